!> Adaptive refinement: a problem is solved at one discretisation, its error is estimated, and the next discretisation
!> is chosen from the estimate, until the error is below the tolerance or refinement brings no further gain.
!>
!> The refined object extends `refinable_t`: it solves, chooses and transfers; the loop counts levels, failures and
!> levels without gain. Users: points and normal modes (hb_refined_motion), steps and motions of a curve
!> (hb_curve_sets), motions found by time integration (hb_integrate_to_tolerance). Source: nested iteration,
!> Hackbusch, Multi-Grid Methods and Applications (1985), chapter 5.
module hb_refinement
   use hb_error, only: error_t
   use hb_kinds, only: wp
   implicit none
   private
   public :: refinable_t, refine, refinement_end

   real(wp), parameter :: max_estimate_ratio = 0.8_wp                 ! of the previous estimate: larger ones count as no gain

   type :: ends_t
      integer :: pending = 0
      integer :: accurate = 1                                         !! the estimate is small enough
      integer :: idle = 2                                             !! levels bring no further gain
      integer :: failed = 3                                           !! levels are no longer solved
      integer :: exhausted = 4                                        !! no further level, or the permitted number is reached
      integer :: stopped = 5                                          !! the problem was cancelled, or there was an error
   end type ends_t

   type(ends_t), parameter :: refinement_end = ends_t()

   !> A problem at its present discretisation, a level.
   type, abstract :: refinable_t
      integer :: max_levels = 25                                     !! tried; sets grow by a tenth at least
      integer :: max_idle = huge(1)                                  !! consecutive levels without gain
      integer :: max_failures = 1                                    !! consecutive levels that are not solved
      integer :: n_levels = 0                                         !! tried so far
      integer :: n_failures = 0                                       !! since the last solved level
      real(wp) :: estimate = huge(1.0_wp)                             !! of the error of the last solved level
      type(error_t), allocatable :: error
   contains
      procedure(solve_level), deferred :: solve
      procedure(choose_level), deferred :: choose
      procedure(ask), deferred :: is_accurate
      procedure(ask), deferred :: is_over
   end type refinable_t

   abstract interface
      !> Solves the problem at the chosen level, from the present solution, and sets `estimate`. On failure the
      !> present solution is unchanged.
      subroutine solve_level(self, is_solved)
         import :: refinable_t
         class(refinable_t), intent(inout) :: self
         logical, intent(out) :: is_solved
      end subroutine solve_level

      !> Chooses the next level; there may be none.
      subroutine choose_level(self, is_there)
         import :: refinable_t
         class(refinable_t), intent(inout) :: self
         logical, intent(out) :: is_there
      end subroutine choose_level

      !> `is_accurate`: whether the last solved level is accurate enough. `is_over`: whether the budget is used up or
      !> the work is cancelled.
      logical function ask(self)
         import :: refinable_t
         class(refinable_t), intent(inout) :: self
      end function ask
   end interface

contains

   !> Refines a problem from its first level on, and returns why the refinement ended. An error of the problem is
   !> stored in the problem.
   subroutine refine(self, end_of_it)
      class(refinable_t), intent(inout) :: self
      integer, intent(out), optional :: end_of_it                     !! one of `refinement_end`
      integer :: ending, n_idle
      real(wp) :: before
      logical :: is_solved, is_there

      self%n_levels = 0
      self%n_failures = 0
      n_idle = 0
      ending = refinement_end%pending
      self%estimate = huge(1.0_wp)
      do while (ending == refinement_end%pending)
         before = self%estimate
         call self%solve(is_solved)
         self%n_levels = self%n_levels + 1
         self%n_failures = merge(0, self%n_failures + 1, is_solved)
         if (is_solved) then
            n_idle = merge(n_idle + 1, 0, self%estimate > max_estimate_ratio*before)
            if (self%is_accurate()) ending = refinement_end%accurate
         end if
         if (ending /= refinement_end%pending) exit
         if (self%is_over() .or. allocated(self%error)) then
            ending = refinement_end%stopped
         else if (self%n_failures >= self%max_failures) then
            ending = refinement_end%failed
         else if (n_idle >= self%max_idle) then
            ending = refinement_end%idle
         else if (self%n_levels >= self%max_levels) then
            ending = refinement_end%exhausted
         else
            call self%choose(is_there)
            if (.not. is_there) ending = refinement_end%exhausted
            if (allocated(self%error)) ending = refinement_end%stopped
         end if
      end do
      if (present(end_of_it)) end_of_it = ending
   end subroutine refine
end module hb_refinement
