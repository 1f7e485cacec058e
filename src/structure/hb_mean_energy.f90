!> Mean energies over the torus of the structure in a motion x(t) = sum over harmonics of Re(c exp(i w t)), its power
!> loss, and the equivalent damping.
!>
!> The mean of x'^T M x'/2 is w**2 c^H M c/4, that of x^T K x/2 is c^H K c/4, of a constant part twice that; a
!> frequency-dependent part stores Re(conj(a.c) Z b.c)/4. With the rate i w c the damping dissipates w**2 Re(c^H D
!> c)/2, of which gyroscopic parts have none, a circulatory stiffness, such as that of damping which rotates with a
!> shaft, w Im(c^H K c)/2, and a frequency-dependent part w Im(conj(a.c) Z b.c)/2. A linear oscillator with damping d
!> and amplitude a at frequency w dissipates P = d w**2 a**2/2, so that P/(2 w U) = d w/k is its loss factor and P/(4
!> T) = d/(2 m) its decay rate; with several harmonics w U is their sum.
module hb_mean_energy
   use hb_kinds, only: wp
   use hb_lapack, only: dgemm
   use hb_sparse, only: sparse_t
   use hb_structure, only: structure_t
   implicit none
   private
   public :: mean_energy_t, new_mean_energy

   type :: mean_energy_t
      real(wp) :: kinetic = 0.0_wp                                    !! [J]
      real(wp) :: strain = 0.0_wp                                     !! [J]
      real(wp) :: lost = 0.0_wp                                       !! [W]
      real(wp), private :: turning = 0.0_wp                           ! sum of |w| U [W]
   contains
      procedure :: loss_factor => mean_energy_loss_factor
      procedure :: decay => mean_energy_decay
   end type mean_energy_t

contains

   !> Computes the energies of a motion; for a large structure harmonic by harmonic, with little memory.
   subroutine new_mean_energy(self, structure, c, frequencies)
      type(mean_energy_t), intent(out) :: self
      type(structure_t), intent(in) :: structure
      complex(wp), intent(in) :: c(:, :)                              !! a - i b [m], (structure%n_dofs, n_harmonics)
      real(wp), intent(in) :: frequencies(:)                          !! [rad/s], (n_harmonics), 0 for constant parts
      integer :: first, last, n_together

      n_together = size(c, 2)
      if (allocated(structure%sparse)) n_together = 1
      do first = 1, size(c, 2), n_together
         last = first + n_together - 1
         call add_energies(self, structure, c(:, first:last), frequencies(first:last))
      end do
   end subroutine new_mean_energy

   !> Adds the energies of some harmonics.
   subroutine add_energies(self, structure, c, frequencies)
      type(mean_energy_t), intent(inout) :: self
      type(structure_t), intent(in) :: structure
      complex(wp), intent(in) :: c(:, :)
      real(wp), intent(in) :: frequencies(:)
      real(wp), dimension(size(c, 1), 2*size(c, 2)) :: x, y
      real(wp), dimension(size(c, 2)) :: circulated, damped, moved, strained
      complex(wp) :: work
      real(wp) :: strain
      integer :: h, n

      n = size(c, 2)
      x(:, :n) = real(c)
      x(:, n + 1:) = aimag(c)
      if (allocated(structure%sparse)) then
         associate (s => structure%sparse)
            moved = functionals_of(s%mass)
            damped = functionals_of(s%damping)
            strained = functionals_of(s%stiffness)
         end associate
      else
         moved = functionals_in(structure%mass)
         damped = functionals_in(structure%damping)
         strained = functionals_in(structure%stiffness)
      end if
      circulated = [(dot_product(x(:, h), y(:, n + h)) - dot_product(x(:, n + h), y(:, h)), h=1, n)]   ! y = K x
      do h = 1, n
         associate (w => frequencies(h))
            work = structure%work_in_parts(c(:, h), w)
            self%kinetic = self%kinetic + 0.25_wp*w**2*moved(h)
            self%lost = self%lost + 0.5_wp*w**2*damped(h) + 0.5_wp*w*(circulated(h) + aimag(work))
            strain = 0.25_wp*(strained(h) + real(work))
            if (abs(w) <= 0.0_wp) strain = 2.0_wp*strain
            self%strain = self%strain + strain
            self%turning = self%turning + abs(w)*strain
         end associate
      end do

   contains

      function functionals_in(matrix)
         real(wp), intent(in) :: matrix(:, :)
         real(wp) :: functionals_in(n)

         associate (m => size(x, 1))
            call dgemm("N", "N", m, 2*n, m, 1.0_wp, matrix, m, x, m, 0.0_wp, y, m)
         end associate
         functionals_in = functionals()
      end function functionals_in

      function functionals_of(matrix)
         type(sparse_t), intent(in) :: matrix
         real(wp) :: functionals_of(n)
         real(wp) :: rows(size(y, 2), size(y, 1))

         call matrix%times(transpose(x), rows)
         y = transpose(rows)
         functionals_of = functionals()
      end function functionals_of

      function functionals()
         real(wp) :: functionals(n)
         integer :: i

         do i = 1, n
            functionals(i) = dot_product(x(:, i), y(:, i)) + dot_product(x(:, n + i), y(:, n + i))
         end do
      end function functionals
   end subroutine add_energies

   !> Loss factor equivalent to a mean power loss; 0 without strain energy.
   pure real(wp) function mean_energy_loss_factor(self, loss) result(factor)
      class(mean_energy_t), intent(in) :: self
      real(wp), intent(in) :: loss                                    !! [W]

      factor = 0.0_wp
      if (abs(self%turning) > 0.0_wp) factor = loss/(2.0_wp*self%turning)
   end function mean_energy_loss_factor

   !> Decay rate [1/s] of a free motion with the same power loss; 0 at rest.
   pure real(wp) function mean_energy_decay(self, loss) result(rate)
      class(mean_energy_t), intent(in) :: self
      real(wp), intent(in) :: loss                                    !! [W]

      rate = 0.0_wp
      if (abs(self%kinetic) > 0.0_wp) rate = loss/(4.0_wp*self%kinetic)
   end function mean_energy_decay
end module hb_mean_energy
