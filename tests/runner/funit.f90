!> What a serial test file sees with `use funit`: the names and semantics of pFUnit 4.x, as far as the runner
!> has them.
module funit
   use runner_cases, only: AbstractTestParameter, ParameterizedTestCase, TestCase
   use runner_conditions, only: assertAll, assertAny, assertExceptionRaised, assertFail, assertFalse, &
      assertIsFinite, assertIsNaN, assertTrue
   use runner_equal, only: assertEqual
   use runner_exceptions, only: anyExceptions, SourceLocation, throw
   use runner_greater_than, only: assertGreaterThan
   use runner_greater_than_or_equal, only: assertGreaterThanOrEqual
   use runner_less_than, only: assertLessThan
   use runner_less_than_or_equal, only: assertLessThanOrEqual
   use runner_not_equal, only: assertNotEqual
   use runner_relatively_equal, only: assertRelativelyEqual
   implicit none
   public
end module funit
