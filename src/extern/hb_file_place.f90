!> Where a file of results goes: refused before the work where that is hopeless, put in place when it is complete.
module hb_file_place
   use hb_error, only: error_t, fail
   use hb_system, only: exists, link_file, remove_file, rename_file
   implicit none
   private
   public :: check_place, put_in_place

contains

   !> Fails where a file of this name cannot or must not be made.
   subroutine check_place(path, overwrite, error)
      character(*), intent(in) :: path
      logical, intent(in) :: overwrite
      type(error_t), allocatable, intent(out) :: error
      character(:), allocatable :: folder

      folder = path(:index(path, "/", back=.true.))
      if (folder == "") folder = "./"
      if (.not. exists(folder//".")) then
         call fail(error, "folder '"//folder//"' does not exist; make it or give another --output")
      else if (exists(path//"/.")) then
         call fail(error, "is a folder; give another --output")
      else if (exists(path) .and. .not. overwrite) then
         call fail(error, "exists; give --overwrite or another --output")
      end if
   end subroutine check_place

   !> Gives a finished file its name, atomically.
   subroutine put_in_place(temporary, path, overwrite, error)
      character(*), intent(in) :: temporary, path
      logical, intent(in) :: overwrite
      type(error_t), allocatable, intent(out) :: error
      logical :: ok

      if (.not. overwrite) then
         ! another run may have made the file meanwhile: link refuses then, and rename would not
         call link_file(temporary, path, ok)
         if (ok) then
            call remove_file(temporary)
            return
         end if
         if (exists(path)) then
            call fail(error, "exists; give --overwrite or another --output")
            return
         end if
         ! a file system without links: rename after all
      end if
      call rename_file(temporary, path, ok)
      if (.not. ok) call fail(error, "'"//temporary//"' cannot be renamed to it; give another --output")
   end subroutine put_in_place
end module hb_file_place
