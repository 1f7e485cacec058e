!> One curve, for the command, C and Python alike: its first motion is found by the attempts of `hb_attempts`, or its state
!> at a stored point is restored; then its points are returned one by one. With jumps the curve has several parts, each a curve
!> of its own (hb_curve_jumps).
module hb_curve_runner
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_attempts, only: attempt_row, attempt_rule_t, attempts_t, make_attempts, stage, technique
   use hb_cancellation, only: cancellation_t, verdict, work_is_over
   use hb_contact_parts, only: contact_parts_t, free_contact_parts
   use hb_curve_jumps, only: curve_jumps_t
   use hb_curve_request, only: curve_request_t
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_level, only: estimate_of
   use hb_model, only: model_t
   use hb_motion_result, only: curve_position_t, motion_result_t
   use hb_movement, only: movement_t, new_movement, set_movement
   use hb_new_curve, only: new_curve_of
   use hb_outcome, only: is_solved, outcome, reason
   use hb_point_kinds, only: curve_kind
   use hb_solution_curve, only: solution_curve_t
   use hb_solver_types, only: attempt_t
   use hb_system, only: system_t
   use hb_text, only: rounded_to, to_text
   use hb_thresholds, only: max_reliable_error
   implicit none
   private
   public :: curve_runner_t

   !> Owns external resources: call `destroy`. A variable of this type needs the attribute `target`.
   type :: curve_runner_t
      type(model_t) :: model                                          !! at the start
      type(curve_request_t) :: request
      logical :: is_done = .false.                                    !! there is no further point
      class(solution_curve_t), allocatable, private :: curve
      type(curve_request_t), private :: part                          ! of the present part, if the curve jumps
      type(curve_jumps_t), private :: jumps
      logical, private :: may_integrate = .true.                      ! of the model, before an attempt has changed it
      logical, private :: has_begun = .false.
      type(contact_parts_t), pointer, private :: contact_parts => null() ! of its systems, owned
      real(wp), private :: last_parameter = 0.0_wp                    ! of the last point
      integer, private :: last_branch = 0                             ! likewise
   contains
      procedure :: prepare => curve_runner_prepare
      procedure :: continue_from => curve_runner_continue_from
      procedure :: is_prepared => curve_runner_is_prepared
      procedure :: lengthen => curve_runner_lengthen
      procedure :: next => curve_runner_next
      procedure :: system_at => curve_runner_system_at
      procedure :: destroy => curve_runner_destroy
   end type curve_runner_t

   !> The attempts to find the first motion of a curve.
   type, extends(attempts_t) :: start_attempts_t
      type(curve_runner_t), pointer :: runner => null()
      type(motion_result_t), pointer :: result => null()
      real(wp) :: start = 0.0_wp                                      ! requested
      logical :: has_choice = .false.                                 ! the curve may begin at the other end of its range
      type(error_t), allocatable :: error
   contains
      procedure :: applies => start_attempts_applies
      procedure :: make => start_attempts_make
      procedure :: is_over => start_attempts_is_over
   end type start_attempts_t

