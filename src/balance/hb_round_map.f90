!> The linear part M of a round of states over the torus: where the states of the first slice change by c before the round, they
!> change by M c after it. States, and their derivatives, that repeat themselves after a round follow from one more round
!> and (1 - M)**-1, however slowly further rounds would lead there. Source: docs/why/theory.md, section 5.5.
module hb_round_map
   use hb_cancellation, only: spend_work
   use hb_characteristic, only: characteristic_t
   use hb_kinds, only: wp
   use hb_lapack, only: dgetrf, dgetrs
   use hb_thresholds, only: equality_tolerance
   implicit none
   private
   public :: find_closing, is_affordable

   integer, parameter :: largest_map = 512                            ! states of the first slice

contains

   !> Whether M is small enough to be computed.
   pure logical function is_affordable(characteristic, n_states)
      type(characteristic_t), intent(in) :: characteristic
      integer, intent(in) :: n_states

      is_affordable = characteristic%n_slice*n_states <= largest_map
   end function is_affordable

   !> (1 - M)**-1; not allocated if 1 - M is nearly singular: sliders hardly slip, and keep what they started with.
   subroutine find_closing(by_start, characteristic, closing)
      real(wp), intent(in) :: by_start(:, :, :, :)                    !! derivatives of the steps by the states at their starts,
                                                                      !! (n_slice, n_states, n_states, n_steps)
      type(characteristic_t), intent(in) :: characteristic
      real(wp), allocatable, intent(out) :: closing(:, :)             !! (n, n) with n = n_slice*n_states, samples fastest
      real(wp), allocatable :: map(:, :)
      integer, allocatable :: pivots(:)
      integer :: i, info, n

      n = characteristic%n_slice*size(by_start, 2)
      allocate (map(n, n), pivots(n))
      call find_map(by_start, characteristic, map)
      map = -map
      allocate (closing(n, n), source=0.0_wp)
      do i = 1, n
         map(i, i) = 1.0_wp + map(i, i)
         closing(i, i) = 1.0_wp
      end do
      call dgetrf(n, n, map, n, pivots, info)
      if (info == 0) call dgetrs("N", n, n, map, n, pivots, closing, n, info)
      if (info /= 0 .or. .not. equality_tolerance*maxval(abs(closing)) < 1.0_wp) deallocate (closing)
   end subroutine find_closing

   !> M, by a round of all unit vectors at once.
   subroutine find_map(by_start, characteristic, map)
      real(wp), intent(in) :: by_start(:, :, :, :)
      type(characteristic_t), intent(in) :: characteristic
      real(wp), intent(out) :: map(characteristic%n_slice, size(by_start, 2), characteristic%n_slice*size(by_start, 2))
      real(wp), parameter :: per_value = 2.0_wp, per_neighbour = 0.3_wp, per_product = 0.5_wp ! see hb_solver_types%unit_of_work
      real(wp), allocatable :: start(:, :, :)
      integer :: c, i, k, n, n_slice, n_states, now, old_state

      n_slice = characteristic%n_slice
      n_states = size(by_start, 2)
      n = n_slice*n_states
      call spend_work(characteristic%work_of_round(n_states*n, per_value, per_neighbour) + per_product*real(n, wp)**3)
      allocate (start(n_slice, n_states, n))
      map = 0.0_wp
      do c = 1, n
         map(1 + modulo(c - 1, n_slice), 1 + (c - 1)/n_slice, c) = 1.0_wp
      end do
      do i = 2, characteristic%n_steps + 1
         now = 1 + modulo(i - 1, characteristic%n_steps)
         do c = 1, n
            call characteristic%interpolate(map(:, :, c), start(:, :, c))
         end do
         if (now == 1) start = characteristic%closing*start
         do c = 1, n
            do k = 1, n_states
               map(:, k, c) = by_start(:, k, 1, now)*start(:, 1, c)
               do old_state = 2, n_states
                  map(:, k, c) = map(:, k, c) + by_start(:, k, old_state, now)*start(:, old_state, c)
               end do
            end do
         end do
      end do
   end subroutine find_map
end module hb_round_map
