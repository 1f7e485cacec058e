!> A step of a curve of motions. Its length is limited so that the corrector converges and the events on it can be
!> located.
module hb_curve_step
   use hb_bifurcation, only: movement
   use hb_curve, only: curve_t, event_t
   use hb_curve_events, only: event_values_t
   use hb_curve_points, only: add_waiting, waiting_t
   use hb_event_location, only: find_events, retained_doubling
   use hb_followed_motion, only: max_tolerance_factor
   use hb_kinds, only: wp
   use hb_observed_motion, only: observed_motion_t
   use hb_outcome, only: outcome
   use hb_point_kinds, only: curve_kind
   use hb_thresholds, only: agreement, faint, next_to_none
   implicit none
   private
   public :: largest_change, longest_chord, step

   real(wp), parameter :: largest_turn = 0.6_wp                       ! [rad] on a step, unless it is short
   real(wp), parameter :: longest_chord = 2.0_wp                      ! of a step, unless it is short: 1.05 with the largest turn
   real(wp), parameter :: short = 1.0e-2_wp                           ! of the longest step; 1e-4: ten times as slow
   real(wp), parameter :: largest_change = 0.5_wp                     !! of a motion or an amplitude on a step
   real(wp), parameter :: off_the_line = 0.25_wp                      ! of a step, likewise: an arc that turns by 0.6 has 0.075

   !> The part of a coefficient along its change on a step: zero where its phase changes by half a turn.
   type, extends(event_t) :: coefficient_event_t
      integer :: cos = 0, sin = 0                                     ! positions of the coefficient among the unknowns
      complex(wp) :: weight = (0.0_wp, 0.0_wp)                        ! that makes both ends of the step of order 1
   contains
      procedure :: value => coefficient_event_value
   end type coefficient_event_t

   !> A coefficient of the motion, which a step passes.
   type :: passed_t
      integer :: cos = 0, sin = 0                                     ! positions among the unknowns
      complex(wp) :: before = 0.0_wp, behind = 0.0_wp                 ! at both ends of the step, in units of the weights
   contains
      procedure :: of => passed_of
      procedure :: largest => passed_largest
      procedure :: nearest_to_zero => passed_nearest_to_zero
   end type passed_t

