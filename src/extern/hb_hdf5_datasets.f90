!> Datasets of a file: their values (all, or rows that a rank reads or writes independently) and their dimension
!> scales.
module hb_hdf5_datasets
   use, intrinsic :: iso_c_binding, only: c_loc, c_null_ptr, c_ptr
   use, intrinsic :: iso_fortran_env, only: int64, int8
   use h5ds, only: h5dsattach_scale_f, h5dsset_scale_f
   use hb_c_text, only: c_text
   use hb_error, only: annotate, error_t, fail
   use hb_hdf5_attributes, only: h5_object_t
   use hb_hdf5_library, only: bytes_of_kind, check, is_characters, is_integer, is_real, memory_type, new_space, no_id, &
      transfer_settings
   use hb_kinds, only: wp
   use hb_text, only: to_text
   use hdf5, only: h5dclose_f, h5dget_offset_f, h5dget_space_f, h5dget_type_f, h5dread_f, h5dvlen_reclaim_f, h5dwrite_f, &
      H5P_DEFAULT_F, H5S_ALL_F, H5S_SELECT_SET_F, h5sclose_f, h5sselect_hyperslab_f, H5T_IEEE_F64LE, H5T_STD_I32LE, h5tclose_f, &
      h5tequal_f, h5tget_size_f, h5tis_variable_str_f, haddr_t, hid_t, hsize_t, size_t
   implicit none
   private
   public :: h5_dataset_t

   !> An open dataset; closed with its file at the latest.
   !>
   !> `read` and `write` transfer values of any shape: the whole dataset, or with `first` contiguous rows (all indices
   !> but the slowest), as many as there are values, independently of other ranks; with `n_used` only the first
   !> `n_used` along the second axis of each row, or along its only one. Values are integers, reals, or bytes,
   !> according to the kind of the dataset.
   type, extends(h5_object_t) :: h5_dataset_t
      integer(hsize_t), allocatable :: extents(:)      ! fastest first
      integer :: kind = is_real                        ! of the values, hb_hdf5_library
   contains
      procedure :: close => dataset_close
      procedure :: describe => dataset_describe
      procedure :: get_extents => dataset_get_extents
      procedure :: get_offset => dataset_get_offset
      procedure :: make_scale => dataset_make_scale
      generic :: read => read_bytes, read_integers, read_reals, read_texts
      procedure :: read_text_row => dataset_read_text_row
      generic :: write => write_bytes, write_integers, write_reals
      procedure, private :: read_bytes => dataset_read_bytes
      procedure, private :: read_integers => dataset_read_integers
      procedure, private :: read_reals => dataset_read_reals
      procedure, private :: read_texts => dataset_read_texts
      procedure, private :: write_bytes => dataset_write_bytes
      procedure, private :: write_integers => dataset_write_integers
      procedure, private :: write_reals => dataset_write_reals
   end type h5_dataset_t

   !> Values in memory.
   type :: memory_t
      integer :: kind = is_real
      type(c_ptr) :: address = c_null_ptr
      integer(hsize_t) :: n_values = 0
   end type memory_t

