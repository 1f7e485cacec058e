!> The motion of a system in one basis: its balance is built, solved by the attempts of the solver alone, and described.
module hb_motion_in_basis
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite, ieee_quiet_nan, ieee_value
   use hb_advice, only: advice_list_t
   use hb_amplitudes, only: amplitudes_t
   use hb_autonomous, only: autonomous_start_t, find_motion, find_start
   use hb_balance, only: balance_t, new_balance
   use hb_cached_parts, only: cached_balances_t
   use hb_cancellation, only: verdict, verdict_on_work, work_is_over
   use hb_clock, only: wall_clock
   use hb_coordinates, only: coordinates_t
   use hb_discretisation, only: discretisation_t
   use hb_dynamic_stiffness, only: dynamic_stiffness_t, new_dynamic_stiffness, wanted_slopes_t
   use hb_error, only: annotate, error_t, fail
   use hb_error_estimate, only: estimate_linear_error
   use hb_estimated_errors, only: error_estimate_t
   use hb_harmonics, only: coefficients_in, harmonics_t
   use hb_kinds, only: wp
   use hb_law_coordinates, only: laws_at
   use hb_limit_cycle_search, only: search_t
   use hb_linear_part, only: linear_part_t, new_linear_part
   use hb_locking, only: locking_t, may_be_locked
   use hb_motion_description, only: add_stability_of, describe_motion, solution_t, store_motion
   use hb_motion_result, only: motion_result_t
   use hb_options, only: options_t
   use hb_outcome, only: is_lost, outcome, reason
   use hb_search_advice, only: advise_on_search, circumstances_t, find_circumstances, limit_of
   use hb_solver, only: solve
   use hb_solver_types, only: report_t
   use hb_stability, only: harmonic_motion_t
   use hb_system, only: coordinates_of, system_t
   implicit none
   private
   public :: solve_in_basis, status_of_ended

