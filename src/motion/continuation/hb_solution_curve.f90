!> A curve whose points are returned one by one, of motions (hb_motion_curve) or of located points (hb_motion_ridge).
module hb_solution_curve
   use hb_curve_request, only: curve_request_t
   use hb_error, only: error_t
   use hb_model, only: model_t
   use hb_motion_result, only: curve_position_t, motion_result_t
   use hb_system, only: system_t
   implicit none
   private
   public :: solution_curve_t

   !> Owns external resources: call `destroy`. A variable of this type needs the attribute `target`.
   type, abstract :: solution_curve_t
      logical :: is_done = .false.                                    !! there is no further point
      integer :: n_reported = 0                                       !! points so far
      integer :: n_points = 0                                         !! at most
   contains
      procedure(begin), deferred :: begin
      procedure(continue_from), deferred :: continue_from
      procedure(next), deferred :: next
      procedure(system_at), deferred :: system_at
      procedure(destroy), deferred :: destroy
      procedure :: lengthen => solution_curve_lengthen
   end type solution_curve_t

   abstract interface
      !> Finds the first point; the curve has ended if there is none.
      subroutine begin(self, model, request, result, error)
         import :: curve_request_t, error_t, model_t, motion_result_t, solution_curve_t
         class(solution_curve_t), intent(inout), target :: self
         type(model_t), intent(inout) :: model                        !! at the start
         type(curve_request_t), intent(in) :: request
         type(motion_result_t), intent(out) :: result
         type(error_t), allocatable, intent(out) :: error
      end subroutine begin

      !> Replaces `begin`: restores the state of a stored curve at its last point, a step or the start of a branch.
      subroutine continue_from(self, model, request, stored, error)
         import :: curve_position_t, curve_request_t, error_t, model_t, solution_curve_t
         class(solution_curve_t), intent(inout), target :: self
         type(model_t), intent(in) :: model                           !! at the start
         type(curve_request_t), intent(in) :: request
         type(curve_position_t), intent(in) :: stored(:)              !! all points up to the one to continue from
         type(error_t), allocatable, intent(out) :: error
      end subroutine continue_from

      !> Returns the next point. Its status shows where the curve ends; `interrupted`: nothing was computed, and the
      !> curve continues here in another run.
      subroutine next(self, result, error)
         import :: error_t, motion_result_t, solution_curve_t
         class(solution_curve_t), intent(inout), target :: self
         type(motion_result_t), intent(out) :: result
         type(error_t), allocatable, intent(out) :: error
      end subroutine next

      !> The system at a point that was reported, to which the curve moves its own.
      function system_at(self, position) result(system)
         import :: curve_position_t, solution_curve_t, system_t
         class(solution_curve_t), intent(inout), target :: self
         type(curve_position_t), intent(in) :: position
         type(system_t), pointer :: system
      end function system_at

      !> Frees external resources; safe to call twice.
      subroutine destroy(self)
         import :: solution_curve_t
         class(solution_curve_t), intent(inout) :: self
      end subroutine destroy
   end interface

contains

   !> Continues a curve that has ended at its number of points: it may have more of them.
   subroutine solution_curve_lengthen(self, n_points)
      class(solution_curve_t), intent(inout) :: self
      integer, intent(in) :: n_points                                 !! of the whole curve

      self%n_points = n_points
      self%is_done = self%n_reported >= n_points
   end subroutine solution_curve_lengthen
end module hb_solution_curve
