!> Problems of two unknowns for the solvers' tests.
module small_problems
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_kinds, only: wp
   use hb_problem, only: deformation, problem_t
   implicit none
   private
   public :: new_small_problem, problem_kind, small_problem_t

   type :: problem_kind_t
      integer :: cubics = 1                                           !! x_i + x_i**3/2 + x_1 x_2/4 = b
      integer :: arctangent = 2                                       !! atan(x_i) = 0
      integer :: no_root = 3                                          !! x_i**2 + 1 = 0
      integer :: not_a_number = 4
      integer :: no_root_aside = 5                                    !! (x_i - 0.3)**2 + 1 = 0: a tangent at zero and at its shares
   end type problem_kind_t
   type(problem_kind_t), parameter :: problem_kind = problem_kind_t()

   real(wp), parameter :: aside = 0.3_wp

   type, extends(problem_t) :: small_problem_t
      integer :: kind = 0
      real(wp) :: root(2) = [0.5_wp, -0.25_wp]                        !! of the cubics
      real(wp) :: amount = 1.0_wp                                     !! of the nonlinear part
      real(wp) :: jacobian(2, 2) = 0.0_wp                             !! of the last `linearise`
   contains
      procedure :: residual => small_problem_residual
      procedure :: tangent => small_problem_tangent
      procedure :: linearise => small_problem_linearise
      procedure :: apply_tangent => small_problem_apply_tangent
      procedure :: solve_linear => small_problem_solve_linear
      procedure :: rounding_level => small_problem_rounding_level
      procedure :: deform => small_problem_deform
   end type small_problem_t

contains

   !> Problem of the given kind, in other units of its unknowns and equations if these are given.
   subroutine new_small_problem(self, kind, x_unit, r_unit)
      type(small_problem_t), intent(out) :: self
      integer, intent(in) :: kind
      real(wp), intent(in), optional :: x_unit(2), r_unit(2)

      self%kind = kind
      self%n_unknowns = 2
      self%has_products = .true.
      self%x_scale = [1.0_wp, 1.0_wp]
      self%r_scale = [1.0_wp, 1.0_wp]
      if (present(x_unit)) self%x_scale = x_unit
      if (present(r_unit)) self%r_scale = r_unit
   end subroutine new_small_problem

   subroutine small_problem_residual(self, x, r)
      class(small_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(out), contiguous :: r(:)
      real(wp) :: y(2)

      y = x/self%x_scale
      select case (self%kind)
      case (problem_kind%cubics)
         r = cubics(y) - cubics(self%root)
      case (problem_kind%arctangent)
         r = atan(y)
      case (problem_kind%no_root)
         r = y**2 + 1.0_wp
      case (problem_kind%no_root_aside)
         r = (y - aside)**2 + 1.0_wp
      case default
         r = ieee_value(1.0_wp, ieee_quiet_nan)
      end select
      r = r*self%r_scale
   end subroutine small_problem_residual

   pure function cubics(y) result(r)
      real(wp), intent(in) :: y(2)
      real(wp) :: r(2)

      r = y + 0.5_wp*y**3 + 0.25_wp*y(1)*y(2)
   end function cubics

   subroutine small_problem_tangent(self, x, jacobian)
      class(small_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(out), contiguous :: jacobian(:, :)
      real(wp) :: y(2)
      integer :: i

      y = x/self%x_scale
      jacobian = 0.0_wp
      select case (self%kind)
      case (problem_kind%cubics)
         jacobian(:, 1) = 0.25_wp*y(2)
         jacobian(:, 2) = 0.25_wp*y(1)
         do i = 1, 2
            jacobian(i, i) = jacobian(i, i) + 1.0_wp + 1.5_wp*y(i)**2
         end do
      case (problem_kind%arctangent)
         do i = 1, 2
            jacobian(i, i) = 1.0_wp/(1.0_wp + y(i)**2)
         end do
      case default
         if (self%kind == problem_kind%no_root_aside) y = y - aside
         do i = 1, 2
            jacobian(i, i) = 2.0_wp*y(i)
         end do
      end select
      do i = 1, 2
         jacobian(:, i) = jacobian(:, i)*self%r_scale/self%x_scale(i)
      end do
   end subroutine small_problem_tangent

   subroutine small_problem_linearise(self, x, is_ready)
      class(small_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      logical, intent(out) :: is_ready

      call self%tangent(x, self%jacobian)
      is_ready = .true.
   end subroutine small_problem_linearise

   subroutine small_problem_apply_tangent(self, x, product)
      class(small_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(out), contiguous :: product(:)

      product = matmul(self%jacobian, x)
   end subroutine small_problem_apply_tangent

   subroutine small_problem_solve_linear(self, r, step)
      class(small_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: r(:)
      real(wp), intent(out), contiguous :: step(:)

      step = r/self%r_scale*self%x_scale
   end subroutine small_problem_solve_linear

   subroutine small_problem_deform(self, kind, amount)
      class(small_problem_t), intent(inout) :: self
      integer, intent(in) :: kind
      real(wp), intent(in) :: amount

      if (kind == deformation%nonlinearity) self%amount = amount
   end subroutine small_problem_deform

   real(wp) function small_problem_rounding_level(self, x)
      class(small_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)

      small_problem_rounding_level = 4.0_wp*epsilon(1.0_wp)
   end function small_problem_rounding_level
end module small_problems
