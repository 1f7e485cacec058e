!> Hostile versions of good texts: what a slip of the hand, a broken disk or malice makes of an input file.
!>
!> A generator is seeded with two numbers; the same numbers give the same text again.
module mutations
   use hb_kinds, only: int64
   use hb_text, only: string_t, to_text
   implicit none
   private
   public :: generator_t, mutant_of, new_generator

   character(*), parameter :: line_feed = achar(10)
   integer, parameter :: longest = 400000                             !! characters of a mutant

   !> Numbers that readers get wrong: around the ends of ranges, not finite, misspelt, repeated beyond measure.
   character(22), parameter :: numbers(46) = [character(22) :: &
      "0", "-1", "1", "2", "3", "7", "50", "64", "1000", "9999", "10000", "999999", "1000000", "10000000", "100000000", &
      "1000000000", "2147483647", "-2147483647", "2147483648", "99999999999999999999", "1e308", "-1e308", "1.7e309", "1e-308", &
      "5e-324", "1e999999999999", "nan", "inf", "-inf", "1000000*0", "999999*1.5", "1000001*0", "0*1", "3*", "*", "0.5", "1d5", &
      "1.5.2", "0x10", "1e", "-", ".5", "5.", "''", "'x1'", ".true."]

   !> Pieces of syntax, and bytes that do not belong into a text.
   character(26), parameter :: pieces(30) = [character(26) :: &
      "/", "&", "&end", "&law", "&sweep parameter =", "=", "(", ")", "(999999999)", "(1000000)", "(1,1000000) =", "(0)", "(1, 2", &
      ",,", "'", '"', "!", "%", "*", "1000000*", "\xFF", "\0", "\r", "\r\n", "\xEF\xBB\xBF", "\xC3\xA9", "\t", "\n", &
      "include 'fuzz.nml'", "tuples = 0 , 1"]

   character(4), parameter :: units(6) = [character(4) :: "x", "7", "7,", "'x',", "&x", "("]   !! of very long words and lists

   type :: generator_t
      private
      integer(int64) :: state = 1
   contains
      procedure :: below => generator_below
   end type generator_t

