!> Runs all points of an input over the ranks of a communicator and writes the result file.
!>
!> Points do not depend on each other; each rank takes the next one from a shared counter. What a point gives does not
!> depend on who solves it or when, so the file holds the same numbers for any number of ranks (with FFTW's planning by
!> estimate, which is the default; measured plans may differ in the last digit).
module hb_sweep
   use hb_certificate, only: choose_wider_set
   use hb_error, only: annotate, error_t, fail
   use hb_fftw, only: export_wisdom, import_wisdom
   use hb_harmonics, only: harmonics_t, merge_tuples
   use hb_kinds, only: wp
   use hb_law_set, only: law_dofs_of
   use hb_mpi, only: barrier, comm_t, max_over, new_work_counter, rank_of, share_error, size_of, sum_over, wall_clock, &
      work_counter_t
   use hb_namelist, only: document_t, new_document
   use hb_outcome, only: outcome, outcome_names
   use hb_point, only: solve_point
   use hb_progress, only: new_progress, progress_t
   use hb_results, only: create_results, point_result_t, results_layout_t, results_t
   use hb_scene, only: group_names, read_harmonics, read_scene, read_tones, scene_t
   use hb_sweep_plan, only: parameter_units, read_sweep_plan, sweep_plan_t
   use hb_text, only: lower, string_t, to_text
   use hb_tones, only: tones_t
   use hb_version, only: git_commit, program_version
   implicit none
   private
   public :: apply_overrides, new_study, run_study, run_summary_t, study_t

   !> An input that was read without a problem, ready to run.
   type :: study_t
      type(document_t) :: document                                    !! the input after overrides
      type(sweep_plan_t) :: plan
      type(scene_t) :: scene                                          !! of the first point
      integer, allocatable :: tuples(:, :)                            !! union of the sets of all points, (n_tones, any)
      character(:), allocatable :: input_text                         !! the input as given
      character(:), allocatable :: input_complete                     !! the input after defaults
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
   end type run_summary_t

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
      call read_scene(self%scene, first, error)
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
   subroutine run_study(self, path, overwrite, is_quiet, comm, summary, error)
      type(study_t), intent(in) :: self
      character(*), intent(in) :: path                                !! of the result file
      logical, intent(in) :: overwrite                                !! an existing file may be replaced
      logical, intent(in) :: is_quiet                                 !! no progress
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
      call run_points(self, layout, results, is_quiet, comm, summary, error)
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
   subroutine run_points(self, layout, results, is_quiet, comm, summary, error)
      type(study_t), intent(in) :: self
      type(results_layout_t), intent(in) :: layout
      type(results_t), intent(inout) :: results
      logical, intent(in) :: is_quiet
      type(comm_t), intent(in) :: comm
      type(run_summary_t), intent(out) :: summary
      type(error_t), allocatable, intent(out) :: error
      type(work_counter_t) :: counter
      type(progress_t) :: progress
      type(point_result_t) :: result
      integer :: done, failed, point

      call new_work_counter(counter, comm, error)
      if (allocated(error)) return
      call new_progress(progress, layout%n_points, is_quiet .or. rank_of(comm) > 0)
      do
         point = counter%next() + 1
         if (point > layout%n_points) exit
         call run_point(self, layout, point, rank_of(comm), result)
         call results%write_point(point, result, error)
         if (allocated(error)) exit
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
      call barrier(comm)
      call counter%destroy()
   end subroutine run_points

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
         if (.not. layout%has_improved .and. allocated(result%improved_coefficients)) deallocate (result%improved_coefficients)
         call spread_harmonics(result%certificate%wider, layout%tuples, result%improved_coefficients)
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
