!> Whether a step of a curve of balances has jumped to another part of the curve or to another curve.
module hb_switched_branch
   use hb_balance, only: balance_t
   use hb_curve, only: curve_t, event_t
   use hb_kinds, only: wp
   use hb_outcome, only: outcome
   use hb_thresholds, only: equality_tolerance, negligible_share
   implicit none
   private
   public :: has_switched_branch, max_change

   real(wp), parameter :: max_change = 0.5_wp                         !! of a motion or an amplitude on a step, relative
   real(wp), parameter :: max_distance_from_chord = 0.25_wp           ! of a step: an arc that turns by 0.6 has 0.075

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

   !> Whether the step may have jumped to another part of the curve or to another curve, or passed over a narrow
   !> resonance.
   !> With little damping, two parts of the curve approach each other where a coefficient is nearly zero, and each
   !> continues in the direction of the other: neither tangents nor determinants reveal a jump between them, but the
   !> phase of the coefficient changes by half a turn. The phase also does so where the coefficient passes through
   !> zero. Therefore the curve is examined in between, where the chord is closest to zero: it must exist there and be
   !> near the chord. The gap between two parts may be far shorter than the step, so the zero itself is located as well:
   !> between two parts there is none.
   logical function has_switched_branch(balance, weights, curve)
      class(balance_t), intent(in) :: balance
      real(wp), intent(in) :: weights(:)                              !! typical motion, (unknowns of the balance)
      type(curve_t), intent(inout) :: curve                           !! at the end of the step
      type(coefficient_event_t) :: event
      type(passed_t) :: passed
      real(wp), allocatable :: middles(:)
      real(wp) :: position, share, size_of_motion, x(size(curve%x))
      integer :: d, h
      logical :: is_on_curve

      has_switched_branch = .false.
      allocate (middles(0))
      associate (set => balance%harmonics, n => balance%n_unknowns)
         size_of_motion = maxval(abs(curve%x(:n)/weights))
         do h = 1, set%n_harmonics
            if (set%sin_at(h) == 0) cycle
            do d = 0, balance%n_dofs - 1
               passed = passed_t(cos=d*set%n_coefficients + set%cos_at(h), sin=d*set%n_coefficients + set%sin_at(h))
               passed%before = passed%of(curve%last%x, weights)
               passed%behind = passed%of(curve%x, weights)
               if (passed%largest() < negligible_share*size_of_motion) cycle
               if (abs(passed%before - passed%behind) <= passed%largest()) cycle
               share = passed%nearest_to_zero()
               if (share <= 0.0_wp .or. share >= 1.0_wp .or. any(abs(middles - share) < 0.1_wp)) cycle
               middles = [middles, share]
               has_switched_branch = leaves_line(curve, weights, passed, share)
               if (has_switched_branch .or. curve%status /= outcome%pending) return
               event = zero_of(passed, weights)
               call curve%find_zero(event, [0.0_wp, curve%last%step], [event%value(curve, curve%last%x), &
                                                                       event%value(curve, curve%x)], x, position, is_on_curve)
               has_switched_branch = .not. is_on_curve
               if (has_switched_branch .or. curve%status /= outcome%pending) return
            end do
         end do
      end associate
   end function has_switched_branch

   !> Whether the curve, or a coefficient on it, is far from the line between both ends of the step at a share of it.
   logical function leaves_line(curve, weights, passed, share)
      type(curve_t), intent(inout) :: curve
      real(wp), intent(in) :: weights(:)
      type(passed_t), intent(in) :: passed
      real(wp), intent(in) :: share
      real(wp) :: x(size(curve%x))
      logical :: is_on_curve

      call curve%point_at(share*curve%last%step, x, is_on_curve)
      leaves_line = .not. is_on_curve
      if (.not. leaves_line) leaves_line = max_distance_from_chord*curve%last%step < &
         norm2((x - (curve%last%x + share*(curve%x - curve%last%x)))/curve%units)
      if (.not. leaves_line) leaves_line = max_change*passed%largest() < &
         abs(passed%of(x, weights) - (passed%before + share*(passed%behind - passed%before)))
   end function leaves_line

   !> The event that a coefficient is zero along the chord of the step.
   pure type(coefficient_event_t) function zero_of(passed, weights) result(event)
      type(passed_t), intent(in) :: passed
      real(wp), intent(in) :: weights(:)

      event%cos = passed%cos
      event%sin = passed%sin
      event%weight = conjg(passed%behind - passed%before)/(abs(passed%behind - passed%before)*passed%largest()*weights(passed%cos))
      event%tolerance = equality_tolerance
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
end module hb_switched_branch
