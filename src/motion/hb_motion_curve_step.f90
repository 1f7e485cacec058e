!> A step of a curve, and what is found on it: folds, peaks, bifurcations, wanted values and ends, located and in their order.
submodule (hb_motion_curve) hb_motion_curve_step
   use hb_bifurcation, only: bifurcation, bifurcation_value, is_torus
   use hb_bordered, only: bordered_problem_t
   use hb_curve, only: event_t
   use hb_curve_conditions, only: is_mirrored, set_conditions
   use hb_curve_events, only: bifurcation_event_t, branch_event_t, count_event_t, find_extremes, find_stability, fold_event_t, &
      graze_event_t, n_outside, peak_event_t, sharp, value_event_t
   use hb_newton, only: solve_newton
   use hb_stability, only: stability_method
   implicit none

   real(wp), parameter :: largest_turn = 0.6_wp                       ! [rad] on a step, unless it is short
   real(wp), parameter :: longest_chord = 2.0_wp                      ! of a step, unless it is short: 1.05 with the largest turn
   real(wp), parameter :: short = 1.0e-2_wp                           ! of the longest step
   real(wp), parameter :: shortest_leap = 1.0e-4_wp                   ! of the longest step: the corner at which a curve may leap
                                                                      ! is as long as the root of the damping
   real(wp), parameter :: least_amplitude = 1.0e-3_wp                 ! of the largest: of harmonics whose phases are looked at
   real(wp), parameter :: largest_phase = 0.5_wp                      ! its cosine; a phase may change by 60 degrees on a step
   real(wp), parameter :: off_the_chord = 0.5_wp                      ! of an amplitude, in the middle of a step
   real(wp), parameter :: off_the_line = 0.25_wp                      ! of a step, likewise: an arc that turns by 0.6 has 0.075
   integer, parameter :: most_middles = 4                             ! points at which one step is looked at
   real(wp), parameter :: located = 1.0e-11_wp                        ! of a function that is zero at a fold or a peak
   real(wp), parameter :: located_multiplier = 1.0e-9_wp              ! of a function that is zero at a bifurcation
   real(wp), parameter :: at_start = 1.0e-4_wp                        ! of a step: where a branch begins rounding decides on zeros
   real(wp), parameter :: uncertain = 100.0_wp                        ! times the tolerance of multipliers: to the unit circle
   real(wp), parameter :: closed = 0.1_wp                             ! of a step, from the start, when the curve is back there

