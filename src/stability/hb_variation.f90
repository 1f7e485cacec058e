!> What a small change of a known motion does as time goes on: the linearised equations along the motion.
!>
!> The state is (q, v/scale, places of sliders). Along the motion the laws' own derivatives make the coefficients, which are smooth
!> between events: a switch of a law changes its sign, a slider begins or ends to slip. The time is cut there, so that each piece
!> is integrated at high order. No force jumps at an event, so that the state does not either (its saltation matrix is the identity:
!> R. I. Leine and H. Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems, Springer 2004, section 7.4). A slider
!> that slips stands on its bound and has no memory of its own; one that sticks keeps its place.
!>
!> Method: commutator-free Magnus integrator of fourth order, which takes any stiffness of the constant part, with the moments of A
!> in a step by Simpson's rule. Source: S. Blanes and P. C. Moan, Applied Numerical Mathematics 56 (2006) 1519-1537.
module hb_variation
   use hb_error, only: error_t, fail
   use hb_hysteretic_law, only: hysteretic_law_t
   use hb_kinds, only: wp
   use hb_lapack, only: dpotrf, dpotrs
   use hb_law, only: law_box_t
   use hb_matrix_exponential, only: count_exponential, exponential_of, exponential_of_two
   use hb_motion_series, only: motion_series_t, new_motion_series
   use hb_structure, only: most_dense, structure_t
   implicit none
   private
   public :: new_variation, piece_t, variation_t

   integer, parameter :: most_halvings = 60
   integer, parameter :: most_passes = 3                              ! events of a slider between two looks
   integer, parameter :: most_laps = 4                                ! of a period, until sliders repeat their places
   real(wp), parameter :: nearness = 1.0e-6_wp                        ! of arguments whose difference makes a derivative
   real(wp), parameter :: same_place = 1.0e-9_wp                      ! of a slider, relative to its motion
   real(wp), parameter :: singular = 1.0e-13_wp                       ! pivot of the mass
   real(wp), parameter :: inside = 1.0e-8_wp                          ! of a piece, where its ends are looked at
   real(wp), parameter :: near = 0.25_wp, middle = 1.0_wp/3.0_wp, far = -1.0_wp/12.0_wp   ! weights of the nodes of a half step

   !> A stretch of time without events inside.
   type :: piece_t
      real(wp) :: start = 0.0_wp, finish = 0.0_wp                     !! [s]
      logical :: is_after_event = .false., is_before_event = .false.
      integer, allocatable :: slip(:)                                 !! (n_states) 1 on the lower bound, -1 on the upper, 0 sticks
      real(wp), allocatable :: held(:)                                !! (n_states) place of those that stick
      real(wp), allocatable, private :: by_place(:, :, :), by_rate(:, :, :), by_state(:, :, :)   ! slopes of the laws at nodes
   end type piece_t

   !> Where a law stands in the lists of all.
   type :: place_t
      integer :: first = 0, last = 0                                  !! coordinates
      integer :: first_state = 1, last_state = 0
   end type place_t

   type :: event_t
      real(wp) :: time = 0.0_wp
      integer :: slider = 0                                           !! 0: a switch of a law
      integer :: slip = 0                                             !! of the slider from then on
      real(wp) :: held = 0.0_wp                                       !! its place
   end type event_t

   type :: variation_t
      integer :: n_dofs = 0
      integer :: n_states = 0                                         !! sliders of all laws
      integer :: n_coordinates = 0                                    !! of all laws
      integer :: size = 0                                             !! of the state
      real(wp) :: scale = 1.0_wp                                      !! of velocities [1/s]
      real(wp) :: norm = 0.0_wp                                       !! of the constant part [1/s]
      type(motion_series_t) :: motion                                 !! of the coordinates
      integer, allocatable :: slip(:)                                 !! where the last piece ended, as in it
      real(wp), allocatable :: held(:)
      logical, allocatable :: has_slipped(:)                          !! (n_states) in any piece so far
      type(law_box_t), allocatable, private :: laws(:)
      type(place_t), allocatable, private :: places(:)
      real(wp), allocatable, private :: constant(:, :)                ! A of the structure alone, (size, size)
      real(wp), allocatable, private :: kick(:, :), shape(:, :)       ! M^-1 S and S, (n_dofs, n_coordinates)
      real(wp), allocatable, private :: reach(:)                      ! of the motion of each coordinate [m]
      logical, private :: has_turning = .false.
   contains
      procedure :: cut => variation_cut
      procedure :: settle => variation_settle
      procedure :: propagate => variation_propagate
      procedure :: is_smooth => variation_is_smooth
      procedure :: matrices => variation_matrices
      procedure :: work_of_node => variation_work_of_node
      procedure :: work_of_step => variation_work_of_step
   end type variation_t

