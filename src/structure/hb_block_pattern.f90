!> Memory layout of a square block: dense, or a band if all entries are near the diagonal.
!>
!> Entry (i, k) is stored at (shift(k) + i, k), for i from first(k) to last(k), so that loops are the same for both.
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

   !> Pattern of order `n` with entries up to `half_bandwidth` off the diagonal: a band if its factors need at most
   !> half of the dense block.
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
