!> The equations of motion of a model in time, M q'' + D q' + K q + S f(z, z', states) = F(t), z = S^T q.
!>
!> Laws and structure are those of the model; no series, transform or balance is used, so that time integration can
!> verify them.
module hb_integration_system
   use hb_cholmod, only: has_cholmod
   use hb_coordinate_scales, only: coordinate_scales_t, find_coordinate_scales
   use hb_error, only: error_t, fail
   use hb_integration_laws, only: integration_laws_t, new_integration_laws
   use hb_integration_loads, only: append_courses, integration_loads_t, new_integration_loads
   use hb_kinds, only: wp
   use hb_lapack, only: dpotrs
   use hb_law, only: law_box_t
   use hb_load_course, only: timed_load_t
   use hb_sparse, only: sparse_t, sparse_transpose
   use hb_spectrum, only: spectrum_t
   use hb_structure, only: structure_t
   implicit none
   private
   public :: has_sparse_steps, integration_matrix_t, integration_state_t, integration_system_t, law_forces, &
      new_integration_matrix, new_integration_state, new_integration_system

   !> The state from which a time integration continues: everything on which the future motion depends.
   type :: integration_state_t
      real(wp) :: time = 0.0_wp                                       !! [s]
      real(wp), allocatable :: q(:)                                   !! displacements [m], (n_dofs)
      real(wp), allocatable :: v(:)                                   !! velocities [m/s], (n_dofs)
      real(wp), allocatable :: s(:)                                   !! states of all laws with memory, (n_states)
   end type integration_state_t

   !> A square matrix for many multiplications: by its nonzero entries if they are few, otherwise dense.
   type :: integration_matrix_t
      integer :: n = 0
      logical :: is_sparse = .false.
      real(wp), allocatable :: entries(:, :)                          !! (n, n) unless sparse
      integer, allocatable :: first(:)                                !! (n + 1) first entry of each column
      integer, allocatable :: row(:)
      real(wp), allocatable :: value(:)
   contains
      procedure :: subtract_product => matrix_subtract_product
   end type integration_matrix_t

   interface new_integration_matrix
      procedure :: from_dense, from_sparse
   end interface new_integration_matrix

   type :: integration_system_t
      integer :: n_dofs = 0
      type(structure_t) :: structure
      type(integration_laws_t) :: laws
      type(integration_loads_t) :: loads                              !! F [N]
      real(wp) :: length = 0.0_wp                                     !! typical displacement [m]
      real(wp), allocatable :: unit(:)                                !! displacements that may be compared, (n_dofs)
      real(wp), allocatable :: response(:)                            !! typical displacements under the loads alone, (n_dofs)
      logical :: lists_impacts = .false.                              !! with times and changes of velocity
      ! The following are divided by the mass, and only available after `divide_by_mass`
      type(integration_matrix_t) :: damping, stiffness                !! M^-1 D [1/s], M^-1 K [1/s**2]
      real(wp), allocatable :: shape(:, :)                            !! M^-1 S [1/kg], (n_dofs, n_coordinates)
      type(integration_loads_t) :: accelerations                      !! M^-1 F [m/s**2]
   contains
      procedure :: divide_by_mass => system_divide_by_mass
      procedure :: accelerate => system_accelerate
      procedure :: largest_in_units => system_largest_in_units
      procedure :: typical_displacements => system_typical_displacements
   end type integration_system_t

