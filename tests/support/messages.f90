!> What a test says of an error that it did not expect.
module messages
   use hb_error, only: error_t
   implicit none
   private
   public :: message_of

contains

   !> Message of an error, empty without one: a test that expects none says what went wrong.
   pure function message_of(error) result(message)
      type(error_t), allocatable, intent(in) :: error
      character(:), allocatable :: message

      message = ""
      if (allocated(error)) message = error%message
   end function message_of

end module messages
