!> Conversion of C strings to Fortran texts.
module hb_c_text
   use, intrinsic :: iso_c_binding, only: c_associated, c_char, c_f_pointer, c_ptr, c_size_t
   implicit none
   private
   public :: c_text

   interface
      pure integer(c_size_t) function c_strlen(text) bind(c, name="strlen")
         import :: c_ptr, c_size_t
         type(c_ptr), intent(in), value :: text
      end function c_strlen
   end interface

contains

   !> Returns a copy of a null-terminated string, of 2 GiB at most; empty for a null pointer.
   function c_text(address) result(text)
      type(c_ptr), intent(in) :: address
      character(c_length(address)) :: text
      character(c_char), pointer :: bytes(:)
      integer :: i

      if (.not. c_associated(address)) return
      call c_f_pointer(address, bytes, [len(text)])
      do i = 1, size(bytes)
         text(i:i) = bytes(i)
      end do
   end function c_text

   pure integer function c_length(address)
      type(c_ptr), intent(in) :: address

      c_length = 0
      if (c_associated(address)) c_length = int(min(c_strlen(address), int(huge(1), c_size_t)))
   end function c_length
end module hb_c_text