contains

   !> Closes the dataset; safe to call twice.
   subroutine dataset_close(self)
      class(h5_dataset_t), intent(inout) :: self
      integer :: status

      if (self%id /= no_id) call h5dclose_f(self%id, status)
      self%id = no_id
   end subroutine dataset_close

   !> Returns the extents, fastest first; empty for a scalar.
   pure function dataset_get_extents(self) result(extents)
      class(h5_dataset_t), intent(in) :: self
      integer, allocatable :: extents(:)
      extents = int(self%extents)
   end function dataset_get_extents

   !> Returns the offset in the file of values that are contiguous and stored as int32 or float64 with the least
   !> significant byte first (`value_size` 4, 8) or as single bytes (1); -1 if they are stored in another form.
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

   ! Reading and writing

   !> Reads integers: the dataset, or rows of it.
   subroutine dataset_read_integers(self, values, error, first, n_used)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(inout), contiguous, target :: values(..)
      type(error_t), allocatable, intent(out) :: error
      integer, intent(in), optional :: first, n_used
      call transfer_values(self, .true., memory_t(is_integer, c_loc(values), size(values, kind=hsize_t)), error, first, n_used)
   end subroutine dataset_read_integers

   !> Reads real numbers: the dataset, or rows of it.
   subroutine dataset_read_reals(self, values, error, first, n_used)
      class(h5_dataset_t), intent(in) :: self
      real(wp), intent(inout), contiguous, target :: values(..)
      type(error_t), allocatable, intent(out) :: error
      integer, intent(in), optional :: first, n_used
      call transfer_values(self, .true., memory_t(is_real, c_loc(values), size(values, kind=hsize_t)), error, first, n_used)
   end subroutine dataset_read_reals

   !> Reads values as bytes: the dataset, or rows of it.
   subroutine dataset_read_bytes(self, values, error, first, n_used)
      class(h5_dataset_t), intent(in) :: self
      integer(int8), intent(inout), contiguous, target :: values(..)
      type(error_t), allocatable, intent(out) :: error
      integer, intent(in), optional :: first, n_used
      call transfer_values(self, .true., memory_t(self%kind, c_loc(values), size(values, kind=hsize_t)/bytes_of_kind(self%kind)), &
                           error, first, n_used)
   end subroutine dataset_read_bytes

   !> Writes integers: the dataset, or rows of it.
   subroutine dataset_write_integers(self, values, error, first, n_used)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in), contiguous, target :: values(..)
      type(error_t), allocatable, intent(out) :: error
      integer, intent(in), optional :: first, n_used
      call transfer_values(self, .false., memory_t(is_integer, c_loc(values), size(values, kind=hsize_t)), error, first, n_used)
   end subroutine dataset_write_integers

   !> Writes real numbers: the dataset, or rows of it.
   subroutine dataset_write_reals(self, values, error, first, n_used)
      class(h5_dataset_t), intent(in) :: self
      real(wp), intent(in), contiguous, target :: values(..)
      type(error_t), allocatable, intent(out) :: error
      integer, intent(in), optional :: first, n_used
      call transfer_values(self, .false., memory_t(is_real, c_loc(values), size(values, kind=hsize_t)), error, first, n_used)
   end subroutine dataset_write_reals

   !> Writes values given as bytes: the dataset, or rows of it.
   subroutine dataset_write_bytes(self, values, error, first, n_used)
      class(h5_dataset_t), intent(in) :: self
      integer(int8), intent(in), contiguous, target :: values(..)
      type(error_t), allocatable, intent(out) :: error
      integer, intent(in), optional :: first, n_used
      call transfer_values(self, .false., memory_t(self%kind, c_loc(values), size(values, kind=hsize_t)/bytes_of_kind(self%kind)), &
                           error, first, n_used)
   end subroutine dataset_write_bytes

   !> Writes or reads the values of the dataset: all of them, or contiguous rows.
   subroutine transfer_values(self, is_reading, memory, error, first, n_used)
      class(h5_dataset_t), intent(in) :: self
      logical, intent(in) :: is_reading
      type(memory_t), intent(in) :: memory
      type(error_t), allocatable, intent(out) :: error
      integer, intent(in), optional :: first            !! row, from 1; default: everything
      integer, intent(in), optional :: n_used           !! of the second axis; default: all
      type(c_ptr) :: buffer
      integer(hid_t) :: in_file, in_memory
      integer :: status

      in_file = H5S_ALL_F
      in_memory = H5S_ALL_F
      if (present(first)) then
         call select_rows(self, first, memory%n_values, in_file, in_memory, error, n_used)
      else if (memory%n_values /= product(self%extents)) then
         call fail(error, self%location//": "//to_text(memory%n_values)//" values, expected "//to_text(product(self%extents)))
      end if
      if (allocated(error) .or. memory%n_values == 0) return
      buffer = memory%address
      if (is_reading) then
         call h5dread_f(self%id, memory_type(memory%kind), buffer, status, in_memory, in_file, transfer_settings)
      else
         call h5dwrite_f(self%id, memory_type(memory%kind), buffer, status, in_memory, in_file, transfer_settings)
      end if
      call check(status, merge("read ", "write", is_reading), error, self%location)
      if (.not. present(first)) return
      call h5sclose_f(in_memory, status)
      call h5sclose_f(in_file, status)
   end subroutine transfer_values

   !> Selects contiguous rows in the file and memory for their values; an empty selection without values.
   subroutine select_rows(self, first, n_values, in_file, in_memory, error, n_used)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in) :: first
      integer(hsize_t), intent(in) :: n_values
      integer(hid_t), intent(out) :: in_file, in_memory
      type(error_t), allocatable, intent(out) :: error
      integer, intent(in), optional :: n_used
      integer(hsize_t) :: start(size(self%extents)), block(size(self%extents)), last, row_size
      integer :: n, status

      n = size(self%extents)
      if (n == 0) then
         call fail(error, self%location//" has no rows")
         return
      end if
      block = self%extents
      if (present(n_used) .and. n > 1) block(min(2, n - 1)) = min(block(min(2, n - 1)), int(n_used, hsize_t))
      row_size = product(block(:n - 1))
      block(n) = n_values/max(row_size, 1_hsize_t)
      last = first + block(n) - 1
      if (n_values /= row_size*block(n)) then
         call fail(error, self%location//": "//to_text(n_values)//" values, a row has "//to_text(row_size))
      else if (first < 1 .or. last > self%extents(n)) then
         call fail(error, self%location//": no row "//to_text(merge(int(first, hsize_t), last, first < 1))//", there are "// &
            to_text(self%extents(n)))
      end if
      if (n_values == 0 .or. allocated(error)) return
      start = 0
      start(n) = first - 1
      call new_space(in_file, self%extents, status)
      if (status >= 0) call h5sselect_hyperslab_f(in_file, H5S_SELECT_SET_F, start, block, status)
      if (status >= 0) call new_space(in_memory, [n_values], status)
      call check(status, "select rows of", error, self%location)
   end subroutine select_rows

   !> Reads a row of bytes as text without trailing zeros.
   subroutine dataset_read_text_row(self, row, text, error)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in) :: row                    !! from 1
      character(:), allocatable, intent(out) :: text
      type(error_t), allocatable, intent(out) :: error
      integer(int8), allocatable :: bytes(:)
      integer :: n

      text = ""
      if (self%kind /= is_characters .or. size(self%extents) /= 2) then
         call fail(error, self%location//" has no rows of text")
         return
      end if
      allocate (bytes(self%extents(1)), source=0_int8)
      call self%read(bytes, error, row)
      n = findloc(bytes, 0_int8, dim=1) - 1
      if (n < 0) n = size(bytes)
      text = trim(transfer(bytes(:n), repeat(" ", n)))
   end subroutine dataset_read_text_row

   !> Reads a whole vector of strings of any length, padded with blanks.
   subroutine dataset_read_texts(self, values, error)
      class(h5_dataset_t), intent(in) :: self
      character(:), allocatable, intent(out) :: values(:)
      type(error_t), allocatable, intent(out) :: error
      integer(hid_t) :: text_type
      integer :: status
      logical :: is_varying

      call h5dget_type_f(self%id, text_type, status)
      if (status >= 0) call h5tis_variable_str_f(text_type, is_varying, status)
      call check(status, "read the text type", error)
      if (.not. allocated(error)) then
         if (.not. is_varying) then
            call fail(error, "is not text of variable length")
         else if (product(real(self%extents, wp)) > huge(1)) then
            call fail(error, "has more than "//to_text(huge(1))//" entries")
         else
            call read_varying(self, text_type, values, error)
         end if
         call h5tclose_f(text_type, status)
      end if
      call annotate(error, self%location)
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
         call fail(error, "not enough memory for its "//to_text(product(self%extents))//" entries")
         return
      end if
      addresses = c_null_ptr
      list = c_loc(addresses)
      if (size(addresses) > 0) call h5dread_f(self%id, text_type, list, status, xfer_prp=transfer_settings)
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
         call fail(error, "not enough memory for its "//to_text(size(addresses))//" texts of "//to_text(length)//" letters")
      end if
      call h5dget_space_f(self%id, space, status)
      if (size(addresses) > 0) call h5dvlen_reclaim_f(text_type, space, H5P_DEFAULT_F, list, status)
      call h5sclose_f(space, status)
   end subroutine read_varying

   ! Dimension scales

   !> Makes the dataset, a vector, a dimension scale of the given name.
   subroutine dataset_make_scale(self, name, error)
      class(h5_dataset_t), intent(in) :: self
      character(*), intent(in) :: name
      type(error_t), allocatable, intent(out) :: error
      integer :: status

      call h5dsset_scale_f(self%id, status, name)
      call check(status, "make a dimension scale", error, self%location)
   end subroutine dataset_make_scale

   !> Sets the unit and meaning of the dataset and, if present, a scale for each dimension, which also names the
   !> dimension; does nothing after an error.
   subroutine dataset_describe(self, units, long_name, error, scales)
      class(h5_dataset_t), intent(in) :: self
      character(*), intent(in) :: units, long_name
      type(error_t), allocatable, intent(inout) :: error
      type(h5_dataset_t), intent(in), optional :: scales(:)            !! fastest dimension first
      integer :: i, status

      if (present(scales)) then
         do i = 1, size(scales)
            if (allocated(error)) return
            call h5dsattach_scale_f(self%id, scales(i)%id, file_index(self, i), status)
            call check(status, "attach a dimension scale", error, self%location)
         end do
      end if
      if (.not. allocated(error)) call self%set_attribute("units", units, error)
      if (.not. allocated(error)) call self%set_attribute("long_name", long_name, error)
   end subroutine dataset_describe

   !> Whether `scale` is attached to dimension `i`, counted from 1 for the fastest.
   !> Returns the number of a dimension in the order of the file: `h5ds`, unlike the rest of the Fortran interface,
   !> does not reverse it.
   pure integer function file_index(self, i)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in) :: i

      file_index = size(self%extents) - i + 1
   end function file_index
end module hb_hdf5_datasets
