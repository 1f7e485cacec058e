!> One point, for the command, C and Python alike: its model is solved from its neighbours, and differentiated.
module hb_point_runner
   use hb_cached_parts, only: cached_balances_t
   use hb_error, only: error_t
   use hb_gradient, only: find_gradient
   use hb_impact_gradient, only: find_impact_gradient, has_periodic_impacts
   use hb_kinds, only: wp
   use hb_level, only: level_t
   use hb_model, only: model_t
   use hb_motion_result, only: motion_result_t
   use hb_neighbour, only: neighbour_t
   use hb_point, only: solve_point
   implicit none
   private
   public :: run_model

contains

   !> Solves a model at its present values. An `error` is a failure of this point alone, which its result has as well.
   subroutine run_model(model, value, neighbour, cached, result, level, error)
      type(model_t), intent(inout) :: model                           !! on return with the values that follow its motion
      real(wp), intent(in) :: value                                   !! at the point, by which its neighbours are compared
      type(neighbour_t), intent(in) :: neighbour                      !! used if the options of the model request it
      type(cached_balances_t), intent(inout), target :: cached
      type(motion_result_t), intent(out) :: result
      type(level_t), intent(out) :: level                             !! of the motion; without unknowns if none is found
      type(error_t), allocatable, intent(out) :: error
      type(level_t) :: below
      real(wp), allocatable :: start(:)

      model%system%contact_parts => cached%contact_parts(model%system%structure)
      if (model%options%chain%is_on) then
         if (model%options%accuracy%is_on) then
            call neighbour%predict_level(value, model, below)
         else
            call neighbour%predict(value, model%discretisation%harmonics, model%options%chain%secant, start)
         end if
      end if
      if (size(model%options%gradient%by) > 0) then
         call solve_with_gradient(model, below, start, cached, result, level, error)
      else
         call solve_point(model, result, error, level, below, start, cached)
      end if
      if (allocated(error)) call result%set_failure(error)
   end subroutine run_model

   !> Solves a point and differentiates its motion. Derivatives of motions with impacts need all degrees of freedom.
   subroutine solve_with_gradient(model, below, start, cached, result, level, error)
      type(model_t), intent(inout) :: model
      type(level_t), intent(in) :: below                              !! the first guess, as that of `solve_point`
      real(wp), allocatable, intent(in) :: start(:)                   !! likewise
      type(cached_balances_t), intent(inout), target :: cached
      type(motion_result_t), intent(out) :: result
      type(level_t), intent(out) :: level
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: dofs(:)
      integer :: i
      logical :: has_impacts

      allocate (dofs, source=model%options%output%dofs)
      has_impacts = has_periodic_impacts(model%system, model%options)
      if (has_impacts) model%options%output%dofs = [(i, i=1, model%system%structure%n_dofs)]
      call solve_point(model, result, error, level, below, start, cached)
      model%options%output%dofs = dofs
      if (has_impacts) then
         call find_impact_gradient(model, result)
         call result%select_dofs(dofs)
      end if
      if (.not. allocated(error)) &
         call find_gradient(model%system, model%options, level, level%unknowns, result)
   end subroutine solve_with_gradient
end module hb_point_runner
