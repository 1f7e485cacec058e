!> Time integration of a model from a state, with a record of the motion.
!>
!> `integrate_from` performs the whole integration; `assess` computes coefficients of a record.
module hb_time_stepping
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_birkhoff, only: coefficients_at
   use hb_budget, only: is_spent
   use hb_cancellation, only: note_progress, work_is_over
   use hb_central_differences, only: central_differences_t, new_central_differences
   use hb_error, only: error_t, fail
   use hb_frequency_analysis, only: find_frequencies
   use hb_generalized_alpha, only: generalized_alpha_t, new_generalized_alpha
   use hb_integration_config, only: integration_config_t, integration_method
   use hb_integration_cvode, only: integration_cvode_t, new_integration_cvode
   use hb_integration_system, only: integration_state_t, integration_system_t
   use hb_integrator, only: integrator_t
   use hb_kinds, only: int64, wp
   use hb_law, only: hold_t
   use hb_memory, only: available_memory
   use hb_rigid_constraints, only: collect_rigid
   use hb_runge_kutta_4, only: new_runge_kutta_4, runge_kutta_4_t
   use hb_text, only: rounded, to_text
   implicit none
   private
   public :: assess, early_end_t, integrate_from, integration_assessment_t, integration_record_t

   real(wp), parameter :: first_share = 1.0_wp/16.0_wp                ! of the evaluations, after which the pace is known
   real(wp), parameter :: too_slow = 3.0_wp                           ! evaluations that would be needed, relative to the permitted
   integer, parameter :: steps_between_checks = 32                    ! a few microseconds at least for the smallest system
   integer, parameter :: steps_of_rest = 7                            ! likewise, of states that a motion at rest passes

   !> Stored motion: all samples of the requested displacements, every n-th sample of the others.
   type :: integration_record_t
      real(wp) :: start = 0.0_wp                                      !! time of the first sample [s]
      real(wp) :: step = 0.0_wp                                       !! from one sample to the next [s]
      real(wp), allocatable :: every_displacement(:, :)               !! (n_samples, n_retained_dofs)
      real(wp), allocatable :: time(:)                                !! [s], (n_stored)
      real(wp), allocatable :: displacement(:, :), velocity(:, :)     !! (n_stored, n_retained_dofs)
      real(wp), allocatable :: force(:, :)                            !! of the laws [N], (n_stored, n_coordinates)
      integer, allocatable :: impacts(:)                              !! as of the integrator; not allocated: not counted
      real(wp), allocatable :: impact_times(:), impact_jumps(:, :)    !! likewise, if the system requests them
      real(wp) :: cpu_seconds = 0.0_wp                                !! processor time, including set-up of the method [s]
      logical :: is_under_way = .false.                               !! the method has started: an error is one of the motion
      logical :: is_out_of_work = .false.                             !! the error is that of the budget
      logical :: is_at_pole = .false.                                 !! it is that of a force which becomes infinite
      logical :: is_at_rest = .false.                                 !! the transient has ended at rest: there is no record
   end type integration_record_t

   !> What ends a time integration before its time.
   type :: early_end_t
      logical :: watches_pace = .false.                               !! fails if the permitted evaluations are too few by far
      real(wp) :: smallest = 0.0_wp                                   !! motion that is at rest [m]; 0: none
      real(wp) :: rest = huge(1.0_wp)                                 !! interval of the transient in which it is at rest [s]
   end type early_end_t

   !> Extent of a motion within an interval of time.
   type :: extent_t
      real(wp), allocatable :: least(:), most(:)                      ! displacements [m], (n_dofs)
      real(wp) :: begun = 0.0_wp                                      ! [s]
   contains
      procedure :: is_at_rest => extent_is_at_rest
   end type extent_t

   !> Evaluations of the laws from the start of an integration.
   type :: pace_t
      logical :: is_watched = .false.                                 ! as `watches_pace`
      integer(int64) :: n_before = 0                                  ! that were made before
   contains
      procedure :: check => pace_check
   end type pace_t

   !> Analysis of a record of a steady motion.
   type :: integration_assessment_t
      complex(wp), allocatable :: coefficients(:, :)                  !! c - i s, (n_harmonics, n_retained_dofs)
      real(wp), allocatable :: spread(:, :)                           !! |difference| of both halves of the record, likewise
      real(wp), allocatable :: frequencies(:, :)                      !! of the largest lines [rad/s], (n_peaks, n_retained_dofs)
      complex(wp), allocatable :: amplitudes(:, :)                    !! as frequencies
   end type integration_assessment_t

