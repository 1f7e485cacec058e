!> One group of a namelist file with typed access to its keys.
!>
!> `require` and `get` collect what is wrong instead of returning an error at every call; `finish` reports all
!> of it at once, together with the keys of the file that nobody asked for. After a problem the value is
!> untouched.
module hb_namelist_group
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_error, only: error_t, fail
   use hb_kinds, only: int64, wp
   use hb_namelist_index, only: max_name
   use hb_namelist_parser, only: content_t, element_text, max_values, shown
   use hb_text, only: closest_word, join, lower, parse_integer, parse_real, quote, string_t, &
         text_builder_t, to_text
   implicit none
   private
   public :: group_t, new_group

   integer, parameter :: max_problems = 50                  !! more are counted, not told
   integer, parameter :: line_width = 100                   !! of the text that `complete` returns

   !> What was asked for, and the value used in namelist form (not allocated where there is none to write).
   type :: asked_t
      integer :: i_key = 0
      character(:), allocatable :: used
   end type asked_t

   type :: group_t
      character(:), allocatable :: name                     !! lower case
      character(:), allocatable :: file_name
      integer :: line = 0                                   !! where it begins; 0: not in the file
      integer :: number = 1                                 !! position among the groups of its name
      logical :: is_repeated = .false.                      !! there are more groups of its name
      logical :: was_opened = .false.                       !! somebody reads it
      type(content_t) :: content
      type(asked_t), allocatable, private :: asked(:)       !! (capacity), in the order of asking
      integer, private :: n_asked = 0
      type(string_t), allocatable, private :: problems(:)
      integer, private :: n_problems = 0
   contains
      !> `call group%require(key, value, ...)`: takes the value of a key that must be there.
      generic :: require => require_real, require_integer, require_logical, require_string, require_reals, &
         require_integers, require_logicals, require_strings, require_matrix
      !> `call group%get(key, value, ...)`: takes the value of a key when it is there.
      generic :: get => get_real, get_integer, get_logical, get_string, get_reals, get_integers, &
            get_logicals, &
         get_strings, get_matrix
      procedure :: complete => group_complete
      procedure :: finish => group_finish
      procedure :: given => group_given
      procedure :: place => group_place
      procedure :: problem => group_problem
      procedure :: problem_as_is => group_problem_as_is
      procedure, private :: require_real => group_require_real
      procedure, private :: require_integer => group_require_integer
      procedure, private :: require_logical => group_require_logical
      procedure, private :: require_string => group_require_string
      procedure, private :: require_reals => group_require_reals
      procedure, private :: require_integers => group_require_integers
      procedure, private :: require_logicals => group_require_logicals
      procedure, private :: require_strings => group_require_strings
      procedure, private :: require_matrix => group_require_matrix
      procedure, private :: get_real => group_get_real
      procedure, private :: get_integer => group_get_integer
      procedure, private :: get_logical => group_get_logical
      procedure, private :: get_string => group_get_string
      procedure, private :: get_reals => group_get_reals
      procedure, private :: get_integers => group_get_integers
      procedure, private :: get_logicals => group_get_logicals
      procedure, private :: get_strings => group_get_strings
      procedure, private :: get_matrix => group_get_matrix
   end type group_t

   !> Limits of a number, or of every number of a list: minimum, maximum, above, below.
   type :: real_range_t
      logical :: is_set(4) = .false.
      real(wp) :: bound(4) = 0.0_wp
   end type real_range_t

   type :: integer_range_t
      logical :: is_set(4) = .false.
      integer :: bound(4) = 0
   end type integer_range_t

