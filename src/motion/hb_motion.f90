!> One question, one answer: from a scene to its motion and what is known of it.
module hb_motion
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite, ieee_quiet_nan, ieee_value
   use hb_advice, only: advice_on, circumstances_t, find_circumstances
   use hb_amplitudes, only: amplitudes_t
   use hb_autonomous, only: autonomous_start_t, find_motion, find_start
   use hb_balance, only: balance_t, new_balance
   use hb_basis, only: basis_t, whole_basis
   use hb_certificate, only: certificate_t, certify_linear
   use hb_clock, only: wall_clock
   use hb_coordinates, only: coordinates_t
   use hb_dynamic_stiffness, only: dynamic_stiffness_t, new_dynamic_stiffness, wanted_slopes_t
   use hb_error, only: annotate, error_t, fail
   use hb_first_way, only: first_way
   use hb_kept_linear_part, only: kept_linear_parts_t
   use hb_kinds, only: wp
   use hb_law_coordinates, only: laws_at
   use hb_limit_cycle_search, only: search_t
   use hb_linear_part, only: linear_part_t, new_linear_part
   use hb_marched_result, only: guess_from, is_lost, keep_marched
   use hb_motion_description, only: describe_motion, keep_motion
   use hb_motion_result, only: motion_result_t
   use hb_outcome, only: is_solved, outcome
   use hb_scene, only: scene_t
   use hb_scene_basis, only: find_basis
   use hb_scene_coordinates, only: coordinates_of
   use hb_solver, only: solve
   use hb_solver_types, only: report_t, rescue
   use hb_time_domain, only: locking_t, may_be_locked, settled_t
   use hb_watch, only: verdict, verdict_on_work, watch_t, work_is_over
   implicit none
   private
   public :: solve_motion, status_of_ended

   integer, parameter :: steps_from_march = 20                        ! of the balance, from a motion that is known
   real(wp), parameter :: largest_asymmetry = 1.0e-8_wp               ! of forces with memory of an odd motion, relative

