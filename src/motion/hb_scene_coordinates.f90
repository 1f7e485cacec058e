!> The coordinates on which the unknowns of a scene stand.
module hb_scene_coordinates
   use hb_coordinates, only: coordinates_t
   use hb_law_coordinates, only: new_law_coordinates
   use hb_scene, only: scene_t
   implicit none
   private
   public :: coordinates_of

contains

   !> What the laws feel, and degrees of freedom at which a phase or an amplitude is told.
   function coordinates_of(scene, n_laws) result(coordinates)
      type(scene_t), intent(in) :: scene
      integer, intent(in), optional :: n_laws                         !! the first ones alone, else all
      type(coordinates_t) :: coordinates
      integer, allocatable :: wanted(:)
      integer :: last

      last = size(scene%laws)
      if (present(n_laws)) last = n_laws

      allocate (wanted(0))
      if (allocated(scene%phase_dofs)) wanted = scene%phase_dofs
      if (scene%normal_mode%is_asked .and. .not. scene%normal_mode%has_energy) wanted = [wanted, scene%normal_mode%dof]
      call new_law_coordinates(coordinates, scene%structure, scene%laws(:last), wanted)
   end function coordinates_of
end module hb_scene_coordinates
