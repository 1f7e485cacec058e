!> Reproducible numbers between -1 and 1 for tests: a linear congruential generator, the same with every compiler.
!> Source of the constants: Numerical Recipes, 2nd ed., section 7.1 ("quick and dirty" generators).
module random_numbers
   use hb_kinds, only: int64, wp
   implicit none
   private
   public :: fill_random

contains

   !> Fills an array; the same seed gives the same numbers.
   subroutine fill_random(seed, values)
      integer, intent(in) :: seed
      real(wp), intent(out) :: values(:, :)
      integer(int64), parameter :: modulus = 2_int64**32
      integer(int64) :: state
      integer :: i, k

      state = modulo(123456789_int64*(seed + 1_int64), modulus)
      do k = 1, size(values, 2)
         do i = 1, size(values, 1)
            state = modulo(1664525_int64*state + 1013904223_int64, modulus)
            values(i, k) = 2.0_wp*real(state, wp)/real(modulus, wp) - 1.0_wp
         end do
      end do
   end subroutine fill_random
end module random_numbers
