!> Structures that a program defines when an input names them: the functions nhbm_structure_... of nhbm.h.
module hb_c_structures
   use, intrinsic :: iso_c_binding, only: c_associated, c_double, c_f_pointer, c_f_procpointer, c_funptr, c_int, c_loc, &
      c_null_char, c_null_funptr, c_null_ptr, c_ptr
   use hb_c_text, only: c_text
   use hb_error, only: annotate, error_t, fail
   use hb_fe_model, only: fe_model_source_t, fe_model_t
   use hb_kinds, only: wp
   use hb_sparse, only: new_sparse, sparse_t
   use hb_structure, only: label_length, unit_length
   use hb_text, only: split, string_t, to_text
   implicit none
   private
   public :: c_structures_t

   !> Calls the program: fill(context, file, structure).
   type, extends(fe_model_source_t) :: c_structures_t
      type(c_funptr) :: fill = c_null_funptr
      type(c_ptr) :: context = c_null_ptr
   contains
      procedure :: fetch => c_structures_fetch
   end type c_structures_t

   !> struct nhbm_structure: the data defined so far, and the first error.
   type :: described_t
      type(fe_model_t) :: fe_model
      integer :: n_nodes = 0
      type(error_t), allocatable :: error
   end type described_t

   abstract interface
      integer(c_int) function fill_structure(context, file, structure) bind(c)
         import :: c_int, c_ptr
         type(c_ptr), value :: context, file, structure
      end function fill_structure
   end interface

