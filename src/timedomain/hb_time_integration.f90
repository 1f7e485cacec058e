!> Time integration for the callbacks of a model: its time-domain solver, and stability.
module hb_time_integration
   use hb_coexisting_motions, only: settle_from_starts
   use hb_integrated_floquet, only: integrated_floquet_t
   use hb_integrated_start, only: integrated_guess
   use hb_kinds, only: wp
   use hb_locking, only: find_locking
   use hb_model, only: callbacks_t, time_domain_solver_t
   implicit none
   private
   public :: add_time_integration

   type, extends(time_domain_solver_t) :: time_integration_t
   contains
      procedure, nopass :: settle => settle_from_starts
      procedure, nopass :: first_guess => integrated_guess
      procedure, nopass :: find_locking
   end type time_integration_t

contains

   !> Adds time integration to the callbacks of the points of a run. Stability may use two seconds in total, in
   !> addition to its permitted work at each point. Time integration may use as much for all points together as for a
   !> single one, but at least a fortieth of it, a second, for each.
   subroutine add_time_integration(callbacks, n_points)
      type(callbacks_t), intent(inout) :: callbacks
      integer, intent(in) :: n_points                                 !! of the run; 0: no additional time for stability
      type(integrated_floquet_t) :: finder
      real(wp), parameter :: nanoseconds_of_run = 2.0e9_wp, least_share = 1.0_wp/40.0_wp

      callbacks%share_of_integration = 1.0_wp
      if (n_points > 0) then
         finder%work_in_any_case = nanoseconds_of_run/n_points
         callbacks%share_of_integration = max(1.0_wp/n_points, least_share)
      end if
      if (allocated(callbacks%stability_finder)) deallocate (callbacks%stability_finder)
      allocate (callbacks%stability_finder, source=finder)
      if (.not. allocated(callbacks%time_domain_solver)) allocate (time_integration_t :: callbacks%time_domain_solver)
   end subroutine add_time_integration
end module hb_time_integration
