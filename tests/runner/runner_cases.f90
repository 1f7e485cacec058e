!> Base types of the fixtures and parameters that a test file defines.
module runner_cases
   implicit none
   private
   public :: AbstractTestParameter, ParameterizedTestCase, TestCase

   !> Data that a test is run with; `toString` tells in the report which.
   type, abstract :: AbstractTestParameter
   contains
      procedure(to_string), deferred :: toString
   end type AbstractTestParameter

   abstract interface
      function to_string(this) result(string)
         import :: AbstractTestParameter
         class(AbstractTestParameter), intent(in) :: this
         character(:), allocatable :: string
      end function to_string
   end interface

   !> Fixture: `setUp` runs before each test, `tearDown` after it, unless `setUp` failed.
   type, abstract :: TestCase
   contains
      procedure :: setUp => do_nothing
      procedure :: tearDown => do_nothing
   end type TestCase

   !> Fixture whose constructor takes a parameter.
   type, abstract, extends(TestCase) :: ParameterizedTestCase
   end type ParameterizedTestCase

contains

   subroutine do_nothing(this)
      class(TestCase), intent(inout) :: this

      if (.not. same_type_as(this, this)) return       ! an unused argument would be a warning
   end subroutine do_nothing
end module runner_cases
