!> The tangent of a problem, scaled to unit magnitudes and LU factorised by LAPACK.
module hb_tangent_factor
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_kinds, only: wp
   use hb_lapack, only: dgetrf, dgetrs
   use hb_problem, only: problem_t
   implicit none
   private
   public :: new_tangent_factor, tangent_factor_t

   type :: tangent_factor_t
      real(wp), allocatable, private :: jacobian(:, :)
      integer, allocatable, private :: pivots(:)
   contains
      procedure :: update => tangent_factor_update
      procedure :: solve => tangent_factor_solve
      procedure :: solve_transposed => tangent_factor_solve_transposed
      procedure :: determinant_sign => tangent_factor_determinant_sign
   end type tangent_factor_t

contains

   !> Allocates memory for `n` unknowns.
   subroutine new_tangent_factor(self, n)
      type(tangent_factor_t), intent(out) :: self
      integer, intent(in) :: n

      allocate (self%jacobian(n, n), self%pivots(n))
   end subroutine new_tangent_factor

   !> Factorises the tangent at x; `is_singular` if it has no inverse or is not finite.
   subroutine tangent_factor_update(self, problem, x, is_singular)
      class(tangent_factor_t), intent(inout) :: self
      class(problem_t), intent(inout) :: problem
      real(wp), intent(in), contiguous :: x(:)                        !! (n_unknowns)
      logical, intent(out) :: is_singular
      real(wp) :: row_factor(size(x)), size_of_all
      integer :: i, info, n

      n = problem%n_unknowns
      call problem%tangent(x, self%jacobian)
      row_factor = 1.0_wp/problem%r_scale
      size_of_all = 0.0_wp
      do i = 1, n
         self%jacobian(:, i) = self%jacobian(:, i)*(problem%x_scale(i)*row_factor)
         size_of_all = size_of_all + sum(abs(self%jacobian(:, i)))
      end do
      is_singular = .not. ieee_is_finite(size_of_all)
      if (is_singular) return                                         ! NaN must not reach LAPACK if exceptions stop it
      call dgetrf(n, n, self%jacobian, n, self%pivots, info)
      is_singular = info /= 0
   end subroutine tangent_factor_update

   !> Sign of the determinant of the tangent, 1 or -1, after an `update` that was not singular.
   pure real(wp) function tangent_factor_determinant_sign(self)
      class(tangent_factor_t), intent(in) :: self
      integer :: i

      tangent_factor_determinant_sign = 1.0_wp
      do i = 1, size(self%pivots)
         if (self%jacobian(i, i) < 0.0_wp .neqv. self%pivots(i) /= i) &
            tangent_factor_determinant_sign = -tangent_factor_determinant_sign
      end do
   end function tangent_factor_determinant_sign

   !> Overwrites r with the solution s of tangent s = r.
   subroutine tangent_factor_solve(self, problem, r)
      class(tangent_factor_t), intent(in) :: self
      class(problem_t), intent(in) :: problem
      real(wp), intent(inout), contiguous :: r(:)                     !! (n_unknowns)
      integer :: info, n

      n = problem%n_unknowns
      r = r/problem%r_scale
      call dgetrs("N", n, 1, self%jacobian, n, self%pivots, r, n, info)
      r = r*problem%x_scale
   end subroutine tangent_factor_solve

   !> Overwrites r with the solution s of transpose(tangent) s = r.
   subroutine tangent_factor_solve_transposed(self, problem, r)
      class(tangent_factor_t), intent(in) :: self
      class(problem_t), intent(in) :: problem
      real(wp), intent(inout), contiguous :: r(:)                     !! (n_unknowns)
      integer :: info, n

      n = problem%n_unknowns
      r = r*problem%x_scale
      call dgetrs("T", n, 1, self%jacobian, n, self%pivots, r, n, info)
      r = r/problem%r_scale
   end subroutine tangent_factor_solve_transposed
end module hb_tangent_factor
