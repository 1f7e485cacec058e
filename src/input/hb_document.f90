!> A document: the groups of properties of an input, by name and number, from a file or from a program.
!>
!> hb_namelist reads documents from files. A caller with numbers writes
!>
!>     call new_document(document)
!>     law => document%add("law")
!>     call law%set("type", "cubic_spring")
!>
!> and the reader calls
!>
!>     call document%expect_groups(["newton", "law   "], error)
!>     group => document%optional_group("newton")
!>     call group%get("tolerance", tolerance)                    ! as often as needed, no check in between
!>     call document%finish(error)                               ! all problems of all groups at once
!>
!> A parameter is a handle to one value: its path is looked up once, and setting it is a store. The document records
!> the numbers that have changed since `accept_changes`, and the groups of which anything else has. Values that follow others
!> (`&tie`) may not be set on their own.
!>
!> The variable that contains a document needs the attribute `target`. Pointers to its groups are valid until an
!> assignment changes it or it is deallocated. Assignment makes a deep copy; parameters are valid for the copy as
!> well.
module hb_document
   use hb_error, only: error_t, fail
   use hb_input_keys, only: kind_of, max_unit
   use hb_kinds, only: wp
   use hb_parameter_path, only: path_help, select_group, split_index, split_path
   use hb_properties, only: properties_t
   use hb_property_groups, only: groups_t, new_groups
   use hb_property_values, only: number_value, value_t
   use hb_similar_word, only: closest_word
   use hb_text, only: is_name, join, lower, max_name, string_t, text_builder_t, to_text
   implicit none
   private
   public :: document_t, new_document, parameter_t, tied_t

   integer, parameter :: max_lines = 200                    !! of a message
   integer, parameter :: max_changes = 64                   !! numbers; for more the groups are marked

   !> Handle to one value of a document, which stores numbers or words.
   type :: parameter_t
      integer :: i_group = 0                                !! position in the list of groups
      character(max_name) :: key = ""
      integer :: element(2) = 0                             !! indices, 0 if there are none
      integer :: line = 0                                   !! source line of its values, as in `value_t`
   contains
      procedure :: hides => parameter_hides
   end type parameter_t

   !> A value that follows another one.
   type :: tied_t
      type(parameter_t) :: parameter                        !! the one that follows
      type(parameter_t) :: to                               !! the one that is followed
   end type tied_t

   !> The groups and their permitted names.
   type :: document_t
      character(:), allocatable :: file_name                !! for messages; empty if not from a file
      type(groups_t) :: groups
      type(tied_t), allocatable :: ties(:)                  !! in their order, if there are any
      type(string_t), allocatable, private :: known(:)      !! names that may occur
      type(parameter_t), allocatable, private :: changes(:) !! numbers that have changed, (max_changes)
      integer, private :: n_changes = 0
      integer, private :: reading = 1                       !! number of the present reading
      logical, private :: has_other_groups = .false.        !! groups were removed since `accept_changes`
   contains
      generic :: set => set_number, set_word
      procedure :: accept_changes => document_accept_changes
      procedure :: add => document_add
      procedure :: add_given => document_add_given
      procedure :: begin => document_begin
      procedure :: count => document_count
      procedure :: expect_groups => document_expect_groups
      procedure :: drives => document_drives
      procedure :: finish => document_finish
      procedure :: finish_early => document_finish_early
      procedure :: group => document_group
      procedure :: has_changed => document_has_changed
      procedure :: is_given => document_is_given
      procedure :: is_of_file => document_is_of_file
      procedure :: is_real => document_is_real
      procedure :: n_tones_of => document_n_tones_of
      procedure :: number_at => document_number_at
      procedure :: optional_group => document_optional_group
      procedure :: reject_tied => document_reject_tied
      procedure :: reject_unknown => document_reject_unknown
      procedure :: required_group => document_required_group
      procedure :: remove => document_remove
      procedure :: remove_group => document_remove_group
      procedure :: resolve => document_resolve
      procedure :: adopt_changes => document_adopt_changes
      procedure :: unit_of => document_unit_of
      procedure, private :: set_number => document_set_number
      procedure, private :: set_word => document_set_word
   end type document_t

