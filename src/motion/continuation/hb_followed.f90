!> What is followed along a curve, abstractly: equations of an unknown motion and of a value, the functions of a point that events
!> compare, and the results of a point. A balance (hb_balance_branch) is one, the period map of motions with impacts
!> (hb_orbit_branch) another.
!>
!> It has neither a point nor a direction: these are in the curve, to whose point the equations move when it is passed.
module hb_followed
   use hb_bordered, only: bordered_problem_t, plane_t
   use hb_curve, only: curve_config_t, curve_t, new_curve, path_t
   use hb_curve_branches, only: branches_t, origin_t
   use hb_curve_course, only: curve_course_t
   use hb_curve_events, only: event_values_t
   use hb_curve_points, only: curve_point_t
   use hb_curve_request, only: curve_request_t
   use hb_discretisation, only: discretisation_t
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_level, only: level_t, without_motion
   use hb_located_response, only: located_response_t, response_series_t
   use hb_model, only: model_t
   use hb_motion_result, only: curve_position_t, motion_result_t
   use hb_options, only: options_t
   use hb_outcome, only: outcome
   use hb_point_kinds, only: curve_kinds
   use hb_solver_types, only: solver_config_t
   use hb_stability, only: stability_t
   use hb_system, only: system_t
   implicit none
   private
   public :: curve_state_t, followed_t, step_accuracy_t

   real(wp), parameter :: desired_turn = 0.12_wp                      ! [rad] per step
   real(wp), parameter :: factor_without_laws = 2.5_wp                ! of steps: 30 points of a resonance circle
   real(wp), parameter :: max_tolerance_factor = 1.0e4_wp             ! by which a tolerance increases for a rough residual

   !> A point of a curve, to which it can go back on the same or on another set: a value.
   type :: curve_state_t
      type(level_t) :: level                                          !! set and grid
      type(path_t) :: path
      type(event_values_t) :: at_point                                !! what events compare
   end type curve_state_t

   !> What is known of the accuracy of the last step.
   type :: step_accuracy_t
      real(wp) :: estimate = huge(1.0_wp)                             !! of the error at its end; huge: not known
      logical :: is_out_of_work = .false.                             !! it has used up the work of a point
   end type step_accuracy_t

   !> Owns external resources: call `destroy`. A variable of this type needs the attribute `target`.
   type, abstract :: followed_t
      type(model_t) :: model                                          !! at the start, as read
      type(curve_request_t) :: request
      type(level_t) :: level                                          !! present set and grid
      integer :: n_further = 1                                        !! unknowns besides those of the motion: the last is the value
      logical :: has_all_harmonics = .true.                           !! of the period: the determinant shows all intersections
      logical :: has_integrated_multipliers = .false.                 !! of the motion: more accurate than those of its series
      logical :: may_jump_within_period = .false.                     !! by a slow tone, which error estimates do not see
      integer :: n_levels = 1                                         !! of the last step
      real(wp) :: roughness = 0.0_wp !! of the residual as a function of frequencies, at the start of this branch
      logical :: is_rough = .false.                                   !! above the tolerance
      real(wp) :: tolerance_factor = 1.0_wp                           !! by which the tolerance may have increased along the branch
   contains
      ! Start
      procedure(find_first), deferred :: find_first
      procedure(resume), deferred :: resume
      procedure(adopt_level), deferred :: adopt_level
      procedure :: adopt_request => followed_adopt_request
      procedure :: prepare => followed_prepare
      procedure :: pack => followed_pack
      procedure :: unpack => followed_unpack
      procedure :: on_level => followed_on_level
      ! Equations at a point
      procedure(border), deferred :: border
      procedure(config), deferred :: config
      procedure(corrector), deferred :: corrector
      procedure(correct_on_plane), deferred :: correct_on_plane
      procedure(units_at), deferred :: units_at
      procedure(update_units), deferred :: update_units
      procedure(prepare_step), deferred :: prepare_step
      procedure :: find_roughness => followed_find_roughness
      procedure :: relax => followed_relax
      procedure :: usual_config => followed_usual_config
      procedure :: begin_curve => followed_begin_curve
      procedure :: place => followed_place
      procedure :: turn_to => followed_turn_to
      procedure :: restrict_to_symmetry => followed_restrict_to_symmetry
      ! Steps
      procedure(make_step), deferred :: make_step
      procedure :: has_jumped => followed_has_jumped
      procedure :: tone_vanishes => followed_tone_vanishes
      procedure :: retained_doubling => followed_retained_doubling
      procedure :: find_separate => followed_find_separate
      procedure(fault_near), deferred :: fault_near
      ! Images, which differ in their phases alone
      procedure :: has_images => followed_has_images
      procedure :: bring_near => followed_bring_near
      procedure :: find_drifting_tones => followed_find_drifting_tones
      ! Functions of a point
      procedure(slope_at), deferred :: slope_at
      procedure(find_series), deferred :: find_series
      procedure(find_stability), deferred :: find_stability
      procedure(find_contact), deferred :: find_contact
      procedure :: evaluate => followed_evaluate
      procedure :: function_at => followed_function_at
      procedure :: square_at => followed_square_at
      procedure :: unit_of_function => followed_unit_of_function
      ! Results
      procedure(describe), deferred :: describe
      procedure :: plane_at => followed_plane_at
      procedure :: find_gradient => followed_find_gradient
      procedure(system_at), deferred :: system_at
      procedure(destroy), deferred :: destroy
   end type followed_t

   abstract interface
      !> Finds the first motion of the requested curve, and its direction if the curve leaves another one.
      subroutine find_first(self, model, first, result, is_described, error)
         import :: error_t, followed_t, model_t, motion_result_t, origin_t
         class(followed_t), intent(inout), target :: self
         type(model_t), intent(inout) :: model                        !! at the start
         type(origin_t), intent(out) :: first                         !! `x` is not allocated if none is found
         type(motion_result_t), intent(inout) :: result               !! of it, if it is described; without a motion the reason
         logical, intent(out) :: is_described
         type(error_t), allocatable, intent(out) :: error
      end subroutine find_first

      !> Replaces `find_first`: prepares the equations for a stored curve.
      subroutine resume(self, model, stored, error)
         import :: curve_position_t, error_t, followed_t, model_t
         class(followed_t), intent(inout), target :: self
         type(model_t), intent(in) :: model                           !! at the start
         type(curve_position_t), intent(in) :: stored(:)
         type(error_t), allocatable, intent(out) :: error
      end subroutine resume

      !> Sets up the equations on a set and a grid, at the start of the curve.
      subroutine adopt_level(self, level, error)
         import :: error_t, followed_t, level_t
         class(followed_t), intent(inout), target :: self
         type(level_t), intent(in) :: level
         type(error_t), allocatable, intent(out) :: error
      end subroutine adopt_level

      !> The equations with their conditions at a point, and a last functional.
      subroutine border(self, x, functional, problem)
         import :: bordered_problem_t, followed_t, wp
         class(followed_t), intent(inout), target :: self
         real(wp), intent(in) :: x(:), functional(:)
         type(bordered_problem_t), intent(out) :: problem
      end subroutine border

      !> Settings of the step control.
      pure type(curve_config_t) function config(self)
         import :: curve_config_t, followed_t
         class(followed_t), intent(in) :: self
      end function config

      !> Settings of the corrector of steps.
      pure type(solver_config_t) function corrector(self)
         import :: followed_t, solver_config_t
         class(followed_t), intent(in) :: self
      end function corrector

      !> Corrects a motion in the plane across a direction; for curves that begin there.
      subroutine correct_on_plane(self, x, direction, is_found)
         import :: followed_t, wp
         class(followed_t), intent(inout), target :: self
         real(wp), intent(inout) :: x(:)
         real(wp), intent(in) :: direction(:)
         logical, intent(out) :: is_found
      end subroutine correct_on_plane

      !> Units of length at a motion.
      function units_at(self, x) result(units)
         import :: followed_t, wp
         class(followed_t), intent(in) :: self
         real(wp), intent(in) :: x(:)
         real(wp) :: units(size(x))
      end function units_at

      !> Updates the units of length and the tolerance of a curve at its point.
      subroutine update_units(self, curve)
         import :: curve_t, followed_t
         class(followed_t), intent(inout), target :: self
         type(curve_t), intent(inout) :: curve
      end subroutine update_units

      !> Prepares the equations at the point of a curve, so that a stored curve also continues from there.
      subroutine prepare_step(self, curve, start)
         import :: curve_t, followed_t, origin_t
         class(followed_t), intent(inout), target :: self
         type(curve_t), intent(inout) :: curve
         type(origin_t), intent(inout) :: start                       !! of the branch, which moves with the section
      end subroutine prepare_step

      !> Performs one step, to the tolerance if one is requested, and returns its points.
      subroutine make_step(self, curve, at_point, branches, course, accuracy, points, error)
         import :: branches_t, curve_course_t, curve_point_t, curve_t, error_t, event_values_t, followed_t, step_accuracy_t
         class(followed_t), intent(inout), target :: self
         type(curve_t), intent(inout), target :: curve
         type(event_values_t), intent(inout), target :: at_point
         type(branches_t), intent(inout), target :: branches
         type(curve_course_t), intent(in) :: course
         type(step_accuracy_t), intent(inout) :: accuracy
         type(curve_point_t), allocatable, intent(out) :: points(:)
         type(error_t), allocatable, intent(out) :: error
      end subroutine make_step

      !> Why there are no motions at a value or next to it: it is rejected, or a law cannot continue; blank: not known.
      pure function fault_near(self, value, distance) result(text)
         import :: followed_t, wp
         class(followed_t), intent(in) :: self
         real(wp), intent(in) :: value, distance
         character(500) :: text
      end function fault_near

      !> Derivative of the square of a response along a direction; NaN if the parameters are rejected.
      real(wp) function slope_at(self, response, x, direction)
         import :: followed_t, located_response_t, wp
         class(followed_t), intent(inout), target :: self
         type(located_response_t), intent(in) :: response
         real(wp), intent(in) :: x(:), direction(:)
      end function slope_at

      !> The motion of the degree of freedom of a response.
      subroutine find_series(self, response, x, series)
         import :: followed_t, located_response_t, response_series_t, wp
         class(followed_t), intent(inout), target :: self
         type(located_response_t), intent(in) :: response
         real(wp), intent(in) :: x(:)
         type(response_series_t), intent(out) :: series
      end subroutine find_series

      !> Stability of the motion.
      subroutine find_stability(self, x, tolerance, stability, is_integrated)
         import :: followed_t, stability_t, wp
         class(followed_t), intent(inout), target :: self
         real(wp), intent(in) :: x(:), tolerance
         type(stability_t), intent(out) :: stability                  !! without multipliers if they are not found
         logical, intent(in), optional :: is_integrated               !! of the integrated periodic motion
      end subroutine find_stability

      !> Distances of the motion from contact: extremes of the switching functions, or impacts in a period.
      subroutine find_contact(self, x, known)
         import :: event_values_t, followed_t, wp
         class(followed_t), intent(inout), target :: self
         real(wp), intent(in) :: x(:)
         type(event_values_t), intent(inout) :: known
      end subroutine find_contact

      !> Computes the results of a point, with its errors in a plane.
      subroutine describe(self, curve, point, plane, result, error, compares_in_time)
         import :: curve_point_t, curve_t, error_t, followed_t, motion_result_t, plane_t
         class(followed_t), intent(inout), target :: self
         type(curve_t), intent(inout), target :: curve                !! near the point
         type(curve_point_t), intent(in) :: point
         type(plane_t), intent(in) :: plane                           !! across the curve there
         type(motion_result_t), intent(inout) :: result
         type(error_t), allocatable, intent(out) :: error
         logical, intent(in), optional :: compares_in_time            !! with a short time integration
      end subroutine describe

      !> The system at a stored point, to which the equations move their own.
      function system_at(self, position) result(system)
         import :: curve_position_t, followed_t, system_t
         class(followed_t), intent(inout), target :: self
         type(curve_position_t), intent(in) :: position
         type(system_t), pointer :: system
      end function system_at

      !> Frees external resources; safe to call twice.
      subroutine destroy(self)
         import :: followed_t
         class(followed_t), intent(inout) :: self
      end subroutine destroy
   end interface

