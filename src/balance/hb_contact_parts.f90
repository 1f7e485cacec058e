!> What the motions of a whole model with many contacts share: the factor of its stiffness and its modes (hb_contact_flexibility)
!> for all points, harmonic sets and curves with the same matrices and contacts. Systems and their copies point at it; the owner of
!> the points allocates and frees it.
module hb_contact_parts
   use hb_amplitudes, only: amplitudes_t
   use hb_contact_flexibility, only: contact_flexibility_t, new_contact_flexibility, pays_to_factorise
   use hb_contact_stiffness, only: contact_stiffness_of
   use hb_coordinates, only: coordinates_t
   use hb_dynamic_stiffness, only: dynamic_stiffness_t, new_contact_stiffness
   use hb_kinds, only: wp
   use hb_law, only: law_box_t
   use hb_linear_part, only: linear_part_t, new_linear_part
   use hb_structure, only: structure_t
   implicit none
   private
   public :: contact_parts_t, free_contact_parts, is_factorised

   real(wp), parameter :: max_frequency_ratio = 3.0_wp ! highest frequency of an error estimate, by that of the motion

   !> Owner of external resources: call `destroy`.
   type :: contact_parts_t
      type(contact_flexibility_t), private :: flexibility
      logical, private :: is_known = .false., is_possible = .false.   ! examined, and found to be possible
   contains
      procedure :: find_linear_part => contact_parts_find_linear_part
      procedure :: cover => contact_parts_cover
      procedure :: destroy => contact_parts_destroy
   end type contact_parts_t

contains

   !> Whether the stiffness of a model is factorised as a whole, if its matrices permit it, and not condensed to its contacts.
   logical function is_factorised(structure, coordinates, laws)
      type(structure_t), intent(in) :: structure
      type(coordinates_t), intent(in) :: coordinates
      type(law_box_t), intent(in) :: laws(:)                          !! on numbers of coordinates

      is_factorised = pays_to_factorise(structure, coordinates)
      if (is_factorised) is_factorised = all(contact_stiffness_of(laws, coordinates%n) > 0.0_wp)
   end function is_factorised

   !> Makes the linear part of a whole model with many contacts; not allocated where the model is none, or where its matrices or
   !> laws do not permit it, see hb_contact_flexibility and hb_contact_stiffness.
   subroutine contact_parts_find_linear_part(self, structure, coordinates, laws, frequencies, loads, linear, load_slopes)
      class(contact_parts_t), intent(inout), target :: self
      type(structure_t), intent(in) :: structure
      type(coordinates_t), intent(in) :: coordinates
      type(law_box_t), intent(in) :: laws(:)                          !! on numbers of coordinates
      real(wp), intent(in) :: frequencies(:)                          !! [rad/s], (n_harmonics)
      type(amplitudes_t), intent(in) :: loads                         !! [N]
      class(linear_part_t), allocatable, intent(out) :: linear
      type(amplitudes_t), intent(in), optional :: load_slopes         !! by the frequencies [N s]; default zero
      type(dynamic_stiffness_t) :: stiffness
      real(wp) :: contact(coordinates%n)
      logical :: is_covered

      if (.not. is_factorised(structure, coordinates, laws)) return
      contact = contact_stiffness_of(laws, coordinates%n)
      if (self%is_known) self%is_known = self%flexibility%is_of(structure, coordinates, contact)
      if (.not. self%is_known) then
         call self%flexibility%destroy()
         call new_contact_flexibility(self%flexibility, structure, coordinates, contact, self%is_possible)
         self%is_known = .true.
      end if
      if (.not. self%is_possible) return
      call self%flexibility%cover(max_frequency_ratio*maxval(abs(frequencies)), is_covered, is_new_point=.true.)
      if (.not. is_covered) return
      call new_contact_stiffness(stiffness, self%flexibility, frequencies, loads, load_slopes)
      allocate (linear)
      call new_linear_part(linear, stiffness)
   end subroutine contact_parts_find_linear_part

   !> Computes the modes up to the highest frequency of a curve at once, so that they do not depend on how it gets there.
   subroutine contact_parts_cover(self, frequency)
      class(contact_parts_t), intent(inout) :: self
      real(wp), intent(in) :: frequency                               !! [rad/s]
      logical :: is_covered                                           ! otherwise the curve ends there

      if (self%is_possible) call self%flexibility%cover(max_frequency_ratio*frequency, is_covered)
   end subroutine contact_parts_cover

   !> Frees the factor; safe to call twice.
   subroutine contact_parts_destroy(self)
      class(contact_parts_t), intent(inout) :: self

      call self%flexibility%destroy()
      self%is_known = .false.
   end subroutine contact_parts_destroy

   !> Frees parts that a pointer owns.
   subroutine free_contact_parts(parts)
      type(contact_parts_t), pointer, intent(inout) :: parts          !! associated; afterwards null

      call parts%destroy()
      deallocate (parts)
   end subroutine free_contact_parts
end module hb_contact_parts
