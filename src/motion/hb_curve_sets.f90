!> Sets and grids along a curve: they grow where a motion is not as accurate as is asked for, and shrink where it is far more.
!>
!> A step whose points are above the tolerance is taken back, and gone again on a set and a grid that hold what their certificates
!> say is lacking. The point before it is taken over: corrected in the plane across the curve, and followed on in the same sense.
!> Neighbours share sets: one that grows is made for a part of the tolerance, and shrinks below a smaller part. The tuples of the
!> lowest set always stay, as a motion may lose its symmetry on the way. Source: docs/why/accuracy.md.
module hb_curve_sets
   use hb_amplitudes, only: as_amplitudes
   use hb_curve, only: curve_t
   use hb_curve_request, only: curve_kind
   use hb_curve_step, only: step
   use hb_error, only: error_t
   use hb_followed_motion, only: followed_motion_t, known_t, waiting_t
   use hb_harmonics, only: harmonics_t, new_box
   use hb_kinds, only: wp
   use hb_motion_result, only: motion_result_t
   use hb_outcome, only: outcome
   use hb_rung, only: carry, choose_next, choose_smaller, estimate_of, idle, join, least_goal, margin, rung_t
   use hb_scene, only: scene_t
   use hb_solver_types, only: report_t
   use hb_watch, only: work_is_over
   implicit none
   private
   public :: settle, step_to_tolerance

   integer, parameter :: most_rungs = 12                              ! on one step
   integer, parameter :: most_stalled = 3                             ! sets on which one step is tried that leads nowhere
   integer, parameter :: most_idle = 2                                ! one after the other that gain nothing
   real(wp), parameter :: goal_ahead = 0.3_wp                         ! of the tolerance: for the points that follow, too
   real(wp), parameter :: ample = 0.01_wp                             ! of the tolerance: a smaller set will do

   !> The curve at one of its points.
   type :: standing_t
      type(rung_t) :: rung
      type(curve_t) :: curve
      real(wp) :: largest = 0.0_wp
      type(known_t) :: known
   end type standing_t

