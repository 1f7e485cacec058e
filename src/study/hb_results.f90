!> The result file of a run: the only writer of the schema in docs/user/schema.md.
!>
!> In the order of use: fill a `results_layout_t`, `create_results` or, to go on with a file, `open_results`, then
!> `write_point` by any rank for any point, then `close`. The file is made whole before the first point is solved;
!> after that only raw data are written in place, the status of a point last, so that a killed run leaves a sound
!> file in which a status other than 0 means complete.
module hb_results
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan, ieee_quiet_nan, ieee_value
   use hb_branches, only: left_branch
   use hb_clock, only: wall_clock
   use hb_crash_watch, only: crash_place_t
   use hb_error, only: annotate, error_t, fail
   use hb_guard, only: lower_guard, raise_guard
   use hb_harmonics, only: harmonics_t, new_box
   use hb_hdf5, only: h5_dataset_t, h5_file_t, open_file_parallel
   use hb_row_buffer, only: row_buffer_t, hold_seconds, new_row_buffer, room_for
   use hb_kinds, only: wp
   use hb_motion_result, only: curve_place_t, motion_result_t
   use hb_mpi, only: comm_t, rank_of, share_error, size_of
   use hb_outcome, only: outcome
   use hb_results_file, only: make_file
   use hb_results_layout, only: check_layout, results_layout_t, swept_parameter_t
   use hb_results_plan, only: harmonic_axis, identifier, is_checked, is_integer, measure_row, message_length, multiplier_axis, &
      new_plan, plan_t, tone_axis
   use hb_stability, only: stability_t
   use hb_system, only: check_held, held_file_t, hold_file, release_file
   use hb_text, only: shortened, to_text
   use hb_timing, only: n_times, rank_times_t
   implicit none
   private
   public :: create_results, open_results, results_layout_t, results_t, swept_parameter_t

   !> A result file open for writing.
   type :: results_t
      private
      type(h5_file_t) :: file
      character(:), allocatable :: path
      type(plan_t) :: plan
      character(:), allocatable :: curve_variable       ! name of the value that moves along curves
      integer :: n_points = 0
      integer :: i_put = 0                              ! variable of the plan that was put last
      logical :: has_accuracy = .false., has_own_tuples = .false.     ! as the layout says
      logical :: is_resumed = .false.                   !! rows may hold what a run before has left
      type(row_buffer_t), allocatable :: held(:)         ! for each variable of the plan
      logical, allocatable :: is_checked(:)             ! same; whether the checksum goes over it
      integer :: room = 1, first_held = 1, n_held = 0   ! points that are held back
      real(wp) :: hold = 0.0_wp, flushed = 0.0_wp       ! [s] how long, and when the last was written
      type(held_file_t) :: place                        ! of rank 0: whether the file is still what it was
   contains
      procedure :: abandon => results_abandon
      procedure :: close => results_close
      procedure :: read_curve => results_read_curve
      procedure :: crash_place => results_crash_place
      procedure :: flush => results_flush
      procedure :: hold_seconds => results_hold_seconds
      procedure :: motion_size => results_motion_size
      procedure :: read_motions => results_read_motions
      procedure :: share => results_share
      procedure :: write_branches => results_write_branches
      procedure :: write_point => results_write_point
      procedure :: write_times => results_write_times
   end type results_t

   !> Puts values into the row of the point that is taken; does nothing once there is an error, so that a point reads as
   !> a plain list.
   interface put
      module procedure put_integer
      module procedure put_real
   end interface put

