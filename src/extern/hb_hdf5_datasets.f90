!> Datasets of a file: making, opening and closing them, their dimension scales.
submodule (hb_hdf5) hb_hdf5_datasets
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use, intrinsic :: iso_c_binding, only: c_char, c_loc, c_null_char, c_null_ptr, c_ptr
   use h5ds, only: h5dsattach_scale_f, h5dsis_attached_f, h5dsset_scale_f
   use hb_error, only: fail
   use hb_hdf5_library, only: new_byte_type, new_space, new_text_type
   use hb_text, only: to_text
   use hdf5, only: H5D_ALLOC_TIME_EARLY_F, H5D_FILL_TIME_ALLOC_F, h5dclose_f, h5dcreate_f, h5dget_offset_f, &
      h5dget_space_f, h5dget_type_f, h5dopen_f, h5dwrite_f, H5P_DATASET_CREATE_F, h5pset_alloc_time_f, &
      h5pset_fill_time_f, h5pset_fill_value_f, h5sclose_f, h5sget_simple_extent_dims_f, &
      h5sget_simple_extent_ndims_f, h5sget_simple_extent_type_f, H5S_NULL_F, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, &
      H5T_NATIVE_INTEGER, H5T_STD_I32LE, h5tclose_f, h5tequal_f, h5tget_size_f, haddr_t, size_t
   implicit none

contains

   module procedure file_add_real
      real(wp), target :: fill

      fill = ieee_value(fill, ieee_quiet_nan)
      call add_dataset(self, name, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, extents, c_loc(fill), dataset, error)
   end procedure file_add_real

   module procedure file_add_integer
      integer, target :: fill

      fill = 0
      call add_dataset(self, name, H5T_STD_I32LE, H5T_NATIVE_INTEGER, extents, c_loc(fill), dataset, error)
   end procedure file_add_integer

   module procedure file_add_characters
      integer(hid_t) :: byte_type
      integer :: status

      call new_byte_type(byte_type, status)
      call check(status, "make the text type", error)
      if (allocated(error)) return
      call add_dataset(self, name, byte_type, no_id, extents, c_null_ptr, dataset, error)
      call h5tclose_f(byte_type, status)
   end procedure file_add_characters

   module procedure file_add_texts
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
   end procedure file_add_texts

   module procedure file_add_text
      character(:), allocatable, target :: bytes
      type(c_ptr), target :: addresses(1)

      bytes = value//c_null_char
      addresses(1) = c_loc(bytes)
      call add_varying(self, name, [integer ::], addresses, dataset, error)
   end procedure file_add_text

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
         call check(status, "write", error, dataset%place)
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
      call check(status, "create", error, dataset%place)
      if (allocated(error)) then
         dataset%id = no_id
         return
      end if
      call h5pclose_f(properties, status)
      call h5sclose_f(space, status)
   end subroutine add_dataset

   module procedure file_open_dataset
      integer(hsize_t), allocatable :: max_extents(:)
      integer(hid_t) :: space
      integer :: class, n_dimensions, status

      dataset%place = self%place//": dataset '"//name//"'"
      call h5dopen_f(self%id, name, dataset%id, status)
      call check(status, "open", error, dataset%place)
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
      call check(status, "ask for the extents", error, dataset%place)
      if (.not. allocated(error)) then
         call h5sclose_f(space, status)
         if (class == H5S_NULL_F) then
            call fail(error, dataset%place//" holds nothing, not even a size")
         else if (any(dataset%extents > huge(1))) then
            call fail(error, dataset%place//" has an axis of "//to_text(maxval(dataset%extents))//" entries")
         end if
      end if
      if (allocated(error)) call dataset%close()
   end procedure file_open_dataset

   module procedure dataset_close
      integer :: status

      if (self%id /= no_id) call h5dclose_f(self%id, status)
      self%id = no_id
   end procedure dataset_close

   module procedure dataset_get_extents
      extents = int(self%extents)
   end procedure dataset_get_extents

   module procedure dataset_get_offset
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
   end procedure dataset_get_offset

   ! Dimension scales

   module procedure dataset_make_scale
      integer :: status

      call h5dsset_scale_f(self%id, status, name)
      call check(status, "make a dimension scale", error, self%place)
   end procedure dataset_make_scale

   module procedure dataset_attach_scale
      integer :: status

      call h5dsattach_scale_f(self%id, scale%id, file_index(self, i), status)
      call check(status, "attach a dimension scale", error, self%place)
   end procedure dataset_attach_scale

   module procedure dataset_has_scale
      integer :: status

      call h5dsis_attached_f(self%id, scale%id, file_index(self, i), is_attached, status)
      is_attached = is_attached .and. status >= 0
   end procedure dataset_has_scale

   !> Gives the number of a dimension in the order of the file: `h5ds`, unlike the rest of the Fortran
   !> interface, does not reverse it.
   pure integer function file_index(self, i)
      class(h5_dataset_t), intent(in) :: self
      integer, intent(in) :: i

      file_index = size(self%extents) - i + 1
   end function file_index
end submodule hb_hdf5_datasets
