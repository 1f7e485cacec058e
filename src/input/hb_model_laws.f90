!> The laws of a model: all groups `&law`, and laws that exclude each other.
module hb_model_laws
   use hb_document, only: document_t
   use hb_error, only: error_t
   use hb_law, only: hold_t, law_box_t
   use hb_law_reader, only: read_law
   use hb_model, only: model_t
   use hb_name_table, only: find_first_equal
   use hb_properties, only: properties_t
   use hb_structure, only: structure_t
   use hb_system, only: shared_walls
   use hb_text, only: number_of, quote, shown, to_text
   implicit none
   private
   public :: read_laws

contains

   !> Reads all `&law`, one law for each location of a group; `error` is an unknown kind.
   subroutine read_laws(self, document, error)
      type(model_t), intent(inout) :: self                            !! with its structure and its tones
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error
      type(properties_t), pointer :: group
      type(law_box_t), allocatable :: boxes(:)                        ! by group
      integer :: first, i, last

      allocate (boxes(document%count("law")))
      do i = 1, size(boxes)
         group => document%group("law", i)
         call read_law(boxes(i), group, self%system%structure, i)
         if (.not. allocated(boxes(i)%law)) then
            call group%report_first(error)
            return
         end if
         if (boxes(i)%law%n_phases > self%system%tones%n_tones) then
            call group%problem(trim(merge("tuple", "tone ", allocated(boxes(i)%law%modulation))), "there "// &
               trim(merge("is ", "are", self%system%tones%n_tones == 1))//" only "//number_of(self%system%tones%n_tones, "tone"))
         end if
      end do
      call check_labels(boxes, document)
      associate (n_laws => sum([(n_positions(boxes(i)), i=1, size(boxes))]))
         allocate (self%system%laws(n_laws), self%system%law_groups(n_laws))
      end associate
      last = 0
      do i = 1, size(boxes)
         group => document%group("law", i)
         first = last + 1
         last = last + n_positions(boxes(i))
         self%system%law_groups(first:last) = i
         call add_laws(boxes(i), self%system%structure, self%system%laws(first:last))
         call check_rigid_laws(self%system%laws(:first - 1), self%system%laws(first:last), group, &
                               self%options%purpose%may_only_integrate)
      end do
   end subroutine read_laws

   !> Rejects labels that previous groups have: paths and messages would not name one law.
   subroutine check_labels(boxes, document)
      type(law_box_t), intent(in) :: boxes(:)                         !! by group
      type(document_t), intent(inout), target :: document
      character(longest_label(boxes)) :: labels(size(boxes))
      type(properties_t), pointer :: group
      integer :: first(size(boxes)), i

      do i = 1, size(boxes)
         labels(i) = boxes(i)%law%label
      end do
      call find_first_equal(labels, first)
      do i = 1, size(boxes)
         if (first(i) == i) cycle
         group => document%group("law", i)
         call group%problem("label", quote(shown(trim(labels(i))))//" is the label of &law("//to_text(first(i))// &
                            "), too; labels name one each")
      end do
   end subroutine check_labels

   pure integer function longest_label(boxes) result(longest)
      type(law_box_t), intent(in) :: boxes(:)
      integer :: i

      longest = 0
      do i = 1, size(boxes)
         longest = max(longest, len(boxes(i)%law%label))
      end do
   end function longest_label

   !> Number of laws for which one group stands.
   pure integer function n_positions(box)
      type(law_box_t), intent(in) :: box

      n_positions = 1
      if (allocated(box%law%positions)) n_positions = size(box%law%positions, 2)
   end function n_positions

   !> Creates one law for each location of a group, labelled by its first degree of freedom there.
   subroutine add_laws(box, structure, laws)
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
   end subroutine add_laws

   !> Rejects rigid laws that share a degree of freedom with a previous one: each would take the whole reaction. Time integration
   !> knows the impacts of a body on several walls.
   subroutine check_rigid_laws(before, laws, group, may_only_integrate)
      type(law_box_t), intent(in) :: before(:)
      type(law_box_t), intent(in) :: laws(:)                               !! of one group, which share none
      type(properties_t), intent(inout) :: group
      logical, intent(in) :: may_only_integrate
      integer :: i, k, n

      do n = 1, size(laws)
         if (.not. is_placed_and_rigid(laws(n))) return
         associate (law => laws(n)%law)
            do i = 1, size(before)
               if (.not. is_placed_and_rigid(before(i))) cycle
               if (.not. any([(before(i)%law%dofs == law%dofs(k), k=1, size(law%dofs))])) cycle
               if (is_wall(before(i)) .and. is_wall(laws(n))) then
                  if (may_only_integrate) cycle
                  call group%problem("type", "laws '"//before(i)%law%label//"' and '"//law%label//"' "//shared_walls)
               else
                  call group%problem("type", "laws '"//before(i)%law%label//"' and '"//law%label//"' are both rigid and share "// &
                                     "a degree of freedom; use an elastic law for one of them")
               end if
            end do
         end associate
      end do
   end subroutine check_rigid_laws

   !> Whether a rigid law is a wall that can be integrated in time.
   logical function is_wall(box)
      type(law_box_t), intent(in) :: box
      type(hold_t) :: hold

      hold = box%law%hold()
      is_wall = hold%is_wall .and. .not. allocated(hold%failure)
   end function is_wall

   logical function is_placed_and_rigid(box)
      type(law_box_t), intent(in) :: box

      is_placed_and_rigid = box%law%is_multiplier .and. allocated(box%law%dofs)   ! without a location: already reported
   end function is_placed_and_rigid
end module hb_model_laws
