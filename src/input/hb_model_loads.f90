!> Amplitudes of a model by harmonic: loads (`&load` and others) and terms added to the first guess (`&start`); `&initial`.
module hb_model_loads
   use hb_discretisation, only: discretisation_t
   use hb_document, only: document_t
   use hb_element_reader, only: find_dofs
   use hb_error, only: error_t
   use hb_harmonics, only: tuple_text
   use hb_kinds, only: wp
   use hb_load_catalogue, only: allocate_load, load_groups
   use hb_model, only: model_t
   use hb_model_number, only: has_number
   use hb_model_numbers, only: build_starts, unknown_tone_of, update_loads
   use hb_number_reader, only: group_problems_t, read_numbers
   use hb_parameter_path, only: check_label
   use hb_properties, only: properties_t
   use hb_stability, only: stability_method
   use hb_start_term, only: start_term_t
   use hb_structure, only: structure_t
   use hb_structure_load, only: is_only_in_time, is_random, structure_load_t, time_key_of
   use hb_system, only: only_in_time
   use hb_text, only: max_name, number_of, to_text
   implicit none
   private
   public :: groups_with_tuples, loaded_tuples, read_initial, read_loads, read_starts

   !> Groups that may have the key `tuple`.
   character(*), parameter :: groups_with_tuples(*) = [character(max_name) :: load_groups, "start"]

