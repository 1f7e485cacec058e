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
   use hb_closest_word, only: closest_word
   use hb_error, only: error_t, fail
   use hb_namelist_content, only: content_t
   use hb_namelist_group, only: group_t
   use hb_namelist_groups, only: groups_t, max_groups, new_groups
   use hb_namelist_parser, only: next_group, parse_body
   use hb_namelist_path, only: path_help, select_group, split_path
   use hb_namelist_scan, only: is_name, scan_t, shown
   use hb_text, only: join, lower, string_t, text_builder_t, to_text
   implicit none
   private
   public :: document_t, group_t, new_document

   integer, parameter :: max_lines = 200                    !! of a message

   !> The groups of a file, and the names that they may have.
   type :: document_t
      character(:), allocatable :: file_name
      type(groups_t), private :: groups
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
      integer :: i, line, n

      self%file_name = trim(file_name)
      call new_groups(self%groups)
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
         if (self%groups%n == max_groups) then
            call fail(error, &
                      self%file_name//":"//to_text(line)//": more than "//to_text(max_groups)//" groups")
            return
         end if
         call self%groups%append(name, self%file_name, line, content)
      end do
      if (allocated(scan%problem)) then
         call fail(error, self%file_name//":"//to_text(scan%problem_line)//": "//scan%problem)
         return
      end if
      call self%groups%sort()
   end subroutine new_document

   !> Number of groups of a name.
   pure integer function document_count(self, name) result(n)
      class(document_t), intent(in) :: self
      character(*), intent(in) :: name

      n = self%groups%count(name)
   end function document_count

   !> The i-th group of a name in file order, null when there are fewer. `finish` reports its unknown keys.
   function document_group(self, name, i) result(group)
      class(document_t), target, intent(inout) :: self
      character(*), intent(in) :: name
      integer, intent(in) :: i
      type(group_t), pointer :: group

      group => null()
      if (i < 1 .or. i > self%count(name)) return
      group => self%groups%holders(self%groups%position_of(name, i))%group
      group%was_opened = .true.
   end function document_group

   !> The only group of a name, added without keys when the file has none, so that defaults are read from it.
   !> A second group of the name is a problem that `finish` reports.
   function document_optional_group(self, name) result(group)
      class(document_t), target, intent(inout) :: self
      character(*), intent(in) :: name
      type(group_t), pointer :: group
      type(error_t), allocatable :: error

      if (self%count(name) == 0) call self%groups%add(lower(trim(name)), self%file_name)
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
      do i = 1, self%groups%n
         associate (group => self%groups%holders(i)%group)
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
   pure subroutine document_set(self, path, value_text, error, sweep_line)
      class(document_t), intent(inout) :: self
      character(*), intent(in) :: path                      !! like law(2)%gap, see `path_help`
      character(*), intent(in) :: value_text                !! like 1.5e-3 or 'newton' or 3, 5
      type(error_t), allocatable, intent(out) :: error
      integer, intent(in), optional :: sweep_line           !! line of the group &sweep that gives the value
      type(content_t) :: content
      type(scan_t) :: scan
      character(:), allocatable :: body, key, name, place, selector
      integer :: i_group, line

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
         call self%groups%add(name, self%file_name)
      else if (self%count(name) == 0) then
         call fail(error, place//"there is no group '&"//name//"'"//advice_on_group(self, name))
         return
      end if
      call select_group(self%groups, name, selector, i_group, error)
      if (allocated(error)) then
         error%message = place//error%message
         return
      end if
      line = 0
      if (present(sweep_line)) line = -sweep_line
      call self%groups%holders(i_group)%group%content%override(content, line)
   end subroutine document_set

   !> Fails with the problems of all groups, one per line.
   pure subroutine document_finish(self, error)
      class(document_t), intent(in) :: self
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: problem
      type(text_builder_t) :: lines
      integer :: i, n_groups

      n_groups = 0
      do i = 1, self%groups%n
         associate (group => self%groups%holders(i)%group)
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

      other%file_name = self%file_name
      if (allocated(self%known)) other%known = self%known
      call self%groups%take(names, other%groups)
   end subroutine document_take_groups

   !> Keeps no text of the values that are read from now on: `complete` is not asked for, reading is faster by a quarter.
   !> Copies behave likewise.
   pure subroutine document_forget_values(self)
      class(document_t), intent(inout) :: self

      call self%groups%forget_values()
   end subroutine document_forget_values

   !> The input after defaults and overrides: all groups that were read, with every key asked for. Reading it
   !> again gives the same values; left out is what a namelist cannot express: values not allocated, empty
   !> lists, NaN, infinity, strings of several lines.
   pure function document_complete(self) result(text)
      class(document_t), intent(in) :: self
      character(:), allocatable :: text
      type(text_builder_t) :: lines
      integer :: i

      do i = 1, self%groups%n
         if (self%groups%holders(i)%group%was_opened) call lines%add(self%groups%holders(i)%group%complete())
      end do
      text = lines%text()
   end function document_complete

   !> Fails when there is more than one group of the name.
   pure subroutine check_single(self, name, error)
      class(document_t), intent(in) :: self
      character(*), intent(in) :: name
      type(error_t), allocatable, intent(out) :: error

      if (self%count(name) < 2) return
      call fail(error, &
                self%file_name//":"//to_text(self%groups%holders(self%groups%position_of(name, 2))%group%line)//": &"// &
                lower(trim(name))//" is given "//to_text(self%count(name))//" times, first in line "// &
                to_text(self%groups%holders(self%groups%position_of(name, 1))%group%line)//"; give it once")
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

      allocate (known(min(20, self%groups%names%n)))
      do i = 1, size(known)
         known(i)%value = trim(self%groups%names%names(i))
      end do
   end subroutine names_in_file
end module hb_namelist
