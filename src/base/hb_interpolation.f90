!> Tables (x_i, y_i): search, and the function through the points by a monotone cubic, which has no overshoot between points and
!> a continuous slope. Beyond the points it continues with the slope of the end, or stays constant.
!> Source: Fritsch and Carlson, SIAM J. Numer. Anal. 17 (1980) 238-246: three-point slopes, limited to the circle of radius
!> 3 in their figure 2; docs/why/theory.md, section 5.1.
module hb_interpolation
   use hb_assert, only: assert, asserts_are_on
   use hb_kinds, only: wp
   implicit none
   private
   public :: cubic_change_t, interval_of, is_ascending, monotone_cubic_t, new_monotone_cubic

   type :: monotone_cubic_t
      real(wp), allocatable :: nodes(:)                               !! x_i, ascending, at least two
      real(wp), allocatable :: values(:)                              !! y_i
      real(wp), allocatable :: slopes(:)                              !! at the nodes
      real(wp), allocatable, private :: entering(:)                   ! before the limit of the interval that begins there
      logical :: is_constant_beyond = .false.
   contains
      procedure :: at => monotone_cubic_at
      procedure :: on_interval => monotone_cubic_on_interval
      procedure :: find_change => monotone_cubic_find_change
      procedure :: change_at => monotone_cubic_change_at
   end type monotone_cubic_t

   !> Derivatives of the slopes by one value or node, zero outside a range.
   type :: cubic_change_t
      integer :: i = 0                                                !! number of the point that changes
      logical :: is_of_node = .false.                                 !! x_i; otherwise y_i
      integer :: first = 0, last = 0                                  !! range
      real(wp), allocatable :: slopes(:)                              !! of the slopes in the range, (first:last)
   end type cubic_change_t

