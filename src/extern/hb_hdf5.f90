!> HDF5 files in the few forms the program needs, with errors as values: the manual, and how files are opened.
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
   use, intrinsic :: iso_fortran_env, only: int64
   use hb_error, only: annotate, error_t
   use hb_hdf5_library, only: check, no_id, start_library, switch_locking_off
   use hb_kinds, only: wp
   use hb_mpi, only: comm_handle, comm_t, no_info_handle
   use hdf5, only: H5F_ACC_EXCL_F, H5F_ACC_RDONLY_F, H5F_ACC_RDWR_F, H5F_ACC_TRUNC_F, H5F_CLOSE_STRONG_F, &
      H5F_LIBVER_EARLIEST_F, H5F_LIBVER_LATEST_F, H5F_SCOPE_LOCAL_F, h5fclose_f, h5fcreate_f, h5fflush_f, h5fopen_f, &
      H5P_FILE_ACCESS_F, &
      h5pclose_f, h5pcreate_f, h5pset_fapl_mpio_f, h5pset_fclose_degree_f, h5pset_libver_bounds_f, hid_t, hsize_t
   implicit none
   private
   public :: create_file, h5_dataset_t, h5_file_t, open_file, open_file_parallel

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
      procedure :: get_offset => dataset_get_offset
      procedure :: has_scale => dataset_has_scale
      procedure :: make_scale => dataset_make_scale
      generic :: read => read_integer, read_real, read_texts
      generic :: read_rows => read_integer_rows, read_real_rows
      generic :: write => write_integer, write_real
      generic :: write_row => write_integer_row, write_real_row, write_text_row
      procedure, private :: read_integer => dataset_read_integer
      procedure, private :: read_integer_rows => dataset_read_integer_rows
      procedure, private :: read_real => dataset_read_real
      procedure, private :: read_real_rows => dataset_read_real_rows
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
      procedure :: flush => file_flush
      procedure :: open_dataset => file_open_dataset
   end type h5_file_t

   ! Datasets; bodies in hb_hdf5_datasets
   interface
      !> Adds a dataset of float64, filled with NaN, its space taken on the disk.
      module subroutine file_add_real(self, name, extents, dataset, error)
         class(h5_file_t), intent(in) :: self
         character(*), intent(in) :: name
         integer, intent(in) :: extents(:)                !! fastest first; empty for a scalar
         type(h5_dataset_t), intent(out) :: dataset
         type(error_t), allocatable, intent(out) :: error
      end subroutine file_add_real

      !> Adds a dataset of int32, filled with zero, its space taken on the disk.
      module subroutine file_add_integer(self, name, extents, dataset, error)
         class(h5_file_t), intent(in) :: self
         character(*), intent(in) :: name
         integer, intent(in) :: extents(:)                !! fastest first; empty for a scalar
         type(h5_dataset_t), intent(out) :: dataset
         type(error_t), allocatable, intent(out) :: error
      end subroutine file_add_integer

      !> Adds a dataset of single bytes, all null, its space taken on the disk: the first extent is the room
      !> for a string.
      !>
      !> Strings of fixed length would be shorter to describe, but netCDF-C before 4.9.1 crashes on them, and
      !> parallel HDF5 cannot write strings of any length.
      module subroutine file_add_characters(self, name, extents, dataset, error)
         class(h5_file_t), intent(in) :: self
         character(*), intent(in) :: name
         integer, intent(in) :: extents(:)                !! fastest first
         type(h5_dataset_t), intent(out) :: dataset
         type(error_t), allocatable, intent(out) :: error
      end subroutine file_add_characters

      !> Adds a vector of strings of any length and writes it; blanks at the ends are dropped. For serial
      !> files only: the library cannot write such strings in parallel.
      module subroutine file_add_texts(self, name, values, dataset, error)
         class(h5_file_t), intent(in) :: self
         character(*), intent(in) :: name
         character(*), intent(in) :: values(:)
         type(h5_dataset_t), intent(out) :: dataset
         type(error_t), allocatable, intent(out) :: error
      end subroutine file_add_texts

      !> Adds one string of any length and writes it, byte by byte as given. For serial files only.
      module subroutine file_add_text(self, name, value, dataset, error)
         class(h5_file_t), intent(in) :: self
         character(*), intent(in) :: name
         character(*), intent(in) :: value
         type(h5_dataset_t), intent(out) :: dataset
         type(error_t), allocatable, intent(out) :: error
      end subroutine file_add_text

      !> Opens a dataset of the file.
      module subroutine file_open_dataset(self, name, dataset, error)
         class(h5_file_t), intent(in) :: self
         character(*), intent(in) :: name
         type(h5_dataset_t), intent(out) :: dataset
         type(error_t), allocatable, intent(out) :: error
      end subroutine file_open_dataset

      !> Closes the dataset; safe to call twice.
      module subroutine dataset_close(self)
         class(h5_dataset_t), intent(inout) :: self
      end subroutine dataset_close

      !> Gives the extents, fastest first; empty for a scalar.
      pure module function dataset_get_extents(self) result(extents)
         class(h5_dataset_t), intent(in) :: self
         integer, allocatable :: extents(:)
      end function dataset_get_extents

      !> Gives the byte of the file where the values begin that then follow each other, int32 or float64 with the least
      !> significant byte first (`value_size` 4, 8) or single bytes (1); -1 where the values stand there in another way.
      module function dataset_get_offset(self, value_size) result(offset)
         class(h5_dataset_t), intent(in) :: self
         integer, intent(in) :: value_size                !! [byte]
         integer(int64) :: offset
      end function dataset_get_offset

      !> Makes the dataset, a vector, a dimension scale of the given name.
      module subroutine dataset_make_scale(self, name, error)
         class(h5_dataset_t), intent(in) :: self
         character(*), intent(in) :: name
         type(error_t), allocatable, intent(out) :: error
      end subroutine dataset_make_scale

      !> Attaches a scale to dimension `i`, counted from 1 for the fastest; the scale also names the
      !> dimension.
      module subroutine dataset_attach_scale(self, i, scale, error)
         class(h5_dataset_t), intent(in) :: self
         integer, intent(in) :: i
         type(h5_dataset_t), intent(in) :: scale
         type(error_t), allocatable, intent(out) :: error
      end subroutine dataset_attach_scale

      !> Says whether `scale` is attached to dimension `i`, counted from 1 for the fastest.
      module function dataset_has_scale(self, i, scale) result(is_attached)
         class(h5_dataset_t), intent(in) :: self
         integer, intent(in) :: i
         type(h5_dataset_t), intent(in) :: scale
         logical :: is_attached
      end function dataset_has_scale
   end interface

   ! Their values; bodies in hb_hdf5_values
   interface
      !> Writes the whole dataset.
      module subroutine dataset_write_real(self, values, error)
         class(h5_dataset_t), intent(in) :: self
         real(wp), intent(in), contiguous, target :: values(..)
         type(error_t), allocatable, intent(out) :: error
      end subroutine dataset_write_real

      !> Writes the whole dataset.
      module subroutine dataset_write_integer(self, values, error)
         class(h5_dataset_t), intent(in) :: self
         integer, intent(in), contiguous, target :: values(..)
         type(error_t), allocatable, intent(out) :: error
      end subroutine dataset_write_integer

      !> Writes one whole row (all indices but the slowest), counted from 1, or several that follow each other;
      !> independent of other ranks.
      module subroutine dataset_write_real_row(self, row, values, error, n_rows)
         class(h5_dataset_t), intent(in) :: self
         integer, intent(in) :: row
         real(wp), intent(in), contiguous, target :: values(..)
         type(error_t), allocatable, intent(out) :: error
         integer, intent(in), optional :: n_rows       !! default 1
      end subroutine dataset_write_real_row

      !> Writes one whole row (all indices but the slowest), counted from 1, or several that follow each other;
      !> independent of other ranks.
      module subroutine dataset_write_integer_row(self, row, values, error, n_rows)
         class(h5_dataset_t), intent(in) :: self
         integer, intent(in) :: row
         integer, intent(in), contiguous, target :: values(..)
         type(error_t), allocatable, intent(out) :: error
         integer, intent(in), optional :: n_rows       !! default 1
      end subroutine dataset_write_integer_row

      !> Writes a string into row `row`, counted from 1, of a matrix of bytes; what is too long is cut.
      !> Independent of other ranks.
      module subroutine dataset_write_text_row(self, row, text, error)
         class(h5_dataset_t), intent(in) :: self
         integer, intent(in) :: row
         character(*), intent(in) :: text
         type(error_t), allocatable, intent(out) :: error
      end subroutine dataset_write_text_row

      !> Reads whole rows (all indices but the slowest) that follow each other, as many as there is room for; independent
      !> of other ranks.
      module subroutine dataset_read_real_rows(self, first, values, error)
         class(h5_dataset_t), intent(in) :: self
         integer, intent(in) :: first                  !! row, from 1
         real(wp), intent(out), contiguous, target :: values(:, :)
         type(error_t), allocatable, intent(out) :: error
      end subroutine dataset_read_real_rows

      !> The same of integers, of a dataset of single numbers.
      module subroutine dataset_read_integer_rows(self, first, values, error)
         class(h5_dataset_t), intent(in) :: self
         integer, intent(in) :: first                  !! row, from 1
         integer, intent(out), contiguous, target :: values(:)
         type(error_t), allocatable, intent(out) :: error
      end subroutine dataset_read_integer_rows

      !> Reads the whole dataset.
      module subroutine dataset_read_real(self, values, error)
         class(h5_dataset_t), intent(in) :: self
         real(wp), intent(out), contiguous, target :: values(..)
         type(error_t), allocatable, intent(out) :: error
      end subroutine dataset_read_real

      !> Reads the whole dataset.
      module subroutine dataset_read_integer(self, values, error)
         class(h5_dataset_t), intent(in) :: self
         integer, intent(out), contiguous, target :: values(..)
         type(error_t), allocatable, intent(out) :: error
      end subroutine dataset_read_integer

      !> Reads a whole vector of strings, or a whole matrix of bytes, as a vector of strings padded with
      !> blanks.
      module subroutine dataset_read_texts(self, values, error)
         class(h5_dataset_t), intent(in) :: self
         character(:), allocatable, intent(out) :: values(:)
         type(error_t), allocatable, intent(out) :: error
      end subroutine dataset_read_texts
   end interface

   ! Attributes; bodies in hb_hdf5_attributes
   interface
      !> Gives the object an attribute of one string, any length; for serial files only.
      module subroutine object_set_text_attribute(self, name, value, error)
         class(h5_object_t), intent(in) :: self
         character(*), intent(in) :: name
         character(*), intent(in) :: value
         type(error_t), allocatable, intent(out) :: error
      end subroutine object_set_text_attribute

      !> Gives the object an attribute of one integer.
      module subroutine object_set_integer_attribute(self, name, value, error)
         class(h5_object_t), intent(in) :: self
         character(*), intent(in) :: name
         integer, intent(in) :: value
         type(error_t), allocatable, intent(out) :: error
      end subroutine object_set_integer_attribute

      !> Gives the object an attribute of several integers.
      module subroutine object_set_integers_attribute(self, name, values, error)
         class(h5_object_t), intent(in) :: self
         character(*), intent(in) :: name
         integer, intent(in), contiguous, target :: values(:)
         type(error_t), allocatable, intent(out) :: error
      end subroutine object_set_integers_attribute

      !> Reads an attribute of one string.
      module subroutine object_get_text_attribute(self, name, value, error)
         class(h5_object_t), intent(in) :: self
         character(*), intent(in) :: name
         character(:), allocatable, intent(out) :: value
         type(error_t), allocatable, intent(out) :: error
      end subroutine object_get_text_attribute

      !> Reads an attribute of one integer.
      module subroutine object_get_integer_attribute(self, name, value, error)
         class(h5_object_t), intent(in) :: self
         character(*), intent(in) :: name
         integer, intent(out) :: value
         type(error_t), allocatable, intent(out) :: error
      end subroutine object_get_integer_attribute
   end interface

