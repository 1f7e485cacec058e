!> Runs all points of an input over the ranks of a communicator and writes the result file.
!> Points, or chains of points that start from each other's solutions, are independent of each other; each rank draws
!> the next ones from hb_schedule. The result of a point does not depend on the rank that solves it or on the time, so
!> the file contains the same numbers for any number of ranks.
module hb_sweep
   use hb_advice, only: describe_advice, n_advice
   use hb_branch_numbers, only: number_branches
   use hb_cancellation, only: verdict
   use hb_chain_check, only: chain_check_t
   use hb_chained_points, only: are_checked, length_of_units
   use hb_clock, only: wall_clock
   use hb_crash_detection, only: begin_point, crash_location_t, detect_crashes, end_crash_detection, end_point
   use hb_error, only: error_t, fail
   use hb_inactive_laws, only: inactive_laws_t
   use hb_interruption, only: interruption, new_interruption
   use hb_kinds, only: wp
   use hb_law_findings, only: law_findings_t
   use hb_model, only: model_t
   use hb_motion_result, only: motion_result_t
   use hb_mpi, only: barrier, broadcast_text, comm_t, gather_rows, max_over, new_work_counter, rank_of, &
      share_error, size_of, sum_over, &
      work_counter_t
   use hb_neighbour, only: neighbour_t
   use hb_outcome, only: outcome, outcome_name, reason
   use hb_padding, only: remove_padding
   use hb_point_source, only: point_source_t
   use hb_progress, only: log_level, new_progress, progress_t
   use hb_results, only: create_results, open_results, results_t
   use hb_results_layout, only: rank_times_t
   use hb_results_record, only: count_pending, read_record, record_t, store_law_findings
   use hb_resume, only: choose_units, resumed_file_t, resumed_input_t
   use hb_run_summary, only: count_point, count_retained, has_answer, number_solved, run_summary_t, sum_up
   use hb_schedule, only: cursor_t, new_schedule, schedule_t
   use hb_signals, only: wait_for_points
   use hb_structure, only: structure_t
   use hb_study, only: describe_layout, study_t
   use hb_swept_curve, only: new_swept_curve, swept_curve_t
   use hb_swept_point, only: run_point
   use hb_text, only: rounded_to, to_text
   use hb_watched_interruption, only: watched_t
   implicit none
   private
   public :: run_options_t, run_study

   ! The whole file is created before the first point: with one degree of freedom and two harmonics a point takes 872
   ! bytes of it, 50 million 44 GB, and 15 bytes of memory during this step, 0.8 GB (measured with 100,000 and a
   ! million points).
   integer, parameter :: max_points = 50000000

   !> How to run a study.
   type :: run_options_t
      character(:), allocatable :: path                               !! of the result file
      logical :: overwrite = .false.                                  !! an existing file may be replaced
      logical :: resumes = .false.                                    !! an existing file is continued
      logical :: retries = .false.                                    !! and its points that did not converge are solved again
      integer :: level = log_level%normal                             !! log level, hb_progress
      real(wp) :: time_limit = huge(1.0_wp)                           !! [s] of wall time
      integer :: status_of_exit = 1                                   !! exit status if exit() ends the process within a point
   end type run_options_t

   !> The objects of a rank that solves points.
   type :: run_t
      type(point_source_t) :: source
      type(results_t) :: results
      type(schedule_t) :: schedule
      type(work_counter_t) :: counter
      type(progress_t) :: progress
      type(watched_t) :: ending
      type(rank_times_t) :: times
      logical :: is_checked = .false.                                 !! whether chains are checked for changes of the branch
      type(resumed_file_t) :: before                                  !! of a previous run, whose crashed points are skipped
      integer :: n_unused = 0                                         !! rows that curves did not need
   end type run_t

