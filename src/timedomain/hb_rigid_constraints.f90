!> Constraints of rigid laws: walls that are not crossed, friction that sticks or slips at its limit.
!>
!> A method without a stiffness for them needs the constraint itself, for each coordinate.
module hb_rigid_constraints
   use hb_error, only: error_t, fail
   use hb_integration_laws, only: integration_laws_t
   use hb_kinds, only: wp
   use hb_law, only: hold_t
   implicit none
   private
   public :: collect_rigid, move_before_walls

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
         hold%coordinate = laws%spans(i)%first
         if (hold%restitution < 0.0_wp) hold%restitution = max(0.0_wp, restitution)
         rigid = [rigid, hold]
      end do
   end subroutine collect_rigid

   !> Moves coordinates behind a wall onto it, along the shortest path in the metric of the mass; again if that moves others
   !> behind theirs.
   pure subroutine move_before_walls(rigid, shape, accelerance, q)
      type(hold_t), intent(in) :: rigid(:)
      real(wp), intent(in) :: shape(:, :)                             !! of the coordinates of all laws, (n_dofs, any)
      real(wp), intent(in) :: accelerance(:, :)                       !! mass^-1 shape of the rigid ones, (n_dofs, n_rigid)
      real(wp), intent(inout) :: q(:)                                 !! [m], (n_dofs)
      real(wp), parameter :: pass_tolerance = 16.0_wp*epsilon(1.0_wp) ! of a further pass
      integer, parameter :: max_passes = 10000
      real(wp) :: behind, z
      integer :: i, pass
      logical :: is_done

      do pass = 1, max_passes
         is_done = .true.
         do i = 1, size(rigid)
            if (.not. rigid(i)%is_wall) cycle
            z = dot_product(shape(:, rigid(i)%coordinate), q)
            behind = max(z - rigid(i)%gap, 0.0_wp)
            if (rigid(i)%two_sided) behind = behind + min(z + rigid(i)%gap, 0.0_wp)
            if (pass > 1 .and. abs(behind) <= pass_tolerance*(abs(rigid(i)%gap) + sum(abs(shape(:, rigid(i)%coordinate)*q)))) cycle
            if (abs(behind) > 0.0_wp) is_done = .false.
            q = q - accelerance(:, i)*(behind/dot_product(shape(:, rigid(i)%coordinate), accelerance(:, i)))
         end do
         if (is_done) exit
      end do
   end subroutine move_before_walls
end module hb_rigid_constraints