contains

   !> Group with a parsed body, `line` 0 for one that is not in the file.
   pure subroutine new_group(self, name, file_name, line, content)
      type(group_t), intent(out) :: self
      character(*), intent(in) :: name                      !! lower case
      character(*), intent(in) :: file_name
      integer, intent(in) :: line
      type(content_t), intent(in), optional :: content

      self%name = name
      self%file_name = file_name
      self%line = line
      if (present(content)) self%content = content
   end subroutine new_group

   !> Takes a real scalar; NaN and infinity are problems.
   pure subroutine group_get_real(self, key, value, minimum, maximum, above, below)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      real(wp), intent(inout) :: value
      real(wp), intent(in), optional :: minimum, maximum, above, below !! value >= minimum, > above, ...

      call read_real(self, key, .false., value, real_range(minimum, maximum, above, below))
   end subroutine group_get_real

   pure subroutine group_require_real(self, key, value, minimum, maximum, above, below)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      real(wp), intent(inout) :: value
      real(wp), intent(in), optional :: minimum, maximum, above, below

      call read_real(self, key, .true., value, real_range(minimum, maximum, above, below))
   end subroutine group_require_real

   !> Takes an integer scalar.
   pure subroutine group_get_integer(self, key, value, minimum, maximum, above, below)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      integer, intent(inout) :: value
      integer, intent(in), optional :: minimum, maximum, above, below

      call read_integer(self, key, .false., value, integer_range(minimum, maximum, above, below))
   end subroutine group_get_integer

   pure subroutine group_require_integer(self, key, value, minimum, maximum, above, below)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      integer, intent(inout) :: value
      integer, intent(in), optional :: minimum, maximum, above, below

      call read_integer(self, key, .true., value, integer_range(minimum, maximum, above, below))
   end subroutine group_require_integer

   !> Takes a logical scalar.
   pure subroutine group_get_logical(self, key, value)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, intent(inout) :: value

      call read_logical(self, key, .false., value)
   end subroutine group_get_logical

   pure subroutine group_require_logical(self, key, value)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, intent(inout) :: value

      call read_logical(self, key, .true., value)
   end subroutine group_require_logical

   !> Takes a string; with `choices` it must be one of them, in any case, and comes out as spelt there.
   pure subroutine group_get_string(self, key, value, choices)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      character(:), allocatable, intent(inout) :: value
      character(*), intent(in), optional :: choices(:)

      call read_string(self, key, .false., value, choices)
   end subroutine group_get_string

   pure subroutine group_require_string(self, key, value, choices)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      character(:), allocatable, intent(inout) :: value
      character(*), intent(in), optional :: choices(:)

      call read_string(self, key, .true., value, choices)
   end subroutine group_require_string

   !> Takes a list of reals of any length, or of length `n`.
   pure subroutine group_get_reals(self, key, value, n, minimum, maximum, above, below)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      real(wp), allocatable, intent(inout) :: value(:)
      integer, intent(in), optional :: n
      real(wp), intent(in), optional :: minimum, maximum, above, below

      call read_reals(self, key, .false., value, real_range(minimum, maximum, above, below), n)
   end subroutine group_get_reals

   pure subroutine group_require_reals(self, key, value, n, minimum, maximum, above, below)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      real(wp), allocatable, intent(inout) :: value(:)
      integer, intent(in), optional :: n
      real(wp), intent(in), optional :: minimum, maximum, above, below

      call read_reals(self, key, .true., value, real_range(minimum, maximum, above, below), n)
   end subroutine group_require_reals

   !> Takes a list of integers of any length, or of length `n`.
   pure subroutine group_get_integers(self, key, value, n, minimum, maximum, above, below)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      integer, allocatable, intent(inout) :: value(:)
      integer, intent(in), optional :: n
      integer, intent(in), optional :: minimum, maximum, above, below

      call read_integers(self, key, .false., value, integer_range(minimum, maximum, above, below), n)
   end subroutine group_get_integers

   pure subroutine group_require_integers(self, key, value, n, minimum, maximum, above, below)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      integer, allocatable, intent(inout) :: value(:)
      integer, intent(in), optional :: n
      integer, intent(in), optional :: minimum, maximum, above, below

      call read_integers(self, key, .true., value, integer_range(minimum, maximum, above, below), n)
   end subroutine group_require_integers

   !> Takes a list of logicals of any length, or of length `n`.
   pure subroutine group_get_logicals(self, key, value, n)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, allocatable, intent(inout) :: value(:)
      integer, intent(in), optional :: n

      call read_logicals(self, key, .false., value, n)
   end subroutine group_get_logicals

   pure subroutine group_require_logicals(self, key, value, n)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, allocatable, intent(inout) :: value(:)
      integer, intent(in), optional :: n

      call read_logicals(self, key, .true., value, n)
   end subroutine group_require_logicals

   !> Takes a list of strings of any length, or of length `n`; `choices` as for one string.
   pure subroutine group_get_strings(self, key, value, n, choices)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      type(string_t), allocatable, intent(inout) :: value(:)
      integer, intent(in), optional :: n
      character(*), intent(in), optional :: choices(:)

      call read_strings(self, key, .false., value, n, choices)
   end subroutine group_get_strings

   pure subroutine group_require_strings(self, key, value, n, choices)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      type(string_t), allocatable, intent(inout) :: value(:)
      integer, intent(in), optional :: n
      character(*), intent(in), optional :: choices(:)

      call read_strings(self, key, .true., value, n, choices)
   end subroutine group_require_strings

   !> Takes a real matrix of `n` rows and `m` columns, written row by row, or element by element as key(i, j).
   pure subroutine group_get_matrix(self, key, value, n, m, minimum, maximum, above, below)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      real(wp), allocatable, intent(inout) :: value(:, :)   !! (n, m)
      integer, intent(in) :: n, m
      real(wp), intent(in), optional :: minimum, maximum, above, below

      call read_matrix(self, key, .false., value, n, m, real_range(minimum, maximum, above, below))
   end subroutine group_get_matrix

   pure subroutine group_require_matrix(self, key, value, n, m, minimum, maximum, above, below)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      real(wp), allocatable, intent(inout) :: value(:, :)
      integer, intent(in) :: n, m
      real(wp), intent(in), optional :: minimum, maximum, above, below

      call read_matrix(self, key, .true., value, n, m, real_range(minimum, maximum, above, below))
   end subroutine group_require_matrix

   !> Whether the file (or an override) gives the key.
   pure logical function group_given(self, key) result(is_given)
      class(group_t), intent(in) :: self
      character(*), intent(in) :: key

      is_given = self%content%is_given(self%content%names%find(lower(trim(key))))
   end function group_given

   !> Place of the group for messages, like `beam.nml:12: &law(2)`.
   pure function group_place(self) result(place)
      class(group_t), intent(in) :: self
      character(:), allocatable :: place

      place = place_at(self, self%line, .false.)
   end function group_place

   !> Adds a problem with a key that the reader cannot see; its line is the line of the key, or of the group
   !> when the key is not given or empty.
   pure subroutine group_problem(self, key, text)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      character(*), intent(in) :: text
      integer :: i_key

      i_key = self%content%names%find(lower(trim(key)))
      if (len_trim(key) == 0) then
         call add_problem(self, self%place()//": "//text)
      else if (self%content%is_given(i_key)) then
         call add_problem(self, &
                          place_at(self, self%content%keys(i_key)%line, .true.)//": "//trim(key)//": "//text)
      else
         call add_problem(self, self%place()//": "//trim(key)//": "//text)
      end if
   end subroutine group_problem

   !> Adds a problem whose text has a place already.
   pure subroutine group_problem_as_is(self, text)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: text

      call add_problem(self, text)
   end subroutine group_problem_as_is

   !> Reports all problems, keys given twice and keys of the file nobody asked for, one per line.
   pure subroutine group_finish(self, error)
      class(group_t), intent(in) :: self
      type(error_t), allocatable, intent(out) :: error
      type(string_t), allocatable :: known(:)
      type(text_builder_t) :: lines
      integer :: i, n

      n = 0
      do i = 1, min(self%n_problems, max_problems)
         call add_line(lines, n, self%problems(i)%value)
      end do
      n = self%n_problems
      call known_keys(self, known)
      associate (content => self%content)
         do i = 1, content%names%n
            if (content%keys(i)%second_line > 0) then
               call add_line(lines, n, place_at(self, content%keys(i)%second_line, .true.)//": key '"// &
                             trim(content%names%names(i))//"' is given again; give it once")
            end if
            if (content%keys(i)%asked > 0 .or. .not. content%is_given(i)) cycle
            if (n >= max_problems) then
               n = n + 1
            else
               call add_line(lines, n, place_at(self, content%keys(i)%line, .true.)//": unknown key '"// &
                             trim(content%names%names(i))//"'; "//advice(trim(content%names%names(i)), known))
            end if
         end do
      end associate
      if (n > max_problems) call lines%add(new_line("a")//self%place()//": and "// &
                                           to_text(n - max_problems)// &
                                           " more problems")
      if (n > 0) call fail(error, lines%text())
   end subroutine group_finish

   !> The group as namelist text with every key that was asked for and its value, given or default.
   pure function group_complete(self) result(text)
      class(group_t), intent(in) :: self
      character(:), allocatable :: text
      type(text_builder_t) :: lines
      integer :: i

      call lines%add("&"//self%name//new_line("a"))
      do i = 1, self%n_asked
         if (.not. allocated(self%asked(i)%used)) cycle
         call lines%add("   "//trim(self%content%names%names(self%asked(i)%i_key))//" = ")
         call lines%add(self%asked(i)%used)
         call lines%add(new_line("a"))
      end do
      call lines%add("/"//new_line("a"))
      text = lines%text()
   end function group_complete

   !> Place of a line of the group; a key without line was set from outside.
   pure function place_at(self, line, is_key) result(place)
      class(group_t), intent(in) :: self
      integer, intent(in) :: line
      logical, intent(in) :: is_key
      character(:), allocatable :: place

      place = self%file_name
      if (line > 0) then
         place = place//":"//to_text(line)
      else if (is_key) then
         place = place//" (override)"
      end if
      place = place//": &"//self%name
      if (self%is_repeated) place = place//"("//to_text(self%number)//")"
   end function place_at

   !> Appends a line unless there are too many already.
   pure subroutine add_line(lines, n, line)
      type(text_builder_t), intent(inout) :: lines
      integer, intent(inout) :: n
      character(*), intent(in) :: line

      n = n + 1
      if (n > max_problems) return
      if (n > 1) call lines%add(new_line("a"))
      call lines%add(line)
   end subroutine add_line

   !> Stores a problem once, however often the key is asked for.
   pure subroutine add_problem(self, text)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: text
      integer :: i

      if (.not. allocated(self%problems)) allocate (self%problems(max_problems))
      do i = 1, min(self%n_problems, max_problems)
         if (self%problems(i)%value == text) return
      end do
      self%n_problems = self%n_problems + 1
      if (self%n_problems <= max_problems) self%problems(self%n_problems)%value = text
   end subroutine add_problem

   !> What to say about an unknown key.
   pure function advice(word, known) result(text)
      character(*), intent(in) :: word
      type(string_t), intent(in) :: known(:)
      character(:), allocatable :: text

      text = closest_word(word, known)
      if (text /= "") text = "did you mean '"//text//"'? "
      if (size(known) == 0) then
         text = text//"no key is known here"
      else
         text = text//"known keys: "//join(known, ", ")
      end if
   end function advice

   !> Keys asked for, in alphabetical order.
   pure subroutine known_keys(self, known)
      class(group_t), intent(in) :: self
      type(string_t), allocatable, intent(out) :: known(:)
      character(max_name), allocatable :: names(:)
      character(max_name) :: name
      integer :: i, j

      allocate (names(self%n_asked), known(self%n_asked))
      do i = 1, self%n_asked
         name = self%content%names%names(self%asked(i)%i_key)
         do j = i - 1, 1, -1
            if (lle(names(j), name)) exit
            names(j + 1) = names(j)
         end do
         names(j + 1) = name
      end do
      do i = 1, self%n_asked
         known(i)%value = trim(names(i))
      end do
   end subroutine known_keys

   !> Notes that a key is asked for. `i_key` is 0 when it is not given, a problem when it is required.
   pure subroutine ask(self, key, is_required, kind, i_asked, i_key)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, intent(in) :: is_required
      character(*), intent(in) :: kind                      !! what is needed, for the message
      integer, intent(out) :: i_asked, i_key
      type(asked_t), allocatable :: larger(:)
      character(:), allocatable :: name
      integer :: i

      name = lower(trim(key))
      i_key = self%content%names%find(name)
      if (i_key == 0) then
         call self%content%add_key(name)
         i_key = self%content%names%n
      end if
      i_asked = self%content%keys(i_key)%asked
      if (i_asked == 0) then
         if (.not. allocated(self%asked)) allocate (self%asked(8))
         if (self%n_asked == size(self%asked)) then
            allocate (larger(2*self%n_asked))
            do i = 1, self%n_asked
               larger(i)%i_key = self%asked(i)%i_key
               call move_alloc(self%asked(i)%used, larger(i)%used)
            end do
            call move_alloc(larger, self%asked)
         end if
         self%n_asked = self%n_asked + 1
         i_asked = self%n_asked
         self%content%keys(i_key)%asked = i_asked
         self%asked(i_asked)%i_key = i_key
      end if
      if (allocated(self%asked(i_asked)%used)) deallocate (self%asked(i_asked)%used)
      if (self%content%is_given(i_key)) return
      i_key = 0
      if (is_required) call add_problem(self, self%place()//": missing key '"//name//"', which needs "//kind)
   end subroutine ask

   !> Adds a problem with a key as a whole.
   pure subroutine key_problem(self, i_key, text)
      class(group_t), intent(inout) :: self
      integer, intent(in) :: i_key
      character(*), intent(in) :: text

      call add_problem(self, place_at(self, self%content%keys(i_key)%line, .true.)//": "// &
                       trim(self%content%names%names(i_key))//" "//text)
   end subroutine key_problem

   !> Adds a problem with one value of a key.
   pure subroutine value_problem(self, i_key, i_value, i, j, text)
      class(group_t), intent(inout) :: self
      integer, intent(in) :: i_key, i_value
      integer, intent(in) :: i, j                           !! element, 0 for a scalar
      character(*), intent(in) :: text
      character(:), allocatable :: word

      word = self%content%word(i_value)
      if (self%content%values(i_value)%is_quoted) word = quote(word)
      call add_problem(self, place_at(self, self%content%values(i_value)%line, .true.)//": "// &
                       element_text(trim(self%content%names%names(i_key)), i, &
                                    j)//" = "//shown(word)//" "//text)
   end subroutine value_problem

   !> Number of the only value of a key, 0 after a problem.
   pure subroutine pick_one(self, i_key, i_value)
      class(group_t), intent(inout) :: self
      integer, intent(in) :: i_key
      integer, intent(out) :: i_value

      associate (key => self%content%keys(i_key))
         i_value = 0
         if (key%element_head > 0) then
            call key_problem(self, i_key, "is a single value; give it without an index")
         else if (key%n_listed /= 1) then
            call key_problem(self, i_key, "has "//to_text(key%n_listed)//" values, needs one")
         else
            i_value = key%head
         end if
      end associate
   end subroutine pick_one

   !> Numbers of the values of a list in the order of its elements; empty after a problem.
   pure subroutine pick_list(self, i_key, order, n_needed)
      class(group_t), intent(inout) :: self
      integer, intent(in) :: i_key
      integer, allocatable, intent(out) :: order(:)
      integer, intent(in), optional :: n_needed
      logical :: is_good
      integer :: first_gap, i_value, n

      is_good = .true.
      associate (key => self%content%keys(i_key), values => self%content%values)
         n = key%n_listed
         i_value = key%element_head
         do while (i_value > 0 .and. is_good)
            is_good = values(i_value)%j == 0
            if (.not. is_good) call key_problem(self, i_key, &
                                                "is a list; its elements have one index, like "// &
                                                trim(self%content%names%names(i_key))//"(2)")
            n = max(n, values(i_value)%i)
            if (present(n_needed) .and. is_good) then
               is_good = values(i_value)%i <= n_needed
               if (.not. is_good) call value_problem(self, i_key, i_value, values(i_value)%i, 0, &
                                                     "is out of range: the list has "//to_text(n_needed)// &
                                                     " elements")
            end if
            i_value = values(i_value)%next
         end do
         allocate (order(merge(n, 0, is_good)), source=0)
         if (.not. is_good) return
         call fill_listed(self, i_key, order)
         call fill_elements(self, i_key, 0, order, is_good)
         first_gap = findloc(order, 0, dim=1)
         if (is_good .and. first_gap > 0) then
            call key_problem(self, i_key, &
                             "has no element ("//to_text(first_gap)//"), but one ("//to_text(n)//")")
            is_good = .false.
         else if (is_good .and. present(n_needed)) then
            is_good = n == n_needed
            if (.not. is_good) call key_problem(self, i_key, &
                                                "has "//counted(int(n, int64))//", needs "//to_text(n_needed))
         end if
      end associate
      if (.not. is_good) then
         deallocate (order)
         allocate (order(0))
      end if
   end subroutine pick_list

   !> Numbers of the values of an n by m matrix, row by row; not allocated after a problem.
   pure subroutine pick_matrix(self, i_key, n, m, order)
      class(group_t), intent(inout) :: self
      integer, intent(in) :: i_key
      integer, intent(in) :: n, m
      integer, allocatable, intent(out) :: order(:)
      character(:), allocatable :: name
      integer(int64) :: n_found, n_needed
      integer :: gap, i_value
      logical :: is_good

      name = trim(self%content%names%names(i_key))
      n_needed = int(max(n, 0), int64)*int(max(m, 0), int64)
      associate (key => self%content%keys(i_key), values => self%content%values)
         i_value = key%element_head
         do while (i_value > 0)
            associate (value => values(i_value))
               if (value%j == 0) then
                  call value_problem(self, i_key, i_value, value%i, 0, &
                                     "is an element of a matrix; write "//name//"(i, j)")
                  return
               else if (value%i > n .or. value%j > m) then
                  call value_problem(self, i_key, i_value, value%i, value%j, &
                                     "is out of range: the matrix has "//matrix_text(n, m))
                  return
               end if
               i_value = value%next
            end associate
         end do
         n_found = int(key%n_listed, int64)
         if (key%head == 0) n_found = int(key%n_elements, int64)
         if (n_found /= n_needed .and. (key%head > 0 .or. n_needed > int(max_values, int64))) then
            call key_problem(self, i_key, "has "//counted(n_found)//", needs "//to_text(n_needed)//": "// &
                             matrix_text(n, m)//", row by row")
            return
         end if
         allocate (order(n_needed), source=0)
         is_good = .true.
         call fill_listed(self, i_key, order)
         call fill_elements(self, i_key, m, order, is_good)
         gap = findloc(order, 0, dim=1) - 1
         if (is_good .and. gap >= 0) then
            call key_problem(self, i_key, "has "//counted(n_found)//", needs "//to_text(n_needed)//": "// &
                             element_text(name, gap/m + 1, mod(gap, m) + 1)//" is missing")
            is_good = .false.
         end if
         if (.not. is_good) deallocate (order)
      end associate
   end subroutine pick_matrix

   !> Puts the listed values of a key into the first places of `order`.
   pure subroutine fill_listed(self, i_key, order)
      class(group_t), intent(in) :: self
      integer, intent(in) :: i_key
      integer, intent(inout) :: order(:)
      integer :: i_value, n

      n = 0
      i_value = self%content%keys(i_key)%head
      do while (i_value > 0)
         associate (value => self%content%values(i_value))
            order(n + 1:n + value%count) = i_value
            n = n + value%count
            i_value = value%next
         end associate
      end do
   end subroutine fill_listed

   !> Puts the elements of a key to their places in `order`; over listed values they come from an override.
   pure subroutine fill_elements(self, i_key, m, order, is_good)
      class(group_t), intent(inout) :: self
      integer, intent(in) :: i_key
      integer, intent(in) :: m                              !! columns of a matrix, 0 for a list
      integer, intent(inout) :: order(:)
      logical, intent(inout) :: is_good                     !! false after a problem
      integer :: i_value, position

      i_value = self%content%keys(i_key)%element_head
      do while (i_value > 0)
         associate (value => self%content%values(i_value))
            position = value%i
            if (m > 0) position = (value%i - 1)*m + value%j
            if (self%content%keys(i_key)%head == 0 .and. order(position) > 0) then
               call value_problem(self, i_key, i_value, value%i, value%j, "is given again; give it once")
               is_good = .false.
               return
            end if
            order(position) = i_value
            i_value = value%next
         end associate
      end do
   end subroutine fill_elements

   !> "1 value", "2 values".
   pure function counted(n) result(text)
      integer(int64), intent(in) :: n
      character(:), allocatable :: text

      text = to_text(n)//" values"
      if (n == 1) text = "1 value"
   end function counted

   pure function matrix_text(n, m) result(text)
      integer, intent(in) :: n, m
      character(:), allocatable :: text

      text = to_text(n)//" rows and "//to_text(m)//" columns"
   end function matrix_text

   !> Value number `i_value` as a real within the range.
   pure subroutine take_real(self, i_key, i_value, i, j, range, number, ok)
      class(group_t), intent(inout) :: self
      integer, intent(in) :: i_key, i_value, i, j
      type(real_range_t), intent(in) :: range
      real(wp), intent(out) :: number
      logical, intent(out) :: ok
      character(:), allocatable :: complaint

      number = 0.0_wp
      ok = .false.
      complaint = ""
      if (self%content%values(i_value)%is_quoted) then
         complaint = "must be a real number, without quotes"
      else
         call parse_real(self%content%word(i_value), number, ok)
         if (.not. ok) then
            complaint = "must be a real number like 1.5e-3, below 1.8e308"
         else if (.not. ieee_is_finite(number)) then
            complaint = "must be finite"
         else if (range%is_set(1) .and. number < range%bound(1)) then
            complaint = "must be "//to_text(range%bound(1))//" or greater"
         else if (range%is_set(2) .and. number > range%bound(2)) then
            complaint = "must be "//to_text(range%bound(2))//" or less"
         else if (range%is_set(3) .and. number <= range%bound(3)) then
            complaint = "must be above "//to_text(range%bound(3))
         else if (range%is_set(4) .and. number >= range%bound(4)) then
            complaint = "must be below "//to_text(range%bound(4))
         end if
      end if
      ok = complaint == ""
      if (.not. ok) call value_problem(self, i_key, i_value, i, j, complaint)
   end subroutine take_real

   !> Value number `i_value` as an integer within the range.
   pure subroutine take_integer(self, i_key, i_value, i, range, number, ok)
      class(group_t), intent(inout) :: self
      integer, intent(in) :: i_key, i_value, i
      type(integer_range_t), intent(in) :: range
      integer, intent(out) :: number
      logical, intent(out) :: ok
      character(:), allocatable :: complaint

      number = 0
      ok = .false.
      complaint = ""
      if (self%content%values(i_value)%is_quoted) then
         complaint = "must be an integer, without quotes"
      else
         call parse_integer(self%content%word(i_value), number, ok)
         if (.not. ok) then
            complaint = "must be an integer like 3, at most "//to_text(huge(number))
         else if (range%is_set(1) .and. number < range%bound(1)) then
            complaint = "must be "//to_text(range%bound(1))//" or greater"
         else if (range%is_set(2) .and. number > range%bound(2)) then
            complaint = "must be "//to_text(range%bound(2))//" or less"
         else if (range%is_set(3) .and. number <= range%bound(3)) then
            complaint = "must be above "//to_text(range%bound(3))
         else if (range%is_set(4) .and. number >= range%bound(4)) then
            complaint = "must be below "//to_text(range%bound(4))
         end if
      end if
      ok = complaint == ""
      if (.not. ok) call value_problem(self, i_key, i_value, i, 0, complaint)
   end subroutine take_integer

   !> Value number `i_value` as a logical.
   pure subroutine take_logical(self, i_key, i_value, i, value, ok)
      class(group_t), intent(inout) :: self
      integer, intent(in) :: i_key, i_value, i
      logical, intent(out) :: value
      logical, intent(out) :: ok

      value = .false.
      ok = .false.
      if (.not. self%content%values(i_value)%is_quoted) then
         select case (lower(self%content%word(i_value)))
         case (".true.", "true", ".t.", "t")
            value = .true.
            ok = .true.
         case (".false.", "false", ".f.", "f")
            ok = .true.
         end select
      end if
      if (.not. ok) call value_problem(self, i_key, i_value, i, 0, "must be .true. or .false.")
   end subroutine take_logical

   !> Value number `i_value` as a string, one of the choices if there are any.
   pure subroutine take_string(self, i_key, i_value, i, value, ok, choices)
      class(group_t), intent(inout) :: self
      integer, intent(in) :: i_key, i_value, i
      character(:), allocatable, intent(out) :: value
      logical, intent(out) :: ok
      character(*), intent(in), optional :: choices(:)
      character(:), allocatable :: close
      integer :: k

      value = self%content%word(i_value)
      ok = self%content%values(i_value)%is_quoted
      if (.not. ok) then
         call value_problem(self, i_key, i_value, i, 0, "needs quotes: "//quote(shown(value)))
      else if (present(choices)) then
         do k = 1, size(choices)
            ok = lower(trim(choices(k))) == lower(value)
            if (.not. ok) cycle
            value = trim(choices(k))
            return
         end do
         ok = .false.
         close = closest_word(value, choices)
         if (close /= "") close = " did you mean '"//close//"'?"
         call value_problem(self, i_key, i_value, i, 0, &
                            "is not known;"//close//" known: "//join(choices, ", "))
      end if
   end subroutine take_string

   pure subroutine read_real(self, key, is_required, value, range)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, intent(in) :: is_required
      real(wp), intent(inout) :: value
      type(real_range_t), intent(in) :: range
      real(wp) :: number
      integer :: i_asked, i_key, i_value
      logical :: ok

      call ask(self, key, is_required, "a real number", i_asked, i_key)
      ok = .false.
      i_value = 0
      if (i_key > 0) call pick_one(self, i_key, i_value)
      if (i_value > 0) call take_real(self, i_key, i_value, 0, 0, range, number, ok)
      if (ok) value = number
      if (.not. ok .and. is_required) return
      if (ieee_is_finite(value)) self%asked(i_asked)%used = to_text(value)
   end subroutine read_real

   pure subroutine read_integer(self, key, is_required, value, range)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, intent(in) :: is_required
      integer, intent(inout) :: value
      type(integer_range_t), intent(in) :: range
      integer :: i_asked, i_key, i_value, number
      logical :: ok

      call ask(self, key, is_required, "an integer", i_asked, i_key)
      ok = .false.
      i_value = 0
      if (i_key > 0) call pick_one(self, i_key, i_value)
      if (i_value > 0) call take_integer(self, i_key, i_value, 0, range, number, ok)
      if (ok) value = number
      if (.not. ok .and. is_required) return
      self%asked(i_asked)%used = to_text(value)
   end subroutine read_integer

   pure subroutine read_logical(self, key, is_required, value)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, intent(in) :: is_required
      logical, intent(inout) :: value
      integer :: i_asked, i_key, i_value
      logical :: found, ok

      call ask(self, key, is_required, ".true. or .false.", i_asked, i_key)
      ok = .false.
      i_value = 0
      if (i_key > 0) call pick_one(self, i_key, i_value)
      if (i_value > 0) call take_logical(self, i_key, i_value, 0, found, ok)
      if (ok) value = found
      if (.not. ok .and. is_required) return
      self%asked(i_asked)%used = to_text(value)
   end subroutine read_logical

   pure subroutine read_string(self, key, is_required, value, choices)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, intent(in) :: is_required
      character(:), allocatable, intent(inout) :: value
      character(*), intent(in), optional :: choices(:)
      character(:), allocatable :: found
      integer :: i_asked, i_key, i_value
      logical :: ok

      call ask(self, key, is_required, "a text in quotes", i_asked, i_key)
      ok = .false.
      i_value = 0
      if (i_key > 0) call pick_one(self, i_key, i_value)
      if (i_value > 0) call take_string(self, i_key, i_value, 0, found, ok, choices)
      if (ok) call move_alloc(found, value)
      if (.not. allocated(value)) return
      if (is_one_line(value)) self%asked(i_asked)%used = quote(value)
   end subroutine read_string

   pure subroutine read_reals(self, key, is_required, value, range, n)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, intent(in) :: is_required
      real(wp), allocatable, intent(inout) :: value(:)
      type(real_range_t), intent(in) :: range
      integer, intent(in), optional :: n
      real(wp), allocatable :: found(:)
      type(string_t), allocatable :: words(:)
      integer, allocatable :: order(:)
      integer :: i, i_asked, i_key
      logical :: ok

      call ask(self, key, is_required, "a list of real numbers", i_asked, i_key)
      if (i_key > 0) then
         call pick_list(self, i_key, order, n)
         ok = size(order) > 0
         allocate (found(size(order)))
         do i = 1, size(order)
            call take_real(self, i_key, order(i), i, 0, range, found(i), ok)
            if (.not. ok) exit
         end do
         if (ok) call move_alloc(found, value)
      end if
      if (.not. allocated(value)) return
      if (.not. all(ieee_is_finite(value))) return
      allocate (words(size(value)))
      do i = 1, size(value)
         words(i)%value = to_text(value(i))
      end do
      call write_list(words, size(words), self%asked(i_asked)%used)
   end subroutine read_reals

   pure subroutine read_integers(self, key, is_required, value, range, n)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, intent(in) :: is_required
      integer, allocatable, intent(inout) :: value(:)
      type(integer_range_t), intent(in) :: range
      integer, intent(in), optional :: n
      integer, allocatable :: found(:)
      type(string_t), allocatable :: words(:)
      integer, allocatable :: order(:)
      integer :: i, i_asked, i_key
      logical :: ok

      call ask(self, key, is_required, "a list of integers", i_asked, i_key)
      if (i_key > 0) then
         call pick_list(self, i_key, order, n)
         ok = size(order) > 0
         allocate (found(size(order)))
         do i = 1, size(order)
            call take_integer(self, i_key, order(i), i, range, found(i), ok)
            if (.not. ok) exit
         end do
         if (ok) call move_alloc(found, value)
      end if
      if (.not. allocated(value)) return
      allocate (words(size(value)))
      do i = 1, size(value)
         words(i)%value = to_text(value(i))
      end do
      call write_list(words, size(words), self%asked(i_asked)%used)
   end subroutine read_integers

   pure subroutine read_logicals(self, key, is_required, value, n)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, intent(in) :: is_required
      logical, allocatable, intent(inout) :: value(:)
      integer, intent(in), optional :: n
      logical, allocatable :: found(:)
      type(string_t), allocatable :: words(:)
      integer, allocatable :: order(:)
      integer :: i, i_asked, i_key
      logical :: ok

      call ask(self, key, is_required, "a list of .true. and .false.", i_asked, i_key)
      if (i_key > 0) then
         call pick_list(self, i_key, order, n)
         ok = size(order) > 0
         allocate (found(size(order)))
         do i = 1, size(order)
            call take_logical(self, i_key, order(i), i, found(i), ok)
            if (.not. ok) exit
         end do
         if (ok) call move_alloc(found, value)
      end if
      if (.not. allocated(value)) return
      allocate (words(size(value)))
      do i = 1, size(value)
         words(i)%value = to_text(value(i))
      end do
      call write_list(words, size(words), self%asked(i_asked)%used)
   end subroutine read_logicals

   pure subroutine read_strings(self, key, is_required, value, n, choices)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, intent(in) :: is_required
      type(string_t), allocatable, intent(inout) :: value(:)
      integer, intent(in), optional :: n
      character(*), intent(in), optional :: choices(:)
      type(string_t), allocatable :: found(:), words(:)
      integer, allocatable :: order(:)
      integer :: i, i_asked, i_key
      logical :: ok

      call ask(self, key, is_required, "a list of texts in quotes", i_asked, i_key)
      if (i_key > 0) then
         call pick_list(self, i_key, order, n)
         ok = size(order) > 0
         allocate (found(size(order)))
         do i = 1, size(order)
            call take_string(self, i_key, order(i), i, found(i)%value, ok, choices)
            if (.not. ok) exit
         end do
         if (ok) call move_alloc(found, value)
      end if
      if (.not. allocated(value)) return
      allocate (words(size(value)))
      do i = 1, size(value)
         if (.not. allocated(value(i)%value)) return
         if (.not. is_one_line(value(i)%value)) return
         words(i)%value = quote(value(i)%value)
      end do
      call write_list(words, size(words), self%asked(i_asked)%used)
   end subroutine read_strings

   pure subroutine read_matrix(self, key, is_required, value, n, m, range)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, intent(in) :: is_required
      real(wp), allocatable, intent(inout) :: value(:, :)
      integer, intent(in) :: n, m
      type(real_range_t), intent(in) :: range
      real(wp), allocatable :: found(:, :)
      type(string_t), allocatable :: words(:)
      integer, allocatable :: order(:)
      integer :: i, i_asked, i_key, j, k
      logical :: ok

      call ask(self, key, is_required, "a matrix of "//matrix_text(n, m)//", row by row", i_asked, i_key)
      if (i_key > 0) call pick_matrix(self, i_key, n, m, order)
      if (allocated(order)) then
         ok = .true.
         allocate (found(n, m))
         do k = 1, size(order)
            i = (k - 1)/m + 1
            j = k - (i - 1)*m
            call take_real(self, i_key, order(k), i, j, range, found(i, j), ok)
            if (.not. ok) exit
         end do
         if (ok) call move_alloc(found, value)
      end if
      if (.not. allocated(value)) return
      if (.not. all(ieee_is_finite(value))) return
      allocate (words(size(value)))
      k = 0
      do i = 1, size(value, 1)
         do j = 1, size(value, 2)
            k = k + 1
            words(k)%value = to_text(value(i, j))
         end do
      end do
      call write_list(words, size(value, 2), self%asked(i_asked)%used)
   end subroutine read_matrix

   !> Whether a string can be written in a namelist file.
   pure logical function is_one_line(text)
      character(*), intent(in) :: text

      is_one_line = scan(text, achar(0)//achar(13)//new_line("a")) == 0
   end function is_one_line

   !> Values in namelist form, a line for each row, four and more equal ones with a repeat count; nothing for
   !> an empty list, which a namelist cannot express.
   pure subroutine write_list(words, row_length, text)
      type(string_t), intent(in) :: words(:)
      integer, intent(in) :: row_length
      character(:), allocatable, intent(out) :: text
      type(text_builder_t) :: list
      character(:), allocatable :: piece
      integer :: column, count, i, k, row_end

      if (size(words) == 0) return
      column = 0
      i = 1
      do while (i <= size(words))
         row_end = ((i - 1)/row_length + 1)*row_length
         count = 1
         do k = i + 1, row_end
            if (words(k)%value /= words(i)%value) exit
            count = count + 1
         end do
         if (count < 4) count = 1
         piece = words(i)%value
         if (count > 1) piece = to_text(count)//"*"//piece
         if (i > 1) call list%add(",")
         if (i > 1 .and. (column + len(piece) > line_width .or. mod(i - 1, row_length) == 0)) then
            call list%add(new_line("a")//"      ")
            column = 0
         else if (i > 1) then
            call list%add(" ")
         end if
         call list%add(piece)
         column = column + len(piece) + 2
         i = i + count
      end do
      text = list%text()
   end subroutine write_list

   pure type(real_range_t) function real_range(minimum, maximum, above, below)
      real(wp), intent(in), optional :: minimum, maximum, above, below

      real_range%is_set = [present(minimum), present(maximum), present(above), present(below)]
      real_range%bound = 0.0_wp
      if (present(minimum)) real_range%bound(1) = minimum
      if (present(maximum)) real_range%bound(2) = maximum
      if (present(above)) real_range%bound(3) = above
      if (present(below)) real_range%bound(4) = below
   end function real_range

   pure type(integer_range_t) function integer_range(minimum, maximum, above, below)
      integer, intent(in), optional :: minimum, maximum, above, below

      integer_range%is_set = [present(minimum), present(maximum), present(above), present(below)]
      integer_range%bound = 0
      if (present(minimum)) integer_range%bound(1) = minimum
      if (present(maximum)) integer_range%bound(2) = maximum
      if (present(above)) integer_range%bound(3) = above
      if (present(below)) integer_range%bound(4) = below
   end function integer_range
end module hb_namelist_group
