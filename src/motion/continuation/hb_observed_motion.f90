!> What events of a curve compare: functions of a followed motion at its points, whose zeros and changes between two points are
!> located. They are the slope of the value, responses and their derivatives, multipliers, and extremes of the switching functions.
module hb_observed_motion
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_curve_events, only: event_values_t, find_extremes, find_motion, find_stability
   use hb_followed_motion, only: followed_motion_t
   use hb_kinds, only: wp
   use hb_located_response, only: located_response_t, response_series_t
   use hb_point_kinds, only: curve_kinds
   use hb_response_slope, only: find_series_slope, omega_slopes_along
   use hb_stability, only: stability_t
   implicit none
   private
   public :: observed_motion_t

   !> Owns external resources: call `destroy`. A variable of this type needs the attribute `target`.
   type, extends(followed_motion_t) :: observed_motion_t
   contains
      procedure :: evaluate_here => observed_motion_evaluate_here
      procedure :: function_at => observed_motion_function_at
      procedure :: square_at => observed_motion_square_at
      procedure :: unit_of_function => observed_motion_unit_of_function
      procedure :: slope_at => observed_motion_slope_at
      procedure :: find_series => observed_motion_find_series
      procedure :: find_stability => observed_motion_find_stability
      procedure :: find_contact => observed_motion_find_contact
   end type observed_motion_t

contains

   !> Computes the quantities at the point of the curve that events compare.
   subroutine observed_motion_evaluate_here(self, known)
      class(observed_motion_t), intent(inout), target :: self
      type(event_values_t), intent(out) :: known
      integer :: i

      associate (x => self%curve%x, responses => self%request%responses)
         known%rise = self%curve%direction(size(x))
         known%functions = [(self%function_at(responses(i), x, self%curve%direction), i=1, size(responses))]
         known%squares = [(self%square_at(responses(i), x), i=1, size(responses))]
         call self%find_stability(x, self%model%options%stability%tolerance, known%stability)
         call self%find_contact(x, known)
      end associate
   end subroutine observed_motion_evaluate_here

   !> The function whose zeros are located.
   real(wp) function observed_motion_function_at(self, response, x, direction) result(value)
      class(observed_motion_t), intent(inout), target :: self
      type(located_response_t), intent(in) :: response
      real(wp), intent(in) :: x(:), direction(:)
      type(response_series_t) :: series

      if (curve_kinds(response%kind)%is_extreme) then
         value = self%slope_at(response, x, direction)
         return
      end if
      call self%find_series(response, x, series)
      value = response%departure(series)
   end function observed_motion_function_at

   !> A unit for the values of that function near x.
   real(wp) function observed_motion_unit_of_function(self, response, x) result(unit)
      class(observed_motion_t), intent(inout), target :: self
      type(located_response_t), intent(in) :: response
      real(wp), intent(in) :: x(:)
      type(response_series_t) :: series

      call self%find_series(response, x, series)
      unit = response%unit(series)
   end function observed_motion_unit_of_function

   !> Square of a response.
   real(wp) function observed_motion_square_at(self, response, x) result(square)
      class(observed_motion_t), intent(inout), target :: self
      type(located_response_t), intent(in) :: response
      real(wp), intent(in) :: x(:)
      type(response_series_t) :: series

      call self%find_series(response, x, series)
      square = response%square(series)
   end function observed_motion_square_at

   !> Derivative of the square of a response along a direction; NaN if the parameters are rejected.
   real(wp) function observed_motion_slope_at(self, response, x, direction) result(slope)
      class(observed_motion_t), intent(inout), target :: self
      type(located_response_t), intent(in) :: response
      real(wp), intent(in) :: x(:), direction(:)
      type(response_series_t) :: series, slopes

      slope = ieee_value(slope, ieee_quiet_nan)
      call self%find_series(response, x, series)
      if (size(series%c) == 0) return
      call find_series_slopes(self, response, x, direction, slopes)
      if (allocated(slopes%c)) slope = response%slope(series, slopes)
   end function observed_motion_slope_at

   !> Derivatives of the motion of a degree of freedom along a direction, of the harmonics of its response, the others are zero, and
   !> of the base frequencies. None if the structure is singular there.
   subroutine find_series_slopes(self, response, x, direction, slopes)
      class(observed_motion_t), intent(inout) :: self                 !! its problem has moved to x
      type(located_response_t), intent(in) :: response
      real(wp), intent(in) :: x(:), direction(:)
      type(response_series_t), intent(out) :: slopes
      complex(wp), allocatable :: of_numbers(:)
      real(wp) :: u(self%problem%model%discretisation%harmonics%n_coefficients, self%problem%n_dofs)
      integer :: h

      associate (set => self%problem%model%discretisation%harmonics, &
                 numbers => response%numbers_in(self%problem%model%discretisation%harmonics))
         if (response%column > 0) then
            u = reshape(direction(:size(u)), shape(u))
            of_numbers = [(set%amplitude(u(:, response%column), numbers(h)), h=1, size(numbers))]
         else
            call find_series_slope(self%problem, response%dof, x, direction, numbers, of_numbers)
            if (.not. allocated(of_numbers)) return
         end if
         allocate (slopes%c(set%n_harmonics), source=(0.0_wp, 0.0_wp))
         slopes%c(numbers) = of_numbers
         slopes%omega = omega_slopes_along(self%problem, direction)
      end associate
   end subroutine find_series_slopes

   !> The motion of the degree of freedom of a response, to whose point the problem moves.
   subroutine observed_motion_find_series(self, response, x, series)
      class(observed_motion_t), intent(inout), target :: self
      type(located_response_t), intent(in) :: response
      real(wp), intent(in) :: x(:)
      type(response_series_t), intent(out) :: series
      complex(wp), allocatable :: motion(:, :)
      real(wp) :: u(self%problem%model%discretisation%harmonics%n_coefficients, self%problem%n_dofs)
      integer :: h
      logical :: is_possible

      call self%problem%move_to_point(x, is_possible)
      series%set => self%problem%model%discretisation%harmonics
      series%omega = self%problem%omega
      series%load = response%largest_load(self%problem%model%discretisation)
      allocate (series%c(0))
      if (.not. is_possible) return
      if (response%column > 0) then
         u = reshape(x(:size(u)), shape(u))
         series%c = [(series%set%amplitude(u(:, response%column), h), h=1, series%set%n_harmonics)]
      else
         call find_motion(self%problem, x, motion)
         if (allocated(motion)) series%c = motion(response%dof, :)
      end if
   end subroutine observed_motion_find_series

   !> Stability of the motion at a point of the curve.
   subroutine observed_motion_find_stability(self, x, tolerance, stability, is_integrated)
      class(observed_motion_t), intent(inout), target :: self
      real(wp), intent(in) :: x(:), tolerance
      type(stability_t), intent(out) :: stability                     !! without multipliers if they are not found
      logical, intent(in), optional :: is_integrated                  !! of the integrated periodic motion

      call find_stability(self%problem, x, tolerance, stability, is_integrated)
   end subroutine observed_motion_find_stability

   !> Extremes of the switching functions at a point of the curve.
   subroutine observed_motion_find_contact(self, x, known)
      class(observed_motion_t), intent(inout), target :: self
      real(wp), intent(in) :: x(:)
      type(event_values_t), intent(inout) :: known

      call find_extremes(self%problem, x, known%extremes)
   end subroutine observed_motion_find_contact
end module hb_observed_motion
