!> Signals by which a user or a batch system ends a run: SIGINT, SIGTERM, SIGUSR1, SIGUSR2.
!>
!> Before there are points, a signal ends the process at once. Afterwards the handler of the first one only sets a
!> flag, which `signal_caught` reads between two points; a second one ends the process. Source of the interface:
!> hb_process.h.
module hb_signals
   use, intrinsic :: iso_c_binding, only: c_char, c_double, c_int, c_null_char, c_ptr
   use hb_c_text, only: c_text
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   implicit none
   private
   public :: catch_signals, note_unfinished, signal_caught, signal_name, survive_failed_writes, wait_for_points

   interface
      integer(c_int) function hb_catch_signals(text, exit_status, pause) bind(c, name="hb_catch_signals")
         import :: c_char, c_double, c_int
         character(c_char), intent(in) :: text(*)
         integer(c_int), value :: exit_status
         real(c_double), value :: pause
      end function hb_catch_signals

      !> From now on the first signal only sets a flag; before, it ends the process at once.
      subroutine wait_for_points() bind(c, name="hb_wait_for_points")
      end subroutine wait_for_points

      !> Makes a write fail, instead of ending the process, if the reader has closed the pipe or a limit on the size
      !> of files is reached.
      subroutine survive_failed_writes() bind(c, name="hb_survive_failed_writes")
      end subroutine survive_failed_writes

      subroutine hb_note_unfinished(path) bind(c, name="hb_note_unfinished")
         import :: c_char
         character(c_char), intent(in) :: path(*)
      end subroutine hb_note_unfinished

      integer(c_int) function hb_caught_signal() bind(c, name="hb_caught_signal")
         import :: c_int
      end function hb_caught_signal

      type(c_ptr) function hb_caught_signal_name() bind(c, name="hb_caught_signal_name")
         import :: c_ptr
      end function hb_caught_signal_name
   end interface

contains

   !> Catches signals from now on; one that ends the process does so with `exit_status`, and a second one also writes
   !> `text` as a line to standard error, cut to 1000 bytes. With `pause`, signals that follow each other within this time
   !> count as one: a process may receive the same signal from a terminal or batch system and from another process.
   subroutine catch_signals(text, exit_status, error, pause)
      character(*), intent(in) :: text
      integer, intent(in) :: exit_status
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: pause          !! [s], default 0
      real(c_double) :: shortest

      shortest = 0.0_c_double
      if (present(pause)) shortest = real(pause, c_double)
      if (hb_catch_signals(text(:min(len(text), 1000))//new_line("a")//c_null_char, int(exit_status, c_int), shortest) /= 0) &
         call fail(error, "cannot catch signals")
   end subroutine catch_signals

   !> Names a temporary file that a signal which ends the process removes; an empty name once it is complete.
   subroutine note_unfinished(path)
      character(*), intent(in) :: path

      call hb_note_unfinished(path//c_null_char)
   end subroutine note_unfinished

   !> Whether a signal has requested the end of this process.
   logical function signal_caught()
      signal_caught = hb_caught_signal() /= 0
   end function signal_caught

   !> Name of the first signal caught, such as SIGTERM; `no signal` before.
   function signal_name() result(name)
      character(:), allocatable :: name

      name = c_text(hb_caught_signal_name())
   end function signal_name
end module hb_signals
