!> Checks of paths: only regular files are read or replaced. The location of a result file is checked before the work; the file is
!> renamed to it when complete.
module hb_file_location
   use hb_error, only: error_t, fail
   use hb_operating_system, only: exists, file_kind, held_file_t, hold_file, kind_of_file, link_file, remove_file, rename_file, &
      unlock_file
   use hb_text, only: to_text
   implicit none
   private
   public :: check_source, check_target, give_final_name

   integer, parameter :: longest_name = 240                           ! bytes; parallel HDF5 under Open MPI aborts from 245 on

contains

   !> Fails if there is no readable file of this name.
   subroutine check_source(path, error)
      character(*), intent(in) :: path
      type(error_t), allocatable, intent(out) :: error
      integer :: kind

      kind = kind_of_file(path)
      if (kind == file_kind%none) then
         call fail(error, "file '"//path//"' does not exist")
      else if (kind == file_kind%lost_link) then
         call fail(error, "'"//path//"' is a link to a file that does not exist")
      else if (kind == file_kind%empty) then
         call fail(error, "file '"//path//"' is empty")
      else if (kind == file_kind%folder) then
         call fail(error, "'"//path//"' is a directory, not a file")
      else if (kind == file_kind%device_or_pipe) then
         call fail(error, "'"//path//"' is a pipe or a device; a regular file is needed")
      end if
   end subroutine check_source

   !> Fails if a file of this name cannot or must not be created.
   subroutine check_target(path, overwrite, error, is_own)
      character(*), intent(in) :: path
      logical, intent(in) :: overwrite
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: is_own          !! this run holds the file; default: no
      character(:), allocatable :: folder
      type(held_file_t) :: held
      integer :: kind

      folder = path(:index(path, "/", back=.true.))
      if (folder == "") folder = "./"
      kind = kind_of_file(path)
      if (kind_of_file(folder) /= file_kind%folder) then
         call fail(error, "folder '"//folder//"' does not exist; make it or give another --output")
      else if (len(path) - index(path, "/", back=.true.) > longest_name) then
         call fail(error, "its name has more than "//to_text(longest_name)//" bytes; give another --output")
      else if (len_trim(path) < len(path)) then
         call fail(error, "its name ends with a blank; give another --output")
      else if (kind == file_kind%folder) then
         call fail(error, "it is a folder; give another --output")
      else if (kind == file_kind%device_or_pipe) then
         call fail(error, "it is a pipe or a device, which is never replaced; give another --output")
      else if (kind == file_kind%lost_link) then
         call fail(error, "it is a link that leads nowhere; give another --output")
      else if (kind /= file_kind%none .and. .not. overwrite) then
         call fail(error, "it exists; give --overwrite or another --output")
      end if
      if (allocated(error) .or. kind == file_kind%none) return
      if (present(is_own)) then
         if (is_own) return
      end if
      call hold_file(path, held, error)                                ! fails while another run writes to it
      if (allocated(error)) error%message = error%message//"; give another --output"
      call unlock_file(held%descriptor)
   end subroutine check_target

   !> Gives a finished file its final name, atomically.
   subroutine give_final_name(temporary, path, overwrite, error, is_own)
      character(*), intent(in) :: temporary, path
      logical, intent(in) :: overwrite
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: is_own          !! this run holds the file; default: no
      logical :: ok

      call check_target(path, overwrite, error, is_own)               ! the name may have been taken in the meantime
      if (allocated(error)) return
      if (.not. overwrite) then
         ! another run may have created the file at this moment: link refuses then, rename would not
         call link_file(temporary, path, ok)
         if (ok) then
            call remove_file(temporary)
            return
         end if
         if (exists(path)) then
            call fail(error, "it exists; give --overwrite or another --output")
            return
         end if
         ! a file system without links: use rename
      end if
      call rename_file(temporary, path, ok)
      if (.not. ok) call fail(error, "'"//temporary//"' cannot be renamed to it; give another --output")
   end subroutine give_final_name
end module hb_file_location
