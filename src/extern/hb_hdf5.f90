!> HDF5 files in the few forms the program needs, with errors as values; the only module that uses `hdf5`.
!>
!> In the order of use: `create_file` (one process) makes a file, `add_...` its datasets with their space on
!> the disk, `make_scale`, `attach_scale` and `set_attribute` describe them, `close` ends.
!> `open_file_parallel` then opens it on all ranks, and `write_row` puts raw data in place: it changes no
!> metadata, so ranks need not agree on anything and a killed run leaves a sound file.
!>
!> Extents are given in the order of Fortran, fastest first: h5py, h5dump and xarray show them reversed.
!> Datasets are contiguous, never compressed. Messages of the library are not printed but put into the error.
!> Source: HDF5 1.10 Reference Manual; HDF5 Dimension Scale Specification.
module hb_hdf5
   use, intrinsic :: iso_c_binding, only: c_char, c_f_pointer, c_funloc, c_funptr, c_int, c_int64_t, c_loc, &
      c_null_char, c_null_ptr, c_ptr, c_size_t
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use h5ds, only: h5dsattach_scale_f, h5dsis_attached_f, h5dsset_scale_f
   use hb_error, only: annotate, error_t, fail
   use hb_kinds, only: wp
   use hb_mpi, only: comm_handle, comm_t, no_info_handle
   use hb_text, only: to_text
   use hdf5, only: h5aclose_f, h5acreate_f, h5aget_space_f, h5aopen_f, h5aread_f, h5awrite_f, &
      H5D_ALLOC_TIME_EARLY_F, H5D_FILL_TIME_ALLOC_F, h5dclose_f, h5dcreate_f, h5dget_space_f, &
      h5dget_type_f, h5dopen_f, h5dread_f, h5dvlen_reclaim_f, h5dwrite_f, h5eset_auto_f, H5F_ACC_EXCL_F, &
      H5F_ACC_RDONLY_F, H5F_ACC_RDWR_F, H5F_ACC_TRUNC_F, H5F_CLOSE_STRONG_F, h5fclose_f, h5fcreate_f, &
      h5fopen_f, h5open_f, H5P_DATASET_CREATE_F, H5P_DEFAULT_F, H5P_FILE_ACCESS_F, h5pclose_f, &
      h5pcreate_f, h5pset_alloc_time_f, h5pset_fapl_mpio_f, h5pset_fclose_degree_f, h5pset_fill_time_f, &
      h5pset_fill_value_f, H5S_ALL_F, H5S_SCALAR_F, H5S_SELECT_SET_F, h5sclose_f, h5screate_f, &
      h5screate_simple_f, h5sget_simple_extent_dims_f, h5sget_simple_extent_ndims_f, &
      h5sselect_hyperslab_f, H5T_C_S1, H5T_CSET_UTF8_F, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, &
      H5T_NATIVE_INTEGER, H5T_STD_I32LE, H5T_STR_NULLPAD_F, H5T_STRING, h5tclose_f, h5tcopy_f, &
      h5tis_variable_str_f, h5tset_cset_f, h5tset_strpad_f, hid_t, hsize_t
   implicit none
   private
   public :: create_file, h5_dataset_t, h5_file_t, open_file, open_file_parallel

   integer(hid_t), parameter :: no_id = -1
   integer, parameter :: max_cause = 512               ! characters kept of what the library says
   logical :: is_library_open = .false.

   !> What attributes can be given to: a file (its root group) or a dataset.
   type :: h5_object_t
      private
      integer(hid_t) :: id = no_id
      character(:), allocatable :: place               ! how messages name it
   contains
      generic :: get_attribute => get_integer_attribute, get_text_attribute
      generic :: set_attribute => set_integer_attribute, set_integers_attribute, set_text_attribute
      procedure, private :: get_integer_attribute => object_get_integer_attribute
      procedure, private :: get_text_attribute => object_get_text_attribute
      procedure, private :: set_integer_attribute => object_set_integer_attribute
      procedure, private :: set_integers_attribute => object_set_integers_attribute
      procedure, private :: set_text_attribute => object_set_text_attribute
   end type h5_object_t

   !> An open dataset; closed with its file at the latest.
   type, extends(h5_object_t) :: h5_dataset_t
      private
      integer(hsize_t), allocatable :: extents(:)      ! fastest first
   contains
      procedure :: attach_scale => dataset_attach_scale
      procedure :: close => dataset_close
      procedure :: get_extents => dataset_get_extents
      procedure :: has_scale => dataset_has_scale
      procedure :: make_scale => dataset_make_scale
      generic :: read => read_integer, read_real, read_texts
      generic :: write => write_integer, write_real
      generic :: write_row => write_integer_row, write_real_row, write_text_row
      procedure, private :: read_integer => dataset_read_integer
      procedure, private :: read_real => dataset_read_real
      procedure, private :: read_texts => dataset_read_texts
      procedure, private :: write_integer => dataset_write_integer
      procedure, private :: write_integer_row => dataset_write_integer_row
      procedure, private :: write_real => dataset_write_real
      procedure, private :: write_real_row => dataset_write_real_row
      procedure, private :: write_text_row => dataset_write_text_row
   end type h5_dataset_t

   !> An open file. All data stand in its root group.
   type, extends(h5_object_t) :: h5_file_t
   contains
      procedure :: add_characters => file_add_characters
      procedure :: add_integer => file_add_integer
      procedure :: add_real => file_add_real
      procedure :: add_text => file_add_text
      procedure :: add_texts => file_add_texts
      procedure :: close => file_close
      procedure :: open_dataset => file_open_dataset
   end type h5_file_t

   !> H5E_error2_t of H5Epublic.h: one entry of the library's stack of errors.
   type, bind(c) :: stack_entry_t
      integer(c_int64_t) :: class, major, minor
      integer(c_int) :: line
      type(c_ptr) :: procedure_name, file_name, description
   end type stack_entry_t

   !> What the callback of `H5Ewalk2` fills.
   type, bind(c) :: cause_t
      character(c_char) :: text(max_cause)
      integer(c_int) :: length = 0
   end type cause_t

   interface
      !> Visits the stack of errors; the Fortran interface has only a way to print it.
      integer(c_int) function h5ewalk2(stack, direction, visit, data) bind(c, name="H5Ewalk2")
         import :: c_funptr, c_int, c_int64_t, c_ptr
         integer(c_int64_t), value :: stack
         integer(c_int), value :: direction            !! 0: innermost first
         type(c_funptr), value :: visit
         type(c_ptr), value :: data
      end function h5ewalk2

      pure integer(c_size_t) function c_strlen(text) bind(c, name="strlen")
         import :: c_ptr, c_size_t
         type(c_ptr), intent(in), value :: text
      end function c_strlen
   end interface

