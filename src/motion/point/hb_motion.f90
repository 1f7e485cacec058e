!> Computes the motion of a model on its set, with all derived results, by the attempts of `hb_attempts`.
module hb_motion
   use hb_attempts, only: attempt_row, attempt_rule_t, attempts_t, make_attempts, motion_conditions_t, stage, technique
   use hb_cached_parts, only: cached_balances_t
   use hb_cancellation, only: cancellation_t, work_is_over
   use hb_coordinates, only: coordinates_t
   use hb_discretisation, only: discretisation_t
   use hb_error, only: error_t
   use hb_integrated_result, only: guess_from, note_unsteady, store_integrated
   use hb_kinds, only: wp
   use hb_model, only: model_t
   use hb_model_basis, only: find_basis
   use hb_motion_in_basis, only: solve_in_basis, status_of_ended
   use hb_motion_result, only: motion_result_t
   use hb_options, only: options_t
   use hb_outcome, only: is_solved, outcome, reason
   use hb_primary_method, only: primary_method
   use hb_solver_types, only: attempt_t
   use hb_spectrum, only: as_spectrum, spectrum_t
   use hb_stability, only: stability_method
   use hb_steady_motion, only: steady_motion_t
   use hb_structure, only: max_dense
   use hb_system, only: coordinates_of, system_t
   use hb_threads, only: use_threads
   use hb_thresholds, only: nearby_steps, rounding_level
   implicit none
   private
   public :: solve_motion, solve_system, start_from

   !> The attempts to find the motion of a model on its set.
   type, extends(attempts_t) :: motion_attempts_t
      type(system_t), pointer :: system => null()
      type(discretisation_t), pointer :: discretisation => null()
      type(options_t), pointer :: options => null()
      type(motion_result_t), pointer :: result => null()
      type(cached_balances_t), pointer :: parts => null()
      type(discretisation_t) :: basis                                          ! of the first balance
      type(motion_conditions_t) :: conditions
      real(wp), allocatable :: first_guess(:)                         ! as that of `solve_system`; not allocated: that of the model
      real(wp), allocatable :: unknowns(:)                            ! of the solution, likewise
      type(coordinates_t) :: coordinates                              ! of time integration
      type(steady_motion_t) :: steady                                 ! what it has found
      type(error_t), allocatable :: error
   contains
      procedure :: applies => motion_attempts_applies
      procedure :: make => motion_attempts_make
      procedure :: is_over => motion_attempts_is_over
   end type motion_attempts_t

