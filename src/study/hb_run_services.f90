!> Whom the scenes of a run ask: files for models, marching for what no linearised equations say of stability.
module hb_run_services
   use hb_kinds, only: wp
   use hb_marched_floquet, only: marched_floquet_t
   use hb_model_file, only: model_file_t
   use hb_scene, only: services_t
   implicit none
   private
   public :: run_services

contains

   !> All services of a run. Stability may take two seconds in all, which nobody notices, beside what it may take at each point.
   function run_services(n_points) result(services)
      integer, intent(in), optional :: n_points                       !! of the run; default: so many that nothing is left of it
      type(services_t) :: services
      type(marched_floquet_t) :: finder
      real(wp), parameter :: nanoseconds_of_run = 2.0e9_wp

      allocate (services%models, source=model_file_t())
      if (present(n_points)) finder%work_in_any_case = nanoseconds_of_run/n_points
      allocate (services%finder, source=finder)
   end function run_services
end module hb_run_services
