!> Crashes of single points: if the solution of a point ends the whole process, for instance in a user's law, the signal
!> handler writes a status into the result file first. Source of the interface: hb_crash.h.
module hb_crash_detection
   use, intrinsic :: iso_c_binding, only: c_char, c_int, c_long_long, c_null_char
   use, intrinsic :: iso_fortran_env, only: int64
   implicit none
   private
   public :: begin_point, crash_location_t, detect_crashes, end_crash_detection, end_point

   !> What is recorded for a crash, and where: byte offsets of the first rows in the file.
   type :: crash_location_t
      integer(int64) :: status_offset = -1             !! rows of four bytes, least significant first; negative: nothing is recorded
      integer(int64) :: message_offset = -1            !! rows of `message_length` bytes; negative: no message
      integer :: message_length = 0                    !! at most 512
      integer :: status = 0                            !! status of a crashed point
      integer :: exit_status = 1                       !! exit status if exit() ends the process within a point
   end type crash_location_t

   type, bind(c) :: hb_crash_location_t
      integer(c_long_long) :: status_offset, message_offset, message_length
      integer(c_int) :: status, exit_status
   end type hb_crash_location_t

   interface
      integer(c_int) function hb_detect_crashes(path, location) bind(c, name="hb_detect_crashes")
         import :: c_char, c_int, hb_crash_location_t
         character(c_char), intent(in) :: path(*)
         type(hb_crash_location_t), intent(in) :: location
      end function hb_detect_crashes

      subroutine hb_begin_point(row) bind(c, name="hb_begin_point")
         import :: c_long_long
         integer(c_long_long), value :: row
      end subroutine hb_begin_point

      !> Marks the end of the present point.
      subroutine end_point() bind(c, name="hb_end_point")
      end subroutine end_point

      !> Reverts `detect_crashes`; safe to call twice.
      subroutine end_crash_detection() bind(c, name="hb_end_crash_detection")
      end subroutine end_crash_detection
   end interface

contains

   !> Records crashes in the file at `path` from now on, by this rank for its own points. If the location is not known
   !> or the file cannot be opened a second time, crashes are not recorded; nothing else changes.
   subroutine detect_crashes(path, location)
      character(*), intent(in) :: path
      type(crash_location_t), intent(in) :: location
      integer(c_int) :: ignored

      ignored = hb_detect_crashes(path//c_null_char, hb_crash_location_t(int(location%status_offset, c_long_long), &
         int(location%message_offset, c_long_long), int(location%message_length, c_long_long), int(location%status, c_int), &
         int(location%exit_status, c_int)))
   end subroutine detect_crashes

   !> Marks the beginning of point `i`, counted from 1.
   subroutine begin_point(i)
      integer, intent(in) :: i

      call hb_begin_point(int(i - 1, c_long_long))
   end subroutine begin_point
end module hb_crash_detection
