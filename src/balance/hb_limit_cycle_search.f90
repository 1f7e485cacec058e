!> The search for self-excited motion: its start and result, and the two problems that it solves.
!> With prescribed amplitudes of the unknown tones and artificial damping xi_m of each as unknowns instead, there is a
!> solution near each mode of the base motion, with xi_m = -2 (growth rate of the mode). If xi_m < 0 the motion is
!> driven and would grow. Near xi_m = 0 the problem without artificial damping is solved. Source: docs/why/theory.md,
!> section 6.5; Krack, Computers and Structures 154 (2015) 59-71, for the artificial damping.
module hb_limit_cycle_search
   use hb_balance, only: balance_t
   use hb_base_motion, only: base_motion_t
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_newton, only: solve_newton
   use hb_outcome, only: outcome
   use hb_phase, only: amplitude_functional, coefficient_functional, new_phase_problem, phase_problem_t, shift_functional
   use hb_solver, only: solve
   use hb_solver_types, only: report_t, solver_config_t
   use hb_thresholds, only: equality_tolerance, nearby_steps, negligible_share, rounding_level
   implicit none
   private
   public :: continue_in_order, first_amplitude, fundamental, last_amplitude, max_steps, new_search, path_point_t
   public :: search_t

   real(wp), parameter :: first_amplitude = 1.0e-3_wp                 !! of a search, relative to the length of the model
   real(wp), parameter :: last_amplitude = 1.0e3_wp                   !! likewise
   integer, parameter :: max_steps = 600                             !! of a path of motions over the amplitude or the damping

   !> A motion with prescribed amplitudes of the unknown tones.
   type :: path_point_t
      real(wp), allocatable :: u(:, :)                                !! [m], (n_coefficients, n_dofs)
      real(wp), allocatable :: omega(:), xi(:)                        !! [rad/s], [1/s], (unknown tones)
      real(wp), allocatable :: amplitude(:)                           !! [m], (unknown tones)
   end type path_point_t

   !> A search and its results. `phase` is the last problem, on the balance of `new_search`.
   type :: search_t
      type(balance_t), pointer :: balance => null()
      type(base_motion_t) :: base
      type(phase_problem_t) :: phase
      type(report_t) :: report
      character(:), allocatable :: message                            !! why nothing was found, or a remark on the motion found
      integer :: advice = 0                                           !! of the table of advice, if nothing was found
      real(wp) :: length = 1.0_wp                                     !! typical motion [m]
      real(wp) :: reached = 0.0_wp                                    !! largest amplitude of the search, 0: none [m]
      logical :: is_neutral = .true.                                  !! nothing drove or damped the motion
      logical :: is_left = .false.                                    !! nearby motions appear to diverge from the one found
      logical :: is_driven = .false.                                  !! at some amplitude of the search
      logical :: runs_away = .false.                                  !! up to the largest amplitude tried
      integer, allocatable :: tones(:)                                !! unknown ones
      integer, allocatable :: modes(:)                                !! of the base motion, where each of them starts
      integer, allocatable :: phase_dofs(:)                           !! sine that is zero, by unknown tone; size 0: integral
      type(solver_config_t) :: config
      real(wp), allocatable, private :: sense(:)                      ! 1 if negative xi drives, otherwise -1, (unknown tones)
      real(wp), allocatable, private :: reference(:, :, :)            ! shapes, (n_coefficients, n_dofs, unknown tones)
   contains
      procedure :: from_start => search_from_start
      procedure :: begin => search_begin
      procedure :: damping => search_damping
      procedure :: solve_with_amplitudes => search_solve_with_amplitudes
      procedure :: try_motion => search_try_motion
      procedure :: move_balance => search_move_balance
      procedure :: path_config => search_path_config
      procedure :: set_scales => search_set_scales
   end type search_t

