!> Properties: one group of named values, from which laws, structures and settings are read.
!>
!> Whoever makes them, a namelist file (hb_namelist) or a caller with numbers:
!>
!>     call law%set("gap", 1.5e-3_wp)
!>     call law%get("gap", gap, required=.true., unit="m", limits=limits_t(minimum=0.0_wp))
!>     call law%finish(error)
!>
!> `get` takes the value of a key when it is there, else what the variable holds is the default; it collects what is wrong
!> instead of returning an error at every call. `finish` reports all of it at once, together with the keys that nobody asked
!> for. After a problem the value is untouched.
module hb_properties
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_closest_word, only: closest_word
   use hb_kinds, only: wp
   use hb_property_order, only: any_length, element_at, matrix_text, pick
   use hb_property_record, only: ask, max_unit, missing_key, record_t, value_problem
   use hb_property_values, only: kind_of, number_value, value_t
   use hb_text, only: join, lower, quote, shown, string_t, to_text
   implicit none
   private
   public :: limits_t, new_properties, properties_t

   integer, parameter :: single_value(0) = [integer ::]     !! extents, as for `pick`

   type, extends(record_t) :: properties_t
   contains
      generic :: get => get_real, get_integer, get_logical, get_word, get_reals, get_integers, get_logicals, get_words, get_matrix
      generic :: set => set_real, set_integer, set_logical, set_word, set_reals, set_integers, set_logicals, set_words, set_matrix
      procedure, private :: get_real => properties_get_real
      procedure, private :: get_integer => properties_get_integer
      procedure, private :: get_logical => properties_get_logical
      procedure, private :: get_word => properties_get_word
      procedure, private :: get_reals => properties_get_reals
      procedure, private :: get_integers => properties_get_integers
      procedure, private :: get_logicals => properties_get_logicals
      procedure, private :: get_words => properties_get_words
      procedure, private :: get_matrix => properties_get_matrix
      procedure, private :: set_real => properties_set_real
      procedure, private :: set_integer => properties_set_integer
      procedure, private :: set_logical => properties_set_logical
      procedure, private :: set_word => properties_set_word
      procedure, private :: set_reals => properties_set_reals
      procedure, private :: set_integers => properties_set_integers
      procedure, private :: set_logicals => properties_set_logicals
      procedure, private :: set_words => properties_set_words
      procedure, private :: set_matrix => properties_set_matrix
   end type properties_t

   !> Where each number of a key must be; what is not named limits nothing.
   type :: limits_t
      real(wp) :: minimum = -huge(1.0_wp), maximum = huge(1.0_wp)     !! which itself may be
      real(wp) :: above = -huge(1.0_wp), below = huge(1.0_wp)         !! which itself may not be
   end type limits_t

   !> What a reader wants of a key.
   type :: wanted_t
      integer :: kind = 0                                   !! one of `kind_of`
      logical :: is_required = .false.
      character(max_unit) :: unit = ""
      type(limits_t) :: limits                              !! holds any integer exactly
   end type wanted_t

