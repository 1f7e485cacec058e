!> Namelist input files, read by ourselves because the compiler's runtime cannot say which key was wrong.
!>
!>     call new_document(document, file_name, text, error)
!>     call document%set("law(2)%gap", "1.5e-3", error)          ! overrides, if any
!>     call document%expect_groups(["newton", "law   "], error)
!>     group => document%optional_group("newton")
!>     call group%get("tolerance", tolerance, above=0.0_wp)      ! as often as needed, no check in between
!>     call document%finish(error)                               ! all problems of all groups at once
!>
!> The variable that holds a document needs the attribute `target`. Pointers to its groups stay valid until an
!> assignment changes it or it is deallocated. Assignment makes a deep copy.
module hb_namelist
   use hb_error, only: error_t, fail
   use hb_namelist_group, only: group_t, new_group
   use hb_namelist_index, only: max_name, name_table_t
   use hb_namelist_parser, only: content_t, is_name, next_group, override, parse_body, scan_t, shown
   use hb_text, only: closest_word, join, lower, parse_integer, quote, string_t, text_builder_t, to_text
   implicit none
   private
   public :: document_t, group_t, new_document

   integer, parameter :: max_groups = 100000
   integer, parameter :: max_lines = 200                    !! of a message
   character(*), parameter :: path_help = &
      "a path is like solver%tolerance, law(2)%gap, law(label)%gap or tones%frequency(2)"

   !> Keeps a group at one address while the list of groups grows.
   type :: holder_t
      type(group_t), allocatable :: group
   end type holder_t

   type :: document_t
      character(:), allocatable :: file_name
      integer, private :: n_groups = 0
      logical, private :: keeps_values = .true.             !! for `complete`
      type(holder_t), allocatable, private :: holders(:)    !! (capacity), file order, then added ones
      type(name_table_t), private :: names                  !! of the groups, each name once
      integer, allocatable, private :: n_of(:)              !! groups of a name, (names%n)
      integer, allocatable, private :: first_of(:)          !! where a name begins in `order`, (names%n)
      integer, allocatable, private :: order(:)             !! groups, those of a name together, (n_groups)
      type(string_t), allocatable, private :: known(:)      !! names that may occur
   contains
      procedure :: complete => document_complete
      procedure :: count => document_count
      procedure :: expect_groups => document_expect_groups
      procedure :: finish => document_finish
      procedure :: forget_values => document_forget_values
      procedure :: group => document_group
      procedure :: optional_group => document_optional_group
      procedure :: required_group => document_required_group
      procedure :: set => document_set
      procedure :: take_groups => document_take_groups
   end type document_t

