!> Amplitudes of a model by harmonic: loads (`&load`) and terms added to the first guess (`&start`).
module hb_model_loads
   use hb_amplitudes, only: amplitudes_t
   use hb_discretisation, only: discretisation_t
   use hb_document, only: document_t
   use hb_error, only: error_t
   use hb_harmonics, only: tuple_text
   use hb_kinds, only: wp
   use hb_load, only: load_kind, load_t
   use hb_model, only: model_t
   use hb_model_numbers, only: build_loads, build_starts, unknown_tone_of
   use hb_number_reader, only: read_numbers
   use hb_properties, only: properties_t
   use hb_system, only: only_in_time, system_t
   use hb_text, only: to_text
   implicit none
   private
   public :: loaded_tuples, read_initial, read_loads, read_starts

contains

   !> Reads all `&load`.
   subroutine read_loads(self, document)
      type(model_t), intent(inout) :: self                            !! with its structure, tones and harmonics
      type(document_t), intent(inout), target :: document
      type(amplitudes_t) :: loads, slopes
      type(error_t), allocatable :: error
      type(properties_t), pointer :: group
      integer :: i

      allocate (self%system%loads(document%count("load")))
      do i = 1, size(self%system%loads)
         group => document%group("load", i)
         call read_load(self%system%loads(i), self%system, self%discretisation, group)
         if (self%system%loads(i)%course%is_given .and. .not. self%options%purpose%may_only_integrate) &
            call group%problem(trim(first_given(group)), only_in_time)
         if (.not. allocated(self%system%loads(i)%weights)) cycle
         if (unknown_tone_of(self%system, i) > 0) call group%problem("tuple", "tone "//to_text(unknown_tone_of(self%system, i))// &
            " of &tones is unknown, and a load needs a given frequency; a first guess is given by &start")
      end do
      self%system%has_inertia_loads = any(self%system%loads%grows())
      call build_loads(self%system, self%discretisation, self%system%structure, loads, slopes, error) ! an error has been reported
      self%discretisation%loads = loads
      self%discretisation%load_slopes = slopes
   end subroutine read_loads

   !> Reads all `&start`.
   subroutine read_starts(self, document)
      type(model_t), intent(inout) :: self
      type(document_t), intent(inout), target :: document
      integer :: i

      allocate (self%options%start%given(document%count("start")))
      do i = 1, size(self%options%start%given)
         self%options%start%given(i)%unit = "m"
         call read_amplitude(self%options%start%given(i), self%system, self%discretisation, document%group("start", i))
      end do
      call build_starts(self)
   end subroutine read_starts

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
            call read_position(self%system, group, dofs, weights)
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

   !> Reads `&load`: an amplitude, and the power of |j.omega| that multiplies it.
   subroutine read_load(self, system, discretisation, group)
      type(load_t), intent(inout) :: self
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(properties_t), intent(inout) :: group
      character(4), parameter :: units(0:4) = [character(4) :: "N", "N s", "N s2", "N s3", "N s4"]

      call group%get("frequency_power", self%power)
      call group%choose("kind", self%kind)
      self%unit = units(max(0, min(self%power, 4)))
      if (self%kind == load_kind%base_acceleration) self%unit = "m/s2"
      if (self%kind == load_kind%base_displacement) self%unit = "m"
      call read_course(self, group)
      call read_amplitude(self, system, discretisation, group)
      if (self%course%is_given .and. .not. self%course%has_own_frequency .and. allocated(self%tuple)) then
         if (size(self%tuple) == system%tones%n_tones) self%course%frequency = dot_product(self%tuple, system%tones%omega)
      end if
   end subroutine read_load

   !> Reads the course of a load over time.
   subroutine read_course(self, group)
      type(load_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group
      integer :: chirp                                                ! linear, exponential

      associate (course => self%course)
         course%is_given = first_given(group) /= ""
         if (.not. course%is_given) return
         course%has_own_frequency = group%given("frequency")
         course%is_chirp = group%given("end_frequency")
         course%power = self%power
         if (group%given("begin")) call group%get("begin", course%begin)
         if (group%given("end")) call group%get("end", course%end)
         if (course%has_own_frequency) call group%get("frequency", course%frequency)
         if (course%has_own_frequency .and. group%given("begin")) course%origin = course%begin
         if (course%is_chirp) call group%get("end_frequency", course%end_frequency)
         call group%choose("chirp", chirp)
         course%is_exponential = chirp == 2
         if (course%end <= max(course%begin, merge(course%origin, -huge(1.0_wp), course%is_chirp))) &
            call group%problem("end", "must be later than the begin of the load")
         if (course%is_chirp .and. .not. (group%given("end") .and. course%has_own_frequency)) then
            call group%problem("end_frequency", "needs 'frequency', from which it changes, and 'end', when it is reached")
         else if (course%is_exponential .and. .not. (course%is_chirp .and. course%frequency > 0.0_wp .and. &
                                                     course%end_frequency > 0.0_wp)) then
            call group%problem("chirp", "'exponential' needs 'frequency' and 'end_frequency' above 0")
         end if
         if (course%has_own_frequency .and. group%given("tuple")) &
            call group%problem("frequency", "give either 'tuple' or 'frequency', not both")
         if (self%kind == load_kind%base_displacement) call group%problem("kind", "a base that jumps or changes its frequency "// &
            "is given by its acceleration: 'base_acceleration'")
      end associate
   end subroutine read_course

   !> The first key of the course of a load that is given; empty: none.
   function first_given(group) result(key)
      type(properties_t), intent(in) :: group
      character(13) :: key
      character(13), parameter :: keys(5) = [character(13) :: "begin", "end", "frequency", "end_frequency", "chirp"]
      integer :: i

      key = ""
      do i = size(keys), 1, -1
         if (group%given(trim(keys(i)))) key = keys(i)
      end do
   end function first_given

   !> Reads `dof` or `vector`. Weights are not allocated after a problem.
   subroutine read_position(system, group, dofs, weights)
      type(system_t), intent(in) :: system
      type(properties_t), intent(inout) :: group
      integer, allocatable, intent(out) :: dofs(:)
      real(wp), allocatable, intent(out) :: weights(:)
      character(:), allocatable :: name, vector
      type(error_t), allocatable :: error

      call group%get("dof", name, required=.not. group%given("vector"))
      call group%get("vector", vector)
      if (allocated(name) .and. allocated(vector)) call group%problem("vector", "give either 'dof' or 'vector', not both")
      if (allocated(vector)) then
         call system%structure%vectors%find(vector, dofs, weights, error)
         if (allocated(error)) call group%problem("vector", error%message)
      else if (allocated(name)) then
         call system%structure%find_dofs(name, dofs, error)
         if (allocated(error)) call group%problem("dof", error%message)
         if (.not. allocated(error)) weights = spread(1.0_wp, 1, size(dofs))
      end if
   end subroutine read_position

   !> Reads `&load` and `&start`: `dof` or `vector`, `tuple`, `cos`, `sin`. Weights are not allocated after a problem.
   subroutine read_amplitude(self, system, discretisation, group)
      type(load_t), intent(inout) :: self
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(properties_t), intent(inout) :: group
      integer, allocatable :: dofs(:)
      real(wp), allocatable :: weights(:)

      call read_position(system, group, dofs, weights)
      if (self%course%has_own_frequency) then
         self%tuple = spread(0, 1, system%tones%n_tones)
      else if (system%tones%n_tones > 0) then
         call group%get("tuple", self%tuple, n=system%tones%n_tones)
      else
         allocate (self%tuple(0))
         if (group%given("tuple")) call group%problem("tuple", "there are no &tones, to which a tuple refers; leave it out")
      end if
      call read_numbers(self, group)
      if (.not. (group%given("cos") .or. group%given("sin"))) then
         call group%problem("cos", "give 'cos', 'sin' or both")
      end if
      if (.not. (allocated(weights) .and. allocated(self%tuple))) return
      if (size(self%tuple) /= system%tones%n_tones) return
      if (discretisation%harmonics%index_of(self%tuple) == 0 .and. .not. self%course%is_given) then
         call group%problem("tuple", "tuple "//tuple_text(self%tuple)//" is not in the set of harmonics; give one entry per "// &
                            "tone, and raise the order in &harmonics if it is too low")
         return
      end if
      call move_alloc(dofs, self%dofs)
      call move_alloc(weights, self%weights)
   end subroutine read_amplitude

   !> Tuples of all loads and first guesses, (n_tones, any); tuples of a wrong size are reported when they are read.
   function loaded_tuples(document, n_tones) result(tuples)
      type(document_t), intent(inout), target :: document
      integer, intent(in) :: n_tones
      integer, allocatable :: tuples(:, :)
      character(5), parameter :: groups(2) = [character(5) :: "load", "start"]
      type(properties_t), pointer :: group
      integer, allocatable :: entries(:), tuple(:)
      integer :: i, k

      allocate (entries(0))
      do k = 1, size(groups)
         do i = 1, document%count(trim(groups(k)))
            group => document%group(trim(groups(k)), i)
            if (.not. group%given("tuple")) cycle
            if (allocated(tuple)) deallocate (tuple)
            call group%get("tuple", tuple)
            if (.not. allocated(tuple)) cycle
            if (size(tuple) == n_tones) entries = [entries, tuple]
         end do
      end do
      tuples = reshape(entries, [n_tones, size(entries)/n_tones])
   end function loaded_tuples
end module hb_model_loads
