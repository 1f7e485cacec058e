!> Floquet multipliers and Lyapunov exponents by time integration, where laws lead through events that have no linearised equations:
!> the map from one period to the next, by differences. Source: docs/why/theory.md, section 8.
module hb_integrated_floquet
   use hb_error, only: error_t
   use hb_exponents, only: work_of_exponents
   use hb_floquet, only: assess_exponents, assess_matrix, floquet_t, has_to_be_integrated, work_on_demand
   use hb_integrated_propagation, only: integrated_propagation_t, new_integrated_propagation
   use hb_integration_system, only: integration_system_t, new_integration_system
   use hb_kinds, only: wp
   use hb_law, only: law_box_t
   use hb_motion_series, only: motion_series_t, new_motion_series
   use hb_multipliers, only: deflate
   use hb_period_map, only: find_period_map, new_period_map, period_map_t, work_of_period_map
   use hb_stability, only: excitation_t, harmonic_motion_t, stability_config_t, stability_method, stability_t
   use hb_structure, only: most_dense, structure_t
   implicit none
   private
   public :: integrated_floquet_t

   type, extends(floquet_t) :: integrated_floquet_t
   contains
      procedure :: find => integrated_floquet_find
   end type integrated_floquet_t

contains

   !> Along the motion where laws have linearised equations and nothing else is requested, else by time integration a period.
   subroutine integrated_floquet_find(self, stability, config, motion, structure, laws, excitation, work_allowed)
      class(integrated_floquet_t), intent(in) :: self
      type(stability_t), intent(out) :: stability
      type(stability_config_t), intent(in) :: config
      type(harmonic_motion_t), intent(in) :: motion
      type(structure_t), intent(in) :: structure
      type(law_box_t), intent(in) :: laws(:)
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: work_allowed                            !! in about a nanosecond
      type(integration_system_t), target :: system
      type(motion_series_t) :: series
      type(error_t), allocatable :: error
      real(wp) :: limit

      if (.not. has_to_be_integrated(laws)) then
         call self%floquet_t%find(stability, config, motion, structure, laws, excitation, work_allowed)
         if (stability%is_integrated .or. .not. config%is_integrated) return
         stability = stability_t()
      end if
      if (config%method /= stability_method%off) then
         call structure%refuse_large("stability", most_dense, error)
         if (allocated(error)) return
         call new_integration_system(system, structure, laws, excitation%loads%whole(), excitation%frequencies, motion%tones%omega)
         call new_motion_series(series, motion%tuples, motion%tones%omega, motion%amplitudes)
         stability%is_integrated = .true.
         limit = self%work_limit(config, work_allowed)
         if (motion%tones%n_tones == 1) then
            call integration_period(stability, config, system, series, motion%tones%is_unknown(1), excitation%restitution, limit)
         else if (.not. any(motion%tones%is_unknown)) then            ! with tones of its own it would drift along itself
            call integration_periods(stability, config, system, series, excitation%restitution, limit)
         end if
      end if
   end subroutine integrated_floquet_find

   !> By time integration from a torus and from beside it, period by period.
   subroutine integration_periods(self, config, system, motion, restitution, work_limit)
      type(stability_t), intent(inout) :: self
      type(stability_config_t), intent(in) :: config
      type(integration_system_t), intent(inout), target :: system
      type(motion_series_t), intent(in) :: motion
      real(wp), intent(in) :: restitution                             !! of rigid walls
      real(wp), intent(in) :: work_limit                              !! in about a nanosecond
      type(integrated_propagation_t) :: propagation
      type(error_t), allocatable :: error

      call new_integrated_propagation(propagation, system, motion, restitution, config%tolerance, error)
      if (allocated(error)) return
      self%is_too_costly = work_of_exponents(propagation%work, config%fewest_periods) > work_limit
      if (self%is_too_costly) return
      self%method = stability_method%integration
      call propagation%integration%allow(work_limit)
      call assess_exponents(self, propagation, min(work_limit, work_on_demand), config)
   end subroutine integration_periods

   !> By time integration a period of one tone from the motion and from beside it, for laws that ask for it: multipliers are those
   !> of the motion that repeats there, their change from the motion given is the least of the estimate.
   subroutine integration_period(self, config, system, series, is_free, restitution, work_limit)
      type(stability_t), intent(inout) :: self
      type(stability_config_t), intent(in) :: config
      type(integration_system_t), intent(inout), target :: system
      type(motion_series_t), intent(in) :: series                     !! of the motion
      logical, intent(in) :: is_free                                  !! the tone is the motion's own
      real(wp), intent(in) :: restitution                             !! of rigid walls
      real(wp), intent(in) :: work_limit                              !! in about a nanosecond
      type(error_t), allocatable :: error
      type(period_map_t) :: map
      type(stability_t) :: before

      call new_period_map(map, system, series, restitution, config%tolerance, error)
      if (allocated(error)) return
      self%is_too_costly = work_of_period_map(map) > work_limit
      if (self%is_too_costly) return
      self%method = stability_method%integration
      call find_period_map(map, is_free, work_on_demand)
      if (.not. map%is_found) return
      self%estimate = map%estimate
      if (is_free) then
         self%estimate = max(self%estimate, norm2(matmul(map%matrix, map%shift) - map%shift)/norm2(map%shift))
         call deflate(map%matrix, map%shift)
         call deflate(map%first, map%shift)
      end if
      call assess_matrix(self, map%matrix, series%omega(1))
      before%estimate = map%estimate
      call assess_matrix(before, map%first, series%omega(1))
      call self%hold_against(before)
   end subroutine integration_period
end module hb_integrated_floquet
