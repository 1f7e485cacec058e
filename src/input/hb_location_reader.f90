!> Reads where a law acts: degrees of freedom by their names.
module hb_location_reader
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_law, only: add_coordinate, law_t, place_on_dofs, placement_t
   use hb_properties, only: properties_t
   use hb_structure, only: structure_t
   use hb_text, only: string_t, to_text
   implicit none
   private
   public :: read_dofs, read_further, read_location

contains

   !> Reads the first coordinate of a law: `dof`, or `dofs` and `weights` for z = sum of weight times degree of
   !> freedom (weights 1, -1: a relative displacement).
   subroutine read_location(self, group, structure)
      class(law_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(in) :: structure
      type(string_t), allocatable :: names(:)
      character(:), allocatable :: name
      real(wp), allocatable :: weights(:)

      if (group%given("dof") .and. group%given("dofs")) then
         call group%problem("dofs", "give either 'dof' or 'dofs', not both")
      end if
      if (group%given("set") .and. .not. (group%given("dof") .or. group%given("dofs"))) then
         call group%problem("set", "is not a key of laws; the name of a set of nodes is a value of 'dof', "// &
                            "such as dof = 'contact.z'")
      else if (group%given("dofs")) then
         call group%get("dofs", names)
         if (.not. allocated(names)) return
         if (.not. group%given("weights")) then
            call group%problem("dofs", "needs 'weights', one for each, such as 1.0, -1.0; one degree of freedom, or each node "// &
                               "of a set, is 'dof'")
            return
         end if
         call group%get("weights", weights, n=size(names))
         if (.not. allocated(weights)) return
         call read_coordinate(self, group, structure, "dofs", names, weights)
      else
         call group%get("dof", name)
         if (.not. allocated(name)) return
         allocate (names(1))
         names(1)%value = name
         call read_coordinate(self, group, structure, "dof", names, [1.0_wp])
      end if
   end subroutine read_location

   !> Reads the coordinates of a law with several of them: `dofs`, each a coordinate of its own, or `dof`, a single one.
   subroutine read_dofs(self, group, structure)
      class(law_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(in) :: structure
      type(placement_t) :: placement
      type(string_t), allocatable :: names(:)
      character(:), allocatable :: key, name

      if (group%given("dof") .and. .not. group%given("dofs")) then
         key = "dof"
         call group%get(key, name)
         if (.not. allocated(name)) return
         allocate (names(1))
         names(1)%value = name
      else
         key = "dofs"
         if (group%given("dof")) call group%problem(key, "give either 'dof' or 'dofs', not both")
         call group%get(key, names, required=.true.)
         if (.not. allocated(names)) return
      end if
      call read_coordinate(self, group, structure, key, names, spread(1.0_wp, 1, size(names)))
      if (.not. allocated(self%dofs)) return
      placement = self%placement()
      if (all(placement%counts /= size(self%dofs) .and. placement%counts > 0)) then
         call group%problem(key, trim(placement%dofs))
      else
         call place_on_dofs(self, (self%dofs))
      end if
   end subroutine read_dofs

   !> Reads the coordinates of a law after the first one, such as `second_dofs` with `second_weights`.
   subroutine read_further(self, group, structure)
      class(law_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(in) :: structure
      type(placement_t) :: placement
      type(string_t), allocatable :: names(:)
      character(:), allocatable :: key
      real(wp), allocatable :: weights(:)
      integer :: i

      placement = self%placement()
      do i = 1, size(placement%further)
         key = trim(placement%further(i))
         if (key == "") return
         if (allocated(names)) deallocate (names)
         if (allocated(weights)) deallocate (weights)
         call group%get(key, names)
         if (.not. allocated(names)) return
         call group%get(key(:index(key, "dofs") - 1)//"weights", weights, n=size(names))
         call read_coordinate(self, group, structure, key, names, weights)
      end do
   end subroutine read_further

   !> Adds a coordinate of the law, z = sum of weights times the named degrees of freedom; those of previous
   !> coordinates may be named again. The name of a set of nodes places the law at every node of the set; single
   !> degrees of freedom beside it belong to each of them. Problems are those of `key`.
   subroutine read_coordinate(self, group, structure, key, names, weights)
      class(law_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(in) :: structure
      character(*), intent(in) :: key                                 !! key with the names
      type(string_t), intent(in) :: names(:)
      real(wp), intent(in) :: weights(:)
      type(error_t), allocatable :: error
      integer, allocatable :: dofs(:), positions(:, :)
      integer :: i, n_positions

      if (size(weights) /= size(names)) then
         call group%problem(key, "there must be as many weights as degrees of freedom")
         return
      end if
      n_positions = 1
      if (allocated(self%positions)) n_positions = size(self%positions, 2)
      allocate (positions(size(names), n_positions), source=0)
      do i = 1, size(names)
         call structure%find_dofs(names(i)%value, dofs, error)
         if (allocated(error)) then
            call group%problem(key, error%message)
            return
         end if
         if (size(positions, 2) == 1 .and. size(dofs) > 1) positions = spread(positions(:, 1), 2, size(dofs))
         if (size(dofs) == 1) dofs = spread(dofs(1), 1, size(positions, 2))
         if (size(dofs) /= size(positions, 2)) then
            call group%problem(key, "'"//names(i)%value//"' stands for "//to_text(size(dofs))//" degrees of freedom, another "// &
                               "set of this law for "//to_text(size(positions, 2))//"; sets that meet need equal numbers of nodes")
            return
         end if
         positions(i, :) = dofs
         if (any(positions(1:i - 1, :) == spread(dofs, 1, i - 1))) then
            call group%problem(key, "degree of freedom '"//names(i)%value//"' is named twice")
            return
         end if
      end do
      if (all(weights == 0.0_wp)) call group%problem("weights", "at least one weight must not be zero")
      if (key == "dof") then
         call add_coordinate(self, positions, weights)
      else
         call add_coordinate(self, positions, weights, key(:index(key, "dofs") - 1)//"weights")
      end if
   end subroutine read_coordinate
end module hb_location_reader
