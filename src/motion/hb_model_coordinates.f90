!> The coordinates of the unknowns of a model.
module hb_model_coordinates
   use hb_coordinates, only: coordinates_t
   use hb_law_coordinates, only: new_law_coordinates
   use hb_model, only: model_t
   implicit none
   private
   public :: coordinates_of

contains

   !> What the laws feel, and degrees of freedom at which a phase or an amplitude is reported.
   function coordinates_of(model, n_laws) result(coordinates)
      type(model_t), intent(in) :: model
      integer, intent(in), optional :: n_laws                         !! the first ones alone, else all
      type(coordinates_t) :: coordinates
      integer, allocatable :: wanted(:)
      integer :: last

      last = size(model%laws)
      if (present(n_laws)) last = n_laws

      allocate (wanted(0))
      if (allocated(model%phase_dofs)) wanted = model%phase_dofs
      if (model%normal_mode%is_asked .and. .not. model%normal_mode%has_energy) wanted = [wanted, model%normal_mode%dof]
      call new_law_coordinates(coordinates, model%structure, model%laws(:last), wanted)
   end function coordinates_of
end module hb_model_coordinates
