!> Time integration for the callbacks of a model: its time-domain solver, and stability.
module hb_time_integration
   use hb_attractors, only: find_from_starts
   use hb_departure, only: find_departure
   use hb_floquet, only: least_work
   use hb_integrated_floquet, only: integrated_floquet_t
   use hb_integrated_start, only: integrated_guess
   use hb_kinds, only: wp
   use hb_locking_search, only: find_locking
   use hb_options, only: callbacks_t, time_domain_solver_t
   implicit none
   private
   public :: add_time_integration

   type, extends(time_domain_solver_t) :: time_integration_t
   contains
      procedure, nopass :: find_steady_motion => find_from_starts
      procedure, nopass :: first_guess => integrated_guess
      procedure, nopass :: find_locking
      procedure, nopass :: find_departure
   end type time_integration_t

contains

   !> Adds time integration to the callbacks of the points of a run. Stability may use half a second in total, or four
   !> milliseconds for each point, in addition to its share of the work there; along a curve the latter, since nobody knows
   !> how many points it will have. Time integration may use as much for all points together as for a single one, or little
   !> for each.
   subroutine add_time_integration(callbacks, is_followed, n_points)
      type(callbacks_t), intent(inout) :: callbacks
      logical, intent(in) :: is_followed                              !! the run is a curve
      integer, intent(in), optional :: n_points                       !! of the run; 0: nothing in addition for stability;
                                                                      !! default: the least for each point
      type(integrated_floquet_t) :: finder
      real(wp), parameter :: work_of_run = 0.5e9_wp

      callbacks%share_of_integration = 1.0_wp
      if (present(n_points)) then
         if (n_points == 0) then
            finder%work_in_any_case = 0.0_wp
         else
            if (.not. is_followed) finder%work_in_any_case = max(work_of_run/n_points, least_work)
            callbacks%share_of_integration = 1.0_wp/n_points
         end if
      end if
      if (allocated(callbacks%stability_finder)) deallocate (callbacks%stability_finder)
      allocate (callbacks%stability_finder, source=finder)
      if (.not. allocated(callbacks%time_domain_solver)) allocate (time_integration_t :: callbacks%time_domain_solver)
   end subroutine add_time_integration
end module hb_time_integration
