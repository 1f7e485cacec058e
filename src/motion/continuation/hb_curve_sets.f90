!> Sets and grids along a curve: they grow where the error of a motion exceeds the tolerance, and shrink where it is
!> far below.
!> A step whose points exceed the tolerance is rejected and repeated on a set and a grid enlarged by what their
!> error estimates find missing. The preceding point is transferred: it is corrected in the plane across the curve, and
!> the curve is continued in the same direction. Neighbouring points share sets: a set that grows is chosen for a part
!> of the tolerance, and shrinks below a smaller part. The tuples of the lowest set always remain, because a motion
!> may lose its symmetry along the curve. Source: docs/why/accuracy.md.
module hb_curve_sets
   use hb_bifurcation, only: bifurcation
   use hb_cancellation, only: cancellation_t, work_is_over
   use hb_curve, only: curve_t
   use hb_curve_branches, only: branches_t
   use hb_curve_events, only: differing_events, event_values_t
   use hb_curve_points, only: curve_point_t
   use hb_curve_step, only: step
   use hb_error, only: error_t
   use hb_followed, only: curve_state_t, followed_t, step_accuracy_t
   use hb_harmonics, only: harmonics_t, new_box
   use hb_kinds, only: wp
   use hb_level, only: choose_next, choose_smaller, estimate_of, goal_share, join, level_t, max_failures, min_goal, transferred
   use hb_motion_result, only: motion_result_t
   use hb_outcome, only: outcome
   use hb_passed_events, only: find_passed_events
   use hb_point_kinds, only: curve_kind, curve_kinds
   use hb_refinement, only: refinable_t, refine, refinement_end
   use hb_solver_types, only: report_t
   implicit none
   private
   public :: step_to_tolerance, transfer_motion

   integer, parameter :: max_idle = 2                                ! consecutive ones without improvement
   real(wp), parameter :: goal_ahead = 0.3_wp                         ! of the tolerance: sufficient for the following points, too
   real(wp), parameter :: max_estimate_to_shrink = 0.01_wp            ! of the tolerance: below it a smaller set is sufficient;
                                                                      ! with 0.03 a curve that has left its stop keeps 12
                                                                      ! harmonics, not 8

   !> A curve that is refined. Its set and grid are those of the motion that is followed.
   type, abstract, extends(refinable_t) :: refined_curve_t
      class(followed_t), pointer :: followed => null()
      type(curve_t), pointer :: curve => null()
      integer, allocatable :: required(:, :)                          ! tuples of the lowest set, (n_tones, any)
      type(level_t) :: next
      logical :: is_ended = .false.                                   ! there is no further step
      type(cancellation_t), pointer :: effort => null()               ! counts the work of all levels
   contains
      procedure :: prepare => refined_curve_prepare
      procedure :: choose_for => refined_curve_choose_for
      procedure :: is_accurate => refined_curve_is_accurate
      procedure :: is_over => refined_curve_is_over
   end type refined_curve_t

   !> A step from a point to the next one.
   type, extends(refined_curve_t) :: refined_step_t
      type(event_values_t), pointer :: at_point => null()             ! of the curve
      type(branches_t), pointer :: branches => null()
      type(step_accuracy_t), pointer :: accuracy => null()
      type(curve_state_t) :: here                                     ! at the point, on the level tried last
      type(curve_point_t), allocatable :: points(:)                       ! of the step
      integer :: worst = 1                                            ! of them, the least accurate
      logical :: is_stalled = .false.                                 ! no step is possible on that level
   contains
      procedure :: solve => refined_step_solve
      procedure :: choose => refined_step_choose
      procedure :: is_accurate => refined_step_is_accurate
   end type refined_step_t

   !> A motion in the plane across a direction.
   type, extends(refined_curve_t) :: refined_crossing_t
      real(wp), allocatable :: x(:), direction(:)
      type(motion_result_t), allocatable :: result
   contains
      procedure :: solve => refined_crossing_solve
      procedure :: choose => refined_crossing_choose
   end type refined_crossing_t

