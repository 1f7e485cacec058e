!> The branch on which a motion lies if all loads are multiplied by a factor: followed by arc length, it passes the given loads
!> again and again where it folds, each time in another motion. Motions with small basins of Newton's method are often found so:
!> they are the partners, beyond a fold, of motions that are found easily.
module hb_load_branch
   use hb_bordered, only: bordered_problem_t, new_bordered_problem
   use hb_cancellation, only: work_is_over
   use hb_curve, only: curve_config_t, curve_t, new_curve
   use hb_deflation, only: is_apart
   use hb_kinds, only: wp
   use hb_newton, only: solve_newton
   use hb_outcome, only: outcome
   use hb_problem, only: deformation, problem_t
   use hb_solver_types, only: report_t, solver_config_t
   use hb_thresholds, only: negligible_share
   implicit none
   private
   public :: follow_loads

   ! of the position along the deformation, hb_problem: loads from a thousandth to the sixteenfold
   real(wp), parameter :: min_load_factor = 0.5_wp, max_load_factor = 1.2_wp
   real(wp), parameter :: unit_of_position = 0.2_wp                   ! lengths are measured in it and in known motions
   real(wp), parameter :: curve_tolerance = 1.0e-4_wp                 ! of the residual along the branch
   integer, parameter :: max_corrections = 8
   integer, parameter :: max_steps = 300                              ! in one direction
   type(curve_config_t), parameter :: steps = &
      curve_config_t(first_step=0.02_wp, longest_step=0.3_wp, shortest_step=1.0e-5_wp, little=2.0_wp, angle=0.25_wp)

contains

   !> Follows the branch of a motion, in one direction of the loads, and returns the motions under the given loads that it passes.
   subroutine follow_loads(problem, config, x, scale, is_upwards, found)
      class(problem_t), intent(inout), target :: problem
      type(solver_config_t), intent(in) :: config
      real(wp), intent(in), contiguous :: x(:)                        !! the motion, (n_unknowns)
      real(wp), intent(in) :: scale(:)                                !! amplitudes of known motions, (n_unknowns)
      logical, intent(in) :: is_upwards                               !! loads grow first
      real(wp), allocatable, intent(out) :: found(:, :)               !! (n_unknowns, any); x last: it is closed
      type(bordered_problem_t) :: path
      type(curve_t) :: curve
      type(solver_config_t) :: corrector
      real(wp), allocatable :: forward(:, :), there(:)
      integer :: i, n
      logical :: is_possible, is_solution

      n = size(x)
      allocate (found(n, 0))
      corrector = config
      corrector%tolerance = curve_tolerance
      corrector%max_iterations = max_corrections
      corrector%line_search = .false.
      corrector%repeats_tangent = .false.
      allocate (forward(n + 1, 1), source=0.0_wp)
      forward(n + 1, 1) = 1.0_wp
      call problem%set_parameters([-deformation%load], [1.0_wp], is_possible)
      call new_bordered_problem(path, problem, [-deformation%load], forward, [1.0_wp])
      call new_curve(curve, path, [x, 1.0_wp], merge(1.0_wp, -1.0_wp, is_upwards)*forward(:, 1), [scale, unit_of_position], steps, &
                     corrector)
      do i = 1, max_steps
         if (curve%status /= outcome%pending .or. work_is_over()) exit
         call curve%advance()
         if (curve%status /= outcome%pending) exit
         if ((curve%x(n + 1) - 1.0_wp)*(curve%last%x(n + 1) - 1.0_wp) < 0.0_wp) then
            call solve_at_loads(problem, config, curve, there, is_solution)
            if (is_solution) found = reshape([found, there], [n, size(found, 2) + 1])
            if (is_solution) is_solution = .not. is_apart(there, reshape(x, [n, 1]), scale, negligible_share)
            if (is_solution) exit                                     ! the branch is closed
         end if
         if (curve%x(n + 1) < min_load_factor .or. curve%x(n + 1) > max_load_factor) exit
         call curve%turn()
      end do
      call problem%set_parameters([-deformation%load], [1.0_wp], is_possible)
   end subroutine follow_loads

   !> The motion under the given loads, from the chord of the last step, which has passed them.
   subroutine solve_at_loads(problem, config, curve, x, is_solution)
      class(problem_t), intent(inout) :: problem
      type(solver_config_t), intent(in) :: config
      type(curve_t), intent(in) :: curve
      real(wp), allocatable, intent(out) :: x(:)
      logical, intent(out) :: is_solution
      type(report_t) :: report
      integer :: n
      logical :: is_possible

      n = size(curve%x) - 1
      associate (position => curve%x(n + 1), before => curve%last%x(n + 1))
         allocate (x, source=curve%last%x(:n) + (1.0_wp - before)/(position - before)*(curve%x(:n) - curve%last%x(:n)))
      end associate
      call problem%set_parameters([-deformation%load], [1.0_wp], is_possible)
      call solve_newton(problem, config, x, report)
      is_solution = report%status == outcome%converged
   end subroutine solve_at_loads
end module hb_load_branch
