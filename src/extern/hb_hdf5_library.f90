!> The HDF5 library itself: initialisation, errors as values, dataspaces and text types.
module hb_hdf5_library
   use, intrinsic :: iso_c_binding, only: c_bool, c_char, c_f_pointer, c_funloc, c_funptr, c_int, c_int64_t, c_loc, c_ptr
   use hb_c_text, only: c_text
   use hb_error, only: annotate, error_t, fail
   use hdf5, only: h5eset_auto_f, h5open_f, H5P_DATASET_XFER_F, h5pcreate_f, h5pset_buffer_f, H5S_SCALAR_F, h5screate_f, &
      h5screate_simple_f, H5T_C_S1, H5T_CSET_UTF8_F, H5T_INTEGER_F, H5T_NATIVE_DOUBLE, H5T_NATIVE_INTEGER, H5T_STR_NULLPAD_F, &
      H5T_STRING, H5T_STRING_F, h5tcopy_f, h5tget_class_f, h5tget_size_f, h5tset_cset_f, h5tset_strpad_f, hid_t, hsize_t, size_t
   implicit none
   private
   public :: bytes_of_kind, check, is_characters, is_integer, is_real, kind_of_type, memory_type, new_space, no_id, start_library
   public :: switch_locking_off, text_type, transfer_settings

   integer(hid_t), parameter :: no_id = -1
   ! Kinds of values: int32, float64, single bytes of text.
   integer, parameter :: is_integer = 1, is_real = 2, is_characters = 3
   integer, parameter :: bytes_of_kind(3) = [4, 8, 1]
   integer, parameter :: max_cause = 512               ! maximum length of the library's message
   ! The library clears its buffer for each conversion, such as of texts or of integers read as reals: by default 1 MiB.
   integer(hsize_t), parameter :: conversion_bytes = 65536
   logical :: is_library_open = .false.
   integer(hid_t), protected :: text_type = no_id         !! of UTF-8 strings of any length
   integer(hid_t), protected :: transfer_settings = no_id !! properties with which values are read and written
   integer(hid_t) :: character_type = no_id             ! of single bytes

   !> H5E_error2_t of H5Epublic.h: one entry of the library's stack of errors.
   type, bind(c) :: stack_entry_t
      integer(c_int64_t) :: class, major, minor
      integer(c_int) :: line
      type(c_ptr) :: procedure_name, file_name, description
   end type stack_entry_t

   !> Result of the callback of `H5Ewalk2`.
   type, bind(c) :: cause_t
      character(c_char) :: text(max_cause)
      integer(c_int) :: length = 0
   end type cause_t

   interface
      !> Walks the error stack; the Fortran interface can only print it.
      integer(c_int) function h5ewalk2(stack, direction, visit, data) bind(c, name="H5Ewalk2")
         import :: c_funptr, c_int, c_int64_t, c_ptr
         integer(c_int64_t), value :: stack
         integer(c_int), value :: direction            !! 0: innermost first
         type(c_funptr), value :: visit
         type(c_ptr), value :: data
      end function h5ewalk2

      !> Sets whether files are locked; available in the Fortran interface from HDF5 1.14 on.
      integer(c_int) function h5pset_file_locking(access, use_locking, ignore_when_disabled) &
         bind(c, name="H5Pset_file_locking")
         import :: c_bool, c_int, c_int64_t
         integer(c_int64_t), value :: access
         logical(c_bool), value :: use_locking, ignore_when_disabled
      end function h5pset_file_locking
   end interface

