!> `nhbm bench`: times the kernels of a scene beside the FFT pair and the LU factorisation of the same size.
module verb_bench
   use, intrinsic :: iso_fortran_env, only: output_unit
   use arguments, only: arguments_t, default_output
   use hb_error, only: annotate, error_t, fail
   use hb_file_place, only: check_place
   use hb_kernel_file, only: write_kernel_times
   use hb_kernel_times, only: kernel_names, kernel_times_t, measure_kernels, memory_bandwidth
   use hb_kinds, only: wp
   use hb_mpi, only: comm_t, size_of
   use hb_namelist, only: document_t
   use hb_outcome, only: is_solved, outcome_name
   use hb_progress, only: log_level
   use hb_study, only: study_t
   use hb_text, only: to_text
   use verb_solve, only: load_study
   implicit none
   private
   public :: run_bench

contains

   !> Runs the verb; `all_solved` tells whether every point was.
   subroutine run_bench(options, comm, all_solved, error)
      type(arguments_t), intent(in) :: options
      type(comm_t), intent(in) :: comm
      logical, intent(out) :: all_solved
      type(error_t), allocatable, intent(out) :: error
      type(study_t) :: study
      type(kernel_times_t), allocatable :: times(:)
      type(document_t), target :: document
      character(:), allocatable :: path
      real(wp) :: bandwidth
      integer :: point

      all_solved = .false.
      path = default_output(options%input)
      if (allocated(options%output)) path = options%output
      if (size_of(comm) > 1) then
         call fail(error, "bench measures times in one process; run it without mpirun")
         return
      end if
      call load_study(options, comm, study, error)
      if (allocated(error)) return
      call check_place(path, options%overwrite, error)                ! before the work
      call annotate(error, "result file '"//path//"'")
      if (allocated(error)) return
      bandwidth = memory_bandwidth()
      if (options%level > log_level%quiet) then
         write (output_unit, "(a, f0.1, a)") "bandwidth of the memory (triad): ", bandwidth/1.0e9_wp, " GB/s"
      end if
      allocate (times(study%plan%n_points))
      do point = 1, study%plan%n_points
         document = study%document
         call study%plan%apply(point, document, error)
         if (.not. allocated(error)) call measure_kernels(times(point), document, options%budget, error)
         if (allocated(error)) then
            call annotate(error, "point "//to_text(point))
            return
         end if
         if (options%level > log_level%quiet) call write_point(point, times(point))
      end do
      all_solved = all([(is_solved(times(point)%status), point=1, size(times))])
      call write_kernel_times(times, study, bandwidth, path, options%overwrite, error)
      if (allocated(error)) return
      if (options%level > log_level%quiet) write (output_unit, "(a)") "results in "//path
   end subroutine run_bench

   subroutine write_point(point, times)
      integer, intent(in) :: point
      type(kernel_times_t), intent(in) :: times
      integer :: i

      write (output_unit, "(a)") "point "//to_text(point)//": "//to_text(times%n_unknowns)//" unknowns, "// &
         to_text(times%n_samples)//" samples, "//to_text(times%n_channels)//" channels, "// &
         outcome_name(times%status)//" after "//to_text(times%iterations)//" iterations, "// &
         to_text(times%evaluations)//" residuals"
      write (output_unit, "(a)") "             median [s]   first     least      most    yardstick     ratio"
      do i = 1, size(kernel_names)
         write (output_unit, "(1x, a12, 5es10.2, f10.3)") kernel_names(i), times%seconds(i), times%first(i), times%fastest(i), &
            times%slowest(i), times%yardstick(i), times%ratio(i)
      end do
   end subroutine write_point
end module verb_bench
