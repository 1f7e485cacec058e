!> Properties: one group of named values, from which laws, structures and settings are read.
!>
!> A namelist file (hb_namelist) or a caller with numbers fills them:
!>
!>     call law%set("gap", 1.5e-3_wp)
!>     call law%get("gap", gap)
!>     call law%finish(error)
!>
!> `get` returns the value of a key if it is given, otherwise its default. Default, unit, limits, choices and whether
!> the key is required are taken from the table of keys (hb_input_keys); if the table has no default, the variable
!> keeps its value. Problems are collected instead of returning an error at every call: `finish` reports all of them
!> at once, together with the keys that no reader requested. After a problem the value is the default.
module hb_properties
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_input_keys, only: kind_of, limits_t, rule_t
   use hb_kinds, only: wp
   use hb_property_order, only: any_length, element_at, matrix_text, pick
   use hb_property_record, only: missing_key, record_t, request, value_problem
   use hb_property_values, only: key_t, number_value, value_t
   use hb_similar_word, only: closest_word
   use hb_text, only: join, lower, quote, shown, string_t, to_text
   implicit none
   private
   public :: new_properties, properties_t

   integer, parameter :: single_value(0) = [integer ::]     !! extents, as for `pick`

   type, extends(record_t) :: properties_t
   contains
      generic :: get => get_real, get_integer, get_logical, get_word, get_reals, get_integers, get_logicals, get_words, get_matrix
      generic :: set => set_one, set_list, set_matrix
      procedure :: choose => properties_choose
      procedure :: find_limits => properties_find_limits
      procedure :: note_number => properties_note_number
      procedure, private :: get_real => properties_get_real
      procedure, private :: get_integer => properties_get_integer
      procedure, private :: get_logical => properties_get_logical
      procedure, private :: get_word => properties_get_word
      procedure, private :: get_reals => properties_get_reals
      procedure, private :: get_integers => properties_get_integers
      procedure, private :: get_logicals => properties_get_logicals
      procedure, private :: get_words => properties_get_words
      procedure, private :: get_matrix => properties_get_matrix
      procedure, private :: set_one => properties_set_one
      procedure, private :: set_list => properties_set_list
      procedure, private :: set_matrix => properties_set_matrix
   end type properties_t

