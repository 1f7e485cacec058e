!> Progress of a run: one line that is rewritten on a terminal, occasional lines in a log, depending on the log level.
module hb_progress
   use, intrinsic :: iso_fortran_env, only: error_unit
   use hb_clock, only: wall_clock
   use hb_kinds, only: wp
   use hb_operating_system, only: is_terminal
   use hb_printable, only: printable
   use hb_text, only: to_text
   implicit none
   private
   public :: log_level, log_level_names, new_progress, progress_t

   !> Amount of output of a run; each level includes the previous ones.
   type :: log_level_t
      integer :: quiet = 0                                            !! errors only
      integer :: normal = 1                                           !! progress, summary, warnings
      integer :: verbose = 2                                          !! the time of each rank by activity
      integer :: debug = 3                                            !! a line for each point, from the rank that solved it
   end type log_level_t
   type(log_level_t), parameter :: log_level = log_level_t()
   character(7), parameter :: log_level_names(0:3) = [character(7) :: "quiet", "normal", "verbose", "debug"]

   integer, parameter :: bar_width = 30
   real(wp), parameter :: terminal_interval = 0.2_wp                  ! [s] between two lines
   real(wp), parameter :: log_interval = 10.0_wp                      ! [s], of the first; then increasingly longer
   real(wp), parameter :: log_growth = 1.5_wp, longest_log_interval = 600.0_wp
   real(wp), parameter :: tally_interval = 0.2_wp                     ! [s] between two messages of a rank to the others

   type :: progress_t
      logical :: is_debug = .false.                                   !! points are reported
      logical, private :: is_shown = .false.
      logical, private :: on_terminal = .false.
      integer, private :: n_points = 0
      character(:), allocatable, private :: what                      ! name of the items that are counted
      character(:), allocatable, private :: place                     ! where the last of them is, if it tells how far the run is
      real(wp), private :: started_at                                 ! wall clock [s]
      real(wp), private :: shown_at                                   ! wall clock [s] of the last line
      real(wp), private :: interval = log_interval                    ! [s] to the next line
      integer, private :: done = 0, failed = 0                        ! points of this rank that are not reported yet
      integer, private :: shown_done = 0, shown_failed = 0            ! in the last line
      logical, private :: ends_log = .false.                          ! the last line is one of a log, about whole points only
      real(wp), private :: reported_at = 0.0_wp                       ! wall clock [s] of the last message to the other ranks
   contains
      procedure :: note => progress_note
      procedure :: note_place => progress_note_place
      procedure :: report => progress_report
      procedure :: is_due => progress_is_due
      procedure :: report_point => progress_report_point
      procedure :: show => progress_show
      procedure :: finish => progress_finish
      procedure :: say => progress_say
   end type progress_t

