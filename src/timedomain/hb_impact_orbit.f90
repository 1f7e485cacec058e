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
   use hb_error, only: error_t, fail
   use hb_floquet, only: stability_of_map
   use hb_harmonics, only: harmonics_t
   use hb_integration_system, only: integration_state_t, integration_system_t, new_integration_system
   use hb_kinds, only: two_pi, wp
   use hb_lapack, only: dgetrf, dgetrs
   use hb_model, only: model_t
   use hb_model_number, only: model_number_t, moving_value_t
   use hb_model_numbers, only: find_model_number
   use hb_motion_series, only: motion_series_t
   use hb_movement, only: movement_t, new_movement, set_movement
   use hb_options, only: options_t
   use hb_problem, only: problem_t
   use hb_refusal, only: refusal_t
   use hb_rigid_constraints, only: collect_rigid
   use hb_sampled_period, only: sampled_period_t
   use hb_stability, only: stability_t
   use hb_state_map, only: at_rest, far_from_events, farthest_phase, new_state_map, state_map_t
   use hb_steady_motion, only: steady_motion_t
   use hb_structure, only: max_dense
   use hb_system, only: system_t
   use hb_thresholds, only: difference_step
   use hb_time_stepping, only: integration_record_t
   implicit none
   private
   public :: impact_orbit_t, motion_slopes_t, new_impact_orbit, orbit_tolerance

   real(wp), parameter :: orbit_tolerance = 1.0e-10_wp                !! residual of a periodic motion, scaled

   real(wp), parameter :: integration_tolerance = 1.0e-9_wp           ! of the integration: all digits
   real(wp), parameter :: map_noise = 1.0e-12_wp                      ! of a period map, scaled
   real(wp), parameter :: derivative_tolerance = 1.0e-8_wp            ! change of a derivative that needs no shorter distance
   real(wp), parameter :: distance_reduction = 0.5_wp                 ! from one distance to the next: derivatives are large
   integer, parameter :: max_levels = 20                             ! distances; near a graze the long ones change the impacts
   integer, parameter :: min_samples = 2048                        ! in a period: their coefficients, corrected for impacts, err by
                                                                      ! 1e-10
   integer, parameter :: samples_of_harmonic = 64
   real(wp), parameter :: too_near = 0.5_wp                           ! to an event, relative to the farthest instant

   !> Derivatives of a periodic motion with respect to numbers of the model, in their units.
   type :: motion_slopes_t
      complex(wp), allocatable :: amplitudes(:, :, :)                 !! cos - i sin [m], (n_dofs, n_harmonics, values)
      real(wp), allocatable :: frequency(:, :)                        !! of base frequencies [rad/s], (n_tones, values)
      real(wp), allocatable :: estimate(:)                            !! of their errors, relative (values)
      real(wp), allocatable :: defect(:)                              !! as that of hb_motion_result%gradient_t, (values)
   end type motion_slopes_t

   !> How a periodic motion changes with the moving value.
   type :: motion_direction_t
      real(wp), allocatable :: along(:)                               ! of state, scaled, and value, (n_unknowns + 1)
      real(wp) :: typical = 1.0_wp                                    ! change of the value
      real(wp) :: of_map = 0.0_wp                                     ! norm of what the value alone changes in the map
   end type motion_direction_t

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
      procedure :: set_section => impact_orbit_set_section
      procedure :: move_section => impact_orbit_move_section
      procedure :: better_section => impact_orbit_better_section
      procedure :: describe => impact_orbit_describe
      procedure :: series_of => impact_orbit_series_of
      procedure :: stability => impact_orbit_stability
      procedure :: find_slopes => impact_orbit_find_slopes
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
      call build_system(self)
      call new_state_map(self%map, self%system, motion, options%integration%restitution, integration_tolerance, error)
      if (allocated(error)) return
      self%section = farthest_phase(self%map)/two_pi
      self%n_unknowns = size(self%map%scale)
      self%x_scale = 0.0_wp*self%map%scale + 1.0_wp
      self%r_scale = self%x_scale
      self%residual_work = self%map%work_of(1)
      self%tangent_work = (6*self%n_unknowns + 1)*self%residual_work
   end subroutine new_impact_orbit

   !> Creates the equations of motion of the model.
   subroutine build_system(self)
      type(impact_orbit_t), intent(inout) :: self

      associate (model => self%model, omega => self%model%system%tones%omega)
         call new_integration_system(self%system, model%system%structure, model%system%laws, model%system%load_spectrum, omega)
      end associate
   end subroutine build_system

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

   !> State after a part of a period from the section on, at a value; with a set, its amplitudes over a period instead.
   subroutine evaluate(self, x, value, part, set, y, is_done)
      class(impact_orbit_t), intent(inout) :: self
      real(wp), intent(in) :: x(:)                                    !! scaled
      real(wp), intent(in) :: value, part
      type(harmonics_t), intent(in), optional :: set
      real(wp), allocatable, intent(out) :: y(:)                      !! scaled; of amplitudes real, then imaginary parts
      logical, intent(out) :: is_done
      complex(wp), allocatable :: c(:, :)
      type(sampled_period_t) :: sampled

      allocate (y(size(x)))
      if (.not. present(set)) then
         call advance_part(self, x, value, part, y, is_done)
         return
      end if
      call self%set_parameters([1], [value], is_done)
      if (is_done) call sample(self, x, sampled, is_done)
      if (.not. is_done) return
      c = transpose(sampled%amplitudes(set, sampled%q))/spread(self%map%scale(:self%system%n_dofs), 2, set%n_harmonics)
      y = [real(c), aimag(c)]
   end subroutine evaluate

   !> Derivative of what `evaluate` returns along a change of state and value, by a central difference, or by a one-sided one at
   !> the end of the range of the value.
   subroutine differ(self, x, change, distance, part, set, slope, is_done)
      class(impact_orbit_t), intent(inout) :: self
      real(wp), intent(in) :: x(:), distance, part
      real(wp), intent(in) :: change(:)                               !! of the state and the value along the direction
      type(harmonics_t), intent(in), optional :: set
      real(wp), allocatable, intent(out) :: slope(:)
      logical, intent(out) :: is_done                                 !! and the walls are struck as often on both sides
      real(wp), parameter :: difference_positions(3, 3) = reshape([-1, 0, 1, 0, 1, 2, -2, -1, 0], [3, 3])
      real(wp), parameter :: difference_weights(3, 3) = 0.5_wp*reshape([-1, 0, 1, -3, 4, -1, 1, -4, 3], [3, 3])
      real(wp) :: value
      integer :: k
      logical :: is_possible(3)

      value = self%value
      call combine(1)
      if (.not. is_done .and. abs(change(size(x) + 1)) > 0.0_wp) then
         do k = 1, 3, 2
            call self%set_parameters([1], [value + distance*difference_positions(k, 1)*change(size(x) + 1)], is_possible(k))
         end do
         if (is_possible(1) .neqv. is_possible(3)) call combine(merge(3, 2, is_possible(1)))
      end if
      call self%set_parameters([1], [value], is_possible(1))

   contains

      !> The difference over three positions.
      subroutine combine(k)
         integer, intent(in) :: k                                     !! number of the positions
         real(wp), allocatable :: y(:)
         integer :: i, impacts(size(self%map%impacts))
         logical :: is_first

         is_first = .true.
         do i = 1, 3
            if (abs(difference_weights(i, k)) <= 0.0_wp) cycle
            associate (along => distance*difference_positions(i, k))
               call evaluate(self, x + along*change(:size(x)), value + along*change(size(x) + 1), part, set, y, is_done)
            end associate
            if (is_done .and. .not. is_first) is_done = all(impacts == self%map%impacts)
            if (.not. is_done) return
            if (is_first) slope = 0.0_wp*y
            is_first = .false.
            impacts = self%map%impacts
            slope = slope + difference_weights(i, k)/distance*y
         end do
      end subroutine combine
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
      real(wp), allocatable :: slopes(:, :)
      real(wp) :: axes(size(x) + 1, size(x) + 1), estimate
      integer :: k

      if (allocated(self%known)) then
         if (all(abs([x, self%value] - self%known) <= 0.0_wp)) return
      end if
      self%known = [x, self%value]
      if (allocated(self%slopes)) deallocate (self%slopes)
      axes = 0.0_wp
      do k = 1, size(x)
         axes(k, k) = 1.0_wp
      end do
      k = size(x) + merge(1, 0, allocated(self%moving))
      axes(k, k) = merge(sum(self%parameter_scales([1])), axes(k, k), allocated(self%moving))
      call find_limit(self, x, axes(:, :k), slopes=slopes, estimate=estimate)
      if (allocated(slopes)) self%slopes = reshape([slopes, 0.0_wp*x], [size(x), size(x) + 1])
   end subroutine differentiate

   !> The limit of differences along changes of state and value.
   subroutine find_limit(self, x, changes, set, slopes, estimate, is_relative)
      class(impact_orbit_t), intent(inout) :: self
      real(wp), intent(in) :: x(:)
      real(wp), intent(in) :: changes(:, :)                           !! those of the value last, (n_unknowns + 1, any)
      type(harmonics_t), intent(in), optional :: set                  !! as that of `evaluate`
      real(wp), allocatable, intent(out) :: slopes(:, :)              !! not allocated: there is none
      real(wp), intent(out) :: estimate                               !! of its error, relative
      logical, intent(in), optional :: is_relative                    !! to the slopes themselves, however small; default no
      type(limit_t) :: limit
      real(wp), allocatable :: all_slopes(:), slope(:)
      real(wp) :: unit
      integer :: k, level, n_added
      logical :: is_done

      limit%ratio = distance_reduction
      n_added = 0
      unit = 1.0_wp
      do level = 1, max_levels
         allocate (all_slopes(0))
         do k = 1, size(changes, 2)
            call differ(self, x, changes(:, k), distance_at(level, distance_reduction), 1.0_wp, set, slope, is_done)
            if (.not. is_done) exit
            all_slopes = [all_slopes, slope]
         end do
         if (is_done) then
            n_added = n_added + 1
            if (present(is_relative) .and. n_added == 1) unit = max(maxval(abs(all_slopes)), tiny(1.0_wp))
            call limit%add(reshape(all_slopes/unit, [size(slope), size(changes, 2)]))
         else
            limit = limit_t(distance_reduction)
            n_added = 0
         end if
         deallocate (all_slopes)
         if (is_done .and. (limit%estimate <= derivative_tolerance .or. limit%n_idle > 1)) exit ! rounding
      end do
      estimate = limit%estimate
      if (allocated(limit%best)) slopes = unit*limit%best
   end subroutine find_limit

   !> Derivatives of a periodic motion with respect to numbers of the model: of the state on the section by those of the map, of the
   !> amplitudes by differences along the state and the number. There are none, not allocated, where the map has no derivative.
   subroutine impact_orbit_find_slopes(self, set, x, by, slopes, error)
      class(impact_orbit_t), intent(inout) :: self                    !! on return unchanged
      type(harmonics_t), intent(in) :: set
      real(wp), intent(in), contiguous :: x(:)
      type(model_number_t), intent(in) :: by(:)
      type(motion_slopes_t), intent(out) :: slopes
      type(error_t), allocatable, intent(out) :: error
      type(moving_value_t), allocatable :: moving
      real(wp) :: factor(size(x), size(x)), value
      integer :: info, k, pivots(size(x))
      logical :: is_found

      call differentiate(self, x)
      if (.not. allocated(self%slopes)) return
      call self%tangent(x, factor)
      call dgetrf(size(x), size(x), factor, size(x), pivots, info)
      if (info /= 0) return
      if (allocated(self%moving)) moving = self%moving
      value = self%value
      associate (n_tones => self%model%system%tones%n_tones)
         allocate (slopes%amplitudes(self%system%n_dofs, set%n_harmonics, size(by)), slopes%frequency(n_tones, size(by)))
         allocate (slopes%estimate(size(by)), slopes%defect(size(by)))
      end associate
      is_found = .true.
      do k = 1, size(by)
         call differentiate_by(by(k))
         if (allocated(error) .or. .not. is_found) exit
      end do
      if (allocated(error) .or. .not. is_found) slopes = motion_slopes_t()
      if (allocated(self%moving)) deallocate (self%moving)
      if (allocated(moving)) call self%move(moving, value)

   contains

      !> By one number.
      subroutine differentiate_by(number)
         type(model_number_t), intent(in) :: number
         type(motion_direction_t) :: direction
         type(movement_t) :: movement

         call find_direction(self, x, factor, pivots, number, direction, error)
         is_found = allocated(direction%along)
         if (.not. is_found) return
         call find_amplitude_slopes(self, set, x, direction, slopes%amplitudes(:, :, k), slopes%estimate(k), is_found)
         if (.not. is_found) return
         slopes%defect(k) = defect_after(self, x, difference_step*direction%along)/ &
                            max(difference_step*direction%of_map, tiny(1.0_wp))
         call new_movement(movement, self%model, number, .false., error)
         if (.not. allocated(error)) slopes%frequency(:, k) = movement%omega_slopes(self%model%system%tones)
      end subroutine differentiate_by
   end subroutine impact_orbit_find_slopes

   !> The change of the state on the section with a number, which becomes the moving value: that which keeps the motion periodic.
   subroutine find_direction(self, x, factor, pivots, number, direction, error)
      class(impact_orbit_t), intent(inout) :: self
      real(wp), intent(in) :: x(:)
      real(wp), intent(in) :: factor(:, :)                            !! of the tangent, with its pivots
      integer, intent(in) :: pivots(:)
      type(model_number_t), intent(in) :: number
      type(motion_direction_t), intent(out) :: direction              !! not allocated: there is none
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: along(size(x) + 1, 1), at, change(size(x)), estimate, typical
      real(wp), allocatable :: of_map(:, :)
      integer :: attempt, info
      logical :: is_found

      call find_model_number(self%model, number, at, is_found)
      if (.not. is_found) return
      typical = abs(at)
      if (.not. typical > 0.0_wp) typical = 1.0_wp
      do attempt = 1, 2
         call self%move(moving_value_t(number, typical), at)
         along = 0.0_wp
         along(size(along), 1) = typical
         call find_limit(self, x, along, slopes=of_map, estimate=estimate, is_relative=.true.)
         if (.not. allocated(of_map)) then
            if (allocated(self%refusal%text)) call fail(error, trim(number%name)//" cannot change by itself: "//self%refusal%text)
            return
         end if
         change = -of_map(:, 1)
         call dgetrs("N", size(x), 1, factor, size(x), pivots, change, size(x), info)
         if (abs(at) > 0.0_wp .or. .not. norm2(change) > 0.0_wp) exit
         typical = typical*norm2(x)/norm2(change)                     ! of a value of zero: the change with a comparable effect
      end do
      direction%along = [change, along(size(along), 1)]
      direction%of_map = norm2(of_map)
      direction%typical = typical
   end subroutine find_direction

   !> Derivatives of the amplitudes of a periodic motion along a direction.
   subroutine find_amplitude_slopes(self, set, x, direction, amplitudes, estimate, is_found)
      class(impact_orbit_t), intent(inout) :: self
      type(harmonics_t), intent(in) :: set
      real(wp), intent(in) :: x(:)
      type(motion_direction_t), intent(in) :: direction
      complex(wp), intent(out) :: amplitudes(:, :)                    !! as a slice of `motion_slopes_t`
      real(wp), intent(out) :: estimate                               !! of their errors, relative
      logical, intent(out) :: is_found
      real(wp), allocatable :: slopes(:, :)

      amplitudes = 0.0_wp
      call find_limit(self, x, reshape(direction%along, [size(direction%along), 1]), set, slopes, estimate, .true.)
      is_found = allocated(slopes)
      if (.not. is_found) return
      associate (n => size(amplitudes))
         amplitudes = reshape(cmplx(slopes(:n, 1), slopes(n + 1:, 1), wp), shape(amplitudes))
      end associate
      amplitudes = amplitudes*spread(self%map%scale(:size(amplitudes, 1)), 2, size(amplitudes, 2))/direction%typical
   end subroutine find_amplitude_slopes

   !> What is missing to a periodic motion after a small step of state and value, to the side that is possible.
   real(wp) function defect_after(self, x, step) result(defect)
      class(impact_orbit_t), intent(inout) :: self
      real(wp), intent(in) :: x(:), step(:)
      real(wp) :: after(size(x), 0:1), at, start(size(x))
      integer :: side
      logical :: is_done

      at = self%value
      defect = ieee_value(1.0_wp, ieee_quiet_nan)
      call advance_part(self, x, at, 1.0_wp, after(:, 0), is_done)
      do side = 1, -1, -2
         start = x + side*step(:size(x))
         call advance_part(self, start, at + side*step(size(step)), 1.0_wp, after(:, 1), is_done)
         if (.not. is_done) cycle
         defect = norm2(after(:, 1) - start - (after(:, 0) - x))
         exit
      end do
      call self%set_parameters([1], [at], is_done)
   end function defect_after

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

      impact_orbit_rounding_level = map_noise*max(1.0_wp, norm2(x))
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
         call build_system(self)
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
      if (allocated(self%known)) deallocate (self%known)
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
      real(wp), allocatable :: slope(:)
      real(wp) :: after(size(x))

      associate (part => modulo(section - self%section, 1.0_wp))
         call differ(self, x, [direction, of_value], distance_at(1, distance_reduction), part, slope=slope, is_done=is_done)
         if (is_done) call advance_part(self, x, self%value, part, after, is_done)
      end associate
      if (.not. is_done) return
      x = after
      direction = slope
      call self%set_section(section)
   end subroutine impact_orbit_move_section

   !> Assigns the section, for states that lie on it.
   subroutine impact_orbit_set_section(self, section)
      class(impact_orbit_t), intent(inout) :: self
      real(wp), intent(in) :: section                                 !! part of a period

      self%section = section
      if (allocated(self%known)) deallocate (self%known)
   end subroutine impact_orbit_set_section

   !> Phase farthest from events of a periodic motion, or the present one if that is far enough.
   real(wp) function impact_orbit_better_section(self, x) result(section)
      class(impact_orbit_t), intent(inout) :: self
      real(wp), intent(in) :: x(:)
      real(wp), allocatable :: far(:), v(:, :)
      type(sampled_period_t) :: sampled
      logical :: is_done

      section = self%section
      call sample(self, x, sampled, is_done)
      if (.not. is_done) return
      v = cshift(sampled%q, 1) - cshift(sampled%q, -1)
      allocate (far, source=far_from_events(self%map, sampled%q, v))
      if (far(1) > too_near*maxval(far)) return
      section = modulo(section + (maxloc(far, dim=1) - 1)/real(size(far), wp), 1.0_wp)
   end function impact_orbit_better_section

   !> Samples a period from the section on.
   subroutine sample(self, x, sampled, is_done)
      class(impact_orbit_t), intent(inout) :: self
      real(wp), intent(in) :: x(:)
      type(sampled_period_t), intent(out) :: sampled
      logical, intent(out) :: is_done
      type(integration_record_t) :: record
      real(wp) :: after(size(x))
      integer :: i, n

      after = x
      n = max(min_samples, samples_of_harmonic*maxval(self%model%discretisation%harmonics%highest))
      associate (period => self%period())
         call self%map%record_from(self%section*period, period, n, [(i, i=1, self%system%n_dofs)], after, record, is_done)
         if (.not. is_done) return
         sampled%begun = self%section
         sampled%q = record%every_displacement(:n, :)
         allocate (sampled%impacts(0), sampled%jumps(self%system%n_dofs, 0))
         if (.not. allocated(record%impact_times)) return
         sampled%impacts = record%impact_times/period - self%section
         sampled%jumps = record%impact_jumps*period
      end associate
   end subroutine sample

   !> Amplitudes, cos - i sin, of a degree of freedom of a motion; none if the integration fails.
   function impact_orbit_series_of(self, set, dof, x) result(c)
      class(impact_orbit_t), intent(inout) :: self
      type(harmonics_t), intent(in) :: set
      integer, intent(in) :: dof
      real(wp), intent(in) :: x(:)
      complex(wp), allocatable :: c(:)                                ! (n_harmonics)
      type(sampled_period_t) :: sampled
      logical :: is_done

      allocate (c(0))
      call sample(self, x, sampled, is_done)
      if (.not. is_done) return
      sampled%jumps = sampled%jumps([dof], :)
      c = reshape(sampled%amplitudes(set, sampled%q(:, [dof])), [set%n_harmonics])
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
      type(sampled_period_t) :: sampled
      real(wp), allocatable :: z(:, :)

      call sample(self, x, sampled, is_done)
      if (.not. is_done) return
      z = coordinates%values_of(sampled%q(:, coordinates%dofs))
      steady%amplitudes = transpose(sampled%amplitudes(discretisation%harmonics, sampled%q))
      sampled%jumps = transpose(coordinates%values_of(transpose(sampled%jumps(coordinates%dofs, :))))
      steady%averages = sampled%amplitudes(discretisation%harmonics, z)
      associate (remainder => sampled%remainder(discretisation%harmonics, z, steady%averages))
         steady%left_out = maxval(norm2(remainder, 1)/max(norm2(z - spread(sum(z, 1)/size(z, 1), 1, size(z, 1)), 1), &
                                                          at_rest*norm2(z, 1), tiny(1.0_wp)))
      end associate
      steady%spread = map_noise
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
      call self%model%system%clear()
   end subroutine impact_orbit_destroy
end module hb_impact_orbit
