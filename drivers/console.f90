!> Output of the program. Standard output is written through the C standard library, because the Fortran library does
!> not report lost output. Titles, labels, names and options are written to a terminal without their control
!> characters.
module console
   use, intrinsic :: iso_c_binding, only: c_char, c_int, c_null_char
   use, intrinsic :: iso_fortran_env, only: error_unit
   use hb_advice, only: advice_list_t, describe_item, find_command, n_advice
   use hb_error, only: error_t, fail
   use hb_printable, only: printable
   use hb_text, only: split, string_t
   implicit none
   private
   public :: print_error, finish_output, say, say_advice, say_entry

   integer, parameter :: width = 118

   interface
      integer(c_int) function hb_finish_output() bind(c, name="hb_finish_output")
         import :: c_int
      end function hb_finish_output

      subroutine hb_say(line) bind(c, name="hb_say")
         import :: c_char
         character(c_char), intent(in) :: line(*)
      end subroutine hb_say
   end interface

   !> Writes lines to standard output.
   interface say
      module procedure print_line, print_lines
   end interface say

contains

   subroutine print_line(text)
      character(*), intent(in) :: text

      call hb_say(printable(text)//c_null_char)
   end subroutine print_line

   !> Writes lines without trailing blanks.
   subroutine print_lines(texts)
      character(*), intent(in) :: texts(:)
      integer :: i

      do i = 1, size(texts)
         call print_line(trim(texts(i)))
      end do
   end subroutine print_lines

   !> Writes the texts of a list, each behind a prefix, and the commands of its table.
   subroutine say_advice(prefix, list)
      character(*), intent(in) :: prefix
      type(advice_list_t), intent(in) :: list
      character(:), allocatable :: text
      integer :: i

      do i = 1, n_advice(list)
         call describe_item(list%items(i), text)
         call say(prefix//text)
         call find_command(list%items(i), text)
         if (len(text) > 0) call say("  try: "//text)
      end do
   end subroutine say_advice

   !> Writes a name and, from a given column on, words wrapped to the width of a page.
   subroutine say_entry(name, text, column)
      character(*), intent(in) :: name, text
      integer, intent(in) :: column                     !! of the text
      type(string_t), allocatable :: words(:)
      character(:), allocatable :: line
      integer :: i

      line = name//repeat(" ", max(0, column - 1 - len(name)))
      call split(trim(adjustl(text)), " ", words)
      do i = 1, size(words)
         if (len_trim(line) > 0 .and. len(line) + len(words(i)%value) > width) then
            call say(trim(line))
            line = repeat(" ", column - 1)
         end if
         line = line//words(i)%value//" "
      end do
      call say(trim(line))
   end subroutine say_entry

   !> Writes a message of the program to standard error.
   subroutine print_error(text)
      character(*), intent(in) :: text

      write (error_unit, "(a)") "nhbm: "//printable(text)
   end subroutine print_error

   !> Flushes all output; fails if some of it was lost. A pipe closed by its reader is not an error.
   subroutine finish_output(error)
      type(error_t), allocatable, intent(out) :: error

      if (hb_finish_output() /= 0) call fail(error, "standard output cannot be written (device full?); output is lost")
   end subroutine finish_output
end module console
