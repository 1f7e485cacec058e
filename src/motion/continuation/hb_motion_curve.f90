!> A curve of motions as a function of one value of the input, parametrised by its arc length: it passes folds and
!> reaches given values exactly; its folds, the maxima of responses and, if multipliers are known, its bifurcations
!> are located.
!> The length of a step is limited by the turn of the tangent and by the iterations of the corrector. A curve that
!> starts inside the range is followed in both directions; then follow the curves that cross it, and those from
!> separate motions. Each point has all results of a motion. Source: docs/user/curves.md; docs/why/theory.md, section
!> 6.7.
module hb_motion_curve
   use hb_balance_branch, only: balance_branch_t
   use hb_bifurcation, only: angle_of_pair, movement
   use hb_cancellation, only: cancellation_t, verdict, verdict_on_work
   use hb_clock, only: wall_clock
   use hb_curve, only: curve_t, path_t
   use hb_curve_branches, only: branches_t, origin_t
   use hb_curve_course, only: curve_course_t
   use hb_curve_end, only: describe_end, end_at_fold, returns_to_fold
   use hb_curve_events, only: event_values_t
   use hb_curve_points, only: add_point, curve_point_t, path_of, reported_extreme_t, store_path
   use hb_curve_request, only: curve_request_t
   use hb_curve_return, only: note_course, restore_course
   use hb_error, only: error_t
   use hb_followed, only: followed_t, step_accuracy_t
   use hb_kinds, only: wp
   use hb_level, only: estimate_of, goal_share, level_of, level_t
   use hb_level_stability, only: allow_for_departure
   use hb_model, only: model_t
   use hb_motion_result, only: curve_position_t, motion_result_t
   use hb_outcome, only: is_solved, outcome, reason
   use hb_point_kinds, only: curve_kind, curve_kinds, located_by, point_kind_t
   use hb_solution_curve, only: solution_curve_t
   use hb_solver_types, only: report_t
   use hb_stability, only: stability_t, unknown_because
   use hb_system, only: system_t
   use hb_tangent_solver, only: find_null_vector
   use hb_threads, only: use_threads
   use hb_thresholds, only: nearby_steps
   implicit none
   private
   public :: motion_curve_t

   real(wp), parameter :: run_up = 0.05_wp                            ! of the longest step, to the next expected point

   !> Owns external resources: call `destroy`. A variable of this type needs the attribute `target`.
   type, extends(solution_curve_t) :: motion_curve_t
      class(followed_t), allocatable :: followed                      !! its equations; a balance if it is not allocated before
      type(curve_t) :: curve                                          !! at its point
      type(event_values_t) :: at_point                                !! what events compare there
      type(step_accuracy_t) :: accuracy                               !! of the last step
      type(branches_t) :: branches
      type(curve_course_t) :: course                                  !! of the present branch
      type(curve_point_t), allocatable :: points(:)                   !! of the last step
      integer :: n_returned = 0                                       !! of them
   contains
      procedure :: begin => motion_curve_begin
      procedure :: begin_next_to => motion_curve_begin_next_to
      procedure :: continue_from => motion_curve_continue_from
      procedure :: next => motion_curve_next
      procedure :: search_for => motion_curve_search_for
      procedure :: measure => motion_curve_measure
      procedure :: make_step => motion_curve_make_step
      procedure :: system_at => motion_curve_system_at
      procedure :: destroy => motion_curve_destroy
   end type motion_curve_t

