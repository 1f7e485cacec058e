!> Constraints of rigid laws: walls that are not crossed, friction that sticks or slips at its limit.
!>
!> A method without a stiffness for them needs the constraint itself, for each coordinate.
module hb_rigid_laws
   use hb_error, only: error_t, fail
   use hb_integration_laws, only: integration_laws_t
   use hb_kinds, only: wp
   use hb_law, only: hold_t
   implicit none
   private
   public :: collect_rigid, put_before_walls

contains

   !> Collects the constraints of the rigid laws, in their order; fails if one has none.
   subroutine collect_rigid(laws, restitution, rigid, error)
      type(integration_laws_t), intent(in) :: laws
      real(wp), intent(in) :: restitution                             !! of walls without a value of their own; < 0: 0
      type(hold_t), allocatable, intent(out) :: rigid(:)
      type(error_t), allocatable, intent(out) :: error
      type(hold_t) :: hold
      integer :: i

      allocate (rigid(0))
      do i = 1, size(laws%laws)
         if (.not. laws%laws(i)%law%is_multiplier) cycle
         hold = laws%laws(i)%law%hold()
         if (allocated(hold%failure)) then
            call fail(error, hold%failure)
            return
         end if
         hold%coordinate = laws%places(i)%first
         if (hold%restitution < 0.0_wp) hold%restitution = max(0.0_wp, restitution)
         rigid = [rigid, hold]
      end do
   end subroutine collect_rigid

   !> Moves coordinates behind a wall onto it, along the shortest path in the metric of the mass.
   pure subroutine put_before_walls(rigid, shape, kick, q)
      type(hold_t), intent(in) :: rigid(:)
      real(wp), intent(in) :: shape(:, :)                             !! of the coordinates of all laws, (n_dofs, any)
      real(wp), intent(in) :: kick(:, :)                              !! mass^-1 shape of the rigid ones, (n_dofs, n_rigid)
      real(wp), intent(inout) :: q(:)                                 !! [m], (n_dofs)
      real(wp) :: behind, z
      integer :: i

      do i = 1, size(rigid)
         if (.not. rigid(i)%is_wall) cycle
         z = dot_product(shape(:, rigid(i)%coordinate), q)
         behind = max(z - rigid(i)%gap, 0.0_wp)
         if (rigid(i)%two_sided) behind = behind + min(z + rigid(i)%gap, 0.0_wp)
         q = q - kick(:, i)*(behind/dot_product(shape(:, rigid(i)%coordinate), kick(:, i)))
      end do
   end subroutine put_before_walls
end module hb_rigid_laws
