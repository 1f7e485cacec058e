!> Callbacks of the models of a run: files for models, and time integration.
module hb_run_callbacks
   use hb_fe_model_file, only: fe_model_file_t
   use hb_integrated_floquet, only: integrated_floquet_t
   use hb_kinds, only: wp
   use hb_model, only: callbacks_t
   use hb_time_integration, only: time_integration_t
   implicit none
   private
   public :: run_callbacks

contains

   !> Makes the callbacks of a run. Stability may take two seconds in all, beside what it may take at each
   !> point. Time integration may take as much at all points together as at a single one, but not less than a fortieth of it, a
   !> second.
   function run_callbacks(n_points, is_followed) result(callbacks)
      integer, intent(in), optional :: n_points                       !! of the run; default: so many that nothing is left of it
      logical, intent(in), optional :: is_followed                    !! the motion is the first one of a curve; default: it is not
      type(callbacks_t) :: callbacks
      type(integrated_floquet_t) :: finder
      real(wp), parameter :: nanoseconds_of_run = 2.0e9_wp, least_share = 1.0_wp/40.0_wp

      allocate (callbacks%fe_models, source=fe_model_file_t())
      if (present(is_followed)) callbacks%is_followed = is_followed
      if (present(n_points)) then
         finder%work_in_any_case = nanoseconds_of_run/n_points
         callbacks%share_of_integration = max(1.0_wp/n_points, least_share)
      end if
      allocate (callbacks%stability_finder, source=finder)
      allocate (callbacks%time_domain_solver, source=time_integration_t())
   end function run_callbacks
end module hb_run_callbacks
