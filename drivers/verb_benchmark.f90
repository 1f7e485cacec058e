!> `nhbm benchmark`: solves one scene at many rungs, measures cost and error of each and writes them as a table.
module verb_benchmark
   use, intrinsic :: iso_fortran_env, only: output_unit
   use arguments, only: arguments_t, default_output
   use hb_benchmark, only: benchmark_t, measured_t, new_benchmark, part, run_benchmark
   use hb_benchmark_file, only: write_benchmark
   use hb_benchmark_table, only: median
   use hb_error, only: annotate, error_t, fail
   use hb_mpi, only: comm_t, size_of
   use hb_outcome, only: is_solved, outcome, outcome_name
   use hb_file_place, only: check_place
   use hb_progress, only: log_level
   use hb_text, only: to_text
   use hb_text_file, only: read_text_file
   implicit none
   private
   public :: run_benchmark_verb

contains

   !> Runs the verb; `all_converged` tells whether every rung did.
   subroutine run_benchmark_verb(options, comm, all_converged, error)
      type(arguments_t), intent(in) :: options
      type(comm_t), intent(in) :: comm
      logical, intent(out) :: all_converged
      type(error_t), allocatable, intent(out) :: error
      type(benchmark_t) :: benchmark
      character(:), allocatable :: path, text

      all_converged = .false.
      path = default_output(options%input)
      if (allocated(options%output)) path = options%output
      if (size_of(comm) > 1) then
         call fail(error, "benchmark measures times in one process; run it without mpirun")
         return
      end if
      call read_text_file(options%input, text, error)
      if (.not. allocated(error)) call new_benchmark(benchmark, options%input, text, options%overrides, error)
      if (allocated(error)) return
      call check_place(path, options%overwrite, error)                ! before the work
      call annotate(error, "result file '"//path//"'")
      if (allocated(error)) return
      if (options%level > log_level%quiet) write (output_unit, "(a)") "nhbm benchmark "//options%input//": "// &
         to_text(benchmark%plan%n_rungs)//" rungs, each solved "//to_text(benchmark%plan%repeats)//" times"
      call run_benchmark(benchmark, options%level, error)
      if (.not. allocated(error)) call write_benchmark(benchmark, path, options%overwrite, error)
      if (allocated(error)) return
      all_converged = all(benchmark%rungs%result%status == outcome%converged)
      if (options%level > log_level%quiet) call write_table(benchmark%rungs, path)
   end subroutine run_benchmark_verb

   subroutine write_table(rungs, path)
      type(measured_t), intent(in) :: rungs(:)
      character(*), intent(in) :: path
      integer :: i

      write (output_unit, "(a)") "rung  order  method   unknowns  iterations  total [s]     error  status"
      do i = 1, size(rungs)
         associate (rung => rungs(i))
            write (output_unit, "(i4, i7, 2x, a, i10, i12, es11.2)", advance="no") i - 1, rung%order, &
               pad(rung%method, 7), rung%n_unknowns, rung%result%iterations, median(rung%seconds(part%total, :))
            if (rung%is_reference) then
               write (output_unit, "(a)", advance="no") " reference"
            else
               write (output_unit, "(es10.1)", advance="no") rung%error
            end if
            write (output_unit, "(a)") "  "//outcome_name(rung%result%status)
         end associate
      end do
      write (output_unit, "(a)") to_text(count([(is_solved(rungs(i)%result%status), i=1, size(rungs))]))//" of "// &
         to_text(size(rungs))//" rungs solved; results in "//path
   end subroutine write_table

   !> Text filled up with blanks to a width; blanks for none.
   pure function pad(text, width)
      character(*), intent(in), optional :: text
      integer, intent(in) :: width
      character(width) :: pad

      pad = ""
      if (present(text)) pad = text
   end function pad
end module verb_benchmark
