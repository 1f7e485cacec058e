!> Cancellation: ends long work early, and receives reports of its progress.
!>
!> A cancellation token limits the processor time of a point, and the work that is spent, by operation counts. Types
!> that extend it end a point for other reasons, such as a signal (`wants_end`), or show progress (`note_level`,
!> `note_progress`). A decision to end holds until the next point begins, so that all work in progress ends soon; the
!> decision to end the run is final.
!>
!> Between `enter` and `leave` a token is the current one of its thread: each loop that may take long calls `work_is_over` and
!> returns what it has; the procedure that entered the token discards that. A token entered within another also ends with it.
module hb_cancellation
   use, intrinsic :: iso_c_binding, only: c_associated, c_f_pointer, c_loc, c_null_ptr, c_ptr
   use hb_budget, only: budget_t
   use hb_kinds, only: wp
   use hb_threads, only: has_helpers, this_thread
   implicit none
   private
   public :: cancellation_t, note_level, note_progress, shared_work_t, spend_work, verdict, verdict_on_work, work_is_over
   public :: work_of_thread

   type :: verdict_t
      integer :: go_on = 0
      integer :: timed_out = 1                                        !! the point has used its time
      integer :: interrupted = 2                                      !! the run ends; the point must be solved again
      integer :: out_of_work = 3                                      !! more work was spent than permitted
   end type verdict_t
   type(verdict_t), parameter :: verdict = verdict_t()

   type :: slot_t
      class(cancellation_t), pointer :: cancellation => null()
   end type slot_t

   !> The work of a thread, for the threads that help it.
   type :: shared_work_t
      type(c_ptr), private :: current = c_null_ptr                    ! cancellation
   contains
      procedure :: join => shared_work_join
      procedure :: leave => shared_work_leave
   end type shared_work_t

   type :: cancellation_t
      integer :: verdict = verdict%go_on
      type(budget_t) :: budget                                        !! of the work that is spent, see hb_solver_types
      real(wp), private :: cpu_end = huge(1.0_wp)                     ! processor time at which the point has to end [s]
      integer, private :: n_entered = 0
      type(slot_t), private :: slot                                   ! the pointer of the thread
      type(c_ptr), private :: outer = c_null_ptr                      ! the cancellation within which this one was entered
   contains
      procedure :: begin => cancellation_begin
      procedure :: spend => cancellation_spend
      procedure :: enter => cancellation_enter
      procedure :: is_over => cancellation_is_over
      procedure :: leave => cancellation_leave
      procedure :: note_level => cancellation_note_level
      procedure :: note_progress => cancellation_note_progress
      procedure :: wants_end => cancellation_wants_end
   end type cancellation_t

   interface
      !> Source: hb_current_cancellation.h.
      type(c_ptr) function hb_current_cancellation() bind(c, name="hb_current_cancellation")
         import :: c_ptr
      end function hb_current_cancellation

      subroutine hb_set_current_cancellation(cancellation) bind(c, name="hb_set_current_cancellation")
         import :: c_ptr
         type(c_ptr), value :: cancellation
      end subroutine hb_set_current_cancellation
   end interface

