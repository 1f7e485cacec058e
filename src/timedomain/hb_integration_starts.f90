!> Several starts of a time integration, and the identification of equal motions in which they end.
!>
!> After rest or a given state the starts are points on spheres of displacement and velocity about rest, of one, three
!> and ten times the size of the motion. Their directions follow multiples of the golden ratio, which are
!> equidistributed and the same in each run; shapes are displacements under forces proportional to mass with random
!> signs, so that a mesh is not excited in its finest modes.
module hb_integration_starts
   use hb_integration_system, only: integration_state_t, integration_system_t, new_integration_state
   use hb_kinds, only: two_pi, wp
   use hb_lapack, only: dpotrf, dpotrs
   implicit none
   private
   public :: motions_of, scattered, state_on_sphere

   real(wp), parameter :: golden_ratio = 0.6180339887498949_wp
   real(wp), parameter :: sphere_radii(3) = [1.0_wp, 3.0_wp, 10.0_wp]  ! of spheres, relative to the motion
   real(wp), parameter :: min_distance = 1.0e-2_wp                  ! of two motions, relative
   real(wp), parameter :: spread_safety = 5.0_wp                      ! of spreads
   real(wp), parameter :: min_relative_motion = 1.0e-3_wp ! smallest motion of a coordinate that counts, relative to the largest

contains

   !> The state of a start at time zero, sliders relaxed.
   subroutine state_on_sphere(system, omega, size_of_motion, number, state)
      type(integration_system_t), intent(inout) :: system             !! its matrices are unpacked
      real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s]
      real(wp), intent(in) :: size_of_motion                          !! at the coordinates of the laws [m]
      integer, intent(in) :: number                                   !! of the start on spheres, from 1
      type(integration_state_t), intent(out) :: state
      real(wp) :: angle, middle, radius, right(system%n_dofs, 2)
      real(wp), allocatable :: factor(:, :)
      integer :: i, info

      call new_integration_state(state, system%n_dofs, system%laws%n_states)
      right = reshape([(scattered(2*number*system%n_dofs + i), i=1, 2*system%n_dofs)], [system%n_dofs, 2])
      middle = sum(omega)/size(omega)
      call system%structure%unpack()
      factor = system%structure%stiffness + middle**2*system%structure%mass
      call dpotrf("L", system%n_dofs, factor, system%n_dofs, info)
      if (info == 0) then
         right = matmul(system%structure%mass, right)
         call dpotrs("L", system%n_dofs, 2, factor, system%n_dofs, right, system%n_dofs, info)
      end if
      radius = sphere_radii(1 + modulo(number - 1, size(sphere_radii)))*size_of_motion
      angle = two_pi*golden_ratio*number
      state%q = radius*cos(angle)*unit_of(right(:, 1))
      state%v = middle*radius*sin(angle)*unit_of(right(:, 2))

   contains

      !> A displacement relative to its effect on the coordinates of the laws.
      pure function unit_of(shape) result(unit)
         real(wp), intent(in) :: shape(:)
         real(wp) :: effect, unit(size(shape))

         effect = 0.0_wp
         if (system%laws%n_coordinates > 0) effect = maxval(abs(matmul(shape, system%laws%shape)))
         if (effect <= 0.0_wp) effect = max(maxval(abs(shape)), tiny(1.0_wp))
         unit = shape/effect
      end function unit_of
   end subroutine state_on_sphere

   !> Number of the motion in which each start ends, from 1 in the order of the starts, 0 if it ends in none. Two
   !> starts end in the same motion if they are of the same kind and, if their averages are meaningful, their
   !> coefficients differ by no more than their spreads permit.
   pure function motions_of(c, kind, spread) result(motion)
      complex(wp), intent(in) :: c(:, :, :)                           !! averages, (n_harmonics, n_coordinates, n_starts)
      integer, intent(in) :: kind(:)                                  !! (n_starts); 0: none
      real(wp), intent(in) :: spread(:)                               !! of the averages, relative, (n_starts); 1: not meaningful
      integer :: motion(size(kind))
      integer :: i, j

      motion = 0
      do i = 1, size(kind)
         if (kind(i) == 0) cycle
         do j = 1, i - 1
            if (kind(j) /= kind(i)) cycle
            if (distance(c(:, :, i), c(:, :, j)) > max(min_distance, spread_safety*(spread(i) + spread(j)))) cycle
            motion(i) = motion(j)
            exit
         end do
         if (motion(i) == 0) motion(i) = maxval(motion) + 1
      end do
   end function motions_of

   !> Largest difference of two motions at a coordinate, relative to the larger of them there.
   pure real(wp) function distance(a, b)
      complex(wp), intent(in) :: a(:, :), b(:, :)                     !! (n_harmonics, n_coordinates)
      real(wp) :: own(size(a, 2))
      integer :: k

      own = [(max(norm2(abs(a(:, k))), norm2(abs(b(:, k)))), k=1, size(a, 2))]
      own = max(own, min_relative_motion*maxval(own), tiny(1.0_wp))
      distance = maxval([(norm2(abs(a(:, k) - b(:, k)))/own(k), k=1, size(a, 2))])
   end function distance

   !> Returns numbers between -1 and 1: multiples of the golden ratio, which are equidistributed.
   pure real(wp) function scattered(i)
      integer, intent(in) :: i

      scattered = 2.0_wp*modulo(i*golden_ratio, 1.0_wp) - 1.0_wp
   end function scattered
end module hb_integration_starts
