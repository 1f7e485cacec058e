!> The motions in which a scene ends from several starts: told apart, counted, named by their amplitudes.
module hb_coexisting_motions
   use hb_advice, only: rounded
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_march_starts, only: motions_of, state_on_sphere
   use hb_march_state, only: march_state_t
   use hb_march_system, only: march_system_t, new_march_system
   use hb_marched_motion, only: settle
   use hb_outcome, only: outcome, outcome_name
   use hb_scene, only: scene_t
   use hb_text, only: to_text
   use hb_time_domain, only: settled_t
   use hb_watch, only: work_is_over
   implicit none
   private
   public :: settle_from_starts, tell_motions

contains

   !> Marches from as many starts as the scene asks for, the first one as `settle` has it. What comes out is the first motion of the
   !> tones; where there are others beside it, the status is `several`, with as many as there are.
   subroutine settle_from_starts(scene, law_dofs, settled, error)
      type(scene_t), intent(in) :: scene                              !! all of its tones given
      integer, intent(in) :: law_dofs(:)
      type(settled_t), intent(out) :: settled
      type(error_t), allocatable, intent(out) :: error
      type(march_state_t) :: start
      type(march_system_t) :: system
      type(settled_t) :: each(scene%march%starts)
      complex(wp), allocatable :: c(:, :, :)
      integer :: i, motion(scene%march%starts)
      real(wp) :: size_of_motion

      call settle(scene, law_dofs, settled, error)
      if (scene%march%starts == 1 .or. .not. allocated(settled%averages)) return
      if (allocated(error)) return
      each(1) = settled
      associate (omega => scene%tones%omega, frequencies => scene%harmonics%frequencies(scene%tones%omega))
         call new_march_system(system, scene%structure, scene%laws, scene%loads%whole(), frequencies, omega)
         size_of_motion = maxval(sum(abs(settled%averages), 1))
         if (size_of_motion <= 0.0_wp) size_of_motion = max(system%length, tiny(1.0_wp))
         do i = 2, size(each)
            call state_on_sphere(system, omega, size_of_motion, i - 1, start)
            call settle(scene, law_dofs, each(i), error, start)
            settled%work = settled%work + each(i)%work
            if (work_is_over()) return
            if (allocated(error)) each(i)%status = outcome%pending    ! it runs away from there
         end do
      end associate
      if (allocated(error)) deallocate (error)
      allocate (c(size(settled%averages, 1), size(settled%averages, 2), size(each)), source=(0.0_wp, 0.0_wp))
      do i = 1, size(each)
         if (each(i)%status == outcome%pending) cycle
         c(:, :, i) = each(i)%averages
         each(i)%spread = min(1.0_wp, each(i)%spread)
         if (each(i)%status == outcome%broadband) each(i)%spread = 1.0_wp
      end do
      motion = motions_of(c, each%status, each%spread)
      i = findloc(each%status, outcome%marched, dim=1)
      if (i == 0) i = max(1, findloc(motion, 1, dim=1))
      each(i)%work = settled%work
      settled = each(i)
      settled%n_motions = maxval(motion)
      if (settled%n_motions == 0) return
      if (settled%n_motions > 1 .and. settled%status == outcome%marched) settled%status = outcome%several
      call tell_motions(motion, each%status, each%amplitude, settled%message)
   end subroutine settle_from_starts

   !> Says which motions there are: their amplitudes, and from how many starts each is reached.
   pure subroutine tell_motions(motion, status, amplitude, message)
      integer, intent(in) :: motion(:)                                !! in which each start ends; 0: in none that is known
      integer, intent(in) :: status(:)                                !! of each start, one of `outcome`
      real(wp), intent(in) :: amplitude(:)                            !! of each start [m]
      character(:), allocatable, intent(out) :: message
      integer, parameter :: most_named = 8                            ! a message has an end
      integer :: first, k

      message = "marched from "//to_text(size(motion))//" starts: "//to_text(maxval(motion))//" motion"
      if (maxval(motion) /= 1) message = message//"s"
      do k = 1, min(maxval(motion), most_named)
         first = findloc(motion, k, dim=1)
         message = message//merge(": ", ", ", k == 1)//"amplitude "//rounded(amplitude(first))//" from "// &
                   to_text(count(motion == k))
         if (status(first) /= outcome%marched) message = message//" ("//outcome_name(status(first))//")"
      end do
      if (maxval(motion) > most_named) message = message//", ..."
      if (any(motion == 0)) message = message//"; not settled from "//to_text(count(motion == 0))
   end subroutine tell_motions
end module hb_coexisting_motions
