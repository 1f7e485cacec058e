!> A curve of periodic motions with impacts on rigid walls: the state of the period map (hb_impact_orbit) is followed
!> along a value of the input, through folds and along stable and unstable motions alike.
!>
!> Steps and events are those of other curves (hb_curve_step), with the multipliers of the map. At a graze the number of
!> impacts in a period changes, and the curve has a corner. The unknowns are the state, scaled, and the value; stored with
!> them are the scales and the section.
module hb_impact_curve
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_bordered, only: bordered_problem_t, new_bordered_problem, plane_t
   use hb_cancellation, only: verdict, verdict_on_work
   use hb_coordinates, only: coordinates_t
   use hb_curve, only: curve_config_t, new_curve
   use hb_curve_events, only: event_values_t
   use hb_curve_points, only: add_waiting, origin_t, waiting_t
   use hb_curve_request, only: curve_request_t
   use hb_curve_step, only: longest_chord, step
   use hb_discretisation, only: discretisation_t
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t
   use hb_impact_gradient, only: store_slopes
   use hb_impact_orbit, only: accurate, impact_orbit_t, motion_slopes_t, new_impact_orbit
   use hb_integrate_to_tolerance, only: loaded_tuples, status_within, store_lines
   use hb_integrated_result, only: store_integrated
   use hb_kinds, only: wp
   use hb_level, only: level_t, set_to_harmonics
   use hb_located_response, only: located_response_t, response_series_t
   use hb_model, only: model_t
   use hb_motion_curve, only: motion_curve_continue_from, motion_curve_start_branch, motion_curve_t
   use hb_motion_result, only: curve_position_t, motion_result_t
   use hb_motion_ridge, only: new_motion_curve
   use hb_motion_series, only: motion_series_t, new_motion_series
   use hb_newton, only: solve_newton
   use hb_options, only: options_t, share_of_integrated
   use hb_outcome, only: is_solved, outcome
   use hb_point, only: solve_point
   use hb_point_kinds, only: curve_kind, curve_kinds, located_by
   use hb_solver_types, only: report_t, solver_config_t
   use hb_stability, only: stability_t
   use hb_steady_motion, only: steady_motion_t
   use hb_system, only: coordinates_of, system_t
   use hb_tangent_solver, only: find_null_vector
   use hb_thresholds, only: faint
   use hb_tuple_choice, only: new_lowest_set
   implicit none
   private
   public :: impact_curve_t, new_curve_of

   integer, parameter :: max_corrections = 10
   real(wp), parameter :: usual_distance = 1.0e-3_wp                  ! of differences for slopes of responses [lengths]
   real(wp), parameter :: nearest = 1.0e-6_wp                         ! to a graze, in units of lengths: differences need 1e-8
   integer, parameter :: max_candidates = 512                        ! order of the harmonics of a point with a tolerance

   !> Owns external resources: call `destroy`. A variable of this type needs the attribute `target`.
   type, extends(motion_curve_t) :: impact_curve_t
      type(impact_orbit_t) :: orbit
      type(harmonics_t), private :: set                               ! of the points and responses
      real(wp), private :: first_section = 0.0_wp                     ! that of the first motion
   contains
      procedure :: begin => impact_curve_begin
      procedure :: continue_from => impact_curve_continue_from
      procedure :: start_branch => impact_curve_start_branch
      procedure :: make_step => impact_curve_make_step
      procedure :: adopt_level => impact_curve_adopt_level
      procedure :: find_roughness => impact_curve_find_roughness
      procedure :: border => impact_curve_border
      procedure :: make_curve => impact_curve_make_curve
      procedure :: prepare_step => impact_curve_prepare_step
      procedure :: transfer_start => impact_curve_transfer_start
      procedure :: update_units => impact_curve_update_units
      procedure :: slope_at => impact_curve_slope_at
      procedure :: find_series => impact_curve_find_series
      procedure :: find_stability => impact_curve_find_stability
      procedure :: find_contact => impact_curve_find_contact
      procedure :: plane_at => impact_curve_plane_at
      procedure :: describe => impact_curve_describe
      procedure :: system_at => impact_curve_system_at
      procedure :: pack => impact_curve_pack
      procedure, private :: impacts_at => impact_curve_impacts_at
      procedure, private :: defect => impact_curve_defect
      procedure :: destroy => impact_curve_destroy
   end type impact_curve_t

   ! Grazes; bodies in hb_impact_curve_grazing
   interface
      module subroutine pass_grazing(self, is_stalled, points, is_passed)
         class(impact_curve_t), intent(inout), target :: self
         logical, intent(in) :: is_stalled                               !! after a step that failed
         type(waiting_t), allocatable, intent(inout) :: points(:)        !! if it is passed: those of the step
         logical, intent(out) :: is_passed
      end subroutine pass_grazing

      module subroutine end_at_grazing(self, points)
         class(impact_curve_t), intent(inout), target :: self
         type(waiting_t), allocatable, intent(inout) :: points(:)
      end subroutine end_at_grazing

      module function grazes_ahead(self) result(grazes)
         class(impact_curve_t), intent(inout), target :: self
         logical :: grazes
      end function grazes_ahead
   end interface

