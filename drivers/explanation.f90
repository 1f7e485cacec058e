!> Explains the points of a result file: each kind of failure once, with its message, the number of its points and the
!> command to try next; and one point in sentences: how it ended, what was tried, how close the attempts came, and
!> what to do next.
module explanation
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_advice, only: advice_list_t, describe_advice, n_advice
   use hb_attempts, only: describe_attempts
   use hb_document, only: document_t
   use hb_kinds, only: wp
   use hb_motion_advice, only: advise_on_status, advise_on_verdict
   use hb_motion_result, only: advise_on_reason
   use hb_outcome, only: is_solved, outcome, outcome_names, outcome_text, reason
   use hb_properties, only: properties_t
   use hb_results_record, only: advice_of, attempts_of, messages_of, numbers_of, record_t
   use hb_solver_types, only: attempt_t
   use hb_sweep_plan, only: sweep_plan_t
   use hb_text, only: add_string, number_of, rounded, rounded_beside, string_t, to_text
   use hb_thresholds, only: well_solved
   use next_step, only: command_to_try, failure_kind_t, is_by_tolerance, run_names_t, shell_word
   use run_texts, only: is_regular_end
   implicit none
   private
   public :: explain_failures, explain_point, find_kinds, status_lines

   character(*), parameter :: command_mark = new_line("a")//"try: "
   integer, parameter :: most_read = 200                              ! messages of a status that are examined for a summary
   integer, parameter :: max_kinds = 3                               ! of a status that are reported there

