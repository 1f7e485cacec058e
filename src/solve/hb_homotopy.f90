!> Homotopy: follows the solutions from an easy problem to the one asked for by their arc length, round folds if need be.
!>
!> The nonlinearity (or the load) is multiplied by a(theta), from 0 at theta = 0 to 1 at theta = 1, growing exponentially
!> in between, because what counts for a contact stiffness is its ratio to the stiffness of the structure. The curve of
!> solutions (x, theta) is followed by tangent predictor and Newton corrector in the plane across the tangent; its
!> orientation is that of the determinant of the bordered tangent, which also holds at the kinks of contact laws.
!> Source: docs/user/theory.md, section 6.4; Allgower and Georg, Introduction to Numerical Continuation Methods, SIAM 2003,
!> chapters 2, 3, 6 and (orientation of piecewise linear curves) 12.
module hb_homotopy
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_ending, only: end_if_over
   use hb_kinds, only: wp
   use hb_lapack, only: dgetrf, dgetrs
   use hb_newton, only: solve_newton
   use hb_outcome, only: outcome
   use hb_problem, only: problem_t
   use hb_solver_types, only: report_t, solver_config_t
   implicit none
   private
   public :: solve_by_homotopy

   real(wp), parameter :: growth = 14.0_wp                            ! a grows by exp(growth), about six decades
   real(wp), parameter :: farthest = 2.0_wp                           ! theta beyond which a grows no more: a correction astray
   real(wp), parameter :: first_step = 0.05_wp                        ! arc length
   real(wp), parameter :: longest_step = 0.5_wp
   real(wp), parameter :: shortest_step = 1.0e-7_wp
   real(wp), parameter :: loose_tolerance = 1.0e-6_wp                 ! of the residual on the way
   integer, parameter :: most_corrections = 12
   integer, parameter :: easy_corrections = 4                         ! the next step may be longer

   !> The curve in scaled unknowns y = (x/x_scale, theta).
   type :: curve_t
      integer :: kind = 0                                             ! of hb_problem%deformation
      integer :: n = 0                                                ! unknowns and theta
      real(wp), allocatable :: y(:), tangent(:), residual(:)          ! (n), (n), (n - 1)
      real(wp), allocatable :: matrix(:, :)                           ! bordered tangent, (n, n)
      integer, allocatable :: pivots(:)
      real(wp) :: orientation = 0.0_wp                                ! sign of the determinant on this curve
      real(wp) :: norm = 0.0_wp
   end type curve_t

