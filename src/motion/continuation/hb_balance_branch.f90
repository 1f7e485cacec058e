!> A balance that is followed along a curve: its equations on a set and a grid, what events compare, and the results at a point.
!> The unknowns of the curve are those of the balance, the unknown frequencies, the artificial damping of a normal
!> mode, and the moving value. The units of length are the range of the value and the largest motion so far.
module hb_balance_branch
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_bordered, only: bordered_problem_t, new_bordered_problem, plane_t
   use hb_curve, only: curve_config_t, curve_t, solve_next_to
   use hb_curve_branches, only: branches_t, origin_t
   use hb_curve_course, only: curve_course_t
   use hb_curve_events, only: event_values_t
   use hb_curve_points, only: curve_point_t
   use hb_energy, only: energy_t
   use hb_error, only: error_t
   use hb_followed, only: followed_t, step_accuracy_t
   use hb_kinds, only: wp
   use hb_level, only: level_t
   use hb_located_response, only: located_response_t, response_series_t
   use hb_model, only: model_t
   use hb_model_basis, only: max_even_share
   use hb_model_problem, only: model_problem_t
   use hb_motion_description, only: stability_of
   use hb_motion_images, only: copies_of, image_of, nearest_phases
   use hb_motion_result, only: curve_position_t, motion_result_t
   use hb_normal_mode, only: amplitude_functionals
   use hb_outcome, only: outcome
   use hb_phase, only: energy_row_t, shift_functional
   use hb_response_slope, only: find_series_slope, omega_slopes_along
   use hb_solver_types, only: report_t, solver_config_t
   use hb_stability, only: stability_t
   use hb_switch_extremes, only: extremes_of_switches
   use hb_switched_branch, only: has_switched_branch
   use hb_system, only: system_t
   use hb_thresholds, only: negligible_share, negligible_step, rounding_level
   implicit none
   private
   public :: balance_branch_t, find_motion

   integer, parameter :: max_corrections = 10

   !> Owns external resources: call `destroy`. A variable of this type needs the attribute `target`.
   type, extends(followed_t) :: balance_branch_t
      real(wp), allocatable :: further(:)                             !! unknowns in addition to those of the balance, at the start
      type(model_problem_t) :: problem
      type(energy_t), private :: energy                               ! of its motions, for a normal mode with given energy
      class(model_problem_t), allocatable, private :: odd_problem     ! of odd motions alone, if the equations are odd
      integer, allocatable, private :: odd_indices(:)                 ! positions of its unknowns among those of the problem
      real(wp), allocatable :: weights(:)                             !! typical motion, (unknowns of the balance)
   contains
      procedure :: find_first => balance_branch_find_first
      procedure :: resume => balance_branch_resume
      procedure :: adopt_level => balance_branch_adopt_level
      procedure :: on_level => balance_branch_on_level
      procedure :: border => balance_branch_border
      procedure :: config => balance_branch_config
      procedure :: corrector => balance_branch_corrector
      procedure :: correct_on_plane => balance_branch_correct_on_plane
      procedure :: units_at => balance_branch_units_at
      procedure :: update_units => balance_branch_update_units
      procedure :: prepare_step => balance_branch_prepare_step
      procedure :: find_roughness => balance_branch_find_roughness
      procedure :: restrict_to_symmetry => balance_branch_restrict_to_symmetry
      procedure :: make_step => balance_branch_make_step
      procedure :: has_jumped => balance_branch_has_jumped
      procedure :: tone_vanishes => balance_branch_tone_vanishes
      procedure :: retained_doubling => balance_branch_retained_doubling
      procedure :: find_separate => balance_branch_find_separate
      procedure :: fault_near => balance_branch_fault_near
      procedure :: has_images => balance_branch_has_images
      procedure :: bring_near => balance_branch_bring_near
      procedure :: find_drifting_tones => balance_branch_find_drifting_tones
      procedure :: slope_at => balance_branch_slope_at
      procedure :: find_series => balance_branch_find_series
      procedure :: find_stability => balance_branch_find_stability
      procedure :: find_contact => balance_branch_find_contact
      procedure :: describe => balance_branch_describe
      procedure :: plane_at => balance_branch_plane_at
      procedure :: find_gradient => balance_branch_find_gradient
      procedure :: system_at => balance_branch_system_at
      procedure :: destroy => balance_branch_destroy
   end type balance_branch_t

   ! The first motion, and sets of harmonics; bodies in hb_balance_branch_start
   interface
      module subroutine balance_branch_find_first(self, model, first, result, is_described, error)
         class(balance_branch_t), intent(inout), target :: self
         type(model_t), intent(inout) :: model
         type(origin_t), intent(out) :: first
         type(motion_result_t), intent(inout) :: result
         logical, intent(out) :: is_described
         type(error_t), allocatable, intent(out) :: error
      end subroutine balance_branch_find_first

      module subroutine balance_branch_resume(self, model, stored, error)
         class(balance_branch_t), intent(inout), target :: self
         type(model_t), intent(in) :: model
         type(curve_position_t), intent(in) :: stored(:)
         type(error_t), allocatable, intent(out) :: error
      end subroutine balance_branch_resume

      module subroutine balance_branch_adopt_level(self, level, error)
         class(balance_branch_t), intent(inout), target :: self
         type(level_t), intent(in) :: level
         type(error_t), allocatable, intent(out) :: error
      end subroutine balance_branch_adopt_level

      module function balance_branch_on_level(self, origin) result(moved)
         class(balance_branch_t), intent(in) :: self
         type(origin_t), intent(in) :: origin
         type(origin_t) :: moved
      end function balance_branch_on_level
   end interface

   ! What other modules do with a balance; bodies in hb_balance_branch_step
   interface
      module subroutine balance_branch_make_step(self, curve, at_point, branches, course, accuracy, points, error)
         class(balance_branch_t), intent(inout), target :: self
         type(curve_t), intent(inout), target :: curve
         type(event_values_t), intent(inout), target :: at_point
         type(branches_t), intent(inout), target :: branches
         type(curve_course_t), intent(in) :: course
         type(step_accuracy_t), intent(inout) :: accuracy
         type(curve_point_t), allocatable, intent(out) :: points(:)
         type(error_t), allocatable, intent(out) :: error
      end subroutine balance_branch_make_step

      module subroutine balance_branch_find_separate(self, branches, x, is_found, error)
         class(balance_branch_t), intent(inout), target :: self
         type(branches_t), intent(in) :: branches
         real(wp), allocatable, intent(out) :: x(:)
         logical, intent(out) :: is_found
         type(error_t), allocatable, intent(out) :: error
      end subroutine balance_branch_find_separate

      module subroutine balance_branch_find_gradient(self, curve, point, result)
         class(balance_branch_t), intent(inout), target :: self
         type(curve_t), intent(in) :: curve
         type(curve_point_t), intent(in) :: point
         type(motion_result_t), intent(inout) :: result
      end subroutine balance_branch_find_gradient
   end interface

   ! Results at a point; bodies in hb_balance_branch_results
   interface
      module subroutine balance_branch_describe(self, curve, point, plane, result, error, compares_in_time)
         class(balance_branch_t), intent(inout), target :: self
         type(curve_t), intent(inout), target :: curve
         type(curve_point_t), intent(in) :: point
         type(plane_t), intent(in) :: plane
         type(motion_result_t), intent(inout) :: result
         type(error_t), allocatable, intent(out) :: error
         logical, intent(in), optional :: compares_in_time
      end subroutine balance_branch_describe

      module function balance_branch_plane_at(self, curve, point) result(plane)
         class(balance_branch_t), intent(inout), target :: self
         type(curve_t), intent(inout) :: curve
         type(curve_point_t), intent(in) :: point
         type(plane_t) :: plane
      end function balance_branch_plane_at
   end interface

