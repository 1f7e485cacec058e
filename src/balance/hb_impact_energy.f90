!> Energy of an impact against a rigid wall: the influence of the choice of an impact law on a motion of a truncated series.
!>
!> A coordinate with mass that strikes a rigid wall needs such a law, for instance a restitution: the equations do not
!> determine its velocity afterwards. A truncated series hides this, because its velocity does not jump. The choice
!> affects the energy of the impact, m v**2/2 with the mass m = 1/(w^T M**-1 w) of the structure at the coordinate w^T
!> x and the speed v at which it meets the wall. Source: docs/why/theory.md, section 7.
module hb_impact_energy
   use hb_balance, only: balance_t
   use hb_dynamic_stiffness, only: dynamic_stiffness_t, new_dynamic_stiffness
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_law, only: law_t
   use hb_small_lu, only: factorise_small, solve_small
   use hb_structure, only: structure_t
   implicit none
   private
   public :: find_mass, impact_energy

contains

   !> Energy of the strongest impact against a rigid wall, m v**2, relative to the mean of m z'**2 + k z**2 with the
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
      allocate (rate, source=balance%harmonics%times(cmplx(0.0_wp, balance%frequencies, wp), u))
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
         call new_dynamic_stiffness(dynamic, structure, dofs, [frequency], load, error, tuples=reshape([integer ::], [0, 1]))
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
end module hb_impact_energy
