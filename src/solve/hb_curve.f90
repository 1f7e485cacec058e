!> A curve of solutions: a bordered problem with one equation fewer than unknowns, continued by arc length.
!>
!> The unknowns are x = (unknowns of the base problem, parameters); the last functional is the plane normal to the
!> curve, all others are the caller's. A step follows the tangent, Newton's method corrects in the plane at its end,
!> with factors or products depending on the size. If the tangent turns little from step to step, its direction
!> continues that of the last step. If it turns a lot, as at the first contact with a stop, its direction preserves
!> the sign of the determinant of the tangent bordered by the last direction (not known from products). A sign change
!> while the tangent turns little means that a branch point was passed. Lengths are measured in units of each unknown.
!>
!> Source: docs/why/theory.md, section 6.4; Allgower and Georg, Introduction to Numerical Continuation Methods, SIAM 2003,
!> chapters 2, 3, 6 and (orientation of piecewise linear curves) 12.
module hb_curve
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
   use hb_assert, only: assert, asserts_are_on
   use hb_bordered, only: bordered_problem_t, plane_t
   use hb_kinds, only: wp
   use hb_krylov, only: solve_krylov
   use hb_newton, only: solve_newton
   use hb_outcome, only: outcome
   use hb_solver_types, only: report_t, solver_config_t
   use hb_tangent_solver, only: new_tangent_solver, tangent_solver_t
   use hb_thresholds, only: equality_tolerance
   use hb_zero_bracket, only: new_zero_bracket, zero_bracket_t
   implicit none
   private
   public :: curve_config_t, curve_t, event_t, new_curve, path_t, solve_next_to

   real(wp), parameter :: min_growth = 0.05_wp ! of a functional along the curve, relative to its largest component

   !> Settings of the step control; lengths in units of the unknowns.
   type :: curve_config_t
      real(wp) :: first_step = 0.05_wp
      real(wp) :: longest_step = 0.5_wp
      real(wp) :: shortest_step = 1.0e-7_wp
      real(wp) :: kink_step = 0.0_wp !! distance beyond a kink at which its other side is sought; 0: not used
      real(wp) :: growth = 1.5_wp                                     !! of the step length after an easy step
      real(wp) :: reduction = 0.3_wp                                  !! of the step length after a failure
      integer :: easy_iterations = 4                                  !! of the corrector in an easy step
      real(wp) :: little = 0.97_wp                                    !! cosine of the largest angle that counts as little: 0 if
                                                                      !! the curve is smooth, above 1 if it has many kinks
      real(wp) :: angle = 0.0_wp                                      !! [rad] desired turn per step; 0: any
   end type curve_config_t

   !> Where a curve is, and what its next step depends on: a value, which may be stored and assigned to a curve.
   type :: path_t
      real(wp), allocatable :: x(:)                                   !! point on the curve, (n_unknowns)
      real(wp), allocatable :: direction(:)                           !! tangent there, of length 1
      real(wp) :: orientation = 0.0_wp                                !! sign of the determinant on this piece; 0: not known
      real(wp) :: step = 0.0_wp                                       !! length of the next step
      real(wp) :: length = 0.0_wp                                     !! of the arc so far
      real(wp) :: largest = 0.0_wp                                    !! motion so far, from which the caller derives units
      integer :: n_branch_points = 0                                  !! passed so far
   end type path_t

   !> A curve: its path and its equations.
   type, extends(path_t) :: curve_t
      type(bordered_problem_t) :: problem
      type(bordered_problem_t), allocatable :: part                   !! if present: the problem for the unknowns `retained` alone,
                                                                      !! on a curve along which all others are zero
      integer, allocatable :: retained(:)                             !! (unknowns of `part`)
      type(curve_config_t) :: config
      type(solver_config_t) :: corrector                              !! its limit of work is that of the whole curve
      type(path_t) :: last                                            !! the previous point; its `step` led from there to x
      real(wp), allocatable :: units(:)                               !! of lengths, > 0
      real(wp), allocatable :: functional(:)                          !! if present: planes are those of this functional, as
                                                                      !! long as it grows along the curve
      real(wp) :: angle = 0.0_wp                                      !! [rad] by which the last `turn` rotated the direction
      logical :: is_around_kink = .false.                             !! the last step is: its planes cross the curve on both sides
      integer :: status = outcome%pending                             !! `stalled`: no further step; `singular`: no tangent
      type(report_t) :: report                                        !! the work so far
      integer, private :: last_iterations = 0                         ! of the corrector
      logical, private :: is_turned = .false.                         ! at a kink, since the previous point
      logical, private :: is_along_functional = .false.               ! the last plane was that of `functional`
   contains
      procedure :: advance => curve_advance
      procedure :: retreat => curve_retreat
      procedure :: turn => curve_turn
      procedure :: point_at => curve_point_at
      procedure :: locate => curve_locate
      procedure :: find_zero => curve_find_zero
      procedure :: tangent_at => curve_tangent_at
      procedure :: set_plane => curve_set_plane
      procedure :: correct_at_value => curve_correct_at_value
      procedure, private :: turn_at_kink => curve_turn_at_kink
   end type curve_t

   !> An event on a curve: a zero of a function of its points.
   type, abstract :: event_t
      integer :: kind = 0                                             !! its number, defined by the caller
      logical :: may_jump = .false.                                   !! a jump across zero counts as a zero
      real(wp) :: tolerance = 0.0_wp                                  !! of the function
   contains
      procedure(event_value), deferred :: value
   end type event_t

   abstract interface
      !> The function at a point of the curve; NaN if it is not known.
      real(wp) function event_value(self, curve, x)
         import :: curve_t, event_t, wp
         class(event_t), intent(inout) :: self
         class(curve_t), intent(inout) :: curve                       !! for tangents; its own point is another one
         real(wp), intent(in) :: x(:)                                 !! (n_unknowns)
      end function event_value
   end interface