contains

   module procedure motion_curve_step
      real(wp), allocatable :: extremes(:, :), slopes(:)
      type(stability_t) :: stability
      real(wp) :: largest, units(size(self%curve%x))
      integer :: n_branch_points
      logical :: is_lost, is_near, is_possible, is_short, is_taken

      if (allocated(self%problem%complaint)) deallocate (self%problem%complaint)
      call self%move(self%curve%x, is_possible)
      call self%problem%renew()                                       ! a stored curve, too, goes on from there
      self%slack = 1.0_wp
      call set_conditions(self%problem, self%which, self%curve, self%weights)
      associate (curve => self%curve)
         do
            largest = self%largest
            units = curve%units
            n_branch_points = curve%n_branch_points
            call curve%advance()
            if (curve%status == outcome%stalled) call try_end(self)
            if (curve%status == outcome%stalled .and. self%is_uneven .and. self%slack < most_slack) then
               self%slack = 10.0_wp*self%slack
               call self%renew()
               curve%status = outcome%pending
               curve%step = curve%config%first_step
               cycle
            end if
            if (curve%status /= outcome%pending .or. size(self%waiting) >= self%first_waiting) return
            call self%renew()
            call curve%turn()
            is_short = curve%last_step <= short*curve%config%longest_step
            is_near = norm2((curve%x - curve%last_x)/curve%units) <= longest_chord*curve%last_step
            is_taken = is_short .or. (curve%angle <= largest_turn .and. is_near)
            if (is_taken) is_taken = .not. has_leapt(self)
            if (is_taken) then
               self%has_collapsed = is_mirrored(self%problem, self%which, self%curve, self%weights)
               if (self%has_collapsed) then
                  curve%status = outcome%collapsed
                  return
               end if
               slopes = self%slopes_along()
               self%waiting = [waiting_t ::]
               self%first_waiting = 1
               call find_stability(self%problem, self%which, curve%x, self%problem%scene%stability%tolerance, stability)
               call find_extremes(self%problem, self%which, curve%x, extremes)
               call look_back(self, self%slopes, slopes, curve%n_branch_points > n_branch_points, stability, extremes, is_lost)
               if (is_short .or. self%is_uneven .or. .not. is_lost) exit
               self%waiting = [waiting_t ::]
            end if
            call curve%retreat()
            if (curve%status == outcome%stalled) call try_end(self)
            if (curve%status /= outcome%pending .or. size(self%waiting) >= self%first_waiting) return
            self%largest = largest
            curve%units = units
         end do
         self%slopes = slopes
         self%stability = stability
         call move_alloc(extremes, self%extremes)
      end associate
   end procedure motion_curve_step

   !> Lands on an end of the range that is ahead and so near that no step fits in between: there may be nothing beyond.
   subroutine try_end(self)
      class(motion_curve_t), intent(inout), target :: self
      real(wp), parameter :: very_near = 1.0e-4_wp                    ! of the range
      real(wp) :: ends(2), gap, x(size(self%curve%x))
      integer :: i, n
      logical :: is_there

      n = size(x)
      ends = [self%request%from, self%request%to]
      do i = 1, size(ends)
         associate (curve => self%curve)
            gap = ends(i) - curve%x(n)
            if (abs(gap) > very_near*curve%units(n) .or. .not. gap*curve%direction(n) > 0.0_wp) cycle
            x = curve%x + gap/curve%direction(n)*curve%direction
            x(n) = ends(i)
            call land(self, x, is_there)
            if (.not. is_there) cycle
            curve%status = outcome%pending
            deallocate (self%waiting)
            allocate (self%waiting(1))
            self%waiting(1)%kind = curve_kind%end
            self%waiting(1)%place = norm2((x - curve%x)/curve%units)
            self%waiting(1)%x = x
            self%first_waiting = 1
            return
         end associate
      end do
   end subroutine try_end

   !> Whether the step may have led to another part of the curve or to another curve, or over a narrow resonance.
   !>
   !> With little damping two parts come close where a coefficient is nearly zero, and go on in each other's direction: neither
   !> tangents nor determinants show a leap from one to the other, but the phase of the coefficient turns by half a turn. It does so
   !> also where the coefficient goes through zero. So the curve is looked at in between, where the chord comes closest to zero: it
   !> must be there, and not far from the chord.
   logical function has_leapt(self)
      class(motion_curve_t), intent(inout), target :: self
      complex(wp) :: before, behind
      real(wp) :: middles(most_middles), share, size_of_motion, x(size(self%curve%x))
      integer :: d, h, n_middles
      logical :: is_on_curve

      has_leapt = .false.
      if (self%curve%last_step <= shortest_leap*self%curve%config%longest_step .or. self%is_uneven) return
      if (size(self%which) > 1) return                                ! tones of the motion's own have no given phases
      n_middles = 0
      associate (curve => self%curve, set => self%problem%scene%harmonics, n => self%problem%n_unknowns)
         size_of_motion = maxval(abs(curve%x(:n)/self%weights))
         do h = 1, set%n_harmonics
            do d = 0, self%problem%balance%n_dofs - 1
               if (set%sin_at(h) == 0) cycle
               before = coefficient_of(curve%last_x)
               behind = coefficient_of(curve%x)
               if (max(abs(before), abs(behind)) < least_amplitude*size_of_motion) cycle
               if (real(conjg(before)*behind) >= largest_phase*abs(before)*abs(behind)) cycle
               share = real(conjg(before)*(before - behind))/abs(before - behind)**2
               if (n_middles == most_middles .or. share <= 0.0_wp .or. share >= 1.0_wp) cycle
               if (any(abs(middles(:n_middles) - share) < 0.1_wp)) cycle
               n_middles = n_middles + 1
               middles(n_middles) = share
               call curve%point_at(share*curve%last_step, x, is_on_curve)
               has_leapt = .not. is_on_curve
               if (.not. has_leapt) has_leapt = norm2((x - (curve%last_x + share*(curve%x - curve%last_x)))/curve%units) > &
                                                off_the_line*curve%last_step
               if (.not. has_leapt) has_leapt = abs(coefficient_of(x) - (before + share*(behind - before))) > &
                                                off_the_chord*max(abs(before), abs(behind))
               if (has_leapt .or. curve%status /= outcome%pending) return
            end do
         end do
      end associate

   contains

      pure complex(wp) function coefficient_of(x)
         real(wp), intent(in) :: x(:)

         associate (set => self%problem%scene%harmonics)
            associate (c => d*set%n_coefficients + set%cos_at(h), s => d*set%n_coefficients + set%sin_at(h))
               coefficient_of = cmplx(x(c)/self%weights(c), x(s)/self%weights(s), wp)
            end associate
         end associate
      end function coefficient_of
   end function has_leapt

   !> Finds folds, peaks, bifurcations, wanted values and ends on the step behind the curve, in their order.
   subroutine look_back(self, slopes_before, slopes, has_branched, stability, extremes, is_lost)
      class(motion_curve_t), intent(inout), target :: self
      real(wp), intent(in) :: slopes_before(:), slopes(:)             !! of the responses
      logical, intent(in) :: has_branched                             !! a branch point was passed by
      type(stability_t), intent(in) :: stability                      !! at the point of the curve
      real(wp), intent(in) :: extremes(:, :)                          !! of switches, likewise
      logical, intent(out) :: is_lost                                 !! something on the step was not located, as it is too long
      type(bifurcation_event_t) :: change
      type(branch_event_t) :: branch
      type(fold_event_t) :: fold
      type(graze_event_t) :: graze
      type(peak_event_t) :: peak
      type(value_event_t) :: event
      real(wp), allocatable :: ends(:), wanted(:), x(:)
      real(wp) :: places(3), values(3)
      integer :: i, k, n, n_pieces
      logical :: is_found, is_there

      is_lost = .false.
      n = size(self%curve%x)
      allocate (x(n))
      associate (curve => self%curve, request => self%request)
         if (self%is_uneven) curve%corrector%tolerance = 10.0_wp*curve%corrector%tolerance   ! of many points
         n_pieces = 1
         places = [0.0_wp, curve%last_step, curve%last_step]
         values = [curve%last_x(n), curve%x(n), curve%x(n)]
         if (curve%last_direction(n)*curve%direction(n) < 0.0_wp .and. .not. (self%way > 2 .and. self%length <= 0.0_wp)) then
            fold%curve = curve
            call find(fold, [curve%last_direction(n), curve%direction(n)]/curve%units(n), &
                      max(located, 10.0_wp*curve%corrector%tolerance), curve_kind%fold)
            if (is_found) then
               n_pieces = 2
               places(2) = self%waiting(size(self%waiting))%place
               values(2) = x(n)
            end if
         end if
         if (has_branched) then
            branch%curve = curve
            call find(branch, [-curve%orientation, curve%orientation], 0.0_wp, curve_kind%branch)
            if (is_found) call sharpen(bifurcation%branch, [0.0_wp, curve%last_step], is_there)
         end if
         do i = 1, size(request%peaks)
            if (.not. (slopes_before(i) > 0.0_wp .and. slopes(i) <= 0.0_wp)) cycle
            peak%curve = curve
            peak%problem => self%problem
            peak%response = request%peaks(i)
            peak%unit = square_at(self%problem, self%which, request%peaks(i), curve%x)
            if (.not. peak%unit > 0.0_wp) cycle
            call find(peak, [slopes_before(i), slopes(i)]/peak%unit, max(located, 10.0_wp*curve%corrector%tolerance), &
                      curve_kind%peak)
         end do
         graze%problem => self%problem
         graze%which = self%which
         do k = 1, size(extremes, 2)
            if (size(self%extremes, 2) /= size(extremes, 2)) exit
            graze%switch = k
            graze%unit = max(maxval(abs(extremes(:, k))), tiny(1.0_wp))
            do i = 1, 2
               if (.not. self%extremes(i, k)*extremes(i, k) < 0.0_wp) cycle
               if (i == 2 .and. same_change(self%extremes(:, k), extremes(:, k))) cycle   ! all round the same distance: one event
               graze%extreme = i
               call find(graze, [self%extremes(i, k), extremes(i, k)]/graze%unit, max(located, 10.0_wp*curve%corrector%tolerance), &
                         curve_kind%graze)
            end do
         end do
         call find_bifurcations()
         ends = [request%from, request%to]
         wanted = [ends, request%values]
         event%unit = abs(request%to - request%from)
         do i = 1, size(wanted)
            if (i > 2 .and. any(abs(wanted(i) - ends) <= 0.0_wp)) cycle
            event%wanted = wanted(i)
            do k = 1, n_pieces
               if (.not. (values(k) - wanted(i))*(values(k + 1) - wanted(i)) < 0.0_wp) then
                  if (.not. abs(values(k + 1) - wanted(i)) <= 0.0_wp) cycle
               end if
               call curve%find_zero(event, places(k:k + 1), (values(k:k + 1) - wanted(i))/event%unit, 1.0e-13_wp, x, places(3), &
                                    is_found)
               if (.not. is_found) cycle
               x(n) = wanted(i)
               call land(self, x, is_there)
               call add(merge(curve_kind%end, curve_kind%value, i <= 2), places(3), x)
            end do
         end do
         self%is_closed = is_back(self)
         if (self%is_closed) call add(curve_kind%end, curve%last_step, self%x_start)
         call add(curve_kind%regular, curve%last_step, curve%x)
         self%waiting(size(self%waiting))%stability = stability
      end associate
      call put_in_order(self%waiting)
      call self%renew()                                               ! the tolerance was another one: a stored curve has this

   contains

      subroutine find(an_event, at_ends, tolerance, kind)
         class(event_t), intent(inout) :: an_event
         real(wp), intent(in) :: at_ends(2), tolerance
         integer, intent(in) :: kind
         real(wp) :: place

         call self%curve%find_zero(an_event, [0.0_wp, self%curve%last_step], at_ends, tolerance, x, place, is_found)
         is_lost = is_lost .or. .not. is_found
         if (self%way > 2 .and. self%length <= 0.0_wp) is_found = is_found .and. place > at_start*self%curve%last_step
         if (is_found) call add(kind, place, x)
      end subroutine find

      !> What multipliers tell on each piece of the step between its grazes, where they may jump.
      subroutine find_bifurcations()
         real(wp), parameter :: beside = 1.0e-6_wp                    ! a graze, in steps
         real(wp), allocatable :: grazes(:)
         type(stability_t) :: at_ends(2)
         real(wp) :: piece(2)
         integer :: i_kind, i_piece, n_before

         change%problem => self%problem
         change%which = self%which
         call put_in_order(self%waiting)
         grazes = pack(self%waiting%place, self%waiting%kind == curve_kind%graze)
         do i_piece = 0, size(grazes)
            piece = [0.0_wp, self%curve%last_step]
            at_ends = [self%stability, stability]
            associate (tolerance => self%problem%scene%stability%tolerance, length => self%curve%last_step)
               if (i_piece > 0) call look_at(grazes(i_piece) + beside*length, piece(1), at_ends(1), tolerance)
               if (i_piece < size(grazes)) call look_at(grazes(i_piece + 1) - beside*length, piece(2), at_ends(2), tolerance)
            end associate
            if (.not. (piece(1) < piece(2) .and. allocated(at_ends(1)%multipliers) .and. allocated(at_ends(2)%multipliers))) cycle
            call make_certain(piece(1), at_ends(1))
            call make_certain(piece(2), at_ends(2))
            n_before = size(self%waiting)
            do i_kind = bifurcation%branch, bifurcation%torus
               if (i_kind == bifurcation%branch .and. (n_pieces > 1 .or. has_branched .or. tells_all(self))) cycle   ! that is known
               change%kind = i_kind
               call find_bifurcation(piece, [bifurcation_value(i_kind, at_ends(1)%multipliers), &
                                             bifurcation_value(i_kind, at_ends(2)%multipliers)])
            end do
            call find_the_rest(piece, n_outside(at_ends(1)), n_outside(at_ends(2)), n_before)
         end do
      end subroutine find_bifurcations

      !> Finds multipliers again that are so close to the unit circle that their error may decide on which side they are.
      subroutine make_certain(place, there)
         real(wp), intent(in) :: place
         type(stability_t), intent(inout) :: there
         type(stability_t) :: better
         real(wp) :: same_place

         if (minval(abs(abs(there%multipliers) - 1.0_wp)) > uncertain*self%problem%scene%stability%tolerance) return
         call look_at(place, same_place, better, sharp)
         if (allocated(better%multipliers)) there%multipliers = better%multipliers
      end subroutine make_certain

      !> Where what was found does not explain how many more multipliers are outside of the unit circle at the end of a piece than
      !> at its beginning, as two that cross it in the same way, each change of their number is located instead.
      subroutine find_the_rest(piece, n_first, n_last, n_before)
         real(wp), intent(in) :: piece(2)
         integer, intent(in) :: n_first, n_last                       !! multipliers outside at both ends
         integer, intent(in) :: n_before                              !! points that wait, of them found without multipliers
         integer, parameter :: most_changes = 8
         real(wp), parameter :: behind = 1.0e-9_wp                    ! a change, in steps
         real(wp), parameter :: on_circle = 1.0e-6_wp                 ! else the multipliers jump
         type(count_event_t) :: number
         type(stability_t) :: there
         real(wp) :: begin, place
         integer :: i_change, n_pairs, n_single, nearest

         if (n_first == n_last) return
         associate (kinds => pack(self%waiting%kind, self%waiting%place >= piece(1) .and. self%waiting%place <= piece(2)))
            n_single = count(kinds == curve_kind%fold .or. kinds == curve_kind%branch .or. kinds == curve_kind%flip .or. &
                             kinds == curve_kind%split)
            n_pairs = count(kinds == curve_kind%torus)
         end associate
         if (modulo(n_last - n_first - n_single, 2) == 0 .and. abs(n_last - n_first) <= n_single + 2*n_pairs) return
         self%waiting = self%waiting(:n_before)
         number%problem => self%problem
         number%which = self%which
         number%n = n_first
         begin = piece(1)
         do i_change = 1, most_changes
            if (number%n == n_last) return
            call self%curve%find_zero(number, [begin, piece(2)], [1.0_wp, -1.0_wp], 0.0_wp, x, place, is_found)
            is_lost = is_lost .or. .not. is_found
            if (.not. is_found) return
            call find_stability(self%problem, self%which, x, sharp, there)
            if (.not. allocated(there%multipliers)) return
            nearest = minloc(abs(abs(there%multipliers) - 1.0_wp), dim=1)
            associate (m => there%multipliers(nearest))
               if (abs(abs(m) - 1.0_wp) <= on_circle) then
                  if (abs(aimag(m)) > 0.0_wp) then
                     call add(curve_kind%torus, place, x)
                  else if (real(m) < 0.0_wp) then
                     call add(curve_kind%flip, place, x)
                  else if (.not. (n_pieces > 1 .or. has_branched .or. tells_all(self))) then
                     call add(curve_kind%split, place, x)
                  end if
               end if
            end associate
            call look_at(min(piece(2), place + behind*self%curve%last_step), begin, there, sharp)
            if (.not. allocated(there%multipliers)) return
            number%n = n_outside(there)
         end do
      end subroutine find_the_rest

      subroutine look_at(there, place, stability_there, tolerance)
         real(wp), intent(in) :: there
         real(wp), intent(out) :: place
         type(stability_t), intent(out) :: stability_there            !! without multipliers where they are not found
         real(wp), intent(in) :: tolerance
         logical :: is_on_curve

         place = there
         call self%curve%point_at(place, x, is_on_curve)
         if (is_on_curve) call find_stability(self%problem, self%which, x, tolerance, stability_there)
      end subroutine look_at

      !> On a piece of the step, at whose ends the function of `change` is known; real multipliers that pass each other's inverse
      !> are none.
      subroutine find_bifurcation(piece, at_ends)
         real(wp), intent(in) :: piece(2), at_ends(2)
         type(stability_t) :: there
         real(wp) :: place

         if (.not. at_ends(1)*at_ends(2) < 0.0_wp .or. minval(abs(at_ends)) <= located_multiplier) return
         call self%curve%find_zero(change, piece, at_ends, located_multiplier, x, place, is_found)
         is_lost = is_lost .or. .not. is_found
         if (.not. is_found) return
         if (change%kind == bifurcation%torus) then
            call find_stability(self%problem, self%which, x, sharp, there)
            if (.not. allocated(there%multipliers)) return
            if (.not. is_torus(there%multipliers)) return
         end if
         select case (change%kind)
         case (bifurcation%branch); call add(curve_kind%split, place, x)
         case (bifurcation%doubling); call add(curve_kind%flip, place, x)
         case default; call add(curve_kind%torus, place, x)
         end select
         call sharpen(change%kind, piece, is_there)
         if (change%kind == bifurcation%branch .and. .not. is_there) self%waiting = self%waiting(:size(self%waiting) - 1)
      end subroutine find_bifurcation

      !> Moves the bifurcation found last to where it is of the motion that repeats when it is marched: near a kink of a law the
      !> multipliers of a truncated motion are off to first order in what is cut off.
      subroutine sharpen(kind, piece, is_there)
         integer, intent(in) :: kind
         real(wp), intent(in) :: piece(2)                             !! of the step, on which that is looked for
         logical, intent(out) :: is_there                             !! false: that motion has none on the step
         real(wp), parameter :: widths(4) = [1.0e-3_wp, 1.0e-2_wp, 1.0e-1_wp, 1.0_wp]   ! of the step
         type(bifurcation_event_t) :: marched
         real(wp) :: ends(2), place, values(2)
         integer :: i, k
         logical :: is_on_curve

         is_there = .true.
         associate (problem => self%problem, curve => self%curve, found => self%waiting(size(self%waiting)))
            if (problem%scene%stability%method /= stability_method%march .or. problem%scene%tones%n_tones > 1) return
            if (all([(problem%scene%laws(i)%law%n_switches + problem%scene%laws(i)%law%n_states == 0, &
                      i=1, size(problem%scene%laws))])) return
            marched%problem => self%problem
            marched%which = self%which
            marched%kind = kind
            marched%is_marched = .true.
            do i = 1, size(widths)
               ends = min(max(found%place + widths(i)*curve%last_step*[-1.0_wp, 1.0_wp], piece(1)), piece(2))
               do k = 1, 2
                  call curve%point_at(ends(k), x, is_on_curve)
                  if (.not. is_on_curve) return
                  values(k) = marched%value(x)
               end do
               if (.not. values(1)*values(2) < 0.0_wp) cycle
               call curve%find_zero(marched, ends, values, located_multiplier, x, place, is_on_curve)
               if (.not. is_on_curve) return
               found%place = place
               found%x = x
               return
            end do
         end associate
         is_there = .false.
      end subroutine sharpen

      subroutine add(kind, place, x_there)
         integer, intent(in) :: kind
         real(wp), intent(in) :: place, x_there(:)
         type(waiting_t), allocatable :: longer(:)

         associate (n_before => size(self%waiting))
            allocate (longer(n_before + 1))
            longer(:n_before) = self%waiting
            longer(n_before + 1)%kind = kind
            longer(n_before + 1)%place = place
            longer(n_before + 1)%x = x_there
         end associate
         call move_alloc(longer, self%waiting)
      end subroutine add
   end subroutine look_back

   !> Whether all motions of one period are sought, and the determinant tells where they meet: where multipliers of a truncated
   !> motion pass 1 a little beside a fold it is no other event.
   logical function tells_all(self)
      class(motion_curve_t), intent(in) :: self

      associate (set => self%problem%scene%harmonics)
         tells_all = abs(self%curve%orientation) > 0.0_wp .and. set%n_harmonics == set%highest(1) + 1
      end associate
   end function tells_all

   !> Whether both extremes are the same before and after, as of a whirl round the middle of a ring.
   pure logical function same_change(before, after)
      real(wp), intent(in) :: before(2), after(2)
      real(wp), parameter :: round = 1.0e-9_wp

      same_change = abs(before(2) - before(1)) <= round*maxval(abs(before)) .and. &
         abs(after(2) - after(1)) <= round*maxval(abs(after))
   end function same_change

   !> Solves for the motion at the value of x, next to where it is.
   subroutine land(self, x, is_there)
      class(motion_curve_t), intent(inout), target :: self
      real(wp), intent(inout) :: x(:)
      logical, intent(out) :: is_there                                !! else x stays what it was
      type(bordered_problem_t) :: problem
      type(report_t) :: report
      real(wp), parameter :: near = 1.0e-6_wp
      real(wp) :: there(size(x))
      integer :: last

      problem = self%curve%problem
      last = size(self%which)
      problem%forms(:, last) = 0.0_wp
      problem%forms(size(x), last) = 1.0_wp
      problem%values(last) = x(size(x))
      call problem%rescale()
      there = x
      call solve_newton(problem, self%curve%corrector, there, report)
      call self%curve%report%add(report)
      there(size(x)) = x(size(x))
      is_there = report%status == outcome%converged .and. maxval(abs(there - x)/self%curve%units) < near   ! at a fold it may not
      if (is_there) x = there
   end subroutine land

   !> Whether the curve has come back to its start, after steps that led away from it.
   logical function is_back(self)
      class(motion_curve_t), intent(in) :: self
      real(wp) :: along

      is_back = .false.
      associate (curve => self%curve, units => self%curve%units)
         if (self%length < 3.0_wp*curve%last_step) return
         associate (way => (self%x_start - curve%last_x)/units, direction => curve%last_direction/units)
            along = dot_product(way, direction)/norm2(direction)
            if (along <= 0.0_wp .or. along > curve%last_step) return
            if (norm2(way - along*direction/norm2(direction)) > closed*curve%last_step) return
            is_back = dot_product(self%direction_start/units, direction) > 0.0_wp
         end associate
      end associate
   end function is_back

   !> Puts points into their order on the step, and drops those behind an end.
   subroutine put_in_order(points)
      type(waiting_t), allocatable, intent(inout) :: points(:)
      type(waiting_t), allocatable :: up_to_end(:)
      type(waiting_t) :: point
      integer :: i, k

      do i = 2, size(points)
         point = points(i)
         k = i - 1
         do while (k >= 1)
            if (points(k)%place <= point%place) exit
            points(k + 1) = points(k)
            k = k - 1
         end do
         points(k + 1) = point
      end do
      i = findloc(points%kind, curve_kind%end, dim=1)
      if (i == 0) return
      allocate (up_to_end(i))
      up_to_end = points(:i)
      call move_alloc(up_to_end, points)
   end subroutine put_in_order
end submodule hb_motion_curve_step
