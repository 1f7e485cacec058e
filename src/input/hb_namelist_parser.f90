!> Grammar of namelist files: finds the groups of a text and parses their bodies into keys and values.
!>
!> A subset of Fortran's namelist input (F2018, 13.11) that refuses what is legal but nearly always a mistake: omitted
!> values, text after the closing '/', strings over several lines, lists for one element.
module hb_namelist_parser
   use hb_input_keys, only: kind_of
   use hb_kinds, only: wp
   use hb_parameter_path, only: index_help, split_index
   use hb_property_values, only: content_t, max_values, value_t
   use hb_text, only: is_name, lower, parse_integer, parse_real, shown, to_text
   implicit none
   private
   public :: blanks, carriage_return, line_feed, next_group, parse_body, scan_t, stop_at, tab

   character(*), parameter :: tab = achar(9), line_feed = achar(10), carriage_return = achar(13)
   character(*), parameter :: blanks = " "//tab//line_feed//carriage_return
   character(*), parameter :: quote_marks = "'"//'"'
   character(*), parameter :: word_end = blanks//",/!=()&"//quote_marks

   !> Position of the parser, and the error there.
   type :: scan_t
      integer :: position = 1
      integer :: line = 1
      character(:), allocatable :: problem                  !! allocated: parsing has failed
      integer :: problem_line = 0
   end type scan_t

   !> State of the parser inside a group.
   type :: body_t
      character(:), allocatable :: name                     !! of the group
      character(:), allocatable :: key                      !! the latest one
      logical :: in_key = .false.                           !! there has been a key
      logical :: after_comma = .false.
      integer :: i_key = 0                                  !! 0: values are skipped
      integer :: i = 0, j = 0                               !! element index of the key
      integer :: n_found = 0                                !! values of the key so far
      integer :: offset = 0                                 !! where the spelling begins in the text
      type(value_t) :: value                                !! the latest one
   end type body_t