contains

   !> Fails for a singular mass, for rigid laws and for laws whose memory does not tell its bounds.
   subroutine new_variation(self, structure, laws, tuples, omega, amplitudes, error)
      type(variation_t), intent(out) :: self
      type(structure_t), intent(in) :: structure
      type(law_box_t), intent(in) :: laws(:)
      integer, intent(in) :: tuples(:, :)                             !! (n_tones, n_harmonics)
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones)
      complex(wp), intent(in) :: amplitudes(:, :)                     !! of the motion, cos - i sin, (n_dofs, n_harmonics)
      type(error_t), allocatable, intent(out) :: error
      integer :: i, n

      call structure%refuse_large("stability", most_dense, error)
      if (allocated(error)) return
      n = structure%n_dofs
      self%n_dofs = n
      self%laws = laws
      allocate (self%places(size(laws)))
      do i = 1, size(laws)
         associate (law => self%laws(i)%law, place => self%places(i))
            if (law%is_multiplier) then
               call fail(error, "law '"//law%label//"' is rigid and has no derivative")
               return
            end if
            place%first = self%n_coordinates + 1
            self%n_coordinates = self%n_coordinates + size(law%shape, 2)
            place%last = self%n_coordinates
            self%has_turning = self%has_turning .or. law%phase_tone > 0
            select type (law)
            class is (hysteretic_law_t)
               if (.not. law%has_bounds) then
                  call fail(error, "the memory of law '"//law%label//"' has no bounds that could be followed")
                  return
               end if
               place%first_state = self%n_states + 1
               self%n_states = self%n_states + law%n_states
               place%last_state = self%n_states
            end select
         end associate
      end do
      self%size = 2*n + self%n_states
      allocate (self%shape(n, self%n_coordinates), source=0.0_wp)
      do i = 1, size(laws)
         self%shape(laws(i)%law%dofs, self%places(i)%first:self%places(i)%last) = laws(i)%law%shape
      end do
      call new_motion_series(self%motion, tuples, omega, matmul(transpose(self%shape), amplitudes))
      self%reach = max(sum(abs(self%motion%amplitudes), dim=2), tiny(1.0_wp))
      allocate (self%slip(self%n_states), source=0)
      allocate (self%held(self%n_states), source=0.0_wp)
      allocate (self%has_slipped(self%n_states), source=.false.)
      call divide_by_mass(self, structure, error)
   end subroutine new_variation

   subroutine divide_by_mass(self, structure, error)
      type(variation_t), intent(inout) :: self
      type(structure_t), intent(in) :: structure
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: damping(self%n_dofs, self%n_dofs), factor(self%n_dofs, self%n_dofs), stiffness(self%n_dofs, self%n_dofs)
      integer :: i, info, n

      n = self%n_dofs
      factor = structure%mass
      call dpotrf("L", n, factor, n, info)
      if (info == 0) then
         do i = 1, n
            if (factor(i, i)**2 <= singular*structure%mass(i, i)) info = i
         end do
      end if
      if (info /= 0) then
         call fail(error, "the mass matrix is singular at "//trim(structure%labels(info)))
         return
      end if
      stiffness = structure%stiffness
      damping = structure%damping
      self%kick = self%shape
      call dpotrs("L", n, n, factor, n, stiffness, n, info)
      call dpotrs("L", n, n, factor, n, damping, n, info)
      if (size(self%kick) > 0) call dpotrs("L", n, size(self%kick, 2), factor, n, self%kick, n, info)
      self%scale = sqrt(maxval(sum(abs(stiffness), dim=1)))
      self%scale = max(self%scale, maxval(abs(self%motion%omega)))
      allocate (self%constant(self%size, self%size), source=0.0_wp)
      do i = 1, n
         self%constant(i, n + i) = self%scale
      end do
      self%constant(n + 1:2*n, :n) = -stiffness/self%scale
      self%constant(n + 1:2*n, n + 1:2*n) = -damping
      self%norm = maxval(sum(abs(self%constant), dim=1))
   end subroutine divide_by_mass

   !> Cuts a stretch of time at its events, which are looked for between so many instants.
   subroutine variation_cut(self, start, finish, n_looks, pieces)
      class(variation_t), intent(inout) :: self
      real(wp), intent(in) :: start, finish                           !! [s]
      integer, intent(in) :: n_looks
      type(piece_t), allocatable, intent(out) :: pieces(:)
      type(event_t), allocatable :: events(:), found(:)
      real(wp), allocatable :: times(:), v(:, :), z(:, :)
      integer, allocatable :: first_slip(:)
      real(wp), allocatable :: first_held(:)
      integer :: i

      allocate (events(0))
      call place_sliders(self, start)
      first_slip = self%slip
      first_held = self%held
      if (.not. self%is_smooth()) then
         times = [(start + (finish - start)*i/n_looks, i=0, n_looks)]
         allocate (z(size(times), self%n_coordinates), v(size(times), self%n_coordinates))
         call self%motion%at(self%motion%phases(times), z, v)
         do i = 1, size(self%laws)
            if (self%laws(i)%law%n_switches > 0) then
               call find_switching(self, i, times, z, v, found)
               events = [events, found]
            end if
            if (self%places(i)%last_state >= self%places(i)%first_state) then
               call find_slipping(self, i, times, z, v, found)
               events = [events, found]
            end if
         end do
         call sort(events)
      end if
      call make_pieces(self, start, finish, first_slip, first_held, events, pieces)
   end subroutine variation_cut

   !> Follows sliders round a period until they repeat their places.
   subroutine variation_settle(self, start, finish, n_looks)
      class(variation_t), intent(inout) :: self
      real(wp), intent(in) :: start, finish                           !! [s]
      integer, intent(in) :: n_looks
      type(piece_t), allocatable :: pieces(:)
      real(wp), allocatable :: before(:)
      integer :: lap

      if (self%n_states == 0) return
      do lap = 1, most_laps
         before = self%held
         call self%cut(start, finish, n_looks, pieces)
         if (lap > 1 .and. all(abs(self%held - before) <= same_place*maxval(self%reach))) exit
      end do
      self%has_slipped = .false.
   end subroutine variation_settle

   !> Changes of sign of the switches of law i.
   subroutine find_switching(self, i, times, z, v, events)
      class(variation_t), intent(inout) :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: times(:), z(:, :), v(:, :)
      type(event_t), allocatable, intent(out) :: events(:)
      type(event_t), allocatable :: list(:)
      real(wp) :: after(self%laws(i)%law%n_switches), before(size(after))
      integer :: k, n, s

      n = 0
      allocate (list(size(times)*size(after)))
      associate (place => self%places(i), law => self%laws(i)%law)
         call switches_at(self, i, times(1), before)
         do k = 2, size(times)
            call set_time(self, i, times(k))
            call law%switches(z(k, place%first:place%last), v(k, place%first:place%last), after)
            do s = 1, size(after)
               if (before(s) > 0.0_wp .eqv. after(s) > 0.0_wp) cycle
               n = n + 1
               list(n)%time = root(times(k - 1), times(k), before(s), after(s), s)
            end do
            before = after
         end do
      end associate
      events = list(:n)

   contains

      !> By false position (Illinois).
      real(wp) function root(from, to, value_from, value_to, s) result(middle)
         real(wp), intent(in) :: from, to, value_from, value_to
         integer, intent(in) :: s
         real(wp) :: high, low, value_high, value_low, value(size(after))
         integer :: pass, side

         low = from
         high = to
         value_low = value_from
         value_high = value_to
         side = 0
         do pass = 1, most_halvings
            middle = (low*value_high - high*value_low)/(value_high - value_low)
            if (.not. (middle > low .and. middle < high)) middle = 0.5_wp*(low + high)
            if (high - low <= 4.0_wp*epsilon(1.0_wp)*max(abs(from), abs(to))) exit
            call switches_at(self, i, middle, value)
            if (value(s) > 0.0_wp .eqv. value_low > 0.0_wp) then
               low = middle
               value_low = value(s)
               if (side == 1) value_high = 0.5_wp*value_high
               side = 1
            else
               high = middle
               value_high = value(s)
               if (side == 2) value_low = 0.5_wp*value_low
               side = 2
            end if
         end do
      end function root
   end subroutine find_switching

   !> Values of the switches of law i at one time.
   subroutine switches_at(self, i, time, values)
      class(variation_t), intent(inout) :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: time
      real(wp), intent(out) :: values(:)
      real(wp) :: v(1, self%n_coordinates), z(1, self%n_coordinates)

      call self%motion%at(self%motion%phases([time]), z, v)
      call set_time(self, i, time)
      associate (place => self%places(i))
         call self%laws(i)%law%switches(z(1, place%first:place%last), v(1, place%first:place%last), values)
      end associate
   end subroutine switches_at

   !> Lets sliders stand where they were left, but within their bounds.
   subroutine place_sliders(self, time)
      class(variation_t), intent(inout) :: self
      real(wp), intent(in) :: time
      real(wp) :: v(1, self%n_coordinates), z(1, self%n_coordinates)
      real(wp), dimension(self%n_states) :: lower, lower_rate, upper, upper_rate
      integer :: i

      if (self%n_states == 0) return
      call self%motion%at(self%motion%phases([time]), z, v)
      do i = 1, size(self%laws)
         select type (law => self%laws(i)%law)
         class is (hysteretic_law_t)
            associate (a => self%places(i)%first, b => self%places(i)%last, m => self%places(i)%first_state, &
                       n => self%places(i)%last_state)
               call law%bounds(z(1, a:b), v(1, a:b), lower(m:n), upper(m:n), lower_rate(m:n), upper_rate(m:n))
            end associate
         end select
      end do
      where (self%held < lower .or. (self%slip > 0 .and. lower_rate > 0.0_wp))
         self%slip = 1
      elsewhere (self%held > upper .or. (self%slip < 0 .and. upper_rate < 0.0_wp))
         self%slip = -1
      elsewhere
         self%slip = 0
      end where
      self%held = min(max(self%held, lower), upper)
      self%has_slipped = self%has_slipped .or. self%slip /= 0
   end subroutine place_sliders

   !> Follows the sliders of law i, and notes where each begins or ends to slip.
   subroutine find_slipping(self, i, times, z, v, events)
      class(variation_t), intent(inout) :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: times(:), z(:, :), v(:, :)
      type(event_t), allocatable, intent(out) :: events(:)
      type(event_t), allocatable :: list(:)
      real(wp), dimension(self%places(i)%last_state - self%places(i)%first_state + 1) :: lower, lower_rate, upper, upper_rate
      real(wp) :: margin
      integer :: k, n, pass, s, slider

      n = 0
      allocate (list(most_passes*size(times)*size(lower)))
      associate (place => self%places(i))
         do k = 2, size(times)
            call bounds_of(z(k, place%first:place%last), v(k, place%first:place%last))
            do s = 1, size(lower)
               slider = place%first_state + s - 1
               do pass = 1, most_passes
                  margin = 8.0_wp*epsilon(1.0_wp)*max(abs(lower(s)), abs(upper(s)))
                  if (self%slip(slider) == 0 .and. self%held(slider) < lower(s) - margin) then
                     call note(1, slip_time(1))
                  else if (self%slip(slider) == 0 .and. self%held(slider) > upper(s) + margin) then
                     call note(-1, slip_time(-1))
                  else if (self%slip(slider) == 1 .and. lower_rate(s) < 0.0_wp) then
                     call note(0, stop_time(1))
                  else if (self%slip(slider) == -1 .and. upper_rate(s) > 0.0_wp) then
                     call note(0, stop_time(-1))
                  else
                     exit
                  end if
                  call bounds_of(z(k, place%first:place%last), v(k, place%first:place%last))
               end do
               if (self%slip(slider) == 1) self%held(slider) = lower(s)
               if (self%slip(slider) == -1) self%held(slider) = upper(s)
            end do
         end do
      end associate
      events = list(:n)

   contains

      subroutine bounds_of(z, v)
         real(wp), intent(in) :: z(:), v(:)

         select type (law => self%laws(i)%law)
         class is (hysteretic_law_t)
            call law%bounds(z, v, lower, upper, lower_rate, upper_rate)
         end select
      end subroutine bounds_of

      !> Notes an event at a time; one that ends a slip keeps the place of the slider there.
      subroutine note(slip, time)
         integer, intent(in) :: slip
         real(wp), intent(in) :: time

         n = n + 1
         list(n)%time = time
         list(n)%slider = slider
         list(n)%slip = slip
         if (slip == 0) self%held(slider) = merge(lower(s), upper(s), self%slip(slider) == 1)   ! as `stop_time` left them
         list(n)%held = self%held(slider)
         self%slip(slider) = slip
         if (slip /= 0) self%has_slipped(slider) = .true.
      end subroutine note

      !> When a bound reaches the slider.
      real(wp) function slip_time(side) result(middle)
         integer, intent(in) :: side
         real(wp) :: high, low

         call bracket(low, high)
         do
            middle = 0.5_wp*(low + high)
            if (high - low <= 4.0_wp*epsilon(1.0_wp)*max(abs(times(k - 1)), abs(times(k)))) exit
            call look(middle)
            if (merge(lower(s) - self%held(slider), self%held(slider) - upper(s), side == 1) > 0.0_wp) then
               high = middle
            else
               low = middle
            end if
         end do
      end function slip_time

      !> When the bound that pushes the slider turns back.
      real(wp) function stop_time(side) result(middle)
         integer, intent(in) :: side
         real(wp) :: high, low

         call bracket(low, high)
         do
            middle = 0.5_wp*(low + high)
            call look(middle)
            if (high - low <= 4.0_wp*epsilon(1.0_wp)*max(abs(times(k - 1)), abs(times(k)))) exit
            if (merge(-lower_rate(s), upper_rate(s), side == 1) > 0.0_wp) then
               high = middle
            else
               low = middle
            end if
         end do
      end function stop_time

      !> From the last event of this slider, or the last look, to this look.
      subroutine bracket(low, high)
         real(wp), intent(out) :: low, high
         integer :: e

         low = times(k - 1)
         high = times(k)
         do e = n, 1, -1
            if (list(e)%slider /= slider) cycle
            low = max(low, list(e)%time)
            exit
         end do
      end subroutine bracket

      subroutine look(time)
         real(wp), intent(in) :: time
         real(wp) :: v_there(1, self%n_coordinates), z_there(1, self%n_coordinates)

         call self%motion%at(self%motion%phases([time]), z_there, v_there)
         associate (place => self%places(i))
            call bounds_of(z_there(1, place%first:place%last), v_there(1, place%first:place%last))
         end associate
      end subroutine look
   end subroutine find_slipping

   !> Puts events into the order of time.
   pure subroutine sort(events)
      type(event_t), intent(inout) :: events(:)
      type(event_t) :: kept
      integer :: i, k

      do i = 2, size(events)
         kept = events(i)
         do k = i - 1, 1, -1
            if (events(k)%time <= kept%time) exit
            events(k + 1) = events(k)
         end do
         events(k + 1) = kept
      end do
   end subroutine sort

   !> The pieces between events.
   subroutine make_pieces(self, start, finish, slip, held, events, pieces)
      class(variation_t), intent(inout) :: self
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

   !> Tells law i the phase of the tone with which it turns.
   subroutine set_time(self, i, time)
      class(variation_t), intent(inout) :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: time

      associate (law => self%laws(i)%law)
         if (law%phase_tone > 0) call law%set_phase([self%motion%omega(law%phase_tone)*time])
      end associate
   end subroutine set_time

   !> Takes changes of the state from the start to the end of a piece in steps of equal length.
   subroutine variation_propagate(self, piece, n_steps, x)
      class(variation_t), intent(inout) :: self
      type(piece_t), intent(inout) :: piece
      integer, intent(in) :: n_steps
      real(wp), intent(inout) :: x(:, :)                              !! (size, any)
      real(wp), dimension(self%size, self%size) :: at_end, at_middle, at_start, e
      real(wp) :: h
      integer :: i

      h = (piece%finish - piece%start)/n_steps
      if (h > 0.0_wp) then
         call refine(self, piece, n_steps)
         if (self%size == 2) then
            call propagate_two(self, piece, h, x)
         else
            call fill(self, piece, 0, at_end)
            do i = 1, n_steps
               at_start = at_end
               call fill(self, piece, 2*i - 1, at_middle)
               call fill(self, piece, 2*i, at_end)
               call exponential_of(h*(near*at_start + middle*at_middle + far*at_end), e)
               x = matmul(e, x)
               call exponential_of(h*(far*at_start + middle*at_middle + near*at_end), e)
               x = matmul(e, x)
            end do
         end if
      end if
      if (self%n_states > 0) call move_sliders(self, piece, x)
   end subroutine variation_propagate

   !> The same steps for a single degree of freedom, without a matrix being made.
   subroutine propagate_two(self, piece, h, x)
      class(variation_t), intent(in) :: self
      type(piece_t), intent(in) :: piece
      real(wp), intent(in) :: h
      real(wp), intent(inout) :: x(:, :)                              !! (2, any)
      real(wp) :: damping(0:ubound(piece%by_place, 3)), e(2, 2), stiffness(0:ubound(piece%by_place, 3))
      integer :: c, d, i

      stiffness = h*self%constant(2, 1)
      damping = h*self%constant(2, 2)
      do d = 1, self%n_coordinates
         do c = 1, self%n_coordinates
            stiffness = stiffness - (h/self%scale*self%kick(1, c)*self%shape(1, d))*piece%by_place(c, d, :)
            damping = damping - (h*self%kick(1, c)*self%shape(1, d))*piece%by_rate(c, d, :)
         end do
      end do
      do i = 0, ubound(stiffness, 1) - 2, 2
         call exponential_of_two(0.0_wp, 0.5_wp*h*self%scale, near*stiffness(i) + middle*stiffness(i + 1) + far*stiffness(i + 2), &
                                 near*damping(i) + middle*damping(i + 1) + far*damping(i + 2), e)
         x = matmul(e, x)
         call exponential_of_two(0.0_wp, 0.5_wp*h*self%scale, far*stiffness(i) + middle*stiffness(i + 1) + near*stiffness(i + 2), &
                                 far*damping(i) + middle*damping(i + 1) + near*damping(i + 2), e)
         x = matmul(e, x)
      end do
   end subroutine propagate_two

   !> Sees to it that the slopes at the ends and in the middle of each step are known; those of half as many steps are used again.
   !> At events a piece is looked at from inside.
   subroutine refine(self, piece, n_steps)
      class(variation_t), intent(inout) :: self
      type(piece_t), intent(inout) :: piece
      integer, intent(in) :: n_steps
      real(wp), allocatable :: by_place(:, :, :), by_rate(:, :, :), by_state(:, :, :)
      real(wp) :: times(0:2*n_steps)
      integer :: i, known

      known = -1
      if (allocated(piece%by_place)) known = ubound(piece%by_place, 3)
      if (known == 2*n_steps) return
      associate (length => piece%finish - piece%start)
         times = piece%start + length*[(real(i, wp)/(2*n_steps), i=0, 2*n_steps)]
         if (piece%is_after_event) times(0) = piece%start + inside*length
         if (piece%is_before_event) times(2*n_steps) = piece%finish - inside*length
      end associate
      associate (n => self%n_coordinates)
         allocate (by_place(n, n, 0:2*n_steps), by_rate(n, n, 0:2*n_steps), by_state(n, self%n_states, 0:2*n_steps))
      end associate
      if (known == n_steps) then
         by_place(:, :, ::2) = piece%by_place
         by_rate(:, :, ::2) = piece%by_rate
         by_state(:, :, ::2) = piece%by_state
         call find_slopes(self, piece, self%motion%phases(times(1::2)), by_place(:, :, 1::2), by_rate(:, :, 1::2), &
                          by_state(:, :, 1::2))
      else
         call find_slopes(self, piece, self%motion%phases(times), by_place, by_rate, by_state)
      end if
      call move_alloc(by_place, piece%by_place)
      call move_alloc(by_rate, piece%by_rate)
      call move_alloc(by_state, piece%by_state)
   end subroutine refine

   !> A at several phases of a motion whose laws are smooth; along the motion phases go with the time.
   subroutine variation_matrices(self, phases, a)
      class(variation_t), intent(inout) :: self
      real(wp), intent(in) :: phases(:, :)                            !! [rad], (n_tones, any)
      real(wp), intent(out) :: a(:, :, :)                             !! (size, size, any)
      type(piece_t) :: piece
      integer :: i

      associate (n => self%n_coordinates, n_phases => size(phases, 2))
         allocate (piece%by_place(n, n, 0:n_phases - 1), piece%by_rate(n, n, 0:n_phases - 1))
         allocate (piece%by_state(n, self%n_states, 0:n_phases - 1), piece%slip(self%n_states), piece%held(self%n_states))
         piece%slip = 0
         piece%held = 0.0_wp
         call find_slopes(self, piece, phases, piece%by_place, piece%by_rate, piece%by_state)
         do i = 1, n_phases
            call fill(self, piece, i - 1, a(:, :, i))
         end do
      end associate
   end subroutine variation_matrices

   !> Whether no law has a memory, or forces with kinks that it tells of.
   pure logical function variation_is_smooth(self) result(is_smooth)
      class(variation_t), intent(in) :: self
      integer :: i

      is_smooth = self%n_states == 0 .and. all([(self%laws(i)%law%n_switches == 0, i=1, size(self%laws))])
   end function variation_is_smooth

   !> A at a node of a piece.
   pure subroutine fill(self, piece, node, a)
      class(variation_t), intent(in) :: self
      type(piece_t), intent(in) :: piece
      integer, intent(in) :: node
      real(wp), intent(out) :: a(:, :)
      integer :: c, d, i, k, n
      real(wp) :: factor

      n = self%n_dofs
      a = self%constant
      do d = 1, self%n_coordinates
         do c = 1, self%n_coordinates
            if (abs(piece%by_place(c, d, node)) + abs(piece%by_rate(c, d, node)) <= 0.0_wp) cycle
            do k = 1, n
               factor = self%shape(k, d)
               if (.not. abs(factor) > 0.0_wp) cycle
               do i = 1, n
                  a(n + i, k) = a(n + i, k) - self%kick(i, c)*(piece%by_place(c, d, node)*factor/self%scale)
                  a(n + i, n + k) = a(n + i, n + k) - self%kick(i, c)*(piece%by_rate(c, d, node)*factor)
               end do
            end do
         end do
      end do
      do k = 1, self%n_states
         a(n + 1:2*n, 2*n + k) = -matmul(self%kick, piece%by_state(:, k, node))/self%scale
      end do
   end subroutine fill

   !> Slopes of the forces of all laws at the coordinates of the motion, at several phases within a piece.
   subroutine find_slopes(self, piece, phases, by_place, by_rate, by_state)
      class(variation_t), intent(inout) :: self
      type(piece_t), intent(in) :: piece
      real(wp), intent(in) :: phases(:, :)                            !! [rad], (n_tones, n_times)
      real(wp), intent(out) :: by_place(:, :, :), by_rate(:, :, :)    !! (n_coordinates, n_coordinates, n_times)
      real(wp), intent(out) :: by_state(:, :, :)                      !! (n_coordinates, n_states, n_times), of those that stick
      real(wp) :: v(size(phases, 2), self%n_coordinates), z(size(phases, 2), self%n_coordinates)
      real(wp), allocatable :: df_dp(:, :, :), df_dv(:, :, :), df_dz(:, :, :), f(:, :), nothing(:, :)
      integer :: c, d, i, n, n_times

      n_times = size(phases, 2)
      by_place = 0.0_wp
      by_rate = 0.0_wp
      by_state = 0.0_wp
      call self%motion%at(phases, z, v)
      do i = 1, size(self%laws)
         associate (law => self%laws(i)%law, place => self%places(i))
            n = size(law%shape, 2)
            if (law%phase_tone > 0) call law%set_phase(phases(law%phase_tone, :))
            select type (law)
            class is (hysteretic_law_t)
               call find_slopes_with_memory(self, law, place, piece, z(:, place%first:place%last), v(:, place%first:place%last), &
                                            by_place, by_state)
            class default
               if (allocated(f)) deallocate (f, df_dz, df_dv, df_dp, nothing)
               allocate (f(n_times, n), df_dz(n_times, n, n), df_dp(n_times, n, 0), nothing(n_times, 0))
               allocate (df_dv(n_times, n, merge(n, 0, law%needs_velocity)))
               df_dv = 0.0_wp
               if (law%needs_velocity) then
                  call law%evaluate(z(:, place%first:place%last), v(:, place%first:place%last), nothing, f, df_dz, df_dv, df_dp)
               else
                  call law%evaluate(z(:, place%first:place%last), nothing, nothing, f, df_dz, df_dv, df_dp)
               end if
               do d = 1, n
                  do c = 1, n
                     by_place(place%first + c - 1, place%first + d - 1, :) = df_dz(:, c, d)
                     if (law%needs_velocity) by_rate(place%first + c - 1, place%first + d - 1, :) = df_dv(:, c, d)
                  end do
               end do
            end select
         end associate
      end do
   end subroutine find_slopes

   !> The same for a law with memory: sliders that slip move with their bounds.
   subroutine find_slopes_with_memory(self, law, place, piece, z, v, by_place, by_state)
      class(variation_t), intent(in) :: self
      class(hysteretic_law_t), intent(in) :: law
      type(place_t), intent(in) :: place
      type(piece_t), intent(in) :: piece
      real(wp), intent(in) :: z(:, :), v(:, :)
      real(wp), intent(inout) :: by_place(:, :, :), by_state(:, :, :)
      real(wp) :: df_ds(size(z, 1), size(z, 2), law%n_states), df_dz(size(z, 1), size(z, 2), size(z, 2))
      real(wp) :: f(size(z, 1), size(z, 2)), s(size(z, 1), law%n_states), slopes(law%n_states, size(z, 2))
      real(wp), dimension(law%n_states) :: lower, lower_rate, upper, upper_rate
      integer :: c, d, i, k

      associate (slip => piece%slip(place%first_state:place%last_state), held => piece%held(place%first_state:place%last_state), &
                 first => place%first)
         do i = 1, size(z, 1)
            call law%bounds(z(i, :), v(i, :), lower, upper, lower_rate, upper_rate)
            s(i, :) = merge(held, merge(lower, upper, slip > 0), slip == 0)
         end do
         call law%force(z, s, f, df_dz, df_ds)
         do i = 1, size(z, 1)
            by_place(first:place%last, first:place%last, i) = df_dz(i, :, :)
            if (any(slip /= 0)) call find_bound_slopes(self, law, place, z(i, :), v(i, :), slip, slopes)
            do k = 1, law%n_states
               do c = 1, size(z, 2)
                  if (slip(k) == 0) then
                     by_state(first + c - 1, place%first_state + k - 1, i) = df_ds(i, c, k)
                  else
                     do d = 1, size(z, 2)
                        by_place(first + c - 1, first + d - 1, i) = by_place(first + c - 1, first + d - 1, i) &
                                                                    + df_ds(i, c, k)*slopes(k, d)
                     end do
                  end if
               end do
            end do
         end do
      end associate
   end subroutine find_slopes_with_memory

   !> How the bound on which a slider stands moves with each coordinate, (n_states, n_coordinates); zero for those that stick.
   pure subroutine find_bound_slopes(self, law, place, z, v, slip, slopes)
      class(variation_t), intent(in) :: self
      class(hysteretic_law_t), intent(in) :: law
      type(place_t), intent(in) :: place
      real(wp), intent(in) :: z(:), v(:)
      integer, intent(in) :: slip(:)
      real(wp), intent(out) :: slopes(:, :)
      real(wp), dimension(size(slip)) :: above, below, lower, lower_rate, upper, upper_rate
      real(wp) :: other(size(z)), step
      integer :: c

      do c = 1, size(z)
         step = nearness*self%reach(place%first + c - 1)
         other = z
         other(c) = z(c) + step
         call law%bounds(other, v, lower, upper, lower_rate, upper_rate)
         above = merge(lower, upper, slip > 0)
         other(c) = z(c) - step
         call law%bounds(other, v, lower, upper, lower_rate, upper_rate)
         below = merge(lower, upper, slip > 0)
         slopes(:, c) = merge(0.0_wp, (above - below)/(2.0_wp*step), slip == 0)
      end do
   end subroutine find_bound_slopes

   !> Places of sliders that have slipped at the end of a piece: those of their bounds.
   subroutine move_sliders(self, piece, x)
      class(variation_t), intent(in) :: self
      type(piece_t), intent(in) :: piece
      real(wp), intent(inout) :: x(:, :)
      real(wp) :: v(1, self%n_coordinates), z(1, self%n_coordinates)
      real(wp), allocatable :: slopes(:, :)
      integer :: i, k

      if (all(piece%slip == 0)) return
      call self%motion%at(self%motion%phases([piece%finish]), z, v)
      do i = 1, size(self%laws)
         associate (place => self%places(i))
            if (place%last_state < place%first_state) cycle
            associate (slip => piece%slip(place%first_state:place%last_state))
               if (all(slip == 0)) cycle
               select type (law => self%laws(i)%law)
               class is (hysteretic_law_t)
                  allocate (slopes(size(slip), place%last - place%first + 1))
                  call find_bound_slopes(self, law, place, z(1, place%first:place%last), v(1, place%first:place%last), slip, slopes)
                  do k = 1, size(slip)
                     if (slip(k) == 0) cycle
                     x(2*self%n_dofs + place%first_state + k - 1, :) = &
                        matmul(matmul(self%shape(:, place%first:place%last), slopes(k, :)), x(:self%n_dofs, :))
                  end do
                  deallocate (slopes)
               end select
            end associate
         end associate
      end do
   end subroutine move_sliders

   !> About how many nanoseconds a step of length h takes beyond its nodes, from counts alone.
   pure real(wp) function variation_work_of_step(self, h) result(work)
      class(variation_t), intent(in) :: self
      real(wp), intent(in) :: h                                       !! [s]

      associate (n => real(self%n_dofs, wp), c => real(self%n_coordinates, wp), m => real(self%size, wp))
         work = 2.0_wp*count_exponential(self%size, 0.5_wp*h*self%norm)
         if (self%size > 2) work = work + 2.0_wp*m**3 + c**2*n**2 + 4.0_wp*m**2
      end associate
   end function variation_work_of_step

   !> The same of a node, or of a look for events.
   pure real(wp) function variation_work_of_node(self) result(work)
      class(variation_t), intent(in) :: self

      work = size(self%motion%frequencies)*(2.0_wp + 4.0_wp*self%n_coordinates) + 20.0_wp + 10.0_wp*self%n_coordinates**2
   end function variation_work_of_node
end module hb_variation
