!> A linear part that is cached from one point of a sweep to the next: it is rebuilt when the structure, the coordinates or the
!> frequencies change, and takes new loads when these change; the numbers are those of a new one in any case.
module hb_cached_linear_part
   use hb_amplitudes, only: amplitudes_t
   use hb_coordinates, only: coordinates_t
   use hb_dynamic_stiffness, only: dynamic_stiffness_t, new_dynamic_stiffness, wanted_slopes_t
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_linear_part, only: linear_part_t, new_linear_part
   use hb_structure, only: structure_t
   implicit none
   private
   public :: cached_linear_part_t, cached_linear_parts_t

   type :: cached_linear_part_t
      integer :: n_condensed = 0                                      !! number of harmonics condensed so far
      type(structure_t), private :: structure                         ! structure of the linear part
      real(wp), allocatable, private :: frequencies(:)                ! [rad/s], (n_harmonics)
      type(amplitudes_t), private :: loads                            ! [N]
      class(linear_part_t), allocatable, private :: linear             ! not allocated while it is in use
   contains
      procedure :: borrow => cached_linear_part_borrow
      procedure :: give_back => cached_linear_part_give_back
   end type cached_linear_part_t

   !> Linear parts shared by the motions of a sweep, of the solution and of its error estimate.
   type :: cached_linear_parts_t
      type(cached_linear_part_t) :: narrow, wide
   end type cached_linear_parts_t

contains

   !> Moves the linear part of a structure, without slopes and drives, to the caller until it is given back. Fails as
   !> `new_dynamic_stiffness` does.
   subroutine cached_linear_part_borrow(self, structure, coordinates, frequencies, loads, linear, error, of_interior)
      class(cached_linear_part_t), intent(inout) :: self
      type(structure_t), intent(in) :: structure
      type(coordinates_t), intent(in) :: coordinates
      real(wp), intent(in) :: frequencies(:)                          !! [rad/s], (n_harmonics)
      type(amplitudes_t), intent(in) :: loads                         !! [N]
      class(linear_part_t), allocatable, intent(out) :: linear
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: of_interior                    !! the motion of all degrees of freedom is needed; default
                                                                      !! true
      type(wanted_slopes_t) :: wanted
      integer :: n

      if (present(of_interior)) wanted%of_interior = of_interior
      wanted%may_share = .true.
      if (has_same_stiffness(self, structure, coordinates, frequencies, wanted%of_interior)) then
         call self%linear%change_loads(structure, frequencies, self%loads, loads, error, n)
         self%n_condensed = self%n_condensed + n
         if (.not. allocated(error)) call move_alloc(self%linear, linear)
      else
         call move_alloc(self%linear, linear)
         call make_linear(structure, coordinates, frequencies, loads, linear, error, wanted)
         self%n_condensed = self%n_condensed + size(frequencies)
         if (.not. structure%has_matrices_of(self%structure)) self%structure = structure
         self%frequencies = frequencies
      end if
      if (allocated(error)) return
      self%loads = loads
      linear%support_share = 0.0_wp
   end subroutine cached_linear_part_borrow

   !> Creates a linear part.
   subroutine make_linear(structure, coordinates, frequencies, loads, linear, error, wanted)
      type(structure_t), intent(in) :: structure
      type(coordinates_t), intent(in) :: coordinates
      real(wp), intent(in) :: frequencies(:)
      type(amplitudes_t), intent(in) :: loads
      class(linear_part_t), allocatable, intent(inout) :: linear
      type(error_t), allocatable, intent(out) :: error
      type(wanted_slopes_t), intent(in) :: wanted
      type(dynamic_stiffness_t) :: stiffness

      call new_dynamic_stiffness(stiffness, structure, coordinates, frequencies, loads, error, wanted)
      if (allocated(error)) return
      if (.not. allocated(linear)) allocate (linear)
      call new_linear_part(linear, stiffness)
   end subroutine make_linear

   !> Returns a linear part to the cache.
   subroutine cached_linear_part_give_back(self, linear)
      class(cached_linear_part_t), intent(inout) :: self
      class(linear_part_t), allocatable, intent(inout) :: linear

      call move_alloc(linear, self%linear)
   end subroutine cached_linear_part_give_back

   logical function has_same_stiffness(self, structure, coordinates, frequencies, of_interior) result(is_same)
      type(cached_linear_part_t), intent(in) :: self
      type(structure_t), intent(in) :: structure
      type(coordinates_t), intent(in) :: coordinates
      real(wp), intent(in) :: frequencies(:)
      logical, intent(in) :: of_interior

      is_same = allocated(self%linear)
      if (is_same) is_same = self%linear%has_interior() .or. .not. of_interior
      if (is_same) is_same = size(frequencies) == size(self%frequencies)
      if (is_same) is_same = all(frequencies == self%frequencies)
      if (is_same) is_same = coordinates%equal(self%linear%coordinates)
      if (is_same) is_same = structure%has_matrices_of(self%structure)
   end function has_same_stiffness
end module hb_cached_linear_part
