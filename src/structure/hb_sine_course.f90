!> The course of a sine, or of a chirp, whose frequency changes while it acts.
!>
!> The factor is exp(i phi). With a constant angular acceleration phi'' the frequency phi' is linear in time, or it grows
!> exponentially. The square of the frequency is that of an unbalance, -d**2/dt**2 of Re(c exp(i phi)), so that it includes
!> phi''.
module hb_sine_course
   use hb_kinds, only: wp
   use hb_load_course, only: load_course_t
   implicit none
   private
   public :: sine_course_t

   type, extends(load_course_t) :: sine_course_t
      real(wp) :: origin = 0.0_wp                                     !! time at which the phase is zero and a chirp begins [s]
      real(wp) :: frequency = 0.0_wp                                  !! at the origin [rad/s]
      real(wp) :: end_frequency = 0.0_wp                              !! at the end [rad/s], > 0 of an exponential chirp
      logical :: is_chirp = .false.
      logical :: is_exponential = .false.
      integer :: power = 0                                            !! of the frequency, by which amplitudes are multiplied
   contains
      procedure :: factor => sine_course_factor
      procedure :: highest_frequency => sine_course_highest_frequency
   end type sine_course_t

contains

   !> exp(i phi), multiplied by the power of the frequency.
   pure complex(wp) function sine_course_factor(self, time) result(factor)
      class(sine_course_t), intent(in) :: self
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
   end function sine_course_factor

   pure real(wp) function sine_course_highest_frequency(self) result(highest)
      class(sine_course_t), intent(in) :: self

      highest = max(abs(self%frequency), self%end_frequency)
   end function sine_course_highest_frequency
end module hb_sine_course
