!> The numbers of a model: their values, and setting them, with all that follows from them.
!> A number belongs to an object of the model, which declares it (hb_numbers): the builder of the structure, a bearing, a
!> load, a law. Setting it is a store in that object. Structure and loads are then built again from numbers, and laws
!> derive what they need; nothing is read.
module hb_model_numbers
   use hb_amplitudes, only: amplitudes_t, new_amplitudes
   use hb_error, only: error_t, fail
   use hb_kinds, only: two_pi, wp
   use hb_law, only: law_box_t
   use hb_memory_estimate, only: check_memory, sizes_of
   use hb_model, only: model_t, symmetry
   use hb_model_basis, only: why_not_odd
   use hb_model_number, only: follower_t, followers_of, has_number, model_number_t, values_at
   use hb_numbers, only: number_t, numbered_t
   use hb_structure, only: structure_t
   use hb_text, only: to_text
   use hb_tones, only: tones_t
   implicit none
   private
   public :: add_linear_numbers, build_beside, build_loads, build_starts, find_model_number, follow_frequencies, movement_t, &
      movement_with_tone, new_movement, set_model_numbers, set_movement, tied_tones, unknown_tone_of

   !> The numbers that move with a value, and what they change.
   type :: movement_t
      type(follower_t), allocatable :: followers(:)                   !! the value itself first
      integer :: first = 1                                            !! of those that are set in the model
      logical :: structure = .false.                                  !! its matrices
      logical :: loads = .false.                                      !! at constant frequencies
      logical :: laws = .false.
      logical :: coordinates = .false.                                !! of laws
      logical :: tones = .false.                                      !! given frequencies
      logical :: is_affine = .false.                                  !! structure and loads are affine functions, a + b p
      logical, private :: has_inertia_loads = .false.
   contains
      procedure :: moves => movement_moves
      procedure :: is_of_laws => movement_is_of_laws
      procedure :: needs_balance => movement_needs_balance
      procedure :: omega_slopes => movement_omega_slopes
   end type movement_t

