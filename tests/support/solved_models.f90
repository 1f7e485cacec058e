!> Models for tests and their motions.
module solved_models
   use hb_error, only: error_t
   use hb_model, only: model_t
   use hb_motion_result, only: motion_result_t
   implicit none
   private
   public :: solve_text

   interface

      !> Reads and solves a model.
      module subroutine solve_text(text, model, result, error)
         character(*), intent(in) :: text
         type(model_t), intent(out) :: model
         type(motion_result_t), intent(out) :: result
         type(error_t), allocatable, intent(out) :: error
      end subroutine solve_text

   end interface

end module solved_models

submodule (solved_models) solved_by_motion
   use hb_motion, only: solve_motion
   use models, only: make_model
   implicit none

contains

   module procedure solve_text
      call make_model(text, model, error)
      if (.not. allocated(error)) call solve_motion(model, result, error)
   end procedure solve_text

end submodule solved_by_motion
