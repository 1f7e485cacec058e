!> `nhbm bench`: what the points of an input cost, whole and by their kernels.
module verb_bench
   use arguments, only: arguments_t
   use console, only: say
   use hb_bench, only: bench_options_t, part, point_cost_t, run_bench
   use hb_error, only: annotate, error_t, fail
   use hb_file_place, only: check_place
   use hb_kernel_times, only: has_kernels, kernel_names, kernel_times_t, median
   use hb_mpi, only: comm_t, size_of
   use hb_outcome, only: outcome, outcome_name
   use hb_progress, only: log_level
   use hb_study, only: study_t
   use hb_text, only: to_text
   use result_place, only: place_result
   use verb_solve, only: load_study
   implicit none
   private
   public :: run_bench_verb

contains

   !> Runs the verb; `all_converged` tells whether every point did.
   subroutine run_bench_verb(options, comm, all_converged, error)
      type(arguments_t), intent(in) :: options
      type(comm_t), intent(in) :: comm
      logical, intent(out) :: all_converged
      type(error_t), allocatable, intent(out) :: error
      type(bench_options_t) :: how
      type(point_cost_t), allocatable :: costs(:)
      type(study_t) :: study
      integer :: i

      all_converged = .false.
      how%overwrite = options%overwrite
      how%repeats = options%n_repeats
      how%budget = options%budget
      how%level = options%level
      if (size_of(comm) > 1) then
         call fail(error, "bench measures times in one process; run it without mpirun")
         return
      end if
      call place_result(options, comm, how%path, error)
      if (.not. allocated(error)) call load_study(options, comm, study, error)
      if (.not. allocated(error) .and. allocated(study%plan%curve)) &
         call fail(error, "bench measures points, not curves; leave out &curve, or time nhbm solve")
      if (allocated(error)) return
      call check_place(how%path, how%overwrite, error)                ! before the work
      call annotate(error, "result file '"//how%path//"'")
      if (allocated(error)) return
      if (how%level > log_level%quiet) call say("nhbm bench "//options%input//": "// &
         to_text(study%plan%n_points)//" points, each solved "//to_text(how%repeats)//" times")
      call run_bench(study, how, comm, costs, error)
      if (allocated(error)) return
      all_converged = all([(costs(i)%result%status == outcome%converged, i=1, size(costs))])
      if (how%level == log_level%quiet) return
      call write_points(study, costs)
      do i = 1, size(costs)
         if (has_kernels(costs(i)%kernels)) call write_kernels(i, costs(i)%kernels)
      end do
      call say("results in "//how%path)
   end subroutine run_bench_verb

   subroutine write_points(study, costs)
      type(study_t), intent(in) :: study
      type(point_cost_t), intent(in) :: costs(:)
      character(:), allocatable :: status
      character(80) :: line
      integer :: i

      call say("point  unknowns  iterations  total [s]  status         parameters")
      do i = 1, size(costs)
         status = outcome_name(costs(i)%result%status)
         associate (cost => costs(i))
            write (line, "(i5, i10, i12, es11.2)") i - 1, cost%result%n_unknowns, cost%result%iterations, &
               median(cost%seconds(part%total, :))
            call say(trim(line)//"  "//status//repeat(" ", max(1, 15 - len(status)))//study%plan%describe(i))
         end associate
      end do
   end subroutine write_points

   subroutine write_kernels(point, times)
      integer, intent(in) :: point                                    !! from 1
      type(kernel_times_t), intent(in) :: times
      character(80) :: line
      integer :: i

      call say("point "//to_text(point - 1)//": "//to_text(times%n_unknowns)//" unknowns, "// &
         to_text(times%n_samples)//" samples, "//to_text(times%n_channels)//" channels")
      call say("             median [s]   first     least      most    yardstick     ratio")
      do i = 1, size(kernel_names)
         write (line, "(1x, a12, 5es10.2, f10.3)") kernel_names(i), times%seconds(i), times%first(i), times%fastest(i), &
            times%slowest(i), times%yardstick(i), times%ratio(i)
         call say(trim(line))
      end do
   end subroutine write_kernels
end module verb_bench
