!> A-posteriori error estimate of a solution, and its defects in the laws between samples.
!> A small residual only shows that the truncated, sampled problem is solved. The error estimate evaluates the same
!> motion with about twice the order on a finer grid: the unbalanced forces there are what the solution neglects, and
!> one step towards balancing them estimates its error. The estimate depends on the motion, its set and its grid
!> alone, not on how they were found. Source: docs/why/theory.md, section 7.
module hb_error_estimate
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_amplitudes, only: amplitudes_t
   use hb_balance, only: balance_t, new_balance
   use hb_bordered, only: bordered_problem_t
   use hb_cancellation, only: verdict, verdict_on_work
   use hb_dynamic_stiffness, only: dynamic_stiffness_t, new_contact_stiffness, new_dynamic_stiffness, wanted_slopes_t
   use hb_error, only: error_t, fail
   use hb_estimated_errors, only: error_estimate_t, wanted_motions_t
   use hb_harmonics, only: canonical_sign, coefficients_in, harmonics_t
   use hb_impact_energy, only: impact_energy
   use hb_kinds, only: wp
   use hb_law_measure, only: law_measure_t, new_law_measure
   use hb_linear_part, only: linear_part_t, new_linear_part
   use hb_mean_energy, only: new_mean_energy
   use hb_newton, only: solve_newton
   use hb_outcome, only: outcome
   use hb_phase, only: phase_problem_t
   use hb_problem, only: problem_t
   use hb_solver, only: solve
   use hb_solver_types, only: report_t, solver_config_t
   use hb_structure, only: structure_t
   use hb_tangent_solver, only: new_tangent_solver, tangent_solver_t
   use hb_thresholds, only: equality_tolerance, nearby_steps, rounding_level, small_share, well_solved
   use hb_tones, only: new_tones, tones_t
   use hb_torus, only: torus_t
   use hb_weak_direction, only: weak_direction_t
   use hb_wide_problem, only: are_walls_struck, clearly_smaller, has_multipliers, has_walls, new_wide_problem, slightly_later, &
      wide_problem_t
   use hb_wider_discretisation, only: choose_wider
   implicit none
   private
   public :: estimate_error, estimate_linear_error, near_commensurate

   !> Error over its change from an order to twice the order, if it falls with the first power of the order, as under rigid
   !> friction.
   real(wp), parameter :: of_first_power = 2.0_wp
   !> Likewise, change from a grid to one of four times the samples over that to one of twice as many: errors that fall so slowly
   !> are estimated as with one tone, others up to 2.3 times too large.
   real(wp), parameter :: of_first_power_of_grid = 1.5_wp

   !> Response of the motion's tangent to what a step in the wider set leaves, relative to the step, above which linear steps do not
   !> show the error: an equation x - k x**2 = e has no solution above 1/4.
   real(wp), parameter :: max_growth = 0.2_wp

