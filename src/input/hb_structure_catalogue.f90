!> Reads `&structure`: the known builders of structures, one case each. Their names are the types of the group in the
!> table of input keys.
module hb_structure_catalogue
   use hb_beam, only: beam_t
   use hb_chain, only: chain_t, n_springs
   use hb_error, only: annotate, error_t
   use hb_fe_model, only: fe_model_builder_t, fe_model_source_t
   use hb_jeffcott, only: jeffcott_t
   use hb_kinds, only: wp
   use hb_matrices, only: matrices_t, names_of_matrices, new_matrices
   use hb_modal_beam, only: modal_beam_t
   use hb_number_reader, only: read_numbers
   use hb_operating_system, only: beside
   use hb_properties, only: properties_t
   use hb_rotor_stator, only: rotor_stator_t
   use hb_structure, only: structure_t
   use hb_structure_builder, only: structure_builder_t
   use hb_text, only: to_text
   implicit none
   private
   public :: read_structure

contains

   !> Reads the structure from its group `&structure`, whose key `type` names the builder. Fails before its matrices
   !> are allocated if they do not fit into `memory_limit`.
   subroutine read_structure(group, structure, error, memory_limit, fe_models, builder)
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(out) :: structure
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: memory_limit                  !! bytes
      class(fe_model_source_t), intent(in), optional :: fe_models     !! for structures of type `model`
      class(structure_builder_t), allocatable, intent(out), optional :: builder
      class(structure_builder_t), allocatable :: new
      character(:), allocatable :: name

      call group%get("type", name)
      if (.not. allocated(name)) then
         call group%report_first(error)
         return
      end if
      select case (name)
      case ("beam")
         call read_beam(new, group)
      case ("chain")
         call read_chain(new, group)
      case ("jeffcott")
         call read_jeffcott(new, group)
      case ("matrices")
         call read_matrices(new, group)
      case ("modal_beam")
         call read_modal_beam(new, group)
      case ("model")
         call read_fe_model(new, group, fe_models)
      case ("rotor_stator")
         call read_rotor_stator(new, group)
      end select
      call group%finish(error)
      if (allocated(error)) return
      call new%build(structure, error, memory_limit)
      call annotate(error, group%location())
      if (present(builder)) call move_alloc(new, builder)
   end subroutine read_structure

   !> Reads a beam.
   subroutine read_beam(self, group)
      class(structure_builder_t), allocatable, intent(out) :: self
      type(properties_t), intent(inout) :: group
      type(beam_t) :: beam
      character(:), allocatable :: left_support, right_support

      call read_numbers(beam, group)
      call group%get("n_elements", beam%n_elements)
      call group%get("left_support", left_support)
      call group%get("right_support", right_support)
      beam%ends(1) = left_support
      beam%ends(2) = right_support
      allocate (self, source=beam)
   end subroutine read_beam

   !> Reads a beam by its modes.
   subroutine read_modal_beam(self, group)
      class(structure_builder_t), allocatable, intent(out) :: self
      type(properties_t), intent(inout) :: group
      type(modal_beam_t) :: beam

      call read_numbers(beam, group)
      call group%get("n_modes", beam%n_modes)
      allocate (self, source=beam)
   end subroutine read_modal_beam

   !> Reads a chain.
   subroutine read_chain(self, group)
      class(structure_builder_t), allocatable, intent(out) :: self
      type(properties_t), intent(inout) :: group
      type(chain_t) :: chain

      call group%get("n_masses", chain%n_masses)
      call group%get("ends", chain%ends)
      call read_numbers(chain, group)
      if (chain%n_masses > 0) then
         call check_number(group, "mass", chain%mass, chain%n_masses)
         call check_number(group, "coupling_stiffness", chain%coupling_stiffness, n_springs(chain%n_masses, chain%ends))
         call check_number(group, "ground_stiffness", chain%ground_stiffness, chain%n_masses)
      end if
      allocate (self, source=chain)
   end subroutine read_chain

   !> Reports a number of values other than 1 or `n` as a problem of the key.
   subroutine check_number(group, key, values, n)
      type(properties_t), intent(inout) :: group
      character(*), intent(in) :: key
      real(wp), allocatable, intent(in) :: values(:)
      integer, intent(in) :: n
      character(:), allocatable :: wanted

      if (.not. allocated(values)) return                             ! already a problem of the group
      if (any(size(values) == [1, n])) return
      wanted = "1 value"
      if (n /= 1) wanted = "1 or "//to_text(n)//" values"
      call group%problem(key, "needs "//wanted//", there are "//to_text(size(values)))
   end subroutine check_number

   !> Reads a rotor.
   subroutine read_jeffcott(self, group)
      class(structure_builder_t), allocatable, intent(out) :: self
      type(properties_t), intent(inout) :: group
      type(jeffcott_t) :: rotor

      call read_numbers(rotor, group)
      if (group%given("speed") .and. .not. (group%given("rotating_damping") .or. group%given("polar_inertia"))) &
         call group%problem("speed", "has no effect without rotating_damping and polar_inertia; remove it, or give one of them")
      allocate (self, source=rotor)
   end subroutine read_jeffcott

   !> Reads disk and casing.
   subroutine read_rotor_stator(self, group)
      class(structure_builder_t), allocatable, intent(out) :: self
      type(properties_t), intent(inout) :: group
      type(rotor_stator_t) :: bodies

      call group%get("n_diameters", bodies%n_diameters)
      call group%get("frame", bodies%frame)
      call read_numbers(bodies, group)
      allocate (self, source=bodies)
   end subroutine read_rotor_stator

   !> Reads matrices, each row by row with n_dofs**2 numbers, or as the n_dofs numbers of its diagonal.
   subroutine read_matrices(self, group)
      class(structure_builder_t), allocatable, intent(out) :: self
      type(properties_t), intent(inout) :: group
      type(matrices_t) :: matrices
      integer :: i, n_dofs

      call group%get("n_dofs", n_dofs)
      call new_matrices(matrices, n_dofs)
      call read_numbers(matrices, group)
      do i = 1, merge(size(names_of_matrices), 0, n_dofs > 0)
         associate (n => size(matrices%of(i)%values))
            if (n_dofs == 1 .and. n /= 1) then
               call group%problem(trim(names_of_matrices(i)), "has "//to_text(n)//" values, needs one: n_dofs = 1")
            else if (all(n /= [n_dofs, n_dofs**2])) then
               call group%problem(trim(names_of_matrices(i)), "needs "//to_text(n_dofs**2)//" values row by row, or "// &
                                  to_text(n_dofs)//" for a diagonal matrix, not "//to_text(n))
            end if
         end associate
      end do
      if (group%given("speed") .and. .not. any([(group%given(trim(names_of_matrices(i))), i=5, size(names_of_matrices))])) &
         call group%problem("speed", "has no effect without matrices by speed; remove it, or give one of them")
      call group%get("labels", matrices%labels)
      call group%get("units", matrices%units)
      allocate (self, source=matrices)
   end subroutine read_matrices

   !> Reads the name of a model and the numbers beside it.
   subroutine read_fe_model(self, group, source)
      class(structure_builder_t), allocatable, intent(out) :: self
      type(properties_t), intent(inout) :: group
      class(fe_model_source_t), intent(in), optional :: source
      type(fe_model_builder_t) :: builder

      allocate (builder%speeds(0))
      call group%get("file", builder%name)
      call read_numbers(builder, group)
      if (allocated(builder%name)) builder%path = trim(beside(group%file_name, builder%name))
      if (present(source)) allocate (builder%source, source=source)
      allocate (self, source=builder)
   end subroutine read_fe_model
end module hb_structure_catalogue
