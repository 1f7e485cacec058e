!> Derivatives of a motion with respect to numbers of its model.
!> The equations R(x, p) = 0 of a motion are differentiated with respect to a value p: dx/dp = -J**-1 dR/dp, with the
!> tangent J of the solution and one linear solution for each value; unknown frequencies are part of x. The
!> derivatives of interior degrees of freedom follow from those of the structure, or from a small step along dx/dp if the
!> structure is constant. If there are more values than functions of the motion to differentiate, one solution with the
!> transposed tangent for each function takes the place of those for each value (hb_reverse_gradient). The residual at this step is
!> checked: it is of second order in the step where the equations are smooth, and of first order where contact or
!> friction begins or ends during a part of the period that the step changes. Source: docs/why/theory.md, section 6.8.
module hb_gradient
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite, ieee_quiet_nan, ieee_value
   use hb_bordered, only: bordered_problem_t, new_bordered_problem
   use hb_cancellation, only: work_is_over
   use hb_coordinates, only: coordinates_t
   use hb_discretisation, only: discretisation_t
   use hb_dynamic_stiffness, only: dynamic_stiffness_t, new_dynamic_stiffness
   use hb_error, only: error_t, fail
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_law, only: has_memory
   use hb_level, only: check_discretisation, degree_of, level_t, needed_samples, transferred, without_motion
   use hb_limit_cycle_search, only: fundamental
   use hb_model, only: model_t
   use hb_model_number, only: model_number_t, moving_value_t
   use hb_model_numbers, only: find_model_number
   use hb_model_problem, only: model_problem_t, new_model_problem
   use hb_motion_result, only: as_pairs, gradient_t, motion_result_t
   use hb_movement, only: movement_t, new_movement, set_movement
   use hb_normal_mode, only: amplitude_functionals
   use hb_options, only: options_t
   use hb_outcome, only: is_integrated, is_solved
   use hb_phase, only: coefficient_functional, shift_functional
   use hb_problem, only: problem_t
   use hb_response_slope, only: find_motion_slopes
   use hb_system, only: coordinates_of, system_t
   use hb_tangent_solver, only: new_tangent_solver, tangent_solver_t
   use hb_thresholds, only: difference_step, location_tolerance, small_share, well_solved
   use hb_tuple_choice, only: new_doubled_set
   implicit none
   private
   public :: differentiable_t, differentiate_to_tolerance, find_gradient, store_slope, zero_gradient

   !> A motion that may be differentiated on any set and grid.
   type, abstract :: differentiable_t
   contains
      procedure(differentiate_on), deferred :: differentiate
   end type differentiable_t

   abstract interface
      !> Computes its derivatives on a set and grid; they are NaN if the tangent is singular or no motion is found.
      subroutine differentiate_on(self, level, gradient, error)
         import :: differentiable_t, error_t, gradient_t, level_t
         class(differentiable_t), intent(inout) :: self
         type(level_t), intent(in) :: level                           !! without unknowns
         type(gradient_t), intent(out) :: gradient
         type(error_t), allocatable, intent(out) :: error
      end subroutine differentiate_on
   end interface

   !> The motion of given values.
   type, extends(differentiable_t) :: known_t
      type(model_t) :: model                                          ! on its set and grid, at its frequencies
      integer, allocatable :: tones(:)                                ! numbers of the unknown ones
      integer, allocatable :: which(:)                                ! likewise of parameters: with the damping of a normal mode
      real(wp), allocatable :: x(:)                                   ! coefficients, then these parameters
      real(wp), allocatable :: residual(:)                            ! of the balance at x
      real(wp), allocatable :: slopes(:, :)                           ! of x by each value, on the level before
      real(wp) :: accuracy = location_tolerance                       ! relative, of these
      integer :: n = 0                                                ! coefficients
   contains
      procedure :: differentiate => known_differentiate
   end type known_t

   ! Reverse mode; bodies in hb_reverse_gradient
   interface
      !> Differentiates by all values that suit reverse mode, if these are more than the functions of the motion.
      module subroutine differentiate_in_reverse(known, here, problem, tangent, gradient, is_done, strongest)
         type(known_t), intent(inout) :: known                        !! unchanged
         type(model_problem_t), intent(inout) :: here                 !! at the motion
         class(problem_t), intent(inout) :: problem                   !! with unknown frequencies
         type(tangent_solver_t), intent(inout) :: tangent
         type(gradient_t), intent(inout) :: gradient
         logical, intent(inout) :: is_done(:)                         !! (values)
         integer, intent(out) :: strongest                            !! value done with the largest effect; 0: none
      end subroutine differentiate_in_reverse
   end interface