contains

   !> Starts the library unless it runs, and suppresses its printing.
   subroutine start_library(error)
      type(error_t), allocatable, intent(out) :: error
      integer :: status

      if (is_library_open) return
      call h5open_f(status)
      if (status >= 0) call h5eset_auto_f(0, status)
      if (status >= 0) call h5tcopy_f(H5T_STRING, text_type, status)
      if (status >= 0) call h5tset_cset_f(text_type, H5T_CSET_UTF8_F, status)
      if (status >= 0) call h5tcopy_f(H5T_C_S1, character_type, status)
      if (status >= 0) call h5tset_strpad_f(character_type, H5T_STR_NULLPAD_F, status)
      if (status >= 0) call h5pcreate_f(H5P_DATASET_XFER_F, transfer_settings, status)
      if (status >= 0) call h5pset_buffer_f(transfer_settings, conversion_bytes, status)
      is_library_open = status >= 0
      if (status < 0) call fail(error, "cannot start the HDF5 library")
   end subroutine start_library

   !> Disables file locking for files opened with these access properties.
   subroutine switch_locking_off(access, status)
      integer(hid_t), intent(in) :: access
      integer, intent(out) :: status

      status = h5pset_file_locking(int(access, c_int64_t), .false._c_bool, .true._c_bool)
   end subroutine switch_locking_off

   !> Raises an error for a negative status: the action, and the innermost cause that the library reports.
   subroutine check(status, action, error, location)
      integer, intent(in) :: status
      character(*), intent(in) :: action
      type(error_t), allocatable, intent(out) :: error
      character(*), intent(in), optional :: location   !! put before the message
      type(cause_t), target :: cause
      character(*), parameter :: opening = "error message = '"
      character(:), allocatable :: text
      integer :: i, ignored

      if (status >= 0) return
      ignored = h5ewalk2(0_c_int64_t, 0_c_int, c_funloc(store_innermost), c_loc(cause))
      text = ""
      do i = 1, cause%length
         text = text//cause%text(i)
      end do
      i = index(text, opening)                         ! message of the operating system within the details
      if (i > 0) text = text(i + len(opening):)
      if (i > 0) text = text(:index(text//"'", "'") - 1)
      if (index(text, "MPI_ERR_ACCESS") > 0 .or. index(text, "MPI_ERR_READ_ONLY") > 0) text = "Permission denied"
      if (cause%length > 0) text = " ("//text//")"
      call fail(error, "HDF5 cannot "//trim(action)//text)
      if (present(location)) call annotate(error, location)
   end subroutine check

   !> Callback of `H5Ewalk2`: stores the description of the innermost entry.
   integer(c_int) function store_innermost(depth, entry, data) bind(c)
      integer(c_int), value :: depth
      type(stack_entry_t), intent(in) :: entry
      type(c_ptr), value :: data
      type(cause_t), pointer :: cause
      character(:), allocatable :: text
      integer :: i

      store_innermost = 0
      if (depth /= 0) return
      call c_f_pointer(data, cause)
      text = c_text(entry%description)
      cause%length = min(len(text), max_cause)
      do i = 1, cause%length
         cause%text(i) = text(i:i)
      end do
   end function store_innermost

   !> Creates a dataspace; without extents it is that of a scalar.
   subroutine new_space(space, extents, status)
      integer(hid_t), intent(out) :: space
      integer(hsize_t), intent(in) :: extents(:)       !! fastest first
      integer, intent(out) :: status

      if (size(extents) == 0) then
         call h5screate_f(H5S_SCALAR_F, space, status)
      else
         call h5screate_simple_f(size(extents), extents, space, status)
      end if
   end subroutine new_space

   !> Returns the type of values of a kind in memory, for single bytes of text also in a file.
   integer(hid_t) function memory_type(kind) result(type)
      integer, intent(in) :: kind

      type = character_type
      if (kind == is_integer) type = H5T_NATIVE_INTEGER
      if (kind == is_real) type = H5T_NATIVE_DOUBLE
   end function memory_type

   !> Kind in which values of a file type are read, `is_real` if it is none of the three, which the library refuses to
   !> convert. Values that are not text, or of another size, must not be read into a text buffer.
   integer function kind_of_type(file_type) result(kind)
      integer(hid_t), intent(in) :: file_type
      integer(size_t) :: n_bytes
      integer :: class, status

      kind = is_real
      call h5tget_class_f(file_type, class, status)
      if (status >= 0) call h5tget_size_f(file_type, n_bytes, status)
      if (status < 0) return
      if (class == H5T_INTEGER_F) kind = is_integer
      if (class == H5T_STRING_F .and. n_bytes == 1) kind = is_characters
   end function kind_of_type
end module hb_hdf5_library
