!> The base frequencies of a motion, one per phase of hypertime.
module hb_tones
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_error, only: error_t, fail
   use hb_kinds, only: two_pi, wp
   use hb_text, only: rounded_to, to_text
   implicit none
   private
   public :: max_tones, new_tones, tones_t

   integer, parameter :: max_tones = 10                               ! larger grids would not fit into memory

   !> tau_m = omega_m t. The frequency of an unknown tone is a first guess, 0 if there is none.
   type :: tones_t
      integer :: n_tones = 0
      real(wp), allocatable :: omega(:)                               !! [rad/s], (n_tones), > 0 of given tones
      logical, allocatable :: is_unknown(:)                           !! (n_tones)
      integer :: subharmonic = 1 !! omega are the frequencies of the input divided by this number
      logical :: is_in_hertz = .false.                                !! of the input: unit of frequencies in texts
   contains
      procedure :: in_unit => tones_in_unit
      procedure :: unit => tones_unit
   end type tones_t

contains

   !> Creates tones of the given angular frequencies; fails unless there is at least one and each is finite and
   !> positive, or zero if it is unknown.
   pure subroutine new_tones(self, omega, error, is_unknown)
      type(tones_t), intent(out) :: self
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones)
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: is_unknown(:)                  !! (n_tones), default: none
      integer :: m

      if (size(omega) < 1) then
         call fail(error, "there must be at least one tone")
         return
      else if (size(omega) > max_tones) then
         call fail(error, "there are "//to_text(size(omega))//" tones; at most "//to_text(max_tones)//" are supported")
         return
      end if
      self%is_unknown = spread(.false., 1, size(omega))
      if (present(is_unknown)) self%is_unknown = is_unknown
      do m = 1, size(omega)
         if (self%is_unknown(m) .and. omega(m) == 0.0_wp) cycle
         if (ieee_is_finite(omega(m)) .and. omega(m) > 0.0_wp) cycle
         call fail(error, "the frequency of tone "//to_text(m)//" must be a positive number")
         return
      end do
      self%n_tones = size(omega)
      self%omega = omega
   end subroutine new_tones

   !> A frequency in the unit of the input, in hertz without rounding errors of its last digit.
   elemental real(wp) function tones_in_unit(self, omega) result(frequency)
      class(tones_t), intent(in) :: self
      real(wp), intent(in) :: omega                                   !! [rad/s]

      frequency = omega
      if (self%is_in_hertz) frequency = rounded_to(omega/two_pi, 15)
   end function tones_in_unit

   !> The unit of the input.
   pure character(5) function tones_unit(self) result(unit)
      class(tones_t), intent(in) :: self

      unit = merge("Hz   ", "rad/s", self%is_in_hertz)
   end function tones_unit
end module hb_tones
