!> Texts of the command about a run: its points, the time of its ranks, and the located points of its curves.
module run_texts
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_advice, only: advice, advice_list_t
   use hb_curve_request, only: curve_request_t
   use hb_error, only: error_t
   use hb_hdf5, only: h5_dataset_t, h5_file_t, open_file
   use hb_interruption, only: interruption
   use hb_kinds, only: wp
   use hb_outcome, only: is_solved, outcome, outcome_names, outcome_text, reason
   use hb_point_kinds, only: curve_kind, curve_kind_names, curve_kinds, response_keys
   use hb_results_layout, only: rank_times_t, times_of_row
   use hb_results_record, only: message_of
   use hb_run_summary, only: has_answer, number_answered, run_summary_t
   use hb_signals, only: signal_caught, signal_name
   use hb_sweep_plan, only: sweep_plan_t
   use hb_text, only: add_string, number_of, string_t, to_text
   use hb_thresholds, only: equality_tolerance
   use hb_tones, only: tones_t
   implicit none
   private
   public :: answers_text, curve_lines, ending_text, find_gaps, found_frequency, is_regular_end, max_line, stability_text
   public :: timing_lines

   integer, parameter :: max_line = 160                               !! length of the lines that are returned
   integer, parameter :: max_points = 60                             ! of curves
   real(wp), parameter :: hides_others = 1.0e5_wp ! multiplier beside which a matrix that is accurate to 1e-6 leaves others an
                                                  !! error of 0.1: their number is not known

