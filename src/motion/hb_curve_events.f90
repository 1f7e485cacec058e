!> Functions along a curve of motions whose zeros are located: folds, grazes, branch points, values.
!>
!> Distance of a motion from the kinks of its laws: the smallest and the largest value of each switch of a law, such
!> as the distance to a stop, over all phases. If one of them is zero, the motion grazes: a contact begins, or becomes
!> permanent.
module hb_curve_events
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_curve, only: curve_t, event_t
   use hb_kinds, only: two_pi, wp
   use hb_law, only: law_box_t
   use hb_model_problem, only: model_problem_t
   use hb_motion_description, only: stability_of
   use hb_motion_series, only: motion_series_t, new_motion_series
   use hb_stability, only: stability_t
   use hb_thresholds, only: max_bisections
   implicit none
   private
   public :: branch_event_t, event_values_t, extremes_of_switches, find_extremes, find_motion, find_stability, fold_event_t, &
      grazing_event_t, value_event_t

   integer, parameter :: largest_search_grid = 4096                   ! size of the grid for the first search of an extreme
   real(wp), parameter :: far = 0.25_wp                               ! from zero, relative to the range of the values

   !> Quantities at the point of the curve that events compare with those at the end of the next step.
   type :: event_values_t
      real(wp) :: rise = 0.0_wp                                       !! of the value in the direction
      real(wp), allocatable :: functions(:)                           !! of the responses, hb_observed_motion
      real(wp), allocatable :: squares(:)                             !! of the responses
      real(wp), allocatable :: extremes(:, :)                         !! of the switching functions of laws
      integer, allocatable :: impacts(:) !! of each wall in a period, if the unknowns are a state (hb_impact_curve)
      type(stability_t) :: stability                                  !! without multipliers if none are searched for
   end type event_values_t

   !> A fold: the value's component of the tangent is zero.
   type, extends(event_t) :: fold_event_t
   contains
      procedure :: value => fold_event_value
   end type fold_event_t

   !> A branch point: the determinant of the tangent, bordered by the direction, changes sign.
   type, extends(event_t) :: branch_event_t
   contains
      procedure :: value => branch_event_value
   end type branch_event_t

   !> A given value.
   type, extends(event_t) :: value_event_t
      real(wp) :: wanted = 0.0_wp, unit = 1.0_wp
   contains
      procedure :: value => value_event_value
   end type value_event_t

   !> A zero of an extremum of a switching function of a law.
   type, extends(event_t) :: grazing_event_t
      type(model_problem_t), pointer :: problem => null()
      integer :: extreme = 0, switch = 0                              ! in the list of `find_extremes`
      real(wp) :: unit = 1.0_wp
   contains
      procedure :: value => grazing_event_value
   end type grazing_event_t

