!> Whether a motion of tones far apart holds in time: a short integration that starts on it.
!>
!> Where a slow tone carries a fast motion into contact, the fast motion may jump to another one, and ring until the jump has
!> decayed. In the balance a smooth motion without the jump may be left, from which Newton's method finds no step in any
!> set: error estimates are steps of it. The integration jumps. It lasts until the transient of the linear structure has
!> decayed, and through one more period of the slowest tone, in which the difference counts. A second one starts very close
!> to it: if they diverge, the motion is unstable, and the difference says nothing. Source: docs/why/theory.md, section 7.
module hb_departure
   use hb_budget, only: affordable_evaluations
   use hb_error, only: error_t
   use hb_integrable_system, only: fastest_of, has_bounds_of
   use hb_integration_config, only: integration_config_t, integration_method
   use hb_integration_system, only: integration_state_t, integration_system_t, new_integration_state, new_integration_system
   use hb_kinds, only: two_pi, wp
   use hb_law, only: law_box_t
   use hb_modes, only: slowest_decay
   use hb_motion_series, only: motion_series_t, new_motion_series
   use hb_options, only: options_t
   use hb_primary_method, only: evaluation_work
   use hb_reached_laws, only: max_gap_to_motion, reached_laws
   use hb_stability, only: harmonic_motion_t
   use hb_structure, only: max_dofs
   use hb_system, only: system_t
   use hb_time_stepping, only: integrate_from, integration_record_t
   implicit none
   private
   public :: find_departure

   real(wp), parameter :: enough_decay = 3.0_wp                       ! of the slowest mode, as a logarithm
   real(wp), parameter :: integration_tolerance = 1.0e-7_wp           ! of the integration
   real(wp), parameter :: start_distance = 1.0e-6_wp                  ! of the second one at its start, relative to the motion
   real(wp), parameter :: growth_limit = 3.0_wp                       ! of their distance
   real(wp), parameter :: step_of_mode = 0.2_wp                       ! radians of the fastest mode, of fixed steps
   integer, parameter :: longest_transient = 5                        ! periods of the slowest tone
   integer, parameter :: samples_of_tone = 40                         ! in a period of the fastest one, at least

contains

   !> Difference between integration and motion at the degrees of freedom of the laws, root mean square, relative; negative
   !> if it is not known.
   subroutine find_departure(system, options, motion, max_work, departure)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(harmonic_motion_t), intent(in) :: motion
      real(wp), intent(in) :: max_work                              !! in about a nanosecond
      real(wp), intent(out) :: departure
      type(error_t), allocatable :: error
      type(integration_config_t) :: config
      type(integration_record_t) :: other_record, record
      type(integration_state_t) :: other, state
      type(integration_system_t), target :: equations
      type(law_box_t), allocatable :: laws(:)
      real(wp), allocatable :: there(:, :), rates(:, :)
      type(motion_series_t) :: series
      integer, allocatable :: law_dofs(:)
      real(wp) :: at_start(1, size(motion%amplitudes, 1)), period, rate, scale, step, velocity(1, size(motion%amplitudes, 1))
      integer :: i, n_transient

      departure = -1.0_wp
      ! impacts and sliders ask for more than a state of displacements and velocities
      laws = reached_laws(system%laws, motion, max_gap_to_motion)
      if (any([(laws(i)%law%is_multiplier .or. laws(i)%law%n_states > 0, i=1, size(laws))])) return
      if (allocated(system%structure%sparse)) return
      call system%structure%check_matrices("integration", max_dofs, error)
      if (allocated(error)) return
      associate (omega => motion%tones%omega, structure => system%structure)
         period = two_pi/minval(abs(omega))
         rate = slowest_decay(structure%mass, structure%damping, structure%stiffness)*period
         if (.not. rate*longest_transient >= enough_decay) return
         n_transient = ceiling(enough_decay/rate)
         call new_motion_series(series, motion%tuples, omega, motion%amplitudes)
         call new_integration_system(equations, structure, laws, system%load_spectrum, omega)
      end associate
      call series%at(series%phases([0.0_wp]), at_start, velocity)
      call new_integration_state(state, equations%n_dofs, equations%laws%n_states)
      state%q = at_start(1, :)
      state%v = velocity(1, :)
      law_dofs = system%dofs_of_unknowns()
      scale = maxval(sum(abs(motion%amplitudes), dim=2))
      other = state
      other%q = other%q + start_distance*scale*[(cos(real(i, wp)), i=1, size(other%q))]
      call plan_integration()
      call integrate_from(equations, config, step, law_dofs, state, record, error)
      if (.not. allocated(error)) call integrate_from(equations, config, step, law_dofs, other, other_record, error)
      if (allocated(error)) return
      if (maxval(abs(other%q - state%q)) > growth_limit*start_distance*scale) return
      associate (times => record%start + record%step*[(real(i, wp), i=0, size(record%every_displacement, 1) - 1)])
         allocate (there(size(times), size(state%q)), rates(size(times), size(state%q)))
         call series%at(series%phases(times), there, rates, with_rates=.false.)
      end associate
      there = there(:, law_dofs)
      departure = norm2(record%every_displacement - there)/max(norm2(there), tiny(1.0_wp))

   contains

      !> Settings of both integrations: through the transient and one period, within the work, in fixed steps where CVODE cannot be
      !> used.
      subroutine plan_integration()
         config = options%integration
         config%tolerance = max(config%tolerance, integration_tolerance)
         config%decimation = huge(1)
         config%transient = n_transient*period
         config%duration = period
         config%max_evaluations = affordable_evaluations(max_work, evaluation_work(equations%n_dofs, &
                                  equations%laws%n_coordinates, .false.)) ! of both
         step = two_pi/(samples_of_tone*maxval(abs(motion%tones%omega)))
         step = period/ceiling(period/step)
         config%method = integration_method%cvode
         if (has_bounds_of(system)) return
         config%method = integration_method%runge_kutta_4
         config%substeps = ceiling(step*fastest_of(system)/step_of_mode)
      end subroutine plan_integration
   end subroutine find_departure
end module hb_departure
