!> What a result says of a motion, which a time integration verifies (hb_verification).
module hb_claim
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_kinds, only: wp
   use hb_motion_result, only: motion_result_t
   use hb_outcome, only: is_integrated
   implicit none
   private
   public :: claim_t, new_claim

   !> A motion with its estimated errors.
   type :: claim_t
      integer, allocatable :: tuples(:, :)                            !! (n_tones, n_harmonics)
      real(wp), allocatable :: omega(:)                               !! [rad/s], (n_tones)
      complex(wp), allocatable :: amplitudes(:, :)                    !! cos - i sin [m], (n_harmonics, n_dofs)
      real(wp) :: estimate = 0.0_wp                                 !! by truncation and aliasing together, relative; NaN: not known
      real(wp), allocatable :: frequency_estimates(:)                 !! [rad/s], (n_tones); NaN: not known
      logical :: is_unstable = .false.                                !! according to its multipliers or exponents
      logical :: is_averaged = .false. !! it was computed by time integration, as averages in a given set
      real(wp) :: spread = 0.0_wp                                     !! of these averages, relative
   end type claim_t

contains

   !> The claim of a motion at all degrees of freedom.
   subroutine new_claim(claim, motion, tuples, grows_set)
      type(claim_t), intent(out) :: claim
      type(motion_result_t), intent(in) :: motion
      integer, intent(in) :: tuples(:, :)                             !! of the model, for a motion without tuples of its own
      logical, intent(in) :: grows_set                                !! the motion was solved to a tolerance

      claim%omega = motion%frequency
      claim%tuples = tuples
      if (allocated(motion%harmonics%tuples)) claim%tuples = motion%harmonics%tuples
      claim%amplitudes = cmplx(motion%coefficients(1, :, :), -motion%coefficients(2, :, :), wp)
      claim%estimate = ieee_value(1.0_wp, ieee_quiet_nan)
      claim%spread = claim%estimate
      claim%frequency_estimates = claim%estimate + 0.0_wp*motion%frequency
      if (allocated(motion%error_estimate%combination)) then
         claim%estimate = motion%error_estimate%truncation + motion%error_estimate%aliasing
         claim%spread = motion%error_estimate%aliasing
      end if
      if (allocated(motion%error_estimate%frequency_error)) claim%frequency_estimates = motion%error_estimate%frequency_error
      claim%is_unstable = motion%stability%n_unstable > 0
      claim%is_averaged = is_integrated(motion%status) .and. .not. grows_set
   end subroutine new_claim
end module hb_claim