contains

   ! Start

   !> Adopts a request, with its values among those to be reached.
   subroutine followed_adopt_request(self, request)
      class(followed_t), intent(inout) :: self
      type(curve_request_t), intent(in) :: request
      integer :: i

      self%request = request
      if (.not. allocated(self%request%responses)) allocate (self%request%responses(0))
      if (.not. allocated(self%request%values)) allocate (self%request%values(0))
      if (.not. allocated(self%request%others)) return
      do i = 1, size(self%request%others)
         if (all(abs(self%request%values - self%request%others(i)) > 0.0_wp)) &
            self%request%values = [self%request%values, self%request%others(i)]
      end do
   end subroutine followed_adopt_request

   !> Adopts a model, and sets up the equations on a set and a grid.
   subroutine followed_prepare(self, system, discretisation, options, level, error)
      class(followed_t), intent(inout), target :: self
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(level_t), intent(in) :: level                              !! of the first motion
      type(error_t), allocatable, intent(out) :: error

      self%model%system = system
      self%model%discretisation = discretisation
      self%model%options = options
      call self%adopt_level(without_motion(level), error)
   end subroutine followed_prepare

   !> The numbers that store unknowns or a direction: themselves.
   pure function followed_pack(self, x) result(packed)
      class(followed_t), intent(in) :: self
      real(wp), intent(in) :: x(:)
      real(wp), allocatable :: packed(:)

      packed = x
   end function followed_pack

   !> The unknowns or the direction of stored numbers: themselves.
   subroutine followed_unpack(self, packed, x)
      class(followed_t), intent(inout), target :: self
      real(wp), intent(in) :: packed(:)
      real(wp), allocatable, intent(out) :: x(:)

      x = packed
   end subroutine followed_unpack

   !> An origin on the present set: without sets, itself.
   function followed_on_level(self, origin) result(moved)
      class(followed_t), intent(in) :: self
      type(origin_t), intent(in) :: origin
      type(origin_t) :: moved

      moved = origin
   end function followed_on_level

   ! Equations at a point

   !> Finds the roughness of the residual at a point: none but rounding.
   subroutine followed_find_roughness(self, x, is_possible)
      class(followed_t), intent(inout), target :: self
      real(wp), intent(in) :: x(:)
      logical, intent(out), optional :: is_possible

      self%roughness = 0.0_wp
      if (present(is_possible)) is_possible = .true.
   end subroutine followed_find_roughness

   !> Increases the tolerance along a branch with a rough residual, up to a limit.
   subroutine followed_relax(self, is_relaxed)
      class(followed_t), intent(inout) :: self
      logical, intent(out) :: is_relaxed

      is_relaxed = self%is_rough .and. self%tolerance_factor < max_tolerance_factor
      if (is_relaxed) self%tolerance_factor = 10.0_wp*self%tolerance_factor
   end subroutine followed_relax

   !> Settings of the step control that all curves share.
   pure type(curve_config_t) function followed_usual_config(self) result(config)
      class(followed_t), intent(in) :: self
      real(wp) :: factor

      factor = merge(factor_without_laws, 1.0_wp, size(self%model%system%laws) == 0)
      config%longest_step = factor*self%request%longest_step
      config%first_step = 0.1_wp*config%longest_step
      config%angle = factor*desired_turn
      config%growth = 2.0_wp
   end function followed_usual_config

   !> Sets up a curve at one of its points, on the present set; its length and its largest motion remain.
   subroutine followed_begin_curve(self, curve, x, direction)
      class(followed_t), intent(inout), target :: self
      type(curve_t), intent(inout) :: curve
      real(wp), intent(in) :: x(:), direction(:)                      !! an approximate direction
      type(bordered_problem_t) :: problem
      type(path_t) :: before
      real(wp) :: units(size(x))

      curve%x = x
      call self%border(x, direction, problem)
      call self%update_units(curve)
      units = curve%units
      before = curve%path_t
      call new_curve(curve, problem, x, direction, units, self%config(), self%corrector())
      curve%length = before%length
      curve%largest = before%largest
      call self%restrict_to_symmetry(curve)
   end subroutine followed_begin_curve

   !> Sets up a curve at a point of it on the present set, as it was there.
   subroutine followed_place(self, curve, path)
      class(followed_t), intent(inout), target :: self
      type(curve_t), intent(inout) :: curve
      type(path_t), intent(in) :: path

      curve%path_t = path
      curve%status = outcome%pending
      call self%border(path%x, path%direction, curve%problem)
      call self%update_units(curve)
      call self%restrict_to_symmetry(curve)
   end subroutine followed_place

   !> Turns a curve at a branch point, where there are two tangents and the determinant is zero.
   subroutine followed_turn_to(self, curve, direction)
      class(followed_t), intent(inout), target :: self
      type(curve_t), intent(inout) :: curve
      real(wp), intent(in) :: direction(:)

      curve%direction = direction
      curve%orientation = 0.0_wp                                      ! not known
      curve%status = outcome%pending
      call self%restrict_to_symmetry(curve)
   end subroutine followed_turn_to

   !> Restricts the corrections of a curve to motions with its symmetry; by default there is none.
   subroutine followed_restrict_to_symmetry(self, curve)
      class(followed_t), intent(inout), target :: self
      type(curve_t), intent(inout) :: curve

   end subroutine followed_restrict_to_symmetry

   ! Steps

   !> Whether a step may have jumped to another part of the curve or to another curve.
   logical function followed_has_jumped(self, curve, is_first_branch) result(has_jumped)
      class(followed_t), intent(inout), target :: self
      type(curve_t), intent(inout) :: curve                           !! at the end of the step
      logical, intent(in) :: is_first_branch

      has_jumped = .false.
   end function followed_has_jumped

   !> Whether the motion of an unknown tone has passed through zero on a step, so that the continuation is its mirror image, or
   !> has ended at zero, where its frequency alone would go on.
   logical function followed_tone_vanishes(self, curve) result(tone_vanishes)
      class(followed_t), intent(in) :: self
      type(curve_t), intent(in) :: curve                              !! at the end of the step

      tone_vanishes = .false.
   end function followed_tone_vanishes

   !> Share of the part of a motion of doubled period that repeats after two periods alone, of its size at the start of the
   !> step, that is left at the end of the step; 1 for other motions.
   real(wp) function followed_retained_doubling(self, curve) result(share)
      class(followed_t), intent(in) :: self
      type(curve_t), intent(in) :: curve                              !! at the end of the step

      share = 1.0_wp
   end function followed_retained_doubling

   !> Searches for a motion on none of the branches so far, at the values at which others are requested.
   subroutine followed_find_separate(self, branches, x, is_found, error)
      class(followed_t), intent(inout), target :: self
      type(branches_t), intent(in) :: branches
      real(wp), allocatable, intent(out) :: x(:)                      !! on the present set
      logical, intent(out) :: is_found
      type(error_t), allocatable, intent(out) :: error

      is_found = .false.
   end subroutine followed_find_separate

   ! Images

   !> Whether a motion of the curve has images that differ in their phases alone.
   logical function followed_has_images(self) result(has_images)
      class(followed_t), intent(in) :: self

      has_images = .false.
   end function followed_has_images

   !> Replaces a motion of the curve, with a direction, by the image that is closest to a reference.
   subroutine followed_bring_near(self, reference, x, direction)
      class(followed_t), intent(in) :: self
      real(wp), intent(in) :: reference(:)
      real(wp), intent(inout) :: x(:)
      real(wp), intent(inout), optional :: direction(:)

   end subroutine followed_bring_near

   !> All base frequencies of a motion, if phases of unknown tones drift along the curve.
   subroutine followed_find_drifting_tones(self, x, omega)
      class(followed_t), intent(inout), target :: self
      real(wp), intent(in) :: x(:)
      real(wp), allocatable, intent(out) :: omega(:)                  !! [rad/s], (n_tones); not allocated: none drift

   end subroutine followed_find_drifting_tones

   ! Functions of a point

   !> Computes the quantities at a point of the curve that events compare.
   subroutine followed_evaluate(self, curve, known)
      class(followed_t), intent(inout), target :: self
      type(curve_t), intent(in) :: curve
      type(event_values_t), intent(out) :: known
      integer :: i

      associate (x => curve%x, responses => self%request%responses)
         known%rise = curve%direction(size(x))
         known%excess = x(size(x)) - [self%request%from, self%request%to, self%request%values]
         known%orientation = curve%orientation
         known%functions = [(self%function_at(responses(i), x, curve%direction), i=1, size(responses))]
         known%squares = [(self%square_at(responses(i), x), i=1, size(responses))]
         call self%find_stability(x, self%model%options%stability%tolerance, known%stability)
         call self%find_contact(x, known)
      end associate
   end subroutine followed_evaluate

   !> The function of a response whose zeros are located.
   real(wp) function followed_function_at(self, response, x, direction) result(value)
      class(followed_t), intent(inout), target :: self
      type(located_response_t), intent(in) :: response
      real(wp), intent(in) :: x(:), direction(:)
      type(response_series_t) :: series

      if (curve_kinds(response%kind)%is_extreme) then
         value = self%slope_at(response, x, direction)
         return
      end if
      call self%find_series(response, x, series)
      value = response%departure(series)
   end function followed_function_at

   !> A unit for the values of that function near x.
   real(wp) function followed_unit_of_function(self, response, x) result(unit)
      class(followed_t), intent(inout), target :: self
      type(located_response_t), intent(in) :: response
      real(wp), intent(in) :: x(:)
      type(response_series_t) :: series

      call self%find_series(response, x, series)
      unit = response%unit(series)
   end function followed_unit_of_function

   !> Square of a response.
   real(wp) function followed_square_at(self, response, x) result(square)
      class(followed_t), intent(inout), target :: self
      type(located_response_t), intent(in) :: response
      real(wp), intent(in) :: x(:)
      type(response_series_t) :: series

      call self%find_series(response, x, series)
      square = response%square(series)
   end function followed_square_at

   ! Results

   !> The plane across the curve at a point in which its errors are estimated; by default they do not depend on one.
   function followed_plane_at(self, curve, point) result(plane)
      class(followed_t), intent(inout), target :: self
      type(curve_t), intent(inout) :: curve
      type(curve_point_t), intent(in) :: point
      type(plane_t) :: plane

   end function followed_plane_at

   !> Adds the requested derivatives to the result of a point, unless `describe` has found them.
   subroutine followed_find_gradient(self, curve, point, result)
      class(followed_t), intent(inout), target :: self
      type(curve_t), intent(in) :: curve
      type(curve_point_t), intent(in) :: point
      type(motion_result_t), intent(inout) :: result

   end subroutine followed_find_gradient
end module hb_followed
