!> The balance with unknown base frequencies: x = (u, omega of the unknown tones, and where asked for, artificial damping).
!>
!> Each further unknown brings one equation, a linear form of the coefficients u that has a given value: phase conditions,
!> which pick one of the motions that differ by a shift of an unknown phase alone, and amplitudes. The last one may be an energy
!> instead, whose derivatives then take the place of its form. Solvers see one more abstract problem. Source: docs/user/theory.md,
!> section 6.5.
module hb_phase
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_balance, only: balance_t
   use hb_energy, only: energy_t
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_problem, only: problem_t
   implicit none
   private
   public :: amplitude_form, coefficient_form, new_phase_problem, peak_form, peak_rate_form, phase_problem_t, shift_form, turn

   type, extends(problem_t) :: phase_problem_t
      type(balance_t), pointer :: balance => null()
      integer, allocatable :: tones(:)                                !! the unknown ones
      logical :: with_damping = .false.                               !! their artificial damping is unknown too
      real(wp), allocatable :: forms(:, :)                            !! (coefficients of all dofs, or all unknowns; equations
                                                                      !! added)
      real(wp), allocatable :: values(:)                              !! of the forms, (equations added)
      type(energy_t), allocatable :: energy                           !! has the last of the values; its form is found anew
      integer :: peak_dof = 0                                         !! the forms are rate and value of its displacement where all
                                                                      !! phases are zero, of a series of any length; 0: they are not
      logical, allocatable :: is_held(:)                              !! coefficients held at zero, none if not allocated
      integer, private :: n_u = 0                                     ! coefficients of all degrees of freedom
      real(wp), allocatable, private :: border(:, :)                  ! derivatives by the further unknowns, (n_u, those)
      real(wp), allocatable, private :: eliminated(:, :), schur(:, :) ! preconditioner by block elimination
      integer, allocatable, private :: schur_pivots(:)
      logical, private :: has_schur = .false.
   contains
      procedure :: residual => phase_problem_residual
      procedure :: tangent => phase_problem_tangent
      procedure :: linearise => phase_problem_linearise
      procedure :: apply_tangent => phase_problem_apply_tangent
      procedure :: update_preconditioner => phase_problem_update_preconditioner
      procedure :: precondition => phase_problem_precondition
      procedure, private :: find_border => phase_problem_find_border
      procedure, private :: find_energy_form => phase_problem_find_energy_form
      procedure :: solve_linear => phase_problem_solve_linear
      procedure :: rounding_level => phase_problem_rounding_level
      procedure :: deform => phase_problem_deform
      procedure :: hold_above => phase_problem_hold_above
      procedure :: unknowns => phase_problem_unknowns
      procedure :: move_to => phase_problem_move_to
      procedure :: added_residual => phase_problem_added_residual
   end type phase_problem_t

   ! Products; bodies in hb_phase_products
   interface
      module subroutine phase_problem_linearise(self, x, is_ready)
         class(phase_problem_t), intent(inout) :: self
         real(wp), intent(in), contiguous :: x(:)
         logical, intent(out) :: is_ready
      end subroutine phase_problem_linearise

      module subroutine phase_problem_apply_tangent(self, x, product)
         class(phase_problem_t), intent(inout) :: self
         real(wp), intent(in), contiguous :: x(:)
         real(wp), intent(out), contiguous :: product(:)
      end subroutine phase_problem_apply_tangent

      module subroutine phase_problem_update_preconditioner(self, level, is_strongest)
         class(phase_problem_t), intent(inout) :: self
         integer, intent(in) :: level
         logical, intent(out) :: is_strongest
      end subroutine phase_problem_update_preconditioner

      module subroutine phase_problem_precondition(self, r, step)
         class(phase_problem_t), intent(inout) :: self
         real(wp), intent(in), contiguous :: r(:)
         real(wp), intent(out), contiguous :: step(:)
      end subroutine phase_problem_precondition
   end interface

