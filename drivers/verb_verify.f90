!> `nhbm verify`: integrates from points of a result file and reports whether the motions agree and are stable.
module verb_verify
   use arguments, only: arguments_t, read_numbers
   use console, only: print_error, say
   use exit_status, only: incomplete, not_all_right, success
   use hb_advice, only: advice, advice_list_t, describe_advice
   use hb_error, only: error_t
   use hb_integration_verdict, only: verdict, verdict_names, verdict_t, verdict_text
   use hb_kinds, only: wp
   use hb_mpi, only: broadcast_text, comm_t, max_over, rank_of, sum_over
   use hb_outcome, only: outcome, outcome_text
   use hb_progress, only: log_level
   use hb_text, only: add_string, join, number_of, string_t, to_text
   use hb_verify, only: unverified_t, verification_options_t, verify_points
   use next_step, only: shell_word
   use run_texts, only: ending_text
   implicit none
   private
   public :: run_verify

   real(wp), parameter :: clear = 0.5_wp                              ! growth or decay of disturbances in all, as a logarithm

contains

   !> Runs the verb; without an error it returns an exit status.
   subroutine run_verify(options, comm, status, error)
      type(arguments_t), intent(in) :: options
      type(comm_t), intent(in) :: comm
      integer, intent(out) :: status
      type(error_t), allocatable, intent(out) :: error
      type(verdict_t), allocatable :: verdicts(:)
      integer, allocatable :: points(:)
      character(:), allocatable :: text
      type(advice_list_t) :: list
      type(unverified_t) :: unverified
      integer :: counts(verdict%agrees:verdict%undecided), i, n_left, n_wrong

      status = success
      allocate (points(0))
      if (allocated(options%points)) call read_numbers("--points", options%points, 0, points, error)
      if (allocated(error)) return
      call verify_points(options%input, points, options%n_periods, comm, verdicts, error, &
                         verification_options_t(options%time_limit, options%level), unverified)
      if (allocated(error)) return
      n_wrong = count(verdicts%kind /= verdict%not_done .and. verdicts%kind /= verdict%agrees)
      n_left = sum_over(comm, size(unverified%points))
      if (max_over(comm, n_wrong) > 0 .or. sum_over(comm, count(verdicts%kind /= verdict%not_done)) == 0) status = not_all_right
      if (n_left > 0) status = incomplete
      if (n_left > 0) call say_left(unverified, size(verdicts), n_left, options%input, comm)
      if (options%level < log_level%normal) return
      call say_skipped(verdicts%skipped_status, size(points) > 0)
      call say_verdicts(verdicts, comm)
      do i = verdict%agrees, verdict%undecided
         counts(i) = sum_over(comm, count(verdicts%kind == i))
      end do
      if (rank_of(comm) > 0) return
      text = ""
      do i = verdict%agrees, verdict%undecided
         if (counts(i) == 0) cycle
         if (len(text) > 0) text = text//", "
         text = text//to_text(counts(i))//" "//trim(verdict_names(i))
      end do
      if (len(text) > 0) text = ": "//text
      call say(number_of(sum(counts), "point")//" verified"//text)
      if (counts(verdict%undecided) == 0) return
      call list%add(advice%undecided)
      call describe_advice(list, text)
      call say(text)
   end subroutine run_verify

   !> What has ended the run, and how the points that are left are verified.
   subroutine say_left(unverified, n_points, n_left, path, comm)
      type(unverified_t), intent(in) :: unverified
      integer, intent(in) :: n_points                                  !! of the file
      integer, intent(in) :: n_left
      character(*), intent(in) :: path                                 !! of the file
      type(comm_t), intent(in) :: comm
      integer, parameter :: most = 100                                 ! numbers in the line
      type(string_t), allocatable :: numbers(:)
      integer :: i

      allocate (numbers(0))
      do i = 1, n_points
         if (max_over(comm, merge(1, 0, any(unverified%points == i))) == 0) cycle
         if (size(numbers) < most) call add_string(numbers, to_text(i - 1))
      end do
      if (rank_of(comm) == 0) call print_error(ending_text(unverified%interruption)//": "//number_of(n_left, "point")// &
         trim(merge(" is ", " are", n_left == 1))//" left: nhbm verify "//shell_word(path)//" --points "//join(numbers, ",")// &
         trim(merge(",...", "    ", n_left > most)))
   end subroutine say_left

   !> A line for each point that was verified, in the order of the points: the first rank writes the lines of all, for a launcher
   !> forwards what several ranks write in any order.
   subroutine say_verdicts(verdicts, comm)
      type(verdict_t), intent(in) :: verdicts(:)                       !! of this rank; others are not done
      type(comm_t), intent(in) :: comm
      character(:), allocatable :: line
      integer :: i, owner

      do i = 1, size(verdicts)
         owner = max_over(comm, merge(rank_of(comm), -1, verdicts(i)%kind /= verdict%not_done))
         if (owner < 0) cycle
         if (rank_of(comm) == owner) line = "point "//to_text(i - 1)//": "//words_on(verdicts(i))
         call broadcast_text(comm, line, owner)
         if (rank_of(comm) == 0) call say(line)
      end do
   end subroutine say_verdicts

   !> A line for each status of points without a motion; spare rows of curves are told only if points were named.
   subroutine say_skipped(statuses, are_named)
      integer, intent(in) :: statuses(:)                               !! 0 of other points
      logical, intent(in) :: are_named
      character(:), allocatable :: who
      integer :: i, n

      do i = 1, size(statuses)
         if (statuses(i) <= 0 .or. any(statuses(:i - 1) == statuses(i))) cycle
         if (statuses(i) == outcome%unused .and. .not. are_named) cycle
         n = count(statuses == statuses(i))
         who = "point "//to_text(i - 1)//": skipped, it has no motion"
         if (n > 1) who = to_text(n)//" points skipped (first: point "//to_text(i - 1)//"), they have no motion"
         call say(who//" to start from: "//outcome_text(statuses(i)))
      end do
   end subroutine say_skipped

   !> Verdict on a point, with its numbers.
   function words_on(found) result(text)
      type(verdict_t), intent(in) :: found
      character(:), allocatable :: text
      character(400) :: line

      if (found%is_of_coefficients) then
         text = trim(verdict_text(found%kind))//"; "//number_of(found%n_periods, "period")
         write (line, "(2(a, es7.1), a)") " to the end of a second time integration, whose coefficients differ by ", &
            found%difference, " (limit ", found%limit, ", at "//found%coordinate//")"
         if (len(found%coordinate) > 0) text = text//trim(line)
         return
      end if
      write (line, "(3(a, es7.1), a)") "; deviation ", found%first_difference, " of the motion in the first period, ", &
         found%difference, " at the end (limit ", found%limit, ", at "//found%coordinate//"), disturbances"
      text = trim(verdict_text(found%kind))
      if (found%starts_beside) text = text//" that starts on the periodic motion, from which disturbances as large as the "// &
         "error of the series diverge"
      text = text//trim(line)
      write (line, "(a, es7.1, a)") trim(merge(" grow at ", " decay at", found%growth > 0.0_wp))//" ", abs(found%growth), " 1/s"
      if (abs(found%growth)*found%duration < clear) then
         line = " neither grow nor decay"
         if (any(abs(found%drift) > 0.0_wp)) line = trim(line)//" (a free motion may be shifted in time)"
      end if
      text = text//trim(line)//"; "//number_of(found%n_periods, "period")
      if (allocated(found%ended_by)) text = text//", ended by: "//found%ended_by
      if (.not. any(abs(found%drift) > 0.0_wp)) return
      write (line, "(*(es10.2))") pack(found%drift, abs(found%drift) > 0.0_wp)
      text = text//"; frequencies differ by "//trim(adjustl(line))//" rad/s"
   end function words_on
end module verb_verify
