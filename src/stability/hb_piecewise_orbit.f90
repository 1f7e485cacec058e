!> The periodic motion next to a given one for laws with constant slopes between their switches, and its monodromy
!> matrix.
!>
!> Between two switches the equations of motion are linear, so that matrix exponentials propagate a state to the next
!> event; no force jumps there, so that the saltation matrix is the identity. Newton's method on the state after a
!> period (shooting) finds the periodic motion: its multipliers have no truncation error. Source: R. I. Leine and H.
!> Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems, Springer 2004, sections 7.4 and 8.4.
module hb_piecewise_orbit
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_kinds, only: two_pi, wp
   use hb_lapack, only: dgetrf, dgetrs, dpotrs
   use hb_matrix_exponential, only: count_exponential, exponential_of
   use hb_monodromy, only: find_monodromy, monodromy_t, n_instants_of
   use hb_stability, only: excitation_t
   use hb_structure, only: structure_t
   use hb_thresholds, only: max_distance_of_same, nearby_steps, rounding_level, small_share
   use hb_variation, only: piece_t, variation_t
   use hb_variation_pieces, only: bracket_t, cut_time
   implicit none
   private
   public :: find_piecewise_orbit, has_piecewise_orbit, piecewise_orbit_t, work_of_piecewise_orbit

   integer, parameter :: steps_a_period = 16 ! of the fastest oscillation: a switch reverses at most once in a step
   integer, parameter :: max_events = 1000                           ! in a period: with more, contact chatters
   integer, parameter :: usual_shots = 5

   type :: piecewise_orbit_t
      real(wp), allocatable :: matrix(:, :)                           !! monodromy matrix of (q, v/scale)
      real(wp) :: estimate = huge(1.0_wp)                             !! of its error, relative to its largest entry or 1
      logical :: is_found = .false.                                   !! false: none is near the motion, or it is ambiguous
   end type piecewise_orbit_t

   !> The linear system of (q, v/scale, 1, cosines, sines of the loads) while no switch changes its sign.
   type :: branch_t
      logical, allocatable :: is_positive(:)                          ! (n_switches)
      real(wp), allocatable :: a(:, :)                                ! (size, size) [1/s]
      real(wp), allocatable :: step(:, :)                             ! exp(h a)
      real(wp) :: h = 0.0_wp                                          ! [s]
   end type branch_t

   !> Propagation of states through time.
   type :: flow_t
      integer :: n = 0                                                ! of (q, v/scale)
      integer :: size = 0
      real(wp) :: period = 0.0_wp                                     ! [s]
      real(wp), allocatable :: constant(:, :)                         ! system without laws, (size, size)
      real(wp), allocatable :: first(:)                               ! the entries after n at the start
      real(wp), allocatable :: switches(:, :)                         ! switches as linear functions, (n_switches, size)
      real(wp), allocatable :: noise(:)                               ! of them [m], (n_switches)
      type(branch_t), allocatable :: branches(:)                      ! encountered so far
   end type flow_t

