!> One swept parameter: its path in the input and its values along an axis.
module hb_swept
   use hb_document, only: parameter_t
   use hb_kinds, only: int64, wp
   use hb_properties, only: properties_t
   use hb_text, only: lower, number_of, quote, rounded_to, string_t, to_text
   implicit none
   private
   public :: has_several_values, is_clear_range, read_values, swept_t, value_text, with_unit

   !> Values between two ends, computed when needed: 100 million of them would occupy 800 MB.
   type :: range_t
      integer :: n = 0                                                ! number of values; 0: they are given individually
      real(wp) :: first = 0.0_wp, last = 0.0_wp
      logical :: is_log = .false.
   end type range_t

   !> One parameter and its values along its axis.
   type :: swept_t
      character(:), allocatable :: path                               !! in the input, such as law(1)%gap
      character(:), allocatable :: group                              !! its name in lower case
      character(:), allocatable :: location                           !! of its group &sweep, for messages
      type(parameter_t) :: parameter                                  !! the number of the path in the document of the plan
      character(:), allocatable :: units                              !! empty if the reader of the input declares none
      integer :: axis = 0                                             !! index among the axes of the plan
      logical :: is_text = .false.
      logical :: is_real = .false.                                    !! according to its reader
      logical :: varies = .false.                                     !! numbers that are not all equal
      type(range_t) :: range                                          !! of numbers without a list
      real(wp), allocatable, private :: values(:)                     ! numbers, unless is_text or a range
      type(string_t), allocatable :: texts(:)
      integer :: n_whole = 0                                          !! number of values of all parts of the sweep
      integer :: n_before = 0                                         !! of them, in earlier parts
      integer, private :: n_here = 0                                  ! of them, in this part
   contains
      procedure :: describe => swept_describe
      procedure :: length => swept_length
      procedure :: restrict => swept_restrict
      procedure :: value => swept_value
   end type swept_t

