!> Runs all points of an input over the ranks of a communicator and writes the result file.
!>
!> Points do not depend on each other; each rank takes the next one from a shared counter. What a point gives does not
!> depend on who solves it or when, so the file holds the same numbers for any number of ranks (with FFTW's planning by
!> estimate, which is the default; measured plans may differ in the last digit).
module hb_sweep
   use hb_error, only: annotate, error_t, fail
   use hb_fftw, only: export_wisdom, import_wisdom
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_law_set, only: law_dofs_of
   use hb_interruption, only: interruption_t, new_interruption
   use hb_mpi, only: barrier, comm_t, max_over, new_work_counter, rank_of, share_error, size_of, wall_clock, &
      work_counter_t
   use hb_namelist, only: document_t, new_document
   use hb_outcome, only: outcome
   use hb_point, only: solve_point
   use hb_progress, only: new_progress, progress_t
   use hb_results, only: create_results, open_results, point_result_t, results_layout_t, results_t
   use hb_resume, only: choose_points, resumed_input_t
   use hb_run_summary, only: count_point, run_summary_t, sum_up
   use hb_scene, only: group_names, read_harmonics, read_scene, read_tones, scene_t
   use hb_sweep_plan, only: parameter_units, read_sweep_plan, sweep_plan_t
   use hb_text, only: join, lower, string_t, to_text
   use hb_tones, only: tones_t
   use hb_version, only: git_commit, program_version
   implicit none
   private
   public :: new_study, read_input, run_options_t, run_study, study_t

   !> An input that was read without a problem, ready to run.
   type :: study_t
      type(document_t) :: document                                    !! the input after overrides
      type(sweep_plan_t) :: plan
      type(scene_t) :: scene                                          !! of the first point
      integer, allocatable :: tuples(:, :)                            !! union of the sets of all points, (n_tones, any)
      character(:), allocatable :: input_text                         !! the input as given
      character(:), allocatable :: input_overrides                    !! path=value, a line each
      character(:), allocatable :: input_complete                     !! the input after defaults
   end type study_t

   !> How to run a study.
   type :: run_options_t
      character(:), allocatable :: path                               !! of the result file
      logical :: overwrite = .false.                                  !! an existing file may be replaced
      logical :: resumes = .false.                                    !! an existing file is gone on with
      logical :: retries = .false.                                    !! ... and its points that did not converge are solved again
      logical :: is_quiet = .false.                                   !! no progress
      real(wp) :: time_limit = huge(1.0_wp)                           !! [s] of wall time
   end type run_options_t

