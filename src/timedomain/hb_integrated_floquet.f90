!> Floquet multipliers and Lyapunov exponents by time integration, for laws with events that have no linearised
!> equations: the map from one period to the next, by differences. Source: docs/why/theory.md, section 8.
module hb_integrated_floquet
   use hb_error, only: error_t
   use hb_exponents, only: orthogonalise, periods_of_beats, propagation_t, work_of_exponents
   use hb_floquet, only: assess_exponents, assess_matrix, floquet_t, has_to_be_integrated, work_on_demand
   use hb_integration_system, only: integration_system_t, new_integration_system
   use hb_kinds, only: two_pi, wp
   use hb_law, only: law_box_t
   use hb_map_eigenvalues, only: deflate
   use hb_motion_series, only: motion_series_t, new_motion_series
   use hb_period_map, only: find_period_map, new_period_map, period_map_t, work_of_period_map
   use hb_stability, only: excitation_t, harmonic_motion_t, stability_config_t, stability_method, stability_t, &
      unknown_because
   use hb_state_map, only: new_state_map, state_map_t
   use hb_structure, only: max_dense, structure_t
   use hb_thresholds, only: max_distance_of_same
   implicit none
   private
   public :: integrated_floquet_t, integrated_propagation_t, new_integrated_propagation

   real(wp), parameter :: orbit_distance = 1.0e-5_wp ! of neighbouring trajectories, scaled: kinks and jumps in between are rare,
                                               !! and rounding is small in comparison
   integer, parameter :: min_steps = 200                           ! in a period of the fastest tone, for fixed steps
   real(wp), parameter :: max_held_change = 1.0e-9_wp                 ! change of a coordinate that friction always holds, scaled

   !> Propagation of disturbances along a motion of several tones by time integration of the motion and of states on
   !> both sides of it. It continues from period to period, and is only compared with the given motion, from which it
   !> may diverge.
   type, extends(propagation_t) :: integrated_propagation_t
      type(state_map_t) :: integration
      real(wp), private :: time = 0.0_wp                              ! [s]
      real(wp), allocatable, private :: x(:)                          ! state of the time integration, scaled
      real(wp), allocatable, private :: still(:, :)                   ! orthonormal, coordinates that are always held, (size, any)
   contains
      procedure :: reach_steady_state => integrated_propagation_reach_steady_state
      procedure :: propagate => integrated_propagation_propagate
   end type integrated_propagation_t

   type, extends(floquet_t) :: integrated_floquet_t
   contains
      procedure :: find => integrated_floquet_find
   end type integrated_floquet_t

