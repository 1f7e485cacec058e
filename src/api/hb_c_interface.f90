!> The functions of nhbm.h: handles, texts and errors of C for hb_session. The header documents them.
!>
!> Each function with a model begins with `begin_call`, which fails for an invalid model or one in use, and ends with
!> `end_call`.
module hb_c_interface
   use, intrinsic :: iso_c_binding, only: c_associated, c_char, c_double, c_f_pointer, c_funptr, c_int, c_loc, &
      c_null_char, c_null_ptr, c_ptr, c_size_t
   use hb_c_handles, only: acquire, c_status, handle_kind, last_error, register_handle, release_handle, set_last_error, &
      status_of, unregister_handle
   use hb_c_structures, only: c_structures_t
   use hb_c_text, only: c_text
   use hb_column_view, only: column_kind
   use hb_error, only: error_t, fail
   use hb_key_rows, only: key_row, n_key_rows
   use hb_kinds, only: wp
   use hb_motion_result, only: motion_result_t
   use hb_outcome, only: is_solved
   use hb_session, only: session_t
   use hb_sundials, only: has_cvode
   use hb_user_library, only: check_law_info, law_info_t, register_law_of_c, unregister_law_of_c
   use hb_version, only: git_commit, program_version, version_number
   implicit none
   private

   integer(c_int), parameter :: api_version = 1_c_int                 ! NHBM_API_VERSION
   integer(c_int), parameter :: cold_start = 0_c_int, warm_start = 1_c_int
   integer, parameter :: max_axes = 4                                 ! NHBM_MAX_AXES
   integer, parameter :: longest_status = 40

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
      integer(c_int) :: lowest_flag
      integer(c_int) :: kind
   end type c_description_t

   !> struct nhbm_motion.
   type, bind(c) :: c_motion_t
      integer(c_size_t) :: n_tones
      integer(c_size_t) :: n_harmonics
      integer(c_size_t) :: n_dofs
      type(c_ptr) :: frequency
      type(c_ptr) :: tuples
      type(c_ptr) :: coefficients
      real(c_double) :: truncation_estimate
      real(c_double) :: aliasing_estimate
      type(c_ptr) :: frequency_estimate
      integer(c_int) :: status
      integer(c_int) :: n_unstable
   end type c_motion_t

   !> struct nhbm_model: a session with the texts passed to C.
   type :: handle_t
      type(session_t) :: session
      character(c_char), allocatable :: text(:), unit(:), axes(:), long_name(:), dof_units(:), flags(:)
      real(wp), allocatable :: frequencies(:)
   end type handle_t

   character(*), parameter :: nul = c_null_char
   character(33), target, save :: version_text = program_version//nul
   character(len(git_commit) + 1), target, save :: commit_text = git_commit//nul
   character(1), target, save :: empty_text = nul
   character(longest_status), target, save :: status_texts(0:6) = [character(longest_status) :: "success"//nul, &
      "invalid input"//nul, "invalid argument"//nul, "invalid state: it cannot be called now"//nul, &
      "the model is in use by another call"//nul, "out of memory"//nul, "unknown status"//nul]   ! of each status, negative

contains

   ! Status and errors

   type(c_ptr) function nhbm_status_text(status) bind(c, name="nhbm_status_text") result(text)
      integer(c_int), value :: status
      integer :: k

      k = 6
      if (status <= 0_c_int .and. status > -6_c_int) k = -int(status)
      text = c_loc(status_texts(k))
   end function nhbm_status_text

   type(c_ptr) function nhbm_get_last_error() bind(c, name="nhbm_get_last_error") result(text)
      text = last_error()
   end function nhbm_get_last_error

   ! Versions, features, input keys

   integer(c_int) function nhbm_get_api_version() bind(c, name="nhbm_get_api_version") result(version)
      version = api_version
   end function nhbm_get_api_version

   type(c_ptr) function nhbm_get_version() bind(c, name="nhbm_get_version") result(text)
      text = c_loc(version_text)
   end function nhbm_get_version

   type(c_ptr) function nhbm_get_commit() bind(c, name="nhbm_get_commit") result(commit)
      commit = c_loc(commit_text)
   end function nhbm_get_commit

   integer(c_int) function nhbm_get_version_number() bind(c, name="nhbm_get_version_number") result(number)
      number = int(version_number, c_int)
   end function nhbm_get_version_number

   integer(c_int) function nhbm_has_feature(feature) bind(c, name="nhbm_has_feature") result(has)
      type(c_ptr), value :: feature
      logical :: is_known
      integer :: i

      is_known = c_text(feature)//"|" == "cvode|" .and. has_cvode()
      do i = 1, n_key_rows()
         is_known = is_known .or. index(key_row(i), c_text(feature)//" | ") == 1
      end do
      has = merge(1_c_int, 0_c_int, is_known)
   end function nhbm_has_feature

   integer(c_size_t) function nhbm_get_key_count() bind(c, name="nhbm_get_key_count") result(n)
      n = int(n_key_rows(), c_size_t)
   end function nhbm_get_key_count

   integer(c_int) function nhbm_get_key_row(index, row, size) bind(c, name="nhbm_get_key_row") result(status)
      integer(c_size_t), value :: index, size
      type(c_ptr), value :: row
      character(*), parameter :: name = "nhbm_get_key_row"
      character(kind=c_char), pointer :: bytes(:)
      type(error_t), allocatable :: error
      character(:), allocatable :: text
      integer :: k

      text = ""
      if (.not. c_associated(row) .or. size == 0_c_size_t) then
         call fail(error, name//": row must not be NULL, and size not 0")
      else if (index < 0_c_size_t .or. index >= int(n_key_rows(), c_size_t)) then
         call fail(error, name//": index must be below nhbm_get_key_count()")
      else
         text = trim(key_row(int(index) + 1))
         if (size > 0_c_size_t .and. size < len(text, kind=c_size_t) + 1_c_size_t) then   ! a size above huge() appears negative
            call fail(error, name//": the row does not fit; NHBM_KEY_ROW_SIZE bytes are enough")
            text = ""
         end if
      end if
      status = status_of(error, c_status%invalid_argument)
      if (.not. c_associated(row) .or. size == 0_c_size_t) return
      call c_f_pointer(row, bytes, [len(text) + 1])
      do k = 1, len(text)
         bytes(k) = text(k:k)
      end do
      bytes(len(text) + 1) = c_null_char
   end function nhbm_get_key_row

   ! Models and their input

   integer(c_int) function nhbm_create(model) bind(c, name="nhbm_create") result(status)
      type(c_ptr), value :: model
      type(c_ptr), pointer :: address
      type(handle_t), pointer :: handle
      integer :: stat

      status = c_status%invalid_argument
      if (.not. c_associated(model)) then
         call set_last_error("nhbm_create: model must not be NULL")
         return
      end if
      call c_f_pointer(model, address)
      address = c_null_ptr
      status = c_status%out_of_memory
      allocate (handle, stat=stat)
      if (stat == 0) then
         if (register_handle(c_loc(handle), handle_kind%model) == 0) then
            address = c_loc(handle)
            status = c_status%success
            return
         end if
         deallocate (handle)
      end if
      call set_last_error("nhbm_create: memory is insufficient")
   end function nhbm_create

   integer(c_int) function nhbm_destroy(model) bind(c, name="nhbm_destroy") result(status)
      type(c_ptr), value :: model
      type(c_ptr), pointer :: address
      type(handle_t), pointer :: handle

      status = c_status%invalid_argument
      if (.not. c_associated(model)) then
         call set_last_error("nhbm_destroy: model must not be NULL; *model may be")
         return
      end if
      call c_f_pointer(model, address)
      status = c_status%success
      if (.not. c_associated(address)) return
      status = begin_call(address, "nhbm_destroy", handle)
      if (status /= c_status%success) return
      call unregister_handle(address)
      call handle%session%destroy()
      deallocate (handle)
      address = c_null_ptr
   end function nhbm_destroy

   integer(c_int) function nhbm_read_input(model, text, name) bind(c, name="nhbm_read_input") result(status)
      type(c_ptr), value :: model, text, name
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      status = begin_call(model, "nhbm_read_input", handle, texts=[text, name])
      if (status /= c_status%success) return
      call handle%session%read(c_text(name), c_text(text), error)
      status = end_call(model, error, c_status%invalid_input)
   end function nhbm_read_input

   integer(c_int) function nhbm_get_input(model, text) bind(c, name="nhbm_get_input") result(status)
      type(c_ptr), value :: model, text
      type(handle_t), pointer :: handle
      character(:), allocatable :: input

      status = begin_call(model, "nhbm_get_input", handle, text=text, needs_input=.true.)
      if (status /= c_status%success) return
      call handle%session%complete_input(input)
      status = end_call_with_text(model, "nhbm_get_input", input, handle%text, text)
   end function nhbm_get_input

   integer(c_int) function nhbm_get_given_input(model, text) bind(c, name="nhbm_get_given_input") result(status)
      type(c_ptr), value :: model, text
      type(handle_t), pointer :: handle
      character(:), allocatable :: input

      status = begin_call(model, "nhbm_get_given_input", handle, text=text, needs_input=.true.)
      if (status /= c_status%success) return
      call handle%session%complete_input(input, only_given=.true.)
      status = end_call_with_text(model, "nhbm_get_given_input", input, handle%text, text)
   end function nhbm_get_given_input

   integer(c_int) function nhbm_get_libraries(model, text) bind(c, name="nhbm_get_libraries") result(status)
      type(c_ptr), value :: model, text
      type(handle_t), pointer :: handle
      character(:), allocatable :: libraries

      status = begin_call(model, "nhbm_get_libraries", handle, text=text, needs_model=.true.)
      if (status /= c_status%success) return
      call handle%session%libraries(libraries)
      status = end_call_with_text(model, "nhbm_get_libraries", libraries, handle%text, text)
   end function nhbm_get_libraries

   integer(c_int) function nhbm_set_key(model, path, values) bind(c, name="nhbm_set_key") result(status)
      type(c_ptr), value :: model, path, values
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      status = begin_call(model, "nhbm_set_key", handle, texts=[path, values], needs_input=.true.)
      if (status /= c_status%success) return
      call handle%session%set_key(c_text(path), c_text(values), error)
      status = end_call(model, error, c_status%invalid_input)
   end function nhbm_set_key

   integer(c_int) function nhbm_find_parameter(model, path, parameter) bind(c, name="nhbm_find_parameter") result(status)
      type(c_ptr), value :: model, path, parameter
      integer(c_int), pointer :: found
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error
      integer :: number

      nullify (found)
      if (c_associated(parameter)) then
         call c_f_pointer(parameter, found)
         found = 0_c_int
      end if
      status = begin_call(model, "nhbm_find_parameter", handle, texts=[path, parameter], needs_input=.true.)
      if (status /= c_status%success) return
      call handle%session%find_parameter(c_text(path), number, error)
      found = int(number, c_int)
      status = end_call(model, error, c_status%invalid_input)
   end function nhbm_find_parameter

   integer(c_int) function nhbm_set_parameter(model, parameter, value) bind(c, name="nhbm_set_parameter") result(status)
      type(c_ptr), value :: model
      integer(c_int), value :: parameter
      real(c_double), value :: value
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      status = begin_call(model, "nhbm_set_parameter", handle, needs_input=.true.)
      if (status /= c_status%success) return
      call handle%session%set_parameter(int(parameter), real(value, wp), error)
      status = end_call(model, error, c_status%invalid_argument)
   end function nhbm_set_parameter

   integer(c_int) function nhbm_set_structure_callback(model, callback, context) &
      bind(c, name="nhbm_set_structure_callback") result(status)
      type(c_ptr), value :: model, context
      type(c_funptr), value :: callback
      type(handle_t), pointer :: handle

      status = begin_call(model, "nhbm_set_structure_callback", handle)
      if (status /= c_status%success) return
      call handle%session%set_structure_source(c_structures_t(callback, context))
      call release_handle(model)
   end function nhbm_set_structure_callback

   ! Laws of the program

   integer(c_int) function nhbm_register_law(name, info, evaluate) bind(c, name="nhbm_register_law") result(status)
      type(c_ptr), value :: name, info
      type(c_funptr), value :: evaluate
      type(law_info_t), pointer :: properties
      type(error_t), allocatable :: error

      nullify (properties)
      if (.not. (c_associated(name) .and. c_associated(info) .and. c_associated(evaluate))) then
         call fail(error, "name, info and evaluate must not be NULL")
      else
         call c_f_pointer(info, properties)
         call check_law_info(c_text(name), properties, is_registered=.true., error=error)
      end if
      if (allocated(error)) error%message = "nhbm_register_law: "//error%message
      status = status_of(error, c_status%invalid_argument)
      if (status /= c_status%success) return
      if (register_law_of_c(name, properties, evaluate) == 0) return
      status = c_status%out_of_memory
      call set_last_error("nhbm_register_law: memory is insufficient")
   end function nhbm_register_law

   integer(c_int) function nhbm_unregister_law(name) bind(c, name="nhbm_unregister_law") result(status)
      type(c_ptr), value :: name

      status = c_status%success
      if (.not. c_associated(name)) then
         status = c_status%invalid_argument
         call set_last_error("nhbm_unregister_law: name must not be NULL")
      else if (unregister_law_of_c(name) /= 0) then
         status = c_status%invalid_argument
         call set_last_error("nhbm_unregister_law: no law '"//c_text(name)//"' is registered")
      end if
   end function nhbm_unregister_law

   ! Callbacks during computations

   integer(c_int) function nhbm_set_interrupt_callback(model, callback, context) &
      bind(c, name="nhbm_set_interrupt_callback") result(status)
      type(c_ptr), value :: model, context
      type(c_funptr), value :: callback
      type(handle_t), pointer :: handle

      status = begin_call(model, "nhbm_set_interrupt_callback", handle)
      if (status /= c_status%success) return
      handle%session%cancellation%interrupt = callback
      handle%session%cancellation%interrupt_context = context
      call release_handle(model)
   end function nhbm_set_interrupt_callback

   integer(c_int) function nhbm_set_progress_callback(model, callback, context) &
      bind(c, name="nhbm_set_progress_callback") result(status)
      type(c_ptr), value :: model, context
      type(c_funptr), value :: callback
      type(handle_t), pointer :: handle

      status = begin_call(model, "nhbm_set_progress_callback", handle)
      if (status /= c_status%success) return
      handle%session%cancellation%report = callback
      handle%session%cancellation%report_context = context
      call release_handle(model)
   end function nhbm_set_progress_callback

   ! Computations

   integer(c_int) function nhbm_solve(model, start) bind(c, name="nhbm_solve") result(status)
      type(c_ptr), value :: model
      integer(c_int), value :: start
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      status = begin_call(model, "nhbm_solve", handle, needs_input=.true.)
      if (status /= c_status%success) return
      if (start == cold_start .or. start == warm_start) then
         call handle%session%solve(start == warm_start, error)
         status = end_call(model, error, c_status%invalid_input)
      else
         call fail(error, "nhbm_solve: start must be NHBM_COLD_START or NHBM_WARM_START")
         status = end_call(model, error, c_status%invalid_argument)
      end if
   end function nhbm_solve

   integer(c_int) function nhbm_set_point_count(model, n_points) bind(c, name="nhbm_set_point_count") result(status)
      type(c_ptr), value :: model
      integer(c_size_t), value :: n_points
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      status = begin_call(model, "nhbm_set_point_count", handle)
      if (status /= c_status%success) return
      if (n_points >= 0_c_size_t .and. n_points <= int(huge(1), c_size_t)) then
         handle%session%n_points = int(n_points)
      else
         call fail(error, "nhbm_set_point_count: n_points must be at most 2147483647")
      end if
      status = end_call(model, error, c_status%invalid_argument)
   end function nhbm_set_point_count

   integer(c_int) function nhbm_curve_begin(model) bind(c, name="nhbm_curve_begin") result(status)
      type(c_ptr), value :: model
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      status = begin_call(model, "nhbm_curve_begin", handle, needs_input=.true.)
      if (status /= c_status%success) return
      call handle%session%curve_begin(error)
      status = end_call(model, error, c_status%invalid_input)
   end function nhbm_curve_begin

   integer(c_int) function nhbm_curve_next(model, has_point) bind(c, name="nhbm_curve_next") result(status)
      type(c_ptr), value :: model, has_point
      integer(c_int), pointer :: has
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      nullify (has)
      if (c_associated(has_point)) then
         call c_f_pointer(has_point, has)
         has = 0_c_int
      end if
      status = begin_call(model, "nhbm_curve_next", handle, texts=[has_point], needs_input=.true.)
      if (status /= c_status%success) return
      if (.not. handle%session%has_begun_curve()) then
         call fail(error, "nhbm_curve_next: there is no curve; nhbm_curve_begin begins one, and setting a value or another "// &
                   "computation ends it")
         status = end_call(model, error, c_status%invalid_state)
         return
      end if
      if (handle%session%has_curve) then
         call handle%session%curve_next(error)
         if (.not. allocated(error)) has = 1_c_int
      end if
      status = end_call(model, error, c_status%invalid_input)
   end function nhbm_curve_next

   integer(c_int) function nhbm_integrate(model) bind(c, name="nhbm_integrate") result(status)
      type(c_ptr), value :: model
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      status = begin_call(model, "nhbm_integrate", handle, needs_input=.true.)
      if (status /= c_status%success) return
      call handle%session%integrate(error)
      status = end_call(model, error, c_status%invalid_input)
   end function nhbm_integrate

   integer(c_int) function nhbm_verify(model, max_periods) bind(c, name="nhbm_verify") result(status)
      type(c_ptr), value :: model
      integer(c_int), value :: max_periods
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      status = begin_call(model, "nhbm_verify", handle, needs_input=.true.)
      if (status /= c_status%success) return
      status = c_status%invalid_state
      if (handle%session%may_verify()) status = c_status%invalid_input
      if (max_periods < 0_c_int) status = c_status%invalid_argument
      call handle%session%verify(int(max_periods), error)
      status = end_call(model, error, status)
   end function nhbm_verify

   integer(c_int) function nhbm_verify_motion(model, motion, max_periods) bind(c, name="nhbm_verify_motion") result(status)
      type(c_ptr), value :: model, motion
      integer(c_int), value :: max_periods
      type(handle_t), pointer :: handle
      type(motion_result_t) :: result
      type(error_t), allocatable :: error

      status = begin_call(model, "nhbm_verify_motion", handle, texts=[motion], needs_input=.true.)
      if (status /= c_status%success) return
      call take_motion(motion, result, error)
      status = c_status%invalid_argument
      if (.not. allocated(error)) then
         if (max_periods >= 0_c_int) status = c_status%invalid_input
         call handle%session%verify_motion(result, int(max_periods), error)
      end if
      status = end_call(model, error, status)
   end function nhbm_verify_motion

   !> Copies a motion of C. Fails for lengths that are zero or too large, and for arrays that are NULL.
   subroutine take_motion(address, motion, error)
      type(c_ptr), intent(in) :: address
      type(motion_result_t), intent(out) :: motion
      type(error_t), allocatable, intent(out) :: error
      type(c_motion_t), pointer :: given
      real(c_double), pointer :: coefficients(:, :, :), frequency(:), frequency_estimate(:)
      integer(c_int), pointer :: tuples(:, :)
      integer(c_size_t), parameter :: largest = int(huge(1), c_size_t)

      call c_f_pointer(address, given)
      associate (n => [given%n_tones, given%n_harmonics, given%n_dofs])
         if (any(n < 1_c_size_t .or. n > largest)) then
            call fail(error, "nhbm_verify_motion: n_tones, n_harmonics and n_dofs must be at least 1")
         else if (any_null([given%frequency, given%tuples, given%coefficients])) then
            call fail(error, "nhbm_verify_motion: frequency, tuples and coefficients must not be NULL")
         else if (.not. is_solved(int(given%status))) then
            call fail(error, "nhbm_verify_motion: the status is not that of a motion")
         end if
         if (allocated(error)) return
         call c_f_pointer(given%frequency, frequency, [n(1)])
         call c_f_pointer(given%tuples, tuples, [n(1), n(2)])
         call c_f_pointer(given%coefficients, coefficients, [2_c_size_t, n(2), n(3)])
         motion%status = int(given%status)
         motion%frequency = real(frequency, wp)
         motion%harmonics%tuples = int(tuples)
         motion%coefficients = real(coefficients, wp)
         motion%error_estimate%combination = 0*int(tuples(:, 1))         ! the estimates are known, or NaN
         motion%error_estimate%truncation = real(given%truncation_estimate, wp)
         motion%error_estimate%aliasing = real(given%aliasing_estimate, wp)
         motion%stability%n_unstable = int(given%n_unstable)
         if (.not. c_associated(given%frequency_estimate)) return
         call c_f_pointer(given%frequency_estimate, frequency_estimate, [n(1)])
         motion%error_estimate%frequency_error = real(frequency_estimate, wp)
      end associate
   end subroutine take_motion

   ! Checks

   integer(c_int) function nhbm_get_warnings(model, warnings) bind(c, name="nhbm_get_warnings") result(status)
      type(c_ptr), value :: model, warnings
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error
      character(:), allocatable :: text

      status = begin_call(model, "nhbm_get_warnings", handle, text=warnings, needs_input=.true.)
      if (status /= c_status%success) return
      call handle%session%warnings(text, error)
      if (allocated(error)) then
         status = end_call(model, error, c_status%invalid_input)
      else
         status = end_call_with_text(model, "nhbm_get_warnings", text, handle%text, warnings)
      end if
   end function nhbm_get_warnings

   integer(c_int) function nhbm_get_natural_frequencies(model, n, frequencies) bind(c, name="nhbm_get_natural_frequencies") &
      result(status)
      type(c_ptr), value :: model, n, frequencies
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error
      integer(c_size_t), pointer :: number
      type(c_ptr), pointer :: address

      status = begin_call(model, "nhbm_get_natural_frequencies", handle, texts=[n, frequencies], needs_input=.true.)
      if (status /= c_status%success) return
      call c_f_pointer(n, number)
      call c_f_pointer(frequencies, address)
      number = 0_c_size_t
      address = c_null_ptr
      call handle%session%natural_frequencies(handle%frequencies, error)
      if (.not. allocated(error)) then
         number = size(handle%frequencies, kind=c_size_t)
         if (number > 0_c_size_t) address = address_of_reals(handle%frequencies)
      end if
      status = end_call(model, error, c_status%invalid_input)
   end function nhbm_get_natural_frequencies

   ! Results

   integer(c_int) function nhbm_get_column(model, name, column) bind(c, name="nhbm_get_column") result(status)
      type(c_ptr), value :: model, name, column
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      call clear_column(column)
      status = begin_call(model, "nhbm_get_column", handle, texts=[name, column], needs_model=.true.)
      if (status /= c_status%success) return
      call handle%session%find_column(c_text(name), error)
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
      call handle%session%find_column(c_text(name), error)
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
      call handle%session%find_time_column(c_text(name), error)
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
      call handle%session%find_column("", error)
      status = end_call_with_text(model, "nhbm_get_column_names", handle%session%column%names, handle%text, names)
   end function nhbm_get_column_names

   integer(c_int) function nhbm_get_time_column(model, name, column) bind(c, name="nhbm_get_time_column") result(status)
      type(c_ptr), value :: model, name, column
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      call clear_column(column)
      status = begin_call(model, "nhbm_get_time_column", handle, texts=[name, column], needs_input=.true., needs_time=.true.)
      if (status /= c_status%success) return
      call handle%session%find_time_column(c_text(name), error)
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
      call handle%session%find_time_column("", error)
      status = end_call_with_text(model, "nhbm_get_time_column_names", handle%session%column%names, handle%text, names)
   end function nhbm_get_time_column_names

   integer(c_int) function nhbm_get_labels(model, axis, labels) bind(c, name="nhbm_get_labels") result(status)
      type(c_ptr), value :: model, axis, labels
      type(handle_t), pointer :: handle
      character(:), allocatable :: joined
      character(64), allocatable :: words(:)
      integer :: i

      status = begin_call(model, "nhbm_get_labels", handle, text=labels, texts=[axis], needs_model=.true.)
      if (status /= c_status%success) return
      words = handle%session%labels_along(c_text(axis))
      joined = ""
      do i = 1, size(words)
         joined = joined//new_line("a")//trim(words(i))
      end do
      status = end_call_with_text(model, "nhbm_get_labels", joined(min(2, len(joined) + 1):), handle%text, labels)
   end function nhbm_get_labels

   integer(c_int) function nhbm_get_message(model, message) bind(c, name="nhbm_get_message") result(status)
      type(c_ptr), value :: model, message
      type(handle_t), pointer :: handle
      character(:), allocatable :: text

      status = begin_call(model, "nhbm_get_message", handle, text=message, needs_input=.true.)
      if (status /= c_status%success) return
      text = ""
      if (allocated(handle%session%result%message)) text = handle%session%result%message
      status = end_call_with_text(model, "nhbm_get_message", text, handle%text, message)
   end function nhbm_get_message

   integer(c_int) function nhbm_get_doubt(model, doubt) bind(c, name="nhbm_get_doubt") result(status)
      type(c_ptr), value :: model, doubt
      type(handle_t), pointer :: handle
      character(:), allocatable :: text

      status = begin_call(model, "nhbm_get_doubt", handle, text=doubt, needs_input=.true.)
      if (status /= c_status%success) return
      call handle%session%doubt(text)
      status = end_call_with_text(model, "nhbm_get_doubt", text, handle%text, doubt)
   end function nhbm_get_doubt

   ! Common to the functions

   !> Makes the calling function the only user of a model. If the status is not `success`, the message is that of the last error
   !> and the function must return.
   integer(c_int) function begin_call(model, name, handle, text, texts, needs_input, needs_model, needs_time) result(status)
      type(c_ptr), intent(in) :: model
      character(*), intent(in) :: name                                !! of the function
      type(handle_t), pointer, intent(out) :: handle
      type(c_ptr), intent(in), optional :: text                       !! address of a text that is returned: an empty one now
      type(c_ptr), intent(in), optional :: texts(:)                   !! further pointers that must not be NULL
      logical, intent(in), optional :: needs_input                    !! fails without an input
      logical, intent(in), optional :: needs_model                    !! also if the present values of the input are invalid
      logical, intent(in), optional :: needs_time                     !! fails without results of a time integration
      type(c_ptr), pointer :: address
      type(error_t), allocatable :: error
      logical :: has_null

      has_null = .false.
      if (present(text)) then
         has_null = .not. c_associated(text)
         if (.not. has_null) then
            call c_f_pointer(text, address)
            address = c_loc(empty_text)
         end if
      end if
      if (present(texts)) has_null = has_null .or. any_null(texts)
      status = acquire(model, handle_kind%model, name)
      if (status /= c_status%success) return
      call c_f_pointer(model, handle)
      status = c_status%invalid_state
      if (has_null) then
         call fail(error, "an argument is NULL")
         status = c_status%invalid_argument
      else if ((present(needs_input) .or. present(needs_model)) .and. .not. handle%session%has_input) then
         call fail(error, "the model has no input; call nhbm_read_input before")
      else if (present(needs_model) .and. .not. handle%session%model%is_read) then
         call fail(error, "the present values of the input are invalid; set others and compute again")
      else if (present(needs_time)) then
         if (.not. handle%session%has_time_columns()) call fail(error, "there are no results of a time integration; call "// &
                                                                "nhbm_integrate or nhbm_verify before")
      end if
      if (allocated(error)) then
         call set_last_error(name//": "//error%message)
         call release_handle(model)
      else
         status = c_status%success
      end if
   end function begin_call

   !> Releases the model. Returns `status` if there is an error.
   integer(c_int) function end_call(model, error, status)
      type(c_ptr), intent(in) :: model
      type(error_t), allocatable, intent(in) :: error
      integer(c_int), intent(in) :: status                            !! of an error

      end_call = status_of(error, status)
      call release_handle(model)
   end function end_call

   !> Stores a text until it is replaced, returns its address through `address`, and releases the model.
   integer(c_int) function end_call_with_text(model, name, text, storage, address) result(status)
      type(c_ptr), intent(in) :: model
      character(*), intent(in) :: name                                !! of the function
      character(*), intent(in) :: text
      character(c_char), allocatable, intent(inout) :: storage(:)
      type(c_ptr), intent(in) :: address
      type(c_ptr), pointer :: returned

      call c_f_pointer(address, returned)
      returned = address_of_text(text, storage)
      status = c_status%success
      if (.not. c_associated(returned)) then
         returned = c_loc(empty_text)
         status = c_status%out_of_memory
         call set_last_error(name//": memory is insufficient")
      end if
      call release_handle(model)
   end function end_call_with_text

   logical function any_null(addresses)
      type(c_ptr), intent(in) :: addresses(:)
      integer :: i

      any_null = .false.
      do i = 1, size(addresses)
         any_null = any_null .or. .not. c_associated(addresses(i))
      end do
   end function any_null

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
      associate (found => handle%session%column)
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
      description%lowest_flag = 0_c_int
      description%kind = int(column_kind%unknown, c_int)
   end subroutine clear_description

   !> Fills a cleared description of C with that of the column that was found last.
   integer(c_int) function shown_description(handle, address) result(status)
      type(handle_t), pointer, intent(in) :: handle
      type(c_ptr), intent(in) :: address
      type(c_description_t), pointer :: description

      call c_f_pointer(address, description)
      associate (found => handle%session%column)
         description%long_name = address_of_text(found%long_name, handle%long_name)
         description%dof_units = address_of_text(found%dof_units, handle%dof_units)
         description%flag_meanings = address_of_text(found%flags, handle%flags)
         description%lowest_flag = int(found%lowest_flag, c_int)
         description%kind = int(found%kind_of_values, c_int)
      end associate
      status = c_status%success
      if (c_associated(description%long_name) .and. c_associated(description%dof_units) .and. &
          c_associated(description%flag_meanings)) return
      call clear_description(address)
      call set_last_error("nhbm_describe_column: memory is insufficient")
      status = c_status%out_of_memory
   end function shown_description

   !> Address of a text that is valid until it is replaced; NULL if memory is insufficient.
   type(c_ptr) function address_of_text(text, storage)
      character(*), intent(in) :: text
      character(c_char), allocatable, target, intent(inout) :: storage(:)
      integer :: i, stat

      address_of_text = c_null_ptr
      if (allocated(storage)) deallocate (storage)
      allocate (storage(len(text) + 1), stat=stat)
      if (stat /= 0) return
      do i = 1, len(text)
         storage(i) = text(i:i)
      end do
      storage(len(text) + 1) = c_null_char
      address_of_text = c_loc(storage)
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
