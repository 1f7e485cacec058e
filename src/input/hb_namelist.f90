!> Conversion of namelist files to documents and back. An own reader, because the compiler's runtime library does not
!> report which key is wrong.
!>
!>     call read_namelist(document, file_name, text, error)
!>     call set_text(document, "law(2)%gap", "1.5e-3", error)    ! overrides, if any
!>     call write_complete_text(document, text)                     ! after it was read: with all defaults
module hb_namelist
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_document, only: document_t, new_document, parameter_t
   use hb_error, only: error_t, fail
   use hb_input_keys, only: input_groups, kind_of
   use hb_kinds, only: int64, wp
   use hb_namelist_parser, only: next_group, parse_body, scan_t
   use hb_parameter_path, only: path_help, split_path
   use hb_properties, only: properties_t
   use hb_property_groups, only: max_groups
   use hb_property_values, only: content_t, key_t
   use hb_text, only: is_name, quote, shown, string_t, text_builder_t, to_text
   implicit none
   private
   public :: read_namelist, set_text, write_complete_text

   integer, parameter :: line_width = 100                   !! of what `write_complete_text` gives

contains

   !> Parses the text of a namelist file; fails with file and line if the syntax is wrong.
   pure subroutine read_namelist(self, file_name, text, error)
      type(document_t), intent(out) :: self
      character(*), intent(in) :: file_name                 !! for messages
      character(*), intent(in) :: text
      type(error_t), allocatable, intent(out) :: error
      type(scan_t) :: scan
      type(content_t) :: content
      character(:), allocatable :: name
      integer :: i, line, n

      call new_document(self, file_name)
      n = index(text, achar(0))
      if (n > 0) then
         line = 1
         do i = 1, n
            if (text(i:i) == new_line("a")) line = line + 1
         end do
         call fail(error, &
                   self%file_name//":"//to_text(line)//": the file contains a NUL byte; it is not a text file")
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
         call self%groups%add(name, self%file_name, line)
         self%groups%holders(self%groups%n)%group%content = content
      end do
      if (allocated(scan%problem)) then
         call fail(error, self%file_name//":"//to_text(scan%problem_line)//": "//scan%problem)
      end if
   end subroutine read_namelist

   !> Sets the key at `path` to another value in namelist form; the path names a group by its number or label. A
   !> missing single group is added.
   pure subroutine set_text(self, path, value_text, error)
      class(document_t), intent(inout) :: self
      character(*), intent(in) :: path                      !! like law(2)%gap, see `path_help`
      character(*), intent(in) :: value_text                !! like 1.5e-3 or 'newton' or 3, 5
      type(error_t), allocatable, intent(out) :: error
      type(content_t) :: content
      type(parameter_t) :: parameter
      type(scan_t) :: scan
      character(:), allocatable :: body, key, name, location, selector
      logical :: is_one_key

      location = "override '"//shown(path)//" = "//shown(value_text)//"': "
      if (index(path//value_text, achar(0)) > 0) then
         call fail(error, location//"contains a NUL byte")
         return
      end if
      call split_path(trim(adjustl(path)), name, selector, key)
      if (.not. is_name(name) .or. len(key) == 0) then
         call fail(error, location//"is not a path to a key; "//path_help)
         return
      end if
      body = key//" = "//value_text//new_line("a")//"/"
      call parse_body(body, scan, name, content)
      if (allocated(scan%problem)) then
         call fail(error, location//scan%problem)
         return
      end if
      is_one_key = scan%position > len(body) .and. content%names%n == 1
      if (is_one_key) is_one_key = content%keys(1)%second_line == 0
      if (.not. is_one_key) then
         call fail(error, location//"must be one key with its values; "//path_help)
         return
      end if
      call self%resolve(path, parameter, error)
      if (allocated(error)) then
         error%message = location//error%message
         return
      end if
      associate (group => self%groups%holders(parameter%i_group)%group)
         call group%content%copy_key(content, group%has_changed)
      end associate
   end subroutine set_text

   !> The input after defaults and overrides: all groups that were read, with every requested key. Reading it again
   !> gives the same values. Groups that are not of a file have the order of the table of keys. Values that a namelist cannot
   !> express are omitted: values not allocated, empty lists, NaN, infinity, strings of several lines.
   pure subroutine write_complete_text(self, text, only_given)
      type(document_t), intent(in) :: self
      character(:), allocatable, intent(out) :: text
      logical, intent(in), optional :: only_given           !! without defaults, default false
      type(text_builder_t) :: lines
      integer :: i, order(self%groups%n)

      order = positions_in_order(self)
      do i = 1, size(order)
         associate (group => self%groups%holders(order(i))%group)
            if (group%reading == 0 .or. (group%line == 0 .and. group%n_requested == 0)) cycle
            call write_group(group, lines, only_given)
         end associate
      end do
      text = lines%text()
   end subroutine write_complete_text

   !> Positions of the groups in the order in which they are written.
   pure function positions_in_order(document) result(order)
      type(document_t), intent(in) :: document
      integer :: order(document%groups%n)
      integer :: i, k, n

      order = [(i, i=1, size(order))]
      if (document%is_of_file()) return
      n = 0
      associate (names => input_groups())
         do k = 1, size(names)
            do i = 1, document%count(names(k))
               n = n + 1
               order(n) = document%groups%position_of(names(k), i)
            end do
         end do
      end associate
   end function positions_in_order

   !> Writes a group with every key that was requested and its value, given or default.
   pure subroutine write_group(self, lines, only_given)
      type(properties_t), intent(in) :: self
      type(text_builder_t), intent(inout) :: lines
      logical, intent(in), optional :: only_given           !! leaves out the group, too, if nothing is given
      type(string_t), allocatable :: texts(:)
      character(:), allocatable :: list
      logical :: leaves_defaults
      integer :: i

      leaves_defaults = .false.
      if (present(only_given)) leaves_defaults = only_given
      if (leaves_defaults .and. .not. any([(self%content%is_given(self%requested(i)), i=1, self%n_requested)])) return
      call lines%add("&"//self%name//new_line("a"))
      do i = 1, self%n_requested
         if (leaves_defaults .and. .not. self%content%is_given(self%requested(i))) cycle
         associate (requested => self%content%keys(self%requested(i)))
            call texts_of(requested, texts)
            if (size(texts) == 0) cycle
            call write_list(texts, requested%row_length, list)
            call lines%add("   "//trim(self%content%names%names(self%requested(i)))//" = ")
            call lines%add(list)
            call lines%add(new_line("a"))
         end associate
      end do
      call lines%add("/"//new_line("a"))
   end subroutine write_group

   !> Values in namelist form; none if a namelist file cannot express one of them.
   pure subroutine texts_of(requested, texts)
      type(key_t), intent(in) :: requested
      type(string_t), allocatable, intent(out) :: texts(:)
      character(:), allocatable :: text
      logical :: is_repeated
      integer :: i

      select case (requested%kind)
      case (kind_of%none)
         allocate (texts(0))
      case (kind_of%word)
         allocate (texts(merge(size(requested%texts), 0, all([(can_be_written(requested%texts(i)), i=1, size(requested%texts))]))))
         do i = 1, size(texts)
            texts(i)%value = quote(requested%texts(i)%value)
         end do
      case default
         text = ""
         allocate (texts(merge(size(requested%numbers), 0, all(ieee_is_finite(requested%numbers)))))
         do i = 1, size(texts)
            is_repeated = i > 1                             ! matrices have long rows of equal numbers; zeros have signs
            if (is_repeated) is_repeated = transfer(requested%numbers(i), 0_int64) == transfer(requested%numbers(i - 1), 0_int64)
            if (.not. is_repeated) then
               text = to_text(requested%numbers(i))
               if (requested%kind == kind_of%whole) text = to_text(nint(requested%numbers(i)))
               if (requested%kind == kind_of%truth) text = to_text(requested%numbers(i) > 0.0_wp)
            end if
            texts(i)%value = text
         end do
      end select
   end subroutine texts_of

   pure logical function can_be_written(word)
      type(string_t), intent(in) :: word

      can_be_written = allocated(word%value)
      if (can_be_written) can_be_written = scan(word%value, achar(0)//achar(13)//new_line("a")) == 0
   end function can_be_written

   !> Values in namelist form, one line per row, four and more equal ones with a repeat count; nothing for an empty
   !> list, which a namelist cannot express.
   pure subroutine write_list(words, row_length, text)
      type(string_t), intent(in) :: words(:)
      integer, intent(in) :: row_length
      character(:), allocatable, intent(out) :: text
      type(text_builder_t) :: list
      character(:), allocatable :: piece
      integer :: column, count, i, k, row_end

      if (size(words) == 0) return
      column = 0
      i = 1
      do while (i <= size(words))
         row_end = ((i - 1)/row_length + 1)*row_length
         count = 1
         do k = i + 1, row_end
            if (words(k)%value /= words(i)%value) exit
            count = count + 1
         end do
         if (count < 4) count = 1
         piece = words(i)%value
         if (count > 1) piece = to_text(count)//"*"//piece
         if (i > 1) call list%add(",")
         if (i > 1 .and. (column + len(piece) > line_width .or. mod(i - 1, row_length) == 0)) then
            call list%add(new_line("a")//"      ")
            column = 0
         else if (i > 1) then
            call list%add(" ")
         end if
         call list%add(piece)
         column = column + len(piece) + 2
         i = i + count
      end do
      text = list%text()
   end subroutine write_list
end module hb_namelist
