!> Paths of the files that an input names.
module hb_path
   implicit none
   private
   public :: beside, library_place

contains

   !> Path of a file that an input names, with blanks behind it: beside the input file if there is one of the name, else as it is.
   function beside(input, name) result(path)
      character(*), intent(in) :: input                               !! path of the input file
      character(*), intent(in) :: name                                !! as the input has it
      character(len(input) + len(name) + 2) :: path
      logical :: exists

      path = name
      if (index(name, "/") == 1) return
      path = input(:index(input, "/", back=.true.))//name
      if (index(path, "/") == 0) path = "./"//name
      inquire (file=path, exist=exists)
      if (.not. exists) path = name
   end function beside

   !> Path of a shared library that an input names, with blanks behind it. Code is never taken from the folder that the program happens to run in: what is
   !> not beside the input is left to the loader as a name alone, which it looks for where the system keeps libraries.
   function library_place(input, name) result(path)
      character(*), intent(in) :: input                               !! path of the input file
      character(*), intent(in) :: name                                !! as the input has it
      character(len(input) + len(name) + 2) :: path

      path = beside(input, name)
      if (index(name, "/") <= 1 .or. path /= name) return
      path = input(:index(input, "/", back=.true.))//name
   end function library_place
end module hb_path