contains

   !> Solves the scene. An `error` is trouble that belongs to this point alone, such as a singular interior; a solver that
   !> does not converge is told by the status of the result.
   subroutine solve_motion(scene, result, error, guess, unknowns, kept)
      type(scene_t), intent(in) :: scene
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: guess(:)                      !! in place of that of the scene: coefficients of what the
                                                                      !! laws feel, then all base frequencies
      real(wp), allocatable, intent(out), optional :: unknowns(:)     !! of a converged solution, as `guess`; none without laws
      type(kept_linear_parts_t), intent(inout), optional, target :: kept  !! of the motion before, for what it can be used
      type(watch_t), target :: watch
      real(wp), allocatable :: found(:)

      call watch%enter(scene%solver%time_limit)
      if (present(guess)) found = guess
      call solve_watched(scene, result, error, found, kept)
      call watch%leave()
      if (allocated(error)) then
         call forget_motion(result)
      else if (present(unknowns)) then
         call move_alloc(found, unknowns)
      end if
   end subroutine solve_motion

   !> Solves the scene under a watch that was entered.
   subroutine solve_watched(scene, result, error, unknowns, kept)
      type(scene_t), intent(in) :: scene
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable, intent(inout) :: unknowns(:)             !! a first guess as that of `solve_motion`, then the solution;
                                                                      !! not allocated: there is none
      type(kept_linear_parts_t), intent(inout), optional, target :: kept
      type(kept_linear_parts_t), pointer :: parts
      type(basis_t) :: basis
      real(wp), allocatable :: first_guess(:)
      logical :: is_done, is_odd

      nullify (parts)
      if (present(kept) .and. .not. any(scene%tones%is_unknown)) parts => kept   ! no slopes, no drives
      call move_alloc(unknowns, first_guess)
      if (scene%first_way == first_way%march .and. scene%has_time_domain() .and. .not. allocated(first_guess)) then
         call march_first(scene, result, is_done)
         if (is_done) return
      end if
      call find_basis(basis, is_odd, scene, error, first_guess)
      if (allocated(error)) return
      if (allocated(first_guess)) unknowns = first_guess
      call solve_scene(scene, basis, result, error, unknowns, parts)
      if (is_odd .and. .not. allocated(error)) then
         result%is_odd = is_proven_odd(result) .or. any(result%status == [outcome%timed_out, outcome%interrupted])
         if (.not. result%is_odd) then
            if (.not. allocated(unknowns) .and. allocated(first_guess)) unknowns = first_guess   ! found ones balance odd harmonics
            call solve_scene(scene, whole_basis(scene%harmonics, scene%torus), result, error, unknowns, parts)
         end if
      end if
      if (scene%has_time_domain() .and. .not. allocated(error)) call rescue_by_march(scene, result, unknowns)
   end subroutine solve_watched

   !> Marches before any balance is tried. Not done where it leads to nothing that is known, or cannot be: the balance follows.
   subroutine march_first(scene, result, is_done)
      type(scene_t), intent(in) :: scene
      type(motion_result_t), intent(out) :: result
      logical, intent(out) :: is_done
      type(coordinates_t) :: coordinates
      type(error_t), allocatable :: error
      type(settled_t) :: settled

      is_done = .false.
      if (any(scene%tones%is_unknown) .or. scene%normal_mode%is_asked) return
      coordinates = coordinates_of(scene)
      if (coordinates%n == 0) return
      call scene%callbacks%time_domain_solver%settle(scene, coordinates%dofs, settled, error)
      is_done = work_is_over() .or. settled%status /= outcome%pending .and. .not. allocated(error)
      if (.not. is_done) return
      result%is_marched_first = .true.
      result%work = settled%work
      result%march_work = settled%work
      result%n_motions = settled%n_motions
      result%status = settled%status
      if (work_is_over()) result%status = status_of_ended()
      if (allocated(settled%message)) result%message = settled%message
      if (is_solved(result%status)) call keep_marched(scene, coordinates, settled, result)
   end subroutine march_first

   !> The last way: where the balance has found no motion the scene is marched, and what that ends in is the answer: the balance
   !> solved from there, the motion marched, or what there is instead.
   subroutine rescue_by_march(scene, result, unknowns)
      type(scene_t), intent(in) :: scene
      type(motion_result_t), intent(inout) :: result
      real(wp), allocatable, intent(inout) :: unknowns(:)
      type(coordinates_t) :: coordinates
      type(error_t), allocatable :: error
      type(settled_t) :: settled

      if (.not. (scene%solver%rescue .and. scene%solver%rescue_by_march .and. is_lost(result%status))) return
      if (any(scene%tones%is_unknown) .or. scene%normal_mode%is_asked) return
      coordinates = coordinates_of(scene)
      if (coordinates%n == 0) return
      call scene%callbacks%time_domain_solver%settle(scene, coordinates%dofs, settled, error)
      result%work = result%work + settled%work
      result%march_work = settled%work
      if (allocated(error)) settled%message = "marching: "//error%message
      if (.not. work_is_over() .and. settled%status == outcome%marched) &
         call balance_from(scene, guess_from(scene, coordinates, settled), result, unknowns)
      result%n_motions = settled%n_motions
      if (work_is_over()) then
         result%status = status_of_ended()
      else if (result%rescue == rescue%march) then
         return                                                       ! the balance has its motion after all
      else if (settled%status == outcome%pending) then
         if (allocated(result%message)) settled%message = settled%message//"; "//result%message
         result%message = settled%message
      else
         call forget_motion(result)
         result%status = settled%status
         result%message = settled%message
         if (is_solved(settled%status)) call keep_marched(scene, coordinates, settled, result)
      end if
   end subroutine rescue_by_march

   !> Solves the balance in a few steps from the motion marched; the result is that of the balance where it converges.
   subroutine balance_from(scene, guess, result, unknowns)
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: guess(:)                                !! as that of `solve_motion`
      type(motion_result_t), intent(inout) :: result
      real(wp), allocatable, intent(inout) :: unknowns(:)
      type(error_t), allocatable :: error
      type(motion_result_t) :: found
      type(scene_t) :: near
      real(wp), allocatable :: solution(:)

      near = scene
      near%solver%rescue = .false.
      near%solver%max_iterations = min(scene%solver%max_iterations, steps_from_march)
      solution = guess
      call solve_scene(near, whole_basis(scene%harmonics, scene%torus), found, error, solution)
      if (allocated(error)) return
      found%iterations = found%iterations + result%iterations
      found%evaluations = found%evaluations + result%evaluations
      found%work = found%work + result%work
      if (found%status == outcome%converged) then
         result = found
         result%rescue = rescue%march
         call move_alloc(solution, unknowns)
      else
         result%iterations = found%iterations
         result%evaluations = found%evaluations
         result%work = found%work
      end if
   end subroutine balance_from

   !> Whether a motion of odd tuples balances the even ones too. Of laws with memory this shows in their forces: a slider that
   !> starts at rest and never slips again stays on one side.
   pure logical function is_proven_odd(result)
      type(motion_result_t), intent(in) :: result

      is_proven_odd = result%asymmetry <= largest_asymmetry
   end function is_proven_odd

   !> Takes out what was found before an error: nobody has seen that it is a motion.
   pure subroutine forget_motion(result)
      type(motion_result_t), intent(inout) :: result

      if (allocated(result%coefficients)) deallocate (result%coefficients)
      if (allocated(result%force_coefficients)) deallocate (result%force_coefficients)
      if (allocated(result%corrected_coefficients)) deallocate (result%corrected_coefficients)
      if (allocated(result%improved_coefficients)) deallocate (result%improved_coefficients)
   end subroutine forget_motion

   !> Solves the scene in a basis.
   subroutine solve_scene(scene, basis, result, error, unknowns, kept)
      type(scene_t), intent(in) :: scene
      type(basis_t), intent(in) :: basis
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable, intent(inout) :: unknowns(:)             !! a first guess in the whole set, as that of `solve_motion`,
                                                                      !! then the solution; not allocated: there is none
      type(kept_linear_parts_t), pointer, intent(in), optional :: kept
      type(dynamic_stiffness_t) :: stiffness
      type(linear_part_t), allocatable :: linear
      type(balance_t), target :: balance
      type(autonomous_start_t) :: start
      type(coordinates_t) :: coordinates
      real(wp), allocatable :: first_guess(:), guess(:), marched(:)
      logical :: is_autonomous, keeps
      real(wp) :: started

      started = wall_clock()
      call move_alloc(unknowns, guess)
      coordinates = coordinates_of(scene)
      is_autonomous = any(scene%tones%is_unknown)
      start%omega = scene%tones%omega
      if (is_autonomous) call find_start(start, scene, basis, coordinates, error)
      if (allocated(error)) return
      if (allocated(guess)) then
         call restrict_guess(basis, coordinates%n, guess, first_guess)
      else if (scene%start_from_march .and. coordinates%n > 0) then
         if (.not. scene%has_time_domain()) then
            call fail(error, "first_guess = 'march' needs a time-domain solver")
            return
         end if
         call scene%callbacks%time_domain_solver%first_guess(scene, start%omega, coordinates%dofs, marched, error)
         if (allocated(error) .and. work_is_over()) deallocate (error)   ! nothing that follows takes long
         call annotate(error, "first guess from marching")
         if (allocated(error)) return
         if (allocated(marched)) then
            associate (n => basis%whole%n_coefficients, n_dofs => size(coordinates%dofs))
               marched = [coordinates%values_of(reshape(marched(:n*n_dofs), [n, n_dofs])), marched(n*n_dofs + 1:)]
            end associate
            call restrict_guess(basis, coordinates%n, marched, first_guess)
         end if
      end if
      if (is_autonomous .and. allocated(first_guess)) then
         start%omega = first_guess(size(first_guess) - size(start%omega) + 1:)
         start%has_motion = .true.
      end if
      result%frequency = start%omega
      result%n_harmonics = basis%whole%n_harmonics
      keeps = .false.
      if (present(kept)) keeps = associated(kept) .and. coordinates%n > 0
      if (keeps) then
         call kept%narrow%take(scene%structure, coordinates, basis%harmonics%frequencies(start%omega), &
                               scene%loads%at(basis%places), linear, error)
      else
         call new_dynamic_stiffness(stiffness, scene%structure, coordinates, basis%harmonics%frequencies(start%omega), &
                                    scene%loads%at(basis%places), error, &
                                    wanted_slopes_t(is_on=is_autonomous, of_motion=scene%normal_mode%has_energy, &
                                                    loads=scene%load_slopes%at(basis%places)))
      end if
      if (allocated(error)) return
      if (coordinates%n == 0) then
         result%setup_seconds = wall_clock() - started
         call solve_linear_scene(scene, basis, stiffness, result)
         return
      end if
      if (.not. keeps) then
         allocate (linear)
         call new_linear_part(linear, stiffness)
      end if
      call new_balance(balance, basis%harmonics, basis%torus, start%omega, linear, laws_at(coordinates, scene%laws), &
                       scene%planning, error)
      if (keeps) balance%kept_wide => kept%wide
      result%setup_seconds = wall_clock() - started
      if (.not. allocated(error)) call solve_balance(scene, basis, start, balance, result, error, first_guess, unknowns)
      if (scene%has_time_domain() .and. is_autonomous .and. scene%tones%n_tones > 1 .and. .not. allocated(error) &
          .and. result%status /= outcome%interrupted) &
         call look_for_locking(scene, start, coordinates%dofs, result)
      if (keeps) call kept%narrow%give_back(balance%stiffness)
      call balance%destroy()
   end subroutine solve_scene

   !> Takes the unknowns out of a first guess of all coefficients at the coordinates; none out of one of another size, as of a
   !> neighbour whose laws feel something else.
   pure subroutine restrict_guess(basis, n_coordinates, guess, first_guess)
      type(basis_t), intent(in) :: basis
      integer, intent(in) :: n_coordinates
      real(wp), intent(in) :: guess(:)                                !! coefficients, then all base frequencies
      real(wp), allocatable, intent(inout) :: first_guess(:)

      associate (n => basis%whole%n_coefficients, n_all => basis%whole%n_coefficients*n_coordinates)
         if (size(guess) /= n_all + basis%whole%n_tones) return
         first_guess = [basis%restrict(reshape(guess(:n_all), [n, n_coordinates])), guess(n_all + 1:)]
      end associate
   end subroutine restrict_guess

   !> A scene without laws: the condensed problem has no unknowns, all that is left is the linear motion.
   subroutine solve_linear_scene(scene, basis, stiffness, result)
      type(scene_t), intent(in) :: scene
      type(basis_t), intent(in) :: basis
      type(dynamic_stiffness_t), intent(in) :: stiffness
      type(motion_result_t), intent(inout) :: result
      complex(wp) :: at_laws(0, basis%harmonics%n_harmonics)
      complex(wp), allocatable :: c(:, :)

      allocate (c(scene%structure%n_dofs, basis%harmonics%n_harmonics))
      call stiffness%recover(at_laws, c)
      call keep_motion(scene, basis, c, result)
      allocate (result%force_coefficients(2, basis%whole%n_harmonics, 0))
      allocate (result%corrected_coefficients(2, basis%whole%n_harmonics, 0))
      result%status = outcome%converged
      if (.not. all(ieee_is_finite(result%coefficients))) result%status = outcome%not_finite
      if (scene%certificate%is_on .and. result%status == outcome%converged) &
         call certify_linear(result%certificate, scene%structure, scene%tones, basis%harmonics%frequencies(scene%tones%omega), &
                             scene%loads%at(basis%places), c)
   end subroutine solve_linear_scene

   !> Solves the balance, and describes the motion found.
   subroutine solve_balance(scene, basis, start, balance, result, error, guess, unknowns)
      type(scene_t), intent(in) :: scene
      type(basis_t), intent(in) :: basis
      type(autonomous_start_t), intent(in) :: start
      type(balance_t), intent(inout), target :: balance
      type(motion_result_t), intent(inout) :: result                  !! with the time that the set-up has taken so far
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable, intent(in) :: guess(:)                   !! in the basis; not allocated: that of the scene
      real(wp), allocatable, intent(out) :: unknowns(:)               !! in the whole set
      type(circumstances_t) :: circumstances
      type(report_t) :: report
      type(search_t) :: search
      real(wp), allocatable :: linear_solution(:, :), u(:, :)
      real(wp) :: begun, started
      character(:), allocatable :: trouble
      logical :: is_stuck

      started = wall_clock()
      allocate (u(basis%harmonics%n_coefficients, balance%n_dofs), source=0.0_wp)
      if (any(scene%tones%is_unknown)) then
         call add_start(scene, basis, balance%stiffness%coordinates, u)
         if (allocated(guess)) u = reshape(guess(:size(u)), shape(u)) - start%base%u
         begun = wall_clock()
         call find_motion(scene, start, balance, u, search)
         report = search%report
         call keep_tones(scene, balance, report, result)
         if (allocated(search%message)) result%message = search%message
      else
         allocate (linear_solution, mold=u)
         call balance%linear_solution(linear_solution)
         if (scene%start_from_linear) then
            u = linear_solution
            if (.not. allocated(guess)) call balance%stuck_solution(u, is_stuck)
         end if
         call add_start(scene, basis, balance%stiffness%coordinates, u)
         if (allocated(guess)) u = reshape(guess(:size(u)), shape(u))
         if (allocated(guess) .or. .not. scene%start%is_zero()) balance%climbs_first = .false.   ! what is known comes first
         begun = wall_clock()
         call solve_unknowns(scene, balance, linear_solution, u, report)
      end if
      if (work_is_over()) report%status = status_of_ended()
      result%setup_seconds = result%setup_seconds + begun - started
      result%solver_seconds = wall_clock() - begun
      if (report%status == outcome%converged) unknowns = [basis%expand(u), balance%omega]
      result%status = report%status
      result%iterations = report%iterations
      result%evaluations = report%evaluations
      result%work = report%work
      result%residual = report%residual
      result%n_unknowns = balance%n_unknowns
      result%preconditioner_level = balance%preconditioner_level
      result%rescue = report%rescue
      trouble = trim(balance%law_set%memory_trouble())
      if (report%status == outcome%failed .and. allocated(report%error) .and. len(trouble) > 0) then
         result%message = trouble                                     ! time integration needs no states that repeat on a grid
         return
      else if (report%status == outcome%failed .and. allocated(report%error)) then
         call move_alloc(report%error, error)
         return
      else if (balance%law_set%is_given_up) then
         call fail(error, balance%law_set%complaint)
         return
      else if (report%status /= outcome%converged .and. allocated(balance%law_set%complaint)) then
         result%message = balance%law_set%complaint
      else if (allocated(report%attempts) .and. any(report%status == [outcome%stalled, outcome%out_of_budget, outcome%singular, &
                                                                     outcome%not_finite, outcome%diverged, outcome%timed_out])) then
         call find_circumstances(scene, balance, u, circumstances)
         result%message = trim(advice_on(report, circumstances))
      else if (report%status == outcome%not_finite) then
         result%message = "loads, or the motion under them, are out of the range of numbers; scale the units"
      end if

      call describe_motion(scene, basis, balance, u, result, error, search)
      trouble = trim(balance%law_set%memory_trouble())
      if (allocated(error) .and. len(trouble) > 0) then
         deallocate (error)
         if (allocated(unknowns)) deallocate (unknowns)
         call forget_motion(result)
         result%status = outcome%failed
         result%message = trouble
      end if
      if (verdict_on_work() == verdict%interrupted) then
         result%status = outcome%interrupted
         if (allocated(error)) deallocate (error)                     ! of what was left half done
      end if
   end subroutine solve_balance

   !> Where the search for a torus was lost, or its motion is no better than a guess and its tones are nearly commensurate, the
   !> tones may have locked: there is no torus then.
   subroutine look_for_locking(scene, start, law_dofs, result)
      type(scene_t), intent(in) :: scene
      type(autonomous_start_t), intent(in) :: start
      integer, intent(in) :: law_dofs(:)
      type(motion_result_t), intent(inout) :: result
      type(locking_t) :: locking
      type(certificate_t) :: none

      select case (result%status)
      case (outcome%stalled)
         call scene%callbacks%time_domain_solver%find_locking(locking, scene, start%omega, law_dofs)
      case (outcome%truncated)
         if (may_be_locked(result%frequency, scene%tones%is_unknown)) &
            call scene%callbacks%time_domain_solver%find_locking(locking, scene, result%frequency, law_dofs)
      case (outcome%collapsed)                                        ! to a part of a given tone? else the motion has no other
         if (all(scene%tones%is_unknown) .or. .not. may_be_locked(start%omega, scene%tones%is_unknown)) return
         call scene%callbacks%time_domain_solver%find_locking(locking, scene, start%omega, law_dofs)
         if (.not. locking%is_locked) return
         locking%is_locked = any(locking%multiples > 1 .and. .not. scene%tones%is_unknown)
      end select
      if (verdict_on_work() == verdict%interrupted) result%status = outcome%interrupted
      if (.not. locking%is_locked) return
      result%status = outcome%locked
      result%message = trim(locking%message())
      result%certificate = none                                       ! of a torus that there is not
      result%is_near_commensurate = .false.
      where (scene%tones%is_unknown) result%frequency = locking%multiples*locking%base
   end subroutine look_for_locking

   !> Status of a point that has to end before it is done.
   integer function status_of_ended() result(status)
      status = merge(outcome%timed_out, outcome%interrupted, verdict_on_work() == verdict%timed_out)
   end function status_of_ended

   !> The tones found; unknown ones that the motion does not have are no numbers.
   subroutine keep_tones(scene, balance, report, result)
      type(scene_t), intent(in) :: scene
      type(balance_t), intent(in) :: balance
      type(report_t), intent(in) :: report
      type(motion_result_t), intent(inout) :: result

      result%frequency = balance%omega
      if (scene%normal_mode%is_asked) result%artificial_damping = balance%xi
      if (any(report%status == [outcome%collapsed, outcome%no_motion])) then
         where (scene%tones%is_unknown) result%frequency = ieee_value(1.0_wp, ieee_quiet_nan)
      end if
   end subroutine keep_tones

   !> The solver sees the coefficients as one vector.
   subroutine solve_unknowns(scene, balance, linear_solution, u, report)
      type(scene_t), intent(in) :: scene
      type(balance_t), intent(inout) :: balance
      real(wp), intent(in) :: linear_solution(:, :)                   !! of the scene without its laws, as u
      real(wp), intent(inout), contiguous, target :: u(:, :)
      type(report_t), intent(out) :: report
      real(wp), pointer, contiguous :: x(:)

      x(1:size(u)) => u
      balance%preconditioner_level = scene%solver%preconditioner_level
      call solve(balance, scene%solver, reshape(linear_solution, [size(u)]), x, report)
   end subroutine solve_unknowns

   !> Adds the user's first guess at the coordinates of the laws; elsewhere the motion follows from there.
   subroutine add_start(scene, basis, coordinates, u)
      type(scene_t), intent(in) :: scene
      type(basis_t), intent(in) :: basis
      type(coordinates_t), intent(in) :: coordinates
      real(wp), intent(inout) :: u(:, :)
      complex(wp), allocatable :: z(:, :)
      type(amplitudes_t) :: start
      integer :: k

      start = scene%start%at(basis%places)
      associate (set => basis%harmonics)
         z = coordinates%amplitudes_of(start%values)
         do k = 1, size(start%harmonics)
            associate (cosine => set%cos_at(start%harmonics(k)), sine => set%sin_at(start%harmonics(k)))
               u(cosine, :) = u(cosine, :) + real(z(:, k))
               if (sine > 0) u(sine, :) = u(sine, :) - aimag(z(:, k))
            end associate
         end do
      end associate
   end subroutine add_start
end module hb_motion
