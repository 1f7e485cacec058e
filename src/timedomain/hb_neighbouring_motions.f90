!> Whether a motion attracts its neighbours: two time integrations that start close to each other, compared block by block.
!>
!> The neighbours of a steady motion approach it, those of a chaotic one part until they are as far from each other as two motions
!> can be, and stay apart. A long record shows neither: its lines may be too many for it, or not there. What grows for a while and
!> then decays is not taken for chaos. Source: A. Pikovsky and A. Politi, Lyapunov Exponents, Cambridge 2016, section 3.
module hb_neighbouring_motions
   use hb_error, only: error_t
   use hb_integration_config, only: integration_config_t
   use hb_integration_starts, only: scattered
   use hb_integration_system, only: integration_state_t, integration_system_t
   use hb_kinds, only: int64, wp
   use hb_time_stepping, only: early_end_t, integrate_from, integration_record_t
   implicit none
   private
   public :: compare_neighbours, neighbours, periods_of_comparison

   integer, parameter :: n_blocks = 10
   integer, parameter :: periods_of_block = 10               ! of the slowest tone
   integer, parameter :: periods_of_comparison = 2*n_blocks*periods_of_block !! that are integrated
   real(wp), parameter :: nearness = 1.0e-4_wp               ! at the start, relative to the motion: above errors of integration
   real(wp), parameter :: apart = 1.0e-2_wp                  ! in each block of the second half

   !> How the neighbours of a motion move.
   type :: neighbours_t
      integer :: undecided = 0, approach = 1, part = 2
   end type neighbours_t
   type(neighbours_t), parameter :: neighbours = neighbours_t()

contains

   !> Compares the motion from a state with one that starts beside it. The state is unchanged.
   subroutine compare_neighbours(equations, config, step, period, state, verdict)
      type(integration_system_t), intent(inout), target :: equations
      type(integration_config_t), intent(in) :: config
      real(wp), intent(in) :: step                           !! [s] between samples
      real(wp), intent(in) :: period                         !! [s] of the slowest tone
      type(integration_state_t), intent(in) :: state
      integer, intent(out) :: verdict                        !! one of `neighbours`
      type(integration_state_t) :: beside, here
      type(integration_record_t) :: other, record
      real(wp) :: distances(n_blocks)
      integer :: block, i

      verdict = neighbours%undecided
      here = state
      do block = 1, n_blocks
         call integrate(here, record)
         if (.not. allocated(record%every_displacement)) return
         if (block == 1) then
            beside = state
            beside%q = beside%q + nearness*[(scattered(i)*amplitude(record%every_displacement(:, i)), i=1, size(state%q))]
         end if
         call integrate(beside, other)
         if (.not. allocated(other%every_displacement)) return
         distances(block) = distance(record%every_displacement, other%every_displacement)
      end do
      if (all(distances(n_blocks/2 + 1:) >= apart)) verdict = neighbours%part
      if (distances(n_blocks) <= nearness .and. distances(n_blocks) < distances(1)) verdict = neighbours%approach

   contains

      subroutine integrate(from, into)
         type(integration_state_t), intent(inout) :: from
         type(integration_record_t), intent(out) :: into
         type(integration_config_t) :: of_block
         type(error_t), allocatable :: error

         of_block = config
         of_block%duration = periods_of_block*period
         of_block%max_evaluations = huge(1_int64)
         call integrate_from(equations, of_block, step, [(i, i=1, size(from%q))], from, into, error, early_end_t())
         if (allocated(error) .and. allocated(into%every_displacement)) deallocate (into%every_displacement)
      end subroutine integrate
   end subroutine compare_neighbours

   !> Root mean square about the mean value.
   pure real(wp) function amplitude(z)
      real(wp), intent(in) :: z(:)

      amplitude = norm2(z - sum(z)/size(z))/sqrt(real(size(z), wp))
   end function amplitude

   !> Root mean square of the difference, relative to the motion, of the degree of freedom where that is largest.
   pure real(wp) function distance(z, other) result(largest)
      real(wp), intent(in) :: z(:, :), other(:, :)           !! (n_samples, n_dofs)
      integer :: i

      largest = 0.0_wp
      do i = 1, size(z, 2)
         if (amplitude(z(:, i)) > 0.0_wp) &
            largest = max(largest, norm2(other(:, i) - z(:, i))/sqrt(real(size(z, 1), wp))/amplitude(z(:, i)))
      end do
   end function distance
end module hb_neighbouring_motions
