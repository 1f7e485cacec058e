!> Memory that this process has, for nhbm-bench. Source: Linux, proc(5); glibc, malloc_trim(3).
module process_memory
   use, intrinsic :: iso_c_binding, only: c_int, c_size_t
   use hb_kinds, only: int64, wp
   implicit none
   private
   public :: memory_peak, memory_resident, release_memory, reset_memory_peak

   interface
      integer(c_int) function c_malloc_trim(pad) bind(c, name="malloc_trim")
         import :: c_int, c_size_t
         integer(c_size_t), value :: pad
      end function c_malloc_trim
   end interface

contains

   !> Gives memory that is free in this process back to the system, so that what was done before is not counted.
   subroutine release_memory()
      integer(c_int) :: ignored

      ignored = c_malloc_trim(0_c_size_t)
   end subroutine release_memory

   !> Lets `memory_peak` begin anew; where the system has no such thing, `ok` is false.
   subroutine reset_memory_peak(ok)
      logical, intent(out) :: ok
      integer :: status, unit

      open (newunit=unit, file="/proc/self/clear_refs", action="write", status="old", iostat=status)
      ok = status == 0
      if (.not. ok) return
      write (unit, "(a)", iostat=status) "5"
      ok = status == 0
      close (unit, iostat=status)
      ok = ok .and. status == 0
   end subroutine reset_memory_peak

   !> Gives the most memory [byte] that was in use since `reset_memory_peak`; 0 where it is not known.
   real(wp) function memory_peak()
      memory_peak = 1024*number_behind("VmHWM:")
   end function memory_peak

   !> Gives the memory [byte] that is in use now; 0 where it is not known.
   real(wp) function memory_resident()
      memory_resident = 1024*number_behind("VmRSS:")
   end function memory_resident

   !> The number behind the first word `key` of the status of this process, 0 where there is none.
   real(wp) function number_behind(key) result(found)
      character(*), intent(in) :: key
      character(200) :: line
      integer(int64) :: number
      integer :: iostat, unit

      found = 0.0_wp
      open (newunit=unit, file="/proc/self/status", action="read", status="old", iostat=iostat)
      do while (iostat == 0)
         read (unit, "(a)", iostat=iostat) line
         if (iostat /= 0 .or. index(line, key) /= 1) cycle
         read (line(len(key) + 1:), *, iostat=iostat) number
         if (iostat == 0) found = real(number, wp)
         exit
      end do
      close (unit, iostat=iostat)
   end function number_behind
end module process_memory
