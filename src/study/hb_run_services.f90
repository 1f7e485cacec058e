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

   !> All services of a run. Stability may take two seconds in all, which nobody notices, beside what it may take at each point. Time
   !> integration may take as much at all points together as at a single one, but not less than a fortieth of it, a second.
   function run_services(n_points) result(services)
      integer, intent(in), optional :: n_points                       !! of the run; default: so many that nothing is left of it
      type(services_t) :: services
      type(marched_floquet_t) :: finder
      real(wp), parameter :: nanoseconds_of_run = 2.0e9_wp, least_share = 1.0_wp/40.0_wp

      allocate (services%models, source=model_file_t())
      if (present(n_points)) then
         finder%work_in_any_case = nanoseconds_of_run/n_points
         services%share_of_march = max(1.0_wp/n_points, least_share)
      end if
      allocate (services%finder, source=finder)
   end function run_services
end module hb_run_services
