!> A located point of curves, such as a maximum, a fold or a bifurcation, continued as a function of a second value of
!> the input.
!> At each of its points a curve along the first value is begun near the preceding point, and followed to the located
!> point. Steps of the second value grow if that point is close and shrink if it is not found, or is a different one.
module hb_motion_ridge
   use hb_bifurcation, only: bifurcation
   use hb_cancellation, only: cancellation_t, verdict, verdict_on_work, work_is_over
   use hb_clock, only: wall_clock
   use hb_curve_points, only: curve_point_t
   use hb_curve_request, only: curve_request_t
   use hb_discretisation, only: discretisation_t
   use hb_error, only: error_t
   use hb_kinds, only: pi, wp
   use hb_level, only: distance, level_of, level_t
   use hb_model, only: model_t
   use hb_motion_curve, only: motion_curve_t
   use hb_motion_result, only: curve_position_t, motion_result_t
   use hb_movement, only: movement_t, new_movement, set_movement
   use hb_options, only: options_t
   use hb_outcome, only: outcome, reason
   use hb_point_kinds, only: curve_kind, curve_kinds
   use hb_solution_curve, only: solution_curve_t
   use hb_switched_branch, only: max_change
   use hb_system, only: measure_of, system_t
   use hb_text, only: to_text
   use hb_threads, only: use_threads
   use hb_thresholds, only: negligible_step
   implicit none
   private
   public :: motion_ridge_t

   real(wp), parameter :: resonant_angle = 0.1_wp                     ! [rad] of multipliers that are about to meet
   real(wp), parameter :: twin_step = 0.01_wp                         ! of the longest step: near a point that merges with another
   integer, parameter :: max_twin_steps = 50                          ! likewise
   real(wp), parameter :: margin_beyond_ends = 0.1_wp                 ! of the range of the first value: points next to its ends

   !> Owns external resources: call `destroy`. A variable of this type needs the attribute `target`. Lengths are
   !> relative to the range of the second value.
   type, extends(solution_curve_t) :: motion_ridge_t
      type(curve_request_t), private :: request
      type(model_t), private :: model                                 ! at the present point
      type(curve_request_t), private :: inner                         ! of the curves along the first value
      type(curve_request_t), private :: nearby                        ! likewise, beyond the range: what leaves it is found there
      type(motion_curve_t), private :: short                          ! such a curve
      type(curve_position_t), private :: last                         ! the last point, with the tangent of the short curve there
      real(wp), private :: value = 0.0_wp                             ! second value there
      real(wp), private :: step = 0.0_wp
      real(wp), private :: length = 0.0_wp                            ! of the ridge up to there
      logical, private :: has_left = .false.                          ! the point tried last is outside the range of the first value
   contains
      procedure :: begin => motion_ridge_begin
      procedure :: continue_from => motion_ridge_continue_from
      procedure :: next => motion_ridge_next
      procedure :: system_at => motion_ridge_system_at
      procedure :: destroy => motion_ridge_destroy
   end type motion_ridge_t

