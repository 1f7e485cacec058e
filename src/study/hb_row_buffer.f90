!> Buffer of results, so that several rows of a dataset are written at once.
!> A point writes a few bytes to about thirty datasets. A parallel file system handles a limited number of writes per
!> second from all ranks together, so each rank holds its results for a time that grows with the number of ranks. On
!> few ranks this time is shorter than a point takes, and every point is written when it is solved.
module hb_row_buffer
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use, intrinsic :: iso_fortran_env, only: int8
   use hb_checksum, only: bytes_in, checksum, checksum_of_zeros
   use hb_error, only: error_t, fail
   use hb_hdf5, only: bytes_of_kind, h5_dataset_t, is_integer, is_real
   use hb_kinds, only: wp
   use hb_text, only: to_text
   implicit none
   private
   public :: capacity_for, hold_seconds, new_row_buffer, row_buffer_t

   real(wp), parameter :: writes_per_second = 5.0e4_wp                ! of all ranks, half of the capacity of a large file system
   real(wp), parameter :: min_point_time = 0.01_wp                    ! [s], for points that take less than that
   real(wp), parameter :: max_bytes = 1.6e7_wp                       ! [B] held by a rank
   integer, parameter :: max_rows = 128                              ! with more rows the saving is below one percent

   !> Rows of one dataset, for consecutive points, as the bytes of the file. Of rows with a part only this part is held, at
   !> the beginning: with the padding to the largest number of harmonics, rows of many degrees of freedom are megabytes.
   type :: row_buffer_t
      private
      integer :: kind = is_real                                       ! of the values, hb_hdf5
      integer, allocatable :: extents(:)                              ! of a row, fastest first
      integer :: row_size = 0                                         ! values
      integer :: part = 0                                             ! axis along which rows have their own lengths; 0: none
      logical :: is_used = .false.                                    ! it contains values that differ from those of a new file
      integer(int8), allocatable :: bytes(:, :)                       ! (bytes of a row, capacity)
      integer, allocatable :: n_used(:)                               ! of the axis `part`, (capacity)
   contains
      procedure :: add_to_checksum => row_buffer_add_to_checksum
      procedure :: blank => row_buffer_blank
      procedure :: flush => row_buffer_flush
      procedure :: store_none => row_buffer_store_none
      generic :: store => store_integers, store_reals, store_text
      procedure, private :: store_integers => row_buffer_store_integers
      procedure, private :: store_reals => row_buffer_store_reals
      procedure, private :: store_text => row_buffer_store_text
   end type row_buffer_t

