!> Names of swept parameters in a result file, and the size of the file.
module hb_results_plan
   use hb_hdf5, only: bytes_of_kind, is_integer, is_real
   use hb_kinds, only: int64, wp
   use hb_parameter_path, only: identifier
   use hb_result_columns, only: column_t, plan_t, tuple_entry_name
   use hb_results_layout, only: results_layout_t
   use hb_text, only: to_text
   implicit none
   private
   public :: measure_row, n_bytes_of, parameter_name_length, parameter_names, size_text

   integer, parameter :: parameter_name_length = 256   ! more than any path of an input has

contains

   !> Gives a variable name for each swept parameter: its path in lower case with one underscore for every run
   !> of other characters; a number is added where the name is taken.
   function parameter_names(layout, plan) result(names)
      type(results_layout_t), intent(in) :: layout
      type(plan_t), intent(in) :: plan
      character(parameter_name_length) :: names(size(layout%parameters))
      character(:), allocatable :: stem
      integer :: i, n

      do i = 1, size(names)
         stem = identifier(layout%parameters(i)%path)
         if (stem == "") stem = "parameter"
         names(i) = stem
         n = 1
         do while (is_taken(trim(names(i))) .or. any(names(:i - 1) == names(i)))
            n = n + 1
            names(i) = stem//"_"//to_text(n)
         end do
      end do

   contains

      pure logical function is_taken(name)
         character(*), intent(in) :: name
         character(*), parameter :: others(6) = [character(15) :: "tuple", "input_text", "input_overrides", "input_complete", &
                                                 "input_libraries", "tuples"]
         integer :: k

         is_taken = plan%index_of(name) > 0 .or. plan%axis_index(name) > 0 .or. any(others == name) .or. &
            any([(plan%times(k)%name == name, k=1, size(plan%times))]) .or. &
            any([(tuple_entry_name(k) == name, k=1, size(layout%tuples, 1))])
      end function is_taken
   end function parameter_names

   !> Gives what one point takes in the file, swept parameters included, and how many datasets it is written to when solved.
   pure subroutine measure_row(plan, n_parameters, n_bytes, n_datasets)
      type(plan_t), intent(in) :: plan
      integer, intent(in) :: n_parameters
      real(wp), intent(out) :: n_bytes
      integer, intent(out) :: n_datasets
      integer :: i

      n_datasets = size(plan%columns)
      n_bytes = bytes_of_kind(is_integer) + real(bytes_of_kind(is_real), wp)*n_parameters
      do i = 1, size(plan%columns)
         n_bytes = n_bytes + bytes_of_row(plan, plan%columns(i))
      end do
   end subroutine measure_row

   pure integer(int64) function bytes_of_row(plan, column) result(n_bytes)
      type(plan_t), intent(in) :: plan
      type(column_t), intent(in) :: column

      n_bytes = bytes_of_kind(column%kind)*product(int(plan%axes(column%axes(:size(column%axes) - 1))%length, int64))
   end function bytes_of_row

   !> Gives the number of bytes that a file takes on the disk, rather a few too many.
   pure function n_bytes_of(plan, layout) result(n_bytes)
      type(plan_t), intent(in) :: plan
      type(results_layout_t), intent(in) :: layout
      integer(int64) :: n_bytes
      integer(int64), parameter :: of_one_dataset = 4000, of_a_text = 100 ! what describes a dataset; a label or text value
      integer :: i

      n_bytes = of_one_dataset*(size(plan%columns) + size(plan%times) + size(plan%axes) + &
         size(layout%parameters) + size(layout%tuples, 1) + 8)
      do i = 1, size(plan%columns)
         if (plan%columns(i)%is_part_used) cycle                      ! nothing yet
         n_bytes = n_bytes + layout%n_points*bytes_of_row(plan, plan%columns(i))
      end do
      do i = 1, size(plan%times)
         n_bytes = n_bytes + bytes_of_kind(plan%times(i)%kind)*int(layout%n_ranks, int64)
      end do
      n_bytes = n_bytes + 8*sum(int(plan%axes%length, int64)) + 8*size(layout%tuples, kind=int64) + &
         of_a_text*(size(layout%dof_labels) + size(layout%law_dof_labels) + size(layout%law_labels) + &
                    size(layout%output_names))
      do i = 1, size(layout%parameters)
         n_bytes = n_bytes + layout%n_points*merge(of_a_text, 8_int64, layout%parameters(i)%is_text)
      end do
      if (allocated(layout%input_text)) n_bytes = n_bytes + len(layout%input_text)
      if (allocated(layout%input_complete)) n_bytes = n_bytes + len(layout%input_complete)
   end function n_bytes_of

   !> Gives a number of bytes in words, for messages.
   function size_text(n_bytes) result(text)
      integer(int64), intent(in) :: n_bytes
      character(:), allocatable :: text
      character(40) :: digits

      write (digits, "(f0.1)") max(0.1_wp, real(n_bytes, wp)/1.0e6_wp)
      text = trim(digits)//" MB"
      if (text(1:1) == ".") text = "0"//text
   end function size_text
end module hb_results_plan
