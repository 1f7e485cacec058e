!> Runs all points of an input over the ranks of a communicator and writes the result file.
!>
!> Points, or chains of points that start from each other's solutions, do not depend on each other; each rank draws the
!> next ones as hb_schedule says. What a point gives does not depend on who solves it or when, so the file holds the same
!> numbers for any number of ranks (with FFTW's planning by estimate, which is the default; measured plans may differ in the
!> last digit).
module hb_sweep
   use hb_certificate, only: choose_wider_set
   use hb_error, only: annotate, error_t, fail
   use hb_fftw, only: export_wisdom, import_wisdom
   use hb_harmonics, only: harmonics_t, merge_tuples
   use hb_kept_scene, only: kept_scene_t
   use hb_kinds, only: wp
   use hb_law_set, only: law_dofs_of
   use hb_mpi, only: barrier, comm_t, gather_rows, max_over, new_work_counter, rank_of, share_error, size_of, sum_over, &
      wall_clock, work_counter_t
   use hb_namelist, only: document_t, new_document
   use hb_neighbour, only: neighbour_t
   use hb_outcome, only: outcome, outcome_name, outcome_names
   use hb_point, only: solve_point
   use hb_progress, only: new_progress, progress_t
   use hb_results, only: create_results, point_result_t, results_layout_t, results_t
   use hb_results_plan, only: measure_row, new_plan, plan_t
   use hb_scene, only: group_names, read_harmonics, read_scene, read_tones, scene_t
   use hb_schedule, only: new_schedule, schedule_t, way_t
   use hb_sweep_plan, only: parameter_units, read_sweep_plan, sweep_plan_t
   use hb_swept_point, only: run_point
   use hb_text, only: lower, string_t, to_text
   use hb_timing, only: rank_times_t
   use hb_tones, only: tones_t
   use hb_version, only: git_commit, program_version
   implicit none
   private
   public :: apply_overrides, new_study, row_of_study, run_study, run_summary_t, study_t

   !> An input that was read without a problem, ready to run.
   type :: study_t
      type(document_t) :: document                                    !! the input after overrides
      type(sweep_plan_t) :: plan
      type(scene_t) :: scene                                          !! of the first point
      integer, allocatable :: tuples(:, :)                            !! union of the sets of all points, (n_tones, any)
      character(:), allocatable :: input_text                         !! the input as given
      character(:), allocatable :: input_complete                     !! the input after defaults
      real(wp) :: available_memory = huge(1.0_wp)                     !! bytes for this process
   end type study_t

   !> What a run came to, over all ranks.
   type :: run_summary_t
      integer :: n_points = 0
      integer :: counts(0:ubound(outcome_names, 1)) = 0               !! points of each status
      integer :: n_rescued = 0                                        !! points where the direct attempt failed, but others did not
      integer :: n_certified = 0                                      !! points with a certificate
      integer :: n_near_commensurate = 0
      real(wp) :: truncation = 0.0_wp                                 !! largest estimate of a certified point
      real(wp) :: aliasing = 0.0_wp
      real(wp) :: seconds = 0.0_wp
      real(wp), allocatable :: times(:, :)                            !! of all ranks, on rank 0, for hb_timing
   end type run_summary_t

