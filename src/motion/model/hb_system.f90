!> The system whose motions are computed: structure, laws, loads and base frequencies. It has no harmonics and no settings.
module hb_system
   use hb_amplitudes, only: amplitudes_t
   use hb_contact_parts, only: contact_parts_t
   use hb_coordinates, only: coordinates_t
   use hb_error, only: error_t, fail
   use hb_frequency_part, only: frequency_part_t                      ! gfortran 12 cannot write the module without it
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_law, only: hold_t, law_box_t
   use hb_law_coordinates, only: dofs_of_unknowns, laws_at, new_law_coordinates
   use hb_law_measure, only: law_measure_t, new_law_measure
   use hb_model_number, only: has_number, model_number_t, tie_t
   use hb_numbers, only: numbered_t
   use hb_spectrum, only: spectrum_t
   use hb_structure, only: structure_t
   use hb_structure_builder, only: structure_builder_t
   use hb_structure_element, only: element_box_t
   use hb_structure_load, only: is_only_in_time, load_box_t
   use hb_text, only: to_text
   use hb_tones, only: tones_t
   implicit none
   private
   public :: coordinates_of, measure_of, normal_mode_t, only_in_time, shared_walls, slowest_of, system_t

   !> Why a load with a course over time has no balance.
   character(*), parameter :: only_in_time = "a load that begins, ends or has a frequency of its own is for time integration "// &
      "alone; a motion with tones has only loads with a tuple"
   !> Why two rigid walls that share a degree of freedom have no balance.
   character(*), parameter :: shared_walls = "are both rigid and share a degree of freedom, which only time integration "// &
      "supports; use one two-sided wall, or an elastic stop for one of them"

   !> The wanted motion of free vibration: by its amplitude or its energy.
   type :: normal_mode_t
      logical :: is_requested = .false.
      logical :: has_energy = .false.                                 !! prescribed instead of an amplitude
      integer :: dof = 0                                              !! of the structure, at which the amplitude is measured
      integer :: mode = 0                                             !! linear mode to start from, by frequency; 0: nearest to
                                                                      !! the first guess of the frequency, otherwise the first
      real(wp) :: amplitude = 0.0_wp                                  !! [m], of either sign
      real(wp) :: energy = 0.0_wp                                     !! [J], > 0
      logical :: is_peak = .true.                                     !! displacement at rest at tau = 0, otherwise first harmonic
   end type normal_mode_t

   integer, parameter :: max_kept = 24                             ! enough to see each mode that the loads excite

   type :: system_t
      class(structure_builder_t), allocatable :: builder              !! of the structure without elements
      type(element_box_t), allocatable :: elements(:)
      type(structure_t) :: structure                                  !! with them
      type(law_box_t), allocatable :: laws(:)
      integer, allocatable :: law_groups(:)                           !! number of the group of each law
      type(load_box_t), allocatable :: loads(:)
      logical :: has_inertia_loads = .false.                          !! some grow with the frequency
      type(spectrum_t) :: load_spectrum                               !! [N], of all loads with tuples
      type(spectrum_t) :: load_slopes                                 !! their derivatives by j.omega [N s]
      type(tones_t) :: tones
      integer, allocatable :: phase_dofs(:)                           !! of the sines that are zero, by unknown tone; size 0:
                                                                      !! integral phase conditions
      type(normal_mode_t) :: normal_mode
      integer, allocatable :: kept_dofs(:)                            !! whose motion is unknown though no law acts on them
      type(tie_t), allocatable :: ties(:)                             !! by which numbers follow others, in their order
      type(contact_parts_t), pointer :: contact_parts => null()       !! of the owner of the points, if contacts of a whole model
                                                                      !! need not be condensed
   contains
      procedure :: object_of => system_object_of
      procedure :: load_of => system_load_of
      procedure :: loads_in => system_loads_in
      procedure :: load_slopes_in => system_load_slopes_in
      procedure :: has_loads_by_structure => system_has_loads_by_structure
      procedure :: has_restitution => system_has_restitution
      procedure :: wanted_dofs => system_wanted_dofs
      procedure :: dofs_of_unknowns => system_dofs_of_unknowns
      procedure :: keep_loaded_dofs => system_keep_loaded_dofs
      procedure :: check_balance => system_check_balance
      procedure :: list_files => system_list_files
      procedure :: may_jump_within_period => system_may_jump_within_period
      procedure :: n_further => system_n_further
      procedure :: clear => system_clear
   end type system_t

