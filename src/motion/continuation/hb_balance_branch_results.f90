!> Results at a point of a curve of balances, and its errors. Small errors of a motion may change its multipliers much, and move the
!> point at which a contact begins far along a curve that is nearly parallel to it: those of located points have terms of their own.
submodule (hb_balance_branch) hb_balance_branch_results
   use hb_bifurcation, only: bifurcation_value
   use hb_law, only: law_box_t
   use hb_law_measure, only: law_measure_t
   use hb_level, only: apply_safety_factor, estimate_of
   use hb_motion_description, only: describe_motion, solution_t, stability_of_refined
   use hb_options, only: options_t
   use hb_point_kinds, only: curve_kind
   use hb_system, only: measure_of
   use hb_thresholds, only: small_share
   use hb_tones, only: tones_t
   implicit none

contains

   !> Computes the results of a motion of the curve, with its errors in a plane.
   module procedure balance_branch_describe
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
         if (allocated(plane%functional)) call curve%problem%hold(plane)
         solution%basis => self%problem%model%discretisation
         solution%balance => self%problem%balance_t
         solution%u => u
         solution%problem => curve%problem
         call describe_motion(model%system, model%discretisation, options, solution, result, error)
      end associate
      if (allocated(error)) return
      if (self%model%options%accuracy%is_on) call apply_safety_factor(self%model%system, result)
      associate (unit => max(abs(point%x(size(point%x))), small_share*abs(self%request%to - self%request%from)))
         call add_error_of_bifurcation(self%problem%model, point%bifurcation, point%shift/unit, result)
         call add_error_of_graze(self%problem%model, [point%extreme, point%switch], point%shift/unit, result)
         if (.not. self%model%options%accuracy%is_on) return
         associate (of_value => min(1.0_wp, result%error_estimate%parameter_error/unit))
            if (of_value > estimate_of(result)) result%level_estimate = of_value   ! such as at folds, which move along the value
         end associate
      end associate
      if (any(result%status == [outcome%converged, outcome%truncated, outcome%aliased])) &
         result%status = merge(outcome%converged, outcome%truncated, estimate_of(result) <= self%model%options%accuracy%tolerance)
      result%harmonics = self%level%harmonics
      result%n_samples = self%level%torus%n_samples
      result%n_levels = self%n_levels
   end procedure balance_branch_describe

   !> The plane across the tangent at a point, in units of the motion there, in which its errors are estimated, if they are: it does
   !> not depend on the previous points of the curve. At a branch point, where any vector between the two curves is a
   !> tangent, steps are across both; at a given value this is held.
   module procedure balance_branch_plane_at
      type(law_measure_t) :: measure
      type(report_t) :: report
      real(wp), allocatable :: u(:, :)
      real(wp) :: determinant_sign, tangent(size(point%x)), units(size(point%x))
      logical :: is_crossed, is_possible, is_singular

      if (.not. self%problem%model%options%error_estimate%is_on) return
      call self%problem%move_to_point(point%x, is_possible)
      is_singular = all(abs(point%x - curve%x) <= 0.0_wp)        ! its tangent is the direction
      if (.not. is_singular) then
         report = curve%report                                   ! not counted as work of the curve
         call curve%tangent_at(point%x, tangent, determinant_sign, is_singular)
         curve%report = report
      end if
      is_crossed = point%is_crossing .or. point%kind == curve_kind%branch
      if (is_singular) tangent = curve%direction
      measure = measure_of(self%problem%model%system)
      associate (n => self%problem%n_unknowns, n_dofs => self%problem%n_dofs)
         u = reshape(point%x(:n), [n/n_dofs, n_dofs])
         call measure%relate_to(u)
         units = [max(measure%size_of_motion, tiny(1.0_wp))*measure%units_of(u), &
                  self%problem%parameter_scales(self%problem%which)]
      end associate
      if (any(point%kind == [curve_kind%value, curve_kind%end]) .and. .not. is_crossed) &
         tangent = [0.0_wp*tangent(2:), units(size(units))]
      plane%functional = tangent/units**2/norm2(tangent/units)
      plane%value = dot_product(plane%functional, point%x)
      if (is_crossed) plane%units_across = units
   end procedure balance_branch_plane_at

   !> Estimates the error by the multipliers of the motion with its first-order errors removed: that of the multipliers is
   !> part of the estimate of stability, that of the value, with a tolerance, of the estimate of the levels.
   subroutine add_error_of_bifurcation(model, kind, shift, result)
      type(model_t), intent(in) :: model                              !! at the motion
      integer, intent(in) :: kind                                     !! of hb_bifurcation; 0: it was not found from multipliers
      real(wp), intent(in) :: shift                                   !! of the value, relative, by a change of its function
      type(motion_result_t), intent(inout) :: result
      type(stability_t) :: refined
      type(tones_t) :: tones
      real(wp) :: change

      if (kind == 0 .or. result%stability%is_integrated .or. .not. allocated(result%error_estimate%refined)) return
      tones = model%system%tones
      tones%omega = result%frequency
      call stability_of_refined(model%system, model%options, tones, result%error_estimate, &
                                model%options%stability, refined)
      if (.not. allocated(refined%multipliers)) return
      change = abs(bifurcation_value(kind, refined%multipliers))
      result%stability%estimate = max(result%stability%estimate, change)
      call allow_for_shift(model, change*shift, result)
   end subroutine add_error_of_bifurcation

   !> Estimates the error of the value of a graze by the extreme that the motion with its first-order errors removed has there.
   subroutine add_error_of_graze(model, extreme, shift, result)
      type(model_t), intent(in) :: model                              !! at the motion
      integer, intent(in) :: extreme(2)                               !! that is zero, in `extremes_of_switches`; 0: none
      real(wp), intent(in) :: shift                                   !! of the value, relative, by a change of the extreme
      type(motion_result_t), intent(inout) :: result
      type(law_box_t), allocatable :: laws(:)
      real(wp), allocatable :: extremes(:, :)

      if (any(extreme == 0) .or. .not. allocated(result%error_estimate%refined)) return
      laws = model%system%laws
      associate (found => result%error_estimate)
         call extremes_of_switches(laws, found%around%tuples, result%frequency, found%refined, extremes)
      end associate
      if (size(extremes, 2) >= extreme(2)) call allow_for_shift(model, abs(extremes(extreme(1), extreme(2)))*shift, result)
   end subroutine add_error_of_graze

   !> Includes the error of the value in the estimate of the levels, if there is a tolerance.
   subroutine allow_for_shift(model, of_value, result)
      type(model_t), intent(in) :: model
      real(wp), intent(in) :: of_value                                !! relative
      type(motion_result_t), intent(inout) :: result

      if (model%options%accuracy%is_on .and. of_value > estimate_of(result)) result%level_estimate = min(1.0_wp, of_value)
   end subroutine allow_for_shift
end submodule hb_balance_branch_results
