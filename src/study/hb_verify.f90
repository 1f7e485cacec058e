!> Time integration from the points of a result file (hb_verification), written to the same file.
module hb_verify
   use hb_claim, only: claim_t
   use hb_curve_table, only: note_curve_values
   use hb_document, only: document_t
   use hb_error, only: annotate, error_t, fail
   use hb_hdf5, only: h5_dataset_t, h5_file_t, open_file, open_file_parallel
   use hb_integration_verdict, only: verdict, verdict_t
   use hb_interruption, only: interruption, new_interruption
   use hb_kinds, only: wp
   use hb_model, only: model_t
   use hb_model_reader, only: read_model
   use hb_movement, only: follow_frequencies
   use hb_mpi, only: barrier, comm_t, max_over, new_work_counter, rank_of, share_error, size_of, work_counter_t
   use hb_named_files, only: are_same_files
   use hb_options, only: purpose_t
   use hb_outcome, only: is_integrated, is_solved
   use hb_progress, only: log_level, new_progress, progress_t
   use hb_results_record, only: read_record, record_t, reject_damaged_rows
   use hb_run_callbacks, only: run_callbacks
   use hb_signals, only: wait_for_points
   use hb_stored_rows, only: stored_file_t
   use hb_study, only: new_study, study_t
   use hb_text, only: string_t, to_text
   use hb_verification, only: verify_motion
   use hb_watched_interruption, only: watched_t
   implicit none
   private
   public :: unverified_t, verification_options_t, verify_points

   !> How to verify points.
   type :: verification_options_t
      real(wp) :: time_limit = huge(1.0_wp)                           !! [s] of wall time
      integer :: level = log_level%quiet                              !! log level, hb_progress
   end type verification_options_t

   !> What a run that has ended early has not verified.
   type :: unverified_t
      integer, allocatable :: points(:)                               !! of this rank, from 1
      integer :: interruption = interruption%none                     !! why, hb_interruption; the same on all ranks
   end type unverified_t

   !> An interruption that shows the progress whenever it is examined: integrations examine it at each step.
   type, extends(watched_t) :: watched_integration_t
      real(wp), private :: share = 0.0_wp                             ! of the present point which is done
   contains
      procedure :: wants_end => watched_integration_wants_end
      procedure :: note_progress => watched_integration_note_progress
   end type watched_integration_t

   !> The data read from a result file in addition to its record.
   type, extends(record_t) :: stored_t
      type(study_t) :: study
      real(wp), allocatable :: frequency_estimates(:, :)              !! [rad/s], as frequency
      real(wp), allocatable :: coefficients(:, :, :, :)               !! (2, n_harmonics, n_dofs, n_points)
      integer, allocatable :: own_tuples(:, :, :)                 !! (n_tones, n_harmonics, n_points), if points have their own
      integer, allocatable :: n_harmonics(:)                          !! their numbers (n_points)
      real(wp), allocatable :: estimates(:)                           !! sum of the estimates of truncation and aliasing, (n_points)
   end type stored_t

