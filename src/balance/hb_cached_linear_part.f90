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
      integer :: n_condensed = 0                                      !! harmonics that were condensed so far
      type(structure_t), private :: structure                         ! what the linear part is of
      real(wp), allocatable, private :: frequencies(:)                ! [rad/s], (n_harmonics)
      type(amplitudes_t), private :: loads                            ! [N]
      type(linear_part_t), allocatable, private :: linear             ! while nobody has it
   contains
      procedure :: take => cached_linear_part_take
      procedure :: give_back => cached_linear_part_give_back
   end type cached_linear_part_t

   !> Linear parts that the motions of a sweep share, of the solution and of its certificate.
   type :: cached_linear_parts_t
      type(cached_linear_part_t) :: narrow, wide
   end type cached_linear_parts_t

contains

   !> Hands out the linear part of a structure, without slopes and drives; until it is given back there is none here. Fails as
   !> `new_dynamic_stiffness` does.
   subroutine cached_linear_part_take(self, structure, coordinates, frequencies, loads, linear, error, of_interior)
      class(cached_linear_part_t), intent(inout) :: self
      type(structure_t), intent(in) :: structure
      type(coordinates_t), intent(in) :: coordinates
      real(wp), intent(in) :: frequencies(:)                          !! [rad/s], (n_harmonics)
      type(amplitudes_t), intent(in) :: loads                         !! [N]
      type(linear_part_t), allocatable, intent(out) :: linear
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: of_interior                    !! the motion of all degrees of freedom is requested; default
                                                                      !! true
      type(wanted_slopes_t) :: wanted

      if (present(of_interior)) wanted%of_interior = of_interior
      if (has_same_stiffness(self, structure, coordinates, frequencies, wanted%of_interior)) then
         call take_loads(self, structure, frequencies, loads, error)
         if (.not. allocated(error)) call move_alloc(self%linear, linear)
      else
         call move_alloc(self%linear, linear)
         if (allocated(linear)) linear = linear_part_t()               ! room for the new one
         call make_linear(structure, coordinates, frequencies, loads, linear, error, wanted)
         self%n_condensed = self%n_condensed + size(frequencies)
         if (.not. structure%has_matrices_of(self%structure)) self%structure = structure
         self%frequencies = frequencies
      end if
      if (allocated(error)) return
      self%loads = loads
      linear%support_share = 0.0_wp
   end subroutine cached_linear_part_take

   !> Makes a linear part.
   subroutine make_linear(structure, coordinates, frequencies, loads, linear, error, wanted)
      type(structure_t), intent(in) :: structure
      type(coordinates_t), intent(in) :: coordinates
      real(wp), intent(in) :: frequencies(:)
      type(amplitudes_t), intent(in) :: loads
      type(linear_part_t), allocatable, intent(inout) :: linear
      type(error_t), allocatable, intent(out) :: error
      type(wanted_slopes_t), intent(in) :: wanted
      type(dynamic_stiffness_t) :: stiffness

      call new_dynamic_stiffness(stiffness, structure, coordinates, frequencies, loads, error, wanted)
      if (allocated(error)) return
      if (.not. allocated(linear)) allocate (linear)
      call new_linear_part(linear, stiffness)
   end subroutine make_linear

   !> Condenses the harmonics whose loads have changed, and with them the fastest one: rounding depends on the frequency of that.
   subroutine take_loads(self, structure, frequencies, loads, error)
      type(cached_linear_part_t), intent(inout) :: self
      type(structure_t), intent(in) :: structure
      real(wp), intent(in) :: frequencies(:)
      type(amplitudes_t), intent(in) :: loads
      type(error_t), allocatable, intent(out) :: error
      type(dynamic_stiffness_t) :: part
      integer, allocatable :: places(:)
      integer :: h
      logical :: is_other(size(frequencies))

      is_other = .false.
      do h = 1, size(frequencies)
         if (any(loads%harmonics == h) .or. any(self%loads%harmonics == h)) is_other(h) = any(loads%of(h) /= self%loads%of(h))
      end do
      if (.not. any(is_other)) return
      is_other(maxloc(abs(frequencies), dim=1)) = .true.
      places = pack([(h, h=1, size(frequencies))], is_other)
      call new_dynamic_stiffness(part, structure, self%linear%coordinates, frequencies(places), loads%at(places), error, &
                                 wanted_slopes_t(of_interior=.false.))
      self%n_condensed = self%n_condensed + size(places)
      if (.not. allocated(error)) call self%linear%take_loads(part, places)
   end subroutine take_loads

   !> Takes a linear part back from who had it.
   subroutine cached_linear_part_give_back(self, linear)
      class(cached_linear_part_t), intent(inout) :: self
      type(linear_part_t), allocatable, intent(inout) :: linear

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