contains

   !> Generator for mutant `number` of a campaign. Source: SplitMix64; Steele, Lea and Flood, OOPSLA 2014, kept to 62 bits.
   pure subroutine new_generator(self, seed, number)
      type(generator_t), intent(out) :: self
      integer, intent(in) :: seed, number
      integer :: i, ignored

      self%state = 1 + ieor(ishft(int(seed, int64), 31), int(number, int64))
      do i = 1, 4
         call self%below(2, ignored)
      end do
   end subroutine new_generator

   !> A number from 0 to n - 1. Source: xorshift64; Marsaglia, J. Stat. Softw. 8 (2003) 14.
   pure subroutine generator_below(self, n, number)
      class(generator_t), intent(inout) :: self
      integer, intent(in) :: n                                        !! 1 or more
      integer, intent(out) :: number

      self%state = ieor(self%state, ishft(self%state, 13))
      self%state = ieor(self%state, ishft(self%state, -7))
      self%state = ieor(self%state, ishft(self%state, 17))
      number = int(mod(ishft(self%state, -2), int(n, int64)))
   end subroutine generator_below

   !> One of the texts, changed at one to four places.
   subroutine mutant_of(texts, generator, mutant)
      type(string_t), intent(in) :: texts(:)
      type(generator_t), intent(inout) :: generator
      character(:), allocatable, intent(out) :: mutant
      integer :: i, k, n_changes

      call generator%below(size(texts), k)
      mutant = texts(k + 1)%value
      call generator%below(4, n_changes)
      do i = 0, n_changes
         call change(texts, generator, mutant)
         mutant = mutant(:min(len(mutant), longest))
      end do
   end subroutine mutant_of

   subroutine change(texts, generator, text)
      type(string_t), intent(in) :: texts(:)
      type(generator_t), intent(inout) :: generator
      character(:), allocatable, intent(inout) :: text
      integer :: first, i, k, kind, last, n, place

      n = len(text)
      call generator%below(n + 1, place)                              ! what comes in goes behind this place
      call choose_span(generator, n, first, last)
      call generator%below(24, kind)
      select case (kind)
      case (0)                                                        ! torn off
         text = text(:place)
      case (1)                                                        ! some bits turned
         call generator%below(8, k)
         do i = 0, k
            call turn_bit(generator, text)
         end do
      case (2)
         text = text(:first - 1)//text(last + 1:)
      case (3)
         text = text(:place)//text(first:last)//text(place + 1:)
      case (4, 5)
         call generator%below(size(pieces), k)
         text = text(:place)//" "//plain(trim(pieces(k + 1)))//" "//text(place + 1:)
      case (6)                                                        ! head of one, tail of another
         call generator%below(size(texts), k)
         associate (other => texts(k + 1)%value)
            call generator%below(len(other) + 1, i)
            text = text(:place)//other(i + 1:)
         end associate
      case (7)                                                        ! a very long word, line or list
         call generator%below(size(units), k)
         call generator%below(20000, i)
         text = text(:place)//repeat(trim(units(k + 1)), i)//text(place + 1:)
      case (8)
         call repeat_group(generator, text)
      case (9)
         call repeat_lines(generator, text)
      case (10)                                                       ! line ends of another system
         text = with_returns(text)
      case (11)                                                       ! as some editors begin a file
         text = char(239)//char(187)//char(191)//text
      case (12)                                                       ! an index too many
         call find_mark(generator, text, "=", place)
         call generator%below(size(numbers), k)
         if (place > 0) text = text(:place - 1)//"("//trim(numbers(k + 1))//") "//text(place:)
      case (13)                                                       ! a word from elsewhere
         call replace_word(texts, generator, text)
      case default
         call replace_number(generator, text)
      end select
   end subroutine change

   !> A span of at most 200 characters; empty in an empty text.
   subroutine choose_span(generator, n, first, last)
      type(generator_t), intent(inout) :: generator
      integer, intent(in) :: n
      integer, intent(out) :: first, last
      integer :: length

      first = 1
      last = 0
      if (n == 0) return
      call generator%below(n, first)
      first = first + 1
      call generator%below(200, length)
      last = min(n, first + length)
   end subroutine choose_span

   subroutine turn_bit(generator, text)
      type(generator_t), intent(inout) :: generator
      character(*), intent(inout) :: text
      integer :: bit, place

      if (len(text) == 0) return
      call generator%below(len(text), place)
      call generator%below(8, bit)
      text(place + 1:place + 1) = achar(ieor(ichar(text(place + 1:place + 1)), ishft(1, bit)))
   end subroutine turn_bit

   !> Puts a nasty number into the place of one.
   subroutine replace_number(generator, text)
      type(generator_t), intent(inout) :: generator
      character(:), allocatable, intent(inout) :: text
      character(*), parameter :: of_numbers = "0123456789.+-eEdD"
      integer :: first, k, length

      call find_mark(generator, text, "0123456789", first)
      if (first == 0) return
      first = first - verify(reversed(text(:first)), of_numbers) + 2
      if (verify(reversed(text(:first)), of_numbers) == 0) first = 1
      length = verify(text(first:), of_numbers) - 1
      if (length < 0) length = len(text) - first + 1
      call generator%below(size(numbers), k)
      text = text(:first - 1)//trim(numbers(k + 1))//text(first + length:)
   end subroutine replace_number

   !> Puts a word of any of the texts into the place of one.
   subroutine replace_word(texts, generator, text)
      type(string_t), intent(in) :: texts(:)
      type(generator_t), intent(inout) :: generator
      character(:), allocatable, intent(inout) :: text
      integer :: first, k, last, other_first, other_last

      call generator%below(size(texts), k)
      call find_word(generator, texts(k + 1)%value, other_first, other_last)
      call find_word(generator, text, first, last)
      text = text(:first - 1)//texts(k + 1)%value(other_first:other_last)//text(last + 1:)
   end subroutine replace_word

   subroutine find_word(generator, text, first, last)
      type(generator_t), intent(inout) :: generator
      character(*), intent(in) :: text
      integer, intent(out) :: first, last
      character(*), parameter :: of_words = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ_0123456789'"

      last = 0
      call find_mark(generator, text, of_words, first)
      if (first == 0) then
         first = 1
         return
      end if
      last = first
      do while (first > 1)
         if (index(of_words, text(first - 1:first - 1)) == 0) exit
         first = first - 1
      end do
      do while (last < len(text))
         if (index(of_words, text(last + 1:last + 1)) == 0) exit
         last = last + 1
      end do
   end subroutine find_word

   !> Place of one of the marks, the first from anywhere on; 0 where there is none.
   subroutine find_mark(generator, text, marks, place)
      type(generator_t), intent(inout) :: generator
      character(*), intent(in) :: text
      character(*), intent(in) :: marks
      integer, intent(out) :: place
      integer :: start

      place = 0
      if (len(text) == 0) return
      call generator%below(len(text), start)
      place = scan(text(start + 1:), marks)
      if (place > 0) place = place + start
      if (place == 0) place = scan(text, marks)
   end subroutine find_mark

   !> Writes a group again, up to fifty times.
   subroutine repeat_group(generator, text)
      type(generator_t), intent(inout) :: generator
      character(:), allocatable, intent(inout) :: text
      integer :: first, last, n_times

      call find_mark(generator, text, "&", first)
      if (first == 0) return
      last = index(text(first + 1:), line_feed//"&")
      last = merge(len(text), first + last, last == 0)
      call generator%below(50, n_times)
      text = text(:first - 1)//repeat(text(first:last), n_times)//text(last + 1:)
   end subroutine repeat_group

   !> Writes what stands between two line ends again, up to five times, or leaves it out.
   subroutine repeat_lines(generator, text)
      type(generator_t), intent(inout) :: generator
      character(:), allocatable, intent(inout) :: text
      integer :: first, last, n_times

      call find_mark(generator, text, line_feed, first)
      if (first == 0) return
      last = first + index(text(first + 1:), line_feed)
      call generator%below(6, n_times)
      text = text(:first)//repeat(text(first + 1:last), n_times)//text(last + 1:)
   end subroutine repeat_lines

   pure function with_returns(text) result(changed)
      character(*), intent(in) :: text
      character(:), allocatable :: changed
      integer :: i, n

      allocate (character(2*len(text)) :: changed)
      n = 0
      do i = 1, len(text)
         if (text(i:i) == line_feed) then
            n = n + 1
            changed(n:n) = achar(13)
         end if
         n = n + 1
         changed(n:n) = text(i:i)
      end do
      changed = changed(:n)
   end function with_returns

   pure function reversed(text)
      character(*), intent(in) :: text
      character(len(text)) :: reversed
      integer :: i

      do i = 1, len(text)
         reversed(i:i) = text(len(text) + 1 - i:len(text) + 1 - i)
      end do
   end function reversed

   !> A piece with its escapes \n, \r, \t, \0 and \xHH made into characters.
   pure function plain(piece)
      character(*), intent(in) :: piece
      character(:), allocatable :: plain
      integer :: code, i

      plain = ""
      i = 1
      do while (i <= len(piece))
         if (piece(i:i) /= "\" .or. i == len(piece)) then
            plain = plain//piece(i:i)
            i = i + 1
            cycle
         end if
         select case (piece(i + 1:i + 1))
         case ("n"); plain = plain//achar(10)
         case ("r"); plain = plain//achar(13)
         case ("t"); plain = plain//achar(9)
         case ("0"); plain = plain//achar(0)
         case default
            read (piece(i + 2:i + 3), "(z2)") code
            plain = plain//char(code)
            i = i + 2
         end select
         i = i + 2
      end do
   end function plain
end module mutations
