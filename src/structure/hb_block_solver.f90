!> Linear equations with a square block of the dynamic stiffness at one frequency after the other.
!>
!> Narrow blocks are factored as band matrices, others as dense ones (LAPACK, with row exchanges). Rows and
!> columns are scaled once with the sizes on the diagonal, so that the verdict "singular" does not depend on
!> units.
module hb_block_solver
   use hb_kinds, only: wp
   use hb_lapack, only: zgbcon, zgbtrf, zgbtrs, zgecon, zgetrf, zgetrs
   use hb_structure_block, only: structure_block_t
   implicit none
   private
   public :: block_solver_t, new_block_solver

   !> Growth of the probe vector, relative to the matrix, above which the condition is estimated in earnest.
   real(wp), parameter :: suspicious_growth = 1.0e8_wp

   type :: block_solver_t
      integer :: n = 0                                                !! order of the block
      logical :: is_banded = .false.
      complex(wp), allocatable :: rhs(:, :)              !! (n, n_rhs + 1): right-hand sides in, solutions out
      integer, private :: n_lower = 0, n_upper = 0, n_rhs = 0
      type(structure_block_t), private :: entries                     !! scaled
      complex(wp), allocatable, private :: scale(:)          !! (n), real values, complex to multiply `rhs`
      complex(wp), allocatable, private :: matrix(:, :)               !! dense (n, n), or LAPACK band storage
      complex(wp), allocatable, private :: s(:), work(:)
      real(wp), allocatable, private :: magnitude(:), row_sum(:), real_work(:)
      integer, allocatable, private :: pivots(:)
   contains
      procedure :: solve => block_solver_solve
      procedure, private :: assemble => block_solver_assemble
   end type block_solver_t

contains

   !> Prepares a solver for `n_rhs` right-hand sides; `highest_frequency` only sets the scaling.
   subroutine new_block_solver(self, block, n, n_rhs, highest_frequency)
      type(block_solver_t), intent(out) :: self
      type(structure_block_t), intent(in) :: block                    !! square
      integer, intent(in) :: n, n_rhs
      real(wp), intent(in) :: highest_frequency                       !! [rad/s]
      real(wp), allocatable :: scale(:)
      integer :: e, n_rows

      self%n = n
      self%n_rhs = n_rhs
      self%entries = block
      allocate (self%s(block%n_entries), self%magnitude(block%n_entries))
      allocate (scale(n), source=1.0_wp)
      call block%magnitude(highest_frequency, self%magnitude)
      do e = 1, block%n_entries
         if (block%row(e) /= block%column(e) .or. .not. self%magnitude(e) > 0.0_wp) cycle
         scale(block%row(e)) = 1.0_wp/sqrt(self%magnitude(e))
      end do
      do e = 1, block%n_entries
         associate (factor => scale(block%row(e))*scale(block%column(e)))
            self%entries%mass(e) = factor*block%mass(e)
            self%entries%damping(e) = factor*block%damping(e)
            self%entries%stiffness(e) = factor*block%stiffness(e)
         end associate
      end do

      self%scale = cmplx(scale, kind=wp)

      self%n_lower = max(0, maxval(block%row - block%column))
      self%n_upper = max(0, maxval(block%column - block%row))
      n_rows = 2*self%n_lower + self%n_upper + 1                      ! LAPACK keeps room for row exchanges
      self%is_banded = 2*n_rows <= n
      if (.not. self%is_banded) n_rows = max(1, n)
      allocate (self%matrix(n_rows, n), self%rhs(n, n_rhs + 1), self%pivots(n))
      allocate (self%work(2*n), self%real_work(2*n), self%row_sum(n))
   end subroutine new_block_solver

   !> Solves S(frequency) X = rhs(:, 1:n_rhs) in place, and tells how close S is to a singular matrix.
   !>
   !> The last column of `rhs` is a probe: a vector of no particular direction. Only when it grows much is
   !> LAPACK's estimate of the condition called, which costs more than factors and solution together.
   subroutine block_solver_solve(self, frequency, reciprocal_condition)
      class(block_solver_t), intent(inout) :: self
      real(wp), intent(in) :: frequency                               !! [rad/s]
      real(wp), intent(out) :: reciprocal_condition          !! from 0, singular (rhs is undefined then), to 1
      real(wp) :: norm
      integer :: i, info

      reciprocal_condition = 1.0_wp
      if (self%n == 0) return
      call self%assemble(frequency, norm)
      reciprocal_condition = 0.0_wp
      associate (n => self%n, kl => self%n_lower, ku => self%n_upper, a => self%matrix, b => self%rhs, &
                 lda => size(self%matrix, 1), probe => self%n_rhs + 1)
         if (self%is_banded) then
            call zgbtrf(n, n, kl, ku, a, lda, self%pivots, info)
         else
            call zgetrf(n, n, a, lda, self%pivots, info)
         end if
         if (info > 0) return

         do i = 1, self%n_rhs
            b(:, i) = self%scale*b(:, i)
         end do
         do i = 1, n
            b(i, probe) = cmplx(cos(real(i, wp)), kind=wp)
         end do
         if (self%is_banded) then
            call zgbtrs("N", n, kl, ku, probe, a, lda, self%pivots, b, n, info)
         else
            call zgetrs("N", n, probe, a, lda, self%pivots, b, n, info)
         end if

         reciprocal_condition = 1.0_wp/max(1.0_wp, norm*maxval(abs(real(b(:, probe))) &
                                                               + abs(aimag(b(:, probe)))))
         if (reciprocal_condition*suspicious_growth < 1.0_wp) then
            if (self%is_banded) then
               call zgbcon("I", n, kl, ku, a, lda, self%pivots, norm, reciprocal_condition, &
                           self%work, self%real_work, info)
            else
               call zgecon("I", n, a, lda, norm, reciprocal_condition, self%work, self%real_work, info)
            end if
         end if
         do i = 1, self%n_rhs
            b(:, i) = self%scale*b(:, i)
         end do
      end associate
   end subroutine block_solver_solve

   !> Fills the matrix; `norm` is the largest row sum of the terms of S before they cancel each other.
   subroutine block_solver_assemble(self, frequency, norm)
      class(block_solver_t), intent(inout) :: self
      real(wp), intent(in) :: frequency
      real(wp), intent(out) :: norm
      integer :: e, shift

      call self%entries%evaluate(frequency, self%s)
      call self%entries%magnitude(frequency, self%magnitude)
      self%matrix = (0.0_wp, 0.0_wp)
      self%row_sum = 0.0_wp
      shift = self%n_lower + self%n_upper + 1
      associate (row => self%entries%row, column => self%entries%column)
         if (self%is_banded) then
            do e = 1, self%entries%n_entries
               self%matrix(shift + row(e) - column(e), column(e)) = self%s(e)
            end do
         else
            do e = 1, self%entries%n_entries
               self%matrix(row(e), column(e)) = self%s(e)
            end do
         end if
         do e = 1, self%entries%n_entries
            self%row_sum(row(e)) = self%row_sum(row(e)) + self%magnitude(e)
         end do
      end associate
      norm = maxval(self%row_sum)
   end subroutine block_solver_assemble
end module hb_block_solver
