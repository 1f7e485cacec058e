!> LU factors of many square complex blocks of one pattern, such as the dynamic stiffness of each harmonic.
!>
!> Of large dense blocks whose solutions are corrected by iterations the factors are in single precision: half of the memory and of
!> the time.
module hb_block_factors
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_band_factors, only: factorise_band, solve_band
   use hb_block_pattern, only: block_pattern_t
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: sp, wp
   use hb_lapack, only: cgetrf, cgetrs, zgetrf, zgetrs
   use hb_small_lu, only: factorise_small, largest_small, solve_small
   use hb_threads, only: n_threads
   use hb_underflow, only: restore_underflow, underflow_to_zero
   implicit none
   private
   public :: block_factors_t, least_rough, new_block_factors

   integer, parameter :: least_rough = 200                   !! order of a dense block; smaller ones take a few MB

   !> The factors of one block.
   type :: factors_t
      complex(wp), allocatable :: matrix(:, :)               ! (rows, n); a band with room for row exchanges
      complex(sp), allocatable :: rough(:, :)                ! or in single precision, in units of the largest entry
      real(wp) :: unit = 1.0_wp                              ! of `rough`, > 0
      integer, allocatable :: pivots(:)                      ! (n)
   end type factors_t

   type :: block_factors_t
      type(block_pattern_t), private :: pattern              ! of the blocks
      type(factors_t), allocatable, private :: blocks(:)     ! allocated as needed
      complex(wp), allocatable, private :: inverses(:)       ! instead of factors for n = 1
      logical, allocatable, private :: is_there(:)           ! (n_blocks)
      logical, private :: are_rough = .false.                ! in single precision
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
   subroutine new_block_factors(self, pattern, n_blocks, are_corrected)
      type(block_factors_t), intent(out) :: self
      type(block_pattern_t), intent(in) :: pattern
      integer, intent(in) :: n_blocks
      logical, intent(in), optional :: are_corrected         !! iterations correct the solutions; default no

      self%pattern = pattern
      if (present(are_corrected)) self%are_rough = are_corrected .and. .not. pattern%is_banded .and. pattern%n >= least_rough
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
      if (self%are_rough) then
         call factorise_roughly(self%blocks(h), block, is_singular)
         self%is_there(h) = .not. is_singular
         return
      end if
      associate (n => self%pattern%n, half_bandwidth => self%pattern%half_bandwidth, factors => self%blocks(h))
         n_rows = merge(3*half_bandwidth + 1, n, self%pattern%is_banded)
         if (.not. allocated(factors%matrix)) allocate (factors%matrix(n_rows, n), factors%pivots(n))
         if (self%pattern%is_banded) then
            factors%matrix(:half_bandwidth, :) = (0.0_wp, 0.0_wp)
            factors%matrix(half_bandwidth + 1:, :) = block
            call factorise_band(factors%matrix, half_bandwidth, half_bandwidth, factors%pivots, is_singular)
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

   !> Factorises a dense block in single precision.
   subroutine factorise_roughly(factors, block, is_singular)
      type(factors_t), intent(inout) :: factors
      complex(wp), intent(in) :: block(:, :)                 !! (n, n)
      logical, intent(out) :: is_singular
      real(wp) :: largest
      integer :: info, k
      logical :: was_gradual

      associate (n => size(block, 1))
         if (.not. allocated(factors%rough)) allocate (factors%rough(n, n), factors%pivots(n))
         largest = 0.0_wp
         do k = 1, n
            largest = max(largest, maxval(abs(real(block(:, k)))), maxval(abs(aimag(block(:, k)))))
         end do
         is_singular = .not. (ieee_is_finite(largest) .and. largest > 0.0_wp)
         if (is_singular) return
         factors%unit = largest
         call underflow_to_zero(was_gradual)
         do k = 1, n
            factors%rough(:, k) = cmplx(block(:, k)/largest, kind=sp)
         end do
         call cgetrf(n, n, factors%rough, n, factors%pivots, info)
         call restore_underflow(was_gradual)
         is_singular = info /= 0
      end associate
   end subroutine factorise_roughly

   !> Overwrites b with the solution by factors in single precision.
   subroutine solve_roughly(factors, b)
      type(factors_t), intent(in) :: factors
      complex(wp), intent(inout), contiguous :: b(:)         !! (n)
      complex(sp) :: x(size(b))
      real(wp) :: largest
      integer :: info
      logical :: was_gradual

      largest = max(maxval(abs(real(b))), maxval(abs(aimag(b))))
      if (.not. largest > 0.0_wp) return
      call underflow_to_zero(was_gradual)
      x = cmplx(b/largest, kind=sp)
      call cgetrs("N", size(b), 1, factors%rough, size(b), factors%pivots, x, size(b), info)
      b = (largest/factors%unit)*x
      call restore_underflow(was_gradual)
   end subroutine solve_roughly

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
      else if (self%are_rough) then
         call solve_roughly(self%blocks(h), b)
         return
      end if
      associate (n => self%pattern%n, half_bandwidth => self%pattern%half_bandwidth, factors => self%blocks(h))
         column(1:n, 1:1) => b
         if (self%pattern%is_banded) then
            call solve_band("N", factors%matrix, half_bandwidth, half_bandwidth, factors%pivots, column)
         else if (n <= largest_small) then
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
