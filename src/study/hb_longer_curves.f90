!> More room for curves that have reached their number of points: the result file is replaced by one with more rows for each of
!> them, in which a resumed run continues.
module hb_longer_curves
   use hb_error, only: annotate, error_t, fail
   use hb_hdf5, only: open_file
   use hb_named_files, only: are_same_files
   use hb_namelist_difference, only: list_differences
   use hb_operating_system, only: held_file_t, hold_file, unlock_file
   use hb_outcome, only: outcome
   use hb_result_columns, only: new_plan, plan_t
   use hb_results_file, only: copied_file_t, make_file
   use hb_results_layout, only: results_layout_t
   use hb_results_record, only: fail_where_damaged, read_record, record_t, store_law_findings
   use hb_study, only: describe_layout, study_t
   use hb_text, only: split, string_t, to_text
   implicit none
   private
   public :: lengthen_curves

   character(*), parameter :: location = "&curve: points: "

contains

   !> Replaces the file at `path` by one with as many rows for each curve as the study has; by one process. The last row of a curve
   !> becomes pending, as it says that there was no room for more; a resumed run returns to the step before. After an error the
   !> file is unchanged.
   subroutine lengthen_curves(study, path, error)
      type(study_t), intent(in) :: study                              !! that of the file but for the number of points
      character(*), intent(in) :: path
      type(error_t), allocatable, intent(out) :: error
      type(copied_file_t) :: source
      type(held_file_t) :: held
      type(plan_t) :: plan
      type(record_t) :: record
      type(results_layout_t) :: layout
      integer :: n_before, n_curves, n_now

      call read_record(record, path, error)
      if (allocated(error)) return
      n_now = study%plan%n_fastest()
      n_curves = study%plan%n_points/n_now
      n_before = record%n_points/n_curves
      call check_lengths(study, record, path, n_before, n_now, error)
      if (allocated(error) .or. n_now == n_before) return
      call record%check_rows(path, error)
      if (.not. allocated(error)) call fail_where_damaged(path, record%is_damaged, error)
      if (allocated(error)) return
      call describe_layout(study, record%n_ranks, layout)
      call new_plan(plan, layout)
      source%rows = rows_of(record%status, n_curves, n_now)
      call hold_file(path, held, error)
      if (.not. allocated(error)) call open_file(source%file, path, error)
      if (.not. allocated(error)) call make_file(path, layout, plan, .true., error, [source])
      call source%file%close(error)
      if (held%descriptor >= 0) call unlock_file(held%descriptor)
      if (.not. allocated(error)) call store_law_findings(path, record%law_findings, error)
      call annotate(error, "result file '"//path//"'")
   end subroutine lengthen_curves

   !> Fails if the input of the file differs by more than the number of points, or has more of them.
   subroutine check_lengths(study, record, path, n_before, n_now, error)
      type(study_t), intent(in) :: study
      type(record_t), intent(in) :: record
      character(*), intent(in) :: path
      integer, intent(in) :: n_before, n_now                          !! points of a curve
      type(error_t), allocatable, intent(out) :: error
      type(string_t), allocatable :: lines(:)
      character(:), allocatable :: differences
      integer :: i

      call list_differences(study%input_complete, record%input_complete, "the input", "the file", differences)
      call split(differences, new_line("a"), lines)
      do i = 1, size(lines)
         if (len(lines(i)%value) == 0 .or. index(lines(i)%value, location) == 1) cycle
         call fail(error, "result file '"//path//"' was made by another version of the program, "//record%program_version// &
                   ", commit "//record%git_commit//", which continues it; now"//new_line("a")//differences)
         return
      end do
      if (.not. are_same_files(study%libraries(), record%input_libraries)) then
         call fail(error, "result file '"//path//"' was made with another model or other libraries of laws; now:"// &
                   new_line("a")//study%libraries()//new_line("a")//"in the file:"//new_line("a")//record%input_libraries)
      else if (n_now < n_before) then
         call fail(error, location//"the curves of '"//path//"' have room for "//to_text(n_before)//" points; give more, not "// &
                   to_text(n_now))
      else if (study%plan%curve%switches .and. n_before < record%n_points .and. n_now > n_before) then
         call fail(error, location//"files of motions that leave several curves have the numbers of their points, which "// &
                   "would change; solve again with another --output")
      end if
   end subroutine check_lengths

   !> The rows of the file for those of the longer one. A curve that has ended before its last row has no further point: that row,
   !> which is unused, is repeated.
   pure function rows_of(status, n_curves, n_now) result(rows)
      integer, intent(in) :: status(:)                                !! of the rows of the file
      integer, intent(in) :: n_curves, n_now
      integer :: rows(n_curves*n_now)
      integer :: c, i, last, n_before

      n_before = size(status)/n_curves
      rows = 0
      do c = 1, n_curves
         last = c*n_before
         do i = 1, n_now
            if (i < n_before) rows((c - 1)*n_now + i) = last - n_before + i
            if (i >= n_before .and. status(last) == outcome%unused) rows((c - 1)*n_now + i) = last
         end do
      end do
   end function rows_of
end module hb_longer_curves
