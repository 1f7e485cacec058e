!> Motions between events of a model whose laws are all rigid walls: its equations are linear as long as no contact begins or ends,
!> and are solved by the Taylor series of the motion, to all digits.
!>
!> A series holds over a step that follows from its last terms, some tenths of a period of the fastest motion. Events are sought
!> on parts of it, short at first: a flight between two impacts may be far shorter than a step. A function of an event that
!> is positive at both ends of a part is above its tangents between them as long as it is convex: where these meet below zero, the
!> part is halved. Source: A. Jorba and M. Zou, Experimental Mathematics 14 (2005) 99-117.
module hb_flight
   use hb_cancellation, only: work_is_over
   use hb_error, only: error_t, fail
   use hb_integration_equations, only: integration_equations_t
   use hb_integration_system, only: integration_system_t
   use hb_kinds, only: wp
   use hb_lapack, only: dgetrs
   use hb_law, only: hold_t
   implicit none
   private
   public :: flight_t, is_made_of_flights, new_flight

   integer, parameter :: series_order = 20                            ! of the series
   integer, parameter :: n_parts = 4                                  ! of a step on which events are sought
   real(wp), parameter :: error_of_step = 1.0e-16_wp                  ! relative to the largest motion so far
   real(wp), parameter :: max_step = 2.0_wp                           ! step, in units of the time of the fastest motion
   real(wp), parameter :: first_part = 1.0e-4_wp                      ! relative to the others
   real(wp), parameter :: max_growth_of_parts = 4.0_wp                ! from one part to the next
   real(wp), parameter :: slope_distance = 1.0e-3_wp                  ! for slopes, relative to a part
   real(wp), parameter :: time_rounding = 4.0_wp*epsilon(1.0_wp)      ! of an event, relative
   integer, parameter :: max_iterations = 200                         ! to locate an event
   integer, parameter :: steps_between_checks = 32

   type :: flight_t
      private
      type(integration_equations_t), pointer :: equations => null()
      real(wp), allocatable :: q(:, :)                                ! coefficients of the series, (n_dofs, 0:order + 1)
      real(wp) :: unit = 1.0_wp                                       ! of its time [s]
      real(wp) :: from = 0.0_wp, to = 0.0_wp                          ! where it holds [s]
      real(wp) :: searched = 0.0_wp                                   ! there is no event before [s]
      real(wp) :: part = 0.0_wp                                       ! length of the next part to search [s]
      real(wp), allocatable :: g(:), slope(:)                         ! functions of the events there, and their slopes [1/s]
      logical :: has_event = .false.                                  ! at `searched`
      integer, allocatable :: found(:)                                ! as of hb_sundials%cvode_t
      integer :: n_steps = 0
   contains
      procedure :: restart => flight_restart
      procedure :: advance => flight_advance
   end type flight_t

