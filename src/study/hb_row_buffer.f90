!> Results that are held back until several rows of a dataset can be written at once.
!>
!> A point writes a few bytes to some thirty datasets. A parallel file system takes only so many writes a second from all
!> ranks together, so each rank holds its results for a time that grows with the number of ranks. On few ranks that is less
!> than a point takes, and every point is written when it is solved.
module hb_row_buffer
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_checksum, only: checksum
   use hb_error, only: error_t, fail
   use hb_hdf5, only: h5_dataset_t
   use hb_kinds, only: wp
   use hb_results_plan, only: is_characters, is_integer, is_real, message_length, variable_t
   use hb_text, only: to_text
   implicit none
   private
   public :: row_buffer_t, hold_seconds, new_row_buffer, room_for

   real(wp), parameter :: writes_per_second = 5.0e4_wp                ! of all ranks, half of what a large file system takes
   real(wp), parameter :: shortest = 0.01_wp                          ! [s], for points that take less than that
   real(wp), parameter :: most_bytes = 1.6e7_wp                       ! [B] held by a rank
   integer, parameter :: most_rows = 128                              ! what a further one saves is below a hundredth of its writing

   !> Rows of one dataset, for consecutive points.
   type :: row_buffer_t
      private
      integer :: kind = is_real
      integer :: row_size = 0
      logical :: is_used = .false.                                    ! something that a new file does not hold anyway
      integer, allocatable :: integers(:, :)                          ! (row_size, room)
      real(wp), allocatable :: reals(:, :)                            ! (row_size, room)
      character(message_length), allocatable :: texts(:)              ! (room)
      logical :: is_part_used = .false.                               ! each row to its own extent
      integer :: n_first = 0, n_second = 0                            ! extents of the first two axes, where that is so
      integer, allocatable :: n_used(:)                               ! of the second one, (room)
   contains
      procedure :: add_to_checksum => row_buffer_add_to_checksum
      procedure :: blank => row_buffer_blank
      procedure :: flush => row_buffer_flush
      generic :: put => put_integers, put_reals, put_text
      generic :: put_part => put_integer_part, put_real_part
      procedure, private :: put_integer_part => row_buffer_put_integer_part
      procedure, private :: put_real_part => row_buffer_put_real_part
      procedure, private :: put_integers => row_buffer_put_integers
      procedure, private :: put_reals => row_buffer_put_reals
      procedure, private :: put_text => row_buffer_put_text
   end type row_buffer_t

