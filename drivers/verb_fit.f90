!> nhbm fit: the command `nhbm-model fit` of the Python package takes the place of this process.
module verb_fit
   use hb_error, only: error_t, fail
   use hb_operating_system, only: replace_process
   use hb_text, only: string_t
   implicit none
   private
   public :: run_fit

   character(*), parameter :: command = "nhbm-model"

contains

   !> Starts the command with the words behind the verb; returns with an error if it cannot be started.
   subroutine run_fit(words, error)
      type(string_t), intent(in) :: words(:)
      type(error_t), allocatable, intent(out) :: error

      call replace_process(command, [string_t("fit"), words])
      call fail(error, "fit is a command of the Python package, "//command//" fit, which is not found: "// &
                "install the package (pip install nhbm) or add its folder to PATH")
   end subroutine run_fit
end module verb_fit
