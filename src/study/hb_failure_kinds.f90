!> How the points of a result file ended, as lines for people: each kind of failure once, with its message, how many points it has,
!> and the command to try next.
module hb_failure_kinds
   use hb_document, only: document_t
   use hb_error, only: error_t
   use hb_kinds, only: two_pi, wp
   use hb_outcome, only: outcome, outcome_names, outcome_text
   use hb_properties, only: properties_t
   use hb_results_record, only: messages_of
   use hb_scene_tones, only: read_tones
   use hb_sweep_plan, only: sweep_plan_t
   use hb_system, only: file_kind, kind_of_file
   use hb_text, only: number_of, parse_integer, string_t, to_text
   use hb_tones, only: tones_t
   implicit none
   private
   public :: failure_kind_t, find_kinds, next_step, run_names_t, shell_word, status_lines

   integer, parameter :: most_read = 200                              ! messages of a status that are looked at
   integer, parameter :: most_kinds = 3                               ! of a status that are told
   character(*), parameter :: without_bounds(1) = ["jenkins_2d"]      ! laws with states that cvode cannot follow
   integer, parameter :: more = 10                                    ! times a budget that was not enough

   !> Points that ended the same way.
   type :: failure_kind_t
      integer :: status = outcome%pending
      integer :: n_points = 0
      integer :: first = 0                                            !! of the points, from 1
      character(:), allocatable :: message                            !! of that one
   end type failure_kind_t

   !> What a command has to name.
   type :: run_names_t
      character(:), allocatable :: input, result                      !! paths
      type(string_t), allocatable :: overrides(:)                     !! path=value, as they were given
   end type run_names_t

