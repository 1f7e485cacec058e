!> Reads laws from groups `&law`: all that a law declares (hb_numbers), and where it acts.
module hb_law_reader
   use hb_coupled_terms_reader, only: read_coupled_terms
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_law, only: law_box_t, law_t, placement_t
   use hb_law_catalogue, only: allocate_law
   use hb_law_polynomial_coupled, only: polynomial_coupled_t
   use hb_law_user, only: adopt_memory, load_user_law, user_t
   use hb_location_reader, only: read_dofs, read_further, read_location
   use hb_number_reader, only: group_problems_t, read_numbers
   use hb_operating_system, only: library_path
   use hb_parameter_path, only: check_label
   use hb_properties, only: properties_t
   use hb_structure, only: structure_t
   use hb_text, only: to_text
   implicit none
   private
   public :: read_law

contains

   !> Reads a `&law` group into a law of the kind given by its key `type`. Problems are collected in the group; the
   !> box remains empty if the kind is unknown.
   subroutine read_law(box, group, structure, number)
      type(law_box_t), intent(out) :: box
      type(properties_t), intent(inout), target :: group
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: number                                   !! of the group in the file, for the default label
      type(group_problems_t) :: problems
      character(:), allocatable :: kind_of_law, label

      call group%get("type", kind_of_law)
      if (.not. allocated(kind_of_law)) return
      call allocate_law(box, kind_of_law)
      if (.not. allocated(box%law)) return
      if (.not. group%given("label")) label = kind_of_law//" "//to_text(number)
      call group%get("label", label)
      call check_label(group, label)
      if (.not. allocated(label)) label = kind_of_law//" "//to_text(number)   ! the given value is not a text
      box%law%label = label
      select type (law => box%law)
      type is (user_t); call read_user_law(law, group, structure)
      type is (polynomial_coupled_t); call read_coupled_terms(law, group, structure)
      class default; call read_declared(law, group, structure)
      end select
      problems%group => group
      call box%law%check(problems)
      if (box%law%n_states > 0) call adopt_memory(box)
   end subroutine read_law

   !> Reads a law that declares all that an input gives.
   subroutine read_declared(law, group, structure)
      class(law_t), intent(inout) :: law
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(in) :: structure
      type(placement_t) :: placement

      placement = law%placement()
      if (placement%is_by_dofs) call read_dofs(law, group, structure)    ! first: matrices have a column for each
      call read_numbers(law, group)
      if (.not. placement%is_by_dofs) then
         call read_location(law, group, structure)
         call read_further(law, group, structure)
      end if
      call law%derive()
   end subroutine read_declared

   !> Reads a law of the user, whose library decides about the rest.
   subroutine read_user_law(law, group, structure)
      type(user_t), intent(inout) :: law
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(in) :: structure
      character(:), allocatable :: library, name
      real(wp), allocatable :: parameters(:)
      type(error_t), allocatable :: error

      if (group%given("dofs") .and. .not. group%given("weights")) then
         call read_dofs(law, group, structure)
      else
         call read_location(law, group, structure)
      end if
      allocate (parameters(0))
      call group%get("library", library)
      call group%get("name", name)
      call group%get("parameters", parameters)
      call group%get("odd", law%is_odd)                               ! only the user can know
      if (.not. (allocated(library) .and. allocated(name))) return
      if (len(library) > 0) library = trim(library_path(group%file_name, library))
      call load_user_law(law, library, name, parameters, error)
      if (allocated(error)) call group%problem("library", error%message)
   end subroutine read_user_law
end module hb_law_reader
