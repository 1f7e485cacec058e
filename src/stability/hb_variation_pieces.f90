!> Division of time at the events of a motion: a switch of a law changes its sign, or a slider begins or ends to slip.
!>
!> On each piece the coefficients of the linearised equations are smooth, so that it is integrated at high order. No
!> force jumps at an event, so that the state does not either (its saltation matrix is the identity: R. I. Leine and
!> H. Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems, Springer 2004, section 7.4).
module hb_variation_pieces
   use hb_cancellation, only: work_is_over
   use hb_hysteretic_law, only: hysteretic_law_t
   use hb_kinds, only: wp
   use hb_thresholds, only: max_bisections, rounding_level
   use hb_variation, only: piece_t, variation_t
   implicit none
   private
   public :: bracket_t, cut_time, make_sliders_periodic

   integer, parameter :: max_passes = 3                              ! events of a slider between two detection times
   integer, parameter :: max_passes_to_extreme = 6                   ! of a switch between two detection times
   integer, parameter :: max_periods = 4                             ! until sliders are periodic

   type :: event_t
      real(wp) :: time = 0.0_wp
      integer :: slider = 0                                           ! 0: a switch of a law
      integer :: slip = 0                                             ! of the slider from then on
      real(wp) :: held = 0.0_wp                                       ! its position
   end type event_t

   !> Zero of a function by false position (Illinois), to rounding.
   type :: bracket_t
      real(wp) :: low, high                                           !! arguments
      real(wp) :: value_low = 0.0_wp, value_high = 0.0_wp             !! values there, of opposite signs
      real(wp) :: middle = 0.0_wp                                     !! next argument, finally the zero
      integer, private :: side = 0, pass = 0
   contains
      procedure :: is_wide => bracket_is_wide
      procedure :: narrow => bracket_narrow
   end type bracket_t

   !> The switches of a law, whose zeros are located together.
   type :: switch_search_t
      type(variation_t), pointer :: variation => null()
      integer :: i = 0                                                ! law
      type(bracket_t), allocatable :: brackets(:)                     ! of the zeros, the first `n` of them
      integer, allocatable :: of_switch(:)                            ! switch of each bracket
      integer :: n = 0
   end type switch_search_t

   !> The sliders of a law between two detection times.
   type :: slip_search_t
      type(variation_t), pointer :: variation => null()
      integer :: i = 0                                                ! law
      integer :: s = 0, slider = 0                                    ! slider, among those of the law and among all
      real(wp) :: times(2) = 0.0_wp                                   ! detection times
      real(wp), dimension(:), allocatable :: lower, upper, lower_rate, upper_rate   ! bounds at the last evaluation
      type(event_t), allocatable :: events(:)
      integer :: n = 0                                                ! number of events
   end type slip_search_t

