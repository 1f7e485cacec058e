!> `nhbm plan`: says how large the result file of an input becomes and how a run of it would go on any number of ranks.
module verb_plan
   use arguments, only: arguments_t
   use console, only: say
   use hb_closest_word, only: closest_word
   use hb_counter_speed, only: measure_counter
   use hb_error, only: annotate, error_t, fail
   use hb_file_place, only: check_place, check_source
   use hb_hdf5, only: h5_file_t, open_file
   use hb_row_buffer, only: hold_seconds
   use hb_kinds, only: wp
   use hb_mpi, only: comm_t, rank_of, size_of
   use hb_schedule, only: new_schedule, ranks_per_counter, schedule_t
   use hb_simulation, only: forecast_t, lognormal_costs, machine_t, simulate, stretched_costs, tasks_t
   use hb_study, only: row_of_study, study_t
   use hb_text, only: join, parse_real, split, string_t, to_text
   use result_place, only: place_result
   use verb_solve, only: load_study
   implicit none
   private
   public :: run_plan

   character(13), parameter :: machine_keys(7) = [character(13) :: "latency", "counter_rate", "write_latency", &
      "write_rate", "bandwidth", "hold", "group_size"]
   character(*), parameter :: columns = "ranks,points,seconds,efficiency,drawing,writing,idle,draws,writes,bytes,"// &
      "counter_load,file_load"
   integer, parameter :: most_ranks = 10000000, most_points = 200000000

