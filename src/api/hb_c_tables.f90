!> The functions of nhbm.h for tables of motions. The header documents them.
module hb_c_tables
   use, intrinsic :: iso_c_binding, only: c_associated, c_double, c_f_pointer, c_int, c_loc, c_null_ptr, c_ptr, &
      c_size_t
   use hb_c_handles, only: c_status, release_handle
   use hb_c_model, only: address_of_text, begin_call, empty_text, end_call, end_call_with_text, handle_t
   use hb_c_results, only: c_description_t, clear_description, fill_description
   use hb_c_text, only: c_text
   use hb_column_table, only: column_table_t
   use hb_column_units, only: column_kind
   use hb_error, only: error_t, fail
   use hb_kinds, only: int64
   implicit none
   private

   integer(int64), parameter :: column_alignment = 8_int64            ! of columns in an array [bytes]

   !> struct nhbm_table.
   type, bind(c) :: c_table_t
      integer(c_size_t) :: n_rows
      integer(c_size_t) :: n_columns
      integer(c_int) :: declaration
      integer(c_int) :: has_messages
      type(c_ptr) :: sizes
   end type c_table_t

   !> struct nhbm_table_column.
   type, bind(c) :: c_table_column_t
      type(c_ptr) :: name
      type(c_ptr) :: unit
      type(c_ptr) :: axes
      type(c_description_t) :: description
   end type c_table_column_t

