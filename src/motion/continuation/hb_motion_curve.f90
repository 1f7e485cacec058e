!> A curve of motions as a function of one value of the input, parametrised by its arc length: it passes folds and
!> reaches given values exactly; its folds, the maxima of responses and, if multipliers are known, its bifurcations
!> are located.
!> The length of a step is limited by the turn of the tangent and by the iterations of the corrector. A curve that
!> starts inside the range is followed in both directions; then follow the curves that cross it, and those from
!> separate motions. Each point has all results of a motion. Source: docs/user/curves.md; docs/why/theory.md, section
!> 6.7.
module hb_motion_curve
   use hb_bifurcation, only: angle_of_pair, movement
   use hb_cancellation, only: cancellation_t, verdict, verdict_on_work, work_is_over
   use hb_clock, only: wall_clock
   use hb_curve_end, only: count_doubtful_steps, describe_end, end_at_fold, end_if_doubtful, returns_to_fold
   use hb_curve_gradient, only: find_curve_gradient
   use hb_curve_origin, only: find_first
   use hb_curve_points, only: add_origin, add_waiting, origin_t, path_of, reported_extreme_t, store_path, waiting_t
   use hb_curve_request, only: curve_request_t
   use hb_curve_return, only: note_course, restore_course
   use hb_curve_sets, only: step_to_tolerance, transfer_motion
   use hb_curve_step, only: step
   use hb_discretisation, only: discretisation_t
   use hb_doubtful_extremes, only: remove_doubtful_extremes
   use hb_error, only: error_t
   use hb_isolated_branches, only: search_separate
   use hb_kinds, only: wp
   use hb_level, only: estimate_of, join, level_of, level_t, margin
   use hb_level_stability, only: allow_for_departure
   use hb_model, only: model_t
   use hb_motion_result, only: curve_position_t, motion_result_t
   use hb_observed_motion, only: observed_motion_t
   use hb_options, only: options_t
   use hb_outcome, only: is_integrated, is_solved, outcome, reason
   use hb_point, only: solve_point
   use hb_point_kinds, only: curve_kind, curve_kinds, located_by, point_kind_t
   use hb_solver_types, only: report_t
   use hb_stability, only: stability_t
   use hb_system, only: system_t
   use hb_tangent_solver, only: find_null_vector
   use hb_threads, only: use_threads
   use hb_thresholds, only: faint, nearby_steps, reliable
   implicit none
   private
   public :: motion_curve_continue_from, motion_curve_start_branch, motion_curve_t

   real(wp), parameter :: run_up = 0.05_wp                            ! of the longest step, to the next expected point

   !> Owns external resources: call `destroy`. A variable of this type needs the attribute `target`.
   type, extends(observed_motion_t) :: motion_curve_t
      logical :: is_done = .false.                                    !! there is no further point
      type(origin_t) :: first                                         ! the start itself; a direction if it leaves another curve
      real(wp), private :: first_sense = 1.0_wp                       ! of the value on the first branch
      type(origin_t), allocatable, private :: met(:)                  ! motions at values at which others are searched for
      integer :: n_reported = 0                                       !! points so far
      type(waiting_t), allocatable :: points(:)                       !! of the last step
      integer :: n_returned = 0                                       !! of them
   contains
      procedure :: begin => motion_curve_begin
      procedure :: begin_next_to => motion_curve_begin_next_to
      procedure :: continue_from => motion_curve_continue_from
      procedure :: next => motion_curve_next
      procedure :: search_for => motion_curve_search_for
      procedure :: lengthen => motion_curve_lengthen
      procedure :: measure => motion_curve_measure
      procedure :: system_at => motion_curve_system_at
      procedure :: start_branch => motion_curve_start_branch
      procedure :: make_step
      procedure :: pack => motion_curve_pack
      procedure :: prepare => motion_curve_prepare
      procedure :: report_start => motion_curve_report_start
   end type motion_curve_t

