!> Derivative of the motion of all degrees of freedom along a direction in which the motion at the coordinates of the laws
!> changes, and with it frequencies, drives, loads and the structure.
!>
!> The interior follows the coordinates, x_r = y - T x_l (hb_dynamic_stiffness). Along the direction
!>
!>     dx_r = dy - dT x_l - T dx_l.
!>
!> One harmonic is condensed after the other, so that the memory does not depend on their number.
module hb_motion_slope
   use hb_amplitudes, only: amplitudes_t
   use hb_condensation, only: condensation_t, new_condensation
   use hb_coordinates, only: coordinates_t
   use hb_kinds, only: wp
   use hb_structure, only: structure_t
   implicit none
   private
   public :: find_motion_slope, moving_parameters_t

   !> Frequencies, drives and loads of all harmonics, and their derivatives along the direction.
   type :: moving_parameters_t
      real(wp), allocatable :: frequencies(:)                !! [rad/s], (n_harmonics)
      real(wp), allocatable :: drives(:)                     !! [rad**2/s**2], (n_harmonics)
      integer, allocatable :: tuples(:, :)                   !! (n_tones, n_harmonics)
      type(amplitudes_t) :: loads                            !! [N]
      real(wp), allocatable :: frequency_slopes(:)           !! as the frequencies
      real(wp), allocatable :: drive_slopes(:)               !! as the drives
      type(amplitudes_t) :: load_slopes                      !! as the loads; with zero degrees of freedom: zero
      type(structure_t), allocatable :: structure_slope      !! of the matrices; not allocated: zero
   end type moving_parameters_t

contains

   !> Finds the derivatives of some harmonics. Units are those of the motion, per unit of length along the direction.
   subroutine find_motion_slope(structure, coordinates, moving, harmonics, motion, motion_slope, slope, is_singular)
      type(structure_t), intent(in) :: structure
      type(coordinates_t), intent(in) :: coordinates                  !! of the laws
      type(moving_parameters_t), intent(in) :: moving
      integer, intent(in) :: harmonics(:)                             !! numbers of the requested ones
      complex(wp), intent(in) :: motion(:, :)                         !! of the coordinates [m], (n_coordinates, n_harmonics)
      complex(wp), intent(in) :: motion_slope(:, :)                   !! its derivative along the direction
      complex(wp), intent(out) :: slope(:, :)                         !! (n_dofs, size(harmonics))
      logical, intent(out) :: is_singular                             !! the interior has a resonance without damping
      type(condensation_t) :: condensation
      complex(wp), allocatable :: condensed(:, :)
      complex(wp) :: load(coordinates%n)
      integer :: h, i, k, n, order(size(harmonics))
      real(wp) :: magnitude(coordinates%n)

      call new_condensation(condensation, structure, coordinates, moving%loads, maxval([0.0_wp, abs(moving%frequencies)]), &
                            moving%load_slopes, moving%structure_slope)
      condensation%rates = moving%frequency_slopes
      condensation%drive_rates = moving%drive_slopes
      if (structure%depends_on_tuple()) condensation%tuples = moving%tuples
      n = coordinates%n
      allocate (condensed(condensation%pattern%n_rows, n))
      is_singular = .false.
      slope = (0.0_wp, 0.0_wp)
      call condensation%begin(harmonics, moving%frequencies, moving%drives, order)
      do k = 1, size(harmonics)
         i = order(k)
         h = harmonics(i)
         call condensation%eliminate(h, moving%frequencies(h), moving%drives(h), load, magnitude, is_singular)
         if (is_singular) exit
         call condensation%find_slopes(h, moving%frequencies(h), .false., condensed, load)
         associate (change => condensation%solver%rhs)
            slope(condensation%interior, i) = change(:, n + 1) - matmul(change(:, :n), motion(:, h)) &
                                              - matmul(condensation%transfer, motion_slope(:, h))
         end associate
         slope(coordinates%positions, i) = motion_slope(:, h)
      end do
      call condensation%end()
      call coordinates%motion_from(slope)
   end subroutine find_motion_slope
end module hb_motion_slope