contains

   ! Equations at a point

   !> The equations with their conditions at a point, and a last functional.
   subroutine balance_branch_border(self, x, functional, problem)
      class(balance_branch_t), intent(inout), target :: self
      real(wp), intent(in) :: x(:), functional(:)
      type(bordered_problem_t), intent(out) :: problem
      real(wp) :: functionals(size(functional), self%n_further)

      functionals = 0.0_wp
      functionals(:, self%n_further) = functional
      call new_bordered_problem(problem, self%problem, self%problem%which, functionals, 0.0_wp*functionals(1, :))
      call set_conditions(self, x, problem)
   end subroutine balance_branch_border

   !> Sets the conditions of a curve: for the phases of unknown tones, from a motion, and for the
   !> amplitude or the energy of a normal mode.
   subroutine set_conditions(self, x, bordered)
      class(balance_branch_t), intent(inout), target :: self
      real(wp), intent(in) :: x(:)
      type(bordered_problem_t), intent(inout) :: bordered
      integer :: i, n
      real(wp) :: scale(self%problem%model%discretisation%harmonics%n_coefficients, self%problem%n_dofs)

      n = self%problem%n_unknowns
      scale = reshape(self%weights, shape(scale))
      associate (mode => self%problem%model%system%normal_mode, set => self%problem%model%discretisation%harmonics, &
                 which => self%problem%which, functionals => bordered%functionals, n_dofs => self%problem%n_dofs)
         if (mode%has_energy) then
            functionals(:n, 1) = shift_functional(set, which(1), reshape(x(:n), shape(scale)), scale)
            bordered%row = energy_row_t(self%energy, which, .true.)
            bordered%row_at = 2
            bordered%values(2) = 1.0_wp
         else if (mode%is_requested) then
            functionals(:n, :2) = amplitude_functionals(set, n_dofs, self%problem%stiffness%coordinates%number_of(mode%dof), &
                                                        which(1), mode%is_peak)
            bordered%values(2) = mode%amplitude
            if (self%problem%moves_mode) then
               functionals(size(functionals, 1), 2) = -1.0_wp
               bordered%values(2) = 0.0_wp
            end if
         else
            do i = 1, size(which) - 1
               functionals(:n, i) = shift_functional(set, which(i), reshape(x(:n), shape(scale)), scale)
            end do
         end if
      end associate
   end subroutine set_conditions

   !> Settings of the step control: with a rough residual shorter steps do not help.
   pure type(curve_config_t) function balance_branch_config(self) result(config)
      class(balance_branch_t), intent(in) :: self

      config = self%usual_config()
      config%shortest_step = merge(1.0e-3_wp, 1.0e-6_wp, self%is_rough)*config%longest_step
      config%kink_step = 1.0e-4_wp*config%longest_step
   end function balance_branch_config

   !> Settings of the corrector of steps.
   pure type(solver_config_t) function balance_branch_corrector(self) result(corrector)
      class(balance_branch_t), intent(in) :: self

      corrector = self%problem%model%options%solver
      corrector%max_iterations = max_corrections
      corrector%line_search = .false.
   end function balance_branch_corrector

   !> Corrects a motion in the plane across a direction.
   subroutine balance_branch_correct_on_plane(self, x, direction, is_found)
      class(balance_branch_t), intent(inout), target :: self
      real(wp), intent(inout) :: x(:)
      real(wp), intent(in) :: direction(:)
      logical, intent(out) :: is_found
      type(bordered_problem_t) :: problem
      type(report_t) :: report
      type(solver_config_t) :: corrector
      real(wp) :: from(size(x)), units(size(x))
      logical :: is_relaxed

      call self%find_roughness(x, is_found)
      if (.not. is_found) return
      units = self%units_at(x)
      from = x
      call self%border(x, direction, problem)
      call problem%hold(plane_t(direction/units**2, dot_product(x, direction/units**2)))
      corrector = self%problem%model%options%solver
      corrector%tolerance = max(corrector%tolerance, 2.0_wp*self%problem%balance_t%rounding_level(x(:self%problem%n_unknowns)), &
                                10.0_wp*self%roughness)
      corrector%max_iterations = 2*max_corrections
      do
         call solve_next_to(problem, corrector, x, report)
         is_found = report%status == outcome%converged
         if (is_found) exit
         call self%relax(is_relaxed)
         if (.not. is_relaxed) exit
         corrector%tolerance = 10.0_wp*corrector%tolerance
         x = from
      end do
   end subroutine balance_branch_correct_on_plane

   !> Finds the roughness of the residual at a point.
   subroutine balance_branch_find_roughness(self, x, is_possible)
      class(balance_branch_t), intent(inout), target :: self
      real(wp), intent(in) :: x(:)
      logical, intent(out), optional :: is_possible
      logical :: is_there

      call self%problem%move_to_point(x, is_there)
      if (present(is_possible)) is_possible = is_there
      if (.not. is_there) return
      self%roughness = self%problem%roughness(x(:self%problem%n_unknowns))
      self%is_rough = 10.0_wp*self%roughness > self%problem%model%options%solver%tolerance
      self%tolerance_factor = 1.0_wp
   end subroutine balance_branch_find_roughness

   !> Units of length at a motion.
   function balance_branch_units_at(self, x) result(units)
      class(balance_branch_t), intent(in) :: self
      real(wp), intent(in) :: x(:)
      real(wp) :: units(size(x))

      units = [self%weights*max(negligible_share, norm2(x(:self%problem%n_unknowns)/self%weights)), &
               self%problem%parameter_scales(self%problem%which)]
   end function balance_branch_units_at

   !> Updates the units of length and the tolerance of a curve at its point.
   subroutine balance_branch_update_units(self, curve)
      class(balance_branch_t), intent(inout), target :: self
      type(curve_t), intent(inout) :: curve
      logical :: is_possible

      call self%problem%move_to_point(curve%x, is_possible)
      associate (n => self%problem%n_unknowns)
         curve%largest = max(negligible_share, curve%largest, norm2(curve%x(:n)/self%weights))
         curve%units = [self%weights*curve%largest, self%problem%parameter_scales(self%problem%which)]
         curve%corrector%tolerance = max(self%problem%model%options%solver%tolerance, &
                                         2.0_wp*self%problem%balance_t%rounding_level(curve%x(:n)), &
                                         10.0_wp*self%tolerance_factor*self%roughness)
      end associate
   end subroutine balance_branch_update_units

   !> Prepares the problem at the point of a curve, so that a stored curve also continues from there.
   subroutine balance_branch_prepare_step(self, curve, start)
      class(balance_branch_t), intent(inout), target :: self
      type(curve_t), intent(inout) :: curve
      type(origin_t), intent(inout) :: start
      logical :: is_possible

      call self%problem%refusal%forget()
      call self%problem%move_to_point(curve%x, is_possible)
      call self%problem%rebuild_balance()
      self%tolerance_factor = 1.0_wp
      call set_conditions(self, curve%x, curve%problem)
   end subroutine balance_branch_prepare_step

   !> Restricts corrections to odd motions if curve and direction are odd; the tangent still detects branches of other
   !> motions.
   subroutine balance_branch_restrict_to_symmetry(self, curve)
      class(balance_branch_t), intent(inout), target :: self
      type(curve_t), intent(inout) :: curve

      if (allocated(curve%part)) deallocate (curve%part)
      if (.not. allocated(self%odd_problem)) return
      if (even_part_of(curve%x) > max_even_share .or. even_part_of(curve%direction) > max_even_share) return
      allocate (curve%part)
      curve%retained = self%odd_indices
      call new_bordered_problem(curve%part, self%odd_problem, self%problem%which, curve%problem%functionals(curve%retained, :), &
                                curve%problem%values)

   contains

      pure real(wp) function even_part_of(x)
         real(wp), intent(in) :: x(:)
         real(wp) :: odd(size(x))

         odd = 0.0_wp
         odd(self%odd_indices) = x(self%odd_indices)
         even_part_of = norm2((x - odd)/curve%units)/norm2(x/curve%units)
      end function even_part_of
   end subroutine balance_branch_restrict_to_symmetry

   ! Steps

   !> Whether a step may have jumped to another part of the curve or to another curve, such as a motion of the doubled period to
   !> that of the whole period.
   logical function balance_branch_has_jumped(self, curve, is_first_branch) result(has_jumped)
      class(balance_branch_t), intent(inout), target :: self
      type(curve_t), intent(inout) :: curve
      logical, intent(in) :: is_first_branch

      has_jumped = .false.
      if (curve%last%step <= negligible_step*curve%config%longest_step .or. self%is_rough) return
      if (is_first_branch) has_jumped = abs(self%retained_doubling(curve)) <= negligible_share
      if (has_jumped .or. self%n_further > 1) return                  ! unknown tones have no given phases
      has_jumped = has_switched_branch(self%problem, self%weights, curve)
   end function balance_branch_has_jumped

   !> Whether the motion of an unknown tone has passed through zero on the step, so that the continuation is its mirror image, or
   !> has ended at zero, where its frequency alone would go on.
   logical function balance_branch_tone_vanishes(self, curve) result(tone_vanishes)
      class(balance_branch_t), intent(in) :: self
      type(curve_t), intent(in) :: curve
      real(wp), dimension(self%problem%model%discretisation%harmonics%n_coefficients, self%problem%n_dofs) :: before, u
      integer :: h, i

      tone_vanishes = .false.
      associate (set => self%problem%model%discretisation%harmonics, which => self%problem%which)
         u = reshape(curve%x(:size(u))/self%weights, shape(u))
         before = reshape(curve%last%x(:size(u))/self%weights, shape(u))
         do i = 1, size(which) - 1
            if (which(i) > set%n_tones) cycle
            do h = 1, set%n_harmonics
               if (set%tuples(which(i), h) /= 0) cycle
               u(set%cos_at(h), :) = 0.0_wp
               if (set%sin_at(h) > 0) u(set%sin_at(h), :) = 0.0_wp
            end do
            tone_vanishes = tone_vanishes .or. sum(u*before) <= 0.0_wp .or. norm2(u) <= rounding_level*curve%largest
         end do
      end associate
   end function balance_branch_tone_vanishes

   !> Share of the part of a motion of doubled period that repeats after two periods alone, of its size at the start of the
   !> step, that is left at the end of the step; 1 for other motions.
   real(wp) function balance_branch_retained_doubling(self, curve) result(share)
      class(balance_branch_t), intent(in) :: self
      type(curve_t), intent(in) :: curve
      real(wp) :: before, behind
      integer :: d, h

      share = 1.0_wp
      if (.not. allocated(self%request%origin)) return
      if (self%request%origin%is_torus) return
      before = 0.0_wp
      behind = 0.0_wp
      associate (set => self%problem%model%discretisation%harmonics, last_x => curve%last%x, x => curve%x, &
                 weights => self%weights)
         do h = 1, set%n_harmonics
            if (all(modulo(set%tuples(:, h), 2) == 0)) cycle
            do d = 0, self%problem%n_dofs - 1
               associate (parts => d*set%n_coefficients + [set%cos_at(h), set%sin_at(h)])
                  before = before + sum((last_x(parts)/weights(parts))**2)
                  behind = behind + sum(last_x(parts)*x(parts)/weights(parts)**2)
               end associate
            end do
         end do
      end associate
      if (before > 0.0_wp) share = behind/before
   end function balance_branch_retained_doubling

   !> Why there are no motions at a value or next to it.
   pure function balance_branch_fault_near(self, value, distance) result(text)
      class(balance_branch_t), intent(in) :: self
      real(wp), intent(in) :: value, distance
      character(500) :: text

      text = ""
      if (allocated(self%problem%refusal%text)) then
         if (abs(self%problem%refusal%value - value) <= distance) text = self%problem%refusal%text
      end if
      if (len_trim(text) == 0 .and. allocated(self%odd_problem)) text = self%odd_problem%fault_of_laws()
      if (len_trim(text) == 0) text = self%problem%fault_of_laws()
   end function balance_branch_fault_near

   ! Images

   !> The unknown tones whose phases are arbitrary: all but those of a normal mode, whose amplitude has a phase.
   pure function free_phases(self) result(tones)
      class(balance_branch_t), intent(in) :: self
      integer, allocatable :: tones(:)
      integer :: i

      associate (system => self%model%system)
         tones = pack([(i, i=1, system%tones%n_tones)], system%tones%is_unknown .and. .not. system%normal_mode%is_requested)
      end associate
   end function free_phases

   !> Whether a motion of the curve has images that differ in their phases alone.
   logical function balance_branch_has_images(self) result(has_images)
      class(balance_branch_t), intent(in) :: self

      has_images = size(free_phases(self)) > 0 .or. any(copies_of(self%model%system) > 1)
   end function balance_branch_has_images

   !> Replaces a motion of the curve, with a direction, by the image that is closest to a reference.
   subroutine balance_branch_bring_near(self, reference, x, direction)
      class(balance_branch_t), intent(in) :: self
      real(wp), intent(in) :: reference(:)
      real(wp), intent(inout) :: x(:)
      real(wp), intent(inout), optional :: direction(:)
      real(wp) :: phases(self%model%system%tones%n_tones)

      if (.not. self%has_images()) return
      associate (n => size(self%weights), set => self%problem%model%discretisation%harmonics)
         phases = nearest_phases(set, copies_of(self%model%system), free_phases(self), &
                                 self%weights, reference(:n), x(:n))
         x = image_of(set, n, x, phases)
         if (present(direction)) direction = image_of(set, n, direction, phases)
      end associate
   end subroutine balance_branch_bring_near

   !> All base frequencies of a motion, if phases of unknown tones drift along the curve.
   subroutine balance_branch_find_drifting_tones(self, x, omega)
      class(balance_branch_t), intent(inout), target :: self
      real(wp), intent(in) :: x(:)
      real(wp), allocatable, intent(out) :: omega(:)
      logical :: is_possible

      call self%problem%move_to_point(x, is_possible)
      if (is_possible .and. size(free_phases(self)) > 0) omega = self%problem%omega(:self%model%system%tones%n_tones)
   end subroutine balance_branch_find_drifting_tones

   ! Functions of a point

   !> The motion at a point of the curve, at all degrees of freedom; not allocated if the parameters are rejected.
   subroutine find_motion(problem, x, c)
      type(model_problem_t), intent(inout), target :: problem
      real(wp), intent(in) :: x(:)
      complex(wp), allocatable, intent(out) :: c(:, :)
      logical :: is_possible

      call problem%move_to_point(x, is_possible)
      if (.not. is_possible) return
      associate (balance => problem%balance_t)
         allocate (c(problem%model%system%structure%n_dofs, balance%harmonics%n_harmonics))
         call balance%all_dofs(reshape(x(:problem%n_unknowns), [balance%harmonics%n_coefficients, balance%n_dofs]), c)
      end associate
   end subroutine find_motion

   !> Derivative of the square of a response along a direction; NaN if the parameters are rejected.
   real(wp) function balance_branch_slope_at(self, response, x, direction) result(slope)
      class(balance_branch_t), intent(inout), target :: self
      type(located_response_t), intent(in) :: response
      real(wp), intent(in) :: x(:), direction(:)
      type(response_series_t) :: series, slopes

      slope = ieee_value(slope, ieee_quiet_nan)
      call self%find_series(response, x, series)
      if (size(series%c) == 0) return
      call find_series_slopes(self, response, x, direction, slopes)
      if (allocated(slopes%c)) slope = response%slope(series, slopes)
   end function balance_branch_slope_at

   !> Derivatives of the motion of a degree of freedom along a direction, of the harmonics of its response, the others are zero, and
   !> of the base frequencies. None if the structure is singular there.
   subroutine find_series_slopes(self, response, x, direction, slopes)
      type(balance_branch_t), intent(inout) :: self                 !! its problem has moved to x
      type(located_response_t), intent(in) :: response
      real(wp), intent(in) :: x(:), direction(:)
      type(response_series_t), intent(out) :: slopes
      complex(wp), allocatable :: of_numbers(:)
      real(wp) :: u(self%problem%model%discretisation%harmonics%n_coefficients, self%problem%n_dofs)
      integer :: h

      associate (set => self%problem%model%discretisation%harmonics, &
                 numbers => response%numbers_in(self%problem%model%discretisation%harmonics))
         if (response%column > 0) then
            u = reshape(direction(:size(u)), shape(u))
            of_numbers = [(set%amplitude(u(:, response%column), numbers(h)), h=1, size(numbers))]
         else
            call find_series_slope(self%problem, response%dof, x, direction, numbers, of_numbers)
            if (.not. allocated(of_numbers)) return
         end if
         allocate (slopes%c(set%n_harmonics), source=(0.0_wp, 0.0_wp))
         slopes%c(numbers) = of_numbers
         slopes%omega = omega_slopes_along(self%problem, direction)
      end associate
   end subroutine find_series_slopes

   !> The motion of the degree of freedom of a response, to whose point the problem moves.
   subroutine balance_branch_find_series(self, response, x, series)
      class(balance_branch_t), intent(inout), target :: self
      type(located_response_t), intent(in) :: response
      real(wp), intent(in) :: x(:)
      type(response_series_t), intent(out) :: series
      complex(wp), allocatable :: motion(:, :)
      real(wp) :: u(self%problem%model%discretisation%harmonics%n_coefficients, self%problem%n_dofs)
      integer :: h
      logical :: is_possible

      call self%problem%move_to_point(x, is_possible)
      series%set => self%problem%model%discretisation%harmonics
      series%omega = self%problem%omega
      series%load = response%largest_load(self%problem%model%system, self%problem%harmonics)
      allocate (series%c(0))
      if (.not. is_possible) return
      if (response%column > 0) then
         u = reshape(x(:size(u)), shape(u))
         series%c = [(series%set%amplitude(u(:, response%column), h), h=1, series%set%n_harmonics)]
      else
         call find_motion(self%problem, x, motion)
         if (allocated(motion)) series%c = motion(response%dof, :)
      end if
   end subroutine balance_branch_find_series

   !> Stability of the motion at a point of the curve.
   subroutine balance_branch_find_stability(self, x, tolerance, stability, is_integrated)
      class(balance_branch_t), intent(inout), target :: self
      real(wp), intent(in) :: x(:), tolerance
      type(stability_t), intent(out) :: stability                     !! without multipliers if they are not found
      logical, intent(in), optional :: is_integrated                  !! of the integrated periodic motion
      complex(wp), allocatable :: c(:, :)

      call find_motion(self%problem, x, c)
      associate (problem => self%problem)
         if (allocated(c)) call stability_of(problem%model%system, problem%model%options, &
                                             problem%balance_t, c, tolerance, stability, is_integrated)
      end associate
   end subroutine balance_branch_find_stability

   !> Extremes of the switching functions at a point of the curve.
   subroutine balance_branch_find_contact(self, x, known)
      class(balance_branch_t), intent(inout), target :: self
      real(wp), intent(in) :: x(:)
      type(event_values_t), intent(inout) :: known
      complex(wp), allocatable :: c(:, :)
      integer :: i

      allocate (known%extremes(2, 0))
      associate (laws => self%problem%model%system%laws)
         if (all([(laws(i)%law%n_switches == 0, i=1, size(laws))])) return
         if (allocated(self%problem%stiffness%contacts)) return       ! contacts begin and end one by one all along the curve
         call find_motion(self%problem, x, c)
         if (allocated(c)) &
            call extremes_of_switches(laws, self%problem%harmonics%tuples, self%problem%omega, c, known%extremes)
      end associate
   end subroutine balance_branch_find_contact

   ! Results

   !> The system at a stored point, to which the problem moves its own.
   function balance_branch_system_at(self, position) result(system)
      class(balance_branch_t), intent(inout), target :: self
      type(curve_position_t), intent(in) :: position
      type(system_t), pointer :: system
      logical :: is_possible                                          ! it was there before

      associate (x => position%unknowns)
         call self%problem%set_parameters(self%problem%which, x(size(x) - self%n_further + 1:), is_possible)
      end associate
      system => self%problem%model%system
   end function balance_branch_system_at

   !> Frees the balance; safe to call twice.
   subroutine balance_branch_destroy(self)
      class(balance_branch_t), intent(inout) :: self

      call self%problem%destroy()
      if (allocated(self%odd_problem)) call self%odd_problem%destroy()
      call self%model%system%clear()
   end subroutine balance_branch_destroy
end module hb_balance_branch
