!> The limit of central differences over decreasing distances. Source: C. J. F. Ridders, Adv. Eng. Softw. 4 (1982) 75-76.
module hb_difference_limit
   use hb_kinds, only: wp
   implicit none
   private
   public :: distance_at, limit_t, ratio_of_distances

   real(wp), parameter :: largest_distance = 5.0e-3_wp                        ! of two states in a difference quotient, scaled
   real(wp), parameter :: ratio_of_distances = 0.2_wp                             ! from one distance to the next

   !> Limit of central differences over decreasing distances, by extrapolation of increasing order. The change by the last
   !> order and distance is the estimate of the error; the best value is stored.
   type :: limit_t
      real(wp) :: ratio = ratio_of_distances                                      !! of one distance to the one before
      real(wp), allocatable :: best(:, :)
      real(wp) :: estimate = huge(1.0_wp)                             !! relative to its largest entry
      integer :: n_idle = 0                                           !! last distances that have not improved the best value
      real(wp), allocatable, private :: orders(:, :, :)               ! at the last distance
   contains
      procedure :: add => limit_add
   end type limit_t

contains

   !> Distance of the states of a difference from the state between them, scaled.
   pure real(wp) function distance_at(level, ratio) result(distance)
      integer, intent(in) :: level                                    !! from 1
      real(wp), intent(in) :: ratio                                   !! to the one before

      distance = largest_distance*ratio**(level - 1)
   end function distance_at

   !> Adds the difference over the next distance.
   subroutine limit_add(self, difference)
      class(limit_t), intent(inout) :: self
      real(wp), intent(in) :: difference(:, :)
      real(wp), allocatable :: now(:, :, :)
      real(wp) :: change
      integer :: i, n_last

      n_last = 0
      if (allocated(self%orders)) n_last = size(self%orders, 3)
      allocate (now(size(difference, 1), size(difference, 2), n_last + 1))
      now(:, :, 1) = difference
      self%n_idle = self%n_idle + 1
      do i = 1, n_last
         associate (share => self%ratio**(2*i), last => self%orders(:, :, i))
            now(:, :, i + 1) = (now(:, :, i) - share*last)/(1.0_wp - share)
            change = max(maxval(abs(now(:, :, i + 1) - now(:, :, i))), maxval(abs(now(:, :, i + 1) - last)))
         end associate
         change = change/max(1.0_wp, maxval(abs(now(:, :, i + 1))))
         if (.not. change < self%estimate) cycle
         self%estimate = change
         self%n_idle = 0
         self%best = now(:, :, i + 1)
      end do
      call move_alloc(now, self%orders)
   end subroutine limit_add
end module hb_difference_limit