contains

   !> A group without values; `file_name` is empty and `line` 0 for one that comes from no file.
   pure subroutine new_properties(self, name, file_name, line)
      type(properties_t), intent(out) :: self
      character(*), intent(in) :: name                      !! lower case
      character(*), intent(in) :: file_name
      integer, intent(in) :: line

      self%name = name
      self%file_name = file_name
      self%line = line
   end subroutine new_properties

   !> Takes a real; NaN and infinity are problems.
   pure subroutine properties_get_real(self, key, value, required, unit, limits)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      real(wp), intent(inout) :: value
      logical, intent(in), optional :: required             !! the key must be there
      character(*), intent(in), optional :: unit
      type(limits_t), intent(in), optional :: limits
      real(wp), allocatable :: numbers(:)

      numbers = [value]
      call take_numbers(self, key, wanting(kind_of%number, required, unit, limits), single_value, numbers)
      value = numbers(1)
   end subroutine properties_get_real

   !> Takes an integer.
   pure subroutine properties_get_integer(self, key, value, required, unit, limits)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      integer, intent(inout) :: value
      logical, intent(in), optional :: required
      character(*), intent(in), optional :: unit
      type(limits_t), intent(in), optional :: limits
      real(wp), allocatable :: numbers(:)

      numbers = [real(value, wp)]
      call take_numbers(self, key, wanting(kind_of%whole, required, unit, limits), single_value, numbers)
      value = nint(numbers(1))
   end subroutine properties_get_integer

   !> Takes a truth.
   pure subroutine properties_get_logical(self, key, value, required)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, intent(inout) :: value
      logical, intent(in), optional :: required
      real(wp), allocatable :: numbers(:)

      numbers = [number_of_truth(value)]
      call take_numbers(self, key, wanting(kind_of%truth, required), single_value, numbers)
      value = numbers(1) > 0.0_wp
   end subroutine properties_get_logical

   !> Takes a word; with `choices` it must be one of them, in any case, and comes out as spelt there.
   pure subroutine properties_get_word(self, key, value, required, choices)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      character(:), allocatable, intent(inout) :: value
      logical, intent(in), optional :: required
      character(*), intent(in), optional :: choices(:)
      type(string_t), allocatable :: words(:)

      if (allocated(value)) then
         allocate (words(1))
         words(1)%value = value
      end if
      call take_words(self, key, wanting(kind_of%word, required), single_value, words, choices)
      if (allocated(words)) value = words(1)%value
   end subroutine properties_get_word

   !> Takes a list of reals of any length, or of length `n`.
   pure subroutine properties_get_reals(self, key, value, n, required, unit, limits)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      real(wp), allocatable, intent(inout) :: value(:)
      integer, intent(in), optional :: n
      logical, intent(in), optional :: required
      character(*), intent(in), optional :: unit
      type(limits_t), intent(in), optional :: limits

      call take_numbers(self, key, wanting(kind_of%number, required, unit, limits), list_of(n), value)
   end subroutine properties_get_reals

   !> Takes a list of integers of any length, or of length `n`.
   pure subroutine properties_get_integers(self, key, value, n, required, unit, limits)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      integer, allocatable, intent(inout) :: value(:)
      integer, intent(in), optional :: n
      logical, intent(in), optional :: required
      character(*), intent(in), optional :: unit
      type(limits_t), intent(in), optional :: limits
      real(wp), allocatable :: numbers(:)

      if (allocated(value)) numbers = real(value, wp)
      call take_numbers(self, key, wanting(kind_of%whole, required, unit, limits), list_of(n), numbers)
      if (allocated(numbers)) value = nint(numbers)
   end subroutine properties_get_integers

   !> Takes a list of truths of any length, or of length `n`.
   pure subroutine properties_get_logicals(self, key, value, n, required)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, allocatable, intent(inout) :: value(:)
      integer, intent(in), optional :: n
      logical, intent(in), optional :: required
      real(wp), allocatable :: numbers(:)

      if (allocated(value)) numbers = number_of_truth(value)
      call take_numbers(self, key, wanting(kind_of%truth, required), list_of(n), numbers)
      if (allocated(numbers)) value = numbers > 0.0_wp
   end subroutine properties_get_logicals

   !> Takes a list of words of any length, or of length `n`; `choices` as for one word.
   pure subroutine properties_get_words(self, key, value, n, required, choices)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      type(string_t), allocatable, intent(inout) :: value(:)
      integer, intent(in), optional :: n
      logical, intent(in), optional :: required
      character(*), intent(in), optional :: choices(:)

      call take_words(self, key, wanting(kind_of%word, required), list_of(n), value, choices)
   end subroutine properties_get_words

   !> Takes a real matrix of `n` rows and `m` columns, listed row by row, or element by element as key(i, j).
   pure subroutine properties_get_matrix(self, key, value, n, m, required, unit, limits)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      real(wp), allocatable, intent(inout) :: value(:, :)   !! (n, m)
      integer, intent(in) :: n, m
      logical, intent(in), optional :: required
      character(*), intent(in), optional :: unit
      type(limits_t), intent(in), optional :: limits
      real(wp), allocatable :: numbers(:)

      if (allocated(value)) numbers = row_by_row(value)
      call take_numbers(self, key, wanting(kind_of%number, required, unit, limits), [n, m], numbers)
      if (.not. allocated(numbers)) return
      if (size(numbers) == n*m) value = reshape(numbers, [n, m], order=[2, 1])
   end subroutine properties_get_matrix

   !> Sets a key to a real in place of the values that it had.
   pure subroutine properties_set_real(self, key, value)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      real(wp), intent(in) :: value

      call self%set_reals(key, [value])
   end subroutine properties_set_real

   !> Sets a key to an integer.
   pure subroutine properties_set_integer(self, key, value)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      integer, intent(in) :: value

      call self%set_reals(key, [real(value, wp)])
   end subroutine properties_set_integer

   !> Sets a key to a truth.
   pure subroutine properties_set_logical(self, key, value)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, intent(in) :: value

      call self%set_logicals(key, [value])
   end subroutine properties_set_logical

   !> Sets a key to a word.
   pure subroutine properties_set_word(self, key, value)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      character(*), intent(in) :: value
      type(string_t) :: words(1)

      words(1)%value = value
      call self%set_words(key, words)
   end subroutine properties_set_word

   !> Sets a key to a list of reals.
   pure subroutine properties_set_reals(self, key, value)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      real(wp), intent(in) :: value(:)

      call self%content%put(lower(trim(key)), number_value(value), self%has_changed)
   end subroutine properties_set_reals

   !> Sets a key to a list of integers.
   pure subroutine properties_set_integers(self, key, value)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      integer, intent(in) :: value(:)

      call self%set_reals(key, real(value, wp))
   end subroutine properties_set_integers

   !> Sets a key to a list of truths.
   pure subroutine properties_set_logicals(self, key, value)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, intent(in) :: value(:)
      type(value_t) :: values(size(value))

      values%kind = kind_of%truth
      values%number = number_of_truth(value)
      call self%content%put(lower(trim(key)), values, self%has_changed)
   end subroutine properties_set_logicals

   !> Sets a key to a list of words.
   pure subroutine properties_set_words(self, key, value)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      type(string_t), intent(in) :: value(:)

      call self%content%put_words(lower(trim(key)), value, self%has_changed)
   end subroutine properties_set_words

   !> Sets a key to a matrix.
   pure subroutine properties_set_matrix(self, key, value)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      real(wp), intent(in) :: value(:, :)

      call self%set_reals(key, row_by_row(value))
   end subroutine properties_set_matrix

   ! What a reader wants, and what is said where a value is not so

   pure type(wanted_t) function wanting(kind, required, unit, limits) result(wanted)
      integer, intent(in) :: kind
      logical, intent(in), optional :: required
      character(*), intent(in), optional :: unit
      type(limits_t), intent(in), optional :: limits

      wanted%kind = kind
      if (present(required)) wanted%is_required = required
      if (present(unit)) wanted%unit = unit
      if (present(limits)) wanted%limits = limits
   end function wanting

   !> Whether a value is of the kind that is wanted, finite and within the limits.
   pure logical function suits(value, wanted)
      type(value_t), intent(in) :: value
      type(wanted_t), intent(in) :: wanted

      suits = value%kind == wanted%kind .or. (value%kind == kind_of%whole .and. wanted%kind == kind_of%number)
      if (suits) suits = ieee_is_finite(value%number)
      if (suits) suits = is_within(value%number, wanted%limits)
   end function suits

   pure logical function is_within(number, limits)
      real(wp), intent(in) :: number
      type(limits_t), intent(in) :: limits

      is_within = number >= limits%minimum .and. number <= limits%maximum .and. &
                  (number > limits%above .or. limits%above <= -huge(1.0_wp)) .and. &
                  (number < limits%below .or. limits%below >= huge(1.0_wp))
   end function is_within

   !> What is wrong with a value that does not suit.
   pure function complaint(value, wanted) result(text)
      type(value_t), intent(in) :: value
      type(wanted_t), intent(in) :: wanted
      character(:), allocatable :: text

      if (wanted%kind == kind_of%truth) then
         text = "must be .true. or .false."
      else if (value%kind == kind_of%word) then
         text = "must be "//what(wanted%kind, single_value)//", without quotes"
      else if (wanted%kind == kind_of%whole .and. value%kind /= kind_of%whole) then
         text = "must be an integer like 3, at most "//to_text(huge(1))
      else if (.not. any(value%kind == [kind_of%number, kind_of%whole])) then
         text = "must be a real number like 1.5e-3, below 1.8e308"
      else if (.not. ieee_is_finite(value%number)) then
         text = "must be finite"
      else if (value%number < wanted%limits%minimum) then
         text = "must be "//limit_text(wanted%limits%minimum)//" or greater"
      else if (value%number > wanted%limits%maximum) then
         text = "must be "//limit_text(wanted%limits%maximum)//" or less"
      else if (value%number <= wanted%limits%above) then
         text = "must be above "//limit_text(wanted%limits%above)
      else
         text = "must be below "//limit_text(wanted%limits%below)
      end if

   contains

      pure function limit_text(limit)
         real(wp), intent(in) :: limit
         character(:), allocatable :: limit_text

         limit_text = to_text(limit)
         if (wanted%kind == kind_of%whole) limit_text = to_text(nint(limit))
      end function limit_text
   end function complaint

   !> What a key needs, for messages.
   pure function what(kind, extents) result(text)
      integer, intent(in) :: kind
      integer, intent(in) :: extents(:)                     !! as for `pick`
      character(:), allocatable :: text
      character(25), parameter :: one(4) = [character(25) :: "a real number", "an integer", ".true. or .false.", &
                                            "a text in quotes"]
      character(25), parameter :: many(4) = [character(25) :: "real numbers", "integers", ".true. and .false.", &
                                             "texts in quotes"]

      select case (size(extents))
      case (0)
         text = trim(one(kind))
      case (1)
         text = "a list of "//trim(many(kind))
      case default
         text = "a matrix of "//matrix_text(extents(1), extents(2))//", row by row"
      end select
   end function what

   ! Reading

   !> Takes the numbers of a key in the place of the default: all of them, or none after a problem. Keeps what is used.
   pure subroutine take_numbers(self, key, wanted, extents, numbers)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      type(wanted_t), intent(in) :: wanted
      integer, intent(in) :: extents(:)                     !! as for `pick`
      real(wp), allocatable, intent(inout) :: numbers(:)    !! row by row; not allocated: no default
      real(wp), allocatable :: found(:)
      integer, allocatable :: order(:)
      integer :: i_asked, i_key, k

      call find(self, key, wanted, extents, i_asked, i_key, order)
      if (allocated(order)) then
         allocate (found(size(order)))
         do k = 1, size(order)
            if (suits(self%content%values(order(k)), wanted)) then
               found(k) = self%content%values(order(k))%number
               cycle
            end if
            call value_problem(self, i_key, order(k), element_at(k, extents), complaint(self%content%values(order(k)), wanted))
            deallocate (found)
            exit
         end do
      end if
      if (allocated(found)) then
         call move_alloc(found, numbers)
      else if (wanted%is_required .or. .not. allocated(numbers)) then
         return
      end if
      associate (asked => self%asked(i_asked))
         asked%kind = wanted%kind
         asked%numbers = numbers
         asked%row_length = size(numbers)
         if (size(extents) == 2) asked%row_length = extents(2)
      end associate
   end subroutine take_numbers

   !> Takes the words of a key in the place of the default, as `take_numbers` does.
   pure subroutine take_words(self, key, wanted, extents, words, choices)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      type(wanted_t), intent(in) :: wanted
      integer, intent(in) :: extents(:)                     !! as for `pick`
      type(string_t), allocatable, intent(inout) :: words(:)
      character(*), intent(in), optional :: choices(:)
      type(string_t), allocatable :: found(:)
      character(:), allocatable :: close, problem, word
      integer, allocatable :: order(:)
      integer :: i, i_asked, i_key, k
      logical :: is_given

      call find(self, key, wanted, extents, i_asked, i_key, order)
      is_given = allocated(order)
      if (.not. is_given) allocate (order(0))
      allocate (found(size(order)))
      do k = 1, size(order)
         problem = ""
         if (self%content%values(order(k))%kind == kind_of%whole .and. .not. present(choices)) then
            found(k)%value = self%content%shown(order(k))    ! a name that is a number, such as that of a degree of freedom
         else if (self%content%values(order(k))%kind /= kind_of%word) then
            problem = "needs quotes: "//quote(shown(self%content%shown(order(k))))
         else
            word = self%content%word(order(k))
            if (present(choices)) then
               do i = 1, size(choices)
                  if (lower(trim(choices(i))) == lower(word)) exit
               end do
               if (i <= size(choices)) then
                  word = trim(choices(i))
               else
                  close = closest_word(word, choices)
                  if (close /= "") close = " did you mean '"//close//"'?"
                  problem = "is not known;"//close//" known: "//join(choices, ", ")
               end if
            end if
            call move_alloc(word, found(k)%value)
         end if
         if (problem == "") cycle
         call value_problem(self, i_key, order(k), element_at(k, extents), problem)
         deallocate (found)
         exit
      end do
      if (allocated(found) .and. is_given) call move_alloc(found, words)
      if (.not. allocated(words)) return
      associate (asked => self%asked(i_asked))
         asked%kind = kind_of%word
         asked%words = words
         asked%row_length = size(words)
      end associate
   end subroutine take_words

   !> Asks for a key; `order` tells its values, and is not allocated when there are none or they are too few or too many.
   pure subroutine find(self, key, wanted, extents, i_asked, i_key, order)
      class(properties_t), intent(inout) :: self
      character(*), intent(in) :: key
      type(wanted_t), intent(in) :: wanted
      integer, intent(in) :: extents(:)                     !! as for `pick`
      integer, intent(out) :: i_asked, i_key
      integer, allocatable, intent(out) :: order(:)

      call ask(self, key, wanted%unit, i_asked, i_key)
      if (i_key > 0) then
         self%content%keys(i_key)%is_real = wanted%kind == kind_of%number
         call pick(self, i_key, extents, order)
      else if (wanted%is_required) then
         call missing_key(self, key, what(wanted%kind, extents))
      end if
   end subroutine find

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
