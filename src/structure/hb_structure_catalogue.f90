!> The known builders of structures. A new one is a module and, here, one name and one case.
module hb_structure_catalogue
   use hb_beam, only: read_beam
   use hb_chain, only: read_chain
   use hb_closest_word, only: closest_word
   use hb_error, only: error_t, fail
   use hb_jeffcott, only: read_jeffcott
   use hb_kinds, only: wp
   use hb_matrices, only: read_matrices
   use hb_modal_beam, only: read_modal_beam
   use hb_model, only: model_source_t, read_model
   use hb_properties, only: properties_t
   use hb_rotor_stator, only: read_rotor_stator
   use hb_structure, only: structure_t
   use hb_text, only: join, lower
   implicit none
   private
   public :: known_structures, read_structure

   character(*), parameter :: known_structures(7) = &
      [character(12) :: "beam", "chain", "jeffcott", "matrices", "modal_beam", "model", "rotor_stator"]

contains

   !> Reads the structure from its group `&structure`, whose key `type` names the builder. Fails before its matrices are made
   !> where these do not fit into `memory_limit`.
   subroutine read_structure(group, structure, error, memory_limit, models)
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(out) :: structure
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: memory_limit                  !! bytes
      class(model_source_t), intent(in), optional :: models           !! for structures of type `model`
      character(:), allocatable :: closest, name

      name = ""
      call group%get("type", name)
      name = lower(name)
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
         call read_model(group, structure, error, memory_limit, models)
      case ("rotor_stator")
         call read_rotor_stator(group, structure, error)
      case ("")
         call fail(error, group%place()//": type: needs the name of a structure in quotes; known: "// &
                   join(known_structures, ", "))
      case default
         closest = closest_word(name, known_structures)
         if (len(closest) > 0) closest = "; did you mean '"//closest//"'?"
         call fail(error, group%place()//": type: unknown structure '"//name//"'; known: "// &
                   join(known_structures, ", ")//closest)
      end select
   end subroutine read_structure
end module hb_structure_catalogue
