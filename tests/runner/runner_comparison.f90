!> Comparison of two values or arrays of equal shape, and the message when it fails. The assertions of any
!> rank, kind and relation end here: they flatten their arguments with `values` and call `compare`.
module runner_comparison
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
   use, intrinsic :: ieee_exceptions, only: ieee_get_status, ieee_set_halting_mode, ieee_set_status, &
      ieee_status_type, ieee_usual
   use, intrinsic :: iso_fortran_env, only: int32, int64, real32, real64
   use runner_exceptions, only: SourceLocation, throw
   implicit none
   private
   public :: compare, values
   public :: equal, greater_than, greater_than_or_equal, less_than, less_than_or_equal, not_equal, relatively_equal

   enum, bind(c)
      enumerator :: equal = 1, not_equal, less_than, less_than_or_equal, greater_than, &
         greater_than_or_equal, relatively_equal
   end enum

   character(*), parameter :: relation_texts(7) = [character(26) :: &
      "equal to", "different from", "less than", "less than or equal to", "greater than", &
      "greater than or equal to", "relatively equal to"]

   !> Elements of `x` in memory order, for rank 0 to 5 (pFUnit's default limit); higher ranks are a failure.
   interface values
      procedure :: values_int32, values_int64, values_real32, values_real64, values_complex64, values_logical
   end interface values

   !> Throws unless `left` (scalar, or the shape of `right`) and `right` are in the relation, element by
   !> element.
   interface compare
      procedure :: compare_integers, compare_reals, compare_complex, compare_logicals
   end interface compare

   !> Value as it is shown in a message.
   interface text
      procedure :: text_integer, text_real, text_complex, text_logical
   end interface text

contains

   subroutine compare_integers(relation, left_shape, left, right_shape, right, message, location)
      integer(kind(equal)), intent(in) :: relation
      integer, intent(in) :: left_shape(:), right_shape(:)
      integer(int64), intent(in) :: left(:), right(:)
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location
      logical :: holds
      integer :: i, j

      if (.not. conformable(left_shape, right_shape, message, location)) return
      do i = 1, size(right)
         j = merge(1, i, size(left_shape) == 0)
         select case (relation)
         case (equal); holds = left(j) == right(i)
         case (not_equal); holds = left(j) /= right(i)
         case (less_than); holds = left(j) < right(i)
         case (less_than_or_equal); holds = left(j) <= right(i)
         case (greater_than); holds = left(j) > right(i)
         case (greater_than_or_equal); holds = left(j) >= right(i)
         case default; holds = .false.
         end select
         if (holds) cycle
         call throw_difference(relation, text(left(j)), text(right(i)), right_shape, i, message, location)
         return
      end do
   end subroutine compare_integers

   subroutine compare_reals(relation, left_shape, left, right_shape, right, tolerance, message, location)
      integer(kind(equal)), intent(in) :: relation
      integer, intent(in) :: left_shape(:), right_shape(:)
      real(real64), intent(in) :: left(:), right(:)
      class(*), intent(in), optional :: tolerance         !! real32 or real64; default 0
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location
      real(real64) :: t
      logical :: has_tolerance, holds
      integer :: i, j

      call read_tolerance(tolerance, t, has_tolerance, location)
      if (.not. has_tolerance) return
      if (.not. conformable(left_shape, right_shape, message, location)) return
      do i = 1, size(right)
         j = merge(1, i, size(left_shape) == 0)
         call check_reals(relation, left(j), right(i), t, holds)
         if (holds) cycle
         call throw_difference(relation, text(left(j)), text(right(i)), right_shape, i, message, location, t)
         return
      end do
   end subroutine compare_reals

   !> One pair of reals. NaN is in no relation; the same infinity is equal to itself.
   subroutine check_reals(relation, left, right, tolerance, holds)
      integer(kind(equal)), intent(in) :: relation
      real(real64), intent(in) :: left, right, tolerance
      logical, intent(out) :: holds
      type(ieee_status_type) :: status

      holds = .false.
      if (ieee_is_nan(left) .or. ieee_is_nan(right)) return
      ! a program under test may trap overflow, which left - right can raise here
      call ieee_get_status(status)
      call ieee_set_halting_mode(ieee_usual, .false.)
      select case (relation)
      case (equal)
         holds = same(left, right)
         if (.not. holds) holds = abs(right - left) <= tolerance
      case (not_equal)
         if (.not. same(left, right)) holds = abs(right - left) > tolerance
      case (relatively_equal)
         if (.not. same(left, 0.0_real64)) holds = abs(right - left) <= tolerance*abs(left)
      case (less_than); holds = left < right + tolerance
      case (less_than_or_equal); holds = left <= right + tolerance
      case (greater_than); holds = left > right - tolerance
      case (greater_than_or_equal); holds = left >= right - tolerance
      end select
      call ieee_set_status(status)
   end subroutine check_reals

   !> left == right, written so that -Wcompare-reals, which is right elsewhere, stays silent.
   pure logical function same(left, right)
      real(real64), intent(in) :: left, right
      same = left <= right .and. left >= right
   end function same

   subroutine compare_complex(relation, left_shape, left, right_shape, right, tolerance, message, location)
      integer(kind(equal)), intent(in) :: relation
      integer, intent(in) :: left_shape(:), right_shape(:)
      complex(real64), intent(in) :: left(:), right(:)
      class(*), intent(in), optional :: tolerance         !! real32 or real64; default 0
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location
      type(ieee_status_type) :: status
      real(real64) :: distance, t
      logical :: has_tolerance, holds
      integer :: i, j

      call read_tolerance(tolerance, t, has_tolerance, location)
      if (.not. has_tolerance) return
      if (.not. conformable(left_shape, right_shape, message, location)) return
      do i = 1, size(right)
         j = merge(1, i, size(left_shape) == 0)
         call ieee_get_status(status)
         call ieee_set_halting_mode(ieee_usual, .false.)
         distance = abs(right(i) - left(j))     ! NaN for the same infinity, which pFUnit fails as well
         holds = .false.
         if (.not. ieee_is_nan(distance)) holds = (distance <= t) .eqv. (relation == equal)
         call ieee_set_status(status)
         if (holds) cycle
         call throw_difference(relation, text(left(j)), text(right(i)), right_shape, i, message, location, t)
         return
      end do
   end subroutine compare_complex

   subroutine compare_logicals(relation, left_shape, left, right_shape, right, message, location)
      integer(kind(equal)), intent(in) :: relation
      integer, intent(in) :: left_shape(:), right_shape(:)
      logical, intent(in) :: left(:), right(:)
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location
      integer :: i, j

      if (.not. conformable(left_shape, right_shape, message, location)) return
      do i = 1, size(right)
         j = merge(1, i, size(left_shape) == 0)
         if ((left(j) .eqv. right(i)) .eqv. (relation == equal)) cycle
         call throw_difference(relation, text(left(j)), text(right(i)), right_shape, i, message, location)
         return
      end do
   end subroutine compare_logicals

   !> Value of the optional tolerance; anything but a real of 32 or 64 bit is a failure of the test.
   subroutine read_tolerance(tolerance, t, has_tolerance, location)
      class(*), intent(in), optional :: tolerance
      real(real64), intent(out) :: t
      logical, intent(out) :: has_tolerance
      type(SourceLocation), intent(in), optional :: location

      t = 0.0_real64
      has_tolerance = .true.
      if (.not. present(tolerance)) return
      select type (tolerance)
      type is (real(real64)); t = tolerance
      type is (real(real32)); t = real(tolerance, real64)
      class default
         has_tolerance = .false.
         call throw("tolerance must be real", location)
      end select
   end subroutine read_tolerance

   !> Equal shapes, or a scalar on the left; otherwise throws.
   logical function conformable(left_shape, right_shape, message, location)
      integer, intent(in) :: left_shape(:), right_shape(:)
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location

      conformable = size(left_shape) == 0
      if (size(left_shape) == size(right_shape)) conformable = all(left_shape == right_shape)
      if (.not. conformable) &
         call throw(lead(message)//"shapes are not conformable: expected "//text_indices(left_shape)// &
         ", found "//text_indices(right_shape), location)
   end function conformable

   subroutine throw_difference(relation, left, right, right_shape, i_element, message, location, tolerance)
      integer(kind(equal)), intent(in) :: relation
      character(*), intent(in) :: left, right
      integer, intent(in) :: right_shape(:)
      integer, intent(in) :: i_element            !! position in memory order
      character(*), intent(in), optional :: message
      type(SourceLocation), intent(in), optional :: location
      real(real64), intent(in), optional :: tolerance
      character(:), allocatable :: full
      integer :: indices(size(right_shape)), k, rest

      select case (relation)
      case (equal, not_equal, relatively_equal)
         full = "found "//right//", expected "//trim(relation_texts(relation))//" "//left
      case default
         full = left//" is not "//trim(relation_texts(relation))//" "//right
      end select
      if (size(right_shape) > 0) then
         rest = i_element - 1
         do k = 1, size(right_shape)
            indices(k) = mod(rest, right_shape(k)) + 1
            rest = rest/right_shape(k)
         end do
         full = full//" at element "//text_indices(indices)
      end if
      if (present(tolerance)) full = full//" (tolerance "//text(tolerance)//")"
      call throw(lead(message)//full, location)
   end subroutine throw_difference

   !> The user's message as the beginning of a longer one.
   pure function lead(message) result(beginning)
      character(*), intent(in), optional :: message
      character(:), allocatable :: beginning

      beginning = ""
      if (present(message)) beginning = trim(message)//": "
   end function lead

   function text_integer(value) result(shown)
      integer(int64), intent(in) :: value
      character(:), allocatable :: shown
      character(24) :: buffer

      write (buffer, "(i0)") value
      shown = trim(buffer)
   end function text_integer

   function text_real(value) result(shown)
      real(real64), intent(in) :: value
      character(:), allocatable :: shown
      character(32) :: buffer

      write (buffer, "(g0)") value
      shown = trim(buffer)
   end function text_real

   function text_complex(value) result(shown)
      complex(real64), intent(in) :: value
      character(:), allocatable :: shown

      shown = "("//text(real(value, real64))//", "//text(aimag(value))//")"
   end function text_complex

   function text_logical(value) result(shown)
      logical, intent(in) :: value
      character(:), allocatable :: shown

      shown = trim(merge(".true. ", ".false.", value))
   end function text_logical

   function text_indices(indices) result(shown)
      integer, intent(in) :: indices(:)
      character(:), allocatable :: shown
      integer :: k

      shown = "("
      do k = 1, size(indices)
         if (k > 1) shown = shown//", "
         shown = shown//text(int(indices(k), int64))
      end do
      shown = shown//")"
   end function text_indices

   function values_int32(x) result(flat)
      integer(int32), intent(in) :: x(..)
      integer(int64), allocatable :: flat(:)
      include "runner_values.inc"
   end function values_int32

   function values_int64(x) result(flat)
      integer(int64), intent(in) :: x(..)
      integer(int64), allocatable :: flat(:)
      include "runner_values.inc"
   end function values_int64

   function values_real32(x) result(flat)
      real(real32), intent(in) :: x(..)
      real(real64), allocatable :: flat(:)
      include "runner_values.inc"
   end function values_real32

   function values_real64(x) result(flat)
      real(real64), intent(in) :: x(..)
      real(real64), allocatable :: flat(:)
      include "runner_values.inc"
   end function values_real64

   function values_complex64(x) result(flat)
      complex(real64), intent(in) :: x(..)
      complex(real64), allocatable :: flat(:)
      include "runner_values.inc"
   end function values_complex64

   function values_logical(x) result(flat)
      logical, intent(in) :: x(..)
      logical, allocatable :: flat(:)
      include "runner_values.inc"
   end function values_logical

   subroutine throw_rank()
      call throw("arrays of rank above 5 cannot be compared")
   end subroutine throw_rank
end module runner_comparison
