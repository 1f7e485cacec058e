!> Comparison of the files that inputs name, as listed with their checksums: a model and a library are the same in another folder.
module hb_named_files
   use hb_checksum, only: file_fingerprint
   use hb_document, only: document_t
   use hb_error, only: error_t, fail
   use hb_operating_system, only: file_kind, kind_of_file, library_path
   use hb_properties, only: properties_t
   implicit none
   private
   public :: are_same_files, reject_other_libraries

contains

   !> Whether two lists of files (`system_t%list_files`) have the same names, folders aside, and checksums.
   pure logical function are_same_files(a, b)
      character(*), intent(in) :: a, b

      are_same_files = without_folders(a) == without_folders(b)
   end function are_same_files

   !> Fails if the library of a law is none of those that a result file lists. It is not loaded for that: loading runs its code.
   !> What is no file is left to the loader.
   subroutine reject_other_libraries(document, files, error)
      type(document_t), intent(in) :: document                        !! the input that the file contains
      character(*), intent(in) :: files                               !! the list (`system_t%list_files`)
      type(error_t), allocatable, intent(out) :: error
      type(document_t), target :: copy                                ! whose groups have not been read yet
      type(properties_t), pointer :: group
      character(:), allocatable :: library, path
      integer :: i

      copy = document
      do i = 1, copy%count("law")
         group => copy%group("law", i)
         if (.not. group%given("library")) cycle
         call group%get("library", library)
         if (.not. allocated(library)) cycle
         path = trim(library_path(group%file_name, library))
         if (index(path, "/") == 0 .or. kind_of_file(path) /= file_kind%regular) cycle   ! without a slash: of the system
         if (index(files, trim(file_fingerprint(path))) > 0) cycle
         call fail(error, "the run had another library of a law than '"//path//"', which is not loaded; give that of the "// &
                   "run, or continue with other libraries by nhbm resume --retry"//new_line("a")//"now: "// &
                   trim(file_fingerprint(path))//new_line("a")//"in the file:"//new_line("a")//files)
         return
      end do
   end subroutine reject_other_libraries

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
