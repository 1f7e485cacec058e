!> Functions of shared libraries, found at run time by the loader of the system.
!>
!> A library stays loaded until the process ends, so that addresses stay valid in every copy of what holds them.
!> Source of the interfaces: POSIX.1-2017, dlopen, dlsym, dlerror.
module hb_dynamic_library
   use, intrinsic :: iso_c_binding, only: c_associated, c_char, c_funptr, c_int, c_null_char, c_null_ptr, c_ptr
   use hb_c_text, only: c_text
   use hb_error, only: error_t, fail
   use hb_outside_code, only: begin_outside_code, end_outside_code
   use hb_system, only: file_kind, kind_of_file
   implicit none
   private
   public :: dynamic_library_t, open_library

   type :: dynamic_library_t
      type(c_ptr), private :: handle = c_null_ptr
   contains
      procedure :: find => dynamic_library_find
   end type dynamic_library_t

   integer(c_int), parameter :: rtld_now = 2                           ! the same on Linux, BSD and macOS

   interface
      type(c_ptr) function dlopen(path, flags) bind(c, name="dlopen")
         import :: c_char, c_int, c_ptr
         character(kind=c_char), intent(in) :: path(*)
         integer(c_int), value :: flags
      end function dlopen

      type(c_funptr) function dlsym(handle, name) bind(c, name="dlsym")
         import :: c_char, c_funptr, c_ptr
         type(c_ptr), value :: handle
         character(kind=c_char), intent(in) :: name(*)
      end function dlsym

      type(c_ptr) function dlerror() bind(c, name="dlerror")
         import :: c_ptr
      end function dlerror
   end interface

contains

   !> Loads a shared library; a path with a slash is taken as it is, a name without is searched for where the system keeps
   !> libraries. Fails with the reason that the loader gives.
   subroutine open_library(self, path, error)
      type(dynamic_library_t), intent(out) :: self
      character(*), intent(in) :: path
      type(error_t), allocatable, intent(out) :: error

      if (kind_of_file(path) == file_kind%device_or_pipe) then
         call fail(error, "cannot load the library: '"//path//"' is a pipe or a device")
         return
      end if
      call begin_outside_code("'"//path//"': the loader of the system died of this library; the file is damaged")   ! e.g. cut off
      self%handle = dlopen(path//c_null_char, rtld_now)
      call end_outside_code()
      if (.not. c_associated(self%handle)) call fail(error, "cannot load the library: "//trim(last_reason(path)))
   end subroutine open_library

   !> Address of a function; fails when the library does not export it.
   subroutine dynamic_library_find(self, name, address, error)
      class(dynamic_library_t), intent(in) :: self
      character(*), intent(in) :: name
      type(c_funptr), intent(out) :: address
      type(error_t), allocatable, intent(out) :: error

      address = dlsym(self%handle, name//c_null_char)
      if (.not. c_associated(address)) call fail(error, "the library has no function '"//name//"': "//trim(last_reason(name)))
   end subroutine dynamic_library_find

   !> What the loader says about its last failure.
   function last_reason(subject) result(text)
      character(*), intent(in) :: subject                             !! told when the loader says nothing
      character(1000) :: text
      type(c_ptr) :: message

      message = dlerror()
      text = subject
      if (c_associated(message)) text = c_text(message)
   end function last_reason
end module hb_dynamic_library
