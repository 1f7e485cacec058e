!> Propagation of disturbances along a motion of several tones by its linearised equations.
!>
!> The motion can be shifted in the phase of an unknown tone: such disturbances, known at each time, are removed.
!> Beside a slow tone a disturbance may grow for a part of a period and decay on the rest: periods are divided into
!> parts to record the largest growth.
module hb_linear_propagation
   use hb_beat, only: slowest_beat
   use hb_cancellation, only: work_is_over
   use hb_exponents, only: orthogonalise, propagation_t
   use hb_kinds, only: two_pi, wp
   use hb_monodromy, only: find_transfer, monodromy_t, n_instants_of, work_of_transfer
   use hb_variation, only: piece_t, variation_t
   use hb_variation_pieces, only: cut_time
   implicit none
   private
   public :: linear_propagation_t, new_linear_propagation

   integer, parameter :: turns_of_part = 4                            ! of the fastest tone
   real(wp), parameter :: turns_of_slow_phase = 2*turns_of_part       ! of the slowest tone, in a slow beat

   type, extends(propagation_t) :: linear_propagation_t
      type(variation_t), pointer :: variation => null()
      complex(wp), allocatable :: shifts(:, :, :)                     !! by phases, as series in the tones, cos - i sin,
                                                                      !! (size, n_harmonics, n_shifts)
      real(wp) :: tolerance = 0.0_wp                                  !! of a period, relative
      real(wp), private :: time = 0.0_wp                              ! [s]
      integer, private :: n_parts = 1                                 ! of a period
      logical :: has_slow_phase = .false.                             !! a slow tone or beat: `surge` is recorded
      real(wp), private :: refine = 0.0_wp                            ! logarithm of the growth of the first disturbance since
                                                                      !! its last minimum
   contains
      procedure :: reach_steady_state => linear_propagation_reach_steady_state
      procedure :: propagate => linear_propagation_propagate
   end type linear_propagation_t

contains

   !> Disturbances of a motion, except those that shift its own phases.
   subroutine new_linear_propagation(self, variation, shifts, tolerance)
      type(linear_propagation_t), intent(out) :: self
      type(variation_t), intent(inout), target :: variation
      complex(wp), intent(in) :: shifts(:, :, :)
      real(wp), intent(in) :: tolerance

      self%variation => variation
      self%shifts = shifts
      self%tolerance = tolerance
      self%size = variation%size
      self%n_begun = 2*variation%n_dofs
      self%n_followed = self%n_begun - size(shifts, 3)
      if (allocated(variation%massless)) self%n_followed = self%n_followed - count(variation%massless%is_inert)
      self%length = two_pi/minval(variation%motion%omega)
      associate (ratio => maxval(variation%motion%omega)/minval(variation%motion%omega))
         self%n_parts = max(1, int(ratio/turns_of_part))
      end associate
      associate (motion => variation%motion)
         self%has_slow_phase = self%n_parts > 1 .or. turns_of_slow_phase*slowest_beat(motion%tuples, motion%omega, &
                                                                                    motion%amplitudes) < minval(motion%omega)
      end associate
      self%work = self%n_parts*work_of_transfer(variation, self%length/self%n_parts)
   end subroutine new_linear_propagation

   !> Advances until sliders are periodic.
   subroutine linear_propagation_reach_steady_state(self, n_periods, is_done)
      class(linear_propagation_t), intent(inout) :: self
      integer, intent(in) :: n_periods
      logical, intent(out) :: is_done
      type(piece_t), allocatable :: pieces(:)
      integer :: i

      is_done = .true.
      if (self%variation%n_states == 0) return
      do i = -n_periods, -1
         is_done = .not. work_is_over()
         if (.not. is_done) return
         call cut_time(self%variation, i*self%length, (i + 1)*self%length, n_instants_of(self%variation, self%length), pieces)
      end do
   end subroutine linear_propagation_reach_steady_state

   subroutine linear_propagation_propagate(self, x, is_done)
      class(linear_propagation_t), intent(inout) :: self
      real(wp), intent(inout), contiguous :: x(:, :)
      logical, intent(out) :: is_done
      type(monodromy_t) :: part
      real(wp) :: before, length
      integer :: i

      is_done = .true.
      length = self%length/self%n_parts
      do i = 1, self%n_parts
         call find_transfer(part, self%variation, self%time, self%time + length, self%tolerance, &
                            max(self%work, self%work_left))
         self%work_left = self%work_left - part%work
         if (allocated(self%variation%massless)) call remove_inert(self%variation%massless%is_inert, x)
         before = self%variation%size_of(x(:, 1))
         x = matmul(part%matrix, x)
         self%time = self%time + length
         call remove_shifts(self, x)
         self%refine = max(0.0_wp, self%refine + log(max(self%variation%size_of(x(:, 1)), tiny(1.0_wp))/ &
                                                   max(before, tiny(1.0_wp))))
         if (self%has_slow_phase) self%surge = max(self%surge, self%refine)
      end do
   end subroutine linear_propagation_propagate

   !> Removes the states that are none of degrees of freedom without mass: a part of the starting directions.
   pure subroutine remove_inert(is_inert, x)
      logical, intent(in) :: is_inert(:)
      real(wp), intent(inout) :: x(:, :)
      integer :: k

      do k = 1, size(is_inert)
         if (is_inert(k)) x(k, :) = 0.0_wp
      end do
   end subroutine remove_inert

   !> Removes shifts of the phases of the motion from disturbances.
   subroutine remove_shifts(self, x)
      type(linear_propagation_t), intent(in) :: self
      real(wp), intent(inout) :: x(:, :)
      real(wp) :: basis(size(x, 1), size(self%shifts, 3)), lost(size(self%shifts, 3)), waves(2, size(self%shifts, 2))
      integer :: k

      if (size(self%shifts, 3) == 0) return
      waves(1, :) = cos(self%variation%motion%frequencies*self%time)
      waves(2, :) = sin(self%variation%motion%frequencies*self%time)
      do k = 1, size(self%shifts, 3)
         basis(:, k) = matmul(real(self%shifts(:, :, k)), waves(1, :)) - matmul(aimag(self%shifts(:, :, k)), waves(2, :))
      end do
      call orthogonalise(basis, lost)
      x = x - matmul(basis, matmul(transpose(basis), x))
   end subroutine remove_shifts
end module hb_linear_propagation
