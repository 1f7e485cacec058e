!> Table of the located points of the curves of a result file: folds, peaks, values and ends.
module hb_curve_table
   use hb_curve_request, only: curve_kind, curve_kind_names
   use hb_error, only: error_t
   use hb_hdf5, only: h5_dataset_t, h5_file_t, open_file
   use hb_kinds, only: wp
   use hb_outcome, only: is_solved, outcome_text
   use hb_parameter_path, only: identifier
   use hb_results_record, only: message_of
   use hb_sweep_plan, only: sweep_plan_t
   use hb_text, only: number_of, to_text
   implicit none
   private
   public :: curve_lines, find_gaps, find_leaving, leaving_t, note_curve_values

   integer, parameter :: most_lines = 60

   !> A point of a curve at which other motions branch off.
   type :: leaving_t
      integer :: point = 0                                            !! from 1
      integer :: kind = 0                                             !! hb_curve_request%curve_kind
      integer :: beyond = 0                                           !! of a graze: the adjacent point, on the side of contact
   end type leaving_t

contains

   !> Stores in a plan the values of the points of curves in a file.
   subroutine note_curve_values(path, plan, error)
      character(*), intent(in) :: path
      type(sweep_plan_t), intent(inout) :: plan
      type(error_t), allocatable, intent(out) :: error
      type(h5_file_t) :: file
      type(h5_dataset_t) :: dataset

      if (.not. allocated(plan%curve)) return
      allocate (plan%curve_values(plan%n_points))
      call open_file(file, path, error)
      if (allocated(error)) return
      call file%open_dataset(identifier(plan%curve%path), dataset, error)
      if (.not. allocated(error)) call dataset%get_attribute("units", plan%curve%units, error)
      if (.not. allocated(error)) call dataset%read(plan%curve_values, error)
      if (allocated(plan%curve%over)) call file%get("curve_over", plan%over_values, error, [plan%n_points])
      call file%close(error)
   end subroutine note_curve_values

   !> Lists the points at which other motions branch off the curves of a file: period doublings, torus bifurcations,
   !> and grazes with a loss of stability.
   subroutine find_leaving(path, n_points, leaving, error)
      character(*), intent(in) :: path
      integer, intent(in) :: n_points
      type(leaving_t), allocatable, intent(out) :: leaving(:)
      type(error_t), allocatable, intent(out) :: error
      type(h5_file_t) :: file
      integer, allocatable :: is_stable(:), kind(:)
      integer :: after, before, beyond, i

      allocate (leaving(0))
      call open_file(file, path, error)
      if (allocated(error)) return
      call file%get("curve_kind", kind, error, [n_points])
      call file%get("is_stable", is_stable, error, [n_points])
      call file%close(error)
      if (allocated(error)) return
      do i = 1, n_points
         beyond = i
         if (kind(i) == curve_kind%graze) then
            before = max(1, i - 1)
            after = min(n_points, i + 1)
            if (is_stable(before) > 0 .and. is_stable(after) < 0) beyond = after
            if (is_stable(before) < 0 .and. is_stable(after) > 0) beyond = before
         end if
         if (any(kind(i) == [curve_kind%flip, curve_kind%torus]) .or. beyond /= i) &
            leaving = [leaving, leaving_t(i, kind(i), beyond)]
      end do
   end subroutine find_leaving

   !> A line for each special point: its kind, its values, its number. `plan` has the values of the curve.
   subroutine curve_lines(path, plan, lines, error)
      character(*), intent(in) :: path
      type(sweep_plan_t), intent(in) :: plan
      character(:), allocatable, intent(out) :: lines(:)
      type(error_t), allocatable, intent(out) :: error
      type(h5_file_t) :: file
      type(sweep_plan_t) :: rounded                                   ! to ten digits
      character(16) :: digits
      integer, allocatable :: branch(:), is_stable(:), kind(:), n_unstable(:), status(:)
      integer :: first_gap, i, n

      allocate (character(160) :: lines(0))
      call open_file(file, path, error)
      if (allocated(error)) return
      call file%get("curve_kind", kind, error, [plan%n_points])
      call file%get("status", status, error, [plan%n_points])
      call file%get("curve_branch", branch, error, [plan%n_points])
      call file%get("is_stable", is_stable, error, [plan%n_points])
      call file%get("n_unstable", n_unstable, error, [plan%n_points])
      call file%close(error)
      if (allocated(error)) return
      rounded = plan
      n = 0
      do i = 1, plan%n_points
         write (digits, "(es16.9)") plan%curve_values(i)
         read (digits, *) rounded%curve_values(i)
         if (any(kind(i) == [curve_kind%none, curve_kind%regular])) cycle
         n = n + 1
         if (n <= most_lines) lines = [character(160) :: lines, line_of(i)]
      end do
      if (n > most_lines) lines = [character(160) :: lines, "and "//to_text(n - most_lines)//" more (see 'curve_kind')"]
      call find_gaps(merge(kind, curve_kind%none, is_solved(status)), branch, merge(n_unstable, -1, is_stable /= 0), &
                     plan%n_fastest(), n, first_gap)
      if (allocated(plan%curve%over)) n = 0                           ! the points are themselves located, along other curves
      if (n > 0) lines = [character(160) :: lines, number_of(n, "step")//", first at "//rounded%describe(first_gap)// &
         ", point "//to_text(first_gap - 1)//": 'n_unstable' changes without a located bifurcation"]
      n = number_cut_short(kind, status, plan%n_fastest())
      if (n > 0) lines = [character(160) :: lines, number_of(n, "curve")//" reached the limit of "//to_text(plan%n_fastest())// &
         " points: increase 'points' of &curve"]

   contains

      function line_of(point) result(line)
         integer, intent(in) :: point
         character(:), allocatable :: line, message

         associate (name => curve_kind_names(kind(point)))
            line = name(:max(7, len_trim(name)))
         end associate
         line = line//" at "//rounded%describe(point)//", point "//to_text(point - 1)
         if (.not. is_solved(status(point))) line = line//", "//outcome_text(status(point))
         if (kind(point) /= curve_kind%start) return
         message = message_of(path, point)                            ! such as that it begins at the other end
         if (len(message) > 0) line = line//": "//message
      end function line_of
   end subroutine curve_lines

   !> Counts the steps on which the number of growing disturbances changes without a point on the step or next to it
   !> that explains this. Steps with an unknown number at either end do not count, nor does the start of a branch.
   pure subroutine find_gaps(kind, branch, n_unstable, n_rows, n_gaps, first)
      integer, intent(in) :: kind(:), branch(:)                       !! of all points of all curves
      integer, intent(in) :: n_unstable(:)                            !! likewise, -1: not known
      integer, intent(in) :: n_rows                                   !! for one curve
      integer, intent(out) :: n_gaps
      integer, intent(out) :: first                                   !! point at the end of the first such step; 0: none
      integer, parameter :: steps(2) = [curve_kind%regular, curve_kind%start]
      integer, parameter :: reasons(6) = [curve_kind%fold, curve_kind%branch, curve_kind%flip, curve_kind%torus, curve_kind%split, &
                                          curve_kind%graze]
      integer :: before, first_row, i, k, next

      n_gaps = 0
      first = 0
      before = 0
      do i = 1, size(kind)
         if (modulo(i - 1, n_rows) == 0 .or. kind(i) == curve_kind%start) before = 0
         if (all(steps /= kind(i)) .or. n_unstable(i) < 0) cycle
         if (before > 0) then
            if (n_unstable(before) /= n_unstable(i) .and. branch(before) == branch(i)) then
               next = i                                               ! the end of the following step
               do k = i + 1, min(size(kind), i + n_rows - 1 - modulo(i - 1, n_rows))
                  next = k
                  if (any(steps == kind(k))) exit
               end do
               do k = before - 1, i - modulo(i - 1, n_rows), -1       ! the beginning of the previous step
                  if (any(steps == kind(k))) exit
               end do
               first_row = max(k, i - modulo(i - 1, n_rows))
               if (.not. any([(any(reasons == kind(k)), k=first_row, next)])) then
                  n_gaps = n_gaps + 1
                  if (first == 0) first = i
               end if
            end if
         end if
         before = i
      end do
   end subroutine find_gaps

   !> Number of curves whose last row is not an end: they have used all of their points, and could continue.
   pure integer function number_cut_short(kind, status, n_rows) result(n)
      integer, intent(in) :: kind(:), status(:)                       !! of all points of all curves
      integer, intent(in) :: n_rows                                   !! for one curve

      associate (last_kind => kind(n_rows::n_rows), last_status => status(n_rows::n_rows))
         n = count(is_solved(last_status) .and. last_kind /= curve_kind%end)
      end associate
   end function number_cut_short
end module hb_curve_table
