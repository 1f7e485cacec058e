!> Summary of how the points of a result file ended: each kind of failure once, with its message, how many points it has,
!> and the command to try next.
module hb_failure_kinds
   use hb_document, only: document_t
   use hb_next_step, only: failure_kind_t, next_step, run_names_t, shell_word
   use hb_outcome, only: outcome, outcome_names, outcome_text
   use hb_results_record, only: messages_of
   use hb_sweep_plan, only: sweep_plan_t
   use hb_text, only: number_of, string_t, to_text
   implicit none
   private
   public :: find_kinds, status_lines

   integer, parameter :: most_read = 200                              ! messages of a status that are examined
   integer, parameter :: most_kinds = 3                               ! of a status that are reported

contains

   !> Lines on all points but those that are converged, pending or unused.
   subroutine status_lines(status, names, plan, document, lines)
      integer, intent(in) :: status(:)                                !! (n_points)
      type(run_names_t), intent(in) :: names
      type(sweep_plan_t), intent(in) :: plan
      type(document_t), intent(in) :: document                        !! the input of the run
      type(string_t), allocatable, intent(out) :: lines(:)
      type(failure_kind_t), allocatable :: kinds(:)
      type(string_t), allocatable :: messages(:)
      character(:), allocatable :: said, text
      integer, allocatable :: points(:)
      integer :: i, k, n

      allocate (lines(0))
      do i = outcome%converged + 1, min(maxval(status), ubound(outcome_names, 1))
         n = count(status == i)
         if (n == 0 .or. i == outcome%unused) cycle
         points = pack([(k, k=1, size(status))], status == i)
         text = to_text(n)//" "//outcome_text(i)//" (first: point "//to_text(points(1) - 1)//")"
         lines = [lines, string_t(text)]
         points = points(:min(n, most_read))
         said = ""
         call messages_of(names%result, points, messages)
         call find_kinds(i, points, messages, kinds)
         do k = 1, min(size(kinds), most_kinds)
            text = "point "//to_text(kinds(k)%first - 1)
            if (len(plan%describe(kinds(k)%first)) > 0) text = text//" ("//plan%describe(kinds(k)%first)//")"
            if (size(kinds) > 1 .and. kinds(k)%n_points > 1) text = text//" and "// &
               number_of(kinds(k)%n_points - 1, "other")
            if (len(kinds(k)%message) > 0) lines = [lines, string_t("  "//text//": "//kinds(k)%message)]
            text = next_step(kinds(k), names, plan, document)
            if (len(text) == 0 .or. text == said) cycle
            lines = [lines, string_t("  try: "//text)]
            said = text
         end do
         if (size(kinds) > most_kinds) lines = [lines, string_t("  and "//number_of(size(kinds) - most_kinds, "other message")// &
            "; nhbm-post info "//shell_word(names%result)//" has a row for each point")]
      end do
   end subroutine status_lines

   !> Groups points of one status by their messages, apart from numbers.
   pure subroutine find_kinds(status, points, messages, kinds)
      integer, intent(in) :: status
      integer, intent(in) :: points(:)                                !! from 1, ascending
      type(string_t), intent(in) :: messages(:)                       !! as points
      type(failure_kind_t), allocatable, intent(out) :: kinds(:)
      character(:), allocatable :: form
      integer :: i, k, n

      allocate (kinds(size(points)))
      n = 0
      do i = 1, size(points)
         form = without_numbers(messages(i)%value)
         do k = 1, n
            if (without_numbers(kinds(k)%message) == form) exit
         end do
         n = max(n, k)
         kinds(k)%n_points = kinds(k)%n_points + 1
         if (kinds(k)%n_points > 1) cycle
         kinds(k)%status = status
         kinds(k)%first = points(i)
         kinds(k)%message = messages(i)%value
      end do
      kinds = kinds(:n)
   end subroutine find_kinds

   !> Message up to its list of residuals, without what numbers consist of.
   pure function without_numbers(message) result(form)
      character(*), intent(in) :: message
      character(:), allocatable :: form
      integer :: i, n

      form = message
      n = index(message, "; least residuals:")
      if (n > 0) form = message(:n - 1)
      n = 0
      do i = 1, len(form)
         if (index("0123456789.+-Ee", form(i:i)) > 0) cycle
         n = n + 1
         form(n:n) = form(i:i)
      end do
      form = form(:n)
   end function without_numbers
end module hb_failure_kinds
