!> A curve of motions along one value of the input, by its arc length: round folds, exactly onto given values, with its folds, the
!> maxima of responses and, where multipliers are known, its bifurcations located.
!>
!> Lengths are counted in the range of the value, and in the largest motion met so far. Steps are as long as the tangent turns
!> little on them, and shorter where the corrector has to work. A curve that starts between the ends of the range is followed both
!> ways. Each point has all that a motion has. Frequencies that are unknown are unknowns of the curve, each with a condition for its
!> phase; of a normal mode the artificial damping as well, with a condition for the amplitude.
!> Source: docs/user/curves.md; docs/user/theory.md, section 6.7.
module hb_motion_curve
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_basis, only: whole_basis
   use hb_bifurcation, only: angle_of_pair, bifurcation, bifurcation_value, is_torus
   use hb_bordered, only: bordered_problem_t, new_bordered_problem
   use hb_clock, only: wall_clock
   use hb_curve, only: curve_config_t, curve_t, event_t, new_curve
   use hb_curve_conditions, only: is_mirrored, set_conditions
   use hb_curve_events, only: bifurcation_event_t, branch_event_t, find_extremes, find_multipliers, fold_event_t, graze_event_t, &
      peak_event_t, sharp, slope_at, square_at, value_event_t
   use hb_curve_origin, only: find_direction
   use hb_curve_request, only: curve_kind, curve_request_t
   use hb_document, only: document_t
   use hb_error, only: error_t
   use hb_judge, only: judge_t
   use hb_kinds, only: wp
   use hb_motion, only: describe_motion, solve_motion
   use hb_motion_result, only: curve_place_t, motion_result_t
   use hb_newton, only: solve_newton
   use hb_outcome, only: outcome
   use hb_scene, only: scene_t
   use hb_scene_problem, only: new_scene_problem, scene_problem_t
   use hb_solver_types, only: report_t, solver_config_t
   use hb_tangent_solver, only: new_tangent_solver, tangent_solver_t
   use hb_text, only: to_text
   use hb_watch, only: verdict, watch_t
   implicit none
   private
   public :: motion_curve_t, state_size

   real(wp), parameter :: largest_turn = 0.6_wp                       ! [rad] on a step, unless it is short
   real(wp), parameter :: short = 1.0e-2_wp                           ! of the longest step
   real(wp), parameter :: located = 1.0e-11_wp                        ! of a function that is zero at a fold or a peak
   real(wp), parameter :: located_multiplier = 1.0e-9_wp              ! of a function that is zero at a bifurcation
   real(wp), parameter :: left_behind = 1.0e-5_wp                     ! value of that function where a curve begins at its zero
   real(wp), parameter :: least_motion = 1.0e-3_wp                    ! relative to the linear one: smaller is no unit of length
   real(wp), parameter :: closed = 0.1_wp                             ! of a step, from the start, when the curve is back there
   real(wp), parameter :: run_up = 0.05_wp                            ! of the longest step, to what is expected next
   integer, parameter :: most_corrections = 10
   real(wp), parameter :: most_slack = 1.0e4_wp
   real(wp), parameter :: first_part = 0.02_wp                        ! of the motion: other ones where they leave a curve

   !> Where another curve crosses.
   type :: origin_t
      real(wp), allocatable :: x(:), direction(:)                     ! there, and along the curve on which it was found
   end type origin_t

   !> A point that waits to be told.
   type :: waiting_t
      integer :: kind = curve_kind%none
      real(wp) :: place = 0.0_wp                                      ! on the step
      real(wp), allocatable :: x(:)
   end type waiting_t

   !> Owner of outside resources: call `destroy`. A variable of this type needs the attribute `target`.
   type :: motion_curve_t
      logical :: is_done = .false.                                    !! there is no further point
      type(curve_request_t), private :: request
      type(scene_problem_t), private :: problem
      type(curve_t), private :: curve
      real(wp), allocatable, private :: weights(:)                    ! typical motion, (unknowns of the balance)
      real(wp), private :: largest = least_motion                     ! motion so far, in these
      integer, private :: way = 1                                     ! 1 and 2 from the start; 2 k + 1 and 2 k + 2 from the k-th
                                                                      ! branch point, along the other curve
      type(origin_t), allocatable, private :: origins(:)              ! branch points met on the ways from the start
      real(wp), allocatable, private :: x_first(:)                    ! the start itself
      real(wp), allocatable, private :: first_direction(:)            ! there, where the curve leaves another one
      real(wp), private :: first_sense = 1.0_wp                       ! of the value on the first way
      real(wp), private :: length = 0.0_wp                            ! of this way so far
      real(wp), allocatable, private :: x_start(:), direction_start(:)
      integer, allocatable, private :: which(:)                       ! parameters of the problem that are unknown, the value last
      real(wp), private :: unevenness = 0.0_wp                        ! of the residual over frequencies, at the start of this way
      logical, private :: is_uneven = .false.                         ! more than the tolerance allows
      real(wp), private :: slack = 1.0_wp                             ! by which it may have grown on the way
      logical, private :: has_collapsed = .false.                     ! the motion of an unknown tone has died out
      logical, private :: is_closed = .false.                         ! this way has come back to its start
      integer, private :: n_told = 0
      integer, private :: first_waiting = 1
      type(waiting_t), allocatable, private :: waiting(:)
      real(wp), allocatable, private :: slopes(:)                     ! of the responses along the curve, at its point
      real(wp), allocatable, private :: extremes(:, :)                ! of the switches of laws, at its point
      complex(wp), allocatable, private :: multipliers(:)             ! at its point; not allocated where they are not looked for
      class(watch_t), pointer, private :: watch => null()
   contains
      procedure :: begin => motion_curve_begin
      procedure :: go_on_from => motion_curve_go_on_from
      procedure :: next => motion_curve_next
      procedure :: begin_next_to => motion_curve_begin_next_to
      procedure :: look_for => motion_curve_look_for
      procedure :: measure => motion_curve_measure
      procedure, nopass :: n_entries
      procedure :: destroy => motion_curve_destroy
      procedure, private :: renew => motion_curve_renew
      procedure, private :: step => motion_curve_step
      procedure, private :: look_back => motion_curve_look_back
      procedure, private :: tell => motion_curve_tell
   end type motion_curve_t

