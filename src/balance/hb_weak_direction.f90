!> The motion of a wider set near a motion whose tangent is almost singular, as at the tip of a resonance curve, where a residual
!> moves it far along one direction and linear steps do not show how far. The balance R(u) of the wider set is bordered by the
!> singular vectors w, v of the smallest singular value of the motion's own tangent,
!>
!>     R(u) + mu w = 0,   v.(u - u0) = xi,
!>
!> which is regular: mu(xi) is the amount by which the balance is missed at a distance xi along v. Its zero next to xi = 0 is the
!> motion of the wider set; without a zero there is none nearby. Source: Lyapunov-Schmidt reduction; docs/why/theory.md, section 7.
module hb_weak_direction
   use hb_kinds, only: wp
   use hb_problem, only: problem_t
   use hb_tangent_solver, only: tangent_solver_t
   use hb_wide_problem, only: wide_problem_t
   implicit none
   private
   public :: weak_direction_t

   real(wp), parameter :: step_accuracy = 1.0e-3_wp                   ! of corrections, relative to the distance
   real(wp), parameter :: distance_accuracy = 0.1_wp                  ! relative
   real(wp), parameter :: accuracy_of_steps = 1.0e-9_wp               ! what weakly coupled harmonics do to mu counts
   integer, parameter :: max_corrections = 6, max_distances = 8       ! of one position, of the zero
   integer, parameter :: max_products = 100                           ! for one correction

   type, extends(wide_problem_t) :: weak_direction_t
      real(wp), allocatable, private :: response(:)                   ! to w in blocks (n_unknowns of the wider balance)
   contains
      procedure :: border_by => weak_direction_border_by
      procedure :: find_motion => weak_direction_find_motion
      procedure :: step_in_blocks => weak_direction_step_in_blocks
   end type weak_direction_t

