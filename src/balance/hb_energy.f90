!> Mean mechanical energy of a free periodic motion over the torus, above that of the equilibrium.
!>
!>     E = <x'^T M x' + x^T K x>/2 - p_0^T <x> + sum over the laws of <V(z)>, minus the same at rest,
!> with constant loads p_0 and the potentials V of the laws. The energy of a conservative motion is constant; for the
!> truncated motion the mean is the most accurate value, see docs/why/theory.md, section 6.5. x contains all degrees
!> of freedom; those without laws follow from the condensation of the balance.
!> Influence of the choice of an impact law on a motion of a truncated series.
!> A coordinate with mass that strikes a rigid wall needs such a law, for instance a restitution: the equations do not
!> determine its velocity afterwards. A truncated series hides this, because its velocity does not jump. The choice
!> affects the energy of the impact, m v**2/2 with the mass m = 1/(w^T M**-1 w) of the structure at the coordinate w^T
!> x and the speed v at which it meets the wall. Source: docs/why/theory.md, section 7.
module hb_energy
   use hb_balance, only: balance_t
   use hb_dynamic_stiffness, only: dynamic_stiffness_t, new_dynamic_stiffness
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_law, only: law_t
   use hb_small_lu, only: factorise_small, solve_small
   use hb_structure, only: structure_t
   use hb_structure_block, only: new_structure_block, structure_block_t
   implicit none
   private
   public :: energy_t, find_mass, impact_energy, new_energy

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

   !> Energy of the hardest impact against a rigid wall, m v**2, relative to the mean of m z'**2 + k z**2 with the
   !> static stiffness k of the structure at the coordinate z; 0 without impacts. The forces of the laws are those of
   !> the motion.
   real(wp) function impact_energy(structure, balance, u)
      type(structure_t), intent(in) :: structure
      type(balance_t), intent(inout) :: balance                       !! after `evaluate`; its samples are changed
      real(wp), intent(in) :: u(:, :)                                 !! [m], (n_coefficients, n_dofs)
      real(wp), allocatable :: rate(:, :), z(:), speed(:), v(:)
      real(wp) :: mass, moving, stiffness
      real(wp), pointer, contiguous :: force(:, :)
      integer :: i

      impact_energy = 0.0_wp
      if (.not. any([(is_wall(balance%law_set%laws(i)%law), i=1, size(balance%law_set%laws))])) return
      rate = balance%harmonics%times(cmplx(0.0_wp, balance%frequencies, wp), u)
      call balance%sample(rate)
      do i = 1, size(balance%law_set%laws)
         associate (set => balance%law_set, law => balance%law_set%laws(i)%law, coordinates => balance%stiffness%coordinates)
            if (.not. is_wall(law)) cycle
            force => set%force_of(i)
            v = reshape(set%coordinates_of(i, set%samples%q%values), [size(force, 1)])
            speed = max(0.0_wp, merge(v, -v, force(:, 1) > 0.0_wp))
            where (abs(force(:, 1)) <= 0.0_wp) speed = 0.0_wp
            if (all(speed <= 0.0_wp)) cycle
            call find_mass(structure, coordinates%dofs, coordinates%weights_of(law%dofs, law%shape(:, 1)), mass, stiffness)
            z = reshape(set%coordinates_of(i, u), [size(u, 1)])
            v = reshape(set%coordinates_of(i, rate), [size(u, 1)])
            moving = mass*mean_square(balance, v) + stiffness*mean_square(balance, z)
            if (moving > 0.0_wp) impact_energy = max(impact_energy, mass*maxval(speed)**2/moving)
         end associate
      end do
   end function impact_energy

   !> Whether a law is a rigid obstacle in one coordinate.
   pure logical function is_wall(law)
      class(law_t), intent(in) :: law

      is_wall = law%is_multiplier .and. .not. law%needs_velocity .and. size(law%shape, 2) == 1
   end function is_wall

   !> Mean over the torus of the square of a function.
   pure real(wp) function mean_square(balance, coefficients)
      type(balance_t), intent(in) :: balance
      real(wp), intent(in) :: coefficients(:)                         !! (n_coefficients)

      mean_square = 0.5_wp*sum(coefficients**2)
      if (balance%harmonics%has_zero) mean_square = mean_square + 0.5_wp*coefficients(1)**2
   end function mean_square

   !> Mass and static stiffness of the structure at a coordinate w: 1/(w^T M**-1 w), as the inertia far above all
   !> resonances, where massless coordinates follow the others, and 1/(w^T K**-1 w); 0 if there is none.
   subroutine find_mass(structure, all_dofs, all_weights, mass, stiffness)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: all_dofs(:)
      real(wp), intent(in) :: all_weights(:)                          !! (size(all_dofs)), some may be zero
      real(wp), intent(out) :: mass, stiffness
      real(wp) :: far, highest, largest_mass
      real(wp), allocatable :: dampings(:), masses(:), stiffnesses(:)
      real(wp), allocatable :: weights(:)
      integer, allocatable :: dofs(:)
      integer :: i

      dofs = pack(all_dofs, abs(all_weights) > 0.0_wp)
      weights = pack(all_weights, abs(all_weights) > 0.0_wp)
      mass = 0.0_wp
      stiffness = max(0.0_wp, seen_at(0.0_wp))
      call structure%diagonals(masses, dampings, stiffnesses)
      largest_mass = maxval(masses)
      if (.not. largest_mass > 0.0_wp) return
      highest = 0.0_wp
      do i = 1, structure%n_dofs
         if (masses(i) > epsilon(1.0_wp)*largest_mass) &
            highest = max(highest, sqrt(abs(stiffnesses(i))/masses(i)), abs(dampings(i))/masses(i))
      end do
      if (.not. highest > 0.0_wp) highest = 1.0_wp
      far = highest*epsilon(1.0_wp)**(-0.25_wp)                       ! the inertia there is as exact as rounding permits
      mass = max(0.0_wp, -seen_at(far)/far**2)

   contains

      !> Real part of 1/(w^T S**-1 w) at a frequency; 0 if the structure can move freely.
      real(wp) function seen_at(frequency)
         real(wp), intent(in) :: frequency
         type(dynamic_stiffness_t) :: dynamic
         type(error_t), allocatable :: error
         complex(wp) :: block(size(dofs), size(dofs)), response(size(dofs), 1), load(structure%n_dofs, 1)
         integer :: pivots(size(dofs))
         logical :: is_singular
         integer :: k

         seen_at = 0.0_wp
         load = (0.0_wp, 0.0_wp)
         call new_dynamic_stiffness(dynamic, structure, dofs, [frequency], load, error)
         if (allocated(error)) return
         block = (0.0_wp, 0.0_wp)
         associate (pattern => dynamic%pattern)
            do k = 1, size(dofs)
               block(pattern%first(k):pattern%last(k), k) = &
                  dynamic%condensed(pattern%shift(k) + pattern%first(k):pattern%shift(k) + pattern%last(k), k, 1)
            end do
         end associate
         call factorise_small(block, pivots, is_singular)
         if (is_singular) return
         response(:, 1) = cmplx(weights, kind=wp)
         call solve_small(block, pivots, response)
         associate (compliance => sum(weights*response(:, 1)))
            if (abs(compliance) > 0.0_wp) seen_at = real(1.0_wp/compliance)
         end associate
      end function seen_at
   end subroutine find_mass
end module hb_energy