contains

   !> Lines on all points but those that are converged, pending or unused.
   subroutine status_lines(status, names, plan, document, lines)
      integer, intent(in) :: status(:)                                !! (n_points)
      type(run_names_t), intent(in) :: names
      type(sweep_plan_t), intent(in) :: plan
      type(document_t), intent(in) :: document                        !! the input of the run
      type(string_t), allocatable, intent(out) :: lines(:)
      type(failure_kind_t), allocatable :: kinds(:)
      type(string_t), allocatable :: messages(:)
      character(:), allocatable :: said, text
      integer, allocatable :: points(:)
      integer :: i, k, n

      allocate (lines(0))
      do i = outcome%converged + 1, min(maxval(status), ubound(outcome_names, 1))
         n = count(status == i)
         if (n == 0 .or. i == outcome%unused) cycle
         points = pack([(k, k=1, size(status))], status == i)
         lines = [lines, string_t(to_text(n)//" "//outcome_text(i)//" (first: point "//to_text(points(1) - 1)//")")]
         points = points(:min(n, most_read))
         said = ""
         call messages_of(names%result, points, messages)
         call find_kinds(i, points, messages, kinds)
         do k = 1, min(size(kinds), most_kinds)
            text = "point "//to_text(kinds(k)%first - 1)
            if (len(plan%describe(kinds(k)%first)) > 0) text = text//" ("//plan%describe(kinds(k)%first)//")"
            if (size(kinds) > 1 .and. kinds(k)%n_points > 1) text = text//" and "// &
               number_of(kinds(k)%n_points - 1, "other")
            if (len(kinds(k)%message) > 0) lines = [lines, string_t("  "//text//": "//kinds(k)%message)]
            text = next_step(kinds(k), names, plan, document)
            if (len(text) == 0 .or. text == said) cycle
            lines = [lines, string_t("  try: "//text)]
            said = text
         end do
         if (size(kinds) > most_kinds) lines = [lines, string_t("  and "//number_of(size(kinds) - most_kinds, "other message")// &
            "; nhbm-post info "//shell_word(names%result)//" has a row for each point")]
      end do
   end subroutine status_lines

   !> Groups points of one status by their messages, apart from numbers.
   pure subroutine find_kinds(status, points, messages, kinds)
      integer, intent(in) :: status
      integer, intent(in) :: points(:)                                !! from 1, ascending
      type(string_t), intent(in) :: messages(:)                       !! as points
      type(failure_kind_t), allocatable, intent(out) :: kinds(:)
      character(:), allocatable :: form
      integer :: i, k, n

      allocate (kinds(size(points)))
      n = 0
      do i = 1, size(points)
         form = without_numbers(messages(i)%value)
         do k = 1, n
            if (without_numbers(kinds(k)%message) == form) exit
         end do
         n = max(n, k)
         kinds(k)%n_points = kinds(k)%n_points + 1
         if (kinds(k)%n_points > 1) cycle
         kinds(k)%status = status
         kinds(k)%first = points(i)
         kinds(k)%message = messages(i)%value
      end do
      kinds = kinds(:n)
   end subroutine find_kinds

   !> Message up to its list of residuals, without what numbers consist of.
   pure function without_numbers(message) result(form)
      character(*), intent(in) :: message
      character(:), allocatable :: form
      integer :: i, n

      form = message
      n = index(message, "; least residuals:")
      if (n > 0) form = message(:n - 1)
      n = 0
      do i = 1, len(form)
         if (index("0123456789.+-Ee", form(i:i)) > 0) cycle
         n = n + 1
         form(n:n) = form(i:i)
      end do
      form = form(:n)
   end function without_numbers

   !> The command to try where points ended like this; empty where there is nothing to be tried.
   function next_step(kind, names, plan, document) result(text)
      type(failure_kind_t), intent(in) :: kind
      type(run_names_t), intent(in) :: names
      type(sweep_plan_t), intent(in) :: plan
      type(document_t), intent(in) :: document                        !! the input of the run
      character(:), allocatable :: text
      type(document_t), target :: here
      type(error_t), allocatable :: error
      type(tones_t) :: tones
      character(:), allocatable :: guess
      integer, allocatable :: numbers(:)
      logical :: rescues
      real(wp) :: oversampling

      text = ""
      if (kind_of_file(names%input) == file_kind%none) return         ! the input of a motion that leaves a curve has no file
      here = document
      call plan%apply(kind%first, here)
      call here%begin()
      call read_tones(tones, here, error)
      if (allocated(error)) return
      select case (kind%status)
      case (outcome%stalled, outcome%out_of_budget, outcome%singular, outcome%not_finite, outcome%diverged, outcome%timed_out)
         if (index(kind%message, "raise &solver ") > 0) then
            text = raised(kind%message(index(kind%message, "raise &solver ") + 14:))
         else
            rescues = .true.
            guess = "auto"
            call read_solver(rescues, guess)
            if (.not. rescues) then
               text = solve_with("solver%rescue=.true.")
            else if (guess /= "march" .and. .not. any(tones%is_unknown)) then
               text = solve_with("solver%first_guess='march'")
            end if
         end if
         if (len(text) == 0) text = march_from_rest()
      case (outcome%truncated, outcome%penetrating)
         numbers = numbers_of("harmonics", "order")
         if (size(numbers) > 0) then
            text = solve_with("harmonics%order="//list_of(2*max(numbers, 1)))
         else if (numbers_are_absent("harmonics", "tuples")) then
            text = solve_with("accuracy%max_work="//to_text(more*real_of("accuracy", "max_work", 60.0_wp)))
         end if
      case (outcome%aliased)
         numbers = numbers_of("sampling", "samples")
         oversampling = real_of("sampling", "oversampling", 0.0_wp)
         if (any(numbers > 0)) then
            text = solve_with("sampling%samples="//list_of(2*numbers))
         else
            text = solve_with("sampling%oversampling="//to_text(merge(2.0_wp*oversampling, 6.0_wp, oversampling > 0.0_wp)))
         end if
      case (outcome%impact)
         text = march_from_rest("march%restitution=0.5")
         if (len(text) > 0) text = text//"  (with the restitution of the wall)"
      case (outcome%subharmonic)
         text = with_lower_tones()
      case (outcome%collapsed, outcome%locked, outcome%broadband)
         text = march_from_rest()
      case (outcome%failed)
         if (index(kind%message, " returned ") == 0 .and. index(kind%message, names%input//":") == 0) text = march_from_rest()
      end select
      if (len(text) > 0) return
      select case (kind%status)
      case (outcome%no_motion, outcome%collapsed)
         text = "nhbm check "//shell_word(names%input)//"  (prints natural frequencies: a first guess for &tones)"
      case (outcome%failed, outcome%crashed)
         text = "nhbm check "//shell_word(names%input)//"; when the cause is gone: nhbm resume "// &
                shell_word(names%result)//" --retry"
      case (outcome%marched)
         text = "nhbm verify "//shell_word(names%result)//" --points "//to_text(kind%first - 1)//"  (does the motion stay?)"
      end select

   contains

      !> The same run with some values changed, in a result file of its own; empty where a sweep gives one of them.
      function solve_with(first, others) result(command)
         character(*), intent(in) :: first
         type(string_t), intent(in), optional :: others(:)
         character(:), allocatable :: command
         integer :: i

         command = ""
         if (is_swept(first)) return
         command = "nhbm solve "//shell_word(names%input)//earlier()//" --set "//shell_word(first)
         if (present(others)) then
            do i = 1, size(others)
               command = command//" --set "//shell_word(others(i)%value)
            end do
         end if
         command = command//" -o "//shell_word(beside_result("_2"))
      end function solve_with

      !> Time integration of the point for 200 periods of the slowest tone.
      function march_from_rest(first) result(command)
         character(*), intent(in), optional :: first
         character(:), allocatable :: command
         character(10) :: duration

         command = ""
         if (any(tones%is_unknown)) return
         command = "nhbm march "//shell_word(names%input)//earlier()
         if (size(plan%parameters) > 0) command = command//" --point "//to_text(kind%first - 1)
         write (duration, "(es8.1e2)") 200.0_wp*two_pi/minval(tones%omega)
         if (here%count("march") == 0) command = command//" --set march%duration="//trim(adjustl(duration))
         if (present(first)) command = command//" --set "//first
         if (needs_fixed_steps()) command = command//" --set "//shell_word("march%method='generalized_alpha'")
         command = command//" -o "//shell_word(beside_result("_march"))
      end function march_from_rest

      !> Whether the usual method cannot follow a law, and no other is asked for.
      logical function needs_fixed_steps()
         character(:), allocatable :: type
         integer :: i

         needs_fixed_steps = .false.
         if (.not. numbers_are_absent("march", "method")) return
         do i = 1, here%count("law")
            type = ""
            call read_law(i, type)
            needs_fixed_steps = needs_fixed_steps .or. any(type == without_bounds)
         end do
      end function needs_fixed_steps

      subroutine read_law(i, type)
         integer, intent(in) :: i
         character(:), allocatable, intent(inout) :: type
         type(properties_t), pointer :: group

         group => group_of("law", i)
         call group%get("type", type)
      end subroutine read_law

      !> The key that a message names, with ten times its value.
      function raised(words) result(command)
         character(*), intent(in) :: words
         character(:), allocatable :: command, key
         real(wp) :: before

         key = words(:verify(words//" ", "abcdefghijklmnopqrstuvwxyz_") - 1)
         select case (key)
         case ("max_iterations")
            command = solve_with("solver%"//key//"="//to_text(nint(more*real_of("solver", key, 100.0_wp))))
         case ("rescue_work")
            command = solve_with("solver%"//key//"="//to_text(more*real_of("solver", key, 20.0_wp)))
         case default
            before = real_of("solver", key, 0.0_wp)
            command = ""
            if (before > 0.0_wp) command = solve_with("solver%"//key//"="//to_text(more*before))
         end select
      end function raised

      !> Twice, or as many times as the message says, the period: tuples of loads and orders count in the new tone.
      function with_lower_tones() result(command)
         character(:), allocatable :: command
         type(string_t), allocatable :: sets(:)
         integer, allocatable :: values(:)
         integer :: i, k, n
         logical :: ok
         character(5), parameter :: with_tuples(2) = [character(5) :: "load", "start"]

         command = ""
         n = index(kind%message, "repeats after ")
         if (n == 0 .or. any(tones%is_unknown)) return
         associate (rest => kind%message(n + 14:))
            call parse_integer(rest(:index(rest//" ", " ") - 1), n, ok)
         end associate
         if (.not. ok .or. n < 2) return
         allocate (sets(0))
         do k = 1, size(with_tuples)
            do i = 1, here%count(trim(with_tuples(k)))
               values = numbers_of(trim(with_tuples(k)), "tuple", i)
               if (size(values) > 0) sets = [sets, string_t(trim(with_tuples(k))//"("//to_text(i)//")%tuple="//list_of(n*values))]
            end do
         end do
         values = numbers_of("harmonics", "order")
         if (size(values) > 0) sets = [sets, string_t("harmonics%order="//list_of(n*values))]
         values = numbers_of("sampling", "samples")
         if (any(values > 0)) sets = [sets, string_t("sampling%samples="//list_of(n*values))]
         command = solve_with("tones%subharmonic="//to_text(n*tones_divided_by()), sets)
      end function with_lower_tones

      integer function tones_divided_by() result(n)
         integer, allocatable :: values(:)

         values = numbers_of("tones", "subharmonic")
         n = 1
         if (size(values) > 0) n = max(1, values(1))
      end function tones_divided_by

      !> Values that the run was started with.
      function earlier() result(words)
         character(:), allocatable :: words
         integer :: i

         words = ""
         do i = 1, size(names%overrides)
            words = words//" --set "//shell_word(names%overrides(i)%value)
         end do
      end function earlier

      function beside_result(ending) result(path)
         character(*), intent(in) :: ending
         character(:), allocatable :: path
         integer :: n

         n = len(names%result)
         if (index(names%result, ".h5", back=.true.) == n - 2) n = n - 3
         path = names%result(:n)//ending//".h5"
      end function beside_result

      logical function is_swept(assignment)
         character(*), intent(in) :: assignment                       !! path=value
         integer :: i

         is_swept = .false.
         do i = 1, size(plan%parameters)
            is_swept = is_swept .or. index(plan%parameters(i)%path, assignment(:index(assignment, "=") - 1)) == 1
         end do
      end function is_swept

      !> Whole numbers of a key; none where it is not given.
      function numbers_of(group_name, key, i) result(values)
         character(*), intent(in) :: group_name, key
         integer, intent(in), optional :: i
         integer, allocatable :: values(:)
         type(properties_t), pointer :: group

         allocate (values(0))
         group => group_of(group_name, i)
         if (.not. associated(group)) return
         if (group%given(key)) call group%get(key, values)
      end function numbers_of

      logical function numbers_are_absent(group_name, key)
         character(*), intent(in) :: group_name, key
         type(properties_t), pointer :: group

         group => group_of(group_name)
         numbers_are_absent = .true.
         if (associated(group)) numbers_are_absent = .not. group%given(key)
      end function numbers_are_absent

      real(wp) function real_of(group_name, key, default) result(value)
         character(*), intent(in) :: group_name, key
         real(wp), intent(in) :: default
         type(properties_t), pointer :: group

         value = default
         group => group_of(group_name)
         if (associated(group)) call group%get(key, value)
      end function real_of

      subroutine read_solver(rescues, guess)
         logical, intent(inout) :: rescues
         character(:), allocatable, intent(inout) :: guess
         type(properties_t), pointer :: group

         group => group_of("solver")
         if (.not. associated(group)) return
         call group%get("rescue", rescues)
         call group%get("first_guess", guess)
      end subroutine read_solver

      function group_of(name, i) result(group)
         character(*), intent(in) :: name
         integer, intent(in), optional :: i
         type(properties_t), pointer :: group
         integer :: number

         number = 1
         if (present(i)) number = i
         group => here%group(name, number)
      end function group_of
   end function next_step

   pure function list_of(numbers) result(text)
      integer, intent(in) :: numbers(:)
      character(:), allocatable :: text
      integer :: i

      text = ""
      do i = 1, size(numbers)
         if (i > 1) text = text//","
         text = text//to_text(numbers(i))
      end do
   end function list_of

   !> A word as a shell takes it for one.
   pure function shell_word(text) result(word)
      character(*), intent(in) :: text
      character(:), allocatable :: word
      character(*), parameter :: plain = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_./%=,+:-"
      integer :: i

      word = text
      if (len(text) > 0 .and. verify(text, plain) == 0) return
      if (scan(text, '"$`\!') == 0 .and. len(text) > 0) then
         word = '"'//text//'"'
         return
      end if
      word = "'"
      do i = 1, len(text)
         if (text(i:i) == "'") then
            word = word//"'\''"
         else
            word = word//text(i:i)
         end if
      end do
      word = word//"'"
   end function shell_word
end module hb_failure_kinds
