!> Calls of the operating system: file names and locks, the process number, time, terminals.
!> Source of the interfaces: POSIX.1-2017, hb_files.h.
module hb_operating_system
   use, intrinsic :: iso_c_binding, only: c_char, c_int, c_loc, c_long, c_long_long, &
      c_null_char, c_null_ptr, c_ptr, c_size_t
   use hb_error, only: error_t, fail
   use hb_text, only: string_t
   implicit none
   private
   public :: beside, check_held, exists, file_kind, finish_file, folder_of, follow_links, has_space, held_file_t, hold_file, &
      is_same_file, is_terminal, kind_of_file, library_path, link_file, lock_file, process_id, remove_file, rename_file, &
      replace_process, sync_file, unlock_file, utc_now

   !> Kinds of file names; links are followed.
   type :: file_kind_t
      integer :: none = 0
      integer :: regular = 1                           !! with at least one byte
      integer :: empty = 2                             !! also regular
      integer :: folder = 3
      integer :: device_or_pipe = 4                    !! or a socket
      integer :: lost_link = 5                         !! to a missing file
   end type file_kind_t

   type(file_kind_t), parameter :: file_kind = file_kind_t()
   integer, parameter, private :: longest = 4096                       ! path

   !> A file that this process locks or monitors.
   type :: held_file_t
      integer :: descriptor = -1
      integer(c_long_long), private :: n_bytes = 0     ! at the beginning
   end type held_file_t

   abstract interface
      integer(c_int) function call_with_path(path) bind(c)
         import :: c_char, c_int
         character(c_char), intent(in) :: path(*)
      end function call_with_path

      integer(c_int) function call_with_paths(one, other) bind(c)
         import :: c_char, c_int
         character(c_char), intent(in) :: one(*), other(*)
      end function call_with_paths

      integer(c_int) function text_of_path(path, text, n_bytes) bind(c)
         import :: c_char, c_int
         character(c_char), intent(in) :: path(*)
         character(c_char), intent(out) :: text(*)
         integer(c_int), value :: n_bytes
      end function text_of_path

      subroutine call_with_descriptor(descriptor) bind(c)
         import :: c_int
         integer(c_int), value :: descriptor
      end subroutine call_with_descriptor
   end interface

   procedure(call_with_paths), bind(c, name="link") :: c_link
   procedure(call_with_paths), bind(c, name="rename") :: c_rename
   procedure(call_with_path), bind(c, name="unlink") :: c_unlink
   procedure(call_with_path), bind(c, name="hb_kind_of_file") :: hb_kind_of_file
   procedure(call_with_paths), bind(c, name="hb_is_same_file") :: hb_is_same_file
   procedure(text_of_path), bind(c, name="hb_read_link") :: hb_read_link
   procedure(text_of_path), bind(c, name="hb_full_folder") :: hb_full_folder
   procedure(call_with_path), bind(c, name="hb_lock_file") :: hb_lock_file
   procedure(call_with_path), bind(c, name="hb_sync_file") :: hb_sync_file
   procedure(call_with_descriptor), bind(c, name="hb_finish_file") :: hb_finish_file
   procedure(call_with_descriptor), bind(c, name="hb_release_file") :: hb_release_file

   interface
      !> Replaces the program of this process; returns only if this fails.
      integer(c_int) function c_execvp(file, words) bind(c, name="execvp")
         import :: c_char, c_int, c_ptr
         character(c_char), intent(in) :: file(*)
         type(c_ptr), intent(in) :: words(*)
      end function c_execvp

      integer(c_int) function c_isatty(descriptor) bind(c, name="isatty")
         import :: c_int
         integer(c_int), value :: descriptor
      end function c_isatty

      integer(c_int) function hb_hold_file(path, n_bytes) bind(c, name="hb_hold_file")
         import :: c_char, c_int, c_long_long
         character(c_char), intent(in) :: path(*)
         integer(c_long_long), intent(out) :: n_bytes
      end function hb_hold_file

      integer(c_int) function hb_state_of_file(descriptor, path, n_bytes) bind(c, name="hb_state_of_file")
         import :: c_char, c_int, c_long_long
         integer(c_int), value :: descriptor
         character(c_char), intent(in) :: path(*)
         integer(c_long_long), value :: n_bytes
      end function hb_state_of_file

      integer(c_int) function hb_check_space(descriptor, n_bytes) bind(c, name="hb_check_space")
         import :: c_int, c_long_long
         integer(c_int), value :: descriptor
         integer(c_long_long), value :: n_bytes
      end function hb_check_space

      integer(c_int) function c_getpid() bind(c, name="getpid")
         import :: c_int
      end function c_getpid

      integer(c_long) function c_time(seconds) bind(c, name="time")
         import :: c_long, c_ptr
         type(c_ptr), value :: seconds
      end function c_time

      type(c_ptr) function c_gmtime(seconds) bind(c, name="gmtime")
         import :: c_long, c_ptr
         integer(c_long), intent(in) :: seconds
      end function c_gmtime

      integer(c_size_t) function c_strftime(text, max_length, format, moment) bind(c, name="strftime")
         import :: c_char, c_ptr, c_size_t
         character(c_char), intent(out) :: text(*)
         integer(c_size_t), value :: max_length
         character(c_char), intent(in) :: format(*)
         type(c_ptr), value :: moment
      end function c_strftime
   end interface

