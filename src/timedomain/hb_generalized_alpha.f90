!> The generalized-alpha method: implicit, of second order, unconditionally stable for linear structures, for singular masses too.
!>
!> Inertia forces are evaluated at n+1-alpha_m, all others at n+1-alpha_f. Laws act on a few coordinates z only, so
!> that Newton's method, with the exact derivatives of the laws, iterates on z alone: the structure is factorised
!> once, a sparse one as such. The tangent of z is factorised for some derivatives of the laws; where few of them have
!> changed since, as those of contacts do one after the other, a small system corrects it (Sherman, Morrison, Woodbury).
!> The spectral radius at infinite frequency determines the damping of motions that the step does not resolve; 1 is the
!> trapezoidal rule. Source: J. Chung and G. M. Hulbert, J. Applied Mechanics 60 (1993) 371-375.
module hb_generalized_alpha
   use hb_cholmod, only: cholesky_factor_t
   use hb_error, only: error_t, fail
   use hb_integration_system, only: has_sparse_steps, integration_matrix_t, integration_state_t, integration_system_t, &
      new_integration_matrix
   use hb_integrator, only: integrator_t
   use hb_kinds, only: wp
   use hb_lapack, only: dgetrf, dgetrs
   use hb_sparse, only: sparse_from_entries, sparse_sum, sparse_t
   use hb_text, only: to_text
   implicit none
   private
   public :: generalized_alpha_t, new_generalized_alpha

   integer, parameter :: max_iterations = 50
   integer, parameter :: coordinates_per_change = 4                   ! fewer: the tangent is factorised again
   integer, parameter :: columns_together = 32                        ! right sides of one sparse solution

   !> The tangent of the coordinates of the laws, 1 + C D, factorised for some derivatives D of the laws.
   type :: law_tangent_t
      real(wp), allocatable :: slope(:, :)                            !! D [N/m]; not allocated: none yet
      real(wp), allocatable :: factor(:, :)
      integer, allocatable :: pivots(:)
      real(wp), allocatable :: response(:, :)                         !! (1 + C D)**-1 C [m/N]
   contains
      procedure :: solve => law_tangent_solve
   end type law_tangent_t

   type, extends(integrator_t) :: generalized_alpha_t
      real(wp) :: tolerance = 0.0_wp                                  !! of Newton, relative to the motion
      real(wp) :: alpha_m = 0.0_wp, alpha_f = 0.0_wp, beta = 0.0_wp, gamma = 0.0_wp
      real(wp), allocatable :: a(:)                                   !! accelerations of the last state [m/s**2]
      real(wp), allocatable :: factor(:, :)                           !! of the effective stiffness, or
      type(cholesky_factor_t) :: sparse_factor                        !! of a sparse one
      integer, allocatable :: pivots(:)
      real(wp), allocatable :: compliance(:, :)                       !! displacements by unit forces on the coordinates, if dense
      real(wp), allocatable :: coupling(:, :)                         !! (1 - alpha_f) S^T compliance
      type(integration_matrix_t) :: mass, damping, stiffness
      type(law_tangent_t) :: tangent
      real(wp), allocatable :: load(:)                                !! at the last state [N]
   contains
      procedure :: begin => generalized_alpha_begin
      procedure :: resume => generalized_alpha_resume
      procedure :: take_step => generalized_alpha_take_step
      procedure :: destroy => generalized_alpha_destroy
   end type generalized_alpha_t