contains

   !> Reads all loads in the order of their table.
   subroutine read_loads(self, document)
      type(model_t), intent(inout) :: self                            !! with its structure, tones and harmonics
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable :: error
      type(properties_t), pointer :: group
      integer :: i, k, n

      allocate (self%system%loads(sum([(document%count(trim(load_groups(k))), k=1, size(load_groups))])))
      n = 0
      do k = 1, size(load_groups)
         do i = 1, document%count(trim(load_groups(k)))
            n = n + 1
            group => document%group(trim(load_groups(k)), i)
            self%system%loads(n)%object = has_number%load + k - 1
            self%system%loads(n)%i = i
            call allocate_load(self%system%loads(n), trim(load_groups(k)))
            call read_load(self%system%loads(n)%load, self%system%structure, self%discretisation, group)
            if (is_only_in_time(self%system%loads(n)) .and. .not. self%options%purpose%may_only_integrate) &
               call group%problem(trim(time_key_of(self%system%loads(n)%load)), only_in_time)
            if (is_random(self%system%loads(n))) &
               call check_noise(self%options%stability%method == stability_method%off, document%count("normal_mode") > 0, group)
            if (.not. allocated(self%system%loads(n)%load%weights)) cycle
            if (unknown_tone_of(self%system, n) > 0) call group%problem("tuple", "tone "// &
               to_text(unknown_tone_of(self%system, n))//" of &tones is unknown, and a load needs a given frequency; a first "// &
               "guess is given by &start")
         end do
      end do
      self%system%has_inertia_loads = any([(self%system%loads(i)%load%depends_on_frequency(), i=1, n)])
      call update_loads(self%system, error)                           ! an error has been reported
   end subroutine read_loads

   !> Reports noise about motions of which no stability is found.
   subroutine check_noise(is_off, is_normal_mode, group)
      logical, intent(in) :: is_off                                   !! no stability is requested
      logical, intent(in) :: is_normal_mode
      type(properties_t), intent(inout) :: group

      if (is_off) call group%problem("intensity", "a response to noise needs the stability of the motion: leave out 'off' in "// &
                                     "&stability")
      if (is_normal_mode) call group%problem("intensity", "the amplitude of a normal mode has no limit under noise; leave out "// &
                                             "&noise or &normal_mode")
   end subroutine check_noise

   !> Reads a load: where it acts, its tuple, as far as its kind has keys for them, and all that it declares. Weights are not
   !> allocated after a problem.
   subroutine read_load(load, structure, discretisation, group)
      class(structure_load_t), intent(inout) :: load
      type(structure_t), intent(in) :: structure
      type(discretisation_t), intent(in) :: discretisation
      type(properties_t), intent(inout), target :: group
      character(:), allocatable :: label
      integer, allocatable :: dofs(:)
      real(wp), allocatable :: weights(:)
      type(group_problems_t) :: problems

      if (group%given("label")) call group%get("label", label)        ! used by paths
      call check_label(group, label)
      if (group%has_key("dof")) then
         call read_position(structure, group, dofs, weights)
      else if (group%has_key("dofs")) then
         call find_dofs(group, "dofs", structure, load%n_dofs(), dofs)
         if (allocated(dofs)) weights = spread(1.0_wp, 1, size(dofs))
      else
         allocate (dofs(0), weights(0))
      end if
      call read_numbers(load, group)
      if (group%has_key("tuple") .and. load%has_tuple()) then
         call read_tuple(discretisation, group, load%tuple)
         if (allocated(load%tuple) .and. time_key_of(load) == "") call check_tuple(discretisation, group, load%tuple)
      else
         load%tuple = spread(0, 1, discretisation%harmonics%n_tones)
      end if
      problems%group => group
      call load%check(problems)
      if (group%has_problems()) return
      call move_alloc(dofs, load%dofs)
      call move_alloc(weights, load%weights)
      call load%derive()
   end subroutine read_load

   !> Reads all `&start`.
   subroutine read_starts(self, document)
      type(model_t), intent(inout) :: self
      type(document_t), intent(inout), target :: document
      integer :: i

      allocate (self%options%start%given(document%count("start")))
      do i = 1, size(self%options%start%given)
         call read_start(self%options%start%given(i), self%system%structure, self%discretisation, document%group("start", i))
      end do
      call build_starts(self)
   end subroutine read_starts

   !> Reads `&start`. Weights are not allocated after a problem.
   subroutine read_start(self, structure, discretisation, group)
      type(start_term_t), intent(inout) :: self
      type(structure_t), intent(in) :: structure
      type(discretisation_t), intent(in) :: discretisation
      type(properties_t), intent(inout) :: group

      call read_position(structure, group, self%dofs, self%weights)
      call read_tuple(discretisation, group, self%tuple)
      if (allocated(self%tuple)) call check_tuple(discretisation, group, self%tuple)
      call read_numbers(self, group)
      if (.not. (group%given("cos") .or. group%given("sin"))) call group%problem("cos", "give 'cos', 'sin' or both")
      if (group%has_problems() .and. allocated(self%weights)) deallocate (self%weights)
   end subroutine read_start

   !> Reads all `&initial`: the sum of their displacements and velocities.
   subroutine read_initial(self, document)
      type(model_t), intent(inout) :: self                            !! with its structure
      type(document_t), intent(inout), target :: document
      type(properties_t), pointer :: group
      integer, allocatable :: dofs(:)
      real(wp), allocatable :: weights(:)
      real(wp) :: displacement, velocity
      integer :: i

      if (document%count("initial") == 0) return
      associate (config => self%options%integration)
         allocate (config%displacement(self%system%structure%n_dofs), config%velocity(self%system%structure%n_dofs), source=0.0_wp)
         do i = 1, document%count("initial")
            group => document%group("initial", i)
            call read_position(self%system%structure, group, dofs, weights)
            call group%get("displacement", displacement)
            call group%get("velocity", velocity)
            if (.not. (group%given("displacement") .or. group%given("velocity"))) &
               call group%problem("displacement", "give 'displacement', 'velocity' or both")
            if (.not. allocated(weights)) cycle
            config%displacement(dofs) = config%displacement(dofs) + weights*displacement
            config%velocity(dofs) = config%velocity(dofs) + weights*velocity
         end do
      end associate
   end subroutine read_initial

   !> Reads `dof` or `vector`. Weights are not allocated after a problem.
   subroutine read_position(structure, group, dofs, weights)
      type(structure_t), intent(in) :: structure
      type(properties_t), intent(inout) :: group
      integer, allocatable, intent(out) :: dofs(:)
      real(wp), allocatable, intent(out) :: weights(:)
      character(:), allocatable :: name, vector
      type(error_t), allocatable :: error

      call group%get("dof", name, required=.not. group%given("vector"))
      if (group%has_key("vector")) call group%get("vector", vector)
      if (allocated(name) .and. allocated(vector)) call group%problem("vector", "give either 'dof' or 'vector', not both")
      if (allocated(vector)) then
         call structure%vectors%find(vector, dofs, weights, error)
         if (allocated(error)) call group%problem("vector", error%message)
      else if (allocated(name)) then
         call structure%find_dofs(name, dofs, error)
         if (allocated(error)) call group%problem("dof", error%message)
         if (.not. allocated(error)) weights = spread(1.0_wp, 1, size(dofs))
      end if
   end subroutine read_position

   !> Reports a tuple that the set does not have.
   subroutine check_tuple(discretisation, group, tuple)
      type(discretisation_t), intent(in) :: discretisation
      type(properties_t), intent(inout) :: group
      integer, intent(in) :: tuple(:)

      if (discretisation%harmonics%index_of(tuple) == 0) call group%problem("tuple", "tuple "//tuple_text(tuple)//" is not in "// &
         "the set of harmonics; give one entry per tone, and raise the order in &harmonics if it is too low")
   end subroutine check_tuple

   !> Reads a tuple of the set; not allocated after a problem.
   subroutine read_tuple(discretisation, group, tuple)
      type(discretisation_t), intent(in) :: discretisation
      type(properties_t), intent(inout) :: group
      integer, allocatable, intent(out) :: tuple(:)
      integer :: n_tones

      n_tones = discretisation%harmonics%n_tones
      if (n_tones > 0) then
         call group%get("tuple", tuple)
         if (.not. allocated(tuple)) return
         if (size(tuple) == n_tones) return
         call group%problem_as_is(group%location()//": tuple has "//number_of(size(tuple), "value")//", needs "// &
            to_text(n_tones)//": there "//trim(merge("is ", "are", n_tones == 1))//" "//number_of(n_tones, "tone"))
         deallocate (tuple)
      else
         allocate (tuple(0))
         if (group%given("tuple")) call group%problem("tuple", "there are no &tones, to which a tuple refers; leave it out")
      end if
   end subroutine read_tuple

   !> Tuples of all loads and first guesses, (n_tones, any); tuples of a wrong size are reported when they are read.
   function loaded_tuples(document, n_tones) result(tuples)
      type(document_t), intent(inout), target :: document
      integer, intent(in) :: n_tones
      integer, allocatable :: tuples(:, :)
      type(properties_t), pointer :: group
      integer, allocatable :: tuple(:)
      integer :: i, k, n

      allocate (tuples(n_tones, sum([(document%count(trim(groups_with_tuples(k))), k=1, size(groups_with_tuples))])))
      n = 0
      do k = 1, size(groups_with_tuples)
         do i = 1, document%count(trim(groups_with_tuples(k)))
            group => document%group(trim(groups_with_tuples(k)), i)
            if (.not. group%given("tuple")) cycle
            if (allocated(tuple)) deallocate (tuple)
            call group%get("tuple", tuple)
            if (.not. allocated(tuple)) cycle
            if (size(tuple) /= n_tones) cycle
            n = n + 1
            tuples(:, n) = tuple
         end do
      end do
      tuples = tuples(:, :n)
   end function loaded_tuples
end module hb_model_loads
