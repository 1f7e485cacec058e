!> Problems of two unknowns with a parameter, whose curves are known: r1 = p - f(x1), r2 = x2 - x1/2.
module curve_problems
   use hb_kinds, only: wp
   use hb_problem, only: problem_t
   implicit none
   private
   public :: curve_kind, new_parametric, parametric_t

   type :: curve_kind_t
      integer :: folded = 1                                           !! f = x**3 - 3 x: folds at x = -1 and 1, where p = 2 and -2
      integer :: kinked = 2                                           !! f = 10 |x|: a corner of less than a right angle at x = 0
      integer :: hidden = 4                                           !! as `kinked`, but straight on behind the corner, beside
                                                                      !! the curve at p < -3e-4, r2 has another piece
      integer :: way = 3                                              !! r1 = -t + amount/(t**2 - 3 t + 2.35), t = easy - x1
   end type curve_kind_t
   type(curve_kind_t), parameter :: curve_kind = curve_kind_t()
   real(wp), parameter :: hidden_from = 3.0e-4_wp

   type, extends(problem_t) :: parametric_t
      integer :: kind = 0
      real(wp) :: p = 0.0_wp
      real(wp) :: amount = 1.0_wp                                     !! of the nonlinear part
      real(wp) :: easy = 3.0_wp                                       !! where a way begins
      real(wp) :: jacobian(2, 2) = 0.0_wp                             !! of the last `linearise`
   contains
      procedure :: residual => parametric_residual
      procedure :: tangent => parametric_tangent
      procedure :: linearise => parametric_linearise
      procedure :: apply_tangent => parametric_apply_tangent
      procedure :: solve_linear => parametric_solve_linear
      procedure :: rounding_level => parametric_rounding_level
      procedure :: deform => parametric_deform
      procedure :: parameters => parametric_parameters
      procedure :: set_parameters => parametric_set_parameters
      procedure :: parameter_derivative => parametric_derivative
   end type parametric_t

   ! A way of a homotopy keeps what the abstract problem has for it.
   type, extends(parametric_t), public :: deformed_t
   contains
      procedure :: parameters => deformed_parameters
      procedure :: set_parameters => deformed_set_parameters
      procedure :: parameter_derivative => deformed_derivative
   end type deformed_t

contains

   subroutine new_parametric(self, kind)
      class(parametric_t), intent(inout) :: self
      integer, intent(in) :: kind                                     !! one of curve_kind

      self%kind = kind
      self%n_unknowns = 2
      self%has_products = .true.
      self%x_scale = [1.0_wp, 1.0_wp]
      self%r_scale = [1.0_wp, 1.0_wp]
   end subroutine new_parametric

   subroutine parametric_residual(self, x, r)
      class(parametric_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(out), contiguous :: r(:)

      select case (self%kind)
      case (curve_kind%folded); r(1) = self%p - (x(1)**3 - 3.0_wp*x(1))
      case (curve_kind%kinked, curve_kind%hidden); r(1) = self%p - 10.0_wp*abs(x(1))
      case default; r(1) = x(1) - self%easy + self%amount/denominator(self%easy - x(1))
      end select
      r(2) = x(2) - 0.5_wp*x(1)
      if (self%kind == curve_kind%hidden) r(2) = r(2) - 30.0_wp*max(0.0_wp, -self%p - hidden_from)
   end subroutine parametric_residual

   subroutine parametric_tangent(self, x, jacobian)
      class(parametric_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(out), contiguous :: jacobian(:, :)

      jacobian(1, :) = 0.0_wp
      select case (self%kind)
      case (curve_kind%folded); jacobian(1, 1) = 3.0_wp - 3.0_wp*x(1)**2
      case (curve_kind%kinked, curve_kind%hidden); jacobian(1, 1) = -sign(10.0_wp, x(1))
      case default; jacobian(1, 1) = 1.0_wp + self%amount*(2.0_wp*(self%easy - x(1)) - 3.0_wp)/ &
                                       denominator(self%easy - x(1))**2
      end select
      jacobian(2, :) = [-0.5_wp, 1.0_wp]
   end subroutine parametric_tangent

   pure real(wp) function denominator(t)
      real(wp), intent(in) :: t

      denominator = t**2 - 3.0_wp*t + 2.35_wp
   end function denominator

   subroutine parametric_linearise(self, x, is_ready)
      class(parametric_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      logical, intent(out) :: is_ready

      call self%tangent(x, self%jacobian)
      is_ready = .true.
   end subroutine parametric_linearise

   subroutine parametric_apply_tangent(self, x, product)
      class(parametric_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(out), contiguous :: product(:)

      product = matmul(self%jacobian, x)
   end subroutine parametric_apply_tangent

   subroutine parametric_solve_linear(self, r, step)
      class(parametric_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: r(:)
      real(wp), intent(out), contiguous :: step(:)

      step = r
   end subroutine parametric_solve_linear

   real(wp) function parametric_rounding_level(self, x) result(level)
      class(parametric_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)

      level = 10.0_wp*epsilon(1.0_wp)*(1.0_wp + norm2(x))
   end function parametric_rounding_level

   subroutine parametric_deform(self, kind, amount)
      class(parametric_t), intent(inout) :: self
      integer, intent(in) :: kind
      real(wp), intent(in) :: amount

      if (kind > 0) self%amount = amount
   end subroutine parametric_deform

   pure function parametric_parameters(self, which) result(values)
      class(parametric_t), intent(in) :: self
      integer, intent(in) :: which(:)
      real(wp) :: values(size(which))

      values = self%p
   end function parametric_parameters

   subroutine parametric_set_parameters(self, which, values, is_possible)
      class(parametric_t), intent(inout) :: self
      integer, intent(in) :: which(:)
      real(wp), intent(in) :: values(:)
      logical, intent(out) :: is_possible

      is_possible = size(which) == 1
      if (is_possible) self%p = values(1)
   end subroutine parametric_set_parameters

   subroutine parametric_derivative(self, x, which, derivative)
      class(parametric_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      integer, intent(in) :: which
      real(wp), intent(out), contiguous :: derivative(:)

      derivative = [real(which, wp), 0.0_wp]
      if (self%kind == curve_kind%hidden .and. self%p < -hidden_from) derivative(2) = 30.0_wp
   end subroutine parametric_derivative

   pure function deformed_parameters(self, which) result(values)
      use hb_problem, only: deformation_positions
      class(deformed_t), intent(in) :: self
      integer, intent(in) :: which(:)
      real(wp) :: values(size(which))

      values = deformation_positions(self, which)
   end function deformed_parameters

   subroutine deformed_set_parameters(self, which, values, is_possible)
      use hb_problem, only: set_deformations
      class(deformed_t), intent(inout) :: self
      integer, intent(in) :: which(:)
      real(wp), intent(in) :: values(:)
      logical, intent(out) :: is_possible

      call set_deformations(self, which, values, is_possible)
   end subroutine deformed_set_parameters

   subroutine deformed_derivative(self, x, which, derivative)
      use hb_problem, only: deformation_derivative
      class(deformed_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      integer, intent(in) :: which
      real(wp), intent(out), contiguous :: derivative(:)

      call deformation_derivative(self, x, which, derivative)
   end subroutine deformed_derivative
end module curve_problems
