!> The classical Runge-Kutta method of fourth order with a fixed step, on displacements and velocities.
!>
!> Explicit: the step must be below 2.8 divided by the largest frequency of the structure. A step in which a switch of
!> a law changes its sign is divided, so that kinks do not reduce the order; the onset of slip of sliders does.
!> Source: E. Hairer, S. P. Norsett and G. Wanner, Solving Ordinary Differential Equations I, 2nd edition, Springer
!> 1993, section II.1.
module hb_runge_kutta_4
   use hb_error, only: error_t, fail
   use hb_integration_system, only: integration_state_t, integration_system_t
   use hb_integrator, only: integrator_t
   use hb_kinds, only: wp
   implicit none
   private
   public :: new_runge_kutta_4, runge_kutta_4_t

   integer, parameter :: max_parts = 100, max_iterations = 100

   type, extends(integrator_t) :: runge_kutta_4_t
      real(wp), allocatable :: load_start(:), load_middle(:), load_end(:), a1(:), a2(:), a3(:), a4(:), q(:), v2(:), v3(:), v4(:)
      real(wp), allocatable :: q_start(:), v_start(:), s_start(:)
      real(wp), allocatable :: switch(:), switch_end(:)               !! of all laws, at the start and the end of a step
   contains
      procedure :: begin => runge_kutta_4_begin
      procedure :: take_step => runge_kutta_4_take_step
   end type runge_kutta_4_t