contains

   !> Reads the text of an input file with its overrides; fails with all problems that the first point and the sweep show.
   subroutine new_study(self, file_name, text, overrides, error, available_memory)
      type(study_t), intent(out), target :: self
      character(*), intent(in) :: file_name                           !! for messages
      character(*), intent(in) :: text
      type(string_t), intent(in) :: overrides(:)                      !! path=value, as --set gives them
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: available_memory              !! bytes for this process, the same on all ranks
      type(document_t), target :: first

      if (present(available_memory)) self%available_memory = available_memory
      self%input_text = text
      call new_document(self%document, file_name, text, error)
      if (allocated(error)) return
      if (self%document%count("benchmark") > 0) then
         call fail(error, file_name//": has a group &benchmark; such an input is for 'nhbm benchmark'")
         return
      end if
      call self%document%expect_groups([group_names, "sweep      "], error)
      if (allocated(error)) return
      call apply_overrides(self%document, overrides, error)
      if (allocated(error)) return
      first = self%document
      call read_sweep_plan(self%plan, first, error)
      if (allocated(error)) return
      call self%plan%apply(1, first, error)
      if (allocated(error)) return
      call read_scene(self%scene, first, error, self%available_memory)
      if (allocated(error)) return
      self%input_complete = first%complete()
      call self%document%forget_values()                             ! nobody asks for the texts of single points
      call collect_tuples(self, error)
   end subroutine new_study

   !> Applies overrides in turn, each path=value.
   subroutine apply_overrides(document, overrides, error)
      type(document_t), intent(inout) :: document
      type(string_t), intent(in) :: overrides(:)
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      do i = 1, size(overrides)
         call apply_override(document, overrides(i)%value, error)
         if (allocated(error)) return
      end do
   end subroutine apply_overrides

   !> Applies one `path=value`.
   subroutine apply_override(document, text, error)
      type(document_t), intent(inout) :: document
      character(*), intent(in) :: text
      type(error_t), allocatable, intent(out) :: error
      integer :: equals

      equals = index(text, "=")
      if (equals < 2 .or. equals == len(text)) then
         call fail(error, "--set needs path=value, such as law(1)%gap=1.5e-3, not '"//text//"'")
         return
      end if
      call document%set(trim(adjustl(text(:equals - 1))), text(equals + 1:), error)
      call annotate(error, "--set")
   end subroutine apply_override

   !> Union of the harmonic sets of all points, so that the file can be laid out before any is solved. Only points that
   !> differ in a swept key of `&harmonics` have to be read.
   subroutine collect_tuples(self, error)
      type(study_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error
      type(document_t), target :: document
      type(tones_t) :: tones
      type(harmonics_t) :: harmonics
      character(:), allocatable :: seen, key
      integer :: i, point

      self%tuples = self%scene%harmonics%tuples
      call merge_wider_set(self, self%scene%harmonics, error)
      if (allocated(error)) return
      if (.not. any([(is_harmonic_path(self%plan%parameters(i)%path), i=1, size(self%plan%parameters))])) return
      seen = ";"
      do point = 1, self%plan%n_points
         key = ""
         do i = 1, size(self%plan%parameters)
            if (is_harmonic_path(self%plan%parameters(i)%path)) key = key//to_text(self%plan%index_on(i, point))//","
         end do
         if (index(seen, ";"//key//";") > 0) cycle
         seen = seen//key//";"
         document = self%document
         call self%plan%apply(point, document, error)
         if (allocated(error)) return
         call read_tones(tones, document, error)
         if (.not. allocated(error)) call read_harmonics(harmonics, document, tones%n_tones, error)
         if (allocated(error)) then
            call annotate(error, "point "//to_text(point)//" of the sweep")
            return
         end if
         if (tones%n_tones /= size(self%tuples, 1)) then
            call fail(error, "all points of a sweep need the same number of tones")
            return
         end if
         call merge_tuples(self%tuples, harmonics)
         call merge_wider_set(self, harmonics, error)
         if (allocated(error)) return
      end do
   end subroutine collect_tuples

   !> Adds the tuples that an improved motion has beyond those of its set.
   subroutine merge_wider_set(self, harmonics, error)
      type(study_t), intent(inout) :: self
      type(harmonics_t), intent(in) :: harmonics
      type(error_t), allocatable, intent(out) :: error
      type(harmonics_t) :: wider

      if (.not. has_improved(self)) return
      call choose_wider_set(harmonics, wider, error)
      if (.not. allocated(error)) call merge_tuples(self%tuples, wider)
   end subroutine merge_wider_set

   !> Whether improved motions are stored: the first point decides for all.
   pure logical function has_improved(self)
      type(study_t), intent(in) :: self

      has_improved = self%scene%certificate%is_on .and. self%scene%certificate%improvement_steps > 0
   end function has_improved

   !> Whether a swept path is a key of `&harmonics`; names of groups stand in either case, with blanks before.
   logical function is_harmonic_path(path)
      character(*), intent(in) :: path

      is_harmonic_path = index(lower(adjustl(path)), "harmonics") == 1
   end function is_harmonic_path

   !> Solves all points and writes them; collective. An error is trouble with the result file; what is wrong with a single
   !> point stands in the file.
   subroutine run_study(self, path, overwrite, level, comm, summary, error)
      type(study_t), intent(in) :: self
      character(*), intent(in) :: path                                !! of the result file
      logical, intent(in) :: overwrite                                !! an existing file may be replaced
      integer, intent(in) :: level                                    !! how much to tell, hb_progress
      type(comm_t), intent(in) :: comm
      type(run_summary_t), intent(out) :: summary
      type(error_t), allocatable, intent(out) :: error
      type(results_t) :: results
      type(results_layout_t) :: layout
      real(wp) :: started

      started = wall_clock()
      call prepare_wisdom(self, comm, error)
      if (allocated(error)) return
      call describe_layout(self, size_of(comm), layout)
      call create_results(results, path, layout, overwrite, comm, error)
      if (allocated(error)) return
      call run_points(self, layout, results, level, comm, summary, error)
      call share_error(comm, error)
      if (allocated(error)) return
      call results%close(error)
      summary%seconds = wall_clock() - started
   end subroutine run_study

   !> Gives all ranks the same wisdom: rank 0 reads the file or plans once and writes it, then the others read it.
   subroutine prepare_wisdom(self, comm, error)
      type(study_t), intent(in) :: self
      type(comm_t), intent(in) :: comm
      type(error_t), allocatable, intent(out) :: error
      type(point_result_t) :: trial

      if (.not. allocated(self%scene%wisdom)) return
      if (rank_of(comm) == 0) then
         if (.not. import_wisdom(self%scene%wisdom)) then
            call solve_point(self%scene, trial, error)                ! plans every transform of the first point
            if (allocated(error)) deallocate (error)                  ! told again when the point is solved
            if (.not. export_wisdom(self%scene%wisdom)) then
               call fail(error, "&sampling: wisdom: cannot write '"//self%scene%wisdom//"'; give a path in a writable folder")
            end if
         end if
      end if
      call share_error(comm, error)
      if (allocated(error)) return
      call barrier(comm)
      if (rank_of(comm) > 0 .and. .not. import_wisdom(self%scene%wisdom)) then
         call fail(error, "&sampling: wisdom: rank "//to_text(rank_of(comm))//" cannot read '"//self%scene%wisdom//"'")
      end if
      call share_error(comm, error)
   end subroutine prepare_wisdom

   subroutine describe_layout(self, n_ranks, layout)
      type(study_t), intent(in) :: self
      integer, intent(in) :: n_ranks
      type(results_layout_t), intent(out) :: layout
      integer, allocatable :: law_dofs(:)
      integer :: i, k

      associate (scene => self%scene, structure => self%scene%structure, plan => self%plan)
         law_dofs = law_dofs_of(scene%laws)
         layout%n_points = plan%n_points
         layout%tuples = self%tuples
         layout%dof_labels = structure%labels(scene%output%dofs)
         layout%dof_units = [character(16) :: structure%units(scene%output%dofs)]
         layout%law_dof_labels = structure%labels(law_dofs)
         layout%law_labels = unique_labels(scene)
         layout%law_dof_units = [character(16) :: structure%units(law_dofs)]
         layout%n_samples = scene%output%samples
         layout%has_improved = has_improved(self)
         layout%title = scene%output%title
         layout%input_text = self%input_text
         layout%input_complete = self%input_complete
         layout%n_ranks = n_ranks
         layout%program_version = program_version
         layout%git_commit = git_commit
         allocate (layout%parameters(size(plan%parameters)))
         do i = 1, size(plan%parameters)
            layout%parameters(i)%path = plan%parameters(i)%path
            layout%parameters(i)%units = parameter_units(plan%parameters(i)%path)
            layout%parameters(i)%is_text = plan%parameters(i)%is_text
            if (plan%parameters(i)%is_text) then
               allocate (layout%parameters(i)%text_values(plan%n_points))
               do k = 1, plan%n_points
                  layout%parameters(i)%text_values(k) = plan%parameters(i)%texts(plan%index_on(i, k))%value
               end do
            else
               layout%parameters(i)%values = [(plan%parameters(i)%values(plan%index_on(i, k)), k=1, plan%n_points)]
            end if
         end do
      end associate
   end subroutine describe_layout

   !> What one point takes in the result file, and to how many datasets it is written.
   subroutine row_of_study(self, n_bytes, n_datasets)
      type(study_t), intent(in) :: self
      real(wp), intent(out) :: n_bytes
      integer, intent(out) :: n_datasets
      type(results_layout_t) :: layout
      type(plan_t) :: plan

      call describe_layout(self, 1, layout)
      call new_plan(plan, layout)
      call measure_row(plan, size(layout%parameters), n_bytes, n_datasets)
   end subroutine row_of_study

   !> Labels of the laws; where two laws have the same, the number of the law is added.
   function unique_labels(scene) result(labels)
      type(scene_t), intent(in) :: scene
      character(64) :: labels(size(scene%laws))
      integer :: i

      do i = 1, size(labels)
         labels(i) = scene%laws(i)%law%label
         if (any(labels(:i - 1) == labels(i))) labels(i) = trim(labels(i))//" "//to_text(i)
      end do
   end function unique_labels

   !> How the points are handed out: chains along the fastest parameter where points start from their neighbours.
   subroutine schedule_study(self, n_ranks, block_seconds, schedule)
      type(study_t), intent(in) :: self
      integer, intent(in) :: n_ranks
      real(wp), intent(in) :: block_seconds
      type(schedule_t), intent(out) :: schedule

      call new_schedule(schedule, self%plan%n_points, self%plan%n_fastest(), &
         merge(self%scene%chain%length, 1, self%scene%chain%is_on), n_ranks, block_seconds)
   end subroutine schedule_study

   !> Draws blocks of points until there are none left. Rank 0 tells the progress of all.
   subroutine run_points(self, layout, results, level, comm, summary, error)
      type(study_t), intent(in) :: self
      type(results_layout_t), intent(in) :: layout
      type(results_t), intent(inout) :: results
      integer, intent(in) :: level
      type(comm_t), intent(in) :: comm
      type(run_summary_t), intent(out) :: summary
      type(error_t), allocatable, intent(out) :: error
      type(schedule_t) :: schedule
      type(way_t) :: way
      type(work_counter_t) :: counter
      type(kept_scene_t) :: kept
      type(progress_t) :: progress
      type(rank_times_t) :: times
      real(wp) :: started, waited
      integer :: done, failed, first, i, last, n, number

      call schedule_study(self, size_of(comm), results%hold_seconds(), schedule)
      call new_work_counter(counter, [(schedule%owner_of(i), i=1, schedule%n_counters)], comm, error)
      if (allocated(error)) return
      call new_progress(progress, layout%n_points, level, rank_of(comm) == 0)
      way = schedule%way_of(rank_of(comm))
      started = wall_clock()
      do while (.not. (way%is_done .or. allocated(error)))
         waited = wall_clock()
         n = schedule%ask(way)
         number = counter%next(way%counter, n)
         times%n_draws = times%n_draws + 1
         times%drawing = times%drawing + wall_clock() - waited
         call schedule%take(way, number, n, first, last)
         waited = wall_clock()
         do i = first, last
            call run_unit(self, layout, schedule, i, rank_of(comm), results, counter, way%counter, kept, progress, summary, &
               times, error)
            if (allocated(error)) exit
         end do
         if (first <= last) call way%note(last - first + 1, wall_clock() - waited)
      end do
      call report(counter, way%counter, progress, times)
      if (.not. allocated(error)) then
         waited = wall_clock()
         call results%flush(error)
         times%writing = times%writing + wall_clock() - waited
      end if
      waited = wall_clock()
      call barrier(comm)
      times%idle = wall_clock() - waited
      times%total = wall_clock() - started
      call counter%read_tallies(done, failed)
      call progress%finish(done, failed)
      call sum_up(summary, comm)
      summary%n_points = layout%n_points
      if (.not. allocated(error)) call results%write_times(rank_of(comm), times, error)
      call gather_rows(comm, times%as_row(), summary%times)
      call barrier(comm)
      call counter%destroy()
   end subroutine run_points

   !> Solves the points of one unit in their order, each from its neighbours where the input asks for that, and writes them.
   subroutine run_unit(self, layout, schedule, unit, rank, results, counter, group, kept, progress, summary, times, error)
      type(study_t), intent(in) :: self
      type(results_layout_t), intent(in) :: layout
      type(schedule_t), intent(in) :: schedule
      integer, intent(in) :: unit, rank
      type(results_t), intent(inout) :: results
      type(work_counter_t), intent(in) :: counter
      integer, intent(in) :: group                                    !! of the counter, for the tallies
      type(kept_scene_t), intent(inout) :: kept
      type(progress_t), intent(inout) :: progress
      type(run_summary_t), intent(inout) :: summary
      type(rank_times_t), intent(inout) :: times
      type(error_t), allocatable, intent(out) :: error
      type(neighbour_t) :: neighbour
      type(point_result_t) :: result
      real(wp) :: started
      integer :: first, last, point
      logical :: is_report_due

      call schedule%points_of(unit, first, last)
      do point = first, last
         call run_point(self%document, self%available_memory, self%plan, layout, point, rank, kept, neighbour, times, result)
         started = wall_clock()
         call results%write_point(point, result, error)
         if (allocated(error)) return
         call count_point(summary, result)
         times%n_points = times%n_points + 1
         times%writing = times%writing + wall_clock() - started
         if (progress%is_debug) call progress%tell_point("point "//to_text(point - 1)//" on rank "//to_text(rank)//": "// &
            outcome_name(result%status)//", "//to_text(result%iterations)//" iterations, "//self%plan%describe(point))
         call progress%note(result%status /= outcome%converged, is_report_due)
         if (is_report_due) call report(counter, group, progress, times)
      end do
   end subroutine run_unit

   !> Adds the points of this rank to the tallies, and shows those of all ranks where it is time for that.
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

   subroutine count_point(summary, result)
      type(run_summary_t), intent(inout) :: summary
      type(point_result_t), intent(in) :: result

      summary%counts(result%status) = summary%counts(result%status) + 1
      if (result%rescue > 0) summary%n_rescued = summary%n_rescued + 1
      if (allocated(result%certificate%combination)) summary%n_certified = summary%n_certified + 1
      if (result%is_near_commensurate) summary%n_near_commensurate = summary%n_near_commensurate + 1
      summary%truncation = max(summary%truncation, result%certificate%truncation)
      summary%aliasing = max(summary%aliasing, result%certificate%aliasing)
   end subroutine count_point

   !> Turns what each rank counted into what all ranks did.
   subroutine sum_up(summary, comm)
      type(run_summary_t), intent(inout) :: summary
      type(comm_t), intent(in) :: comm
      integer :: status

      do status = lbound(summary%counts, 1), ubound(summary%counts, 1)
         summary%counts(status) = sum_over(comm, summary%counts(status))
      end do
      summary%n_rescued = sum_over(comm, summary%n_rescued)
      summary%n_certified = sum_over(comm, summary%n_certified)
      summary%n_near_commensurate = sum_over(comm, summary%n_near_commensurate)
      summary%truncation = max_over(comm, summary%truncation)
      summary%aliasing = max_over(comm, summary%aliasing)
   end subroutine sum_up
end module hb_sweep
