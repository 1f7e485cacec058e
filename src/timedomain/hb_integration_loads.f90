!> Loads as functions of time, sum over tuples of Re(F_j exp(i j.omega t)), stepped by rotation of phasors.
module hb_integration_loads
   use hb_kinds, only: int64, wp
   implicit none
   private
   public :: integration_loads_t, new_integration_loads

   integer(int64), parameter :: steps_between_cosines = 512_int64              ! rotation errors grow with the steps since

   type :: integration_loads_t
      integer :: n_active = 0
      real(wp), allocatable :: frequency(:)                           !! [rad/s], (n_active)
      real(wp), allocatable :: cosine(:, :), sine(:, :)               !! (n_dofs, n_active)
      complex(wp), allocatable :: phasor(:), rotation(:)              !! (n_active)
      real(wp) :: origin = 0.0_wp, step = 0.0_wp                      !! [s]
      integer(int64) :: n_steps = 0                                   !! since `origin`
   contains
      procedure :: at => loads_at
      procedure :: after => loads_after
      procedure :: begin => loads_begin
      procedure :: go_on => loads_go_on
      procedure :: here => loads_here
   end type integration_loads_t

contains

   !> Keeps the columns that are not zero of amplitudes c = cos - i sin.
   pure subroutine new_integration_loads(self, amplitudes, frequencies)
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
   end subroutine new_integration_loads

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
   end subroutine loads_at

   !> Value some time after the one given to `begin`. Phases of long times are taken once, not at each call.
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
   end subroutine loads_after

   !> Prepares equal steps from a time on.
   pure subroutine loads_begin(self, time, step)
      class(integration_loads_t), intent(inout) :: self
      real(wp), intent(in) :: time, step                              !! [s]

      self%origin = time
      self%step = step
      self%n_steps = 0_int64
      self%rotation = cmplx(cos(self%frequency*step), sin(self%frequency*step), wp)
      self%phasor = cmplx(cos(self%frequency*time), sin(self%frequency*time), wp)
   end subroutine loads_begin

   !> One step on.
   pure subroutine loads_go_on(self)
      class(integration_loads_t), intent(inout) :: self
      real(wp) :: time

      self%n_steps = self%n_steps + 1_int64
      if (modulo(self%n_steps, steps_between_cosines) == 0_int64) then
         time = self%origin + self%n_steps*self%step
         self%phasor = cmplx(cos(self%frequency*time), sin(self%frequency*time), wp)
      else
         self%phasor = self%phasor*self%rotation
      end if
   end subroutine loads_go_on

   !> Value where the steps are.
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
   end subroutine loads_here
end module hb_integration_loads