contains

   !> Creates a curve through x, which solves all equations but the last; `direction` is an approximate direction.
   subroutine new_curve(self, problem, x, direction, units, config, corrector)
      type(curve_t), intent(out) :: self
      type(bordered_problem_t), intent(in) :: problem                 !! its last functional is not used
      real(wp), intent(in) :: x(:)                                    !! (n_unknowns)
      real(wp), intent(in) :: direction(:)                            !! not zero
      real(wp), intent(in) :: units(:)                                !! of lengths, > 0
      type(curve_config_t), intent(in) :: config
      type(solver_config_t), intent(in) :: corrector

      if (asserts_are_on) call assert(norm2(direction) > 0.0_wp .and. all(units > 0.0_wp), &
                                      "new_curve", "a direction, and positive units")
      if (asserts_are_on) call assert(all([size(x), size(direction), size(units)] == problem%n_unknowns), &
                                      "new_curve", "point, direction and units of all unknowns")
      self%problem = problem
      self%config = config
      self%corrector = corrector
      self%x = x
      self%units = units
      self%step = config%first_step
      self%direction = direction/norm2(direction/units)
      call self%turn()
   end subroutine new_curve

   !> Takes one step along the direction and back to the curve; on failure with shorter and shorter steps, and finally
   !> around a kink. The status shows where the curve ends.
   subroutine curve_advance(self)
      class(curve_t), intent(inout) :: self
      logical :: is_on_curve

      do while (self%status == outcome%pending)
         self%last = self%path_t
         self%is_around_kink = self%is_turned
         call self%point_at(self%step, self%x, is_on_curve)
         if (is_on_curve) self%length = self%last%length + self%step
         if (is_on_curve .or. self%status /= outcome%pending) return
         call self%retreat()
      end do
   end subroutine curve_advance

   !> Returns to the previous point and shortens the step, because it left the curve or was too long for the caller.
   subroutine curve_retreat(self)
      class(curve_t), intent(inout) :: self
      real(wp) :: step
      logical :: is_possible

      step = self%config%reduction*min(self%step, self%last%step)
      self%path_t = self%last
      self%step = step
      if (self%step >= self%config%shortest_step) return
      is_possible = .false.
      if (self%config%kink_step > 0.0_wp .and. .not. self%is_turned) call self%turn_at_kink(is_possible)
      self%is_turned = is_possible
      if (.not. is_possible) self%status = outcome%stalled
   end subroutine curve_retreat

   !> Rotates the direction to the tangent at x, and chooses the next step. The caller may have changed functionals,
   !> scales and units.
   subroutine curve_turn(self)
      class(curve_t), intent(inout) :: self
      real(wp) :: direction(size(self%x)), factor, sign_now
      logical :: is_back, is_other, is_singular

      self%angle = 0.0_wp
      call self%tangent_at(self%x, direction, sign_now, is_singular)
      if (is_singular) then
         if (.not. allocated(self%last%x)) self%status = outcome%singular   ! otherwise the old direction is retained
      else
         if (.not. self%is_along_functional .and. abs(self%orientation*sign_now) > 0.0_wp) then
            is_other = self%orientation*sign_now < 0.0_wp
            is_back = .false.
            if (dot_product(direction/self%units, self%direction/self%units) <= self%config%little) then
               is_back = is_other
               if (allocated(self%part) .and. allocated(self%last%x)) call evaluate_part(self, is_back)
            end if
            if (is_other .neqv. is_back) self%n_branch_points = self%n_branch_points + 1
            if (is_back) direction = -direction
            self%orientation = merge(-sign_now, sign_now, is_back)
         else if (abs(sign_now) > 0.0_wp) then
            self%orientation = sign_now
         end if
         self%angle = angle_between(direction/self%units, self%direction/self%units)
         self%direction = direction
      end if
      self%is_turned = .false.
      if (.not. allocated(self%last%x)) return
      factor = 1.0_wp
      if (self%last_iterations <= self%config%easy_iterations) factor = self%config%growth
      if (self%config%angle > 0.0_wp .and. self%angle*factor > self%config%angle .and. .not. self%is_around_kink) &
         factor = max(self%config%reduction, self%config%angle/self%angle, self%config%shortest_step/self%step)
      if (abs(factor - 1.0_wp) > 0.0_wp) self%step = min(self%config%longest_step, factor*self%step)
   end subroutine curve_turn

   !> Whether the determinant of `part` changes its sign on the last step; solutions that leave this part may change
   !> the sign of the whole determinant at the same kink.
   subroutine evaluate_part(self, is_changed)
      type(curve_t), intent(inout) :: self
      logical, intent(inout) :: is_changed                            !! unchanged if that is not known
      real(wp) :: direction(size(self%x)), sign_before, sign_now
      logical :: is_singular

      call corrected_tangent(self, self%last%x, direction, sign_before, is_singular)
      if (is_singular) return
      call corrected_tangent(self, self%x, direction, sign_now, is_singular)
      if (.not. is_singular) is_changed = sign_before*sign_now < 0.0_wp
   end subroutine evaluate_part

   !> Angle between two vectors [rad], exact for small ones as well.
   pure real(wp) function angle_between(a, b) result(angle)
      real(wp), intent(in) :: a(:), b(:)

      angle = 2.0_wp*atan2(norm2(a/norm2(a) - b/norm2(b)), norm2(a/norm2(a) + b/norm2(b)))
   end function angle_between

   !> The point of the curve in the plane at a distance from the last point, along the direction there. A corrector that ends at
   !> rounding errors has found it as well: those of single points exceed their usual level.
   subroutine curve_point_at(self, step, x, is_on_curve, guess)
      class(curve_t), intent(inout) :: self
      real(wp), intent(in) :: step
      real(wp), intent(inout) :: x(:)
      logical, intent(out) :: is_on_curve
      real(wp), intent(in), optional :: guess(:)                      !! of the point; default: on the line along the direction
      real(wp), parameter :: max_rounding = 8.0_wp                    ! of a single point, in units of its usual level
      type(report_t) :: report
      type(solver_config_t) :: limited
      real(wp), allocatable :: y(:)

      limited = self%corrector
      limited%max_work = self%corrector%max_work - self%report%work
      call self%set_plane(self%last%x, self%last%direction, step)
      x = self%last%x + step*self%last%direction
      if (present(guess)) x = guess
      if (allocated(self%part)) then
         call copy_plane_to_part(self)
         y = x(self%retained)
         call solve_next_to(self%part, limited, y, report)
         x = 0.0_wp
         x(self%retained) = y
      else
         call solve_next_to(self%problem, limited, x, report)
      end if
      call self%report%add(report)
      self%last_iterations = report%iterations
      is_on_curve = report%status == outcome%converged
      if (any(report%status == [outcome%stalled, outcome%out_of_budget])) &
         is_on_curve = report%residual <= max_rounding*self%problem%rounding_level(x)
      if (any(report%status == [outcome%timed_out, outcome%interrupted])) self%status = report%status
      self%report%is_out_of_work = self%report%work >= self%corrector%max_work
      if (self%report%is_out_of_work) self%status = outcome%out_of_budget
   end subroutine curve_point_at

   !> Corrects a point near a solution, with the method for its size.
   subroutine solve_next_to(problem, config, x, report)
      type(bordered_problem_t), intent(inout) :: problem
      type(solver_config_t), intent(in) :: config
      real(wp), intent(inout), contiguous :: x(:)
      type(report_t), intent(out) :: report

      if (problem%has_products .and. problem%n_unknowns > problem%largest_dense) then
         call solve_krylov(problem, config, x, report)
      else
         call solve_newton(problem, config, x, report)
      end if
   end subroutine solve_next_to

   !> Locates a zero of a function that has changed its sign on the step from the last point to x. x becomes the zero;
   !> the next step begins there, after `turn` was called.
   subroutine curve_locate(self, event, is_found)
      class(curve_t), intent(inout) :: self
      class(event_t), intent(inout) :: event
      logical, intent(out) :: is_found
      real(wp) :: step, x(size(self%x))

      call self%find_zero(event, [0.0_wp, self%last%step], [event%value(self, self%last%x), event%value(self, self%x)], x, step, &
                          is_found)
      if (.not. is_found) return
      self%x = x
      self%last%step = step
      self%length = self%last%length + step
   end subroutine curve_locate

   !> As `locate`, without changing the curve. When the bracket cannot shrink further, by rounding or since no
   !> point in it can be computed, the remaining changes of the function and of x distinguish a jump from a zero, and a leap to
   !> another curve from both.
   subroutine curve_find_zero(self, event, positions, values, x, step, is_found)
      class(curve_t), intent(inout) :: self
      class(event_t), intent(inout) :: event
      real(wp), intent(in) :: positions(2)                            !! positions of the bracket, from the last point on
      real(wp), intent(in) :: values(2)                               !! of the function there, with different signs
      real(wp), intent(out) :: x(:)                                   !! the zero
      real(wp), intent(out) :: step                                   !! its position on the step, from the last point on
      logical, intent(out) :: is_found
      integer, parameter :: max_steps = 80, fast_steps = 24
      real(wp), parameter :: min_length = 4.0_wp*epsilon(1.0_wp)      ! of the bracket [steps]
      real(wp), parameter :: max_close_length = 1.0e-2_wp             ! likewise; farther guesses may lead to the crossing curve
      type(zero_bracket_t) :: bracket
      real(wp) :: value
      integer :: i
      logical :: is_close, is_on_curve

      call new_zero_bracket(bracket, positions, values, self%last%x, self%x, self%last%step)
      is_found = .false.
      do i = 1, max_steps
         step = bracket%inside(is_middle=modulo(i, 4) == 0 .or. i > fast_steps)
         is_close = i > fast_steps .or. bracket%length() <= max_close_length*self%last%step
         call find_point_inside(self, bracket, is_close, event%may_jump, step, x, is_on_curve)
         if (self%status /= outcome%pending) return
         if (.not. is_on_curve) then                                  ! the bracket cannot shrink further
            call bracket%get_nearest(step, x)
            is_found = is_close .and. bracket%has_zero(self%units, self%last%step, event%may_jump)
            return
         end if
         value = event%value(self, x)
         if (ieee_is_nan(value)) return
         is_found = abs(value) <= event%tolerance
         if (.not. is_found .and. bracket%length() > min_length*self%last%step) then
            call bracket%insert(step, x, value)
            cycle
         end if
         if (.not. is_found) is_found = bracket%has_zero(self%units, self%last%step, event%may_jump)
         return
      end do
   end subroutine curve_find_zero

   !> Point of the curve in a bracket, or where the corrector fails there, at another position in it: next to a kink it may
   !> succeed at one of two neighbouring positions alone.
   subroutine find_point_inside(self, bracket, is_close, may_jump, step, x, is_there)
      class(curve_t), intent(inout) :: self
      type(zero_bracket_t), intent(in) :: bracket
      logical, intent(in) :: is_close                                 !! otherwise the curve may leap
      logical, intent(in) :: may_jump                                 !! where the residual is small is near enough
      real(wp), intent(inout) :: step                                 !! its position
      real(wp), intent(inout) :: x(:)
      logical, intent(out) :: is_there
      real(wp), parameter :: shares(3) = [0.5_wp, 0.25_wp, 0.75_wp]
      integer :: k

      if (is_close .and. may_jump) then
         call self%point_at(step, x, is_there, bracket%between(step))
      else
         call self%point_at(step, x, is_there)
      end if
      do k = 1, size(shares)
         if (is_there .or. self%status /= outcome%pending) return
         step = bracket%ends(1) + shares(k)*bracket%length()
         if (is_close) then
            call self%point_at(step, x, is_there, bracket%between(step))
         else
            call self%point_at(step, x, is_there)
         end if
      end do
   end subroutine find_point_inside

   !> Sets the last equation to the plane at a distance from a point.
   subroutine curve_set_plane(self, x, direction, distance)
      class(curve_t), intent(inout) :: self
      real(wp), intent(in) :: x(:), direction(:), distance
      type(plane_t) :: plane

      if (asserts_are_on) call assert(size(x) == size(self%x) .and. size(direction) == size(x), &
                                      "curve_set_plane", "a point and a direction of the curve")
      plane%functional = direction/self%units**2
      self%is_along_functional = .false.
      if (allocated(self%functional)) self%is_along_functional = &
         dot_product(self%functional, direction) > min_growth*maxval(abs(self%functional*self%units))
      if (self%is_along_functional) plane%functional = self%functional/dot_product(self%functional, direction)
      plane%value = dot_product(plane%functional, x) + distance
      call self%problem%hold(plane)
   end subroutine curve_set_plane

   !> Solves for the point with the last unknown of x, near x.
   subroutine curve_correct_at_value(self, x, is_there)
      class(curve_t), intent(inout) :: self
      real(wp), intent(inout) :: x(:)
      logical, intent(out) :: is_there                                !! if false, x is unchanged
      type(bordered_problem_t) :: problem
      type(report_t) :: report
      real(wp) :: there(size(x))

      problem = self%problem
      call problem%hold(plane_t([0.0_wp*x(2:), 1.0_wp], x(size(x))))
      there = x
      call solve_next_to(problem, self%corrector, there, report)
      call self%report%add(report)
      there(size(x)) = x(size(x))
      is_there = report%status == outcome%converged .and. maxval(abs(there - x)/self%units) < equality_tolerance ! else near a fold
      if (is_there) x = there
   end subroutine curve_correct_at_value

   !> Copies the functionals of the whole problem to `part`.
   subroutine copy_plane_to_part(self)
      type(curve_t), intent(inout) :: self

      self%part%functionals = self%problem%functionals(self%retained, :)
      self%part%values = self%problem%values
      call self%part%rescale()
   end subroutine copy_plane_to_part

   !> The tangent at a point of the curve, along the direction, and the sign of the determinant; 0 if it is not known. On a step
   !> around a kink it is along the direction of the step: that at its end leads back before the kink.
   subroutine curve_tangent_at(self, x, tangent, determinant_sign, is_singular)
      class(curve_t), intent(inout) :: self
      real(wp), intent(in) :: x(:)
      real(wp), intent(out), contiguous :: tangent(:)
      real(wp), intent(out) :: determinant_sign
      logical, intent(out) :: is_singular
      real(wp) :: along(size(x))
      logical :: is_possible

      determinant_sign = 0.0_wp
      call self%problem%move_to(x, is_possible)
      is_singular = .not. is_possible
      if (is_singular) return
      along = self%direction
      if (self%is_around_kink) along = self%last%direction
      call self%set_plane(x, along, 0.0_wp)
      call find_tangent(self%problem, x, self%report, along, tangent, determinant_sign, is_singular)
      if (.not. is_singular) tangent = tangent/norm2(tangent/self%units)
   end subroutine curve_tangent_at

   !> The vector that a problem, evaluated at x, maps to zero except for its last functional.
   subroutine find_tangent(problem, x, report, guess, tangent, determinant_sign, is_singular)
      type(bordered_problem_t), intent(inout) :: problem
      real(wp), intent(in), contiguous :: x(:)
      type(report_t), intent(inout) :: report
      real(wp), intent(in) :: guess(:)                                !! of the tangent
      real(wp), intent(out), contiguous :: tangent(:)
      real(wp), intent(out) :: determinant_sign                       !! 0 if it is not known
      logical, intent(out) :: is_singular
      type(tangent_solver_t) :: solver

      determinant_sign = 0.0_wp
      call new_tangent_solver(solver, problem, x, is_singular)
      report%factorizations = report%factorizations + 1
      report%work = report%work + problem%tangent_work
      if (is_singular) return
      determinant_sign = solver%determinant_sign()
      tangent = 0.0_wp
      tangent(size(tangent)) = 1.0_wp
      call solver%solve(problem, tangent, is_singular, guess)
   end subroutine find_tangent

   !> Rotates the direction at a kink so sharp that no plane normal to the old direction meets the following piece.
   !> Its direction is found from the tangent of the next piece, in the sense that preserves the sign of the determinant.
   !> Several distances beyond the kink are tried: straight ahead there may be other pieces, which the curve never enters
   !> and whose tangent leads back along the curve. Therefore a point is computed in that direction, where the sign must
   !> be the same again: next to this point and, if that leads back along the same piece, next to the kink itself.
   subroutine curve_turn_at_kink(self, is_possible)
      class(curve_t), intent(inout) :: self
      logical, intent(out) :: is_possible
      real(wp), parameter :: shares(4) = [1.0_wp, 10.0_wp, 0.1_wp, 100.0_wp]   ! of `kink_step`
      real(wp), dimension(size(self%x)) :: direction, guess, next, there, x
      real(wp) :: sign_before, sign_beyond
      integer :: i, k
      logical :: is_on_curve, is_singular

      is_possible = .false.
      direction = self%direction
      call corrected_tangent(self, self%x, next, sign_before, is_singular)
      do i = 1, merge(0, size(shares), is_singular)
         self%direction = direction
         self%step = shares(i)*self%config%kink_step
         call corrected_tangent(self, self%x + self%step*direction, next, sign_beyond, is_singular)
         if (is_singular .or. .not. sign_before*sign_beyond < 0.0_wp) cycle
         self%last%direction = -next
         guess = self%x - self%step*next
         do k = 1, 2
            call self%point_at(self%step, x, is_on_curve, guess)
            if (self%status /= outcome%pending) exit
            if (is_on_curve) then
               self%direction = -next
               call corrected_tangent(self, x, there, sign_beyond, is_singular)
               is_possible = .not. is_singular .and. sign_before*sign_beyond > 0.0_wp
            end if
            if (is_possible) then
               call face_both_sides(self, direction, there, x)
               return
            end if
            self%direction = direction
            if (k == 1) call start_from_kink(self, sign_before, -next, guess)
         end do
         if (self%status /= outcome%pending) exit
      end do
      self%direction = direction
   end subroutine curve_turn_at_kink

   !> The first guess of a point on the piece beyond a kink that is up to a step ahead: from the kink, where the determinant
   !> straight ahead changes its sign, in the direction of that piece, in the plane of this step.
   subroutine start_from_kink(self, sign_before, beyond, guess)
      type(curve_t), intent(inout) :: self
      real(wp), intent(in) :: sign_before                             !! at its point
      real(wp), intent(in) :: beyond(:)                               !! direction
      real(wp), intent(out) :: guess(:)
      integer, parameter :: n_halvings = 20
      real(wp) :: ends(2), middle, sign_there, tangent(size(guess))
      integer :: i
      logical :: is_singular

      ends = [0.0_wp, self%step]
      do i = 1, n_halvings
         middle = 0.5_wp*sum(ends)
         call corrected_tangent(self, self%x + middle*self%direction, tangent, sign_there, is_singular)
         ends(merge(1, 2, .not. is_singular .and. sign_before*sign_there > 0.0_wp)) = middle
      end do
      associate (ahead => ends(2)*dot_product(self%direction/self%units, beyond/self%units))
         guess = self%x + ends(2)*self%direction + (self%step - ahead)*beyond
      end associate
   end subroutine start_from_kink

   !> Takes the direction half-way between both sides of a kink: its planes meet the curve before the kink, at it and beyond it,
   !> so that the step contains the kink and events there are located. The direction is that of the next piece if no such plane
   !> meets that piece.
   subroutine face_both_sides(self, before, beyond, x)
      class(curve_t), intent(inout) :: self
      real(wp), intent(in) :: before(:), beyond(:)                    !! tangents
      real(wp), intent(in) :: x(:)                                    !! a point beyond the kink
      real(wp), parameter :: min_tangent_sum = 1.0e-4_wp              ! sum of both tangents: the curve would go back along itself
      real(wp) :: half_way(size(x)), met(size(x)), next(size(x)), step
      logical :: is_on_curve

      half_way = before/norm2(before/self%units) + beyond/norm2(beyond/self%units)
      if (norm2(half_way/self%units) < min_tangent_sum) return
      half_way = half_way/norm2(half_way/self%units)
      step = dot_product((x - self%x)/self%units, half_way/self%units)
      if (.not. step > 0.0_wp) return
      next = self%direction
      self%last%direction = half_way
      call self%point_at(step, met, is_on_curve)
      if (is_on_curve) is_on_curve = norm2((met - x)/self%units) <= step
      if (is_on_curve) then
         self%direction = half_way
         self%step = step
      else
         self%last%direction = next
      end if
   end subroutine face_both_sides

   !> As `tangent_at`, for the problem that is corrected: `part`, if there is one, since solutions that leave it may
   !> change the sign of the determinant at the same kink.
   subroutine corrected_tangent(self, x, tangent, determinant_sign, is_singular)
      type(curve_t), intent(inout) :: self
      real(wp), intent(in) :: x(:)
      real(wp), intent(out), contiguous :: tangent(:)
      real(wp), intent(out) :: determinant_sign
      logical, intent(out) :: is_singular
      real(wp), allocatable :: y(:)
      logical :: is_possible

      if (.not. allocated(self%part)) then
         call self%tangent_at(x, tangent, determinant_sign, is_singular)
         return
      end if
      determinant_sign = 0.0_wp
      call self%part%move_to(x(self%retained), is_possible)
      is_singular = .not. is_possible
      if (is_singular) return
      call self%set_plane(x, self%direction, 0.0_wp)
      call copy_plane_to_part(self)
      allocate (y(size(self%retained)))
      call find_tangent(self%part, x(self%retained), self%report, self%direction(self%retained), y, determinant_sign, is_singular)
      tangent = 0.0_wp
      tangent(self%retained) = y
      if (.not. is_singular) tangent = tangent/norm2(tangent/self%units)
   end subroutine corrected_tangent
end module hb_curve