contains

   subroutine c_structures_fetch(self, name, fe_model, error)
      class(c_structures_t), intent(in) :: self
      character(*), intent(in) :: name
      type(fe_model_t), intent(out) :: fe_model
      type(error_t), allocatable, intent(out) :: error
      procedure(fill_structure), pointer :: fill
      type(described_t), target :: structure
      character(:), allocatable, target :: file
      integer(c_int) :: code

      if (.not. c_associated(self%fill)) then
         call fail(error, "no callback provides the structure '"//name//"'; nhbm_structures of nhbm.h sets one")
         return
      end if
      file = name//c_null_char
      call c_f_procpointer(self%fill, fill)
      code = fill(self%context, c_loc(file), c_loc(structure))
      if (allocated(structure%error)) then
         call move_alloc(structure%error, error)
      else if (code /= 0) then
         call fail(error, "structure '"//name//"' was refused with "//to_text(int(code)))
      else if (structure%fe_model%n_dofs == 0 .or. structure%fe_model%mass%n_rows == 0 .or. structure%fe_model%stiffness%n_rows == &
         0) then
         call fail(error, "degrees of freedom, mass and stiffness must be given")
      end if
      call annotate(error, "structure '"//name//"'")
      if (allocated(error)) return
      fe_model = structure%fe_model
      deallocate (fe_model%labels, fe_model%units)                    ! gfortran 12 loses their lengths
      call move_alloc(structure%fe_model%labels, fe_model%labels)
      call move_alloc(structure%fe_model%units, fe_model%units)
   end subroutine c_structures_fetch

   integer(c_int) function nhbm_structure_dofs(structure, labels, units, up_to) bind(c, name="nhbm_structure_dofs") result(code)
      type(c_ptr), value :: structure, labels, units
      real(c_double), value :: up_to
      type(described_t), pointer :: d
      type(string_t), allocatable :: words(:)
      integer :: i

      call c_f_pointer(structure, d)
      words = words_of(c_text(labels))
      d%fe_model%n_dofs = size(words)
      allocate (character(label_length) :: d%fe_model%labels(size(words)))
      allocate (character(unit_length) :: d%fe_model%units(size(words)))
      d%fe_model%units = "m"
      do i = 1, size(words)
         d%fe_model%labels(i) = words(i)%value
      end do
      words = words_of(c_text(units))
      if (size(words) > 0 .and. size(words) /= d%fe_model%n_dofs) call fail(d%error, to_text(size(words))//" units for "// &
                                                                         to_text(d%fe_model%n_dofs)//" labels")
      do i = 1, min(size(words), d%fe_model%n_dofs)
         d%fe_model%units(i) = words(i)%value
      end do
      d%fe_model%up_to = up_to
      code = code_of(d)
   end function nhbm_structure_dofs

   integer(c_int) function nhbm_structure_matrix(structure, name, starts, columns, values) &
      bind(c, name="nhbm_structure_matrix") result(code)
      type(c_ptr), value :: structure, name
      integer(c_int), intent(in) :: starts(*), columns(*)
      real(c_double), intent(in) :: values(*)
      type(described_t), pointer :: d
      type(sparse_t) :: matrix
      type(error_t), allocatable :: error
      character(:), allocatable :: word

      call c_f_pointer(structure, d)
      word = c_text(name)
      associate (n => d%fe_model%n_dofs)
         call new_sparse(matrix, n, int(starts(:n + 1)), int(columns(:starts(n + 1))), real(values(:starts(n + 1)), wp), error)
      end associate
      call annotate(error, "matrix '"//word//"'")
      if (.not. allocated(error)) then
         select case (word)
         case ("mass"); d%fe_model%mass = matrix
         case ("stiffness"); d%fe_model%stiffness = matrix
         case ("damping"); d%fe_model%damping = matrix
         case ("gyroscopic"); d%fe_model%gyroscopic = matrix
         case ("structural"); d%fe_model%structural = matrix
         case ("gyroscopic_by_speed"); d%fe_model%speeds(1)%gyroscopic = matrix
         case ("stiffness_by_speed"); d%fe_model%speeds(1)%stiffness = matrix
         case ("stiffness_by_speed_squared"); d%fe_model%speeds(1)%stiffness_squared = matrix
         case ("gyroscopic_by_speed_2"); d%fe_model%speeds(2)%gyroscopic = matrix
         case ("stiffness_by_speed_2"); d%fe_model%speeds(2)%stiffness = matrix
         case ("stiffness_by_speed_squared_2"); d%fe_model%speeds(2)%stiffness_squared = matrix
         case default
            call fail(error, "there is no matrix '"//word//"'; known: mass, stiffness, damping, gyroscopic, structural, "// &
                      "gyroscopic_by_speed, stiffness_by_speed, stiffness_by_speed_squared, and these with _2 for a second speed")
         end select
      end if
      if (allocated(error)) call move_alloc(error, d%error)
      code = code_of(d)
   end function nhbm_structure_matrix

   integer(c_int) function nhbm_structure_vector(structure, name, n, dofs, values) &
      bind(c, name="nhbm_structure_vector") result(code)
      type(c_ptr), value :: structure, name
      integer(c_int), value :: n
      integer(c_int), intent(in) :: dofs(*)
      real(c_double), intent(in) :: values(*)
      type(described_t), pointer :: d
      type(error_t), allocatable :: error

      call c_f_pointer(structure, d)
      call d%fe_model%vectors%add(c_text(name), int(dofs(:n)), real(values(:n), wp), d%fe_model%n_dofs, error)
      if (allocated(error)) call move_alloc(error, d%error)
      code = code_of(d)
   end function nhbm_structure_vector

   integer(c_int) function nhbm_structure_nodes(structure, n_nodes, nodes, directions) &
      bind(c, name="nhbm_structure_nodes") result(code)
      type(c_ptr), value :: structure, directions
      integer(c_int), value :: n_nodes
      integer(c_int), intent(in) :: nodes(*)
      type(described_t), pointer :: d
      type(string_t), allocatable :: words(:)
      integer :: i

      call c_f_pointer(structure, d)
      words = words_of(c_text(directions))
      if (size(words) /= d%fe_model%n_dofs) then
         call fail(d%error, to_text(size(words))//" directions for "//to_text(d%fe_model%n_dofs)//" degrees of freedom")
      else if (any(nodes(:d%fe_model%n_dofs) < -1 .or. nodes(:d%fe_model%n_dofs) >= n_nodes)) then
         call fail(d%error, "nodes of degrees of freedom must be 0 to "//to_text(int(n_nodes) - 1)//", or -1 for none")
      else
         d%n_nodes = int(n_nodes)
         d%fe_model%sets%node_of = int(nodes(:d%fe_model%n_dofs)) + 1
         allocate (d%fe_model%sets%direction(size(words)))
         do i = 1, size(words)
            d%fe_model%sets%direction(i) = words(i)%value
         end do
      end if
      code = code_of(d)
   end function nhbm_structure_nodes

   integer(c_int) function nhbm_structure_set(structure, name, n, nodes) bind(c, name="nhbm_structure_set") result(code)
      type(c_ptr), value :: structure, name
      integer(c_int), value :: n
      integer(c_int), intent(in) :: nodes(*)
      type(described_t), pointer :: d
      type(error_t), allocatable :: error

      call c_f_pointer(structure, d)
      if (allocated(d%fe_model%sets%node_of)) then
         call d%fe_model%sets%add(c_text(name), int(nodes(:n)), d%n_nodes, error)
      else
         call fail(error, "set '"//c_text(name)//"': nhbm_structure_nodes comes before")
      end if
      if (allocated(error)) call move_alloc(error, d%error)
      code = code_of(d)
   end function nhbm_structure_set

   subroutine nhbm_structure_refuse(structure, text) bind(c, name="nhbm_structure_refuse")
      type(c_ptr), value :: structure, text
      type(described_t), pointer :: d

      call c_f_pointer(structure, d)
      call fail(d%error, c_text(text))
   end subroutine nhbm_structure_refuse

   !> The words of a text separated by blanks.
   function words_of(text) result(words)
      character(*), intent(in) :: text
      type(string_t), allocatable :: words(:)

      allocate (words(0))
      if (len(text) > 0) call split(text, " ", words)
   end function words_of

   integer(c_int) function code_of(d)
      type(described_t), intent(in) :: d

      code_of = merge(1_c_int, 0_c_int, allocated(d%error))
   end function code_of
end module hb_c_structures
