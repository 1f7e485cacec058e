!> Motion by time integration to a tolerance: its tuples are determined from the record.
!> The record of the time integration is fitted by many candidate tuples (hb_line_fit); the important ones form the
!> set. The estimated error is the misfit of this series in a part of the record that the fit does not use. The model
!> is integrated either before any balance is tried, from rest, or from the motion at which the sequence of orders of
!> the balance ended above the tolerance: that motion is nearly steady from the beginning.
module hb_integrate_to_tolerance
   use hb_amplitudes, only: amplitudes_t
   use hb_budget, only: budget_t, is_spent
   use hb_cancellation, only: verdict, verdict_on_work, work_is_over
   use hb_coordinates, only: coordinates_t
   use hb_discretisation, only: discretisation_t
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t, new_harmonics
   use hb_integrated_result, only: guess_from, note_unsteady, store_integrated
   use hb_kinds, only: wp
   use hb_law, only: hold_t
   use hb_level, only: check_discretisation, degree_of, distance, estimate_of, is_rigid, level_t
   use hb_modes, only: slowest_decay
   use hb_motion, only: start_from
   use hb_motion_description, only: request_stability
   use hb_motion_in_basis, only: status_of_ended
   use hb_motion_result, only: motion_result_t
   use hb_options, only: options_t, share_of_integrated
   use hb_outcome, only: is_integrated, outcome, reason
   use hb_point_budget, only: budget_of, point_budget_t
   use hb_primary_method, only: integration_counts_t, integration_is_cheaper, primary_method
   use hb_refinement, only: refinable_t, refine
   use hb_spectrum, only: spectrum_t
   use hb_stability, only: few_periods, harmonic_motion_t, stability_config_t, stability_method, stability_t, &
      stability_verdict => verdict
   use hb_steady_motion, only: steady_motion_t
   use hb_structure, only: max_dense, structure_t
   use hb_system, only: coordinates_of, measure_of, system_t
   use hb_text, only: rounded, to_text
   use hb_thresholds, only: estimate_safety, max_reliable_error, well_solved
   use hb_torus, only: samples_for
   use hb_tuple_choice, only: largest_indices, lowest_order, new_lowest_set
   implicit none
   private
   public :: driven_tuples, integrate_from_balance, integrate_to_tolerance, integrates_first, status_within, store_lines

   integer, parameter :: candidates_of_retained = 4                   ! at most, for each tuple of a set
   real(wp), parameter :: order_growth_power = 0.7_wp                 ! power of the tolerance with which orders of candidates grow
   real(wp), parameter :: fall_of_one_tone = 0.4_wp                   ! likewise: with one tone a larger box is cheap
   real(wp), parameter :: share_of_tail = 0.3_wp                      ! of the tolerance, in omitted tuples; the rest is the misfit

   !> A motion found by time integration whose candidates for a set are refined.
   type, extends(refinable_t) :: refined_record_t
      type(system_t), pointer :: system => null()
      type(discretisation_t) :: discretisation                        ! with the candidates tried last
      type(options_t) :: options                                      ! with the aim of the integration
      type(coordinates_t) :: coordinates
      type(harmonics_t) :: candidates
      integer :: order = 1                                            ! of their box
      integer :: capacity = 0                                         ! most tuples of a set
      integer :: n_found = 0                                          ! motions
      type(budget_t) :: budget
      type(steady_motion_t) :: steady                                ! of the best motion, otherwise of the first candidates
      type(motion_result_t) :: result
      type(level_t) :: found
      logical :: is_ended = .false.                                   ! a larger box cannot be better
   contains
      procedure :: solve => refined_record_solve
      procedure :: choose => refined_record_choose
      procedure :: is_accurate => refined_record_is_accurate
      procedure :: is_over => refined_record_is_over
   end type refined_record_t

