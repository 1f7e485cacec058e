!> How complete a census is: from the number of times that random starts have found each motion.
!>
!> With f_k motions that were found k times by n starts: a further start finds an unknown motion with a probability of about
!> f_1/n (I. J. Good, Biometrika 40 (1953) 237-264), whose standard deviation is sqrt(f_1 (1 - f_1/n) + 2 f_2)/n (W. W. Esty,
!> Annals of Statistics 11 (1983) 905-912). The number of motions is at least that found plus (n - 1)/n f_1 (f_1 - 1)/(2 (f_2 +
!> 1)) (A. Chao, Scandinavian Journal of Statistics 11 (1984) 265-270, without bias). If other starts have found m motions,
!> random ones d, and both b of them, it is about (m + 1)(d + 1)/(b + 1) - 1 (D. G. Chapman, University of California
!> Publications in Statistics 1 (1951) 131-160). Both are lower bounds: motions to
!> which hardly any start leads leave no trace in either. A motion to which a share p of the starts leads is not among n finds with
!> a probability of (1 - p)**n: motions with shares below 1 - .05**(1/n) are not excluded, with a confidence of 95 %.
module hb_census_estimate
   use hb_kinds, only: wp
   implicit none
   private
   public :: completeness_t, estimate_completeness

   integer, parameter :: min_finds = 20                               ! by random starts, for an estimate
   real(wp), parameter :: bound_in_deviations = 1.645_wp              ! of a normal distribution: one-sided bound of 95 %
   real(wp), parameter :: excluded_probability = 0.05_wp              ! probability of what a bound excludes

   type :: completeness_t
      integer :: n_finds = 0                                          !! by random starts
      integer :: n_once = 0                                           !! motions that these have found once
      integer :: n_never = 0                                  !! motions that no random start has found
      real(wp) :: unseen = 1.0_wp                                     !! probability that a further random start finds an unknown
                                                                      !! motion
      real(wp) :: unseen_bound = 1.0_wp                               !! largest probability by the same data, with 95 %
      real(wp) :: missed = 0.0_wp                                     !! estimated number of motions that were missed, at least
      real(wp) :: least_share = 1.0_wp                                !! of the finds: motions with a smaller one may have been
                                                                      !! missed, others not, with 95 %
      logical :: is_reliable = .false.                                !! there were enough finds, and few motions found once
   end type completeness_t

contains

   !> Estimates the completeness of a census.
   pure type(completeness_t) function estimate_completeness(n_random, n_other) result(found)
      integer, intent(in) :: n_random(:)                              !! finds of each motion by random starts, (motions)
      integer, intent(in) :: n_other(:)                            !! likewise by all other ones
      real(wp) :: by_both, by_counts, n, once, seen, twice

      found%n_finds = sum(n_random)
      found%n_once = count(n_random == 1)
      found%n_never = count(n_random == 0)
      if (found%n_finds == 0) return
      n = real(found%n_finds, wp)
      once = real(found%n_once, wp)
      twice = real(count(n_random == 2), wp)
      seen = real(count(n_random > 0), wp)
      found%unseen = once/n
      found%unseen_bound = found%unseen + bound_in_deviations*sqrt(max(0.0_wp, once*(1.0_wp - once/n) + 2.0_wp*twice))/n
      found%least_share = 1.0_wp - excluded_probability**(1.0_wp/n)
      found%unseen_bound = min(1.0_wp, max(found%unseen_bound, found%least_share))
      by_counts = seen + (n - 1.0_wp)/n*once*(once - 1.0_wp)/(2.0_wp*(twice + 1.0_wp))
      by_both = (count(n_other > 0) + 1.0_wp)*(seen + 1.0_wp)/(count(n_other > 0 .and. n_random > 0) + 1.0_wp) - 1.0_wp
      found%missed = max(0.0_wp, max(by_counts, by_both) - size(n_random))
      found%is_reliable = found%n_finds >= min_finds .and. 3*(found%n_once + found%n_never) <= size(n_random)
   end function estimate_completeness
end module hb_census_estimate
