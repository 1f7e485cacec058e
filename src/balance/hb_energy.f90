!> Mean mechanical energy of a free periodic motion over the torus, above that of the equilibrium.
!>
!>     E = <x'^T M x' + x^T K x>/2 - p_0^T <x> + sum over the laws of <V(z)>, minus the same at rest,
!>
!> with constant loads p_0 and the potentials V of the laws. The energy of a conservative motion is constant; for the
!> truncated motion the mean is the most accurate value, see docs/why/theory.md, section 6.5. x contains all degrees
!> of freedom; those without laws follow from the condensation of the balance.
module hb_energy
   use hb_balance, only: balance_t
   use hb_kinds, only: wp
   use hb_structure, only: structure_t
   use hb_structure_block, only: new_structure_block, structure_block_t
   implicit none
   private
   public :: energy_t, new_energy

   type :: energy_t
      type(structure_block_t), private :: matrices                    ! mass and stiffness of all degrees of freedom
      real(wp), allocatable, private :: load(:)                       ! constant [N], (all dofs)
      real(wp) :: at_rest = 0.0_wp                                    !! [J], is subtracted
   contains
      procedure :: value => energy_value
      procedure :: differentiate => energy_differentiate
   end type energy_t

contains

   !> Energy of motions of a balance whose stiffness has motion slopes and whose laws have potentials; the stiffness
   !> of the structure is symmetric and loads are constant.
   subroutine new_energy(self, structure, load, balance, rest)
      type(energy_t), intent(out) :: self
      type(structure_t), intent(in) :: structure
      real(wp), intent(in) :: load(:)                                 !! constant [N], (all dofs)
      type(balance_t), intent(inout) :: balance
      real(wp), intent(in) :: rest(:, :)                              !! the motion of zero energy [m], (n_coefficients, n_dofs)
      integer :: all_dofs(structure%n_dofs), i

      all_dofs = [(i, i=1, structure%n_dofs)]
      call new_structure_block(self%matrices, structure, all_dofs, all_dofs)
      self%load = load
      self%at_rest = self%value(balance, rest)
   end subroutine new_energy

   !> Energy [J] of a motion at the frequencies of the balance; changes the samples of its laws.
   real(wp) function energy_value(self, balance, u)
      class(energy_t), intent(in) :: self
      type(balance_t), intent(inout) :: balance
      real(wp), intent(in) :: u(:, :)                                 !! [m], (n_coefficients, n_dofs)
      real(wp), allocatable :: law_gradient(:, :), by_omega(:), by_xi(:)

      call find(self, balance, u, .false., energy_value, law_gradient, by_omega, by_xi)
   end function energy_value

   !> Its exact derivatives with respect to the coefficients [N], the base frequencies and the artificial damping of
   !> all tones [J s].
   subroutine energy_differentiate(self, balance, u, by_u, by_omega, by_xi)
      class(energy_t), intent(in) :: self
      type(balance_t), intent(inout) :: balance
      real(wp), intent(in) :: u(:, :)                                 !! [m], (n_coefficients, n_dofs)
      real(wp), allocatable, intent(out) :: by_u(:, :)                !! as u
      real(wp), allocatable, intent(out) :: by_omega(:), by_xi(:)     !! (n_tones)
      real(wp) :: energy

      call find(self, balance, u, .true., energy, by_u, by_omega, by_xi)
   end subroutine energy_differentiate

   !> Energy of the structure harmonic by harmonic, (w**2 c^H M c + c^H K c)/4, of the zero tuple c^T K c/2 - p_0^T c, then that
   !> of the laws. With g = (w**2 M + K) c/2, of the zero tuple K c - p_0, dE = Re(g^H dc) at constant w.
   subroutine find(self, balance, u, with_derivatives, energy, by_u, by_omega, by_xi)
      class(energy_t), intent(in) :: self
      type(balance_t), intent(inout) :: balance
      real(wp), intent(in) :: u(:, :)
      logical, intent(in) :: with_derivatives
      real(wp), intent(out) :: energy
      real(wp), allocatable, intent(out) :: by_u(:, :), by_omega(:), by_xi(:)
      complex(wp), dimension(size(self%load), balance%harmonics%n_harmonics) :: c, inertia, gradient
      real(wp) :: of_laws
      integer :: h

      call balance%all_dofs(u, c)
      call multiply(self%matrices, c, inertia, gradient)
      energy = -self%at_rest
      do h = 1, size(c, 2)
         if (balance%harmonics%sin_at(h) == 0) then
            energy = energy + real(dot_product(c(:, h), 0.5_wp*gradient(:, h) - self%load))
            gradient(:, h) = gradient(:, h) - self%load
         else
            gradient(:, h) = 0.5_wp*(balance%frequencies(h)**2*inertia(:, h) + gradient(:, h))
            energy = energy + 0.5_wp*real(dot_product(c(:, h), gradient(:, h)))
         end if
      end do
      call balance%sample(u)
      call balance%law_set%potential(of_laws)
      energy = energy + of_laws
      if (with_derivatives) call find_derivatives()

   contains

      subroutine find_derivatives()
         complex(wp) :: at_laws(balance%n_dofs, size(c, 2)), change(size(c, 1), size(c, 2))
         real(wp), dimension(size(c, 2)) :: by_drive, by_frequency
         real(wp) :: tuples(size(balance%xi), size(c, 2))

         by_u = u
         associate (set => balance%harmonics)
            call balance%project(balance%law_set%samples%f%values, by_u) ! of a function of mean f, f_c and f_s: f, f_c/2, f_s/2
            call balance%stiffness%map_to_laws(gradient, at_laws)
            do h = 1, set%n_harmonics
               if (set%sin_at(h) > 0) by_u([set%cos_at(h), set%sin_at(h)], :) = 0.5_wp*by_u([set%cos_at(h), set%sin_at(h)], :)
            end do
            by_u = by_u + set%coefficients(at_laws)
            at_laws = set%amplitudes(u)
            call balance%stiffness%recover_slope(at_laws, .false., change)
            by_frequency = real(sum(conjg(gradient)*change, dim=1)) + &
                           0.5_wp*balance%frequencies*real(sum(conjg(c)*inertia, dim=1))   ! none for the mean, where w = 0
            call balance%stiffness%recover_slope(at_laws, .true., change)
            by_drive = real(sum(conjg(gradient)*change, dim=1))
            tuples = real(set%tuples, wp)
            by_omega = matmul(tuples, by_frequency) + balance%xi*matmul(tuples, by_drive)
            by_xi = balance%omega*matmul(tuples, by_drive)
         end associate
      end subroutine find_derivatives
   end subroutine find

   !> Products of mass and stiffness with the motion.
   pure subroutine multiply(matrices, c, inertia, elastic)
      type(structure_block_t), intent(in) :: matrices
      complex(wp), intent(in) :: c(:, :)                              !! [m], (n_dofs, n_harmonics)
      complex(wp), intent(out) :: inertia(:, :), elastic(:, :)
      integer :: e, h

      inertia = (0.0_wp, 0.0_wp)
      elastic = (0.0_wp, 0.0_wp)
      do h = 1, size(c, 2)
         do e = 1, matrices%n_entries
            associate (row => matrices%row(e), column => matrices%column(e))
               inertia(row, h) = inertia(row, h) + matrices%mass(e)*c(column, h)
               elastic(row, h) = elastic(row, h) + matrices%stiffness(e)*c(column, h)
            end associate
         end do
      end do
   end subroutine multiply
end module hb_energy
