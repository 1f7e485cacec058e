!> Backtracking along a step, shared by the solvers: the residual must fall below the largest of the last few.
!>
!> The comparison with a few past residuals permits the iteration to cross kinks of contact laws, where the residual
!> may rise for a step or two. Source: Grippo, Lampariello, Lucidi, SIAM J. Numer. Anal. 23 (1986) 707-716, with the
!> residual as merit function. If the residual is bounded, that comparison alone lets the unknowns diverge; trial
!> points too far away are therefore not evaluated.
module hb_line_search
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_assert, only: assert, asserts_are_on
   use hb_kinds, only: wp
   use hb_outcome, only: outcome
   use hb_problem, only: problem_t
   use hb_solver_types, only: solver_config_t
   implicit none
   private
   public :: line_search_t, new_line_search

   integer, parameter :: compared_residuals = 6                       ! past residuals in the comparison
   integer, parameter :: max_halvings = 12
   real(wp), parameter :: max_unknown_growth = 1.0e8_wp               ! of the unknowns: half of their digits are lost there
   real(wp), parameter :: sufficient_decrease = 1.0e-4_wp             ! fraction of the decrease predicted by a full step

   type :: line_search_t
      logical :: is_on = .true.                                       !! false: always full steps
      integer :: n_residuals = 0                                      !! residuals evaluated so far
      integer :: failure = outcome%pending                            !! why no trial of the last step was accepted, hb_outcome
      real(wp), private :: farthest = 0.0_wp                          ! largest admissible trial, in units of x_scale
      real(wp), private :: past(compared_residuals) = 0.0_wp
      integer, private :: n_past = 0
      real(wp), allocatable, private :: x_trial(:), r_trial(:)        ! latest trial
   contains
      procedure :: remember => line_search_remember
      procedure :: advance => line_search_advance
      procedure :: try_step => line_search_try_step
   end type line_search_t

contains

   !> Creates a line search from a first point, and evaluates the residual there. Without `line_search` of the settings every full
   !> step with a finite residual is accepted.
   subroutine new_line_search(self, config, problem, x, r, norm)
      type(line_search_t), intent(out) :: self
      type(solver_config_t), intent(in) :: config
      class(problem_t), intent(inout) :: problem
      real(wp), intent(in), contiguous :: x(:)                        !! (n_unknowns)
      real(wp), intent(out), contiguous :: r(:)                       !! (n_unknowns)
      real(wp), intent(out) :: norm

      if (asserts_are_on) call assert(size(x) == problem%n_unknowns .and. size(r) == size(x), &
                                      "new_line_search", "as many unknowns as the problem")
      self%is_on = config%line_search
      allocate (self%x_trial(problem%n_unknowns), self%r_trial(problem%n_unknowns))
      call problem%residual(x, r)
      norm = problem%norm(r)
      call self%remember(norm)
   end subroutine new_line_search

   !> Adds the norm of an accepted point to the past residuals.
   pure subroutine line_search_remember(self, norm)
      class(line_search_t), intent(inout) :: self
      real(wp), intent(in) :: norm

      self%past(1 + modulo(self%n_past, compared_residuals)) = norm
      self%n_past = self%n_past + 1
   end subroutine line_search_remember

   !> Moves x along `step`, halving it until the residual is small enough; on success x, r and norm are those of the
   !> new point and `fraction` is the accepted part of the step; otherwise they are unchanged, `fraction` is 0 and
   !> `failure` gives the reason. Distances are measured from the first x.
   subroutine line_search_advance(self, problem, step, x, r, norm, fraction)
      class(line_search_t), intent(inout) :: self
      class(problem_t), intent(inout) :: problem
      real(wp), intent(in) :: step(:)                                 !! (n_unknowns)
      real(wp), intent(inout), contiguous :: x(:), r(:)               !! (n_unknowns)
      real(wp), intent(inout) :: norm
      real(wp), intent(out) :: fraction
      real(wp) :: reference, trial_norm
      integer :: halving
      logical :: met_finite, met_near

      reference = maxval(self%past(1:min(self%n_past, compared_residuals)))
      fraction = 1.0_wp
      if (self%n_residuals == 0) self%farthest = max_unknown_growth*max(1.0_wp, maxval(abs(x/problem%x_scale)))
      met_finite = .false.
      met_near = .false.
      do halving = 0, max_halvings
         self%x_trial = x + fraction*step
         if (.not. any(abs(self%x_trial/problem%x_scale) > self%farthest)) then  ! NaN is not far, but not finite
            met_near = .true.
            call problem%residual(self%x_trial, self%r_trial)
            self%n_residuals = self%n_residuals + 1
            trial_norm = problem%norm(self%r_trial)
            if (ieee_is_finite(trial_norm)) then
               met_finite = .true.
               if (.not. self%is_on .or. trial_norm <= (1.0_wp - sufficient_decrease*fraction)*reference) then
                  x = self%x_trial
                  r = self%r_trial
                  norm = trial_norm
                  call self%remember(norm)
                  return
               end if
            end if
         end if
         fraction = 0.5_wp*fraction
      end do
      fraction = 0.0_wp
      self%failure = outcome%stalled
      if (.not. met_finite) self%failure = outcome%not_finite
      if (.not. met_near) self%failure = outcome%diverged
   end subroutine line_search_advance

   !> Moves x along the full step if that reduces the residual; otherwise x, r and norm are unchanged. Later steps are
   !> not compared with it.
   subroutine line_search_try_step(self, problem, step, x, r, norm)
      class(line_search_t), intent(inout) :: self
      class(problem_t), intent(inout) :: problem
      real(wp), intent(in) :: step(:)                                 !! (n_unknowns)
      real(wp), intent(inout), contiguous :: x(:), r(:)               !! (n_unknowns)
      real(wp), intent(inout) :: norm
      real(wp) :: trial_norm

      self%x_trial = x + step
      call problem%residual(self%x_trial, self%r_trial)
      self%n_residuals = self%n_residuals + 1
      trial_norm = problem%norm(self%r_trial)
      if (.not. trial_norm < norm) return                             ! also if it is NaN
      x = self%x_trial
      r = self%r_trial
      norm = trial_norm
   end subroutine line_search_try_step
end module hb_line_search
