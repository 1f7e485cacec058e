!> The equations of motion between two events, and the events: each law remains on the smooth branch that was last
!> chosen. Time is relative to the start of the loads.
!>
!> Events are: a switch of a law changes its sign; a slider begins or ends to slip; contact with a rigid wall begins
!> or ends; rigid friction begins or ends to slip. A slider that slips is on its bound, one that sticks keeps its
!> position, so that neither needs an equation of its own. Rigid contact and sticking are enforced by the reactions
!> that keep the accelerations of their coordinates zero. Source: E. Hairer, S. P. Norsett and G. Wanner, Solving
!> Ordinary Differential Equations I, 2nd edition, Springer 1993, section II.6 (discontinuous equations); F. Pfeiffer
!> and C. Glocker, Multibody Dynamics with Unilateral Contacts, Wiley 1996.
module hb_integration_equations
   use hb_error, only: error_t
   use hb_hysteretic_law, only: hysteretic_law_t
   use hb_integration_system, only: integration_system_t
   use hb_kinds, only: wp
   use hb_lapack, only: dgetrf, dgetrs
   use hb_law, only: hold_t
   use hb_sundials, only: ode_t
   implicit none
   private
   public :: integration_equations_t, new_integration_equations

   real(wp), parameter :: smallest_scale = 1.0e-3_wp                  ! of one unknown, relative to the largest
   real(wp), parameter :: min_relative_pivot = 1.0e-10_wp             ! relative pivot of independent reactions

   type, extends(ode_t) :: integration_equations_t
      type(integration_system_t), pointer :: system => null()
      real(wp) :: tolerance = 0.0_wp
      real(wp), allocatable :: scale(:)                               !! largest displacements, then velocities so far, (2 n_dofs)
      ! Switches of the laws, one after the other
      logical, allocatable :: is_positive(:)
      ! Sliders, as the states of all laws
      integer, allocatable :: slip(:)                                 !! 1 moved by its lower bound, -1 by its upper, 0 sticks
      real(wp), allocatable :: held(:)                                !! position of sliders that stick [m]
      ! Rigid laws
      type(hold_t), allocatable :: rigid(:)
      integer, allocatable :: mode(:)                                 !! wall: 0 open, otherwise the side; friction: slip, 0 stick
      integer, allocatable :: leaving(:)                              !! side on which a wall was struck, until the coordinate
                                                                      !! turns back: a step may pass over a short flight
      integer, allocatable :: active(:)                               !! those with a constrained coordinate
      real(wp), allocatable :: accelerance(:, :)                      !! M^-1 S of all rigid laws
      real(wp), allocatable :: yield(:, :)                            !! S^T M^-1 S of them [1/kg]
      real(wp), allocatable :: factor(:, :)                           !! of those of the active ones
      integer, allocatable :: pivots(:)
      real(wp), allocatable :: reaction(:)                            !! of all rigid laws, on the left-hand side [N]
      real(wp), allocatable :: a(:), lower(:), upper(:), lower_rate(:), upper_rate(:)
   contains
      procedure :: n_branch_events => equations_n_branch_events
      procedure :: n_events => equations_n_events
      procedure :: rhs => equations_rhs
      procedure :: events => equations_events
      procedure :: weights => equations_weights
      procedure :: gather => equations_gather
      procedure :: find_bounds => equations_find_bounds
      procedure :: hold_active => equations_hold_active
   end type integration_equations_t

