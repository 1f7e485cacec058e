!> The course of a load over time, for time integration alone: it begins and ends, and its frequency may change meanwhile.
!>
!> The load is Re(c exp(i phi)) with c = cos - i sin. With a constant angular acceleration phi'' the frequency phi' is linear in
!> time, or it grows exponentially. The square of the frequency is that of an unbalance, -d**2/dt**2 of Re(c exp(i phi)), so that
!> it includes phi''.
module hb_load_course
   use hb_kinds, only: wp
   implicit none
   private
   public :: load_course_t, timed_load_t

   type :: load_course_t
      logical :: is_given = .false.                                   !! otherwise the load is a harmonic without begin or end
      real(wp) :: begin = -huge(1.0_wp), end = huge(1.0_wp)           !! [s]
      real(wp) :: origin = 0.0_wp                                     !! time at which the phase is zero and a chirp begins [s]
      real(wp) :: frequency = 0.0_wp                                  !! at the origin [rad/s]
      real(wp) :: end_frequency = 0.0_wp                              !! at the end [rad/s], > 0 of an exponential chirp
      logical :: has_own_frequency = .false.                          !! otherwise that of a tuple
      logical :: is_chirp = .false.
      logical :: is_exponential = .false.
      integer :: power = 0                                            !! of the frequency, by which amplitudes are multiplied
   contains
      procedure :: share => course_share
      procedure :: factor => course_factor
   end type load_course_t

   !> A load with a course.
   type :: timed_load_t
      type(load_course_t) :: course
      complex(wp), allocatable :: amplitude(:)                        !! c, without the power of the frequency [N], (n_dofs)
   end type timed_load_t

contains

   !> Part of an interval in which the load acts.
   elemental real(wp) function course_share(self, from, to) result(share)
      class(load_course_t), intent(in) :: self
      real(wp), intent(in) :: from, to                                !! [s], ascending

      share = max(0.0_wp, min(self%end, to) - max(self%begin, from))/(to - from)
   end function course_share

   !> exp(i phi), multiplied by the power of the frequency; defined before the begin and after the end, too.
   elemental complex(wp) function course_factor(self, time) result(factor)
      class(load_course_t), intent(in) :: self
      real(wp), intent(in) :: time                                    !! [s]
      real(wp) :: acceleration, duration, frequency, growth, phase

      acceleration = 0.0_wp
      frequency = self%frequency
      associate (s => time - self%origin)
         phase = frequency*s
         if (self%is_chirp) then
            duration = self%end - self%origin
            if (self%is_exponential) then
               growth = log(self%end_frequency/self%frequency)/duration
               frequency = self%frequency*exp(growth*s)
               acceleration = growth*frequency
               if (abs(growth) > 0.0_wp) phase = (frequency - self%frequency)/growth
            else
               acceleration = (self%end_frequency - self%frequency)/duration
               frequency = self%frequency + acceleration*s
               phase = 0.5_wp*(self%frequency + frequency)*s
            end if
         end if
      end associate
      factor = cmplx(cos(phase), sin(phase), wp)
      if (self%power == 2) then
         factor = factor*cmplx(frequency**2, -acceleration, wp)
      else if (self%power > 0) then
         factor = factor*abs(frequency)**self%power
      end if
   end function course_factor
end module hb_load_course
