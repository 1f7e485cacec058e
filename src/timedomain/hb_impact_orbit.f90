!> A periodic motion with impacts on rigid walls, as the state that returns to itself after a period (shooting), and a
!> value of the input on which it depends.
!>
!> The period map is integrated event by event, so that it contains the jumps of the velocities. Its derivatives are
!> extrapolated differences (hb_period_map) of states from which the same walls are struck as often: they include the
!> effect of impacts on a disturbance (saltation). The section of the map is a phase of the tone far from impacts.
!> Sources: S. W. Shaw and P. J. Holmes, J. Sound Vib. 90 (1983) 129-155; A. H. Nayfeh and B. Balachandran, Applied
!> Nonlinear Dynamics, Wiley 1995, section 6.5.
module hb_impact_orbit
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_coordinates, only: coordinates_t
   use hb_difference_limit, only: distance_at, limit_t
   use hb_discretisation, only: discretisation_t
   use hb_error, only: error_t
   use hb_floquet, only: stability_of_map
   use hb_harmonics, only: harmonics_t
   use hb_integration_laws, only: collect_rigid
   use hb_integration_system, only: integration_state_t, integration_system_t, new_integration_system
   use hb_kinds, only: two_pi, wp
   use hb_model, only: model_t
   use hb_model_problem, only: moving_value_t, refusal_t
   use hb_motion_series, only: motion_series_t
   use hb_movement, only: movement_t, new_movement, set_movement
   use hb_options, only: options_t
   use hb_problem, only: problem_t
   use hb_stability, only: stability_t
   use hb_state_map, only: at_rest, far_from_events, farthest_phase, new_state_map, state_map_t
   use hb_structure, only: max_dense
   use hb_system, only: system_t
   use hb_time_domain, only: steady_motion_t
   use hb_time_stepping, only: integration_record_t
   implicit none
   private
   public :: accurate, impact_orbit_t, new_impact_orbit

   real(wp), parameter :: accurate = 1.0e-10_wp                       !! residual of a periodic motion, scaled

   real(wp), parameter :: accuracy = 1.0e-9_wp                        ! of the integration: all digits
   real(wp), parameter :: noise = 1.0e-12_wp                          ! of a period map, scaled
   real(wp), parameter :: enough = 1.0e-8_wp                          ! change of a derivative that needs no shorter distance
   real(wp), parameter :: nearer = 0.5_wp                             ! from one distance to the next: derivatives are large
   integer, parameter :: max_levels = 20                             ! distances; near a graze the long ones change the impacts
   integer, parameter :: min_samples = 8192                        ! in a period: their coefficients err by 1e-8 at impacts
   integer, parameter :: samples_of_harmonic = 64
   real(wp), parameter :: too_near = 0.5_wp                           ! to an event, relative to the farthest instant

   !> Owns memory: call `destroy`. Its parameter 1 is the moving value.
   type, extends(problem_t) :: impact_orbit_t
      type(model_t) :: model                                          !! at the present value
      type(moving_value_t), allocatable :: moving                     !! if present
      real(wp) :: value = 0.0_wp
      real(wp) :: section = 0.0_wp                                    !! phase of the map, part of a period
      integer, allocatable :: impacts(:)                              !! in the period after the last residual, as of a record
      type(refusal_t) :: refusal
      type(state_map_t) :: map
      type(integration_system_t), pointer, private :: system => null()
      real(wp), allocatable, private :: known(:), slopes(:, :)        ! state and value with the last derivatives of the map
   contains
      procedure :: residual => impact_orbit_residual
      procedure :: tangent => impact_orbit_tangent
      procedure :: solve_linear => impact_orbit_solve_linear
      procedure :: rounding_level => impact_orbit_rounding_level
      procedure :: deform => impact_orbit_deform
      procedure :: parameters => impact_orbit_parameters
      procedure :: parameter_scales => impact_orbit_parameter_scales
      procedure :: set_parameters => impact_orbit_set_parameters
      procedure :: parameter_derivative => impact_orbit_parameter_derivative
      procedure :: period => impact_orbit_period
      procedure :: state_after => impact_orbit_state_after
      procedure :: put_section => impact_orbit_put_section
      procedure :: move_section => impact_orbit_move_section
      procedure :: better_section => impact_orbit_better_section
      procedure :: describe => impact_orbit_describe
      procedure :: series_of => impact_orbit_series_of
      procedure :: stability => impact_orbit_stability
      procedure :: move => impact_orbit_move
      procedure :: destroy => impact_orbit_destroy
   end type impact_orbit_t

