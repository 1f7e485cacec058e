!> Differences between two inputs by group and key, for users who resume a run with a changed input.
module hb_namelist_difference
   use hb_document, only: document_t
   use hb_error, only: error_t
   use hb_input_keys, only: find_rule, kind_of, rule_t
   use hb_kinds, only: wp
   use hb_namelist, only: read_namelist
   use hb_text, only: join, parse_real, split, string_t, text_builder_t, to_text
   implicit none
   private
   public :: list_differences

   integer, parameter :: max_lines = 20                     !! of a list of differences
   integer, parameter :: max_shown = 60                     !! characters of a value
   character(*), parameter :: ellipsis = "..."

contains

   !> Lists a line for each key whose value differs between two inputs, or that one of them lacks; empty if there is
   !> none. Both are texts of `write_complete_text`. A key that the first has by default and the second lacks is no difference: the
   !> second was written before there was this key.
   subroutine list_differences(one, other, name_of_one, name_of_other, text)
      character(*), intent(in) :: one, other
      character(*), intent(in) :: name_of_one, name_of_other !! for the lines
      character(:), allocatable, intent(out) :: text
      type(document_t) :: ours, theirs
      type(error_t), allocatable :: ignored
      type(text_builder_t) :: lines
      integer :: n

      text = ""
      if (one == other) return
      call read_namelist(ours, "", one, ignored)
      call read_namelist(theirs, "", other, ignored)
      n = 0
      call add_keys(ours, theirs, .true.)
      call add_keys(theirs, ours, .false.)
      if (n > max_lines) call lines%add(new_line("a")//"and "//to_text(n - max_lines)//" more")
      text = lines%text()

   contains

      !> Adds the keys of one input that the other lacks or, for the first one, that have another value there.
      subroutine add_keys(from, to, is_first)
         type(document_t), intent(in) :: from, to
         logical, intent(in) :: is_first
         character(:), allocatable :: its, location, value
         integer :: first, i, k

         do i = 1, from%groups%n
            associate (group => from%groups%holders(i)%group)
               do k = 1, group%content%names%n
                  location = "&"//group%name
                  if (group%is_repeated) location = location//"("//to_text(group%number)//")"
                  location = location//": "//trim(group%content%names%names(k))
                  call get_value(from, group%name, group%number, trim(group%content%names%names(k)), value)
                  call get_value(to, group%name, group%number, trim(group%content%names%names(k)), its)
                  if (.not. allocated(its)) then
                     if (is_first .and. group%number <= to%count(group%name)) then
                        if (is_default(from, group%name, group%number, trim(group%content%names%names(k)), value)) cycle
                     end if
                     if (is_first) call add(location, shown(value), "nothing")
                     if (.not. is_first) call add(location, "nothing", shown(value))
                  else if (is_first .and. value /= its) then
                     first = first_difference(value, its)
                     call add(location, shown(value, first), shown(its, first))
                  end if
               end do
            end associate
         end do
      end subroutine add_keys

      subroutine add(location, our_value, their_value)
         character(*), intent(in) :: location, our_value, their_value

         n = n + 1
         if (n > max_lines) return
         if (n > 1) call lines%add(new_line("a"))
         call lines%add(location//": "//trim(our_value)//" in "//name_of_one//", "//trim(their_value)//" in "//name_of_other)
      end subroutine add
   end subroutine list_differences

   !> Whether a value is the default of its key in the table.
   logical function is_default(document, name, number, key, value)
      type(document_t), intent(in) :: document
      character(*), intent(in) :: name, key
      integer, intent(in) :: number                         !! of the group of that name
      character(*), intent(in) :: value                     !! as it is spelt
      type(rule_t), allocatable :: rule
      character(:), allocatable :: type
      real(wp) :: its_number
      logical :: is_number

      is_default = .false.
      call get_value(document, name, number, "type", type)
      if (.not. allocated(type)) type = "''"
      allocate (rule)
      call find_rule(name, type(2:len(type) - 1), key, rule)
      if (allocated(rule%word)) then
         is_default = value == "'"//rule%word//"'"
      else if (allocated(rule%numbers)) then
         if (size(rule%numbers) /= 1) return
         if (rule%kind == kind_of%truth) then
            is_default = value == trim(merge(".true. ", ".false.", rule%numbers(1) > 0.0_wp))
         else
            call parse_real(value, its_number, is_number)
            if (is_number) is_default = abs(its_number - rule%numbers(1)) <= 0.0_wp
         end if
      end if
   end function is_default

   !> Returns the values of a key as they are spelt, in one line; not allocated if the input does not have the key.
   subroutine get_value(document, name, number, key, value)
      type(document_t), intent(in) :: document
      character(*), intent(in) :: name, key
      integer, intent(in) :: number                         !! of the group of that name
      character(:), allocatable, intent(out) :: value
      type(string_t), allocatable :: pieces(:)
      integer :: first, i, last

      if (number > document%count(name)) return
      associate (content => document%groups%holders(document%groups%position_of(name, number))%group%content)
         i = content%names%find(key)
         if (.not. content%is_given(i)) return
         associate (values => content%keys(i)%values(:content%keys(i)%n), spelling => content%spelling)
            first = index(spelling(:values(1)%first - 1), " = ", back=.true.) + 3
            last = values(size(values))%last
            call split(spelling(first:last + index(spelling(last + 1:)//new_line("a"), new_line("a")) - 1), new_line("a"), pieces)
         end associate
      end associate
      do i = 1, size(pieces)
         pieces(i)%value = trim(adjustl(pieces(i)%value))
      end do
      value = join(pieces, " ")
   end subroutine get_value

   !> Position of the first character in which two texts differ.
   pure integer function first_difference(a, b) result(i)
      character(*), intent(in) :: a, b

      do i = 1, min(len(a), len(b))
         if (a(i:i) /= b(i:i)) return
      end do
   end function first_difference

   !> A value for a message; of a long one the part around position `around`.
   pure function shown(value, around) result(text)
      character(*), intent(in) :: value
      integer, intent(in), optional :: around
      character(min(len(value), max_shown) + 2*len(ellipsis)) :: text !! with blanks behind it
      integer :: first, last

      first = 1
      if (present(around) .and. len(value) > max_shown) first = max(1, min(around, len(value)) - max_shown/2)
      last = min(len(value), first + max_shown - 1)
      text = value(first:last)
      if (first > 1) text = ellipsis//text
      if (last < len(value)) text = trim(text)//ellipsis
   end function shown
end module hb_namelist_difference
