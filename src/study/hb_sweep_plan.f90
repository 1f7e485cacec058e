!> The points of a sweep: the varied parameters of the input and their values.
!> Each `&sweep` group varies one parameter. Groups with the same `axis` number vary together (zipped); different axes
!> form a grid, the last axis running fastest. Without any group there is one point, the input itself. With a group
!> `&curve` each point is replaced by a curve: its points are one more axis, the fastest.
module hb_sweep_plan
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_curve_plan, only: curve_plan_t, read_curve_plan
   use hb_curve_request, only: usual_points
   use hb_document, only: document_t
   use hb_error, only: error_t, fail
   use hb_kinds, only: int64, wp
   use hb_parameter_number, only: followed_groups
   use hb_properties, only: properties_t
   use hb_property_record, only: line_of_sweep
   use hb_swept, only: has_several_values, is_clear_range, read_values, swept_t, value_text, with_unit
   use hb_text, only: lower, number_of, shown, to_text
   implicit none
   private
   public :: read_sweep_plan, sweep_plan_t

   integer(int64), parameter :: max_points = 2000000000_int64

   type :: sweep_plan_t
      integer :: n_points = 1
      type(swept_t), allocatable :: parameters(:)
      type(curve_plan_t), allocatable :: curve
      real(wp), allocatable :: curve_values(:)                        !! at the points of curves; none until known
      real(wp), allocatable :: over_values(:)                         !! likewise of `over`
      integer, allocatable, private :: length(:)                      ! of each axis
      integer, allocatable, private :: n_before(:), n_whole(:)        ! of each axis: values in earlier parts, and in all parts
   contains
      procedure :: index_on => sweep_plan_index_on
      procedure :: axes_of => sweep_plan_axes_of
      procedure :: n_combinations => sweep_plan_n_combinations
      procedure :: note_units => sweep_plan_note_units
      procedure :: point_of_whole => sweep_plan_point_of_whole
      procedure :: largest_array => sweep_plan_largest_array
      procedure :: point_of_combination => sweep_plan_point_of_combination
      procedure :: apply => sweep_plan_apply
      procedure :: apply_between => sweep_plan_apply_between
      procedure :: describe => sweep_plan_describe
      procedure :: describe_between => sweep_plan_describe_between
      procedure :: fastest_value => sweep_plan_fastest_value
      procedure :: is_ordered => sweep_plan_is_ordered
      procedure :: can_be_chained => sweep_plan_can_be_chained
      procedure :: n_fastest => sweep_plan_n_fastest
      procedure :: n_fastest_of_whole => sweep_plan_n_fastest_of_whole
      procedure :: n_expected => sweep_plan_n_expected
      procedure :: share_covered => sweep_plan_share_covered
      procedure :: reject_tied => sweep_plan_reject_tied
   end type sweep_plan_t

