!> The verdict of a time integration on the motion from which it starts, decided period by period from two numbers:
!> the difference between time integration and motion, and the distance to a second time integration that started very
!> close to it.
!>
!> The distance of both time integrations grows if the motion is unstable, however accurate it is, and falls with the
!> decay of the initial error if it is stable. Growth is therefore checked first, and differences count after the
!> transient has decayed.
module hb_integration_verdict
   use hb_kinds, only: wp
   implicit none
   private
   public :: certain_growth, decide, growth_of, limit_of, min_growth, n_steady, verdict, verdict_kind_t, verdict_names, verdict_t, &
      verdict_text

   real(wp), parameter :: estimate_safety = 5.0_wp                    ! on the estimate of the error estimate
   real(wp), parameter :: largest_limit = 0.08_wp                     ! of a motion, whatever the estimate; with several tones
                                                                      !! a longer time integration would find up to a tenth
   real(wp), parameter :: smallest_limit = 1.0e-9_wp
   real(wp), parameter :: certain_growth = 30.0_wp                    !! of the distance: certain, unless it may be transient
   real(wp), parameter :: beyond_transients = 1.0e6_wp                ! likewise: certain in any case
   real(wp), parameter :: min_growth = 3.0_wp !! of the distance: before the difference exceeds its limit, growth
   real(wp), parameter :: forgetting_fall = 100.0_wp                  ! fall of the distance after which the start has no influence
   real(wp), parameter :: min_fall_of_difference = 1.3_wp             ! of the difference, from one group of periods to the next
   real(wp), parameter :: half_decay = 1.5_wp                     ! likewise over `decay` periods, as a logarithm: half of its fall
   real(wp), parameter :: distance_fall = 2.0_wp                      ! fall of the distance that counts
   real(wp), parameter :: neutral_rise = 1.2_wp                       ! rise of the distance that does not count
   real(wp), parameter :: shear_rise = 4.5_wp                         ! likewise if nothing decays: like the square of time
   real(wp), parameter :: drift_rise = 2.2_wp                         ! likewise: like time
   real(wp), parameter :: max_late_growth_share = 0.42_wp             ! part of a logarithmic growth in the second half of the
                                                                      ! periods: 0.5 if exponential, 0.37 if threefold like time
   integer, parameter :: min_fitted = 2                            ! periods

   type :: verdict_kind_t
      integer :: not_done = 0
      integer :: agrees = 1
      integer :: unstable = 2
      integer :: differs = 3
      integer :: undecided = 4
   end type verdict_kind_t
   type(verdict_kind_t), parameter :: verdict = verdict_kind_t()
   character(9), parameter :: verdict_names(0:4) = [character(9) :: "not_done", "agrees", "unstable", "differs", "undecided"]

   !> Result of the verification of a motion.
   type :: verdict_t
      integer :: kind = verdict%not_done
      integer :: skipped_status = 0                                   !! outcome of a point without a motion to start from
      real(wp) :: first_difference = 0.0_wp                           !! in the first period, relative: the worst coordinate
      real(wp) :: difference = 0.0_wp !! in the last ones, of the coordinate with the largest ratio to its limit
      real(wp) :: limit = 0.0_wp                                      !! of that difference
      character(:), allocatable :: coordinate                         !! its name
      real(wp) :: growth = 0.0_wp                                     !! of neighbouring trajectories [1/s]
      real(wp), allocatable :: drift(:)                               !! of the unknown frequencies [rad/s], (n_tones)
      real(wp) :: duration = 0.0_wp                                   !! of the time integration [s]
      integer :: n_periods = 0                                        !! of the slowest tone, likewise
      character(:), allocatable :: ended_by                           !! error that ended the time integration
      logical :: is_of_coefficients = .false.                         !! both differences are that of the coefficients, those of
                                                                      !! a second time integration to its end; no `growth`
      logical :: starts_beside = .false. !! on the periodic motion next to the series, from which time integration diverges
   end type verdict_t