contains

   !> Creates the curve of a model: of impacts if walls have a restitution, otherwise of balances.
   subroutine new_curve_of(self, system, options, request)
      class(motion_curve_t), allocatable, intent(out) :: self
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(curve_request_t), intent(in) :: request

      if (options%lacks_impacts_of(system, outcome%impact)) then
         allocate (impact_curve_t :: self)
      else
         call new_motion_curve(self, request)
      end if
   end subroutine new_curve_of

   !> Solves the first motion by all methods of a point, and the period map from there.
   subroutine impact_curve_begin(self, model, request, result, error)
      class(impact_curve_t), intent(inout), target :: self
      type(model_t), intent(inout) :: model                           !! at the start
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

      if (allocated(request%origin)) then
         call begin_at_origin(self, model, request, result, error)
         return
      end if
      whole = model
      whole%options%output%dofs = [(i, i=1, model%system%structure%n_dofs)]
      whole%options%chain%is_on = .false.
      call solve_point(whole, result, error, level)
      self%is_done = allocated(error) .or. .not. (is_solved(result%status) .and. allocated(result%coefficients))
      if (self%is_done) return
      set = model%discretisation%harmonics
      if (model%options%accuracy%is_on) set = result%harmonics
      call new_motion_series(motion, set%tuples, model%system%tones%omega, &
                             transpose(cmplx(result%coefficients(1, :, :), -result%coefficients(2, :, :), wp)))
      call new_impact_orbit(self%orbit, model%system, model%discretisation, model%options, motion, error)
      self%is_done = allocated(error)
      if (self%is_done) return
      call self%orbit%move(request%moving, request%start)
      allocate (x, source=self%orbit%map%state_at(self%orbit%section*self%orbit%period()))
      call solve_newton(self%orbit, solver_config_t(tolerance=accurate, max_iterations=3*max_corrections), x, report)
      self%is_done = report%status /= outcome%converged
      if (self%is_done) then
         result%status = outcome%stalled
         result%message = "the period map has no periodic motion near the one found; "//result%message
         return
      end if
      self%first_section = self%orbit%section
      self%request = request
      call self%prepare(model%system, model%discretisation, model%options, [request%start], level_t(), error)
      self%first%x = [x, request%start]
      call self%report_start(result, error)
   end subroutine impact_curve_begin

   !> Begins where the period of another curve doubles, a short distance along the direction of the multiplier -1. The section is
   !> that of the other curve, which is half as far in the period of this one.
   subroutine begin_at_origin(self, model, request, result, error)
      class(impact_curve_t), intent(inout), target :: self
      type(model_t), intent(inout) :: model                           !! at the start
      type(curve_request_t), intent(in) :: request
      type(motion_result_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error
      real(wp), parameter :: parts(5) = [0.02_wp, 0.005_wp, 0.1_wp, 0.001_wp, 0.3_wp]   ! of the motion: departure from it
      real(wp), allocatable :: across(:), direction(:), from(:), x(:)
      type(report_t) :: report
      integer :: i
      logical :: is_found

      self%request = request
      associate (packed => request%origin%u(:, 1), n => (size(request%origin%u, 1) - 2)/2, orbit => self%orbit)
         call build_orbit(self, model, request, packed(n + 1:2*n), error)
         self%is_done = allocated(error)
         if (self%is_done) return
         from = unpacked(packed)
         call orbit%set_section(0.5_wp*packed(2*n + 1))
         self%first_section = orbit%section
         call self%prepare(model%system, model%discretisation, model%options, request%origin%further, level_t(), error)
         call orbit%set_parameters([1], from(n + 1:), is_found)
         allocate (across(n))
         if (is_found) call find_null_vector(orbit, from(:n), spread(1.0_wp, 1, n), spread(.true., 1, n), spread(0.0_wp, 1, n), &
                                             across, is_found)
         self%is_done = allocated(error) .or. .not. is_found
         if (allocated(error)) return
         direction = [across, 0.0_wp]
         if (is_found) call self%make_curve(from, direction)
         do i = 1, merge(size(parts), 0, is_found)
            x = from + parts(i)*norm2(from(:n))*direction
            call self%curve%set_plane(x, direction, 0.0_wp)
            call solve_newton(self%curve%problem, self%curve%corrector, x, report)
            is_found = report%status == outcome%converged .and. &
                       norm2((x - from)/self%curve%units) <= longest_chord*parts(i)*norm2(from(:n))/self%curve%largest
            if (is_found) exit
         end do
      end associate
      self%is_done = .not. is_found
      if (self%is_done) then
         result%status = outcome%stalled
         result%message = "no bifurcating motion was found near the bifurcation point"
         return
      end if
      self%first%x = x
      self%first%direction = direction
      call self%report_start(result, error)
   end subroutine begin_at_origin

   !> Creates the orbit of a stored curve, with its scales.
   subroutine build_orbit(self, model, request, scale, error)
      class(impact_curve_t), intent(inout), target :: self
      type(model_t), intent(in) :: model
      type(curve_request_t), intent(in) :: request
      real(wp), intent(in) :: scale(:)
      type(error_t), allocatable, intent(out) :: error
      type(motion_series_t) :: motion

      associate (n_dofs => model%system%structure%n_dofs)
         call new_motion_series(motion, reshape([1], [1, 1]), model%system%tones%omega, &
                                cmplx(reshape(scale(:n_dofs), [n_dofs, 1]), kind=wp))
      end associate
      call new_impact_orbit(self%orbit, model%system, model%discretisation, model%options, motion, error)
      if (allocated(error)) return
      call self%orbit%move(request%moving, request%start)
      self%orbit%map%scale = scale
   end subroutine build_orbit

   !> Restores the state of a stored curve at its last point, a step.
   subroutine impact_curve_continue_from(self, model, request, stored, error)
      class(impact_curve_t), intent(inout), target :: self
      type(model_t), intent(in) :: model
      type(curve_request_t), intent(in) :: request
      type(curve_position_t), intent(in) :: stored(:)                 !! all points up to the one to continue from
      type(error_t), allocatable, intent(out) :: error
      type(curve_position_t) :: bare(size(stored))
      integer :: i, n

      associate (last => stored(size(stored))%unknowns)
         n = (size(last) - 2)/2
         call build_orbit(self, model, request, last(n + 1:2*n), error)
         if (allocated(error)) return
         self%first_section = stored(1)%unknowns(2*n + 1)
         bare = stored
         do i = 1, size(stored)
            if (stored(i)%kind == curve_kind%branch) cycle            ! the origin of another branch, `start_branch`
            bare(i)%unknowns = unpacked(stored(i)%unknowns)
            if (allocated(stored(i)%direction)) bare(i)%direction = unpacked(stored(i)%direction)
         end do
         call motion_curve_continue_from(self, model, request, bare, error)
         if (allocated(error)) return
         call self%orbit%set_section(last(2*n + 1))
      end associate
      call self%evaluate_here(self%at_point)
   end subroutine impact_curve_continue_from

   !> The system at a point that was reported, to which the orbit moves its own.
   function impact_curve_system_at(self, position) result(system)
      class(impact_curve_t), intent(inout), target :: self
      type(curve_position_t), intent(in) :: position
      type(system_t), pointer :: system
      logical :: is_possible                                          ! it was there before

      call self%orbit%set_parameters([1], [position%parameter], is_possible)
      system => self%orbit%model%system
   end function impact_curve_system_at

   !> The state with its scales and the section, and the value.
   pure function impact_curve_pack(self, x) result(packed)
      class(impact_curve_t), intent(in) :: self
      real(wp), intent(in) :: x(:)
      real(wp), allocatable :: packed(:)

      packed = [x(:size(x) - 1), self%orbit%map%scale, self%orbit%section, x(size(x))]
   end function impact_curve_pack

   !> The state, and the value, of what `pack` has packed.
   pure function unpacked(packed) result(x)
      real(wp), intent(in) :: packed(:)
      real(wp), allocatable :: x(:)

      associate (n => (size(packed) - 2)/2)
         x = [packed(:n), packed(2*n + 2)]
      end associate
   end function unpacked

   !> The section of the first motion is that of the start, that of another branch the one stored with its origin.
   subroutine impact_curve_start_branch(self, error)
      class(impact_curve_t), intent(inout), target :: self
      type(error_t), allocatable, intent(out) :: error
      type(origin_t) :: packed

      if (self%branch == 0) then
         call self%orbit%set_section(self%first_section)
         call motion_curve_start_branch(self, error)
         return
      end if
      associate (origin => self%origins(self%branch), n => self%orbit%n_unknowns)
         packed = origin
         call self%orbit%set_section(origin%x(2*n + 1))
         origin%x = unpacked(packed%x)
         origin%direction = unpacked(packed%direction)
         call motion_curve_start_branch(self, error)
         origin = packed
      end associate
   end subroutine impact_curve_start_branch

   !> A state has no set; that of the points contains all candidates for a tolerance.
   subroutine impact_curve_adopt_level(self, level, error)
      class(impact_curve_t), intent(inout), target :: self
      type(level_t), intent(in) :: level
      type(error_t), allocatable, intent(out) :: error

      self%level = level
      if (allocated(self%model%options%gradient%by)) deallocate (self%model%options%gradient%by)
      allocate (self%model%options%gradient%by(0))                    ! `describe` finds them, from the orbit
      self%set = self%model%discretisation%harmonics
      associate (accuracy => self%model%options%accuracy)
         if (accuracy%is_on) call new_lowest_set(self%set, 1, loaded_tuples(self%model%discretisation), error, &
            min(max_candidates, max(16, ceiling(4.0_wp*accuracy%tolerance**(-2.0_wp/3.0_wp)))))
      end associate
   end subroutine impact_curve_adopt_level

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

   !> Assigns to the curve its problem, with a given functional.
   subroutine impact_curve_border(self, functional)
      class(impact_curve_t), intent(inout), target :: self
      real(wp), intent(in) :: functional(:)

      call new_bordered_problem(self%curve%problem, self%orbit, [1], reshape(functional, [size(functional), 1]), [0.0_wp])
   end subroutine impact_curve_border

   !> Sets up the curve at one of its points.
   subroutine impact_curve_make_curve(self, x, direction)
      class(impact_curve_t), intent(inout), target :: self
      real(wp), intent(in) :: x(:), direction(:)
      type(bordered_problem_t) :: bordered
      type(curve_config_t) :: config
      type(solver_config_t) :: corrector
      real(wp) :: units(size(x))

      call self%border(direction)
      bordered = self%curve%problem
      corrector%tolerance = accurate
      corrector%max_iterations = max_corrections
      corrector%patience = 3
      corrector%line_search = .false.
      config = self%config()
      config%shortest_step = 1.0e-4_wp*config%longest_step            ! the period map has no derivative at a graze
      self%curve%x = x
      call self%update_units()
      units = self%curve%units
      call new_curve(self%curve, bordered, x, direction, units, config, corrector)
   end subroutine impact_curve_make_curve

   !> Performs one step, or passes a graze, before it or where it stalls. A graze at which the curve turns back cannot be located
   !> on a step: it is passed, or the short step begins there.
   subroutine impact_curve_make_step(self, points, error)
      class(impact_curve_t), intent(inout), target :: self
      type(waiting_t), allocatable, intent(out) :: points(:)
      type(error_t), allocatable, intent(out) :: error
      type(waiting_t), allocatable :: first(:)
      integer, allocatable :: before(:)
      logical :: is_passed

      allocate (before, source=self%at_point%impacts)
      call self%orbit%refusal%forget()
      call pass_grazing(self, .false., points, is_passed)
      if (.not. is_passed) call step(self, points)
      if (self%curve%status == outcome%stalled .and. self%at_point%stability%n_unstable > 0) &
         call pass_grazing(self, .true., points, is_passed)
      if (verdict_on_work() == verdict%timed_out) self%curve%status = outcome%timed_out   ! integrations then miss impacts
      if (is_passed) return
      if (self%curve%status == outcome%pending .and. any(before /= self%at_point%impacts) .and. &
          all(points%kind /= curve_kind%grazing)) then
         allocate (first(0))
         call add_waiting(first, curve_kind%grazing, 0.0_wp, self%curve%last%x)
         points = [first, points]
      end if
      self%problem%refusal = self%orbit%refusal
      if (self%curve%status == outcome%stalled .and. grazes_ahead(self)) call end_at_grazing(self, points)
   end subroutine impact_curve_make_step

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
         call move(self%start_on_set%x, self%start_on_set%direction)
         call orbit%set_section(old)
         call move(curve%x, curve%direction)
         curve%orientation = 0.0_wp
         call self%update_units()
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

   !> None: the errors of a motion of the map do not depend on one.
   function impact_curve_plane_at(self, point) result(plane)
      class(impact_curve_t), intent(inout), target :: self
      type(waiting_t), intent(in) :: point
      type(plane_t) :: plane

   end function impact_curve_plane_at

   !> Computes the results of a motion of the curve.
   subroutine impact_curve_describe(self, point, plane, result, error, compares_in_time)
      class(impact_curve_t), intent(inout), target :: self
      type(waiting_t), intent(in) :: point
      type(plane_t), intent(in) :: plane                              !! of no influence
      type(motion_result_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: compares_in_time               !! of no influence: it is integrated
      type(coordinates_t) :: coordinates
      type(discretisation_t) :: here
      type(options_t) :: options
      type(steady_motion_t) :: steady
      integer, allocatable :: positions(:)
      integer :: h
      logical :: is_done

      associate (orbit => self%orbit, n => self%orbit%n_unknowns, accuracy => self%model%options%accuracy)
         result = motion_result_t()
         result%residual = orbit%norm(self%defect(point%x))
         result%n_unknowns = n
         result%status = outcome%failed
         here = orbit%model%discretisation
         options = orbit%model%options
         coordinates = coordinates_of(orbit%model%system)
         if (accuracy%is_on) then
            call set_to_harmonics(here, orbit%model%discretisation, self%set)
            options%integration%aim = accuracy%tolerance
         end if
         call orbit%describe(here, options, coordinates, point%x(:n), steady, is_done)
         steady%status = outcome%integrated
         if (is_done .and. accuracy%is_on) then
            call store_lines(orbit%model%system, here, options, coordinates, share_of_integrated*accuracy%max_harmonics, steady, &
                            result, self%level)
            result%status = status_within(self%model%options, steady, result)
            positions = [(here%harmonics%index_of(result%harmonics%tuples(:, h)), h=1, result%harmonics%n_harmonics)]
            call differentiate(self, point, result%harmonics, steady%amplitudes(:, positions), result)
         else if (is_done) then
            call store_integrated(orbit%model%system, here, options, coordinates, steady, result)
            result%status = steady%status
            call differentiate(self, point, here%harmonics, steady%amplitudes, result)
         end if
         if (verdict_on_work() == verdict%timed_out) result%status = outcome%timed_out
      end associate
   end subroutine impact_curve_describe

   !> Adds the derivatives of a point that stays at its value along the curve, if any are requested.
   subroutine differentiate(self, point, set, c, result)
      class(impact_curve_t), intent(inout), target :: self
      type(waiting_t), intent(in) :: point
      type(harmonics_t), intent(in) :: set                            !! that of the result
      complex(wp), intent(in) :: c(:, :)                              !! amplitudes [m], (n_dofs, n_harmonics)
      type(motion_result_t), intent(inout) :: result
      type(error_t), allocatable :: error
      type(motion_slopes_t) :: slopes

      associate (orbit => self%orbit, n => self%orbit%n_unknowns)
         if (size(orbit%model%options%gradient%by) == 0 .or. curve_kinds(point%kind)%by /= located_by%nothing) return
         call orbit%find_slopes(set, point%x(:n), orbit%model%options%gradient%by, slopes, error)
         call store_slopes(orbit%model, set, slopes, c, result)
      end associate
      if (allocated(error) .and. .not. allocated(result%message)) result%message = "no derivatives: "//error%message
   end subroutine differentiate

   !> Updates the units of length at the present point.
   subroutine impact_curve_update_units(self)
      class(impact_curve_t), intent(inout), target :: self

      associate (curve => self%curve, n => self%orbit%n_unknowns)
         curve%largest = max(faint, curve%largest, norm2(curve%x(:n)))
         curve%units = [spread(curve%largest, 1, n), self%orbit%parameter_scales([1])]
      end associate
   end subroutine impact_curve_update_units

   !> Fourth-order difference, since a motion is integrated from event to event; of motions with the same impacts: near
   !> a graze it is shorter.
   real(wp) function impact_curve_slope_at(self, response, x, direction) result(slope)
      class(impact_curve_t), intent(inout), target :: self
      type(located_response_t), intent(in) :: response
      real(wp), intent(in) :: x(:), direction(:)
      integer, allocatable :: impacts(:)
      real(wp) :: apart

      apart = usual_distance
      allocate (impacts, source=self%impacts_at(x))
      do while (apart > 0.01_wp*nearest)                              ! corners are that near to a graze
         if (all(impacts == self%impacts_at(x + 2.0_wp*apart*direction)) .and. &
             all(impacts == self%impacts_at(x - 2.0_wp*apart*direction))) exit
         apart = 0.5_wp*apart
      end do
      slope = (8.0_wp*change(apart) - change(2.0_wp*apart))/(12.0_wp*apart)

   contains

      real(wp) function change(distance)
         real(wp), intent(in) :: distance

         change = self%square_at(response, x + distance*direction) - self%square_at(response, x - distance*direction)
      end function change
   end function impact_curve_slope_at

   !> The motion of the degree of freedom of a response, to whose point the orbit moves.
   subroutine impact_curve_find_series(self, response, x, series)
      class(impact_curve_t), intent(inout), target :: self
      type(located_response_t), intent(in) :: response
      real(wp), intent(in) :: x(:)
      type(response_series_t), intent(out) :: series
      logical :: is_possible

      call self%orbit%set_parameters([1], x(size(x):), is_possible)
      series%set => self%set
      series%omega = self%orbit%model%system%tones%omega
      series%load = response%largest_load(self%orbit%model%discretisation)
      allocate (series%c(0))
      if (is_possible) series%c = self%orbit%series_of(series%set, response%dof, x(:size(x) - 1))
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
      type(event_values_t), intent(inout) :: known

      known%impacts = self%impacts_at(x)
   end subroutine impact_curve_find_contact

   !> Impacts of each wall in a period, as of a record.
   function impact_curve_impacts_at(self, x) result(impacts)
      class(impact_curve_t), intent(inout), target :: self
      real(wp), intent(in) :: x(:)
      integer, allocatable :: impacts(:)
      real(wp) :: r(self%orbit%n_unknowns)

      r = self%defect(x)
      impacts = self%orbit%impacts
   end function impact_curve_impacts_at

   !> Defect of a motion after a period, NaN if its value is rejected; the orbit counts its impacts.
   function impact_curve_defect(self, x) result(r)
      class(impact_curve_t), intent(inout), target :: self
      real(wp), intent(in) :: x(:)
      real(wp) :: r(self%orbit%n_unknowns)
      logical :: is_possible

      r = ieee_value(1.0_wp, ieee_quiet_nan)
      call self%orbit%set_parameters([1], x(size(x):), is_possible)
      if (is_possible) call self%orbit%residual(x(:size(x) - 1), r)
   end function impact_curve_defect

   !> Frees the equations of motion; safe to call twice.
   subroutine impact_curve_destroy(self)
      class(impact_curve_t), intent(inout) :: self

      call self%orbit%destroy()
      call self%model%discretisation%clear()
   end subroutine impact_curve_destroy
end module hb_impact_curve
