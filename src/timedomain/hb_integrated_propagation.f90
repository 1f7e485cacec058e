!> Propagation of disturbances along a motion of several tones by time integration, of the motion and of states on both sides of it.
!>
!> The time integration continues from period to period, and is only compared with the given motion, which it may leave.
module hb_integrated_propagation
   use hb_error, only: error_t
   use hb_exponents, only: orthogonalise, propagation_t
   use hb_integration_system, only: integration_system_t
   use hb_kinds, only: two_pi, wp
   use hb_motion_series, only: motion_series_t
   use hb_state_map, only: new_state_map, state_map_t
   implicit none
   private
   public :: integrated_propagation_t, new_integrated_propagation

   real(wp), parameter :: distance = 1.0e-5_wp ! of the time integrations beside the motion, scaled: kinks and jumps
                                                                      ! within it are rare, and rounding is small beside it
   integer, parameter :: fewest_steps = 200                           ! in a period of the fastest tone, where they are fixed
   real(wp), parameter :: same_motion = 0.1_wp ! farthest place of the time integration from the motion, scaled
   real(wp), parameter :: unmoved = 1.0e-9_wp                         ! change of a place that friction never lets go, scaled

   type, extends(propagation_t) :: integrated_propagation_t
      type(state_map_t) :: integration
      real(wp), private :: time = 0.0_wp                              ! [s]
      real(wp), allocatable, private :: x(:)                          ! state of the time integration, scaled
      real(wp), allocatable, private :: still(:, :)                   ! orthonormal, places held for ever, (size, any)
   contains
      procedure :: settle => integrated_propagation_settle
      procedure :: carry => integrated_propagation_carry
   end type integrated_propagation_t

contains

   !> Fails for laws that no method can follow.
   subroutine new_integrated_propagation(self, system, motion, restitution, tolerance, error)
      type(integrated_propagation_t), intent(out) :: self
      type(integration_system_t), intent(inout), target :: system     !! of all degrees of freedom
      type(motion_series_t), intent(in) :: motion                     !! of all degrees of freedom
      real(wp), intent(in) :: restitution                             !! of rigid walls
      real(wp), intent(in) :: tolerance                               !! of a period, relative
      type(error_t), allocatable, intent(out) :: error

      call new_state_map(self%integration, system, motion, restitution, tolerance, error)
      if (allocated(error)) return
      self%integration%fewest_steps = fewest_steps
      self%size = size(self%integration%scale)
      self%n_begun = 2*system%n_dofs
      self%n_followed = self%n_begun
      self%length = two_pi/minval(motion%omega)
      self%work = (2*self%n_followed + 1)*self%integration%work_of(1)
   end subroutine new_integrated_propagation

   !> From the motion on; what rigid friction holds all the time has its place taken out of the disturbances, which stay there.
   subroutine integrated_propagation_settle(self, n_periods, is_done)
      class(integrated_propagation_t), intent(inout) :: self
      integer, intent(in) :: n_periods
      logical, intent(out) :: is_done
      real(wp), allocatable :: begun(:), lost(:), places(:, :)
      logical, allocatable :: is_still(:)
      integer :: i, period

      associate (system => self%integration%system, rigid => self%integration%rigid, n => self%integration%system%n_dofs)
         allocate (places(self%size, size(rigid)), source=0.0_wp)
         do i = 1, size(rigid)
            places(:n, i) = system%laws%shape(:, rigid(i)%coordinate)*self%integration%scale(:n)
            places(:, i) = places(:, i)/norm2(places(:, i))
         end do
         is_still = .not. rigid%is_wall
      end associate
      self%time = -n_periods*self%length
      self%x = self%integration%state_at(self%time)
      do period = 1, n_periods
         begun = self%x
         call go_on(self, is_done)
         if (.not. is_done) return
         is_still = is_still .and. abs(matmul(self%x - begun, places)) <= unmoved
      end do
      self%still = places(:, pack([(i, i=1, size(is_still))], is_still))
      allocate (lost(size(self%still, 2)))
      call orthogonalise(self%still, lost)
      self%n_followed = self%n_begun - size(self%still, 2)
   end subroutine integrated_propagation_settle

   !> The time integration itself through the next period; not done where it leaves the motion.
   subroutine go_on(self, is_done)
      type(integrated_propagation_t), intent(inout) :: self
      logical, intent(out) :: is_done
      real(wp) :: after(self%size)

      call self%integration%carry(self%time, self%length, self%x, after, is_done)
      if (.not. is_done) return
      self%time = self%time + self%length
      self%x = after
      associate (n => self%integration%system%n_dofs, there => self%integration%state_at(self%time))
         is_done = maxval(abs(after(:n) - there(:n))) <= same_motion
      end associate
   end subroutine go_on

   subroutine integrated_propagation_carry(self, x, is_done)
      class(integrated_propagation_t), intent(inout) :: self
      real(wp), intent(inout), contiguous :: x(:, :)
      logical, intent(out) :: is_done
      real(wp) :: after(size(x, 1), size(x, 2))

      x = x - matmul(self%still, matmul(transpose(self%still), x))
      call self%integration%differences(self%time, self%length, self%x, distance, x, after, is_done)
      if (is_done) call go_on(self, is_done)
      if (is_done) x = after - matmul(self%still, matmul(transpose(self%still), after))
   end subroutine integrated_propagation_carry
end module hb_integrated_propagation
