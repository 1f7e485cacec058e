!> Columns of the files of `benchmark` and `bench`: one dataset each, with a value a row. And what both say of times.
module hb_benchmark_table
   use hb_error, only: annotate, error_t
   use hb_file_place, only: check_place, put_in_place
   use hb_hdf5, only: create_file, h5_dataset_t, h5_file_t
   use hb_kinds, only: wp
   use hb_results_file, only: describe, set_flags
   use hb_system, only: process_id, remove_file
   use hb_text, only: to_text
   implicit none
   private
   public :: add_integers, add_one_text, add_reals, add_texts, begin_table, end_table, median, table_t, text_length, threads_text

   integer, parameter :: text_length = 200                            ! longest text of a row

   !> A file that is being filled; after an error nothing more is written.
   type :: table_t
      type(h5_file_t) :: file
      type(h5_dataset_t) :: row, tone, harmonic, dof, component, repeat   ! dimension scales
      type(error_t), allocatable :: error
      character(:), allocatable, private :: path, temporary
      logical, private :: is_open = .false., overwrite = .false.
   end type table_t

contains

   !> Begins a file under another name than its own.
   subroutine begin_table(table, path, overwrite)
      type(table_t), intent(inout) :: table
      character(*), intent(in) :: path
      logical, intent(in) :: overwrite                                !! an existing file may be replaced

      table%path = path
      table%overwrite = overwrite
      table%temporary = path//"."//to_text(process_id())//".part"
      call check_place(path, overwrite, table%error)
      if (allocated(table%error)) return
      call create_file(table%file, table%temporary, .true., table%error)
      table%is_open = .not. allocated(table%error)
      if (.not. table%is_open) call remove_file(table%temporary)
   end subroutine begin_table

   !> Closes the file and gives it its name; after an error nothing stays of it.
   subroutine end_table(table, error)
      type(table_t), intent(inout) :: table
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: error_in_close

      if (allocated(table%error)) call move_alloc(table%error, error)
      if (table%is_open) then
         call table%file%close(error_in_close)
         if (allocated(error_in_close) .and. .not. allocated(error)) call move_alloc(error_in_close, error)
         if (.not. allocated(error)) call put_in_place(table%temporary, table%path, table%overwrite, error)
         if (allocated(error)) call remove_file(table%temporary)
      end if
      call annotate(error, "result file '"//table%path//"'")
   end subroutine end_table

   !> Adds a column of real numbers.
   subroutine add_reals(table, name, values, units, long_name, parameter)
      type(table_t), intent(inout) :: table
      character(*), intent(in) :: name, units, long_name
      real(wp), intent(in) :: values(:)
      character(*), intent(in), optional :: parameter                 !! path in the input
      type(h5_dataset_t) :: dataset

      if (allocated(table%error)) return
      call table%file%add_real(name, shape(values), dataset, table%error)
      if (.not. allocated(table%error)) call dataset%write(values, table%error)
      call finish_column(table, dataset, units, long_name, parameter)
   end subroutine add_reals

   !> Adds a column of integers; those of a list of choices with their meanings (CF convention).
   subroutine add_integers(table, name, values, long_name, meanings)
      type(table_t), intent(inout) :: table
      character(*), intent(in) :: name, long_name
      integer, intent(in) :: values(:)
      character(*), intent(in), optional :: meanings(:)               !! of 0, 1, ...
      type(h5_dataset_t) :: dataset

      if (allocated(table%error)) return
      call table%file%add_integer(name, shape(values), dataset, table%error)
      if (.not. allocated(table%error)) call dataset%write(values, table%error)
      call finish_column(table, dataset, "1", long_name)
      if (present(meanings) .and. .not. allocated(table%error)) call set_flags(dataset, meanings, table%error)
   end subroutine add_integers

   !> Adds a column of texts.
   subroutine add_texts(table, name, values, long_name, parameter)
      type(table_t), intent(inout) :: table
      character(*), intent(in) :: name, values(:), long_name
      character(*), intent(in), optional :: parameter                 !! path in the input
      type(h5_dataset_t) :: dataset

      if (allocated(table%error)) return
      call table%file%add_texts(name, values, dataset, table%error)
      call finish_column(table, dataset, "1", long_name, parameter)
   end subroutine add_texts

   subroutine finish_column(table, dataset, units, long_name, parameter)
      type(table_t), intent(inout) :: table
      type(h5_dataset_t), intent(in) :: dataset
      character(*), intent(in) :: units, long_name
      character(*), intent(in), optional :: parameter

      if (.not. allocated(table%error)) call dataset%attach_scale(1, table%row, table%error)
      if (.not. allocated(table%error)) call describe(dataset, units, long_name, table%error)
      if (present(parameter) .and. .not. allocated(table%error)) call dataset%set_attribute("parameter", parameter, table%error)
   end subroutine finish_column

   !> Adds one text that belongs to no row.
   subroutine add_one_text(table, name, text, long_name)
      type(table_t), intent(inout) :: table
      character(*), intent(in) :: name, text, long_name
      type(h5_dataset_t) :: dataset

      if (.not. allocated(table%error)) call table%file%add_text(name, text, dataset, table%error)
      if (.not. allocated(table%error)) call describe(dataset, "1", long_name, table%error)
   end subroutine add_one_text

   !> What the environment says of threads, on which all times depend.
   function threads_text() result(text)
      character(:), allocatable :: text
      character(*), parameter :: names(2) = [character(20) :: "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"]
      character(32) :: value
      integer :: i, status

      text = ""
      do i = 1, size(names)
         call get_environment_variable(trim(names(i)), value, status=status)
         if (status /= 0) value = "not set"
         if (i > 1) text = text//", "
         text = text//trim(names(i))//" "//trim(value)
      end do
   end function threads_text

   !> Median of some numbers; of an even number of them the mean of the middle two.
   pure real(wp) function median(values)
      real(wp), intent(in) :: values(:)                               !! at least one
      real(wp) :: sorted(size(values)), moved
      integer :: i, k

      sorted = values
      do i = 2, size(sorted)
         moved = sorted(i)
         do k = i - 1, 1, -1
            if (sorted(k) <= moved) exit
            sorted(k + 1) = sorted(k)
         end do
         sorted(k + 1) = moved
      end do
      i = size(sorted)
      median = 0.5_wp*(sorted((i + 1)/2) + sorted(i/2 + 1))
   end function median
end module hb_benchmark_table
