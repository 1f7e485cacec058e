!> The harmonic balance of a model: R(u) = S u + F_nl(u) - F_ext at the coordinates on which laws act.
!>
!> Forces are evaluated on the torus and projected back (alternating frequency/time); the tangent is the exact derivative
!> of this discrete residual. Unknowns u(n_coefficients, n_dofs) are cosines and sines, degree of freedom by degree of
!> freedom. Source: docs/why/theory.md, sections 3 to 5.
!> Forces with memory depend on all samples; their columns of the tangent come from the derivative of their
!> integration along time.
!>
!> Glossary: u unknowns, S condensed dynamic stiffness, s reaction = F_ext - S u, q motion and v rate on the samples.
!>
!> The number of unknowns above which a step of Newton's method by products with the tangent is cheaper than by its factors, for
!> each kind of laws. Measured: docs/develop/performance.md, section "Factors or products".
module hb_balance
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_assert, only: assert, asserts_are_on
   use hb_block_factors, only: block_factors_t
   use hb_cached_parts, only: cached_parts_t
   use hb_cancellation, only: spend_work
   use hb_dense_tangent, only: dense_tangent_t
   use hb_dynamic_stiffness, only: dynamic_stiffness_t
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_law, only: law_box_t
   use hb_linear_part, only: linear_part_t, new_linear_part
   use hb_numbers, only: number_t
   use hb_preconditioner, only: preconditioner_t, unit_work
   use hb_problem, only: default_largest_dense, deformation, problem_t
   use hb_projected_laws, only: new_projected_laws, projected_laws_t
   use hb_solver_types, only: report_t, solver_config_t
   use hb_tangent_product, only: tangent_product_t
   use hb_torus, only: torus_t
   implicit none
   private
   public :: balance_t, indifferent_coordinates, largest_dense_tangent, new_balance

   integer, parameter :: with_smooth_laws = 40                        ! few products per step, few steps
   integer, parameter :: with_kinks = 120                             ! inexact steps need one or two more
   integer, parameter :: with_memory = 250                            ! each product integrates along time

   integer, parameter :: min_to_continue_in_order = 100 ! unknowns from which fewer harmonics first is the primary method

   !> Owner of external resources: call `destroy`.
   type, extends(problem_t) :: balance_t
      type(harmonics_t) :: harmonics
      class(linear_part_t), allocatable :: stiffness
      type(cached_parts_t), pointer :: cached_wide => null()    !! parts of that of its error estimate, if they are cached
      real(wp), allocatable :: omega(:)                               !! base frequencies [rad/s], (n_tones)
      real(wp), allocatable :: frequencies(:)                         !! j.omega [rad/s], (n_harmonics)
      real(wp), allocatable :: xi(:)                                  !! artificial damping, negative, per tone [1/s], (n_tones)
      integer :: n_dofs = 0                                           !! coordinates on which laws act
      type(projected_laws_t), allocatable :: law_set                  !! of a balance that was created
      class(dense_tangent_t), allocatable :: dense_tangent            !! replaceable parts; created by default
      class(tangent_product_t), allocatable :: tangent_product
      class(preconditioner_t), allocatable :: preconditioner
      real(wp), private :: load_factor = 1.0_wp                       ! of a problem along a homotopy
      real(wp), allocatable, private :: reaction(:, :), force(:, :)   ! (n_coefficients, n_dofs)
      real(wp), allocatable, private :: sampled(:, :)                 ! (n_coefficients, n_dofs) motion of the samples in law_set
      logical, private :: has_samples = .false.                       ! of it, at the present frequencies and loads
      logical, private :: has_slopes = .false.                        ! and forces and slopes of the laws at these samples
      type(block_factors_t), private :: mean_factors                  ! of the tangent of each harmonic by itself
      logical, private :: has_moved = .false.                         ! to frequencies other than the initial ones
      integer, private :: n_rounds = 1                                ! of sliders, counted by `tangent_work`
      real(wp), private :: work_of_factors = 0.0_wp                   ! of a dense tangent
      real(wp), private :: work_of_round = 0.0_wp                     ! of all columns of a tangent
      real(wp), private :: work_of_pass = 0.0_wp                      ! of a residual or a product, as measured, without kinks
      real(wp), private :: work_of_kinks = 0.0_wp                     ! of a residual or its derivative, as measured
   contains
      procedure :: residual => balance_residual
      procedure :: tangent => balance_tangent
      procedure :: linearise => balance_linearise
      procedure :: apply_tangent => balance_apply_tangent
      procedure :: update_preconditioner => balance_update_preconditioner
      procedure :: precondition => balance_precondition
      procedure :: solve_linear => balance_solve_linear
      procedure :: compliance_of_law => balance_compliance_of_law
      procedure :: rounding_level => balance_rounding_level
      procedure :: is_unsuitable => balance_is_unsuitable
      procedure :: has_left_domain => balance_has_left_domain
      procedure :: set_scales => balance_set_scales
      procedure :: factorise_mean_tangent => balance_factorise_mean_tangent
      procedure :: solve_mean_tangent => balance_solve_mean_tangent
      procedure :: mean_slopes => balance_mean_slopes
      procedure :: move => balance_move
      procedure :: drives => balance_drives
      procedure :: frequency_derivative => balance_frequency_derivative
      procedure :: damping_derivative => balance_damping_derivative
      procedure :: reaction_derivative => balance_reaction_derivative
      procedure :: transpose_reaction => balance_transpose_reaction
      procedure :: deform => balance_deform
      procedure :: parameters => balance_parameters
      procedure :: parameter_scales => balance_parameter_scales
      procedure :: set_parameters => balance_set_parameters
      procedure :: parameter_derivative => balance_parameter_derivative
      procedure :: update_regular_preconditioner => balance_update_regular_preconditioner
      procedure :: replace_laws => balance_replace_laws
      procedure :: number_derivative => balance_number_derivative
      procedure :: lowest_level => balance_lowest_level
      procedure :: coarse_guess => balance_coarse_guess
      procedure :: linear_solution => balance_linear_solution
      procedure :: stuck_solution => balance_stuck_solution
      procedure :: drifting => balance_drifting
      procedure :: sample => balance_sample
      procedure, private :: sample_if_new => balance_sample_if_new
      procedure :: differentiate => balance_differentiate
      procedure :: project => balance_project
      procedure :: project_one => balance_project_one
      procedure :: all_dofs => balance_all_dofs
      procedure :: at_law_dofs => balance_at_law_dofs
      procedure :: fault_of_laws => balance_fault_of_laws
      procedure :: destroy => balance_destroy
   end type balance_t

   interface new_balance
      procedure :: balance_of_stiffness, balance_of_linear_part
   end interface new_balance

   ! Linear part; bodies in hb_balance_linear
   interface
      module subroutine prepare_multiplier(self, i)
         type(balance_t), intent(inout) :: self
         integer, intent(in) :: i
      end subroutine prepare_multiplier

      module subroutine choose_scales(self)
         type(balance_t), intent(inout) :: self
      end subroutine choose_scales

      module subroutine balance_stuck_solution(self, u, is_better)
         class(balance_t), intent(inout) :: self
         real(wp), intent(inout) :: u(self%harmonics%n_coefficients, self%n_dofs) !! [m]
         logical, intent(out) :: is_better
      end subroutine balance_stuck_solution

      !> Compliance of the structure where a law acts.
      module function balance_compliance_of_law(self, i) result(compliance)
         class(balance_t), intent(inout) :: self
         integer, intent(in) :: i                                        !! law
         real(wp) :: compliance                                          !! of the structure at its first coordinate [m/N]
      end function balance_compliance_of_law

      module function balance_rounding_level(self, x) result(level)
         class(balance_t), intent(inout) :: self
         real(wp), intent(in), contiguous :: x(:)
         real(wp) :: level
      end function balance_rounding_level
   end interface

   ! Preconditioner; bodies in hb_balance_precondition
   interface
      module subroutine balance_update_preconditioner(self, level, is_strongest)
         class(balance_t), intent(inout) :: self
         integer, intent(in) :: level
         logical, intent(out) :: is_strongest
      end subroutine balance_update_preconditioner

      module subroutine balance_precondition(self, r, step)
         class(balance_t), intent(inout) :: self
         real(wp), intent(in), contiguous :: r(:)
         real(wp), intent(out), contiguous :: step(:)
      end subroutine balance_precondition

      module subroutine balance_factorise_mean_tangent(self, u, error, without)
         class(balance_t), intent(inout) :: self
         real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)    !! [m]
         type(error_t), allocatable, intent(out) :: error
         type(harmonics_t), intent(in), optional :: without              !! tuples that need no factors
      end subroutine balance_factorise_mean_tangent

      module subroutine balance_solve_mean_tangent(self, r, step)
         class(balance_t), intent(in) :: self
         real(wp), intent(in) :: r(self%harmonics%n_coefficients, self%n_dofs)    !! [N]
         real(wp), intent(out) :: step(self%harmonics%n_coefficients, self%n_dofs)
      end subroutine balance_solve_mean_tangent

      module subroutine balance_mean_slopes(self, u, df_dq, df_dv, error)
         class(balance_t), intent(inout) :: self
         real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)    !! [m]
         real(wp), intent(out) :: df_dq(:, :)                            !! [N/m], (n_dofs, n_dofs)
         real(wp), intent(out) :: df_dv(:, :)                            !! [N s/m], as df_dq
         type(error_t), allocatable, intent(out) :: error
      end subroutine balance_mean_slopes

   end interface

   ! Sequence of orders; bodies in hb_balance_coarse
   interface
      pure module function balance_lowest_level(self) result(share)
         class(balance_t), intent(in) :: self
         real(wp) :: share
      end function balance_lowest_level

      module subroutine balance_coarse_guess(self, share, config, x, report, is_found)
         class(balance_t), intent(inout) :: self
         real(wp), intent(in) :: share                                   !! of the orders
         type(solver_config_t), intent(in) :: config
         real(wp), intent(inout), contiguous :: x(:)
         type(report_t), intent(out) :: report
         logical, intent(out) :: is_found
      end subroutine balance_coarse_guess
   end interface

   ! Base frequencies and artificial damping; bodies in hb_balance_frequency. As parameters of a problem they are numbered
   ! 1 to n_tones and n_tones + 1 to 2 n_tones.
   interface
      pure module function balance_parameters(self, which) result(values)
         class(balance_t), intent(in) :: self
         integer, intent(in) :: which(:)
         real(wp) :: values(size(which))
      end function balance_parameters

      pure module function balance_parameter_scales(self, which) result(scales)
         class(balance_t), intent(in) :: self
         integer, intent(in) :: which(:)
         real(wp) :: scales(size(which))
      end function balance_parameter_scales

      module subroutine balance_set_parameters(self, which, values, is_possible)
         class(balance_t), intent(inout) :: self
         integer, intent(in) :: which(:)
         real(wp), intent(in) :: values(:)
         logical, intent(out) :: is_possible
      end subroutine balance_set_parameters

      module subroutine balance_parameter_derivative(self, x, which, derivative)
         class(balance_t), intent(inout) :: self
         real(wp), intent(in), contiguous :: x(:)
         integer, intent(in) :: which
         real(wp), intent(out), contiguous :: derivative(:)
      end subroutine balance_parameter_derivative

      module subroutine balance_update_regular_preconditioner(self, which, level, is_strongest)
         class(balance_t), intent(inout) :: self
         integer, intent(in) :: which(:)
         integer, intent(in) :: level
         logical, intent(out) :: is_strongest
      end subroutine balance_update_regular_preconditioner

      module subroutine balance_move(self, omega, xi, error)
         class(balance_t), intent(inout) :: self
         real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s], (n_tones), > 0
         real(wp), intent(in) :: xi(:)                                   !! [1/s], (n_tones)
         type(error_t), allocatable, intent(out) :: error
      end subroutine balance_move

      pure module function balance_drives(self) result(drives)
         class(balance_t), intent(in) :: self
         real(wp) :: drives(self%harmonics%n_harmonics)
      end function balance_drives

      module subroutine balance_frequency_derivative(self, u, m, derivative, error)
         class(balance_t), intent(inout) :: self
         real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)    !! [m]
         integer, intent(in) :: m                                        !! tone
         real(wp), intent(out) :: derivative(self%harmonics%n_coefficients, self%n_dofs)   !! [N s]
         type(error_t), allocatable, intent(out) :: error
      end subroutine balance_frequency_derivative

      module subroutine balance_damping_derivative(self, u, m, derivative, error)
         class(balance_t), intent(inout) :: self
         real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)    !! [m]
         integer, intent(in) :: m                                        !! tone
         real(wp), intent(out) :: derivative(self%harmonics%n_coefficients, self%n_dofs)   !! [N s]
         type(error_t), allocatable, intent(out) :: error
      end subroutine balance_damping_derivative

      !> Derivative of the residual by a number on which the linear part alone depends, from that of the reaction.
      module subroutine balance_reaction_derivative(self, u, slope, derivative, error)
         class(balance_t), intent(inout) :: self
         real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)    !! [m]
         real(wp), intent(in) :: slope(self%harmonics%n_coefficients, self%n_dofs)   !! of s = F_ext - S u at constant u
         real(wp), intent(out) :: derivative(self%harmonics%n_coefficients, self%n_dofs)
         type(error_t), allocatable, intent(out) :: error
      end subroutine balance_reaction_derivative
   end interface

   ! Transposed tangent; bodies in hb_balance_transposed
   interface
      !> Multiplies by the transposed derivative of the residual by the reaction, with the sign changed: l - (df/ds)^T l.
      module subroutine balance_transpose_reaction(self, u, l, product)
         class(balance_t), intent(inout) :: self
         real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)    !! [m]
         real(wp), intent(in) :: l(self%harmonics%n_coefficients, self%n_dofs)
         real(wp), allocatable, intent(out) :: product(:)             !! (n_unknowns)
      end subroutine balance_transpose_reaction
   end interface

