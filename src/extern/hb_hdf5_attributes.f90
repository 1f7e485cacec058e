!> Attributes of files and datasets.
submodule (hb_hdf5) hb_hdf5_attributes
   use, intrinsic :: iso_c_binding, only: c_loc, c_null_char, c_null_ptr, c_ptr
   use hb_error, only: fail
   use hb_hdf5_library, only: c_text, new_space, new_text_type
   use hb_text, only: to_text
   use hdf5, only: h5aclose_f, h5acreate_f, h5aget_space_f, h5aopen_f, h5aread_f, h5awrite_f, &
      h5dvlen_reclaim_f, H5P_DEFAULT_F, h5sclose_f, h5sget_simple_extent_npoints_f, H5T_NATIVE_INTEGER, H5T_STD_I32LE, h5tclose_f
   implicit none

contains

   module procedure object_set_text_attribute
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
   end procedure object_set_text_attribute

   module procedure object_set_integer_attribute
      integer, target :: copy

      copy = value
      call set_attribute(self, name, H5T_STD_I32LE, H5T_NATIVE_INTEGER, [integer(hsize_t) ::], &
         c_loc(copy), error)
   end procedure object_set_integer_attribute

   module procedure object_set_integers_attribute
      call set_attribute(self, name, H5T_STD_I32LE, H5T_NATIVE_INTEGER, [size(values, kind=hsize_t)], &
         c_loc(values), error)
   end procedure object_set_integers_attribute

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
      call check(status, "set attribute '"//name//"'", error, self%place)
      if (allocated(error)) return
      call h5aclose_f(attribute, status)
      call h5sclose_f(space, status)
   end subroutine set_attribute

   module procedure object_get_text_attribute
      type(c_ptr), target :: addresses(1)
      type(c_ptr) :: list
      integer(hid_t) :: attribute, space, text_type
      integer :: status

      addresses = c_null_ptr
      list = c_loc(addresses)
      call open_single(self, name, attribute, error)
      if (allocated(error)) return
      call new_text_type(text_type, status)
      if (status >= 0) call h5aread_f(attribute, text_type, list, status)
      call check(status, "read attribute '"//name//"'", error, self%place)
      if (allocated(error)) return
      value = c_text(addresses(1))
      call h5aget_space_f(attribute, space, status)
      call h5dvlen_reclaim_f(text_type, space, H5P_DEFAULT_F, list, status)
      call h5sclose_f(space, status)
      call h5tclose_f(text_type, status)
      call h5aclose_f(attribute, status)
   end procedure object_get_text_attribute

   module procedure object_get_integer_attribute
      integer(hid_t) :: attribute
      type(c_ptr) :: address                           ! the library wants variables for addresses
      integer, target :: found
      integer :: status

      found = 0
      address = c_loc(found)
      call open_single(self, name, attribute, error)
      value = found
      if (allocated(error)) return
      call h5aread_f(attribute, H5T_NATIVE_INTEGER, address, status)
      call check(status, "read attribute '"//name//"'", error, self%place)
      value = found
      if (.not. allocated(error)) call h5aclose_f(attribute, status)
   end procedure object_get_integer_attribute

   !> Opens an attribute of one value: several would not fit into the memory that waits for it.
   subroutine open_single(self, name, attribute, error)
      class(h5_object_t), intent(in) :: self
      character(*), intent(in) :: name
      integer(hid_t), intent(out) :: attribute
      type(error_t), allocatable, intent(out) :: error
      integer(hid_t) :: space
      integer(hsize_t) :: n_values
      integer :: status

      call h5aopen_f(self%id, name, attribute, status)
      if (status >= 0) call h5aget_space_f(attribute, space, status)
      if (status >= 0) call h5sget_simple_extent_npoints_f(space, n_values, status)
      call check(status, "read attribute '"//name//"'", error, self%place)
      if (allocated(error)) return
      call h5sclose_f(space, status)
      if (n_values == 1) return
      call fail(error, self%place//": attribute '"//name//"' has "//to_text(n_values)//" values, expected 1")
      call h5aclose_f(attribute, status)
   end subroutine open_single
end submodule hb_hdf5_attributes
