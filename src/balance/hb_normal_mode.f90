!> Nonlinear normal modes: periodic motion of a prescribed amplitude, continued from a linear mode.
!>
!> The frequency and one artificial damping xi (forces -xi M x', negative damping) are unknown beside the coefficients; the
!> conditions are an amplitude and a phase. xi makes up for the damping of the scene; without any it comes out as zero, and
!> takes up the equation that a conservative scene has too many. Source: docs/theory.md, section 6.5; Krack, Computers and
!> Structures 154 (2015) 59-71.
module hb_normal_mode
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_outcome, only: outcome
   use hb_phase, only: coefficient_form, new_phase_problem, peak_form, peak_rate_form
   use hb_search, only: climb_orders, fundamental, search_t
   use hb_solver, only: solve
   use hb_solver_types, only: report_t, solver_config_t
   use hb_text, only: to_text
   implicit none
   private
   public :: find_normal_mode, measure_names, normal_mode_t

   character(8), parameter :: measure_names(2) = [character(8) :: "peak", "harmonic"]
   real(wp), parameter :: first_share = 1.0e-3_wp                     ! of the amplitude, where the way begins
   real(wp), parameter :: longest_growth = 2.5_wp                     ! of log(amplitude) in one step
   real(wp), parameter :: shortest_growth = 1.0e-5_wp
   integer, parameter :: most_steps = 400
   real(wp), parameter :: dead = 1.0e-3_wp                            ! share of the fundamental in a motion
   integer, parameter :: easy_iterations = 6                          ! the next step may be longer

   type :: normal_mode_t
      logical :: is_asked = .false.
      integer :: dof = 0                                              !! of the structure, where the amplitude is measured
      integer :: mode = 0                                             !! linear mode to start from, by frequency; 0: nearest
                                                                      !! to the first guess of the frequency, else the first
      real(wp) :: amplitude = 0.0_wp                                  !! [m], of either sign
      logical :: is_peak = .true.                                     !! displacement at rest at tau = 0, else first harmonic
   end type normal_mode_t

contains

   !> Finds the motion with the given amplitude of one unknown tone. On success the balance of the search stands at its
   !> frequency and artificial damping; u is the last motion reached.
   subroutine find_normal_mode(search, amplitude, is_peak, dof, has_start, u)
      type(search_t), intent(inout) :: search
      real(wp), intent(in) :: amplitude                               !! [m], not zero
      logical, intent(in) :: is_peak
      integer, intent(in) :: dof                                      !! among those of the laws
      logical, intent(in) :: has_start                                !! u and the balance are a first guess
      real(wp), intent(inout) :: u(:, :)                              !! [m], (n_coefficients, n_dofs)
      real(wp), allocatable :: forms(:, :)
      integer :: h

      associate (set => search%balance%harmonics, tone => search%tones(1), n_dofs => size(u, 2))
         h = fundamental(set, tone)
         allocate (forms(size(u), 2))
         if (is_peak) then
            forms(:, 1) = peak_rate_form(set, n_dofs, dof, tone)
            forms(:, 2) = peak_form(set, n_dofs, dof)
         else
            forms(:, 1) = coefficient_form(set, n_dofs, set%sin_at(h), dof)
            forms(:, 2) = coefficient_form(set, n_dofs, set%cos_at(h), dof)
         end if
      end associate
      if (has_start) then
         call solve_at(search, forms, amplitude, search%config, .false., u)
         if (search%report%status == outcome%converged) return
      end if
      if (size(search%modes) == 0) then
         search%report%status = outcome%no_motion
         search%message = "there is no linear mode to start from, or none of that number; give a &start"
         return
      end if
      call continue_from_mode(search, forms, amplitude, dof, h, u)
   end subroutine find_normal_mode

   !> Follows the amplitude from nearly nothing, by steps of its logarithm with a secant predictor.
   subroutine continue_from_mode(search, forms, amplitude, dof, h, u)
      type(search_t), intent(inout) :: search
      real(wp), intent(in) :: forms(:, :)
      real(wp), intent(in) :: amplitude
      integer, intent(in) :: dof, h
      real(wp), intent(inout) :: u(:, :)
      type(solver_config_t) :: config
      complex(wp) :: form(size(u, 2))
      real(wp), allocatable :: last(:), before(:), now(:)
      real(wp) :: goal, growth, reached, reached_before
      integer :: iterations, step
      type(error_t), allocatable :: error
      real(wp) :: omega(size(search%balance%omega)), xi(size(search%balance%omega))

      config = search%path_config()
      associate (modes => search%rest%modes, mode => search%modes(1), set => search%balance%harmonics, tone => search%tones(1))
         form = modes%shapes(:, mode)
         if (.not. abs(form(dof)) > 1.0e-8_wp*maxval(abs(form))) then
            search%report%status = outcome%no_motion
            search%message = "the linear mode does not move where the amplitude is measured; choose another mode or dof"
            return
         end if
         form = form/form(dof)*amplitude
         omega = search%balance%omega
         xi = 0.0_wp
         omega(tone) = modes%frequency(mode)
         xi(tone) = -modes%growth(mode)/modes%response(mode)
         call search%balance%move(omega, xi, error)
         if (allocated(error)) then
            search%report%status = outcome%singular
            search%message = error%message
            return
         end if
         u = search%rest%u
         before = [reshape(u, [size(u)]), omega(tone), xi(tone)]
         u(set%cos_at(h), :) = u(set%cos_at(h), :) + first_share*real(form)
         u(set%sin_at(h), :) = u(set%sin_at(h), :) - first_share*aimag(form)
         last = before
         last(:size(u)) = reshape(u, [size(u)])
      end associate
      reached_before = 0.0_wp
      reached = first_share
      growth = 0.1_wp*longest_growth
      goal = first_share
      do step = 1, most_steps
         if (step == 1) then
            now = last
         else
            goal = min(1.0_wp, reached*exp(growth))
            now = last + (last - before)*(goal - reached)/(reached - reached_before)
         end if
         call step_to(goal)
         if (search%report%status == outcome%converged) then
            if (step > 1) then
               before = last
               reached_before = reached
            end if
            last = now
            reached = goal
            if (reached >= 1.0_wp) exit
            if (iterations <= easy_iterations) growth = min(longest_growth, 1.6_wp*growth)
         else
            if (step == 1) exit
            growth = 0.4_wp*growth
            if (growth < shortest_growth) exit
         end if
      end do
      if (reached < 1.0_wp .or. search%report%status /= outcome%converged) then
         search%message = "the way from the linear mode ended at amplitude "//to_text(reached*amplitude)
         u = reshape(last(:size(u)), shape(u))
         return
      end if
      call put(last)
      call solve_at(search, forms, amplitude, search%config, .false., u)

   contains

      subroutine step_to(share)
         real(wp), intent(in) :: share
         integer :: effort_before
         logical :: is_possible

         is_possible = now(size(u) + 1) > 0.0_wp
         search%report%status = outcome%stalled
         iterations = 0
         if (.not. is_possible) return
         effort_before = search%report%iterations
         call put(now)
         call solve_at(search, forms, share*amplitude, config, step == 1, u)
         iterations = search%report%iterations - effort_before
         now = search%phase%unknowns(u)
         associate (set => search%balance%harmonics)                   ! the same motion counted as a higher harmonic?
            if (norm2(u([set%cos_at(h), set%sin_at(h)], :)) < dead*norm2(u - search%rest%u)) search%report%status = outcome%stalled
         end associate
      end subroutine step_to

      !> Puts balance and u at a vector of unknowns.
      subroutine put(x)
         real(wp), intent(in) :: x(:)

         u = reshape(x(:size(u)), shape(u))
         omega(search%tones) = x(size(u) + 1)
         xi(search%tones) = x(size(u) + 2)
         call search%balance%move(omega, xi, error)
      end subroutine put
   end subroutine continue_from_mode

   !> Solves at one amplitude from u and the frequencies of the balance, by orders or as a whole.
   subroutine solve_at(search, forms, amplitude, config, by_orders, u)
      type(search_t), intent(inout) :: search
      real(wp), intent(in) :: forms(:, :)
      real(wp), intent(in) :: amplitude
      type(solver_config_t), intent(in) :: config
      logical, intent(in) :: by_orders
      real(wp), intent(inout) :: u(:, :)
      type(report_t) :: report
      real(wp), allocatable :: x(:)
      logical :: is_possible

      call search%set_scales(abs(amplitude))
      call new_phase_problem(search%phase, search%balance, search%tones, .true., forms, [0.0_wp, amplitude])
      x = search%phase%unknowns(u)
      if (by_orders) then
         call climb_orders(search%phase, config, x, report)
      else
         call solve(search%phase, config, x, x, report)
      end if
      call search%add_effort(report)
      search%report%status = report%status
      search%report%residual = report%residual
      u = reshape(x(:size(u)), shape(u))
      call search%phase%move_to(x, is_possible)
   end subroutine solve_at
end module hb_normal_mode
