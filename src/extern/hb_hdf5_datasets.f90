!> Datasets of a file: their values, whole ones and rows that a rank writes alone, and their dimension scales.
module hb_hdf5_datasets
   use, intrinsic :: iso_c_binding, only: c_char, c_loc, c_null_char, c_null_ptr, c_ptr
   use, intrinsic :: iso_fortran_env, only: int64
   use h5ds, only: h5dsattach_scale_f, h5dsis_attached_f, h5dsset_scale_f
   use hb_c_text, only: c_text
   use hb_error, only: annotate, error_t, fail
   use hb_hdf5_attributes, only: h5_object_t
   use hb_hdf5_library, only: check, is_text_type, new_byte_type, new_space, no_id
   use hb_kinds, only: wp
   use hb_text, only: to_text
   use hdf5, only: h5dclose_f, h5dget_offset_f, h5dget_space_f, h5dget_type_f, h5dread_f, h5dvlen_reclaim_f, h5dwrite_f, &
      H5P_DEFAULT_F, H5S_ALL_F, H5S_SELECT_SET_F, h5sclose_f, h5sselect_hyperslab_f, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, &
      H5T_NATIVE_INTEGER, H5T_STD_I32LE, h5tclose_f, h5tequal_f, h5tget_size_f, h5tis_variable_str_f, haddr_t, hid_t, hsize_t, &
      size_t
   implicit none
   private
   public :: h5_dataset_t

   !> An open dataset; closed with its file at the latest.
   type, extends(h5_object_t) :: h5_dataset_t
      integer(hsize_t), allocatable :: extents(:)      ! fastest first
   contains
      procedure :: attach_scale => dataset_attach_scale
      procedure :: close => dataset_close
      procedure :: describe => dataset_describe
      procedure :: get_extents => dataset_get_extents
      procedure :: get_offset => dataset_get_offset
      procedure :: has_scale => dataset_has_scale
      procedure :: make_scale => dataset_make_scale
      generic :: read => read_integer, read_real, read_texts
      generic :: read_rows => read_integer_rows, read_real_rows
      procedure :: read_text_row => dataset_read_text_row
      generic :: write => write_integer, write_real
      generic :: write_part => write_integer_part, write_real_part
      generic :: write_row => write_integer_row, write_real_row, write_text_row
      procedure, private :: read_integer => dataset_read_integer
      procedure, private :: read_integer_rows => dataset_read_integer_rows
      procedure, private :: read_real => dataset_read_real
      procedure, private :: read_real_rows => dataset_read_real_rows
      procedure, private :: read_texts => dataset_read_texts
      procedure, private :: write_integer => dataset_write_integer
      procedure, private :: write_integer_part => dataset_write_integer_part
      procedure, private :: write_integer_row => dataset_write_integer_row
      procedure, private :: write_real => dataset_write_real
      procedure, private :: write_real_part => dataset_write_real_part
      procedure, private :: write_real_row => dataset_write_real_row
      procedure, private :: write_text_row => dataset_write_text_row
   end type h5_dataset_t

   !> Values in memory.
   type :: memory_t
      integer(hid_t) :: type = no_id                   ! of each value
      type(c_ptr) :: address = c_null_ptr
      integer :: n_values = 0
   end type memory_t

