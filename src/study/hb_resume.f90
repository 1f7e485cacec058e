!> Resuming the result file of a run that has ended: checks that the input is the same, and selects the remaining
!> units of points.
module hb_resume
   use hb_error, only: error_t, fail
   use hb_mpi, only: broadcast_integers, comm_t, rank_of, share_error
   use hb_named_files, only: are_same_files
   use hb_namelist_difference, only: list_differences
   use hb_operating_system, only: exists
   use hb_outcome, only: outcome
   use hb_results_record, only: open_points, read_record, record_t
   use hb_run_summary, only: count_retained, run_summary_t
   use hb_schedule, only: schedule_t
   implicit none
   private
   public :: choose_units, resumed_file_t, resumed_input_t

   !> The data that must agree with the file.
   type :: resumed_input_t
      character(:), allocatable :: complete                           !! the input after defaults
      integer, allocatable :: tuples(:, :)                            !! (n_tones, n_harmonics), of all points
      character(:), allocatable :: libraries                          !! of laws, model, reduction, with their checksums
   end type resumed_input_t

   !> The data of the file.
   type :: resumed_file_t
      logical :: is_there = .false.
      integer, allocatable :: crashed(:)                              !! points, from 1, that are skipped
   end type resumed_file_t

contains

   !> Restricts the schedule to the units that have a point to solve in the file at `path`; to all units if there is
   !> no file. The summary of rank 0 begins with the points that are not solved again. Collective; an error is the
   !> same on all ranks.
   subroutine choose_units(path, input, retries, comm, schedule, file, summary, error)
      character(*), intent(in) :: path
      type(resumed_input_t), intent(in) :: input
      logical, intent(in) :: retries                                  !! points that did not converge are solved again
      type(comm_t), intent(in) :: comm
      type(schedule_t), intent(inout) :: schedule
      type(resumed_file_t), intent(out) :: file
      type(run_summary_t), intent(inout) :: summary
      type(error_t), allocatable, intent(out) :: error
      type(record_t) :: record
      integer, allocatable :: found(:)
      integer :: i

      allocate (file%crashed(0), found(0))
      if (rank_of(comm) == 0) then
         if (exists(path)) then
            call read_record(record, path, error)
            if (.not. allocated(error)) call compare_input(input, schedule%n_points, retries, record, path, error)
            if (.not. allocated(error)) call record%check_rows(path, error)
            if (.not. allocated(error)) found = [1, open_points(record, retries)]
         end if
      end if
      call share_error(comm, error)
      if (allocated(error)) return
      if (rank_of(comm) == 0 .and. size(found) > 0 .and. .not. retries) &
         file%crashed = pack([(i, i=1, record%n_points)], record%status == outcome%crashed)
      call broadcast_integers(comm, found)
      call broadcast_integers(comm, file%crashed)
      file%is_there = size(found) > 0                                 ! a 1 and the points, or nothing without a file
      if (.not. file%is_there) return
      call schedule%restrict_to(found(2:))
      if (rank_of(comm) > 0) return
      call count_retained(summary, record, schedule%all_points())
      summary%has_other_libraries = .not. are_same_files(input%libraries, record%input_libraries)
   end subroutine choose_units

   !> Rejects the file of another input.
   subroutine compare_input(self, n_points, retries, record, path, error)
      type(resumed_input_t), intent(in) :: self
      integer, intent(in) :: n_points
      logical, intent(in) :: retries                                  !! with another library, points may converge
      type(record_t), intent(in) :: record
      character(*), intent(in) :: path
      type(error_t), allocatable, intent(out) :: error
      character(:), allocatable :: differences

      call list_differences(self%complete, record%input_complete, "the input", "the file", differences)
      if (record%is_census) then
         call fail(error, "'"//path//"' is the result of a census, which is complete")
      else if (len(differences) > 0) then
         call fail(error, "result file '"//path//"' was made from another input; give the same or another --output"// &
            new_line("a")//differences)
      else if (len(self%libraries) > 0 .and. len(record%input_libraries) == 0 .and. .not. retries) then
         call fail(error, "result file '"//path//"' does not say which model and libraries of laws it was made with; "// &
            "--retry continues with the present ones, if they are the same"//new_line("a")//self%libraries)
      else if (.not. (are_same_files(self%libraries, record%input_libraries) .or. retries)) then
         call fail(error, "result file '"//path//"' was made with another model or other libraries of laws; give the same or "// &
            "another --output, or --retry to continue with these"//new_line("a")//"now:"//new_line("a")// &
            self%libraries//new_line("a")//"in the file:"//new_line("a")//record%input_libraries)
      else if (.not. record%has_tuples(self%tuples) .or. n_points /= record%n_points) then
         call fail(error, "result file '"//path//"' has other points or harmonics than the input gives in this version "// &
            "of the program; it was made by version "//record%program_version//", commit "//record%git_commit)
      end if
   end subroutine compare_input
end module hb_resume
