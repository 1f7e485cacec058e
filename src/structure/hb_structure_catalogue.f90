!> The known builders of structures, one case each. Their names are the types of `&structure` in the table of input
!> keys.
module hb_structure_catalogue
   use hb_beam, only: read_beam, read_modal_beam
   use hb_chain, only: read_chain
   use hb_error, only: annotate, error_t
   use hb_fe_model, only: fe_model_source_t, read_fe_model
   use hb_jeffcott, only: read_jeffcott
   use hb_kinds, only: wp
   use hb_matrices, only: read_matrices
   use hb_properties, only: properties_t
   use hb_rotor_stator, only: read_rotor_stator
   use hb_structure, only: structure_t
   use hb_structure_builder, only: structure_builder_t
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
end module hb_structure_catalogue
