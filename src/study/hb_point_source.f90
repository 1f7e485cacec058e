!> The document, plan and model from which one rank creates its points.
module hb_point_source
   use hb_cached_parts, only: cached_balances_t
   use hb_document, only: document_t
   use hb_inactive_laws, only: inactive_laws_t
   use hb_kinds, only: wp
   use hb_law_findings, only: law_findings_t
   use hb_model, only: model_t
   use hb_options, only: callbacks_t, purpose_t
   use hb_results_layout, only: results_layout_t
   use hb_sweep_plan, only: sweep_plan_t
   implicit none
   private
   public :: point_source_t

   !> The input, in which the values of a point are set, and the layout of the file for its result.
   type :: point_source_t
      type(document_t) :: document                                    !! with the values of the point read last
      type(model_t) :: model                                          !! of that point
      type(callbacks_t) :: callbacks                                   !! for models that are read again
      type(purpose_t) :: purpose                                       !! of their motions
      type(sweep_plan_t) :: plan                                      !! values of all points
      type(results_layout_t) :: layout                                !! of the file
      real(wp) :: available_memory = huge(1.0_wp)                     !! bytes
      type(cached_balances_t) :: cached                           !! of the point solved last
      integer :: rank = 0                                             !! of this process
      type(law_findings_t) :: law_findings                                  !! at the first motion
      type(inactive_laws_t) :: inactive_laws                                  !! in all motions of this process
   end type point_source_t
end module hb_point_source
