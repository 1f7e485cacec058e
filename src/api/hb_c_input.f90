!> The functions of nhbm.h for models and their input. The header documents them.
module hb_c_input
   use, intrinsic :: iso_c_binding, only: c_associated, c_double, c_f_pointer, c_funptr, c_int, c_loc, c_null_ptr, &
      c_ptr, c_size_t
   use hb_c_handles, only: c_status, handle_kind, register_handle, release_handle, set_last_error, unregister_handle
   use hb_c_model, only: any_null, begin_call, end_call, end_call_with_text, handle_t
   use hb_c_structures, only: c_structures_t
   use hb_c_text, only: c_text
   use hb_error, only: error_t, fail
   use hb_input_keys, only: kind_of
   use hb_text, only: string_t
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
         allocate (handle%session, stat=stat)
         if (stat == 0) then
            if (register_handle(c_loc(handle), handle_kind%model) == 0) then
               address = c_loc(handle)
               status = c_status%success
               return
            end if
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

   integer(c_int) function nhbm_clear(model, folder) bind(c, name="nhbm_clear") result(status)
      type(c_ptr), value :: model, folder
      type(handle_t), pointer :: handle

      status = begin_call(model, "nhbm_clear", handle, texts=[folder])
      if (status /= c_status%success) return
      call handle%session%clear(c_text(folder))
      call release_handle(model)
   end function nhbm_clear

   integer(c_int) function nhbm_add_group(model, name, group) bind(c, name="nhbm_add_group") result(status)
      type(c_ptr), value :: model, name, group
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error
      integer(c_int), pointer :: found

      status = begin_call(model, "nhbm_add_group", handle, texts=[name, group])
      if (status /= c_status%success) return
      call c_f_pointer(group, found)
      call handle%session%add_group(c_text(name), found, error)
      status = end_group_call(model, "nhbm_add_group", error)
   end function nhbm_add_group

   integer(c_int) function nhbm_find_group(model, path, group) bind(c, name="nhbm_find_group") result(status)
      type(c_ptr), value :: model, path, group
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error
      integer(c_int), pointer :: found

      status = begin_call(model, "nhbm_find_group", handle, texts=[path, group], needs_input=.true.)
      if (status /= c_status%success) return
      call c_f_pointer(group, found)
      call handle%session%locate(c_text(path), found, error)
      status = end_call(model, error, c_status%invalid_input)
   end function nhbm_find_group

   integer(c_int) function nhbm_remove_group(model, group) bind(c, name="nhbm_remove_group") result(status)
      type(c_ptr), value :: model
      integer(c_int), value :: group
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      status = begin_call(model, "nhbm_remove_group", handle)
      if (status /= c_status%success) return
      call handle%session%remove_group(int(group), error)
      status = end_group_call(model, "nhbm_remove_group", error)
   end function nhbm_remove_group

   integer(c_int) function nhbm_set_real(model, group, key, value) bind(c, name="nhbm_set_real") result(status)
      type(c_ptr), value :: model, key
      integer(c_int), value :: group
      real(c_double), value, target :: value

      status = set_values(model, "nhbm_set_real", group, key, 1_c_size_t, c_loc(value), kind_of%number)
   end function nhbm_set_real

   integer(c_int) function nhbm_set_text(model, group, key, text) bind(c, name="nhbm_set_text") result(status)
      type(c_ptr), value :: model, key
      integer(c_int), value :: group
      type(c_ptr), value, target :: text

      status = set_values(model, "nhbm_set_text", group, key, 1_c_size_t, c_loc(text), kind_of%word)
   end function nhbm_set_text

   integer(c_int) function nhbm_set_reals(model, group, key, n, values) bind(c, name="nhbm_set_reals") result(status)
      type(c_ptr), value :: model, key, values
      integer(c_int), value :: group
      integer(c_size_t), value :: n

      status = set_values(model, "nhbm_set_reals", group, key, n, values, kind_of%number)
   end function nhbm_set_reals

   integer(c_int) function nhbm_set_integers(model, group, key, n, values) bind(c, name="nhbm_set_integers") result(status)
      type(c_ptr), value :: model, key, values
      integer(c_int), value :: group
      integer(c_size_t), value :: n

      status = set_values(model, "nhbm_set_integers", group, key, n, values, kind_of%whole)
   end function nhbm_set_integers

   integer(c_int) function nhbm_set_logicals(model, group, key, n, values) bind(c, name="nhbm_set_logicals") result(status)
      type(c_ptr), value :: model, key, values
      integer(c_int), value :: group
      integer(c_size_t), value :: n

      status = set_values(model, "nhbm_set_logicals", group, key, n, values, kind_of%truth)
   end function nhbm_set_logicals

   integer(c_int) function nhbm_set_texts(model, group, key, n, values) bind(c, name="nhbm_set_texts") result(status)
      type(c_ptr), value :: model, key, values
      integer(c_int), value :: group
      integer(c_size_t), value :: n

      status = set_values(model, "nhbm_set_texts", group, key, n, values, kind_of%word)
   end function nhbm_set_texts

   !> Sets a key of a group to values of a kind, for all functions above.
   integer(c_int) function set_values(model, name, group, key, n, values, kind) result(status)
      type(c_ptr), intent(in) :: model, key, values
      character(*), intent(in) :: name                                !! of the function
      integer(c_int), intent(in) :: group
      integer(c_size_t), intent(in) :: n
      integer, intent(in) :: kind                                     !! one of `kind_of`
      real(c_double), pointer :: reals(:)
      integer(c_int), pointer :: integers(:)
      type(c_ptr), pointer :: texts(:)
      type(string_t), allocatable :: words(:)
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error
      integer :: i

      status = begin_call(model, name, handle, texts=[key, values])
      if (status /= c_status%success) return
      if (n < 0 .or. n > int(huge(1), c_size_t)) then                 ! size_t has no sign
         call fail(error, "n must be at most 2147483647")
      else if (kind == kind_of%number) then
         call c_f_pointer(values, reals, [n])
         call handle%session%set(int(group), c_text(key), reals, error)
      else if (kind == kind_of%word) then
         call c_f_pointer(values, texts, [n])
         if (any_null(texts)) call fail(error, "a text is NULL")
         allocate (words(merge(0, size(texts), allocated(error))))
         do i = 1, size(words)
            words(i)%value = c_text(texts(i))
         end do
         if (.not. allocated(error)) call handle%session%set(int(group), c_text(key), words, error)
      else
         call c_f_pointer(values, integers, [n])
         if (kind == kind_of%whole) call handle%session%set(int(group), c_text(key), integers, error)
         if (kind == kind_of%truth) call handle%session%set(int(group), c_text(key), integers /= 0_c_int, error)
      end if
      status = end_group_call(model, name, error)
   end function set_values

   integer(c_int) function nhbm_check_group(model, group) bind(c, name="nhbm_check_group") result(status)
      type(c_ptr), value :: model
      integer(c_int), value :: group
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      status = begin_call(model, "nhbm_check_group", handle, needs_input=.true.)
      if (status /= c_status%success) return
      call handle%session%check_group(int(group), error)
      status = end_call(model, error, c_status%invalid_input)
   end function nhbm_check_group

   integer(c_int) function nhbm_check(model) bind(c, name="nhbm_check") result(status)
      type(c_ptr), value :: model
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      status = begin_call(model, "nhbm_check", handle, needs_input=.true.)
      if (status /= c_status%success) return
      call handle%session%update(error)
      status = end_call(model, error, c_status%invalid_input)
   end function nhbm_check

   !> Releases the model. An error is that of an argument; it gets the name of the function.
   integer(c_int) function end_group_call(model, name, error) result(status)
      type(c_ptr), intent(in) :: model
      character(*), intent(in) :: name
      type(error_t), allocatable, intent(inout) :: error

      if (allocated(error)) error%message = name//": "//error%message
      status = end_call(model, error, c_status%invalid_argument)
   end function end_group_call

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
