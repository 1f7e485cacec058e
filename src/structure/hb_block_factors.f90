!> LU factors of many square complex blocks of one pattern, such as the dynamic stiffness of each harmonic.
module hb_block_factors
   use hb_block_pattern, only: block_pattern_t
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_lapack, only: zgbtrf, zgbtrs, zgetrf, zgetrs
   use hb_small_lu, only: factorise_small, largest_small, solve_small
   use hb_threads, only: n_threads
   implicit none
   private
   public :: block_factors_t, new_block_factors

   !> The factors of one block.
   type :: factors_t
      complex(wp), allocatable :: matrix(:, :)               ! (rows, n); a band with room for row exchanges
      integer, allocatable :: pivots(:)                      ! (n)
   end type factors_t

   type :: block_factors_t
      type(block_pattern_t), private :: pattern              ! of the blocks
      type(factors_t), allocatable, private :: blocks(:)     ! allocated as needed
      complex(wp), allocatable, private :: inverses(:)       ! instead of factors for n = 1
      logical, allocatable, private :: is_there(:)           ! (n_blocks)
   contains
      procedure :: are_there => block_factors_are_there
      procedure :: factorise => block_factors_factorise
      procedure :: forget => block_factors_forget
      procedure :: release => block_factors_release
      procedure :: solve => block_factors_solve
      procedure :: solve_harmonics => block_factors_solve_harmonics
   end type block_factors_t

contains

   !> Prepares for the factors of `n_blocks` blocks.
   subroutine new_block_factors(self, pattern, n_blocks)
      type(block_factors_t), intent(out) :: self
      type(block_pattern_t), intent(in) :: pattern
      integer, intent(in) :: n_blocks

      self%pattern = pattern
      allocate (self%is_there(n_blocks), source=.false.)
      if (pattern%n == 1) then
         allocate (self%inverses(n_blocks), source=(0.0_wp, 0.0_wp))
      else
         allocate (self%blocks(n_blocks))
      end if
   end subroutine new_block_factors

   !> Whether block h has been factorised.
   pure logical function block_factors_are_there(self, h) result(are_there)
      class(block_factors_t), intent(in) :: self
      integer, intent(in) :: h

      are_there = self%is_there(h)
   end function block_factors_are_there

   !> Discards all factors; their memory is retained.
   subroutine block_factors_forget(self)
      class(block_factors_t), intent(inout) :: self

      self%is_there = .false.
   end subroutine block_factors_forget

   !> Releases the memory of all factors.
   subroutine block_factors_release(self)
      class(block_factors_t), intent(inout) :: self

      if (allocated(self%blocks)) deallocate (self%blocks)
      if (allocated(self%inverses)) deallocate (self%inverses)
      if (allocated(self%is_there)) deallocate (self%is_there)
   end subroutine block_factors_release

   !> Factorises block h; `is_singular` if a pivot is exactly zero.
   subroutine block_factors_factorise(self, h, block, is_singular)
      class(block_factors_t), intent(inout) :: self
      integer, intent(in) :: h
      complex(wp), intent(in) :: block(:, :)                 !! (n_rows, n) as defined by the pattern
      logical, intent(out) :: is_singular
      integer :: info, n_rows

      if (self%pattern%n == 1) then
         is_singular = abs(block(1, 1)) <= 0.0_wp
         self%is_there(h) = .not. is_singular
         self%inverses(h) = (0.0_wp, 0.0_wp)
         if (.not. is_singular) self%inverses(h) = (1.0_wp, 0.0_wp)/block(1, 1)
         return
      end if
      associate (n => self%pattern%n, half_bandwidth => self%pattern%half_bandwidth, factors => self%blocks(h))
         n_rows = merge(3*half_bandwidth + 1, n, self%pattern%is_banded)
         if (.not. allocated(factors%matrix)) allocate (factors%matrix(n_rows, n), factors%pivots(n))
         if (self%pattern%is_banded) then
            factors%matrix(:half_bandwidth, :) = (0.0_wp, 0.0_wp)
            factors%matrix(half_bandwidth + 1:, :) = block
            call zgbtrf(n, n, half_bandwidth, half_bandwidth, factors%matrix, n_rows, factors%pivots, info)
            is_singular = info /= 0
         else if (n <= largest_small) then
            factors%matrix = block
            call factorise_small(factors%matrix, factors%pivots, is_singular)
         else
            factors%matrix = block
            call zgetrf(n, n, factors%matrix, n, factors%pivots, info)
            is_singular = info /= 0
         end if
      end associate
      self%is_there(h) = .not. is_singular
   end subroutine block_factors_factorise

   !> Overwrites b with the solution of block h.
   subroutine block_factors_solve(self, h, b)
      class(block_factors_t), intent(in) :: self
      integer, intent(in) :: h
      complex(wp), intent(inout), contiguous, target :: b(:) !! (n)
      complex(wp), pointer, contiguous :: column(:, :)
      integer :: info

      if (self%pattern%n == 1) then
         b(1) = self%inverses(h)*b(1)
         return
      end if
      associate (n => self%pattern%n, half_bandwidth => self%pattern%half_bandwidth, factors => self%blocks(h))
         if (self%pattern%is_banded) then
            call zgbtrs("N", n, half_bandwidth, half_bandwidth, 1, factors%matrix, size(factors%matrix, 1), factors%pivots, b, n, &
               info)
         else if (n <= largest_small) then
            column(1:n, 1:1) => b
            call solve_small(factors%matrix, factors%pivots, column)
         else
            call zgetrs("N", n, 1, factors%matrix, n, factors%pivots, b, n, info)
         end if
      end associate
   end subroutine block_factors_solve

   !> Solves for the coefficients of all harmonics, with block h for harmonic h; those without factors are zero.
   subroutine block_factors_solve_harmonics(self, set, r, x)
      class(block_factors_t), intent(in) :: self
      type(harmonics_t), intent(in) :: set
      real(wp), intent(in) :: r(set%n_coefficients, self%pattern%n)
      real(wp), intent(out) :: x(set%n_coefficients, self%pattern%n)
      integer :: h, n

      if (self%pattern%n == 1) then
         x = set%times(self%inverses, r)
         return
      end if
      n = n_threads(set%n_harmonics*self%pattern%n_rows*self%pattern%n)
      if (n == 1) then
         do h = 1, set%n_harmonics
            call solve_harmonic(self, set, h, r, x)
         end do
      else
         !$omp parallel do num_threads(n)
         do h = 1, set%n_harmonics
            call solve_harmonic(self, set, h, r, x)
         end do
      end if
   end subroutine block_factors_solve_harmonics

   subroutine solve_harmonic(self, set, h, r, x)
      type(block_factors_t), intent(in) :: self
      type(harmonics_t), intent(in) :: set
      integer, intent(in) :: h
      real(wp), intent(in) :: r(set%n_coefficients, self%pattern%n)
      real(wp), intent(inout) :: x(set%n_coefficients, self%pattern%n)
      complex(wp) :: c(self%pattern%n)
      integer :: i

      do i = 1, self%pattern%n
         c(i) = set%amplitude(r(:, i), h)
      end do
      if (self%is_there(h)) then
         call self%solve(h, c)
      else
         c = (0.0_wp, 0.0_wp)
      end if
      do i = 1, self%pattern%n
         call set%set_amplitude(x(:, i), h, c(i))
      end do
   end subroutine solve_harmonic
end module hb_block_factors
