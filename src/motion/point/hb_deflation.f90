!> Motions besides known ones: whether a motion is another one, and Newton's method with deflation of the known ones.
!> The residual is multiplied by the product of s**2/|x - x_i|**2 + 1 over the known motions x_i, with the size s of
!> the largest: its other zeros are those of the residual, and Newton's method is repelled from the known ones. Its
!> step is the usual one multiplied by a factor, which may be negative. Source: P. E. Farrell, A. Birkisson and S. W.
!> Funke, SIAM J. Sci. Comput. 37 (2015) A2026-A2045.
module hb_deflation
   use hb_assert, only: assert, asserts_are_on
   use hb_harmonics, only: harmonics_t
   use hb_iteration_end, only: end_at_point
   use hb_kinds, only: wp
   use hb_outcome, only: outcome
   use hb_problem, only: problem_t
   use hb_solver_types, only: report_t, solver_config_t
   use hb_tangent_solver, only: new_tangent_solver, tangent_solver_t
   use hb_thresholds, only: equality_tolerance, negligible_share
   implicit none
   private
   public :: deflated_share, follow_deflated, is_apart, is_other, scale_of, shifted

contains

   !> Whether x is none of the known motions, which may have an error of a share of themselves.
   pure logical function is_other(x, known, harmonics, x_scale, share)
      real(wp), intent(in) :: x(:)
      real(wp), intent(in) :: known(:, :)                             !! (n_unknowns, any)
      type(harmonics_t), intent(in) :: harmonics
      real(wp), intent(in) :: x_scale(:)                              !! of unknowns of the balance
      real(wp), intent(in) :: share

      if (asserts_are_on) call assert(size(known, 1) == size(x), "is_other", "motions of the same unknowns")
      is_other = is_apart(x, known, scale_of(known, harmonics, [x_scale, spread(1.0_wp, 1, size(x) - size(x_scale))]), &
                          max(negligible_share, share))
   end function is_other

   !> Whether x is none of the known motions.
   pure logical function is_apart(x, known, scale, least)
      real(wp), intent(in) :: x(:)
      real(wp), intent(in) :: known(:, :), scale(:)
      real(wp), intent(in) :: least                                   !! distance, relative to the larger of both
      integer :: i

      is_apart = .true.
      do i = 1, size(known, 2)                                        ! rest and its rounding errors are one motion
         is_apart = norm2((x - known(:, i))/scale) >= max(least*max(norm2(x/scale), norm2(known(:, i)/scale)), equality_tolerance)
         if (.not. is_apart) return
      end do
   end function is_apart

   !> Amplitude of the largest known motion at each degree of freedom, for all its coefficients.
   pure function scale_of(known, harmonics, x_scale) result(scale)
      real(wp), intent(in) :: known(:, :)                             !! (n_unknowns, any)
      type(harmonics_t), intent(in) :: harmonics
      real(wp), intent(in) :: x_scale(:)                              !! typical unknowns
      real(wp) :: scale(size(x_scale))
      integer :: d, i

      scale = x_scale
      associate (n => harmonics%n_coefficients)
         do d = 1, size(scale)/n
            scale((d - 1)*n + 1:d*n) = maxval([(norm2(known((d - 1)*n + 1:d*n, i)), i=1, size(known, 2))])
         end do
         associate (all_of_them => scale(:(size(scale)/n)*n), typical => x_scale(:(size(scale)/n)*n))
            all_of_them = max(all_of_them, negligible_share*maxval(all_of_them), equality_tolerance*typical)
         end associate
      end associate
   end function scale_of

   !> The motion with shifted phases, x(tau + phases).
   pure function shifted(x, harmonics, phases) result(y)
      real(wp), intent(in) :: x(:)                                    !! (n_coefficients*n_dofs)
      type(harmonics_t), intent(in) :: harmonics
      real(wp), intent(in) :: phases(:)                               !! [rad], (n_tones)
      real(wp) :: y(size(x))

      if (asserts_are_on) call assert(size(phases) == harmonics%n_tones .and. modulo(size(x), harmonics%n_coefficients) == 0, &
                                      "shifted", "a phase for each tone, coefficients of the set")
      associate (n => harmonics%n_coefficients, angles => matmul(phases, real(harmonics%tuples, wp)))
         y = reshape(harmonics%times(exp(cmplx(0.0_wp, angles, wp)), reshape(x, [n, size(x)/n])), [size(x)])
      end associate
   end function shifted

   !> Newton's method from x with deflation of the known zeros.
   subroutine follow_deflated(problem, config, known, scale, x, is_found)
      class(problem_t), intent(inout) :: problem
      type(solver_config_t), intent(in) :: config
      real(wp), intent(in) :: known(:, :)                             !! (n_unknowns, any)
      real(wp), intent(in) :: scale(:)                                !! amplitudes of known motions, (n_unknowns)
      real(wp), intent(inout), contiguous :: x(:)
      logical, intent(out) :: is_found
      type(report_t) :: report
      type(tangent_solver_t) :: solver
      real(wp) :: length, r(size(x)), size_of_known
      integer :: i
      logical :: is_singular

      if (asserts_are_on) call assert(size(x) == problem%n_unknowns .and. all([size(known, 1), size(scale)] == size(x)), &
                                      "follow_deflated", "motions of the unknowns")
      is_found = .false.
      size_of_known = maxval([(norm2(known(:, i)/scale), i=1, size(known, 2))])
      do
         call problem%residual(x, r)
         report%residual = problem%norm(r)
         report%evaluations = report%evaluations + 1
         call end_at_point(problem, config, report)
         if (report%status /= outcome%pending) exit
         call new_tangent_solver(solver, problem, x, is_singular)
         if (is_singular) return
         call solver%solve(problem, r, is_singular)
         if (is_singular) return
         r = -deflated_share(-r/scale, x/scale, known/spread(scale, 2, size(known, 2)), size_of_known)*r
         length = norm2(r/scale)/size_of_known
         x = x + min(1.0_wp, 1.0_wp/max(length, tiny(1.0_wp)))*r        ! no farther than the size of the known motions
         report%iterations = report%iterations + 1
      end do
      is_found = report%status == outcome%converged .and. is_apart(x, known, scale, negligible_share)
   end subroutine follow_deflated

   !> The step of the deflated problem, relative to that of the problem itself.
   pure real(wp) function deflated_share(step, x, known, size_of_motion) result(share)
      real(wp), intent(in) :: step(:), x(:)
      real(wp), intent(in) :: known(:, :)                             !! (n_unknowns, any)
      real(wp), intent(in) :: size_of_motion
      real(wp) :: growth, square
      integer :: i

      growth = 0.0_wp                                                 ! of the logarithm of the product along the step
      do i = 1, size(known, 2)
         square = max(sum((x - known(:, i))**2)/size_of_motion**2, tiny(1.0_wp))
         growth = growth - 2.0_wp*dot_product(x - known(:, i), step)/size_of_motion**2/(square*(1.0_wp + square))
      end do
      share = 1.0_wp - growth
      share = 1.0_wp/sign(max(abs(share), equality_tolerance), share)
   end function deflated_share
end module hb_deflation
