!> Number kinds and mathematical constants used everywhere.
module hb_kinds
   use, intrinsic :: iso_fortran_env, only: int64, real64
   implicit none
   private
   public :: int64, pi, two_pi, wp

   integer, parameter :: wp = real64                                  !! working precision
   real(wp), parameter :: pi = acos(-1.0_wp)
   real(wp), parameter :: two_pi = 2.0_wp*pi
end module hb_kinds