contains

   !> Goes one step on a set and a grid on which all points found on it are as accurate as is asked for, if there is one.
   subroutine step_to_tolerance(self, error)
      class(followed_motion_t), intent(inout), target :: self
      type(error_t), allocatable, intent(out) :: error
      type(standing_t) :: first, here
      type(scene_t) :: scene                                          ! in which all tuples of the lowest set are needed
      type(rung_t) :: next
      real(wp) :: best, estimate
      integer :: n_idle, n_stalled, worst
      logical :: is_accurate, is_found

      scene = self%scene
      call need_all_tuples(scene)
      if (self%estimate <= ample*scene%accuracy%tolerance) call shrink(self, scene, error)
      if (allocated(error)) return
      first = standing_at(self)
      n_idle = 0
      n_stalled = 0
      best = huge(1.0_wp)
      self%n_rungs = 1
      do
         here = standing_at(self)
         call step(self)
         if (self%curve%status == outcome%stalled .and. n_stalled < most_stalled) then
            n_stalled = n_stalled + 1
            call widen(self, scene, here, is_found, error)
            if (allocated(error)) return
            self%n_rungs = self%n_rungs + 1
            if (is_found) cycle
         end if
         if (self%curve%status /= outcome%pending) return
         call describe_all(self, worst, estimate, error)
         if (allocated(error) .or. work_is_over() .or. self%n_rungs == most_rungs) return
         is_accurate = estimate <= margin*self%scene%accuracy%tolerance
         associate (kinds => self%waiting(self%first_waiting:)%kind)
            if (is_accurate .and. .not. any(kinds == curve_kind%branch .or. kinds == curve_kind%split)) return
         end associate
         if (.not. is_accurate) n_idle = merge(n_idle + 1, 0, estimate > idle*best)
         if (n_idle == most_idle) then                                ! no set helps: the point is told as it is
            call stand_at(self, first, error)
            if (allocated(error)) return
            self%n_rungs = 1
            call step(self)
            if (self%curve%status == outcome%pending) call describe_all(self, worst, estimate, error)
            return
         end if
         associate (point => self%waiting(worst))
            if (is_accurate) then                                     ! the other motions may have what this one has not
               next = top_at(self, point%x)
               call fill(next, is_found)
            else
               best = min(best, estimate)
               call choose_next(scene, point%result, top_at(self, point%x), &
                                max(least_goal*estimate, goal_ahead*self%scene%accuracy%tolerance), 0, next, is_found)
            end if
         end associate
         if (.not. is_found) return
         call stand_at(self, here, error)
         if (allocated(error)) return
         call change_set(self, next, is_found, error)
         if (allocated(error)) return
         if (.not. is_found) then
            call stand_at(self, here, error)
            if (.not. allocated(error)) call step(self)
            if (self%curve%status == outcome%pending .and. .not. allocated(error)) call describe_all(self, worst, estimate, error)
            return
         end if
         self%n_rungs = self%n_rungs + 1
      end do
   end subroutine step_to_tolerance

   !> Goes over to a larger set or a finer grid where there is no way on, at the last point; the curve stays stalled where there is
   !> none.
   subroutine widen(self, scene, here, is_found, error)
      class(followed_motion_t), intent(inout), target :: self
      type(scene_t), intent(in) :: scene
      type(standing_t), intent(in) :: here
      logical, intent(out) :: is_found
      type(error_t), allocatable, intent(out) :: error
      type(motion_result_t) :: result
      type(rung_t) :: next

      is_found = .false.
      call stand_at(self, here, error)
      if (allocated(error)) return
      call self%describe(waiting_t(curve_kind%regular, 0.0_wp, self%curve%x), result, error)
      if (allocated(error)) return
      call choose_next(scene, result, top_at(self, self%curve%x), least_goal*estimate_of(result), 0, next, is_found)
      if (is_found .and. .not. work_is_over()) call change_set(self, next, is_found, error)
      if (allocated(error)) return
      if (is_found) then
         self%curve%step = self%curve%config%first_step
      else
         call stand_at(self, here, error)
         self%curve%status = outcome%stalled
      end if
   end subroutine widen

   !> Makes the set of one tone one without gaps: where symmetry breaks the branch point depends on tuples that carry nothing.
   subroutine fill(rung, is_new)
      type(rung_t), intent(inout) :: rung
      logical, intent(out) :: is_new
      type(harmonics_t) :: box
      type(error_t), allocatable :: error

      is_new = .false.
      if (rung%set%n_tones > 1 .or. is_without_gaps(rung)) return
      call new_box(box, rung%set%highest, .false., error)
      if (.not. allocated(error)) call join(rung, box, is_new)
   end subroutine fill

   pure logical function is_without_gaps(rung)
      type(rung_t), intent(in) :: rung

      is_without_gaps = rung%set%n_tones == 1 .and. rung%set%n_harmonics == rung%set%highest(1) + 1
   end function is_without_gaps

   !> The set at hand with a motion in it.
   function top_at(self, x) result(top)
      class(followed_motion_t), intent(in) :: self
      real(wp), intent(in) :: x(:)
      type(rung_t) :: top

      top = self%rung
      top%unknowns = [x(:self%problem%n_unknowns), 0.0_wp*self%scene%tones%omega]
   end function top_at

   !> Takes a motion over to a set and a grid on which it is as accurate as is asked for, if there is one, in the plane across a
   !> direction. The problem stands on these afterwards.
   subroutine settle(self, x, direction, error)
      class(followed_motion_t), intent(inout), target :: self
      real(wp), allocatable, intent(inout) :: x(:), direction(:)      !! on the set at hand, before and afterwards
      type(error_t), allocatable, intent(out) :: error
      type(scene_t) :: scene                                          ! in which all tuples of the lowest set are needed
      type(motion_result_t), allocatable :: result
      type(rung_t) :: before, next
      real(wp), allocatable :: moved(:), moved_direction(:)
      real(wp) :: best, estimate
      integer :: n_idle
      logical :: is_found

      scene = self%scene
      call need_all_tuples(scene)
      n_idle = 0
      best = huge(1.0_wp)
      self%n_rungs = 1
      do
         if (allocated(result)) deallocate (result)
         allocate (result)
         call self%make_curve(x, direction)
         call self%describe(waiting_t(curve_kind%regular, 0.0_wp, x), result, error)
         if (allocated(error)) return
         estimate = estimate_of(result)
         if (estimate <= margin*scene%accuracy%tolerance .or. self%n_rungs == most_rungs) return
         n_idle = merge(n_idle + 1, 0, estimate > idle*best)
         if (n_idle == most_idle .or. work_is_over()) return
         best = min(best, estimate)
         call choose_next(scene, result, top_at(self, x), max(least_goal*estimate, goal_ahead*scene%accuracy%tolerance), 0, next, &
                          is_found)
         if (.not. is_found) return
         before = self%rung
         moved = carry(before%set, next%set, x, size(self%problem%which))
         moved_direction = carry(before%set, next%set, direction, size(self%problem%which))
         call self%put_on(next, error)
         if (allocated(error)) return
         call self%find_on_plane(moved, moved_direction, is_found)
         if (.not. is_found) then
            call self%put_on(before, error)
            return
         end if
         call move_alloc(moved, x)
         call move_alloc(moved_direction, direction)
         self%n_rungs = self%n_rungs + 1
      end do
   end subroutine settle

   !> Goes over to a smaller set or a coarser grid, if one will do.
   subroutine shrink(self, scene, error)
      class(followed_motion_t), intent(inout), target :: self
      type(scene_t), intent(in) :: scene
      type(error_t), allocatable, intent(out) :: error
      type(standing_t) :: here
      type(rung_t) :: smaller
      real(wp) :: ahead
      logical :: is_filled, is_found, is_smaller

      smaller = top_at(self, self%curve%x)
      call choose_smaller(scene, smaller, is_smaller)
      if (is_without_gaps(self%rung)) call fill(smaller, is_filled)   ! so it stays behind a branch point
      if (.not. is_smaller .or. 2*smaller%set%n_harmonics > self%rung%set%n_harmonics) return   ! a little less is not worth it
      here = standing_at(self)
      associate (direction => self%curve%direction)
         ahead = direction(size(direction))
      end associate
      call change_set(self, smaller, is_found, error)
      if (allocated(error)) return
      associate (direction => self%curve%direction)
         if (is_found) is_found = ahead*direction(size(direction)) > 0.0_wp   ! else a fold would be told twice
      end associate
      if (.not. is_found) call stand_at(self, here, error)
   end subroutine shrink

   !> Describes all points that wait, and says which is the least accurate.
   subroutine describe_all(self, worst, estimate, error)
      class(followed_motion_t), intent(inout), target :: self
      integer, intent(out) :: worst
      real(wp), intent(out) :: estimate                               !! its own
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      worst = 1
      estimate = 0.0_wp
      do i = self%first_waiting, size(self%waiting)
         associate (point => self%waiting(i))
            allocate (point%result)
            call self%describe(point, point%result, error)
            if (allocated(error)) return
            if (point%kind == curve_kind%regular) self%estimate = estimate_of(point%result)
            if (.not. estimate_of(point%result) > estimate) cycle
            worst = i
            estimate = estimate_of(point%result)
         end associate
      end do
   end subroutine describe_all

   !> Where the curve stands, to come back to.
   function standing_at(self) result(here)
      class(followed_motion_t), intent(in) :: self
      type(standing_t) :: here

      here%rung = self%rung
      here%curve = self%curve
      here%largest = self%largest
      here%known = self%known
   end function standing_at

   !> Goes back there; work stays counted.
   subroutine stand_at(self, here, error)
      class(followed_motion_t), intent(inout), target :: self
      type(standing_t), intent(in) :: here
      type(error_t), allocatable, intent(out) :: error
      type(report_t) :: report

      call self%put_on(here%rung, error)
      if (allocated(error)) return
      call self%carry_start()
      report = self%curve%report
      self%curve = here%curve
      self%curve%problem%has_preconditioner = .false.                 ! the balance is another one
      self%curve%report = report
      call self%keep_symmetry()
      self%first_waiting = size(self%waiting) + 1
      self%largest = here%largest
      self%known = here%known
      call self%renew()
   end subroutine stand_at

   !> Takes the curve at its point over to another set and grid; `is_found` is false where the motion is not found there.
   subroutine change_set(self, rung, is_found, error)
      class(followed_motion_t), intent(inout), target :: self
      type(rung_t), intent(in) :: rung
      logical, intent(out) :: is_found
      type(error_t), allocatable, intent(out) :: error
      type(report_t) :: report
      real(wp), allocatable :: direction(:), x(:)
      real(wp) :: step, unevenness
      logical :: is_at_branch_point, is_uneven

      step = self%curve%step
      report = self%curve%report
      x = carry(self%rung%set, rung%set, self%curve%x, size(self%problem%which))
      direction = carry(self%rung%set, rung%set, self%curve%direction, size(self%problem%which))
      is_found = .false.
      call self%put_on(rung, error)
      if (allocated(error)) return
      is_at_branch_point = self%has_left_branch() .and. self%length <= 0.0_wp   ! there are two tangents
      is_found = is_at_branch_point
      unevenness = self%unevenness                                    ! a curve that goes on from a stored row has that of the start
      is_uneven = self%is_uneven
      if (.not. is_found) call self%find_on_plane(x, direction, is_found)
      self%unevenness = unevenness
      self%is_uneven = is_uneven
      if (.not. is_found) return
      call self%make_curve(x, direction)
      if (is_at_branch_point) then
         self%curve%direction = direction
         self%curve%orientation = 0.0_wp
         self%curve%status = outcome%pending
         call self%keep_symmetry()
      end if
      self%curve%step = step
      self%curve%report = report
      call self%carry_start()
      call self%renew()
      call self%look_here(self%known)
   end subroutine change_set

   !> Loads every tuple, so that none of the set is left out as one that nothing needs.
   pure subroutine need_all_tuples(scene)
      type(scene_t), intent(inout) :: scene

      scene%loads = as_amplitudes(spread(spread((1.0_wp, 0.0_wp), 1, scene%loads%n_dofs), 2, scene%loads%n_harmonics))
   end subroutine need_all_tuples
end module hb_curve_sets
