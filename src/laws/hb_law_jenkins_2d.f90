!> Elastic Coulomb friction in a plane: f = k (z - w), |f| <= mu N, with two tangential coordinates.
!>
!> The normal load N is constant, or N = max(0, N_0 + k_n z_n) with a third coordinate z_n, on which N itself acts:
!> contact in three dimensions that sticks, slips and opens. States: the position w of the slider. It is pulled as by
!> a string of length l = mu N/k: when taut, it moves towards the end z of the spring, so that friction opposes
!> sliding. Along the straight line between two samples its path (a tractrix) is known: with theta the angle of the
!> string to the line, tan(theta/2) falls as exp(-integral of path length/l). A contact that closes again begins with
!> a relaxed spring. Source: docs/why/theory.md, section 5.5; B. D. Yang and C. H. Menq, J. Sound Vib. 217 (1998) 909
!> (three-dimensional contact). Sign: f and N stand beside K q on the left-hand side.
module hb_law_jenkins_2d
   use hb_hysteretic_law, only: path_part
   use hb_kinds, only: wp
   use hb_law, only: placement_t
   use hb_law_jenkins, only: derive_limit, jenkins_t
   implicit none
   private
   public :: jenkins_2d_t

   type, extends(jenkins_t) :: jenkins_2d_t
   contains
      procedure :: placement => jenkins_2d_placement
      procedure :: derive => jenkins_2d_derive
      procedure :: advance => jenkins_2d_advance
   end type jenkins_2d_t

   real(wp), parameter :: identity(2, 2) = reshape([1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], [2, 2])
   real(wp), parameter :: smallest_leash = 1.0e-100_wp                ! shorter ones belong to an open contact [m]

