!> Amplitude and phase of one harmonic of a load or of a first guess, cos cos(j.tau + phi) + sin sin(j.tau + phi).
module hb_harmonic_amplitude
   use hb_kinds, only: two_pi, wp
   use hb_numbers, only: numbers_t
   implicit none
   private
   public :: harmonic_amplitude_t

   type :: harmonic_amplitude_t
      real(wp) :: cosine = 0.0_wp, sine = 0.0_wp
      real(wp) :: phase = 0.0_wp                                      !! phi [rad], without effect on a constant
   contains
      procedure :: declare => amplitude_declare
      procedure :: turned => amplitude_turned
      procedure :: slope => amplitude_slope
      procedure :: is_zero => amplitude_is_zero
   end type harmonic_amplitude_t

contains

   !> Declares the numbers for the object that has them.
   subroutine amplitude_declare(self, numbers, unit)
      class(harmonic_amplitude_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers
      character(*), intent(in) :: unit

      call numbers%add("cos", self%cosine, unit=unit)
      call numbers%add("sin", self%sine, unit=unit)
      call numbers%add("phase", self%phase)
   end subroutine amplitude_declare

   !> c = cos - i sin, ahead by the phase unless it belongs to a constant.
   pure complex(wp) function amplitude_turned(self, is_constant) result(c)
      class(harmonic_amplitude_t), intent(in) :: self
      logical, intent(in) :: is_constant
      real(wp) :: phase

      phase = merge(0.0_wp, self%phase, is_constant)
      c = cmplx(self%cosine*cos(phase) + self%sine*sin(phase), -(self%sine*cos(phase) - self%cosine*sin(phase)), wp)
   end function amplitude_turned

   !> The derivative by one of the numbers: linear in the amplitudes, and a quarter of a period ahead for the phase. Zero, and
   !> `is_known` is false, for other keys.
   pure subroutine amplitude_slope(self, key, is_constant, slope, is_known)
      class(harmonic_amplitude_t), intent(in) :: self
      character(*), intent(in) :: key
      logical, intent(in) :: is_constant                              !! on which the phase has no effect
      type(harmonic_amplitude_t), intent(out) :: slope
      logical, intent(out) :: is_known

      is_known = any(key == [character(5) :: "cos", "sin", "phase"])
      slope%phase = self%phase
      if (key == "cos") slope%cosine = 1.0_wp
      if (key == "sin") slope%sine = 1.0_wp
      if (key /= "phase" .or. is_constant) return
      slope = harmonic_amplitude_t(self%cosine, self%sine, self%phase + 0.25_wp*two_pi)
   end subroutine amplitude_slope

   !> Whether both amplitudes are zero.
   pure logical function amplitude_is_zero(self) result(is_zero)
      class(harmonic_amplitude_t), intent(in) :: self

      is_zero = .not. (abs(self%cosine) > 0.0_wp .or. abs(self%sine) > 0.0_wp)
   end function amplitude_is_zero
end module hb_harmonic_amplitude