contains

   !> Fails for a singular mass or rigid laws.
   subroutine new_runge_kutta_4(self, system, step, error)
      type(runge_kutta_4_t), intent(out) :: self
      type(integration_system_t), intent(inout), target :: system
      real(wp), intent(in) :: step                                    !! [s], > 0
      type(error_t), allocatable, intent(out) :: error

      if (system%laws%has_rigid()) then
         call fail(error, "runge_kutta_4 does not support rigid walls or rigid friction; of the methods of integration "// &
                   "cvode and central_differences do")
         return
      end if
      call system%divide_by_mass(error)
      if (allocated(error)) return
      self%system => system
      self%step = step
      associate (n => system%n_dofs)
         allocate (self%load_start(n), self%load_middle(n), self%load_end(n))
         allocate (self%a1(n), self%a2(n), self%a3(n), self%a4(n), self%q(n))
         allocate (self%v2(n), self%v3(n), self%v4(n), self%q_start(n), self%v_start(n), self%s_start(system%laws%n_states))
      end associate
      allocate (self%switch(system%laws%n_switches), self%switch_end(system%laws%n_switches))
   end subroutine new_runge_kutta_4

   subroutine runge_kutta_4_begin(self, state, error)
      class(runge_kutta_4_t), intent(inout) :: self
      type(integration_state_t), intent(inout) :: state
      type(error_t), allocatable, intent(out) :: error

      call self%system%accelerations%begin(state%time, 0.5_wp*self%step)
      call self%system%accelerations%here(self%load_end)
      call self%system%laws%switch_values(state%time, state%q, state%v, self%switch)
   end subroutine runge_kutta_4_begin

   subroutine runge_kutta_4_take_step(self, time, time_after, state, error)
      class(runge_kutta_4_t), intent(inout) :: self
      real(wp), intent(in) :: time, time_after
      type(integration_state_t), intent(inout) :: state
      type(error_t), allocatable, intent(out) :: error

      associate (loads => self%system%accelerations)
         self%load_start = self%load_end
         if (size(loads%timed) > 0) then                             ! of this step, not of the last one
            call loads%act_within(time, time_after)
            call loads%here(self%load_start)
         end if
         call loads%step_on()
         call loads%here(self%load_middle)
         call loads%step_on()
         call loads%here(self%load_end)
         self%q_start = state%q
         self%v_start = state%v
         self%s_start = state%s
         call one_step(self, time, self%step, state%q, state%v, state%s)
         if (size(self%switch) == 0) return
         call self%system%laws%switch_values(time + self%step, state%q, state%v, self%switch_end)
         if (any(self%switch > 0.0_wp .neqv. self%switch_end > 0.0_wp)) then
            call split_step(self, time, state%q, state%v, state%s)
            call loads%here(self%load_end)
         else
            self%switch = self%switch_end
         end if
      end associate
   end subroutine runge_kutta_4_take_step

   !> One step of length h from a time on, with the loads at its start, middle and end.
   subroutine one_step(self, time, h, q, v, s)
      class(runge_kutta_4_t), intent(inout) :: self
      real(wp), intent(in) :: time                                    !! [s]
      real(wp), intent(in) :: h                                       !! [s]
      real(wp), intent(inout), contiguous :: q(:), v(:), s(:)

      associate (system => self%system, a1 => self%a1, a2 => self%a2, a3 => self%a3, a4 => self%a4, v2 => self%v2, &
                 v3 => self%v3, v4 => self%v4)
         call system%laws%start_step(time, q, v, s)
         a1 = self%load_start
         call system%accelerate(q, v, 0.0_wp, a1)

         self%q = q + 0.5_wp*h*v
         v2 = v + 0.5_wp*h*a1
         a2 = self%load_middle
         call system%accelerate(self%q, v2, 0.5_wp*h, a2)

         self%q = q + 0.5_wp*h*v2
         v3 = v + 0.5_wp*h*a2
         a3 = self%load_middle
         call system%accelerate(self%q, v3, 0.5_wp*h, a3)

         self%q = q + h*v3
         v4 = v + h*a3
         a4 = self%load_end
         call system%accelerate(self%q, v4, h, a4)

         q = q + h/6.0_wp*(v + 2.0_wp*(v2 + v3) + v4)
         v = v + h/6.0_wp*(a1 + 2.0_wp*(a2 + a3) + a4)
         if (system%laws%n_states == 0) return
         call system%laws%gather(q, v)
         call system%laws%evaluate(h)
         s = system%laws%s
      end associate
   end subroutine one_step

   !> The step from `time` on once more, in parts that end where a switch changes its sign: each is smooth, so the order stays.
   subroutine split_step(self, time, q, v, s)
      class(runge_kutta_4_t), intent(inout) :: self
      real(wp), intent(in) :: time                                    !! [s]
      real(wp), intent(out), contiguous :: q(:), v(:), s(:)
      real(wp) :: done, part
      integer :: i

      done = 0.0_wp
      do i = 1, max_parts
         part = self%step - done
         call advance_part(self, time + done, part, q, v, s)
         if (i < max_parts) call shorten_part(self, time + done, part, q, v, s)
         done = done + part
         self%switch = self%switch_end
         if (done >= self%step) return
         self%q_start = q
         self%v_start = v
         self%s_start = s
      end do
   end subroutine split_step

   !> Advances a part of a step from where the parts before ended.
   subroutine advance_part(self, time, part, q, v, s)
      class(runge_kutta_4_t), intent(inout) :: self
      real(wp), intent(in) :: time                                    !! at its start [s]
      real(wp), intent(in) :: part                                    !! [s]
      real(wp), intent(out), contiguous :: q(:), v(:), s(:)

      q = self%q_start
      v = self%v_start
      s = self%s_start
      call self%system%accelerations%at(time, self%load_start)
      call self%system%accelerations%at(time + 0.5_wp*part, self%load_middle)
      call self%system%accelerations%at(time + part, self%load_end)
      call one_step(self, time, part, q, v, s)
      call self%system%laws%switch_values(time + part, q, v, self%switch_end)
   end subroutine advance_part

   !> Makes the part end just behind the first change of a sign, by false position (Illinois).
   subroutine shorten_part(self, time, part, q, v, s)
      class(runge_kutta_4_t), intent(inout) :: self
      real(wp), intent(in) :: time                                    !! at its start [s]
      real(wp), intent(inout) :: part                                 !! [s]
      real(wp), intent(inout), contiguous :: q(:), v(:), s(:)         !! at its end
      real(wp) :: high, low, value_high, value_low
      integer :: changed, iteration, k

      k = first_changed(self%switch, self%switch_end)
      if (k == 0) return
      low = 0.0_wp
      value_low = self%switch(k)
      high = part
      value_high = self%switch_end(k)
      do iteration = 1, max_iterations
         if (high - low <= 4.0_wp*epsilon(1.0_wp)*self%step) exit
         part = (low*value_high - high*value_low)/(value_high - value_low)
         if (.not. (part > low .and. part < high)) part = 0.5_wp*(low + high)
         call advance_part(self, time, part, q, v, s)
         changed = first_changed(self%switch, self%switch_end)
         if (changed == 0) then
            if (low > 0.0_wp) value_high = 0.5_wp*value_high
            low = part
            value_low = self%switch_end(k)
            cycle
         end if
         if (changed == k) then
            value_low = 0.5_wp*value_low
         else
            k = changed                                               ! another one is earlier
            low = 0.0_wp
            value_low = self%switch(k)
         end if
         high = part
         value_high = self%switch_end(k)
         if (abs(value_high) <= 4.0_wp*epsilon(1.0_wp)*abs(self%switch(k))) exit
      end do
      part = high
      call advance_part(self, time, part, q, v, s)
   end subroutine shorten_part

   !> The switch that changes its sign first, by linear interpolation over a part; 0: none. One that starts at zero has its
   !> event behind it.
   pure integer function first_changed(switch_start, switch_end) result(first)
      real(wp), intent(in) :: switch_start(:), switch_end(:)
      real(wp) :: earliest, share
      integer :: k

      first = 0
      earliest = 2.0_wp
      do k = 1, size(switch_start)
         associate (before => switch_start(k), after => switch_end(k))
            if ((before > 0.0_wp .eqv. after > 0.0_wp) .or. .not. abs(before) > 0.0_wp) cycle
            share = before/(before - after)
            if (share >= earliest) cycle
            earliest = share
            first = k
         end associate
      end do
   end function first_changed
end module hb_runge_kutta_4
