!> Exit statuses of the program, listed in `nhbm --help` and docs/user/running.md. 1 is not used: mpirun returns it for itself.
module exit_status
   implicit none
   private
   public :: bad_input, incomplete, not_all_right, success

   integer, parameter :: success = 0
   integer, parameter :: bad_input = 2                 !! invalid command line or input, or a file error
   integer, parameter :: incomplete = 3                !! unsolved points, which `resume` solves
   integer, parameter :: not_all_right = 4             !! points without a motion, or a wrong derivative
end module exit_status