contains

   !> Follows a whole curve along the first value at the start of the second: the ridge begins at its highest peak, or
   !> at its first point of another kind.
   subroutine motion_ridge_begin(self, model, request, result, error)
      class(motion_ridge_t), intent(inout), target :: self
      type(model_t), intent(inout) :: model                           !! at the start
      type(curve_request_t), intent(in) :: request                    !! with `over`
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      type(motion_result_t) :: point
      real(wp) :: highest, measure

      call prepare(self, model%system, model%discretisation, model%options, request)
      call set_values(self, request%start, self%inner%start, error)
      if (.not. allocated(error)) call self%short%begin(self%model, self%inner, point, error)
      self%is_done = allocated(error)
      if (self%is_done) return
      highest = -huge(1.0_wp)
      result = point
      do while (.not. self%short%is_done)
         call self%short%next(point, error)
         if (allocated(error) .or. point%status == outcome%interrupted) then
            result%status = point%status
            self%is_done = .true.
            return
         end if
         if (.not. allocated(point%curve)) cycle                      ! the curve was lost there
         if (point%curve%kind /= request%over%kind) cycle
         measure = self%short%measure(point%curve%unknowns)
         if (measure <= highest .or. (highest >= 0.0_wp .and. request%over%kind /= curve_kind%peak)) cycle
         highest = measure
         result = point
         call store_direction(self, result)
      end do
      self%is_done = highest < 0.0_wp
      if (self%is_done) then
         if (result%status == outcome%converged) result%status = outcome%stalled
         result%curve = curve_position_t(curve_kind%none, request%start, over=self%inner%start)
         result%message = "no such point was found on the curve from "//to_text(self%inner%from)//" to "//to_text(self%inner%to)
         return
      end if
      call report_point(self, request%start, curve_kind%start, result)
   end subroutine motion_ridge_begin

   !> Replaces `begin`: restores the state of a stored ridge.
   subroutine motion_ridge_continue_from(self, model, request, stored, error)
      class(motion_ridge_t), intent(inout), target :: self
      type(model_t), intent(in) :: model
      type(curve_request_t), intent(in) :: request
      type(curve_position_t), intent(in) :: stored(:)                 !! all points up to the one to continue from
      type(error_t), allocatable, intent(out) :: error                !! if there is none

      call prepare(self, model%system, model%discretisation, model%options, request)
      self%last = stored(size(stored))
      self%step = self%last%step
      self%value = self%last%parameter
      self%length = self%last%length
      self%n_reported = size(stored)
      self%is_done = self%n_reported >= self%n_points
   end subroutine motion_ridge_continue_from

   subroutine prepare(self, system, discretisation, options, request)
      class(motion_ridge_t), intent(inout), target :: self
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(curve_request_t), intent(in) :: request

      self%request = request
      self%n_points = request%n_points
      self%model%system = system
      self%model%discretisation = discretisation
      self%model%options = options
      self%step = 0.25_wp*request%longest_step
      self%inner%moving = request%over%moving
      self%inner%from = request%over%from
      self%inner%to = request%over%to
      self%inner%start = request%over%from
      self%inner%longest_step = request%longest_step
      self%inner%n_points = huge(1)
      self%inner%responses = request%responses
      self%nearby = self%inner
      self%nearby%from = self%inner%from - margin_beyond_ends*(self%inner%to - self%inner%from)
      self%nearby%to = self%inner%to + margin_beyond_ends*(self%inner%to - self%inner%from)
   end subroutine prepare

   !> Sets both values, and what follows them, in the model.
   subroutine set_values(self, value, first_value, error)
      class(motion_ridge_t), intent(inout), target :: self
      real(wp), intent(in) :: value, first_value
      type(error_t), allocatable, intent(out) :: error
      type(movement_t) :: movement

      call new_movement(movement, self%model, self%request%moving%number, self%request%moving%is_tied, error)
      if (.not. allocated(error)) call set_movement(self%model, movement, value, error)
      if (.not. allocated(error)) call new_movement(movement, self%model, self%inner%moving%number, .false., error)
      if (.not. allocated(error)) call set_movement(self%model, movement, first_value, error)
   end subroutine set_values

   !> Makes a point of a curve along the first value the last point of the ridge.
   subroutine report_point(self, value, kind, result)
      class(motion_ridge_t), intent(inout) :: self
      real(wp), intent(in) :: value
      integer, intent(in) :: kind
      type(motion_result_t), intent(inout) :: result

      if (kind /= curve_kind%start) self%length = self%length + abs(value - self%value)/self%request%moving%typical
      self%last = result%curve
      self%value = value
      associate (position => result%curve)
         position%kind = kind
         position%parameter = value
         position%over = position%unknowns(size(position%unknowns))
         position%length = self%length
         position%branch = 0
         position%step = self%step
         if (all(kind /= [curve_kind%start, curve_kind%regular])) deallocate (position%direction) ! not a point of continuation
      end associate
      self%n_reported = self%n_reported + 1
      self%is_done = kind == curve_kind%end .or. self%n_reported >= self%n_points
      if (self%is_done .and. kind /= curve_kind%end) result%reason = reason%points
   end subroutine report_point

   !> Returns the next point. Its status shows where the curve ends.
   subroutine motion_ridge_next(self, result, error)
      class(motion_ridge_t), intent(inout), target :: self
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      type(motion_result_t) :: nothing
      type(cancellation_t), target :: cancellation
      real(wp) :: far, started, value
      integer :: i, kind
      logical :: is_found

      started = wall_clock()
      call cancellation%enter(self%model%options%solver%time_limit)
      call use_threads(self%model%options%solver%n_threads)
      associate (request => self%request, sense => sign(1.0_wp, self%request%to - self%request%from))
         do
            value = self%value + sense*self%step*request%moving%typical
            kind = curve_kind%regular
            far = request%to
            do i = 1, size(request%values)
               if (sense*(request%values(i) - self%value) > 0.0_wp .and. sense*(far - request%values(i)) > 0.0_wp) &
                  far = request%values(i)
            end do
            if (sense*(value - far) >= 0.0_wp) then
               value = far
               kind = merge(curve_kind%end, curve_kind%value, abs(far - request%to) <= 0.0_wp)
            end if
            call try(self, value, result, is_found, error)
            if (allocated(error) .or. is_found) exit
            if (work_is_over()) exit
            self%step = 0.5_wp*min(self%step, abs(value - self%value)/request%moving%typical)
            if (self%step < negligible_step*request%longest_step) exit
         end do
         if (is_found) then
            self%step = min(request%longest_step, 1.5_wp*self%step)
            call report_point(self, value, kind, result)
         else if (.not. allocated(error)) then
            if (.not. work_is_over()) call report_end(self, result, is_found, error)
            if (.not. is_found) then
               result = nothing
               result%status = outcome%stalled
               result%reason = reason%lost_curve
               if (verdict_on_work() == verdict%timed_out) result%status = outcome%timed_out
               if (verdict_on_work() == verdict%interrupted) result%status = outcome%interrupted
               result%message = "continuation of the located point failed beyond the value "//to_text(self%value)
               self%is_done = .true.
            end if
         else
            self%is_done = .true.
         end if
      end associate
      call cancellation%leave()
      result%solver_seconds = wall_clock() - started - result%error_estimate_seconds
   end subroutine motion_ridge_next

   !> Reports the last point again as the end of the ridge, if there is a reason for it to end there.
   subroutine report_end(self, result, is_regular, error)
      class(motion_ridge_t), intent(inout), target :: self
      type(motion_result_t), intent(out) :: result
      logical, intent(out) :: is_regular
      type(error_t), allocatable, intent(out) :: error
      character(80) :: text
      logical :: is_torus

      is_regular = .true.
      is_torus = curve_kinds(self%request%over%kind)%bifurcation == bifurcation%torus
      if (self%has_left) then
         text = "it leaves the range of 'over'"
      else if (is_torus .and. self%last%angle < resonant_angle) then
         text = "the multipliers meet at 1, a 1:1 resonance"
      else if (is_torus .and. pi - self%last%angle < resonant_angle) then
         text = "the multipliers meet at -1, a 1:2 resonance"
      else
         call find_twin(self, is_regular, error)
         if (allocated(error)) return
         text = "it merges with another one"
         if (self%request%over%kind == curve_kind%fold) text = "two folds merge, at a cusp or where a closed curve vanishes"
         if (self%request%over%kind == curve_kind%peak) text = "the peak merges with a minimum"
      end if
      if (is_regular) call try(self, self%value, result, is_regular, error)
      if (allocated(error) .or. .not. is_regular) return
      call report_point(self, self%value, curve_kind%end, result)
      result%message = "the located point ends here: "//trim(text)
   end subroutine report_end

   !> Whether there is another point of the kind next to the last one, with which it is about to merge: a peak merges
   !> with a minimum.
   subroutine find_twin(self, is_there, error)
      class(motion_ridge_t), intent(inout), target :: self
      logical, intent(out) :: is_there
      type(error_t), allocatable, intent(out) :: error
      type(curve_position_t) :: position
      type(curve_request_t) :: close
      type(curve_point_t), allocatable :: points(:)
      integer :: attempt, i, n
      logical :: is_found

      is_there = .false.
      close = self%nearby
      close%longest_step = twin_step*close%longest_step
      if (self%request%over%kind == curve_kind%peak) then
         close%responses = [close%responses, close%responses]
         close%responses(size(self%inner%responses) + 1:)%kind = curve_kind%minimum
      end if
      position = self%last
      call set_values(self, self%value, self%last%unknowns(size(self%last%unknowns)), error)
      do attempt = 1, 2                                               ! along the curve, then in the opposite direction
         if (allocated(error)) return
         call self%short%destroy()
         call self%short%begin_next_to(self%model, close, position, is_found, error)
         if (allocated(error) .or. .not. is_found) return
         n = 0
         do i = 1, max_twin_steps
            call self%short%make_step(points, error)
            if (allocated(error)) return
            if (self%short%curve%status /= outcome%pending) exit
            n = n + count(points%kind == self%request%over%kind)
            if (self%request%over%kind == curve_kind%peak) n = n + count(points%kind == curve_kind%minimum)
            is_there = n > 1
            if (is_there) return
         end do
         position%direction = -position%direction
      end do
   end subroutine find_twin

   !> Searches for the point at another second value, near the last one: along the curve there, then in the opposite
   !> direction.
   subroutine try(self, value, result, is_found, error)
      class(motion_ridge_t), intent(inout), target :: self
      real(wp), intent(in) :: value
      type(motion_result_t), intent(out) :: result
      logical, intent(out) :: is_found
      type(error_t), allocatable, intent(out) :: error
      type(curve_position_t) :: position
      integer :: attempt

      is_found = .false.
      self%has_left = .false.
      call set_values(self, value, self%last%unknowns(size(self%last%unknowns)), error)
      if (allocated(error)) return
      position = self%last
      do attempt = 1, 2                                               ! along the curve, then in the opposite direction
         call self%short%destroy()
         call self%short%begin_next_to(self%model, self%nearby, position, is_found, error)
         if (allocated(error) .or. .not. is_found) return
         call self%short%search_for(self%request%over%kind, result, is_found, error)
         if (allocated(error) .or. is_found) exit
         position%direction = -position%direction
      end do
      if (allocated(error) .or. .not. is_found) return
      call store_direction(self, result)
      associate (over => self%request%over, at => result%curve%unknowns(size(result%curve%unknowns)))
         self%has_left = (at - over%from)*(at - over%to) > 0.0_wp
      end associate
      is_found = .not. self%has_left
      if (is_found) &
         is_found = distance(motion_at(self, result%curve), motion_at(self, self%last), measure_of(self%model%system), &
                             .false.) <= max_change
   end subroutine try

   !> Grazes and similar points have no direction for the continuation of curves; the ridge has one.
   subroutine store_direction(self, result)
      class(motion_ridge_t), intent(in) :: self
      type(motion_result_t), intent(inout) :: result

      if (.not. allocated(result%curve%direction)) result%curve%direction = self%short%curve%direction
   end subroutine store_direction

   !> The motion of a point on its set.
   function motion_at(self, position) result(level)
      type(motion_ridge_t), intent(in) :: self
      type(curve_position_t), intent(in) :: position
      type(level_t) :: level

      level = level_of(self%model%discretisation, position)
      level%unknowns = [position%unknowns(:size(position%unknowns) - 1), 0.0_wp*self%model%system%tones%omega]
   end function motion_at

   !> The system at the last point, to which the curve along the first value moves its own.
   function motion_ridge_system_at(self, position) result(system)
      class(motion_ridge_t), intent(inout), target :: self
      type(curve_position_t), intent(in) :: position
      type(system_t), pointer :: system

      system => self%short%system_at(position)
   end function motion_ridge_system_at

   !> Frees the curve; safe to call twice.
   subroutine motion_ridge_destroy(self)
      class(motion_ridge_t), intent(inout) :: self

      call self%short%destroy()
   end subroutine motion_ridge_destroy
end module hb_motion_ridge