contains

   !> Reads the text of an input file with its overrides; fails with all problems that the first point and the sweep show.
   subroutine new_study(self, file_name, text, overrides, error)
      type(study_t), intent(out), target :: self
      character(*), intent(in) :: file_name                           !! for messages
      character(*), intent(in) :: text
      type(string_t), intent(in) :: overrides(:)                      !! path=value, as --set gives them
      type(error_t), allocatable, intent(out) :: error
      type(document_t), target :: first

      self%input_text = text
      self%input_overrides = join(overrides, new_line("a"))
      call read_input(self%document, file_name, text, overrides, error)
      if (allocated(error)) return
      first = self%document
      call read_sweep_plan(self%plan, first, error)
      if (allocated(error)) return
      call self%plan%apply(1, first, error)
      if (allocated(error)) return
      call read_scene(self%scene, first, error)
      if (allocated(error)) return
      self%input_complete = first%complete()
      call self%document%forget_values()                             ! nobody asks for the texts of single points
      call collect_tuples(self, error)
   end subroutine new_study

   !> Takes the text of an input file apart and applies its overrides.
   subroutine read_input(document, file_name, text, overrides, error)
      type(document_t), intent(out) :: document
      character(*), intent(in) :: file_name                           !! for messages
      character(*), intent(in) :: text
      type(string_t), intent(in) :: overrides(:)                      !! path=value
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      call new_document(document, file_name, text, error)
      if (.not. allocated(error)) call document%expect_groups([group_names, "sweep      "], error)
      do i = 1, size(overrides)
         if (allocated(error)) return
         call apply_override(document, overrides(i)%value, error)
      end do
   end subroutine read_input

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
      else if (index(text, new_line("a")) > 0) then
         call fail(error, "--set needs path=value in one line")
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
      end do
   end subroutine collect_tuples

   !> Whether a swept path is a key of `&harmonics`; names of groups stand in either case, with blanks before.
   logical function is_harmonic_path(path)
      character(*), intent(in) :: path

      is_harmonic_path = index(lower(adjustl(path)), "harmonics") == 1
   end function is_harmonic_path

   !> Adds what the set has and the list lacks. The list grows to hold the largest set first where sets are nested.
   subroutine merge_tuples(tuples, harmonics)
      integer, allocatable, intent(inout) :: tuples(:, :)
      type(harmonics_t), intent(in) :: harmonics
      logical :: is_known(harmonics%n_harmonics)
      integer, allocatable :: longer(:, :)
      integer :: h, i, n_new

      is_known = .false.
      do i = 1, size(tuples, 2)
         h = harmonics%index_of(tuples(:, i))
         if (h > 0) is_known(h) = .true.
      end do
      n_new = count(.not. is_known)
      if (n_new == 0) return
      allocate (longer(size(tuples, 1), size(tuples, 2) + n_new))
      longer(:, 1:size(tuples, 2)) = tuples
      i = size(tuples, 2)
      do h = 1, harmonics%n_harmonics
         if (is_known(h)) cycle
         i = i + 1
         longer(:, i) = harmonics%tuples(:, h)
      end do
      call move_alloc(longer, tuples)
   end subroutine merge_tuples

   !> Solves all points, or those that a run before has left, and writes them; collective. An error is trouble with the
   !> result file; what is wrong with a single point stands in the file.
   subroutine run_study(self, options, comm, summary, error)
      type(study_t), intent(in) :: self
      type(run_options_t), intent(in) :: options
      type(comm_t), intent(in) :: comm
      type(run_summary_t), intent(out) :: summary
      type(error_t), allocatable, intent(out) :: error
      type(results_t) :: results
      type(results_layout_t) :: layout
      type(interruption_t) :: ending
      type(resumed_input_t) :: input
      type(error_t), allocatable :: error_in_close
      integer, allocatable :: points(:)
      real(wp) :: started

      started = wall_clock()
      call prepare_wisdom(self, comm, error)
      if (allocated(error)) return
      call describe_layout(self, size_of(comm), layout)
      if (options%resumes) then
         input%complete = self%input_complete
         input%tuples = self%tuples
         input%n_points = layout%n_points
         call choose_points(options%path, input, options%retries, comm, points, summary, error)
         if (allocated(error)) return
      end if
      if (allocated(points)) then
         call open_results(results, options%path, layout, comm, error)
      else
         points = all_numbers(layout%n_points)
         call create_results(results, options%path, layout, options%overwrite, comm, error)
      end if
      if (allocated(error)) return
      call new_interruption(ending, options%time_limit - (wall_clock() - started), comm, error)
      if (allocated(error)) return
      call run_points(self, layout, points, results, options%is_quiet, comm, ending, summary, error)
      call share_error(comm, error)
      call results%close(error_in_close)
      if (.not. allocated(error)) call move_alloc(error_in_close, error)
      call ending%destroy()
      summary%seconds = wall_clock() - started
   end subroutine run_study

   pure function all_numbers(n)
      integer, intent(in) :: n
      integer, allocatable :: all_numbers(:)
      integer :: i

      all_numbers = [(i, i=1, n)]
   end function all_numbers

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
         layout%title = scene%output%title
         layout%input_name = self%document%file_name
         layout%input_text = self%input_text
         layout%input_overrides = self%input_overrides
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

   !> Takes points from the shared counter until there are none left. Rank 0 tells the progress of all.
   subroutine run_points(self, layout, points, results, is_quiet, comm, ending, summary, error)
      type(study_t), intent(in) :: self
      type(results_layout_t), intent(in) :: layout
      integer, intent(in) :: points(:)                                !! to solve, from 1; the same on all ranks
      type(results_t), intent(inout) :: results
      logical, intent(in) :: is_quiet
      type(comm_t), intent(in) :: comm
      type(interruption_t), intent(inout) :: ending
      type(run_summary_t), intent(inout) :: summary
      type(error_t), allocatable, intent(out) :: error
      type(work_counter_t) :: counter
      type(progress_t) :: progress
      type(point_result_t) :: result
      integer :: done, failed, next

      call new_work_counter(counter, comm, error)
      if (allocated(error)) return
      call new_progress(progress, size(points), is_quiet .or. rank_of(comm) > 0)
      do
         next = counter%next() + 1
         if (next > size(points)) exit
         if (ending%is_due()) exit
         call run_point(self, layout, points(next), rank_of(comm), result)
         call results%write_point(points(next), result, error)
         if (allocated(error)) then
            call ending%ask_all()
            exit
         end if
         call ending%note_point(result%solve_seconds)
         call count_point(summary, result)
         call counter%add_done(result%status /= outcome%converged)
         call counter%read_tallies(done, failed)
         call progress%show(done, failed)
      end do
      call barrier(comm)
      call counter%read_tallies(done, failed)
      call progress%finish(done, failed)
      call sum_up(summary, comm)
      summary%n_points = layout%n_points
      summary%n_left = size(points) - done
      summary%interruption = max_over(comm, ending%reason)
      call barrier(comm)
      call counter%destroy()
   end subroutine run_points

   !> Solves one point; whatever goes wrong becomes its status and message.
   subroutine run_point(self, layout, point, rank, result)
      type(study_t), intent(in) :: self
      type(results_layout_t), intent(in) :: layout
      integer, intent(in) :: point, rank
      type(point_result_t), intent(out) :: result
      type(document_t), target :: document
      type(scene_t) :: scene
      type(error_t), allocatable :: error
      real(wp) :: started

      started = wall_clock()
      document = self%document
      call self%plan%apply(point, document, error)
      if (.not. allocated(error)) call read_scene(scene, document, error)
      if (.not. allocated(error)) call check_layout(scene, layout, error)
      if (.not. allocated(error)) call solve_point(scene, result, error)
      if (allocated(error)) then
         result%status = outcome%failed
         result%message = error%message
      else
         call spread_harmonics(scene%harmonics, layout%tuples, result%coefficients)
         call spread_harmonics(scene%harmonics, layout%tuples, result%force_coefficients)
         call spread_harmonics(scene%harmonics, layout%tuples, result%corrected_coefficients)
      end if
      result%rank = rank
      result%solve_seconds = wall_clock() - started
   end subroutine run_point

   !> A file holds one list of degrees of freedom: refuses a point whose structure or laws have others.
   subroutine check_layout(scene, layout, error)
      type(scene_t), intent(in) :: scene
      type(results_layout_t), intent(in) :: layout
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: law_dofs(:)
      logical :: is_same

      law_dofs = law_dofs_of(scene%laws)
      is_same = size(scene%output%dofs) == size(layout%dof_labels) .and. size(law_dofs) == size(layout%law_dof_labels) &
                .and. size(scene%laws) == size(layout%law_labels) &
                .and. size(scene%output%samples) == size(layout%n_samples)
      if (is_same) then
         is_same = all(scene%structure%labels(scene%output%dofs) == layout%dof_labels) .and. &
                   all(scene%structure%labels(law_dofs) == layout%law_dof_labels) .and. &
                   all(scene%output%samples == layout%n_samples)
      end if
      if (.not. is_same) call fail(error, "this point has other degrees of freedom or surfaces than the first point; "// &
                                   "list the common ones in &output dofs, or run it by itself")
   end subroutine check_layout

   !> Puts coefficients of a point's own set onto the harmonics of the file; those that the point lacks become NaN.
   subroutine spread_harmonics(harmonics, tuples, coefficients)
      type(harmonics_t), intent(in) :: harmonics
      integer, intent(in) :: tuples(:, :)
      real(wp), allocatable, intent(inout) :: coefficients(:, :, :)   !! (2, n_harmonics, any)
      real(wp), allocatable :: all_harmonics(:, :, :)
      integer :: h, i

      if (.not. allocated(coefficients)) return
      allocate (all_harmonics(2, size(tuples, 2), size(coefficients, 3)))
      do i = 1, size(tuples, 2)
         h = harmonics%index_of(tuples(:, i))
         if (h > 0) then
            all_harmonics(:, i, :) = coefficients(:, h, :)
         else
            all_harmonics(:, i, :) = ieee_value_nan()
         end if
      end do
      call move_alloc(all_harmonics, coefficients)
   end subroutine spread_harmonics

   pure real(wp) function ieee_value_nan()
      use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value

      ieee_value_nan = ieee_value(1.0_wp, ieee_quiet_nan)
   end function ieee_value_nan
end module hb_sweep
