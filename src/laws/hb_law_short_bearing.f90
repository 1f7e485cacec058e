!> Oil film in a short journal bearing or a squeeze film damper: its force on the journal.
!>
!> The film has the thickness h = c - x.n in the direction n; the velocity w = v - Omega/2 (-y, x) closes it.
!> Pressures are parabolic along the bearing, p = 6 mu (L**2/4 - s**2) w.n/h**3, so that f = mu R L**3 times the
!> integral of n (w.n)/h**3 over the directions: those where the film closes (half film: oil carries no tension), or
!> all. With e = |x|/c and the substitution 1 - e cos(beta) = (1 - e**2)/(1 + e cos(gamma)) the integrands are
!> polynomials in sin(gamma) and cos(gamma), which Gauss points integrate to rounding, without the cancellation of
!> closed forms; the ends do not contribute to derivatives, because w.n is 0 there. Source: J. F. Booker, J. Basic
!> Eng. 87 (1965) 533 (integrals); J. Vance, F. Zeidan and B. Murphy, Machinery Vibration and Rotordynamics, Wiley
!> 2010, chapter 6; docs/why/theory.md, section 5.2. Sign: f stands beside K q on the left-hand side.
module hb_law_short_bearing
   use hb_kinds, only: two_pi, wp
   use hb_law, only: defects_t, law_t, placement_t
   use hb_numbers, only: number_t, numbers_t
   implicit none
   private
   public :: short_bearing_t

   type, extends(law_t) :: short_bearing_t
      real(wp) :: viscosity = 0.0_wp                                  !! mu [Pa s]
      real(wp) :: radius = 0.0_wp                                     !! R [m]
      real(wp) :: length = 0.0_wp                                     !! L [m]
      real(wp) :: clearance = 0.0_wp                                  !! c [m]
      real(wp) :: rotor_speed = 0.0_wp                                !! Omega [rad/s], from x towards y
      logical :: is_full = .false.                                    !! oil carries tension
   contains
      procedure :: declare_numbers => short_bearing_declare_numbers
      procedure :: placement => short_bearing_placement
      procedure :: derive => short_bearing_derive
      procedure :: number_slope => short_bearing_number_slope
      procedure :: evaluate => short_bearing_evaluate
      procedure :: defects => short_bearing_defects
   end type short_bearing_t

   real(wp), parameter :: max_eccentricity = 0.99_wp                  ! largest eccentricity of the formula; iterates may exceed it

   !> Gauss points of order 16 for (-1, 1), those above 0: exact to 1e-14 for sines and cosines of three times an
   !> angle.
   real(wp), parameter :: nodes(8) = [0.09501250983763745_wp, 0.28160355077925892_wp, 0.45801677765722737_wp, &
                                      0.61787624440264377_wp, 0.75540440835500300_wp, 0.86563120238783176_wp, &
                                      0.94457502307323260_wp, 0.98940093499164994_wp]
   real(wp), parameter :: weights(8) = [0.18945061045506859_wp, 0.18260341504492361_wp, 0.16915651939500262_wp, &
                                        0.14959598881657676_wp, 0.12462897125553403_wp, 0.09515851168249259_wp, &
                                        0.06225352393864771_wp, 0.02715245941175404_wp]