contains

   !> Computes the error estimate of the motion `u` (n_coefficients, n_dofs) of a balance, and the requested motions.
   subroutine estimate_error(self, structure, loads, balance, u, wanted, error, bordered)
      type(error_estimate_t), intent(out) :: self
      type(structure_t), intent(in) :: structure
      type(amplitudes_t), intent(in) :: loads                         !! [N]
      type(balance_t), intent(inout), target :: balance
      real(wp), intent(in) :: u(:, :)                                 !! [m]
      type(wanted_motions_t), intent(in) :: wanted
      type(error_t), allocatable, intent(out) :: error
      class(bordered_problem_t), intent(inout), optional :: bordered !! on this balance: with its unknown tones, or a curve of which
                                                                      !! the motion is a point: errors along its last form, and
                                                                      !! along a null vector where another one crosses, do not count
      complex(wp), allocatable :: c(:, :)
      logical :: is_fine, needs_grid
      type(balance_t), target :: wide                                 ! not `allocatable`: several kB, for each point
      type(harmonics_t) :: set
      type(law_measure_t) :: measure
      type(tones_t) :: tones
      type(torus_t) :: grid

      self%wanted = wanted
      call new_tones(tones, balance%omega, error)
      if (allocated(error)) return
      allocate (self%frequency_error(tones%n_tones), source=0.0_wp)
      call near_commensurate(tones, self%combination, self%combination_frequency)
      is_fine = needs_fine_grid(balance, u, has_unknown_tones(bordered))
      call new_law_measure(measure, structure, balance%stiffness%coordinates, balance%law_set%laws, balance%omega)
      call measure%relate_to(u, stiffest_response(balance))
      call choose_wider(balance, balance%harmonics%norms(measure%seen(u)), self%combination, is_fine, set, grid, error)
      if (allocated(error)) return
      call make_wide_balance(self, structure, loads, balance, set, grid, wide, error)
      if (.not. allocated(error)) call check_contact(self, structure, balance, wide, u, error)
      if (.not. allocated(error)) call estimate_errors(self, balance, wide, u, measure, is_fine, error, bordered)
      if (.not. allocated(error)) then
         needs_grid = any(is_unknown([self%truncation, self%aliasing])) .and. .not. wide%has_left_domain() ! no grid leads back
         needs_grid = needs_grid .or. has_multipliers(balance) .and. balance%harmonics%n_tones == 1
         if (needs_grid .and. .not. (present(bordered) .or. is_interrupted())) &
            call solve_on_finer_grid(self, balance, wide, u, measure, is_fine, error)
         if (is_unknown(self%truncation)) self%truncation = 1.0_wp
         if (is_unknown(self%aliasing)) self%aliasing = 1.0_wp
      end if
      if (.not. allocated(error)) then
         allocate (c(structure%n_dofs, balance%harmonics%n_harmonics))
         call balance%all_dofs(u, c)
         self%power_in = loads%power_into(c, balance%frequencies)
         call new_mean_energy(self%energy, structure, c, balance%frequencies)
      end if
      if (associated(balance%cached_wide) .and. .not. allocated(balance%stiffness%contacts)) &
         call balance%cached_wide%give_back(wide%stiffness, wide%law_set)
      call wide%destroy()
   end subroutine estimate_error

   !> Creates the balance of the same motion in the wider set and on the finer grid.
   subroutine make_wide_balance(self, structure, loads, balance, set, grid, wide, error)
      type(error_estimate_t), intent(in) :: self
      type(structure_t), intent(in) :: structure
      type(amplitudes_t), intent(in) :: loads                         !! [N]
      type(balance_t), intent(in) :: balance
      type(harmonics_t), intent(in) :: set
      type(torus_t), intent(in) :: grid
      type(balance_t), intent(inout) :: wide                          !! a new one
      type(error_t), allocatable, intent(out) :: error
      type(dynamic_stiffness_t) :: stiffness
      class(linear_part_t), allocatable :: linear
      type(amplitudes_t) :: wide_loads
      logical :: is_covered, of_interior

      of_interior = self%wanted%improvement_steps > 0 .or. keeps_all(self, balance)
      wide_loads = loads%in_set(balance%harmonics, set)
      if (allocated(balance%stiffness%contacts)) then
         associate (flexibility => balance%stiffness%contacts%flexibility, frequencies => set%frequencies(balance%omega))
            call flexibility%cover(maxval(abs(frequencies)), is_covered)
            if (.not. is_covered) call fail(error, "error estimate: too many modes below its highest frequency; use a lower order")
            if (allocated(error)) return
            call new_contact_stiffness(stiffness, flexibility, frequencies, wide_loads)
         end associate
         allocate (linear)
         call new_linear_part(linear, stiffness)
      else if (associated(balance%cached_wide)) then
         balance%cached_wide%of_interior = of_interior
         call balance%cached_wide%borrow(structure, balance%stiffness%coordinates, set, set%frequencies(balance%omega), &
                                         wide_loads, linear, error)
         call balance%cached_wide%borrow_laws(wide%law_set)
      else
         call new_dynamic_stiffness(stiffness, structure, balance%stiffness%coordinates, set%frequencies(balance%omega), &
                                    wide_loads, error, wanted_slopes_t(of_interior=of_interior, &
                                                                       drives=set%frequencies(balance%xi*balance%omega)), &
                                    set%tuples)
         if (allocated(error)) return
         allocate (linear)
         call new_linear_part(linear, stiffness)
      end if
      if (allocated(error)) return
      call new_balance(wide, set, grid, balance%omega, linear, balance%law_set%laws, error)
   end subroutine make_wide_balance

   !> Computes the error estimate of a motion without laws: without errors, only powers and energies.
   subroutine estimate_linear_error(self, structure, tones, frequencies, loads, c)
      type(error_estimate_t), intent(out) :: self
      type(structure_t), intent(in) :: structure
      type(tones_t), intent(in) :: tones
      real(wp), intent(in) :: frequencies(:)                          !! j.omega [rad/s], (n_harmonics)
      type(amplitudes_t), intent(in) :: loads                         !! [N]
      complex(wp), intent(in) :: c(:, :)                              !! a - i b [m], as loads

      allocate (self%frequency_error(tones%n_tones), source=0.0_wp)
      allocate (self%power_laws(0), self%peak_force(0))
      call near_commensurate(tones, self%combination, self%combination_frequency)
      self%power_in = loads%power_into(c, frequencies)
      call new_mean_energy(self%energy, structure, c, frequencies)
   end subroutine estimate_linear_error

   !> Whether an estimate exceeds the motion itself, or is NaN.
   elemental logical function is_unknown(estimate)
      real(wp), intent(in) :: estimate

      is_unknown = .true.
      if (ieee_is_finite(estimate)) is_unknown = estimate > 1.0_wp
   end function is_unknown

   !> Repeats the estimate from the solution on the finer grid, if there is one nearby: aliasing is the difference.
   !> The few samples in contact with rigid laws, such as sticking under friction, may leave the tangent almost
   !> singular, or a different one if rounding decides whether a sample is in contact.
   subroutine solve_on_finer_grid(self, balance, wide, u, measure, is_fine, error)
      type(error_estimate_t), intent(inout) :: self
      type(balance_t), intent(in) :: balance
      type(balance_t), intent(inout) :: wide
      real(wp), intent(in) :: u(:, :)                                 !! [m], (n_coefficients, n_dofs)
      type(law_measure_t), intent(in) :: measure
      logical, intent(in) :: is_fine                                  !! the grid of `wide` is that of needs_fine_grid
      type(error_t), allocatable, intent(out) :: error
      class(balance_t), allocatable :: fine
      type(report_t) :: report
      type(solver_config_t) :: config
      class(linear_part_t), allocatable :: linear
      real(wp), allocatable :: x(:)
      real(wp) :: difference

      allocate (fine)
      allocate (linear, source=balance%stiffness)
      call new_balance(fine, balance%harmonics, wide%law_set%transform%torus, balance%omega, linear, balance%law_set%laws, &
                       error)
      if (.not. allocated(error)) then
         config%max_iterations = nearby_steps
         config%fallback = .false.
         x = reshape(u, [size(u)])
         call solve(fine, config, 0.0_wp*x, x, report)
         if (report%status == outcome%converged) then
            difference = measure%relative(reshape(x, shape(u)) - u)
            if (allocated(self%improved)) deallocate (self%improved)
            call estimate_errors(self, fine, wide, reshape(x, shape(u)), measure, is_fine, error)
            self%aliasing = difference
         end if
      end if
      call fine%destroy()
   end subroutine solve_on_finer_grid

   !> `equality_tolerance` times the response of the stiffest harmonic to the loads at each coordinate [m], (n_dofs): errors of
   !> smaller motions are relative to it.
   pure function stiffest_response(balance) result(response)
      type(balance_t), intent(in) :: balance
      real(wp) :: response(balance%n_dofs), stiffness
      integer :: h, i

      associate (linear => balance%stiffness, n => balance%harmonics%n_coefficients)
         do i = 1, balance%n_dofs
            stiffness = maxval([(abs(linear%entry(i, i, h)), h=1, balance%harmonics%n_harmonics)])
            response(i) = equality_tolerance*balance%r_scale(1 + (i - 1)*n)/max(stiffness, tiny(1.0_wp))
         end do
      end associate
   end function stiffest_response

   !> Aliasing: the change of the retained harmonics by the exact projection of the forces. Truncation: the further
   !> change of retained harmonics, others and unknown frequencies in the wider set. Both are `huge` if they are not found.
   subroutine estimate_errors(self, balance, wide, u, measure, is_fine, error, bordered)
      type(error_estimate_t), intent(inout) :: self
      type(balance_t), intent(inout), target :: balance
      type(balance_t), intent(inout), target :: wide
      real(wp), intent(in) :: u(:, :)
      type(law_measure_t), intent(in) :: measure
      logical, intent(in) :: is_fine                                  !! the grid of `wide` is that of needs_fine_grid
      type(error_t), allocatable, intent(out) :: error
      class(bordered_problem_t), intent(inout), optional, target :: bordered
      type(tangent_solver_t), target :: tangent
      type(wide_problem_t), target :: whole
      class(problem_t), pointer :: problem
      real(wp), allocatable :: alias(:), big(:, :), first(:), r(:), second(:), x(:)
      logical :: is_free, is_lost, is_smooth, needs_search

      if (all(u == 0.0_wp)) return
      self%truncation = huge(1.0_wp)
      self%aliasing = huge(1.0_wp)
      is_free = has_unknown_tones(bordered)
      call find_tangent(balance, u, problem, x, tangent, is_lost, bordered)
      select type (problem)
      class is (phase_problem_t)
         self%frequency_error(problem%tones) = balance%omega(problem%tones)
      end select
      if (is_lost .or. is_interrupted()) return
      allocate (big, source=coefficients_in(wide%harmonics, balance%harmonics, u))
      call new_wide_problem(whole, wide, balance, problem, tangent, measure)
      allocate (first(whole%n_unknowns), r(whole%n_unknowns), second(whole%n_unknowns), source=0.0_wp)
      call whole%find_residual(big, first, r, is_lost)
      if (is_lost .or. is_interrupted()) return
      call wide%factorise_mean_tangent(slightly_later(wide, big), error, without=balance%harmonics)
      if (allocated(error)) return
      alias = [r(whole%positions), r(size(big) + 1:)]
      call tangent%solve(problem, alias, is_lost)
      if (is_lost .or. is_interrupted()) return
      self%aliasing = measure%relative(reshape(alias(:size(u)), shape(u)))
      call whole%find_two_steps(big, r, acts_rigidly(balance, wide, is_free), first, second, is_lost)
      if (is_lost) return
      is_smooth = .not. (acts_rigidly(balance, wide, is_free) .or. has_multipliers(balance))
      if (is_smooth .and. .not. present(bordered) .and. whole%growth > max_growth) then
         associate (length => norm2([norm_of(first), norm_of(second)]))
            needs_search = length <= self%wanted%acceptable .and. whole%growth*length > rounding_level
         end associate
         if (needs_search) call find_along_weak_direction(whole, problem, tangent, measure, big, first, second, is_lost)
         if (is_lost) return
      end if
      call add_up_steps(measure, shape(big), whole%positions, alias(:size(u)), second, first, self%truncation)
      call allow_for_slow_convergence(self, balance, is_fine)
      call store_step(self, balance, wide, whole%which, big, first, alias(size(u) + 1:), measure)
      if (present(bordered) .and. .not. is_free) self%parameter_error = without_cancellation(alias(size(alias)), first(size(first)))
      self%n_products = whole%n_products
      ! an error above `small_share` is too large for one linear step
      if (acts_rigidly(balance, wide, is_free) .or. (is_free .and. self%truncation > small_share)) &
         call compare_with_half(self, balance, problem, x, size(u), measure)
      if (self%wanted%improvement_steps == 0 .or. present(bordered)) return ! the improvement uses constant frequencies
      self%wider = wide%harmonics
      call whole%improve(self%wanted%improvement_steps, big)
      self%improved = wide%at_law_dofs(big)

   contains

      pure real(wp) function norm_of(step)
         real(wp), intent(in) :: step(:)

         norm_of = measure%relative(reshape(step(:size(big)), shape(big)))
      end function norm_of
   end subroutine estimate_errors

   !> Replaces two steps by the one to the motion in the wider set that is reached along the weakest direction of the tangent, if
   !> this is clearly longer or shorter; `is_lost` if there is none within the size of the motion.
   subroutine find_along_weak_direction(whole, problem, tangent, measure, motion, first, second, is_lost)
      type(wide_problem_t), intent(in) :: whole
      class(problem_t), intent(inout), target :: problem
      type(tangent_solver_t), intent(inout), target :: tangent        !! of `problem`
      type(law_measure_t), intent(in) :: measure
      real(wp), intent(in) :: motion(:, :)                            !! in the wider set [m]
      real(wp), intent(inout) :: first(:), second(:)                  !! (n_unknowns)
      logical, intent(out) :: is_lost
      type(weak_direction_t) :: weak
      real(wp), parameter :: similar = 1.5_wp                         ! ratio of lengths up to which linear steps show the error
      real(wp) :: found(size(first)), linear
      logical :: is_possible

      is_lost = .false.
      call weak%border_by(whole, problem, tangent, is_possible)
      if (.not. is_possible) return
      call weak%find_motion(motion, measure%norm(motion), found, is_possible)
      is_lost = .not. is_possible
      if (is_lost) return
      linear = length_of(first + second)
      if (length_of(found) <= similar*linear .and. linear <= similar*length_of(found)) return
      first = found
      second = 0.0_wp

   contains

      pure real(wp) function length_of(step)
         real(wp), intent(in) :: step(:)

         length_of = measure%norm(reshape(step(:size(motion)), shape(motion)))
      end function length_of
   end subroutine find_along_weak_direction

   !> The problem that a motion solves, its unknowns, and its tangent slightly later than the motion; `is_lost` if that is singular.
   subroutine find_tangent(balance, u, problem, x, tangent, is_lost, bordered)
      type(balance_t), intent(inout), target :: balance
      real(wp), intent(in) :: u(:, :)                                 !! [m], (n_coefficients, n_dofs)
      class(problem_t), pointer, intent(out) :: problem               !! `bordered`, or else the balance
      real(wp), allocatable, intent(out) :: x(:)                      !! its unknowns
      type(tangent_solver_t), intent(inout) :: tangent                !! a new one
      logical, intent(out) :: is_lost
      class(bordered_problem_t), intent(inout), optional, target :: bordered
      real(wp), allocatable :: later(:)
      integer :: i

      problem => balance
      x = [u]
      later = [slightly_later(balance, u)]
      if (present(bordered)) then
         problem => bordered
         x = bordered%unknowns(x)
         later = bordered%unknowns(later)
      end if
      ! with parameters and kinks each product of the wide problem is a solution; of polynomials few products suffice
      call new_tangent_solver(tangent, problem, later, is_lost, well_solved, are_many=present(bordered) .and. &
                              any([(balance%law_set%laws(i)%law%degree == 0, i=1, size(balance%law_set%laws))]))
      if (is_lost .or. .not. present(bordered)) return
      if (allocated(bordered%units_across)) call tangent%leave_out_null_vector(problem, bordered%units_across)
   end subroutine find_tangent

   !> The length of what two steps of Newton's method in the wider set add to the change by the grid. The second step starts from
   !> the end of the first: contacts reached only by the harmonics outside respond there. It is added to `first` if it is clearly
   !> smaller; otherwise both count, and the change by the grid is not known well enough to be left out.
   pure subroutine add_up_steps(measure, shape_of_motion, positions, by_grid, second, first, length)
      type(law_measure_t), intent(in) :: measure
      integer, intent(in) :: shape_of_motion(2)                       !! in the wider set
      integer, intent(in) :: positions(:)                             !! of the retained unknowns
      real(wp), intent(in) :: by_grid(:)                              !! change of these
      real(wp), intent(in) :: second(:)                               !! (n_unknowns)
      real(wp), intent(inout) :: first(:)                             !! (n_unknowns)
      real(wp), intent(out) :: length                                 !! relative to the motion
      real(wp) :: change(size(first))

      length = hypot(length_of(first), length_of(second))
      if (.not. length_of(second) < clearly_smaller*length_of(first)) return   ! nor if it is NaN
      first = first + second
      change = first
      change(positions) = change(positions) - by_grid
      length = length_of(change)

   contains

      pure real(wp) function length_of(step)
         real(wp), intent(in) :: step(:)

         length_of = measure%relative(reshape(step(:product(shape_of_motion)), shape_of_motion))
      end function length_of
   end subroutine add_up_steps

   !> Errors under rigid friction fall with the first power of the order and of the samples: more of them is left than the steps
   !> show.
   subroutine allow_for_slow_convergence(self, balance, is_fine)
      type(error_estimate_t), intent(inout) :: self
      type(balance_t), intent(in) :: balance
      logical, intent(in) :: is_fine                                  !! the aliasing is found by the grid of needs_fine_grid
      integer :: i

      if (.not. any([(balance%law_set%laws(i)%law%is_rigid_friction(), i=1, size(balance%law_set%laws))])) return
      self%truncation = of_first_power*self%truncation
      if (.not. is_fine) self%aliasing = of_first_power_of_grid*self%aliasing
   end subroutine allow_for_slow_convergence

   !> Whether the run ends: the point is solved again, without the results of this one.
   logical function is_interrupted()
      is_interrupted = verdict_on_work() == verdict%interrupted
   end function is_interrupted

   !> Stores the response of the tuples outside, the motion after the step, and the errors of frequencies.
   subroutine store_step(self, balance, wide, which, big, first, alias, measure)
      type(error_estimate_t), intent(inout) :: self
      type(balance_t), intent(in) :: balance
      type(balance_t), intent(inout) :: wide
      integer, intent(in) :: which(:)                                 !! parameters of the balance among the unknowns
      real(wp), intent(in) :: big(:, :)                               !! the motion in the wider set [m]
      real(wp), intent(in) :: first(:)                                !! the step of all unknowns
      real(wp), intent(in) :: alias(:)                                !! its part by the grid, for the parameters
      type(law_measure_t), intent(in) :: measure
      real(wp) :: outside(size(big, 1), size(big, 2))
      integer :: i

      outside = reshape(first(:size(big)), shape(big))
      self%first_order = big - outside
      outside([wide%harmonics%indices_of(balance%harmonics, 1)], :) = 0.0_wp
      self%around = wide%harmonics
      self%neglected = wide%harmonics%norms(measure%seen(outside))/measure%size_of_motion
      do i = 1, size(which)
         if (which(i) <= size(balance%omega)) self%frequency_error(which(i)) = &
            without_cancellation(alias(i), first(size(big) + i))
      end do
      if (.not. keeps_all(self, balance)) return
      if (allocated(self%refined)) deallocate (self%refined)
      allocate (self%refined(wide%stiffness%n_dofs, wide%harmonics%n_harmonics))
      call wide%all_dofs(self%first_order, self%refined)
   end subroutine store_step

   !> Error of a parameter: its parts by the grid and by the set may have opposite signs, and then do not show how accurate it is.
   elemental real(wp) function without_cancellation(by_grid, whole)
      real(wp), intent(in) :: by_grid, whole

      without_cancellation = abs(by_grid) + abs(whole - by_grid)
   end function without_cancellation

   !> Whether the motion of all degrees of freedom is computed in the wider set too.
   pure logical function keeps_all(self, balance)
      type(error_estimate_t), intent(in) :: self
      type(balance_t), intent(in) :: balance

      keeps_all = (size(balance%omega) == 1 .and. .not. allocated(balance%stiffness%contacts)) .or. self%wanted%refined
   end function keeps_all

   !> Whether the unknowns beside the motion are frequencies, not a value along a curve.
   pure logical function has_unknown_tones(bordered)
      class(bordered_problem_t), intent(in), optional :: bordered

      has_unknown_tones = .false.
      if (.not. present(bordered)) return
      select type (bordered)
      class is (phase_problem_t)
         has_unknown_tones = .true.
      end select
   end function has_unknown_tones

   !> Whether a law that is not smooth is rigid, or so much stiffer than the structure in the fastest retained
   !> harmonic that it acts as a rigid one: such an impact is too short for the set. If loads determine its duration
   !> the steps resolve it up to a higher stiffness (the paper's beam at stops 10, 100, 1000 times as stiff: 1, .6 to
   !> 1.1, .2 to .4 of the error), and so they do for rigid walls.
   logical function acts_rigidly(balance, wide, is_free)
      type(balance_t), intent(in) :: balance
      type(balance_t), intent(in) :: wide                             !! with the derivatives of its laws
      logical, intent(in) :: is_free                                  !! the motion has unknown tones
      real(wp), parameter :: stiff_ratio_if_free = 4.0_wp, stiff_ratio_if_driven = 30.0_wp
      integer :: fastest, i

      associate (set => wide%law_set, stiffness => balance%stiffness)
         acts_rigidly = has_multipliers(balance) .and. is_free
         if (has_multipliers(balance) .or. all([(set%laws(i)%law%degree > 0, i=1, size(set%laws))])) return
         fastest = maxloc(abs(balance%frequencies), dim=1)
         do i = 1, set%jacobian%n_pairs
            associate (dof => set%jacobian%row(i))
               if (set%jacobian%column(i) /= dof) cycle
               acts_rigidly = acts_rigidly .or. maxval(abs(set%jacobian%df_dq%values(:, i))) > &
                              merge(stiff_ratio_if_free, stiff_ratio_if_driven, is_free)*abs(stiffness%entry(dof, dof, fastest))
            end associate
         end do
      end associate
   end function acts_rigidly

   !> Whether a grid of four times the samples shows the errors of a motion, not one of twice as many: with one tone, for rigid
   !> walls that it strikes, which are penetrated between samples, and for errors of frequencies.
   logical function needs_fine_grid(balance, u, is_free)
      type(balance_t), intent(inout) :: balance
      real(wp), intent(in) :: u(:, :)
      logical, intent(in) :: is_free                                  !! the motion has unknown tones

      needs_fine_grid = is_free .or. size(balance%omega) == 1
      if (needs_fine_grid .or. .not. has_walls(balance)) return
      call balance%sample(u)
      needs_fine_grid = are_walls_struck(balance)
   end function needs_fine_grid

   !> For rigid laws and those that act as rigid ones, and for any self-excited motion that one linear step cannot
   !> check: the change from the solution of half the order raises the estimates, or replaces them if they are too
   !> large to be reliable. A wall that is struck exerts all harmonics alike, and the omitted ones shift the position
   !> of the impact by sum 1/j**2 = 1/order: the error falls with the first power, so that it is as large as this
   !> change. The harmonics just outside show little of it, because the force of the truncated motion has a finite
   !> duration, not the spectrum of an impact. Without a solution the estimates are unchanged.
   subroutine compare_with_half(self, balance, problem, x, n, measure)
      type(error_estimate_t), intent(inout) :: self
      type(balance_t), intent(in) :: balance
      class(problem_t), intent(inout) :: problem
      real(wp), intent(in) :: x(:)                                    !! its solution
      integer, intent(in) :: n                                        !! coefficients among its unknowns
      type(law_measure_t), intent(in) :: measure
      real(wp), parameter :: nearly_at_rest = 0.5_wp ! size relative to the motion; a smaller one approaches the equilibrium
      type(report_t) :: report
      type(solver_config_t) :: config
      real(wp) :: x_half(size(x))
      logical :: is_held(n), is_high(balance%harmonics%n_coefficients), is_possible, is_there
      integer :: i

      is_high = are_in_upper_half(balance%harmonics, problem)
      if (.not. any(is_high)) return
      is_held = [(is_high, i=1, n/size(is_high))]
      x_half = x
      where (is_held) x_half(:n) = 0.0_wp
      config%max_iterations = nearby_steps
      config%max_fallback_work = 0.0_wp
      select type (problem)
      class is (bordered_problem_t)
         problem%is_held = is_held
         call solve_newton(problem, config, x_half, report)
         deallocate (problem%is_held)
         is_there = report%status == outcome%converged
         call problem%move_to(x, is_possible)
      class default
         call problem%coarse_guess(0.5_wp, config, x_half, report, is_there)
      end select
      if (.not. is_there) return
      if (size_of(x_half) < nearly_at_rest*size_of(x)) return
      x_half = x_half - x
      select type (problem)
      class is (bordered_problem_t)
         do i = 1, size(problem%which)
            if (problem%which(i) > size(self%frequency_error)) cycle
            associate (of_tone => self%frequency_error(problem%which(i)))
               of_tone = max(abs(x_half(n + i)), merge(0.0_wp, of_tone, self%truncation > small_share))
            end associate
         end do
      end select
      associate (change => reshape(x_half(:n), [balance%harmonics%n_coefficients, balance%n_dofs]))
         self%truncation = max(measure%relative(change), min(self%truncation, small_share))
      end associate

   contains

      pure real(wp) function size_of(unknowns)
         real(wp), intent(in) :: unknowns(:)

         size_of = measure%norm(reshape(unknowns(:n), [balance%harmonics%n_coefficients, balance%n_dofs]))
      end function size_of
   end subroutine compare_with_half

   !> Whether coefficients belong to the upper half of a set, which the smaller problem does not have.
   pure function are_in_upper_half(set, problem) result(are_high)
      type(harmonics_t), intent(in) :: set
      class(problem_t), intent(in) :: problem
      logical :: are_high(set%n_coefficients)
      integer :: h, half

      half = int(0.5_wp*maxval(sum(abs(set%tuples), dim=1)))
      do h = 1, set%n_harmonics
         select type (problem)
         class is (bordered_problem_t)
            are_high(set%cos_at(h)) = sum(abs(set%tuples(:, h))) > half
         class default                                                ! as in its smaller problem
            are_high(set%cos_at(h)) = any(abs(set%tuples(:, h)) > ceiling(0.5_wp*set%highest))
         end select
         if (set%sin_at(h) > 0) are_high(set%sin_at(h)) = are_high(set%cos_at(h))
      end do
   end function are_in_upper_half

   !> Rigid contact and friction on the finer grid, and the power dissipated by each law there.
   subroutine check_contact(self, structure, balance, wide, u, error)
      type(error_estimate_t), intent(inout) :: self
      type(structure_t), intent(in) :: structure
      type(balance_t), intent(in) :: balance
      type(balance_t), intent(inout) :: wide
      real(wp), intent(in) :: u(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: big(:, :), force(:)
      real(wp), pointer, contiguous :: samples(:, :)
      integer :: c, i

      allocate (big, source=coefficients_in(wide%harmonics, balance%harmonics, u))
      allocate (force(wide%harmonics%n_coefficients))
      call wide%differentiate(big, error)
      if (allocated(error)) return
      self%defects = wide%law_set%defects()
      allocate (self%power_laws(size(wide%law_set%laws)), self%peak_force(size(wide%law_set%laws)), source=0.0_wp)
      do i = 1, size(self%power_laws)
         samples => wide%law_set%force_of(i)
         self%peak_force(i) = sqrt(maxval(sum(samples**2, dim=2)))
         associate (motion => wide%law_set%coordinates_of(i, big))
            do c = 1, size(samples, 2)
               call wide%project_one(samples(:, c:c), force)
               self%power_laws(i) = self%power_laws(i) + mean_power(wide%harmonics, wide%frequencies, force, motion(:, c))
            end do
         end associate
      end do
      if (any([(wide%law_set%laws(i)%law%is_multiplier, i=1, size(self%power_laws))])) &
         self%impact = impact_energy(structure, wide, big)
   end subroutine check_contact

   !> Mean of force times rate: sum over harmonics of w/2 (f_cos x_sin - f_sin x_cos), rate = w (x_sin cos - x_cos sin).
   pure real(wp) function mean_power(set, frequencies, force, motion)
      type(harmonics_t), intent(in) :: set
      real(wp), intent(in) :: frequencies(:)                          !! [rad/s]
      real(wp), intent(in) :: force(:), motion(:)                     !! (n_coefficients)
      integer :: h

      mean_power = 0.0_wp
      do h = 1, set%n_harmonics
         if (set%sin_at(h) == 0) cycle
         associate (a => set%cos_at(h), b => set%sin_at(h))
            mean_power = mean_power + 0.5_wp*frequencies(h)*(force(a)*motion(b) - force(b)*motion(a))
         end associate
      end do
   end function mean_power

   !> The combination k of low order with the smallest k.omega. If it is very small, the motion on the torus is slow
   !> along k, and neither averages over time nor the truncated series are reliable.
   pure subroutine near_commensurate(tones, combination, frequency)
      type(tones_t), intent(in) :: tones
      integer, allocatable, intent(out) :: combination(:)             !! (n_tones); 1 for one tone
      real(wp), intent(out) :: frequency                              !! |k.omega| [rad/s]
      integer, parameter :: largest_sum(10) = [1, 24, 12, 8, 8, 4, 3, 2, 1, 1]   ! of |k_m|, by number of tones
      integer :: k(tones%n_tones), m, largest_order

      largest_order = largest_sum(min(tones%n_tones, size(largest_sum)))
      k = -largest_order
      k(1) = 0
      allocate (combination(tones%n_tones), source=0)
      combination(1) = 1
      frequency = abs(tones%omega(1))
      do
         if (any(k /= 0) .and. sum(abs(k)) <= largest_order .and. abs(dot_product(k, tones%omega)) < frequency) then
            frequency = abs(dot_product(k, tones%omega))
            combination = canonical_sign(k)*k
         end if
         do m = size(k), 1, -1                                         ! odometer
            if (k(m) < largest_order) exit
            k(m) = merge(0, -largest_order, m == 1)
         end do
         if (m == 0) return
         k(m) = k(m) + 1
      end do
   end subroutine near_commensurate
end module hb_error_estimate
