!> The functions of nhbm.h for models and their input. The header documents them.
module hb_c_input
   use, intrinsic :: iso_c_binding, only: c_associated, c_double, c_f_pointer, c_funptr, c_int, c_loc, c_null_ptr, &
      c_ptr, c_size_t
   use hb_c_handles, only: c_status, handle_kind, register_handle, release_handle, set_last_error, unregister_handle
   use hb_c_model, only: begin_call, end_call, end_call_with_text, handle_t
   use hb_c_structures, only: c_structures_t
   use hb_c_text, only: c_text
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   implicit none
   private

contains

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
         call free(handle)
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
      call free(handle)
      address = c_null_ptr
   end function nhbm_destroy

   !> Deallocates a model, for both procedures above: gfortran expands the deallocation of every nested component, 240 kB of code.
   subroutine free(handle)
      type(handle_t), pointer, intent(in) :: handle
      type(handle_t), pointer :: object

      object => handle
      deallocate (object)
   end subroutine free

   integer(c_int) function nhbm_read_input(model, text, name) bind(c, name="nhbm_read_input") result(status)
      type(c_ptr), value :: model, text, name
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      status = begin_call(model, "nhbm_read_input", handle, texts=[text, name])
      if (status /= c_status%success) return
      call handle%session%read(c_text(name), c_text(text), error)
      status = end_call(model, error, c_status%invalid_input)
   end function nhbm_read_input

   integer(c_int) function nhbm_input_begin(model) bind(c, name="nhbm_input_begin") result(status)
      type(c_ptr), value :: model
      type(handle_t), pointer :: handle

      status = begin_call(model, "nhbm_input_begin", handle)
      if (status /= c_status%success) return
      call handle%session%begin_input()
      call release_handle(model)
   end function nhbm_input_begin

   integer(c_int) function nhbm_input_add_group(model, name) bind(c, name="nhbm_input_add_group") result(status)
      type(c_ptr), value :: model, name
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      status = begin_call(model, "nhbm_input_add_group", handle, texts=[name])
      if (status /= c_status%success) return
      call handle%session%input%add_group(c_text(name), error)
      status = end_input_call(model, "nhbm_input_add_group", error)
   end function nhbm_input_add_group

   integer(c_int) function nhbm_input_set_text(model, key, text) bind(c, name="nhbm_input_set_text") result(status)
      type(c_ptr), value :: model, key, text
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      status = begin_call(model, "nhbm_input_set_text", handle, texts=[key, text])
      if (status /= c_status%success) return
      call handle%session%input%set_text(c_text(key), c_text(text), error)
      status = end_input_call(model, "nhbm_input_set_text", error)
   end function nhbm_input_set_text

   integer(c_int) function nhbm_input_set_logical(model, key, value) bind(c, name="nhbm_input_set_logical") result(status)
      type(c_ptr), value :: model, key
      integer(c_int), value :: value
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      status = begin_call(model, "nhbm_input_set_logical", handle, texts=[key])
      if (status /= c_status%success) return
      call handle%session%input%set_values(c_text(key), [value /= 0_c_int], error)
      status = end_input_call(model, "nhbm_input_set_logical", error)
   end function nhbm_input_set_logical

   integer(c_int) function nhbm_input_set_integers(model, key, n, values) bind(c, name="nhbm_input_set_integers") result(status)
      type(c_ptr), value :: model, key, values
      integer(c_size_t), value :: n
      integer(c_int), pointer :: given(:)
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      status = begin_call(model, "nhbm_input_set_integers", handle, texts=[key, values])
      if (status /= c_status%success) return
      call check_count(n, error)
      if (.not. allocated(error)) then
         call c_f_pointer(values, given, [n])
         call handle%session%input%set_values(c_text(key), int(given), error)
      end if
      status = end_input_call(model, "nhbm_input_set_integers", error)
   end function nhbm_input_set_integers

   integer(c_int) function nhbm_input_set_reals(model, key, n, values) bind(c, name="nhbm_input_set_reals") result(status)
      type(c_ptr), value :: model, key, values
      integer(c_size_t), value :: n
      real(c_double), pointer :: given(:)
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      status = begin_call(model, "nhbm_input_set_reals", handle, texts=[key, values])
      if (status /= c_status%success) return
      call check_count(n, error)
      if (.not. allocated(error)) then
         call c_f_pointer(values, given, [n])
         call handle%session%input%set_values(c_text(key), real(given, wp), error)
      end if
      status = end_input_call(model, "nhbm_input_set_reals", error)
   end function nhbm_input_set_reals

   integer(c_int) function nhbm_input_set_real(model, key, value) bind(c, name="nhbm_input_set_real") result(status)
      type(c_ptr), value :: model, key
      real(c_double), value :: value
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      status = begin_call(model, "nhbm_input_set_real", handle, texts=[key])
      if (status /= c_status%success) return
      call handle%session%input%set_values(c_text(key), [real(value, wp)], error)
      status = end_input_call(model, "nhbm_input_set_real", error)
   end function nhbm_input_set_real

   integer(c_int) function nhbm_input_end(model) bind(c, name="nhbm_input_end") result(status)
      type(c_ptr), value :: model
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      status = begin_call(model, "nhbm_input_end", handle)
      if (status /= c_status%success) return
      status = merge(c_status%invalid_input, c_status%invalid_state, handle%session%input%is_begun)
      call handle%session%end_input(error)
      status = end_call(model, error, status)
   end function nhbm_input_end

   !> Releases the model. An error is that of an argument or, if no input was begun, of the state.
   integer(c_int) function end_input_call(model, name, error) result(status)
      type(c_ptr), intent(in) :: model
      character(*), intent(in) :: name                                !! of the function
      type(error_t), allocatable, intent(inout) :: error
      type(handle_t), pointer :: handle

      call c_f_pointer(model, handle)
      status = merge(c_status%invalid_argument, c_status%invalid_state, handle%session%input%is_begun)
      if (allocated(error)) error%message = name//": "//error%message
      status = end_call(model, error, status)
   end function end_input_call

   subroutine check_count(n, error)
      integer(c_size_t), intent(in) :: n
      type(error_t), allocatable, intent(out) :: error

      if (n > int(huge(1), c_size_t)) call fail(error, "n must be at most 2147483647")
   end subroutine check_count

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
end module hb_c_input
