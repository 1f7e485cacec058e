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
   use hb_properties, only: properties_t
   use hb_rotor_stator, only: read_rotor_stator
   use hb_structure, only: max_dofs, structure_bytes, structure_t
   use hb_text, only: join, lower, to_text
   implicit none
   private
   public :: known_structures, read_structure

   character(*), parameter :: known_structures(6) = &
      [character(12) :: "beam", "chain", "jeffcott", "matrices", "modal_beam", "rotor_stator"]

contains

   !> Reads the structure from its group `&structure`, whose key `type` names the builder. Fails before its matrices are made
   !> where these do not fit into `memory_limit`.
   subroutine read_structure(group, structure, error, memory_limit)
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(out) :: structure
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: memory_limit                  !! bytes
      character(:), allocatable :: closest, name

      name = ""
      call group%get("type", name)
      name = lower(name)
      if (present(memory_limit)) call check_size(group, name, memory_limit, error)
      if (allocated(error)) return
      select case (name)
      case ("beam")
         call read_beam(group, structure, error)
      case ("chain")
         call read_chain(group, structure, error)
      case ("jeffcott")
         call read_jeffcott(group, structure, error)
      case ("matrices")
         call read_matrices(group, structure, error)
      case ("modal_beam")
         call read_modal_beam(group, structure, error)
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

   !> Fails when the matrices of a structure as large as the group says need more than the limit.
   subroutine check_size(group, name, memory_limit, error)
      type(properties_t), intent(inout) :: group
      character(*), intent(in) :: name                                !! of the builder
      real(wp), intent(in) :: memory_limit                            !! bytes
      type(error_t), allocatable, intent(out) :: error
      real(wp), parameter :: gib = 1024.0_wp**3
      integer :: n_dofs
      character(10) :: key
      character(20) :: needed, there

      select case (name)                                              ! each builder asks for its key again
      case ("beam"); key = "n_elements"
      case ("chain"); key = "n_masses"
      case ("matrices"); key = "n_dofs"
      case ("modal_beam"); key = "n_modes"
      case default; return                                            ! a few degrees of freedom
      end select
      n_dofs = 0
      call group%get(key, n_dofs)
      if (name == "beam") n_dofs = 2*max(0, min(n_dofs, max_dofs/2)) + 2
      if (n_dofs > max_dofs + 2) return                               ! the builder refuses it with its key
      if (structure_bytes(n_dofs) <= memory_limit) return
      write (needed, "(f20.2)") structure_bytes(n_dofs)/gib
      write (there, "(f20.2)") memory_limit/gib
      call fail(error, group%place()//": the matrices of "//to_text(n_dofs)//" degrees of freedom would need "// &
                trim(adjustl(needed))//" GiB of memory while they are read, "//trim(adjustl(there))// &
                " GiB are there for each process; at most "//to_text(int(sqrt(memory_limit/structure_bytes(1))))//" would fit")
   end subroutine check_size
end module hb_structure_catalogue
