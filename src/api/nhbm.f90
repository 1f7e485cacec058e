!> nhbm for programs in Fortran: the only module that they use.
!>
!>     type(model_t), target :: model
!>     type(error_t), allocatable :: error
!>     call model%read("my model", text, error)                   ! the text of an input (docs/user/input.md)
!>     call model%locate("tones%frequency", tones, error)         ! or model%add_group("tones", tones, error), without a text
!>     do i = 1, n
!>        call model%set(tones, "frequency", values(i:i), error)
!>        call model%solve(is_warm=i > 1, error=error)
!>        if (model%result%status == outcome%converged) print *, model%result%coefficients(:, 1, 1)
!>     end do
!>     call model%destroy()
!>
!> `model%result` contains all results of the last motion; a `columns_t` also finds them by the names of the result file,
!> `call columns%find_of_motion(model, "power_in", error)`, with `labels_along` their axes. For structures given as matrices:
!> extend `structure_source_t` and pass it to `model%set_structure_source`. For laws of the program: `register_law` registers a
!> `law_info_t` and a function of `law_samples_t`, as nhbm_user_law.h describes them.
module nhbm
   use hb_error, only: error_t
   use hb_fe_model, only: structure_data_t => fe_model_t, structure_source_t => fe_model_source_t
   use hb_kinds, only: wp
   use hb_motion_result, only: motion_result_t
   use hb_outcome, only: outcome, outcome_names
   use hb_session, only: model_t => session_t
   use hb_session_columns, only: columns_t => session_columns_t, labels_along
   use hb_sparse, only: new_sparse, sparse_t
   use hb_text, only: string_t
   use hb_user_library, only: law_api => api_version, law_info_t, law_samples_t, law_step_t, register_law, unregister_law
   use hb_version, only: program_version
   implicit none
   private
   public :: columns_t, error_t, labels_along, law_api, law_info_t, law_samples_t, law_step_t, model_t, motion_result_t, &
      new_sparse, outcome, outcome_names, program_version, register_law, sparse_t, string_t, structure_data_t, structure_source_t, &
      unregister_law, wp
end module nhbm
