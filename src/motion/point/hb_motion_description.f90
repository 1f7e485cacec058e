!> The results derived from a motion: coefficients, forces, error estimate, named outputs, stability, surfaces.
module hb_motion_description
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_advice, only: advice
   use hb_balance, only: balance_t, new_balance
   use hb_bordered, only: bordered_problem_t
   use hb_clock, only: wall_clock
   use hb_contact_parts, only: contact_parts_t                        ! gfortran 12 cannot write the module without it
   use hb_discretisation, only: discretisation_t
   use hb_error, only: error_t, fail
   use hb_error_estimate, only: estimate_error
   use hb_estimated_errors, only: error_estimate_t, wanted_motions_t
   use hb_fftw, only: new_real_block, real_block_t
   use hb_frequency_part, only: frequency_part_t                      ! gfortran 16 cannot write the module without it
   use hb_harmonics, only: coefficients_in, harmonics_t
   use hb_kinds, only: wp
   use hb_law, only: law_box_t
   use hb_law_coordinates, only: laws_at
   use hb_linear_part, only: linear_part_t
   use hb_model_basis, only: asymmetry
   use hb_motion_result, only: as_pairs, motion_result_t
   use hb_options, only: options_t
   use hb_outcome, only: is_solved, outcome, reason
   use hb_reached_laws, only: max_gap_to_motion, reached_laws
   use hb_stability, only: excitation_t, few_periods, harmonic_motion_t, noise_status, stability_config_t, &
      stability_method, stability_t, stability_verdict => verdict, work_of_verdict
   use hb_structure, only: max_dense, structure_t                     ! structure_t: gfortran 12 cannot write the module without it
   use hb_structure_load, only: find_random_forces
   use hb_system, only: system_t
   use hb_text, only: rounded
   use hb_thresholds, only: equality_tolerance, estimate_safety, small_share
   use hb_tones, only: tones_t
   use hb_torus, only: new_torus, torus_t
   use hb_transform, only: new_transform, transform_t
   use hb_wider_discretisation, only: choose_wider_set
   implicit none
   private
   public :: add_stability_of, allow_for_growth, compare_with_refined, describe_motion, request_stability, solution_t, &
      stability_of, stability_of_refined, store_motion

   !> A solution of a balance. It refers to its parts.
   type :: solution_t
      type(discretisation_t), pointer :: basis => null()              !! of the balance, a part of that of the motion
      type(balance_t), pointer :: balance => null()
      real(wp), pointer :: u(:, :) => null()                          !! [m], (n_coefficients, n_dofs)
      class(bordered_problem_t), pointer :: problem => null()         !! the balance with its other unknowns; null if only
                                                                      !! coefficients are unknown
   end type solution_t

