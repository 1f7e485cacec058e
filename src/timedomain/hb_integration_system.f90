!> The equations of motion of a model in time, M q'' + D q' + K q + S f(z, z', states) = F(t), z = S^T q.
!>
!> Laws and structure are those of the model; no series, transform or balance is used, so that time integration can
!> verify them.
!>
!> The abstract integrator: steps of constant size from a given state.
module hb_integration_system
   use hb_error, only: error_t, fail
   use hb_integration_laws, only: integration_laws_t, new_integration_laws
   use hb_kinds, only: int64, wp
   use hb_lapack, only: dpotrs
   use hb_law, only: law_box_t
   use hb_load_course, only: load_course_t, timed_load_t
   use hb_structure, only: structure_t
   implicit none
   private
   public :: integration_matrix_t, integration_state_t, integration_system_t, integrator_t, law_forces, &
      new_integration_matrix, new_integration_state, new_integration_system

   !> The state from which a time integration continues: everything on which the future motion depends.
   type :: integration_state_t
      real(wp) :: time = 0.0_wp                                       !! [s]
      real(wp), allocatable :: q(:)                                   !! displacements [m], (n_dofs)
      real(wp), allocatable :: v(:)                                   !! velocities [m/s], (n_dofs)
      real(wp), allocatable :: s(:)                                   !! states of all laws with memory, (n_states)
   end type integration_state_t

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
      type(load_course_t), allocatable :: course(:)                   !! of the loads with one, (n_courses)
      complex(wp), allocatable :: amplitude(:, :)                     !! cos - i sin, (n_dofs, n_courses)
      real(wp), allocatable :: share(:)                               !! of the present interval, (n_courses)
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

   !> A square matrix for many multiplications: by its nonzero entries if they are few, otherwise dense.
   type :: integration_matrix_t
      integer :: n = 0
      logical :: is_sparse = .false.
      real(wp), allocatable :: entries(:, :)                          !! (n, n) unless sparse
      integer, allocatable :: first(:)                                !! (n + 1) first entry of each column
      integer, allocatable :: row(:)
      real(wp), allocatable :: value(:)
   contains
      procedure :: subtract_product => matrix_subtract_product
   end type integration_matrix_t

   type :: integration_system_t
      integer :: n_dofs = 0
      type(structure_t) :: structure
      type(integration_laws_t) :: laws
      type(integration_loads_t) :: loads                              !! F [N]
      real(wp) :: length = 0.0_wp                                     !! typical displacement [m]
      logical :: lists_impacts = .false.                              !! with times and changes of velocity
      ! The following are divided by the mass, and only available after `divide_by_mass`
      type(integration_matrix_t) :: damping, stiffness                !! M^-1 D [1/s], M^-1 K [1/s**2]
      real(wp), allocatable :: shape(:, :)                            !! M^-1 S [1/kg], (n_dofs, n_coordinates)
      type(integration_loads_t) :: accelerations                      !! M^-1 F [m/s**2]
   contains
      procedure :: divide_by_mass => system_divide_by_mass
      procedure :: accelerate => system_accelerate
   end type integration_system_t

   !> Steps of one size from a state on.
   type, abstract :: integrator_t
      type(integration_system_t), pointer :: system => null()
      real(wp) :: step = 0.0_wp                                       !! [s]
      real(wp) :: origin = 0.0_wp                                     !! [s] where it started
      integer(int64) :: n_steps = 0_int64                             !! since then
      integer, allocatable :: impacts(:)                              !! since then, on both sides of each rigid law; negative
                                                                      !! once bounces have ended in contact
      real(wp), allocatable :: impact_times(:)                        !! [s], if they are to be listed: allocated at first
      real(wp), allocatable :: impact_jumps(:, :)                     !! changes of velocity there [m/s], (n_dofs, n_listed)
   contains
      procedure :: start => integrator_start
      procedure :: advance => integrator_advance
      procedure(begin_integration), deferred :: begin
      procedure :: resume => integrator_resume
      procedure(take_one_step), deferred :: take_step
      procedure :: read_state => integrator_read_state
      procedure :: forces => integrator_forces
      procedure :: destroy => integrator_destroy
   end type integrator_t

   abstract interface
      !> Sets the first state; coordinates behind a rigid wall are moved onto it.
      subroutine begin_integration(self, state, error)
         import :: error_t, integrator_t, integration_state_t
         class(integrator_t), intent(inout) :: self
         type(integration_state_t), intent(inout) :: state
         type(error_t), allocatable, intent(out) :: error
      end subroutine begin_integration

      !> Takes one step between two times; `state` may be brought up to it by `read_state` alone.
      subroutine take_one_step(self, time, time_after, state, error)
         import :: error_t, integrator_t, integration_state_t, wp
         class(integrator_t), intent(inout) :: self
         real(wp), intent(in) :: time, time_after                     !! [s]
         type(integration_state_t), intent(inout) :: state
         type(error_t), allocatable, intent(out) :: error
      end subroutine take_one_step
   end interface

