!> What is found on a step of a curve: folds, peaks, grazes, bifurcations, wanted values and ends, located and in their order.
submodule (hb_motion_curve) hb_motion_curve_found
   use hb_bifurcation, only: bifurcation, bifurcation_value, is_torus
   use hb_curve, only: event_t
   use hb_curve_events, only: bifurcation_event_t, branch_event_t, count_event_t, fold_event_t, graze_event_t, n_outside, &
      on_circle, peak_event_t, sharp, value_event_t
   use hb_stability, only: stability_method
   implicit none

   real(wp), parameter :: located = 1.0e-11_wp                        ! of a function that is zero at a fold or a peak
   real(wp), parameter :: at_start = 1.0e-4_wp                        ! of a step: where a branch begins rounding decides on zeros
   real(wp), parameter :: uncertain = 100.0_wp                        ! times the tolerance of multipliers: to the unit circle
   real(wp), parameter :: closed = 0.1_wp                             ! of a step, from the start, when the curve is back there
   integer, parameter :: kind_of(3) = [curve_kind%split, curve_kind%flip, curve_kind%torus]   ! of each kind of bifurcation

   !> The step, and how far the search has come.
   type :: search_t
      real(wp), allocatable :: slopes(:), extremes(:, :)              ! at the end of the step
      type(stability_t) :: stability                                  ! there
      logical :: has_branched = .false.                               ! a branch point was passed by
      logical :: has_fold = .false.                                   ! its point is in the list
      logical :: is_lost = .false.                                    ! something was not located
      real(wp) :: fold(2) = 0.0_wp                                    ! place and value of the fold
   end type search_t

   !> Part of the step without grazes, at which multipliers may jump.
   type :: piece_t
      real(wp) :: ends(2) = 0.0_wp                                    ! places on the step
      type(stability_t) :: stability(2)                               ! at these
   end type piece_t

