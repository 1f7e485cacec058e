!> Copies the rows of a result file into one that has fewer places for harmonics.
module hb_results_copy
   use, intrinsic :: iso_fortran_env, only: int8
   use hb_checksum, only: checksum
   use hb_error, only: annotate, error_t
   use hb_hdf5, only: bytes_of_kind, h5_dataset_t, h5_file_t
   use hb_kinds, only: wp
   use hb_result_columns, only: column_t, plan_t
   use hb_results_plan, only: measure_row
   implicit none
   private
   public :: copy_rows

   real(wp), parameter :: most_bytes = 1.6e7_wp                       ! [B] of rows that are copied at once

contains

   !> Copies the rows of all points and ranks. Of the places for harmonics, and of what curves continue from, those that the new
   !> file has are kept, the first ones; checksums are made anew.
   subroutine copy_rows(source, plan, error)
      type(h5_file_t), intent(in) :: source
      type(plan_t), intent(in) :: plan                                !! of the new file, with its datasets
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: stored(:), sums(:)
      integer :: first, i, n_at_once, n_datasets, n_points
      real(wp) :: n_bytes

      n_points = plan%axes(1)%length
      call measure_row(plan, 0, n_bytes, n_datasets)
      n_at_once = max(1, int(most_bytes/n_bytes))
      do first = 1, n_points, n_at_once
         allocate (sums(min(n_at_once, n_points - first + 1)), source=0)
         do i = 1, size(plan%columns)
            call copy(source, plan%columns(i), first, sums, error)
            if (allocated(error)) return
         end do
         associate (of_rows => plan%columns(plan%index_of("checksum"))%dataset)
            allocate (stored, mold=sums)
            call of_rows%read(stored, error, first)
            if (.not. allocated(error)) call of_rows%write(merge(sums, 0, stored /= 0), error, first)
         end associate
         if (allocated(error)) return
         deallocate (stored, sums)
      end do
      do i = 1, size(plan%times)
         allocate (sums(product(plan%times(i)%dataset%get_extents())))
         call copy(source, plan%times(i), 1, sums, error)
         if (allocated(error)) return
         deallocate (sums)
      end do
   end subroutine copy_rows

   !> Copies as many rows of a dataset as there are checksums, which continue over what is checked.
   subroutine copy(source, column, first, sums, error)
      type(h5_file_t), intent(in) :: source
      type(column_t), intent(in) :: column
      integer, intent(in) :: first
      integer, intent(inout) :: sums(:)
      type(error_t), allocatable, intent(out) :: error
      type(h5_dataset_t) :: old
      integer(int8), allocatable :: rows(:, :)
      integer, allocatable :: n_used                                  ! not allocated: not present where it is handed on
      integer :: k

      call source%open_dataset(column%name, old, error)
      if (allocated(error)) return
      associate (extents => column%dataset%get_extents())
         if (column%is_part_used) n_used = extents(min(2, size(extents) - 1))
         allocate (rows(bytes_of_kind(column%kind)*product(extents(:size(extents) - 1)), size(sums)))
      end associate
      call old%read(rows, error, first, n_used)
      if (column%is_checked) sums = [(checksum(sums(k), rows(:, k)), k=1, size(sums))]
      if (.not. allocated(error)) call column%dataset%write(rows, error, first)
      call annotate(error, "'"//column%name//"'")
   end subroutine copy
end module hb_results_copy