contains

   !> Moves to the next group: `name` is its name in lower case, empty if there are no more; the position is after the
   !> name.
   pure subroutine next_group(text, scan, name)
      character(*), intent(in) :: text
      type(scan_t), intent(inout) :: scan
      character(:), allocatable, intent(out) :: name
      integer :: last

      name = ""
      do while (scan%position <= len(text))
         select case (text(scan%position:scan%position))
         case (line_feed)
            scan%line = scan%line + 1
         case (" ", tab, carriage_return)
            continue
         case ("!", "#", "%", "*")                                    ! a comment, also as other programs mark it
            call skip_comment(text, scan)
            cycle
         case ("/")
            call stop_at(scan, scan%line, "'/' outside of a group; was the group closed too early? a comment begins with '!'")
            return
         case ("&")
            last = word_last(text, scan%position + 1)
            name = lower(text(scan%position + 1:last))
            if (.not. is_name(name)) then
               call stop_at(scan, scan%line, &
                            "'&"//shown(name)//"' is not a group name; write it like '&newton'")
            else if (name == "end") then
               call stop_at(scan, scan%line, "'&end' outside of a group")
            else if (last < len(text)) then
               if (index(blanks//"/!", text(last + 1:last + 1)) == 0) then
                  call stop_at(scan, scan%line, &
                               "unexpected '"//text(last + 1:last + 1)//"' after '&"//name//"'")
               end if
            end if
            scan%position = last + 1
            return
         case default
            last = max(scan%position, word_last(text, scan%position))
            call stop_at(scan, scan%line, "'"//shown(text(scan%position:last))// &
                         "' outside of a group; a group begins with '&', a comment with '!'")
            return
         end select
         scan%position = scan%position + 1
      end do
   end subroutine next_group

   !> Parses the body of group `name`, from the present position to after its '/' or '&end'.
   pure subroutine parse_body(text, scan, name, content)
      character(*), intent(in) :: text
      type(scan_t), intent(inout) :: scan
      character(*), intent(in) :: name
      type(content_t), intent(out) :: content
      type(body_t) :: body
      integer :: first_line, last, start
      logical :: has_ended

      first_line = scan%line
      body%offset = scan%position - 1
      body%name = name
      body%key = ""
      has_ended = .false.
      do while (.not. has_ended)
         call skip_blanks(text, scan)
         if (scan%position > len(text)) then
            call stop_at(scan, first_line, "group &"//name//" never ends; close it with '/'")
            return
         end if
         start = scan%position
         select case (text(start:start))
         case ("/")
            call end_key(scan, body)
            scan%position = start + 1
            has_ended = .true.
         case ("&")
            last = word_last(text, start + 1)
            if (lower(text(start + 1:last)) /= "end") then
               call stop_at(scan, scan%line, "'&"//shown(text(start + 1:last))//"' inside group &"//name// &
                            " of line "//to_text(first_line)//", which is not yet closed with '/'")
            end if
            call end_key(scan, body)
            scan%position = last + 1
            has_ended = .true.
         case (",")
            call pass_comma(scan, body, name)
         case ("'", '"')
            call read_value(text, scan, body, start - 1)
            call store_value(text, scan, body, content)
         case default
            last = word_last(text, start)
            if (last < start) then
               call stop_at(scan, scan%line, "&"//name//": unexpected '"//text(start:start)//"'")
            else if (body%in_key .and. body%n_found == 0 .and. .not. body%after_comma .and. is_call(text, last)) then
               call stop_at(scan, scan%line, "&"//name//": "//body%key//" = "//shown(text(start:call_last(text, last)))// &
                            " is neither a number nor a text in quotes, '"//shown(text(start:call_last(text, last)))//"'")
            else if (is_key(text, last)) then
               call end_key(scan, body)
               call begin_key(text, scan, body, content, last)
            else
               call read_value(text, scan, body, last)
               call store_value(text, scan, body, content)
            end if
         end select
         if (allocated(scan%problem)) return
      end do
      if (rest_is_empty(text, scan%position)) then
         content%spelling = text(body%offset + 1:scan%position - 1)
      else
         call reject_rest(text, scan, name)
      end if
   end subroutine parse_body

   !> Passes a comma between the values of a key.
   pure subroutine pass_comma(scan, body, name)
      type(scan_t), intent(inout) :: scan
      type(body_t), intent(inout) :: body
      character(*), intent(in) :: name                                !! of the group

      if (.not. body%in_key) then
         call stop_at(scan, scan%line, "&"//name//": unexpected ',' where a key is expected")
      else if (body%n_found == 0 .or. body%after_comma) then
         call stop_at(scan, scan%line, "&"//name//": key '"//body%key//"' has an empty value before ','")
      end if
      body%after_comma = .true.
      scan%position = scan%position + 1
   end subroutine pass_comma

   !> Stops at what is on the line of the end of a group.
   pure subroutine reject_rest(text, scan, name)
      character(*), intent(in) :: text
      type(scan_t), intent(inout) :: scan
      character(*), intent(in) :: name                                !! of the group

      call skip_blanks(text, scan)
      if (text(scan%position:scan%position) == "&") then
         call stop_at(scan, scan%line, "a group begins on a line of its own, not behind the end of &"//name)
      else
         call stop_at(scan, scan%line, "text behind the end of group &"//name// &
                      "; a value with '/' needs quotes, a comment begins with '!'")
      end if
   end subroutine reject_rest

   !> Whether the word that ends at `last` is a key: '=' or an index follows; blanks in between are ignored.
   pure logical function is_key(text, last)
      character(*), intent(in) :: text
      integer, intent(in) :: last
      integer :: i

      is_key = .false.
      do i = last + 1, len(text)
         if (index(blanks, text(i:i)) > 0 .and. text(i:i) /= line_feed) cycle
         is_key = index("=(", text(i:i)) > 0
         return
      end do
   end function is_key

   !> Whether the word that ends at `last` is followed by something in parentheses that is no index of a key: a path without quotes,
   !> such as law(stop)%gap, or an expression.
   pure logical function is_call(text, last)
      character(*), intent(in) :: text
      integer, intent(in) :: last
      integer :: i

      is_call = .false.
      if (last >= len(text)) return
      if (text(last + 1:last + 1) /= "(") return
      do i = last + 2, len(text)
         if (text(i:i) == line_feed) return
         if (text(i:i) == ")") exit
      end do
      if (i > len(text)) return
      i = i + verify(text(i + 1:)//"x", " ")
      is_call = i > len(text)
      if (.not. is_call) is_call = text(i:i) /= "="
   end function is_call

   !> Position of the last character of such a text.
   pure integer function call_last(text, last)
      character(*), intent(in) :: text
      integer, intent(in) :: last

      call_last = last + index(text(last + 1:), ")")
      call_last = max(call_last, word_last(text, call_last + 1))
   end function call_last

   !> Checks that a key has a value before the next one begins or the group ends.
   pure subroutine end_key(scan, body)
      type(scan_t), intent(inout) :: scan
      type(body_t), intent(in) :: body

      if (body%in_key .and. body%n_found == 0) then
         call stop_at(scan, scan%line, "&"//body%name//": key '"//body%key//"' has no value")
      end if
   end subroutine end_key

   !> Reads a key, from the present position to `last`, with its index and '='.
   pure subroutine begin_key(text, scan, body, content, last)
      character(*), intent(in) :: text
      type(scan_t), intent(inout) :: scan
      type(body_t), intent(inout) :: body
      type(content_t), intent(inout) :: content
      integer, intent(in) :: last

      if (allocated(scan%problem)) return
      body%key = lower(text(scan%position:last))
      if (.not. is_name(body%key)) then
         call stop_at(scan, scan%line, "&"//body%name//": '"//shown(body%key)// &
                      "' is not a key; a key is a name like 'gap'")
         return
      end if
      body%i = 0
      body%j = 0
      scan%position = last + 1
      call skip_blanks(text, scan)
      if (text(scan%position:scan%position) == "(") then
         call read_index(text, scan, body)
         if (allocated(scan%problem)) return
         call skip_blanks(text, scan)
      end if
      if (scan%position > len(text)) then
         call stop_at(scan, scan%line, "&"//body%name//": '=' is missing after key '"//body%key//"'")
      else if (text(scan%position:scan%position) /= "=") then
         call stop_at(scan, scan%line, "&"//body%name//": '=' is missing after key '"//body%key//"'")
      end if
      scan%position = scan%position + 1
      body%in_key = .true.
      body%after_comma = .false.
      body%n_found = 0
      call content%find_or_add(body%key, body%i_key)
      associate (key => content%keys(body%i_key))
         if (key%line == 0) then
            key%line = scan%line
         else if (body%i == 0 .or. key%n_listed > 0) then
            if (key%second_line == 0) key%second_line = scan%line
            body%i_key = 0                                            ! its values are skipped
         end if
      end associate
   end subroutine begin_key

   !> Reads the index '(i)' or '(i, j)' of an element.
   pure subroutine read_index(text, scan, body)
      character(*), intent(in) :: text
      type(scan_t), intent(inout) :: scan
      type(body_t), intent(inout) :: body
      character(:), allocatable :: name
      integer, parameter :: max_shown_text = 60
      integer :: close
      logical :: ok

      close = index(text(scan%position:min(len(text), scan%position + max_shown_text)), ")")
      ok = close > 0
      if (ok) call split_index("x"//text(scan%position:scan%position + close - 1), name, body%i, body%j, ok)
      if (.not. ok) then
         call stop_at(scan, scan%line, "&"//body%name//": index of '"//body%key// &
                      "' "//index_help//to_text(max_values))
      end if
      scan%position = scan%position + close
   end subroutine read_index

   !> Reads the value at the present position: a word that ends at `last`, a string, or a repeated one of them.
   pure subroutine read_value(text, scan, body, last)
      character(*), intent(in) :: text
      type(scan_t), intent(inout) :: scan
      type(body_t), intent(inout) :: body
      integer, &
            intent(in) :: last                           !! before the present position if there is no word
      integer :: star
      logical :: is_quote_next, ok

      body%value = value_t(first=scan%position, last=last, line=scan%line, i=body%i, j=body%j)
      is_quote_next = .false.
      if (last < len(text)) is_quote_next = index(quote_marks, text(last + 1:last + 1)) > 0
      associate (value => body%value, word => text(scan%position:last))
         star = index(word, "*")
         if (star > 1) then
            if (verify(word(1:star - 1), "0123456789") == 0) then
               call parse_integer(word(1:star - 1), value%count, ok)
               if (.not. ok .or. value%count < 1 .or. value%count > max_values) then
                  call stop_at(scan, scan%line, "&"//body%name//": repeat count of '"//shown(word)// &
                               "' must be from 1 to "//to_text(max_values))
                  return
               end if
               value%first = scan%position + star
            end if
         end if
         if (is_quote_next .and. value%first > last) then
            scan%position = last + 1
            call read_string(text, scan, body)
         else if (is_quote_next) then
            call stop_at(scan, scan%line, "&"//body%name//": unexpected quote after '"//shown(word)//"'")
         else if (value%first > last) then
            call stop_at(scan, scan%line, "&"//body%name//": a value is missing after '"//shown(word)//"'")
         else
            call classify(text(value%first:last), value)
            scan%position = last + 1
         end if
      end associate
   end subroutine read_value

   !> Classifies a word without quotes: a number, a logical, or neither.
   pure subroutine classify(word, value)
      character(*), intent(in) :: word
      type(value_t), intent(inout) :: value
      integer :: whole
      logical :: ok

      call parse_integer(word, whole, ok)
      if (ok .and. (whole /= 0 .or. word(1:1) /= "-")) then ! zeros have signs
         value%kind = kind_of%whole
         value%number = real(whole, wp)
         return
      end if
      value%kind = merge(kind_of%whole, kind_of%number, ok)
      call parse_real(word, value%number, ok)
      if (ok) return
      value%kind = kind_of%truth
      select case (lower(word))
      case (".true.", "true", ".t.", "t")
         value%number = 1.0_wp
      case (".false.", "false", ".f.", "f")
         value%number = 0.0_wp
      case default
         value%kind = kind_of%none
      end select
   end subroutine classify

   !> Reads the string in quotes at the present position; it must end in the same line.
   pure subroutine read_string(text, scan, body)
      character(*), intent(in) :: text
      type(scan_t), intent(inout) :: scan
      type(body_t), intent(inout) :: body
      character(1) :: mark
      integer :: i
      logical :: is_closed

      mark = text(scan%position:scan%position)
      is_closed = .false.
      i = scan%position + 1
      do while (i <= len(text))
         if (text(i:i) == line_feed .or. text(i:i) == carriage_return) exit
         if (text(i:i) == mark) then
            is_closed = .true.
            if (i < len(text)) is_closed = text(i + 1:i + 1) /= mark
            if (is_closed) exit
            i = i + 1
         end if
         i = i + 1
      end do
      if (.not. is_closed) then
         call stop_at(scan, scan%line, &
                      "&"//body%name//": string "//shown(text(scan%position:min(i, len(text) + 1) - 1))// &
                      " is not closed in its line; its quote is "//mark)
         return
      end if
      body%value%first = scan%position + 1
      body%value%last = i - 1
      body%value%kind = kind_of%word
      if (i < len(text)) then
         if (index(blanks//",/!", text(i + 1:i + 1)) == 0) then
            call stop_at(scan, scan%line, &
                         "&"//body%name//": a blank or comma is missing after the string "// &
                         shown(text(scan%position:i)))
         end if
      end if
      scan%position = i + 1
   end subroutine read_string

   !> Appends the value just read to its key.
   pure subroutine store_value(text, scan, body, content)
      character(*), intent(in) :: text
      type(scan_t), intent(inout) :: scan
      type(body_t), intent(inout) :: body
      type(content_t), intent(inout) :: content

      if (allocated(scan%problem)) return
      if (.not. body%in_key) then
         call stop_at(scan, scan%line, "&"//body%name//": value '"// &
                      shown(text(body%value%first:body%value%last))//"' without a key; write key = value")
         return
      end if
      body%after_comma = .false.
      body%n_found = body%n_found + body%value%count
      if (body%i > 0 .and. body%n_found > 1) then
         call stop_at(scan, scan%line, "&"//body%name//": one element of '"//body%key//"' takes one value")
      else if (body%n_found > max_values) then
         call stop_at(scan, scan%line, "&"//body%name//": key '"//body%key//"' has more than "// &
                      to_text(max_values)//" values")
      end if
      if (body%i_key == 0) return
      body%value%first = body%value%first - body%offset
      body%value%last = body%value%last - body%offset
      call content%keys(body%i_key)%add(body%value)
      if (content%keys(body%i_key)%n_elements > max_values) then
         call stop_at(scan, scan%line, "&"//body%name//": key '"//body%key//"' has more than "// &
                      to_text(max_values)//" values")
      end if
   end subroutine store_value

   !> Records an error and its line; only the first counts.
   pure subroutine stop_at(scan, line, problem)
      type(scan_t), intent(inout) :: scan
      integer, intent(in) :: line
      character(*), intent(in) :: problem

      if (allocated(scan%problem)) return
      scan%problem = problem
      if (index(problem, char(194)//char(160)) > 0) &                 ! in UTF-8
         scan%problem = problem//"; a blank is a no-break space, as of a web page: write it anew"
      scan%problem_line = line
   end subroutine stop_at

   !> Position of the last character of the word that begins at `first`, first - 1 if there is none.
   pure integer function word_last(text, first) result(last)
      character(*), intent(in) :: text
      integer, intent(in) :: first

      last = first - 1
      do while (last < len(text))
         if (index(word_end, text(last + 1:last + 1)) > 0) exit
         last = last + 1
      end do
   end function word_last

   !> Skips blanks, line ends and comments.
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

   !> Skips the rest of the line.
   pure subroutine skip_comment(text, scan)
      character(*), intent(in) :: text
      type(scan_t), intent(inout) :: scan

      do while (scan%position <= len(text))
         if (text(scan%position:scan%position) == line_feed) exit
         scan%position = scan%position + 1
      end do
   end subroutine skip_comment

   !> Whether only blanks and a comment follow in the line from `first` on.
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
end module hb_namelist_parser
