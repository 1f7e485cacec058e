!> Models for tests, made from namelist text as a user would write it. What the reader needs is used by the submodule alone:
!> each suite would read it.
module models
   use hb_error, only: error_t
   use hb_model, only: model_t
   implicit none
   private
   public :: make_model

   interface

      !> Reads a model; one that is integrated in time alone may lack tones.
      module subroutine make_model(text, model, error, may_only_integrate)
         character(*), intent(in) :: text
         type(model_t), intent(out) :: model
         type(error_t), allocatable, intent(out) :: error
         logical, intent(in), optional :: may_only_integrate          !! default: false
      end subroutine make_model

   end interface

end module models

submodule (models) models_from_text
   use hb_document, only: document_t
   use hb_model_reader, only: read_model
   use hb_namelist, only: read_namelist
   use hb_options, only: purpose_t
   use hb_run_callbacks, only: run_callbacks
   use model_texts, only: one_group_a_line
   implicit none

contains

   module procedure make_model
      type(document_t), target :: document
      type(purpose_t) :: purpose

      if (present(may_only_integrate)) purpose%may_only_integrate = may_only_integrate
      call read_namelist(document, "test.nml", one_group_a_line(text), error)
      if (.not. allocated(error)) call read_model(model, document, error, callbacks=run_callbacks(), purpose=purpose)
   end procedure make_model

end submodule models_from_text
