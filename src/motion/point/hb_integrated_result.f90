!> The result of a point whose motion was found by time integration.
module hb_integrated_result
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_amplitudes, only: amplitudes_t
   use hb_coordinates, only: coordinates_t
   use hb_discretisation, only: discretisation_t
   use hb_error_estimate, only: near_commensurate
   use hb_floquet, only: stability_of_map
   use hb_kinds, only: wp
   use hb_mean_energy, only: new_mean_energy
   use hb_motion_description, only: request_stability, store_motion
   use hb_motion_result, only: as_pairs, motion_result_t
   use hb_options, only: options_t
   use hb_outcome, only: is_lost, outcome, reason
   use hb_stability, only: harmonic_motion_t, stability_method, stability_t, unknown_because, verdict
   use hb_steady_motion, only: steady_motion_t
   use hb_system, only: system_t
   use hb_thresholds, only: max_reliable_error
   implicit none
   private
   public :: guess_from, note_unsteady, store_integrated

contains

   !> First guess of the balance in the form of hb_motion: coefficients at the coordinates, then all base frequencies.
   function guess_from(system, discretisation, coordinates, steady) result(guess)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(coordinates_t), intent(in) :: coordinates
      type(steady_motion_t), intent(in) :: steady
      real(wp), allocatable :: guess(:)

      guess = [discretisation%harmonics%coefficients(coordinates%amplitudes_of(steady%amplitudes)), system%tones%omega]
   end function guess_from

   !> Notes in the result of a balance that a time integration has not become steady: its message, and that it is out of work. A
   !> friction too steep for the samples remains the reason.
   subroutine note_unsteady(steady, is_struck, result)
      type(steady_motion_t), intent(in) :: steady
      logical, intent(in) :: is_struck                                !! the balance strikes walls with a given restitution
      type(motion_result_t), intent(inout) :: result

      if (steady%is_out_of_work .and. result%reason == reason%steep_friction) return
      if (allocated(steady%message)) call result%add_message(steady%message, is_first=result%status /= outcome%law_undefined)
      if (steady%is_at_pole .and. is_lost(result%status)) result%status = outcome%law_undefined
      if (.not. steady%is_out_of_work) return
      result%reason = reason%max_fallback_work
      if (is_struck) result%status = outcome%out_of_budget
   end subroutine note_unsteady

   !> Stores an integrated motion in a result, in place of any other. The forces of the laws follow from its inertia, damping,
   !> stiffness and loads.
   subroutine store_integrated(system, discretisation, options, coordinates, steady, result)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(coordinates_t), intent(in) :: coordinates
      type(steady_motion_t), intent(in) :: steady
      type(motion_result_t), intent(inout) :: result
      complex(wp), dimension(system%structure%n_dofs, discretisation%harmonics%n_harmonics) :: c, forces
      type(amplitudes_t) :: loads
      real(wp) :: w(discretisation%harmonics%n_harmonics)
      integer :: h

      c = steady%amplitudes
      w = discretisation%harmonics%frequencies(system%tones%omega)
      loads = system%loads_in(discretisation%harmonics)
      do h = 1, size(w)
         forces(:, h) = loads%of(h) - forces_of(system, c(:, h), w(h))
      end do
      call result%forget_motion()
      result%frequency = system%tones%omega
      result%n_harmonics = discretisation%harmonics%n_harmonics
      result%is_odd = .false.
      call store_motion(options, discretisation%harmonics, discretisation%harmonics, c, result)
      result%force_coefficients = as_pairs(forces(coordinates%dofs, :))
      result%corrected_coefficients = as_pairs(c(coordinates%dofs, :))
      call find_stability(system, discretisation, options, steady, result%stability)
      associate (found => result%error_estimate, nan => ieee_value(1.0_wp, ieee_quiet_nan))
         call near_commensurate(system%tones, found%combination, found%combination_frequency)
         result%is_near_commensurate = system%tones%n_tones > 1 .and. &
            found%combination_frequency < options%error_estimate%commensurability*maxval(system%tones%omega)
         found%truncation = steady%spread
         found%aliasing = 0.0_wp
         if (options%integration%aim <= 0.0_wp) then                  ! averages: tuples outside the set, and the scatter
            found%truncation = steady%left_out
            found%aliasing = steady%spread
         end if
         found%impact = nan
         found%defects%penetration = nan
         found%defects%tension = nan
         found%defects%complementarity = nan
         found%defects%slip = nan
         found%power_laws = spread(nan, 1, size(system%laws))
         found%power_in = loads%power_into(c, w)
         call new_mean_energy(found%energy, system%structure, c, w)
      end associate
   end subroutine store_integrated

   !> Stable, because time integration converged to it; if walls are struck, with the multipliers of the periodic
   !> motion. If the motion explains almost nothing of its record, stability is unknown.
   subroutine find_stability(system, discretisation, options, steady, stability)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(steady_motion_t), intent(in) :: steady
      type(stability_t), intent(out) :: stability

      if (allocated(steady%monodromy)) then
         if (options%stability%method /= stability_method%off) stability = stability_of_map(steady%monodromy, system%tones%omega(1))
         return
      end if
      if (system%tones%n_tones == 1 .and. options%lacks_impacts_of(system, outcome%impact)) &
         call request_stability(system, options, options%stability, &
                                harmonic_motion_t(discretisation%harmonics%tuples, system%tones, steady%amplitudes), &
                                   steady%work, stability)
      select case (stability%verdict)
      case (verdict%unknown)
         if (steady%spread < max_reliable_error) stability = stability_t(verdict=verdict%stable, &
               method=stability_method%integration)
      case (verdict%unstable)                                         ! the two results contradict each other
         call stability%withdraw(unknown_because%contradicted)
      end select
   end subroutine find_stability

   !> Forces that a motion requires without laws.
   function forces_of(system, c, w) result(forces)
      type(system_t), intent(in) :: system
      complex(wp), intent(in) :: c(:)                                 !! [m], (n_dofs)
      real(wp), intent(in) :: w                                       !! [rad/s]
      complex(wp) :: forces(size(c))
      real(wp) :: imaginary_part(size(c)), real_part(size(c)), stiffness(size(c), size(c))

      associate (s => system%structure)
         stiffness = s%stiffness - w**2*s%mass
         real_part = real(c)
         imaginary_part = aimag(c)
         forces = cmplx(matmul(stiffness, real_part), matmul(stiffness, imaginary_part), wp) + &
                  cmplx(0.0_wp, w, wp)*s%damping_times(c)
      end associate
   end function forces_of
end module hb_integrated_result
