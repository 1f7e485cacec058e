!> Text utilities: numbers to text and back, lists of words.
!>
!> Functions that return texts declare the length of their result, because gfortran stores lengths of deferred results
!> in static memory, which threads would share.
module hb_text
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite, ieee_is_nan, ieee_negative_inf, ieee_positive_inf, &
      ieee_quiet_nan, ieee_value
   use hb_kinds, only: int64, wp
   implicit none
   private
   public :: add_string, is_name, join, length_of, letters, lower, max_name, number_of, parse_integer, parse_real, quote, &
      rounded, rounded_beside, rounded_to, shortened, shown, split, string_t, text_builder_t, texts_t, to_text

   character(*), parameter :: digits = "0123456789"
   character(*), parameter :: letters = "abcdefghijklmnopqrstuvwxyz"
   character(*), parameter :: ellipsis = " ..."
   integer, parameter :: max_name = 63                      !! length of the longest name of a group or key

   !> One text of a list whose members differ in length.
   type :: string_t
      character(:), allocatable :: value
   end type string_t

   !> Texts of one length. As a component they are what gfortran expects: of a local array it reads the length before that is set.
   type :: texts_t
      character(:), allocatable :: values(:)
   end type texts_t

   !> Text that is built piece by piece at a cost linear in its final length.
   type :: text_builder_t
      character(:), allocatable, private :: buffer
      integer(int64), private :: length = 0
   contains
      procedure :: add => text_builder_add
      procedure :: text => text_builder_text
   end type text_builder_t

   !> Converts a value to text; a real in the shortest form found that `parse_real` converts back to the same double.
   interface to_text
      module procedure integer_text, int64_text, real_text, logical_text
   end interface to_text

   !> Joins the members of a list with `separator`; trailing blanks of a character array are ignored.
   interface join
      module procedure join_strings, join_words
   end interface join

