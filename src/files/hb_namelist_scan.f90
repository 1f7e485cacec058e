!> Lexical scanner of namelist files: position, errors, blanks, words, names.
module hb_namelist_scan
   implicit none
   private
   public :: blanks, line_feed, quote_marks, rest_is_empty, return, scan_t, skip_blanks, skip_comment, &
      stop_at, tab, word_last

   character(*), parameter :: tab = achar(9), line_feed = achar(10), return = achar(13)
   character(*), parameter :: blanks = " "//tab//line_feed//return
   character(*), parameter :: quote_marks = "'"//'"'
   character(*), parameter :: word_end = blanks//",/!=()&"//quote_marks

   !> Where the parser stands, and what is wrong there.
   type :: scan_t
      integer :: position = 1
      integer :: line = 1
      character(:), allocatable :: problem                  !! allocated: parsing has failed
      integer :: problem_line = 0
   end type scan_t

contains

   !> Notes what is wrong in which line; only the first counts.
   pure subroutine stop_at(scan, line, problem)
      type(scan_t), intent(inout) :: scan
      integer, intent(in) :: line
      character(*), intent(in) :: problem

      if (allocated(scan%problem)) return
      scan%problem = problem
      scan%problem_line = line
   end subroutine stop_at

   !> Position of the last character of the word that begins at `first`, first - 1 when none does.
   pure integer function word_last(text, first) result(last)
      character(*), intent(in) :: text
      integer, intent(in) :: first

      last = first - 1
      do while (last < len(text))
         if (index(word_end, text(last + 1:last + 1)) > 0) exit
         last = last + 1
      end do
   end function word_last

   !> Moves over blanks, line ends and comments.
   pure subroutine skip_blanks(text, scan)
      character(*), intent(in) :: text
      type(scan_t), intent(inout) :: scan

      do while (scan%position <= len(text))
         if (text(scan%position:scan%position) == "!") then
            call skip_comment(text, scan)
            cycle
         end if
         if (index(blanks, text(scan%position:scan%position)) == 0) exit
         if (text(scan%position:scan%position) == line_feed) scan%line = scan%line + 1
         scan%position = scan%position + 1
      end do
   end subroutine skip_blanks

   !> Moves to the end of the line.
   pure subroutine skip_comment(text, scan)
      character(*), intent(in) :: text
      type(scan_t), intent(inout) :: scan

      do while (scan%position <= len(text))
         if (text(scan%position:scan%position) == line_feed) exit
         scan%position = scan%position + 1
      end do
   end subroutine skip_comment

   !> Whether nothing but blanks and a comment follows in the line from `first` on.
   pure logical function rest_is_empty(text, first)
      character(*), intent(in) :: text
      integer, intent(in) :: first
      integer :: i

      rest_is_empty = .true.
      do i = first, len(text)
         if (index(line_feed//"!", text(i:i)) > 0) return
         if (index(blanks, text(i:i)) == 0) then
            rest_is_empty = .false.
            return
         end if
      end do
   end function rest_is_empty
end module hb_namelist_scan
