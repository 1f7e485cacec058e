!> What long work asks from step to step, whether it shall end before it is done, and where it tells how far it is.
!>
!> A watch knows the processor time that a point may take. Whoever has other reasons to end a point, such as a signal, extends
!> it and answers `wants_end`; whoever shows progress has `note_progress`. A verdict stays until the next point begins, so that
!> all that is under way ends soon; that the run ends stays for good, so that no later step of the same work hides it.
module hb_watch
   use hb_kinds, only: wp
   implicit none
   private
   public :: verdict, watch_t

   type :: verdict_t
      integer :: go_on = 0
      integer :: timed_out = 1                                        !! the point has had its time
      integer :: interrupted = 2                                      !! the run ends; the point has to be solved again
   end type verdict_t
   type(verdict_t), parameter :: verdict = verdict_t()

   type :: watch_t
      integer :: verdict = verdict%go_on
      logical :: is_patient = .false.                                 !! the time of the point does not count for now
      real(wp), private :: cpu_end = huge(1.0_wp)                     ! processor time at which the point has to end [s]
   contains
      procedure :: begin => watch_begin
      procedure :: is_over => watch_is_over
      procedure :: note_progress => watch_note_progress
      procedure :: wants_end => watch_wants_end
   end type watch_t

contains

   !> Begins a point that may take `time_limit`.
   subroutine watch_begin(self, time_limit)
      class(watch_t), intent(inout) :: self
      real(wp), intent(in) :: time_limit                              !! of the processor [s], huge for any
      real(wp) :: now

      if (self%verdict /= verdict%interrupted) self%verdict = verdict%go_on
      self%is_patient = .false.
      self%cpu_end = huge(1.0_wp)
      if (time_limit >= huge(1.0_wp)) return
      call cpu_time(now)
      self%cpu_end = now + time_limit
   end subroutine watch_begin

   !> Whether the point shall end; `verdict` then says why.
   logical function watch_is_over(self)
      class(watch_t), intent(inout) :: self
      real(wp) :: now

      if (self%verdict == verdict%go_on) then
         if (self%wants_end()) self%verdict = verdict%interrupted
      end if
      if (self%verdict == verdict%go_on .and. self%cpu_end < huge(1.0_wp) .and. .not. self%is_patient) then
         call cpu_time(now)
         if (now >= self%cpu_end) self%verdict = verdict%timed_out
      end if
      watch_is_over = self%verdict /= verdict%go_on
   end function watch_is_over

   !> Hears how far the work is; nobody listens.
   subroutine watch_note_progress(self, n_done, n_steps)
      class(watch_t), intent(inout) :: self
      integer, intent(in) :: n_done, n_steps
   end subroutine watch_note_progress

   !> Whether something else than the point asks for its end; nothing does.
   logical function watch_wants_end(self)
      class(watch_t), intent(inout) :: self

      watch_wants_end = .false.
   end function watch_wants_end
end module hb_watch