contains

   !> Solves a model, see `solve_system`.
   subroutine solve_motion(model, result, error, guess, unknowns, cached)
      type(model_t), intent(in) :: model
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: guess(:)                      !! as that of `solve_system`
      real(wp), allocatable, intent(out), optional :: unknowns(:)     !! likewise
      type(cached_balances_t), intent(inout), optional, target :: cached

      call solve_system(model%system, model%discretisation, model%options, result, error, guess, unknowns, cached)
   end subroutine solve_motion

   !> Solves a system in a discretisation. An `error` is a failure of this point alone, such as a singular interior; a solver
   !> that does not converge is reported by the status of the result.
   subroutine solve_system(system, discretisation, options, result, error, guess, unknowns, cached)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: guess(:)                      !! replaces that of the model: coefficients at the
                                                                      !! coordinates of the laws, then all base frequencies
      real(wp), allocatable, intent(out), optional :: unknowns(:) !! of a converged solution, ordered as `guess`; none without laws
      type(cached_balances_t), intent(inout), optional, target :: cached !! of the previous motion, reused if possible
      type(cancellation_t), target :: cancellation
      real(wp), allocatable :: found(:)

      call cancellation%enter(options%solver%time_limit)
      call use_threads(options%solver%n_threads)
      if (present(guess)) found = guess
      call solve_with_cancellation(system, discretisation, options, result, error, found, cached)
      call cancellation%leave()
      call result%withdraw_verdict()
      if (allocated(error)) then
         call result%forget_motion()
      else if (present(unknowns)) then
         call move_alloc(found, unknowns)
      end if
   end subroutine solve_system

   !> Solves the model under a cancellation that has been entered, by the attempts of `hb_attempts`.
   subroutine solve_with_cancellation(system, discretisation, options, result, error, unknowns, cached)
      type(system_t), intent(in), target :: system
      type(discretisation_t), intent(in), target :: discretisation
      type(options_t), intent(in), target :: options
      type(motion_result_t), intent(out), target :: result
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable, intent(inout) :: unknowns(:)             !! on entry a first guess as that of `solve_system`, if
                                                                      !! allocated; on return the solution
      type(cached_balances_t), intent(inout), optional, target :: cached
      type(motion_attempts_t) :: attempts

      attempts%system => system
      attempts%discretisation => discretisation
      attempts%options => options
      attempts%result => result
      if (present(cached) .and. .not. any(system%tones%is_unknown)) attempts%parts => cached ! no slopes, no drives
      call move_alloc(unknowns, attempts%first_guess)
      call find_basis(attempts%basis, attempts%conditions%has_odd_set, system, discretisation, options, error, attempts%first_guess)
      if (allocated(error)) return
      associate (c => attempts%conditions)
         c%may_integrate = options%has_time_domain() .and. .not. (any(system%tones%is_unknown) .or. system%normal_mode%is_requested)
         c%integrates_first = options%primary_method == primary_method%integration .and. .not. allocated(attempts%first_guess)
         c%integrates_last = options%solver%fallback .and. options%solver%fallback_by_integration
      end associate
      call make_attempts(attempts, stage%motion)
      if (allocated(attempts%error)) call move_alloc(attempts%error, error)
      if (allocated(attempts%unknowns)) call move_alloc(attempts%unknowns, unknowns)
      call move_alloc(attempts%made, result%attempts)
   end subroutine solve_with_cancellation

   !> Whether an attempt can be made, by the conditions of `hb_attempts`; time integration also needs coordinates of laws.
   logical function motion_attempts_applies(self, rule) result(applies)
      class(motion_attempts_t), intent(inout) :: self
      type(attempt_rule_t), intent(in) :: rule

      self%conditions%status = self%result%status
      self%conditions%is_struck = self%options%lacks_impacts_of(self%system, self%result%status)
      applies = self%conditions%permit(rule)
      if (.not. applies .or. rule%technique /= technique%integration) return
      self%coordinates = coordinates_of(self%system)
      applies = self%coordinates%n > 0
   end function motion_attempts_applies

   !> Makes one attempt.
   subroutine motion_attempts_make(self, rule, attempt, within)
      class(motion_attempts_t), intent(inout) :: self
      type(attempt_rule_t), intent(in) :: rule
      type(attempt_t), intent(inout) :: attempt
      type(attempt_t), allocatable, intent(out) :: within(:)

      select case (rule%row)
      case (attempt_row%integration_first)
         call integrate_first(self, attempt)
      case (attempt_row%integration)
         call integrate_last(self, attempt)
      case (attempt_row%from_integration)
         call solve_from_integration(self, rule%kind, attempt)
      case (attempt_row%odd_set)
         call solve_on(self, self%basis, attempt, within)
         self%result%is_odd = is_proven_odd(self%result) .or. any(self%result%status == [outcome%timed_out, outcome%interrupted])
         attempt%has_succeeded = self%result%is_odd
      case (attempt_row%whole_set)
         call solve_on(self, self%discretisation, attempt, within)
         attempt%has_succeeded = self%result%status == outcome%converged
      end select
   end subroutine motion_attempts_make

   !> Solves the balance on a basis, from the first guess or the last solution.
   subroutine solve_on(self, basis, attempt, within)
      type(motion_attempts_t), intent(inout) :: self
      type(discretisation_t), intent(in), target :: basis
      type(attempt_t), intent(inout) :: attempt
      type(attempt_t), allocatable, intent(out) :: within(:)

      if (.not. allocated(self%unknowns) .and. allocated(self%first_guess)) self%unknowns = self%first_guess
      call solve_in_basis(self%system, self%discretisation, self%options, basis, self%result, self%error, self%unknowns, self%parts)
      if (allocated(self%result%attempts)) call move_alloc(self%result%attempts, within)
      attempt%status = merge(outcome%failed, self%result%status, allocated(self%error))
   end subroutine solve_on

   !> Solves the balance from the integrated motion, which remains the result if the balance does not converge.
   subroutine solve_from_integration(self, kind, attempt)
      type(motion_attempts_t), intent(inout) :: self
      integer, intent(in) :: kind                                     !! of the attempt, one of hb_solver_types%fallback
      type(attempt_t), intent(inout) :: attempt

      call balance_from(self%system, self%discretisation, self%options, &
                        guess_from(self%system, self%discretisation, self%coordinates, self%steady), self%result, self%unknowns, &
                        attempt%has_succeeded)
      if (attempt%has_succeeded) self%result%fallback = kind
      call adopt_integrated(self, has_balance=attempt%has_succeeded)
      attempt%status = self%result%status
   end subroutine solve_from_integration

   logical function motion_attempts_is_over(self) result(is_over)
      class(motion_attempts_t), intent(inout) :: self

      is_over = allocated(self%error)
   end function motion_attempts_is_over

   !> Integrates before any balance is tried. If this does not lead to a conclusive result, or is not possible, the balance
   !> follows.
   subroutine integrate_first(self, attempt)
      type(motion_attempts_t), intent(inout) :: self
      type(attempt_t), intent(inout) :: attempt
      type(error_t), allocatable :: error

      associate (system => self%system, discretisation => self%discretisation, options => self%options, &
                 result => self%result, steady => self%steady)
         call options%callbacks%time_domain_solver%find_steady_motion(system, discretisation, options, self%coordinates%dofs, &
                                                                      steady, error)
         attempt%has_succeeded = work_is_over() .or. steady%status /= outcome%pending .and. .not. allocated(error)
         attempt%status = merge(steady%status, outcome%failed, attempt%has_succeeded)
         if (.not. attempt%has_succeeded) return
         result%is_integrated_first = .true.
         result%work = steady%work
         result%integration_work = steady%work
         result%n_motions = steady%n_motions
         result%status = steady%status
         result%n_periods = steady%n_repeat
         if (work_is_over()) result%status = status_of_ended()
         if (allocated(steady%message)) result%message = steady%message
         if (is_solved(result%status)) call store_integrated(system, discretisation, options, self%coordinates, steady, result)
         attempt%status = result%status
      end associate
   end subroutine integrate_first

   !> Integrates after the balance, from its motion if that strikes walls. If a balance can start from the integrated motion
   !> it is the next attempt; otherwise the result is the integrated motion, or a description of what was integrated.
   subroutine integrate_last(self, attempt)
      type(motion_attempts_t), intent(inout) :: self
      type(attempt_t), intent(inout) :: attempt
      type(error_t), allocatable :: error
      type(options_t) :: from
      logical :: has_start

      associate (system => self%system, discretisation => self%discretisation, options => self%options, &
                 result => self%result, steady => self%steady)
         has_start = self%conditions%is_struck .and. allocated(self%unknowns)
         from = options
         if (has_start) call start_from(system, discretisation, options, self%unknowns, from%start%spectrum, has_start)
         if (.not. has_start) from%start%spectrum = options%start%spectrum
         call options%callbacks%time_domain_solver%find_steady_motion(system, discretisation, from, self%coordinates%dofs, steady, &
                                                                      error)
         result%work = result%work + steady%work
         result%integration_work = steady%work
         if (allocated(error)) steady%message = "integration: "//error%message
         attempt%status = steady%status
         if (steady%status == outcome%pending) &
            attempt%status = merge(outcome%out_of_budget, outcome%failed, steady%is_out_of_work)
         attempt%has_succeeded = .not. (work_is_over() .or. self%conditions%is_struck) .and. steady%status == outcome%integrated
         if (.not. attempt%has_succeeded) call adopt_integrated(self, has_balance=.false.)
      end associate
   end subroutine integrate_last

   !> Adopts the integrated motion, unless a balance has converged from it, or what the integration found instead.
   subroutine adopt_integrated(self, has_balance)
      type(motion_attempts_t), intent(inout) :: self
      logical, intent(in) :: has_balance                              !! one that has converged from the integrated motion

      associate (system => self%system, discretisation => self%discretisation, options => self%options, &
                 result => self%result, steady => self%steady)
         result%n_motions = steady%n_motions
         if (work_is_over()) then
            result%status = status_of_ended()
         else if (has_balance) then
            return
         else if (steady%status == outcome%pending) then
            call note_unsteady(steady, self%conditions%is_struck, result)
         else
            call result%forget_motion()
            if (allocated(self%unknowns)) deallocate (self%unknowns)
            result%status = steady%status
            result%n_periods = steady%n_repeat
            result%message = steady%message
            if (is_solved(steady%status)) call store_integrated(system, discretisation, options, self%coordinates, steady, result)
         end if
      end associate
   end subroutine adopt_integrated

   !> The motion of a solution of the balance in all degrees of freedom, as a start.
   subroutine start_from(system, discretisation, options, unknowns, start, is_there)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      real(wp), intent(in) :: unknowns(:)                             !! of the solution, as the guess of `solve_system`
      type(spectrum_t), intent(out) :: start                          !! [m]
      logical, intent(out) :: is_there
      type(error_t), allocatable :: error
      type(motion_result_t) :: whole
      type(options_t) :: alone                                        !! the balance, without what follows from its motion
      integer :: i

      is_there = system%structure%n_dofs <= max_dense
      if (.not. is_there) return
      alone = options
      alone%may_integrate = .false.
      alone%error_estimate%is_on = .false.
      alone%stability%method = stability_method%off
      alone%output%dofs = [(i, i=1, system%structure%n_dofs)]
      call solve_system(system, discretisation, alone, whole, error, unknowns)
      is_there = .not. allocated(error) .and. whole%status == outcome%converged
      if (.not. is_there) return
      start = as_spectrum(discretisation%harmonics, transpose(cmplx(whole%coefficients(1, :, :), -whole%coefficients(2, :, :), wp)))
   end subroutine start_from

   !> Solves the balance in a few steps from the integrated motion; the result is that of the balance if it converges.
   subroutine balance_from(system, discretisation, options, guess, result, unknowns, has_converged)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      real(wp), intent(in) :: guess(:)                                !! as that of `solve_system`
      type(motion_result_t), intent(inout) :: result
      real(wp), allocatable, intent(inout) :: unknowns(:)
      logical, intent(out) :: has_converged
      type(error_t), allocatable :: error
      type(motion_result_t) :: found
      type(options_t) :: nearby
      real(wp), allocatable :: solution(:)

      nearby = options
      nearby%solver%fallback = .false.
      nearby%solver%max_iterations = min(options%solver%max_iterations, nearby_steps)
      solution = guess
      has_converged = .false.
      call solve_in_basis(system, discretisation, nearby, discretisation, found, error, solution)
      if (allocated(error)) return
      call found%add(result%effort_t)
      has_converged = found%status == outcome%converged
      if (has_converged) then
         result = found
         call move_alloc(solution, unknowns)
      else
         result%effort_t = found%effort_t
      end if
   end subroutine balance_from

   !> Whether a motion of odd tuples satisfies the balance of the even ones too. For laws with memory their forces
   !> show this: a slider that starts at rest and never slips again remains on one side.
   pure logical function is_proven_odd(result)
      type(motion_result_t), intent(in) :: result

      is_proven_odd = result%asymmetry <= rounding_level
   end function is_proven_odd
end module hb_motion
