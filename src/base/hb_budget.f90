!> A budget of work, counted in units of hb_solver_types%unit_of_work: its limit and what has been spent.
module hb_budget
   use hb_kinds, only: wp
   implicit none
   private
   public :: budget_t

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
end module hb_budget