contains

   !> Creates the problem of a model with one given tone near a motion; fails for laws that no integrator supports.
   subroutine new_impact_orbit(self, system, discretisation, options, motion, error)
      type(impact_orbit_t), intent(out) :: self
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(motion_series_t), intent(in) :: motion                     !! of all degrees of freedom
      type(error_t), allocatable, intent(out) :: error

      self%model%system = system
      self%model%discretisation = discretisation
      self%model%options = options
      call system%structure%check_matrices("integration", max_dense, error)
      if (allocated(error)) return
      allocate (self%system)
      call put_system(self)
      call new_state_map(self%map, self%system, motion, options%integration%restitution, accuracy, error)
      if (allocated(error)) return
      self%section = farthest_phase(self%map)/two_pi
      self%n_unknowns = size(self%map%scale)
      self%x_scale = 0.0_wp*self%map%scale + 1.0_wp
      self%r_scale = self%x_scale
      self%residual_work = self%map%work_of(1)
      self%tangent_work = (6*self%n_unknowns + 1)*self%residual_work
   end subroutine new_impact_orbit

   !> Creates the equations of motion of the model.
   subroutine put_system(self)
      type(impact_orbit_t), intent(inout) :: self

      associate (model => self%model, omega => self%model%system%tones%omega)
         call new_integration_system(self%system, model%system%structure, model%system%laws, model%discretisation%loads%whole(), &
                                     model%discretisation%harmonics%frequencies(omega), omega)
      end associate
   end subroutine put_system

   !> Period [s] at the present value.
   pure real(wp) function impact_orbit_period(self) result(period)
      class(impact_orbit_t), intent(in) :: self

      period = two_pi/self%model%system%tones%omega(1)
   end function impact_orbit_period

   !> State after a part of a period from the section on, at a value.
   subroutine advance_part(self, x, value, part, after, is_done)
      class(impact_orbit_t), intent(inout) :: self
      real(wp), intent(in) :: x(:)                                    !! scaled
      real(wp), intent(in) :: value, part
      real(wp), intent(out) :: after(:)                               !! scaled; NaN if the integration fails
      logical, intent(out) :: is_done

      call self%set_parameters([1], [value], is_done)
      if (is_done) call self%map%advance(self%section*self%period(), part*self%period(), x, after, is_done)
      if (.not. is_done) after = ieee_value(1.0_wp, ieee_quiet_nan)
   end subroutine advance_part

   !> Changes of the state after a part of a period, and the derivative along a change of state and value, by a central
   !> difference.
   subroutine differ(self, x, change, of_value, distance, part, slope, is_done)
      class(impact_orbit_t), intent(inout) :: self
      real(wp), intent(in) :: x(:), change(:), of_value, distance, part
      real(wp), intent(out) :: slope(:)
      logical, intent(out) :: is_done                                 !! and the walls are struck as often on both sides
      real(wp) :: after(size(x), 2), value
      integer, allocatable :: impacts(:)
      logical :: is_possible

      slope = 0.0_wp
      value = self%value
      call advance_part(self, x + distance*change, value + distance*of_value, part, after(:, 1), is_done)
      if (is_done) then
         allocate (impacts, source=self%map%impacts)
         call advance_part(self, x - distance*change, value - distance*of_value, part, after(:, 2), is_done)
         if (is_done) then
            is_done = all(impacts == self%map%impacts)
            slope = (after(:, 1) - after(:, 2))/(2.0_wp*distance)
         end if
      end if
      call self%set_parameters([1], [value], is_possible)
   end subroutine differ

   !> The state at the section that follows from one at another time.
   subroutine impact_orbit_state_after(self, state, x, is_done)
      class(impact_orbit_t), intent(inout) :: self
      type(integration_state_t), intent(in) :: state
      real(wp), allocatable, intent(out) :: x(:)                      !! scaled
      logical, intent(out) :: is_done
      real(wp) :: after(self%n_unknowns)

      x = [state%q, state%v, state%s]/self%map%scale
      associate (period => self%period())
         call self%map%advance(state%time, (1.0_wp - modulo(state%time/period - self%section, 1.0_wp))*period, x, &
                             after, is_done)
      end associate
      if (is_done) x = after
   end subroutine impact_orbit_state_after

   subroutine impact_orbit_residual(self, x, r)
      class(impact_orbit_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(out), contiguous :: r(:)
      logical :: is_done

      call advance_part(self, x, self%value, 1.0_wp, r, is_done)
      r = r - x
      self%impacts = self%map%impacts
   end subroutine impact_orbit_residual

   subroutine impact_orbit_tangent(self, x, jacobian)
      class(impact_orbit_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(out), contiguous :: jacobian(:, :)
      integer :: k

      call differentiate(self, x)
      jacobian = 0.0_wp                                               ! singular: the solver detects it
      if (.not. allocated(self%slopes)) return
      jacobian = self%slopes(:, :size(x))
      do k = 1, size(x)
         jacobian(k, k) = jacobian(k, k) - 1.0_wp
      end do
   end subroutine impact_orbit_tangent

   !> Finds the derivatives of the map along all states and the value, per typical value.
   subroutine differentiate(self, x)
      class(impact_orbit_t), intent(inout) :: self
      real(wp), intent(in) :: x(:)
      type(limit_t) :: limit
      real(wp) :: axis(size(x) + 1), slopes(size(x), size(x) + 1)
      integer :: k, level
      logical :: is_done

      if (allocated(self%known)) then
         if (all(abs([x, self%value] - self%known) <= 0.0_wp)) return
      end if
      self%known = [x, self%value]
      if (allocated(self%slopes)) deallocate (self%slopes)
      slopes = 0.0_wp
      limit%ratio = nearer
      do level = 1, max_levels
         do k = 1, size(x) + merge(1, 0, allocated(self%moving))
            axis = 0.0_wp
            axis(k) = 1.0_wp
            call differ(self, x, axis(:size(x)), axis(size(axis))*sum(self%parameter_scales([1])), distance_at(level, nearer), &
                        1.0_wp, slopes(:, k), is_done)
            if (.not. is_done) exit
         end do
         if (.not. is_done) limit = limit_t(nearer)
         if (.not. is_done) cycle
         call limit%add(slopes)
         if (limit%estimate <= enough .or. limit%n_idle > 1) exit     ! rounding
      end do
      if (allocated(limit%best)) self%slopes = limit%best
   end subroutine differentiate

   subroutine impact_orbit_parameter_derivative(self, x, which, derivative)
      class(impact_orbit_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      integer, intent(in) :: which
      real(wp), intent(out), contiguous :: derivative(:)

      call differentiate(self, x)
      derivative = 0.0_wp
      if (allocated(self%slopes)) derivative = self%slopes(:, size(x) + 1)/self%moving%typical
   end subroutine impact_orbit_parameter_derivative

   !> Disturbances decay: the tangent is approximately -1.
   subroutine impact_orbit_solve_linear(self, r, step)
      class(impact_orbit_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: r(:)
      real(wp), intent(out), contiguous :: step(:)

      step = -r
   end subroutine impact_orbit_solve_linear

   real(wp) function impact_orbit_rounding_level(self, x)
      class(impact_orbit_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)

      impact_orbit_rounding_level = noise*max(1.0_wp, norm2(x))
   end function impact_orbit_rounding_level

   !> There is no easier problem.
   subroutine impact_orbit_deform(self, kind, amount)
      class(impact_orbit_t), intent(inout) :: self
      integer, intent(in) :: kind
      real(wp), intent(in) :: amount

   end subroutine impact_orbit_deform

   pure function impact_orbit_parameters(self, which) result(values)
      class(impact_orbit_t), intent(in) :: self
      integer, intent(in) :: which(:)
      real(wp) :: values(size(which))

      values = self%value
   end function impact_orbit_parameters

   pure function impact_orbit_parameter_scales(self, which) result(scales)
      class(impact_orbit_t), intent(in) :: self
      integer, intent(in) :: which(:)
      real(wp) :: scales(size(which))

      scales = 1.0_wp
      if (allocated(self%moving)) scales = self%moving%typical
   end function impact_orbit_parameter_scales

   !> Sets the value, and what follows it, in the model.
   subroutine impact_orbit_set_parameters(self, which, values, is_possible)
      class(impact_orbit_t), intent(inout) :: self
      integer, intent(in) :: which(:)
      real(wp), intent(in) :: values(:)
      logical, intent(out) :: is_possible
      type(error_t), allocatable :: error
      type(movement_t) :: movement

      is_possible = .true.
      if (abs(values(1) - self%value) <= 0.0_wp) return
      call new_movement(movement, self%model, self%moving%number, self%moving%is_tied, error)
      if (.not. allocated(error)) call set_movement(self%model, movement, values(1), error)
      if (.not. allocated(error)) then
         self%value = values(1)
         call put_system(self)
         call collect_rigid(self%system%laws, self%model%options%integration%restitution, self%map%rigid, error)
         self%map%motion%omega = self%model%system%tones%omega
      end if
      is_possible = .not. allocated(error)
      if (is_possible) then
         self%refusal%possible = values(1)
      else
         call self%refusal%note(error%message, values(1))
      end if
   end subroutine impact_orbit_set_parameters

   !> Assigns the value that moves.
   subroutine impact_orbit_move(self, moving, value)
      class(impact_orbit_t), intent(inout) :: self
      type(moving_value_t), intent(in) :: moving
      real(wp), intent(in) :: value                                   !! its value in the model

      self%moving = moving
      self%value = value
   end subroutine impact_orbit_move

   !> Stability of a periodic motion, with the multipliers of the map.
   type(stability_t) function impact_orbit_stability(self, x) result(stability)
      class(impact_orbit_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)

      call differentiate(self, x)
      if (allocated(self%slopes)) stability = stability_of_map(self%slopes(:, :size(x)), self%model%system%tones%omega(1))
   end function impact_orbit_stability

   !> Moves the section to another phase, and a state on it with a direction along which state and value change.
   subroutine impact_orbit_move_section(self, section, x, direction, of_value, is_done)
      class(impact_orbit_t), intent(inout) :: self
      real(wp), intent(in) :: section                                 !! part of a period
      real(wp), intent(inout) :: x(:), direction(:)
      real(wp), intent(in) :: of_value                                !! change of the value along the direction
      logical, intent(out) :: is_done
      real(wp) :: after(size(x)), slope(size(x))

      associate (part => modulo(section - self%section, 1.0_wp))
         call differ(self, x, direction, of_value, distance_at(1, nearer), part, slope, is_done)
         if (is_done) call advance_part(self, x, self%value, part, after, is_done)
      end associate
      if (.not. is_done) return
      x = after
      direction = slope
      call self%put_section(section)
   end subroutine impact_orbit_move_section

   !> Assigns the section, for states that lie on it.
   subroutine impact_orbit_put_section(self, section)
      class(impact_orbit_t), intent(inout) :: self
      real(wp), intent(in) :: section                                 !! part of a period

      self%section = section
      if (allocated(self%known)) deallocate (self%known)
   end subroutine impact_orbit_put_section

   !> Phase farthest from events of a periodic motion, or the present one if that is far enough.
   real(wp) function impact_orbit_better_section(self, x) result(section)
      class(impact_orbit_t), intent(inout) :: self
      real(wp), intent(in) :: x(:)
      real(wp), allocatable :: far(:), q(:, :), v(:, :)
      logical :: is_done

      section = self%section
      call sample(self, x, q, is_done)
      if (.not. is_done) return
      v = cshift(q, 1) - cshift(q, -1)
      allocate (far, source=far_from_events(self%map, q, v))
      if (far(1) > too_near*maxval(far)) return
      section = modulo(section + (maxloc(far, dim=1) - 1)/real(size(far), wp), 1.0_wp)
   end function impact_orbit_better_section

   !> Displacements of a period from the section on, (n_samples, n_dofs).
   subroutine sample(self, x, q, is_done)
      class(impact_orbit_t), intent(inout) :: self
      real(wp), intent(in) :: x(:)
      real(wp), allocatable, intent(out) :: q(:, :)
      logical, intent(out) :: is_done
      type(integration_record_t) :: record
      real(wp) :: after(size(x))
      integer :: i, n

      after = x
      n = max(min_samples, samples_of_harmonic*maxval(self%model%discretisation%harmonics%highest))
      associate (period => self%period())
         call self%map%record_from(self%section*period, period, n, [(i, i=1, self%system%n_dofs)], after, record, is_done)
      end associate
      if (is_done) q = record%every_displacement(:n, :)
   end subroutine sample

   !> One turn of a harmonic from the section on, at as many samples.
   pure function wave(self, order, n)
      type(impact_orbit_t), intent(in) :: self
      integer, intent(in) :: order, n
      complex(wp) :: wave(n)
      integer :: i

      wave = exp(cmplx(0.0_wp, two_pi*order*(self%section + [(i, i=0, n - 1)]/real(n, wp)), wp))
   end function wave

   !> Amplitudes, cos - i sin, of samples of a period from the section on, (n_harmonics, columns of z).
   pure function harmonics_of(self, set, z) result(amplitudes)
      type(impact_orbit_t), intent(in) :: self
      type(harmonics_t), intent(in) :: set
      real(wp), intent(in) :: z(:, :)                                 !! (n_samples, any)
      complex(wp) :: amplitudes(set%n_harmonics, size(z, 2))
      integer :: h

      do h = 1, set%n_harmonics
         associate (order => set%tuples(1, h), n => size(z, 1))
            amplitudes(h, :) = matmul(merge(1.0_wp, 2.0_wp, order == 0)/n*conjg(wave(self, order, n)), z)
         end associate
      end do
   end function harmonics_of

   !> Amplitudes, cos - i sin, of a degree of freedom of a motion; none if the integration fails.
   function impact_orbit_series_of(self, set, dof, x) result(c)
      class(impact_orbit_t), intent(inout) :: self
      type(harmonics_t), intent(in) :: set
      integer, intent(in) :: dof
      real(wp), intent(in) :: x(:)
      complex(wp), allocatable :: c(:)                                ! (n_harmonics)
      real(wp), allocatable :: q(:, :)
      logical :: is_done

      allocate (c(0))
      call sample(self, x, q, is_done)
      if (is_done) c = reshape(harmonics_of(self, set, q(:, [dof])), [set%n_harmonics])
   end function impact_orbit_series_of

   !> Derivative of the map and coefficients of a periodic motion at the harmonics of a model, with the part of it outside these.
   subroutine impact_orbit_describe(self, discretisation, options, coordinates, x, steady, is_done)
      class(impact_orbit_t), intent(inout) :: self
      type(discretisation_t), intent(in) :: discretisation            !! at the same value, with a set of its own
      type(options_t), intent(in) :: options
      type(coordinates_t), intent(in) :: coordinates
      real(wp), intent(in) :: x(:)
      type(steady_motion_t), intent(inout) :: steady
      logical, intent(out) :: is_done
      real(wp), allocatable :: q(:, :), remainder(:, :), z(:, :)
      integer :: h

      call sample(self, x, q, is_done)
      if (.not. is_done) return
      z = coordinates%values_of(q(:, coordinates%dofs))
      remainder = z
      associate (set => discretisation%harmonics, n => size(q, 1))
         steady%amplitudes = transpose(harmonics_of(self, set, q))
         steady%averages = harmonics_of(self, set, z)
         do h = 1, set%n_harmonics
            remainder = remainder - real(spread(wave(self, set%tuples(1, h), n), 2, size(z, 2))* &
                                         spread(steady%averages(h, :), 1, n), wp)
         end do
      end associate
      steady%left_out = maxval(norm2(remainder, 1)/max(norm2(z - spread(sum(z, 1)/size(z, 1), 1, size(z, 1)), 1), &
                                                       at_rest*norm2(z, 1), tiny(1.0_wp)))
      steady%spread = noise
      call differentiate(self, x)
      if (allocated(self%slopes)) steady%monodromy = self%slopes(:, :size(x))
      if (options%integration%aim > 0.0_wp) then                      ! as for fits to candidates
         steady%spread = steady%left_out
         steady%left_out = 0.0_wp
      end if
   end subroutine impact_orbit_describe

   !> Frees the equations of motion; safe to call twice.
   subroutine impact_orbit_destroy(self)
      class(impact_orbit_t), intent(inout) :: self

      if (associated(self%system)) deallocate (self%system)
   end subroutine impact_orbit_destroy
end module hb_impact_orbit
