!> A signal handler around calls of libraries that crash or loop on damaged files, such as HDF5 and the loader of shared
!> libraries: the process ends, since its memory may be corrupt, but with a message and the exit status of bad input.
module hb_crash_handler
   use, intrinsic :: iso_c_binding, only: c_char, c_double, c_int, c_null_char, c_size_t
   use hb_kinds, only: int64, wp
   use hb_outside_code, only: set_outside_code_callbacks
   use hb_printable, only: printable
   implicit none
   private
   public :: install_crash_handler, install_file_handler, protect_outside_code, record_entry, remove_crash_handler

   integer(c_int), parameter :: bad_input = 2                         ! exit status, docs/user/running.md
   integer, parameter :: max_bytes = 1000
   real(wp), parameter :: seconds_at_least = 2.0_wp                   ! for any file; most take 0.01 s
   real(wp), parameter :: bytes_per_second = 1.0e6_wp                 ! a hundredth of the usual reading speed
   real(wp), parameter :: bytes_at_least = 2.0_wp**29                 ! of memory, for any file
   real(wp), parameter :: bytes_per_byte = 4.0_wp                     ! additional memory for large files: entries and derived data

   interface
      integer(c_int) function hb_install_crash_handler(text, exit_status, seconds, bytes) bind(c, name="hb_install_crash_handler")
         import :: c_char, c_double, c_int
         character(c_char), intent(in) :: text(*)
         integer(c_int), value :: exit_status
         real(c_double), value :: seconds, bytes
      end function hb_install_crash_handler

      subroutine hb_record_entry(entry, n_bytes) bind(c, name="hb_record_entry")
         import :: c_char, c_size_t
         character(c_char), intent(in) :: entry(*)
         integer(c_size_t), value :: n_bytes
      end subroutine hb_record_entry

      subroutine hb_remove_crash_handler() bind(c, name="hb_remove_crash_handler")
      end subroutine hb_remove_crash_handler
   end interface

contains

   !> From now on a signal such as SIGSEGV or SIGBUS makes the process write `text`, cut to 1000 bytes, and end. If
   !> the system does not support this, the signal has its default effect.
   subroutine install_crash_handler(text, seconds, bytes)
      character(*), intent(in) :: text                                !! information for the user; `nhbm: ` is prepended
      real(wp), intent(in), optional :: seconds !! processor time after which the process also ends; default: no limit
      real(wp), intent(in), optional :: bytes !! memory that may be allocated until the handler is removed; default: no limit
      character(:), allocatable :: words
      integer(c_int) :: ignored
      real(c_double) :: limits(2)

      limits = 0.0_c_double
      if (present(seconds)) limits(1) = seconds
      if (present(bytes)) limits(2) = bytes
      words = printable(text(:min(len(text), max_bytes)))
      ignored = hb_install_crash_handler("nhbm: "//words(:min(len(words), max_bytes))//c_null_char, bad_input, limits(1), limits(2))
   end subroutine install_crash_handler

   !> Protects calls of user libraries and their loader from now on.
   subroutine protect_outside_code()
      call set_outside_code_callbacks(install_with_text, remove_crash_handler)
   end subroutine protect_outside_code

   subroutine install_with_text(text)
      character(*), intent(in) :: text

      call install_crash_handler(text)
   end subroutine install_with_text

   !> Installs the handler for an HDF5 file that this process reads by itself, with limits of time and memory by its
   !> size.
   subroutine install_file_handler(path, text)
      character(*), intent(in) :: path
      character(*), intent(in), optional :: text                      !! after the path
      character(:), allocatable :: words
      integer(int64) :: size_of_file
      real(wp) :: n_bytes

      words = "HDF5 crashed on this file; it is damaged"
      if (present(text)) words = text
      inquire (file=path, size=size_of_file)
      n_bytes = real(max(size_of_file, 0_int64), wp)
      call install_crash_handler("'"//path//"': "//words, seconds_at_least + n_bytes/bytes_per_second, &
                                 bytes_at_least + bytes_per_byte*n_bytes)
   end subroutine install_file_handler

   !> Records which entry of a protected file is being read, for the message.
   subroutine record_entry(entry)
      character(*), intent(in) :: entry

      character(:), allocatable :: words

      words = printable(entry)
      call hb_record_entry(words, len(words, c_size_t))
   end subroutine record_entry

   !> Reverts `install_crash_handler`.
   subroutine remove_crash_handler()
      call hb_remove_crash_handler()
   end subroutine remove_crash_handler
end module hb_crash_handler
