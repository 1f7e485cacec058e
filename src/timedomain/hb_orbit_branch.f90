!> Periodic motions with impacts on rigid walls that are followed along a curve: the state of the period map (hb_impact_orbit) is
!> followed along a value of the input, through folds and along stable and unstable motions alike.
!>
!> Steps and events are those of other curves (hb_curve_step), with the multipliers of the map. At a graze the number of
!> impacts in a period changes, and the curve has a corner. The unknowns are the state, scaled, and the value; stored with
!> them are the scales and the section.
module hb_orbit_branch
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_bordered, only: bordered_problem_t, new_bordered_problem, plane_t
   use hb_cancellation, only: verdict, verdict_on_work
   use hb_coordinates, only: coordinates_t
   use hb_curve, only: curve_config_t, curve_t
   use hb_curve_branches, only: branches_t, origin_t
   use hb_curve_course, only: curve_course_t
   use hb_curve_events, only: event_values_t
   use hb_curve_points, only: add_point, curve_point_t
   use hb_curve_step, only: max_chord, step
   use hb_discretisation, only: discretisation_t
   use hb_error, only: error_t
   use hb_followed, only: followed_t, step_accuracy_t
   use hb_harmonics, only: harmonics_t
   use hb_impact_gradient, only: store_slopes
   use hb_impact_orbit, only: impact_orbit_t, motion_slopes_t, new_impact_orbit, orbit_tolerance
   use hb_integrate_to_tolerance, only: driven_tuples, status_within, store_lines
   use hb_integrated_result, only: store_integrated
   use hb_kinds, only: wp
   use hb_level, only: level_of, level_t
   use hb_located_response, only: located_response_t, response_series_t
   use hb_model, only: model_t
   use hb_motion_result, only: curve_position_t, motion_result_t
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
   use hb_thresholds, only: negligible_share
   use hb_tuple_choice, only: new_lowest_set
   implicit none
   private
   public :: orbit_branch_t

   integer, parameter :: max_corrections = 10
   real(wp), parameter :: difference_of_slopes = 1.0e-3_wp            ! of responses [lengths]
   real(wp), parameter :: min_distance = 1.0e-6_wp                    ! from a graze, in units of lengths: differences need 1e-8
   integer, parameter :: max_candidates = 512                        ! order of the harmonics of a point with a tolerance

   !> Owns external resources: call `destroy`. A variable of this type needs the attribute `target`.
   type, extends(followed_t) :: orbit_branch_t
      type(impact_orbit_t) :: orbit
      type(harmonics_t), private :: set                               ! of the points and responses
   contains
      procedure :: find_first => orbit_branch_find_first
      procedure :: resume => orbit_branch_resume
      procedure :: adopt_level => orbit_branch_adopt_level
      procedure :: pack => orbit_branch_pack
      procedure :: unpack => orbit_branch_unpack
      procedure :: border => orbit_branch_border
      procedure :: config => orbit_branch_config
      procedure :: corrector => orbit_branch_corrector
      procedure :: correct_on_plane => orbit_branch_correct_on_plane
      procedure :: units_at => orbit_branch_units_at
      procedure :: update_units => orbit_branch_update_units
      procedure :: prepare_step => orbit_branch_prepare_step
      procedure :: make_step => orbit_branch_make_step
      procedure :: fault_near => orbit_branch_fault_near
      procedure :: slope_at => orbit_branch_slope_at
      procedure :: find_series => orbit_branch_find_series
      procedure :: find_stability => orbit_branch_find_stability
      procedure :: find_contact => orbit_branch_find_contact
      procedure :: describe => orbit_branch_describe
      procedure :: system_at => orbit_branch_system_at
      procedure, private :: impacts_at => orbit_branch_impacts_at
      procedure, private :: defect => orbit_branch_defect
      procedure :: destroy => orbit_branch_destroy
   end type orbit_branch_t

   ! Grazes; bodies in hb_orbit_branch_grazing
   interface
      module subroutine pass_grazing(self, curve, at_point, branches, is_stalled, points, is_passed)
         class(orbit_branch_t), intent(inout), target :: self
         type(curve_t), intent(inout) :: curve
         type(event_values_t), intent(inout) :: at_point
         type(branches_t), intent(inout) :: branches
         logical, intent(in) :: is_stalled                               !! after a step that failed
         type(curve_point_t), allocatable, intent(inout) :: points(:)    !! if it is passed: those of the step
         logical, intent(out) :: is_passed
      end subroutine pass_grazing

      module subroutine end_at_grazing(self, curve, at_point, points)
         class(orbit_branch_t), intent(inout), target :: self
         type(curve_t), intent(inout) :: curve
         type(event_values_t), intent(in) :: at_point
         type(curve_point_t), allocatable, intent(inout) :: points(:)
      end subroutine end_at_grazing

      module subroutine add_graze(points, position, x)
         type(curve_point_t), allocatable, intent(inout) :: points(:)
         real(wp), intent(in) :: position, x(:)
      end subroutine add_graze

      module function grazes_ahead(self, curve, at_point) result(grazes)
         class(orbit_branch_t), intent(inout), target :: self
         type(curve_t), intent(in) :: curve
         type(event_values_t), intent(in) :: at_point
         logical :: grazes
      end function grazes_ahead
   end interface

