!> The command line of nhbm.
module arguments
   use command_table, only: long_name, option_names, options_of, takes_value, verb_names
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   use hb_progress, only: log_level, log_level_names
   use hb_similar_word, only: closest_word
   use hb_text, only: add_string, join, lower, parse_integer, parse_real, split, string_t, to_text
   implicit none
   private
   public :: argument_list, arguments_t, is_more_points, read_arguments, read_numbers

   type :: arguments_t
      character(:), allocatable :: verb
      character(:), allocatable :: input                              !! path of the input file, or of a result file
      type(string_t), allocatable :: more_inputs(:)                   !! of info and merge: further result files
      character(:), allocatable :: output                             !! path of the result file
      type(string_t), allocatable :: overrides(:)                     !! path=value
      integer :: point = -1                                           !! number of a point of the sweep, from 0; -1: not given
      integer :: n_periods = 0                                        !! 0: not given
      integer :: n_starts = 200, seed = 1                             !! of census
      logical :: overwrite = .false.
      logical :: resumes = .false.                                    !! continue with an existing result file
      logical :: retries = .false.                                    !! also solve again the points that did not converge
      real(wp) :: time_limit = huge(1.0_wp)                           !! [s]
      integer :: n_workers = 0                                        !! processes that solve points; 0: not given
      integer :: level = log_level%normal                             !! amount of output
      logical :: wants_check = .false.                                !! of info: check the rows for damage
      logical :: is_json = .false.                                    !! of keys: for programs
      logical :: wants_help = .false.
      logical :: wants_version = .false.
      character(:), allocatable :: ranks, cost, cost_from             !! of plan
      integer :: n_parts = 0                                          !! of plan: jobs of an array; 0: not given
      character(:), allocatable :: points                             !! of plan their number, of verify a list
      type(string_t), allocatable :: given(:)                         !! long names of the options that were given
   contains
      procedure :: result_path => arguments_result_path
   end type arguments_t

