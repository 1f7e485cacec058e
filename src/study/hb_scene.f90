!> A scene: all that one point of a study needs, read from a namelist document.
!>
!> The component initialisers of the types here and below are the defaults of the input; docs/input.md lists the keys.
module hb_scene
   use hb_error, only: annotate, error_t
   use hb_fftw, only: planning, planning_names
   use hb_harmonics, only: harmonics_t, new_of_parity, tuple_text
   use hb_kinds, only: two_pi, wp
   use hb_law, only: law_box_t, law_t
   use hb_law_catalogue, only: read_law
   use hb_law_set, only: law_dofs_of
   use hb_loads, only: add_harmonic
   use hb_march_config, only: march_config_t, read_march
   use hb_memory_estimate, only: check_memory, gib
   use hb_memory_sizes, only: new_sizes, sizes_t
   use hb_namelist, only: document_t, group_t
   use hb_normal_mode, only: measure_names, normal_mode_t
   use hb_odd_symmetry, only: has_memory, why_not_odd
   use hb_solver_types, only: method_names, solver_config_t, start_names
   use hb_structure, only: structure_t
   use hb_structure_catalogue, only: read_structure
   use hb_text, only: string_t, to_text
   use hb_tones, only: new_tones, tones_t
   use hb_torus, only: default_samples, new_torus, torus_t
   use hb_truncation, only: read_harmonics, symmetry
   implicit none
   private
   public :: group_names, groups_read_again, half_of_odd, is_solved_odd, output_config_t, read_again, read_scene, read_tones
   public :: scene_t, sizes_of

   !> Every group that an input file may have.
   character(11), parameter :: group_names(13) = [character(11) :: &
      "structure", "tones", "phase", "harmonics", "sampling", "load", "law", "start", "normal_mode", "solver", &
      "certificate", "output", "march"]

   !> Groups of numbers that many points of a study differ in.
   character(5), parameter :: groups_read_again(4) = [character(5) :: "tones", "load", "law", "start"]

   character(8), parameter :: phase_names(2) = [character(8) :: "integral", "sine"]

   character(9), parameter :: first_guess_names(4) = [character(9) :: "linear", "zero", "neighbour", "march"]

   !> What is kept of a result.
   type :: output_config_t
      character(:), allocatable :: title
      integer, allocatable :: dofs(:)                                 !! stored degrees of freedom
      integer, allocatable :: samples(:)                              !! grid of the stored surfaces, size 0: none
   end type output_config_t

   !> What makes a solved point count as not good enough.
   type :: certificate_config_t
      logical :: is_on = .true.
      real(wp) :: truncation = 0.1_wp                                 !! largest estimated error, relative to the motion
      real(wp) :: aliasing = 0.1_wp                                   !! largest estimated error, relative to the motion
      real(wp) :: penetration = 0.1_wp                                !! largest, relative to the largest harmonic
      integer :: improvement_steps = 0                                !! steps towards the motion in a wider set
      real(wp) :: commensurability = 1.0e-3_wp                        !! smallest |k.omega| relative to the largest tone
   end type certificate_config_t

   !> First guesses from neighbouring points of a sweep.
   type :: chain_config_t
      logical :: is_on = .false.
      integer :: length = 16                                          !! points along the fastest parameter
      logical :: secant = .true.                                      !! extrapolate through the last two solutions
   end type chain_config_t

   type :: scene_t
      type(structure_t) :: structure
      type(tones_t) :: tones
      integer, allocatable :: phase_dofs(:)                           !! of the sines that vanish, by unknown tone; size 0:
                                                                      !! integral phase conditions
      type(normal_mode_t) :: normal_mode
      type(harmonics_t) :: harmonics
      integer :: symmetry = symmetry%auto
      type(torus_t) :: torus
      type(law_box_t), allocatable :: laws(:)
      complex(wp), allocatable :: loads(:, :)                         !! cos - i sin [N], (n_dofs, n_harmonics)
      complex(wp), allocatable :: load_slopes(:, :)                   !! their derivatives by j.omega [N s], as loads
      logical :: has_inertia_loads = .false.                          !! some grow with the frequency
      complex(wp), allocatable :: start(:, :)                         !! added to the first guess [m], as loads
      type(solver_config_t) :: solver
      logical :: start_from_linear = .true.                           !! first guess: the motion without laws, else zero
      logical :: start_from_march = .false.                           !! or where marching ends
      type(chain_config_t) :: chain
      integer :: planning = planning%estimate                         !! effort of FFTW
      character(:), allocatable :: wisdom                             !! file with FFTW's wisdom
      type(certificate_config_t) :: certificate
      type(output_config_t) :: output
      real(wp) :: memory_limit = huge(1.0_wp)                         !! bytes that this process may take
      type(march_config_t) :: march
   end type scene_t

