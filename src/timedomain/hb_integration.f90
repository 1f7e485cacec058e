!> Time integration of a model by its settings of time integration: record, its coefficients, and the state from
!> which it can be continued.
module hb_integration
   use hb_discretisation, only: discretisation_t
   use hb_error, only: annotate, error_t, fail
   use hb_integrable_system, only: largest_integrable
   use hb_integration_config, only: integration_start, step_of
   use hb_integration_starts, only: motions_of, state_on_sphere
   use hb_integration_system, only: integration_state_t, integration_system_t, new_integration_state, new_integration_system
   use hb_kinds, only: wp
   use hb_load_course, only: timed_load_t
   use hb_modes, only: modes_t, new_modes
   use hb_options, only: options_t
   use hb_record_tones, only: find_tones
   use hb_structure, only: max_dense
   use hb_structure_load, only: find_timed_loads
   use hb_system, only: system_t
   use hb_text, only: to_text
   use hb_time_stepping, only: assess, integrate_from, integration_assessment_t, integration_record_t
   implicit none
   private
   public :: check_integration, integrate_model, integration_t

   integer, parameter :: min_samples = 32                          ! from which frequencies are read

   !> Results of a time integration.
   type :: integration_t
      type(integration_system_t) :: system
      type(integration_record_t) :: record
      type(integration_assessment_t) :: assessment
      type(integration_state_t) :: state                              !! the last one
      real(wp), allocatable :: omega(:)                               !! base frequencies [rad/s], (n_tones)
      real(wp) :: share = 0.0_wp                                      !! of the power of the record explained by unknown tones
      integer, allocatable :: motion(:)                               !! in which each start ends, from 1; 0: it diverges
      type(integration_assessment_t), allocatable :: motions(:)       !! each of them, (maxval(motion))
   end type integration_t

