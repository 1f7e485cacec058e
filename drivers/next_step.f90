!> The command to try after points of a run ended with a given status.
module next_step
   use hb_advice, only: advice, advice_list_t, find_command, n_advice
   use hb_document, only: document_t
   use hb_error, only: error_t
   use hb_input_keys, only: find_rule, kind_of, rule_t
   use hb_kinds, only: two_pi, wp
   use hb_model_loads, only: groups_with_tuples
   use hb_model_tones, only: read_tones
   use hb_motion_advice, only: advise_on_status
   use hb_motion_result, only: advise_on_reason
   use hb_operating_system, only: file_kind, kind_of_file
   use hb_outcome, only: outcome, reason
   use hb_point_kinds, only: curve_kind
   use hb_properties, only: properties_t
   use hb_results_record, only: column_of => numbers_of
   use hb_sweep_plan, only: sweep_plan_t
   use hb_text, only: add_string, join, lower, split, string_t, to_text
   use hb_tones, only: tones_t
   use switched_inputs, only: list_of
   implicit none
   private
   public :: command_for_cut_curve, command_to_try, failure_kind_t, is_by_tolerance, option_of, run_names_t, shell_word

   character(*), parameter :: set_keys(4) = [character(8) :: "set", "order", "tuples", "odd_only"], & ! that fix a set or a grid
                              grid_keys(2) = [character(12) :: "samples", "oversampling"]
   character(*), parameter :: without_bounds(1) = ["jenkins_2d"]      ! laws with states that cvode cannot integrate
   integer, parameter :: max_points = 1000000                         ! of a curve
   integer, parameter :: more_points_factor = 10                      ! of a curve that covers little of its range
   real(wp), parameter :: max_covered_share = 0.5_wp                  ! of the range of a curve, if it has many folds
   integer, parameter :: budget_factor = 10                           ! of a budget that was insufficient

   !> Points that ended in the same way.
   type :: failure_kind_t
      integer :: status = outcome%pending
      integer :: n_points = 0
      integer :: first = 0                                            !! of the points, from 1
      integer :: reason = reason%none                                 !! hb_outcome; as the next, of that one
      integer :: n_periods = 0                                        !! after which a subharmonic motion repeats
      character(:), allocatable :: message
      type(advice_list_t) :: advice                                   !! on a search that has failed
   end type failure_kind_t

   !> The names that a command contains.
   type :: run_names_t
      character(:), allocatable :: input, result                      !! paths
      type(string_t), allocatable :: overrides(:)                     !! path=value, as given
   end type run_names_t

   !> A kind of failure with the model of its first point.
   type :: run_t
      type(failure_kind_t) :: kind
      type(run_names_t) :: names
      type(sweep_plan_t) :: plan
      type(document_t), pointer :: here => null()                     ! the input of that point
      type(tones_t) :: tones
   end type run_t

