!> Steps along time on the torus: from slice to slice of one tone, the phases of the others shifted by the ratio of tones.
!>
!> A slice holds the samples with one phase of the tone that leads; one step leads from each of its samples to the next
!> slice. Going back along d tau/dt = omega from a sample, the other phases fall between samples of the slice before: what
!> is known there is interpolated by cubics, with weights that are the same everywhere (semi-Lagrangian scheme; A. Staniforth
!> and J. Cote, Monthly Weather Review 119 (1991) 2206-2223). Source: docs/theory.md, section 5.5.
module hb_characteristic
   use hb_kinds, only: two_pi, wp
   use hb_torus, only: torus_t
   implicit none
   private
   public :: characteristic_t, new_characteristic

   integer, parameter :: n_nodes = 4                                  ! of a cubic, at -1, 0, 1, 2
   real(wp), parameter :: longest_way = 2.0_wp                        ! of any tone in one step, in its samples

   type :: characteristic_t
      integer :: tone = 0                                             !! that leads
      integer :: n_steps = 0                                          !! once around: slices of that tone
      integer :: n_slice = 0                                          !! samples of a slice
      real(wp) :: step = 0.0_wp                                       !! time from slice to slice [s]
      integer, allocatable :: sample(:, :)                            !! (n_slice, n_steps) place among those of the torus
      integer, allocatable :: neighbour(:, :)                         !! (n_neighbours, n_slice) within the slice before
      real(wp), allocatable :: weight(:)                              !! (n_neighbours), their sum is 1
   contains
      procedure :: interpolate => characteristic_interpolate
   end type characteristic_t

contains

   !> The tone that leads has the longest step in which no tone moves on by more than two samples: few interpolations, yet a
   !> path between the ends of a step that they tell well.
   subroutine new_characteristic(self, torus, omega)
      type(characteristic_t), intent(out) :: self
      type(torus_t), intent(in) :: torus
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones), > 0
      integer :: i, inner, outer, p

      associate (speed => omega*torus%n_samples)
         self%tone = minloc(speed, mask=speed*longest_way >= maxval(speed), dim=1)
      end associate
      self%n_steps = torus%n_samples(self%tone)
      self%n_slice = torus%n_total/self%n_steps
      self%step = two_pi/(omega(self%tone)*self%n_steps)
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

   !> Tensor product of one cubic per other tone.
   subroutine lay_out_neighbours(self, torus, omega)
      type(characteristic_t), intent(inout) :: self
      type(torus_t), intent(in) :: torus
      real(wp), intent(in) :: omega(:)
      integer :: m, n_neighbours, node, other, p, q, rest, stride(size(omega)), shift(size(omega))
      real(wp) :: by_node(n_nodes, size(omega)), way

      other = size(omega) - 1
      n_neighbours = n_nodes**other
      allocate (self%neighbour(n_neighbours, self%n_slice), self%weight(n_neighbours))
      stride = 1
      do m = 1, size(omega)
         way = -omega(m)*self%step*torus%n_samples(m)/two_pi           ! to the start of a step, in samples
         if (abs(way - anint(way)) < 8*epsilon(1.0_wp)*max(1.0_wp, abs(way))) way = anint(way)
         shift(m) = floor(way)
         by_node(:, m) = cubic_weights(way - shift(m))
      end do
      do p = 1, self%n_slice
         do q = 1, n_neighbours
            rest = q - 1
            node = 0
            self%neighbour(q, p) = 1
            self%weight(q) = 1.0_wp
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
            node = modulo(rest, n_nodes)
            rest = rest/n_nodes
            at = modulo((p - 1)/inner, n)
            at = modulo(at + shift(m) + node - 1, n)
            self%neighbour(q, p) = self%neighbour(q, p) + inner*at
            self%weight(q) = self%weight(q)*by_node(node + 1, m)
            inner = inner*n
         end do
      end subroutine visit_tones
   end subroutine lay_out_neighbours

   !> Weights of the cubic through nodes at -1, 0, 1, 2 for its value at x between 0 and 1.
   pure function cubic_weights(x) result(weights)
      real(wp), intent(in) :: x
      real(wp) :: weights(n_nodes)

      weights = [-x*(x - 1.0_wp)*(x - 2.0_wp)/6.0_wp, (x + 1.0_wp)*(x - 1.0_wp)*(x - 2.0_wp)/2.0_wp, &
                 -(x + 1.0_wp)*x*(x - 2.0_wp)/2.0_wp, (x + 1.0_wp)*x*(x - 1.0_wp)/6.0_wp]
   end function cubic_weights

   !> Values at the starts of all steps that end in a slice, from those on the slice before.
   pure subroutine characteristic_interpolate(self, before, values)
      class(characteristic_t), intent(in) :: self
      real(wp), intent(in) :: before(:, :)                            !! (n_slice, any)
      real(wp), intent(out) :: values(:, :)                           !! as before
      integer :: c, p

      do c = 1, size(before, 2)
         do p = 1, self%n_slice
            values(p, c) = dot_product(self%weight, before(self%neighbour(:, p), c))
         end do
      end do
   end subroutine characteristic_interpolate
end module hb_characteristic
