!> What the points of an input cost: each solved as a whole from nothing, again and again, and its kernels beside yardsticks.
!>
!> From nothing: its input is read, FFTW forgets its plans, freed memory goes back to the system. The points take turns, up
!> the list and down again, so that a machine that slows down hits all alike. The file is a result file of these points with
!> the costs beside them, so that errors are found from it as from any other.
module bench_points
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_clock, only: wall_clock
   use hb_document, only: document_t
   use hb_error, only: annotate, error_t
   use hb_fftw, only: forget_plans
   use hb_hdf5, only: h5_dataset_t, h5_file_t, open_file
   use hb_kinds, only: wp
   use hb_motion_result, only: motion_result_t
   use hb_mpi, only: comm_t
   use hb_neighbour, only: neighbour_t
   use hb_outcome, only: is_solved
   use hb_point_source, only: point_source_t
   use hb_progress, only: new_progress, progress_t
   use hb_results, only: create_results, results_t
   use hb_results_layout, only: rank_times_t, results_layout_t
   use hb_study, only: describe_layout, study_t
   use hb_swept_point, only: run_point
   use hb_text, only: to_text
   use kernel_times, only: has_kernels, kernel_names, kernel_times_t, kernel_words, measure_kernels, median, &
      memory_bandwidth, yardstick_words
   use process_memory, only: memory_peak, memory_resident, release_memory, reset_memory_peak
   implicit none
   private
   public :: bench_options_t, part, point_cost_t, run_bench

   !> Parts of the time of a point; wall time but for the last.
   type :: part_t
      integer :: setup = 1
      integer :: solver = 2
      integer :: recovery = 3
      integer :: error_estimate = 4
      integer :: total = 5                                            !! of all of them
      integer :: cpu = 6                                              !! `total` as processor time, of all threads
   end type part_t
   type(part_t), parameter :: part = part_t()
   character(*), parameter :: part_names(6) = [character(14) :: "setup", "solver", "recovery", "error_estimate", "total", "cpu"]
   character(*), parameter :: part_words(6) = [character(75) :: &
      "wall time of the set-up: input, dynamic stiffness, plans, first guess", "wall time of the iterations", &
      "wall time of the recovery: motion of all degrees of freedom, forces", "wall time of the error estimate", &
      "wall time of the point: the sum of these", "processor time of the point, of all threads"]

   !> How to measure.
   type :: bench_options_t
      character(:), allocatable :: path                               !! of the file
      logical :: overwrite = .false.                                  !! an existing file may be replaced
      integer :: repeats = 3                                          !! solutions of each point
      real(wp) :: budget = 0.5_wp                                     !! [s] for each kernel of each point; 0: no kernels
      integer :: level = 0                                            !! how much to tell, one of hb_progress%log_level
   end type bench_options_t

   !> What one point costs.
   type :: point_cost_t
      type(motion_result_t) :: result                                  !! of the first time
      real(wp), allocatable :: seconds(:, :)                          !! (parts, repeats)
      real(wp) :: memory = 0.0_wp                                     !! largest addition [byte]; 0: not known
      type(kernel_times_t) :: kernels
   end type point_cost_t

