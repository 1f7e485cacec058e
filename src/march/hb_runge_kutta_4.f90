!> The classical Runge-Kutta method of fourth order with a fixed step, on displacements and velocities.
!>
!> Explicit: the step must stay below 2.8 divided by the largest frequency of the structure. Kinks of a law within a
!> step cost order. Source: E. Hairer, S. P. Norsett and G. Wanner, Solving Ordinary Differential Equations I, 2nd
!> edition, Springer 1993, section II.1.
module hb_runge_kutta_4
   use hb_error, only: error_t, fail
   use hb_integrator, only: integrator_t
   use hb_kinds, only: int64, wp
   use hb_march_state, only: march_state_t
   use hb_march_system, only: march_system_t
   implicit none
   private
   public :: new_runge_kutta_4, runge_kutta_4_t

   type, extends(integrator_t) :: runge_kutta_4_t
      real(wp) :: step = 0.0_wp                                       !! [s]
      real(wp) :: origin = 0.0_wp                                     !! [s] where it started
      integer(int64) :: n_steps = 0_int64                             !! since then
      real(wp), allocatable :: load(:), a1(:), a2(:), a3(:), a4(:), q(:), v2(:), v3(:), v4(:)
   contains
      procedure :: start => runge_kutta_4_start
      procedure :: advance => runge_kutta_4_advance
   end type runge_kutta_4_t

contains

   !> Fails for a singular mass or rigid laws.
   subroutine new_runge_kutta_4(self, system, step, error)
      type(runge_kutta_4_t), intent(out) :: self
      type(march_system_t), intent(inout), target :: system
      real(wp), intent(in) :: step                                    !! [s], > 0
      type(error_t), allocatable, intent(out) :: error

      if (system%laws%has_rigid()) then
         call fail(error, "runge_kutta_4 cannot hold rigid walls or rigid friction; of the methods of &march cvode and "// &
                   "central_differences can")
         return
      end if
      call system%divide_by_mass(error)
      if (allocated(error)) return
      self%system => system
      self%step = step
      associate (n => system%n_dofs)
         allocate (self%load(n), self%a1(n), self%a2(n), self%a3(n), self%a4(n), self%q(n))
         allocate (self%v2(n), self%v3(n), self%v4(n))
      end associate
   end subroutine new_runge_kutta_4

   subroutine runge_kutta_4_start(self, state, error)
      class(runge_kutta_4_t), intent(inout) :: self
      type(march_state_t), intent(in) :: state
      type(error_t), allocatable, intent(out) :: error

      self%origin = state%time
      self%n_steps = 0_int64
      call self%system%accelerations%begin(state%time, 0.5_wp*self%step)
      call self%system%accelerations%here(self%load)
   end subroutine runge_kutta_4_start

   subroutine runge_kutta_4_advance(self, state, n_steps, error)
      class(runge_kutta_4_t), intent(inout) :: self
      type(march_state_t), intent(inout) :: state
      integer, intent(in) :: n_steps
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      associate (system => self%system, h => self%step, q => state%q, v => state%v, load => self%load, a1 => self%a1, &
                 a2 => self%a2, a3 => self%a3, a4 => self%a4, v2 => self%v2, v3 => self%v3, v4 => self%v4)
         do i = 1, n_steps
            call system%laws%start_step(q, v, state%s)
            a1 = load
            call system%accelerate(q, v, 0.0_wp, a1)

            call system%accelerations%go_on()
            call system%accelerations%here(load)
            self%q = q + 0.5_wp*h*v
            v2 = v + 0.5_wp*h*a1
            a2 = load
            call system%accelerate(self%q, v2, 0.5_wp*h, a2)

            self%q = q + 0.5_wp*h*v2
            v3 = v + 0.5_wp*h*a2
            a3 = load
            call system%accelerate(self%q, v3, 0.5_wp*h, a3)

            call system%accelerations%go_on()
            call system%accelerations%here(load)
            self%q = q + h*v3
            v4 = v + h*a3
            a4 = load
            call system%accelerate(self%q, v4, h, a4)

            q = q + h/6.0_wp*(v + 2.0_wp*(v2 + v3) + v4)
            v = v + h/6.0_wp*(a1 + 2.0_wp*(a2 + a3) + a4)
            if (system%laws%n_states == 0) cycle
            call system%laws%gather(q, v)
            call system%laws%evaluate(h)
            state%s = system%laws%s
         end do
      end associate
      self%n_steps = self%n_steps + n_steps
      state%time = self%origin + self%n_steps*self%step
   end subroutine runge_kutta_4_advance
end module hb_runge_kutta_4
