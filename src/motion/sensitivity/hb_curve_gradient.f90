!> Derivatives of points of a curve with respect to numbers of the model.
!> Folds, peaks and similar points move along the curve when a number p changes. They are zeros of an extended system: the
!> equations R(x, p) = 0 of the curve, and the function g(x, p) = 0 of the event, hb_curve_events. One step of Newton's method
!> with the tangent at p solves it at p +- h: in the plane across the curve, then along the curve. All other points are fixed at
!> their value along the curve, hb_gradient. Source: docs/why/theory.md, section 6.8.
module hb_curve_gradient
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_balance_branch, only: balance_branch_t
   use hb_bifurcation_location, only: bifurcation_event_t
   use hb_cancellation, only: work_is_over
   use hb_curve, only: curve_t, event_t
   use hb_curve_events, only: fold_event_t
   use hb_curve_points, only: curve_point_t
   use hb_error, only: error_t
   use hb_event_location, only: response_event_t
   use hb_gradient, only: differentiable_t, differentiate_to_tolerance, find_gradient, store_slope, zero_gradient
   use hb_kinds, only: wp
   use hb_law, only: has_memory
   use hb_level, only: level_t, transferred
   use hb_model_number, only: model_number_t
   use hb_model_numbers, only: find_model_number
   use hb_motion_result, only: gradient_t, motion_result_t
   use hb_movement, only: movement_t, new_movement, set_movement
   use hb_outcome, only: is_solved
   use hb_point_kinds, only: curve_kind, curve_kinds, located_by
   use hb_system, only: system_t
   use hb_tangent_solver, only: new_tangent_solver, tangent_solver_t
   use hb_thresholds, only: equality_tolerance, location_tolerance, nearby_steps, negligible_share, small_share
   implicit none
   private
   public :: find_curve_gradient

   real(wp), parameter :: smooth_step = 3.0e-5_wp ! of differences, relative to the number or the largest motion; 1e-4: the
                                                  ! defect of a smooth fold is 2e-3
   real(wp), parameter :: step_across_samples = 3.0e-2_wp             ! likewise, over 20 of the following samples
   integer, parameter :: n_steps_across_samples = 6                   ! of Newton's method with the same tangent: to 1e-4
   integer, parameter :: min_samples = 4096                        ! of one tone, for a position to 1 %
   real(wp), parameter :: max_values = 1.0e6_wp                      ! of them for all coordinates: a second for a step

   !> A located point.
   type, extends(differentiable_t) :: located_t
      class(balance_branch_t), pointer :: branch => null()
      real(wp), allocatable :: direction(:)                           ! of the curve there
      type(curve_point_t) :: point
      real(wp) :: step = smooth_step
      integer :: n_newton_steps = 1
   contains
      procedure :: differentiate => located_differentiate
   end type located_t

   !> The extended system for one value of a number. Owns external resources: its branch.
   type :: extended_t
      class(balance_branch_t), allocatable :: branch
      type(curve_t) :: curve
      class(event_t), allocatable :: event
      real(wp), allocatable :: x(:)                                   ! the solution
      real(wp), allocatable :: tangent(:)                             ! of the curve there
      real(wp) :: growth = 0.0_wp                                     ! of the event along it
      type(tangent_solver_t) :: solver                                ! of the equations with the plane across it
   end type extended_t

   !> The same point for another value.
   type :: neighbour_t
      real(wp) :: position = 0.0_wp                                   ! value along the curve
      real(wp), allocatable :: frequency(:)                           ! [rad/s], (n_tones)
      complex(wp), allocatable :: c(:, :)                             ! [m], (all dofs, n_harmonics)
   end type neighbour_t