contains

   !> Time [s] for which a rank holds its results.
   pure real(wp) function hold_seconds(n_ranks, n_datasets)
      integer, intent(in) :: n_ranks
      integer, intent(in) :: n_datasets                               !! written by a point

      hold_seconds = max(min_point_time, real(n_ranks, wp)*n_datasets/writes_per_second)
   end function hold_seconds

   !> Largest number of points that a rank holds, at least one.
   pure integer function capacity_for(bytes_per_point, n_points)
      real(wp), intent(in) :: bytes_per_point
      integer, intent(in) :: n_points

      capacity_for = max(1, int(min(real(min(max_rows, n_points), wp), max_bytes/max(bytes_per_point, 1.0_wp))))
   end function capacity_for

   !> Allocates `capacity` rows of a dataset.
   pure subroutine new_row_buffer(self, kind, extents, capacity, is_part_used)
      type(row_buffer_t), intent(out) :: self
      integer, intent(in) :: kind                                     !! of the values, hb_hdf5
      integer, intent(in) :: extents(:)                               !! of the axes of a row, fastest first
      integer, intent(in) :: capacity
      logical, intent(in) :: is_part_used                             !! rows use the first of their second, or only, axis

      self%kind = kind
      self%extents = extents
      self%row_size = product(extents)
      if (is_part_used) self%part = min(2, size(extents))
      allocate (self%bytes(bytes_of_kind(kind)*self%row_size, capacity))
      if (self%part == 0) self%bytes = 0_int8
      allocate (self%n_used(capacity), source=0)
   end subroutine new_row_buffer

   !> Fills row `k` with the values of a new file.
   subroutine row_buffer_blank(self, k)
      class(row_buffer_t), intent(inout) :: self
      integer, intent(in) :: k
      integer :: i

      self%n_used(k) = 0
      if (self%part > 0) return
      self%bytes(:, k) = 0_int8
      if (self%kind /= is_real) return
      do i = 0, self%row_size - 1
         self%bytes(8*i + 1:8*i + 8, k) = transfer(ieee_value(1.0_wp, ieee_quiet_nan), [0_int8])
      end do
   end subroutine row_buffer_blank

   !> Continues the checksum over row `k`, byte by byte as in the file.
   subroutine row_buffer_add_to_checksum(self, k, so_far)
      class(row_buffer_t), intent(in) :: self
      integer, intent(in) :: k
      integer, intent(inout) :: so_far
      integer :: i, n_block, n_padding

      if (self%part == 0 .or. size(self%bytes) == 0) then
         so_far = checksum(so_far, self%bytes(:, k))
         return
      end if
      n_block = n_entry(self)*self%n_used(k)
      n_padding = n_entry(self)*(self%extents(self%part) - self%n_used(k))
      do i = 0, n_blocks(self) - 1
         so_far = checksum(so_far, self%bytes(i*n_block + 1:(i + 1)*n_block, k))
         so_far = checksum_of_zeros(so_far, n_padding)
      end do
   end subroutine row_buffer_add_to_checksum

   !> Stores the integers of row `k`: all of the row, or those of its part.
   subroutine row_buffer_store_integers(self, k, values, error)
      class(row_buffer_t), intent(inout) :: self
      integer, intent(in) :: k
      integer, intent(in), contiguous, target :: values(..)
      type(error_t), allocatable, intent(out) :: error

      call store_bytes(self, k, bytes_in(values), shape(values), error)
   end subroutine row_buffer_store_integers

   !> As for integers.
   subroutine row_buffer_store_reals(self, k, values, error)
      class(row_buffer_t), intent(inout) :: self
      integer, intent(in) :: k
      real(wp), intent(in), contiguous, target :: values(..)
      type(error_t), allocatable, intent(out) :: error

      call store_bytes(self, k, bytes_in(values), shape(values), error)
   end subroutine row_buffer_store_reals

   !> Stores the text of row `k`, padded with zeros.
   subroutine row_buffer_store_text(self, k, text, error)
      class(row_buffer_t), intent(inout) :: self
      integer, intent(in) :: k
      character(*), intent(in) :: text
      type(error_t), allocatable, intent(out) :: error
      integer :: n

      n = min(len_trim(text), self%row_size)
      self%bytes(:, k) = 0_int8
      self%bytes(:n, k) = transfer(text(:n), [0_int8])
      self%is_used = self%is_used .or. n > 0
   end subroutine row_buffer_store_text

   !> Stores missing values in row `k`; for a part, one NaN entry.
   subroutine row_buffer_store_none(self, k, error)
      class(row_buffer_t), intent(inout) :: self
      integer, intent(in) :: k
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable, target :: values(:)
      integer :: extents(size(self%extents))

      call self%blank(k)
      if (self%part == 0 .or. self%kind /= is_real) return
      extents = self%extents
      extents(self%part) = 1
      allocate (values(product(extents)), source=ieee_value(1.0_wp, ieee_quiet_nan))
      call store_bytes(self, k, bytes_in(values), extents, error)
   end subroutine row_buffer_store_none

   subroutine store_bytes(self, k, values, extents, error)
      class(row_buffer_t), intent(inout) :: self
      integer, intent(in) :: k
      integer(int8), intent(in) :: values(:)
      integer, intent(in) :: extents(:)
      type(error_t), allocatable, intent(out) :: error

      call check_extents(self, extents, error)
      if (allocated(error) .or. size(self%bytes) == 0) return
      if (self%part == 0) then
         self%bytes(:, k) = values
      else
         self%n_used(k) = extents(self%part)
         self%bytes(:size(values), k) = values
      end if
      if (.not. self%is_used) self%is_used = self%part > 0 .or. self%kind /= is_integer .or. any(values /= 0_int8)
   end subroutine store_bytes

   !> Rejects values whose number differs from that of a row, or is larger along an axis with individual lengths.
   subroutine check_extents(self, extents, error)
      type(row_buffer_t), intent(in) :: self
      integer, intent(in) :: extents(:)                               !! as many axes as a row, if it has a part
      type(error_t), allocatable, intent(out) :: error
      integer :: whole(size(extents))

      whole = extents
      if (self%part > 0) whole(self%part) = self%extents(self%part)
      if (product(whole) /= self%row_size) then
         call fail(error, to_text(product(whole))//" values, expected "//to_text(self%row_size))
      else if (any(extents > whole)) then
         call fail(error, "the point has "//to_text(extents(self%part))//" harmonics, the file has room for "// &
                   to_text(whole(self%part)))
      end if
   end subroutine check_extents

   !> Writes the first `n` rows to the dataset, beginning at row `first`, unless both are blank. Of rows with a part no more is
   !> written than this part, and what the file has beyond: the rest of a sparse file has no room on the disk.
   subroutine row_buffer_flush(self, first, n, is_filled, dataset, error)
      class(row_buffer_t), intent(inout) :: self
      integer, intent(in) :: first, n
      logical, intent(in) :: is_filled                                !! the rows of the file may differ from those of a new file
      type(h5_dataset_t), intent(in) :: dataset
      type(error_t), allocatable, intent(out) :: error
      integer :: k, n_written

      if (.not. (self%is_used .or. is_filled)) return
      self%is_used = .false.
      if (self%part == 0 .or. size(self%bytes) == 0) then
         call dataset%write(self%bytes(:, :n), error, first)
         return
      end if
      do k = 1, n
         n_written = self%n_used(k)
         if (is_filled) call extend_over(self, dataset, first + k - 1, n_written, error)
         if (allocated(error)) return
         if (n_written > 0) call dataset%write(used_bytes(self, k, n_written), error, first + k - 1, n_written)
         if (allocated(error)) return
      end do
   end subroutine row_buffer_flush

   !> Extends a number of entries along the part to all that differ from zero in a row of the file.
   subroutine extend_over(self, dataset, row, n_used, error)
      class(row_buffer_t), intent(in) :: self
      type(h5_dataset_t), intent(in) :: dataset
      integer, intent(in) :: row
      integer, intent(inout) :: n_used
      type(error_t), allocatable, intent(out) :: error
      integer(int8), allocatable :: before(:, :), blocks(:, :, :)
      integer :: i

      allocate (before(size(self%bytes, 1), 1))
      call dataset%read(before, error, row)
      if (allocated(error)) return
      allocate (blocks, source=reshape(before, [n_entry(self), self%extents(self%part), n_blocks(self)]))
      do i = self%extents(self%part), n_used + 1, -1
         if (all(blocks(:, i, :) == 0_int8)) cycle
         n_used = i
         exit
      end do
   end subroutine extend_over

   !> The bytes of the first `n_used` entries of row `k`; zeros beyond those that it holds.
   pure function used_bytes(self, k, n_used) result(bytes)
      class(row_buffer_t), intent(in) :: self
      integer, intent(in) :: k, n_used
      integer(int8), allocatable :: bytes(:)
      integer :: i, n_held, n_here

      n_held = n_entry(self)*self%n_used(k)
      n_here = n_entry(self)*n_used
      allocate (bytes(n_here*n_blocks(self)), source=0_int8)
      do i = 0, n_blocks(self) - 1
         bytes(i*n_here + 1:i*n_here + n_held) = self%bytes(i*n_held + 1:(i + 1)*n_held, k)
      end do
   end function used_bytes

   !> Bytes of an entry along the part.
   pure integer function n_entry(self)
      class(row_buffer_t), intent(in) :: self

      n_entry = bytes_of_kind(self%kind)*product(self%extents(:self%part - 1))
   end function n_entry

   !> Blocks of a row, each with its own entries along the part.
   pure integer function n_blocks(self)
      class(row_buffer_t), intent(in) :: self

      n_blocks = product(self%extents(self%part + 1:))
   end function n_blocks
end module hb_row_buffer
