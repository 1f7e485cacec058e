!> `nhbm verify`: marches from points of a result file and says whether their motions stay where they are.
module verb_verify
   use arguments, only: arguments_t, read_numbers
   use console, only: say
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_march_verdict, only: verdict, verdict_text
   use hb_mpi, only: comm_t, max_over
   use hb_outcome, only: outcome_name
   use hb_text, only: to_text
   use hb_progress, only: log_level
   use hb_verify, only: verdict_t, verify_points
   implicit none
   private
   public :: run_verify

contains

   !> Runs the verb; `all_right` tells whether marching agrees with every point.
   subroutine run_verify(options, comm, all_right, error)
      type(arguments_t), intent(in) :: options
      type(comm_t), intent(in) :: comm
      logical, intent(out) :: all_right
      type(error_t), allocatable, intent(out) :: error
      type(verdict_t), allocatable :: verdicts(:)
      integer, allocatable :: points(:)
      character(400) :: line, drift
      integer :: i, n_wrong

      all_right = .false.
      allocate (points(0))
      if (allocated(options%points)) call read_numbers("--points", options%points, 0, points, error)
      if (allocated(error)) return
      call verify_points(options%input, points, options%n_periods, comm, verdicts, error)
      if (allocated(error)) return
      n_wrong = count(verdicts%kind /= verdict%not_done .and. verdicts%kind /= verdict%agrees)
      all_right = max_over(comm, n_wrong) == 0
      if (options%level < log_level%normal) return
      do i = 1, size(verdicts)
         if (verdicts(i)%skipped_status > 0) call say(&
            "point "//to_text(i - 1)//": skipped, its status is "//outcome_name(verdicts(i)%skipped_status))
         if (verdicts(i)%kind == verdict%not_done) cycle
         write (line, "(a, es8.1, a, es8.1, a, es8.1, a, es9.1, a)") &
            "point "//to_text(i - 1)//": difference", verdicts(i)%first_difference, " in the first period,", &
            verdicts(i)%difference, " at the end (limit", verdicts(i)%limit, ", "//verdicts(i)%coordinate//"), growth", &
            verdicts(i)%growth, " 1/s, after "//to_text(verdicts(i)%n_periods)//" periods;"
         drift = ""
         if (any(abs(verdicts(i)%drift) > 0.0_wp)) write (drift, "(a, *(es10.2))") " drift of the frequency", &
            pack(verdicts(i)%drift, abs(verdicts(i)%drift) > 0.0_wp)
         if (drift /= "") drift = trim(drift)//" rad/s;"
         call say(trim(line)//trim(drift)//" "//verdict_text(verdicts(i)%kind))
      end do
   end subroutine run_verify
end module verb_verify
