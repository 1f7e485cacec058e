!> Memory available to this process, and memory used by it.
!>
!> Source: proc(5) (MemAvailable), getrlimit(2) of Linux, and the control groups of its kernel (version 2, memory.max). A
!> limit that the system does not report counts as none.
module hb_memory
   use, intrinsic :: iso_c_binding, only: c_int, c_long
   use hb_kinds, only: int64, wp
   implicit none
   private
   public :: available_memory, retain_freed_memory

   integer(c_int), parameter :: address_space = 9                     ! RLIMIT_AS of Linux

   type, bind(c) :: limits_t
      integer(c_long) :: soft, hard                                   ! unsigned in C: negative means no limit
   end type limits_t

   interface
      integer(c_int) function c_getrlimit(resource, limits) bind(c, name="getrlimit")
         import :: c_int, limits_t
         integer(c_int), value :: resource
         type(limits_t), intent(out) :: limits
      end function c_getrlimit

      !> Lets this process retain so much freed memory: each level, error estimate and point allocates as much as the previous
      !> one, and new pages from the system must first be cleared. Source of the interface: hb_heap.h.
      subroutine retain_freed_memory(n_mebibytes) bind(c, name="hb_retain_freed_memory")
         import :: c_int
         integer(c_int), value :: n_mebibytes                         !! < 2048
      end subroutine retain_freed_memory
   end interface

contains

   !> Returns the bytes that all processes of this computer together can still allocate, huge() if not known.
   real(wp) function available_memory()
      type(limits_t) :: limits
      real(wp) :: group, used

      available_memory = huge(1.0_wp)
      call lower_to(available_memory, 1024*number_in("/proc/meminfo", "MemAvailable:"))
      group = number_in("/sys/fs/cgroup/memory.max", "")
      used = number_in("/sys/fs/cgroup/memory.current", "")
      if (group > 0.0_wp .and. used > 0.0_wp) call lower_to(available_memory, max(1.0_wp, group - used))
      if (c_getrlimit(address_space, limits) == 0) call lower_to(available_memory, real(limits%soft, wp))
   end function available_memory

   pure subroutine lower_to(limit, other)
      real(wp), intent(inout) :: limit
      real(wp), intent(in) :: other                                   !! ignored unless positive

      if (other > 0.0_wp) limit = min(limit, other)
   end subroutine lower_to

   !> The number after the first word `key` of a system file, 0 if there is none.
   real(wp) function number_in(path, key)
      character(*), intent(in) :: path, key
      character(200) :: line
      integer(int64) :: number
      integer :: iostat, unit

      number_in = 0.0_wp
      open (newunit=unit, file=path, action="read", status="old", iostat=iostat)
      if (iostat /= 0) return
      do
         read (unit, "(a)", iostat=iostat) line
         if (iostat /= 0) exit
         if (index(line, key) /= 1) cycle
         read (line(len(key) + 1:), *, iostat=iostat) number
         if (iostat == 0) number_in = real(number, wp)
         exit
      end do
      close (unit, iostat=iostat)
   end function number_in
end module hb_memory
