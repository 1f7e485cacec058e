!> nhbm fit: the command `nhbm-model fit` of the Python package takes the place of this process.
module verb_fit
   use, intrinsic :: iso_c_binding, only: c_char, c_int, c_loc, c_null_char, c_null_ptr, c_ptr
   use hb_error, only: error_t, fail
   use hb_text, only: string_t
   implicit none
   private
   public :: run_fit

   interface
      !> Replaces the program of this process; returns only if this fails.
      integer(c_int) function execvp(file, words) bind(c, name="execvp")
         import :: c_char, c_int, c_ptr
         character(c_char), intent(in) :: file(*)
         type(c_ptr), intent(in) :: words(*)
      end function execvp
   end interface

   character(*), parameter :: command = "nhbm-model"

contains

   !> Starts the command with the words behind the verb; returns with an error if it cannot be started.
   subroutine run_fit(words, error)
      type(string_t), intent(in) :: words(:)
      type(error_t), allocatable, intent(out) :: error
      integer :: i, longest

      longest = len(command)
      do i = 1, size(words)
         longest = max(longest, len(words(i)%value))
      end do
      block
         character(longest + 1, c_char), target :: texts(size(words) + 2)
         type(c_ptr) :: arguments(size(words) + 3)

         texts(1) = command//c_null_char
         texts(2) = "fit"//c_null_char
         do i = 1, size(words)
            texts(i + 2) = words(i)%value//c_null_char
         end do
         do i = 1, size(texts)
            arguments(i) = c_loc(texts(i))
         end do
         arguments(size(arguments)) = c_null_ptr
         if (execvp(command//c_null_char, arguments) /= 0) &
            call fail(error, "fit is a command of the Python package, "//command//" fit, which is not found: "// &
                      "install the package (pip install nhbm) or add its folder to PATH")
      end block
   end subroutine run_fit
end module verb_fit