contains

   !> Takes the text of a namelist file apart; fails with file and line where the syntax is wrong.
   pure subroutine new_document(self, file_name, text, error)
      type(document_t), intent(out) :: self
      character(*), intent(in) :: file_name                 !! for messages
      character(*), intent(in) :: text
      type(error_t), allocatable, intent(out) :: error
      type(scan_t) :: scan
      type(content_t) :: content
      character(:), allocatable :: name
      integer, allocatable :: name_of(:)                    !! number of the name of each group
      integer, allocatable :: larger(:)
      integer :: i, i_name, line, n

      self%file_name = trim(file_name)
      allocate (self%holders(8), name_of(8), self%n_of(0), self%first_of(0), self%order(0))
      n = index(text, achar(0))
      if (n > 0) then
         line = 1
         do i = 1, n
            if (text(i:i) == new_line("a")) line = line + 1
         end do
         call fail(error, &
                   self%file_name//":"//to_text(line)//": the file contains a NUL byte; it is no text file")
         return
      end if
      if (index(text, char(239)//char(187)//char(191)) == 1) scan%position = 4  ! byte order mark
      do
         call next_group(text, scan, name)
         if (len(name) == 0 .or. allocated(scan%problem)) exit
         line = scan%line
         call parse_body(text, scan, name, content)
         if (allocated(scan%problem)) exit
         if (self%n_groups == max_groups) then
            call fail(error, &
                      self%file_name//":"//to_text(line)//": more than "//to_text(max_groups)//" groups")
            return
         end if
         call append_group(self, name, line, content)
         n = self%n_groups
         if (n > size(name_of)) then
            allocate (larger(2*n))
            larger(1:n - 1) = name_of
            call move_alloc(larger, name_of)
         end if
         i_name = self%names%find(name)
         if (i_name == 0) then
            call self%names%add(name)
            i_name = self%names%n
         end if
         name_of(n) = i_name
      end do
      if (allocated(scan%problem)) then
         call fail(error, self%file_name//":"//to_text(scan%problem_line)//": "//scan%problem)
         return
      end if
      call sort_by_name(self, name_of(1:self%n_groups))
   end subroutine new_document

   !> Number of groups of a name.
   pure integer function document_count(self, name) result(n)
      class(document_t), intent(in) :: self
      character(*), intent(in) :: name
      integer :: i_name

      n = 0
      i_name = self%names%find(lower(trim(name)))
      if (i_name > 0) n = self%n_of(i_name)
   end function document_count

   !> The i-th group of a name in file order, null when there are fewer. `finish` reports its unknown keys.
   function document_group(self, name, i) result(group)
      class(document_t), target, intent(inout) :: self
      character(*), intent(in) :: name
      integer, intent(in) :: i
      type(group_t), pointer :: group

      group => null()
      if (i < 1 .or. i > self%count(name)) return
      group => self%holders(position_of(self, name, i))%group
      group%was_opened = .true.
   end function document_group

   !> The only group of a name, added without keys when the file has none, so that defaults are read from it.
   !> A second group of the name is a problem that `finish` reports.
   function document_optional_group(self, name) result(group)
      class(document_t), target, intent(inout) :: self
      character(*), intent(in) :: name
      type(group_t), pointer :: group
      type(error_t), allocatable :: error

      if (self%count(name) == 0) call add_group(self, lower(trim(name)))
      group => self%group(name, 1)
      call check_single(self, name, error)
      if (allocated(error)) call group%problem_as_is(error%message)
   end function document_optional_group

   !> The only group of a name; fails when there is none or more than one.
   subroutine document_required_group(self, name, group, error)
      class(document_t), target, intent(inout) :: self
      character(*), intent(in) :: name
      type(group_t), pointer, intent(out) :: group
      type(error_t), allocatable, intent(out) :: error

      group => null()
      if (self%count(name) == 0) then
         call fail(error, self%file_name//": missing group &"//lower(trim(name))//advice_on_group(self, name))
         return
      end if
      call check_single(self, name, error)
      if (allocated(error)) return
      group => self%group(name, 1)
   end subroutine document_required_group

   !> Fails when the file has groups of other names than these; the message names all of them.
   pure subroutine document_expect_groups(self, names, error)
      class(document_t), intent(inout) :: self
      character(*), intent(in) :: names(:)
      type(error_t), allocatable, intent(out) :: error
      type(text_builder_t) :: lines
      character(:), allocatable :: close
      integer :: i, n_unknown

      if (allocated(self%known)) deallocate (self%known)
      allocate (self%known(size(names)))
      do i = 1, size(names)
         self%known(i)%value = lower(trim(names(i)))
      end do
      n_unknown = 0
      do i = 1, self%n_groups
         associate (group => self%holders(i)%group)
            if (is_known(self, group%name)) cycle
            n_unknown = n_unknown + 1
            if (n_unknown > max_lines) cycle
            close = closest_word(group%name, self%known)
            if (close /= "") close = "; did you mean '&"//close//"'?"
            if (n_unknown > 1) call lines%add(new_line("a"))
            if (group%line > 0) then
               call lines%add(self%file_name//":"//to_text(group%line))
            else
               call lines%add(self%file_name//" (override)")
            end if
            call lines%add(": unknown group '&"//group%name//"'"//close)
         end associate
      end do
      if (n_unknown == 0) return
      if (n_unknown > max_lines) call lines%add(new_line("a")//"and "//to_text(n_unknown - max_lines)// &
                                                " more")
      call fail(error, &
                lines%text()//new_line("a")//self%file_name//": known groups: "//join(self%known, ", "))
   end subroutine document_expect_groups

   !> Gives the key at `path` another value, in namelist form; the path names a group by its number or label.
   !> A single group that the file does not have is added.
   pure subroutine document_set(self, path, value_text, error)
      class(document_t), intent(inout) :: self
      character(*), intent(in) :: path                      !! like law(2)%gap, see `path_help`
      character(*), intent(in) :: value_text                !! like 1.5e-3 or 'newton' or 3, 5
      type(error_t), allocatable, intent(out) :: error
      type(content_t) :: content
      type(scan_t) :: scan
      character(:), allocatable :: body, key, name, place, selector
      integer :: i_group

      place = "override '"//shown(path)//" = "//shown(value_text)//"': "
      if (index(path//value_text, achar(0)) > 0) then
         call fail(error, place//"contains a NUL byte")
         return
      end if
      call split_path(trim(adjustl(path)), name, selector, key)
      if (.not. is_name(name) .or. len(key) == 0) then
         call fail(error, place//"is no path to a key; "//path_help)
         return
      end if
      body = key//" = "//value_text//new_line("a")//"/"
      call parse_body(body, scan, name, content)
      if (allocated(scan%problem)) then
         call fail(error, place//scan%problem)
         return
      else if (scan%position <= len(body) .or. content%names%n /= 1) then
         call fail(error, place//"must be one key with its values; "//path_help)
         return
      else if (content%keys(1)%second_line > 0) then
         call fail(error, place//"must be one key with its values; "//path_help)
         return
      end if
      if (self%count(name) == 0 .and. len(selector) == 0) then
         if (allocated(self%known)) then
            if (.not. is_known(self, name)) then
               call fail(error, place//"unknown group '&"//name//"'"//advice_on_group(self, name))
               return
            end if
         end if
         call add_group(self, name)
      end if
      call select_group(self, name, selector, i_group, error)
      if (allocated(error)) then
         error%message = place//error%message
         return
      end if
      call override(self%holders(i_group)%group%content, content)
   end subroutine document_set

   !> Fails with the problems of all groups, one per line.
   pure subroutine document_finish(self, error)
      class(document_t), intent(in) :: self
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: problem
      type(text_builder_t) :: lines
      integer :: i, n_groups

      n_groups = 0
      do i = 1, self%n_groups
         associate (group => self%holders(i)%group)
            if (group%was_opened) then
               call group%finish(problem)
            else if (group%line == 0) then
               call fail(problem, self%file_name//" (override): &"//group%name//": nothing reads this group")
            else
               cycle
            end if
         end associate
         if (.not. allocated(problem)) cycle
         n_groups = n_groups + 1
         if (n_groups > 1) call lines%add(new_line("a"))
         if (n_groups > max_lines) then
            call lines%add(self%file_name//": and more problems in the groups that follow")
            exit
         end if
         call lines%add(problem%message)
      end do
      if (n_groups > 0) call fail(error, lines%text())
   end subroutine document_finish

   !> Copies the groups of some names, as they are, into a document of their own.
   pure subroutine document_take_groups(self, names, other)
      class(document_t), intent(in) :: self
      character(*), intent(in) :: names(:)                  !! lower case
      type(document_t), intent(out) :: other
      integer, allocatable :: name_of(:)
      integer :: i, i_name, n

      other%file_name = self%file_name
      other%keeps_values = self%keeps_values
      if (allocated(self%known)) other%known = self%known
      n = 0
      do i = 1, self%n_groups
         if (any(names == self%holders(i)%group%name)) n = n + 1
      end do
      allocate (other%holders(max(n, 1)), name_of(n), other%n_of(0), other%first_of(0), other%order(0))
      do i = 1, self%n_groups
         if (.not. any(names == self%holders(i)%group%name)) cycle
         other%n_groups = other%n_groups + 1
         other%holders(other%n_groups)%group = self%holders(i)%group
         i_name = other%names%find(self%holders(i)%group%name)
         if (i_name == 0) then
            call other%names%add(self%holders(i)%group%name)
            i_name = other%names%n
         end if
         name_of(other%n_groups) = i_name
      end do
      call sort_by_name(other, name_of)
   end subroutine document_take_groups

   !> Keeps no text of the values that are read from now on: `complete` is not asked for, reading is faster by a quarter.
   !> Copies behave likewise.
   pure subroutine document_forget_values(self)
      class(document_t), intent(inout) :: self
      integer :: i

      self%keeps_values = .false.
      do i = 1, self%n_groups
         self%holders(i)%group%keeps_values = .false.
      end do
   end subroutine document_forget_values

   !> The input after defaults and overrides: all groups that were read, with every key asked for. Reading it
   !> again gives the same values; left out is what a namelist cannot express: values not allocated, empty
   !> lists, NaN, infinity, strings of several lines.
   pure function document_complete(self) result(text)
      class(document_t), intent(in) :: self
      character(:), allocatable :: text
      type(text_builder_t) :: lines
      integer :: i

      do i = 1, self%n_groups
         if (self%holders(i)%group%was_opened) call lines%add(self%holders(i)%group%complete())
      end do
      text = lines%text()
   end function document_complete

   !> Appends a group to the list; the groups before it keep their addresses.
   pure subroutine append_group(self, name, line, content)
      type(document_t), intent(inout) :: self
      character(*), intent(in) :: name
      integer, intent(in) :: line
      type(content_t), intent(in), optional :: content
      type(holder_t), allocatable :: larger(:)
      integer :: i

      if (self%n_groups == size(self%holders)) then
         allocate (larger(2*self%n_groups))
         do i = 1, self%n_groups
            call move_alloc(self%holders(i)%group, larger(i)%group)
         end do
         call move_alloc(larger, self%holders)
      end if
      self%n_groups = self%n_groups + 1
      allocate (self%holders(self%n_groups)%group)
      call new_group(self%holders(self%n_groups)%group, name, self%file_name, line, content)
      self%holders(self%n_groups)%group%keeps_values = self%keeps_values
   end subroutine append_group

   !> Adds the first group of a name.
   pure subroutine add_group(self, name)
      type(document_t), intent(inout) :: self
      character(*), intent(in) :: name

      call append_group(self, name, 0)
      call self%names%add(name)
      self%n_of = [self%n_of, 1]
      self%first_of = [self%first_of, self%n_groups]
      self%order = [self%order, self%n_groups]
   end subroutine add_group

   !> Sorts the groups by name in linear time, file order within a name, and numbers them.
   pure subroutine sort_by_name(self, name_of)
      type(document_t), intent(inout) :: self
      integer, intent(in) :: name_of(:)
      integer :: i, k, next(self%names%n)

      deallocate (self%n_of, self%first_of, self%order)
      allocate (self%n_of(self%names%n), source=0)
      allocate (self%first_of(self%names%n), self%order(self%n_groups))
      do i = 1, self%n_groups
         self%n_of(name_of(i)) = self%n_of(name_of(i)) + 1
      end do
      k = 1
      do i = 1, self%names%n
         self%first_of(i) = k
         k = k + self%n_of(i)
      end do
      next = self%first_of
      do i = 1, self%n_groups
         k = name_of(i)
         self%order(next(k)) = i
         self%holders(i)%group%number = next(k) - self%first_of(k) + 1
         self%holders(i)%group%is_repeated = self%n_of(k) > 1
         next(k) = next(k) + 1
      end do
   end subroutine sort_by_name

   !> Position of the i-th group of a name, which must exist.
   pure integer function position_of(self, name, i) result(position)
      class(document_t), intent(in) :: self
      character(*), intent(in) :: name
      integer, intent(in) :: i

      position = self%order(self%first_of(self%names%find(lower(trim(name)))) + i - 1)
   end function position_of

   !> Fails when there is more than one group of the name.
   pure subroutine check_single(self, name, error)
      class(document_t), intent(in) :: self
      character(*), intent(in) :: name
      type(error_t), allocatable, intent(out) :: error

      if (self%count(name) < 2) return
      call fail(error, &
                self%file_name//":"//to_text(self%holders(position_of(self, name, 2))%group%line)//": &"// &
                lower(trim(name))//" is given "//to_text(self%count(name))//" times, first in line "// &
                to_text(self%holders(position_of(self, name, 1))%group%line)//"; give it once")
   end subroutine check_single

   pure logical function is_known(self, name)
      class(document_t), intent(in) :: self
      character(*), intent(in) :: name
      integer :: i

      is_known = .false.
      do i = 1, size(self%known)
         is_known = is_known .or. self%known(i)%value == name
      end do
   end function is_known

   !> What is close to the name of a missing group: among the known names, else among those of the file.
   pure function advice_on_group(self, name) result(text)
      class(document_t), intent(in) :: self
      character(*), intent(in) :: name
      character(:), allocatable :: text
      type(string_t), allocatable :: known(:)

      if (allocated(self%known)) then
         if (.not. is_known(self, lower(trim(name)))) then
            text = suggestion(name, self%known)//" known groups: "//join(self%known, ", ")
            return
         end if
      end if
      call names_in_file(self, known)
      if (size(known) == 0) then
         text = "; the file has no groups"
      else
         text = suggestion(name, known)//" the file has: "//join(known, ", ")
      end if
   end function advice_on_group

   !> The close name in a question, or just the semicolon.
   pure function suggestion(name, known) result(text)
      character(*), intent(in) :: name
      type(string_t), intent(in) :: known(:)
      character(:), allocatable :: text

      text = closest_word(name, known)
      if (text /= "") text = " did you mean '&"//text//"'?"
      text = ";"//text
   end function suggestion

   !> Names of the groups that there are, the first twenty.
   pure subroutine names_in_file(self, known)
      class(document_t), intent(in) :: self
      type(string_t), allocatable, intent(out) :: known(:)
      integer :: i

      allocate (known(min(20, self%names%n)))
      do i = 1, size(known)
         known(i)%value = trim(self%names%names(i))
      end do
   end subroutine names_in_file

   !> Cuts name(selector)%key into its parts; the selector is empty without brackets, the key in a wrong path.
   pure subroutine split_path(path, name, selector, key)
      character(*), intent(in) :: path
      character(:), allocatable, intent(out) :: name, selector, key
      integer :: close, first

      selector = ""
      key = ""
      first = scan(path, "(%")
      name = lower(trim(path(1:max(0, first - 1))))
      if (first == 0) return
      if (path(first:first) == "%") then
         key = trim(adjustl(path(first + 1:)))
         return
      end if
      close = index(path, ")%")
      if (close <= first + 1) return
      selector = trim(adjustl(path(first + 1:close - 1)))
      if (len(selector) > 0) key = trim(adjustl(path(close + 2:)))
   end subroutine split_path

   !> Number of the group that a path names.
   pure subroutine select_group(self, name, selector, i_group, error)
      class(document_t), intent(in) :: self
      character(*), intent(in) :: name, selector
      integer, intent(out) :: i_group
      type(error_t), allocatable, intent(out) :: error
      type(string_t), allocatable :: labels(:)
      character(:), allocatable :: text
      integer :: i, n, n_matches, number
      logical :: is_number

      i_group = 0
      n = self%count(name)
      if (n == 0) then
         call fail(error, "there is no group '&"//name//"'"//advice_on_group(self, name))
         return
      end if
      if (len(selector) == 0) then
         i_group = position_of(self, name, 1)
         if (n > 1) call fail(error, &
               "there are "//to_text(n)//" groups &"//name//"; write "//name//"(1) to "//name// &
                              "("//to_text(n)//"), or "//name//"(label)")
         return
      end if
      call parse_integer(selector, number, is_number)
      if (is_number) then
         if (number < 1 .or. number > n) then
            call fail(error, &
                  "there is no "//name//"("//shown(selector)//"); the file has "//name//"(1) to "//name// &
                      "("//to_text(n)//")")
         else
            i_group = position_of(self, name, number)
         end if
         return
      end if
      allocate (labels(n))
      n_matches = 0
      do i = 1, n
         labels(i)%value = label_of(self%holders(position_of(self, name, i))%group)
         if (labels(i)%value /= selector) cycle
         n_matches = n_matches + 1
         i_group = position_of(self, name, i)
      end do
      if (n_matches > 1) then
         call fail(error, &
                   to_text(n_matches)//" groups &"//name//" have the label "//quote(shown(selector))// &
                   "; use their numbers")
      else if (n_matches == 0) then
         text = closest_word(selector, labels)
         if (text /= "") text = " did you mean "//quote(text)//"?"
         call fail(error, "no group &"//name//" has the label "//quote(shown(selector))//";"//text// &
                   labels_text(labels))
      end if
   end subroutine select_group

   !> The first twenty labels that are not empty, for a message.
   pure function labels_text(labels) result(text)
      type(string_t), intent(in) :: labels(:)
      character(:), allocatable :: text
      integer :: i, n

      text = ""
      n = 0
      do i = 1, size(labels)
         if (len(labels(i)%value) == 0 .or. n == 20) cycle
         n = n + 1
         if (n > 1) text = text//", "
         text = text//quote(shown(labels(i)%value))
      end do
      if (n == 0) then
         text = " none has one, use their numbers"
      else
         text = " labels: "//text
      end if
   end function labels_text

   !> Value of the key `label` of a group, empty when it has none.
   pure function label_of(group) result(label)
      type(group_t), intent(in) :: group
      character(:), allocatable :: label
      integer :: i_key

      label = ""
      i_key = group%content%names%find("label")
      if (.not. group%content%is_given(i_key)) return
      if (group%content%keys(i_key)%head > 0) label = trim(group%content%word(group%content%keys(i_key)%head))
   end function label_of
end module hb_namelist
