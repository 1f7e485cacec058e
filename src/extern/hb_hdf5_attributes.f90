!> Attributes of files and datasets.
module hb_hdf5_attributes
   use, intrinsic :: iso_c_binding, only: c_loc, c_null_char, c_null_ptr, c_ptr
   use hb_c_text, only: c_text
   use hb_crash_handler, only: record_entry
   use hb_error, only: error_t, fail
   use hb_hdf5_library, only: check, new_space, no_id, text_type
   use hb_kinds, only: wp
   use hb_text, only: to_text
   use hdf5, only: h5aclose_f, h5acreate_f, h5aget_space_f, h5aopen_f, h5aread_f, h5awrite_f, &
      h5dvlen_reclaim_f, H5P_DEFAULT_F, h5sclose_f, h5sget_simple_extent_npoints_f, H5T_IEEE_F64LE, &
      H5T_NATIVE_DOUBLE, H5T_NATIVE_INTEGER, H5T_STD_I32LE, hid_t, hsize_t
   implicit none
   private
   public :: h5_object_t

   !> An object with attributes: a file (its root group) or a dataset.
   type :: h5_object_t
      integer(hid_t) :: id = no_id
      character(:), allocatable :: location            ! name in messages
   contains
      generic :: get_attribute => get_integer_attribute, get_text_attribute
      generic :: set_attribute => set_integer_attribute, set_number_attribute, set_text_attribute
      procedure, private :: get_integer_attribute => object_get_integer_attribute
      procedure, private :: get_text_attribute => object_get_text_attribute
      procedure, private :: set_integer_attribute => object_set_integer_attribute
      procedure, private :: set_number_attribute => object_set_number_attribute
      procedure, private :: set_text_attribute => object_set_text_attribute
   end type h5_object_t

contains

   !> Sets an attribute of one string of any length; for serial files only.
   subroutine object_set_text_attribute(self, name, value, error)
      class(h5_object_t), intent(in) :: self
      character(*), intent(in) :: name
      character(*), intent(in) :: value
      type(error_t), allocatable, intent(out) :: error
      character(:), allocatable, target :: bytes
      type(c_ptr), target :: address

      bytes = value//c_null_char
      address = c_loc(bytes)
      call set_attribute(self, name, text_type, text_type, [integer(hsize_t) ::], c_loc(address), error)
   end subroutine object_set_text_attribute

   !> Sets an attribute of one or several integers.
   subroutine object_set_integer_attribute(self, name, values, error)
      class(h5_object_t), intent(in) :: self
      character(*), intent(in) :: name
      integer, intent(in), contiguous, target :: values(..)
      type(error_t), allocatable, intent(out) :: error
      call set_attribute(self, name, H5T_STD_I32LE, H5T_NATIVE_INTEGER, shape(values, hsize_t), c_loc(values), error)
   end subroutine object_set_integer_attribute

   !> Sets an attribute of one number.
   subroutine object_set_number_attribute(self, name, value, error)
      class(h5_object_t), intent(in) :: self
      character(*), intent(in) :: name
      real(wp), intent(in), target :: value
      type(error_t), allocatable, intent(out) :: error

      call set_attribute(self, name, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, [integer(hsize_t) ::], c_loc(value), error)
   end subroutine object_set_number_attribute

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
      call check(status, "set attribute '"//name//"'", error, self%location)
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
      integer(hid_t) :: attribute, space
      integer :: status

      addresses = c_null_ptr
      list = c_loc(addresses)
      call open_single(self, name, attribute, error)
      if (allocated(error)) return
      call h5aread_f(attribute, text_type, list, status)
      call check(status, "read attribute '"//name//"'", error, self%location)
      if (allocated(error)) return
      value = c_text(addresses(1))
      call h5aget_space_f(attribute, space, status)
      call h5dvlen_reclaim_f(text_type, space, H5P_DEFAULT_F, list, status)
      call h5sclose_f(space, status)
      call h5aclose_f(attribute, status)
   end subroutine object_get_text_attribute

   !> Reads an attribute of one integer.
   subroutine object_get_integer_attribute(self, name, value, error)
      class(h5_object_t), intent(in) :: self
      character(*), intent(in) :: name
      integer, intent(out) :: value
      type(error_t), allocatable, intent(out) :: error
      integer(hid_t) :: attribute
      type(c_ptr) :: address                           ! the library requires variables for addresses
      integer, target :: found
      integer :: status

      found = 0
      address = c_loc(found)
      call open_single(self, name, attribute, error)
      value = found
      if (allocated(error)) return
      call h5aread_f(attribute, H5T_NATIVE_INTEGER, address, status)
      call check(status, "read attribute '"//name//"'", error, self%location)
      value = found
      if (.not. allocated(error)) call h5aclose_f(attribute, status)
   end subroutine object_get_integer_attribute

   !> Opens an attribute of one value; several would exceed the memory of the caller.
   subroutine open_single(self, name, attribute, error)
      class(h5_object_t), intent(in) :: self
      character(*), intent(in) :: name
      integer(hid_t), intent(out) :: attribute
      type(error_t), allocatable, intent(out) :: error
      integer(hid_t) :: space
      integer(hsize_t) :: n_values
      integer :: status

      call record_entry(name)
      call h5aopen_f(self%id, name, attribute, status)
      if (status >= 0) call h5aget_space_f(attribute, space, status)
      if (status >= 0) call h5sget_simple_extent_npoints_f(space, n_values, status)
      call check(status, "read attribute '"//name//"'", error, self%location)
      if (allocated(error)) return
      call h5sclose_f(space, status)
      if (n_values == 1) return
      call fail(error, self%location//": attribute '"//name//"' has "//to_text(n_values)//" values, expected 1")
      call h5aclose_f(attribute, status)
   end subroutine open_single
end module hb_hdf5_attributes
