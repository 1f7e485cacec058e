!> Distance of a motion from the kinks of its laws: the smallest and the largest value of each switch of a law, such as the
!> distance to a stop, over all phases.
module hb_switch_extremes
   use hb_kinds, only: wp
   use hb_law, only: law_box_t, law_t
   use hb_motion_series, only: motion_series_t, new_motion_series
   use hb_torus_extremes, only: new_phase_grid, phase_functions_t, phase_grid_t
   implicit none
   private
   public :: extremes_of_switches

   !> The switches of a law along a motion.
   type, extends(phase_functions_t) :: switches_t
      class(law_t), pointer :: law => null()
      type(motion_series_t) :: motion
   contains
      procedure :: evaluate => switches_evaluate
   end type switches_t

contains

   !> Extremes of all switches, (2, switches of all laws): smallest, largest.
   subroutine extremes_of_switches(laws, tuples, omega, amplitudes, extremes)
      type(law_box_t), intent(inout), target :: laws(:)               !! phases are set for laws that rotate
      integer, intent(in) :: tuples(:, :)                             !! (n_tones, n_harmonics)
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones)
      complex(wp), intent(in) :: amplitudes(:, :)                     !! cos - i sin, (n_dofs, n_harmonics)
      real(wp), allocatable, intent(out) :: extremes(:, :)
      type(phase_grid_t) :: grid
      type(switches_t) :: switches
      real(wp), allocatable :: of_law(:, :)                           ! (2, its switches)
      integer :: i, n

      allocate (extremes(2, sum([(laws(i)%law%n_switches, i=1, size(laws))])))
      if (size(extremes, 2) == 0) return
      call new_phase_grid(grid, tuples)
      n = 0
      do i = 1, size(laws)
         associate (law => laws(i)%law)
            if (law%n_switches == 0) cycle
            call new_motion_series(switches%motion, tuples, omega, matmul(transpose(law%shape), amplitudes(law%dofs, :)))
            switches%law => laws(i)%law
            call grid%find_extremes(switches, of_law)
            extremes(:, n + 1:n + law%n_switches) = of_law
            n = n + law%n_switches
         end associate
      end do
   end subroutine extremes_of_switches

   !> Values of all switches of the law, (n_switches, n_phases).
   subroutine switches_evaluate(self, phases, values)
      class(switches_t), intent(inout) :: self
      real(wp), intent(in) :: phases(:, :)
      real(wp), allocatable, intent(out) :: values(:, :)
      real(wp) :: v(size(phases, 2), self%motion%n_coordinates), z(size(phases, 2), self%motion%n_coordinates)
      integer :: i

      call self%motion%at(phases, z, v)
      associate (law => self%law)
         allocate (values(law%n_switches, size(phases, 2)))
         do i = 1, size(phases, 2)
            if (law%n_phases > 0) call law%set_phases(phases(:, i:i))
            call law%switches(z(i, :), v(i, :), values(:, i))
         end do
      end associate
   end subroutine switches_evaluate
end module hb_switch_extremes
