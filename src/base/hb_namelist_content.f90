!> Body of one group of a namelist file: its keys with their values, as written.
!>
!> Values stay as spans of the text, repeat counts stay counts, so memory is linear in the size of the file.
module hb_namelist_content
   use hb_kinds, only: int64
   use hb_namelist_index, only: name_table_t
   use hb_text, only: to_text
   implicit none
   private
   public :: content_t, element_text, key_t, max_values, value_t

   integer, parameter :: max_values = 1000000               !! of one key, repeat counts included

   !> One value, or equal values in a row, as written.
   type :: value_t
      integer :: first = 1, last = 0                        !! span in the text, without quotes
      integer :: line = 0                                   !! 0: set from outside; below 0: by the group &sweep of that line
      integer :: count = 1                                  !! repeat count
      integer :: i = 0, j = 0                               !! element index, 0 where there is none
      integer :: next = 0                                   !! next value of the key, 0 after the last
      logical :: is_quoted = .false.
   end type value_t

   !> One key: a chain of listed values, a chain of single elements, or (set from outside) both.
   type :: key_t
      integer :: line = 0                                   !! of its first appearance; from outside as above
      integer :: second_line = 0                            !! line where the key is wrongly given again
      logical :: has_problem = .false.                      !! its reader has said what is wrong with it
      logical :: is_real = .false.                          !! has been read as real numbers
      integer :: head = 0, tail = 0                         !! listed values
      integer :: n_listed = 0                               !! their number, repeat counts included
      integer :: element_head = 0, element_tail = 0         !! values of elements
      integer :: n_elements = 0
      integer :: asked = 0                                  !! position in the owner's list of asked keys
   end type key_t

   !> Body of one group.
   type :: content_t
      character(:), allocatable :: text
      type(name_table_t) :: names                           !! of the keys
      type(key_t), allocatable :: keys(:)                   !! (capacity), names%n in use
      type(value_t), allocatable :: values(:)               !! (capacity), n_values in use
      integer :: n_values = 0
   contains
      procedure :: add_key => content_add_key
      procedure :: add_value => content_add_value
      procedure :: comma_advice => content_comma_advice
      procedure :: is_given => content_is_given
      procedure :: override => content_override
      procedure :: word => content_word
   end type content_t

