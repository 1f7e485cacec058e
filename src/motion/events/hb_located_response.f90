!> A response at which points of a curve are located, and the function of its motion whose zeros they are.
!>
!> A new kind of these points is a row of hb_point_kinds and its formula here: `square` or `departure`, of an extreme `slope`, and
!> its unit if that is not the square. `find_series` of a curve supplies the motion with all harmonics, of balances
!> (hb_balance_branch) and of impacts (hb_orbit_branch) alike; `slope` gets those of the response alone.
module hb_located_response
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_amplitudes, only: amplitudes_t
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_point_kinds, only: curve_kind, curve_kinds
   use hb_response, only: response_t
   use hb_system, only: system_t
   use hb_thresholds, only: rounding_level
   implicit none
   private
   public :: located_response_t, response_series_t

   !> A response, and the kind of points that are located for it.
   type, extends(response_t) :: located_response_t
      integer :: kind = curve_kind%peak                               !! or another one whose row in `curve_kinds` has a key
      real(wp) :: target = 0.0_wp                                     !! value at which it is located, of a kind with `targets`
   contains
      procedure :: square => located_response_square
      procedure :: slope => located_response_slope
      procedure :: departure => located_response_departure
      procedure :: unit => located_response_unit
      procedure :: unit_of => located_response_unit_of
      procedure :: largest_load => located_response_largest_load
   end type located_response_t

   !> The motion of its degree of freedom at a point of a curve, and what it is compared with.
   type :: response_series_t
      type(harmonics_t), pointer :: set => null()
      complex(wp), allocatable :: c(:)                                !! a - i b, (harmonics of the set); none at a rejected point
      real(wp), allocatable :: omega(:)                               !! base frequencies at the point [rad/s], (n_tones)
      complex(wp) :: load = (0.0_wp, 0.0_wp)                          !! the largest one of its tuple
   end type response_series_t

contains

   !> Square of what is located: of the response. Zero at a rejected point.
   pure real(wp) function located_response_square(self, series) result(square)
      class(located_response_t), intent(in) :: self
      type(response_series_t), intent(in) :: series

      square = 0.0_wp
      if (size(series%c) > 0) square = self%of(series%set, series%c)
   end function located_response_square

   !> Derivative of that square along a curve, of which extremes are zeros.
   pure real(wp) function located_response_slope(self, series, slopes) result(slope)
      class(located_response_t), intent(in) :: self
      type(response_series_t), intent(in) :: series
      type(response_series_t), intent(in) :: slopes                   !! derivatives of its components

      slope = self%slope_of(series%set, series%c, slopes%c)
   end function located_response_slope

   !> The function whose zeros are located, except for extremes: the difference of that square from the
   !> requested one, or the part of a harmonic in phase with its load, turned by the requested lag behind it and a quarter of a
   !> period back. NaN at a rejected point, or without a load.
   real(wp) function located_response_departure(self, series) result(value)
      class(located_response_t), intent(in) :: self
      type(response_series_t), intent(in) :: series

      value = ieee_value(value, ieee_quiet_nan)
      if (size(series%c) == 0) return
      if (curve_kinds(self%kind)%needs_load) then
         associate (c => series%c, load => series%load)
            if (abs(load) > 0.0_wp) value = real(turn_of(self)*c(series%set%index_of(self%tuple))*conjg(load))/abs(load)
         end associate
      else
         value = self%square(series) - self%target**2
      end if
   end function located_response_departure

   !> The factor that turns a harmonic at the wanted phase to its load into quadrature with it.
   pure complex(wp) function turn_of(response) result(turn)
      type(located_response_t), intent(in) :: response

      select case (response%kind)
      case (curve_kind%phase)
         turn = cmplx(sin(response%target), -cos(response%target), wp)
      case default
         turn = (1.0_wp, 0.0_wp)
      end select
   end function turn_of

   !> A unit for the values of the function that is located, of the motion at a point nearby; 0 of a response that is but rounding
   !> of its motion.
   pure real(wp) function located_response_unit(self, series) result(unit)
      class(located_response_t), intent(in) :: self
      type(response_series_t), intent(in) :: series

      unit = 0.0_wp
      associate (square => self%square(series))
         if (square > (rounding_level*norm2(abs(series%c)))**2) unit = self%unit_of(square)
      end associate
   end function located_response_unit

   !> The same from what is located.
   pure real(wp) function located_response_unit_of(self, square) result(unit)
      class(located_response_t), intent(in) :: self
      real(wp), intent(in) :: square

      unit = square
      if (curve_kinds(self%kind)%needs_load) unit = sqrt(square)
   end function located_response_unit_of

   !> The largest load of the harmonic of a response; zero for a whole oscillation.
   pure complex(wp) function located_response_largest_load(self, system, set) result(load)
      class(located_response_t), intent(in) :: self
      type(system_t), intent(in) :: system
      type(harmonics_t), intent(in) :: set
      type(amplitudes_t) :: all_loads
      integer :: h

      load = (0.0_wp, 0.0_wp)
      if (.not. allocated(self%tuple)) return
      h = set%index_of(self%tuple)
      if (h == 0) return
      all_loads = system%loads_in(set)
      associate (loads => all_loads%of(h))
         load = loads(maxloc(abs(loads), dim=1))
      end associate
   end function located_response_largest_load
end module hb_located_response
