!> A motion that is followed along a curve: its equations on a set and a grid, the point and the tangent, its corrections,
!> and the results at the point. What events compare there is in hb_observed_motion.
!> The unknowns of the curve are those of the balance, the unknown frequencies, the artificial damping of a normal
!> mode, and the moving value. The units of length are the range of the value and the largest motion so far.
module hb_followed_motion
   use hb_autonomous, only: find_energy
   use hb_basis, only: basis_t, whole_basis
   use hb_bifurcation_error, only: add_error_of_bifurcation, add_error_of_graze
   use hb_bordered, only: bordered_problem_t, new_bordered_problem, plane_t
   use hb_curve, only: curve_config_t, curve_t, new_curve, path_t
   use hb_curve_course, only: curve_course_t
   use hb_curve_events, only: event_values_t
   use hb_curve_points, only: origin_t, reported_extreme_t, waiting_t
   use hb_curve_request, only: curve_request_t
   use hb_discretisation, only: discretisation_t
   use hb_energy, only: energy_t
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t, new_of_parity
   use hb_kinds, only: wp
   use hb_law, only: has_memory
   use hb_level, only: apply_safety_factor, estimate_of, level_t, set_to_level, transferred
   use hb_model, only: model_t
   use hb_model_basis, only: half_of_odd, is_solved_odd, max_even
   use hb_model_problem, only: model_problem_t, new_model_problem
   use hb_motion_description, only: describe_motion, solution_t
   use hb_motion_result, only: motion_result_t
   use hb_newton, only: solve_newton
   use hb_normal_mode, only: amplitude_functionals
   use hb_options, only: options_t
   use hb_outcome, only: outcome
   use hb_phase, only: energy_row_t, shift_functional
   use hb_point_kinds, only: curve_kind
   use hb_solver_types, only: report_t, solver_config_t
   use hb_system, only: system_t
   use hb_thresholds, only: agreement, faint, minor, rounding
   implicit none
   private
   public :: curve_state_t, followed_motion_t, max_tolerance_factor

   integer, parameter :: max_corrections = 10
   real(wp), parameter :: turn = 0.12_wp                              ! [rad] desired per step
   real(wp), parameter :: without_laws = 2.5_wp                       ! steps are so much longer: 30 points of a resonance circle
   real(wp), parameter :: max_tolerance_factor = 1.0e4_wp            !! by which a tolerance increases for a rough residual

   !> A point of a curve, to which it can go back on the same or on another set: a value.
   type :: curve_state_t
      type(level_t) :: level                                          !! set and grid
      type(path_t) :: path
      type(event_values_t) :: at_point                                !! what events compare
   end type curve_state_t

   !> Owns external resources: call `destroy`. A variable of this type needs the attribute `target`.
   type :: followed_motion_t
      type(level_t) :: level                                          !! present set and grid
      type(curve_t) :: curve
      type(event_values_t) :: at_point                                !! what events compare
      type(curve_request_t) :: request
      type(model_t) :: model                                          !! at the start, as read
      real(wp), allocatable :: further(:)                             !! unknowns in addition to those of the balance, at the start
      real(wp) :: estimate = huge(1.0_wp)                             !! of the error at the point of the curve; huge: not known
      integer :: n_levels = 1                                         !! of the last step
      type(model_problem_t) :: problem
      type(energy_t) :: energy                                        !! of its motions, for a normal mode with given energy
      class(model_problem_t), allocatable :: odd_problem              !! of odd motions alone, if the equations are odd
      integer, allocatable :: odd_indices(:)                          !! positions of its unknowns among those of the problem
      real(wp), allocatable :: weights(:)                             !! typical motion, (unknowns of the balance)
      integer :: branch = 0                                           !! origin of this branch; 0: the start
      logical :: is_reversed = .false.                                !! it is the second of the two from its origin
      type(origin_t), allocatable :: origins(:) !! branch points on the branches from the start, separate motions
      type(origin_t) :: branch_start                                  !! start of this branch
      type(origin_t) :: start_on_set                                  !! the same on the present set
      type(curve_course_t) :: course                                  !! of this branch
      type(reported_extreme_t), allocatable :: reported(:)            !! on this branch
      real(wp) :: roughness = 0.0_wp !! of the residual as a function of frequencies, at the start of this branch
      logical :: is_rough = .false.                                   !! above the tolerance
      real(wp) :: tolerance_factor = 1.0_wp                           !! by which the tolerance may have increased along the branch
      logical :: is_out_of_work = .false.                             !! the last step has used up the work of a point
   contains
      procedure :: adopt_level => followed_motion_adopt_level
      procedure :: border => followed_motion_border
      procedure :: make_curve => followed_motion_make_curve
      procedure :: config => followed_motion_config
      procedure :: state => followed_motion_state
      procedure :: restore => followed_motion_restore
      procedure :: restrict_to_symmetry => followed_motion_restrict_to_symmetry
      procedure :: correct_on_plane => followed_motion_correct_on_plane
      procedure :: find_roughness => followed_motion_find_roughness
      procedure :: set_conditions => followed_motion_set_conditions
      procedure :: tone_vanishes => followed_motion_tone_vanishes
      procedure :: units_at => followed_motion_units_at
      procedure :: update_units => followed_motion_update_units
      procedure :: prepare_step => followed_motion_prepare_step
      procedure :: transfer_start => followed_motion_transfer_start
      procedure :: plane_at => followed_motion_plane_at
      procedure :: describe => followed_motion_describe
      procedure :: free_phases => followed_motion_free_phases
      procedure :: has_left_branch => followed_motion_has_left_branch
      procedure :: sense => followed_motion_sense
      procedure :: destroy => followed_motion_destroy
   end type followed_motion_t