contains

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
      if (n > size(self%values)) then
         allocate (larger(2*n))
         larger(1:n - 1) = self%values
         call move_alloc(larger, self%values)
      end if
      self%n_values = n
      self%values(n) = value
      call link_value(self, i_key, n)
   end subroutine content_add_value

   !> Hangs value `n` into the chain of its key.
   pure subroutine link_value(self, i_key, n)
      class(content_t), intent(inout) :: self
      integer, intent(in) :: i_key, n

      associate (key => self%keys(i_key))
         self%values(n)%next = 0
         if (self%values(n)%i > 0) then
            if (key%element_head == 0) key%element_head = n
            if (key%element_tail > 0) self%values(key%element_tail)%next = n
            key%element_tail = n
            key%n_elements = key%n_elements + 1
         else
            if (key%head == 0) key%head = n
            if (key%tail > 0) self%values(key%tail)%next = n
            key%tail = n
            key%n_listed = key%n_listed + self%values(n)%count
         end if
      end associate
   end subroutine link_value

   !> Puts the only key of `other` in the place of the same key of `self`: all its values, or one element.
   pure subroutine content_override(self, other, line)
      class(content_t), intent(inout) :: self
      type(content_t), intent(in) :: other
      integer, intent(in) :: line                           !! 0, or -line of the group &sweep that gives the values
      type(value_t), allocatable :: larger(:)
      integer :: asked, i, i_key, n, same, second_line, shift

      i_key = self%names%find(other%names%names(1))
      if (i_key == 0) then
         call self%add_key(other%names%names(1))
         i_key = self%names%n
      else if (other%keys(1)%head > 0) then
         asked = self%keys(i_key)%asked
         second_line = self%keys(i_key)%second_line
         self%keys(i_key) = key_t(asked=asked, second_line=second_line)
      end if
      self%keys(i_key)%line = line
      shift = 0
      if (allocated(self%text)) then
         shift = len(self%text)
         self%text = self%text//other%text
      else
         self%text = other%text
      end if
      allocate (larger(self%n_values + other%n_values))
      if (self%n_values > 0) larger(1:self%n_values) = self%values(1:self%n_values)
      call move_alloc(larger, self%values)
      do i = 1, other%n_values
         n = self%n_values + 1
         self%n_values = n
         self%values(n) = other%values(i)
         self%values(n)%first = other%values(i)%first + shift
         self%values(n)%last = other%values(i)%last + shift
         self%values(n)%line = line
         self%values(n)%next = 0
         same = 0
         if (other%values(i)%i > 0) same = self%keys(i_key)%element_head
         do while (same > 0)
            associate (old => self%values(same), new => other%values(i))
               if (old%i == new%i .and. old%j == new%j) exit
               same = old%next
            end associate
         end do
         if (same > 0) then
            self%values(n)%next = self%values(same)%next
            self%values(same) = self%values(n)
         else
            call link_value(self, i_key, n)
         end if
      end do
   end subroutine content_override

   !> Whether key number `i_key` has a value.
   pure logical function content_is_given(self, i_key) result(is_given)
      class(content_t), intent(in) :: self
      integer, intent(in) :: i_key

      is_given = .false.
      if (i_key > 0) is_given = self%keys(i_key)%head > 0 .or. self%keys(i_key)%element_head > 0
   end function content_is_given

   !> What to say where a value of a key of real numbers looks like the first half of a number with a decimal comma:
   !> `1,5e-3` is two values. From value number `i_value` on, or of that alone; empty where none looks so.
   pure function content_comma_advice(self, i_key, i_value, only_this) result(advice)
      class(content_t), intent(in) :: self
      integer, intent(in) :: i_key, i_value
      logical, intent(in) :: only_this
      character(:), allocatable :: advice
      character(*), parameter :: digits = "0123456789"
      integer :: comma, first, i, last

      advice = ""
      i = i_value
      if (.not. self%keys(i_key)%is_real) i = 0
      do while (i > 0)
         associate (value => self%values(i), text => self%text)
            comma = value%last + 1
            first = 0                                       ! of the value behind
            if (value%next > 0) first = self%values(value%next)%first
            if (first == comma + 1 .and. verify(text(value%first:value%last), "+-"//digits) == 0) then
               last = self%values(value%next)%last
               if (text(comma:comma) == "," .and. index(digits, text(first:first)) > 0) then
                  advice = "; if "//text(value%first:last)//" is one number, write it with a point: "// &
                     text(value%first:value%last)//"."//text(first:last)
                  return
               end if
            end if
            i = value%next
            if (only_this) return
         end associate
      end do
   end function content_comma_advice

   !> Text of value number `i_value`; of a quoted one without its quotes, doubled quotes made single.
   pure function content_word(self, i_value) result(word)
      class(content_t), intent(in) :: self
      integer, intent(in) :: i_value
      character(:), allocatable :: word
      character(1) :: mark
      integer(int64) :: first, i, last, n

      first = int(self%values(i_value)%first, int64)
      last = int(self%values(i_value)%last, int64)
      word = self%text(first:last)
      if (.not. self%values(i_value)%is_quoted) return
      mark = self%text(first - 1:first - 1)
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
   end function content_word

   !> Key with an index behind it, for messages; indices of 0 are left out.
   pure function element_text(key, i, j) result(text)
      character(*), intent(in) :: key
      integer, intent(in) :: i, j
      character(:), allocatable :: text

      text = key
      if (i > 0 .and. j > 0) then
         text = key//"("//to_text(i)//", "//to_text(j)//")"
      else if (i > 0) then
         text = key//"("//to_text(i)//")"
      end if
   end function element_text
end module hb_namelist_content
