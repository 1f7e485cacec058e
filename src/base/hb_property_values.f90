!> Keys of one group of properties and the values given for them: numbers, logicals and words, with their line in the file.
!>
!> Values read from a text are stored as spans of it, and repeat counts as counts, so that memory is linear in the
!> size of the file. Values set from numbers have no spelling and no line.
module hb_property_values
   use hb_kinds, only: int64, wp
   use hb_name_table, only: name_table_t
   use hb_text, only: length_of, quote, string_t, to_text
   implicit none
   private
   public :: content_t, element_text, kind_of, max_values, number_value, value_t

   integer, parameter :: max_values = 1000000               !! of one key, repeat counts included

   !> Kinds of values. A whole number is valid as an integer and as a real.
   type :: kinds_t
      integer :: none = 0                                   !! invalid spelling
      integer :: number = 1
      integer :: whole = 2
      integer :: truth = 3                                  !! 1 for true, 0 for false
      integer :: word = 4
   end type kinds_t
   type(kinds_t), parameter :: kind_of = kinds_t()

   !> One value, or a run of equal values.
   type :: value_t
      real(wp) :: number = 0.0_wp
      integer :: kind = 0                                   !! one of `kind_of`
      integer :: first = 1, last = 0                        !! span of the spelling, without quotes; empty if there is none
      integer :: line = 0                                   !! 0: set from outside; negative: set by the group &sweep of that line
      integer :: count = 1                                  !! repeat count
      integer :: i = 0, j = 0                               !! element index, 0 if there is none
      integer :: next = 0                                   !! next value of the key, 0 after the last
   end type value_t

   integer, parameter :: in_words = -1                      !! `last` of a word that is stored in `words`, at `first`

   !> One key: a chain of listed values, a chain of single elements, or (set from outside) both.
   type :: key_t
      integer :: line = 0                                   !! of its first appearance; from outside as above
      integer :: second_line = 0                            !! line of a second, invalid definition
      logical :: has_problem = .false.                      !! its reader has reported a problem
      logical :: is_real = .false.                          !! has been read as real numbers
      integer :: head = 0, tail = 0                         !! listed values
      integer :: n_listed = 0                               !! their number, repeat counts included
      integer :: element_head = 0, element_tail = 0         !! values of elements
      integer :: n_elements = 0
      integer :: asked = 0                                  !! position in the owner's list of requested keys
   end type key_t

   !> Keys and values of one group.
   type :: content_t
      character(:), allocatable :: spelling                 !! text that contains the spans of values
      type(string_t), allocatable :: words(:)               !! set from outside
      type(name_table_t) :: names                           !! of the keys
      type(key_t), allocatable :: keys(:)                   !! (capacity), names%n in use
      type(value_t), allocatable :: values(:)               !! (capacity), n_values in use
      integer :: n_values = 0
   contains
      procedure :: add_key => content_add_key
      procedure :: add_value => content_add_value
      procedure :: add_comma_advice => content_add_comma_advice
      procedure :: get_shown => content_get_shown
      procedure :: get_word => content_get_word
      procedure :: is_given => content_is_given
      procedure :: put => content_put
      procedure :: put_words => content_put_words
      procedure :: take => content_take
   end type content_t