contains

   integer(c_int) function nhbm_clear_table(model) bind(c, name="nhbm_clear_table") result(status)
      type(c_ptr), value :: model
      type(handle_t), pointer :: handle

      status = begin_call(model, "nhbm_clear_table", handle)
      if (status /= c_status%success) return
      call handle%table%clear()
      call release_handle(model)
   end function nhbm_clear_table

   integer(c_int) function nhbm_add_row(model) bind(c, name="nhbm_add_row") result(status)
      type(c_ptr), value :: model
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      status = begin_call(model, "nhbm_add_row", handle, needs_model=.true.)
      if (status /= c_status%success) return
      call handle%table%add_motion(handle%session, error)
      status = end_call(model, error, c_status%invalid_state)
   end function nhbm_add_row

   integer(c_int) function nhbm_get_table(model, table) bind(c, name="nhbm_get_table") result(status)
      type(c_ptr), value :: model, table
      type(handle_t), pointer :: handle
      type(c_table_t), pointer :: found

      nullify (found)
      if (c_associated(table)) then
         call c_f_pointer(table, found)
         found = c_table_t(0_c_size_t, 0_c_size_t, 0_c_int, 0_c_int, c_null_ptr)
      end if
      status = begin_call(model, "nhbm_get_table", handle, texts=[table])
      if (status /= c_status%success) return
      found%n_rows = int(handle%table%n_rows, c_size_t)
      found%n_columns = int(handle%table%n_columns, c_size_t)
      found%declaration = int(handle%table%declaration, c_int)
      found%has_messages = merge(1_c_int, 0_c_int, allocated(handle%table%messages))
      if (handle%table%n_columns > 0) then
         handle%sizes = int(handle%table%sizes(), c_int)
         found%sizes = address_of_sizes(handle%sizes)
      end if
      call release_handle(model)
   end function nhbm_get_table

   integer(c_int) function nhbm_describe_table_column(model, column, found) bind(c, name="nhbm_describe_table_column") &
      result(status)
      type(c_ptr), value :: model, found
      integer(c_size_t), value :: column
      type(handle_t), pointer :: handle
      type(c_table_column_t), pointer :: described
      type(error_t), allocatable :: error

      nullify (described)
      if (c_associated(found)) then
         call c_f_pointer(found, described)
         described%name = c_loc(empty_text)
         described%unit = c_loc(empty_text)
         described%axes = c_loc(empty_text)
         call clear_description(c_loc(described%description))
      end if
      status = begin_call(model, "nhbm_describe_table_column", handle, texts=[found])
      if (status /= c_status%success) return
      status = c_status%invalid_argument
      if (column < 0_c_size_t .or. column >= int(handle%table%n_columns, c_size_t)) then
         call fail(error, "nhbm_describe_table_column: the table has no column of this number")
      else
         associate (chosen => handle%table%columns(int(column) + 1))
            described%name = address_of_text(chosen%name, handle%name)
            described%unit = address_of_text(chosen%units, handle%unit)
            described%axes = address_of_text(chosen%axes, handle%axes)
            status = fill_description(handle, c_loc(described%description), chosen%long_name, chosen%dof_units, chosen%flags, &
                                      chosen%attributes, [chosen%lowest_flag, chosen%kind])
         end associate
      end if
      if (allocated(error)) then
         status = end_call(model, error, status)
      else
         call release_handle(model)
      end if
   end function nhbm_describe_table_column

   integer(c_int) function nhbm_copy_columns(model, first, n, values, size) bind(c, name="nhbm_copy_columns") result(status)
      type(c_ptr), value :: model, values
      integer(c_size_t), value :: first, n, size
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error
      integer(int64) :: bytes
      integer :: i

      status = begin_call(model, "nhbm_copy_columns", handle, texts=[values])
      if (status /= c_status%success) return
      associate (table => handle%table)
         if (first < 0_c_size_t .or. n < 0_c_size_t .or. first > int(table%n_columns, c_size_t) .or. &
             n > int(table%n_columns, c_size_t) - first) then
            call fail(error, "nhbm_copy_columns: the table has no such columns")
         else
            bytes = 0_int64
            do i = int(first) + 1, int(first + n)
               bytes = bytes + aligned(table, i)
            end do
            if (size < 0_c_size_t .or. bytes > int(size, int64)) then
               call fail(error, "nhbm_copy_columns: the columns do not fit into `size` bytes")
            else
               call copy_columns(table, int(first), int(n), values, bytes)
            end if
         end if
      end associate
      status = end_call(model, error, c_status%invalid_argument)
   end function nhbm_copy_columns

   integer(c_int) function nhbm_get_row_message(model, row, message) bind(c, name="nhbm_get_row_message") result(status)
      type(c_ptr), value :: model, message
      integer(c_size_t), value :: row
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error
      character(:), allocatable :: text

      status = begin_call(model, "nhbm_get_row_message", handle, text=message)
      if (status /= c_status%success) return
      if (row < 0_c_size_t .or. row >= int(handle%table%n_rows, c_size_t)) then
         call fail(error, "nhbm_get_row_message: the table has no row of this number")
         status = end_call(model, error, c_status%invalid_argument)
         return
      end if
      call handle%table%get_message(int(row) + 1, text)
      status = end_call_with_text(model, "nhbm_get_row_message", text, handle%text, message)
   end function nhbm_get_row_message

   integer(c_int) function nhbm_get_table_labels(model, axis, labels) bind(c, name="nhbm_get_table_labels") result(status)
      type(c_ptr), value :: model, axis, labels
      type(handle_t), pointer :: handle
      character(:), allocatable :: text

      status = begin_call(model, "nhbm_get_table_labels", handle, text=labels, texts=[axis])
      if (status /= c_status%success) return
      call handle%table%get_labels(c_text(axis), text)
      status = end_call_with_text(model, "nhbm_get_table_labels", text, handle%text, labels)
   end function nhbm_get_table_labels

   !> Bytes of a column in an array, with what is left out behind it.
   integer(int64) function aligned(table, i) result(bytes)
      class(column_table_t), intent(in) :: table
      integer, intent(in) :: i

      bytes = (table%bytes(i) + column_alignment - 1_int64)/column_alignment*column_alignment
   end function aligned

   !> Copies columns into an array of C.
   subroutine copy_columns(table, first, n, address, bytes)
      class(column_table_t), intent(in) :: table
      integer, intent(in) :: first, n                                 !! counted from 0
      type(c_ptr), intent(in) :: address
      integer(int64), intent(in) :: bytes                             !! of all
      real(c_double), pointer, contiguous :: reals(:)
      integer(c_int), pointer, contiguous :: integers(:)
      integer(int64) :: from, length
      integer :: i

      call c_f_pointer(address, reals, [bytes/8_int64])
      call c_f_pointer(address, integers, [bytes/4_int64])
      from = 0_int64
      do i = first + 1, first + n
         length = table%bytes(i)
         if (length == 0_int64) cycle
         if (table%columns(i)%kind == column_kind%real) then
            call table%copy_reals(i, reals(from/8_int64 + 1:(from + length)/8_int64))
         else
            call table%copy_integers(i, integers(from/4_int64 + 1:(from + length)/4_int64))
         end if
         from = from + aligned(table, i)
      end do
   end subroutine copy_columns

   !> Address of the sizes of a table, valid until they are asked for again.
   type(c_ptr) function address_of_sizes(sizes) result(address)
      integer(c_int), allocatable, target, intent(in) :: sizes(:, :)

      address = c_loc(sizes)
   end function address_of_sizes
end module hb_c_tables
