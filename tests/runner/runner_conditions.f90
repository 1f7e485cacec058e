!> Assertions on logical conditions and single reals, and the one on expected exceptions.
module runner_conditions
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite, ieee_is_nan
   use, intrinsic :: iso_fortran_env, only: real32, real64
   use runner_exceptions, only: catch_exception, SourceLocation, throw
   implicit none
   private
   public :: assertAll, assertAny, assertExceptionRaised, assertFail, assertFalse, assertIsFinite, &
      assertIsNaN, assertTrue

   interface assertTrue
      procedure :: true_scalar, true_array
   end interface assertTrue

   interface assertFalse
      procedure :: false_scalar, false_array
   end interface assertFalse

   interface assertIsFinite
      procedure :: finite_single, finite_double
   end interface assertIsFinite

   interface assertIsNaN
      procedure :: nan_single, nan_double
   end interface assertIsNaN

   interface assertExceptionRaised
      procedure :: raised_any, raised_message
   end interface assertExceptionRaised

contains

   subroutine true_scalar(condition, message, location)
      logical, intent(in) :: condition
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location

      call require(condition, "the condition is false", message, location)
   end subroutine true_scalar

   subroutine true_array(condition, message, location)
      logical, intent(in) :: condition(:)
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location

      call require(all(condition), "not all conditions are true", message, location)
   end subroutine true_array

   subroutine false_scalar(condition, message, location)
      logical, intent(in) :: condition
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location

      call require(.not. condition, "the condition is true", message, location)
   end subroutine false_scalar

   subroutine false_array(condition, message, location)
      logical, intent(in) :: condition(:)
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location

      call require(.not. any(condition), "not all conditions are false", message, location)
   end subroutine false_array

   subroutine assertAll(conditions, message, location)
      logical, intent(in) :: conditions(:)
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location

      call require(all(conditions), "not all conditions are true", message, location)
   end subroutine assertAll

   subroutine assertAny(conditions, message, location)
      logical, intent(in) :: conditions(:)
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location

      call require(any(conditions), "no condition is true", message, location)
   end subroutine assertAny

   subroutine finite_single(x, message, location)
      real(real32), intent(in) :: x
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location

      call require(ieee_is_finite(x), "the number is not finite", message, location)
   end subroutine finite_single

   subroutine finite_double(x, message, location)
      real(real64), intent(in) :: x
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location

      call require(ieee_is_finite(x), "the number is not finite", message, location)
   end subroutine finite_double

   subroutine nan_single(x, message, location)
      real(real32), intent(in) :: x
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location

      call require(ieee_is_nan(x), "the number is not NaN", message, location)
   end subroutine nan_single

   subroutine nan_double(x, message, location)
      real(real64), intent(in) :: x
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location

      call require(ieee_is_nan(x), "the number is not NaN", message, location)
   end subroutine nan_double

   subroutine assertFail(message, location)
      character(*), intent(in) :: message
      type(SourceLocation), intent(in), optional :: location

      call throw(message, location)
   end subroutine assertFail

   !> Passes if some exception is waiting, and forgets the last one.
   subroutine raised_any(location)
      type(SourceLocation), intent(in), optional :: location
      logical :: was_caught

      call catch_exception(was_caught)
      if (.not. was_caught) call throw("no exception was thrown", location)
   end subroutine raised_any

   !> Passes if an exception with this message is waiting, and forgets it.
   subroutine raised_message(message, location)
      character(*), intent(in) :: message
      type(SourceLocation), intent(in), optional :: location
      logical :: was_caught

      call catch_exception(was_caught, message)
      if (.not. was_caught) call throw("no exception '"//message//"' was thrown", location)
   end subroutine raised_message

   !> Throws unless `holds`: the user's message, followed by what is wrong.
   subroutine require(holds, reason, message, location)
      logical, intent(in) :: holds
      character(*), intent(in) :: reason
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location

      if (holds) return
      if (present(message)) then
         call throw(trim(message)//": "//reason, location)
      else
         call throw(reason, location)
      end if
   end subroutine require
end module runner_conditions
