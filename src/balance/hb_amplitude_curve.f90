!> The way of one unknown tone to a limit cycle: the curve of motions with artificial damping, by its arc length.
!>
!> The curve begins at a mode with a small amplitude. Where the artificial damping changes its sign on it, the motion needs
!> none: a limit cycle. One beyond which the motion is damped is preferred, motion near it would come back to it.
!> The curve may turn back in amplitude, as where two flexible bodies touch. Source: docs/user/theory.md, section 6.5.
module hb_amplitude_curve
   use hb_kinds, only: wp
   use hb_newton, only: solve_newton
   use hb_outcome, only: outcome
   use hb_phase, only: new_phase_problem, phase_problem_t, shift_form
   use hb_search, only: first_amplitude, fundamental, last_amplitude, neutral, search_t, way_point_t
   use hb_solver_types, only: report_t
   use hb_tangent_factor, only: new_tangent_factor, tangent_factor_t
   use hb_text, only: to_text
   implicit none
   private
   public :: follow_curve

   real(wp), parameter :: first_step = 0.3_wp                         ! arc length in units of the amplitude reached
   real(wp), parameter :: longest_step = 2.0_wp
   real(wp), parameter :: shortest_step = 1.0e-6_wp
   real(wp), parameter :: kink_step = 1.0e-3_wp                       ! beyond a kink
   integer, parameter :: most_steps = 600
   integer, parameter :: easy_iterations = 4                          ! the next step may be longer
   real(wp), parameter :: largest_damping = 100.0_wp                  ! xi/omega: damped for good
   integer, parameter :: most_bisections = 40                         ! of a step on which the damping changes its sign

