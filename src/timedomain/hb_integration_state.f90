!> The state from which a time integration continues: all that the future motion depends on.
module hb_integration_state
   use hb_kinds, only: wp
   implicit none
   private
   public :: integration_state_t, new_integration_state

   type :: integration_state_t
      real(wp) :: time = 0.0_wp                                       !! [s]
      real(wp), allocatable :: q(:)                                   !! displacements [m], (n_dofs)
      real(wp), allocatable :: v(:)                                   !! velocities [m/s], (n_dofs)
      real(wp), allocatable :: s(:)                                   !! states of all laws with memory, (n_states)
   end type integration_state_t

contains

   !> State of rest at time zero, sliders relaxed.
   pure subroutine new_integration_state(self, n_dofs, n_states)
      type(integration_state_t), intent(out) :: self
      integer, intent(in) :: n_dofs, n_states

      allocate (self%q(n_dofs), self%v(n_dofs), self%s(n_states), source=0.0_wp)
   end subroutine new_integration_state
end module hb_integration_state
