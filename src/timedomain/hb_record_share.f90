!> Parts of a record of motion: what its series leaves, and by how much motions differ, relative to the motion.
module hb_record_share
   use hb_cancellation, only: work_is_over
   use hb_kinds, only: wp
   use hb_thresholds, only: rounding_level
   use hb_time_stepping, only: integration_record_t
   implicit none
   private
   public :: amplitude_of, as_real, distance_of, largest_in_parts, largest_share, remainder_of, scale_of

   integer, parameter :: parts_of_record = 4                          ! of a record; the worst one determines the error of a series

contains

   !> Largest root mean square of the remainder of a record, in a part of it, relative to that of its motion without
   !> the mean.
   pure real(wp) function largest_share(remainder, z, rest) result(share)
      real(wp), intent(in) :: remainder(:, :)                         !! (any, n_coordinates)
      real(wp), intent(in) :: z(:, :)                                 !! the record, (n_samples, n_coordinates)
      real(wp), intent(in) :: rest(:)                                 !! as for `scale_of`

      share = maxval(norm2(remainder, 1)/scale_of(z, rest))/sqrt(real(size(remainder, 1), wp))
   end function largest_share

   !> Returns the largest such share of the parts of a record, each as long as the part not used by a fit: the phases
   !> of several tones for which a series is worst may be in any of them, and a fit has little weight at the
   !> beginning.
   pure real(wp) function largest_in_parts(remainder, z, rest) result(share)
      real(wp), intent(in) :: remainder(:, :), z(:, :)                !! (n_samples, n_coordinates)
      real(wp), intent(in) :: rest(:)                                 !! as for `scale_of`
      integer :: part

      share = 0.0_wp
      associate (n => size(z, 1))
         do part = 1, parts_of_record
            share = max(share, largest_share(remainder((part - 1)*n/parts_of_record + 1:part*n/parts_of_record, :), z, rest))
         end do
      end associate
   end function largest_in_parts

   !> Root mean squares of a record without the means. What moves less than rounding of its place, or than `rest`, is at rest:
   !> what is left of it is compared with this.
   pure function scale_of(z, rest) result(scale)
      real(wp), intent(in) :: z(:, :)                                 !! (n_samples, n_coordinates)
      real(wp), intent(in) :: rest(:)                                 !! motion that counts as none, (n_coordinates)
      real(wp) :: scale(size(z, 2))
      integer :: k

      scale = [(norm2(z(:, k) - sum(z(:, k))/size(z, 1))/sqrt(real(size(z, 1), wp)), k=1, size(z, 2))]
      scale = max(scale, rest, rounding_level*maxval(abs(z), dim=1))
      where (scale <= 0.0_wp) scale = 1.0_wp
   end function scale_of

   !> Amplitude of an oscillation with the same root mean square, for the coordinate with the largest one.
   pure real(wp) function amplitude_of(z) result(amplitude)
      real(wp), intent(in) :: z(:, :)                                 !! (n_samples, n_coordinates)
      integer :: k

      amplitude = sqrt(2.0_wp/size(z, 1))*maxval([(norm2(z(:, k) - sum(z(:, k))/size(z, 1)), k=1, size(z, 2))])
   end function amplitude_of

   !> Real and imaginary parts below each other.
   pure function as_real(c) result(parts)
      complex(wp), intent(in) :: c(:, :)                              !! (n_harmonics, n_coordinates)
      real(wp) :: parts(2*size(c, 1), size(c, 2))

      parts(:size(c, 1), :) = real(c)
      parts(size(c, 1) + 1:, :) = aimag(c)
   end function as_real

   !> Differences of motions relative to the first, by coordinate, for coefficients above `least`.
   pure function distance_of(c, other, least, rest) result(distance)
      complex(wp), intent(in) :: c(:, :), other(:, :)                 !! (n_harmonics, n_coordinates)
      real(wp), intent(in) :: least
      real(wp), intent(in), optional :: rest(:)                       !! as for `scale_of`; default: 0
      real(wp) :: distance(size(c, 2)), own
      integer :: k

      do k = 1, size(c, 2)
         own = max(norm2(abs(c(:, k))), tiny(1.0_wp))
         if (present(rest)) own = max(own, rest(k))
         distance(k) = norm2(pack(abs(c(:, k) - other(:, k)), abs(c(:, k)) >= least*own))/own
      end do
   end function distance_of

   !> Remainder of a record without its series.
   function remainder_of(x, c, record, frequencies) result(remainder)
      real(wp), intent(in) :: x(:, :)                                 !! (n_samples, any)
      complex(wp), intent(in) :: c(:, :)                              !! (n_harmonics, any)
      type(integration_record_t), intent(in) :: record
      real(wp), intent(in) :: frequencies(:)                          !! [rad/s]
      real(wp) :: remainder(size(x, 1), size(x, 2))
      integer, parameter :: steps_between_cosines = 256
      complex(wp) :: phasor(size(frequencies)), rotation(size(frequencies))
      integer :: i, k

      remainder = 0.0_wp
      rotation = exp(cmplx(0.0_wp, frequencies*record%step, wp))
      do i = 1, size(x, 1)
         if (modulo(i - 1, steps_between_cosines) == 0) then
            if (work_is_over()) exit
            phasor = exp(cmplx(0.0_wp, frequencies*(record%start + (i - 1)*record%step), wp))
         else
            phasor = phasor*rotation
         end if
         do k = 1, size(x, 2)
            remainder(i, k) = x(i, k) - sum(real(c(:, k)*phasor, wp))
         end do
      end do
   end function remainder_of
end module hb_record_share
