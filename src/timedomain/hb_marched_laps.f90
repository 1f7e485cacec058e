!> Disturbances carried along a motion of several tones by marching: from the motion on, and from both sides of it.
!>
!> The march goes on from lap to lap, and the motion given is only held against it: one that it leaves is another one.
module hb_marched_laps
   use hb_error, only: error_t
   use hb_exponents, only: laps_t, orthogonalise
   use hb_kinds, only: two_pi, wp
   use hb_march_system, only: march_system_t
   use hb_motion_series, only: motion_series_t
   use hb_state_map, only: new_state_map, state_map_t
   implicit none
   private
   public :: marched_laps_t, new_marched_laps

   real(wp), parameter :: distance = 1.0e-5_wp                        ! of the marches beside the motion, scaled: kinks and jumps
                                                                      ! within it are rare, and rounding is small beside it
   integer, parameter :: fewest_steps = 200                           ! in a period of the fastest tone, where they are fixed
   real(wp), parameter :: same_motion = 0.1_wp                        ! farthest place of the march from the motion, scaled
   real(wp), parameter :: unmoved = 1.0e-9_wp                         ! change of a place that friction never lets go, scaled

   type, extends(laps_t) :: marched_laps_t
      type(state_map_t) :: march
      real(wp), private :: time = 0.0_wp                              ! [s]
      real(wp), allocatable, private :: x(:)                          ! state of the march, scaled
      real(wp), allocatable, private :: still(:, :)                   ! orthonormal, places held for ever, (size, any)
   contains
      procedure :: settle => marched_laps_settle
      procedure :: carry => marched_laps_carry
   end type marched_laps_t

contains

   !> Fails for laws that no method can follow.
   subroutine new_marched_laps(self, system, motion, restitution, tolerance, error)
      type(marched_laps_t), intent(out) :: self
      type(march_system_t), intent(inout), target :: system           !! of all degrees of freedom
      type(motion_series_t), intent(in) :: motion                     !! of all degrees of freedom
      real(wp), intent(in) :: restitution                             !! of rigid walls
      real(wp), intent(in) :: tolerance                               !! of a lap, relative
      type(error_t), allocatable, intent(out) :: error

      call new_state_map(self%march, system, motion, restitution, tolerance, error)
      if (allocated(error)) return
      self%march%fewest_steps = fewest_steps
      self%size = size(self%march%scale)
      self%n_begun = 2*system%n_dofs
      self%n_followed = self%n_begun
      self%length = two_pi/minval(motion%omega)
      self%work = (2*self%n_followed + 1)*self%march%work_of(1)
   end subroutine new_marched_laps

   !> From the motion on; what rigid friction holds all the time has its place taken out of the disturbances, which stay there.
   subroutine marched_laps_settle(self, n_laps, is_done)
      class(marched_laps_t), intent(inout) :: self
      integer, intent(in) :: n_laps
      logical, intent(out) :: is_done
      real(wp), allocatable :: begun(:), lost(:), places(:, :)
      logical, allocatable :: is_still(:)
      integer :: i, lap

      associate (system => self%march%system, rigid => self%march%rigid, n => self%march%system%n_dofs)
         allocate (places(self%size, size(rigid)), source=0.0_wp)
         do i = 1, size(rigid)
            places(:n, i) = system%laws%shape(:, rigid(i)%coordinate)*self%march%scale(:n)
            places(:, i) = places(:, i)/norm2(places(:, i))
         end do
         is_still = .not. rigid%is_wall
      end associate
      self%time = -n_laps*self%length
      self%x = self%march%state_at(self%time)
      do lap = 1, n_laps
         begun = self%x
         call go_on(self, is_done)
         if (.not. is_done) return
         is_still = is_still .and. abs(matmul(self%x - begun, places)) <= unmoved
      end do
      self%still = places(:, pack([(i, i=1, size(is_still))], is_still))
      allocate (lost(size(self%still, 2)))
      call orthogonalise(self%still, lost)
      self%n_followed = self%n_begun - size(self%still, 2)
   end subroutine marched_laps_settle

   !> The march itself through the next lap; not done where it leaves the motion.
   subroutine go_on(self, is_done)
      type(marched_laps_t), intent(inout) :: self
      logical, intent(out) :: is_done
      real(wp) :: after(self%size)

      call self%march%carry(self%time, self%length, self%x, after, is_done)
      if (.not. is_done) return
      self%time = self%time + self%length
      self%x = after
      associate (n => self%march%system%n_dofs, there => self%march%state_at(self%time))
         is_done = maxval(abs(after(:n) - there(:n))) <= same_motion
      end associate
   end subroutine go_on

   subroutine marched_laps_carry(self, x, is_done)
      class(marched_laps_t), intent(inout) :: self
      real(wp), intent(inout), contiguous :: x(:, :)
      logical, intent(out) :: is_done
      real(wp) :: after(size(x, 1), size(x, 2))

      x = x - matmul(self%still, matmul(transpose(self%still), x))
      call self%march%differences(self%time, self%length, self%x, distance, x, after, is_done)
      if (is_done) call go_on(self, is_done)
      if (is_done) x = after - matmul(self%still, matmul(transpose(self%still), after))
   end subroutine marched_laps_carry
end module hb_marched_laps
