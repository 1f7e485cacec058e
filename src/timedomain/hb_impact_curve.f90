!> A curve of periodic motions with impacts on rigid walls: the state of the period map (hb_impact_orbit) is followed
!> along a value of the input, through folds and along stable and unstable motions alike.
!>
!> Steps and events are those of other curves (hb_curve_step), with the multipliers of the map. At a graze the number of
!> impacts in a period changes, and the curve has a corner. The unknowns are the state, scaled, and the value; stored with
!> them are the scales and the section.
module hb_impact_curve
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite, ieee_quiet_nan, ieee_value
   use hb_bordered, only: bordered_problem_t, new_bordered_problem
   use hb_cancellation, only: verdict, verdict_on_work
   use hb_coordinates, only: coordinates_t
   use hb_curve, only: curve_config_t, curve_t, new_curve
   use hb_curve_request, only: curve_kind, curve_request_t, located_response_t
   use hb_curve_step, only: longest_chord, step
   use hb_document, only: document_t
   use hb_error, only: error_t
   use hb_followed_motion, only: followed_motion_function_at, known_t, largest_load, waiting_t
   use hb_harmonics, only: harmonics_t
   use hb_impact_orbit, only: accurate, impact_orbit_t, new_impact_orbit
   use hb_integrate_to_tolerance, only: keep_lines, loaded_tuples, status_within
   use hb_integrated_result, only: keep_integrated
   use hb_kinds, only: wp
   use hb_level, only: level_t, put_on_set
   use hb_model, only: model_t, share_of_integrated
   use hb_model_basis, only: coordinates_of
   use hb_motion_curve, only: motion_curve_continue_from, motion_curve_start_branch, motion_curve_t
   use hb_motion_result, only: curve_position_t, motion_result_t
   use hb_motion_ridge, only: new_motion_curve
   use hb_motion_series, only: motion_series_t, new_motion_series
   use hb_newton, only: solve_newton
   use hb_outcome, only: is_solved, outcome
   use hb_point, only: solve_point
   use hb_solver_types, only: report_t, solver_config_t
   use hb_stability, only: stability_t
   use hb_time_domain, only: steady_motion_t
   use hb_tuple_choice, only: new_lowest_set
   implicit none
   private
   public :: impact_curve_t, new_curve_of

   integer, parameter :: most_corrections = 10
   integer, parameter :: most_halvings = 30
   real(wp), parameter :: nearest = 1.0e-6_wp                         ! to a graze, in units of lengths: differences need 1e-8
   real(wp), parameter :: into = 1.0e-5_wp                            ! beyond it, likewise: speed of the impact 3e-3
   real(wp), parameter :: off_the_line = 0.25_wp                      ! of the distance to a graze ahead
   integer, parameter :: most_candidates = 512                        ! order of the harmonics of a point with a tolerance

   !> Owns external resources: call `destroy`. A variable of this type needs the attribute `target`.
   type, extends(motion_curve_t) :: impact_curve_t
      type(impact_orbit_t) :: orbit
      type(harmonics_t), private :: set                               ! of the points and responses
      real(wp), private :: first_section = 0.0_wp                     ! that of the first motion
   contains
      procedure :: begin => impact_curve_begin
      procedure :: continue_from => impact_curve_continue_from
      procedure :: start_branch => impact_curve_start_branch
      procedure :: go => impact_curve_go
      procedure :: put_on => impact_curve_put_on
      procedure :: find_roughness => impact_curve_find_roughness
      procedure :: make_curve => impact_curve_make_curve
      procedure :: prepare_step => impact_curve_prepare_step
      procedure :: transfer_start => impact_curve_transfer_start
      procedure :: renew => impact_curve_renew
      procedure :: function_at => impact_curve_function_at
      procedure :: find_series => impact_curve_find_series
      procedure :: find_stability => impact_curve_find_stability
      procedure :: find_contact => impact_curve_find_contact
      procedure :: describe => impact_curve_describe
      procedure :: pack => impact_curve_pack
      procedure :: destroy => impact_curve_destroy
   end type impact_curve_t