contains

   !> Text of a verdict.
   pure function verdict_text(kind) result(text)
      integer, intent(in) :: kind
      character(100) :: text

      select case (kind)
      case (verdict%agrees); text = "agrees with time integration"
      case (verdict%unstable); text = "unstable: time integration diverges from the motion"
      case (verdict%differs); text = "differs from time integration by more than the estimated error allows"
      case (verdict%undecided)
         text = "undecided: disturbances neither decayed nor grew, or a beat lasts longer"
      case default; text = "not verified"
      end select
   end function verdict_text

   !> Largest difference (relative to the motion of a coordinate) at which time integration agrees: a small multiple
   !> of the estimate, at most 8 %.
   pure elemental real(wp) function limit_of(estimate, share)
      real(wp), intent(in) :: estimate                                !! relative error according to the error estimate
      real(wp), intent(in) :: share                                   !! factor by which it may be larger in this coordinate, >= 1

      limit_of = min(largest_limit, max(estimate_safety*min(estimate, 1.0_wp), smallest_limit)*min(share, 1.0_wp/smallest_limit))
   end function limit_of

   !> Verdict after some periods; `not_done` if the time integration must continue. Disturbances of a stable motion may grow before
   !> they decay, as far as the shapes in which they decay are nearly parallel: with `may_recover` growth counts as transient as
   !> long as the time integration has not left the motion and is not over; a growth like a power of time, of a body that is nearly
   !> free, is not known to last before the structure has decayed. Where nothing holds a body, disturbances move it on like time, as
   !> errors of the time integration do: no sign of an instability.
   pure integer function decide(ratio, distance, fewest, decay, is_last, may_recover, is_free) result(kind)
      real(wp), intent(in) :: ratio(:)                                !! of the difference to its limit, (n_periods)
      real(wp), intent(in) :: distance(:) !! of both time integrations, logarithm, 0 at the start, (n_periods)
      integer, intent(in) :: fewest                                   !! periods that cover the whole motion
      integer, intent(in) :: decay !! periods in which the transient of the structure decays, 0: it does not
      logical, intent(in) :: is_last                                  !! no more periods
      logical, intent(in), optional :: may_recover                    !! default: growth is certain
      logical, intent(in), optional :: is_free                        !! nothing linear holds some body; default: false
      logical :: has_forgotten, has_left
      real(wp) :: certain, gain, rise
      integer :: n, tail

      kind = verdict%not_done
      n = size(ratio)
      if (n < fewest .and. .not. is_last) return
      tail = n_steady(n, fewest)
      has_left = maxval(ratio(n - tail + 1:)) > 1.0_wp
      has_forgotten = distance(n) <= start_of(distance) - log(forgetting_fall)
      call find_growth(ratio, distance, has_left, gain, rise)
      certain = certain_growth
      if (present(may_recover)) then
         if (may_recover .and. .not. has_left .and. .not. is_last) certain = beyond_transients
      end if
      if (gain >= log(certain) .and. rise >= log(min_growth)) then
         kind = verdict%unstable
      else if (has_left) then
         if (is_falling(ratio, tail, decay, is_last)) then
            if (is_last) kind = verdict%undecided
         else if (has_forgotten .or. is_last .or. n >= max(decay, 2*fewest)) then
            kind = merge(verdict%unstable, verdict%differs, gain >= log(min_growth) .and. rise > 0.0_wp)
            if (kind == verdict%unstable .and. present(is_free)) then
               if (is_free .and. rise <= min(log(drift_rise), max_late_growth_share*gain)) kind = verdict%undecided
            end if
         end if
      else if (has_forgotten .and. rise_of(distance(n - tail + 1:)) <= log(neutral_rise)) then
         kind = verdict%agrees
      else if (is_last) then
         kind = verdict%undecided
         if (rise <= -log(distance_fall) .or. (n >= fewest .and. rise <= log(merge(neutral_rise, shear_rise, decay > 0)))) &
            kind = verdict%agrees
      end if
      if (.not. present(may_recover)) return
      if (may_recover .and. is_last .and. kind == verdict%unstable .and. n < decay .and. rise <= log(shear_rise)) &
         kind = verdict%undecided                                     ! like a power of time, over less than a decay
   end function decide

   !> Distance at the start, as a logarithm: the fall in the first period counts.
   pure real(wp) function start_of(distance) result(start)
      real(wp), intent(in) :: distance(:)                             !! (n_periods)

      start = max(distance(1), 0.0_wp)
   end function start_of

   !> Growth of the distance as long as the difference is within its limit: over all of these periods, and in the later ones.
   pure subroutine find_growth(ratio, distance, has_left, gain, rise)
      real(wp), intent(in) :: ratio(:), distance(:)                   !! (n_periods), as those of `decide`
      logical, intent(in) :: has_left                                 !! the difference exceeds its limit in the last periods
      real(wp), intent(out) :: gain, rise                             !! logarithms
      integer :: n

      n = size(ratio)
      if (has_left) n = n_within_limit(ratio)
      gain = 0.0_wp
      rise = 0.0_wp
      if (n < min_fitted) return
      gain = distance(n) - start_of(distance)
      rise = rise_of(distance(:n))
   end subroutine find_growth

   !> Number of periods before the difference exceeds its limit; at least two, which tell growth from a jump.
   pure integer function n_within_limit(ratio) result(n)
      real(wp), intent(in) :: ratio(:)                                !! (n_periods), as that of `decide`

      n = findloc(ratio > 1.0_wp, .true., dim=1) - 1
      if (n < 0) n = size(ratio)
      n = min(size(ratio), max(n, min_fitted))
   end function n_within_limit

   !> Whether the difference decreases in the last periods, or may still do so.
   pure logical function is_falling(ratio, tail, decay, is_last)
      real(wp), intent(in) :: ratio(:)                                !! (n_periods)
      integer, intent(in) :: tail                                     !! number of the last periods
      integer, intent(in) :: decay                                    !! as that of `decide`
      logical, intent(in) :: is_last
      integer :: n, stretch

      n = size(ratio)
      stretch = tail
      if (is_last) stretch = max(tail, n/4)                           ! fluctuations fall from time to time
      is_falling = n >= 2*stretch
      if (is_falling) is_falling = mean_of(ratio(n - stretch + 1:)) < mean_of(ratio(n - 2*stretch + 1:n - stretch)) &
                                   - min(log(min_fall_of_difference), half_decay*stretch/max(1, decay))
      if (is_last .and. n >= 2*decay .and. decay > 0) is_falling = .false.
   end function is_falling

   !> Mean of ratios, as a logarithm.
   pure real(wp) function mean_of(ratio)
      real(wp), intent(in) :: ratio(:)

      mean_of = sum(log(max(ratio, tiny(1.0_wp))))/size(ratio)
   end function mean_of

   !> The last periods, in which a time integration counts as steady.
   pure integer function n_steady(n, fewest)
      integer, intent(in) :: n, fewest                                !! periods

      n_steady = max(1, min(n/2, max(5, fewest/2)))
   end function n_steady

   !> Slope of the logarithm of the distance, per period, over the second half of the periods before the difference
   !> exceeds its limit.
   pure real(wp) function growth_of(ratio, distance) result(growth)
      real(wp), intent(in) :: ratio(:), distance(:)                   !! as in `decide`
      integer :: n

      n = n_within_limit(ratio)
      growth = 0.0_wp
      if (n > 1) growth = rise_of(distance(:n))/(n - n/2)
   end function growth_of

   !> Rise of a straight line through the second half of some values, from the last one of the first half on.
   pure real(wp) function rise_of(values)
      real(wp), intent(in) :: values(:)
      real(wp), allocatable :: half(:), abscissa(:)
      integer :: k, n

      rise_of = 0.0_wp
      allocate (half, source=values(max(1, size(values)/2):))
      n = size(half)
      if (n < 2) return
      allocate (abscissa, source=[(k - 0.5_wp*(n + 1), k=1, n)])
      rise_of = sum(abscissa*half)/sum(abscissa**2)*(n - 1)
   end function rise_of
end module hb_integration_verdict
