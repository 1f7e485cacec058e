!> Differences between two inputs by group and key, for users who resume a run with a changed input.
module hb_namelist_difference
   use hb_text, only: split, string_t, text_builder_t, to_text
   implicit none
   private
   public :: input_differences

   integer, parameter :: max_lines = 20                     !! of a list of differences
   integer, parameter :: max_shown = 60                     !! characters of a value

   !> One key of an input.
   type :: entry_t
      character(:), allocatable :: place                    !! such as &law(2): gap
      character(:), allocatable :: value
      logical :: is_met = .false.                           !! the other input has the same key
   end type entry_t

contains

   !> Returns a line for each key whose value differs between two inputs, or that one of them lacks; empty if there is
   !> none. Both are texts of `complete` of a document.
   function input_differences(one, other, name_of_one, name_of_other) result(text)
      character(*), intent(in) :: one, other
      character(*), intent(in) :: name_of_one, name_of_other !! for the lines
      character(:), allocatable :: text
      type(entry_t), allocatable :: ours(:), theirs(:)
      type(text_builder_t) :: lines
      integer :: i, j, n

      text = ""
      if (one == other) return
      call read_entries(one, ours)
      call read_entries(other, theirs)
      n = 0
      do i = 1, size(ours)
         j = index_of(theirs, ours(i)%place)
         if (j == 0) then
            call add(ours(i)%place, shown(ours(i)%value), "nothing")
         else
            theirs(j)%is_met = .true.
            if (ours(i)%value /= theirs(j)%value) call add_values(ours(i), theirs(j))
         end if
      end do
      do j = 1, size(theirs)
         if (.not. theirs(j)%is_met) call add(theirs(j)%place, "nothing", shown(theirs(j)%value))
      end do
      if (n > max_lines) call lines%add(new_line("a")//"and "//to_text(n - max_lines)//" more")
      text = lines%text()
   contains
      subroutine add_values(our, their)
         type(entry_t), intent(in) :: our, their
         integer :: first

         first = first_difference(our%value, their%value)
         call add(our%place, shown(our%value, first), shown(their%value, first))
      end subroutine add_values

      subroutine add(place, our_value, their_value)
         character(*), intent(in) :: place, our_value, their_value

         n = n + 1
         if (n > max_lines) return
         if (n > 1) call lines%add(new_line("a"))
         call lines%add(place//": "//our_value//" in "//name_of_one//", "//their_value//" in "//name_of_other)
      end subroutine add
   end function input_differences

   !> Parses a text of `complete`: a group begins with & in the first column, a key in the fourth; other lines
   !> continue a value.
   pure subroutine read_entries(text, entries)
      character(*), intent(in) :: text
      type(entry_t), allocatable, intent(out) :: entries(:)
      type(string_t), allocatable :: lines(:), groups(:)
      integer, allocatable :: numbers(:), group_of(:)
      integer :: equals, g, i, k, n

      call split(text, new_line("a"), lines)
      n = 0
      g = 0
      allocate (entries(size(lines)), groups(size(lines)), numbers(size(lines)), group_of(size(lines)))
      do i = 1, size(lines)
         associate (line => lines(i)%value)
            if (index(line, "&") == 1) then
               g = g + 1
               groups(g)%value = trim(line)
               numbers(g) = 1 + count([(groups(k)%value == groups(g)%value, k=1, g - 1)])
            else if (index(line, "      ") == 1 .and. n > 0) then
               entries(n)%value = entries(n)%value//" "//trim(adjustl(line))
            else if (index(line, "   ") == 1) then
               equals = index(line, " = ")
               n = n + 1
               entries(n)%place = line(4:equals - 1)
               entries(n)%value = line(equals + 3:)
               group_of(n) = g
            end if
         end associate
      end do
      entries = entries(:n)
      do i = 1, n
         g = group_of(i)
         k = count([(groups(k)%value == groups(g)%value, k=1, count_groups())])
         if (k > 1) then
            entries(i)%place = groups(g)%value//"("//to_text(numbers(g))//"): "//entries(i)%place
         else
            entries(i)%place = groups(g)%value//": "//entries(i)%place
         end if
      end do
   contains
      pure integer function count_groups()
         count_groups = count([(allocated(groups(k)%value), k=1, size(groups))])
      end function count_groups
   end subroutine read_entries

   pure integer function index_of(entries, place)
      type(entry_t), intent(in) :: entries(:)
      character(*), intent(in) :: place

      do index_of = size(entries), 1, -1
         if (entries(index_of)%place == place) return
      end do
   end function index_of

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
      character(:), allocatable :: text
      integer :: first, last

      first = 1
      if (present(around) .and. len(value) > max_shown) first = max(1, min(around, len(value)) - max_shown/2)
      last = min(len(value), first + max_shown - 1)
      text = value(first:last)
      if (first > 1) text = "..."//text
      if (last < len(value)) text = text//"..."
   end function shown
end module hb_namelist_difference
