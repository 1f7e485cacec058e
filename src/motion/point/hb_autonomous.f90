!> A model with unknown tones: the start of the search for its motion, and the search.
!> A known motion, from a neighbouring point or a time integration, is given as `model%start` with its frequencies as
!> the first guesses `model%tones%omega`; it is tried before any mode.
module hb_autonomous
   use hb_advice, only: advice
   use hb_amplitudes, only: amplitudes_t
   use hb_balance, only: balance_t, new_balance
   use hb_base_motion, only: base_motion_t, find_base_motion
   use hb_cancellation, only: work_is_over
   use hb_coordinates, only: coordinates_t
   use hb_discretisation, only: discretisation_t
   use hb_dynamic_stiffness, only: dynamic_stiffness_t, new_dynamic_stiffness
   use hb_energy, only: energy_t, new_energy
   use hb_error, only: error_t, fail
   use hb_harmonics, only: harmonics_t, new_harmonics
   use hb_kinds, only: wp
   use hb_law_coordinates, only: laws_at
   use hb_limit_cycle_search, only: fundamental, new_search, search_t
   use hb_normal_mode, only: find_mode_of_energy, find_normal_mode
   use hb_options, only: options_t
   use hb_outcome, only: outcome
   use hb_self_excitation, only: search_from_modes
   use hb_structure, only: structure_t
   use hb_system, only: coordinates_of, system_t
   use hb_text, only: number_of, to_text
   use hb_torus, only: default_samples, new_torus, torus_t
   implicit none
   private
   public :: autonomous_start_t, find_energy, find_motion, find_start

   integer, parameter :: max_modes = 8                               ! from which one unknown tone is searched for
   real(wp), parameter :: trial_amplitudes(9) = [1.0_wp, 0.5_wp, 2.0_wp, 0.25_wp, 4.0_wp, 0.1_wp, 10.0_wp, 0.03_wp, 30.0_wp]
                                                                      ! relative to the length of the model, without masses

   type :: autonomous_start_t
      type(base_motion_t) :: base
      real(wp), allocatable :: omega(:)                               !! [rad/s], (n_tones), first guesses where unknown
      integer, allocatable :: tones(:)                                !! unknown ones
      integer, allocatable :: modes(:)                                !! of the base motion, one for each unknown tone, or fewer
      logical :: has_motion = .false.                                 !! the user specifies a motion of an unknown tone as the start
   end type autonomous_start_t

   !> What searches have shown that have found no motion.
   type :: vain_searches_t
      character(:), allocatable :: failure                            ! message of the last one that failed
      character(:), allocatable :: driven                             ! of the last one from a mode that grows
      logical :: runs_away = .false.                                  ! this one, up to the largest amplitude tried
      logical :: is_neutral = .true.                                  ! nothing drove or damped a motion
      real(wp) :: reached = huge(1.0_wp)                              ! least of their largest amplitudes [m]
   contains
      procedure :: note => vain_searches_note
      procedure :: conclude => vain_searches_conclude
   end type vain_searches_t