contains

   !> Fails if the structure has rigid laws or a singular effective stiffness.
   subroutine new_generalized_alpha(self, system, step, spectral_radius, tolerance, error)
      type(generalized_alpha_t), intent(out) :: self
      type(integration_system_t), intent(inout), target :: system
      real(wp), intent(in) :: step                                    !! [s], > 0
      real(wp), intent(in) :: spectral_radius                         !! 0 to 1
      real(wp), intent(in) :: tolerance                               !! > 0
      type(error_t), allocatable, intent(out) :: error

      if (system%laws%has_rigid()) then
         call fail(error, "generalized_alpha does not support rigid walls or rigid friction; of the methods of integration "// &
                   "cvode and central_differences do")
         return
      end if
      self%system => system
      self%step = step
      self%tolerance = tolerance
      self%alpha_m = (2.0_wp*spectral_radius - 1.0_wp)/(spectral_radius + 1.0_wp)
      self%alpha_f = spectral_radius/(spectral_radius + 1.0_wp)
      self%gamma = 0.5_wp - self%alpha_m + self%alpha_f
      self%beta = 0.25_wp*(1.0_wp - self%alpha_m + self%alpha_f)**2
      allocate (self%a(system%n_dofs), self%load(system%n_dofs))
      if (.not. has_sparse_steps(system%structure)) call system%structure%unpack()
      if (allocated(system%structure%sparse)) then
         call factorise_sparse(self, error)
      else
         call factorise_dense(self, error)
      end if
   end subroutine new_generalized_alpha

   !> Factorises the effective stiffness of a structure with dense matrices.
   subroutine factorise_dense(self, error)
      class(generalized_alpha_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error
      integer :: info

      associate (structure => self%system%structure, n => self%system%n_dofs, h => self%step, left => 1.0_wp - self%alpha_f)
         call new_integration_matrix(self%mass, structure%mass)
         call new_integration_matrix(self%damping, structure%damping)
         call new_integration_matrix(self%stiffness, structure%stiffness)
         allocate (self%pivots(n))
         self%factor = (1.0_wp - self%alpha_m)/(self%beta*h**2)*structure%mass + &
                       left*self%gamma/(self%beta*h)*structure%damping + left*structure%stiffness
         call dgetrf(n, n, self%factor, n, self%pivots, info)
         if (info > 0) then
            call fail(error, "generalized_alpha: there is neither mass nor stiffness at "//trim(structure%labels(info)))
            return
         end if
         self%compliance = self%system%laws%shape
         if (size(self%compliance) > 0) &
            call dgetrs("N", n, size(self%compliance, 2), self%factor, n, self%pivots, self%compliance, n, info)
         self%coupling = left*matmul(transpose(self%system%laws%shape), self%compliance)
      end associate
   end subroutine factorise_dense

   !> Likewise of a structure with sparse matrices.
   subroutine factorise_sparse(self, error)
      class(generalized_alpha_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error
      type(sparse_t) :: effective
      real(wp), allocatable :: columns(:, :)
      integer :: c, first, last

      associate (matrices => self%system%structure%sparse, laws => self%system%laws, h => self%step, left => 1.0_wp - self%alpha_f)
         call new_integration_matrix(self%mass, matrices%mass)
         call new_integration_matrix(self%damping, matrices%damping)
         call new_integration_matrix(self%stiffness, matrices%stiffness)
         effective = sparse_sum(left*self%gamma/(self%beta*h), matrices%damping, left, matrices%stiffness)
         effective = sparse_sum((1.0_wp - self%alpha_m)/(self%beta*h**2), matrices%mass, 1.0_wp, effective)
         if (.not. self%sparse_factor%factorise(effective%first, effective%column, effective%value, [integer ::])) then
            call fail(error, "generalized_alpha: the effective stiffness is not positive definite, or there is not enough "// &
                      "memory for its factor; reduce the model (nhbm-model reduce)")
            return
         end if
         allocate (self%coupling(laws%n_coordinates, laws%n_coordinates))
         do first = 1, laws%n_coordinates, columns_together
            last = min(first + columns_together - 1, laws%n_coordinates)
            columns = transpose(laws%shape(:, first:last))
            call self%sparse_factor%solve(columns)
            do c = first, last
               self%coupling(:, c) = left*laws%coordinates_of(columns(c - first + 1, :))
            end do
         end do
      end associate
   end subroutine factorise_sparse

   !> Sets the initial state; its accelerations are in equilibrium with it, those of massless degrees of freedom are
   !> zero.
   subroutine generalized_alpha_begin(self, state, error)
      class(generalized_alpha_t), intent(inout) :: self
      type(integration_state_t), intent(inout) :: state
      type(error_t), allocatable, intent(out) :: error

      associate (laws => self%system%laws)
         call self%system%loads%act_within(state%time, state%time + 0.5_wp*self%step)
         call self%system%loads%at(state%time, self%a)
         call self%damping%subtract_product(state%v, self%a)
         call self%stiffness%subtract_product(state%q, self%a)
         call laws%start_step(state%time, state%q, state%v, state%s)
         call laws%gather(state%q, state%v)
         call laws%evaluate(0.0_wp)
         self%a = self%a - laws%forces_of(laws%f)
      end associate
      if (allocated(self%system%structure%sparse)) then
         call divide_by_sparse_mass(self, error)
      else
         call divide_by_dense_mass(self, error)
      end if
   end subroutine generalized_alpha_begin

   !> Accelerations from forces; those of massless degrees of freedom are zero.
   subroutine divide_by_dense_mass(self, error)
      class(generalized_alpha_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: mass(:, :)
      integer :: i, info, n, pivots(self%system%n_dofs)

      n = self%system%n_dofs
      allocate (mass, source=self%system%structure%mass)
      do i = 1, n
         if (mass(i, i) > 0.0_wp) cycle
         mass(i, i) = 1.0_wp
         self%a(i) = 0.0_wp
      end do
      call dgetrf(n, n, mass, n, pivots, info)
      if (info > 0) then
         call fail(error, "generalized_alpha: accelerations at the start are not determined, the mass is singular at "// &
                   trim(self%system%structure%labels(info)))
         return
      end if
      call dgetrs("N", n, 1, mass, n, pivots, self%a, n, info)
   end subroutine divide_by_dense_mass

   !> Likewise by a sparse mass.
   subroutine divide_by_sparse_mass(self, error)
      class(generalized_alpha_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error
      type(cholesky_factor_t) :: factor
      type(sparse_t) :: mass
      integer, allocatable :: massless(:)
      real(wp) :: right(1, self%system%n_dofs)
      integer :: i

      associate (of_structure => self%system%structure%sparse%mass)
         massless = pack([(i, i=1, self%system%n_dofs)], .not. of_structure%diagonal() > 0.0_wp)
         self%a(massless) = 0.0_wp
         mass = sparse_sum(1.0_wp, of_structure, 1.0_wp, &
                           sparse_from_entries(self%system%n_dofs, massless, massless, 1.0_wp + 0.0_wp*massless))
      end associate
      if (factor%factorise(mass%first, mass%column, mass%value, [integer ::])) then
         right(1, :) = self%a
         call factor%solve(right)
         self%a = right(1, :)
      else
         call fail(error, "generalized_alpha: accelerations at the start are not determined, the mass is singular")
      end if
      call factor%destroy()
   end subroutine divide_by_sparse_mass

   !> Displacements by forces, with the effective stiffness.
   subroutine respond(self, b)
      class(generalized_alpha_t), intent(in) :: self
      real(wp), intent(inout), contiguous :: b(:)                     !! (n_dofs)
      real(wp) :: right(1, size(b))
      integer :: info

      if (self%sparse_factor%is_there()) then
         right(1, :) = b
         call self%sparse_factor%solve(right)
         b = right(1, :)
      else
         call dgetrs("N", size(b), 1, self%factor, size(b), self%pivots, b, size(b), info)
      end if
   end subroutine respond

   !> Forces of laws and loads at the state.
   subroutine generalized_alpha_resume(self, state)
      class(generalized_alpha_t), intent(inout) :: self
      type(integration_state_t), intent(in) :: state

      call self%system%laws%start_step(state%time, state%q, state%v, state%s)
      call self%system%laws%gather(state%q, state%v)
      call self%system%laws%evaluate(0.0_wp)
      call self%system%loads%at(state%time, self%load)
   end subroutine generalized_alpha_resume

   subroutine generalized_alpha_take_step(self, time, time_after, state, error)
      class(generalized_alpha_t), intent(inout) :: self
      real(wp), intent(in) :: time, time_after
      type(integration_state_t), intent(inout) :: state
      type(error_t), allocatable, intent(out) :: error
      real(wp), dimension(self%system%n_dofs) :: a_before, before, load, q_guess, v_before, v_guess, right

      associate (h => self%step, beta => self%beta, gamma => self%gamma, am => self%alpha_m, af => self%alpha_f, &
                 laws => self%system%laws, q => state%q, v => state%v, a => self%a)
         before = self%load - laws%forces_of(laws%f)                  ! forces at the start of the step
         call laws%start_step(time, q, v, state%s)
         ! q_new = q_guess where a_new = a_guess = -(...)/(beta h**2) makes the unknown q_new itself
         q_guess = q + h*v + (0.5_wp - beta)*h**2*a
         v_guess = v + (1.0_wp - gamma)*h*a
         call self%system%loads%act_within(time_after - 0.5_wp*h, time_after + 0.5_wp*h)
         call self%system%loads%at(time_after, load)
         a_before = (1.0_wp - am)/(beta*h**2)*q_guess - am*a
         v_before = gamma/(beta*h)*q_guess - v_guess
         call self%stiffness%subtract_product(q, before)
         right = (1.0_wp - af)*load + af*before
         call self%mass%subtract_product(-a_before, right)
         call self%damping%subtract_product(af*v - (1.0_wp - af)*v_before, right)
         call respond(self, right)
         call solve_laws(self, right, q_guess, v_guess, error)         ! adds what the laws do to the motion
         if (allocated(error)) then
            error%message = error%message//" at t = "//to_text(time_after)//" s"
            return
         end if
         a = (right - q_guess)/(beta*h**2)
         q = right
         v = v_guess + gamma*h*a
         state%s = laws%s
         self%load = load
      end associate
   end subroutine generalized_alpha_take_step

   !> Newton's method for z = z_free - C f(z, z'), z' = rate_guess + gamma/(beta h) (z - z_guess).
   !>
   !> On entry `q` is the motion without the new forces of the laws, on return with them.
   subroutine solve_laws(self, q, q_guess, v_guess, error)
      class(generalized_alpha_t), intent(inout) :: self
      real(wp), intent(inout), contiguous :: q(:)
      real(wp), intent(in), contiguous :: q_guess(:), v_guess(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp), dimension(self%system%laws%n_coordinates) :: change, z_free, z_guess, rate_guess
      real(wp), allocatable, dimension(:, :) :: df_dz, df_dv
      real(wp), allocatable :: forces(:)
      real(wp) :: rate, size_of_z
      integer :: iteration, n
      logical :: is_singular

      n = self%system%laws%n_coordinates
      if (n == 0) return
      allocate (df_dz(n, n), df_dv(n, n))
      rate = self%gamma/(self%beta*self%step)
      associate (laws => self%system%laws)
         z_free = laws%coordinates_of(q)
         z_guess = laws%coordinates_of(q_guess)
         rate_guess = laws%coordinates_of(v_guess)
         laws%z = z_guess
         do iteration = 1, max_iterations
            laws%z_rate = rate_guess + rate*(laws%z - z_guess)
            call laws%differentiate(self%step, df_dz, df_dv)
            change = z_free - matmul(self%coupling, laws%f) - laws%z
            df_dz = df_dz + rate*df_dv
            call self%tangent%solve(self%coupling, df_dz, change, is_singular)
            if (is_singular) exit
            laws%z = laws%z + change
            size_of_z = max(self%system%length, maxval(abs(laws%z)))
            if (maxval(abs(change)) <= self%tolerance*size_of_z) then
               laws%z_rate = rate_guess + rate*(laws%z - z_guess)
               call laws%evaluate(self%step)
               if (allocated(self%compliance)) then
                  q = q - (1.0_wp - self%alpha_f)*matmul(self%compliance, laws%f)
               else
                  forces = laws%forces_of(laws%f)
                  call respond(self, forces)
                  q = q - (1.0_wp - self%alpha_f)*forces
               end if
               return
            end if
         end do
      end associate
      call fail(error, "generalized_alpha: Newton's method for the laws does not converge")
   end subroutine solve_laws

   !> Solves (1 + C D) x = b, in the place of b, with the factor of earlier derivatives where few have changed.
   subroutine law_tangent_solve(self, coupling, slope, b, is_singular)
      class(law_tangent_t), intent(inout) :: self
      real(wp), intent(in) :: coupling(:, :)                          !! C [m/N], (n, n)
      real(wp), intent(in) :: slope(:, :)                             !! D [N/m], likewise
      real(wp), intent(inout), contiguous :: b(:)                     !! (n)
      logical, intent(out) :: is_singular
      real(wp), allocatable :: small(:, :), y(:)
      integer, allocatable :: changed(:), pivots(:), rows(:)
      integer :: i, info, m, n

      n = size(b)
      is_singular = .false.
      if (allocated(self%slope)) then
         changed = pack([(i, i=1, n)], [(any(abs(slope(:, i) - self%slope(:, i)) > 0.0_wp), i=1, n)])  ! columns
      else
         changed = [(i, i=1, n)]
      end if
      m = size(changed)
      if (m*coordinates_per_change > n .or. .not. allocated(self%slope)) then
         call factorise()
         if (is_singular) return
         m = 0
      end if
      call dgetrs("N", n, 1, self%factor, n, self%pivots, b, n, info)
      if (m == 0) return
      ! with the change E of the columns: x + R E x = b, R = (1 + C D)**-1 C; the changed components first
      allocate (small(m, m), pivots(m))
      associate (difference => slope(:, changed) - self%slope(:, changed))
         rows = pack([(i, i=1, n)], any(abs(difference) > 0.0_wp, dim=2))
         small = matmul(self%response(changed, rows), difference(rows, :))
         do i = 1, m
            small(i, i) = small(i, i) + 1.0_wp
         end do
         y = b(changed)
         call dgetrf(m, m, small, m, pivots, info)
         is_singular = info > 0
         if (is_singular) return
         call dgetrs("N", m, 1, small, m, pivots, y, m, info)
         b = b - matmul(self%response(:, rows), matmul(difference(rows, :), y))
      end associate

   contains

      subroutine factorise()
         self%slope = slope
         self%factor = matmul(coupling, slope)
         do i = 1, n
            self%factor(i, i) = self%factor(i, i) + 1.0_wp
         end do
         if (.not. allocated(self%pivots)) allocate (self%pivots(n))
         call dgetrf(n, n, self%factor, n, self%pivots, info)
         is_singular = info > 0
         if (is_singular) then
            deallocate (self%slope)
            return
         end if
         self%response = coupling
         call dgetrs("N", n, n, self%factor, n, self%pivots, self%response, n, info)
      end subroutine factorise
   end subroutine law_tangent_solve

   !> Frees the factor; safe to call twice.
   subroutine generalized_alpha_destroy(self)
      class(generalized_alpha_t), intent(inout) :: self

      call self%sparse_factor%destroy()
   end subroutine generalized_alpha_destroy
end module hb_generalized_alpha
