!> Structures that a program defines when an input names them: the functions nhbm_structure_... of nhbm.h.
module hb_c_structures
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use, intrinsic :: iso_c_binding, only: c_associated, c_double, c_f_pointer, c_f_procpointer, c_funptr, c_int, c_loc, &
      c_null_char, c_null_funptr, c_null_ptr, c_ptr, c_size_t
   use hb_c_handles, only: acquire, c_status, handle_kind, register_handle, release_handle, set_last_error, &
      unregister_handle
   use hb_c_text, only: c_text
   use hb_error, only: annotate, error_t, fail
   use hb_fe_model, only: fe_model_source_t, fe_model_t
   use hb_kinds, only: wp
   use hb_node_sets, only: name_length
   use hb_sparse, only: new_sparse, sparse_t
   use hb_structure, only: label_length, unit_length
   use hb_text, only: split, string_t, to_text
   implicit none
   private
   public :: c_structures_t

   !> Calls the program: callback(context, file, structure).
   type, extends(fe_model_source_t) :: c_structures_t
      type(c_funptr) :: callback = c_null_funptr
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
      integer(c_int) function structure_callback(context, file, structure) bind(c)
         import :: c_int, c_ptr
         type(c_ptr), value :: context, file, structure
      end function structure_callback
   end interface

