!> Functions along a curve of motions whose zeros are of interest: folds, peaks of responses, branch points, bifurcations, values.
module hb_curve_events
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_bifurcation, only: bifurcation_value
   use hb_curve, only: curve_t, event_t
   use hb_curve_request, only: curve_kind, located_response_t
   use hb_grazing, only: extremes_of_switches
   use hb_kinds, only: wp
   use hb_model_problem, only: model_problem_t
   use hb_motion_description, only: stability_of
   use hb_response, only: response_t
   use hb_stability, only: stability_t
   use hb_thresholds, only: rounding
   implicit none
   private
   public :: bifurcation_event_t, branch_event_t, count_event_t, find_extremes, find_stability, fold_event_t, graze_event_t
   public :: function_at, n_outside, response_event_t, sharp, square_at, value_event_t

   real(wp), parameter :: sharp = 1.0e-11_wp                          !! tolerance of functions and multipliers at events

   !> Where the value turns back: its part of the tangent.
   type, extends(event_t) :: fold_event_t
   contains
      procedure :: value => fold_event_value
   end type fold_event_t

   !> Where the determinant of the tangent, bordered by the direction, changes its sign.
   type, extends(event_t) :: branch_event_t
   contains
      procedure :: value => branch_event_value
   end type branch_event_t

   !> Where the value is a given one.
   type, extends(event_t) :: value_event_t
      real(wp) :: wanted = 0.0_wp, unit = 1.0_wp
   contains
      procedure :: value => value_event_value
   end type value_event_t

   !> What a function of the motion decides.
   type, abstract, extends(event_t) :: motion_event_t
      type(model_problem_t), pointer :: problem => null()
   end type motion_event_t

   !> Where the function of a response is zero.
   type, extends(motion_event_t) :: response_event_t
      type(located_response_t) :: response
      real(wp) :: unit = 1.0_wp                                       ! of the function
   contains
      procedure :: value => response_event_value
   end type response_event_t

   !> Where an extreme of a switch of a law is zero.
   type, extends(motion_event_t) :: graze_event_t
      integer :: extreme = 0, switch = 0                              ! in the list of `find_extremes`
      real(wp) :: unit = 1.0_wp
   contains
      procedure :: value => graze_event_value
   end type graze_event_t

   !> Where a function of the multipliers is zero.
   type, extends(motion_event_t) :: bifurcation_event_t
      integer :: bifurcation = 0                                      ! hb_bifurcation
      logical :: is_integrated = .false.                              ! of the motion that repeats when it is integrated
   contains
      procedure :: value => bifurcation_event_value
   end type bifurcation_event_t

   !> Where the number of multipliers outside of the unit circle changes: 1 as long as it is a given one, else -1.
   type, extends(motion_event_t) :: count_event_t
      integer :: n = 0
   contains
      procedure :: value => count_event_value
   end type count_event_t

