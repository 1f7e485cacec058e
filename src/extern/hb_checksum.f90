!> Checksums that detect damage to stored numbers. Source of the interface: hb_checksum.h.
module hb_checksum
   use, intrinsic :: iso_c_binding, only: c_char, c_f_pointer, c_funptr, c_int, c_int32_t, c_loc, c_long_long, c_null_char, &
      c_ptr, c_size_t
   use, intrinsic :: iso_fortran_env, only: int8
   use hb_kinds, only: int64, wp
   implicit none
   private
   public :: bytes_in, checksum, checksum_of_zeros, checksum_rows, file_fingerprint, library_fingerprint

   !> The bytes of values, without a copy.
   interface bytes_in
      module procedure bytes_in_integers, bytes_in_reals
   end interface bytes_in

   interface
      integer(c_int32_t) function hb_add_to_checksum(so_far, bytes, n_bytes) bind(c, name="hb_add_to_checksum")
         import :: c_int32_t, c_ptr, c_size_t
         integer(c_int32_t), value :: so_far
         type(c_ptr), value :: bytes
         integer(c_size_t), value :: n_bytes
      end function hb_add_to_checksum

      integer(c_int32_t) function hb_add_zeros_to_checksum(so_far, n_bytes) bind(c, name="hb_add_zeros_to_checksum")
         import :: c_int32_t, c_size_t
         integer(c_int32_t), value :: so_far
         integer(c_size_t), value :: n_bytes
      end function hb_add_zeros_to_checksum

      integer(c_int) function hb_checksum_rows(path, offset, row_bytes, n_rows, checksums) bind(c, name="hb_checksum_rows")
         import :: c_char, c_int, c_int32_t, c_long_long
         character(c_char), intent(in) :: path(*)
         integer(c_long_long), value :: offset, row_bytes, n_rows
         integer(c_int32_t), intent(inout) :: checksums(*)
      end function hb_checksum_rows

      integer(c_int) function hb_checksum_of_file(path, sum, n_bytes) bind(c, name="hb_checksum_of_file")
         import :: c_char, c_int, c_int32_t, c_long_long
         character(c_char), intent(in) :: path(*)
         integer(c_int32_t), intent(out) :: sum
         integer(c_long_long), intent(out) :: n_bytes
      end function hb_checksum_of_file

      integer(c_int) function hb_checksum_of_library(address, sum, n_bytes) bind(c, name="hb_checksum_of_library")
         import :: c_funptr, c_int, c_int32_t, c_long_long
         type(c_funptr), value :: address
         integer(c_int32_t), intent(out) :: sum
         integer(c_long_long), intent(out) :: n_bytes
      end function hb_checksum_of_library
   end interface

   !> Continues a checksum, 0 at the beginning, over further values in memory order.
   interface checksum
      module procedure checksum_bytes, checksum_integers, checksum_reals, checksum_text
   end interface checksum

contains

   integer function checksum_bytes(so_far, values) result(sum)
      integer, intent(in) :: so_far
      integer(int8), intent(in), contiguous, target :: values(:)

      sum = so_far
      if (size(values) > 0) sum = hb_add_to_checksum(int(so_far, c_int32_t), c_loc(values), size(values, kind=c_size_t))
   end function checksum_bytes

   integer function checksum_integers(so_far, values) result(sum)
      integer, intent(in) :: so_far
      integer, intent(in), contiguous, target :: values(:)

      sum = so_far
      if (size(values) > 0) sum = hb_add_to_checksum(int(so_far, c_int32_t), c_loc(values), 4_c_size_t*size(values))
   end function checksum_integers

   integer function checksum_reals(so_far, values) result(sum)
      integer, intent(in) :: so_far
      real(wp), intent(in), contiguous, target :: values(:)

      sum = so_far
      if (size(values) > 0) sum = hb_add_to_checksum(int(so_far, c_int32_t), c_loc(values), 8_c_size_t*size(values))
   end function checksum_reals

   integer function checksum_text(so_far, text) result(sum)
      integer, intent(in) :: so_far
      character(*), intent(in), target :: text

      sum = hb_add_to_checksum(int(so_far, c_int32_t), c_loc(text), len(text, c_size_t))
   end function checksum_text

   !> Continues a checksum over bytes that are zero.
   integer function checksum_of_zeros(so_far, n_bytes) result(sum)
      integer, intent(in) :: so_far, n_bytes

      sum = hb_add_zeros_to_checksum(int(so_far, c_int32_t), int(n_bytes, c_size_t))
   end function checksum_of_zeros

   !> Continues the checksum of each row over its bytes in a part of a file in which rows are contiguous; `ok` is
   !> false if it cannot be read.
   subroutine checksum_rows(path, offset, row_bytes, checksums, ok)
      character(*), intent(in) :: path
      integer(int64), intent(in) :: offset, row_bytes
      integer, intent(inout) :: checksums(:)                          !! (rows)
      logical, intent(out) :: ok

      ok = hb_checksum_rows(path//c_null_char, int(offset, c_long_long), int(row_bytes, c_long_long), &
         size(checksums, kind=c_long_long), checksums) == 0
   end subroutine checksum_rows

   !> Fingerprint of a shared library, identified by a loaded function: its checksum and length.
   function library_fingerprint(address) result(text)
      type(c_funptr), intent(in) :: address
      character(60) :: text
      integer(c_int32_t) :: sum
      integer(c_long_long) :: n_bytes

      text = "unknown"
      if (hb_checksum_of_library(address, sum, n_bytes) == 0) text = fingerprint_of(sum, n_bytes)
   end function library_fingerprint

   !> The same of a library that is not loaded; "unknown" if the file cannot be read.
   function file_fingerprint(path) result(text)
      character(*), intent(in) :: path
      character(60) :: text
      integer(c_int32_t) :: sum
      integer(c_long_long) :: n_bytes

      text = "unknown"
      if (hb_checksum_of_file(path//c_null_char, sum, n_bytes) == 0) text = fingerprint_of(sum, n_bytes)
   end function file_fingerprint

   function fingerprint_of(sum, n_bytes) result(text)
      integer(c_int32_t), intent(in) :: sum
      integer(c_long_long), intent(in) :: n_bytes
      character(60) :: text

      write (text, "(a, z8.8, a, i0, a)") "CRC-32 ", sum, ", ", n_bytes, " bytes"
   end function fingerprint_of

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
end module hb_checksum
