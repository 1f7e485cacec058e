!> The loads of a model in time: harmonic ones, and those with a course of their own, which begin and end.
module hb_integration_loads
   use hb_kinds, only: int64, wp
   use hb_load_course, only: timed_load_t
   implicit none
   private
   public :: append_courses, integration_loads_t, new_integration_loads

   integer(int64), parameter :: steps_between_cosines = 512_int64              ! rotation errors grow with the steps since

   !> Loads as functions of time, sum over tuples of Re(F_j exp(i j.omega t)), stepped by rotation of phasors; and loads with a
   !> course of their own, which act during a share of an interval that the integrator sets.
   type :: integration_loads_t
      integer :: n_active = 0
      real(wp), allocatable :: frequency(:)                           !! [rad/s], (n_active)
      real(wp), allocatable :: cosine(:, :), sine(:, :)               !! (n_dofs, n_active)
      complex(wp), allocatable :: phasor(:), rotation(:)              !! (n_active)
      real(wp) :: origin = 0.0_wp, step = 0.0_wp                      !! [s]
      integer(int64) :: n_steps = 0                                   !! since `origin`
      type(timed_load_t), allocatable :: timed(:)                     !! those with a course
      complex(wp), allocatable :: amplitude(:, :)                     !! theirs, cos - i sin, (n_dofs, size(timed))
      real(wp), allocatable :: share(:)                               !! of the present interval, (size(timed))
   contains
      procedure :: act_within => loads_act_within
      procedure :: add_courses => loads_add_courses
      procedure :: highest_frequency => loads_highest_frequency
      procedure :: next_edge => loads_next_edge
      procedure :: at => loads_at
      procedure :: after => loads_after
      procedure :: begin => loads_begin
      procedure :: step_on => loads_step_on
      procedure :: here => loads_here
   end type integration_loads_t

