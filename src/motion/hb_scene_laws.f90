!> The laws of a scene: all groups `&law`, or those that take other numbers, and which laws exclude each other.
module hb_scene_laws
   use hb_document, only: document_t
   use hb_error, only: error_t
   use hb_law, only: law_box_t, law_t
   use hb_law_catalogue, only: read_law
   use hb_properties, only: properties_t
   use hb_scene, only: scene_t
   use hb_text, only: to_text
   implicit none
   private
   public :: read_laws, update_laws

contains

   !> Reads all `&law`; `error` is a kind that is not known.
   subroutine read_laws(self, document, error)
      type(scene_t), intent(inout) :: self                            !! with its structure and its tones
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error
      type(properties_t), pointer :: group
      integer :: i

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
   end subroutine read_laws

   !> Reads the laws anew in whose groups values have changed, if they differ from before in numbers alone; else `are_read` is
   !> false, and the scene of no use.
   subroutine update_laws(self, document, are_read)
      type(scene_t), intent(inout) :: self
      type(document_t), intent(inout), target :: document
      logical, intent(out) :: are_read
      type(properties_t), pointer :: group
      type(law_box_t) :: box
      integer :: i

      are_read = .false.
      do i = 1, document%count("law")
         group => document%changed_group("law", i)
         if (.not. associated(group)) cycle
         call read_law(box, group, self%structure, i)
         if (.not. allocated(box%law)) return
         if (.not. is_alike(box%law, self%laws(i)%law)) return
         call move_alloc(box%law, self%laws(i)%law)
      end do
      are_read = .true.
   end subroutine update_laws

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

   !> Fails when the kind of a law is not known, and with that alone: none of the other keys of its group can be judged.
   subroutine check_kind(box, group, error)
      type(law_box_t), intent(in) :: box
      type(properties_t), intent(in) :: group
      type(error_t), allocatable, intent(out) :: error

      if (allocated(box%law)) return
      call group%finish(error)
      error%message = error%message(:index(error%message//new_line("a"), new_line("a")) - 1)
   end subroutine check_kind

   !> Refuses the last law where it and one before are rigid and share a degree of freedom: each would take the whole
   !> reaction.
   subroutine check_rigid_laws(laws, group)
      type(law_box_t), intent(in) :: laws(:)
      type(properties_t), intent(inout) :: group                           !! of the last law
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
end module hb_scene_laws