contains

   !> Creates the cubic through given points.
   pure subroutine new_monotone_cubic(self, nodes, values, is_constant_beyond)
      type(monotone_cubic_t), intent(out) :: self
      real(wp), intent(in) :: nodes(:)                                !! ascending, at least two
      real(wp), intent(in) :: values(:)                               !! as nodes
      logical, intent(in) :: is_constant_beyond                       !! otherwise it continues with the slope of the end

      if (asserts_are_on) call assert(size(nodes) >= 2 .and. size(values) == size(nodes) .and. is_ascending(nodes), &
                                      "new_monotone_cubic", "two or more ascending nodes, with a value each")
      self%nodes = nodes
      self%values = values
      allocate (self%slopes(size(nodes)), self%entering(size(nodes)))
      call find_monotone_slopes(nodes, values, self%slopes, self%entering)
      self%is_constant_beyond = is_constant_beyond
   end subroutine new_monotone_cubic

   !> Slopes at the nodes that keep each cubic between the two values at its ends.
   pure subroutine find_monotone_slopes(nodes, values, slopes, entering)
      real(wp), intent(in) :: nodes(:), values(:)
      real(wp), intent(out) :: slopes(:), entering(:)                 !! as nodes
      real(wp) :: factor, secants(size(nodes) - 1), widths(size(nodes) - 1)
      integer :: i, n

      n = size(nodes)
      widths = nodes(2:) - nodes(:n - 1)
      secants = (values(2:) - values(:n - 1))/widths
      slopes(1) = secants(1)
      slopes(n) = secants(n - 1)
      do i = 2, n - 1
         slopes(i) = three_point_slope(widths(i - 1:i), secants(i - 1:i))
      end do
      entering = slopes
      do i = 1, n - 1
         entering(i) = slopes(i)
         if (secants(i) == 0.0_wp) then
            slopes(i:i + 1) = 0.0_wp
         else
            factor = 3.0_wp/hypot(slopes(i)/secants(i), slopes(i + 1)/secants(i))
            if (factor < 1.0_wp) slopes(i:i + 1) = factor*slopes(i:i + 1)
         end if
      end do
   end subroutine find_monotone_slopes

   !> Slope at a node from the secants of the intervals beside it, before the limits.
   pure real(wp) function three_point_slope(widths, secants) result(slope)
      real(wp), intent(in) :: widths(2), secants(2)

      slope = 0.0_wp
      if (have_other_signs(secants(1), secants(2))) return
      slope = (widths(2)*secants(1) + widths(1)*secants(2))/(widths(1) + widths(2))
   end function three_point_slope

   !> Derivatives of the slopes by value or node `i`: those of the secants beside it, of the three-point slopes, and of the
   !> limits, interval by interval as far as they reach. One-sided where a limit begins.
   pure subroutine monotone_cubic_find_change(self, i, is_of_node, change)
      class(monotone_cubic_t), intent(in) :: self
      integer, intent(in) :: i
      logical, intent(in) :: is_of_node
      type(cubic_change_t), intent(out) :: change
      real(wp) :: entered_change, next, next_change, secant, secant_change
      integer :: k, n

      n = size(self%nodes)
      change%i = i
      change%is_of_node = is_of_node
      change%first = max(1, i - 2)
      allocate (change%slopes(change%first:n), source=0.0_wp)
      call find_three_point_change(self, change, change%first, next, entered_change)
      do k = change%first, n - 1
         change%last = k
         call find_secant_change(self, change, k, secant, secant_change)
         call find_three_point_change(self, change, k + 1, next, next_change)
         call limit_changes(secant, secant_change, [self%entering(k), next], entered_change, next_change)
         change%slopes(k) = entered_change
         entered_change = next_change
         if (k > i + 1 .and. entered_change == 0.0_wp) exit
      end do
      if (k >= n) then
         change%last = n
         change%slopes(n) = entered_change
      end if
   end subroutine monotone_cubic_find_change

   !> The secant of interval `m` and its derivative by the number of a change.
   pure subroutine find_secant_change(self, change, m, secant, secant_change)
      class(monotone_cubic_t), intent(in) :: self
      type(cubic_change_t), intent(in) :: change
      integer, intent(in) :: m
      real(wp), intent(out) :: secant, secant_change
      real(wp) :: sign_of, width

      width = self%nodes(m + 1) - self%nodes(m)
      secant = (self%values(m + 1) - self%values(m))/width
      sign_of = merge(1.0_wp, 0.0_wp, m + 1 == change%i) - merge(1.0_wp, 0.0_wp, m == change%i)
      secant_change = sign_of/width
      if (change%is_of_node) secant_change = -sign_of*secant/width
   end subroutine find_secant_change

   !> The slope at node `m` before all limits and its derivative by the number of a change.
   pure subroutine find_three_point_change(self, change, m, slope, slope_change)
      class(monotone_cubic_t), intent(in) :: self
      type(cubic_change_t), intent(in) :: change
      integer, intent(in) :: m
      real(wp), intent(out) :: slope, slope_change
      real(wp) :: d(3), left, left_change, right, right_change
      integer :: k, n

      n = size(self%nodes)
      if (m == 1 .or. m == n) then
         call find_secant_change(self, change, min(m, n - 1), slope, slope_change)
         return
      end if
      call find_secant_change(self, change, m - 1, left, left_change)
      call find_secant_change(self, change, m, right, right_change)
      slope_change = 0.0_wp
      associate (x => self%nodes(m - 1:m + 1))
         slope = three_point_slope(x(2:) - x(:2), [left, right])
         if (have_other_signs(left, right)) return
         slope_change = ((x(3) - x(2))*left_change + (x(2) - x(1))*right_change)/(x(3) - x(1))
         if (.not. change%is_of_node) return
         d = [(merge(1.0_wp, 0.0_wp, m + k == change%i), k=-1, 1)]
         slope_change = slope_change + ((d(3) - d(2))*left + (d(2) - d(1))*right - (d(3) - d(1))*slope)/(x(3) - x(1))
      end associate
   end subroutine find_three_point_change

   !> Applies the derivative of the limit of an interval to those of the slopes at its ends.
   pure subroutine limit_changes(secant, secant_change, slopes, first_change, last_change)
      real(wp), intent(in) :: secant, secant_change
      real(wp), intent(in) :: slopes(2)                               !! before this limit
      real(wp), intent(inout) :: first_change, last_change            !! their derivatives
      real(wp) :: a, b, by_a, by_b, by_ratio, factor, radius

      if (secant == 0.0_wp) then
         first_change = 0.0_wp
         last_change = 0.0_wp
         return
      end if
      a = slopes(1)/secant
      b = slopes(2)/secant
      radius = hypot(a, b)
      factor = 3.0_wp/radius
      if (.not. factor < 1.0_wp) return
      by_a = (first_change - a*secant_change)/secant
      by_b = (last_change - b*secant_change)/secant
      by_ratio = -factor*(a*by_a + b*by_b)/radius**2
      first_change = factor*first_change + by_ratio*slopes(1)
      last_change = factor*last_change + by_ratio*slopes(2)
   end subroutine limit_changes

   !> Derivative of the value at `x` by the number of a change.
   pure real(wp) function monotone_cubic_change_at(self, change, x) result(by_number)
      class(monotone_cubic_t), intent(in) :: self
      type(cubic_change_t), intent(in) :: change
      real(wp), intent(in) :: x
      real(wp) :: a, b, by_node(2), by_slope(2), by_value(2), d, secant, t, width
      real(wp) :: by_secant, by_t, by_width
      integer :: i, n

      by_number = 0.0_wp
      n = size(self%nodes)
      if (x < self%nodes(max(change%first - 1, 1)) .and. change%first > 1) return
      if (x > self%nodes(min(change%last + 1, n)) .and. change%last < n) return
      i = interval_of(self%nodes, x)
      if (i == 0 .or. i == n) then
         i = max(i, 1)
         d = merge(1.0_wp, 0.0_wp, i == change%i)
         if (.not. change%is_of_node) by_number = d
         if (self%is_constant_beyond) return
         if (change%is_of_node) by_number = -d*self%slopes(i)
         by_number = by_number + slope_change(i)*(x - self%nodes(i))
         return
      end if
      by_node = 0.0_wp
      by_value = 0.0_wp
      if (change%i == i .or. change%i == i + 1) then
         if (change%is_of_node) by_node(change%i - i + 1) = 1.0_wp
         if (.not. change%is_of_node) by_value(change%i - i + 1) = 1.0_wp
      end if
      by_slope = [slope_change(i), slope_change(i + 1)]
      width = self%nodes(i + 1) - self%nodes(i)
      by_width = by_node(2) - by_node(1)
      t = (x - self%nodes(i))/width
      by_t = -(by_node(1) + t*by_width)/width
      secant = (self%values(i + 1) - self%values(i))/width
      by_secant = (by_value(2) - by_value(1) - secant*by_width)/width
      associate (s_1 => self%slopes(i), s_2 => self%slopes(i + 1))
         a = 3.0_wp*secant - 2.0_wp*s_1 - s_2
         b = s_1 + s_2 - 2.0_wp*secant
         by_number = by_value(1) + (by_width*t + width*by_t)*(s_1 + t*(a + t*b)) + &
                     width*t*(by_slope(1) + by_t*(a + 2.0_wp*t*b) + t*(3.0_wp*by_secant - 2.0_wp*by_slope(1) - by_slope(2)) + &
                              t**2*(by_slope(1) + by_slope(2) - 2.0_wp*by_secant))
      end associate

   contains

      pure real(wp) function slope_change(m)
         integer, intent(in) :: m

         slope_change = 0.0_wp
         if (m >= change%first .and. m <= change%last) slope_change = change%slopes(m)
      end function slope_change
   end function monotone_cubic_change_at

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