contains

   !> Solves the balance in a basis. A solver that does not converge is reported by the status of the result; an `error` is a
   !> failure of the point.
   subroutine solve_in_basis(system, discretisation, options, basis, result, error, unknowns, cached)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(discretisation_t), intent(in), target :: basis
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable, intent(inout) :: unknowns(:)             !! on entry a first guess in the whole set, as that of
                                                                      !! `solve_system`, if allocated; on return the solution
      type(cached_balances_t), pointer, intent(in), optional :: cached
      type(dynamic_stiffness_t) :: stiffness
      class(linear_part_t), allocatable :: linear
      type(balance_t), target :: balance                              ! not `allocatable`: several kB, for each point
      type(autonomous_start_t) :: start
      type(coordinates_t) :: coordinates
      type(solution_t) :: solution
      real(wp), allocatable :: guess(:)
      logical :: is_autonomous, keeps
      real(wp) :: started

      started = wall_clock()
      call move_alloc(unknowns, guess)
      coordinates = coordinates_of(system)
      is_autonomous = any(system%tones%is_unknown)
      call find_first_guess(system, discretisation, options, basis, coordinates, guess, start, error)
      if (allocated(error)) return
      result%frequency = start%omega
      result%n_harmonics = discretisation%harmonics%n_harmonics
      keeps = .false.
      if (present(cached)) keeps = associated(cached) .and. coordinates%n > 0
      call find_linear_part()
      if (allocated(error)) return
      if (coordinates%n == 0) then
         result%setup_seconds = wall_clock() - started
         call solve_linear_model(system, discretisation, options, basis, stiffness, result)
         return
      end if
      if (keeps) call cached%narrow%borrow_laws(balance%law_set)
      call new_balance(balance, basis%harmonics, basis%torus, start%omega, linear, laws_at(coordinates, system%laws), error)
      if (keeps) balance%cached_wide => cached%wide
      result%setup_seconds = wall_clock() - started
      if (.not. allocated(error)) then
         solution%basis => basis
         solution%balance => balance
         call move_alloc(guess, unknowns)
         call solve_balance(system, discretisation, options, solution, start, result, error, unknowns)
      end if
      if (options%has_time_domain() .and. is_autonomous .and. system%tones%n_tones > 1 .and. .not. allocated(error) &
          .and. result%status /= outcome%interrupted) &
         call search_for_locking(system, discretisation, options, start, coordinates%dofs, result)
      if (keeps .and. .not. allocated(balance%stiffness%contacts)) &
         call cached%narrow%give_back(balance%stiffness, balance%law_set)
      call balance%destroy()

   contains

      !> The linear part: that of the previous motion, as far as it is the same, or a new one; without coordinates of laws the
      !> dynamic stiffness alone.
      subroutine find_linear_part()
         if (associated(system%contact_parts) .and. coordinates%n > 0 .and. .not. is_autonomous) &
            call system%contact_parts%find_linear_part(system%structure, coordinates, laws_at(coordinates, system%laws), &
               basis%harmonics%frequencies(start%omega), system%loads_in(basis%harmonics), linear)
         if (allocated(linear)) return
         if (keeps) then
            call cached%narrow%borrow(system%structure, coordinates, basis%harmonics, basis%harmonics%frequencies(start%omega), &
                                      system%loads_in(basis%harmonics), linear, error)
            return
         end if
         call new_dynamic_stiffness(stiffness, system%structure, coordinates, basis%harmonics%frequencies(start%omega), &
                                    system%loads_in(basis%harmonics), error, &
                                    wanted_slopes_t(is_on=is_autonomous, of_motion=system%normal_mode%has_energy, &
                                                    loads=system%load_slopes_in(basis%harmonics)), basis%harmonics%tuples)
         if (allocated(error) .or. coordinates%n == 0) return
         allocate (linear)
         call new_linear_part(linear, stiffness)
      end subroutine find_linear_part
   end subroutine solve_in_basis

   !> Finds the start of the search: the tones, and the motion if it is given or by time integration.
   subroutine find_first_guess(system, discretisation, options, basis, coordinates, guess, start, error)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(discretisation_t), intent(in) :: basis
      type(coordinates_t), intent(in) :: coordinates
      real(wp), allocatable, intent(inout) :: guess(:)                !! on entry in the whole set, on return in the basis; not
                                                                      !! allocated: there is none
      type(autonomous_start_t), intent(out) :: start
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: given(:)

      call move_alloc(guess, given)
      start%omega = system%tones%omega
      if (any(system%tones%is_unknown)) &
         call find_start(start, system, options, basis, coordinates, allocated(given), error)
      if (allocated(error)) return
      if (allocated(given)) then
         call restrict_guess(discretisation%harmonics, basis%harmonics, coordinates%n, given, guess)
      else if (options%start%from_integration .and. coordinates%n > 0) then
         call integrate_guess(system, discretisation, options, basis, start%omega, coordinates, guess, error)
      end if
      if (allocated(error) .or. .not. (any(system%tones%is_unknown) .and. allocated(guess))) return
      start%omega = guess(size(guess) - size(start%omega) + 1:)
      start%has_motion = .true.
   end subroutine find_first_guess

   !> Computes a first guess by time integration; there is none if that finds nothing.
   subroutine integrate_guess(system, discretisation, options, basis, omega, coordinates, first_guess, error)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(discretisation_t), intent(in) :: basis
      real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s], (n_tones)
      type(coordinates_t), intent(in) :: coordinates
      real(wp), allocatable, intent(out) :: first_guess(:)            !! in the basis
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: integrated(:)

      if (.not. options%has_time_domain()) then
         call fail(error, "a first guess from time integration needs a time-domain solver")
         return
      end if
      call options%callbacks%time_domain_solver%first_guess(system, discretisation, options, omega, coordinates%dofs, integrated, &
                                                            error)
      if (allocated(error) .and. work_is_over()) deallocate (error)   ! the following steps are short
      call annotate(error, "first guess from time integration")
      if (allocated(error) .or. .not. allocated(integrated)) return
      associate (n => discretisation%harmonics%n_coefficients, n_dofs => size(coordinates%dofs))
         integrated = [coordinates%values_of(reshape(integrated(:n*n_dofs), [n, n_dofs])), integrated(n*n_dofs + 1:)]
      end associate
      call restrict_guess(discretisation%harmonics, basis%harmonics, coordinates%n, integrated, first_guess)
   end subroutine integrate_guess

   !> Restricts a first guess of all coefficients at the coordinates to the unknowns; there is none if its size
   !> differs, as for a neighbour whose laws have other coordinates.
   pure subroutine restrict_guess(whole, set, n_coordinates, guess, first_guess)
      type(harmonics_t), intent(in) :: whole, set                     !! of the guess, of the unknowns
      integer, intent(in) :: n_coordinates
      real(wp), intent(in) :: guess(:)                                !! coefficients, then all base frequencies
      real(wp), allocatable, intent(inout) :: first_guess(:)

      associate (n => whole%n_coefficients, n_all => whole%n_coefficients*n_coordinates)
         if (size(guess) /= n_all + whole%n_tones) return
         first_guess = [coefficients_in(set, whole, reshape(guess(:n_all), [n, n_coordinates])), guess(n_all + 1:)]
      end associate
   end subroutine restrict_guess

   !> Solves a model without laws: the condensed problem has no unknowns, only the linear motion remains.
   subroutine solve_linear_model(system, discretisation, options, basis, stiffness, result)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(discretisation_t), intent(in) :: basis
      type(dynamic_stiffness_t), intent(in) :: stiffness
      type(motion_result_t), intent(inout) :: result
      complex(wp) :: at_laws(0, basis%harmonics%n_harmonics)
      complex(wp), allocatable :: c(:, :)

      allocate (c(system%structure%n_dofs, basis%harmonics%n_harmonics))
      call stiffness%recover(at_laws, c)
      call store_motion(options, discretisation%harmonics, basis%harmonics, c, result)
      result%is_beyond_tables = system%structure%is_beyond_tables(c, basis%harmonics%frequencies(system%tones%omega))
      allocate (result%force_coefficients(2, discretisation%harmonics%n_harmonics, 0))
      allocate (result%corrected_coefficients(2, discretisation%harmonics%n_harmonics, 0))
      result%status = outcome%converged
      if (.not. all(ieee_is_finite(result%coefficients))) result%status = outcome%not_finite
      if (options%error_estimate%is_on .and. result%status == outcome%converged) &
         call estimate_linear_error(result%error_estimate, system%structure, system%tones, &
                                    basis%harmonics%frequencies(system%tones%omega), system%loads_in(basis%harmonics), c)
      if (result%status == outcome%converged) call add_stability_of(system, options, &
         harmonic_motion_t(basis%harmonics%tuples, system%tones, c), result)
   end subroutine solve_linear_model

   !> Fails for a motion of which a coordinate drifts: no motion with a constant mean value exists.
   subroutine check_drift(system, options, balance, u, error)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(balance_t), intent(in) :: balance
      real(wp), intent(in) :: u(:, :)                                 !! solution [m]
      type(error_t), allocatable, intent(out) :: error
      integer :: drifting

      drifting = balance%drifting(u, options%solver%tolerance)
      if (drifting == 0) return
      call fail(error, "degree of freedom '"// &
                trim(system%structure%labels(balance%stiffness%coordinates%positions(drifting)))//"' drifts: it has no static "// &
                "stiffness, and the mean force of its laws and loads is not zero, so that no motion has a mean value there; "// &
                "add a support or make the loads symmetric")
   end subroutine check_drift

   !> Solves the balance, and describes the motion found.
   subroutine solve_balance(system, discretisation, options, solution, start, result, error, unknowns)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in), target :: discretisation
      type(options_t), intent(in) :: options
      type(solution_t), intent(inout) :: solution                     !! with its basis and its balance
      type(autonomous_start_t), intent(in) :: start
      type(motion_result_t), intent(inout) :: result                  !! with the set-up time so far
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable, intent(inout) :: unknowns(:)             !! on entry a first guess in the basis, if allocated; on
                                                                      !! return the solution in the whole set
      type(report_t) :: report
      type(search_t), target :: search
      real(wp), allocatable :: guess(:)
      real(wp), allocatable, target :: u(:, :)
      real(wp) :: begun, started
      character(:), allocatable :: failure

      started = wall_clock()
      call move_alloc(unknowns, guess)
      associate (basis => solution%basis, balance => solution%balance)
         allocate (u(basis%harmonics%n_coefficients, balance%n_dofs), source=0.0_wp)
         if (any(system%tones%is_unknown)) then
            call add_start(options, basis, balance%stiffness%coordinates, u)
            if (allocated(guess)) u = reshape(guess(:size(u)), shape(u)) - start%base%u
            begun = wall_clock()
            call find_motion(system, discretisation, options, start, balance, u, search)
            report = search%report
            call store_tones(system, balance, report, result)
            if (allocated(search%message)) result%message = search%message
         else
            call solve_with_given_tones(system, options, solution, guess, u, report, begun)
         end if
         if (report%status == outcome%converged) call check_drift(system, options, balance, u, error)
         if (allocated(error)) return
         if (work_is_over()) report%status = status_of_ended()
         result%setup_seconds = result%setup_seconds + begun - started
         result%solver_seconds = wall_clock() - begun
         if (report%status == outcome%converged) &
            unknowns = [coefficients_in(discretisation%harmonics, basis%harmonics, u), balance%omega]
         call store_report(system, options, balance, u, report, result, error)
         if (search%advice > 0) call result%advice%add(search%advice)
         if (allocated(error) .or. (report%status == outcome%failed .and. allocated(report%error))) return
         solution%u => u
         if (any(system%tones%is_unknown)) solution%problem => search%phase
         call describe_motion(system, discretisation, options, solution, result, error)
         failure = trim(balance%law_set%memory_failure())
         if (allocated(error) .and. len(failure) > 0) then
            deallocate (error)
            if (allocated(unknowns)) deallocate (unknowns)
            call result%forget_motion()
            result%status = outcome%failed
            result%message = failure
         end if
         if (verdict_on_work() == verdict%interrupted) then
            result%status = outcome%interrupted
            if (allocated(error)) deallocate (error)                     ! of the partial results
         end if
      end associate
   end subroutine solve_balance

   !> Solves the balance at given base frequencies, from the given motion, or else from the linear one.
   subroutine solve_with_given_tones(system, options, solution, guess, u, report, begun)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(solution_t), intent(in) :: solution                        !! with its basis and its balance
      real(wp), allocatable, intent(in) :: guess(:)                   !! in the basis; not allocated: there is none
      real(wp), intent(inout), contiguous, target :: u(:, :)          !! zero; the last iterate
      type(report_t), intent(out) :: report
      real(wp), intent(out) :: begun                                  !! wall time at which the solver began [s]
      real(wp), allocatable :: linear_solution(:, :)
      logical :: is_stuck

      allocate (linear_solution, mold=u)
      associate (balance => solution%balance)
         call balance%linear_solution(linear_solution)
         if (options%start%from_linear) then
            u = linear_solution
            if (.not. allocated(guess)) call balance%stuck_solution(u, is_stuck)
         end if
         call add_start(options, solution%basis, balance%stiffness%coordinates, u)
         if (allocated(guess)) u = reshape(guess(:size(u)), shape(u))
         ! a known motion is tried first
         if (allocated(guess) .or. .not. options%start%spectrum%is_zero()) balance%continues_in_order_first = .false.
         begun = wall_clock()
         call solve_unknowns(options, balance, linear_solution, u, report)
         if (report%status == outcome%converged .and. system%load_spectrum%is_zero() .and. &
             .not. options%purpose%is_followed) call discard_noise(balance, u, report%residual)
      end associate
   end subroutine solve_with_given_tones

   !> Sets a motion without loads to zero if zero is an exact solution and the residual grows in proportion to the motion:
   !> it is then the remainder of an iteration towards zero, whose forces are below the tolerance, and no motion by itself.
   !> A curve does not begin with it, but at its other end.
   subroutine discard_noise(balance, u, residual)
      type(balance_t), intent(inout) :: balance
      real(wp), intent(inout) :: u(:, :)                              !! (n_coefficients, n_dofs)
      real(wp), intent(inout) :: residual                             !! its norm
      real(wp) :: r(size(u))

      if (.not. maxval(abs(u)) > 0.0_wp) return
      call balance%residual(spread(0.0_wp, 1, size(u)), r)
      if (any(abs(r) > 0.0_wp)) return
      call balance%residual([0.5_wp*u], r)                            ! of a motion by itself it is far larger than that of u
      if (.not. balance%norm(r) <= residual) return
      u = 0.0_wp
      residual = 0.0_wp
   end subroutine discard_noise

   !> Stores the solver's report in the result, with a message if it has found no motion.
   subroutine store_report(system, options, balance, u, report, result, error)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(balance_t), intent(inout) :: balance
      real(wp), intent(in) :: u(:, :)                                 !! the last iterate
      type(report_t), intent(inout) :: report
      type(motion_result_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error
      type(circumstances_t) :: circumstances
      character(:), allocatable :: failure

      result%advice = advice_list_t()
      result%status = report%status
      result%iterations = report%iterations
      result%evaluations = report%evaluations
      result%work = report%work
      result%residual = report%residual
      result%n_unknowns = balance%n_unknowns
      result%preconditioner_level = balance%preconditioner_level
      result%fallback = report%fallback
      if (allocated(report%attempts)) result%attempts = report%attempts
      if (report%status == outcome%failed .and. allocated(report%error)) then
         failure = trim(balance%law_set%memory_failure())
         if (len(failure) > 0) result%message = failure               ! time integration needs no states that repeat on a grid
         if (len(failure) == 0) call move_alloc(report%error, error)
      else if (balance%law_set%is_given_up) then
         call fail(error, balance%law_set%error_text)
      else if (report%status /= outcome%converged .and. allocated(balance%law_set%error_text)) then
         result%message = balance%law_set%error_text
         if (is_lost(report%status)) result%status = outcome%law_undefined
      else if (allocated(report%attempts) .and. any(report%status == [outcome%stalled, outcome%out_of_budget, outcome%singular, &
                                                                     outcome%not_finite, outcome%diverged, outcome%timed_out])) then
         call find_circumstances(system, options, balance, u, circumstances)
         call advise_on_search(system, report, circumstances, result%advice)
         result%reason = limit_of(report, circumstances)
      else if (report%status == outcome%not_finite) then
         result%reason = reason%overflow
      end if
   end subroutine store_report

   !> Checks whether the tones have locked, in which case there is no torus: if the search for a torus failed, or if
   !> its motion is no better than a guess and its tones are nearly commensurate.
   subroutine search_for_locking(system, discretisation, options, start, law_dofs, result)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(autonomous_start_t), intent(in) :: start
      integer, intent(in) :: law_dofs(:)
      type(motion_result_t), intent(inout) :: result
      type(locking_t) :: locking
      type(error_estimate_t) :: none

      select case (result%status)
      case (outcome%stalled)
         call options%callbacks%time_domain_solver%find_locking(locking, system, discretisation, options, start%omega, law_dofs)
      case (outcome%truncated)
         if (may_be_locked(result%frequency, system%tones%is_unknown)) &
            call options%callbacks%time_domain_solver%find_locking(locking, system, discretisation, options, result%frequency, &
                                                                   law_dofs)
      case (outcome%collapsed) ! to a fraction of a given tone? Otherwise the motion has no other tone
         if (all(system%tones%is_unknown) .or. .not. may_be_locked(start%omega, system%tones%is_unknown)) return
         call options%callbacks%time_domain_solver%find_locking(locking, system, discretisation, options, start%omega, law_dofs)
         if (.not. locking%is_locked) return
         locking%is_locked = any(locking%multiples > 1 .and. .not. system%tones%is_unknown)
      end select
      if (verdict_on_work() == verdict%interrupted) result%status = outcome%interrupted
      if (.not. locking%is_locked) return
      result%status = outcome%locked
      result%message = trim(locking%message())
      result%advice = advice_list_t()
      result%error_estimate = none                                       ! of a torus that does not exist
      result%is_near_commensurate = .false.
      where (system%tones%is_unknown) result%frequency = locking%multiples*locking%base
   end subroutine search_for_locking

   !> Status of a point that must end early.
   integer function status_of_ended() result(status)
      select case (verdict_on_work())
      case (verdict%timed_out)
         status = outcome%timed_out
      case (verdict%out_of_work)
         status = outcome%out_of_budget
      case default
         status = outcome%interrupted
      end select
   end function status_of_ended

   !> Stores the tones; unknown ones that the motion does not have are NaN.
   subroutine store_tones(system, balance, report, result)
      type(system_t), intent(in) :: system
      type(balance_t), intent(in) :: balance
      type(report_t), intent(in) :: report
      type(motion_result_t), intent(inout) :: result

      result%frequency = balance%omega
      if (system%normal_mode%is_requested) result%artificial_damping = balance%xi
      if (any(report%status == [outcome%collapsed, outcome%no_motion])) then
         where (system%tones%is_unknown) result%frequency = ieee_value(1.0_wp, ieee_quiet_nan)
      end if
   end subroutine store_tones

   !> Solves with the coefficients as one vector.
   subroutine solve_unknowns(options, balance, linear_solution, u, report)
      type(options_t), intent(in) :: options
      type(balance_t), intent(inout) :: balance
      real(wp), intent(in) :: linear_solution(:, :)                   !! of the model without its laws, in the form of u
      real(wp), intent(inout), contiguous, target :: u(:, :)
      type(report_t), intent(out) :: report
      real(wp), pointer, contiguous :: x(:)

      x(1:size(u)) => u
      balance%preconditioner_level = options%solver%preconditioner_level
      call solve(balance, options%solver, reshape(linear_solution, [size(u)]), x, report)
   end subroutine solve_unknowns

   !> Adds the user's first guess at the coordinates of the laws; the other motion follows from these.
   subroutine add_start(options, basis, coordinates, u)
      type(options_t), intent(in) :: options
      type(discretisation_t), intent(in) :: basis
      type(coordinates_t), intent(in) :: coordinates
      real(wp), intent(inout) :: u(:, :)
      type(amplitudes_t) :: start

      start = options%start%spectrum%in_set(basis%harmonics)
      if (.not. start%is_zero()) u = u + basis%harmonics%coefficients(coordinates%amplitudes_of(start%whole()))
   end subroutine add_start
end module hb_motion_in_basis
