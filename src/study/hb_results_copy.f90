!> Copies the rows of a result file into one that has fewer places for harmonics.
module hb_results_copy
   use hb_checksum, only: checksum
   use hb_error, only: annotate, error_t
   use hb_hdf5, only: h5_dataset_t, h5_file_t
   use hb_kinds, only: wp
   use hb_results_plan, only: is_checked, is_characters, is_integer, measure_row, message_length, plan_t, point_axis, variable_t
   implicit none
   private
   public :: copy_rows

   real(wp), parameter :: most_bytes = 1.6e7_wp                       ! [B] of rows that are copied at once

contains

   !> Copies the rows of all points and ranks. Of the places for harmonics, and of what curves go on from, those that the new file
   !> has are kept, the first ones; checksums are made anew.
   subroutine copy_rows(source, plan, error)
      type(h5_file_t), intent(in) :: source
      type(plan_t), intent(in) :: plan                                !! of the new file, with its datasets
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: sums(:)
      integer :: first, i, i_sum, n_at_once, n_datasets, n_points
      real(wp) :: n_bytes

      i_sum = findloc([(plan%variables(i)%name == "checksum", i=1, size(plan%variables))], .true., dim=1)
      n_points = plan%axes(point_axis)%length
      call measure_row(plan, 0, n_bytes, n_datasets)
      n_at_once = max(1, int(most_bytes/n_bytes))
      do first = 1, n_points, n_at_once
         allocate (sums(min(n_at_once, n_points - first + 1)), source=0)
         do i = 1, size(plan%variables)
            if (i /= i_sum) call copy(source, plan%variables(i), first, sums, error)
            if (allocated(error)) return
         end do
         call copy(source, plan%variables(i_sum), first, sums, error)
         if (allocated(error)) return
         deallocate (sums)
      end do
      do i = 1, size(plan%times)
         allocate (sums(product(plan%times(i)%dataset%get_extents())), source=0)
         call copy(source, plan%times(i), 1, sums, error)
         if (allocated(error)) return
         deallocate (sums)
      end do
   end subroutine copy_rows

   !> Copies as many rows of a dataset as there are checksums. These go on over what is checked, and are written where they belong.
   subroutine copy(source, variable, first, sums, error)
      type(h5_file_t), intent(in) :: source
      type(variable_t), intent(in) :: variable
      integer, intent(in) :: first
      integer, intent(inout) :: sums(:)
      type(error_t), allocatable, intent(out) :: error
      type(h5_dataset_t) :: old
      integer, allocatable :: n_used                                  ! not allocated: not present where it is handed on
      integer :: row_size

      call source%open_dataset(variable%name, old, error)
      if (allocated(error)) return
      associate (new => variable%dataset%get_extents())
         row_size = product(new(:size(new) - 1))
         if (variable%is_part_used) n_used = new(min(2, size(new) - 1))
      end associate
      select case (variable%kind)
      case (is_characters); call copy_texts(old, variable%dataset, first, sums, error)
      case (is_integer); call copy_integers(old, variable, row_size, first, sums, error, n_used)
      case default; call copy_reals(old, variable, row_size, first, sums, error, n_used)
      end select
      call annotate(error, "'"//variable%name//"'")
   end subroutine copy

   subroutine copy_reals(old, variable, row_size, first, sums, error, n_used)
      type(h5_dataset_t), intent(in) :: old
      type(variable_t), intent(in) :: variable
      integer, intent(in) :: row_size                                 !! values of a row
      integer, intent(in), optional :: n_used                         !! places of its harmonics, the first ones; default: all
      integer, intent(in) :: first
      integer, intent(inout) :: sums(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: rows(:, :)
      integer :: k

      allocate (rows(row_size, size(sums)))
      call old%read_rows(first, rows, error, n_used)
      if (allocated(error)) return
      if (is_checked(variable)) sums = [(checksum(sums(k), rows(:, k)), k=1, size(sums))]
      call variable%dataset%write_row(first, rows, error, size(sums))
   end subroutine copy_reals

   subroutine copy_integers(old, variable, row_size, first, sums, error, n_used)
      type(h5_dataset_t), intent(in) :: old
      type(variable_t), intent(in) :: variable
      integer, intent(in) :: row_size
      integer, intent(in), optional :: n_used
      integer, intent(in) :: first
      integer, intent(inout) :: sums(:)
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: rows(:, :)
      integer :: k

      allocate (rows(row_size, size(sums)))
      call old%read_rows(first, rows, error, n_used)
      if (allocated(error)) return
      if (is_checked(variable)) sums = [(checksum(sums(k), rows(:, k)), k=1, size(sums))]
      if (variable%name == "checksum") rows(1, :) = merge(sums, 0, rows(1, :) /= 0)
      call variable%dataset%write_row(first, rows, error, size(sums))
   end subroutine copy_integers

   subroutine copy_texts(old, new, first, sums, error)
      type(h5_dataset_t), intent(in) :: old, new
      integer, intent(in) :: first
      integer, intent(inout) :: sums(:)
      type(error_t), allocatable, intent(out) :: error
      character(message_length) :: bytes
      character(:), allocatable :: text
      integer :: k

      do k = 1, size(sums)
         call old%read_text_row(first + k - 1, text, error)
         if (.not. allocated(error) .and. len(text) > 0) call new%write_row(first + k - 1, text, error)
         if (allocated(error)) return
         bytes = text//repeat(achar(0), message_length)
         sums(k) = checksum(sums(k), bytes)
      end do
   end subroutine copy_texts
end module hb_results_copy
