!> `nhbm check`: reads an input and every point of it as `solve` does, prints what it requests, and compares the
!> derivatives of its laws with differences of their forces.
module verb_check
   use arguments, only: arguments_t
   use console, only: print_error, say, say_advice
   use exit_status, only: incomplete, not_all_right, success
   use hb_advice, only: advice_list_t, append_advice, has_advice, n_advice
   use hb_cancellation, only: cancellation_t, verdict
   use hb_clock, only: wall_clock
   use hb_coordinates, only: coordinates_t
   use hb_crash_handler, only: install_crash_handler, remove_crash_handler
   use hb_discretisation, only: discretisation_t
   use hb_error, only: error_t
   use hb_interruption, only: interruption
   use hb_kinds, only: two_pi, wp
   use hb_law, only: law_box_t
   use hb_law_check, only: check_derivatives, derivative_check_t
   use hb_level, only: level_t
   use hb_memory_estimate, only: amount, estimate_memory, memory_estimate_t, memory_text, sizes_of
   use hb_model, only: model_t
   use hb_model_basis, only: find_basis
   use hb_model_advice, only: advise_on_drive, advise_on_model
   use hb_modes, only: find_natural_frequencies, max_dofs, modes_t, new_modes
   use hb_motion_result, only: motion_result_t
   use hb_mpi, only: comm_t, rank_of
   use hb_outcome, only: is_solved, outcome, outcome_name
   use hb_point, only: solve_point
   use hb_signals, only: signal_caught, wait_for_points
   use hb_structure, only: structure_t
   use hb_study, only: study_t
   use hb_system, only: coordinates_of
   use hb_text, only: number_of, rounded, to_text
   use run_texts, only: ending_text
   use verb_solve, only: load_study
   implicit none
   private
   public :: run_check

   !> Ends a point at a signal.
   type, extends(cancellation_t) :: until_signal_t
   contains
      procedure :: wants_end => until_signal_wants_end
   end type until_signal_t

   !> Advice on the points of a study: each kind once, with the number of its points.
   type :: counted_advice_t
      type(advice_list_t) :: list
      integer, allocatable :: n_points(:), first(:)                   !! how many have it, and the first of them
   end type counted_advice_t