contains

   !> Divides an interval of time at its events, which are searched for between `n_instants` instants.
   subroutine cut_time(self, start, finish, n_instants, pieces)
      type(variation_t), intent(inout) :: self
      real(wp), intent(in) :: start, finish                           !! [s]
      integer, intent(in) :: n_instants
      type(piece_t), allocatable, intent(out) :: pieces(:)
      type(event_t), allocatable :: events(:), found(:)
      real(wp), allocatable :: times(:), v(:, :), z(:, :)
      integer, allocatable :: first_slip(:)
      real(wp), allocatable :: first_held(:)
      integer :: i

      allocate (events(0))
      call self%enter(start, finish)
      call place_sliders(self, start)
      first_slip = self%slip
      first_held = self%held
      if (.not. self%is_smooth()) then
         times = [(start + (finish - start)*i/n_instants, i=0, n_instants)]
         allocate (z(size(times), self%n_coordinates), v(size(times), self%n_coordinates))
         call self%find_motion(times, z, v)
         do i = 1, size(self%laws)
            if (self%laws(i)%law%n_switches > 0) then
               call find_switching(self, i, times, z, v, found)
               events = [events, found]
            end if
            if (self%spans(i)%last_state >= self%spans(i)%first_state) then
               call find_slipping(self, i, times, z, v, found)
               events = [events, found]
            end if
         end do
         call sort(events)
      end if
      call make_pieces(self, start, finish, first_slip, first_held, events, pieces)
   end subroutine cut_time

   !> Propagates sliders round a period until they are periodic.
   subroutine make_sliders_periodic(self, start, finish, n_instants)
      type(variation_t), intent(inout) :: self
      real(wp), intent(in) :: start, finish                           !! [s]
      integer, intent(in) :: n_instants
      type(piece_t), allocatable :: pieces(:)
      real(wp), allocatable :: before(:)
      integer :: period

      if (self%n_states == 0) return
      do period = 1, max_periods
         if (work_is_over()) exit
         before = self%held
         call cut_time(self, start, finish, n_instants, pieces)
         if (period > 1 .and. all(abs(self%held - before) <= rounding_level*maxval(self%extent))) exit
      end do
      self%has_slipped = .false.
   end subroutine make_sliders_periodic

   !> Sign changes of the switches of law i, all located together, because a motion is evaluated more cheaply at many
   !> times at once.
   subroutine find_switching(self, i, times, z, v, events)
      type(variation_t), intent(inout), target :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: times(:), z(:, :), v(:, :)
      type(event_t), allocatable, intent(out) :: events(:)
      type(switch_search_t) :: search
      real(wp) :: values(self%laws(i)%law%n_switches, size(times))
      integer :: k

      search%variation => self
      search%i = i
      allocate (search%brackets(size(values)), search%of_switch(size(values)))
      call switches_at(self, i, times, z, v, values)
      call find_sign_changes(search, times, values)
      call find_touches(search, times, values)
      call narrow_all(search)
      events = [(event_t(time=search%brackets(k)%middle), k=1, search%n)]
   end subroutine find_switching

   !> Adds the sign changes of the values at the instants.
   subroutine find_sign_changes(search, times, values)
      type(switch_search_t), intent(inout) :: search
      real(wp), intent(in) :: times(:), values(:, :)                  !! (n_times), (n_switches, n_times)
      integer :: k, s

      do k = 2, size(times)
         do s = 1, size(values, 1)
            if (values(s, k - 1) > 0.0_wp .neqv. values(s, k) > 0.0_wp) &
               call add_sign_change(search, s, times(k - 1:k), values(s, k - 1:k))
         end do
      end do
   end subroutine find_sign_changes

   !> Adds pairs of sign changes between instants.
   subroutine find_touches(search, times, values)
      type(switch_search_t), intent(inout) :: search
      real(wp), intent(in) :: times(:), values(:, :)                  !! (n_times), (n_switches, n_times)
      integer :: k, s

      do k = 2, size(times) - 1
         do s = 1, size(values, 1)
            if (is_passed_between(values(s, k - 1:k + 1))) &
               call find_touch(search, s, times(k - 1:k + 1), values(s, k - 1:k + 1))
         end do
      end do
   end subroutine find_touches

   !> Adds a sign change of a switch between two times.
   subroutine add_sign_change(search, s, times, values)
      type(switch_search_t), intent(inout) :: search
      integer, intent(in) :: s                                        !! switch
      real(wp), intent(in) :: times(2), values(2)

      search%n = search%n + 1
      search%brackets(search%n) = bracket_t(low=times(1), high=times(2), value_low=values(1), value_high=values(2))
      search%of_switch(search%n) = s
   end subroutine add_sign_change

   !> Two sign changes between instants: where the extreme of the parabola through three values has the other sign, as the motion
   !> may have, this extreme is improved.
   subroutine find_touch(search, s, times, values)
      type(switch_search_t), intent(inout) :: search
      integer, intent(in) :: s                                        !! switch
      real(wp), intent(in) :: times(3), values(3)
      real(wp) :: at(3), now(3), extreme, value
      integer :: pass

      at = times
      now = values
      do pass = 1, max_passes_to_extreme
         extreme = extreme_of_parabola(at, now)
         if (.not. (extreme > at(1) .and. extreme < at(3)) .or. abs(extreme - at(2)) <= rounding_level*(times(3) - times(1))) return
         value = switch_at(search, s, extreme)
         if (value > 0.0_wp .neqv. now(2) > 0.0_wp) then
            call add_sign_change(search, s, [times(1), extreme], [values(1), value])
            call add_sign_change(search, s, [extreme, times(3)], [value, values(3)])
            return
         end if
         if (abs(value) >= abs(now(2))) return
         if (extreme < at(2)) then
            at = [at(1), extreme, at(2)]
            now = [now(1), value, now(2)]
         else
            at = [at(2), extreme, at(3)]
            now = [now(2), value, now(3)]
         end if
      end do
   end subroutine find_touch

   !> Value of a switch at a time.
   real(wp) function switch_at(search, s, time)
      type(switch_search_t), intent(inout) :: search
      integer, intent(in) :: s
      real(wp), intent(in) :: time
      real(wp), dimension(1, search%variation%n_coordinates) :: v, z
      real(wp) :: values(search%variation%laws(search%i)%law%n_switches, 1)

      call search%variation%find_motion([time], z, v)
      call switches_at(search%variation, search%i, [time], z, v, values)
      switch_at = values(s, 1)
   end function switch_at

   !> Narrows the brackets until all are at their zeros.
   subroutine narrow_all(search)
      type(switch_search_t), intent(inout) :: search
      logical :: is_wide(search%n)
      integer :: k

      do
         do k = 1, search%n
            is_wide(k) = search%brackets(k)%is_wide()
         end do
         if (.not. any(is_wide)) exit
         call narrow_together(search, pack([(k, k=1, search%n)], is_wide))
      end do
   end subroutine narrow_all

   !> Narrows some brackets once, by one evaluation of the motion.
   subroutine narrow_together(search, wide)
      type(switch_search_t), intent(inout) :: search
      integer, intent(in) :: wide(:)                                  !! their numbers
      real(wp), dimension(size(wide), search%variation%n_coordinates) :: v, z
      real(wp) :: values(search%variation%laws(search%i)%law%n_switches, size(wide))
      integer :: k

      associate (middles => search%brackets(wide)%middle)
         call search%variation%find_motion(middles, z, v)
         call switches_at(search%variation, search%i, middles, z, v, values)
      end associate
      do k = 1, size(wide)
         call search%brackets(wide(k))%narrow(values(search%of_switch(wide(k)), k))
      end do
   end subroutine narrow_together

   !> Whether the parabola through three values of one sign at equal distances, the middle one nearest to zero, nearly reaches zero.
   pure logical function is_passed_between(values)
      real(wp), intent(in) :: values(3)
      real(wp), parameter :: parabola_margin = 0.1_wp                 ! by which the motion may differ from the parabola
      real(wp) :: bend, sizes(3)

      is_passed_between = (all(values > 0.0_wp) .or. all(values < 0.0_wp))
      if (.not. is_passed_between) return
      sizes = abs(values)
      bend = sizes(1) - 2*sizes(2) + sizes(3)
      is_passed_between = sizes(2) < sizes(1) .and. sizes(2) <= sizes(3) .and. bend > 0.0_wp
      if (is_passed_between) is_passed_between = sizes(2) - (sizes(3) - sizes(1))**2/(8*bend) <= parabola_margin*bend
   end function is_passed_between

   !> Argument of the extreme of the parabola through three points.
   pure real(wp) function extreme_of_parabola(at, values) result(extreme)
      real(wp), intent(in) :: at(3), values(3)
      real(wp) :: slopes(2)

      slopes = (values(2:) - values(:2))/(at(2:) - at(:2))
      extreme = huge(1.0_wp)
      if (abs(slopes(2) - slopes(1)) > 0.0_wp) &
         extreme = 0.5_wp*(at(1) + at(2)) - 0.5_wp*slopes(1)*(at(3) - at(1))/(slopes(2) - slopes(1))
   end function extreme_of_parabola

   !> Chooses the next middle; the start if there is no sign change. False if no further evaluation is needed.
   logical function bracket_is_wide(self) result(is_wide)
      class(bracket_t), intent(inout) :: self

      if (self%value_low > 0.0_wp .eqv. self%value_high > 0.0_wp) then
         self%middle = self%low
         is_wide = .false.
         return
      end if
      self%middle = (self%low*self%value_high - self%high*self%value_low)/(self%value_high - self%value_low)
      if (.not. (self%middle > self%low .and. self%middle < self%high)) self%middle = 0.5_wp*(self%low + self%high)
      is_wide = self%pass < max_bisections &
                .and. self%high - self%low > 4.0_wp*epsilon(1.0_wp)*max(abs(self%low), abs(self%high))
   end function bracket_is_wide

   !> Replaces the value at one of the ends by that at the middle.
   subroutine bracket_narrow(self, value)
      class(bracket_t), intent(inout) :: self
      real(wp), intent(in) :: value

      self%pass = self%pass + 1
      if (value > 0.0_wp .eqv. self%value_low > 0.0_wp) then
         self%low = self%middle
         self%value_low = value
         if (self%side == 1) self%value_high = 0.5_wp*self%value_high
         self%side = 1
      else
         self%high = self%middle
         self%value_high = value
         if (self%side == 2) self%value_low = 0.5_wp*self%value_low
         self%side = 2
      end if
   end subroutine bracket_narrow

   !> Values of the switches of law i at several times, where the motion is known.
   subroutine switches_at(self, i, times, z, v, values)
      type(variation_t), intent(inout) :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: times(:), z(:, :), v(:, :)              !! (n_times), (n_times, n_coordinates)
      real(wp), intent(out) :: values(:, :)                           !! (n_switches, n_times)
      integer :: k

      associate (span => self%spans(i))
         do k = 1, size(times)
            call set_time(self, i, times(k))
            call self%laws(i)%law%switches(z(k, span%first:span%last), v(k, span%first:span%last), values(:, k))
         end do
      end associate
   end subroutine switches_at

   !> Starts sliders at their last positions, moved into their bounds.
   subroutine place_sliders(self, time)
      type(variation_t), intent(inout) :: self
      real(wp), intent(in) :: time
      real(wp) :: v(1, self%n_coordinates), z(1, self%n_coordinates)
      real(wp), dimension(self%n_states) :: lower, lower_rate, upper, upper_rate
      integer :: i

      if (self%n_states == 0) return
      call self%find_motion([time], z, v)
      do i = 1, size(self%laws)
         select type (law => self%laws(i)%law)
         class is (hysteretic_law_t)
            associate (a => self%spans(i)%first, b => self%spans(i)%last, m => self%spans(i)%first_state, &
                       n => self%spans(i)%last_state)
               call law%bounds(z(1, a:b), v(1, a:b), lower(m:n), upper(m:n), lower_rate(m:n), upper_rate(m:n))
            end associate
         end select
      end do
      where (self%held < lower .or. (self%slip > 0 .and. lower_rate > 0.0_wp))
         self%slip = 1
      else where (self%held > upper .or. (self%slip < 0 .and. upper_rate < 0.0_wp))
         self%slip = -1
      else where
         self%slip = 0
      end where
      self%held = min(max(self%held, lower), upper)
      self%has_slipped = self%has_slipped .or. self%slip /= 0
   end subroutine place_sliders

   !> Propagates the sliders of law i, and records where each begins or ends to slip.
   subroutine find_slipping(self, i, times, z, v, events)
      type(variation_t), intent(inout), target :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: times(:), z(:, :), v(:, :)
      type(event_t), allocatable, intent(out) :: events(:)
      type(slip_search_t) :: search
      real(wp), allocatable :: before_lower(:), before_upper(:)
      integer :: k, n, s

      search%variation => self
      search%i = i
      associate (span => self%spans(i))
         n = span%last_state - span%first_state + 1
         allocate (search%lower(n), search%upper(n), search%lower_rate(n), search%upper_rate(n))
         allocate (search%events(max_passes*size(times)*n))
         call find_bounds(search, z(1, span%first:span%last), v(1, span%first:span%last))
         do k = 2, size(times)
            search%times = times(k - 1:k)
            before_lower = search%lower_rate
            before_upper = search%upper_rate
            call find_bounds(search, z(k, span%first:span%last), v(k, span%first:span%last))
            do s = 1, n
               search%s = s
               search%slider = span%first_state + s - 1
               call follow_slider(search, before_lower(s), before_upper(s), z(k, span%first:span%last), &
                                  v(k, span%first:span%last))
            end do
         end do
      end associate
      events = search%events(:search%n)
   end subroutine find_slipping

   !> Propagates a slider from one detection time to the next, over the events in between.
   subroutine follow_slider(search, lower_rate_before, upper_rate_before, z, v)
      type(slip_search_t), intent(inout) :: search
      real(wp), intent(in) :: lower_rate_before, upper_rate_before    !! of its bounds at the previous detection time
      real(wp), intent(in) :: z(:), v(:)                              !! of the law at the present one
      real(wp) :: margin
      integer :: pass
      logical :: is_followed

      associate (slip => search%variation%slip(search%slider), held => search%variation%held(search%slider), &
                 lower => search%lower(search%s), lower_rate => search%lower_rate(search%s), &
                 upper => search%upper(search%s), upper_rate => search%upper_rate(search%s), now => search%times(2))
         do pass = 1, max_passes
            is_followed = .false.
            margin = 8.0_wp*epsilon(1.0_wp)*max(abs(lower), abs(upper))
            if (slip == 0 .and. held < lower - margin) then
               call note(search, 1, time_of(search, 1, .false., now))
            else if (slip == 0 .and. held > upper + margin) then
               call note(search, -1, time_of(search, -1, .false., now))
            else if (slip == 1 .and. lower_rate < 0.0_wp) then
               call note(search, 0, time_of(search, 1, .true., now))
            else if (slip == -1 .and. upper_rate > 0.0_wp) then
               call note(search, 0, time_of(search, -1, .true., now))
            else if (slip == 0 .and. lower_rate_before > 0.0_wp .and. lower_rate < 0.0_wp) then
               is_followed = .not. slips_at_turn(search, 1, margin)
            else if (slip == 0 .and. upper_rate_before < 0.0_wp .and. upper_rate > 0.0_wp) then
               is_followed = .not. slips_at_turn(search, -1, margin)
            else
               exit
            end if
            call find_bounds(search, z, v)                            ! also for the sliders that follow
            if (is_followed) exit
         end do
         if (slip == 1) held = lower
         if (slip == -1) held = upper
      end associate
   end subroutine follow_slider

   !> Computes the bounds of the sliders of the law and their rates.
   subroutine find_bounds(search, z, v)
      type(slip_search_t), intent(inout) :: search
      real(wp), intent(in) :: z(:), v(:)

      select type (law => search%variation%laws(search%i)%law)
      class is (hysteretic_law_t)
         call law%bounds(z, v, search%lower, search%upper, search%lower_rate, search%upper_rate)
      end select
   end subroutine find_bounds

   !> Records an event; one that ends a slip stores the position of the slider.
   subroutine note(search, slip, time)
      type(slip_search_t), intent(inout) :: search
      integer, intent(in) :: slip
      real(wp), intent(in) :: time

      associate (variation => search%variation, slider => search%slider)
         if (slip == 0) variation%held(slider) = merge(search%lower(search%s), search%upper(search%s), &
                                                       variation%slip(slider) == 1)          ! as left by `time_of`
         search%n = search%n + 1
         search%events(search%n) = event_t(time, slider, slip, variation%held(slider))
         variation%slip(slider) = slip
         if (slip /= 0) variation%has_slipped(slider) = .true.
      end associate
   end subroutine note

   !> Whether a bound that reverses between two detection times moves the slider there: however short the slip, the
   !> slider forgets its position.
   logical function slips_at_turn(search, side, margin) result(slips)
      type(slip_search_t), intent(inout) :: search
      integer, intent(in) :: side
      real(wp), intent(in) :: margin
      real(wp) :: turn

      turn = time_of(search, side, .true., search%times(2))
      slips = beyond(search, turn, side, .false.) > margin
      if (slips) call note(search, side, time_of(search, side, .false., turn))
   end function slips_at_turn

   !> Time until which a bound reaches the slider or, with `stops`, the bound that moves it reverses; sets the bounds
   !> to that time.
   real(wp) function time_of(search, side, stops, until)
      type(slip_search_t), intent(inout) :: search
      integer, intent(in) :: side
      logical, intent(in) :: stops
      real(wp), intent(in) :: until
      type(bracket_t) :: bracket

      bracket = bracket_t(low=earliest(search), high=until)
      bracket%value_high = beyond(search, bracket%high, side, stops)
      bracket%value_low = beyond(search, bracket%low, side, stops)
      do while (bracket%is_wide())
         call bracket%narrow(beyond(search, bracket%middle, side, stops))
      end do
      time_of = bracket%middle
      if (stops) call update_bounds(search, time_of)
   end function time_of

   !> Distance by which the bound has moved, or would have moved, the slider at a time; with `stops`, its speed away
   !> from it.
   real(wp) function beyond(search, time, side, stops)
      type(slip_search_t), intent(inout) :: search
      real(wp), intent(in) :: time
      integer, intent(in) :: side
      logical, intent(in) :: stops

      call update_bounds(search, time)
      associate (s => search%s, held => search%variation%held(search%slider))
         if (stops) then
            beyond = merge(-search%lower_rate(s), search%upper_rate(s), side == 1)
         else
            beyond = merge(search%lower(s) - held, held - search%upper(s), side == 1)
         end if
      end associate
   end function beyond

   !> The last event of the slider, or the previous detection time.
   pure real(wp) function earliest(search)
      type(slip_search_t), intent(in) :: search
      integer :: e

      earliest = search%times(1)
      e = findloc(search%events(:search%n)%slider, search%slider, dim=1, back=.true.)
      if (e > 0) earliest = max(earliest, search%events(e)%time)
   end function earliest

   !> Computes the bounds at a time.
   subroutine update_bounds(search, time)
      type(slip_search_t), intent(inout) :: search
      real(wp), intent(in) :: time
      real(wp), dimension(1, search%variation%n_coordinates) :: v, z

      associate (span => search%variation%spans(search%i))
         call search%variation%find_motion([time], z, v)
         call find_bounds(search, z(1, span%first:span%last), v(1, span%first:span%last))
      end associate
   end subroutine update_bounds

   !> Sorts events by time.
   pure subroutine sort(events)
      type(event_t), intent(inout) :: events(:)
      type(event_t) :: retained
      integer :: i, k

      do i = 2, size(events)
         retained = events(i)
         do k = i - 1, 1, -1
            if (events(k)%time <= retained%time) exit
            events(k + 1) = events(k)
         end do
         events(k + 1) = retained
      end do
   end subroutine sort

   !> Creates the pieces between events.
   subroutine make_pieces(self, start, finish, slip, held, events, pieces)
      type(variation_t), intent(inout) :: self
      real(wp), intent(in) :: start, finish
      integer, intent(in) :: slip(:)                                  !! at the start
      real(wp), intent(in) :: held(:)
      type(event_t), intent(in) :: events(:)
      type(piece_t), allocatable, intent(out) :: pieces(:)
      integer :: e

      allocate (pieces(size(events) + 1))
      pieces(1)%start = start
      pieces(1)%slip = slip
      pieces(1)%held = held
      do e = 1, size(events)
         associate (event => events(e), before => pieces(e), after => pieces(e + 1))
            before%finish = event%time
            before%is_before_event = .true.
            after%start = event%time
            after%is_after_event = .true.
            after%slip = before%slip
            after%held = before%held
            if (event%slider == 0) cycle
            after%slip(event%slider) = event%slip
            after%held(event%slider) = event%held
         end associate
      end do
      pieces(size(pieces))%finish = finish
   end subroutine make_pieces

   !> Sets the phase of the tone with which law i rotates.
   subroutine set_time(self, i, time)
      type(variation_t), intent(inout) :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: time

      associate (law => self%laws(i)%law)
         if (law%n_phases > 0) call law%set_phases(reshape(self%motion%omega*time, [size(self%motion%omega), 1]))
      end associate
   end subroutine set_time
end module hb_variation_pieces
