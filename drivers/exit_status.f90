!> Exit statuses of the program, listed in `nhbm --help` and docs/user/running.md.
module exit_status
   implicit none
   private
   public :: bad_input, incomplete, not_all_right, success

   integer, parameter :: success = 0
   integer, parameter :: not_all_right = 1             !! some points did not converge, or a derivative is wrong
   integer, parameter :: bad_input = 2                 !! bad command line or input, failure with a file
   integer, parameter :: incomplete = 3                !! points are left, which `resume` solves
end module exit_status
