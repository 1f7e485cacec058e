!> Values of a namelist file by type: from words to values with what is wrong about them, and back to text.
!>
!> A reader fills one of the types that extend `values_t`, whichever it is: `reserve`, then `take` for each
!> word. `texts_of` gives values as a namelist has them.
module hb_namelist_values
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_closest_word, only: closest_word
   use hb_kinds, only: int64, wp
   use hb_namelist_scan, only: shown
   use hb_text, only: join, lower, parse_integer, parse_real, quote, string_t, to_text
   implicit none
   private
   public :: integer_range, integers_t, logicals_t, range_t, real_range, reals_t, strings_among, strings_t, &
      texts_of, values_t

   !> Limits of a number, or of every number of a list: minimum, maximum, above, below.
   type :: range_t
      logical :: is_set(4) = .false.
      real(wp) :: bound(4) = 0.0_wp                         !! holds any integer exactly
      logical :: is_integer = .false.
   end type range_t

   !> The values of one key.
   type, abstract :: values_t
      logical :: are_complete = .false.                     !! for the reader: all have been taken
   contains
      procedure(reserve_values), deferred :: reserve
      procedure(take_value), deferred :: take
      procedure(repeat_value), deferred :: repeat
   end type values_t

   abstract interface
      !> Makes room for `n` values.
      pure subroutine reserve_values(self, n)
         import :: values_t
         class(values_t), intent(inout) :: self
         integer, intent(in) :: n
      end subroutine reserve_values

      !> Takes value `k` from a word of the file. `complaint` says what is wrong with it; empty: nothing.
      pure subroutine take_value(self, k, word, is_quoted, complaint)
         import :: values_t
         class(values_t), intent(inout) :: self
         integer, intent(in) :: k
         character(*), intent(in) :: word                   !! without quotes
         logical, intent(in) :: is_quoted                   !! in the file
         character(:), allocatable, intent(out) :: complaint
      end subroutine take_value

      !> Makes value `k` that before it, as a repeat count asks for.
      pure subroutine repeat_value(self, k)
         import :: values_t
         class(values_t), intent(inout) :: self
         integer, intent(in) :: k
      end subroutine repeat_value
   end interface

   type, extends(values_t) :: reals_t
      type(range_t) :: range
      real(wp), allocatable :: values(:)
   contains
      procedure :: reserve => reals_reserve
      procedure :: take => reals_take
      procedure :: repeat => reals_repeat
   end type reals_t

   type, extends(values_t) :: integers_t
      type(range_t) :: range
      integer, allocatable :: values(:)
   contains
      procedure :: reserve => integers_reserve
      procedure :: take => integers_take
      procedure :: repeat => integers_repeat
   end type integers_t

   type, extends(values_t) :: logicals_t
      logical, allocatable :: values(:)
   contains
      procedure :: reserve => logicals_reserve
      procedure :: take => logicals_take
      procedure :: repeat => logicals_repeat
   end type logicals_t

   type, extends(values_t) :: strings_t
      type(string_t), allocatable :: choices(:)             !! not allocated: any string will do
      type(string_t), allocatable :: values(:)
   contains
      procedure :: reserve => strings_reserve
      procedure :: take => strings_take
      procedure :: repeat => strings_repeat
   end type strings_t

   !> Values in namelist form; not allocated where a namelist file cannot express one.
   interface texts_of
      module procedure texts_of_reals, texts_of_integers, texts_of_logicals, texts_of_strings
   end interface texts_of

