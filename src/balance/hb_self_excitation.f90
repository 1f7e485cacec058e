!> Self-excited motion: limit cycles and tori with unknown base frequencies, never the motion at rest.
!>
!> With the amplitudes of the unknown tones prescribed and artificial damping xi_m of each in their place, the equations have
!> a solution near each mode, where xi_m = -2 (growth of the mode). From there amplitudes grow where the motion is driven
!> (xi_m < 0) and shrink where it is damped, as they would in time, until the artificial damping is nearly gone; Newton's
!> method on the problem without it then finds the motion. Where the rest is stable a scan of amplitudes looks for driving.
!> Source: docs/theory.md, section 6.5; Krack, Computers and Structures 154 (2015) 59-71, for the artificial damping.
module hb_self_excitation
   use hb_balance, only: balance_t
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_newton, only: solve_newton
   use hb_outcome, only: outcome
   use hb_phase, only: amplitude_form, coefficient_form, new_phase_problem, phase_problem_t, shift_form, turn
   use hb_rest, only: rest_t
   use hb_solver, only: solve
   use hb_solver_types, only: report_t, solver_config_t
   use hb_text, only: to_text
   implicit none
   private
   public :: climb_orders, new_search, search_t

   real(wp), parameter :: first_amplitude = 1.0e-3_wp                 ! of the scan, relative to the length of the scene
   real(wp), parameter :: last_amplitude = 1.0e3_wp
   integer, parameter :: n_amplitudes = 13                            ! of the scan, equal ratios
   real(wp), parameter :: largest_amplitude = 1.0e8_wp                ! beyond: grows without bound
   real(wp), parameter :: longest_growth = 1.1_wp                     ! of log(amplitude) in one step
   real(wp), parameter :: shortest_growth = 1.0e-4_wp
   integer, parameter :: most_steps = 120
   real(wp), parameter :: neutral = 1.0e-9_wp                         ! |xi|/omega of a motion neither driven nor damped
   real(wp), parameter :: nearly_gone = 0.1_wp                        ! |xi|/omega from which on the motion itself is tried
   real(wp), parameter :: dead = 1.0e-3_wp                            ! amplitude of a tone relative to that before
   real(wp), parameter :: path_tolerance = 1.0e-8_wp
   integer, parameter :: path_iterations = 15

   !> A motion with prescribed amplitudes of the unknown tones.
   type :: way_point_t
      real(wp), allocatable :: u(:, :)                                ! [m], (n_coefficients, n_dofs)
      real(wp), allocatable :: omega(:), xi(:)                        ! [rad/s], [1/s], (unknown tones)
      real(wp), allocatable :: amplitude(:)                           ! [m], (unknown tones)
   end type way_point_t

   !> A search and what it found. `phase` is the problem solved last, on the balance of `new_search`.
   type :: search_t
      type(balance_t), pointer :: balance => null()
      type(rest_t) :: rest
      type(phase_problem_t) :: phase
      type(report_t) :: report
      character(:), allocatable :: message                            !! why nothing was found
      real(wp) :: length = 1.0_wp                                     !! typical motion [m]
      real(wp) :: reached = 0.0_wp                                    !! largest amplitude of the scan, 0: none [m]
      logical :: is_neutral = .true.                                  !! nothing drove or damped the scan
      integer, allocatable :: tones(:)                                !! unknown ones
      integer, allocatable :: modes(:)                                !! of the rest, where each of them starts
      integer, allocatable :: phase_dofs(:)                           !! sine that is zero, by unknown tone; size 0: integral
      type(solver_config_t) :: config
      real(wp), allocatable, private :: reference(:, :, :)            ! shapes, (n_coefficients, n_dofs, unknown tones)
   contains
      procedure :: from_modes => search_from_modes
      procedure :: from_start => search_from_start
      procedure :: set_scales => search_set_scales
   end type search_t

