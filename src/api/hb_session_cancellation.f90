!> Ends the work of a session when the program requests it, and reports its progress to the program (nhbm.h).
module hb_session_cancellation
   use, intrinsic :: iso_c_binding, only: c_associated, c_double, c_f_procpointer, c_funptr, c_int, c_int64_t, &
      c_null_funptr, c_null_ptr, c_ptr
   use hb_cancellation, only: cancellation_t, verdict
   use hb_clock, only: wall_clock
   use hb_kinds, only: wp
   implicit none
   private
   public :: session_cancellation_t

   !> struct nhbm_progress.
   type, bind(c) :: progress_t
      real(c_double) :: seconds = 0.0_c_double
      integer(c_int64_t) :: n_done = 0_c_int64_t, n_steps = 0_c_int64_t
   end type progress_t

   !> Ends the present work if requested, and reports its progress.
   type, extends(cancellation_t) :: session_cancellation_t
      type(c_funptr) :: interrupt = c_null_funptr                     !! nhbm_interrupt_callback; null: none
      type(c_ptr) :: interrupt_context = c_null_ptr
      type(c_funptr) :: report = c_null_funptr                        !! nhbm_progress_callback; null: none
      type(c_ptr) :: report_context = c_null_ptr
      type(progress_t), private :: progress
      real(wp), private :: began = 0.0_wp                             ! [s]
      real(wp), private :: requested = -huge(1.0_wp)                  ! [s] time of the last call
   contains
      procedure :: begin_work => session_cancellation_begin_work
      procedure :: note_progress => session_cancellation_note_progress
      procedure :: wants_end => session_cancellation_wants_end
   end type session_cancellation_t

   abstract interface
      integer(c_int) function interrupt_callback(context) bind(c)
         import :: c_int, c_ptr
         type(c_ptr), value :: context
      end function interrupt_callback

      subroutine report_progress(context, progress) bind(c)
         import :: c_ptr, progress_t
         type(c_ptr), value :: context
         type(progress_t), intent(in) :: progress
      end subroutine report_progress
   end interface

contains

   !> Begins work that the program can end. An earlier end does not affect it.
   subroutine session_cancellation_begin_work(self)
      class(session_cancellation_t), intent(inout) :: self

      self%verdict = verdict%go_on
      self%progress = progress_t()
      self%began = wall_clock()
   end subroutine session_cancellation_begin_work

   recursive subroutine session_cancellation_note_progress(self, n_done, n_steps)
      class(session_cancellation_t), intent(inout) :: self
      integer, intent(in) :: n_done, n_steps

      self%progress%n_done = int(n_done, c_int64_t)
      self%progress%n_steps = int(n_steps, c_int64_t)
   end subroutine session_cancellation_note_progress

   !> Calls the program every twentieth of a second, at negligible cost.
   logical function session_cancellation_wants_end(self) result(wants)
      class(session_cancellation_t), intent(inout) :: self
      real(wp), parameter :: check_interval = 0.05_wp
      procedure(interrupt_callback), pointer :: interrupt
      procedure(report_progress), pointer :: report
      real(wp) :: now

      wants = .false.
      if (.not. (c_associated(self%interrupt) .or. c_associated(self%report))) return
      now = wall_clock()
      if (now - self%requested < check_interval) return
      self%requested = now
      if (c_associated(self%report)) then
         self%progress%seconds = now - self%began
         call c_f_procpointer(self%report, report)
         call report(self%report_context, self%progress)
      end if
      if (.not. c_associated(self%interrupt)) return
      call c_f_procpointer(self%interrupt, interrupt)
      wants = interrupt(self%interrupt_context) /= 0
   end function session_cancellation_wants_end
end module hb_session_cancellation
