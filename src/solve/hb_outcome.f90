!> How the solution of a point ended: the statuses of all solvers, each written once with its name and its meaning.
!>
!> An outcome is part of a result and never an error: `if (result%status == outcome%converged)`. The numbers are
!> stored in the result file (docs/user/schema.md): they may be added to, never changed.
module hb_outcome
   implicit none
   private
   public :: has_verdict, is_integrated, is_lost, is_solved, is_status
   public :: outcome, outcome_name, outcome_names, outcome_text, reason, reason_names

   type :: outcome_t
      integer :: pending = 0                           !! not solved yet
      integer :: converged = 1                         !! residual below the tolerance or down at rounding level
      integer :: stalled = 2                           !! no step makes the residual smaller
      integer :: out_of_budget = 3                     !! a limit on work came first
      integer :: singular = 4                          !! the linear system of a step has no unique solution
      integer :: not_finite = 5                        !! NaN or infinity wherever the residual was evaluated
      integer :: failed = 6                            !! an error of this point alone, described by its message
      integer :: truncated = 7                         !! solved, but the harmonics left out matter
      integer :: aliased = 8                           !! solved, but the samples are too few
      integer :: penetrating = 9                       !! solved, but the motion goes too far into a rigid wall
      integer :: collapsed = 10                        !! an unknown tone died out: the motion has fewer tones
      integer :: no_motion = 11                        !! no self-excited motion was found
      integer :: crashed = 12                          !! the solution of the point has ended the process
      integer :: diverged = 13                         !! the steps run away from anything of the size of the problem
      integer :: locked = 14                           !! the tones are multiples of one: the motion has one tone
      integer :: timed_out = 15                        !! the point has had its processor time
      integer :: impact = 16                           !! solved, but a rigid wall is struck: a law of impact is missing
      integer :: unused = 17                           !! row of a curve that has ended before
      integer :: integrated = 18 !! found by time integration instead of the balance
      integer :: subharmonic = 19                      !! time integration ends in a motion that takes several periods
      integer :: broadband = 20                        !! time integration ends in a motion without order
      integer :: multiple_attractors = 21                          !! time integration ends in several motions, by where it starts
      integer :: law_undefined = 22                    !! not solved, and laws were undefined at motions that were tried
      integer :: interrupted = -1                      !! the run ends: never in a file, where the point stays pending
   end type outcome_t

   type(outcome_t), parameter :: outcome = outcome_t()

   !> What ended the work, where the next step depends on it. The first three are limits, named as in `solver_config_t`.
   type :: reason_t
      integer :: none = 0
      integer :: max_iterations = 1
      integer :: max_fallback_work = 2
      integer :: time_limit = 3
      integer :: overflow = 4                          !! of loads or motion: wrong units
      integer :: growth = 5                            !! of disturbances within a period: a larger set does not help
      integer :: lost_curve = 6                        !! continuation failed
      integer :: error = 7                             !! of the input, a law or a library: the point cannot be solved as it is
      integer :: points = 8                            !! of a curve, which continues beyond its last point
      integer :: grazing = 9                             !! a curve ends at a grazing impact, beyond which no motion was found
      integer :: departure = 10                        !! of a time integration from the motion: a larger set does not help
      integer :: steep_friction = 11                   !! friction that is smoothed over a tiny speed: more work does not help
      integer :: unlocated = 12                        !! of a converged point: a curve has passed an event before it, not located
      integer :: max_work = 13                         !! of `accuracy_t`: no work is left for a larger set of harmonics
      integer :: max_harmonics = 14                    !! of `accuracy_t`, or memory: there is no larger set
      integer :: tolerance = 15                        !! of a motion that larger sets do not bring to it: its estimates can be met
   end type reason_t
   type(reason_t), parameter :: reason = reason_t()
   character(*), parameter :: reason_names(0:15) = [character(17) :: "none", "max_iterations", "max_fallback_work", "time_limit", &
      "overflow", "growth", "lost_curve", "error", "points", "grazing", "departure", "steep_friction", &
      "unlocated", "max_work", "max_harmonics", "tolerance"]

   !> Names as they stand in the result file (`flag_meanings`); the index is the status.
   character(*), parameter :: outcome_names(0:22) = [character(19) :: &
      "pending", "converged", "stalled", "out_of_budget", "singular", "not_finite", "failed", &
      "truncated", "aliased", "penetrating", "collapsed", "no_motion", "crashed", "diverged", "locked", &
      "timed_out", "impact", "unused", "integrated", "subharmonic", "broadband", "multiple_attractors", &
      "law_undefined"]

   character(*), parameter :: texts(0:22) = [character(64) :: &
      "not solved yet", &
      "converged", &
      "stalled: no step reduces the residual", &
      "out of budget: a work limit was reached before the tolerance", &
      "singular: the linear system of a Newton step is singular", &
      "not finite: the residual is NaN or infinite", &
      "failed: an error of this point, see its message", &
      "truncated: solved, but the truncation error exceeds its limit", &
      "aliased: solved, but the aliasing error exceeds its limit", &
      "penetrating: solved, but the penetration exceeds its limit", &
      "collapsed: an unknown tone vanished, the motion has fewer tones", &
      "no motion: no self-excited motion was found", &
      "crashed: the process crashed while solving this point", &
      "diverged: the iteration diverged", &
      "locked: the tones are commensurate, the motion is periodic", &
      "timed out: the processor time limit of the point was reached", &
      "impact: solved, but it may depend on the restitution of a wall", &
      "unused: spare row of a curve that ended earlier", &
      "integrated: found by time integration instead of the balance", &
      "subharmonic: the motion repeats after several periods only", &
      "broadband: time integration finds no motion with these tones", &
      "multiple attractors: time integration finds several motions", &
      "law undefined: a law has no force at motions that were tried"]