contains

   !> Solves all points, or those that a previous run has not solved, and writes them; collective. An error is a
   !> failure of the result file; errors of single points are recorded in the file.
   subroutine run_study(self, options, comm, summary, error)
      type(study_t), intent(inout) :: self                            !! afterwards at the point that was read last
      type(run_options_t), intent(in) :: options
      type(comm_t), intent(in) :: comm
      type(run_summary_t), intent(out) :: summary
      type(error_t), allocatable, intent(out) :: error
      class(run_t), allocatable, target :: run
      real(wp) :: started

      started = wall_clock()
      if (self%plan%n_points > max_points) then
         call fail(error, to_text(self%plan%n_points)//" points are more than one result file takes, "//to_text(max_points)// &
            "; give the sweep fewer values, or split it into several inputs")
         return
      end if
      allocate (run)
      call prepare(self, options, comm, run, summary, error)
      if (allocated(error)) then
         call return_model(run%source, self)
         return
      end if
      call run%source%layout%forget_values()
      run%schedule%block_seconds = run%results%hold_seconds()
      run%ending%progress => run%progress
      run%ending%counter => run%counter
      call new_interruption(run%ending%interruption_t, options%time_limit - (wall_clock() - started), comm, error)
      if (.not. allocated(error)) call solve_points(self, options, comm, run, summary, error)
      call run%source%cached%destroy()
      call return_model(run%source, self)
      if (allocated(error)) then
         call run%results%abandon()                                   ! closing is collective, and fails if writing has failed
      else
         call run%results%close(error)
      end if
      if (rank_of(comm) == 0 .and. .not. allocated(error)) &
         call complete_file(self, options, run, wall_clock() - started < options%time_limit, summary, error)
      call share_error(comm, error)
      call broadcast_text(comm, summary%law_findings)
      call run%ending%destroy()
      summary%seconds = wall_clock() - started
   end subroutine run_study

   !> Solves and writes the points under the detection of crashes, and numbers the branches of a sweep that is complete; collective.
   subroutine solve_points(self, options, comm, run, summary, error)
      type(study_t), intent(in) :: self
      type(run_options_t), intent(in) :: options
      type(comm_t), intent(in) :: comm
      type(run_t), intent(inout), target :: run
      type(run_summary_t), intent(inout) :: summary
      type(error_t), allocatable, intent(out) :: error
      type(crash_location_t) :: location

      location = run%results%crash_location()
      location%exit_status = options%status_of_exit
      call detect_crashes(options%path, location)
      call wait_for_points()
      call run%ending%enter(huge(1.0_wp))
      call run_points(self, run, options%level, comm, summary, error)
      call run%ending%leave()
      call end_crash_detection()
      call share_error(comm, error)
      if (summary%n_left == 0 .and. self%plan%is_ordered() .and. .not. allocated(error)) &
         call number_branches(run%results, self%plan, length_of_units(self%plan, self%model), comm, summary%n_jumps, &
         summary%first_jump, error)
   end subroutine solve_points

   !> Checks the closed file, and adds to it what is known of the whole run alone; on one rank.
   subroutine complete_file(self, options, run, has_time, summary, error)
      type(study_t), intent(in) :: self
      type(run_options_t), intent(in) :: options
      type(run_t), intent(inout) :: run
      logical, intent(in) :: has_time                                 !! for what is not necessary
      type(run_summary_t), intent(inout) :: summary
      type(error_t), allocatable, intent(out) :: error

      if (summary%interruption /= interruption%signal) call check_written(options%path, summary%n_left, error)
      if (allocated(error)) return
      if (run%before%is_there .and. allocated(self%plan%curve)) call recount(options%path, summary, error)
      if (allocated(error)) return
      if (summary%n_left == 0 .and. self%model%options%accuracy%grows_set) &
         call remove_padding(self, options%path, run%progress, has_time)
      if (run%before%is_there .or. allocated(summary%law_findings)) &
         call store_law_findings(options%path, summary%law_findings, error)
   end subroutine complete_file

   !> Prepares a run: the source of points, the points to solve, and the result file.
   subroutine prepare(self, options, comm, run, summary, error)
      type(study_t), intent(inout) :: self
      type(run_options_t), intent(in) :: options
      type(comm_t), intent(in) :: comm
      type(run_t), intent(inout) :: run
      type(run_summary_t), intent(inout) :: summary
      type(error_t), allocatable, intent(out) :: error
      type(resumed_input_t) :: input

      run%source%rank = rank_of(comm)
      run%source%document = self%document
      run%source%plan = self%plan
      run%source%available_memory = self%available_memory
      run%source%callbacks = self%callbacks
      run%source%purpose = self%purpose
      call describe_layout(self, size_of(comm), run%source%layout)
      call hand_over_model(self%model, run%source%model)
      call new_schedule(run%schedule, self%plan%n_points, self%plan%n_fastest(), &
         length_of_units(self%plan, self%model), size_of(comm), block_seconds=0.0_wp)
      run%is_checked = are_checked(self%plan, self%model)
      allocate (run%before%crashed(0))
      if (options%resumes) then
         input%complete = self%input_complete
         input%tuples = self%tuples
         input%libraries = run%source%layout%input_libraries
         call choose_units(options%path, input, options%retries, comm, run%schedule, run%before, summary, error)
         if (allocated(error)) return
      end if
      if (run%before%is_there) then
         summary%was_complete = run%schedule%n_points == 0
         call open_results(run%results, options%path, run%source%layout, comm, error)
      else
         call create_results(run%results, options%path, run%source%layout, options%overwrite, comm, error)
      end if
   end subroutine prepare

   !> Copies a model, but moves its large matrices, of which a second copy would take as much memory as the solution.
   subroutine hand_over_model(from, to)
      type(model_t), intent(inout) :: from
      type(model_t), intent(out) :: to
      type(structure_t) :: large

      call move_alloc(from%system%structure%sparse, large%sparse)
      to = from
      call move_alloc(large%sparse, to%system%structure%sparse)
   end subroutine hand_over_model

   !> Returns the model to the study, with the document that has its values: another run goes on from there as from any other point.
   subroutine return_model(source, study)
      type(point_source_t), intent(inout) :: source
      type(study_t), intent(inout) :: study

      nullify (source%model%system%contact_parts)                     ! freed
      call hand_over_model(source%model, study%model)
      study%document = source%document
   end subroutine return_model

   !> Counts all points of the file: a continued curve has points of both runs.
   subroutine recount(path, summary, error)
      character(*), intent(in) :: path
      type(run_summary_t), intent(inout) :: summary
      type(error_t), allocatable, intent(out) :: error
      type(record_t) :: record
      integer :: none(0)

      call read_record(record, path, error)
      if (.not. allocated(error)) call count_retained(summary, record, none)
   end subroutine recount

   !> Fails if results that were written are missing in the file.
   subroutine check_written(path, n_left, error)
      character(*), intent(in) :: path
      integer, intent(in) :: n_left                                   !! points that may be without a result
      type(error_t), allocatable, intent(out) :: error
      integer :: n_pending

      call count_pending(path, n_pending, error)
      if (allocated(error)) then
         error%message = "result file '"//path//"' was changed while the run wrote to it; results are lost: "//error%message
      else if (n_pending > n_left) then
         call fail(error, "result file '"//path//"' was changed while the run wrote to it; the results of "// &
            to_text(n_pending - n_left)//" points are lost")
      end if
   end subroutine check_written

   !> Draws blocks of units until there are none left, or the run must end. Rank 0 prints the progress of all ranks.
   subroutine run_points(self, run, level, comm, summary, error)
      type(study_t), intent(in) :: self
      type(run_t), intent(inout), target :: run
      integer, intent(in) :: level
      type(comm_t), intent(in) :: comm
      type(run_summary_t), intent(inout) :: summary
      type(error_t), allocatable, intent(out) :: error
      type(cursor_t) :: cursor
      real(wp) :: started, waited
      integer :: done, failed, first, i, last, n, number

      call new_work_counter(run%counter, [(run%schedule%owner_of(i), i=1, run%schedule%n_counters)], comm, error)
      if (allocated(error)) return
      call new_progress(run%progress, merge(0, run%schedule%n_points, allocated(self%plan%curve)), level, run%source%rank == 0)
      cursor = run%schedule%cursor_of(run%source%rank)
      started = wall_clock()
      do while (.not. (cursor%is_done .or. allocated(error) .or. run%ending%reason /= interruption%none))
         waited = wall_clock()
         n = run%schedule%ask(cursor)
         number = run%counter%next(cursor%counter, n)
         run%times%n_draws = run%times%n_draws + 1
         run%times%drawing = run%times%drawing + wall_clock() - waited
         call run%schedule%block_of(cursor, number, n, first, last)
         waited = wall_clock()
         do i = first, last
            call run_unit(self, run, i, cursor%counter, summary, error)
            if (allocated(error)) exit
         end do
         if (first <= last) call cursor%note(last - first + 1, wall_clock() - waited)
      end do
      call report(run%counter, cursor%counter, run%progress, run%times)
      if (.not. allocated(error)) then
         waited = wall_clock()
         call run%results%flush(error)
         run%times%writing = run%times%writing + wall_clock() - waited
      end if
      if (allocated(error)) call run%ending%request_stop()
      waited = wall_clock()
      call barrier(comm)
      run%times%idle = wall_clock() - waited
      run%times%total = wall_clock() - started
      call run%counter%read_tallies(done, failed)
      call run%progress%finish(done, failed)
      call sum_up(summary, comm)
      call share_law_findings(run%source%law_findings, comm, summary)
      call find_inactive_laws(run%source%inactive_laws, size(self%model%system%laws), comm, summary)
      summary%n_points = self%plan%n_points
      summary%n_left = run%schedule%n_points - done - sum_over(comm, run%n_unused)
      summary%interruption = max_over(comm, run%ending%reason)
      if (.not. allocated(error)) call run%results%write_times(run%source%rank, run%times, error)
      call gather_rows(comm, run%times%as_row(), summary%times)
      call barrier(comm)
      call run%counter%destroy()
   end subroutine run_points

   !> What is wrong with user laws, on all ranks: that of the first rank that has found anything.
   subroutine share_law_findings(found, comm, summary)
      type(law_findings_t), intent(in) :: found                          !! by this rank
      type(comm_t), intent(in) :: comm
      type(run_summary_t), intent(inout) :: summary
      integer :: first

      first = -max_over(comm, merge(-rank_of(comm), -size_of(comm), n_advice(found%found) > 0))
      if (first == size_of(comm)) return
      if (n_advice(found%found) > 0) call describe_advice(found%found, summary%law_findings)
      call broadcast_text(comm, summary%law_findings, root=first)
   end subroutine share_law_findings

   !> Finds the laws that exert no force in any motion of the file; none if it has motions of other runs, or points whose motion
   !> was not found, which laws may have prevented.
   subroutine find_inactive_laws(found, n_laws, comm, summary)
      type(inactive_laws_t), intent(in) :: found                          !! by this rank
      integer, intent(in) :: n_laws
      type(comm_t), intent(in) :: comm
      type(run_summary_t), intent(inout) :: summary
      integer, parameter :: max_laws = 100                            ! a message of each
      logical :: acts(n_laws)
      integer :: i, n_lost

      n_lost = sum(summary%counts) - number_solved(summary) - &
               sum(summary%counts([outcome%pending, outcome%unused, outcome%collapsed]))
      acts = sum_over(comm, found%n_motions) < number_solved(summary) .or. n_laws > max_laws .or. n_lost > 0
      if (allocated(found%is_inactive)) then
         if (size(found%is_inactive) /= n_laws) acts = .true.
         if (.not. all(acts)) acts = acts .or. .not. (found%is_inactive .and. found%largest > 0.0_wp)
      end if
      allocate (summary%is_inactive(n_laws), source=.false.)
      if (n_laws > max_laws) return
      do i = 1, n_laws
         summary%is_inactive(i) = max_over(comm, merge(1, 0, acts(i))) == 0 .and. number_solved(summary) > 0
      end do
   end subroutine find_inactive_laws

   !> Solves the points of one unit in order, each from its neighbours if the input requests it, and writes them;
   !> returns early if the run must end.
   subroutine run_unit(self, run, unit, group, summary, error)
      type(study_t), intent(in) :: self
      type(run_t), intent(inout), target :: run
      integer, intent(in) :: unit
      integer, intent(in) :: group                                    !! of the counter, for the tallies
      type(run_summary_t), intent(inout) :: summary
      type(error_t), allocatable, intent(out) :: error
      type(neighbour_t) :: neighbour
      type(chain_check_t), allocatable :: check
      type(motion_result_t) :: result
      integer :: first, last, point

      call run%schedule%points_of(unit, first, last)
      if (allocated(self%plan%curve)) then
         call run_curve(self, run, first, last, group, summary, error)
         return
      end if
      if (run%is_checked) allocate (check)
      do point = first, last
         if (run%ending%is_due()) return
         if (any(run%before%crashed == point)) then                          ! of a chain that is solved again
            call pass_by(run, point, neighbour, summary)
            cycle
         end if
         call begin_point(point)
         call run_point(run%source, point, neighbour, check, run%times, result)
         call end_point()
         if (result%status == outcome%interrupted) return             ! pending in the file, for another run
         call store_point(self, run, point, result, group, summary, error)
         if (allocated(error)) return
      end do
   end subroutine run_unit

   !> Follows a curve, from its start or from the end of a previous run, and writes its points; returns early if the
   !> run must end. Unused rows are marked as such.
   subroutine run_curve(self, run, first, last, group, summary, error)
      type(study_t), intent(in) :: self
      type(run_t), intent(inout), target :: run
      integer, intent(in) :: first, last                              !! points
      integer, intent(in) :: group                                    !! of the counter, for the tallies
      type(run_summary_t), intent(inout) :: summary
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: failure
      type(neighbour_t) :: neighbour
      class(swept_curve_t), allocatable, target :: curve
      type(motion_result_t) :: result
      integer :: point
      logical :: is_report_due

      if (run%ending%is_due()) return
      allocate (curve)
      call new_swept_curve(curve, run%source, run%results, first, run%before%is_there, failure, error)
      if (allocated(error) .or. run%ending%verdict == verdict%interrupted) then
         call curve%destroy()
         return
      end if
      do point = first, first + size(curve%stored) - 1
         summary%counts(curve%stored(point - first + 1)) = summary%counts(curve%stored(point - first + 1)) + 1
         call run%progress%note(.not. has_answer(curve%stored(point - first + 1)), is_report_due)
      end do
      curve%law_findings%is_done = run%source%law_findings%is_done
      do while (point <= last .and. .not. curve%is_done)
         if (run%ending%is_due()) exit
         if (any(run%before%crashed == point)) then
            curve%is_done = .true.                                    ! the rest of the curve is unknown
            call pass_by(run, point, neighbour, summary)
         else
            call begin_point(point)
            call curve%next(run%source%layout, run%source%rank, result)
            call end_point()
            if (result%status == outcome%interrupted) exit            ! pending in the file, for another run
            call store_point(self, run, point, result, group, summary, error)
            if (allocated(error)) exit
         end if
         point = point + 1
      end do
      if (allocated(failure)) then
         call result%set_failure(failure)
         call store_point(self, run, point, result, group, summary, error)
         point = point + 1
      end if
      result = motion_result_t()
      result%status = outcome%unused
      if (curve%is_done) then
         do point = point, last
            if (allocated(error)) exit
            call store_point(self, run, point, result, group, summary, error)
         end do
      end if
      if (.not. run%source%law_findings%is_done) run%source%law_findings = curve%law_findings
      call run%source%inactive_laws%add(curve%inactive_laws)
      call curve%destroy()
   end subroutine run_curve

   !> Writes the result of a point, and counts it.
   subroutine store_point(self, run, point, result, group, summary, error)
      type(study_t), intent(in) :: self
      type(run_t), intent(inout) :: run
      integer, intent(in) :: point
      type(motion_result_t), intent(in) :: result
      integer, intent(in) :: group                                    !! of the counter, for the tallies
      type(run_summary_t), intent(inout) :: summary
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: started
      logical :: is_report_due

      call run%ending%note_point(result%solve_seconds)
      started = wall_clock()
      call run%results%write_point(point, result, error)
      if (allocated(error)) return
      call count_point(summary, point, result)
      run%times%n_points = run%times%n_points + 1
      run%times%writing = run%times%writing + wall_clock() - started
      if (run%progress%is_debug) call run%progress%report_point("point "//to_text(point - 1)//" on rank "// &
         to_text(run%source%rank)//": "//outcome_name(result%status)//", "//to_text(result%iterations)//" iterations, "// &
         self%plan%describe(point))
      if (result%status == outcome%unused) then
         run%n_unused = run%n_unused + 1
         return
      end if
      call run%progress%note(.not. has_answer(result%status), is_report_due)
      if (.not. is_report_due) return
      if (allocated(result%curve) .and. run%progress%is_due()) call run%progress%note_place(place_of(result%curve%parameter))
      call report(run%counter, group, run%progress, run%times)

   contains

      !> How far a curve is.
      function place_of(value) result(text)
         real(wp), intent(in) :: value
         character(:), allocatable :: text
         integer, parameter :: n_digits = 4

         associate (curve => self%plan%curve)
            text = "at "//to_text(rounded_to(value, n_digits))//" between "//to_text(curve%from)//" and "//to_text(curve%to)
         end associate
      end function place_of
   end subroutine store_point

   !> Counts a point that has crashed in a previous run and remains unchanged in the file; the next has no neighbour.
   subroutine pass_by(run, point, neighbour, summary)
      type(run_t), intent(inout) :: run
      integer, intent(in) :: point
      type(neighbour_t), intent(inout) :: neighbour
      type(run_summary_t), intent(inout) :: summary
      type(motion_result_t) :: result
      logical :: is_report_due

      result%status = outcome%crashed
      call count_point(summary, point, result)
      call run%progress%note(.true., is_report_due)
      call neighbour%forget()
   end subroutine pass_by

   !> Adds the points of this rank to the tallies, and shows those of all ranks if a line is due.
   subroutine report(counter, group, progress, times)
      type(work_counter_t), intent(in) :: counter
      integer, intent(in) :: group
      type(progress_t), intent(inout) :: progress
      type(rank_times_t), intent(inout) :: times
      real(wp) :: started
      integer :: done, failed

      started = wall_clock()
      call progress%report(done, failed)
      if (done > 0) call counter%add_done(group, done, failed)
      if (progress%is_due()) then
         call counter%read_tallies(done, failed)
         call progress%show(done, failed)
      end if
      times%drawing = times%drawing + wall_clock() - started
   end subroutine report
end module hb_sweep
