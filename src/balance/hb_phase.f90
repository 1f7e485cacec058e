!> The balance with unknown base frequencies: x = (u, omega of the unknown tones, and if requested, artificial
!> damping).
!> Each additional unknown has one equation, a linear functional of the coefficients u with a given value: phase
!> conditions, which select one of the motions that differ only by a shift of an unknown phase, and amplitudes. The
!> last one may be an energy instead. Source: docs/why/theory.md, section 6.5.
module hb_phase
   use hb_balance, only: balance_t
   use hb_bordered, only: bordered_problem_t, new_bordered_problem, row_t
   use hb_energy, only: energy_t
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_problem, only: problem_t
   implicit none
   private
   public :: amplitude_functional, coefficient_functional, energy_row_t, new_phase_problem, peak_functional, &
      peak_rate_functional, phase_problem_t, &
      shift_functional

   type, extends(bordered_problem_t) :: phase_problem_t
      integer, allocatable :: tones(:)                                !! the unknown ones
      integer :: peak_dof = 0                                         !! degree of freedom for which the functionals are rate
                                                                      !! and value of its displacement at zero phases, for a
                                                                      !! series of any length; 0: they are not
   contains
      procedure :: added_residual => phase_problem_added_residual
      procedure :: hold_above => phase_problem_hold_above
   end type phase_problem_t

   !> The energy of a motion as a function of all unknowns; on a curve over the energy, relative to the varied value.
   type, extends(row_t) :: energy_row_t
      type(energy_t) :: energy
      integer, allocatable :: which(:)                                ! parameters of the balance among the unknowns; another one
                                                                      ! is none of its own
      logical :: is_relative = .false.                                ! to the last unknown
   contains
      procedure :: value => energy_row_value
      procedure :: gradient => energy_row_gradient
   end type energy_row_t

