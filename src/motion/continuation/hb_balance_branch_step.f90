!> Steps of a curve of balances, motions on none of its branches, and derivatives of its points.
submodule (hb_balance_branch) hb_balance_branch_step
   use hb_cancellation, only: work_is_over
   use hb_curve_gradient, only: find_curve_gradient
   use hb_curve_sets, only: step_to_tolerance
   use hb_curve_step, only: step
   use hb_doubtful_extremes, only: remove_doubtful_extremes
   use hb_isolated_branches, only: search_separate
   implicit none

contains

   !> Performs one step, to the tolerance if one is requested, and returns its points.
   module procedure balance_branch_make_step
      if (self%model%options%accuracy%is_on) then
         call step_to_tolerance(self, curve, at_point, branches, accuracy, points, error)
      else
         call step(self, curve, at_point, branches, points)
      end if
      if (allocated(error) .or. curve%status /= outcome%pending .or. work_is_over()) return
      call remove_doubtful_extremes(self, curve, branches, course%reported, points, error)
   end procedure balance_branch_make_step

   !> Searches for a motion on none of the branches so far.
   module procedure balance_branch_find_separate
      is_found = .false.
      if (allocated(self%request%others)) call search_separate(self, branches, x, is_found, error)
   end procedure balance_branch_find_separate

   !> Adds the requested derivatives to the result of a point.
   module procedure balance_branch_find_gradient
      if (size(self%model%options%gradient%by) > 0) call find_curve_gradient(self, curve%direction, point, result)
   end procedure balance_branch_find_gradient
end submodule hb_balance_branch_step
