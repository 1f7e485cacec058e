!> The table of input keys: each key is described once, in src/input_keys.txt, whose header describes the columns.
!>
!> A section of the table is a group, or a group and its type: "law", "law jenkins". Readers (hb_properties), pages
!> and messages use unit, default, limits and choices of a key from its row.
module hb_input_keys
   use hb_key_rows, only: group_of, key_row, max_group, n_key_rows, row_of
   use hb_kinds, only: wp
   use hb_text, only: add_string, join, parse_real, split, string_t
   implicit none
   private
   public :: choices_of, find_groups, find_rule, input_groups, keys_of, kind_of, limits_t, max_choice, max_unit, rule_t

   integer, parameter :: max_unit = 16
   integer, parameter :: max_choice = 24
   integer, parameter :: n_cells = 6                        ! before the meaning
   integer, parameter :: max_groups = 3                     ! that have the same key; with more of them a hint is not useful

   !> Kinds of values. A whole number is valid as an integer and as a real.
   type :: kinds_t
      integer :: none = 0                                   !! invalid spelling
      integer :: number = 1
      integer :: whole = 2
      integer :: truth = 3                                  !! 1 for true, 0 for false
      integer :: word = 4
   end type kinds_t
   type(kinds_t), parameter :: kind_of = kinds_t()

   !> Limits of each number of a key; the defaults limit nothing.
   type :: limits_t
      real(wp) :: minimum = -huge(1.0_wp), maximum = huge(1.0_wp)     !! inclusive
      real(wp) :: above = -huge(1.0_wp)                               !! exclusive
   end type limits_t

   !> The entry of the table for a key.
   type :: rule_t
      integer :: kind = kind_of%none                        !! of its values; none: the key is not in the table
      logical :: is_required = .false.
      character(max_unit) :: unit = ""
      real(wp), allocatable :: numbers(:)                   !! default, or
      character(:), allocatable :: word                     !! neither if the reader has its own default
      type(limits_t) :: limits
      character(max_choice), allocatable :: choices(:)
   end type rule_t

