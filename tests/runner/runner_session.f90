!> One run of a test executable: command line, a line per test, totals, exit status. Runs the serial tests.
module runner_session
   use, intrinsic :: iso_fortran_env, only: error_unit, output_unit
   use runner_exceptions, only: anyExceptions, take_report
   implicit none
   private
   public :: print_totals, read_command_line, record_test, set_root       ! for the main program
   public :: is_selected, start_test
   public :: finish_run, start_run
   public :: runner_finish, runner_run, runner_skip, runner_wants         ! for the generated suites

   abstract interface
      subroutine plain_procedure()
      end subroutine plain_procedure
   end interface

   logical, save :: is_root = .true.             ! only rank 0 runs serial tests and prints
   logical, save :: is_verbose = .false.
   character(:), allocatable, save :: pattern    ! only tests whose label contains it are run
   character(:), allocatable, save :: current    ! label of the running test
   integer, save :: n_passed = 0, n_failed = 0, n_skipped = 0

contains

   !> Begin of a serial executable.
   subroutine start_run()
      call read_command_line()
   end subroutine start_run

   !> End of a serial executable: totals, and status 2 if a test has failed.
   subroutine finish_run()
      logical :: has_failed

      call print_totals(has_failed)
      if (has_failed) stop 2, quiet=.true.
   end subroutine finish_run

   !> Tell whether this process is the one that runs serial tests and prints.
   subroutine set_root(is_root_process)
      logical, intent(in) :: is_root_process
      is_root = is_root_process
   end subroutine set_root

   !> Read `-v` (name each test before it runs) and `-f <pattern>`; stops with status 2 on anything else.
   subroutine read_command_line()
      character(:), allocatable :: argument
      integer :: i

      pattern = ""
      i = 0
      do while (i < command_argument_count())
         i = i + 1
         call get_argument(i, argument)
         if (argument == "-v") then
            is_verbose = .true.
         else if (argument == "-f" .and. i < command_argument_count()) then
            i = i + 1
            call get_argument(i, pattern)
         else
            write (error_unit, "(a)") "unknown argument '"//argument// &
               "'; usage: [-v] [-f <part of a test name>]"
            stop 2, quiet=.true.
         end if
      end do
   end subroutine read_command_line

   subroutine get_argument(i, argument)
      integer, intent(in) :: i
      character(:), allocatable, intent(out) :: argument
      integer :: length

      call get_command_argument(i, length=length)
      allocate (character(length) :: argument)
      call get_command_argument(i, argument)
   end subroutine get_argument

   !> True if the filter of the command line lets this test through.
   logical function is_selected(label)
      character(*), intent(in) :: label
      is_selected = index(label, pattern) > 0
   end function is_selected

   !> Make `label` the running test.
   subroutine start_test(label)
      character(*), intent(in) :: label

      current = label
      if (.not. (is_verbose .and. is_root)) return
      write (output_unit, "(a)") "run  "//label
      flush (output_unit)
   end subroutine start_test

   !> Count and print the running test; it has failed if `report` is not empty.
   subroutine record_test(report)
      character(*), intent(in) :: report

      if (len(report) == 0) then
         n_passed = n_passed + 1
         write (output_unit, "(a)") "ok   "//current
      else
         n_failed = n_failed + 1
         write (output_unit, "(a)") "FAIL "//current
         write (output_unit, "(a)", advance="no") report
      end if
      flush (output_unit)
   end subroutine record_test

   !> Print the last line of the run. A filter that lets nothing through is a failure.
   subroutine print_totals(has_failed)
      logical, intent(out) :: has_failed
      character(80) :: line

      has_failed = n_failed > 0
      if (n_failed > 0) then
         write (line, "(a, i0, a, i0, a, i0, a)") &
            "FAILED (", n_failed, " of ", n_passed + n_failed, " tests, ", n_skipped, " disabled)"
      else
         write (line, "(a, i0, a, i0, a)") "OK (", n_passed, " tests, ", n_skipped, " disabled)"
      end if
      if (n_passed + n_failed + n_skipped == 0) then
         has_failed = .true.
         line = "FAILED (no test matches the pattern)"
      end if
      write (output_unit, "(a)") trim(line)
      flush (output_unit)
   end subroutine print_totals

   !> True if a serial test is to be run here; it is then the running test.
   logical function runner_wants(label)
      character(*), intent(in) :: label

      runner_wants = is_root .and. is_selected(label)
      if (runner_wants) call start_test(label)
   end function runner_wants

   !> End of the running serial test.
   subroutine runner_finish()
      character(:), allocatable :: report

      call take_report(report, suffix="")
      call record_test(report)
   end subroutine runner_finish

   !> Run a test without arguments; `after` runs even if the test fails, but not if `before` does.
   subroutine runner_run(label, method, before, after)
      character(*), intent(in) :: label
      procedure(plain_procedure) :: method
      procedure(plain_procedure), optional :: before, after

      if (.not. runner_wants(label)) return
      if (present(before)) call before()
      if (.not. anyExceptions()) then
         call method()
         if (present(after)) call after()
      end if
      call runner_finish()
   end subroutine runner_run

   !> Count and print a disabled test.
   subroutine runner_skip(label)
      character(*), intent(in) :: label

      if (.not. (is_root .and. is_selected(label))) return
      n_skipped = n_skipped + 1
      write (output_unit, "(a)") "skip "//label
   end subroutine runner_skip
end module runner_session
