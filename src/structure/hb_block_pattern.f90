!> Where the entries of a square block stand in memory: dense, or as a band when nothing lies far from the diagonal.
!>
!> Entry (i, k) stands at (shift(k) + i, k), for i from first(k) to last(k); so loops read the same for both.
module hb_block_pattern
   implicit none
   private
   public :: block_pattern_t, new_block_pattern

   type :: block_pattern_t
      integer :: n = 0                                       !! order of the block
      integer :: half_bandwidth = 0                          !! largest |i - k| of an entry
      integer :: n_rows = 0                                  !! rows in memory
      logical :: is_banded = .false.
      integer, allocatable :: first(:), last(:), shift(:)    !! (n)
   end type block_pattern_t

contains

   !> Pattern of order `n` with entries up to `reach` off the diagonal: a band where its factors take at most half of the
   !> dense block.
   pure subroutine new_block_pattern(self, n, half_bandwidth)
      type(block_pattern_t), intent(out) :: self
      integer, intent(in) :: n, half_bandwidth
      integer :: k

      self%n = n
      self%is_banded = 2*(3*half_bandwidth + 1) <= n
      allocate (self%first(n), self%last(n), self%shift(n))
      if (self%is_banded) then
         self%half_bandwidth = half_bandwidth
         self%n_rows = 2*half_bandwidth + 1
         do k = 1, n
            self%first(k) = max(1, k - half_bandwidth)
            self%last(k) = min(n, k + half_bandwidth)
            self%shift(k) = half_bandwidth + 1 - k
         end do
      else
         self%half_bandwidth = max(0, n - 1)
         self%n_rows = n
         self%first = 1
         self%last = n
         self%shift = 0
      end if
   end subroutine new_block_pattern
end module hb_block_pattern