contains

   !> Closes the dataset; safe to call twice.
   subroutine dataset_close(self)
      class(h5_dataset_t), intent(inout) :: self
      integer :: status

      if (self%id /= no_id) call h5dclose_f(self%id, status)
      self%id = no_id
   end subroutine dataset_close

   !> Gives the extents, fastest first; empty for a scalar.
   pure function dataset_get_extents(self) result(extents)
      class(h5_dataset_t), intent(in) :: self
      integer, allocatable :: extents(:)
      extents = int(self%extents)
   end function dataset_get_extents

   !> Gives the byte of the file where the values begin that then follow each other, int32 or float64 with the least
   !> significant byte first (`value_size` 4, 8) or single bytes (1); -1 where the values stand there in another way.
   function dataset_get_offset(self, value_size) result(offset)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in) :: value_size                !! [byte]
      integer(int64) :: offset
      integer(hid_t) :: file_type
      integer(size_t) :: n_bytes
      integer(haddr_t) :: address
      integer :: status
      logical :: is_integer, is_real

      offset = -1
      call h5dget_type_f(self%id, file_type, status)
      if (status < 0) return
      call h5tget_size_f(file_type, n_bytes, status)
      if (status >= 0) call h5tequal_f(file_type, H5T_STD_I32LE, is_integer, status)
      if (status >= 0) call h5tequal_f(file_type, H5T_IEEE_F64LE, is_real, status)
      if (status >= 0 .and. n_bytes == value_size .and. (is_integer .or. is_real .or. value_size == 1)) then
         call h5dget_offset_f(self%id, address, status)              ! fails unless there is one address for all
         if (status >= 0) offset = int(address, int64)
      end if
      call h5tclose_f(file_type, status)
   end function dataset_get_offset

   ! Writing

   !> Writes the whole dataset.
   subroutine dataset_write_real(self, values, error)
      class(h5_dataset_t), intent(in) :: self
      real(wp), intent(in), contiguous, target :: values(..)
      type(error_t), allocatable, intent(out) :: error
      call transfer_values(self, .false., memory_t(H5T_NATIVE_DOUBLE, c_loc(values), size(values)), error)
   end subroutine dataset_write_real

   !> Writes the whole dataset.
   subroutine dataset_write_integer(self, values, error)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in), contiguous, target :: values(..)
      type(error_t), allocatable, intent(out) :: error
      call transfer_values(self, .false., memory_t(H5T_NATIVE_INTEGER, c_loc(values), size(values)), error)
   end subroutine dataset_write_integer

   !> Writes one whole row (all indices but the slowest), counted from 1, or several that follow each other;
   !> independent of other ranks.
   subroutine dataset_write_real_row(self, row, values, error, n_rows)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in) :: row
      real(wp), intent(in), contiguous, target :: values(..)
      type(error_t), allocatable, intent(out) :: error
      integer, intent(in), optional :: n_rows       !! default 1
      call transfer_values(self, .false., memory_t(H5T_NATIVE_DOUBLE, c_loc(values), size(values)), error, row, n_rows)
   end subroutine dataset_write_real_row

   !> Writes one whole row (all indices but the slowest), counted from 1, or several that follow each other;
   !> independent of other ranks.
   subroutine dataset_write_integer_row(self, row, values, error, n_rows)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in) :: row
      integer, intent(in), contiguous, target :: values(..)
      type(error_t), allocatable, intent(out) :: error
      integer, intent(in), optional :: n_rows       !! default 1
      call transfer_values(self, .false., memory_t(H5T_NATIVE_INTEGER, c_loc(values), size(values)), error, row, n_rows)
   end subroutine dataset_write_integer_row

   !> Writes the first `n_used` values along the second axis of one row, counted from 1; the others stay as they are.
   subroutine dataset_write_real_part(self, row, n_used, values, error)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in) :: row, n_used
      real(wp), intent(in), contiguous, target :: values(..)
      type(error_t), allocatable, intent(out) :: error
      call transfer_values(self, .false., memory_t(H5T_NATIVE_DOUBLE, c_loc(values), size(values)), error, row, n_used=n_used)
   end subroutine dataset_write_real_part

   !> Writes the first `n_used` values along the second axis of one row, counted from 1; the others stay as they are.
   subroutine dataset_write_integer_part(self, row, n_used, values, error)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in) :: row, n_used
      integer, intent(in), contiguous, target :: values(..)
      type(error_t), allocatable, intent(out) :: error
      call transfer_values(self, .false., memory_t(H5T_NATIVE_INTEGER, c_loc(values), size(values)), error, row, n_used=n_used)
   end subroutine dataset_write_integer_part

   !> Writes a string into row `row`, counted from 1, of a matrix of bytes; what is too long is cut.
   !> Independent of other ranks.
   subroutine dataset_write_text_row(self, row, text, error)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in) :: row
      character(*), intent(in) :: text
      type(error_t), allocatable, intent(out) :: error
      character(c_char), allocatable, target :: bytes(:)
      integer(hid_t) :: byte_type
      integer :: i, status

      if (size(self%extents) == 0) then
         call fail(error, self%place//" has no rows")
         return
      end if
      allocate (bytes(self%extents(1)), source=c_null_char)
      do i = 1, min(len(text), size(bytes))
         bytes(i) = text(i:i)
      end do
      call new_byte_type(byte_type, status)
      call check(status, "make the text type", error)
      if (allocated(error)) return
      call transfer_values(self, .false., memory_t(byte_type, c_loc(bytes), size(bytes)), error, row)
      call h5tclose_f(byte_type, status)
   end subroutine dataset_write_text_row

   !> Writes or reads the values of the dataset: all of them, or rows that follow each other; independent of other ranks.
   subroutine transfer_values(self, is_reading, memory, error, row, n_rows, n_used)
      class(h5_dataset_t), intent(in) :: self
      logical, intent(in) :: is_reading
      type(memory_t), intent(in) :: memory
      type(error_t), allocatable, intent(out) :: error
      integer, intent(in), optional :: row              !! the first of them, from 1; default: everything
      integer, intent(in), optional :: n_rows           !! default 1
      integer, intent(in), optional :: n_used           !! of the second axis; default: all
      type(c_ptr) :: buffer
      integer(hid_t) :: in_file, in_memory
      integer :: n, status

      in_file = H5S_ALL_F
      in_memory = H5S_ALL_F
      n = 1
      if (present(n_rows)) n = n_rows
      if (present(row)) then
         call select_rows(self, row, n, memory%n_values, in_file, in_memory, error, n_used)
      else
         call check_size(self, memory%n_values, product(self%extents), error)
      end if
      if (allocated(error) .or. memory%n_values == 0) return
      buffer = memory%address
      if (is_reading) then
         call h5dread_f(self%id, memory%type, buffer, status, in_memory, in_file)
      else
         call h5dwrite_f(self%id, memory%type, buffer, status, in_memory, in_file)
      end if
      call check(status, merge("read ", "write", is_reading), error, self%place)
      if (.not. present(row)) return
      call h5sclose_f(in_memory, status)
      call h5sclose_f(in_file, status)
   end subroutine transfer_values

   !> Selects rows that follow each other, and room for their values in memory; none for no values.
   subroutine select_rows(self, row, n_rows, n_values, in_file, in_memory, error, n_used)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in) :: row, n_rows, n_values
      integer(hid_t), intent(out) :: in_file, in_memory
      type(error_t), allocatable, intent(out) :: error
      integer, intent(in), optional :: n_used           !! of the second axis of a row, or of its only one; default: all
      integer(hsize_t) :: start(size(self%extents)), block(size(self%extents))
      integer :: last, n, status

      n = size(self%extents)
      if (n == 0) then
         call fail(error, self%place//" has no rows")
         return
      end if
      last = row + n_rows - 1
      block = self%extents
      block(n) = n_rows
      if (present(n_used)) block(min(2, n - 1)) = min(block(min(2, n - 1)), int(n_used, hsize_t))
      call check_size(self, n_values, product(block), error)
      if (allocated(error)) return
      if (row < 1 .or. last > self%extents(n)) then
         call fail(error, self%place//": no row "//to_text(merge(row, last, row < 1))//", there are "//to_text(self%extents(n)))
         return
      end if
      if (n_values == 0) return
      start = 0
      start(n) = row - 1
      call new_space(in_file, self%extents, status)
      if (status >= 0) call h5sselect_hyperslab_f(in_file, H5S_SELECT_SET_F, start, block, status)
      if (status >= 0) call new_space(in_memory, [int(n_values, hsize_t)], status)
      call check(status, "select rows of", error, self%place)
   end subroutine select_rows

   ! Reading

   !> Reads the whole dataset.
   subroutine dataset_read_real(self, values, error)
      class(h5_dataset_t), intent(in) :: self
      real(wp), intent(out), contiguous, target :: values(..)
      type(error_t), allocatable, intent(out) :: error
      call transfer_values(self, .true., memory_t(H5T_NATIVE_DOUBLE, c_loc(values), size(values)), error)
   end subroutine dataset_read_real

   !> Reads the whole dataset.
   subroutine dataset_read_integer(self, values, error)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(out), contiguous, target :: values(..)
      type(error_t), allocatable, intent(out) :: error
      call transfer_values(self, .true., memory_t(H5T_NATIVE_INTEGER, c_loc(values), size(values)), error)
   end subroutine dataset_read_integer

   !> Reads whole rows (all indices but the slowest) that follow each other, as many as there is room for; independent
   !> of other ranks.
   subroutine dataset_read_real_rows(self, first, values, error, n_used)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in) :: first                  !! row, from 1
      real(wp), intent(out), contiguous, target :: values(:, :)
      type(error_t), allocatable, intent(out) :: error
      integer, intent(in), optional :: n_used       !! of the second axis of a row, or of its only one; default: all
      call transfer_values(self, .true., memory_t(H5T_NATIVE_DOUBLE, c_loc(values), size(values)), error, first, size(values, 2), &
                           n_used)
   end subroutine dataset_read_real_rows

   !> Reads integers of rows that follow each other, which the last axis of the values counts.
   subroutine dataset_read_integer_rows(self, first, values, error, n_used)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in) :: first                  !! row, from 1
      integer, intent(inout), contiguous, target :: values(..)
      type(error_t), allocatable, intent(out) :: error
      integer, intent(in), optional :: n_used       !! of the second axis of a row, or of its only one; default: all
      call transfer_values(self, .true., memory_t(H5T_NATIVE_INTEGER, c_loc(values), size(values)), error, first, &
                           size(values, rank(values)), n_used)
   end subroutine dataset_read_integer_rows

   !> Reads a row of bytes as text without the zeros behind it.
   subroutine dataset_read_text_row(self, row, text, error)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in) :: row                    !! from 1
      character(:), allocatable, intent(out) :: text
      type(error_t), allocatable, intent(out) :: error
      character(c_char), allocatable, target :: bytes(:)
      integer(hid_t) :: byte_type
      integer :: i, n, status

      text = ""
      if (size(self%extents) == 0) then
         call fail(error, self%place//" has no rows")
         return
      end if
      allocate (bytes(self%extents(1)), source=c_null_char)
      call new_byte_type(byte_type, status)
      call check(status, "make the text type", error)
      if (allocated(error)) return
      call transfer_values(self, .true., memory_t(byte_type, c_loc(bytes), size(bytes)), error, row)
      call h5tclose_f(byte_type, status)
      n = findloc(bytes, c_null_char, dim=1) - 1
      if (n < 0) n = size(bytes)
      text = repeat(" ", n)
      do i = 1, n
         text(i:i) = bytes(i)
      end do
      text = trim(text)
   end subroutine dataset_read_text_row

   !> Reads a whole vector of strings, or a whole matrix of bytes, as a vector of strings padded with
   !> blanks.
   subroutine dataset_read_texts(self, values, error)
      class(h5_dataset_t), intent(in) :: self
      character(:), allocatable, intent(out) :: values(:)
      type(error_t), allocatable, intent(out) :: error
      integer(hid_t) :: text_type
      integer(size_t) :: n_bytes
      logical :: is_varying
      integer :: status

      call h5dget_type_f(self%id, text_type, status)
      if (status >= 0) call h5tis_variable_str_f(text_type, is_varying, status)
      if (status >= 0) call h5tget_size_f(text_type, n_bytes, status)
      call check(status, "read the text type", error)
      if (.not. allocated(error)) then
         if (.not. is_text_type(text_type)) then
            call fail(error, "is no text")
         else if (product(real(self%extents, wp)) > huge(1)) then
            call fail(error, "has more than "//to_text(huge(1))//" entries")
         else if (is_varying) then
            call read_varying(self, text_type, values, error)
         else if (n_bytes /= 1 .or. size(self%extents) == 0) then
            call fail(error, "is not an array of single letters")
         else
            call read_bytes(self, text_type, values, error)
         end if
         call h5tclose_f(text_type, status)
      end if
      call annotate(error, self%place)
   end subroutine dataset_read_texts

   subroutine read_varying(self, text_type, values, error)
      class(h5_dataset_t), intent(in) :: self
      integer(hid_t), intent(in) :: text_type
      character(:), allocatable, intent(out) :: values(:)
      type(error_t), allocatable, intent(out) :: error
      type(c_ptr), allocatable, target :: addresses(:)
      type(c_ptr) :: list
      integer(hid_t) :: space
      integer :: i, length, status

      allocate (addresses(product(self%extents)), stat=status)
      if (status /= 0) then
         call fail(error, "there is no memory for its "//to_text(product(self%extents))//" entries")
         return
      end if
      addresses = c_null_ptr
      list = c_loc(addresses)
      if (size(addresses) > 0) call h5dread_f(self%id, text_type, list, status)
      call check(status, "read", error)
      if (allocated(error)) return
      length = 0
      do i = 1, size(addresses)
         length = max(length, len(c_text(addresses(i))))
      end do
      allocate (character(length) :: values(size(addresses)), stat=status)
      if (status == 0) then
         do i = 1, size(addresses)
            values(i) = c_text(addresses(i))
         end do
      else
         call fail(error, "there is no memory for its "//to_text(size(addresses))//" texts of "//to_text(length)//" letters")
      end if
      call h5dget_space_f(self%id, space, status)
      if (size(addresses) > 0) call h5dvlen_reclaim_f(text_type, space, H5P_DEFAULT_F, list, status)
      call h5sclose_f(space, status)
   end subroutine read_varying

   subroutine read_bytes(self, byte_type, values, error)
      class(h5_dataset_t), intent(in) :: self
      integer(hid_t), intent(in) :: byte_type
      character(:), allocatable, intent(out) :: values(:)
      type(error_t), allocatable, intent(out) :: error
      character(c_char), allocatable, target :: bytes(:, :)
      type(c_ptr) :: address
      integer :: i, j, status

      allocate (bytes(self%extents(1), product(self%extents(2:))), stat=status)
      if (status /= 0) then
         call fail(error, "there is no memory for its "//to_text(product(self%extents))//" letters")
         return
      end if
      address = c_loc(bytes)
      call h5dread_f(self%id, byte_type, address, status)
      call check(status, "read", error)
      if (allocated(error)) return
      allocate (character(size(bytes, 1)) :: values(size(bytes, 2)), stat=status)
      if (status /= 0) then
         call fail(error, "there is no memory for its "//to_text(size(bytes, 2))//" texts")
         return
      end if
      do j = 1, size(values)
         values(j) = ""
         do i = 1, size(bytes, 1)
            if (bytes(i, j) /= c_null_char) values(j) (i:i) = bytes(i, j)
         end do
      end do
   end subroutine read_bytes

   subroutine check_size(self, n_values, n_expected, error)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in) :: n_values
      integer(hsize_t), intent(in) :: n_expected
      type(error_t), allocatable, intent(out) :: error

      if (n_values /= n_expected) &
         call fail(error, self%place//": "//to_text(n_values)//" values, expected "//to_text(n_expected))
   end subroutine check_size

   ! Dimension scales

   !> Makes the dataset, a vector, a dimension scale of the given name.
   subroutine dataset_make_scale(self, name, error)
      class(h5_dataset_t), intent(in) :: self
      character(*), intent(in) :: name
      type(error_t), allocatable, intent(out) :: error
      integer :: status

      call h5dsset_scale_f(self%id, status, name)
      call check(status, "make a dimension scale", error, self%place)
   end subroutine dataset_make_scale

   !> Attaches a scale to dimension `i`, counted from 1 for the fastest; the scale also names the
   !> dimension.
   subroutine dataset_attach_scale(self, i, scale, error)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in) :: i
      type(h5_dataset_t), intent(in) :: scale
      type(error_t), allocatable, intent(out) :: error
      integer :: status

      call h5dsattach_scale_f(self%id, scale%id, file_index(self, i), status)
      call check(status, "attach a dimension scale", error, self%place)
   end subroutine dataset_attach_scale

   !> Gives the dataset its unit, what it means and, if they are given, a scale for each dimension; nothing after an error.
   subroutine dataset_describe(self, units, long_name, error, scales)
      class(h5_dataset_t), intent(in) :: self
      character(*), intent(in) :: units, long_name
      type(error_t), allocatable, intent(inout) :: error
      type(h5_dataset_t), intent(in), optional :: scales(:)            !! fastest dimension first
      integer :: i

      if (present(scales)) then
         do i = 1, size(scales)
            if (.not. allocated(error)) call self%attach_scale(i, scales(i), error)
         end do
      end if
      if (.not. allocated(error)) call self%set_attribute("units", units, error)
      if (.not. allocated(error)) call self%set_attribute("long_name", long_name, error)
   end subroutine dataset_describe

   !> Says whether `scale` is attached to dimension `i`, counted from 1 for the fastest.
   function dataset_has_scale(self, i, scale) result(is_attached)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in) :: i
      type(h5_dataset_t), intent(in) :: scale
      logical :: is_attached
      integer :: status

      call h5dsis_attached_f(self%id, scale%id, file_index(self, i), is_attached, status)
      is_attached = is_attached .and. status >= 0
   end function dataset_has_scale

   !> Gives the number of a dimension in the order of the file: `h5ds`, unlike the rest of the Fortran
   !> interface, does not reverse it.
   pure integer function file_index(self, i)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in) :: i

      file_index = size(self%extents) - i + 1
   end function file_index
end module hb_hdf5_datasets