contains

   !> Problem on a balance whose stiffness has slopes. Its scales are those of the balance, frequencies are scaled by their
   !> present values. There must be as many forms as further unknowns, of all unknowns where the last is that of an energy.
   subroutine new_phase_problem(self, balance, tones, with_damping, forms, values, energy)
      type(phase_problem_t), intent(out) :: self
      type(balance_t), intent(in), target :: balance
      integer, intent(in) :: tones(:)                                 !! unknown ones
      logical, intent(in) :: with_damping
      real(wp), intent(in) :: forms(:, :)                             !! (coefficients of all dofs, or all unknowns; equations
                                                                      !! added)
      real(wp), intent(in) :: values(:)                               !! (further unknowns)
      type(energy_t), intent(in), optional :: energy                  !! has the last value; what its form holds does not matter
      integer :: i

      self%balance => balance
      self%tones = tones
      self%with_damping = with_damping
      self%forms = forms
      self%values = values
      self%n_u = balance%n_unknowns
      self%n_unknowns = self%n_u + size(values)
      self%has_products = balance%has_products
      self%residual_work = balance%residual_work
      self%tangent_work = balance%tangent_work
      self%watch => balance%watch
      allocate (self%border(self%n_u, size(values)))
      self%x_scale = [balance%x_scale, balance%omega(tones)]
      if (with_damping) self%x_scale = [self%x_scale, balance%omega(tones)]
      self%r_scale = [balance%r_scale, (norm2(forms(:, i)*self%x_scale(:size(forms, 1))), i=1, size(values))]
      if (.not. present(energy)) return
      self%energy = energy
      self%r_scale(self%n_unknowns) = abs(values(size(values)))
   end subroutine new_phase_problem

   !> The state of the balance as a vector of unknowns.
   pure function phase_problem_unknowns(self, u) result(x)
      class(phase_problem_t), intent(in) :: self
      real(wp), intent(in) :: u(:, :)                                 !! [m], (n_coefficients, n_dofs)
      real(wp) :: x(self%n_unknowns)

      x = [reshape(u, [size(u)]), self%balance%omega(self%tones), self%balance%xi(self%tones(:n_damped(self)))]
   end function phase_problem_unknowns

   !> Holds the coefficients of all harmonics with sum |j_m| > order at zero: the problem of a smaller set, in the same vector.
   !> An order of the whole set or above lets all go.
   subroutine phase_problem_hold_above(self, order)
      class(phase_problem_t), intent(inout) :: self
      integer, intent(in) :: order
      logical :: is_high(self%balance%harmonics%n_coefficients)
      integer :: h, i

      if (allocated(self%is_held)) deallocate (self%is_held)
      associate (set => self%balance%harmonics)
         do h = 1, set%n_harmonics
            is_high(set%cos_at(h)) = sum(abs(set%tuples(:, h))) > order
            if (set%sin_at(h) > 0) is_high(set%sin_at(h)) = is_high(set%cos_at(h))
         end do
      end associate
      if (any(is_high)) self%is_held = [(is_high, i=1, self%balance%n_dofs)]
   end subroutine phase_problem_hold_above

   !> Number of tones with unknown artificial damping.
   pure integer function n_damped(self)
      class(phase_problem_t), intent(in) :: self

      n_damped = merge(size(self%tones), 0, self%with_damping)
   end function n_damped

   !> Moves the balance to the frequencies in x; `is_possible` is false where they are not positive or the structure has no
   !> condensed stiffness.
   subroutine phase_problem_move_to(self, x, is_possible)
      class(phase_problem_t), intent(inout) :: self
      real(wp), intent(in) :: x(:)                                    !! (n_unknowns)
      logical, intent(out) :: is_possible
      type(error_t), allocatable :: error
      real(wp) :: omega(size(self%balance%omega)), xi(size(self%balance%omega))
      integer :: n

      n = size(self%tones)
      is_possible = all(x(self%n_u + 1:self%n_u + n) > 0.0_wp)
      if (.not. is_possible) return
      omega = self%balance%omega
      xi = self%balance%xi
      omega(self%tones) = x(self%n_u + 1:self%n_u + n)
      if (self%with_damping) xi(self%tones) = x(self%n_u + n + 1:)
      call self%balance%move(omega, xi, error)
      is_possible = .not. allocated(error)
   end subroutine phase_problem_move_to

   subroutine phase_problem_residual(self, x, r)
      class(phase_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(out), contiguous :: r(:)
      logical :: is_possible

      call self%move_to(x, is_possible)
      if (.not. is_possible) then
         r = ieee_value(1.0_wp, ieee_quiet_nan)
         return
      end if
      associate (n => self%n_u)
         call self%balance%residual(x(:n), r(:n))
         r(n + 1:) = matmul(x(:size(self%forms, 1)), self%forms) - self%values
         if (allocated(self%energy)) r(self%n_unknowns) = &
            self%energy%value(self%balance, reshape(x(:n), [self%balance%harmonics%n_coefficients, self%balance%n_dofs])) &
            - self%values(size(self%values))
         if (allocated(self%is_held)) then
            where (self%is_held) r(:n) = x(:n)*self%r_scale(:n)/self%x_scale(:n)
         end if
      end associate
   end subroutine phase_problem_residual

   !> Residual of the equations added, of a motion in a wider set: peaks and energies have a part outside of the set of the
   !> problem, which its forms cannot see; all else has none.
   function phase_problem_added_residual(self, wide, motion) result(r)
      class(phase_problem_t), intent(in) :: self
      type(balance_t), intent(inout), target :: wide                  !! at the frequencies of the balance
      real(wp), intent(in) :: motion(:, :)                            !! [m], (n_coefficients of the wider set, n_dofs)
      real(wp) :: r(size(self%values))

      r = 0.0_wp
      if (self%peak_dof > 0) then
         r(1) = dot_product(peak_rate_form(wide%harmonics, wide%n_dofs, self%peak_dof, self%tones(1)), &
                            reshape(motion, [size(motion)])) - self%values(1)
         r(2) = dot_product(peak_form(wide%harmonics, wide%n_dofs, self%peak_dof), reshape(motion, [size(motion)])) &
                - self%values(2)
      end if
      if (allocated(self%energy)) r(size(r)) = self%energy%value(wide, motion) - self%values(size(r))
   end function phase_problem_added_residual

   subroutine phase_problem_tangent(self, x, jacobian)
      class(phase_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(out), contiguous :: jacobian(:, :)
      real(wp), allocatable :: block(:, :)
      logical :: is_possible
      integer :: i

      jacobian = 0.0_wp
      call self%move_to(x, is_possible)
      if (.not. is_possible) return                                   ! singular: the solver sees it
      associate (n => self%n_u)
         allocate (block(n, n))
         call self%balance%tangent(x(:n), block)
         jacobian(:n, :n) = block
         call self%find_energy_form(x)
         jacobian(n + 1:, :size(self%forms, 1)) = transpose(self%forms)
         call self%find_border(x, jacobian(:n, n + 1:))
         if (.not. allocated(self%is_held)) return
         do i = 1, n
            if (.not. self%is_held(i)) cycle
            jacobian(i, :) = 0.0_wp
            jacobian(i, i) = self%r_scale(i)/self%x_scale(i)
         end do
      end associate
   end subroutine phase_problem_tangent

   !> Derivatives of the residual by the further unknowns; zero where there are none.
   subroutine phase_problem_find_border(self, x, border)
      class(phase_problem_t), intent(inout) :: self
      real(wp), intent(in) :: x(:)
      real(wp), intent(out) :: border(:, :)                           !! (n_u, further unknowns)
      type(error_t), allocatable :: error
      real(wp) :: u(self%balance%harmonics%n_coefficients, self%balance%n_dofs)
      real(wp) :: column(self%balance%harmonics%n_coefficients, self%balance%n_dofs)
      integer :: i, n_tones

      border = 0.0_wp
      n_tones = size(self%tones)
      u = reshape(x(:self%n_u), shape(u))
      do i = 1, n_tones
         call self%balance%frequency_derivative(u, self%tones(i), column, error)
         if (.not. allocated(error)) border(:, i) = reshape(column, [self%n_u])
         if (.not. self%with_damping) cycle
         call self%balance%damping_derivative(u, self%tones(i), column, error)
         if (.not. allocated(error)) border(:, n_tones + i) = reshape(column, [self%n_u])
      end do
   end subroutine phase_problem_find_border

   !> The derivatives of the energy by all unknowns, as the last form; nothing without an energy.
   subroutine phase_problem_find_energy_form(self, x)
      class(phase_problem_t), intent(inout) :: self
      real(wp), intent(in) :: x(:)
      real(wp), allocatable :: by_omega(:), by_u(:, :), by_xi(:)

      if (.not. allocated(self%energy)) return
      call self%energy%differentiate(self%balance, reshape(x(:self%n_u), [self%balance%harmonics%n_coefficients, &
                                                                          self%balance%n_dofs]), by_u, by_omega, by_xi)
      self%forms(:, size(self%values)) = [by_u, by_omega(self%tones), by_xi(self%tones(:n_damped(self)))]
   end subroutine phase_problem_find_energy_form

   !> The linear part of the balance, and nothing that couples it to the further unknowns.
   subroutine phase_problem_solve_linear(self, r, step)
      class(phase_problem_t), intent(in) :: self
      real(wp), intent(in), contiguous :: r(:)
      real(wp), intent(out), contiguous :: step(:)

      associate (n => self%n_u)
         call self%balance%solve_linear(r(:n), step(:n))
         step(n + 1:) = r(n + 1:)*self%x_scale(n + 1:)/self%r_scale(n + 1:)
      end associate
   end subroutine phase_problem_solve_linear

   !> Rounding level of the balance, and what the condensation rounds anew at each frequency: units in the last place of the
   !> stiffness before the interior is eliminated.
   real(wp) function phase_problem_rounding_level(self, x)
      class(phase_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), parameter :: units = 64.0_wp                          ! elimination lets errors grow a little
      real(wp), parameter :: largest_level = 1.0e-6_wp
      real(wp) :: total
      integer :: h, i
      logical :: is_possible

      phase_problem_rounding_level = 0.0_wp
      call self%move_to(x, is_possible)
      if (.not. is_possible) return
      phase_problem_rounding_level = self%balance%rounding_level(x(:self%n_u))
      if (self%balance%stiffness%n_dofs == self%balance%n_dofs) return   ! no interior
      total = 0.0_wp
      associate (set => self%balance%harmonics, magnitude => self%balance%stiffness%magnitude)
         do i = 1, self%balance%n_dofs
            associate (first => (i - 1)*set%n_coefficients)
               do h = 1, set%n_harmonics
                  total = total + (magnitude(i, h)*x(first + set%cos_at(h))/self%r_scale(first + 1))**2
                  if (set%sin_at(h) == 0) cycle
                  total = total + (magnitude(i, h)*x(first + set%sin_at(h))/self%r_scale(first + 1))**2
               end do
            end associate
         end do
      end associate
      phase_problem_rounding_level = min(largest_level, phase_problem_rounding_level + units*epsilon(1.0_wp)*sqrt(total))
   end function phase_problem_rounding_level

   subroutine phase_problem_deform(self, kind, amount)
      class(phase_problem_t), intent(inout) :: self
      integer, intent(in) :: kind
      real(wp), intent(in) :: amount

      call self%balance%deform(kind, amount)
   end subroutine phase_problem_deform

   ! Linear forms of the coefficients

   !> Integral phase condition: the motion has no part along the shift of phase `tone` of a reference,
   !> sum_j j_m (b_ref a - a_ref b)/scale**2, divided by the same sum of the shift with itself.
   pure function shift_form(harmonics, tone, reference, scale) result(form)
      type(harmonics_t), intent(in) :: harmonics
      integer, intent(in) :: tone
      real(wp), intent(in) :: reference(:, :)                         !! [m], (n_coefficients, n_dofs)
      real(wp), intent(in) :: scale(:, :)                             !! of the coefficients [m], as reference
      real(wp) :: form(size(reference))
      real(wp) :: shift(size(reference, 1), size(reference, 2)), total
      integer :: h

      shift = 0.0_wp
      do h = 1, harmonics%n_harmonics
         associate (a => harmonics%cos_at(h), b => harmonics%sin_at(h), j => harmonics%tuples(tone, h))
            if (b == 0) cycle
            shift(a, :) = j*reference(b, :)/scale(a, :)
            shift(b, :) = -j*reference(a, :)/scale(b, :)
         end associate
      end do
      total = sum(shift**2)
      form = reshape(shift/scale, [size(reference)])
      if (total > 0.0_wp) form = form/total
   end function shift_form

   !> How much of a reference the part of the motion in one harmonic has; 1 for the reference itself.
   pure function amplitude_form(harmonics, h, reference, scale) result(form)
      type(harmonics_t), intent(in) :: harmonics
      integer, intent(in) :: h                                        !! harmonic, not the zero tuple
      real(wp), intent(in) :: reference(:, :)                         !! [m], (n_coefficients, n_dofs)
      real(wp), intent(in) :: scale(:, :)                             !! of the coefficients [m], as reference
      real(wp) :: form(size(reference))
      real(wp) :: part(size(reference, 1), size(reference, 2))

      part = 0.0_wp
      associate (a => harmonics%cos_at(h), b => harmonics%sin_at(h))
         part([a, b], :) = reference([a, b], :)/scale([a, b], :)
      end associate
      form = reshape(part/scale, [size(reference)])/sum(part**2)
   end function amplitude_form

   !> One coefficient of one degree of freedom.
   pure function coefficient_form(harmonics, n_dofs, place, dof) result(form)
      type(harmonics_t), intent(in) :: harmonics
      integer, intent(in) :: n_dofs
      integer, intent(in) :: place                                    !! one of harmonics%cos_at and sin_at
      integer, intent(in) :: dof                                      !! among those of the laws
      real(wp) :: form(harmonics%n_coefficients*n_dofs)

      form = 0.0_wp
      form((dof - 1)*harmonics%n_coefficients + place) = 1.0_wp
   end function coefficient_form

   !> Displacement of one degree of freedom where all phases are zero.
   pure function peak_form(harmonics, n_dofs, dof) result(form)
      type(harmonics_t), intent(in) :: harmonics
      integer, intent(in) :: n_dofs
      integer, intent(in) :: dof                                      !! among those of the laws
      real(wp) :: form(harmonics%n_coefficients*n_dofs)

      form = 0.0_wp
      form((dof - 1)*harmonics%n_coefficients + harmonics%cos_at) = 1.0_wp
   end function peak_form

   !> Derivative by phase `tone` of the displacement of one degree of freedom where all phases are zero.
   pure function peak_rate_form(harmonics, n_dofs, dof, tone) result(form)
      type(harmonics_t), intent(in) :: harmonics
      integer, intent(in) :: n_dofs
      integer, intent(in) :: dof                                      !! among those of the laws
      integer, intent(in) :: tone
      real(wp) :: form(harmonics%n_coefficients*n_dofs)
      integer :: h

      form = 0.0_wp
      do h = 1, harmonics%n_harmonics
         if (harmonics%sin_at(h) > 0) form((dof - 1)*harmonics%n_coefficients + harmonics%sin_at(h)) = harmonics%tuples(tone, h)
      end do
   end function peak_rate_form

   !> Shifts one phase of a motion: x(tau_m) becomes x(tau_m + angle).
   pure subroutine turn(harmonics, tone, angle, u)
      type(harmonics_t), intent(in) :: harmonics
      integer, intent(in) :: tone
      real(wp), intent(in) :: angle                                   !! [rad]
      real(wp), intent(inout) :: u(:, :)                              !! (n_coefficients, n_dofs)
      real(wp) :: before(size(u, 2))
      integer :: h

      do h = 1, harmonics%n_harmonics
         if (harmonics%sin_at(h) == 0) cycle
         associate (a => u(harmonics%cos_at(h), :), b => u(harmonics%sin_at(h), :), phi => harmonics%tuples(tone, h)*angle)
            before = a
            a = before*cos(phi) + b*sin(phi)
            b = b*cos(phi) - before*sin(phi)
         end associate
      end do
   end subroutine turn
end module hb_phase
