!> What happened at a point of a result file, in sentences: how it ended, what was tried, how near that came, and what to do next.
module hb_explanation
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_advice, only: rounded
   use hb_document, only: document_t
   use hb_failure_kinds, only: find_kinds
   use hb_kinds, only: wp
   use hb_next_step, only: failure_kind_t, next_step, run_names_t
   use hb_outcome, only: is_solved, outcome, outcome_names, outcome_remedy, outcome_text
   use hb_properties, only: properties_t
   use hb_results_record, only: messages_of, record_t
   use hb_solver_types, only: fallback_names, fallback_texts
   use hb_sweep_plan, only: sweep_plan_t
   use hb_text, only: number_of, split, string_t, to_text
   implicit none
   private
   public :: explain_failures, explain_point

   character(*), parameter :: mark = "; least residuals: "            ! of hb_advice, before what each attempt reached

contains

   !> A paragraph on each kind of failure in a file, at the first of its points; an element each.
   subroutine explain_failures(record, names, plan, document, paragraphs)
      type(record_t), intent(in) :: record
      type(run_names_t), intent(in) :: names
      type(sweep_plan_t), intent(in) :: plan
      type(document_t), intent(in) :: document
      type(string_t), allocatable, intent(out) :: paragraphs(:)
      type(failure_kind_t), allocatable :: kinds(:)
      type(string_t), allocatable :: messages(:)
      character(:), allocatable :: text
      integer, allocatable :: points(:)
      integer :: i, k

      allocate (paragraphs(0))
      do i = outcome%converged + 1, ubound(outcome_names, 1)
         points = pack([(k, k=1, record%n_points)], record%status == i)
         if (size(points) == 0 .or. i == outcome%unused) cycle
         call messages_of(names%result, points, messages)
         call find_kinds(i, points, messages, kinds)
         do k = 1, size(kinds)
            text = paragraph(kinds(k), record, names, plan, document)
            paragraphs = [paragraphs, string_t(text)]
         end do
      end do
   end subroutine explain_failures

   !> A paragraph on one point.
   function explain_point(point, record, names, plan, document) result(text)
      integer, intent(in) :: point                                    !! from 1
      type(record_t), intent(in) :: record
      type(run_names_t), intent(in) :: names
      type(sweep_plan_t), intent(in) :: plan
      type(document_t), intent(in) :: document
      character(:), allocatable :: text
      type(string_t), allocatable :: messages(:)
      type(failure_kind_t), allocatable :: kinds(:)

      call messages_of(names%result, [point], messages)
      call find_kinds(record%status(point), [point], messages, kinds)
      text = paragraph(kinds(1), record, names, plan, document)
   end function explain_point

   !> Sentences on the first point of a kind; lines with a command begin with "try: ".
   function paragraph(kind, record, names, plan, document) result(text)
      type(failure_kind_t), intent(in) :: kind
      type(record_t), intent(in) :: record
      type(run_names_t), intent(in) :: names
      type(sweep_plan_t), intent(in) :: plan
      type(document_t), intent(in) :: document
      character(:), allocatable :: text, advice, command
      integer :: n

      text = "Point "//name_of(kind%first, plan)
      if (kind%n_points > 1) text = text//" and "//number_of(kind%n_points - 1, "other")
      text = text//": "//outcome_text(kind%status)//"."
      if (kind%status == outcome%pending .or. kind%status == outcome%unused) then
         if (kind%status == outcome%pending) text = text//" "//outcome_remedy(kind%status)
         return
      end if
      text = text//attempts_text(kind, record)//nearness_text(kind%first, record, document)
      n = index(kind%message, mark)
      advice = kind%message
      if (n > 0) advice = kind%message(:n - 1)
      if (len_trim(advice) > 0) text = text//new_line("a")//"Message: "//trim(advice)
      if (.not. is_solved(kind%status)) text = text//neighbour_text(kind%first, record, plan)
      text = text//new_line("a")//"What to do: "//outcome_remedy(kind%status)
      command = next_step(kind, names, plan, document)
      if (len(command) > 0) text = text//new_line("a")//"try: "//command
   end function paragraph

   function name_of(point, plan) result(text)
      integer, intent(in) :: point                                    !! from 1
      type(sweep_plan_t), intent(in) :: plan
      character(:), allocatable :: text

      text = to_text(point - 1)
      if (len(plan%describe(point)) > 0) text = text//" ("//plan%describe(point)//")"
   end function name_of

   !> What was tried: the attempts that the message lists, or the one that led to the motion.
   function attempts_text(kind, record) result(text)
      type(failure_kind_t), intent(in) :: kind
      type(record_t), intent(in) :: record
      character(:), allocatable :: text, ending, name
      type(string_t), allocatable :: attempts(:), words(:)
      integer :: i, k, n

      text = ""
      if (ieee_is_finite(record%solve_seconds(kind%first))) text = " It took "//rounded(record%solve_seconds(kind%first))//" s."
      n = index(kind%message, mark)
      if (n == 0) then
         associate (way => record%fallback(kind%first))
            if (is_solved(kind%status) .and. way > 0 .and. way <= ubound(fallback_texts, 1)) &
               text = text//" The first attempt failed; the motion was found "//trim(fallback_texts(way))//"."
         end associate
         return
      end if
      call split(kind%message(n + len(mark):), ", ", attempts)
      ending = ""
      do i = 1, size(attempts)
         call split(trim(adjustl(attempts(i)%value)), " ", words)
         if (size(words) < 2) cycle                                   ! the end of the message had no room
         if (size(words) > 2) ending = words(3)%value
         name = trim(words(1)%value)
         do k = 0, ubound(fallback_names, 1)
            if (fallback_names(k) == words(1)%value .or. (k == 0 .and. words(1)%value == "direct")) name = trim(fallback_texts(k))
         end do
         if (i == 1) text = text//" Tried: "
         if (i > 1) text = text//", "
         text = text//name//" (residual "//words(2)%value//", "//ending//")"
      end do
      text = text//"."
   end function attempts_text

   !> How near the point has come, beside what is asked for.
   function nearness_text(point, record, document) result(text)
      integer, intent(in) :: point                                    !! from 1
      type(record_t), intent(in) :: record
      type(document_t), intent(in) :: document
      character(:), allocatable :: text
      character(:), allocatable :: sign

      text = ""
      if (ieee_is_finite(record%residual(point)) .and. record%residual(point) > 0.0_wp) then   ! 0: from time integration
         text = " Its residual is "//rounded(record%residual(point))//" of the forces"
         if (is_solved(record%status(point)) .and. has_tolerance()) then
            text = text//", enough for the tolerance."                ! hb_accurate_motion, share_of_residual
         else
            text = text//" (tolerance: "//rounded(limit("solver", "tolerance"))//")."
         end if
      end if
      if (is_solved(record%status(point))) then
         sign = " The estimated error is "
         call add(record%truncation(point), " by truncation", "truncation")
         call add(record%aliasing(point), " by aliasing", "aliasing")
         if (sign /= " The estimated error is ") text = text//"."
         if (record%penetration(point) > 0.0_wp) &
            text = text//" The penetration of a wall is "//rounded(record%penetration(point))//" m."
         if (record%is_stable(point) /= 0) &
            text = text//" The motion is "//trim(merge("stable  ", "unstable", record%is_stable(point) > 0))//"."
      end if

   contains

      subroutine add(value, cause, key)
         real(wp), intent(in) :: value
         character(*), intent(in) :: cause, key

         if (.not. ieee_is_finite(value)) return
         text = text//sign//rounded(value)//cause//" (limit "//rounded(limit("certificate", key))//")"
         sign = ", "
      end subroutine add

      !> Whether a tolerance of the motion is asked for.
      logical function has_tolerance()
         type(document_t) :: copy

         copy = document
         has_tolerance = copy%count("accuracy") > 0
      end function has_tolerance

      !> What the input asks for: with a tolerance that of the motion.
      real(wp) function limit(group_name, key) result(value)
         character(*), intent(in) :: group_name, key
         type(document_t), target :: copy
         type(properties_t), pointer :: group

         copy = document
         value = 0.0_wp
         if (group_name == "certificate" .and. copy%count("accuracy") > 0) then
            group => copy%optional_group("accuracy")
            call group%get("tolerance", value)
         end if
         if (value > 0.0_wp) return
         group => copy%optional_group(group_name)
         call group%get(key, value)
      end function limit
   end function nearness_text

   !> The point nearest in number that has a motion to come from.
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
end module hb_explanation
