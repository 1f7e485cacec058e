!> The generalized-alpha method: implicit, of second order, unconditionally stable for linear structures, for singular masses too.
!>
!> Inertia forces are evaluated at n+1-alpha_m, all others at n+1-alpha_f. Laws act on a few coordinates z only, so
!> that Newton's method, with the exact derivatives of the laws, iterates on z alone: the structure is factorised
!> once. The spectral radius at infinite frequency determines the damping of motions that the step does not resolve; 1
!> is the trapezoidal rule. Source: J. Chung and G. M. Hulbert, J. Applied Mechanics 60 (1993) 371-375.
module hb_generalized_alpha
   use hb_error, only: error_t, fail
   use hb_integration_system, only: integration_state_t, integration_system_t
   use hb_integrator, only: integrator_t
   use hb_kinds, only: wp
   use hb_lapack, only: dgetrf, dgetrs
   use hb_text, only: to_text
   implicit none
   private
   public :: generalized_alpha_t, new_generalized_alpha

   integer, parameter :: max_iterations = 50

   type, extends(integrator_t) :: generalized_alpha_t
      real(wp) :: tolerance = 0.0_wp                                  !! of Newton, relative to the motion
      real(wp) :: alpha_m = 0.0_wp, alpha_f = 0.0_wp, beta = 0.0_wp, gamma = 0.0_wp
      real(wp), allocatable :: a(:)                                   !! accelerations of the last state [m/s**2]
      real(wp), allocatable :: factor(:, :)                           !! of the effective stiffness
      integer, allocatable :: pivots(:)
      real(wp), allocatable :: compliance(:, :)                       !! displacements by unit forces on the coordinates
      real(wp), allocatable :: coupling(:, :)                         !! S^T compliance
      real(wp), allocatable :: mass(:, :), damping(:, :), stiffness(:, :)
      real(wp), allocatable :: load(:)                                !! at the last state [N]
   contains
      procedure :: begin => generalized_alpha_begin
      procedure :: resume => generalized_alpha_resume
      procedure :: take_step => generalized_alpha_take_step
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
      integer :: info

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
      self%mass = system%structure%mass
      self%damping = system%structure%damping
      self%stiffness = system%structure%stiffness
      associate (n => system%n_dofs, h => step, left => 1.0_wp - self%alpha_f)
         allocate (self%pivots(n), self%a(n), self%load(n))
         self%factor = (1.0_wp - self%alpha_m)/(self%beta*h**2)*self%mass + left*self%gamma/(self%beta*h)*self%damping + &
                       left*self%stiffness
         call dgetrf(n, n, self%factor, n, self%pivots, info)
         if (info > 0) then
            call fail(error, "generalized_alpha: there is neither mass nor stiffness at "//trim(system%structure%labels(info)))
            return
         end if
         self%compliance = system%laws%shape
         if (size(self%compliance) > 0) &
            call dgetrs("N", n, size(self%compliance, 2), self%factor, n, self%pivots, self%compliance, n, info)
         self%coupling = matmul(transpose(system%laws%shape), self%compliance)
      end associate
   end subroutine new_generalized_alpha

   !> Sets the initial state; its accelerations are in equilibrium with it, those of massless degrees of freedom are
   !> zero.
   subroutine generalized_alpha_begin(self, state, error)
      class(generalized_alpha_t), intent(inout) :: self
      type(integration_state_t), intent(inout) :: state
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: mass(:, :)
      integer :: i, info, n
      integer :: pivots(self%system%n_dofs)

      n = self%system%n_dofs
      call self%system%loads%act_within(state%time, state%time + 0.5_wp*self%step)
      call self%system%loads%at(state%time, self%a)
      self%a = self%a - matmul(self%damping, state%v) - matmul(self%stiffness, state%q)
      call self%system%laws%start_step(state%time, state%q, state%v, state%s)
      call self%system%laws%gather(state%q, state%v)
      call self%system%laws%evaluate(0.0_wp)
      self%a = self%a - matmul(self%system%laws%shape, self%system%laws%f)
      mass = self%mass
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
   end subroutine generalized_alpha_begin

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
      real(wp), dimension(self%system%n_dofs) :: a_before, law_before, load, q_guess, v_before, v_guess, right
      integer :: info, n

      n = self%system%n_dofs
      associate (h => self%step, beta => self%beta, gamma => self%gamma, am => self%alpha_m, af => self%alpha_f, &
                 laws => self%system%laws, q => state%q, v => state%v, a => self%a)
         law_before = matmul(laws%shape, laws%f)
         call laws%start_step(time, q, v, state%s)
         ! q_new = q_guess where a_new = a_guess = -(...)/(beta h**2) makes the unknown q_new itself
         q_guess = q + h*v + (0.5_wp - beta)*h**2*a
         v_guess = v + (1.0_wp - gamma)*h*a
         call self%system%loads%act_within(time_after - 0.5_wp*h, time_after + 0.5_wp*h)
         call self%system%loads%at(time_after, load)
         a_before = (1.0_wp - am)/(beta*h**2)*q_guess - am*a
         v_before = gamma/(beta*h)*q_guess - v_guess
         right = (1.0_wp - af)*load + af*(self%load - law_before - matmul(self%stiffness, q) - matmul(self%damping, v)) &
                 + matmul(self%mass, a_before) + (1.0_wp - af)*matmul(self%damping, v_before)
         call dgetrs("N", n, 1, self%factor, n, self%pivots, right, n, info)
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

   !> Newton's method for z = z_free - (1 - alpha_f) S^T compliance f(z, z'), z' = rate_guess + gamma/(beta h) (z - z_guess).
   !>
   !> On entry `q` is the motion without the new forces of the laws, on return with them.
   subroutine solve_laws(self, q, q_guess, v_guess, error)
      class(generalized_alpha_t), intent(inout) :: self
      real(wp), intent(inout) :: q(:)
      real(wp), intent(in) :: q_guess(:), v_guess(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp), dimension(self%system%laws%n_coordinates) :: change, z_free, z_guess, rate_guess
      real(wp), dimension(self%system%laws%n_coordinates, self%system%laws%n_coordinates) :: df_dz, df_dv, tangent
      integer :: i, info, iteration, n, pivots(self%system%laws%n_coordinates)
      real(wp) :: rate, size_of_z

      n = self%system%laws%n_coordinates
      if (n == 0) return
      rate = self%gamma/(self%beta*self%step)
      associate (laws => self%system%laws, left => 1.0_wp - self%alpha_f)
         z_free = matmul(q, laws%shape)
         z_guess = matmul(q_guess, laws%shape)
         rate_guess = matmul(v_guess, laws%shape)
         laws%z = z_guess
         do iteration = 1, max_iterations
            laws%z_rate = rate_guess + rate*(laws%z - z_guess)
            call laws%differentiate(self%step, df_dz, df_dv)
            change = z_free - left*matmul(self%coupling, laws%f) - laws%z
            tangent = left*matmul(self%coupling, df_dz + rate*df_dv)
            do i = 1, n
               tangent(i, i) = tangent(i, i) + 1.0_wp
            end do
            call dgetrf(n, n, tangent, n, pivots, info)
            if (info > 0) exit
            call dgetrs("N", n, 1, tangent, n, pivots, change, n, info)
            laws%z = laws%z + change
            size_of_z = max(self%system%length, maxval(abs(laws%z)))
            if (maxval(abs(change)) <= self%tolerance*size_of_z) then
               laws%z_rate = rate_guess + rate*(laws%z - z_guess)
               call laws%evaluate(self%step)
               q = q - left*matmul(self%compliance, laws%f)
               return
            end if
         end do
      end associate
      call fail(error, "generalized_alpha: Newton's method for the laws does not converge")
   end subroutine solve_laws
end module hb_generalized_alpha
