!> Tables (x_i, y_i): search, and the function through the points by a monotone cubic, which has no overshoot between points and
!> a continuous slope. Beyond the points it continues with the slope of the end, or stays constant.
!> Source: Fritsch and Carlson, SIAM J. Numer. Anal. 17 (1980) 238-246: three-point slopes, limited to the circle of radius
!> 3 in their figure 2; docs/why/theory.md, section 5.1.
module hb_interpolation
   use hb_kinds, only: wp
   implicit none
   private
   public :: interval_of, is_ascending, monotone_cubic_t, new_monotone_cubic

   type :: monotone_cubic_t
      real(wp), allocatable :: nodes(:)                               !! x_i, ascending, at least two
      real(wp), allocatable :: values(:)                              !! y_i
      real(wp), allocatable :: slopes(:)                              !! at the nodes
      logical :: is_constant_beyond = .false.
   contains
      procedure :: at => monotone_cubic_at
      procedure :: on_interval => monotone_cubic_on_interval
   end type monotone_cubic_t

contains

   !> Creates the cubic through given points.
   pure subroutine new_monotone_cubic(self, nodes, values, is_constant_beyond)
      type(monotone_cubic_t), intent(out) :: self
      real(wp), intent(in) :: nodes(:)                                !! ascending, at least two
      real(wp), intent(in) :: values(:)                               !! as nodes
      logical, intent(in) :: is_constant_beyond                       !! otherwise it continues with the slope of the end

      self%nodes = nodes
      self%values = values
      self%slopes = monotone_slopes(nodes, values)
      self%is_constant_beyond = is_constant_beyond
   end subroutine new_monotone_cubic

   !> Slopes at the nodes that keep each cubic between the two values at its ends.
   pure function monotone_slopes(nodes, values) result(slopes)
      real(wp), intent(in) :: nodes(:), values(:)
      real(wp) :: slopes(size(nodes))
      real(wp) :: factor, secants(size(nodes) - 1), widths(size(nodes) - 1)
      integer :: i, n

      n = size(nodes)
      widths = nodes(2:) - nodes(:n - 1)
      secants = (values(2:) - values(:n - 1))/widths
      slopes(1) = secants(1)
      slopes(n) = secants(n - 1)
      do i = 2, n - 1
         slopes(i) = (widths(i)*secants(i - 1) + widths(i - 1)*secants(i))/(widths(i - 1) + widths(i))
         if (have_other_signs(secants(i - 1), secants(i))) slopes(i) = 0.0_wp
      end do
      do i = 1, n - 1
         if (secants(i) == 0.0_wp) then
            slopes(i:i + 1) = 0.0_wp
         else
            factor = 3.0_wp/hypot(slopes(i)/secants(i), slopes(i + 1)/secants(i))
            if (factor < 1.0_wp) slopes(i:i + 1) = factor*slopes(i:i + 1)
         end if
      end do
   end function monotone_slopes

   pure logical function have_other_signs(a, b)
      real(wp), intent(in) :: a, b

      have_other_signs = (a > 0.0_wp .and. b < 0.0_wp) .or. (a < 0.0_wp .and. b > 0.0_wp)
   end function have_other_signs

   !> Value and slope at `x`.
   pure subroutine monotone_cubic_at(self, x, value, slope)
      class(monotone_cubic_t), intent(in) :: self
      real(wp), intent(in) :: x
      real(wp), intent(out) :: value, slope

      call self%on_interval(interval_of(self%nodes, x), x, value, slope)
   end subroutine monotone_cubic_at

   !> Cubic with value and slope given at both ends, in t = (x - x_i)/(x_(i+1) - x_i).
   pure subroutine monotone_cubic_on_interval(self, interval, x, value, slope)
      class(monotone_cubic_t), intent(in) :: self
      integer, intent(in) :: interval                                 !! as returned by `interval_of`
      real(wp), intent(in) :: x
      real(wp), intent(out) :: value, slope
      real(wp) :: secant, t, width
      integer :: i, n

      n = size(self%nodes)
      i = interval
      if (i == 0 .or. i == n) then
         i = max(i, 1)
         slope = merge(0.0_wp, self%slopes(i), self%is_constant_beyond)
         value = self%values(i) + slope*(x - self%nodes(i))
         return
      end if
      width = self%nodes(i + 1) - self%nodes(i)
      t = (x - self%nodes(i))/width
      secant = (self%values(i + 1) - self%values(i))/width
      associate (s_1 => self%slopes(i), s_2 => self%slopes(i + 1))
         value = self%values(i) + width*t*(s_1 + t*(3.0_wp*secant - 2.0_wp*s_1 - s_2 + t*(s_1 + s_2 - 2.0_wp*secant)))
         slope = s_1 + t*(2.0_wp*(3.0_wp*secant - 2.0_wp*s_1 - s_2) + 3.0_wp*t*(s_1 + s_2 - 2.0_wp*secant))
      end associate
   end subroutine monotone_cubic_on_interval

   !> Number of nodes at or below z, 0 to size(nodes), by bisection.
   pure integer function interval_of(nodes, z) result(low)
      real(wp), intent(in) :: nodes(:)                                !! ascending
      real(wp), intent(in) :: z
      integer :: high, middle

      low = 0
      high = size(nodes) + 1
      do while (high - low > 1)
         middle = (low + high)/2
         if (nodes(middle) <= z) then
            low = middle
         else
            high = middle
         end if
      end do
   end function interval_of

   !> Whether every node is greater than the previous one.
   pure logical function is_ascending(nodes)
      real(wp), intent(in) :: nodes(:)

      is_ascending = all(nodes(2:) > nodes(:size(nodes) - 1))
   end function is_ascending
end module hb_interpolation
