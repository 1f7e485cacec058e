!> Named sets of nodes of a structure, and named load vectors, which address many degrees of freedom at once.
module hb_node_sets
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   use hb_similar_word, only: closest_word
   use hb_text, only: join, to_text
   implicit none
   private
   public :: name_length, named_vectors_t, node_sets_t

   integer, parameter :: name_length = 64                             !! longest name of a set or a vector
   integer, parameter :: direction_length = 8

   !> Sets of nodes. With a direction after a dot, as in `contact.z`, a set is a list of degrees of freedom.
   type :: node_sets_t
      character(name_length), allocatable :: names(:)                 !! (n_sets)
      integer, allocatable :: first(:)                                !! (n_sets + 1): nodes first(i) to first(i + 1) - 1
      integer, allocatable :: nodes(:)                                !! of all sets
      integer, allocatable :: node_of(:)                              !! (n_dofs), 0: none
      character(direction_length), allocatable :: direction(:)        !! (n_dofs), such as `x` or `rz`
      real(wp), allocatable :: coordinates(:, :)                      !! [m], (3, n_nodes), where they are known
   contains
      procedure :: add => node_sets_add
      procedure :: find => node_sets_find
   end type node_sets_t

   !> Named vectors, each by its entries.
   type :: named_vectors_t
      character(name_length), allocatable :: names(:)                 !! (n_vectors)
      integer, allocatable :: first(:)                                !! (n_vectors + 1)
      integer, allocatable :: dofs(:)
      real(wp), allocatable :: values(:)                              !! [N]
   contains
      procedure :: add => named_vectors_add
      procedure :: find => named_vectors_find
   end type named_vectors_t

