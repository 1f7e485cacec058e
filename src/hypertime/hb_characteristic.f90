!> Steps along time on the torus: from slice to slice of one tone, with the phases of the others shifted by the ratio
!> of tones.
!>
!> A slice contains the samples with one phase of the leading tone; one step leads from each of its samples to the
!> next slice. Going back along d tau/dt = omega from a sample, the other phases fall between samples of the previous
!> slice: values there are interpolated by cubics, with weights that are the same everywhere (semi-Lagrangian scheme;
!> A. Staniforth and J. Cote, Monthly Weather Review 119 (1991) 2206-2223). Source: docs/why/theory.md, section 5.5.
module hb_characteristic
   use hb_kinds, only: two_pi, wp
   use hb_torus, only: fast_size, torus_t
   implicit none
   private
   public :: characteristic_t, new_characteristic, samples_along_time

   integer, parameter :: n_nodes = 4                                  ! of a cubic, at -1, 0, 1, 2
   real(wp), parameter :: longest_step = 2.0_wp                       ! of any tone in one step, in its samples

   type :: characteristic_t
      integer :: tone = 0                                             !! leading tone
      integer :: n_steps = 0                                          !! once around: slices of that tone, half of them on half
                                                                      !! a torus
      real(wp) :: closing = 1.0_wp                                    !! factor of the states as the last step closes the round:
                                                                      !! -1 on half a torus, whose motions are odd
      integer :: n_slice = 0                                          !! samples of a slice
      real(wp) :: step = 0.0_wp                                       !! time from slice to slice [s]
      integer, allocatable :: sample(:, :)                            !! (n_slice, n_steps) position among those of the torus
      integer, allocatable :: neighbour(:, :)                         !! (n_neighbours, n_slice) within the previous slice
      real(wp), allocatable :: weight(:)                              !! (n_neighbours), their sum is 1
      real(wp), allocatable, private :: omega(:)                      ! [rad/s], (n_tones)
      real(wp), allocatable, private :: offset(:)                     ! to the start of a step, in samples, (n_tones)
      real(wp), allocatable, private :: by_node(:, :)                 ! weights of one tone, (n_nodes, n_tones)
      integer, allocatable, private :: shift(:)                       ! of its node 0, in samples, (n_tones)
      integer, allocatable, private :: n_samples(:)                   ! in a slice: 1 of the leading tone, (n_tones)
   contains
      procedure :: frequency_slopes => characteristic_frequency_slopes
      procedure :: interpolate => characteristic_interpolate
      procedure :: work_of_round => characteristic_work_of_round
   end type characteristic_t

