!> A guard around calls of libraries that die of damaged files, such as HDF5 and the loader of shared libraries: the process
!> still ends, for its memory may be spoilt, but with a message and the exit status of bad input.
module hb_guard
   use, intrinsic :: iso_c_binding, only: c_char, c_int, c_null_char
   implicit none
   private
   public :: lower_guard, raise_guard

   integer(c_int), parameter :: bad_input = 2                         ! exit status, docs/user/running.md
   integer, parameter :: longest = 1000

   interface
      integer(c_int) function hb_raise_guard(text, exit_status) bind(c, name="hb_raise_guard")
         import :: c_char, c_int
         character(c_char), intent(in) :: text(*)
         integer(c_int), value :: exit_status
      end function hb_raise_guard

      subroutine hb_lower_guard() bind(c, name="hb_lower_guard")
      end subroutine hb_lower_guard
   end interface

contains

   !> From here on a signal such as SIGSEGV or SIGBUS makes the process write `text`, cut to 1000 bytes, and end. Where the
   !> system does not allow this, the signal does what it would have done.
   subroutine raise_guard(text)
      character(*), intent(in) :: text                                !! what the user should know; `nhbm: ` comes before it
      integer(c_int) :: ignored

      ignored = hb_raise_guard("nhbm: "//text(:min(len(text), longest))//new_line("a")//c_null_char, bad_input)
   end subroutine raise_guard

   !> Ends what `raise_guard` began.
   subroutine lower_guard()
      call hb_lower_guard()
   end subroutine lower_guard
end module hb_guard
