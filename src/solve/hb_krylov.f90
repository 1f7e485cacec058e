!> Newton's method without a matrix: steps by GMRES from products with the exact tangent, as accurate as they pay.
!>
!> Source: docs/theory.md, section 6.5; Dembo, Eisenstat, Steihaug, SIAM J. Numer. Anal. 19 (1982) 400-408; Eisenstat and
!> Walker, SIAM J. Sci. Comput. 17 (1996) 16-32 (accuracy of the steps, second choice).
module hb_krylov
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_gmres, only: gmres_t, new_gmres
   use hb_kinds, only: wp
   use hb_line_search, only: line_search_t, new_line_search
   use hb_outcome, only: outcome
   use hb_problem, only: problem_t
   use hb_solver_types, only: report_t, solver_config_t
   implicit none
   private
   public :: solve_krylov

   real(wp), parameter :: first_accuracy = 1.0e-2_wp                  ! of a step, residual of GMRES
   real(wp), parameter :: lowest_accuracy = 1.0e-1_wp
   real(wp), parameter :: useless = 0.9_wp                            ! a step that leaves more of the residual is none

   integer, parameter :: patience = 60                                ! products until the preconditioner gets stronger
   integer, parameter :: easy = 20                                    ! products up to which it need not be made anew

   !> What is known of the preconditioner.
   type :: preconditioner_t
      integer :: level = 0
      logical :: is_fresh = .false.                                   ! made for this very tangent
      logical :: is_tired = .true.                                    ! the last step took many products
      logical :: is_strongest = .false.
   end type preconditioner_t

contains

   !> Solves r(x) = 0 from the given x; x is the last point reached, whatever the outcome. Ends as `singular` where GMRES
   !> finds no step, or the problem has no products.
   subroutine solve_krylov(problem, config, x, report)
      class(problem_t), intent(inout) :: problem
      type(solver_config_t), intent(in) :: config
      real(wp), intent(inout), contiguous :: x(:)                     !! (n_unknowns)
      type(report_t), intent(out) :: report
      type(gmres_t) :: gmres
      type(line_search_t) :: search
      type(preconditioner_t) :: preconditioner
      real(wp), allocatable :: r(:), step(:)
      real(wp) :: accuracy, fraction, norm_before
      logical :: has_products

      allocate (r(problem%n_unknowns), step(problem%n_unknowns))
      call new_line_search(search, problem%n_unknowns, config%line_search)
      call problem%residual(x, r)
      report%residual = problem%norm(r)
      call search%remember(report%residual)
      accuracy = first_accuracy
      do
         report%evaluations = 1 + search%n_residuals
         if (.not. ieee_is_finite(report%residual)) then
            report%status = outcome%not_finite
         else if (report%residual <= config%tolerance) then
            report%status = outcome%converged
         else if (report%iterations >= config%max_iterations) then
            report%status = outcome%out_of_budget
         end if
         if (report%status /= outcome%pending) return

         if (report%iterations == 0) call new_gmres(gmres, problem%n_unknowns, config%krylov_vectors)
         call problem%linearise(x, has_products)
         if (has_products) call find_step(problem, gmres, config, preconditioner, &
            max(accuracy, 0.5_wp*config%tolerance/report%residual), r, step, report)
         if (.not. has_products .or. .not. gmres%residual < useless) then
            report%status = outcome%singular
            if (has_products .and. report%residual <= problem%rounding_level(x)) report%status = outcome%converged
            return
         end if
         norm_before = report%residual
         call search%advance(problem, step, x, r, report%residual, fraction)
         report%iterations = report%iterations + 1
         if (fraction <= 0.0_wp) then
            report%evaluations = 1 + search%n_residuals
            report%status = outcome%stalled
            if (search%met_only_nan) report%status = outcome%not_finite
            if (report%residual <= problem%rounding_level(x)) report%status = outcome%converged
            return
         end if
         accuracy = next_accuracy(accuracy, report%residual/norm_before)
      end do
   end subroutine solve_krylov

   !> Solves J step = -r by GMRES. The preconditioner is made anew where it served long enough, and stronger where GMRES does
   !> not come to an end with it.
   subroutine find_step(problem, gmres, config, preconditioner, accuracy, r, step, report)
      class(problem_t), intent(inout) :: problem
      type(gmres_t), intent(inout) :: gmres
      type(solver_config_t), intent(in) :: config
      type(preconditioner_t), intent(inout) :: preconditioner
      real(wp), intent(in) :: accuracy
      real(wp), intent(in) :: r(:)
      real(wp), intent(out), contiguous :: step(:)
      type(report_t), intent(inout) :: report
      integer :: products

      if (preconditioner%level == 0 .or. preconditioner%is_tired) call renew()
      step = 0.0_wp
      products = 0
      do
         call gmres%solve(problem, -r, accuracy, merge(config%krylov_products - products, patience, &
                                                       preconditioner%is_strongest), step)
         products = products + gmres%n_products
         if (gmres%residual <= accuracy .or. products >= config%krylov_products) exit
         if (preconditioner%is_strongest .and. preconditioner%is_fresh) exit
         if (preconditioner%is_fresh) preconditioner%level = preconditioner%level + 1
         call renew()
      end do
      report%products = report%products + products
      preconditioner%is_tired = products > easy
      preconditioner%is_fresh = .false.

   contains

      subroutine renew()
         call problem%update_preconditioner(preconditioner%level, preconditioner%is_strongest)
         report%factorizations = report%factorizations + 1
         preconditioner%is_fresh = .true.
      end subroutine renew
   end subroutine find_step

   !> Accuracy of the next step from how the residual fell: no more than quadratic convergence can use, and no jump to less
   !> than the last one asked for.
   pure real(wp) function next_accuracy(accuracy, ratio)
      real(wp), intent(in) :: accuracy, ratio
      real(wp), parameter :: gamma = 0.9_wp, memory = 0.1_wp          ! of Eisenstat and Walker

      next_accuracy = gamma*ratio**2
      if (gamma*accuracy**2 > memory) next_accuracy = max(next_accuracy, gamma*accuracy**2)
      next_accuracy = min(lowest_accuracy, next_accuracy)
   end function next_accuracy
end module hb_krylov
