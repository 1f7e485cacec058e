!> Values with names, compared with what a test expects: a line such as "status=converged power=2.884381e-2 stuck=0".
!>
!> A number with a point has to agree to one unit of the last digit that is written, so each line shows how much it asserts;
!> 0.0e-9 permits 1e-10. Whole numbers and words have to be equal. A line names the values that matter to it, not all.
module named_values
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_kinds, only: wp
   use hb_text, only: parse_integer, parse_real, to_text
   implicit none
   private
   public :: named_values_t

   integer, parameter :: length = 24

   type :: named_values_t
      private
      character(length), allocatable :: names(:)
      character(length), allocatable :: texts(:)                      !! as a test would write them
      real(wp), allocatable :: numbers(:)
   contains
      procedure :: add_number, add_whole, add_word
      generic :: add => add_number, add_whole, add_word
      procedure :: differences
   end type named_values_t

contains

   !> Adds a number of a quantity of a certain size; as many digits of this size are meaningful.
   subroutine add_number(self, name, value, size_of_all, n_digits)
      class(named_values_t), intent(inout) :: self
      character(*), intent(in) :: name
      real(wp), intent(in) :: value, size_of_all
      integer, intent(in) :: n_digits

      if (ieee_is_finite(value)) then
         call append(self, name, digits_of(value, size_of_all, n_digits), value)
      else                                                            ! not known
         call append(self, name, "nan", huge(value))
      end if
   end subroutine add_number

   subroutine add_whole(self, name, value)
      class(named_values_t), intent(inout) :: self
      character(*), intent(in) :: name
      integer, intent(in) :: value

      call append(self, name, to_text(value), real(value, wp))
   end subroutine add_whole

   subroutine add_word(self, name, value)
      class(named_values_t), intent(inout) :: self
      character(*), intent(in) :: name, value

      call append(self, name, value, 0.0_wp)
   end subroutine add_word

   subroutine append(self, name, text, number)
      class(named_values_t), intent(inout) :: self
      character(*), intent(in) :: name, text
      real(wp), intent(in) :: number

      if (.not. allocated(self%names)) allocate (self%names(0), self%texts(0), self%numbers(0))
      self%names = [character(length) :: self%names, name]
      self%texts = [character(length) :: self%texts, text]
      self%numbers = [self%numbers, number]
   end subroutine append

   !> What is not as expected, e.g. "power is 2.9e-2 instead of 2.884381e-2"; empty if everything is. All values where nothing is
   !> expected, for a new case.
   function differences(self, expected) result(text)
      class(named_values_t), intent(in) :: self
      character(*), intent(in) :: expected
      character(:), allocatable :: text
      character(:), allocatable :: line
      integer :: i, n, next

      text = ""
      if (len_trim(expected) == 0) then
         text = "no values are expected; they are:"
         do i = 1, size(self%names)
            text = text//" "//trim(self%names(i))//"="//trim(self%texts(i))
         end do
         return
      end if
      line = trim(expected)//" "
      next = 1
      do while (next <= len(line))
         n = index(line(next:), " ")
         if (n > 1) call compare(self, line(next:next + n - 2), text)
         next = next + n
      end do
      if (len(text) > 0) text = text(len("; ") + 1:)
   end function differences

   subroutine compare(self, word, text)
      class(named_values_t), intent(in) :: self
      character(*), intent(in) :: word                                !! name=value
      character(:), allocatable, intent(inout) :: text
      integer :: i, is_at
      real(wp) :: number, unit
      logical :: is_number, is_same

      is_at = index(word, "=")
      do i = 1, size(self%names)
         if (self%names(i) == word(:is_at - 1)) exit
      end do
      if (i > size(self%names)) then
         text = text//"; no value is called "//word(:is_at - 1)
         return
      end if
      associate (value => word(is_at + 1:))
         call parse_real(value, number, is_number)
         if (is_number .and. index(value, ".") > 0) then
            unit = unit_of(value)
            is_same = abs(self%numbers(i) - number) <= 1.000001_wp*unit
         else
            is_same = self%texts(i) == value
         end if
         if (.not. is_same) text = text//"; "//trim(self%names(i))//" is "//trim(self%texts(i))//" instead of "//value
      end associate
   end subroutine compare

   !> A unit of the last digit of a number that is written with a point.
   real(wp) function unit_of(text)
      character(*), intent(in) :: text
      integer :: exponent_10, last
      logical :: ok

      last = scan(text, "e") - 1
      exponent_10 = 0
      if (last > 0) call parse_integer(text(last + 2:), exponent_10, ok)
      if (last < 0) last = len(text)
      unit_of = 10.0_wp**(exponent_10 + index(text, ".") - last)
   end function unit_of

   !> Writes a number with the digits that are meaningful.
   function digits_of(value, size_of_all, n_digits) result(text)
      real(wp), intent(in) :: value, size_of_all
      integer, intent(in) :: n_digits
      character(:), allocatable :: text
      character(60) :: buffer
      character(20) :: form
      integer :: exponent_10, last

      last = floor(log10(max(abs(size_of_all), 1.0e-290_wp))) + 1 - n_digits
      exponent_10 = max(last + 1, floor(log10(max(abs(value), 1.0e-290_wp))))
      if (exponent_10 >= -2 .and. exponent_10 <= 4 .and. last < 0) exponent_10 = 0
      write (form, "(a, i0, a)") "(f0.", exponent_10 - last, ")"
      write (buffer, form) value/10.0_wp**exponent_10
      text = trim(buffer)
      if (verify(text, "-.0") == 0 .and. text(1:1) == "-") text = text(2:)
      if (text(1:1) == ".") text = "0"//text
      if (text(1:min(2, len(text))) == "-.") text = "-0"//text(2:)
      if (exponent_10 /= 0) text = text//"e"//to_text(exponent_10)
   end function digits_of
end module named_values
