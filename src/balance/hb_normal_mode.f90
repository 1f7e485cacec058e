!> Nonlinear normal modes: periodic motion of a prescribed amplitude or energy, continued from a linear mode.
!> The frequency and one artificial damping xi (forces -xi M x', negative damping) are unknown in addition to the
!> coefficients; the conditions are an amplitude or an energy, and a phase. xi compensates for the damping of the
!> model; without damping it is zero, and accounts for the redundant equation of a conservative model. Source:
!> docs/why/theory.md, section 6.5; Krack, Computers and Structures 154 (2015) 59-71.
module hb_normal_mode
   use hb_advice, only: advice
   use hb_amplitude_curve, only: begin_curve, point_of, step_along, update_scales
   use hb_balance, only: balance_t
   use hb_curve, only: curve_t, event_t
   use hb_energy, only: energy_t
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_limit_cycle_search, only: continue_in_order, first_amplitude, fundamental, max_steps, &
      path_point_t, search_t
   use hb_outcome, only: outcome
   use hb_phase, only: coefficient_functional, new_phase_problem, peak_functional, peak_rate_functional, shift_functional
   use hb_resonant_modes, only: find_resonant, find_shares, resonant_t, with_resonant
   use hb_solver, only: solve
   use hb_solver_types, only: report_t, solver_config_t
   use hb_text, only: to_text
   use hb_thresholds, only: equality_tolerance, negligible_share, rounding_level
   implicit none
   private
   public :: amplitude_functionals, find_mode_of_energy, find_normal_mode

   !> The goal: an amplitude with its phase condition, or an energy. Half of the path is half of the amplitude and a
   !> quarter of the energy.
   type :: goal_t
      real(wp) :: value = 0.0_wp                                      ! [m] or [J], beyond the rest
      real(wp) :: rest = 0.0_wp                                       ! amplitude of the base motion [m]
      real(wp) :: share = first_amplitude                                 ! of the amplitude, where the path begins
      integer :: dof = 0                                              ! of the amplitude, among those of the laws
      real(wp), allocatable :: functionals(:, :)                      ! phase and amplitude, (coefficients of all dofs, 2)
      logical :: is_peak = .false.                                    ! these are rate and value at zero phase
      type(energy_t), allocatable :: energy                           ! otherwise an amplitude
   end type goal_t

   !> Intersection of a curve with the goal.
   type, extends(event_t) :: goal_event_t
      type(goal_t) :: goal
      type(balance_t), pointer :: balance => null()
   contains
      procedure :: value => goal_event_value
   end type goal_event_t

contains

   !> Phase and amplitude of a mode, of all coefficients: rate and value at zero phase, or sine and cosine of the fundamental.
   pure function amplitude_functionals(set, n_dofs, dof, tone, is_peak) result(functionals)
      type(harmonics_t), intent(in) :: set
      integer, intent(in) :: n_dofs
      integer, intent(in) :: dof                                      !! among those of the laws
      integer, intent(in) :: tone
      logical, intent(in) :: is_peak
      real(wp) :: functionals(set%n_coefficients*n_dofs, 2)

      if (is_peak) then
         functionals(:, 1) = peak_rate_functional(set, n_dofs, dof, tone)
         functionals(:, 2) = peak_functional(set, n_dofs, dof)
      else
         associate (h => fundamental(set, tone))
            functionals(:, 1) = coefficient_functional(set, n_dofs, set%sin_at(h), dof)
            functionals(:, 2) = coefficient_functional(set, n_dofs, set%cos_at(h), dof)
         end associate
      end if
   end function amplitude_functionals

   !> Finds the motion with the given amplitude of one unknown tone. On success the balance of the search has its
   !> frequency and artificial damping; u is the last motion.
   subroutine find_normal_mode(search, amplitude, is_peak, dof, has_start, u)
      type(search_t), intent(inout) :: search
      real(wp), intent(in) :: amplitude                               !! [m], not zero
      logical, intent(in) :: is_peak
      integer, intent(in) :: dof                                      !! among those of the laws
      logical, intent(in) :: has_start                                !! u and the balance are a first guess
      real(wp), intent(inout) :: u(:, :)                              !! [m], (n_coefficients, n_dofs)
      type(goal_t) :: goal

      goal%dof = dof
      goal%is_peak = is_peak
      goal%functionals = amplitude_functionals(search%balance%harmonics, size(u, 2), dof, search%tones(1), is_peak)
      goal%rest = dot_product(goal%functionals(:, 2), reshape(search%base%u, [size(u)]))
      goal%value = amplitude - goal%rest
      if (abs(goal%value) <= rounding_level*abs(amplitude)) then
         search%report%status = outcome%no_motion
         search%message = "the amplitude is the displacement at rest"
         return
      end if
      call find(search, goal, has_start, u)
   end subroutine find_normal_mode

   !> Finds the motion with the given energy above that of the base motion, like `find_normal_mode`.
   subroutine find_mode_of_energy(search, energy, value, has_start, u)
      type(search_t), intent(inout) :: search
      type(energy_t), intent(in) :: energy
      real(wp), intent(in) :: value                                   !! [J], > 0
      logical, intent(in) :: has_start                                !! u and the balance are a first guess
      real(wp), intent(inout) :: u(:, :)                              !! [m], (n_coefficients, n_dofs)
      type(goal_t) :: goal

      goal%value = value
      goal%energy = energy
      goal%share = min(1.0_wp, max(first_amplitude, sqrt(equality_tolerance*abs(energy%at_rest)/value)))
      call find(search, goal, has_start, u)
   end subroutine find_mode_of_energy

   subroutine find(search, goal, has_start, u)
      type(search_t), intent(inout) :: search
      type(goal_t), intent(in) :: goal
      logical, intent(in) :: has_start
      real(wp), intent(inout) :: u(:, :)

      real(wp) :: before

      if (has_start) then
         before = size_of_fundamental()
         call solve_at(search, goal, 1.0_wp, search%config, .false., u)
         if (search%report%status == outcome%converged .and. &
             ! otherwise a motion of another mode
             size_of_fundamental() > max(negligible_share*before, rounding_level*norm2(u))) return
         search%report%status = outcome%pending
      end if
      if (size(search%modes) == 0) then
         search%report%status = outcome%no_motion
         search%message = "no such linear mode to start from"
         search%advice = advice%other_guess
         return
      end if
      call continue_from_mode(search, goal, u)

   contains

      pure real(wp) function size_of_fundamental()
         integer :: h

         associate (set => search%balance%harmonics)
            h = fundamental(set, search%tones(1))
            size_of_fundamental = norm2(u([set%cos_at(h), set%sin_at(h)], :))
         end associate
      end function size_of_fundamental
   end subroutine find

   !> Follows the motions with artificial damping from a small one in the linear mode, until one meets the goal. If none does, modes
   !> at an internal resonance give other starts.
   subroutine continue_from_mode(search, goal, u)
      type(search_t), intent(inout) :: search
      type(goal_t), intent(in) :: goal
      real(wp), intent(inout) :: u(:, :)
      real(wp), allocatable :: ended(:, :)
      real(wp) :: reached
      logical :: is_found

      call start_on_mode(search, goal, u)
      if (search%report%status /= outcome%pending) return
      reached = 0.0_wp
      call solve_at(search, goal, goal%share, search%path_config(), .true., u)
      is_found = search%report%status == outcome%converged
      if (is_found) call follow_to_goal(search, goal, goal%share, u, reached, is_found)
      if (is_found) return
      ended = u
      call start_on_resonant_modes(search, goal, u, reached, is_found)
      if (is_found) return
      u = ended
      search%report%status = outcome%stalled
      if (reached >= 1.0_wp) return
      if (allocated(goal%energy)) then
         search%message = "continuation from the linear mode ended at an energy of "//to_text(reached**2*goal%value)
      else
         search%message = "continuation from the linear mode ended at amplitude "//to_text(goal%rest + reached*goal%value)
      end if
   end subroutine continue_from_mode

   !> Follows the motions from one at a fraction of the goal until one meets it.
   subroutine follow_to_goal(search, goal, from, u, reached, is_found)
      type(search_t), intent(inout) :: search
      type(goal_t), intent(in) :: goal
      real(wp), intent(in) :: from                                    !! of the path
      real(wp), intent(inout) :: u(:, :)                              !! the motion there, on return the last one
      real(wp), intent(inout) :: reached                              !! largest fraction so far; 1: the goal, but it was not solved
      logical, intent(out) :: is_found
      type(curve_t) :: curve
      type(goal_event_t) :: event
      type(path_point_t) :: last, point
      real(wp) :: share
      integer :: i
      logical :: is_possible

      is_found = from >= 1.0_wp
      if (is_found) return
      event%tolerance = negligible_share
      event%goal = goal
      event%balance => search%balance
      reached = max(reached, from)
      point = point_of(search, search%phase%unknowns([u]))
      call begin_curve(search, point, curve)
      if (.not. allocated(goal%energy)) then                          ! the peak determines the penetration of a stop
         curve%functional = 0.0_wp*curve%x
         curve%functional(:size(u)) = sign(1.0_wp, goal%value)*goal%functionals(:, 2)
      end if
      do i = 1, max_steps
         last = point
         call step_along(search, curve, point)
         if (curve%status /= outcome%pending) exit
         share = 1.0_wp + event%value(curve, curve%x)
         if (share >= 1.0_wp) then
            call curve%locate(event, is_found)
            if (is_found) exit
            call curve%retreat()                                      ! the step has led to another part of the curve
            if (curve%status /= outcome%pending) exit
            point = last
            cycle
         end if
         reached = max(reached, share)
         call update_scales(search, curve, point)
         call curve%turn()
      end do
      call search%report%add(curve%report)
      u = point%u
      if (.not. is_found) return
      call search%phase%move_to(curve%x, is_possible)
      u = reshape(curve%x(:size(u)), shape(u))
      call solve_at(search, goal, 1.0_wp, search%config, .false., u)
      is_found = search%report%status == outcome%converged
      reached = 1.0_wp
   end subroutine follow_to_goal

   !> Computes a small motion in the linear mode, with its frequency and damping; a status other than pending: there
   !> is none.
   subroutine start_on_mode(search, goal, u)
      type(search_t), intent(inout) :: search
      type(goal_t), intent(in) :: goal
      real(wp), intent(inout) :: u(:, :)
      type(error_t), allocatable :: error
      complex(wp) :: deflection(size(u, 2))
      real(wp) :: omega(size(search%balance%omega)), xi(size(search%balance%omega))
      integer :: h

      h = fundamental(search%balance%harmonics, search%tones(1))
      associate (modes => search%base%modes, mode => search%modes(1), set => search%balance%harmonics, tone => search%tones(1))
         omega = search%balance%omega
         xi = 0.0_wp
         omega(tone) = modes%frequency(mode)
         if (.not. search%base%is_undamped) omega(tone) = hypot(omega(tone), modes%growth(mode))   ! xi compensates the damping
         xi(tone) = -modes%growth(mode)/modes%response(mode)
         call search%balance%move(omega, xi, error)
         if (allocated(error)) then
            search%report%status = outcome%singular
            search%message = error%message
            return
         end if
         call scale_mode(search, goal, h, deflection)
         if (search%report%status == outcome%no_motion) return
         u = search%base%u
         u(set%cos_at(h), :) = goal%share*real(deflection)            ! of an unknown tone: none in the base motion
         u(set%sin_at(h), :) = -goal%share*aimag(deflection)
      end associate
   end subroutine start_on_mode

   !> Starts with first guesses in the chosen mode and one whose frequency is a multiple of its own. At such an internal
   !> resonance the laws alone determine the share of each mode: there may be no motion near the mode alone, however small
   !> it is, and where the laws are small beside the tolerance of the path any share seems to be a motion.
   subroutine start_on_resonant_modes(search, goal, u, reached, is_found)
      type(search_t), intent(inout) :: search
      type(goal_t), intent(in) :: goal
      real(wp), intent(inout) :: u(:, :)
      real(wp), intent(inout) :: reached                              !! largest fraction of the path so far
      logical, intent(out) :: is_found
      real(wp), parameter :: goal_shares(4) = [1.0_wp, 0.3_wp, 0.1_wp, 0.01_wp]                ! of the goal
      real(wp), parameter :: second_mode_shares(6) = [0.3_wp, -0.3_wp, 1.0_wp, -1.0_wp, 3.0_wp, -3.0_wp] ! shares of the second mode
      integer, parameter :: max_paths = 4
      type(resonant_t), allocatable :: resonant(:)
      real(wp), allocatable :: frequencies(:), shares(:)
      real(wp) :: alone(size(u, 1), size(u, 2))
      integer :: i, k, n_paths, p, phase

      is_found = .false.
      n_paths = 0
      call find_resonant(search, resonant)
      do p = 1, size(goal_shares)
         do k = 1, size(resonant)
            do phase = 1, 2
               call begin_alone(goal_shares(p), alone)
               if (search%report%status /= outcome%pending) return
               call find_shares(search, alone, resonant(k), phase == 2, shares, frequencies)
               shares = [shares, second_mode_shares]
               frequencies = [frequencies, spread(search%balance%omega(search%tones(1)), 1, size(second_mode_shares))]
               do i = 1, size(shares)
                  call begin_alone(goal_shares(p), alone)
                  u = with_resonant(search, alone, resonant(k), shares(i), phase == 2)
                  call move_to_frequency(search, frequencies(i))
                  call solve_at(search, goal, goal_shares(p), search%config, .false., u)
                  if (search%report%status /= outcome%converged .or. .not. has_fundamental(search, u)) cycle
                  call follow_to_goal(search, goal, goal_shares(p), u, reached, is_found)
                  n_paths = n_paths + 1
                  if (is_found .or. n_paths >= max_paths) return
               end do
            end do
         end do
      end do

   contains

      !> A motion in the chosen mode at a part of the goal.
      subroutine begin_alone(part, alone)
         real(wp), intent(in) :: part
         real(wp), intent(out) :: alone(:, :)

         search%report%status = outcome%pending
         call start_on_mode(search, goal, alone)
         if (search%report%status == outcome%pending) alone = search%base%u + part/goal%share*(alone - search%base%u)
      end subroutine begin_alone
   end subroutine start_on_resonant_modes

   !> Sets the frequency of the unknown tone, if the structure permits it.
   subroutine move_to_frequency(search, frequency)
      type(search_t), intent(inout) :: search
      real(wp), intent(in) :: frequency                               !! [rad/s]
      real(wp) :: omega(size(search%balance%omega))
      type(error_t), allocatable :: error

      omega = search%balance%omega
      omega(search%tones(1)) = frequency
      call search%balance%move(omega, search%balance%xi, error)
   end subroutine move_to_frequency

   !> Whether a motion has the period of the unknown tone: a motion of a faster mode alone repeats after a part of it.
   pure logical function has_fundamental(search, u)
      type(search_t), intent(in) :: search
      real(wp), intent(in) :: u(:, :)
      integer :: h

      associate (set => search%balance%harmonics)
         h = fundamental(set, search%tones(1))
         has_fundamental = norm2(u([set%cos_at(h), set%sin_at(h)], :)) >= negligible_share*norm2(u - search%base%u)
      end associate
   end function has_fundamental

   !> Distance of a motion beyond the goal, as a fraction of the amplitude; 0 at the goal.
   real(wp) function goal_event_value(self, curve, x) result(value)
      class(goal_event_t), intent(inout) :: self
      class(curve_t), intent(inout) :: curve
      real(wp), intent(in) :: x(:)
      logical :: is_possible

      associate (n => self%balance%n_unknowns, goal => self%goal)
         if (allocated(goal%energy)) then
            call curve%problem%move_to(x, is_possible)
            value = goal%energy%value(self%balance, reshape(x(:n), [self%balance%harmonics%n_coefficients, self%balance%n_dofs]))
            value = sign(sqrt(abs(value)/goal%value), value) - 1.0_wp
         else
            value = (dot_product(goal%functionals(:n, 2), x(:n)) - goal%rest)/goal%value - 1.0_wp
         end if
      end associate
   end function goal_event_value

   !> Shape of the linear mode at the laws [m], as large as it would be at the goal if the laws were linear; sets the
   !> balance to the frequency of the mode. The status is `no_motion` if it is undefined.
   subroutine scale_mode(search, goal, h, deflection)
      type(search_t), intent(inout) :: search
      type(goal_t), intent(in) :: goal
      integer, intent(in) :: h                                        !! the fundamental
      complex(wp), intent(out) :: deflection(:)                       !! (n_dofs)
      real(wp) :: energy, length
      real(wp), allocatable :: u(:, :)

      deflection = search%base%modes%shapes(:, search%modes(1))
      if (.not. allocated(goal%energy)) then
         if (abs(deflection(goal%dof)) > 1.0e-8_wp*maxval(abs(deflection))) then
            deflection = deflection/deflection(goal%dof)*goal%value
         else
            search%report%status = outcome%no_motion
            search%message = "the linear mode has a node where the amplitude is measured"
            search%advice = advice%other_mode
         end if
         return
      end if
      if (.not. search%base%is_at_laws(search%modes(1))) then
         search%report%status = outcome%no_motion
         search%message = "the linear mode has nodes where the laws act"
         search%advice = advice%other_mode
         return
      end if
      length = first_amplitude*search%length
      deflection = length*deflection/deflection(maxloc(abs(deflection), dim=1))
      u = search%base%u
      associate (set => search%balance%harmonics)
         u(set%cos_at(h), :) = real(deflection)
         u(set%sin_at(h), :) = -aimag(deflection)
      end associate
      energy = goal%energy%value(search%balance, u)
      if (energy > 0.0_wp) then
         deflection = sqrt(goal%value/energy)*deflection
      else
         search%report%status = outcome%no_motion
         search%message = "a small motion in the linear mode has no energy"
         search%advice = advice%other_mode
      end if
   end subroutine scale_mode

   !> Solves at a fraction of the goal from u and the frequencies of the balance, by increasing orders or with the
   !> whole set.
   subroutine solve_at(search, goal, share, config, by_orders, u)
      type(search_t), intent(inout) :: search
      type(goal_t), intent(in) :: goal
      real(wp), intent(in) :: share                                   !! of the path, > 0
      type(solver_config_t), intent(in) :: config
      logical, intent(in) :: by_orders
      real(wp), intent(inout) :: u(:, :)
      type(report_t) :: report
      real(wp), allocatable :: functionals(:, :), x(:)
      logical :: is_possible

      if (allocated(goal%energy)) then
         call search%set_scales(maxval(norm2(u - search%base%u, dim=1)))
         allocate (functionals(size(u) + 2, 2), source=0.0_wp)
         functionals(:size(u), 1) = shift_functional(search%balance%harmonics, search%tones(1), u, &
                                                     reshape(search%balance%x_scale, shape(u)))
         call new_phase_problem(search%phase, search%balance, search%tones, .true., functionals, [0.0_wp, share**2*goal%value], &
                                goal%energy)
      else
         call search%set_scales(abs(share*goal%value))
         call new_phase_problem(search%phase, search%balance, search%tones, .true., goal%functionals, &
                                [0.0_wp, goal%rest + share*goal%value])
         if (goal%is_peak) search%phase%peak_dof = goal%dof
      end if
      allocate (x, source=search%phase%unknowns([u]))
      if (by_orders) then
         call continue_in_order(search%phase, search%balance%harmonics, config, x, report)
      else
         call solve(search%phase, config, x, x, report)
      end if
      call search%report%add(report)
      search%report%status = report%status
      search%report%residual = report%residual
      u = reshape(x(:size(u)), shape(u))
      call search%phase%move_to(x, is_possible)
   end subroutine solve_at
end module hb_normal_mode