contains

   !> Adds the derivatives to a result, if any are requested and the motion is one of the balance; there are none if
   !> its tangent is singular.
   subroutine find_gradient(system, options, level, unknowns, result)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(level_t), intent(in) :: level                              !! set and grid of the motion
      real(wp), allocatable, intent(in) :: unknowns(:)                !! ordered as those of hb_level%level_t
      type(motion_result_t), intent(inout) :: result
      type(error_t), allocatable :: error
      type(known_t) :: known
      type(coordinates_t) :: coordinates
      type(level_t) :: own

      coordinates = coordinates_of(system)
      if (size(options%gradient%by) == 0 .or. .not. is_solved(result%status) .or. .not. allocated(result%coefficients)) return
      if (is_integrated(result%status)) return ! not a motion of a balance
      if (coordinates%n > 0 .and. .not. allocated(unknowns)) return
      own = without_motion(level)
      known%model%system = system
      nullify (known%model%system%contact_parts)                      ! derivatives need contacts condensed
      known%model%discretisation = level%discretisation_t
      known%model%options = options
      call check_discretisation(system, level%discretisation_t, options, error)
      if (.not. allocated(error)) then
         if (coordinates%n == 0) then
            call differentiate_without_laws(known, result%gradient, error)
         else
            call set_motion(known, unknowns, result%artificial_damping)
            call differentiate(known, result%gradient, error)
         end if
      end if
      if (allocated(error)) then                                      ! the motion itself remains a result
         result%gradient = gradient_t()
         if (.not. (work_is_over() .or. allocated(result%message))) result%message = "no derivatives: "//error%message
         return
      end if
      if (coordinates%n > 0 .and. allocated(result%gradient%coefficients)) &
         call differentiate_to_tolerance(known, known%model%system, known%model%options, own, result%gradient)
      call note_no_response(options, result)
   end subroutine find_gradient

   !> Reports that the requested response is zero: its amplitude has no derivative there.
   subroutine note_no_response(options, result)
      type(options_t), intent(in) :: options
      type(motion_result_t), intent(inout) :: result

      if (.not. allocated(options%gradient%of) .or. allocated(result%message)) return
      if (allocated(result%gradient%weights) .or. .not. allocated(result%gradient%response)) return
      result%message = "no derivatives: '"//options%gradient%of%name//"' is zero, or not in the set of harmonics"
   end subroutine note_no_response

   !> Sets the motion that is differentiated, and the accuracy of its derivatives.
   subroutine set_motion(known, unknowns, artificial_damping)
      type(known_t), intent(inout) :: known                           !! with its model
      real(wp), intent(in) :: unknowns(:)                             !! ordered as those of hb_level%level_t
      real(wp), allocatable, intent(in) :: artificial_damping(:)      !! of a normal mode, (n_tones)
      integer :: m

      associate (accuracy => known%model%options%accuracy)
         if (accuracy%is_on .and. (accuracy%grows_set .or. accuracy%refines_grid)) &
            known%accuracy = max(location_tolerance, well_solved*accuracy%tolerance)
      end associate
      associate (system => known%model%system)
         known%n = size(unknowns) - system%tones%n_tones
         system%tones%omega = unknowns(known%n + 1:)
         known%tones = pack([(m, m=1, system%tones%n_tones)], system%tones%is_unknown)
         known%which = known%tones
         known%x = [unknowns(:known%n), system%tones%omega(known%tones)]
         if (.not. system%normal_mode%is_requested) return
         known%which = [known%which, system%tones%n_tones + known%tones]
         known%x = [known%x, artificial_damping(known%tones)]
      end associate
   end subroutine set_motion

   !> Differentiates a motion without laws by all values.
   subroutine differentiate_without_laws(known, gradient, error)
      type(known_t), intent(inout) :: known                           !! unchanged
      type(gradient_t), intent(out) :: gradient
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      gradient = zero_gradient(known%model%system, known%model%options, known%model%discretisation%harmonics)
      do k = 1, size(known%model%options%gradient%by)
         call differentiate_linear(known, k, gradient, error)
         if (allocated(error)) return
      end do
   end subroutine differentiate_without_laws

   !> Differentiates a motion without laws: it is computed on both sides of the value.
   subroutine differentiate_linear(known, k, gradient, error)
      type(known_t), intent(inout) :: known                           !! unchanged
      integer, intent(in) :: k                                        !! number of the value
      type(gradient_t), intent(inout) :: gradient
      type(error_t), allocatable, intent(out) :: error
      complex(wp), allocatable :: c(:, :, :)
      type(model_t) :: there
      type(movement_t) :: movement
      type(dynamic_stiffness_t) :: stiffness
      real(wp) :: step, value
      integer :: side
      logical :: is_found

      associate (model => known%model, by => known%model%options%gradient%by(k), set => known%model%discretisation%harmonics)
         call find_model_number(known%model, by, value, is_found)
         call new_movement(movement, known%model, by, .false., error)
         if (allocated(error)) return
         step = difference_step*merge(abs(value), 1.0_wp, abs(value) > 0.0_wp)
         allocate (c(model%system%structure%n_dofs, set%n_harmonics, 2))
         do side = 1, 2
            there = model
            call set_movement(there, movement, value + (2*side - 3)*step, error)
            if (.not. allocated(error)) &
               call new_dynamic_stiffness(stiffness, there%system%structure, coordinates_of(there%system), &
               set%frequencies(there%system%tones%omega), there%system%loads_in(set), error, &
               tuples=set%tuples)
            if (allocated(error)) return
            call stiffness%recover(reshape([complex(wp) ::], [0, set%n_harmonics]), c(:, :, side))
            gradient%frequency(:, k) = gradient%frequency(:, k) + (2*side - 3)*there%system%tones%omega/(2.0_wp*step)
         end do
         call weigh_response(model%options, set, 0.5_wp*(c(:, :, 1) + c(:, :, 2)), gradient)
         call store_slope(gradient, dofs_of(model%options), k, (c(:, :, 2) - c(:, :, 1))/(2.0_wp*step))
      end associate
   end subroutine differentiate_linear

   !> Degrees of freedom whose derivatives are requested.
   pure function dofs_of(options) result(dofs)
      type(options_t), intent(in) :: options
      integer, allocatable :: dofs(:)

      dofs = options%output%dofs
      if (allocated(options%gradient%of)) dofs = [options%gradient%of%dof]
   end function dofs_of

   !> Finds the differential of the requested response, if there is one, at a motion of all degrees of freedom.
   pure subroutine weigh_response(options, set, c, gradient)
      type(options_t), intent(in) :: options
      type(harmonics_t), intent(in) :: set
      complex(wp), intent(in) :: c(:, :)                              !! (n_dofs, n_harmonics)
      type(gradient_t), intent(inout) :: gradient

      if (allocated(options%gradient%of)) &
         call options%gradient%of%find_weights(set, c(options%gradient%of%dof, :), gradient%weights)
   end subroutine weigh_response

   !> Differentiates the same motion in wider sets and on finer grids. A derivative may need tuples that are almost
   !> zero in the motion, such as those that a load of amplitude zero would excite. The time at which contact or
   !> friction changes is known to within one sample, which has little effect on the motion and a large one on its
   !> derivatives. A set or grid chosen from the tolerance is made wider or finer until the derivatives change by less
   !> than the tolerance; a given set is not changed, and a given grid is not either, but the change on a finer one is
   !> reported.
   subroutine differentiate_to_tolerance(motion, system, options, own, gradient)
      class(differentiable_t), intent(inout) :: motion
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(level_t), intent(in) :: own                                !! of the present derivatives
      type(gradient_t), intent(inout) :: gradient
      type(gradient_t) :: finer
      type(error_t), allocatable :: error
      type(level_t) :: next
      logical :: has_room, is_exact, refines_set, refines_grid

      is_exact = degree_of(system) > 0
      refines_set = options%accuracy%is_on .and. options%accuracy%grows_set
      refines_grid = options%accuracy%is_on .and. options%accuracy%refines_grid
      if (is_exact .and. .not. refines_set) return
      gradient%estimate = ieee_value(1.0_wp, ieee_quiet_nan)          ! unless there is room for a check
      next = own
      do
         call refine_level()
         if (.not. has_room) return
         call motion%differentiate(next, finer, error)
         if (allocated(error) .or. .not. allocated(finer%coefficients)) return
         finer%coefficients = in_set(finer%coefficients, next%harmonics, own%harmonics)
         finer%estimate = changes_of(finer, gradient)
         gradient%estimate = finer%estimate
         if (refines_set .or. refines_grid) gradient = finer
         if (.not. (refines_set .or. refines_grid) .or. all(finer%estimate <= options%accuracy%tolerance)) return
      end do

   contains

      !> Makes the next level twice as fine, in what limits the accuracy; whether the limits of the accuracy permit it.
      subroutine refine_level()
         type(level_t) :: before

         before = next
         has_room = .false.
         if (refines_set) call new_doubled_set(next%harmonics, before%harmonics, error)
         if (allocated(error)) return
         if (is_exact .and. refines_grid) call next%torus%resample(needed_samples(next%harmonics%highest, degree_of(system)))
         if (.not. is_exact) call next%torus%resample(2*next%torus%n_samples)
         has_room = .not. (product(real(next%torus%n_samples, wp)) >= small_share*options%accuracy%max_samples .or. &
                           any(next%torus%n_samples <= 2*next%harmonics%highest) .or. &
                           next%harmonics%n_harmonics > options%accuracy%max_harmonics)
      end subroutine refine_level
   end subroutine differentiate_to_tolerance

   !> Relative changes of derivatives, of the response or of all coefficients, (values).
   pure function changes_of(finer, coarse) result(changes)
      type(gradient_t), intent(in) :: finer, coarse                   !! with the same harmonics
      real(wp) :: changes(size(coarse%estimate))
      integer :: k

      if (allocated(coarse%response)) then
         changes = abs(finer%response - coarse%response)/max(abs(finer%response), tiny(1.0_wp))
      else
         changes = [(norm2(finer%coefficients(:, :, :, k) - coarse%coefficients(:, :, :, k))/ &
                     max(norm2(finer%coefficients(:, :, :, k)), tiny(1.0_wp)), k=1, size(changes))]
      end if
   end function changes_of

   !> Coefficients of the tuples of another set, all of which `set` contains.
   pure function in_set(coefficients, set, other)
      real(wp), intent(in) :: coefficients(:, :, :, :)                !! as those of hb_motion_result%gradient_t
      type(harmonics_t), intent(in) :: set, other
      real(wp), allocatable :: in_set(:, :, :, :)
      integer :: h

      in_set = coefficients(:, [(set%index_of(other%tuples(:, h)), h=1, other%n_harmonics)], :, :)
   end function in_set

   !> Derivatives that are all zero.
   pure function zero_gradient(system, options, set) result(gradient)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(harmonics_t), intent(in) :: set
      type(gradient_t) :: gradient

      associate (n => size(options%gradient%by), has_response => allocated(options%gradient%of))
         allocate (gradient%coefficients(2, set%n_harmonics, merge(0, size(options%output%dofs), has_response), n), source=0.0_wp)
         if (has_response) allocate (gradient%response(n), source=ieee_value(1.0_wp, ieee_quiet_nan))
         allocate (gradient%frequency(system%tones%n_tones, n), source=0.0_wp)
         allocate (gradient%position(n), gradient%defect(n), gradient%estimate(n), source=0.0_wp)
      end associate
   end function zero_gradient

   !> Differentiates the motion on another set and grid, after a step of Newton's method.
   subroutine known_differentiate(self, level, gradient, error)
      class(known_t), intent(inout) :: self
      type(level_t), intent(in) :: level
      type(gradient_t), intent(out) :: gradient
      type(error_t), allocatable, intent(out) :: error
      type(harmonics_t) :: before
      real(wp), allocatable :: slopes(:, :)
      integer :: k

      before = self%model%discretisation%harmonics
      self%model%discretisation = level%discretisation_t
      call check_discretisation(self%model%system, self%model%discretisation, self%model%options, error)
      if (allocated(error)) return
      self%x = transferred(before, level%harmonics, self%x, size(self%which))
      self%n = size(self%x) - size(self%which)
      if (allocated(self%slopes)) then
         call move_alloc(self%slopes, slopes)
         allocate (self%slopes(size(self%x), size(slopes, 2)))
         do k = 1, size(slopes, 2)
            self%slopes(:, k) = transferred(before, level%harmonics, slopes(:, k), size(self%which))
         end do
      end if
      deallocate (self%residual)
      call differentiate(self, gradient, error, corrects=level%harmonics%n_harmonics > before%n_harmonics)
   end subroutine known_differentiate

   !> Differentiates with respect to each of the values; the derivatives are NaN if the tangent is singular.
   subroutine differentiate(known, gradient, error, corrects)
      type(known_t), intent(inout) :: known
      type(gradient_t), intent(out) :: gradient
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: corrects                       !! first correct the motion by a step of Newton's method
      class(model_problem_t), allocatable, target :: here, moved
      type(bordered_problem_t), target :: with_frequencies
      class(problem_t), pointer :: problem
      type(tangent_solver_t) :: tangent
      complex(wp), allocatable :: c(:, :)
      logical :: is_done(size(known%model%options%gradient%by)), is_found, is_lost
      integer :: k, strongest

      associate (by => known%model%options%gradient%by, n => known%n)
         gradient = zero_gradient(known%model%system, known%model%options, known%model%discretisation%harmonics)
         allocate (here, moved)
         call express_by(known, here, by(1), 1.0_wp, error)
         if (allocated(error)) return
         problem => here
         if (size(known%tones) > 0) then
            associate (functionals => conditions(known, here))
               call new_bordered_problem(with_frequencies, here, known%which, functionals, matmul(known%x(:n), functionals))
            end associate
            problem => with_frequencies
         end if
         if (.not. allocated(known%residual)) allocate (known%residual(n))
         if (present(corrects)) then
            if (corrects) call correct(known, problem)
         end if
         call here%set_parameters(known%which, known%x(n + 1:), is_found)
         call here%residual(known%x(:n), known%residual)
         allocate (c(known%model%system%structure%n_dofs, known%model%discretisation%harmonics%n_harmonics))
         call here%all_dofs(known%x(:n), c)
         call weigh_response(known%model%options, known%model%discretisation%harmonics, c, gradient)
         call new_tangent_solver(tangent, problem, known%x, is_lost, known%accuracy, &
                                 are_many=suits_factors(known%model%system, size(by)))
         if (.not. allocated(known%slopes)) allocate (known%slopes(size(known%x), size(by)), source=0.0_wp)
         is_done = .false.
         strongest = 0
         if (.not. is_lost) call differentiate_in_reverse(known, here, problem, tangent, gradient, is_done, strongest)
         if (strongest > 0 .and. degree_of(known%model%system) == 0) then   ! its defect is that of all, if there may be one
            call differentiate_by(known, moved, problem, tangent, strongest, gradient, is_lost, error)
            gradient%defect = merge(gradient%defect(strongest), gradient%defect, is_done)
         end if
         do k = 1, size(by)
            if (is_lost .or. allocated(error) .or. work_is_over()) exit
            if (.not. is_done(k)) call differentiate_by(known, moved, problem, tangent, k, gradient, is_lost, error)
         end do
      end associate
      is_lost = is_lost .or. allocated(error) .or. work_is_over()
      if (is_lost) gradient = gradient_t()
      call here%destroy()
      call moved%destroy()
   end subroutine differentiate

   !> Whether factors of the tangent cost less than a solution from products for each value: under friction with memory, whose
   !> products integrate the states of its sliders, from the second value on, at stops from the fourth.
   pure logical function suits_factors(system, n_values)
      type(system_t), intent(in) :: system
      integer, intent(in) :: n_values

      suits_factors = degree_of(system) == 0 .and. n_values >= merge(2, 4, has_memory(system%laws))
   end function suits_factors

   !> Differentiates by one value, with a solution of its own.
   subroutine differentiate_by(known, moved, problem, tangent, k, gradient, is_lost, error)
      type(known_t), intent(inout) :: known                           !! unchanged but for `slopes`
      type(model_problem_t), intent(inout) :: moved                   !! the balance as a function of the value, created or adapted
      class(problem_t), intent(inout) :: problem                      !! at the motion, with unknown frequencies
      type(tangent_solver_t), intent(inout) :: tangent                !! of this problem
      integer, intent(in) :: k                                        !! number of the value
      type(gradient_t), intent(inout) :: gradient
      logical, intent(inout) :: is_lost                               !! becomes true if the tangent is singular
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: by_value(known%n), slope(size(known%x)), typical, value
      integer :: attempt
      logical :: is_found

      associate (number => known%model%options%gradient%by(k), n => known%n)
         call find_model_number(known%model, number, value, is_found)
         typical = abs(value)
         if (.not. typical > 0.0_wp) typical = 1.0_wp
         do attempt = 1, 2
            call express_by(known, moved, number, typical, error)
            if (allocated(error)) return
            call moved%set_parameters(known%which, known%x(n + 1:), is_found)
            call moved%parameter_derivative(known%x(:n), moved%own, by_value)
            slope = 0.0_wp
            slope(:n) = -by_value
            call tangent%solve(problem, slope, is_lost, guess=known%slopes(:, k))
            if (is_lost .or. abs(value) > 0.0_wp .or. .not. norm2(slope(:n)) > 0.0_wp) exit
            typical = norm2(known%x(:n))/norm2(slope(:n))             ! of a value of zero: the change with a comparable effect
         end do
         if (is_lost) return
         known%slopes(:, k) = slope
         call step_to_both_sides(known, moved, value, difference_step*typical, slope, by_value, k, gradient)
         if (all(ieee_is_finite(gradient%frequency(:, k)))) return
         if (.not. allocated(moved%refusal%text)) moved%refusal%text = "it is rejected on both sides of its value"
         call fail(error, trim(number%name)//" cannot change by itself: "//moved%refusal%text)
      end associate
   end subroutine differentiate_by

   !> Makes a problem the balance as a function of a number.
   subroutine express_by(known, problem, number, typical, error)
      type(known_t), intent(inout) :: known                           !! unchanged
      type(model_problem_t), intent(inout) :: problem
      type(model_number_t), intent(in) :: number
      real(wp), intent(in) :: typical                                 !! value
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: at
      logical :: is_done, is_found

      call find_model_number(known%model, number, at, is_found)
      call problem%choose_number(moving_value_t(number, typical), at, is_done)
      if (.not. is_done) call new_model_problem(problem, known%model%system, known%model%discretisation, known%model%options, &
                                                moving_value_t(number, typical), at, error)
   end subroutine express_by

   !> Corrects the motion by a step of Newton's method, unless the step increases the residual.
   subroutine correct(known, problem)
      type(known_t), intent(inout) :: known
      class(problem_t), intent(inout) :: problem
      type(tangent_solver_t) :: tangent
      real(wp), dimension(size(known%x)) :: r, r_after, step
      logical :: is_lost

      call problem%residual(known%x, r)
      call new_tangent_solver(tangent, problem, known%x, is_lost, known%accuracy)
      if (is_lost) return
      step = r
      call tangent%solve(problem, step, is_lost)
      if (is_lost) return
      call problem%residual(known%x - step, r_after)
      if (.not. norm2(r_after/problem%r_scale) <= norm2(r/problem%r_scale)) return
      known%x = known%x - step
      known%model%system%tones%omega(known%tones) = known%x(known%n + 1:known%n + size(known%tones))
   end subroutine correct

   !> Conditions for the phases of unknown tones: sines that are zero, or no component along a shift of the motion. Those
   !> of a normal mode are its phase and its amplitude.
   function conditions(known, problem) result(functionals)
      type(known_t), intent(in) :: known
      type(model_problem_t), intent(in) :: problem
      real(wp), allocatable :: functionals(:, :)
      real(wp), dimension(problem%harmonics%n_coefficients, problem%n_dofs) :: scale, u
      integer :: i

      u = reshape(known%x(:known%n), shape(u))
      scale = reshape(problem%x_scale, shape(u))
      allocate (functionals(size(u), size(known%which)))
      associate (set => problem%harmonics, dofs => known%model%system%phase_dofs, mode => known%model%system%normal_mode)
         if (mode%is_requested) then
            functionals = amplitude_functionals(set, problem%n_dofs, problem%stiffness%coordinates%number_of(mode%dof), &
                                                known%tones(1), mode%is_peak)
            return
         end if
         do i = 1, size(known%tones)
            if (size(dofs) > 0) then
               functionals(:, i) = coefficient_functional(set, problem%n_dofs, set%sin_at(fundamental(set, known%tones(i))), &
                                                          problem%stiffness%coordinates%number_of(dofs(i)))
            else
               functionals(:, i) = shift_functional(set, known%tones(i), u, scale)
            end if
         end do
      end associate
   end function conditions

   !> Takes steps to both sides along the derivative: they give the derivatives of all degrees of freedom and the
   !> residual.
   subroutine step_to_both_sides(known, moved, value, step, slope, by_value, k, gradient)
      type(known_t), intent(inout) :: known                           !! unchanged
      type(model_problem_t), intent(inout) :: moved
      real(wp), intent(in) :: value, step
      real(wp), intent(in) :: slope(:), by_value(:)                   !! derivatives of the unknowns, and of the equations
      integer, intent(in) :: k                                        !! number of the value
      type(gradient_t), intent(inout) :: gradient
      complex(wp), allocatable :: c(:, :, :), slopes(:, :)
      real(wp) :: at(2), omega(known%model%system%tones%n_tones, 2), r(known%n), x(size(slope))
      integer :: side
      logical :: has_slopes, is_possible

      allocate (c(known%model%system%structure%n_dofs, known%model%discretisation%harmonics%n_harmonics, 2))
      call find_slopes()
      associate (n => known%n)
         do side = 1, 2
            at(side) = (2*side - 3)*step
            call move_to_side(is_possible)
            if (.not. is_possible) then                               ! at the end of the range of the value
               at(side) = 0.0_wp
               call move_to_side(is_possible)
            end if
            if (.not. has_slopes) call moved%all_dofs(x(:n), c(:, :, side))
            omega(:, side) = moved%omega
            call moved%residual(x(:n), r)
            gradient%defect(k) = max(gradient%defect(k), norm2((r - known%residual)/moved%r_scale)/ &
                                     max(step*norm2(by_value/moved%r_scale), tiny(1.0_wp)))
         end do
         if (.not. at(2) > at(1)) then                                 ! the value is rejected on both sides
            gradient%frequency(:, k) = ieee_value(1.0_wp, ieee_quiet_nan)
            return
         end if
         gradient%frequency(:, k) = (omega(:, 2) - omega(:, 1))/(at(2) - at(1))
         gradient%frequency(known%tones, k) = slope(n + 1:n + size(known%tones))
         if (.not. has_slopes) slopes = (c(:, :, 2) - c(:, :, 1))/(at(2) - at(1))
         call store_slope(gradient, dofs_of(known%model%options), k, slopes)
      end associate

   contains

      !> If the structure moves, differences of the motion of its interior would lose the digits that the condition number
      !> of the interior costs.
      subroutine find_slopes()
         type(error_t), allocatable :: error
         type(movement_t) :: movement
         real(wp) :: typical
         integer :: h

         call new_movement(movement, known%model, known%model%options%gradient%by(k), .false., error)
         has_slopes = movement%structure .and. .not. moved%moves_coordinates()
         if (.not. has_slopes) return
         typical = step/difference_step
         moved%which = [known%which, moved%own]
         allocate (slopes(known%model%system%structure%n_dofs, known%model%discretisation%harmonics%n_harmonics))
         call find_motion_slopes(moved, [known%x, value], typical*[slope, 1.0_wp], [(h, h=1, size(slopes, 2))], slopes, has_slopes)
         slopes = slopes/typical
      end subroutine find_slopes

      subroutine move_to_side(is_possible)
         logical, intent(out) :: is_possible

         x = known%x + at(side)*slope
         call moved%set_parameters([known%which, moved%own], [x(known%n + 1:), value + at(side)], is_possible)
      end subroutine move_to_side
   end subroutine step_to_both_sides

   !> Stores the derivatives of the stored degrees of freedom with respect to one value.
   pure subroutine store_slope(gradient, dofs, k, slope)
      type(gradient_t), intent(inout) :: gradient
      integer, intent(in) :: dofs(:)                                  !! of a response its only one
      integer, intent(in) :: k
      complex(wp), intent(in) :: slope(:, :)                          !! a - i b, (n_dofs, n_harmonics)

      if (.not. allocated(gradient%response)) then
         gradient%coefficients(:, :, :, k) = as_pairs(slope(dofs, :))
      else if (allocated(gradient%weights)) then
         gradient%response(k) = real(sum(conjg(gradient%weights)*slope(dofs(1), :)), wp)
      end if
   end subroutine store_slope
end module hb_gradient