contains

   !> Integrates from points of a result file and writes the verdicts to it. The points are distributed over the
   !> ranks. A point that a signal or a time limit ends has no verdict; those of the points before are written.
   subroutine verify_points(path, points, n_periods, comm, verdicts, error, options, unverified)
      character(*), intent(in) :: path
      integer, intent(in) :: points(:)                                !! from 0; empty: all. Unsolved points are skipped
      integer, intent(in) :: n_periods                                !! of the slowest tone, at most; 0: from the decay
      type(comm_t), intent(in) :: comm
      type(verdict_t), allocatable, intent(out) :: verdicts(:)        !! (n_points), of the points of this rank
      type(error_t), allocatable, intent(out) :: error
      type(verification_options_t), intent(in), optional :: options   !! default: no time limit, nothing is shown
      type(unverified_t), intent(out), optional :: unverified         !! points without a verdict
      type(verification_options_t) :: how
      type(watched_integration_t), target :: ending
      type(progress_t), target :: progress
      type(work_counter_t), target :: counter
      type(stored_t) :: stored
      type(h5_file_t) :: file
      logical, allocatable :: is_wanted(:)
      integer, allocatable :: left(:)
      integer :: i

      if (present(options)) how = options
      call read_stored(path, stored, error)
      if (.not. allocated(error)) call check_points(path, stored, points, error)
      if (.not. allocated(error)) call reject_damaged_rows(path, stored%status, points, error)
      call share_error(comm, error)
      if (allocated(error)) return
      allocate (verdicts(size(stored%status)))
      is_wanted = [(size(points) == 0 .or. any(points == i - 1), i=1, size(verdicts))]
      if (rank_of(comm) == 0) verdicts%skipped_status = merge(stored%status, 0, is_wanted .and. .not. is_solved(stored%status))
      is_wanted = is_wanted .and. is_solved(stored%status)
      call new_work_counter(counter, [0], comm, error)
      if (.not. allocated(error)) call new_interruption(ending%interruption_t, how%time_limit, comm, error)
      call share_error(comm, error)
      if (allocated(error)) return
      call new_progress(progress, count(is_wanted), how%level, rank_of(comm) == 0)
      ending%progress => progress
      ending%counter => counter
      call wait_for_points()
      call ending%enter(huge(1.0_wp))
      call verify_share(stored, pack([(i, i=1, size(verdicts))], is_wanted), n_periods, comm, ending, verdicts, left, error)
      call ending%leave()
      call finish_progress(progress, counter, comm)
      call ending%destroy()
      call counter%destroy()
      if (present(unverified)) unverified = unverified_t(left, max_over(comm, ending%reason))
      call share_error(comm, error)
      if (allocated(error)) return
      call open_file_parallel(file, path, comm, error)
      call share_error(comm, error)
      if (allocated(error)) return
      call write_verdicts(file, verdicts, error)
      call file%close(error)
      call share_error(comm, error)
   end subroutine verify_points

   !> Integrates from those of some points that belong to this rank.
   subroutine verify_share(stored, points, n_periods, comm, ending, verdicts, left, error)
      type(stored_t), intent(in) :: stored
      integer, intent(in) :: points(:)                                !! of all ranks, from 1
      integer, intent(in) :: n_periods
      type(comm_t), intent(in) :: comm
      type(watched_integration_t), intent(inout) :: ending
      type(verdict_t), intent(inout) :: verdicts(:)
      integer, allocatable, intent(out) :: left(:)                    !! points of this rank without a verdict, from 1
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      allocate (left(0))
      do i = 1 + rank_of(comm), size(points), size_of(comm)
         associate (point => points(i))
            ending%share = 0.0_wp
            if (.not. ending%is_due()) call verify_point(stored, point, n_periods, verdicts(point), error)
            if (ending%reason /= interruption%none) then
               if (allocated(error)) deallocate (error)
               verdicts(point) = verdict_t()
               left = [left, point]
               cycle
            end if
            call annotate(error, "point "//to_text(point - 1))
            if (allocated(error)) return
            call ending%counter%add_done(1, 1, 0)
         end associate
      end do
   end subroutine verify_share

   !> Writes the final state of all ranks.
   subroutine finish_progress(progress, counter, comm)
      type(progress_t), intent(inout) :: progress
      type(work_counter_t), intent(in) :: counter
      type(comm_t), intent(in) :: comm
      integer :: done, failed

      call barrier(comm)
      call counter%read_tallies(done, failed)
      call progress%finish(done, failed)
   end subroutine finish_progress

   !> Whether the present point must end, as of the parent type; shows the progress if a line is due.
   logical function watched_integration_wants_end(self) result(wants_end)
      class(watched_integration_t), intent(inout) :: self

      if (self%progress%is_due()) call self%show_within("time integration, "//to_text(nint(100*self%share))//" %", self%share)
      wants_end = self%interruption_t%wants_end()
   end function watched_integration_wants_end

   !> Notes which share of the present point is done.
   recursive subroutine watched_integration_note_progress(self, n_done, n_steps)
      class(watched_integration_t), intent(inout) :: self
      integer, intent(in) :: n_done, n_steps

      self%share = real(n_done, wp)/max(1, n_steps)
   end subroutine watched_integration_note_progress

   subroutine check_points(path, stored, points, error)
      character(*), intent(in) :: path
      type(stored_t), intent(in) :: stored
      integer, intent(in) :: points(:)
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      if (size(stored%coefficients, 3) /= stored%study%model%system%structure%n_dofs) then
         call fail(error, "time integration starts from all degrees of freedom, and the file has "// &
                   to_text(size(stored%coefficients, 3))//" of "//to_text(stored%study%model%system%structure%n_dofs)// &
                   "; solve again without &output dofs")
         return
      end if
      do i = 1, size(points)
         if (points(i) < size(stored%status)) cycle
         call fail(error, "there is no point "//to_text(points(i))//" in '"//path//"'; it has 0 to "// &
                   to_text(size(stored%status) - 1))
         return
      end do
   end subroutine check_points

   subroutine read_stored(path, stored, error)
      character(*), intent(in) :: path
      type(stored_t), intent(out) :: stored
      type(error_t), allocatable, intent(out) :: error
      type(stored_file_t) :: of_file
      character(:), allocatable :: folder

      call read_record(stored%record_t, path, error)
      if (allocated(error)) return
      stored%estimates = stored%truncation + stored%aliasing
      call open_file(of_file%file, path, error)
      if (allocated(error)) return
      call read_motions(of_file, stored, error)
      call of_file%file%close(error)
      folder = stored%input_folder                                    ! files that the input names are relative to its folder
      if (len(folder) == 0) folder = stored%input_name(:index(stored%input_name, "/", back=.true.))
      if (.not. allocated(error)) call new_study(stored%study, &
         folder//path(index(path, "/", back=.true.) + 1:)//": input_complete", stored%input_complete, [string_t ::], error, &
         files=stored%input_libraries)
      if (allocated(error)) return
      if (.not. are_same_files(stored%study%libraries(), stored%input_libraries)) call fail(error, "'"//path// &
         "' was made with another model or another library of a law, which is needed to verify it"//new_line("a")// &
         "now:"//new_line("a")//stored%study%libraries()//new_line("a")//"in the file:"//new_line("a")//stored%input_libraries)
      if (.not. (stored%is_census .or. stored%has_tuples(stored%study%tuples) .or. allocated(error))) call fail(error, "'"//path// &
         "' has other harmonics than its input gives in this version of the program; it was made by version "// &
         stored%program_version//", commit "//stored%git_commit)
      if (.not. allocated(error)) call note_curve_values(path, stored%study%plan, error)
   end subroutine read_stored

   !> Coefficients and frequencies of all points.
   subroutine read_motions(self, stored, error)
      type(stored_file_t), intent(inout) :: self
      type(stored_t), intent(inout) :: stored
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: tuples(:)
      real(wp), allocatable :: coefficients(:), estimates(:)

      call self%list(error)
      call self%fetch("coefficients", coefficients, error)
      call self%fetch("frequency_estimate", estimates, error)
      if (allocated(error)) return
      associate (n_tones => size(stored%tuples, 1), n => size(stored%tuples, 2))
         stored%coefficients = reshape(coefficients, [2, n, size(stored%dofs), stored%n_points])
         stored%frequency_estimates = reshape(estimates, [n_tones, stored%n_points])
         if (.not. stored%has_own_tuples) return
         call self%fetch("tuples", tuples, error)
         call self%fetch("n_harmonics", stored%n_harmonics, error)
         if (allocated(error)) return
         stored%own_tuples = reshape(tuples, [n_tones, n, stored%n_points])
         stored%n_harmonics = max(1, min(stored%n_harmonics, n))
      end associate
   end subroutine read_motions

   !> Integrates from one point.
   subroutine verify_point(stored, point, n_periods, result, error)
      type(stored_t), intent(in) :: stored
      integer, intent(in) :: point, n_periods
      type(verdict_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      type(document_t), target :: document
      type(model_t) :: model
      type(claim_t) :: claim

      document = stored%study%document
      call stored%study%plan%apply(point, document)
      call read_model(model, document, error, callbacks=run_callbacks(), &
                      purpose=purpose_t(is_followed=allocated(stored%study%plan%curve)))
      if (.not. allocated(error)) then                                ! values may follow unknown frequencies
         call follow_frequencies(model, stored%frequency(:, point), error)
      end if
      if (allocated(error)) return
      claim%omega = stored%frequency(:, point)
      claim%tuples = stored%tuples
      if (stored%has_own_tuples) claim%tuples = stored%own_tuples(:, :stored%n_harmonics(point), point)
      associate (n => size(claim%tuples, 2))
         allocate (claim%amplitudes(n, model%system%structure%n_dofs))
         claim%amplitudes(:, model%options%output%dofs) = cmplx(stored%coefficients(1, :n, :, point), &
                                                        -stored%coefficients(2, :n, :, point), wp)
      end associate
      call claim%leave_out_absent()
      claim%estimate = stored%estimates(point)
      claim%frequency_estimates = stored%frequency_estimates(:, point)
      claim%is_averaged = is_integrated(stored%status(point)) .and. .not. model%options%accuracy%grows_set
      claim%is_unstable = stored%is_stable(point) == -1
      claim%spread = stored%aliasing(point)
      call verify_motion(model, claim, n_periods, result, error)
   end subroutine verify_point

   subroutine write_verdicts(file, verdicts, error)
      type(h5_file_t), intent(in) :: file
      type(verdict_t), intent(in) :: verdicts(:)
      type(error_t), allocatable, intent(out) :: error
      type(h5_dataset_t) :: dataset
      integer :: i

      call write_column("integration_first_difference", verdicts%first_difference)
      call write_column("integration_difference", verdicts%difference)
      call write_column("integration_limit", verdicts%limit)
      call write_column("integration_growth", verdicts%growth)
      call write_column("integration_duration", verdicts%duration)
      if (.not. allocated(error)) call file%open_dataset("integration_drift", dataset, error)
      do i = 1, size(verdicts)
         if (verdicts(i)%kind /= verdict%not_done .and. .not. allocated(error)) call dataset%write(verdicts(i)%drift, error, i)
      end do
      call write_column("integration_verdict", real(verdicts%kind, wp))

   contains

      subroutine write_column(name, values)
         character(*), intent(in) :: name
         real(wp), intent(in) :: values(:)
         integer :: k

         if (.not. allocated(error)) call file%open_dataset(name, dataset, error)
         do k = 1, size(values)
            if (verdicts(k)%kind /= verdict%not_done .and. .not. allocated(error)) call dataset%write(values(k), error, k)
         end do
      end subroutine write_column
   end subroutine write_verdicts
end module hb_verify
