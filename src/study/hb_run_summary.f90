!> Summary of a run: number of points by status, and the largest estimates.
module hb_run_summary
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
   use hb_attempts, only: is_fallback
   use hb_interruption, only: interruption
   use hb_kinds, only: wp
   use hb_motion_result, only: motion_result_t
   use hb_mpi, only: comm_t, max_over, sum_over
   use hb_outcome, only: is_solved, outcome, outcome_names
   use hb_results_record, only: record_t
   use hb_stability, only: noise_status, unknown_because_names
   use hb_tones, only: max_tones
   use hb_version, only: git_commit, program_version
   implicit none
   private
   public :: count_point, count_retained, has_answer, number_answered, number_solved, run_summary_t, sum_up

   !> The outcome of a run, over all ranks.
   type :: run_summary_t
      integer :: n_points = 0
      integer :: counts(0:ubound(outcome_names, 1)) = 0               !! points of each status
      integer :: n_by_fallback = 0                                    !! points solved by a fallback
      integer :: n_estimated = 0                                      !! points with an error estimate
      integer :: n_near_commensurate = 0
      integer :: first_near_commensurate = huge(1)                    !! point, from 1
      integer :: n_stable = 0, n_unstable = 0                         !! points with such motions
      integer :: n_without_noise = 0                                  !! points whose response to noise is not known
      integer :: n_unknown(0:ubound(unknown_because_names, 1)) = 0    !! solved points of unknown stability, by unknown_because
      integer :: n_jumps = 0                                          !! between neighbours, hb_branches
      integer :: first_jump = 0                                       !! the point after the first of them, from 1
      real(wp) :: truncation = 0.0_wp                                 !! largest estimate of an estimated point
      real(wp) :: aliasing = 0.0_wp
      real(wp) :: of_frequency = 0.0_wp                               !! of unknown tones
      real(wp) :: by_levels = 0.0_wp                                  !! from the difference of levels, if larger
      real(wp) :: lowest(max_tones) = huge(1.0_wp)                    !! frequency of each tone over solved points [rad/s]
      real(wp) :: highest(max_tones) = 0.0_wp                         !! below the lowest if there is no such point
      real(wp) :: seconds = 0.0_wp
      real(wp), allocatable :: times(:, :)                            !! of all ranks, on rank 0, for hb_results_layout
      integer :: n_left = 0                                           !! points that the run has not solved
      logical :: was_complete = .false.                               !! the file had no point that was left to solve
      integer :: interruption = interruption%none                     !! the reason
      character(:), allocatable :: law_findings                          !! derivatives of user laws that are wrong; on all ranks
      logical, allocatable :: is_inactive(:)                              !! laws without force in all motions of the file
      character(:), allocatable :: made_by                            !! version that wrote the file, if different
      integer :: n_damaged = 0                                        !! points of the file whose results were damaged
      logical :: has_other_libraries = .false.                        !! different from those of the run that created the file
   end type run_summary_t

