!> Files besides the input on which a model depends.
module hb_model_files
   use hb_system, only: system_t
   implicit none
   private
   public :: list_model_files

contains

   !> Lists these files with their checksums, one per line: libraries of user laws, the model, its stored reduction.
   subroutine list_model_files(system, text)
      type(system_t), intent(in) :: system
      character(:), allocatable, intent(out) :: text
      character(:), allocatable :: fingerprint
      integer :: i

      text = ""
      do i = 1, size(system%laws)
         fingerprint = trim(system%laws(i)%law%fingerprint())
         if (len(fingerprint) == 0) cycle
         if (len(text) > 0) text = text//new_line("a")
         text = text//system%laws(i)%law%label//": "//fingerprint
      end do
      if (.not. allocated(system%structure%origin)) return
      if (len(text) > 0) text = text//new_line("a")
      text = text//system%structure%origin
   end subroutine list_model_files
end module hb_model_files