contains

   !> Creates a group without values; `file_name` is empty and `line` 0 if it is not from a file.
   pure subroutine new_properties(self, name, file_name, line)
      type(properties_t), intent(out) :: self
      character(*), intent(in) :: name                      !! lower case
      character(*), intent(in) :: file_name
      integer, intent(in) :: line

      self%name = name
      self%file_name = file_name
      self%line = line
   end subroutine new_properties

   !> Reads a real; NaN and infinity are problems. `required` and `unit`, if present, override the table.
   pure subroutine properties_get_real(self, key, value, required, unit)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      real(wp), intent(inout) :: value
      logical, intent(in), optional :: required             !! the key must be given
      character(*), intent(in), optional :: unit
      real(wp), allocatable :: numbers(:)
      integer :: i_key

      allocate (numbers, source=[value])
      call read_numbers(self, key, kind_of%number, single_value, numbers, required, i_key)
      value = numbers(1)
      if (present(unit)) self%content%keys(i_key)%unit = unit
   end subroutine properties_get_real

   !> Reads an integer.
   pure subroutine properties_get_integer(self, key, value, required)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      integer, intent(inout) :: value
      logical, intent(in), optional :: required
      real(wp), allocatable :: numbers(:)

      allocate (numbers, source=[real(value, wp)])
      call read_numbers(self, key, kind_of%whole, single_value, numbers, required)
      value = nint(numbers(1))
   end subroutine properties_get_integer

   !> Reads a logical.
   pure subroutine properties_get_logical(self, key, value)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, intent(inout) :: value
      real(wp), allocatable :: numbers(:)

      allocate (numbers, source=[number_of_truth(value)])
      call read_numbers(self, key, kind_of%truth, single_value, numbers)
      value = numbers(1) > 0.0_wp
   end subroutine properties_get_logical

   !> Reads a word; a choice may have any case and is returned as spelt in the table.
   pure subroutine properties_get_word(self, key, value, required)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      character(:), allocatable, intent(inout) :: value
      logical, intent(in), optional :: required
      type(string_t), allocatable :: words(:)

      if (allocated(value)) call set_word(words, value)
      call read_words(self, key, single_value, words, required)
      if (allocated(words)) value = words(1)%value
   end subroutine properties_get_word

   !> Reads a word that is one of several choices, as its number in the table.
   pure subroutine properties_choose(self, key, choice)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key                       !! with a default in the table
      integer, intent(out) :: choice
      type(string_t), allocatable :: words(:)
      integer :: i_key

      call read_words(self, key, single_value, words, i_key=i_key)
      choice = findloc(self%content%keys(i_key)%rule%choices == words(1)%value, .true., dim=1)
   end subroutine properties_choose

   !> Finds the limits of a number of a key. `is_number` is false unless the key has been read as a real number, or as a list
   !> that has this element, or no other one.
   pure subroutine properties_find_limits(self, key, element, is_number, minimum, maximum, above)
      class(properties_t), intent(in) :: self
      character(*), intent(in) :: key                       !! lower case
      integer, intent(in) :: element(2)                     !! indices, 0 where there is none
      logical, intent(out) :: is_number
      real(wp), intent(out) :: minimum, maximum             !! inclusive
      real(wp), intent(out) :: above                        !! exclusive
      integer :: i

      minimum = -huge(1.0_wp)
      maximum = huge(1.0_wp)
      above = -huge(1.0_wp)
      i = self%content%names%find(key)
      is_number = i > 0
      if (.not. is_number) return
      associate (read_key => self%content%keys(i))
         is_number = read_key%requested > 0 .and. read_key%kind == kind_of%number .and. allocated(read_key%rule) .and. &
                     allocated(read_key%numbers)
         if (.not. is_number) return
         is_number = index_of(read_key, element) <= size(read_key%numbers) .and. &
                     (any(element > 0) .or. size(read_key%numbers) == 1)
         minimum = read_key%rule%limits%minimum
         maximum = read_key%rule%limits%maximum
         above = read_key%rule%limits%above
      end associate
   end subroutine properties_find_limits

   !> Index of an element among the numbers of a key, row by row.
   pure integer function index_of(key, element)
      type(key_t), intent(in) :: key
      integer, intent(in) :: element(2)

      index_of = max(1, element(1))
      if (element(2) > 0) index_of = (element(1) - 1)*key%row_length + element(2)
   end function index_of

   !> Stores the number that an object uses, without its having been read.
   pure subroutine properties_note_number(self, key, element, number)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key                       !! that has been read, lower case
      integer, intent(in) :: element(2)                     !! indices, 0 where there is none
      real(wp), intent(in) :: number
      integer :: i

      associate (read_key => self%content%keys(self%content%names%find(key)))
         i = index_of(read_key, element)
         if (i <= size(read_key%numbers)) read_key%numbers(i) = number
      end associate
   end subroutine properties_note_number

   !> Reads a list of reals of any length, or of length `n`.
   pure subroutine properties_get_reals(self, key, value, n, required)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      real(wp), allocatable, intent(inout) :: value(:)
      integer, intent(in), optional :: n
      logical, intent(in), optional :: required

      call read_numbers(self, key, kind_of%number, list_of(n), value, required)
   end subroutine properties_get_reals

   !> Reads a list of integers of any length, or of length `n`.
   pure subroutine properties_get_integers(self, key, value, n, required)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      integer, allocatable, intent(inout) :: value(:)
      integer, intent(in), optional :: n
      logical, intent(in), optional :: required
      real(wp), allocatable :: numbers(:)

      if (allocated(value)) numbers = real(value, wp)
      call read_numbers(self, key, kind_of%whole, list_of(n), numbers, required)
      if (allocated(numbers)) value = nint(numbers)
   end subroutine properties_get_integers

   !> Reads a list of logicals of any length.
   pure subroutine properties_get_logicals(self, key, value)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, allocatable, intent(inout) :: value(:)
      real(wp), allocatable :: numbers(:)

      if (allocated(value)) numbers = number_of_truth(value)
      call read_numbers(self, key, kind_of%truth, list_of(), numbers)
      if (allocated(numbers)) value = numbers > 0.0_wp
   end subroutine properties_get_logicals

   !> Reads a list of words of any length, or of length `n`; choices as for one word.
   pure subroutine properties_get_words(self, key, value, n, required)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      type(string_t), allocatable, intent(inout) :: value(:)
      integer, intent(in), optional :: n
      logical, intent(in), optional :: required

      call read_words(self, key, list_of(n), value, required)
   end subroutine properties_get_words

   !> Reads a real matrix of `n` rows and `m` columns, listed row by row, or element by element as key(i, j).
   pure subroutine properties_get_matrix(self, key, value, n, m, required)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      real(wp), allocatable, intent(inout) :: value(:, :)   !! (n, m)
      integer, intent(in) :: n, m
      logical, intent(in), optional :: required
      real(wp), allocatable :: numbers(:)

      if (allocated(value)) numbers = row_by_row(value)
      call read_numbers(self, key, kind_of%number, [n, m], numbers, required)
      if (.not. allocated(numbers)) return
      if (size(numbers) == n*m) value = reshape(numbers, [n, m], order=[2, 1])
   end subroutine properties_get_matrix

   !> Sets a key to one value (real, integer, logical or word), which replaces all its values.
   pure subroutine properties_set_one(self, key, value)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      class(*), intent(in) :: value
      type(string_t), allocatable :: words(:)

      select type (value)
      type is (real(wp)); call self%set(key, [value])
      type is (integer); call self%set(key, [value])
      type is (logical); call self%set(key, [value])
      type is (character(*))
         call set_word(words, value)
         call self%set(key, words)
      end select
   end subroutine properties_set_one

   !> Sets a key to a list of reals, integers, logicals or words.
   pure subroutine properties_set_list(self, key, value)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      class(*), intent(in) :: value(:)
      type(value_t) :: values(size(value))

      select type (value)
      type is (real(wp))
         values = number_value(value)
      type is (integer)
         values = number_value(real(value, wp))
      type is (logical)
         values%kind = kind_of%truth
         values%number = number_of_truth(value)
      type is (string_t)
         call self%content%replace_words(lower(trim(key)), value, self%has_changed)
         return
      end select
      call self%content%replace(lower(trim(key)), values, self%has_changed)
   end subroutine properties_set_list

   !> Sets a key to a matrix.
   pure subroutine properties_set_matrix(self, key, value)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      real(wp), intent(in) :: value(:, :)

      call self%set(key, row_by_row(value))
   end subroutine properties_set_matrix

   ! Messages for values that do not comply with the table

   !> Whether a value has the required kind, is finite and within the limits.
   pure logical function suits(value, kind, limits)
      type(value_t), intent(in) :: value
      integer, intent(in) :: kind
      type(limits_t), intent(in) :: limits

      suits = value%kind == kind .or. (value%kind == kind_of%whole .and. kind == kind_of%number)
      if (suits) suits = ieee_is_finite(value%number)
      if (suits) suits = value%number >= limits%minimum .and. value%number <= limits%maximum .and. &
                         (value%number > limits%above .or. limits%above <= -huge(1.0_wp))
   end function suits

   !> Error text for a value that does not comply, padded with blanks.
   pure function error_text(value, kind, limits) result(text)
      type(value_t), intent(in) :: value
      integer, intent(in) :: kind
      type(limits_t), intent(in) :: limits
      character(80) :: text

      if (kind == kind_of%truth) then
         text = "must be .true. or .false."
      else if (value%kind == kind_of%word) then
         text = "must be "//trim(what(kind, single_value))//", without quotes"
      else if (kind == kind_of%whole .and. value%kind /= kind_of%whole) then
         text = "must be an integer like 3, at most "//to_text(huge(1))
      else if (.not. any(value%kind == [kind_of%number, kind_of%whole])) then
         text = "must be a real number like 1.5e-3, below 1.8e308"
      else if (.not. ieee_is_finite(value%number)) then
         text = "must be finite"
      else if (value%number < limits%minimum) then
         text = "must be "//trim(limit_text(limits%minimum))//" or greater"
      else if (value%number > limits%maximum) then
         text = "must be "//trim(limit_text(limits%maximum))//" or less"
      else
         text = "must be above "//limit_text(limits%above)
      end if

   contains

      pure character(24) function limit_text(limit)
         real(wp), intent(in) :: limit

         limit_text = to_text(limit)
         if (kind == kind_of%whole) limit_text = to_text(nint(limit))
      end function limit_text
   end function error_text

   !> The requirement of a key, for messages, padded with blanks.
   pure function what(kind, extents) result(text)
      integer, intent(in) :: kind
      integer, intent(in) :: extents(:)                     !! as for `pick`
      character(80) :: text
      character(25), parameter :: one(4) = [character(25) :: "a real number", "an integer", ".true. or .false.", &
                                            "a text in quotes"]
      character(25), parameter :: many(4) = [character(25) :: "real numbers", "integers", ".true. and .false.", &
                                             "texts such as 'x1'"]

      select case (size(extents))
      case (0)
         text = one(kind)
      case (1)
         text = "a list of "//trim(many(kind))
      case default
         text = "a matrix of "//matrix_text(extents(1), extents(2))//", row by row"
      end select
   end function what

   ! Reading

   !> Replaces the default by the numbers of a key: all of them, or none after a problem. Stores the values that are
   !> used.
   pure subroutine read_numbers(self, key, kind, extents, numbers, required, i_key)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      integer, intent(in) :: kind                           !! one of `kind_of`
      integer, intent(in) :: extents(:)                     !! as for `pick`
      real(wp), allocatable, intent(inout) :: numbers(:)    !! row by row; not allocated: no default
      logical, intent(in), optional :: required
      integer, intent(out), optional :: i_key               !! number of the key
      real(wp), allocatable :: found(:)
      integer, allocatable :: order(:)
      integer :: i, k

      call find(self, key, kind, extents, required, i, order)
      if (present(i_key)) i_key = i
      associate (requested => self%content%keys(i))
         call set_default(requested%rule, extents, numbers)
         if (allocated(order)) then
            found = requested%values(order)%number
            do k = 1, size(order)
               if (suits(requested%values(order(k)), kind, requested%rule%limits)) cycle
               call value_problem(self, i, order(k), element_at(k, extents), &
                                  trim(error_text(requested%values(order(k)), kind, requested%rule%limits)))
               deallocate (found)
               exit
            end do
         end if
         if (allocated(found)) then
            call move_alloc(found, numbers)
         else if (must_be_given(requested%rule, required) .or. .not. allocated(numbers)) then
            return
         end if
         requested%kind = kind
         requested%numbers = numbers
         requested%row_length = size(numbers)
         if (size(extents) == 2) requested%row_length = extents(2)
      end associate
   end subroutine read_numbers

   !> Replaces the default of the reader by that of the table, once for each value that exists or is required. A
   !> required single number is 0 after a problem.
   pure subroutine set_default(rule, extents, numbers)
      type(rule_t), intent(in) :: rule
      integer, intent(in) :: extents(:)                     !! as for `pick`
      real(wp), allocatable, intent(inout) :: numbers(:)
      integer :: n

      n = 1
      if (allocated(numbers)) n = size(numbers)
      if (size(extents) == 1) n = merge(n, extents(1), extents(1) == any_length)
      if (.not. allocated(rule%numbers)) then
         if (rule%is_required .and. size(extents) == 0) numbers = [0.0_wp]
      else if (size(rule%numbers) > 1) then
         numbers = rule%numbers
      else
         numbers = spread(rule%numbers(1), 1, n)
      end if
   end subroutine set_default

   !> Replaces the default by the words of a key, as `read_numbers` does.
   pure subroutine read_words(self, key, extents, words, required, i_key)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      integer, intent(in) :: extents(:)                     !! as for `pick`
      type(string_t), allocatable, intent(inout) :: words(:)
      logical, intent(in), optional :: required
      integer, intent(out), optional :: i_key               !! number of the key
      type(string_t), allocatable :: found(:)
      character(:), allocatable :: problem
      integer, allocatable :: order(:)
      integer :: i, k

      call find(self, key, kind_of%word, extents, required, i, order)
      if (present(i_key)) i_key = i
      associate (requested => self%content%keys(i))
         if (allocated(requested%rule%word)) then
            if (.not. allocated(words)) allocate (words(1))
            do k = 1, size(words)
               words(k)%value = requested%rule%word
            end do
         end if
         if (allocated(order)) then
            allocate (found(size(order)))
            do k = 1, size(order)
               call read_word(self, i, order(k), found(k)%value, problem)
               if (problem == "") cycle
               call value_problem(self, i, order(k), element_at(k, extents), problem)
               deallocate (found)
               exit
            end do
         end if
         if (allocated(found)) call move_alloc(found, words)
         if (.not. allocated(words)) return
         requested%kind = kind_of%word
         requested%texts = words
         requested%row_length = size(words)
      end associate
   end subroutine read_words

   !> Reads value `k` of a key as one word, as the table spells it.
   pure subroutine read_word(self, i_key, k, word, problem)
      class(properties_t), intent(in) :: self
      integer, intent(in) :: i_key, k
      character(:), allocatable, intent(out) :: word, problem
      character(:), allocatable :: bare
      integer :: i

      problem = ""
      associate (rule => self%content%keys(i_key)%rule, kind => self%content%keys(i_key)%values(k)%kind)
         if (kind /= kind_of%word) then
            call self%content%get_shown(i_key, k, word)
            bare = word
            call drop_marks(bare)
            ! a name may be a number, such as that of a degree of freedom
            if (kind == kind_of%whole .and. .not. allocated(rule%choices)) return
            problem = "needs quotes: "//quote(shown(bare))
            if (self%content%keys(i_key)%values(k)%line < 0) problem = "is a number, but this key takes a text: give the "// &
               "&sweep 'texts' instead of 'values' or 'from', 'to' and 'n'"
            return
         end if
         call self%content%get_word(i_key, k, word)
         if (.not. allocated(rule%choices)) return
         do i = 1, size(rule%choices)
            if (rule%choices(i) /= lower(word)) cycle
            word = trim(rule%choices(i))
            return
         end do
         problem = trim(closest_word(word, rule%choices))
         if (problem /= "") problem = " did you mean '"//problem//"'?"
         problem = "is not known;"//problem//" known: "//join(rule%choices, ", ")
      end associate
   end subroutine read_word

   !> Removes quotation marks of typography, UTF-8 from U+2018 to U+201F, which are no quotes of an input.
   pure subroutine drop_marks(word)
      character(:), allocatable, intent(inout) :: word
      integer :: i

      do i = len(word) - 2, 1, -1
         if (i + 2 > len(word)) cycle                              ! a mark behind it is gone
         if (word(i:i + 1) /= char(226)//char(128)) cycle
         if (iachar(word(i + 2:i + 2)) >= 152 .and. iachar(word(i + 2:i + 2)) <= 159) word = word(:i - 1)//word(i + 3:)
      end do
   end subroutine drop_marks

   !> Requests a key; `order` contains the positions of its values, and is not allocated if there are none, too few or
   !> too many.
   pure subroutine find(self, key, kind, extents, required, i_key, order)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      integer, intent(in) :: kind
      integer, intent(in) :: extents(:)                     !! as for `pick`
      logical, intent(in), optional :: required
      integer, intent(out) :: i_key
      integer, allocatable, intent(out) :: order(:)
      character(:), allocatable :: choices

      call request(self, key, i_key)
      associate (rule => self%content%keys(i_key)%rule)
         if (all(rule%kind /= [kind, kind_of%none]) .and. (rule%kind /= kind_of%whole .or. kind /= kind_of%number)) &
            call self%problem(key, "is "//trim(what(rule%kind, extents))//" in the table of keys, and read as "// &
                              trim(what(kind, extents)))
         if (self%content%is_given(i_key)) then
            self%content%keys(i_key)%is_real = kind == kind_of%number
            call pick(self, i_key, extents, order)
         else if (must_be_given(rule, required)) then
            choices = ""
            if (allocated(rule%choices)) choices = ": "//join(rule%choices, ", ")
            call missing_key(self, key, trim(what(kind, extents))//choices)
         end if
      end associate
   end subroutine find

   pure logical function must_be_given(rule, required)
      type(rule_t), intent(in) :: rule
      logical, intent(in), optional :: required             !! overrides the rule

      must_be_given = rule%is_required
      if (present(required)) must_be_given = required
   end function must_be_given

   pure subroutine set_word(words, word)
      type(string_t), allocatable, intent(out) :: words(:)
      character(*), intent(in) :: word

      allocate (words(1))
      words(1)%value = word
   end subroutine set_word

   !> Extents of a list, with or without a given length.
   pure function list_of(n) result(extents)
      integer, intent(in), optional :: n
      integer :: extents(1)

      extents = any_length
      if (present(n)) extents = n
   end function list_of

   elemental real(wp) function number_of_truth(truth) result(number)
      logical, intent(in) :: truth

      number = merge(1.0_wp, 0.0_wp, truth)
   end function number_of_truth

   pure function row_by_row(matrix) result(numbers)
      real(wp), intent(in) :: matrix(:, :)
      real(wp), allocatable :: numbers(:)

      numbers = reshape(transpose(matrix), [size(matrix)])
   end function row_by_row
end module hb_properties