contains

   !> Performs one step, and finds the events on it and its end; none if the curve cannot be followed, see its status.
   subroutine step(self, points)
      class(observed_motion_t), intent(inout), target :: self
      type(waiting_t), allocatable, intent(out) :: points(:)
      type(event_values_t) :: at_end
      real(wp) :: units(size(self%curve%x))
      logical :: is_balance, is_lost, is_near, is_short, is_taken

      allocate (points(0))
      call self%problem%refusal%forget()
      call self%prepare_step()
      is_balance = .not. allocated(self%at_point%impacts)
      associate (curve => self%curve)
         do
            units = curve%units
            call curve%advance()
            if (curve%status == outcome%stalled) call try_end(self, points)
            if (curve%status == outcome%stalled .and. self%is_rough .and. self%tolerance_factor < max_tolerance_factor) then
               self%tolerance_factor = 10.0_wp*self%tolerance_factor
               call self%update_units()
               curve%status = outcome%pending
               curve%step = curve%config%first_step
               cycle
            end if
            if (curve%status /= outcome%pending .or. size(points) > 0) return
            call self%update_units()
            call curve%turn()
            is_short = curve%last%step <= short*curve%config%longest_step
            is_near = norm2((curve%x - curve%last%x)/curve%units) <= longest_chord*curve%last%step
            is_taken = is_short .or. (curve%angle <= largest_turn .and. is_near)
            if (is_taken .and. is_balance) is_taken = .not. has_switched_branch(self)
            if (is_taken) then
               if (is_balance) then
                  if (self%tone_vanishes()) curve%status = outcome%collapsed
                  if (curve%status == outcome%collapsed) return
               end if
               call self%evaluate_here(at_end)
               call find_events(self, at_end, curve%n_branch_points > curve%last%n_branch_points, points, is_lost)
               if (is_short .or. self%is_rough .or. .not. is_lost) exit
               points = [waiting_t ::]
            end if
            call curve%retreat()
            if (curve%status == outcome%stalled) call try_end(self, points)
            if (curve%status /= outcome%pending .or. size(points) > 0) return
            curve%units = units
         end do
      end associate
      if (allocated(self%at_point%stability%multipliers) .and. allocated(at_end%stability%multipliers)) &
         at_end%speed = movement(self%at_point%stability%multipliers, at_end%stability%multipliers)/self%curve%last%step
      self%at_point = at_end
   end subroutine step

   !> Steps to an end of the range that is too close for another step: beyond it there may be no motions.
   subroutine try_end(self, points)
      class(observed_motion_t), intent(inout) :: self
      type(waiting_t), allocatable, intent(inout) :: points(:)
      real(wp) :: ends(2), gap, x(size(self%curve%x))
      integer :: i, n
      logical :: is_there

      n = size(x)
      ends = [self%request%from, self%request%to]
      do i = 1, size(ends)
         associate (curve => self%curve)
            gap = ends(i) - curve%x(n)
            if (abs(gap) > next_to_none*curve%units(n) .or. .not. gap*curve%direction(n) > 0.0_wp) cycle
            x = curve%x + gap/curve%direction(n)*curve%direction
            x(n) = ends(i)
            call curve%correct_at_value(x, is_there)
            if (.not. is_there) cycle
            curve%status = outcome%pending
            points = [waiting_t ::]
            call add_waiting(points, curve_kind%end, norm2((x - curve%x)/curve%units), x)
            return
         end associate
      end do
   end subroutine try_end

   !> Whether the step may have jumped to another part of the curve or to another curve, or passed over a narrow
   !> resonance.
   !> With little damping, two parts of the curve approach each other where a coefficient is nearly zero, and each
   !> continues in the direction of the other: neither tangents nor determinants reveal a jump between them, but the
   !> phase of the coefficient changes by half a turn. The phase also does so where the coefficient passes through
   !> zero. Therefore the curve is examined in between, where the chord is closest to zero: it must exist there and be
   !> near the chord. The gap between two parts may be far shorter than the step, so the zero itself is located as well:
   !> between two parts there is none.
   logical function has_switched_branch(self)
      class(observed_motion_t), intent(inout), target :: self
      type(coefficient_event_t) :: event
      type(passed_t) :: passed
      real(wp), allocatable :: middles(:)
      real(wp) :: position, share, size_of_motion, x(size(self%curve%x))
      integer :: d, h
      logical :: is_on_curve

      has_switched_branch = .false.
      if (self%curve%last%step <= next_to_none*self%curve%config%longest_step .or. self%is_rough) return
      has_switched_branch = abs(retained_doubling(self, self%curve)) <= faint                       ! to the motion of the whole period
      if (has_switched_branch) return
      if (size(self%problem%which) > 1) return                                ! unknown tones have no given phases
      allocate (middles(0))
      associate (curve => self%curve, set => self%problem%model%discretisation%harmonics, n => self%problem%n_unknowns)
         size_of_motion = maxval(abs(curve%x(:n)/self%weights))
         do h = 1, set%n_harmonics
            if (set%sin_at(h) == 0) cycle
            do d = 0, self%problem%n_dofs - 1
               passed = passed_t(cos=d*set%n_coefficients + set%cos_at(h), sin=d*set%n_coefficients + set%sin_at(h))
               passed%before = passed%of(curve%last%x, self%weights)
               passed%behind = passed%of(curve%x, self%weights)
               if (passed%largest() < faint*size_of_motion) cycle
               if (abs(passed%before - passed%behind) <= passed%largest()) cycle
               share = passed%nearest_to_zero()
               if (share <= 0.0_wp .or. share >= 1.0_wp .or. any(abs(middles - share) < 0.1_wp)) cycle
               middles = [middles, share]
               has_switched_branch = leaves_line(self, passed, share)
               if (has_switched_branch .or. curve%status /= outcome%pending) return
               event = zero_of(passed, self%weights)
               call curve%find_zero(event, [0.0_wp, curve%last%step], [event%value(curve, curve%last%x), &
                                                                       event%value(curve, curve%x)], x, position, is_on_curve)
               has_switched_branch = .not. is_on_curve
               if (has_switched_branch .or. curve%status /= outcome%pending) return
            end do
         end do
      end associate
   end function has_switched_branch

   !> Whether the curve, or a coefficient on it, is far from the line between both ends of the step at a share of it.
   logical function leaves_line(self, passed, share)
      class(observed_motion_t), intent(inout), target :: self
      type(passed_t), intent(in) :: passed
      real(wp), intent(in) :: share
      real(wp) :: x(size(self%curve%x))
      logical :: is_on_curve

      associate (curve => self%curve)
         call curve%point_at(share*curve%last%step, x, is_on_curve)
         leaves_line = .not. is_on_curve
         if (.not. leaves_line) leaves_line = off_the_line*curve%last%step < &
            norm2((x - (curve%last%x + share*(curve%x - curve%last%x)))/curve%units)
         if (.not. leaves_line) leaves_line = largest_change*passed%largest() < &
            abs(passed%of(x, self%weights) - (passed%before + share*(passed%behind - passed%before)))
      end associate
   end function leaves_line

   !> The event that a coefficient is zero along the chord of the step.
   pure type(coefficient_event_t) function zero_of(passed, weights) result(event)
      type(passed_t), intent(in) :: passed
      real(wp), intent(in) :: weights(:)

      event%cos = passed%cos
      event%sin = passed%sin
      event%weight = conjg(passed%behind - passed%before)/(abs(passed%behind - passed%before)*passed%largest()*weights(passed%cos))
      event%tolerance = agreement
   end function zero_of

   !> The coefficient at a point of the curve.
   pure complex(wp) function passed_of(self, x, weights) result(coefficient)
      class(passed_t), intent(in) :: self
      real(wp), intent(in) :: x(:), weights(:)

      coefficient = cmplx(x(self%cos)/weights(self%cos), x(self%sin)/weights(self%sin), wp)
   end function passed_of

   !> The larger amplitude of both ends.
   pure real(wp) function passed_largest(self) result(largest)
      class(passed_t), intent(in) :: self

      largest = max(abs(self%before), abs(self%behind))
   end function passed_largest

   !> Share of the step at which the chord of the coefficient is nearest to zero.
   pure real(wp) function passed_nearest_to_zero(self) result(share)
      class(passed_t), intent(in) :: self

      share = real(conjg(self%before)*(self%before - self%behind))/abs(self%before - self%behind)**2
   end function passed_nearest_to_zero

   real(wp) function coefficient_event_value(self, curve, x) result(value)
      class(coefficient_event_t), intent(inout) :: self
      class(curve_t), intent(inout) :: curve
      real(wp), intent(in) :: x(:)

      value = real(self%weight*cmplx(x(self%cos), x(self%sin), wp))
   end function coefficient_event_value
end module hb_curve_step
