!> The time-domain solver of a model's callbacks: time integration.
module hb_time_integration
   use hb_coexisting_motions, only: settle_from_starts
   use hb_integrated_start, only: integrated_guess
   use hb_locking, only: find_locking
   use hb_model, only: time_domain_solver_t
   implicit none
   private
   public :: time_integration_t

   type, extends(time_domain_solver_t) :: time_integration_t
   contains
      procedure, nopass :: settle => settle_from_starts
      procedure, nopass :: first_guess => integrated_guess
      procedure, nopass :: find_locking
   end type time_integration_t
end module hb_time_integration
