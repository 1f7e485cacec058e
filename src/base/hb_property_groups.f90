!> The groups of a document: a list in the order of the input, and the groups of each name by their number.
module hb_property_groups
   use hb_name_table, only: name_table_t
   use hb_properties, only: new_properties, properties_t
   use hb_text, only: lower
   implicit none
   private
   public :: groups_t, max_groups, new_groups

   integer, parameter :: max_groups = 100000

   !> Holds a group at a fixed address while the list of groups grows.
   type :: holder_t
      type(properties_t), allocatable :: group
   end type holder_t

   !> The list; `append` any number of groups, then `sort` before groups are requested by name.
   type :: groups_t
      integer :: n = 0
      type(holder_t), allocatable :: holders(:)             !! (capacity), file order, then added ones
      type(name_table_t) :: names                           !! of the groups, each name once
      integer, allocatable, private :: n_of(:)              !! groups of a name, (names%n)
      integer, allocatable, private :: first_of(:)          !! start of each name in `order`, (names%n)
      integer, allocatable, private :: order(:)             !! groups, those of one name together, (n)
      integer, allocatable, private :: name_of(:)           !! number of the name of each group, (capacity)
   contains
      procedure :: add => groups_add
      procedure :: append => groups_append
      procedure :: count => groups_count
      procedure :: position_of => groups_position_of
      procedure :: sort => groups_sort
   end type groups_t

contains

   !> Creates an empty list.
   pure subroutine new_groups(self)
      type(groups_t), intent(out) :: self

      allocate (self%holders(8), self%name_of(8), self%n_of(0), self%first_of(0), self%order(0))
   end subroutine new_groups

   !> Appends a group without values; the addresses of the previous groups do not change.
   pure subroutine groups_append(self, name, file_name, line)
      class(groups_t), intent(inout) :: self
      character(*), intent(in) :: name                      !! lower case
      character(*), intent(in) :: file_name
      integer, intent(in) :: line                           !! 0 if not in the file
      type(holder_t), allocatable :: larger(:)
      integer, allocatable :: larger_name_of(:)
      integer :: i, i_name

      if (self%n == size(self%holders)) then
         allocate (larger(2*self%n), larger_name_of(2*self%n))
         do i = 1, self%n
            call move_alloc(self%holders(i)%group, larger(i)%group)
         end do
         larger_name_of(1:self%n) = self%name_of
         call move_alloc(larger, self%holders)
         call move_alloc(larger_name_of, self%name_of)
      end if
      i_name = self%names%find(name)
      if (i_name == 0) then
         call self%names%add(name)
         i_name = self%names%n
      end if
      self%n = self%n + 1
      self%name_of(self%n) = i_name
      allocate (self%holders(self%n)%group)
      call new_properties(self%holders(self%n)%group, name, file_name, line)
   end subroutine groups_append

   !> Appends a group that is not in the file; the list remains sorted.
   pure subroutine groups_add(self, name, file_name)
      class(groups_t), intent(inout) :: self
      character(*), intent(in) :: name                      !! lower case
      character(*), intent(in) :: file_name

      call self%append(name, file_name, 0)
      if (self%names%n > size(self%n_of)) then ! the first of its name is at the end of `order`
         self%n_of = [self%n_of, 1]
         self%first_of = [self%first_of, self%n]
         self%order = [self%order, self%n]
      else
         call self%sort()
      end if
   end subroutine groups_add

   !> Sorts the groups by name in linear time, file order within a name, and numbers them.
   pure subroutine groups_sort(self)
      class(groups_t), intent(inout) :: self
      integer :: i, k, next(self%names%n)

      deallocate (self%n_of, self%first_of, self%order)
      allocate (self%n_of(self%names%n), source=0)
      allocate (self%first_of(self%names%n), self%order(self%n))
      do i = 1, self%n
         self%n_of(self%name_of(i)) = self%n_of(self%name_of(i)) + 1
      end do
      k = 1
      do i = 1, self%names%n
         self%first_of(i) = k
         k = k + self%n_of(i)
      end do
      next = self%first_of
      do i = 1, self%n
         k = self%name_of(i)
         self%order(next(k)) = i
         self%holders(i)%group%number = next(k) - self%first_of(k) + 1
         self%holders(i)%group%is_repeated = self%n_of(k) > 1
         next(k) = next(k) + 1
      end do
   end subroutine groups_sort

   !> Number of groups of a name.
   pure integer function groups_count(self, name) result(n)
      class(groups_t), intent(in) :: self
      character(*), intent(in) :: name
      integer :: i_name

      n = 0
      i_name = self%names%find(lower(trim(name)))
      if (i_name > 0) n = self%n_of(i_name)
   end function groups_count

   !> Position of the i-th group of a name, which must exist.
   pure integer function groups_position_of(self, name, i) result(position)
      class(groups_t), intent(in) :: self
      character(*), intent(in) :: name
      integer, intent(in) :: i

      position = self%order(self%first_of(self%names%find(lower(trim(name)))) + i - 1)
   end function groups_position_of
end module hb_property_groups