contains

   !> Adds a set; fails for nodes that do not exist or occur twice.
   pure subroutine node_sets_add(self, name, nodes, n_nodes, error)
      class(node_sets_t), intent(inout) :: self
      character(*), intent(in) :: name
      integer, intent(in) :: nodes(:)                                 !! from 0
      integer, intent(in) :: n_nodes
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      do k = 1, size(nodes)
         if (nodes(k) < 0 .or. nodes(k) >= n_nodes) then
            call fail(error, "set '"//name//"' names node "//to_text(nodes(k))//", there are 0 to "//to_text(n_nodes - 1))
         else if (any(nodes(:k - 1) == nodes(k))) then
            call fail(error, "set '"//name//"' names node "//to_text(nodes(k))//" twice")
         end if
         if (allocated(error)) return
      end do
      if (.not. allocated(self%names)) then
         allocate (self%names(0), self%nodes(0))
         self%first = [1]
      end if
      self%names = [character(name_length) :: self%names, name]
      self%nodes = [self%nodes, nodes + 1]
      self%first = [self%first, size(self%nodes) + 1]
   end subroutine node_sets_add

   !> Adds a vector; fails for degrees of freedom that do not exist, and for values that are not finite.
   pure subroutine named_vectors_add(self, name, dofs, values, n_dofs, error)
      class(named_vectors_t), intent(inout) :: self
      character(*), intent(in) :: name
      integer, intent(in) :: dofs(:)                                  !! from 0
      real(wp), intent(in) :: values(:)                               !! [N], as dofs
      integer, intent(in) :: n_dofs
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      do k = 1, size(dofs)
         if (dofs(k) < 0 .or. dofs(k) >= n_dofs) then
            call fail(error, "load '"//name//"' names degree of freedom "//to_text(dofs(k))//", there are 0 to "// &
                      to_text(n_dofs - 1))
         else if (.not. ieee_is_finite(values(k))) then
            call fail(error, "value "//to_text(k)//" of load '"//name//"' is not a finite number")
         end if
         if (allocated(error)) return
      end do
      if (.not. allocated(self%names)) then
         allocate (self%names(0), self%dofs(0), self%values(0))
         self%first = [1]
      end if
      self%names = [character(name_length) :: self%names, name]
      self%dofs = [self%dofs, dofs + 1]
      self%values = [self%values, values]
      self%first = [self%first, size(self%dofs) + 1]
   end subroutine named_vectors_add

   !> Degrees of freedom of a set in the order of its nodes: `contact.z`, or `contact` if its nodes have only one
   !> direction. Not allocated if no set has the name; fails if a node of the set lacks the direction.
   pure subroutine node_sets_find(self, name, dofs, error)
      class(node_sets_t), intent(in) :: self
      character(*), intent(in) :: name
      integer, allocatable, intent(out) :: dofs(:)
      type(error_t), allocatable, intent(out) :: error
      character(:), allocatable :: direction, word
      integer, allocatable :: dof_at(:)
      integer :: dot, i, i_set

      if (.not. allocated(self%names)) return
      word = trim(adjustl(name))
      direction = ""
      i_set = position_of(self%names, word)
      dot = index(word, ".", back=.true.)
      if (i_set == 0 .and. dot > 1) then
         direction = word(dot + 1:)
         i_set = position_of(self%names, word(:dot - 1))
      end if
      if (i_set == 0) return
      associate (nodes => self%nodes(self%first(i_set):self%first(i_set + 1) - 1))
         if (size(nodes) == 0) then
            call fail(error, "set '"//trim(self%names(i_set))//"' has no nodes")
            return
         end if
         allocate (dof_at(maxval(nodes)), source=0)
         do i = 1, size(self%node_of)
            if (self%node_of(i) < 1 .or. self%node_of(i) > size(dof_at)) cycle
            if (direction /= "" .and. self%direction(i) /= direction) cycle
            if (direction == "" .and. dof_at(self%node_of(i)) > 0 .and. any(nodes == self%node_of(i))) then
               call fail(error, "set '"//word//"' needs a direction, such as '"//word//"."//trim(self%direction(i))//"'")
               return
            end if
            dof_at(self%node_of(i)) = i
         end do
         if (any(dof_at(nodes) == 0)) then
            i = findloc(dof_at(nodes), 0, dim=1)
            call fail(error, "node "//to_text(i)//" of set '"//trim(self%names(i_set))//"' has no degree of freedom '"// &
                      direction//"'; "//to_text(count(dof_at(nodes) == 0))//" of its "//to_text(size(nodes))//" nodes have none")
            return
         end if
         dofs = dof_at(nodes)
      end associate
   end subroutine node_sets_find

   !> Returns the entries of a vector; fails with the known names and the closest one.
   pure subroutine named_vectors_find(self, name, dofs, values, error)
      class(named_vectors_t), intent(in) :: self
      character(*), intent(in) :: name
      integer, allocatable, intent(out) :: dofs(:)
      real(wp), allocatable, intent(out) :: values(:)
      type(error_t), allocatable, intent(out) :: error
      character(:), allocatable :: closest, known
      integer :: i

      allocate (dofs(0), values(0))
      i = 0
      known = "none; they come with a structure of type 'model'"
      closest = ""
      if (allocated(self%names)) then
         i = position_of(self%names, trim(adjustl(name)))
         if (size(self%names) > 0) known = join(self%names, ", ")
         closest = trim(closest_word(name, self%names))
      end if
      if (i == 0) then
         if (len(closest) > 0) closest = "; did you mean '"//closest//"'?"
         call fail(error, "unknown load vector '"//trim(adjustl(name))//"'; known: "//known//closest)
         return
      end if
      dofs = self%dofs(self%first(i):self%first(i + 1) - 1)
      values = self%values(self%first(i):self%first(i + 1) - 1)
   end subroutine named_vectors_find

   pure integer function position_of(names, name) result(position)
      character(*), intent(in) :: names(:), name

      do position = 1, size(names)
         if (names(position) == name) return
      end do
      position = 0
   end function position_of
end module hb_node_sets