contains

   !> Appends a text to a list. gfortran 13 loses characters of expressions within `[list, string_t(...)]`.
   pure subroutine add_string(list, text)
      type(string_t), allocatable, intent(inout) :: list(:)
      character(*), intent(in) :: text
      type(string_t), allocatable :: longer(:)
      integer :: i

      allocate (longer(size(list) + 1))
      do i = 1, size(list)
         call move_alloc(list(i)%value, longer(i)%value)
      end do
      longer(size(longer))%value = text
      call move_alloc(longer, list)
   end subroutine add_string

   pure function integer_text(value) result(text)
      integer, intent(in) :: value
      character(length_of(value)) :: text

      text = int64_text(int(value, int64))
   end function integer_text

   pure function int64_text(value) result(text)
      integer(int64), intent(in) :: value
      character(int64_length(value)) :: text
      integer(int64) :: rest
      integer :: i

      rest = value
      do i = len(text), 1, -1                               ! formatted output takes ten times as long
         text(i:i) = achar(iachar("0") + int(abs(mod(rest, 10_int64))))
         rest = rest/10
      end do
      if (value < 0) text(1:1) = "-"
   end function int64_text

   !> Length of an integer as text.
   elemental integer function length_of(number)
      integer, intent(in) :: number

      length_of = int64_length(int(number, int64))
   end function length_of

   pure integer function int64_length(value) result(length)
      integer(int64), intent(in) :: value
      integer(int64) :: rest

      length = merge(2, 1, value < 0)
      rest = value/10
      do while (rest /= 0)
         length = length + 1
         rest = rest/10
      end do
   end function int64_length

   pure function logical_text(value) result(text)
      logical, intent(in) :: value
      character(merge(6, 7, value)) :: text

      text = merge(".true. ", ".false.", value)
   end function logical_text

   pure function real_text(value) result(text)
      real(wp), intent(in) :: value
      character(real_length(value)) :: text
      character(:), allocatable :: shortest

      call write_real(value, shortest)
      text = shortest
   end function real_text

   pure integer function real_length(value) result(length)
      real(wp), intent(in) :: value
      character(:), allocatable :: shortest

      call write_real(value, shortest)
      length = len(shortest)
   end function real_length

   !> A number with `n_digits` significant decimal digits: without the rounding errors, or the digits that are not known, after
   !> them.
   elemental real(wp) function rounded_to(value, n_digits)
      real(wp), intent(in) :: value                         !! finite
      integer, intent(in) :: n_digits
      character(40) :: buffer, form

      write (form, "(a, i0, a)") "(es40.", n_digits - 1, "e4)"
      write (buffer, form) value
      read (buffer, *) rounded_to
   end function rounded_to

   !> Formats a number with two digits: 7800, 0.12, 4.9E-05.
   pure function rounded(value) result(text)
      real(wp), intent(in) :: value
      character(rounded_length(value)) :: text
      character(24) :: buffer

      call write_rounded(value, buffer)
      text = buffer
   end function rounded

   !> Formats a number that is compared with a limit: as `rounded`, with a third digit where two are those of the limit.
   pure function rounded_beside(value, limit) result(text)
      real(wp), intent(in) :: value, limit
      character(24) :: text
      character(9) :: digits

      text = rounded(value)
      if (text /= rounded(limit)) return
      write (digits, "(es9.2)") value
      text = adjustl(digits)
   end function rounded_beside

   pure integer function rounded_length(value) result(length)
      real(wp), intent(in) :: value
      character(24) :: buffer

      call write_rounded(value, buffer)
      length = len_trim(buffer)
   end function rounded_length

   pure subroutine write_rounded(value, text)
      real(wp), intent(in) :: value
      character(*), intent(out) :: text
      integer :: n

      if (value >= 0.01_wp .and. value < 1.0e6_wp) then
         text = to_text(real(nint(value*10.0_wp**(1 - floor(log10(value)))), wp)/10.0_wp**(1 - floor(log10(value))))
         n = len_trim(text)
         if (text(n - 1:n) == ".0") text(n - 1:n) = ""
      else
         write (text, "(es8.1e2)") max(value, 1.0e-99_wp)
         text = adjustl(text)
         if (value <= 0.0_wp) text = "0"
      end if
   end subroutine write_rounded

   !> Tries fifteen digits first, which find every form of at most 15 digits (except for subnormal numbers, which
   !> begin with one digit). Plain form from 0.01 to below 1e6.
   pure subroutine write_real(value, text)
      real(wp), intent(in) :: value
      character(:), allocatable, intent(out) :: text
      character(:), allocatable :: mantissa
      character(40) :: buffer, form
      real(wp) :: back
      integer :: exponent_10, first_try, n, n_digits, point
      logical :: ok

      if (.not. ieee_is_finite(value)) then
         text = "nan"
         if (.not. ieee_is_nan(value)) text = merge("-inf", "inf ", sign(1.0_wp, value) < 0.0_wp)
         text = trim(text)
         return
      end if
      if ((abs(value) >= 0.01_wp .or. .not. abs(value) > 0.0_wp) .and. abs(value) < 1.0e6_wp) then
         call write_short(value, text)
         if (allocated(text)) return
      end if
      first_try = merge(1, 15, abs(value) < 1e-290_wp)
      do n_digits = first_try, 17
         write (form, "(a,i0,a)") "(es40.", n_digits - 1, "e4)"
         write (buffer, form) abs(value)
         call parse_real(trim(adjustl(buffer)), back, ok)
         if (ok .and. abs(back - abs(value)) <= 0.0_wp) exit
      end do
      buffer = adjustl(buffer)
      point = index(buffer, ".")
      n = scan(buffer, "E")
      read (buffer(n + 1:), *) exponent_10
      mantissa = buffer(1:point - 1)//buffer(point + 1:n - 1)
      n = max(1, verify(mantissa, "0", back=.true.))
      mantissa = mantissa(1:n)
      if (exponent_10 >= 6 .or. exponent_10 < -2) then
         text = mantissa(1:1)//"."
         if (n > 1) text = text//mantissa(2:)
         if (n == 1) text = text//"0"
         text = text//"e"//to_text(exponent_10)
      else if (exponent_10 < 0) then
         text = trim(merge("0.0", "0. ", exponent_10 == -2))//mantissa
      else if (n <= exponent_10 + 1) then
         do n = n, exponent_10
            mantissa = mantissa//"0"
         end do
         text = mantissa//".0"
      else
         text = mantissa(1:exponent_10 + 1)//"."//mantissa(exponent_10 + 2:)
      end if
      if (sign(1.0_wp, value) < 0.0_wp) text = "-"//text
   end subroutine write_real

   !> Formats a number with at most eight decimals, as most numbers of an input, in a tenth of the time: a quotient of two integers
   !> that numbers of this kind represent exactly is rounded as its decimal form is. Not allocated for other numbers.
   pure subroutine write_short(value, text)
      real(wp), intent(in) :: value                         !! 0 or of a magnitude in [0.01, 1e6)
      character(:), allocatable, intent(out) :: text
      integer(int64), parameter :: units_of_decimals = 100000000_int64
      character(20) :: buffer
      integer(int64) :: whole
      integer :: i, last

      whole = nint(abs(value)*units_of_decimals, int64)
      if (abs(real(whole, wp)/units_of_decimals - abs(value)) > 0.0_wp) return
      do i = len(buffer), 13, -1
         buffer(i:i) = achar(iachar("0") + int(mod(whole, 10_int64)))
         whole = whole/10
      end do
      buffer(12:12) = "."
      last = max(13, 12 + verify(buffer(13:), "0", back=.true.))
      text = to_text(whole)//buffer(12:last)
      if (sign(1.0_wp, value) < 0.0_wp) text = "-"//text
   end subroutine write_short

   !> Converts A to Z to lower case and changes nothing else, so that UTF-8 is preserved.
   pure function lower(text) result(changed)
      character(*), intent(in) :: text
      character(len(text)) :: changed
      integer, parameter :: lower_case_offset = iachar("a") - iachar("A")
      integer :: i

      do i = 1, len(text)
         if (text(i:i) >= "A" .and. text(i:i) <= "Z") then
            changed(i:i) = achar(iachar(text(i:i)) + lower_case_offset)
         else
            changed(i:i) = text(i:i)
         end if
      end do
   end function lower

   pure function join_strings(list, separator) result(text)
      type(string_t), intent(in) :: list(:)
      character(*), intent(in) :: separator
      character(length_of_strings(list) + max(0, size(list) - 1)*len(separator)) :: text
      integer :: i, n

      n = 0
      do i = 1, size(list)
         if (i > 1) call append(text, n, separator)
         if (allocated(list(i)%value)) call append(text, n, list(i)%value)
      end do
   end function join_strings

   pure integer function length_of_words(list) result(length)
      character(*), intent(in) :: list(:)

      length = sum(len_trim(list))
   end function length_of_words

   pure integer function length_of_strings(list) result(length)
      type(string_t), intent(in) :: list(:)
      integer :: i

      length = 0
      do i = 1, size(list)
         if (allocated(list(i)%value)) length = length + len(list(i)%value)
      end do
   end function length_of_strings

   pure subroutine append(text, n, piece)
      character(*), intent(inout) :: text
      integer, intent(inout) :: n                           !! characters in use
      character(*), intent(in) :: piece

      text(n + 1:n + len(piece)) = piece
      n = n + len(piece)
   end subroutine append

   pure function join_words(list, separator) result(text)
      character(*), intent(in) :: list(:)
      character(*), intent(in) :: separator
      character(length_of_words(list) + max(0, size(list) - 1)*len(separator)) :: text
      integer :: i, n

      n = 0
      do i = 1, size(list)
         if (i > 1) call append(text, n, separator)
         call append(text, n, trim(list(i)))
      end do
   end function join_words

   !> Encloses a text in single quotes and doubles those inside, as required in a Fortran namelist.
   pure function quote(text) result(quoted)
      character(*), intent(in) :: text
      character(len(text) + 2 + n_quotes(text)) :: quoted
      integer :: i, n

      quoted(1:1) = "'"
      n = 1
      do i = 1, len(text)
         n = n + 1
         quoted(n:n) = text(i:i)
         if (text(i:i) == "'") then
            n = n + 1
            quoted(n:n) = "'"
         end if
      end do
      quoted(n + 1:n + 1) = "'"
   end function quote

   pure integer function n_quotes(text)
      character(*), intent(in) :: text
      integer :: i

      n_quotes = count([(text(i:i) == "'", i=1, len(text))])
   end function n_quotes

   !> Splits a text at every `separator`; n separators give n + 1 parts, of which any may be empty.
   pure subroutine split(text, separator, parts)
      character(*), intent(in) :: text
      character(*), intent(in) :: separator                 !! not empty
      type(string_t), allocatable, intent(out) :: parts(:)
      integer :: first, i, n, pass, width

      do pass = 1, 2
         n = 1
         first = 1
         do
            width = 0
            if (len(separator) > 0) width = index(text(first:), separator)
            if (width == 0) exit
            if (pass == 2) parts(n)%value = text(first:first + width - 2)
            first = first + width - 1 + len(separator)
            n = n + 1
         end do
         if (pass == 1) allocate (parts(n))
      end do
      i = size(parts)
      parts(i)%value = text(first:)
   end subroutine split

   !> Reads a whole token as a real: sign, digits, point, exponent with e or d. `ok` is false and `value` zero for
   !> anything else and for numbers beyond huge(); `nan` and `inf` are recognised, and the caller decides about them.
   !> The range is checked before the conversion by the runtime library, which would raise an overflow exception.
   pure subroutine parse_real(token, value, ok)
      character(*), intent(in) :: token
      real(wp), intent(out) :: value
      logical, intent(out) :: ok
      character(*), parameter :: largest = "179769313486231570814527423731704356798"
      integer(int64) :: exponent_10, scale_10
      integer :: first, iostat, last, point, start
      logical :: is_beyond, is_exponent

      ok = .false.
      value = 0.0_wp
      if (len(token) == 0) return
      start = 1 + scan(token(1:1), "+-")
      call parse_special(token(start:), token(1:1) == "-", value, ok)
      if (ok) return
      last = start + verify(token(start:)//"e", digits//".") - 2
      call parse_exponent(token(last + 1:), exponent_10, is_exponent)
      associate (mantissa => token(start:last))
         point = index(mantissa, ".")
         if (.not. is_exponent .or. scan(mantissa, digits) == 0 .or. index(mantissa, ".", back=.true.) /= point) return
         if (point == 0) point = len(mantissa) + 1
         first = scan(mantissa, digits(2:))                           ! digit other than zero
         ! the number is +-0.d * 10**scale_10 with the digits d from there on
         scale_10 = exponent_10 + int(point - first + merge(0, 1, first < point), int64)
         is_beyond = scale_10 > 309
         if (first > 0 .and. scale_10 == 309) is_beyond = llt(largest, mantissa(first:point - 1)//mantissa(max(first, point + 1):))
      end associate
      if (first > 0 .and. is_beyond) return
      if (first > 0 .and. scale_10 > -330) then
         read (token(start:), *, iostat=iostat) value
         if (iostat /= 0) then
            value = 0.0_wp
            return
         end if
      end if
      if (token(1:1) == "-") value = -value
      ok = .true.
   end subroutine parse_real

   !> Numbers that are not finite: nan, inf, infinity in any case, without their sign.
   pure subroutine parse_special(word, is_negative, value, ok)
      character(*), intent(in) :: word
      logical, intent(in) :: is_negative
      real(wp), intent(inout) :: value                      !! unchanged if it is none of them
      logical, intent(out) :: ok

      ok = .false.
      if (len(word) /= 3 .and. len(word) /= 8) return
      ok = .true.
      select case (lower(word))
      case ("nan")
         value = ieee_value(1.0_wp, ieee_quiet_nan)
      case ("inf", "infinity")
         value = ieee_value(1.0_wp, ieee_positive_inf)
         if (is_negative) value = ieee_value(1.0_wp, ieee_negative_inf)
      case default
         ok = .false.
      end select
   end subroutine parse_special

   !> Reads an exponent with its letter, or an empty text.
   pure subroutine parse_exponent(token, exponent_10, ok)
      character(*), intent(in) :: token
      integer(int64), intent(out) :: exponent_10            !! not above 10**13
      logical, intent(out) :: ok
      integer :: first, i

      exponent_10 = 0
      ok = len(token) == 0
      if (ok) return
      if (scan(token(1:1), "eEdD") == 0) return
      first = 2
      if (len(token) > 1) first = merge(3, 2, scan(token(2:2), "+-") == 1)
      if (first > len(token)) return
      do i = first, len(token)
         if (index(digits, token(i:i)) == 0) return
         exponent_10 = min(10*exponent_10 + index(digits, token(i:i), kind=int64) - 1, 10_int64**12)
      end do
      if (token(2:2) == "-") exponent_10 = -exponent_10
      ok = .true.
   end subroutine parse_exponent

   !> Reads a whole token as an integer: sign and digits; `ok` is false and `value` zero otherwise and if the number
   !> does not fit.
   pure subroutine parse_integer(token, value, ok)
      character(*), intent(in) :: token
      integer, intent(out) :: value
      logical, intent(out) :: ok
      integer(int64) :: number
      integer :: first, i

      ok = .false.
      value = 0
      if (len(token) == 0) return
      first = 1
      if (scan(token(1:1), "+-") == 1) first = 2
      if (first > len(token)) return
      number = 0
      do i = first, len(token)
         if (index(digits, token(i:i)) == 0) return
         number = 10*number + index(digits, token(i:i), kind=int64) - 1
         if (number > huge(value)) return
      end do
      if (token(1:1) == "-") number = -number
      value = int(number)
      ok = .true.
   end subroutine parse_integer

   !> Appends a piece.
   pure subroutine text_builder_add(self, piece)
      class(text_builder_t), intent(inout) :: self
      character(*), intent(in) :: piece
      character(:), allocatable :: larger
      integer(int64) :: n

      if (.not. allocated(self%buffer)) allocate (character(256) :: self%buffer)
      n = self%length + len(piece, int64)
      if (n > len(self%buffer, int64)) then
         allocate (character(2*n) :: larger)
         larger(1:self%length) = self%buffer(1:self%length)
         call move_alloc(larger, self%buffer)
      end if
      self%buffer(self%length + 1:n) = piece
      self%length = n
   end subroutine text_builder_add

   !> Everything added so far.
   pure function text_builder_text(self) result(text)
      class(text_builder_t), intent(in) :: self
      character(self%length) :: text

      if (allocated(self%buffer)) text = self%buffer(1:self%length)
   end function text_builder_text

   !> A count with its noun: `1 point`, `2 points`.
   pure function number_of(n, word) result(text)
      integer, intent(in) :: n
      character(*), intent(in) :: word                                !! singular
      character(length_of(n) + 1 + len(word) + merge(0, 1, n == 1)) :: text

      text = to_text(n)//" "//word//"s"
   end function number_of

   !> Whether a text is a Fortran name in lower case.
   pure logical function is_name(text)
      character(*), intent(in) :: text

      is_name = .false.
      if (len(text) == 0 .or. len(text) > max_name) return
      is_name = index(letters, text(1:1)) > 0 .and. verify(text, letters//"0123456789_") == 0
   end function is_name

   !> Text of the file for a message: without control characters, and shortened if long (not inside UTF-8).
   pure function shown(text) result(clean)
      character(*), intent(in) :: text
      character(shown_length(text) + merge(3, 0, shown_length(text) < len(text))) :: clean
      integer :: i, n

      n = shown_length(text)
      clean = text(1:n)//"..."
      do i = 1, n
         if (ichar(clean(i:i)) < 32 .or. ichar(clean(i:i)) == 127) clean(i:i) = "?"
      end do
   end function shown

   pure integer function shown_length(text) result(n)
      character(*), intent(in) :: text
      integer, parameter :: max_shown_bytes = 60

      n = len(text)
      if (n <= max_shown_bytes) return
      n = max_shown_bytes
      do while (n > max_shown_bytes - 4)
         if (iand(ichar(text(n + 1:n + 1)), 192) /= 128) exit
         n = n - 1
      end do
   end function shown_length

   !> Text of at most `n_bytes`: a longer one ends at the end of a word, or of a character if that would leave less
   !> than half, with an ellipsis.
   pure function shortened(text, n_bytes) result(short)
      character(*), intent(in) :: text
      integer, intent(in) :: n_bytes
      character(short_length(text, n_bytes) + merge(0, len(ellipsis), len(text) <= n_bytes)) :: short

      short = text(:short_length(text, n_bytes))//ellipsis
   end function shortened

   pure integer function short_length(text, n_bytes) result(n)
      character(*), intent(in) :: text
      integer, intent(in) :: n_bytes

      n = len(text)
      if (n <= n_bytes) return
      n = max(0, n_bytes - len(ellipsis))
      if (scan(text(:n + 1), " ", back=.true.) > n/2) then
         n = scan(text(:n + 1), " ", back=.true.) - 1
      else
         do while (n > 0 .and. iand(ichar(text(n + 1:n + 1)), 192) == 128)
            n = n - 1                                  ! the next byte continues a character
         end do
      end if
      n = len_trim(text(:n))
   end function short_length
end module hb_text
