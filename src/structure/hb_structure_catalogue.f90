!> The known builders of structures, one case each. Their names are the types of `&structure` in the table of input
!> keys.
module hb_structure_catalogue
   use hb_beam, only: read_beam, read_modal_beam
   use hb_chain, only: read_chain
   use hb_error, only: error_t
   use hb_fe_model, only: fe_model_source_t, read_fe_model
   use hb_jeffcott, only: read_jeffcott
   use hb_kinds, only: wp
   use hb_matrices, only: read_matrices
   use hb_properties, only: properties_t
   use hb_rotor_stator, only: read_rotor_stator
   use hb_structure, only: structure_t
   implicit none
   private
   public :: read_structure

contains

   !> Reads the structure from its group `&structure`, whose key `type` names the builder. Fails before its matrices
   !> are allocated if they do not fit into `memory_limit`.
   subroutine read_structure(group, structure, error, memory_limit, fe_models)
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(out) :: structure
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: memory_limit                  !! bytes
      class(fe_model_source_t), intent(in), optional :: fe_models     !! for structures of type `model`
      character(:), allocatable :: name

      call group%get("type", name)
      if (.not. allocated(name)) then
         call group%report_first(error)
         return
      end if
      select case (name)
      case ("beam")
         call read_beam(group, structure, error, memory_limit)
      case ("chain")
         call read_chain(group, structure, error, memory_limit)
      case ("jeffcott")
         call read_jeffcott(group, structure, error)
      case ("matrices")
         call read_matrices(group, structure, error, memory_limit)
      case ("modal_beam")
         call read_modal_beam(group, structure, error, memory_limit)
      case ("model")
         call read_fe_model(group, structure, error, memory_limit, fe_models)
      case ("rotor_stator")
         call read_rotor_stator(group, structure, error)
      end select
   end subroutine read_structure
end module hb_structure_catalogue
