!> The numbers of a model: their values, and setting them, with all that follows from them.
!> A number belongs to an object of the model, which declares it (hb_numbers): the builder of the structure, an element, a
!> load, a law. Setting it is a store in that object. Structure and loads are then built again from numbers, and laws
!> derive what they need; nothing is read.
module hb_model_numbers
   use hb_discretisation, only: discretisation_t, symmetry
   use hb_error, only: error_t, fail
   use hb_kinds, only: two_pi, wp
   use hb_law, only: law_box_t
   use hb_memory_estimate, only: check_memory, sizes_of
   use hb_model, only: model_t
   use hb_model_basis, only: why_not_odd
   use hb_model_number, only: has_number, model_number_t
   use hb_numbers, only: number_t, numbered_t
   use hb_spectrum, only: new_spectrum, spectrum_t
   use hb_structure, only: structure_t
   use hb_structure_load, only: is_only_in_time
   use hb_system, only: system_t
   use hb_text, only: to_text
   implicit none
   private
   public :: build_beside, build_starts, find_model_number, set_model_numbers, unknown_tone_of, update_loads

contains

   !> Builds structure and loads with other values of some numbers, which the model does not adopt. The structure is empty
   !> if its matrices do not depend on them.
   subroutine build_beside(model, numbers, values, structure, loads, error)
      type(model_t), intent(inout) :: model                           !! unchanged
      type(model_number_t), intent(in) :: numbers(:)                  !! of structures and loads
      real(wp), intent(in) :: values(:)
      type(structure_t), intent(out) :: structure
      type(spectrum_t), intent(out) :: loads
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: ignored
      type(spectrum_t) :: slopes
      real(wp) :: before(size(numbers))
      integer :: i
      logical :: has_structure, is_found

      do i = 1, size(numbers)
         call find_model_number(model, numbers(i), before(i), is_found)
         if (numbers(i)%range_problem(values(i)) /= "") call fail(error, trim(numbers(i)%range_problem(values(i))))
         if (allocated(error)) return
      end do
      has_structure = any(numbers%is_of_structure())
      call store_numbers(model, numbers, values, error)
      if (.not. allocated(error) .and. has_structure) call build_structure(model, structure, error)
      if (.not. allocated(error)) then
         if (has_structure) call build_loads(model%system, structure, loads, slopes, error)
         if (.not. has_structure) call build_loads(model%system, model%system%structure, loads, slopes, error)
      end if
      call store_numbers(model, numbers, before, ignored)
   end subroutine build_beside

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
         associate (tones => self%system%tones, tone => max(1, number%element(1)))
            if (tone > tones%n_tones .or. (number%key == "hertz" .neqv. tones%is_in_hertz)) return
            if (tones%is_unknown(tone)) return
            is_found = .true.
            value = tones%in_unit(tones%omega(tone)*tones%subharmonic)
         end associate
      case (has_number%normal_mode)
         is_found = self%system%normal_mode%is_requested .and. (number%key == "energy" .eqv. self%system%normal_mode%has_energy)
         value = merge(self%system%normal_mode%energy, self%system%normal_mode%amplitude, self%system%normal_mode%has_energy)
      case default
         object => object_of(self, number)
         if (associated(object)) call object%find_number(number%number_t, value, is_found)
      end select
   end subroutine find_model_number

   !> The object that has a number, null if there is none.
   function object_of(self, number) result(object)
      type(model_t), intent(inout), target :: self
      type(model_number_t), intent(in) :: number
      class(numbered_t), pointer :: object

      object => null()
      if (number%object /= has_number%start) then
         object => self%system%object_of(number)
      else if (number%i <= size(self%options%start%given)) then
         object => self%options%start%given(number%i)
      end if
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
      allocate (traits, source=traits_of(self%system%laws))
      call store_numbers(self, numbers, values, error)
      if (.not. allocated(error)) call follow_numbers(self, numbers, error)
      if (allocated(error)) then
         call store_numbers(self, numbers, before, ignored)
         call follow_numbers(self, numbers, ignored)
      else if (present(is_alike)) then
         is_alike = all(traits == traits_of(self%system%laws))
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
            if (self%system%normal_mode%has_energy) self%system%normal_mode%energy = values(k)
            if (.not. self%system%normal_mode%has_energy) self%system%normal_mode%amplitude = values(k)
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
      do i = 1, size(self%system%laws)
         if (self%system%law_groups(i) == first%i .and. are_set) call self%system%laws(i)%law%set_numbers(numbers, values, are_set)
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
         self%system%tones%omega(max(1, numbers(k)%element(1))) = &
            merge(two_pi*values(k), values(k), self%system%tones%is_in_hertz)/ self%system%tones%subharmonic
      end do
   end subroutine store_frequencies

   !> Builds what follows from numbers that are stored.
   subroutine follow_numbers(self, numbers, error)
      type(model_t), intent(inout) :: self
      type(model_number_t), intent(in) :: numbers(:)
      type(error_t), allocatable, intent(out) :: error
      type(structure_t) :: structure
      logical :: has_other_structure

      has_other_structure = any(numbers%is_of_structure())
      if (has_other_structure) then
         call build_structure(self, structure, error)
         if (allocated(error)) return
         if (.not. has_dofs_of(structure, self%system%structure)) then
            call fail(error, trim(numbers(1)%name)//": the structure would have other degrees of freedom")
            return
         end if
         self%system%structure = structure
         ! zero entries make a structure smaller
         call check_memory(sizes_of(self%system, self%discretisation, self%options), self%options%memory_limit, error)
         if (allocated(error)) return
      end if
      if (any(numbers%is_of_loads()) .or. (any(numbers%object == has_number%tones) .and. self%system%has_inertia_loads) .or. &
          (has_other_structure .and. self%system%has_loads_by_structure())) then
         call update_loads(self%system, error)
         if (allocated(error)) return
      end if
      if (any(numbers%object == has_number%start)) call build_starts(self)
      if (self%discretisation%symmetry == symmetry%odd) call check_odd(self%system, self%discretisation, error)
   end subroutine follow_numbers

   !> Builds the structure of the present numbers.
   subroutine build_structure(self, structure, error)
      type(model_t), intent(inout) :: self                            !! its own structure is unchanged
      type(structure_t), intent(out) :: structure
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      call self%system%builder%build(structure, error, self%options%memory_limit)
      if (allocated(error)) return
      do i = 1, size(self%system%elements)
         call self%system%elements(i)%element%add_to(structure)
      end do
      if (.not. allocated(self%system%structure%parts)) return
      associate (parts => self%system%structure%parts)
         if (allocated(structure%parts)) then                         ! elements have made theirs
            structure%parts = [pack(parts, .not. parts%is_of_element), structure%parts]
         else
            structure%parts = parts
         end if
      end associate
   end subroutine build_structure

   logical function has_dofs_of(structure, other) result(has)
      type(structure_t), intent(in) :: structure, other

      has = structure%n_dofs == other%n_dofs
      if (has) has = all(structure%labels == other%labels) .and. all(structure%units == other%units)
   end function has_dofs_of

   !> Builds the loads on a structure, and their derivatives by the frequencies. Fails for a load in a tuple of an unknown
   !> tone.
   subroutine build_loads(system, structure, loads, slopes, error)
      type(system_t), intent(in) :: system
      type(structure_t), intent(in) :: structure
      type(spectrum_t), intent(out) :: loads                          !! [N], not those of the system
      type(spectrum_t), intent(out) :: slopes                         !! by j.omega [N s]
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: omega(system%tones%n_tones)
      integer :: i

      call new_spectrum(loads, structure%n_dofs, system%tones%n_tones)
      slopes = loads
      omega = merge(0.0_wp, system%tones%omega, system%tones%is_unknown)
      do i = 1, size(system%loads)
         if (.not. allocated(system%loads(i)%load%weights)) cycle     ! a problem that has been reported
         if (is_only_in_time(system%loads(i))) cycle
         if (unknown_tone_of(system, i) > 0) then
            call fail(error, "load "//to_text(i)//": tone "//to_text(unknown_tone_of(system, i))// &
                      " is unknown, and a load needs a given frequency")
            return
         end if
         call system%loads(i)%load%add_to(structure, omega, loads, slopes)
      end do
   end subroutine build_loads

   !> Builds the loads of a system.
   subroutine update_loads(system, error)
      type(system_t), intent(inout) :: system
      type(error_t), allocatable, intent(out) :: error
      type(spectrum_t) :: loads, slopes

      call build_loads(system, system%structure, loads, slopes, error)
      system%load_spectrum = loads
      system%load_slopes = slopes
   end subroutine update_loads

   !> An unknown tone in the tuple of a load that is not zero; 0: there is none.
   pure integer function unknown_tone_of(system, i) result(tone)
      type(system_t), intent(in) :: system
      integer, intent(in) :: i                                        !! number of the load

      tone = 0
      if (.not. system%loads(i)%load%is_zero()) &
         tone = findloc(system%tones%is_unknown .and. system%loads(i)%load%tuple /= 0, .true., dim=1)
   end function unknown_tone_of

   !> Builds the terms that are added to the first guess.
   subroutine build_starts(self)
      type(model_t), intent(inout) :: self
      integer :: i

      associate (start => self%options%start)
         call new_spectrum(start%spectrum, self%system%structure%n_dofs, self%system%tones%n_tones)
         do i = 1, size(start%given)
            if (allocated(start%given(i)%weights)) call start%given(i)%add_to(start%spectrum) ! else a problem has been reported
         end do
      end associate
   end subroutine build_starts

   !> Fails if the equations of odd motions are no longer odd.
   subroutine check_odd(system, discretisation, error)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(error_t), allocatable, intent(out) :: error
      character(200) :: reason

      reason = why_not_odd(system%laws, discretisation%harmonics, discretisation%torus, system%loads_in(discretisation%harmonics))
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
