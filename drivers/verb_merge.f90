!> `nhbm merge`: one result file from those of the parts of a sweep.
module verb_merge
   use arguments, only: arguments_t
   use console, only: say
   use exit_status, only: incomplete, success
   use hb_error, only: annotate, error_t, fail
   use hb_merge, only: merge_results, whole_overrides
   use hb_mpi, only: comm_t, size_of
   use hb_progress, only: log_level
   use hb_results_record, only: name_of_input, read_record, record_t
   use hb_study, only: study_t
   use hb_text, only: number_of, string_t, to_text
   use next_step, only: shell_word
   use verb_solve, only: make_study
   implicit none
   private
   public :: run_merge

contains

   !> Runs the verb; the exit status shows whether the file is complete.
   subroutine run_merge(options, comm, status, error)
      type(arguments_t), intent(in) :: options
      type(comm_t), intent(in) :: comm
      integer, intent(out) :: status
      type(error_t), allocatable, intent(out) :: error
      type(record_t) :: record
      type(string_t), allocatable :: overrides(:)
      type(study_t) :: study
      integer :: i, n_left
      character(:), allocatable :: rest

      status = success
      if (size(options%more_inputs) == 0) call fail(error, "merge needs a new file and those of the parts, such as nhbm merge "// &
                                                    "whole.h5 part_*.h5; the only file is '"//options%input//"'")
      if (size_of(comm) > 1 .and. .not. allocated(error)) call fail(error, "merge is done by one process, without mpirun")
      do i = 1, size(options%more_inputs)
         if (options%more_inputs(i)%value == options%input .and. .not. allocated(error)) &
            call fail(error, "'"//options%input//"' is the new file and a part; give the new one another name")
      end do
      if (allocated(error)) return
      call read_record(record, options%more_inputs(1)%value, error)
      if (.not. allocated(error)) call whole_overrides(record, overrides, error)
      if (.not. allocated(error)) call make_study(study, trim(name_of_input(record)), record%input_text, overrides, comm, error, &
                                                  files=record%input_libraries)
      call annotate(error, "'"//options%more_inputs(1)%value//"'")
      if (allocated(error)) return
      call merge_results(study, options%input, options%more_inputs, options%overwrite, comm, n_left, error)
      if (allocated(error)) return
      rest = ", complete"
      if (n_left > 0) rest = ", "//to_text(n_left)//" left: nhbm resume "//shell_word(options%input)
      if (n_left > 0) status = incomplete
      if (options%level >= log_level%normal) call say(options%input//": "//number_of(study%plan%n_points, "point")//" from "// &
         number_of(size(options%more_inputs), "file")//rest)
   end subroutine run_merge
end module verb_merge