contains

   !> Counts the points of a file that are not solved again.
   subroutine count_retained(summary, record, points)
      type(run_summary_t), intent(inout) :: summary
      type(record_t), intent(in) :: record
      integer, intent(in) :: points(:)                                !! these points
      logical :: is_retained(record%n_points)
      integer :: i, status

      is_retained = .true.
      is_retained(points) = .false.
      do status = lbound(summary%counts, 1), ubound(summary%counts, 1)
         summary%counts(status) = count(is_retained .and. record%status == status)
      end do
      summary%n_by_fallback = count(is_retained .and. is_fallback(record%fallback))
      summary%n_stable = count(is_retained .and. record%is_stable > 0)
      summary%n_unstable = count(is_retained .and. record%is_stable < 0)
      do i = 0, ubound(summary%n_unknown, 1)
         summary%n_unknown(i) = count(is_retained .and. is_solved(record%status) .and. record%is_stable == 0 .and. &
                                      record%stability_reason == i)
      end do
      summary%n_near_commensurate = count(is_retained .and. record%is_near_commensurate > 0)
      if (summary%n_near_commensurate > 0) &
         summary%first_near_commensurate = findloc(is_retained .and. record%is_near_commensurate > 0, .true., dim=1)
      do i = 1, record%n_points
         if (is_retained(i) .and. is_solved(record%status(i))) call count_frequency(summary, record%frequency(:, i))
      end do
      is_retained = is_retained .and. .not. ieee_is_nan(record%truncation)
      summary%n_estimated = count(is_retained)
      summary%truncation = max(0.0_wp, maxval(record%truncation, is_retained))
      summary%aliasing = max(0.0_wp, maxval(record%aliasing, is_retained .and. .not. ieee_is_nan(record%aliasing)))
      if (allocated(record%of_frequency)) summary%of_frequency = max(0.0_wp, maxval(record%of_frequency, is_retained))
      if (allocated(record%by_levels)) &
         summary%by_levels = max(0.0_wp, maxval(record%by_levels, is_retained .and. .not. ieee_is_nan(record%by_levels)))
      if (allocated(record%is_damaged)) summary%n_damaged = count(record%is_damaged)
      if (record%program_version /= program_version .or. record%git_commit /= git_commit) &
         summary%made_by = "nhbm "//record%program_version//" ("//record%git_commit//")"
   end subroutine count_retained

   !> Counts a point that was solved.
   subroutine count_point(summary, point, result)
      type(run_summary_t), intent(inout) :: summary
      integer, intent(in) :: point                                    !! from 1
      type(motion_result_t), intent(in) :: result

      summary%counts(result%status) = summary%counts(result%status) + 1
      if (is_fallback(result%fallback)) summary%n_by_fallback = summary%n_by_fallback + 1
      if (result%stability%verdict > 0) summary%n_stable = summary%n_stable + 1
      if (result%stability%verdict < 0) summary%n_unstable = summary%n_unstable + 1
      if (result%stability%response%status /= noise_status%known .and. is_solved(result%status)) &
         summary%n_without_noise = summary%n_without_noise + 1
      associate (n => summary%n_unknown(result%stability%reason))
         if (result%stability%verdict == 0 .and. is_solved(result%status)) n = n + 1
      end associate
      if (allocated(result%error_estimate%combination)) summary%n_estimated = summary%n_estimated + 1
      if (result%is_near_commensurate) then
         summary%n_near_commensurate = summary%n_near_commensurate + 1
         summary%first_near_commensurate = min(summary%first_near_commensurate, point)
      end if
      summary%truncation = max(summary%truncation, result%error_estimate%truncation)
      summary%aliasing = max(summary%aliasing, result%error_estimate%aliasing)
      if (allocated(result%error_estimate%frequency_error) .and. allocated(result%frequency)) summary%of_frequency = &
         max(summary%of_frequency, maxval(result%error_estimate%frequency_error/result%frequency))
      summary%by_levels = max(summary%by_levels, result%level_estimate)
      if (is_solved(result%status) .and. allocated(result%frequency)) call count_frequency(summary, result%frequency)
   end subroutine count_point

   !> Extends the ranges of the frequencies by those of a point.
   subroutine count_frequency(summary, frequency)
      type(run_summary_t), intent(inout) :: summary
      real(wp), intent(in) :: frequency(:)                            !! [rad/s], (n_tones); NaN: none

      associate (lowest => summary%lowest(:size(frequency)), highest => summary%highest(:size(frequency)))
         where (.not. ieee_is_nan(frequency))
            lowest = min(lowest, frequency)
            highest = max(highest, frequency)
         end where
      end associate
   end subroutine count_frequency

   !> Whether a point has an acceptable motion, as exit status 0 requires of all points: from the balance, within its
   !> thresholds, or from time integration if no balance was found.
   elemental logical function has_answer(status)
      integer, intent(in) :: status

      has_answer = any(status == [outcome%converged, outcome%integrated, outcome%multiple_attractors])
   end function has_answer

   !> Number of points with an acceptable motion.
   pure integer function number_answered(summary)
      type(run_summary_t), intent(in) :: summary
      integer :: status

      number_answered = sum(summary%counts, mask=has_answer([(status, status=0, ubound(summary%counts, 1))]))
   end function number_answered

   !> Number of points with a motion, within its thresholds or not.
   pure integer function number_solved(summary)
      type(run_summary_t), intent(in) :: summary
      integer :: status

      number_solved = sum(summary%counts, mask=is_solved([(status, status=0, ubound(summary%counts, 1))]))
   end function number_solved

   !> Adds up the counts of all ranks.
   subroutine sum_up(summary, comm)
      type(run_summary_t), intent(inout) :: summary
      type(comm_t), intent(in) :: comm
      integer :: i, status

      do status = lbound(summary%counts, 1), ubound(summary%counts, 1)
         summary%counts(status) = sum_over(comm, summary%counts(status))
      end do
      summary%n_by_fallback = sum_over(comm, summary%n_by_fallback)
      summary%n_estimated = sum_over(comm, summary%n_estimated)
      summary%n_stable = sum_over(comm, summary%n_stable)
      summary%n_unstable = sum_over(comm, summary%n_unstable)
      do i = 0, ubound(summary%n_unknown, 1)
         summary%n_unknown(i) = sum_over(comm, summary%n_unknown(i))
      end do
      summary%n_without_noise = sum_over(comm, summary%n_without_noise)
      summary%n_near_commensurate = sum_over(comm, summary%n_near_commensurate)
      summary%first_near_commensurate = -max_over(comm, -summary%first_near_commensurate)
      summary%truncation = max_over(comm, summary%truncation)
      summary%aliasing = max_over(comm, summary%aliasing)
      summary%of_frequency = max_over(comm, summary%of_frequency)
      summary%by_levels = max_over(comm, summary%by_levels)
      do i = 1, max_tones
         summary%lowest(i) = -max_over(comm, -summary%lowest(i))
         summary%highest(i) = max_over(comm, summary%highest(i))
      end do
   end subroutine sum_up
end module hb_run_summary