contains

   !> Creates the progress over `n_points`, written to standard error by one rank of a run.
   subroutine new_progress(self, n_points, level, is_first, what)
      type(progress_t), intent(out) :: self
      integer, intent(in) :: n_points                                 !! 0: unknown
      integer, intent(in) :: level                                    !! one of log_level
      logical, intent(in) :: is_first                                 !! this rank writes the line
      character(*), intent(in), optional :: what                      !! name of the items; default: points

      self%what = "points"
      if (present(what)) self%what = what
      self%n_points = n_points
      self%is_shown = is_first .and. level >= log_level%normal
      self%is_debug = level >= log_level%debug
      self%on_terminal = is_terminal()
      self%started_at = wall_clock()
      self%shown_at = self%started_at
      if (self%on_terminal) self%interval = terminal_interval
   end subroutine new_progress

   !> Counts a point that this rank has solved; `is_report_due` is true if the other ranks should be informed.
   subroutine progress_note(self, has_failed, is_report_due)
      class(progress_t), intent(inout) :: self
      logical, intent(in) :: has_failed
      logical, intent(out) :: is_report_due

      self%done = self%done + 1
      if (has_failed) self%failed = self%failed + 1
      is_report_due = wall_clock() - self%reported_at >= tally_interval
   end subroutine progress_note

   !> Notes where the last point is, for the next line.
   subroutine progress_note_place(self, place)
      class(progress_t), intent(inout) :: self
      character(*), intent(in) :: place

      self%place = place
   end subroutine progress_note_place

   !> Returns the points counted since the last call.
   subroutine progress_report(self, done, failed)
      class(progress_t), intent(inout) :: self
      integer, intent(out) :: done, failed

      done = self%done
      failed = self%failed
      self%done = 0
      self%failed = 0
      self%reported_at = wall_clock()
   end subroutine progress_report

   !> Whether the next line is due.
   logical function progress_is_due(self)
      class(progress_t), intent(in) :: self

      progress_is_due = .false.
      if (self%is_shown) progress_is_due = wall_clock() - self%shown_at >= self%interval
   end function progress_is_due

   !> Writes the progress of the run.
   subroutine progress_show(self, done, failed, within, share)
      class(progress_t), intent(inout) :: self
      integer, intent(in) :: done, failed                             !! points, over all ranks
      character(*), intent(in), optional :: within                    !! what the rank does within a point
      real(wp), intent(in), optional :: share                         !! of that point which is done; 0 if not given

      if (.not. self%is_shown) return
      self%shown_at = wall_clock()
      if (.not. self%on_terminal) self%interval = min(log_growth*self%interval, longest_log_interval)
      self%shown_done = done
      self%shown_failed = failed
      self%ends_log = .not. (self%on_terminal .or. present(within))
      call write_line(self, done, failed, self%shown_at, within, share)
   end subroutine progress_show

   !> Writes the outcome of one point, at level debug, on the rank that solved it.
   subroutine progress_report_point(self, text)
      class(progress_t), intent(in) :: self
      character(*), intent(in) :: text

      if (.not. self%is_debug) return
      write (error_unit, "(a)") printable(text)
      flush (error_unit)
   end subroutine progress_report_point

   !> Writes the final state, unless it is the last line of a log, and ends the line on a terminal.
   subroutine progress_finish(self, done, failed)
      class(progress_t), intent(inout) :: self
      integer, intent(in) :: done, failed

      if (.not. self%is_shown) return
      if (.not. (self%ends_log .and. done == self%shown_done .and. failed == self%shown_failed)) &
         call write_line(self, done, failed, wall_clock())
      if (self%on_terminal) write (error_unit, "()")
   end subroutine progress_finish

   !> Writes a line about the run as a whole.
   subroutine progress_say(self, text)
      class(progress_t), intent(in) :: self
      character(*), intent(in) :: text

      if (self%is_shown) write (error_unit, "(a)") printable(text)
   end subroutine progress_say

   subroutine write_line(self, done, failed, now, within, share)
      class(progress_t), intent(in) :: self
      integer, intent(in) :: done, failed
      real(wp), intent(in) :: now
      character(*), intent(in), optional :: within                    !! of a point
      real(wp), intent(in), optional :: share
      character(:), allocatable :: line
      real(wp) :: reached, seconds
      integer :: filled

      seconds = max(now - self%started_at, epsilon(1.0_wp))
      reached = done
      if (present(share)) reached = done + share
      line = to_text(done)
      if (self%n_points > 0) line = line//"/"//to_text(self%n_points)
      line = line//" "//self%what
      if (failed > 0) line = line//", "//to_text(failed)//" not converged"
      line = line//", "//rate_text(done/seconds)//" per s"
      if (reached > 0.0_wp .and. done < self%n_points) then
         line = line//", "//time_text(seconds*(self%n_points - reached)/reached)//" left"
      else
         line = line//", "//time_text(seconds)
      end if
      if (allocated(self%place)) line = line//"; "//self%place
      if (present(within)) line = line//"; "//within
      if (self%on_terminal) then
         filled = nint(bar_width*real(done, wp)/max(self%n_points, 1))
         if (self%n_points > 0) line = "["//repeat("#", filled)//repeat(".", bar_width - filled)//"] "//line
         write (error_unit, "(a)", advance="no") achar(13)//line//achar(27)//"[K"
      else
         write (error_unit, "(a)") line
      end if
      flush (error_unit)                                              ! a file or a pipe is read while the run goes on
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