contains

   !> Search on a balance with slopes. Rescues and Broyden's linear Jacobian are switched off: they know nothing of a rest
   !> that must not be found.
   subroutine new_search(self, balance, rest, tones, modes, phase_dofs, length, config)
      type(search_t), intent(out) :: self
      type(balance_t), intent(in), target :: balance
      type(rest_t), intent(in) :: rest
      integer, intent(in) :: tones(:)                                 !! unknown ones
      integer, intent(in) :: modes(:)                                 !! of the rest, one for each, or fewer
      integer, intent(in) :: phase_dofs(:)                            !! among those of the laws, one for each, or none
      real(wp), intent(in) :: length                                  !! [m], > 0
      type(solver_config_t), intent(in) :: config

      self%balance => balance
      self%rest = rest
      self%tones = tones
      self%modes = modes
      self%phase_dofs = phase_dofs
      self%length = length
      self%config = config
      self%config%rescue = .false.
      self%config%start_with_tangent = .true.
   end subroutine new_search

   !> Tries a first guess u, with the balance at its frequencies. Afterwards u is the motion if one was found.
   subroutine search_from_start(self, u, is_found)
      class(search_t), intent(inout) :: self
      real(wp), intent(inout) :: u(:, :)                              !! [m], (n_coefficients, n_dofs)
      logical, intent(out) :: is_found
      type(way_point_t) :: point

      point%u = u
      point%omega = self%balance%omega(self%tones)
      point%xi = 0.0_wp*point%omega
      call self%set_scales(maxval(norm2(u, dim=1)))
      call try_motion(self, point, is_found)
      if (is_found) u = point%u
   end subroutine search_from_start

   !> Searches from the modes. When nothing is found, u is the motion at rest, and status and message tell what is known.
   subroutine search_from_modes(self, u, is_found)
      class(search_t), intent(inout) :: self
      real(wp), intent(out) :: u(:, :)                                !! [m], (n_coefficients, n_dofs)
      logical, intent(out) :: is_found
      type(way_point_t) :: last, now
      real(wp) :: goal
      integer :: i
      logical :: is_solved

      is_found = .false.
      self%is_neutral = .true.
      self%reached = 0.0_wp
      if (allocated(self%message)) deallocate (self%message)
      do i = 1, n_amplitudes
         goal = self%length*first_amplitude*(last_amplitude/first_amplitude)**(real(i - 1, wp)/(n_amplitudes - 1))
         if (i == 1) then
            call begin(self, goal, now, is_solved)
         else
            call approach(self, last, spread(goal, 1, size(self%tones)), now, is_solved)
         end if
         if (.not. is_solved) exit
         last = now
         self%reached = goal
         self%is_neutral = self%is_neutral .and. all(abs(now%xi) <= neutral*now%omega)
         if (any(now%xi < -neutral*now%omega)) then
            call follow(self, now, is_found)
            exit
         end if
      end do
      u = self%rest%u
      if (is_found) then
         u = now%u
         return
      end if
      self%report%residual = self%rest%report%residual
      if (allocated(self%message) .and. self%report%status == outcome%stalled) return
      self%report%status = outcome%no_motion
      if (self%rest%is_forced .or. size(self%tones) > 1) self%report%status = outcome%collapsed
      if (allocated(self%message)) return
      if (self%reached <= 0.0_wp) then
         self%report%status = outcome%stalled
         self%message = "no motion with a small amplitude of the unknown tones was found to start from"
      else if (self%is_neutral) then
         self%message = "nothing drives or damps the unknown tone: give its amplitude in &normal_mode"
      else
         self%message = "damped at the amplitudes tried, "//to_text(self%length*first_amplitude)//" to "//to_text(self%reached)
      end if
   end subroutine search_from_modes

   !> First point on the way, at the amplitude asked for; where an unstable rest is left but nothing drives the motion there
   !> any more, at a hundredth, and so on.
   subroutine begin(self, amplitude, point, is_solved)
      type(search_t), intent(inout) :: self
      real(wp), intent(in) :: amplitude                               !! [m]
      type(way_point_t), intent(out) :: point
      logical, intent(out) :: is_solved
      integer, parameter :: most_tries = 4
      integer :: try

      do try = 0, most_tries - 1
         call shape_references(self)
         point%amplitude = spread(amplitude*0.01_wp**try, 1, size(self%tones))
         point%u = self%rest%u + point%amplitude(1)*sum(self%reference, dim=3)
         associate (modes => self%rest%modes)
            point%omega = modes%frequency(self%modes)
            point%xi = -2.0_wp*modes%growth(self%modes)
            call solve_with_amplitudes(self, point, .true., is_solved)
            if (.not. is_solved .or. all(modes%growth(self%modes) <= neutral*modes%frequency(self%modes))) return
            if (any(point%xi < -neutral*point%omega)) return
         end associate
      end do
   end subroutine begin

   !> Lets the amplitudes follow the artificial damping until that is nearly gone, then tries the motion without it.
   subroutine follow(self, now, is_found)
      type(search_t), intent(inout) :: self
      type(way_point_t), intent(inout) :: now
      logical, intent(out) :: is_found
      type(way_point_t) :: last, trial
      real(wp), dimension(size(self%tones)) :: growth, sign_before
      real(wp) :: next_try, smallest
      integer :: step
      logical :: has_turned(size(self%tones)), is_solved

      self%report%status = outcome%pending
      has_turned = .false.
      smallest = min(minval(now%amplitude), first_amplitude*self%length)
      growth = longest_growth
      sign_before = sign(1.0_wp, now%xi)
      next_try = nearly_gone
      do step = 1, most_steps
         is_found = .false.
         if (all(has_turned) .and. maxval(abs(now%xi)/now%omega) <= next_try) then
            trial = now
            call try_motion(self, trial, is_found)
            if (is_found) now = trial
            if (is_found) return
            next_try = 0.3_wp*maxval(abs(now%xi)/now%omega)
         end if
         if (maxval(now%amplitude) > largest_amplitude*self%length) then
            self%message = "driven at all amplitudes tried: the motion grows without bound"
            return
         end if
         if (any(now%amplitude < 0.3_wp*smallest .and. now%xi > 0.0_wp)) then
            self%message = "the motion of an unknown tone dies out beside that of another"
            return
         end if
         last = now
         call approach(self, last, last%amplitude*exp(-sign(growth, last%xi)), now, is_solved)
         if (is_solved) then
            where (sign(1.0_wp, now%xi) == sign_before)
               growth = min(longest_growth, 1.3_wp*growth)
            elsewhere
               growth = 0.3_wp*growth
               has_turned = .true.
            end where
            sign_before = sign(1.0_wp, now%xi)
         else
            now = last
            growth = 0.3_wp*growth
         end if
         if (maxval(growth) < shortest_growth) exit
      end do
      self%report%status = outcome%stalled
      self%message = "lost on the way to the motion, at amplitude "//to_text(maxval(now%amplitude))//" and damping xi/omega "// &
                     to_text(maxval(abs(now%xi)/now%omega))
   end subroutine follow

   !> Solves at other amplitudes from the point `last`, by smaller steps where the whole one fails. `now` is the last point
   !> reached.
   subroutine approach(self, last, goal, now, is_solved)
      type(search_t), intent(inout) :: self
      type(way_point_t), intent(in) :: last
      real(wp), intent(in) :: goal(:)                                 !! [m], (unknown tones)
      type(way_point_t), intent(out) :: now
      logical, intent(out) :: is_solved
      integer, parameter :: most_solutions = 24
      type(way_point_t) :: trial
      real(wp) :: share
      integer :: i

      now = last
      share = 1.0_wp
      do i = 1, most_solutions
         trial = now
         trial%amplitude = now%amplitude*(goal/now%amplitude)**share
         call scale_tones(self, now, trial)
         call solve_with_amplitudes(self, trial, .false., is_solved)
         if (is_solved) then
            now = trial
            if (share >= 1.0_wp) return
            share = 1.0_wp
         else
            share = 0.4_wp*share
            if (share < 1.0e-3_wp) return
         end if
      end do
      is_solved = .false.
   end subroutine approach

   !> Predictor: each harmonic grows with the unknown tone that turns most in it.
   subroutine scale_tones(self, from, to)
      type(search_t), intent(in) :: self
      type(way_point_t), intent(in) :: from
      type(way_point_t), intent(inout) :: to
      integer :: h, m

      associate (set => self%balance%harmonics)
         do h = 1, set%n_harmonics
            associate (j => set%tuples(self%tones, h))
               if (all(j == 0)) cycle
               m = maxloc(abs(j), dim=1)
               to%u(set%cos_at(h), :) = from%u(set%cos_at(h), :)*to%amplitude(m)/from%amplitude(m)
               to%u(set%sin_at(h), :) = from%u(set%sin_at(h), :)*to%amplitude(m)/from%amplitude(m)
            end associate
         end do
      end associate
   end subroutine scale_tones

   !> Shapes of the modes in the fundamental of their tones, real and 1 where they are largest.
   subroutine shape_references(self)
      type(search_t), intent(inout) :: self
      complex(wp) :: form(self%balance%n_dofs)
      integer :: h, m

      associate (set => self%balance%harmonics)
         if (allocated(self%reference)) deallocate (self%reference)
         allocate (self%reference(set%n_coefficients, self%balance%n_dofs, size(self%tones)), source=0.0_wp)
         do m = 1, size(self%tones)
            h = fundamental(set, self%tones(m))
            form = self%rest%modes%shapes(:, self%modes(m))
            form = form/form(maxloc(abs(form), dim=1))
            self%reference(set%cos_at(h), :, m) = real(form)
            self%reference(set%sin_at(h), :, m) = -aimag(form)
         end do
      end associate
   end subroutine shape_references

   !> Number of the harmonic that is the tone itself.
   pure integer function fundamental(set, tone)
      type(harmonics_t), intent(in) :: set
      integer, intent(in) :: tone
      integer :: m

      fundamental = set%index_of([(merge(1, 0, m == tone), m=1, set%n_tones)])
   end function fundamental

   !> Newton's method with prescribed amplitudes and free artificial damping. The shapes then become those of the motion found.
   subroutine solve_with_amplitudes(self, point, is_first, is_solved)
      type(search_t), intent(inout) :: self
      type(way_point_t), intent(inout) :: point
      logical, intent(in) :: is_first                                 !! nothing better to start from: try smaller sets too
      logical, intent(out) :: is_solved
      type(phase_problem_t) :: problem
      type(report_t) :: report
      type(solver_config_t) :: config
      real(wp), allocatable :: forms(:, :), scale(:, :), x(:)
      integer :: h, m, n

      n = size(self%tones)
      call move_balance(self, point, is_solved)
      if (.not. is_solved) return
      call self%set_scales(maxval(point%amplitude))
      scale = reshape(self%balance%x_scale, shape(point%u))
      allocate (forms(size(point%u), 2*n))
      do m = 1, n
         h = fundamental(self%balance%harmonics, self%tones(m))
         forms(:, m) = shift_form(self%balance%harmonics, self%tones(m), self%reference(:, :, m), scale)
         forms(:, n + m) = amplitude_form(self%balance%harmonics, h, self%reference(:, :, m), scale)
      end do
      call new_phase_problem(problem, self%balance, self%tones, .true., forms, [0.0_wp*point%amplitude, point%amplitude])
      config = self%config
      config%tolerance = max(path_tolerance, config%tolerance)
      config%max_iterations = path_iterations
      x = problem%unknowns(point%u)
      call solve_newton(problem, config, x, report)
      call add_effort(self, report)
      if (report%status /= outcome%converged .and. is_first) then
         x = problem%unknowns(point%u)
         call climb_orders(problem, config, x, report)
         call add_effort(self, report)
      end if
      is_solved = report%status == outcome%converged
      if (.not. is_solved) return
      point%u = reshape(x(:size(point%u)), shape(point%u))
      point%omega = x(size(point%u) + 1:size(point%u) + n)
      point%xi = x(size(point%u) + n + 1:)
      self%reference = 0.0_wp
      do m = 1, n
         h = fundamental(self%balance%harmonics, self%tones(m))
         associate (a => self%balance%harmonics%cos_at(h), b => self%balance%harmonics%sin_at(h))
            self%reference([a, b], :, m) = point%u([a, b], :)/point%amplitude(m)
         end associate
      end do
   end subroutine solve_with_amplitudes

   !> Newton's method with the harmonics up to order 1, 2, 4, ... only, each from the one before, then with all. Order 1 is
   !> close to the linear mode with the stiffness that the laws have on average.
   subroutine climb_orders(problem, config, x, report)
      type(phase_problem_t), intent(inout) :: problem
      type(solver_config_t), intent(in) :: config
      real(wp), intent(inout), contiguous :: x(:)
      type(report_t), intent(out) :: report
      type(report_t) :: attempt
      integer :: order

      order = 1
      do
         call problem%hold_above(order)
         if (allocated(problem%is_held)) then
            where (problem%is_held) x(:size(problem%is_held)) = 0.0_wp
         end if
         call solve_newton(problem, config, x, attempt)
         report%iterations = report%iterations + attempt%iterations
         report%evaluations = report%evaluations + attempt%evaluations
         report%factorizations = report%factorizations + attempt%factorizations
         report%status = attempt%status
         report%residual = attempt%residual
         if (report%status /= outcome%converged .or. .not. allocated(problem%is_held)) exit
         order = 2*order
      end do
      call problem%hold_above(huge(order))
   end subroutine climb_orders

   !> Solves without artificial damping from a point nearby; found is a motion in which every unknown tone lives.
   subroutine try_motion(self, point, is_found)
      type(search_t), intent(inout) :: self
      type(way_point_t), intent(inout) :: point
      logical, intent(out) :: is_found
      real(wp), allocatable :: forms(:, :), scale(:, :), x(:), u(:, :)
      real(wp) :: before(size(self%tones))
      type(report_t) :: report
      integer :: m

      point%xi = 0.0_wp
      call move_balance(self, point, is_found)
      if (.not. is_found) return
      u = point%u
      scale = reshape(self%balance%x_scale, shape(u))
      allocate (forms(size(u), size(self%tones)))
      do m = 1, size(self%tones)
         before(m) = norm2(fundamental_part(u, m))
         if (size(self%phase_dofs) == 0) then
            forms(:, m) = shift_form(self%balance%harmonics, self%tones(m), u, scale)
         else
            call make_sine_form(m, forms(:, m))
         end if
      end do
      is_found = all(before > 0.0_wp)
      if (.not. is_found) return
      call new_phase_problem(self%phase, self%balance, self%tones, .false., forms, 0.0_wp*point%omega)
      x = self%phase%unknowns(u)
      call solve(self%phase, self%config, x, x, report)
      call add_effort(self, report)
      is_found = report%status == outcome%converged
      if (.not. is_found) return
      u = reshape(x(:size(u)), shape(u))
      is_found = all([(norm2(fundamental_part(u, m)) > dead*before(m), m=1, size(before))])
      if (.not. is_found) return
      point%u = u
      point%omega = x(size(u) + 1:)
      call self%phase%move_to(x, is_found)
      self%report%status = report%status
      self%report%residual = report%residual

   contains

      !> The condition that the sine of tone m vanishes at its degree of freedom; the motion is turned that way first.
      subroutine make_sine_form(m, form)
         integer, intent(in) :: m
         real(wp), intent(out) :: form(:)
         integer :: h

         associate (set => self%balance%harmonics, dof => self%phase_dofs(m))
            h = fundamental(set, self%tones(m))
            call turn(set, self%tones(m), atan2(u(set%sin_at(h), dof), u(set%cos_at(h), dof)), u)
            form = coefficient_form(set, size(u, 2), set%sin_at(h), dof)
         end associate
      end subroutine make_sine_form

      !> Coefficients of the unknown tone m itself.
      function fundamental_part(motion, m) result(part)
         real(wp), intent(in) :: motion(:, :)
         integer, intent(in) :: m
         real(wp) :: part(2, size(motion, 2))

         associate (set => self%balance%harmonics)
            part = motion([set%cos_at(fundamental(set, self%tones(m))), set%sin_at(fundamental(set, self%tones(m)))], :)
         end associate
      end function fundamental_part
   end subroutine try_motion

   !> Puts the balance at the frequencies and the artificial damping of a point.
   subroutine move_balance(self, point, is_possible)
      type(search_t), intent(inout) :: self
      type(way_point_t), intent(in) :: point
      logical, intent(out) :: is_possible
      real(wp), dimension(size(self%balance%omega)) :: omega, xi
      type(error_t), allocatable :: error

      omega = self%balance%omega
      xi = 0.0_wp
      omega(self%tones) = point%omega
      xi(self%tones) = point%xi
      call self%balance%move(omega, xi, error)
      is_possible = .not. allocated(error)
   end subroutine move_balance

   !> Scales for a motion of the given magnitude: forces are those of inertia and stiffness in the unknown tones.
   subroutine search_set_scales(self, magnitude)
      class(search_t), intent(inout) :: self
      real(wp), intent(in) :: magnitude                               !! [m], > 0
      real(wp) :: force(self%balance%n_dofs), motion
      integer :: h, i, m

      motion = max(magnitude, maxval(norm2(self%rest%u, dim=1)))
      force = 0.0_wp
      associate (b => self%balance, n => self%balance%harmonics%n_coefficients)
         do m = 1, size(self%tones)
            h = fundamental(b%harmonics, self%tones(m))
            do i = 1, b%n_dofs
               force(i) = max(force(i), motion*abs(b%stiffness%condensed(i, i, h)), &
                              motion*abs(b%frequencies(h)*b%stiffness%condensed_slope(i, i, h)))
            end do
         end do
         where (force <= epsilon(1.0_wp)*maxval(force)) force = maxval(force)
         b%x_scale = motion
         b%r_scale = [(spread(force(i), 1, n), i=1, b%n_dofs)]
      end associate
   end subroutine search_set_scales

   pure subroutine add_effort(self, report)
      type(search_t), intent(inout) :: self
      type(report_t), intent(in) :: report

      self%report%iterations = self%report%iterations + report%iterations
      self%report%evaluations = self%report%evaluations + report%evaluations
      self%report%factorizations = self%report%factorizations + report%factorizations
   end subroutine add_effort
end module hb_self_excitation
