!> What the tests of the namelist reader share.
module namelist_steps
   use funit, only: assertEqual, assertTrue
   use hb_document, only: document_t
   use hb_error, only: error_t
   use hb_namelist, only: read_namelist
   implicit none
   private
   public :: cr, expect_error, expect_no_error, nl, read_text, tab

   character(*), parameter :: nl = new_line("a")
   character(*), parameter :: tab = achar(9), cr = achar(13)

contains

   !> Takes a text apart as the file beam.nml.
   subroutine read_text(text, document)
      character(*), intent(in) :: text
      type(document_t), intent(out) :: document
      type(error_t), allocatable :: error
      call read_namelist(document, "beam.nml", text, error)
      call expect_no_error(error)
   end subroutine read_text

   subroutine expect_no_error(error)
      type(error_t), allocatable, intent(in) :: error
      character(:), allocatable :: message
      message = ""
      if (allocated(error)) message = error%message
      call assertEqual("", message)
   end subroutine expect_no_error

   subroutine expect_error(expected, error)
      character(*), intent(in) :: expected
      type(error_t), allocatable, intent(in) :: error
      call assertTrue(allocated(error), message=expected)
      call assertEqual(expected, error%message)
   end subroutine expect_error
end module namelist_steps