contains

   !> Adds to a result the quantities that follow from a solution: motion, forces, error estimate, surfaces. The
   !> error estimate decides whether the status `converged` remains.
   subroutine describe_motion(system, discretisation, options, solution, result, error)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in), target :: discretisation
      type(options_t), intent(in) :: options
      type(solution_t), intent(in) :: solution
      type(motion_result_t), intent(inout) :: result                  !! with its status, and its stability if known
      type(error_t), allocatable, intent(out) :: error
      complex(wp), allocatable :: c(:, :)
      real(wp) :: begun

      associate (basis => solution%basis, balance => solution%balance, u => solution%u)
         allocate (c(system%structure%n_dofs, basis%harmonics%n_harmonics))
         call balance%all_dofs(u, c)
         call store_motion(options, discretisation%harmonics, basis%harmonics, c, result)
         result%is_beyond_tables = system%structure%is_beyond_tables(c, basis%harmonics%frequencies(balance%omega))
         call store_forces(discretisation%harmonics, basis, balance, u, result, error)
         if (allocated(error)) return
         if (options%error_estimate%is_on .and. result%status == outcome%converged) then
            begun = wall_clock()
            call store_error_estimate(system, discretisation, options, solution, result, error)
            result%error_estimate_seconds = wall_clock() - begun
            if (allocated(error)) return
            call store_outputs(options, discretisation%harmonics, basis%harmonics, c, result)
         end if
         if (is_solved(result%status)) then
            if (result%stability%method == stability_method%off) &
               call stability_of(system, options, balance, c, options%stability%tolerance, result%stability)
            call compare_with_refined(system, options, tones_of(system, balance), result%error_estimate, &
                                      result%stability)
         end if
         result%usual_work = usual_work(balance)
         if (options%compares_in_time) call compare_in_time(system, options, &
            harmonic_motion_t(balance%harmonics%tuples, tones_of(system, balance), c), result)
         call allow_for_growth(result, options%error_estimate%truncation)
         call result%withdraw_verdict()
         if (size(options%output%samples) > 0) call store_surfaces(system, options, basis, balance, u, result, error)
      end associate
   end subroutine describe_motion

   !> Computes the stability of a motion of the model according to its settings except the tolerance; not that of
   !> normal modes.
   subroutine stability_of(system, options, balance, c, tolerance, stability, is_integrated)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(balance_t), intent(in) :: balance
      complex(wp), intent(in) :: c(:, :)                              !! a - i b, (all dofs, n_harmonics)
      real(wp), intent(in) :: tolerance
      type(stability_t), intent(out) :: stability
      logical, intent(in), optional :: is_integrated !! always of the integrated periodic motion
      type(stability_config_t) :: config

      config = options%stability
      config%tolerance = tolerance
      if (present(is_integrated)) config%is_integrated = is_integrated
      call request_stability(system, options, config, &
                             harmonic_motion_t(balance%harmonics%tuples, tones_of(system, balance), c), &
                             usual_work(balance), stability)
   end subroutine stability_of

   !> Adds to the result of a solved motion its stability and, if requested, its comparison with a time integration.
   subroutine add_stability_of(system, options, motion, result)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(harmonic_motion_t), intent(in) :: motion
      type(motion_result_t), intent(inout) :: result

      call request_stability(system, options, options%stability, motion, result%usual_work, result%stability)
      if (options%compares_in_time) call compare_in_time(system, options, motion, result)
   end subroutine add_stability_of

   !> Finds how far a short time integration leaves a motion that is not unstable.
   subroutine compare_in_time(system, options, motion, result)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(harmonic_motion_t), intent(in) :: motion
      type(motion_result_t), intent(inout) :: result
      real(wp), parameter :: min_work_of_comparison = 3.0e8_wp        ! in about a nanosecond, for any motion

      if (result%status /= outcome%converged .or. result%stability%verdict == stability_verdict%unstable) return
      if (.not. allocated(options%callbacks%time_domain_solver)) return
      call options%callbacks%time_domain_solver%find_departure(system, options, motion, &
         work_of_verdict(options%stability%work_spent, min_work_of_comparison), result%departure)
   end subroutine compare_in_time

   !> Accepts a verdict only if the motion with its first-order errors removed has the same one: multipliers and
   !> exponents are sensitive to errors that are small relative to the motion, such as errors in the time at which a
   !> hard stop is left.
   subroutine compare_with_refined(system, options, tones, found, stability)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(tones_t), intent(in) :: tones                              !! of the motion
      type(error_estimate_t), intent(in) :: found                        !! its error estimate
      type(stability_t), intent(inout) :: stability                   !! its stability
      type(stability_config_t) :: config
      type(stability_t) :: compared, refined

      if (.not. allocated(found%refined)) return
      if (max(found%truncation, found%aliasing) <= equality_tolerance) return
      if (stability%is_integrated .and. stability%response%status /= noise_status%known) return ! of the periodic motion itself
      config = options%stability
      if (allocated(stability%along_series)) then                     ! a second one has to be as unstable
         call stability_of_refined(system, options, tones, found, config, refined)
         compared = stability%unstable_along_series(tones%omega(1))
         call compared%compare_with(refined%unstable_along_series(tones%omega(1)))
         if (compared%verdict == stability_verdict%unstable) stability = compared
         return
      end if
      if (stability%verdict == stability_verdict%unknown) return
      if (stability%n_periods > 0) config%min_periods = min(few_periods, stability%n_periods)
      if (stability%n_periods > 0) config%max_periods = stability%n_periods
      do
         call stability_of_refined(system, options, tones, found, config, refined)
         compared = stability
         call compared%compare_with(refined)
         if (compared%verdict /= stability_verdict%unknown .or. config%min_periods >= stability%n_periods) exit
         config%min_periods = stability%n_periods                     ! the averages of a shorter record differ by beats alone
      end do
      stability = compared
   end subroutine compare_with_refined

   !> Finds the stability of the motion with its first-order errors removed, which its error estimate has.
   subroutine stability_of_refined(system, options, tones, found, config, stability)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(tones_t), intent(in) :: tones                              !! of the motion
      type(error_estimate_t), intent(in) :: found                     !! its error estimate, with `refined`
      type(stability_config_t), intent(in) :: config
      type(stability_t), intent(out) :: stability
      type(stability_config_t) :: unlimited
      integer, allocatable :: carrying(:)

      unlimited = config
      unlimited%patience = max(1.0_wp, config%patience)
      call find_carrying(found%around%tuples, found%refined, small_share*max(found%truncation, found%aliasing), carrying)
      call request_stability(system, options, unlimited, &
                             harmonic_motion_t(found%around%tuples(:, carrying), tones, found%refined(:, carrying)), &
                             huge(1.0_wp), stability)
   end subroutine stability_of_refined

   !> Finds the tuples of a motion without the smallest ones, which together change no degree of freedom by more than
   !> a share of its largest harmonic. Mean values are kept.
   pure subroutine find_carrying(tuples, amplitudes, share, positions)
      integer, intent(in) :: tuples(:, :)                             !! (n_tones, n_harmonics)
      complex(wp), intent(in) :: amplitudes(:, :)                     !! (n_dofs, n_harmonics)
      real(wp), intent(in) :: share                                   !! > 0
      integer, allocatable, intent(out) :: positions(:)
      real(wp) :: largest, threshold, weight(size(amplitudes, 2))
      logical :: is_mean(size(amplitudes, 2))
      integer :: h, i

      is_mean = all(tuples == 0, dim=1)
      weight = 0.0_wp
      do i = 1, size(amplitudes, 1)
         largest = maxval(abs(amplitudes(i, :)), mask=.not. is_mean)
         if (largest > 0.0_wp) weight = max(weight, abs(amplitudes(i, :))/largest)
      end do
      threshold = 1.0_wp
      do while (sum(weight, mask=weight <= threshold) > share)
         threshold = 0.5_wp*threshold
      end do
      allocate (positions, source=pack([(h, h=1, size(weight))], weight > threshold .or. is_mean))
   end subroutine find_carrying

   !> If disturbances grow within a period of a slow tone before they decay, so does the residual of a solution, in
   !> harmonics of that tone far beyond those of the error estimate: its estimate is increased by the growth.
   subroutine allow_for_growth(result, limit)
      type(motion_result_t), intent(inout) :: result
      real(wp), intent(in) :: limit                                   !! of the estimated error of a motion that is `converged`

      if (result%stability%growth <= 1.0_wp) return
      result%level_estimate = max(result%level_estimate, min(1.0_wp, result%stability%growth* &
                                                             hypot(result%error_estimate%truncation, &
                                                                   result%error_estimate%aliasing)))
      if (result%status /= outcome%converged .or. result%level_estimate <= limit) return
      result%status = outcome%truncated
      result%reason = reason%growth
      result%message = "the motion is extremely sensitive: its error may be "//rounded(result%level_estimate)//" of it, "// &
                       "because disturbances grow "//rounded(result%stability%growth)//" times within the slowest period"
   end subroutine allow_for_growth

   !> Calls the stability finder of the model, with the laws that the motion reaches; without one the stability is unknown. With
   !> it what the noise of the loads causes, at the output degrees of freedom.
   subroutine request_stability(system, options, config, motion, work_allowed, stability)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(stability_config_t), intent(in) :: config
      type(harmonic_motion_t), intent(in) :: motion
      real(wp), intent(in) :: work_allowed                            !! in about a nanosecond
      type(stability_t), intent(out) :: stability
      type(law_box_t), allocatable :: laws(:)
      real(wp), allocatable :: noise(:, :)                            ! forces

      if (system%normal_mode%is_requested .or. config%method == stability_method%off) return
      if (.not. allocated(options%callbacks%stability_finder)) return
      laws = system%laws
      if (.not. config%is_integrated) laws = reached_laws(laws, motion, max(max_gap_to_motion, estimate_safety* &
            options%error_estimate%truncation))
      call find_random_forces(system%loads, system%structure%n_dofs, noise)
      call options%callbacks%stability_finder%find(stability, config, motion, system%structure, laws, &
                                                   excitation_t(system%load_spectrum, options%integration%restitution, noise), &
                                                   work_allowed)
      if (size(noise) == 0) return
      if (stability%response%status == noise_status%none) stability%response%status = noise_status%no_equations
      call stability%response%select_dofs(options%output%dofs)
   end subroutine request_stability

   !> The tones of a model at the frequencies of a solution.
   type(tones_t) function tones_of(system, balance) result(tones)
      type(system_t), intent(in) :: system
      type(balance_t), intent(in) :: balance

      tones = system%tones
      tones%omega = balance%omega
   end function tones_of

   !> Approximate time of a usual point in nanoseconds, from counts alone, so that it is the same for all points of a
   !> sweep: the solution and its error estimate, with twice the order and the samples, in residuals.
   pure real(wp) function usual_work(balance) result(work)
      type(balance_t), intent(in) :: balance
      real(wp), parameter :: verdict_cost_in_residuals = 300.0_wp     ! of small models, measured

      work = verdict_cost_in_residuals*balance%residual_work
   end function usual_work

   !> Stores what follows from the motion alone, whether a balance or time integration has found it, at the output degrees of
   !> freedom.
   subroutine store_motion(options, whole, set, c, result)
      type(options_t), intent(in) :: options
      type(harmonics_t), intent(in) :: whole, set                     !! of the result; of the unknowns, a part of it
      complex(wp), intent(in) :: c(:, :)                              !! a - i b, (n_dofs, set%n_harmonics)
      type(motion_result_t), intent(inout) :: result                  !! without a motion
      integer :: i, positions(set%n_harmonics)

      allocate (result%coefficients(2, whole%n_harmonics, size(options%output%dofs)), source=0.0_wp)
      positions = whole%positions_of(set)
      do i = 1, size(options%output%dofs)                             ! a copy of all would take as much memory again
         result%coefficients(:, positions, i:i) = as_pairs(c(options%output%dofs(i:i), :))
      end do
   end subroutine store_motion

   !> Stores the forces of the laws and the motion corrected to walls, on the grid of the solution.
   subroutine store_forces(whole, basis, balance, u, result, error)
      type(harmonics_t), intent(in) :: whole                          !! of the result
      type(discretisation_t), intent(in) :: basis
      type(balance_t), intent(inout) :: balance
      real(wp), intent(in) :: u(:, :)
      type(motion_result_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error
      type(real_block_t) :: correction
      real(wp), allocatable :: coefficients(:, :), moved(:, :)
      real(wp) :: column(basis%harmonics%n_coefficients)
      integer :: i
      character(:), allocatable :: failure

      allocate (coefficients, mold=u)
      call balance%sample(u)
      call balance%law_set%evaluate()
      failure = trim(balance%law_set%memory_failure())
      if (len(failure) > 0) then
         call fail(error, failure)
         return
      end if
      associate (torus => basis%torus)
         if (balance%law_set%has_memory .and. .not. torus%is_half .and. all(modulo(sum(basis%harmonics%tuples, dim=1), 2) == 1) &
             .and. all(modulo(torus%n_samples, 2) == 0)) result%asymmetry = asymmetry(torus, balance%law_set%samples%f%values)
      end associate
      result%n_full_stick = count([(balance%law_set%full_stick(i), i=1, size(balance%law_set%laws))])
      call balance%project(balance%law_set%samples%f%values, coefficients)
      result%force_coefficients = as_pairs(whole%amplitudes(coefficients_in(whole, basis%harmonics, &
         balance%stiffness%coordinates%spread_forces(coefficients))))
      allocate (moved, source=balance%at_law_dofs(u))
      if (balance%law_set%needs_reaction) then
         call new_real_block(correction, size(balance%law_set%samples%q%values, 1), size(moved, 2), error)
         if (allocated(error)) return
         correction%values = 0.0_wp
         call balance%law_set%correct(balance%stiffness%coordinates, correction%values)
         do i = 1, size(moved, 2)
            call balance%project_one(correction%values(:, i:i), column)
            moved(:, i) = moved(:, i) + column
         end do
         call correction%destroy()
      end if
      result%corrected_coefficients = as_pairs(whole%amplitudes(coefficients_in(whole, basis%harmonics, moved)))
   end subroutine store_forces

   !> Stores the outputs whose accuracy is requested. The estimated error of each is its change when the first-order
   !> errors of the motion are removed; zero if the motion has none, because nothing moves at the laws.
   subroutine store_outputs(options, whole, set, c, result)
      type(options_t), intent(in) :: options
      type(harmonics_t), intent(in) :: whole, set                     !! as those of `store_motion`
      complex(wp), intent(in) :: c(:, :)                              !! a - i b, (all dofs, n_harmonics)
      type(motion_result_t), intent(inout) :: result
      integer :: i

      if (.not. allocated(options%accuracy%outputs)) return
      associate (outputs => options%accuracy%outputs, found => result%error_estimate)
         if (size(outputs) == 0) return
         allocate (result%outputs(whole%n_harmonics, size(outputs)), source=(0.0_wp, 0.0_wp))
         allocate (result%output_estimate(size(outputs)), &
                   source=merge(1.0_wp, 0.0_wp, max(found%truncation, found%aliasing) > 0.0_wp))
         allocate (result%output_level_estimate(size(outputs)), source=0.0_wp)
         do i = 1, size(outputs)
            result%outputs(whole%positions_of(set), i) = c(outputs(i)%dof, :)
            if (allocated(found%refined)) result%output_estimate(i) = min(1.0_wp, &
               outputs(i)%distance(set, c(outputs(i)%dof, :), found%around, found%refined(outputs(i)%dof, :)))
         end do
      end associate
   end subroutine store_outputs

   !> Computes the error estimate of a solved point; if it exceeds a threshold, the point receives the corresponding
   !> status.
   subroutine store_error_estimate(system, discretisation, options, solution, result, error)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in), target :: discretisation
      type(options_t), intent(in) :: options
      type(solution_t), intent(in) :: solution
      type(motion_result_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error
      type(wanted_motions_t) :: wanted
      integer :: i

      wanted%refined = system%structure%n_dofs <= max_dense .and. &   ! for stability
         any([(system%laws(i)%law%n_switches + system%laws(i)%law%n_states > 0, i=1, size(system%laws))])
      if (allocated(options%accuracy%outputs)) wanted%refined = wanted%refined .or. size(options%accuracy%outputs) > 0
      wanted%improvement_steps = options%error_estimate%improvement_steps
      wanted%acceptable = options%error_estimate%truncation
      if (options%accuracy%is_on) wanted%acceptable = options%accuracy%tolerance
      if (associated(solution%problem)) then
         call estimate_error(result%error_estimate, system%structure, &
                             system%loads_in(solution%basis%harmonics), solution%balance, solution%u, wanted, error, &
                             solution%problem)
      else
         call estimate_error(result%error_estimate, system%structure, &
                             system%loads_in(solution%basis%harmonics), solution%balance, solution%u, wanted, error)
      end if
      if (allocated(error)) return
      if (allocated(result%error_estimate%improved)) call store_improved(discretisation%harmonics, result, error)
      if (allocated(error)) return
      associate (found => result%error_estimate, limit => options%error_estimate)
         result%penetration_share = found%defects%penetration/(limit%penetration*max(maxval(abs(solution%u)), tiny(1.0_wp)))
         if (result%penetration_share > 1.0_wp) result%status = outcome%penetrating
         if (is_missed(found%truncation, limit%truncation)) result%status = outcome%truncated
         if (any(is_missed(found%frequency_error/solution%balance%omega, limit%truncation))) result%status = outcome%truncated
         if (is_missed(found%aliasing, limit%aliasing)) result%status = outcome%aliased
         if (found%impact > limit%impact .and. .not. system%normal_mode%is_requested) & ! a free motion loses no energy
            result%status = outcome%impact                            ! a larger set does not help
         if (any(system%tones%is_unknown) .and. options%lacks_impacts_of(system, result%status)) then
            result%message = "the restitution of walls has no effect on motions with unknown tones, which are not integrated "// &
                             "with impacts"
            call result%advice%add(advice%given_tones)
         end if
         if (.not. all(ieee_is_finite([found%power_in, found%energy%lost, found%power_laws]))) &
            result%status = outcome%not_finite
         result%is_near_commensurate = system%tones%n_tones > 1 .and. &
            found%combination_frequency < limit%commensurability*maxval(solution%balance%omega)
      end associate
   end subroutine store_error_estimate

   !> The improved motion with all tuples of the wider set.
   subroutine store_improved(set, result, error)
      type(harmonics_t), intent(in) :: set                            !! of the motion
      type(motion_result_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error
      type(harmonics_t) :: wider
      real(wp), allocatable :: improved(:, :)

      call choose_wider_set(set, wider, error)
      if (allocated(error)) return
      associate (found => result%error_estimate)
         allocate (improved, source=coefficients_in(wider, found%wider, found%improved))
         result%improved_coefficients = as_pairs(wider%amplitudes(improved))
         call move_alloc(improved, found%improved)
         found%wider = wider
      end associate
   end subroutine store_improved

   !> Whether an estimate is above its limit, or NaN because a law is outside its domain.
   elemental logical function is_missed(estimate, limit)
      real(wp), intent(in) :: estimate, limit

      is_missed = .true.
      if (ieee_is_finite(estimate)) is_missed = estimate > limit
   end function is_missed

   !> Stores hypertime surfaces on the grid that the user requested.
   subroutine store_surfaces(system, options, basis, balance, u, result, error)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(discretisation_t), intent(in) :: basis
      type(balance_t), intent(in) :: balance
      real(wp), intent(in) :: u(:, :)
      type(motion_result_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error
      class(balance_t), allocatable :: shown
      class(linear_part_t), allocatable :: linear
      type(real_block_t) :: samples
      type(torus_t) :: torus
      type(transform_t) :: transform

      call new_torus(torus, options%output%samples, basis%harmonics, error)
      if (allocated(error)) return
      torus%corrects_kinks = .false.                                  ! uncorrected forces
      associate (coordinates => balance%stiffness%coordinates)
         allocate (shown)
         allocate (linear, source=balance%stiffness)
         call new_balance(shown, basis%harmonics, torus, balance%omega, linear, laws_at(coordinates, system%laws), &
                          error)
         if (.not. allocated(error)) call new_real_block(samples, torus%n_total, size(coordinates%dofs), error)
         if (.not. allocated(error)) &
            call new_transform(transform, basis%harmonics, torus, size(coordinates%dofs), error)
         if (.not. allocated(error)) then
            call shown%sample(u)
            call shown%law_set%evaluate()
            call transform%to_samples(shown%at_law_dofs(u), samples%values)
            result%displacement_samples = samples%values
            result%force_samples = coordinates%spread_forces(shown%law_set%samples%f%values)
            result%corrected_samples = result%displacement_samples
            call shown%law_set%correct(coordinates, result%corrected_samples)
         end if
      end associate
      call transform%destroy()
      call samples%destroy()
      call shown%destroy()
   end subroutine store_surfaces
end module hb_motion_description