contains

   !> Solves all points so many times, times their kernels, and writes the file. What is wrong with a single point becomes its
   !> status and message.
   subroutine run_bench(study, options, comm, costs, error)
      type(study_t), intent(in) :: study
      type(bench_options_t), intent(in) :: options
      type(comm_t), intent(in) :: comm                                !! of one process
      type(point_cost_t), allocatable, intent(out) :: costs(:)        !! (n_points)
      type(error_t), allocatable, intent(out) :: error
      type(results_t) :: results
      type(results_layout_t) :: layout
      type(error_t), allocatable :: error_in_close
      real(wp) :: bandwidth
      integer :: i

      call describe_layout(study, 1, layout)
      call create_results(results, options%path, layout, options%overwrite, comm, error)
      if (allocated(error)) return
      call solve_points(study, options, layout, costs)
      do i = 1, size(costs)
         call results%write_point(i, costs(i)%result, error)
         if (allocated(error)) exit
      end do
      call results%close(error_in_close)
      if (.not. allocated(error)) call move_alloc(error_in_close, error)
      if (allocated(error)) return
      bandwidth = ieee_value(1.0_wp, ieee_quiet_nan)
      if (options%budget > 0.0_wp) then
         bandwidth = memory_bandwidth()
         call time_kernels(study, options%budget, costs, error)
         if (allocated(error)) return
      end if
      call add_costs(options%path, costs, bandwidth, error)
      call annotate(error, "result file '"//options%path//"'")
   end subroutine run_bench

   !> Solves every point once to load libraries, not counted, and then as often as requested.
   subroutine solve_points(study, options, layout, costs)
      type(study_t), intent(in) :: study
      type(bench_options_t), intent(in) :: options
      type(results_layout_t), intent(in) :: layout
      type(point_cost_t), allocatable, intent(out) :: costs(:)
      type(point_cost_t) :: warm_up
      type(progress_t) :: progress
      integer :: failed, i, repeat, step

      associate (n => study%plan%n_points, repeats => options%repeats)
         allocate (costs(n))
         do i = 1, n
            allocate (costs(i)%seconds(size(part_names), repeats), source=0.0_wp)
         end do
         allocate (warm_up%seconds(size(part_names), 1))
         call solve_from_nothing(study, layout, 1, 1, warm_up)
         call new_progress(progress, n*repeats, options%level, is_first=.true., what="solutions")
         failed = 0
         do repeat = 1, repeats
            do step = 1, n
               i = merge(step, n + 1 - step, modulo(repeat, 2) == 1)
               call solve_from_nothing(study, layout, i, repeat, costs(i))
               if (.not. is_solved(costs(i)%result%status)) failed = failed + 1
               call progress%show((repeat - 1)*n + step, failed)
            end do
         end do
         call progress%finish(n*repeats, failed)
      end associate
   end subroutine solve_points

   !> Solves point i from nothing; the first time keeps what it gives, each time how long it takes.
   subroutine solve_from_nothing(study, layout, i, repeat, cost)
      type(study_t), intent(in) :: study
      type(results_layout_t), intent(in) :: layout
      integer, intent(in) :: i, repeat
      type(point_cost_t), intent(inout) :: cost
      type(point_source_t), target :: source
      type(neighbour_t) :: nobody
      type(motion_result_t) :: result
      type(rank_times_t) :: times
      real(wp) :: begun, ended, cpu_begun, cpu_ended, resident
      logical :: has_peak

      call release_memory()
      call forget_plans()
      source%plan = study%plan
      source%layout = layout
      source%available_memory = study%available_memory
      source%callbacks = study%callbacks
      resident = memory_resident()
      call reset_memory_peak(has_peak)
      call cpu_time(cpu_begun)
      begun = wall_clock()
      source%document = study%document
      call run_point(source, i, nobody, times=times, result=result)
      ended = wall_clock()
      call cpu_time(cpu_ended)
      if (has_peak) cost%memory = max(cost%memory, memory_peak() - resident)
      associate (seconds => cost%seconds(:, repeat))
         seconds(part%setup) = times%reading + result%setup_seconds
         seconds(part%solver) = result%solver_seconds
         seconds(part%error_estimate) = result%error_estimate_seconds
         seconds(part%total) = ended - begun
         seconds(part%cpu) = cpu_ended - cpu_begun
         seconds(part%recovery) = seconds(part%total) - sum(seconds([part%setup, part%solver, part%error_estimate]))
      end associate
      if (repeat == 1) cost%result = result
   end subroutine solve_from_nothing

   !> Times the kernels of those points that have any.
   subroutine time_kernels(study, budget, costs, error)
      type(study_t), intent(in) :: study
      real(wp), intent(in) :: budget                                  !! [s]
      type(point_cost_t), intent(inout) :: costs(:)
      type(error_t), allocatable, intent(out) :: error
      type(document_t) :: document
      integer :: i

      do i = 1, size(costs)
         document = study%document
         call study%plan%apply(i, document)
         call measure_kernels(costs(i)%kernels, document, budget, error)
         if (allocated(error)) then
            call annotate(error, "point "//to_text(i))
            return
         end if
      end do
   end subroutine time_kernels

   !> Adds the costs to the result file, a dataset each with a value a point; docs/user/schema.md lists them.
   subroutine add_costs(path, costs, bandwidth, error)
      character(*), intent(in) :: path
      type(point_cost_t), intent(in) :: costs(:)
      real(wp), intent(in) :: bandwidth                               !! of the memory [B/s], NaN: not measured
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: error_in_close
      type(h5_file_t) :: file
      type(h5_dataset_t) :: points
      real(wp) :: values(size(costs))
      integer :: i, k

      call open_file(file, path, error, for_writing=.true.)
      if (.not. allocated(error)) call file%open_dataset("point", points, error)
      if (.not. allocated(error)) call file%set_attribute("threads", threads_text(), error)
      do k = 1, size(part_names)
         call add_part("bench_"//trim(part_names(k))//"_seconds", trim(part_words(k)), k)
      end do
      values = costs%memory
      where (values <= 0.0_wp) values = ieee_value(1.0_wp, ieee_quiet_nan)
      call add("bench_memory_peak", values, "byte", "most memory in use beyond that before the point")
      if (any([(has_kernels(costs(i)%kernels), i=1, size(costs))])) then
         call add("bench_n_samples", real(costs%kernels%n_samples, wp), "1", "samples of the torus")
         call add("bench_n_channels", real(costs%kernels%n_channels, wp), "1", "degrees of freedom that are transformed")
         call add("bench_memory_bandwidth", spread(bandwidth, 1, size(costs)), "byte/s", "triad over long arrays")
         do k = 1, size(kernel_names)
            call add_kernel("kernel_"//trim(kernel_names(k)), trim(kernel_words(k)), trim(yardstick_words(k)), k)
         end do
      end if
      call file%close(error_in_close)
      if (.not. allocated(error)) call move_alloc(error_in_close, error)

   contains

      subroutine add_part(name, what, k)
         character(*), intent(in) :: name, what
         integer, intent(in) :: k
         real(wp) :: middle(size(costs)), least(size(costs)), most(size(costs))
         integer :: i

         do i = 1, size(costs)
            middle(i) = median(costs(i)%seconds(k, :))
            least(i) = minval(costs(i)%seconds(k, :))
            most(i) = maxval(costs(i)%seconds(k, :))
         end do
         call add(name, middle, "s", what//", median of the repeats")
         call add(name//"_min", least, "s", what//", least of the repeats")
         call add(name//"_max", most, "s", what//", most of the repeats")
      end subroutine add_part

      subroutine add_kernel(name, what, yardstick, k)
         character(*), intent(in) :: name, what, yardstick
         integer, intent(in) :: k

         associate (kernels => costs%kernels)
            call add(name//"_seconds", kernels%seconds(k), "s", what//", median of the repeats")
            call add(name//"_seconds_first", kernels%first(k), "s", what//", the first time")
            call add(name//"_seconds_min", kernels%fastest(k), "s", what//", least of the repeats")
            call add(name//"_seconds_max", kernels%slowest(k), "s", what//", most of the repeats")
            call add(name//"_yardstick", kernels%yardstick(k), "s", yardstick//", median of the repeats")
            call add(name//"_ratio", kernels%ratio(k), "1", what//" over "//yardstick//", median")
            call add(name//"_ratio_low", kernels%ratio_low(k), "1", what//" over "//yardstick//", lower quartile")
            call add(name//"_ratio_high", kernels%ratio_high(k), "1", what//" over "//yardstick//", upper quartile")
         end associate
      end subroutine add_kernel

      subroutine add(name, column, units, long_name)
         character(*), intent(in) :: name, units, long_name
         real(wp), intent(in) :: column(:)

         call file%store(name, column, [points], units, long_name, error)
      end subroutine add
   end subroutine add_costs

   !> What the environment says of threads, on which all times depend.
   function threads_text() result(text)
      character(:), allocatable :: text
      character(*), parameter :: names(2) = [character(20) :: "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"]
      character(32) :: value
      integer :: i, status

      text = ""
      do i = 1, size(names)
         call get_environment_variable(trim(names(i)), value, status=status)
         if (status /= 0) value = "not set"
         if (i > 1) text = text//", "
         text = text//trim(names(i))//" "//trim(value)
      end do
   end function threads_text
end module bench_points