contains

   ! Real numbers

   pure subroutine reals_reserve(self, n)
      class(reals_t), intent(inout) :: self
      integer, intent(in) :: n

      allocate (self%values(n))
   end subroutine reals_reserve

   !> Takes a finite real within the range.
   pure subroutine reals_take(self, k, word, is_quoted, complaint)
      class(reals_t), intent(inout) :: self
      integer, intent(in) :: k
      character(*), intent(in) :: word
      logical, intent(in) :: is_quoted
      character(:), allocatable, intent(out) :: complaint
      logical :: ok

      if (is_quoted) then
         complaint = "must be a real number, without quotes"
         return
      end if
      call parse_real(word, self%values(k), ok)
      if (.not. ok) then
         complaint = "must be a real number like 1.5e-3, below 1.8e308"
      else if (.not. ieee_is_finite(self%values(k))) then
         complaint = "must be finite"
      else
         complaint = range_complaint(self%range, self%values(k))
      end if
   end subroutine reals_take

   pure subroutine reals_repeat(self, k)
      class(reals_t), intent(inout) :: self
      integer, intent(in) :: k

      self%values(k) = self%values(k - 1)
   end subroutine reals_repeat

   pure function texts_of_reals(values) result(texts)
      real(wp), intent(in) :: values(:)
      type(string_t) :: texts(size(values))
      character(:), allocatable :: text
      integer(int64) :: bits, bits_before
      integer :: i

      text = to_text(0.0_wp)
      bits_before = transfer(0.0_wp, bits_before)
      do i = 1, size(values)
         if (.not. ieee_is_finite(values(i))) cycle
         bits = transfer(values(i), bits)                   ! zeros have signs
         if (bits /= bits_before) text = to_text(values(i)) ! matrices have long rows of equal numbers
         bits_before = bits
         texts(i)%value = text
      end do
   end function texts_of_reals

   ! Integers

   pure subroutine integers_reserve(self, n)
      class(integers_t), intent(inout) :: self
      integer, intent(in) :: n

      allocate (self%values(n))
   end subroutine integers_reserve

   !> Takes an integer within the range.
   pure subroutine integers_take(self, k, word, is_quoted, complaint)
      class(integers_t), intent(inout) :: self
      integer, intent(in) :: k
      character(*), intent(in) :: word
      logical, intent(in) :: is_quoted
      character(:), allocatable, intent(out) :: complaint
      logical :: ok

      if (is_quoted) then
         complaint = "must be an integer, without quotes"
         return
      end if
      call parse_integer(word, self%values(k), ok)
      if (.not. ok) then
         complaint = "must be an integer like 3, at most "//to_text(huge(k))
      else
         complaint = range_complaint(self%range, real(self%values(k), wp))
      end if
   end subroutine integers_take

   pure subroutine integers_repeat(self, k)
      class(integers_t), intent(inout) :: self
      integer, intent(in) :: k

      self%values(k) = self%values(k - 1)
   end subroutine integers_repeat

   pure function texts_of_integers(values) result(texts)
      integer, intent(in) :: values(:)
      type(string_t) :: texts(size(values))
      integer :: i

      do i = 1, size(values)
         texts(i)%value = to_text(values(i))
      end do
   end function texts_of_integers

   ! Ranges of numbers

   pure type(range_t) function real_range(minimum, maximum, above, below) result(range)
      real(wp), intent(in), optional :: minimum, maximum, above, below

      range%is_set = [present(minimum), present(maximum), present(above), present(below)]
      if (present(minimum)) range%bound(1) = minimum
      if (present(maximum)) range%bound(2) = maximum
      if (present(above)) range%bound(3) = above
      if (present(below)) range%bound(4) = below
   end function real_range

   pure type(range_t) function integer_range(minimum, maximum, above, below) result(range)
      integer, intent(in), optional :: minimum, maximum, above, below

      range%is_integer = .true.
      range%is_set = [present(minimum), present(maximum), present(above), present(below)]
      if (present(minimum)) range%bound(1) = real(minimum, wp)
      if (present(maximum)) range%bound(2) = real(maximum, wp)
      if (present(above)) range%bound(3) = real(above, wp)
      if (present(below)) range%bound(4) = real(below, wp)
   end function integer_range

   !> What the range has against a finite number: empty when nothing.
   pure function range_complaint(range, number) result(complaint)
      type(range_t), intent(in) :: range
      real(wp), intent(in) :: number
      character(:), allocatable :: complaint
      character(:), allocatable :: bound
      integer :: i

      complaint = ""
      associate (b => range%bound)
         i = findloc(range%is_set .and. &
                     [number < b(1), number > b(2), number <= b(3), number >= b(4)], .true., dim=1)
         if (i == 0) return
         bound = to_text(b(i))
         if (range%is_integer) bound = to_text(nint(b(i)))
      end associate
      select case (i)
      case (1)
         complaint = "must be "//bound//" or greater"
      case (2)
         complaint = "must be "//bound//" or less"
      case (3)
         complaint = "must be above "//bound
      case (4)
         complaint = "must be below "//bound
      end select
   end function range_complaint

   ! Logicals

   pure subroutine logicals_reserve(self, n)
      class(logicals_t), intent(inout) :: self
      integer, intent(in) :: n

      allocate (self%values(n))
   end subroutine logicals_reserve

   pure subroutine logicals_take(self, k, word, is_quoted, complaint)
      class(logicals_t), intent(inout) :: self
      integer, intent(in) :: k
      character(*), intent(in) :: word
      logical, intent(in) :: is_quoted
      character(:), allocatable, intent(out) :: complaint
      logical :: ok

      ok = .not. is_quoted
      select case (lower(word))
      case (".true.", "true", ".t.", "t")
         self%values(k) = .true.
      case (".false.", "false", ".f.", "f")
         self%values(k) = .false.
      case default
         ok = .false.
      end select
      complaint = ""
      if (.not. ok) complaint = "must be .true. or .false."
   end subroutine logicals_take

   pure subroutine logicals_repeat(self, k)
      class(logicals_t), intent(inout) :: self
      integer, intent(in) :: k

      self%values(k) = self%values(k - 1)
   end subroutine logicals_repeat

   pure function texts_of_logicals(values) result(texts)
      logical, intent(in) :: values(:)
      type(string_t) :: texts(size(values))
      integer :: i

      do i = 1, size(values)
         texts(i)%value = to_text(values(i))
      end do
   end function texts_of_logicals

   ! Strings

   !> No strings yet; each must be one of `choices` where there are any.
   pure type(strings_t) function strings_among(choices) result(self)
      character(*), intent(in), optional :: choices(:)
      integer :: i

      if (.not. present(choices)) return
      allocate (self%choices(size(choices)))
      do i = 1, size(choices)
         self%choices(i)%value = trim(choices(i))
      end do
   end function strings_among

   pure subroutine strings_reserve(self, n)
      class(strings_t), intent(inout) :: self
      integer, intent(in) :: n

      allocate (self%values(n))
   end subroutine strings_reserve

   !> Takes a string; one of the choices, in any case, comes out as spelt there.
   pure subroutine strings_take(self, k, word, is_quoted, complaint)
      class(strings_t), intent(inout) :: self
      integer, intent(in) :: k
      character(*), intent(in) :: word
      logical, intent(in) :: is_quoted
      character(:), allocatable, intent(out) :: complaint
      character(:), allocatable :: close
      integer :: i

      complaint = ""
      self%values(k)%value = word
      if (.not. is_quoted) then
         complaint = "needs quotes: "//quote(shown(word))
      else if (allocated(self%choices)) then
         do i = 1, size(self%choices)
            if (lower(self%choices(i)%value) /= lower(word)) cycle
            self%values(k)%value = self%choices(i)%value
            return
         end do
         close = closest_word(word, self%choices)
         if (close /= "") close = " did you mean '"//close//"'?"
         complaint = "is not known;"//close//" known: "//join(self%choices, ", ")
      end if
   end subroutine strings_take

   pure subroutine strings_repeat(self, k)
      class(strings_t), intent(inout) :: self
      integer, intent(in) :: k

      self%values(k) = self%values(k - 1)
   end subroutine strings_repeat

   pure function texts_of_strings(values) result(texts)
      type(string_t), intent(in) :: values(:)
      type(string_t) :: texts(size(values))
      integer :: i

      do i = 1, size(values)
         if (.not. allocated(values(i)%value)) cycle
         if (is_one_line(values(i)%value)) texts(i)%value = quote(values(i)%value)
      end do
   end function texts_of_strings

   !> Whether a string can be written in a namelist file.
   pure logical function is_one_line(text)
      character(*), intent(in) :: text

      is_one_line = scan(text, achar(0)//achar(13)//new_line("a")) == 0
   end function is_one_line
end module hb_namelist_values
