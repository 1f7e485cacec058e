!> `nhbm keys`: the table of input keys as rows, or as JSON for programs.
module key_table
   use console, only: say
   use hb_error, only: error_t, fail
   use hb_key_rows, only: key_row, n_key_rows
   use hb_similar_word, only: closest_word
   use hb_text, only: lower, string_t
   implicit none
   private
   public :: print_keys

   character(*), parameter :: separator = " | "
   character(*), parameter :: columns(7) = [character(7) :: "section", "key", "type", "unit", "default", "range", "meaning"]

contains

   !> Prints the rows of the table, or those that contain a word in any case.
   subroutine print_keys(word, is_json, error)
      character(*), intent(in) :: word                                !! '': all rows
      logical, intent(in) :: is_json                                  !! as an array of objects
      type(error_t), allocatable, intent(out) :: error
      integer :: i
      logical :: is_reported

      is_reported = .false.
      do i = 1, n_key_rows()
         if (index(lower(key_row(i)), lower(word)) == 0) cycle
         if (.not. is_json) then
            call say(trim(key_row(i)))
         else if (is_reported) then
            call say(", "//json_object(trim(key_row(i))))
         else
            call say("[ "//json_object(trim(key_row(i))))
         end if
         is_reported = .true.
      end do
      if (.not. is_reported) then
         call fail(error, "no row contains '"//word//"';"//suggestion(word)//" nhbm keys prints all")
      else if (is_json) then
         call say("]")
      end if
   end subroutine print_keys

   !> The key or section that was probably meant; empty if none is close.
   function suggestion(word) result(text)
      character(*), intent(in) :: word
      character(:), allocatable :: text
      type(string_t) :: known(2*n_key_rows())
      character(:), allocatable :: row
      integer :: i, first

      do i = 1, n_key_rows()
         row = key_row(i)
         first = index(row, separator)
         known(2*i - 1)%value = row(:first - 1)
         row = row(first + len(separator):)
         known(2*i)%value = row(:index(row, separator) - 1)
      end do
      text = closest_word(word, known)
      if (text /= "") text = " did you mean '"//text//"'?"
   end function suggestion

   !> A row as an object with a text for each column.
   pure function json_object(row) result(object)
      character(*), intent(in) :: row                                 !! of the table, without blanks behind it
      character(:), allocatable :: object
      integer :: first, i, next

      object = "{"
      first = 1
      do i = 1, size(columns)
         next = 0
         if (i < size(columns)) next = index(row(first:), separator)
         if (i > 1) object = object//", "
         object = object//json_text(trim(columns(i)))//": "
         if (next > 0) then
            object = object//json_text(row(first:first + next - 2))
            first = first + next - 1 + len(separator)
         else
            object = object//json_text(row(first:))
            first = len(row) + 1
         end if
      end do
      object = object//"}"
   end function json_object

   !> A text in quotes; UTF-8 is kept.
   pure function json_text(text) result(quoted)
      character(*), intent(in) :: text
      character(:), allocatable :: quoted
      integer :: i

      quoted = '"'
      do i = 1, len(text)
         if (text(i:i) == '"' .or. text(i:i) == "\") quoted = quoted//"\"
         quoted = quoted//text(i:i)
      end do
      quoted = quoted//'"'
   end function json_text
end module key_table
