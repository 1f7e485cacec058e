!> The equations of motion of a model in time, M q'' + D q' + K q + S f(z, z', states) = F(t), z = S^T q.
!>
!> Laws and structure are those of the model; no series, transform or balance enters, so that time integration can check them.
module hb_integration_system
   use hb_error, only: error_t, fail
   use hb_integration_laws, only: integration_laws_t, new_integration_laws
   use hb_integration_loads, only: integration_loads_t, new_integration_loads
   use hb_integration_matrix, only: integration_matrix_t, new_integration_matrix
   use hb_kinds, only: wp
   use hb_lapack, only: dpotrf, dpotrs
   use hb_law, only: law_box_t
   use hb_structure, only: structure_t
   implicit none
   private
   public :: integration_system_t, new_integration_system

   type :: integration_system_t
      integer :: n_dofs = 0
      type(structure_t) :: structure
      type(integration_laws_t) :: laws
      type(integration_loads_t) :: loads                              !! F [N]
      real(wp) :: length = 0.0_wp                                     !! typical displacement [m]
      ! What follows is divided by the mass, and only there after `divide_by_mass`
      type(integration_matrix_t) :: damping, stiffness                !! M^-1 D [1/s], M^-1 K [1/s**2]
      real(wp), allocatable :: shape(:, :)                            !! M^-1 S [1/kg], (n_dofs, n_coordinates)
      type(integration_loads_t) :: accelerations                      !! M^-1 F [m/s**2]
   contains
      procedure :: divide_by_mass => system_divide_by_mass
      procedure :: accelerate => system_accelerate
   end type integration_system_t

contains

   !> System from the parts of a model.
   subroutine new_integration_system(self, structure, laws, loads, frequencies, omega)
      type(integration_system_t), intent(out) :: self
      type(structure_t), intent(in) :: structure
      type(law_box_t), intent(in) :: laws(:)
      complex(wp), intent(in) :: loads(:, :)                          !! cos - i sin [N], (n_dofs, n_harmonics)
      real(wp), intent(in) :: frequencies(:)                          !! j.omega [rad/s], (n_harmonics)
      real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s]
      integer :: i

      self%n_dofs = structure%n_dofs
      self%structure = structure
      call self%structure%unpack()
      call new_integration_laws(self%laws, laws, structure%n_dofs, omega)
      call new_integration_loads(self%loads, loads, frequencies)
      do i = 1, size(laws)
         self%length = max(self%length, laws(i)%law%length_scale)
      end do
      do i = 1, structure%n_dofs
         associate (k => abs(self%structure%stiffness(i, i)) + maxval(self%loads%frequency**2)*self%structure%mass(i, i))
            if (k > 0.0_wp) self%length = max(self%length, sum(abs(loads(i, :)))/k)
         end associate
      end do
   end subroutine new_integration_system

   !> Makes what `accelerate` needs; fails for a singular mass.
   subroutine system_divide_by_mass(self, error)
      class(integration_system_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: factor(:, :), right(:, :)
      real(wp), parameter :: singular = 1.0e-13_wp
      integer :: i, info, n

      n = self%n_dofs
      factor = self%structure%mass
      call dpotrf("L", n, factor, n, info)
      if (info == 0) then
         do i = 1, n                                                  ! a pivot is a rest of the diagonal
            if (factor(i, i)**2 <= singular*self%structure%mass(i, i)) info = i
         end do
      end if
      if (info /= 0) then
         call fail(error, "the mass matrix is singular at "//trim(self%structure%labels(info))// &
                   "; of the methods of &integration only generalized_alpha can follow such a structure")
         return
      end if
      right = self%structure%damping
      call dpotrs("L", n, n, factor, n, right, n, info)
      call new_integration_matrix(self%damping, right)
      right = self%structure%stiffness
      call dpotrs("L", n, n, factor, n, right, n, info)
      call new_integration_matrix(self%stiffness, right)
      self%shape = self%laws%shape
      if (size(self%shape) > 0) call dpotrs("L", n, size(self%shape, 2), factor, n, self%shape, n, info)
      self%accelerations = self%loads
      if (self%loads%n_active == 0) return
      call dpotrs("L", n, self%loads%n_active, factor, n, self%accelerations%cosine, n, info)
      call dpotrs("L", n, self%loads%n_active, factor, n, self%accelerations%sine, n, info)
   end subroutine system_divide_by_mass

   !> Accelerations of a motion: M^-1 (F - D v - K q - S f). On entry `a` holds M^-1 F.
   subroutine system_accelerate(self, q, v, elapsed, a)
      class(integration_system_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: q(:), v(:)                  !! [m], [m/s], (n_dofs)
      real(wp), intent(in) :: elapsed                                 !! [s] since the start of the step
      real(wp), intent(inout), contiguous :: a(:)                     !! [m/s**2], (n_dofs)
      integer :: c, i

      call self%stiffness%subtract_product(q, a)
      call self%damping%subtract_product(v, a)
      call self%laws%gather(q, v)
      call self%laws%evaluate(elapsed)
      do c = 1, self%laws%n_coordinates
         do i = 1, self%n_dofs
            a(i) = a(i) - self%shape(i, c)*self%laws%f(c)
         end do
      end do
   end subroutine system_accelerate
end module hb_integration_system