contains

   !> Integrates from a state through the transient and the duration of `config`. `state` returns the last one.
   subroutine integrate_from(system, config, step, retained_dofs, state, record, error, early_end)
      type(integration_system_t), intent(inout), target :: system
      type(integration_config_t), intent(in) :: config
      real(wp), intent(in) :: step                                    !! [s], > 0
      integer, intent(in) :: retained_dofs(:)
      type(integration_state_t), intent(inout) :: state
      type(integration_record_t), intent(out) :: record
      type(error_t), allocatable, intent(out) :: error
      type(early_end_t), intent(in), optional :: early_end            !! none if absent
      class(integrator_t), allocatable :: integrator
      real(wp) :: begun, ended
      type(early_end_t) :: ends

      if (present(early_end)) ends = early_end
      call cpu_time(begun)
      call new_integrator(integrator, system, config, step/config%substeps, error)
      if (.not. allocated(error) .and. system%lists_impacts) &
         allocate (integrator%impact_times(0), integrator%impact_jumps(system%n_dofs, 0))
      if (.not. allocated(error)) call integrator%start(state, error)
      record%is_under_way = .not. allocated(error)
      record%step = step
      if (.not. allocated(error)) call record_steps(integrator, system, config, retained_dofs, ends, state, record, error)
      call cpu_time(ended)
      record%cpu_seconds = ended - begun
      if (allocated(integrator)) then
         record%is_at_pole = integrator%is_at_pole
         if (allocated(integrator%impacts)) call move_alloc(integrator%impacts, record%impacts)
         if (allocated(integrator%impact_times)) then
            call move_alloc(integrator%impact_times, record%impact_times)
            call move_alloc(integrator%impact_jumps, record%impact_jumps)
         end if
         call integrator%destroy()
      end if
   end subroutine integrate_from

   subroutine new_integrator(self, system, config, step, error)
      class(integrator_t), allocatable, intent(out) :: self
      type(integration_system_t), intent(inout), target :: system
      type(integration_config_t), intent(in) :: config
      real(wp), intent(in) :: step
      type(error_t), allocatable, intent(out) :: error
      type(runge_kutta_4_t), allocatable :: runge_kutta_4
      type(central_differences_t), allocatable :: central_differences
      type(generalized_alpha_t), allocatable :: generalized_alpha
      type(integration_cvode_t), allocatable :: cvode
      type(hold_t), allocatable :: rigid(:)

      call collect_rigid(system%laws, config%restitution, rigid, error)
      if (allocated(error)) return
      select case (config%method)
      case (integration_method%runge_kutta_4)
         allocate (runge_kutta_4)
         call new_runge_kutta_4(runge_kutta_4, system, step, error)
         call move_alloc(runge_kutta_4, self)
      case (integration_method%central_differences)
         allocate (central_differences)
         call new_central_differences(central_differences, system, step, rigid, error)
         call move_alloc(central_differences, self)
      case (integration_method%generalized_alpha)
         allocate (generalized_alpha)
         call new_generalized_alpha(generalized_alpha, system, step, config%spectral_radius, config%tolerance, error)
         call move_alloc(generalized_alpha, self)
      case default
         allocate (cvode)
         call new_integration_cvode(cvode, system, step, config%tolerance, config%is_stiff, rigid, error)
         call move_alloc(cvode, self)
      end select
   end subroutine new_integrator

   !> Advances step by step and records.
   subroutine record_steps(integrator, system, config, retained_dofs, ends, state, record, error)
      class(integrator_t), intent(inout) :: integrator
      type(integration_system_t), intent(inout), target :: system     !! the integrator points to it
      type(integration_config_t), intent(in) :: config
      integer, intent(in) :: retained_dofs(:)
      type(early_end_t), intent(in) :: ends
      type(integration_state_t), intent(inout) :: state
      type(integration_record_t), intent(inout) :: record             !! with its step
      type(error_t), allocatable, intent(out) :: error
      type(pace_t) :: pace
      integer :: i, n_steps, n_transient

      call check_length(config, record%step, size(retained_dofs), system%laws%n_coordinates, error)
      if (allocated(error)) return
      system%laws%max_evaluations = config%max_evaluations
      pace%is_watched = ends%watches_pace
      pace%n_before = system%laws%n_evaluations
      n_transient = nint(config%transient/record%step)
      n_steps = max(1, nint(config%duration/record%step))
      call pass_transient(integrator, system, config, ends, [n_transient, n_steps], state, record, error)
      if (allocated(error) .or. record%is_at_rest) return
      call make_room(record, n_steps, config%decimation, size(retained_dofs), system%laws%n_coordinates, error)
      if (allocated(error)) return
      record%start = state%time
      call store_state(integrator, state, retained_dofs, 0, config%decimation, record)
      do i = 1, n_steps
         call integrator%advance(state, config%substeps, error)
         if (allocated(error)) then
            call check_budget(system, record, error)
            return
         end if
         call store_state(integrator, state, retained_dofs, i, config%decimation, record)
         if (modulo(i, steps_between_checks) > 0 .and. i < n_steps .and. system%laws%n_evaluations <= config%max_evaluations) cycle
         call check_finite(state, config%largest, error)
         call check_budget(system, record, error)
         if (.not. allocated(error)) call pace%check(system, real(i, wp)/n_steps, record, error)
         if (allocated(error)) return
         call note_progress(n_transient + i, n_transient + n_steps)
      end do
   end subroutine record_steps

   !> Advances through the transient, which ends early at rest.
   subroutine pass_transient(integrator, system, config, ends, n_steps, state, record, error)
      class(integrator_t), intent(inout) :: integrator
      type(integration_system_t), intent(in), target :: system        !! the integrator points to it
      type(integration_config_t), intent(in) :: config
      type(early_end_t), intent(in) :: ends
      integer, intent(in) :: n_steps(2)                               !! of the transient, and after it
      type(integration_state_t), intent(inout) :: state
      type(integration_record_t), intent(inout) :: record
      type(error_t), allocatable, intent(out) :: error
      type(extent_t) :: extent
      integer :: block, done

      block = merge(steps_of_rest, steps_between_checks, ends%smallest > 0.0_wp)
      do done = 0, n_steps(1) - 1, block
         call integrator%advance(state, config%substeps*min(block, n_steps(1) - done), error)
         if (.not. allocated(error)) call check_finite(state, config%largest, error)
         call check_budget(system, record, error)
         if (allocated(error)) return
         if (ends%smallest > 0.0_wp) record%is_at_rest = extent%is_at_rest(state, ends)
         if (record%is_at_rest) return
         call note_progress(done, sum(n_steps))
      end do
   end subroutine pass_transient

   !> Allocates a record.
   subroutine make_room(record, n_steps, stride, n_retained, n_coordinates, error)
      type(integration_record_t), intent(inout) :: record
      integer, intent(in) :: n_steps, stride, n_retained, n_coordinates
      type(error_t), allocatable, intent(out) :: error
      integer :: n_stored, stat

      n_stored = n_steps/stride + 1
      allocate (record%every_displacement(n_steps + 1, n_retained), stat=stat)
      if (stat /= 0) then
         call fail(error, "out of memory for a record of "//to_text(n_steps)//" steps")
         return
      end if
      allocate (record%time(n_stored), record%displacement(n_stored, n_retained), record%velocity(n_stored, n_retained))
      allocate (record%force(n_stored, n_coordinates))
   end subroutine make_room

   !> Stores the state after i steps.
   subroutine store_state(integrator, state, retained_dofs, i, stride, record)
      class(integrator_t), intent(inout) :: integrator
      type(integration_state_t), intent(in) :: state
      integer, intent(in) :: retained_dofs(:)
      integer, intent(in) :: i
      integer, intent(in) :: stride                                   !! of stored velocities and forces
      type(integration_record_t), intent(inout) :: record
      integer :: row

      record%every_displacement(i + 1, :) = state%q(retained_dofs)
      if (modulo(i, stride) > 0) return
      row = i/stride + 1
      record%time(row) = state%time
      record%displacement(row, :) = state%q(retained_dofs)
      record%velocity(row, :) = state%v(retained_dofs)
      call integrator%forces(state, record%force(row, :))
   end subroutine store_state

   !> Checks the budget and the cancellation; either is then the reason of a failure.
   subroutine check_budget(system, record, error)
      type(integration_system_t), intent(in) :: system
      type(integration_record_t), intent(inout) :: record
      type(error_t), allocatable, intent(inout) :: error

      record%is_out_of_work = system%laws%n_evaluations > system%laws%max_evaluations
      if (record%is_out_of_work) then
         call fail(error, "the time integration"//is_spent)
      else if (.not. allocated(error) .and. work_is_over()) then
         call fail(error, "the time integration was cancelled")
      end if
   end subroutine check_budget

   !> Ends a record that would need far more evaluations than permitted.
   subroutine pace_check(self, system, done, record, error)
      class(pace_t), intent(in) :: self
      type(integration_system_t), intent(in) :: system
      real(wp), intent(in) :: done                                    !! share of the record
      type(integration_record_t), intent(inout) :: record
      type(error_t), allocatable, intent(inout) :: error
      real(wp) :: used

      if (.not. self%is_watched) return
      used = (system%laws%n_evaluations - self%n_before)/real(max(1_int64, system%laws%max_evaluations - self%n_before), wp)
      record%is_out_of_work = used > max(first_share, too_slow*done)
      if (record%is_out_of_work) call fail(error, "the time integration would exceed its budget of work by far")
   end subroutine pace_check

   !> Adds a state. Whether an interval ends here in which no displacement has changed by the smallest motion.
   logical function extent_is_at_rest(self, state, ends) result(is_at_rest)
      class(extent_t), intent(inout) :: self
      type(integration_state_t), intent(in) :: state
      type(early_end_t), intent(in) :: ends

      if (.not. allocated(self%least)) then
         self%least = state%q
         self%most = state%q
         self%begun = state%time
      end if
      self%least = min(self%least, state%q)
      self%most = max(self%most, state%q)
      is_at_rest = .false.
      if (maxval(self%most - self%least) >= ends%smallest) then
         deallocate (self%least, self%most)                           ! the next interval begins with the next state
      else
         is_at_rest = state%time - self%begun >= ends%rest
      end if
   end function extent_is_at_rest

   !> Fails if steps cannot be counted, or if the record would not fit into memory.
   subroutine check_length(config, step, n_retained, n_coordinates, error)
      type(integration_config_t), intent(in) :: config
      real(wp), intent(in) :: step                                    !! [s], > 0
      integer, intent(in) :: n_retained, n_coordinates
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: bytes, n_steps

      n_steps = (config%transient + config%duration)/step
      bytes = 8.0_wp*(config%duration/step + 1.0_wp)*(n_retained + (1 + 2*n_retained + n_coordinates)/real(config%decimation, wp))
      if (.not. n_steps < real(huge(1), wp)) then
         call fail(error, "a time integration of "//to_text(config%transient + config%duration)//" s has "//to_text(n_steps)// &
            " steps of "// &
                   to_text(step)//" s, at most "//to_text(huge(1))//" can be counted: give a shorter duration or a larger step")
      else if (bytes > 2.0_wp**20) then                               ! else not worth reading how much is available
         if (bytes > available_memory()) &
            call fail(error, "a record of "//to_text(config%duration)//" s takes "//to_text(nint(bytes/2.0_wp**20))// &
                      " MiB, more than available: give a shorter duration, a larger step or a larger decimation")
      end if
   end subroutine check_length

   subroutine check_finite(state, largest, error)
      type(integration_state_t), intent(in) :: state
      real(wp), intent(in) :: largest                                 !! displacement [m]
      type(error_t), allocatable, intent(out) :: error

      if (all(ieee_is_finite(state%q)) .and. all(ieee_is_finite(state%v))) then
         if (maxval(abs(state%q)) <= largest) return
         call fail(error, "the motion has grown beyond "//trim(rounded(largest))//" at t = "//to_text(state%time)//" s")
         return
      end if
      call fail(error, "the motion is not finite at t = "//to_text(state%time)//" s: an explicit method may need a smaller step")
   end subroutine check_finite

   !> Coefficients at given frequencies with the difference between both halves of the record, and the largest lines.
   subroutine assess(record, frequencies, n_peaks, assessment, error)
      type(integration_record_t), intent(in) :: record
      real(wp), intent(in) :: frequencies(:)                          !! j.omega [rad/s], (n_harmonics)
      integer, intent(in) :: n_peaks
      type(integration_assessment_t), intent(out) :: assessment
      type(error_t), allocatable, intent(out) :: error
      complex(wp) :: first(size(frequencies)), second(size(frequencies))
      integer :: half, k, n, n_retained

      n = size(record%every_displacement, 1)
      n_retained = size(record%every_displacement, 2)
      half = n/2
      allocate (assessment%coefficients(size(frequencies), n_retained), assessment%spread(size(frequencies), n_retained))
      allocate (assessment%frequencies(n_peaks, n_retained), assessment%amplitudes(n_peaks, n_retained))
      if (half < 3) then
         call fail(error, "a record of "//to_text(n)//" samples is too short for coefficients")
         return
      end if
      do k = 1, n_retained
         associate (x => record%every_displacement(:, k))
            call coefficients_at(x, record%start, record%step, frequencies, assessment%coefficients(:, k))
            call coefficients_at(x(:half), record%start, record%step, frequencies, first)
            call coefficients_at(x(n - half + 1:), record%start + (n - half)*record%step, record%step, frequencies, second)
            assessment%spread(:, k) = abs(second - first)
            if (n_peaks == 0) cycle
            call find_frequencies(x, record%start, record%step, assessment%frequencies(:, k), assessment%amplitudes(:, k), error)
            if (allocated(error)) return
         end associate
      end do
   end subroutine assess
end module hb_time_stepping
