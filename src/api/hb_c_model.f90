!> A model of C, struct nhbm_model: its session, the columns and texts that are returned to C, and what all functions of
!> nhbm.h with a model have in common. Each of them begins with `begin_call`, which fails for an invalid model or one in use,
!> and ends with `end_call`.
module hb_c_model
   use, intrinsic :: iso_c_binding, only: c_associated, c_char, c_f_pointer, c_int, c_loc, c_null_char, c_null_ptr, &
      c_ptr
   use hb_c_handles, only: acquire, c_status, handle_kind, release_handle, set_last_error, status_of
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   use hb_session, only: session_t
   use hb_session_columns, only: session_columns_t, session_table_t
   implicit none
   private
   public :: address_of_integers, address_of_reals, address_of_text, any_null, begin_call, empty_text, end_call, &
      end_call_with_text, handle_t

   character(1), target, save :: empty_text = c_null_char

   !> struct nhbm_model: a session with the columns and texts passed to C.
   type :: handle_t
      class(session_t), allocatable :: session                       ! polymorphic: freed by one procedure
      type(session_columns_t) :: columns
      type(session_table_t) :: table
      integer(c_int), allocatable :: sizes(:, :)                      ! of the table
      character(c_char), allocatable :: text(:), name(:), unit(:), axes(:), long_name(:), dof_units(:), flags(:), attributes(:)
      real(wp), allocatable :: frequencies(:)
   end type handle_t

contains

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
      else if ((present(needs_input) .or. present(needs_model)) .and. .not. handle%session%input%has_groups()) then
         call fail(error, "the model has no groups; call nhbm_add_group or nhbm_read_input before")
      else if (present(needs_model) .and. .not. handle%session%source%model%is_read) then
         call fail(error, "the present values of the input are invalid; set others and compute again")
      else if (present(needs_time)) then
         if (.not. handle%session%has_time_results()) call fail(error, "there are no results of a time integration; call "// &
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

   !> Whether one of the addresses is NULL.
   logical function any_null(addresses)
      type(c_ptr), intent(in) :: addresses(:)
      integer :: i

      any_null = .false.
      do i = 1, size(addresses)
         any_null = any_null .or. .not. c_associated(addresses(i))
      end do
   end function any_null

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

   !> Address of reals of a model, valid until they are computed again.
   type(c_ptr) function address_of_reals(values) result(address)
      real(wp), allocatable, target, intent(in) :: values(:)

      address = c_loc(values)
   end function address_of_reals

   !> Address of integers of a model, likewise.
   type(c_ptr) function address_of_integers(values) result(address)
      integer, allocatable, target, intent(in) :: values(:)

      address = c_loc(values)
   end function address_of_integers
end module hb_c_model
