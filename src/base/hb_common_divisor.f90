!> The greatest common divisor of integers, by Euclid's algorithm.
module hb_common_divisor
   implicit none
   private
   public :: common_divisor

contains

   !> Greatest common divisor of numbers; 0 if all of them are 0.
   pure integer function common_divisor(numbers) result(divisor)
      integer, intent(in) :: numbers(:)
      integer :: i, remainder, rest

      divisor = 0
      do i = 1, size(numbers)
         rest = abs(numbers(i))
         do while (rest > 0)
            remainder = modulo(divisor, rest)
            divisor = rest
            rest = remainder
         end do
      end do
   end function common_divisor
end module hb_common_divisor