contains

   !> Whether standard error goes to a terminal.
   logical function is_terminal()
      is_terminal = c_isatty(2_c_int) == 1
   end function is_terminal

   !> Runs another command, which is searched in PATH, in the place of this program; returns only if it cannot be started.
   subroutine replace_process(command, words)
      character(*), intent(in) :: command
      type(string_t), intent(in) :: words(:)                          !! behind the command
      integer :: i, longest
      integer(c_int) :: ignored

      longest = len(command)
      do i = 1, size(words)
         longest = max(longest, len(words(i)%value))
      end do
      block
         character(longest + 1, c_char), target :: texts(0:size(words))
         type(c_ptr) :: arguments(0:size(words) + 1)

         texts(0) = c_path(command)
         do i = 1, size(words)
            texts(i) = c_path(words(i)%value)
         end do
         do i = 0, size(words)
            arguments(i) = c_loc(texts(i))
         end do
         arguments(size(words) + 1) = c_null_ptr
         ignored = c_execvp(c_path(command), arguments)
      end block
   end subroutine replace_process

   !> Whether a file of this name exists; `folder/.` exists if the folder does.
   logical function exists(path)
      character(*), intent(in) :: path

      inquire (file=path, exist=exists)
   end function exists

   !> Returns the kind of a file name, one of `file_kind`.
   integer function kind_of_file(path)
      character(*), intent(in) :: path

      kind_of_file = int(hb_kind_of_file(c_path(path)))
   end function kind_of_file

   !> Whether both names refer to the same file.
   logical function is_same_file(one, other)
      character(*), intent(in) :: one, other

      is_same_file = hb_is_same_file(c_path(one), c_path(other)) /= 0
   end function is_same_file

   !> Returns the target of a link, whether it exists or not; other names unchanged.
   subroutine follow_links(path, file)
      character(*), intent(in) :: path
      character(:), allocatable, intent(out) :: file
      integer, parameter :: max_links = 40
      character(longest, c_char) :: words
      integer :: i, length

      file = path
      do i = 1, max_links
         length = int(hb_read_link(c_path(file), words, int(longest, c_int)))
         if (length < 1) return
         if (words(1:1) == "/") then
            file = words(:length)
         else
            file = file(:index(file, "/", back=.true.))//words(:length)
         end if
      end do
   end subroutine follow_links

   !> Gives a file a second name; unlike `rename_file` it fails if the name is taken.
   subroutine link_file(old, new, ok)
      character(*), intent(in) :: old, new
      logical, intent(out) :: ok

      ok = c_link(c_path(old), c_path(new)) == 0
   end subroutine link_file

   !> Renames a file and replaces an existing one of the new name.
   subroutine rename_file(old, new, ok)
      character(*), intent(in) :: old, new
      logical, intent(out) :: ok

      ok = c_rename(c_path(old), c_path(new)) == 0
   end subroutine rename_file

   !> Removes one name of a file; does nothing if there is none.
   subroutine remove_file(path)
      character(*), intent(in) :: path
      integer(c_int) :: ignored

      ignored = c_unlink(c_path(path))
   end subroutine remove_file

   !> Creates a file if necessary, and locks it for this process until `unlock_file` or the end of the process.
   subroutine lock_file(path, descriptor, error)
      character(*), intent(in) :: path
      integer, intent(out) :: descriptor               !! for `unlock_file`
      type(error_t), allocatable, intent(out) :: error

      descriptor = int(hb_lock_file(c_path(path)))
      select case (descriptor)
      case (0:); return
      case (-2); call fail(error, "another run is making it at this moment; give another --output")
      case (-3); call fail(error, "'"//path//"' is not a regular file; remove it or give another --output")
      case (-4); call fail(error, "'"//path//"' was not written by a run; move it or give another --output")
      case default
         call fail(error, "it cannot be made; check the permission of its folder or give another --output")
      end select
   end subroutine lock_file

   !> Opens a file that is being written, to monitor it, and locks it if that does not conflict with parallel HDF5;
   !> fails if another process has the lock.
   subroutine hold_file(path, held, error)
      character(*), intent(in) :: path
      type(held_file_t), intent(out) :: held           !! for `check_held` and `unlock_file`
      type(error_t), allocatable, intent(out) :: error

      held%descriptor = int(hb_hold_file(c_path(path), held%n_bytes))
      if (held%descriptor == -2) call fail(error, "another run is writing to it at this moment")
   end subroutine hold_file

   !> Fails if the file was deleted, replaced or truncated since `hold_file`.
   subroutine check_held(held, path, error)
      type(held_file_t), intent(in) :: held
      character(*), intent(in) :: path
      type(error_t), allocatable, intent(out) :: error

      select case (hb_state_of_file(int(held%descriptor, c_int), c_path(path), held%n_bytes))
      case (1); call fail(error, "was deleted while the run wrote to it; its results are lost")
      case (2); call fail(error, "was moved while the run wrote to it; its results are not under this name")
      case (3); call fail(error, "was cut off while the run wrote to it; results are lost")
      case (4); call fail(error, "was replaced by another file while the run wrote to it; its results are not in it")
      end select
   end subroutine check_held

   !> Whether a file can grow to `n_bytes`; also true if the system cannot determine it.
   logical function has_space(descriptor, n_bytes)
      integer, intent(in) :: descriptor                !! of `lock_file`; the file is empty, before and after
      integer(c_long_long), intent(in) :: n_bytes

      has_space = hb_check_space(int(descriptor, c_int), n_bytes) == 0
   end function has_space

   !> Marks a file as complete: from now on it is no longer treated as a leftover of a killed run.
   subroutine finish_file(descriptor)
      integer, intent(in) :: descriptor                !! of `lock_file`

      call hb_finish_file(int(descriptor, c_int))
   end subroutine finish_file

   !> Releases a lock.
   subroutine unlock_file(descriptor)
      integer, intent(in) :: descriptor

      call hb_release_file(int(descriptor, c_int))
   end subroutine unlock_file

   !> Writes all data of a file to the disk.
   subroutine sync_file(path, ok)
      character(*), intent(in) :: path
      logical, intent(out) :: ok

      ok = hb_sync_file(c_path(path)) == 0
   end subroutine sync_file

   !> Returns the absolute path of the folder of a file, with a slash and padded with blanks; empty if there is none.
   function folder_of(path) result(folder)
      character(*), intent(in) :: path                                !! of the file
      character(longest) :: folder
      character(longest, c_char) :: words
      integer :: length

      folder = ""
      length = int(hb_full_folder(c_path(path(:index(path, "/", back=.true.))//"."), words, int(longest, c_int)))
      if (length == 1) folder = "/"
      if (length > 1) folder = words(:length)//"/"
   end function folder_of

   !> Returns the number of this process.
   integer function process_id()
      process_id = int(c_getpid())
   end function process_id

   !> Returns the present time in UTC, ISO 8601.
   function utc_now() result(text)
      character(20) :: text
      character(21, c_char) :: bytes
      integer(c_size_t) :: length

      length = c_strftime(bytes, len(bytes, c_size_t), "%Y-%m-%dT%H:%M:%SZ"//c_null_char, &
                          c_gmtime(c_time(c_null_ptr)))
      text = bytes(:length)
   end function utc_now

   pure function c_path(path)
      character(*), intent(in) :: path
      character(len(path) + 1) :: c_path

      c_path = path//c_null_char
   end function c_path

   !> Path of a file named in an input, padded with blanks: beside the input file if it exists there, otherwise as
   !> given.
   function beside(input, name) result(path)
      character(*), intent(in) :: input                               !! path of the input file
      character(*), intent(in) :: name                                !! as in the input
      character(len(input) + len(name) + 2) :: path
      logical :: exists

      path = name
      if (index(name, "/") == 1) return
      path = input(:index(input, "/", back=.true.))//name
      if (index(path, "/") == 0) path = "./"//name
      inquire (file=path, exist=exists)
      if (.not. exists) path = name
   end function beside

   !> Path of a shared library named in an input, padded with blanks. Code is never loaded from the current folder of
   !> the program: a library that is not beside the input is passed to the loader by name alone, which searches the
   !> system folders.
   function library_path(input, name) result(path)
      character(*), intent(in) :: input                               !! path of the input file
      character(*), intent(in) :: name                                !! as in the input
      character(len(input) + len(name) + 2) :: path

      path = beside(input, name)
      if (index(name, "/") <= 1 .or. path /= name) return
      path = input(:index(input, "/", back=.true.))//name
   end function library_path
end module hb_operating_system
