!> `nhbm info`: the contents of a result file, the outcome of its points, and whether it is complete.
module verb_info
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use arguments, only: arguments_t
   use console, only: say
   use exit_status, only: bad_input, incomplete, success
   use explanation, only: status_lines
   use hb_advice, only: advice_list_t, describe_item, n_advice
   use hb_attempts, only: is_fallback
   use hb_branches, only: jumps_between
   use hb_curve_table, only: note_curve_values
   use hb_document, only: document_t
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_model_tones, only: read_tones
   use hb_mpi, only: comm_t, max_over, rank_of, share_error
   use hb_outcome, only: is_solved, outcome, outcome_text
   use hb_results_record, only: fail_where_damaged, message_of, open_points, read_record, read_units, record_t
   use hb_run_summary, only: count_retained, run_summary_t
   use hb_stability, only: unknown_because_names
   use hb_study, only: read_input
   use hb_sweep_plan, only: read_sweep_plan, sweep_plan_t
   use hb_text, only: number_of, string_t, to_text
   use hb_tones, only: tones_t
   use next_step, only: command_for_cut_curve, run_names_t, shell_word
   use run_texts, only: curve_lines, found_frequency, max_line, stability_text
   implicit none
   private
   public :: read_result, run_info

contains

   !> Runs the verb, on rank 0; the exit status shows whether the file is complete.
   subroutine run_info(options, comm, status, error)
      type(arguments_t), intent(in) :: options
      type(comm_t), intent(in) :: comm
      integer, intent(out) :: status
      type(error_t), allocatable, intent(out) :: error

      status = success
      if (rank_of(comm) == 0) then
         if (size(options%more_inputs) > 0) then
            call list_files(options, status)
         else
            call describe_file(options, status, error)
         end if
      end if
      call share_error(comm, error)
      status = max_over(comm, status)
   end subroutine run_info

   !> Writes what is in one file.
   subroutine describe_file(options, status, error)
      type(arguments_t), intent(in) :: options
      integer, intent(inout) :: status
      type(error_t), allocatable, intent(out) :: error
      type(record_t) :: record
      type(document_t), target :: document
      type(run_names_t) :: names
      type(sweep_plan_t) :: plan
      type(tones_t) :: tones

      call read_result(options%input, record, document, plan, names, error)
      if (.not. allocated(error)) call read_tones(tones, document, error)
      if (allocated(error)) return
      call note_curve_values(options%input, plan, error)
      call write_origin(record, options%input)
      call write_parameters(plan)
      call write_statuses(record, names, plan, document)
      call write_found(record, tones)
      call write_stability(record)
      call write_jumps(record, plan, options%input)
      if (allocated(plan%curve) .and. .not. allocated(error)) call write_curves(names, plan, document, error)
      call write_worst(record, plan)
      call write_times(record, plan)
      if (options%wants_check .and. .not. allocated(error)) call record%check_rows(options%input, error)
      call write_rest(record, options%input)
      if (allocated(record%is_damaged) .and. .not. allocated(error)) call report_damage(record, options%input, error)
      if (size(open_points(record, .false.)) > 0) status = incomplete
   end subroutine describe_file

   !> Writes a line for each file and the sum of their points; the status is that of the worst file.
   subroutine list_files(options, status)
      type(arguments_t), intent(in) :: options
      integer, intent(inout) :: status
      type(string_t) :: paths(size(options%more_inputs) + 1)
      type(record_t) :: record
      type(error_t), allocatable :: error
      integer :: i, n_points, n_solved, n_left, n_unreadable, total(3)
      character(:), allocatable :: end_of_line

      paths(1)%value = options%input
      paths(2:) = options%more_inputs
      total = 0
      n_unreadable = 0
      do i = 1, size(paths)
         call read_record(record, paths(i)%value, error)
         if (.not. allocated(error) .and. options%wants_check) call record%check_rows(paths(i)%value, error)
         if (allocated(error)) then
            n_unreadable = n_unreadable + 1
            call say(paths(i)%value//": "//error%message)
            cycle
         end if
         n_points = count(record%status /= outcome%unused)
         n_solved = count(is_solved(record%status))
         n_left = size(open_points(record, .false.))
         total = total + [n_points, n_solved, n_left]
         end_of_line = ", complete"
         if (n_left > 0) end_of_line = ", "//to_text(n_left)//" left: nhbm resume "//shell_word(paths(i)%value)
         call say(paths(i)%value//": "//number_of(n_points, "point")//", "//to_text(n_solved)//" solved"//end_of_line)
      end do
      call say(number_of(size(paths), "file")//": "//number_of(total(1), "point")//", "//to_text(total(2))//" solved, "// &
         to_text(total(3))//" left"//unreadable_text(n_unreadable))
      if (n_unreadable > 0) then
         status = bad_input
      else if (total(3) > 0) then
         status = incomplete
      end if
   end subroutine list_files

   pure function unreadable_text(n) result(text)
      integer, intent(in) :: n
      character(:), allocatable :: text

      text = ""
      if (n > 0) text = ", "//number_of(n, "file")//" unreadable"
   end function unreadable_text

   !> Reads a result file and the input in it, with the values of its first point.
   subroutine read_result(path, record, document, plan, names, error)
      character(*), intent(in) :: path
      type(record_t), intent(out) :: record
      type(document_t), intent(out), target :: document
      type(sweep_plan_t), intent(out) :: plan
      type(run_names_t), intent(out) :: names           !! for the suggested commands
      type(error_t), allocatable, intent(out) :: error

      call read_record(record, path, error)
      if (.not. allocated(error)) call read_input(document, record%input_name, record%input_text, record%overrides, error)
      if (.not. allocated(error)) call read_sweep_plan(plan, document, error)
      if (allocated(error)) return
      call plan%apply(1, document)
      call read_units(path, plan)
      names%input = record%input_name
      names%result = path
      names%overrides = record%overrides
   end subroutine read_result

   !> Writes the origin of the file; the labels on the left are those of `nhbm-post info`.
   subroutine write_origin(record, path)
      type(record_t), intent(in) :: record
      character(*), intent(in) :: path

      call write_fact("file", path)
      if (len(record%title) > 0) call write_fact("title", record%title)
      call write_fact("written by", "nhbm "//record%program_version//", commit "//record%git_commit//", "// &
         record%created_utc)
      call write_fact("run on", number_of(record%n_ranks, "rank"))
      call write_fact("tones", to_text(size(record%tuples, 1)))
      if (record%has_own_tuples) then
         call write_fact("harmonics", "chosen by each point for its tolerance, at most "//to_text(size(record%tuples, 2)))
      else
         call write_fact("harmonics", to_text(size(record%tuples, 2))//" in the union of all points")
      end if
      call write_fact("dofs", list_of(record%dofs))
      if (size(record%laws) > 0) call write_fact("laws", list_of(record%laws))
      if (allocated(record%law_findings)) call write_fact("warning", record%law_findings)
   end subroutine write_origin

   subroutine write_parameters(plan)
      type(sweep_plan_t), intent(in) :: plan
      integer :: i

      do i = 1, size(plan%parameters)
         call write_fact("swept", plan%parameters(i)%describe())
      end do
      if (allocated(plan%curve)) call write_fact("curve", plan%curve%describe())
      if (size(plan%parameters) == 0) call write_fact("swept", "nothing")
   end subroutine write_parameters

   !> Writes the number of points of each status; for those without a motion the message and a suggestion.
   subroutine write_statuses(record, names, plan, document)
      type(record_t), intent(in) :: record
      type(run_names_t), intent(in) :: names
      type(sweep_plan_t), intent(in) :: plan
      type(document_t), intent(in) :: document
      type(string_t), allocatable :: lines(:)
      integer :: i, n, status

      call write_fact("points", to_text(count(record%status /= outcome%unused)))
      do status = outcome%pending, outcome%converged
         n = count(record%status == status)
         if (n > 0) call write_fact("", to_text(n)//" "//outcome_text(status))
      end do
      call status_lines(record%status, names, plan, document, lines)
      do i = 1, size(lines)
         call write_fact("", lines(i)%value)
      end do
      n = count(is_fallback(record%fallback))
      if (n > 0) call write_fact("", number_of(n, "point")//" solved by a fallback (see 'fallback')")
      n = count(record%is_near_commensurate > 0)
      if (n > 0) call write_fact("", number_of(n, "point")//" where a low-order combination of the tones nearly vanishes")
   end subroutine write_statuses

   !> Writes the number of stable and unstable motions.
   subroutine write_stability(record)
      type(record_t), intent(in) :: record
      integer :: n_stable, n_unstable

      n_stable = count(record%is_stable > 0)
      n_unstable = count(record%is_stable < 0)
      if (.not. any(is_solved(record%status))) return
      call write_fact("stability", stability_text(n_stable, n_unstable, count(is_solved(record%status)))// &
         reasons()//first_unstable())

   contains

      !> Why the stability of points is not known, and of how many each.
      function reasons() result(text)
         character(:), allocatable :: text
         integer :: n, reason

         text = ""
         do reason = 1, ubound(unknown_because_names, 1)
            n = count(is_solved(record%status) .and. record%is_stable == 0 .and. record%stability_reason == reason)
            if (n > 0) text = text//merge(" (", ", ", len(text) == 0)//to_text(n)//" "//trim(unknown_because_names(reason))
         end do
         if (len(text) > 0) text = text//")"
      end function reasons

      function first_unstable() result(text)
         character(:), allocatable :: text

         text = ""
         if (n_unstable > 0) text = " (first unstable: point "//to_text(findloc(record%is_stable < 0, .true., dim=1) - 1)//")"
      end function first_unstable
   end subroutine write_stability

   !> Writes the points at which the motion jumps to another branch.
   subroutine write_jumps(record, plan, path)
      type(record_t), intent(in) :: record
      type(sweep_plan_t), intent(in) :: plan
      character(*), intent(in) :: path                  !! of the result file
      integer, allocatable :: points(:)
      integer, parameter :: most = 10
      integer :: i

      allocate (points, source=jumps_between(record%branch, plan%n_fastest()))
      do i = 1, min(size(points), most)
         call write_fact(merge("jumps", "     ", i == 1), "to another branch at point "//to_text(points(i) - 1)//" ("// &
            plan%describe(points(i))//")")
         call write_message(path, points(i))
      end do
      if (size(points) > most) call write_fact("", "and "//to_text(size(points) - most)//" more (see 'branch')")
   end subroutine write_jumps

   !> Writes the message of a point.
   subroutine write_message(path, point)
      character(*), intent(in) :: path                  !! of the result file
      integer, intent(in) :: point                      !! from 1
      character(:), allocatable :: message

      message = message_of(path, point)
      if (len(message) > 0) call write_fact("", "  point "//to_text(point - 1)//": "//message)
   end subroutine write_message

   !> Writes folds, peaks and ends of curves.
   subroutine write_curves(names, plan, document, error)
      type(run_names_t), intent(in) :: names
      type(sweep_plan_t), intent(in) :: plan
      type(document_t), intent(in) :: document
      type(error_t), allocatable, intent(out) :: error
      type(advice_list_t) :: list
      character(max_line), allocatable :: lines(:)
      character(:), allocatable :: text
      integer :: i

      call curve_lines(names%result, plan, lines, list, error)
      if (allocated(error)) return
      do i = 1, size(lines)
         call write_fact(merge("found", "     ", i == 1), trim(lines(i)))
      end do
      do i = 1, n_advice(list)
         call describe_item(list%items(i), text)
         call write_fact("", text)
      end do
      text = command_for_cut_curve(names, plan, document)
      if (len(text) > 0) call write_fact("", "try: "//text)
   end subroutine write_curves

   !> Writes the frequencies of unknown tones.
   subroutine write_found(record, tones)
      type(record_t), intent(in) :: record
      type(tones_t), intent(in) :: tones
      type(run_summary_t) :: summary
      integer :: i, none(0)

      if (.not. any(tones%is_unknown)) return
      call count_retained(summary, record, none)
      do i = 1, tones%n_tones
         if (tones%is_unknown(i)) call write_fact("unknown", found_frequency(summary, i, tones))
      end do
   end subroutine write_found

   !> Writes the largest values of the error estimates, each with its point.
   subroutine write_worst(record, plan)
      type(record_t), intent(in) :: record
      type(sweep_plan_t), intent(in) :: plan
      logical :: was_written

      was_written = .false.
      call write_largest("residual", record%residual, "")
      call write_largest("truncation", record%truncation, "")
      call write_largest("aliasing", record%aliasing, "")
      if (allocated(record%by_levels)) call write_largest("difference of levels", record%by_levels, "")
      call write_largest("penetration", record%penetration, " m")
   contains
      subroutine write_largest(name, values, units)
         character(*), intent(in) :: name, units
         real(wp), intent(in) :: values(:)
         character(:), allocatable :: location
         character(16) :: number
         integer :: i

         if (.not. any(ieee_is_finite(values))) return
         i = maxloc(values, dim=1, mask=ieee_is_finite(values))
         if (values(i) <= 0.0_wp) return
         write (number, "(es9.2)") values(i)
         location = " at point "//to_text(i - 1)
         if (size(plan%parameters) > 0) location = location//" ("//plan%describe(i)//")"
         call write_fact(merge("     ", "worst", was_written), name//" "//trim(adjustl(number))//units//location)
         was_written = .true.
      end subroutine write_largest
   end subroutine write_worst

   subroutine write_times(record, plan)
      type(record_t), intent(in) :: record
      type(sweep_plan_t), intent(in) :: plan
      logical :: is_done(record%n_points)
      character(:), allocatable :: location
      integer :: i

      is_done = record%status /= outcome%pending .and. record%status /= outcome%unused .and. ieee_is_finite(record%solve_seconds)
      if (.not. any(is_done)) return
      if (.not. sum(record%solve_seconds, is_done) > 0.0_wp) return    ! of a model in memory, which has no clock
      i = maxloc(record%solve_seconds, dim=1, mask=is_done)
      location = "point "//to_text(i - 1)
      if (size(plan%parameters) > 0) location = location//" ("//plan%describe(i)//")"
      call write_fact("times", seconds_text(sum(record%solve_seconds, is_done))//" over all points, "// &
         seconds_text(sum(record%solve_seconds, is_done)/count(is_done))//" a point, longest "// &
         seconds_text(record%solve_seconds(i))//" at "//location)
   end subroutine write_times

   subroutine write_rest(record, path)
      type(record_t), intent(in) :: record
      character(*), intent(in) :: path
      integer :: n_left, n_failed

      n_left = size(open_points(record, .false.))
      n_failed = size(open_points(record, .true.)) - n_left
      if (n_left == 0) then
         call write_fact("complete", "yes")
      else
         call write_fact("complete", "no, "//number_of(n_left, "point")//" left; nhbm resume "//path//" solves "// &
            merge("it  ", "them", n_left == 1))
      end if
      if (n_failed > 0) call write_fact("", "nhbm resume "//path//" --retry also tries "//to_text(n_failed)// &
         " again that did not converge")
   end subroutine write_rest

   !> Fails if rows are damaged; the message names their points.
   subroutine report_damage(record, path, error)
      type(record_t), intent(in) :: record
      character(*), intent(in) :: path
      type(error_t), allocatable, intent(out) :: error

      call fail_where_damaged(path, record%is_damaged, error)
      if (.not. allocated(error)) call write_fact("checked", "all rows are as they were written")
   end subroutine report_damage

   subroutine write_fact(name, text)
      character(*), intent(in) :: name, text
      character(11) :: field
      character(:), allocatable :: line
      integer :: i

      field = name
      line = trim(text)
      do i = 1, len(line)                               ! control characters of a title, for example, must not start a new line
         if (line(i:i) == new_line("a")) line(i:i) = " "
      end do
      call say(field//line)
   end subroutine write_fact

   pure function list_of(words) result(text)
      character(*), intent(in) :: words(:)
      character(:), allocatable :: text
      integer, parameter :: most = 20
      integer :: i

      text = ""
      do i = 1, min(size(words), most)
         if (i > 1) text = text//", "
         text = text//trim(words(i))
      end do
      if (size(words) > most) text = text//" and "//to_text(size(words) - most)//" more"
   end function list_of

   !> A time in seconds, with three digits.
   pure function seconds_text(seconds) result(text)
      real(wp), intent(in) :: seconds
      character(:), allocatable :: text
      character(24) :: number

      if (seconds >= 100.0_wp) then
         write (number, "(f0.0)") seconds
         number = number(:index(number, ".") - 1)
      else if (seconds >= 0.1_wp) then
         write (number, "(f6.2)") seconds
      else
         write (number, "(es8.2)") seconds
      end if
      text = trim(adjustl(number))//" s"
   end function seconds_text
end module verb_info
