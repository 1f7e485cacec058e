!> One group of a namelist file with typed access to its keys.
!>
!> `require` and `get` collect what is wrong instead of returning an error at every call; `finish` reports all
!> of it at once, together with the keys of the file that nobody asked for. After a problem the value is
!> untouched.
module hb_namelist_group
   use hb_kinds, only: wp
   use hb_namelist_content, only: content_t
   use hb_namelist_order, only: any_length, element_at, matrix_text, pick
   use hb_namelist_record, only: ask, keep, record_t, value_problem
   use hb_namelist_values, only: integer_range, integers_t, logicals_t, range_t, real_range, reals_t, &
      strings_among, strings_t, texts_of, values_t
   use hb_text, only: string_t
   implicit none
   private
   public :: group_t, new_group

   integer, parameter :: single_value(0) = [integer ::]     !! extents, as for `pick`

   type, extends(record_t) :: group_t
   contains
      !> `call group%require(key, value, ...)`: takes the value of a key that must be there.
      generic :: require => require_real, require_integer, require_logical, require_string, require_reals, &
         require_integers, require_logicals, require_strings, require_matrix
      !> `call group%get(key, value, ...)`: takes the value of a key when it is there.
      generic :: get => get_real, get_integer, get_logical, get_string, get_reals, get_integers, &
         get_logicals, get_strings, get_matrix
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

   ! The same for a key that must be there and one that need not

   pure subroutine read_real(self, key, is_required, value, range)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, intent(in) :: is_required
      real(wp), intent(inout) :: value
      type(range_t), intent(in) :: range
      type(reals_t) :: found
      integer :: i_asked

      found%range = range
      call read_values(self, key, is_required, "a real number", single_value, found, i_asked)
      if (found%are_complete) value = found%values(1)
      if (self%keeps_values .and. (found%are_complete .or. .not. is_required)) call keep(self, i_asked, texts_of([value]), 1)
   end subroutine read_real

   pure subroutine read_integer(self, key, is_required, value, range)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, intent(in) :: is_required
      integer, intent(inout) :: value
      type(range_t), intent(in) :: range
      type(integers_t) :: found
      integer :: i_asked

      found%range = range
      call read_values(self, key, is_required, "an integer", single_value, found, i_asked)
      if (found%are_complete) value = found%values(1)
      if (self%keeps_values .and. (found%are_complete .or. .not. is_required)) call keep(self, i_asked, texts_of([value]), 1)
   end subroutine read_integer

   pure subroutine read_logical(self, key, is_required, value)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, intent(in) :: is_required
      logical, intent(inout) :: value
      type(logicals_t) :: found
      integer :: i_asked

      call read_values(self, key, is_required, ".true. or .false.", single_value, found, i_asked)
      if (found%are_complete) value = found%values(1)
      if (self%keeps_values .and. (found%are_complete .or. .not. is_required)) call keep(self, i_asked, texts_of([value]), 1)
   end subroutine read_logical

   pure subroutine read_string(self, key, is_required, value, choices)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, intent(in) :: is_required
      character(:), allocatable, intent(inout) :: value
      character(*), intent(in), optional :: choices(:)
      type(strings_t) :: found
      type(string_t) :: used(1)
      integer :: i_asked

      found = strings_among(choices)
      call read_values(self, key, is_required, "a text in quotes", single_value, found, i_asked)
      if (found%are_complete) value = found%values(1)%value
      if (.not. allocated(value)) return
      used(1)%value = value                                 ! gfortran 12 would leak [string_t(value)]
      if (self%keeps_values) call keep(self, i_asked, texts_of(used), 1)
   end subroutine read_string

   pure subroutine read_reals(self, key, is_required, value, range, n)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, intent(in) :: is_required
      real(wp), allocatable, intent(inout) :: value(:)
      type(range_t), intent(in) :: range
      integer, intent(in), optional :: n
      type(reals_t) :: found
      integer :: i_asked

      found%range = range
      call read_values(self, key, is_required, "a list of real numbers", list_of(n), found, i_asked)
      if (found%are_complete) call move_alloc(found%values, value)
      if (self%keeps_values .and. allocated(value)) call keep(self, i_asked, texts_of(value), size(value))
   end subroutine read_reals

   pure subroutine read_integers(self, key, is_required, value, range, n)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, intent(in) :: is_required
      integer, allocatable, intent(inout) :: value(:)
      type(range_t), intent(in) :: range
      integer, intent(in), optional :: n
      type(integers_t) :: found
      integer :: i_asked

      found%range = range
      call read_values(self, key, is_required, "a list of integers", list_of(n), found, i_asked)
      if (found%are_complete) call move_alloc(found%values, value)
      if (self%keeps_values .and. allocated(value)) call keep(self, i_asked, texts_of(value), size(value))
   end subroutine read_integers

   pure subroutine read_logicals(self, key, is_required, value, n)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, intent(in) :: is_required
      logical, allocatable, intent(inout) :: value(:)
      integer, intent(in), optional :: n
      type(logicals_t) :: found
      integer :: i_asked

      call read_values(self, key, is_required, "a list of .true. and .false.", list_of(n), found, i_asked)
      if (found%are_complete) call move_alloc(found%values, value)
      if (self%keeps_values .and. allocated(value)) call keep(self, i_asked, texts_of(value), size(value))
   end subroutine read_logicals

   pure subroutine read_strings(self, key, is_required, value, n, choices)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, intent(in) :: is_required
      type(string_t), allocatable, intent(inout) :: value(:)
      integer, intent(in), optional :: n
      character(*), intent(in), optional :: choices(:)
      type(strings_t) :: found
      integer :: i_asked

      found = strings_among(choices)
      call read_values(self, key, is_required, "a list of texts in quotes", list_of(n), found, i_asked)
      if (found%are_complete) call move_alloc(found%values, value)
      if (self%keeps_values .and. allocated(value)) call keep(self, i_asked, texts_of(value), size(value))
   end subroutine read_strings

   pure subroutine read_matrix(self, key, is_required, value, n, m, range)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, intent(in) :: is_required
      real(wp), allocatable, intent(inout) :: value(:, :)
      integer, intent(in) :: n, m
      type(range_t), intent(in) :: range
      type(reals_t) :: found
      integer :: i_asked

      found%range = range
      call read_values(self, key, is_required, "a matrix of "//matrix_text(n, m)//", row by row", [n, m], &
         found, i_asked)
      if (found%are_complete) value = reshape(found%values, [n, m], order=[2, 1])
      if (self%keeps_values .and. allocated(value)) &
         call keep(self, i_asked, texts_of(reshape(transpose(value), [size(value)])), size(value, 2))
   end subroutine read_matrix

   !> Asks for a key and takes its values, of whatever type: all of them, or none that count after a problem.
   pure subroutine read_values(self, key, is_required, kind, extents, found, i_asked)
      class(group_t), intent(inout) :: self
      character(*), intent(in) :: key
      logical, intent(in) :: is_required
      character(*), intent(in) :: kind                      !! what the key needs, for the message
      integer, intent(in) :: extents(:)                     !! as for `pick`
      class(values_t), intent(inout) :: found
      integer, intent(out) :: i_asked                       !! for `keep`
      character(:), allocatable :: complaint
      integer, allocatable :: order(:)
      integer :: before, element(2), i_key, k

      call ask(self, key, is_required, kind, i_asked, i_key)
      if (i_key == 0) return
      select type (found)
      type is (reals_t)
         self%content%keys(i_key)%is_real = .true.
      end select
      call pick(self, i_key, extents, order)
      if (.not. allocated(order)) return
      call found%reserve(size(order))
      before = 0
      do k = 1, size(order)
         if (order(k) == before) then
            call found%repeat(k)
            cycle
         end if
         before = order(k)
         call found%take(k, self%content%word(order(k)), self%content%values(order(k))%is_quoted, complaint)
         if (complaint == "") cycle
         element = element_at(k, extents)
         call value_problem(self, i_key, order(k), element(1), element(2), complaint)
         return
      end do
      found%are_complete = .true.
   end subroutine read_values

   !> Extents of a list, with or without a given length.
   pure function list_of(n) result(extents)
      integer, intent(in), optional :: n
      integer :: extents(1)

      extents = any_length
      if (present(n)) extents = n
   end function list_of
end module hb_namelist_group
