!> The result file of a run: the only writer of the schema in docs/user/schema.md.
!> Order of use: fill a `results_layout_t`; `create_results` or, to continue a file, `open_results`; then
!> `write_point` by any rank for any point; then `close`. The whole file is created before the first point is solved;
!> afterwards only raw data are written in place, the status of a point last, so that a killed run leaves a valid file
!> in which a status other than 0 means that the point is complete.
module hb_results
   use hb_clock, only: wall_clock
   use hb_crash_detection, only: crash_location_t
   use hb_crash_handler, only: install_crash_handler, remove_crash_handler
   use hb_error, only: annotate, error_t, fail
   use hb_hdf5, only: h5_dataset_t, h5_file_t, open_file_parallel
   use hb_kinds, only: wp
   use hb_line_numbering, only: line_up
   use hb_motion_result, only: curve_position_t, motion_result_t
   use hb_mpi, only: comm_t, rank_of, share_error, size_of
   use hb_operating_system, only: check_held, held_file_t, hold_file, unlock_file
   use hb_outcome, only: outcome
   use hb_result_columns, only: column_t, measure_row, message_length, new_plan
   use hb_results_file, only: make_file
   use hb_results_layout, only: check_layout, n_times, rank_times_t, results_layout_t, swept_parameter_t
   use hb_row_buffer, only: capacity_for, hold_seconds, new_row_buffer
   use hb_stored_rows, only: stored_file_t
   use hb_text, only: to_text
   implicit none
   private
   public :: create_results, open_results, results_t

   !> A result file open for writing.
   type, extends(stored_file_t) :: results_t
      private
      character(:), allocatable :: path
      integer :: n_points = 0, i_checksum = 0
      logical :: is_resumed = .false.                   !! rows may contain results of a previous run
      integer :: capacity = 1, first_held = 1, n_held = 0 ! points that are held
      real(wp) :: hold = 0.0_wp, flushed = 0.0_wp       ! [s] how long, and time of the last write
      type(held_file_t) :: held_file                    ! of rank 0: whether the file has been replaced
   contains
      procedure :: abandon => results_abandon
      procedure :: close => results_close
      procedure :: read_curve => results_read_curve
      procedure :: crash_location => results_crash_location
      procedure :: flush => results_flush
      procedure :: hold_seconds => results_hold_seconds
      procedure :: motion_size => results_motion_size
      procedure :: read_motions => results_read_motions
      procedure :: share => results_share
      procedure :: write_branches => results_write_branches
      procedure :: write_point => results_write_point
      procedure :: write_times => results_write_times
   end type results_t

