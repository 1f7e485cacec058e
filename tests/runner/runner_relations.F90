!> The relational assertions, a module each: assertEqual, assertNotEqual, assertLessThan, ... Every module is
!> the same specifics (runner_relation.inc) with another relation; the preprocessor only names their
!> arguments.

#define LEFT expected
#define RIGHT actual

module runner_equal
   use, intrinsic :: iso_fortran_env, only: int32, int64, real32, real64
   use runner_comparison, only: compare, relation => equal, values
   use runner_exceptions, only: SourceLocation, throw
   implicit none
   private
   public :: assertEqual

   interface assertEqual
      procedure :: integer_integer, integer_long, long_long, double_double, single_double, integer_double
      procedure :: complex_complex, single_complex, integer_complex, logical_logical, string_string
   end interface assertEqual

contains

#include "runner_relation.inc"

#include "runner_equality.inc"

   !> Strings are compared without their leading and trailing blanks.
   subroutine string_string(expected, actual, message, location)
      character(*), intent(in) :: expected, actual
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location
      character(:), allocatable :: a, beginning, e

      e = trim(adjustl(expected))
      a = trim(adjustl(actual))
      if (len(e) == len(a) .and. e == a) return
      beginning = ""
      if (present(message)) beginning = trim(message)//": "
      call throw(beginning//'found "'//a//'", expected equal to "'//e//'"', location)
   end subroutine string_string
end module runner_equal

module runner_not_equal
   use, intrinsic :: iso_fortran_env, only: int32, int64, real32, real64
   use runner_comparison, only: compare, relation => not_equal, values
   use runner_exceptions, only: SourceLocation
   implicit none
   private
   public :: assertNotEqual

   interface assertNotEqual
      procedure :: integer_integer, integer_long, long_long, double_double, single_double, integer_double
      procedure :: complex_complex, single_complex, integer_complex, logical_logical
   end interface assertNotEqual

contains

#include "runner_relation.inc"

#include "runner_equality.inc"
end module runner_not_equal

module runner_relatively_equal
   use, intrinsic :: iso_fortran_env, only: real32, real64
   use runner_comparison, only: compare, relatively_equal, values
   use runner_exceptions, only: SourceLocation
   implicit none
   private
   public :: assertRelativelyEqual

   interface assertRelativelyEqual
      procedure :: double_double, single_double
   end interface assertRelativelyEqual

contains

   subroutine double_double(expected, actual, tolerance, message, location)
      real(real64), intent(in) :: expected(..), actual(..)
      class(*), intent(in) :: tolerance
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location

      call compare(relatively_equal, shape(expected), values(expected), shape(actual), values(actual), &
         tolerance, message, location)
   end subroutine double_double

   subroutine single_double(expected, actual, tolerance, message, location)
      real(real32), intent(in) :: expected(..)
      real(real64), intent(in) :: actual(..)
      class(*), intent(in) :: tolerance
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location

      call compare(relatively_equal, shape(expected), values(expected), shape(actual), values(actual), &
         tolerance, message, location)
   end subroutine single_double
end module runner_relatively_equal

#undef LEFT
#undef RIGHT
#define LEFT lhs
#define RIGHT rhs

module runner_less_than
   use, intrinsic :: iso_fortran_env, only: int32, int64, real32, real64
   use runner_comparison, only: compare, relation => less_than, values
   use runner_exceptions, only: SourceLocation
   implicit none
   private
   public :: assertLessThan

   interface assertLessThan
      procedure :: integer_integer, integer_long, long_long, double_double, single_double, integer_double
   end interface assertLessThan

contains

#include "runner_relation.inc"
end module runner_less_than

module runner_less_than_or_equal
   use, intrinsic :: iso_fortran_env, only: int32, int64, real32, real64
   use runner_comparison, only: compare, relation => less_than_or_equal, values
   use runner_exceptions, only: SourceLocation
   implicit none
   private
   public :: assertLessThanOrEqual

   interface assertLessThanOrEqual
      procedure :: integer_integer, integer_long, long_long, double_double, single_double, integer_double
   end interface assertLessThanOrEqual

contains

#include "runner_relation.inc"
end module runner_less_than_or_equal

module runner_greater_than
   use, intrinsic :: iso_fortran_env, only: int32, int64, real32, real64
   use runner_comparison, only: compare, relation => greater_than, values
   use runner_exceptions, only: SourceLocation
   implicit none
   private
   public :: assertGreaterThan

   interface assertGreaterThan
      procedure :: integer_integer, integer_long, long_long, double_double, single_double, integer_double
   end interface assertGreaterThan

contains

#include "runner_relation.inc"
end module runner_greater_than

module runner_greater_than_or_equal
   use, intrinsic :: iso_fortran_env, only: int32, int64, real32, real64
   use runner_comparison, only: compare, relation => greater_than_or_equal, values
   use runner_exceptions, only: SourceLocation
   implicit none
   private
   public :: assertGreaterThanOrEqual

   interface assertGreaterThanOrEqual
      procedure :: integer_integer, integer_long, long_long, double_double, single_double, integer_double
   end interface assertGreaterThanOrEqual

contains

#include "runner_relation.inc"
end module runner_greater_than_or_equal
