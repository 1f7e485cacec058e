!> The base frequencies of a model: the group `&tones`.
module hb_model_tones
   use hb_document, only: document_t
   use hb_error, only: annotate, error_t
   use hb_kinds, only: two_pi, wp
   use hb_properties, only: properties_t
   use hb_text, only: to_text
   use hb_tones, only: new_tones, tones_t
   implicit none
   private
   public :: read_tones

contains

   !> Reads `&tones`: `frequency` [rad/s] or `hertz`, which of them are `unknown`, and by what they are divided (`subharmonic`).
   subroutine read_tones(self, document, error)
      type(tones_t), intent(out) :: self
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error
      type(properties_t), pointer :: group
      real(wp), allocatable :: omega(:)
      logical, allocatable :: is_unknown(:)
      character(:), allocatable :: key
      integer :: subharmonic

      call document%required_group("tones", group, error)
      if (allocated(error)) return
      if (group%given("hertz")) then
         if (group%given("frequency")) then
            call group%problem("hertz", "give either 'frequency' [rad/s] or 'hertz', not both")
            call group%get("frequency", omega)
         end if
         call group%get("hertz", omega)
         if (allocated(omega)) omega = two_pi*omega
      else if (group%given("frequency") .or. .not. group%given("unknown")) then
         call group%get("frequency", omega)
      else
         call group%get("unknown", is_unknown)
         if (allocated(is_unknown)) then
            omega = spread(0.0_wp, 1, size(is_unknown))
            call group%get("frequency", omega, required=.not. all(is_unknown))
         end if
      end if
      if (allocated(omega)) then
         is_unknown = spread(.false., 1, size(omega))
         call group%get("unknown", is_unknown)
         if (size(is_unknown) /= size(omega)) then
            call group%problem("unknown", "give one value for each of the "//to_text(size(omega))//" tones")
         else if (any(omega <= 0.0_wp .and. .not. is_unknown)) then
            key = trim(merge("hertz    ", "frequency", group%given("hertz")))
            call group%problem(key, key//"("//to_text(findloc(omega <= 0.0_wp .and. .not. is_unknown, .true., dim=1))// &
                               ") = 0.0 must be above 0.0; only for an unknown tone 0 means that there is no first guess")
         end if
      end if
      call group%get("subharmonic", subharmonic)
      if (allocated(omega)) omega = omega/subharmonic
      call group%finish(error)
      if (allocated(error)) return
      call new_tones(self, omega, error, is_unknown)
      self%subharmonic = subharmonic
      if (allocated(error)) call annotate(error, group%place())
   end subroutine read_tones
end module hb_model_tones
