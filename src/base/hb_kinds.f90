!> Number kinds, sizes in memory and mathematical constants used everywhere.
module hb_kinds
   use, intrinsic :: iso_fortran_env, only: int64, real32, real64
   implicit none
   private
   public :: complex_bytes, gib, int64, pi, real_bytes, sp, two_pi, wp

   integer, parameter :: wp = real64                                  !! working precision
   integer, parameter :: sp = real32                                  !! of factors that iterations correct
   real(wp), parameter :: pi = acos(-1.0_wp)
   real(wp), parameter :: two_pi = 2.0_wp*pi
   real(wp), parameter :: real_bytes = 8.0_wp, complex_bytes = 16.0_wp   !! of a number
   real(wp), parameter :: gib = 1024.0_wp**3                          !! bytes
end module hb_kinds
