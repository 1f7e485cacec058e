!> The points of a sweep: the varied parameters of the input and their values.
!> Each `&sweep` group varies one parameter. Groups with the same `axis` number vary together (zipped); different axes
!> form a grid, the last axis running fastest. Without any group there is one point, the input itself. With a group
!> `&curve` each point is replaced by a curve: its points are one more axis, the fastest.
module hb_sweep_plan
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_curve_plan, only: curve_plan_t, read_curve_plan
   use hb_curve_request, only: usual_points
   use hb_document, only: document_t, parameter_t
   use hb_error, only: error_t, fail
   use hb_kinds, only: int64, wp
   use hb_parameter_number, only: followed_groups
   use hb_properties, only: properties_t
   use hb_property_record, only: line_of_sweep
   use hb_text, only: lower, number_of, quote, rounded_to, shown, string_t, to_text
   implicit none
   private
   public :: read_sweep_plan, sweep_plan_t

   integer(int64), parameter :: max_points = 2000000000_int64

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
      type(range_t), private :: range
      real(wp), allocatable, private :: values(:)                     ! numbers, unless is_text or a range
      type(string_t), allocatable :: texts(:)
   contains
      procedure :: describe => swept_describe
      procedure :: length => swept_length
      procedure :: omission => swept_omission
      procedure :: value => swept_value
   end type swept_t

   type :: sweep_plan_t
      integer :: n_points = 1
      type(swept_t), allocatable :: parameters(:)
      type(curve_plan_t), allocatable :: curve
      real(wp), allocatable :: curve_values(:)                        !! at the points of curves; none until known
      real(wp), allocatable :: over_values(:)                         !! likewise of `over`
      integer, allocatable, private :: length(:)                      ! of each axis
   contains
      procedure :: index_on => sweep_plan_index_on
      procedure :: axes_of => sweep_plan_axes_of
      procedure :: n_combinations => sweep_plan_n_combinations
      procedure :: note_units => sweep_plan_note_units
      procedure :: point_of_combination => sweep_plan_point_of_combination
      procedure :: apply => sweep_plan_apply
      procedure :: apply_between => sweep_plan_apply_between
      procedure :: describe => sweep_plan_describe
      procedure :: describe_between => sweep_plan_describe_between
      procedure :: fastest_value => sweep_plan_fastest_value
      procedure :: is_ordered => sweep_plan_is_ordered
      procedure :: can_be_chained => sweep_plan_can_be_chained
      procedure :: n_fastest => sweep_plan_n_fastest
      procedure :: n_expected => sweep_plan_n_expected
      procedure :: share_covered => sweep_plan_share_covered
      procedure :: refuse_tied => sweep_plan_refuse_tied
   end type sweep_plan_t

