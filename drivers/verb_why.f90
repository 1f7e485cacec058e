!> `nhbm why`: explains in sentences how points of a result file ended, what was tried, how close the attempts came
!> and what to do next.
module verb_why
   use arguments, only: arguments_t
   use console, only: say, say_entry
   use explanation, only: explain_failures, explain_point
   use hb_advice, only: advice_list_t, describe_advice
   use hb_curve_table, only: note_curve_values
   use hb_document, only: document_t
   use hb_error, only: error_t, fail
   use hb_motion_advice, only: advise_on_status
   use hb_mpi, only: comm_t, rank_of, share_error
   use hb_outcome, only: outcome, outcome_names, outcome_text
   use hb_results_record, only: record_t
   use hb_sweep_plan, only: sweep_plan_t
   use hb_text, only: number_of, split, string_t, to_text
   use next_step, only: command_for_cut_curve, run_names_t
   use verb_info, only: read_result
   implicit none
   private
   public :: run_why, print_statuses

contains

   !> Runs the verb, on rank 0.
   subroutine run_why(options, comm, error)
      type(arguments_t), intent(in) :: options
      type(comm_t), intent(in) :: comm
      type(error_t), allocatable, intent(out) :: error

      if (rank_of(comm) == 0) call explain(options, error)
      call share_error(comm, error)
   end subroutine run_why

   subroutine explain(options, error)
      type(arguments_t), intent(in) :: options
      type(error_t), allocatable, intent(out) :: error
      type(document_t), target :: document
      type(record_t) :: record
      type(run_names_t) :: names
      type(string_t), allocatable :: paragraphs(:)
      type(sweep_plan_t) :: plan
      character(:), allocatable :: command
      integer :: i

      call read_result(options%input, record, document, plan, names, error)
      if (.not. allocated(error)) call note_curve_values(options%input, plan, error)
      if (allocated(error)) return
      if (options%point >= record%n_points) then
         call fail(error, "there is no point "//to_text(options%point)//" in '"//options%input//"'; it has 0 to "// &
                   to_text(record%n_points - 1))
      else if (options%point >= 0) then
         call write_paragraph(explain_point(options%point + 1, record, names, plan, document))
      else
         call explain_failures(record, names, plan, document, paragraphs)
         do i = 1, size(paragraphs)
            if (i > 1) call say("")
            call write_paragraph(paragraphs(i)%value)
         end do
         command = command_for_cut_curve(names, plan, document)
         if (len(command) > 0) call say("A curve goes on beyond its last point, 'points' of &curve; try: "//command)
         if (size(paragraphs) == 0 .and. len(command) == 0) call say("nothing has failed: "// &
            number_of(count(record%status == outcome%converged), "point")//" converged, "// &
            to_text(count(record%status == outcome%pending))//" pending; nhbm why FILE --point N describes one")
      end if
   end subroutine explain

   !> Wraps sentences; a command remains on one line, so that it can be copied.
   subroutine write_paragraph(text)
      character(*), intent(in) :: text
      type(string_t), allocatable :: lines(:)
      integer :: i

      call split(text, new_line("a"), lines)
      do i = 1, size(lines)
         if (index(lines(i)%value, "try: ") == 1) then
            call say("  "//lines(i)%value)
         else
            call say_entry("", lines(i)%value, 1)
         end if
      end do
   end subroutine write_paragraph

   !> Prints the table of all statuses: the meaning and the remedy of each.
   subroutine print_statuses()
      type(advice_list_t) :: list
      character(:), allocatable :: remedy, text
      integer :: i

      do i = lbound(outcome_names, 1), ubound(outcome_names, 1)
         text = outcome_text(i)
         if (index(text, ": ") > 0) text = text(index(text, ": ") + 2:)   ! the preceding text repeats the name
         list = advice_list_t()
         call advise_on_status(i, list)
         call describe_advice(list, remedy)
         call say_entry(trim(outcome_names(i)), text//". "//remedy, len(outcome_names) + 2)
      end do
   end subroutine print_statuses
end module verb_why
