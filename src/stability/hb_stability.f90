!> Stability of a motion: growth or decay of small disturbances.
!>
!> One tone: Floquet multipliers, the eigenvalues of the map of a disturbance over a period; the motion is stable if
!> all are smaller than 1 in magnitude. Several tones: Lyapunov exponents, stable if all are negative. A shift in the
!> phase of an unknown tone has the multiplier 1 or the exponent 0 and is omitted. Source: docs/why/theory.md, section
!> 8.
module hb_stability
   use hb_kinds, only: two_pi, wp
   use hb_law, only: law_box_t
   use hb_spectrum, only: spectrum_t
   use hb_structure, only: structure_t
   use hb_thresholds, only: certainty_factor, estimate_safety, small_share
   use hb_tones, only: tones_t
   implicit none
   private
   public :: change_of_variances, excitation_t, few_periods, harmonic_motion_t, max_multipliers, n_multipliers_of
   public :: noise_response_t, noise_status, noise_status_names, share_of_stability, stability_config_t, stability_finder_t
   public :: stability_method, stability_method_names, stability_t, unknown_because, unknown_because_names, verdict
   public :: work_of_verdict

   integer, parameter :: max_multipliers = 16                        !! that are stored, the largest
   real(wp), parameter :: share_of_stability = 0.3_wp                 !! of the work of a point
   real(wp), parameter :: min_share = 1.0e-2_wp                       ! of the mean variance: what a least one is compared with
   integer, parameter :: few_periods = 25                             !! for exponents far from zero, and if more take too long

   type :: stability_method_t
      integer :: off = 0
      integer :: auto = 1
      integer :: integration = 2
   end type stability_method_t
   type(stability_method_t), parameter :: stability_method = stability_method_t()
   character(11), parameter :: stability_method_names(0:2) = [character(11) :: "off", "auto", "integration"]

   type :: verdict_t
      integer :: unstable = -1
      integer :: unknown = 0
      integer :: stable = 1
   end type verdict_t
   type(verdict_t), parameter :: verdict = verdict_t()

   !> Why a verdict is not known.
   type :: unknown_because_t
      integer :: none = 0                                             !! it is known, or was not requested
      integer :: too_costly = 1                                       !! it would exceed the permitted work
      integer :: too_large = 2                                        !! the structure has no dense matrices
      integer :: too_many_cycles = 3                                  !! of the fastest harmonic in a period of the slowest tone
      integer :: no_equations = 4                                     !! in time, linear along the motion
      integer :: at_limit = 5                                         !! the limit of stability is within the error
      integer :: inaccurate = 6                                       !! the motion: a better one has or may have another verdict
      integer :: growing = 7                                          !! disturbances grow within a slow period before they decay
      integer :: contradicted = 8                                     !! by the time integration that has led to the motion
      integer :: status = 9                                           !! that of the motion permits no verdict
      integer :: at_bifurcation = 10                                  !! a point of a curve that was located there
   end type unknown_because_t
   type(unknown_because_t), parameter :: unknown_because = unknown_because_t()
   character(15), parameter :: unknown_because_names(0:10) = [character(15) :: "none", "too_costly", "too_large", &
      "too_many_cycles", "no_equations", "at_limit", "inaccurate", "growing", "contradicted", "status", &
      "at_bifurcation"]

   type :: stability_config_t
      integer :: method = stability_method%auto
      real(wp) :: patience = share_of_stability                       !! of `auto`: permitted work, relative to a typical point
      real(wp) :: work_spent = 0.0_wp                                 !! on the motion, in about a nanosecond: `auto` may always
                                                                      !! use a share of it
      real(wp) :: tolerance = 1.0e-6_wp                               !! of the monodromy matrix, relative
      integer :: min_periods = 100                                 !! of the slowest tone, for exponents
      integer :: max_periods = 800                                   !! likewise, while the sign of the largest is undecided
      real(wp) :: noise_frequency = -1.0_wp !! of the wanted spectral density of the response to noise [rad/s]; < 0: none
      logical :: is_integrated = .false. !! always of the periodic motion of the time integration
   end type stability_config_t

   !> Why the covariance of noise is known, or not.
   type :: noise_status_t
      integer :: none = 0                                             !! there is no noise
      integer :: known = 1
      integer :: no_verdict = 2                                       !! the stability is not known
      integer :: unstable = 3
      integer :: several_tones = 4
      integer :: unbounded = 5                                        !! nothing holds a displacement
      integer :: infinite = 6                                         !! it acts where there is neither mass nor constant damping
      integer :: too_costly = 7
      integer :: no_equations = 8                                     !! in time: rigid laws, parts that depend on frequency
      integer :: inaccurate = 9                                       !! the motion is too far from a periodic one
   end type noise_status_t
   type(noise_status_t), parameter :: noise_status = noise_status_t()
   character(13), parameter :: noise_status_names(0:9) = [character(13) :: "none", "known", "no_verdict", "unstable", &
      "several_tones", "unbounded", "infinite", "too_costly", "no_equations", "inaccurate"]

   !> What the noise of the loads causes about a motion: the variances of the degrees of freedom in their own units squared.
   type :: noise_response_t
      integer :: status = noise_status%none
      real(wp), allocatable :: variance(:)                            !! mean over a period, (n_dofs)
      real(wp), allocatable :: peak(:), least(:)                      !! largest and smallest in a period, (n_dofs)
      real(wp), allocatable :: spectrum(:)                            !! one-sided density, mean over a period [square s], (n_dofs)
      real(wp), allocatable :: phase_diffusion(:)                     !! rate of the variance of the phases [rad**2/s], (n_tones); 0
                                                                      !! of given tones
      real(wp) :: estimate = 0.0_wp                                   !! of the relative error of the variances
   contains
      procedure :: compare_with => noise_response_compare_with
      procedure :: scale => noise_response_scale
      procedure :: select_dofs => noise_response_select_dofs
      procedure :: fail => noise_response_fail
   end type noise_response_t

   type :: stability_t
      integer :: verdict = verdict%unknown
      integer :: n_unstable = 0                                       !! multipliers outside the unit circle, or exponents > 0;
                                                                      !! beside much larger ones they are not known, nor counted
      integer :: method = stability_method%off                        !! the one that was used
      logical :: is_integrated = .false.                              !! computed along a periodic motion of the time domain
      integer :: reason = unknown_because%none                        !! of a verdict that is not known
      integer :: n_periods = 0                                        !! of the slowest tone, over which exponents are averaged
      real(wp) :: estimate = 0.0_wp                                   !! of the relative error of the monodromy matrix, of its
                                                                      !! error for a phase shift, or of the change of the
                                                                      !! largest multiplier with the errors of the motion; for
                                                                      !! several tones the spread of the largest exponent [1/s]
      real(wp) :: noise = 0.0_wp                                      !! error of all multipliers by that of the matrix, which is
                                                                      !! relative to the largest one
      real(wp) :: growth = 1.0_wp                                     !! of disturbances that decay on average, within a period
                                                                      !! of the slowest tone, if that prevents a verdict
      complex(wp), allocatable :: multipliers(:)                      !! of one tone, the largest first
      complex(wp), allocatable :: along_series(:)                     !! likewise, one of them outside the unit circle: along the
                                                                      !! series, where no periodic motion was found near it
      real(wp), allocatable :: exponents(:)                           !! [1/s], the largest first; of one tone growth rates
      type(noise_response_t) :: response                              !! to the noise of the loads
   contains
      procedure :: withdraw => stability_withdraw
      procedure :: compare_with => stability_compare_with
      procedure :: unstable_along_series => stability_unstable_along_series
      procedure :: resolves_circle => stability_resolves_circle
   end type stability_t

   !> A motion of some tones.
   type :: harmonic_motion_t
      integer, allocatable :: tuples(:, :)                            !! (n_tones, n_harmonics)
      type(tones_t) :: tones
      complex(wp), allocatable :: amplitudes(:, :)                    !! cos - i sin, (n_dofs, n_harmonics)
   end type harmonic_motion_t

   !> Loads of a motion, and the restitution of walls.
   type :: excitation_t
      type(spectrum_t) :: loads                                       !! [N]
      real(wp) :: restitution = 0.0_wp                                !! of walls without a value of their own
      real(wp), allocatable :: noise(:, :)                            !! forces of independent white noises of density 1
                                                                      !! [N s**(1/2)], (n_dofs, n_sources)
   end type excitation_t

   !> Stability solver, hb_floquet; without one nothing is known.
   type, abstract :: stability_finder_t
   contains
      procedure(find_stability), deferred :: find
   end type stability_finder_t

   abstract interface
      !> `auto` does so if it does not exceed the permitted work. Otherwise the result is not known.
      subroutine find_stability(self, stability, config, motion, structure, laws, excitation, work_allowed)
         import :: excitation_t, harmonic_motion_t, law_box_t, stability_config_t, stability_finder_t, stability_t, structure_t, wp
         class(stability_finder_t), intent(in) :: self
         type(stability_t), intent(out) :: stability
         type(stability_config_t), intent(in) :: config
         type(harmonic_motion_t), intent(in) :: motion
         type(structure_t), intent(in) :: structure
         type(law_box_t), intent(in) :: laws(:)
         type(excitation_t), intent(in) :: excitation
         real(wp), intent(in) :: work_allowed                         !! in about a nanosecond
      end subroutine find_stability
   end interface