contains

   subroutine short_bearing_declare_numbers(self, numbers)
      class(short_bearing_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("viscosity", self%viscosity)
      call numbers%add("radius", self%radius)
      call numbers%add("length", self%length)
      call numbers%add("clearance", self%clearance)
      call numbers%add("rotor_speed", self%rotor_speed)
      call numbers%add("film", self%is_full, word="full")
   end subroutine short_bearing_declare_numbers

   pure function short_bearing_placement(self) result(placement)
      class(short_bearing_t), intent(in) :: self
      type(placement_t) :: placement

      placement%further(1) = "second_dofs"
   end function short_bearing_placement

   pure subroutine short_bearing_derive(self)
      class(short_bearing_t), intent(inout) :: self

      self%needs_velocity = .true.
      self%is_odd = .true.
      self%has_potential = .not. abs(self%rotor_speed) > 0.0_wp
      self%length_scale = self%clearance
   end subroutine short_bearing_derive

   subroutine short_bearing_evaluate(self, z, v, p, f, df_dz, df_dv, df_dp)
      class(short_bearing_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)
      real(wp) :: by_w(2, 2), by_x(2, 2), force(2), w(2), x(2)
      integer :: i

      do i = 1, size(z, 1)
         x = z(i, :)/self%clearance
         w = (v(i, :) - 0.5_wp*self%rotor_speed*[-z(i, 2), z(i, 1)])/self%clearance
         call press(x, w, self%is_full, force, by_x, by_w)
         associate (scale => self%viscosity*self%radius*self%length**3/self%clearance**2)
            f(i, :) = scale*force
            if (present(df_dv)) df_dv(i, :, :) = scale/self%clearance*by_w
            if (.not. present(df_dz)) cycle
            by_x(:, 1) = by_x(:, 1) - 0.5_wp*self%rotor_speed*by_w(:, 2)
            by_x(:, 2) = by_x(:, 2) + 0.5_wp*self%rotor_speed*by_w(:, 1)
            df_dz(i, :, :) = scale/self%clearance*by_x
         end associate
      end do
   end subroutine short_bearing_evaluate

   !> With s = mu R L**3/c**2 the force is s F(x/c, w/c): by the clearance it changes by -(2 F + F_x x/c + F_w w/c) s/c,
   !> by the speed of the rotor by s F_w/c dw/dOmega.
   subroutine short_bearing_number_slope(self, number, z, v, p, slope, is_known)
      class(short_bearing_t), intent(in) :: self
      type(number_t), intent(in) :: number
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: slope(:, :)
      logical, intent(out) :: is_known
      real(wp) :: by_w(2, 2), by_x(2, 2), force(2), scale, w(2), x(2)
      integer :: i

      is_known = .true.
      scale = self%viscosity*self%radius*self%length**3/self%clearance**2
      do i = 1, size(z, 1)
         x = z(i, :)/self%clearance
         w = (v(i, :) - 0.5_wp*self%rotor_speed*[-z(i, 2), z(i, 1)])/self%clearance
         call press(x, w, self%is_full, force, by_x, by_w)
         select case (number%key)
         case ("viscosity"); slope(i, :) = scale/self%viscosity*force
         case ("radius"); slope(i, :) = scale/self%radius*force
         case ("length"); slope(i, :) = 3.0_wp*scale/self%length*force
         case ("clearance"); slope(i, :) = -scale/self%clearance*(2.0_wp*force + matmul(by_x, x) + matmul(by_w, w))
         case ("rotor_speed"); slope(i, :) = 0.5_wp*scale*matmul(by_w, [x(2), -x(1)])
         case default
            is_known = .false.
         end select
      end do
   end subroutine short_bearing_number_slope

   !> The integral of n (w.n)/(1 - x.n)**3 and its derivatives, in the frame of the eccentricity; beyond the largest
   !> eccentricity x is replaced by the point of that eccentricity in its direction.
   pure subroutine press(x, w, is_full, force, by_x, by_w)
      real(wp), intent(in) :: x(2), w(2)
      logical, intent(in) :: is_full
      real(wp), intent(out) :: force(2), by_x(2, 2), by_w(2, 2)
      real(wp) :: angle, e, ends(2), even(2), first, frame(2, 2), half(2), middle(2), moments(3), odd(2), own(2), s, second
      real(wp) :: slopes(4), weight
      integer :: k, side

      frame(:, 1) = [1.0_wp, 0.0_wp]
      if (norm2(x) > 0.0_wp) frame(:, 1) = x/norm2(x)
      e = min(norm2(x), max_eccentricity)
      frame(:, 2) = [-frame(2, 1), frame(1, 1)]
      own = matmul(w, frame)
      s = sqrt((1.0_wp - e)*(1.0_wp + e))
      ends = [-0.5_wp, 0.5_wp]*two_pi
      if (.not. is_full) then
         angle = 0.0_wp
         if (any(abs(own) > 0.0_wp)) angle = modulo(atan2(own(2), own(1)), two_pi)
         ends = 0.5_wp*angle + 0.125_wp*two_pi*[-1.0_wp, 1.0_wp]      ! beta/2
         ends = 2.0_wp*atan2(-sqrt(1.0_wp - e)*cos(ends), sqrt(1.0_wp + e)*sin(ends))
      end if
      moments = 0.0_wp                                                ! of first**a second**b, a + b = 2, b rises
      slopes = 0.0_wp                                                 ! a + b = 3
      middle = [sin(0.25_wp*sum(ends)), cos(0.25_wp*sum(ends))]       ! of half angles, whose sines keep small angles
      do k = 1, size(nodes)
         weight = 0.5_wp*weights(k)*(ends(2) - ends(1))
         angle = 0.25_wp*nodes(k)*(ends(2) - ends(1))
         even = cos(angle)*middle
         odd = sin(angle)*[middle(2), -middle(1)]
         do side = 1, -1, -2
            half = even + side*odd                                    ! its sine, its cosine
            first = 2.0_wp*half(1)**2 - (1.0_wp - e)                  ! e + cos(gamma)
            second = -2.0_wp*s*half(1)*half(2)
            moments = moments + weight*[first**2, first*second, second**2]
            slopes = slopes + weight*[first**3, first**2*second, first*second**2, second**3]
         end do
      end do
      moments = moments/s**5
      slopes = 3.0_wp*slopes/s**7
      by_w = reshape([moments(1), moments(2), moments(2), moments(3)], [2, 2])
      by_x(:, 1) = own(1)*slopes(1:2) + own(2)*slopes(2:3)
      by_x(:, 2) = own(1)*slopes(2:3) + own(2)*slopes(3:4)
      if (norm2(x) > max_eccentricity) by_x = by_x*spread([0.0_wp, max_eccentricity/norm2(x)], 1, 2)
      force = matmul(frame, matmul(by_w, own))
      by_w = matmul(frame, matmul(by_w, transpose(frame)))
      by_x = matmul(frame, matmul(by_x, transpose(frame)))
   end subroutine press

   !> Distance of the journal beyond the largest eccentricity of the formula.
   pure function short_bearing_defects(self, z, v, p) result(defects)
      class(short_bearing_t), intent(in) :: self
      real(wp), intent(in) :: z(:, :), v(:, :), p(:, :)
      type(defects_t) :: defects

      defects%penetration = max(0.0_wp, maxval(norm2(z, dim=2)) - max_eccentricity*self%clearance)
   end function short_bearing_defects
end module hb_law_short_bearing
