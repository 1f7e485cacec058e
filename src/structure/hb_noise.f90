!> White noise that acts on a structure about its motion: no part of the balance, it causes the covariance of hb_noise_response.
!> The two-sided spectral density of a force of intensity D is 2 D: its covariance is 2 D delta(t - t').
module hb_noise
   use hb_kinds, only: wp
   use hb_numbers, only: number_t, numbers_t
   use hb_spectrum, only: spectrum_t
   use hb_structure, only: structure_t
   use hb_structure_load, only: random_structure_load_t
   implicit none
   private
   public :: noise_t

   type, extends(random_structure_load_t) :: noise_t
      real(wp) :: intensity = 0.0_wp                                  !! D [N**2 s]
      real(wp) :: factor = 1.0_wp                                     !! of the force
   contains
      procedure :: add_slope_to => noise_add_slope_to
      procedure :: add_to => noise_add_to
      procedure :: declare_numbers => noise_declare_numbers
      procedure :: derive => noise_derive
      procedure :: has_tuple => noise_has_tuple
      procedure :: has_valid_numbers => noise_has_valid_numbers
      procedure :: is_zero => noise_is_zero
   end type noise_t

contains

   subroutine noise_declare_numbers(self, numbers)
      class(noise_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("intensity", self%intensity, required=.true.)
      call numbers%add("factor", self%factor)
      call numbers%add("source", self%source)
   end subroutine noise_declare_numbers

   logical function noise_has_valid_numbers(self) result(are_valid)
      class(noise_t), intent(in) :: self

      are_valid = self%intensity >= 0.0_wp
   end function noise_has_valid_numbers

   pure subroutine noise_derive(self)
      class(noise_t), intent(inout) :: self

      self%strength = self%factor*sqrt(2.0_wp*max(self%intensity, 0.0_wp))
   end subroutine noise_derive

   !> Adds nothing: its mean is zero.
   subroutine noise_add_to(self, structure, omega, loads, slopes)
      class(noise_t), intent(in) :: self
      type(structure_t), intent(in) :: structure
      real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s], (n_tones)
      type(spectrum_t), intent(inout) :: loads                        !! [N]
      type(spectrum_t), intent(inout), optional :: slopes             !! their derivatives by j.omega [N s]
   end subroutine noise_add_to

   !> Adds nothing, either.
   subroutine noise_add_slope_to(self, number, structure, omega, slope, is_known)
      class(noise_t), intent(in) :: self
      type(number_t), intent(in) :: number
      type(structure_t), intent(in) :: structure
      real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s], (n_tones)
      type(spectrum_t), intent(inout) :: slope
      logical, intent(out) :: is_known

      is_known = .true.
   end subroutine noise_add_slope_to

   !> It has none.
   pure logical function noise_has_tuple(self) result(has)
      class(noise_t), intent(in) :: self

      has = .false.
   end function noise_has_tuple

   !> Its mean.
   pure logical function noise_is_zero(self) result(is_zero)
      class(noise_t), intent(in) :: self

      is_zero = .true.
   end function noise_is_zero
end module hb_noise
