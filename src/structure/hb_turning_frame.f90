!> Two coordinates in a frame that rotates relative to the body whose motion they describe.
!>
!> With X = x1 + i x2 in the frame of the body and Y = y1 + i y2 in a frame rotated by the angle W t relative to it, X
!> = Y exp(i W t) and X' = (Y' + i W Y) exp(i W t). Multiplication by i is the matrix J = ((0, -1), (1, 0)). A mass m,
!> an isotropic damper d and an isotropic spring k of the body become
!>
!>     m y'' + (d + 2 m W J) y' + (k - m W**2 + d W J) y:
!>
!> with Coriolis terms (skew-symmetric), centrifugal terms, and a circulatory stiffness of the damper. Two modes u =
!> x1 cos(n theta) + x2 sin(n theta) of n nodal diameters, in a frame of speed S, have W = n S. Source:
!> docs/why/theory.md, section 4, rotating frames.
module hb_turning_frame
   use hb_kinds, only: wp
   implicit none
   private
   public :: add_turned_pair, quarter_turn

   real(wp), parameter :: quarter_turn(2, 2) = reshape([0.0_wp, 1.0_wp, -1.0_wp, 0.0_wp], [2, 2])   !! J

contains

   !> Adds mass, damper and spring of a body to the rows and columns `first` and `first + 1` of the matrices.
   pure subroutine add_turned_pair(mass_matrix, damping_matrix, stiffness_matrix, first, mass, damping, stiffness, rate)
      real(wp), intent(inout) :: mass_matrix(:, :), damping_matrix(:, :), stiffness_matrix(:, :)   !! (n_dofs, n_dofs)
      integer, intent(in) :: first
      real(wp), intent(in) :: mass                           !! m [kg]
      real(wp), intent(in) :: damping                        !! d [N s/m], for the motion in the frame of the body
      real(wp), intent(in) :: stiffness                      !! k [N/m]
      real(wp), intent(in) :: rate                           !! W [rad/s], of the frame relative to the body
      integer :: i, last

      last = first + 1
      do i = first, last
         mass_matrix(i, i) = mass_matrix(i, i) + mass
         damping_matrix(i, i) = damping_matrix(i, i) + damping
         stiffness_matrix(i, i) = stiffness_matrix(i, i) + stiffness - mass*rate**2
      end do
      damping_matrix(first:last, first:last) = damping_matrix(first:last, first:last) + 2.0_wp*mass*rate*quarter_turn
      stiffness_matrix(first:last, first:last) = stiffness_matrix(first:last, first:last) + damping*rate*quarter_turn
   end subroutine add_turned_pair
end module hb_turning_frame
