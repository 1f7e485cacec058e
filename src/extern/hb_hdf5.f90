!> HDF5 files in the few forms that the program needs, with errors as values: the manual, files, and the creation of
!> datasets.
!>
!> In the order of use: `create_file` (one process) creates a file, `add` adds its datasets and allocates their space
!> on the disk, `make_scale`, `describe` and `set_attribute` describe them, `close` closes it. `open_file_parallel`
!> then opens it on all ranks, and `write` of a dataset writes raw data in place: this changes no metadata, so ranks
!> need no coordination and a killed run leaves a valid file. Small datasets with known values are written by `put`
!> and read by `get`.
!>
!> Extents have the order of Fortran, fastest first: h5py, h5dump and xarray show them reversed. Datasets are
!> contiguous and not compressed. Messages of the library are not printed but included in the error. Source: HDF5 1.10
!> Reference Manual; HDF5 Dimension Scale Specification.
module hb_hdf5
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use, intrinsic :: iso_c_binding, only: c_associated, c_char, c_loc, c_null_char, c_null_ptr, c_ptr
   use hb_crash_handler, only: install_file_handler, record_entry, remove_crash_handler
   use hb_error, only: annotate, error_t, fail
   use hb_hdf5_attributes, only: h5_object_t
   use hb_hdf5_datasets, only: h5_dataset_t
   use hb_hdf5_library, only: bytes_of_kind, check, is_characters, is_integer, is_real, kind_of_type, memory_type, new_space, &
      no_id, start_library, switch_locking_off, text_type, transfer_settings
   use hb_hdf5_sharing, only: share_access
   use hb_kinds, only: wp
   use hb_mpi, only: comm_t
   use hb_text, only: to_text
   use hdf5, only: H5D_ALLOC_TIME_EARLY_F, H5D_FILL_TIME_ALLOC_F, H5D_FILL_TIME_NEVER_F, H5D_VIRTUAL_F, h5dcreate_f, &
      h5dget_create_plist_f, h5dget_space_f, h5dget_storage_size_f, h5dget_type_f, h5dopen_f, h5dwrite_f, H5F_ACC_EXCL_F, &
      H5F_ACC_RDONLY_F, H5F_ACC_RDWR_F, H5F_ACC_TRUNC_F, H5F_CLOSE_STRONG_F, H5F_LIBVER_EARLIEST_F, H5F_LIBVER_LATEST_F, &
      H5F_SCOPE_LOCAL_F, h5fclose_f, h5fcreate_f, h5fflush_f, h5fget_name_f, h5fopen_f, h5lexists_f, H5P_DATASET_CREATE_F, &
      H5P_FILE_ACCESS_F, h5pclose_f, h5pcreate_f, h5pget_external_count_f, h5pget_layout_f, h5pset_alloc_time_f, h5pset_chunk_f, &
      h5pset_fclose_degree_f, h5pset_fill_time_f, h5pset_fill_value_f, h5pset_libver_bounds_f, h5pset_sieve_buf_size_f, &
      H5S_NULL_F, H5S_UNLIMITED_F, h5sclose_f, h5screate_simple_f, &
      h5sget_simple_extent_dims_f, h5sget_simple_extent_ndims_f, h5sget_simple_extent_type_f, H5T_IEEE_F64LE, &
      H5T_NATIVE_DOUBLE, H5T_NATIVE_INTEGER, H5T_STD_I32LE, h5tclose_f, h5tget_size_f, hid_t, hsize_t, size_t
   implicit none
   private
   public :: bytes_of_kind, can_end_library, create_file, h5_dataset_t, h5_file_t, is_characters, is_integer
   public :: is_real, open_file, open_file_parallel

   !> An open file. Results are in its root group, models in groups of their own.
   type, extends(h5_object_t) :: h5_file_t
      logical, private :: is_protected = .false.         ! until it is closed
      logical, private :: is_shared = .false.            ! open on several ranks
   contains
      procedure :: abandon => file_abandon
      procedure :: add => file_add
      procedure :: add_texts => file_add_texts
      procedure :: close => file_close
      procedure :: flush => file_flush
      procedure :: has => file_has
      procedure :: open_dataset => file_open_dataset
      generic :: get => get_integer, get_real, get_texts
      generic :: store => store_integer, store_real, store_text
      procedure, private :: get_integer => file_get_integer
      procedure, private :: get_real => file_get_real
      procedure, private :: get_texts => file_get_texts
      procedure, private :: store_integer => file_store_integer
      procedure, private :: store_real => file_store_real
      procedure, private :: store_text => file_store_text
   end type h5_file_t

   integer, parameter :: for_making = 1, for_replacing = 2, for_reading = 3, for_changing = 4 ! purposes of opening a file
   logical :: is_library_sound = .true.

