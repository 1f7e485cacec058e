!> Functions of the multipliers whose zeros are bifurcations of periodic motions, for curves to locate.
!>
!> With all multipliers m but the one that is known: the product of 1 + m changes its sign where the period doubles, that of 1 - m
!> where a branch begins (or at a fold, where the curve itself turns back), that of 1 - m n over all pairs where two leave the unit
!> circle together, or where two real ones are the inverse of each other, which is nothing: `is_torus` tells. Each factor is divided
!> by the larger of 1 and what it is made of, so that no product overflows.
!> Source: Y. A. Kuznetsov, Elements of Applied Bifurcation Theory, 3rd edition, Springer 2004, section 10.2
!> (for the matrix itself).
module hb_bifurcation
   use hb_kinds, only: wp
   implicit none
   private
   public :: angle_of_pair, bifurcation, bifurcation_value, is_torus

   type :: bifurcation_t
      integer :: branch = 1                                           !! a multiplier 1
      integer :: doubling = 2                                         !! a multiplier -1
      integer :: torus = 3                                            !! a pair on the unit circle (Neimark and Sacker)
   end type bifurcation_t
   type(bifurcation_t), parameter :: bifurcation = bifurcation_t()

contains

   !> The function of one kind; positive where all multipliers are small.
   pure real(wp) function bifurcation_value(kind, multipliers) result(value)
      integer, intent(in) :: kind
      complex(wp), intent(in) :: multipliers(:)                       !! with each its conjugate, but half of the last pair
      complex(wp) :: factor
      integer :: i, k

      factor = (1.0_wp, 0.0_wp)
      do i = 1, n_in_pairs(multipliers)
         associate (m => multipliers(i))
            select case (kind)
            case (bifurcation%branch)
               factor = factor*(1.0_wp - m)/max(1.0_wp, abs(m))
            case (bifurcation%doubling)
               factor = factor*(1.0_wp + m)/max(1.0_wp, abs(m))
            case default
               do k = 1, i - 1
                  factor = factor*(1.0_wp - m*multipliers(k))/max(1.0_wp, abs(m*multipliers(k)))
               end do
            end select
         end associate
      end do
      value = real(factor)
   end function bifurcation_value

   !> Whether the two multipliers whose product is closest to 1 are a complex pair.
   pure logical function is_torus(multipliers)
      complex(wp), intent(in) :: multipliers(:)

      is_torus = angle_of_pair(multipliers) > 0.0_wp
   end function is_torus

   !> Angle [rad] of the complex one of the two multipliers whose product is closest to 1; 0 where these are real.
   pure real(wp) function angle_of_pair(multipliers) result(angle)
      complex(wp), intent(in) :: multipliers(:)
      real(wp) :: least
      integer :: i, k

      angle = 0.0_wp
      least = huge(1.0_wp)
      do i = 1, n_in_pairs(multipliers)
         do k = 1, i - 1
            if (abs(1.0_wp - multipliers(i)*multipliers(k)) >= least) cycle
            least = abs(1.0_wp - multipliers(i)*multipliers(k))
            angle = 0.0_wp
            if (abs(aimag(multipliers(i))) > 0.0_wp) angle = abs(atan2(aimag(multipliers(i)), real(multipliers(i))))
         end do
      end do
   end function angle_of_pair

   !> Number of multipliers without half a pair at the end.
   pure integer function n_in_pairs(multipliers) result(n)
      complex(wp), intent(in) :: multipliers(:)

      n = size(multipliers) - modulo(count(abs(aimag(multipliers)) > 0.0_wp), 2)
   end function n_in_pairs
end module hb_bifurcation