contains

   !> Fails if the settings of time integration are incomplete.
   subroutine check_integration(system, options, error)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(error_t), allocatable, intent(out) :: error

      if (options%integration%duration <= 0.0_wp) then
         call fail(error, "missing integration%duration: give a time [s]")
      else if (system%tones%n_tones == 0 .and. options%integration%step <= 0.0_wp) then
         call fail(error, "missing integration%step: give a time [s], for without tones there is no period")
      else if (system%tones%n_tones == 0 .and. options%integration%starts > 1) then
         call fail(error, "integration%starts must be 1: other starts have velocities that follow from tones, which are missing")
      else if (options%integration%starts > 1 .and. any(system%tones%is_unknown)) then
         call fail(error, "integration%starts must be 1: motions with an unknown tone differ by its phase, too")
      end if
   end subroutine check_integration

   !> Integrates from rest, from the sum of the given amplitudes, or from the end of an earlier record; the given displacements and
   !> velocities are added.
   subroutine integrate_model(self, system, discretisation, options, error, earlier)
      type(integration_t), intent(out), target :: self
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(error_t), allocatable, intent(out) :: error
      type(integration_state_t), intent(in), optional :: earlier      !! end of an earlier record
      type(timed_load_t), allocatable :: timed(:)
      real(wp), allocatable :: frequencies(:)
      real(wp) :: step

      call check_integration(system, options, error)
      if (.not. allocated(error)) call guess_frequencies(system, self%omega, error)
      if (allocated(error)) return
      call system%structure%check_matrices("integration", largest_integrable(system%structure, options%integration%method), &
                                           error)
      if (allocated(error)) return
      allocate (frequencies, source=discretisation%harmonics%frequencies(self%omega))
      call find_timed_loads(system%loads, system%structure, self%omega, timed)
      call new_integration_system(self%system, system%structure, system%laws, system%load_spectrum, self%omega, timed)
      call new_integration_state(self%state, self%system%n_dofs, self%system%laws%n_states)
      if (present(earlier)) then
         self%state = earlier
      else if (options%integration%start == integration_start%given) then
         call options%start%spectrum%find_state(self%omega, self%state%q, self%state%v)
      end if
      if (allocated(options%integration%displacement)) then
         self%state%q = self%state%q + options%integration%displacement
         self%state%v = self%state%v + options%integration%velocity
      end if
      step = step_of(options%integration, self%omega)
      call integrate_from(self%system, options%integration, step, options%output%dofs, self%state, self%record, error)
      if (.not. allocated(error)) call read_frequencies(system, discretisation, self%record, self%omega, self%share, error)
      if (allocated(error)) return
      frequencies = discretisation%harmonics%frequencies(self%omega)
      call assess(self%record, frequencies, options%integration%n_peaks, self%assessment, error)
      if (options%integration%starts > 1 .and. .not. allocated(error)) &
         call integrate_others(system, discretisation, options, frequencies, step, self, error)
   end subroutine integrate_model

   !> Integrates from the other starts, as long as from the first one, and distinguishes their motions.
   subroutine integrate_others(system, discretisation, options, frequencies, step, content, error)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      real(wp), intent(in) :: frequencies(:)                          !! [rad/s], (n_harmonics)
      real(wp), intent(in) :: step                                    !! [s]
      type(integration_t), intent(inout) :: content                 !! with the results of the first start
      type(error_t), allocatable, intent(out) :: error
      type(integration_assessment_t) :: each(options%integration%starts)
      type(integration_record_t) :: record
      type(integration_state_t) :: state
      type(integration_system_t), target :: equations
      type(timed_load_t), allocatable :: timed(:)
      complex(wp) :: c(size(frequencies), size(options%output%dofs), options%integration%starts)
      integer :: i, kind(options%integration%starts)
      real(wp) :: size_of_motion, spread(options%integration%starts)

      call find_timed_loads(system%loads, system%structure, system%tones%omega, timed)
      each(1) = content%assessment
      kind = 1
      do i = 1, size(each)
         call new_integration_system(equations, system%structure, system%laws, system%load_spectrum, system%tones%omega, timed)
         if (i == 1) then
            size_of_motion = maxval(abs(matmul(content%record%every_displacement, equations%laws%shape(options%output%dofs, :))))
            if (size_of_motion <= 0.0_wp) size_of_motion = max(equations%length, tiny(1.0_wp))
         else
            call state_on_sphere(equations, system%tones%omega, size_of_motion, i - 1, state)
            call integrate_from(equations, options%integration, step, options%output%dofs, state, record, error)
            if (allocated(error)) kind(i) = 0                         ! it diverges from there
            if (kind(i) > 0) call assess(record, frequencies, 0, each(i), error)
         end if
         c(:, :, i) = 0.0_wp
         spread(i) = 0.0_wp
         if (kind(i) == 0) cycle
         c(:, :, i) = each(i)%coefficients
         spread(i) = min(1.0_wp, norm2(each(i)%spread)/max(norm2(abs(c(:, :, i))), tiny(1.0_wp)))
      end do
      if (allocated(error)) deallocate (error)
      content%motion = motions_of(c, kind, spread)
      allocate (content%motions(maxval(content%motion)))
      do i = 1, size(content%motions)
         content%motions(i) = each(findloc(content%motion, i, dim=1))
      end do
   end subroutine integrate_others

   !> Base frequencies for the time integration: unknown ones without a first guess are those of the linear structure,
   !> the lowest first.
   subroutine guess_frequencies(system, omega, error)
      type(system_t), intent(in) :: system
      real(wp), allocatable, intent(out) :: omega(:)                  !! [rad/s], (n_tones), > 0
      type(error_t), allocatable, intent(out) :: error
      type(modes_t) :: modes
      integer :: m, n

      omega = system%tones%omega
      if (all(omega > 0.0_wp)) return
      associate (structure => system%structure)
         call structure%check_matrices("a search for modes", max_dense, error)
         if (.not. allocated(error)) call new_modes(modes, structure%mass, structure%damping, structure%stiffness, error)
      end associate
      n = 0
      do m = 1, size(omega)
         if (allocated(error)) exit
         if (omega(m) > 0.0_wp) cycle
         n = n + 1
         if (n > modes%n_modes) then
            call fail(error, "the linear structure has "//to_text(modes%n_modes)// &
                      " oscillatory modes, not one for each unknown tone")
         else
            omega(m) = modes%frequency(n)
         end if
      end do
      call annotate(error, "give first guesses of the frequencies of the tones")
   end subroutine guess_frequencies

   !> Reads the frequencies of unknown tones from a record. If it has none, guesses are unchanged and the share is
   !> zero.
   subroutine read_frequencies(system, discretisation, record, omega, share, error)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(integration_record_t), intent(in) :: record
      real(wp), intent(inout) :: omega(:)                             !! [rad/s], (n_tones)
      real(wp), intent(out) :: share                                  !! of the power of the record that they explain
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: found(size(omega))

      share = 0.0_wp
      if (.not. any(system%tones%is_unknown) .or. size(record%every_displacement, 1) < min_samples) return
      found = system%tones%omega                                      ! only guesses of the user are used
      call find_tones(record%every_displacement, record%start, record%step, discretisation%harmonics%tuples, &
                      system%tones%is_unknown, found, share, error)
      if (share > 0.0_wp) omega = found
   end subroutine read_frequencies
end module hb_integration
