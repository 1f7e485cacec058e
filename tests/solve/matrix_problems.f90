!> Linear problems J x = b for the tests of GMRES: products with a given matrix, its diagonal as preconditioner.
module matrix_problems
   use hb_kinds, only: wp
   use hb_problem, only: problem_t
   implicit none
   private
   public :: matrix_problem_t, new_matrix_problem

   type, extends(problem_t) :: matrix_problem_t
      real(wp), allocatable :: matrix(:, :), rhs(:)                   !! (n_unknowns, n_unknowns), (n_unknowns)
      real(wp), allocatable :: weights(:)                             !! of the preconditioner, step = weights*r
      integer :: highest_level = 0                                    !! where the preconditioner becomes the inverse diagonal
   contains
      procedure :: residual => matrix_problem_residual
      procedure :: tangent => matrix_problem_tangent
      procedure :: linearise => matrix_problem_linearise
      procedure :: apply_tangent => matrix_problem_apply_tangent
      procedure :: update_preconditioner => matrix_problem_update_preconditioner
      procedure :: precondition => matrix_problem_precondition
      procedure :: solve_linear => matrix_problem_solve_linear
      procedure :: rounding_level => matrix_problem_rounding_level
      procedure :: deform => matrix_problem_deform
   end type matrix_problem_t

contains

   !> Problem with a square matrix, all scales 1 and no preconditioner.
   subroutine new_matrix_problem(self, matrix, rhs)
      type(matrix_problem_t), intent(out) :: self
      real(wp), intent(in) :: matrix(:, :), rhs(:)

      self%n_unknowns = size(rhs)
      self%has_products = .true.
      self%matrix = matrix
      self%rhs = rhs
      self%x_scale = 0.0_wp*rhs + 1.0_wp
      self%r_scale = self%x_scale
      self%weights = self%x_scale
   end subroutine new_matrix_problem

   subroutine matrix_problem_residual(self, x, r)
      class(matrix_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(out), contiguous :: r(:)

      r = matmul(self%matrix, x) - self%rhs
   end subroutine matrix_problem_residual

   subroutine matrix_problem_tangent(self, x, jacobian)
      class(matrix_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(out), contiguous :: jacobian(:, :)

      jacobian = self%matrix
   end subroutine matrix_problem_tangent

   subroutine matrix_problem_linearise(self, x, is_ready)
      class(matrix_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      logical, intent(out) :: is_ready

      is_ready = .true.
   end subroutine matrix_problem_linearise

   subroutine matrix_problem_apply_tangent(self, x, product)
      class(matrix_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(out), contiguous :: product(:)

      product = matmul(self%matrix, x)
   end subroutine matrix_problem_apply_tangent

   subroutine matrix_problem_update_preconditioner(self, level, is_strongest)
      class(matrix_problem_t), intent(inout) :: self
      integer, intent(in) :: level
      logical, intent(out) :: is_strongest
      integer :: i

      is_strongest = level >= self%highest_level
      if (is_strongest .and. self%highest_level > 0) self%weights = [(1.0_wp/self%matrix(i, i), i=1, self%n_unknowns)]
   end subroutine matrix_problem_update_preconditioner

   subroutine matrix_problem_precondition(self, r, step)
      class(matrix_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: r(:)
      real(wp), intent(out), contiguous :: step(:)

      step = self%weights*r
   end subroutine matrix_problem_precondition

   subroutine matrix_problem_solve_linear(self, r, step)
      class(matrix_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: r(:)
      real(wp), intent(out), contiguous :: step(:)

      step = self%weights*r
   end subroutine matrix_problem_solve_linear

   real(wp) function matrix_problem_rounding_level(self, x)
      class(matrix_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)

      matrix_problem_rounding_level = 4.0_wp*epsilon(1.0_wp)
   end function matrix_problem_rounding_level

   subroutine matrix_problem_deform(self, kind, amount)
      class(matrix_problem_t), intent(inout) :: self
      integer, intent(in) :: kind
      real(wp), intent(in) :: amount
   end subroutine matrix_problem_deform
end module matrix_problems