contains

   !> Borders a wide problem by the weakest direction of the motion's tangent; `is_possible` is false if it is not found.
   subroutine weak_direction_border_by(self, whole, problem, tangent, is_possible)
      class(weak_direction_t), intent(inout) :: self
      type(wide_problem_t), intent(in) :: whole                       !! without parameters
      class(problem_t), intent(inout), target :: problem              !! that the motion solves
      type(tangent_solver_t), intent(inout), target :: tangent        !! its tangent
      logical, intent(out) :: is_possible
      integer, parameter :: n_rounds = 2
      real(wp) :: v(problem%n_unknowns), w(problem%n_unknowns)
      integer :: i, n
      logical :: is_singular

      n = whole%n_unknowns
      self%wide_problem_t = whole
      self%n_unknowns = n + 1
      self%accuracy = accuracy_of_steps
      w = problem%r_scale*cos([(real(i, wp), i=1, size(w))])
      do i = 1, n_rounds
         v = w
         call tangent%solve(problem, v, is_singular)
         w = v/problem%x_scale**2
         call tangent%solve_transposed(problem, w, is_possible)
         is_possible = is_possible .and. .not. is_singular .and. norm2(v) > 0.0_wp
         if (.not. is_possible) return
         w = w*problem%r_scale**2
         w = w/norm2(w/problem%r_scale)
      end do
      v = w
      call tangent%solve(problem, v, is_singular)
      associate (units => whole%r_scale(whole%positions))
         w = w/norm2(v/units)                                         ! mu is then a length along v
         v = v/norm2(v/units)
      end associate
      allocate (self%response(n), source=0.0_wp)
      self%response(self%positions) = v
      deallocate (self%border, self%functionals)
      allocate (self%border(n, 1), self%functionals(n + 1, 1), source=0.0_wp)
      self%border(self%positions, 1) = w
      self%r_scale = [whole%r_scale, 1.0_wp]
      self%functionals(:n, 1) = self%response/whole%r_scale**2
      self%x_scale = self%r_scale
   end subroutine weak_direction_border_by

   !> M**-1 r, bordered.
   subroutine weak_direction_step_in_blocks(self, r, step)
      class(weak_direction_t), intent(inout) :: self
      real(wp), intent(in) :: r(:)                                    !! (n_unknowns)
      real(wp), intent(out) :: step(:)                                !! (n_unknowns)

      associate (n => size(self%response))
         call self%wide_problem_t%step_in_blocks(r(:n), step(:n))
         step(n + 1) = dot_product(self%functionals(:n, 1), step(:n)) - r(n + 1)
         step(:n) = step(:n) - step(n + 1)*self%response
      end associate
   end subroutine weak_direction_step_in_blocks

   !> Finds the motion of the wider set: the step to be subtracted from `motion`. `is_found` is false if there is none nearby, or if
   !> corrections do not converge.
   subroutine weak_direction_find_motion(self, motion, farthest, step, is_found)
      class(weak_direction_t), intent(inout) :: self
      real(wp), intent(in) :: motion(:, :)                            !! [m], (n_coefficients, n_dofs)
      real(wp), intent(in) :: farthest                                !! distance along the direction [m]
      real(wp), intent(out) :: step(:)                                !! (n_coefficients*n_dofs)
      logical, intent(out) :: is_found
      real(wp) :: along(self%n_unknowns), ahead(self%n_unknowns), here(self%n_unknowns)
      real(wp) :: mu, mu_ahead, curvature, slope, x, x_ahead
      integer :: i

      x = 0.0_wp
      here = 0.0_wp
      call correct(x, here, is_found)
      do i = 1, max_distances
         if (.not. is_found) return
         call find_slope(here, along, is_found)
         if (.not. is_found) return
         mu = -here(size(here))
         slope = along(size(along))
         is_found = abs(slope) > 0.0_wp
         if (.not. is_found) return
         x_ahead = x + max(-farthest, min(-mu/slope, farthest))
         ahead = here - (x_ahead - x)*along
         call correct(x_ahead, ahead, is_found)
         if (.not. is_found) return
         mu_ahead = -ahead(size(ahead))
         if (abs(mu_ahead) <= distance_accuracy*abs(slope*x_ahead)) exit
         ! the parabola through both
         curvature = (mu_ahead - mu - slope*(x_ahead - x))/(x_ahead - x)**2
         associate (discriminant => slope**2 - 4.0_wp*curvature*mu)
            is_found = discriminant >= 0.0_wp
            if (.not. is_found) return
            x = x - 2.0_wp*mu/(slope + sign(sqrt(discriminant), slope))
         end associate
         is_found = abs(x) <= farthest
         if (.not. is_found) return
         here = here - (x - dot_product(self%functionals(:, 1), -here))*along
         call correct(x, here, is_found)
         ahead = here
         if (abs(here(size(here))) <= distance_accuracy*abs(slope*x)) exit
      end do
      is_found = i <= max_distances
      step = ahead(:size(step))

   contains

      !> Corrects the motion at a distance x.
      subroutine correct(x, total, is_found)
         real(wp), intent(in) :: x
         real(wp), intent(inout) :: total(:)                          !! subtracted from the motion (n_unknowns)
         logical, intent(out) :: is_found
         real(wp), dimension(size(total)) :: change, r
         integer :: i
         logical :: is_lost

         do i = 1, max_corrections
            call self%find_residual(moved(total), total, r, is_lost)
            is_found = .not. is_lost
            if (is_lost) return
            r(size(r)) = -dot_product(self%functionals(:, 1), total) - x
            call self%step_in_blocks(r, change)
            call self%find_step(moved(total), r, max_products, step_accuracy*self%length_of(total), change, is_found)
            if (.not. is_found) return
            total = total + change
            if (self%length_of(change) <= step_accuracy*self%length_of(total)) return
         end do
         is_found = .false.
      end subroutine correct

      !> The derivative of the motion, and of mu, by the distance.
      subroutine find_slope(total, along, is_found)
         real(wp), intent(in) :: total(:)
         real(wp), intent(out) :: along(:)
         logical, intent(out) :: is_found
         real(wp) :: r(size(total))

         r = 0.0_wp
         r(size(r)) = 1.0_wp
         call self%step_in_blocks(r, along)
         call self%find_step(moved(total), r, max_products, 0.0_wp, along, is_found)
      end subroutine find_slope

      !> The motion after a step.
      pure function moved(total)
         real(wp), intent(in) :: total(:)
         real(wp) :: moved(size(motion, 1), size(motion, 2))

         moved = motion - reshape(total(:size(motion)), shape(motion))
      end function moved
   end subroutine weak_direction_find_motion
end module hb_weak_direction