contains

   !> Work that a verdict on a motion may take in any case: a share of that of the motion.
   pure real(wp) function work_of_verdict(work_spent, at_least) result(work)
      real(wp), intent(in) :: work_spent                              !! on the motion
      real(wp), intent(in) :: at_least

      work = max(share_of_stability*work_spent, at_least)
   end function work_of_verdict

   !> Number of multipliers stored for a structure and the states of its laws, each of which has one.
   pure integer function n_multipliers_of(structure, laws)
      type(structure_t), intent(in) :: structure
      type(law_box_t), intent(in) :: laws(:)
      integer :: i

      n_multipliers_of = min(2*structure%n_dofs + sum([(laws(i)%law%n_states, i=1, size(laws))]), max_multipliers)
   end function n_multipliers_of

   !> Makes the verdict unknown, for the first of several reasons.
   pure subroutine stability_withdraw(self, reason)
      class(stability_t), intent(inout) :: self
      integer, intent(in) :: reason                                   !! of unknown_because

      if (self%verdict == verdict%unknown .and. self%reason /= unknown_because%none) return
      self%verdict = verdict%unknown
      self%reason = reason
   end subroutine stability_withdraw

   !> Compares with the result along a more accurate motion: a verdict on which both do not agree, or which lies
   !> within twice the change of the largest multiplier (outside the unit circle: three times that of its logarithm) or, where it is
   !> negative, exponent, is not known; nor is it if the errors of multipliers may let two of them meet.
   pure subroutine stability_compare_with(self, better)
      class(stability_t), intent(inout) :: self
      type(stability_t), intent(in) :: better

      if (allocated(self%multipliers) .and. allocated(better%multipliers)) then
         call compare_multipliers(self, better)
      else if (.not. allocated(self%multipliers) .and. allocated(self%exponents) .and. allocated(better%exponents)) then
         call compare_exponents(self, better)
      else if (allocated(self%multipliers) .or. allocated(self%exponents) .or. self%verdict /= better%verdict) then
         ! without either, it was counted by Hill's determinant
         call self%withdraw(merge(better%reason, unknown_because%inaccurate, better%reason /= unknown_because%none))
      end if
      call self%response%compare_with(better%response, self%verdict)
   end subroutine stability_compare_with

   !> Compares with the result along a more accurate motion: the estimated error is at least the change; nothing is known of a
   !> motion that is not stable.
   pure subroutine noise_response_compare_with(self, better, of_motion)
      class(noise_response_t), intent(inout) :: self
      type(noise_response_t), intent(in) :: better
      integer, intent(in) :: of_motion                                !! verdict on the motion

      if (self%status /= noise_status%known) return
      if (of_motion /= verdict%stable) then
         call self%fail(noise_status%no_verdict)
      else if (better%status /= noise_status%known) then
         call self%fail(better%status)
      else
         self%estimate = max(self%estimate, change_of_variances(self, better), change(self%phase_diffusion, better%phase_diffusion))
      end if
   end subroutine noise_response_compare_with

   !> Largest relative change of the variances of a response to those of another. A least variance may vanish, as that of a limit
   !> cycle at its own phase: below a share of the mean one it counts as this share.
   pure real(wp) function change_of_variances(from, to) result(largest)
      type(noise_response_t), intent(in) :: from, to
      real(wp) :: small(size(from%variance))

      small = min_share*max(from%variance, to%variance)
      largest = max(change(from%variance, to%variance), change(from%peak, to%peak), &
                    change(max(from%least, small), max(to%least, small)))
   end function change_of_variances

   !> Largest relative change of numbers that are not negative; NaN counts as none.
   pure real(wp) function change(from, to)
      real(wp), intent(in) :: from(:), to(:)
      real(wp), dimension(size(from)) :: larger

      larger = max(from, to)
      change = maxval(abs(from - to)/max(larger, tiny(1.0_wp)), mask=larger > 0.0_wp)
      change = max(change, 0.0_wp)
   end function change

   !> Variances in the units of the model, from those of scaled coordinates.
   pure subroutine noise_response_scale(self, units)
      class(noise_response_t), intent(inout) :: self
      real(wp), intent(in) :: units(:)                                !! of each coordinate, (n_dofs)

      if (.not. allocated(self%variance)) return
      self%variance = units**2*self%variance
      self%peak = units**2*self%peak
      self%least = units**2*self%least
      if (allocated(self%spectrum)) self%spectrum = units**2*self%spectrum
   end subroutine noise_response_scale

   !> Reduces variances of all degrees of freedom to some of them.
   pure subroutine noise_response_select_dofs(self, dofs)
      class(noise_response_t), intent(inout) :: self
      integer, intent(in) :: dofs(:)

      if (.not. allocated(self%variance)) return
      self%variance = self%variance(dofs)
      self%peak = self%peak(dofs)
      self%least = self%least(dofs)
      if (allocated(self%spectrum)) self%spectrum = self%spectrum(dofs)
   end subroutine noise_response_select_dofs

   !> Makes the response unknown, for a reason.
   pure subroutine noise_response_fail(self, status)
      class(noise_response_t), intent(inout) :: self
      integer, intent(in) :: status                                   !! of noise_status

      self%status = status
      if (allocated(self%variance)) deallocate (self%variance, self%peak, self%least)
      if (allocated(self%phase_diffusion)) deallocate (self%phase_diffusion)
      if (allocated(self%spectrum)) deallocate (self%spectrum)
   end subroutine noise_response_fail

   pure subroutine compare_exponents(self, better)
      type(stability_t), intent(inout) :: self
      type(stability_t), intent(in) :: better

      associate (here => self%exponents(1), there => better%exponents(1))
         self%estimate = max(self%estimate, abs(here - there))
         if ((self%verdict == verdict%stable .and. max(here, there) >= -2.0_wp*abs(here - there)) .or. &
             (self%verdict == verdict%unstable .and. there <= 0.0_wp)) call self%withdraw(unknown_because%inaccurate)
      end associate
   end subroutine compare_exponents

   pure subroutine compare_multipliers(self, better)
      type(stability_t), intent(inout) :: self
      type(stability_t), intent(in) :: better

      associate (here => abs(self%multipliers(1)), there => abs(better%multipliers(1)))
         self%estimate = max(self%estimate, abs(here - there))
         if (self%verdict /= better%verdict .or. &
             (self%verdict == verdict%stable .and. max(here, there) >= 1.0_wp - 2.0_wp*abs(here - there))) &
            call self%withdraw(unknown_because%inaccurate)
         if (self%verdict == verdict%unstable) then                    ! both are outside
            if (log(min(here, there)) <= estimate_safety*abs(log(here/there)) .or. &
                may_cross(self%multipliers(1), partner_of(self%multipliers), better%multipliers, estimate_safety)) &
               call self%withdraw(unknown_because%inaccurate)
         end if
      end associate
      if (self%verdict == verdict%stable .and. move_far(self%multipliers, better%multipliers)) &
         call self%withdraw(unknown_because%inaccurate)
   end subroutine compare_multipliers

   !> The multiplier inside the unit circle from which the largest, outside, has parted: the nearest in direction; none if all are
   !> outside.
   pure function partner_of(multipliers) result(partner)
      complex(wp), intent(in) :: multipliers(:)                       !! the largest first
      complex(wp), allocatable :: partner(:), inside(:)
      integer :: k

      inside = pack(multipliers, abs(multipliers) < 1.0_wp .and. abs(multipliers) > 0.0_wp)
      k = minloc(abs(inside/abs(inside) - multipliers(1)/abs(multipliers(1))), dim=1)
      partner = inside(max(1, k):k)
   end function partner_of

   !> The verdict along the series itself: of a motion so unstable that small errors lead away from the periodic motion next to it.
   !> It holds if that of a more accurate series is the same; a motion without such multipliers is returned unchanged.
   pure type(stability_t) function stability_unstable_along_series(self, omega) result(stability)
      class(stability_t), intent(in) :: self
      real(wp), intent(in) :: omega                                   !! [rad/s]

      stability = self
      if (.not. allocated(self%along_series)) return
      call move_alloc(stability%along_series, stability%multipliers)
      stability%n_unstable = count(abs(stability%multipliers) > 1.0_wp)
      stability%exponents = log(max(abs(stability%multipliers), tiny(1.0_wp)))*omega/two_pi
      stability%verdict = verdict%unstable
      stability%reason = unknown_because%none
   end function stability_unstable_along_series

   !> Whether multipliers on the unit circle have digits beside the errors of the largest one.
   pure logical function stability_resolves_circle(self) result(resolves)
      class(stability_t), intent(in) :: self

      resolves = .false.
      if (allocated(self%multipliers)) resolves = certainty_factor*self%noise < small_share .and. &
                                                  all(certainty_factor*epsilon(1.0_wp)*abs(self%multipliers) < small_share)
   end function stability_resolves_circle

   !> Whether twice the change of a multiplier moves it to the unit circle and, for a complex one, to its nearest neighbour: with
   !> light damping pairs lie on a circle inside, on which they may rotate freely until they meet others; next to the unit circle
   !> errors of pairs count.
   pure logical function move_far(multipliers, better)
      complex(wp), intent(in) :: multipliers(:), better(:)
      real(wp) :: change
      integer :: i

      move_far = .false.
      do i = 1, size(multipliers)
         associate (m => multipliers(i), others => [multipliers(:i - 1), multipliers(i + 1:)])
            change = minval(abs(m - better))
            if (2.0_wp*change < 1.0_wp - abs(m)) cycle
            if (abs(aimag(m)) <= 0.0_wp) then
               move_far = .true.
            else if (1.0_wp - abs(m) < small_share) then
               move_far = move_far .or. may_cross(m, pack(others, 1.0_wp - abs(others) < small_share), better, 1.0_wp)
            else
               move_far = move_far .or. 2.0_wp*change >= minval(abs(m - others))
            end if
         end associate
      end do
   end function move_far

   !> Whether its error may lead a multiplier, together with another one that it meets or has parted from, through the unit
   !> circle: the product of their logarithms, in the direction of the point of the circle between them, moves like an error;
   !> next to their meeting their difference moves like its square root.
   pure logical function may_cross(m, others, better, changes)
      complex(wp), intent(in) :: m, others(:), better(:)
      real(wp), intent(in) :: changes                                 !! that the more accurate one may still be off by
      complex(wp), allocatable :: rest(:)
      complex(wp) :: here, mean, mean_there, there
      integer :: k, nearest

      may_cross = size(better) <= size(others)
      if (may_cross) return
      nearest = minloc(abs(m - better), dim=1)
      rest = [better(:nearest - 1), better(nearest + 1:)]
      do k = 1, size(others)
         associate (other => rest(minloc(abs(others(k) - rest), dim=1)))
            mean = sqrt(m)*sqrt(others(k))
            if (abs(m + others(k) + 2.0_wp*mean) < abs(m + others(k) - 2.0_wp*mean)) mean = -mean
            mean_there = sqrt(better(nearest))*sqrt(other)
            if (abs(mean_there + mean) < abs(mean_there - mean)) mean_there = -mean_there
            here = distances(m, others(k), mean)
            there = distances(better(nearest), other, mean_there)
         end associate
         may_cross = may_cross .or. changes*abs(here - there) >= min(abs(here), abs(there))
      end do

   contains

      !> Product of the logarithms of two multipliers in the direction of their mean; next to the unit circle it is that of
      !> their distances from it.
      pure complex(wp) function distances(first, second, middle)
         complex(wp), intent(in) :: first, second, middle

         associate (direction => middle/max(abs(middle), tiny(1.0_wp)))
            distances = logarithm(first*conjg(direction))*logarithm(second*conjg(direction))
         end associate
      end function distances

      pure complex(wp) function logarithm(multiplier)
         complex(wp), intent(in) :: multiplier

         logarithm = (0.0_wp, 0.0_wp)
         if (abs(multiplier) > 0.0_wp) logarithm = log(multiplier)
      end function logarithm
   end function may_cross
end module hb_stability
