!> Reads the elements of a structure, groups such as `&bearing`: where they are, and all that they declare (hb_numbers).
module hb_element_reader
   use hb_document, only: document_t
   use hb_element_catalogue, only: allocate_element, element_groups
   use hb_error, only: error_t
   use hb_model_number, only: has_number
   use hb_number_reader, only: group_problems_t, read_numbers
   use hb_parameter_path, only: check_label
   use hb_properties, only: properties_t
   use hb_structure, only: structure_t
   use hb_structure_element, only: dof_key_length, element_box_t, structure_element_t
   use hb_text, only: string_t
   implicit none
   private
   public :: find_dofs, read_elements

contains

   !> Reads all elements in the order of their table and adds those without problems to the structure; the groups collect the
   !> problems.
   subroutine read_elements(document, structure, elements)
      type(document_t), intent(inout), target :: document
      type(structure_t), intent(inout) :: structure
      type(element_box_t), allocatable, intent(out) :: elements(:)
      type(properties_t), pointer :: group
      integer :: i, k, n

      allocate (elements(sum([(document%count(trim(element_groups(k))), k=1, size(element_groups))])))
      n = 0
      do k = 1, size(element_groups)
         do i = 1, document%count(trim(element_groups(k)))
            n = n + 1
            group => document%group(trim(element_groups(k)), i)
            elements(n)%object = has_number%element + k - 1
            elements(n)%i = i
            call allocate_element(elements(n), trim(element_groups(k)))
            call read_element(elements(n)%element, group, structure)
            if (.not. group%has_problems()) call elements(n)%element%add_to(structure)
         end do
      end do
   end subroutine read_elements

   subroutine read_element(self, group, structure)
      class(structure_element_t), intent(inout) :: self
      type(properties_t), intent(inout), target :: group
      type(structure_t), intent(in) :: structure
      type(group_problems_t) :: problems
      character(:), allocatable :: label
      character(dof_key_length), allocatable :: keys(:)
      integer, allocatable :: dofs(:)
      integer :: i

      if (group%given("label")) call group%get("label", label)        ! used by paths
      call check_label(group, label)
      call self%get_dof_keys(keys)
      allocate (self%n_of_key(size(keys)))
      do i = 1, size(keys)
         call find_dofs(group, trim(keys(i)), structure, self%n_dofs(), dofs)
         if (.not. allocated(dofs)) return
         self%n_of_key(i) = size(dofs)
         if (i > 1) dofs = [self%dofs, dofs]
         call move_alloc(dofs, self%dofs)
      end do
      call read_numbers(self, group)
      problems%group => group
      call self%check(problems)
      if (.not. group%has_problems()) call self%derive()
   end subroutine read_element

   !> Finds degrees of freedom, of any number also those of sets; not allocated on failure.
   subroutine find_dofs(group, key, structure, n, dofs)
      type(properties_t), intent(inout) :: group
      character(*), intent(in) :: key
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: n                                        !! 0: any
      integer, allocatable, intent(out) :: dofs(:)
      type(string_t), allocatable :: names(:)
      type(error_t), allocatable :: error
      integer, allocatable :: found(:), of_name(:)
      integer :: i, k

      if (n > 0) call group%get(key, names, n=n)
      if (n == 0) call group%get(key, names, required=.true.)
      if (.not. allocated(names)) return
      if (n > 0 .and. size(names) /= n) return
      allocate (found(0))
      do i = 1, size(names)
         if (n == 0) then
            call structure%find_dofs(names(i)%value, of_name, error)
         else
            of_name = [0]
            call structure%find_dof(names(i)%value, of_name(1), error)
         end if
         if (allocated(error)) then
            call group%problem(key, error%message)
            of_name = [0]
         else if (any([(any(found == of_name(k)), k=1, size(of_name))])) then
            call group%problem(key, "degree of freedom '"//names(i)%value//"' is named twice")
         end if
         found = [found, of_name]
      end do
      call move_alloc(found, dofs)
   end subroutine find_dofs
end module hb_element_reader