contains

   !> Solves r(x) = 0 along a curve that starts at x, the solution of the easy problem. On failure x is the last point
   !> reached. Iterations are corrections, evaluations those of the residual.
   subroutine solve_by_homotopy(problem, config, kind, x, report)
      class(problem_t), intent(inout) :: problem
      type(solver_config_t), intent(in) :: config
      integer, intent(in) :: kind                                     !! one of hb_problem%deformation
      real(wp), intent(inout), contiguous :: x(:)                     !! (n_unknowns)
      type(report_t), intent(out) :: report
      type(curve_t) :: curve
      real(wp), allocatable :: y_before(:), tangent_before(:)
      real(wp) :: step
      integer :: corrections, n_steps
      logical :: is_on_curve

      if (problem%tangent_work >= config%work_limit) then
         report%status = outcome%out_of_budget
         report%is_out_of_work = .true.
         return
      end if
      curve%kind = kind
      curve%n = problem%n_unknowns + 1
      allocate (curve%y(curve%n), curve%tangent(curve%n), curve%residual(curve%n - 1))
      allocate (curve%matrix(curve%n, curve%n), curve%pivots(curve%n))
      curve%y = [x/problem%x_scale, 0.0_wp]
      curve%tangent = 0.0_wp
      curve%tangent(curve%n) = 1.0_wp
      call turn_tangent(curve, problem, report)
      step = first_step
      n_steps = 0                                                     ! many may need no correction
      do while (report%status == outcome%pending)
         y_before = curve%y
         tangent_before = curve%tangent
         curve%y = y_before + step*tangent_before
         call correct(curve, problem, report, corrections, is_on_curve)
         if (is_on_curve) then
            n_steps = n_steps + 1
            if (curve%y(curve%n) >= 1.0_wp) then
               call finish(curve, problem, config, y_before, x, report)
               if (report%status == outcome%converged) exit
               is_on_curve = .false.                                  ! too long a step to land well
            else if (curve%y(curve%n) < 0.0_wp) then
               report%status = outcome%stalled                        ! back at the easy problem
            else
               call turn_tangent(curve, problem, report)
               if (corrections <= easy_corrections) step = min(longest_step, 1.5_wp*step)
            end if
         end if
         if (.not. is_on_curve) then
            curve%y = y_before
            curve%tangent = tangent_before
            step = 0.3_wp*step
            if (step < shortest_step) report%status = outcome%stalled
         end if
         report%work = problem%work_of(report)
         if (report%status /= outcome%pending) exit
         report%is_out_of_work = report%work >= config%work_limit
         if (max(report%iterations, n_steps) >= config%homotopy_iterations .or. report%is_out_of_work) then
            report%status = outcome%out_of_budget
         else
            call end_if_over(problem, report)
         end if
      end do
      call problem%deform(kind, 1.0_wp)
      report%work = problem%work_of(report)
      if (report%status /= outcome%converged) then
         x = curve%y(1:curve%n - 1)*problem%x_scale
         call problem%residual(x, curve%residual)
         report%residual = problem%norm(curve%residual)
      end if
   end subroutine solve_by_homotopy

   !> Newton's method on r = 0 and tangent.(y - y_start) = 0.
   subroutine correct(curve, problem, report, corrections, is_on_curve)
      type(curve_t), intent(inout) :: curve
      class(problem_t), intent(inout) :: problem
      type(report_t), intent(inout) :: report
      integer, intent(out) :: corrections
      logical, intent(out) :: is_on_curve
      real(wp) :: change(curve%n), norm_before
      integer :: info
      logical :: is_singular

      is_on_curve = .false.
      call evaluate(curve, problem, report)
      do corrections = 0, most_corrections
         if (.not. ieee_is_finite(curve%norm)) return
         is_on_curve = curve%norm <= loose_tolerance
         if (is_on_curve .or. corrections == most_corrections) return
         if (corrections > 4 .and. curve%norm > norm_before) return
         if (problem%is_over()) return
         call border(curve, problem, report)
         call factorise(curve, is_singular)
         if (is_singular) return
         change(1:curve%n - 1) = -curve%residual
         change(curve%n) = 0.0_wp
         call dgetrs("N", curve%n, 1, curve%matrix, curve%n, curve%pivots, change, curve%n, info)
         norm_before = curve%norm
         curve%y = curve%y + change
         call evaluate(curve, problem, report)
         report%iterations = report%iterations + 1
      end do
   end subroutine correct

   !> Tangent at y: the unit vector along the curve, turned the way that keeps the sign of the determinant.
   subroutine turn_tangent(curve, problem, report)
      type(curve_t), intent(inout) :: curve
      class(problem_t), intent(inout) :: problem
      type(report_t), intent(inout) :: report
      real(wp) :: sign_now
      integer :: i, info
      logical :: is_singular

      call evaluate(curve, problem, report)
      call border(curve, problem, report)
      call factorise(curve, is_singular)
      if (is_singular) then
         report%status = outcome%singular
         return
      end if
      sign_now = 1.0_wp
      do i = 1, curve%n
         if (curve%matrix(i, i) < 0.0_wp) sign_now = -sign_now
         if (curve%pivots(i) /= i) sign_now = -sign_now
      end do
      curve%tangent = 0.0_wp
      curve%tangent(curve%n) = 1.0_wp
      call dgetrs("N", curve%n, 1, curve%matrix, curve%n, curve%pivots, curve%tangent, curve%n, info)
      curve%tangent = curve%tangent/norm2(curve%tangent)
      if (curve%orientation == 0.0_wp) curve%orientation = sign_now
      curve%tangent = curve%tangent*sign_now*curve%orientation
   end subroutine turn_tangent

   !> LU of the bordered tangent; `is_singular` when it has no inverse or is not finite.
   subroutine factorise(curve, is_singular)
      type(curve_t), intent(inout) :: curve
      logical, intent(out) :: is_singular
      integer :: info

      is_singular = .not. all(ieee_is_finite(curve%matrix))
      if (is_singular) return
      call dgetrf(curve%n, curve%n, curve%matrix, curve%n, curve%pivots, info)
      is_singular = info /= 0
   end subroutine factorise

   !> Scaled residual at y.
   subroutine evaluate(curve, problem, report)
      type(curve_t), intent(inout) :: curve
      class(problem_t), intent(inout) :: problem
      type(report_t), intent(inout) :: report

      call problem%deform(curve%kind, amount_at(curve%y(curve%n)))
      call problem%residual(curve%y(1:curve%n - 1)*problem%x_scale, curve%residual)
      curve%norm = problem%norm(curve%residual)
      curve%residual = curve%residual/problem%r_scale
      report%evaluations = report%evaluations + 1
   end subroutine evaluate

   !> Derivatives of the scaled residual by y, above the tangent as the last row. The residual is linear in the amount, so
   !> two values give its derivative.
   subroutine border(curve, problem, report)
      type(curve_t), intent(inout) :: curve
      class(problem_t), intent(inout) :: problem
      type(report_t), intent(inout) :: report
      real(wp), parameter :: apart = 0.5_wp                           ! of two amounts
      real(wp) :: jacobian(curve%n - 1, curve%n - 1), r(curve%n - 1), amount
      integer :: i

      amount = amount_at(curve%y(curve%n))
      associate (m => curve%n - 1)
         call problem%tangent(curve%y(1:m)*problem%x_scale, jacobian)
         do i = 1, m
            curve%matrix(1:m, i) = jacobian(:, i)*(problem%x_scale(i)/problem%r_scale)
         end do
         call problem%deform(curve%kind, amount + apart)
         call problem%residual(curve%y(1:m)*problem%x_scale, r)
         call problem%deform(curve%kind, amount)
         curve%matrix(1:m, curve%n) = (r/problem%r_scale - curve%residual)/apart*slope_at(curve%y(curve%n))
         curve%matrix(curve%n, :) = curve%tangent
      end associate
      report%factorizations = report%factorizations + 1
      report%evaluations = report%evaluations + 1
   end subroutine border

   !> Solves the problem itself from the point of the chord where theta = 1.
   subroutine finish(curve, problem, config, y_before, x, report)
      type(curve_t), intent(in) :: curve
      class(problem_t), intent(inout) :: problem
      type(solver_config_t), intent(in) :: config
      real(wp), intent(in) :: y_before(:)
      real(wp), intent(inout), contiguous :: x(:)
      type(report_t), intent(inout) :: report
      type(report_t) :: last
      real(wp), allocatable :: trial(:)
      real(wp) :: share

      associate (m => curve%n - 1)
         share = (1.0_wp - y_before(curve%n))/(curve%y(curve%n) - y_before(curve%n))
         allocate (trial, source=(y_before(1:m) + share*(curve%y(1:m) - y_before(1:m)))*problem%x_scale)
      end associate
      call problem%deform(curve%kind, 1.0_wp)
      call solve_newton(problem, config, trial, last)
      call report%add(last)
      if (last%status /= outcome%converged) return
      x = trial
      report%residual = last%residual
      report%status = outcome%converged
   end subroutine finish

   !> a(theta) = (exp(c theta) - 1)/(exp(c) - 1)
   pure real(wp) function amount_at(theta)
      real(wp), intent(in) :: theta

      amount_at = (exp(growth*min(theta, farthest)) - 1.0_wp)/(exp(growth) - 1.0_wp)
   end function amount_at

   !> da/dtheta
   pure real(wp) function slope_at(theta)
      real(wp), intent(in) :: theta

      slope_at = growth*exp(growth*min(theta, farthest))/(exp(growth) - 1.0_wp)
   end function slope_at
end module hb_homotopy
