!> Central differences with exact unilateral constraints: explicit, of second order, walls and friction by multipliers.
!>
!> With velocities at half steps, v(n+1/2) = v(n) + h/2 a(n), q(n+1) = q(n) + h v(n+1/2), which is equivalent to the
!> scheme of three displacements; the damping matrix is treated implicitly. Before a step is completed, impulses at
!> the rigid laws correct the half-step velocity: a wall that would be crossed is met exactly (the impulse only
!> pushes, and a coordinate that arrives with v leaves with at most -e v), friction stops the coordinate or acts with
!> its limit. At e = 0 a coordinate loses its normal velocity when it meets the wall: the energy lost is that of the
!> mass lumped there in the discrete structure, which tends to zero as the mesh is refined. Source: N. J. Carpenter,
!> R. L. Taylor and M. G. Katona, Int. J. Numer. Meth. Engng 32 (1991) 103-128; J. J. Moreau, Comput. Methods Appl.
!> Mech. Engrg. 177 (1999) 329-349.
module hb_central_differences
   use hb_error, only: error_t, fail
   use hb_integration_system, only: integration_state_t, integration_system_t, law_forces
   use hb_integrator, only: integrator_t
   use hb_kinds, only: wp
   use hb_lapack, only: dgetrf, dgetrs
   use hb_law, only: hold_t
   use hb_rigid_constraints, only: move_before_walls
   use hb_text, only: to_text
   implicit none
   private
   public :: central_differences_t, new_central_differences

   integer, parameter :: max_sweeps = 10000

   type, extends(integrator_t) :: central_differences_t
      type(hold_t), allocatable :: rigid(:)
      real(wp), allocatable :: accelerance(:, :)                      !! M^-1 S of the rigid laws, (n_dofs, n_rigid) [1/kg]
      real(wp), allocatable :: yield(:, :)                            !! S^T M^-1 S of them [1/kg]
      real(wp), allocatable :: impulse(:)                             !! of the last step [N s], (n_rigid)
      real(wp), allocatable :: a(:), half_v(:)                        !! [m/s**2], [m/s]
      real(wp), allocatable :: factor(:, :)                           !! of 1 + h/2 M^-1 D
      integer, allocatable :: pivots(:)
   contains
      procedure :: begin => central_differences_begin
      procedure :: take_step => central_differences_take_step
      procedure :: forces => central_differences_forces
   end type central_differences_t

