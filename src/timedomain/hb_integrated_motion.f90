!> The last resort: time integration of the model until its motion is steady (hb_steady_windows), by the methods that the system
!> permits, in steps that are halved until they no longer change the motion.
module hb_integrated_motion
   use hb_discretisation, only: discretisation_t
   use hb_error, only: error_t
   use hb_integrable_system, only: fastest_of, has_bounds_of, lacks_mass
   use hb_integration_config, only: integration_method
   use hb_integration_system, only: integration_state_t
   use hb_kinds, only: two_pi, wp
   use hb_options, only: options_t
   use hb_outcome, only: outcome
   use hb_primary_method, only: evaluation_work
   use hb_record_share, only: distance_of
   use hb_steady_motion, only: steady_motion_t
   use hb_steady_windows, only: allowed_of, integrate_to_steady, periods_of_first, sample_step
   use hb_system, only: system_t
   use hb_text, only: rounded
   implicit none
   private
   public :: find_steady_motion

   integer, parameter :: more_steps = 5                               ! of an implicit method, relative to the number of samples
   integer, parameter :: coarse_steps = 3                             ! likewise at first, for a given set
   integer, parameter :: max_halvings = 3                            ! of fixed steps
   real(wp), parameter :: largest_change = 0.1_wp ! by the last of them: the motion is known, though inaccurately
   real(wp), parameter :: steps_of_mode = 1.0_wp                      ! of central differences per radian of the fastest mode
   real(wp), parameter :: work_of_mode = 4.0_wp                       ! right-hand sides of cvode, likewise

contains

   !> Integrates from the given state, otherwise from the given amplitudes, otherwise from rest, slightly perturbed
   !> so that no symmetry preserves an unstable motion. If `cvode` uses up all of its work on the fastest motions of
   !> the structure, which hard stops excite, or would do so on candidates, a method with fixed steps has the same
   !> budget again.
   subroutine find_steady_motion(system, discretisation, options, law_dofs, steady, error, start)
      type(system_t), intent(in) :: system                            !! all tones given
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      integer, intent(in) :: law_dofs(:)
      type(steady_motion_t), intent(out) :: steady
      type(error_t), allocatable, intent(out) :: error
      type(integration_state_t), intent(in), optional :: start
      type(error_t), allocatable :: failure
      type(integration_state_t) :: last
      type(steady_motion_t) :: again
      integer :: i
      logical :: by_cvode_alone, is_fast

      by_cvode_alone = options%integration%aim <= 0.0_wp .and. any([(system%laws(i)%law%is_multiplier, i=1, size(system%laws))])
      is_fast = options%integration%method == integration_method%cvode .and. .not. by_cvode_alone
      if (is_fast) is_fast = .not. has_bounds_of(system) .or. lacks_mass(system) .or. &
         work_of_mode*fastest_of(system)*periods_of_first(system, discretisation, options)* &
                             two_pi/minval(system%tones%omega)*evaluation_work(system%structure%n_dofs, size(law_dofs), .false.) > &
                             options%integration%max_work
      if (.not. is_fast) then
         call integrate_to_steady(system, discretisation, options, law_dofs, steady, last, error, start)
         if (options%integration%method /= integration_method%cvode) return
         if (.not. steady%is_out_of_work .or. steady%status /= outcome%pending) return
         if (by_cvode_alone) return
      end if
      call follow_in_steps(system, discretisation, options, law_dofs, 2.0_wp*options%integration%max_work - steady%work, again, &
                           failure, start)
      again%work = again%work + steady%work
      steady%work = again%work
      if (.not. is_fast .and. (allocated(failure) .or. again%status == outcome%pending)) return
      if (allocated(error)) deallocate (error)
      if (allocated(failure)) call move_alloc(failure, error)
      steady = again
   end subroutine find_steady_motion

   !> Integrates by a method with fixed steps, and with steps half as long from the end of the previous integration;
   !> with a tolerance until the motion no longer changes by more than permitted. The result is that of the shortest
   !> steps; the last change counts as its error. Steps may make a ripple at coordinates without mass, which repeats after
   !> some periods: a small part of the motion that does so counts if it exceeds its change by the steps.
   subroutine follow_in_steps(system, discretisation, options, law_dofs, budget, steady, error, start)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      integer, intent(in) :: law_dofs(:)
      real(wp), intent(in) :: budget                                  !! of work
      type(steady_motion_t), intent(out) :: steady
      type(error_t), allocatable, intent(out) :: error
      type(integration_state_t), intent(in), optional :: start
      type(integration_state_t) :: last, now
      type(options_t) :: stepped
      type(steady_motion_t) :: coarse
      real(wp) :: change
      integer :: i
      logical :: is_aimed

      is_aimed = options%integration%aim > 0.0_wp
      stepped = options
      if (any([(system%laws(i)%law%is_multiplier, i=1, size(system%laws))])) then
         stepped%integration%method = integration_method%central_differences
         stepped%integration%substeps = ceiling(steps_of_mode*fastest_of(system)*sample_step(system, discretisation, options))
      else
         stepped%integration%method = integration_method%generalized_alpha
         stepped%integration%spectral_radius = 0.0_wp
         stepped%integration%substeps = merge(more_steps, coarse_steps, is_aimed)
      end if
      call integrate_to_steady(system, discretisation, stepped, law_dofs, steady, last, error, start)
      do i = 1, max_halvings
         if (allocated(error)) exit
         if (steady%status == outcome%subharmonic) then
            if (part_of(steady, is_aimed) >= largest_change) return
         else if (is_aimed .and. steady%status /= outcome%integrated) then
            exit
         end if
         coarse = steady
         stepped%integration%substeps = 2*stepped%integration%substeps
         stepped%integration%max_work = max(0.0_wp, budget - coarse%work)
         now = last
         call integrate_to_steady(system, discretisation, stepped, law_dofs, steady, last, error, now)
         steady%work = steady%work + coarse%work
         if (allocated(error)) exit
         steady%message = steady%message//merge("; implicit steps", "; fixed steps   ", &
                                                stepped%integration%method == integration_method%generalized_alpha)
         if (steady%status == outcome%subharmonic .and. coarse%n_repeat == steady%n_repeat) then
            change = abs(part_of(steady, is_aimed) - part_of(coarse, is_aimed))
            if (part_of(steady, is_aimed) > change) return
         end if
         if (.not. any(steady%status == [outcome%integrated, outcome%subharmonic])) exit
         if (any([coarse%status, steady%status] /= outcome%integrated)) cycle
         change = maxval(distance_of(steady%averages, coarse%averages, 0.1_wp*allowed_of(options)))
         steady%spread = hypot(steady%spread, change)
         steady%message = trim(steady%message)//", half as long ones change it by "//rounded(change)
         if (merge(change, steady%spread, is_aimed) <= allowed_of(options)) return
         steady%change_by_steps = change
      end do
      if (steady%status == outcome%subharmonic .or. &
          (steady%status == outcome%integrated .and. .not. (is_aimed .and. steady%change_by_steps <= largest_change))) &
         steady%status = outcome%pending
   end subroutine follow_in_steps

   !> Part of a motion beyond its tones, relative.
   pure real(wp) function part_of(steady, is_aimed) result(part)
      type(steady_motion_t), intent(in) :: steady
      logical, intent(in) :: is_aimed                                 !! lines were fitted to it

      part = merge(steady%spread, steady%left_out, is_aimed)
   end function part_of
end module hb_integrated_motion