contains

   !> Reads all `&sweep` groups and resolves their paths in the document; its copies receive the values.
   subroutine read_sweep_plan(self, document, error)
      type(sweep_plan_t), intent(out) :: self
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error
      type(properties_t), pointer :: group
      integer, allocatable :: axis_of(:), parts(:, :)
      integer :: i, n

      allocate (self%parameters(document%count("sweep")), self%length(0), self%n_before(0), self%n_whole(0))
      call read_axes(document, axis_of)
      call read_parts(document, axis_of, parts, error)
      if (allocated(error)) return
      do i = 1, size(self%parameters)
         group => document%group("sweep", i)
         self%parameters(i)%location = group%location()
         self%parameters(i)%units = ""
         call read_values(self%parameters(i), group)
         call reject_twice(self%parameters(:i), group)
         call group%finish(error)
         if (allocated(error)) return
         if (parts(2, i) > self%parameters(i)%length()) then
            call group%problem("part", "there are only "//number_of(self%parameters(i)%length(), "value")//" for "// &
                               number_of(parts(2, i), "part"))
            call group%finish(error)
            return
         end if
         call self%parameters(i)%restrict(parts(:, i))
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
            self%n_before = [self%n_before, self%parameters(i)%n_before]
            self%n_whole = [self%n_whole, self%parameters(i)%n_whole]
            self%parameters(i)%axis = size(self%length)
         end if
      end do
      if (document%count("curve") > 0) then
         allocate (self%curve)
         call read_curve_plan(self%curve, document, error)
         if (allocated(error)) return
         self%length = [self%length, self%curve%n_points]
         self%n_before = [self%n_before, 0]
         self%n_whole = [self%n_whole, self%curve%n_points]
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
               if (allocated(self%curve)) call reject_curve(self%curve, swept, error)
               call reject_same(self%parameters(:i), error)
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
   subroutine reject_same(parameters, error)
      type(swept_t), intent(in) :: parameters(:)
      type(error_t), allocatable, intent(inout) :: error
      integer :: i, n

      n = size(parameters)
      do i = 1, n - 1
         if (parameters(i)%parameter%hides(parameters(n)%parameter) .or. parameters(n)%parameter%hides(parameters(i)%parameter)) &
            call fail(error, "is swept twice, also as '"//trim(parameters(i)%path)//"' by "//parameters(i)%location)
      end do
   end subroutine reject_same

   !> Fails if a value that is swept, or that moves along a curve, is tied to another one.
   subroutine sweep_plan_reject_tied(self, document, error)
      class(sweep_plan_t), intent(in) :: self
      type(document_t), intent(in) :: document                        !! that was read
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      do i = 1, size(self%parameters)
         call document%reject_tied(self%parameters(i)%parameter, self%parameters(i)%path, error)
         if (allocated(error)) error%message = self%parameters(i)%location//": "//error%message
         if (allocated(error)) return
      end do
      if (.not. allocated(self%curve)) return
      call document%reject_tied(self%curve%parameter, self%curve%path, error)
      if (.not. allocated(error) .and. allocated(self%curve%over)) &
         call document%reject_tied(self%curve%over_parameter, self%curve%over_path, error)
      if (allocated(error)) error%message = self%curve%location//": "//error%message
   end subroutine sweep_plan_reject_tied

   !> Rejects a path that an earlier parameter has: the later value would replace the earlier one.
   subroutine reject_twice(parameters, group)
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
   end subroutine reject_twice

   !> Rejects a sweep of the value that moves along the curve, or of the curve itself.
   subroutine reject_curve(curve, swept, error)
      type(curve_plan_t), intent(in) :: curve
      type(swept_t), intent(in) :: swept
      type(error_t), allocatable, intent(out) :: error

      if (swept%parameter%hides(curve%parameter) .or. curve%parameter%hides(swept%parameter)) then
         call fail(error, "moves along the curve; sweep another value, or leave out &curve")
      else if (swept%group == "curve") then
         call fail(error, "a sweep cannot vary a curve; give the path of another group")
      end if
   end subroutine reject_curve

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

   !> Reads the part of its values that each group has: that of the first group on its axis with one, else all.
   subroutine read_parts(document, axis_of, parts, error)
      type(document_t), intent(inout), target :: document
      integer, intent(in) :: axis_of(:)                               !! of each group
      integer, allocatable, intent(out) :: parts(:, :)                !! number and count, of each group
      type(error_t), allocatable, intent(out) :: error
      type(properties_t), pointer :: group
      integer, allocatable :: part(:)
      integer :: i, k

      allocate (parts(2, size(axis_of)), source=1)
      do i = 1, size(axis_of)
         group => document%group("sweep", i)
         if (.not. group%given("part")) cycle
         call group%get("part", part)
         if (size(part) /= 2) then
            call group%problem("part", "needs two numbers, K, N: part K of N")
         else if (part(1) < 1 .or. part(1) > part(2)) then
            call group%problem("part", "must be K, N with 1 <= K <= N, not "//to_text(part(1))//", "//to_text(part(2)))
         else
            do k = 1, size(axis_of)
               if (axis_of(k) == axis_of(i)) parts(:, k) = part
            end do
            cycle
         end if
         call group%pass_over_keys()
         call group%finish(error)
         return
      end do
   end subroutine read_parts

   !> The point of the whole sweep that a point of this part of it is.
   pure integer function sweep_plan_point_of_whole(self, point) result(whole)
      class(sweep_plan_t), intent(in) :: self
      integer, intent(in) :: point                                    !! 1 to n_points
      integer :: axis, quotient, stride

      whole = 1
      quotient = point - 1
      stride = 1
      do axis = size(self%length), 1, -1
         whole = whole + (self%n_before(axis) + modulo(quotient, self%length(axis)))*stride
         quotient = quotient/self%length(axis)
         stride = stride*self%n_whole(axis)
      end do
   end function sweep_plan_point_of_whole

   !> The group &sweep whose values are shared by the parts of an array of jobs, the slowest with as many values, and the most parts
   !> that there may be; 0 without a sweep.
   pure subroutine sweep_plan_largest_array(self, n_parts, group, most)
      class(sweep_plan_t), intent(in) :: self
      integer, intent(in) :: n_parts
      integer, intent(out) :: group                                   !! from 1; 0: no axis has so many values
      integer, intent(out) :: most
      integer :: axis, i

      group = 0
      most = 0
      do i = 1, size(self%parameters)
         axis = self%parameters(i)%axis
         most = max(most, self%length(axis))
         if (self%length(axis) < n_parts) cycle
         if (group == 0) group = i
         if (axis < self%parameters(group)%axis) group = i
      end do
   end subroutine sweep_plan_largest_array

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

   !> That number in the whole sweep, of which this may be a part.
   pure integer function sweep_plan_n_fastest_of_whole(self) result(n)
      class(sweep_plan_t), intent(in) :: self

      n = 1
      if (size(self%n_whole) > 0) n = self%n_whole(size(self%n_whole))
   end function sweep_plan_n_fastest_of_whole

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

   !> Number of points by which a run may measure the cost of one: of all parts of the sweep, so that a part is solved as in one run
   !> of the whole; of curves not more than usual, however many are permitted.
   pure integer function sweep_plan_n_expected(self) result(n)
      class(sweep_plan_t), intent(in) :: self

      n = int(min(product(real(self%n_whole, wp)), real(max_points, wp)))
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
   subroutine sweep_plan_describe_between(self, first, last, share, text)
      class(sweep_plan_t), intent(in) :: self
      integer, intent(in) :: first, last                              !! points
      real(wp), intent(in) :: share                                   !! fraction of the distance from the first to the last, 0 to 1
      character(:), allocatable, intent(out) :: text
      character(16) :: value
      integer :: i

      text = ""
      do i = 1, size(self%parameters)
         if (self%parameters(i)%axis < size(self%length)) cycle
         if (len(text) > 0) text = text//", "
         write (value, "(g0.6)") value_between(self, i, first, last, share)
         text = text//with_unit(self%parameters(i)%path//" = "//trim(value), self%parameters(i)%units)
      end do
   end subroutine sweep_plan_describe_between
end module hb_sweep_plan
