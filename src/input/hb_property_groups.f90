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
   contains
      procedure :: add => groups_add
      procedure :: count => groups_count
      procedure :: position_of => groups_position_of
   end type groups_t

contains

   !> Creates an empty list.
   pure subroutine new_groups(self)
      type(groups_t), intent(out) :: self

      allocate (self%holders(8), self%positions(8))
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
         allocate (holders(2*self%n), positions(2*self%n))
         do i = 1, self%n
            call move_alloc(self%holders(i)%group, holders(i)%group)
         end do
         positions(:self%n) = self%positions
         call move_alloc(holders, self%holders)
         call move_alloc(positions, self%positions)
      end if
      i = self%names%find(name)
      if (i == 0) then
         call self%names%add(name)
         i = self%names%n
         allocate (self%positions(i)%of(1))
      end if
      self%n = self%n + 1
      allocate (self%holders(self%n)%group)
      associate (here => self%positions(i), group => self%holders(self%n)%group)
         if (here%n == size(here%of)) here%of = [here%of, here%of]
         here%n = here%n + 1
         here%of(here%n) = self%n
         call new_properties(group, name, file_name, line)
         group%number = here%n
         group%is_repeated = here%n > 1
         self%holders(here%of(1))%group%is_repeated = here%n > 1
      end associate
   end subroutine groups_add

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

      position = self%positions(self%names%find(lower(trim(name))))%of(i)
   end function groups_position_of
end module hb_property_groups