contains

   !> Reads `parameter` and either `values`, `texts`, or `from`, `to`, `n`, `spacing`.
   subroutine read_values(self, group)
      type(swept_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group
      character(:), allocatable :: spacing

      call group%get("parameter", self%path)
      self%group = ""
      if (allocated(self%path)) then
         self%group = lower(trim(adjustl(self%path)))//"%"
         self%group = self%group(:scan(self%group, "(% ") - 1)
         if (index(lower(adjustl(self%path)), "sweep") == 1) then
            call group%problem("parameter", "a sweep cannot vary a sweep; give the path of another group")
         end if
      end if
      if (count([group%given("values"), group%given("texts"), group%given("from")]) /= 1) then
         call group%problem_as_is(group%location()//": give one of 'values' (numbers), 'texts' (strings), "// &
                                  "or 'from', 'to' and 'n'")
         call group%pass_over_keys()
      else if (group%given("values")) then
         call group%get("values", self%values)
      else if (group%given("texts")) then
         call group%get("texts", self%texts)
         self%is_text = .true.
      else if (group%given("from")) then
         call group%get("from", self%range%first)
         call group%get("to", self%range%last)
         call group%get("n", self%range%n)
         self%range%n = max(1, self%range%n)                          ! after a problem
         call group%get("spacing", spacing)
         self%range%is_log = spacing == "log"
         if (self%range%is_log .and. .not. self%range%first*self%range%last > 0.0_wp) &
            call group%problem("spacing", "'from' and 'to' of a logarithmic range must be nonzero and have the same sign")
      end if
   end subroutine read_values

   !> Retains the values of one part of several, whose lengths differ by one at most.
   subroutine swept_restrict(self, part)
      class(swept_t), intent(inout) :: self
      integer, intent(in) :: part(2)                                  !! its number, from 1, and how many there are

      self%n_whole = self%length()
      self%n_before = int(int(part(1) - 1, int64)*self%n_whole/part(2))
      self%n_here = int(int(part(1), int64)*self%n_whole/part(2)) - self%n_before
      associate (first => self%n_before + 1, last => self%n_before + self%n_here)
         if (allocated(self%values)) self%values = self%values(first:last)
         if (allocated(self%texts)) self%texts = self%texts(first:last)
      end associate
   end subroutine swept_restrict

   !> Value i along the axis of a parameter.
   pure real(wp) function swept_value(self, i) result(value)
      class(swept_t), intent(in) :: self
      integer, intent(in) :: i                                        !! 1 to its length
      integer :: k
      real(wp) :: step

      if (allocated(self%values)) then
         value = self%values(i)
         return
      end if
      associate (first => self%range%first, last => self%range%last, n => self%range%n)
         step = (last - first)/max(n - 1, 1)
         k = self%n_before + i
         if (k == 1) then
            value = first
         else if (k == n) then
            value = last
         else if (self%range%is_log) then
            value = first*(last/first)**(real(k - 1, wp)/(n - 1))
         else if (first == anint(first) .and. step == anint(step)) then ! without the rounding of a quotient: orders are integers
            value = first + step*(k - 1)
         else
            value = first + (last - first)*(real(k - 1, wp)/(n - 1))
         end if
      end associate
   end function swept_value

   !> Whether a parameter is a range whose spacing is much larger than rounding errors.
   pure logical function is_clear_range(self)
      type(swept_t), intent(in) :: self
      real(wp), parameter :: max_ulps = 16.0_wp

      is_clear_range = .false.
      if (self%is_text .or. allocated(self%values)) return
      associate (first => self%range%first, last => self%range%last, n => self%range%n)
         is_clear_range = abs(last - first) > max_ulps*n*epsilon(1.0_wp)*max(abs(first), abs(last))
         if (self%range%is_log) is_clear_range = abs(log(last/first)) > max_ulps*n*epsilon(1.0_wp)*(1.0_wp + abs(log(last/first)))
      end associate
   end function is_clear_range

   !> Whether a parameter has numbers that are not all equal.
   pure logical function has_several_values(self)
      type(swept_t), intent(in) :: self
      integer :: i

      has_several_values = .not. self%is_text
      if (self%is_text) return
      do i = 2, self%length()
         if (abs(self%value(i) - self%value(1)) > 0.0_wp) return
      end do
      has_several_values = .false.
   end function has_several_values

   !> A text with a unit after it, if there is one.
   pure function with_unit(text, units)
      character(*), intent(in) :: text, units
      character(len(text) + merge(len(units) + 1, 0, len(units) > 0 .and. units /= "1")) :: with_unit

      with_unit = text
      if (len(with_unit) > len(text)) with_unit = text//" "//units
   end function with_unit

   !> Path, number of values, first and last of them with the unit, for messages.
   function swept_describe(self) result(text)
      class(swept_t), intent(in) :: self
      character(:), allocatable :: text
      integer :: first, last

      first = 1
      last = self%length()
      if (.not. self%is_text) then
         first = merge(1, last, self%value(1) <= self%value(last))
         last = last + 1 - first
         if (allocated(self%values)) then
            first = minloc(self%values, dim=1)
            last = maxloc(self%values, dim=1)
         end if
      end if
      text = self%path//": "//number_of(self%length(), "value")//", "//trim(value_text(self, first))
      if (last /= first) text = text//" to "//trim(value_text(self, last))
      if (.not. self%is_text) text = with_unit(text, self%units)
   end function swept_describe

   !> Number of values that the parameter takes.
   pure integer function swept_length(self) result(n)
      class(swept_t), intent(in) :: self

      if (self%is_text) then
         n = size(self%texts)
      else if (allocated(self%values)) then
         n = size(self%values)
      else
         n = merge(self%n_here, self%range%n, self%n_whole > 0)
      end if
   end function swept_length

   !> A value in the form of the input; whole numbers without a decimal point, so that they are valid for integers,
   !> too.
   function value_text(self, i) result(text)
      type(swept_t), intent(in) :: self
      integer, intent(in) :: i
      character(room_for(self, i)) :: text                            !! padded with blanks

      if (self%is_text) then
         text = quote(self%texts(i)%value)
      else if (self%value(i) == anint(self%value(i)) .and. abs(self%value(i)) <= real(huge(i), wp)) then
         text = to_text(nint(self%value(i)))
      else
         text = to_text(distinguished(self%value(i), self%value(merge(i - 1, min(2, self%length()), i > 1)), &
                                   self%value(merge(i + 1, max(1, i - 1), i < self%length()))))
      end if
   end function value_text

   !> Length that a value needs at most.
   pure integer function room_for(self, i) result(length)
      type(swept_t), intent(in) :: self
      integer, intent(in) :: i

      length = 40
      if (self%is_text) length = 2*len(self%texts(i)%value) + 2
   end function room_for

   !> A value with enough digits to distinguish it from its neighbours: the error is below a hundredth of the
   !> distance.
   real(wp) function distinguished(value, before, after) result(found)
      real(wp), intent(in) :: value
      real(wp), intent(in) :: before, after                           !! at an end equal, and the value itself if it is the only one
      integer :: n_digits

      do n_digits = 3, 17
         found = rounded_to(value, n_digits)
         if (100.0_wp*abs(found - value) <= min(abs(value - before), abs(value - after))) return
      end do
   end function distinguished
end module hb_swept
