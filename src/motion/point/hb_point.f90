!> The motion of a point: on its given set or to its tolerance, and with the values that follow unknown frequencies.
!>
!> A tie makes a value p follow the frequency of an unknown tone. At a fixed p the model has a frequency omega(p); the
!> tie holds where omega(p) agrees with the frequency of which p was computed. Broyden's method solves this equation for
!> one or several tones; each of its steps starts from the last motion. Along curves, ties are part of the equations
!> (hb_model_problem). Source: C. T. Kelley, Iterative Methods for Linear and Nonlinear Equations, SIAM 1995, chapter 7.
module hb_point
   use hb_accurate_motion, only: solve_to_tolerance
   use hb_cached_parts, only: cached_balances_t
   use hb_cancellation, only: cancellation_t, work_is_over
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_level, only: level_t
   use hb_model, only: model_t
   use hb_motion, only: solve_motion
   use hb_motion_in_basis, only: status_of_ended
   use hb_motion_result, only: effort_t, motion_result_t
   use hb_movement, only: follow_frequencies, tied_tones
   use hb_outcome, only: outcome
   use hb_thresholds, only: location_tolerance, nearby_steps, well_solved
   implicit none
   private
   public :: solve_point

   real(wp), parameter :: max_frequency_drop = 0.5_wp                 ! of a frequency in a step, relative

contains

   !> Solves a model. An `error` is a failure of this point alone.
   subroutine solve_point(model, result, error, level, below, guess, cached)
      type(model_t), intent(inout) :: model                           !! on return with the values that follow its motion
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      type(level_t), intent(out) :: level                             !! of the motion; without unknowns if none is found
      type(level_t), intent(in), optional :: below                    !! start with a tolerance
      real(wp), intent(in), optional :: guess(:)                      !! start on a given set, as that of hb_motion
      type(cached_balances_t), intent(inout), optional, target :: cached
      type(cancellation_t), target :: all_steps
      integer, allocatable :: tones(:)

      allocate (tones, source=tied_tones(model%system))
      associate (options => model%options)                            ! the limits of a point hold for all steps together
         if (size(tones) > 0) call all_steps%enter(options%solver%time_limit, &
                                                   merge(options%max_work(), huge(1.0_wp), options%accuracy%is_on))
      end associate
      call solve_once(model, result, error, level, below, guess, cached)
      if (size(tones) == 0) return
      if (.not. allocated(error) .and. allocated(level%unknowns)) call satisfy_ties(model, tones, result, error, level)
      call all_steps%leave()
   end subroutine solve_point

   !> Repeats the solution of a model until the values that follow its frequencies agree with them.
   subroutine satisfy_ties(model, tones, result, error, level)
      type(model_t), intent(inout) :: model
      integer, intent(in) :: tones(:)                                 !! that have followers
      type(motion_result_t), intent(inout) :: result                  !! at the present values, with a motion
      type(error_t), allocatable, intent(out) :: error
      type(level_t), intent(inout) :: level
      type(effort_t) :: effort
      type(level_t) :: before
      real(wp), dimension(size(tones)) :: change, defect, step
      real(wp) :: omega(size(model%system%tones%omega)), slope(size(tones), size(tones))
      integer :: i

      model%is_read = .false.                                         ! its values are no longer those of the input
      omega = model%system%tones%omega
      slope = 0.0_wp
      do i = 1, size(tones)
         slope(i, i) = 1.0_wp
      end do
      do i = 1, nearby_steps
         associate (found => result%frequency(tones), accuracy => model%options%accuracy)
            if (i > 1) then
               change = found - omega(tones) - defect
               slope = slope - spread(step + matmul(slope, change), 2, size(tones))*spread(change, 1, size(tones))/ &
                       max(sum(change**2), tiny(1.0_wp))
            end if
            defect = found - omega(tones)
            if (all(abs(defect) <= merge(well_solved*accuracy%tolerance, location_tolerance, accuracy%is_on)*found)) return
         end associate
         if (i == nearby_steps .or. work_is_over()) exit
         step = matmul(slope, defect)
         do while (any(step < -max_frequency_drop*omega(tones)) .and. all(omega(tones) > 0.0_wp))
            step = 0.5_wp*step
         end do
         omega(tones) = omega(tones) + step
         call follow_frequencies(model, omega, error)
         if (allocated(error)) return
         effort = result%effort_t
         before = level
         call solve_once(model, result, error, level, before, before%unknowns)
         call result%add(effort)
         if (allocated(error) .or. .not. allocated(level%unknowns)) return
      end do
      call result%forget_motion()
      deallocate (level%unknowns)
      result%status = outcome%stalled
      if (work_is_over()) result%status = status_of_ended()
      if (.not. work_is_over()) &
         result%message = "no motion was found whose frequency agrees with the values that are tied to it"
   end subroutine satisfy_ties

   !> Solves a model at its present values.
   subroutine solve_once(model, result, error, level, below, guess, cached)
      type(model_t), intent(in) :: model
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      type(level_t), intent(out) :: level
      type(level_t), intent(in), optional :: below
      real(wp), intent(in), optional :: guess(:)
      type(cached_balances_t), intent(inout), optional, target :: cached
      real(wp), allocatable :: unknowns(:)

      if (model%options%accuracy%is_on) then
         call solve_to_tolerance(model, result, error, level, below)
      else
         call solve_motion(model, result, error, guess, unknowns, cached)
         level%discretisation_t = model%discretisation
         if (allocated(unknowns)) call move_alloc(unknowns, level%unknowns)
      end if
   end subroutine solve_once
end module hb_point