contains

   !> Creates the result file and opens it on all ranks; collective, and an error is the same on all ranks.
   !> An existing file is an error unless `overwrite` is true. It is replaced only when the new file, which is created
   !> under another name in the same folder, is complete.
   subroutine create_results(self, path, layout, overwrite, comm, error)
      type(results_t), intent(out) :: self
      character(*), intent(in) :: path
      type(results_layout_t), intent(in) :: layout
      logical, intent(in) :: overwrite
      type(comm_t), intent(in) :: comm
      type(error_t), allocatable, intent(out) :: error

      call begin(self, path, layout, comm, error, overwrite)
   end subroutine create_results

   !> Opens a file that a previous run has created with the same layout, to write further points; collective, and an
   !> error is the same on all ranks.
   subroutine open_results(self, path, layout, comm, error)
      type(results_t), intent(out) :: self
      character(*), intent(in) :: path
      type(results_layout_t), intent(in) :: layout
      type(comm_t), intent(in) :: comm
      type(error_t), allocatable, intent(out) :: error

      call begin(self, path, layout, comm, error)
   end subroutine open_results

   !> Plans the file, creates it if it is new, and opens it.
   subroutine begin(self, path, layout, comm, error, overwrite)
      type(results_t), intent(inout) :: self
      character(*), intent(in) :: path
      type(results_layout_t), intent(in) :: layout
      type(comm_t), intent(in) :: comm
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: overwrite        !! replace an existing file; default: continue it

      self%path = path
      self%n_points = layout%n_points
      self%is_resumed = .not. present(overwrite)
      call check_layout(layout, error)
      if (.not. allocated(error)) call new_plan(self%plan, layout)
      if (present(overwrite) .and. rank_of(comm) == 0 .and. .not. allocated(error)) &
         call make_file(path, layout, self%plan, overwrite, error)
      call share_error(comm, error)
      if (.not. allocated(error)) call open_datasets(self, layout, comm, error)
      call annotate(error, "result file '"//path//"'")
   end subroutine begin

   !> Opens the file on all ranks, and allocates memory for the held rows; rejects datasets whose extents differ from
   !> those of the plan.
   subroutine open_datasets(self, layout, comm, error)
      type(results_t), intent(inout) :: self
      type(results_layout_t), intent(in) :: layout
      type(comm_t), intent(in) :: comm
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      if (rank_of(comm) == 0) call hold_file(self%path, self%held_file, error)
      call share_error(comm, error)
      if (allocated(error)) return
      if (self%is_resumed) call install_crash_handler("'"//self%path//"': HDF5 crashed on this file; it is damaged")
      call open_file_parallel(self%file, self%path, comm, error)
      call share_error(comm, error)
      if (allocated(error)) then
         call remove_crash_handler()
         return
      end if
      if (self%is_resumed) call fit_harmonics(self, error)
      do i = 1, size(self%plan%columns)
         associate (column => self%plan%columns(i))
            if (.not. allocated(error)) &
               call self%file%open_dataset(column%name, column%dataset, error, self%plan%extents_of(column))
            if (self%is_resumed .and. .not. allocated(error)) call check_meanings(self%file, column, error)
         end associate
      end do
      do i = 1, merge(0, size(self%plan%times), self%is_resumed)
         if (.not. allocated(error)) call self%file%open_dataset(self%plan%times(i)%name, self%plan%times(i)%dataset, error)
      end do
      call share_error(comm, error)
      if (allocated(error)) then
         call self%file%close(error)
         call unlock_file(self%held_file%descriptor)
      else
         call allocate_rows(self, size(layout%parameters), size_of(comm))
      end if
      call remove_crash_handler()
   end subroutine open_datasets

   !> Rejects a column whose numbers have other names in the file than in this program: its rows would have two meanings.
   subroutine check_meanings(file, column, error)
      type(h5_file_t), intent(in) :: file
      type(column_t), intent(in) :: column
      type(error_t), allocatable, intent(out) :: error
      character(:), allocatable :: commit, meanings, version

      if (.not. allocated(column%flags)) return
      call column%dataset%get_attribute("flag_meanings", meanings, error)
      if (allocated(error)) return
      if (meanings == column%flags) return
      call file%get_attribute("program_version", version, error)
      if (.not. allocated(error)) call file%get_attribute("git_commit", commit, error)
      if (.not. allocated(error)) call fail(error, "the numbers of '"//column%name//"' mean other things than in this version "// &
         "of the program; continue it with that which made it, version "//version//", commit "//commit// &
         ", or give another --output")
   end subroutine check_meanings

   !> Reduces the number of harmonics to that of the file, if it is complete and has room for fewer than the input
   !> permits.
   subroutine fit_harmonics(self, error)
      type(results_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error
      type(h5_dataset_t) :: dataset
      integer, allocatable :: extents(:)
      integer :: i, k

      do i = 1, size(self%plan%columns)
         if (.not. self%plan%columns(i)%is_part_used) cycle
         call self%file%open_dataset(self%plan%columns(i)%name, dataset, error)
         if (allocated(error)) return
         extents = dataset%get_extents()
         k = min(2, size(extents) - 1)
         if (k < 1 .or. size(extents) /= size(self%plan%columns(i)%axes)) cycle
         associate (axis => self%plan%axes(self%plan%columns(i)%axes(k)))
            axis%length = min(axis%length, extents(k))
         end associate
      end do
   end subroutine fit_harmonics

   !> Allocates memory for the held rows.
   subroutine allocate_rows(self, n_parameters, n_ranks)
      type(results_t), intent(inout) :: self
      integer, intent(in) :: n_parameters, n_ranks
      real(wp) :: n_bytes
      integer :: i, n_datasets

      call measure_row(self%plan, n_parameters, n_bytes, n_datasets)
      self%capacity = capacity_for(n_bytes, self%n_points)
      self%hold = hold_seconds(n_ranks, n_datasets)
      self%flushed = wall_clock()
      self%i_checksum = self%plan%index_of("checksum")
      do i = 1, size(self%plan%columns)
         associate (column => self%plan%columns(i), extents => self%plan%extents_of(self%plan%columns(i)))
            call new_row_buffer(column%held, column%kind, extents(:size(extents) - 1), self%capacity, column%is_part_used)
         end associate
      end do
   end subroutine allocate_rows

   !> Receives the result of point `i`, from 1; any rank may write any point at any time. Consecutive points are held
   !> for a while and written together, see hb_row_buffer and `flush`.
   subroutine results_write_point(self, i, point, error)
      class(results_t), intent(inout) :: self
      integer, intent(in) :: i
      type(motion_result_t), intent(in) :: point
      type(error_t), allocatable, intent(out) :: error
      integer :: k, sum

      if (i < 1 .or. i > self%n_points) then
         call fail(error, "result file '"//self%path//"': no point "//to_text(i)//", there are "// &
                   to_text(self%n_points))
         return
      end if
      if (self%n_held > 0 .and. i /= self%first_held + self%n_held) call self%flush(error)
      if (allocated(error)) return
      if (self%n_held == 0) self%first_held = i
      self%n_held = self%n_held + 1
      call self%plan%store_row(self%n_held, point, error)
      sum = 0
      do k = 1, size(self%plan%columns)
         if (self%plan%columns(k)%is_checked) call self%plan%columns(k)%held%add_to_checksum(self%n_held, sum)
      end do
      if (.not. allocated(error)) call self%plan%columns(self%i_checksum)%held%store(self%n_held, sum, error)
      call annotate(error, "point "//to_text(i))
      if (allocated(error)) then
         self%n_held = self%n_held - 1                  ! a row with an error is not written in part
         return
      end if
      if (self%n_held == self%capacity .or. wall_clock() - self%flushed >= self%hold) call self%flush(error)
   end subroutine results_write_point

   !> Time [s] for which a rank holds results.
   pure real(wp) function results_hold_seconds(self)
      class(results_t), intent(in) :: self

      results_hold_seconds = self%hold
   end function results_hold_seconds

   !> Location in the file at which a crash is recorded, for hb_crash_detection.
   type(crash_location_t) function results_crash_location(self) result(location)
      class(results_t), intent(in) :: self

      location%status = outcome%crashed
      location%status_offset = self%plan%columns(self%plan%index_of("status"))%dataset%get_offset(4)
      location%message_offset = self%plan%columns(self%plan%index_of("message"))%dataset%get_offset(1)
      location%message_length = message_length
   end function results_crash_location

   !> Writes the held rows, the statuses last; independent of other ranks. Rows that may contain results of a previous
   !> run are set to pending while they are overwritten, and written as far as they have some.
   subroutine results_flush(self, error)
      class(results_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error
      integer :: i, n

      call check_held(self%held_file, self%path, error)
      if (allocated(error)) then
         call annotate(error, "result file '"//self%path//"'")
         return
      end if
      n = self%n_held
      self%n_held = 0
      self%flushed = wall_clock()
      if (n == 0) return
      associate (columns => self%plan%columns, last => self%plan%index_of("status"))
         if (self%is_resumed) call columns(last)%dataset%write(spread(outcome%pending, 1, n), error, self%first_held)
         do i = 1, size(columns)
            if (i == last .or. allocated(error)) cycle
            call columns(i)%held%flush(self%first_held, n, self%is_resumed, columns(i)%dataset, error)
         end do
         if (.not. allocated(error)) &
            call columns(last)%held%flush(self%first_held, n, self%is_resumed, columns(last)%dataset, error)
      end associate
      call annotate(error, "result file '"//self%path//"': point "//to_text(self%first_held - 1)//" or after")
   end subroutine results_flush

   !> Writes the times of a rank, from 0; no effect for a file of a previous run, to whose ranks the rows belong.
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
            call variable%dataset%write(row(i), error, rank + 1)
         end associate
         if (allocated(error)) exit
      end do
      call annotate(error, "result file '"//self%path//"': times of rank "//to_text(rank))
   end subroutine results_write_times

   !> Writes the held rows, so that each rank can read all points after a barrier; collective. Several ranks wait for the
   !> disk. One does not: a sparse file that reached the disk takes 43 s to remove for 2840 points (ext4 with `discard`).
   subroutine results_share(self, n_ranks, error)
      class(results_t), intent(inout) :: self
      integer, intent(in) :: n_ranks
      type(error_t), allocatable, intent(out) :: error

      call self%flush(error)
      if (n_ranks > 1 .and. .not. allocated(error)) call self%file%flush(error)
   end subroutine results_share

   !> Number of coefficients that describe the motion of a point, at the degrees of freedom of the laws: 0 without
   !> laws.
   pure integer function results_motion_size(self)
      class(results_t), intent(in) :: self

      associate (extents => self%plan%extents_of(self%plan%columns(self%plan%index_of("corrected_coefficients"))))
         results_motion_size = product(extents(:size(extents) - 1))
      end associate
   end function results_motion_size

   !> Reads the statuses, motions and branches of consecutive points; independent of other ranks, after `share`.
   subroutine results_read_motions(self, first, status, motion, branch, error)
      class(results_t), intent(in) :: self
      integer, intent(in) :: first                      !! point, from 1
      integer, intent(out) :: status(:)                 !! (points)
      real(wp), allocatable, intent(out) :: motion(:, :) !! (any, points)
      integer, intent(out) :: branch(:)                 !! (points), as written by `write_point` or `write_branches`
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: tuples(:, :, :)

      associate (plan => self%plan, columns => self%plan%columns)
         allocate (motion(self%motion_size(), size(status)))
         call columns(plan%index_of("status"))%dataset%read(status, error, first)
         if (.not. allocated(error)) call columns(plan%index_of("corrected_coefficients"))%dataset%read(motion, error, first)
         if (.not. allocated(error)) call columns(plan%index_of("branch"))%dataset%read(branch, error, first)
         if (allocated(error) .or. plan%index_of("tuples") == 0) return
         associate (extents => plan%extents_of(columns(plan%index_of("tuples"))))
            allocate (tuples(extents(1), extents(2), size(motion, 2)))
         end associate
         call columns(plan%index_of("tuples"))%dataset%read(tuples, error, first)
      end associate
      if (.not. allocated(error)) call line_up(tuples, size(tuples, 2), motion, error)
   end subroutine results_read_motions

   !> Writes the branches of consecutive points; independent of other ranks.
   subroutine results_write_branches(self, first, branch, error)
      class(results_t), intent(in) :: self
      integer, intent(in) :: first                      !! point, from 1
      integer, intent(in) :: branch(:)                  !! (points)
      type(error_t), allocatable, intent(out) :: error

      call self%plan%columns(self%plan%index_of("branch"))%dataset%write(branch, error, first)
      call annotate(error, "result file '"//self%path//"': 'branch'")
   end subroutine results_write_branches

   !> Reads the statuses and the positions on curves of consecutive points; independent of other ranks, after `share`.
   subroutine results_read_curve(self, first, status, positions, error)
      class(results_t), intent(in) :: self
      integer, intent(in) :: first                      !! point, from 1
      integer, intent(out) :: status(:)                 !! (points)
      type(curve_position_t), intent(out) :: positions(:) !! (points)
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      call self%plan%columns(self%plan%index_of("status"))%dataset%read(status, error, first)
      do i = 1, size(status)
         if (.not. allocated(error)) call self%get_position(first + i - 1, positions(i), error, self%plan%curve_column)
      end do
   end subroutine results_read_curve

   !> Writes the held rows and closes the file; collective, safe to call twice. An earlier error is not replaced.
   subroutine results_close(self, error)
      class(results_t), intent(inout) :: self
      type(error_t), allocatable, intent(inout) :: error
      type(error_t), allocatable :: in_close, in_flush

      call self%flush(in_flush)
      call self%file%close(in_close)
      if (.not. allocated(in_close)) call check_held(self%held_file, self%path, in_close)
      call annotate(in_close, "result file '"//self%path//"'")
      if (allocated(in_flush)) call move_alloc(in_flush, in_close)
      if (.not. allocated(error)) call move_alloc(in_close, error)
      call unlock_file(self%held_file%descriptor)
      self%held_file%descriptor = -1
   end subroutine results_close

   !> Closes the file without writing the held rows; not collective.
   subroutine results_abandon(self)
      class(results_t), intent(inout) :: self

      call self%file%abandon()
      call unlock_file(self%held_file%descriptor)
      self%held_file%descriptor = -1
   end subroutine results_abandon
end module hb_results
