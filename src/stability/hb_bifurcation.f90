!> Functions of the multipliers whose zeros are bifurcations of periodic motions, for curves to locate.
!>
!> With all multipliers m except the trivial one: 1 + m is zero at a period doubling, 1 - m at a branch point (or at a
!> fold, where the curve itself turns back), 1 - m n of a complex pair where it leaves the unit circle. For two real
!> ones 1 - m n is zero where they are inverse to each other, which is not a bifurcation: `is_torus` distinguishes the
!> cases. The function of each kind has the magnitude of the factor closest to zero and the sign of the product of
!> all. It is therefore zero if one factor is, changes its sign there, and does not depend on the number of other
!> multipliers or their distance from the unit circle. Source: Y. A. Kuznetsov, Elements of Applied Bifurcation
!> Theory, 3rd edition, Springer 2004, section 10.2 (for the matrix itself).
module hb_bifurcation
   use hb_kinds, only: wp
   implicit none
   private
   public :: angle_of_pair, bifurcation, bifurcation_product, bifurcation_value, is_branch, is_torus, &
      movement

   type :: bifurcation_t
      integer :: branch = 1                                           !! a multiplier 1
      integer :: doubling = 2                                         !! a multiplier -1
      integer :: torus = 3                                            !! a pair on the unit circle (Neimark and Sacker)
   end type bifurcation_t
   type(bifurcation_t), parameter :: bifurcation = bifurcation_t()

contains

   !> The function of one kind; positive if all multipliers are small.
   pure real(wp) function bifurcation_value(kind, multipliers) result(value)
      integer, intent(in) :: kind
      complex(wp), intent(in) :: multipliers(:)                       !! each with its conjugate, except half of the last pair
      integer :: i, k

      value = huge(1.0_wp)
      do i = 1, n_in_pairs(multipliers)
         associate (m => multipliers(i))
            select case (kind)
            case (bifurcation%branch)
               call join(1.0_wp - m)
            case (bifurcation%doubling)
               call join(1.0_wp + m)
            case default
               do k = 1, i - 1
                  if (are_pair(m, multipliers(k))) call join(1.0_wp - m*multipliers(k))
               end do
            end select
         end associate
      end do
      if (value >= huge(1.0_wp)) value = 1.0_wp                       ! there is no such factor

   contains

      !> Includes a factor: a complex one occurs with its conjugate, and their product is positive.
      pure subroutine join(factor)
         complex(wp), intent(in) :: factor

         if (abs(factor) < abs(value)) value = sign(abs(factor), value)
         if (.not. abs(aimag(factor)) > 0.0_wp .and. real(factor) < 0.0_wp) value = -value
      end subroutine join
   end function bifurcation_value

   !> Product of the factors of which `bifurcation_value` has the smallest, also those of pairs that never meet: smooth along a
   !> curve, with the same sign unless other factors are negative. Factors are relative to the larger of their terms, so that
   !> the product of many has a magnitude of about 1.
   pure real(wp) function bifurcation_product(kind, multipliers) result(value)
      integer, intent(in) :: kind
      complex(wp), intent(in) :: multipliers(:)                       !! each with its conjugate, except half of the last pair
      complex(wp) :: factors
      integer :: i, k

      factors = (1.0_wp, 0.0_wp)
      do i = 1, n_in_pairs(multipliers)
         associate (m => multipliers(i))
            select case (kind)
            case (bifurcation%branch)
               factors = factors*((1.0_wp - m)/max(1.0_wp, abs(m)))
            case (bifurcation%doubling)
               factors = factors*((1.0_wp + m)/max(1.0_wp, abs(m)))
            case default
               do k = 1, i - 1
                  factors = factors*((1.0_wp - m*multipliers(k))/max(1.0_wp, abs(m*multipliers(k))))
               end do
            end select
         end associate
      end do
      value = real(factors)
   end function bifurcation_product

   !> Whether two multipliers are both real, or each the conjugate of the other.
   elemental logical function are_pair(m, n)
      complex(wp), intent(in) :: m, n

      are_pair = .not. abs(aimag(m) + aimag(n)) > 0.0_wp
      if (are_pair .and. abs(aimag(m)) > 0.0_wp) are_pair = .not. abs(real(m) - real(n)) > 0.0_wp
   end function are_pair

   !> Whether the multiplier closest to 1 is real: one of a complex pair meets its conjugate before it can be 1.
   pure logical function is_branch(multipliers)
      complex(wp), intent(in) :: multipliers(:)

      is_branch = size(multipliers) > 0
      if (is_branch) is_branch = .not. abs(aimag(multipliers(minloc(abs(1.0_wp - multipliers), dim=1)))) > 0.0_wp
   end function is_branch

   !> Whether the pair, complex or real, whose product is closest to 1 is a complex one.
   pure logical function is_torus(multipliers)
      complex(wp), intent(in) :: multipliers(:)

      is_torus = angle_of_pair(multipliers) > 0.0_wp
   end function is_torus

   !> Angle [rad] of the pair, complex or real, whose product is closest to 1; 0 if it is real.
   pure real(wp) function angle_of_pair(multipliers) result(angle)
      complex(wp), intent(in) :: multipliers(:)
      real(wp) :: least
      integer :: i, k

      angle = 0.0_wp
      least = huge(1.0_wp)
      do i = 1, n_in_pairs(multipliers)
         do k = 1, i - 1
            if (.not. are_pair(multipliers(i), multipliers(k))) cycle
            if (abs(1.0_wp - multipliers(i)*multipliers(k)) >= least) cycle
            least = abs(1.0_wp - multipliers(i)*multipliers(k))
            angle = 0.0_wp
            if (abs(aimag(multipliers(i))) > 0.0_wp) angle = abs(atan2(aimag(multipliers(i)), real(multipliers(i))))
         end do
      end do
   end function angle_of_pair

   !> Largest distance of a multiplier of one motion from the nearest one of another, relative to those outside the unit circle.
   pure real(wp) function movement(before, behind)
      complex(wp), intent(in) :: before(:), behind(:)
      integer :: i

      movement = 0.0_wp
      if (min(size(before), size(behind)) == 0) return
      do i = 1, size(before)
         movement = max(movement, minval(abs(behind - before(i)))/max(1.0_wp, abs(before(i))))
      end do
      do i = 1, size(behind)
         movement = max(movement, minval(abs(before - behind(i)))/max(1.0_wp, abs(behind(i))))
      end do
   end function movement

   !> Number of multipliers without half a pair at the end.
   pure integer function n_in_pairs(multipliers) result(n)
      complex(wp), intent(in) :: multipliers(:)

      n = size(multipliers) - modulo(count(abs(aimag(multipliers)) > 0.0_wp), 2)
   end function n_in_pairs
end module hb_bifurcation
