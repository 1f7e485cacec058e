!> Files besides the input on which a model depends.
module hb_model_files
   use hb_model, only: model_t
   implicit none
   private
   public :: list_model_files

contains

   !> Lists these files with their checksums, one per line: libraries of user laws, the model, its stored reduction.
   subroutine list_model_files(model, text)
      type(model_t), intent(in) :: model
      character(:), allocatable, intent(out) :: text
      character(:), allocatable :: fingerprint
      integer :: i

      text = ""
      do i = 1, size(model%laws)
         fingerprint = trim(model%laws(i)%law%fingerprint())
         if (len(fingerprint) == 0) cycle
         if (len(text) > 0) text = text//new_line("a")
         text = text//model%laws(i)%law%label//": "//fingerprint
      end do
      if (.not. allocated(model%structure%origin)) return
      if (len(text) > 0) text = text//new_line("a")
      text = text//model%structure%origin
   end subroutine list_model_files
end module hb_model_files
