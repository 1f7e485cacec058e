!> Finds rows of a result file that are damaged: each has a checksum over its values in most datasets.
module hb_row_checks
   use hb_checksum, only: checksum_rows
   use hb_error, only: annotate, error_t, fail
   use hb_hdf5, only: h5_dataset_t, h5_file_t, open_file
   use hb_kinds, only: int64
   use hb_outcome, only: outcome
   use hb_text, only: join, number_of, split, string_t, to_text
   implicit none
   private
   public :: count_pending, fail_where_damaged, find_damaged_rows, refuse_damaged_rows

contains

   !> Returns which points have other numbers than were written. What has no result, or a crash noted in it, has no checksum.
   subroutine find_damaged_rows(path, status, is_damaged, error)
      character(*), intent(in) :: path
      integer, intent(in) :: status(:)                                !! of the points
      logical, allocatable, intent(out) :: is_damaged(:)              !! (points)
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: error_in_close
      type(h5_file_t) :: file
      type(h5_dataset_t) :: dataset
      character(:), allocatable :: names
      integer :: expected(size(status)), found(size(status))

      allocate (is_damaged(size(status)), source=.false.)
      call open_file(file, path, error)
      if (.not. allocated(error)) call file%open_dataset("checksum", dataset, error)
      if (.not. allocated(error)) call dataset%read(expected, error)
      if (.not. allocated(error)) call dataset%get_attribute("of", names, error)
      if (.not. allocated(error)) call add_up(file, path, names, found, error)
      call file%close(error_in_close)
      call annotate(error, "checksums of '"//path//"'")
      if (allocated(error)) return
      is_damaged = found /= expected .and. status /= outcome%pending .and. status /= outcome%crashed
   end subroutine find_damaged_rows

   !> Fails where rows of these points are damaged.
   subroutine refuse_damaged_rows(path, status, points, error)
      character(*), intent(in) :: path
      integer, intent(in) :: status(:)                                !! of all points
      integer, intent(in) :: points(:)                                !! from 0; empty: all
      type(error_t), allocatable, intent(out) :: error
      logical, allocatable :: is_damaged(:)
      integer :: i

      call find_damaged_rows(path, status, is_damaged, error)
      if (allocated(error)) return
      if (size(points) > 0) is_damaged = is_damaged .and. [(any(points == i - 1), i=1, size(status))]
      call fail_where_damaged(path, is_damaged, error)
   end subroutine refuse_damaged_rows

   !> Fails with the names of damaged points, if there are any.
   pure subroutine fail_where_damaged(path, is_damaged, error)
      character(*), intent(in) :: path
      logical, intent(in) :: is_damaged(:)                            !! (points)
      type(error_t), allocatable, intent(out) :: error
      integer, parameter :: most = 20                                 ! points that are named
      integer, allocatable :: points(:)
      type(string_t), allocatable :: names(:)
      character(:), allocatable :: more
      integer :: i

      points = pack([(i - 1, i=1, size(is_damaged))], is_damaged)
      if (size(points) == 0) return
      allocate (names(min(size(points), most)))
      do i = 1, size(names)
         names(i)%value = to_text(points(i))
      end do
      more = ""
      if (size(points) > most) more = " and "//to_text(size(points) - most)//" more"
      call fail(error, "result file '"//path//"' is damaged: the results of "//number_of(size(points), "point")// &
                " are not what was written ("//join(names, ", ")//more//"); nhbm resume "//path//" solves them again")
   end subroutine fail_where_damaged

   !> Checksums of all rows over the datasets of these names, with blanks between them.
   subroutine add_up(file, path, names, checksums, error)
      type(h5_file_t), intent(in) :: file
      character(*), intent(in) :: path, names
      integer, intent(out) :: checksums(:)
      type(error_t), allocatable, intent(out) :: error
      integer, parameter :: value_sizes(3) = [4, 8, 1]
      type(h5_dataset_t) :: dataset
      type(string_t), allocatable :: words(:)
      integer(int64) :: offset, row_bytes
      integer :: i, k
      logical :: ok

      checksums = 0
      call split(names, " ", words)
      do i = 1, size(words)
         call file%open_dataset(words(i)%value, dataset, error)
         if (allocated(error)) return
         associate (extents => dataset%get_extents())
            ok = size(extents) > 0
            if (ok) ok = extents(size(extents)) == size(checksums)
            row_bytes = 0
            if (ok) row_bytes = product(int(extents(:size(extents) - 1), int64))
         end associate
         if (ok .and. row_bytes == 0) cycle
         offset = -1
         do k = 1, size(value_sizes)
            if (offset < 0) offset = dataset%get_offset(value_sizes(k))
            if (offset >= 0) exit
         end do
         if (ok) ok = offset >= 0
         if (ok) call checksum_rows(path, offset, row_bytes*value_sizes(k), checksums, ok)
         if (.not. ok) call fail(error, "dataset '"//words(i)%value//"' cannot be read row by row")
         if (allocated(error)) return
      end do
   end subroutine add_up

   !> Counts the points without a result in a file, as it stands on the disk.
   subroutine count_pending(path, n_pending, error)
      character(*), intent(in) :: path
      integer, intent(out) :: n_pending
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: error_in_close
      type(h5_file_t) :: file
      integer, allocatable :: status(:)

      n_pending = 0
      call open_file(file, path, error, last_words="was changed while the run wrote it, HDF5 dies of it; results are lost")
      call file%get("status", status, error)
      if (.not. allocated(error)) n_pending = count(status == outcome%pending)
      call file%close(error_in_close)
   end subroutine count_pending
end module hb_row_checks