contains

   !> Runs the verb; without an error it returns an exit status.
   subroutine run_check(options, comm, status, error)
      type(arguments_t), intent(in) :: options
      type(comm_t), intent(in) :: comm
      integer, intent(out) :: status
      type(error_t), allocatable, intent(out) :: error
      type(study_t) :: study
      type(advice_list_t) :: implausible
      type(counted_advice_t) :: found
      type(error_t), allocatable :: no_balance
      real(wp) :: end_of_time
      logical :: all_right
      integer :: n_checked, point, stride

      status = success
      allocate (found%n_points(0), found%first(0))
      end_of_time = wall_clock() + options%time_limit
      call load_study(options, comm, study, error)
      if (allocated(error)) return
      call wait_for_points()
      stride = 1
      if (allocated(study%plan%curve)) stride = study%plan%n_fastest()
      do point = 1, study%plan%n_points, stride                       ! of curves, their starts
         call check_point(study, point, found, error)
         if (allocated(error)) return
         if (point + stride > study%plan%n_points) exit
         if (.not. signal_caught() .and. wall_clock() < end_of_time) cycle
         status = incomplete
         if (rank_of(comm) == 0) call print_error(why_stopped()//" after "//number_of((point - 1)/stride + 1, "point")//" of "// &
            to_text((study%plan%n_points - 1)/stride + 1)//", which can be read")
         return
      end do
      if (rank_of(comm) > 0) return
      call describe(study)
      associate (laws => study%model%system%laws)
         call check_laws(laws, study%model%system%tones%n_tones, all_right, n_checked)
         call write_advice(study, found)
         if (n_checked < size(laws)) call print_error(why_stopped()//" after the derivatives of "//to_text(n_checked)//" of "// &
            number_of(size(laws), "law"))
         if (n_checked < size(laws)) status = incomplete
      end associate
      if (.not. all_right) then
         status = not_all_right
         call say("the input can be solved, but its results may be wrong: correct the law")
      end if
      if (status /= success) return
      call study%model%system%check_balance(no_balance)
      if (allocated(no_balance)) then
         call say("the input is valid for nhbm integrate alone: "//no_balance%message)
         return
      end if
      call write_cost(study, end_of_time - wall_clock())
      if (signal_caught()) then
         status = incomplete
         call print_error(why_stopped()//" before the cost of the tolerance was measured")
         return
      end if
      call advise_on_model(study%model%system, study%model%discretisation, study%model%options, implausible)
      if (n_advice(found%list) + n_advice(implausible) > 0) then
         call say("the input can be solved, but see the warnings above")
      else
         call say("the input is valid")
      end if
   end subroutine run_check

   !> What has ended the verb early.
   function why_stopped() result(text)
      character(:), allocatable :: text

      text = ending_text(merge(interruption%signal, interruption%time_limit, signal_caught()))
   end function why_stopped

   !> Reads a point and counts the advice on it.
   subroutine check_point(study, point, found, error)
      type(study_t), intent(in) :: study
      integer, intent(in) :: point
      type(counted_advice_t), intent(inout) :: found
      type(error_t), allocatable, intent(out) :: error
      type(advice_list_t) :: here, new
      type(model_t) :: model
      integer :: i, k

      call study%read_point(point, model, error)
      if (allocated(error)) return
      call advise_on_drive(model%system, model%discretisation, model%options, here)
      do i = 1, n_advice(here)
         if (has_advice(found%list, here%items(i)%number)) then
            k = findloc(found%list%items%number, here%items(i)%number, dim=1)
            found%n_points(k) = found%n_points(k) + 1
         else
            new%items = [here%items(i)]
            call append_advice(found%list, new)
            found%n_points = [found%n_points, 1]
            found%first = [found%first, point]
         end if
      end do
   end subroutine check_point

   !> Prints the advice, of a sweep with the number of points.
   subroutine write_advice(study, found)
      type(study_t), intent(in) :: study
      type(counted_advice_t), intent(in) :: found
      type(advice_list_t) :: one
      character(:), allocatable :: points
      integer :: i

      points = ""
      do i = 1, n_advice(found%list)
         if (study%plan%n_points > 1) points = to_text(found%n_points(i))//" of "//to_text(study%plan%n_points)// &
            " points, the first at "//study%plan%describe(found%first(i))//": "
         one%items = [found%list%items(i)]
         call say_advice("warning: "//points, one)
      end do
   end subroutine write_advice

   subroutine describe(study)
      type(study_t), intent(in) :: study
      character(:), allocatable :: samples, tones
      type(coordinates_t) :: coordinates
      integer :: i

      associate (model => study%model)
         coordinates = coordinates_of(model%system)
         if (allocated(study%plan%curve)) then
            call say("points      "//number_of(study%plan%n_points/study%plan%n_fastest(), "curve")//" of up to "// &
               to_text(study%plan%n_fastest()))
         else
            call say("points      "//to_text(study%plan%n_points))
         end if
         do i = 1, size(study%plan%parameters)
            call say("swept       "//study%plan%parameters(i)%describe())
         end do
         if (allocated(study%plan%curve)) call say("curve       "//study%plan%curve%describe())
         call say("structure   "//number_of(model%system%structure%n_dofs, "degree")//" of freedom")
         call describe_frequencies(model%system%structure)
         call describe_damping(model%system%structure)
         if (model%system%tones%n_tones == 0) then
            call say("tones       none: the model can only be integrated in time")
         else
            tones = tone_text(model, 1)
            samples = to_text(model%discretisation%torus%n_samples(1))
            do i = 2, model%system%tones%n_tones
               tones = tones//", "//tone_text(model, i)
               samples = samples//" x "//to_text(model%discretisation%torus%n_samples(i))
            end do
            call say("tones       "//tones)
            call describe_accuracy(model)
            call say("harmonics   "//to_text(model%discretisation%harmonics%n_harmonics)// &
                     on_lowest(model%options%accuracy%grows_set))
            call say("samples     "//samples//on_lowest(model%options%accuracy%refines_grid .and. model%options%accuracy%is_on))
            call say("unknowns    "//to_text(model%discretisation%harmonics%n_coefficients*coordinates%n))
            call describe_symmetry(model, coordinates%n)
            call describe_memory(model)
         end if
         do i = 1, size(model%system%laws)
            call say("law         "//model%system%laws(i)%law%label)
         end do
      end associate
   end subroutine describe

   !> Writes the requested accuracy of motions, and the limits of the search.
   subroutine describe_accuracy(model)
      type(model_t), intent(in) :: model

      associate (accuracy => model%options%accuracy)
         if (.not. accuracy%is_on) return
         call say("accuracy    "//to_text(accuracy%tolerance)//" of the motion at the laws; at most "// &
                  to_text(accuracy%max_harmonics)//" harmonics, "//to_text(accuracy%max_samples)//" samples")
      end associate
   end subroutine describe_accuracy

   !> Solves some points as `solve` does, each from its own start, and reports what all will take. The points are spread over the
   !> sweep, because few may take most of the time; of curves the first point of the first one is solved.
   subroutine write_cost(study, seconds_left)
      type(study_t), intent(in) :: study
      real(wp), intent(in) :: seconds_left                            !! of the verb [s]
      real(wp), parameter :: limit = 1.0_wp, limit_of_all = 3.0_wp    !! [s] of the processor for a point, for all
      integer, parameter :: most = 8
      real(wp), parameter :: golden = 0.6180339887498949_wp
      type(until_signal_t), target :: cancellation
      type(error_t), allocatable :: error
      type(level_t) :: level
      type(model_t) :: model
      type(motion_result_t) :: result
      real(wp) :: ends, now, seconds(most)
      integer :: i, n, n_ended, n_lost, n_points

      if (.not. study%model%options%accuracy%is_on .and. study%plan%n_points == 1) return
      ends = wall_clock() + min(limit_of_all, seconds_left)
      n_points = merge(1, min(most, study%plan%n_points), allocated(study%plan%curve))
      n = 0
      n_ended = 0
      n_lost = 0
      do i = 1, n_points
         now = wall_clock()
         if (now >= ends) exit
         call study%read_point(merge(i, 1 + int(study%plan%n_points*modulo((i - 1)*golden, 1.0_wp)), &
                                     study%plan%n_points <= most), model, error)
         if (allocated(error)) return                                 ! solve reports the error
         call cancellation%enter(min(limit, model%options%solver%time_limit, ends - now))
         call solve_point(model, result, error, level)
         call cancellation%leave()
         if (allocated(error) .or. result%status == outcome%interrupted) return
         if (.not. is_solved(result%status)) n_lost = n_lost + 1
         if (result%status == outcome%timed_out) n_ended = n_ended + 1
         n = i
         seconds(i) = wall_clock() - now
      end do
      if (n == 0) return
      if (study%plan%n_points == 1 .or. allocated(study%plan%curve)) then
         call write_cost_of_one(study, result, seconds(1), n_ended > 0)
      else
         call say("cost        "//rounded(sum(seconds(:n))/n)//" s a point, the mean of "//to_text(n)//", which took "// &
                  rounded(minval(seconds(:n)))//" to "//rounded(maxval(seconds(:n)))//" s; "// &
                  trim(merge("more than", "about    ", n_ended > 0))//" "//rounded(study%plan%n_points*sum(seconds(:n))/n)// &
                  " s for "//to_text(study%plan%n_points)//" points on one rank")
         if (n_lost > 0) call say("            "//to_text(n_lost)//" of the "//to_text(n)//" points were not solved"// &
            trim(merge(" within a second", "                ", n_ended > 0))//"; nhbm why explains them after a run")
      end if
   end subroutine write_cost

   !> Writes what one point takes: what the tolerance will probably cost elsewhere.
   subroutine write_cost_of_one(study, result, seconds, is_ended)
      type(study_t), intent(in) :: study
      type(motion_result_t), intent(in) :: result
      real(wp), intent(in) :: seconds
      logical, intent(in) :: is_ended                                 !! by its limit
      character(:), allocatable :: of_all

      if (is_ended) then
         call say("cost        the first point takes longer than a second")
         return
      end if
      of_all = ""
      if (study%plan%n_points > 1) of_all = "; at this rate "//rounded(seconds*study%plan%n_points)//" s for "// &
         number_of(study%plan%n_points, "point")//" on one rank"
      call say("cost        "//rounded(seconds)//" s for the first point ("//outcome_name(result%status)//", "// &
               number_of(result%n_harmonics, "harmonic")//")"//of_all)
      if (.not. is_solved(result%status)) call say("            other points may take less, or longer")
   end subroutine write_cost_of_one

   logical function until_signal_wants_end(self) result(wants_end)
      class(until_signal_t), intent(inout) :: self

      wants_end = signal_caught() .or. self%verdict == verdict%interrupted
   end function until_signal_wants_end

   !> What is behind a size that only the lowest level has.
   pure function on_lowest(is_chosen) result(text)
      logical, intent(in) :: is_chosen
      character(:), allocatable :: text

      text = ""
      if (is_chosen) text = " initially"
   end function on_lowest

   !> Lists the lowest natural frequencies of the linear structure; those of a reduced one as far as their error is
   !> known.
   subroutine describe_frequencies(structure)
      type(structure_t), intent(in) :: structure
      integer, parameter :: most = 10
      real(wp), allocatable :: frequencies(:)
      character(:), allocatable :: note
      integer :: n
      logical :: lacks_gyroscopic

      if (structure%n_dofs > max_dofs .or. allocated(structure%sparse)) then
         call say("natural     frequencies are not computed for more than "//to_text(max_dofs)//" degrees of freedom")
         return
      end if
      if (structure%depends_on_tuple()) then
         call say("natural     frequencies of a sector are not computed: they depend on the nodal diameter")
         return
      end if
      if (allocated(structure%states)) then
         call say("natural     frequencies of a structure with states of a feedback are not computed")
         return
      end if
      call find_natural_frequencies(structure, frequencies, lacks_gyroscopic)
      n = min(size(frequencies), most)
      note = ""
      if (n < size(frequencies)) note = "  (the "//to_text(n)//" lowest)"
      if (lacks_gyroscopic) note = note//"  (without gyroscopic terms)"
      if (allocated(structure%parts)) then
         if (.not. all(structure%parts%is_of_element)) note = note//"  (without &dynamic_stiffness)"
         if (any(structure%parts%is_of_element)) note = note//"  (bearings as at the last frequency, no delayed feedback)"
      end if
      if (size(frequencies) == 0) then
         call say("natural     frequencies are not known: some part has neither mass nor support")
      else
         call say("natural     "//list_text(frequencies(:n), 1.0_wp)//" rad/s"//note)
         call say("            "//list_text(frequencies(:n), two_pi)//" Hz")
         if (any(frequencies < 0.0_wp) .and. .not. any(abs(structure%damping - transpose(structure%damping)) > 0.0_wp)) &
            call say("            negative: the structure at rest is unstable, disturbances grow at this rate")
      end if
   end subroutine describe_frequencies

   !> Lists the damping ratios of the lowest oscillating modes: 1 is critical damping, a negative one an unstable
   !> equilibrium.
   subroutine describe_damping(structure)
      type(structure_t), intent(in) :: structure
      integer, parameter :: most = 10
      integer, parameter :: largest = 200                        ! degrees of freedom: a general eigenvalue problem of twice as many
      real(wp), parameter :: rounding = 1.0e-13_wp               ! of a ratio
      real(wp), allocatable :: ratios(:)
      type(error_t), allocatable :: error
      type(modes_t) :: modes
      integer :: n
      character(:), allocatable :: note

      if (structure%n_dofs > largest .or. allocated(structure%sparse) .or. allocated(structure%parts)) return
      call new_modes(modes, structure%mass, structure%damping, structure%stiffness, error)
      if (allocated(error)) return
      n = min(modes%n_modes, most)
      if (structure%up_to > 0.0_wp) n = min(n, count(modes%frequency <= structure%up_to))
      if (n == 0) return
      note = ""
      if (n < modes%n_modes) note = "  (the "//to_text(n)//" lowest)"
      ratios = -modes%growth(:n)/hypot(modes%growth(:n), modes%frequency(:n))
      where (abs(ratios) < rounding) ratios = 0.0_wp
      call say("damping     "//list_text(ratios, 1.0_wp, "(es9.2)")//" of critical"//note)
   end subroutine describe_damping

   !> Formats numbers, with six digits unless a format is given.
   function list_text(values, unit, form) result(text)
      real(wp), intent(in) :: values(:), unit
      character(*), intent(in), optional :: form
      character(:), allocatable :: text, as
      character(24) :: number
      integer :: i

      text = ""
      do i = 1, size(values)
         as = six_digits(values(i)/unit)
         if (present(form)) as = form
         write (number, as) values(i)/unit + 0.0_wp                   ! no -0
         if (i > 1) text = text//", "
         text = text//trim(adjustl(number))
      end do
   end function list_text

   !> The form in which a number has six digits.
   pure function six_digits(value) result(form)
      real(wp), intent(in) :: value
      character(:), allocatable :: form
      integer :: power

      form = "(es24.5)"
      if (.not. abs(value) > 0.0_wp) form = "(f24.1)"
      if (.not. (abs(value) >= 1.0e-4_wp .and. abs(value) < 0.999999e6_wp)) return
      power = floor(log10(abs(value)*(1.0_wp + 5.0e-7_wp)))           ! of what it is rounded to
      form = "(f24."//to_text(max(0, 5 - power))//")"
   end function six_digits

   !> Describes how many unknowns are left where the motion is sought among odd ones.
   subroutine describe_symmetry(model, n_coordinates)
      type(model_t), intent(in) :: model
      integer, intent(in) :: n_coordinates
      type(discretisation_t) :: basis
      type(error_t), allocatable :: error
      logical :: is_odd

      call find_basis(basis, is_odd, model%system, model%discretisation, model%options, error)
      if (is_odd) call say("symmetry    odd motions, "//to_text(basis%harmonics%n_coefficients*n_coordinates)//" unknowns")
   end subroutine describe_symmetry

   !> Writes the estimated memory of a point, and its largest parts.
   subroutine describe_memory(model)
      type(model_t), intent(in) :: model
      type(memory_estimate_t) :: bytes
      character(:), allocatable :: text

      bytes = estimate_memory(sizes_of(model%system, model%discretisation, model%options))
      text = trim(amount(bytes%usual()))
      if (bytes%worst() > bytes%usual()) text = text//", "//trim(amount(bytes%worst()))//" if the first attempt at a solution fails"
      if (model%options%memory_limit < huge(1.0_wp)) &
         text = text//" for each process; "//trim(amount(model%options%memory_limit))//" are free"
      call say("memory      "//text)
      text = trim(memory_text(bytes))
      if (index(text(:scan(text//",", ",") - 1), " 0 MiB") == 0) call say("            most for: "//text)
   end subroutine describe_memory

   !> Frequency of a tone, or `unknown`.
   function tone_text(model, i) result(text)
      type(model_t), intent(in) :: model
      integer, intent(in) :: i
      character(:), allocatable :: text

      text = to_text(model%system%tones%in_unit(model%system%tones%omega(i)))//" "//trim(model%system%tones%unit())
      if (.not. model%system%tones%is_unknown(i)) return
      if (model%system%tones%omega(i) > 0.0_wp) then
         text = "unknown, first guess "//text
      else
         text = "unknown"
      end if
   end function tone_text

   !> Checks the derivatives of all laws of the first point and prints them as a table, with the names of wrong ones.
   subroutine check_laws(laws, n_tones, all_right, n_checked)
      type(law_box_t), intent(in) :: laws(:)
      integer, intent(in) :: n_tones
      logical, intent(out) :: all_right                               !! of those that were checked
      integer, intent(out) :: n_checked                               !! a signal ends the check early
      type(derivative_check_t) :: check
      character(:), allocatable :: text
      character(12) :: difference
      integer :: i, width

      all_right = .true.
      n_checked = 0
      if (size(laws) == 0) return
      width = max(11, maxval([(len(laws(i)%law%label), i=1, size(laws))]))
      call say("")
      call say(pad("derivatives", width)//"  difference  skipped       verdict")
      do i = 1, size(laws)
         if (signal_caught()) exit
         call install_crash_handler("law '"//laws(i)%law%label//"' has ended the process")
         call check_derivatives(laws(i)%law, check, n_tones)
         call remove_crash_handler()
         write (difference, "(es12.1)") check%difference
         call check%describe(text)
         call say(pad(laws(i)%law%label, width)//difference//"  "// &
            pad(to_text(check%n_skipped)//" of "//to_text(check%n_compared), 14)//text)
         all_right = all_right .and. check%is_sound()
         n_checked = i
      end do
      call say("difference: largest relative deviation of a derivative from finite differences; "// &
         "skipped: samples near kinks")
      call say("")
   end subroutine check_laws

   !> Text padded with blanks to a width.
   pure function pad(text, width)
      character(*), intent(in) :: text
      integer, intent(in) :: width
      character(max(width, len(text))) :: pad

      pad = text
   end function pad
end module verb_check
