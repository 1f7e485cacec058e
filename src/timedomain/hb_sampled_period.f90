!> A sampled period of a motion with impacts, and its Fourier coefficients, which include the jumps of the velocity.
module hb_sampled_period
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: two_pi, wp
   implicit none
   private
   public :: sampled_period_t

   type :: sampled_period_t
      real(wp) :: begun = 0.0_wp                                      !! phase of the first sample, part of a period
      real(wp), allocatable :: q(:, :)                                !! displacements [m], (n_samples, n_dofs)
      real(wp), allocatable :: impacts(:)                             !! parts of a period after it with an impact, (n_impacts)
      real(wp), allocatable :: jumps(:, :)                            !! of the velocities [m per period], (n_dofs, n_impacts)
   contains
      procedure :: amplitudes => sampled_period_amplitudes
      procedure :: remainder => sampled_period_remainder
   end type sampled_period_t

contains

   !> Amplitudes, cos - i sin, of samples, (n_harmonics, columns of z).
   !>
   !> The sum over samples differs from the integral by h**2/2 B2 jump for each jump of the slope, B2 the Bernoulli polynomial at
   !> its position between two samples, and by h**3/6 B3 for that of the second derivative (formula of Euler and Maclaurin).
   pure function sampled_period_amplitudes(self, set, z) result(amplitudes)
      class(sampled_period_t), intent(in) :: self                     !! with jumps of the same columns
      type(harmonics_t), intent(in) :: set                            !! of one tone
      real(wp), intent(in) :: z(:, :)                                 !! (n_samples, any)
      complex(wp) :: amplitudes(set%n_harmonics, size(z, 2))
      complex(wp) :: correction, roots(0:size(z, 1) - 1), total, turn
      real(wp) :: between, h
      integer :: c, i, j, k, n

      n = size(z, 1)
      h = 1.0_wp/n
      roots = roots_of_one(n)
      do k = 1, set%n_harmonics
         associate (order => set%tuples(1, k))
            do c = 1, size(z, 2)
               total = 0.0_wp
               j = 0
               do i = 1, n
                  total = total + z(i, c)*conjg(roots(j))
                  j = j + order
                  if (j >= n) j = j - n
               end do
               correction = 0.0_wp
               do i = 1, size(self%impacts)
                  between = modulo(n*self%impacts(i), 1.0_wp)
                  turn = exp(cmplx(0.0_wp, -two_pi*order*self%impacts(i), wp))
                  correction = correction + self%jumps(c, i)*turn*(0.5_wp*h**2*(between**2 - between + 1.0_wp/6.0_wp) + &
                     h**3/3.0_wp*(between**3 - 1.5_wp*between**2 + 0.5_wp*between)*cmplx(0.0_wp, two_pi*order, wp))
               end do
               turn = exp(cmplx(0.0_wp, -two_pi*order*self%begun, wp))
               amplitudes(k, c) = merge(1.0_wp, 2.0_wp, order == 0)*turn*(h*total + correction)
            end do
         end associate
      end do
   end function sampled_period_amplitudes

   !> Samples without their harmonics.
   pure function sampled_period_remainder(self, set, z, amplitudes) result(remainder)
      class(sampled_period_t), intent(in) :: self
      type(harmonics_t), intent(in) :: set                            !! of one tone
      real(wp), intent(in) :: z(:, :)                                 !! (n_samples, any)
      complex(wp), intent(in) :: amplitudes(:, :)                     !! (n_harmonics, columns of z)
      real(wp) :: remainder(size(z, 1), size(z, 2))
      complex(wp) :: roots(0:size(z, 1) - 1), turn
      integer :: c, h, i, j, n

      n = size(z, 1)
      remainder = z
      roots = roots_of_one(n)
      do h = 1, set%n_harmonics
         associate (order => set%tuples(1, h))
            do c = 1, size(z, 2)
               turn = exp(cmplx(0.0_wp, two_pi*order*self%begun, wp))*amplitudes(h, c)
               j = 0
               do i = 1, n
                  remainder(i, c) = remainder(i, c) - real(roots(j)*turn, wp)
                  j = j + order
                  if (j >= n) j = j - n
               end do
            end do
         end associate
      end do
   end function sampled_period_remainder

   !> The roots of one, exp(i 2 pi j/n).
   pure function roots_of_one(n) result(roots)
      integer, intent(in) :: n
      complex(wp) :: roots(0:n - 1)
      integer :: j

      roots = exp(cmplx(0.0_wp, [(two_pi*j/n, j=0, n - 1)], wp))
   end function roots_of_one
end module hb_sampled_period
