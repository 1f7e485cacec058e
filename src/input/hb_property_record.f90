!> The keys that readers request from one group of properties, the values used, and the problems found.
!>
!> Readers of values `request` for a key, store the value that is used (given or default) and add problems; `finish`
!> reports all problems at once, together with the given keys that no reader requested.
module hb_property_record
   use hb_error, only: error_t, fail
   use hb_input_keys, only: find_groups, find_rule, keys_of, kind_of
   use hb_key_rows, only: row_of
   use hb_property_values, only: content_t, element_text
   use hb_similar_word, only: closest_word
   use hb_text, only: join, lower, max_name, shown, string_t, text_builder_t, to_text
   implicit none
   private
   public :: key_problem, line_of_curve, line_of_sweep, missing_key, record_t, request, value_problem

   integer, parameter :: max_problems = 50                  !! further ones are counted, not reported
   integer, parameter :: first_of_curves = 1000000000       !! lines below its negative are those of a &curve

   type :: record_t
      character(:), allocatable :: name                     !! of the group, lower case
      character(:), allocatable :: file_name                !! source; empty if not from a file
      integer :: line = 0                                   !! first line; 0 if not in the file
      integer :: number = 1                                 !! position among the groups of its name
      integer :: handle = 0                                 !! that identifies it in its document (hb_property_groups)
      logical :: is_repeated = .false.                      !! there are several groups of its name
      integer :: reading = 0                                !! number of the last reading that opened it; 0: never
      logical :: has_changed = .false.                      !! a value has been set since the markers were removed
      type(content_t) :: content
      integer, allocatable :: requested(:)                  !! (capacity), numbers of the keys in the order of the requests
      integer :: n_requested = 0
      character(:), allocatable, private :: type            !! for which the rules of the keys are valid
      type(string_t), allocatable, private :: problems(:)
      integer, private :: n_problems = 0
   contains
      procedure :: describe_unknown => record_describe_unknown
      procedure :: finish => record_finish
      procedure :: forget => record_forget
      procedure :: given => record_given
      procedure :: has_key => record_has_key
      procedure :: has_problems => record_has_problems
      procedure :: reject_unknown => record_reject_unknown
      procedure :: reject_unread => record_reject_unread
      procedure :: location => record_location
      procedure :: pass_over_keys => record_pass_over_keys
      procedure :: problem => record_problem
      procedure :: problem_as_is => record_problem_as_is
      procedure :: report_first => record_report_first
   end type record_t