contains

   !> System from the parts of a model; the matrices of the structure remain as they are.
   subroutine new_integration_system(self, structure, laws, loads, omega, timed)
      type(integration_system_t), intent(out) :: self
      type(structure_t), intent(in) :: structure
      type(law_box_t), intent(in) :: laws(:)
      type(spectrum_t), intent(in) :: loads                           !! [N]
      real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s]
      type(timed_load_t), intent(in), optional :: timed(:)            !! further loads
      type(coordinate_scales_t) :: scales
      real(wp), allocatable :: damping(:), mass(:), stiffness(:)
      real(wp) :: highest                                             ! frequency of the loads [rad/s]
      integer :: i

      self%n_dofs = structure%n_dofs
      self%structure = structure
      call new_integration_laws(self%laws, laws, structure%n_dofs, omega)
      call new_integration_loads(self%loads, loads%values, loads%frequencies(omega))
      if (present(timed)) call append_courses(self%loads, timed)
      allocate (self%response(self%n_dofs), source=0.0_wp)
      do i = 1, size(laws)
         self%length = max(self%length, laws(i)%law%length_scale)
      end do
      highest = self%loads%highest_frequency()
      call structure%diagonals(mass, damping, stiffness)
      do i = 1, structure%n_dofs
         associate (k => abs(stiffness(i)) + highest**2*mass(i))
            if (k > 0.0_wp) self%response(i) = (sum(abs(loads%values(i, :))) + sum(abs(self%loads%amplitude(i, :))))/k
         end associate
      end do
      self%length = max(self%length, maxval(self%response))
      associate (slowest => minval(abs(omega)))
         call find_coordinate_scales(scales, self%structure, laws, merge(slowest, 1.0_wp, slowest > 0.0_wp .and. size(omega) > 0), &
                                     self%response)
      end associate
      self%unit = scales%coordinates
      self%response = self%largest_in_units(self%response)
   end subroutine new_integration_system

   !> The largest of some displacements or rates, of all degrees of freedom, in the unit of each.
   pure function system_largest_in_units(self, values) result(largest)
      class(integration_system_t), intent(in) :: self
      real(wp), intent(in) :: values(:)                               !! (n_dofs)
      real(wp) :: largest(size(values))

      largest = self%unit*maxval(abs(values)/self%unit)
   end function system_largest_in_units

   !> Displacements of all degrees of freedom that are typical of the loads and the laws, in the unit of each.
   pure function system_typical_displacements(self) result(typical)
      class(integration_system_t), intent(in) :: self
      real(wp) :: typical(self%n_dofs)
      integer :: i, k

      typical = self%response
      do i = 1, size(self%laws%laws)
         associate (law => self%laws%laws(i)%law)
            do k = 1, size(law%shape, 2)
               associate (reach => maxval(abs(law%shape(:, k))*self%unit(law%dofs)))
                  if (reach > 0.0_wp) typical = max(typical, self%unit*(law%length_scale/reach))
               end associate
            end do
         end associate
      end do
   end function system_typical_displacements

   !> Computes the data for `accelerate`; fails for a singular mass.
   subroutine system_divide_by_mass(self, error)
      class(integration_system_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: factor(:, :), imaginary_part(:, :), real_part(:, :), right(:, :)
      integer :: info, n

      n = self%n_dofs
      call self%structure%unpack()
      call self%structure%factorise_mass(factor, info)
      if (info /= 0) then
         call fail(error, "the mass matrix is singular at "//trim(self%structure%labels(info))// &
                   "; of the methods of time integration only generalized_alpha supports such a structure")
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
      if (size(self%loads%timed) > 0) then
         associate (amplitude => self%accelerations%amplitude)
            allocate (real_part, source=real(amplitude, wp))
            allocate (imaginary_part, source=aimag(amplitude))
            call dpotrs("L", n, size(amplitude, 2), factor, n, real_part, n, info)
            call dpotrs("L", n, size(amplitude, 2), factor, n, imaginary_part, n, info)
            amplitude = cmplx(real_part, imaginary_part, wp)
         end associate
      end if
      if (self%loads%n_active == 0) return
      call dpotrs("L", n, self%loads%n_active, factor, n, self%accelerations%cosine, n, info)
      call dpotrs("L", n, self%loads%n_active, factor, n, self%accelerations%sine, n, info)
   end subroutine system_divide_by_mass

   !> Accelerations of a motion: M^-1 (F - D v - K q - S f). On entry `a` contains M^-1 F.
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

   !> Whether generalized_alpha takes steps with sparse matrices, which must then be symmetric.
   logical function has_sparse_steps(structure)
      type(structure_t), intent(in) :: structure

      has_sparse_steps = has_cholmod() .and. allocated(structure%sparse)
      if (.not. has_sparse_steps) return
      associate (matrices => structure%sparse)
         has_sparse_steps = matrices%mass%is_symmetric() .and. matrices%damping%is_symmetric() .and. &
                            matrices%stiffness%is_symmetric()
      end associate
   end function has_sparse_steps

   !> Stores a matrix; if few entries are nonzero, only these.
   pure subroutine from_dense(self, entries)
      type(integration_matrix_t), intent(out) :: self
      real(wp), intent(in) :: entries(:, :)                           !! (n, n)
      integer :: e, i, j

      self%n = size(entries, 1)
      self%is_sparse = 2*count(abs(entries) > 0.0_wp) < self%n**2
      if (.not. self%is_sparse) then
         self%entries = entries
         return
      end if
      allocate (self%first(self%n + 1), self%row(count(abs(entries) > 0.0_wp)))
      allocate (self%value(size(self%row)))
      e = 0
      do j = 1, self%n
         self%first(j) = e + 1
         do i = 1, self%n
            if (.not. abs(entries(i, j)) > 0.0_wp) cycle
            e = e + 1
            self%row(e) = i
            self%value(e) = entries(i, j)
         end do
      end do
      self%first(self%n + 1) = e + 1
   end subroutine from_dense

   !> Stores a square matrix that is sparse already.
   subroutine from_sparse(self, matrix)
      type(integration_matrix_t), intent(out) :: self
      type(sparse_t), intent(in) :: matrix
      type(sparse_t) :: by_columns

      by_columns = sparse_transpose(matrix)
      self%n = matrix%n_rows
      self%is_sparse = .true.
      self%first = by_columns%first
      self%row = by_columns%column
      self%value = by_columns%value
   end subroutine from_sparse

   !> y = y - A x.
   pure subroutine matrix_subtract_product(self, x, y)
      class(integration_matrix_t), intent(in) :: self
      real(wp), intent(in), contiguous :: x(:)                        !! (n)
      real(wp), intent(inout), contiguous :: y(:)                     !! (n)
      integer :: e, i, j

      if (self%is_sparse) then
         do j = 1, self%n
            do e = self%first(j), self%first(j + 1) - 1
               y(self%row(e)) = y(self%row(e)) - self%value(e)*x(j)
            end do
         end do
      else
         do j = 1, self%n
            do i = 1, self%n
               y(i) = y(i) - self%entries(i, j)*x(j)
            end do
         end do
      end if
   end subroutine matrix_subtract_product

   !> State of rest at time zero, sliders relaxed.
   pure subroutine new_integration_state(self, n_dofs, n_states)
      type(integration_state_t), intent(out) :: self
      integer, intent(in) :: n_dofs, n_states

      allocate (self%q(n_dofs), self%v(n_dofs), self%s(n_states), source=0.0_wp)
   end subroutine new_integration_state

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
end module hb_integration_system
