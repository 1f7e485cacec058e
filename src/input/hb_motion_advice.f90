!> Advice on a motion: its status with numbers and limits, and what to do.
module hb_motion_advice
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_advice, only: advice, advice_list_t, has_row
   use hb_kinds, only: wp
   use hb_motion_result, only: advise_on_reason, motion_result_t
   use hb_options, only: options_t
   use hb_outcome, only: is_solved, outcome, outcome_name, outcome_text, reason
   use hb_stability, only: noise_status, unknown_because
   use hb_structure, only: max_dense
   implicit none
   private
   public :: advise_on_motion, advise_on_status, advise_on_verdict

   integer, parameter :: with_order = 100, with_tolerance = 200       ! beyond the number of a status

contains

   !> Says why a motion has not converged, or is less accurate than requested; nothing on a motion without doubt.
   subroutine advise_on_motion(options, motion, list)
      type(options_t), intent(in) :: options
      type(motion_result_t), intent(in) :: motion
      type(advice_list_t), intent(inout) :: list

      if (motion%n_full_stick > 0) call list%add(advice%full_stick)
      if (motion%is_beyond_tables) call list%add(advice%beyond_tables, [1.0_wp])
      if (motion%stability%response%status > noise_status%known) call list%add(advice%unknown_noise, [1.0_wp])
      if (motion%reason == reason%unlocated .and. allocated(motion%message)) then
         call list%add(advice%outcome, a=motion%message)
         call advise_on_reason(motion%reason, list)
      end if
      if (any(motion%status == [outcome%pending, outcome%converged, outcome%unused, outcome%interrupted])) return
      if (.not. is_solved(motion%status) .and. allocated(motion%message)) then
         call list%add(advice%outcome, a=outcome_name(motion%status)//": "//motion%message)
      else
         call list%add(advice%outcome, a=outcome_text(motion%status))
      end if
      call motion%list_advice(list)
      associate (accuracy => options%accuracy, errors => motion%error_estimate, limits => options%error_estimate)
         if (is_solved(motion%status) .and. allocated(errors%combination)) then
            call add_error("by truncation", errors%truncation, limits%truncation)
            call add_error("by aliasing", errors%aliasing, limits%aliasing)
            call add_error("by refinement", motion%level_estimate, accuracy%tolerance)
         end if
         call advise_on_status(motion%status, list, &
                               accuracy%is_on .and. (accuracy%grows_set .or. motion%status /= outcome%truncated))
      end associate

   contains

      subroutine add_error(cause, estimate, limit)
         character(*), intent(in) :: cause
         real(wp), intent(in) :: estimate, limit                      !! the limit without a tolerance

         if (ieee_is_finite(estimate) .and. estimate > 0.0_wp) call list%add(advice%estimated_error, &
            [estimate, merge(options%accuracy%tolerance, limit, options%accuracy%is_on)], cause)
      end subroutine add_error
   end subroutine advise_on_motion

   !> Says what to do about a status of `hb_outcome`.
   pure subroutine advise_on_status(status, list, is_adaptive)
      integer, intent(in) :: status
      type(advice_list_t), intent(inout) :: list
      logical, intent(in), optional :: is_adaptive !! by a tolerance, for harmonics or samples; not present: for both cases
      integer :: number, of_case

      number = advice%if_pending + status
      of_case = number
      if (present(is_adaptive)) of_case = number + merge(with_tolerance, with_order, is_adaptive)
      call list%add(merge(of_case, number, has_row(of_case)))
   end subroutine advise_on_status

   !> Says why the stability of points is not known, and what to do.
   pure subroutine advise_on_verdict(reason, n_points, is_requested, list)
      integer, intent(in) :: reason                                   !! of `unknown_because`
      integer, intent(in) :: n_points
      logical, intent(in) :: is_requested                             !! whatever it costs
      type(advice_list_t), intent(inout) :: list
      integer :: number

      select case (reason)
      case (unknown_because%too_costly)
         number = merge(advice%stability_beyond_limit, advice%stability_too_costly, is_requested)
      case (unknown_because%too_large)
         number = advice%stability_too_large
      case (unknown_because%too_many_cycles)
         number = advice%stability_too_many_cycles
      case (unknown_because%no_equations)
         number = advice%stability_no_equations
      case (unknown_because%at_limit)
         number = advice%stability_at_limit
      case (unknown_because%inaccurate)
         number = advice%stability_inaccurate
      case (unknown_because%growing)
         number = advice%stability_growing
      case (unknown_because%contradicted)
         number = advice%stability_contradicted
      case default                                                    ! the status says it
         return
      end select
      call list%add(number, real([n_points, max_dense], wp))
   end subroutine advise_on_verdict
end module hb_motion_advice