contains

   !> Creates the curve of a model: of impacts if walls have a restitution, otherwise of balances.
   subroutine new_curve_of(self, model, request)
      class(motion_curve_t), allocatable, intent(out) :: self
      type(model_t), intent(in) :: model
      type(curve_request_t), intent(in) :: request

      if (model%lacks_impacts_of(outcome%impact)) then
         allocate (impact_curve_t :: self)
      else
         call new_motion_curve(self, request)
      end if
   end subroutine new_curve_of

   !> Solves the first motion by all methods of a point, and the period map from there.
   subroutine impact_curve_begin(self, model, document, request, result, error)
      class(impact_curve_t), intent(inout), target :: self
      type(model_t), intent(inout) :: model                           !! at the start
      type(document_t), intent(in) :: document                        !! from which it was read
      type(curve_request_t), intent(in) :: request
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      type(level_t) :: level
      type(model_t) :: whole
      type(motion_series_t) :: motion
      type(report_t) :: report
      type(harmonics_t) :: set
      real(wp), allocatable :: x(:)
      integer :: i

      whole = model
      whole%output%dofs = [(i, i=1, model%structure%n_dofs)]
      whole%chain%is_on = .false.
      call solve_point(whole, document, result, error, level)
      self%is_done = allocated(error) .or. .not. (is_solved(result%status) .and. allocated(result%coefficients))
      if (self%is_done) return
      set = model%harmonics
      if (model%accuracy%is_on) set = result%harmonics
      call new_motion_series(motion, set%tuples, model%tones%omega, &
                             transpose(cmplx(result%coefficients(1, :, :), -result%coefficients(2, :, :), wp)))
      call new_impact_orbit(self%orbit, model, motion, error)
      self%is_done = allocated(error)
      if (self%is_done) return
      call self%orbit%move(document, request%moving, request%start)
      x = self%orbit%map%state_at(self%orbit%section*self%orbit%period())
      call solve_newton(self%orbit, solver_config_t(tolerance=accurate, max_iterations=3*most_corrections), x, report)
      self%is_done = report%status /= outcome%converged
      if (self%is_done) then
         result%status = outcome%stalled
         result%message = "the period map has no periodic motion near the one found; "//result%message
         return
      end if
      self%first_section = self%orbit%section
      self%request = request
      call self%prepare(model, document, [request%start], level_t(), error)
      self%first%x = [x, request%start]
      call self%report_start(result, error)
   end subroutine impact_curve_begin

   !> Restores the state of a stored curve at its last point, a step.
   subroutine impact_curve_continue_from(self, model, document, request, stored, error)
      class(impact_curve_t), intent(inout), target :: self
      type(model_t), intent(in) :: model
      type(document_t), intent(in) :: document
      type(curve_request_t), intent(in) :: request
      type(curve_position_t), intent(in) :: stored(:)                 !! all points up to the one to continue from
      type(error_t), allocatable, intent(out) :: error
      type(curve_position_t) :: bare(size(stored))
      type(motion_series_t) :: motion
      integer :: i, n

      associate (last => stored(size(stored))%unknowns, n_dofs => model%structure%n_dofs)
         n = (size(last) - 2)/2
         call new_motion_series(motion, reshape([1], [1, 1]), model%tones%omega, &
                                cmplx(reshape(last(n + 1:n + n_dofs), [n_dofs, 1]), kind=wp))
         call new_impact_orbit(self%orbit, model, motion, error)
         if (allocated(error)) return
         call self%orbit%move(document, request%moving, request%start)
         self%orbit%map%scale = last(n + 1:2*n)
         self%first_section = stored(1)%unknowns(2*n + 1)
         bare = stored
         do i = 1, size(stored)
            bare(i)%unknowns = [stored(i)%unknowns(:n), stored(i)%unknowns(2*n + 2)]
            if (allocated(stored(i)%direction)) bare(i)%direction = [stored(i)%direction(:n), stored(i)%direction(2*n + 2)]
         end do
         call motion_curve_continue_from(self, model, document, request, bare, error)
         if (allocated(error)) return
         call self%orbit%put_section(last(2*n + 1))
      end associate
      call self%evaluate_here(self%known)
   end subroutine impact_curve_continue_from

   !> The state with its scales and the section, and the value.
   pure function impact_curve_pack(self, x) result(packed)
      class(impact_curve_t), intent(in) :: self
      real(wp), intent(in) :: x(:)
      real(wp), allocatable :: packed(:)

      packed = [x(:size(x) - 1), self%orbit%map%scale, self%orbit%section, x(size(x))]
   end function impact_curve_pack

   !> The section of the first motion is that of the start.
   subroutine impact_curve_start_branch(self, error)
      class(impact_curve_t), intent(inout), target :: self
      type(error_t), allocatable, intent(out) :: error

      call self%orbit%put_section(self%first_section)
      call motion_curve_start_branch(self, error)
   end subroutine impact_curve_start_branch

   !> A state has no set; that of the points contains all candidates for a tolerance.
   subroutine impact_curve_put_on(self, level, error)
      class(impact_curve_t), intent(inout), target :: self
      type(level_t), intent(in) :: level
      type(error_t), allocatable, intent(out) :: error

      self%level = level
      self%set = self%model%harmonics
      associate (accuracy => self%model%accuracy)
         if (accuracy%is_on) call new_lowest_set(self%set, 1, loaded_tuples(self%model), error, &
            min(most_candidates, max(16, ceiling(4.0_wp*accuracy%tolerance**(-2.0_wp/3.0_wp)))))
      end associate
   end subroutine impact_curve_put_on

   !> Nor has the period map more roughness than its rounding.
   subroutine impact_curve_find_roughness(self, x, is_possible)
      class(impact_curve_t), intent(inout), target :: self
      real(wp), intent(in) :: x(:)
      logical, intent(out), optional :: is_possible

      self%roughness = 0.0_wp
   end subroutine impact_curve_find_roughness

   !> Likewise.
   subroutine impact_curve_transfer_start(self)
      class(impact_curve_t), intent(inout) :: self

   end subroutine impact_curve_transfer_start

   !> Sets up the curve at one of its points.
   subroutine impact_curve_make_curve(self, x, direction)
      class(impact_curve_t), intent(inout), target :: self
      real(wp), intent(in) :: x(:), direction(:)
      type(bordered_problem_t) :: bordered
      type(curve_config_t) :: config
      type(solver_config_t) :: corrector
      real(wp) :: units(size(x))

      call new_bordered_problem(bordered, self%orbit, [1], reshape(direction, [size(x), 1]), [0.0_wp])
      corrector%tolerance = accurate
      corrector%max_iterations = most_corrections
      corrector%patience = 3
      corrector%line_search = .false.
      config = self%config()
      config%shortest_step = 1.0e-4_wp*config%longest_step            ! the period map has no derivative at a graze
      self%curve%x = x
      call self%renew()
      units = self%curve%units
      call new_curve(self%curve, bordered, x, direction, units, config, corrector)
   end subroutine impact_curve_make_curve

   !> Performs one step, or passes a graze, before it or where it stalls. A graze at which the curve turns back cannot be located
   !> on a step: it is passed, or the short step begins there.
   subroutine impact_curve_go(self, error)
      class(impact_curve_t), intent(inout), target :: self
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: before(:)
      logical :: is_passed

      before = self%known%impacts
      call pass_graze(self, is_passed)
      if (.not. is_passed) call step(self)
      if (self%curve%status == outcome%stalled .and. self%known%stability%n_unstable > 0) call pass_graze(self, is_passed)
      if (verdict_on_work() == verdict%timed_out) self%curve%status = outcome%timed_out   ! integrations then miss impacts
      if (is_passed) return
      if (self%curve%status == outcome%pending .and. any(before /= self%known%impacts) .and. &
          all(self%waiting%kind /= curve_kind%graze)) &
         self%waiting = [waiting_t(curve_kind%graze, 0.0_wp, self%curve%last_x), self%waiting]
      self%problem%refused = self%curve%x(size(self%curve%x))
      if (allocated(self%orbit%error_text)) self%problem%error_text = self%orbit%error_text
      if (self%curve%status == outcome%stalled .and. grazes_ahead(self)) call end_at_graze(self)
   end subroutine impact_curve_go

   !> Passes a graze straight ahead: the curve has a corner there, between motions with an impact more and those without it.
   !>
   !> The speed of that impact is proportional to the distance from the graze, and multipliers to its inverse. Newton's
   !> method therefore finds the motions without the impact from afar, and the graze on them; those with it from the graze
   !> alone. Source: A. B. Nordmark, J. Sound Vib. 145 (1991) 279-297.
   subroutine pass_graze(self, is_passed)
      class(impact_curve_t), intent(inout), target :: self
      logical, intent(out) :: is_passed
      type(curve_t) :: here
      type(known_t) :: known
      integer, allocatable :: beyond(:)
      real(wp), dimension(size(self%curve%x)) :: ahead, corner, found, tangent
      real(wp) :: along
      logical :: is_stalled

      is_passed = .false.
      call self%prepare_step()
      is_stalled = self%curve%status == outcome%stalled
      if (is_stalled) self%curve%step = self%curve%config%longest_step
      here = self%curve
      known = self%known
      ahead = here%x + here%step*here%direction
      if (is_stalled) call leave_impact(self, ahead)
      beyond = impacts_at(self, ahead)
      if (any([beyond, known%impacts] < 0)) return
      if (sum(beyond) > sum(known%impacts) .and. .not. is_stalled) then
         call find_last(self, here%x, here%direction, here%step, known%impacts, corner, along)
         here%report = self%curve%report                             ! of its work
         self%curve = here
         if (along > nearest) self%curve%step = along                 ! events before the graze are located on a step to it
         if (along > nearest) return
         call find_with_impact(self, corner, here%direction, found, tangent, is_passed)
      else if (sum(beyond) < sum(known%impacts) .and. known%stability%n_unstable > 0) then   ! as with any slow impact
         self%curve%status = outcome%pending
         call find_without_impact(self, beyond, ahead, corner, tangent, is_passed)
         if (is_passed) call find_known_before(self, here, corner, -tangent, known, is_passed)
         found = corner
      end if
      here%report = self%curve%report
      self%curve = here
      if (.not. is_passed) return
      self%curve%status = outcome%pending
      self%curve%last_x = here%x
      self%curve%last_direction = here%direction
      self%curve%x = found
      self%curve%direction = tangent
      self%curve%orientation = 0.0_wp
      self%curve%step = here%config%first_step
      call self%renew()
      call self%evaluate_here(self%known)
      associate (units => here%units)
         along = norm2((corner - here%x)/units)
         self%waiting = [waiting_t(curve_kind%graze, along, corner), corners_of(self, known, along, corner), &
                         waiting_t(curve_kind%regular, along + norm2((found - corner)/units), found)]
         self%first_waiting = 1
      end associate
   end subroutine pass_graze

   !> Folds and extreme responses at a corner, with what is known before it.
   function corners_of(self, before, position, x) result(found)
      class(impact_curve_t), intent(in) :: self
      type(known_t), intent(in) :: before
      real(wp), intent(in) :: position, x(:)
      type(waiting_t), allocatable :: found(:)
      integer :: i, sense

      allocate (found(0))
      if (before%rise*self%known%rise < 0.0_wp) found = [waiting_t(curve_kind%fold, position, x)]
      do i = 1, size(self%request%responses)
         associate (kind => self%request%responses(i)%kind)
            if (all(kind /= [curve_kind%peak, curve_kind%minimum])) cycle
            sense = merge(1, -1, kind == curve_kind%peak)
            if (sense*before%functions(i) > 0.0_wp .and. sense*self%known%functions(i) < 0.0_wp) &
               found = [found, waiting_t(kind, position, x, response=i)]
         end associate
      end do
   end function corners_of

   !> The last point of a piece of the curve from which the walls are struck as often as given, within a length.
   subroutine find_last(self, x, direction, length, impacts, last, along)
      class(impact_curve_t), intent(inout), target :: self
      real(wp), intent(in) :: x(:), direction(:), length
      integer, intent(in) :: impacts(:)
      real(wp), intent(out) :: last(:)
      real(wp), intent(out) :: along                                  !! its distance from x; the length: there is no graze
      real(wp) :: step, y(size(x))
      logical :: is_on_curve

      self%curve%last_x = x
      self%curve%last_direction = direction
      self%curve%corrector%patience = 1                               ! on this piece Newton's method gains from the first step on
      last = x
      along = 0.0_wp
      step = length
      do while (step > 0.5_wp*nearest .and. self%curve%status == outcome%pending .and. along < length)
         call self%curve%point_at(along + step, y, is_on_curve)
         if (is_on_curve) is_on_curve = all(impacts_at(self, y) == impacts)
         if (is_on_curve) then
            along = along + step
            last = y
         end if
         step = 0.5_wp*step
      end do
   end subroutine find_last

   !> Finds a motion with an impact more near a graze, and the tangent there.
   subroutine find_with_impact(self, corner, inward, found, tangent, is_found)
      class(impact_curve_t), intent(inout), target :: self
      real(wp), intent(in) :: corner(:)                               !! last motion without the impact
      real(wp), intent(in) :: inward(:)                               !! direction of the motions without, continued
      real(wp), intent(out) :: found(:), tangent(:)
      logical, intent(out) :: is_found
      real(wp), parameter :: share(0:2) = [2.0_wp, 0.5_wp, 0.1_wp]      ! of the longest step
      real(wp) :: along(size(corner)), sign_there, step
      integer :: i
      logical :: is_singular

      is_found = .false.
      associate (curve => self%curve)
         curve%direction = inward
         call curve%tangent_at(corner + into*inward, along, sign_there, is_singular)
         do i = 0, merge(-1, 2*size(share) - 1, is_singular)         ! with each share against and along
            step = share(i/2)*curve%config%longest_step
            along = -along
            found = corner + step*along
            call put_behind_graze(self, inward, step, found)
            call correct(self, along, found, is_found)
            if (is_found) is_found = norm2((found - corner)/curve%units) <= longest_chord*step .and. &
                                     .not. has_wanted(self, corner, found)
            if (is_found) is_found = sum(impacts_at(self, found)) > sum(self%known%impacts)
            if (.not. is_found) cycle
            curve%direction = along
            call curve%tangent_at(found, tangent, sign_there, is_singular)
            is_found = .not. is_singular
            if (is_found) exit
         end do
      end associate
   end subroutine find_with_impact

   !> Moves a point to where the map has the smallest defect with an impact more: the distance from the border beyond which
   !> there is one varies with the square of the speed of the impact.
   subroutine put_behind_graze(self, inward, longest, x)
      class(impact_curve_t), intent(inout), target :: self
      real(wp), intent(in) :: inward(:), longest
      real(wp), intent(inout) :: x(:)
      real(wp) :: best, border(2), least, middle, r(self%orbit%n_unknowns)
      integer :: fewest, k, n

      border = [-longest, longest]
      fewest = impacts_beyond(border(1))
      do k = 1, most_halvings
         middle = 0.5_wp*sum(border)
         n = impacts_beyond(middle)
         border(merge(1, 2, n == fewest)) = middle
      end do
      best = border(2)
      least = huge(1.0_wp)
      do k = 0, most_halvings
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

         r = defect(self, x + distance*inward)
         impacts_beyond = sum(self%orbit%impacts)
      end function impacts_beyond
   end subroutine put_behind_graze

   !> Moves a point ahead of a stalled curve to where there are fewer impacts, if there are any such points. The curve touches
   !> the border of these motions, and its tangent may miss them; the defect of a slow impact crosses it: the multiplier is large.
   subroutine leave_impact(self, x)
      class(impact_curve_t), intent(inout), target :: self
      real(wp), intent(inout) :: x(:)
      real(wp) :: across(size(x)), ahead(size(x))
      integer :: i

      ahead = x
      across = [defect(self, ahead), 0.0_wp]
      do i = 0, merge(2*most_halvings + 1, -1, all(ieee_is_finite(across)))   ! to both sides, the nearest first
         x = ahead + (-1)**i*0.5_wp**(most_halvings - i/2)*across
         if (sum(impacts_at(self, x)) < sum(self%known%impacts)) exit
      end do
   end subroutine leave_impact

   !> Finds the graze ahead of the curve, from the motions without the impact, and their tangent, away from it.
   subroutine find_without_impact(self, impacts, ahead, corner, tangent, is_found)
      class(impact_curve_t), intent(inout), target :: self
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
      associate (curve => self%curve, units => self%curve%units)
         x = curve%x
         direction = curve%direction
         length = longest_chord*curve%step
         call curve%tangent_at(ahead, along, sign_there, is_singular)
         if (is_singular) return
         do i = 1, size(shares)
            found = ahead + shares(i)*curve%step*along
            call correct(self, along, found, is_found)
            if (is_found) is_found = all(impacts_at(self, found) == impacts)
            if (is_found) exit
         end do
         if (.not. is_found) return
         do i = 1, 2
            along = -along
            curve%direction = along
            call curve%tangent_at(found, tangent, sign_there, is_singular)
            if (is_singular) cycle
            call find_last(self, found, -tangent, length, impacts, corner, distance)
            is_found = distance < length .and. is_ahead(corner)
            if (is_found) exit
         end do
         if (.not. is_found) return
         curve%direction = tangent
         call curve%tangent_at(corner, tangent, sign_there, is_singular)
         if (is_singular) corner = corner + nearest*curve%direction  ! where there are distances for differences
         if (is_singular) call curve%tangent_at(corner, tangent, sign_there, is_singular)
         is_found = .not. is_singular
      end associate

   contains

      !> Whether a point is approximately in the direction of the curve.
      pure logical function is_ahead(y)
         real(wp), intent(in) :: y(:)
         real(wp) :: share

         associate (units => self%curve%units)
            share = dot_product((y - x)/units, direction/units)
            is_ahead = share > 0.0_wp .and. norm2((y - x - share*direction)/units) <= off_the_line*share
         end associate
      end function is_ahead
   end subroutine find_without_impact

   !> Finds what is known shortly before a graze at which an impact ends, if there is no other event between the point of
   !> the curve and the graze.
   subroutine find_known_before(self, here, corner, inward, known, is_clear)
      class(impact_curve_t), intent(inout), target :: self
      type(curve_t), intent(in) :: here                               !! at its point
      real(wp), intent(in) :: corner(:), inward(:)
      type(known_t), intent(inout) :: known                           !! on entry at the point
      logical, intent(out) :: is_clear
      type(known_t) :: before
      real(wp) :: sign_there
      logical :: is_singular

      before = known
      associate (curve => self%curve)
         curve%x = corner + into*inward
         curve%direction = here%direction
         call curve%tangent_at(curve%x, curve%direction, sign_there, is_singular)
         is_clear = .not. (is_singular .or. has_wanted(self, here%x, corner))
         if (.not. is_clear) return
         call self%evaluate_here(known)
      end associate
      is_clear = known%rise*before%rise > 0.0_wp .and. all(known%functions*before%functions >= 0.0_wp) .and. &
                 known%stability%n_unstable == before%stability%n_unstable
      if (is_clear) is_clear = real(known%stability%multipliers(1))*real(before%stability%multipliers(1)) > 0.0_wp
   end subroutine find_known_before

   !> Whether a value at which there is a point lies between two points.
   pure logical function has_wanted(self, x, y)
      class(impact_curve_t), intent(in) :: self
      real(wp), intent(in) :: x(:), y(:)

      associate (wanted => [self%request%values, self%request%from, self%request%to], n => size(x))
         has_wanted = any((wanted - x(n))*(wanted - y(n)) < 0.0_wp)
      end associate
   end function has_wanted

   !> Corrects a point in the plane across a direction.
   subroutine correct(self, direction, x, is_found)
      class(impact_curve_t), intent(inout), target :: self
      real(wp), intent(in) :: direction(:)
      real(wp), intent(inout) :: x(:)
      logical, intent(out) :: is_found
      type(report_t) :: report

      associate (curve => self%curve)
         call curve%put_plane(x, direction, 0.0_wp)
         call solve_newton(curve%problem, curve%corrector, x, report)
         call curve%report%add(report)
      end associate
      is_found = report%status == outcome%converged
   end subroutine correct

   !> Ends the branch with its last point from which the walls are struck as often: beyond it the curve has no tangent.
   subroutine end_at_graze(self)
      class(impact_curve_t), intent(inout), target :: self
      real(wp) :: found(size(self%curve%x)), position

      self%curve%status = outcome%pending
      call find_last(self, self%curve%x, self%curve%direction, self%curve%config%shortest_step, self%known%impacts, found, position)
      self%waiting = [waiting_t(curve_kind%graze, position, found)]
      self%first_waiting = 1
      self%ends_here = .true.
   end subroutine end_at_graze

   !> Whether a wall is struck a different number of times shortly behind the point of the curve.
   logical function grazes_ahead(self)
      class(impact_curve_t), intent(inout), target :: self
      integer :: i

      grazes_ahead = .false.
      do i = 1, 4
         grazes_ahead = grazes_ahead .or. any(self%known%impacts /= &
            impacts_at(self, self%curve%x + 0.25_wp*i*self%request%longest_step*self%curve%direction))
      end do
   end function grazes_ahead

   !> Moves the section of the map, and the curve with its start, away from impacts.
   subroutine impact_curve_prepare_step(self)
      class(impact_curve_t), intent(inout), target :: self
      real(wp) :: old, section
      logical :: is_done

      associate (curve => self%curve, orbit => self%orbit, n => self%orbit%n_unknowns)
         call orbit%set_parameters([1], curve%x(n + 1:), is_done)
         old = orbit%section
         section = orbit%better_section(curve%x(:n))
         if (abs(section - old) <= 0.0_wp) return
         call move(self%start%x, self%start%direction)
         call orbit%put_section(old)
         call move(curve%x, curve%direction)
         curve%orientation = 0.0_wp
         call self%renew()
         curve%direction = curve%direction/norm2(curve%direction/curve%units)
      end associate

   contains

      subroutine move(x, direction)
         real(wp), intent(inout) :: x(:), direction(:)

         associate (n => self%orbit%n_unknowns)
            call self%orbit%set_parameters([1], x(n + 1:), is_done)
            call self%orbit%move_section(section, x(:n), direction(:n), direction(n + 1), is_done)
         end associate
      end subroutine move
   end subroutine impact_curve_prepare_step

   !> Computes the results of a motion of the curve.
   subroutine impact_curve_describe(self, point, result, error)
      class(impact_curve_t), intent(inout), target :: self
      type(waiting_t), intent(in) :: point
      type(motion_result_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error
      type(coordinates_t) :: coordinates
      type(model_t) :: here
      type(steady_motion_t) :: steady
      logical :: is_done

      associate (orbit => self%orbit, n => self%orbit%n_unknowns, accuracy => self%model%accuracy)
         result = motion_result_t()
         result%residual = orbit%norm(defect(self, point%x))
         result%n_unknowns = n
         result%status = outcome%failed
         here = orbit%model
         coordinates = coordinates_of(here)
         if (accuracy%is_on) then
            call put_on_set(here, orbit%model, self%set)
            here%integration%aim = accuracy%tolerance
         end if
         call orbit%describe(here, coordinates, point%x(:n), steady, is_done)
         steady%status = outcome%time_domain
         if (is_done .and. accuracy%is_on) then
            call keep_lines(here, coordinates, share_of_integrated*accuracy%max_harmonics, steady, result, self%level)
            result%status = status_within(self%model, steady, result)
         else if (is_done) then
            call keep_integrated(here, coordinates, steady, result)
            result%status = steady%status
         end if
         if (verdict_on_work() == verdict%timed_out) result%status = outcome%timed_out
      end associate
   end subroutine impact_curve_describe

   !> Updates the units of length at the present point.
   subroutine impact_curve_renew(self)
      class(impact_curve_t), intent(inout), target :: self

      associate (curve => self%curve, n => self%orbit%n_unknowns)
         self%largest = max(self%largest, norm2(curve%x(:n)))
         curve%units = [spread(self%largest, 1, n), self%orbit%parameter_scales([1])]
      end associate
   end subroutine impact_curve_renew

   !> Slopes are those of motions with the same impacts: near a graze their differences are shorter.
   real(wp) function impact_curve_function_at(self, response, x, direction) result(value)
      class(impact_curve_t), intent(inout), target :: self
      type(located_response_t), intent(in) :: response
      real(wp), intent(in) :: x(:), direction(:)
      real(wp) :: usual
      integer, allocatable :: impacts(:)

      usual = self%apart
      impacts = impacts_at(self, x)
      do while (self%apart > 0.01_wp*nearest)                         ! corners are that near to a graze
         if (all(impacts == impacts_at(self, x + 2.0_wp*self%apart*direction)) .and. &
             all(impacts == impacts_at(self, x - 2.0_wp*self%apart*direction))) exit
         self%apart = 0.5_wp*self%apart
      end do
      value = followed_motion_function_at(self, response, x, direction)
      self%apart = usual
   end function impact_curve_function_at

   !> Amplitudes of the degree of freedom of a response; none if the value is rejected.
   subroutine impact_curve_find_series(self, response, x, set, c, load)
      class(impact_curve_t), intent(inout), target :: self
      type(located_response_t), intent(in) :: response
      real(wp), intent(in) :: x(:)
      type(harmonics_t), pointer, intent(out) :: set
      complex(wp), allocatable, intent(out) :: c(:)
      complex(wp), intent(out) :: load
      logical :: is_possible

      set => self%set
      call self%orbit%set_parameters([1], x(size(x):), is_possible)
      load = largest_load(self%orbit%model, response)
      allocate (c(0))
      if (is_possible) c = self%orbit%series_of(set, response%dof, x(:size(x) - 1))
   end subroutine impact_curve_find_series

   !> Stability of the motion at a point of the curve.
   subroutine impact_curve_find_stability(self, x, tolerance, stability, is_integrated)
      class(impact_curve_t), intent(inout), target :: self
      real(wp), intent(in) :: x(:), tolerance
      type(stability_t), intent(out) :: stability
      logical, intent(in), optional :: is_integrated
      logical :: is_possible

      call self%orbit%set_parameters([1], x(size(x):), is_possible)
      if (is_possible) stability = self%orbit%stability(x(:size(x) - 1))
   end subroutine impact_curve_find_stability

   !> Impacts of each wall in a period at a point of the curve.
   subroutine impact_curve_find_contact(self, x, known)
      class(impact_curve_t), intent(inout), target :: self
      real(wp), intent(in) :: x(:)
      type(known_t), intent(inout) :: known

      known%impacts = impacts_at(self, x)
   end subroutine impact_curve_find_contact

   !> Impacts of each wall in a period, as of a record.
   function impacts_at(self, x) result(impacts)
      class(impact_curve_t), intent(inout), target :: self
      real(wp), intent(in) :: x(:)
      integer, allocatable :: impacts(:)
      real(wp) :: r(self%orbit%n_unknowns)

      r = defect(self, x)
      impacts = self%orbit%impacts
   end function impacts_at

   !> Defect of a motion after a period, NaN if its value is rejected; the orbit counts its impacts.
   function defect(self, x) result(r)
      class(impact_curve_t), intent(inout), target :: self
      real(wp), intent(in) :: x(:)
      real(wp) :: r(self%orbit%n_unknowns)
      logical :: is_possible

      r = ieee_value(1.0_wp, ieee_quiet_nan)
      call self%orbit%set_parameters([1], x(size(x):), is_possible)
      if (is_possible) call self%orbit%residual(x(:size(x) - 1), r)
   end function defect

   !> Frees the equations of motion; safe to call twice.
   subroutine impact_curve_destroy(self)
      class(impact_curve_t), intent(inout) :: self

      call self%orbit%destroy()
   end subroutine impact_curve_destroy
end module hb_impact_curve