contains

   !> Sets up the problem of the curve on a set and a grid, at its start.
   subroutine followed_motion_adopt_level(self, level, error)
      class(followed_motion_t), intent(inout), target :: self
      type(level_t), intent(in) :: level
      type(error_t), allocatable, intent(out) :: error
      type(model_t) :: found
      integer, allocatable :: which(:)
      integer :: i, n_unknown

      found = self%model
      associate (tones => found%system%tones)
         n_unknown = count(tones%is_unknown)
         which = pack([(i, i=1, tones%n_tones)], tones%is_unknown)
         tones%omega(which) = self%further(:n_unknown)
         if (found%system%normal_mode%is_requested) which = [which, tones%n_tones + which]
      end associate
      if (found%options%accuracy%is_on .or. any(level%n_samples /= found%discretisation%torus%n_samples)) then
         call set_to_level(found%discretisation, found%system, self%model%discretisation, found%options, level, error)
         if (allocated(error)) return
      end if
      if (found%options%accuracy%is_on) then
         found%options%error_estimate%is_on = .true.
         found%options%error_estimate%truncation = found%options%accuracy%tolerance
         found%options%error_estimate%aliasing = found%options%accuracy%tolerance
         call self%problem%destroy()
      end if
      call new_model_problem(self%problem, found%system, found%discretisation, found%options, self%request%moving, &
                             self%request%start, error)
      if (allocated(error)) return
      self%level = level_t(level%set, level%n_samples)
      self%problem%which = [which, self%problem%own]
      self%weights = self%problem%x_scale
      if (found%system%normal_mode%has_energy) &
         call find_energy(self%energy, found%system, found%discretisation, found%options, self%problem%balance_t, error)
      if (allocated(error)) return
      call make_odd_problem(self, found%system, found%discretisation, found%options, error)
      if (allocated(error)) return
      do i = 1, size(self%request%responses)
         associate (response => self%request%responses(i))
            response%column = self%problem%stiffness%coordinates%number_of(response%dof)
         end associate
      end do
   end subroutine followed_motion_adopt_level

   !> Sets up the problem of odd motions alone on the present set, if the moving value is a given frequency and the
   !> equations are odd: other values may break the symmetry. Odd motions may hold sliders away from their center, and
   !> the forces of these are then not odd.
   subroutine make_odd_problem(self, system, discretisation, options, error)
      class(followed_motion_t), intent(inout), target :: self
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation            !! on the present set
      type(options_t), intent(in) :: options
      type(error_t), allocatable, intent(out) :: error
      type(harmonics_t) :: odd
      type(discretisation_t) :: reduced
      integer :: i

      if (allocated(self%odd_problem)) then
         call self%odd_problem%destroy()
         deallocate (self%odd_problem)
      end if
      if (.not. (self%problem%moves_frequency .and. is_solved_odd(system, discretisation, options)) .or. &
          has_memory(system%laws) .or. any(system%tones%is_unknown)) return
      call new_of_parity(odd, discretisation%harmonics, 1, error)
      if (allocated(error) .or. odd%n_harmonics == discretisation%harmonics%n_harmonics) return
      reduced = discretisation
      call set_to_level(reduced, system, discretisation, options, level_t(odd, discretisation%torus%n_samples), error)
      if (allocated(error)) return
      reduced%torus = half_of_odd(system, discretisation)
      allocate (self%odd_problem)
      call new_model_problem(self%odd_problem, system, reduced, options, self%request%moving, self%request%start, error)
      associate (n => self%problem%n_unknowns, m => size(self%problem%which))
         self%odd_indices = [discretisation%harmonics%indices_of(odd, self%problem%n_dofs), (n + i, i=1, m)]
      end associate
   end subroutine make_odd_problem

   !> Sets up the curve at one of its points, on the present set; `direction` is an approximate direction.
   subroutine followed_motion_make_curve(self, x, direction)
      class(followed_motion_t), intent(inout), target :: self
      real(wp), intent(in) :: x(:), direction(:)
      type(bordered_problem_t) :: bordered
      type(curve_config_t) :: config
      type(path_t) :: before
      type(solver_config_t) :: corrector
      real(wp) :: units(size(x))

      config = self%config()
      config%shortest_step = 1.0e-6_wp*config%longest_step
      config%kink_step = 1.0e-4_wp*config%longest_step
      corrector = self%problem%model%options%solver
      corrector%max_iterations = max_corrections
      corrector%line_search = .false.
      self%curve%x = x
      call self%border(direction)
      call self%update_units()
      bordered = self%curve%problem
      units = self%curve%units
      if (self%is_rough) config%shortest_step = 1.0e-3_wp*config%longest_step    ! shorter steps do not help
      before = self%curve%path_t
      call new_curve(self%curve, bordered, x, direction, units, config, corrector)
      self%curve%length = before%length
      self%curve%largest = before%largest
      call self%restrict_to_symmetry()
   end subroutine followed_motion_make_curve

   !> Settings of the step control, without the shortest step.
   pure type(curve_config_t) function followed_motion_config(self) result(config)
      class(followed_motion_t), intent(in) :: self
      real(wp) :: factor

      factor = merge(without_laws, 1.0_wp, size(self%model%system%laws) == 0)
      config%longest_step = factor*self%request%longest_step
      config%first_step = 0.1_wp*config%longest_step
      config%angle = factor*turn
      config%growth = 2.0_wp
   end function followed_motion_config

   !> Assigns to the curve the problem with the conditions at its point, and a given last functional.
   subroutine followed_motion_border(self, functional)
      class(followed_motion_t), intent(inout), target :: self
      real(wp), intent(in) :: functional(:)
      type(bordered_problem_t) :: bordered
      real(wp) :: functionals(size(functional), size(self%problem%which))

      functionals = 0.0_wp
      functionals(:, size(functionals, 2)) = functional
      call new_bordered_problem(bordered, self%problem, self%problem%which, functionals, 0.0_wp*functionals(1, :))
      self%curve%problem = bordered
      call self%set_conditions()
   end subroutine followed_motion_border

   !> The state at the present point.
   function followed_motion_state(self) result(state)
      class(followed_motion_t), intent(in) :: self
      type(curve_state_t) :: state

      state%level = self%level
      state%path = self%curve%path_t
      state%at_point = self%at_point
   end function followed_motion_state

   !> Sets up the curve at a point of it on the present set, as it was there.
   subroutine followed_motion_restore(self, path)
      class(followed_motion_t), intent(inout), target :: self
      type(path_t), intent(in) :: path

      self%curve%path_t = path
      self%curve%status = outcome%pending
      call self%border(path%direction)
      call self%update_units()
      call self%restrict_to_symmetry()
   end subroutine followed_motion_restore

   !> Restricts corrections to odd motions if curve and direction are odd; the tangent still detects branches of other
   !> motions.
   subroutine followed_motion_restrict_to_symmetry(self)
      class(followed_motion_t), intent(inout), target :: self

      associate (curve => self%curve)
         if (allocated(curve%part)) deallocate (curve%part)
         if (.not. allocated(self%odd_problem)) return
         if (even_part_of(curve%x) > max_even .or. even_part_of(curve%direction) > max_even) return
         allocate (curve%part)
         curve%retained = self%odd_indices
         call new_bordered_problem(curve%part, self%odd_problem, self%problem%which, curve%problem%functionals(curve%retained, :), &
                                   curve%problem%values)
      end associate

   contains

      pure real(wp) function even_part_of(x)
         real(wp), intent(in) :: x(:)
         real(wp) :: odd(size(x))

         odd = 0.0_wp
         odd(self%odd_indices) = x(self%odd_indices)
         even_part_of = norm2((x - odd)/self%curve%units)/norm2(x/self%curve%units)
      end function even_part_of
   end subroutine followed_motion_restrict_to_symmetry

   !> Corrects a motion in the plane across a direction.
   subroutine followed_motion_correct_on_plane(self, x, direction, is_found)
      class(followed_motion_t), intent(inout), target :: self
      real(wp), intent(inout) :: x(:)
      real(wp), intent(in) :: direction(:)
      logical, intent(out) :: is_found
      type(report_t) :: report
      type(solver_config_t) :: corrector
      real(wp) :: units(size(x))

      call self%find_roughness(x, is_found)
      if (.not. is_found) return
      units = self%units_at(x)
      self%curve%x = x
      call self%border(direction)
      call self%curve%problem%hold(plane_t(direction/units**2, dot_product(x, direction/units**2)))
      corrector = self%problem%model%options%solver
      corrector%tolerance = max(corrector%tolerance, 2.0_wp*self%problem%balance_t%rounding_level(x(:self%problem%n_unknowns)), &
                                10.0_wp*self%roughness)
      corrector%max_iterations = 2*max_corrections
      do
         call solve_newton(self%curve%problem, corrector, x, report)
         is_found = report%status == outcome%converged
         if (is_found .or. .not. self%is_rough .or. self%tolerance_factor >= max_tolerance_factor) exit
         self%tolerance_factor = 10.0_wp*self%tolerance_factor
         corrector%tolerance = 10.0_wp*corrector%tolerance
         x = self%curve%x
      end do
   end subroutine followed_motion_correct_on_plane

   !> Finds the roughness of the residual at a point.
   subroutine followed_motion_find_roughness(self, x, is_possible)
      class(followed_motion_t), intent(inout), target :: self
      real(wp), intent(in) :: x(:)
      logical, intent(out), optional :: is_possible
      logical :: is_there

      call self%problem%move_to_point(x, is_there)
      if (present(is_possible)) is_possible = is_there
      if (.not. is_there) return
      self%roughness = self%problem%roughness(x(:self%problem%n_unknowns))
      self%is_rough = 10.0_wp*self%roughness > self%problem%model%options%solver%tolerance
      self%tolerance_factor = 1.0_wp
   end subroutine followed_motion_find_roughness

   !> Sets the conditions of the curve: for the phases of unknown tones, from the present motion, and for the
   !> amplitude or the energy of a normal mode.
   subroutine followed_motion_set_conditions(self)
      class(followed_motion_t), intent(inout) :: self
      integer :: i, n
      real(wp) :: scale(self%problem%model%discretisation%harmonics%n_coefficients, self%problem%n_dofs)

      n = self%problem%n_unknowns
      scale = reshape(self%weights, shape(scale))
      associate (mode => self%problem%model%system%normal_mode, set => self%problem%model%discretisation%harmonics, &
                 which => self%problem%which, functionals => self%curve%problem%functionals, n_dofs => self%problem%n_dofs)
         if (mode%has_energy) then
            functionals(:n, 1) = shift_functional(set, which(1), reshape(self%curve%x(:n), shape(scale)), scale)
            self%curve%problem%row = energy_row_t(self%energy, which, .true.)
            self%curve%problem%row_at = 2
            self%curve%problem%values(2) = 1.0_wp
         else if (mode%is_requested) then
            functionals(:n, :2) = amplitude_functionals(set, n_dofs, self%problem%stiffness%coordinates%number_of(mode%dof), &
                                                        which(1), mode%is_peak)
            self%curve%problem%values(2) = mode%amplitude
            if (self%problem%moves_mode) then
               functionals(size(functionals, 1), 2) = -1.0_wp
               self%curve%problem%values(2) = 0.0_wp
            end if
         else
            do i = 1, size(which) - 1
               functionals(:n, i) = shift_functional(set, which(i), reshape(self%curve%x(:n), shape(scale)), scale)
            end do
         end if
      end associate
   end subroutine followed_motion_set_conditions

   !> Whether the motion of an unknown tone has passed through zero on the step, so that the continuation is its mirror image, or
   !> has ended at zero, where its frequency alone would go on.
   logical function followed_motion_tone_vanishes(self) result(tone_vanishes)
      class(followed_motion_t), intent(in) :: self
      real(wp), dimension(self%problem%model%discretisation%harmonics%n_coefficients, self%problem%n_dofs) :: before, u
      integer :: h, i

      tone_vanishes = .false.
      associate (set => self%problem%model%discretisation%harmonics, which => self%problem%which)
         u = reshape(self%curve%x(:size(u))/self%weights, shape(u))
         before = reshape(self%curve%last%x(:size(u))/self%weights, shape(u))
         do i = 1, size(which) - 1
            if (which(i) > set%n_tones) cycle
            do h = 1, set%n_harmonics
               if (set%tuples(which(i), h) /= 0) cycle
               u(set%cos_at(h), :) = 0.0_wp
               if (set%sin_at(h) > 0) u(set%sin_at(h), :) = 0.0_wp
            end do
            tone_vanishes = tone_vanishes .or. sum(u*before) <= 0.0_wp .or. norm2(u) <= rounding*self%curve%largest
         end do
      end associate
   end function followed_motion_tone_vanishes

   !> Units of length at a motion.
   function followed_motion_units_at(self, x) result(units)
      class(followed_motion_t), intent(in) :: self
      real(wp), intent(in) :: x(:)
      real(wp) :: units(size(x))

      units = [self%weights*max(faint, norm2(x(:self%problem%n_unknowns)/self%weights)), &
               self%problem%parameter_scales(self%problem%which)]
   end function followed_motion_units_at

   !> Updates the units of length and the tolerance at the present point.
   subroutine followed_motion_update_units(self)
      class(followed_motion_t), intent(inout), target :: self
      logical :: is_possible

      call self%problem%move_to_point(self%curve%x, is_possible)
      associate (n => self%problem%n_unknowns, curve => self%curve)
         curve%largest = max(faint, curve%largest, norm2(curve%x(:n)/self%weights))
         curve%units = [self%weights*curve%largest, self%problem%parameter_scales(self%problem%which)]
         curve%corrector%tolerance = max(self%problem%model%options%solver%tolerance, &
                                         2.0_wp*self%problem%balance_t%rounding_level(curve%x(:n)), &
                                         10.0_wp*self%tolerance_factor*self%roughness)
      end associate
   end subroutine followed_motion_update_units

   !> Prepares the problem at the present point, so that a stored curve also continues from there.
   subroutine followed_motion_prepare_step(self)
      class(followed_motion_t), intent(inout), target :: self
      logical :: is_possible

      call self%problem%move_to_point(self%curve%x, is_possible)
      call self%problem%rebuild_balance()
      self%tolerance_factor = 1.0_wp
      call self%set_conditions()
   end subroutine followed_motion_prepare_step

   !> Transfers the start of this branch to the present set.
   subroutine followed_motion_transfer_start(self)
      class(followed_motion_t), intent(inout) :: self

      associate (branch_start => self%branch_start, n => size(self%problem%which))
         self%start_on_set%x = transferred(branch_start%level%set, self%level%set, branch_start%x, n)
         self%start_on_set%direction = transferred(branch_start%level%set, self%level%set, branch_start%direction, n)
      end associate
   end subroutine followed_motion_transfer_start

   !> Computes the results of a motion of the curve, with its errors in a plane.
   subroutine followed_motion_describe(self, point, plane, result, error, compares_in_time)
      class(followed_motion_t), intent(inout), target :: self
      type(waiting_t), intent(in) :: point
      type(plane_t), intent(in) :: plane                              !! across the curve there
      type(motion_result_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: compares_in_time               !! with a short time integration
      type(basis_t), target :: basis
      type(options_t) :: options
      type(solution_t) :: solution
      real(wp), target :: u(self%problem%harmonics%n_coefficients, self%problem%n_dofs)
      real(wp) :: r(self%problem%n_unknowns)
      integer :: n
      logical :: is_possible

      n = self%problem%n_unknowns
      u = reshape(point%x(:n), shape(u))
      call self%problem%move_to_point(point%x, is_possible)
      associate (balance => self%problem%balance_t, model => self%problem%model)
         call self%problem%residual(point%x(:n), r)
         result%residual = self%problem%norm(r)
         result%status = outcome%converged
         if (allocated(point%stability)) result%stability = point%stability
         result%frequency = balance%omega
         if (model%system%normal_mode%is_requested) result%artificial_damping = balance%xi
         result%n_harmonics = model%discretisation%harmonics%n_harmonics
         result%n_unknowns = n
         options = model%options
         if (present(compares_in_time)) options%compares_in_time = compares_in_time
         if (allocated(plane%functional)) call self%curve%problem%hold(plane)
         basis = whole_basis(model%discretisation%harmonics, model%discretisation%torus)
         solution%basis => basis
         solution%balance => self%problem%balance_t
         solution%u => u
         solution%problem => self%curve%problem
         call describe_motion(model%system, model%discretisation, options, solution, result, error)
      end associate
      if (allocated(error)) return
      if (self%model%options%accuracy%is_on) call apply_safety_factor(self%model%system, result)
      associate (unit => max(abs(point%x(size(point%x))), minor*abs(self%request%to - self%request%from)))
         call add_error_of_bifurcation(self%problem%model, point%bifurcation, point%shift/unit, result)
         call add_error_of_graze(self%problem%model, [point%extreme, point%switch], point%shift/unit, result)
         if (.not. self%model%options%accuracy%is_on) return
         associate (of_value => min(1.0_wp, result%error_estimate%parameter_error/unit))
            if (of_value > estimate_of(result)) result%level_estimate = of_value   ! such as at folds, which move along the value
         end associate
      end associate
      if (any(result%status == [outcome%converged, outcome%truncated, outcome%aliased])) &
         result%status = merge(outcome%converged, outcome%truncated, estimate_of(result) <= self%model%options%accuracy%tolerance)
      result%harmonics = self%level%set
      result%n_samples = self%level%n_samples
      result%n_levels = self%n_levels
   end subroutine followed_motion_describe

   !> The plane across the tangent at a point, in units of the motion there, in which its errors are estimated, if they are: it does
   !> not depend on the previous points of the curve. At a branch point, where any vector between the two curves is a
   !> tangent, steps are across both; at a given value this is held.
   function followed_motion_plane_at(self, point) result(plane)
      class(followed_motion_t), intent(inout), target :: self
      type(waiting_t), intent(in) :: point
      type(plane_t) :: plane
      type(report_t) :: report
      real(wp) :: determinant_sign, tangent(size(point%x)), units(size(point%x))
      logical :: is_crossed, is_possible, is_singular

      if (.not. self%problem%model%options%error_estimate%is_on) return
      call self%problem%move_to_point(point%x, is_possible)
      is_singular = all(abs(point%x - self%curve%x) <= 0.0_wp)        ! its tangent is the direction
      if (.not. is_singular) then
         report = self%curve%report                                   ! not counted as work of the curve
         call self%curve%tangent_at(point%x, tangent, determinant_sign, is_singular)
         self%curve%report = report
      end if
      is_crossed = point%kind == curve_kind%branch
      if (point%kind == curve_kind%start) is_crossed = self%has_left_branch()
      is_crossed = is_crossed .or. point%is_crossing
      if (is_singular) tangent = self%curve%direction
      associate (u => point%x(:self%problem%n_unknowns))
         units = [spread(max(norm2(u), tiny(1.0_wp)), 1, size(u)), self%problem%parameter_scales(self%problem%which)]
      end associate
      if (any(point%kind == [curve_kind%value, curve_kind%end]) .and. .not. is_crossed) &
         tangent = [0.0_wp*tangent(2:), units(size(units))]
      plane%functional = tangent/units**2/norm2(tangent/units)
      plane%value = dot_product(plane%functional, point%x)
      if (is_crossed) plane%units_across = units
   end function followed_motion_plane_at

   !> The unknown tones whose phases are arbitrary: all but those of a normal mode, whose amplitude has a phase.
   pure function followed_motion_free_phases(self) result(tones)
      class(followed_motion_t), intent(in) :: self
      integer, allocatable :: tones(:)
      integer :: i

      associate (system => self%model%system)
         tones = pack([(i, i=1, system%tones%n_tones)], system%tones%is_unknown .and. .not. system%normal_mode%is_requested)
      end associate
   end function followed_motion_free_phases

   !> Whether this branch begins at a branch point.
   pure logical function followed_motion_has_left_branch(self) result(has)
      class(followed_motion_t), intent(in) :: self

      has = self%branch > 0
      if (has) has = .not. self%origins(self%branch)%is_apart
   end function followed_motion_has_left_branch

   !> 1 on the first of two branches from one point, -1 on the other.
   pure real(wp) function followed_motion_sense(self) result(sense)
      class(followed_motion_t), intent(in) :: self

      sense = merge(-1.0_wp, 1.0_wp, self%is_reversed)
   end function followed_motion_sense

   !> Frees the balance; safe to call twice.
   subroutine followed_motion_destroy(self)
      class(followed_motion_t), intent(inout) :: self

      call self%problem%destroy()
      if (allocated(self%odd_problem)) call self%odd_problem%destroy()
      call self%model%discretisation%clear()
   end subroutine followed_motion_destroy
end module hb_followed_motion
