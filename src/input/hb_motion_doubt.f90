!> What is doubtful about a motion, in words: its status with numbers and limits, and what to do.
module hb_motion_doubt
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_kinds, only: wp
   use hb_motion_result, only: motion_result_t
   use hb_options, only: options_t
   use hb_outcome, only: is_solved, outcome, outcome_name, outcome_text, reason
   use hb_remedies, only: remedy_of
   use hb_text, only: number_of, rounded, rounded_beside
   implicit none
   private
   public :: describe_doubt, sticking_text

contains

   !> That joints stick throughout motions, which are then each one of many; empty if none does.
   pure subroutine sticking_text(n_points, is_of_many, text)
      integer, intent(in) :: n_points                                 !! with such joints
      logical, intent(in) :: is_of_many                               !! points: they are counted
      character(:), allocatable, intent(out) :: text

      text = ""
      if (n_points == 0) return
      if (is_of_many) text = "in "//number_of(n_points, "point")//" "
      text = text//"joints stick throughout (see 'n_full_stick'): a continuum of motions is possible, with any force that they "// &
             "hold; stored is the one that is loaded from rest"
   end subroutine sticking_text

   !> Describes why a motion has not converged, or is less accurate than requested; an empty text for a motion without doubt.
   subroutine describe_doubt(options, motion, text)
      type(options_t), intent(in) :: options
      type(motion_result_t), intent(in) :: motion
      character(:), allocatable, intent(out) :: text

      text = ""
      if (motion%reason == reason%unlocated .and. allocated(motion%message)) &
         text = motion%message//"; a smaller &curve max_step may locate them"
      if (any(motion%status == [outcome%pending, outcome%converged, outcome%unused, outcome%interrupted])) return
      text = outcome_text(motion%status)
      if (.not. is_solved(motion%status)) then
         if (allocated(motion%message)) then
            if (len_trim(motion%message) > 0) text = outcome_name(motion%status)//": "//trim(motion%message)
         end if
      else if (allocated(motion%error_estimate%combination)) then
         associate (accuracy => options%accuracy, error_estimate => options%error_estimate)
            call add("; estimated error ", motion%error_estimate%truncation, " by truncation", &
                     merge(accuracy%tolerance, error_estimate%truncation, accuracy%is_on))
            call add(", ", motion%error_estimate%aliasing, " by aliasing", &
                     merge(accuracy%tolerance, error_estimate%aliasing, accuracy%is_on))
            if (motion%level_estimate > 0.0_wp) call add(", ", motion%level_estimate, " by refinement", accuracy%tolerance)
         end associate
      end if
      text = text//". "//trim(remedy_of(motion%status, options%accuracy%is_on .and. &
                                        (options%accuracy%grows_set .or. motion%status /= outcome%truncated)))

   contains

      subroutine add(sign, value, cause, limit)
         character(*), intent(in) :: sign, cause
         real(wp), intent(in) :: value, limit

         if (.not. ieee_is_finite(value)) return
         text = text//sign//trim(rounded_beside(value, limit))//cause//" (limit "//rounded(limit)//")"
      end subroutine add
   end subroutine describe_doubt
end module hb_motion_doubt