contains

   pure function jenkins_2d_placement(self) result(placement)
      class(jenkins_2d_t), intent(in) :: self
      type(placement_t) :: placement

      placement%further(1) = "second_dofs"
      if (self%normal_load_varies) placement%further(2) = "normal_dofs"
   end function jenkins_2d_placement

   pure subroutine jenkins_2d_derive(self)
      class(jenkins_2d_t), intent(inout) :: self

      self%n_states = 2
      call derive_limit(self)
   end subroutine jenkins_2d_derive

   subroutine jenkins_2d_advance(self, s_old, path, s_new, ds_ds_old, ds_dpath)
      class(jenkins_2d_t), intent(in) :: self
      real(wp), intent(in), contiguous :: s_old(:, :), path(:, :, :)
      real(wp), intent(out), contiguous :: s_new(:, :)
      real(wp), intent(out), contiguous, optional :: ds_ds_old(:, :, :), ds_dpath(:, :, :, :)
      real(wp) :: by(2, 6), displacement(2), elongation(2), longest(2), slope
      integer :: i

      associate (start => path_part%at_start, end => path_part%at_end)
         if (present(ds_dpath)) ds_dpath = 0.0_wp
         longest = self%limit/self%stiffness
         slope = self%friction_coefficient*self%normal_stiffness/self%stiffness
         do i = 1, size(s_old, 1)
            elongation = path(i, :2, start) - s_old(i, :)
            displacement = path(i, :2, end) - path(i, :2, start)
            if (self%normal_load_varies) longest = self%friction_coefficient*self%preload/self%stiffness + &
                                                   slope*path(i, 3, [start, end])
            call drag(longest, displacement, elongation, by)
            s_new(i, :) = path(i, :2, end) - elongation
            if (.not. (present(ds_ds_old) .and. present(ds_dpath))) cycle
            ds_ds_old(i, :, :) = by(:, 1:2)
            ds_dpath(i, :, :2, start) = by(:, 3:4) - by(:, 1:2)
            ds_dpath(i, :, :2, end) = identity - by(:, 3:4)
            if (self%normal_load_varies) ds_dpath(i, :, 3, [start, end]) = -slope*by(:, 5:6)
         end do
      end associate
   end subroutine jenkins_2d_advance

   !> Computes the string after a straight displacement of its end while its maximum length changes linearly, and its
   !> derivatives.
   !>
   !> A string longer than its maximum, as may result from interpolation, is first shortened. Until it is taut the
   !> slider rests.
   pure subroutine drag(longest, displacement, elongation, by)
      real(wp), intent(in) :: longest(2)                              !! at start and end [m]; negative: contact is open
      real(wp), intent(in) :: displacement(2)                         !! [m]
      real(wp), intent(inout) :: elongation(2)                        !! [m]
      real(wp), intent(out) :: by(2, 6)                               !! last axis: elongation, displacement, longest
      real(wp) :: growth, length, share
      integer :: c

      by = 0.0_wp
      if (longest(2) <= smallest_leash) then
         elongation = 0.0_wp
      else if (longest(1) <= smallest_leash) then                     ! contact closes within the step, its spring relaxed
         growth = longest(2) - longest(1)
         share = longest(2)/growth
         elongation = share*displacement
         if (norm2(elongation) <= longest(2)) then
            by(:, 3:4) = share*identity
            by(:, 5) = displacement*share/growth
            by(:, 6) = displacement*(1.0_wp - share)/growth
         else
            length = norm2(displacement)
            elongation = longest(2)*displacement/length
            by(:, 6) = displacement/length
            do c = 1, 2
               by(:, 2 + c) = longest(2)/length*(identity(:, c) - displacement*displacement(c)/length**2)
            end do
         end if
      else
         by(:, 1:2) = identity
         length = norm2(elongation)
         if (length > longest(1)) then
            by(:, 5) = elongation/length
            do c = 1, 2
               by(:, c) = longest(1)/length*(identity(:, c) - elongation*elongation(c)/length**2)
            end do
            elongation = longest(1)/length*elongation
         end if
         if (norm2(elongation + displacement) <= longest(2)) then
            elongation = elongation + displacement
            by(:, 3:4) = identity
         else
            call drag_taut(longest, displacement, elongation, by)
         end if
      end if
   end subroutine drag

   !> Moves the slider by a string that becomes taut within the step, and is not too long before. Once taut it remains
   !> so: along the line it only rotates towards it, or shortens linearly.
   pure subroutine drag_taut(longest, displacement, elongation, by)
      real(wp), intent(in) :: longest(2), displacement(2)
      real(wp), intent(inout) :: elongation(2)
      real(wp), intent(inout) :: by(2, 6) !! in: derivatives of `elongation` with respect to the first two and longest(1)
      real(wp) :: a, angle, b, c, cut(2, 2), growth, decay, length, mean, root, share, since, slid, taut(2), turned, unit(2)
      real(wp) :: cut_by_longest(2), d_angle(6), d_share(6), d_since(6), d_slid(6), d_taut(2, 6)

      ! |elongation + share displacement| = longest(1) + share growth: a share**2 + 2 b share + c = 0
      growth = longest(2) - longest(1)
      length = norm2(displacement)
      a = length**2 - growth**2
      b = dot_product(elongation, displacement) - longest(1)*growth
      c = min(dot_product(elongation, elongation) - longest(1)**2, 0.0_wp)
      root = sqrt(max(b**2 - a*c, 0.0_wp))
      share = 1.0_wp
      if (b > 0.0_wp) then
         share = -c/(b + root)
      else if (a > 0.0_wp) then
         share = (root - b)/a
      end if
      share = min(max(share, 0.0_wp), 1.0_wp)
      taut = elongation + share*displacement
      since = (1.0_wp - share)*longest(1) + share*longest(2)            ! length of the string when it becomes taut
      d_share = 0.0_wp
      if (root > epsilon(1.0_wp)*longest(1)*max(length, abs(growth))) &
         d_share = [-taut, -share*taut, since*(1.0_wp - share), since*share]/root
      d_taut = spread(displacement, 2, 6)*spread(d_share, 1, 2)
      d_taut(:, 1:2) = d_taut(:, 1:2) + identity
      d_taut(:, 3:4) = d_taut(:, 3:4) + share*identity
      d_since = growth*d_share + [0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp - share, share]

      ! The tractrix from there, with a string of the mean length
      unit = taut/norm2(taut)
      d_angle = (unit(1)*d_taut(2, :) - unit(2)*d_taut(1, :))/since
      if (length > 0.0_wp) then
         mean = 0.5_wp*(since + longest(2))
         slid = (1.0_wp - share)*length/mean
         d_slid = -(length*d_share + 0.5_wp*slid*d_since)/mean
         d_slid(3:4) = d_slid(3:4) + (1.0_wp - share)*displacement/length/mean
         d_slid(6) = d_slid(6) - 0.5_wp*slid/mean
         angle = 0.5_wp*atan2(displacement(1)*taut(2) - displacement(2)*taut(1), dot_product(displacement, taut))
         decay = exp(-slid)
         turned = 1.0_wp/(cos(angle)**2 + (decay*sin(angle))**2)      ! decay*turned: angle at the end by angle when taut
         d_angle = decay*turned*d_angle
         ! The remainder, 1 - decay*turned, without cancellation if the path is short
         d_angle(3:4) = d_angle(3:4) + tanh(0.5_wp*slid)*(1.0_wp + decay)*(1.0_wp - sin(angle)**2*(1.0_wp + decay))*turned/length* &
                        [-displacement(2), displacement(1)]/length
         a = 2.0_wp*atan2(decay*sin(angle), cos(angle))
         d_angle = d_angle - sin(a)*d_slid
         a = a - 2.0_wp*angle
         unit = [cos(a)*unit(1) - sin(a)*unit(2), sin(a)*unit(1) + cos(a)*unit(2)]
      end if
      elongation = longest(2)*unit
      cut = by(:, 1:2)
      cut_by_longest = by(:, 5)
      by = longest(2)*reshape([-unit(2)*d_angle, unit(1)*d_angle], [2, 6], order=[2, 1])
      by(:, 6) = by(:, 6) + unit
      by(:, 5) = by(:, 5) + matmul(by(:, 1:2), cut_by_longest)
      by(:, 1:2) = matmul(by(:, 1:2), cut)
   end subroutine drag_taut
end module hb_law_jenkins_2d
