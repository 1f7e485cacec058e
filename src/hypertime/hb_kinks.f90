!> What sampling misses of a function whose slope jumps between two samples, and how that depends on the samples.
!>
!> A mean over samples of a function of z, smooth but for a jump k of its slope at z = p, is off by terms that depend on where
!> between two samples z passes p (Euler and Maclaurin's sum with its ends there). Along each line of the grid z - p is the cubic
!> through its values at two neighbours and the central differences there; a root at s in [0, 1] between them, with the cubic's
!> derivatives z', z'', z''' and sigma = 1 where z rises, adds (1 - s) A - M to the sample before and s A + M to the one after,
!>
!>    A = k sigma (z' b2/2 - z'' b3/6 + z''' b4/24),   M = k sigma (-z' b3/3 + z'' b4/8),
!>    b1 = s - 1/2, b2 = s**2 - s + 1/6, b3 = s (s - 1/2) (s - 1), b4 = s**2 (1 - s)**2.
!>
!> M is what the sum misses of the slope of the wave that the function is multiplied by. b4 leaves out a constant, so that nothing
!> jumps as a root passes a sample. As two roots merge, their terms cancel: a touch leaves no trace. In several tones each line has
!> the share w_m = d_m**2/sum d_n**2 of the sample that it adds to, with d_n half the difference of the neighbours along tone n.
!> Source: docs/why/theory.md, section 5.7.
module hb_kinks
   use hb_kinds, only: wp
   use hb_torus, only: torus_t
   implicit none
   private
   public :: kink_grid_t, kink_slopes_t, new_kink_grid

   integer, parameter :: max_tones = 24                              ! of a grid of at least three samples each
   integer, parameter :: before = 1, left = 2, right = 3, beyond = 4  ! samples around a cell, from left to right

   !> Derivatives of the corrections with respect to the sample itself and its neighbours.
   type :: kink_slopes_t
      integer :: n = 0                                                !! samples with corrections, in use of the arrays
      integer, allocatable :: row(:)                                  !! the sample, (any)
      integer, allocatable :: column(:, :)                            !! index of a neighbour, negative if it counts with the
                                                                      !! opposite sign; (0:n_parts, any), 0 the sample itself,
                                                                      !! others as `shift`
      real(wp), allocatable :: value(:, :)                            !! slope [N/m], as column; without the sign
      integer, allocatable, private :: position(:)                    ! of each sample in the arrays, 0: none; (n_samples)
   contains
      procedure :: forget => kink_slopes_forget
      procedure, private :: find => kink_slopes_find
   end type kink_slopes_t

   !> The neighbours on a grid.
   type :: kink_grid_t
      integer :: n_parts = 0 !! neighbours on which a correction depends, without the sample itself
      integer, allocatable, private :: n(:)                           ! (n_tones) stored samples
      integer, allocatable, private :: whole(:)                       ! (n_tones) samples of the whole torus
      integer, allocatable, private :: stride(:)                      ! (n_tones)
      logical, private :: is_half = .false.
      integer, allocatable, private :: mirror(:)                      ! samples of lower tones half a period later, on half a grid
      real(wp), allocatable, private :: line(:), beside(:, :)         ! samples with their continuation beyond the ends
   contains
      procedure :: correct => kink_grid_correct
      procedure :: shift => kink_grid_shift
      procedure, private :: position => kink_grid_place
      procedure, private :: neighbour => kink_grid_neighbour
      procedure, private :: add_cell => kink_grid_add_cell
      procedure, private :: find_share => kink_grid_find_share
   end type kink_grid_t

   !> A sample near another one, and its sign.
   type :: neighbour_t
      integer :: sample
      real(wp) :: sign
   end type neighbour_t

contains

   !> Prepares the corrections of functions on a grid; on half a grid they change their sign half a period later.
   pure subroutine new_kink_grid(self, torus)
      type(kink_grid_t), intent(out) :: self
      type(torus_t), intent(in) :: torus
      integer :: d, i, m

      d = size(torus%n_samples)
      self%whole = torus%n_samples
      self%n = torus%n_samples
      self%is_half = torus%is_half
      if (self%is_half) self%n(d) = self%n(d)/2
      self%stride = [(product(self%n(:m - 1)), m=1, d)]
      self%n_parts = 4*d
      allocate (self%line(-1:self%n(1) + 1), self%beside(self%stride(d), before:beyond))
      if (self%is_half) self%mirror = [(mirrored(i), i=1, self%stride(d))]

   contains

      !> The sample of the lower tones half a period after sample i.
      pure integer function mirrored(i)
         integer, intent(in) :: i
         integer :: k

         mirrored = 1
         do k = 1, d - 1
            mirrored = mirrored + self%stride(k)*modulo((i - 1)/self%stride(k) + self%whole(k)/2, self%n(k))
         end do
      end function mirrored
   end subroutine new_kink_grid

   !> Steps (n_tones) along the grid from a sample to its neighbour number `part`.
   pure function kink_grid_shift(self, part) result(steps)
      class(kink_grid_t), intent(in) :: self
      integer, intent(in) :: part                                     !! 1 to n_parts
      integer :: steps(size(self%n))
      integer, parameter :: offsets_along(4) = [-2, -1, 1, 2]

      steps = 0
      steps(1 + (part - 1)/4) = offsets_along(1 + modulo(part - 1, 4))
   end function kink_grid_shift

   !> Adds the sampling errors of a function of z to its samples f, and their derivatives with respect to the samples
   !> of z.
   subroutine kink_grid_correct(self, z, positions, jumps, f, slopes)
      class(kink_grid_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: z(:)                        !! [m], (n_samples)
      real(wp), intent(in) :: positions(:)                            !! positions of the jumps of the slope [m]
      real(wp), intent(in) :: jumps(:)                                !! their sizes, as z rises [N/m], as positions
      real(wp), intent(inout), contiguous :: f(:)                     !! [N], (n_samples)
      type(kink_slopes_t), intent(inout), optional :: slopes          !! are added to
      type(neighbour_t) :: there
      integer :: first, j, k, m, slab

      associate (n => self%n)
         do first = 1, size(z), n(1)                                  ! along the first tone a line is contiguous
            self%line(0:n(1) - 1) = z(first:first + n(1) - 1)
            do j = -1, n(1) + 1
               if (j >= 0 .and. j < n(1)) cycle
               there = self%neighbour(first, 0, 1, j)
               self%line(j) = there%sign*z(there%sample)
            end do
            call scan(1, first, self%line(-1:n(1) - 2), self%line(0:n(1) - 1), self%line(1:n(1)), self%line(2:n(1) + 1))
         end do
         do m = 2, size(n)                                            ! along others the neighbours of a whole slab are contiguous
            slab = self%stride(m)
            do first = 1, size(z), slab*n(m)
               do j = 0, n(m) - 1
                  associate (at => first + j*slab)
                     if (j > 0 .and. j < n(m) - 2) then
                        call scan(m, at, z(at - slab:at - 1), z(at:at + slab - 1), z(at + slab:at + 2*slab - 1), &
                                       z(at + 2*slab:at + 3*slab - 1))
                     else
                        do k = before, beyond
                           call fetch_slab(self, z, first, m, j + k - left, self%beside(:slab, k))
                        end do
                        call scan(m, at, self%beside(:slab, before), self%beside(:slab, left), self%beside(:slab, right), &
                                       self%beside(:slab, beyond))
                     end if
                  end associate
               end do
            end do
         end do
      end associate

   contains

      !> Searches for kinks between samples and their successors along tone m.
      subroutine scan(m, first, a, b, c, d)
         integer, intent(in) :: m
         integer, intent(in) :: first                                    !! index of the sample b(1)
         real(wp), intent(in), contiguous :: a(:), b(:), c(:), d(:)      !! samples before, at, after and beyond each cell
         integer, parameter :: block_size = 64                           ! cells examined at once
         real(wp) :: distance(block_size)
         integer :: first_cell, i, k, n

         do k = 1, size(positions)
            do first_cell = 0, size(b) - 1, block_size
               n = min(block_size, size(b) - first_cell)
               associate (from => first_cell + 1)
                  call find_distances(n, a(from:), b(from:), c(from:), d(from:), positions(k), distance)
               end associate
               do i = 1, n
                  if (.not. distance(i) <= 0.0_wp) cycle
                  associate (at => first_cell + i)
                     call self%add_cell(m, first + at - 1, [a(at), b(at), c(at), d(at)] - positions(k), jumps(k), z, f, slopes)
                  end associate
               end do
            end do
         end do
      end subroutine scan
   end subroutine kink_grid_correct

   !> Slab number j of tone m, continued beyond both ends.
   pure subroutine fetch_slab(self, z, first, m, j, values)
      class(kink_grid_t), intent(in) :: self
      real(wp), intent(in) :: z(:)                                    !! [m], (n_samples)
      integer, intent(in) :: first, m, j
      real(wp), intent(out) :: values(:)

      associate (at => first + modulo(j, self%n(m))*self%stride(m))
         if (self%is_half .and. m == size(self%n) .and. modulo(turns(j, self%n(m)), 2) == 1) then
            values = -z(at - 1 + self%mirror)
         else
            values = z(at:at + self%stride(m) - 1)
         end if
      end associate
   end subroutine fetch_slab

   !> Number of complete rounds of n positions in j.
   elemental integer function turns(j, n)
      integer, intent(in) :: j, n

      turns = (j - modulo(j, n))/n
   end function turns

   !> Indices of a sample along the tones, from 0; integer divisions take longer than all neighbour lookups.
   pure subroutine kink_grid_place(self, sample, from)
      class(kink_grid_t), intent(in) :: self
      integer, intent(in) :: sample
      integer, intent(out) :: from(max_tones)                        !! (n_tones) of them
      integer :: left_over, m

      left_over = sample - 1
      do m = size(self%n), 2, -1
         from(m) = left_over/self%stride(m)
         left_over = left_over - from(m)*self%stride(m)
      end do
      from(1) = left_over
   end subroutine kink_grid_place

   !> The sample `steps` along tone m from a given one.
   pure type(neighbour_t) function kink_grid_neighbour(self, sample, from, m, steps) result(there)
      class(kink_grid_t), intent(in) :: self
      integer, intent(in) :: sample
      integer, intent(in) :: from                                     !! its index along tone m, see `position`
      integer, intent(in) :: m
      integer, intent(in) :: steps
      integer :: j, lower

      associate (stride => self%stride(m), n => self%n(m))
         there%sign = 1.0_wp
         j = from + steps
         there%sample = sample + steps*stride
         if (j >= 0 .and. j < n) return
         there%sample = sample + (modulo(j, n) - from)*stride
         if (.not. self%is_half .or. m < size(self%n)) return
         if (modulo(turns(j, n), 2) == 0) return
         there%sign = -1.0_wp
         lower = modulo(sample - 1, stride)
         there%sample = there%sample + self%mirror(lower + 1) - lower - 1
      end associate
   end function kink_grid_neighbour

   !> Computes the distance of a position from the range of the cubics of cells. Not positive: it is between their
   !> ends, or as near as a cubic can be to its chord.
   pure subroutine find_distances(n, a, b, c, d, position, distance)
      integer, intent(in) :: n                                        !! cells
      real(wp), intent(in) :: a(n), b(n), c(n), d(n)                  !! values before, at, after and beyond each cell [m]
      real(wp), intent(in) :: position                                !! [m]
      real(wp), intent(out) :: distance(n)                            !! [m]
      real(wp), parameter :: max_overshoot_ratio = 2.0_wp/27.0_wp
      real(wp) :: at_left, at_right
      integer :: i

      do i = 1, n                                                     ! without a branch: vectorised
         at_left = b(i) - position
         at_right = c(i) - position
         distance(i) = max(min(at_left, at_right), -max(at_left, at_right)) &
                       - max_overshoot_ratio*(abs(a(i) - 2.0_wp*b(i) + c(i)) + abs(b(i) - 2.0_wp*c(i) + d(i)))
      end do
   end subroutine find_distances

   !> Adds the corrections of the roots between a sample and its successor along tone m, if there are any.
   subroutine kink_grid_add_cell(self, m, sample, values, jump, z, f, slopes)
      class(kink_grid_t), intent(in) :: self
      integer, intent(in) :: m
      integer, intent(in) :: sample
      real(wp), intent(in) :: values(before:beyond)                   !! of z minus the position [m]
      real(wp), intent(in) :: jump                                    !! [N/m]
      real(wp), intent(in), contiguous :: z(:)
      real(wp), intent(inout), contiguous :: f(:)
      type(kink_slopes_t), intent(inout), optional :: slopes
      real(wp) :: added(left:right), by_values(before:beyond, left:right), share, share_slopes(max_tones)
      type(neighbour_t) :: around(before:beyond), beside(-1:1, max_tones)
      logical :: has_kink
      integer :: at, from(max_tones), k, row, tone

      call correct_cell(values, jump, present(slopes), added, by_values, has_kink)
      if (.not. has_kink) return
      call self%position(sample, from)
      do k = before, beyond
         around(k) = self%neighbour(sample, from(m), m, k - left)
      end do
      do row = left, right
         share = 1.0_wp
         if (size(self%n) > 1) then
            if (row == right) call self%position(around(row)%sample, from)
            call self%find_share(m, around(row)%sample, from, z, share, share_slopes, beside)
         end if
         associate (here => around(row))
            f(here%sample) = f(here%sample) + here%sign*share*added(row)
            if (.not. present(slopes)) cycle
            call slopes%find(here%sample, self%n_parts, size(z), at)
            do k = before, beyond
               call add(part_of(m, k - row), around(k)%sample, here%sign*around(k)%sign, share*by_values(k, row))
            end do
            if (size(self%n) == 1) cycle
            do tone = 1, size(self%n)                                 ! the argument of the weight changes its sign with `added`
               do k = -1, 1, 2
                  call add(part_of(tone, k), beside(k, tone)%sample, beside(k, tone)%sign, &
                           0.5_wp*k*here%sign*added(row)*share_slopes(tone))
               end do
            end do
         end associate
      end do

   contains

      subroutine add(part, column, sign, value)
         integer, intent(in) :: part, column
         real(wp), intent(in) :: sign, value

         slopes%column(part, at) = merge(column, -column, sign > 0.0_wp)
         slopes%value(part, at) = slopes%value(part, at) + value
      end subroutine add
   end subroutine kink_grid_add_cell

   !> Number of the neighbour `steps` along tone m; see `shift`.
   pure integer function part_of(m, steps)
      integer, intent(in) :: m, steps

      part_of = 0
      if (steps < 0) part_of = 4*(m - 1) + 3 + steps
      if (steps > 0) part_of = 4*(m - 1) + 2 + steps
   end function part_of

   !> Weight of tone m in the corrections at a sample, and its derivatives with respect to half the differences of
   !> neighbours, 1 for each tone.
   pure subroutine kink_grid_find_share(self, m, sample, from, z, share, slopes, beside)
      class(kink_grid_t), intent(in) :: self
      integer, intent(in) :: m, sample
      integer, intent(in) :: from(max_tones)                         !! see `position`
      real(wp), intent(in) :: z(:)
      real(wp), intent(out) :: share
      real(wp), intent(out) :: slopes(max_tones)                     !! [1/m], (n_tones) of them
      type(neighbour_t), intent(out) :: beside(-1:1, max_tones)      !! before and after the sample along each tone
      real(wp) :: rates(max_tones), largest, total
      integer :: tone

      do tone = 1, size(self%n)
         associate (next => beside(1, tone), previous => beside(-1, tone))
            next = self%neighbour(sample, from(tone), tone, 1)
            previous = self%neighbour(sample, from(tone), tone, -1)
            rates(tone) = 0.5_wp*(next%sign*z(next%sample) - previous%sign*z(previous%sample))
         end associate
      end do
      associate (d => size(self%n))
         largest = maxval(abs(rates(:d)))
         share = 1.0_wp/d
         slopes(:d) = 0.0_wp
         if (.not. largest > 0.0_wp) return
         rates(:d) = rates(:d)/largest
         total = sum(rates(:d)**2)
         share = rates(m)**2/total
         slopes(:d) = -2.0_wp*share*rates(:d)
         slopes(m) = slopes(m) + 2.0_wp*rates(m)
         slopes(:d) = slopes(:d)/(total*largest)
      end associate
   end subroutine kink_grid_find_share

   !> Corrections of the roots of the cubic in one cell, with their derivatives by the four values; see the header of
   !> this module.
   pure subroutine correct_cell(values, jump, with_slopes, added, by_values, has_kink)
      real(wp), intent(in) :: values(before:beyond), jump
      logical, intent(in) :: with_slopes                              !! otherwise these are not computed
      real(wp), intent(out) :: added(left:right)
      real(wp), intent(out) :: by_values(before:beyond, left:right)
      logical, intent(out) :: has_kink
      real(wp) :: cubic(0:3), roots(3)
      logical :: rises(3)
      integer :: i, n_roots

      cubic(0) = values(left)
      cubic(1) = 0.5_wp*(values(right) - values(before))
      cubic(2) = values(before) - 2.5_wp*values(left) + 2.0_wp*values(right) - 0.5_wp*values(beyond)
      cubic(3) = 0.5_wp*(values(beyond) - values(before)) + 1.5_wp*(values(left) - values(right))
      call find_roots(cubic, values(right), roots, rises, n_roots)
      has_kink = n_roots > 0
      added = 0.0_wp
      by_values = 0.0_wp
      do i = 1, n_roots
         call add_root(cubic, roots(i), merge(jump, -jump, rises(i)), with_slopes, added, by_values)
      end do
   end subroutine correct_cell

   !> Adds one root. If the motion changes by psi, the root by -psi/z', A changes by k sigma (psi' b2/2 - psi'' b3/6 +
   !> psi''' b4/24 - psi b1), and M + A s by s times that and k sigma (-psi' b3/3 + psi'' b4/8 + psi (b2/2 - z'''
   !> b4/(6 z'))).
   pure subroutine add_root(cubic, s, strength, with_slopes, added, by_values)
      real(wp), intent(in) :: cubic(0:3), s
      real(wp), intent(in) :: strength                                !! k sigma [N/m]
      logical, intent(in) :: with_slopes
      real(wp), intent(inout) :: added(left:right), by_values(before:beyond, left:right)
      real(wp), dimension(before:beyond) :: psi, psi_1, psi_2, psi_3, slope, moment_slope
      real(wp) :: b1, b2, b3, b4, moment, total, z_1, z_2, z_3

      z_1 = cubic(1) + s*(2.0_wp*cubic(2) + s*3.0_wp*cubic(3))
      z_2 = 2.0_wp*cubic(2) + 6.0_wp*s*cubic(3)
      z_3 = 6.0_wp*cubic(3)
      b1 = s - 0.5_wp
      b2 = s*(s - 1.0_wp) + 1.0_wp/6.0_wp
      b3 = s*(s - 0.5_wp)*(s - 1.0_wp)
      b4 = (s*(1.0_wp - s))**2
      total = strength*(z_1*b2/2.0_wp - z_2*b3/6.0_wp + z_3*b4/24.0_wp)
      moment = strength*(-z_1*b3/3.0_wp + z_2*b4/8.0_wp)
      added(left) = added(left) + (1.0_wp - s)*total - moment
      added(right) = added(right) + s*total + moment
      if (.not. with_slopes) return

      psi = [-0.5_wp*s + s**2 - 0.5_wp*s**3, 1.0_wp - 2.5_wp*s**2 + 1.5_wp*s**3, &
             0.5_wp*s + 2.0_wp*s**2 - 1.5_wp*s**3, 0.5_wp*(s**3 - s**2)]
      psi_1 = [-0.5_wp + 2.0_wp*s - 1.5_wp*s**2, -5.0_wp*s + 4.5_wp*s**2, 0.5_wp + 4.0_wp*s - 4.5_wp*s**2, 1.5_wp*s**2 - s]
      psi_2 = [2.0_wp - 3.0_wp*s, -5.0_wp + 9.0_wp*s, 4.0_wp - 9.0_wp*s, 3.0_wp*s - 1.0_wp]
      psi_3 = [-3.0_wp, 9.0_wp, -9.0_wp, 3.0_wp]
      slope = strength*(psi_1*b2/2.0_wp - psi_2*b3/6.0_wp + psi_3*b4/24.0_wp - psi*b1)
      moment_slope = strength*(-psi_1*b3/3.0_wp + psi_2*b4/8.0_wp + psi*b2/2.0_wp)
      if (abs(z_1) > 0.0_wp) moment_slope = moment_slope - strength*psi*(z_3/z_1)*b4/6.0_wp
      by_values(:, left) = by_values(:, left) + (1.0_wp - s)*slope - moment_slope
      by_values(:, right) = by_values(:, right) + s*slope + moment_slope
   end subroutine add_root

   !> Roots of a cubic in [0, 1] at which it changes its sign; zero counts as not positive.
   pure subroutine find_roots(cubic, at_one, roots, rises, n_roots)
      real(wp), intent(in) :: cubic(0:3)
      real(wp), intent(in) :: at_one                                  !! its value at 1
      real(wp), intent(out) :: roots(3)
      logical, intent(out) :: rises(3)
      integer, intent(out) :: n_roots
      real(wp) :: ends(0:3), values(0:3), extrema(2)
      integer :: i, n

      call find_extrema(cubic, extrema)
      n = 0
      ends(0) = 0.0_wp
      values(0) = cubic(0)
      do i = 1, 2
         if (.not. (extrema(i) > ends(n) .and. extrema(i) < 1.0_wp)) cycle
         n = n + 1
         ends(n) = extrema(i)
         values(n) = value_of(cubic, extrema(i))
      end do
      n = n + 1
      ends(n) = 1.0_wp
      values(n) = at_one
      n_roots = 0
      do i = 1, n
         if ((values(i - 1) > 0.0_wp) .eqv. (values(i) > 0.0_wp)) cycle
         n_roots = n_roots + 1
         rises(n_roots) = values(i) > 0.0_wp
         roots(n_roots) = root_between(cubic, ends(i - 1), ends(i), values(i - 1), values(i))
      end do
   end subroutine find_roots

   pure real(wp) function value_of(cubic, s)
      real(wp), intent(in) :: cubic(0:3), s

      value_of = cubic(0) + s*(cubic(1) + s*(cubic(2) + s*cubic(3)))
   end function value_of

   !> Zeros of the slope of a cubic, ascending; -1 if there are none.
   pure subroutine find_extrema(cubic, extrema)
      real(wp), intent(in) :: cubic(0:3)
      real(wp), intent(out) :: extrema(2)
      real(wp) :: a, b, c, largest, root, x

      extrema = -1.0_wp
      largest = maxval(abs(cubic(1:)))
      if (.not. largest > 0.0_wp) return
      a = 3.0_wp*cubic(3)/largest
      b = cubic(2)/largest
      c = cubic(1)/largest
      root = b**2 - a*c
      if (root < 0.0_wp) return
      x = -(b + sign(sqrt(root), b))
      if (abs(x) > abs(c)) extrema(1) = c/x                           ! only those within the cell are of interest
      if (abs(a) > abs(x)) extrema(2) = x/a
      extrema = [minval(extrema), maxval(extrema)]
   end subroutine find_extrema

   !> Root of a cubic between two positions of different signs without an extremum in between: Newton steps, bisection
   !> if these leave the bracket.
   pure real(wp) function root_between(cubic, from, to, at_from, at_to) result(s)
      real(wp), intent(in) :: cubic(0:3), from, to, at_from, at_to
      integer, parameter :: max_steps = 100
      real(wp) :: high, low, next, slope, value
      integer :: i

      low = from
      high = to
      s = low + (high - low)*(at_from/(at_from - at_to))
      do i = 1, max_steps
         value = value_of(cubic, s)
         if ((value > 0.0_wp) .eqv. (at_from > 0.0_wp)) then
            low = s
         else
            high = s
         end if
         slope = cubic(1) + s*(2.0_wp*cubic(2) + s*3.0_wp*cubic(3))
         next = 0.5_wp*(low + high)
         if (abs(value) < abs(slope)) then
            if (s - value/slope >= low .and. s - value/slope <= high) next = s - value/slope
         end if
         if (abs(next - s) <= epsilon(s)) return
         s = next
      end do
   end function root_between

   !> Discards all entries.
   pure subroutine kink_slopes_forget(self)
      class(kink_slopes_t), intent(inout) :: self

      if (self%n > 0) self%position(self%row(:self%n)) = 0
      self%n = 0
   end subroutine kink_slopes_forget

   !> Position of a sample in the arrays; a new one starts with zero slopes.
   pure subroutine kink_slopes_find(self, row, n_parts, n_samples, position)
      class(kink_slopes_t), intent(inout) :: self
      integer, intent(in) :: row, n_parts
      integer, intent(in) :: n_samples                                !! the same each time
      integer, intent(out) :: position
      integer, parameter :: first_size = 256
      integer, allocatable :: column(:, :)
      real(wp), allocatable :: value(:, :)

      if (.not. allocated(self%row)) then
         allocate (self%row(first_size), self%column(0:n_parts, first_size), self%value(0:n_parts, first_size))
         allocate (self%position(n_samples), source=0)
      end if
      position = self%position(row)
      if (position > 0) return
      if (self%n == size(self%row)) then
         allocate (column(0:n_parts, 2*self%n), value(0:n_parts, 2*self%n))
         column(:, :self%n) = self%column
         value(:, :self%n) = self%value
         call move_alloc(column, self%column)
         call move_alloc(value, self%value)
         self%row = [self%row, self%row]
      end if
      self%n = self%n + 1
      position = self%n
      self%position(row) = position
      self%row(position) = row
      self%column(:, position) = row
      self%value(:, position) = 0.0_wp
   end subroutine kink_slopes_find
end module hb_kinks