contains

   !> The leading tone has the longest step in which no tone advances by more than two samples: few interpolations,
   !> but the ends of a step still define the path in between well.
   subroutine new_characteristic(self, torus, omega, tone)
      type(characteristic_t), intent(out) :: self
      type(torus_t), intent(in) :: torus                              !! half a torus only with a single tone
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones), > 0
      integer, intent(in), optional :: tone                           !! leading tone, given by the caller
      integer :: i, inner, outer, p

      associate (speed => omega*torus%n_samples)
         self%tone = minloc(speed, mask=speed*longest_step >= maxval(speed), dim=1)
      end associate
      if (present(tone)) self%tone = tone
      self%n_steps = torus%n_samples(self%tone)
      self%step = two_pi/(omega(self%tone)*self%n_steps)
      if (torus%is_half) then
         self%n_steps = self%n_steps/2
         self%closing = -1.0_wp
      end if
      self%n_slice = torus%n_total/self%n_steps
      self%omega = omega
      inner = product(torus%n_samples(:self%tone - 1))
      outer = product(torus%n_samples(self%tone + 1:))
      allocate (self%sample(self%n_slice, self%n_steps))
      do i = 1, self%n_steps
         do p = 1, self%n_slice
            self%sample(p, i) = 1 + modulo(p - 1, inner) + inner*(i - 1 + self%n_steps*((p - 1)/inner))
         end do
      end do
      call lay_out_neighbours(self, torus, omega)
   end subroutine new_characteristic

   !> Samples of each tone, at least as many as given, with which steps along time lead from sample to sample, or
   !> nearly so: repeated interpolation then loses nothing of the transported states. The smallest such grid; the
   !> given one if that would have many more samples.
   pure function samples_along_time(least, omega) result(n_samples)
      integer, intent(in) :: least(:)                                 !! fast numbers, (n_tones)
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones), > 0
      integer :: n_samples(size(least))
      real(wp), parameter :: max_offset = 0.02_wp                     ! of an offset, from a whole number of samples
      real(wp), parameter :: max_more = 2.0_wp                       ! samples
      real(wp) :: fewest, ideal
      integer :: best(size(least)), lead, m, n, steps

      n_samples = least
      if (size(least) == 1) return
      fewest = max_more*product(real(least, wp))
      do lead = 1, size(least)
         n = least(lead)
         do while (n <= max_more*least(lead))
            best = huge(1)
            best(lead) = n
            do m = 1, size(least)
               if (m == lead) cycle
               do steps = 1, int(longest_step)
                  ideal = steps*n*omega(lead)/omega(m)
                  associate (nearest => fast_size(max(least(m), ceiling(ideal*(1.0_wp - max_offset)))))
                     if (nearest <= ideal*merge(1.0_wp, 1.0_wp + max_offset, steps == int(longest_step))) &
                        best(m) = min(best(m), nearest)
                  end associate
               end do
            end do
            if (product(real(best, wp)) < fewest) then
               n_samples = best
               fewest = product(real(best, wp))
            end if
            n = fast_size(n + 1)
         end do
      end do
   end function samples_along_time

   !> Sets up the tensor product of one cubic per other tone.
   subroutine lay_out_neighbours(self, torus, omega)
      type(characteristic_t), intent(inout) :: self
      type(torus_t), intent(in) :: torus
      real(wp), intent(in) :: omega(:)
      integer :: m, n_neighbours, node, other, p, q, quotient

      other = size(omega) - 1
      n_neighbours = n_nodes**other
      allocate (self%neighbour(n_neighbours, self%n_slice), self%weight(n_neighbours), self%offset(size(omega)))
      allocate (self%by_node(n_nodes, size(omega)), self%shift(size(omega)))
      self%n_samples = torus%n_samples
      self%n_samples(self%tone) = 1
      do m = 1, size(omega)
         associate (offset => self%offset(m))
            offset = -omega(m)*self%step*torus%n_samples(m)/two_pi
            if (abs(offset - anint(offset)) < 8*epsilon(1.0_wp)*max(1.0_wp, abs(offset))) offset = anint(offset)
            self%shift(m) = floor(offset)
            self%by_node(:, m) = cubic_weights(offset - self%shift(m))
         end associate
      end do
      self%weight = product_of(self%by_node, self%tone)
      do p = 1, self%n_slice
         do q = 1, n_neighbours
            quotient = q - 1
            self%neighbour(q, p) = 1
            call visit_tones()
         end do
      end do

   contains

      subroutine visit_tones()
         integer :: at, inner, n

         inner = 1
         do m = 1, size(omega)
            if (m == self%tone) cycle
            n = torus%n_samples(m)
            node = modulo(quotient, n_nodes)
            quotient = quotient/n_nodes
            at = modulo((p - 1)/inner, n)
            at = modulo(at + self%shift(m) + node - 1, n)
            self%neighbour(q, p) = self%neighbour(q, p) + inner*at
            inner = inner*n
         end do
      end subroutine visit_tones
   end subroutine lay_out_neighbours

   !> Weights of all neighbours: products of those of one node per tone except the leading one, first tones fastest.
   pure function product_of(by_node, leading) result(weight)
      real(wp), intent(in) :: by_node(:, :)                           !! (n_nodes, n_tones)
      integer, intent(in) :: leading
      real(wp) :: weight(n_nodes**(size(by_node, 2) - 1))
      integer :: m, q, quotient

      do q = 1, size(weight)
         quotient = q - 1
         weight(q) = 1.0_wp
         do m = 1, size(by_node, 2)
            if (m == leading) cycle
            weight(q) = weight(q)*by_node(1 + modulo(quotient, n_nodes), m)
            quotient = quotient/n_nodes
         end do
      end do
   end function product_of

   !> Derivatives of step and weights with respect to base frequency m, with the leading tone and the neighbours held
   !> constant. If an offset ends exactly on a sample, the neighbours change there too, and this is the derivative for
   !> a smaller offset.
   pure subroutine characteristic_frequency_slopes(self, m, step_slope, weight_slope)
      class(characteristic_t), intent(in) :: self
      integer, intent(in) :: m                                        !! tone
      real(wp), intent(out) :: step_slope                             !! [s**2]
      real(wp), intent(out) :: weight_slope(:)                        !! [s], (n_neighbours)
      real(wp) :: by_node(n_nodes, size(self%omega)), offset_slope
      integer :: k, other

      step_slope = 0.0_wp
      if (m == self%tone) step_slope = -self%step/self%omega(m)
      weight_slope = 0.0_wp
      do k = 1, size(self%omega)
         if (k == self%tone .or. (k /= m .and. m /= self%tone)) cycle
         offset_slope = self%offset(k)/self%omega(m)                   ! offset_k is proportional to omega_k/omega_leading
         if (m == self%tone) offset_slope = -offset_slope
         do other = 1, size(self%omega)
            by_node(:, other) = cubic_weights(self%offset(other) - floor(self%offset(other)))
         end do
         by_node(:, k) = offset_slope*cubic_slopes(self%offset(k) - floor(self%offset(k)))
         weight_slope = weight_slope + product_of(by_node, self%tone)
      end do
   end subroutine characteristic_frequency_slopes

   !> Derivatives of `cubic_weights` by x.
   pure function cubic_slopes(x) result(slopes)
      real(wp), intent(in) :: x
      real(wp) :: slopes(n_nodes)

      slopes = [-(3*x**2 - 6*x + 2.0_wp)/6.0_wp, (3*x**2 - 4*x - 1.0_wp)/2.0_wp, -(3*x**2 - 2*x - 2.0_wp)/2.0_wp, &
                (3*x**2 - 1.0_wp)/6.0_wp]
   end function cubic_slopes

   !> Weights of the cubic through nodes at -1, 0, 1, 2 for its value at x between 0 and 1.
   pure function cubic_weights(x) result(weights)
      real(wp), intent(in) :: x
      real(wp) :: weights(n_nodes)

      weights = [-x*(x - 1.0_wp)*(x - 2.0_wp)/6.0_wp, (x + 1.0_wp)*(x - 1.0_wp)*(x - 2.0_wp)/2.0_wp, &
                 -(x + 1.0_wp)*x*(x - 2.0_wp)/2.0_wp, (x + 1.0_wp)*x*(x - 1.0_wp)/6.0_wp]
   end function cubic_weights

   !> Work of one round with an interpolation and a step of values at each sample, see hb_solver_types%unit_of_work.
   pure real(wp) function characteristic_work_of_round(self, n_values, per_value, per_neighbour) result(work)
      class(characteristic_t), intent(in) :: self
      integer, intent(in) :: n_values                                 !! at each sample
      real(wp), intent(in) :: per_value, per_neighbour                !! of one value: its step, and each value it is made of

      work = real(n_values, wp)*self%n_slice*self%n_steps*(per_value + per_neighbour*size(self%weight))
   end function characteristic_work_of_round

   !> Values at the starts of all steps that end in a slice, from those on the previous slice: tone by tone.
   pure subroutine characteristic_interpolate(self, before, values)
      class(characteristic_t), intent(in) :: self
      real(wp), intent(in) :: before(:, :)                            !! (n_slice, any)
      real(wp), intent(out) :: values(:, :)                           !! as before
      real(wp) :: between(self%n_slice)
      integer :: c, inner, m

      do c = 1, size(before, 2)
         values(:, c) = before(:, c)
         inner = 1
         do m = 1, size(self%n_samples)
            associate (n => self%n_samples(m))
               if (n == 1) cycle
               between = values(:, c)
               call interpolate_along(inner, n, self%shift(m), self%by_node(:, m), between, values(:, c))
               inner = inner*n
            end associate
         end do
      end do
   end subroutine characteristic_interpolate

   !> Interpolation along one tone, of `inner` values at each of its samples.
   pure subroutine interpolate_along(inner, n, shift, weights, before, values)
      integer, intent(in) :: inner, n, shift
      real(wp), intent(in) :: weights(n_nodes), before(:)
      real(wp), intent(out) :: values(:)
      real(wp) :: line(inner*(n + n_nodes - 1))
      integer :: at, first, i, n_line

      n_line = inner*n
      first = inner*modulo(shift - 1, n)
      do at = 0, size(before) - n_line, n_line
         line(:n_line - first) = before(at + first + 1:at + n_line)
         do i = n_line - first + 1, size(line), n_line                  ! a short line ends more than once
            associate (last => min(size(line), i + n_line - 1))
               line(i:last) = before(at + 1:at + last - i + 1)
            end associate
         end do
         values(at + 1:at + n_line) = weights(1)*line(:n_line) + weights(2)*line(inner + 1:inner + n_line) &
                                              + weights(3)*line(2*inner + 1:2*inner + n_line) &
                                              + weights(4)*line(3*inner + 1:)
      end do
   end subroutine interpolate_along
end module hb_characteristic
