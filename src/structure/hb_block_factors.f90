!> LU factors of many square complex blocks of one pattern, such as the dynamic stiffness of each harmonic.
module hb_block_factors
   use hb_block_pattern, only: block_pattern_t
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_lapack, only: zgbtrf, zgbtrs, zgetrf, zgetrs
   implicit none
   private
   public :: block_factors_t, new_block_factors

   type :: block_factors_t
      type(block_pattern_t), private :: pattern              ! of the blocks
      complex(wp), allocatable, private :: matrix(:, :, :)   ! (rows, n, n_blocks); a band with room for row exchanges;
                                                             ! for n = 1 the inverse
      integer, allocatable, private :: pivots(:, :)          ! (n, n_blocks)
   contains
      procedure :: factorise => block_factors_factorise
      procedure :: solve => block_factors_solve
      procedure :: solve_harmonics => block_factors_solve_harmonics
   end type block_factors_t

contains

   !> Makes room for the factors of `n_blocks` blocks.
   subroutine new_block_factors(self, pattern, n_blocks)
      type(block_factors_t), intent(out) :: self
      type(block_pattern_t), intent(in) :: pattern
      integer, intent(in) :: n_blocks
      integer :: n_rows

      self%pattern = pattern
      n_rows = max(1, pattern%n_rows)
      if (pattern%is_banded) n_rows = 3*pattern%reach + 1
      allocate (self%matrix(n_rows, pattern%n, n_blocks), self%pivots(pattern%n, n_blocks))
   end subroutine new_block_factors

   !> Factorises block h; `is_singular` where a pivot is exactly zero.
   subroutine block_factors_factorise(self, h, block, is_singular)
      class(block_factors_t), intent(inout) :: self
      integer, intent(in) :: h
      complex(wp), intent(in) :: block(:, :)                 !! (n_rows, n) as the pattern says
      logical, intent(out) :: is_singular
      integer :: info

      associate (n => self%pattern%n, reach => self%pattern%reach, n_rows => size(self%matrix, 1))
         if (n == 1) then
            info = merge(1, 0, abs(block(1, 1)) <= 0.0_wp)
            self%matrix(1, 1, h) = (0.0_wp, 0.0_wp)
            if (info == 0) self%matrix(1, 1, h) = (1.0_wp, 0.0_wp)/block(1, 1)
         else if (self%pattern%is_banded) then
            self%matrix(:reach, :, h) = (0.0_wp, 0.0_wp)
            self%matrix(reach + 1:, :, h) = block
            call zgbtrf(n, n, reach, reach, self%matrix(:, :, h), n_rows, self%pivots(:, h), info)
         else
            self%matrix(:n, :, h) = block
            call zgetrf(n, n, self%matrix(:, :, h), n_rows, self%pivots(:, h), info)
         end if
      end associate
      is_singular = info /= 0
   end subroutine block_factors_factorise

   !> Overwrites b with the solution of block h.
   subroutine block_factors_solve(self, h, b)
      class(block_factors_t), intent(in) :: self
      integer, intent(in) :: h
      complex(wp), intent(inout), contiguous :: b(:)         !! (n)
      integer :: info

      associate (n => self%pattern%n, reach => self%pattern%reach, n_rows => size(self%matrix, 1))
         if (n == 1) then
            b(1) = self%matrix(1, 1, h)*b(1)
         else if (self%pattern%is_banded) then
            call zgbtrs("N", n, reach, reach, 1, self%matrix(:, :, h), n_rows, self%pivots(:, h), b, n, info)
         else
            call zgetrs("N", n, 1, self%matrix(:, :, h), n_rows, self%pivots(:, h), b, n, info)
         end if
      end associate
   end subroutine block_factors_solve

   !> Solves for the coefficients of all harmonics, with block h for harmonic h.
   subroutine block_factors_solve_harmonics(self, set, r, x)
      class(block_factors_t), intent(in) :: self
      type(harmonics_t), intent(in) :: set
      real(wp), intent(in) :: r(set%n_coefficients, self%pattern%n)
      real(wp), intent(out) :: x(set%n_coefficients, self%pattern%n)
      complex(wp) :: c(self%pattern%n)
      integer :: h, i

      if (self%pattern%n == 1) then
         call scale_harmonics(set, self%matrix(1, 1, :), r(:, 1), x(:, 1))
         return
      end if
      do h = 1, set%n_harmonics
         do i = 1, self%pattern%n
            c(i) = set%amplitude(r(:, i), h)
         end do
         call self%solve(h, c)
         do i = 1, self%pattern%n
            call set%set_amplitude(x(:, i), h, c(i))
         end do
      end do
   end subroutine block_factors_solve_harmonics

   !> Multiplies the amplitudes of one degree of freedom by a factor each.
   pure subroutine scale_harmonics(set, factor, r, x)
      type(harmonics_t), intent(in) :: set
      complex(wp), intent(in) :: factor(:)                   !! (n_harmonics)
      real(wp), intent(in) :: r(:)                           !! (n_coefficients)
      real(wp), intent(out) :: x(:)                          !! as r
      integer :: h

      do h = 1, set%n_harmonics
         associate (c => set%cos_at(h), s => set%sin_at(h), a => real(factor(h)), b => aimag(factor(h)))
            if (s > 0) then                                  ! (a + i b) (r_c - i r_s)
               x(c) = a*r(c) + b*r(s)
               x(s) = a*r(s) - b*r(c)
            else
               x(c) = a*r(c)
            end if
         end associate
      end do
   end subroutine scale_harmonics
end module hb_block_factors