contains

   !> Runs the verb on rank 0. Several ranks measure how fast a shared counter is among them, for a machine like this one.
   subroutine run_plan(options, comm, error)
      type(arguments_t), intent(in) :: options
      type(comm_t), intent(in) :: comm
      type(error_t), allocatable, intent(out) :: error
      type(study_t) :: study
      type(tasks_t) :: tasks
      type(machine_t) :: machine
      real(wp), allocatable :: ranks(:)
      character(128) :: measured
      character(:), allocatable :: path
      integer :: chain, group_size, line, n_points

      if (allocated(options%output)) then
         call place_result(options, comm, path, error)
         if (.not. allocated(error)) call check_place(path, options%overwrite, error)
         call annotate(error, "'"//options%output//"' cannot be written")
         if (allocated(error)) return
      end if
      call load_study(options, comm, study, error)
      if (allocated(error)) return
      if (size_of(comm) > 1) call measure_counter(comm, machine%latency, machine%counter_rate, error)
      if (allocated(error) .or. rank_of(comm) > 0) return
      if (size_of(comm) > 1) then
         write (measured, "(a, es7.1, a, es7.1)") "measured among "//to_text(size_of(comm))//" ranks: latency=", &
            machine%latency, " counter_rate=", machine%counter_rate
         call say(trim(measured))
      end if
      n_points = study%plan%n_points
      line = study%plan%n_fastest()
      chain = merge(study%scene%chain%length, 1, study%scene%chain%is_on)
      if (allocated(study%plan%curve)) chain = line                   ! rooms of points are drawn as a whole
      call read_points(options, line, n_points, error)
      if (.not. allocated(error)) call read_costs(options, n_points, tasks, error)
      if (.not. allocated(error)) call read_machine(options%machine, machine, group_size, error)
      if (.not. allocated(error)) call read_ranks(options, ranks, error)
      if (allocated(error)) return
      call row_of_study(study, tasks%bytes_per_point, tasks%writes_per_row)
      call say(to_text(n_points)//" points of "//to_text(nint(tasks%bytes_per_point))//" B in "// &
         to_text(tasks%writes_per_row)//" datasets: "//gigabytes(n_points*tasks%bytes_per_point)//" GB")
      if (.not. allocated(tasks%ends)) return
      call forecast_all(ranks, n_points, line, chain, group_size, tasks, machine, path, error)
   end subroutine run_plan

   subroutine read_points(options, line, n_points, error)
      type(arguments_t), intent(in) :: options
      integer, intent(in) :: line                                     !! points along the fastest parameter
      integer, intent(inout) :: n_points
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: numbers(:)

      if (allocated(options%points)) then
         call read_list("--points", options%points, 1.0_wp, real(most_points, wp), numbers, error)
         if (allocated(error)) return
         n_points = ((nint(numbers(1)) - 1)/line + 1)*line            ! whole lines of the grid
      end if
      if (n_points > most_points) call fail(error, "--points: a simulation takes up to "//to_text(most_points)//" points")
   end subroutine read_points

   !> Costs of all points, if any are given.
   subroutine read_costs(options, n_points, tasks, error)
      type(arguments_t), intent(in) :: options
      integer, intent(in) :: n_points
      type(tasks_t), intent(inout) :: tasks
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: measured(:), numbers(:)

      if (allocated(options%cost_from)) then
         call read_measured(options%cost_from, measured, error)
         call annotate(error, "--cost-from '"//options%cost_from//"'")
         if (.not. allocated(error)) call stretched_costs(n_points, measured, tasks%ends)
      else if (allocated(options%cost)) then
         call read_list("--cost", options%cost, 0.0_wp, 1.0e9_wp, numbers, error)
         if (allocated(error)) return
         if (size(numbers) == 1) numbers = [numbers, 0.0_wp]
         call lognormal_costs(n_points, numbers(1), numbers(2), tasks%ends)
      end if
   end subroutine read_costs

   !> Seconds of all points of a result file that were solved.
   subroutine read_measured(path, measured, error)
      character(*), intent(in) :: path
      real(wp), allocatable, intent(out) :: measured(:)
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: ignored
      type(h5_file_t) :: file
      real(wp), allocatable :: seconds(:)

      call check_source(path, error)
      if (.not. allocated(error)) call open_file(file, path, error)
      if (allocated(error)) return
      call file%get("solve_seconds", seconds, error)
      call file%close(ignored)
      if (allocated(error)) return
      measured = pack(seconds, seconds > 0.0_wp)
      if (size(measured) == 0) call fail(error, "no point was solved")
   end subroutine read_measured

   !> Settings KEY=VALUE of the machine.
   subroutine read_machine(settings, machine, group_size, error)
      type(string_t), intent(in) :: settings(:)
      type(machine_t), intent(inout) :: machine
      integer, intent(out) :: group_size
      type(error_t), allocatable, intent(out) :: error
      character(:), allocatable :: closest, key
      real(wp), allocatable :: numbers(:)
      integer :: equals, i

      group_size = ranks_per_counter
      do i = 1, size(settings)
         equals = index(settings(i)%value//"=", "=")
         key = settings(i)%value(:equals - 1)
         if (all(machine_keys /= key)) then
            closest = closest_word(key, machine_keys)
            if (len(closest) > 0) closest = " did you mean '"//closest//"'?"
            call fail(error, "--machine: unknown key '"//key//"';"//closest//" known: "//join(machine_keys, ", "))
            return
         end if
         call read_list("--machine "//key, settings(i)%value(equals + 1:), 1.0e-9_wp, 1.0e18_wp, numbers, error)
         if (allocated(error)) return
         select case (key)
         case ("latency"); machine%latency = numbers(1)
         case ("counter_rate"); machine%counter_rate = numbers(1)
         case ("write_latency"); machine%write_latency = numbers(1)
         case ("write_rate"); machine%write_rate = numbers(1)
         case ("bandwidth"); machine%bandwidth = numbers(1)
         case ("hold"); machine%hold = numbers(1)
         case default; group_size = max(1, nint(min(numbers(1), real(most_ranks, wp))))
         end select
      end do
   end subroutine read_machine

   subroutine read_ranks(options, ranks, error)
      type(arguments_t), intent(in) :: options
      real(wp), allocatable, intent(out) :: ranks(:)
      type(error_t), allocatable, intent(out) :: error

      ranks = [1.0_wp, 10.0_wp, 100.0_wp, 1.0e3_wp, 1.0e4_wp, 1.0e5_wp]
      if (allocated(options%ranks)) call read_list("--ranks", options%ranks, 1.0_wp, real(most_ranks, wp), ranks, error)
   end subroutine read_ranks

   !> Numbers with commas between them, each within limits; there is one at least.
   subroutine read_list(name, text, least, most, numbers, error)
      character(*), intent(in) :: name, text
      real(wp), intent(in) :: least, most
      real(wp), allocatable, intent(out) :: numbers(:)
      type(error_t), allocatable, intent(out) :: error
      type(string_t), allocatable :: words(:)
      logical :: ok
      integer :: i

      call split(text, ",", words)
      allocate (numbers(size(words)), source=0.0_wp)
      do i = 1, size(words)
         call parse_real(words(i)%value, numbers(i), ok)
         if (ok) ok = numbers(i) >= least .and. numbers(i) <= most
         if (.not. ok) then
            call fail(error, name//": '"//words(i)%value//"' is no number from "//to_text(least)//" to "//to_text(most))
            return
         end if
      end do
   end subroutine read_list

   !> Simulates each number of ranks; the table goes to standard output, and to a file of comma-separated values if asked.
   subroutine forecast_all(ranks, n_points, line, chain, group_size, tasks, machine, path, error)
      real(wp), intent(in) :: ranks(:)
      integer, intent(in) :: n_points, line, chain, group_size
      type(tasks_t), intent(in) :: tasks
      type(machine_t), intent(inout) :: machine
      character(*), intent(in), optional :: path                      !! of a file of comma-separated values
      type(error_t), allocatable, intent(out) :: error
      type(schedule_t) :: schedule
      type(forecast_t) :: forecast
      character(160) :: row
      real(wp) :: n_bytes
      integer :: i, n_ranks, status, unit
      logical :: is_hold_given

      is_hold_given = machine%hold > 0.0_wp
      if (present(path)) then
         open (newunit=unit, file=path, action="write", status="replace", iostat=status)
         if (status /= 0) then
            call fail(error, "'"//path//"' cannot be written; give another --output")
            return
         end if
         write (unit, "(a)") columns
      end if
      call say("     ranks    seconds  efficiency   drawing   writing      idle      draws    writes/s"// &
         "        B/s  counter     file")
      n_bytes = n_points*tasks%bytes_per_point
      do i = 1, size(ranks)
         n_ranks = nint(ranks(i))
         if (.not. is_hold_given) machine%hold = hold_seconds(n_ranks, tasks%writes_per_row)
         call new_schedule(schedule, n_points, line, chain, n_ranks, machine%hold, group_size)
         call simulate(schedule, n_ranks, tasks, machine, forecast)
         write (row, "(i10, es11.3, f12.4, 3f10.4, 3es11.2, 2f9.4)") n_ranks, forecast%seconds, forecast%efficiency, &
            forecast%drawing, forecast%writing, forecast%idle, forecast%draws, forecast%writes/forecast%seconds, &
            n_bytes/forecast%seconds, forecast%counter_load, forecast%file_load
         call say(trim(row))
         if (present(path)) write (unit, "(i0, ',', i0, 10(',', es13.6))") n_ranks, n_points, forecast%seconds, &
            forecast%efficiency, forecast%drawing, forecast%writing, forecast%idle, forecast%draws, forecast%writes, n_bytes, &
            forecast%counter_load, forecast%file_load
      end do
      if (present(path)) close (unit)
   end subroutine forecast_all

   function gigabytes(n_bytes) result(text)
      real(wp), intent(in) :: n_bytes
      character(:), allocatable :: text
      character(24) :: buffer

      write (buffer, "(f20.3)") n_bytes*1.0e-9_wp
      text = trim(adjustl(buffer))
   end function gigabytes
end module verb_plan