contains

   !> The command to try after points ended in this way; empty if there is none.
   function command_to_try(kind, names, plan, document) result(text)
      type(failure_kind_t), intent(in) :: kind
      type(run_names_t), intent(in) :: names
      type(sweep_plan_t), intent(in) :: plan
      type(document_t), intent(in) :: document                        !! the input of the run
      character(:), allocatable :: text
      type(document_t), target :: here
      type(error_t), allocatable :: error
      type(run_t) :: run

      text = ""
      if (kind%reason /= reason%points .and. kind_of_file(names%input) == file_kind%none) return  ! of a motion that leaves a curve
      here = document
      call plan%apply(kind%first, here)
      call here%begin()
      run%kind = kind
      run%names = names
      run%plan = plan
      run%here => here
      call read_tones(run%tones, here, error)
      if (allocated(error)) return
      text = from_table(run, kind%advice)
      if (len(text) == 0) text = solve_or_integrate(run)
      if (len(text) == 0) text = look_into(run)
   end function command_to_try

   !> The command that follows a curve to its end that has reached its number of points; empty if there is no such curve.
   function command_for_cut_curve(names, plan, document) result(text)
      type(run_names_t), intent(in) :: names
      type(sweep_plan_t), intent(in) :: plan                          !! with the values of the curve
      type(document_t), intent(in) :: document                        !! the input of the run
      character(:), allocatable :: text
      type(failure_kind_t) :: kind

      text = ""
      kind%first = findloc(column_of(names%result, "reason"), reason%points, dim=1)
      if (kind%first == 0) return
      kind%status = outcome%converged
      kind%reason = reason%points
      text = command_to_try(kind, names, plan, document)
   end function command_for_cut_curve

   !> More room for a curve, or the same with jumps over its folds.
   function more_points(run) result(text)
      type(run_t), intent(in) :: run
      character(:), allocatable :: points, text
      integer :: n

      if (can_jump(run)) then
         n = min(max_points, more_points_factor*run%plan%n_fastest())
         points = "curve%points="//to_text(n)
         text = solve_with(run, "curve%jump=.true.", [string_t(points)])
      else
         n = enough_points(run%plan, run%kind%first)
         text = "nhbm resume "//shell_word(run%names%result)//" --set curve%points="//to_text(n)
      end if
   end function more_points

   !> Whether a curve that has reached its number of points has turned back several times in a small part of its range, and could
   !> leave its folds.
   logical function can_jump(run)
      type(run_t), intent(in) :: run
      integer, parameter :: several = 3                               ! folds

      can_jump = .false.
      if (any(run%tones%is_unknown) .or. run%plan%share_covered(run%kind%first) > max_covered_share) return
      associate (curve => run%plan%curve)
         if (curve%jumps .or. curve%switches .or. allocated(curve%over) .or. size(curve%others) > 0) return
         if (len(curve%origin_path) > 0 .or. (curve%start - curve%from)*(curve%start - curve%to) < 0.0_wp) return
      end associate
      can_jump = count(column_of(run%names%result, "curve_kind") == curve_kind%fold) >= several
   end function can_jump

   !> A number of points that should suffice for a curve that has reached it, by the share of its range that it covers.
   integer function enough_points(plan, last) result(n)
      type(sweep_plan_t), intent(in) :: plan                          !! with the values of the curve
      integer, intent(in) :: last                                     !! point of the curve, from 1
      real(wp), parameter :: margin = 1.3_wp
      integer :: digit

      n = plan%n_fastest()
      n = nint(n*min(real(budget_factor, wp), max(2.0_wp, margin/max(plan%share_covered(last), tiny(1.0_wp)))))
      digit = 10**int(log10(real(n)))
      n = min(max_points, (n + digit - 1)/digit*digit)
   end function enough_points

   !> Another run that may find the motion.
   function solve_or_integrate(run) result(text)
      type(run_t), intent(in) :: run
      character(:), allocatable :: text

      text = ""
      associate (why => run%kind%reason)
         if (why == reason%points) then
            text = more_points(run)
            return
         end if
         select case (run%kind%status)
         case (outcome%stalled, outcome%out_of_budget, outcome%singular, outcome%not_finite, outcome%diverged, outcome%timed_out)
            text = from_reason(run)
            if (len(text) == 0 .and. all(why /= [reason%overflow, reason%steep_friction])) text = with_other_search(run)
         case (outcome%truncated, outcome%penetrating)
            if (any(why == [reason%growth, reason%departure])) then
               text = integrate_from_rest(run)
            else
               text = from_reason(run)
               if (len(text) == 0) text = with_more_harmonics(run)
            end if
         case (outcome%aliased)
            text = by_tolerance(run)
            if (len(text) == 0) text = with_more_samples(run)
         case (outcome%impact)
            if (has_restitution(run)) text = integrate_from_rest(run)
         case (outcome%subharmonic)
            text = with_lower_tones(run)
         case (outcome%collapsed, outcome%locked, outcome%broadband)
            text = integrate_from_rest(run)
         case (outcome%failed)
            if (why /= reason%error) text = integrate_from_rest(run)
         end select
      end associate
   end function solve_or_integrate

   !> What the table of advice has for the status.
   function look_into(run) result(text)
      type(run_t), intent(in) :: run
      character(:), allocatable :: text
      type(advice_list_t) :: list

      call advise_on_status(run%kind%status, list)
      if (run%kind%status == outcome%collapsed .and. size(run%tones%omega) == 1) list%items%number = advice%if_no_motion
      text = from_table(run, list)
   end function look_into

   !> What the table of advice has for what ended the work.
   function from_reason(run) result(text)
      type(run_t), intent(in) :: run
      character(:), allocatable :: text
      type(advice_list_t) :: list

      call advise_on_reason(merge(reason%time_limit, run%kind%reason, run%kind%status == outcome%timed_out), list)
      text = from_table(run, list)
   end function from_reason

   !> The first command that the table has for advice: a command line, or assignments for another run; empty if there is none.
   function from_table(run, list) result(text)
      type(run_t), intent(in) :: run
      type(advice_list_t), intent(in) :: list
      character(:), allocatable :: text
      character(:), allocatable :: remark
      type(string_t), allocatable :: sets(:)
      integer :: i

      text = ""
      do i = 1, n_advice(list)
         call find_command(list%items(i), text)
         if (len(text) > 0) exit
      end do
      if (index(text, "nhbm") == 1) then
         call replace(text, "{input}", shell_word(run%names%input))
         call replace(text, "{result}", shell_word(run%names%result))
         call replace(text, "{point}", to_text(run%kind%first - 1))
      else if (len(text) > 0) then
         remark = text(index(text//"  (", "  ("):)
         call split(text(:len(text) - len(remark)), " ", sets)
         do i = 1, size(sets)
            call multiply(run, sets(i)%value)
            if (len(sets(i)%value) == 0) text = ""
         end do
         if (len(text) > 0) text = solve_with(run, sets(1)%value, sets(2:))
         if (len(text) > 0) text = text//remark
      end if
   end function from_table

   pure subroutine replace(text, old, new)
      character(:), allocatable, intent(inout) :: text
      character(*), intent(in) :: old, new
      type(string_t), allocatable :: parts(:)

      call split(text, old, parts)
      text = join(parts, new)
   end subroutine replace

   !> Makes `path*factor` an assignment of this multiple of the present value, and at least of the default; empty if both are zero.
   subroutine multiply(run, text)
      type(run_t), intent(in) :: run
      character(:), allocatable, intent(inout) :: text
      type(string_t), allocatable :: words(:)
      character(:), allocatable :: group, key
      type(rule_t) :: rule
      real(wp) :: factor, value

      if (index(text, "*") == 0 .or. index(text, "=") > 0) return
      call split(text, "*", words)
      read (words(2)%value, *) factor
      group = text(:index(text, "%") - 1)
      key = words(1)%value(len(group) + 2:)
      call find_rule(group, "", key, rule)
      value = max(factor*real_of(run, group, key), rule%numbers(1))
      text = ""
      if (value <= 0.0_wp) return
      text = words(1)%value//"="//to_text(value)
      if (rule%kind == kind_of%whole) text = words(1)%value//"="//to_text(nint(value))
   end subroutine multiply

   !> Another first guess, finer equations of a curve, or time integration.
   function with_other_search(run) result(text)
      type(run_t), intent(in) :: run
      character(:), allocatable :: text
      type(properties_t), pointer :: group
      character(:), allocatable :: guess

      text = ""
      group => run%here%optional_group("solver")
      call group%get("first_guess", guess)
      if (run%kind%reason /= reason%lost_curve) then
         if (guess /= "integration" .and. .not. any(run%tones%is_unknown) .and. &
             run%here%count("dynamic_stiffness") + run%here%count("sector") == 0) &
            text = solve_with(run, "solver%first_guess='integration'")
      else if (run%kind%status == outcome%out_of_budget) then         ! given up, as its errors were too large
         text = with_more_harmonics(run)
      else if (has_restitution(run)) then                             ! the period map has no finer equations
         text = solve_with(run, "curve%max_step="//to_text(real_of(run, "curve", "max_step")/budget_factor))
      else
         text = with_finer_equations(run)
      end if
      if (len(text) == 0) text = integrate_from_rest(run)
   end function with_other_search

   !> Finer equations: if a curve cannot be continued, more samples remove artificial kinks and small folds.
   function with_finer_equations(run) result(text)
      type(run_t), intent(in) :: run
      character(:), allocatable :: text

      if (is_by_tolerance(run%here)) then
         text = solve_with(run, "accuracy%tolerance="// &
                           to_text(real_of(run, "accuracy", "tolerance")/budget_factor))
      else
         text = with_more_samples(run)
      end if
   end function with_finer_equations

   function with_more_harmonics(run) result(text)
      type(run_t), intent(in) :: run
      character(:), allocatable :: text
      integer, allocatable :: orders(:)

      text = by_tolerance(run)
      allocate (orders, source=numbers_of(run, "harmonics", "order"))
      if (len(text) > 0) then
         return
      else if (size(orders) > 0) then
         text = solve_with(run, "harmonics%order="//list_of(2*max(orders, 1)))
      else if (is_by_tolerance(run%here)) then
         text = with_more_work(run, "max_harmonics", 1000000)
      end if
   end function with_more_harmonics

   !> A tolerance instead of a given set and grid: the given one, or the limit of the estimated error; empty if a sweep varies the
   !> set, or the set is needed.
   function by_tolerance(run) result(text)
      type(run_t), intent(in) :: run
      character(:), allocatable :: text
      type(string_t), allocatable :: sets(:)
      real(wp) :: tolerance
      integer :: i

      text = ""
      if (is_by_tolerance(run%here) .or. is_swept(run, "harmonics=") .or. is_swept(run, "sampling=")) return
      if (real_of(run, "error_estimate", "improvement_steps") > 0.0_wp .or. run%here%count("normal_mode") > 0) return
      allocate (sets(0))
      do i = 1, size(set_keys)
         if (.not. numbers_are_absent(run, "harmonics", trim(set_keys(i)))) &
            call add_string(sets, "harmonics%"//trim(set_keys(i))//"=")
      end do
      do i = 1, size(grid_keys)
         if (.not. numbers_are_absent(run, "sampling", trim(grid_keys(i)))) &
            call add_string(sets, "sampling%"//trim(grid_keys(i))//"=")
      end do
      tolerance = min(real_of(run, "error_estimate", "truncation"), real_of(run, "error_estimate", "aliasing"))
      if (run%here%count("accuracy") > 0) tolerance = real_of(run, "accuracy", "tolerance")
      text = solve_with(run, "accuracy%tolerance="//to_text(tolerance), sets)
   end function by_tolerance

   !> More work for a tolerance, and a higher limit if one is given.
   function with_more_work(run, key, most) result(text)
      type(run_t), intent(in) :: run
      character(*), intent(in) :: key
      integer, intent(in) :: most                                     !! largest possible limit
      character(:), allocatable :: text
      type(string_t), allocatable :: sets(:)
      integer, allocatable :: limits(:)
      integer, parameter :: more_of_three = 20                        ! a grid of three tones grows with the cube of the orders
      real(wp) :: work

      allocate (sets(0))
      work = merge(more_of_three, budget_factor, size(run%tones%omega) > 2)*real_of(run, "accuracy", "max_work")
      limits = numbers_of(run, "accuracy", key)
      if (size(limits) > 0) then
         limits = budget_factor*min(limits, most/budget_factor)
         call add_string(sets, "accuracy%"//key//"="//list_of(limits))
      end if
      text = solve_with(run, "accuracy%max_work="//to_text(work), sets)
   end function with_more_work

   !> Whether each point chooses its harmonics, as in hb_model_settings.
   logical function is_by_tolerance(document)
      type(document_t), intent(in) :: document
      type(document_t), target :: copy
      type(properties_t), pointer :: group

      copy = document
      group => copy%optional_group("harmonics")
      is_by_tolerance = .not. (group%given("order") .or. group%given("tuples") .or. group%given("set") .or. group%given("odd_only"))
   end function is_by_tolerance

   function with_more_samples(run) result(text)
      type(run_t), intent(in) :: run
      character(:), allocatable :: text
      integer, allocatable :: numbers(:)
      real(wp) :: oversampling

      allocate (numbers, source=numbers_of(run, "sampling", "samples"))
      oversampling = real_of(run, "sampling", "oversampling")
      if (is_by_tolerance(run%here) .and. any(numbers > 0)) then
         text = solve_with(run, "sampling%samples=0")
      else if (is_by_tolerance(run%here) .and. oversampling > 0.0_wp) then
         text = solve_with(run, "sampling%oversampling=0")
      else if (is_by_tolerance(run%here)) then
         text = with_more_work(run, "max_samples", 100000000)
      else if (any(numbers > 0)) then
         text = solve_with(run, "sampling%samples="//list_of(2*numbers))
      else
         text = solve_with(run, "sampling%oversampling="//to_text(merge(2.0_wp*oversampling, 6.0_wp, oversampling > 0.0_wp)))
      end if
   end function with_more_samples

   !> The same run with some values changed, with its own result file; empty if a sweep varies one of them.
   function solve_with(run, first, others) result(command)
      type(run_t), intent(in) :: run
      character(*), intent(in) :: first
      type(string_t), intent(in), optional :: others(:)
      character(:), allocatable :: command
      type(string_t), allocatable :: sets(:)
      integer :: i

      command = ""
      if (is_swept(run, first)) return
      sets = [string_t(first)]
      if (present(others)) sets = [sets, others]
      command = "nhbm solve "//shell_word(run%names%input)//earlier(run, sets)
      do i = 1, size(sets)
         command = command//option_of(sets(i)%value)
      end do
      command = command//" -o "//shell_word(beside_result(run, "_"//changed(first)))
   end function solve_with

   !> The key of an assignment, with its value if that is a positive integer: for the name of the result.
   pure function changed(assignment) result(text)
      character(*), intent(in) :: assignment                          !! path=value
      character(:), allocatable :: text
      integer :: equals

      equals = index(assignment, "=")
      text = assignment(index(assignment, "%") + 1:equals - 1)
      if (verify(assignment(equals + 1:), "0123456789") == 0) text = text//"_"//assignment(equals + 1:)
   end function changed

   !> Time integration of the point for 200 periods of the slowest tone.
   function integrate_from_rest(run) result(command)
      type(run_t), intent(in) :: run
      character(:), allocatable :: command, ending
      character(10) :: duration

      command = ""
      ending = "_integration"
      if (any(run%tones%is_unknown) .or. run%here%count("dynamic_stiffness") + run%here%count("sector") > 0) return
      command = "nhbm integrate "//shell_word(run%names%input)//earlier(run, [string_t ::])
      if (size(run%plan%parameters) > 0) then
         command = command//" --point "//to_text(run%kind%first - 1)
         ending = ending//"_"//to_text(run%kind%first - 1)
      end if
      write (duration, "(es8.1e2)") 200.0_wp*two_pi/minval(run%tones%omega)
      if (real_of(run, "integration", "duration") <= 0.0_wp) command = command// &
         " --set integration%duration="//trim(adjustl(duration))
      if (run%kind%status == outcome%broadband .and. numbers_are_absent(run, "integration", "n_peaks")) &
         command = command//" --set integration%n_peaks=8"
      if (needs_fixed_steps(run)) command = command//" --set "//shell_word("integration%method='generalized_alpha'")
      command = command//" -o "//shell_word(beside_result(run, ending))
   end function integrate_from_rest

   !> Whether there are rigid walls, all with a given restitution, as in hb_model.
   logical function has_restitution(run)
      type(run_t), intent(in) :: run
      character(:), allocatable :: type
      type(properties_t), pointer :: group
      integer :: i

      has_restitution = .false.
      do i = 1, run%here%count("law")
         type = ""
         group => run%here%group("law", i)
         call group%get("type", type)
         if (type /= "rigid_wall") cycle
         has_restitution = group%given("restitution") .or. .not. numbers_are_absent(run, "integration", "restitution")
         if (.not. has_restitution) return
      end do
   end function has_restitution

   !> Whether the default method cannot integrate a law, and no other method is requested.
   logical function needs_fixed_steps(run)
      type(run_t), intent(in) :: run
      character(:), allocatable :: type
      type(properties_t), pointer :: group
      integer :: i

      needs_fixed_steps = .false.
      if (.not. numbers_are_absent(run, "integration", "method")) return
      do i = 1, run%here%count("law")
         type = ""
         group => run%here%group("law", i)
         call group%get("type", type)
         needs_fixed_steps = needs_fixed_steps .or. any(type == without_bounds)
      end do
   end function needs_fixed_steps

   !> The same model with the period multiplied by that of the motion: tuples of loads and orders are multiples of the
   !> new tone.
   function with_lower_tones(run) result(command)
      type(run_t), intent(in) :: run
      character(:), allocatable :: command
      type(string_t), allocatable :: sets(:)
      integer, allocatable :: values(:)
      integer :: i, k, n

      command = ""
      n = run%kind%n_periods
      if (n < 2 .or. any(run%tones%is_unknown)) return
      allocate (sets(0))
      do k = 1, size(groups_with_tuples)
         do i = 1, run%here%count(trim(groups_with_tuples(k)))
            values = numbers_of(run, trim(groups_with_tuples(k)), "tuple", i)
            if (size(values) > 0) call add_string(sets, trim(groups_with_tuples(k))//"("//to_text(i)//")%tuple="//list_of(n*values))
         end do
      end do
      values = numbers_of(run, "harmonics", "order")
      if (size(values) > 0) call add_string(sets, "harmonics%order="//list_of(n*values))
      if (size(values) == 0 .and. size(run%tones%omega) > 1) &         ! otherwise the unstable motion is found in the larger set
         call add_string(sets, "solver%primary_method='integration'")
      values = numbers_of(run, "sampling", "samples")
      if (any(values > 0)) call add_string(sets, "sampling%samples="//list_of(n*values))
      values = [numbers_of(run, "tones", "subharmonic"), 1]            ! 1 if it is not given
      command = solve_with(run, "tones%subharmonic="//to_text(n*max(1, values(1))), sets)
   end function with_lower_tones

   !> Values with which the run was started and that no later assignment sets again.
   function earlier(run, later) result(words)
      type(run_t), intent(in) :: run
      type(string_t), intent(in) :: later(:)                          !! path=value, after those of the run
      character(:), allocatable :: words
      type(string_t), allocatable :: sets(:)
      integer :: i, k

      words = ""
      allocate (sets, source=[run%names%overrides, later])
      do i = 1, size(run%names%overrides)
         if (any([(path_of(sets(k)%value) == path_of(sets(i)%value), k=i + 1, size(sets))])) cycle
         words = words//option_of(sets(i)%value)
      end do
   end function earlier

   !> The option that makes an assignment; without a value it removes the key.
   function option_of(assignment) result(words)
      character(*), intent(in) :: assignment                          !! path=value or path=
      character(:), allocatable :: words

      if (index(assignment, "=") == len_trim(assignment)) then
         words = " --unset "//shell_word(assignment(:len_trim(assignment) - 1))
      else
         words = " --set "//shell_word(assignment)
      end if
   end function option_of

   pure function path_of(assignment) result(path)
      character(*), intent(in) :: assignment                          !! path=value
      character(:), allocatable :: path

      path = lower(trim(adjustl(assignment(:index(assignment//"=", "=") - 1))))
   end function path_of

   function beside_result(run, ending) result(path)
      type(run_t), intent(in) :: run
      character(*), intent(in) :: ending
      character(:), allocatable :: path
      integer :: n

      n = len(run%names%result)
      if (index(run%names%result, ".h5", back=.true.) == n - 2) n = n - 3
      path = run%names%result(:n)//ending//".h5"
   end function beside_result

   logical function is_swept(run, assignment)
      type(run_t), intent(in) :: run
      character(*), intent(in) :: assignment                          !! path=value
      integer :: i

      is_swept = .false.
      do i = 1, size(run%plan%parameters)
         is_swept = is_swept .or. index(run%plan%parameters(i)%path, assignment(:index(assignment, "=") - 1)) == 1
      end do
   end function is_swept

   !> Whole numbers of a key; none if it is not given.
   function numbers_of(run, group_name, key, i) result(values)
      type(run_t), intent(in) :: run
      character(*), intent(in) :: group_name, key
      integer, intent(in), optional :: i
      integer, allocatable :: values(:)
      type(properties_t), pointer :: group
      integer :: number

      allocate (values(0))
      number = 1
      if (present(i)) number = i
      group => run%here%group(group_name, number)
      if (.not. associated(group)) return
      if (group%given(key)) call group%get(key, values)
   end function numbers_of

   logical function numbers_are_absent(run, group_name, key)
      type(run_t), intent(in) :: run
      character(*), intent(in) :: group_name, key
      type(properties_t), pointer :: group

      group => run%here%group(group_name, 1)
      numbers_are_absent = .true.
      if (associated(group)) numbers_are_absent = .not. group%given(key)
   end function numbers_are_absent

   real(wp) function real_of(run, group_name, key) result(value)
      type(run_t), intent(in) :: run
      character(*), intent(in) :: group_name, key
      type(properties_t), pointer :: group

      value = 0.0_wp
      group => run%here%optional_group(group_name)
      call group%get(key, value)
   end function real_of

   !> A word quoted for the shell if necessary.
   pure recursive function shell_word(text) result(word)
      character(*), intent(in) :: text
      character(:), allocatable :: word
      character(*), parameter :: plain = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_./%=,+:-"
      integer :: i

      word = text
      if (index(text, "-") == 1) then                                 ! a file, not an option
         word = shell_word("./"//text)
         return
      end if
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
end module next_step