contains

   !> Gives the name of a status as it stands in the result file, `unknown` for a number that is not a status.
   pure function outcome_name(status) result(name)
      integer, intent(in) :: status
      character(merge(len_trim(outcome_names(known(status))), len("unknown"), is_status(status))) :: name

      name = "unknown"
      if (is_status(status)) name = outcome_names(status)
   end function outcome_name

   !> Gives a status in words for people, `unknown status` for a number that is not a status.
   pure function outcome_text(status) result(text)
      integer, intent(in) :: status
      character(merge(len_trim(texts(known(status))), len("unknown status"), is_status(status))) :: text

      text = "unknown status"
      if (is_status(status)) text = texts(status)
   end function outcome_text

   !> Whether there is a motion: from the balance, well enough for the thresholds of the error estimate or not, or from time
   !> integration.
   elemental logical function is_solved(status)
      integer, intent(in) :: status

      is_solved = any(status == [outcome%converged, outcome%truncated, outcome%aliased, outcome%penetrating, &
                               outcome%impact, outcome%integrated, outcome%multiple_attractors])
   end function is_solved

   !> Whether a search has ended without a motion although there was time left; laws without a force would end a time
   !> integration as well. It has `failed` without an error because states of sliders do not repeat on a grid.
   elemental logical function is_lost(status)
      integer, intent(in) :: status

      is_lost = any(status == [outcome%stalled, outcome%out_of_budget, outcome%singular, outcome%diverged, outcome%failed, &
                              outcome%law_undefined])
   end function is_lost

   !> Whether a motion was found by time integration.
   elemental logical function is_integrated(status)
      integer, intent(in) :: status

      is_integrated = any(status == [outcome%integrated, outcome%multiple_attractors])
   end function is_integrated

   !> Whether a verdict on stability may belong to the motion: it solves its equations, and its errors are within their limits.
   elemental logical function has_verdict(status)
      integer, intent(in) :: status

      has_verdict = any(status == [outcome%converged, outcome%integrated, outcome%multiple_attractors])
   end function has_verdict

   !> The status, or one that there is.
   pure integer function known(status)
      integer, intent(in) :: status

      known = max(lbound(texts, 1), min(status, ubound(texts, 1)))
   end function known

   !> Whether a number is one of the statuses.
   elemental logical function is_status(status)
      integer, intent(in) :: status

      is_status = status >= lbound(texts, 1) .and. status <= ubound(texts, 1)
   end function is_status
end module hb_outcome
