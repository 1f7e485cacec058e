!> `nhbm bench`: times the kernels of a scene beside the FFT pair and the LU factorisation of the same size.
module verb_bench
   use, intrinsic :: iso_fortran_env, only: output_unit
   use arguments, only: arguments_t
   use hb_error, only: annotate, error_t
   use hb_kernel_times, only: kernel_names, kernel_times_t, measure_kernels, memory_bandwidth
   use hb_kinds, only: wp
   use hb_mpi, only: comm_t
   use hb_namelist, only: document_t
   use hb_outcome, only: outcome_name
   use hb_study, only: study_t
   use hb_text, only: to_text
   use verb_solve, only: load_study
   implicit none
   private
   public :: run_bench

   real(wp), parameter :: budget = 0.5_wp                             ! seconds for each kernel

contains

   subroutine run_bench(options, comm, error)
      type(arguments_t), intent(in) :: options
      type(comm_t), intent(in) :: comm
      type(error_t), allocatable, intent(out) :: error
      type(study_t) :: study
      type(kernel_times_t) :: times
      type(document_t), target :: document
      integer :: i, point

      call load_study(options, comm, study, error)
      if (allocated(error)) return
      write (output_unit, "(a, f6.1, a)") "memory bandwidth (triad): ", memory_bandwidth()/1.0e9_wp, " GB/s"
      do point = 1, study%plan%n_points
         document = study%document
         call study%plan%apply(point, document, error)
         if (.not. allocated(error)) call measure_kernels(times, document, budget, error)
         if (allocated(error)) then
            call annotate(error, "point "//to_text(point))
            return
         end if
         write (output_unit, "(a)") "point "//to_text(point)//": "//to_text(times%n_unknowns)//" unknowns, "// &
            to_text(times%n_samples)//" samples, "//to_text(times%n_channels)//" channels, "// &
            outcome_name(times%status)//" after "//to_text(times%iterations)//" iterations, "// &
            to_text(times%evaluations)//" residuals"
         do i = 1, size(kernel_names)
            write (output_unit, "(a12, 3es11.3, a, es11.3, a, f9.3)") kernel_names(i), times%seconds(i), times%fastest(i), &
               times%slowest(i), "   yardstick", times%yardstick(i), "  ratio", times%ratio(i)
         end do
      end do
   end subroutine run_bench
end module verb_bench
