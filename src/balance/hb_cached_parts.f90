!> What is cached of a balance from one point of a sweep to the next. The linear part is rebuilt when the structure, the coordinates
!> or the frequencies change, and takes new loads when these change. Of the laws on a small grid the transforms and the memory of
!> samples serve again; on a large one they take less time than the motion, and their memory is needed. The numbers are those of a
!> new balance in any case.
module hb_cached_parts
   use hb_amplitudes, only: amplitudes_t
   use hb_contact_parts, only: contact_parts_t, free_contact_parts
   use hb_coordinates, only: coordinates_t
   use hb_dynamic_stiffness, only: dynamic_stiffness_t, new_dynamic_stiffness, wanted_slopes_t
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_linear_part, only: linear_part_t, new_linear_part
   use hb_projected_laws, only: projected_laws_t
   use hb_structure, only: structure_t
   implicit none
   private
   public :: cached_balances_t, cached_parts_t

   integer, parameter :: small_grid = 4096                            ! samples of all coordinates

   !> Owner of external resources: call `destroy`.
   type :: cached_parts_t
      integer :: n_condensed = 0                                      !! number of harmonics condensed so far
      logical :: of_interior = .true.                                 !! the motion of all degrees of freedom is needed
      type(structure_t), private :: structure                         ! structure of the linear part
      real(wp), allocatable, private :: frequencies(:)                ! [rad/s], (n_harmonics)
      type(amplitudes_t), private :: loads                            ! [N]
      class(linear_part_t), allocatable, private :: linear             ! not allocated while it is in use
      type(projected_laws_t), allocatable, private :: laws             ! likewise, and if they are not cached
   contains
      procedure :: borrow => cached_parts_borrow
      procedure :: borrow_laws => cached_parts_borrow_laws
      procedure :: give_back => cached_parts_give_back
      procedure :: destroy => cached_parts_destroy
   end type cached_parts_t

   !> Parts shared by the motions of a sweep, of their balances and those of their error estimates. Owner of external resources:
   !> call `destroy`.
   type :: cached_balances_t
      type(cached_parts_t) :: narrow, wide
      type(contact_parts_t), pointer, private :: contacts => null()   ! of whole models, owned
   contains
      procedure :: contact_parts => cached_balances_contact_parts
      procedure :: destroy => cached_balances_destroy
   end type cached_balances_t