contains

   !> Looks for a limit cycle, from the rest until the curve is far from it, well damped, or back there. What is known without
   !> one stands in the search: how far it came, and a message if the curve was lost.
   subroutine follow_curve(self, point, is_found)
      type(search_t), intent(inout) :: self
      type(way_point_t), intent(out) :: point                         !! the motion found, else the last point
      logical, intent(out) :: is_found
      type(way_point_t) :: last, crossing
      type(report_t) :: report
      real(wp), allocatable :: direction(:)
      real(wp) :: damping(1), damping_before(1), step
      integer :: i
      logical :: is_on_curve, is_stable, is_turned

      is_found = .false.
      is_turned = .false.
      call self%begin(self%length*first_amplitude, point, is_on_curve)
      if (.not. is_on_curve) return
      damping = self%damping(point)
      self%is_neutral = abs(damping(1)) <= neutral
      self%reached = point%amplitude(1)
      call point_upwards(self, point, direction)
      step = first_step
      do i = 1, most_steps
         last = point
         call advance(self, last, step, direction, point, report, is_on_curve)
         if (is_on_curve) is_on_curve = .not. leaps(last, point)
         if (is_on_curve) then
            if (sum((point%u - self%rest%u)*(last%u - self%rest%u)) < 0.0_wp) exit   ! through the rest: another mode ends here
         else
            point = last
            step = 0.4_wp*step
            if (step >= shortest_step) cycle
            if (is_turned) exit
            call turn_at_kink(self, point, direction, is_turned)
            if (.not. is_turned) exit
            step = kink_step
            cycle
         end if
         is_turned = .false.
         damping_before = damping
         damping = self%damping(point)
         self%is_neutral = self%is_neutral .and. abs(damping(1)) <= neutral
         self%reached = max(self%reached, point%amplitude(1))
         if (damping(1)*damping_before(1) <= 0.0_wp .and. .not. self%is_neutral) then
            is_stable = damping(1) > damping_before(1)
            if (is_stable .or. .not. allocated(crossing%u)) then
               call land(self, last, step, direction, is_found)
               if (is_found .and. is_stable) then
                  point = last
                  return
               else if (is_found) then
                  crossing = last
                  is_found = .false.
               end if
            end if
         end if
         if (point%amplitude(1) > last_amplitude*self%length .or. damping(1) > largest_damping) exit
         if (point%amplitude(1) < 0.1_wp*first_amplitude*self%length .and. point%amplitude(1) < last%amplitude(1)) exit
         call turn_direction(self, point, direction)
         if (report%iterations <= easy_iterations) step = min(longest_step, 1.5_wp*step)
      end do
      if (allocated(crossing%u)) then
         point = crossing
         call self%try_motion(point, is_found)
         self%is_left = is_found
         if (is_found) self%message = "driven beyond this limit cycle and damped below: motion near it leaves it"
         if (is_found) return
      end if
      if (i <= most_steps .and. step >= shortest_step) then
         if (damping(1) < -neutral .and. point%amplitude(1) > last_amplitude*self%length) &
            self%message = "driven up to an amplitude of "//to_text(point%amplitude(1))//": the motion grows without bound"
         return
      end if
      self%report%status = outcome%stalled
      self%message = "lost on the way to the motion, at amplitude "//to_text(point%amplitude(1))//" and damping xi/omega "// &
                     to_text(point%xi(1)/point%omega(1))
   end subroutine follow_curve

   !> Whether a step changed the frequency so much that the point is hardly on the same piece of the curve.
   pure logical function leaps(from, to)
      type(way_point_t), intent(in) :: from, to
      real(wp), parameter :: largest_ratio = 1.5_wp

      leaps = max(from%omega(1)/to%omega(1), to%omega(1)/from%omega(1)) > largest_ratio .or. &
              to%amplitude(1) <= 0.0_wp
   end function leaps

   !> Point as the vector of unknowns of its problem.
   pure function vector_of(point) result(x)
      type(way_point_t), intent(in) :: point
      real(wp) :: x(size(point%u) + 2)

      x = [reshape(point%u, [size(point%u)]), point%omega(1), point%xi(1)]
   end function vector_of

   !> Units of the arc length: the amplitude for coefficients, the frequency for itself and for the damping unless that is more.
   pure function units_of(point) result(units)
      type(way_point_t), intent(in) :: point
      real(wp) :: units(size(point%u) + 2)

      units(:size(point%u)) = point%amplitude(1)
      units(size(point%u) + 1) = point%omega(1)
      units(size(point%u) + 2) = max(point%omega(1), abs(point%xi(1)))
   end function units_of

   !> First direction: more of the same shape.
   subroutine point_upwards(self, point, direction)
      type(search_t), intent(inout) :: self
      type(way_point_t), intent(in) :: point
      real(wp), allocatable, intent(out) :: direction(:)

      direction = [reshape(point%u - self%rest%u, [size(point%u)]), 0.0_wp, 0.0_wp]
      direction = direction/norm2(direction/units_of(point))
      call turn_direction(self, point, direction)
   end subroutine point_upwards

   !> The problem of one point of the curve: the phase condition, and the plane across `direction` at a distance.
   subroutine make_problem(self, point, direction, step, problem)
      type(search_t), intent(inout) :: self
      type(way_point_t), intent(in) :: point
      real(wp), intent(in) :: direction(:), step
      type(phase_problem_t), intent(out) :: problem
      real(wp), allocatable :: forms(:, :)
      integer :: n

      n = size(point%u)
      call self%set_scales(point%amplitude(1))
      allocate (forms(n + 2, 2), source=0.0_wp)
      forms(:n, 1) = shift_form(self%balance%harmonics, self%tones(1), point%u, reshape(self%balance%x_scale, shape(point%u)))
      forms(:, 2) = direction/units_of(point)**2
      call new_phase_problem(problem, self%balance, self%tones, .true., forms, &
                             [0.0_wp, dot_product(forms(:, 2), vector_of(point)) + step])
   end subroutine make_problem

   !> Turns the direction where the curve has a kink, as at the first touch of a stop, so sharp that no plane across the
   !> direction meets what follows. What follows has the tangent of the next piece, in the sense that keeps the sign of the
   !> determinant (Allgower and Georg, Introduction to Numerical Continuation Methods, SIAM 2003, chapter 12).
   subroutine turn_at_kink(self, point, direction, is_turned)
      type(search_t), intent(inout) :: self
      type(way_point_t), intent(in) :: point
      real(wp), intent(inout) :: direction(:)
      logical, intent(out) :: is_turned
      type(way_point_t) :: beyond
      real(wp) :: next(size(direction)), same(size(direction)), sign_before, sign_beyond, x(size(direction))

      x = vector_of(point) + kink_step*direction
      beyond = point
      beyond%u = reshape(x(:size(point%u)), shape(point%u))
      beyond%omega = x(size(point%u) + 1)
      beyond%xi = x(size(point%u) + 2)
      same = direction
      call turn_direction(self, point, same, sign_before)
      next = direction
      call turn_direction(self, beyond, next, sign_beyond)
      is_turned = sign_before*sign_beyond < 0.0_wp
      if (is_turned) direction = -next
   end subroutine turn_at_kink

   !> Turns a direction into the tangent of the curve at a point, forwards.
   subroutine turn_direction(self, point, direction, determinant_sign)
      type(search_t), intent(inout) :: self
      type(way_point_t), intent(in) :: point
      real(wp), intent(inout) :: direction(:)
      real(wp), intent(out), optional :: determinant_sign             !! of the tangent bordered by the old direction, 0: none
      type(phase_problem_t) :: problem
      type(tangent_factor_t) :: factor
      real(wp) :: across(size(direction))
      logical :: is_possible, is_singular

      if (present(determinant_sign)) determinant_sign = 0.0_wp
      call self%move_balance(point, is_possible)
      if (.not. is_possible) return
      call make_problem(self, point, direction, 0.0_wp, problem)
      call new_tangent_factor(factor, problem%n_unknowns)
      call factor%update(problem, vector_of(point), is_singular)
      self%report%factorizations = self%report%factorizations + 1
      if (is_singular) return                                         ! the old direction must do
      if (present(determinant_sign)) determinant_sign = factor%determinant_sign()
      across = 0.0_wp
      across(size(across)) = 1.0_wp
      call factor%solve(problem, across)
      direction = across/norm2(across/units_of(point))
   end subroutine turn_direction

   !> Goes one step along the direction and back to the curve.
   subroutine advance(self, from, step, direction, to, report, is_on_curve)
      type(search_t), intent(inout) :: self
      type(way_point_t), intent(in) :: from
      real(wp), intent(in) :: step, direction(:)
      type(way_point_t), intent(out) :: to
      type(report_t), intent(out) :: report
      logical, intent(out) :: is_on_curve
      type(phase_problem_t) :: problem
      real(wp), allocatable :: x(:)
      integer :: n

      n = size(from%u)
      to = from
      call self%move_balance(from, is_on_curve)
      if (.not. is_on_curve) return
      call make_problem(self, from, direction, step, problem)
      x = vector_of(from) + step*direction
      call solve_newton(problem, self%path_config(), x, report)
      call self%report%add(report)
      is_on_curve = report%status == outcome%converged
      if (.not. is_on_curve) return
      to%u = reshape(x(:n), shape(to%u))
      to%omega = x(n + 1)
      to%xi = x(n + 2)
      associate (set => self%balance%harmonics)
         associate (h => fundamental(set, self%tones(1)))
            to%amplitude = maxval(hypot(to%u(set%cos_at(h), :), to%u(set%sin_at(h), :)))
         end associate
      end associate
   end subroutine advance

   !> Finds the limit cycle on a step on which the damping changes its sign, and tries it without artificial damping, the
   !> sooner the better.
   subroutine land(self, from, step, direction, is_found)
      type(search_t), intent(inout) :: self
      type(way_point_t), intent(inout) :: from                        !! where the step begins; the motion found
      real(wp), intent(in) :: step, direction(:)
      logical, intent(out) :: is_found
      type(way_point_t) :: middle, trial
      type(report_t) :: report
      real(wp) :: high, low
      integer :: i
      logical :: is_on_curve

      low = 0.0_wp
      high = step
      do i = 1, most_bisections
         call advance(self, from, 0.5_wp*(low + high), direction, middle, report, is_on_curve)
         if (.not. is_on_curve) middle = from
         trial = middle
         if (abs(middle%xi(1)) <= 0.1_wp*0.3_wp**i*middle%omega(1) .or. modulo(i, 4) == 0) then
            call self%try_motion(trial, is_found)
            if (is_found) is_found = abs(log(trial%omega(1)/middle%omega(1))) < 0.1_wp
            if (is_found) then
               from = trial
               return
            end if
         end if
         if (.not. is_on_curve) exit
         if (middle%xi(1)*from%xi(1) > 0.0_wp) then
            low = 0.5_wp*(low + high)
         else
            high = 0.5_wp*(low + high)
         end if
      end do
      is_found = .false.
   end subroutine land
end module hb_amplitude_curve
