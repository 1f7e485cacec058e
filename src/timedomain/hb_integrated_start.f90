!> First guesses from time integration: the motion at the end of a time integration.
!>
!> Time integration finds attractors: a stable one of several motions, and motions to which no linear mode leads. With
!> given tones it starts from rest, with unknown ones from random displacements and velocities of several sizes, or
!> from the given amplitudes; the frequencies are then read from the record (hb_record_tones), the coefficients are
!> averages over it (hb_birkhoff).
module hb_integrated_start
   use hb_birkhoff, only: coefficients_at
   use hb_discretisation, only: discretisation_t
   use hb_error, only: error_t
   use hb_integrable_system, only: fastest_of, fixed_step_method_of, has_bounds_of, lacks_mass
   use hb_integration_config, only: integration_config_t, integration_method, step_of
   use hb_integration_starts, only: scattered
   use hb_integration_system, only: integration_state_t, integration_system_t, new_integration_state, new_integration_system
   use hb_kinds, only: two_pi, wp
   use hb_options, only: options_t
   use hb_record_tones, only: find_tones
   use hb_structure, only: max_dofs
   use hb_system, only: system_t
   use hb_time_stepping, only: early_end_t, integrate_from, integration_record_t
   implicit none
   private
   public :: change_of, first_perturbation, integrate_once, integrated_guess, steady_power_change

   integer, parameter :: periods_of_transient = 200, periods_of_record = 50   ! of the slowest tone, unless given
   integer, parameter :: samples_of_harmonic = 8                      ! of the highest one in its period, at least
   real(wp), parameter :: start_perturbations(4) = [3.0_wp, 30.0_wp, 0.3_wp, 300.0_wp] ! of the length of the laws
   real(wp), parameter :: first_perturbation = start_perturbations(1)
   real(wp), parameter :: step_of_mode = 0.2_wp                       ! radians of the fastest mode, of fixed steps
   real(wp), parameter :: guess_tolerance = 1.0e-7_wp                 ! tolerance of the integrator: below what decides on locking
   real(wp), parameter :: steady_power_change = 0.02_wp               !! change of the power from one half to the other
   real(wp), parameter :: runaway_ratio = 1.0e4_wp                    ! relative to the first displacement
   real(wp), parameter :: decay_ratio = 1.0e-3_wp                     ! relative to the perturbation
   integer, parameter :: periods_of_rest = 10                         ! in which a motion that has decayed is seen

