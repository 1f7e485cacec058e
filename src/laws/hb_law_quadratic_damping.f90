!> Quadratic damping, f = c |v| v, the drag of a fluid.
!> Source: docs/why/theory.md, section 5.1. Sign: f stands beside K q on the left-hand side.
module hb_law_quadratic_damping
   use hb_kinds, only: wp
   use hb_law, only: law_t
   use hb_numbers, only: number_t, numbers_t
   implicit none
   private
   public :: quadratic_damping_t

   type, extends(law_t) :: quadratic_damping_t
      real(wp) :: coefficient = 0.0_wp                                !! c [N s**2/m**2]
   contains
      procedure :: declare_numbers => quadratic_damping_declare_numbers
      procedure :: derive => quadratic_damping_derive
      procedure :: number_slope => quadratic_damping_number_slope
      procedure :: evaluate => quadratic_damping_evaluate
      procedure :: switches => quadratic_damping_switches
      procedure :: evaluate_held => quadratic_damping_evaluate_held
   end type quadratic_damping_t

contains

   subroutine quadratic_damping_declare_numbers(self, numbers)
      class(quadratic_damping_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("coefficient", self%coefficient)
   end subroutine quadratic_damping_declare_numbers

   pure subroutine quadratic_damping_derive(self)
      class(quadratic_damping_t), intent(inout) :: self

      self%needs_velocity = .true.
      self%needs_displacement = .false.
      self%has_potential = .true.
      self%is_odd = .true.
      self%n_switches = 1
   end subroutine quadratic_damping_derive

   subroutine quadratic_damping_evaluate(self, z, v, p, f, df_dz, df_dv, df_dp)
      class(quadratic_damping_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)

      f = self%coefficient*abs(v)*v
      if (present(df_dz)) df_dz = 0.0_wp
      if (present(df_dv)) df_dv(:, :, 1) = 2.0_wp*self%coefficient*abs(v)
   end subroutine quadratic_damping_evaluate

   subroutine quadratic_damping_number_slope(self, number, z, v, p, slope, is_known)
      class(quadratic_damping_t), intent(in) :: self
      type(number_t), intent(in) :: number
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: slope(:, :)
      logical, intent(out) :: is_known

      is_known = .true.
      select case (number%key)
      case ("coefficient"); slope = abs(v)*v
      case default
         is_known = .false.
      end select
   end subroutine quadratic_damping_number_slope

   pure subroutine quadratic_damping_switches(self, z, v, values)
      class(quadratic_damping_t), intent(in) :: self
      real(wp), intent(in) :: z(:), v(:)
      real(wp), intent(out) :: values(:)

      values = v
   end subroutine quadratic_damping_switches

   subroutine quadratic_damping_evaluate_held(self, z, v, is_positive, f)
      class(quadratic_damping_t), intent(in) :: self
      real(wp), intent(in) :: z(:), v(:)
      logical, intent(in) :: is_positive(:)
      real(wp), intent(out) :: f(:)

      f = merge(self%coefficient, -self%coefficient, is_positive)*v**2
   end subroutine quadratic_damping_evaluate_held
end module hb_law_quadratic_damping
