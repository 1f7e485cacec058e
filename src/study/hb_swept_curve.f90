!> One curve of a run: its first model is read and its start solved, or the state at the end of a previous run is
!> restored from the file; then its points are returned one by one, in the form of the file.
module hb_swept_curve
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_attempts, only: attempts_t, make_attempts
   use hb_cancellation, only: cancellation_t, verdict, work_is_over
   use hb_clock, only: wall_clock
   use hb_curve_request, only: curve_kind, curve_request_t
   use hb_document, only: document_t
   use hb_error, only: error_t
   use hb_idle_laws, only: idle_laws_t
   use hb_impact_curve, only: new_curve_of
   use hb_kinds, only: wp
   use hb_law_doubt, only: law_doubt_t
   use hb_level, only: estimate_of
   use hb_model, only: model_t
   use hb_model_reader, only: update_model
   use hb_motion_curve, only: is_unreliable, motion_curve_t
   use hb_motion_result, only: curve_position_t, motion_result_t
   use hb_movement, only: movement_t, new_movement, set_movement
   use hb_outcome, only: is_solved, outcome, reason
   use hb_point_source, only: point_source_t
   use hb_results, only: results_layout_t, results_t
   use hb_solver_types, only: attempt_rule_t, attempt_t, set_choice, stage, technique
   use hb_stored_origin, only: request_curve
   use hb_swept_point, only: check_layout, spread_result
   use hb_text, only: to_text
   use hb_thresholds, only: reliable
   implicit none
   private
   public :: new_swept_curve, swept_curve_t

   !> Owns external resources: call `destroy`. A variable of this type needs the attribute `target`.
   type :: swept_curve_t
      integer, allocatable :: stored(:) !! statuses of the points in the file after which it continues
      logical :: is_done = .false.                                    !! there is no further point
      type(law_doubt_t) :: law_doubt                                  !! at the first point
      type(idle_laws_t) :: idle_laws                                  !! in all points
      class(motion_curve_t), allocatable, private :: curve
      type(curve_request_t), private :: request
      type(model_t), private :: model
      real(wp), private :: last_parameter = 0.0_wp
      integer, private :: last_branch = 0
      logical, private :: has_begun = .false.
   contains
      procedure :: next => swept_curve_next
      procedure :: destroy => swept_curve_destroy
   end type swept_curve_t

   !> The attempts to find the first motion of a curve.
   type, extends(attempts_t) :: start_attempts_t
      type(swept_curve_t), pointer :: curve => null()
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

   !> Reads the model at the start of the curve with a given first point. An `error` is one of the file; an error of
   !> the curve becomes the status of its first point.
   subroutine new_swept_curve(self, source, results, first, is_resumed, failure, error)
      type(swept_curve_t), intent(inout), target :: self
      type(point_source_t), intent(in) :: source
      type(results_t), intent(inout) :: results
      integer, intent(in) :: first                                    !! point, from 1
      logical, intent(in) :: is_resumed                               !! the file may contain points of the curve
      type(error_t), allocatable, intent(out) :: failure              !! of the curve
      type(error_t), allocatable, intent(out) :: error
      type(curve_position_t), allocatable :: positions(:)
      integer, allocatable :: status(:)
      real(wp), allocatable :: estimates(:)
      type(document_t), target :: document
      integer :: last
      logical :: is_new

      document = source%document
      call source%plan%apply(first, document)
      call update_model(self%model, document, is_new, failure, source%available_memory, source%callbacks)
      if (.not. allocated(failure)) call check_layout(self%model%system, self%model%options, source%layout, failure)
      if (.not. allocated(failure)) call request_curve(source%plan%curve, self%model, document, self%request, failure)
      allocate (self%stored(0))
      call new_curve_of(self%curve, self%model%system, self%model%options, self%request)
      self%is_done = allocated(failure)
      self%last_parameter = source%plan%curve%start
      if (self%is_done .or. .not. is_resumed) return
      allocate (positions(source%plan%curve%n_points), status(source%plan%curve%n_points), &
                estimates(source%plan%curve%n_points))
      call results%read_curve(first, status, positions, estimates, error)
      if (allocated(error)) return
      last = last_step(status, positions%kind)
      if (last == 0) return
      if (.not. (allocated(self%request%origin) .or. allocated(self%request%over))) &
         call go_to(self, positions(1)%parameter, failure)
      if (.not. allocated(failure)) &
         call self%curve%continue_from(self%model, self%request, positions(:last), failure)
      self%curve%n_unreliable = n_unreliable(positions(:last), estimates(:last))
      self%is_done = self%curve%is_done .or. allocated(failure)
      self%has_begun = .true.
      self%stored = status(:last)
      self%last_parameter = positions(last)%parameter
      self%last_branch = positions(last)%branch
   end subroutine new_swept_curve

   !> Number of the last steps of the last branch whose estimated errors have no meaning.
   pure integer function n_unreliable(positions, estimates) result(n)
      type(curve_position_t), intent(in) :: positions(:)
      real(wp), intent(in) :: estimates(:)                            !! of the errors there
      integer :: i

      n = 0
      do i = 1, size(positions)
         if (positions(i)%kind == curve_kind%start) n = 0
         if (positions(i)%kind == curve_kind%regular) n = merge(n + 1, 0, is_unreliable(estimates(i)))
      end do
   end function n_unreliable

   !> The last of the stored points from which a curve can continue, without gaps before it; 0: none.
   pure integer function last_step(status, kind) result(last)
      integer, intent(in) :: status(:), kind(:)                       !! of all points of the curve
      integer :: i

      last = 0
      do i = 1, size(status)
         if (kind(i) == curve_kind%none .or. status(i) == outcome%pending .or. .not. (is_solved(status(i)) .or. i == 1)) exit
         if (any(kind(i) == [curve_kind%regular, curve_kind%start])) last = i
      end do
      if (all(status /= outcome%pending) .and. all(is_solved(status) .or. status == outcome%unused)) last = 0   ! rows are damaged
   end function last_step

   !> Returns the next point; `interrupted` if the run ends first.
   subroutine swept_curve_next(self, layout, rank, result)
      class(swept_curve_t), intent(inout), target :: self
      type(results_layout_t), intent(in) :: layout
      integer, intent(in) :: rank
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable :: error
      type(cancellation_t), target :: cancellation
      real(wp) :: limit, started

      started = wall_clock()
      limit = self%model%options%solver%time_limit
      if (allocated(self%request%over)) limit = huge(1.0_wp)          ! first a whole curve, limited by point
      call cancellation%enter(limit)
      if (self%has_begun) then
         call self%curve%next(result, error)
      else
         call begin(self, result, error)
      end if
      self%has_begun = .true.
      call cancellation%leave()
      if (cancellation%verdict == verdict%interrupted) then ! the cause of an apparent error or end may be the interruption
         result%status = outcome%interrupted
         self%is_done = .false.
         return
      end if
      self%is_done = self%curve%is_done
      if (allocated(error)) then
         result%status = outcome%failed
         result%reason = reason%error
         result%message = error%message
         self%is_done = .true.
      else
         call self%law_doubt%examine(self%model%system, self%model%discretisation, result)
         call self%idle_laws%examine(self%model%system, self%model%discretisation, result)
         if (.not. layout%has_own_tuples) call spread_result(self%model%discretisation%harmonics, layout, result)
      end if
      if (.not. allocated(result%curve)) result%curve = curve_position_t(curve_kind%none, self%last_parameter, &
                                                                      ieee_value(1.0_wp, ieee_quiet_nan), self%last_branch)
      self%last_parameter = result%curve%parameter
      self%last_branch = result%curve%branch
      result%rank = rank
      result%solve_seconds = wall_clock() - started
   end subroutine swept_curve_next

   !> Begins the curve by the attempts of `hb_attempts`: contacts that are closed at one end of the range are often open at the
   !> other; time integration, which takes longer, is the last attempt.
   subroutine begin(self, result, error)
      class(swept_curve_t), intent(inout), target :: self
      type(motion_result_t), intent(out), target :: result
      type(error_t), allocatable, intent(out) :: error
      type(start_attempts_t) :: attempts

      attempts%curve => self
      attempts%result => result
      attempts%start = self%request%start
      associate (request => self%request, model => self%model)
         attempts%has_choice = any(abs(request%start - [request%from, request%to]) <= 0.0_wp) .and. .not. &
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

      associate (curve => self%curve, result => self%result)
         associate (request => curve%request)
            call go_to(curve, merge(request%from + request%to - self%start, self%start, &
                                    rule%discretisation == set_choice%other_end), self%error)
         end associate
         if (self%has_choice) curve%model%options%may_integrate = rule%technique == technique%integration
         if (.not. allocated(self%error)) call curve%curve%begin(curve%model, curve%request, result, self%error)
         if (allocated(result%attempts)) call move_alloc(result%attempts, within)
         attempt%status = merge(outcome%failed, result%status, allocated(self%error))
         if (allocated(self%error)) return
         attempt%has_succeeded = is_solved(result%status) .and. estimate_of(result) < reliable
         if (is_solved(result%status) .and. rule%discretisation == set_choice%other_end .and. &
             (attempt%has_succeeded .or. work_is_over())) &
            result%message = "no motion was found at "//to_text(self%start)//"; the curve begins at the other end of its range"
      end associate
   end subroutine start_attempts_make

   logical function start_attempts_is_over(self) result(is_over)
      class(start_attempts_t), intent(inout) :: self

      is_over = allocated(self%error) .or. work_is_over()
   end function start_attempts_is_over

   !> Moves the start of the curve, before it has begun, to a value.
   subroutine go_to(self, start, error)
      class(swept_curve_t), intent(inout), target :: self
      real(wp), intent(in) :: start
      type(error_t), allocatable, intent(out) :: error
      type(movement_t) :: movement

      if (abs(start - self%request%start) <= 0.0_wp) return
      call self%curve%destroy()
      call new_curve_of(self%curve, self%model%system, self%model%options, self%request)
      self%request%start = start
      call new_movement(movement, self%model, self%request%moving%number, self%request%moving%is_tied, error)
      if (.not. allocated(error)) call set_movement(self%model, movement, start, error)
   end subroutine go_to

   !> Frees the curve; safe to call twice.
   subroutine swept_curve_destroy(self)
      class(swept_curve_t), intent(inout) :: self

      if (allocated(self%curve)) call self%curve%destroy()
   end subroutine swept_curve_destroy
end module hb_swept_curve