contains

   !> Creates the problem for a balance whose stiffness has slopes. Its scales are those of the balance, frequencies
   !> are scaled by their present values. There must be as many functionals as additional unknowns.
   subroutine new_phase_problem(self, balance, tones, with_damping, functionals, values, energy)
      type(phase_problem_t), intent(out) :: self
      type(balance_t), intent(inout), target :: balance
      integer, intent(in) :: tones(:)                                 !! unknown ones
      logical, intent(in) :: with_damping                             !! their artificial damping is unknown too
      real(wp), intent(in) :: functionals(:, :)                       !! (coefficients of all dofs, or all unknowns; equations
                                                                      !! added)
      real(wp), intent(in) :: values(:)                               !! (further unknowns)
      type(energy_t), intent(in), optional :: energy                  !! for the last value; its functional is arbitrary
      integer, allocatable :: which(:)

      self%tones = tones
      which = tones
      if (with_damping) which = [tones, size(balance%omega) + tones]
      if (present(energy)) then
         call new_bordered_problem(self%bordered_problem_t, balance, which, functionals, values, energy_row_t(energy, which))
      else
         call new_bordered_problem(self%bordered_problem_t, balance, which, functionals, values)
      end if
   end subroutine new_phase_problem

   !> Fixes the coefficients of all harmonics with sum |j_m| > order at zero: the problem of a smaller set, in the
   !> same vector. An order of the whole set or above releases all.
   pure subroutine phase_problem_hold_above(self, harmonics, order)
      class(phase_problem_t), intent(inout) :: self
      type(harmonics_t), intent(in) :: harmonics                      !! of the balance
      integer, intent(in) :: order
      logical :: is_high(harmonics%n_coefficients)
      integer :: h, i

      if (allocated(self%is_held)) deallocate (self%is_held)
      do h = 1, harmonics%n_harmonics
         is_high(harmonics%cos_at(h)) = sum(abs(harmonics%tuples(:, h))) > order
         if (harmonics%sin_at(h) > 0) is_high(harmonics%sin_at(h)) = is_high(harmonics%cos_at(h))
      end do
      if (any(is_high)) self%is_held = [(is_high, i=1, self%n_base/size(is_high))]
   end subroutine phase_problem_hold_above

   !> Residual of the additional equations for a motion in a wider set: peaks and energies have a part outside the set
   !> of the problem, which its functionals do not contain; others have none.
   function phase_problem_added_residual(self, wide, motion) result(r)
      class(phase_problem_t), intent(in) :: self
      type(balance_t), intent(inout), target :: wide                  !! at the frequencies of the balance
      real(wp), intent(in) :: motion(:, :)                            !! [m], (n_coefficients of the wider set, n_dofs)
      real(wp) :: r(size(self%values))

      r = 0.0_wp
      if (self%peak_dof > 0) then
         r(1) = dot_product(peak_rate_functional(wide%harmonics, wide%n_dofs, self%peak_dof, self%tones(1)), &
                            reshape(motion, [size(motion)])) - self%values(1)
         r(2) = dot_product(peak_functional(wide%harmonics, wide%n_dofs, self%peak_dof), reshape(motion, [size(motion)])) &
                - self%values(2)
      end if
      if (allocated(self%row)) r(size(r)) = self%row%value(wide, [motion]) - self%values(size(r))
   end function phase_problem_added_residual

   real(wp) function energy_row_value(self, base, x)
      class(energy_row_t), intent(in) :: self
      class(problem_t), intent(inout) :: base
      real(wp), intent(in) :: x(:)

      energy_row_value = 0.0_wp
      select type (base)
      class is (balance_t)
         energy_row_value = self%energy%value(base, reshape(x(:base%n_unknowns), [base%harmonics%n_coefficients, base%n_dofs]))
      end select
      if (self%is_relative) energy_row_value = energy_row_value/x(size(x))
   end function energy_row_value

   subroutine energy_row_gradient(self, base, x, gradient)
      class(energy_row_t), intent(in) :: self
      class(problem_t), intent(inout) :: base
      real(wp), intent(in) :: x(:)
      real(wp), intent(out) :: gradient(:)
      real(wp), allocatable :: by_omega(:), by_u(:, :), by_xi(:), by_parameter(:)

      gradient = 0.0_wp
      select type (base)
      class is (balance_t)
         call self%energy%differentiate(base, reshape(x(:base%n_unknowns), [base%harmonics%n_coefficients, base%n_dofs]), by_u, &
                                        by_omega, by_xi)
         by_parameter = [by_omega, by_xi, 0.0_wp]
         gradient = [by_u, by_parameter(self%which)]
      end select
      if (.not. self%is_relative) return
      gradient = gradient/x(size(x))
      gradient(size(x)) = -self%value(base, x)/x(size(x))
   end subroutine energy_row_gradient

   ! Linear functionals of the coefficients

   !> Integral phase condition: the motion has no component along the shift of phase `tone` of a reference, sum_j j_m
   !> (b_ref a - a_ref b)/scale**2, divided by the same sum of the shift with itself.
   pure function shift_functional(harmonics, tone, reference, scale) result(functional)
      type(harmonics_t), intent(in) :: harmonics
      integer, intent(in) :: tone
      real(wp), intent(in) :: reference(:, :)                         !! [m], (n_coefficients, n_dofs)
      real(wp), intent(in) :: scale(:, :)                             !! of the coefficients [m], as reference
      real(wp) :: functional(size(reference))
      real(wp) :: shift(size(reference, 1), size(reference, 2)), total

      shift = harmonics%times(cmplx(0.0_wp, harmonics%tuples(tone, :), wp), reference)/scale
      total = sum(shift**2)
      functional = reshape(shift/scale, [size(reference)])
      if (total > 0.0_wp) functional = functional/total
   end function shift_functional

   !> Amplitude of the motion in one harmonic along a reference; 1 for the reference itself.
   pure function amplitude_functional(harmonics, h, reference, scale) result(functional)
      type(harmonics_t), intent(in) :: harmonics
      integer, intent(in) :: h                                        !! harmonic, not the zero tuple
      real(wp), intent(in) :: reference(:, :)                         !! [m], (n_coefficients, n_dofs)
      real(wp), intent(in) :: scale(:, :)                             !! of the coefficients [m], as reference
      real(wp) :: functional(size(reference))
      real(wp) :: part(size(reference, 1), size(reference, 2))

      part = 0.0_wp
      associate (a => harmonics%cos_at(h), b => harmonics%sin_at(h))
         part([a, b], :) = reference([a, b], :)/scale([a, b], :)
      end associate
      functional = reshape(part/scale, [size(reference)])/sum(part**2)
   end function amplitude_functional

   !> One coefficient of one degree of freedom.
   pure function coefficient_functional(harmonics, n_dofs, position, dof) result(functional)
      type(harmonics_t), intent(in) :: harmonics
      integer, intent(in) :: n_dofs
      integer, intent(in) :: position                                 !! one of harmonics%cos_at and sin_at
      integer, intent(in) :: dof                                      !! among those of the laws
      real(wp) :: functional(harmonics%n_coefficients*n_dofs)

      functional = 0.0_wp
      functional((dof - 1)*harmonics%n_coefficients + position) = 1.0_wp
   end function coefficient_functional

   !> Displacement of one degree of freedom at zero phases.
   pure function peak_functional(harmonics, n_dofs, dof) result(functional)
      type(harmonics_t), intent(in) :: harmonics
      integer, intent(in) :: n_dofs
      integer, intent(in) :: dof                                      !! among those of the laws
      real(wp) :: functional(harmonics%n_coefficients*n_dofs)

      functional = 0.0_wp
      functional((dof - 1)*harmonics%n_coefficients + harmonics%cos_at) = 1.0_wp
   end function peak_functional

   !> Derivative by phase `tone` of the displacement of one degree of freedom at zero phases.
   pure function peak_rate_functional(harmonics, n_dofs, dof, tone) result(functional)
      type(harmonics_t), intent(in) :: harmonics
      integer, intent(in) :: n_dofs
      integer, intent(in) :: dof                                      !! among those of the laws
      integer, intent(in) :: tone
      real(wp) :: functional(harmonics%n_coefficients*n_dofs)
      integer :: h

      functional = 0.0_wp
      do h = 1, harmonics%n_harmonics
         if (harmonics%sin_at(h) > 0) &
            functional((dof - 1)*harmonics%n_coefficients + harmonics%sin_at(h)) = harmonics%tuples(tone, h)
      end do
   end function peak_rate_functional
end module hb_phase
