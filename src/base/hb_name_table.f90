!> Table from names to positions 1, 2, 3, ... in order of addition: a hash table with open addressing, so that
!> files with very many groups or keys are read in linear time. Source of the hash: FNV-1a, 32 bit.
module hb_name_table
   use hb_kinds, only: int64
   use hb_text, only: max_name
   implicit none
   private
   public :: find_first_equal, name_table_t

   type :: name_table_t
      integer :: n = 0                                      !! number of names
      character(max_name), allocatable :: names(:)          !! (capacity), the first n are in use
      integer, allocatable, private :: slots(:)             !! position of a name, 0 if free
   contains
      procedure :: add => name_table_add
      procedure :: find => name_table_find
   end type name_table_t

contains

   !> Position of a name (lower case), 0 when it is not in the table.
   pure integer function name_table_find(self, name) result(position)
      class(name_table_t), intent(in) :: self
      character(*), intent(in) :: name

      position = 0
      if (self%n == 0 .or. len_trim(name) > max_name) return
      position = self%slots(slot_of(self, name))
   end function name_table_find

   !> Adds a name that is not in the table; its position is `n` afterwards.
   pure subroutine name_table_add(self, name)
      class(name_table_t), intent(inout) :: self
      character(*), intent(in) :: name
      character(max_name), allocatable :: larger(:)
      integer :: i

      if (.not. allocated(self%names)) then
         allocate (self%names(8), self%slots(16))
         self%slots = 0
      else if (self%n == size(self%names)) then
         allocate (larger(2*self%n))
         larger(1:self%n) = self%names
         call move_alloc(larger, self%names)
         deallocate (self%slots)
         allocate (self%slots(4*self%n), source=0)
         do i = 1, self%n
            self%slots(slot_of(self, self%names(i))) = i
         end do
      end if
      self%n = self%n + 1
      self%names(self%n) = name
      self%slots(slot_of(self, name)) = self%n
   end subroutine name_table_add

   !> For each text the position of the first one that is equal: its own, if it is that one.
   pure subroutine find_first_equal(texts, first)
      character(*), intent(in) :: texts(:)
      integer, intent(out) :: first(:)                      !! (size(texts))
      integer :: i, slot, slots(2*size(texts) + 1)

      slots = 0
      do i = 1, size(texts)
         slot = free_slot(slots, texts, texts(i))
         if (slots(slot) == 0) slots(slot) = i
         first(i) = slots(slot)
      end do
   end subroutine find_first_equal

   !> Slot of a name, or the free slot for it.
   pure integer function slot_of(self, name) result(slot)
      class(name_table_t), intent(in) :: self
      character(*), intent(in) :: name

      slot = free_slot(self%slots, self%names, name)
   end function slot_of

   !> Slot of the position of a name, or the free slot for it; at least half of the slots are free.
   pure integer function free_slot(slots, names, name) result(slot)
      integer, intent(in) :: slots(:)                       !! positions in `names`, 0 if free
      character(*), intent(in) :: names(:)
      character(*), intent(in) :: name
      integer(int64) :: hash
      integer :: i

      hash = 2166136261_int64
      do i = 1, len_trim(name)
         hash = iand(ieor(hash, int(ichar(name(i:i)), int64))*16777619_int64, 4294967295_int64)
      end do
      slot = int(mod(ieor(hash, ishft(hash, -16)), size(slots, kind=int64))) + 1
      do
         if (slots(slot) == 0) return
         if (names(slots(slot)) == name) return
         slot = slot + 1
         if (slot > size(slots)) slot = 1
      end do
   end function free_slot
end module hb_name_table
