!> Callbacks of the models of a run: sources of models, and time integration.
module hb_run_callbacks
   use hb_fe_model_file, only: fe_model_file_t
   use hb_options, only: callbacks_t
   use hb_time_integration, only: add_time_integration
   implicit none
   private
   public :: run_callbacks

contains

   !> Creates the callbacks of a run.
   function run_callbacks(n_points, is_followed) result(callbacks)
      integer, intent(in), optional :: n_points                       !! of the run; default: as `add_time_integration`
      logical, intent(in), optional :: is_followed                    !! the run is a curve; default: false
      type(callbacks_t) :: callbacks
      logical :: is_curve

      allocate (callbacks%fe_models, source=fe_model_file_t())
      is_curve = .false.
      if (present(is_followed)) is_curve = is_followed
      call add_time_integration(callbacks, is_curve, n_points)
   end function run_callbacks
end module hb_run_callbacks
