!> Values as the bytes that they are in memory.
module hb_bytes
   use, intrinsic :: iso_c_binding, only: c_f_pointer, c_loc
   use, intrinsic :: iso_fortran_env, only: int8
   use hb_kinds, only: wp
   implicit none
   private
   public :: bytes_in

   !> The bytes of values, in their place.
   interface bytes_in
      module procedure bytes_in_integers, bytes_in_reals
   end interface bytes_in

contains

   function bytes_in_integers(values) result(bytes)
      integer, intent(in), contiguous, target :: values(..)
      integer(int8), pointer, contiguous :: bytes(:)

      call c_f_pointer(c_loc(values), bytes, [4*size(values)])
   end function bytes_in_integers

   function bytes_in_reals(values) result(bytes)
      real(wp), intent(in), contiguous, target :: values(..)
      integer(int8), pointer, contiguous :: bytes(:)

      call c_f_pointer(c_loc(values), bytes, [8*size(values)])
   end function bytes_in_reals
end module hb_bytes