contains

   !> Fails for a singular mass.
   subroutine new_central_differences(self, system, step, rigid, error)
      type(central_differences_t), intent(out) :: self
      type(integration_system_t), intent(inout), target :: system
      real(wp), intent(in) :: step                                    !! [s], > 0
      type(hold_t), intent(in) :: rigid(:)                            !! its rigid laws
      type(error_t), allocatable, intent(out) :: error
      integer :: i, info, k, n
      real(wp), allocatable :: unit(:)

      associate (shape => system%laws%shape)
         do i = 2, size(rigid)
            do k = 1, i - 1
               if (all(abs(shape(:, rigid(i)%coordinate)*shape(:, rigid(k)%coordinate)) <= 0.0_wp)) cycle
               call fail(error, "central_differences would let a body strike several walls at once; of the methods of "// &
                         "time integration only cvode treats one impact after the other")
               return
            end do
         end do
      end associate
      call system%divide_by_mass(error)
      if (allocated(error)) return
      self%system => system
      self%step = step
      self%rigid = rigid
      n = system%n_dofs
      allocate (self%accelerance(n, size(self%rigid)), self%yield(size(self%rigid), size(self%rigid)))
      allocate (self%impulse(size(self%rigid)), source=0.0_wp)
      allocate (self%a(n), self%half_v(n), self%factor(n, n), self%pivots(n), unit(n))
      do i = 1, size(self%rigid)
         self%accelerance(:, i) = system%shape(:, self%rigid(i)%coordinate)
      end do
      do i = 1, size(self%rigid)
         self%yield(i, :) = matmul(system%laws%shape(:, self%rigid(i)%coordinate), self%accelerance)
      end do
      do i = 1, n
         unit = 0.0_wp
         unit(i) = 1.0_wp
         self%factor(:, i) = 0.0_wp
         call system%damping%subtract_product(unit, self%factor(:, i))
         self%factor(:, i) = unit - 0.5_wp*step*self%factor(:, i)
      end do
      call dgetrf(n, n, self%factor, n, self%pivots, info)
      if (info > 0) call fail(error, "central_differences: 1 + h/2 M^-1 D is singular, take another step")
   end subroutine new_central_differences

   subroutine central_differences_begin(self, state, error)
      class(central_differences_t), intent(inout) :: self
      type(integration_state_t), intent(inout) :: state
      type(error_t), allocatable, intent(out) :: error

      call move_before_walls(self%rigid, self%system%laws%shape, self%accelerance, state%q)
      call self%system%accelerations%begin(state%time, self%step)
      call self%system%accelerations%act_within(state%time, state%time + 0.5_wp*self%step)
      call self%system%laws%start_step(state%time, state%q, state%v, state%s)
      call self%system%accelerations%here(self%a)
      call self%system%accelerate(state%q, state%v, 0.0_wp, self%a)
      self%half_v = state%v - 0.5_wp*self%step*self%a
   end subroutine central_differences_begin

   subroutine central_differences_take_step(self, time, time_after, state, error)
      class(central_differences_t), intent(inout) :: self
      real(wp), intent(in) :: time, time_after
      type(integration_state_t), intent(inout) :: state
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: before(self%system%n_dofs)
      integer :: info, n

      n = self%system%n_dofs
      associate (h => self%step, system => self%system, q => state%q, v => state%v, a => self%a, half_v => self%half_v)
         call system%laws%start_step(time, q, v, state%s)
         before = half_v
         half_v = v + 0.5_wp*h*a
         if (size(self%rigid) > 0) call push(self, q, before, error)
         if (allocated(error)) then
            error%message = error%message//" at t = "//to_text(time_after)//" s"
            return
         end if
         q = q + h*half_v
         call system%accelerations%step_on()
         call system%accelerations%act_within(time_after - 0.5_wp*h, time_after + 0.5_wp*h)
         ! (1 + h/2 M^-1 D) a = M^-1 (F - K q - S f - D v(n+1/2)), laws at the velocity that the last acceleration predicts
         v = half_v + 0.5_wp*h*a
         call system%accelerations%here(a)
         call system%stiffness%subtract_product(q, a)
         call system%damping%subtract_product(half_v, a)
         call system%laws%gather(q, v)
         call system%laws%evaluate(h)
         if (system%laws%n_states > 0) state%s = system%laws%s
         a = a - matmul(system%shape, system%laws%f)
         call dgetrs("N", n, 1, self%factor, n, self%pivots, a, n, info)
         v = half_v + 0.5_wp*h*a
      end associate
   end subroutine central_differences_take_step

   !> Adds the impulses of the rigid laws to the half-step velocity, by projected Gauss-Seidel sweeps over them.
   subroutine push(self, q, v, error)
      class(central_differences_t), intent(inout) :: self
      real(wp), intent(in) :: q(:)
      real(wp), intent(in) :: v(:)                                    !! at the previous half step [m/s]
      type(error_t), allocatable, intent(out) :: error
      real(wp), dimension(size(self%rigid)) :: after, before, free, z
      real(wp) :: change, new, scale
      integer :: i, sweep

      associate (shape => self%system%laws%shape, impulse => self%impulse, yield => self%yield)
         do i = 1, size(self%rigid)
            associate (s => shape(:, self%rigid(i)%coordinate))
               z(i) = dot_product(s, q)
               before(i) = dot_product(s, v)
               free(i) = dot_product(s, self%half_v)
            end associate
         end do
         impulse = 0.0_wp
         after = free
         do sweep = 1, max_sweeps
            change = 0.0_wp
            scale = 0.0_wp
            do i = 1, size(self%rigid)
               new = impulse_of(self%rigid(i), self%step, z(i), before(i), &
                                after(i) + yield(i, i)*impulse(i))/yield(i, i)
               if (.not. self%rigid(i)%is_wall) new = min(max(new, -self%rigid(i)%limit*self%step), &
                                                          self%rigid(i)%limit*self%step)
               change = max(change, abs(new - impulse(i)))
               scale = max(scale, abs(new))
               after = after - yield(:, i)*(new - impulse(i))
               impulse(i) = new
            end do
            if (size(self%rigid) == 1 .or. change <= 4.0_wp*epsilon(1.0_wp)*scale) then
               self%half_v = self%half_v - matmul(self%accelerance, impulse)
               return
            end if
         end do
      end associate
      call fail(error, "central_differences: the impulses of the rigid laws do not converge")
   end subroutine push

   !> Change of velocity, against the coordinate, that the law requires for a coordinate with the given free velocity.
   pure real(wp) function impulse_of(rigid, step, z, before, free) result(change)
      type(hold_t), intent(in) :: rigid
      real(wp), intent(in) :: step
      real(wp), intent(in) :: z, before, free                         !! position, velocity a step before, velocity without impulse
      real(wp) :: high, low

      change = 0.0_wp
      if (.not. rigid%is_wall) then
         change = free
         return
      end if
      associate (e => rigid%restitution)
         high = (rigid%gap - z)/step
         if (free > high) change = free - min(high, merge(-e*before, high, before > 0.0_wp .and. e > 0.0_wp))
         if (.not. rigid%two_sided) return
         low = (-rigid%gap - z)/step
         if (free < low) change = free - max(low, merge(-e*before, low, before < 0.0_wp .and. e > 0.0_wp))
      end associate
   end function impulse_of

   !> Forces of the laws; of rigid ones the mean over the last step.
   subroutine central_differences_forces(self, state, f)
      class(central_differences_t), intent(inout) :: self
      type(integration_state_t), intent(in) :: state
      real(wp), intent(out) :: f(:)
      integer :: i

      call law_forces(self%system, state, f)
      do i = 1, size(self%rigid)
         f(self%rigid(i)%coordinate) = self%impulse(i)/self%step
      end do
   end subroutine central_differences_forces
end module hb_central_differences
