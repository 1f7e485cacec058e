!> A curve of motions along one value of the input, by its arc length: round folds, exactly onto given values, with its folds, the
!> maxima of responses and, where multipliers are known, its bifurcations located.
!>
!> Lengths are counted in the range of the value, and in the largest motion met so far. Steps are as long as the tangent turns
!> little on them, and shorter where the corrector has to work. A curve that starts between the ends of the range is followed both
!> ways. Each point has all that a motion has. Frequencies that are unknown are unknowns of the curve, each with a condition for its
!> phase; of a normal mode the artificial damping as well, with a condition for the amplitude.
!> Source: docs/user/curves.md; docs/user/theory.md, section 6.7.
module hb_motion_curve
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite, ieee_is_nan
   use hb_basis, only: whole_basis
   use hb_bifurcation, only: angle_of_pair
   use hb_clock, only: wall_clock
   use hb_curve, only: curve_t
   use hb_curve_events, only: find_extremes, find_stability, slope_at, square_at
   use hb_curve_request, only: curve_kind, curve_request_t
   use hb_document, only: document_t
   use hb_error, only: error_t
   use hb_judge, only: judge_t
   use hb_kinds, only: wp
   use hb_motion_description, only: describe_motion
   use hb_motion_result, only: curve_place_t, motion_result_t
   use hb_outcome, only: outcome
   use hb_rung, only: estimate_of, rung_t, with_caution
   use hb_scene, only: scene_t
   use hb_scene_problem, only: scene_problem_t
   use hb_solver_types, only: report_t
   use hb_stability, only: stability_t
   use hb_text, only: to_text
   use hb_watch, only: verdict, watch_t
   implicit none
   private
   public :: motion_curve_t, state_size

   real(wp), parameter :: least_motion = 1.0e-3_wp                    ! relative to the linear one: smaller is no unit of length
   real(wp), parameter :: most_slack = 1.0e4_wp
   real(wp), parameter :: nearby = 1.0e-4_wp                          ! of the range: a refused value at which a curve ends

   !> Where another curve crosses, or a motion apart from the curves before.
   type :: origin_t
      logical :: is_apart = .false.
      real(wp), allocatable :: x(:), direction(:)                     ! there, and along the curve on which it was found
      type(rung_t) :: rung                                            ! set and grid of both
   end type origin_t

   !> A point that waits to be told.
   type :: waiting_t
      integer :: kind = curve_kind%none
      real(wp) :: place = 0.0_wp                                      ! on the step
      real(wp), allocatable :: x(:)
      type(stability_t), allocatable :: stability                     ! where that is known
      type(motion_result_t), allocatable :: result                    ! what is known of it already
      integer :: response = 0                                         ! that has its peak there, of those of the request
   end type waiting_t

   !> A fold or peak that was reported.
   type :: extreme_told_t
      integer :: response = 0                                         ! of the request; 0: a fold
      real(wp) :: length = 0.0_wp                                     ! of this way up to there
   end type extreme_told_t

   !> The curve at one of its points.
   type :: standing_t
      type(rung_t) :: rung
      type(curve_t) :: curve
      real(wp) :: largest = 0.0_wp
      real(wp), allocatable :: slopes(:), extremes(:, :)
      type(stability_t) :: stability
   end type standing_t

   !> Owner of outside resources: call `destroy`. A variable of this type needs the attribute `target`.
   type :: motion_curve_t
      logical :: is_done = .false.                                    !! there is no further point
      type(curve_request_t), private :: request
      type(scene_t), private :: scene                                 ! at the start, as it was read
      type(document_t), private :: document
      real(wp), allocatable, private :: further(:)                    ! unknowns beside those of the balance, at the start
      type(rung_t), private :: rung                                   ! set and grid at hand
      real(wp), private :: estimate = huge(1.0_wp)                    ! of the error at the point of the curve; huge: not known
      integer, private :: n_rungs = 1                                 ! that the last step has taken
      type(scene_problem_t), private :: problem
      type(scene_problem_t), allocatable, private :: odd_problem      ! of odd motions alone, where the equations are odd
      integer, allocatable, private :: odd_places(:)                  ! of its unknowns among those of the problem
      type(curve_t), private :: curve
      real(wp), allocatable, private :: weights(:)                    ! typical motion, (unknowns of the balance)
      real(wp), private :: largest = least_motion                     ! motion so far, in these
      integer, private :: way = 1                                     ! 1 and 2 from the start; 2 k + 1 and 2 k + 2 from the k-th
                                                                      ! branch point, along the other curve, or motion apart
      type(origin_t), allocatable, private :: origins(:)              ! branch points met on the ways from the start, motions apart
      type(origin_t), allocatable, private :: met(:)                  ! motions at values at which others are sought
      real(wp), allocatable, private :: x_first(:)                    ! the start itself
      real(wp), allocatable, private :: first_direction(:)            ! there, where the curve leaves another one
      real(wp), private :: first_sense = 1.0_wp                       ! of the value on the first way
      real(wp), private :: length = 0.0_wp                            ! of this way so far
      type(extreme_told_t), allocatable, private :: extremes_told(:)  ! on this way
      type(rung_t), private :: first_rung                             ! its set and grid
      real(wp), allocatable, private :: x_start(:), direction_start(:)
      type(origin_t), private :: outset                               ! these two on the set of the start of this way
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
      type(stability_t), private :: stability                         ! at its point, without multipliers where none are looked for
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
      procedure, private :: go => motion_curve_go
      procedure, private :: has_left_branch => motion_curve_has_left_branch
      procedure, private :: step => motion_curve_step
      procedure, private :: land => motion_curve_land
      procedure, private :: look_back => motion_curve_look_back
      procedure, private :: drop_doubtful => motion_curve_drop_doubtful
      procedure, private :: step_to_tolerance => motion_curve_step_to_tolerance
      procedure, private :: put_on => motion_curve_put_on
      procedure, private :: find_on_plane => motion_curve_find_on_plane
      procedure, private :: make_curve => motion_curve_make_curve
      procedure, private :: keep_symmetry => motion_curve_keep_symmetry
      procedure, private :: look_here => motion_curve_look_here
      procedure, private :: carry_start => motion_curve_carry_start
      procedure, private :: describe => motion_curve_describe
      procedure, private :: tell => motion_curve_tell
      procedure, private :: set_out => motion_curve_set_out
      procedure, private :: put_start => motion_curve_put_start
      procedure, private :: note_origin => motion_curve_note_origin
      procedure, private :: note_apart => motion_curve_note_apart
      procedure, private :: note_met => motion_curve_note_met
      procedure, private :: look_apart => motion_curve_look_apart
      procedure, private :: settle => motion_curve_settle
      procedure, private :: move => motion_curve_move
      procedure, private :: sense => motion_curve_sense
      procedure, private :: state => motion_curve_state
      procedure, private :: slopes_along => motion_curve_slopes_along
      procedure, private, nopass :: n_further
   end type motion_curve_t

   ! Where a curve begins; bodies in hb_motion_curve_start
   interface
      !> Solves the first motion, by all the ways that a point has; the curve is done with it where that does not lead to one.
      module subroutine motion_curve_begin(self, scene, document, request, result, error, watch, judge)
         class(motion_curve_t), intent(inout), target :: self
         type(scene_t), intent(inout) :: scene                        !! at the start
         type(document_t), intent(in) :: document                     !! from which it was read
         type(curve_request_t), intent(in) :: request
         type(motion_result_t), intent(out) :: result
         type(error_t), allocatable, intent(out) :: error
         class(watch_t), intent(inout), target :: watch
         class(judge_t), intent(in), optional :: judge
      end subroutine motion_curve_begin

      !> Takes the place of `begin`: next to a motion and tangent of another curve, in the plane across this a bit before it, so
      !> that what is there lies ahead. `is_found` is false where there is no motion.
      module subroutine motion_curve_begin_next_to(self, scene, document, request, place, is_found, error, watch)
         class(motion_curve_t), intent(inout), target :: self
         type(scene_t), intent(in) :: scene
         type(document_t), intent(in) :: document                     !! from which it was read
         type(curve_request_t), intent(in) :: request
         type(curve_place_t), intent(in) :: place                     !! a fold or peak of the other curve, and the way there
         logical, intent(out) :: is_found
         type(error_t), allocatable, intent(out) :: error
         class(watch_t), intent(inout), target :: watch
      end subroutine motion_curve_begin_next_to

      !> Takes the place of `begin`: the curve stands where a stored one has been at its last point, a step or the start of a way.
      module subroutine motion_curve_go_on_from(self, scene, document, request, stored, error, watch)
         class(motion_curve_t), intent(inout), target :: self
         type(scene_t), intent(in) :: scene                           !! at the start
         type(document_t), intent(in) :: document                     !! from which it was read
         type(curve_request_t), intent(in) :: request
         type(curve_place_t), intent(in) :: stored(:)                 !! all points up to the one to go on from
         type(error_t), allocatable, intent(out) :: error
         class(watch_t), intent(inout), target :: watch
      end subroutine motion_curve_go_on_from

      !> The problem of the curve on a set and a grid, at its start.
      module subroutine motion_curve_put_on(self, rung, error)
         class(motion_curve_t), intent(inout), target :: self
         type(rung_t), intent(in) :: rung
         type(error_t), allocatable, intent(out) :: error
      end subroutine motion_curve_put_on

      !> The curve at the start of this way.
      module subroutine motion_curve_set_out(self, error)
         class(motion_curve_t), intent(inout), target :: self
         type(error_t), allocatable, intent(out) :: error
      end subroutine motion_curve_set_out

      !> Corrects a motion in the plane across a direction.
      module subroutine motion_curve_find_on_plane(self, x, direction, is_found)
         class(motion_curve_t), intent(inout), target :: self
         real(wp), intent(inout) :: x(:)
         real(wp), intent(in) :: direction(:)
         logical, intent(out) :: is_found
      end subroutine motion_curve_find_on_plane

      !> The curve at one of its points, on the set at hand; `direction` says roughly where to go.
      module subroutine motion_curve_make_curve(self, x, direction)
         class(motion_curve_t), intent(inout), target :: self
         real(wp), intent(in) :: x(:), direction(:)
      end subroutine motion_curve_make_curve

      !> Corrections stay among odd motions where curve and direction are odd; what leaves these is still seen, by the tangent.
      module subroutine motion_curve_keep_symmetry(self)
         class(motion_curve_t), intent(inout), target :: self
      end subroutine motion_curve_keep_symmetry

      !> The list of points that wait is the start of this way alone.
      module subroutine motion_curve_put_start(self)
         class(motion_curve_t), intent(inout) :: self
      end subroutine motion_curve_put_start
   end interface

   ! Sets and grids along it; bodies in hb_motion_curve_sets
   interface
      !> Goes one step on a set and a grid on which all points found on it are as accurate as is asked for, if there is one.
      module subroutine motion_curve_step_to_tolerance(self, error)
         class(motion_curve_t), intent(inout), target :: self
         type(error_t), allocatable, intent(out) :: error
      end subroutine motion_curve_step_to_tolerance

      !> Takes a motion over to a set and a grid on which it is as accurate as is asked for, if there is one, in the plane across a
      !> direction. The problem stands on these afterwards.
      module subroutine motion_curve_settle(self, x, direction, error)
         class(motion_curve_t), intent(inout), target :: self
         real(wp), allocatable, intent(inout) :: x(:), direction(:)   !! on the set at hand, before and afterwards
         type(error_t), allocatable, intent(out) :: error
      end subroutine motion_curve_settle

      !> Takes start and direction of this way over to the set at hand.
      module subroutine motion_curve_carry_start(self)
         class(motion_curve_t), intent(inout) :: self
      end subroutine motion_curve_carry_start
   end interface

   ! Its steps; bodies in hb_motion_curve_step
   interface
      !> Goes one step, and puts what was found on it and its end into the list of those that wait.
      module subroutine motion_curve_step(self)
         class(motion_curve_t), intent(inout), target :: self
      end subroutine motion_curve_step

      !> Solves for the motion at the value of x, next to where it is.
      module subroutine motion_curve_land(self, x, is_there)
         class(motion_curve_t), intent(inout), target :: self
         real(wp), intent(inout) :: x(:)
         logical, intent(out) :: is_there                             !! else x stays what it was
      end subroutine motion_curve_land
   end interface

   ! What is found on a step; body in hb_motion_curve_found
   interface
      !> Finds folds, peaks, bifurcations, wanted values and ends on the step behind the curve, and lists them in their order.
      module subroutine motion_curve_look_back(self, slopes, stability, extremes, has_branched, is_lost)
         class(motion_curve_t), intent(inout), target :: self
         real(wp), intent(in) :: slopes(:)                            !! of the responses, at the end of the step
         type(stability_t), intent(in) :: stability                   !! likewise
         real(wp), intent(in) :: extremes(:, :)                       !! of switches, likewise
         logical, intent(in) :: has_branched                          !! a branch point was passed by
         logical, intent(out) :: is_lost                              !! something was not located, as the step is too long
      end subroutine motion_curve_look_back
   end interface

   ! What of it is smaller than errors; body in hb_motion_curve_doubtful
   interface
      !> Drops the folds and peaks of the step that are smaller than the estimated error of the motion there.
      module subroutine motion_curve_drop_doubtful(self, error)
         class(motion_curve_t), intent(inout), target :: self
         type(error_t), allocatable, intent(out) :: error
      end subroutine motion_curve_drop_doubtful
   end interface

   ! Motions apart from all curves; body in hb_motion_curve_apart
   interface
      !> Looks for a motion apart from all that were met at the values at which others are asked for; notes the first one.
      module subroutine motion_curve_look_apart(self, error)
         class(motion_curve_t), intent(inout), target :: self
         type(error_t), allocatable, intent(out) :: error
      end subroutine motion_curve_look_apart
   end interface

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
         call self%go(error)
         if (allocated(error) .or. self%curve%status /= outcome%pending) return
         i = findloc(self%waiting%kind, kind, dim=1)
         is_found = i > 0
         if (is_found) exit
         self%first_waiting = size(self%waiting) + 1
      end do
      if (.not. is_found) return
      call self%tell(self%waiting(i), result, error)
      call count_work(self%curve%report, report_t(), result)
   end subroutine motion_curve_look_for

   !> The first response of the request at the state of the point told last.
   real(wp) function motion_curve_measure(self, state) result(measure)
      class(motion_curve_t), intent(inout), target :: self
      real(wp), intent(in) :: state(:)

      measure = 0.0_wp
      if (size(self%request%peaks) > 0) &
         measure = sqrt(square_at(self%problem, self%which, self%request%peaks(1), &
                                  state(:self%problem%n_unknowns + size(self%which))))
   end function motion_curve_measure

   !> 1 on the first of two ways from one point, -1 on the other.
   pure real(wp) function motion_curve_sense(self) result(sense)
      class(motion_curve_t), intent(in) :: self

      sense = merge(1.0_wp, -1.0_wp, modulo(self%way, 2) == 1)
   end function motion_curve_sense

   !> Moves the problem to the parameters of a point.
   subroutine motion_curve_move(self, x, is_possible)
      class(motion_curve_t), intent(inout), target :: self
      real(wp), intent(in) :: x(:)
      logical, intent(out) :: is_possible

      call self%problem%set_parameters(self%which, x(self%problem%n_unknowns + 1:), is_possible)
   end subroutine motion_curve_move

   !> All that the curve needs to go on from its point, as one row of numbers.
   function motion_curve_state(self) result(state)
      class(motion_curve_t), intent(in) :: self
      real(wp), allocatable :: state(:)

      associate (curve => self%curve)
         state = [curve%x, curve%direction, curve%step, curve%orientation, self%largest]
      end associate
   end function motion_curve_state

   !> Brings the units of length and the tolerance to the point reached.
   subroutine motion_curve_renew(self)
      class(motion_curve_t), intent(inout), target :: self
      logical :: is_possible

      call self%move(self%curve%x, is_possible)
      associate (n => self%problem%n_unknowns, curve => self%curve)
         self%largest = max(self%largest, norm2(curve%x(:n)/self%weights))
         curve%units = [self%weights*self%largest, self%problem%parameter_scales(self%which)]
         curve%corrector%tolerance = max(self%problem%scene%solver%tolerance, 2.0_wp*self%problem%rounding_level(curve%x(:n)), &
                                         10.0_wp*self%slack*self%unevenness)
      end associate
   end subroutine motion_curve_renew

   !> The next point. Its status tells where there is no way on; `interrupted`: nothing was found out, and the curve goes on here in
   !> another run.
   subroutine motion_curve_next(self, result, error)
      class(motion_curve_t), intent(inout), target :: self
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error

      associate (limit => self%problem%scene%solver%time_limit)
         call self%watch%enter(limit)
         call self%watch%begin(limit)
      end associate
      call find_next(self, result, error)
      call self%watch%leave()
   end subroutine motion_curve_next

   !> The next point, under a watch that was entered.
   subroutine find_next(self, result, error)
      class(motion_curve_t), intent(inout), target :: self
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      type(report_t) :: before
      real(wp) :: started
      logical :: is_end

      started = wall_clock()
      before = self%curve%report
      if (self%first_waiting > size(self%waiting)) then
         call self%go(error)
         if (allocated(error)) return
      end if
      if (self%watch%verdict == verdict%interrupted) then             ! what was found on the step may not be all
         result%status = outcome%interrupted
         return
      else if (self%curve%status /= outcome%pending) then
         result%status = self%curve%status
         if (self%has_collapsed) result%status = outcome%collapsed
         result%message = lost_text(self)
         call count_work(self%curve%report, before, result)
         call leave(self, error)
      else
         associate (point => self%waiting(self%first_waiting))
            call self%tell(point, result, error)
            if (self%watch%verdict == verdict%interrupted) then       ! what is known of the point is not all
               result%status = outcome%interrupted
               return
            end if
            self%first_waiting = self%first_waiting + 1
            call count_work(self%curve%report, before, result)
            is_end = point%kind == curve_kind%end
         end associate
         if (is_end .and. .not. allocated(error)) call leave(self, error)
      end if
      result%solver_seconds = wall_clock() - started - result%certificate_seconds
      self%n_told = self%n_told + 1
      self%is_done = self%is_done .or. self%n_told >= self%request%n_points
   end subroutine find_next

   !> Goes one step, by tolerance where one is asked for.
   subroutine motion_curve_go(self, error)
      class(motion_curve_t), intent(inout), target :: self
      type(error_t), allocatable, intent(out) :: error

      if (self%scene%accuracy%is_on) then
         call self%step_to_tolerance(error)
      else
         call self%step()
      end if
      if (allocated(error) .or. self%curve%status /= outcome%pending .or. self%watch%verdict /= verdict%go_on) return
      call self%drop_doubtful(error)
   end subroutine motion_curve_go

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
      if (.not. allocated(self%problem%complaint)) return
      associate (value => self%curve%x(size(self%curve%x)), unit => self%curve%units(size(self%curve%x)))
         if (abs(self%problem%refused - value) <= nearby*unit) text = text//": "//self%problem%complaint   ! else it is no reason
      end associate
   end function lost_text

   !> This way has come to its end: the next one follows where there is one, along another curve behind a row for its start.
   subroutine leave(self, error)
      class(motion_curve_t), intent(inout), target :: self
      type(error_t), allocatable, intent(out) :: error

      if (self%is_closed .and. modulo(self%way, 2) == 1) self%way = self%way + 1   ! the other way would be the same
      self%is_closed = .false.
      self%way = self%way + 1
      if (self%way == 2 .and. .not. is_inside(self%request, self%request%start)) self%way = 3
      if (self%way == 2 .and. allocated(self%request%origin)) self%way = 3   ! the other way has the same motions, shifted
      if (self%way > 2*(1 + size(self%origins)) .and. self%n_told + 1 < self%request%n_points) then
         call self%look_apart(error)
         if (allocated(error)) return
      end if
      self%is_done = self%way > 2*(1 + size(self%origins))
      if (self%way > 2*(1 + size(self%origins))) return
      call self%set_out(error)
      if (self%way <= 2 .or. allocated(error)) return
      call self%put_start()
   end subroutine leave

   !> Adds a branch point to those from which other curves are followed.
   subroutine motion_curve_note_origin(self, state, rung)
      class(motion_curve_t), intent(inout) :: self
      real(wp), intent(in) :: state(:)                                !! its unknowns, and the direction of the curve
      type(rung_t), intent(in) :: rung                                !! their set and grid
      type(origin_t), allocatable :: longer(:)

      allocate (longer(size(self%origins) + 1))
      longer(:size(self%origins)) = self%origins
      longer(size(longer))%x = state(:size(state)/2)
      longer(size(longer))%direction = state(size(state)/2 + 1:)
      longer(size(longer))%rung = rung
      call move_alloc(longer, self%origins)
   end subroutine motion_curve_note_origin

   !> Adds a motion apart from all curves so far to those from which curves are followed.
   subroutine motion_curve_note_apart(self, x, rung)
      class(motion_curve_t), intent(inout) :: self
      real(wp), intent(in) :: x(:)
      type(rung_t), intent(in) :: rung                                !! its set and grid

      call self%note_origin([x, 0.0_wp*x], rung)
      self%origins(size(self%origins))%is_apart = .true.
   end subroutine motion_curve_note_apart

   !> Keeps a motion that was met at a value at which others are sought.
   subroutine motion_curve_note_met(self, x, rung)
      class(motion_curve_t), intent(inout) :: self
      real(wp), intent(in) :: x(:)
      type(rung_t), intent(in) :: rung                                !! its set and grid

      if (.not. allocated(self%request%others)) return
      if (all(abs(self%request%others - x(size(x))) > 0.0_wp)) return
      self%met = [self%met, origin_t(x=x, rung=rung)]
   end subroutine motion_curve_note_met

   !> Whether a value is in the range, and at none of its ends.
   pure logical function is_inside(request, value)
      type(curve_request_t), intent(in) :: request
      real(wp), intent(in) :: value

      is_inside = (value - request%from)*(value - request%to) < 0.0_wp
   end function is_inside

   !> What is known of a motion of the curve.
   subroutine motion_curve_describe(self, point, result, error)
      class(motion_curve_t), intent(inout), target :: self
      type(waiting_t), intent(in) :: point
      type(motion_result_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: r(self%problem%n_unknowns)
      integer :: n
      logical :: is_possible

      n = self%problem%n_unknowns
      call self%move(point%x, is_possible)
      associate (balance => self%problem%balance, scene => self%problem%scene)
         call self%problem%residual(point%x(:n), r)
         result%residual = self%problem%norm(r)
         result%status = outcome%converged
         if (allocated(point%stability)) result%stability = point%stability
         result%frequency = balance%omega
         if (scene%normal_mode%is_asked) result%artificial_damping = balance%xi
         result%n_harmonics = scene%harmonics%n_harmonics
         result%n_unknowns = n
         if (scene%certificate%is_on) call put_across(self, point)
         call describe_motion(scene, whole_basis(scene%harmonics, scene%torus), balance, &
                              reshape(point%x(:n), [scene%harmonics%n_coefficients, balance%n_dofs]), result, error, &
                              curve=self%curve%problem)
      end associate
      if (allocated(self%curve%problem%units_across)) deallocate (self%curve%problem%units_across)
      if (allocated(error) .or. .not. self%scene%accuracy%is_on) return
      call with_caution(self%scene, result)
      if (any(result%status == [outcome%converged, outcome%truncated, outcome%aliased])) &
         result%status = merge(outcome%converged, outcome%truncated, estimate_of(result) <= self%scene%accuracy%tolerance)
      result%harmonics = self%rung%set
      result%n_samples = self%rung%n_samples
      result%n_rungs = self%n_rungs
   end subroutine motion_curve_describe

   !> Makes the last equation the plane across the tangent at a point, in units of the motion there: how the curve came to it does
   !> not matter. At a branch point, where any vector between the two curves is a tangent, steps are across both.
   subroutine put_across(self, point)
      class(motion_curve_t), intent(inout), target :: self
      type(waiting_t), intent(in) :: point
      type(report_t) :: report
      real(wp) :: determinant_sign, tangent(size(point%x)), units(size(point%x))
      integer :: last
      logical :: is_crossed, is_singular

      report = self%curve%report                                      ! no work of the curve
      call self%curve%tangent_at(point%x, tangent, determinant_sign, is_singular)
      self%curve%report = report
      is_crossed = point%kind == curve_kind%branch
      if (point%kind == curve_kind%start) is_crossed = self%has_left_branch()
      if (is_singular) tangent = self%curve%direction
      associate (u => point%x(:self%problem%n_unknowns), problem => self%curve%problem)
         units = [spread(max(norm2(u), tiny(1.0_wp)), 1, size(u)), self%problem%parameter_scales(self%which)]
         last = size(problem%values)
         problem%forms(:, last) = tangent/units**2/norm2(tangent/units)
         problem%values(last) = dot_product(problem%forms(:, last), point%x)
         call problem%rescale()
         if (is_crossed) problem%units_across = units
      end associate
   end subroutine put_across

   !> Whether this way begins at a branch point.
   pure logical function motion_curve_has_left_branch(self) result(has)
      class(motion_curve_t), intent(in) :: self

      has = self%way > 2
      if (has) has = .not. self%origins((self%way - 1)/2)%is_apart
   end function motion_curve_has_left_branch

   !> Makes the result of a point.
   subroutine motion_curve_tell(self, point, result, error)
      class(motion_curve_t), intent(inout), target :: self
      type(waiting_t), intent(in) :: point
      type(motion_result_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: length

      if (allocated(point%result)) then
         result = point%result
      else
         call self%describe(point, result, error)
      end if
      if (allocated(error)) return
      call self%note_met(point%x, self%rung)
      length = self%length + point%place
      result%curve = curve_place_t(point%kind, point%x(size(point%x)), self%sense()*length, (self%way - 1)/2, point%x)
      if (self%scene%accuracy%is_on) then
         result%curve%tuples = self%rung%set%tuples
         result%curve%n_samples = self%rung%n_samples
      end if
      if (point%kind == curve_kind%regular .or. point%kind == curve_kind%start) then
         self%length = length
         result%curve%state = self%state()
      else if (point%kind == curve_kind%branch) then
         result%curve%state = [point%x, self%curve%direction]
         if (self%request%switches .and. self%way <= 2) call self%note_origin(result%curve%state, self%rung)
      else if (any(point%kind == [curve_kind%fold, curve_kind%peak])) then
         result%curve%state = [point%x, self%curve%direction]
         if (size(self%request%peaks) > 1) result%curve%state = [result%curve%state, real(point%response, wp)]
         self%extremes_told = [self%extremes_told, extreme_told_t(point%response, length)]
      else if (any(point%kind == [curve_kind%flip, curve_kind%torus]) .and. allocated(result%stability%multipliers)) then
         result%curve%state = [point%x, self%curve%direction, angle_of_pair(result%stability%multipliers)]
      end if
   end subroutine motion_curve_tell

   !> What the next step compares with: slopes of responses, stability and extremes at the point of the curve.
   subroutine motion_curve_look_here(self)
      class(motion_curve_t), intent(inout), target :: self

      self%slopes = self%slopes_along()
      call find_stability(self%problem, self%which, self%curve%x, self%problem%scene%stability%tolerance, self%stability)
      call find_extremes(self%problem, self%which, self%curve%x, self%extremes)
   end subroutine motion_curve_look_here

   !> Slopes of the squares of all responses along the curve, at its point.
   function motion_curve_slopes_along(self) result(slopes)
      class(motion_curve_t), intent(inout), target :: self
      real(wp) :: slopes(size(self%request%peaks))
      integer :: i

      do i = 1, size(slopes)
         slopes(i) = slope_at(self%problem, self%which, self%request%peaks(i), self%curve%x, self%curve%direction)
      end do
   end function motion_curve_slopes_along

   !> Frees the balance; safe to call twice.
   subroutine motion_curve_destroy(self)
      class(motion_curve_t), intent(inout) :: self

      call self%problem%destroy()
      if (allocated(self%odd_problem)) call self%odd_problem%destroy()
   end subroutine motion_curve_destroy
end module hb_motion_curve
