!> The command line of nhbm.
module arguments
   use hb_error, only: error_t, fail
   use hb_text, only: closest_word, join, parse_integer, string_t
   implicit none
   private
   public :: argument_list, arguments_t, read_arguments

   character(11), parameter :: options(8) = [character(11) :: &
      "--help", "-h", "--output", "-o", "--overwrite", "--point", "--set", "--quiet"]

   type :: arguments_t
      character(:), allocatable :: verb
      character(:), allocatable :: input                              !! path of the input file
      character(:), allocatable :: output                             !! path of the result file
      type(string_t), allocatable :: overrides(:)                     !! path=value
      integer :: point = -1                                           !! number of a point of the sweep, from 0; -1: not given
      logical :: overwrite = .false.
      logical :: is_quiet = .false.
      logical :: wants_help = .false.
   end type arguments_t

contains

   !> The words of the command line.
   function argument_list() result(words)
      type(string_t), allocatable :: words(:)
      integer :: i, length

      allocate (words(command_argument_count()))
      do i = 1, size(words)
         call get_command_argument(i, length=length)
         allocate (character(length) :: words(i)%value)
         call get_command_argument(i, words(i)%value)
      end do
   end function argument_list

   !> Sorts the words into verb, options and input file; the result file is by default named after the input.
   subroutine read_arguments(self, words, error)
      type(arguments_t), intent(out) :: self
      type(string_t), intent(in) :: words(:)
      type(error_t), allocatable, intent(out) :: error
      character(:), allocatable :: closest
      logical :: is_number
      integer :: i

      allocate (self%overrides(0))
      i = 1
      do while (i <= size(words))
         associate (word => words(i)%value)
            select case (word)
            case ("--help", "-h")
               self%wants_help = .true.
            case ("--overwrite")
               self%overwrite = .true.
            case ("--quiet")
               self%is_quiet = .true.
            case ("--output", "-o", "--point", "--set")
               i = i + 1
               if (value_length(words, i) == 0) then
                  call fail(error, word//" needs a value")
                  return
               end if
               select case (word)
               case ("--set")
                  self%overrides = [self%overrides, words(i)]
               case ("--point")
                  call parse_integer(words(i)%value, self%point, is_number)
                  if (.not. is_number .or. self%point < 0) then
                     call fail(error, "--point needs a number from 0 on, not '"//words(i)%value//"'")
                     return
                  end if
               case default
                  self%output = words(i)%value
               end select
            case default
               if (index(word, "-") == 1) then
                  closest = closest_word(word, options)
                  if (len(closest) > 0) closest = " did you mean '"//closest//"'?"
                  call fail(error, "unknown option '"//word//"';"//closest//" known: "//join(options, ", "))
                  return
               else if (.not. allocated(self%verb)) then
                  self%verb = word
               else if (.not. allocated(self%input)) then
                  self%input = word
               else
                  call fail(error, "unexpected argument '"//word//"'; the input file is '"//self%input//"'")
                  return
               end if
            end select
         end associate
         i = i + 1
      end do
      if (allocated(self%input) .and. .not. allocated(self%output)) self%output = default_output(self%input)
   end subroutine read_arguments

   !> Length of word i, 0 where there is none.
   pure integer function value_length(words, i)
      type(string_t), intent(in) :: words(:)
      integer, intent(in) :: i

      value_length = 0
      if (i <= size(words)) value_length = len(words(i)%value)
   end function value_length

   !> The name of the input without its folder, ending in .h5: results go to the current folder.
   pure function default_output(input) result(path)
      character(*), intent(in) :: input
      character(:), allocatable :: path
      integer :: dot

      path = input(index(input, "/", back=.true.) + 1:)
      dot = index(path, ".", back=.true.)
      if (dot > 1) path = path(:dot - 1)
      path = path//".h5"
   end function default_output
end module arguments