contains

   !> Reads all `&sweep` groups and resolves their paths in the document; its copies receive the values.
   subroutine read_sweep_plan(self, document, error)
      type(sweep_plan_t), intent(out) :: self
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error
      type(properties_t), pointer :: group
      integer, allocatable :: axis_of(:)
      integer :: i, n

      allocate (self%parameters(document%count("sweep")), self%length(0))
      call read_axes(document, axis_of)
      do i = 1, size(self%parameters)
         group => document%group("sweep", i)
         self%parameters(i)%location = group%location()
         self%parameters(i)%units = ""
         call read_values(self%parameters(i), group)
         call refuse_twice(self%parameters(:i), group)
         call group%finish(error)
         if (allocated(error)) return
         n = self%parameters(i)%length()
         self%parameters(i)%axis = findloc(axis_of(1:i - 1), axis_of(i), dim=1)
         if (self%parameters(i)%axis > 0) then
            self%parameters(i)%axis = self%parameters(self%parameters(i)%axis)%axis
            if (self%length(self%parameters(i)%axis) /= n) then
               call group%problem("axis", "parameters on one axis need equally many values: "// &
                  to_text(n)//" here, "//to_text(self%length(self%parameters(i)%axis))//" before")
               call group%finish(error)
               return
            end if
         else
            self%length = [self%length, n]
            self%parameters(i)%axis = size(self%length)
         end if
      end do
      if (document%count("curve") > 0) then
         allocate (self%curve)
         call read_curve_plan(self%curve, document, error)
         if (allocated(error)) return
         self%length = [self%length, self%curve%n_points]
      end if
      if (product(real(self%length, wp)) > real(max_points, wp)) then
         call fail(error, "the sweep would have more than "//to_text(max_points)//" points")
         return
      end if
      self%n_points = product(self%length)
      do i = 1, size(self%parameters)
         self%parameters(i)%varies = has_several_values(self%parameters(i))
      end do
      call resolve_parameters(self, document, error)
   end subroutine read_sweep_plan

   !> Resolves the keys that the parameters vary; the one along which the curve runs is not among them.
   subroutine resolve_parameters(self, document, error)
      type(sweep_plan_t), intent(inout) :: self
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error
      type(properties_t), pointer :: group
      integer :: i

      do i = 1, size(self%parameters)
         associate (swept => self%parameters(i))
            call document%resolve(swept%path, swept%parameter, error)
            group => document%group("sweep", i)
            swept%parameter%line = line_of_sweep(group%line)
            if (.not. allocated(error)) then
               if (allocated(self%curve)) call refuse_curve(self%curve, swept, error)
               call refuse_same(self%parameters(:i), error)
               if (document%n_tones_of(swept%parameter) > 1) call fail(error, "there are "// &
                  to_text(document%n_tones_of(swept%parameter))//" tones; say which, such as '"//trim(swept%path)//"(1)'")
               if (.not. allocated(error)) cycle
            end if
            error%message = swept%location//": parameter '"//shown(swept%path)//"': "//error%message
            return
         end associate
      end do
   end subroutine resolve_parameters

   !> Fails if the last of the parameters is an earlier one under another name, such as law(1)%gap and law(stop)%gap.
   subroutine refuse_same(parameters, error)
      type(swept_t), intent(in) :: parameters(:)
      type(error_t), allocatable, intent(inout) :: error
      integer :: i, n

      n = size(parameters)
      do i = 1, n - 1
         if (parameters(i)%parameter%hides(parameters(n)%parameter) .or. parameters(n)%parameter%hides(parameters(i)%parameter)) &
            call fail(error, "is swept twice, also as '"//trim(parameters(i)%path)//"' by "//parameters(i)%location)
      end do
   end subroutine refuse_same

   !> Fails if a value that is swept, or that moves along a curve, is tied to another one.
   subroutine sweep_plan_refuse_tied(self, document, error)
      class(sweep_plan_t), intent(in) :: self
      type(document_t), intent(in) :: document                        !! that was read
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      do i = 1, size(self%parameters)
         call document%refuse_tied(self%parameters(i)%parameter, self%parameters(i)%path, error)
         if (allocated(error)) error%message = self%parameters(i)%location//": "//error%message
         if (allocated(error)) return
      end do
      if (.not. allocated(self%curve)) return
      call document%refuse_tied(self%curve%parameter, self%curve%path, error)
      if (.not. allocated(error) .and. allocated(self%curve%over)) &
         call document%refuse_tied(self%curve%over_parameter, self%curve%over_path, error)
      if (allocated(error)) error%message = self%curve%location//": "//error%message
   end subroutine sweep_plan_refuse_tied

   !> Rejects a path that an earlier parameter has: the later value would replace the earlier one.
   subroutine refuse_twice(parameters, group)
      type(swept_t), intent(in) :: parameters(:)                      !! the last is that of the group
      type(properties_t), intent(inout) :: group
      integer :: i, n

      n = size(parameters)
      if (.not. allocated(parameters(n)%path)) return
      do i = 1, n - 1
         if (parameters(i)%group /= parameters(n)%group) cycle
         if (lower(adjustl(parameters(i)%path)) /= lower(adjustl(parameters(n)%path))) cycle
         call group%problem("parameter", "is swept twice, also by "//parameters(i)%location)
         return
      end do
   end subroutine refuse_twice

   !> Rejects a sweep of the value that moves along the curve, or of the curve itself.
   subroutine refuse_curve(curve, swept, error)
      type(curve_plan_t), intent(in) :: curve
      type(swept_t), intent(in) :: swept
      type(error_t), allocatable, intent(out) :: error

      if (swept%parameter%hides(curve%parameter) .or. curve%parameter%hides(swept%parameter)) then
         call fail(error, "moves along the curve; sweep another value, or leave out &curve")
      else if (swept%group == "curve") then
         call fail(error, "a sweep cannot vary a curve; give the path of another group")
      end if
   end subroutine refuse_curve

   !> Reads the numbers of the axes. A group without a number gets the lowest unused number, an axis of its own.
   subroutine read_axes(document, axis_of)
      type(document_t), intent(inout), target :: document
      integer, allocatable, intent(out) :: axis_of(:)
      type(properties_t), pointer :: group
      integer :: free, i

      allocate (axis_of(document%count("sweep")), source=0)
      do i = 1, size(axis_of)
         group => document%group("sweep", i)
         if (group%given("axis")) call group%get("axis", axis_of(i))
      end do
      free = 1
      do i = 1, size(axis_of)
         group => document%group("sweep", i)
         if (group%given("axis")) cycle
         do while (any(axis_of == free))
            free = free + 1
         end do
         axis_of(i) = free
         call group%get("axis", axis_of(i))
      end do
   end subroutine read_axes

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

   !> What a range of one value leaves out; empty: nothing.
   function swept_omission(self) result(text)
      class(swept_t), intent(in) :: self
      character(:), allocatable :: text

      text = ""
      if (self%range%n == 1 .and. abs(self%range%last - self%range%first) > 0.0_wp) &
         text = "with n = 1 only from = "//to_text(self%range%first)//" is solved, not to = "//to_text(self%range%last)// &
                "; n counts both ends"
   end function swept_omission

   !> Value i along the axis of a parameter.
   pure real(wp) function swept_value(self, i) result(value)
      class(swept_t), intent(in) :: self
      integer, intent(in) :: i                                        !! 1 to its length
      real(wp) :: step

      if (allocated(self%values)) then
         value = self%values(i)
         return
      end if
      associate (first => self%range%first, last => self%range%last, n => self%range%n)
         step = (last - first)/max(n - 1, 1)
         if (i == 1) then
            value = first
         else if (i == n) then
            value = last
         else if (self%range%is_log) then
            value = first*(last/first)**(real(i - 1, wp)/(n - 1))
         else if (first == anint(first) .and. step == anint(step)) then ! without the rounding of a quotient: orders are integers
            value = first + step*(i - 1)
         else
            value = first + (last - first)*(real(i - 1, wp)/(n - 1))
         end if
      end associate
   end function swept_value

   !> Whether a parameter is a range whose spacing is much larger than rounding errors.
   pure logical function is_clear_range(self)
      type(swept_t), intent(in) :: self
      real(wp), parameter :: roundings = 16.0_wp

      is_clear_range = .false.
      if (self%is_text .or. allocated(self%values)) return
      associate (first => self%range%first, last => self%range%last, n => self%range%n)
         is_clear_range = abs(last - first) > roundings*n*epsilon(1.0_wp)*max(abs(first), abs(last))
         if (self%range%is_log) is_clear_range = abs(log(last/first)) > roundings*n*epsilon(1.0_wp)*(1.0_wp + abs(log(last/first)))
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

   !> Index of the value of parameter `i` at a point.
   pure integer function sweep_plan_index_on(self, i, point)
      class(sweep_plan_t), intent(in) :: self
      integer, intent(in) :: i                                        !! parameter
      integer, intent(in) :: point                                    !! 1 to n_points
      integer :: axis, quotient

      quotient = point - 1
      do axis = size(self%length), self%parameters(i)%axis + 1, -1
         quotient = quotient/self%length(axis)
      end do
      sweep_plan_index_on = 1 + modulo(quotient, self%length(self%parameters(i)%axis))
   end function sweep_plan_index_on

   !> Number of points along the fastest axis: consecutive points of the sweep.
   pure integer function sweep_plan_n_fastest(self)
      class(sweep_plan_t), intent(in) :: self

      sweep_plan_n_fastest = 1
      if (size(self%length) > 0) sweep_plan_n_fastest = self%length(size(self%length))
   end function sweep_plan_n_fastest

   !> Coordinate of a point on the fastest axis: the value of its first parameter with numbers that are not all equal,
   !> otherwise the index of the point.
   pure real(wp) function sweep_plan_fastest_value(self, point)
      class(sweep_plan_t), intent(in) :: self
      integer, intent(in) :: point                                    !! 1 to n_points
      integer :: i

      do i = 1, size(self%parameters)
         if (self%parameters(i)%axis < size(self%length) .or. self%parameters(i)%is_text) cycle
         if (self%parameters(i)%varies) then
            sweep_plan_fastest_value = self%parameters(i)%value(self%index_on(i, point))
            return
         end if
      end do
      sweep_plan_fastest_value = real(modulo(point - 1, self%n_fastest()), wp)
   end function sweep_plan_fastest_value

   !> Share of its range that a curve covers, from its `curve_values`.
   pure real(wp) function sweep_plan_share_covered(self, last) result(share)
      class(sweep_plan_t), intent(in) :: self
      integer, intent(in) :: last                                     !! row of the curve, from 1; with all rows before it
      integer :: first

      first = last - modulo(last - 1, self%n_fastest())
      associate (values => self%curve_values(first:last))
         share = maxval(values, ieee_is_finite(values)) - minval(values, ieee_is_finite(values))
      end associate
      share = share/abs(self%curve%to - self%curve%from)
   end function sweep_plan_share_covered

   !> Number of points by which a run may measure the cost of one: of curves not more than usual, however many are permitted.
   pure integer function sweep_plan_n_expected(self) result(n)
      class(sweep_plan_t), intent(in) :: self

      n = self%n_points
      if (allocated(self%curve)) n = n/self%n_fastest()*min(self%n_fastest(), usual_points)
   end function sweep_plan_n_expected

   !> Whether neighbours along the fastest axis have neighbouring values: its parameters are numbers, each is
   !> monotonic, and one of them changes from point to point.
   pure logical function sweep_plan_is_ordered(self)
      class(sweep_plan_t), intent(in) :: self
      integer :: direction, i, k
      logical :: is_first
      real(wp) :: step

      sweep_plan_is_ordered = .false.
      is_first = .true.
      do i = 1, size(self%parameters)
         associate (swept => self%parameters(i))
            if (swept%axis < size(self%length)) cycle
            if (swept%is_text) then
               sweep_plan_is_ordered = .false.
               return
            end if
            if (is_first .and. swept%varies) sweep_plan_is_ordered = .true.
            if (is_clear_range(swept)) then                           ! without evaluating 100 million values
               is_first = .false.
               cycle
            end if
            direction = 0
            do k = 2, swept%length()
               step = swept%value(k) - swept%value(k - 1)
               if (step*direction < 0.0_wp .or. (is_first .and. swept%varies .and. .not. abs(step) > 0.0_wp)) then
                  sweep_plan_is_ordered = .false.
                  return
               end if
               if (abs(step) > 0.0_wp) direction = nint(sign(1.0_wp, step))
            end do
            is_first = is_first .and. .not. swept%varies               ! that of fastest_value
         end associate
      end do
   end function sweep_plan_is_ordered

   !> Whether points along the fastest axis can start from each other: all its parameters are real numbers of the
   !> physical model that change gradually.
   pure logical function sweep_plan_can_be_chained(self)
      class(sweep_plan_t), intent(in) :: self
      integer :: i

      sweep_plan_can_be_chained = self%is_ordered()
      do i = 1, size(self%parameters)
         if (self%parameters(i)%axis == size(self%length)) sweep_plan_can_be_chained = sweep_plan_can_be_chained .and. &
            self%parameters(i)%is_real .and. any(followed_groups == self%parameters(i)%group)
      end do
   end function sweep_plan_can_be_chained

   !> Axes along which values of a group vary, (number of axes).
   pure function sweep_plan_axes_of(self, group) result(axes)
      class(sweep_plan_t), intent(in) :: self
      character(*), intent(in) :: group                               !! lower case
      logical, allocatable :: axes(:)
      integer :: i

      allocate (axes(size(self%length)), source=.false.)
      do i = 1, size(self%parameters)
         if (self%parameters(i)%group == group) axes(self%parameters(i)%axis) = .true.
      end do
   end function sweep_plan_axes_of

   !> Number of combinations of the values along some axes.
   pure integer function sweep_plan_n_combinations(self, axes) result(n)
      class(sweep_plan_t), intent(in) :: self
      logical, intent(in) :: axes(:)                                  !! (number of axes)

      n = product(self%length, mask=axes)
   end function sweep_plan_n_combinations

   !> First point with a combination of the values along some axes; increases with the number of the combination.
   pure integer function sweep_plan_point_of_combination(self, axes, combination) result(point)
      class(sweep_plan_t), intent(in) :: self
      logical, intent(in) :: axes(:)                                  !! (number of axes)
      integer, intent(in) :: combination                              !! 1 to n_combinations
      integer :: axis, quotient, stride

      point = 1
      quotient = combination - 1
      stride = 1
      do axis = size(self%length), 1, -1
         if (axes(axis)) then
            point = point + modulo(quotient, self%length(axis))*stride
            quotient = quotient/self%length(axis)
         end if
         stride = stride*self%length(axis)
      end do
   end function sweep_plan_point_of_combination

   !> Sets the values of a point in the document in which the paths were resolved, or in a copy of it.
   pure subroutine sweep_plan_apply(self, point, document)
      class(sweep_plan_t), intent(in) :: self
      integer, intent(in) :: point                                    !! 1 to n_points
      type(document_t), intent(inout) :: document
      integer :: i, k

      do i = 1, size(self%parameters)
         k = self%index_on(i, point)
         associate (swept => self%parameters(i))
            if (swept%is_text) then
               call document%set(swept%parameter, swept%texts(k)%value)
            else
               call document%set(swept%parameter, swept%value(k))
            end if
         end associate
      end do
      if (.not. allocated(self%curve)) return
      if (.not. allocated(self%curve_values)) then
         call self%curve%set(document, self%curve%start)
      else if (ieee_is_finite(self%curve_values(point))) then
         call self%curve%set(document, self%curve_values(point))
         if (allocated(self%over_values)) call document%set(self%curve%over_parameter, self%over_values(point))
      end if
   end subroutine sweep_plan_apply

   !> Sets the values between two points of one line of the sweep, along which all parameters are numbers.
   pure subroutine sweep_plan_apply_between(self, first, last, share, document)
      class(sweep_plan_t), intent(in) :: self
      integer, intent(in) :: first, last                              !! points
      real(wp), intent(in) :: share                                   !! fraction of the distance from the first to the last, 0 to 1
      type(document_t), intent(inout) :: document
      integer :: i

      call self%apply(first, document)
      do i = 1, size(self%parameters)
         if (self%parameters(i)%axis == size(self%length)) &
            call document%set(self%parameters(i)%parameter, value_between(self, i, first, last, share))
      end do
   end subroutine sweep_plan_apply_between

   !> Value of a parameter between two points.
   pure real(wp) function value_between(self, i, first, last, share) result(value)
      type(sweep_plan_t), intent(in) :: self
      integer, intent(in) :: i                                        !! parameter
      integer, intent(in) :: first, last                              !! points
      real(wp), intent(in) :: share

      associate (swept => self%parameters(i))
         value = (1.0_wp - share)*swept%value(self%index_on(i, first)) + share*swept%value(self%index_on(i, last))
      end associate
   end function value_between

   !> Stores units and kinds of the parameters, which are known after a model has been read from the document.
   pure subroutine sweep_plan_note_units(self, document)
      class(sweep_plan_t), intent(inout) :: self
      type(document_t), intent(in) :: document
      integer :: i

      do i = 1, size(self%parameters)
         self%parameters(i)%units = trim(document%unit_of(self%parameters(i)%parameter))
         self%parameters(i)%is_real = document%is_real(self%parameters(i)%parameter)
      end do
      if (allocated(self%curve)) self%curve%units = trim(document%unit_of(self%curve%parameter))
   end subroutine sweep_plan_note_units

   !> Text such as `law(1)%gap = 0.0015, solver%method = 'newton'`; empty without parameters.
   function sweep_plan_describe(self, point) result(text)
      class(sweep_plan_t), intent(in) :: self
      integer, intent(in) :: point                                    !! 1 to n_points
      character(:), allocatable :: text
      integer :: i

      text = ""
      do i = 1, size(self%parameters)
         if (i > 1) text = text//", "
         text = text//self%parameters(i)%path//" = "//trim(value_text(self%parameters(i), self%index_on(i, point)))
         if (.not. self%parameters(i)%is_text) text = with_unit(text, self%parameters(i)%units)
      end do
      if (.not. allocated(self%curve_values)) return
      if (.not. ieee_is_finite(self%curve_values(point))) return
      if (len(text) > 0) text = text//", "
      text = text//with_unit(self%curve%path//" = "//to_text(self%curve_values(point)), self%curve%units)
   end function sweep_plan_describe

   !> Text such as `law(1)%gap = 0.00153 m` for the values between two points of one line.
   function sweep_plan_describe_between(self, first, last, share) result(text)
      class(sweep_plan_t), intent(in) :: self
      integer, intent(in) :: first, last                              !! points
      real(wp), intent(in) :: share                                   !! fraction of the distance from the first to the last, 0 to 1
      character(:), allocatable :: text
      character(16) :: value
      integer :: i

      text = ""
      do i = 1, size(self%parameters)
         if (self%parameters(i)%axis < size(self%length)) cycle
         if (len(text) > 0) text = text//", "
         write (value, "(g0.6)") value_between(self, i, first, last, share)
         text = text//with_unit(self%parameters(i)%path//" = "//trim(value), self%parameters(i)%units)
      end do
   end function sweep_plan_describe_between

   !> Number of values that the parameter takes.
   pure integer function swept_length(self) result(n)
      class(swept_t), intent(in) :: self

      if (self%is_text) then
         n = size(self%texts)
      else if (allocated(self%values)) then
         n = size(self%values)
      else
         n = self%range%n
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
end module hb_sweep_plan
