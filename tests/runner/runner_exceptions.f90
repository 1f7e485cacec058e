!> Failures that the running test has collected: `throw` adds one, the preprocessor's `if (anyExceptions())
!> return` ends the test at the first, `take_report` hands all of them over as text.
module runner_exceptions
   implicit none
   private
   public :: anyExceptions, catch_exception, SourceLocation, take_report, throw

   !> Line of a .pf file. Lengths are fixed, because gfortran 12 loses memory of structure constructors
   !> otherwise.
   type :: SourceLocation
      character(80) :: fileName = ""
      integer :: lineNumber = 0
   end type SourceLocation

   type :: exception_t
      character(:), allocatable :: message
      type(SourceLocation) :: location
   end type exception_t

   integer, parameter :: max_exceptions = 50     ! more than one reader wants; the rest is counted only
   type(exception_t), save :: exceptions(max_exceptions)
   integer, save :: n_exceptions = 0, n_dropped = 0

contains

   !> Record a failure.
   subroutine throw(message, location)
      character(*), intent(in) :: message
      type(SourceLocation), intent(in), optional :: location

      if (n_exceptions == max_exceptions) then
         n_dropped = n_dropped + 1
         return
      end if
      n_exceptions = n_exceptions + 1
      exceptions(n_exceptions)%message = message
      exceptions(n_exceptions)%location = SourceLocation()
      if (present(location)) exceptions(n_exceptions)%location = location
   end subroutine throw

   !> True while failures are waiting to be reported or caught.
   logical function anyExceptions()
      anyExceptions = n_exceptions > 0
   end function anyExceptions

   !> Remove one failure: the first with this message, or the last if no message is given.
   subroutine catch_exception(was_caught, message)
      logical, intent(out) :: was_caught
      character(*), intent(in), optional :: message
      integer :: i, i_caught

      i_caught = n_exceptions
      if (present(message)) then
         do i_caught = n_exceptions, 1, -1
            if (exceptions(i_caught)%message == message) exit
         end do
      end if
      was_caught = i_caught > 0
      if (.not. was_caught) return
      do i = i_caught, n_exceptions - 1
         exceptions(i) = exceptions(i + 1)
      end do
      n_exceptions = n_exceptions - 1
   end subroutine catch_exception

   !> Return all failures, a line each that ends with `suffix` and a line feed, and forget them; empty if
   !> none.
   subroutine take_report(report, suffix)
      character(:), allocatable, intent(out) :: report
      character(*), intent(in) :: suffix
      character(20) :: number
      integer :: i

      report = ""
      do i = 1, n_exceptions
         associate (e => exceptions(i))
            write (number, "(i0)") e%location%lineNumber
            if (e%location%lineNumber > 0) &
               report = report//"     ["//trim(e%location%fileName)//":"//trim(number)//"] "
            if (e%location%lineNumber == 0) report = report//"     [no location] "
            report = report//e%message//suffix//new_line("a")
         end associate
      end do
      if (n_dropped > 0) then
         write (number, "(i0)") n_dropped
         report = report//"     ... and "//trim(number)//" more"//suffix//new_line("a")
      end if
      n_exceptions = 0
      n_dropped = 0
   end subroutine take_report
end module runner_exceptions