contains

   ! Start of a curve

   !> Solves the first motion by all methods of a point; the curve has ended if none is found.
   subroutine motion_curve_begin(self, model, request, result, error)
      class(motion_curve_t), intent(inout), target :: self
      type(model_t), intent(inout) :: model                           !! at the start
      type(curve_request_t), intent(in) :: request
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: further(:)
      type(level_t) :: lowest, level
      logical :: is_new

      self%request = request
      if (allocated(request%origin)) then
         call begin_at_origin(self, model%system, model%discretisation, model%options, result, error)
         return
      end if
      if (model%options%accuracy%is_on) model%options%chain%is_on = .false. ! the point has no neighbour and is none
      call solve_point(model, result, error, level)
      if (allocated(level%unknowns) .and. model%options%accuracy%is_on .and. model%options%accuracy%grows_set) then
         lowest = level
         call join(lowest, model%discretisation%harmonics, is_new)    ! without even tuples no loss of symmetry is detected
         if (is_new) call solve_point(model, result, error, level, lowest)
      end if
      self%is_done = allocated(error) .or. .not. allocated(level%unknowns)
      if (is_integrated(result%status)) then
         result%status = outcome%stalled                              ! a motion, but not a point of a curve
         result%message = "a curve must start from a harmonic balance solution; "//result%message
      end if
      if (any(model%system%tones%is_unknown) .and. model%options%accuracy%is_on .and. .not. self%is_done) then
         self%is_done = estimate_of(result) >= reliable
         if (self%is_done) &
            result%message = "no harmonic set within the limits represents this motion: it may have other tones, or none"
      end if
      if (.not. self%is_done .and. may_be_locked(model%system%tones%is_unknown, result)) then
         self%is_done = .true.
         result%message = "a combination of the tones is slower than the error of the unknown ones: they may lock, and the "// &
                          "motion may have fewer tones"
      end if
      if (self%is_done) return
      further = [pack(result%frequency, model%system%tones%is_unknown)]
      if (model%system%normal_mode%is_requested) further = [further, pack(result%artificial_damping, model%system%tones%is_unknown)]
      further = [further, request%start]
      call self%prepare(model%system, model%discretisation, model%options, further, level, error)
      self%is_done = allocated(error)
      if (self%is_done) return
      self%first%x = [level%unknowns(:self%problem%n_unknowns), further]
      call self%start_branch(error)
      if (.not. allocated(error)) call add_position(self, waiting_t(curve_kind%start, x=self%first%x), result)
      self%n_reported = 1
      self%is_done = allocated(error) .or. self%n_reported >= request%n_points
   end subroutine motion_curve_begin

   !> Whether the tones are next to a strong resonance, closer than the errors of the unknown ones: a series of few beats of a
   !> motion with fewer tones looks the same.
   pure logical function may_be_locked(is_unknown, result)
      logical, intent(in) :: is_unknown(:)                            !! (n_tones)
      type(motion_result_t), intent(in) :: result
      integer, parameter :: largest_sum = 5                           ! of a strong resonance, 1:4 at most

      may_be_locked = .false.
      associate (found => result%error_estimate)
         if (.not. (result%is_near_commensurate .and. allocated(found%frequency_error))) return
         may_be_locked = sum(abs(found%combination)) <= largest_sum .and. &
            sum(abs(pack(found%combination*found%frequency_error, is_unknown))) > found%combination_frequency
      end associate
   end function may_be_locked

   !> Begins where the curve leaves another one, a short distance along it: at the intersection itself the tangent is
   !> singular.
   subroutine begin_at_origin(self, system, discretisation, options, result, error)
      class(motion_curve_t), intent(inout), target :: self
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(motion_result_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error
      logical :: is_found

      call self%prepare(system, discretisation, options, self%request%origin%further, self%request%origin%level, error)
      self%is_done = allocated(error)
      if (self%is_done) return
      call find_first(self, self%first, is_found)
      if (.not. is_found) then
         result%status = outcome%stalled
         result%message = "no bifurcating motion was found near the bifurcation point"
         self%is_done = .true.
         return
      end if
      if (options%accuracy%is_on) call transfer_motion(self, self%first%x, self%first%direction, error)
      self%is_done = allocated(error)
      if (self%is_done) return
      self%first%level = self%level
      call self%report_start(result, error)
   end subroutine begin_at_origin

   !> Starts the first branch, with the results of its start.
   subroutine motion_curve_report_start(self, result, error)
      class(motion_curve_t), intent(inout), target :: self
      type(motion_result_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error

      call self%start_branch(error)
      if (allocated(error)) return
      call set_start(self)
      call report(self, self%points(1), result, error)
      self%n_returned = 1
      self%n_reported = 1
      self%is_done = allocated(error) .or. self%n_reported >= self%request%n_points
   end subroutine motion_curve_report_start

   !> Replaces `begin`: starts from a motion and tangent of another curve, in the plane across the tangent and
   !> slightly before the motion, so that the events there are ahead. `is_found` is false if there is no motion.
   subroutine motion_curve_begin_next_to(self, system, discretisation, options, request, position, is_found, error)
      class(motion_curve_t), intent(inout), target :: self
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(curve_request_t), intent(in) :: request
      type(curve_position_t), intent(in) :: position                  !! a fold or peak of the other curve, with its tangent
      logical, intent(out) :: is_found
      type(error_t), allocatable, intent(out) :: error

      self%request = request
      self%branch = 0
      self%is_reversed = .false.
      is_found = .false.
      call self%prepare(system, discretisation, options, further_of(position, system), level_of(discretisation, position), error)
      if (allocated(error)) return
      associate (direction => position%direction)
         self%first%x = position%unknowns - run_up*request%longest_step*direction/norm2(direction/self%units_at(position%unknowns))
         self%first%direction = direction
      end associate
      call self%correct_on_plane(self%first%x, self%first%direction, is_found)
      if (is_found) call self%start_branch(error)
   end subroutine motion_curve_begin_next_to

   !> Replaces `begin`: restores the state of a stored curve at its last point, a step or the start of a branch.
   subroutine motion_curve_continue_from(self, model, request, stored, error)
      class(motion_curve_t), intent(inout), target :: self
      type(model_t), intent(in) :: model                              !! at the start
      type(curve_request_t), intent(in) :: request
      type(curve_position_t), intent(in) :: stored(:)                 !! all points up to the one to continue from
      type(error_t), allocatable, intent(out) :: error
      type(motion_result_t) :: result
      type(waiting_t) :: here

      self%request = request
      call self%prepare(model%system, model%discretisation, model%options, further_of(stored(1), model%system), &
                        level_of(model%discretisation, stored(1)), error)
      self%is_done = allocated(error)
      if (self%is_done) return
      self%first%x = stored(1)%unknowns
      if (allocated(request%origin)) self%first%direction = stored(1)%direction
      call restore_origins(self, model%discretisation, stored)
      associate (last => stored(size(stored)))
         self%branch = last%branch
         self%is_reversed = last%length < 0.0_wp .or. &
                            (last%branch > 0 .and. count(stored%kind == curve_kind%start .and. stored%branch == last%branch) > 1)
         call self%start_branch(error)
         if (allocated(error)) return
         self%n_reported = size(stored)
         if (model%options%accuracy%is_on) then
            call self%adopt_level(level_of(model%discretisation, last), error)
            if (allocated(error)) return
            call self%transfer_start()
         end if
         call self%restore(path_of(last))
         call restore_passed(self, model%discretisation, stored)
         self%course%n_unreliable = last%n_unreliable
         self%course%n_exhausted = last%n_exhausted
         call self%evaluate_here(self%at_point)
         call restore_speed(self, stored)
         if (model%options%accuracy%is_on .and. last%kind == curve_kind%regular) then
            here = waiting_t(last%kind, x=self%curve%x)
            call self%describe(here, self%plane_at(here), result, error)
            self%estimate = estimate_of(result)
         end if
      end associate
      self%is_done = self%n_reported >= request%n_points
   end subroutine motion_curve_continue_from

   !> Restores the speed of the multipliers on the last step, unless the set has changed.
   subroutine restore_speed(self, stored)
      class(motion_curve_t), intent(inout), target :: self
      type(curve_position_t), intent(in) :: stored(:)
      type(stability_t) :: there
      integer :: i
      logical :: is_same

      associate (last => stored(size(stored)))
         do i = size(stored) - 1, 1, -1
            if (stored(i)%step > 0.0_wp .and. stored(i)%branch == last%branch .and. stored(i)%length*last%length >= 0.0_wp) exit
         end do
         if (i == 0 .or. .not. allocated(self%at_point%stability%multipliers)) return
         is_same = size(stored(i)%unknowns) == size(last%unknowns) .and. (allocated(stored(i)%tuples) .eqv. allocated(last%tuples))
         if (is_same .and. allocated(last%tuples)) is_same = all(stored(i)%tuples == last%tuples)
         if (is_same .and. allocated(last%n_samples)) is_same = all(stored(i)%n_samples == last%n_samples)
         if (.not. is_same) return
         call self%find_stability(stored(i)%unknowns, self%model%options%stability%tolerance, there)
         if (.not. allocated(there%multipliers)) return
         self%at_point%speed = movement(there%multipliers, self%at_point%stability%multipliers)/ &
                               abs(last%length - stored(i)%length)
      end associate
   end subroutine restore_speed

   !> Restores where branches begin, and the motions that were met.
   subroutine restore_origins(self, discretisation, stored)
      class(motion_curve_t), intent(inout), target :: self
      type(discretisation_t), intent(in) :: discretisation
      type(curve_position_t), intent(in) :: stored(:)
      type(level_t) :: level
      integer :: i

      do i = 1, size(stored)
         level = level_of(discretisation, stored(i))
         if (stored(i)%kind == curve_kind%branch .and. stored(i)%branch == 0 .and. self%request%switches) &
            call add_origin(self%origins, .false., stored(i)%unknowns, stored(i)%direction, level)
         if (stored(i)%kind == curve_kind%start .and. stored(i)%branch > size(self%origins)) &
            call add_origin(self%origins, .true., stored(i)%unknowns, 0.0_wp*stored(i)%unknowns, level)
         call store_met_motion(self, stored(i)%unknowns, level)
      end do
   end subroutine restore_origins

   !> Restores what the present branch has passed: the ends of others, folds, peaks and minima, and its course since its start.
   subroutine restore_passed(self, discretisation, stored)
      class(motion_curve_t), intent(inout), target :: self
      type(discretisation_t), intent(in) :: discretisation
      type(curve_position_t), intent(in) :: stored(:)
      integer :: i

      do i = 1, size(stored)
         if (stored(i)%kind == curve_kind%end .and. stored(i)%branch > 0) call note_traced(self, stored(i))
      end do
      do i = size(stored), 2, -1
         if (stored(i)%kind == curve_kind%start .or. stored(i)%length*stored(size(stored))%length < 0.0_wp) exit
         if (curve_kinds(stored(i)%kind)%is_extreme) &
            self%reported = [self%reported, reported_extreme_t(stored(i)%response, abs(stored(i)%length))]
      end do
      call restore_course(self, stored(max(1, i):), discretisation)
   end subroutine restore_passed

   !> The unknowns of a point other than those of the balance.
   pure function further_of(position, system) result(further)
      type(curve_position_t), intent(in) :: position
      type(system_t), intent(in) :: system
      real(wp) :: further(system%n_further())

      further = position%unknowns(size(position%unknowns) - size(further) + 1:)
   end function further_of

   !> Prepares the curve for its start on a set and a grid.
   subroutine motion_curve_prepare(self, system, discretisation, options, further, level, error)
      class(motion_curve_t), intent(inout), target :: self
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      real(wp), intent(in) :: further(:)                              !! unknowns in addition to those of the balance, at the start
      type(level_t), intent(in) :: level                              !! of its first motion
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      self%model%system = system
      self%model%discretisation = discretisation
      self%model%options = options
      self%further = further
      self%first%level = level_t(level%set, level%n_samples)
      if (.not. allocated(self%request%values)) allocate (self%request%values(0))
      if (allocated(self%request%others)) then
         do i = 1, size(self%request%others)
            if (all(abs(self%request%values - self%request%others(i)) > 0.0_wp)) &
               self%request%values = [self%request%values, self%request%others(i)]
         end do
      end if
      if (.not. allocated(self%request%responses)) allocate (self%request%responses(0))
      self%points = [waiting_t ::]
      self%n_returned = 0
      self%origins = [origin_t ::]
      self%met = [origin_t ::]
      self%first_sense = sign(1.0_wp, self%request%to - self%request%start)
      if (.not. abs(self%request%to - self%request%start) > 0.0_wp) &
         self%first_sense = sign(1.0_wp, self%request%from - self%request%to)
      call self%adopt_level(self%first%level, error)
   end subroutine motion_curve_prepare

   ! Branches of the curve

   !> Places the curve at the start of this branch.
   subroutine motion_curve_start_branch(self, error)
      class(motion_curve_t), intent(inout), target :: self
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: direction(:)

      self%branch_start = self%first
      if (self%branch > 0) self%branch_start = self%origins(self%branch)
      if (self%model%options%accuracy%is_on) call self%adopt_level(self%branch_start%level, error)
      if (allocated(error)) return
      if (self%branch == 0 .and. allocated(self%first%direction)) then
         direction = self%first%direction
      else if (self%has_left_branch()) then
         direction = self%branch_start%direction
      else
         direction = 0.0_wp*self%branch_start%x
         direction(size(direction)) = self%first_sense*self%sense()
      end if
      call self%course%begin()
      self%reported = [reported_extreme_t ::]
      self%estimate = huge(1.0_wp)
      self%curve%length = 0.0_wp
      self%curve%largest = 0.0_wp
      call self%find_roughness(self%branch_start%x)
      call self%make_curve(self%branch_start%x, direction)
      if (self%has_left_branch()) then
         call switch_curve(self, direction)
         self%curve%direction = self%sense()*direction
         self%curve%orientation = 0.0_wp                              ! not known where the determinant is zero
         self%curve%status = outcome%pending
         call self%restrict_to_symmetry()
      end if
      self%branch_start%direction = self%curve%direction
      self%start_on_set = self%branch_start
      call self%update_units()
      call self%evaluate_here(self%at_point)
   end subroutine motion_curve_start_branch

   !> At a branch point the tangent bordered by the direction has a null vector: the direction of the other curve
   !> across this one. Its sign, otherwise determined by rounding, is that of its first large entry.
   subroutine switch_curve(self, direction)
      class(motion_curve_t), intent(inout), target :: self
      real(wp), intent(inout) :: direction(:)                         !! on entry of the curve, on return of the other one
      real(wp), parameter :: large = 0.6_wp                           ! of the largest
      real(wp), dimension(size(direction)) :: along, next
      integer :: i
      logical :: is_found

      associate (curve => self%curve)
         along = direction/curve%units
         call curve%set_plane(curve%x, direction, 0.0_wp)
         call find_null_vector(curve%problem, curve%x, curve%units, spread(.true., 1, size(along)), along/norm2(along), next, &
                               is_found)
         if (.not. is_found) return
         i = findloc(abs(next/curve%units) > large*maxval(abs(next/curve%units)), .true., dim=1)
         direction = sign(1.0_wp, next(i))*next
      end associate
   end subroutine switch_curve

   !> Ends this branch; the next one follows if there is one: the other one from the same origin, or along another curve
   !> after a row for its start.
   subroutine leave(self, is_closed, error)
      class(motion_curve_t), intent(inout), target :: self
      logical, intent(in) :: is_closed                                !! along a closed curve the other one would be the same
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: x(:)
      logical :: is_found, is_last

      is_last = self%is_reversed .or. is_closed
      associate (request => self%request)                             ! from an origin the other has the same motions, shifted
         if (self%branch == 0) is_last = is_last .or. allocated(request%origin) .or. &
                                         (request%start - request%from)*(request%start - request%to) >= 0.0_wp
      end associate
      self%n_returned = size(self%points)
      self%is_reversed = .not. is_last
      if (is_last) self%branch = self%branch + 1
      do while (self%branch > 0 .and. self%branch <= size(self%origins))
         if (.not. self%origins(self%branch)%is_traced) exit
         self%branch = self%branch + 1
      end do
      if (self%branch > size(self%origins) .and. self%n_reported + 1 < self%request%n_points) then
         call search_separate(self, self%met, x, is_found, error)
         if (allocated(error)) return
         if (is_found) call add_origin(self%origins, .true., x, 0.0_wp*x, self%level)
      end if
      self%is_done = self%branch > size(self%origins)
      if (self%is_done) return
      call self%start_branch(error)
      if (self%branch > 0 .and. .not. allocated(error)) call set_start(self)
   end subroutine leave

   !> Makes the start of this branch the only point to be returned.
   subroutine set_start(self)
      class(motion_curve_t), intent(inout) :: self

      self%points = [waiting_t ::]
      call add_waiting(self%points, curve_kind%start, 0.0_wp, self%start_on_set%x)
      self%n_returned = 0
   end subroutine set_start

   !> Stores a motion at a value at which others are searched for.
   subroutine store_met_motion(self, x, level)
      class(motion_curve_t), intent(inout) :: self
      real(wp), intent(in) :: x(:)
      type(level_t), intent(in) :: level                              !! its set and grid

      if (.not. allocated(self%request%others)) return
      if (all(abs(self%request%others - x(size(x))) > 0.0_wp)) return
      call add_origin(self%met, .false., x, 0.0_wp*x, level)
   end subroutine store_met_motion

   ! Points of the curve

   !> Returns the next point. Its status shows where the curve ends; `interrupted`: nothing was computed, and the
   !> curve continues here in another run.
   subroutine motion_curve_next(self, result, error)
      class(motion_curve_t), intent(inout), target :: self
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error

      type(cancellation_t), target :: cancellation

      call cancellation%enter(self%model%options%solver%time_limit)
      call use_threads(self%model%options%solver%n_threads)
      call find_next(self, result, error)
      call cancellation%leave()
   end subroutine motion_curve_next

   !> Returns the next point, under a cancellation that has been entered.
   subroutine find_next(self, result, error)
      class(motion_curve_t), intent(inout), target :: self
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      type(report_t) :: before
      type(waiting_t) :: point
      type(waiting_t), allocatable :: points(:)
      real(wp) :: started
      logical :: has_ended, is_end

      started = wall_clock()
      before = self%curve%report
      if (self%n_returned >= size(self%points)) then
         call end_if_doubtful(self, has_ended)
         if (.not. has_ended) then
            call self%make_step(points, error)
            if (allocated(error)) return
            call move_alloc(points, self%points)
            self%n_returned = 0
         end if
      end if
      if (verdict_on_work() == verdict%interrupted) then             ! the events on the step may be incomplete
         result%status = outcome%interrupted
         return
      else if (self%curve%status /= outcome%pending) then
         call describe_end(self, result)
         call count_work(self%curve%report, before, result)
         call leave(self, .false., error)
      else
         point = self%points(self%n_returned + 1)
         call report(self, point, result, error)
         if (verdict_on_work() == verdict%interrupted) then          ! the results of the point may be incomplete
            result%status = outcome%interrupted
            return
         end if
         call count_work(self%curve%report, before, result)
         if (point%is_last .and. is_solved(result%status)) result%reason = reason%grazing
         if (point%unlocated /= "" .and. is_solved(result%status) .and. .not. allocated(result%message)) then
            result%message = "events passed before this point: "//trim(point%unlocated)
            result%reason = reason%unlocated
         end if
         is_end = point%is_last .or. point%kind == curve_kind%end
         if (is_end .and. self%course%is_retraced .and. .not. allocated(result%message)) result%message = returns_to_fold
         self%n_returned = self%n_returned + 1
         if (self%course%is_retraced .and. .not. is_end) self%points = [self%points(:self%n_returned), end_at_fold(point)]
         if (is_end .and. .not. allocated(error)) call leave(self, point%is_return, error)
      end if
      result%solver_seconds = wall_clock() - started - result%error_estimate_seconds
      self%n_reported = self%n_reported + 1
      if (self%is_done .or. self%n_reported < self%request%n_points) return
      self%is_done = .true.
      if (is_solved(result%status)) result%reason = reason%points
   end subroutine find_next

   !> Continues a curve that has ended at its number of points: it may have more of them.
   subroutine motion_curve_lengthen(self, n_points)
      class(motion_curve_t), intent(inout) :: self
      integer, intent(in) :: n_points                                 !! of the whole curve

      self%request%n_points = n_points
      self%is_done = self%n_reported >= n_points
   end subroutine motion_curve_lengthen

   !> Follows the curve to the first point of a kind, within a number of steps, and returns that point alone.
   subroutine motion_curve_search_for(self, kind, result, is_found, error)
      class(motion_curve_t), intent(inout), target :: self
      integer, intent(in) :: kind
      type(motion_result_t), intent(out) :: result
      logical, intent(out) :: is_found
      type(error_t), allocatable, intent(out) :: error
      type(waiting_t), allocatable :: points(:)
      integer :: i, n_steps

      is_found = .false.
      do n_steps = 1, nearby_steps
         call self%make_step(points, error)
         if (allocated(error) .or. self%curve%status /= outcome%pending) return
         i = findloc(points%kind, kind, dim=1)
         is_found = i > 0
         if (is_found) exit
      end do
      if (.not. is_found) return
      call report(self, points(i), result, error)
      call count_work(self%curve%report, report_t(), result)
   end subroutine motion_curve_search_for

   !> Performs one step, to the tolerance if one is requested, and returns its points.
   subroutine make_step(self, points, error)
      class(motion_curve_t), intent(inout), target :: self
      type(waiting_t), allocatable, intent(out) :: points(:)
      type(error_t), allocatable, intent(out) :: error

      if (self%model%options%accuracy%is_on) then
         call step_to_tolerance(self, points, error)
      else
         call step(self, points)
      end if
      if (allocated(error) .or. self%curve%status /= outcome%pending .or. work_is_over()) return
      call remove_doubtful_extremes(self, points, error)
   end subroutine make_step

   !> Computes the result of a point.
   subroutine report(self, point, result, error)
      class(motion_curve_t), intent(inout), target :: self
      type(waiting_t), intent(in) :: point
      type(motion_result_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error

      if (allocated(point%result)) then
         result = point%result
      else
         call self%describe(point, self%plane_at(point), result, error)
      end if
      if (.not. allocated(error)) call compare_in_time(self, point, result, error)
      call result%withdraw_verdict()
      if (.not. allocated(error)) call add_position(self, point, result)
   end subroutine report

   !> Compares a point with a short time integration if no set has made its estimate as small as those of others, and a slow tone
   !> may carry the motion through a jump: error estimates do not see it.
   subroutine compare_in_time(self, point, result, error)
      class(motion_curve_t), intent(inout), target :: self
      type(waiting_t), intent(in) :: point
      type(motion_result_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error
      type(motion_result_t) :: compared

      associate (accuracy => self%model%options%accuracy, kind => curve_kinds(point%kind))
         if (.not. accuracy%is_on .or. result%status /= outcome%converged .or. allocated(self%at_point%impacts)) return
         if (kind%is_bifurcation .or. point%kind == curve_kind%fold .or. point%is_crossing) return
         if (estimate_of(result) <= margin*accuracy%tolerance .or. .not. self%model%system%may_jump_within_period()) return
         call self%describe(point, self%plane_at(point), compared, error, compares_in_time=.true.)
         if (.not. allocated(error)) call allow_for_departure(compared%departure, accuracy%tolerance, result)
      end associate
   end subroutine compare_in_time

   !> Adds the position on the curve to the result of a point, and stores the data on which later points depend.
   subroutine add_position(self, point, result)
      class(motion_curve_t), intent(inout), target :: self
      type(waiting_t), intent(in) :: point
      type(motion_result_t), intent(inout) :: result
      type(curve_position_t) :: position
      type(point_kind_t) :: kind
      real(wp) :: length

      length = self%curve%last%length + point%position
      call store_met_motion(self, point%x, self%level)
      if (point%kind == curve_kind%regular) call count_doubtful_steps(self, result)
      call note_course(self, point%kind, point%x, length)
      position%kind = point%kind
      position%parameter = point%x(size(point%x))
      position%length = self%sense()*length
      position%branch = self%branch
      position%unknowns = self%pack(point%x)
      if (self%model%options%accuracy%is_on) then
         position%tuples = self%level%set%tuples
         position%n_samples = self%level%n_samples
      end if
      if (point%is_crossing) call note_traced(self, position)
      kind = curve_kinds(point%kind)
      if (kind%has_direction) position%direction = self%pack(self%curve%direction)
      if (kind%by == located_by%response) position%response = point%response
      if (kind%by == located_by%multipliers .and. kind%has_derivatives .and. allocated(result%stability%multipliers)) &
         position%angle = angle_of_pair(result%stability%multipliers)
      if (kind%is_extreme) self%reported = [self%reported, reported_extreme_t(point%response, length)]
      select case (point%kind)
      case (curve_kind%regular, curve_kind%start)
         call store_path(self%curve%path_t, position)
         position%n_unreliable = self%course%n_unreliable
         position%n_exhausted = self%course%n_exhausted
      case (curve_kind%branch)
         if (self%request%switches .and. self%branch == 0) &
            call add_origin(self%origins, .false., position%unknowns, position%direction, self%level)
      end select
      result%curve = position
      call find_curve_gradient(self, point, result)
   end subroutine add_position

   !> Notes that this branch has come to the origin of another one.
   subroutine note_traced(self, position)
      class(motion_curve_t), intent(inout) :: self
      type(curve_position_t), intent(in) :: position                  !! of an end
      integer :: i, n

      n = size(position%unknowns)
      do i = 1, size(self%origins)
         associate (origin => self%origins(i)%x, typical => self%request%moving%typical)
            if (self%origins(i)%is_apart .or. i == position%branch) cycle
            if (abs(origin(size(origin)) - position%unknowns(n)) > faint*typical) cycle
            self%origins(i)%is_traced = self%origins(i)%is_traced .or. &
               abs(norm2(origin(:size(origin) - 1)) - norm2(position%unknowns(:n - 1))) <= faint*norm2(origin(:size(origin) - 1))
         end associate
      end do
   end subroutine note_traced

   !> The numbers that store unknowns or a direction of the curve: themselves.
   pure function motion_curve_pack(self, x) result(packed)
      class(motion_curve_t), intent(in) :: self
      real(wp), intent(in) :: x(:)
      real(wp), allocatable :: packed(:)

      packed = x
   end function motion_curve_pack

   !> Records the work of a point.
   pure subroutine count_work(report, before, result)
      type(report_t), intent(in) :: report, before                    !! of the curve
      type(motion_result_t), intent(inout) :: result

      result%iterations = report%iterations - before%iterations
      result%evaluations = report%evaluations - before%evaluations
   end subroutine count_work

   !> The first response of the request at the point reported last.
   real(wp) function motion_curve_measure(self, x) result(measure)
      class(motion_curve_t), intent(inout), target :: self
      real(wp), intent(in) :: x(:)                                    !! its unknowns

      measure = 0.0_wp
      if (size(self%request%responses) > 0) measure = sqrt(self%square_at(self%request%responses(1), x))
   end function motion_curve_measure

   !> The system at a point that was reported, to which the curve moves its own.
   function motion_curve_system_at(self, position) result(system)
      class(motion_curve_t), intent(inout), target :: self
      type(curve_position_t), intent(in) :: position
      type(system_t), pointer :: system
      logical :: is_possible                                          ! it was there before

      call self%problem%set_parameters(self%problem%which, further_of(position, self%model%system), is_possible)
      system => self%problem%model%system
   end function motion_curve_system_at
end module hb_motion_curve