contains

   !> Moves the linear part of a structure, without slopes and drives, to the caller until it is given back. Fails as
   !> `new_dynamic_stiffness` does.
   subroutine cached_parts_borrow(self, structure, coordinates, set, frequencies, loads, linear, error)
      class(cached_parts_t), intent(inout) :: self
      type(structure_t), intent(in) :: structure
      type(coordinates_t), intent(in) :: coordinates
      type(harmonics_t), intent(in) :: set
      real(wp), intent(in) :: frequencies(:)                          !! of the set [rad/s], (n_harmonics)
      type(amplitudes_t), intent(in) :: loads                         !! [N]
      class(linear_part_t), allocatable, intent(out) :: linear
      type(error_t), allocatable, intent(out) :: error
      type(wanted_slopes_t) :: wanted
      integer :: n

      wanted%of_interior = self%of_interior
      wanted%may_share = .true.
      if (has_same_stiffness(self, structure, coordinates, set, frequencies)) then
         call self%linear%change_loads(structure, frequencies, self%loads, loads, error, n)
         self%n_condensed = self%n_condensed + n
         if (.not. allocated(error)) call move_alloc(self%linear, linear)
      else
         call move_alloc(self%linear, linear)
         call make_linear(structure, coordinates, set, frequencies, loads, linear, error, wanted)
         self%n_condensed = self%n_condensed + size(frequencies)
         if (.not. structure%has_matrices_of(self%structure)) self%structure = structure
         self%frequencies = frequencies
      end if
      if (allocated(error)) return
      self%loads = loads
      linear%support_share = 0.0_wp
   end subroutine cached_parts_borrow

   !> Creates a linear part.
   subroutine make_linear(structure, coordinates, set, frequencies, loads, linear, error, wanted)
      type(structure_t), intent(in) :: structure
      type(coordinates_t), intent(in) :: coordinates
      type(harmonics_t), intent(in) :: set
      real(wp), intent(in) :: frequencies(:)
      type(amplitudes_t), intent(in) :: loads
      class(linear_part_t), allocatable, intent(inout) :: linear
      type(error_t), allocatable, intent(out) :: error
      type(wanted_slopes_t), intent(in) :: wanted
      type(dynamic_stiffness_t) :: stiffness

      call new_dynamic_stiffness(stiffness, structure, coordinates, frequencies, loads, error, wanted, set%tuples)
      if (allocated(error)) return
      if (.not. allocated(linear)) allocate (linear)
      call new_linear_part(linear, stiffness)
   end subroutine make_linear

   !> Moves the laws of the last motion to the caller, for `new_projected_laws`; none if there are none.
   subroutine cached_parts_borrow_laws(self, laws)
      class(cached_parts_t), intent(inout) :: self
      type(projected_laws_t), allocatable, intent(inout) :: laws      !! none on entry

      if (allocated(self%laws)) call move_alloc(self%laws, laws)
   end subroutine cached_parts_borrow_laws

   !> Returns a linear part to the cache, and laws if they are on a small grid.
   subroutine cached_parts_give_back(self, linear, laws)
      class(cached_parts_t), intent(inout) :: self
      class(linear_part_t), allocatable, intent(inout) :: linear
      type(projected_laws_t), allocatable, intent(inout), optional :: laws

      call move_alloc(linear, self%linear)
      if (.not. present(laws)) return
      if (.not. allocated(laws)) return
      if (laws%transform%torus%n_total*laws%n_dofs <= small_grid) call move_alloc(laws, self%laws)
   end subroutine cached_parts_give_back

   !> Frees transforms and samples; safe to call twice.
   subroutine cached_parts_destroy(self)
      class(cached_parts_t), intent(inout) :: self

      if (.not. allocated(self%laws)) return
      call self%laws%destroy()
      deallocate (self%laws)
   end subroutine cached_parts_destroy

   !> What whole models with many contacts share, for the systems of all points; null for other models.
   function cached_balances_contact_parts(self, structure) result(parts)
      class(cached_balances_t), intent(inout) :: self
      type(structure_t), intent(in) :: structure                      !! of the model
      type(contact_parts_t), pointer :: parts

      nullify (parts)
      if (.not. allocated(structure%sparse)) return
      if (.not. associated(self%contacts)) allocate (self%contacts)
      parts => self%contacts
   end function cached_balances_contact_parts

   !> Frees what both hold; safe to call twice.
   subroutine cached_balances_destroy(self)
      class(cached_balances_t), intent(inout) :: self

      if (associated(self%contacts)) call free_contact_parts(self%contacts)
      call self%narrow%destroy()
      call self%wide%destroy()
   end subroutine cached_balances_destroy

   logical function has_same_stiffness(self, structure, coordinates, set, frequencies) result(is_same)
      type(cached_parts_t), intent(in) :: self
      type(structure_t), intent(in) :: structure
      type(coordinates_t), intent(in) :: coordinates
      type(harmonics_t), intent(in) :: set
      real(wp), intent(in) :: frequencies(:)

      is_same = allocated(self%linear)
      if (is_same) is_same = self%linear%has_interior() .or. .not. self%of_interior
      if (is_same) is_same = size(frequencies) == size(self%frequencies)
      if (is_same) is_same = all(frequencies == self%frequencies)
      if (is_same) is_same = coordinates%equal(self%linear%coordinates)
      if (is_same) is_same = structure%has_matrices_of(self%structure)
      if (is_same .and. allocated(self%linear%tuples)) is_same = all(set%tuples == self%linear%tuples)
   end function has_same_stiffness
end module hb_cached_parts
