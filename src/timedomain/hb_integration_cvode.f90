!> Time integration by multistep methods of variable order and step, event by event.
!>
!> Between events the equations are smooth, so that the tolerance is met at high order; at an event the integration
!> stops, the branch of the law changes (hb_integration_equations), and the integrator is restarted. The step of the
!> record only defines the sampling. A rigid wall reflects a coordinate with the coefficient of restitution times its
!> speed; a speed below 1e-6 of the largest so far does not bounce.
module hb_integration_cvode
   use hb_cancellation, only: work_is_over
   use hb_error, only: error_t, fail
   use hb_flight, only: flight_t, is_made_of_flights, new_flight
   use hb_hysteretic_law, only: hysteretic_law_t
   use hb_integration_equations, only: integration_equations_t, new_integration_equations
   use hb_integration_system, only: integration_state_t, integration_system_t, law_forces
   use hb_integrator, only: integrator_t
   use hb_kinds, only: wp
   use hb_law, only: hold_t
   use hb_rigid_constraints, only: move_before_walls
   use hb_sundials, only: cvode_t, new_cvode
   use hb_text, only: to_text
   implicit none
   private
   public :: integration_cvode_t, new_integration_cvode

   ! Rounding of the time at each step of CVODE is systematic; it is small if the origin of time is near.
   integer, parameter :: steps_from_base = 1000
   integer, parameter :: max_events = 100000                          ! from one sample to the next
   real(wp), parameter :: min_bounce_speed = 1.0e-6_wp                ! relative speed below which there is no bounce
   real(wp), parameter :: part_of_fastest = 1.0e-5_wp                 ! of the time of the fastest motion: slightly later
   real(wp), parameter :: time_rounding = 64.0_wp*epsilon(1.0_wp)     ! of a time, relative
   real(wp), parameter :: smallest_scale = 1.0e-3_wp                  ! of a displacement, relative to the length of the system

   type, extends(integrator_t) :: integration_cvode_t
      type(integration_equations_t), pointer :: equations => null()
      type(cvode_t) :: cvode                                          !! has the values of both
      type(flight_t), allocatable :: flight                           !! takes its place if equations are linear between events
      real(wp) :: base = 0.0_wp                                       !! [s] from where the time of CVODE counts
      integer :: n_since_base = 0                                     !! steps
      real(wp) :: time_scale = 0.0_wp                                 !! [s], far below all periods
      real(wp) :: tolerance = 0.0_wp
   contains
      procedure :: begin => integration_cvode_begin
      procedure :: take_step => integration_cvode_take_step
      procedure :: read_state => integration_cvode_read_state
      procedure :: forces => integration_cvode_forces
      procedure :: destroy => integration_cvode_destroy
   end type integration_cvode_t

   ! Impacts on walls; bodies in hb_integration_cvode_impacts
   interface
      !> Lists the change of the velocities at an event, if there is one.
      module subroutine list_impact(self, t, before)
         class(integration_cvode_t), intent(inout) :: self
         real(wp), intent(in) :: t
         real(wp), intent(in) :: before(:)                               !! velocities [m/s]
      end subroutine list_impact

      !> All impacts at one time. Bodies that touch several walls strike them one after the other, the fastest first, with the
      !> restitution of each, until none is approached: the limit of small gaps, as in Newton's cradle. What is then slower than the
      !> slowest impact stays in contact. Impacts that have no effect on others are independent.
      module subroutine collide(self, struck)
         class(integration_cvode_t), intent(inout) :: self
         integer, intent(in) :: struck(:)                                !! side of each rigid law that was struck; 0: none
      end subroutine collide

      !> Reflects a coordinate at a wall; all others in contact are constrained.
      module subroutine hit_wall(self, i, side)
         class(integration_cvode_t), intent(inout) :: self
         integer, intent(in) :: i, side
      end subroutine hit_wall

      !> Sets the rates of the constrained coordinates, by an impulse on each.
      module subroutine stop_active(self, rates)
         class(integration_cvode_t), intent(inout) :: self
         real(wp), intent(in) :: rates(:)                                !! [m/s], of the active ones
      end subroutine stop_active
   end interface

