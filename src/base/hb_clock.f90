!> Wall-clock time.
module hb_clock
   use, intrinsic :: iso_fortran_env, only: int64
   use hb_kinds, only: wp
   implicit none
   private
   public :: wall_clock

contains

   !> Returns the seconds since a fixed moment [s], for differences. Works before `start_mpi`.
   real(wp) function wall_clock()
      integer(int64) :: ticks, ticks_per_second

      call system_clock(ticks, ticks_per_second)
      wall_clock = real(ticks, wp)/real(ticks_per_second, wp)
   end function wall_clock
end module hb_clock