contains

   !> Uses the linearised equations along the motion if all laws have them and nothing else is requested, otherwise
   !> time integration over a period.
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
         if (stability%is_integrated .or. allocated(structure%parts) .or. .not. config%is_integrated) return
         stability = stability_t()
      end if
      if (config%method /= stability_method%off) then
         stability%reason = unknown_because%no_equations              ! unless they follow
         call structure%check_matrices("stability", max_dense, error)
         if (allocated(error)) return
         call new_integration_system(system, structure, laws, excitation%loads, motion%tones%omega)
         call new_motion_series(series, motion%tuples, motion%tones%omega, motion%amplitudes)
         stability%is_integrated = .true.
         limit = self%max_work(config, work_allowed)
         if (motion%tones%n_tones == 1) then
            call integration_period(stability, config, system, series, motion%tones%is_unknown(1), excitation%restitution, limit)
         else if (.not. any(motion%tones%is_unknown)) then            ! with unknown tones it would drift along the motion
            call integration_periods(stability, config, system, series, excitation%restitution, limit)
         end if
      end if
   end subroutine integrated_floquet_find

   !> By time integration from a torus and from neighbouring states, period by period.
   subroutine integration_periods(self, config, system, motion, restitution, max_work)
      type(stability_t), intent(inout) :: self
      type(stability_config_t), intent(in) :: config
      type(integration_system_t), intent(inout), target :: system
      type(motion_series_t), intent(in) :: motion
      real(wp), intent(in) :: restitution                             !! of rigid walls
      real(wp), intent(in) :: max_work                              !! in about a nanosecond
      type(integrated_propagation_t) :: propagation
      type(error_t), allocatable :: error
      type(stability_config_t) :: how

      how = config
      how%min_periods = max(how%min_periods, periods_of_beats(motion%tuples, motion%omega, motion%amplitudes))
      how%max_periods = max(how%max_periods, how%min_periods)
      call new_integrated_propagation(propagation, system, motion, restitution, config%tolerance, error)
      if (allocated(error)) return
      self%reason = unknown_because%none
      if (work_of_exponents(propagation%work, how%min_periods) > max_work) then
         self%reason = unknown_because%too_costly
         return
      end if
      self%method = stability_method%integration
      call propagation%integration%allow(max_work)
      call assess_exponents(self, propagation, min(max_work, work_on_demand), how)
   end subroutine integration_periods

   !> By time integration over a period of one tone from the motion and from neighbouring states, for laws that
   !> require it: multipliers are those of the periodic motion there, and the estimate is at least their change from
   !> the given motion.
   subroutine integration_period(self, config, system, series, is_free, restitution, max_work)
      type(stability_t), intent(inout) :: self
      type(stability_config_t), intent(in) :: config
      type(integration_system_t), intent(inout), target :: system
      type(motion_series_t), intent(in) :: series                     !! of the motion
      logical, intent(in) :: is_free                                  !! the tone is unknown
      real(wp), intent(in) :: restitution                             !! of rigid walls
      real(wp), intent(in) :: max_work                              !! in about a nanosecond
      type(error_t), allocatable :: error
      type(period_map_t) :: map
      type(stability_t) :: before

      call new_period_map(map, system, series, restitution, config%tolerance, error)
      if (allocated(error)) return
      self%reason = unknown_because%too_costly
      if (work_of_period_map(map) > max_work) return
      self%reason = unknown_because%inaccurate                        ! unless a periodic motion is found
      self%method = stability_method%integration
      call find_period_map(map, is_free, work_on_demand)
      if (.not. map%is_found) return
      self%estimate = map%estimate
      if (is_free) then
         self%estimate = max(self%estimate, norm2(matmul(map%matrix, map%shift) - map%shift)/norm2(map%shift))
         call deflate(map%matrix, map%shift)
         call deflate(map%at_motion, map%shift)
      end if
      call assess_matrix(self, map%matrix, series%omega(1))
      before%estimate = map%estimate
      call assess_matrix(before, map%at_motion, series%omega(1))
      call self%compare_with(before)
   end subroutine integration_period

   !> Fails for laws that no integrator supports.
   subroutine new_integrated_propagation(self, system, motion, restitution, tolerance, error)
      type(integrated_propagation_t), intent(out) :: self
      type(integration_system_t), intent(inout), target :: system     !! of all degrees of freedom
      type(motion_series_t), intent(in) :: motion                     !! of all degrees of freedom
      real(wp), intent(in) :: restitution                             !! of rigid walls
      real(wp), intent(in) :: tolerance                               !! of a period, relative
      type(error_t), allocatable, intent(out) :: error

      call new_state_map(self%integration, system, motion, restitution, tolerance, error)
      if (allocated(error)) return
      self%integration%min_steps = min_steps
      self%size = size(self%integration%scale)
      self%n_begun = 2*system%n_dofs
      self%n_followed = self%n_begun
      self%length = two_pi/minval(motion%omega)
      self%work = (2*self%n_followed + 1)*self%integration%work_of(1)
   end subroutine new_integrated_propagation

   !> Advances from the motion; coordinates that rigid friction always holds are removed from the disturbances, which
   !> are constant there.
   subroutine integrated_propagation_reach_steady_state(self, n_periods, is_done)
      class(integrated_propagation_t), intent(inout) :: self
      integer, intent(in) :: n_periods
      logical, intent(out) :: is_done
      real(wp), allocatable :: begun(:), lost(:), axes(:, :)
      logical, allocatable :: is_still(:)
      integer :: i, period

      associate (system => self%integration%system, rigid => self%integration%rigid, n => self%integration%system%n_dofs)
         allocate (axes(self%size, size(rigid)), source=0.0_wp)
         do i = 1, size(rigid)
            axes(:n, i) = system%laws%shape(:, rigid(i)%coordinate)*self%integration%scale(:n)
            axes(:, i) = axes(:, i)/norm2(axes(:, i))
         end do
         is_still = .not. rigid%is_wall
      end associate
      self%time = -n_periods*self%length
      self%x = self%integration%state_at(self%time)
      do period = 1, n_periods
         begun = self%x
         call integrate_period(self, is_done)
         if (.not. is_done) return
         is_still = is_still .and. abs(matmul(self%x - begun, axes)) <= max_held_change
      end do
      self%still = axes(:, pack([(i, i=1, size(is_still))], is_still))
      allocate (lost(size(self%still, 2)))
      call orthogonalise(self%still, lost)
      self%n_followed = self%n_begun - size(self%still, 2)
   end subroutine integrated_propagation_reach_steady_state

   !> Integrates over the next period; not done if it diverges from the motion.
   subroutine integrate_period(self, is_done)
      type(integrated_propagation_t), intent(inout) :: self
      logical, intent(out) :: is_done
      real(wp) :: after(self%size)

      call self%integration%advance(self%time, self%length, self%x, after, is_done)
      if (.not. is_done) return
      self%time = self%time + self%length
      self%x = after
      associate (n => self%integration%system%n_dofs, there => self%integration%state_at(self%time))
         is_done = maxval(abs(after(:n) - there(:n))) <= max_distance_of_same
      end associate
   end subroutine integrate_period

   subroutine integrated_propagation_propagate(self, x, is_done)
      class(integrated_propagation_t), intent(inout) :: self
      real(wp), intent(inout), contiguous :: x(:, :)
      logical, intent(out) :: is_done
      real(wp) :: after(size(x, 1), size(x, 2))

      x = x - matmul(self%still, matmul(transpose(self%still), x))
      call self%integration%differences(self%time, self%length, self%x, orbit_distance, x, after, is_done)
      if (is_done) call integrate_period(self, is_done)
      if (is_done) x = after - matmul(self%still, matmul(transpose(self%still), after))
   end subroutine integrated_propagation_propagate
end module hb_integrated_floquet
