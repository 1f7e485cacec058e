!> The functions of nhbm.h that return results. The header documents them.
module hb_c_results
   use, intrinsic :: iso_c_binding, only: c_associated, c_double, c_f_pointer, c_int, c_loc, c_null_ptr, c_ptr, c_size_t
   use hb_advice, only: advice_list_t, advice_number, advice_t, describe_item, list_records
   use hb_c_handles, only: c_status, release_handle, set_last_error, status_of
   use hb_c_model, only: address_of_integers, address_of_reals, address_of_text, begin_call, empty_text, &
      end_call, end_call_with_text, handle_t
   use hb_c_text, only: c_text
   use hb_column_table, only: max_axes
   use hb_column_units, only: column_kind
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   use hb_session_columns, only: labels_along
   use hb_text, only: split
   implicit none
   private
   public :: c_description_t, clear_description, fill_description

   integer(c_int), parameter :: about_model = 0_c_int, about_motion = 1_c_int, about_laws = 2_c_int   ! enum nhbm_subject

   !> struct nhbm_column.
   type, bind(c) :: c_column_t
      type(c_ptr) :: data
      integer(c_int) :: kind
      integer(c_int) :: n_axes
      integer(c_size_t) :: shape(max_axes)
      integer(c_size_t) :: n_values
      type(c_ptr) :: unit
      type(c_ptr) :: axes
   end type c_column_t

   !> struct nhbm_column_description.
   type, bind(c) :: c_description_t
      type(c_ptr) :: long_name
      type(c_ptr) :: dof_units
      type(c_ptr) :: flag_meanings
      type(c_ptr) :: attributes
      integer(c_int) :: lowest_flag
      integer(c_int) :: kind
   end type c_description_t

