!> The base frequencies of a scene: the group `&tones`.
module hb_scene_tones
   use hb_document, only: document_t
   use hb_error, only: annotate, error_t
   use hb_kinds, only: two_pi, wp
   use hb_properties, only: limits_t, properties_t
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
      integer :: subharmonic

      call document%required_group("tones", group, error)
      if (allocated(error)) return
      if (group%given("hertz")) then
         if (group%given("frequency")) then
            call group%problem("hertz", "give either 'frequency' [rad/s] or 'hertz', not both")
            call group%get("frequency", omega, unit="rad/s", limits=limits_t(above=0.0_wp))
         end if
         if (group%given("unknown")) then
            call group%get("hertz", omega, unit="Hz", limits=limits_t(minimum=0.0_wp))
         else
            call group%get("hertz", omega, unit="Hz", limits=limits_t(above=0.0_wp))
         end if
         if (allocated(omega)) omega = two_pi*omega
      else if (.not. group%given("unknown")) then
         call group%get("frequency", omega, required=.true., unit="rad/s", limits=limits_t(above=0.0_wp))
      else if (group%given("frequency")) then
         call group%get("frequency", omega, unit="rad/s", limits=limits_t(minimum=0.0_wp))
      else
         call group%get("unknown", is_unknown)
         if (allocated(is_unknown)) then
            omega = spread(0.0_wp, 1, size(is_unknown))
            if (all(is_unknown)) then
               call group%get("frequency", omega, unit="rad/s")
            else
               call group%get("frequency", omega, required=.true., unit="rad/s")
            end if
         end if
      end if
      if (allocated(omega)) then
         is_unknown = spread(.false., 1, size(omega))
         call group%get("unknown", is_unknown)
         if (size(is_unknown) /= size(omega)) then
            call group%problem("unknown", "give one value for each of the "//to_text(size(omega))//" tones")
         else if (any(omega <= 0.0_wp .and. .not. is_unknown)) then
            call group%problem(trim(merge("hertz    ", "frequency", group%given("hertz"))), &
                               "must be greater than 0; only for an unknown tone 0 says that there is no first guess")
         end if
      end if
      subharmonic = 1
      call group%get("subharmonic", subharmonic, limits=limits_t(minimum=1, maximum=1000))
      if (allocated(omega)) omega = omega/subharmonic
      call group%finish(error)
      if (allocated(error)) return
      call new_tones(self, omega, error, is_unknown)
      self%subharmonic = subharmonic
      if (allocated(error)) call annotate(error, group%place())
   end subroutine read_tones
end module hb_scene_tones
