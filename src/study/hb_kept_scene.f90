!> The scene of the point before, in which a next point that differs by numbers alone reads only what they change.
!>
!> Where all values that differ between two points stand in groups that are read one by one (hb_scene_reader: `read_again`), neither
!> the structure nor the settings are read and checked anew. Whatever is unusual there, a mistake in the input included, ends in a
!> complete reading, which has the last word.
module hb_kept_scene
   use hb_error, only: error_t
   use hb_namelist, only: document_t
   use hb_scene, only: scene_t
   use hb_scene_reader, only: groups_read_again, read_again, read_scene
   use hb_sweep_plan, only: sweep_plan_t
   use hb_kinds, only: wp
   implicit none
   private
   public :: kept_scene_t

   type :: kept_scene_t
      type(scene_t) :: scene                                          !! of the point read last
      integer, private :: point = 0                                   !! its number; 0: there is none
   contains
      procedure :: read => kept_scene_read
   end type kept_scene_t

contains

   !> Makes `scene` that of a point; `is_new` tells whether more than numbers may have changed.
   subroutine kept_scene_read(self, input, plan, point, available_memory, is_new, error)
      class(kept_scene_t), intent(inout) :: self
      type(document_t), intent(in) :: input                           !! before values of the sweep are set
      type(sweep_plan_t), intent(in) :: plan
      integer, intent(in) :: point                                    !! 1 to n_points
      real(wp), intent(in) :: available_memory                        !! bytes
      logical, intent(out) :: is_new
      type(error_t), allocatable, intent(out) :: error
      type(document_t), target :: document
      logical :: is_read

      is_new = .true.
      if (self%point > 0) then
         if (plan%differ_within(groups_read_again, self%point, point)) then
            call read_changes(self%scene, input, plan, self%point, point, is_read)
            is_new = .not. is_read
         end if
      end if
      if (is_new) then
         self%point = 0
         document = input
         call plan%apply(point, document, error)
         if (.not. allocated(error)) call read_scene(self%scene, document, error, available_memory)
         if (allocated(error)) return
      end if
      self%point = point
   end subroutine kept_scene_read

   !> Reads what differs from the point before; `is_read` is false, and the scene of no use, where that is not enough.
   subroutine read_changes(scene, input, plan, before, point, is_read)
      type(scene_t), intent(inout) :: scene
      type(document_t), intent(in) :: input
      type(sweep_plan_t), intent(in) :: plan
      integer, intent(in) :: before, point
      logical, intent(out) :: is_read
      type(document_t), target :: document
      type(error_t), allocatable :: error
      logical :: is_changed(size(groups_read_again))
      integer :: i

      is_changed = [(.not. plan%agree_in(groups_read_again(i), before, point), i=1, size(is_changed))]
      if (scene%has_inertia_loads .and. any(groups_read_again == "tones" .and. is_changed)) then
         is_changed = is_changed .or. groups_read_again == "load"
      end if
      associate (groups => pack(groups_read_again, is_changed))
         call input%take_groups(groups, document)
         call plan%apply(point, document, error, groups)
      end associate
      is_read = .false.
      if (.not. allocated(error)) call read_again(scene, document, is_read)
   end subroutine read_changes
end module hb_kept_scene
