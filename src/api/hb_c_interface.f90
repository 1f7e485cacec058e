!> The functions of nhbm.h: handles, texts and errors of C for hb_session. The header documents them.
module hb_c_interface
   use, intrinsic :: iso_c_binding, only: c_associated, c_char, c_double, c_f_pointer, c_funptr, c_int, c_int64_t, &
      c_loc, c_null_char, c_null_ptr, c_ptr
   use hb_c_structures, only: c_structures_t
   use hb_c_text, only: c_text
   use hb_column_view, only: column_kind
   use hb_error, only: error_t
   use hb_key_rows, only: key_row, n_key_rows
   use hb_kinds, only: wp
   use hb_session, only: session_t
   use hb_sundials, only: has_cvode
   use hb_user_library, only: forget_law, give_law, law_info_t
   use hb_version, only: program_version, version_number
   implicit none
   private

   integer(c_int), parameter :: api = 2_c_int                         ! NHBM_API
   integer(c_int), parameter :: wrong_input = 1_c_int, wrong_use = 2_c_int
   integer, parameter :: error_length = 2048, most_axes = 4

   !> struct nhbm_error.
   type, bind(c) :: c_error_t
      integer(c_int) :: code
      character(c_char) :: text(error_length)
   end type c_error_t

   !> struct nhbm_column.
   type, bind(c) :: c_column_t
      type(c_ptr) :: data
      integer(c_int) :: kind
      integer(c_int) :: n_axes
      integer(c_int64_t) :: shape(most_axes)
      type(c_ptr) :: unit
      type(c_ptr) :: axes
   end type c_column_t

   !> struct nhbm_model: a session with the texts passed to C.
   type :: handle_t
      type(session_t) :: session
      type(error_t), allocatable :: failure                           ! of the last call
      character(c_char), allocatable :: text(:), unit(:), axes(:)
   end type handle_t

   character(kind=c_char), target, save :: version_text(32) = c_null_char