contains

   !> Creates a document without groups.
   pure subroutine new_document(self, file_name)
      type(document_t), intent(out) :: self
      character(*), intent(in), optional :: file_name       !! for messages

      self%file_name = ""
      if (present(file_name)) self%file_name = trim(file_name)
      call new_groups(self%groups)
   end subroutine new_document

   !> Adds a group of the given name and returns it.
   function document_add(self, name) result(group)
      class(document_t), target, intent(inout) :: self
      character(*), intent(in) :: name
      type(properties_t), pointer :: group

      call self%groups%add(lower(trim(name)), self%file_name, 0)
      group => self%groups%holders(self%groups%n)%group
   end function document_add

   !> Adds a group as if it were written in an input: it need not be read. `handle` identifies it until it is removed. Fails for an
   !> unknown name.
   subroutine document_add_given(self, name, handle, error)
      class(document_t), intent(inout) :: self
      character(*), intent(in) :: name
      integer, intent(out) :: handle
      type(error_t), allocatable, intent(out) :: error
      integer :: position

      handle = 0
      if (allocated(self%known)) then
         if (.not. is_known(self, lower(trim(name)))) then
            call fail_with_advice("unknown group '&"//lower(trim(name))//"'", self, name, error)
            return
         end if
      end if
      position = self%groups%n + 1
      if (self%count(name) == 1 .and. .not. self%is_given(name)) position = self%groups%position_of(name, 1)   ! of a reading
      if (position > self%groups%n) call self%groups%add(lower(trim(name)), self%file_name, position)
      associate (group => self%groups%holders(position)%group)
         group%line = position
         group%has_changed = .true.
         handle = group%handle
      end associate
   end subroutine document_add_given

   !> Removes the group at a position.
   subroutine document_remove_group(self, position)
      class(document_t), intent(inout) :: self
      integer, intent(in) :: position

      call self%groups%remove(position)
      self%has_other_groups = .true.                        ! all is read again,
      self%n_changes = 0                                    ! and positions of other groups differ
      if (allocated(self%ties)) deallocate (self%ties)
   end subroutine document_remove_group

   !> Begins another reading: a group that is opened in it has no requested keys yet.
   pure subroutine document_begin(self)
      class(document_t), intent(inout) :: self

      self%reading = self%reading + 1
   end subroutine document_begin

   !> Number of groups of a name.
   pure integer function document_count(self, name) result(n)
      class(document_t), intent(in) :: self
      character(*), intent(in) :: name

      n = self%groups%count(name)
   end function document_count

   !> Whether the input has a group of a name: not one that a reading has added for its defaults.
   pure logical function document_is_given(self, name) result(is_given)
      class(document_t), intent(in) :: self
      character(*), intent(in) :: name

      is_given = self%count(name) > 0
      if (is_given) is_given = is_of_input(self%groups%holders(self%groups%position_of(name, 1))%group)
   end function document_is_given

   !> Whether the groups are those of a file, not of a program: a name that is empty, or a folder, is none of a file.
   pure logical function document_is_of_file(self) result(is_of_file)
      class(document_t), intent(in) :: self

      is_of_file = index(self%file_name, "/", back=.true.) < len(self%file_name)
   end function document_is_of_file

   !> Whether a group is written in the input, or one of its keys was set.
   pure logical function is_of_input(group)
      type(properties_t), intent(in) :: group
      integer :: k

      is_of_input = group%line > 0 .or. any([(group%content%is_given(k), k=1, group%content%names%n)])
   end function is_of_input

   !> Returns the i-th group of a name in the order of the input, null if there are fewer. `finish` reports its
   !> unknown keys.
   function document_group(self, name, i) result(group)
      class(document_t), target, intent(inout) :: self
      character(*), intent(in) :: name
      integer, intent(in) :: i
      type(properties_t), pointer :: group

      group => null()
      if (i < 1 .or. i > self%count(name)) return
      group => self%groups%holders(self%groups%position_of(name, i))%group
      if (group%reading == self%reading) return
      call group%forget()
      group%reading = self%reading
   end function document_group

   !> Returns the only group of a name. A missing group is added without keys, so that defaults are read from it;
   !> `finish` reports a second group of the name.
   function document_optional_group(self, name) result(group)
      class(document_t), target, intent(inout) :: self
      character(*), intent(in) :: name
      type(properties_t), pointer :: group
      type(error_t), allocatable :: error

      if (self%count(name) == 0) call self%groups%add(lower(trim(name)), self%file_name, 0)
      group => self%group(name, 1)
      call check_single(self, name, error)
      if (allocated(error)) call group%problem_as_is(error%message)
   end function document_optional_group

   !> Returns the only group of a name; fails if there is none or more than one.
   subroutine document_required_group(self, name, group, error)
      class(document_t), target, intent(inout) :: self
      character(*), intent(in) :: name
      type(properties_t), pointer, intent(out) :: group
      type(error_t), allocatable, intent(out) :: error

      group => null()
      if (self%count(name) == 0) then
         call fail_with_advice(place_of(self)//"missing group &"//lower(trim(name)), self, name, error)
         return
      end if
      call check_single(self, name, error)
      if (allocated(error)) return
      group => self%group(name, 1)
   end subroutine document_required_group

   !> Fails if the file has groups of other names than these; the message names all of them.
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
            if (group%line > 0 .and. self%is_of_file()) then
               call lines%add(self%file_name//":"//to_text(group%line)//": ")
            else if (self%is_of_file()) then
               call lines%add(self%file_name//" (override): ")
            end if
            call lines%add("unknown group '&"//group%name//"'"//close)
         end associate
      end do
      if (n_unknown == 0) return
      if (n_unknown > max_lines) call lines%add(new_line("a")//"and "//to_text(n_unknown - max_lines)// &
                                                " more")
      call fail(error, &
                lines%text()//new_line("a")//place_of(self)//"known groups: "//join(self%known, ", "))
   end subroutine document_expect_groups

   !> Looks up the value at `path`, which names a group by its number or label. A missing single group is added.
   pure subroutine document_resolve(self, path, parameter, error)
      class(document_t), intent(inout) :: self
      character(*), intent(in) :: path                      !! like law(2)%gap, see `path_help`
      type(parameter_t), intent(out) :: parameter
      type(error_t), allocatable, intent(out) :: error
      character(:), allocatable :: key, key_with_index, name, selector
      logical :: is_good

      call split_path(trim(adjustl(path)), name, selector, key_with_index)
      call split_index(key_with_index, key, parameter%element(1), parameter%element(2), is_good)
      if (.not. (is_good .and. is_name(name))) then
         call fail(error, "is not a path to a key; "//path_help)
         return
      end if
      parameter%key = key
      if (self%count(name) == 0) then
         if (allocated(self%known)) is_good = is_known(self, name)
         if (len(selector) > 0 .or. .not. is_good) then
            if (len(selector) == 0 .and. self%count("law") > 0) then
               call select_group(self%groups, "law", name, parameter%i_group, error)
               is_good = .not. allocated(error)
               if (is_good) then
                  call fail(error, "a law is named by its label in brackets: law("//name//")%"//key_with_index)
                  return
               end if
            end if
            key = "there is no group '&"
            if (len(selector) == 0) key = "unknown group '&"
            call fail_with_advice(key//name//"'", self, name, error)
            return
         end if
         call self%groups%add(name, self%file_name, 0)
      end if
      call select_group(self%groups, name, selector, parameter%i_group, error)
   end subroutine document_resolve

   !> Sets a parameter. Unless it is an element, the number replaces all values of its key.
   pure subroutine document_set_number(self, parameter, number)
      class(document_t), intent(inout) :: self
      type(parameter_t), intent(in) :: parameter
      real(wp), intent(in) :: number
      type(value_t) :: value
      logical :: has_changed

      value = number_value(number)
      value%i = parameter%element(1)
      value%j = parameter%element(2)
      value%line = parameter%line
      has_changed = .false.
      associate (group => self%groups%holders(parameter%i_group)%group)
         call group%content%replace(trim(parameter%key), [value], has_changed)
         if (has_changed .and. .not. group%has_changed) call note_change(self, parameter)
      end associate
   end subroutine document_set_number

   !> Adds a number to those that have changed, or marks its group if these are many.
   pure subroutine note_change(self, parameter)
      class(document_t), intent(inout) :: self
      type(parameter_t), intent(in) :: parameter
      integer :: i

      if (.not. allocated(self%changes)) allocate (self%changes(max_changes))
      do i = 1, self%n_changes
         if (self%changes(i)%hides(parameter) .and. parameter%hides(self%changes(i))) return
      end do
      if (self%n_changes == max_changes) then
         self%groups%holders(parameter%i_group)%group%has_changed = .true.
      else
         self%n_changes = self%n_changes + 1
         self%changes(self%n_changes) = parameter
      end if
   end subroutine note_change

   !> Returns the numbers that have changed, and forgets them: the caller sets them, or reads everything again.
   pure subroutine document_adopt_changes(self, changes)
      class(document_t), intent(inout) :: self
      type(parameter_t), allocatable, intent(out) :: changes(:)

      allocate (changes(self%n_changes))
      if (self%n_changes > 0) changes = self%changes(:self%n_changes)
      self%n_changes = 0
   end subroutine document_adopt_changes

   !> Sets a value of the input to a word.
   pure subroutine document_set_word(self, parameter, word)
      class(document_t), intent(inout) :: self
      type(parameter_t), intent(in) :: parameter
      character(*), intent(in) :: word
      type(string_t) :: words(1)

      words(1)%value = word
      associate (group => self%groups%holders(parameter%i_group)%group)
         call group%content%replace_words(trim(parameter%key), words, group%has_changed, parameter%element, parameter%line)
      end associate
   end subroutine document_set_word

   !> Removes the values of a key.
   pure subroutine document_remove(self, parameter)
      class(document_t), intent(inout) :: self
      type(parameter_t), intent(in) :: parameter
      type(value_t) :: none(0)

      associate (group => self%groups%holders(parameter%i_group)%group)
         call group%content%replace(trim(parameter%key), none, group%has_changed)
      end associate
   end subroutine document_remove

   !> Returns the number of a parameter; not found if the input has none or a word.
   pure subroutine document_number_at(self, parameter, number, is_found)
      class(document_t), intent(in) :: self
      type(parameter_t), intent(in) :: parameter
      real(wp), intent(out) :: number
      logical, intent(out) :: is_found
      integer :: i, k

      number = 0.0_wp
      is_found = .false.
      i = number_of_key(self, parameter)
      if (i == 0) return
      associate (key => self%groups%holders(parameter%i_group)%group%content%keys(i), element => parameter%element)
         k = key%element_at(max(1, element(1)), element(2))
         if (k == 0 .and. element(2) == 0) k = key%listed_at(element(1))
         if (k == 0 .and. element(2) > 0 .and. element(2) <= key%row_length .and. key%requested > 0) &
            k = key%listed_at((element(1) - 1)*key%row_length + element(2))   ! of a matrix, row by row
         if (k == 0) return
         is_found = any(key%values(k)%kind == [kind_of%number, kind_of%whole])
         if (is_found) number = key%values(k)%number
      end associate
   end subroutine document_number_at

   !> Whether another value follows one of the key of a parameter.
   pure logical function document_drives(self, parameter) result(drives)
      class(document_t), intent(in) :: self
      type(parameter_t), intent(in) :: parameter
      integer :: i

      drives = .false.
      if (.not. allocated(self%ties)) return
      do i = 1, size(self%ties)
         associate (to => self%ties(i)%to)
            drives = drives .or. (to%i_group == parameter%i_group .and. to%key == parameter%key)
         end associate
      end do
   end function document_drives

   !> Fails if a parameter follows another one, because nothing else may change it.
   pure subroutine document_reject_tied(self, parameter, path, error)
      class(document_t), intent(in) :: self
      type(parameter_t), intent(in) :: parameter
      character(*), intent(in) :: path                      !! of the parameter, for the message
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      if (.not. allocated(self%ties)) return
      do i = 1, size(self%ties)
         associate (tie => self%ties(i))
            if (.not. (parameter%hides(tie%parameter) .or. tie%parameter%hides(parameter))) cycle
            call fail(error, "'"//trim(path)//"' follows '"//trim(self%groups%holders(tie%to%i_group)%group%name)//"%"// &
                      trim(tie%to%key)//"' by &tie number "//to_text(i)//"; vary that, or remove the &tie")
            return
         end associate
      end do
   end subroutine document_reject_tied

   !> Fails if the table of keys has no key of this name for the group of a parameter.
   pure subroutine document_reject_unknown(self, parameter, path, error)
      class(document_t), intent(in) :: self
      type(parameter_t), intent(in) :: parameter
      character(*), intent(in) :: path                      !! of the parameter, for the message
      type(error_t), allocatable, intent(out) :: error
      character(:), allocatable :: text

      associate (group => self%groups%holders(parameter%i_group)%group)
         if (group%has_key(trim(parameter%key))) return
         call group%describe_unknown(trim(parameter%key), text)
      end associate
      call fail(error, "'"//trim(path)//"': "//text)
   end subroutine document_reject_unknown

   !> Whether the values of a parameter replace all of those of another: the same key as a whole, or the same element.
   pure logical function parameter_hides(self, other) result(hides)
      class(parameter_t), intent(in) :: self
      type(parameter_t), intent(in) :: other

      hides = self%i_group == other%i_group .and. self%key == other%key .and. &
         (all(self%element == 0) .or. all(self%element == other%element))
   end function parameter_hides

   !> Unit of a parameter, padded with blanks, as its reader declares it; 1 for an integer; empty if it is not
   !> declared or has not been read yet.
   pure function document_unit_of(self, parameter) result(unit)
      class(document_t), intent(in) :: self
      type(parameter_t), intent(in) :: parameter
      character(max_unit) :: unit
      integer :: i

      unit = ""
      i = number_of_key(self, parameter)
      if (i == 0) return
      associate (key => self%groups%holders(parameter%i_group)%group%content%keys(i))
         if (key%requested == 0) return
         unit = key%unit
         if (unit == "" .and. key%kind == kind_of%whole) unit = "1"
      end associate
   end function document_unit_of

   !> Whether the reader of a parameter reads it as a real number; false until it has been read.
   pure logical function document_is_real(self, parameter) result(is_real)
      class(document_t), intent(in) :: self
      type(parameter_t), intent(in) :: parameter
      integer :: i

      is_real = .false.
      i = number_of_key(self, parameter)
      if (i == 0) return
      associate (key => self%groups%holders(parameter%i_group)%group%content%keys(i))
         is_real = key%requested > 0 .and. key%kind == kind_of%number
      end associate
   end function document_is_real

   !> Number of tones of the input if a parameter is the frequency of all of them, 0 otherwise.
   pure integer function document_n_tones_of(self, parameter) result(n_tones)
      class(document_t), intent(in) :: self
      type(parameter_t), intent(in) :: parameter
      integer :: i

      n_tones = 0
      i = number_of_key(self, parameter)
      associate (group => self%groups%holders(parameter%i_group)%group)
         if (i == 0 .or. group%name /= "tones" .or. parameter%element(1) > 0) return
         if (all(parameter%key /= [character(9) :: "frequency", "hertz"])) return
         n_tones = max(group%content%keys(i)%n_listed, group%content%keys(i)%n_elements)
      end associate
   end function document_n_tones_of

   !> Number of the key of a parameter in its group, 0 where that has none.
   pure integer function number_of_key(self, parameter)
      class(document_t), intent(in) :: self
      type(parameter_t), intent(in) :: parameter

      number_of_key = self%groups%holders(parameter%i_group)%group%content%names%find(trim(parameter%key))
   end function number_of_key

   !> Whether a value has changed since `accept_changes`, in groups of some names or in any group; numbers that were taken
   !> do not count.
   pure logical function document_has_changed(self, names) result(has_changed)
      class(document_t), intent(in) :: self
      character(*), intent(in), optional :: names(:)        !! lower case
      integer :: i

      has_changed = self%has_other_groups .and. .not. present(names)
      do i = 1, self%groups%n
         associate (group => self%groups%holders(i)%group)
            if (group%has_changed) has_changed = has_changed .or. is_one(group%name)
         end associate
      end do
      do i = 1, self%n_changes
         has_changed = has_changed .or. is_one(self%groups%holders(self%changes(i)%i_group)%group%name)
      end do

   contains

      pure logical function is_one(name)
         character(*), intent(in) :: name

         is_one = .true.
         if (present(names)) is_one = any(names == name)
      end function is_one
   end function document_has_changed

   !> Removes the markers of changes.
   pure subroutine document_accept_changes(self)
      class(document_t), intent(inout) :: self
      integer :: i

      do i = 1, self%groups%n
         self%groups%holders(i)%group%has_changed = .false.
      end do
      self%n_changes = 0
      self%has_other_groups = .false.
   end subroutine document_accept_changes

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
            if (group%reading == self%reading) then
               call group%finish(problem)
            else if (group%line == 0 .and. group%reading == 0) then
               call group%reject_unread(problem)
            else
               cycle
            end if
         end associate
         if (.not. allocated(problem)) cycle
         n_groups = n_groups + 1
         if (n_groups > 1) call lines%add(new_line("a"))
         if (n_groups > max_lines) then
            call lines%add(place_of(self)//"and further errors in the groups that follow")
            exit
         end if
         call lines%add(problem%message)
      end do
      if (n_groups > 0) call fail(error, lines%text())
   end subroutine document_finish

   !> Adds to an error that ended the reading what is known of other groups: problems of those read before it, and keys that do
   !> not exist of those that follow.
   pure subroutine document_finish_early(self, error)
      class(document_t), intent(in) :: self
      type(error_t), allocatable, intent(inout) :: error
      type(error_t), allocatable :: problem
      integer :: i, n, n_groups

      n_groups = 0
      do i = 1, self%groups%n
         associate (group => self%groups%holders(i)%group)
            if (group%reading /= self%reading) then
               call group%reject_unknown(problem)
            else if (group%has_problems()) then
               call group%finish(problem)
               n = scan(problem%message//new_line("a"), new_line("a")) - 1
               if (index(error%message, problem%message(:n)) > 0) cycle   ! the group that ended the reading
            else
               cycle
            end if
         end associate
         if (.not. allocated(problem)) cycle
         n_groups = n_groups + 1
         if (n_groups > max_lines) exit
         error%message = error%message//new_line("a")//problem%message
      end do
   end subroutine document_finish_early

   !> Fails if there is more than one group of the name.
   pure subroutine check_single(self, name, error)
      class(document_t), intent(in) :: self
      character(*), intent(in) :: name
      type(error_t), allocatable, intent(out) :: error

      if (self%count(name) < 2) return
      if (.not. self%is_of_file()) then
         call fail(error, "&"//lower(trim(name))//" is given "//to_text(self%count(name))//" times; give it once")
         return
      end if
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

   !> The file for messages, with a colon; empty for a text without a file, whose name is a folder or empty.
   pure function place_of(self) result(place)
      class(document_t), intent(in) :: self
      character(merge(len(self%file_name) + 2, 0, document_is_of_file(self))) :: place

      if (len(place) > 0) place = self%file_name//": "
   end function place_of

   !> Fails with the closest name for a missing group: among the known names, otherwise among those of the file.
   pure subroutine fail_with_advice(message, self, name, error)
      character(*), intent(in) :: message
      class(document_t), intent(in) :: self
      character(*), intent(in) :: name
      type(error_t), allocatable, intent(out) :: error
      character(:), allocatable :: close, list
      type(string_t), allocatable :: known(:)
      logical :: is_misspelt

      is_misspelt = .false.
      if (allocated(self%known)) is_misspelt = .not. is_known(self, lower(trim(name)))
      if (is_misspelt) then
         known = self%known
         list = " known groups: "
      else
         call names_in_file(self, known)
         list = " the input has: "
      end if
      close = closest_word(name, known)
      if (close /= "") close = " did you mean '&"//close//"'?"
      if (size(known) == 0) list = " the input has no groups"
      call fail(error, message//";"//close//list//join(known, ", "))
   end subroutine fail_with_advice

   !> Names of the groups of the file, at most twenty, without those that readers have added for their defaults.
   pure subroutine names_in_file(self, known)
      class(document_t), intent(in) :: self
      type(string_t), allocatable, intent(out) :: known(:)
      integer :: i, k, n

      allocate (known(20))
      n = 0
      do i = 1, self%groups%n
         associate (group => self%groups%holders(i)%group)
            if (.not. is_of_input(group)) cycle
            if (n == size(known) .or. any([(known(k)%value == group%name, k=1, n)])) cycle
            n = n + 1
            known(n)%value = group%name
         end associate
      end do
      known = known(:n)
   end subroutine names_in_file
end module hb_document
