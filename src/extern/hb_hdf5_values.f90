!> Values of datasets: whole ones, and rows that a rank writes alone.
submodule (hb_hdf5) hb_hdf5_values
   use, intrinsic :: iso_c_binding, only: c_char, c_loc, c_null_char, c_null_ptr, c_ptr
   use hb_error, only: fail
   use hb_hdf5_library, only: c_text, is_text_type, new_byte_type, new_space
   use hb_text, only: to_text
   use hdf5, only: h5dget_space_f, h5dget_type_f, h5dread_f, h5dvlen_reclaim_f, h5dwrite_f, H5P_DEFAULT_F, &
      H5S_ALL_F, H5S_SELECT_SET_F, h5sclose_f, h5sselect_hyperslab_f, H5T_NATIVE_DOUBLE, H5T_NATIVE_INTEGER, &
      h5tclose_f, h5tget_size_f, h5tis_variable_str_f, size_t
   implicit none

contains

   ! Writing

   module procedure dataset_write_real
      call write_all(self, H5T_NATIVE_DOUBLE, c_loc(values), size(values), error)
   end procedure dataset_write_real

   module procedure dataset_write_integer
      call write_all(self, H5T_NATIVE_INTEGER, c_loc(values), size(values), error)
   end procedure dataset_write_integer

   module procedure dataset_write_real_row
      call write_values_of_rows(self, row, H5T_NATIVE_DOUBLE, c_loc(values), size(values), error, n_rows)
   end procedure dataset_write_real_row

   module procedure dataset_write_integer_row
      call write_values_of_rows(self, row, H5T_NATIVE_INTEGER, c_loc(values), size(values), error, n_rows)
   end procedure dataset_write_integer_row

   module procedure dataset_write_text_row
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
      call write_values_of_rows(self, row, byte_type, c_loc(bytes), size(bytes), error)
      call h5tclose_f(byte_type, status)
   end procedure dataset_write_text_row

   subroutine write_all(self, memory_type, address, n_values, error)
      class(h5_dataset_t), intent(in) :: self
      integer(hid_t), intent(in) :: memory_type
      type(c_ptr), intent(in) :: address
      integer, intent(in) :: n_values
      type(error_t), allocatable, intent(out) :: error
      integer :: status

      call check_size(self, n_values, product(self%extents), error)
      if (allocated(error) .or. n_values == 0) return
      call h5dwrite_f(self%id, memory_type, address, status)
      call check(status, "write", error, self%place)
   end subroutine write_all

   subroutine write_values_of_rows(self, row, memory_type, address, n_values, error, n_rows)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in) :: row, n_values
      integer(hid_t), intent(in) :: memory_type
      type(c_ptr), intent(in) :: address
      type(error_t), allocatable, intent(out) :: error
      integer, intent(in), optional :: n_rows
      integer(hid_t) :: in_file, in_memory
      integer :: n, status

      n = 1
      if (present(n_rows)) n = n_rows
      call select_rows(self, row, n, n_values, in_file, in_memory, error)
      if (allocated(error) .or. n_values == 0) return
      call h5dwrite_f(self%id, memory_type, address, status, in_memory, in_file)
      call check(status, "write", error, self%place)
      call h5sclose_f(in_memory, status)
      call h5sclose_f(in_file, status)
   end subroutine write_values_of_rows

   !> Selects rows that follow each other, and room for their values in memory; none for no values.
   subroutine select_rows(self, row, n_rows, n_values, in_file, in_memory, error)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in) :: row, n_rows, n_values
      integer(hid_t), intent(out) :: in_file, in_memory
      type(error_t), allocatable, intent(out) :: error
      integer(hsize_t) :: start(size(self%extents)), block(size(self%extents))
      integer :: last, n, status

      n = size(self%extents)
      if (n == 0) then
         call fail(error, self%place//" has no rows")
         return
      end if
      last = row + n_rows - 1
      call check_size(self, n_values, product(self%extents(:n - 1))*n_rows, error)
      if (allocated(error)) return
      if (row < 1 .or. last > self%extents(n)) then
         call fail(error, self%place//": no row "//to_text(merge(row, last, row < 1))//", there are "//to_text(self%extents(n)))
         return
      end if
      if (n_values == 0) return
      start = 0
      start(n) = row - 1
      block = self%extents
      block(n) = n_rows
      call new_space(in_file, self%extents, status)
      if (status >= 0) call h5sselect_hyperslab_f(in_file, H5S_SELECT_SET_F, start, block, status)
      if (status >= 0) call new_space(in_memory, [int(n_values, hsize_t)], status)
      call check(status, "select rows of", error, self%place)
   end subroutine select_rows

   ! Reading

   module procedure dataset_read_real
      call read_all(self, H5T_NATIVE_DOUBLE, c_loc(values), size(values), error)
   end procedure dataset_read_real

   module procedure dataset_read_integer
      call read_all(self, H5T_NATIVE_INTEGER, c_loc(values), size(values), error)
   end procedure dataset_read_integer

   module procedure dataset_read_real_rows
      call read_values_of_rows(self, first, size(values, 2), H5T_NATIVE_DOUBLE, c_loc(values), size(values), error)
   end procedure dataset_read_real_rows

   module procedure dataset_read_integer_rows
      call read_values_of_rows(self, first, size(values), H5T_NATIVE_INTEGER, c_loc(values), size(values), error)
   end procedure dataset_read_integer_rows

   subroutine read_values_of_rows(self, first, n_rows, memory_type, address, n_values, error)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in) :: first, n_rows, n_values
      integer(hid_t), intent(in) :: memory_type
      type(c_ptr), intent(in) :: address
      type(error_t), allocatable, intent(out) :: error
      type(c_ptr) :: buffer
      integer(hid_t) :: in_file, in_memory
      integer :: status

      call select_rows(self, first, n_rows, n_values, in_file, in_memory, error)
      if (allocated(error) .or. n_values == 0) return
      buffer = address
      call h5dread_f(self%id, memory_type, buffer, status, in_memory, in_file)
      call check(status, "read", error, self%place)
      call h5sclose_f(in_memory, status)
      call h5sclose_f(in_file, status)
   end subroutine read_values_of_rows

   module procedure dataset_read_texts
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
   end procedure dataset_read_texts

   subroutine read_all(self, memory_type, address, n_values, error)
      class(h5_dataset_t), intent(in) :: self
      integer(hid_t), intent(in) :: memory_type
      type(c_ptr), intent(in) :: address
      integer, intent(in) :: n_values
      type(error_t), allocatable, intent(out) :: error
      type(c_ptr) :: buffer
      integer :: status

      call check_size(self, n_values, product(self%extents), error)
      if (allocated(error) .or. n_values == 0) return
      buffer = address
      call h5dread_f(self%id, memory_type, buffer, status, H5S_ALL_F, H5S_ALL_F)
      call check(status, "read", error, self%place)
   end subroutine read_all

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
      allocate (character(length) :: values(size(addresses)))
      do i = 1, size(addresses)
         values(i) = c_text(addresses(i))
      end do
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
      allocate (character(size(bytes, 1)) :: values(size(bytes, 2)))
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
end submodule hb_hdf5_values