contains

   !> Reads a scene. All problems of the input are collected in one message, a line each. Fails as well where the scene would
   !> need more memory than its key `memory_limit` or, where that is zero, `available` says.
   subroutine read_scene(self, document, error, available)
      type(scene_t), intent(out) :: self
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: available                     !! bytes for this process

      if (present(available)) self%memory_limit = available
      call read_parts(self, document, error)
      if (.not. allocated(error)) call document%finish(error)
   end subroutine read_scene

   !> Reads group after group; `error` is what stops the reading, problems of single keys wait in the document.
   subroutine read_parts(self, document, error)
      type(scene_t), intent(inout) :: self
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error
      type(group_t), pointer :: group
      integer :: i

      call read_solver(self, document%optional_group("solver"))
      call document%required_group("structure", group, error)
      if (allocated(error)) return
      call read_structure(group, self%structure, error, self%memory_limit)
      if (allocated(error)) return
      call read_tones(self%tones, document, error)
      if (allocated(error)) return
      call read_harmonics(self%harmonics, document, self%tones%n_tones, error, self%symmetry)
      if (allocated(error)) return

      allocate (self%laws(document%count("law")))
      do i = 1, size(self%laws)
         group => document%group("law", i)
         call read_law(self%laws(i), group, self%structure, i)
         call check_kind(self%laws(i), group, error)
         if (allocated(error)) return
         call check_rigid_laws(self%laws(:i), group)
         if (self%laws(i)%law%phase_tone > self%tones%n_tones) then
            call group%problem("tone", "there are only "//to_text(self%tones%n_tones)//" tones")
         end if
      end do
      call read_certificate(self%certificate, document%optional_group("certificate"))
      call read_output(self, document%optional_group("output"))
      call read_sampling(self, document%optional_group("sampling"))
      call check_memory(sizes_of(self), self%memory_limit, error)
      if (allocated(error)) then
         call annotate(error, document%file_name)
         return
      end if
      allocate (self%loads(self%structure%n_dofs, self%harmonics%n_harmonics), source=(0.0_wp, 0.0_wp))
      allocate (self%load_slopes, self%start, source=self%loads)
      call read_loads(self, document)
      call check_symmetry(self, document%optional_group("harmonics"))
      call check_memory(sizes_of(self), self%memory_limit, error)     ! again: loads tell whether motions are odd
      if (allocated(error)) then
         call annotate(error, document%file_name)
         return
      end if
      if (any(self%tones%is_unknown)) then
         if (self%certificate%improvement_steps > 0) then
            group => document%optional_group("certificate")
            call group%problem("improvement_steps", "only tones that are given allow it; leave it out")
         end if
         call check_fundamentals(self, document%optional_group("harmonics"))
         call read_phase(self, document%optional_group("phase"))
      end if
      if (document%count("normal_mode") > 0) call read_normal_mode(self, document%optional_group("normal_mode"))
      call read_march(self%march, document%optional_group("march"))
   end subroutine read_parts

   !> Reads those of `&tones`, `&law`, `&load` and `&start` anew that a document has, into a scene whose other groups are as before.
   !> `is_read` is false, and the scene of no use, where something is wrong with them, or where they differ in more than numbers.
   subroutine read_again(self, document, is_read)
      type(scene_t), intent(inout) :: self
      type(document_t), intent(inout), target :: document             !! nothing else; of a name all groups or none
      logical, intent(out) :: is_read
      type(law_box_t) :: box
      type(tones_t) :: tones
      type(error_t), allocatable :: error
      integer :: i

      is_read = .false.
      if (any(self%tones%is_unknown) .or. self%symmetry == symmetry%odd) return
      if (document%count("tones") > 0) then
         call read_tones(tones, document, error)
         if (allocated(error)) return
         if (tones%n_tones /= self%tones%n_tones .or. any(tones%is_unknown)) return
         self%tones = tones
      end if
      do i = 1, document%count("law")
         call read_law(box, document%group("law", i), self%structure, i)
         if (.not. allocated(box%law)) return
         if (.not. is_alike(box%law, self%laws(i)%law)) return
         call move_alloc(box%law, self%laws(i)%law)
      end do
      call read_loads(self, document)
      call document%finish(error)
      is_read = .not. allocated(error)
   end subroutine read_again

   !> Whether two laws differ by numbers alone.
   logical function is_alike(law, other)
      class(law_t), intent(in) :: law, other

      is_alike = .false.
      if (.not. (same_type_as(law, other) .and. allocated(law%dofs) .and. allocated(law%shape))) return
      if (size(law%dofs) /= size(other%dofs) .or. any(shape(law%shape) /= shape(other%shape))) return
      is_alike = all(law%dofs == other%dofs) .and. law%label == other%label .and. law%degree == other%degree .and. &
                 (law%needs_velocity .eqv. other%needs_velocity) .and. (law%is_multiplier .eqv. other%is_multiplier) .and. &
                 law%phase_tone == other%phase_tone
   end function is_alike

   !> Reads all `&load` and `&start`.
   subroutine read_loads(self, document)
      type(scene_t), intent(inout) :: self
      type(document_t), intent(inout), target :: document
      integer :: i

      if (document%count("load") > 0) then
         self%loads = (0.0_wp, 0.0_wp)
         self%load_slopes = (0.0_wp, 0.0_wp)
      end if
      do i = 1, document%count("load")
         call read_load(self, document%group("load", i))
      end do
      if (document%count("start") > 0) self%start = (0.0_wp, 0.0_wp)
      do i = 1, document%count("start")
         call read_amplitude(self, document%group("start", i), self%start)
      end do
   end subroutine read_loads

   !> Whether the motion is sought among odd ones, unless a first guess from elsewhere is not odd. Loads and first guess that
   !> are not read yet count as none.
   logical function is_solved_odd(self)
      type(scene_t), intent(in) :: self
      logical :: is_even(self%harmonics%n_harmonics)
      integer :: i

      is_solved_odd = .false.
      if (self%symmetry == symmetry%none .or. size(self%laws) == 0) return
      is_even = modulo(sum(self%harmonics%tuples, dim=1), 2) == 0
      if (self%symmetry == symmetry%auto) then
         if (self%start_from_march) return
         ! a rigid law may take its augmentation from tuples that would go
         if (any(is_even) .and. any([(self%laws(i)%law%is_multiplier, i=1, size(self%laws))])) return
         if (allocated(self%start)) then
            do i = 1, size(is_even)
               if (.not. is_even(i)) cycle
               if (any(abs(self%start(:, i)) > 0.0_wp)) return
            end do
         end if
      end if
      if (allocated(self%loads)) then
         is_solved_odd = len(why_not_odd(self%laws, self%harmonics, self%torus, self%loads)) == 0
      else
         is_solved_odd = len(why_not_odd(self%laws, self%harmonics, self%torus)) == 0
      end if
   end function is_solved_odd

   !> The grid on which odd motions are solved: half of it, but whole for what cannot be halved.
   type(torus_t) function half_of_odd(self) result(torus)
      type(scene_t), intent(in) :: self

      torus = self%torus
      if (.not. torus%can_be_halved()) return
      if (.not. has_memory(self%laws) .or. self%tones%n_tones == 1) torus = torus%half()
   end function half_of_odd

   !> What the memory of a scene depends on; laws from the first that has a problem on, and a grid with one, do
   !> not count. Neighbours may ask for all tuples.
   type(sizes_t) function sizes_of(self) result(sizes)
      type(scene_t), intent(in) :: self
      type(harmonics_t) :: set
      type(torus_t) :: torus
      type(error_t), allocatable :: error
      integer :: n

      do n = 0, size(self%laws) - 1
         if (.not. (allocated(self%laws(n + 1)%law%dofs) .and. allocated(self%laws(n + 1)%law%shape))) exit
      end do
      torus = self%torus
      set = self%harmonics
      if (.not. allocated(torus%n_samples)) then
         torus%n_samples = default_samples(self%harmonics, 1)
      else if (n == size(self%laws) .and. .not. self%chain%is_on) then
         if (is_solved_odd(self)) then
            call new_of_parity(set, self%harmonics, 1, error)         ! that has odd tuples
            torus = half_of_odd(self)
            associate (last => torus%n_samples(size(torus%n_samples)))
               if (torus%is_half) last = last/2
            end associate
         end if
      end if
      call new_sizes(sizes, self%structure, set, torus, self%laws(:n), law_dofs_of(self%laws(:n)), &
                     size(self%output%dofs), self%output%samples, self%solver, self%certificate%is_on, any(self%tones%is_unknown))
   end function sizes_of

   !> Fails when the kind of a law is not known, and with that alone: none of the other keys of its group can be judged.
   subroutine check_kind(box, group, error)
      type(law_box_t), intent(in) :: box
      type(group_t), intent(in) :: group
      type(error_t), allocatable, intent(out) :: error

      if (allocated(box%law)) return
      call group%finish(error)
      error%message = error%message(:index(error%message//new_line("a"), new_line("a")) - 1)
   end subroutine check_kind

   !> Refuses the last law where it and one before are rigid and share a degree of freedom: each would take the whole
   !> reaction.
   subroutine check_rigid_laws(laws, group)
      type(law_box_t), intent(in) :: laws(:)
      type(group_t), intent(inout) :: group                           !! of the last law
      integer :: i, k

      if (.not. is_placed_and_rigid(laws(size(laws)))) return
      associate (last => laws(size(laws))%law)
         do i = 1, size(laws) - 1
            if (.not. is_placed_and_rigid(laws(i))) cycle
            if (.not. any([(laws(i)%law%dofs == last%dofs(k), k=1, size(last%dofs))])) cycle
            call group%problem("type", "laws '"//laws(i)%law%label//"' and '"//last%label//"' are both rigid and share a "// &
                               "degree of freedom; use one two-sided wall, or an elastic stop for one of them")
         end do
      end associate
   end subroutine check_rigid_laws

   logical function is_placed_and_rigid(box)
      type(law_box_t), intent(in) :: box

      is_placed_and_rigid = box%law%is_multiplier .and. allocated(box%law%dofs)   ! without a place: a problem by now
   end function is_placed_and_rigid

   !> Reads `&tones`: `frequency` [rad/s] or `hertz`, and which of them are `unknown`.
   subroutine read_tones(self, document, error)
      type(tones_t), intent(out) :: self
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error
      type(group_t), pointer :: group
      real(wp), allocatable :: omega(:)
      logical, allocatable :: is_unknown(:)

      call document%required_group("tones", group, error)
      if (allocated(error)) return
      if (group%given("hertz")) then
         if (group%given("frequency")) then
            call group%problem("hertz", "give either 'frequency' [rad/s] or 'hertz', not both")
            call group%get("frequency", omega, above=0.0_wp)
         end if
         if (group%given("unknown")) then
            call group%get("hertz", omega, minimum=0.0_wp)
         else
            call group%get("hertz", omega, above=0.0_wp)
         end if
         if (allocated(omega)) omega = two_pi*omega
      else if (.not. group%given("unknown")) then
         call group%require("frequency", omega, above=0.0_wp)
      else if (group%given("frequency")) then
         call group%get("frequency", omega, minimum=0.0_wp)
      else
         call group%get("unknown", is_unknown)
         if (allocated(is_unknown)) then
            omega = spread(0.0_wp, 1, size(is_unknown))
            if (all(is_unknown)) then
               call group%get("frequency", omega)
            else
               call group%require("frequency", omega)
            end if
         end if
      end if
      if (allocated(omega)) then
         is_unknown = spread(.false., 1, size(omega))
         call group%get("unknown", is_unknown)
         if (size(is_unknown) /= size(omega)) then
            call group%problem("unknown", "give one value for each of the "//to_text(size(omega))//" tones")
         else if (any(omega <= 0.0_wp .and. .not. is_unknown)) then
            call group%problem(trim(merge("hertz    ", "frequency", group%given("hertz"))), &
                               "must be greater than 0; only for an unknown tone 0 says that there is no first guess")
         end if
      end if
      call group%finish(error)
      if (allocated(error)) return
      call new_tones(self, omega, error, is_unknown)
      if (allocated(error)) call annotate(error, group%place())
   end subroutine read_tones

   !> Reads `&phase`: the conditions that fix the phases of unknown tones.
   subroutine read_phase(self, group)
      type(scene_t), intent(inout) :: self
      type(group_t), intent(inout) :: group
      character(:), allocatable :: condition
      type(string_t), allocatable :: names(:)
      integer :: i

      condition = trim(phase_names(1))
      allocate (self%phase_dofs(0))
      call group%get("condition", condition, choices=phase_names)
      if (condition == phase_names(1)) return
      call group%require("dofs", names, n=count(self%tones%is_unknown))
      if (.not. allocated(names)) return
      self%phase_dofs = spread(0, 1, size(names))
      do i = 1, size(names)
         call find_law_dof(self, group, "dofs", names(i)%value, self%phase_dofs(i))
      end do
   end subroutine read_phase

   !> Finds a degree of freedom on which a law acts: only these are unknowns.
   subroutine find_law_dof(self, group, key, name, dof)
      type(scene_t), intent(in) :: self
      type(group_t), intent(inout) :: group
      character(*), intent(in) :: key, name
      integer, intent(out) :: dof
      type(error_t), allocatable :: error
      integer :: i

      call self%structure%find_dof(name, dof, error)
      if (allocated(error)) then
         call group%problem(key, error%message)
      else if (.not. all([(allocated(self%laws(i)%law%dofs), i=1, size(self%laws))])) then
         return                                                       ! a problem by now
      else if (all(law_dofs_of(self%laws) /= dof)) then
         call group%problem(key, "no law acts on '"//name//"', so that its motion is not among the unknowns")
      end if
   end subroutine find_law_dof

   !> Reads `&normal_mode`: which amplitude or energy the motion has, and the linear mode from which it starts.
   subroutine read_normal_mode(self, group)
      type(scene_t), intent(inout) :: self
      type(group_t), intent(inout) :: group
      character(:), allocatable :: dof, measure

      measure = trim(measure_names(merge(1, 2, self%normal_mode%is_peak)))
      associate (mode => self%normal_mode)
         mode%is_asked = .true.
         mode%has_energy = group%given("energy")
         call group%get("mode", mode%mode, minimum=0)
         if (mode%has_energy) then
            call group%require("energy", mode%energy, above=0.0_wp)
            call check_energy(self, group)
         else
            call group%require("amplitude", mode%amplitude)
            call group%require("dof", dof)
            call group%get("measure", measure, choices=measure_names)
         end if
         mode%is_peak = measure == measure_names(1)
         if (allocated(dof)) call find_law_dof(self, group, "dof", dof, mode%dof)
         if (group%given("amplitude") .and. mode%amplitude == 0.0_wp) call group%problem("amplitude", "must not be 0")
      end associate
      if (self%start_from_march) call group%problem_as_is(group%place()//": a normal mode attracts nothing, so that "// &
         "&solver first_guess = 'march' does not find it")
      if (count(self%tones%is_unknown) /= 1) then
         call group%problem_as_is(group%place()//": a normal mode needs one unknown tone: give 'unknown' in &tones")
      else if (self%normal_mode%has_energy) then
         if (self%tones%n_tones > 1) call group%problem("energy", "with several tones the energy is not that of one motion")
      else if (self%normal_mode%is_peak .and. self%tones%n_tones > 1) then
         call group%problem("measure", "with several tones there is no common peak; use 'harmonic'")
      end if
   end subroutine read_normal_mode

   !> Refuses what leaves a free motion without a mechanical energy: laws without a potential, loads that vary, a stiffness
   !> that is not symmetric.
   subroutine check_energy(self, group)
      type(scene_t), intent(in) :: self
      type(group_t), intent(inout) :: group
      real(wp), parameter :: digits = 1.0e-12_wp                      ! relative to the largest stiffness
      integer :: h, i

      do i = 1, size(self%laws)
         if (.not. allocated(self%laws(i)%law)) cycle                  ! a problem by now
         if (.not. self%laws(i)%law%has_potential()) call group%problem("energy", "law '"//self%laws(i)%law%label// &
            "' has no potential, so that there is no energy to prescribe; give 'amplitude' and 'dof'")
      end do
      do h = 1, self%harmonics%n_harmonics
         if (any(self%harmonics%tuples(:, h) /= 0) .and. any(abs(self%loads(:, h)) > 0.0_wp)) &
            call group%problem("energy", "the energy of a motion under a &load that varies is not constant; give 'amplitude' "// &
                               "and 'dof'")
      end do
      associate (k => self%structure%stiffness)
         if (maxval(abs(k - transpose(k))) > digits*maxval(abs(k))) &
            call group%problem("energy", "the stiffness is not symmetric, so that there is no strain energy; give 'amplitude' "// &
                               "and 'dof'")
      end associate
   end subroutine check_energy

   !> Refuses a scene without laws, and a set of harmonics that lacks the fundamental of an unknown tone.
   subroutine check_fundamentals(self, group)
      type(scene_t), intent(in) :: self
      type(group_t), intent(inout) :: group
      integer :: i, m

      if (size(self%laws) == 0) call group%problem_as_is(group%place()//": unknown tones need a law, without one nothing "// &
                                                         "fixes an amplitude")
      do m = 1, self%tones%n_tones
         associate (tuple => [(merge(1, 0, i == m), i=1, self%tones%n_tones)])
            if (self%tones%is_unknown(m) .and. self%harmonics%index_of(tuple) == 0) &
               call group%problem_as_is(group%place()//": the set of harmonics needs "//tuple_text(tuple)// &
                                        ", the fundamental of an unknown tone")
         end associate
      end do
   end subroutine check_fundamentals

   !> Refuses `symmetry = 'odd'` where the equations are not odd.
   subroutine check_symmetry(self, group)
      type(scene_t), intent(in) :: self
      type(group_t), intent(inout) :: group
      character(:), allocatable :: reason
      integer :: i

      if (self%symmetry /= symmetry%odd .or. .not. allocated(self%torus%n_samples)) return
      if (.not. all([(allocated(self%laws(i)%law%dofs), i=1, size(self%laws))])) return   ! a problem by now
      reason = why_not_odd(self%laws, self%harmonics, self%torus, self%loads)
      if (len(reason) > 0) call group%problem("symmetry", "must not be 'odd': "//reason// &
                                              "; 'auto' uses the symmetry where there is one")
   end subroutine check_symmetry

   !> Reads `&load`: an amplitude, and the power of |j.omega| that multiplies it.
   subroutine read_load(self, group)
      type(scene_t), intent(inout) :: self
      type(group_t), intent(inout) :: group
      complex(wp), allocatable :: amplitudes(:, :)
      real(wp), allocatable :: w(:)
      integer :: h, power

      power = 0
      call group%get("frequency_power", power, minimum=0, maximum=4)
      if (power > 0 .and. any(self%tones%is_unknown)) then
         call group%problem("frequency_power", "loads cannot grow with frequencies where some of these are unknown")
      end if
      if (power == 0) then
         call read_amplitude(self, group, self%loads)
         return
      end if
      self%has_inertia_loads = .true.
      allocate (amplitudes(size(self%loads, 1), size(self%loads, 2)), source=(0.0_wp, 0.0_wp))
      call read_amplitude(self, group, amplitudes)
      w = self%harmonics%frequencies(self%tones%omega)
      do h = 1, size(w)
         self%loads(:, h) = self%loads(:, h) + abs(w(h))**power*amplitudes(:, h)
         self%load_slopes(:, h) = self%load_slopes(:, h) + power*abs(w(h))**(power - 1)*sign(1.0_wp, w(h))*amplitudes(:, h)
      end do
   end subroutine read_load

   !> Reads `&load` and `&start`: `dof`, `tuple`, `cos`, `sin`, added to the amplitudes.
   subroutine read_amplitude(self, group, amplitudes)
      type(scene_t), intent(in) :: self
      type(group_t), intent(inout) :: group
      complex(wp), intent(inout) :: amplitudes(:, :)
      character(:), allocatable :: name
      integer, allocatable :: tuple(:)
      type(error_t), allocatable :: error
      real(wp) :: cosine, sine
      integer :: dof

      cosine = 0.0_wp
      sine = 0.0_wp
      call group%require("dof", name)
      call group%require("tuple", tuple, n=self%tones%n_tones)
      call group%get("cos", cosine)
      call group%get("sin", sine)
      if (.not. (group%given("cos") .or. group%given("sin"))) then
         call group%problem("cos", "give 'cos', 'sin' or both")
      end if
      if (.not. (allocated(name) .and. allocated(tuple))) return
      if (size(tuple) /= self%tones%n_tones) return
      call self%structure%find_dof(name, dof, error)
      if (allocated(error)) then
         call group%problem("dof", error%message)
         return
      end if
      call add_harmonic(amplitudes, self%harmonics, dof, tuple, cosine, sine, error)
      if (allocated(error)) call group%problem("tuple", error%message)
   end subroutine read_amplitude

   !> Reads `&sampling`: `samples` per tone, effort and wisdom file of FFTW.
   subroutine read_sampling(self, group)
      type(scene_t), intent(inout) :: self
      type(group_t), intent(inout) :: group
      integer, allocatable :: samples(:)
      character(:), allocatable :: effort
      type(error_t), allocatable :: error
      integer :: degree, i

      degree = 1
      do i = 1, size(self%laws)
         if (self%laws(i)%law%degree == 0 .or. degree == 0) then
            degree = 0
         else
            degree = max(degree, self%laws(i)%law%degree)
         end if
      end do
      samples = [0]                                                   ! so that a sweep over the order has its own at each point
      call group%get("samples", samples, minimum=0)
      if (size(samples) == 1) samples = spread(samples(1), 1, self%tones%n_tones)
      if (size(samples) == self%tones%n_tones) &
         samples = merge(samples, default_samples(self%harmonics, degree), samples > 0)
      call new_torus(self%torus, samples, self%harmonics, error)
      if (allocated(error)) call group%problem("samples", error%message)

      effort = planning_names(1)
      call group%get("planning", effort, choices=planning_names)
      select case (effort)
      case ("measure"); self%planning = planning%measure
      case ("patient"); self%planning = planning%patient
      case default; self%planning = planning%estimate
      end select
      call group%get("wisdom", self%wisdom)
   end subroutine read_sampling

   !> Reads `&solver` into its configuration.
   subroutine read_solver(self, group)
      type(scene_t), intent(inout) :: self
      type(group_t), intent(inout) :: group
      character(:), allocatable :: first_guess, first_jacobian, name
      real(wp) :: limit

      associate (solver => self%solver)
         name = trim(method_names(solver%method))
         first_jacobian = trim(start_names(merge(2, 1, solver%start_with_tangent)))
         first_guess = trim(first_guess_names(merge(1, 2, self%start_from_linear)))
         call group%get("method", name, choices=method_names)
         call group%get("tolerance", solver%tolerance, above=0.0_wp)
         call group%get("max_iterations", solver%max_iterations, minimum=0)
         call group%get("line_search", solver%line_search)
         call group%get("rescue", solver%rescue)
         call group%get("homotopy_iterations", solver%homotopy_iterations, minimum=0)
         call group%get("memory", solver%memory, minimum=1, maximum=10000)
         call group%get("first_jacobian", first_jacobian, choices=start_names)
         call group%get("first_guess", first_guess, choices=first_guess_names)
         call group%get("chain_length", self%chain%length, minimum=1, maximum=1000000)
         call group%get("secant", self%chain%secant)
         limit = 0.0_wp
         call group%get("memory_limit", limit, minimum=0.0_wp)
         if (limit > 0.0_wp) self%memory_limit = limit*gib
         solver%method = max(1, findloc(method_names == name, .true., dim=1))
         solver%start_with_tangent = first_jacobian == start_names(2)
         self%chain%is_on = first_guess == first_guess_names(3)
         self%start_from_linear = first_guess /= first_guess_names(2)
         self%start_from_march = first_guess == first_guess_names(4)
      end associate
   end subroutine read_solver

   !> Reads `&certificate`: whether it is made, and its thresholds.
   subroutine read_certificate(self, group)
      type(certificate_config_t), intent(inout) :: self
      type(group_t), intent(inout) :: group

      call group%get("is_on", self%is_on)
      call group%get("truncation", self%truncation, above=0.0_wp)
      call group%get("aliasing", self%aliasing, above=0.0_wp)
      call group%get("penetration", self%penetration, above=0.0_wp)
      call group%get("improvement_steps", self%improvement_steps, minimum=0, maximum=1000)
      call group%get("commensurability", self%commensurability, minimum=0.0_wp)
   end subroutine read_certificate

   !> Reads `&output`: title, stored degrees of freedom, grid of stored surfaces.
   subroutine read_output(self, group)
      type(scene_t), intent(inout) :: self
      type(group_t), intent(inout) :: group
      type(string_t), allocatable :: names(:)
      type(torus_t) :: torus
      type(error_t), allocatable :: error
      integer :: i

      associate (output => self%output)
         output%title = ""
         call group%get("title", output%title)
         call group%get("samples", output%samples, minimum=1)
         if (.not. allocated(output%samples)) allocate (output%samples(0))
         if (size(output%samples) == 1) output%samples = spread(output%samples(1), 1, self%tones%n_tones)
         if (size(output%samples) > 0 .and. size(output%samples) /= self%tones%n_tones) then
            call group%problem("samples", "give one number, or one for each of the "//to_text(self%tones%n_tones)//" tones")
         else if (size(output%samples) > 0) then
            call new_torus(torus, output%samples, self%harmonics, error)
            if (allocated(error)) call group%problem("samples", error%message)
         end if
         call group%get("dofs", names)
         if (allocated(names)) then
            allocate (output%dofs(size(names)))
            do i = 1, size(names)
               call self%structure%find_dof(names(i)%value, output%dofs(i), error)
               if (allocated(error)) call group%problem("dofs", error%message)
            end do
         else
            output%dofs = [(i, i=1, self%structure%n_dofs)]
         end if
      end associate
   end subroutine read_output
end module hb_scene