contains

   !> Integrates, and returns the guess in the form of hb_motion: coefficients at the degrees of freedom of the laws,
   !> then all base frequencies. Not allocated if the motion decays, or if it has no unknown tone. An error is one of
   !> time integration, such as a law that the method does not support.
   subroutine integrated_guess(system, discretisation, options, omega, law_dofs, guess, error)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones), guesses if unknown, all > 0
      integer, intent(in) :: law_dofs(:)
      real(wp), allocatable, intent(out) :: guess(:)
      type(error_t), allocatable, intent(out) :: error
      type(integration_record_t) :: record
      real(wp), allocatable :: found(:)
      real(wp) :: best, change, decayed, share
      integer :: i, n_failed, n_tries
      logical :: has_start

      has_start = .not. options%start%spectrum%is_zero()
      n_tries = merge(size(start_perturbations), 1, any(system%tones%is_unknown) .and. .not. has_start)
      best = huge(1.0_wp)
      n_failed = 0
      decayed = 0.0_wp
      do i = 1, n_tries
         if (start_perturbations(i) < decayed) cycle                  ! a larger one has passed this size
         call integrate_once(system, discretisation, options, omega, law_dofs, start_perturbations(i), record, error)
         if (allocated(error)) then
            n_failed = n_failed + 1
            if (n_failed == n_tries) return
            deallocate (error)                                        ! another perturbation may succeed
            cycle
         end if
         found = omega
         if (any(system%tones%is_unknown)) then
            if (is_dead(options, record, start_perturbations(i)*length_of(system), has_start)) then
               decayed = max(decayed, start_perturbations(i))
               cycle
            end if
            found = system%tones%omega                                ! only guesses of the user are used
            call find_tones(record%every_displacement, record%start, record%step, discretisation%harmonics%tuples, &
                            system%tones%is_unknown, found, share, error)
            if (allocated(error)) return
            if (share <= 0.0_wp) cycle
         end if
         change = change_of(record)
         if (change >= best) cycle
         best = change
         guess = [coefficients_of(discretisation, record, found), found]
         if (best <= steady_power_change) return
      end do
   end subroutine integrated_guess

   !> Integrates through the transient and the record of the settings, or through the default number of periods.
   subroutine integrate_once(system, discretisation, options, omega, law_dofs, perturbation, record, error)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      real(wp), intent(in) :: omega(:)
      integer, intent(in) :: law_dofs(:)
      real(wp), intent(in) :: perturbation                            !! of the length of the laws
      type(integration_record_t), intent(out) :: record
      type(error_t), allocatable, intent(out) :: error
      type(early_end_t) :: early_end
      type(integration_config_t) :: config
      type(integration_state_t) :: state
      type(integration_system_t), target :: equations
      real(wp) :: frequencies(discretisation%harmonics%n_harmonics), period, step
      integer :: i

      frequencies = discretisation%harmonics%frequencies(omega)
      call system%structure%check_matrices("integration", max_dofs, error)
      if (allocated(error)) return
      call new_integration_system(equations, system%structure, system%laws, system%load_spectrum, omega)
      call new_integration_state(state, equations%n_dofs, equations%laws%n_states)
      if (.not. options%start%spectrum%is_zero()) then
         call options%start%spectrum%find_state(omega, state%q, state%v)
      else if (any(system%tones%is_unknown)) then
         ! Multiples of the golden ratio are equidistributed, so that no shape is missed
         state%q = perturbation*length_of(system)*[(scattered(2*i), i=1, equations%n_dofs)]
         state%v = perturbation*length_of(system)*minval(omega, mask=system%tones%is_unknown)* &
                   [(scattered(2*i + 1), i=1, equations%n_dofs)]
      end if
      config = options%integration
      config%decimation = huge(1)
      config%tolerance = max(config%tolerance, guess_tolerance)
      period = two_pi/minval(omega)
      if (config%duration <= 0.0_wp) then
         config%duration = periods_of_record*period
         config%transient = periods_of_transient*period
      end if
      if (any(system%tones%is_unknown)) then
         config%largest = runaway_ratio*max(maxval(abs(state%q)), equations%length)
         early_end%smallest = decay_ratio*min(maxval(abs(state%q)), length_of(system))
         early_end%rest = periods_of_rest*period
      end if
      step = min(step_of(config, omega), two_pi/(samples_of_harmonic*maxval(abs(frequencies))))
      if (config%method == integration_method%cvode .and. lacks_mass(system)) then
         config%method = integration_method%generalized_alpha
         config%spectral_radius = 0.0_wp                              ! what has no mass has no vibration of its own
      else if (config%method == integration_method%cvode .and. .not. has_bounds_of(system)) then
         config%method = fixed_step_method_of(system)
         config%substeps = ceiling(step*fastest_of(system)/step_of_mode)
      end if
      call integrate_from(equations, config, step, law_dofs, state, record, error, early_end)
   end subroutine integrate_once

   !> Typical length of the laws [m], 1 if they have none.
   pure real(wp) function length_of(system)
      type(system_t), intent(in) :: system
      integer :: i

      length_of = 0.0_wp
      do i = 1, size(system%laws)
         length_of = max(length_of, system%laws(i)%law%length_scale)
      end do
      if (length_of <= 0.0_wp) length_of = 1.0_wp
   end function length_of

   !> Whether the motion has decayed relative to its start; false for a motion driven by loads.
   pure logical function is_dead(options, record, perturbation, has_start)
      type(options_t), intent(in) :: options
      type(integration_record_t), intent(in) :: record
      real(wp), intent(in) :: perturbation                            !! [m]
      logical, intent(in) :: has_start
      real(wp) :: begun

      is_dead = record%is_at_rest
      if (is_dead) return
      begun = perturbation
      if (has_start) begun = maxval(abs(options%start%spectrum%values))
      associate (x => record%every_displacement)
         is_dead = maxval(maxval(x, dim=1) - minval(x, dim=1)) < decay_ratio*begun
      end associate
   end function is_dead

   !> Relative change of the power from the first half of a record to the second.
   pure real(wp) function change_of(record) result(change)
      type(integration_record_t), intent(in) :: record
      real(wp) :: first, second
      integer :: half

      half = size(record%every_displacement, 1)/2
      first = sum(record%every_displacement(:half, :)**2)
      second = sum(record%every_displacement(half + 1:2*half, :)**2)
      change = abs(second - first)/max(first, second, tiny(1.0_wp))
   end function change_of

   !> Coefficients of the record.
   function coefficients_of(discretisation, record, omega) result(u)
      type(discretisation_t), intent(in) :: discretisation
      type(integration_record_t), intent(in) :: record
      real(wp), intent(in) :: omega(:)
      real(wp) :: u(discretisation%harmonics%n_coefficients, size(record%every_displacement, 2))
      complex(wp) :: c(size(u, 2), discretisation%harmonics%n_harmonics)
      integer :: k

      associate (set => discretisation%harmonics, x => record%every_displacement)
         do k = 1, size(x, 2)
            call coefficients_at(x(:, k), record%start, record%step, set%frequencies(omega), c(k, :))
         end do
         u = set%coefficients(c)
      end associate
   end function coefficients_of
end module hb_integrated_start