contains

   !> The object that has a number: of several laws of one group the first; null if there is none, and for tones and the normal
   !> mode, whose numbers depend on each other.
   function system_object_of(self, number) result(object)
      class(system_t), intent(in), target :: self
      type(model_number_t), intent(in) :: number
      class(numbered_t), pointer :: object
      integer :: k

      object => null()
      associate (i => number%i)
         select case (number%object)
         case (has_number%structure)
            if (allocated(self%builder)) object => self%builder
         case (has_number%dynamic_stiffness)
            if (.not. allocated(self%structure%parts)) return
            if (i <= size(self%structure%parts)) object => self%structure%parts(i)
         case (has_number%law)
            k = findloc(self%law_groups, i, dim=1)
            if (k > 0) object => self%laws(k)%law
         case default
            k = findloc(self%elements%object == number%object .and. self%elements%i == i, .true., dim=1)
            if (k > 0) object => self%elements(k)%element
            k = self%load_of(number)
            if (k > 0) object => self%loads(k)%load
         end select
      end associate
   end function system_object_of

   !> The load that has a number; 0: none.
   pure integer function system_load_of(self, number) result(k)
      class(system_t), intent(in) :: self
      type(model_number_t), intent(in) :: number

      k = findloc(self%loads%object == number%object .and. self%loads%i == number%i, .true., dim=1)
   end function system_load_of

   !> The loads in a set of harmonics [N].
   pure type(amplitudes_t) function system_loads_in(self, set) result(loads)
      class(system_t), intent(in) :: self
      type(harmonics_t), intent(in) :: set

      loads = self%load_spectrum%in_set(set)
   end function system_loads_in

   !> Their derivatives by j.omega [N s].
   pure type(amplitudes_t) function system_load_slopes_in(self, set) result(slopes)
      class(system_t), intent(in) :: self
      type(harmonics_t), intent(in) :: set

      slopes = self%load_slopes%in_set(set, are_slopes=.true.)
   end function system_load_slopes_in

   !> Deallocates the spectra, for the `destroy` of objects that contain a system: gfortran 12 deallocates of a polymorphic
   !> object the first component of each type alone.
   pure subroutine system_clear(self)
      class(system_t), intent(inout) :: self

      self%load_spectrum = spectrum_t()
      self%load_slopes = spectrum_t()
   end subroutine system_clear

   !> Whether some loads depend on the matrices of the structure.
   pure logical function system_has_loads_by_structure(self) result(has)
      class(system_t), intent(in) :: self
      integer :: i

      has = .false.
      do i = 1, size(self%loads)
         has = has .or. self%loads(i)%load%depends_on_structure()
      end do
   end function system_has_loads_by_structure

   !> Degrees of freedom whose motion is unknown whether or not a law acts on them: those with a given phase or amplitude, those
   !> that are kept, and those that elements of the structure need.
   pure function system_wanted_dofs(self) result(dofs)
      class(system_t), intent(in) :: self
      integer, allocatable :: dofs(:)
      logical, allocatable :: is_used(:)
      integer :: i

      allocate (dofs(0))
      if (allocated(self%phase_dofs)) dofs = self%phase_dofs
      if (self%normal_mode%is_requested .and. .not. self%normal_mode%has_energy) dofs = [dofs, self%normal_mode%dof]
      if (allocated(self%kept_dofs)) dofs = [dofs, self%kept_dofs]
      if (.not. (self%structure%depends_on_tuple() .or. allocated(self%structure%states))) return
      if (.not. allocated(self%elements)) return
      is_used = spread(.false., 1, self%structure%n_dofs)
      is_used(dofs) = .true.
      do i = 1, size(self%laws)
         is_used(self%laws(i)%law%dofs) = .true.
      end do
      do i = 1, size(self%elements)
         dofs = [dofs, self%elements(i)%element%wanted_dofs(self%structure, is_used)]
      end do
   end function system_wanted_dofs

   !> Degrees of freedom of the coordinates of the unknowns, ascending, each once.
   pure function system_dofs_of_unknowns(self) result(dofs)
      class(system_t), intent(in) :: self
      integer, allocatable :: dofs(:)

      dofs = dofs_of_unknowns(self%laws, self%wanted_dofs())
   end function system_dofs_of_unknowns

   !> The coordinates of the unknowns.
   function coordinates_of(system, n_laws) result(coordinates)
      type(system_t), intent(in) :: system
      integer, intent(in), optional :: n_laws                         !! only the first ones; default: all
      type(coordinates_t) :: coordinates
      integer :: last

      last = size(system%laws)
      if (present(n_laws)) last = n_laws
      call new_law_coordinates(coordinates, system%structure, system%laws(:last), system%wanted_dofs())
   end function coordinates_of

   !> The slowest tone; 1 without tones [rad/s].
   pure real(wp) function slowest_of(tones)
      type(tones_t), intent(in) :: tones

      slowest_of = 1.0_wp
      if (tones%n_tones > 0) slowest_of = minval(abs(tones%omega))
      if (.not. slowest_of > 0.0_wp) slowest_of = 1.0_wp
   end function slowest_of

   !> The norm of motions at the coordinates of the unknowns: what the laws see of them.
   function measure_of(system) result(measure)
      type(system_t), intent(in) :: system
      type(law_measure_t) :: measure
      type(coordinates_t) :: coordinates

      coordinates = coordinates_of(system)
      call new_law_measure(measure, system%structure, coordinates, laws_at(coordinates, system%laws), system%tones%omega)
   end function measure_of

   !> Gives unknowns to a linear system, so that a curve can be followed: the degrees of freedom of its loads, at which each mode
   !> that they excite moves.
   pure subroutine system_keep_loaded_dofs(self)
      class(system_t), intent(inout) :: self
      logical :: is_loaded(self%structure%n_dofs)
      integer :: i

      is_loaded = .false.
      do i = 1, size(self%loads)
         if (allocated(self%loads(i)%load%weights)) is_loaded(self%loads(i)%load%dofs) = .true.
      end do
      if (.not. any(is_loaded)) is_loaded = .true.
      self%kept_dofs = pack([(i, i=1, size(is_loaded))], is_loaded)
      self%kept_dofs = self%kept_dofs(:min(size(self%kept_dofs), max_kept))
   end subroutine system_keep_loaded_dofs

   !> Fails if the system has no balance, so that it can only be integrated in time.
   pure subroutine system_check_balance(self, error)
      class(system_t), intent(in) :: self
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: user(:)                                 ! rigid law that acts on a degree of freedom
      integer :: i, k

      if (self%tones%n_tones == 0) then
         call fail(error, "missing tones; without them a model can only be integrated in time")
      else if (any(is_only_in_time(self%loads))) then
         i = findloc(is_only_in_time(self%loads), .true., dim=1)
         call fail(error, "load "//to_text(i)//": "//only_in_time)
      end if
      if (allocated(error)) return
      allocate (user(self%structure%n_dofs), source=0)
      do i = 1, size(self%laws)
         if (.not. self%laws(i)%law%is_multiplier) cycle
         associate (dofs => self%laws(i)%law%dofs)
            k = findloc(user(dofs) > 0, .true., dim=1)
            if (k > 0) then
               call fail(error, "laws '"//self%laws(user(dofs(k)))%law%label//"' and '"//self%laws(i)%law%label//"' "//shared_walls)
               return
            end if
            user(dofs) = i
         end associate
      end do
   end subroutine system_check_balance

   !> Whether there are walls and all of them have a given restitution, of their own or by default.
   logical function system_has_restitution(self, default) result(has)
      class(system_t), intent(in) :: self
      real(wp), intent(in) :: default                                 !! negative: none
      type(hold_t) :: hold
      integer :: i

      has = .false.
      do i = 1, size(self%laws)
         if (.not. self%laws(i)%law%is_multiplier) cycle
         hold = self%laws(i)%law%hold()
         if (.not. hold%is_wall) cycle
         has = max(hold%restitution, default) >= 0.0_wp
         if (.not. has) return
      end do
   end function system_has_restitution

   !> Whether a slow tone may carry a fast one through contact: the fast motion may then jump within a period of the slow one.
   logical function system_may_jump_within_period(self) result(may_jump)
      class(system_t), intent(in) :: self
      real(wp), parameter :: max_tone_ratio = 10.0_wp                 ! ratio of two tones
      integer :: i

      may_jump = self%tones%n_tones > 1 .and. .not. any(self%tones%is_unknown)
      if (may_jump) may_jump = maxval(abs(self%tones%omega)) > max_tone_ratio*minval(abs(self%tones%omega)) .and. &
                               any([(self%laws(i)%law%degree == 0, i=1, size(self%laws))])
   end function system_may_jump_within_period

   !> Number of unknowns along a curve in addition to those of the balance: frequencies, artificial damping, and the moving value.
   pure integer function system_n_further(self) result(n_further)
      class(system_t), intent(in) :: self

      n_further = 1 + count(self%tones%is_unknown)
      if (self%normal_mode%is_requested) n_further = n_further + 1
   end function system_n_further

   !> Lists the files besides the input on which the system depends, with their checksums, one per line: libraries of user laws, the
   !> model, its stored reduction.
   subroutine system_list_files(self, text)
      class(system_t), intent(in) :: self
      character(:), allocatable, intent(out) :: text
      character(:), allocatable :: fingerprint
      integer :: i

      text = ""
      do i = 1, size(self%laws)
         fingerprint = trim(self%laws(i)%law%fingerprint())
         if (len(fingerprint) == 0) cycle
         if (len(text) > 0) text = text//new_line("a")
         text = text//self%laws(i)%law%label//": "//fingerprint
      end do
      if (.not. allocated(self%structure%origin)) return
      if (len(text) > 0) text = text//new_line("a")
      text = text//self%structure%origin
   end subroutine system_list_files
end module hb_system
