!> What a result says of a motion, which a time integration verifies (hb_verification).
module hb_claim
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite, ieee_is_nan, ieee_quiet_nan, ieee_value
   use hb_error, only: annotate, error_t, fail
   use hb_harmonics, only: harmonics_t, new_harmonics
   use hb_kinds, only: wp
   use hb_motion_result, only: motion_result_t
   use hb_outcome, only: is_integrated
   use hb_text, only: to_text
   implicit none
   private
   public :: claim_t, new_claim

   real(wp), parameter :: greatest_amplitude = 1.0e100_wp             ! [m]; the squares of larger ones overflow in sums

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
   contains
      procedure :: check => claim_check
      procedure :: leave_out_absent => claim_leave_out_absent
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
      call claim%leave_out_absent()
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

   !> Sets the harmonics that a point does not have to zero: those of a file for points of several sets are NaN at all degrees of
   !> freedom there.
   pure subroutine claim_leave_out_absent(self)
      class(claim_t), intent(inout) :: self
      logical :: is_absent(size(self%amplitudes, 1))
      integer :: h

      is_absent = all(ieee_is_nan(real(self%amplitudes)) .and. ieee_is_nan(aimag(self%amplitudes)), dim=2)
      if (all(is_absent)) return
      do h = 1, size(is_absent)
         if (is_absent(h)) self%amplitudes(h, :) = (0.0_wp, 0.0_wp)
      end do
   end subroutine claim_leave_out_absent

   !> Rejects what cannot be a motion: frequencies that are not positive, amplitudes that are no numbers, tuples that are no set.
   subroutine claim_check(self, n_tones, n_dofs, error)
      class(claim_t), intent(in) :: self
      integer, intent(in) :: n_tones, n_dofs                          !! of the model
      type(error_t), allocatable, intent(out) :: error
      type(harmonics_t) :: set
      logical :: is_wrong
      integer :: m

      is_wrong = size(self%omega) /= n_tones .or. size(self%tuples, 1) /= n_tones
      if (.not. is_wrong) is_wrong = any(shape(self%amplitudes) /= [size(self%tuples, 2), n_dofs])
      if (is_wrong) then
         call fail(error, "the motion has "//to_text(size(self%omega))//" tones and "//to_text(size(self%amplitudes, 2))// &
                   " degrees of freedom, the model "//to_text(n_tones)//" and "//to_text(n_dofs))
         return
      end if
      do m = 1, n_tones
         if (ieee_is_finite(self%omega(m)) .and. self%omega(m) > 0.0_wp) cycle
         call fail(error, "the frequency of tone "//to_text(m)//" of the motion is "//to_text(self%omega(m))// &
                   " rad/s; it must be positive")
         return
      end do
      if (.not. all(abs(real(self%amplitudes)) < greatest_amplitude .and. abs(aimag(self%amplitudes)) < greatest_amplitude)) then
         call fail(error, "a coefficient of the motion is no number, or is too large")
         return
      end if
      if (any(self%tuples < -huge(1))) then
         call fail(error, "tuples of the motion are no set of harmonics")
         return
      end if
      call new_harmonics(set, self%tuples, error)
      call annotate(error, "tuples of the motion are no set of harmonics")
   end subroutine claim_check
end module hb_claim