contains

   !> Creates a number set from outside; without a fraction it is also valid as an integer.
   elemental type(value_t) function number_value(number) result(value)
      real(wp), intent(in) :: number

      value%number = number
      value%kind = kind_of%number
      if (abs(number) > real(huge(1), wp)) return
      if (abs(number - anint(number)) <= 0.0_wp) value%kind = kind_of%whole
   end function number_value

   !> Adds a key without values.
   pure subroutine content_add_key(self, name)
      class(content_t), intent(inout) :: self
      character(*), intent(in) :: name                      !! lower case, not yet a key
      type(key_t), allocatable :: larger(:)

      if (.not. allocated(self%keys)) allocate (self%keys(8))
      if (self%names%n == size(self%keys)) then
         allocate (larger(2*self%names%n))
         larger(1:self%names%n) = self%keys
         call move_alloc(larger, self%keys)
      end if
      call self%names%add(name)
   end subroutine content_add_key

   !> Appends a value to key number `i_key`.
   pure subroutine content_add_value(self, i_key, value)
      class(content_t), intent(inout) :: self
      integer, intent(in) :: i_key
      type(value_t), intent(in) :: value
      type(value_t), allocatable :: larger(:)
      integer :: n

      n = self%n_values + 1
      if (.not. allocated(self%values)) allocate (self%values(8))
      if (n > size(self%values)) then
         allocate (larger(2*n))
         larger(1:n - 1) = self%values
         call move_alloc(larger, self%values)
      end if
      self%n_values = n
      self%values(n) = value
      self%values(n)%next = 0
      associate (key => self%keys(i_key))
         if (value%i > 0) then
            if (key%element_head == 0) key%element_head = n
            if (key%element_tail > 0) self%values(key%element_tail)%next = n
            key%element_tail = n
            key%n_elements = key%n_elements + 1
         else
            if (key%head == 0) key%head = n
            if (key%tail > 0) self%values(key%tail)%next = n
            key%tail = n
            key%n_listed = key%n_listed + value%count
         end if
      end associate
   end subroutine content_add_value

   !> Replaces values of a key from outside: one element, or the whole list.
   pure subroutine content_put(self, name, values, has_changed)
      class(content_t), intent(inout) :: self
      character(*), intent(in) :: name                      !! lower case
      type(value_t), intent(in) :: values(:)                !! a list, or one value with an index
      logical, intent(inout) :: has_changed                 !! set to true if a value changes
      type(key_t) :: emptied
      integer :: i_key, i_value, k, n
      logical :: is_element

      i_key = self%names%find(name)
      if (i_key == 0) then
         call self%add_key(name)
         i_key = self%names%n
      end if
      self%keys(i_key)%line = 0
      if (size(values) > 0) self%keys(i_key)%line = values(1)%line
      is_element = .false.
      if (size(values) == 1) is_element = values(1)%i > 0
      call find_present(self, i_key, values, is_element, i_value, n)
      if (n /= size(values)) then
         has_changed = .true.
         if (.not. is_element) then
            emptied%asked = self%keys(i_key)%asked
            emptied%second_line = self%keys(i_key)%second_line
            emptied%line = self%keys(i_key)%line
            self%keys(i_key) = emptied
         end if
         do k = 1, size(values)
            call self%add_value(i_key, values(k))
         end do
         return
      end if
      if (.not. is_element) self%keys(i_key)%n_listed = sum(values%count)
      do k = 1, n                                           ! in place: nothing grows when a value is set repeatedly
         associate (old => self%values(i_value))
            has_changed = has_changed .or. old%kind /= values(k)%kind .or. old%count /= values(k)%count .or. &
                          old%kind == kind_of%word .or. old%kind == kind_of%none .or. &
                          transfer(old%number, 1_int64) /= transfer(values(k)%number, 1_int64)
            n = old%next
            old = values(k)
            old%next = n
            i_value = n
         end associate
      end do
   end subroutine content_put

   !> Finds the present values of a key that given ones replace: the first of them and their number; more than given
   !> if the key has more.
   pure subroutine find_present(self, i_key, values, is_element, i_value, n)
      class(content_t), intent(in) :: self
      integer, intent(in) :: i_key
      type(value_t), intent(in) :: values(:)
      logical, intent(in) :: is_element                     !! the single value has an index
      integer, intent(out) :: i_value, n

      associate (key => self%keys(i_key))
         if (is_element) then
            i_value = key%element_head
            do while (i_value > 0)
               associate (old => self%values(i_value))
                  if (old%i == values(1)%i .and. old%j == values(1)%j) exit
                  i_value = old%next
               end associate
            end do
            n = merge(1, 0, i_value > 0)
         else
            n = 0
            i_value = key%head
            do while (i_value > 0 .and. key%n_elements == 0 .and. n <= size(values))
               n = n + 1
               i_value = self%values(i_value)%next
            end do
            i_value = key%head
         end if
      end associate
   end subroutine find_present

   !> Replaces all values of a key by words from outside.
   pure subroutine content_put_words(self, name, words, has_changed, element, line)
      class(content_t), intent(inout) :: self
      character(*), intent(in) :: name                      !! lower case
      type(string_t), intent(in) :: words(:)
      logical, intent(inout) :: has_changed
      integer, intent(in), optional :: element(2)           !! of the single word, 0 for missing indices
      integer, intent(in), optional :: line                 !! as in `value_t`
      type(value_t) :: values(size(words))
      type(string_t), allocatable :: longer(:)
      integer :: i_key, i_value, k, n, reused

      if (present(element)) then
         values%i = element(1)
         values%j = element(2)
      end if
      if (present(line)) values%line = line
      reused = 0
      i_key = self%names%find(name)
      if (i_key > 0 .and. size(words) == 1 .and. all(values%i == 0)) then
         i_value = self%keys(i_key)%head
         if (i_value > 0) then
            if (self%values(i_value)%last == in_words .and. self%values(i_value)%next == 0) reused = self%values(i_value)%first
         end if
      end if
      if (.not. allocated(self%words)) allocate (self%words(0))
      values%kind = kind_of%word
      values%last = in_words
      if (reused > 0) then
         has_changed = has_changed .or. self%words(reused)%value /= words(1)%value .or. &
                       len(self%words(reused)%value) /= len(words(1)%value)
         self%words(reused) = words(1)
         return
      end if
      n = size(self%words)
      allocate (longer(n + size(words)))
      longer(:n) = self%words
      do k = 1, size(words)
         longer(n + k) = words(k)
         values(k)%first = n + k
      end do
      call move_alloc(longer, self%words)
      has_changed = .true.
      call self%put(name, values, has_changed)
   end subroutine content_put_words

   !> Copies the only key of `other`: all its values, or one element.
   pure subroutine content_take(self, other, has_changed)
      class(content_t), intent(inout) :: self
      type(content_t), intent(in) :: other
      logical, intent(inout) :: has_changed
      type(value_t) :: values(other%n_values)
      integer :: shift

      shift = 0
      if (allocated(self%spelling)) shift = len(self%spelling)
      values = other%values(1:other%n_values)
      where (values%last /= in_words)
         values%first = values%first + shift
         values%last = values%last + shift
      end where
      values%line = 0
      if (shift > 0) then
         self%spelling = self%spelling//other%spelling
      else
         self%spelling = other%spelling
      end if
      call self%put(trim(other%names%names(1)), values, has_changed)
   end subroutine content_take

   !> Whether key number `i_key` has a value.
   pure logical function content_is_given(self, i_key) result(is_given)
      class(content_t), intent(in) :: self
      integer, intent(in) :: i_key

      is_given = .false.
      if (i_key > 0) is_given = self%keys(i_key)%head > 0 .or. self%keys(i_key)%element_head > 0
   end function content_is_given

   !> Adds advice to a message if a value of a key of real numbers looks like the first half of a number with a
   !> decimal comma: `1,5e-3` is two values.
   pure subroutine content_add_comma_advice(self, i_key, message)
      class(content_t), intent(in) :: self
      integer, intent(in) :: i_key
      character(:), allocatable, intent(inout) :: message
      integer :: comma, first, i, last

      i = 0
      if (self%keys(i_key)%is_real) i = self%keys(i_key)%head
      do while (i > 0)
         associate (value => self%values(i))
            comma = value%last + 1
            first = 0                                       ! of the next value
            if (value%next > 0) first = self%values(value%next)%first
            if (first == comma + 1 .and. value%kind == kind_of%whole .and. value%last >= value%first) then
               last = self%values(value%next)%last
               if (self%spelling(comma:comma) == "," .and. scan(self%spelling(first:first), "0123456789") > 0) then
                  message = message//"; if "//self%spelling(value%first:last)//" is one number, write it with a point: "// &
                     self%spelling(value%first:value%last)//"."//self%spelling(first:last)
                  return
               end if
            end if
            i = value%next
         end associate
      end do
   end subroutine content_add_comma_advice

   !> Returns a word without its quotes, doubled quotes made single.
   pure subroutine content_get_word(self, i_value, word)
      class(content_t), intent(in) :: self
      integer, intent(in) :: i_value                        !! of the kind `word`
      character(:), allocatable, intent(out) :: word
      character(1) :: mark
      integer(int64) :: first, i, last, n

      first = int(self%values(i_value)%first, int64)
      last = int(self%values(i_value)%last, int64)
      if (last == in_words) then
         word = self%words(first)%value
         return
      end if
      word = self%spelling(first:last)
      mark = self%spelling(first - 1:first - 1)
      if (index(word, mark) == 0) return
      n = 0
      i = 1
      do while (i <= last - first + 1)
         n = n + 1
         word(n:n) = word(i:i)
         if (word(i:i) == mark) i = i + 1
         i = i + 1
      end do
      word = word(1:n)
   end subroutine content_get_word

   !> Returns a value for a message: its spelling, otherwise its number.
   pure subroutine content_get_shown(self, i_value, text)
      class(content_t), intent(in) :: self
      integer, intent(in) :: i_value
      character(:), allocatable, intent(out) :: text

      associate (value => self%values(i_value))
         if (value%kind == kind_of%word) then
            call self%get_word(i_value, text)
            text = quote(text)
         else if (value%last >= value%first) then
            text = self%spelling(value%first:value%last)
         else if (value%kind == kind_of%whole) then
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