contains

   !> What has ended a run early.
   function ending_text(kind) result(text)
      integer, intent(in) :: kind                                     !! one of `interruption`
      character(:), allocatable :: text

      select case (kind)
      case (interruption%time_limit)
         text = "stopped by the time limit"
      case (interruption%signal)
         text = "stopped by a signal"
         if (signal_caught()) text = "stopped by "//signal_name()
      case default
         text = "ended early"
      end select
   end function ending_text

   !> Text with the frequency, or range of frequencies, of an unknown tone.
   function found_frequency(summary, tone, tones) result(text)
      type(run_summary_t), intent(in) :: summary
      integer, intent(in) :: tone
      type(tones_t), intent(in) :: tones                              !! with the unit of the input
      character(:), allocatable :: text
      character(24) :: lowest, highest

      text = "tone "//to_text(tone)//" was not found"
      if (summary%highest(tone) < summary%lowest(tone)) return
      write (lowest, "(g0.8)") tones%in_unit(summary%lowest(tone))
      write (highest, "(g0.8)") tones%in_unit(summary%highest(tone))
      text = "tone "//to_text(tone)//" at "//trim(lowest)//" "//trim(tones%unit())
      if (lowest /= highest) text = "tone "//to_text(tone)//" from "//trim(lowest)//" to "//trim(highest)//" "//trim(tones%unit())
   end function found_frequency

   !> Text with the number of points that converged, and of those found by time integration.
   pure function answers_text(summary) result(text)
      type(run_summary_t), intent(in) :: summary
      character(:), allocatable :: text
      integer :: n

      associate (converged => summary%counts(outcome%converged), of_all => " of "// &
                 to_text(summary%n_points - summary%counts(outcome%unused))//" points ")
         n = number_answered(summary) - converged
         text = to_text(converged)//of_all//"converged"
         if (n > 0) text = text//", "//to_text(n)//" found by time integration"
         if (n > 0 .and. converged == 0) text = to_text(n)//of_all//"found by time integration"
      end associate
   end function answers_text

   !> Counts motions that are stable, unstable and of unknown stability.
   pure function stability_text(n_stable, n_unstable, n_solved) result(text)
      integer, intent(in) :: n_stable, n_unstable, n_solved
      character(:), allocatable :: text

      text = to_text(n_stable)//" stable, "//to_text(n_unstable)//" unstable"
      if (n_stable + n_unstable < n_solved) text = text//", "//to_text(n_solved - n_stable - n_unstable)//" not known"
   end function stability_text

   !> Table of all ranks, one line each, and their sum; of many ranks only those with the least and the most idle
   !> time.
   function timing_lines(table) result(lines)
      real(wp), intent(in) :: table(:, :)                             !! (n_times, n_ranks), of hb_mpi%gather_rows
      character(max_line), allocatable :: lines(:)
      integer, parameter :: max_lines = 32
      integer, allocatable :: shown(:)
      integer :: i, n_ranks

      n_ranks = size(table, 2)
      allocate (shown, source=[(i, i=1, n_ranks)])
      if (n_ranks > max_lines) shown = [minloc(table(7, :)), maxloc(table(7, :))]
      lines = [character(max_line) :: &
         "    rank    points     draws   reading   solving   writing   drawing      idle     total [s]  overhead/point [s]"]
      do i = 1, size(shown)
         lines = [character(max_line) :: lines, times_line(to_text(shown(i) - 1), times_of_row(table(:, shown(i))))]
      end do
      if (n_ranks > 1) lines = [character(max_line) :: lines, times_line("all", times_of_row(sum(table, dim=2)))]
      lines = [character(max_line) :: lines, "idle share "//share_text(sum(table(7, :)), sum(table(8, :)))// &
               ", solving share "//share_text(sum(table(4, :)), sum(table(8, :)))]
   end function timing_lines

   function times_line(name, times) result(line)
      character(*), intent(in) :: name
      type(rank_times_t), intent(in) :: times
      character(112) :: line

      write (line, "(a8, 2i10, 6f10.3, es14.3)") name, times%n_points, times%n_draws, times%reading, times%solving, &
         times%writing, times%drawing, times%idle, times%total, times%overhead_per_point()
   end function times_line

   function share_text(part, whole) result(text)
      real(wp), intent(in) :: part, whole
      character(:), allocatable :: text
      character(16) :: buffer

      write (buffer, "(f8.2)") 100.0_wp*part/max(whole, tiny(1.0_wp))
      text = trim(adjustl(buffer))//" %"
   end function share_text

   !> A line for each special point: its kind, its values, its number; and advice on the curves. `plan` has the values of the
   !> curve.
   subroutine curve_lines(path, plan, lines, list, error)
      character(*), intent(in) :: path
      type(sweep_plan_t), intent(in) :: plan
      character(max_line), allocatable, intent(out) :: lines(:)
      type(advice_list_t), intent(out) :: list
      type(error_t), allocatable, intent(out) :: error
      type(h5_file_t) :: file
      type(sweep_plan_t) :: rounded                                   ! to ten digits
      character(16) :: digits
      integer, allocatable :: branch(:), is_stable(:), kind(:), n_unstable(:), reasons(:), response(:), status(:)
      integer, allocatable :: turned(:), vanishing(:)
      type(string_t), allocatable :: names(:)                         ! of all responses, if there are several
      real(wp), allocatable :: largest(:), lengths(:)
      integer :: first_gap, i, n

      allocate (lines(0))
      call open_file(file, path, error)
      if (allocated(error)) return
      call file%get("curve_kind", kind, error, [plan%n_points])
      call file%get("status", status, error, [plan%n_points])
      call file%get("curve_branch", branch, error, [plan%n_points])
      call file%get("curve_length", lengths, error, [plan%n_points])
      call file%get("is_stable", is_stable, error, [plan%n_points])
      call file%get("n_unstable", n_unstable, error, [plan%n_points])
      call file%get("reason", reasons, error, [plan%n_points])
      call file%get("curve_response", response, error, [plan%n_points])
      call read_largest_multipliers(file, plan%n_points, largest, error)
      call file%close(error)
      if (allocated(error)) return
      rounded = plan
      names = names_of_responses(plan)
      n = 0
      do i = 1, plan%n_points
         write (digits, "(es16.9)") plan%curve_values(i)
         read (digits, *) rounded%curve_values(i)
         if (any(kind(i) == [curve_kind%none, curve_kind%regular])) cycle
         n = n + 1
         if (n <= max_points) lines = [character(max_line) :: lines, line_of(i)]
      end do
      if (n > max_points) lines = [character(max_line) :: lines, "and "//to_text(n - max_points)//" more (see 'curve_kind')"]
      call find_gaps(merge(kind, curve_kind%none, is_solved(status)), branch, lengths, &
                     merge(n_unstable, -1, is_stable /= 0 .and. largest < hides_others), plan%n_fastest(), n, first_gap)
      if (allocated(plan%curve%over)) n = 0                           ! the points are themselves located, along other curves
      if (n > 0) call list%add(advice%unexplained_steps, [real(wp) :: n, first_gap - 1], rounded%describe(first_gap))
      n = count(reasons == reason%unlocated)
      if (n > 0) call list%add(advice%unlocated_of_curve, [real(wp) :: n, findloc(reasons, reason%unlocated, dim=1) - 1])
      n = count(reasons == reason%points)
      i = findloc(reasons, reason%points, dim=1)
      if (n > 0) call list%add(advice%cut_curves, [real(wp) :: n, plan%n_fastest()], rounded%describe(i), &
                                first_of(n), share_text(i))
      if (has_no_peak()) call list%add(advice%no_peak)
      n = count(reasons == reason%grazing)
      if (n > 0) call list%add(advice%ended_at_graze, [real(n, wp)])
      vanishing = pack([(i, i=1, plan%n_points)], [(is_regular_end(status(i), i, plan), i=1, plan%n_points)] .and. &
                       status == outcome%collapsed)
      n = size(vanishing)
      if (n > 0) call list%add(advice%vanishing_motion, [real(n, wp)], rounded%describe(vanishing(1)), first_of(n))
      do i = 1, plan%n_points
         if (status(i) /= outcome%locked .or. .not. is_regular_end(status(i), i, plan)) cycle
         lines = [character(max_line) :: lines, "point "//to_text(i - 1)//": "//message_of(path, i)]
      end do
      turned = rows_turned_back(plan%curve_values, kind, plan%n_fastest(), plan%curve%curve_request_t)
      if (size(turned) == 0) return
      associate (from => plan%curve%from, to => plan%curve%to, start => plan%curve_values(turned(1)))
         call list%add(advice%returned_curves, [real(size(turned), wp), start, &
                                                merge(to, from, abs(start - from) < abs(start - to))])
      end associate

   contains

      !> Percentage of the range that a curve covers.
      function share_text(point) result(text)
         integer, intent(in) :: point
         character(:), allocatable :: text

         text = to_text(int(100.0_wp*plan%share_covered(point)))
         if (text == "0") text = "less than 1"
      end function share_text

      !> That the first of several is meant.
      pure character(8) function first_of(n)
         integer, intent(in) :: n

         first_of = merge(" (first)", repeat(" ", 8), n > 1)
      end function first_of

      !> Whether peaks were requested along curves that have none, although they end regularly.
      logical function has_no_peak()
         integer :: k

         k = findloc(response_keys, "peak_of", dim=1)
         has_no_peak = size(plan%curve%responses_of(k)%names) > 0 .and. any(kind == curve_kind%end) .and. &
                       .not. (any(kind == curve_kind%peak) .or. allocated(plan%curve%over))
      end function has_no_peak

      function line_of(point) result(line)
         integer, intent(in) :: point
         character(:), allocatable :: line, message

         associate (name => curve_kind_names(kind(point)))
            line = name(:max(7, len_trim(name)))
         end associate
         line = line//" at "//rounded%describe(point)//", point "//to_text(point - 1)
         if (response(point) > 0 .and. response(point) <= size(names)) line = line//", of "//names(response(point))%value
         if (.not. is_solved(status(point))) then
            line = line//", "//outcome_text(status(point))
         else if (.not. has_answer(status(point))) then
            line = line//", not converged: "//trim(outcome_names(status(point)))
         end if
         if (all(kind(point) /= [curve_kind%start, curve_kind%end])) return
         message = message_of(path, point)                            ! such as that it begins at the other end, or why it ends
         if (len(message) > 0) line = line//": "//message
      end function line_of
   end subroutine curve_lines

   !> Names of the responses of curves, in the order of their numbers; none if there is one name alone.
   function names_of_responses(plan) result(names)
      type(sweep_plan_t), intent(in) :: plan
      type(string_t), allocatable :: names(:)
      integer :: i, j, k

      allocate (names(0))
      do k = 1, size(response_keys)
         associate (responses => plan%curve%responses_of(k))
            do i = 1, size(responses%names)
               do j = 1, max(1, size(responses%targets))
                  call add_string(names, responses%names(i)%value)
               end do
            end do
         end associate
      end do
      if (size(names) == 0) return
      if (all([(names(i)%value == names(1)%value, i=1, size(names))])) names = [string_t ::]
   end function names_of_responses

   !> Whether a point without a motion is the regular end of a curve: that of an unknown tone vanishes, as at a Hopf point, or it
   !> locks to another tone.
   pure logical function is_regular_end(status, point, plan)
      integer, intent(in) :: status
      integer, intent(in) :: point                                    !! from 1
      type(sweep_plan_t), intent(in) :: plan

      is_regular_end = .false.
      if (allocated(plan%curve)) is_regular_end = any(status == [outcome%collapsed, outcome%locked]) .and. &
                                                    modulo(point - 1, plan%n_fastest()) > 0
   end function is_regular_end

   !> Magnitude of the largest multiplier of each point; 0 without multipliers.
   subroutine read_largest_multipliers(file, n_points, largest, error)
      type(h5_file_t), intent(in) :: file
      integer, intent(in) :: n_points
      real(wp), allocatable, intent(out) :: largest(:)
      type(error_t), allocatable, intent(inout) :: error
      type(h5_dataset_t) :: dataset
      real(wp), allocatable :: imaginary(:), real_part(:)
      integer, allocatable :: extents(:)
      integer :: i, n

      allocate (largest(n_points), source=0.0_wp)
      if (allocated(error)) return
      if (.not. (file%has("multiplier_real") .and. file%has("multiplier_imag"))) return
      call file%open_dataset("multiplier_real", dataset, error)
      if (allocated(error)) return
      extents = dataset%get_extents()
      call dataset%close()
      call file%get("multiplier_real", real_part, error, extents)
      call file%get("multiplier_imag", imaginary, error, extents)
      if (allocated(error)) return
      n = size(real_part)/max(1, n_points)
      if (n == 0) return
      largest = [(hypot(real_part((i - 1)*n + 1), imaginary((i - 1)*n + 1)), i=1, n_points)]
      where (.not. ieee_is_finite(largest)) largest = 0.0_wp
   end subroutine read_largest_multipliers

   !> Counts the steps along curves on which the number of growing disturbances changes without a point on the step or
   !> next to it that explains this. Steps with an unknown number are passed over.
   pure subroutine find_gaps(kind, branch, length, n_unstable, n_rows, n_gaps, first)
      integer, intent(in) :: kind(:), branch(:)                       !! of all points of all curves
      real(wp), intent(in) :: length(:)                               !! likewise, along the curve: one direction is negative
      integer, intent(in) :: n_unstable(:)                            !! likewise, -1: not known
      integer, intent(in) :: n_rows                                   !! for one curve
      integer, intent(out) :: n_gaps
      integer, intent(out) :: first                                   !! point at the end of the first such step; 0: none
      integer, parameter :: steps(2) = [curve_kind%regular, curve_kind%start]
      integer, allocatable :: along(:), at(:), rows(:)
      integer :: b, i, k, last, row

      n_gaps = 0
      first = 0
      do row = 1, size(kind), n_rows
         do b = 0, maxval(branch(row:min(row + n_rows - 1, size(kind))))
            rows = pack([(i, i=row, min(row + n_rows - 1, size(kind)))], branch(row:min(row + n_rows - 1, size(kind))) == b)
            rows = pack(rows, kind(rows) /= curve_kind%none)
            along = pack(rows, length(rows) < 0.0_wp)
            along = [along(size(along):1:-1), pack(rows, .not. length(rows) < 0.0_wp)]
            at = pack([(i, i=1, size(along))], [(any(steps == kind(along(i))), i=1, size(along))])
            last = 0
            do k = 1, size(at)                                        ! from one step of known stability to the next
               if (n_unstable(along(at(k))) < 0) cycle
               if (last > 0) then
                  associate (near => kind(along(at(max(1, last - 1)):at(min(size(at), k + 1)))))
                     if (n_unstable(along(at(last))) /= n_unstable(along(at(k))) .and. &
                         .not. any(curve_kinds(near)%is_bifurcation .or. curve_kinds(near)%multipliers_jump .or. &
                                   (b > 0 .and. near == curve_kind%start))) then ! a branch starts at a bifurcation
                        n_gaps = n_gaps + 1
                        if (first == 0) first = along(at(k))
                     end if
                  end associate
               end if
               last = k
            end do
         end do
      end do
   end subroutine find_gaps

   !> First rows of the curves that start at an end of their range and return to it.
   pure function rows_turned_back(values, kind, n_rows, request) result(rows)
      real(wp), intent(in) :: values(:)                               !! of all points of all curves
      integer, intent(in) :: kind(:)                                  !! likewise
      integer, intent(in) :: n_rows                                   !! for one curve
      type(curve_request_t), intent(in) :: request
      integer, allocatable :: rows(:)
      integer :: i

      allocate (rows(0))
      associate (near => equality_tolerance*abs(request%to - request%from))
         do i = 0, size(kind) - n_rows, n_rows
            associate (start => values(i + 1), ends => pack(values(i + 1:i + n_rows), kind(i + 1:i + n_rows) == curve_kind%end))
               if (min(abs(start - request%from), abs(start - request%to)) > near) cycle
               if (size(ends) > 0 .and. all(abs(ends - start) <= near)) rows = [rows, i + 1]
            end associate
         end do
      end associate
   end function rows_turned_back
end module run_texts
