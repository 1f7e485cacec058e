!> Keys of one group of properties, the values given for them (numbers, logicals and words, with their line in the file) and the
!> values that their reader uses. A single value is a list of length one.
!>
!> Values read from a text are stored as spans of it, and repeat counts as counts, so that memory is linear in the
!> size of the file. Values set from numbers have no spelling and no line.
module hb_property_values
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_input_keys, only: kind_of, max_unit, rule_t
   use hb_kinds, only: int64, wp
   use hb_name_table, only: name_table_t
   use hb_text, only: length_of, quote, shown, string_t, to_text
   implicit none
   private
   public :: content_t, element_text, key_t, max_values, number_value, value_t

   integer, parameter :: max_values = 1000000               !! of one key, repeat counts included

   !> One value, or a run of equal values.
   type :: value_t
      real(wp) :: number = 0.0_wp
      integer :: kind = 0                                   !! one of `kind_of`
      integer :: first = 1, last = 0                        !! span of the spelling, without quotes; empty if there is none
      integer :: line = 0                                   !! 0: set from outside; negative: set by the group &sweep of that line
      integer :: count = 1                                  !! repeat count
      integer :: i = 0, j = 0                               !! element index, 0 if there is none
   end type value_t

   integer, parameter :: in_words = -1                      !! `last` of a word that is stored in the words of its key, at `first`

   !> One key: listed values, single elements, or (set from outside) both.
   type :: key_t
      integer :: line = 0                                   !! of its first appearance; from outside as above
      integer :: second_line = 0                            !! line of a second, invalid definition
      logical :: has_problem = .false.                      !! its reader has reported a problem
      logical :: is_real = .false.                          !! has been read as real numbers
      integer :: n = 0                                      !! values in use
      integer :: n_elements = 0                             !! of them, the last ones, those with an index
      integer :: n_listed = 0                               !! number of the others, repeat counts included
      type(value_t), allocatable :: values(:)               !! (capacity)
      type(string_t), allocatable :: words(:)               !! set from outside
      ! What its reader uses, given or default:
      integer :: requested = 0                              !! position among the requested keys; 0: not requested
      type(rule_t), allocatable :: rule                     !! for the key, from the table of keys
      character(max_unit) :: unit = ""
      integer :: kind = 0                                   !! one of `kind_of`, `none` if nothing has been read
      real(wp), allocatable :: numbers(:)                   !! values used, or
      type(string_t), allocatable :: texts(:)
      integer :: row_length = 1                             !! of a matrix
   contains
      procedure :: add => key_add
      procedure :: element_at => key_element_at
      procedure :: listed_at => key_listed_at
   end type key_t

   !> Keys and values of one group.
   type :: content_t
      character(:), allocatable :: spelling                 !! text that contains the spans of values
      type(name_table_t) :: names                           !! of the keys
      type(key_t), allocatable :: keys(:)                   !! (capacity), names%n in use
   contains
      procedure :: add_advice => content_add_advice
      procedure :: find_or_add => content_find_or_add
      procedure :: get_shown => content_get_shown
      procedure :: get_word => content_get_word
      procedure :: is_given => content_is_given
      procedure :: replace => content_replace
      procedure :: replace_words => content_replace_words
      procedure :: copy_key => content_copy_key
   end type content_t