contains

   !> Prepares the curve of the present model and request, which are set before.
   subroutine curve_runner_prepare(self)
      class(curve_runner_t), intent(inout) :: self

      call self%destroy()
      self%part = self%request
      self%may_integrate = self%model%options%may_integrate
      nullify (self%model%system%contact_parts)
      if (allocated(self%model%system%structure%sparse) .and. size(self%model%options%gradient%by) == 0) then ! else condensed
         allocate (self%contact_parts)
         self%model%system%contact_parts => self%contact_parts
      end if
      call new_curve_of(self%curve, self%model%system, self%model%options, self%part)
      call self%jumps%begin(self%request, self%request%start)
      self%is_done = .false.
      self%has_begun = .false.
      self%last_parameter = self%request%start
      self%last_branch = 0
   end subroutine curve_runner_prepare

   !> Restores the state of a prepared curve at the last of its stored points.
   subroutine curve_runner_continue_from(self, stored, error)
      class(curve_runner_t), intent(inout), target :: self
      type(curve_position_t), intent(in) :: stored(:)                 !! all points up to the one to continue from
      type(error_t), allocatable, intent(out) :: error
      integer :: first

      first = 1
      if (self%request%jumps) call self%jumps%restore(self%part, stored, first)
      if (.not. (allocated(self%request%origin) .or. allocated(self%request%over))) &
         call move_start(self, stored(first)%parameter, error)
      if (.not. allocated(error)) &
         call self%curve%continue_from(self%model, self%part, rows_of_part(stored(first:), self%jumps%part), error)
      self%is_done = self%curve%is_done .or. allocated(error)
      self%has_begun = .true.
      self%last_parameter = stored(size(stored))%parameter
      self%last_branch = stored(size(stored))%branch
   end subroutine curve_runner_continue_from

   !> Rows of a part of a curve as those of a curve of its own.
   function rows_of_part(stored, part) result(rows)
      type(curve_position_t), intent(in) :: stored(:)
      integer, intent(in) :: part
      type(curve_position_t), allocatable :: rows(:)

      allocate (rows, source=stored)
      if (part > 0) rows%branch = 0
   end function rows_of_part

   !> Whether there is a curve that may have points.
   pure logical function curve_runner_is_prepared(self) result(is_prepared)
      class(curve_runner_t), intent(in) :: self

      is_prepared = allocated(self%curve)
   end function curve_runner_is_prepared

   !> Continues a curve that has ended at its number of points.
   subroutine curve_runner_lengthen(self, n_points)
      class(curve_runner_t), intent(inout) :: self
      integer, intent(in) :: n_points                                 !! of the whole curve

      self%request%n_points = n_points
      self%part%n_points = n_points - self%jumps%n_before
      call self%curve%lengthen(self%part%n_points)
      self%is_done = self%curve%is_done .and. .not. self%jumps%is_due
   end subroutine curve_runner_lengthen

   !> Returns the next point; with the status `interrupted`, and without an error, if the work ends first. An `error` is a failure
   !> of this point, which its result has as well; it ends the curve.
   subroutine curve_runner_next(self, cancellation, result, error)
      class(curve_runner_t), intent(inout), target :: self
      class(cancellation_t), intent(inout), target :: cancellation
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      type(curve_jumps_t) :: before
      real(wp) :: limit

      before = self%jumps
      limit = self%model%options%solver%time_limit
      if (allocated(self%request%over)) limit = huge(1.0_wp)          ! first a whole curve, limited by point
      call cancellation%enter(limit)
      if (self%jumps%is_due) then
         call jump(self, result, error)
      else if (self%has_begun) then
         call self%curve%next(result, error)
      else
         call begin(self, result, error)
      end if
      call cancellation%leave()
      self%has_begun = .true.
      if (cancellation%verdict == verdict%interrupted) then ! the cause of an apparent error or end may be the interruption
         result%status = outcome%interrupted
         self%jumps = before
         self%is_done = .false.
         if (allocated(error)) deallocate (error)
         return
      end if
      self%is_done = self%curve%is_done .or. allocated(error)
      if (allocated(error)) call result%set_failure(error)
      if (.not. allocated(result%curve)) result%curve = curve_position_t(curve_kind%none, self%last_parameter, &
                                                                      ieee_value(1.0_wp, ieee_quiet_nan), self%last_branch)
      if (self%request%jumps) call note_row(self, result)
      self%last_parameter = result%curve%parameter
      self%last_branch = result%curve%branch
   end subroutine curve_runner_next

   !> The system at the point that was returned last, with the numbers that it has there.
   function curve_runner_system_at(self, result) result(system)
      class(curve_runner_t), intent(inout), target :: self
      type(motion_result_t), intent(in) :: result
      type(system_t), pointer :: system

      system => self%model%system
      if (.not. allocated(result%curve)) return
      if (allocated(result%curve%unknowns)) system => self%curve%system_at(result%curve)
   end function curve_runner_system_at

   !> Notes a row of a curve that jumps: after a fold, and after the last row of a part that has not come to the end of the range,
   !> the curve goes on if there is room for another row.
   subroutine note_row(self, result)
      class(curve_runner_t), intent(inout) :: self
      type(motion_result_t), intent(inout) :: result
      logical :: has_ended, has_room                                  ! the part; otherwise it may be the room that ends it

      if (self%jumps%n_rows == 0) call self%jumps%begin(self%request, result%curve%parameter)
      has_ended = self%is_done .and. (any(result%curve%kind == [curve_kind%end, curve_kind%none]) .or. &
                                      result%reason == reason%grazing)
      call self%jumps%note(result%curve, has_ended)
      has_room = self%jumps%n_rows < self%request%n_points
      if (self%jumps%is_due) self%is_done = .not. has_room
      if (.not. has_room .and. is_solved(result%status)) result%reason = reason%points
   end subroutine note_row

   !> Begins the next part of a curve that jumps. If the work ends first, it begins again in another run.
   subroutine jump(self, result, error)
      class(curve_runner_t), intent(inout), target :: self
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      integer, parameter :: n_digits = 10
      real(wp) :: furthest

      furthest = self%jumps%furthest
      call self%jumps%next_request(self%request%n_points, self%part)
      self%last_parameter = self%part%from
      self%model%options%may_integrate = self%may_integrate
      call move_start(self, self%part%from, error)
      if (.not. allocated(error)) call begin(self, result, error)
      if (allocated(error) .or. .not. is_solved(result%status)) return
      if (.not. allocated(result%message)) result%message = "a jump from "//to_text(rounded_to(furthest, n_digits))
   end subroutine jump

   !> Begins the curve by the attempts of `hb_attempts`: contacts that are closed at one end of the range are often open at the
   !> other; time integration, which takes longer, is the last attempt.
   subroutine begin(self, result, error)
      class(curve_runner_t), intent(inout), target :: self
      type(motion_result_t), intent(out), target :: result
      type(error_t), allocatable, intent(out) :: error
      type(start_attempts_t) :: attempts

      attempts%runner => self
      attempts%result => result
      attempts%start = self%part%start
      associate (request => self%part, model => self%model)
         attempts%has_choice = self%jumps%part == 0 .and. &
            any(abs(request%start - [request%from, request%to]) <= 0.0_wp) .and. .not. &
            (allocated(request%origin) .or. allocated(request%over) .or. any(model%system%tones%is_unknown) .or. &
             model%options%start%from_integration .or. model%system%normal_mode%is_requested .or. &
                model%options%lacks_impacts_of(model%system, outcome%impact))
      end associate
      call make_attempts(attempts, stage%curve)
      result%attempts = attempts%made
      if (allocated(attempts%error)) call move_alloc(attempts%error, error)
   end subroutine begin

   !> Whether an attempt can be made: without a choice the start alone, by all methods.
   logical function start_attempts_applies(self, rule) result(applies)
      class(start_attempts_t), intent(inout) :: self
      type(attempt_rule_t), intent(in) :: rule

      applies = self%has_choice .or. rule%technique == technique%integration
   end function start_attempts_applies

   !> Makes one attempt; a solution with an error too large to be estimated is not accepted.
   subroutine start_attempts_make(self, rule, attempt, within)
      class(start_attempts_t), intent(inout) :: self
      type(attempt_rule_t), intent(in) :: rule
      type(attempt_t), intent(inout) :: attempt
      type(attempt_t), allocatable, intent(out) :: within(:)
      real(wp) :: start

      associate (runner => self%runner, result => self%result)
         associate (request => runner%part)
            start = self%start                                        ! exactly an end: a curve from within is followed both ways
            if (rule%row == attempt_row%other_end) start = merge(request%to, request%from, abs(start - request%from) <= 0.0_wp)
            call move_start(runner, start, self%error)
         end associate
         if (self%has_choice) runner%model%options%may_integrate = rule%technique == technique%integration
         if (.not. allocated(self%error)) call runner%curve%begin(runner%model, runner%part, result, self%error)
         if (allocated(result%attempts)) call move_alloc(result%attempts, within)
         attempt%status = merge(outcome%failed, result%status, allocated(self%error))
         if (allocated(self%error)) return
         attempt%has_succeeded = is_solved(result%status) .and. estimate_of(result) < max_reliable_error
         if (is_solved(result%status) .and. rule%row == attempt_row%other_end .and. (attempt%has_succeeded .or. work_is_over())) &
            result%message = "no motion was found at "//to_text(self%start)//"; the curve begins at the other end of its range"
      end associate
   end subroutine start_attempts_make

   logical function start_attempts_is_over(self) result(is_over)
      class(start_attempts_t), intent(inout) :: self

      is_over = allocated(self%error) .or. work_is_over()
   end function start_attempts_is_over

   !> Moves the start of the curve, before it has begun, to a value.
   subroutine move_start(self, start, error)
      class(curve_runner_t), intent(inout), target :: self
      real(wp), intent(in) :: start
      type(error_t), allocatable, intent(out) :: error
      type(movement_t) :: movement

      if (abs(start - self%part%start) <= 0.0_wp) return
      call self%curve%destroy()
      call new_curve_of(self%curve, self%model%system, self%model%options, self%part)
      self%part%start = start
      call new_movement(movement, self%model, self%part%moving%number, self%part%moving%is_tied, error)
      if (.not. allocated(error)) call set_movement(self%model, movement, start, error)
   end subroutine move_start

   !> Frees the curve; safe to call twice.
   subroutine curve_runner_destroy(self)
      class(curve_runner_t), intent(inout) :: self

      if (.not. allocated(self%curve)) return
      call self%curve%destroy()
      deallocate (self%curve)
      nullify (self%model%system%contact_parts)
      if (associated(self%contact_parts)) call free_contact_parts(self%contact_parts)
   end subroutine curve_runner_destroy
end module hb_curve_runner
