!> Reads `&bearing`: stiffness and damping of two directions, tabulated over the speed of a shaft.
module hb_bearing
   use hb_error, only: error_t
   use hb_interpolation, only: is_ascending, monotone_cubic_t, new_monotone_cubic
   use hb_kinds, only: wp
   use hb_properties, only: properties_t
   use hb_sparse, only: sparse_from_entries, sparse_sum
   use hb_structure, only: structure_t
   use hb_text, only: string_t, to_text
   implicit none
   private
   public :: read_bearing

   integer, parameter :: row(4) = [1, 1, 2, 2], column(4) = [1, 2, 1, 2]   ! of the columns of a table: xx, xy, yx, yy

contains

   !> Adds the bearing of a group, at its speed, to the structure; errors are reported as problems of its keys.
   subroutine read_bearing(group, structure)
      type(properties_t), intent(inout) :: group                      !! &bearing
      type(structure_t), intent(inout) :: structure
      character(:), allocatable :: label
      integer :: dofs(2)
      real(wp) :: speed
      real(wp), allocatable :: damping(:, :), speeds(:), stiffness(:, :)

      dofs = 0
      speed = 0.0_wp
      if (group%given("label")) call group%get("label", label)        ! used by paths
      call find_dofs(group, structure, dofs)
      call group%get("speed", speed)
      call group%get("speeds", speeds)
      if (.not. allocated(speeds)) return
      call group%get("stiffness", stiffness, n=size(speeds), m=4)
      allocate (damping(size(speeds), 4), source=0.0_wp)
      call group%get("damping", damping, n=size(speeds), m=4)
      if (size(speeds) < 2 .or. .not. is_ascending(speeds)) then
         call group%problem("speeds", "two or more are needed, each greater than the one before")
      else if (speed < speeds(1) .or. speed > speeds(size(speeds))) then
         call group%problem("speed", to_text(speed)//" rad/s lies outside of the table, "//to_text(speeds(1))//" to "// &
                            to_text(speeds(size(speeds))))
      else if (allocated(stiffness) .and. all(dofs > 0)) then
         call add_at(structure, dofs, values_at(speeds, stiffness, speed), values_at(speeds, damping, speed))
      end if
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

   !> The four coefficients at a speed.
   function values_at(speeds, table, speed) result(values)
      real(wp), intent(in) :: speeds(:), table(:, :)
      real(wp), intent(in) :: speed
      real(wp) :: slope, values(4)
      type(monotone_cubic_t) :: curve
      integer :: k

      do k = 1, 4
         call new_monotone_cubic(curve, speeds, table(:, k), is_constant_beyond=.true.)
         call curve%at(speed, values(k), slope)
      end do
   end function values_at

   subroutine add_at(structure, dofs, stiffness, damping)
      type(structure_t), intent(inout) :: structure
      integer, intent(in) :: dofs(2)
      real(wp), intent(in) :: stiffness(4), damping(4)
      integer :: k

      if (allocated(structure%sparse)) then
         associate (s => structure%sparse, n => structure%n_dofs)
            s%stiffness = sparse_sum(1.0_wp, s%stiffness, 1.0_wp, sparse_from_entries(n, dofs(row), dofs(column), stiffness))
            s%damping = sparse_sum(1.0_wp, s%damping, 1.0_wp, sparse_from_entries(n, dofs(row), dofs(column), damping))
         end associate
         return
      end if
      do k = 1, 4
         associate (i => dofs(row(k)), j => dofs(column(k)))
            structure%stiffness(i, j) = structure%stiffness(i, j) + stiffness(k)
            structure%damping(i, j) = structure%damping(i, j) + damping(k)
         end associate
      end do
   end subroutine add_at
end module hb_bearing
