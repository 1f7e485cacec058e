!> The stability of a motion that was found on levels, its samples, and its comparison with a time integration.
module hb_level_stability
   use hb_base_change, only: base_change_t
   use hb_discretisation, only: discretisation_t
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_level, only: check_discretisation, estimate_of_motion, level_t
   use hb_level_solver, only: solve_level
   use hb_motion, only: solve_system
   use hb_motion_description, only: add_stability_of, allow_for_growth, compare_with_refined
   use hb_motion_result, only: motion_result_t
   use hb_options, only: options_t
   use hb_outcome, only: outcome, reason
   use hb_stability, only: few_periods, harmonic_motion_t, stability_method
   use hb_system, only: system_t
   use hb_text, only: rounded
   use hb_tones, only: tones_t
   implicit none
   private
   public :: add_stability, allow_for_departure

contains

   !> Solves the last level again, with stability and samples of the motion.
   subroutine add_stability(system, options, top, tolerance, work_spent, compares, result)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(level_t), intent(in) :: top
      real(wp), intent(in) :: tolerance                               !! residual of the motion
      real(wp), intent(in) :: work_spent                              !! for the motion
      logical, intent(in) :: compares                                 !! with a short time integration
      type(motion_result_t), intent(inout) :: result
      type(options_t) :: alone                                        !! the motion and its stability, without estimates
      type(tones_t) :: tones
      type(motion_result_t) :: whole
      type(error_t), allocatable :: error
      type(base_change_t) :: base
      real(wp), allocatable :: guess(:)

      alone = options
      alone%may_integrate = .false.
      alone%error_estimate%is_on = .false.
      alone%solver%tolerance = tolerance
      alone%stability%work_spent = work_spent
      alone%compares_in_time = compares
      if (alone%stability%method == stability_method%auto) alone%stability%min_periods = few_periods
      guess = top%unknowns
      if (size(options%output%samples) == 0) call base%choose(system, alone, top, guess) ! else over given phases
      if (.not. base%is_on) then
         call check_discretisation(system, top%discretisation_t, alone, error)
         if (.not. allocated(error)) call solve_system(system, top%discretisation_t, alone, whole, error, guess)
      else
         call solve_for_all_dofs(system, alone, top, whole, error)
         if (.not. allocated(error) .and. whole%status == outcome%converged) &
            call add_stability_of(system, alone, motion_of(top%harmonics, system%tones, whole), whole)
      end if
      if (allocated(error) .or. whole%status /= outcome%converged) return
      if (result%status == outcome%converged) then
         result%stability = whole%stability
         tones = system%tones
         tones%omega = result%frequency
         call compare_with_refined(system, alone, tones, result%error_estimate, result%stability)
         call allow_for_growth(result, options%accuracy%tolerance)
         call allow_for_departure(whole%departure, options%accuracy%tolerance, result)
      end if
      if (.not. allocated(whole%displacement_samples)) return
      result%displacement_samples = whole%displacement_samples
      result%force_samples = whole%force_samples
      result%corrected_samples = whole%corrected_samples
   end subroutine add_stability

   !> Solves the level for the motion of all degrees of freedom. Periods of its stability are those of the given tones.
   subroutine solve_for_all_dofs(system, options, top, whole, error)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(level_t), intent(in) :: top
      type(motion_result_t), intent(out) :: whole
      type(error_t), allocatable, intent(out) :: error
      type(options_t) :: of_all
      real(wp), allocatable :: guess(:), found(:)
      integer :: i

      of_all = options
      of_all%stability%method = stability_method%off
      of_all%compares_in_time = .false.
      of_all%output%dofs = [(i, i=1, system%structure%n_dofs)]
      guess = top%unknowns
      call solve_level(system, of_all, top, guess, whole, error, found)
   end subroutine solve_for_all_dofs

   !> The motion of a result that has the coefficients of all degrees of freedom.
   pure function motion_of(set, tones, whole) result(motion)
      type(harmonics_t), intent(in) :: set
      type(tones_t), intent(in) :: tones
      type(motion_result_t), intent(in) :: whole
      type(harmonic_motion_t) :: motion
      complex(wp) :: amplitudes(size(whole%coefficients, 3), set%n_harmonics)
      integer :: i

      do i = 1, size(amplitudes, 1)
         amplitudes(i, :) = cmplx(whole%coefficients(1, :, i), -whole%coefficients(2, :, i), wp)
      end do
      motion = harmonic_motion_t(set%tuples, tones, amplitudes)
   end function motion_of

   !> If a time integration from a motion leaves it by more than its estimated error and the tolerance explain, the difference is
   !> its error.
   subroutine allow_for_departure(departure, tolerance, result)
      real(wp), intent(in) :: departure                               !! relative; negative if it is not known
      real(wp), intent(in) :: tolerance
      type(motion_result_t), intent(inout) :: result
      real(wp), parameter :: max_ratio = 2.0_wp                       ! of the estimate: it may be too small by as much

      result%departure = departure
      if (result%status /= outcome%converged .or. departure <= max_ratio*max(tolerance, estimate_of_motion(result))) return
      result%status = outcome%truncated
      result%reason = reason%departure
      result%level_estimate = min(1.0_wp, departure)
      result%message = "a time integration that starts on the motion leaves it by "//rounded(departure)// &
                       ", more than the estimated error: the motion may jump within a period of the slowest tone"
   end subroutine allow_for_departure
end module hb_level_stability