contains

   !> Time [s] for which a rank holds results back.
   pure real(wp) function hold_seconds(n_ranks, n_datasets)
      integer, intent(in) :: n_ranks
      integer, intent(in) :: n_datasets                               !! that a point is written to

      hold_seconds = max(shortest, real(n_ranks, wp)*n_datasets/writes_per_second)
   end function hold_seconds

   !> Number of points that a rank holds at most, one or more, of those that there are.
   pure integer function room_for(bytes_per_point, n_points)
      real(wp), intent(in) :: bytes_per_point
      integer, intent(in) :: n_points

      room_for = max(1, int(min(real(min(most_rows, n_points), wp), most_bytes/max(bytes_per_point, 1.0_wp))))
   end function room_for

   !> Makes room for `room` rows of a dataset.
   pure subroutine new_row_buffer(self, variable, extents, room)
      type(row_buffer_t), intent(out) :: self
      type(variable_t), intent(in) :: variable
      integer, intent(in) :: extents(:)                               !! of the axes of a row, fastest first
      integer, intent(in) :: room
      integer :: row_size

      row_size = product(extents)
      self%is_part_used = variable%is_part_used
      if (self%is_part_used) then
         self%n_first = 1
         if (size(extents) > 1) self%n_first = extents(1)
         self%n_second = extents(min(2, size(extents)))
         allocate (self%n_used(room), source=0)
      end if
      self%kind = variable%kind
      self%row_size = row_size
      select case (variable%kind)
      case (is_integer); allocate (self%integers(row_size, room))
      case (is_real); allocate (self%reals(row_size, room))
      case (is_characters); allocate (self%texts(room))
      end select
   end subroutine new_row_buffer

   !> Fills row `k` with what a new file has there.
   pure subroutine row_buffer_blank(self, k)
      class(row_buffer_t), intent(inout) :: self
      integer, intent(in) :: k

      if (allocated(self%integers)) self%integers(:, k) = 0
      if (allocated(self%reals)) self%reals(:, k) = merge(0.0_wp, ieee_value(1.0_wp, ieee_quiet_nan), self%is_part_used)
      if (self%is_part_used) self%n_used(k) = 0
      if (allocated(self%texts)) self%texts(k) = ""
   end subroutine row_buffer_blank

   !> Goes on with the checksum over row `k`, byte by byte as in the file.
   subroutine row_buffer_add_to_checksum(self, k, so_far)
      class(row_buffer_t), intent(in) :: self
      integer, intent(in) :: k
      integer, intent(inout) :: so_far
      character(message_length) :: bytes

      select case (self%kind)
      case (is_integer); so_far = checksum(so_far, self%integers(:, k))
      case (is_real); so_far = checksum(so_far, self%reals(:, k))
      case (is_characters)
         bytes = trim(self%texts(k))//repeat(achar(0), message_length)
         so_far = checksum(so_far, bytes)
      end select
   end subroutine row_buffer_add_to_checksum

   !> Holds the integers of row `k`, all that a row of the dataset has.
   subroutine row_buffer_put_integers(self, k, values, error)
      class(row_buffer_t), intent(inout) :: self
      integer, intent(in) :: k
      integer, intent(in) :: values(:)
      type(error_t), allocatable, intent(out) :: error

      call check_size(self, size(values), error)
      if (allocated(error)) return
      self%integers(:, k) = values
      self%is_used = self%is_used .or. any(values /= 0)
   end subroutine row_buffer_put_integers

   !> Holds the real numbers of row `k`, all that a row of the dataset has.
   subroutine row_buffer_put_reals(self, k, values, error)
      class(row_buffer_t), intent(inout) :: self
      integer, intent(in) :: k
      real(wp), intent(in) :: values(..)                              !! of one to three dimensions
      type(error_t), allocatable, intent(out) :: error

      call check_size(self, size(values), error)
      if (allocated(error)) return
      select rank (values)
      rank (1); self%reals(:, k) = values
      rank (2); self%reals(:, k) = reshape(values, [size(values)])
      rank (3); self%reals(:, k) = reshape(values, [size(values)])
      rank default
         call fail(error, "values of more than three dimensions")
         return
      end select
      self%is_used = .true.
   end subroutine row_buffer_put_reals

   !> Puts the values of the harmonics that the row has, (first axis, harmonics, others).
   subroutine row_buffer_put_real_part(self, k, values, error)
      class(row_buffer_t), intent(inout) :: self
      integer, intent(in) :: k
      real(wp), intent(in) :: values(:, :, :)
      type(error_t), allocatable, intent(out) :: error
      integer :: d, first

      call check_size(self, size(values, 1)*self%n_second*size(values, 3), error)
      if (.not. allocated(error) .and. size(values, 2) > self%n_second) call fail(error, "the point has "// &
         to_text(size(values, 2))//" harmonics, the file has room for "//to_text(self%n_second))
      if (allocated(error)) return
      do d = 1, size(values, 3)
         first = (d - 1)*self%n_first*self%n_second
         self%reals(first + 1:first + size(values(:, :, d)), k) = reshape(values(:, :, d), [size(values(:, :, d))])
      end do
      self%n_used(k) = size(values, 2)
      self%is_used = .true.
   end subroutine row_buffer_put_real_part

   !> Puts the values of the harmonics that the row has, (first axis, harmonics).
   subroutine row_buffer_put_integer_part(self, k, values, error)
      class(row_buffer_t), intent(inout) :: self
      integer, intent(in) :: k
      integer, intent(in) :: values(:, :)
      type(error_t), allocatable, intent(out) :: error

      call check_size(self, size(values, 1)*self%n_second, error)
      if (.not. allocated(error) .and. size(values, 2) > self%n_second) call fail(error, "the point has "// &
         to_text(size(values, 2))//" harmonics, the file has room for "//to_text(self%n_second))
      if (allocated(error)) return
      self%integers(:size(values), k) = reshape(values, [size(values)])
      self%n_used(k) = size(values, 2)
      self%is_used = .true.
   end subroutine row_buffer_put_integer_part

   !> Holds the text of row `k`.
   subroutine row_buffer_put_text(self, k, text, error)
      class(row_buffer_t), intent(inout) :: self
      integer, intent(in) :: k
      character(*), intent(in) :: text
      type(error_t), allocatable, intent(out) :: error

      self%texts(k) = text
      self%is_used = self%is_used .or. len_trim(text) > 0
   end subroutine row_buffer_put_text

   subroutine check_size(self, n_values, error)
      type(row_buffer_t), intent(in) :: self
      integer, intent(in) :: n_values
      type(error_t), allocatable, intent(out) :: error

      if (n_values /= self%row_size) call fail(error, to_text(n_values)//" values, expected "//to_text(self%row_size))
   end subroutine check_size

   !> Writes the first `n` rows to rows `first` and following of the dataset, unless these are blank and those, too.
   subroutine row_buffer_flush(self, first, n, is_filled, dataset, error)
      class(row_buffer_t), intent(inout) :: self
      integer, intent(in) :: first, n
      logical, intent(in) :: is_filled                                !! the rows may hold other than what a new file does
      type(h5_dataset_t), intent(in) :: dataset
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      if (.not. (self%is_used .or. is_filled)) return
      self%is_used = .false.
      if (self%is_part_used .and. .not. is_filled) then
         do k = 1, n
            call flush_part(self, k, first + k - 1, dataset, error)
            if (allocated(error)) return
         end do
         return
      end if
      select case (self%kind)
      case (is_integer); call dataset%write_row(first, self%integers(:, :n), error, n)
      case (is_real); call dataset%write_row(first, self%reals(:, :n), error, n)
      case (is_characters)
         do k = 1, n
            call dataset%write_row(first + k - 1, trim(self%texts(k)), error)
            if (allocated(error)) return
         end do
      end select
   end subroutine row_buffer_flush

   !> Writes of row `k` what is used of it.
   subroutine flush_part(self, k, row, dataset, error)
      class(row_buffer_t), intent(in) :: self
      integer, intent(in) :: k
      integer, intent(in) :: row                                      !! of the dataset
      type(h5_dataset_t), intent(in) :: dataset
      type(error_t), allocatable, intent(out) :: error
      integer :: extents(3)
      real(wp), allocatable :: reals(:, :, :)
      integer, allocatable :: integers(:, :, :)

      if (self%n_used(k) == 0) return
      extents = [self%n_first, self%n_second, self%row_size/(self%n_first*self%n_second)]
      if (self%kind == is_integer) then
         integers = reshape(self%integers(:, k), extents)
         integers = integers(:, :self%n_used(k), :)
         call dataset%write_part(row, self%n_used(k), integers, error)
      else
         reals = reshape(self%reals(:, k), extents)
         reals = reals(:, :self%n_used(k), :)
         call dataset%write_part(row, self%n_used(k), reals, error)
      end if
   end subroutine flush_part
end module hb_row_buffer