contains

   !> Whether the motion is that of a system that is linear between switches of laws without memory.
   pure logical function has_piecewise_orbit(variation)
      type(variation_t), intent(in) :: variation
      integer :: i

      has_piecewise_orbit = size(variation%motion%omega) == 1 .and. variation%n_states == 0 .and. variation%n_switches() > 0 &
                            .and. variation%is_piecewise_linear() .and. .not. allocated(variation%massless)
      do i = 1, size(variation%laws)
         associate (law => variation%laws(i)%law)
            has_piecewise_orbit = has_piecewise_orbit .and. law%n_phases == 0 .and. .not. law%needs_velocity
         end associate
      end do
   end function has_piecewise_orbit

   !> Approximate work in nanoseconds, from counts alone.
   pure real(wp) function work_of_piecewise_orbit(variation) result(work)
      type(variation_t), intent(in) :: variation
      real(wp) :: n_events, period

      period = two_pi/variation%motion%omega(1)
      n_events = 2.0_wp*variation%n_switches()
      work = usual_shots*(steps_a_period*(period*variation%scale/two_pi + n_events)*(variation%size + 3)**2 &
                          + (n_events + 1)*count_exponential(variation%size, period*variation%norm/(n_events + 1)))
   end function work_of_piecewise_orbit

   !> Finds the periodic motion by shooting from the state of a given one far from its events. Where no force depends on a
   !> displacement, the one that the given motion has of it is retained.
   subroutine find_piecewise_orbit(self, variation, structure, amplitudes, excitation, free)
      type(piecewise_orbit_t), intent(out) :: self
      type(variation_t), intent(inout) :: variation                   !! along the given motion
      type(structure_t), intent(in) :: structure
      complex(wp), intent(in) :: amplitudes(:, :)                     !! of the given motion, cos - i sin, (n_dofs, n_harmonics)
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: free(:, :)                              !! displacements on which no force depends, (n_dofs, any)
      type(flow_t) :: flow
      real(wp), dimension(2*variation%n_dofs) :: after, begun, left, left_before, step, units, x
      complex(wp) :: turned(size(amplitudes, 1), size(amplitudes, 2))
      real(wp), dimension(size(amplitudes, 1), size(amplitudes, 2)) :: lengths, sines
      real(wp) :: frequencies(size(amplitudes, 2)), sense, sense_now, start
      integer :: n, n_events, n_events_given, shot
      logical :: is_done

      n = variation%n_dofs
      call find_quiet_time(variation, start, n_events_given)
      frequencies = variation%motion%frequencies
      turned = amplitudes*spread(exp(cmplx(0.0_wp, frequencies*start, wp)), 1, n)
      sines = aimag(turned)
      begun(:n) = sum(real(turned), dim=2)
      begun(n + 1:) = -matmul(sines, frequencies)/variation%scale
      lengths = abs(amplitudes)
      frequencies = abs(frequencies)
      units(:n) = sum(lengths, dim=2)
      units(n + 1:) = matmul(lengths, frequencies)/variation%scale
      units(:n) = max(units(:n), small_share*maxval(units(:n)), tiny(1.0_wp))
      if (maxval(units(n + 1:)) <= epsilon(1.0_wp)*maxval(units(:n))) units(n + 1:) = maxval(units(:n))   ! an equilibrium
      units(n + 1:) = max(units(n + 1:), small_share*maxval(units(n + 1:)), tiny(1.0_wp))
      call new_flow(flow, variation, structure, excitation, start, is_done)
      if (.not. is_done) return
      x = begun
      step = 0.0_wp
      left_before = huge(1.0_wp)
      sense = 0.0_wp
      do shot = 1, nearby_steps
         call integrate_round(flow, variation, x, after, self%matrix, n_events, is_done)
         if (.not. is_done) return
         left = (after - x)/units
         if (maxval(abs(left)) >= maxval(abs(left_before))) then
            if (maxval(abs(left)) <= rounding_level) exit              ! rounding
            step = 0.5_wp*step
            x = x - step
            cycle
         end if
         call solve_step(self%matrix, free, after - x, step, sense_now)
         if (.not. sense_now*sense > 0.0_wp .and. shot > 1) return     ! a fold lies between: the motion is ambiguous
         sense = sense_now
         if (max(maxval(abs(left)), maxval(abs(step/units))) <= rounding_level) exit
         left_before = left
         x = x + step
         if (maxval(abs((x - begun)/units)) > max_distance_of_same) return
      end do
      self%is_found = maxval(abs(left)) <= rounding_level
      if (self%is_found .and. n_events /= n_events_given) self%is_found = sense*sense_along(variation, start, free) > 0.0_wp
      self%estimate = max(maxval(abs(left)), epsilon(1.0_wp)*size(flow%branches)*flow%period*maxval(abs(flow%constant)))
   end subroutine find_piecewise_orbit

   !> Middle of the longest interval without events of the given motion, where the state determines the next events
   !> best, and the number of events in a period.
   subroutine find_quiet_time(variation, time, n_events)
      type(variation_t), intent(inout) :: variation
      real(wp), intent(out) :: time                                   !! [s]
      integer, intent(out) :: n_events
      type(piece_t), allocatable :: pieces(:)
      real(wp) :: period

      period = two_pi/variation%motion%omega(1)                       ! of two periods, the ends of one lie within the other
      call cut_time(variation, 0.0_wp, 2.0_wp*period, n_instants_of(variation, 2.0_wp*period), pieces)
      n_events = (size(pieces) - 1)/2
      associate (longest => pieces(maxloc(pieces%finish - pieces%start, dim=1)))
         time = 0.5_wp*(longest%start + longest%finish)
      end associate
   end subroutine find_quiet_time

   !> Sign of the determinant of the equations of a step, along the given motion. Where the orbit has other events and another
   !> sign, one more orbit is as near, behind a fold, and the given motion may be this one.
   real(wp) function sense_along(variation, start, free) result(sense)
      type(variation_t), intent(inout) :: variation
      real(wp), intent(in) :: start                                   !! [s]
      real(wp), intent(in) :: free(:, :)                              !! (n_dofs, any)
      type(monodromy_t) :: along
      real(wp) :: none(2*variation%n_dofs), step(2*variation%n_dofs)

      call find_monodromy(along, variation, start, rounding_level, huge(1.0_wp))
      none = 0.0_wp
      call solve_step(along%matrix, free, none, step, sense)
   end function sense_along

   !> Newton's step: (matrix - 1) step = -left, with the sign of the determinant. Free displacements, which the matrix leaves
   !> as they are, do not change: a term of rank one for each makes the equations regular.
   subroutine solve_step(matrix, free, left, step, sense)
      real(wp), intent(in) :: matrix(:, :), free(:, :), left(:)
      real(wp), intent(out) :: step(:)
      real(wp), intent(out) :: sense
      real(wp) :: a(size(left), size(left))
      integer :: i, info, pivots(size(left))

      a = matrix
      do i = 1, size(left)
         a(i, i) = a(i, i) - 1.0_wp
      end do
      associate (n => size(free, 1))
         a(:n, :n) = a(:n, :n) + matmul(free, transpose(free))
      end associate
      call dgetrf(size(left), size(left), a, size(left), pivots, info)
      step = huge(1.0_wp)
      sense = 0.0_wp
      if (info /= 0) return
      sense = 1.0_wp
      do i = 1, size(left)
         sense = sign(sense, sense*a(i, i)*merge(1.0_wp, -1.0_wp, pivots(i) == i))
      end do
      step = -left
      call dgetrs("N", size(left), 1, a, size(left), pivots, step, size(left), info)
   end subroutine solve_step

   !> Fails if a switch is not a linear function, or loads are not of the tone of the motion.
   subroutine new_flow(self, variation, structure, excitation, start, is_done)
      type(flow_t), intent(out) :: self
      type(variation_t), intent(in) :: variation
      type(structure_t), intent(in) :: structure
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: start                                   !! [s]
      logical, intent(out) :: is_done
      real(wp), allocatable :: factor(:, :)
      real(wp), allocatable :: pushes(:, :)                           ! cosine and sine of each load over the mass
      integer, allocatable :: turning(:)                              ! loads that vary
      integer :: i, info, k, n

      n = variation%n_dofs
      self%n = 2*n
      self%period = two_pi/variation%motion%omega(1)
      is_done = allocated(excitation%loads%values)
      if (.not. is_done) return
      associate (loads => excitation%loads, w => excitation%loads%frequencies(variation%motion%omega))
         call structure%factorise_mass(factor, info)
         allocate (pushes(n, 2*size(w)))
         do k = 1, size(w)
            pushes(:, 2*k - 1) = real(loads%values(:, k))
            pushes(:, 2*k) = -aimag(loads%values(:, k))
         end do
         if (size(pushes) > 0) call dpotrs("L", n, size(pushes, 2), factor, n, pushes, n, info)
         turning = pack([(k, k=1, size(w))], abs(w) > 0.0_wp)
         self%size = self%n + 1 + 2*size(turning)
         allocate (self%constant(self%size, self%size), self%first(1 + 2*size(turning)), source=0.0_wp)
         self%constant(:self%n, :self%n) = variation%constant(:self%n, :self%n)
         self%first(1) = 1.0_wp
         do k = 1, size(w)
            if (.not. any(turning == k)) self%constant(n + 1:self%n, self%n + 1) = self%constant(n + 1:self%n, self%n + 1) &
                                                                                 + pushes(:, 2*k - 1)/variation%scale
         end do
         do i = 1, size(turning)
            associate (c => self%n + 2*i, k => turning(i))
               self%constant(n + 1:self%n, c:c + 1) = pushes(:, 2*k - 1:2*k)/variation%scale
               self%constant(c, c + 1) = -w(k)
               self%constant(c + 1, c) = w(k)
               self%first(2*i:2*i + 1) = [cos(w(k)*start), sin(w(k)*start)]
            end associate
         end do
      end associate
      call store_switches(self, variation)
      allocate (self%branches(0))
   end subroutine new_flow

   !> Stores the switches of all laws as linear functions of the state.
   subroutine store_switches(self, variation)
      type(flow_t), intent(inout) :: self
      type(variation_t), intent(in) :: variation
      integer :: c, first, i, last

      allocate (self%switches(variation%n_switches(), self%size), source=0.0_wp)
      allocate (self%noise(size(self%switches, 1)))
      last = 0
      do i = 1, size(variation%laws)
         associate (law => variation%laws(i)%law, span => variation%spans(i))
            first = last + 1
            last = last + law%n_switches
            block
               real(wp), dimension(law%n_switches) :: at_unit, at_zero
               real(wp), dimension(size(law%shape, 2)) :: still, z

               still = 0.0_wp
               call law%switches(still, still, at_zero)
               self%switches(first:last, self%n + 1) = at_zero
               self%noise(first:last) = 16.0_wp*epsilon(1.0_wp)*(abs(at_zero) + maxval(variation%extent(span%first:span%last)))
               do c = span%first, span%last
                  z = 0.0_wp
                  z(c - span%first + 1) = 1.0_wp
                  call law%switches(z, still, at_unit)
                  self%switches(first:last, :variation%n_dofs) = self%switches(first:last, :variation%n_dofs) &
                     + spread(at_unit - at_zero, 2, variation%n_dofs)*spread(variation%shape(:, c), 1, law%n_switches)
               end do
            end block
         end associate
      end do
   end subroutine store_switches

   !> Number of the branch with given signs of the switches; created if it is new.
   subroutine find_branch(self, variation, is_positive, number)
      type(flow_t), intent(inout) :: self
      type(variation_t), intent(in) :: variation
      logical, intent(in) :: is_positive(:)
      integer, intent(out) :: number
      type(branch_t) :: branch
      type(piece_t) :: piece
      real(wp) :: forces(variation%n_coordinates)
      real(wp) :: fastest, speeds(variation%size, variation%size)
      integer :: c, first, i, last, n

      do number = 1, size(self%branches)
         if (all(self%branches(number)%is_positive .eqv. is_positive)) return
      end do
      n = variation%n_dofs
      allocate (piece%by_displacement(variation%n_coordinates, variation%n_coordinates, 0:0), source=0.0_wp)
      piece%by_rate = piece%by_displacement
      last = 0
      do i = 1, size(variation%laws)
         associate (law => variation%laws(i)%law, span => variation%spans(i))
            first = last + 1
            last = last + law%n_switches
            block
               real(wp), dimension(size(law%shape, 2)) :: at_unit, at_zero, still, z

               still = 0.0_wp
               call law%evaluate_held(still, still, is_positive(first:last), at_zero)
               forces(span%first:span%last) = at_zero
               do c = span%first, span%last
                  z = 0.0_wp
                  z(c - span%first + 1) = variation%extent(c)
                  call law%evaluate_held(z, still, is_positive(first:last), at_unit)
                  piece%by_displacement(span%first:span%last, c, 0) = (at_unit - at_zero)/variation%extent(c)
               end do
            end block
         end associate
      end do
      call variation%matrix_at(piece, 0, speeds)
      branch%is_positive = is_positive
      branch%a = self%constant
      branch%a(:self%n, :self%n) = speeds(:self%n, :self%n)
      branch%a(n + 1:self%n, self%n + 1) = branch%a(n + 1:self%n, self%n + 1) &
                                           - matmul(variation%accelerance, forces)/variation%scale
      fastest = sqrt(variation%scale*maxval(sum(abs(speeds(n + 1:self%n, :n)), dim=2)))
      fastest = max(fastest, maxval(abs(self%constant(self%n + 1:, self%n + 1:))))
      branch%h = two_pi/(steps_a_period*fastest)
      allocate (branch%step(self%size, self%size))
      call exponential_of(branch%h*branch%a, branch%step)
      self%branches = [self%branches, branch]
      number = size(self%branches)
   end subroutine find_branch

   !> Computes the state after a period and its derivative.
   subroutine integrate_round(self, variation, x, after, matrix, n_events, is_done)
      type(flow_t), intent(inout) :: self
      type(variation_t), intent(in) :: variation
      real(wp), intent(in) :: x(:)
      real(wp), intent(out) :: after(:)
      real(wp), allocatable, intent(out) :: matrix(:, :)
      integer, intent(out) :: n_events                                !! in the period
      logical, intent(out) :: is_done
      real(wp) :: y(self%size), y_next(self%size)
      real(wp) :: begun, time, to_event
      logical :: is_last, is_positive(size(self%switches, 1))
      integer :: i, number, switch

      allocate (matrix(self%n, self%n), source=0.0_wp)
      do i = 1, self%n
         matrix(i, i) = 1.0_wp
      end do
      y = [x, self%first]
      is_positive = matmul(self%switches, y) > 0.0_wp
      call find_branch(self, variation, is_positive, number)
      begun = 0.0_wp
      time = 0.0_wp
      n_events = 0
      is_done = .false.
      do
         associate (branch => self%branches(number))
            is_last = time + branch%h >= self%period
            if (is_last) then
               call advance_state(branch%a, self%period - time, y, y_next)
               call next_event(self, branch, y, y_next, self%period - time, switch, to_event)
            else
               y_next = matmul(branch%step, y)
               call next_event(self, branch, y, y_next, branch%h, switch, to_event)
            end if
            if (.not. all(ieee_is_finite(y_next))) return
            if (switch > 0) then
               time = time + to_event
               call advance_state(branch%a, to_event, y, y_next)
            else
               time = merge(self%period, time + branch%h, is_last)
            end if
            y = y_next
            if (switch == 0 .and. .not. is_last) cycle
            call multiply(branch%a(:self%n, :self%n), time - begun, matrix)
         end associate
         if (switch == 0) exit
         begun = time
         n_events = n_events + 1
         if (n_events > max_events) return
         is_positive(switch) = .not. is_positive(switch)
         call find_branch(self, variation, is_positive, number)
      end do
      after = y(:self%n)
      is_done = .true.
   end subroutine integrate_round

   !> matrix = exp(duration a) matrix.
   subroutine multiply(a, duration, matrix)
      real(wp), intent(in) :: a(:, :), duration
      real(wp), intent(inout) :: matrix(:, :)
      real(wp) :: e(size(a, 1), size(a, 1))

      call exponential_of(duration*a, e)
      matrix = matmul(e, matrix)
   end subroutine multiply

   !> The state after a part of a step, from the series of the exponential.
   pure subroutine advance_state(a, duration, y, after)
      real(wp), intent(in) :: a(:, :), duration, y(:)
      real(wp), intent(out) :: after(:)
      real(wp) :: term(size(y))
      integer :: k

      after = y
      term = y
      k = 0
      do while (any(abs(term) > 0.1_wp*epsilon(1.0_wp)*abs(after)))
         k = k + 1
         term = matmul(a, term)*(duration/k)
         after = after + term
      end do
   end subroutine advance_state

   !> The first switch of a branch that changes its sign within a step from y to y_next, and its time.
   subroutine next_event(self, branch, y, y_next, h, switch, time)
      type(flow_t), intent(in) :: self
      type(branch_t), intent(in) :: branch
      real(wp), intent(in) :: y(:), y_next(:)
      real(wp), intent(in) :: h                                       !! [s]
      integer, intent(out) :: switch                                  !! 0: none
      real(wp), intent(out) :: time                                   !! from y [s]
      real(wp), dimension(size(self%switches, 1)) :: distance, distance_next, rate, rate_next, sense
      real(wp) :: extreme, there
      integer :: i

      switch = 0
      time = h
      sense = merge(1.0_wp, -1.0_wp, branch%is_positive)
      distance = sense*matmul(self%switches, y)
      distance_next = sense*matmul(self%switches, y_next)
      rate = sense*matmul(self%switches, matmul(branch%a, y))
      rate_next = sense*matmul(self%switches, matmul(branch%a, y_next))
      do i = 1, size(distance)
         if (distance_next(i) < 0.0_wp) then
            if (distance(i) > self%noise(i)) then
               there = zero_of(0.0_wp, h, .false.)
            else if (rate(i) > 0.0_wp) then                           ! it has just changed, and changes back within the step
               extreme = zero_of(0.0_wp, h, .true.)
               there = zero_of(extreme, h, .false.)
            else
               there = 0.0_wp
            end if
         else if (rate(i) < 0.0_wp .and. rate_next(i) > 0.0_wp) then   ! two changes within the step
            extreme = zero_of(0.0_wp, h, .true.)
            if (value_at(extreme, .false.) >= -self%noise(i)) cycle
            there = 0.0_wp
            if (distance(i) > self%noise(i)) there = zero_of(0.0_wp, extreme, .false.)
         else
            cycle
         end if
         if (there > time) cycle
         time = there
         switch = i
      end do

   contains

      !> Distance of switch i, or its rate, after a time.
      real(wp) function value_at(after, of_rate)
         real(wp), intent(in) :: after
         logical, intent(in) :: of_rate
         real(wp) :: state(size(y))

         call advance_state(branch%a, after, y, state)
         if (of_rate) state = matmul(branch%a, state)
         value_at = sense(i)*dot_product(self%switches(i, :), state)
      end function value_at

      !> Zero of the distance or its rate between two times with different signs.
      real(wp) function zero_of(from, to, of_rate)
         real(wp), intent(in) :: from, to
         logical, intent(in) :: of_rate
         type(bracket_t) :: bracket

         bracket = bracket_t(low=from, high=to, value_low=value_at(from, of_rate), value_high=value_at(to, of_rate))
         do while (bracket%is_wide())
            call bracket%narrow(value_at(bracket%middle, of_rate))
         end do
         zero_of = bracket%middle
      end function zero_of
   end subroutine next_event
end module hb_piecewise_orbit
