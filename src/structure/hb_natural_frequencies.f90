!> Natural frequencies of a linear structure: K v = omega**2 M v, without damping, and without what is not symmetric.
module hb_natural_frequencies
   use hb_kinds, only: wp
   use hb_lapack, only: dsygv
   implicit none
   private
   public :: natural_frequencies

contains

   !> Gives all finite natural frequencies, ascending; 0 for a motion that the structure does not resist, negative for the rate at
   !> which the structure at rest is left where its stiffness is negative. No value where LAPACK finds none: the structure has
   !> massless parts that nothing holds.
   !>
   !> Where the stiffness is positive definite, M v = mu K v is solved, whose largest eigenvalues are the lowest frequencies to all
   !> digits and which takes masses of zero; else K v = lambda M v.
   function natural_frequencies(mass, stiffness) result(frequencies)
      real(wp), intent(in) :: mass(:, :), stiffness(:, :)             !! (n_dofs, n_dofs)
      real(wp), allocatable :: frequencies(:)                         !! [rad/s]
      real(wp), allocatable :: a(:, :), b(:, :), values(:), work(:)
      integer :: info, n

      n = size(mass, 1)
      allocate (values(n), work(max(1, 3*n)))
      a = 0.5_wp*(mass + transpose(mass))
      b = 0.5_wp*(stiffness + transpose(stiffness))
      call dsygv(1, "N", "U", n, a, n, b, n, values, work, size(work), info)
      if (info == 0) then
         values = values(n:1:-1)
         frequencies = 1.0_wp/sqrt(pack(values, values > n*epsilon(1.0_wp)*maxval(values)))
         return
      end if
      a = 0.5_wp*(stiffness + transpose(stiffness))
      b = 0.5_wp*(mass + transpose(mass))
      call dsygv(1, "N", "U", n, a, n, b, n, values, work, size(work), info)
      if (info == 0) then
         where (abs(values) <= n*epsilon(1.0_wp)*maxval(abs(values))) values = 0.0_wp
         frequencies = sign(sqrt(abs(values)), values)
      else
         allocate (frequencies(0))
      end if
   end function natural_frequencies
end module hb_natural_frequencies