contains

   !> Whether a system has walls, no other law, and loads that are sums of harmonics: its equations are then linear between events.
   !> Rigid friction is excluded, whose slips may be far shorter than a step.
   pure logical function is_made_of_flights(system, rigid)
      type(integration_system_t), intent(in) :: system
      type(hold_t), intent(in) :: rigid(:)                            !! its rigid laws

      is_made_of_flights = size(rigid) > 0 .and. all(rigid%is_wall) .and. all(system%laws%spans%is_held_back) .and. &
                           .not. system%laws%has_turning .and. size(system%loads%timed) == 0
   end function is_made_of_flights

   !> Flights of a model with walls; its time is counted in units of the fastest motion.
   subroutine new_flight(self, equations)
      type(flight_t), intent(out) :: self
      type(integration_equations_t), intent(in), target :: equations
      real(wp) :: fastest
      integer :: i

      self%equations => equations
      associate (system => equations%system)
         allocate (self%q(system%n_dofs, 0:series_order + 1), self%found(equations%n_events()))
         allocate (self%g(equations%n_events()), self%slope(equations%n_events()))
         fastest = system%loads%highest_frequency()
         do i = 1, system%n_dofs
            associate (m => system%structure%mass(i, i), k => system%structure%stiffness(i, i), d => system%structure%damping(i, i))
               if (m > 0.0_wp) fastest = max(fastest, sqrt(abs(k)/m), abs(d)/m)
            end associate
         end do
      end associate
      if (fastest > 0.0_wp) self%unit = 1.0_wp/fastest
   end subroutine new_flight

   !> Begins at a state, after an event or a jump of the time.
   subroutine flight_restart(self, t, y)
      class(flight_t), intent(inout) :: self
      real(wp), intent(in) :: t                                       !! [s]
      real(wp), intent(in), contiguous :: y(:)                        !! (q, v)

      call expand(self, t, y)
      self%part = first_part*(self%to - self%from)/n_parts
      call self%equations%events(t, y, self%g)
      call find_slope(self, t, self%part, self%g, self%slope)
      self%has_event = .false.
      self%found = 0
   end subroutine flight_restart

   !> Goes on to `t_end`, or to an event before it.
   subroutine flight_advance(self, t_end, y, t, is_event, found, error)
      class(flight_t), intent(inout) :: self
      real(wp), intent(in) :: t_end                                   !! [s]
      real(wp), intent(out), contiguous :: y(:)                       !! (q, v)
      real(wp), intent(out) :: t                                      !! where y holds [s]
      logical, intent(out) :: is_event
      integer, intent(out) :: found(:)                                !! of each event: 0 no, -1 falling
      type(error_t), allocatable, intent(out) :: error

      found = 0
      associate (laws => self%equations%system%laws)
         do while (self%searched < t_end .and. .not. self%has_event)
            if (self%searched >= self%to) then
               self%n_steps = self%n_steps + 1
               if (laws%n_evaluations > laws%max_evaluations .or. &
                   (modulo(self%n_steps, steps_between_checks) == 0 .and. work_is_over())) then
                  call fail(error, "the time integration was ended before its time")
                  return
               end if
               call evaluate(self, self%to, y)
               call expand(self, self%to, y)
            end if
            call search(self, min(self%to, self%searched + self%part))
            self%part = min(max_growth_of_parts*self%part, (self%to - self%from)/n_parts)
         end do
      end associate
      is_event = self%has_event .and. self%searched <= t_end
      t = t_end
      if (is_event) then
         t = self%searched
         found = self%found
         self%has_event = .false.
      end if
      call evaluate(self, t, y)
   end subroutine flight_advance

   !> Finds the series from a state on, and how far it holds.
   subroutine expand(self, t, y)
      class(flight_t), intent(inout) :: self
      real(wp), intent(in) :: t
      real(wp), intent(in) :: y(:)
      complex(wp) :: phasors(self%equations%system%accelerations%n_active)
      real(wp) :: a(size(self%q, 1)), length, rate(size(self%q, 1)), reactions(size(self%equations%active))
      integer :: i, info, k, n

      n = size(self%q, 1)
      associate (equations => self%equations, system => self%equations%system, q => self%q, unit => self%unit)
         self%from = t
         self%searched = t
         q(:, 0) = y(:n)
         q(:, 1) = unit*y(n + 1:)
         associate (loads => system%accelerations)
            phasors = loads%phasor*exp(cmplx(0.0_wp, loads%frequency*t, wp))
            do k = 0, series_order - 1
               a = matmul(loads%cosine, real(phasors, wp)) + matmul(loads%sine, aimag(phasors))
               phasors = phasors*cmplx(0.0_wp, loads%frequency*unit/(k + 1), wp)
               rate = (k + 1)/unit*q(:, k + 1)
               call system%stiffness%subtract_product(q(:, k), a)
               call system%damping%subtract_product(rate, a)
               if (size(reactions) > 0) then
                  do i = 1, size(reactions)
                     reactions(i) = dot_product(system%laws%shape(:, equations%rigid(equations%active(i))%coordinate), a)
                  end do
                  call dgetrs("N", size(reactions), 1, equations%factor, size(reactions), equations%pivots, reactions, &
                              size(reactions), info)
                  a = a - matmul(equations%accelerance(:, equations%active), reactions)
               end if
               q(:, k + 2) = unit**2/((k + 1.0_wp)*(k + 2.0_wp))*a
            end do
         end associate
         system%laws%n_evaluations = system%laws%n_evaluations + series_order
         length = max_step
         do k = series_order, series_order + 1
            length = min(length, shortest(abs(q(:, k)), equations%scale(:n), k), &
                         shortest(k*abs(q(:, k))/unit, equations%scale(n + 1:), k - 1))
         end do
         self%to = t + length*unit
         self%part = min(self%part, (self%to - self%from)/n_parts)
         if (.not. self%part > 0.0_wp) self%part = (self%to - self%from)/n_parts
      end associate

   contains

      !> Time over which a term stays below the permitted error.
      pure real(wp) function shortest(terms, scale, power)
         real(wp), intent(in) :: terms(:), scale(:)
         integer, intent(in) :: power

         shortest = (error_of_step*maxval(scale)/max(maxval(terms), tiny(1.0_wp)))**(1.0_wp/power)
      end function shortest
   end subroutine expand

   !> State at a time at which the series holds.
   pure subroutine evaluate(self, t, y)
      class(flight_t), intent(in) :: self
      real(wp), intent(in) :: t
      real(wp), intent(out) :: y(:)
      real(wp) :: s
      integer :: k, n

      n = size(self%q, 1)
      s = (t - self%from)/self%unit
      y(:n) = self%q(:, series_order + 1)
      y(n + 1:) = (series_order + 1)*self%q(:, series_order + 1)
      do k = series_order, 1, -1
         y(:n) = self%q(:, k) + s*y(:n)
         y(n + 1:) = k*self%q(:, k) + s*y(n + 1:)
      end do
      y(:n) = self%q(:, 0) + s*y(:n)
      y(n + 1:) = y(n + 1:)/self%unit
   end subroutine evaluate

   !> Functions of the events at a time at which the series holds.
   subroutine find_functions(self, t, g)
      class(flight_t), intent(inout) :: self
      real(wp), intent(in) :: t
      real(wp), intent(out), contiguous :: g(:)
      real(wp) :: y(2*size(self%q, 1))

      call evaluate(self, t, y)
      call self%equations%events(t, y, g)
   end subroutine find_functions

   !> Their slopes there.
   subroutine find_slope(self, t, part, g, slope)
      class(flight_t), intent(inout) :: self
      real(wp), intent(in) :: t, part                                 !! [s]
      real(wp), intent(in) :: g(:)                                    !! functions there
      real(wp), intent(out), contiguous :: slope(:)

      call find_functions(self, t + slope_distance*part, slope)
      slope = (slope - g)/(slope_distance*part)
   end subroutine find_slope

   !> Seeks the first event up to a time, or on the first part of this interval on which there can be no event between its ends.
   subroutine search(self, end)
      class(flight_t), intent(inout) :: self
      real(wp), intent(in) :: end
      real(wp) :: high(size(self%g)), part, slope(size(self%g))

      part = end - self%searched
      do
         call find_functions(self, self%searched + part, high)
         if (any(self%g > 0.0_wp .and. high <= 0.0_wp)) then
            call locate(self, self%searched + part, high)
            return
         end if
         call find_slope(self, self%searched + part, part, high, slope)
         if (.not. any(meet_below(self%g, self%slope, high, slope, part)) .or. part <= rounding(self, end)) exit
         part = 0.5_wp*part
      end do
      if (part < end - self%searched) self%part = part
      self%searched = merge(end, self%searched + part, part >= end - self%searched)
      self%g = high
      self%slope = slope
   end subroutine search

   !> Whether the tangents at two ends of a part, where a function is positive, meet between these below zero.
   elemental logical function meet_below(g, slope, g_end, slope_end, part)
      real(wp), intent(in) :: g, slope, g_end, slope_end
      real(wp), intent(in) :: part                                    !! length

      meet_below = g > 0.0_wp .and. slope < 0.0_wp .and. slope_end > 0.0_wp
      if (meet_below) meet_below = g + slope*(slope_end*part - (g_end - g))/(slope_end - slope) <= 0.0_wp
   end function meet_below

   !> Distance of times below which events are not told apart.
   pure real(wp) function rounding(self, t)
      class(flight_t), intent(in) :: self
      real(wp), intent(in) :: t                                       !! the larger one [s]

      rounding = time_rounding*(max(abs(self%searched), abs(t)) + self%to - self%from)
   end function rounding

   !> Locates the first event up to a time, by false position on the function that reaches zero first.
   subroutine locate(self, end, high)
      class(flight_t), intent(inout) :: self
      real(wp), intent(in) :: end
      real(wp), intent(inout) :: high(:)                              !! functions there
      real(wp) :: g(size(self%g)), low(size(self%g)), middle, share, times(2), weights(2)
      integer :: i, iteration, last

      low = self%g
      times = [self%searched, end]
      weights = 1.0_wp
      last = 0
      do iteration = 1, max_iterations
         if (times(2) - times(1) <= rounding(self, times(2))) exit
         i = maxloc(-high/(low - high), dim=1, mask=low > 0.0_wp .and. high <= 0.0_wp)
         share = weights(1)*low(i)/(weights(1)*low(i) - weights(2)*high(i))
         if (modulo(iteration, 5) == 0) share = 0.5_wp
         middle = times(1) + share*(times(2) - times(1))
         associate (least => 0.25_wp*rounding(self, times(2)))
            middle = min(max(middle, times(1) + least), times(2) - least)
         end associate
         call find_functions(self, middle, g)
         i = merge(2, 1, any(low > 0.0_wp .and. g <= 0.0_wp))
         if (i == last) weights(3 - i) = 0.5_wp*weights(3 - i)
         if (i /= last) weights = 1.0_wp
         last = i
         times(i) = middle
         if (i == 2) high = g
         if (i == 1) low = g
      end do
      self%has_event = .true.
      self%searched = times(2)
      self%found = merge(-1, 0, low > 0.0_wp .and. high <= 0.0_wp)
      self%g = high
      call find_slope(self, self%searched, self%part, self%g, self%slope)
   end subroutine locate
end module hb_flight