contains

   module procedure motion_curve_look_back
      type(search_t) :: search

      search%slopes = slopes
      search%extremes = extremes
      search%stability = stability
      search%has_branched = has_branched
      associate (curve => self%curve)
         if (self%is_uneven) curve%corrector%tolerance = 10.0_wp*curve%corrector%tolerance   ! of many points
         call find_fold(self, search)
         if (has_branched) call find_branch(self, search)
         call find_peaks(self, search)
         call find_grazes(self, search)
         call find_bifurcations(self, search)
         call find_values(self, search)
         self%is_closed = is_back(self)
         if (self%is_closed) call add(self, curve_kind%end, curve%last_step, self%x_start)
         call add(self, curve_kind%regular, curve%last_step, curve%x)
         self%waiting(size(self%waiting))%stability = stability
      end associate
      call put_in_order(self%waiting)
      call self%renew()                                               ! the tolerance was another one: a stored curve has this
      is_lost = search%is_lost
   end procedure motion_curve_look_back

   !> Where the value turns back.
   subroutine find_fold(self, search)
      class(motion_curve_t), intent(inout), target :: self
      type(search_t), intent(inout) :: search
      type(fold_event_t) :: fold

      associate (curve => self%curve, n => size(self%curve%x))
         if (.not. curve%last_direction(n)*curve%direction(n) < 0.0_wp .or. is_at_origin(self)) return
         fold%curve = curve
         fold%may_jump = .true.                                       ! a corner of the curve
         call find(self, search, fold, [curve%last_direction(n), curve%direction(n)]/curve%units(n), rounding_of(self), &
                   curve_kind%fold, search%has_fold)
         if (.not. search%has_fold) return
         associate (found => self%waiting(size(self%waiting)))
            search%fold = [found%place, found%x(n)]
         end associate
      end associate
   end subroutine find_fold

   !> Where another curve of the equations crosses.
   subroutine find_branch(self, search)
      class(motion_curve_t), intent(inout), target :: self
      type(search_t), intent(inout) :: search
      type(branch_event_t) :: branch
      logical :: is_found, is_there

      branch%curve = self%curve
      branch%may_jump = .true.                                        ! a sign alone
      call find(self, search, branch, [-1.0_wp, 1.0_wp]*self%curve%orientation, 0.0_wp, curve_kind%branch, is_found)
      if (is_found) call sharpen(self, bifurcation%branch, [0.0_wp, self%curve%last_step], is_there)
   end subroutine find_branch

   !> Where a response is largest.
   subroutine find_peaks(self, search)
      class(motion_curve_t), intent(inout), target :: self
      type(search_t), intent(inout) :: search
      type(peak_event_t) :: peak
      integer :: i
      logical :: is_found

      peak%may_jump = .true.                                          ! a maximum at a corner
      do i = 1, size(self%request%peaks)
         if (.not. (self%slopes(i) > 0.0_wp .and. search%slopes(i) <= 0.0_wp)) cycle
         peak%curve = self%curve
         peak%problem => self%problem
         peak%response = self%request%peaks(i)
         peak%unit = square_at(self%problem, self%which, self%request%peaks(i), self%curve%x)
         if (.not. peak%unit > 0.0_wp) cycle
         call find(self, search, peak, [self%slopes(i), search%slopes(i)]/peak%unit, rounding_of(self), curve_kind%peak, is_found)
         if (is_found) self%waiting(size(self%waiting))%response = i
      end do
   end subroutine find_peaks

   !> Where a contact begins, or is never left any more.
   subroutine find_grazes(self, search)
      class(motion_curve_t), intent(inout), target :: self
      type(search_t), intent(inout) :: search
      type(graze_event_t) :: graze
      integer :: i, k
      logical :: is_found

      graze%problem => self%problem
      graze%which = self%which
      if (size(self%extremes, 2) /= size(search%extremes, 2)) return
      do k = 1, size(search%extremes, 2)
         associate (before => self%extremes(:, k), behind => search%extremes(:, k))
            graze%switch = k
            graze%unit = max(maxval(abs(behind)), tiny(1.0_wp))
            do i = 1, 2
               if (.not. before(i)*behind(i) < 0.0_wp) cycle
               if (i == 2 .and. same_change(before, behind)) cycle     ! all round the same distance: one event
               graze%extreme = i
               call find(self, search, graze, [before(i), behind(i)]/graze%unit, rounding_of(self), curve_kind%graze, is_found)
            end do
         end associate
      end do
   end subroutine find_grazes

   !> What multipliers tell on each piece of the step between its grazes.
   subroutine find_bifurcations(self, search)
      class(motion_curve_t), intent(inout), target :: self
      type(search_t), intent(inout) :: search
      real(wp), parameter :: beside = 1.0e-6_wp                       ! a graze, in steps
      type(piece_t) :: piece
      real(wp), allocatable :: grazes(:)
      integer :: i, n_before

      call put_in_order(self%waiting)
      grazes = pack(self%waiting%place, self%waiting%kind == curve_kind%graze)
      do i = 0, size(grazes)
         piece%ends = [0.0_wp, self%curve%last_step]
         piece%stability = [self%stability, search%stability]
         associate (tolerance => self%problem%scene%stability%tolerance, length => self%curve%last_step)
            if (i > 0) call look_at(self, grazes(i) + beside*length, tolerance, piece%ends(1), piece%stability(1))
            if (i < size(grazes)) call look_at(self, grazes(i + 1) - beside*length, tolerance, piece%ends(2), piece%stability(2))
         end associate
         if (.not. (piece%ends(1) < piece%ends(2) .and. has_multipliers(piece))) cycle
         call make_certain(self, piece%ends(1), piece%stability(1))
         call make_certain(self, piece%ends(2), piece%stability(2))
         n_before = size(self%waiting)
         call find_by_kind(self, search, piece)
         call find_by_number(self, search, piece, n_before)
      end do
   end subroutine find_bifurcations

   pure logical function has_multipliers(piece)
      type(piece_t), intent(in) :: piece

      has_multipliers = allocated(piece%stability(1)%multipliers) .and. allocated(piece%stability(2)%multipliers)
   end function has_multipliers

   !> Finds multipliers again that are so close to the unit circle that their error may decide on which side they are.
   subroutine make_certain(self, place, there)
      class(motion_curve_t), intent(inout), target :: self
      real(wp), intent(in) :: place
      type(stability_t), intent(inout) :: there
      type(stability_t) :: better
      real(wp) :: same_place

      if (minval(abs(abs(there%multipliers) - 1.0_wp)) > uncertain*self%problem%scene%stability%tolerance) return
      call look_at(self, place, sharp, same_place, better)
      if (allocated(better%multipliers)) there%multipliers = better%multipliers
   end subroutine make_certain

   !> Where the function of a kind is zero; real multipliers that pass each other's inverse are no torus.
   subroutine find_by_kind(self, search, piece)
      class(motion_curve_t), intent(inout), target :: self
      type(search_t), intent(inout) :: search
      type(piece_t), intent(in) :: piece
      type(bifurcation_event_t) :: change
      type(stability_t) :: there
      real(wp) :: at_ends(2), place, x(size(self%curve%x))
      integer :: kind
      logical :: is_found

      change%problem => self%problem
      change%which = self%which
      do kind = bifurcation%branch, bifurcation%torus
         if (kind == bifurcation%branch .and. is_branch_known(self, search)) cycle
         at_ends(1) = bifurcation_value(kind, piece%stability(1)%multipliers)
         at_ends(2) = bifurcation_value(kind, piece%stability(2)%multipliers)
         if (.not. at_ends(1)*at_ends(2) < 0.0_wp .or. minval(abs(at_ends)) <= on_circle) cycle
         change%kind = kind
         call self%curve%find_zero(change, piece%ends, at_ends, on_circle, x, place, is_found)
         search%is_lost = search%is_lost .or. .not. is_found
         if (.not. is_found) cycle
         if (kind == bifurcation%torus) then
            call find_stability(self%problem, self%which, x, sharp, there)
            if (.not. allocated(there%multipliers)) cycle
            if (.not. is_torus(there%multipliers)) cycle
         end if
         call add_bifurcation(self, kind, piece, place, x)
      end do
   end subroutine find_by_kind

   !> Where what was found does not explain how many more multipliers are outside of the unit circle at the end of a piece than
   !> at its beginning, as two that cross it in the same way, each change of their number is located instead.
   subroutine find_by_number(self, search, piece, n_before)
      class(motion_curve_t), intent(inout), target :: self
      type(search_t), intent(inout) :: search
      type(piece_t), intent(in) :: piece
      integer, intent(in) :: n_before                                 !! points that wait, of them found without multipliers
      integer, parameter :: most_changes = 8
      real(wp), parameter :: behind = 1.0e-9_wp                       ! a change, in steps
      real(wp), parameter :: no_jump = 1.0e-6_wp                      ! of a multiplier from the unit circle
      type(count_event_t) :: number
      type(stability_t) :: there
      real(wp) :: begin, place, x(size(self%curve%x))
      integer :: i, kind, n_last
      logical :: is_found, is_new

      n_last = n_outside(piece%stability(2))
      number%n = n_outside(piece%stability(1))
      if (is_explained(self%waiting, piece, n_last - number%n)) return
      self%waiting = self%waiting(:n_before)
      number%problem => self%problem
      number%which = self%which
      number%may_jump = .true.
      begin = piece%ends(1)
      do i = 1, most_changes
         if (number%n == n_last) return
         call self%curve%find_zero(number, [begin, piece%ends(2)], [1.0_wp, -1.0_wp], 0.0_wp, x, place, is_found)
         search%is_lost = search%is_lost .or. .not. is_found
         if (.not. is_found) return
         call find_stability(self%problem, self%which, x, sharp, there)
         if (.not. allocated(there%multipliers)) return
         associate (nearest => there%multipliers(minloc(abs(abs(there%multipliers) - 1.0_wp), dim=1)))
            kind = kind_at(nearest)
            is_new = .not. (kind == bifurcation%branch .and. is_branch_known(self, search))
            if (abs(abs(nearest) - 1.0_wp) <= no_jump .and. is_new) call add_bifurcation(self, kind, piece, place, x)
         end associate
         call look_at(self, min(piece%ends(2), place + behind*self%curve%last_step), sharp, begin, there)
         if (.not. allocated(there%multipliers)) return
         number%n = n_outside(there)
      end do
   end subroutine find_by_number

   !> Whether the points on a piece explain that so many more multipliers are outside of the unit circle at its end.
   pure logical function is_explained(points, piece, n_more)
      type(waiting_t), intent(in) :: points(:)
      type(piece_t), intent(in) :: piece
      integer, intent(in) :: n_more
      integer :: i, n_pairs, n_single

      n_single = 0
      n_pairs = 0
      do i = 1, size(points)
         if (points(i)%place < piece%ends(1) .or. points(i)%place > piece%ends(2)) cycle
         if (any(points(i)%kind == [curve_kind%fold, curve_kind%branch, curve_kind%flip, curve_kind%split])) n_single = n_single + 1
         if (points(i)%kind == curve_kind%torus) n_pairs = n_pairs + 1
      end do
      is_explained = n_more == 0 .or. (modulo(n_more - n_single, 2) == 0 .and. abs(n_more) <= n_single + 2*n_pairs)
   end function is_explained

   !> The bifurcation at which a multiplier passes the unit circle where it is.
   pure integer function kind_at(multiplier) result(kind)
      complex(wp), intent(in) :: multiplier

      kind = bifurcation%branch
      if (real(multiplier) < 0.0_wp) kind = bifurcation%doubling
      if (abs(aimag(multiplier)) > 0.0_wp) kind = bifurcation%torus
   end function kind_at

   !> Whether a multiplier 1 on the step is a fold or a branch point that was found without multipliers.
   pure logical function is_branch_known(self, search)
      class(motion_curve_t), intent(in) :: self
      type(search_t), intent(in) :: search

      is_branch_known = search%has_fold .or. search%has_branched .or. tells_all(self)
   end function is_branch_known

   !> Adds a bifurcation of the series, if the motion of the time domain has it.
   subroutine add_bifurcation(self, kind, piece, place, x)
      class(motion_curve_t), intent(inout), target :: self
      integer, intent(in) :: kind
      type(piece_t), intent(in) :: piece
      real(wp), intent(in) :: place, x(:)
      logical :: is_there

      call add(self, kind_of(kind), place, x)
      call sharpen(self, kind, piece%ends, is_there)
      if (.not. is_there) self%waiting = self%waiting(:size(self%waiting) - 1)
   end subroutine add_bifurcation

   !> Moves the bifurcation found last to where it is of the motion that repeats when it is marched: near a kink of a law the
   !> multipliers of a truncated motion are off to first order in what is cut off.
   subroutine sharpen(self, kind, piece, is_there)
      class(motion_curve_t), intent(inout), target :: self
      integer, intent(in) :: kind
      real(wp), intent(in) :: piece(2)                                !! of the step, on which that is looked for
      logical, intent(out) :: is_there                                !! false: that motion has none there, as far as is known
      real(wp), parameter :: widths(4) = [1.0e-3_wp, 1.0e-2_wp, 1.0e-1_wp, 1.0_wp]   ! of the step
      type(bifurcation_event_t) :: marched
      real(wp) :: ends(2), place, values(2), x(size(self%curve%x))
      integer :: i, k
      logical :: is_on_curve

      associate (problem => self%problem, curve => self%curve, found => self%waiting(size(self%waiting)))
         is_there = problem%scene%stability%method /= stability_method%march .or. problem%scene%tones%n_tones > 1
         if (.not. is_there) is_there = all([(problem%scene%laws(i)%law%n_switches + problem%scene%laws(i)%law%n_states == 0, &
                                              i=1, size(problem%scene%laws))])
         if (is_there) return
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
               if (ieee_is_nan(values(k))) return
            end do
            if (.not. values(1)*values(2) < 0.0_wp) cycle
            call curve%find_zero(marched, ends, values, on_circle, x, place, is_there)
            if (.not. is_there) return
            found%place = place
            found%x = x
            return
         end do
      end associate
   end subroutine sharpen

   !> Wanted values and ends of the range; a fold parts the step.
   subroutine find_values(self, search)
      class(motion_curve_t), intent(inout), target :: self
      type(search_t), intent(inout) :: search
      type(value_event_t) :: event
      real(wp), allocatable :: wanted(:)
      real(wp) :: place, places(3), values(3), x(size(self%curve%x))
      integer :: i, k, n
      logical :: is_found, is_there

      n = size(x)
      associate (curve => self%curve, request => self%request)
         places = [0.0_wp, curve%last_step, curve%last_step]
         values = [curve%last_x(n), curve%x(n), curve%x(n)]
         if (search%has_fold) then
            places(2) = search%fold(1)
            values(2) = search%fold(2)
         end if
         wanted = [request%from, request%to, request%values]
         event%unit = abs(request%to - request%from)
         do i = 1, size(wanted)
            if (i > 2 .and. any(abs(wanted(i) - wanted(:2)) <= 0.0_wp)) cycle
            event%wanted = wanted(i)
            do k = 1, merge(2, 1, search%has_fold)
               if (.not. (values(k) - wanted(i))*(values(k + 1) - wanted(i)) < 0.0_wp) then
                  if (.not. abs(values(k + 1) - wanted(i)) <= 0.0_wp) cycle
               end if
               call curve%find_zero(event, places(k:k + 1), (values(k:k + 1) - wanted(i))/event%unit, 1.0e-13_wp, x, place, &
                                    is_found)
               if (.not. is_found) cycle
               x(n) = wanted(i)
               call self%land(x, is_there)
               call add(self, merge(curve_kind%end, curve_kind%value, i <= 2), place, x)
            end do
         end do
      end associate
   end subroutine find_values

   !> Locates an event on the whole step, and adds its point.
   subroutine find(self, search, event, at_ends, tolerance, kind, is_found)
      class(motion_curve_t), intent(inout), target :: self
      type(search_t), intent(inout) :: search
      class(event_t), intent(inout) :: event
      real(wp), intent(in) :: at_ends(2), tolerance
      integer, intent(in) :: kind
      logical, intent(out) :: is_found
      real(wp) :: place, x(size(self%curve%x))

      call self%curve%find_zero(event, [0.0_wp, self%curve%last_step], at_ends, tolerance, x, place, is_found)
      search%is_lost = search%is_lost .or. .not. is_found
      if (is_at_origin(self)) is_found = is_found .and. place > at_start*self%curve%last_step
      if (is_found) call add(self, kind, place, x)
   end subroutine find

   subroutine look_at(self, there, tolerance, place, stability)
      class(motion_curve_t), intent(inout), target :: self
      real(wp), intent(in) :: there, tolerance
      real(wp), intent(out) :: place
      type(stability_t), intent(out) :: stability                     !! without multipliers where they are not found
      real(wp) :: x(size(self%curve%x))
      logical :: is_on_curve

      place = there
      call self%curve%point_at(place, x, is_on_curve)
      if (is_on_curve) call find_stability(self%problem, self%which, x, tolerance, stability)
   end subroutine look_at

   subroutine add(self, kind, place, x)
      class(motion_curve_t), intent(inout) :: self
      integer, intent(in) :: kind
      real(wp), intent(in) :: place, x(:)
      type(waiting_t), allocatable :: longer(:)

      associate (n_before => size(self%waiting))
         allocate (longer(n_before + 1))
         longer(:n_before) = self%waiting
         longer(n_before + 1)%kind = kind
         longer(n_before + 1)%place = place
         longer(n_before + 1)%x = x
      end associate
      call move_alloc(longer, self%waiting)
   end subroutine add

   !> What rounding, or unevenness of the residual, leaves of a function that is zero.
   pure real(wp) function rounding_of(self)
      class(motion_curve_t), intent(in) :: self

      rounding_of = max(located, 10.0_wp*self%curve%corrector%tolerance)
   end function rounding_of

   !> Whether the step begins at a branch point, or a motion apart, from which this way has set out.
   pure logical function is_at_origin(self)
      class(motion_curve_t), intent(in) :: self

      is_at_origin = self%way > 2 .and. self%length <= 0.0_wp
   end function is_at_origin

   !> Whether all motions of one period are sought, and the determinant tells where they meet: where multipliers of a truncated
   !> motion pass 1 a little beside a fold it is no other event.
   pure logical function tells_all(self)
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
end submodule hb_motion_curve_found