contains

   !> Stores the nonzero columns of amplitudes c = cos - i sin.
   subroutine new_integration_loads(self, amplitudes, frequencies)
      type(integration_loads_t), intent(out) :: self
      complex(wp), intent(in) :: amplitudes(:, :)                     !! (n_dofs, n_harmonics)
      real(wp), intent(in) :: frequencies(:)                          !! j.omega [rad/s], (n_harmonics)
      integer :: h
      logical :: is_active(size(frequencies))

      is_active = [(any(abs(amplitudes(:, h)) > 0.0_wp), h=1, size(frequencies))]
      self%n_active = count(is_active)
      self%frequency = pack(frequencies, is_active)
      allocate (self%cosine(size(amplitudes, 1), self%n_active), self%sine(size(amplitudes, 1), self%n_active))
      allocate (self%phasor(self%n_active), self%rotation(self%n_active))
      self%cosine = real(amplitudes(:, pack([(h, h=1, size(frequencies))], is_active)), wp)
      self%sine = -aimag(amplitudes(:, pack([(h, h=1, size(frequencies))], is_active)))
      allocate (self%timed(0), self%share(0), self%amplitude(size(amplitudes, 1), 0))
   end subroutine new_integration_loads

   !> Adds loads with a course.
   pure subroutine append_courses(self, timed)
      type(integration_loads_t), intent(inout) :: self
      type(timed_load_t), intent(in) :: timed(:)
      integer :: i, n_dofs

      n_dofs = size(self%amplitude, 1)
      deallocate (self%share, self%amplitude)
      self%timed = timed
      allocate (self%share(size(timed)), source=0.0_wp)
      allocate (self%amplitude(n_dofs, size(timed)))
      do i = 1, size(timed)
         self%amplitude(:, i) = timed(i)%amplitude
      end do
   end subroutine append_courses

   !> Sets an interval: each load with a course acts there with the share of it during which it is on, so that a step takes its
   !> whole impulse.
   pure subroutine loads_act_within(self, from, to)
      class(integration_loads_t), intent(inout) :: self
      real(wp), intent(in) :: from, to                                !! [s], ascending
      integer :: k

      do k = 1, size(self%timed)
         self%share(k) = self%timed(k)%course%share(from, to)
      end do
   end subroutine loads_act_within

   !> Adds the loads with a course.
   pure subroutine loads_add_courses(self, time, values)
      class(integration_loads_t), intent(in) :: self
      real(wp), intent(in) :: time                                    !! [s]
      real(wp), intent(inout) :: values(:)                            !! (n_dofs)
      complex(wp) :: factor
      integer :: k

      do k = 1, size(self%timed)
         if (.not. self%share(k) > 0.0_wp) cycle
         factor = self%share(k)*self%timed(k)%course%factor(time)
         values = values + real(factor*self%amplitude(:, k), wp)
      end do
   end subroutine loads_add_courses

   !> Highest frequency of all loads [rad/s]; 0 without loads.
   pure real(wp) function loads_highest_frequency(self) result(highest)
      class(integration_loads_t), intent(in) :: self
      integer :: k

      highest = maxval([0.0_wp, abs(self%frequency)])
      do k = 1, size(self%timed)
         highest = max(highest, self%timed(k)%course%highest_frequency())
      end do
   end function loads_highest_frequency

   !> The first time after another one at which a load begins or ends; huge: none.
   pure real(wp) function loads_next_edge(self, time) result(edge)
      class(integration_loads_t), intent(in) :: self
      real(wp), intent(in) :: time                                    !! [s]
      integer :: k

      edge = huge(1.0_wp)
      do k = 1, size(self%timed)
         if (self%timed(k)%course%begin > time) edge = min(edge, self%timed(k)%course%begin)
         if (self%timed(k)%course%end > time) edge = min(edge, self%timed(k)%course%end)
      end do
   end function loads_next_edge

   !> Value at any time.
   pure subroutine loads_at(self, time, values)
      class(integration_loads_t), intent(in) :: self
      real(wp), intent(in) :: time                                    !! [s]
      real(wp), intent(out) :: values(:)                              !! (n_dofs)
      real(wp) :: phase
      integer :: k

      values = 0.0_wp
      do k = 1, self%n_active
         phase = self%frequency(k)*time
         values = values + cos(phase)*self%cosine(:, k) + sin(phase)*self%sine(:, k)
      end do
      if (size(self%timed) > 0) call self%add_courses(time, values)
   end subroutine loads_at

   !> Value some time after the one given to `begin`. Phases of long times are computed once, not at each call.
   pure subroutine loads_after(self, elapsed, values)
      class(integration_loads_t), intent(in) :: self
      real(wp), intent(in) :: elapsed                                 !! [s]
      real(wp), intent(out) :: values(:)                              !! (n_dofs)
      complex(wp) :: phasor
      integer :: k

      values = 0.0_wp
      do k = 1, self%n_active
         phasor = self%phasor(k)*cmplx(cos(self%frequency(k)*elapsed), sin(self%frequency(k)*elapsed), wp)
         values = values + real(phasor, wp)*self%cosine(:, k) + aimag(phasor)*self%sine(:, k)
      end do
      if (size(self%timed) > 0) call self%add_courses(self%origin + elapsed, values)
   end subroutine loads_after

   !> Prepares equal steps from a given time.
   pure subroutine loads_begin(self, time, step)
      class(integration_loads_t), intent(inout) :: self
      real(wp), intent(in) :: time, step                              !! [s]

      self%origin = time
      self%step = step
      self%n_steps = 0_int64
      self%rotation = cmplx(cos(self%frequency*step), sin(self%frequency*step), wp)
      self%phasor = cmplx(cos(self%frequency*time), sin(self%frequency*time), wp)
   end subroutine loads_begin

   !> Advances by one step.
   pure subroutine loads_step_on(self)
      class(integration_loads_t), intent(inout) :: self
      real(wp) :: time

      self%n_steps = self%n_steps + 1_int64
      if (modulo(self%n_steps, steps_between_cosines) == 0_int64) then
         time = self%origin + self%n_steps*self%step
         self%phasor = cmplx(cos(self%frequency*time), sin(self%frequency*time), wp)
      else
         self%phasor = self%phasor*self%rotation
      end if
   end subroutine loads_step_on

   !> Value at the present step.
   pure subroutine loads_here(self, values)
      class(integration_loads_t), intent(in) :: self
      real(wp), intent(out), contiguous :: values(:)                  !! (n_dofs)
      real(wp) :: c, s
      integer :: i, k

      values = 0.0_wp
      do k = 1, self%n_active
         c = real(self%phasor(k), wp)
         s = aimag(self%phasor(k))
         do i = 1, size(values)
            values(i) = values(i) + c*self%cosine(i, k) + s*self%sine(i, k)
         end do
      end do
      if (size(self%timed) > 0) call self%add_courses(self%origin + self%n_steps*self%step, values)
   end subroutine loads_here
end module hb_integration_loads
