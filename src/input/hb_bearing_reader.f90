!> Reads `&bearing`.
module hb_bearing_reader
   use hb_bearing, only: bearing_t
   use hb_error, only: error_t
   use hb_interpolation, only: is_ascending
   use hb_number_reader, only: read_numbers
   use hb_parameter_path, only: check_label
   use hb_properties, only: properties_t
   use hb_structure, only: structure_t
   use hb_text, only: string_t, to_text
   implicit none
   private
   public :: read_bearing

contains

   !> Reads a bearing; errors are reported as problems of its keys.
   subroutine read_bearing(self, group, structure)
      type(bearing_t), intent(out) :: self
      type(properties_t), intent(inout) :: group                      !! &bearing
      type(structure_t), intent(in) :: structure
      character(:), allocatable :: label

      if (group%given("label")) call group%get("label", label)        ! used by paths
      call check_label(group, label)
      call find_dofs(group, structure, self%dofs)
      call read_numbers(self, group)
      if (.not. allocated(self%speeds)) return
      associate (speed => self%speed, speeds => self%speeds)
         if (size(speeds) < 2 .or. .not. is_ascending(speeds)) then
            call group%problem("speeds", "two or more are needed, each greater than the one before")
         else if (.not. self%has_valid_numbers()) then
            call group%problem("speed", to_text(speed)//" rad/s lies outside of the table, "//to_text(speeds(1))//" to "// &
                               to_text(speeds(size(speeds))))
         end if
      end associate
   end subroutine read_bearing

   !> Finds the two degrees of freedom; 0 on failure.
   subroutine find_dofs(group, structure, dofs)
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(in) :: structure
      integer, intent(inout) :: dofs(2)
      type(string_t), allocatable :: names(:)
      type(error_t), allocatable :: error
      integer :: i

      call group%get("dofs", names, n=2)
      if (.not. allocated(names)) return
      if (size(names) /= 2) return
      do i = 1, 2
         call structure%find_dof(names(i)%value, dofs(i), error)
         if (allocated(error)) call group%problem("dofs", error%message)
      end do
      if (dofs(1) == dofs(2) .and. dofs(1) > 0) then
         call group%problem("dofs", "degree of freedom '"//names(1)%value//"' is named twice")
         dofs = 0
      end if
   end subroutine find_dofs
end module hb_bearing_reader
