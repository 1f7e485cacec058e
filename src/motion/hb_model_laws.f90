!> The laws of a model: all groups `&law`, or those that have changed, single numbers, and laws that exclude each other.
module hb_model_laws
   use hb_document, only: document_t, parameter_t
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_law, only: law_box_t, law_t
   use hb_law_reader, only: read_law
   use hb_model, only: model_t
   use hb_numbers, only: number_t
   use hb_properties, only: properties_t
   use hb_structure, only: structure_t
   use hb_text, only: number_of
   implicit none
   private
   public :: find_law_number, read_laws, set_law_number, update_laws

contains

   !> Reads all `&law`, one law for each location of a group; `error` is an unknown kind.
   subroutine read_laws(self, document, error)
      type(model_t), intent(inout) :: self                            !! with its structure and its tones
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error
      type(properties_t), pointer :: group
      type(law_box_t), allocatable :: boxes(:)                        ! by group
      integer :: first, i, last

      allocate (boxes(document%count("law")), self%law_groups(0))
      do i = 1, size(boxes)
         group => document%group("law", i)
         call read_law(boxes(i), group, self%structure, i)
         if (.not. allocated(boxes(i)%law)) then
            call group%report_first(error)
            return
         end if
         self%law_groups = [self%law_groups, spread(i, 1, n_positions(boxes(i)))]
         if (boxes(i)%law%n_phases > self%tones%n_tones) then
            call group%problem(trim(merge("tuple", "tone ", allocated(boxes(i)%law%modulation))), "there "// &
               trim(merge("is ", "are", self%tones%n_tones == 1))//" only "//number_of(self%tones%n_tones, "tone"))
         end if
      end do
      allocate (self%laws(size(self%law_groups)))
      last = 0
      do i = 1, size(boxes)
         group => document%group("law", i)
         first = last + 1
         last = last + n_positions(boxes(i))
         call put_laws(boxes(i), self%structure, self%laws(first:last))
         call check_rigid_laws(self%laws(:first - 1), self%laws(first:last), group)
      end do
   end subroutine read_laws

   !> Reads again the laws of the groups whose values have changed, if only numbers differ; otherwise `are_read` is
   !> false, and the model is unusable.
   subroutine update_laws(self, document, are_read)
      type(model_t), intent(inout) :: self
      type(document_t), intent(inout), target :: document
      logical, intent(out) :: are_read
      type(properties_t), pointer :: group
      type(law_box_t) :: box
      type(law_box_t), allocatable :: laws(:)
      integer :: i, k, n

      are_read = .false.
      do i = 1, document%count("law")
         group => document%changed_group("law", i)
         if (.not. associated(group)) cycle
         call read_law(box, group, self%structure, i)
         if (.not. allocated(box%law)) return
         allocate (laws(n_positions(box)))
         call put_laws(box, self%structure, laws)
         if (size(laws) /= count(self%law_groups == i)) return
         n = findloc(self%law_groups, i, dim=1) - 1
         do k = 1, size(laws)
            if (.not. is_alike(laws(k)%law, self%laws(n + k)%law)) return
            call move_alloc(laws(k)%law, self%laws(n + k)%law)
         end do
         deallocate (laws)
      end do
      are_read = .true.
   end subroutine update_laws

   !> The number of laws that a parameter of a document is.
   pure subroutine find_law_number(document, parameter, i_law, number)
      type(document_t), intent(in) :: document
      type(parameter_t), intent(in) :: parameter
      integer, intent(out) :: i_law                                   !! number of its &law; 0 if it belongs to another group
      type(number_t), intent(out) :: number

      associate (group => document%groups%holders(parameter%i_group)%group)
         i_law = merge(group%number, 0, group%name == "law")
      end associate
      number = number_t(parameter%key, parameter%element)
   end subroutine find_law_number

   !> Sets a number of laws to its value in the document. `is_set` is false if it is not a number that they declare, is
   !> not in its range, or does not fit to the others, and if the laws differ in more than numbers then; their group must
   !> then be read again.
   subroutine set_law_number(self, document, parameter, is_set)
      type(model_t), intent(inout) :: self
      type(document_t), intent(inout) :: document
      type(parameter_t), intent(in) :: parameter
      logical, intent(out) :: is_set
      type(number_t) :: number
      real(wp) :: value
      integer :: before(7), i, i_law

      call find_law_number(document, parameter, i_law, number)
      is_set = i_law > 0
      if (is_set) call document%number_at(parameter, value, is_set)
      if (.not. is_set) return
      associate (group => document%groups%holders(parameter%i_group)%group)
         is_set = group%accepts(trim(parameter%key), value) .and. any(self%law_groups == i_law)
         do i = 1, size(self%laws)
            if (self%law_groups(i) /= i_law .or. .not. is_set) cycle
            associate (law => self%laws(i)%law)
               before = traits_of(law)
               call law%set_number(number, value, is_set)
               if (is_set) is_set = all(traits_of(law) == before)
            end associate
         end do
         if (is_set) call group%note_number(trim(parameter%key), parameter%element, value)
      end associate
   end subroutine set_law_number

   !> What does not change with the numbers of a law.
   pure function traits_of(law) result(traits)
      class(law_t), intent(in) :: law
      integer :: traits(7)

      traits(:3) = [law%degree, law%n_phases, law%n_states]
      traits(4:) = merge(1, 0, [law%needs_velocity, law%is_multiplier, law%is_odd, law%has_potential])
   end function traits_of

   !> Number of laws for which one group stands.
   pure integer function n_positions(box)
      type(law_box_t), intent(in) :: box

      n_positions = 1
      if (allocated(box%law%positions)) n_positions = size(box%law%positions, 2)
   end function n_positions

   !> Creates one law for each location of a group, labelled by its first degree of freedom there.
   subroutine put_laws(box, structure, laws)
      type(law_box_t), intent(inout) :: box                           !! empty afterwards, if there is one location
      type(structure_t), intent(in) :: structure
      type(law_box_t), intent(inout) :: laws(:)                       !! (n_places), empty
      integer :: i

      if (.not. allocated(box%law%positions)) then
         call move_alloc(box%law, laws(1)%law)
         return
      end if
      do i = 1, size(laws)
         allocate (laws(i)%law, source=box%law)
         laws(i)%law%dofs = box%law%positions(:, i)
         laws(i)%law%label = box%law%label//" "//trim(structure%labels(box%law%positions(1, i)))
         deallocate (laws(i)%law%positions)
      end do
   end subroutine put_laws

   !> Whether two laws differ in numbers alone.
   logical function is_alike(law, other)
      class(law_t), intent(in) :: law, other

      is_alike = .false.
      if (.not. (same_type_as(law, other) .and. allocated(law%dofs) .and. allocated(law%shape))) return
      if (size(law%dofs) /= size(other%dofs) .or. any(shape(law%shape) /= shape(other%shape))) return
      is_alike = all(law%dofs == other%dofs) .and. law%label == other%label .and. law%degree == other%degree .and. &
                 (law%needs_velocity .eqv. other%needs_velocity) .and. (law%is_multiplier .eqv. other%is_multiplier) .and. &
                 law%n_phases == other%n_phases .and. law%n_states == other%n_states
   end function is_alike

   !> Rejects rigid laws that share a degree of freedom with a previous one: each would take the whole reaction.
   subroutine check_rigid_laws(before, laws, group)
      type(law_box_t), intent(in) :: before(:)
      type(law_box_t), intent(in) :: laws(:)                               !! of one group, which share none
      type(properties_t), intent(inout) :: group
      integer :: i, k, n

      do n = 1, size(laws)
         if (.not. is_placed_and_rigid(laws(n))) return
         associate (law => laws(n)%law)
            do i = 1, size(before)
               if (.not. is_placed_and_rigid(before(i))) cycle
               if (.not. any([(before(i)%law%dofs == law%dofs(k), k=1, size(law%dofs))])) cycle
               call group%problem("type", "laws '"//before(i)%law%label//"' and '"//law%label//"' are both rigid and share a "// &
                                  "degree of freedom; use one two-sided wall, or an elastic stop for one of them")
            end do
         end associate
      end do
   end subroutine check_rigid_laws

   logical function is_placed_and_rigid(box)
      type(law_box_t), intent(in) :: box

      is_placed_and_rigid = box%law%is_multiplier .and. allocated(box%law%dofs)   ! without a location: already reported
   end function is_placed_and_rigid
end module hb_model_laws
