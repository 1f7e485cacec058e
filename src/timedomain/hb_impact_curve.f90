!> A curve of periodic motions with impacts on rigid walls: the state of the period map (hb_impact_orbit) is followed
!> along a value of the input, through folds and along stable and unstable motions alike.
!>
!> Folds, branch points, wanted values and ends are located as on other curves; flips and tori from the multipliers of
!> the map; a graze where the number of impacts in a period changes.
module hb_impact_curve
   use hb_accurate_motion, only: solve_to_tolerance
   use hb_bordered, only: bordered_problem_t, new_bordered_problem
   use hb_coordinates, only: coordinates_t
   use hb_curve, only: curve_config_t, curve_t, event_t, new_curve
   use hb_curve_events, only: branch_event_t
   use hb_curve_request, only: curve_kind, curve_request_t
   use hb_curve_step, only: add, find, find_fold, find_values, is_back, largest_turn, search_t, short, sort_by_position, try_end
   use hb_document, only: document_t
   use hb_error, only: error_t
   use hb_followed_motion, only: known_t, reported_extreme_t, waiting_t
   use hb_harmonics, only: harmonics_t
   use hb_impact_orbit, only: accurate, impact_orbit_t, new_impact_orbit
   use hb_integrate_to_tolerance, only: keep_lines, loaded_tuples, status_within
   use hb_integrated_result, only: keep_integrated
   use hb_kinds, only: wp
   use hb_level, only: level_t, put_on_set
   use hb_model, only: model_t, share_of_integrated
   use hb_model_basis, only: coordinates_of
   use hb_motion, only: solve_motion
   use hb_motion_curve, only: motion_curve_t
   use hb_motion_result, only: curve_position_t, motion_result_t
   use hb_motion_ridge, only: new_motion_curve
   use hb_motion_series, only: motion_series_t, new_motion_series
   use hb_newton, only: solve_newton
   use hb_outcome, only: is_solved, outcome
   use hb_solver_types, only: report_t, solver_config_t
   use hb_stability, only: angle_of_pair, bifurcation, bifurcation_value, is_torus, stability_t
   use hb_time_domain, only: steady_motion_t
   use hb_tuple_choice, only: new_lowest_set
   implicit none
   private
   public :: impact_curve_t, new_curve_of

   integer, parameter :: most_corrections = 10
   integer, parameter :: most_candidates = 512                        ! order of the harmonics of a point with a tolerance

   !> Owns external resources: call `destroy`. A variable of this type needs the attribute `target`.
   type, extends(motion_curve_t) :: impact_curve_t
      type(impact_orbit_t) :: orbit
      real(wp), allocatable, private :: first_x(:)                    ! state and value of the first motion
      real(wp), private :: first_section = 0.0_wp
      integer, allocatable, private :: impacts(:)                     ! at the point of the curve
   contains
      procedure :: begin => impact_curve_begin
      procedure :: continue_from => impact_curve_continue_from
      procedure :: start_branch => impact_curve_start_branch
      procedure :: go => impact_curve_go
      procedure :: report => impact_curve_report
      procedure :: renew => impact_curve_renew
      procedure :: evaluate_here => impact_curve_evaluate_here
      procedure :: destroy => impact_curve_destroy
   end type impact_curve_t

   !> A zero of a function of the orbit: of its multipliers, or a change of the impacts.
   type, extends(event_t) :: orbit_event_t
      type(impact_orbit_t), pointer :: orbit => null()
      integer :: bifurcation = 0                                      ! hb_stability
      integer, allocatable :: impacts(:)
   contains
      procedure :: value => orbit_event_value
   end type orbit_event_t

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
      type(solver_config_t) :: config
      type(harmonics_t) :: set
      real(wp), allocatable :: x(:)
      integer :: i

      whole = model
      whole%output%dofs = [(i, i=1, model%structure%n_dofs)]
      whole%chain%is_on = .false.
      if (model%accuracy%is_on) then
         call solve_to_tolerance(whole, result, error, level)
      else
         call solve_motion(whole, result, error)
      end if
      self%is_done = allocated(error) .or. .not. (is_solved(result%status) .and. allocated(result%coefficients))
      if (self%is_done) return
      set = model%harmonics
      if (model%accuracy%is_on) set = result%harmonics
      call new_motion_series(motion, set%tuples, model%tones%omega, &
                             transpose(cmplx(result%coefficients(1, :, :), -result%coefficients(2, :, :), wp)))
      call prepare(self, model, document, request, motion, error)
      if (.not. allocated(error)) then
         config%tolerance = accurate
         config%max_iterations = 3*most_corrections
         x = self%orbit%map%state_at(self%orbit%section*self%orbit%period())
         call solve_newton(self%orbit, config, x, report)
         if (report%status /= outcome%converged) then
            result%status = outcome%stalled
            result%message = "the period map has no periodic motion near the one found; "//result%message
         end if
         self%is_done = report%status /= outcome%converged
      end if
      self%is_done = self%is_done .or. allocated(error)
      if (self%is_done) return
      self%first_x = [x, request%start]
      self%first_section = self%orbit%section
      call self%start_branch(error)
      self%waiting = [waiting_t(curve_kind%start, x=self%first_x)]
      call self%report(1, result, error)
      self%first_waiting = 2
      self%n_reported = 1
      self%is_done = allocated(error) .or. self%n_reported >= request%n_points
   end subroutine impact_curve_begin

   !> Creates the period map of a model near a motion.
   subroutine prepare(self, model, document, request, motion, error)
      class(impact_curve_t), intent(inout), target :: self
      type(model_t), intent(in) :: model
      type(document_t), intent(in) :: document
      type(curve_request_t), intent(in) :: request
      type(motion_series_t), intent(in) :: motion
      type(error_t), allocatable, intent(out) :: error

      self%request = request
      self%model = model
      self%document = document
      if (.not. allocated(self%request%values)) allocate (self%request%values(0))
      if (.not. allocated(self%request%responses)) allocate (self%request%responses(0))
      allocate (self%origins(0), self%waiting(0))
      call new_impact_orbit(self%orbit, model, motion, error)
      self%orbit%document = document
      self%orbit%moving = request%moving
      self%orbit%value = request%start
   end subroutine prepare

   !> Restores the state of a stored curve at its last point, a step.
   subroutine impact_curve_continue_from(self, model, document, request, stored, error)
      class(impact_curve_t), intent(inout), target :: self
      type(model_t), intent(in) :: model
      type(document_t), intent(in) :: document
      type(curve_request_t), intent(in) :: request
      type(curve_position_t), intent(in) :: stored(:)                 !! all points up to the one to continue from
      type(error_t), allocatable, intent(out) :: error
      type(motion_series_t) :: motion
      integer :: n

      associate (first => stored(1)%unknowns, last => stored(size(stored)))
         n = (size(last%unknowns) - 2)/2
         call new_motion_series(motion, reshape([1], [1, 1]), model%tones%omega, &
                                reshape(cmplx(last%unknowns(n + 1:n + model%structure%n_dofs), 0.0_wp, wp), &
                                        [model%structure%n_dofs, 1]))
         call prepare(self, model, document, request, motion, error)
         if (allocated(error)) return
         self%orbit%map%scale = last%unknowns(n + 1:2*n)
         self%first_x = [first(:n), first(2*n + 2)]
         self%first_section = first(2*n + 1)
         self%way = merge(2, 1, last%length < 0.0_wp)
         call self%start_branch(error)
         if (allocated(error)) return
         self%orbit%section = last%unknowns(2*n + 1)
         self%curve%x = [last%unknowns(:n), last%unknowns(2*n + 2)]
         self%curve%direction = [last%direction(:n), last%direction(2*n + 2)]
         self%curve%step = last%step
         self%curve%orientation = last%orientation
         self%largest = last%largest_motion
         self%length = abs(last%length)
      end associate
      self%n_reported = size(stored)
      call self%renew()
      call self%evaluate_here(self%known)
      self%is_done = self%n_reported >= request%n_points
   end subroutine impact_curve_continue_from

   !> Places the curve at its start, in the direction of this branch.
   subroutine impact_curve_start_branch(self, error)
      class(impact_curve_t), intent(inout), target :: self
      type(error_t), allocatable, intent(out) :: error
      type(bordered_problem_t) :: bordered
      type(curve_config_t) :: config
      type(solver_config_t) :: corrector
      real(wp) :: ahead, direction(size(self%first_x)), units(size(self%first_x))

      associate (x => self%first_x, request => self%request)
         self%length = 0.0_wp
         self%reported = [reported_extreme_t ::]
         self%largest = 0.0_wp
         self%orbit%section = self%first_section
         direction = 0.0_wp
         ahead = request%to - request%start
         if (.not. abs(ahead) > 0.0_wp) ahead = request%from - request%to
         direction(size(x)) = sign(1.0_wp, ahead)*self%sense()
         call new_bordered_problem(bordered, self%orbit, [1], reshape(direction, [size(x), 1]), [0.0_wp])
         corrector%tolerance = accurate
         corrector%max_iterations = most_corrections
         corrector%line_search = .false.
         config%longest_step = request%longest_step
         config%first_step = 0.1_wp*request%longest_step
         config%shortest_step = 1.0e-4_wp*request%longest_step        ! the period map has no derivative at a graze
         config%angle = 0.12_wp
         config%growth = 2.0_wp
         self%curve%x = x
         call self%renew()
         units = self%curve%units
         call new_curve(self%curve, bordered, x, direction, units, config, corrector)
         self%start%x = x
         self%start%direction = self%curve%direction
         call self%evaluate_here(self%known)
      end associate
   end subroutine impact_curve_start_branch

   !> Performs one step, and appends the events on it and its end to the waiting points.
   subroutine impact_curve_go(self, error)
      class(impact_curve_t), intent(inout), target :: self
      type(error_t), allocatable, intent(out) :: error
      type(known_t) :: known
      integer :: n_branch_points

      if (allocated(self%problem%error_text)) deallocate (self%problem%error_text)
      call move_section(self)
      self%waiting = [waiting_t ::]
      self%first_waiting = 1
      associate (curve => self%curve)
         do
            n_branch_points = curve%n_branch_points
            call curve%advance()
            if (curve%status == outcome%stalled) call try_end(self)
            if (curve%status /= outcome%pending .or. size(self%waiting) > 0) exit
            call self%renew()
            call curve%turn()
            if (curve%angle <= largest_turn .or. curve%last_step <= short*curve%config%longest_step) then
               call find_events(self, known, curve%n_branch_points > n_branch_points)
               self%known = known
               return
            end if
            call curve%retreat()
         end do
      end associate
      if (allocated(self%orbit%error_text)) self%problem%error_text = self%orbit%error_text
      if (self%curve%status == outcome%stalled .and. grazes_ahead(self)) &
         self%problem%error_text = "a wall is grazed, and the number of impacts changes"
      self%problem%refused = self%curve%x(size(self%curve%x))
   end subroutine impact_curve_go

   !> Whether a wall is struck a different number of times shortly behind the point of the curve.
   logical function grazes_ahead(self)
      class(impact_curve_t), intent(inout), target :: self
      real(wp) :: r(self%orbit%n_unknowns)
      integer :: i
      logical :: is_possible

      grazes_ahead = .false.
      do i = 1, 4
         associate (x => self%curve%x + 0.25_wp*i*self%request%longest_step*self%curve%direction)
            call self%orbit%set_parameters([1], x(size(x):), is_possible)
            if (.not. is_possible) exit
            call self%orbit%residual(x(:size(x) - 1), r)
         end associate
         grazes_ahead = grazes_ahead .or. any(self%orbit%impacts /= self%impacts)
      end do
   end function grazes_ahead

   !> Moves the section of the map, and the curve with it, away from impacts.
   subroutine move_section(self)
      class(impact_curve_t), intent(inout), target :: self
      real(wp), allocatable :: start(:), start_direction(:)
      real(wp) :: old, section
      integer :: n
      logical :: is_done

      n = self%orbit%n_unknowns
      associate (curve => self%curve, orbit => self%orbit)
         call orbit%set_parameters([1], self%start%x(n + 1:), is_done)
         old = orbit%section
         start = self%start%x(:n)
         start_direction = self%start%direction(:n)
         call orbit%set_parameters([1], curve%x(n + 1:), is_done)
         section = orbit%better_section(curve%x(:n))
         if (abs(section - old) <= 0.0_wp) return
         call orbit%set_parameters([1], self%start%x(n + 1:), is_done)
         call orbit%move_section(section, start, start_direction, self%start%direction(n + 1), is_done)
         if (is_done) then
            self%start%x(:n) = start
            self%start%direction(:n) = start_direction
         end if
         orbit%section = old
         call orbit%set_parameters([1], curve%x(n + 1:), is_done)
         call orbit%move_section(section, curve%x(:n), curve%direction(:n), curve%direction(n + 1), is_done)
         curve%orientation = 0.0_wp
         call self%renew()
         curve%direction = curve%direction/norm2(curve%direction/curve%units)
      end associate
   end subroutine move_section

   !> Finds folds, branch points, grazes, bifurcations, wanted values and ends on the completed step, and lists
   !> them in their order.
   subroutine find_events(self, known, has_branched)
      class(impact_curve_t), intent(inout), target :: self
      type(known_t), intent(out) :: known                             !! at the end of the step
      logical, intent(in) :: has_branched                             !! a branch point was passed
      type(search_t) :: search
      type(orbit_event_t) :: event
      type(stability_t) :: there
      integer, allocatable :: before(:)
      real(wp) :: values(2)
      integer :: i
      logical :: is_found

      before = self%impacts
      call self%evaluate_here(known)
      search%known = known
      associate (curve => self%curve)
         call find_fold(self, search)
         if (has_branched) call find(self, search, branch_event_t(curve_kind%branch, .true.), [-1.0_wp, 1.0_wp]*curve%orientation, &
                                     is_found)
         event%tolerance = 10.0_wp*accurate
         event%orbit => self%orbit
         if (any(before /= self%impacts)) then
            event%kind = curve_kind%graze
            event%may_jump = .true.
            event%impacts = before
            call find(self, search, event, [1.0_wp, -1.0_wp], is_found)
            deallocate (event%impacts)
         end if
         event%may_jump = .false.
         do i = bifurcation%doubling, bifurcation%torus
            event%kind = merge(curve_kind%flip, curve_kind%torus, i == bifurcation%doubling)
            event%bifurcation = i
            values = [bifurcation_value(i, self%known%stability%multipliers), bifurcation_value(i, known%stability%multipliers)]
            if (.not. product(values) < 0.0_wp) cycle
            call find(self, search, event, values, is_found)
            if (.not. is_found .or. i == bifurcation%doubling) cycle
            associate (x => self%waiting(size(self%waiting))%x)
               there = stability_at(self%orbit, x)
            end associate
            if (.not. is_torus(there%multipliers)) self%waiting = self%waiting(:size(self%waiting) - 1)
         end do
         call find_values(self, search)
         self%is_closed = is_back(self)
         if (self%is_closed) call add(self, curve_kind%end, curve%last_step, self%start%x)
         call add(self, curve_kind%regular, curve%last_step, curve%x)
      end associate
      call sort_by_position(self%waiting)
      call self%renew()
   end subroutine find_events

   !> Stability of the motion at a point of the curve.
   type(stability_t) function stability_at(orbit, x) result(stability)
      type(impact_orbit_t), intent(inout) :: orbit
      real(wp), intent(in) :: x(:)
      logical :: is_possible

      call orbit%set_parameters([1], x(orbit%n_unknowns + 1:), is_possible)
      stability = orbit%stability(x(:orbit%n_unknowns))
   end function stability_at

   real(wp) function orbit_event_value(self, curve, x) result(value)
      class(orbit_event_t), intent(inout) :: self
      class(curve_t), intent(inout) :: curve
      real(wp), intent(in) :: x(:)
      type(stability_t) :: there
      real(wp) :: r(self%orbit%n_unknowns)
      logical :: is_possible

      associate (n => self%orbit%n_unknowns)
         if (allocated(self%impacts)) then
            call self%orbit%set_parameters([1], x(n + 1:), is_possible)
            call self%orbit%residual(x(:n), r)
            value = merge(1.0_wp, -1.0_wp, all(self%orbit%impacts == self%impacts))
         else
            there = stability_at(self%orbit, x)
            value = bifurcation_value(self%bifurcation, there%multipliers)
         end if
      end associate
   end function orbit_event_value

   !> Computes the result of one of the waiting points, with its position on the curve.
   subroutine impact_curve_report(self, i, result, error)
      class(impact_curve_t), intent(inout), target :: self
      integer, intent(in) :: i
      type(motion_result_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error
      type(curve_position_t) :: place
      integer :: n

      n = self%orbit%n_unknowns
      associate (point => self%waiting(i))
         call describe(self, point%x, result, error)
         if (allocated(error)) return
         place%kind = point%kind
         place%parameter = point%x(n + 1)
         place%length = self%sense()*(self%length + point%place)
         place%unknowns = [point%x(:n), self%orbit%map%scale, self%orbit%section, point%x(n + 1)]
         if (any(point%kind == [curve_kind%regular, curve_kind%start])) then
            self%length = self%length + point%place
            place%direction = [self%curve%direction(:n), spread(0.0_wp, 1, n + 1), self%curve%direction(n + 1)]
            place%step = self%curve%step
            place%orientation = self%curve%orientation
            place%largest_motion = self%largest
         else if (any(point%kind == [curve_kind%flip, curve_kind%torus])) then
            if (allocated(result%stability%multipliers)) place%angle = angle_of_pair(result%stability%multipliers)
         end if
         if (self%model%accuracy%is_on) then
            place%tuples = result%harmonics%tuples
            place%n_samples = result%n_samples
         end if
         result%curve = place
      end associate
   end subroutine impact_curve_report

   !> Computes the results of a motion of the curve.
   subroutine describe(self, x, result, error)
      class(impact_curve_t), intent(inout), target :: self
      real(wp), intent(in) :: x(:)
      type(motion_result_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error
      type(coordinates_t) :: coordinates
      type(harmonics_t) :: set
      type(level_t) :: found
      type(model_t) :: here
      type(motion_result_t) :: fresh
      type(steady_motion_t) :: settled
      real(wp) :: r(self%orbit%n_unknowns)
      logical :: is_done

      associate (orbit => self%orbit, n => self%orbit%n_unknowns, accuracy => self%model%accuracy)
         call orbit%set_parameters([1], x(n + 1:), is_done)
         call orbit%residual(x(:n), r)
         fresh%residual = orbit%norm(r)
         fresh%n_unknowns = n
         here = orbit%model
         coordinates = coordinates_of(here)
         if (accuracy%is_on) then
            call new_lowest_set(set, 1, loaded_tuples(orbit%model), error, &
                                min(most_candidates, max(16, ceiling(4.0_wp*accuracy%tolerance**(-2.0_wp/3.0_wp)))))
            if (allocated(error)) return
            call put_on_set(here, orbit%model, set)
            here%integration%aim = accuracy%tolerance
         end if
         call orbit%describe(here, coordinates, x(:n), settled, is_done)
         settled%status = outcome%time_domain
         fresh%status = outcome%failed
         if (is_done) then
            if (accuracy%is_on) then
               call keep_lines(here, coordinates, share_of_integrated*accuracy%max_harmonics, settled, fresh, found)
            else
               call keep_integrated(here, coordinates, settled, fresh)
            end if
            fresh%status = settled%status
            if (accuracy%is_on) fresh%status = status_within(self%model, settled, fresh)
         end if
         result = fresh
      end associate
   end subroutine describe

   !> Updates the units of length at the present point.
   subroutine impact_curve_renew(self)
      class(impact_curve_t), intent(inout), target :: self

      associate (curve => self%curve, n => self%orbit%n_unknowns)
         self%largest = max(self%largest, norm2(curve%x(:n)))
         curve%units = [spread(self%largest, 1, n), self%orbit%parameter_scales([1])]
      end associate
   end subroutine impact_curve_renew

   !> Computes the quantities at the point of the curve that events compare.
   subroutine impact_curve_evaluate_here(self, known)
      class(impact_curve_t), intent(inout), target :: self
      type(known_t), intent(out) :: known
      real(wp) :: r(self%orbit%n_unknowns)

      known%rise = self%curve%direction(size(self%curve%x))
      known%stability = stability_at(self%orbit, self%curve%x)
      call self%orbit%residual(self%curve%x(:self%orbit%n_unknowns), r)
      self%impacts = self%orbit%impacts
   end subroutine impact_curve_evaluate_here

   !> Frees the equations of motion; safe to call twice.
   subroutine impact_curve_destroy(self)
      class(impact_curve_t), intent(inout) :: self

      call self%orbit%destroy()
   end subroutine impact_curve_destroy
end module hb_impact_curve