contains

   !> Finds what moves with a number. Fails if something follows it that cannot move.
   subroutine new_movement(self, model, number, is_tied, error)
      type(movement_t), intent(out) :: self
      type(model_t), intent(inout) :: model                           !! unchanged
      type(model_number_t), intent(in) :: number
      logical, intent(in) :: is_tied                                  !! tones keep their ratios to this one
      type(error_t), allocatable, intent(out) :: error
      type(follower_t), allocatable :: first(:)
      type(model_number_t) :: tone
      real(wp) :: ratio, value
      integer :: i
      logical :: is_found

      first = [follower_t(number)]
      if (is_tied) then
         tone = number
         do i = 1, model%tones%n_tones
            if (i == max(1, number%element(1))) cycle
            tone%element(1) = i
            ratio = model%tones%omega(i)/model%tones%omega(max(1, number%element(1)))
            first = [first, follower_t(tone, factor=ratio, slope=ratio)]
         end do
      end if
      call make_movement(self, model, first)
      if (number%object == has_number%normal_mode) self%first = 2     ! an equation has it
      do i = 1, size(self%followers)
         call find_model_number(model, self%followers(i)%number, value, is_found)
         if (.not. is_found) call fail(error, trim(self%followers(i)%number%name)//" cannot move: it is not a number of this model")
         if (.not. is_found) return
      end do
   end subroutine new_movement

   !> What moves with the frequency of an unknown tone [rad/s], which itself belongs to the balance.
   function movement_with_tone(model, tone) result(self)
      type(model_t), intent(in) :: model
      integer, intent(in) :: tone
      type(movement_t) :: self
      type(model_number_t) :: number
      real(wp) :: unit

      number%object = has_number%tones
      number%key = trim(merge("hertz    ", "frequency", model%tones%is_in_hertz))
      number%element(1) = tone
      unit = model%tones%subharmonic/merge(two_pi, 1.0_wp, model%tones%is_in_hertz)
      call make_movement(self, model, [follower_t(number, factor=unit, slope=unit)])
      self%tones = .false.                                            ! no given one can follow it
      self%first = 2
   end function movement_with_tone

   subroutine make_movement(self, model, first)
      type(movement_t), intent(out) :: self
      type(model_t), intent(in) :: model
      type(follower_t), intent(in) :: first(:)
      integer :: i

      self%followers = first
      if (allocated(model%ties)) self%followers = followers_of(model%ties, first)
      associate (numbers => self%followers%number)
         self%structure = any(is_of_structure(numbers))
         self%loads = any(numbers%object == has_number%load)
         if (self%structure .and. .not. self%loads) self%loads = any(model%given_loads%depends_on_structure())
         self%laws = any(numbers%object == has_number%law)
         self%coordinates = any([(is_weight(model, numbers(i)), i=1, size(numbers))])
         self%tones = any(numbers%object == has_number%tones)
         self%has_inertia_loads = model%has_inertia_loads
         if (size(numbers) == 1) self%is_affine = is_affine_in(model, numbers(1))
      end associate
   end subroutine make_movement

   !> Whether a number is the weight of a coordinate of laws.
   pure logical function is_weight(model, number)
      type(model_t), intent(in) :: model
      type(model_number_t), intent(in) :: number
      integer :: i

      is_weight = .false.
      if (number%object /= has_number%law) return
      do i = 1, size(model%laws)
         if (model%law_groups(i) == number%i) is_weight = is_weight .or. model%laws(i)%law%has_weight(number%number_t)
      end do
   end function is_weight

   !> Whether structure and loads are affine functions of a number, a + b p, where nothing else moves.
   logical function is_affine_in(model, number)
      type(model_t), intent(in) :: model
      type(model_number_t), intent(in) :: number

      is_affine_in = number%object == has_number%load
      if (number%object == has_number%structure) is_affine_in = model%builder%is_affine_in(number%number_t)
   end function is_affine_in

   !> Whether it moves numbers of the model.
   pure logical function movement_moves(self) result(moves)
      class(movement_t), intent(in) :: self

      moves = allocated(self%followers)
      if (moves) moves = size(self%followers) >= self%first
   end function movement_moves

   !> Whether laws alone change.
   pure logical function movement_is_of_laws(self) result(is_of_laws)
      class(movement_t), intent(in) :: self

      is_of_laws = self%laws .and. .not. (self%structure .or. self%loads .or. self%tones)
   end function movement_is_of_laws

   !> Whether a balance that can move to other frequencies has to be created again.
   pure logical function movement_needs_balance(self) result(needs)
      class(movement_t), intent(in) :: self

      needs = self%structure .or. self%loads .or. self%laws .or. (self%tones .and. self%has_inertia_loads)
   end function movement_needs_balance

   !> Derivatives of the given base frequencies [rad/s] by the value, (n_tones).
   pure function movement_omega_slopes(self, tones) result(slopes)
      class(movement_t), intent(in) :: self
      type(tones_t), intent(in) :: tones
      real(wp) :: slopes(tones%n_tones)
      integer :: i

      slopes = 0.0_wp
      do i = self%first, size(self%followers)
         associate (follower => self%followers(i))
            if (follower%number%object /= has_number%tones) cycle
            slopes(max(1, follower%number%element(1))) = follower%slope*merge(two_pi, 1.0_wp, tones%is_in_hertz)/tones%subharmonic
         end associate
      end do
   end function movement_omega_slopes

   !> Sets the numbers of a movement in a model, as `set_model_numbers` does.
   subroutine set_movement(model, movement, value, error, is_alike, laws_only)
      type(model_t), intent(inout) :: model
      type(movement_t), intent(in) :: movement
      real(wp), intent(in) :: value
      type(error_t), allocatable, intent(out) :: error
      logical, intent(out), optional :: is_alike
      logical, intent(in), optional :: laws_only                      !! only numbers of laws
      integer, allocatable :: which(:)
      real(wp) :: values(size(movement%followers))
      logical :: is_set(size(movement%followers))
      integer :: i

      values = values_at(movement%followers, value)
      is_set = [(i >= movement%first, i=1, size(is_set))]
      if (present(laws_only)) then
         if (laws_only) is_set = is_set .and. movement%followers%number%object == has_number%law
      end if
      which = pack([(i, i=1, size(is_set))], is_set)
      call set_model_numbers(model, movement%followers(which)%number, values(which), error, is_alike)
   end subroutine set_movement

   !> Builds structure and loads with other values of some numbers, which the model does not adopt. The structure is empty
   !> if its matrices do not depend on them.
   subroutine build_beside(model, numbers, values, structure, loads, error)
      type(model_t), intent(inout) :: model                           !! unchanged
      type(model_number_t), intent(in) :: numbers(:)                  !! of structures and loads
      real(wp), intent(in) :: values(:)
      type(structure_t), intent(out) :: structure
      type(amplitudes_t), intent(out) :: loads
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: ignored
      type(amplitudes_t) :: slopes
      real(wp) :: before(size(numbers))
      integer :: i
      logical :: has_structure, is_found

      do i = 1, size(numbers)
         call find_model_number(model, numbers(i), before(i), is_found)
         if (numbers(i)%range_problem(values(i)) /= "") call fail(error, trim(numbers(i)%range_problem(values(i))))
         if (allocated(error)) return
      end do
      has_structure = any(is_of_structure(numbers))
      call store_numbers(model, numbers, values, error)
      if (.not. allocated(error) .and. has_structure) call build_structure(model, structure, error)
      if (.not. allocated(error)) then
         if (has_structure) call build_loads(model, structure, loads, slopes, error)
         if (.not. has_structure) call build_loads(model, model%structure, loads, slopes, error)
      end if
      call store_numbers(model, numbers, before, ignored)
   end subroutine build_beside

   !> The numbers of structures and loads among those of a movement, and their values.
   subroutine add_linear_numbers(movement, value, numbers, values)
      type(movement_t), intent(in) :: movement
      real(wp), intent(in) :: value
      type(model_number_t), allocatable, intent(inout) :: numbers(:)  !! any number before, added
      real(wp), allocatable, intent(inout) :: values(:)
      real(wp) :: all_values(size(movement%followers))
      integer :: i

      all_values = values_at(movement%followers, value)
      do i = movement%first, size(movement%followers)
         associate (number => movement%followers(i)%number)
            if (.not. (is_of_structure(number) .or. number%object == has_number%load)) cycle
            numbers = [numbers, number]
            values = [values, all_values(i)]
         end associate
      end do
   end subroutine add_linear_numbers

   !> Unknown tones whose frequencies numbers follow.
   function tied_tones(model) result(which)
      type(model_t), intent(in) :: model
      integer, allocatable :: which(:)
      type(movement_t) :: movement
      integer :: tone

      which = [integer ::]
      do tone = 1, model%tones%n_tones
         if (.not. model%tones%is_unknown(tone)) cycle
         movement = movement_with_tone(model, tone)
         if (movement%moves()) which = [which, tone]
      end do
   end function tied_tones

   !> Sets the numbers that follow frequencies of unknown tones.
   subroutine follow_frequencies(model, omega, error)
      type(model_t), intent(inout) :: model
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones)
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: tones(:)
      integer :: i

      tones = tied_tones(model)
      do i = 1, size(tones)
         call set_movement(model, movement_with_tone(model, tones(i)), omega(tones(i)), error)
         if (allocated(error)) return
      end do
   end subroutine follow_frequencies

   !> Finds the value of a number; not found if the model has no such number, or if it is the frequency of an unknown tone.
   subroutine find_model_number(self, number, value, is_found)
      type(model_t), intent(inout), target :: self                    !! unchanged
      type(model_number_t), intent(in) :: number
      real(wp), intent(out) :: value
      logical, intent(out) :: is_found
      class(numbered_t), pointer :: object

      value = 0.0_wp
      is_found = .false.
      select case (number%object)
      case (has_number%tones)
         associate (tones => self%tones, tone => max(1, number%element(1)))
            if (tone > tones%n_tones .or. (number%key == "hertz" .neqv. tones%is_in_hertz)) return
            if (tones%is_unknown(tone)) return
            is_found = .true.
            value = tones%in_unit(tones%omega(tone)*tones%subharmonic)
         end associate
      case (has_number%normal_mode)
         is_found = self%normal_mode%is_requested .and. (number%key == "energy" .eqv. self%normal_mode%has_energy)
         value = merge(self%normal_mode%energy, self%normal_mode%amplitude, self%normal_mode%has_energy)
      case default
         object => object_of(self, number)
         if (associated(object)) call object%find_number(number%number_t, value, is_found)
      end select
   end subroutine find_model_number

   !> The object that has a number: of several laws of one group the first; null if there is none.
   function object_of(self, number) result(object)
      type(model_t), intent(inout), target :: self
      type(model_number_t), intent(in) :: number
      class(numbered_t), pointer :: object

      object => null()
      associate (i => number%i)
         select case (number%object)
         case (has_number%structure)
            if (allocated(self%builder)) object => self%builder
         case (has_number%bearing)
            if (i <= size(self%bearings)) object => self%bearings(i)
         case (has_number%dynamic_stiffness)
            if (.not. allocated(self%structure%parts)) return
            if (i <= size(self%structure%parts)) object => self%structure%parts(i)
         case (has_number%load)
            if (i <= size(self%given_loads)) object => self%given_loads(i)
         case (has_number%start)
            if (i <= size(self%given_starts)) object => self%given_starts(i)
         case (has_number%law)
            if (any(self%law_groups == i)) object => self%laws(findloc(self%law_groups, i, dim=1))%law
         end select
      end associate
   end function object_of

   !> Sets numbers, and what follows from them. Fails, with an unchanged model, for a number that the model does not have
   !> or that is not in its range, and if it does not fit to the others.
   subroutine set_model_numbers(self, numbers, values, error, is_alike)
      type(model_t), intent(inout) :: self
      type(model_number_t), intent(in) :: numbers(:)
      real(wp), intent(in) :: values(:)
      type(error_t), allocatable, intent(out) :: error
      logical, intent(out), optional :: is_alike                      !! the laws differ from the previous ones in numbers alone
      type(error_t), allocatable :: ignored
      integer, allocatable :: traits(:, :)
      real(wp) :: before(size(numbers))
      integer :: k
      logical :: is_found

      if (present(is_alike)) is_alike = .true.
      do k = 1, size(numbers)
         call find_model_number(self, numbers(k), before(k), is_found)
         if (.not. is_found) then
            call fail(error, trim(numbers(k)%name)//" cannot move: it is not a number of this model")
         else if (numbers(k)%range_problem(values(k)) /= "") then
            call fail(error, trim(numbers(k)%range_problem(values(k))))
         end if
         if (allocated(error)) return
      end do
      traits = traits_of(self%laws)
      call store_numbers(self, numbers, values, error)
      if (.not. allocated(error)) call follow_numbers(self, numbers, error)
      if (allocated(error)) then
         call store_numbers(self, numbers, before, ignored)
         call follow_numbers(self, numbers, ignored)
      else if (present(is_alike)) then
         is_alike = all(traits == traits_of(self%laws))
      end if
   end subroutine set_model_numbers

   !> Stores numbers in their objects, without what follows outside of these. Fails if they do not fit to each other.
   subroutine store_numbers(self, numbers, values, error)
      type(model_t), intent(inout) :: self
      type(model_number_t), intent(in) :: numbers(:)
      real(wp), intent(in) :: values(:)
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: mine(:)
      integer :: j, k
      logical :: are_set, is_stored(size(numbers))

      is_stored = .false.
      do k = 1, size(numbers)
         if (is_stored(k)) cycle
         mine = pack([(j, j=1, size(numbers))], numbers%object == numbers(k)%object .and. numbers%i == numbers(k)%i)
         is_stored(mine) = .true.
         select case (numbers(k)%object)
         case (has_number%tones)
            call store_frequencies(self, numbers(mine), values(mine), are_set)
         case (has_number%normal_mode)
            are_set = abs(values(k)) > 0.0_wp
            if (self%normal_mode%has_energy) self%normal_mode%energy = values(k)
            if (.not. self%normal_mode%has_energy) self%normal_mode%amplitude = values(k)
         case default
            call store_in_objects(self, numbers(k), [(numbers(mine(j))%number_t, j=1, size(mine))], values(mine), are_set)
         end select
         if (are_set) cycle
         call fail(error, trim(numbers(k)%name)//" = "//to_text(values(k))//" is not possible")
         return
      end do
   end subroutine store_numbers

   !> Stores numbers of one object, or of all laws of one group.
   subroutine store_in_objects(self, first, numbers, values, are_set)
      type(model_t), intent(inout), target :: self
      type(model_number_t), intent(in) :: first
      type(number_t), intent(in) :: numbers(:)
      real(wp), intent(in) :: values(:)
      logical, intent(out) :: are_set
      class(numbered_t), pointer :: object
      integer :: i

      if (first%object /= has_number%law) then
         object => object_of(self, first)
         call object%set_numbers(numbers, values, are_set)
         return
      end if
      are_set = .true.
      do i = 1, size(self%laws)
         if (self%law_groups(i) == first%i .and. are_set) call self%laws(i)%law%set_numbers(numbers, values, are_set)
      end do
   end subroutine store_in_objects

   !> Sets frequencies of given tones, in their unit.
   subroutine store_frequencies(self, numbers, values, are_set)
      type(model_t), intent(inout) :: self
      type(model_number_t), intent(in) :: numbers(:)
      real(wp), intent(in) :: values(:)
      logical, intent(out) :: are_set
      integer :: k

      are_set = all(values > 0.0_wp)
      do k = 1, size(numbers)
         self%tones%omega(max(1, numbers(k)%element(1))) = merge(two_pi*values(k), values(k), self%tones%is_in_hertz)/ &
                                                           self%tones%subharmonic
      end do
   end subroutine store_frequencies

   !> Builds what follows from numbers that are stored.
   subroutine follow_numbers(self, numbers, error)
      type(model_t), intent(inout) :: self
      type(model_number_t), intent(in) :: numbers(:)
      type(error_t), allocatable, intent(out) :: error
      type(amplitudes_t) :: loads, slopes
      type(structure_t) :: structure
      logical :: has_other_structure

      has_other_structure = any(is_of_structure(numbers))
      if (has_other_structure) then
         call build_structure(self, structure, error)
         if (allocated(error)) return
         if (.not. has_dofs_of(structure, self%structure)) then
            call fail(error, trim(numbers(1)%name)//": the structure would have other degrees of freedom")
            return
         end if
         self%structure = structure
         call check_memory(sizes_of(self), self%memory_limit, error)  ! zero entries make a structure smaller
         if (allocated(error)) return
      end if
      if (any(numbers%object == has_number%load) .or. (any(numbers%object == has_number%tones) .and. self%has_inertia_loads) .or. &
          (has_other_structure .and. any(self%given_loads%depends_on_structure()))) then
         call build_loads(self, self%structure, loads, slopes, error)
         if (allocated(error)) return
         self%loads = loads
         self%load_slopes = slopes
      end if
      if (any(numbers%object == has_number%start)) call build_starts(self)
      if (self%symmetry == symmetry%odd) call check_odd(self, error)
   end subroutine follow_numbers

   !> Whether the matrices of the structure depend on a number.
   elemental logical function is_of_structure(number)
      type(model_number_t), intent(in) :: number

      is_of_structure = any(number%object == [has_number%structure, has_number%bearing, has_number%dynamic_stiffness])
   end function is_of_structure

   !> Builds the structure of the present numbers.
   subroutine build_structure(self, structure, error)
      type(model_t), intent(inout) :: self                            !! its own structure is unchanged
      type(structure_t), intent(out) :: structure
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      call self%builder%build(structure, error, self%memory_limit)
      if (allocated(error)) return
      do i = 1, size(self%bearings)
         call self%bearings(i)%add_to(structure)
      end do
      if (allocated(self%structure%parts)) structure%parts = self%structure%parts
   end subroutine build_structure

   logical function has_dofs_of(structure, other) result(has)
      type(structure_t), intent(in) :: structure, other

      has = structure%n_dofs == other%n_dofs
      if (has) has = all(structure%labels == other%labels) .and. all(structure%units == other%units)
   end function has_dofs_of

   !> Builds the loads on a structure, and their derivatives by the frequencies. Fails for a load in a tuple of an unknown
   !> tone.
   subroutine build_loads(self, structure, loads, slopes, error)
      type(model_t), intent(in) :: self
      type(structure_t), intent(in) :: structure
      type(amplitudes_t), intent(out) :: loads                        !! [N], not those of the model
      type(amplitudes_t), intent(out) :: slopes                       !! by j.omega [N s]
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: frequencies(self%harmonics%n_harmonics)
      integer :: i

      call new_amplitudes(loads, structure%n_dofs, self%harmonics%n_harmonics)
      slopes = loads
      frequencies = self%harmonics%frequencies(merge(0.0_wp, self%tones%omega, self%tones%is_unknown))
      do i = 1, size(self%given_loads)
         associate (load => self%given_loads(i))
            if (.not. allocated(load%weights)) cycle                  ! a problem that has been reported
            if (unknown_tone_of(self, i) > 0) then
               call fail(error, "load "//to_text(i)//": tone "//to_text(unknown_tone_of(self, i))// &
                         " is unknown, and a load needs a given frequency")
               return
            end if
            call load%add_to(structure, self%harmonics, frequencies, loads, slopes)
         end associate
      end do
   end subroutine build_loads

   !> An unknown tone in the tuple of a load that is not zero; 0: there is none.
   pure integer function unknown_tone_of(self, i) result(tone)
      type(model_t), intent(in) :: self
      integer, intent(in) :: i                                        !! number of the load

      tone = 0
      associate (load => self%given_loads(i))
         if (any(abs(load%weights*load%cosine) > 0.0_wp) .or. any(abs(load%weights*load%sine) > 0.0_wp)) &
            tone = findloc(self%tones%is_unknown .and. load%tuple /= 0, .true., dim=1)
      end associate
   end function unknown_tone_of

   !> Builds the terms that are added to the first guess.
   subroutine build_starts(self)
      type(model_t), intent(inout) :: self
      integer :: i

      call new_amplitudes(self%start, self%structure%n_dofs, self%harmonics%n_harmonics)
      do i = 1, size(self%given_starts)
         if (.not. allocated(self%given_starts(i)%weights)) cycle     ! a problem that has been reported
         call self%given_starts(i)%add_to(self%structure, self%harmonics, spread(0.0_wp, 1, self%harmonics%n_harmonics), self%start)
      end do
   end subroutine build_starts

   !> Fails if the equations of odd motions are no longer odd.
   subroutine check_odd(self, error)
      type(model_t), intent(in) :: self
      type(error_t), allocatable, intent(out) :: error
      character(200) :: reason

      reason = why_not_odd(self%laws, self%harmonics, self%torus, self%loads)
      if (reason /= "") call fail(error, "the symmetry of motions cannot be 'odd': "//trim(reason))
   end subroutine check_odd

   !> What does not change with the numbers of laws, (7, laws).
   pure function traits_of(laws) result(traits)
      type(law_box_t), intent(in) :: laws(:)
      integer :: traits(7, size(laws))
      integer :: i

      do i = 1, size(laws)
         associate (law => laws(i)%law)
            traits(:3, i) = [law%degree, law%n_phases, law%n_states]
            traits(4:, i) = merge(1, 0, [law%needs_velocity, law%is_multiplier, law%is_odd, law%has_potential])
         end associate
      end do
   end function traits_of
end module hb_model_numbers