contains

   !> Begins a point with a limit of `time_limit`.
   subroutine cancellation_begin(self, time_limit, max_work)
      class(cancellation_t), intent(inout) :: self
      real(wp), intent(in) :: time_limit                              !! processor time [s], huge() for no limit
      real(wp), intent(in), optional :: max_work                    !! of the work that is spent; default none
      real(wp) :: now

      if (self%verdict /= verdict%interrupted) self%verdict = verdict%go_on
      self%budget = budget_t()
      if (present(max_work)) self%budget%limit = max_work
      self%cpu_end = huge(1.0_wp)
      if (time_limit >= huge(1.0_wp)) return
      call cpu_time(now)
      self%cpu_end = now + time_limit
   end subroutine cancellation_begin

   !> Makes this the cancellation of the thread. If it was not entered yet, a point begins; otherwise its clock
   !> continues.
   subroutine cancellation_enter(self, time_limit, max_work)
      class(cancellation_t), intent(inout), target :: self            !! must not move until it is left
      real(wp), intent(in) :: time_limit                              !! as that of `begin`
      real(wp), intent(in), optional :: max_work                    !! likewise

      if (self%n_entered == 0) then
         call self%begin(time_limit, max_work)
         self%slot%cancellation => self
         self%outer = hb_current_cancellation()
         call hb_set_current_cancellation(c_loc(self%slot))
      end if
      self%n_entered = self%n_entered + 1
   end subroutine cancellation_enter

   !> Reverts one `enter`.
   subroutine cancellation_leave(self)
      class(cancellation_t), intent(inout) :: self

      self%n_entered = self%n_entered - 1
      if (self%n_entered > 0) return
      call hb_set_current_cancellation(self%outer)
      self%outer = c_null_ptr
   end subroutine cancellation_leave

   !> Adds work to this cancellation and to those around it.
   recursive subroutine cancellation_spend(self, work)
      class(cancellation_t), intent(inout) :: self
      real(wp), intent(in) :: work
      type(slot_t), pointer :: outer

      if (has_helpers()) then
         !$omp critical(hb_budget)
         call self%budget%spend(work)
         !$omp end critical(hb_budget)
      else
         call self%budget%spend(work)
      end if
      if (.not. c_associated(self%outer)) return
      call c_f_pointer(self%outer, outer)
      call outer%cancellation%spend(work)
   end subroutine cancellation_spend

   !> Whether the point must end; `verdict` then gives the reason.
   recursive logical function cancellation_is_over(self) result(is_over)
      class(cancellation_t), intent(inout) :: self
      type(slot_t), pointer :: outer
      real(wp) :: now

      if (self%verdict == verdict%go_on) then
         if (self%wants_end()) self%verdict = verdict%interrupted
      end if
      if (self%verdict == verdict%go_on .and. c_associated(self%outer)) then
         call c_f_pointer(self%outer, outer)
         if (outer%cancellation%is_over()) self%verdict = outer%cancellation%verdict
      end if
      if (self%verdict == verdict%go_on .and. self%cpu_end < huge(1.0_wp)) then
         call cpu_time(now)
         if (now >= self%cpu_end) self%verdict = verdict%timed_out
      end if
      if (self%verdict == verdict%go_on .and. self%budget%is_exhausted()) self%verdict = verdict%out_of_work
      is_over = self%verdict /= verdict%go_on
   end function cancellation_is_over

   !> Records a level that was solved; here by passing it to the enclosing cancellation.
   recursive subroutine cancellation_note_level(self, level, n_unknowns, estimate)
      class(cancellation_t), intent(inout) :: self
      integer, intent(in) :: level, n_unknowns
      real(wp), intent(in) :: estimate                                !! of the error, relative
      type(slot_t), pointer :: outer

      if (.not. c_associated(self%outer)) return
      call c_f_pointer(self%outer, outer)
      call outer%cancellation%note_level(level, n_unknowns, estimate)
   end subroutine cancellation_note_level

   !> Records the progress of a time integration; here likewise.
   recursive subroutine cancellation_note_progress(self, n_done, n_steps)
      class(cancellation_t), intent(inout) :: self
      integer, intent(in) :: n_done, n_steps
      type(slot_t), pointer :: outer

      if (.not. c_associated(self%outer)) return
      call c_f_pointer(self%outer, outer)
      call outer%cancellation%note_progress(n_done, n_steps)
   end subroutine cancellation_note_progress

   !> Whether an external reason demands the end of the point; never here.
   logical function cancellation_wants_end(self)
      class(cancellation_t), intent(inout) :: self

      cancellation_wants_end = .false.
   end function cancellation_wants_end

   !> Whether the work of this thread must end. Takes a tenth of a microsecond, with a limit on processor time half a
   !> microsecond.
   logical function work_is_over()
      work_is_over = verdict_on_work() /= verdict%go_on
   end function work_is_over

   !> Charges work to the current cancellation of this thread.
   subroutine spend_work(work)
      real(wp), intent(in) :: work                                    !! see hb_solver_types%unit_of_work
      type(c_ptr) :: current
      type(slot_t), pointer :: slot

      current = hb_current_cancellation()
      if (.not. c_associated(current)) return
      call c_f_pointer(current, slot)
      call slot%cancellation%spend(work)
   end subroutine spend_work

   !> Reports a solved level of adaptive refinement to the current cancellation of this thread.
   subroutine note_level(level, n_unknowns, estimate)
      integer, intent(in) :: level, n_unknowns
      real(wp), intent(in) :: estimate                                !! of the error, relative
      type(c_ptr) :: current
      type(slot_t), pointer :: slot

      current = hb_current_cancellation()
      if (.not. c_associated(current)) return
      call c_f_pointer(current, slot)
      call slot%cancellation%note_level(level, n_unknowns, estimate)
   end subroutine note_level

   !> Reports the progress of a time integration to the current cancellation of this thread.
   subroutine note_progress(n_done, n_steps)
      integer, intent(in) :: n_done, n_steps
      type(c_ptr) :: current
      type(slot_t), pointer :: slot

      current = hb_current_cancellation()
      if (.not. c_associated(current)) return
      call c_f_pointer(current, slot)
      call slot%cancellation%note_progress(n_done, n_steps)
   end subroutine note_progress

   !> The work of this thread, before others help it.
   type(shared_work_t) function work_of_thread() result(work)
      work%current = hb_current_cancellation()
   end function work_of_thread

   !> Makes this thread, which helps another one, charge what it does to the work of the other.
   subroutine shared_work_join(self)
      class(shared_work_t), intent(in) :: self

      call hb_set_current_cancellation(self%current)
   end subroutine shared_work_join

   !> Ends that; the thread that was helped goes on with its own work.
   subroutine shared_work_leave(self)
      class(shared_work_t), intent(in) :: self

      if (this_thread() > 1) call hb_set_current_cancellation(c_null_ptr)
   end subroutine shared_work_leave

   !> Why the work of this thread must end; `go_on` if it need not, or if there is no cancellation. A thread that helps another one
   !> does not decide: it sees what the other has found.
   integer function verdict_on_work() result(found)
      type(c_ptr) :: current
      type(slot_t), pointer :: slot

      found = verdict%go_on
      current = hb_current_cancellation()
      if (.not. c_associated(current)) return
      call c_f_pointer(current, slot)
      if (this_thread() > 1) then
         found = slot%cancellation%verdict
      else if (slot%cancellation%is_over()) then
         found = slot%cancellation%verdict
      end if
   end function verdict_on_work
end module hb_cancellation