contains

   !> Lines on all points except those that are converged, pending or unused.
   subroutine status_lines(status, names, plan, document, lines)
      integer, intent(in) :: status(:)                                !! (n_points)
      type(run_names_t), intent(in) :: names
      type(sweep_plan_t), intent(in) :: plan
      type(document_t), intent(in) :: document                        !! the input of the run
      type(string_t), allocatable, intent(out) :: lines(:)
      type(failure_kind_t), allocatable :: kinds(:)
      character(:), allocatable :: text
      type(string_t), allocatable :: said(:)
      integer :: faults(size(status)), i, k

      allocate (lines(0), said(0))
      faults = without_ends(status, plan)
      do i = outcome%converged + 1, ubound(outcome_names, 1)
         call kinds_of_status(i, faults, names%result, most_read, kinds)
         if (size(kinds) == 0) cycle
         call add(to_text(count(faults == i))//" "//outcome_text(i)//" (first: point "//to_text(kinds(1)%first - 1)//")")
         do k = 1, min(size(kinds), max_kinds)
            text = "point "//name_of(kinds(k)%first, plan)
            if (size(kinds) > 1) text = text//others_of(kinds(k))
            if (len(kinds(k)%message) > 0) call add("  "//text//": "//kinds(k)%message)
            text = command_to_try(kinds(k), names, plan, document)
            if (len(text) > 0 .and. is_new(text, said)) call add("  try: "//text)
         end do
         if (size(kinds) > max_kinds) call add("  "//others_text(size(kinds), names%result))
      end do
   contains
      subroutine add(line)
         character(*), intent(in) :: line
         type(string_t) :: last

         last%value = line                                            ! gfortran 12 may crash on string_t(line) in the constructor
         lines = [lines, last]
      end subroutine add
   end subroutine status_lines

   !> Text on the kinds beyond those that are reported.
   pure function others_text(n_kinds, path) result(text)
      integer, intent(in) :: n_kinds
      character(*), intent(in) :: path                                !! of the result file
      character(:), allocatable :: text

      text = "and "//number_of(n_kinds - max_kinds, "other message")//"; nhbm-post info "//shell_word(path)// &
             " has a row for each point"
   end function others_text

   !> Explains each kind of failure in a file by its first point; one paragraph per element, `max_kinds` of a status.
   subroutine explain_failures(record, names, plan, document, paragraphs)
      type(record_t), intent(in) :: record
      type(run_names_t), intent(in) :: names
      type(sweep_plan_t), intent(in) :: plan
      type(document_t), intent(in) :: document
      type(string_t), allocatable, intent(out) :: paragraphs(:)
      type(failure_kind_t), allocatable :: kinds(:)
      character(:), allocatable :: text
      type(string_t), allocatable :: said(:)
      integer :: i, k, n

      allocate (paragraphs(0), said(0))
      do i = outcome%converged + 1, ubound(outcome_names, 1)
         call kinds_of_status(i, without_ends(record%status, plan), names%result, record%n_points, kinds)
         do k = 1, min(size(kinds), max_kinds)
            text = paragraph(kinds(k), record, names, plan, document)
            n = index(text, command_mark)
            if (n > 0) then
               if (.not. is_new(text(n:), said)) text = text(:n - 1)//" The command is the same as above."
            end if
            call add_string(paragraphs, text)
         end do
         if (size(kinds) > max_kinds) call add_string(paragraphs, others_text(size(kinds), names%result))
      end do
   end subroutine explain_failures

   !> Statuses, in which the regular ends of curves are no failures.
   pure function without_ends(status, plan) result(faults)
      integer, intent(in) :: status(:)                                !! (n_points)
      type(sweep_plan_t), intent(in) :: plan
      integer :: faults(size(status)), i

      faults = status
      where ([(is_regular_end(status(i), i, plan), i=1, size(status))]) faults = outcome%converged
   end function without_ends

   !> Whether a command has not been printed before; it is noted. Each command has one result file.
   logical function is_new(command, said)
      character(*), intent(in) :: command
      type(string_t), allocatable, intent(inout) :: said(:)
      integer :: i

      is_new = all([(said(i)%value /= command, i=1, size(said))])
      if (is_new) call add_string(said, command)
   end function is_new

   !> Explains one point in a paragraph.
   function explain_point(point, record, names, plan, document) result(text)
      integer, intent(in) :: point                                    !! from 1
      type(record_t), intent(in) :: record
      type(run_names_t), intent(in) :: names
      type(sweep_plan_t), intent(in) :: plan
      type(document_t), intent(in) :: document
      character(:), allocatable :: text
      type(failure_kind_t), allocatable :: kinds(:)

      call kinds_of_points(record%status(point), [point], names%result, kinds)
      text = paragraph(kinds(1), record, names, plan, document)
   end function explain_point

   !> Kinds of the points with a status, none if it is `unused`; of many points only the first are examined.
   subroutine kinds_of_status(wanted, status, path, most, kinds)
      integer, intent(in) :: wanted, status(:)                        !! of all points
      character(*), intent(in) :: path                                !! of the result file
      integer, intent(in) :: most                                     !! points that are examined
      type(failure_kind_t), allocatable, intent(out) :: kinds(:)
      integer, allocatable :: points(:)
      integer :: i

      points = pack([(i, i=1, size(status))], status == wanted .and. wanted /= outcome%unused)
      call kinds_of_points(wanted, points(:min(size(points), most)), path, kinds)
   end subroutine kinds_of_status

   !> Kinds of points with one status.
   subroutine kinds_of_points(status, points, path, kinds)
      integer, intent(in) :: status, points(:)                        !! from 1, ascending
      character(*), intent(in) :: path                                !! of the result file
      type(failure_kind_t), allocatable, intent(out) :: kinds(:)
      type(string_t), allocatable :: messages(:)
      type(advice_list_t) :: advice(size(points))
      type(failure_kind_t) :: failures(size(points))
      integer, allocatable :: n_periods(:), reasons(:)
      integer :: i

      call messages_of(path, points, messages)
      call advice_of(path, points, advice)
      allocate (reasons, source=numbers_of(path, "reason"))
      allocate (n_periods, source=numbers_of(path, "n_periods"))
      do i = 1, size(points)
         failures(i)%status = status
         failures(i)%first = points(i)
         failures(i)%message = messages(i)%value
         failures(i)%advice = advice(i)
         if (min(size(reasons), size(n_periods)) < points(i)) cycle   ! no such file
         failures(i)%reason = reasons(points(i))
         failures(i)%n_periods = n_periods(points(i))
      end do
      call find_kinds(failures, kinds)
   end subroutine kinds_of_points

   !> Groups points of one status, ascending, by what is stored about their ends; the first of each kind stands for all.
   pure subroutine find_kinds(failures, kinds)
      type(failure_kind_t), intent(in) :: failures(:)
      type(failure_kind_t), allocatable, intent(out) :: kinds(:)
      integer :: i, k, n

      allocate (kinds(size(failures)))
      n = 0
      do i = 1, size(failures)
         do k = 1, n
            if (ended_alike(kinds(k), failures(i))) exit
         end do
         if (k > n) kinds(k) = failures(i)
         n = max(n, k)
         kinds(k)%n_points = kinds(k)%n_points + 1
      end do
      kinds = kinds(:n)
   end subroutine find_kinds

   !> Whether two points ended for the same reason, with the same advice; errors, which have no other sign, with the same text.
   pure logical function ended_alike(one, other)
      type(failure_kind_t), intent(in) :: one, other

      ended_alike = one%reason == other%reason .and. one%n_periods == other%n_periods .and. &
                    n_advice(one%advice) == n_advice(other%advice)
      if (ended_alike .and. n_advice(one%advice) > 0) ended_alike = all(one%advice%items%number == other%advice%items%number)
      if (ended_alike .and. one%reason == reason%error) ended_alike = one%message == other%message
   end function ended_alike

   !> Explains the first point of a kind; lines with a command begin with "try: ".
   function paragraph(kind, record, names, plan, document) result(text)
      type(failure_kind_t), intent(in) :: kind
      type(record_t), intent(in) :: record
      type(run_names_t), intent(in) :: names
      type(sweep_plan_t), intent(in) :: plan
      type(document_t), intent(in) :: document
      character(:), allocatable :: text, command, remedy, tried
      type(advice_list_t) :: list
      type(attempt_t), allocatable :: attempts(:)

      if (is_solved(kind%status)) call advise_on_reason(kind%reason, list)   ! of other points the message has it
      call advise_on_status(kind%status, list)
      call describe_advice(list, remedy, ". ")
      text = "Point "//name_of(kind%first, plan)//others_of(kind)//": "//outcome_text(kind%status)//"."
      if (kind%status == outcome%pending .or. kind%status == outcome%unused) then
         if (kind%status == outcome%pending) text = text//" "//remedy
         return
      end if
      associate (seconds => record%solve_seconds(kind%first))
         if (ieee_is_finite(seconds)) text = text//" It took "//rounded(seconds)//" s."
      end associate
      text = text//nearness_text(kind%first, record, document)
      if (len_trim(kind%message) > 0) text = text//new_line("a")//"Message: "//trim(kind%message)
      call attempts_of(names%result, kind%first, attempts)
      call describe_attempts(attempts, tried)
      if (size(attempts) > 0) text = text//new_line("a")//"Attempts: "//tried
      if (.not. is_solved(kind%status)) text = text//neighbour_text(kind%first, record, plan)
      text = text//new_line("a")//"What to do: "//remedy
      command = command_to_try(kind, names, plan, document)
      if (len(command) > 0) text = text//command_mark//command
   end function paragraph

   function name_of(point, plan) result(text)
      integer, intent(in) :: point                                    !! from 1
      type(sweep_plan_t), intent(in) :: plan
      character(:), allocatable :: text

      text = to_text(point - 1)
      if (len(plan%describe(point)) > 0) text = text//" ("//plan%describe(point)//")"
   end function name_of

   !> Text with the number of further points of a kind.
   pure function others_of(kind) result(text)
      type(failure_kind_t), intent(in) :: kind
      character(:), allocatable :: text

      text = ""
      if (kind%n_points > 1) text = " and "//number_of(kind%n_points - 1, "other")
   end function others_of

   !> Text on how close the point has come, compared with the limits.
   function nearness_text(point, record, document) result(text)
      integer, intent(in) :: point                                    !! from 1
      type(record_t), intent(in) :: record
      type(document_t), intent(in) :: document
      character(:), allocatable :: text
      character(:), allocatable :: sign

      text = ""
      ! 0: from time integration; the largest number: never evaluated
      if (record%residual(point) > 0.0_wp .and. record%residual(point) < huge(1.0_wp)) then
         text = " Remaining imbalance: "//rounded(record%residual(point))//" times the forces"
         if (is_solved(record%status(point)) .and. has_tolerance()) then
            text = text//", enough for the tolerance."                ! hb_thresholds, well_solved
         else
            text = text//" (allowed: "//rounded(limit("solver", "tolerance"))//")."
         end if
      end if
      if (is_solved(record%status(point))) then
         sign = " The estimated error is "
         call add(record%truncation(point), " by truncation", "truncation")
         call add(record%aliasing(point), " by aliasing", "aliasing")
         if (allocated(record%of_frequency)) then
            if (record%of_frequency(point) > 0.0_wp) &
               call add(record%of_frequency(point), " of an unknown frequency", "truncation")
         end if
         if (sign /= " The estimated error is ") text = text//"."
         if (record%penetration(point) > 0.0_wp) &
            text = text//" The penetration of a wall is "//rounded(record%penetration(point))//" m."
         if (record%is_stable(point) /= 0) &
            text = text//" The motion is "//trim(merge("stable  ", "unstable", record%is_stable(point) > 0))//"."
         text = text//stability_text()
      end if

   contains

      subroutine add(value, cause, key)
         real(wp), intent(in) :: value
         character(*), intent(in) :: cause, key

         if (.not. ieee_is_finite(value)) return
         associate (most => limit("error_estimate", key))
            text = text//sign//trim(rounded_beside(value, most))//cause//" (limit "//rounded(most)//")"
         end associate
         sign = ", "
      end subroutine add

      !> Why the stability is not known.
      function stability_text() result(text)
         character(:), allocatable :: text
         character(:), allocatable :: method
         type(advice_list_t) :: list
         type(document_t), target :: copy
         type(properties_t), pointer :: group

         copy = document
         group => copy%optional_group("stability")
         call group%get("method", method)
         call advise_on_verdict(record%stability_reason(point), 1, method == "integration", list)
         call describe_advice(list, text)
         if (len(text) > 0) text = new_line("a")//"Stability: "//text//"."
      end function stability_text

      !> Whether the motion has a tolerance.
      logical function has_tolerance()
         type(document_t) :: copy

         copy = document
         has_tolerance = copy%count("accuracy") > 0 .or. is_by_tolerance(document)
      end function has_tolerance

      !> The limit in the input: with a tolerance that of the motion, or for the residual a part of it.
      real(wp) function limit(group_name, key) result(value)
         character(*), intent(in) :: group_name, key
         type(document_t), target :: copy
         type(properties_t), pointer :: group
         real(wp) :: tolerance

         copy = document
         tolerance = 0.0_wp
         group => copy%optional_group("accuracy")
         if (has_tolerance()) call group%get("tolerance", tolerance)
         group => copy%optional_group(group_name)
         call group%get(key, value)
         if (group_name == "error_estimate" .and. tolerance > 0.0_wp) value = tolerance
         if (group_name == "solver" .and. .not. group%given(key)) value = max(value, well_solved*tolerance)
      end function limit
   end function nearness_text

   !> Text with the nearest point, by number, that has a motion.
   function neighbour_text(point, record, plan) result(text)
      integer, intent(in) :: point                                    !! from 1
      type(record_t), intent(in) :: record
      type(sweep_plan_t), intent(in) :: plan
      character(:), allocatable :: text
      integer :: distance, i

      text = ""
      do distance = 1, record%n_points
         do i = point - distance, point + distance, 2*distance
            if (i < 1 .or. i > record%n_points) cycle
            if (.not. is_solved(record%status(i))) cycle
            text = new_line("a")//"Nearest solved point: "//name_of(i, plan)//"."
            return
         end do
      end do
   end function neighbour_text
end module explanation