contains

   !> Numbers that the state of a curve takes, of so many unknowns of the balance at most.
   pure integer function state_size(n_unknowns, scene)
      integer, intent(in) :: n_unknowns
      type(scene_t), intent(in) :: scene

      state_size = 2*(n_unknowns + n_further(scene)) + 3
   end function state_size

   !> Number of unknowns in a state, which a file fills up with NaN.
   pure integer function n_entries(state, n_more)
      real(wp), intent(in) :: state(:)
      integer, intent(in) :: n_more                                   !! numbers behind unknowns and direction

      n_entries = (findloc(ieee_is_finite(state), .true., dim=1, back=.true.) - n_more)/2
   end function n_entries

   !> Unknowns beside those of the balance: frequencies, artificial damping, and the value that moves.
   pure integer function n_further(scene)
      type(scene_t), intent(in) :: scene

      n_further = 1 + count(scene%tones%is_unknown)
      if (scene%normal_mode%is_asked) n_further = n_further + 1
   end function n_further

   !> Solves the first motion, by all the ways that a point has; the curve is done with it where that does not lead to one.
   subroutine motion_curve_begin(self, scene, document, request, available_memory, result, error, watch, judge)
      class(motion_curve_t), intent(inout), target :: self
      type(scene_t), intent(inout) :: scene                           !! at the start
      type(document_t), intent(in) :: document                        !! from which it was read
      type(curve_request_t), intent(in) :: request
      real(wp), intent(in) :: available_memory                        !! bytes
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      class(watch_t), intent(inout), target :: watch
      class(judge_t), intent(in), optional :: judge
      real(wp), allocatable :: further(:), unknowns(:)

      self%request = request
      self%watch => watch
      if (allocated(request%origin)) then
         call begin_at_origin(self, scene, document, available_memory, result, error)
         return
      end if
      call solve_motion(scene, result, error, unknowns=unknowns, watch=watch, judge=judge)
      self%is_done = allocated(error) .or. .not. allocated(unknowns)
      if (result%status == outcome%marched) then
         result%status = outcome%stalled                              ! a motion, but no point of a curve
         result%message = "a curve starts from a balance; "//result%message
      end if
      if (self%is_done) return
      further = [pack(result%frequency, scene%tones%is_unknown)]
      if (scene%normal_mode%is_asked) further = [further, pack(result%artificial_damping, scene%tones%is_unknown)]
      further = [further, request%start]
      call prepare(self, scene, document, available_memory, further, error)
      self%is_done = allocated(error)
      if (self%is_done) return
      self%x_first = [unknowns(:self%problem%n_unknowns), further]
      call set_out(self)
      self%n_told = 1
      result%curve = curve_place_t(curve_kind%start, request%start, 0.0_wp, 0, state_of(self))
      self%is_done = self%n_told >= request%n_points
   end subroutine motion_curve_begin

   !> Begins where the curve leaves another one, a small way along it: at the very point the tangent has no inverse.
   subroutine begin_at_origin(self, scene, document, available_memory, result, error)
      class(motion_curve_t), intent(inout), target :: self
      type(scene_t), intent(in) :: scene
      type(document_t), intent(in) :: document
      real(wp), intent(in) :: available_memory                        !! bytes
      type(motion_result_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error
      logical :: is_found

      call prepare(self, scene, document, available_memory, self%request%origin%further, error)
      self%is_done = allocated(error)
      if (self%is_done) return
      call find_first(self, is_found)
      if (.not. is_found) then
         result%status = outcome%stalled
         result%message = "next to the point where it leaves the other curve no motion was found"
         self%is_done = .true.
         return
      end if
      call set_out(self)
      call put_start(self)
      call self%tell(self%waiting(1), result, error)
      self%first_waiting = 2
      self%n_told = 1
      self%is_done = allocated(error) .or. self%n_told >= self%request%n_points
   end subroutine begin_at_origin

   !> The first motion of a curve that leaves another one, and the direction there.
   subroutine find_first(self, is_found)
      class(motion_curve_t), intent(inout), target :: self
      logical, intent(out) :: is_found
      real(wp) :: across(self%problem%n_unknowns), joined
      logical :: is_possible

      associate (origin => self%request%origin, n => self%problem%n_unknowns, n_which => size(self%which))
         self%x_first = [origin%u, origin%further]
         call move(self, self%x_first, is_possible)
         is_found = is_possible
         if (.not. is_found) return
         joined = 0.0_wp
         if (origin%is_torus) joined = self%x_first(n + n_which - 1)
         call find_direction(self%problem, origin, joined, across, is_found)
         if (.not. is_found) return
         if (origin%is_torus) self%x_first(n + n_which - 1) = joined
         across = across/norm2(across/self%weights)*norm2(self%x_first(:n)/self%weights)
         self%first_direction = [across, spread(0.0_wp, 1, n_which)]
         self%x_first = self%x_first + first_part*self%first_direction
      end associate
      call find_on_plane(self, is_found)
   end subroutine find_first

   !> Units of length by one motion.
   function units_at(self, x) result(units)
      class(motion_curve_t), intent(in) :: self
      real(wp), intent(in) :: x(:)
      real(wp) :: units(size(x))

      units = [self%weights*max(least_motion, norm2(x(:self%problem%n_unknowns)/self%weights)), &
               self%problem%parameter_scales(self%which)]
   end function units_at

   !> Corrects the first motion, in the plane across the first direction.
   subroutine find_on_plane(self, is_found)
      class(motion_curve_t), intent(inout), target :: self
      logical, intent(out) :: is_found
      type(bordered_problem_t) :: bordered
      type(report_t) :: report
      type(solver_config_t) :: corrector
      real(wp) :: units(size(self%x_first))
      logical :: is_possible

      call move(self, self%x_first, is_possible)
      is_found = is_possible
      if (.not. is_found) return
      units = units_at(self, self%x_first)
      call new_bordered_problem(bordered, self%problem, self%which, spread(self%first_direction/units**2, 2, size(self%which)), &
                                spread(0.0_wp, 1, size(self%which)))
      self%curve%x = self%x_first
      self%curve%problem = bordered
      call set_conditions(self%problem, self%which, self%curve, self%weights)
      self%curve%problem%values = matmul(self%x_first, self%curve%problem%forms)
      call self%curve%problem%rescale()
      corrector = self%problem%scene%solver
      associate (u => self%x_first(:self%problem%n_unknowns))
         self%unevenness = self%problem%unevenness(u)
         self%is_uneven = 10.0_wp*self%unevenness > corrector%tolerance
         corrector%tolerance = max(corrector%tolerance, 2.0_wp*self%problem%rounding_level(u), 10.0_wp*self%unevenness)
      end associate
      corrector%max_iterations = 2*most_corrections
      self%slack = 1.0_wp
      do
         call solve_newton(self%curve%problem, corrector, self%x_first, report)
         is_found = report%status == outcome%converged
         if (is_found .or. .not. self%is_uneven .or. self%slack >= most_slack) exit
         self%slack = 10.0_wp*self%slack
         corrector%tolerance = 10.0_wp*corrector%tolerance
         self%x_first = self%curve%x
      end do
   end subroutine find_on_plane

   !> Takes the place of `begin`: next to a motion and tangent of another curve, in the plane across this a bit before it, so that
   !> what is there lies ahead. `is_found` is false where there is no motion.
   subroutine motion_curve_begin_next_to(self, scene, document, request, available_memory, x, direction, is_found, error, watch)
      class(motion_curve_t), intent(inout), target :: self
      type(scene_t), intent(in) :: scene
      type(document_t), intent(in) :: document                        !! from which it was read
      type(curve_request_t), intent(in) :: request
      real(wp), intent(in) :: available_memory                        !! bytes
      real(wp), intent(in) :: x(:), direction(:)                      !! unknowns and tangent of the other curve
      logical, intent(out) :: is_found
      type(error_t), allocatable, intent(out) :: error
      class(watch_t), intent(inout), target :: watch

      self%request = request
      self%watch => watch
      self%way = 1
      is_found = .false.
      if (allocated(self%waiting)) deallocate (self%waiting, self%origins)
      call prepare(self, scene, document, available_memory, x(size(x) - n_further(scene) + 1:), error)
      if (allocated(error)) return
      self%x_first = x - run_up*request%longest_step*direction/norm2(direction/units_at(self, x))
      self%first_direction = direction
      call find_on_plane(self, is_found)
      if (is_found) call set_out(self)
      self%first_waiting = 1
   end subroutine motion_curve_begin_next_to

   !> Goes on to the first point of a kind, if so many steps lead there, and tells that point alone.
   subroutine motion_curve_look_for(self, kind, most_steps, result, n_steps, is_found, error)
      class(motion_curve_t), intent(inout), target :: self
      integer, intent(in) :: kind, most_steps
      type(motion_result_t), intent(out) :: result
      integer, intent(out) :: n_steps
      logical, intent(out) :: is_found
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      is_found = .false.
      do n_steps = 1, most_steps
         call self%step()
         if (self%curve%status /= outcome%pending) return
         i = findloc(self%waiting%kind, kind, dim=1)
         is_found = i > 0
         if (is_found) exit
         self%first_waiting = size(self%waiting) + 1
      end do
      if (.not. is_found) return
      call self%tell(self%waiting(i), result, error)
      call count_work(self%curve%report, report_t(), result)
   end subroutine motion_curve_look_for

   !> The first response of the request at a stored state.
   real(wp) function motion_curve_measure(self, state) result(measure)
      class(motion_curve_t), intent(inout), target :: self
      real(wp), intent(in) :: state(:)

      measure = 0.0_wp
      if (size(self%request%peaks) > 0) &
         measure = sqrt(square_at(self%problem, self%which, self%request%peaks(1), state(:size(self%x_first))))
   end function motion_curve_measure

   !> The list of points that wait is the start of this way alone.
   subroutine put_start(self)
      class(motion_curve_t), intent(inout) :: self

      if (allocated(self%waiting)) deallocate (self%waiting)
      allocate (self%waiting(1))
      self%waiting(1)%kind = curve_kind%start
      self%waiting(1)%x = self%x_start
      self%first_waiting = 1
   end subroutine put_start

   !> The problem of the curve, at its start.
   subroutine prepare(self, scene, document, available_memory, further, error)
      class(motion_curve_t), intent(inout), target :: self
      type(scene_t), intent(in) :: scene
      type(document_t), intent(in) :: document
      real(wp), intent(in) :: available_memory
      real(wp), intent(in) :: further(:)                              !! unknowns beside those of the balance, at the start
      type(error_t), allocatable, intent(out) :: error
      type(scene_t) :: found
      integer :: i, n_unknown

      found = scene
      associate (tones => found%tones)
         n_unknown = count(tones%is_unknown)
         self%which = pack([(i, i=1, tones%n_tones)], tones%is_unknown)
         tones%omega(self%which) = further(:n_unknown)
         if (scene%normal_mode%is_asked) self%which = [self%which, tones%n_tones + self%which]
      end associate
      self%problem%watch => self%watch
      call new_scene_problem(self%problem, found, document, self%request%moving, self%request%start, available_memory, error)
      if (allocated(error)) return
      self%which = [self%which, self%problem%own]
      self%weights = self%problem%x_scale
      if (.not. allocated(self%request%values)) allocate (self%request%values(0))
      if (.not. allocated(self%request%peaks)) allocate (self%request%peaks(0))
      do i = 1, size(self%request%peaks)
         associate (peak => self%request%peaks(i))
            peak%column = self%problem%balance%stiffness%coordinates%number_of(peak%dof)
         end associate
      end do
      allocate (self%waiting(0), self%origins(0))
      self%first_sense = sign(1.0_wp, self%request%to - self%request%start)
      if (.not. abs(self%request%to - self%request%start) > 0.0_wp) self%first_sense = -sign(1.0_wp, self%first_sense)
   end subroutine prepare

   !> The curve at the start of this way.
   subroutine set_out(self)
      class(motion_curve_t), intent(inout), target :: self
      type(bordered_problem_t) :: bordered
      type(curve_config_t) :: config
      type(solver_config_t) :: corrector
      real(wp), dimension(size(self%x_first)) :: direction, units
      real(wp) :: forms(size(self%x_first), size(self%which))
      logical :: is_possible

      config%longest_step = self%request%longest_step
      config%first_step = 0.1_wp*config%longest_step
      config%shortest_step = 1.0e-6_wp*config%longest_step
      config%kink_step = 1.0e-4_wp*config%longest_step
      config%angle = 0.12_wp
      config%growth = 2.0_wp
      corrector = self%problem%scene%solver
      corrector%max_iterations = most_corrections
      corrector%line_search = .false.
      self%x_start = self%x_first
      direction = 0.0_wp
      direction(size(direction)) = self%first_sense*sense_of(self)
      if (allocated(self%first_direction)) direction = self%first_direction
      if (self%way > 2) then
         self%x_start = self%origins((self%way - 1)/2)%x
         direction = self%origins((self%way - 1)/2)%direction
      end if
      self%has_collapsed = .false.
      self%length = 0.0_wp
      self%largest = least_motion
      call move(self, self%x_start, is_possible)
      self%slack = 1.0_wp
      self%unevenness = self%problem%unevenness(self%x_start(:self%problem%n_unknowns))
      self%is_uneven = 10.0_wp*self%unevenness > corrector%tolerance
      forms = 0.0_wp
      forms(:, size(self%which)) = direction
      call new_bordered_problem(bordered, self%problem, self%which, forms, 0.0_wp*forms(1, :))
      self%curve%x = self%x_start
      self%curve%problem = bordered
      call self%renew()
      call set_conditions(self%problem, self%which, self%curve, self%weights)
      bordered = self%curve%problem
      units = self%curve%units
      if (self%is_uneven) config%shortest_step = 1.0e-3_wp*config%longest_step   ! no step is as short as to help
      call new_curve(self%curve, bordered, self%x_start, direction, units, config, corrector)
      if (self%way > 2) then
         call turn_off(self, direction)
         self%curve%direction = sense_of(self)*direction
         self%curve%orientation = 0.0_wp                              ! not known where the determinant vanishes
         self%curve%status = outcome%pending
      end if
      self%direction_start = self%curve%direction
      call self%renew()
      self%slopes = slopes_of(self)
      call find_multipliers(self%problem, self%which, self%curve%x, self%problem%scene%stability%tolerance, self%multipliers)
      call find_extremes(self%problem, self%which, self%curve%x, self%extremes)
   end subroutine set_out

   !> 1 on the first of two ways from one point, -1 on the other.
   pure real(wp) function sense_of(self)
      class(motion_curve_t), intent(in) :: self

      sense_of = merge(1.0_wp, -1.0_wp, modulo(self%way, 2) == 1)
   end function sense_of

   !> At a branch point the tangent bordered by the direction has a null vector: the direction of the other curve across this one,
   !> by inverse iteration.
   subroutine turn_off(self, direction)
      class(motion_curve_t), intent(inout), target :: self
      real(wp), intent(inout), contiguous :: direction(:)             !! of the curve; of the other one
      type(tangent_solver_t) :: solver
      real(wp) :: along(size(direction)), next(size(direction))
      integer :: i
      integer, parameter :: n_rounds = 3
      real(wp), parameter :: nearby = 1.0e-9_wp                       ! where the tangent is not singular to the last digit
      logical :: is_singular

      associate (curve => self%curve)
         along = direction/curve%units
         along = along/norm2(along)
         call curve%put_plane(curve%x, direction, 0.0_wp)
         next = curve%units*across(cos([(real(i, wp), i=1, size(next))]), along)
         call new_tangent_solver(solver, curve%problem, curve%x, is_singular)
         if (is_singular) call new_tangent_solver(solver, curve%problem, curve%x + nearby*direction, is_singular)
         if (is_singular) return
         do i = 1, n_rounds
            next = next/curve%units*curve%problem%r_scale             ! as a residual
            call solver%solve(curve%problem, next, is_singular)
            next = curve%units*across(next/curve%units, along)
         end do
         direction = next
      end associate

   contains

      !> The part of a vector across another one, of length 1.
      pure function across(vector, other) result(part)
         real(wp), intent(in) :: vector(:), other(:)
         real(wp) :: part(size(vector))

         part = vector - dot_product(vector, other)*other
         part = part/norm2(part)
      end function across
   end subroutine turn_off

   !> Moves the problem to the parameters of a point.
   subroutine move(self, x, is_possible)
      class(motion_curve_t), intent(inout), target :: self
      real(wp), intent(in) :: x(:)
      logical, intent(out) :: is_possible

      call self%problem%set_parameters(self%which, x(self%problem%n_unknowns + 1:), is_possible)
   end subroutine move

   !> All that the curve needs to go on from its point, as one row of numbers.
   function state_of(self) result(state)
      class(motion_curve_t), intent(in) :: self
      real(wp), allocatable :: state(:)

      associate (curve => self%curve)
         state = [curve%x, curve%direction, curve%step, curve%orientation, self%largest]
      end associate
   end function state_of

   !> Takes the place of `begin`: the curve stands where a stored one has been at its last point, a step or the start of a way.
   subroutine motion_curve_go_on_from(self, scene, document, request, available_memory, stored, error, watch)
      class(motion_curve_t), intent(inout), target :: self
      type(scene_t), intent(in) :: scene                              !! at the start
      type(document_t), intent(in) :: document                        !! from which it was read
      type(curve_request_t), intent(in) :: request
      real(wp), intent(in) :: available_memory                        !! bytes
      type(curve_place_t), intent(in) :: stored(:)                    !! all points up to the one to go on from
      type(error_t), allocatable, intent(out) :: error
      class(watch_t), intent(inout), target :: watch
      integer :: i, n

      self%request = request
      self%watch => watch
      n = n_entries(stored(1)%state, 3)
      call prepare(self, scene, document, available_memory, stored(1)%state(n - n_further(scene) + 1:n), error)
      self%is_done = allocated(error)
      if (self%is_done) return
      self%x_first = stored(1)%state(:n)
      if (allocated(request%origin)) self%first_direction = stored(1)%state(n + 1:2*n)
      do i = 2, size(stored)
         if (stored(i)%kind == curve_kind%branch .and. stored(i)%branch == 0 .and. request%switches) &
            call note_origin(self, stored(i)%state(:2*n))
      end do
      associate (last => stored(size(stored)))
         self%way = 2*last%branch + merge(2, 1, last%length < 0.0_wp .or. &
                                          (last%branch > 0 .and. count(stored%kind == curve_kind%start .and. &
                                                                       stored%branch == last%branch) > 1))
         call set_out(self)
         self%n_told = size(stored)
         self%length = abs(last%length)
         self%curve%x = last%state(:n)
         self%curve%direction = last%state(n + 1:2*n)
         self%curve%step = last%state(2*n + 1)
         self%curve%orientation = last%state(2*n + 2)
         self%largest = last%state(2*n + 3)
      end associate
      call self%renew()
      self%slopes = slopes_of(self)
      call find_multipliers(self%problem, self%which, self%curve%x, self%problem%scene%stability%tolerance, self%multipliers)
      call find_extremes(self%problem, self%which, self%curve%x, self%extremes)
      self%is_done = self%n_told >= request%n_points
   end subroutine motion_curve_go_on_from

   !> Brings the units of length and the tolerance to the point reached.
   subroutine motion_curve_renew(self)
      class(motion_curve_t), intent(inout), target :: self
      logical :: is_possible

      call move(self, self%curve%x, is_possible)
      associate (n => self%problem%n_unknowns, curve => self%curve)
         self%largest = max(self%largest, norm2(curve%x(:n)/self%weights))
         curve%units = [self%weights*self%largest, self%problem%parameter_scales(self%which)]
         curve%corrector%tolerance = max(self%problem%scene%solver%tolerance, 2.0_wp*self%problem%rounding_level(curve%x(:n)), &
                                         10.0_wp*self%slack*self%unevenness)
      end associate
   end subroutine motion_curve_renew

   !> The next point. Its status tells where there is no way on; `interrupted`: nothing was found out, and the curve is done.
   subroutine motion_curve_next(self, result, error)
      class(motion_curve_t), intent(inout), target :: self
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      type(report_t) :: before
      real(wp) :: started
      logical :: is_end

      started = wall_clock()
      call self%watch%begin(self%problem%scene%solver%time_limit)
      before = self%curve%report
      if (self%first_waiting > size(self%waiting)) call self%step()
      if (self%curve%status /= outcome%pending) then
         result%status = self%curve%status
         if (self%watch%verdict == verdict%interrupted) result%status = outcome%interrupted
         if (self%has_collapsed) result%status = outcome%collapsed
         result%message = lost_text(self)
         call count_work(self%curve%report, before, result)
         call leave(self)
         if (result%status == outcome%interrupted) self%is_done = .true.
      else
         associate (point => self%waiting(self%first_waiting))
            call self%tell(point, result, error)
            self%first_waiting = self%first_waiting + 1
            call count_work(self%curve%report, before, result)
            is_end = point%kind == curve_kind%end
         end associate
         if (is_end) call leave(self)
      end if
      result%solver_seconds = wall_clock() - started - result%certificate_seconds
      self%n_told = self%n_told + 1
      self%is_done = self%is_done .or. self%n_told >= self%request%n_points
   end subroutine motion_curve_next

   !> Notes what a point has taken.
   pure subroutine count_work(report, before, result)
      type(report_t), intent(in) :: report, before                    !! of the curve
      type(motion_result_t), intent(inout) :: result

      result%iterations = report%iterations - before%iterations
      result%evaluations = report%evaluations - before%evaluations
   end subroutine count_work

   !> Where and why the curve cannot be followed.
   function lost_text(self) result(text)
      class(motion_curve_t), intent(in) :: self
      character(:), allocatable :: text

      if (self%has_collapsed) then
         text = "the motion of an unknown tone died out next to the value "//to_text(self%curve%x(size(self%curve%x)))
         return
      end if
      text = "no way on along the curve from the value "//to_text(self%curve%x(size(self%curve%x)))//" after the length "// &
             to_text(self%length)
      if (allocated(self%problem%complaint)) text = text//": "//self%problem%complaint
   end function lost_text

   !> This way has come to its end: the next one follows where there is one, along another curve behind a row for its start.
   subroutine leave(self)
      class(motion_curve_t), intent(inout), target :: self

      if (self%is_closed .and. modulo(self%way, 2) == 1) self%way = self%way + 1   ! the other way would be the same
      self%is_closed = .false.
      self%way = self%way + 1
      if (self%way == 2 .and. .not. is_inside(self%request, self%request%start)) self%way = 3
      if (self%way == 2 .and. allocated(self%request%origin)) self%way = 3   ! the other way has the same motions, shifted
      self%is_done = self%way > 2*(1 + size(self%origins))
      if (self%is_done) return
      call set_out(self)
      if (self%way <= 2) return
      call put_start(self)
   end subroutine leave

   !> Adds a branch point to those from which other curves are followed.
   subroutine note_origin(self, state)
      class(motion_curve_t), intent(inout) :: self
      real(wp), intent(in) :: state(:)                                !! its unknowns, and the direction of the curve
      type(origin_t), allocatable :: longer(:)

      allocate (longer(size(self%origins) + 1))
      longer(:size(self%origins)) = self%origins
      longer(size(longer))%x = state(:size(state)/2)
      longer(size(longer))%direction = state(size(state)/2 + 1:)
      call move_alloc(longer, self%origins)
   end subroutine note_origin

   !> Whether a value is in the range, and at none of its ends.
   pure logical function is_inside(request, value)
      type(curve_request_t), intent(in) :: request
      real(wp), intent(in) :: value

      is_inside = (value - request%from)*(value - request%to) < 0.0_wp
   end function is_inside

   !> Goes one step, and puts what was found on it and its end into the list of those that wait.
   subroutine motion_curve_step(self)
      class(motion_curve_t), intent(inout), target :: self
      complex(wp), allocatable :: multipliers(:)
      real(wp), allocatable :: extremes(:, :), slopes(:)
      real(wp) :: largest, units(size(self%curve%x))
      integer :: n_branch_points
      logical :: is_possible

      if (allocated(self%problem%complaint)) deallocate (self%problem%complaint)
      call move(self, self%curve%x, is_possible)
      call self%problem%renew()                                       ! a stored curve, too, goes on from there
      self%slack = 1.0_wp
      call set_conditions(self%problem, self%which, self%curve, self%weights)
      associate (curve => self%curve)
         do
            largest = self%largest
            units = curve%units
            n_branch_points = curve%n_branch_points
            call curve%advance()
            if (curve%status == outcome%stalled) call try_end(self)
            if (curve%status == outcome%stalled .and. self%is_uneven .and. self%slack < most_slack) then
               self%slack = 10.0_wp*self%slack
               call self%renew()
               curve%status = outcome%pending
               curve%step = curve%config%first_step
               cycle
            end if
            if (curve%status /= outcome%pending .or. size(self%waiting) >= self%first_waiting) return
            call self%renew()
            call curve%turn()
            if (curve%angle <= largest_turn .or. curve%last_step <= short*curve%config%longest_step) exit
            call curve%retreat()
            if (curve%status == outcome%stalled) call try_end(self)
            if (curve%status /= outcome%pending .or. size(self%waiting) >= self%first_waiting) return
            self%largest = largest
            curve%units = units
         end do
         self%has_collapsed = is_mirrored(self%problem, self%which, self%curve, self%weights)
         if (self%has_collapsed) then
            curve%status = outcome%collapsed
            return
         end if
         slopes = slopes_of(self)
         deallocate (self%waiting)
         allocate (self%waiting(0))
         self%first_waiting = 1
         call find_multipliers(self%problem, self%which, curve%x, self%problem%scene%stability%tolerance, multipliers)
         call find_extremes(self%problem, self%which, curve%x, extremes)
         call self%look_back(self%slopes, slopes, curve%n_branch_points > n_branch_points, multipliers, extremes)
         self%slopes = slopes
         call move_alloc(multipliers, self%multipliers)
         call move_alloc(extremes, self%extremes)
      end associate
   end subroutine motion_curve_step

   !> Lands on an end of the range that is ahead and so near that no step fits in between: there may be nothing beyond.
   subroutine try_end(self)
      class(motion_curve_t), intent(inout), target :: self
      real(wp), parameter :: very_near = 1.0e-4_wp                    ! of the range
      real(wp) :: ends(2), gap, x(size(self%curve%x))
      integer :: i, n
      logical :: is_there

      n = size(x)
      ends = [self%request%from, self%request%to]
      do i = 1, size(ends)
         associate (curve => self%curve)
            gap = ends(i) - curve%x(n)
            if (abs(gap) > very_near*curve%units(n) .or. .not. gap*curve%direction(n) > 0.0_wp) cycle
            x = curve%x + gap/curve%direction(n)*curve%direction
            x(n) = ends(i)
            call land(self, x, is_there)
            if (.not. is_there) cycle
            curve%status = outcome%pending
            deallocate (self%waiting)
            allocate (self%waiting(1))
            self%waiting(1)%kind = curve_kind%end
            self%waiting(1)%place = norm2((x - curve%x)/curve%units)
            self%waiting(1)%x = x
            self%first_waiting = 1
            return
         end associate
      end do
   end subroutine try_end

   !> Finds folds, peaks, bifurcations, wanted values and ends on the step behind the curve, in their order.
   subroutine motion_curve_look_back(self, slopes_before, slopes, has_branched, multipliers, extremes)
      class(motion_curve_t), intent(inout), target :: self
      real(wp), intent(in) :: slopes_before(:), slopes(:)             !! of the responses
      logical, intent(in) :: has_branched                             !! a branch point was passed by
      complex(wp), allocatable, intent(in) :: multipliers(:)          !! at the point of the curve
      real(wp), intent(in) :: extremes(:, :)                          !! of switches, likewise
      type(bifurcation_event_t) :: change
      type(branch_event_t) :: branch
      type(fold_event_t) :: fold
      type(graze_event_t) :: graze
      type(peak_event_t) :: peak
      type(value_event_t) :: event
      real(wp), allocatable :: ends(:), wanted(:), x(:)
      real(wp) :: places(3), values(3)
      integer :: i, k, n, n_pieces
      logical :: is_found, is_there

      n = size(self%curve%x)
      allocate (x(n))
      associate (curve => self%curve, request => self%request)
         if (self%is_uneven) curve%corrector%tolerance = 10.0_wp*curve%corrector%tolerance   ! of many points
         n_pieces = 1
         places = [0.0_wp, curve%last_step, curve%last_step]
         values = [curve%last_x(n), curve%x(n), curve%x(n)]
         if (curve%last_direction(n)*curve%direction(n) < 0.0_wp .and. .not. (self%way > 2 .and. self%length <= 0.0_wp)) then
            fold%curve = curve
            call find(fold, [curve%last_direction(n), curve%direction(n)]/curve%units(n), &
                      max(located, 10.0_wp*curve%corrector%tolerance), curve_kind%fold)
            if (is_found) then
               n_pieces = 2
               places(2) = self%waiting(size(self%waiting))%place
               values(2) = x(n)
            end if
         end if
         if (has_branched) then
            branch%curve = curve
            call find(branch, [-curve%orientation, curve%orientation], 0.0_wp, curve_kind%branch)
         end if
         do i = 1, size(request%peaks)
            if (.not. (slopes_before(i) > 0.0_wp .and. slopes(i) <= 0.0_wp)) cycle
            peak%curve = curve
            peak%problem => self%problem
            peak%response = request%peaks(i)
            peak%unit = square_at(self%problem, self%which, request%peaks(i), curve%x)
            if (.not. peak%unit > 0.0_wp) cycle
            call find(peak, [slopes_before(i), slopes(i)]/peak%unit, max(located, 10.0_wp*curve%corrector%tolerance), &
                      curve_kind%peak)
         end do
         graze%problem => self%problem
         graze%which = self%which
         do k = 1, size(extremes, 2)
            if (size(self%extremes, 2) /= size(extremes, 2)) exit
            graze%switch = k
            graze%unit = max(maxval(abs(extremes(:, k))), tiny(1.0_wp))
            do i = 1, 2
               if (.not. self%extremes(i, k)*extremes(i, k) < 0.0_wp) cycle
               if (i == 2 .and. same_change(self%extremes(:, k), extremes(:, k))) cycle   ! all round the same distance: one event
               graze%extreme = i
               call find(graze, [self%extremes(i, k), extremes(i, k)]/graze%unit, max(located, 10.0_wp*curve%corrector%tolerance), &
                         curve_kind%graze)
            end do
         end do
         if (allocated(self%multipliers) .and. allocated(multipliers) .and. all(self%waiting%kind /= curve_kind%graze)) then
            change%problem => self%problem
            change%which = self%which
            do i = bifurcation%branch, bifurcation%torus
               if (i == bifurcation%branch .and. (n_pieces > 1 .or. has_branched)) cycle   ! that is known
               change%kind = i
               call find_bifurcation([bifurcation_value(i, self%multipliers), bifurcation_value(i, multipliers)])
            end do
         end if
         ends = [request%from, request%to]
         wanted = [ends, request%values]
         event%unit = abs(request%to - request%from)
         do i = 1, size(wanted)
            if (i > 2 .and. any(abs(wanted(i) - ends) <= 0.0_wp)) cycle
            event%wanted = wanted(i)
            do k = 1, n_pieces
               if (.not. (values(k) - wanted(i))*(values(k + 1) - wanted(i)) < 0.0_wp) then
                  if (.not. abs(values(k + 1) - wanted(i)) <= 0.0_wp) cycle
               end if
               call curve%find_zero(event, places(k:k + 1), (values(k:k + 1) - wanted(i))/event%unit, 1.0e-13_wp, x, places(3), &
                                    is_found)
               if (.not. is_found) cycle
               x(n) = wanted(i)
               call land(self, x, is_there)
               call add(merge(curve_kind%end, curve_kind%value, i <= 2), places(3), x)
            end do
         end do
         self%is_closed = is_back(self)
         if (self%is_closed) call add(curve_kind%end, curve%last_step, self%x_start)
         call add(curve_kind%regular, curve%last_step, curve%x)
      end associate
      call put_in_order(self%waiting)

   contains

      subroutine find(an_event, at_ends, tolerance, kind)
         class(event_t), intent(inout) :: an_event
         real(wp), intent(in) :: at_ends(2), tolerance
         integer, intent(in) :: kind
         real(wp) :: place

         call self%curve%find_zero(an_event, [0.0_wp, self%curve%last_step], at_ends, tolerance, x, place, is_found)
         if (is_found) call add(kind, place, x)
      end subroutine find

      !> Between two points at which the function of `change` is known; real multipliers that pass each other's inverse are none.
      subroutine find_bifurcation(at_ends)
         real(wp), intent(in) :: at_ends(2)
         complex(wp), allocatable :: there(:)
         real(wp) :: place

         if (.not. at_ends(1)*at_ends(2) < 0.0_wp .or. minval(abs(at_ends)) < left_behind) return
         call self%curve%find_zero(change, [0.0_wp, self%curve%last_step], at_ends, located_multiplier, x, place, is_found)
         if (.not. is_found) return
         if (change%kind == bifurcation%torus) then
            call find_multipliers(self%problem, self%which, x, sharp, there)
            if (.not. allocated(there)) return
            if (.not. is_torus(there)) return
         end if
         select case (change%kind)
         case (bifurcation%branch); call add(curve_kind%split, place, x)
         case (bifurcation%doubling); call add(curve_kind%flip, place, x)
         case default; call add(curve_kind%torus, place, x)
         end select
      end subroutine find_bifurcation

      subroutine add(kind, place, x_there)
         integer, intent(in) :: kind
         real(wp), intent(in) :: place, x_there(:)
         type(waiting_t), allocatable :: longer(:)

         associate (n_before => size(self%waiting))
            allocate (longer(n_before + 1))
            longer(:n_before) = self%waiting
            longer(n_before + 1)%kind = kind
            longer(n_before + 1)%place = place
            longer(n_before + 1)%x = x_there
         end associate
         call move_alloc(longer, self%waiting)
      end subroutine add
   end subroutine motion_curve_look_back

   !> Whether both extremes are the same before and after, as of a whirl round the middle of a ring.
   pure logical function same_change(before, after)
      real(wp), intent(in) :: before(2), after(2)
      real(wp), parameter :: round = 1.0e-9_wp

      same_change = abs(before(2) - before(1)) <= round*maxval(abs(before)) .and. &
         abs(after(2) - after(1)) <= round*maxval(abs(after))
   end function same_change

   !> Solves for the motion at the value of x, next to where it is.
   subroutine land(self, x, is_there)
      class(motion_curve_t), intent(inout), target :: self
      real(wp), intent(inout) :: x(:)
      logical, intent(out) :: is_there                                !! else x stays what it was
      type(bordered_problem_t) :: problem
      type(report_t) :: report
      real(wp), parameter :: near = 1.0e-6_wp
      real(wp) :: there(size(x))
      integer :: last

      problem = self%curve%problem
      last = size(self%which)
      problem%forms(:, last) = 0.0_wp
      problem%forms(size(x), last) = 1.0_wp
      problem%values(last) = x(size(x))
      call problem%rescale()
      there = x
      call solve_newton(problem, self%curve%corrector, there, report)
      call self%curve%report%add(report)
      there(size(x)) = x(size(x))
      is_there = report%status == outcome%converged .and. maxval(abs(there - x)/self%curve%units) < near   ! at a fold it may not
      if (is_there) x = there
   end subroutine land

   !> Whether the curve has come back to its start, after steps that led away from it.
   logical function is_back(self)
      class(motion_curve_t), intent(in) :: self
      real(wp) :: along

      is_back = .false.
      associate (curve => self%curve, units => self%curve%units)
         if (self%length < 3.0_wp*curve%last_step) return
         associate (way => (self%x_start - curve%last_x)/units, direction => curve%last_direction/units)
            along = dot_product(way, direction)/norm2(direction)
            if (along <= 0.0_wp .or. along > curve%last_step) return
            if (norm2(way - along*direction/norm2(direction)) > closed*curve%last_step) return
            is_back = dot_product(self%direction_start/units, direction) > 0.0_wp
         end associate
      end associate
   end function is_back

   !> Puts points into their order on the step, and drops those behind an end.
   subroutine put_in_order(points)
      type(waiting_t), allocatable, intent(inout) :: points(:)
      type(waiting_t), allocatable :: up_to_end(:)
      type(waiting_t) :: point
      integer :: i, k

      do i = 2, size(points)
         point = points(i)
         k = i - 1
         do while (k >= 1)
            if (points(k)%place <= point%place) exit
            points(k + 1) = points(k)
            k = k - 1
         end do
         points(k + 1) = point
      end do
      i = findloc(points%kind, curve_kind%end, dim=1)
      if (i == 0) return
      allocate (up_to_end(i))
      up_to_end = points(:i)
      call move_alloc(up_to_end, points)
   end subroutine put_in_order

   !> Makes the result of a point.
   subroutine motion_curve_tell(self, point, result, error)
      class(motion_curve_t), intent(inout), target :: self
      type(waiting_t), intent(in) :: point
      type(motion_result_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: length, r(self%problem%n_unknowns)
      integer :: n
      logical :: is_certified, is_possible

      n = self%problem%n_unknowns
      call move(self, point%x, is_possible)
      associate (balance => self%problem%balance, scene => self%problem%scene)
         call self%problem%residual(point%x(:n), r)
         result%residual = self%problem%norm(r)
         result%status = outcome%converged
         result%frequency = balance%omega
         if (scene%normal_mode%is_asked) result%artificial_damping = balance%xi
         result%n_harmonics = scene%harmonics%n_harmonics
         result%n_unknowns = n
         nullify (balance%watch)                                      ! what a solution is worth is always found to its end
         is_certified = scene%certificate%is_on
         if (any(point%kind == [curve_kind%branch, curve_kind%start])) scene%certificate%is_on = .false.   ! it has no tangent
         call self%curve%put_plane(point%x, self%curve%direction, 0.0_wp)
         call describe_motion(scene, whole_basis(scene%harmonics, scene%torus), balance, &
                              reshape(point%x(:n), [scene%harmonics%n_coefficients, balance%n_dofs]), result, error, &
                              curve=self%curve%problem)
         scene%certificate%is_on = is_certified
         balance%watch => self%watch
      end associate
      if (allocated(error)) return
      length = self%length + point%place
      result%curve = curve_place_t(point%kind, point%x(size(point%x)), sense_of(self)*length, (self%way - 1)/2, point%x)
      if (point%kind == curve_kind%regular .or. point%kind == curve_kind%start) then
         self%length = length
         result%curve%state = state_of(self)
      else if (point%kind == curve_kind%branch) then
         result%curve%state = [point%x, self%curve%direction]
         if (self%request%switches .and. self%way <= 2) call note_origin(self, result%curve%state)
      else if (any(point%kind == [curve_kind%fold, curve_kind%peak])) then
         result%curve%state = [point%x, self%curve%direction]
      else if (any(point%kind == [curve_kind%flip, curve_kind%torus]) .and. allocated(result%stability%multipliers)) then
         result%curve%state = [point%x, self%curve%direction, angle_of_pair(result%stability%multipliers)]
      end if
   end subroutine motion_curve_tell

   !> Slopes of the squares of all responses along the curve, at its point.
   function slopes_of(self) result(slopes)
      class(motion_curve_t), intent(inout), target :: self
      real(wp) :: slopes(size(self%request%peaks))
      integer :: i

      do i = 1, size(slopes)
         slopes(i) = slope_at(self%problem, self%which, self%request%peaks(i), self%curve%x, self%curve%direction)
      end do
   end function slopes_of

   !> Frees the balance; safe to call twice.
   subroutine motion_curve_destroy(self)
      class(motion_curve_t), intent(inout) :: self

      call self%problem%destroy()
   end subroutine motion_curve_destroy
end module hb_motion_curve
