!> `nhbm solve`: solves all points of an input and writes the result file. `nhbm resume`: continues a result file.
module verb_solve
   use arguments, only: arguments_t, is_more_points
   use console, only: print_error, say, say_advice
   use exit_status, only: incomplete, not_all_right, success
   use explanation, only: status_lines
   use hb_advice, only: advice, advice_list_t, has_advice
   use hb_curve_table, only: find_leaving, leaving_t, note_curve_values
   use hb_error, only: annotate, error_t, fail
   use hb_file_location, only: check_source
   use hb_inactive_laws, only: advise_on_inactive_laws
   use hb_kinds, only: wp
   use hb_longer_curves, only: lengthen_curves
   use hb_memory, only: available_memory, retain_freed_memory
   use hb_model, only: model_t
   use hb_model_advice, only: advise_on_combination, advise_on_drive
   use hb_motion_advice, only: advise_on_verdict
   use hb_mpi, only: broadcast_text, comm_t, max_over, rank_of, ranks_on_node, share_error, size_of
   use hb_operating_system, only: file_kind, folder_of, kind_of_file, remove_file
   use hb_outcome, only: outcome, reason
   use hb_point_kinds, only: beginning, curve_kind, curve_kinds
   use hb_progress, only: log_level
   use hb_results_record, only: name_of_input, numbers_of, read_record, record_t
   use hb_run_summary, only: number_answered, number_solved, run_summary_t
   use hb_stability, only: stability_method
   use hb_structure_load, only: is_random
   use hb_study, only: new_study, study_t
   use hb_sweep, only: run_options_t, run_study
   use hb_sweep_plan, only: sweep_plan_t
   use hb_text, only: add_string, join, number_of, split, string_t, to_text
   use hb_text_file, only: read_text_file
   use hb_version, only: git_commit, program_version
   use next_step, only: command_for_cut_curve, run_names_t, shell_word
   use result_location, only: place_result
   use run_advice, only: advise_on_free_coordinates, advise_on_run, varies_loads
   use run_texts, only: answers_text, curve_lines, ending_text, found_frequency, is_regular_end, max_line, stability_text, &
      timing_lines
   use switched_inputs, only: switched_input
   implicit none
   private
   public :: load_study, make_study, run_resume, run_solve

   integer, parameter :: most_points = 4000                           ! of a curve whose number of points is not given
   real(wp), parameter :: same_end = 1.0e-5_wp                        ! of the range: motions end where others leave the curve