contains

   !> The words of the command line.
   function argument_list() result(words)
      type(string_t), allocatable :: words(:)
      integer :: i, length

      allocate (words(command_argument_count()))
      do i = 1, size(words)
         call get_command_argument(i, length=length)
         allocate (character(length) :: words(i)%value)
         call get_command_argument(i, words(i)%value)
      end do
   end function argument_list

   !> Sorts the words into verb, options and input file.
   subroutine read_arguments(self, words, error)
      type(arguments_t), intent(out) :: self
      type(string_t), intent(in) :: words(:)
      type(error_t), allocatable, intent(out) :: error
      character(:), allocatable :: name, value
      integer :: i
      logical :: has_value
      logical :: options_ended                                        !! by `--`: only words follow

      allocate (self%overrides(0), self%given(0), self%more_inputs(0))
      options_ended = .false.
      i = 1
      do while (i <= size(words))
         if (.not. options_ended .and. words(i)%value == "--") then
            options_ended = .true.
         else if (.not. options_ended .and. index(words(i)%value, "-") == 1) then
            call cut_option(self, words(i)%value, name, value, has_value, error)
            if (allocated(error)) return
            if (takes_value(name) .and. .not. has_value) then
               i = i + 1
               if (i <= size(words)) value = words(i)%value
            end if
            call store_option(self, name, value, has_value, error)
         else
            call store_word(self, words(i)%value, error)
         end if
         if (allocated(error)) return
         i = i + 1
      end do
      call check_combination(self, error)
   end subroutine read_arguments

   !> Stores a word that is not an option: first the verb, then the file.
   subroutine store_word(self, word, error)
      type(arguments_t), intent(inout) :: self
      character(*), intent(in) :: word
      type(error_t), allocatable, intent(out) :: error

      if (.not. allocated(self%verb)) then
         self%verb = word
      else if (.not. allocated(self%input)) then
         self%input = word
      else if (self%verb == "info" .or. self%verb == "merge") then
         call add_string(self%more_inputs, word)
      else if (self%verb == "keys") then
         call fail(error, "unexpected argument '"//word//"'; several words need quotes: nhbm keys '"//self%input//" "//word//"'")
      else
         call fail(error, "unexpected argument '"//word//"'; the file is '"//self%input//"'")
      end if
   end subroutine store_word

   !> Splits `--name=value`, `--name` or `-n` into the long name and the value, which is empty if there is none.
   subroutine cut_option(self, word, name, value, has_value, error)
      type(arguments_t), intent(in) :: self                           !! as far as read: the verb
      character(*), intent(in) :: word
      character(:), allocatable, intent(out) :: name, value
      logical, intent(out) :: has_value
      type(error_t), allocatable, intent(out) :: error
      character(:), allocatable :: closest, given
      character(12), allocatable :: known(:)
      integer :: equals

      equals = 0
      if (index(word, "--") == 1) equals = index(word, "=")
      given = word
      value = ""
      has_value = equals > 0
      if (has_value) then
         given = word(:equals - 1)
         value = word(equals + 1:)
      end if
      name = long_name(given)
      if (name == "") then
         allocate (known, source=option_names())
         if (allocated(self%verb)) then
            if (any(verb_names() == self%verb)) known = option_names(self%verb)
         end if
         closest = trim(closest_word(given, known))
         if (len(closest) > 0) closest = " did you mean '"//closest//"'?"
         call fail(error, "unknown option '"//given//"';"//closest//" known: "//join(known, ", "))
      end if
   end subroutine cut_option

   !> Stores an option.
   subroutine store_option(self, name, value, has_value, error)
      type(arguments_t), intent(inout) :: self
      character(*), intent(in) :: name                                !! the long one
      character(*), intent(in) :: value
      logical, intent(in) :: has_value                                !! it is a part of the same word
      type(error_t), allocatable, intent(out) :: error

      call add_string(self%given, name)
      if (takes_value(name)) then
         if (len(value) == 0) then
            call fail(error, name//" needs a value")
         else
            call store_value(self, name, value, error)
         end if
         return
      else if (has_value) then
         call fail(error, name//" takes no value, there is '"//value//"'")
         return
      end if
      select case (name)
      case ("--check"); self%wants_check = .true.
      case ("--json"); self%is_json = .true.
      case ("--help"); self%wants_help = .true.
      case ("--version"); self%wants_version = .true.
      case ("--overwrite"); self%overwrite = .true.
      case ("--quiet"); self%level = log_level%quiet
      case ("--verbose"); self%level = log_level%verbose
      case ("--resume"); self%resumes = .true.
      case ("--retry"); self%retries = .true.
      end select
   end subroutine store_option

   !> Stores the value of an option that has one.
   subroutine store_value(self, option, value, error)
      type(arguments_t), intent(inout) :: self
      character(*), intent(in) :: option, value
      type(error_t), allocatable, intent(out) :: error

      select case (option)
      case ("--set"); call store_override(self, value, error)
      case ("--unset")
         call add_string(self%overrides, value//"=")
         if (index(value, "=") > 0) call fail(error, "--unset takes a path without a value, not '"//value//"'")
      case ("--ranks"); self%ranks = value
      case ("--points"); self%points = value
      case ("--point"); call read_number(option, value, 0, self%point, error)
      case ("--periods"); call read_number(option, value, 2, self%n_periods, error)
      case ("--starts"); call read_number(option, value, 0, self%n_starts, error)
      case ("--seed"); call read_number(option, value, 0, self%seed, error)
      case ("--workers"); call read_number(option, value, 1, self%n_workers, error)
      case ("--array"); call read_number(option, value, 1, self%n_parts, error)
      case ("--cost"); self%cost = value
      case ("--cost-from"); self%cost_from = value
      case ("--time-limit"); call read_time_limit(value, self%time_limit, error)
      case ("--log-level")
         self%level = findloc(log_level_names == value, .true., dim=1) - 1
         if (self%level < 0) call fail(error, "unknown log level '"//value//"'; known: "//join(log_level_names, ", "))
      case default; self%output = value
      end select
   end subroutine store_value

   !> Stores path=value. Without a value, as from an empty variable of the shell, it would remove the key.
   subroutine store_override(self, assignment, error)
      type(arguments_t), intent(inout) :: self
      character(*), intent(in) :: assignment
      type(error_t), allocatable, intent(out) :: error
      integer :: equals

      call add_string(self%overrides, assignment)
      equals = index(assignment, "=")
      if (equals == 0 .or. len_trim(assignment(equals + 1:)) > 0) return
      call fail(error, "--set "//assignment//" has no value; --unset "//assignment(:equals - 1)//" removes the key")
   end subroutine store_override

   !> Reads a whole number with a lower bound.
   subroutine read_number(option, text, least, number, error)
      character(*), intent(in) :: option, text
      integer, intent(in) :: least
      integer, intent(inout) :: number                                !! unchanged if there is none
      type(error_t), allocatable, intent(out) :: error
      logical :: is_number
      integer :: found

      call parse_integer(text, found, is_number)
      if (is_number .and. found >= least) then
         number = found
      else
         call fail(error, option//" needs a whole number, "//to_text(least)//" or more, not '"//text//"'")
      end if
   end subroutine read_number

   !> Reads whole numbers separated by commas, each with a lower bound.
   subroutine read_numbers(option, text, least, numbers, error)
      character(*), intent(in) :: option, text
      integer, intent(in) :: least
      integer, allocatable, intent(out) :: numbers(:)
      type(error_t), allocatable, intent(out) :: error
      type(string_t), allocatable :: parts(:)
      logical :: is_number
      integer :: i

      call split(text, ",", parts)
      allocate (numbers(size(parts)), source=0)
      do i = 1, size(parts)
         call parse_integer(parts(i)%value, numbers(i), is_number)
         if (is_number .and. numbers(i) >= least) cycle
         call fail(error, option//" needs whole numbers, "//to_text(least)//" or more, separated by commas, not '"//text//"'")
         return
      end do
   end subroutine read_numbers

   subroutine read_time_limit(text, seconds, error)
      character(*), intent(in) :: text
      real(wp), intent(out) :: seconds
      type(error_t), allocatable, intent(out) :: error
      logical :: ok

      call parse_real(text, seconds, ok)
      if (ok) ok = seconds >= 0.0_wp .and. seconds <= huge(seconds)
      if (.not. ok) call fail(error, "--time-limit needs seconds, such as 3600, not '"//text//"'")
   end subroutine read_time_limit

   !> Rejects options that contradict each other.
   subroutine check_combination(self, error)
      type(arguments_t), intent(in) :: self
      type(error_t), allocatable, intent(out) :: error
      logical :: changes, is_resume
      integer :: i

      is_resume = .false.
      if (allocated(self%verb)) is_resume = self%verb == "resume"
      changes = .not. all([(is_more_points(self%overrides(i)%value), i=1, size(self%overrides))])
      if (is_resume .and. (allocated(self%output) .or. changes)) then
         call fail(error, "resume takes the input from the result file and continues in it: no --output, no --unset, "// &
                   "no --set but curve%points=N, more points for its curves")
      else if (is_resume .and. self%overwrite) then
         call fail(error, "resume continues a result file; solve --overwrite makes it anew")
      else if (self%resumes .and. self%overwrite) then
         call fail(error, "--overwrite makes a new result file and --resume continues one; give one of them")
      else if (self%retries .and. .not. (is_resume .or. self%resumes)) then
         call fail(error, "--retry solves points of an existing result file again; it goes with resume or --resume")
      else if (allocated(self%verb)) then
         if (any(verb_names() == self%verb) .and. .not. self%wants_help) call reject_others(self, error)
      end if
   end subroutine check_combination

   !> Whether path=value gives curves another number of points.
   pure logical function is_more_points(assignment)
      character(*), intent(in) :: assignment

      is_more_points = lower(adjustl(assignment(:index(assignment, "=") - 1))) == "curve%points"
   end function is_more_points

   !> Rejects options that the verb does not have.
   subroutine reject_others(self, error)
      type(arguments_t), intent(in) :: self
      type(error_t), allocatable, intent(out) :: error
      character(:), allocatable :: closest
      integer :: i

      do i = 1, size(self%given)
         if (any(option_names(self%verb) == self%given(i)%value) .or. self%wants_version) cycle
         closest = trim(closest_word(self%given(i)%value, option_names(self%verb)))
         if (len(closest) > 0) closest = " did you mean "//closest//"?"
         call fail(error, self%verb//" has no option "//self%given(i)%value//";"//closest//" it has "//options_of(self%verb))
         return
      end do
   end subroutine reject_others

   !> Path of the result: --output, or the name of the input without its folder, with the ending .h5, in the current
   !> folder; for resume the given file.
   pure function arguments_result_path(self) result(path)
      class(arguments_t), intent(in) :: self
      character(:), allocatable :: path
      integer :: dot

      if (allocated(self%output)) then
         path = self%output
         return
      end if
      path = self%input
      if (self%verb == "resume") return
      path = path(index(path, "/", back=.true.) + 1:)
      dot = index(path, ".", back=.true.)
      if (dot > 1) path = path(:dot - 1)
      path = path//".h5"
   end function arguments_result_path
end module arguments