contains

   !> Creates a number set from outside; without a fraction it is also valid as an integer.
   elemental type(value_t) function number_value(number) result(value)
      real(wp), intent(in) :: number

      value%number = number
      value%kind = kind_of%number
      if (.not. ieee_is_finite(number)) return
      if (abs(number) > real(huge(1), wp)) return
      if (abs(number - anint(number)) <= 0.0_wp) value%kind = kind_of%whole
   end function number_value

   !> Appends a value; elements follow the listed values.
   pure subroutine key_add(self, value)
      class(key_t), intent(inout) :: self
      type(value_t), intent(in) :: value
      type(value_t), allocatable :: larger(:)

      if (.not. allocated(self%values)) allocate (self%values(1))
      if (self%n == size(self%values)) then
         allocate (larger(2*self%n + 1))
         larger(:self%n) = self%values
         call move_alloc(larger, self%values)
      end if
      self%n = self%n + 1
      self%values(self%n) = value
      if (value%i > 0) then
         self%n_elements = self%n_elements + 1
      else
         self%n_listed = self%n_listed + value%count
      end if
   end subroutine key_add

   !> Returns the position of the element (i, j) among the values, 0 if it is not given.
   pure integer function key_element_at(self, i, j) result(position)
      class(key_t), intent(in) :: self
      integer, intent(in) :: i, j                           !! j is 0 if the element has one index

      do position = self%n, self%n - self%n_elements + 1, -1
         if (self%values(position)%i == i .and. self%values(position)%j == j) return
      end do
      position = 0
   end function key_element_at

   !> Returns the position of the value that contains number `i` of the list, 0 if the list is shorter.
   pure integer function key_listed_at(self, i) result(position)
      class(key_t), intent(in) :: self
      integer, intent(in) :: i
      integer :: n

      n = 0
      do position = 1, self%n - self%n_elements
         n = n + self%values(position)%count
         if (n >= i) return
      end do
      position = 0
   end function key_listed_at

   !> Finds a key by its name, and adds it without values if there is none.
   pure subroutine content_find_or_add(self, name, i_key)
      class(content_t), intent(inout) :: self
      character(*), intent(in) :: name                      !! lower case
      integer, intent(out) :: i_key
      type(key_t), allocatable :: larger(:)

      i_key = self%names%find(name)
      if (i_key > 0) return
      if (.not. allocated(self%keys)) allocate (self%keys(8))
      if (self%names%n == size(self%keys)) then
         allocate (larger(2*self%names%n))
         larger(1:self%names%n) = self%keys
         call move_alloc(larger, self%keys)
      end if
      call self%names%add(name)
      i_key = self%names%n
   end subroutine content_find_or_add

   !> Replaces values of a key from outside: one element, or the whole list.
   pure subroutine content_replace(self, name, values, has_changed)
      class(content_t), intent(inout) :: self
      character(*), intent(in) :: name                      !! lower case
      type(value_t), intent(in) :: values(:)                !! a list, or one with an index
      logical, intent(inout) :: has_changed                 !! set to true if a value changes
      integer :: i_key, k
      logical :: is_element

      call self%find_or_add(name, i_key)
      is_element = .false.
      if (size(values) == 1) is_element = values(1)%i > 0
      associate (key => self%keys(i_key))
         key%line = 0
         if (size(values) > 0) key%line = values(1)%line
         if (is_element) then
            k = key%element_at(values(1)%i, values(1)%j)
            if (k == 0) then
               has_changed = .true.
               call key%add(values(1))
            else
               has_changed = has_changed .or. differs(key%values(k), values(1))
               key%values(k) = values(1)
            end if
            return
         end if
         has_changed = has_changed .or. key%n /= size(values) .or. key%n_elements > 0
         if (key%n > 0 .and. .not. has_changed) has_changed = any(differs(key%values(:key%n), values))
         key%values = values                                ! in place: nothing grows when a value is set repeatedly
         key%n = size(values)
         key%n_elements = 0
         key%n_listed = sum(values%count)
      end associate
   end subroutine content_replace

   !> Whether a value may differ from the previous one.
   elemental logical function differs(old, new)
      type(value_t), intent(in) :: old, new

      differs = old%kind /= new%kind .or. old%count /= new%count .or. old%kind == kind_of%word .or. old%kind == kind_of%none .or. &
                transfer(old%number, 1_int64) /= transfer(new%number, 1_int64)
   end function differs

   !> Replaces all values of a key by words from outside.
   pure subroutine content_replace_words(self, name, words, has_changed, element, line)
      class(content_t), intent(inout) :: self
      character(*), intent(in) :: name                      !! lower case
      type(string_t), intent(in) :: words(:)
      logical, intent(inout) :: has_changed
      integer, intent(in), optional :: element(2)           !! of the single word, 0 for missing indices
      integer, intent(in), optional :: line                 !! as in `value_t`
      type(value_t) :: values(size(words))
      integer :: i_key, k, n

      values%kind = kind_of%word
      values%last = in_words
      if (present(element)) then
         values%i = element(1)
         values%j = element(2)
      end if
      if (present(line)) values%line = line
      call self%find_or_add(name, i_key)
      associate (key => self%keys(i_key))
         n = 0                                              ! words that other elements may use
         if (any(values%i > 0) .and. allocated(key%words)) n = size(key%words)
         k = 0                                              ! the value that the word replaces
         if (size(words) == 1 .and. n > 0) k = key%element_at(values(1)%i, values(1)%j)
         if (size(words) == 1 .and. n == 0 .and. key%n == 1) k = 1
         if (k > 0) then
            if (key%values(k)%last /= in_words .or. key%values(k)%i /= values(1)%i) k = 0
         end if
         if (k > 0) then
            k = key%values(k)%first
            has_changed = has_changed .or. key%words(k)%value /= words(1)%value .or. &
                          len(key%words(k)%value) /= len(words(1)%value)
            key%words(k) = words(1)
            return
         else if (n > 0) then
            key%words = [key%words, words]
         else
            key%words = words
         end if
      end associate
      values%first = [(n + k, k=1, size(words))]
      has_changed = .true.
      call self%replace(name, values, has_changed)
   end subroutine content_replace_words

   !> Copies the only key of `other`: all its values, or one element.
   pure subroutine content_copy_key(self, other, has_changed)
      class(content_t), intent(inout) :: self
      type(content_t), intent(in) :: other
      logical, intent(inout) :: has_changed
      type(value_t) :: values(other%keys(1)%n)

      if (.not. allocated(self%spelling)) self%spelling = ""
      values = other%keys(1)%values(:size(values))
      values%first = values%first + len(self%spelling)
      values%last = values%last + len(self%spelling)
      values%line = 0
      self%spelling = self%spelling//other%spelling
      call self%replace(trim(other%names%names(1)), values, has_changed)
   end subroutine content_copy_key

   !> Whether key number `i_key` has a value.
   pure logical function content_is_given(self, i_key) result(is_given)
      class(content_t), intent(in) :: self
      integer, intent(in) :: i_key

      is_given = .false.
      if (i_key > 0) is_given = self%keys(i_key)%n > 0
   end function content_is_given

   !> Adds advice to a message if a value of a key of real numbers has a sign of another language, or looks like the first half
   !> of a number with a decimal comma, `1,5e-3` is two values, or like the unit of the number before it.
   pure subroutine content_add_advice(self, i_key, message)
      class(content_t), intent(in) :: self
      integer, intent(in) :: i_key
      character(:), allocatable, intent(inout) :: message
      integer :: comma, k
      logical :: is_found

      is_found = .false.
      associate (key => self%keys(i_key))
         do k = 1, merge(key%n - key%n_elements, 0, key%is_real)
            associate (value => key%values(k))
               if (value%kind == kind_of%none .and. value%last >= value%first) &
                  call add_sign_advice(self%spelling(value%first:value%last), message, is_found)
               if (is_found) return
            end associate
         end do
         do k = 1, merge(key%n - key%n_elements - 1, 0, key%is_real)
            associate (value => key%values(k), next => key%values(k + 1))
               if (next%kind == kind_of%none .and. any(value%kind == [kind_of%whole, kind_of%number])) then
                  message = message//"; numbers have no unit: leave out '"//shown(self%spelling(next%first:next%last))//"'"
                  return
               end if
               comma = value%last + 1
               if (next%first /= comma + 1 .or. value%kind /= kind_of%whole .or. value%last < value%first) cycle
               if (self%spelling(comma:comma) /= "," .or. scan(self%spelling(comma + 1:comma + 1), "0123456789") == 0) cycle
               message = message//"; if "//self%spelling(value%first:next%last)//" is one number, write it "
               if (index(self%spelling(next%first:next%last), ".") > 0) then  ! 1,000.0
                  message = message//"without the comma: "//self%spelling(value%first:value%last)
               else
                  message = message//"with a point: "//self%spelling(value%first:value%last)//"."
               end if
               message = message//self%spelling(next%first:next%last)
               return
            end associate
         end do
      end associate
   end subroutine content_add_advice

   !> Adds advice on a word in the place of a number that has signs of another language.
   pure subroutine add_sign_advice(word, message, is_found)
      character(*), intent(in) :: word
      character(:), allocatable, intent(inout) :: message
      logical, intent(out) :: is_found
      character(*), parameter :: minus = char(226)//char(136)//char(146), dash = char(226)//char(128)//char(147) ! in UTF-8
      character(*), parameter :: no_break = char(194)//char(160)
      character(:), allocatable :: advice

      advice = ""
      if (index(word, minus) + index(word, dash) > 0) advice = "its minus is another character than '-'"
      if (index(word, no_break) > 0) advice = "a blank is a no-break space, as of a web page"
      if (index(word, ";") > 0) advice = "separate numbers by commas or blanks, not by ';'"
      if (scan(word, "[](){}") > 0) advice = "lists of numbers have no brackets"
      if (scan(word, "*^") > 0) advice = "there are no products or powers; 3*0.5 repeats 0.5 three times"
      is_found = len(advice) > 0
      if (is_found) message = message//"; "//advice
   end subroutine add_sign_advice

   !> Returns a word without its quotes, doubled quotes made single.
   pure subroutine content_get_word(self, i_key, k, word)
      class(content_t), intent(in) :: self
      integer, intent(in) :: i_key, k                       !! value k of the key, of the kind `word`
      character(:), allocatable, intent(out) :: word
      character(1) :: mark
      integer :: i, n

      associate (value => self%keys(i_key)%values(k))
         if (value%last == in_words) then
            word = self%keys(i_key)%words(value%first)%value
            return
         end if
         word = self%spelling(value%first:value%last)
         mark = self%spelling(value%first - 1:value%first - 1)
      end associate
      if (index(word, mark) == 0) return
      n = 0
      i = 1
      do while (i <= len(word))
         n = n + 1
         word(n:n) = word(i:i)
         if (word(i:i) == mark) i = i + 1
         i = i + 1
      end do
      word = word(1:n)
   end subroutine content_get_word

   !> Returns a value for a message: its spelling, otherwise its number.
   pure subroutine content_get_shown(self, i_key, k, text)
      class(content_t), intent(in) :: self
      integer, intent(in) :: i_key, k                       !! value k of the key
      character(:), allocatable, intent(out) :: text

      associate (value => self%keys(i_key)%values(k))
         if (value%kind == kind_of%word) then
            call self%get_word(i_key, k, text)
            text = quote(text)
         else if (value%last >= value%first) then
            text = self%spelling(value%first:value%last)
         else if (value%kind == kind_of%whole .and. .not. self%keys(i_key)%is_real) then
            text = to_text(nint(value%number))
         else if (value%kind == kind_of%truth) then
            text = to_text(value%number > 0.0_wp)
         else
            text = to_text(value%number)
         end if
      end associate
   end subroutine content_get_shown

   !> Key with its index, for messages; indices of 0 are omitted.
   pure function element_text(key, i, j) result(text)
      character(*), intent(in) :: key
      integer, intent(in) :: i, j
      character(len(key) + merge(2 + length_of(i), 0, i > 0) + merge(2 + length_of(j), 0, i > 0 .and. j > 0)) :: text

      text = key//"("//to_text(i)//")"
      if (i > 0 .and. j > 0) text = key//"("//to_text(i)//", "//to_text(j)//")"
   end function element_text
end module hb_property_values