contains

   !> Makes a new file for this process alone. An existing file is an error, or is replaced when `replace` is
   !> true.
   subroutine create_file(self, path, replace, error)
      type(h5_file_t), intent(out) :: self
      character(*), intent(in) :: path
      logical, intent(in) :: replace
      type(error_t), allocatable, intent(out) :: error
      integer(hid_t) :: access
      integer :: status

      call begin_opening(self, path, access, error)
      if (.not. allocated(error)) then
         call h5fcreate_f(path, merge(H5F_ACC_TRUNC_F, H5F_ACC_EXCL_F, replace), self%id, status, &
                          access_prp=access)
         call check(status, "create", error)
      end if
      call end_opening(self, access, error)
   end subroutine create_file

   !> Opens a file by this process alone, for reading unless `for_writing` is true.
   subroutine open_file(self, path, error, for_writing)
      type(h5_file_t), intent(out) :: self
      character(*), intent(in) :: path
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: for_writing
      integer(hid_t) :: access
      integer :: flags, status

      flags = H5F_ACC_RDONLY_F
      if (present(for_writing)) flags = merge(H5F_ACC_RDWR_F, flags, for_writing)
      call begin_opening(self, path, access, error)
      if (.not. allocated(error)) then
         call h5fopen_f(path, flags, self%id, status, access)
         call check(status, "open", error)
      end if
      call end_opening(self, access, error)
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

      call begin_opening(self, path, access, error)
      if (.not. allocated(error)) then
         call h5pset_fapl_mpio_f(access, comm_handle(comm), no_info_handle(), status)
         call check(status, "choose MPI access", error)
      end if
      if (.not. allocated(error)) then
         call h5fopen_f(path, H5F_ACC_RDWR_F, self%id, status, access)
         call check(status, "open for parallel writing", error)
      end if
      call end_opening(self, access, error)
   end subroutine open_file_parallel

   !> Names the file and makes a list of access properties: whatever is still open in the file is closed with
   !> it; the library locks nothing, so that people can look into the file of a run that goes on; and the form of
   !> the file is the oldest that will do. That has no mark of being open for writing, which a killed run would leave
   !> and which would keep readers out.
   subroutine begin_opening(self, path, access, error)
      type(h5_file_t), intent(inout) :: self
      character(*), intent(in) :: path
      integer(hid_t), intent(out) :: access            !! for `end_opening`
      type(error_t), allocatable, intent(out) :: error
      integer :: status

      self%place = "file '"//path//"'"
      access = no_id
      call start_library(error)
      if (allocated(error)) return
      call h5pcreate_f(H5P_FILE_ACCESS_F, access, status)
      call check(status, "make the access properties", error)
      if (allocated(error)) then
         access = no_id
         return
      end if
      call h5pset_fclose_degree_f(access, H5F_CLOSE_STRONG_F, status)
      if (status >= 0) call h5pset_libver_bounds_f(access, H5F_LIBVER_EARLIEST_F, H5F_LIBVER_LATEST_F, status)
      if (status >= 0) call switch_locking_off(access, status)
      call check(status, "set the access properties", error)
   end subroutine begin_opening

   subroutine end_opening(self, access, error)
      type(h5_file_t), intent(inout) :: self
      integer(hid_t), intent(in) :: access
      type(error_t), allocatable, intent(inout) :: error
      integer :: status

      if (access /= no_id) call h5pclose_f(access, status)
      if (allocated(error)) self%id = no_id
      call annotate(error, self%place)
   end subroutine end_opening

   !> Hands on what was written, so that other ranks read it after a barrier; collective.
   subroutine file_flush(self, error)
      class(h5_file_t), intent(in) :: self
      type(error_t), allocatable, intent(out) :: error
      integer :: status

      call h5fflush_f(self%id, H5F_SCOPE_LOCAL_F, status)
      call check(status, "flush", error, self%place)
   end subroutine file_flush

   !> Closes the file with all its datasets; safe to call twice.
   subroutine file_close(self, error)
      class(h5_file_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error
      integer :: status

      if (self%id == no_id) return
      call h5fclose_f(self%id, status)
      call check(status, "close", error, self%place)
      self%id = no_id
   end subroutine file_close
end module hb_hdf5
