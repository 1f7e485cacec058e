!> The abstract integrator: steps of constant size from a given state.
module hb_integrator
   use hb_error, only: error_t
   use hb_integration_system, only: integration_state_t, integration_system_t
   use hb_kinds, only: wp
   implicit none
   private
   public :: integrator_t, law_forces

   type, abstract :: integrator_t
      type(integration_system_t), pointer :: system => null()
   contains
      procedure :: forces => integrator_forces
      procedure(start_integration), deferred :: start
      procedure(advance_integration), deferred :: advance
      procedure :: destroy => integrator_destroy
   end type integrator_t

   abstract interface
      !> Sets the first state; coordinates behind a rigid wall are moved onto it.
      subroutine start_integration(self, state, error)
         import :: error_t, integrator_t, integration_state_t
         class(integrator_t), intent(inout) :: self
         type(integration_state_t), intent(inout) :: state
         type(error_t), allocatable, intent(out) :: error
      end subroutine start_integration

      !> Continues from the state of the last call, which `state` must contain.
      subroutine advance_integration(self, state, n_steps, error)
         import :: error_t, integrator_t, integration_state_t
         class(integrator_t), intent(inout) :: self
         type(integration_state_t), intent(inout) :: state
         integer, intent(in) :: n_steps
         type(error_t), allocatable, intent(out) :: error
      end subroutine advance_integration
   end interface

contains

   !> Forces of the laws [N] on their coordinates in a state, on the left-hand side; 0 for rigid laws unless a method
   !> provides them.
   subroutine integrator_forces(self, state, f)
      class(integrator_t), intent(inout) :: self
      type(integration_state_t), intent(in) :: state
      real(wp), intent(out) :: f(:)                                   !! (n_coordinates)

      call law_forces(self%system, state, f)
   end subroutine integrator_forces

   !> Forces of all laws except the rigid ones in a state.
   subroutine law_forces(system, state, f)
      type(integration_system_t), intent(inout) :: system
      type(integration_state_t), intent(in) :: state
      real(wp), intent(out) :: f(:)                                   !! [N], (n_coordinates)

      call system%laws%start_step(state%time, state%q, state%v, state%s)
      call system%laws%gather(state%q, state%v)
      call system%laws%evaluate(0.0_wp)
      f = system%laws%f
   end subroutine law_forces

   !> Frees the memory of an external library; safe to call twice.
   subroutine integrator_destroy(self)
      class(integrator_t), intent(inout) :: self
   end subroutine integrator_destroy
end module hb_integrator