contains

   integer(c_int) function nhbm_api() bind(c, name="nhbm_api")
      nhbm_api = api
   end function nhbm_api

   integer(c_int) function nhbm_version_number() bind(c, name="nhbm_version_number")
      nhbm_version_number = int(version_number, c_int)
   end function nhbm_version_number

   integer(c_int) function nhbm_has(feature) bind(c, name="nhbm_has") result(has)
      type(c_ptr), value :: feature
      logical :: is_known
      integer :: i

      is_known = c_text(feature)//"|" == "cvode|" .and. has_cvode()
      do i = 1, n_key_rows()
         is_known = is_known .or. index(key_row(i), c_text(feature)//" | ") == 1
      end do
      has = merge(1_c_int, 0_c_int, is_known)
   end function nhbm_has

   integer(c_int) function nhbm_give_law(name, info, evaluate) bind(c, name="nhbm_give_law") result(code)
      character(c_char), intent(in) :: name(*)
      type(law_info_t), intent(in) :: info
      type(c_funptr), value :: evaluate

      code = give_law(name, info, evaluate)
   end function nhbm_give_law

   subroutine nhbm_forget_law(name) bind(c, name="nhbm_forget_law")
      character(c_char), intent(in) :: name(*)

      call forget_law(name)
   end subroutine nhbm_forget_law

   type(c_ptr) function nhbm_new() bind(c, name="nhbm_new") result(model)
      type(handle_t), pointer :: handle

      allocate (handle)
      model = c_loc(handle)
   end function nhbm_new

   subroutine nhbm_structures(model, fill, context) bind(c, name="nhbm_structures")
      type(c_ptr), value :: model
      type(c_funptr), value :: fill
      type(c_ptr), value :: context
      type(handle_t), pointer :: handle

      call c_f_pointer(model, handle)
      handle%session%callbacks%fe_models = c_structures_t(fill, context)
   end subroutine nhbm_structures

   integer(c_int) function nhbm_read(model, text, name, error) bind(c, name="nhbm_read") result(code)
      type(c_ptr), value :: model, text, name
      type(c_error_t), intent(inout) :: error
      type(handle_t), pointer :: handle

      call c_f_pointer(model, handle)
      call handle%session%read(c_text(name), c_text(text), handle%failure)
      code = reported(handle%failure, wrong_input, error)
   end function nhbm_read

   subroutine nhbm_delete(model) bind(c, name="nhbm_delete")
      type(c_ptr), intent(inout) :: model
      type(handle_t), pointer :: handle

      if (.not. c_associated(model)) return
      call c_f_pointer(model, handle)
      call handle%session%destroy()
      deallocate (handle)
      model = c_null_ptr
   end subroutine nhbm_delete

   type(c_ptr) function nhbm_input(model) bind(c, name="nhbm_input") result(text)
      type(c_ptr), value :: model
      type(handle_t), pointer :: handle
      character(:), allocatable :: input

      call c_f_pointer(model, handle)
      call handle%session%complete_input(input)
      text = address_of_text(input, handle%text)
   end function nhbm_input

   integer(c_int) function nhbm_set_text(model, path, values, error) bind(c, name="nhbm_set_text") result(code)
      type(c_ptr), value :: model, path, values
      type(c_error_t), intent(inout) :: error
      type(handle_t), pointer :: handle

      call c_f_pointer(model, handle)
      call handle%session%set(c_text(path), c_text(values), handle%failure)
      code = reported(handle%failure, wrong_input, error)
   end function nhbm_set_text

   integer(c_int) function nhbm_parameter(model, path, number, error) bind(c, name="nhbm_parameter") result(code)
      type(c_ptr), value :: model, path
      integer(c_int), intent(out) :: number
      type(c_error_t), intent(inout) :: error
      type(handle_t), pointer :: handle
      integer :: found

      call c_f_pointer(model, handle)
      call handle%session%resolve(c_text(path), found, handle%failure)
      number = int(found, c_int)
      code = reported(handle%failure, wrong_input, error)
   end function nhbm_parameter

   integer(c_int) function nhbm_set(model, number, value, error) bind(c, name="nhbm_set") result(code)
      type(c_ptr), value :: model
      integer(c_int), value :: number
      real(c_double), value :: value
      type(c_error_t), intent(inout) :: error
      type(handle_t), pointer :: handle

      call c_f_pointer(model, handle)
      call handle%session%set_number(int(number), real(value, wp), handle%failure)
      code = reported(handle%failure, wrong_use, error)
   end function nhbm_set

   integer(c_int) function nhbm_solve(model, start, error) bind(c, name="nhbm_solve") result(code)
      type(c_ptr), value :: model
      integer(c_int), value :: start
      type(c_error_t), intent(inout) :: error
      type(handle_t), pointer :: handle

      call c_f_pointer(model, handle)
      call handle%session%solve(start /= 0, handle%failure)
      code = reported(handle%failure, wrong_input, error)
   end function nhbm_solve

   integer(c_int) function nhbm_begin_curve(model, error) bind(c, name="nhbm_begin_curve") result(code)
      type(c_ptr), value :: model
      type(c_error_t), intent(inout) :: error
      type(handle_t), pointer :: handle

      call c_f_pointer(model, handle)
      call handle%session%begin_curve(handle%failure)
      code = reported(handle%failure, wrong_input, error)
   end function nhbm_begin_curve

   integer(c_int) function nhbm_next(model, is_point, error) bind(c, name="nhbm_next") result(code)
      type(c_ptr), value :: model
      integer(c_int), intent(out) :: is_point
      type(c_error_t), intent(inout) :: error
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: failure

      call c_f_pointer(model, handle)
      is_point = merge(1_c_int, 0_c_int, handle%session%has_curve)
      if (is_point == 1) call handle%session%next(failure)
      if (allocated(failure)) is_point = 0
      code = reported(failure, wrong_input, error)
   end function nhbm_next

   integer(c_int) function nhbm_integrate(model, error) bind(c, name="nhbm_integrate") result(code)
      type(c_ptr), value :: model
      type(c_error_t), intent(inout) :: error
      type(handle_t), pointer :: handle

      call c_f_pointer(model, handle)
      call handle%session%integrate(handle%failure)
      code = reported(handle%failure, wrong_input, error)
   end function nhbm_integrate

   integer(c_int) function nhbm_verify(model, n_periods, error) bind(c, name="nhbm_verify") result(code)
      type(c_ptr), value :: model
      integer(c_int), value :: n_periods
      type(c_error_t), intent(inout) :: error
      type(handle_t), pointer :: handle

      call c_f_pointer(model, handle)
      call handle%session%verify(int(n_periods), handle%failure)
      code = reported(handle%failure, wrong_use, error)
   end function nhbm_verify

   integer(c_int) function nhbm_column_of(model, name, column, error) bind(c, name="nhbm_column_of") result(code)
      type(c_ptr), value :: model, name
      type(c_column_t), intent(out) :: column
      type(c_error_t), intent(inout) :: error
      type(handle_t), pointer :: handle

      call c_f_pointer(model, handle)
      call handle%session%find_column(c_text(name), handle%failure)
      call show_column(handle, column)
      code = reported(handle%failure, wrong_use, error)
   end function nhbm_column_of

   integer(c_int) function nhbm_time_column_of(model, name, column, error) bind(c, name="nhbm_time_column_of") result(code)
      type(c_ptr), value :: model, name
      type(c_column_t), intent(out) :: column
      type(c_error_t), intent(inout) :: error
      type(handle_t), pointer :: handle

      call c_f_pointer(model, handle)
      call handle%session%find_time_column(c_text(name), handle%failure)
      call show_column(handle, column)
      code = reported(handle%failure, wrong_use, error)
   end function nhbm_time_column_of

   type(c_ptr) function nhbm_time_column_names(model) bind(c, name="nhbm_time_column_names") result(text)
      type(c_ptr), value :: model
      type(handle_t), pointer :: handle

      call c_f_pointer(model, handle)
      call handle%session%find_time_column("", handle%failure)
      text = address_of_text(handle%session%column%names, handle%text)
   end function nhbm_time_column_names

   !> Fills the column of C with the one that was found last.
   subroutine show_column(handle, column)
      type(handle_t), pointer, intent(in) :: handle
      type(c_column_t), intent(inout) :: column

      column%data = c_null_ptr
      column%n_axes = 0
      column%shape = 0
      associate (found => handle%session%column)
         column%kind = int(min(found%kind, column_kind%unknown), c_int)
         column%unit = address_of_text(found%units, handle%unit)
         column%axes = address_of_text(found%axes, handle%axes)
         if (column%kind /= column_kind%unknown) then
            column%n_axes = size(found%extents)
            column%shape(:size(found%extents)) = found%extents(size(found%extents):1:-1)
         end if
         if (found%kind == column_kind%real) column%data = address_of_reals(found%reals)
         if (found%kind == column_kind%integer) column%data = address_of_integers(found%integers)
      end associate
   end subroutine show_column

   type(c_ptr) function nhbm_column_names(model) bind(c, name="nhbm_column_names") result(text)
      type(c_ptr), value :: model
      type(handle_t), pointer :: handle

      call c_f_pointer(model, handle)
      call handle%session%find_column("", handle%failure)
      text = address_of_text(handle%session%column%names, handle%text)
   end function nhbm_column_names

   type(c_ptr) function nhbm_labels(model, axis) bind(c, name="nhbm_labels") result(text)
      type(c_ptr), value :: model, axis
      type(handle_t), pointer :: handle
      character(:), allocatable :: joined
      character(64), allocatable :: labels(:)
      integer :: i

      call c_f_pointer(model, handle)
      labels = handle%session%labels_along(c_text(axis))
      joined = ""
      do i = 1, size(labels)
         joined = joined//" "//trim(labels(i))
      end do
      text = address_of_text(joined(min(2, len(joined) + 1):), handle%text)
   end function nhbm_labels

   type(c_ptr) function nhbm_message(model) bind(c, name="nhbm_message") result(text)
      type(c_ptr), value :: model
      type(handle_t), pointer :: handle

      call c_f_pointer(model, handle)
      if (allocated(handle%session%result%message)) then
         text = address_of_text(handle%session%result%message, handle%text)
      else
         text = address_of_text("", handle%text)
      end if
   end function nhbm_message

   integer(c_int) function nhbm_ask(model, wants_end, context, error) bind(c, name="nhbm_ask") result(code)
      type(c_ptr), value :: model
      type(c_funptr), value :: wants_end
      type(c_ptr), value :: context
      type(c_error_t), intent(inout) :: error
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: none

      call c_f_pointer(model, handle)
      handle%session%cancellation%ask = wants_end
      handle%session%cancellation%context = context
      code = reported(none, wrong_use, error)
   end function nhbm_ask

   integer(c_int) function nhbm_follow(model, report, context, error) bind(c, name="nhbm_follow") result(code)
      type(c_ptr), value :: model
      type(c_funptr), value :: report
      type(c_ptr), value :: context
      type(c_error_t), intent(inout) :: error
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: none

      call c_f_pointer(model, handle)
      handle%session%cancellation%report = report
      handle%session%cancellation%report_context = context
      code = reported(none, wrong_use, error)
   end function nhbm_follow

   subroutine nhbm_points(model, n) bind(c, name="nhbm_points")
      type(c_ptr), value :: model
      integer(c_int), value :: n
      type(handle_t), pointer :: handle

      call c_f_pointer(model, handle)
      handle%session%n_points = max(int(n), 0)
   end subroutine nhbm_points

   type(c_ptr) function nhbm_version() bind(c, name="nhbm_version") result(text)
      integer :: i

      do i = 1, min(len(program_version), size(version_text) - 1)
         version_text(i) = program_version(i:i)
      end do
      text = c_loc(version_text)
   end function nhbm_version

   !> Row i of the table of input keys, from 0; 0 after the last.
   integer(c_int) function nhbm_key(i, row, size) bind(c, name="nhbm_key") result(is_row)
      integer(c_int), value :: i, size
      character(c_char), intent(out) :: row(size)
      character(:), allocatable :: text
      integer :: k

      is_row = merge(1_c_int, 0_c_int, i >= 0 .and. i < n_key_rows() .and. size > 0)
      if (is_row == 0) return
      text = trim(key_row(i + 1))
      do k = 1, min(len(text), size - 1)
         row(k) = text(k:k)
      end do
      row(k) = c_null_char
   end function nhbm_key

   !> Fills the error of C, and returns its code.
   integer(c_int) function reported(failure, code, error)
      type(error_t), allocatable, intent(in) :: failure
      integer(c_int), intent(in) :: code
      type(c_error_t), intent(inout) :: error
      integer :: i, n

      error%code = 0
      error%text(1) = c_null_char
      reported = 0
      if (.not. allocated(failure)) return
      n = min(len_trim(failure%message), error_length - 1)
      do i = 1, n
         error%text(i) = failure%message(i:i)
      end do
      error%text(n + 1) = c_null_char
      error%code = code
      reported = code
   end function reported

   !> Address of a text that is valid until it is replaced.
   type(c_ptr) function address_of_text(text, address)
      character(*), intent(in) :: text
      character(c_char), allocatable, target, intent(inout) :: address(:)
      integer :: i

      if (allocated(address)) deallocate (address)
      allocate (address(len(text) + 1))
      do i = 1, len(text)
         address(i) = text(i:i)
      end do
      address(len(text) + 1) = c_null_char
      address_of_text = c_loc(address)
   end function address_of_text

   type(c_ptr) function address_of_reals(values) result(address)
      real(wp), allocatable, target, intent(in) :: values(:)

      address = c_loc(values)
   end function address_of_reals

   type(c_ptr) function address_of_integers(values) result(address)
      integer, allocatable, target, intent(in) :: values(:)

      address = c_loc(values)
   end function address_of_integers
end module hb_c_interface
