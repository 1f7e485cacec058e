!> A balance and a wider one, of more harmonics on a finer grid, in which its error is estimated and the solution improved.
!>
!> Improvement: Newton's method in the wider set would need its large tangent. In its place stands the exact tangent for the
!> kept harmonics, and for the others the mean tangent of each harmonic by itself. Steps with this
!> approximation alone need not converge; Anderson's acceleration combines all of them so that their residual is least.
!> Source: docs/why/theory.md, section 7; Walker and Ni, SIAM J. Numer. Anal. 49 (2011) 1715-1735.
module hb_two_level
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_balance, only: balance_t
   use hb_basis, only: transfer_coefficients
   use hb_cancellation, only: work_is_over
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_tangent_solver, only: tangent_solver_t
   implicit none
   private
   public :: clear_kept, improve, residual_of

   real(wp), parameter :: smallest_pivot = 1.0e-10_wp                 ! relative; below, a step brings nothing new

   !> Steps of the past in an orthogonal basis, dG = Q R.
   type :: history_t
      integer :: n = 0
      real(wp), allocatable :: move_changes(:, :)                     ! of what a step leads to
      real(wp), allocatable :: basis(:, :), triangle(:, :)            ! of the changes of the step itself, dG
   end type history_t

contains

   !> Improves the motion u in the wider set by some accelerated steps; of all motions on the way the one with the least
   !> approximate step is taken, u itself among them. Costs n_steps + 1 evaluations of the wider balance.
   subroutine improve(narrow, wide, tangent, u, n_steps, improved)
      type(balance_t), intent(inout) :: narrow, wide
      type(tangent_solver_t), intent(inout) :: tangent                !! of the narrow balance at u
      real(wp), intent(in) :: u(:, :)                                 !! [m], (n_coefficients, n_dofs)
      integer, intent(in) :: n_steps                                  !! >= 1
      real(wp), intent(out) :: improved(:, :)                         !! [m], (n_coefficients of the wider set, n_dofs)
      type(history_t) :: history
      real(wp), allocatable :: motion(:, :), start(:, :), step(:, :), step_before(:), motion_before(:)
      real(wp) :: least
      logical :: is_lost
      integer :: i

      allocate (start, motion, step, mold=improved)
      allocate (history%move_changes(size(start), n_steps), history%basis(size(start), n_steps))
      allocate (history%triangle(n_steps, n_steps))
      call transfer_coefficients(narrow%harmonics, wide%harmonics, u, start)
      motion = start
      improved = start
      least = huge(1.0_wp)
      do i = 0, n_steps
         if (work_is_over()) return
         call approximate_step(narrow, wide, tangent, motion, step, is_lost)
         if (is_lost) return
         if (.not. all(ieee_is_finite(step))) return                  ! out of the range of a law
         if (norm2(step) < least) then
            least = norm2(step)
            improved = motion
         end if
         if (i == n_steps .or. least <= 0.0_wp) return
         if (i > 0) call remember(history, flat(step) - step_before, flat(motion) - motion_before)
         step_before = flat(step)
         motion_before = flat(motion)
         motion = motion + step + reshape(acceleration(history, step_before), shape(motion))
      end do
   end subroutine improve

   !> Step from a motion by the approximate tangent, - P**-1 R; the mean tangent is that of the factors of the wide balance.
   !> `is_lost` where products with the tangent lead to no step.
   subroutine approximate_step(narrow, wide, tangent, motion, step, is_lost)
      type(balance_t), intent(inout) :: narrow, wide
      type(tangent_solver_t), intent(inout) :: tangent
      real(wp), intent(in) :: motion(:, :)
      real(wp), intent(out) :: step(:, :)
      logical, intent(out) :: is_lost
      real(wp) :: defect(size(motion, 1), size(motion, 2)), outside(size(motion, 1), size(motion, 2))
      real(wp) :: kept(narrow%n_unknowns), pairs(narrow%harmonics%n_coefficients, narrow%n_dofs)

      step = 0.0_wp
      call residual_of(wide, motion, defect)
      call transfer_coefficients(wide%harmonics, narrow%harmonics, defect, pairs)
      kept = reshape(pairs, [size(pairs)])
      call tangent%solve(narrow, kept, is_lost)
      if (is_lost) return
      call clear_kept(narrow%harmonics, wide%harmonics, defect)
      call wide%solve_mean_tangent(defect, outside)
      call clear_kept(narrow%harmonics, wide%harmonics, outside)
      call transfer_coefficients(narrow%harmonics, wide%harmonics, reshape(kept, shape(pairs)), step)
      step = -step - outside
   end subroutine approximate_step

   !> Adds the changes of the last step to the history, orthogonal to those before; one that brings nothing new is left out.
   subroutine remember(history, step_change, motion_change)
      type(history_t), intent(inout) :: history
      real(wp), intent(in) :: step_change(:), motion_change(:)
      real(wp) :: orthogonal(size(step_change)), column(history%n)
      integer :: i

      orthogonal = step_change
      do i = 1, history%n
         column(i) = dot_product(history%basis(:, i), orthogonal)
         orthogonal = orthogonal - column(i)*history%basis(:, i)
      end do
      if (norm2(orthogonal) <= smallest_pivot*norm2(step_change)) return
      history%n = history%n + 1
      associate (n => history%n)
         history%move_changes(:, n) = motion_change + step_change
         history%triangle(1:n - 1, n) = column
         history%triangle(n, n) = norm2(orthogonal)
         history%basis(:, n) = orthogonal/norm2(orthogonal)
      end associate
   end subroutine remember

   !> What the history adds to a step g: - dM c, with c the least squares of g - dG c.
   function acceleration(history, step) result(added)
      type(history_t), intent(in) :: history
      real(wp), intent(in) :: step(:)
      real(wp) :: added(size(step)), c(history%n)
      integer :: i

      do i = history%n, 1, -1
         c(i) = (dot_product(history%basis(:, i), step) - dot_product(history%triangle(i, i + 1:history%n), c(i + 1:))) &
                /history%triangle(i, i)
      end do
      added = -matmul(history%move_changes(:, 1:history%n), c)
   end function acceleration

   pure function flat(coefficients)
      real(wp), intent(in) :: coefficients(:, :)
      real(wp) :: flat(size(coefficients))

      flat = reshape(coefficients, [size(coefficients)])
   end function flat

   !> Residual of coefficients by degree of freedom.
   subroutine residual_of(problem, u, r)
      type(balance_t), intent(inout) :: problem
      real(wp), intent(in) :: u(:, :)
      real(wp), intent(out) :: r(:, :)
      real(wp) :: flat(size(u))

      call problem%residual(reshape(u, [size(u)]), flat)
      r = reshape(flat, shape(r))
   end subroutine residual_of

   !> Sets wide coefficients of the kept tuples to zero.
   subroutine clear_kept(kept, set, coefficients)
      type(harmonics_t), intent(in) :: kept, set
      real(wp), intent(inout) :: coefficients(:, :)

      coefficients([set%places_of(kept, 1)], :) = 0.0_wp
   end subroutine clear_kept

end module hb_two_level
