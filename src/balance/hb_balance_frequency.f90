!> The balance at other base frequencies and artificial damping, and its derivatives by both.
!> Source: docs/why/theory.md, sections 5.6 and 6.5.
submodule (hb_balance) hb_balance_frequency
   use hb_error, only: fail
   use hb_problem, only: deformation_derivative, deformation_positions, set_deformations
   use hb_text, only: to_text
   implicit none

   real(wp), parameter :: added_damping = 1.0e-6_wp                   ! of the preconditioner, relative to the frequencies

contains

   module procedure balance_parameters
      integer :: i

      values = deformation_positions(self, which)
      do i = 1, size(which)
         if (which(i) > size(self%omega)) then
            values(i) = self%xi(which(i) - size(self%omega))
         else if (which(i) > 0) then
            values(i) = self%omega(which(i))
         end if
      end do
   end procedure balance_parameters

   !> Of a frequency and of the artificial damping of its tone: the frequency.
   module procedure balance_parameter_scales
      integer :: i

      scales = 1.0_wp
      do i = 1, size(which)
         if (which(i) > 0) scales(i) = self%omega(1 + modulo(which(i) - 1, size(self%omega)))
      end do
   end procedure balance_parameter_scales

   !> Not possible are frequencies that are not positive, and those at which the structure has no condensed stiffness.
   module procedure balance_set_parameters
      type(error_t), allocatable :: error
      real(wp), dimension(size(self%omega)) :: omega, xi
      integer :: i

      associate (n => size(self%omega))
         call set_deformations(self, pack(which, which < 0), pack(values, which < 0), is_possible)
         if (all(which < 0) .or. .not. is_possible) return
         omega = self%omega
         xi = self%xi
         do i = 1, size(which)
            if (which(i) > n) then
               xi(which(i) - n) = values(i)
            else if (which(i) > 0) then
               omega(which(i)) = values(i)
            end if
         end do
         is_possible = all(omega(pack(which, which > 0 .and. which <= n)) > 0.0_wp)
         if (.not. is_possible) return
         call self%move(omega, xi, error)
         is_possible = .not. allocated(error)
      end associate
   end procedure balance_set_parameters

   !> Exact; zero, with the reason in `failure`, if there is none.
   module procedure balance_parameter_derivative
      type(error_t), allocatable :: error
      real(wp), dimension(self%harmonics%n_coefficients, self%n_dofs) :: u, column

      if (which < 0) then
         call deformation_derivative(self, x, which, derivative)
         return
      end if
      u = reshape(x, shape(u))
      if (which > size(self%omega)) then
         call self%damping_derivative(u, which - size(self%omega), column, error)
      else
         call self%frequency_derivative(u, which, column, error)
      end if
      derivative = 0.0_wp
      if (allocated(error)) then
         call move_alloc(error, self%failure)
      else
         derivative = reshape(column, [size(column)])
      end if
   end procedure balance_parameter_derivative

   !> Adds a small damping of the tones with unknown frequencies, because at a solution the tangent is singular along
   !> the shift of an unknown phase.
   module procedure balance_update_regular_preconditioner
      type(error_t), allocatable :: error, error_of_return
      real(wp) :: omega(size(self%omega)), xi(size(self%xi)), xi_damped(size(self%xi))
      integer :: i

      omega = self%omega
      xi = self%xi
      xi_damped = xi
      do i = 1, size(which)
         if (which(i) > 0 .and. which(i) <= size(omega)) &
            xi_damped(which(i)) = xi(which(i)) + added_damping*omega(which(i))
      end do
      call self%move(omega, xi_damped, error)
      if (allocated(error)) call self%move(omega, xi, error_of_return)   ! without damping is better than nothing
      call self%update_preconditioner(level, is_strongest)
      if (.not. allocated(error)) call self%move(omega, xi, error)
      if (allocated(error)) call move_alloc(error, self%failure)
   end procedure balance_update_regular_preconditioner

   !> Changes base frequencies and artificial damping. Scales, first Jacobian and the structural data of laws are
   !> unchanged, and so is a preconditioner until its next update. Products need a new `linearise`.
   !> Fails if the stiffness was created without slopes or its interior is singular at the new frequencies.
   module procedure balance_move
      logical :: is_same(2)

      is_same = [all(omega == self%omega), all(xi == self%xi)]
      if (all(is_same)) return
      self%omega = omega
      self%xi = xi
      self%has_samples = .false.
      self%has_moved = .true.
      self%frequencies = self%harmonics%frequencies(omega)
      if (.not. is_same(1)) call self%law_set%move(self%law_set%transform%torus, omega)
      call self%stiffness%move(self%frequencies, self%drives(), error)
      if (allocated(error)) self%omega = -1.0_wp                      ! the present data belong to no frequencies
   end procedure balance_move

   !> The drive of each harmonic, sum over the tones of xi_m j_m omega_m [rad**2/s**2]: the artificial forces
   !> -M sum_m xi_m omega_m dx/dtau_m on the left-hand side. Source: docs/why/theory.md, section 6.5.
   module procedure balance_drives

      drives = self%harmonics%frequencies(self%xi*self%omega)
   end procedure balance_drives

   !> Derivative of the residual by the artificial damping of tone m at fixed coefficients and frequencies. Fails as
   !> `frequency_derivative` does.
   module procedure balance_damping_derivative
      real(wp) :: reaction(self%harmonics%n_coefficients, self%n_dofs)

      call prepare_slopes(self, u, m, derivative, error)
      if (allocated(error)) return
      call self%stiffness%find_reaction_slope(self%harmonics, u, self%load_factor, 0.0_wp*self%frequencies, &
                                              reaction, self%omega(m)*self%harmonics%tuples(m, :))
      call self%reaction_derivative(u, reaction, derivative, error)
   end procedure balance_damping_derivative

   !> dR = df/ds ds - ds.
   module procedure balance_reaction_derivative

      derivative = -slope
      if (.not. self%law_set%needs_reaction) return
      call self%differentiate(u, error)
      if (.not. allocated(error)) call self%law_set%make_direction_samples(error)
      if (allocated(error)) return
      associate (along => self%law_set%along)
         along%q%values = 0.0_wp
         if (self%law_set%needs_velocity) along%v%values = 0.0_wp
         call self%law_set%transform%to_samples(slope, along%s%values)
         call self%law_set%differentiate_along(error)
         if (allocated(error)) return
         call self%law_set%transform%to_coefficients(along%f%values, self%force)
      end associate
      derivative = self%law_set%factor*self%force - slope
   end procedure balance_reaction_derivative

   !> Common part of both derivatives: checks the arguments, evaluates the laws with derivatives.
   subroutine prepare_slopes(self, u, m, derivative, error)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(:, :)
      integer, intent(in) :: m
      real(wp), intent(out) :: derivative(:, :)
      type(error_t), allocatable, intent(out) :: error

      derivative = 0.0_wp
      if (.not. (allocated(self%stiffness%condensed_slope) .or. allocated(self%stiffness%contacts))) then
         call fail(error, "balance: its dynamic stiffness was made without slopes; derivatives by frequencies need them")
      else if (m < 1 .or. m > size(self%omega)) then
         call fail(error, "balance: no tone "//to_text(m)//" to differentiate by, there are 1 to "//to_text(size(self%omega)))
      end if
      if (allocated(error)) return
      call balance_sample(self, u)
      call self%law_set%differentiate(error)
      if (allocated(error)) return
      call self%law_set%make_direction_samples(error)
   end subroutine prepare_slopes

   !> Derivative of the residual by base frequency m at fixed coefficients, exact for the discrete equations:
   !> dR/domega_m = j_m (dS/dw u - dP/dw) + the projection of df/dv dv/domega_m + df/ds ds/domega_m + df/domega_m.
   !> The structural data of laws (`prepare`) are constant. Fails if the stiffness was created without slopes, for a
   !> tone that does not exist, if the derivative of a law with memory does not become periodic, and out of memory.
   !> docs/why/theory.md, section 5.6.
   module procedure balance_frequency_derivative
      real(wp) :: turns(self%harmonics%n_harmonics)                   ! j_m, the derivative of j.omega
      real(wp), dimension(self%harmonics%n_coefficients, self%n_dofs) :: force, reaction
      real(wp), allocatable :: weight_slope(:)

      call prepare_slopes(self, u, m, derivative, error)
      if (allocated(error)) return
      turns = real(self%harmonics%tuples(m, :), wp)
      allocate (weight_slope(0))
      if (.not. allocated(self%stiffness%contacts)) &
         call self%stiffness%find_reaction_slope(self%harmonics, u, self%load_factor, turns, reaction, self%xi(m)*turns)
      associate (along => self%law_set%along)
         along%q%values = 0.0_wp
         if (self%law_set%needs_velocity) call self%law_set%transform%to_rate_samples(u, turns, along%v%values)
         if (self%law_set%needs_reaction) call self%law_set%transform%to_samples(reaction, along%s%values)
         if (self%law_set%has_memory) call self%law_set%bring_step_slopes(u, self%omega, m, weight_slope)
         call self%law_set%differentiate_along(error, weight_slope)
         if (allocated(error)) return
         call self%law_set%add_frequency_slopes(m)
         call self%law_set%transform%to_coefficients(along%f%values, self%force)
      end associate
      if (allocated(self%stiffness%contacts)) then
         call self%law_set%evaluate()
         call self%law_set%transform%to_coefficients(self%law_set%samples%f%values, force)
         call self%stiffness%find_contact_slope(self%harmonics, u, self%law_set%factor*force, turns, &
                                                self%law_set%factor*self%force, derivative)
         return
      end if
      derivative = self%law_set%factor*self%force - reaction
   end procedure balance_frequency_derivative

end submodule hb_balance_frequency