contains

   !> Fails for a singular mass, and for a law with memory without bounds.
   subroutine new_integration_cvode(self, system, step, tolerance, is_stiff, rigid, error)
      type(integration_cvode_t), intent(out) :: self
      type(integration_system_t), intent(inout), target :: system
      real(wp), intent(in) :: step                                    !! from one sample to the next [s], > 0
      real(wp), intent(in) :: tolerance
      type(hold_t), intent(in) :: rigid(:)                            !! its rigid laws
      logical, intent(in) :: is_stiff
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: directions(:)
      integer :: i

      do i = 1, size(system%laws%laws)
         select type (law => system%laws%laws(i)%law)
         class is (hysteretic_law_t)
            if (law%has_bounds) cycle
            call fail(error, "cvode does not support the states of law '"//law%label//"'; the other methods of integration do")
            return
         end select
      end do
      call system%divide_by_mass(error)
      if (allocated(error)) return
      self%system => system
      self%step = step
      self%tolerance = tolerance
      allocate (self%equations)
      call new_integration_equations(self%equations, system, tolerance, rigid)
      if (is_made_of_flights(system, rigid) .and. .not. is_stiff) then
         allocate (self%flight)
         call new_flight(self%flight, self%equations)
         allocate (self%cvode%values(2*system%n_dofs), source=0.0_wp)
         return
      end if
      allocate (directions(self%equations%n_events()), source=-1)
      directions(:size(self%equations%is_positive)) = 0
      call new_cvode(self%cvode, self%equations, 2*system%n_dofs, directions, is_stiff, error)
   end subroutine new_integration_cvode

   subroutine integration_cvode_begin(self, state, error)
      class(integration_cvode_t), intent(inout) :: self
      type(integration_state_t), intent(inout) :: state
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: fastest, length
      integer :: i

      associate (equations => self%equations, n => self%system%n_dofs, y => self%cvode%values)
         call move_before_walls(equations%rigid, self%system%laws%shape, equations%accelerance, state%q)
         y(:n) = state%q
         y(n + 1:) = state%v
         fastest = 1.0_wp/self%step
         fastest = max(fastest, self%system%loads%highest_frequency())
         do i = 1, n
            if (self%system%structure%mass(i, i) > 0.0_wp) fastest = max(fastest, &
               sqrt(abs(self%system%structure%stiffness(i, i))/self%system%structure%mass(i, i)))
         end do
         self%time_scale = part_of_fastest/fastest
         equations%scale = abs(y)
         length = max(self%system%length, maxval(abs(state%q)))
         if (length <= 0.0_wp) length = 1.0_wp
         equations%scale(:n) = max(equations%scale(:n), smallest_scale*length)
         equations%scale(n + 1:) = max(equations%scale(n + 1:), smallest_scale**2*fastest*length)
         equations%held = state%s
         equations%mode = 0
         equations%leaving = 0
         self%impacts = spread(0, 1, 2*size(equations%rigid))
         call self%equations%hold_active()
         call begin_here(self, state%time, error)
      end associate
   end subroutine integration_cvode_begin

   !> Begins at the present values, with the loads that act from there on.
   subroutine begin_here(self, time, error)
      class(integration_cvode_t), intent(inout) :: self
      real(wp), intent(in) :: time                                    !! [s]
      type(error_t), allocatable, intent(out) :: error

      call self%system%accelerations%begin(time, 0.0_wp)
      call act_from(self, time)
      call choose_branches(self, 0.0_wp)                              ! may change velocities, therefore first
      call leave_touched_walls(self)
      call begin_at(self, time, error)
   end subroutine begin_here

   !> Coordinates that touch an open wall move away from it, the slowest for so short a time that the distance is never seen: these
   !> leave until their rate turns.
   subroutine leave_touched_walls(self)
      class(integration_cvode_t), intent(inout) :: self
      real(wp) :: rate, z
      integer :: i, side

      associate (equations => self%equations, y => self%cvode%values, n => self%system%n_dofs)
         do i = 1, size(equations%rigid)
            associate (rigid => equations%rigid(i), shape => self%system%laws%shape(:, equations%rigid(i)%coordinate))
               if (.not. rigid%is_wall .or. equations%mode(i) /= 0) cycle
               z = dot_product(shape, y(:n))
               rate = dot_product(shape, y(n + 1:))
               side = merge(1, merge(-1, 0, rigid%two_sided), rate < 0.0_wp)
               if (side*z > rigid%gap - touching(self, i) .and. abs(rate) > 0.0_wp) equations%leaving(i) = side
            end associate
         end do
      end associate
   end subroutine leave_touched_walls

   !> Distance from a wall within which a coordinate touches it [m].
   pure real(wp) function touching(self, i)
      class(integration_cvode_t), intent(in) :: self
      integer, intent(in) :: i

      touching = 64.0_wp*epsilon(1.0_wp)*max(abs(self%equations%rigid(i)%gap), &
                                             maxval(self%equations%scale(:self%system%n_dofs)))
   end function touching

   !> Sets the origin of time.
   subroutine begin_at(self, time, error)
      class(integration_cvode_t), intent(inout) :: self
      real(wp), intent(in) :: time                                    !! [s]
      type(error_t), allocatable, intent(out) :: error

      self%base = time
      self%n_since_base = 0
      call self%system%accelerations%begin(time, 0.0_wp)
      call restart(self, 0.0_wp, error)
   end subroutine begin_at

   !> Restarts from the present values; discards the history.
   subroutine restart(self, t, error)
      class(integration_cvode_t), intent(inout) :: self
      real(wp), intent(in) :: t                                       !! [s] from the base
      type(error_t), allocatable, intent(out) :: error

      if (allocated(self%flight)) then
         call self%flight%restart(t, self%cvode%values)
      else
         call self%cvode%restart(t, error)
      end if
   end subroutine restart

   !> Integrates to `t_end`, or to an event before it.
   subroutine advance(self, t_end, t, is_event, found, error)
      class(integration_cvode_t), intent(inout) :: self
      real(wp), intent(in) :: t_end                                   !! [s] from the base
      real(wp), intent(out) :: t                                      !! where the values hold
      logical, intent(out) :: is_event
      integer, intent(out) :: found(:)                                !! of each event: 0 no, 1 rising, -1 falling
      type(error_t), allocatable, intent(out) :: error

      if (allocated(self%flight)) then
         call self%flight%advance(t_end, self%cvode%values, t, is_event, found, error)
      else
         call self%cvode%advance(t_end, t, is_event, found, error, self%base)
         self%is_at_pole = allocated(error) .and. self%cvode%is_at_pole()
      end if
   end subroutine advance

   !> The loads act as they do between a time and the next one at which one of them begins or ends.
   subroutine act_from(self, time)
      class(integration_cvode_t), intent(inout) :: self
      real(wp), intent(in) :: time                                    !! [s]
      real(wp) :: next

      associate (loads => self%system%accelerations)
         next = min(next_edge(self, time), time + self%step)
         call loads%act_within(0.5_wp*(time + next), next)
      end associate
   end subroutine act_from

   !> The first time at which a load begins or ends, clearly after another one: CVODE needs some distance.
   pure real(wp) function next_edge(self, time) result(edge)
      class(integration_cvode_t), intent(in) :: self
      real(wp), intent(in) :: time                                    !! [s]

      edge = self%system%accelerations%next_edge(time + time_rounding*max(abs(time), self%step))
   end function next_edge

   !> Integrates from one sample to the next, over events and over times at which loads begin or end: each is passed by a procedure
   !> of its own, which says whether the sample is reached there.
   subroutine integration_cvode_take_step(self, time, time_after, state, error)
      class(integration_cvode_t), intent(inout) :: self
      real(wp), intent(in) :: time, time_after
      type(integration_state_t), intent(inout) :: state
      type(error_t), allocatable, intent(out) :: error
      integer :: found(self%equations%n_events()), n_events
      logical :: goes_on                                              ! after an extreme, without a restart
      logical :: is_at_sample, is_event
      real(wp) :: edge                                                ! where a load begins or ends
      real(wp) :: rounding_of_time
      real(wp) :: t, t_extreme                                        ! from the base

      goes_on = .false.
      is_at_sample = .false.
      t_extreme = 0.0_wp
      rounding_of_time = time_rounding*max(abs(time_after), self%step)
      edge = next_edge(self, time)
      do n_events = 1, max_events
         call advance(self, min(edge, time_after) - self%base, t, is_event, found, error)
         if (allocated(error) .and. goes_on) then
            call leave_extreme()
            if (allocated(error)) return
            cycle
         end if
         if (.not. allocated(error) .and. n_events > 1 .and. work_is_over()) call fail(error, "cvode was ended before its time")
         if (allocated(error)) return
         self%equations%scale = max(self%equations%scale, abs(self%cvode%values))
         if (is_event) then
            call pass_event()
         else if (edge <= time_after + rounding_of_time) then
            call pass_edge()
         else
            is_at_sample = .true.
         end if
         if (allocated(error)) return
         if (is_at_sample) exit
      end do
      if (.not. is_at_sample) then
         call fail(error, "cvode: events without end at t = "//to_text(self%base + t)//" s")
         return
      end if
      self%n_since_base = self%n_since_base + 1
      if (self%n_since_base >= steps_from_base) call begin_at(self, time_after, error)

   contains

      !> Restarts at the last extreme: the rate is zero for some time, which cannot be passed without.
      subroutine leave_extreme()
         deallocate (error)
         goes_on = .false.
         call restart(self, t_extreme, error)
      end subroutine leave_extreme

      !> Restarts on the branches behind an event, if there are others; not behind an extreme, unless it is at the sample, for there
      !> may be another one.
      subroutine pass_event()
         goes_on = all(found(:self%equations%n_branch_events()) == 0)
         is_at_sample = time_after - self%base - t <= 8.0_wp*epsilon(1.0_wp)*abs(t)
         if (goes_on) then
            t_extreme = t
         else
            call change_branches(self, t, found)
         end if
         if (is_at_sample .or. .not. goes_on) call restart(self, t, error)
      end subroutine pass_event

      !> Begins again where a load begins or ends, at the sample if this is as near as rounding.
      subroutine pass_edge()
         is_at_sample = edge >= time_after - rounding_of_time
         if (is_at_sample) edge = time_after
         call begin_here(self, edge, error)
         if (.not. allocated(error)) edge = next_edge(self, edge)
         goes_on = .false.
      end subroutine pass_edge
   end subroutine integration_cvode_take_step

   !> Displacements, velocities and positions of all sliders.
   subroutine integration_cvode_read_state(self, state)
      class(integration_cvode_t), intent(inout) :: self
      type(integration_state_t), intent(inout) :: state

      associate (n => self%system%n_dofs, equations => self%equations)
         state%q = self%cvode%values(:n)
         state%v = self%cvode%values(n + 1:)
         if (self%system%laws%n_states == 0) return
         call equations%gather(state%time - self%base, self%cvode%values)
         call equations%find_bounds()
         state%s = merge(equations%held, merge(equations%lower, equations%upper, equations%slip > 0), equations%slip == 0)
      end associate
   end subroutine integration_cvode_read_state

   !> Changes the branches whose events were found.
   subroutine change_branches(self, t, found)
      class(integration_cvode_t), intent(inout) :: self
      real(wp), intent(in) :: t
      integer, intent(in) :: found(:)
      integer :: i, k, side, struck(size(self%equations%rigid))
      real(wp) :: before(self%system%n_dofs)

      before = self%cvode%values(self%system%n_dofs + 1:)
      associate (equations => self%equations, y => self%cvode%values)
         call equations%gather(t, y)
         call equations%find_bounds()
         do i = 1, size(equations%is_positive)
            if (found(i) /= 0) equations%is_positive(i) = found(i) > 0
         end do
         k = size(equations%is_positive)
         do i = 1, size(equations%slip)
            if (any(found(k + 1:k + 2) /= 0)) call change_slider(i)
            k = k + 2
         end do
         struck = 0
         do i = 1, size(equations%rigid)
            if (any(found(k + 1:k + 2) /= 0)) then
               side = merge(1, -1, found(k + 1) /= 0)
               if (equations%rigid(i)%is_wall) call change_wall(i, side)
               if (.not. equations%rigid(i)%is_wall) equations%mode(i) = merge(side, 0, equations%mode(i) == 0) ! slips, or sticks
            end if
            k = k + 2
         end do
         call collide(self, struck)
         if (size(equations%rigid) > 0) then
            call equations%hold_active()
            call make_rigid_consistent(self, t)
         end if
         if (any(struck /= 0)) call choose_branches(self, t)
      end associate
      if (allocated(self%impact_times)) call list_impact(self, t, before)

   contains

      !> A slider stays where its bound has left it, and slips again where a bound moves it.
      subroutine change_slider(i)
         integer, intent(in) :: i

         associate (equations => self%equations)
            if (equations%slip(i) /= 0) then
               equations%held(i) = merge(equations%lower(i), equations%upper(i), equations%slip(i) > 0)
               equations%slip(i) = 0
            end if
         end associate
         call choose_slip(self, t, i)
      end subroutine change_slider

      !> A wall is left, or touched: by a coordinate that was leaving it and turns lower than the integration is accurate, which
      !> remains there, or by one that strikes it.
      subroutine change_wall(i, side)
         integer, intent(in) :: i, side

         associate (equations => self%equations)
            if (equations%mode(i) /= 0) then
               equations%mode(i) = 0
            else if (equations%leaving(i) == side) then
               equations%leaving(i) = 0
               associate (rigid => equations%rigid(i), z => self%system%laws%z(equations%rigid(i)%coordinate))
                  if (rigid%gap - side*z <= self%tolerance*maxval(equations%scale(:self%system%n_dofs))) &
                     call hit_wall(self, i, side)
               end associate
            else
               struck(i) = side
            end if
         end associate
      end subroutine change_wall
   end subroutine change_branches

   !> Finds modes of the rigid laws that are consistent in the present state: walls push, also those that are touched without a
   !> speed, friction is within its limit or slips against it.
   subroutine make_rigid_consistent(self, t)
      class(integration_cvode_t), intent(inout) :: self
      real(wp), intent(in) :: t
      real(wp) :: dydt(size(self%cvode%values)), rounding
      integer :: i, pass, side
      logical :: is_consistent

      associate (equations => self%equations, laws => self%system%laws)
         do pass = 1, 3*size(equations%rigid) + 1
            call equations%rhs(t, self%cvode%values, dydt)
            is_consistent = .true.
            do i = 1, size(equations%rigid)
               associate (rigid => equations%rigid(i))
                  if (rigid%is_wall) then
                     side = 0
                     if (equations%mode(i) == 0) side = pressed_side(self, i, dydt)
                     if (side == 0 .and. equations%mode(i)*equations%reaction(i) >= 0.0_wp) cycle
                     equations%mode(i) = side
                  else if (equations%mode(i) == 0) then
                     if (abs(equations%reaction(i)) <= rigid%limit) cycle
                     equations%mode(i) = merge(1, -1, equations%reaction(i) > 0.0_wp)
                  else
                     rounding = epsilon(1.0_wp)*maxval(equations%scale(self%system%n_dofs + 1:))
                     if (equations%mode(i)*laws%z_rate(rigid%coordinate) >= -rounding) cycle
                     equations%mode(i) = -equations%mode(i)
                  end if
               end associate
               is_consistent = .false.
               exit
            end do
            if (is_consistent) exit
            call equations%hold_active()
         end do
      end associate
   end subroutine make_rigid_consistent

   !> Side of an open wall that is touched, without a speed, by a coordinate that accelerates towards it; 0: none.
   pure integer function pressed_side(self, i, dydt) result(side)
      class(integration_cvode_t), intent(in) :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: dydt(:)
      real(wp) :: acceleration, rate, z

      associate (n => self%system%n_dofs, y => self%cvode%values, rigid => self%equations%rigid(i))
         associate (shape => self%system%laws%shape(:, rigid%coordinate))
            z = dot_product(shape, y(:n))
            rate = dot_product(shape, y(n + 1:))
            acceleration = dot_product(shape, dydt(n + 1:))
         end associate
         side = merge(1, merge(-1, 0, rigid%two_sided), acceleration > 0.0_wp)
         if (rigid%gap - side*z > touching(self, i)) side = 0
         if (abs(rate) > epsilon(1.0_wp)*maxval(self%equations%scale(n + 1:))) side = 0
         if (abs(acceleration)*self%time_scale <= epsilon(1.0_wp)*maxval(self%equations%scale(n + 1:))) side = 0
      end associate
   end function pressed_side

   !> Chooses all branches anew from the present state, as at the start or after an impact.
   subroutine choose_branches(self, t)
      class(integration_cvode_t), intent(inout) :: self
      real(wp), intent(in) :: t
      real(wp) :: ahead(size(self%equations%is_positive)), now(size(self%equations%is_positive))
      real(wp) :: crawling, rate, zero
      integer :: i, slips(size(self%equations%rigid)), struck(size(self%equations%rigid))

      slips = 0
      struck = 0
      associate (equations => self%equations, laws => self%system%laws, y => self%cvode%values)
         crawling = min_bounce_speed*maxval(equations%scale(self%system%n_dofs + 1:))
         call equations%gather(t, y)
         call self%system%laws%switches_here(now)
         equations%is_positive = now > 0.0_wp
         do i = 1, size(equations%rigid)
            associate (rigid => equations%rigid(i), z => laws%z(equations%rigid(i)%coordinate))
               rate = laws%z_rate(rigid%coordinate)
               zero = touching(self, i)
               if (.not. rigid%is_wall) then
                  slips(i) = merge(0, merge(1, -1, rate > 0.0_wp), abs(rate) <= crawling)
               else if (equations%mode(i) == 0) then
                  if (z > rigid%gap - zero .and. rate >= 0.0_wp) struck(i) = 1
                  if (rigid%two_sided .and. z < -rigid%gap + zero .and. rate <= 0.0_wp) struck(i) = -1
               end if
            end associate
         end do
         call collide(self, struck)
         where (.not. equations%rigid%is_wall) equations%mode = slips
         call equations%hold_active()
         if (size(equations%active) > 0) call stop_active(self, 0.0_wp*equations%active)   ! constrained coordinates must not creep
         call evaluate_ahead(self, t, ahead)
         call equations%gather(t, y)
         call self%system%laws%switches_here(now)
         where (abs(now) <= 64.0_wp*epsilon(1.0_wp)*max(maxval(equations%scale), abs(ahead))) equations%is_positive = ahead > 0.0_wp
         do i = 1, size(equations%slip)
            call choose_slip(self, t, i)
         end do
         if (size(equations%rigid) > 0) call make_rigid_consistent(self, t)
      end associate
   end subroutine choose_branches

   !> Whether slider i slips: its position, outside or on a bound, is moved in the direction of the motion.
   subroutine choose_slip(self, t, i)
      class(integration_cvode_t), intent(inout) :: self
      real(wp), intent(in) :: t
      integer, intent(in) :: i
      real(wp) :: ahead(size(self%equations%is_positive)), zero

      associate (equations => self%equations)
         call equations%gather(t, self%cvode%values)
         call equations%find_bounds()
         equations%held(i) = min(max(equations%held(i), equations%lower(i)), equations%upper(i))
         zero = 64.0_wp*epsilon(1.0_wp)*max(abs(equations%lower(i)), abs(equations%upper(i)))
         associate (on_lower => equations%held(i) <= equations%lower(i) + zero, &
                    on_upper => equations%held(i) >= equations%upper(i) - zero)
            call evaluate_ahead(self, t, ahead)
            equations%slip(i) = 0
            if (on_lower .and. equations%lower(i) > equations%held(i)) equations%slip(i) = 1
            if (on_upper .and. equations%upper(i) < equations%held(i)) equations%slip(i) = -1
         end associate
      end associate
   end subroutine choose_slip

   !> Computes coordinates, bounds and switches slightly later.
   subroutine evaluate_ahead(self, t, switches)
      class(integration_cvode_t), intent(inout) :: self
      real(wp), intent(in) :: t
      real(wp), intent(out) :: switches(:)
      real(wp) :: dydt(size(self%cvode%values)), later(size(self%cvode%values))

      associate (n => self%system%n_dofs, y => self%cvode%values, h => self%time_scale)
         call self%equations%rhs(t, y, dydt)
         later = y + h*dydt
         later(:n) = later(:n) + 0.5_wp*h**2*dydt(n + 1:)
         call self%equations%gather(t + h, later)
         call self%equations%find_bounds()
         call self%system%laws%switches_here(switches)
      end associate
   end subroutine evaluate_ahead

   !> Forces of the laws; of rigid ones their reactions.
   subroutine integration_cvode_forces(self, state, f)
      class(integration_cvode_t), intent(inout) :: self
      type(integration_state_t), intent(in) :: state
      real(wp), intent(out) :: f(:)
      real(wp) :: dydt(2*size(state%q))
      integer :: i

      call law_forces(self%system, state, f)
      if (size(self%equations%rigid) == 0) return
      call self%equations%rhs(state%time - self%base, [state%q, state%v], dydt)
      do i = 1, size(self%equations%rigid)
         f(self%equations%rigid(i)%coordinate) = self%equations%reaction(i)
      end do
   end subroutine integration_cvode_forces

   subroutine integration_cvode_destroy(self)
      class(integration_cvode_t), intent(inout) :: self

      if (allocated(self%flight) .and. associated(self%cvode%values)) deallocate (self%cvode%values)
      call self%cvode%destroy()
      if (associated(self%equations)) deallocate (self%equations)
   end subroutine integration_cvode_destroy
end module hb_integration_cvode