contains

   !> Returns the rule for a key of a group; a rule for the type of the group has precedence.
   pure subroutine find_rule(group, type, key, rule)
      character(*), intent(in) :: group, type, key          !! lower case; the type is empty if there is none
      type(rule_t), intent(out) :: rule
      type(string_t) :: cells(n_cells)
      integer :: i

      i = 0
      if (type /= "") i = row_of(group//" "//type, key)
      if (i == 0) i = row_of(group, key)
      if (i == 0) return
      call split_row(key_row(i), cells)
      associate (type_cell => cells(3)%value, unit => cells(4)%value, default => cells(5)%value, range => cells(6)%value)
         rule%kind = kind_of%word
         if (index(type_cell, "real") > 0) rule%kind = kind_of%number
         if (index(type_cell, "integer") > 0) rule%kind = kind_of%whole
         if (index(type_cell, "logical") > 0) rule%kind = kind_of%truth
         rule%is_required = index(default, "required") == 1
         if (len(unit) <= max_unit .and. index(unit, ",") == 0 .and. index(unit, "of ") == 0) rule%unit = unit
         if (unit == "" .and. rule%kind == kind_of%number) rule%unit = "1"
         call read_default(default, rule)
         if (rule%kind == kind_of%word) then
            call read_choices(range, rule)
         else
            call read_limits(range, rule%limits)
         end if
      end associate
   end subroutine find_rule

   !> The first cells of a row; the last one, which is the longest, is for readers of the table.
   pure subroutine split_row(row, cells)
      character(*), intent(in) :: row
      type(string_t), intent(out) :: cells(:)
      integer :: first, i, k

      i = 1
      do k = 1, size(cells)
         first = i
         do while (row(i:i + 2) /= " | ")
            i = i + 1
         end do
         cells(k)%value = row(first:i - 1)
         i = i + 3
      end do
   end subroutine split_row

   !> The words that a key accepts, in the order of the table; none if it has no choices.
   pure function choices_of(group, key, type) result(choices)
      character(*), intent(in) :: group, key
      character(*), intent(in), optional :: type
      character(max_choice), allocatable :: choices(:)
      type(rule_t) :: rule

      if (present(type)) call find_rule(group, type, key, rule)
      if (.not. present(type)) call find_rule(group, "", key, rule)
      call move_alloc(rule%choices, choices)
      if (.not. allocated(choices)) allocate (choices(0))
   end function choices_of

   !> All groups that an input may contain, in the order of the table.
   pure function input_groups() result(groups)
      character(max_group), allocatable :: groups(:)
      integer :: i

      allocate (groups(0))
      do i = 1, n_key_rows()
         if (i > 1) then
            if (group_of(i) == group_of(i - 1)) cycle
         end if
         if (all(groups /= group_of(i))) groups = [character(max_group) :: groups, group_of(i)]
      end do
   end function input_groups

   !> All keys of a group, of any type of it.
   pure subroutine keys_of(group, keys)
      character(*), intent(in) :: group                     !! lower case
      type(string_t), allocatable, intent(out) :: keys(:)
      type(string_t), allocatable :: cells(:)
      integer :: i

      allocate (keys(0))
      do i = 1, n_key_rows()
         if (group_of(i) /= group) cycle
         call split(trim(key_row(i)), " | ", cells)
         call add_string(keys, cells(2)%value)
      end do
   end subroutine keys_of

   !> Where else a key exists, such as "&harmonics" or "&law type = 'jenkins'"; empty if nowhere, in many groups, or
   !> here.
   pure subroutine find_groups(key, group, type, text)
      character(*), intent(in) :: key
      character(*), intent(in) :: group, type               !! without these; lower case
      character(:), allocatable, intent(out) :: text
      character(:), allocatable :: section, row
      type(string_t), allocatable :: groups(:)
      integer :: i, n

      text = ""
      allocate (groups(0))
      do i = 1, n_key_rows()
         row = key_row(i)
         section = row(:index(row, " | ") - 1)
         if (index(row, section//" | "//key//" | ") /= 1) cycle
         if (section == group .or. section == group//" "//type) return
         n = index(section, " ")
         if (n > 0) section = section(:n - 1)//" type = '"//section(n + 1:)//"'"
         call add_string(groups, "&"//section)
      end do
      if (size(groups) <= max_groups) text = join(groups, ", ")
   end subroutine find_groups

   !> Reads a default that is a value; a description in words is ignored.
   pure subroutine read_default(text, rule)
      character(*), intent(in) :: text
      type(rule_t), intent(inout) :: rule
      type(string_t), allocatable :: parts(:)
      real(wp), allocatable :: numbers(:)
      logical :: is_number
      integer :: i

      select case (rule%kind)
      case (kind_of%word)
         if (is_quoted(text)) rule%word = text(2:len(text) - 1)
      case (kind_of%truth)
         if (text == ".true." .or. text == ".false.") rule%numbers = [merge(1.0_wp, 0.0_wp, text == ".true.")]
      case default
         call split(text, ", ", parts)
         allocate (numbers(size(parts)))
         do i = 1, size(parts)
            call parse_real(parts(i)%value, numbers(i), is_number)
            if (.not. is_number) return
         end do
         rule%numbers = numbers
      end select
   end subroutine read_default

   !> Reads the words of a range that consists of quoted words only.
   pure subroutine read_choices(text, rule)
      character(*), intent(in) :: text
      type(rule_t), intent(inout) :: rule
      type(string_t), allocatable :: parts(:)
      integer :: i

      call split(text, ", ", parts)
      if (.not. all([(is_quoted(parts(i)%value), i=1, size(parts))])) return
      allocate (rule%choices(size(parts)))
      do i = 1, size(parts)
         rule%choices(i) = parts(i)%value(2:len(parts(i)%value) - 1)
      end do
   end subroutine read_choices

   pure logical function is_quoted(text)
      character(*), intent(in) :: text

      is_quoted = .false.
      if (len(text) > 1) is_quoted = text(1:1) == "'" .and. index(text(2:), "'") == len(text) - 1
   end function is_quoted

   !> Reads the limits of a range from parts like `>= 0`, `> 0`, `<= 1`, `1 to 100`; other parts are for readers of
   !> the table.
   pure subroutine read_limits(text, limits)
      character(*), intent(in) :: text
      type(limits_t), intent(inout) :: limits
      type(string_t), allocatable :: parts(:)
      integer :: i, middle

      call split(text, ", ", parts)
      do i = 1, size(parts)
         associate (part => parts(i)%value)
            middle = index(part, " to ")
            call read_limit(part, ">= ", limits%minimum)
            call read_limit(part, "> ", limits%above)
            call read_limit(part, "<= ", limits%maximum)
            if (middle > 0) call read_limit(part(:middle - 1), "", limits%minimum)
            if (middle > 0) call read_limit(part(middle + 4:), "", limits%maximum)
         end associate
      end do
   end subroutine read_limits

   pure subroutine read_limit(text, mark, limit)
      character(*), intent(in) :: text, mark
      real(wp), intent(inout) :: limit
      real(wp) :: number
      logical :: is_number

      if (index(text, mark) /= 1) return
      call parse_real(text(len(mark) + 1:), number, is_number)
      if (is_number) limit = number
   end subroutine read_limit
end module hb_input_keys