contains

   real(wp) function bifurcation_event_value(self, curve, x) result(value)
      class(bifurcation_event_t), intent(inout) :: self
      class(curve_t), intent(inout) :: curve
      real(wp), intent(in) :: x(:)
      type(stability_t) :: there

      call find_stability(self%problem, x, sharp, there, self%is_integrated)
      value = ieee_value(value, ieee_quiet_nan)
      if (allocated(there%multipliers)) value = bifurcation_value(self%bifurcation, there%multipliers)
   end function bifurcation_event_value

   real(wp) function count_event_value(self, curve, x) result(value)
      class(count_event_t), intent(inout) :: self
      class(curve_t), intent(inout) :: curve
      real(wp), intent(in) :: x(:)
      type(stability_t) :: there

      call find_stability(self%problem, x, sharp, there)
      value = ieee_value(value, ieee_quiet_nan)
      if (allocated(there%multipliers)) value = merge(1.0_wp, -1.0_wp, n_outside(there) == self%n)
   end function count_event_value

   !> Number of multipliers outside of the unit circle; what rounding leaves of those on it, as without damping, is not outside.
   pure integer function n_outside(stability)
      type(stability_t), intent(in) :: stability

      n_outside = count(abs(stability%multipliers) > 1.0_wp + rounding)
   end function n_outside

   !> The motion at a point of the curve, at all degrees of freedom; not allocated where the parameters are refused.
   subroutine find_motion(problem, x, c)
      type(model_problem_t), intent(inout), target :: problem
      real(wp), intent(in) :: x(:)
      complex(wp), allocatable, intent(out) :: c(:, :)
      logical :: is_possible

      call problem%move_to_point(x, is_possible)
      if (.not. is_possible) return
      associate (balance => problem%balance_t)
         allocate (c(problem%model%structure%n_dofs, balance%harmonics%n_harmonics))
         call balance%all_dofs(reshape(x(:problem%n_unknowns), [balance%harmonics%n_coefficients, balance%n_dofs]), c)
      end associate
   end subroutine find_motion

   !> Smallest and largest value of each switch of the laws, (2, any), hb_grazing.
   subroutine find_extremes(problem, x, extremes)
      type(model_problem_t), intent(inout), target :: problem
      real(wp), intent(in) :: x(:)
      real(wp), allocatable, intent(out) :: extremes(:, :)
      complex(wp), allocatable :: c(:, :)
      integer :: i

      allocate (extremes(2, 0))
      if (all([(problem%model%laws(i)%law%n_switches == 0, i=1, size(problem%model%laws))])) return
      call find_motion(problem, x, c)
      if (allocated(c)) call extremes_of_switches(problem%model%laws, problem%harmonics%tuples, problem%omega, c, &
                                                  extremes)
   end subroutine find_extremes

   real(wp) function graze_event_value(self, curve, x) result(value)
      class(graze_event_t), intent(inout) :: self
      class(curve_t), intent(inout) :: curve
      real(wp), intent(in) :: x(:)
      real(wp), allocatable :: extremes(:, :)

      call find_extremes(self%problem, x, extremes)
      value = ieee_value(value, ieee_quiet_nan)
      if (size(extremes, 2) >= self%switch) value = extremes(self%extreme, self%switch)/self%unit
   end function graze_event_value

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

   real(wp) function response_event_value(self, curve, x) result(value)
      class(response_event_t), intent(inout) :: self
      class(curve_t), intent(inout) :: curve
      real(wp), intent(in) :: x(:)
      real(wp) :: tangent(size(x)), determinant_sign
      logical :: is_singular

      call curve%tangent_at(x, tangent, determinant_sign, is_singular)
      value = ieee_value(value, ieee_quiet_nan)
      if (.not. is_singular) value = function_at(self%problem, self%response, x, tangent)/self%unit
   end function response_event_value

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

   !> The function whose zeros are located: the slope of the square of a response along a direction, how far the square is from
   !> the one requested, or the part of a harmonic that is in phase with its load.
   real(wp) function function_at(problem, response, x, direction) result(value)
      type(model_problem_t), intent(inout), target :: problem
      type(located_response_t), intent(in) :: response
      real(wp), intent(in) :: x(:), direction(:)
      complex(wp) :: load, motion
      complex(wp), allocatable :: c(:)
      integer :: h

      select case (response%kind)
      case (curve_kind%amplitude)
         value = square_at(problem, response, x) - response%amplitude**2
      case (curve_kind%resonance)
         call find_series(problem, response, x, c)
         h = problem%model%harmonics%index_of(response%tuple)
         motion = (0.0_wp, 0.0_wp)
         if (size(c) > 0) motion = c(h)
         associate (loads => problem%model%loads%of(h))
            load = loads(maxloc(abs(loads), dim=1))
         end associate
         value = ieee_value(value, ieee_quiet_nan)
         if (abs(load) > 0.0_wp) value = real(motion*conjg(load))/abs(load)
      case default
         value = slope_at(problem, response, x, direction)
      end select
   end function function_at

   !> Slope of the square of a response along a direction, by a difference of fourth order.
   real(wp) function slope_at(problem, response, x, direction) result(slope)
      type(model_problem_t), intent(inout), target :: problem
      class(response_t), intent(in) :: response
      real(wp), intent(in) :: x(:), direction(:)
      real(wp), parameter :: apart = 1.0e-3_wp
      real(wp) :: near, far

      near = square_at(problem, response, x + apart*direction) - square_at(problem, response, x - apart*direction)
      far = square_at(problem, response, x + 2.0_wp*apart*direction) - square_at(problem, response, x - 2.0_wp*apart*direction)
      slope = (8.0_wp*near - far)/(12.0_wp*apart)
   end function slope_at

   !> Square of a response.
   real(wp) function square_at(problem, response, x) result(square)
      type(model_problem_t), intent(inout), target :: problem
      class(response_t), intent(in) :: response
      real(wp), intent(in) :: x(:)
      complex(wp), allocatable :: c(:)

      call find_series(problem, response, x, c)
      square = 0.0_wp
      if (size(c) > 0) square = response%of(problem%model%harmonics, c)
   end function square_at

   !> Amplitudes of the degree of freedom of a response; none where the parameters are refused.
   subroutine find_series(problem, response, x, c)
      type(model_problem_t), intent(inout), target :: problem
      class(response_t), intent(in) :: response
      real(wp), intent(in) :: x(:)
      complex(wp), allocatable, intent(out) :: c(:)                   !! (n_harmonics)
      complex(wp), allocatable :: motion(:, :)
      real(wp) :: u(problem%model%harmonics%n_coefficients, problem%n_dofs)
      integer :: h

      associate (set => problem%model%harmonics)
         if (response%column > 0) then
            u = reshape(x(:size(u)), shape(u))
            c = [(set%amplitude(u(:, response%column), h), h=1, set%n_harmonics)]
         else
            call find_motion(problem, x, motion)
            allocate (c(0))
            if (allocated(motion)) c = motion(response%dof, :)
         end if
      end associate
   end subroutine find_series

   !> Stability of the motion at a point of the curve; without multipliers where they are not looked for, or not found.
   subroutine find_stability(problem, x, tolerance, stability, is_integrated)
      type(model_problem_t), intent(inout), target :: problem
      real(wp), intent(in) :: x(:), tolerance
      type(stability_t), intent(out) :: stability
      logical, intent(in), optional :: is_integrated                  !! that of the motion that repeats when it is integrated
      complex(wp), allocatable :: c(:, :)

      call find_motion(problem, x, c)
      if (allocated(c)) call stability_of(problem%model, problem%balance_t, c, tolerance, stability, is_integrated)
   end subroutine find_stability
end module hb_curve_events