contains

   ! Files

   !> Makes a new file for this process alone. An existing file is an error, or is replaced when `replace` is
   !> true.
   subroutine create_file(self, path, replace, error)
      type(h5_file_t), intent(out) :: self
      character(*), intent(in) :: path
      logical, intent(in) :: replace
      type(error_t), allocatable, intent(out) :: error
      integer(hid_t) :: access
      integer :: status

      self%place = "file '"//path//"'"
      call new_file_access(access, error)
      if (.not. allocated(error)) then
         call h5fcreate_f(path, merge(H5F_ACC_TRUNC_F, H5F_ACC_EXCL_F, replace), self%id, status, &
                          access_prp=access)
         call check(status, "create", error)
         call h5pclose_f(access, status)
      end if
      if (allocated(error)) self%id = no_id
      call annotate(error, self%place)
   end subroutine create_file

   !> Opens a file for reading by this process alone.
   subroutine open_file(self, path, error)
      type(h5_file_t), intent(out) :: self
      character(*), intent(in) :: path
      type(error_t), allocatable, intent(out) :: error
      integer(hid_t) :: access
      integer :: status

      self%place = "file '"//path//"'"
      call new_file_access(access, error)
      if (.not. allocated(error)) then
         call h5fopen_f(path, H5F_ACC_RDONLY_F, self%id, status, access)
         call check(status, "open", error)
         call h5pclose_f(access, status)
      end if
      if (allocated(error)) self%id = no_id
      call annotate(error, self%place)
   end subroutine open_file

   !> Opens a file for writing on all ranks of `comm`; collective, and so is its `close`. Raw data may then be
   !> written by any rank alone. The error is that of this rank.
   subroutine open_file_parallel(self, path, comm, error)
      type(h5_file_t), intent(out) :: self
      character(*), intent(in) :: path
      type(comm_t), intent(in) :: comm
      type(error_t), allocatable, intent(out) :: error
      integer(hid_t) :: access
      integer :: status

      self%place = "file '"//path//"'"
      call new_file_access(access, error)
      if (.not. allocated(error)) then
         call h5pset_fapl_mpio_f(access, comm_handle(comm), no_info_handle(), status)
         call check(status, "choose MPI access", error)
         if (.not. allocated(error)) then
            call h5fopen_f(path, H5F_ACC_RDWR_F, self%id, status, access)
            call check(status, "open for parallel writing", error)
         end if
         call h5pclose_f(access, status)
      end if
      if (allocated(error)) self%id = no_id
      call annotate(error, self%place)
   end subroutine open_file_parallel

   !> Makes a list of access properties: whatever is still open in the file is closed with it.
   subroutine new_file_access(access, error)
      integer(hid_t), intent(out) :: access
      type(error_t), allocatable, intent(out) :: error
      integer :: status

      access = no_id
      if (.not. is_library_open) then
         call h5open_f(status)
         if (status < 0) then
            call fail(error, "cannot start the HDF5 library")
            return
         end if
         call h5eset_auto_f(0, status)
         is_library_open = .true.
      end if
      call h5pcreate_f(H5P_FILE_ACCESS_F, access, status)
      call check(status, "make the access properties", error)
      if (allocated(error)) return
      call h5pset_fclose_degree_f(access, H5F_CLOSE_STRONG_F, status)
      call check(status, "set the access properties", error)
      if (allocated(error)) call h5pclose_f(access, status)
   end subroutine new_file_access

   !> Closes the file with all its datasets; safe to call twice.
   subroutine file_close(self, error)
      class(h5_file_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error
      integer :: status

      if (self%id == no_id) return
      call h5fclose_f(self%id, status)
      call check(status, "close", error)
      call annotate(error, self%place)
      self%id = no_id
   end subroutine file_close

   ! Datasets

   !> Adds a dataset of float64, filled with NaN, its space taken on the disk.
   subroutine file_add_real(self, name, extents, dataset, error)
      class(h5_file_t), intent(in) :: self
      character(*), intent(in) :: name
      integer, intent(in) :: extents(:)                !! fastest first; empty for a scalar
      type(h5_dataset_t), intent(out) :: dataset
      type(error_t), allocatable, intent(out) :: error
      real(wp), target :: fill

      fill = ieee_value(fill, ieee_quiet_nan)
      call add_dataset(self, name, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, extents, c_loc(fill), dataset, error)
   end subroutine file_add_real

   !> Adds a dataset of int32, filled with zero, its space taken on the disk.
   subroutine file_add_integer(self, name, extents, dataset, error)
      class(h5_file_t), intent(in) :: self
      character(*), intent(in) :: name
      integer, intent(in) :: extents(:)                !! fastest first; empty for a scalar
      type(h5_dataset_t), intent(out) :: dataset
      type(error_t), allocatable, intent(out) :: error
      integer, target :: fill

      fill = 0
      call add_dataset(self, name, H5T_STD_I32LE, H5T_NATIVE_INTEGER, extents, c_loc(fill), dataset, error)
   end subroutine file_add_integer

   !> Adds a dataset of single bytes, all null, its space taken on the disk: the first extent is the room for
   !> a string.
   !>
   !> Strings of fixed length would be shorter to describe, but netCDF-C before 4.9.1 crashes on them, and
   !> parallel HDF5 cannot write strings of any length.
   subroutine file_add_characters(self, name, extents, dataset, error)
      class(h5_file_t), intent(in) :: self
      character(*), intent(in) :: name
      integer, intent(in) :: extents(:)                !! fastest first
      type(h5_dataset_t), intent(out) :: dataset
      type(error_t), allocatable, intent(out) :: error
      integer(hid_t) :: byte_type
      integer :: status

      call new_byte_type(byte_type, status)
      call check(status, "make the text type", error)
      if (allocated(error)) return
      call add_dataset(self, name, byte_type, no_id, extents, c_null_ptr, dataset, error)
      call h5tclose_f(byte_type, status)
   end subroutine file_add_characters

   !> Adds a vector of strings of any length and writes it; blanks at the ends are dropped. For serial files
   !> only: the library cannot write such strings in parallel.
   subroutine file_add_texts(self, name, values, dataset, error)
      class(h5_file_t), intent(in) :: self
      character(*), intent(in) :: name
      character(*), intent(in) :: values(:)
      type(h5_dataset_t), intent(out) :: dataset
      type(error_t), allocatable, intent(out) :: error
      character(c_char), allocatable, target :: bytes(:)
      type(c_ptr), allocatable, target :: addresses(:)
      integer :: i, j, first, length

      allocate (bytes(sum(len_trim(values)) + size(values)), addresses(size(values)))
      first = 1
      do i = 1, size(values)
         length = len_trim(values(i))
         do j = 1, length
            bytes(first + j - 1) = values(i) (j:j)
         end do
         bytes(first + length) = c_null_char
         addresses(i) = c_loc(bytes(first))
         first = first + length + 1
      end do
      call add_varying(self, name, [size(values)], addresses, dataset, error)
   end subroutine file_add_texts

   !> Adds one string of any length and writes it, byte by byte as given. For serial files only.
   subroutine file_add_text(self, name, value, dataset, error)
      class(h5_file_t), intent(in) :: self
      character(*), intent(in) :: name
      character(*), intent(in) :: value
      type(h5_dataset_t), intent(out) :: dataset
      type(error_t), allocatable, intent(out) :: error
      character(:), allocatable, target :: bytes
      type(c_ptr), target :: addresses(1)

      bytes = value//c_null_char
      addresses(1) = c_loc(bytes)
      call add_varying(self, name, [integer ::], addresses, dataset, error)
   end subroutine file_add_text

   subroutine add_varying(self, name, extents, addresses, dataset, error)
      class(h5_file_t), intent(in) :: self
      character(*), intent(in) :: name
      integer, intent(in) :: extents(:)
      type(c_ptr), intent(in), target :: addresses(:)  !! of the strings, which end with a null
      type(h5_dataset_t), intent(out) :: dataset
      type(error_t), allocatable, intent(out) :: error
      integer(hid_t) :: text_type
      integer :: status

      call new_text_type(text_type, status)
      call check(status, "make the text type", error)
      if (allocated(error)) return
      call add_dataset(self, name, text_type, no_id, extents, c_null_ptr, dataset, error)
      if (.not. allocated(error) .and. size(addresses) > 0) then
         call h5dwrite_f(dataset%id, text_type, c_loc(addresses), status)
         call check(status, "write", error)
         call annotate(error, dataset%place)
      end if
      call h5tclose_f(text_type, status)
   end subroutine add_varying

   !> Adds a dataset of any type with early allocation; without an address of a fill value the fill is zero
   !> bytes.
   subroutine add_dataset(file, name, file_type, fill_type, extents, fill, dataset, error)
      class(h5_file_t), intent(in) :: file
      character(*), intent(in) :: name
      integer(hid_t), intent(in) :: file_type, fill_type
      integer, intent(in) :: extents(:)
      type(c_ptr), intent(in) :: fill
      type(h5_dataset_t), intent(out) :: dataset
      type(error_t), allocatable, intent(out) :: error
      integer(hid_t) :: properties, space
      integer :: status

      dataset%place = file%place//": dataset '"//name//"'"
      dataset%extents = int(extents, hsize_t)
      call new_space(space, dataset%extents, status)
      if (status >= 0) call h5pcreate_f(H5P_DATASET_CREATE_F, properties, status)
      if (status >= 0) call h5pset_alloc_time_f(properties, H5D_ALLOC_TIME_EARLY_F, status)
      if (status >= 0) call h5pset_fill_time_f(properties, H5D_FILL_TIME_ALLOC_F, status)
      if (status >= 0 .and. fill_type /= no_id) call h5pset_fill_value_f(properties, fill_type, fill, status)
      if (status >= 0) call h5dcreate_f(file%id, name, file_type, space, dataset%id, status, properties)
      call check(status, "create", error)
      if (allocated(error)) then
         dataset%id = no_id
         call annotate(error, dataset%place)
         return
      end if
      call h5pclose_f(properties, status)
      call h5sclose_f(space, status)
   end subroutine add_dataset

   !> Opens a dataset of the file.
   subroutine file_open_dataset(self, name, dataset, error)
      class(h5_file_t), intent(in) :: self
      character(*), intent(in) :: name
      type(h5_dataset_t), intent(out) :: dataset
      type(error_t), allocatable, intent(out) :: error
      integer(hsize_t), allocatable :: max_extents(:)
      integer(hid_t) :: space
      integer :: n_dimensions, status

      dataset%place = self%place//": dataset '"//name//"'"
      call h5dopen_f(self%id, name, dataset%id, status)
      call check(status, "open", error)
      if (allocated(error)) then
         dataset%id = no_id
         call annotate(error, dataset%place)
         return
      end if
      call h5dget_space_f(dataset%id, space, status)
      if (status >= 0) call h5sget_simple_extent_ndims_f(space, n_dimensions, status)
      if (status >= 0) then
         allocate (dataset%extents(n_dimensions), max_extents(n_dimensions))
         if (n_dimensions > 0) call h5sget_simple_extent_dims_f(space, dataset%extents, max_extents, status)
      end if
      call check(status, "ask for the extents", error)
      call annotate(error, dataset%place)
      if (.not. allocated(error)) call h5sclose_f(space, status)
   end subroutine file_open_dataset

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

   ! Dimension scales

   !> Makes the dataset, a vector, a dimension scale of the given name.
   subroutine dataset_make_scale(self, name, error)
      class(h5_dataset_t), intent(in) :: self
      character(*), intent(in) :: name
      type(error_t), allocatable, intent(out) :: error
      integer :: status

      call h5dsset_scale_f(self%id, status, name)
      call check(status, "make a dimension scale", error)
      call annotate(error, self%place)
   end subroutine dataset_make_scale

   !> Attaches a scale to dimension `i`, counted from 1 for the fastest; the scale also names the dimension.
   subroutine dataset_attach_scale(self, i, scale, error)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in) :: i
      type(h5_dataset_t), intent(in) :: scale
      type(error_t), allocatable, intent(out) :: error
      integer :: status

      call h5dsattach_scale_f(self%id, scale%id, file_index(self, i), status)
      call check(status, "attach a dimension scale", error)
      call annotate(error, self%place)
   end subroutine dataset_attach_scale

   !> Says whether `scale` is attached to dimension `i`, counted from 1 for the fastest.
   logical function dataset_has_scale(self, i, scale)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in) :: i
      type(h5_dataset_t), intent(in) :: scale
      integer :: status

      call h5dsis_attached_f(self%id, scale%id, file_index(self, i), dataset_has_scale, status)
      dataset_has_scale = dataset_has_scale .and. status >= 0
   end function dataset_has_scale

   !> Gives the number of a dimension in the order of the file: `h5ds`, unlike the rest of the Fortran
   !> interface, does not reverse it.
   pure integer function file_index(self, i)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in) :: i

      file_index = size(self%extents) - i + 1
   end function file_index

   ! Writing and reading

   !> Writes the whole dataset.
   subroutine dataset_write_real(self, values, error)
      class(h5_dataset_t), intent(in) :: self
      real(wp), intent(in), contiguous, target :: values(..)
      type(error_t), allocatable, intent(out) :: error

      call write_all(self, H5T_NATIVE_DOUBLE, c_loc(values), size(values), error)
   end subroutine dataset_write_real

   !> Writes the whole dataset.
   subroutine dataset_write_integer(self, values, error)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in), contiguous, target :: values(..)
      type(error_t), allocatable, intent(out) :: error

      call write_all(self, H5T_NATIVE_INTEGER, c_loc(values), size(values), error)
   end subroutine dataset_write_integer

   !> Writes one whole row (all indices but the slowest), counted from 1; independent of other ranks.
   subroutine dataset_write_real_row(self, row, values, error)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in) :: row
      real(wp), intent(in), contiguous, target :: values(..)
      type(error_t), allocatable, intent(out) :: error

      call write_values_of_row(self, row, H5T_NATIVE_DOUBLE, c_loc(values), size(values), error)
   end subroutine dataset_write_real_row

   !> Writes one whole row (all indices but the slowest), counted from 1; independent of other ranks.
   subroutine dataset_write_integer_row(self, row, values, error)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in) :: row
      integer, intent(in), contiguous, target :: values(..)
      type(error_t), allocatable, intent(out) :: error

      call write_values_of_row(self, row, H5T_NATIVE_INTEGER, c_loc(values), size(values), error)
   end subroutine dataset_write_integer_row

   !> Writes a string into row `row`, counted from 1, of a matrix of bytes; what is too long is cut.
   !> Independent of other ranks.
   subroutine dataset_write_text_row(self, row, text, error)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in) :: row
      character(*), intent(in) :: text
      type(error_t), allocatable, intent(out) :: error
      character(c_char), target :: bytes(self%extents(1))
      integer(hid_t) :: byte_type
      integer :: i, status

      bytes = c_null_char
      do i = 1, min(len(text), size(bytes))
         bytes(i) = text(i:i)
      end do
      call new_byte_type(byte_type, status)
      call check(status, "make the text type", error)
      if (allocated(error)) return
      call write_values_of_row(self, row, byte_type, c_loc(bytes), size(bytes), error)
      call h5tclose_f(byte_type, status)
   end subroutine dataset_write_text_row

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
      call check(status, "write", error)
      call annotate(error, self%place)
   end subroutine write_all

   subroutine write_values_of_row(self, row, memory_type, address, n_values, error)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in) :: row, n_values
      integer(hid_t), intent(in) :: memory_type
      type(c_ptr), intent(in) :: address
      type(error_t), allocatable, intent(out) :: error
      integer(hsize_t) :: start(size(self%extents)), block(size(self%extents))
      integer(hid_t) :: in_file, in_memory
      integer :: n, status

      n = size(self%extents)
      call check_size(self, n_values, product(self%extents(:n - 1)), error)
      if (allocated(error)) return
      if (row < 1 .or. row > self%extents(n)) then
         call fail(error, self%place//": no row "//to_text(row)//", there are "//to_text(self%extents(n)))
         return
      end if
      if (n_values == 0) return
      start = 0
      start(n) = row - 1
      block = self%extents
      block(n) = 1
      call new_space(in_file, self%extents, status)
      if (status >= 0) call h5sselect_hyperslab_f(in_file, H5S_SELECT_SET_F, start, block, status)
      if (status >= 0) call new_space(in_memory, [int(n_values, hsize_t)], status)
      if (status >= 0) call h5dwrite_f(self%id, memory_type, address, status, in_memory, in_file)
      call check(status, "write", error)
      call annotate(error, self%place)
      if (allocated(error)) return
      call h5sclose_f(in_memory, status)
      call h5sclose_f(in_file, status)
   end subroutine write_values_of_row

   !> Reads the whole dataset.
   subroutine dataset_read_real(self, values, error)
      class(h5_dataset_t), intent(in) :: self
      real(wp), intent(out), contiguous, target :: values(..)
      type(error_t), allocatable, intent(out) :: error

      call read_all(self, H5T_NATIVE_DOUBLE, c_loc(values), size(values), error)
   end subroutine dataset_read_real

   !> Reads the whole dataset.
   subroutine dataset_read_integer(self, values, error)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(out), contiguous, target :: values(..)
      type(error_t), allocatable, intent(out) :: error

      call read_all(self, H5T_NATIVE_INTEGER, c_loc(values), size(values), error)
   end subroutine dataset_read_integer

   !> Reads a whole vector of strings, or a whole matrix of bytes, as a vector of strings padded with blanks.
   subroutine dataset_read_texts(self, values, error)
      class(h5_dataset_t), intent(in) :: self
      character(:), allocatable, intent(out) :: values(:)
      type(error_t), allocatable, intent(out) :: error
      integer(hid_t) :: text_type
      logical :: is_varying
      integer :: status

      call h5dget_type_f(self%id, text_type, status)
      if (status >= 0) call h5tis_variable_str_f(text_type, is_varying, status)
      call check(status, "read the text type", error)
      if (.not. allocated(error)) then
         if (is_varying) then
            call read_varying(self, text_type, values, error)
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
      type(c_ptr), target :: addresses(product(self%extents))
      type(c_ptr) :: list
      integer(hid_t) :: space
      integer :: i, length, status

      status = 0
      list = c_loc(addresses)
      if (size(addresses) > 0) call h5dread_f(self%id, text_type, list, status)
      call check(status, "read", error)
      if (allocated(error)) return
      length = 0
      do i = 1, size(addresses)
         length = max(length, int(c_strlen(addresses(i))))
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
      character(c_char), target :: bytes(self%extents(1), product(self%extents(2:)))
      type(c_ptr) :: address
      integer :: i, j, status

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
      call check(status, "read", error)
      call annotate(error, self%place)
   end subroutine read_all

   subroutine check_size(self, n_values, n_expected, error)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in) :: n_values
      integer(hsize_t), intent(in) :: n_expected
      type(error_t), allocatable, intent(out) :: error

      if (n_values /= n_expected) &
         call fail(error, self%place//": "//to_text(n_values)//" values, expected "//to_text(n_expected))
   end subroutine check_size

   ! Attributes

   !> Gives the object an attribute of one string, any length; for serial files only.
   subroutine object_set_text_attribute(self, name, value, error)
      class(h5_object_t), intent(in) :: self
      character(*), intent(in) :: name
      character(*), intent(in) :: value
      type(error_t), allocatable, intent(out) :: error
      character(:), allocatable, target :: bytes
      type(c_ptr), target :: address
      integer(hid_t) :: text_type
      integer :: status

      bytes = value//c_null_char
      address = c_loc(bytes)
      call new_text_type(text_type, status)
      call check(status, "make the text type", error)
      if (allocated(error)) return
      call set_attribute(self, name, text_type, text_type, [integer(hsize_t) ::], c_loc(address), error)
      call h5tclose_f(text_type, status)
   end subroutine object_set_text_attribute

   !> Gives the object an attribute of one integer.
   subroutine object_set_integer_attribute(self, name, value, error)
      class(h5_object_t), intent(in) :: self
      character(*), intent(in) :: name
      integer, intent(in) :: value
      type(error_t), allocatable, intent(out) :: error
      integer, target :: copy

      copy = value
      call set_attribute(self, name, H5T_STD_I32LE, H5T_NATIVE_INTEGER, [integer(hsize_t) ::], &
         c_loc(copy), error)
   end subroutine object_set_integer_attribute

   !> Gives the object an attribute of several integers.
   subroutine object_set_integers_attribute(self, name, values, error)
      class(h5_object_t), intent(in) :: self
      character(*), intent(in) :: name
      integer, intent(in), contiguous, target :: values(:)
      type(error_t), allocatable, intent(out) :: error

      call set_attribute(self, name, H5T_STD_I32LE, H5T_NATIVE_INTEGER, [size(values, kind=hsize_t)], &
         c_loc(values), error)
   end subroutine object_set_integers_attribute

   subroutine set_attribute(self, name, file_type, memory_type, extents, address, error)
      class(h5_object_t), intent(in) :: self
      character(*), intent(in) :: name
      integer(hid_t), intent(in) :: file_type, memory_type
      integer(hsize_t), intent(in) :: extents(:)
      type(c_ptr), intent(in) :: address
      type(error_t), allocatable, intent(out) :: error
      integer(hid_t) :: attribute, space
      integer :: status

      call new_space(space, extents, status)
      if (status >= 0) call h5acreate_f(self%id, name, file_type, space, attribute, status)
      if (status >= 0) call h5awrite_f(attribute, memory_type, address, status)
      call check(status, "set attribute '"//name//"'", error)
      call annotate(error, self%place)
      if (allocated(error)) return
      call h5aclose_f(attribute, status)
      call h5sclose_f(space, status)
   end subroutine set_attribute

   !> Reads an attribute of one string.
   subroutine object_get_text_attribute(self, name, value, error)
      class(h5_object_t), intent(in) :: self
      character(*), intent(in) :: name
      character(:), allocatable, intent(out) :: value
      type(error_t), allocatable, intent(out) :: error
      type(c_ptr), target :: addresses(1)
      type(c_ptr) :: list
      integer(hid_t) :: attribute, space, text_type
      integer :: status

      list = c_loc(addresses)
      call h5aopen_f(self%id, name, attribute, status)
      if (status >= 0) call new_text_type(text_type, status)
      if (status >= 0) call h5aread_f(attribute, text_type, list, status)
      call check(status, "read attribute '"//name//"'", error)
      call annotate(error, self%place)
      if (allocated(error)) return
      value = c_text(addresses(1))
      call h5aget_space_f(attribute, space, status)
      call h5dvlen_reclaim_f(text_type, space, H5P_DEFAULT_F, list, status)
      call h5sclose_f(space, status)
      call h5tclose_f(text_type, status)
      call h5aclose_f(attribute, status)
   end subroutine object_get_text_attribute

   !> Reads an attribute of one integer.
   subroutine object_get_integer_attribute(self, name, value, error)
      class(h5_object_t), intent(in) :: self
      character(*), intent(in) :: name
      integer, intent(out) :: value
      type(error_t), allocatable, intent(out) :: error
      integer(hid_t) :: attribute
      type(c_ptr) :: address                           ! the library wants variables for addresses
      integer, target :: found
      integer :: status

      found = 0
      address = c_loc(found)
      call h5aopen_f(self%id, name, attribute, status)
      if (status >= 0) call h5aread_f(attribute, H5T_NATIVE_INTEGER, address, status)
      call check(status, "read attribute '"//name//"'", error)
      call annotate(error, self%place)
      value = found
      if (.not. allocated(error)) call h5aclose_f(attribute, status)
   end subroutine object_get_integer_attribute

   ! Small parts

   subroutine new_space(space, extents, status)
      integer(hid_t), intent(out) :: space
      integer(hsize_t), intent(in) :: extents(:)
      integer, intent(out) :: status

      if (size(extents) == 0) then
         call h5screate_f(H5S_SCALAR_F, space, status)
      else
         call h5screate_simple_f(size(extents), extents, space, status)
      end if
   end subroutine new_space

   !> Makes the type of UTF-8 strings of any length.
   subroutine new_text_type(text_type, status)
      integer(hid_t), intent(out) :: text_type
      integer, intent(out) :: status

      call h5tcopy_f(H5T_STRING, text_type, status)
      if (status >= 0) call h5tset_cset_f(text_type, H5T_CSET_UTF8_F, status)
   end subroutine new_text_type

   !> Makes the type of single bytes of text.
   subroutine new_byte_type(byte_type, status)
      integer(hid_t), intent(out) :: byte_type
      integer, intent(out) :: status

      call h5tcopy_f(H5T_C_S1, byte_type, status)
      if (status >= 0) call h5tset_strpad_f(byte_type, H5T_STR_NULLPAD_F, status)
   end subroutine new_byte_type

   !> Gives a copy of a string that ends with a null.
   function c_text(address) result(text)
      type(c_ptr), intent(in) :: address
      character(:), allocatable :: text
      character(c_char), pointer :: bytes(:)
      integer :: i

      call c_f_pointer(address, bytes, [int(c_strlen(address))])
      allocate (character(size(bytes)) :: text)
      do i = 1, size(bytes)
         text(i:i) = bytes(i)
      end do
   end function c_text

   !> Raises an error for a negative status: the action, and the innermost cause that the library names.
   subroutine check(status, action, error)
      integer, intent(in) :: status
      character(*), intent(in) :: action
      type(error_t), allocatable, intent(out) :: error
      type(cause_t), target :: cause
      character(*), parameter :: opening = "error message = '"
      character(:), allocatable :: text
      integer :: i, ignored

      if (status >= 0) return
      ignored = h5ewalk2(0_c_int64_t, 0_c_int, c_funloc(keep_innermost), c_loc(cause))
      text = ""
      do i = 1, cause%length
         text = text//cause%text(i)
      end do
      i = index(text, opening)                         ! what the operating system says, within much detail
      if (i > 0) text = text(i + len(opening):)
      if (i > 0) text = text(:index(text//"'", "'") - 1)
      if (cause%length > 0) text = " ("//text//")"
      call fail(error, "HDF5 cannot "//action//text)
   end subroutine check

   integer(c_int) function keep_innermost(depth, entry, data) bind(c)
      integer(c_int), value :: depth
      type(stack_entry_t), intent(in) :: entry
      type(c_ptr), value :: data
      type(cause_t), pointer :: cause
      character(:), allocatable :: text
      integer :: i

      keep_innermost = 0
      if (depth /= 0) return
      call c_f_pointer(data, cause)
      text = c_text(entry%description)
      cause%length = min(len(text), max_cause)
      do i = 1, cause%length
         cause%text(i) = text(i:i)
      end do
   end function keep_innermost
end module hb_hdf5