contains

   !> The line of a value that a `&sweep` sets, as properties store it.
   pure integer function line_of_sweep(line) result(stored)
      integer, intent(in) :: line                           !! of the group

      stored = -line
   end function line_of_sweep

   !> Likewise of a `&curve`.
   pure integer function line_of_curve(line) result(stored)
      integer, intent(in) :: line                           !! of the group

      stored = -first_of_curves - line
   end function line_of_curve

   !> Whether the key has a value.
   pure logical function record_given(self, key) result(is_given)
      class(record_t), intent(in) :: self
      character(*), intent(in) :: key

      is_given = self%content%is_given(self%content%names%find(lower(trim(key))))
   end function record_given

   !> Whether the table has a key for the group and its type.
   pure logical function record_has_key(self, key) result(has_key)
      class(record_t), intent(in) :: self
      character(*), intent(in) :: key                       !! lower case
      character(:), allocatable :: type

      has_key = row_of(self%name, key) > 0
      if (has_key) return
      call get_type(self, type)
      has_key = row_of(self%name//" "//type, key) > 0
   end function record_has_key

   !> Message on a key that the group does not have, with a suggestion and the keys that were requested.
   pure subroutine record_describe_unknown(self, key, text)
      class(record_t), intent(in) :: self
      character(*), intent(in) :: key
      character(:), allocatable, intent(out) :: text
      type(string_t), allocatable :: known(:)
      character(:), allocatable :: closest, keys, type

      type = ""
      if (allocated(self%type)) type = self%type
      call known_keys(self, known)
      keys = "this group has no keys"
      if (size(known) > 0) keys = "known keys: "//join(known, ", ")
      closest = closest_word(key, known)
      if (closest /= "") then
         closest = "did you mean '"//closest//"'? "
      else
         call find_groups(key, self%name, type, closest)
         if (closest /= "") closest = "it belongs to "//closest//"; "
      end if
      text = "unknown key '"//key//"'; "//closest//keys
   end subroutine record_describe_unknown

   !> Fails because the group, set from outside, is not read.
   pure subroutine record_reject_unread(self, error)
      class(record_t), intent(in) :: self
      type(error_t), allocatable, intent(out) :: error

      call fail(error, location_at(self, 0, .true.)//": this group is not read")
   end subroutine record_reject_unread

   !> Fails with the given keys that no type of the group has, one per line: what can be said of a group before it is read.
   pure subroutine record_reject_unknown(self, error)
      class(record_t), intent(in) :: self
      type(error_t), allocatable, intent(out) :: error
      type(string_t), allocatable :: known(:)
      type(text_builder_t) :: lines
      character(:), allocatable :: closest, key
      integer :: i, k, n

      n = 0
      call keys_of(self%name, known)
      if (size(known) == 0) return
      associate (content => self%content)
         do i = 1, content%names%n
            if (.not. content%is_given(i)) cycle
            key = trim(content%names%names(i))
            if (any([(known(k)%value == key, k=1, size(known))])) cycle
            closest = closest_word(key, known)
            if (closest /= "") closest = "; did you mean '"//closest//"'?"
            call add_line(lines, n, location_at(self, content%keys(i)%line, .true.)//": unknown key '"//key//"'"//closest)
         end do
      end associate
      if (n > 0) call fail(error, lines%text())
   end subroutine record_reject_unknown

   !> Position of the group for messages, like `beam.nml:12: &law(2)`.
   pure function record_location(self) result(location)
      class(record_t), intent(in) :: self
      character(location_length(self, self%line, .false.)) :: location

      location = location_at(self, self%line, .false.)
   end function record_location

   !> Adds a problem with a key that the reader itself cannot detect; the line is that of the key, or of the group if
   !> the key is not given or empty.
   pure subroutine record_problem(self, key, text)
      class(record_t), intent(inout) :: self
      character(*), intent(in) :: key
      character(*), intent(in) :: text
      character(:), allocatable :: message
      integer :: i_key

      i_key = self%content%names%find(lower(trim(key)))
      if (len_trim(key) == 0) then
         call add_problem(self, self%location()//": "//text)
      else if (self%content%is_given(i_key)) then
         self%content%keys(i_key)%has_problem = .true.
         message = location_at(self, self%content%keys(i_key)%line, .true.)//": "//trim(key)//": "//text
         call self%content%add_advice(i_key, message)
         call add_problem(self, message)
      else
         call add_problem(self, self%location()//": "//trim(key)//": "//text)
      end if
   end subroutine record_problem

   !> Suppresses messages on keys of the table in `finish`, because after a problem their use is not known.
   pure subroutine record_pass_over_keys(self)
      class(record_t), intent(inout) :: self
      integer :: i

      do i = 1, self%content%names%n
         if (row_of(self%name, trim(self%content%names%names(i))) > 0) self%content%keys(i)%has_problem = .true.
      end do
   end subroutine record_pass_over_keys

   !> Adds a problem whose text already contains its position.
   pure subroutine record_problem_as_is(self, text)
      class(record_t), intent(inout) :: self
      character(*), intent(in) :: text

      call add_problem(self, text)
   end subroutine record_problem_as_is

   !> Begins another reading without requests and problems.
   pure subroutine record_forget(self)
      class(record_t), intent(inout) :: self
      integer :: i

      do i = 1, self%n_requested
         self%content%keys(self%requested(i))%requested = 0
      end do
      self%n_requested = 0
      self%n_problems = 0
      if (allocated(self%content%keys)) self%content%keys%has_problem = .false.
   end subroutine record_forget

   !> Reports all problems, keys given twice, and keys of the file that no reader requested or commented on, one per
   !> line.
   pure subroutine record_finish(self, error)
      class(record_t), intent(in) :: self
      type(error_t), allocatable, intent(out) :: error
      type(text_builder_t) :: lines
      character(:), allocatable :: text
      integer :: i, n

      n = 0
      do i = 1, min(self%n_problems, max_problems)
         call add_line(lines, n, self%problems(i)%value)
      end do
      n = self%n_problems
      associate (content => self%content)
         do i = 1, content%names%n
            if (content%keys(i)%second_line > 0) then
               call add_line(lines, n, location_at(self, content%keys(i)%second_line, .true.)//": key '"// &
                             trim(content%names%names(i))//"' is given again; give it once")
            end if
            if (content%keys(i)%requested > 0 .or. content%keys(i)%has_problem .or. .not. content%is_given(i)) cycle
            if (n >= max_problems) then
               n = n + 1
            else
               call self%describe_unknown(trim(content%names%names(i)), text)
               call add_line(lines, n, location_at(self, content%keys(i)%line, .true.)//": "//text)
            end if
         end do
      end associate
      if (n > max_problems) &
         call lines%add(new_line("a")//self%location()//": and "//to_text(n - max_problems)//" more problems")
      if (n > 0) call fail(error, lines%text())
   end subroutine record_finish

   !> Whether problems have been found.
   pure logical function record_has_problems(self) result(has)
      class(record_t), intent(in) :: self

      has = self%n_problems > 0
   end function record_has_problems

   !> Reports the first problem only: without a known type no other key can be checked.
   pure subroutine record_report_first(self, error)
      class(record_t), intent(in) :: self
      type(error_t), allocatable, intent(out) :: error

      call fail(error, self%problems(1)%value)
   end subroutine record_report_first

   !> Records the request of a key.
   pure subroutine request(self, key, i_key)
      class(record_t), intent(inout) :: self
      character(*), intent(in) :: key
      integer, intent(out) :: i_key
      character(max_name) :: name

      name = lower(key)
      call self%content%find_or_add(name, i_key)
      if (self%content%keys(i_key)%requested > 0) return
      if (self%n_requested == 0) call begin_reading(self)
      self%n_requested = self%n_requested + 1
      if (self%n_requested > size(self%requested)) self%requested = [self%requested, self%requested]
      self%requested(self%n_requested) = i_key
      associate (requested => self%content%keys(i_key))
         requested%requested = self%n_requested
         if (.not. allocated(requested%rule)) then
            allocate (requested%rule)
            call find_rule(self%name, self%type, trim(name), requested%rule)
         end if
         requested%unit = requested%rule%unit
         requested%kind = kind_of%none
      end associate
   end subroutine request

   !> Allocates the list of requests; earlier requests are discarded if the type of the group has changed.
   pure subroutine begin_reading(self)
      class(record_t), intent(inout) :: self
      character(:), allocatable :: type
      integer :: i

      if (.not. allocated(self%requested)) allocate (self%requested(8))
      call get_type(self, type)
      associate (content => self%content)
         if (.not. allocated(self%type)) self%type = type
         do i = 1, merge(content%names%n, 0, self%type /= type)
            if (allocated(content%keys(i)%rule)) deallocate (content%keys(i)%rule)
         end do
      end associate
      self%type = type
   end subroutine begin_reading

   !> The type of a group as it is given; empty if it has none.
   pure subroutine get_type(self, type)
      class(record_t), intent(in) :: self
      character(:), allocatable, intent(out) :: type
      integer :: i

      type = ""
      associate (content => self%content)
         i = content%names%find("type")
         if (.not. content%is_given(i)) return
         if (content%keys(i)%values(1)%kind == kind_of%word .and. content%keys(i)%values(1)%i == 0) &
            call content%get_word(i, 1, type)
         type = lower(type)
      end associate
   end subroutine get_type

   !> Adds the problem that a required key is missing.
   pure subroutine missing_key(self, key, what)
      class(record_t), intent(inout) :: self
      character(*), intent(in) :: key
      character(*), intent(in) :: what                      !! the requirement

      call add_problem(self, self%location()//": missing key '"//lower(trim(key))//"', which needs "//what)
   end subroutine missing_key

   !> Adds a problem with a key as a whole.
   pure subroutine key_problem(self, i_key, text)
      class(record_t), intent(inout) :: self
      integer, intent(in) :: i_key
      character(*), intent(in) :: text
      character(:), allocatable :: message

      message = location_at(self, self%content%keys(i_key)%line, .true.)//": "//trim(self%content%names%names(i_key))//" "//text
      call self%content%add_advice(i_key, message)
      call add_problem(self, message)
   end subroutine key_problem

   !> Adds a problem with one value of a key.
   pure subroutine value_problem(self, i_key, k, element, text)
      class(record_t), intent(inout) :: self
      integer, intent(in) :: i_key, k                       !! value k of the key
      integer, intent(in) :: element(2)                     !! its indices, 0 for missing ones
      character(*), intent(in) :: text
      character(:), allocatable :: message, value

      call self%content%get_shown(i_key, k, value)
      message = location_at(self, self%content%keys(i_key)%values(k)%line, .true.)//": "// &
                element_text(trim(self%content%names%names(i_key)), element(1), element(2))//" = "//shown(value)//" "//text
      if (self%content%keys(i_key)%values(k)%kind == kind_of%none) call self%content%add_advice(i_key, message)
      call add_problem(self, message)
   end subroutine value_problem

   !> Requested keys, in alphabetical order.
   pure subroutine known_keys(self, known)
      class(record_t), intent(in) :: self
      type(string_t), allocatable, intent(out) :: known(:)
      character(max_name), allocatable :: names(:)
      character(max_name) :: name
      integer :: i, j

      allocate (names(self%n_requested), known(self%n_requested))
      do i = 1, self%n_requested
         name = self%content%names%names(self%requested(i))
         do j = i - 1, 1, -1
            if (lle(names(j), name)) exit
            names(j + 1) = names(j)
         end do
         names(j + 1) = name
      end do
      do i = 1, self%n_requested
         known(i)%value = trim(names(i))
      end do
   end subroutine known_keys

   !> Position of a line of the group; line 0 is a key set from outside, a negative line a key set by a sweep.
   pure function location_at(self, line, is_key) result(location)
      class(record_t), intent(in) :: self
      integer, intent(in) :: line
      logical, intent(in) :: is_key
      character(location_length(self, line, is_key)) :: location
      character(:), allocatable :: text

      call write_location(self, line, is_key, text)
      location = text
   end function location_at

   pure integer function location_length(self, line, is_key)
      class(record_t), intent(in) :: self
      integer, intent(in) :: line
      logical, intent(in) :: is_key
      character(:), allocatable :: text

      call write_location(self, line, is_key, text)
      location_length = len(text)
   end function location_length

   pure subroutine write_location(self, line, is_key, location)
      class(record_t), intent(in) :: self
      integer, intent(in) :: line
      logical, intent(in) :: is_key
      character(:), allocatable, intent(out) :: location

      location = self%file_name
      if (index(location, "/", back=.true.) == len(location)) location = ""   ! a folder: the text has no file
      if (line > 0 .and. len(location) > 0) then
         location = location//":"//to_text(line)
      else if (is_key .and. len(location) > 0) then
         if (line == 0) location = location//" (override)"
         if (line < -first_of_curves) then
            location = location//":"//to_text(-first_of_curves - line)//": &curve"
         else if (line < 0) then
            location = location//":"//to_text(-line)//": &sweep"
         end if
      end if
      if (len(location) > 0) location = location//": "
      location = location//"&"//self%name
      if (self%is_repeated) location = location//"("//to_text(self%number)//")"
   end subroutine write_location

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

   !> Stores a problem once, however often the key is requested.
   pure subroutine add_problem(self, text)
      class(record_t), intent(inout) :: self
      character(*), intent(in) :: text
      integer :: i

      if (.not. allocated(self%problems)) allocate (self%problems(max_problems))
      do i = 1, min(self%n_problems, max_problems)
         if (self%problems(i)%value == text) return
      end do
      self%n_problems = self%n_problems + 1
      if (self%n_problems <= max_problems) self%problems(self%n_problems)%value = text
   end subroutine add_problem
end module hb_property_record
