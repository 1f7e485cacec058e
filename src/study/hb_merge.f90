!> One result file from those of the parts of a sweep, which jobs of an array solved: the file that one run of the whole sweep would
!> have made.
module hb_merge
   use hb_branch_numbers, only: number_branches
   use hb_chained_points, only: length_of_units
   use hb_document, only: document_t
   use hb_error, only: annotate, error_t, fail
   use hb_hdf5, only: open_file
   use hb_mpi, only: comm_t
   use hb_named_files, only: are_same_files
   use hb_namelist_difference, only: list_differences
   use hb_outcome, only: outcome
   use hb_properties, only: properties_t
   use hb_result_columns, only: new_plan, plan_t
   use hb_results, only: open_results, results_t
   use hb_results_file, only: copied_file_t, make_file
   use hb_results_layout, only: results_layout_t
   use hb_results_record, only: fail_where_damaged, name_of_input, open_points, read_record, record_t, store_law_findings
   use hb_study, only: describe_layout, new_study, read_input, study_t
   use hb_sweep_plan, only: read_sweep_plan, sweep_plan_t
   use hb_text, only: add_string, join, lower, string_t, to_text
   implicit none
   private
   public :: merge_results, whole_overrides

   character(*), parameter :: key = "part"

contains

   !> Overrides of a part without that of its number, which give the input of the whole sweep.
   subroutine whole_overrides(record, overrides, error)
      type(record_t), intent(in) :: record
      type(string_t), allocatable, intent(out) :: overrides(:)
      type(error_t), allocatable, intent(out) :: error
      type(document_t), target :: document
      type(properties_t), pointer :: group
      character(:), allocatable :: path
      integer :: i

      allocate (overrides(0))
      do i = 1, size(record%overrides)
         path = lower(adjustl(record%overrides(i)%value(:index(record%overrides(i)%value, "=") - 1)))
         if (index(path, "sweep") == 1 .and. index(path, "%"//key) == len_trim(path) - len(key)) cycle
         call add_string(overrides, record%overrides(i)%value)
      end do
      call read_input(document, record%input_name, record%input_text, overrides, error)
      if (allocated(error)) return
      do i = 1, document%count("sweep")
         group => document%group("sweep", i)
         if (group%given(key)) call add_string(overrides, "sweep("//to_text(i)//")%"//key//"=")
      end do
   end subroutine whole_overrides

   !> Writes the result file of a whole sweep from those of its parts; by one process. Fails, with no file, if a part has another
   !> input, another model or libraries, damaged rows, or a point that an earlier one has. Points that no part has are pending.
   subroutine merge_results(study, path, parts, overwrite, comm, n_left, error)
      type(study_t), intent(in) :: study                              !! of the whole sweep
      character(*), intent(in) :: path                                !! of the new file
      type(string_t), intent(in) :: parts(:)                          !! paths of the files
      logical, intent(in) :: overwrite
      type(comm_t), intent(in) :: comm                                !! of this process alone
      integer, intent(out) :: n_left                                  !! points that can be solved yet
      type(error_t), allocatable, intent(out) :: error
      type(copied_file_t) :: sources(size(parts))
      type(plan_t) :: plan
      type(record_t) :: record
      type(results_layout_t) :: layout
      integer, allocatable :: owner(:)
      integer :: i, n_complete, n_harmonics, n_ranks
      character(:), allocatable :: doubt

      n_left = 0
      n_complete = 0
      n_harmonics = 1
      n_ranks = 0
      allocate (owner(study%plan%n_points), source=0)
      do i = 1, size(parts)
         call read_record(record, parts(i)%value, error)
         if (.not. allocated(error)) call check_input(study, record, error)
         if (.not. allocated(error)) call check_rows(study, record, parts(i)%value, error)
         call annotate(error, "'"//parts(i)%value//"'")
         if (.not. allocated(error)) call claim_rows(study, record, parts, i, owner, sources(i)%rows, error)
         if (allocated(error)) return
         sources(i)%first_rank = n_ranks + 1
         sources(i)%n_ranks = record%n_ranks
         n_ranks = n_ranks + record%n_ranks
         n_harmonics = max(n_harmonics, size(record%tuples, 2))
         n_complete = n_complete + record%n_points - size(open_points(record, .true.))
         n_left = n_left - (record%n_points - size(open_points(record, .false.)))
         if (allocated(record%law_findings) .and. .not. allocated(doubt)) doubt = record%law_findings
      end do
      n_left = n_left + study%plan%n_points
      if (n_complete < study%plan%n_points) n_harmonics = size(study%tuples, 2) ! the rest may need them
      call describe_layout(study, n_ranks, layout, min(n_harmonics, size(study%tuples, 2)))
      call new_plan(plan, layout)
      do i = 1, size(parts)
         if (.not. allocated(error)) call open_file(sources(i)%file, parts(i)%value, error)
      end do
      if (.not. allocated(error)) then
         call make_file(path, layout, plan, overwrite, error, sources)
         call annotate(error, "'"//path//"'")
      end if
      do i = 1, size(parts)
         call sources(i)%file%close(error)
      end do
      if (n_left == 0 .and. study%plan%is_ordered() .and. .not. allocated(error)) call renumber(study, path, layout, comm, error)
      if (.not. allocated(error)) call store_law_findings(path, doubt, error)
   end subroutine merge_results

   !> Fails unless a file has a part of the sweep: unless its input without the number of its part is that of the whole.
   subroutine check_input(study, record, error)
      type(study_t), intent(in) :: study
      type(record_t), intent(in) :: record
      type(error_t), allocatable, intent(out) :: error
      type(string_t), allocatable :: overrides(:)
      type(study_t) :: other
      character(:), allocatable :: differences

      if (record%is_census) then
         call fail(error, "it is the result of a census, not of a sweep")
         return
      end if
      call whole_overrides(record, overrides, error)
      if (allocated(error)) return
      if (record%input_text == study%input_text .and. join(overrides, new_line("a")) == study%input_overrides) return
      call new_study(other, trim(name_of_input(record)), record%input_text, overrides, error, study%available_memory, &
                     files=record%input_libraries)
      if (allocated(error)) return
      call list_differences(study%input_complete, other%input_complete, "the first file", "this one", differences)
      if (len(differences) > 0) call fail(error, "it has another input than the first file; parts differ by &sweep: "//key// &
                                          " alone"//new_line("a")//differences)
   end subroutine check_input

   !> Fails unless the rows of a file are intact, and made with the model, libraries and harmonics of the whole sweep.
   subroutine check_rows(study, record, path, error)
      type(study_t), intent(in) :: study
      type(record_t), intent(inout) :: record
      character(*), intent(in) :: path
      type(error_t), allocatable, intent(out) :: error

      if (.not. are_same_files(study%libraries(), record%input_libraries)) then
         call fail(error, "it was made with another model or other libraries of laws; now:"//new_line("a")//study%libraries()// &
                   new_line("a")//"in the file:"//new_line("a")//record%input_libraries)
      else if (.not. record%has_own_tuples .and. .not. record%has_tuples(study%tuples)) then
         call fail(error, "it has other harmonics than the whole sweep; parts of a sweep of orders cannot be merged")
      else
         call record%check_rows(path, error)
         if (.not. allocated(error)) call fail_where_damaged(path, record%is_damaged, error)
      end if
   end subroutine check_rows

   !> Assigns the rows of a part to the points of the whole sweep; fails for a point that an earlier part has.
   subroutine claim_rows(study, record, parts, i, owner, rows, error)
      type(study_t), intent(in) :: study
      type(record_t), intent(in) :: record
      type(string_t), intent(in) :: parts(:)                          !! paths of the files
      integer, intent(in) :: i                                        !! this part
      integer, intent(inout) :: owner(:)                              !! the part that has a point; 0: none
      integer, allocatable, intent(out) :: rows(:)                    !! of the file, for each point; 0: none
      type(error_t), allocatable, intent(out) :: error
      type(document_t), target :: document
      type(sweep_plan_t) :: plan
      integer :: point, whole

      allocate (rows(study%plan%n_points), source=0)
      call read_input(document, record%input_name, record%input_text, record%overrides, error)
      if (.not. allocated(error)) call read_sweep_plan(plan, document, error)
      if (.not. allocated(error) .and. plan%n_points /= record%n_points) call fail(error, "it has "//to_text(record%n_points)// &
         " points, its input "//to_text(plan%n_points))
      if (.not. allocated(error)) then
         do point = 1, plan%n_points
            if (record%status(point) == outcome%pending) cycle
            whole = plan%point_of_whole(point)
            if (owner(whole) > 0) then
               call fail(error, "its point "//to_text(point - 1)//", "//plan%describe(point)//", is also in '"// &
                         parts(owner(whole))%value//"'")
               exit
            end if
            owner(whole) = i
            rows(whole) = point
         end do
      end if
      call annotate(error, "'"//parts(i)%value//"'")
   end subroutine claim_rows

   !> Numbers the branches along the lines of the whole sweep, which parts may have cut.
   subroutine renumber(study, path, layout, comm, error)
      type(study_t), intent(in) :: study
      character(*), intent(in) :: path
      type(results_layout_t), intent(in) :: layout
      type(comm_t), intent(in) :: comm
      type(error_t), allocatable, intent(out) :: error
      type(results_t) :: results
      integer :: first_jump, n_jumps

      call open_results(results, path, layout, comm, error)
      if (allocated(error)) return
      call number_branches(results, study%plan, length_of_units(study%plan, study%model), comm, n_jumps, first_jump, error)
      call results%close(error)
   end subroutine renumber
end module hb_merge