contains

   !> System from the parts of a model.
   subroutine new_integration_system(self, structure, laws, loads, frequencies, omega, timed)
      type(integration_system_t), intent(out) :: self
      type(structure_t), intent(in) :: structure
      type(law_box_t), intent(in) :: laws(:)
      complex(wp), intent(in) :: loads(:, :)                          !! cos - i sin [N], (n_dofs, n_harmonics)
      real(wp), intent(in) :: frequencies(:)                          !! j.omega [rad/s], (n_harmonics)
      real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s]
      type(timed_load_t), intent(in), optional :: timed(:)            !! further loads
      real(wp) :: highest                                             ! frequency of the loads [rad/s]
      integer :: i

      self%n_dofs = structure%n_dofs
      self%structure = structure
      call self%structure%unpack()
      call new_integration_laws(self%laws, laws, structure%n_dofs, omega)
      call new_integration_loads(self%loads, loads, frequencies)
      if (present(timed)) call append_courses(self%loads, timed)
      do i = 1, size(laws)
         self%length = max(self%length, laws(i)%law%length_scale)
      end do
      highest = self%loads%highest_frequency()
      do i = 1, structure%n_dofs
         associate (k => abs(self%structure%stiffness(i, i)) + highest**2*self%structure%mass(i, i))
            if (k > 0.0_wp) self%length = max(self%length, (sum(abs(loads(i, :))) + sum(abs(self%loads%amplitude(i, :))))/k)
         end associate
      end do
   end subroutine new_integration_system

   !> Computes the data for `accelerate`; fails for a singular mass.
   subroutine system_divide_by_mass(self, error)
      class(integration_system_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: factor(:, :), imaginary_part(:, :), real_part(:, :), right(:, :)
      integer :: info, n

      n = self%n_dofs
      call self%structure%factorise_mass(factor, info)
      if (info /= 0) then
         call fail(error, "the mass matrix is singular at "//trim(self%structure%labels(info))// &
                   "; of the methods of time integration only generalized_alpha supports such a structure")
         return
      end if
      right = self%structure%damping
      call dpotrs("L", n, n, factor, n, right, n, info)
      call new_integration_matrix(self%damping, right)
      right = self%structure%stiffness
      call dpotrs("L", n, n, factor, n, right, n, info)
      call new_integration_matrix(self%stiffness, right)
      self%shape = self%laws%shape
      if (size(self%shape) > 0) call dpotrs("L", n, size(self%shape, 2), factor, n, self%shape, n, info)
      self%accelerations = self%loads
      if (size(self%loads%course) > 0) then
         associate (amplitude => self%accelerations%amplitude)
            allocate (real_part, source=real(amplitude, wp))
            allocate (imaginary_part, source=aimag(amplitude))
            call dpotrs("L", n, size(amplitude, 2), factor, n, real_part, n, info)
            call dpotrs("L", n, size(amplitude, 2), factor, n, imaginary_part, n, info)
            amplitude = cmplx(real_part, imaginary_part, wp)
         end associate
      end if
      if (self%loads%n_active == 0) return
      call dpotrs("L", n, self%loads%n_active, factor, n, self%accelerations%cosine, n, info)
      call dpotrs("L", n, self%loads%n_active, factor, n, self%accelerations%sine, n, info)
   end subroutine system_divide_by_mass

   !> Accelerations of a motion: M^-1 (F - D v - K q - S f). On entry `a` contains M^-1 F.
   subroutine system_accelerate(self, q, v, elapsed, a)
      class(integration_system_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: q(:), v(:)                  !! [m], [m/s], (n_dofs)
      real(wp), intent(in) :: elapsed                                 !! [s] since the start of the step
      real(wp), intent(inout), contiguous :: a(:)                     !! [m/s**2], (n_dofs)
      integer :: c, i

      call self%stiffness%subtract_product(q, a)
      call self%damping%subtract_product(v, a)
      call self%laws%gather(q, v)
      call self%laws%evaluate(elapsed)
      do c = 1, self%laws%n_coordinates
         do i = 1, self%n_dofs
            a(i) = a(i) - self%shape(i, c)*self%laws%f(c)
         end do
      end do
   end subroutine system_accelerate

   !> Stores a matrix; if few entries are nonzero, only these.
   pure subroutine new_integration_matrix(self, entries)
      type(integration_matrix_t), intent(out) :: self
      real(wp), intent(in) :: entries(:, :)                           !! (n, n)
      integer :: e, i, j

      self%n = size(entries, 1)
      self%is_sparse = 2*count(abs(entries) > 0.0_wp) < self%n**2
      if (.not. self%is_sparse) then
         self%entries = entries
         return
      end if
      allocate (self%first(self%n + 1), self%row(count(abs(entries) > 0.0_wp)))
      allocate (self%value(size(self%row)))
      e = 0
      do j = 1, self%n
         self%first(j) = e + 1
         do i = 1, self%n
            if (.not. abs(entries(i, j)) > 0.0_wp) cycle
            e = e + 1
            self%row(e) = i
            self%value(e) = entries(i, j)
         end do
      end do
      self%first(self%n + 1) = e + 1
   end subroutine new_integration_matrix

   !> y = y - A x.
   pure subroutine matrix_subtract_product(self, x, y)
      class(integration_matrix_t), intent(in) :: self
      real(wp), intent(in), contiguous :: x(:)                        !! (n)
      real(wp), intent(inout), contiguous :: y(:)                     !! (n)
      integer :: e, i, j

      if (self%is_sparse) then
         do j = 1, self%n
            do e = self%first(j), self%first(j + 1) - 1
               y(self%row(e)) = y(self%row(e)) - self%value(e)*x(j)
            end do
         end do
      else
         do j = 1, self%n
            do i = 1, self%n
               y(i) = y(i) - self%entries(i, j)*x(j)
            end do
         end do
      end if
   end subroutine matrix_subtract_product

   !> Stores the nonzero columns of amplitudes c = cos - i sin.
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
      allocate (self%course(0), self%share(0), self%amplitude(size(amplitudes, 1), 0))
   end subroutine new_integration_loads

   !> Adds loads with a course.
   pure subroutine append_courses(self, timed)
      type(integration_loads_t), intent(inout) :: self
      type(timed_load_t), intent(in) :: timed(:)
      integer :: i, n_dofs

      n_dofs = size(self%amplitude, 1)
      deallocate (self%share, self%amplitude)
      self%course = timed%course
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

      self%share = self%course%share(from, to)
   end subroutine loads_act_within

   !> Adds the loads with a course.
   pure subroutine loads_add_courses(self, time, values)
      class(integration_loads_t), intent(in) :: self
      real(wp), intent(in) :: time                                    !! [s]
      real(wp), intent(inout) :: values(:)                            !! (n_dofs)
      complex(wp) :: factor
      integer :: k

      do k = 1, size(self%course)
         if (.not. self%share(k) > 0.0_wp) cycle
         factor = self%share(k)*self%course(k)%factor(time)
         values = values + real(factor*self%amplitude(:, k), wp)
      end do
   end subroutine loads_add_courses

   !> Highest frequency of all loads [rad/s]; 0 without loads.
   pure real(wp) function loads_highest_frequency(self) result(highest)
      class(integration_loads_t), intent(in) :: self

      highest = maxval([0.0_wp, abs(self%frequency), abs(self%course%frequency), self%course%end_frequency])
   end function loads_highest_frequency

   !> The first time after another one at which a load begins or ends; huge: none.
   pure real(wp) function loads_next_edge(self, time) result(edge)
      class(integration_loads_t), intent(in) :: self
      real(wp), intent(in) :: time                                    !! [s]
      real(wp) :: edges(2*size(self%course))

      edge = huge(1.0_wp)
      if (size(self%course) == 0) return
      edges = [self%course%begin, self%course%end]
      edge = minval([huge(1.0_wp), pack(edges, edges > time)])
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
      if (size(self%course) > 0) call self%add_courses(time, values)
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
      if (size(self%course) > 0) call self%add_courses(self%origin + elapsed, values)
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
      if (size(self%course) > 0) call self%add_courses(self%origin + self%n_steps*self%step, values)
   end subroutine loads_here

   !> State of rest at time zero, sliders relaxed.
   pure subroutine new_integration_state(self, n_dofs, n_states)
      type(integration_state_t), intent(out) :: self
      integer, intent(in) :: n_dofs, n_states

      allocate (self%q(n_dofs), self%v(n_dofs), self%s(n_states), source=0.0_wp)
   end subroutine new_integration_state

   !> Takes a state as the first one.
   subroutine integrator_start(self, state, error)
      class(integrator_t), intent(inout) :: self
      type(integration_state_t), intent(inout) :: state
      type(error_t), allocatable, intent(out) :: error

      self%origin = state%time
      self%n_steps = 0_int64
      call self%begin(state, error)
   end subroutine integrator_start

   !> Goes on from the state where the last call ended, which `state` must hold.
   subroutine integrator_advance(self, state, n_steps, error)
      class(integrator_t), intent(inout) :: self
      type(integration_state_t), intent(inout) :: state
      integer, intent(in) :: n_steps
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      call self%resume(state)
      do i = 1, n_steps
         call self%take_step(self%origin + self%n_steps*self%step, self%origin + (self%n_steps + 1_int64)*self%step, state, error)
         if (allocated(error)) return
         self%n_steps = self%n_steps + 1_int64
      end do
      state%time = self%origin + self%n_steps*self%step
      call self%read_state(state)
   end subroutine integrator_advance

   !> Finds what a method needs of the state from which it goes on.
   subroutine integrator_resume(self, state)
      class(integrator_t), intent(inout) :: self
      type(integration_state_t), intent(in) :: state
   end subroutine integrator_resume

   !> Brings a state to the time that it has.
   subroutine integrator_read_state(self, state)
      class(integrator_t), intent(inout) :: self
      type(integration_state_t), intent(inout) :: state
   end subroutine integrator_read_state

   !> Forces of the laws [N] on their coordinates in a state, on the left-hand side; 0 for rigid laws unless a method
   !> provides them.
   subroutine integrator_forces(self, state, f)
      class(integrator_t), intent(inout) :: self
      type(integration_state_t), intent(in) :: state
      real(wp), intent(out) :: f(:)                                   !! (n_coordinates)

      call law_forces(self%system, state, f)
   end subroutine integrator_forces

   !> Forces of all laws except the rigid ones in a state.
   subroutine law_forces(system, state, f)
      type(integration_system_t), intent(inout) :: system
      type(integration_state_t), intent(in) :: state
      real(wp), intent(out) :: f(:)                                   !! [N], (n_coordinates)

      call system%laws%start_step(state%time, state%q, state%v, state%s)
      call system%laws%gather(state%q, state%v)
      call system%laws%evaluate(0.0_wp)
      f = system%laws%f
   end subroutine law_forces

   !> Frees the memory of an external library; safe to call twice.
   subroutine integrator_destroy(self)
      class(integrator_t), intent(inout) :: self
   end subroutine integrator_destroy
end module hb_integration_system
