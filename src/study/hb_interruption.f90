!> Whether a run must end early: a signal, a limit on its time, or another rank that ends.
!> This is checked before each point, and within a point by the solvers through a cancellation. A point that is
!> interrupted remains pending, and a later run solves it from its beginning: no number depends on when a run ends.
module hb_interruption
   use hb_cancellation, only: cancellation_t
   use hb_clock, only: wall_clock
   use hb_error, only: annotate, error_t
   use hb_kinds, only: wp
   use hb_mpi, only: comm_t, new_work_counter, size_of, work_counter_t
   use hb_signals, only: signal_caught
   implicit none
   private
   public :: interruption, interruption_t, new_interruption

   !> Reasons not to begin another point; of two ranks, the one with the larger number is reported.
   type :: reason_t
      integer :: none = 0
      integer :: other_rank = 1                                       !! another rank has its reason
      integer :: time_limit = 2
      integer :: signal = 3
   end type reason_t

   type(reason_t), parameter :: interruption = reason_t()

   ! The flag is in the memory of one rank; this limits how often all other ranks together read it, and each rank
   ! reads it at most as often as a delay is perceptible.
   real(wp), parameter :: checks_per_second = 1.0e5_wp, shortest_interval = 0.01_wp

   type, extends(cancellation_t) :: interruption_t
      integer :: reason = interruption%none
      real(wp), private :: started = 0.0_wp
      real(wp), private :: time_limit = huge(1.0_wp)                  !! [s] from the start
      real(wp), private :: longest = 0.0_wp                           !! [s] of the points of this rank so far
      type(work_counter_t), private :: flag                           !! more than 0 points are done: all ranks must stop
      real(wp), private :: last_check = -huge(1.0_wp)                 !! [s] time of the last check by this rank
      real(wp), private :: interval = shortest_interval               !! [s] between two checks
   contains
      procedure :: request_stop => interruption_request_stop
      procedure :: destroy => interruption_destroy
      procedure :: is_due => interruption_is_due
      procedure :: note_point => interruption_note_point
      procedure :: wants_end => interruption_wants_end
   end type interruption_t

contains

   !> Starts the clock of a run with a `time_limit`; collective, as is `destroy`.
   subroutine new_interruption(self, time_limit, comm, error)
      type(interruption_t), intent(out) :: self
      real(wp), intent(in) :: time_limit                              !! [s], huge for none
      type(comm_t), intent(in) :: comm
      type(error_t), allocatable, intent(out) :: error

      call new_work_counter(self%flag, [0], comm, error)
      call annotate(error, "MPI cannot make a flag that all ranks share")
      self%started = wall_clock()
      self%time_limit = time_limit
      self%interval = max(shortest_interval, size_of(comm)/checks_per_second)
   end subroutine new_interruption

   !> Records the duration of a point.
   pure subroutine interruption_note_point(self, seconds)
      class(interruption_t), intent(inout) :: self
      real(wp), intent(in) :: seconds

      self%longest = max(self%longest, seconds)
   end subroutine interruption_note_point

   !> Whether no further point may be begun. A point is not begun if it would exceed the time limit when it took as
   !> long as the longest so far. A signal to one rank stops all ranks; each rank observes the time limit by itself,
   !> since their points differ.
   logical function interruption_is_due(self) result(is_due)
      class(interruption_t), intent(inout) :: self

      call check_reasons(self, self%longest)
      is_due = self%reason /= interruption%none
   end function interruption_is_due

   !> Whether the present point must end.
   logical function interruption_wants_end(self)
      class(interruption_t), intent(inout) :: self

      call check_reasons(self, 0.0_wp)
      interruption_wants_end = self%reason /= interruption%none
   end function interruption_wants_end

   !> Checks for a reason to end, given the expected duration of the remaining work.
   subroutine check_reasons(self, seconds)
      class(interruption_t), intent(inout) :: self
      real(wp), intent(in) :: seconds
      real(wp) :: now

      now = wall_clock()
      if (signal_caught()) then
         if (self%reason /= interruption%signal) call self%request_stop()
         self%reason = interruption%signal
      else if (now - self%started + seconds >= self%time_limit) then
         self%reason = interruption%time_limit
      else if (now - self%last_check >= self%interval) then
         self%last_check = now
         if (self%flag%n_done(1) > 0) self%reason = interruption%other_rank
      end if
   end subroutine check_reasons

   !> Requests that no rank begins another point.
   subroutine interruption_request_stop(self)
      class(interruption_t), intent(in) :: self

      if (self%flag%n_done(1) == 0) call self%flag%add_done(1, 1, 0)
   end subroutine interruption_request_stop

   !> Frees the shared memory of the ranks; collective, safe to call twice.
   subroutine interruption_destroy(self)
      class(interruption_t), intent(inout) :: self

      call self%flag%destroy()
   end subroutine interruption_destroy
end module hb_interruption