contains

   !> The motion at a point of the curve, at all degrees of freedom; not allocated if the parameters are rejected.
   subroutine find_motion(problem, x, c)
      type(model_problem_t), intent(inout), target :: problem
      real(wp), intent(in) :: x(:)
      complex(wp), allocatable, intent(out) :: c(:, :)
      logical :: is_possible

      call problem%move_to_point(x, is_possible)
      if (.not. is_possible) return
      associate (balance => problem%balance_t)
         allocate (c(problem%model%system%structure%n_dofs, balance%harmonics%n_harmonics))
         call balance%all_dofs(reshape(x(:problem%n_unknowns), [balance%harmonics%n_coefficients, balance%n_dofs]), c)
      end associate
   end subroutine find_motion

   !> Smallest and largest value of each switch of the laws, (2, any), `extremes_of_switches`.
   subroutine find_extremes(problem, x, extremes)
      type(model_problem_t), intent(inout), target :: problem
      real(wp), intent(in) :: x(:)
      real(wp), allocatable, intent(out) :: extremes(:, :)
      complex(wp), allocatable :: c(:, :)
      integer :: i

      allocate (extremes(2, 0))
      if (all([(problem%model%system%laws(i)%law%n_switches == 0, i=1, size(problem%model%system%laws))])) return
      call find_motion(problem, x, c)
      if (allocated(c)) call extremes_of_switches(problem%model%system%laws, problem%harmonics%tuples, problem%omega, c, &
                                                  extremes)
   end subroutine find_extremes

   real(wp) function grazing_event_value(self, curve, x) result(value)
      class(grazing_event_t), intent(inout) :: self
      class(curve_t), intent(inout) :: curve
      real(wp), intent(in) :: x(:)
      real(wp), allocatable :: extremes(:, :)

      call find_extremes(self%problem, x, extremes)
      value = ieee_value(value, ieee_quiet_nan)
      if (size(extremes, 2) >= self%switch) value = extremes(self%extreme, self%switch)/self%unit
   end function grazing_event_value

   real(wp) function fold_event_value(self, curve, x) result(value)
      class(fold_event_t), intent(inout) :: self
      class(curve_t), intent(inout) :: curve
      real(wp), intent(in) :: x(:)
      real(wp) :: tangent(size(x)), determinant_sign
      logical :: is_singular

      call curve%tangent_at(x, tangent, determinant_sign, is_singular)
      value = tangent(size(x))/curve%units(size(x))
      if (is_singular) value = 0.0_wp
   end function fold_event_value

   real(wp) function branch_event_value(self, curve, x) result(value)
      class(branch_event_t), intent(inout) :: self
      class(curve_t), intent(inout) :: curve
      real(wp), intent(in) :: x(:)
      real(wp) :: tangent(size(x))
      logical :: is_singular

      call curve%tangent_at(x, tangent, value, is_singular)
   end function branch_event_value

   real(wp) function value_event_value(self, curve, x) result(value)
      class(value_event_t), intent(inout) :: self
      class(curve_t), intent(inout) :: curve
      real(wp), intent(in) :: x(:)

      value = (x(size(x)) - self%wanted)/self%unit
   end function value_event_value

   !> Stability of the motion at a point of the curve; without multipliers if they are not searched for, or not found.
   subroutine find_stability(problem, x, tolerance, stability, is_integrated)
      type(model_problem_t), intent(inout), target :: problem
      real(wp), intent(in) :: x(:), tolerance
      type(stability_t), intent(out) :: stability
      logical, intent(in), optional :: is_integrated                  !! of the integrated periodic motion
      complex(wp), allocatable :: c(:, :)

      call find_motion(problem, x, c)
      if (allocated(c)) call stability_of(problem%model%system, problem%model%discretisation, problem%model%options, &
                                          problem%balance_t, c, tolerance, stability, is_integrated)
   end subroutine find_stability

   !> Extremes of all switches, (2, switches of all laws): smallest, largest. None if there are too many tones for a
   !> grid.
   subroutine extremes_of_switches(laws, tuples, omega, amplitudes, extremes)
      type(law_box_t), intent(inout) :: laws(:)                       !! phases are set for laws that rotate
      integer, intent(in) :: tuples(:, :)                             !! (n_tones, n_harmonics)
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones)
      complex(wp), intent(in) :: amplitudes(:, :)                     !! cos - i sin, (n_dofs, n_harmonics)
      real(wp), allocatable, intent(out) :: extremes(:, :)
      type(motion_series_t) :: motion
      real(wp), allocatable :: phases(:, :), values(:, :)
      integer :: i, n, s

      allocate (extremes(2, sum([(laws(i)%law%n_switches, i=1, size(laws))])))
      if (size(extremes, 2) == 0) return
      call make_grid(tuples, phases)
      if (size(phases, 2) == 0) then
         deallocate (extremes)
         allocate (extremes(2, 0))
         return
      end if
      n = 0
      do i = 1, size(laws)
         associate (law => laws(i)%law)
            if (law%n_switches == 0) cycle
            call new_motion_series(motion, tuples, omega, matmul(transpose(law%shape), amplitudes(law%dofs, :)))
            call find_values(laws(i), motion, phases, values)
            do s = 1, law%n_switches
               n = n + 1
               call locate_extreme(laws(i), motion, s, phases, values, -1.0_wp, extremes(1, n))
               call locate_extreme(laws(i), motion, s, phases, values, 1.0_wp, extremes(2, n))
            end do
         end associate
      end do
   end subroutine extremes_of_switches

   !> Phases on a grid that is fine enough for the highest harmonics, (n_tones, any); none if that is too large.
   pure subroutine make_grid(tuples, phases)
      integer, intent(in) :: tuples(:, :)
      real(wp), allocatable, intent(out) :: phases(:, :)
      integer :: each(size(tuples, 1)), i, m, quotient

      each = max(16, 4*maxval(abs(tuples), dim=2))
      if (size(each) > 1) each = max(12, 2*maxval(abs(tuples), dim=2) + 2)
      if (product(real(each, wp)) > real(largest_search_grid, wp)) each = 0
      allocate (phases(size(each), product(each)))
      do i = 1, size(phases, 2)
         quotient = i - 1
         do m = 1, size(each)
            phases(m, i) = two_pi*modulo(quotient, each(m))/each(m)
            quotient = quotient/each(m)
         end do
      end do
   end subroutine make_grid

   !> Values of all switches of a law, (n_switches, n_phases).
   subroutine find_values(box, motion, phases, values)
      type(law_box_t), intent(inout) :: box
      type(motion_series_t), intent(in) :: motion
      real(wp), intent(in) :: phases(:, :)
      real(wp), allocatable, intent(out) :: values(:, :)
      real(wp) :: v(size(phases, 2), motion%n_coordinates), z(size(phases, 2), motion%n_coordinates)
      integer :: i

      call motion%at(phases, z, v)
      allocate (values(box%law%n_switches, size(phases, 2)))
      do i = 1, size(phases, 2)
         if (box%law%n_phases > 0) call box%law%set_phases(phases(:, i:i))
         call box%law%switches(z(i, :), v(i, :), values(:, i))
      end do
   end subroutine find_values

   !> The largest value of a switch times a sign: from the best point of the grid, one tone after the other, to the
   !> vertex of the parabola through three phases whose distance is reduced from iteration to iteration.
   subroutine locate_extreme(box, motion, s, phases, values, sense, extreme)
      type(law_box_t), intent(inout) :: box
      type(motion_series_t), intent(in) :: motion
      integer, intent(in) :: s
      real(wp), intent(in) :: phases(:, :), values(:, :), sense
      real(wp), intent(out) :: extreme
      real(wp), allocatable :: near(:, :)
      real(wp) :: best(size(phases, 1)), curvature, shift, slope, stencil(size(phases, 1), 3), width
      integer :: m, round

      best = phases(:, maxloc(sense*values(s, :), dim=1))
      extreme = maxval(sense*values(s, :))
      if (abs(extreme) > far*(maxval(values(s, :)) - minval(values(s, :)))) then   ! its sign is known
         extreme = sense*extreme
         return
      end if
      width = two_pi/real(size(phases, 2), wp)**(1.0_wp/size(phases, 1))
      do round = 1, max_bisections
         do m = 1, size(best)
            stencil = spread(best, 2, 3)
            stencil(m, :) = best(m) + [-width, 0.0_wp, width]
            call find_values(box, motion, stencil, near)
            slope = sense*(near(s, 3) - near(s, 1))/(2.0_wp*width)
            curvature = sense*(near(s, 3) - 2.0_wp*near(s, 2) + near(s, 1))/width**2
            shift = sign(width, slope)
            if (curvature < 0.0_wp) shift = max(-width, min(width, -slope/curvature))
            if (.not. abs(slope) > 0.0_wp) shift = 0.0_wp
            best(m) = best(m) + shift
            extreme = max(extreme, maxval(sense*near(s, :)))
         end do
         width = max(1.0e-4_wp, 0.5_wp*width)                         ! a smaller one would show rounding errors only
      end do
      call find_values(box, motion, reshape(best, [size(best), 1]), near)
      extreme = sense*max(extreme, sense*near(s, 1))
   end subroutine locate_extreme
end module hb_curve_events
