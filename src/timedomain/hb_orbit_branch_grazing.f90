!> Grazes of a curve of motions with impacts: the number of impacts in a period changes there, and the curve has a corner.
submodule (hb_orbit_branch) hb_orbit_branch_grazing
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_curve_events, only: compared_event_t, differing_events
   implicit none

   integer, parameter :: max_halvings = 30
   real(wp), parameter :: distance_beyond_graze = 1.0e-5_wp           ! beyond a graze, as min_distance: speed of the impact 3e-3
   real(wp), parameter :: max_deviation = 0.25_wp                      ! of the distance to a graze ahead

contains

   !> Passes a graze straight ahead: the curve has a corner there, between motions with an impact more and those without it.
   !>
   !> The speed of that impact is proportional to the distance from the graze, and multipliers to its inverse. Newton's
   !> method therefore finds the motions without the impact from afar, and the graze on them; those with it from the graze
   !> alone. Source: A. B. Nordmark, J. Sound Vib. 145 (1991) 279-297.
   module procedure pass_grazing
      type(curve_t) :: here
      type(event_values_t) :: known
      integer, allocatable :: beyond(:)
      real(wp), dimension(size(curve%x)) :: ahead, corner, found, tangent
      real(wp) :: along

      is_passed = .false.
      call self%prepare_step(curve, branches%start_on_set)
      if (is_stalled) curve%step = curve%config%longest_step
      here = curve
      known = at_point
      ahead = here%x + here%step*here%direction
      if (is_stalled) call leave_impact(self, at_point, ahead)
      beyond = self%impacts_at(ahead)
      if (any([beyond, known%impacts] < 0)) return
      if (sum(beyond) > sum(known%impacts) .and. .not. is_stalled) then
         call find_last(self, curve, here%x, here%direction, here%step, known%impacts, corner, along)
         here%report = curve%report                             ! of its work
         curve = here
         if (along > min_distance) curve%step = along                 ! events before the graze are located on a step to it
         if (along > min_distance) return
         call find_with_impact(self, curve, at_point, corner, here%direction, found, tangent, is_passed)
      else if (sum(beyond) < sum(known%impacts) .and. known%stability%n_unstable > 0) then   ! as with any slow impact
         curve%status = outcome%pending
         call find_without_impact(self, curve, beyond, ahead, corner, tangent, is_passed)
         if (is_passed) call find_known_before(self, curve, here, corner, -tangent, known, is_passed)
         found = corner
      end if
      here%report = curve%report
      curve = here
      if (.not. is_passed) return
      curve%status = outcome%pending
      curve%last = here%path_t
      curve%x = found
      curve%direction = tangent
      curve%orientation = 0.0_wp
      curve%step = here%config%first_step
      call self%update_units(curve)
      call self%evaluate(curve, at_point)
      associate (units => here%units)
         along = norm2((corner - here%x)/units)
         points = [curve_point_t ::]
         call add_graze(points, along, corner)
         call add_corners(self, known, at_point, along, corner, points)
         along = along + norm2((found - corner)/units)
         call add_point(points, curve_kind%regular, along, found)
         curve%length = here%length + along
      end associate
   end procedure pass_grazing

   !> Adds folds and extreme responses at a corner, with what is known before it.
   subroutine add_corners(self, before, behind, position, x, points)
      class(orbit_branch_t), intent(in) :: self
      type(event_values_t), intent(in) :: before, behind
      real(wp), intent(in) :: position, x(:)
      type(curve_point_t), allocatable, intent(inout) :: points(:)
      type(compared_event_t), allocatable :: events(:)
      integer :: i

      allocate (events, source=differing_events(before, behind, self%request%responses%kind))
      do i = 1, size(events)
         if (events(i)%is_passed() .and. curve_kinds(events(i)%kind)%is_extreme) &
            call add_point(points, events(i)%kind, position, x, events(i)%response)
      end do
   end subroutine add_corners

   !> The last point of a piece of the curve from which the walls are struck as often as given, within a length.
   subroutine find_last(self, curve, x, direction, length, impacts, last, along)
      class(orbit_branch_t), intent(inout), target :: self
      type(curve_t), intent(inout) :: curve
      real(wp), intent(in) :: x(:), direction(:), length
      integer, intent(in) :: impacts(:)
      real(wp), intent(out) :: last(:)
      real(wp), intent(out) :: along                                  !! its distance from x; the length: there is no graze
      real(wp) :: step, y(size(x))
      logical :: is_on_curve

      curve%last%x = x
      curve%last%direction = direction
      curve%corrector%patience = 1                               ! on this piece Newton's method gains from the first step on
      last = x
      along = 0.0_wp
      step = length
      do while (step > 0.5_wp*min_distance .and. curve%status == outcome%pending .and. along < length)
         call curve%point_at(along + step, y, is_on_curve)
         if (is_on_curve) is_on_curve = all(self%impacts_at(y) == impacts)
         if (is_on_curve) then
            along = along + step
            last = y
         end if
         step = 0.5_wp*step
      end do
   end subroutine find_last

   !> Finds a motion with an impact more near a graze, and the tangent there.
   subroutine find_with_impact(self, curve, at_point, corner, inward, found, tangent, is_found)
      class(orbit_branch_t), intent(inout), target :: self
      type(curve_t), intent(inout) :: curve
      type(event_values_t), intent(in) :: at_point
      real(wp), intent(in) :: corner(:)                               !! last motion without the impact
      real(wp), intent(in) :: inward(:)                               !! direction of the motions without, continued
      real(wp), intent(out) :: found(:), tangent(:)
      logical, intent(out) :: is_found
      real(wp), parameter :: share(0:4) = [2.0_wp, 0.5_wp, 0.1_wp, 0.02_wp, 0.004_wp]   ! of the longest step
      real(wp) :: along(size(corner)), sign_there, step
      integer :: i
      logical :: is_singular

      is_found = .false.
      curve%direction = inward
      call curve%tangent_at(corner + distance_beyond_graze*inward, along, sign_there, is_singular)
      do i = 0, merge(-1, 2*size(share) - 1, is_singular)         ! with each share against and along
         step = share(i/2)*curve%config%longest_step
         along = -along
         found = corner + step*along
         call move_behind_grazing(self, inward, step, found)
         call correct(self, curve, along, found, is_found)
         if (is_found) is_found = norm2((found - corner)/curve%units) <= max_chord*step .and. &
                                  .not. has_wanted(self, corner, found)
         if (is_found) is_found = sum(self%impacts_at(found)) > sum(at_point%impacts)
         if (.not. is_found) cycle
         curve%direction = along
         call curve%tangent_at(found, tangent, sign_there, is_singular)
         is_found = .not. is_singular
         if (is_found) exit
      end do
   end subroutine find_with_impact

   !> Moves a point to where the map has the smallest defect with an impact more: the distance from the border beyond which
   !> there is one varies with the square of the speed of the impact.
   subroutine move_behind_grazing(self, inward, longest, x)
      class(orbit_branch_t), intent(inout), target :: self
      real(wp), intent(in) :: inward(:), longest
      real(wp), intent(inout) :: x(:)
      real(wp) :: best, border(2), least, middle, r(self%orbit%n_unknowns)
      integer :: fewest, k, n

      border = [-longest, longest]
      fewest = impacts_beyond(border(1))
      do k = 1, max_halvings
         middle = 0.5_wp*sum(border)
         n = impacts_beyond(middle)
         border(merge(1, 2, n == fewest)) = middle
      end do
      best = border(2)
      least = huge(1.0_wp)
      do k = 0, max_halvings
         n = impacts_beyond(border(2) + 0.5_wp**k*longest)
         if (n <= fewest .or. .not. all(ieee_is_finite(r))) cycle
         if (norm2(r) >= least) cycle
         least = norm2(r)
         best = border(2) + 0.5_wp**k*longest
      end do
      x = x + best*inward

   contains

      integer function impacts_beyond(distance)
         real(wp), intent(in) :: distance

         r = self%defect(x + distance*inward)
         impacts_beyond = sum(self%orbit%impacts)
      end function impacts_beyond
   end subroutine move_behind_grazing

   !> Moves a point ahead of a stalled curve to where there are fewer impacts, if there are any such points. The curve touches
   !> the border of these motions, and its tangent may miss them; the defect of a slow impact crosses it: the multiplier is large.
   subroutine leave_impact(self, at_point, x)
      class(orbit_branch_t), intent(inout), target :: self
      type(event_values_t), intent(in) :: at_point
      real(wp), intent(inout) :: x(:)
      real(wp) :: across(size(x)), ahead(size(x))
      integer :: i

      ahead = x
      across = [self%defect(ahead), 0.0_wp]
      do i = 0, merge(2*max_halvings + 1, -1, all(ieee_is_finite(across)))   ! to both sides, the nearest first
         x = ahead + (-1)**i*0.5_wp**(max_halvings - i/2)*across
         if (sum(self%impacts_at(x)) < sum(at_point%impacts)) exit
      end do
   end subroutine leave_impact

   !> Finds the graze ahead of the curve, from the motions without the impact, and their tangent, away from it.
   subroutine find_without_impact(self, curve, impacts, ahead, corner, tangent, is_found)
      class(orbit_branch_t), intent(inout), target :: self
      type(curve_t), intent(inout) :: curve
      integer, intent(in) :: impacts(:)                               !! beyond the graze
      real(wp), intent(in) :: ahead(:)                                !! of the curve, with these impacts
      real(wp), intent(out) :: corner(:), tangent(:)
      logical, intent(out) :: is_found
      real(wp), parameter :: shares(5) = [0.0_wp, 0.5_wp, -0.5_wp, 1.0_wp, -1.0_wp]   ! of the step
      real(wp), dimension(size(corner)) :: along, direction, found, x
      real(wp) :: distance, length, sign_there
      integer :: i
      logical :: is_singular

      is_found = .false.
      associate (units => curve%units)
         x = curve%x
         direction = curve%direction
         length = max_chord*curve%step
         call curve%tangent_at(ahead, along, sign_there, is_singular)
         if (is_singular) return
         do i = 1, size(shares)
            found = ahead + shares(i)*curve%step*along
            call correct(self, curve, along, found, is_found)
            if (is_found) is_found = all(self%impacts_at(found) == impacts)
            if (is_found) exit
         end do
         if (.not. is_found) return
         do i = 1, 2
            along = -along
            curve%direction = along
            call curve%tangent_at(found, tangent, sign_there, is_singular)
            if (is_singular) cycle
            call find_last(self, curve, found, -tangent, length, impacts, corner, distance)
            is_found = distance < length .and. is_ahead(corner)
            if (is_found) exit
         end do
         if (.not. is_found) return
         curve%direction = tangent
         call curve%tangent_at(corner, tangent, sign_there, is_singular)
         if (is_singular) corner = corner + min_distance*curve%direction  ! where there are distances for differences
         if (is_singular) call curve%tangent_at(corner, tangent, sign_there, is_singular)
         is_found = .not. is_singular
      end associate

   contains

      !> Whether a point is approximately in the direction of the curve.
      pure logical function is_ahead(y)
         real(wp), intent(in) :: y(:)
         real(wp) :: share

         associate (units => curve%units)
            share = dot_product((y - x)/units, direction/units)
            is_ahead = share > 0.0_wp .and. norm2((y - x - share*direction)/units) <= max_deviation*share
         end associate
      end function is_ahead
   end subroutine find_without_impact

   !> Finds what is known shortly before a graze at which an impact ends, if there is no other event between the point of
   !> the curve and the graze.
   subroutine find_known_before(self, curve, here, corner, inward, known, is_clear)
      class(orbit_branch_t), intent(inout), target :: self
      type(curve_t), intent(inout) :: curve
      type(curve_t), intent(in) :: here                               !! at its point
      real(wp), intent(in) :: corner(:), inward(:)
      type(event_values_t), intent(inout) :: known                           !! on entry at the point
      logical, intent(out) :: is_clear
      type(event_values_t) :: before
      real(wp) :: sign_there
      logical :: is_singular

      before = known
      curve%x = corner + distance_beyond_graze*inward
      curve%direction = here%direction
      call curve%tangent_at(curve%x, curve%direction, sign_there, is_singular)
      is_clear = .not. (is_singular .or. has_wanted(self, here%x, corner))
      if (.not. is_clear) return
      call self%evaluate(curve, known)
      is_clear = known%rise*before%rise > 0.0_wp .and. all(known%functions*before%functions >= 0.0_wp) .and. &
                 known%stability%n_unstable == before%stability%n_unstable
      if (is_clear) is_clear = real(known%stability%multipliers(1))*real(before%stability%multipliers(1)) > 0.0_wp
   end subroutine find_known_before

   !> Whether a value at which there is a point lies between two points.
   pure logical function has_wanted(self, x, y)
      class(orbit_branch_t), intent(in) :: self
      real(wp), intent(in) :: x(:), y(:)

      associate (wanted => [self%request%values, self%request%from, self%request%to], n => size(x))
         has_wanted = any((wanted - x(n))*(wanted - y(n)) < 0.0_wp)
      end associate
   end function has_wanted

   !> Corrects a point in the plane across a direction.
   subroutine correct(self, curve, direction, x, is_found)
      class(orbit_branch_t), intent(inout), target :: self
      type(curve_t), intent(inout) :: curve
      real(wp), intent(in) :: direction(:)
      real(wp), intent(inout) :: x(:)
      logical, intent(out) :: is_found
      type(report_t) :: report

      call curve%set_plane(x, direction, 0.0_wp)
      call solve_newton(curve%problem, curve%corrector, x, report)
      call curve%report%add(report)
      is_found = report%status == outcome%converged
   end subroutine correct

   !> Ends the branch with its last point from which the walls are struck as often: beyond it the curve has no tangent.
   module procedure end_at_grazing
      real(wp) :: found(size(curve%x)), position

      curve%status = outcome%pending
      call find_last(self, curve, curve%x, curve%direction, curve%config%shortest_step, at_point%impacts, found, &
                     position)
      points = [curve_point_t ::]
      call add_graze(points, position, found)
      points(1)%is_last = .true.
   end procedure end_at_grazing

   !> Adds a point at which the number of impacts in a period changes.
   module procedure add_graze
      call add_point(points, curve_kind%grazing, position, x)
   end procedure add_graze

   !> Whether a wall is struck a different number of times shortly behind the point of the curve.
   module procedure grazes_ahead
      integer :: i

      grazes = .false.
      do i = 1, 4
         grazes = grazes .or. any(at_point%impacts /= &
            self%impacts_at(curve%x + 0.25_wp*i*self%request%longest_step*curve%direction))
      end do
   end procedure grazes_ahead
end submodule hb_orbit_branch_grazing
