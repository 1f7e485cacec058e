!> nhbm-bench: what the points of an input cost, whole and by their kernels. Takes INPUT -o FILE [--overwrite] [--quiet] [--set
!> PATH=VALUE]... [--repeats N] [--budget SECONDS]; exit status 0: all points converged, 4: some did not, 2: bad input.
program nhbm_bench
   use, intrinsic :: iso_fortran_env, only: error_unit, output_unit
   use bench_points, only: bench_options_t, part, point_cost_t, run_bench
   use hb_blas_threads, only: allocate_blas_memory, limit_blas_threads
   use hb_error, only: annotate, error_t, fail
   use hb_file_location, only: check_source, check_target
   use hb_kinds, only: wp
   use hb_memory, only: available_memory, retain_freed_memory
   use hb_mpi, only: comm_t, size_of, start_mpi, stop_mpi, world
   use hb_outcome, only: outcome, outcome_name
   use hb_progress, only: log_level
   use hb_study, only: new_study, study_t
   use hb_text, only: add_string, parse_integer, parse_real, string_t, to_text
   use hb_text_file, only: read_text_file
   use kernel_times, only: has_kernels, kernel_names, kernel_times_t, median
   implicit none

   type(bench_options_t) :: options
   type(comm_t) :: comm
   type(error_t), allocatable :: error
   type(point_cost_t), allocatable :: costs(:)
   type(string_t), allocatable :: overrides(:)
   type(study_t) :: study
   character(:), allocatable :: input
   integer :: i, status

   call retain_freed_memory(64)
   call limit_blas_threads()
   call start_mpi()
   comm = world()
   options%level = log_level%normal
   call read_words()
   if (.not. allocated(error)) call load_input()
   if (.not. allocated(error)) call allocate_blas_memory(error)
   if (.not. allocated(error)) call run_bench(study, options, comm, costs, error)
   if (allocated(error)) then
      status = 2
      write (error_unit, "(a)") "nhbm-bench: "//error%message
   else
      status = merge(0, 4, all([(costs(i)%result%status == outcome%converged, i=1, size(costs))]))
      if (options%level > log_level%quiet) call write_tables()
   end if
   flush (output_unit)
   call stop_mpi()
   stop status, quiet=.true.

contains

   subroutine read_words()
      character(*), parameter :: with_value(5) = [character(9) :: "-o", "--output", "--set", "--repeats", "--budget"]
      character(:), allocatable :: value, word
      integer :: i
      logical :: is_right

      allocate (overrides(0))
      input = ""
      i = 0
      do while (i < command_argument_count() .and. .not. allocated(error))
         call next_word(i, word)
         is_right = .true.
         value = ""
         if (any(with_value == word)) call next_word(i, value)
         select case (word)
         case ("-o", "--output"); options%path = value
         case ("--overwrite"); options%overwrite = .true.
         case ("--quiet"); options%level = log_level%quiet
         case ("--set"); call add_string(overrides, value)
         case ("--repeats")
            call parse_integer(value, options%repeats, is_right)
            is_right = is_right .and. options%repeats >= 1
         case ("--budget")
            call parse_real(value, options%budget, is_right)
            is_right = is_right .and. options%budget >= 0.0_wp .and. options%budget <= huge(1.0_wp)
         case default
            is_right = index(word, "-") /= 1 .and. len(input) == 0
            input = word
         end select
         if (.not. is_right) call fail(error, "cannot understand '"//word//"', or the value behind it")
      end do
      if (.not. allocated(error) .and. (len(input) == 0 .or. .not. allocated(options%path))) &
         call fail(error, "give INPUT and -o FILE")
      if (.not. allocated(error) .and. size_of(comm) > 1) &
         call fail(error, "times are measured in one process; run it without mpirun")
   end subroutine read_words

   !> The word behind number i of the command line, and i one further; empty behind the last.
   subroutine next_word(i, word)
      integer, intent(inout) :: i
      character(:), allocatable, intent(out) :: word
      integer :: length

      i = i + 1
      call get_command_argument(i, length=length)
      allocate (character(length) :: word)
      call get_command_argument(i, word)
   end subroutine next_word

   subroutine load_input()
      character(:), allocatable :: text

      call check_source(input, error)
      if (.not. allocated(error)) call read_text_file(input, text, error)
      if (.not. allocated(error)) call new_study(study, input, text, overrides, error, available_memory())
      if (allocated(error)) return
      if (allocated(study%plan%curve)) then
         call fail(error, "points are measured, not curves; leave out &curve, or time nhbm solve")
         return
      end if
      call check_target(options%path, options%overwrite, error)        ! before the work
      call annotate(error, "result file '"//options%path//"'")
   end subroutine load_input

   subroutine write_tables()
      integer :: i

      print "(a)", "point  unknowns  iterations  total [s]  status         parameters"
      do i = 1, size(costs)
         associate (result => costs(i)%result)
            print "(i5, i10, i12, es11.2, 2x, a15, a)", i - 1, result%n_unknowns, result%iterations, &
               median(costs(i)%seconds(part%total, :)), outcome_name(result%status)//repeat(" ", 15), study%plan%describe(i)
         end associate
      end do
      do i = 1, size(costs)
         if (has_kernels(costs(i)%kernels)) call write_kernels(i, costs(i)%kernels)
      end do
      print "(a)", "results in "//options%path
   end subroutine write_tables

   subroutine write_kernels(point, times)
      integer, intent(in) :: point                                    !! from 1
      type(kernel_times_t), intent(in) :: times
      integer :: i

      print "(a)", "point "//to_text(point - 1)//": "//to_text(times%n_unknowns)//" unknowns, "// &
         to_text(times%n_samples)//" samples, "//to_text(times%n_channels)//" channels"
      print "(a)", "             median [s]   first     least      most    yardstick     ratio"
      do i = 1, size(kernel_names)
         print "(1x, a12, 5es10.2, f10.3)", kernel_names(i), times%seconds(i), times%first(i), times%fastest(i), &
            times%slowest(i), times%yardstick(i), times%ratio(i)
      end do
   end subroutine write_kernels
end program nhbm_bench
