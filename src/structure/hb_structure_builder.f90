!> The object from which a structure is built, such as a beam: it declares its numbers (hb_numbers), and builds the
!> structure from them as often as they change.
module hb_structure_builder
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_numbers, only: number_t, numbered_t
   use hb_proportional_damping, only: proportional_damping_t
   use hb_structure, only: structure_t
   implicit none
   private
   public :: structure_builder_t

   type, extends(numbered_t), abstract :: structure_builder_t
      type(proportional_damping_t) :: proportional           !! added to other damping
   contains
      procedure(build_structure), deferred :: build
      procedure :: is_affine_in => structure_builder_is_affine_in
   end type structure_builder_t

   abstract interface
      !> Builds the structure of the present numbers. Fails as the constructor of the structure does, and, before
      !> matrices are allocated, if they do not fit into `memory_limit`.
      subroutine build_structure(self, structure, error, memory_limit)
         import :: error_t, structure_builder_t, structure_t, wp
         class(structure_builder_t), intent(inout) :: self   !! its numbers are unchanged
         type(structure_t), intent(out) :: structure
         type(error_t), allocatable, intent(out) :: error
         real(wp), intent(in), optional :: memory_limit      !! bytes
      end subroutine build_structure
   end interface

contains

   !> Whether the matrices are affine functions of a number, a + b p: differences of any length are then exact.
   pure logical function structure_builder_is_affine_in(self, number) result(is_affine)
      class(structure_builder_t), intent(in) :: self
      type(number_t), intent(in) :: number

      is_affine = .true.
   end function structure_builder_is_affine_in
end module hb_structure_builder