contains

   !> Creates the balance of laws at the coordinates to which the dynamic stiffness of the structure is condensed; the
   !> stiffness is moved into the balance.
   subroutine balance_of_stiffness(self, harmonics, torus, omega, stiffness, laws, error)
      type(balance_t), intent(inout) :: self
      type(harmonics_t), intent(in) :: harmonics
      type(torus_t), intent(in) :: torus
      real(wp), intent(in) :: omega(:)
      type(dynamic_stiffness_t), intent(inout) :: stiffness           !! at the frequencies j.omega of all harmonics
      type(law_box_t), intent(in) :: laws(:)
      type(error_t), allocatable, intent(out) :: error
      class(linear_part_t), allocatable :: linear

      allocate (linear)
      call new_linear_part(linear, stiffness)
      call balance_of_linear_part(self, harmonics, torus, omega, linear, laws, error)
   end subroutine balance_of_stiffness

   !> Creates the balance of laws with a linear part, which is moved into the balance; its components `stiffness` and `law_set`, if
   !> present, may be taken from another one.
   subroutine balance_of_linear_part(self, harmonics, torus, omega, linear, laws, error)
      type(balance_t), intent(inout) :: self
      type(harmonics_t), intent(in) :: harmonics
      type(torus_t), intent(in) :: torus
      real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s], (n_tones)
      class(linear_part_t), allocatable, intent(inout) :: linear       !! at the frequencies j.omega of all harmonics
      type(law_box_t), intent(in) :: laws(:)                          !! at least one; on indices of coordinates
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      self%harmonics = harmonics
      self%omega = omega
      self%frequencies = harmonics%frequencies(omega)
      self%xi = 0.0_wp*omega
      call move_alloc(linear, self%stiffness)
      self%n_dofs = self%stiffness%n_law
      self%n_unknowns = harmonics%n_coefficients*self%n_dofs
      self%has_products = .true.
      self%can_be_damped = .not. allocated(self%stiffness%contacts) .and. &
                           .not. any([(laws(i)%law%is_multiplier, i=1, size(laws))])   ! with them it led to other motions
      self%continues_in_order_first = self%n_unknowns >= min_to_continue_in_order .and. &
         any([(laws(i)%law%degree == 0 .and. .not. laws(i)%law%is_multiplier, i=1, size(laws))])
      self%largest_dense = largest_dense_tangent(laws)
      if (allocated(self%stiffness%contacts)) self%largest_dense = 0   ! there are products alone
      self%load_factor = 1.0_wp
      self%has_samples = .false.
      self%has_moved = .false.
      if (.not. allocated(self%dense_tangent)) allocate (dense_tangent_t :: self%dense_tangent)
      if (.not. allocated(self%tangent_product)) allocate (tangent_product_t :: self%tangent_product)
      if (.not. allocated(self%preconditioner)) allocate (preconditioner_t :: self%preconditioner)
      call self%dense_tangent%destroy()
      call self%tangent_product%destroy()
      if (.not. allocated(self%law_set)) allocate (self%law_set)
      call new_projected_laws(self%law_set, laws, self%n_dofs, harmonics, torus, omega, error)
      if (allocated(error)) return
      call self%stiffness%hold_free(self%frequencies, indifferent_coordinates(laws, self%n_dofs))
      call self%preconditioner%prepare(self%stiffness, self%law_set)
      do i = 1, size(laws)
         if (laws(i)%law%is_multiplier) call prepare_multiplier(self, i)
      end do
      if (allocated(self%reaction)) deallocate (self%reaction, self%force)
      allocate (self%reaction(harmonics%n_coefficients, self%n_dofs), self%force(harmonics%n_coefficients, self%n_dofs))
      call choose_scales(self)
      call count_work(self, torus)
   end subroutine balance_of_linear_part

   !> Whether the forces of all laws at a coordinate are independent of its displacement.
   pure function indifferent_coordinates(laws, n) result(is_indifferent)
      type(law_box_t), intent(in) :: laws(:)                          !! on indices of coordinates
      integer, intent(in) :: n
      logical :: is_indifferent(n)
      integer :: i

      is_indifferent = .true.
      do i = 1, size(laws)
         associate (law => laws(i)%law)
            if (.not. law%needs_displacement) cycle
            is_indifferent(law%dofs) = .false.
            if (allocated(law%positions)) is_indifferent([law%positions]) = .false.
         end associate
      end do
   end function indifferent_coordinates

   !> Coordinate that drifts, because its mean value changes no force and the mean force there is not zero; 0: none.
   pure integer function balance_drifting(self, u, tolerance) result(coordinate)
      class(balance_t), intent(in) :: self
      real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)    !! solution [m]
      real(wp), intent(in) :: tolerance                               !! of a residual
      real(wp), parameter :: in_equilibrium = 1.0e-8_wp               ! mean force relative to the forces there
      integer :: h, i

      coordinate = 0
      if (.not. any(self%stiffness%is_free)) return
      do h = 1, self%harmonics%n_harmonics
         if (abs(self%frequencies(h)) > 0.0_wp) cycle
         do i = 1, self%n_dofs
            if (.not. self%stiffness%is_free(i)) cycle
            associate (mean => self%stiffness%support_in(i, h)*u(self%harmonics%cos_at(h), i), &
                       scale => self%r_scale((i - 1)*self%harmonics%n_coefficients + 1))
               if (abs(mean) > max(in_equilibrium, 100*tolerance)*scale) coordinate = i
            end associate
         end do
      end do
   end function balance_drifting

   !> Replaces the laws by others that differ from them in numbers alone: the balance is the one that `new_balance` creates
   !> with them at the present frequencies. Products need a new `linearise`.
   subroutine balance_replace_laws(self, laws)
      class(balance_t), intent(inout) :: self
      type(law_box_t), intent(in) :: laws(:)                          !! as `new_balance` has them
      integer :: i

      self%load_factor = 1.0_wp
      self%has_samples = .false.
      self%has_moved = any(abs(self%xi) > 0.0_wp)
      self%law_set%factor = 1.0_wp
      call self%law_set%replace(laws, self%law_set%transform%torus, self%omega)
      do i = 1, size(laws)
         if (laws(i)%law%is_multiplier) call prepare_multiplier(self, i)
      end do
      call choose_scales(self)
      call count_work(self, self%law_set%transform%torus)
   end subroutine balance_replace_laws

   !> Work of a residual and a tangent (see `unit_of_work`): transforms and laws by samples, laws with memory by steps
   !> for each unknown, factors by multiplications. What is spent is counted more closely: transforms one by one, the
   !> corrections of kinks, and laws with memory as they go round the torus.
   subroutine count_work(self, torus)
      class(balance_t), intent(inout) :: self
      type(torus_t), intent(in) :: torus
      real(wp), parameter :: per_sample = 5.0_wp, per_step = 20.0_wp, per_step_of_column = 3.0_wp, per_multiplication = 0.025_wp
      real(wp), parameter :: per_value = 7.5_wp, per_kink = 50.0_wp  ! .6 to 2 times the time, 1 to 3 tones
      real(wp) :: n
      integer :: i, n_transforms

      n = self%n_unknowns
      self%residual_work = per_sample*torus%n_total*self%n_dofs
      if (self%law_set%has_memory) self%residual_work = self%residual_work + per_step*torus%n_total*self%n_dofs
      self%work_of_factors = per_multiplication*n**3
      self%preconditioner_work = 1.5_wp*per_multiplication*unit_work  ! multiplications of factors: 2/3 n**3
      self%n_rounds = 1
      self%work_of_round = n*per_step_of_column*torus%n_total*sum([(self%law_set%laws(i)%law%n_states, i=1, &
                                                                    size(self%law_set%laws))])
      self%tangent_work = self%work_of_factors + self%work_of_round
      associate (set => self%law_set)
         n_transforms = 2 + count([set%needs_velocity, set%needs_reaction]) + merge(3, 0, set%has_memory)
         self%work_of_kinks = per_kink*size(torus%n_samples)*torus%n_total*size(set%kinks%lines)
      end associate
      self%work_of_pass = per_value*n_transforms*torus%n_total*self%n_dofs
      if (.not. allocated(self%stiffness%contacts)) return
      self%work_of_pass = self%work_of_pass + self%stiffness%contacts%work()
      self%residual_work = self%residual_work + self%stiffness%contacts%work()
      self%tangent_work = self%work_of_factors + n*self%work_of_pass
   end subroutine count_work

   subroutine balance_residual(self, x, r)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(out), contiguous :: r(:)

      if (asserts_are_on) call assert(size(x) == self%n_unknowns .and. size(r) == size(x), &
                                      "balance_residual", "as many unknowns as the balance")
      call spend_work(self%work_of_pass + self%work_of_kinks)
      call balance_residual_of(self, x, r)
   end subroutine balance_residual

   !> R = F_nl - s, with s = F_ext - S u; the factors are 1 except along a homotopy in the laws, where supports that
   !> vanish as the laws grow restrain a structure that can move freely.
   subroutine balance_residual_of(self, u, r)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)
      real(wp), intent(out) :: r(self%harmonics%n_coefficients, self%n_dofs)

      call balance_sample(self, u)
      call self%law_set%evaluate()
      call self%law_set%transform%to_coefficients(self%law_set%samples%f%values, self%force)
      if (.not. all(ieee_is_finite(self%force(1, :)))) call self%law_set%find_failure()
      if (allocated(self%stiffness%contacts)) then
         call self%stiffness%find_contact_residual(self%harmonics, u, self%law_set%factor*self%force, self%load_factor, .true., r)
         return
      end if
      r = self%law_set%factor*self%force - self%reaction
      if (self%stiffness%has_supports) call self%stiffness%add_supports(self%harmonics, u, r)
   end subroutine balance_residual_of

   !> Updates samples, forces and slopes of the laws to a motion, unless they are up to date.
   subroutine balance_differentiate(self, u, error)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)    !! [m]
      type(error_t), allocatable, intent(out) :: error

      call self%sample_if_new(u)
      if (self%has_slopes) return
      call self%law_set%differentiate(error)
      self%has_slopes = .not. allocated(error)
   end subroutine balance_differentiate

   !> Transforms the motion to the torus: q, and v and s if a law needs them.
   subroutine balance_sample(self, u)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)    !! [m]

      if (.not. allocated(self%stiffness%contacts)) &
         call self%stiffness%find_reaction(self%harmonics, u, self%load_factor, self%reaction)
      call self%law_set%bring_to(self%law_set%samples, u, self%reaction, self%frequencies)
      self%sampled = u
      self%has_samples = .true.
      self%has_slopes = .false.
   end subroutine balance_sample

   !> Samples a motion unless its samples exist: a tangent is usually evaluated at the point of the last residual.
   subroutine balance_sample_if_new(self, u)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)    !! [m]

      if (self%has_samples) then
         if (all(abs(u - self%sampled) <= 0.0_wp)) return
      end if
      call balance_sample(self, u)
   end subroutine balance_sample_if_new

   subroutine balance_linearise(self, x, is_ready)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      logical, intent(out) :: is_ready
      type(error_t), allocatable :: error

      if (asserts_are_on) call assert(size(x) == self%n_unknowns, "balance_linearise", "as many unknowns as the balance")
      call spend_work(self%work_of_kinks)
      call self%differentiate(x, error)
      if (.not. allocated(error)) call self%tangent_product%prepare(self%law_set, error)
      is_ready = .not. allocated(error)
      if (allocated(error)) call move_alloc(error, self%failure)
   end subroutine balance_linearise

   subroutine balance_apply_tangent(self, x, product)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(out), contiguous :: product(:)

      call spend_work(self%work_of_pass)
      call apply_tangent_to(self, x, product)
   end subroutine balance_apply_tangent

   !> J u = S u + the derivative of the forces along u. Source: docs/why/theory.md, section 6.6.
   subroutine apply_tangent_to(self, u, product)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)
      real(wp), intent(out) :: product(self%harmonics%n_coefficients, self%n_dofs)
      type(error_t), allocatable :: error

      if (.not. allocated(self%stiffness%contacts)) &
         call self%stiffness%find_reaction(self%harmonics, u, 0.0_wp, self%reaction)
      call self%tangent_product%apply(self%law_set, u, self%reaction, self%frequencies, self%force, error)
      if (allocated(error)) call move_alloc(error, self%failure)
      if (allocated(self%stiffness%contacts)) then
         call self%stiffness%find_contact_residual(self%harmonics, u, self%law_set%factor*self%force, 0.0_wp, .false., product)
         return
      end if
      product = self%law_set%factor*self%force - self%reaction
      if (self%stiffness%has_supports) call self%stiffness%add_supports(self%harmonics, u, product)
   end subroutine apply_tangent_to

   subroutine balance_tangent(self, x, jacobian)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(out), contiguous :: jacobian(:, :)

      call balance_tangent_of(self, x, jacobian)
      call spend_work(self%work_of_factors)
   end subroutine balance_tangent

   subroutine balance_tangent_of(self, u, jacobian)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)
      real(wp), intent(out) :: jacobian(self%harmonics%n_coefficients, self%n_dofs, &
                                        self%harmonics%n_coefficients, self%n_dofs)
      type(error_t), allocatable :: error
      integer :: n_rounds

      if (allocated(self%stiffness%contacts)) then
         call find_tangent_by_products(self, u, jacobian)
         return
      end if
      call self%differentiate(u, error)
      if (.not. allocated(error)) &
         call self%dense_tangent%assemble(self%stiffness, self%law_set, self%frequencies, jacobian, error)
      if (.not. allocated(error)) then
         n_rounds = max(1, self%law_set%memory_rounds())
         self%tangent_work = self%tangent_work + (n_rounds - self%n_rounds)*self%work_of_round
         self%n_rounds = n_rounds
         return
      end if
      jacobian = 0.0_wp                                               ! singular: no solver continues
      call move_alloc(error, self%failure)
   end subroutine balance_tangent_of

   !> The tangent of many contacts of a whole model, column by column: as expensive as `count_work` says.
   subroutine find_tangent_by_products(self, u, jacobian)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(:, :)
      real(wp), intent(out) :: jacobian(:, :, :, :)
      real(wp) :: unit(size(u, 1), size(u, 2))
      integer :: i, k
      logical :: is_ready

      jacobian = 0.0_wp                                               ! singular: no solver continues
      call balance_linearise(self, [u], is_ready)
      if (.not. is_ready) return
      unit = 0.0_wp
      do k = 1, size(u, 2)
         do i = 1, size(u, 1)
            unit(i, k) = 1.0_wp
            call apply_tangent_to(self, unit, jacobian(:, :, i, k))
            unit(i, k) = 0.0_wp
         end do
      end do
   end subroutine find_tangent_by_products

   !> Derivative of the residual by a number of laws at fixed coefficients, see `differentiate_by_number` of
   !> hb_sampled_laws; `is_known` is false where differences of the residual must take its place.
   subroutine balance_number_derivative(self, u, is_moved, number, steps, derivative, is_known)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)    !! [m]
      logical, intent(in) :: is_moved(:)                              !! the laws that have the number, (laws)
      type(number_t), intent(in) :: number
      real(wp), intent(in) :: steps(2)                                !! of differences, downwards and upwards; 0 at an end of
                                                                      !! the range
      real(wp), intent(out) :: derivative(self%harmonics%n_coefficients, self%n_dofs)
      logical, intent(out) :: is_known
      type(error_t), allocatable :: error

      derivative = 0.0_wp
      is_known = .false.
      call self%differentiate(u, error)
      if (.not. allocated(error)) call self%law_set%make_direction_samples(error)
      if (allocated(error)) return
      call self%law_set%differentiate_by_number(is_moved, number, steps, is_known)
      if (.not. is_known) return
      call self%law_set%transform%to_coefficients(self%law_set%along%f%values, derivative)
      derivative = self%law_set%factor*derivative
      if (allocated(self%stiffness%contacts)) &
         call self%stiffness%find_contact_slope(self%harmonics, u, self%force, 0.0_wp*self%frequencies, (derivative), derivative)
   end subroutine balance_number_derivative

   !> The motion without laws; for a structure that can move freely that on its weak supports.
   subroutine balance_linear_solution(self, u)
      class(balance_t), intent(inout) :: self
      real(wp), intent(out) :: u(self%harmonics%n_coefficients, self%n_dofs)   !! [m]

      call self%stiffness%find_motion(self%harmonics, u)
   end subroutine balance_linear_solution

   subroutine balance_solve_linear(self, r, step)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: r(:)
      real(wp), intent(out), contiguous :: step(:)

      call self%stiffness%solve(self%harmonics, r, step)
   end subroutine balance_solve_linear

   !> Sets the scales of unknowns and equations, the same for all coefficients of a degree of freedom.
   pure subroutine balance_set_scales(self, motion, force)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: motion(:)                               !! [m], (n_dofs), > 0
      real(wp), intent(in) :: force(:)                                !! [N], (n_dofs), > 0
      integer :: i

      associate (n => self%harmonics%n_coefficients)
         self%x_scale = [(spread(motion(i), 1, n), i=1, self%n_dofs)]
         self%r_scale = [(spread(force(i), 1, n), i=1, self%n_dofs)]
      end associate
   end subroutine balance_set_scales

   !> Multiplies all forces of the laws, or all loads, by a factor, or adds artificial damping.
   subroutine balance_deform(self, kind, amount)
      class(balance_t), intent(inout) :: self
      integer, intent(in) :: kind
      real(wp), intent(in) :: amount

      self%has_samples = .false.
      if (kind == deformation%nonlinearity) then
         self%law_set%factor = amount
         self%stiffness%support_share = 1.0_wp - amount
      end if
      if (kind == deformation%load) self%load_factor = amount
      if (kind == deformation%damping) call self%stiffness%damp(self%frequencies, 1.0_wp - amount)
   end subroutine balance_deform

   !> Coefficients of one sampled function, such as a column of `law_set%force_of`.
   subroutine balance_project_one(self, samples, coefficients)
      class(balance_t), intent(inout) :: self
      real(wp), intent(inout), contiguous :: samples(:, :)            !! (n_samples, 1), aligned as those of law_set
      real(wp), intent(out) :: coefficients(:)                        !! (n_coefficients)

      call self%law_set%transform%to_coefficients_of_one(samples, coefficients)
   end subroutine balance_project_one

   !> Coefficients of sampled functions at the degrees of freedom of the laws, such as the forces `law_set%f`.
   subroutine balance_project(self, samples, coefficients)
      class(balance_t), intent(inout) :: self
      real(wp), intent(inout), contiguous :: samples(:, :)            !! (n_samples, n_dofs), aligned as those of law_set
      real(wp), intent(out) :: coefficients(:, :)                     !! (n_coefficients, n_dofs)

      call self%law_set%transform%to_coefficients(samples, coefficients)
   end subroutine balance_project

   !> Motion of all degrees of freedom of the structure from that at the laws.
   subroutine balance_all_dofs(self, u, c)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)    !! [m]
      complex(wp), intent(out) :: c(:, :)                             !! a - i b [m], (all dofs, n_harmonics)

      if (allocated(self%stiffness%contacts)) then                    ! from forces: their compliance has no inverse here
         call self%sample_if_new(u)
         call self%law_set%evaluate()
         call self%law_set%transform%to_coefficients(self%law_set%samples%f%values, self%force)
         call self%stiffness%contacts%recover(self%stiffness%force_beyond_contacts(self%harmonics, u, self%force), c)
         return
      end if
      call self%stiffness%recover(self%harmonics%amplitudes(u), c)
   end subroutine balance_all_dofs

   !> Motion of the degrees of freedom that the coordinates involve, in their order.
   function balance_at_law_dofs(self, u) result(motion)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)    !! [m]
      real(wp) :: motion(self%harmonics%n_coefficients, size(self%stiffness%coordinates%dofs))
      complex(wp), allocatable :: c(:, :)

      associate (coordinates => self%stiffness%coordinates)
         if (coordinates%are_dofs) then
            motion = u
            return
         end if
         allocate (c(self%stiffness%n_dofs, self%harmonics%n_harmonics))
         call self%all_dofs(u, c)
         motion = self%harmonics%coefficients(c(coordinates%dofs, :))
      end associate
   end function balance_at_law_dofs

   !> Whether a law of the user has forces that no method can follow, examined along a motion; it is then given up.
   logical function balance_is_unsuitable(self, x) result(is_unsuitable)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)

      call self%sample_if_new(x)
      call self%law_set%find_unsuitable(self%law_set%transform%torus)
      is_unsuitable = self%law_set%is_given_up
   end function balance_is_unsuitable

   !> Whether laws were undefined at motions that were tried, as beyond pull-in.
   pure logical function balance_has_left_domain(self) result(has_left_domain)
      class(balance_t), intent(in) :: self

      has_left_domain = allocated(self%law_set%error_text)
   end function balance_has_left_domain

   !> Why a law cannot continue; empty if all laws can, and before the balance is created.
   pure function balance_fault_of_laws(self) result(text)
      class(balance_t), intent(in) :: self
      character(400) :: text

      text = ""
      if (.not. allocated(self%law_set)) return
      if (self%law_set%is_given_up) text = self%law_set%error_text
   end function balance_fault_of_laws

   !> Frees transforms and samples; safe to call twice.
   subroutine balance_destroy(self)
      class(balance_t), intent(inout) :: self

      if (allocated(self%law_set)) call self%law_set%destroy()
      if (allocated(self%dense_tangent)) call self%dense_tangent%destroy()
      if (allocated(self%tangent_product)) call self%tangent_product%destroy()
   end subroutine balance_destroy

   !> Unknowns up to which the dense tangent is cheaper for the laws of a model: the largest number of any law. Walls
   !> and rigid friction, whose steps must be exact, have the largest number.
   pure integer function largest_dense_tangent(laws)
      type(law_box_t), intent(in) :: laws(:)
      integer :: i

      largest_dense_tangent = with_smooth_laws
      do i = 1, size(laws)
         associate (law => laws(i)%law)
            if (law%degree == 0) largest_dense_tangent = max(largest_dense_tangent, with_kinks)
            if (law%is_multiplier) largest_dense_tangent = max(largest_dense_tangent, default_largest_dense)
            if (law%n_states > 0) largest_dense_tangent = max(largest_dense_tangent, with_memory)
         end associate
      end do
   end function largest_dense_tangent
end module hb_balance
