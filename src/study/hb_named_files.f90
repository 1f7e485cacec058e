!> Comparison of the files that inputs name, as listed with their checksums: a model and a library are the same in another folder.
module hb_named_files
   implicit none
   private
   public :: are_same_files

contains

   !> Whether two lists of files (`system_t%list_files`) have the same names, folders aside, and checksums.
   pure logical function are_same_files(a, b)
      character(*), intent(in) :: a, b

      are_same_files = without_folders(a) == without_folders(b)
   end function are_same_files

   !> A text without what precedes the last slash of each name; a name begins at a quote, a line or a colon with its blank.
   pure function without_folders(text) result(short)
      character(*), intent(in) :: text
      character(len(text)) :: short
      integer :: begins, i, n

      short = ""
      n = 0
      begins = 0
      do i = 1, len(text)
         if (text(i:i) == "/") then
            short(begins + 1:) = ""
            n = begins
            cycle
         end if
         n = n + 1
         short(n:n) = text(i:i)
         if (any(text(i:i) == ["'", new_line("a")]) .or. text(max(1, i - 1):i) == ": ") begins = n
      end do
   end function without_folders
end module hb_named_files