contains

   ! Start

   !> Finds the first motion by all methods of a point, and the period map from there.
   subroutine orbit_branch_find_first(self, model, first, result, is_described, error)
      class(orbit_branch_t), intent(inout), target :: self
      type(model_t), intent(inout) :: model
      type(origin_t), intent(out) :: first
      type(motion_result_t), intent(inout) :: result
      logical, intent(out) :: is_described
      type(error_t), allocatable, intent(out) :: error
      type(level_t) :: level
      type(model_t) :: whole
      type(motion_series_t) :: motion
      type(report_t) :: report
      type(harmonics_t) :: set
      real(wp), allocatable :: x(:)
      integer :: i

      is_described = .false.
      if (allocated(self%request%origin)) then
         call find_at_origin(self, model, first, result, error)
         return
      end if
      whole = model
      whole%options%output%dofs = [(i, i=1, model%system%structure%n_dofs)]
      whole%options%chain%is_on = .false.
      call solve_point(whole, result, error, level)
      if (allocated(error) .or. .not. (is_solved(result%status) .and. allocated(result%coefficients))) return
      set = model%discretisation%harmonics
      if (model%options%accuracy%is_on) set = result%harmonics
      call new_motion_series(motion, set%tuples, model%system%tones%omega, &
                             transpose(cmplx(result%coefficients(1, :, :), -result%coefficients(2, :, :), wp)))
      call new_impact_orbit(self%orbit, model%system, model%discretisation, model%options, motion, error)
      if (allocated(error)) return
      call self%orbit%move(self%request%moving, self%request%start)
      allocate (x, source=self%orbit%map%state_at(self%orbit%section*self%orbit%period()))
      call solve_newton(self%orbit, solver_config_t(tolerance=orbit_tolerance, max_iterations=3*max_corrections), x, report)
      if (report%status /= outcome%converged) then
         result%status = outcome%stalled
         result%message = "the period map has no periodic motion near the one found; "//result%message
         return
      end if
      call self%prepare(model%system, model%discretisation, model%options, level_t(), error)
      if (.not. allocated(error)) first%x = self%pack([x, self%request%start])
   end subroutine orbit_branch_find_first

   !> Begins where the period of another curve doubles, a short distance along the direction of the multiplier -1. The section is
   !> that of the other curve, which is half as far in the period of this one.
   subroutine find_at_origin(self, model, first, result, error)
      class(orbit_branch_t), intent(inout), target :: self
      type(model_t), intent(in) :: model
      type(origin_t), intent(inout) :: first
      type(motion_result_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error
      real(wp), parameter :: departure_shares(5) = [0.02_wp, 0.005_wp, 0.1_wp, 0.001_wp, 0.3_wp] ! of the motion: departure from it
      type(curve_t) :: curve
      real(wp), allocatable :: across(:), direction(:), from(:), x(:)
      type(report_t) :: report
      integer :: i
      logical :: is_found

      associate (packed => self%request%origin%u(:, 1), n => (size(self%request%origin%u, 1) - 2)/2, orbit => self%orbit)
         call build_orbit(self, model, packed(n + 1:2*n), error)
         if (allocated(error)) return
         from = without_section(packed)
         call orbit%set_section(0.5_wp*packed(2*n + 1))
         call self%prepare(model%system, model%discretisation, model%options, level_t(), error)
         call orbit%set_parameters([1], from(n + 1:), is_found)
         allocate (across(n))
         if (is_found) call find_null_vector(orbit, from(:n), spread(1.0_wp, 1, n), spread(.true., 1, n), spread(0.0_wp, 1, n), &
                                             across, is_found)
         if (allocated(error)) return
         if (is_found) then
            direction = [across, 0.0_wp]
            call self%begin_curve(curve, from, direction)
            do i = 1, size(departure_shares)
               x = from + departure_shares(i)*norm2(from(:n))*direction
               call curve%set_plane(x, direction, 0.0_wp)
               call solve_newton(curve%problem, curve%corrector, x, report)
               is_found = report%status == outcome%converged .and. &
                          norm2((x - from)/curve%units) <= max_chord*departure_shares(i)*norm2(from(:n))/curve%largest
               if (is_found) exit
            end do
         end if
      end associate
      if (.not. is_found) then
         result%status = outcome%stalled
         result%message = "no bifurcating motion was found near the bifurcation point"
         return
      end if
      first%x = self%pack(x)
      first%direction = self%pack(direction)
   end subroutine find_at_origin

   !> Creates the orbit of a stored curve, with its scales.
   subroutine build_orbit(self, model, scale, error)
      class(orbit_branch_t), intent(inout), target :: self
      type(model_t), intent(in) :: model
      real(wp), intent(in) :: scale(:)
      type(error_t), allocatable, intent(out) :: error
      type(motion_series_t) :: motion

      associate (n_dofs => model%system%structure%n_dofs)
         call new_motion_series(motion, reshape([1], [1, 1]), model%system%tones%omega, &
                                cmplx(reshape(scale(:n_dofs), [n_dofs, 1]), kind=wp))
      end associate
      call new_impact_orbit(self%orbit, model%system, model%discretisation, model%options, motion, error)
      if (allocated(error)) return
      call self%orbit%move(self%request%moving, self%request%start)
      self%orbit%map%scale = scale
   end subroutine build_orbit

   !> Prepares the orbit of a stored curve.
   subroutine orbit_branch_resume(self, model, stored, error)
      class(orbit_branch_t), intent(inout), target :: self
      type(model_t), intent(in) :: model
      type(curve_position_t), intent(in) :: stored(:)
      type(error_t), allocatable, intent(out) :: error

      associate (last => stored(size(stored))%unknowns)
         call build_orbit(self, model, last((size(last) - 2)/2 + 1:size(last) - 2), error)
      end associate
      if (.not. allocated(error)) call self%prepare(model%system, model%discretisation, model%options, &
                                                    level_of(model%discretisation, stored(1)), error)
   end subroutine orbit_branch_resume

   !> A state has no set; that of the points contains all candidates for a tolerance.
   subroutine orbit_branch_adopt_level(self, level, error)
      class(orbit_branch_t), intent(inout), target :: self
      type(level_t), intent(in) :: level
      type(error_t), allocatable, intent(out) :: error

      self%level = level
      if (allocated(self%model%options%gradient%by)) deallocate (self%model%options%gradient%by)
      allocate (self%model%options%gradient%by(0))                    ! `describe` finds them, from the orbit
      self%set = self%model%discretisation%harmonics
      associate (accuracy => self%model%options%accuracy)
         if (accuracy%is_on) call new_lowest_set(self%set, 1, driven_tuples(self%model%system, self%model%options), error, &
            min(max_candidates, max(16, ceiling(4.0_wp*accuracy%tolerance**(-2.0_wp/3.0_wp)))))
      end associate
   end subroutine orbit_branch_adopt_level

   !> The state with its scales and the section, and the value.
   pure function orbit_branch_pack(self, x) result(packed)
      class(orbit_branch_t), intent(in) :: self
      real(wp), intent(in) :: x(:)
      real(wp), allocatable :: packed(:)

      packed = [x(:size(x) - 1), self%orbit%map%scale, self%orbit%section, x(size(x))]
   end function orbit_branch_pack

   !> The state, and the value, of stored numbers, to whose section the orbit moves.
   subroutine orbit_branch_unpack(self, packed, x)
      class(orbit_branch_t), intent(inout), target :: self
      real(wp), intent(in) :: packed(:)
      real(wp), allocatable, intent(out) :: x(:)

      x = without_section(packed)
      call self%orbit%set_section(packed(size(packed) - 1))
   end subroutine orbit_branch_unpack

   !> The state, and the value, of stored numbers.
   pure function without_section(packed) result(x)
      real(wp), intent(in) :: packed(:)
      real(wp), allocatable :: x(:)

      associate (n => (size(packed) - 2)/2)
         x = [packed(:n), packed(2*n + 2)]
      end associate
   end function without_section

   ! Equations at a point

   !> The period map, with a given functional.
   subroutine orbit_branch_border(self, x, functional, problem)
      class(orbit_branch_t), intent(inout), target :: self
      real(wp), intent(in) :: x(:), functional(:)                     !! no condition depends on the point
      type(bordered_problem_t), intent(out) :: problem

      call new_bordered_problem(problem, self%orbit, [1], reshape(functional, [size(x), 1]), [0.0_wp])
   end subroutine orbit_branch_border

   !> Settings of the step control: the period map has no derivative at a graze.
   pure type(curve_config_t) function orbit_branch_config(self) result(config)
      class(orbit_branch_t), intent(in) :: self

      config = self%usual_config()
      config%shortest_step = 1.0e-4_wp*config%longest_step
   end function orbit_branch_config

   !> Settings of the corrector of steps.
   pure type(solver_config_t) function orbit_branch_corrector(self) result(corrector)
      class(orbit_branch_t), intent(in) :: self

      corrector%tolerance = orbit_tolerance
      corrector%max_iterations = max_corrections
      corrector%patience = 3
      corrector%line_search = .false.
   end function orbit_branch_corrector

   !> Corrects a motion in the plane across a direction.
   subroutine orbit_branch_correct_on_plane(self, x, direction, is_found)
      class(orbit_branch_t), intent(inout), target :: self
      real(wp), intent(inout) :: x(:)
      real(wp), intent(in) :: direction(:)
      logical, intent(out) :: is_found
      type(bordered_problem_t) :: problem
      type(report_t) :: report
      real(wp) :: functional(size(x))

      functional = direction/self%units_at(x)**2
      call self%border(x, direction, problem)
      call problem%hold(plane_t(functional, dot_product(x, functional)))
      call solve_newton(problem, self%corrector(), x, report)
      is_found = report%status == outcome%converged
   end subroutine orbit_branch_correct_on_plane

   !> Units of length at a motion.
   function orbit_branch_units_at(self, x) result(units)
      class(orbit_branch_t), intent(in) :: self
      real(wp), intent(in) :: x(:)
      real(wp) :: units(size(x))

      associate (n => self%orbit%n_unknowns)
         units = [spread(max(negligible_share, norm2(x(:n))), 1, n), self%orbit%parameter_scales([1])]
      end associate
   end function orbit_branch_units_at

   !> Updates the units of length of a curve at its point.
   subroutine orbit_branch_update_units(self, curve)
      class(orbit_branch_t), intent(inout), target :: self
      type(curve_t), intent(inout) :: curve

      associate (n => self%orbit%n_unknowns)
         curve%largest = max(negligible_share, curve%largest, norm2(curve%x(:n)))
         curve%units = [spread(curve%largest, 1, n), self%orbit%parameter_scales([1])]
      end associate
   end subroutine orbit_branch_update_units

   !> Moves the section of the map, and a curve with the start of its branch, away from impacts.
   subroutine orbit_branch_prepare_step(self, curve, start)
      class(orbit_branch_t), intent(inout), target :: self
      type(curve_t), intent(inout) :: curve
      type(origin_t), intent(inout) :: start
      real(wp) :: old, section
      logical :: is_done

      associate (orbit => self%orbit, n => self%orbit%n_unknowns)
         call orbit%set_parameters([1], curve%x(n + 1:), is_done)
         old = orbit%section
         section = orbit%better_section(curve%x(:n))
         if (abs(section - old) <= 0.0_wp) return
         call move(start%x, start%direction)
         call orbit%set_section(old)
         call move(curve%x, curve%direction)
         curve%orientation = 0.0_wp
         call self%update_units(curve)
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
   end subroutine orbit_branch_prepare_step

   ! Steps

   !> Performs one step, or passes a graze, before it or where it stalls. A graze at which the curve turns back cannot be located
   !> on a step: it is passed, or the short step begins there.
   subroutine orbit_branch_make_step(self, curve, at_point, branches, course, accuracy, points, error)
      class(orbit_branch_t), intent(inout), target :: self
      type(curve_t), intent(inout), target :: curve
      type(event_values_t), intent(inout), target :: at_point
      type(branches_t), intent(inout), target :: branches
      type(curve_course_t), intent(in) :: course
      type(step_accuracy_t), intent(inout) :: accuracy
      type(curve_point_t), allocatable, intent(out) :: points(:)
      type(error_t), allocatable, intent(out) :: error
      type(curve_point_t), allocatable :: first(:)
      integer, allocatable :: before(:)
      integer :: i
      logical :: is_passed

      allocate (before, source=at_point%impacts)
      call self%orbit%refusal%forget()
      call pass_grazing(self, curve, at_point, branches, .false., points, is_passed)
      if (.not. is_passed) call step(self, curve, at_point, branches, points)
      if (curve%status == outcome%stalled .and. at_point%stability%n_unstable > 0) &
         call pass_grazing(self, curve, at_point, branches, .true., points, is_passed)
      if (verdict_on_work() == verdict%timed_out) curve%status = outcome%timed_out   ! integrations then miss impacts
      if (is_passed) return
      if (curve%status == outcome%pending .and. any(before /= at_point%impacts) .and. &
          .not. any([(curve_kinds(points(i)%kind)%multipliers_jump, i=1, size(points))])) then
         allocate (first(0))
         call add_graze(first, 0.0_wp, curve%last%x)
         points = [first, points]
      end if
      if (curve%status == outcome%stalled .and. grazes_ahead(self, curve, at_point)) &
         call end_at_grazing(self, curve, at_point, points)
   end subroutine orbit_branch_make_step

   !> Why there are no motions at a value or next to it.
   pure function orbit_branch_fault_near(self, value, distance) result(text)
      class(orbit_branch_t), intent(in) :: self
      real(wp), intent(in) :: value, distance
      character(500) :: text

      text = ""
      if (.not. allocated(self%orbit%refusal%text)) return
      if (abs(self%orbit%refusal%value - value) <= distance) text = self%orbit%refusal%text
   end function orbit_branch_fault_near

   ! Functions of a point

   !> Fourth-order difference, since a motion is integrated from event to event; of motions with the same impacts: near
   !> a graze it is shorter.
   real(wp) function orbit_branch_slope_at(self, response, x, direction) result(slope)
      class(orbit_branch_t), intent(inout), target :: self
      type(located_response_t), intent(in) :: response
      real(wp), intent(in) :: x(:), direction(:)
      integer, allocatable :: impacts(:)
      real(wp) :: apart

      apart = difference_of_slopes
      allocate (impacts, source=self%impacts_at(x))
      do while (apart > 0.01_wp*min_distance)                              ! corners are that near to a graze
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
   end function orbit_branch_slope_at

   !> The motion of the degree of freedom of a response, to whose point the orbit moves.
   subroutine orbit_branch_find_series(self, response, x, series)
      class(orbit_branch_t), intent(inout), target :: self
      type(located_response_t), intent(in) :: response
      real(wp), intent(in) :: x(:)
      type(response_series_t), intent(out) :: series
      logical :: is_possible

      call self%orbit%set_parameters([1], x(size(x):), is_possible)
      series%set => self%set
      series%omega = self%orbit%model%system%tones%omega
      series%load = response%largest_load(self%orbit%model%system, self%orbit%model%discretisation%harmonics)
      allocate (series%c(0))
      if (is_possible) series%c = self%orbit%series_of(series%set, response%dof, x(:size(x) - 1))
   end subroutine orbit_branch_find_series

   !> Stability of the motion at a point of the curve.
   subroutine orbit_branch_find_stability(self, x, tolerance, stability, is_integrated)
      class(orbit_branch_t), intent(inout), target :: self
      real(wp), intent(in) :: x(:), tolerance
      type(stability_t), intent(out) :: stability
      logical, intent(in), optional :: is_integrated
      logical :: is_possible

      call self%orbit%set_parameters([1], x(size(x):), is_possible)
      if (is_possible) stability = self%orbit%stability(x(:size(x) - 1))
   end subroutine orbit_branch_find_stability

   !> Impacts of each wall in a period at a point of the curve.
   subroutine orbit_branch_find_contact(self, x, known)
      class(orbit_branch_t), intent(inout), target :: self
      real(wp), intent(in) :: x(:)
      type(event_values_t), intent(inout) :: known

      known%impacts = self%impacts_at(x)
   end subroutine orbit_branch_find_contact

   !> Impacts of each wall in a period, as of a record.
   function orbit_branch_impacts_at(self, x) result(impacts)
      class(orbit_branch_t), intent(inout), target :: self
      real(wp), intent(in) :: x(:)
      integer, allocatable :: impacts(:)
      real(wp) :: r(self%orbit%n_unknowns)

      r = self%defect(x)
      impacts = self%orbit%impacts
   end function orbit_branch_impacts_at

   !> Defect of a motion after a period, NaN if its value is rejected; the orbit counts its impacts.
   function orbit_branch_defect(self, x) result(r)
      class(orbit_branch_t), intent(inout), target :: self
      real(wp), intent(in) :: x(:)
      real(wp) :: r(self%orbit%n_unknowns)
      logical :: is_possible

      r = ieee_value(1.0_wp, ieee_quiet_nan)
      call self%orbit%set_parameters([1], x(size(x):), is_possible)
      if (is_possible) call self%orbit%residual(x(:size(x) - 1), r)
   end function orbit_branch_defect

   ! Results

   !> Computes the results of a motion of the curve.
   subroutine orbit_branch_describe(self, curve, point, plane, result, error, compares_in_time)
      class(orbit_branch_t), intent(inout), target :: self
      type(curve_t), intent(inout), target :: curve
      type(curve_point_t), intent(in) :: point
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
            here%harmonics = self%set
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
   end subroutine orbit_branch_describe

   !> Adds the derivatives of a point that stays at its value along the curve, if any are requested.
   subroutine differentiate(self, point, set, c, result)
      class(orbit_branch_t), intent(inout), target :: self
      type(curve_point_t), intent(in) :: point
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

   !> The system at a point that was reported, to which the orbit moves its own.
   function orbit_branch_system_at(self, position) result(system)
      class(orbit_branch_t), intent(inout), target :: self
      type(curve_position_t), intent(in) :: position
      type(system_t), pointer :: system
      logical :: is_possible                                          ! it was there before

      call self%orbit%set_parameters([1], [position%parameter], is_possible)
      system => self%orbit%model%system
   end function orbit_branch_system_at

   !> Frees the equations of motion; safe to call twice.
   subroutine orbit_branch_destroy(self)
      class(orbit_branch_t), intent(inout) :: self

      call self%orbit%destroy()
      call self%model%system%clear()
   end subroutine orbit_branch_destroy
end module hb_orbit_branch
