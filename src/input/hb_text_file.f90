!> Text files, read as a whole.
module hb_text_file
   use hb_error, only: error_t, fail
   use hb_kinds, only: int64
   use hb_text, only: to_text
   implicit none
   private
   public :: read_text_file

   integer, parameter :: max_file_bytes = 16*1024**2

contains

   !> Reads a whole file byte by byte; fails if it is not a readable regular file of at most 16 MiB.
   subroutine read_text_file(path, text, error)
      character(*), intent(in) :: path
      character(:), allocatable, intent(out) :: text
      type(error_t), allocatable, intent(out) :: error
      character(256) :: reason
      integer(int64) :: n_bytes
      integer :: iostat, unit
      logical :: exists

      if (len_trim(path) == 0) then
         call fail(error, "the name of the file to read is empty")
         return
      end if
      inquire (file=path, exist=exists)
      if (.not. exists) then
         call fail(error, "file '"//trim(path)//"' does not exist")
         return
      end if
      reason = ""
      open (newunit=unit, file=path, access="stream", form="unformatted", action="read", status="old", &
            iostat=iostat, iomsg=reason)
      if (iostat /= 0) then
         call fail(error, "file '"//trim(path)//"' cannot be opened: "//trim(reason))
         return
      end if
      inquire (unit=unit, size=n_bytes)
      if (n_bytes < 0) then
         call fail(error, "'"//trim(path)//"' is not a regular file")
      else if (n_bytes > max_file_bytes) then
         call fail(error, "file '"//trim(path)//"' has "//to_text(n_bytes)//" bytes; at most "// &
                   to_text(max_file_bytes)//" (16 MiB) are read")
      else
         allocate (character(n_bytes) :: text)
         if (n_bytes > 0) read (unit, iostat=iostat, iomsg=reason) text
         if (iostat /= 0) call fail(error, "file '"//trim(path)//"' cannot be read: "//trim(reason))
      end if
      close (unit, iostat=iostat)
      if (allocated(error) .and. allocated(text)) deallocate (text)
   end subroutine read_text_file
end module hb_text_file
