!> Reads `&dynamic_stiffness`: parts of a structure whose stiffness depends on the frequency.
module hb_frequency_part_input
   use hb_error, only: error_t
   use hb_frequency_part, only: frequency_part_t, kind_of_part
   use hb_input_keys, only: choices_of
   use hb_interpolation, only: is_ascending
   use hb_kinds, only: wp
   use hb_number_reader, only: read_numbers
   use hb_parameter_path, only: check_label
   use hb_properties, only: properties_t
   use hb_structure, only: structure_t
   use hb_text, only: string_t
   implicit none
   private
   public :: read_frequency_part

contains

   !> Reads the part of a group; errors are reported as problems of its keys, an unknown kind as an error.
   subroutine read_frequency_part(part, group, structure, error)
      type(frequency_part_t), intent(out) :: part                     !! incomplete after a problem
      type(properties_t), intent(inout) :: group                      !! &dynamic_stiffness
      type(structure_t), intent(in) :: structure
      type(error_t), allocatable, intent(out) :: error
      character(:), allocatable :: force_name, label, name, type
      type(string_t), allocatable :: force_names(:), names(:)

      call group%get("type", type)
      if (.not. allocated(type)) then
         call group%report_first(error)
         return
      end if
      part%kind = findloc(choices_of("dynamic_stiffness", "type") == type, .true., dim=1)   ! in the order of `kind_of_part`
      if (group%given("label")) call group%get("label", label)        ! used by paths
      call check_label(group, label)
      call read_names(group, name, names, force_name, force_names)
      if (allocated(names)) part%n_weights = size(names)
      if (allocated(force_names)) part%n_force_weights = size(force_names)
      call read_numbers(part, group)
      if (part%kind == kind_of_part%table) call check_table(part, group)
      allocate (part%feels(structure%n_dofs))
      call find_dofs(group, structure, "", name, names, part%weights, part%dofs)
      call find_dofs(group, structure, "force_", force_name, force_names, part%force_weights, part%force_dofs)
      if (is_complete(part)) call part%derive()
   end subroutine read_frequency_part

   !> Whether all numbers are there; if not, that has been reported.
   logical function is_complete(part)
      type(frequency_part_t), intent(in) :: part

      is_complete = allocated(part%dofs)
      if (part%kind == kind_of_part%maxwell) is_complete = is_complete .and. allocated(part%times)
      if (part%kind == kind_of_part%table .and. is_complete) then
         is_complete = allocated(part%storage_values) .and. allocated(part%loss_values)
         if (is_complete) is_complete = size(part%storage_values) == size(part%frequencies) .and. &
                                        size(part%loss_values) == size(part%frequencies)
      end if
      if (is_complete) is_complete = part%has_valid_numbers()
   end function is_complete

   !> Reports problems of a table of storage and loss moduli.
   subroutine check_table(part, group)
      type(frequency_part_t), intent(in) :: part
      type(properties_t), intent(inout) :: group

      if (.not. allocated(part%frequencies)) return
      associate (frequencies => part%frequencies)
         if (size(frequencies) < 2) then
            call group%problem("frequencies", "a table needs two frequencies or more")
         else if (.not. is_ascending(frequencies) .or. frequencies(1) < 0.0_wp) then
            call group%problem("frequencies", "each must be greater than the one before, the first 0 or more")
         else if (allocated(part%loss_values)) then
            if (size(part%loss_values) /= size(frequencies)) return
            if (.not. frequencies(1) > 0.0_wp .and. abs(part%loss_values(1)) > 0.0_wp) &
               call group%problem("loss", "must be 0 at the frequency 0")
         end if
      end associate
   end subroutine check_table

   !> Reads where the coordinate of the part is, and where its force acts: a degree of freedom, or several that have weights.
   subroutine read_names(group, name, names, force_name, force_names)
      type(properties_t), intent(inout) :: group
      character(:), allocatable, intent(out) :: name, force_name
      type(string_t), allocatable, intent(out) :: names(:), force_names(:)

      if (group%given("dofs")) then
         call group%get("dofs", names)
      else
         call group%get("dof", name, required=.true.)
      end if
      if (group%given("force_dofs")) then
         call group%get("force_dofs", force_names)
      else if (group%given("force_dof")) then
         call group%get("force_dof", force_name)
      end if
   end subroutine read_names

   !> Finds one or several degrees of freedom; `dofs` is not allocated if they, or their weights, are incomplete.
   subroutine find_dofs(group, structure, prefix, name, names, weights, dofs)
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(in) :: structure
      character(*), intent(in) :: prefix                              !! of the keys
      character(:), allocatable, intent(in) :: name                   !! of a single one
      type(string_t), allocatable, intent(inout) :: names(:)          !! of several, otherwise not allocated
      real(wp), allocatable, intent(inout) :: weights(:)
      integer, allocatable, intent(out) :: dofs(:)
      character(:), allocatable :: key
      integer, allocatable :: found(:)
      type(error_t), allocatable :: error
      integer :: i

      key = prefix//"dofs"
      if (group%given(prefix//"dof")) then
         if (allocated(names)) call group%problem(key, "give either '"//prefix//"dof' or '"//key//"', not both")
         key = prefix//"dof"
         if (.not. allocated(name)) return
         names = [string_t(name)]
         weights = [1.0_wp]
      end if
      if (.not. (allocated(names) .and. allocated(weights))) return
      if (size(weights) /= size(names)) return
      allocate (found(size(names)), source=0)
      do i = 1, size(names)
         call structure%find_dof(names(i)%value, found(i), error)
         if (allocated(error)) then
            call group%problem(key, error%message)
            return
         else if (any(found(:i - 1) == found(i))) then
            call group%problem(key, "degree of freedom '"//names(i)%value//"' is named twice")
            return
         end if
      end do
      if (.not. any(abs(weights) > 0.0_wp)) call group%problem(prefix//"weights", "at least one weight must not be zero")
      call move_alloc(found, dofs)
   end subroutine find_dofs
end module hb_frequency_part_input
