!> The abstract integrator: steps of constant size from a given state.
module hb_integrator
   use hb_cancellation, only: work_is_over
   use hb_error, only: error_t, fail
   use hb_integration_system, only: integration_state_t, integration_system_t, law_forces
   use hb_kinds, only: int64, wp
   implicit none
   private
   public :: integrator_t

   integer, parameter :: steps_between_checks = 64                    ! of the cancellation, within one call

   !> Steps of one size from a state on.
   type, abstract :: integrator_t
      type(integration_system_t), pointer :: system => null()
      real(wp) :: step = 0.0_wp                                       !! [s]
      real(wp) :: origin = 0.0_wp                                     !! [s] where it started
      integer(int64) :: n_steps = 0_int64                             !! since then
      integer, allocatable :: impacts(:)                              !! since then, on both sides of each rigid law; negative
                                                                      !! once bounces have ended in contact
      logical :: is_at_pole = .false.                                 !! it has ended where a force becomes infinite
      real(wp), allocatable :: impact_times(:)                        !! [s], if they are to be listed: allocated at first
      real(wp), allocatable :: impact_jumps(:, :)                     !! changes of velocity there [m/s], (n_dofs, n_listed)
   contains
      procedure :: start => integrator_start
      procedure :: advance => integrator_advance
      procedure(begin_integration), deferred :: begin
      procedure :: resume => integrator_resume
      procedure(take_one_step), deferred :: take_step
      procedure :: read_state => integrator_read_state
      procedure :: forces => integrator_forces
      procedure :: destroy => integrator_destroy
   end type integrator_t

   abstract interface
      !> Sets the first state; coordinates behind a rigid wall are moved onto it.
      subroutine begin_integration(self, state, error)
         import :: error_t, integrator_t, integration_state_t
         class(integrator_t), intent(inout) :: self
         type(integration_state_t), intent(inout) :: state
         type(error_t), allocatable, intent(out) :: error
      end subroutine begin_integration

      !> Takes one step between two times; `state` may be brought up to it by `read_state` alone.
      subroutine take_one_step(self, time, time_after, state, error)
         import :: error_t, integrator_t, integration_state_t, wp
         class(integrator_t), intent(inout) :: self
         real(wp), intent(in) :: time, time_after                     !! [s]
         type(integration_state_t), intent(inout) :: state
         type(error_t), allocatable, intent(out) :: error
      end subroutine take_one_step
   end interface

contains

   !> Takes a state as the first one.
   subroutine integrator_start(self, state, error)
      class(integrator_t), intent(inout) :: self
      type(integration_state_t), intent(inout) :: state
      type(error_t), allocatable, intent(out) :: error

      self%origin = state%time
      self%n_steps = 0_int64
      call self%begin(state, error)
   end subroutine integrator_start

   !> Goes on from the state where the last call ended, which `state` must hold.
   subroutine integrator_advance(self, state, n_steps, error)
      class(integrator_t), intent(inout) :: self
      type(integration_state_t), intent(inout) :: state
      integer, intent(in) :: n_steps
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      call self%resume(state)
      do i = 1, n_steps
         call self%take_step(self%origin + self%n_steps*self%step, self%origin + (self%n_steps + 1_int64)*self%step, state, error)
         if (allocated(error)) return
         self%n_steps = self%n_steps + 1_int64
         if (modulo(i, steps_between_checks) > 0) cycle
         if (.not. work_is_over()) cycle
         call fail(error, "the time integration was cancelled")
         return
      end do
      state%time = self%origin + self%n_steps*self%step
      call self%read_state(state)
   end subroutine integrator_advance

   !> Finds what a method needs of the state from which it goes on.
   subroutine integrator_resume(self, state)
      class(integrator_t), intent(inout) :: self
      type(integration_state_t), intent(in) :: state
   end subroutine integrator_resume

   !> Brings a state to the time that it has.
   subroutine integrator_read_state(self, state)
      class(integrator_t), intent(inout) :: self
      type(integration_state_t), intent(inout) :: state
   end subroutine integrator_read_state

   !> Forces of the laws [N] on their coordinates in a state, on the left-hand side; 0 for rigid laws unless a method
   !> provides them.
   subroutine integrator_forces(self, state, f)
      class(integrator_t), intent(inout) :: self
      type(integration_state_t), intent(in) :: state
      real(wp), intent(out) :: f(:)                                   !! (n_coordinates)

      call law_forces(self%system, state, f)
   end subroutine integrator_forces

   !> Frees the memory of an external library; safe to call twice.
   subroutine integrator_destroy(self)
      class(integrator_t), intent(inout) :: self
   end subroutine integrator_destroy
end module hb_integrator