contains

   !> Makes the result file and opens it on all ranks; collective, and an error is the same on all ranks.
   !>
   !> An existing file is an error unless `overwrite` is true. It is replaced only when the new file is
   !> complete: that is made under another name in the same folder.
   subroutine create_results(self, path, layout, overwrite, comm, error)
      type(results_t), intent(out) :: self
      character(*), intent(in) :: path
      type(results_layout_t), intent(in) :: layout
      logical, intent(in) :: overwrite
      type(comm_t), intent(in) :: comm
      type(error_t), allocatable, intent(out) :: error

      call take_layout(self, path, layout, error)
      if (rank_of(comm) == 0 .and. .not. allocated(error)) call make_file(path, layout, self%plan, overwrite, error)
      call share_error(comm, error)
      if (.not. allocated(error)) call open_datasets(self, layout, comm, error)
      call annotate(error, "result file '"//path//"'")
   end subroutine create_results

   !> Opens a file that a run before has made from the same layout, to write further points; collective, and an error is
   !> the same on all ranks.
   subroutine open_results(self, path, layout, comm, error)
      type(results_t), intent(out) :: self
      character(*), intent(in) :: path
      type(results_layout_t), intent(in) :: layout
      type(comm_t), intent(in) :: comm
      type(error_t), allocatable, intent(out) :: error

      self%is_resumed = .true.
      call take_layout(self, path, layout, error)
      call share_error(comm, error)
      if (.not. allocated(error)) call open_datasets(self, layout, comm, error)
      call annotate(error, "result file '"//path//"'")
   end subroutine open_results

   !> Plans the file.
   subroutine take_layout(self, path, layout, error)
      type(results_t), intent(inout) :: self
      character(*), intent(in) :: path
      type(results_layout_t), intent(in) :: layout
      type(error_t), allocatable, intent(out) :: error

      self%path = path
      call check_layout(layout, error)
      if (allocated(error)) return
      self%n_points = layout%n_points
      self%has_accuracy = layout%has_accuracy
      self%has_own_tuples = layout%has_own_tuples
      call new_plan(self%plan, layout)
      if (allocated(layout%curve_parameter)) self%curve_variable = identifier(layout%curve_parameter)
   end subroutine take_layout

   !> Opens the file on all ranks, and makes room for the rows that are held back; refuses datasets of other extents than
   !> those of the plan.
   subroutine open_datasets(self, layout, comm, error)
      type(results_t), intent(inout) :: self
      type(results_layout_t), intent(in) :: layout
      type(comm_t), intent(in) :: comm
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: error_in_close
      integer :: i

      if (rank_of(comm) == 0) call hold_file(self%path, self%place, error)
      call share_error(comm, error)
      if (allocated(error)) return
      if (self%is_resumed) call raise_guard("'"//self%path//"': HDF5 died of this file; it is damaged")
      call open_file_parallel(self%file, self%path, comm, error)
      call share_error(comm, error)
      if (allocated(error)) then
         call lower_guard()
         return
      end if
      if (self%is_resumed) call fit_places(self, error)
      do i = 1, merge(0, size(self%plan%variables), allocated(error))
         associate (variable => self%plan%variables(i))
            call self%file%open_dataset(variable%name, variable%dataset, error)
            if (allocated(error)) exit
            if (.not. same_numbers(variable%dataset%get_extents(), self%plan%axes(variable%axes)%length)) &
               call fail(error, "dataset '"//variable%name//"' has other extents than the input asks for")
         end associate
         if (allocated(error)) exit
      end do
      if (.not. (allocated(error) .or. self%is_resumed)) then
         do i = 1, size(self%plan%times)
            call self%file%open_dataset(self%plan%times(i)%name, self%plan%times(i)%dataset, error)
            if (allocated(error)) exit
         end do
      end if
      call share_error(comm, error)
      if (allocated(error)) then
         call self%file%close(error_in_close)
         call release_file(self%place%descriptor)
      else
         call make_room(self, size(layout%parameters), size_of(comm))
      end if
      call lower_guard()
   end subroutine open_datasets

   !> Takes as many places for harmonics as the file has where it was complete and has fewer than the input allows.
   subroutine fit_places(self, error)
      type(results_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error
      type(h5_dataset_t) :: dataset
      integer, allocatable :: extents(:)
      integer :: i, k

      do i = 1, size(self%plan%variables)
         if (.not. self%plan%variables(i)%is_part_used) cycle
         call self%file%open_dataset(self%plan%variables(i)%name, dataset, error)
         if (allocated(error)) return
         extents = dataset%get_extents()
         k = min(2, size(extents) - 1)
         if (k < 1 .or. size(extents) /= size(self%plan%variables(i)%axes)) cycle
         associate (axis => self%plan%axes(self%plan%variables(i)%axes(k)))
            axis%length = min(axis%length, extents(k))
         end associate
      end do
   end subroutine fit_places

   pure logical function same_numbers(a, b)
      integer, intent(in) :: a(:), b(:)

      same_numbers = size(a) == size(b)
      if (same_numbers) same_numbers = all(a == b)
   end function same_numbers

   !> Makes room for the rows that are held back.
   subroutine make_room(self, n_parameters, n_ranks)
      type(results_t), intent(inout) :: self
      integer, intent(in) :: n_parameters, n_ranks
      real(wp) :: n_bytes
      integer :: i, n_datasets

      call measure_row(self%plan, n_parameters, n_bytes, n_datasets)
      self%room = room_for(n_bytes, self%n_points)
      self%hold = hold_seconds(n_ranks, n_datasets)
      self%flushed = wall_clock()
      self%is_checked = is_checked(self%plan%variables)
      self%i_put = index_of(self, "status")
      allocate (self%held(size(self%plan%variables)))
      do i = 1, size(self%held)
         associate (axes => self%plan%variables(i)%axes)
            call new_row_buffer(self%held(i), self%plan%variables(i), self%plan%axes(axes(:size(axes) - 1))%length, self%room)
         end associate
      end do
   end subroutine make_room

   !> Takes the result of point `i`, from 1; any rank may give any point at any time. Points that follow each other are
   !> held back for a while and written together, see hb_row_buffer and `flush`.
   subroutine results_write_point(self, i, point, error)
      class(results_t), intent(inout) :: self
      integer, intent(in) :: i
      type(motion_result_t), intent(in) :: point
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      if (i < 1 .or. i > self%n_points) then
         call fail(error, "result file '"//self%path//"': no point "//to_text(i)//", there are "// &
                   to_text(self%n_points))
         return
      end if
      if (self%n_held > 0 .and. i /= self%first_held + self%n_held) call self%flush(error)
      if (allocated(error)) return
      if (self%n_held == 0) self%first_held = i
      self%n_held = self%n_held + 1
      do k = 1, size(self%held)
         call self%held(k)%blank(self%n_held)
      end do
      call put_message(self, point%message, error)
      call put(self, "iterations", [point%iterations], error)
      call put(self, "rescue", [point%rescue], error)
      call put(self, "evaluations", [point%evaluations], error)
      call put(self, "residual", [point%residual], error)
      call put(self, "solve_seconds", [point%solve_seconds], error)
      call put(self, "setup_seconds", [point%setup_seconds], error)
      call put(self, "iteration_seconds", [point%solver_seconds], error)
      call put(self, "certificate_seconds", [point%certificate_seconds], error)
      call put(self, "rank", [point%rank], error)
      call put(self, "n_harmonics", [point%n_harmonics], error)
      call put(self, "n_unknowns", [point%n_unknowns], error)
      call put(self, "is_odd", [merge(1, 0, point%is_odd)], error)
      call put(self, "n_full_stick", [point%n_full_stick], error)
      call put(self, "n_motions", [point%n_motions], error)
      call put(self, "is_marched_first", [merge(1, 0, point%is_marched_first)], error)
      if (allocated(point%frequency)) call put(self, "frequency", point%frequency, error)
      if (allocated(point%artificial_damping)) call put(self, "artificial_damping", point%artificial_damping, error)
      if (self%has_accuracy) then
         call put(self, "n_rungs", [point%n_rungs], error)
         call put(self, "rung_difference", [point%rung_difference], error)
         call put(self, "level_estimate", [point%level_estimate], error)
         if (allocated(point%n_samples)) call put(self, "grid", point%n_samples, error)
         if (allocated(point%output_estimate)) call put(self, "output_estimate", point%output_estimate, error)
      end if
      call put_coefficients(self, point, error)
      if (allocated(point%improved_coefficients)) call put(self, "improved_coefficients", point%improved_coefficients, error)
      if (allocated(point%certificate%combination)) call put_certificate(self, point, error)
      call put_stability(self, point%stability, error)
      if (allocated(point%curve)) call put_curve(self, point%curve, error)
      if (allocated(point%displacement_samples)) call put(self, "displacement_samples", point%displacement_samples, error)
      if (allocated(point%corrected_samples)) call put(self, "corrected_samples", point%corrected_samples, error)
      if (allocated(point%force_samples)) call put(self, "force_samples", point%force_samples, error)
      if (point%leaves_branch) call put(self, "branch", [left_branch], error)
      call put(self, "status", [point%status], error)
      if (.not. allocated(error)) call put(self, "checksum", [checksum_of_row(self)], error)
      call annotate(error, "point "//to_text(i))
      if (allocated(error)) then
         self%n_held = self%n_held - 1                  ! what could not be taken whole is not written in part
         return
      end if
      if (self%n_held == self%room .or. wall_clock() - self%flushed >= self%hold) call self%flush(error)
   end subroutine results_write_point

   !> Checksum over what is held of the point that is taken.
   integer function checksum_of_row(self) result(sum)
      class(results_t), intent(in) :: self
      integer :: i

      sum = 0
      do i = 1, size(self%held)
         if (self%is_checked(i)) call self%held(i)%add_to_checksum(self%n_held, sum)
      end do
   end function checksum_of_row

   !> Gives the time [s] for which a rank holds results back.
   pure real(wp) function results_hold_seconds(self)
      class(results_t), intent(in) :: self

      results_hold_seconds = self%hold
   end function results_hold_seconds

   !> Says where in the file a crash is noted, for hb_crash_watch.
   type(crash_place_t) function results_crash_place(self) result(place)
      class(results_t), intent(in) :: self

      place%status = outcome%crashed
      place%status_offset = self%plan%variables(index_of(self, "status"))%dataset%get_offset(4)
      place%message_offset = self%plan%variables(index_of(self, "message"))%dataset%get_offset(1)
      place%message_length = message_length
   end function results_crash_place

   !> Writes what is held back, the statuses last; independent of other ranks. Rows that a run before may have filled are
   !> pending while they are written over, and written whole.
   subroutine results_flush(self, error)
      class(results_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error
      integer :: i, i_status, n

      call check_held(self%place, self%path, error)
      if (allocated(error)) then
         call annotate(error, "result file '"//self%path//"'")
         return
      end if
      n = self%n_held
      self%n_held = 0
      self%flushed = wall_clock()
      if (n == 0) return
      i_status = index_of(self, "status")
      associate (status => self%plan%variables(i_status)%dataset)
         if (self%is_resumed) call status%write_row(self%first_held, spread([outcome%pending], 2, n), error, n)
         do i = 1, size(self%held)
            if (allocated(error)) exit
            if (i /= i_status) call self%held(i)%flush(self%first_held, n, self%is_resumed, self%plan%variables(i)%dataset, error)
         end do
         if (.not. allocated(error)) call self%held(i_status)%flush(self%first_held, n, self%is_resumed, status, error)
      end associate
      call annotate(error, "result file '"//self%path//"': point "//to_text(self%first_held - 1)//" or after")
   end subroutine results_flush

   !> Writes where the time of a rank, from 0, went; nothing in the file of a run before, whose ranks the rows are of.
   subroutine results_write_times(self, rank, times, error)
      class(results_t), intent(inout) :: self
      integer, intent(in) :: rank
      type(rank_times_t), intent(in) :: times
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: row(n_times + 1)
      integer :: i

      if (self%is_resumed) return
      row = [times%as_row(), times%overhead_per_point()]
      do i = 1, size(self%plan%times)
         associate (variable => self%plan%times(i))
            if (rank >= product(variable%dataset%get_extents())) return
            if (variable%kind == is_integer) then
               call variable%dataset%write_row(rank + 1, [nint(row(i))], error)
            else
               call variable%dataset%write_row(rank + 1, row(i:i), error)
            end if
         end associate
         if (allocated(error)) exit
      end do
      call annotate(error, "result file '"//self%path//"': times of rank "//to_text(rank))
   end subroutine results_write_times

   !> Writes what is held back, so that every rank may read every point after a barrier; collective.
   subroutine results_share(self, error)
      class(results_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error

      call self%flush(error)
      if (.not. allocated(error)) call self%file%flush(error)
   end subroutine results_share

   !> Number of coefficients that tell the motion of a point, at the degrees of freedom of the laws: 0 without laws.
   pure integer function results_motion_size(self)
      class(results_t), intent(in) :: self
      integer :: i

      i = index_of(self, "corrected_coefficients")
      associate (axes => self%plan%variables(i)%axes)
         results_motion_size = product(self%plan%axes(axes(:size(axes) - 1))%length)
      end associate
   end function results_motion_size

   !> Reads the statuses, motions and branches of points that follow each other; independent of other ranks, after `share`.
   subroutine results_read_motions(self, first, status, motion, branch, error)
      class(results_t), intent(in) :: self
      integer, intent(in) :: first                      !! point, from 1
      integer, intent(out) :: status(:)                 !! (points)
      real(wp), intent(out) :: motion(:, :)             !! (motion_size, points)
      integer, intent(out) :: branch(:)                 !! (points), as `write_point` or `write_branches` left them
      type(error_t), allocatable, intent(out) :: error

      associate (variables => self%plan%variables)
         call variables(index_of(self, "status"))%dataset%read_rows(first, status, error)
         if (.not. allocated(error)) &
            call variables(index_of(self, "corrected_coefficients"))%dataset%read_rows(first, motion, error)
         if (.not. allocated(error)) call variables(index_of(self, "branch"))%dataset%read_rows(first, branch, error)
      end associate
      if (.not. allocated(error) .and. index_of(self, "tuples") > 0) call line_up(self, first, motion, error)
   end subroutine results_read_motions

   !> Puts motions of points that have tuples of their own onto the tuples of a box, so that they can be compared; what lies
   !> outside of it carries little.
   subroutine line_up(self, first, motion, error)
      class(results_t), intent(in) :: self
      integer, intent(in) :: first                      !! point, from 1
      real(wp), intent(inout) :: motion(:, :)           !! (motion_size, points)
      type(error_t), allocatable, intent(out) :: error
      type(harmonics_t) :: box
      integer, allocatable :: tuples(:, :, :)
      real(wp), allocatable :: own(:, :, :), moved(:, :, :)
      integer :: h, k, n_tones, order, p

      associate (variable => self%plan%variables(index_of(self, "tuples")))
         allocate (tuples(self%plan%axes(variable%axes(1))%length, self%plan%axes(variable%axes(2))%length, size(motion, 2)), &
                   source=0)
         call variable%dataset%read_rows(first, tuples, error)
      end associate
      if (allocated(error)) return
      n_tones = size(tuples, 1)
      order = 0
      do while ((2*order + 3.0_wp)**n_tones + 1.0_wp <= 2.0_wp*size(tuples, 2))
         order = order + 1
      end do
      call new_box(box, spread(order, 1, n_tones), .false., error)
      if (allocated(error)) return
      do p = 1, size(motion, 2)
         own = reshape(motion(:, p), [2, size(tuples, 2), size(motion, 1)/(2*size(tuples, 2))])
         moved = 0.0_wp*own
         do h = 1, size(tuples, 2)
            if (h > 1 .and. all(tuples(:, h, p) == 0)) exit           ! not in use
            k = box%index_of(tuples(:, h, p))
            if (k > 0) moved(:, k, :) = own(:, h, :)
         end do
         motion(:, p) = reshape(moved, [size(motion, 1)])
      end do
   end subroutine line_up

   !> Writes the branches of points that follow each other; independent of other ranks.
   subroutine results_write_branches(self, first, branch, error)
      class(results_t), intent(in) :: self
      integer, intent(in) :: first                      !! point, from 1
      integer, intent(in) :: branch(:)                  !! (points)
      type(error_t), allocatable, intent(out) :: error

      call self%plan%variables(index_of(self, "branch"))%dataset%write_row(first, branch, error, size(branch))
      call annotate(error, "result file '"//self%path//"': 'branch'")
   end subroutine results_write_branches

   !> Where on a curve the point is; what its state lacks of the row stays NaN.
   subroutine put_curve(self, place, error)
      class(results_t), intent(inout) :: self
      type(curve_place_t), intent(in) :: place
      type(error_t), allocatable, intent(inout) :: error
      real(wp) :: state(self%plan%axes(size(self%plan%axes))%length)
      integer :: i, n

      if (.not. allocated(self%curve_variable)) return
      state = ieee_value(1.0_wp, ieee_quiet_nan)
      n = 0
      if (allocated(place%state)) n = size(place%state)
      if (n > 0) state(:n) = place%state
      call put(self, "curve_kind", [place%kind], error)
      call put(self, "curve_branch", [place%branch], error)
      call put(self, "curve_length", [place%length], error)
      i = index_of(self, "curve_state")
      if (.not. self%plan%variables(i)%is_part_used) then
         call put(self, "curve_state", state, error)
      else if (.not. allocated(error)) then                           ! up to a first NaN
         call self%held(i)%put_part(self%n_held, reshape(state(:n + 1), [1, n + 1, 1]), error)
      end if
      call put(self, self%curve_variable, [place%parameter], error)
   end subroutine put_curve

   !> Reads the statuses of points that follow each other, and where on a curve they are; independent of other ranks, after
   !> `share`.
   subroutine results_read_curve(self, first, status, places, error)
      class(results_t), intent(in) :: self
      integer, intent(in) :: first                      !! point, from 1
      integer, intent(out) :: status(:)                 !! (points)
      type(curve_place_t), intent(out) :: places(:)     !! (points)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: state(:, :)
      real(wp), dimension(1, size(status)) :: length, parameter
      integer, allocatable :: grid(:, :), n_harmonics(:), tuples(:, :, :)
      integer :: i

      allocate (state(self%plan%axes(size(self%plan%axes))%length, 1), n_harmonics(size(status)))
      associate (variables => self%plan%variables)
         call variables(index_of(self, "status"))%dataset%read_rows(first, status, error)
         if (.not. allocated(error)) call variables(index_of(self, "curve_kind"))%dataset%read_rows(first, places%kind, error)
         if (.not. allocated(error)) call variables(index_of(self, "curve_branch"))%dataset%read_rows(first, places%branch, error)
         if (.not. allocated(error)) call variables(index_of(self, "curve_length"))%dataset%read_rows(first, length, error)
         if (.not. allocated(error)) call variables(index_of(self, self%curve_variable))%dataset%read_rows(first, parameter, error)
         if (.not. allocated(error)) call variables(index_of(self, "n_harmonics"))%dataset%read_rows(first, n_harmonics, error)
         do i = 1, size(status)
            if (allocated(error)) return
            places(i)%length = length(1, i)
            places(i)%parameter = parameter(1, i)
            if (places(i)%kind == 0) cycle
            call variables(index_of(self, "curve_state"))%dataset%read_rows(first + i - 1, state, error)
            places(i)%state = state(:max(0, merge(size(state), findloc(ieee_is_nan(state(:, 1)), .true., dim=1) - 1, &
                                                  .not. any(ieee_is_nan(state)))), 1)
            if (index_of(self, "grid") == 0 .or. allocated(error)) cycle
            allocate (grid(self%plan%axes(tone_axis)%length, 1))
            call variables(index_of(self, "grid"))%dataset%read_rows(first + i - 1, grid, error)
            places(i)%n_samples = grid(:, 1)
            deallocate (grid)
            if (index_of(self, "tuples") == 0 .or. allocated(error)) cycle
            allocate (tuples(self%plan%axes(tone_axis)%length, self%plan%axes(harmonic_axis)%length, 1))
            call variables(index_of(self, "tuples"))%dataset%read_rows(first + i - 1, tuples, error)
            places(i)%tuples = tuples(:, :n_harmonics(i), 1)
            deallocate (tuples)
         end do
      end associate
   end subroutine results_read_curve

   !> Coefficients of the harmonics of the file or, where it has places for them, of those of the point. What is not known is no
   !> number at the first place.
   subroutine put_coefficients(self, point, error)
      class(results_t), intent(inout) :: self
      type(motion_result_t), intent(in) :: point
      type(error_t), allocatable, intent(inout) :: error

      if (.not. self%has_own_tuples) then
         if (allocated(point%coefficients)) call put(self, "coefficients", point%coefficients, error)
         if (allocated(point%force_coefficients)) call put(self, "force_coefficients", point%force_coefficients, error)
         if (allocated(point%corrected_coefficients)) call put(self, "corrected_coefficients", point%corrected_coefficients, error)
         return
      end if
      if (allocated(point%harmonics%tuples) .and. .not. allocated(error)) &
         call self%held(index_of(self, "tuples"))%put_part(self%n_held, point%harmonics%tuples, error)
      call put_part(self, "coefficients", point%coefficients, error)
      call put_part(self, "force_coefficients", point%force_coefficients, error)
      call put_part(self, "corrected_coefficients", point%corrected_coefficients, error)
   end subroutine put_coefficients

   subroutine put_part(self, name, values, error)
      class(results_t), intent(inout) :: self
      character(*), intent(in) :: name
      real(wp), allocatable, intent(in) :: values(:, :, :)            !! (2, n_harmonics, any)
      type(error_t), allocatable, intent(inout) :: error
      integer :: i

      if (allocated(error)) return
      i = index_of(self, name)
      if (allocated(values)) then
         call self%held(i)%put_part(self%n_held, values, error)
      else
         associate (axis => self%plan%axes(self%plan%variables(i)%axes(3)))
            call self%held(i)%put_part(self%n_held, reshape(spread(ieee_value(1.0_wp, ieee_quiet_nan), 1, 2*axis%length), &
                                                            [2, 1, axis%length]), error)
         end associate
      end if
      call annotate(error, "'"//name//"'")
   end subroutine put_part

   subroutine put_certificate(self, point, error)
      class(results_t), intent(inout) :: self
      type(motion_result_t), intent(in) :: point
      type(error_t), allocatable, intent(inout) :: error

      associate (found => point%certificate)
         if (allocated(found%frequency_error)) call put(self, "frequency_estimate", found%frequency_error, error)
         call put(self, "truncation_estimate", [found%truncation], error)
         call put(self, "aliasing_estimate", [found%aliasing], error)
         call put(self, "penetration", [found%defects%penetration], error)
         call put(self, "impact_estimate", [found%impact], error)
         call put(self, "tension", [found%defects%tension], error)
         call put(self, "complementarity", [found%defects%complementarity], error)
         call put(self, "slip_defect", [found%defects%slip], error)
         call put(self, "power_in", [found%power_in], error)
         call put(self, "power_damping", [found%power_damping], error)
         call put(self, "power_laws", found%power_laws, error)
         call put(self, "energy_kinetic", [found%energy%kinetic], error)
         call put(self, "energy_strain", [found%energy%strain], error)
         associate (loss => found%power_damping + sum(found%power_laws))
            call put(self, "loss_factor", [found%energy%loss_factor(loss)], error)
            call put(self, "equivalent_damping", [found%energy%decay(loss)], error)
         end associate
         call put(self, "combination_frequency", [found%combination_frequency], error)
         call put(self, "combination", found%combination, error)
         call put(self, "is_near_commensurate", [merge(1, 0, point%is_near_commensurate)], error)
      end associate
   end subroutine put_certificate

   !> Multipliers and exponents that the structure does not have are no numbers.
   subroutine put_stability(self, stability, error)
      class(results_t), intent(inout) :: self
      type(stability_t), intent(in) :: stability
      type(error_t), allocatable, intent(inout) :: error
      complex(wp) :: row(self%plan%axes(multiplier_axis)%length)
      real(wp) :: rates(size(row))
      integer :: n

      call put(self, "is_stable", [stability%verdict], error)
      call put(self, "n_unstable", [stability%n_unstable], error)
      call put(self, "stability_method", [stability%method], error)
      if (.not. allocated(stability%exponents)) return
      call put(self, "stability_estimate", [stability%estimate], error)
      if (size(row) == 0) return
      rates = ieee_value(1.0_wp, ieee_quiet_nan)
      n = min(size(row), size(stability%exponents))
      rates(:n) = stability%exponents(:n)
      call put(self, "exponent", rates, error)
      if (.not. allocated(stability%multipliers)) return
      row = cmplx(ieee_value(1.0_wp, ieee_quiet_nan), ieee_value(1.0_wp, ieee_quiet_nan), wp)
      row(:n) = stability%multipliers(:n)
      call put(self, "multiplier_real", real(row), error)
      call put(self, "multiplier_imag", aimag(row), error)
   end subroutine put_stability

   !> Writes what is held back and closes the file; collective, safe to call twice.
   subroutine results_close(self, error)
      class(results_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: error_in_close

      call self%flush(error)
      call self%file%close(error_in_close)
      call annotate(error_in_close, "result file '"//self%path//"'")
      if (.not. allocated(error)) call move_alloc(error_in_close, error)
      if (.not. allocated(error)) then
         call check_held(self%place, self%path, error)
         call annotate(error, "result file '"//self%path//"'")
      end if
      call release_file(self%place%descriptor)
      self%place%descriptor = -1
   end subroutine results_close

   !> Leaves the file as it is, without what is held back; not collective.
   subroutine results_abandon(self)
      class(results_t), intent(inout) :: self

      call self%file%abandon()
      call release_file(self%place%descriptor)
      self%place%descriptor = -1
   end subroutine results_abandon

   subroutine put_integer(self, name, values, error)
      class(results_t), intent(inout) :: self
      character(*), intent(in) :: name
      integer, intent(in), contiguous :: values(:)
      type(error_t), allocatable, intent(inout) :: error

      if (allocated(error)) return
      self%i_put = index_of(self, name, self%i_put)
      call self%held(self%i_put)%put(self%n_held, values, error)
      if (allocated(error)) call annotate(error, "'"//name//"'")
   end subroutine put_integer

   subroutine put_real(self, name, values, error)
      class(results_t), intent(inout) :: self
      character(*), intent(in) :: name
      real(wp), intent(in), contiguous :: values(..)
      type(error_t), allocatable, intent(inout) :: error

      if (allocated(error)) return
      self%i_put = index_of(self, name, self%i_put)
      if (self%i_put == 0) then
         call fail(error, "'"//name//"' given, but the layout has no room for it")
         return
      end if
      call self%held(self%i_put)%put(self%n_held, values, error)
      if (allocated(error)) call annotate(error, "'"//name//"'")
   end subroutine put_real

   subroutine put_message(self, message, error)
      class(results_t), intent(inout) :: self
      character(*), intent(in), optional :: message    !! empty where it is not there
      type(error_t), allocatable, intent(inout) :: error
      character(:), allocatable :: text

      if (allocated(error)) return
      text = ""
      if (present(message)) text = shortened(message, message_length)
      call self%held(index_of(self, "message"))%put(self%n_held, text, error)
   end subroutine put_message

   !> Gives the index of the variable called `name`, 0 when the file has none.
   pure integer function index_of(self, name, from)
      class(results_t), intent(in) :: self
      character(*), intent(in) :: name
      integer, intent(in), optional :: from            !! variable that is looked at last: the next one comes first
      integer :: i, n, shift

      n = size(self%plan%variables)
      shift = 0
      if (present(from)) shift = from
      do i = 1, n
         index_of = modulo(shift + i - 1, n) + 1
         if (self%plan%variables(index_of)%name == name) return
      end do
      index_of = 0
   end function index_of
end module hb_results
