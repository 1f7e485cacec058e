!> Progress of a run: one line that is rewritten on a terminal, a plain line now and then in a log.
module hb_progress
   use, intrinsic :: iso_fortran_env, only: error_unit
   use hb_kinds, only: wp
   use hb_mpi, only: wall_clock
   use hb_system, only: is_terminal
   use hb_text, only: to_text
   implicit none
   private
   public :: new_progress, progress_t

   integer, parameter :: bar_width = 30
   real(wp), parameter :: terminal_interval = 0.2_wp                  ! [s] between two lines
   real(wp), parameter :: log_interval = 10.0_wp                      ! [s]

   type :: progress_t
      logical, private :: is_quiet = .false.
      logical, private :: on_terminal = .false.
      integer, private :: n_points = 0
      character(:), allocatable, private :: noun                      !! what is counted
      real(wp), private :: started = 0.0_wp, shown = 0.0_wp
   contains
      procedure :: show => progress_show
      procedure :: finish => progress_finish
   end type progress_t

contains

   !> Progress over `n_points`, written to standard error; nothing is written when `is_quiet`.
   subroutine new_progress(self, n_points, is_quiet, noun)
      type(progress_t), intent(out) :: self
      integer, intent(in) :: n_points
      logical, intent(in) :: is_quiet
      character(*), intent(in), optional :: noun                      !! what is counted, if not points

      self%noun = "points"
      if (present(noun)) self%noun = noun
      self%n_points = n_points
      self%is_quiet = is_quiet
      self%on_terminal = is_terminal()
      self%started = wall_clock()
      self%shown = self%started
   end subroutine new_progress

   !> Says how far the run is, if the last line is old enough.
   subroutine progress_show(self, done, failed)
      class(progress_t), intent(inout) :: self
      integer, intent(in) :: done, failed                             !! points, over all ranks
      real(wp) :: now

      if (self%is_quiet) return
      now = wall_clock()
      if (now - self%shown < merge(terminal_interval, log_interval, self%on_terminal)) return
      self%shown = now
      call write_line(self, done, failed, now)
   end subroutine progress_show

   !> Says the final state, and ends the line on a terminal.
   subroutine progress_finish(self, done, failed)
      class(progress_t), intent(inout) :: self
      integer, intent(in) :: done, failed

      if (self%is_quiet) return
      call write_line(self, done, failed, wall_clock())
      if (self%on_terminal) write (error_unit, "()")
   end subroutine progress_finish

   subroutine write_line(self, done, failed, now)
      class(progress_t), intent(in) :: self
      integer, intent(in) :: done, failed
      real(wp), intent(in) :: now
      character(:), allocatable :: line
      real(wp) :: seconds
      integer :: filled

      seconds = max(now - self%started, epsilon(1.0_wp))
      line = to_text(done)//"/"//to_text(self%n_points)//" "//self%noun
      if (failed > 0) line = line//", "//to_text(failed)//" not converged"
      line = line//", "//rate_text(done/seconds)//" per s"
      if (done > 0 .and. done < self%n_points) then
         line = line//", "//time_text(seconds*(self%n_points - done)/done)//" left"
      else
         line = line//", "//time_text(seconds)
      end if
      if (self%on_terminal) then
         filled = nint(bar_width*real(done, wp)/max(self%n_points, 1))
         line = "["//repeat("#", filled)//repeat(".", bar_width - filled)//"] "//line
         write (error_unit, "(a)", advance="no") achar(13)//line//achar(27)//"[K"
         flush (error_unit)
      else
         write (error_unit, "(a)") line
      end if
   end subroutine write_line

   !> Three significant digits.
   function rate_text(rate) result(text)
      real(wp), intent(in) :: rate
      character(:), allocatable :: text
      character(17) :: buffer

      if (rate >= 100.0_wp) then
         write (buffer, "(i0)") nint(min(rate, 1.0e9_wp))
      else
         write (buffer, "(f0.2)") rate
         if (buffer(1:1) == ".") buffer = "0"//buffer(1:16)
      end if
      text = trim(buffer)
   end function rate_text

   !> Seconds as 12.3 s, 4 min 05 s or 3 h 20 min.
   function time_text(seconds) result(text)
      real(wp), intent(in) :: seconds
      character(:), allocatable :: text
      character(32) :: buffer
      integer :: whole

      whole = nint(min(seconds, 1.0e9_wp))
      if (seconds < 60.0_wp) then
         write (buffer, "(f5.1, a)") seconds, " s"
      else if (whole < 3600) then
         write (buffer, "(i0, a, i2.2, a)") whole/60, " min ", modulo(whole, 60), " s"
      else
         write (buffer, "(i0, a, i2.2, a)") whole/3600, " h ", modulo(whole/60, 60), " min"
      end if
      text = trim(adjustl(buffer))
   end function time_text
end module hb_progress