contains

   !> Finds the motion without the unknown tones, its modes, and the frequencies of the start. Modes are not required where a
   !> motion with its frequencies is known.
   subroutine find_start(self, system, options, basis, coordinates, is_known, error)
      type(autonomous_start_t), intent(out) :: self
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(discretisation_t), intent(in) :: basis
      type(coordinates_t), intent(in) :: coordinates                  !! of its laws
      logical, intent(in) :: is_known                                 !! a motion, such as that of a smaller set
      type(error_t), allocatable, intent(out) :: error
      class(balance_t), allocatable :: balance
      type(amplitudes_t) :: given
      integer :: h, m

      allocate (balance)
      given = options%start%spectrum%in_set(basis%harmonics)
      associate (tones => system%tones)
         self%tones = pack([(m, m=1, tones%n_tones)], tones%is_unknown)
         self%has_motion = any([(any(basis%harmonics%tuples(self%tones, h) /= 0) .and. &
                                 .not. given%is_zero_at(h), h=1, basis%harmonics%n_harmonics)])
         self%omega = tones%omega
         where (self%omega <= 0.0_wp) self%omega = 1.0_wp             ! arbitrary: the base motion does not contain these tones
         call new_base_balance(balance, system, basis, coordinates, self%omega, error)
         if (.not. allocated(error)) &
            call find_base_motion(self%base, system%structure, balance, basis%harmonics, options%solver, error)
         call balance%destroy()
         if (allocated(error)) then
            if (.not. (allocated(self%base%u) .and. (self%has_motion .or. is_known))) return
            deallocate (error)                                         ! without modes only the start remains
            allocate (self%modes(0))
         else
            call choose_modes(self, system)
         end if
         do m = 1, size(self%tones)
            if (tones%omega(self%tones(m)) > 0.0_wp) cycle
            if (m > size(self%modes) .and. is_known) then
               exit
            else if (m > size(self%modes) .and. size(tones%omega) == 1 .and. options%has_time_domain() .and. &
                     .not. (allocated(system%structure%parts) .or. system%normal_mode%is_requested)) then
               self%omega = typical_rate(system%structure)
               exit
            else if (m > size(self%modes)) then
               call fail(error, "the linear structure has "//to_text(self%base%n_linear)//" oscillatory modes, not "// &
                         "one for each unknown tone: give first guesses of their frequencies, and a motion to start from")
               return
            end if
            self%omega(self%tones(m)) = self%base%modes%frequency(self%modes(m))
         end do
      end associate
   end subroutine find_start

   !> Rate of a structure without oscillatory modes [1/s], by which a time integration chooses its length.
   pure real(wp) function typical_rate(structure) result(rate)
      type(structure_t), intent(in) :: structure

      rate = 1.0_wp
      if (.not. allocated(structure%stiffness)) return
      associate (k => norm2(structure%stiffness), d => norm2(structure%damping), m => norm2(structure%mass))
         if (m > 0.0_wp .and. k > 0.0_wp) then
            rate = sqrt(k/m)
         else if (m > 0.0_wp .and. d > 0.0_wp) then
            rate = d/m
         else if (k > 0.0_wp .and. d > 0.0_wp) then
            rate = k/d
         end if
      end associate
   end function typical_rate

   !> The balance over the tuples without unknown tones, always with the mean. Fails if the interior is singular.
   subroutine new_base_balance(balance, system, basis, coordinates, omega, error)
      type(balance_t), intent(inout) :: balance
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: basis
      type(coordinates_t), intent(in) :: coordinates                  !! of its laws
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones), > 0, arbitrary for unknown tones
      type(error_t), allocatable, intent(out) :: error
      type(dynamic_stiffness_t) :: stiffness
      type(harmonics_t) :: set
      type(torus_t) :: grid
      integer, allocatable :: tuples(:, :), retained(:)
      integer :: h, samples(size(omega))

      associate (harmonics => basis%harmonics, is_unknown => system%tones%is_unknown)
         retained = pack([(h, h=1, harmonics%n_harmonics)], [(all(harmonics%tuples(:, h) == 0 .or. .not. is_unknown), &
                                                              h=1, harmonics%n_harmonics)])
         tuples = harmonics%tuples(:, retained)
         if (.not. harmonics%has_zero) tuples = reshape([spread(0, 1, size(omega)), reshape(tuples, [size(tuples)])], &
                                                        [size(omega), size(retained) + 1])
         call new_harmonics(set, tuples, error)
         if (allocated(error)) return
         samples = default_samples(set, 0)
         where (.not. is_unknown) samples = max(samples, basis%torus%n_samples)
      end associate
      call new_torus(grid, samples, set, error)
      if (allocated(error)) return
      grid%corrects_kinks = basis%torus%corrects_kinks
      call new_dynamic_stiffness(stiffness, system%structure, coordinates, set%frequencies(omega), &
                                 system%loads_in(set), error, tuples=set%tuples)
      if (.not. allocated(error)) call new_balance(balance, set, grid, omega, stiffness, laws_at(coordinates, system%laws), &
                                                  error)
   end subroutine new_base_balance

   !> Prepares the energy of motions of a balance relative to the motion without the unknown tone.
   subroutine find_energy(energy, system, discretisation, options, balance, error)
      type(energy_t), intent(out) :: energy
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(balance_t), intent(inout) :: balance                       !! on the set of the model, with slopes of motions
      type(error_t), allocatable, intent(out) :: error
      type(autonomous_start_t) :: start

      call find_start(start, system, options, discretisation, coordinates_of(system), .false., error)
      if (.not. allocated(start%base%u)) return
      if (allocated(error)) deallocate (error)                        ! modes are not required
      call new_energy(energy, system%structure, constant_load(system, discretisation), balance, start%base%u)
   end subroutine find_energy

   !> Chooses the modes from which the unknown tones start: those nearest to the first guess of a frequency; without
   !> one, that of a normal mode by its number; otherwise those with the largest growth rate, ordered by frequency.
   subroutine choose_modes(self, system)
      type(autonomous_start_t), intent(inout) :: self
      type(system_t), intent(in) :: system
      logical :: is_free(self%base%modes%n_modes), is_grown(self%base%modes%n_modes)
      integer :: i, m, mode(size(self%tones))

      is_free = .true.
      is_free(self%base%n_linear + 1:) = .false.
      if (.not. system%normal_mode%is_requested) is_free = is_free .and. self%base%is_at_laws
      mode = 0
      associate (modes => self%base%modes, guess => system%tones%omega)
         do m = 1, size(mode)
            if (guess(self%tones(m)) <= 0.0_wp) cycle
            mode(m) = minloc(abs(modes%frequency - guess(self%tones(m))), mask=is_free, dim=1)
            if (mode(m) > 0) is_free(mode(m)) = .false.
         end do
         if (system%normal_mode%is_requested .and. mode(1) == 0) then
            mode(1) = max(1, system%normal_mode%mode)
            if (mode(1) > self%base%n_linear) mode(1) = 0
         else if (system%normal_mode%mode > 0) then
            mode(1) = merge(system%normal_mode%mode, 0, system%normal_mode%mode <= self%base%n_linear)
         end if
         is_grown = .false.
         do i = 1, count(mode == 0 .and. .not. system%normal_mode%is_requested)
            m = maxloc(modes%growth, mask=is_free, dim=1)
            if (m == 0) exit
            is_free(m) = .false.
            is_grown(m) = .true.
         end do
         do m = 1, size(mode)
            if (mode(m) > 0 .or. .not. any(is_grown)) cycle
            mode(m) = findloc(is_grown, .true., dim=1)
            is_grown(mode(m)) = .false.
         end do
      end associate
      self%modes = pack(mode, mode > 0)
   end subroutine choose_modes

   !> Searches for the motion on a balance with slopes, at the frequencies of the start. Afterwards u has the status
   !> of the report in `search`, and the balance has the frequencies of u.
   subroutine find_motion(system, discretisation, options, start, balance, u, search)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(autonomous_start_t), intent(in) :: start
      type(balance_t), intent(inout), target :: balance
      real(wp), intent(inout) :: u(:, :)                              !! [m], (n_coefficients, n_dofs): on entry the start
      type(search_t), intent(out) :: search
      type(energy_t) :: energy
      real(wp) :: length
      integer :: i
      logical :: is_found

      length = 0.0_wp
      do i = 1, size(system%laws)
         length = max(length, system%laws(i)%law%length_scale)
      end do
      if (length <= 0.0_wp) length = maxval(norm2(start%base%u, dim=1))
      if (length <= 0.0_wp) length = 1.0_wp
      call new_search(search, balance, start%base, start%tones, start%modes, &
                      [(balance%stiffness%coordinates%number_of(system%phase_dofs(i)), i=1, size(system%phase_dofs))], &
                         length, options%solver)
      u = u + start%base%u
      if (system%normal_mode%has_energy) then
         call new_energy(energy, system%structure, constant_load(system, discretisation), balance, start%base%u)
         call find_mode_of_energy(search, energy, system%normal_mode%energy, start%has_motion, u)
         return
      else if (system%normal_mode%is_requested) then
         call find_normal_mode(search, system%normal_mode%amplitude, system%normal_mode%is_peak, &
                               balance%stiffness%coordinates%number_of(system%normal_mode%dof), start%has_motion, u)
         return
      end if
      is_found = .false.
      if (start%has_motion) call search%from_start(u, is_found)
      if (is_found) return
      if (size(start%tones) == 1 .and. size(start%modes) == 1 .and. .not. any(is_damped(start%base))) then
         call search_from_amplitudes(start, balance, search, u, is_found)
      else if (size(start%tones) == 1 .and. size(start%modes) == 1) then
         call search_all_modes(start, system%tones%omega(start%tones(1)), balance, search, u, is_found)
      else if (size(start%modes) == size(start%tones)) then
         call search_from_modes(search, u, is_found)
      else
         u = start%base%u
         search%report%status = outcome%stalled
         search%message = "the linear structure has fewer oscillatory modes than unknown tones, and no given start leads "// &
                          "to a motion"
         search%advice = advice%guess_by_integration
      end if
   end subroutine find_motion

   !> Searches for the motion of one unknown tone: from the chosen mode, then from others, those nearest to the first
   !> guess or most strongly driven first. A motion that decays or grows from a mode into another is accepted only if
   !> there is no other.
   subroutine search_all_modes(start, guess, balance, search, u, is_found)
      type(autonomous_start_t), intent(in) :: start
      real(wp), intent(in) :: guess                                   !! of its frequency [rad/s]; 0: none
      type(balance_t), intent(inout), target :: balance
      type(search_t), intent(inout) :: search
      real(wp), intent(inout) :: u(:, :)                              !! [m], (n_coefficients, n_dofs)
      logical, intent(inout) :: is_found
      type(error_t), allocatable :: error
      type(vain_searches_t) :: in_vain
      character(:), allocatable :: unstable_message
      real(wp) :: merit(start%base%modes%n_modes)
      real(wp), allocatable :: unstable_u(:, :), unstable_omega(:)
      integer :: best, k

      merit = merit_of_modes(start, guess)
      unstable_message = ""
      do k = 1, min(max_modes, count(start%base%is_at_laws))
         best = maxloc(merit, dim=1)
         merit(best) = -huge(1.0_wp)
         if (work_is_over()) return
         if (.not. abs(start%base%modes%response(best)) > 0.0_wp) cycle
         search%modes = [best]
         call search_from_modes(search, u, is_found)
         if (is_found .and. .not. search%is_left) return
         if (is_found .and. .not. allocated(unstable_u)) then
            allocate (unstable_u, source=u)
            allocate (unstable_omega, source=balance%omega)
            unstable_message = search%message
         end if
         call in_vain%note(search)
         if (in_vain%is_neutral) return
      end do
      if (allocated(unstable_u)) then
         u = unstable_u
         call balance%move(unstable_omega, 0.0_wp*unstable_omega, error)
         call search%from_start(u, is_found)
         search%message = unstable_message
         if (is_found) return
      end if
      call in_vain%conclude(k - 1, search)
   end subroutine search_all_modes

   !> Notes what a search from one mode has shown.
   pure subroutine vain_searches_note(self, search)
      class(vain_searches_t), intent(inout) :: self
      type(search_t), intent(in) :: search                            !! after it

      if (search%report%status == outcome%stalled) then
         self%failure = search%message
      else if (search%is_driven) then
         self%driven = search%message
         self%runs_away = search%runs_away
      end if
      self%reached = min(self%reached, search%reached)
      self%is_neutral = self%is_neutral .and. search%is_neutral
   end subroutine vain_searches_note

   !> Sets message and status of a search from all modes: a failure counts more than a mode that grows, this more than decay.
   subroutine vain_searches_conclude(self, n_modes, search)
      class(vain_searches_t), intent(in) :: self
      integer, intent(in) :: n_modes                                  !! that were tried
      type(search_t), intent(inout) :: search
      character(7) :: amplitude

      if (allocated(self%failure)) then
         search%report%status = outcome%stalled
         search%message = self%failure
      else if (allocated(self%driven)) then
         if (self%runs_away) search%report%status = outcome%no_motion
         search%message = self%driven
      else
         write (amplitude, "(es7.1)") self%reached
         search%message = "the motion decays from each of "//number_of(n_modes, "mode")//", up to an amplitude of "//amplitude// &
            " or more"
      end if
   end subroutine vain_searches_conclude

   !> Whether the artificial damping changes the growth rates of modes: it acts on masses.
   pure function is_damped(base)
      type(base_motion_t), intent(in) :: base
      logical :: is_damped(base%modes%n_modes)

      is_damped = abs(base%modes%response) > 0.0_wp
   end function is_damped

   !> Searches for the limit cycle of equations of first order, which have no masses on which an artificial damping could
   !> act: by Newton's method from the modes that grow, with several amplitudes.
   subroutine search_from_amplitudes(start, balance, search, u, is_found)
      type(autonomous_start_t), intent(in) :: start
      type(balance_t), intent(inout), target :: balance
      type(search_t), intent(inout) :: search
      real(wp), intent(inout) :: u(:, :)                              !! [m], (n_coefficients, n_dofs)
      logical, intent(inout) :: is_found
      type(error_t), allocatable :: error
      complex(wp) :: mode_shape(size(u, 2))
      real(wp) :: omega(size(balance%omega))
      integer :: h, i, k

      search%is_neutral = .false.
      h = fundamental(balance%harmonics, start%tones(1))
      omega = balance%omega
      associate (modes => start%base%modes, set => balance%harmonics)
         do k = 1, modes%n_modes
            if (.not. modes%growth(k) > 0.0_wp) cycle
            mode_shape = modes%shapes(:, k)
            mode_shape = mode_shape/mode_shape(maxloc(abs(mode_shape), dim=1))
            omega(start%tones(1)) = modes%frequency(k)
            do i = 1, size(trial_amplitudes)
               if (work_is_over()) return
               call balance%move(omega, 0.0_wp*omega, error)
               if (allocated(error)) return
               u = start%base%u
               u(set%cos_at(h), :) = u(set%cos_at(h), :) + trial_amplitudes(i)*search%length*real(mode_shape)
               u(set%sin_at(h), :) = u(set%sin_at(h), :) - trial_amplitudes(i)*search%length*aimag(mode_shape)
               call search%from_start(u, is_found)
               if (is_found) return
            end do
         end do
         u = start%base%u
         search%report%status = outcome%no_motion
         search%message = "the equilibrium is stable: no mode grows"
         if (.not. any(modes%growth > 0.0_wp)) return
         search%report%status = outcome%stalled
         search%message = "no motion was found from the modes that grow"
         search%advice = advice%guess_by_integration
      end associate
   end subroutine search_from_amplitudes

   !> Order of the modes: nearest to the first guess, or most strongly driven; modes on which the laws have no effect
   !> are excluded.
   function merit_of_modes(start, guess) result(merit)
      type(autonomous_start_t), intent(in) :: start
      real(wp), intent(in) :: guess                                   !! [rad/s]; 0: none
      real(wp) :: merit(start%base%modes%n_modes)

      merit = start%base%modes%growth
      if (guess > 0.0_wp) merit = -abs(start%base%modes%frequency - guess)
      where (.not. start%base%is_at_laws) merit = -huge(1.0_wp)
   end function merit_of_modes

   !> Constant forces on all degrees of freedom [N]: the loads in the zero tuple.
   pure function constant_load(system, discretisation) result(load)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      real(wp) :: load(system%structure%n_dofs)
      type(amplitudes_t) :: loads
      integer :: h

      load = 0.0_wp
      h = discretisation%harmonics%index_of(spread(0, 1, system%tones%n_tones))
      loads = system%loads_in(discretisation%harmonics)
      if (h > 0) load = real(loads%of(h))
   end function constant_load
end module hb_autonomous
