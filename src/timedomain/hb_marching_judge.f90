!> The judge of a run: marching.
module hb_marching_judge
   use hb_coexisting_motions, only: settle_from_starts
   use hb_error, only: error_t
   use hb_judge, only: judge_t, locking_t, settled_t
   use hb_kinds, only: wp
   use hb_locking, only: find_locking
   use hb_marched_start, only: marched_guess
   use hb_scene, only: scene_t
   use hb_watch, only: watch_t
   implicit none
   private
   public :: marching_judge_t

   type, extends(judge_t) :: marching_judge_t
   contains
      procedure :: settle => marching_judge_settle
      procedure :: first_guess => marching_judge_first_guess
      procedure :: find_locking => marching_judge_find_locking
   end type marching_judge_t

contains

   subroutine marching_judge_settle(self, scene, law_dofs, watch, settled, error)
      class(marching_judge_t), intent(in) :: self
      type(scene_t), intent(in) :: scene
      integer, intent(in) :: law_dofs(:)
      class(watch_t), intent(inout) :: watch
      type(settled_t), intent(out) :: settled
      type(error_t), allocatable, intent(out) :: error

      call settle_from_starts(scene, law_dofs, watch, settled, error)
   end subroutine marching_judge_settle

   subroutine marching_judge_first_guess(self, scene, omega, law_dofs, watch, guess, error)
      class(marching_judge_t), intent(in) :: self
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: omega(:)
      integer, intent(in) :: law_dofs(:)
      class(watch_t), intent(inout) :: watch
      real(wp), allocatable, intent(out) :: guess(:)
      type(error_t), allocatable, intent(out) :: error

      call marched_guess(scene, omega, law_dofs, watch, guess, error)
   end subroutine marching_judge_first_guess

   subroutine marching_judge_find_locking(self, locking, scene, omega, law_dofs, watch)
      class(marching_judge_t), intent(in) :: self
      type(locking_t), intent(out) :: locking
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: omega(:)
      integer, intent(in) :: law_dofs(:)
      class(watch_t), intent(inout) :: watch

      call find_locking(locking, scene, omega, law_dofs, watch)
   end subroutine marching_judge_find_locking
end module hb_marching_judge
