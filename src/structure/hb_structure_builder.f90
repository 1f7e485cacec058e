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
   public :: matrix_slope_t, structure_builder_t

   !> Derivatives of the matrices by one number, by their entries that are not zero; several of one place add.
   type :: matrix_slope_t
      integer, allocatable :: row(:), column(:)              !! (any)
      real(wp), allocatable :: mass(:), damping(:), stiffness(:) !! by the number, as row
   contains
      procedure :: begin => matrix_slope_begin
      procedure :: add => matrix_slope_add
   end type matrix_slope_t

   type, extends(numbered_t), abstract :: structure_builder_t
      type(proportional_damping_t) :: proportional           !! added to other damping
   contains
      procedure(build_structure), deferred :: build
      procedure :: find_slope => structure_builder_find_slope
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

   !> Forgets all entries.
   pure subroutine matrix_slope_begin(self)
      class(matrix_slope_t), intent(inout) :: self

      self%row = [integer ::]
      self%column = [integer ::]
      self%mass = [real(wp) ::]
      self%damping = [real(wp) ::]
      self%stiffness = [real(wp) ::]
   end subroutine matrix_slope_begin

   !> Adds an entry of mass and stiffness, and that of proportional damping.
   pure subroutine matrix_slope_add(self, row, column, mass, stiffness, damping)
      class(matrix_slope_t), intent(inout) :: self
      integer, intent(in) :: row, column
      real(wp), intent(in) :: mass, stiffness, damping

      self%row = [self%row, row]
      self%column = [self%column, column]
      self%mass = [self%mass, mass]
      self%stiffness = [self%stiffness, stiffness]
      self%damping = [self%damping, damping]
   end subroutine matrix_slope_add

   !> Derivatives of the matrices by a number of which few entries depend; `is_known` is false if the builder does not
   !> know them, so that differences of the matrices must take their place.
   subroutine structure_builder_find_slope(self, number, slope, is_known)
      class(structure_builder_t), intent(in) :: self
      type(number_t), intent(in) :: number                   !! one that it declares
      type(matrix_slope_t), intent(inout) :: slope
      logical, intent(out) :: is_known

      call slope%begin()
      is_known = .false.
   end subroutine structure_builder_find_slope
end module hb_structure_builder