contains

   !> Creates a search on a balance with slopes. Fallbacks and Broyden's linear Jacobian are disabled, because they do
   !> not exclude the base motion.
   subroutine new_search(self, balance, base, tones, modes, phase_dofs, length, config)
      type(search_t), intent(out) :: self
      type(balance_t), intent(inout), target :: balance
      type(base_motion_t), intent(in) :: base
      integer, intent(in) :: tones(:)                                 !! unknown ones
      integer, intent(in) :: modes(:)                                 !! of the base motion, one for each, or fewer
      integer, intent(in) :: phase_dofs(:)                            !! among those of the laws, one for each, or none
      real(wp), intent(in) :: length                                  !! [m], > 0
      type(solver_config_t), intent(in) :: config

      self%balance => balance
      self%base = base
      self%tones = tones
      self%modes = modes
      self%phase_dofs = phase_dofs
      self%length = length
      self%config = config
      self%config%fallback = .false.
      self%config%repeats_tangent = .false. ! if there are several motions, the path decides which one is found
      self%config%start_with_tangent = .true.
   end subroutine new_search

   !> Tries a first guess u, with the balance at its frequencies. On success u is the motion found.
   subroutine search_from_start(self, u, is_found)
      class(search_t), intent(inout) :: self
      real(wp), intent(inout) :: u(:, :)                              !! [m], (n_coefficients, n_dofs)
      logical, intent(out) :: is_found
      type(path_point_t) :: point

      allocate (point%u, source=u)
      allocate (point%omega(size(self%tones)), source=self%balance%omega(self%tones))
      allocate (point%xi(size(self%tones)), source=0.0_wp)
      call self%set_scales(maxval(norm2(u, dim=1)))
      call self%try_motion(point, is_found)
      if (is_found) u = point%u
   end subroutine search_from_start

   !> First point of the path, at the given amplitude; if the base motion is unstable but the motion is damped there,
   !> at a hundredth of it, and so on.
   subroutine search_begin(self, amplitude, point, is_solved)
      class(search_t), intent(inout) :: self
      real(wp), intent(in) :: amplitude                               !! [m]
      type(path_point_t), intent(out) :: point
      logical, intent(out) :: is_solved
      real(wp) :: smaller

      smaller = amplitude
      do
         call shape_references(self)
         point%amplitude = spread(smaller, 1, size(self%tones))
         point%u = self%base%u + point%amplitude(1)*sum(self%reference, dim=3)
         associate (modes => self%base%modes)
            point%omega = modes%frequency(self%modes)
            self%sense = sign(1.0_wp, modes%response(self%modes))
            point%xi = -modes%growth(self%modes)/modes%response(self%modes)
            call self%solve_with_amplitudes(point, .true., is_solved)
            if (.not. is_solved .or. all(modes%growth(self%modes) <= rounding_level*modes%frequency(self%modes))) return
            if (any(self%damping(point) < -rounding_level)) return
         end associate
         smaller = 0.01_wp*smaller
         if (smaller < rounding_level*self%length) return
      end do
   end subroutine search_begin

   !> Damping ratio |xi|/omega of the motion of each unknown tone without the artificial damping, negative if it is
   !> driven. In a rotating frame a mode that travels against the rotation may be damped by forces that drive others:
   !> the sign is that of the mode at which the search begins.
   pure function search_damping(self, point) result(damping)
      class(search_t), intent(in) :: self
      type(path_point_t), intent(in) :: point
      real(wp) :: damping(size(self%tones))

      damping = self%sense*point%xi/point%omega
   end function search_damping

   !> Shapes of the modes in the fundamental of their tones, real and 1 at their maximum.
   subroutine shape_references(self)
      type(search_t), intent(inout) :: self
      complex(wp) :: mode_shape(self%balance%n_dofs)
      integer :: h, m

      associate (set => self%balance%harmonics)
         if (allocated(self%reference)) deallocate (self%reference)
         allocate (self%reference(set%n_coefficients, self%balance%n_dofs, size(self%tones)), source=0.0_wp)
         do m = 1, size(self%tones)
            h = fundamental(set, self%tones(m))
            mode_shape = self%base%modes%shapes(:, self%modes(m))
            mode_shape = mode_shape/mode_shape(maxloc(abs(mode_shape), dim=1))
            self%reference(set%cos_at(h), :, m) = real(mode_shape)
            self%reference(set%sin_at(h), :, m) = -aimag(mode_shape)
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

   !> Newton's method with prescribed amplitudes and unknown artificial damping. The shapes then become those of the
   !> motion found.
   subroutine search_solve_with_amplitudes(self, point, is_first, is_solved)
      class(search_t), intent(inout) :: self
      type(path_point_t), intent(inout) :: point
      logical, intent(in) :: is_first                                 !! there is no better start: also try smaller sets
      logical, intent(out) :: is_solved
      type(phase_problem_t) :: problem
      type(report_t) :: report
      type(solver_config_t) :: config
      real(wp), allocatable :: functionals(:, :), scale(:, :), x(:)
      integer :: h, m, n

      n = size(self%tones)
      call self%move_balance(point, is_solved)
      if (.not. is_solved) return
      call self%set_scales(maxval(point%amplitude))
      scale = reshape(self%balance%x_scale, shape(point%u))
      allocate (functionals(size(point%u), 2*n))
      do m = 1, n
         h = fundamental(self%balance%harmonics, self%tones(m))
         functionals(:, m) = shift_functional(self%balance%harmonics, self%tones(m), self%reference(:, :, m), scale)
         functionals(:, n + m) = amplitude_functional(self%balance%harmonics, h, self%reference(:, :, m), scale)
      end do
      call new_phase_problem(problem, self%balance, self%tones, .true., functionals, [0.0_wp*point%amplitude, point%amplitude])
      config = self%path_config()
      allocate (x, source=problem%unknowns([point%u]))
      call solve_newton(problem, config, x, report)
      call self%report%add(report)
      if (report%status /= outcome%converged .and. is_first) then
         x = problem%unknowns([point%u])
         call continue_in_order(problem, self%balance%harmonics, config, x, report)
         call self%report%add(report)
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
   end subroutine search_solve_with_amplitudes

   !> Settings of the solver along the path.
   pure function search_path_config(self) result(config)
      class(search_t), intent(in) :: self
      type(solver_config_t) :: config

      config = self%config
      config%tolerance = max(equality_tolerance, config%tolerance)
      config%max_iterations = nearby_steps
   end function search_path_config

   !> Newton's method with only the harmonics up to order 1, 2, 4, ..., each from the previous solution, then with
   !> all. Order 1 is close to the linear mode with the mean stiffness of the laws.
   subroutine continue_in_order(problem, harmonics, config, x, report)
      type(phase_problem_t), intent(inout) :: problem
      type(harmonics_t), intent(in) :: harmonics
      type(solver_config_t), intent(in) :: config
      real(wp), intent(inout), contiguous :: x(:)
      type(report_t), intent(out) :: report
      type(report_t) :: attempt
      integer :: order

      order = 1
      do
         call problem%hold_above(harmonics, order)
         if (allocated(problem%is_held)) then
            where (problem%is_held) x(:size(problem%is_held)) = 0.0_wp
         end if
         call solve_newton(problem, config, x, attempt)
         call report%add(attempt)
         report%status = attempt%status
         report%residual = attempt%residual
         if (report%status /= outcome%converged .or. .not. allocated(problem%is_held)) exit
         order = 2*order
      end do
      call problem%hold_above(harmonics, huge(order))
   end subroutine continue_in_order

   !> Solves without artificial damping from a point nearby; accepts a motion that contains every unknown tone.
   subroutine search_try_motion(self, point, is_found)
      class(search_t), intent(inout) :: self
      type(path_point_t), intent(inout) :: point
      logical, intent(out) :: is_found
      real(wp), allocatable :: functionals(:, :), scale(:, :), x(:), u(:, :)
      real(wp) :: before(size(self%tones))
      type(report_t) :: report
      integer :: m

      point%xi = 0.0_wp
      call self%move_balance(point, is_found)
      if (.not. is_found) return
      u = point%u
      scale = reshape(self%balance%x_scale, shape(u))
      allocate (functionals(size(u), size(self%tones)))
      do m = 1, size(self%tones)
         before(m) = norm2(fundamental_part(u, m))
         if (size(self%phase_dofs) == 0) then
            functionals(:, m) = shift_functional(self%balance%harmonics, self%tones(m), u, scale)
         else
            call make_sine_functional(m, functionals(:, m))
         end if
      end do
      is_found = all(before > 0.0_wp)
      if (.not. is_found) return
      call new_phase_problem(self%phase, self%balance, self%tones, .false., functionals, 0.0_wp*point%omega)
      allocate (x, source=self%phase%unknowns([u]))
      call solve(self%phase, self%config, x, x, report)
      call self%report%add(report)
      is_found = report%status == outcome%converged
      if (.not. is_found) return
      u = reshape(x(:size(u)), shape(u))
      is_found = all([(norm2(fundamental_part(u, m)) > negligible_share*before(m), m=1, size(before))])
      if (.not. is_found) return
      point%u = u
      point%omega = x(size(u) + 1:)
      call self%phase%move_to(x, is_found)
      self%report%status = report%status
      self%report%residual = report%residual

   contains

      !> The condition that the sine of tone m vanishes at its degree of freedom; the motion is first shifted
      !> accordingly.
      subroutine make_sine_functional(m, functional)
         integer, intent(in) :: m
         real(wp), intent(out) :: functional(:)
         real(wp) :: angle
         integer :: h

         associate (set => self%balance%harmonics, dof => self%phase_dofs(m))
            h = fundamental(set, self%tones(m))
            angle = atan2(u(set%sin_at(h), dof), u(set%cos_at(h), dof))
            u = set%times(exp(cmplx(0.0_wp, set%tuples(self%tones(m), :)*angle, wp)), u)
            functional = coefficient_functional(set, size(u, 2), set%sin_at(h), dof)
         end associate
      end subroutine make_sine_functional

      !> Coefficients of the unknown tone m itself.
      function fundamental_part(motion, m) result(part)
         real(wp), intent(in) :: motion(:, :)
         integer, intent(in) :: m
         real(wp) :: part(2, size(motion, 2))

         associate (set => self%balance%harmonics)
            part = motion([set%cos_at(fundamental(set, self%tones(m))), set%sin_at(fundamental(set, self%tones(m)))], :)
         end associate
      end function fundamental_part
   end subroutine search_try_motion

   !> Sets the balance to the frequencies and the artificial damping of a point.
   subroutine search_move_balance(self, point, is_possible)
      class(search_t), intent(inout) :: self
      type(path_point_t), intent(in) :: point
      logical, intent(out) :: is_possible
      real(wp), dimension(size(self%balance%omega)) :: omega, xi
      type(error_t), allocatable :: error

      omega = self%balance%omega
      xi = 0.0_wp
      omega(self%tones) = point%omega
      xi(self%tones) = point%xi
      call self%balance%move(omega, xi, error)
      is_possible = .not. allocated(error)
   end subroutine search_move_balance

   !> Scales for a motion of the given magnitude: forces are those of inertia and stiffness in the unknown tones.
   subroutine search_set_scales(self, magnitude)
      class(search_t), intent(inout) :: self
      real(wp), intent(in) :: magnitude                               !! [m], > 0
      real(wp) :: force(self%balance%n_dofs), motion
      integer :: h, i, m

      motion = max(magnitude, maxval(norm2(self%base%u, dim=1)))
      force = 0.0_wp
      associate (b => self%balance)
         do m = 1, size(self%tones)
            h = fundamental(b%harmonics, self%tones(m))
            do i = 1, b%n_dofs
               associate (row => b%stiffness%pattern%shift(i) + i)
                  force(i) = max(force(i), motion*abs(b%stiffness%condensed(row, i, h)), &
                                 motion*abs(b%frequencies(h)*b%stiffness%condensed_slope(row, i, h)))
               end associate
            end do
         end do
         where (force <= epsilon(1.0_wp)*maxval(force)) force = maxval(force)
         call b%set_scales(spread(motion, 1, b%n_dofs), force)
      end associate
   end subroutine search_set_scales
end module hb_limit_cycle_search
