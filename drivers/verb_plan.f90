!> `nhbm plan`: estimates the size of the result file of an input and the duration of a run on any number of ranks.
module verb_plan
   use arguments, only: arguments_t, read_numbers
   use console, only: say
   use hb_error, only: annotate, error_t, fail
   use hb_file_location, only: check_source
   use hb_hdf5, only: h5_file_t, open_file
   use hb_kinds, only: wp
   use hb_mpi, only: comm_t, rank_of
   use hb_study, only: row_of_study, study_t
   use hb_text, only: number_of, parse_real, to_text
   use next_step, only: option_of, shell_word
   use verb_solve, only: load_study
   implicit none
   private
   public :: run_plan

contains

   !> Runs the verb on rank 0. Times require the seconds of a point, or a result file with those of a smaller run.
   subroutine run_plan(options, comm, error)
      type(arguments_t), intent(in) :: options
      type(comm_t), intent(in) :: comm
      type(error_t), allocatable, intent(out) :: error
      type(study_t) :: study
      real(wp) :: mean, most, n_points
      integer, allocatable :: ranks(:)
      integer :: line, task

      call load_study(options, comm, study, error)
      if (allocated(error) .or. rank_of(comm) > 0) return
      line = study%plan%n_fastest()
      n_points = real(study%plan%n_points, wp)
      if (allocated(options%points)) call read_positive("--points", options%points, n_points, error)
      if (allocated(error)) return
      n_points = real(line, wp)*aint((n_points + line - 1)/line)      ! whole lines of the grid
      ranks = [1, 10, 100, 1000, 10000]
      if (allocated(options%ranks)) call read_numbers("--ranks", options%ranks, 1, ranks, error)
      mean = 0.0_wp
      if (.not. allocated(error)) call read_seconds(options, mean, most, error)
      if (allocated(error)) return
      call say_size(study, n_points)
      task = merge(study%model%options%chain%length, 1, study%model%options%chain%is_on)
      if (allocated(study%plan%curve)) task = line                    ! curves are drawn as a whole
      if (mean > 0.0_wp) call write_times(ranks, n_points, task, mean, most)
      if (options%n_parts > 0) call write_array(study, options, mean, error)
   end subroutine run_plan

   !> Writes the command of the jobs of an array, and that which merges their results.
   subroutine write_array(study, options, mean, error)
      type(study_t), intent(in) :: study
      type(arguments_t), intent(in) :: options
      real(wp), intent(in) :: mean                                    !! [s] of a point; 0: not known
      type(error_t), allocatable, intent(out) :: error
      character(:), allocatable :: line, name
      character(9) :: seconds
      integer :: group, i, most

      call study%plan%largest_array(options%n_parts, group, most)
      if (group == 0) then
         line = "the input has no &sweep that jobs could share"
         if (most > 0) line = "at most "//number_of(most, "job")//" can share the sweep, whose longest axis has as many values"
         call fail(error, "--array "//to_text(options%n_parts)//": "//line)
         return
      end if
      name = options%result_path()
      name = name(:len(name) - len(".h5"))
      line = "   nhbm solve "//shell_word(options%input)
      do i = 1, size(options%overrides)
         line = line//option_of(options%overrides(i)%value)
      end do
      call say(number_of(options%n_parts, "job")//", K = 1 to "//to_text(options%n_parts)//", each with a part of the values "// &
               "of "//study%plan%parameters(group)%path//":")
      call say(line//" --set 'sweep("//to_text(group)//")%part=K,"//to_text(options%n_parts)//"' -o "//shell_word(name//"_K.h5"))
      call say("then one file of all:")
      call say("   nhbm merge "//shell_word(name//".h5")//" "//shell_word(name)//"_*.h5")
      write (seconds, "(es9.1)") mean*study%plan%n_expected()/options%n_parts
      if (mean > 0.0_wp) call say("A job takes "//trim(adjustl(seconds))//" s on one rank, on average.")
   end subroutine write_array

   !> Prints the size of the result file. If each point has its own harmonics, that with the initial ones: the space for the most
   !> that there may be is reserved without being written.
   subroutine say_size(study, n_points)
      type(study_t), intent(in) :: study
      real(wp), intent(in) :: n_points
      character(:), allocatable :: text
      real(wp) :: bytes_per_point, most
      integer :: n, n_datasets

      call row_of_study(study, bytes_per_point, n_datasets)
      text = ""
      if (study%model%options%accuracy%grows_set) then
         n = study%model%discretisation%harmonics%n_harmonics
         most = bytes_per_point
         call row_of_study(study, bytes_per_point, n_datasets, n)
         text = " with "//number_of(n, "harmonic")//" a point; the file looks "//size_text(n_points*most)// &
                " large until the run ends, with room for "//to_text(size(study%tuples, 2))//" harmonics that is not written"
      end if
      call say(rounded(n_points)//" point"//trim(merge("s", " ", n_points > 1.0_wp))//" of "//to_text(nint(bytes_per_point))// &
               " B in "//to_text(n_datasets)//" datasets: "//size_text(n_points*bytes_per_point)//text)
   end subroutine say_size

   !> Seconds of a point: the mean, and those of the slowest.
   subroutine read_seconds(options, mean, most, error)
      type(arguments_t), intent(in) :: options
      real(wp), intent(inout) :: mean
      real(wp), intent(out) :: most
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: ignored
      type(h5_file_t) :: file
      real(wp), allocatable :: seconds(:)

      if (allocated(options%cost)) call read_positive("--cost", options%cost, mean, error)
      most = mean
      if (allocated(error) .or. .not. allocated(options%cost_from)) return
      call check_source(options%cost_from, error)
      if (.not. allocated(error)) call open_file(file, options%cost_from, error)
      if (.not. allocated(error)) then
         call file%get("solve_seconds", seconds, error)
         call file%close(ignored)
      end if
      if (.not. allocated(error)) then
         seconds = pack(seconds, seconds > 0.0_wp)
         if (size(seconds) == 0) call fail(error, "no point was solved")
      end if
      call annotate(error, "--cost-from '"//options%cost_from//"'")
      if (allocated(error)) return
      mean = sum(seconds)/size(seconds)
      most = maxval(seconds)
   end subroutine read_seconds

   !> A number greater than 0.
   subroutine read_positive(name, text, value, error)
      character(*), intent(in) :: name, text
      real(wp), intent(inout) :: value
      type(error_t), allocatable, intent(out) :: error
      logical :: is_right

      call parse_real(text, value, is_right)
      if (is_right) is_right = value > 0.0_wp .and. value <= huge(value)
      if (.not. is_right) call fail(error, name//": '"//text//"' is not a number greater than 0")
   end subroutine read_positive

   !> Writes the wall time for each number of ranks. Ranks draw tasks until there are none left (hb_schedule), so the
   !> last rank ends at most one slow task after the mean; the start, the creation of the file and a slow file system
   !> are not included.
   subroutine write_times(ranks, n_points, task, mean, most)
      integer, intent(in) :: ranks(:)
      real(wp), intent(in) :: n_points
      integer, intent(in) :: task                                     !! points that one rank solves in order
      real(wp), intent(in) :: mean, most                              !! [s] of a point
      character(80) :: row
      real(wp) :: n_tasks, seconds
      integer :: i

      call say("     ranks    seconds  efficiency")
      n_tasks = aint((n_points + task - 1)/task)
      do i = 1, size(ranks)
         seconds = max(task*mean*aint((n_tasks + ranks(i) - 1)/ranks(i)), n_points*mean/ranks(i) + task*(most - mean))
         write (row, "(i10, es11.3, f12.4)") ranks(i), seconds, n_points*mean/(ranks(i)*seconds)
         call say(trim(row))
      end do
   end subroutine write_times

   !> A size of a file, in the unit in which it has one to three digits before the point.
   function size_text(bytes) result(text)
      real(wp), intent(in) :: bytes
      character(:), allocatable :: text
      character(2), parameter :: units(5) = ["B ", "kB", "MB", "GB", "TB"]
      character(12) :: buffer
      real(wp) :: value
      integer :: i

      i = max(1, min(size(units), 1 + int(log10(max(bytes, 1.0_wp))/3.0_wp)))
      value = bytes/1.0e3_wp**(i - 1)
      write (buffer, "(f12.1)") value
      if (value >= 10.0_wp) write (buffer, "(i12)") nint(min(value, 1.0e9_wp))
      text = trim(adjustl(buffer))//" "//trim(units(i))
   end function size_text

   !> A number, whole or with three decimals.
   function rounded(value) result(text)
      real(wp), intent(in) :: value
      character(:), allocatable :: text
      character(40) :: buffer

      if (value >= 1.0e15_wp) then
         write (buffer, "(es10.3)") value
      else if (value >= 0.0_wp .and. value - aint(value) <= 0.0_wp) then
         write (buffer, "(f32.0)") value
         buffer = buffer(:len_trim(buffer) - 1)
      else
         write (buffer, "(f32.3)") value
      end if
      text = trim(adjustl(buffer))
   end function rounded
end module verb_plan
