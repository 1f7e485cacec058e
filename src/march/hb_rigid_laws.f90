!> What rigid laws demand of a motion: walls that are not crossed, friction that holds or slips at its limit.
!>
!> A method without a stiffness for them needs the constraint itself, coordinate by coordinate.
module hb_rigid_laws
   use hb_kinds, only: wp
   use hb_law_coulomb_rigid, only: coulomb_rigid_t
   use hb_law_rigid_wall, only: rigid_wall_t
   use hb_march_laws, only: march_laws_t
   implicit none
   private
   public :: collect_rigid, put_before_walls, rigid_t

   type :: rigid_t
      integer :: coordinate = 0                                       !! of all laws
      logical :: is_wall = .false.                                    !! else friction
      real(wp) :: gap = 0.0_wp                                        !! of the wall [m]
      logical :: two_sided = .false.
      real(wp) :: limit = 0.0_wp                                      !! of friction [N]
   end type rigid_t

contains

   !> The rigid ones among the laws, in their order.
   subroutine collect_rigid(laws, rigid)
      type(march_laws_t), intent(in) :: laws
      type(rigid_t), allocatable, intent(out) :: rigid(:)
      integer :: i

      allocate (rigid(0))
      do i = 1, size(laws%laws)
         select type (law => laws%laws(i)%law)
         type is (rigid_wall_t)
            rigid = [rigid, rigid_t(coordinate=laws%places(i)%first, is_wall=.true., gap=law%gap, two_sided=law%two_sided)]
         type is (coulomb_rigid_t)
            rigid = [rigid, rigid_t(coordinate=laws%places(i)%first, limit=law%limit)]
         end select
      end do
   end subroutine collect_rigid

   !> Moves what is behind a wall onto it, by the shortest way in the metric of the mass.
   pure subroutine put_before_walls(rigid, shape, kick, q)
      type(rigid_t), intent(in) :: rigid(:)
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