contains

   integer(c_int) function nhbm_get_column(model, name, column) bind(c, name="nhbm_get_column") result(status)
      type(c_ptr), value :: model, name, column
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      call clear_column(column)
      status = begin_call(model, "nhbm_get_column", handle, texts=[name, column], needs_model=.true.)
      if (status /= c_status%success) return
      call handle%columns%find_of_motion(handle%session, c_text(name), error)
      if (.not. allocated(error) .and. len(c_text(name)) == 0) call fail(error, "nhbm_get_column: the name is empty")
      if (.not. allocated(error)) status = shown_column(handle, column)
      if (status == c_status%success) status = status_of(error, c_status%invalid_argument)
      call release_handle(model)
   end function nhbm_get_column

   integer(c_int) function nhbm_describe_column(model, name, description) bind(c, name="nhbm_describe_column") result(status)
      type(c_ptr), value :: model, name, description
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      call clear_description(description)
      status = begin_call(model, "nhbm_describe_column", handle, texts=[name, description], needs_model=.true.)
      if (status /= c_status%success) return
      call handle%columns%find_of_motion(handle%session, c_text(name), error)
      if (.not. allocated(error) .and. len(c_text(name)) == 0) call fail(error, "nhbm_describe_column: the name is empty")
      if (.not. allocated(error)) status = shown_description(handle, description)
      if (status == c_status%success) status = status_of(error, c_status%invalid_argument)
      call release_handle(model)
   end function nhbm_describe_column

   integer(c_int) function nhbm_describe_time_column(model, name, description) bind(c, name="nhbm_describe_time_column") &
      result(status)
      type(c_ptr), value :: model, name, description
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      call clear_description(description)
      status = begin_call(model, "nhbm_describe_time_column", handle, texts=[name, description], needs_input=.true., &
                          needs_time=.true.)
      if (status /= c_status%success) return
      call handle%columns%find_in_time(handle%session, c_text(name), error)
      if (.not. allocated(error) .and. len(c_text(name)) == 0) call fail(error, "nhbm_describe_time_column: the name is empty")
      if (.not. allocated(error)) status = shown_description(handle, description)
      if (status == c_status%success) status = status_of(error, c_status%invalid_argument)
      call release_handle(model)
   end function nhbm_describe_time_column

   integer(c_int) function nhbm_get_column_names(model, names) bind(c, name="nhbm_get_column_names") result(status)
      type(c_ptr), value :: model, names
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      status = begin_call(model, "nhbm_get_column_names", handle, text=names, needs_model=.true.)
      if (status /= c_status%success) return
      call handle%columns%find_of_motion(handle%session, "", error)
      status = end_call_with_text(model, "nhbm_get_column_names", handle%columns%names, handle%text, names)
   end function nhbm_get_column_names

   integer(c_int) function nhbm_get_time_column(model, name, column) bind(c, name="nhbm_get_time_column") result(status)
      type(c_ptr), value :: model, name, column
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      call clear_column(column)
      status = begin_call(model, "nhbm_get_time_column", handle, texts=[name, column], needs_input=.true., needs_time=.true.)
      if (status /= c_status%success) return
      call handle%columns%find_in_time(handle%session, c_text(name), error)
      if (.not. allocated(error) .and. len(c_text(name)) == 0) call fail(error, "nhbm_get_time_column: the name is empty")
      if (.not. allocated(error)) status = shown_column(handle, column)
      if (status == c_status%success) status = status_of(error, c_status%invalid_argument)
      call release_handle(model)
   end function nhbm_get_time_column

   integer(c_int) function nhbm_get_time_column_names(model, names) bind(c, name="nhbm_get_time_column_names") result(status)
      type(c_ptr), value :: model, names
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      status = begin_call(model, "nhbm_get_time_column_names", handle, text=names, needs_input=.true., needs_time=.true.)
      if (status /= c_status%success) return
      call handle%columns%find_in_time(handle%session, "", error)
      status = end_call_with_text(model, "nhbm_get_time_column_names", handle%columns%names, handle%text, names)
   end function nhbm_get_time_column_names

   integer(c_int) function nhbm_get_labels(model, axis, labels) bind(c, name="nhbm_get_labels") result(status)
      type(c_ptr), value :: model, axis, labels
      type(handle_t), pointer :: handle
      character(:), allocatable :: joined
      character(64), allocatable :: words(:)
      integer :: i

      status = begin_call(model, "nhbm_get_labels", handle, text=labels, texts=[axis], needs_model=.true.)
      if (status /= c_status%success) return
      words = labels_along(handle%session, c_text(axis))
      joined = ""
      do i = 1, size(words)
         joined = joined//new_line("a")//trim(words(i))
      end do
      status = end_call_with_text(model, "nhbm_get_labels", joined(min(2, len(joined) + 1):), handle%text, labels)
   end function nhbm_get_labels

   integer(c_int) function nhbm_get_outcome(model, motion_status, motion_reason) bind(c, name="nhbm_get_outcome") result(status)
      type(c_ptr), value :: model, motion_status, motion_reason
      type(handle_t), pointer :: handle
      integer(c_int), pointer :: number

      if (c_associated(motion_status)) call set_number(motion_status, 0)
      if (c_associated(motion_reason)) call set_number(motion_reason, 0)
      status = begin_call(model, "nhbm_get_outcome", handle, texts=[motion_status, motion_reason], needs_input=.true.)
      if (status /= c_status%success) return
      call set_number(motion_status, handle%session%result%status)
      call set_number(motion_reason, handle%session%result%reason)
      call release_handle(model)

   contains

      subroutine set_number(address, value)
         type(c_ptr), intent(in) :: address
         integer, intent(in) :: value

         call c_f_pointer(address, number)
         number = int(value, c_int)
      end subroutine set_number
   end function nhbm_get_outcome

   integer(c_int) function nhbm_get_message(model, message) bind(c, name="nhbm_get_message") result(status)
      type(c_ptr), value :: model, message
      type(handle_t), pointer :: handle
      character(:), allocatable :: text

      status = begin_call(model, "nhbm_get_message", handle, text=message, needs_input=.true.)
      if (status /= c_status%success) return
      call handle%session%result%describe(text)
      status = end_call_with_text(model, "nhbm_get_message", text, handle%text, message)
   end function nhbm_get_message

   integer(c_int) function nhbm_get_advice(model, about, advice) bind(c, name="nhbm_get_advice") result(status)
      type(c_ptr), value :: model, advice
      integer(c_int), value :: about
      type(handle_t), pointer :: handle
      type(advice_list_t) :: list
      type(error_t), allocatable :: error
      character(:), allocatable :: text

      status = begin_call(model, "nhbm_get_advice", handle, text=advice, needs_input=.true.)
      if (status /= c_status%success) return
      select case (about)
      case (about_model)
         call handle%session%advise_on_model(list, error)
      case (about_motion)
         call handle%session%advise_on_motion(list)
      case (about_laws)
         call handle%session%advise_on_laws(list)
      case default
         call fail(error, "nhbm_get_advice: there is no such subject; use one of enum nhbm_subject")
      end select
      if (allocated(error)) then
         status = end_call(model, error, merge(c_status%invalid_input, c_status%invalid_argument, about == about_model))
      else
         call list_records(list, text)
         status = end_call_with_text(model, "nhbm_get_advice", text, handle%text, advice)
      end if
   end function nhbm_get_advice

   integer(c_int) function nhbm_describe_advice(model, name, n, values, words, text) &
      bind(c, name="nhbm_describe_advice") result(status)
      type(c_ptr), value :: model, name, values, words, text
      integer(c_size_t), value :: n
      type(handle_t), pointer :: handle
      type(advice_t) :: item
      type(error_t), allocatable :: error
      real(c_double), pointer :: numbers(:)
      character(:), allocatable :: line

      status = begin_call(model, "nhbm_describe_advice", handle, text=text, texts=[name, words])
      if (status /= c_status%success) return
      item%number = advice_number(c_text(name))
      call split(c_text(words), new_line("a"), item%words)
      allocate (item%values(0))
      if (n > 0 .and. c_associated(values)) then
         call c_f_pointer(values, numbers, [n])
         item%values = real(numbers, wp)
      end if
      if (item%number == 0) then
         call fail(error, "nhbm_describe_advice: the table of advice has no row '"//c_text(name)//"'")
         status = end_call(model, error, c_status%invalid_argument)
         return
      end if
      call describe_item(item, line)
      status = end_call_with_text(model, "nhbm_describe_advice", line, handle%text, text)
   end function nhbm_describe_advice

   !> Sets a column of C, unless it is NULL, to one without values.
   subroutine clear_column(address)
      type(c_ptr), intent(in) :: address
      type(c_column_t), pointer :: column

      if (.not. c_associated(address)) return
      call c_f_pointer(address, column)
      column%data = c_null_ptr
      column%kind = int(column_kind%unknown, c_int)
      column%n_axes = 0_c_int
      column%shape = 0_c_size_t
      column%n_values = 0_c_size_t
      column%unit = c_loc(empty_text)
      column%axes = c_loc(empty_text)
   end subroutine clear_column

   !> Fills a cleared column of C with the one that was found last.
   integer(c_int) function shown_column(handle, address) result(status)
      type(handle_t), pointer, intent(in) :: handle
      type(c_ptr), intent(in) :: address
      type(c_column_t), pointer :: column

      call c_f_pointer(address, column)
      associate (found => handle%columns)
         column%unit = address_of_text(found%units, handle%unit)
         column%axes = address_of_text(found%axes, handle%axes)
         if (.not. (c_associated(column%unit) .and. c_associated(column%axes))) then
            call clear_column(address)
            call set_last_error("nhbm_get_column: memory is insufficient")
            status = c_status%out_of_memory
            return
         end if
         column%kind = int(min(found%kind, column_kind%unknown), c_int)
         if (column%kind /= column_kind%unknown) then
            column%n_axes = size(found%extents, kind=c_int)
            column%shape(:size(found%extents)) = found%extents(size(found%extents):1:-1)
            column%n_values = product(int(found%extents, c_size_t))
         end if
         if (found%kind == column_kind%real) column%data = address_of_reals(found%reals)
         if (found%kind == column_kind%integer) column%data = address_of_integers(found%integers)
      end associate
      status = c_status%success
   end function shown_column

   !> Sets a description of C, unless it is NULL, to an empty one.
   subroutine clear_description(address)
      type(c_ptr), intent(in) :: address
      type(c_description_t), pointer :: description

      if (.not. c_associated(address)) return
      call c_f_pointer(address, description)
      description%long_name = c_loc(empty_text)
      description%dof_units = c_loc(empty_text)
      description%flag_meanings = c_loc(empty_text)
      description%attributes = c_loc(empty_text)
      description%lowest_flag = 0_c_int
      description%kind = int(column_kind%unknown, c_int)
   end subroutine clear_description

   !> Fills a cleared description of C with that of the column that was found last.
   integer(c_int) function shown_description(handle, address) result(status)
      type(handle_t), pointer, intent(in) :: handle
      type(c_ptr), intent(in) :: address

      associate (found => handle%columns)
         status = fill_description(handle, address, found%long_name, found%dof_units, found%flags, found%attributes, &
                                   [found%lowest_flag, found%kind_of_values])
      end associate
   end function shown_description

   !> Fills a cleared description of C.
   integer(c_int) function fill_description(handle, address, long_name, dof_units, flags, attributes, numbers) result(status)
      type(handle_t), pointer, intent(in) :: handle
      type(c_ptr), intent(in) :: address
      character(*), intent(in) :: long_name, dof_units, flags, attributes
      integer, intent(in) :: numbers(:)                               !! lowest flag, kind of the values
      type(c_description_t), pointer :: description

      call c_f_pointer(address, description)
      description%long_name = address_of_text(long_name, handle%long_name)
      description%dof_units = address_of_text(dof_units, handle%dof_units)
      description%flag_meanings = address_of_text(flags, handle%flags)
      description%attributes = address_of_text(attributes, handle%attributes)
      description%lowest_flag = int(numbers(1), c_int)
      description%kind = int(numbers(2), c_int)
      status = c_status%success
      if (c_associated(description%long_name) .and. c_associated(description%dof_units) .and. &
          c_associated(description%flag_meanings) .and. c_associated(description%attributes)) return
      call clear_description(address)
      call set_last_error("the description of a column: memory is insufficient")
      status = c_status%out_of_memory
   end function fill_description
end module hb_c_results
