!> A part of a structure whose stiffness depends on the frequency: viscoelastic mounts, seals, controllers, delays.
!>
!> In a motion Re(c exp(i w t)) it responds to z = b.c with the force Z(w) z along a, so that it adds Z(w) a b^T to
!> the dynamic stiffness of hb_dynamic_stiffness. Motions are real: Z(-w) = conj(Z(w)). Kinds: below and
!> docs/why/theory.md, section 4.
module hb_frequency_part
   use hb_interpolation, only: monotone_cubic_t
   use hb_kinds, only: wp
   implicit none
   private
   public :: frequency_part_t, kind_of_part

   type :: kind_of_part_t
      integer :: delay = 1                                            !! (k + i w d) exp(-i w T)
      integer :: fractional = 2                                       !! c (i w)**alpha
      integer :: loss_factor = 3                                      !! k (1 + i eta sign(w))
      integer :: maxwell = 4                                          !! sum of k_j i w t_j/(1 + i w t_j)
      integer :: table = 5                                            !! storage + i loss, monotone cubics of |w|
   end type kind_of_part_t
   type(kind_of_part_t), parameter :: kind_of_part = kind_of_part_t()

   type :: frequency_part_t
      integer :: kind = 0
      real(wp), allocatable :: acts(:), feels(:)                      !! a, b, (n_dofs)
      real(wp) :: factor = 1.0_wp                                     !! of all terms below; for differences of two parts
      real(wp) :: stiffness = 0.0_wp, damping = 0.0_wp                !! k [N/m], d [N s/m]
      real(wp) :: delay = 0.0_wp                                      !! T [s]
      real(wp) :: coefficient = 0.0_wp, exponent = 0.0_wp             !! c [N s**alpha/m], alpha
      real(wp) :: loss_factor = 0.0_wp                                !! eta
      real(wp), allocatable :: moduli(:), times(:)                    !! k_j [N/m], t_j [s]
      type(monotone_cubic_t) :: storage, loss                         !! [N/m] over |w| [rad/s]
   contains
      procedure :: evaluate => frequency_part_evaluate
      procedure :: equals => frequency_part_equals
   end type frequency_part_t

contains

   !> Z and its derivative with respect to the frequency, of any sign; at zero frequency the limit of slow motion.
   pure subroutine frequency_part_evaluate(self, frequency, z, dz_dw)
      class(frequency_part_t), intent(in) :: self
      real(wp), intent(in) :: frequency                               !! [rad/s]
      complex(wp), intent(out) :: z                                   !! [N/m]
      complex(wp), intent(out) :: dz_dw                               !! [N s/m]
      complex(wp), parameter :: i = (0.0_wp, 1.0_wp)
      complex(wp) :: turn
      real(wp) :: by_w(2), value(2), w
      integer :: j

      w = abs(frequency)
      z = 0.0_wp
      dz_dw = 0.0_wp
      select case (self%kind)
      case (kind_of_part%delay)
         turn = exp(-i*w*self%delay)
         z = (self%stiffness + i*w*self%damping)*turn
         dz_dw = i*self%damping*turn - i*self%delay*z
      case (kind_of_part%fractional)
         if (w > 0.0_wp) then
            z = self%coefficient*w**self%exponent*exp(0.5_wp*acos(-1.0_wp)*self%exponent*i)
            dz_dw = self%exponent*z/w
         else if (.not. self%exponent > 0.0_wp) then
            z = self%coefficient
         end if
      case (kind_of_part%loss_factor)
         z = self%stiffness*(1.0_wp + merge(i*self%loss_factor, (0.0_wp, 0.0_wp), w > 0.0_wp))
      case (kind_of_part%maxwell)
         do j = 1, size(self%moduli)
            turn = 1.0_wp/(1.0_wp + i*w*self%times(j))
            z = z + self%moduli(j)*i*w*self%times(j)*turn
            dz_dw = dz_dw + self%moduli(j)*i*self%times(j)*turn**2
         end do
      case (kind_of_part%table)
         call self%storage%at(w, value(1), by_w(1))
         call self%loss%at(w, value(2), by_w(2))
         z = cmplx(value(1), value(2), wp)
         dz_dw = cmplx(by_w(1), by_w(2), wp)
      end select
      z = self%factor*z
      dz_dw = self%factor*dz_dw
      if (frequency >= 0.0_wp) return
      z = conjg(z)
      dz_dw = -conjg(dz_dw)
   end subroutine frequency_part_evaluate

   !> Whether two parts are equal, number by number.
   pure logical function frequency_part_equals(self, other) result(is_same)
      class(frequency_part_t), intent(in) :: self, other

      is_same = self%kind == other%kind .and. all(self%acts == other%acts) .and. all(self%feels == other%feels) .and. &
                all([self%factor, self%stiffness, self%damping, self%delay, self%coefficient, self%exponent, self%loss_factor] == &
                    [other%factor, other%stiffness, other%damping, other%delay, other%coefficient, other%exponent, &
                     other%loss_factor])
      if (.not. is_same) return
      select case (self%kind)
      case (kind_of_part%maxwell)
         is_same = size(self%moduli) == size(other%moduli)
         if (is_same) is_same = all(self%moduli == other%moduli) .and. all(self%times == other%times)
      case (kind_of_part%table)
         is_same = size(self%storage%nodes) == size(other%storage%nodes)
         if (is_same) is_same = all(self%storage%nodes == other%storage%nodes) .and. &
                                all(self%storage%values == other%storage%values) .and. all(self%loss%values == other%loss%values)
      end select
   end function frequency_part_equals
end module hb_frequency_part
