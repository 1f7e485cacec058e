!> Addresses that programs in C pass to nhbm: which objects exist, and whether a call is using them; the message of the last
!> error of the calling thread. Source: hb_handles.h, hb_last_error.h.
module hb_c_handles
   use, intrinsic :: iso_c_binding, only: c_associated, c_char, c_int, c_loc, c_ptr, c_size_t
   use hb_error, only: error_t
   implicit none
   private
   public :: acquire, c_status, handle_kind, last_error, register_handle, release_handle, set_last_error, status_of, &
      unregister_handle

   !> enum nhbm_status.
   type :: c_status_t
      integer(c_int) :: success = 0_c_int
      integer(c_int) :: invalid_input = -1_c_int
      integer(c_int) :: invalid_argument = -2_c_int
      integer(c_int) :: invalid_state = -3_c_int
      integer(c_int) :: busy = -4_c_int
      integer(c_int) :: out_of_memory = -5_c_int
   end type c_status_t
   type(c_status_t), parameter :: c_status = c_status_t()

   type :: handle_kind_t
      integer(c_int) :: model = 1_c_int
      integer(c_int) :: structure = 2_c_int
   end type handle_kind_t
   type(handle_kind_t), parameter :: handle_kind = handle_kind_t()

   integer(c_int), parameter :: acquired = 0_c_int, unknown = 1_c_int, busy_here = 2_c_int

   interface
      !> Registers an object. Returns 0, or 1 if memory is insufficient.
      integer(c_int) function register_handle(object, kind) bind(c, name="hb_register_handle")
         import :: c_int, c_ptr
         type(c_ptr), value :: object
         integer(c_int), value :: kind
      end function register_handle

      integer(c_int) function acquire_handle(object, kind) bind(c, name="hb_acquire_handle")
         import :: c_int, c_ptr
         type(c_ptr), value :: object
         integer(c_int), value :: kind
      end function acquire_handle

      !> Ends the use of an object.
      subroutine release_handle(object) bind(c, name="hb_release_handle")
         import :: c_ptr
         type(c_ptr), value :: object
      end subroutine release_handle

      !> Removes an object from the register, also one that the calling thread uses; waits while another thread uses it.
      subroutine unregister_handle(object) bind(c, name="hb_unregister_handle")
         import :: c_ptr
         type(c_ptr), value :: object
      end subroutine unregister_handle

      !> Message of the last error of this thread, null-terminated.
      type(c_ptr) function last_error() bind(c, name="hb_last_error")
         import :: c_ptr
      end function last_error

      subroutine set_last_error_of_c(text, length) bind(c, name="hb_set_last_error")
         import :: c_char, c_size_t
         character(kind=c_char), intent(in) :: text(*)
         integer(c_size_t), value :: length
      end subroutine set_last_error_of_c
   end interface

contains

   !> Stores the message of the last error of this thread.
   subroutine set_last_error(message)
      character(*), intent(in) :: message

      call set_last_error_of_c(message, len_trim(message, kind=c_size_t))
   end subroutine set_last_error

   !> Makes the calling function the only user of an object until `release_handle`. The status is not `success` if the object
   !> does not exist or is in use; the message is then that of the last error.
   integer(c_int) function acquire(object, kind, function_name) result(status)
      type(c_ptr), intent(in) :: object
      integer(c_int), intent(in) :: kind                              !! of `handle_kind`
      character(*), intent(in) :: function_name                       !! for messages
      character(:), allocatable :: noun
      integer(c_int) :: found

      found = acquire_handle(object, kind)
      status = c_status%success
      if (found == acquired) return
      noun = "model"
      if (kind == handle_kind%structure) noun = "structure"
      status = c_status%invalid_argument
      if (.not. c_associated(object)) then
         call set_last_error(function_name//": the "//noun//" is NULL")
      else if (found == unknown) then
         if (kind == handle_kind%model) then
            call set_last_error(function_name//": there is no model at this address; it was destroyed, or nhbm_create did not "// &
                                "create it")
         else
            call set_last_error(function_name//": there is no structure at this address; it exists until the structure "// &
                                "callback returns")
         end if
      else if (found == busy_here) then
         status = c_status%busy
         call set_last_error(function_name//": the "//noun//" is in use by the function whose callback calls this function")
      else
         status = c_status%busy
         call set_last_error(function_name//": the "//noun//" is in use by another thread")
      end if
   end function acquire

   !> The status of a call: `status` if there is an error, whose message becomes that of the last error.
   integer(c_int) function status_of(error, status)
      type(error_t), allocatable, intent(in) :: error
      integer(c_int), intent(in) :: status                            !! of an error

      status_of = c_status%success
      if (.not. allocated(error)) return
      status_of = status
      call set_last_error(error%message)
   end function status_of
end module hb_c_handles
