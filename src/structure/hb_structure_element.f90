!> An element that is added to a structure, such as a bearing: it declares its numbers (hb_numbers), and adds to the matrices
!> as often as they change. Each kind is a group of an input, a row of src/structure_elements.txt.
module hb_structure_element
   use hb_kinds, only: wp
   use hb_numbers, only: numbered_t
   use hb_problems, only: problems_t
   use hb_sparse, only: sparse_from_entries, sparse_sum, sparse_t
   use hb_structure, only: structure_t
   implicit none
   private
   public :: dof_key_length, element_box_t, structure_element_t

   integer, parameter :: dof_key_length = 9

   type, extends(numbered_t), abstract :: structure_element_t
      integer, allocatable :: dofs(:)                                 !! degrees of freedom at which it is, key by key
      integer, allocatable :: n_of_key(:)                             !! how many each key names
   contains
      procedure(add_element), deferred :: add_to
      procedure :: n_dofs => structure_element_n_dofs
      procedure :: get_dof_keys => structure_element_get_dof_keys
      procedure :: wanted_dofs => structure_element_wanted_dofs
      procedure :: n_tones => structure_element_n_tones
      procedure :: check => structure_element_check
      procedure, nopass :: add_matrices => structure_element_add_matrices
   end type structure_element_t

   abstract interface
      !> Adds the element, with its present numbers, to a structure (`add_matrices`).
      subroutine add_element(self, structure)
         import :: structure_element_t, structure_t
         class(structure_element_t), intent(in) :: self
         type(structure_t), intent(inout) :: structure
      end subroutine add_element
   end interface

   !> Elements in an array.
   type :: element_box_t
      integer :: object = 0                                           !! its kind, as a `model_number_t` has it
      integer :: i = 0                                                !! its number among those of this kind, as given
      class(structure_element_t), allocatable :: element
   end type element_box_t

contains

   !> Keys that name the degrees of freedom of an element, which are together those of all.
   pure subroutine structure_element_get_dof_keys(self, keys)
      class(structure_element_t), intent(in) :: self
      character(dof_key_length), allocatable, intent(out) :: keys(:)

      keys = [character(dof_key_length) :: "dofs"]
   end subroutine structure_element_get_dof_keys

   !> Degrees of freedom that must be unknown where laws act on some.
   pure function structure_element_wanted_dofs(self, structure, is_used) result(dofs)
      class(structure_element_t), intent(in) :: self
      type(structure_t), intent(in) :: structure                      !! with this element
      logical, intent(in) :: is_used(:)                               !! (structure%n_dofs), by laws
      integer, allocatable :: dofs(:)

      allocate (dofs(0))
   end function structure_element_wanted_dofs

   !> Number of tones that an element is for; negative: any.
   pure integer function structure_element_n_tones(self) result(n_tones)
      class(structure_element_t), intent(in) :: self

      n_tones = -1
   end function structure_element_n_tones

   !> Number of degrees of freedom that each key names; 0: any.
   pure integer function structure_element_n_dofs(self) result(n_dofs)
      class(structure_element_t), intent(in) :: self

      n_dofs = 1
   end function structure_element_n_dofs

   !> Reports numbers that do not fit together, which `has_valid_numbers` rejects.
   subroutine structure_element_check(self, problems)
      class(structure_element_t), intent(in) :: self
      class(problems_t), intent(inout) :: problems
   end subroutine structure_element_check

   !> Adds matrices between different degrees of freedom to those of a structure.
   subroutine structure_element_add_matrices(structure, dofs, stiffness, damping, mass)
      type(structure_t), intent(inout) :: structure
      integer, intent(in) :: dofs(:)
      real(wp), intent(in) :: stiffness(:, :), damping(:, :)          !! [N/m], [N s/m], (n_dofs, n_dofs)
      real(wp), intent(in), optional :: mass(:, :)                    !! [kg], likewise: symmetric, positive semidefinite

      if (allocated(structure%sparse)) then
         associate (s => structure%sparse)
            call add_entries(s%stiffness, dofs, stiffness)
            call add_entries(s%damping, dofs, damping)
            if (present(mass)) call add_entries(s%mass, dofs, mass)
         end associate
      else
         structure%stiffness(dofs, dofs) = structure%stiffness(dofs, dofs) + stiffness
         structure%damping(dofs, dofs) = structure%damping(dofs, dofs) + damping
         if (present(mass)) structure%mass(dofs, dofs) = structure%mass(dofs, dofs) + mass
      end if
   end subroutine structure_element_add_matrices

   !> Adds a matrix between degrees of freedom to a sparse one.
   subroutine add_entries(sum, dofs, matrix)
      type(sparse_t), intent(inout) :: sum
      integer, intent(in) :: dofs(:)
      real(wp), intent(in) :: matrix(:, :)                            !! (size(dofs), size(dofs))
      integer :: i, k

      associate (n => size(dofs))
         associate (rows => [((dofs(i), k=1, n), i=1, n)], columns => [((dofs(k), k=1, n), i=1, n)])
            sum = sparse_sum(1.0_wp, sum, 1.0_wp, sparse_from_entries(sum%n_rows, rows, columns, [transpose(matrix)]))
         end associate
      end associate
   end subroutine add_entries
end module hb_structure_element
