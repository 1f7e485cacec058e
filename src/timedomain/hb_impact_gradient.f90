!> Derivatives of motions with impacts, which time integration has found, with respect to numbers of the model: those of the
!> periodic motion nearby (hb_impact_orbit).
module hb_impact_gradient
   use hb_error, only: error_t
   use hb_gradient, only: store_slope, zero_gradient
   use hb_harmonics, only: harmonics_t
   use hb_impact_orbit, only: impact_orbit_t, motion_slopes_t, new_impact_orbit, orbit_tolerance
   use hb_kinds, only: wp
   use hb_model, only: model_t
   use hb_motion_result, only: motion_result_t
   use hb_motion_series, only: motion_series_t, new_motion_series
   use hb_newton, only: solve_newton
   use hb_options, only: options_t
   use hb_outcome, only: outcome
   use hb_solver_types, only: report_t, solver_config_t
   use hb_system, only: system_t
   implicit none
   private
   public :: find_impact_gradient, has_periodic_impacts, store_slopes

   integer, parameter :: max_shots = 30                               ! of Newton's method
   real(wp), parameter :: max_state_distance = 0.1_wp                 ! the periodic state, scaled: harmonics are few

contains

   !> Whether motions with impacts are periodic, so that they have derivatives.
   logical function has_periodic_impacts(system, options)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options

      has_periodic_impacts = system%tones%n_tones == 1 .and. .not. any(system%tones%is_unknown)
      if (has_periodic_impacts) has_periodic_impacts = options%lacks_impacts_of(system, outcome%impact)
   end function has_periodic_impacts

   !> Adds the derivatives to a result of time integration; there are none if no periodic motion is found nearby.
   subroutine find_impact_gradient(model, result)
      type(model_t), intent(in) :: model                              !! at the point
      type(motion_result_t), intent(inout) :: result                  !! with the coefficients of all degrees of freedom
      type(error_t), allocatable :: error
      type(harmonics_t) :: set
      type(impact_orbit_t) :: orbit
      type(motion_series_t) :: motion
      type(motion_slopes_t) :: slopes
      type(report_t) :: report
      real(wp), allocatable :: begun(:), x(:)

      if (result%status /= outcome%integrated .or. .not. allocated(result%coefficients)) return
      set = model%discretisation%harmonics
      if (model%options%accuracy%is_on) set = result%harmonics
      associate (c => transpose(cmplx(result%coefficients(1, :, :), -result%coefficients(2, :, :), wp)))
         call new_motion_series(motion, set%tuples, model%system%tones%omega, c)
         call new_impact_orbit(orbit, model%system, model%discretisation, model%options, motion, error)
         if (.not. allocated(error)) then
            begun = orbit%map%state_at(orbit%section*orbit%period())
            x = begun
            call solve_newton(orbit, solver_config_t(tolerance=orbit_tolerance, max_iterations=max_shots), x, report)
            if (report%status == outcome%converged .and. maxval(abs(x - begun)) <= max_state_distance) then
               call orbit%find_slopes(set, x, model%options%gradient%by, slopes, error)
               call store_slopes(model, set, slopes, c, result)
               if (allocated(error) .and. .not. allocated(result%message)) result%message = "no derivatives: "//error%message
            end if
         end if
      end associate
      call orbit%destroy()
   end subroutine find_impact_gradient

   !> Stores derivatives in a result, if there are any.
   subroutine store_slopes(model, set, slopes, c, result)
      type(model_t), intent(in) :: model
      type(harmonics_t), intent(in) :: set
      type(motion_slopes_t), intent(in) :: slopes
      complex(wp), intent(in) :: c(:, :)                              !! the motion [m], (n_dofs, n_harmonics)
      type(motion_result_t), intent(inout) :: result
      integer, allocatable :: dofs(:)
      integer :: k

      if (.not. allocated(slopes%amplitudes)) return
      associate (options => model%options, gradient => result%gradient)
         gradient = zero_gradient(model%system, options, set)
         dofs = options%output%dofs
         if (allocated(options%gradient%of)) then
            dofs = [options%gradient%of%dof]
            call options%gradient%of%find_weights(set, c(dofs(1), :), gradient%weights)
         end if
         do k = 1, size(slopes%estimate)
            call store_slope(gradient, dofs, k, slopes%amplitudes(:, :, k))
         end do
         gradient%frequency = slopes%frequency
         gradient%estimate = slopes%estimate
         gradient%defect = slopes%defect
      end associate
   end subroutine store_slopes
end module hb_impact_gradient