contains

   !> Whether time integration precedes the balance: because it is requested, or because its estimated work is
   !> smaller.
   logical function integrates_first(system, options)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(hold_t) :: hold
      type(integration_counts_t) :: counts
      type(structure_t) :: structure
      integer :: i

      integrates_first = options%primary_method == primary_method%integration
      if (options%primary_method /= primary_method%auto .or. system%tones%n_tones /= 1 .or. any(system%tones%is_unknown)) return
      if (.not. is_rigid(system) .or. .not. options%accuracy%grows_set .or. size(options%accuracy%outputs) > 0) return
      if (system%structure%n_dofs > max_dense .or. options%chain%is_on) return
      structure = system%structure
      call structure%unpack()
      counts%n_dofs = structure%n_dofs
      counts%n_coordinates = size(system%laws)
      counts%max_harmonics = options%accuracy%max_harmonics
      counts%tolerance = options%accuracy%tolerance
      counts%omega = system%tones%omega(1)
      do i = 1, size(system%laws)
         if (.not. system%laws(i)%law%is_multiplier) cycle
         hold = system%laws(i)%law%hold()
         counts%has_walls = counts%has_walls .or. hold%is_wall
      end do
      counts%decay = slowest_decay(structure%mass, structure%damping, structure%stiffness)
      counts%fastest = maxval([(sqrt(abs(structure%stiffness(i, i))/max(abs(structure%mass(i, i)), tiny(1.0_wp))), &
                                i=1, structure%n_dofs)])
      integrates_first = integration_is_cheaper(counts)
   end function integrates_first

   !> Integrates from rest or the given amplitudes. `is_done` is false if no motion is found.
   subroutine integrate_to_tolerance(system, discretisation, options, result, is_done)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(motion_result_t), intent(inout) :: result
      logical, intent(out) :: is_done
      type(motion_result_t) :: integrated
      type(level_t) :: found
      type(steady_motion_t) :: steady

      is_done = .false.
      if (.not. can_integrate(system, options)) return
      integrated%integration_work = result%integration_work
      integrated%work_spent = result%work_spent
      call integration(system, discretisation, options, steady, integrated, found)
      is_done = work_is_over() .or. steady%status /= outcome%pending
      if (.not. is_done) then
         call note_unsteady(steady, .false., result)
         return
      end if
      integrated%is_integrated_first = result%work <= 0.0_wp
      integrated%work = integrated%work + result%work
      call adopt_status(options, steady, integrated)
      if (work_is_over()) integrated%status = status_of_ended()
      result = integrated
   end subroutine integrate_to_tolerance

   !> Integrates from the motion at which the sequence of orders ended above the tolerance, and accepts the result if
   !> it is closer to the tolerance, or within it another one to which a motion that is not stable leads.
   !> Otherwise the result is unchanged, with a message on the outcome of the time integration. If walls with a given
   !> restitution are struck, the integrated motion is always accepted.
   subroutine integrate_from_balance(system, discretisation, options, result, top, is_other)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(motion_result_t), intent(inout) :: result                  !! of the sequence of orders, `truncated` or `impact`
      type(level_t), intent(inout) :: top                             !! its last level; of the other motion if that is accepted
      logical, intent(out) :: is_other                                !! another motion is accepted
      type(motion_result_t) :: integrated
      type(level_t) :: found
      type(options_t) :: from                                         ! with the motion of the level as the start
      type(steady_motion_t) :: steady
      real(wp) :: apart, estimate, estimate_before
      logical :: is_struck, is_there

      is_other = .false.
      if (.not. (options%solver%fallback .and. options%solver%fallback_by_integration .and. can_integrate(system, options))) &
         return
      if (allocated(result%output_estimate)) return                   ! time integration has no estimates of outputs
      from = options
      call start_on(system, options, top, from%start%spectrum, is_there)
      if (.not. is_there) return
      integrated%work_spent = result%work_spent
      call integration(system, discretisation, from, steady, integrated, found)
      result%work = result%work + steady%work
      if (verdict_on_work() == verdict%interrupted) result%status = outcome%interrupted
      if (work_is_over()) return                      ! there is a motion even without time left
      is_struck = options%lacks_impacts_of(system, result%status)
      if (steady%status == outcome%pending .or. .not. (is_struck .or. allocated(integrated%coefficients))) then
         call describe_lost(system, options, steady, is_struck, result)
         return
      end if
      estimate_before = estimate_of(result)
      apart = 0.0_wp
      if (.not. is_struck) then                                       ! then it is the same motion
         estimate = estimate_of(integrated)
         apart = distance(top, found, measure_of(system), .false.)
         is_other = estimate_before < max_reliable_error .and. apart > estimate_safety*(estimate + estimate_before)
         if (is_other) then                                           ! a stable one may have a basin smaller than its error
            if (estimate > options%accuracy%tolerance .or. is_stable(system, discretisation, from, steady%work)) then
               result%message = "time integration from this motion leads to another one, relative distance "//rounded(apart)
               is_other = .false.
               return
            end if
         else if (estimate >= estimate_before) then
            return
         end if
      end if
      call adopt_status(options, steady, integrated)
      integrated%effort_t = result%effort_t
      integrated%level_difference = apart
      if (is_struck) then
         integrated%message = integrated%message//"; with impacts on a wall"
      else if (is_other) then
         integrated%message = integrated%message//"; reached from another motion of the balance, which is not stable, with "// &
                              "estimated error "//rounded(estimate_before)//", relative distance "//rounded(apart)
         top = found
      else
         integrated%message = integrated%message//"; started from a balance with estimated error "//rounded(estimate_before)
      end if
      result = integrated
   end subroutine integrate_from_balance

   !> Whether disturbances of the motion at the start are known to decay: of one tone those of the periodic motion next to it.
   logical function is_stable(system, discretisation, options, max_work)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      real(wp), intent(in) :: max_work                                !! in about a nanosecond
      type(stability_config_t) :: config
      type(stability_t) :: stability

      config = options%stability
      config%method = stability_method%auto
      config%patience = 1.0_wp
      config%min_periods = few_periods
      config%is_integrated = .true.
      associate (start => options%start%spectrum)
         call request_stability(system, options, config, harmonic_motion_t(start%tuples, system%tones, start%values), max_work, &
                                stability)
      end associate
      is_stable = stability%verdict == stability_verdict%stable
   end function is_stable

   !> Describes why time integration from a balance has found no motion with a series, and discards that of the balance if it does
   !> not persist, as where it leads to pull-in, or is none by its estimate.
   subroutine describe_lost(system, options, steady, is_struck, result)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(steady_motion_t), intent(in) :: steady
      logical, intent(in) :: is_struck                                !! the balance strikes walls with a given restitution
      type(motion_result_t), intent(inout) :: result                  !! of the balance, with the work of the integration
      logical :: is_known                                             ! larger sets bring no gain, but its estimate is one
      character(:), allocatable :: message

      if (steady%is_at_pole .and. .not. is_struck) then
         message = "a motion of the balance, with estimated error "//rounded(estimate_of(result))//", does not persist: "// &
                   steady%message
         call result%forget_motion()
         result%message = message
         result%reason = reason%none
         result%status = outcome%law_undefined
         return
      end if
      if (steady%is_out_of_work .and. steady%status == outcome%pending .and. .not. is_struck .and. &
          needs_larger_set(system, options, result, result%work - steady%work)) then
         result%message = "the search for a larger set"//is_spent//", and so has a time integration from this motion"
         return
      end if
      is_known = result%reason == reason%tolerance .and. estimate_of(result) < max_reliable_error
      if (allocated(steady%message)) then
         if (is_known .and. allocated(result%message)) then
            result%message = result%message//"; "//steady%message
         else
            result%message = steady%message
         end if
      end if
      if (steady%is_out_of_work .and. steady%status /= outcome%subharmonic .and. .not. is_known) &
         result%reason = reason%max_fallback_work
      if (is_struck .and. steady%is_out_of_work) result%status = outcome%out_of_budget
      if (steady%status == outcome%subharmonic .or. &
          (steady%status == outcome%broadband .and. estimate_of(result) >= max_reliable_error)) then
         call result%forget_motion()                               ! it is not a motion by its estimate, or does not persist
         result%reason = reason%none
         result%status = steady%status
         result%n_periods = steady%n_repeat
      else if (steady%status == outcome%broadband) then
         result%reason = reason%departure
      end if
   end subroutine describe_lost

   !> Whether larger sets ended for lack of work where a longer time integration helps less: the lines of three tones are so close
   !> that ten times its work separates none.
   pure logical function needs_larger_set(system, options, result, work) result(needs)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(motion_result_t), intent(in) :: result                     !! of the sequence of orders
      real(wp), intent(in) :: work                                    !! of its solutions, in about a nanosecond
      integer, parameter :: many_tones = 3                            ! tones
      type(point_budget_t) :: budget

      budget = budget_of(options, result)
      needs = system%tones%n_tones >= many_tones .and. estimate_of(result) < max_reliable_error .and. &
         (work > budget%levels%limit .or. budget%whole%left() <= 0.0_wp)
   end function needs_larger_set

   !> Status of an integrated motion, and the number of periods after which it repeats.
   pure subroutine adopt_status(options, steady, result)
      type(options_t), intent(in) :: options
      type(steady_motion_t), intent(in) :: steady
      type(motion_result_t), intent(inout) :: result

      result%status = steady%status
      result%n_periods = steady%n_repeat
      if (allocated(result%coefficients)) result%status = status_within(options, steady, result)
      if (result%status == outcome%truncated) result%reason = merge(reason%max_fallback_work, reason%tolerance, &
                                                                    steady%is_out_of_work)
   end subroutine adopt_status

   !> Status of an integrated motion: converged if its estimate is within the tolerance.
   pure integer function status_within(options, steady, result) result(status)
      type(options_t), intent(in) :: options
      type(steady_motion_t), intent(in) :: steady
      type(motion_result_t), intent(in) :: result

      status = merge(steady%status, outcome%truncated, estimate_of(result) <= options%accuracy%tolerance)
   end function status_within

   !> Whether an integrated motion is acceptable.
   pure logical function can_integrate(system, options)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options

      can_integrate = options%accuracy%grows_set .and. size(system%laws) > 0 .and. &
         .not. any(system%tones%is_unknown) .and. .not. system%normal_mode%is_requested
   end function can_integrate

   !> The motion of a level in all degrees of freedom.
   subroutine start_on(system, options, level, start, is_there)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(level_t), intent(in) :: level
      type(spectrum_t), intent(out) :: start
      logical, intent(out) :: is_there
      type(error_t), allocatable :: error

      call check_discretisation(system, level%discretisation_t, options, error)
      is_there = .not. allocated(error)
      if (is_there) call start_from(system, level%discretisation_t, options, level%unknowns, start, is_there)
   end subroutine start_on

   !> Integrates with candidates in a box, then in a box of twice the order if the misfit is too large, and stores the
   !> important tuples of the best one. Lines outside a small box appear as a motion that is not periodic; with
   !> several tones the larger box therefore decides. Without a motion only its description is returned.
   subroutine integration(system, discretisation, options, steady, result, found)
      type(system_t), intent(in), target :: system
      type(discretisation_t), intent(in), target :: discretisation
      type(options_t), intent(in) :: options
      type(steady_motion_t), intent(out) :: steady
      type(motion_result_t), intent(inout) :: result
      type(level_t), intent(out) :: found                             !! its set and motion
      type(refined_record_t) :: record
      type(point_budget_t) :: budget

      record%system => system
      record%discretisation = discretisation
      record%options = options
      record%options%integration%aim = sqrt(1.0_wp - share_of_tail**2)*options%accuracy%tolerance
      record%options%integration%tolerance = max(options%integration%tolerance, well_solved*record%options%integration%aim)
      record%options%error_estimate%truncation = min(options%error_estimate%truncation, options%accuracy%tolerance)
      record%coordinates = coordinates_of(system)
      record%capacity = share_of_integrated*options%accuracy%max_harmonics
      record%order = first_order(system, options, candidates_of_retained*record%capacity)
      budget = budget_of(options, result)
      record%budget = budget%of_record(result%integration_work, decides_rarely=system%tones%n_tones > 2 .and. &
                                       options%primary_method /= primary_method%integration)
      record%max_failures = huge(1)
      record%result = result
      call new_lowest_set(record%candidates, system%tones%n_tones, driven_tuples(system, options), record%error, record%order)
      if (.not. allocated(record%error)) call refine(record)
      steady = record%steady
      steady%work = record%budget%spent
      found = record%found
      result = record%result
      result%work = record%budget%spent
      result%integration_work = record%budget%spent
      result%n_motions = steady%n_motions
      if (allocated(steady%message)) result%message = steady%message
   end subroutine integration

   !> Integrates with the candidates chosen last, and stores the motion if it is the best so far.
   subroutine refined_record_solve(self, is_solved)
      class(refined_record_t), intent(inout) :: self
      logical, intent(out) :: is_solved
      type(motion_result_t) :: result
      type(level_t) :: found
      type(steady_motion_t) :: steady

      is_solved = .false.
      self%discretisation%harmonics = self%candidates
      self%options%integration%max_work = 0.5_wp*self%budget%left()
      call self%options%callbacks%time_domain_solver%find_steady_motion(self%system, self%discretisation, self%options, &
                                                                        self%coordinates%dofs, steady, self%error)
      call self%budget%spend(steady%work)
      steady%work = self%budget%spent
      if (allocated(self%error)) then
         if (self%n_levels > 0) return
         self%steady%message = "integration: "//self%error%message
         self%steady%is_out_of_work = steady%is_out_of_work
         self%steady%is_at_pole = steady%is_at_pole
         return
      end if
      if (self%n_found == 0 .and. .not. (self%steady%status == outcome%subharmonic .and. steady%status == outcome%pending)) &
         self%steady = steady
      is_solved = is_integrated(steady%status)
      self%is_ended = .not. (is_solved .or. any(steady%status == [outcome%subharmonic, outcome%broadband]) .and. &
                             .not. shows_returns(self%system, self%options))
      if (work_is_over() .or. .not. is_solved) return
      result = self%result
      call store_lines(self%system, self%discretisation, self%options, self%coordinates, self%capacity, steady, result, found)
      self%n_found = self%n_found + 1
      if (self%n_found == 1 .or. estimate_of(result) < self%estimate) then
         self%steady = steady
         self%result = result
         self%found = found
         self%estimate = estimate_of(result)
      end if
      self%result%n_levels = self%n_found
      self%is_ended = steady%change_by_steps > self%options%accuracy%tolerance ! a larger box cannot reduce this
   end subroutine refined_record_solve

   !> Chooses the candidates in a box of twice the order, within the limits of size and work.
   subroutine refined_record_choose(self, is_there)
      class(refined_record_t), intent(inout) :: self
      logical, intent(out) :: is_there

      is_there = .false.
      self%order = 2*self%order
      call new_lowest_set(self%candidates, self%system%tones%n_tones, driven_tuples(self%system, self%options), self%error, &
                          self%order)
      if (allocated(self%error)) return
      if (self%candidates%n_harmonics > candidates_of_retained*self%capacity) return
      is_there = self%budget%left() > 0.0_wp
      if (.not. is_there .and. self%n_found == 0 .and. self%steady%status /= outcome%subharmonic) &
         call leave_open(self%steady, self%discretisation%harmonics%n_harmonics)
   end subroutine refined_record_choose

   logical function refined_record_is_accurate(self) result(is_accurate)
      class(refined_record_t), intent(inout) :: self

      is_accurate = self%estimate <= self%options%accuracy%tolerance
   end function refined_record_is_accurate

   logical function refined_record_is_over(self) result(is_over)
      class(refined_record_t), intent(inout) :: self

      is_over = self%is_ended .or. work_is_over()
   end function refined_record_is_over

   !> Whether the first box shows the period of the motion: lines outside it are multiples of the only tone, and
   !> contribute no difference from one period to the next if the period is a whole number of samples.
   pure logical function shows_returns(system, options)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options

      shows_returns = system%tones%n_tones == 1 .and. options%integration%step <= 0.0_wp
   end function shows_returns

   !> Leaves the verdict open: the misfit may consist of lines of the next box, for which no work is left.
   subroutine leave_open(steady, n_candidates)
      type(steady_motion_t), intent(inout) :: steady
      integer, intent(in) :: n_candidates

      steady%status = outcome%pending
      steady%is_out_of_work = .true.
      steady%message = "time integration over "//to_text(steady%n_periods)//" periods of the slowest tone: a series of "// &
                        to_text(n_candidates)//" harmonics has the relative residual "//rounded(steady%spread)// &
                        " (worst quarter of the record), and the time integration"//is_spent
   end subroutine leave_open

   !> Order of the first box of candidates: with one tone or a coarse tolerance it has fewer candidates than
   !> permitted.
   pure integer function first_order(system, options, most)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      integer, intent(in) :: most                                     !! candidates

      associate (n_tones => system%tones%n_tones, tolerance => options%accuracy%tolerance)
         first_order = min(ceiling(min(1.0e6_wp, tolerance**(-merge(fall_of_one_tone, order_growth_power, n_tones == 1)))), &
                           int(0.5_wp*((2.0_wp*most)**(1.0_wp/n_tones) - 1.0_wp)))
         first_order = max(first_order, lowest_order(n_tones))
      end associate
   end function first_order

   !> Selects the important candidates, and the motion in them. The estimate includes the others.
   subroutine store_lines(system, discretisation, options, coordinates, capacity, steady, result, found)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation            !! of all candidates
      type(options_t), intent(in) :: options
      type(coordinates_t), intent(in) :: coordinates
      integer, intent(in) :: capacity                                 !! tuples
      type(steady_motion_t), intent(in) :: steady
      type(motion_result_t), intent(inout) :: result
      type(level_t), intent(out) :: found
      type(error_t), allocatable :: error
      type(steady_motion_t) :: retained
      real(wp) :: carried(discretisation%harmonics%n_harmonics), tail
      logical :: is_retained(discretisation%harmonics%n_harmonics), is_needed(discretisation%harmonics%n_harmonics)
      integer, allocatable :: positions(:)
      type(amplitudes_t) :: loads
      integer :: h, k

      carried = 0.0_wp
      do k = 1, size(steady%averages, 2)
         carried = max(carried, abs(steady%averages(:, k))/max(norm2(abs(steady%averages(:, k))), tiny(1.0_wp)))
      end do
      loads = system%loads_in(discretisation%harmonics)
      is_needed = [(sum(abs(discretisation%harmonics%tuples(:, h))) <= 1 .or. &
                    .not. loads%is_zero_at(h), h=1, size(carried))]
      tail = share_of_tail*options%accuracy%tolerance
      allocate (positions, source=largest_indices(merge(huge(1.0_wp), carried, is_needed), tail, capacity))
      is_retained = .false.
      is_retained(positions) = .true.
      tail = norm2(pack(carried, .not. is_retained))
      found%discretisation_t = discretisation
      call new_harmonics(found%harmonics, discretisation%harmonics%tuples(:, positions), error)
      if (allocated(error)) return                                    ! impossible: they are tuples of a set
      call found%torus%resample(samples_for(found%harmonics%highest, degree_of(system)))
      retained = steady
      retained%amplitudes = steady%amplitudes(:, positions)
      retained%averages = steady%averages(positions, :)
      call store_integrated(system, found%discretisation_t, options, coordinates, retained, result)
      result%error_estimate%truncation = min(1.0_wp, hypot(steady%spread, tail))
      found%unknowns = guess_from(system, found%discretisation_t, coordinates, retained)
      result%harmonics = found%harmonics
      result%n_samples = found%torus%n_samples
   end subroutine store_lines

   !> Tuples that have a load or a first guess.
   pure function driven_tuples(system, options) result(tuples)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      integer, allocatable :: tuples(:, :)

      associate (loads => system%load_spectrum%nonzero_tuples(), start => options%start%spectrum%nonzero_tuples())
         tuples = reshape([loads, start], [system%tones%n_tones, size(loads, 2) + size(start, 2)])
      end associate
   end function driven_tuples
end module hb_integrate_to_tolerance
