!> Calls of external code, user libraries of laws and their loader, which may end the process. A program may set
!> callbacks that run before and after each of them, such as a signal handler; set them before threads start.
module hb_outside_code
   implicit none
   private
   public :: begin_outside_code, end_outside_code, set_outside_code_callbacks

   abstract interface
      subroutine begin_hook(text)
         character(*), intent(in) :: text                             !! information for the user if the process ends
      end subroutine begin_hook

      subroutine end_hook()
      end subroutine end_hook
   end interface

   procedure(begin_hook), pointer :: before => null()
   procedure(end_hook), pointer :: after => null()

contains

   !> Sets the callbacks that run before and after each call of external code.
   subroutine set_outside_code_callbacks(before_it, after_it)
      procedure(begin_hook) :: before_it
      procedure(end_hook) :: after_it

      before => before_it
      after => after_it
   end subroutine set_outside_code_callbacks

   !> Marks the beginning of such a call; `text` informs the user if the process ends within it.
   subroutine begin_outside_code(text)
      character(*), intent(in) :: text

      if (associated(before)) call before(text)
   end subroutine begin_outside_code

   !> Marks the return of the call.
   subroutine end_outside_code()
      if (associated(after)) call after()
   end subroutine end_outside_code
end module hb_outside_code