contains

   ! Start of a curve

   !> Finds the first motion; the curve has ended if there is none.
   subroutine motion_curve_begin(self, model, request, result, error)
      class(motion_curve_t), intent(inout), target :: self
      type(model_t), intent(inout) :: model                           !! at the start
      type(curve_request_t), intent(in) :: request
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      type(origin_t) :: first
      logical :: is_described

      call adopt(self, request)
      call self%followed%find_first(model, first, result, is_described, error)
      self%is_done = allocated(error) .or. .not. allocated(first%x)
      if (self%is_done) return
      call self%branches%begin(first, self%followed%request)
      call start_branch(self, error)
      if (.not. allocated(error)) then
         call set_start(self)
         if (is_described) then
            call add_position(self, self%points(1), result)
         else
            call report(self, self%points(1), result, error)
         end if
      end if
      self%n_returned = 1
      self%n_reported = 1
      self%is_done = allocated(error) .or. self%n_reported >= self%n_points
   end subroutine motion_curve_begin

   !> Adopts a request.
   subroutine adopt(self, request)
      class(motion_curve_t), intent(inout), target :: self
      type(curve_request_t), intent(in) :: request

      if (.not. allocated(self%followed)) allocate (balance_branch_t :: self%followed)
      call self%followed%adopt_request(request)
      self%n_points = request%n_points
      self%points = [curve_point_t ::]
      self%n_returned = 0
   end subroutine adopt

   !> Replaces `begin`: starts from a motion and tangent of another curve, in the plane across the tangent and
   !> slightly before the motion, so that the events there are ahead. `is_found` is false if there is no motion.
   subroutine motion_curve_begin_next_to(self, model, request, position, is_found, error)
      class(motion_curve_t), intent(inout), target :: self
      type(model_t), intent(in) :: model
      type(curve_request_t), intent(in) :: request
      type(curve_position_t), intent(in) :: position                  !! a fold or peak of the other curve, with its tangent
      logical, intent(out) :: is_found
      type(error_t), allocatable, intent(out) :: error
      type(curve_position_t) :: stored(1)
      type(origin_t) :: first

      is_found = .false.
      call adopt(self, request)
      stored(1) = position
      call self%followed%resume(model, stored, error)
      if (allocated(error)) return
      associate (direction => position%direction, followed => self%followed)
         first%x = position%unknowns - run_up*request%longest_step*direction/norm2(direction/followed%units_at(position%unknowns))
         first%direction = direction
         first%level = followed%level
         call followed%correct_on_plane(first%x, first%direction, is_found)
      end associate
      call self%branches%begin(first, self%followed%request)
      if (is_found) call start_branch(self, error)
   end subroutine motion_curve_begin_next_to

   !> Replaces `begin`: restores the state of a stored curve at its last point, a step or the start of a branch.
   subroutine motion_curve_continue_from(self, model, request, stored, error)
      class(motion_curve_t), intent(inout), target :: self
      type(model_t), intent(in) :: model                              !! at the start
      type(curve_request_t), intent(in) :: request
      type(curve_position_t), intent(in) :: stored(:)                 !! all points up to the one to continue from
      type(error_t), allocatable, intent(out) :: error
      type(motion_result_t) :: result
      type(curve_point_t) :: here

      call adopt(self, request)
      call self%followed%resume(model, stored, error)
      self%is_done = allocated(error)
      if (self%is_done) return
      call restore_branches(self, stored)
      call start_branch(self, error)
      if (allocated(error)) return
      self%n_reported = size(stored)
      associate (last => stored(size(stored)), followed => self%followed)
         if (model%options%accuracy%is_on) then
            call followed%adopt_level(level_of(model%discretisation, last), error)
            if (allocated(error)) return
            self%branches%start_on_set = followed%on_level(self%branches%start)
         end if
         call followed%place(self%curve, unpacked_path(self, last))
         call restore_passed(self, stored)
         self%course%n_unreliable = last%n_unreliable
         self%course%n_exhausted = last%n_exhausted
         call followed%evaluate(self%curve, self%at_point)
         call restore_speed(self, stored)
         if (model%options%accuracy%is_on .and. last%kind == curve_kind%regular) then
            here = curve_point_t(last%kind, x=self%curve%x)
            call followed%describe(self%curve, here, followed%plane_at(self%curve, here), result, error)
            self%accuracy%estimate = estimate_of(result)
         end if
      end associate
      self%is_done = self%n_reported >= self%n_points
   end subroutine motion_curve_continue_from

   !> The path of a stored row, to whose section the equations move.
   function unpacked_path(self, position) result(path)
      class(motion_curve_t), intent(inout), target :: self
      type(curve_position_t), intent(in) :: position
      type(path_t) :: path

      path = path_of(position)
      call self%followed%unpack(position%direction, path%direction)
      call self%followed%unpack(position%unknowns, path%x)
   end function unpacked_path

   !> Restores the speed of the multipliers on the last step, unless the set has changed.
   subroutine restore_speed(self, stored)
      class(motion_curve_t), intent(inout), target :: self
      type(curve_position_t), intent(in) :: stored(:)
      type(stability_t) :: there
      real(wp), allocatable :: x(:)
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
         call self%followed%unpack(stored(i)%unknowns, x)
         call self%followed%find_stability(x, self%followed%model%options%stability%tolerance, there)
         call self%followed%unpack(last%unknowns, x)
         if (.not. allocated(there%multipliers)) return
         self%at_point%speed = movement(there%multipliers, self%at_point%stability%multipliers)/ &
                               abs(last%length - stored(i)%length)
      end associate
   end subroutine restore_speed

   !> Restores where branches begin, the present one, and the motions that were passed at values at which others are sought.
   subroutine restore_branches(self, stored)
      class(motion_curve_t), intent(inout), target :: self
      type(curve_position_t), intent(in) :: stored(:)
      type(origin_t) :: first
      type(level_t) :: level
      integer :: i

      first%x = stored(1)%unknowns
      first%level = self%followed%level
      if (allocated(self%followed%request%origin)) first%direction = stored(1)%direction
      associate (branches => self%branches, request => self%followed%request, last => stored(size(stored)))
         call branches%begin(first, request)
         do i = 1, size(stored)
            level = level_of(self%followed%model%discretisation, stored(i))
            associate (x => stored(i)%unknowns)
               if (stored(i)%kind == curve_kind%branch .and. stored(i)%branch == 0 .and. request%switches) &
                  call branches%add(x, level, stored(i)%direction)
               if (stored(i)%kind == curve_kind%start .and. stored(i)%branch > size(branches%origins)) call branches%add(x, level)
               call branches%note(x, level, request)
            end associate
         end do
         branches%number = last%branch
         branches%is_reversed = last%length < 0.0_wp .or. (last%branch > 0 .and. &
                                count(stored%kind == curve_kind%start .and. stored%branch == last%branch) > 1)
      end associate
   end subroutine restore_branches

   !> Restores what the present branch has passed: the ends of others, folds, peaks and minima, and its course since its start.
   subroutine restore_passed(self, stored)
      class(motion_curve_t), intent(inout), target :: self
      type(curve_position_t), intent(in) :: stored(:)
      integer :: i

      associate (followed => self%followed, course => self%course)
         do i = 1, size(stored)
            if (stored(i)%kind == curve_kind%end .and. stored(i)%branch > 0) &
               call self%branches%trace(stored(i)%unknowns, stored(i)%branch, followed%request%moving%typical)
         end do
         do i = size(stored), 2, -1
            if (stored(i)%kind == curve_kind%start .or. stored(i)%length*stored(size(stored))%length < 0.0_wp) exit
            if (stored(i)%extreme /= 0) course%reported = [reported_at(stored(i)), course%reported]
         end do
         if (followed%has_images()) &
            call restore_course(followed, course, stored(max(1, i):), followed%model%discretisation)
      end associate
   end subroutine restore_passed

   !> The extreme of a stored point.
   pure type(reported_extreme_t) function reported_at(position) result(reported)
      type(curve_position_t), intent(in) :: position

      reported = reported_extreme_t(position%response, abs(position%length))
      if (abs(position%extreme) == 1) reported%sense = position%extreme
   end function reported_at

   ! Branches of the curve

   !> Places the curve at the start of the present branch.
   subroutine start_branch(self, error)
      class(motion_curve_t), intent(inout), target :: self
      type(error_t), allocatable, intent(out) :: error
      type(origin_t) :: origin
      real(wp), allocatable :: direction(:)

      associate (followed => self%followed, branches => self%branches)
         origin = branches%origin()
         branches%start = origin
         if (allocated(origin%direction)) call followed%unpack(origin%direction, branches%start%direction)
         call followed%unpack(origin%x, branches%start%x)
         if (followed%model%options%accuracy%is_on) call followed%adopt_level(origin%level, error)
         if (allocated(error)) return
         direction = branches%direction()
         call self%course%begin()
         self%accuracy%estimate = huge(1.0_wp)
         self%curve%length = 0.0_wp
         self%curve%largest = 0.0_wp
         call followed%find_roughness(branches%start%x)
         call followed%begin_curve(self%curve, branches%start%x, direction)
         if (branches%leaves_another()) then
            call switch_curve(self%curve, direction)
            call followed%turn_to(self%curve, branches%sense()*direction)
         end if
         branches%start%direction = self%curve%direction
         branches%start_on_set = branches%start
         call followed%update_units(self%curve)
         call followed%evaluate(self%curve, self%at_point)
      end associate
   end subroutine start_branch

   !> At a branch point the tangent bordered by the direction has a null vector: the direction of the other curve
   !> across this one. Its sign, otherwise determined by rounding, is that of its first large entry.
   subroutine switch_curve(curve, direction)
      type(curve_t), intent(inout) :: curve
      real(wp), intent(inout) :: direction(:)                         !! on entry of the curve, on return of the other one
      real(wp), parameter :: large_amplitude_share = 0.6_wp           ! of the largest
      real(wp), dimension(size(direction)) :: along, next
      integer :: i
      logical :: is_found

      along = direction/curve%units
      call curve%set_plane(curve%x, direction, 0.0_wp)
      call find_null_vector(curve%problem, curve%x, curve%units, spread(.true., 1, size(along)), along/norm2(along), next, &
                            is_found)
      if (.not. is_found) return
      i = findloc(abs(next/curve%units) > large_amplitude_share*maxval(abs(next/curve%units)), .true., dim=1)
      direction = sign(1.0_wp, next(i))*next
   end subroutine switch_curve

   !> Ends this branch; the next one follows if there is one: the other one from the same origin, or along another curve
   !> after a row for its start.
   subroutine leave(self, is_closed, error)
      class(motion_curve_t), intent(inout), target :: self
      logical, intent(in) :: is_closed                                !! along a closed curve the other one would be the same
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: x(:)
      logical :: is_found, is_last

      associate (request => self%followed%request, branches => self%branches)
         is_last = is_closed
         if (branches%number == 0) is_last = is_last .or. allocated(request%origin) .or. & ! the other has the same motions, shifted
                                             (request%start - request%from)*(request%start - request%to) >= 0.0_wp
         self%n_returned = size(self%points)
         call branches%advance(is_last)
         if (branches%are_exhausted() .and. self%n_reported + 1 < self%n_points) then
            call self%followed%find_separate(branches, x, is_found, error)
            if (allocated(error)) return
            if (is_found) call branches%add(x, self%followed%level)
         end if
         self%is_done = branches%are_exhausted()
         if (self%is_done) return
         call start_branch(self, error)
         if (branches%number > 0 .and. .not. allocated(error)) call set_start(self)
      end associate
   end subroutine leave

   !> Makes the start of this branch the only point to be returned.
   subroutine set_start(self)
      class(motion_curve_t), intent(inout) :: self

      self%points = [curve_point_t ::]
      call add_point(self%points, curve_kind%start, 0.0_wp, self%branches%start_on_set%x)
      self%n_returned = 0
   end subroutine set_start

   ! Points of the curve

   !> Returns the next point. Its status shows where the curve ends; `interrupted`: nothing was computed, and the
   !> curve continues here in another run.
   subroutine motion_curve_next(self, result, error)
      class(motion_curve_t), intent(inout), target :: self
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      type(cancellation_t), target :: cancellation

      call cancellation%enter(self%followed%model%options%solver%time_limit)
      call use_threads(self%followed%model%options%solver%n_threads)
      call find_next(self, result, error)
      call cancellation%leave()
   end subroutine motion_curve_next

   !> Returns the next point, under a cancellation that has been entered.
   subroutine find_next(self, result, error)
      class(motion_curve_t), intent(inout), target :: self
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      type(report_t) :: before
      type(curve_point_t) :: point
      type(curve_point_t), allocatable :: points(:)
      real(wp) :: started
      integer :: status
      logical :: is_end

      started = wall_clock()
      before = self%curve%report
      if (self%n_returned >= size(self%points)) then
         status = self%course%status()
         if (status /= outcome%pending) then
            self%curve%status = status
         else
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
         call describe_end(self%followed, self%curve, self%course, result)
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
      if (self%is_done .or. self%n_reported < self%n_points) return
      self%is_done = .true.
      if (is_solved(result%status)) result%reason = reason%points
   end subroutine find_next

   !> Follows the curve to the first point of a kind, within a number of steps, and returns that point alone.
   subroutine motion_curve_search_for(self, kind, result, is_found, error)
      class(motion_curve_t), intent(inout), target :: self
      integer, intent(in) :: kind
      type(motion_result_t), intent(out) :: result
      logical, intent(out) :: is_found
      type(error_t), allocatable, intent(out) :: error
      type(curve_point_t), allocatable :: points(:)
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

   !> Performs one step and returns its points.
   subroutine motion_curve_make_step(self, points, error)
      class(motion_curve_t), intent(inout), target :: self
      type(curve_point_t), allocatable, intent(out) :: points(:)
      type(error_t), allocatable, intent(out) :: error

      call self%followed%make_step(self%curve, self%at_point, self%branches, self%course, self%accuracy, points, error)
   end subroutine motion_curve_make_step

   !> Computes the result of a point.
   subroutine report(self, point, result, error)
      class(motion_curve_t), intent(inout), target :: self
      type(curve_point_t), intent(in) :: point
      type(motion_result_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error

      if (allocated(point%result)) then
         result = point%result
      else
         call describe(self, point, result, error)
      end if
      if (.not. allocated(error)) call compare_in_time(self, point, result, error)
      call result%withdraw_verdict()
      if (.not. allocated(error)) call add_position(self, point, result)
   end subroutine report

   !> Describes a point. A branch that leaves another one begins where both cross.
   subroutine describe(self, point, result, error, compares_in_time)
      class(motion_curve_t), intent(inout), target :: self
      type(curve_point_t), intent(in) :: point
      type(motion_result_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: compares_in_time
      type(curve_point_t) :: there

      there = point
      if (point%kind == curve_kind%start) there%is_crossing = self%branches%leaves_another()
      associate (followed => self%followed)
         call followed%describe(self%curve, there, followed%plane_at(self%curve, there), result, error, compares_in_time)
      end associate
   end subroutine describe

   !> Compares a point with a short time integration if no set has made its estimate as small as those of others, and a slow tone
   !> may carry the motion through a jump: error estimates do not see it.
   subroutine compare_in_time(self, point, result, error)
      class(motion_curve_t), intent(inout), target :: self
      type(curve_point_t), intent(in) :: point
      type(motion_result_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error
      type(motion_result_t) :: compared

      associate (accuracy => self%followed%model%options%accuracy, kind => curve_kinds(point%kind))
         if (.not. accuracy%is_on .or. result%status /= outcome%converged) return
         if (kind%is_bifurcation .or. point%kind == curve_kind%fold .or. point%is_crossing) return
         if (estimate_of(result) <= goal_share*accuracy%tolerance .or. .not. self%followed%may_jump_within_period) return
         call describe(self, point, compared, error, compares_in_time=.true.)
         if (.not. allocated(error)) call allow_for_departure(compared%departure, accuracy%tolerance, result)
      end associate
   end subroutine compare_in_time

   !> Adds the position on the curve to the result of a point, and stores the data on which later points depend.
   subroutine add_position(self, point, result)
      class(motion_curve_t), intent(inout), target :: self
      type(curve_point_t), intent(in) :: point
      type(motion_result_t), intent(inout) :: result
      type(curve_position_t) :: position
      type(point_kind_t) :: kind
      real(wp) :: length

      associate (followed => self%followed, branches => self%branches, course => self%course)
         length = self%curve%last%length + point%position
         call branches%note(point%x, followed%level, followed%request)
         if (point%kind == curve_kind%regular) &
            call course%count_step(followed%model%options%accuracy, self%accuracy%is_out_of_work, result)
         if (followed%has_images()) call note_course(followed, course, point%kind, point%x, length)
         position%kind = point%kind
         position%parameter = point%x(size(point%x))
         position%length = branches%sense()*length
         position%branch = branches%number
         position%unknowns = followed%pack(point%x)
         if (followed%model%options%accuracy%is_on) then
            position%tuples = followed%level%harmonics%tuples
            position%n_samples = followed%level%torus%n_samples
         end if
         if (point%is_crossing) call branches%trace(position%unknowns, position%branch, followed%request%moving%typical)
         kind = curve_kinds(point%kind)
         if (kind%is_bifurcation .and. any(result%stability%reason == [unknown_because%at_limit, unknown_because%inaccurate])) &
            result%stability%reason = unknown_because%at_bifurcation
         if (kind%has_direction) position%direction = followed%pack(self%curve%direction)
         if (kind%by == located_by%response) position%response = point%response
         if (kind%by == located_by%multipliers .and. kind%has_derivatives .and. allocated(result%stability%multipliers)) &
            position%angle = angle_of_pair(result%stability%multipliers)
         if (kind%is_extreme .or. point%hides_fold) then
            position%extreme = nint(merge(point%sense, 2.0_wp, abs(point%sense) > 0.0_wp))
            course%reported = [course%reported, reported_at(position)]
         end if
         select case (point%kind)
         case (curve_kind%regular, curve_kind%start)
            call store_path(self%curve%path_t, position)
            position%n_unreliable = course%n_unreliable
            position%n_exhausted = course%n_exhausted
         case (curve_kind%branch)
            if (followed%request%switches .and. branches%number == 0) &
               call branches%add(position%unknowns, followed%level, position%direction)
         end select
         result%curve = position
         call followed%find_gradient(self%curve, point, result)
      end associate
   end subroutine add_position

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
      associate (followed => self%followed)
         if (size(followed%request%responses) > 0) measure = sqrt(followed%square_at(followed%request%responses(1), x))
      end associate
   end function motion_curve_measure

   !> The system at a point that was reported, to which the curve moves its own.
   function motion_curve_system_at(self, position) result(system)
      class(motion_curve_t), intent(inout), target :: self
      type(curve_position_t), intent(in) :: position
      type(system_t), pointer :: system

      system => self%followed%system_at(position)
   end function motion_curve_system_at

   !> Frees the equations; safe to call twice.
   subroutine motion_curve_destroy(self)
      class(motion_curve_t), intent(inout) :: self

      if (allocated(self%followed)) call self%followed%destroy()
   end subroutine motion_curve_destroy
end module hb_motion_curve