contains

   !> `system` must be divided by its mass.
   subroutine new_integration_equations(self, system, tolerance, rigid)
      type(integration_equations_t), intent(out) :: self
      type(integration_system_t), intent(in), target :: system
      real(wp), intent(in) :: tolerance                               !! relative
      type(hold_t), intent(in) :: rigid(:)                            !! its rigid laws
      integer :: i

      self%system => system
      self%tolerance = tolerance
      associate (laws => system%laws, m => system%laws%n_states)
         allocate (self%is_positive(laws%n_switches), source=.false.)
         allocate (self%slip(m), source=0)
         allocate (self%held(m), self%lower(m), self%upper(m), self%lower_rate(m), self%upper_rate(m), source=0.0_wp)
      end associate
      self%rigid = rigid
      allocate (self%mode(size(self%rigid)), self%leaving(size(self%rigid)), source=0)
      allocate (self%reaction(size(self%rigid)), self%a(system%n_dofs), self%scale(2*system%n_dofs), source=0.0_wp)
      allocate (self%accelerance(system%n_dofs, size(self%rigid)), self%active(0))
      do i = 1, size(self%rigid)
         self%accelerance(:, i) = system%shape(:, self%rigid(i)%coordinate)
      end do
      allocate (self%yield(size(self%rigid), size(self%rigid)))
      do i = 1, size(self%rigid)
         self%yield(i, :) = matmul(system%laws%shape(:, self%rigid(i)%coordinate), self%accelerance)
      end do
   end subroutine new_integration_equations

   !> Two for each slider and each rigid law, one for each switch.
   pure integer function equations_n_events(self)
      class(integration_equations_t), intent(in) :: self

      equations_n_events = self%n_branch_events() + 2*size(self%rigid)
   end function equations_n_events

   !> Those at which a branch changes, the first ones.
   pure integer function equations_n_branch_events(self)
      class(integration_equations_t), intent(in) :: self

      equations_n_branch_events = size(self%is_positive) + 2*size(self%slip) + 2*size(self%rigid)
   end function equations_n_branch_events

   !> Coordinates and rates of the laws in y = (q, v) at a time.
   subroutine equations_gather(self, t, y)
      class(integration_equations_t), intent(inout) :: self
      real(wp), intent(in) :: t                                       !! [s], relative to the start of the loads
      real(wp), intent(in), contiguous :: y(:)

      associate (n => self%system%n_dofs)
         call self%system%laws%set_time(self%system%accelerations%origin + t)
         call self%system%laws%gather(y(:n), y(n + 1:))
      end associate
   end subroutine equations_gather

   subroutine equations_rhs(self, t, y, dydt)
      class(integration_equations_t), intent(inout) :: self
      real(wp), intent(in) :: t
      real(wp), intent(in), contiguous :: y(:)
      real(wp), intent(out), contiguous :: dydt(:)
      integer :: c, i, k, n

      n = self%system%n_dofs
      associate (system => self%system, a => self%a, f => self%system%laws%f)
         call system%accelerations%after(t, a)
         call system%stiffness%subtract_product(y(:n), a)
         call system%damping%subtract_product(y(n + 1:), a)
         call self%gather(t, y)
         call law_forces(self)
         do i = 1, size(self%rigid)
            if (self%rigid(i)%is_wall) cycle
            f(self%rigid(i)%coordinate) = self%mode(i)*self%rigid(i)%limit
         end do
         do c = 1, size(f)
            a = a - system%shape(:, c)*f(c)
         end do
         self%reaction = 0.0_wp
         do i = 1, size(self%rigid)
            self%reaction(i) = f(self%rigid(i)%coordinate)
         end do
         if (size(self%active) > 0) then
            call find_reactions(self)
            do k = 1, size(self%active)
               a = a - self%accelerance(:, self%active(k))*self%reaction(self%active(k))
            end do
         end if
         dydt(:n) = y(n + 1:)
         dydt(n + 1:) = a
         self%is_over = system%laws%n_evaluations > system%laws%max_evaluations
      end associate
   end subroutine equations_rhs

   !> Forces of all laws on their present branches, at the gathered coordinates.
   subroutine law_forces(self)
      type(integration_equations_t), intent(inout) :: self
      real(wp) :: position(1, self%system%laws%n_states)
      integer :: i

      associate (laws => self%system%laws)
         if (size(self%slip) > 0) then
            call self%find_bounds()
            position(1, :) = merge(self%held, merge(self%lower, self%upper, self%slip > 0), self%slip == 0)
            laws%s = position(1, :)
         end if
         do i = 1, size(laws%laws)
            associate (at => laws%spans(i))
               if (at%is_held_back) then
                  laws%f(at%first:at%last) = 0.0_wp
                  cycle
               end if
               select type (law => laws%laws(i)%law)
               class is (hysteretic_law_t)
                  at%z(1, :) = laws%z(at%first:at%last)
                  call law%force(at%z, position(:, at%first_state:at%last_state), at%f)
                  laws%f(at%first:at%last) = at%f(1, :)
               class default
                  call law%evaluate_held(laws%z(at%first:at%last), laws%z_rate(at%first:at%last), &
                     self%is_positive(at%first_switch:at%last_switch), laws%f(at%first:at%last))
               end select
            end associate
         end do
      end associate
   end subroutine law_forces

   !> Bounds of all sliders at the gathered coordinates.
   subroutine equations_find_bounds(self)
      class(integration_equations_t), intent(inout) :: self
      integer :: i

      do i = 1, size(self%system%laws%laws)
         associate (at => self%system%laws%spans(i))
            select type (law => self%system%laws%laws(i)%law)
            class is (hysteretic_law_t)
               call law%bounds(self%system%laws%z(at%first:at%last), self%system%laws%z_rate(at%first:at%last), &
                  self%lower(at%first_state:at%last_state), self%upper(at%first_state:at%last_state), &
                  self%lower_rate(at%first_state:at%last_state), self%upper_rate(at%first_state:at%last_state))
            end select
         end associate
      end do
   end subroutine equations_find_bounds

   !> Reactions that keep the accelerations of the active coordinates zero; `a` contains those without them.
   subroutine find_reactions(self)
      type(integration_equations_t), intent(inout) :: self
      real(wp) :: right(size(self%active))
      integer :: info, k

      associate (shape => self%system%laws%shape)
         do k = 1, size(self%active)
            right(k) = dot_product(shape(:, self%rigid(self%active(k))%coordinate), self%a)
         end do
      end associate
      call dgetrs("N", size(right), 1, self%factor, size(right), self%pivots, right, size(right), info)
      self%reaction(self%active) = right
   end subroutine find_reactions

   !> Lists the active rigid laws from their modes, and factorises their equations. A wall whose reaction would depend on those of
   !> others opens: they hold its coordinate.
   subroutine equations_hold_active(self)
      class(integration_equations_t), intent(inout) :: self
      integer :: dependent, i, info, k

      do
         self%active = pack([(i, i=1, size(self%rigid))], self%mode /= 0 .eqv. self%rigid%is_wall)
         if (allocated(self%factor)) deallocate (self%factor, self%pivots)
         associate (m => size(self%active))
            allocate (self%factor(m, m), self%pivots(m))
            if (m == 0) return
            self%factor = self%yield(self%active, self%active)
            call dgetrf(m, m, self%factor, m, self%pivots, info)
            dependent = findloc([(abs(self%factor(k, k)) <= min_relative_pivot*self%yield(self%active(k), self%active(k)) .and. &
                                  self%rigid(self%active(k))%is_wall, k=1, m)], .true., dim=1)
            if (dependent == 0) return
            self%mode(self%active(dependent)) = 0
         end associate
      end do
   end subroutine equations_hold_active

   !> In this order: switches, two for each slider, two for each rigid law; then, for each rigid law, two extremes of an open
   !> wall's coordinate, without which one step could pass over a short time behind the wall. All of these fall to zero at
   !> their events.
   subroutine equations_events(self, t, y, g)
      class(integration_equations_t), intent(inout) :: self
      real(wp), intent(in) :: t
      real(wp), intent(in), contiguous :: y(:)
      real(wp), intent(out), contiguous :: g(:)
      real(wp) :: dydt(size(y))
      integer :: i, n

      n = size(self%is_positive)
      if (size(self%active) > 0) then
         call self%rhs(t, y, dydt)                                    ! for the reactions
      else
         call self%gather(t, y)
         if (size(self%slip) > 0) call self%find_bounds()
      end if
      call self%system%laws%switches_here(g(:n))
      do i = 1, size(self%slip)
         call events_of_slider(i, g(n + 1:n + 2))
         n = n + 2
      end do
      do i = 1, size(self%rigid)
         call events_of_rigid(i, g(n + 1:n + 2))
         n = n + 2
      end do
      do i = 1, size(self%rigid)
         call extremes_before_wall(i, g(n + 1:n + 2))
         n = n + 2
      end do

   contains

      !> A slider that is held: its distances from both bounds; otherwise the rate of the bound that moves it.
      pure subroutine events_of_slider(i, values)
         integer, intent(in) :: i
         real(wp), intent(out) :: values(2)

         select case (self%slip(i))
         case (0)
            values = [self%held(i) - self%lower(i), self%upper(i) - self%held(i)]
         case (1)
            values = [self%lower_rate(i), 1.0_wp]
         case default
            values = [1.0_wp, -self%upper_rate(i)]
         end select
      end subroutine events_of_slider

      !> An open wall: the distances from it, or the rate of what leaves it; a closed one: its reaction. Friction: what is left of
      !> its limit while it sticks, otherwise the rate.
      pure subroutine events_of_rigid(i, values)
         integer, intent(in) :: i
         real(wp), intent(out) :: values(2)

         associate (rigid => self%rigid(i), z => self%system%laws%z(self%rigid(i)%coordinate), &
                    rate => self%system%laws%z_rate(self%rigid(i)%coordinate))
            values = 1.0_wp
            if (rigid%is_wall .and. self%mode(i) == 0) then
               values(1) = rigid%gap - z
               if (rigid%two_sided) values(2) = rigid%gap + z
               if (self%leaving(i) == 1) values(1) = -rate
               if (self%leaving(i) == -1) values(2) = rate
            else if (rigid%is_wall) then
               values(1) = self%mode(i)*self%reaction(i)
            else if (self%mode(i) == 0) then
               values = [rigid%limit - self%reaction(i), rigid%limit + self%reaction(i)]
            else
               values(1) = self%mode(i)*rate
            end if
         end associate
      end subroutine events_of_rigid

      !> The rates towards an open wall: behind an extreme of the distance a contact may begin and end within a step.
      pure subroutine extremes_before_wall(i, values)
         integer, intent(in) :: i
         real(wp), intent(out) :: values(2)

         values = 1.0_wp
         if (.not. self%rigid(i)%is_wall .or. self%mode(i) /= 0 .or. self%leaving(i) /= 0) return
         values(1) = self%system%laws%z_rate(self%rigid(i)%coordinate)
         if (self%rigid(i)%two_sided) values(2) = -values(1)
      end subroutine extremes_before_wall
   end subroutine equations_events

   !> The error of each unknown is relative to its largest value so far; small ones have a lower limit, so that nearly
   !> constant unknowns do not determine the step.
   subroutine equations_weights(self, y, w)
      class(integration_equations_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: y(:)
      real(wp), intent(out), contiguous :: w(:)

      w = max(self%scale, abs(y))
      associate (n => self%system%n_dofs)
         w(:n) = max(w(:n), smallest_scale*maxval(w(:n)))
         w(n + 1:) = max(w(n + 1:), smallest_scale*maxval(w(n + 1:)))
      end associate
      w = 1.0_wp/(self%tolerance*w)
   end subroutine equations_weights
end module hb_integration_equations