contains

   subroutine c_structures_fetch(self, name, fe_model, error)
      class(c_structures_t), intent(in) :: self
      character(*), intent(in) :: name
      type(fe_model_t), intent(out) :: fe_model
      type(error_t), allocatable, intent(out) :: error
      procedure(structure_callback), pointer :: callback
      type(described_t), pointer :: structure
      character(:), allocatable, target :: file
      integer(c_int) :: code

      if (.not. c_associated(self%callback)) then
         call fail(error, "no callback provides the structure '"//name//"'; nhbm_set_structure_callback of nhbm.h sets one")
         return
      end if
      allocate (structure)
      if (register_handle(c_loc(structure), handle_kind%structure) /= 0) then
         call fail(error, "structure '"//name//"': memory is insufficient")
         deallocate (structure)
         return
      end if
      file = name//c_null_char
      call c_f_procpointer(self%callback, callback)
      code = callback(self%context, c_loc(file), c_loc(structure))
      call unregister_handle(c_loc(structure))
      if (allocated(structure%error)) then
         call move_alloc(structure%error, error)
      else if (code /= 0) then
         call fail(error, "the structure callback returned "//to_text(int(code)))
      else if (structure%fe_model%n_dofs == 0 .or. structure%fe_model%mass%n_rows == 0 .or. structure%fe_model%stiffness%n_rows == &
         0) then
         call fail(error, "degrees of freedom, mass and stiffness must be given")
      end if
      call annotate(error, "structure '"//name//"'")
      if (.not. allocated(error)) then
         fe_model = structure%fe_model
         deallocate (fe_model%labels, fe_model%units)                 ! gfortran 12 loses their lengths
         call move_alloc(structure%fe_model%labels, fe_model%labels)
         call move_alloc(structure%fe_model%units, fe_model%units)
      end if
      deallocate (structure)
   end subroutine c_structures_fetch

   integer(c_int) function nhbm_structure_set_dofs(structure, labels, units, max_frequency) &
      bind(c, name="nhbm_structure_set_dofs") result(status)
      type(c_ptr), value :: structure, labels, units
      real(c_double), value :: max_frequency
      character(*), parameter :: name = "nhbm_structure_set_dofs"
      type(described_t), pointer :: d
      type(error_t), allocatable :: error
      type(string_t), allocatable :: label_words(:), unit_words(:)
      integer :: i, n

      status = acquire(structure, handle_kind%structure, name)
      if (status /= c_status%success) return
      call c_f_pointer(structure, d)
      if (.not. (c_associated(labels) .and. c_associated(units))) then
         call fail(error, "labels and units must not be NULL; no units: an empty text")
      else if (d%fe_model%n_dofs > 0) then
         call fail(error, "the degrees of freedom are set already")
      else if (.not. (ieee_is_finite(max_frequency) .and. sign(1.0_c_double, max_frequency) > 0.0_c_double)) then ! NaN traps in <
         call fail(error, "max_frequency must be a finite number, positive, or 0 for any frequency")
      else
         label_words = words_of(c_text(labels))
         unit_words = words_of(c_text(units))
         n = size(label_words)
         if (n == 0) then
            call fail(error, "there are no labels")
         else if (size(unit_words) > 0 .and. size(unit_words) /= n) then
            call fail(error, to_text(size(unit_words))//" units for "//to_text(n)//" labels")
         end if
         call check_lengths("label", label_words, label_length, error)
         call check_lengths("unit", unit_words, unit_length, error)
      end if
      if (.not. allocated(error)) then
         allocate (character(label_length) :: d%fe_model%labels(n))
         allocate (character(unit_length) :: d%fe_model%units(n))
         do i = 1, n
            d%fe_model%labels(i) = label_words(i)%value
         end do
         d%fe_model%units = "m"
         do i = 1, size(unit_words)
            d%fe_model%units(i) = unit_words(i)%value
         end do
         d%fe_model%n_dofs = n
         d%fe_model%up_to = max_frequency
      end if
      status = ended(structure, d, name, error)
   end function nhbm_structure_set_dofs

   integer(c_int) function nhbm_structure_set_matrix(structure, name, n_rows, n_entries, row_starts, columns, values) &
      bind(c, name="nhbm_structure_set_matrix") result(status)
      type(c_ptr), value :: structure, name, row_starts, columns, values
      integer(c_size_t), value :: n_rows, n_entries
      character(*), parameter :: function_name = "nhbm_structure_set_matrix"
      integer(c_int), pointer :: starts(:), column(:)
      real(c_double), pointer :: value(:)
      type(described_t), pointer :: d
      type(sparse_t) :: matrix
      type(error_t), allocatable :: error
      character(:), allocatable :: word

      status = acquire(structure, handle_kind%structure, function_name)
      if (status /= c_status%success) return
      call c_f_pointer(structure, d)
      word = c_text(name)
      call check_dofs(d, n_rows, error)
      if (allocated(error)) then
         continue
      else if (.not. (c_associated(row_starts) .and. c_associated(columns) .and. c_associated(values))) then
         call fail(error, "row_starts, columns and values must not be NULL")
      else if (.not. is_count(n_entries)) then
         call fail(error, "n_entries must be at most "//to_text(huge(1)))
      else
         call c_f_pointer(row_starts, starts, [n_rows + 1_c_size_t])
         call c_f_pointer(columns, column, [n_entries])
         call c_f_pointer(values, value, [n_entries])
         call new_sparse(matrix, d%fe_model%n_dofs, int(starts), int(column), real(value, wp), error)
      end if
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
      status = ended(structure, d, function_name, error)
   end function nhbm_structure_set_matrix

   integer(c_int) function nhbm_structure_add_load(structure, name, n, dofs, values) &
      bind(c, name="nhbm_structure_add_load") result(status)
      type(c_ptr), value :: structure, name, dofs, values
      integer(c_size_t), value :: n
      character(*), parameter :: function_name = "nhbm_structure_add_load"
      integer(c_int), pointer :: dof(:)
      real(c_double), pointer :: value(:)
      type(described_t), pointer :: d
      type(error_t), allocatable :: error

      status = acquire(structure, handle_kind%structure, function_name)
      if (status /= c_status%success) return
      call c_f_pointer(structure, d)
      call check_name("load", c_text(name), error)
      if (.not. allocated(error) .and. d%fe_model%n_dofs == 0) call fail(error, "nhbm_structure_set_dofs comes before")
      if (.not. allocated(error)) call check_array(n, [dofs, values], error)
      if (.not. allocated(error)) then
         call c_f_pointer(dofs, dof, [n])
         call c_f_pointer(values, value, [n])
         call d%fe_model%vectors%add(c_text(name), int(dof), real(value, wp), d%fe_model%n_dofs, error)
      end if
      status = ended(structure, d, function_name, error)
   end function nhbm_structure_add_load

   integer(c_int) function nhbm_structure_set_nodes(structure, n_nodes, n_dofs, nodes, directions) &
      bind(c, name="nhbm_structure_set_nodes") result(status)
      type(c_ptr), value :: structure, nodes, directions
      integer(c_size_t), value :: n_nodes, n_dofs
      character(*), parameter :: function_name = "nhbm_structure_set_nodes"
      type(described_t), pointer :: d
      type(error_t), allocatable :: error

      status = acquire(structure, handle_kind%structure, function_name)
      if (status /= c_status%success) return
      call c_f_pointer(structure, d)
      call check_dofs(d, n_dofs, error)
      if (allocated(error)) then
         continue
      else if (.not. (c_associated(nodes) .and. c_associated(directions))) then
         call fail(error, "nodes and directions must not be NULL")
      else if (allocated(d%fe_model%sets%node_of)) then
         call fail(error, "the nodes are set already")
      else if (.not. is_count(n_nodes)) then
         call fail(error, "n_nodes must be at most "//to_text(huge(1)))
      else
         call set_nodes(d, nodes, words_of(c_text(directions)), int(n_nodes), error)
      end if
      status = ended(structure, d, function_name, error)
   end function nhbm_structure_set_nodes

   !> Stores the nodes and directions of all degrees of freedom.
   subroutine set_nodes(d, nodes, words, n_nodes, error)
      type(described_t), intent(inout) :: d
      type(c_ptr), value :: nodes                      !! one of each degree of freedom, from 0, or -1 for none
      type(string_t), intent(in) :: words(:)           !! directions, likewise
      integer, intent(in) :: n_nodes
      type(error_t), allocatable, intent(out) :: error
      integer(c_int), pointer :: node(:)
      integer :: i

      call c_f_pointer(nodes, node, [d%fe_model%n_dofs])
      if (size(words) /= d%fe_model%n_dofs) then
         call fail(error, to_text(size(words))//" directions for "//to_text(d%fe_model%n_dofs)//" degrees of freedom")
      else if (any(node < -1 .or. node >= n_nodes)) then
         call fail(error, "nodes of degrees of freedom must be 0 to "//to_text(n_nodes - 1)//", or -1 for none")
      else
         d%n_nodes = n_nodes
         d%fe_model%sets%node_of = int(node) + 1
         allocate (d%fe_model%sets%direction(size(words)))
         do i = 1, size(words)
            d%fe_model%sets%direction(i) = words(i)%value
         end do
      end if
   end subroutine set_nodes

   integer(c_int) function nhbm_structure_set_coordinates(structure, n_nodes, coordinates) &
      bind(c, name="nhbm_structure_set_coordinates") result(status)
      type(c_ptr), value :: structure, coordinates
      integer(c_size_t), value :: n_nodes
      character(*), parameter :: function_name = "nhbm_structure_set_coordinates"
      real(c_double), pointer :: place(:, :)
      type(described_t), pointer :: d
      type(error_t), allocatable :: error

      status = acquire(structure, handle_kind%structure, function_name)
      if (status /= c_status%success) return
      call c_f_pointer(structure, d)
      if (.not. allocated(d%fe_model%sets%node_of)) then
         call fail(error, "nhbm_structure_set_nodes comes before")
      else if (n_nodes /= int(d%n_nodes, c_size_t)) then
         call fail(error, "the structure has "//to_text(d%n_nodes)//" nodes, not the given number")
      else if (.not. c_associated(coordinates)) then
         call fail(error, "coordinates must not be NULL")
      else
         call c_f_pointer(coordinates, place, [3, d%n_nodes])
         d%fe_model%sets%coordinates = real(place, wp)
      end if
      status = ended(structure, d, function_name, error)
   end function nhbm_structure_set_coordinates

   integer(c_int) function nhbm_structure_add_node_set(structure, name, n, nodes) &
      bind(c, name="nhbm_structure_add_node_set") result(status)
      type(c_ptr), value :: structure, name, nodes
      integer(c_size_t), value :: n
      character(*), parameter :: function_name = "nhbm_structure_add_node_set"
      integer(c_int), pointer :: node(:)
      type(described_t), pointer :: d
      type(error_t), allocatable :: error

      status = acquire(structure, handle_kind%structure, function_name)
      if (status /= c_status%success) return
      call c_f_pointer(structure, d)
      call check_name("set", c_text(name), error)
      if (.not. (allocated(error) .or. allocated(d%fe_model%sets%node_of))) &
         call fail(error, "set '"//c_text(name)//"': nhbm_structure_set_nodes comes before")
      if (.not. allocated(error)) call check_array(n, [nodes], error)
      if (.not. allocated(error)) then
         call c_f_pointer(nodes, node, [n])
         call d%fe_model%sets%add(c_text(name), int(node), d%n_nodes, error)
      end if
      status = ended(structure, d, function_name, error)
   end function nhbm_structure_add_node_set

   integer(c_int) function nhbm_structure_set_error(structure, message) bind(c, name="nhbm_structure_set_error") result(status)
      type(c_ptr), value :: structure, message
      character(*), parameter :: function_name = "nhbm_structure_set_error"
      type(described_t), pointer :: d
      type(error_t), allocatable :: error

      status = acquire(structure, handle_kind%structure, function_name)
      if (status /= c_status%success) return
      call c_f_pointer(structure, d)
      if (c_associated(message)) then
         call fail(d%error, c_text(message))
      else
         call fail(error, "message must not be NULL")
      end if
      status = ended(structure, d, function_name, error)
   end function nhbm_structure_set_error

   !> Ends a function: its error is the last one of the thread and, unless there was one before, that of the structure.
   integer(c_int) function ended(structure, d, function_name, error) result(status)
      type(c_ptr), intent(in) :: structure
      type(described_t), intent(inout) :: d
      character(*), intent(in) :: function_name
      type(error_t), allocatable, intent(inout) :: error

      status = c_status%success
      if (allocated(error)) then
         call set_last_error(function_name//": "//error%message)
         status = c_status%invalid_argument
         if (.not. allocated(d%error)) call move_alloc(error, d%error)
      end if
      call release_handle(structure)
   end function ended

   !> Fails unless the degrees of freedom are set, `n` of them.
   subroutine check_dofs(d, n, error)
      type(described_t), intent(in) :: d
      integer(c_size_t), intent(in) :: n
      type(error_t), allocatable, intent(out) :: error

      if (d%fe_model%n_dofs == 0) then
         call fail(error, "nhbm_structure_set_dofs comes before")
      else if (n /= int(d%fe_model%n_dofs, c_size_t)) then
         call fail(error, "the structure has "//to_text(d%fe_model%n_dofs)//" degrees of freedom, not the given number")
      end if
   end subroutine check_dofs

   !> Fails if an array of `n` values is too long, or NULL although it has values.
   subroutine check_array(n, addresses, error)
      integer(c_size_t), intent(in) :: n
      type(c_ptr), intent(in) :: addresses(:)
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      if (.not. is_count(n)) call fail(error, "n must be at most "//to_text(huge(1)))
      if (allocated(error) .or. n == 0) return
      do i = 1, size(addresses)
         if (.not. c_associated(addresses(i))) call fail(error, "an array of "//to_text(int(n))//" values is NULL")
      end do
   end subroutine check_array

   !> Whether a number of C is one of Fortran; `size_t` is unsigned, so that larger ones may appear as negative.
   pure logical function is_count(n)
      integer(c_size_t), intent(in) :: n

      is_count = n >= 0_c_size_t .and. n <= int(huge(1), c_size_t)
   end function is_count

   subroutine check_name(noun, name, error)
      character(*), intent(in) :: noun, name
      type(error_t), allocatable, intent(out) :: error

      if (len_trim(name) == 0 .or. len(name) > name_length) &
         call fail(error, "the name of a "//noun//" must have 1 to "//to_text(name_length)//" characters")
   end subroutine check_name

   subroutine check_lengths(noun, words, max_length, error)
      character(*), intent(in) :: noun
      type(string_t), intent(in) :: words(:)
      integer, intent(in) :: max_length
      type(error_t), allocatable, intent(inout) :: error
      integer :: i

      do i = 1, size(words)
         if (allocated(error)) return
         if (len(words(i)%value) > max_length) &
            call fail(error, noun//" '"//words(i)%value//"' has more than "//to_text(max_length)//" characters")
      end do
   end subroutine check_lengths

   !> The words of a text, between which there are one or more blanks.
   function words_of(text) result(words)
      character(*), intent(in) :: text
      type(string_t), allocatable :: words(:)
      type(string_t), allocatable :: parts(:)
      integer :: i, n

      call split(text, " ", parts)
      allocate (words(count([(len(parts(i)%value) > 0, i=1, size(parts))])))
      n = 0
      do i = 1, size(parts)
         if (len(parts(i)%value) == 0) cycle
         n = n + 1
         words(n) = parts(i)
      end do
   end function words_of
end module hb_c_structures