contains

   !> Creates a new file for this process alone. An existing file is an error, or is replaced if `replace` is true.
   subroutine create_file(self, path, replace, error)
      type(h5_file_t), intent(out) :: self
      character(*), intent(in) :: path
      logical, intent(in) :: replace
      type(error_t), allocatable, intent(out) :: error

      call open_as(self, path, merge(for_replacing, for_making, replace), error)
   end subroutine create_file

   !> Opens a file by this process alone, for reading unless `for_writing` is true. Until it is closed the process
   !> ends with a message if the library crashes on the file, loops, or needs much more memory than the file has
   !> bytes.
   subroutine open_file(self, path, error, for_writing, message)
      type(h5_file_t), intent(out) :: self
      character(*), intent(in) :: path
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: for_writing
      character(*), intent(in), optional :: message   !! that message; default: the file is damaged
      integer :: purpose

      call install_file_handler(path, message)
      purpose = for_reading
      if (present(for_writing)) purpose = merge(for_changing, for_reading, for_writing)
      call open_as(self, path, purpose, error)
      self%is_protected = .not. allocated(error)
      if (allocated(error)) call remove_crash_handler()
   end subroutine open_file

   !> Opens a file for writing on all ranks of `comm`; collective, and so is its `close`. Raw data may then be
   !> written by any rank alone. The error is that of this rank.
   subroutine open_file_parallel(self, path, comm, error)
      type(h5_file_t), intent(out) :: self
      character(*), intent(in) :: path
      type(comm_t), intent(in) :: comm
      type(error_t), allocatable, intent(out) :: error

      call open_as(self, path, for_changing, error, comm)
   end subroutine open_file_parallel

   !> Creates or opens the file. Open objects are closed with it; the library does not lock it, so that others can
   !> read the file of a running run; and the format is the oldest possible. The latter has no flag for being open for
   !> writing, which a killed run would leave and which would lock readers out.
   subroutine open_as(self, path, purpose, error, comm)
      type(h5_file_t), intent(inout) :: self
      character(*), intent(in) :: path
      integer, intent(in) :: purpose
      type(error_t), allocatable, intent(out) :: error
      type(comm_t), intent(in), optional :: comm       !! of the ranks that open it; default: this process
      integer(hid_t) :: access
      integer :: ignored, status

      self%location = "file '"//path//"'"
      self%is_shared = present(comm)
      call start_library(error)
      if (.not. allocated(error)) then
         call h5pcreate_f(H5P_FILE_ACCESS_F, access, status)
         if (status >= 0) call h5pset_fclose_degree_f(access, H5F_CLOSE_STRONG_F, status)
         if (status >= 0) call h5pset_libver_bounds_f(access, H5F_LIBVER_EARLIEST_F, H5F_LIBVER_LATEST_F, status)
         if (status >= 0) call switch_locking_off(access, status)
         if (status >= 0 .and. present(comm)) call share_access(access, comm, status)
         ! rows of which a part is used are far apart: no bytes between them are read
         if (status >= 0 .and. purpose == for_reading) call h5pset_sieve_buf_size_f(access, 0_size_t, status)
         if (status >= 0) then
            select case (purpose)
            case (for_making); call h5fcreate_f(path, H5F_ACC_EXCL_F, self%id, status, access_prp=access)
            case (for_replacing); call h5fcreate_f(path, H5F_ACC_TRUNC_F, self%id, status, access_prp=access)
            case (for_changing); call h5fopen_f(path, H5F_ACC_RDWR_F, self%id, status, access)
            case default; call h5fopen_f(path, H5F_ACC_RDONLY_F, self%id, status, access)
            end select
         end if
         call check(status, merge("create", "open  ", any(purpose == [for_making, for_replacing])), error)
         call h5pclose_f(access, ignored)
      end if
      if (allocated(error)) self%id = no_id
      call annotate(error, self%location)
   end subroutine open_as

   !> Flushes written data, so that other ranks read them after a barrier; collective.
   subroutine file_flush(self, error)
      class(h5_file_t), intent(in) :: self
      type(error_t), allocatable, intent(out) :: error
      integer :: status

      call h5fflush_f(self%id, H5F_SCOPE_LOCAL_F, status)
      call check(status, "flush", error, self%location)
   end subroutine file_flush

   !> Closes the file with all its datasets; safe to call twice. Does not replace an earlier error. A file that cannot be
   !> written stays open: HDF5 2 ends the process by an assertion when it closes one.
   subroutine file_close(self, error)
      class(h5_file_t), intent(inout) :: self
      type(error_t), allocatable, intent(inout) :: error
      type(error_t), allocatable :: own
      integer :: status

      if (self%id == no_id) return
      if (.not. self%is_shared) call self%flush(own)                ! of several ranks, each would wait for the others
      if (.not. allocated(own)) then
         call h5fclose_f(self%id, status)
         call check(status, "close", own, self%location)
      end if
      if (allocated(own)) is_library_sound = .false.
      if (.not. allocated(error)) call move_alloc(own, error)
      self%id = no_id
      if (self%is_protected) call remove_crash_handler()
      self%is_protected = .false.
   end subroutine file_close

   !> Leaves the file open until the process ends, which must then end without closing the library: see
   !> `can_end_library`.
   subroutine file_abandon(self)
      class(h5_file_t), intent(inout) :: self

      if (self%id == no_id) return
      is_library_sound = .false.
      self%id = no_id
   end subroutine file_abandon

   !> Whether the library can be closed, which MPI does at its end: it crashes on a file that it could not write and
   !> close.
   logical function can_end_library()
      can_end_library = is_library_sound
   end function can_end_library

   ! Creating and opening datasets

   !> Adds a dataset and allocates its space on the disk: int32 filled with zero, float64 filled with NaN, or single
   !> bytes, all null, whose first extent is the length of a string. With `as_hole` it is zero until written and takes
   !> no space on file systems with sparse files.
   !>
   !> Strings of fixed length would be shorter to describe, but netCDF-C before 4.9.1 crashes on them, and
   !> parallel HDF5 cannot write strings of any length.
   subroutine file_add(self, name, kind, extents, dataset, error, as_hole)
      class(h5_file_t), intent(in) :: self
      character(*), intent(in) :: name
      integer, intent(in) :: kind                      !! hb_hdf5_library
      integer, intent(in) :: extents(:)                !! fastest first; empty for a scalar
      type(h5_dataset_t), intent(out) :: dataset
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: as_hole         !! default false
      logical :: is_hole

      is_hole = .false.
      if (present(as_hole)) is_hole = as_hole
      dataset%kind = kind
      call add_dataset(self, name, extents, memory_type(kind), dataset, error, is_hole)
   end subroutine file_add

   !> Adds a vector of strings of any length and writes it; trailing blanks are dropped. For serial files only: the
   !> library cannot write such strings in parallel.
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

   subroutine add_varying(self, name, extents, addresses, dataset, error)
      class(h5_file_t), intent(in) :: self
      character(*), intent(in) :: name
      integer, intent(in) :: extents(:)
      type(c_ptr), intent(in), target :: addresses(:)  !! of the null-terminated strings
      type(h5_dataset_t), intent(out) :: dataset
      type(error_t), allocatable, intent(out) :: error
      integer :: status

      call add_dataset(self, name, extents, text_type, dataset, error, .false.)
      if (allocated(error) .or. size(addresses) == 0) return
      call h5dwrite_f(dataset%id, text_type, c_loc(addresses), status, xfer_prp=transfer_settings)
      call check(status, "write", error, dataset%location)
   end subroutine add_varying

   !> Adds a dataset with early allocation.
   subroutine add_dataset(file, name, extents, type, dataset, error, is_hole)
      class(h5_file_t), intent(in) :: file
      character(*), intent(in) :: name
      integer, intent(in) :: extents(:)
      integer(hid_t), intent(in) :: type               !! in memory
      type(h5_dataset_t), intent(inout) :: dataset
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in) :: is_hole
      integer(hid_t) :: file_type, properties, space
      integer, target :: zero
      integer :: status
      real(wp), target :: none
      type(c_ptr) :: fill

      dataset%location = file%location//": dataset '"//name//"'"
      dataset%extents = int(extents, hsize_t)
      file_type = type
      fill = c_null_ptr                                ! zero bytes
      zero = 0
      none = merge(0.0_wp, ieee_value(none, ieee_quiet_nan), is_hole)
      if (type == H5T_NATIVE_INTEGER) then
         file_type = H5T_STD_I32LE
         fill = c_loc(zero)
      else if (type == H5T_NATIVE_DOUBLE) then
         file_type = H5T_IEEE_F64LE
         fill = c_loc(none)
      end if
      if (any(dataset%extents == 0)) then              ! h5repack fails at fixed extents of 0, for which it wants chunks
         call h5screate_simple_f(size(extents), dataset%extents, space, status, spread(H5S_UNLIMITED_F, 1, size(extents)))
      else
         call new_space(space, dataset%extents, status)
      end if
      if (status >= 0) call h5pcreate_f(H5P_DATASET_CREATE_F, properties, status)
      if (status >= 0 .and. any(dataset%extents == 0)) &
         call h5pset_chunk_f(properties, size(extents), max(1_hsize_t, dataset%extents), status)
      if (status >= 0) call h5pset_alloc_time_f(properties, H5D_ALLOC_TIME_EARLY_F, status)
      if (status >= 0) call h5pset_fill_time_f(properties, merge(H5D_FILL_TIME_NEVER_F, H5D_FILL_TIME_ALLOC_F, is_hole), status)
      if (status >= 0 .and. c_associated(fill)) call h5pset_fill_value_f(properties, type, fill, status)
      if (status >= 0) call h5dcreate_f(file%id, name, file_type, space, dataset%id, status, properties)
      call check(status, "create", error, dataset%location)
      if (allocated(error)) then
         dataset%id = no_id
         return
      end if
      call h5pclose_f(properties, status)
      call h5sclose_f(space, status)
   end subroutine add_dataset

   !> Opens a dataset of the file. Fails if it claims more values than the file contains, or if they are in another file.
   subroutine file_open_dataset(self, name, dataset, error, extents)
      class(h5_file_t), intent(in) :: self
      character(*), intent(in) :: name
      type(h5_dataset_t), intent(out) :: dataset
      type(error_t), allocatable, intent(out) :: error
      integer, intent(in), optional :: extents(:)         !! required extents, fastest first; default: any
      integer(hsize_t), allocatable :: max_extents(:)
      integer(hid_t) :: space
      integer :: class, n_dimensions, status

      dataset%location = self%location//": dataset '"//name//"'"
      call record_entry(name)
      call h5dopen_f(self%id, name, dataset%id, status)
      call check(status, "open", error, dataset%location)
      if (allocated(error)) then
         dataset%id = no_id
         return
      end if
      call h5dget_space_f(dataset%id, space, status)
      if (status >= 0) call h5sget_simple_extent_type_f(space, class, status)
      if (status >= 0) call h5sget_simple_extent_ndims_f(space, n_dimensions, status)
      if (status >= 0) then
         allocate (dataset%extents(n_dimensions), max_extents(n_dimensions))
         if (n_dimensions > 0) call h5sget_simple_extent_dims_f(space, dataset%extents, max_extents, status)
      end if
      call check(status, "ask for the extents", error, dataset%location)
      if (.not. allocated(error)) then
         call h5sclose_f(space, status)
         if (class == H5S_NULL_F) then
            call fail(error, dataset%location//" has no extents")
         else if (any(dataset%extents > huge(1))) then
            call fail(error, dataset%location//" has an axis of "//to_text(maxval(dataset%extents))//" entries")
         else if (present(extents)) then
            call check_extents(dataset%location, dataset%get_extents(), extents, error)
         end if
      end if
      if (.not. allocated(error)) call check_stored_here(self, dataset, error)
      if (.not. allocated(error)) call check_stored(dataset, error)
      if (allocated(error)) call dataset%close()
   end subroutine file_open_dataset

   !> Fails for a dataset with data in another file: behind an external link, in external raw storage, or in the sources
   !> of a virtual dataset. The library would follow such names to any file of the user, also to write there.
   subroutine check_stored_here(file, dataset, error)
      class(h5_file_t), intent(in) :: file
      type(h5_dataset_t), intent(in) :: dataset
      type(error_t), allocatable, intent(out) :: error
      integer, parameter :: longest_path = 4096
      character(longest_path) :: its_file, this_file
      integer(hid_t) :: properties
      integer(size_t) :: length
      integer :: ignored, layout, n_external, status

      call h5fget_name_f(file%id, this_file, length, status)
      if (status >= 0) call h5fget_name_f(dataset%id, its_file, length, status)
      if (status >= 0) call h5dget_create_plist_f(dataset%id, properties, status)
      if (status >= 0) then
         call h5pget_external_count_f(properties, n_external, status)
         if (status >= 0) call h5pget_layout_f(properties, layout, status)
         call h5pclose_f(properties, ignored)
      end if
      call check(status, "ask for the storage", error, dataset%location)
      if (allocated(error)) return
      if (its_file /= this_file .or. n_external > 0 .or. layout == H5D_VIRTUAL_F) &
         call fail(error, dataset%location//" is stored in another file, which is not read")
   end subroutine check_stored_here

   !> Determines the kind of the values. Fails if a dataset claims more bytes than are in the file, except for a
   !> limited number that its owner may have compressed.
   subroutine check_stored(dataset, error)
      type(h5_dataset_t), intent(inout) :: dataset
      type(error_t), allocatable, intent(out) :: error
      real(wp), parameter :: max_compressed = 2.0_wp**26 ! bytes; a run reads a dozen columns at once
      integer(hid_t) :: value_type
      integer(hsize_t) :: n_stored
      integer(size_t) :: n_bytes
      integer :: status

      call h5dget_type_f(dataset%id, value_type, status)
      if (status >= 0) call h5tget_size_f(value_type, n_bytes, status)
      if (status >= 0) dataset%kind = kind_of_type(value_type)
      if (status >= 0) call h5tclose_f(value_type, status)
      call check(status, "ask for the type", error, dataset%location)
      if (allocated(error)) return
      call h5dget_storage_size_f(dataset%id, n_stored, status)
      if (status < 0) n_stored = 0                        ! also fails if nothing is stored
      associate (n_claimed => product(real(dataset%extents, wp))*real(n_bytes, wp))
         if (n_claimed - real(n_stored, wp) > max_compressed) call fail(error, dataset%location//" claims "// &
            to_text(nint(n_claimed/1.0e6_wp))//" MB, and "//to_text(nint(n_stored/1.0e6_wp))// &
            " MB of it are in the file; if it is compressed: h5repack -f NONE")
      end associate
   end subroutine check_stored

   !> Whether the file, or an existing group of it, contains an object of the given name.
   logical function file_has(self, name) result(has)
      class(h5_file_t), intent(in) :: self
      character(*), intent(in) :: name                    !! such as `mass/data`
      integer :: i, status

      has = .true.
      do i = 1, len(name)                                ! the library requires each group on the path to be tested
         if (has .and. (i == len(name) .or. name(i:i) == "/")) &
            call h5lexists_f(self%id, name(:merge(i, i - 1, i == len(name))), has, status)
      end do
   end function file_has

   !> Adds a dataset with its values, scales, unit and meaning; does nothing after an error.
   subroutine file_store_real(self, name, values, scales, units, long_name, error, dataset)
      class(h5_file_t), intent(in) :: self
      character(*), intent(in) :: name
      real(wp), intent(in), contiguous :: values(..)
      type(h5_dataset_t), intent(in) :: scales(:)         !! of the dimensions, fastest first
      character(*), intent(in) :: units, long_name
      type(error_t), allocatable, intent(inout) :: error
      type(h5_dataset_t), intent(out), optional :: dataset
      type(h5_dataset_t) :: made

      if (allocated(error)) return
      call self%add(name, is_real, shape(values), made, error)
      if (.not. allocated(error)) call made%write(values, error)
      call made%describe(units, long_name, error, scales)
      if (present(dataset)) dataset = made
   end subroutine file_store_real

   !> As for real numbers.
   subroutine file_store_integer(self, name, values, scales, units, long_name, error, dataset)
      class(h5_file_t), intent(in) :: self
      character(*), intent(in) :: name
      integer, intent(in), contiguous :: values(..)
      type(h5_dataset_t), intent(in) :: scales(:)
      character(*), intent(in) :: units, long_name
      type(error_t), allocatable, intent(inout) :: error
      type(h5_dataset_t), intent(out), optional :: dataset
      type(h5_dataset_t) :: made

      if (allocated(error)) return
      call self%add(name, is_integer, shape(values), made, error)
      if (.not. allocated(error)) call made%write(values, error)
      call made%describe(units, long_name, error, scales)
      if (present(dataset)) dataset = made
   end subroutine file_store_integer

   !> Adds one string of any length, byte by byte as given, with its meaning; does nothing after an error. For serial files only.
   subroutine file_store_text(self, name, text, long_name, error, dataset)
      class(h5_file_t), intent(in) :: self
      character(*), intent(in) :: name, text, long_name
      type(error_t), allocatable, intent(inout) :: error
      type(h5_dataset_t), intent(out), optional :: dataset
      type(h5_dataset_t) :: made
      character(:), allocatable, target :: bytes
      type(c_ptr), target :: addresses(1)

      if (allocated(error)) return
      bytes = text//c_null_char
      addresses(1) = c_loc(bytes)
      call add_varying(self, name, [integer ::], addresses, made, error)
      call made%describe("1", long_name, error)
      if (present(dataset)) dataset = made
   end subroutine file_store_text

   !> Reads values in the order of the file: of a vector or a scalar; with `extents` (fastest first) of an array that
   !> must have these; with `row` only of this one, counted from 1. Does nothing after an error.
   subroutine file_get_real(self, name, values, error, extents, row)
      class(h5_file_t), intent(in) :: self
      character(*), intent(in) :: name
      real(wp), allocatable, intent(out) :: values(:)
      type(error_t), allocatable, intent(inout) :: error
      integer, intent(in), optional :: extents(:), row
      type(h5_dataset_t) :: dataset
      integer :: n, status

      call open_for_get(self, name, dataset, n, error, extents, row)
      if (allocated(error)) return
      allocate (values(n), stat=status)
      if (status /= 0) call fail(error, dataset%location//": not enough memory for its "//to_text(n)//" entries")
      if (.not. allocated(error)) call dataset%read(values, error, row)
      call dataset%close()
   end subroutine file_get_real

   !> As for real numbers, which represent each integer exactly.
   subroutine file_get_integer(self, name, values, error, extents, row)
      class(h5_file_t), intent(in) :: self
      character(*), intent(in) :: name
      integer, allocatable, intent(out) :: values(:)
      type(error_t), allocatable, intent(inout) :: error
      integer, intent(in), optional :: extents(:), row
      real(wp), parameter :: largest_integer = real(huge(1), wp)
      real(wp), allocatable :: numbers(:)

      call self%get(name, numbers, error, extents, row)
      if (.not. allocated(error)) values = nint(max(-largest_integer, min(numbers, largest_integer)))
   end subroutine file_get_integer

   !> As for numbers: strings padded with blanks.
   subroutine file_get_texts(self, name, values, error, extents)
      class(h5_file_t), intent(in) :: self
      character(*), intent(in) :: name
      character(:), allocatable, intent(out) :: values(:)
      type(error_t), allocatable, intent(inout) :: error
      integer, intent(in), optional :: extents(:)
      type(h5_dataset_t) :: dataset
      integer :: n

      call open_for_get(self, name, dataset, n, error, extents)
      if (allocated(error)) return
      call dataset%read(values, error)
      call dataset%close()
   end subroutine file_get_texts

   subroutine open_for_get(self, name, dataset, n, error, extents, row)
      class(h5_file_t), intent(in) :: self
      character(*), intent(in) :: name
      type(h5_dataset_t), intent(out) :: dataset
      integer, intent(out) :: n                           !! entries
      type(error_t), allocatable, intent(inout) :: error
      integer, intent(in), optional :: extents(:), row
      integer, allocatable :: found(:)

      n = 0
      if (allocated(error)) return
      if (.not. self%has(name)) then
         call fail(error, self%location//" has no '"//name//"'")
         return
      end if
      call self%open_dataset(name, dataset, error)
      if (allocated(error)) return
      found = dataset%get_extents()
      if (size(found) == 0) found = [1]                   ! a scalar is accepted as a vector of one element
      n = product(found)
      if (present(row)) n = product(found(:size(found) - 1))
      if (present(extents)) then
         call check_extents(dataset%location, found, extents, error)
      else
         call check_extents(dataset%location, found, found(:1), error)
      end if
      if (allocated(error)) call dataset%close()
   end subroutine open_for_get

   !> Fails if extents differ from the expected ones.
   subroutine check_extents(location, found, extents, error)
      character(*), intent(in) :: location
      integer, intent(in) :: found(:), extents(:)
      type(error_t), allocatable, intent(inout) :: error

      if (size(found) /= size(extents)) then
         call fail(error, location//" has "//to_text(size(found))//" axes, expected "//to_text(size(extents)))
      else if (any(found /= extents)) then
         call fail(error, location//" has "//joined(found)//" values, expected "//joined(extents))
      end if
   contains
      function joined(numbers) result(text)
         integer, intent(in) :: numbers(:)
         character(:), allocatable :: text
         integer :: i

         text = ""
         do i = 1, size(numbers)
            text = text//" x "//to_text(numbers(i))
         end do
         text = text(4:)
      end function joined
   end subroutine check_extents
end module hb_hdf5
