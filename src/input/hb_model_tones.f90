!> The base frequencies of a model: the group `&tones`; and the input for unknown ones: phase conditions (`&phase`),
!> amplitude or energy (`&normal_mode`). Checks that there are laws and that the fundamentals of these tones are in
!> the set.
module hb_model_tones
   use hb_amplitudes, only: amplitudes_t
   use hb_discretisation, only: discretisation_t
   use hb_document, only: document_t
   use hb_error, only: annotate, error_t
   use hb_harmonics, only: tuple_text
   use hb_kinds, only: two_pi, wp
   use hb_model, only: model_t
   use hb_properties, only: properties_t
   use hb_structure, only: max_dense
   use hb_system, only: system_t
   use hb_text, only: string_t, to_text
   use hb_thresholds, only: rounding_level
   use hb_tones, only: new_tones, tones_t
   implicit none
   private
   public :: check_fundamentals, read_normal_mode, read_phase, read_tones, tone_of

contains

   !> Reads `&tones`: `frequency` [rad/s] or `hertz`, the `unknown` ones, and their divisors (`subharmonic`).
   subroutine read_tones(self, document, error, may_be_absent)
      type(tones_t), intent(out) :: self
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: may_be_absent                  !! without the group there is no tone; default: an error
      type(properties_t), pointer :: group
      real(wp), allocatable :: absent(:), omega(:)
      logical, allocatable :: is_unknown(:)
      integer :: subharmonic

      if (present(may_be_absent)) then
         if (may_be_absent .and. document%count("tones") == 0) then
            allocate (self%omega(0), self%is_unknown(0))
            return
         end if
      end if
      call document%required_group("tones", group, error)
      if (allocated(error)) error%message = error%message//"; without it a model can only be integrated in time"
      if (allocated(error)) return
      call read_frequencies(group, omega)
      call read_unknown_tones(group, omega, is_unknown)
      if (.not. group%given("frequency")) call group%get("frequency", absent, required=.false.)       ! known in any case
      if (.not. group%given("hertz")) call group%get("hertz", absent, required=.false.)
      call group%get("subharmonic", subharmonic)
      if (allocated(omega)) omega = omega/subharmonic
      call group%finish(error)
      if (allocated(error)) return
      call new_tones(self, omega, error, is_unknown)
      self%subharmonic = subharmonic
      self%is_in_hertz = group%given("hertz")
      if (allocated(error)) call annotate(error, group%location())
   end subroutine read_tones

   !> Reads `frequency` or `hertz`, of which unknown tones alone need none; not allocated after a problem.
   subroutine read_frequencies(group, omega)
      type(properties_t), intent(inout) :: group
      real(wp), allocatable, intent(out) :: omega(:)                  !! [rad/s], as given
      logical, allocatable :: is_unknown(:)
      character(:), allocatable :: key

      if (group%given("hertz")) then
         if (group%given("frequency")) then
            key = trim(merge("hertz    ", "frequency", is_before("frequency", "hertz")))
            call group%problem(key, "give either 'frequency' [rad/s] or 'hertz', not both; the path of a &curve, a &sweep or "// &
                               "--set names the one that is given")
            call group%get("frequency", omega)
         end if
         call group%get("hertz", omega)
         if (allocated(omega)) omega = two_pi*omega
      else if (group%given("frequency") .or. .not. group%given("unknown")) then
         call group%get("frequency", omega)
      else
         call group%get("unknown", is_unknown)
         if (allocated(is_unknown)) then
            omega = spread(0.0_wp, 1, size(is_unknown))
            call group%get("frequency", omega, required=.not. all(is_unknown))
         end if
      end if

   contains

      !> Whether a key is in the file before another one that is there later, or was set by a sweep or an option.
      pure logical function is_before(first, second)
         character(*), intent(in) :: first, second

         associate (content => group%content)
            associate (a => content%keys(content%names%find(first))%line, b => content%keys(content%names%find(second))%line)
               is_before = a > 0 .and. (b <= 0 .or. b > a)
            end associate
         end associate
      end function is_before
   end subroutine read_frequencies

   !> Reads which tones are unknown; the frequencies of the others must be above zero.
   subroutine read_unknown_tones(group, omega, is_unknown)
      type(properties_t), intent(inout) :: group
      real(wp), allocatable, intent(in) :: omega(:)                   !! [rad/s]
      logical, allocatable, intent(out) :: is_unknown(:)
      character(:), allocatable :: key

      if (.not. allocated(omega)) then
         call group%get("unknown", is_unknown)                        ! known in any case
         return
      end if
      is_unknown = spread(.false., 1, size(omega))
      call group%get("unknown", is_unknown)
      if (size(is_unknown) /= size(omega)) then
         call group%problem("unknown", "give one value for each of the "//to_text(size(omega))//" tones")
      else if (any(omega <= 0.0_wp .and. .not. is_unknown)) then
         key = trim(merge("hertz    ", "frequency", group%given("hertz")))
         call group%problem(key, key//"("//to_text(findloc(omega <= 0.0_wp .and. .not. is_unknown, .true., dim=1))// &
                            ") = 0.0 must be above 0.0; only for an unknown tone 0 means that there is no first guess")
      end if
   end subroutine read_unknown_tones

   !> The unknown tone whose frequency a tie follows; 0: none.
   pure integer function tone_of(document, i, tones) result(tone)
      type(document_t), intent(in) :: document
      integer, intent(in) :: i                                        !! of the tie
      type(tones_t), intent(in) :: tones

      associate (to => document%ties(i)%to)
         tone = max(1, to%element(1))
         if (document%groups%holders(to%i_group)%group%name /= "tones" .or. tone > tones%n_tones) tone = 0
      end associate
      if (tone == 0) return
      if (.not. tones%is_unknown(tone)) tone = 0
   end function tone_of

   !> Rejects a model without laws, and a set of harmonics that lacks the fundamental of an unknown tone.
   subroutine check_fundamentals(system, discretisation, group)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(properties_t), intent(inout) :: group
      integer :: i, m

      if (size(system%laws) == 0) &
         call group%problem_as_is(group%location()//": unknown tones need a law; without one nothing determines the amplitude")
      do m = 1, system%tones%n_tones
         associate (tuple => [(merge(1, 0, i == m), i=1, system%tones%n_tones)])
            if (system%tones%is_unknown(m) .and. discretisation%harmonics%index_of(tuple) == 0) &
               call group%problem_as_is(group%location()//": the set of harmonics needs "//tuple_text(tuple)// &
                                        ", the fundamental of an unknown tone")
         end associate
      end do
   end subroutine check_fundamentals

   !> Reads `&phase`: the conditions that fix the phases of unknown tones.
   subroutine read_phase(self, group)
      type(model_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group
      type(string_t), allocatable :: names(:)
      integer :: condition, i                                         ! condition: integral, sine

      allocate (self%system%phase_dofs(0))
      call group%choose("condition", condition)
      if (condition == 1) return
      call group%get("dofs", names, n=count(self%system%tones%is_unknown))
      if (.not. allocated(names)) return
      self%system%phase_dofs = spread(0, 1, size(names))
      do i = 1, size(names)
         call find_dof(self%system, group, "dofs", names(i)%value, self%system%phase_dofs(i))
      end do
   end subroutine read_phase

   !> Reads `&normal_mode`: the amplitude or energy of the motion, and the linear mode from which it starts.
   subroutine read_normal_mode(self, group)
      type(model_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group
      character(:), allocatable :: dof
      integer :: measure                                              ! peak, harmonic

      measure = 1
      associate (mode => self%system%normal_mode)
         mode%is_requested = .true.
         mode%has_energy = group%given("energy")
         call group%get("mode", mode%mode)
         if (mode%has_energy) then
            call group%get("energy", mode%energy)
            call reject_beside_energy(group)
            call check_energy(self%system, self%discretisation, group)
         else if (.not. any([group%given("amplitude"), group%given("dof"), group%given("measure")])) then
            call group%problem("amplitude", "give 'amplitude' and 'dof', or 'energy'")
         else
            call group%get("amplitude", mode%amplitude)
            call group%get("dof", dof)
            if (group%given("amplitude") .and. mode%amplitude == 0.0_wp) call group%problem("amplitude", "must not be 0")
            call group%choose("measure", measure)
         end if
         mode%is_peak = measure == 1
         if (allocated(dof)) call find_dof(self%system, group, "dof", dof, mode%dof)
      end associate
      if (self%options%start%from_integration) &
         call group%problem_as_is(group%location()//": a normal mode is not an attractor, "// &
         "&solver first_guess = 'integration' does not find it")
      if (count(self%system%tones%is_unknown) /= 1) then
         call group%problem_as_is(group%location()//": a normal mode needs one unknown tone: give 'unknown' in &tones")
      else if (self%system%normal_mode%has_energy) then
         if (self%system%tones%n_tones > 1) call group%problem("energy", "with several tones the energy is not that of one motion")
      else if (self%system%normal_mode%is_peak .and. self%system%tones%n_tones > 1) then
         call group%problem("measure", "with several tones there is no common peak; use 'harmonic'")
      end if
   end subroutine read_normal_mode

   !> Rejects keys of a mode with given amplitude if the energy is given.
   subroutine reject_beside_energy(group)
      type(properties_t), intent(inout) :: group
      character(9), parameter :: keys(3) = [character(9) :: "amplitude", "dof", "measure"]
      integer :: i

      do i = 1, size(keys)
         if (group%given(trim(keys(i)))) call group%problem(trim(keys(i)), "not beside 'energy'; leave out one of the two")
      end do
   end subroutine reject_beside_energy

   !> Rejects models in which a free motion has no mechanical energy: laws without a potential, time-dependent loads,
   !> an unsymmetric stiffness.
   subroutine check_energy(system, discretisation, group)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(properties_t), intent(inout) :: group
      type(error_t), allocatable :: error
      type(amplitudes_t) :: loads
      integer :: h, i

      loads = system%loads_in(discretisation%harmonics)
      do i = 1, size(system%laws)
         if (.not. allocated(system%laws(i)%law)) cycle               ! already reported
         if (.not. system%laws(i)%law%has_potential) call group%problem("energy", "law '"//system%laws(i)%law%label// &
            "' has no potential, so that there is no energy to prescribe; give 'amplitude' and 'dof'")
      end do
      do h = 1, discretisation%harmonics%n_harmonics
         if (any(discretisation%harmonics%tuples(:, h) /= 0) .and. .not. loads%is_zero_at(h)) &
            call group%problem("energy", "the energy of a motion under a &load that varies is not constant; give 'amplitude' "// &
                               "and 'dof'")
      end do
      call system%structure%check_matrices("an energy", max_dense, error)
      if (allocated(error)) then
         call group%problem("energy", error%message)
         return
      end if
      associate (k => system%structure%stiffness)
         if (maxval(abs(k - transpose(k))) > rounding_level*maxval(abs(k))) &
            call group%problem("energy", "the stiffness is not symmetric, so that there is no strain energy; give 'amplitude' "// &
                               "and 'dof'")
      end associate
   end subroutine check_energy

   !> Finds a degree of freedom by its name.
   subroutine find_dof(system, group, key, name, dof)
      type(system_t), intent(in) :: system
      type(properties_t), intent(inout) :: group
      character(*), intent(in) :: key, name
      integer, intent(out) :: dof
      type(error_t), allocatable :: error

      call system%structure%find_dof(name, dof, error)
      if (allocated(error)) call group%problem(key, error%message)
   end subroutine find_dof
end module hb_model_tones
