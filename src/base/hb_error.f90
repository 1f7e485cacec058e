!> The error value: bad input or a failed library call, carried to the caller as the last argument.
!>
!> Raise with `fail`, test with `allocated(error)`, add the location with `annotate` when passing on. A solver that
!> does not converge is not an error but an outcome (hb_outcome).
module hb_error
   implicit none
   private
   public :: annotate, error_t, fail

   type :: error_t
      character(:), allocatable :: message                            !! what is wrong, where, and what would be correct
   end type error_t

contains

   !> Raises an error with the given message.
   pure subroutine fail(error, message)
      type(error_t), allocatable, intent(out) :: error
      character(*), intent(in) :: message

      allocate (error)
      error%message = message
   end subroutine fail

   !> Prepends `location` to the message of an error that is passed on; does nothing without an error.
   pure subroutine annotate(error, location)
      type(error_t), allocatable, intent(inout) :: error
      character(*), intent(in) :: location

      if (allocated(error)) error%message = location//": "//error%message
   end subroutine annotate
end module hb_error
