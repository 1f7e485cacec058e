!> The groups of a document: a list in the order of the input, and the groups of each name by their number. The handle of a group
!> identifies it, whatever is added or removed.
module hb_property_groups
   use hb_assert, only: assert, asserts_are_on
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

   !> Positions of the groups of one name, in their order.
   type :: positions_t
      integer :: n = 0
      integer, allocatable :: of(:)                         ! (capacity)
   end type positions_t

   !> The list.
   type :: groups_t
      integer :: n = 0
      type(holder_t), allocatable :: holders(:)             !! (capacity), in the order of addition
      type(name_table_t) :: names                           !! of the groups, each name once
      type(positions_t), allocatable, private :: positions(:)   ! of each name, (capacity)
      integer, allocatable, private :: of_handle(:)         ! position by handle, 0: removed, (capacity)
      integer :: n_handles = 0                              !! that have been given
   contains
      procedure :: add => groups_add
      procedure :: count => groups_count
      procedure :: position_of => groups_position_of
      procedure :: position_of_handle => groups_position_of_handle
      procedure :: remove => groups_remove
   end type groups_t

contains

   !> Creates an empty list.
   pure subroutine new_groups(self)
      type(groups_t), intent(out) :: self

      allocate (self%holders(8), self%positions(8), self%of_handle(8))
   end subroutine new_groups

   !> Adds a group without values; the addresses of the previous groups do not change.
   pure subroutine groups_add(self, name, file_name, line)
      class(groups_t), intent(inout) :: self
      character(*), intent(in) :: name                      !! lower case
      character(*), intent(in) :: file_name
      integer, intent(in) :: line                           !! 0 if not in the file
      type(holder_t), allocatable :: holders(:)
      type(positions_t), allocatable :: positions(:)
      integer :: i

      if (self%n == size(self%holders)) then
         allocate (holders(2*self%n))
         do i = 1, self%n
            call move_alloc(self%holders(i)%group, holders(i)%group)
         end do
         call move_alloc(holders, self%holders)
      end if
      i = self%names%find(name)
      if (i == 0) then
         call self%names%add(name)
         i = self%names%n
         if (i > size(self%positions)) then
            allocate (positions(2*i))
            positions(:i - 1) = self%positions
            call move_alloc(positions, self%positions)
         end if
         allocate (self%positions(i)%of(1))
      end if
      self%n = self%n + 1
      self%n_handles = self%n_handles + 1
      if (self%n_handles > size(self%of_handle)) self%of_handle = [self%of_handle, self%of_handle]
      self%of_handle(self%n_handles) = self%n
      allocate (self%holders(self%n)%group)
      associate (here => self%positions(i), group => self%holders(self%n)%group)
         if (here%n == size(here%of)) here%of = [here%of, here%of]
         here%n = here%n + 1
         here%of(here%n) = self%n
         call new_properties(group, name, file_name, line)
         group%number = here%n
         group%is_repeated = here%n > 1
         group%handle = self%n_handles
         self%holders(here%of(1))%group%is_repeated = here%n > 1
      end associate
   end subroutine groups_add

   !> Removes the group at a position; those that follow move up.
   pure subroutine groups_remove(self, position)
      class(groups_t), intent(inout) :: self
      integer, intent(in) :: position
      integer :: i, k

      i = self%names%find(self%holders(position)%group%name)
      self%of_handle(self%holders(position)%group%handle) = 0
      associate (here => self%positions(i))
         here%of(:here%n - 1) = pack(here%of(:here%n), here%of(:here%n) /= position)
         here%n = here%n - 1
      end associate
      deallocate (self%holders(position)%group)
      do k = position + 1, self%n
         call move_alloc(self%holders(k)%group, self%holders(k - 1)%group)
      end do
      self%n = self%n - 1
      where (self%of_handle(:self%n_handles) > position) self%of_handle(:self%n_handles) = self%of_handle(:self%n_handles) - 1
      do k = 1, self%names%n
         associate (others => self%positions(k)%of(:self%positions(k)%n))
            where (others > position) others = others - 1
         end associate
      end do
      do k = 1, self%positions(i)%n
         associate (group => self%holders(self%positions(i)%of(k))%group)
            group%number = k
            group%is_repeated = self%positions(i)%n > 1
         end associate
      end do
   end subroutine groups_remove

   !> Position of the group with a handle; 0 if there is none.
   pure integer function groups_position_of_handle(self, handle) result(position)
      class(groups_t), intent(in) :: self
      integer, intent(in) :: handle

      position = 0
      if (handle > 0 .and. handle <= self%n_handles) position = self%of_handle(handle)
   end function groups_position_of_handle

   !> Number of groups of a name.
   pure integer function groups_count(self, name) result(n)
      class(groups_t), intent(in) :: self
      character(*), intent(in) :: name
      integer :: i

      n = 0
      i = self%names%find(lower(trim(name)))
      if (i > 0) n = self%positions(i)%n
   end function groups_count

   !> Position of the i-th group of a name, which must exist.
   pure integer function groups_position_of(self, name, i) result(position)
      class(groups_t), intent(in) :: self
      character(*), intent(in) :: name
      integer, intent(in) :: i

      if (asserts_are_on) call assert(i >= 1 .and. i <= self%count(name), "groups_position_of", "a group that exists")
      position = self%positions(self%names%find(lower(trim(name))))%of(i)
   end function groups_position_of
end module hb_property_groups