contains

   !> Adds the requested derivatives to the result of a point.
   subroutine find_curve_gradient(branch, direction, point, result)
      class(balance_branch_t), intent(inout), target :: branch        !! on the set of the point
      real(wp), intent(in) :: direction(:)                            !! of the curve near the point
      type(curve_point_t), intent(in) :: point
      type(motion_result_t), intent(inout) :: result
      type(error_t), allocatable :: error
      type(located_t) :: located
      real(wp), allocatable :: unknowns(:)
      logical :: is_possible

      if (.not. is_solved(result%status)) return
      call branch%problem%move_to_point(point%x, is_possible)
      if (.not. is_possible) return
      associate (problem => branch%problem)
         if (curve_kinds(point%kind)%has_derivatives) then
            located%branch => branch
            located%direction = direction
            located%point = point
            call located%differentiate(branch%level, result%gradient, error)
            if (.not. allocated(result%gradient%coefficients)) return
            call differentiate_to_tolerance(located, problem%model%system, problem%model%options, branch%level, result%gradient)
            if (has_jumping_slopes(problem%model%system)) call average_position(located, result%gradient)
         else if (curve_kinds(point%kind)%by == located_by%nothing) then  ! at the others there may be none
            unknowns = [point%x(:problem%n_unknowns), problem%omega]
            call find_gradient(problem%model%system, problem%model%options, branch%level, unknowns, &
                               result)
         end if
      end associate
   end subroutine find_curve_gradient

   !> Whether laws have memory or rigid contact, whose kinks in time are not corrected.
   pure logical function has_jumping_slopes(system)
      type(system_t), intent(in) :: system
      integer :: i

      has_jumping_slopes = has_memory(system%laws) .or. any([(system%laws(i)%law%is_multiplier, i=1, size(system%laws))])
   end function has_jumping_slopes

   !> Differentiates the position across samples: where kinks move from one to the next without a correction, the slope of
   !> the motion along the curve jumps, by which the position of a peak changes as much as between them. Unknown, NaN, with
   !> several tones or many coordinates.
   subroutine average_position(located, gradient)
      type(located_t), intent(inout) :: located
      type(gradient_t), intent(inout) :: gradient
      type(error_t), allocatable :: error
      type(gradient_t) :: average
      type(level_t) :: level

      gradient%position = ieee_value(1.0_wp, ieee_quiet_nan)
      gradient%frequency = ieee_value(1.0_wp, ieee_quiet_nan)
      level = located%branch%level
      if (size(level%torus%n_samples) > 1 .or. min_samples*real(located%branch%problem%n_dofs, wp) > max_values) return
      call level%torus%resample(max(level%torus%n_samples, min_samples))
      located%step = step_across_samples
      located%n_newton_steps = n_steps_across_samples
      call located%differentiate(level, average, error)
      if (.not. allocated(average%coefficients)) return
      gradient%position = average%position
      gradient%frequency = average%frequency
   end subroutine average_position

   !> Forms the differences of the points on both sides; their distance from a line reveals a kink.
   subroutine located_differentiate(self, level, gradient, error)
      class(located_t), intent(inout) :: self
      type(level_t), intent(in) :: level
      type(gradient_t), intent(out) :: gradient
      type(error_t), allocatable, intent(out) :: error
      class(extended_t), allocatable, target :: here
      type(neighbour_t) :: sides(-1:1)
      real(wp) :: step, value
      integer :: k, side
      logical :: is_found

      associate (model => self%branch%problem%model)
         gradient = zero_gradient(model%system, model%options, level%harmonics)
         call extend(self, level, here, is_found)
         if (is_found) call solve(here, self%step, sides(0), is_found)
         do k = 1, size(model%options%gradient%by)
            if (.not. is_found .or. work_is_over()) exit
            call find_model_number(self%branch%model, model%options%gradient%by(k), value, is_found)
            step = self%step*merge(abs(value), 1.0_wp, abs(value) > 0.0_wp)
            do side = -1, 1, 2
               if (is_found) call step_to_side(self, level, here, model%options%gradient%by(k), value + side*step, sides(side), &
                                               is_found)
            end do
            if (.not. is_found) exit
            call store_slope(gradient, model%options%output%dofs, k, (sides(1)%c - sides(-1)%c)/(2.0_wp*step))
            gradient%frequency(:, k) = (sides(1)%frequency - sides(-1)%frequency)/(2.0_wp*step)
            gradient%position(k) = (sides(1)%position - sides(-1)%position)/(2.0_wp*step)
            gradient%defect(k) = norm2(abs(sides(1)%c - 2.0_wp*sides(0)%c + sides(-1)%c))/ &
                                 max(norm2(abs(sides(1)%c - sides(-1)%c)), tiny(1.0_wp))
         end do
      end associate
      if (.not. is_found .or. work_is_over()) gradient = gradient_t()
      call here%branch%destroy()
   end subroutine located_differentiate

   !> Sets up the extended system, for another value of a number if there is one.
   subroutine extend(self, level, there, is_possible, number, value)
      class(located_t), intent(in) :: self
      type(level_t), intent(in) :: level
      class(extended_t), allocatable, intent(out), target :: there
      logical, intent(out) :: is_possible
      type(model_number_t), intent(in), optional :: number
      real(wp), intent(in), optional :: value
      type(error_t), allocatable :: error
      type(movement_t) :: movement

      allocate (there)
      allocate (there%branch)
      associate (branch => there%branch, from => self%branch%level%harmonics)
         branch%request = self%branch%request
         branch%model = self%branch%model
         branch%further = self%branch%further
         branch%model%options%solver%tolerance = min(branch%model%options%solver%tolerance, 1.0e-12_wp)
         if (present(number)) then
            call new_movement(movement, branch%model, number, .false., error)
            if (.not. allocated(error)) call set_movement(branch%model, movement, value, error)
         end if
         if (.not. allocated(error)) call branch%adopt_level(level, error)
         is_possible = .not. allocated(error)
         if (.not. is_possible) return
         call branch%begin_curve(there%curve, transferred(from, level%harmonics, self%point%x, branch%n_further), &
                                 transferred(from, level%harmonics, self%direction, branch%n_further))
         call make_event(branch, self%point, there%event)
      end associate
   end subroutine extend

   !> Solves the extended system, and prepares steps to other values.
   subroutine solve(here, step, found, is_found)
      class(extended_t), intent(inout), target :: here
      real(wp), intent(in) :: step                                    ! of differences along the curve
      type(neighbour_t), intent(out) :: found
      logical, intent(out) :: is_found
      real(wp) :: determinant_sign
      logical :: is_singular

      associate (curve => here%curve)
         here%x = curve%x
         call find_zero(here%branch, curve, here%event, here%x, is_found)
         if (.not. is_found) return
         call describe(here%branch, here%x, found, is_found)
         allocate (here%tangent, mold=here%x)
         call curve%tangent_at(here%x, here%tangent, determinant_sign, is_singular)
         is_found = is_found .and. .not. is_singular
         if (.not. is_found) return
         here%growth = (here%event%value(curve, here%x + step*here%tangent) - &
                        here%event%value(curve, here%x - step*here%tangent))/(2.0_wp*step)
         call curve%problem%move_to(here%x, is_found)
         call curve%set_plane(here%x, here%tangent, 0.0_wp)
         call new_tangent_solver(here%solver, curve%problem, here%x, is_singular)
         is_found = is_found .and. .not. is_singular .and. abs(here%growth) > 0.0_wp
      end associate
   end subroutine solve

   !> Performs steps of Newton's method to the solution for another value of a number.
   subroutine step_to_side(self, level, here, number, value, found, is_found)
      class(located_t), intent(in) :: self
      type(level_t), intent(in) :: level
      class(extended_t), intent(inout) :: here
      type(model_number_t), intent(in) :: number
      real(wp), intent(in) :: value
      type(neighbour_t), intent(out) :: found
      logical, intent(out) :: is_found
      class(extended_t), allocatable, target :: there
      real(wp) :: step(size(here%x)), x(size(here%x))
      integer :: i
      logical :: is_singular

      call extend(self, level, there, is_found, number, value)
      x = here%x
      do i = 1, self%n_newton_steps
         if (is_found) call there%curve%problem%move_to(x, is_found)
         if (.not. is_found) exit
         call there%curve%problem%residual(x, step)
         step(size(step)) = 0.0_wp                                    ! in the plane
         call here%solver%solve(here%curve%problem, step, is_singular)
         x = x - step
         x = x - there%event%value(there%curve, x)/here%growth*here%tangent
      end do
      if (is_found) call describe(there%branch, x, found, is_found)
      call there%branch%destroy()
   end subroutine step_to_side

   !> The motion and its position at a point.
   subroutine describe(branch, x, found, is_possible)
      type(balance_branch_t), intent(inout) :: branch
      real(wp), intent(in) :: x(:)
      type(neighbour_t), intent(out) :: found
      logical, intent(out) :: is_possible

      associate (problem => branch%problem)
         call problem%move_to_point(x, is_possible)
         found%position = x(size(x))
         found%frequency = problem%omega
         allocate (found%c(problem%model%system%structure%n_dofs, problem%harmonics%n_harmonics))
         if (is_possible) call problem%all_dofs(x(:problem%n_unknowns), found%c)
      end associate
   end subroutine describe

   !> The function that is zero at a located point.
   subroutine make_event(branch, point, event)
      type(balance_branch_t), intent(inout), target :: branch
      type(curve_point_t), intent(in) :: point
      class(event_t), allocatable, intent(out) :: event
      type(bifurcation_event_t) :: change
      type(response_event_t) :: located

      select case (curve_kinds(point%kind)%by)
      case (located_by%value)
         allocate (event, source=fold_event_t(point%kind))
      case (located_by%multipliers)
         change%kind = point%kind
         change%followed => branch
         change%bifurcation = curve_kinds(point%kind)%bifurcation
         allocate (event, source=change)
      case default
         located%kind = point%kind
         located%followed => branch
         located%response = branch%request%responses(point%response)
         allocate (event, source=located)
      end select
   end subroutine make_event

   !> Follows the curve to the zero of a function by the secant method; x becomes the zero.
   subroutine find_zero(branch, curve, event, x, is_found)
      type(balance_branch_t), intent(inout), target :: branch
      type(curve_t), intent(inout) :: curve
      class(event_t), intent(inout) :: event
      real(wp), intent(inout) :: x(:)                                 !! near the zero
      logical, intent(out) :: is_found
      real(wp) :: before, here, direction(size(x)), last_step, step
      integer :: i

      direction = curve%direction
      step = negligible_share                                         ! of the secant, in units of lengths
      here = 0.0_wp
      do i = 1, nearby_steps
         curve%x = x
         call branch%correct_on_plane(x, direction, is_found)
         if (.not. is_found) return
         call branch%border(curve%x, direction, curve%problem)
         before = here
         here = event%value(curve, x)
         last_step = abs(step)
         if (i > 1) step = -here*step/(here - before)
         is_found = i > 1 .and. (abs(step) <= location_tolerance .or. (abs(step) <= equality_tolerance .and. & ! a rough residual
               abs(step) >= last_step))
         if (is_found) return
         if (.not. abs(step) <= small_share) return
         x = x + step*direction
      end do
   end subroutine find_zero
end module hb_curve_gradient