contains

   ! Steps

   !> Performs one step on a set and a grid on which all of its points have the requested accuracy, if there is one.
   subroutine step_to_tolerance(followed, curve, at_point, branches, accuracy, points, error)
      class(followed_t), intent(inout), target :: followed
      type(curve_t), intent(inout), target :: curve
      type(event_values_t), intent(inout), target :: at_point
      type(branches_t), intent(inout), target :: branches
      type(step_accuracy_t), intent(inout), target :: accuracy
      type(curve_point_t), allocatable, intent(out) :: points(:)
      type(error_t), allocatable, intent(out) :: error
      type(refined_step_t) :: refined
      type(curve_state_t) :: first
      type(cancellation_t), target :: effort
      integer :: ending

      call refined%prepare(followed, curve)
      refined%at_point => at_point
      refined%branches => branches
      refined%accuracy => accuracy
      refined%effort => effort
      refined%max_failures = max_failures + 1
      if (accuracy%estimate <= max_estimate_to_shrink*followed%model%options%accuracy%tolerance) call shrink(refined, error)
      if (allocated(error)) return
      first = state_of(followed, curve, at_point)
      call effort%enter(huge(1.0_wp))
      call refine(refined, ending)
      call effort%leave()
      accuracy%is_out_of_work = ending /= refinement_end%accurate .and. &
                                effort%budget%spent > followed%model%options%max_work()
      if (ending == refinement_end%idle) then                         ! no set improves it: the point is reported unchanged
         call restore_curve(refined, first)
         followed%n_levels = 1
         if (.not. allocated(refined%error)) call step_here(refined)
      else if (refined%n_levels > 1 .and. curve%status == outcome%pending .and. .not. allocated(refined%error)) then
         call find_passed_events(followed, curve, branches, first, refined%here, refined%points)
      end if
      call move_alloc(refined%points, points)
      call move_alloc(refined%error, error)
   end subroutine step_to_tolerance

   !> Performs the step on the level chosen last, and describes its points.
   subroutine refined_step_solve(self, is_solved)
      class(refined_step_t), intent(inout) :: self
      logical, intent(out) :: is_solved

      is_solved = self%n_levels == 0
      if (.not. is_solved) then
         call change_level(self, is_solved)
         if (allocated(self%error) .or. .not. is_solved) return
      end if
      self%followed%n_levels = self%n_levels + 1
      self%here = state_of(self%followed, self%curve, self%at_point)
      call step_here(self)
      associate (status => self%curve%status)
         self%is_stalled = status == outcome%stalled
         self%is_ended = .not. (self%is_stalled .or. status == outcome%pending)
         is_solved = status == outcome%pending
      end associate
   end subroutine refined_step_solve

   !> Changes to the next level at the first point of the step; if that fails, the step is performed on the previous
   !> level.
   subroutine change_level(self, is_found)
      type(refined_step_t), intent(inout) :: self
      logical, intent(out) :: is_found

      call restore_curve(self, self%here)
      if (allocated(self%error)) return
      call change_set(self, self%next, is_found)
      if (allocated(self%error)) return
      associate (curve => self%curve)
         if (is_found) then
            if (self%is_stalled) curve%step = curve%config%first_step
            return
         end if
         self%is_ended = .true.
         call restore_curve(self, self%here)
         if (allocated(self%error)) return
         if (self%is_stalled) then
            curve%status = outcome%stalled
         else
            call step_here(self)
         end if
      end associate
   end subroutine change_level

   !> Performs the step on the present set.
   subroutine step_here(self)
      type(refined_step_t), intent(inout) :: self

      call step(self%followed, self%curve, self%at_point, self%branches, self%points)
      if (self%curve%status == outcome%pending) call describe_all(self)
   end subroutine step_here

   !> Chooses the next level from the least accurate point or, if no step is possible, from the first point of the
   !> step.
   subroutine refined_step_choose(self, is_there)
      class(refined_step_t), intent(inout) :: self
      logical, intent(out) :: is_there
      type(motion_result_t) :: result
      type(curve_point_t) :: here

      associate (followed => self%followed, curve => self%curve)
         if (self%is_stalled) then
            is_there = .false.
            call restore_curve(self, self%here)
            if (allocated(self%error)) return
            here = curve_point_t(curve_kind%regular, 0.0_wp, curve%x)
            call followed%describe(curve, here, followed%plane_at(curve, here), result, self%error)
            if (allocated(self%error)) return
            call self%choose_for(result, curve%x, 0.0_wp, is_there)
            if (is_there) return
            call restore_curve(self, self%here)
            curve%status = outcome%stalled
            return
         end if
         associate (point => self%points(self%worst))
            if (refined_curve_is_accurate(self)) then              ! the other motions may contain tuples that this one lacks
               self%next = level_at(followed, point%x)
               call fill(self%next, is_there)
            else
               call self%choose_for(point%result, point%x, goal_ahead, is_there)
            end if
         end associate
      end associate
   end subroutine refined_step_choose

   !> Branch points are searched for on sets without gaps.
   logical function refined_step_is_accurate(self) result(is_accurate)
      class(refined_step_t), intent(inout) :: self
      integer :: i

      is_accurate = refined_curve_is_accurate(self)
      if (.not. is_accurate) return
      do i = 1, size(self%points)
         associate (kind => curve_kinds(self%points(i)%kind))
            is_accurate = is_accurate .and. (kind%bifurcation /= bifurcation%branch .or. kind%is_extreme)
         end associate
      end do
   end function refined_step_is_accurate

   ! Motions

   !> Transfers a motion to a set and a grid on which it has the requested accuracy, if there is one, in the plane
   !> across a direction. The problem uses these afterwards.
   subroutine transfer_motion(followed, x, direction, error)
      class(followed_t), intent(inout), target :: followed
      real(wp), allocatable, intent(inout) :: x(:), direction(:)      !! on the present set, before and afterwards
      type(error_t), allocatable, intent(out) :: error
      type(curve_t), target :: curve
      type(refined_crossing_t) :: refined

      call refined%prepare(followed, curve)
      call move_alloc(x, refined%x)
      call move_alloc(direction, refined%direction)
      call refine(refined)
      call move_alloc(refined%x, x)
      call move_alloc(refined%direction, direction)
      call move_alloc(refined%error, error)
   end subroutine transfer_motion

   !> Finds the motion on the level chosen last from that on the previous one.
   subroutine refined_crossing_solve(self, is_solved)
      class(refined_crossing_t), intent(inout) :: self
      logical, intent(out) :: is_solved
      type(level_t) :: before
      type(curve_point_t) :: here
      real(wp), allocatable :: direction(:), x(:)

      associate (followed => self%followed)
         is_solved = self%n_levels == 0
         if (.not. is_solved) then
            before = followed%level
            x = transferred(before%harmonics, self%next%harmonics, self%x, followed%n_further)
            direction = transferred(before%harmonics, self%next%harmonics, self%direction, followed%n_further)
            call followed%adopt_level(self%next, self%error)
            if (allocated(self%error)) return
            call followed%correct_on_plane(x, direction, is_solved)
            if (.not. is_solved) then
               call followed%adopt_level(before, self%error)
               return
            end if
            call move_alloc(x, self%x)
            call move_alloc(direction, self%direction)
         end if
         followed%n_levels = self%n_levels + 1
         call followed%begin_curve(self%curve, self%x, self%direction)
         if (allocated(self%result)) deallocate (self%result)
         allocate (self%result)
         here = curve_point_t(curve_kind%regular, 0.0_wp, self%x)
         call followed%describe(self%curve, here, followed%plane_at(self%curve, here), self%result, self%error)
         self%estimate = estimate_of(self%result)
      end associate
   end subroutine refined_crossing_solve

   subroutine refined_crossing_choose(self, is_there)
      class(refined_crossing_t), intent(inout) :: self
      logical, intent(out) :: is_there

      call self%choose_for(self%result, self%x, goal_ahead, is_there)
   end subroutine refined_crossing_choose

   ! Both

   !> Prepares the levels of a motion that is followed.
   subroutine refined_curve_prepare(self, followed, curve)
      class(refined_curve_t), intent(inout) :: self
      class(followed_t), intent(inout), target :: followed
      type(curve_t), intent(inout), target :: curve

      self%followed => followed
      self%curve => curve
      self%required = followed%model%discretisation%harmonics%tuples
      self%max_idle = max_idle
   end subroutine refined_curve_prepare

   !> Chooses the next level for one motion.
   subroutine refined_curve_choose_for(self, result, x, least, is_there)
      class(refined_curve_t), intent(inout) :: self
      type(motion_result_t), intent(in) :: result
      real(wp), intent(in) :: x(:)                                    !! its unknowns
      real(wp), intent(in) :: least                                   !! of the tolerance: a sufficiently small error
      logical, intent(out) :: is_there

      associate (options => self%followed%model%options)
         call choose_next(self%followed%model%system, options, self%required, result, level_at(self%followed, x), &
                          max(min_goal*estimate_of(result), least*options%accuracy%tolerance), 0, self%next)
         is_there = allocated(self%next%unknowns)
      end associate
   end subroutine refined_curve_choose_for

   logical function refined_curve_is_accurate(self) result(is_accurate)
      class(refined_curve_t), intent(inout) :: self

      is_accurate = self%estimate <= goal_share*self%followed%model%options%accuracy%tolerance
   end function refined_curve_is_accurate

   logical function refined_curve_is_over(self) result(is_over)
      class(refined_curve_t), intent(inout) :: self

      is_over = self%is_ended .or. work_is_over()
      if (associated(self%effort)) is_over = is_over .or. self%effort%budget%spent > self%followed%model%options%max_work()
   end function refined_curve_is_over

   ! Sets

   !> Fills the gaps of a set of one tone: at a loss of symmetry the branch point depends on tuples that are zero on
   !> the curve.
   subroutine fill(level, is_new)
      type(level_t), intent(inout) :: level
      logical, intent(out) :: is_new
      type(harmonics_t) :: box
      type(error_t), allocatable :: error

      is_new = .false.
      if (level%harmonics%n_tones > 1 .or. is_without_gaps(level)) return
      call new_box(box, level%harmonics%highest, .false., error)
      if (.not. allocated(error)) call join(level, box, is_new)
   end subroutine fill

   pure logical function is_without_gaps(level)
      type(level_t), intent(in) :: level

      is_without_gaps = level%harmonics%n_tones == 1 .and. level%harmonics%n_harmonics == level%harmonics%highest(1) + 1
   end function is_without_gaps

   !> The present set and grid with a motion.
   function level_at(followed, x) result(level)
      class(followed_t), intent(in) :: followed
      real(wp), intent(in) :: x(:)                                    !! its unknowns, and those of the curve
      type(level_t) :: level

      level = followed%level
      level%unknowns = [x(:size(x) - followed%n_further), 0.0_wp*followed%model%system%tones%omega]
   end function level_at

   !> Changes to a smaller set or a coarser grid, if one is sufficient.
   subroutine shrink(self, error)
      type(refined_step_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error
      type(curve_state_t) :: here
      type(level_t) :: smaller
      logical :: is_filled, is_found, is_smaller

      associate (followed => self%followed, curve => self%curve)
         smaller = level_at(followed, curve%x)
         call choose_smaller(followed%model%system, followed%model%options, self%required, smaller, is_smaller)
         if (is_without_gaps(followed%level)) call fill(smaller, is_filled)  ! so the set remains without gaps after a branch point
         ! unless the saving is too small
         if (.not. is_smaller .or. 2*smaller%harmonics%n_harmonics > followed%level%harmonics%n_harmonics) return
         here = state_of(followed, curve, self%at_point)
         call change_set(self, smaller, is_found)
         if (is_found .and. .not. allocated(self%error)) then         ! otherwise an event would be reported twice, or never
            is_found = size(differing_events(here%at_point, self%at_point, followed%request%responses%kind)) == 0
         end if
         if (.not. (is_found .or. allocated(self%error))) call restore_curve(self, here)
      end associate
      call move_alloc(self%error, error)
   end subroutine shrink

   !> The state at the point of a curve. (gfortran 12 loses allocatable components in a constructor.)
   function state_of(followed, curve, at_point) result(state)
      class(followed_t), intent(in) :: followed
      type(curve_t), intent(in) :: curve
      type(event_values_t), intent(in) :: at_point
      type(curve_state_t) :: state

      state%level = followed%level
      state%path = curve%path_t
      state%at_point = at_point
   end function state_of

   !> Describes all points of a step, and finds the least accurate one.
   subroutine describe_all(self)
      type(refined_step_t), intent(inout) :: self
      integer :: i

      self%worst = 1
      self%estimate = 0.0_wp
      do i = 1, size(self%points)
         associate (point => self%points(i), followed => self%followed)
            allocate (point%result)
            call followed%describe(self%curve, point, followed%plane_at(self%curve, point), point%result, self%error)
            if (allocated(self%error)) return
            if (point%kind == curve_kind%regular) self%accuracy%estimate = estimate_of(point%result)
            if (.not. estimate_of(point%result) > self%estimate) cycle
            self%worst = i
            self%estimate = estimate_of(point%result)
         end associate
      end do
   end subroutine describe_all

   !> Restores a state of the curve on its set; the work remains counted.
   subroutine restore_curve(self, here)
      type(refined_step_t), intent(inout) :: self
      type(curve_state_t), intent(in) :: here

      call self%followed%adopt_level(here%level, self%error)
      if (allocated(self%error)) return
      self%branches%start_on_set = self%followed%on_level(self%branches%start)
      call self%followed%place(self%curve, here%path)
      self%at_point = here%at_point
   end subroutine restore_curve

   !> Changes the set and the grid of the curve at its point; `is_found` is false if the motion is not found there.
   subroutine change_set(self, level, is_found)
      type(refined_step_t), intent(inout) :: self
      type(level_t), intent(in) :: level
      logical, intent(out) :: is_found
      type(report_t) :: report
      real(wp), allocatable :: direction(:), x(:)
      real(wp) :: orientation, step, roughness
      logical :: is_at_branch_point, is_rough

      associate (followed => self%followed, curve => self%curve, branches => self%branches)
         step = curve%step
         report = curve%report
         orientation = curve%orientation
         x = transferred(followed%level%harmonics, level%harmonics, curve%x, followed%n_further)
         direction = transferred(followed%level%harmonics, level%harmonics, curve%direction, followed%n_further)
         is_found = .false.
         call followed%adopt_level(level, self%error)
         if (allocated(self%error)) return
         is_at_branch_point = branches%leaves_another() .and. curve%length <= 0.0_wp   ! there are two tangents
         is_found = is_at_branch_point
         roughness = followed%roughness ! a curve that continues from a stored row has the roughness of the start
         is_rough = followed%is_rough
         if (.not. is_found) call followed%correct_on_plane(x, direction, is_found)
         followed%roughness = roughness
         followed%is_rough = is_rough
         if (.not. is_found) return
         call followed%begin_curve(curve, x, direction)
         if (is_at_branch_point) call followed%turn_to(curve, direction)
         ! next to a corner the tangents of both sets may be across each other: as on a step, the determinant shows the way ahead
         if (cos(curve%angle) <= curve%config%little .and. orientation*curve%orientation < 0.0_wp .and. &
             .not. allocated(curve%part)) then
            curve%direction = -curve%direction
            curve%orientation = -curve%orientation
         end if
         curve%step = step
         curve%report = report
         branches%start_on_set = followed%on_level(branches%start)
         call followed%update_units(curve)
         call followed%evaluate(curve, self%at_point)
      end associate
   end subroutine change_set
end module hb_curve_sets