contains

   !> Runs the verb `solve`; without an error it returns an exit status.
   subroutine run_solve(options, comm, status, error)
      type(arguments_t), intent(in) :: options
      type(comm_t), intent(in) :: comm
      integer, intent(out) :: status
      type(error_t), allocatable, intent(out) :: error
      type(study_t) :: study
      type(advice_list_t) :: list
      character(:), allocatable :: path

      status = success
      call place_result(options, comm, path, error)
      if (.not. allocated(error)) call load_study(options, comm, study, error)
      if (allocated(error)) return
      call advise_on_drive(study%model%system, study%model%discretisation, study%model%options, list)
      if (rank_of(comm) == 0 .and. has_advice(list, advice%no_load) .and. .not. varies_loads(study%plan)) then
         list = advice_list_t()
         call list%add(advice%no_load)
         call say_advice("warning: ", list)
      end if
      if (options%overwrite .and. rank_of(comm) == 0) call remove_switched(path)
      call run(study, options, path, options%resumes, comm, status, error)
      if (.not. allocated(error)) call run_switched(study, options, path, comm, status, error)
   end subroutine run_solve

   !> Runs the verb `resume`; without an error it returns an exit status.
   subroutine run_resume(options, comm, status, error)
      type(arguments_t), intent(in) :: options
      type(comm_t), intent(in) :: comm
      integer, intent(out) :: status
      type(error_t), allocatable, intent(out) :: error
      type(study_t) :: study

      status = success
      call load_stored_study(options%input, comm, study, error, options%overrides, options%retries)
      if (allocated(error)) return
      if (size(options%overrides) > 0) then
         if (rank_of(comm) == 0) call lengthen_curves(study, options%input, error)
         call share_error(comm, error)
         if (allocated(error)) return
      end if
      call run(study, options, options%input, .true., comm, status, error)
      if (.not. allocated(error)) call run_switched(study, options, options%input, comm, status, error)
   end subroutine run_resume

   !> Runs a study and reports its end. Curves without a given number of points get more of them until they end.
   subroutine run(study, options, path, resumes, comm, status, error, n_rows)
      type(study_t), intent(inout) :: study                           !! afterwards with the number of points of its file
      type(arguments_t), intent(in) :: options
      character(*), intent(in) :: path                                !! of the result file
      logical, intent(in) :: resumes
      type(comm_t), intent(in) :: comm
      integer, intent(out) :: status
      type(error_t), allocatable, intent(out) :: error
      integer, intent(out), optional :: n_rows                        !! points of the file except unused ones
      character(*), parameter :: chain_note = "; a chain of points that is not finished begins again (see &solver chain_length)"
      type(run_options_t) :: how
      type(run_summary_t) :: summary
      logical :: is_reported

      how%path = path
      how%overwrite = options%overwrite
      how%resumes = resumes
      how%retries = options%retries
      how%level = options%level
      how%time_limit = options%time_limit
      how%status_of_exit = incomplete
      status = success
      is_reported = rank_of(comm) == 0 .and. options%level >= log_level%normal
      if (is_reported) call say("nhbm "//options%verb//" "//options%input//": "// &
         room_text(study)//" on "//number_of(size_of(comm), "rank")//threads_text(study%model%options%solver%n_threads)//", "// &
         number_of(study%model%system%tones%n_tones, "tone")//", "//set_text(study))
      if (is_reported .and. study%n_chains() > 0 .and. study%n_chains() < size_of(comm)) call say("note: "// &
         number_of(study%n_chains(), "chain")//" of points for "//number_of(size_of(comm), "rank")// &
         "; a smaller &solver chain_length makes more of them")
      call run_study(study, how, comm, summary, error)
      do while (.not. allocated(error))
         if (.not. needs_more_points(study, summary, path)) exit
         if (is_reported) call say("a curve has used up "//to_text(study%plan%n_fastest())// &
                                   " points: it continues with twice as many")
         call double_points(study, path, comm, error)
         how%resumes = .true.
         how%overwrite = .false.
         how%retries = .false.
         if (.not. allocated(error)) call run_study(study, how, comm, summary, error)
      end do
      if (allocated(error)) return
      if (number_answered(summary) + n_ends(study%plan, summary, path) + summary%counts(outcome%unused) < summary%n_points) &
         status = not_all_right
      if (allocated(summary%law_findings)) status = not_all_right
      if (summary%n_left > 0) status = incomplete
      if (present(n_rows)) n_rows = summary%n_points - summary%counts(outcome%unused)
      if (is_reported) call write_summary(summary, study, path)
      if (rank_of(comm) == 0 .and. .not. is_reported .and. allocated(summary%law_findings)) &
         call print_error("warning: "//summary%law_findings)
      if (is_reported .and. options%level >= log_level%verbose) call write_times(summary)
      if (rank_of(comm) == 0 .and. status == incomplete) call print_error(ending_text(summary%interruption)//": "// &
         number_of(summary%n_left, "point")//trim(merge(" is ", " are", summary%n_left == 1))// &
         " left; nhbm resume "//path//" solves "//trim(merge("it  ", "them", summary%n_left == 1))// &
         trim(merge(chain_note, repeat(" ", len(chain_note)), study%n_chains() > 0 .and. study%n_chains() < study%plan%n_points)))
   end subroutine run

   !> Whether a curve has used up a number of points that is not given in the input.
   logical function needs_more_points(study, summary, path) result(needs)
      type(study_t), intent(in) :: study
      type(run_summary_t), intent(in) :: summary
      character(*), intent(in) :: path                                !! of the result file

      needs = .false.
      if (.not. allocated(study%plan%curve) .or. summary%n_left > 0) return
      associate (curve => study%plan%curve, n => study%plan%n_fastest())
         if (curve%has_given_points .or. 2*n > most_points) return
         if (curve%switches .and. study%plan%n_points > n) return     ! their files have the numbers of these points
      end associate
      needs = any(numbers_of(path, "reason") == reason%points)
   end function needs_more_points

   !> Gives all curves of a result file room for twice as many points.
   subroutine double_points(study, path, comm, error)
      type(study_t), intent(inout) :: study
      character(*), intent(in) :: path
      type(comm_t), intent(in) :: comm
      type(error_t), allocatable, intent(out) :: error
      type(study_t) :: longer
      type(string_t) :: points(1)

      points(1)%value = "curve%points="//to_text(2*study%plan%n_fastest())
      call load_stored_study(path, comm, longer, error, points)
      if (allocated(error)) return
      if (rank_of(comm) == 0) call lengthen_curves(longer, path, error)
      call share_error(comm, error)
      if (allocated(error)) return
      longer%plan%curve%has_given_points = .false.
      study = longer
   end subroutine double_points

   !> Number of points that are regular ends of curves.
   integer function n_ends(plan, summary, path)
      type(sweep_plan_t), intent(in) :: plan
      type(run_summary_t), intent(in) :: summary
      character(*), intent(in) :: path                                !! of the result file
      integer :: i
      integer, allocatable :: statuses(:)

      n_ends = 0
      if (.not. allocated(plan%curve) .or. summary%counts(outcome%collapsed) + summary%counts(outcome%locked) == 0) return
      statuses = numbers_of(path, "status")
      n_ends = count([(is_regular_end(statuses(i), i, plan), i=1, size(statuses))])
   end function n_ends

   !> Follows the motions that leave the curves of a finished run, each in its own result file, if the input requests
   !> it.
   subroutine run_switched(study, options, path, comm, status, error)
      type(study_t), intent(in) :: study
      type(arguments_t), intent(in) :: options
      character(*), intent(in) :: path                                !! of the result file
      type(comm_t), intent(in) :: comm
      integer, intent(inout) :: status
      type(error_t), allocatable, intent(out) :: error
      type(sweep_plan_t) :: plan
      type(leaving_t), allocatable :: leaving(:)
      real(wp), allocatable :: ends(:)                                ! of the motions followed so far
      integer :: i, its_status

      if (.not. allocated(study%plan%curve) .or. status == incomplete) return
      if (.not. study%plan%curve%switches) return
      plan = study%plan
      call note_curve_values(path, plan, error)
      if (.not. allocated(error)) call find_leaving(path, plan%n_points, leaving, error)
      if (allocated(error)) return
      allocate (ends(0))
      do i = 1, size(leaving)
         associate (value => plan%curve_values(leaving(i)%point), range => abs(plan%curve%to - plan%curve%from))
            if (curve_kinds(leaving(i)%kind)%begins == beginning%doubled_period .and. any(abs(ends - value) <= same_end*range)) then
               if (rank_of(comm) == 0) call say(location_of(path, leaving(i)%point)//": the motions followed before end here")
               cycle
            end if
         end associate
         if (curve_kinds(leaving(i)%kind)%multipliers_jump .and. &
             study%model%options%lacks_impacts_of(study%model%system, outcome%impact)) cycle   ! the curve goes on by itself
         call run_one(leaving(i))
         if (allocated(error)) return
         if (its_status == incomplete .or. status == success) status = its_status
         if (status /= incomplete) cycle
         if (rank_of(comm) == 0) call print_error("nhbm resume "//path//" also follows the motions that bifurcate from its curves")
         return
      end do

   contains

      subroutine run_one(from)
         type(leaving_t), intent(in) :: from
         type(study_t) :: switched
         type(string_t), allocatable :: overrides(:)
         character(:), allocatable :: location, text, where
         integer :: n_rows
         logical :: is_there

         its_status = success
         where = switched_path(path, from%point)
         location = location_of(path, from%point)
         is_there = kind_of_file(where) /= file_kind%none .and. .not. options%overwrite
         if (is_there) then                                           ! its input names this file by its previous name
            call load_stored_study(where, comm, switched, error)
         else
            call switched_input(study, plan, path, from, text, overrides, error)
            if (.not. allocated(error)) call new_study(switched, trim(folder_of(study%document%file_name))// &
               location_of(last_name(path), from%point), text, overrides, error, memory_share(comm))
         end if
         if (allocated(error)) then                                   ! the curve itself is complete
            if (rank_of(comm) == 0) call say(location//": branch not followed: "//error%message)
            deallocate (error)
         else
            call run(switched, options, where, is_there, comm, its_status, error, n_rows)
            if (.not. allocated(error)) call add_ends(ends, switched%plan, where, error)
            if (allocated(error) .or. its_status /= not_all_right .or. n_rows > 1) return
            if (.not. curve_kinds(from%kind)%multipliers_jump) return
            its_status = success                                      ! the motion after the graze need not be a torus
            if (rank_of(comm) > 0) return
            call say("no torus was found beyond "//location//": "//where//" is removed")
            call remove_file(where)
         end if
      end subroutine run_one
   end subroutine run_switched

   !> Adds the values at which the curves of a file end.
   subroutine add_ends(ends, plan, path, error)
      real(wp), allocatable, intent(inout) :: ends(:)
      type(sweep_plan_t), intent(in) :: plan
      character(*), intent(in) :: path
      type(error_t), allocatable, intent(out) :: error
      type(sweep_plan_t) :: noted
      integer, allocatable :: kinds(:)

      noted = plan
      call note_curve_values(path, noted, error)
      if (allocated(error)) return
      kinds = numbers_of(path, "curve_kind")
      ends = [ends, pack(noted%curve_values, kinds == curve_kind%end)]
   end subroutine add_ends

   !> Removes the files of motions that leave the curves of an old result file that is about to be replaced.
   subroutine remove_switched(path)
      character(*), intent(in) :: path
      type(record_t) :: old, switched
      type(error_t), allocatable :: error
      character(:), allocatable :: prefix, where
      integer :: i, k

      if (kind_of_file(path) == file_kind%none) return
      call read_record(old, path, error)
      if (allocated(error)) return
      if (index(old%input_complete, "&curve") == 0) return
      do i = 1, old%n_points
         where = switched_path(path, i)
         if (kind_of_file(where) == file_kind%none) cycle
         call read_record(switched, where, error)
         if (allocated(error)) cycle
         prefix = location_of("", i)
         k = index(switched%input_name, prefix)
         if (k == 0) cycle
         if (last_name(switched%input_name(k + len(prefix):)) == last_name(path)) call remove_file(where)
      end do
   end subroutine remove_switched

   !> A path without its folder.
   pure function last_name(path)
      character(*), intent(in) :: path
      character(:), allocatable :: last_name

      last_name = path(index(path, "/", back=.true.) + 1:)
   end function last_name

   !> Path of the file of the motions that leave a curve at a point, counted from 1.
   function switched_path(path, point) result(where)
      character(*), intent(in) :: path
      integer, intent(in) :: point
      character(:), allocatable :: where

      where = path//"_"//to_text(point - 1)//".h5"
      if (index(path, ".h5", back=.true.) == len(path) - 2) where = path(:len(path) - 3)//"_"//to_text(point - 1)//".h5"
   end function switched_path

   !> Description of a point of a curve, used as the name of the input of the motions that leave it there.
   function location_of(path, point) result(location)
      character(*), intent(in) :: path
      integer, intent(in) :: point
      character(:), allocatable :: location

      location = "point "//to_text(point - 1)//" of "//path
   end function location_of

   !> Text with the number of points, or with the largest number of them.
   function room_text(study) result(text)
      type(study_t), intent(in) :: study
      character(:), allocatable :: text

      associate (plan => study%plan)
         text = number_of(plan%n_points, "point")
         if (allocated(plan%curve)) text = number_of(plan%n_points/plan%n_fastest(), "curve")//" of up to "// &
            number_of(plan%n_fastest(), "point")
      end associate
   end function room_text

   !> Writes the located points of curves.
   subroutine write_curves(study, path)
      type(study_t), intent(in) :: study
      character(*), intent(in) :: path
      type(sweep_plan_t) :: plan
      type(error_t), allocatable :: error
      type(advice_list_t) :: list
      character(max_line), allocatable :: lines(:)
      character(:), allocatable :: command
      integer :: i

      plan = study%plan
      call note_curve_values(path, plan, error)
      if (.not. allocated(error)) call curve_lines(path, plan, lines, list, error)
      if (allocated(error)) return                                    ! the file was just written: `info` reports the error
      do i = 1, size(lines)
         call say(trim(lines(i)))
      end do
      call say_advice("", list)
      command = command_for_cut_curve(names_of(study, path), plan, study%document)
      if (len(command) > 0) call say("  try: "//command)
   end subroutine write_curves

   subroutine write_times(summary)
      type(run_summary_t), intent(in) :: summary
      character(max_line), allocatable :: lines(:)
      integer :: i

      allocate (lines, source=timing_lines(summary%times))
      call say("time spent by each rank:")
      do i = 1, size(lines)
         call say(trim(lines(i)))
      end do
   end subroutine write_times

   subroutine write_summary(summary, study, path)
      type(run_summary_t), intent(in) :: summary
      type(study_t), intent(in) :: study
      character(*), intent(in) :: path
      character(100) :: estimates
      type(advice_list_t) :: list
      integer :: i, n

      if (allocated(summary%made_by)) call say("note: the file was made by "//summary%made_by// &
         ", this is nhbm "//program_version//" ("//git_commit//")")
      if (summary%n_damaged > 0) call say("note: the results of "//number_of(summary%n_damaged, "point")// &
         " were damaged in the file; solved again")
      if (summary%has_other_libraries) call say("note: the model comes from another file, or a law from another library, than "// &
         "in the run that made the results")
      if (summary%was_complete) call say("nothing is left to solve: "//path//" was complete"//retry_text(summary, study, path))
      call say(answers_text(summary)//"; results in "//path)
      call write_others(study, path)
      if (allocated(study%plan%curve)) call write_curves(study, path)
      if (summary%n_by_fallback > 0) call say(number_of(summary%n_by_fallback, "point")// &
         " solved by a fallback (see 'fallback' in the results)")
      n = count(numbers_of(path, "n_full_stick") > 0)
      if (n > 0) call list%add(advice%full_stick_of_points, [real(n, wp)])
      call say_advice("", list)
      list = advice_list_t()
      do i = 1, study%model%system%tones%n_tones
         if (study%model%system%tones%is_unknown(i)) call say("unknown "//found_frequency(summary, i, study%model%system%tones))
      end do
      if (summary%n_estimated > 0) then
         write (estimates, "(a, es7.1, a, es7.1, a)") "largest estimated relative error: ", summary%truncation, &
            " by truncation, ", summary%aliasing, " by aliasing"
         call say(trim(estimates))
         if (summary%of_frequency > max(summary%truncation, summary%aliasing)) then
            write (estimates, "(a, es7.1)") "of the frequency of an unknown tone: ", summary%of_frequency
            call say(trim(estimates))
         end if
         if (summary%by_levels > 0.0_wp) then
            write (estimates, "(a, es7.1)") "by comparison of refinement levels, where larger: ", summary%by_levels
            call say(trim(estimates))
         end if
      end if
      if (number_solved(summary) > 0 .and. study%model%options%stability%method /= stability_method%off &
          .and. .not. study%model%system%normal_mode%is_requested) &
         call say(stability_text(summary%n_stable, summary%n_unstable, number_solved(summary))//" (see 'is_stable')")
      do i = 0, ubound(summary%n_unknown, 1)
         if (summary%n_unknown(i) > 0) call advise_on_verdict(i, summary%n_unknown(i), &
            study%model%options%stability%method == stability_method%integration, list)
      end do
      if (summary%n_without_noise > 0 .and. any(is_random(study%model%system%loads))) &
         call list%add(advice%unknown_noise, [real(summary%n_without_noise, wp)])
      call say_advice("", list)
      list = advice_list_t()
      if (size(study%model%options%gradient%by) > 0 .and. summary%counts(outcome%integrated) > 0 .and. &
          .not. (study%model%system%tones%n_tones == 1 .and. &
                 study%model%options%lacks_impacts_of(study%model%system, outcome%impact))) &
         call list%add(advice%no_derivatives, [real(summary%counts(outcome%integrated), wp)])
      if (allocated(summary%law_findings)) call say("warning: "//summary%law_findings)
      call advise_on_inactive_laws(study%model%system, summary%is_inactive, list)
      n = count(numbers_of(path, "is_beyond_tables") > 0)
      if (n > 0) call list%add(advice%beyond_tables, [real(n, wp)])
      if (summary%n_near_commensurate > 0) call advise_on_tones(study, summary, list)
      call say_advice("warning: ", list)
      list = advice_list_t()
      if (summary%n_jumps > 0) call list%add(advice%jumps, [real(summary%n_jumps, wp)], study%plan%describe(summary%first_jump))
      call say_advice("", list)
   end subroutine write_summary

   !> How the points of a complete file that did not converge are tried again; empty if there are none.
   function retry_text(summary, study, path) result(text)
      type(run_summary_t), intent(in) :: summary
      type(study_t), intent(in) :: study
      character(*), intent(in) :: path
      character(:), allocatable :: text
      integer :: n

      text = ""
      n = summary%n_points - summary%counts(outcome%unused) - number_answered(summary) - n_ends(study%plan, summary, path)
      if (n > 0) text = "; nhbm resume "//shell_word(path)//" --retry repeats "//number_of(n, "point")// &
                        " that did not converge"
   end function retry_text

   !> Writes the outcome of the points that did not converge, and suggestions.
   subroutine write_others(study, path)
      type(study_t), intent(in) :: study
      character(*), intent(in) :: path                                !! of the result file
      type(sweep_plan_t) :: plan
      type(error_t), allocatable :: error
      type(string_t), allocatable :: lines(:)
      integer :: i

      plan = study%plan
      call note_curve_values(path, plan, error)
      call status_lines(numbers_of(path, "status"), names_of(study, path), plan, study%document, lines)
      do i = 1, size(lines)
         call say(lines(i)%value)
      end do
      if (size(lines) > 0) call say("nhbm why "//shell_word(path)//" explains each of them")
   end subroutine write_others

   !> The names that a command about a run contains.
   function names_of(study, path) result(names)
      type(study_t), intent(in) :: study
      character(*), intent(in) :: path                                !! of the result file
      type(run_names_t) :: names

      names%input = study%document%file_name
      names%result = path
      allocate (names%overrides(0))
      if (len(study%input_overrides) > 0) call split(study%input_overrides, new_line("a"), names%overrides)
   end function names_of

   !> Names the points at which a combination of the tones nearly vanishes, and that of the first one.
   subroutine advise_on_tones(study, summary, list)
      type(study_t), intent(in) :: study
      type(run_summary_t), intent(in) :: summary
      type(advice_list_t), intent(inout) :: list
      type(error_t), allocatable :: error
      type(model_t) :: model
      character(:), allocatable :: first

      first = study%plan%describe(summary%first_near_commensurate)
      if (len(first) == 0) first = "point "//to_text(summary%first_near_commensurate - 1)
      call list%add(advice%vanishing_combinations, [real(summary%n_near_commensurate, wp)], first)
      call study%read_point(summary%first_near_commensurate, model, error)
      if (.not. allocated(error)) &
         call advise_on_combination(model%system%tones, model%options%error_estimate%commensurability, list)
   end subroutine advise_on_tones

   !> Reads the input file on rank 0, for all ranks, and creates its study.
   subroutine load_study(options, comm, study, error)
      type(arguments_t), intent(in) :: options
      type(comm_t), intent(in) :: comm
      type(study_t), intent(out) :: study
      type(error_t), allocatable, intent(out) :: error
      character(:), allocatable :: text

      if (rank_of(comm) == 0) then
         call check_source(options%input, error)
         if (.not. allocated(error)) call read_text_file(options%input, text, error)
      end if
      call share_error(comm, error)
      if (allocated(error)) return
      call broadcast_text(comm, text, 0)
      call make_study(study, options%input, text, options%overrides, comm, error, &
                      may_only_integrate=any(options%verb == [character(9) :: "check", "integrate"]))
   end subroutine load_study

   !> Creates the study of the input that is stored in a result file, with further overrides, for more points of its curves.
   subroutine load_stored_study(path, comm, study, error, overrides_of_curve, may_have_others)
      character(*), intent(in) :: path
      type(comm_t), intent(in) :: comm
      type(study_t), intent(out) :: study
      type(error_t), allocatable, intent(out) :: error
      type(string_t), intent(in), optional :: overrides_of_curve(:)
      logical, intent(in), optional :: may_have_others                !! libraries of laws, as with --retry; default: no
      type(record_t) :: record
      type(string_t), allocatable :: overrides(:)
      character(:), allocatable :: files, lines, name, text

      if (rank_of(comm) == 0) then
         call read_record(record, path, error)
         if (.not. allocated(error)) then
            name = trim(name_of_input(record))
            text = record%input_text
            files = record%input_libraries
            overrides = record%overrides
            if (present(overrides_of_curve)) call add_overrides(overrides, overrides_of_curve, record, path, error)
            lines = join(overrides, new_line("a"))
            if (allocated(overrides)) deallocate (overrides)
            if (has_changed(name, text)) call print_error("note: "//name//" has changed; the run continues with the input that "// &
               path//" contains")
         end if
      end if
      call share_error(comm, error)
      if (allocated(error)) return
      call broadcast_text(comm, name, 0)
      call broadcast_text(comm, text, 0)
      call broadcast_text(comm, lines, 0)
      call broadcast_text(comm, files, 0)
      allocate (overrides(0))
      if (len(lines) > 0) call split(lines, new_line("a"), overrides)
      if (present(may_have_others)) then
         if (may_have_others) deallocate (files)                       ! absent below
      end if
      call make_study(study, name, text, overrides, comm, error, files=files)
      if (allocated(error) .and. allocated(files)) call annotate(error, "result file '"//path//"'")
   end subroutine load_stored_study

   !> Adds overrides of `&curve` to those of a file, in place of those of the same keys; fails if the file has no curve.
   subroutine add_overrides(overrides, added, record, path, error)
      type(string_t), allocatable, intent(inout) :: overrides(:)
      type(string_t), intent(in) :: added(:)
      type(record_t), intent(in) :: record
      character(*), intent(in) :: path
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      if (size(added) == 0) return
      if (index(record%input_complete, "&curve") == 0) then
         call fail(error, "--set "//added(1)%value//": '"//path//"' has no curve")
         return
      end if
      overrides = pack(overrides, [(.not. is_more_points(overrides(i)%value), i=1, size(overrides))])
      do i = 1, size(added)
         call add_string(overrides, added(i)%value)
      end do
   end subroutine add_overrides

   !> Whether the input file is still there and has another text.
   logical function has_changed(name, text)
      character(*), intent(in) :: name, text
      type(error_t), allocatable :: error
      character(:), allocatable :: present_text

      has_changed = .false.
      if (kind_of_file(name) /= file_kind%regular) return
      call read_text_file(name, present_text, error)
      if (.not. allocated(error)) has_changed = present_text /= text
   end function has_changed

   !> Creates a study on all ranks, one after the other: the first may have to reduce a model, and the others read the
   !> stored reduction.
   subroutine make_study(study, name, text, overrides, comm, error, may_only_integrate, files)
      type(study_t), intent(out) :: study
      character(*), intent(in) :: name, text
      type(string_t), intent(in) :: overrides(:)
      type(comm_t), intent(in) :: comm
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: may_only_integrate             !! as of `new_study`
      character(*), intent(in), optional :: files                     !! likewise
      type(advice_list_t) :: list
      real(wp) :: memory

      memory = memory_share(comm)
      call retain_freed_memory(retained_mebibytes(memory))
      if (rank_of(comm) == 0) call new_study(study, name, text, overrides, error, memory, may_only_integrate, files)
      call share_error(comm, error)
      if (allocated(error)) return
      if (rank_of(comm) > 0) call new_study(study, name, text, overrides, error, memory, may_only_integrate, files)
      call share_error(comm, error)
      if (allocated(error) .or. rank_of(comm) > 0) return
      call advise_on_run(study%plan, study%document, study%model, list)
      call say_advice("warning: ", list)
      list = advice_list_t()
      call advise_on_free_coordinates(study%model, list)
      call say_advice("note: ", list)
   end subroutine make_study

   !> Memory [bytes] that each process may take: the smallest share of all ranks; collective.
   real(wp) function memory_share(comm)
      type(comm_t), intent(in) :: comm

      memory_share = -max_over(comm, -available_memory()/ranks_on_node(comm))
   end function memory_share

   !> Freed memory [MiB] that a process retains of its share [bytes]: what one level of a point with three tones needs, if that is
   !> a small part.
   pure integer function retained_mebibytes(memory) result(n)
      real(wp), intent(in) :: memory
      real(wp), parameter :: mebibyte = 1048576.0_wp, part = 0.125_wp
      integer, parameter :: least = 64, most = 1024

      n = max(least, int(min(part*memory/mebibyte, real(most, wp))))
   end function retained_mebibytes

   !> Text with the number of harmonics of the points, or with their requested accuracy.
   function set_text(study) result(text)
      type(study_t), intent(in) :: study
      character(:), allocatable :: text
      integer :: i

      text = number_of(size(study%tuples, 2), "harmonic")
      if (study%model%options%accuracy%is_on) then
         text = text//", samples"
         if (study%model%options%accuracy%grows_set) text = "harmonics"
         if (any([(study%plan%parameters(i)%path == "accuracy%tolerance", i=1, size(study%plan%parameters))])) then
            text = text//" for the tolerance of each point"
         else
            text = text//" for a tolerance of "//to_text(study%model%options%accuracy%tolerance)
         end if
      end if
   end function set_text

   !> How many threads each rank has, for the first line of a run.
   pure function threads_text(n) result(text)
      integer, intent(in) :: n
      character(:), allocatable :: text

      text = ""
      if (n > 1) text = " of "//to_text(n)//" threads"
   end function threads_text
end module verb_solve
