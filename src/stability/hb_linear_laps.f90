!> Disturbances carried along a motion of several tones by its linearised equations.
!>
!> A phase of the motion's own can be shifted: such disturbances, known at each time, are taken out. Beside a slow tone a
!> disturbance may grow for a part of a lap and decay on the rest: laps are cut into parts to see how far it gets.
module hb_linear_laps
   use hb_exponents, only: laps_t, orthogonalise
   use hb_kinds, only: two_pi, wp
   use hb_koopman_hill, only: hill_t
   use hb_monodromy, only: find_transfer, monodromy_t, n_looks_of, work_of_transfer
   use hb_variation, only: piece_t, variation_t
   use hb_variation_pieces, only: cut_time
   use hb_watch, only: work_is_over
   implicit none
   private
   public :: linear_laps_t, new_linear_laps

   real(wp), parameter :: most_of_usual = 100.0_wp                    ! work of a lap
   integer, parameter :: turns_of_part = 4                            ! of the fastest tone, at least
   integer, parameter :: most_parts = 16                              ! of a lap

   type, extends(laps_t) :: linear_laps_t
      type(variation_t), pointer :: variation => null()
      complex(wp), allocatable :: shifts(:, :, :)                     !! by phases, as series in the tones, cos - i sin,
                                                                      !! (size, n_harmonics, n_shifts)
      real(wp) :: tolerance = 0.0_wp                                  !! of a lap, relative
      type(hill_t), allocatable :: hill                               !! follows them by Hill's problem, where there is one
      real(wp), private :: time = 0.0_wp                              ! [s]
      integer, private :: n_parts = 1                                 ! of a lap
      real(wp), private :: climb = 0.0_wp                             ! of the first disturbance from its last lowest point, in
                                                                      ! logarithms
   contains
      procedure :: settle => linear_laps_settle
      procedure :: carry => linear_laps_carry
   end type linear_laps_t

contains

   !> Disturbances of a motion but those that shift its own phases.
   subroutine new_linear_laps(self, variation, shifts, tolerance)
      type(linear_laps_t), intent(out) :: self
      type(variation_t), intent(inout), target :: variation
      complex(wp), intent(in) :: shifts(:, :, :)
      real(wp), intent(in) :: tolerance

      self%variation => variation
      self%shifts = shifts
      self%tolerance = tolerance
      self%size = variation%size
      self%n_begun = 2*variation%n_dofs
      self%n_followed = self%n_begun - size(shifts, 3)
      self%length = two_pi/minval(variation%motion%omega)
      associate (ratio => maxval(variation%motion%omega)/minval(variation%motion%omega))
         self%n_parts = max(1, int(min(real(most_parts, wp), ratio/turns_of_part)))
      end associate
      self%work = self%n_parts*work_of_transfer(variation, self%length/self%n_parts)
   end subroutine new_linear_laps

   !> Lets sliders find their places.
   subroutine linear_laps_settle(self, n_laps, is_done)
      class(linear_laps_t), intent(inout) :: self
      integer, intent(in) :: n_laps
      logical, intent(out) :: is_done
      type(piece_t), allocatable :: pieces(:)
      integer :: i

      is_done = .true.
      if (self%variation%n_states == 0) return
      do i = -n_laps, -1
         is_done = .not. work_is_over()
         if (.not. is_done) return
         call cut_time(self%variation, i*self%length, (i + 1)*self%length, n_looks_of(self%variation, self%length), pieces)
      end do
   end subroutine linear_laps_settle

   subroutine linear_laps_carry(self, x, is_done)
      class(linear_laps_t), intent(inout) :: self
      real(wp), intent(inout), contiguous :: x(:, :)
      logical, intent(out) :: is_done
      type(monodromy_t) :: part
      real(wp) :: before, length
      integer :: i

      is_done = .true.
      length = self%length/self%n_parts
      do i = 1, self%n_parts
         if (allocated(self%hill)) then
            call self%hill%transfer(self%time, length, self%tolerance, part%matrix, part%estimate)
         else
            call find_transfer(part, self%variation, self%time, self%time + length, self%tolerance, most_of_usual*self%work)
         end if
         before = norm2(x(:, 1))
         x = matmul(part%matrix, x)
         self%time = self%time + length
         call remove_shifts(self, x)
         self%climb = max(0.0_wp, self%climb + log(max(norm2(x(:, 1)), tiny(1.0_wp))/max(before, tiny(1.0_wp))))
         if (self%n_parts > 1) self%surge = max(self%surge, self%climb)
      end do
   end subroutine linear_laps_carry

   !> Takes out of disturbances what shifts phases of the motion.
   subroutine remove_shifts(self, x)
      type(linear_laps_t), intent(in) :: self
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
end module hb_linear_laps
