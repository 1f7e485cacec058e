!> Whom the scenes of a run ask: files for models, marching for what no linearised equations say of stability.
module hb_run_services
   use hb_marched_floquet, only: marched_floquet_t
   use hb_model_file, only: model_file_t
   use hb_scene, only: services_t
   implicit none
   private
   public :: run_services

contains

   !> All services of a run.
   function run_services() result(services)
      type(services_t) :: services

      allocate (services%models, source=model_file_t())
      allocate (services%finder, source=marched_floquet_t())
   end function run_services
end module hb_run_services
