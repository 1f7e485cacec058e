!> A budget of work, counted in units of hb_solver_types%unit_of_work: its limit and what has been spent.
module hb_budget
   use hb_kinds, only: int64, wp
   implicit none
   private
   public :: affordable_evaluations, budget_t, is_spent

   character(*), parameter :: is_spent = " has used up its budget of work" !! what messages say of an exhausted budget

   type :: budget_t
      real(wp) :: limit = huge(1.0_wp)
      real(wp) :: spent = 0.0_wp
   contains
      procedure :: spend => budget_spend
      procedure :: left => budget_left
      procedure :: is_exhausted => budget_is_exhausted
   end type budget_t

contains

   !> Counts work.
   elemental subroutine budget_spend(self, work)
      class(budget_t), intent(inout) :: self
      real(wp), intent(in) :: work

      self%spent = self%spent + work
   end subroutine budget_spend

   !> Returns what is left; never negative.
   elemental real(wp) function budget_left(self) result(left)
      class(budget_t), intent(in) :: self

      left = max(0.0_wp, self%limit - self%spent)
   end function budget_left

   !> Whether more was spent than permitted.
   elemental logical function budget_is_exhausted(self) result(is_exhausted)
      class(budget_t), intent(in) :: self

      is_exhausted = self%spent > self%limit
   end function budget_is_exhausted

   !> Evaluations for which some work suffices.
   elemental integer(int64) function affordable_evaluations(work, work_of_one) result(n)
      real(wp), intent(in) :: work, work_of_one
      real(wp), parameter :: max_count = 1.0e18_wp                    ! within the range of the integers

      n = int(min(work/work_of_one, max_count), int64)
   end function affordable_evaluations
end module hb_budget
