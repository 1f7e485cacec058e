!> The harmonic balance of a scene: R(u) = S u + F_nl(u) - F_ext at the degrees of freedom on which laws act.
!>
!> Forces are evaluated on the torus and projected back (alternating frequency/time); the tangent is the exact derivative
!> of this discrete residual. Unknowns u(n_coefficients, n_dofs) are cosines and sines, degree of freedom by degree of
!> freedom. Source: docs/theory.md, sections 3 to 5.
!>
!> Forces with memory depend on all samples; their columns of the tangent come from the walk that found them.
!>
!> Glossary: u unknowns, S condensed dynamic stiffness, s reaction = F_ext - S u, q motion and v rate on the samples.
module hb_balance
   use hb_dynamic_stiffness, only: dynamic_stiffness_t
   use hb_error, only: error_t, fail
   use hb_fftw, only: new_real_block, real_block_t
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_lapack, only: zgetrf, zgetrs
   use hb_law, only: law_box_t
   use hb_law_set, only: law_set_t, new_law_set
   use hb_memory_tangent, only: width
   use hb_problem, only: deformation, problem_t
   use hb_text, only: to_text
   use hb_torus, only: torus_t
   use hb_transform, only: new_transform, product_table_t, transform_t
   implicit none
   private
   public :: balance_t, new_balance

   !> Owner of outside resources: call `destroy`.
   type, extends(problem_t) :: balance_t
      type(harmonics_t) :: harmonics
      type(dynamic_stiffness_t) :: stiffness
      real(wp), allocatable :: omega(:)                               !! base frequencies [rad/s], (n_tones)
      real(wp), allocatable :: frequencies(:)                         !! j.omega [rad/s], (n_harmonics)
      real(wp), allocatable :: xi(:)                                  !! artificial damping, negative, per tone [1/s], (n_tones)
      integer :: n_dofs = 0                                           !! degrees of freedom on which laws act
      type(law_set_t) :: law_set
      type(transform_t), private :: transform
      type(product_table_t), private :: table
      real(wp), private :: law_factor = 1.0_wp                        ! of a problem on the way to the one asked for
      real(wp), private :: load_factor = 1.0_wp
      real(wp), allocatable, private :: reaction(:, :), force(:, :)   ! (n_coefficients, n_dofs)
      real(wp), allocatable, private :: columns(:, :)                 ! (n_coefficients, 2) of a product
      real(wp), allocatable, private :: u_before(:, :)                ! (n_coefficients, n_dofs) motion a step of time earlier
      type(real_block_t), private :: answer                           ! (n_samples, 1) of a law with memory
      complex(wp), allocatable, private :: factors(:, :, :)           ! LU of S, (n_dofs, n_dofs, n_harmonics)
      integer, allocatable, private :: pivots(:, :)
      logical, allocatable, private :: is_singular(:)                 ! (n_harmonics) where the structure is free to move
      real(wp), allocatable, private :: support(:)                    ! (n_dofs) [N/m] that holds it there on the way
   contains
      procedure :: residual => balance_residual
      procedure :: tangent => balance_tangent
      procedure :: solve_linear => balance_solve_linear
      procedure :: rounding_level => balance_rounding_level
      procedure :: solve_mean_tangent => balance_solve_mean_tangent
      procedure :: move => balance_move
      procedure :: drives => balance_drives
      procedure :: frequency_derivative => balance_frequency_derivative
      procedure :: damping_derivative => balance_damping_derivative
      procedure :: mean_slopes => balance_mean_slopes
      procedure :: deform => balance_deform
      procedure :: linear_solution => balance_linear_solution
      procedure :: sample => balance_sample
      procedure :: project => balance_project
      procedure :: all_dofs => balance_all_dofs
      procedure :: destroy => balance_destroy
   end type balance_t

contains

   !> Balance of the laws on a structure whose dynamic stiffness is condensed to `law_dofs_of(laws)`.
   subroutine new_balance(self, harmonics, torus, omega, stiffness, laws, effort, error)
      type(balance_t), intent(inout) :: self
      type(harmonics_t), intent(in) :: harmonics
      type(torus_t), intent(in) :: torus
      real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s], (n_tones)
      type(dynamic_stiffness_t), intent(in) :: stiffness              !! at the frequencies j.omega of all harmonics
      type(law_box_t), intent(in) :: laws(:)                          !! at least one
      integer, intent(in) :: effort                                   !! one of hb_fftw%planning
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      self%harmonics = harmonics
      self%omega = omega
      self%frequencies = harmonics%frequencies(omega)
      self%xi = 0.0_wp*omega
      self%stiffness = stiffness
      self%n_dofs = size(stiffness%load, 1)
      self%n_unknowns = harmonics%n_coefficients*self%n_dofs
      self%law_factor = 1.0_wp
      self%load_factor = 1.0_wp
      call new_transform(self%transform, harmonics, torus, self%n_dofs, effort, error)
      if (allocated(error)) return
      call new_law_set(self%law_set, laws, torus, omega, error)
      if (allocated(error)) return
      call factorise_linear_part(self)
      do i = 1, size(laws)
         call prepare_law(self, i)
      end do
      if (allocated(self%reaction)) deallocate (self%reaction, self%force, self%columns)
      allocate (self%reaction(harmonics%n_coefficients, self%n_dofs), self%force(harmonics%n_coefficients, self%n_dofs))
      allocate (self%columns(harmonics%n_coefficients, 2))
      self%table = product_table_t()
      if (self%law_set%has_memory) then
         self%u_before = self%reaction
         call new_real_block(self%answer, torus%n_total, 1, error)
         if (allocated(error)) return
      end if
      call choose_scales(self)
   end subroutine new_balance

   !> LU of S per harmonic. Where S is singular (a structure free to move, an undamped resonance) weak supports hold it, each a
   !> tenth of the stiffness in the first harmonic that is not: for first guesses and first steps, never for a residual.
   subroutine factorise_linear_part(self)
      type(balance_t), intent(inout) :: self
      real(wp), parameter :: weakness = 1.0e-1_wp
      integer :: h, i, info
      complex(wp), allocatable :: free_motion(:, :)
      real(wp) :: stiffest

      self%factors = self%stiffness%condensed
      if (allocated(self%pivots)) deallocate (self%pivots)
      allocate (self%pivots(self%n_dofs, self%harmonics%n_harmonics))
      if (allocated(self%is_singular)) deallocate (self%is_singular)
      allocate (self%is_singular(self%harmonics%n_harmonics))
      allocate (free_motion(self%n_dofs, self%harmonics%n_harmonics))
      call self%stiffness%linear_amplitudes(free_motion, self%is_singular)
      h = max(1, findloc(self%is_singular, .false., dim=1))
      self%support = [(weakness*abs(self%stiffness%condensed(i, i, h)), i=1, self%n_dofs)]
      stiffest = maxval(self%support)
      if (stiffest <= 0.0_wp) stiffest = 1.0_wp
      where (self%support <= epsilon(1.0_wp)*stiffest) self%support = stiffest
      do h = 1, self%harmonics%n_harmonics
         if (self%is_singular(h)) then
            do i = 1, self%n_dofs
               self%factors(i, i, h) = self%factors(i, i, h) + self%support(i)
            end do
         end if
         call zgetrf(self%n_dofs, self%n_dofs, self%factors(:, :, h), self%n_dofs, self%pivots(:, h), info)
      end do
   end subroutine factorise_linear_part

   !> Tells law i what it feels at its first coordinate: the stiffness 1/|w.S^-1 w| in the first harmonic in which the
   !> structure is not free to move (the static one, unless the set has no zero tuple or the structure no support), and the
   !> impedance, this stiffness over |j.omega| in the fastest harmonic.
   subroutine prepare_law(self, i)
      type(balance_t), intent(inout) :: self
      integer, intent(in) :: i
      integer :: fastest, h
      real(wp) :: compliance, mobility

      h = max(1, findloc(self%is_singular, .false., dim=1))
      associate (law => self%law_set%laws(i)%law)
         compliance = compliance_of(self, i, h)
         if (compliance > 0.0_wp) call law%prepare(1.0_wp/compliance)
         fastest = maxloc(abs(self%frequencies), dim=1)
         mobility = abs(self%frequencies(fastest))*compliance_of(self, i, fastest)
         if (mobility > 0.0_wp) call law%prepare_rate(1.0_wp/mobility)
      end associate
   end subroutine prepare_law

   !> |w.S^-1 w| of harmonic h, with w the weights of the first coordinate of law i.
   real(wp) function compliance_of(self, i, h)
      type(balance_t), intent(in) :: self
      integer, intent(in) :: i, h
      complex(wp) :: response(self%n_dofs)
      integer :: info

      response = spread_weights(self, i)
      call zgetrs("N", self%n_dofs, 1, self%factors(:, :, h), self%n_dofs, self%pivots(:, h), response, self%n_dofs, info)
      compliance_of = abs(dot_product(spread_weights(self, i), response))
   end function compliance_of

   !> Weights of the first coordinate of law i over all degrees of freedom of the laws.
   function spread_weights(self, i) result(weights)
      type(balance_t), intent(in) :: self
      integer, intent(in) :: i
      complex(wp) :: weights(self%n_dofs)
      integer :: k

      weights = (0.0_wp, 0.0_wp)
      associate (columns => self%law_set%columns_of(i))
         do k = 1, size(columns)
            weights(columns(k)) = self%law_set%laws(i)%law%shape(k, 1)
         end do
      end associate
   end function spread_weights

   !> Scales of unknowns and equations, one each per degree of freedom: linear motion and loads; where these vanish, gaps and
   !> the forces at rest.
   subroutine choose_scales(self)
      type(balance_t), intent(inout) :: self
      real(wp) :: motion(self%n_dofs), load(self%n_dofs)
      real(wp) :: u(self%harmonics%n_coefficients, self%n_dofs), r(self%harmonics%n_coefficients, self%n_dofs)
      integer :: h, i

      call self%linear_solution(u)
      motion = norm2(u, dim=1)
      load = 0.0_wp
      do h = 1, self%harmonics%n_harmonics
         do i = 1, self%n_dofs
            load(i) = load(i) + max(abs(self%stiffness%load(i, h)), abs(self%stiffness%condensed(i, i, h)* &
                                                                      amplitude(self, u, h, i)))**2
         end do
      end do
      load = sqrt(load)
      if (maxval(load) <= 0.0_wp) then                                ! no loads: what the laws do at rest
         call balance_residual_of(self, 0.0_wp*u, r)
         load = norm2(r, dim=1)
      end if
      if (maxval(motion) <= 0.0_wp) then
         do i = 1, size(self%law_set%laws)
            motion = max(motion, self%law_set%laws(i)%law%length_scale())
         end do
      end if
      if (maxval(motion) <= 0.0_wp) motion = 1.0_wp
      if (maxval(load) <= 0.0_wp) load = maxval(abs(self%stiffness%condensed))*motion
      if (maxval(load) <= 0.0_wp) load = 1.0_wp
      where (motion <= epsilon(1.0_wp)*maxval(motion)) motion = maxval(motion)
      where (load <= epsilon(1.0_wp)*maxval(load)) load = maxval(load)
      self%x_scale = [(spread(motion(i), 1, self%harmonics%n_coefficients), i=1, self%n_dofs)]
      self%r_scale = [(spread(load(i), 1, self%harmonics%n_coefficients), i=1, self%n_dofs)]
   end subroutine choose_scales

   !> Complex amplitude a - i b of harmonic h in column i.
   pure complex(wp) function amplitude(self, u, h, i)
      type(balance_t), intent(in) :: self
      real(wp), intent(in) :: u(:, :)
      integer, intent(in) :: h, i
      integer :: sine

      sine = self%harmonics%sin_at(h)
      if (sine > 0) then
         amplitude = cmplx(u(self%harmonics%cos_at(h), i), -u(sine, i), wp)
      else
         amplitude = cmplx(u(self%harmonics%cos_at(h), i), 0.0_wp, wp)
      end if
   end function amplitude

   !> Writes the complex amplitude c = a - i b of harmonic h into column i; the zero tuple keeps its real part.
   pure subroutine set_amplitude(self, u, h, i, c)
      type(balance_t), intent(in) :: self
      real(wp), intent(inout) :: u(:, :)
      integer, intent(in) :: h, i
      complex(wp), intent(in) :: c

      u(self%harmonics%cos_at(h), i) = real(c)
      if (self%harmonics%sin_at(h) > 0) u(self%harmonics%sin_at(h), i) = -aimag(c)
   end subroutine set_amplitude

   !> The motion without any law; where the structure is free to move, that on its weak supports.
   subroutine balance_linear_solution(self, u)
      class(balance_t), intent(in) :: self
      real(wp), intent(out) :: u(self%harmonics%n_coefficients, self%n_dofs)   !! [m]
      complex(wp) :: c(self%n_dofs, self%harmonics%n_harmonics)
      logical :: is_singular(self%harmonics%n_harmonics)
      integer :: h, i, info

      call self%stiffness%linear_amplitudes(c, is_singular)
      do h = 1, self%harmonics%n_harmonics
         if (is_singular(h)) then
            c(:, h) = self%stiffness%load(:, h)
            call zgetrs("N", self%n_dofs, 1, self%factors(:, :, h), self%n_dofs, self%pivots(:, h), c(:, h), self%n_dofs, info)
         end if
         do i = 1, self%n_dofs
            call set_amplitude(self, u, h, i, c(i, h))
         end do
      end do
   end subroutine balance_linear_solution

   subroutine balance_residual(self, x, r)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(out), contiguous :: r(:)

      call balance_residual_of(self, x, r)
   end subroutine balance_residual

   !> R = F_nl - s, with s = F_ext - S u; the factors are 1 but on the way of a homotopy in the laws, where supports that fade as
   !> the laws grow hold a structure that is free to move.
   subroutine balance_residual_of(self, u, r)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)
      real(wp), intent(out) :: r(self%harmonics%n_coefficients, self%n_dofs)
      integer :: h, i

      call balance_sample(self, u)
      call self%law_set%evaluate()
      call self%transform%to_coefficients(self%law_set%f%values, self%force)
      r = self%law_factor*self%force - self%reaction
      do i = 1, self%n_dofs
         do h = 1, self%harmonics%n_harmonics
            if (self%is_singular(h)) call add_support(h, i)
         end do
      end do

   contains

      subroutine add_support(h, i)
         integer, intent(in) :: h, i

         associate (a => self%harmonics%cos_at(h), b => self%harmonics%sin_at(h), k => (1.0_wp - self%law_factor)*self%support(i))
            r(a, i) = r(a, i) + k*u(a, i)
            if (b > 0) r(b, i) = r(b, i) + k*u(b, i)
         end associate
      end subroutine add_support
   end subroutine balance_residual_of

   !> Brings the motion onto the torus: q, and v and s where a law asks for them.
   subroutine balance_sample(self, u)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)    !! [m]

      call find_reaction(self, u)
      call self%transform%to_samples(u, self%law_set%q%values)
      if (self%law_set%needs_velocity) then
         call self%transform%to_rate_samples(u, self%frequencies, self%law_set%v%values)
      end if
      if (self%law_set%needs_reaction) call self%transform%to_samples(self%reaction, self%law_set%s%values)
      if (self%law_set%has_memory) call sample_steps(self, u)
   end subroutine balance_sample

   !> The steps of time that end at the samples: motion at their start, rates at both ends.
   subroutine sample_steps(self, u)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(:, :)
      real(wp) :: angle(self%harmonics%n_harmonics)
      integer :: h, i

      angle = self%frequencies*self%law_set%characteristic%step
      do i = 1, self%n_dofs
         do h = 1, self%harmonics%n_harmonics
            call set_amplitude(self, self%u_before, h, i, amplitude(self, u, h, i)*cmplx(cos(angle(h)), -sin(angle(h)), wp))
         end do
      end do
      call self%transform%to_samples(self%u_before, self%law_set%q_before%values)
      call self%transform%to_rate_samples(u, angle, self%law_set%step_rate%values)
      call self%transform%to_rate_samples(self%u_before, angle, self%law_set%step_rate_before%values)
   end subroutine sample_steps

   !> s = F_ext - S u, per harmonic.
   subroutine find_reaction(self, u)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(:, :)
      complex(wp) :: s
      integer :: h, i, k

      do h = 1, self%harmonics%n_harmonics
         do i = 1, self%n_dofs
            s = self%load_factor*self%stiffness%load(i, h)
            do k = 1, self%n_dofs
               s = s - self%stiffness%condensed(i, k, h)*amplitude(self, u, h, k)
            end do
            call set_amplitude(self, self%reaction, h, i, s)
         end do
      end do
   end subroutine find_reaction

   subroutine balance_tangent(self, x, jacobian)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(out), contiguous :: jacobian(:, :)

      call balance_tangent_of(self, x, jacobian)
   end subroutine balance_tangent

   !> J = S + T[df/dq] + T[df/dv] d/dt - T[df/ds] S, with T[g] the projection of multiplication by g.
   !> Source: docs/theory.md, eq. (11) to (13).
   subroutine balance_tangent_of(self, u, jacobian)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)
      real(wp), intent(out) :: jacobian(self%harmonics%n_coefficients, self%n_dofs, &
                                        self%harmonics%n_coefficients, self%n_dofs)
      type(error_t), allocatable :: error
      integer :: h, i, k

      jacobian = 0.0_wp
      do k = 1, self%n_dofs
         do h = 1, self%harmonics%n_harmonics
            do i = 1, self%n_dofs
               call add_linear(self, jacobian, h, i, k)
            end do
            if (self%is_singular(h)) call add_support(h, k)
         end do
      end do
      call balance_sample(self, u)
      call self%law_set%differentiate(error)
      if (allocated(error)) then                                      ! out of memory: no tangent, the solver sees it
         jacobian = 0.0_wp
         return
      end if
      do i = 1, self%law_set%n_pairs
         associate (row => self%law_set%row(i), column => self%law_set%column(i))
            call self%transform%tabulate_product(self%law_set%df_dq%values, i, self%table, self%law_factor)
            call add_motion(self, jacobian(:, row, :, column))
            if (self%law_set%needs_velocity) then
               call self%transform%tabulate_product(self%law_set%df_dv%values, i, self%table, self%law_factor)
               call add_rate(self, jacobian(:, row, :, column))
            end if
            if (self%law_set%needs_reaction) then
               call self%transform%tabulate_product(self%law_set%df_ds%values, i, self%table, self%law_factor)
               do k = 1, self%n_dofs
                  call add_reaction(self, column, k, jacobian(:, row, :, k))
               end do
            end if
         end associate
      end do
      if (self%law_set%has_memory) call add_memory(self, jacobian)

   contains

      subroutine add_support(h, i)
         integer, intent(in) :: h, i

         associate (a => self%harmonics%cos_at(h), b => self%harmonics%sin_at(h), k => (1.0_wp - self%law_factor)*self%support(i))
            jacobian(a, i, a, i) = jacobian(a, i, a, i) + k
            if (b > 0) jacobian(b, i, b, i) = jacobian(b, i, b, i) + k
         end associate
      end subroutine add_support
   end subroutine balance_tangent_of

   !> Adds what the forces with memory answer to each coefficient: through coordinate b of a law, cos or sin of harmonic h of
   !> the degree of freedom k moves it by shape(k, b) times that of the coordinate.
   subroutine add_memory(self, jacobian)
      type(balance_t), intent(inout) :: self
      real(wp), intent(inout) :: jacobian(:, :, :, :)
      logical :: has_answers
      integer :: b, block, h, i, in_block, k, law, part, place

      do law = 1, size(self%law_set%laws)
         call self%law_set%prepare_answers(law, self%harmonics, self%transform%torus, self%frequencies, has_answers)
         if (.not. has_answers) cycle
         associate (moved => self%law_set%columns_of(law), answering => self%law_set%answering_dofs(law), &
                    shape => self%law_set%laws(law)%law%shape)
            do b = 1, size(shape, 2)
               h = 0
               do block = 1, self%law_set%n_blocks(law)
                  call self%law_set%answer_block(law, b, block)
                  do in_block = 1, min(width, self%harmonics%n_harmonics - h)
                     h = h + 1
                     do part = 1, 2
                        place = merge(self%harmonics%cos_at(h), self%harmonics%sin_at(h), part == 1)
                        if (place == 0) cycle
                        do i = 1, size(answering)
                           call self%law_set%answer(law, in_block, part, answering(i), self%answer%values(:, 1))
                           call self%transform%to_coefficients_of_one(self%answer%values, self%columns(:, 1))
                           do k = 1, size(moved)
                              jacobian(:, answering(i), place, moved(k)) = jacobian(:, answering(i), place, moved(k)) &
                                                                           + self%law_factor*shape(k, b)*self%columns(:, 1)
                           end do
                        end do
                     end do
                  end do
               end do
            end do
         end associate
      end do
   end subroutine add_memory

   !> Block of S for harmonic h: (S c) = (Re S a + Im S b) - i (Re S b - Im S a).
   pure subroutine add_linear(self, jacobian, h, i, k)
      type(balance_t), intent(in) :: self
      real(wp), intent(inout) :: jacobian(:, :, :, :)
      integer, intent(in) :: h, i, k

      associate (s => self%stiffness%condensed(i, k, h), a => self%harmonics%cos_at(h), b => self%harmonics%sin_at(h))
         jacobian(a, i, a, k) = jacobian(a, i, a, k) + real(s)
         if (b == 0) return
         jacobian(a, i, b, k) = jacobian(a, i, b, k) + aimag(s)
         jacobian(b, i, a, k) = jacobian(b, i, a, k) - aimag(s)
         jacobian(b, i, b, k) = jacobian(b, i, b, k) + real(s)
      end associate
   end subroutine add_linear

   !> block += T[g]
   subroutine add_motion(self, block)
      type(balance_t), intent(inout) :: self
      real(wp), intent(inout) :: block(:, :)
      integer :: h

      associate (set => self%harmonics)
         do h = 1, set%n_harmonics
            call self%table%columns(set, h, self%columns(:, 1), self%columns(:, 2))
            block(:, set%cos_at(h)) = block(:, set%cos_at(h)) + self%columns(:, 1)
            if (set%sin_at(h) > 0) block(:, set%sin_at(h)) = block(:, set%sin_at(h)) + self%columns(:, 2)
         end do
      end associate
   end subroutine add_motion

   !> block += T[g] d/dt: the rate of cos is -frequency sin, that of sin is frequency cos.
   subroutine add_rate(self, block)
      type(balance_t), intent(inout) :: self
      real(wp), intent(inout) :: block(:, :)
      integer :: h

      associate (set => self%harmonics, w => self%frequencies)
         do h = merge(2, 1, set%has_zero), set%n_harmonics
            call self%table%columns(set, h, self%columns(:, 1), self%columns(:, 2))
            block(:, set%cos_at(h)) = block(:, set%cos_at(h)) - w(h)*self%columns(:, 2)
            block(:, set%sin_at(h)) = block(:, set%sin_at(h)) + w(h)*self%columns(:, 1)
         end do
      end associate
   end subroutine add_rate

   !> block += -T[g] S(m, k): how a force that depends on the reaction at m moves with the motion of k.
   subroutine add_reaction(self, m, k, block)
      type(balance_t), intent(inout) :: self
      integer, intent(in) :: m, k
      real(wp), intent(inout) :: block(:, :)
      integer :: h

      associate (set => self%harmonics)
         do h = 1, set%n_harmonics
            call self%table%columns(set, h, self%columns(:, 1), self%columns(:, 2))
            associate (s => self%stiffness%condensed(m, k, h), a => set%cos_at(h), b => set%sin_at(h))
               block(:, a) = block(:, a) - real(s)*self%columns(:, 1)
               if (b > 0) then
                  block(:, a) = block(:, a) + aimag(s)*self%columns(:, 2)
                  block(:, b) = block(:, b) - aimag(s)*self%columns(:, 1) - real(s)*self%columns(:, 2)
               end if
            end associate
         end do
      end associate
   end subroutine add_reaction

   !> Changes base frequencies and artificial damping; scales, first Jacobian and what laws were told by the structure stay.
   !>
   !> Fails where the stiffness was made without slopes or its interior is singular at the new frequencies.
   subroutine balance_move(self, omega, xi, error)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s], (n_tones), > 0
      real(wp), intent(in) :: xi(:)                                   !! [1/s], (n_tones)
      type(error_t), allocatable, intent(out) :: error
      logical :: is_same(2)

      is_same = [all(omega == self%omega), all(xi == self%xi)]
      if (all(is_same)) return
      self%omega = omega
      self%xi = xi
      self%frequencies = self%harmonics%frequencies(omega)
      if (.not. is_same(1)) call self%law_set%move(self%transform%torus, omega)
      call self%stiffness%move(self%frequencies, self%drives(), error)
      if (allocated(error)) self%omega = -1.0_wp                      ! what is kept fits no frequencies
   end subroutine balance_move

   !> The drive of each harmonic, sum over the tones of xi_m j_m omega_m [rad**2/s**2]: the artificial forces
   !> -M sum_m xi_m omega_m dx/dtau_m on the left-hand side. Source: docs/theory.md, section 6.5.
   pure function balance_drives(self) result(drives)
      class(balance_t), intent(in) :: self
      real(wp) :: drives(self%harmonics%n_harmonics)

      drives = self%harmonics%frequencies(self%xi*self%omega)
   end function balance_drives

   !> Derivative of the residual by the artificial damping of tone m at fixed coefficients and frequencies. Fails as
   !> `frequency_derivative` does.
   subroutine balance_damping_derivative(self, u, m, derivative, error)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)    !! [m]
      integer, intent(in) :: m                                        !! tone
      real(wp), intent(out) :: derivative(self%harmonics%n_coefficients, self%n_dofs)   !! [N s]
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: reaction(self%harmonics%n_coefficients, self%n_dofs)

      call prepare_slopes(self, u, m, derivative, error)
      if (allocated(error)) return
      call find_reaction_slope(self, u, 0.0_wp*self%frequencies, self%omega(m)*self%harmonics%tuples(m, :), reaction)
      associate (by => self%law_set%by_frequency)
         if (self%law_set%needs_reaction) then
            if (self%law_set%needs_velocity) by%v%values = 0.0_wp
            call self%transform%to_samples(reaction, by%s%values)
            call self%law_set%differentiate_without_memory()
            call self%transform%to_coefficients(by%f%values, self%force)
            derivative = self%law_factor*self%force
         end if
      end associate
      derivative = derivative - reaction
   end subroutine balance_damping_derivative

   !> What both derivatives begin with: refuses what cannot be answered, evaluates the laws with derivatives.
   subroutine prepare_slopes(self, u, m, derivative, error)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(:, :)
      integer, intent(in) :: m
      real(wp), intent(out) :: derivative(:, :)
      type(error_t), allocatable, intent(out) :: error

      derivative = 0.0_wp
      if (.not. allocated(self%stiffness%condensed_slope)) then
         call fail(error, "balance: its dynamic stiffness was made without slopes; derivatives by frequencies need them")
      else if (m < 1 .or. m > size(self%omega)) then
         call fail(error, "balance: no tone "//to_text(m)//" to differentiate by, there are 1 to "//to_text(size(self%omega)))
      end if
      if (allocated(error)) return
      call balance_sample(self, u)
      call self%law_set%differentiate(error)
      if (allocated(error)) return
      call self%law_set%make_frequency_samples(error)
   end subroutine prepare_slopes

   !> Means over the torus of the derivatives of all forces by motion and rate, at a motion. Reactions are left out.
   subroutine balance_mean_slopes(self, u, df_dq, df_dv, error)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)    !! [m]
      real(wp), intent(out) :: df_dq(:, :)                            !! [N/m], (n_dofs, n_dofs)
      real(wp), intent(out) :: df_dv(:, :)                            !! [N s/m], as df_dq
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: df_ds(self%n_dofs, self%n_dofs)

      call balance_sample(self, u)
      call self%law_set%differentiate(error)
      if (.not. allocated(error)) call self%law_set%mean_slopes(df_dq, df_dv, df_ds)
   end subroutine balance_mean_slopes

   !> Derivative of the residual by base frequency m at fixed coefficients, exact for the discrete equations:
   !> dR/domega_m = j_m (dS/dw u - dP/dw) + the projection of df/dv dv/domega_m + df/ds ds/domega_m.
   !>
   !> What laws were told by the structure (`prepare`) stays. Fails where the stiffness was made without slopes, for a tone
   !> that does not exist, where the answer of a memory does not repeat, and out of memory. Source: docs/theory.md, section 5.6.
   subroutine balance_frequency_derivative(self, u, m, derivative, error)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)    !! [m]
      integer, intent(in) :: m                                        !! tone
      real(wp), intent(out) :: derivative(self%harmonics%n_coefficients, self%n_dofs)   !! [N s]
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: turns(self%harmonics%n_harmonics)                   ! j_m, the derivative of j.omega
      real(wp) :: reaction(self%harmonics%n_coefficients, self%n_dofs)
      real(wp), allocatable :: weight_slope(:)

      call prepare_slopes(self, u, m, derivative, error)
      if (allocated(error)) return
      turns = real(self%harmonics%tuples(m, :), wp)
      allocate (weight_slope(0))
      call find_reaction_slope(self, u, turns, self%xi(m)*turns, reaction)
      associate (by => self%law_set%by_frequency)
         if (self%law_set%needs_velocity) call self%transform%to_rate_samples(u, turns, by%v%values)
         if (self%law_set%needs_reaction) call self%transform%to_samples(reaction, by%s%values)
         if (self%law_set%has_memory) call sample_step_slopes(self, u, m, turns, weight_slope)
         call self%law_set%differentiate_by_frequency(weight_slope, error)
         if (allocated(error)) return
         call self%transform%to_coefficients(by%f%values, self%force)
      end associate
      derivative = self%law_factor*self%force - reaction
   end subroutine balance_frequency_derivative

   !> How the steps of time change with base frequency m: motion at their start, rates at both ends, and the weights of the
   !> neighbours there. With the angle phi = j.omega step and c the amplitude at the end of a step,
   !> d(c exp(-i phi)) = -i c exp(-i phi) dphi, and d(i phi c exp(-i phi)) = (i + phi) c exp(-i phi) dphi.
   subroutine sample_step_slopes(self, u, m, turns, weight_slope)
      class(balance_t), intent(inout) :: self                         !! after `sample`
      real(wp), intent(in) :: u(:, :)
      integer, intent(in) :: m
      real(wp), intent(in) :: turns(:)                                !! j_m, (n_harmonics)
      real(wp), allocatable, intent(inout) :: weight_slope(:)
      real(wp), dimension(self%harmonics%n_harmonics) :: angle, angle_slope
      real(wp) :: rate_slope(self%harmonics%n_coefficients, self%n_dofs), step_slope
      integer :: h, i

      associate (characteristic => self%law_set%characteristic, by => self%law_set%by_frequency)
         weight_slope = 0.0_wp*characteristic%weight
         call characteristic%frequency_slopes(m, step_slope, weight_slope)
         angle = self%frequencies*characteristic%step
         angle_slope = turns*characteristic%step
         if (m == characteristic%tone) angle_slope = (self%frequencies - turns*self%omega(m))*step_slope   ! this tone cancels
         do i = 1, self%n_dofs
            do h = 1, self%harmonics%n_harmonics
               call set_amplitude(self, rate_slope, h, i, &
                                  cmplx(angle(h), 1.0_wp, wp)*angle_slope(h)*amplitude(self, self%u_before, h, i))
            end do
         end do
         call self%transform%to_rate_samples(self%u_before, -angle_slope, by%q_before%values)
         call self%transform%to_rate_samples(u, angle_slope, by%step_rate%values)
         call self%transform%to_samples(rate_slope, by%step_rate_before%values)
      end associate
   end subroutine sample_step_slopes

   !> Derivative of s where the frequency of each harmonic changes by `turns` and its drive by `drive_turns`:
   !> (dP/dw - dS/dw u) turns + (dP/ddrive - dS/ddrive u) drive_turns.
   subroutine find_reaction_slope(self, u, turns, drive_turns, slope)
      type(balance_t), intent(in) :: self
      real(wp), intent(in) :: u(:, :)
      real(wp), intent(in) :: turns(:), drive_turns(:)                !! (n_harmonics)
      real(wp), intent(out) :: slope(:, :)                            !! [N s], as u
      complex(wp) :: s
      integer :: h, i, k

      do h = 1, self%harmonics%n_harmonics
         do i = 1, self%n_dofs
            s = self%load_factor*(turns(h)*self%stiffness%load_slope(i, h) + drive_turns(h)*self%stiffness%load_drive_slope(i, h))
            do k = 1, self%n_dofs
               s = s - (turns(h)*self%stiffness%condensed_slope(i, k, h) + &
                        drive_turns(h)*self%stiffness%condensed_drive_slope(i, k, h))*amplitude(self, u, h, k)
            end do
            call set_amplitude(self, slope, h, i, s)
         end do
      end do
   end subroutine find_reaction_slope

   !> Multiplies all forces of the laws, or all loads, by a factor.
   subroutine balance_deform(self, kind, amount)
      class(balance_t), intent(inout) :: self
      integer, intent(in) :: kind
      real(wp), intent(in) :: amount

      if (kind == deformation%nonlinearity) self%law_factor = amount
      if (kind == deformation%load) self%load_factor = amount
   end subroutine balance_deform

   subroutine balance_solve_linear(self, r, step)
      class(balance_t), intent(in) :: self
      real(wp), intent(in), contiguous :: r(:)
      real(wp), intent(out), contiguous :: step(:)

      call solve_linear_of(self, r, step)
   end subroutine balance_solve_linear

   !> step = S^-1 r, harmonic by harmonic.
   subroutine solve_linear_of(self, r, step)
      class(balance_t), intent(in) :: self
      real(wp), intent(in) :: r(self%harmonics%n_coefficients, self%n_dofs)
      real(wp), intent(out) :: step(self%harmonics%n_coefficients, self%n_dofs)
      complex(wp) :: c(self%n_dofs)
      integer :: h, i, info

      do h = 1, self%harmonics%n_harmonics
         do i = 1, self%n_dofs
            c(i) = amplitude(self, r, h, i)
         end do
         call zgetrs("N", self%n_dofs, 1, self%factors(:, :, h), self%n_dofs, self%pivots(:, h), c, self%n_dofs, info)
         do i = 1, self%n_dofs
            call set_amplitude(self, step, h, i, c(i))
         end do
      end do
   end subroutine solve_linear_of

   !> Solves with the tangent at u of each harmonic by itself, (1 - mean df/ds) S + mean df/dq + i w mean df/dv: what couples
   !> the harmonics is left out.
   subroutine balance_solve_mean_tangent(self, u, r, step, error)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)    !! [m]
      real(wp), intent(in) :: r(self%harmonics%n_coefficients, self%n_dofs)    !! [N]
      real(wp), intent(out) :: step(self%harmonics%n_coefficients, self%n_dofs)
      type(error_t), allocatable, intent(out) :: error
      real(wp), dimension(self%n_dofs, self%n_dofs) :: df_dq, df_dv, df_ds
      complex(wp) :: block(self%n_dofs, self%n_dofs), c(self%n_dofs)
      integer :: h, i, info, pivots(self%n_dofs)

      call balance_sample(self, u)
      call self%law_set%differentiate(error)
      if (allocated(error)) return
      call self%law_set%mean_slopes(df_dq, df_dv, df_ds)
      do h = 1, self%harmonics%n_harmonics
         associate (s => self%stiffness%condensed(:, :, h))
            block = s - matmul(df_ds, s) + cmplx(df_dq, self%frequencies(h)*df_dv, wp)
         end associate
         do i = 1, self%n_dofs
            c(i) = amplitude(self, r, h, i)
         end do
         call zgetrf(self%n_dofs, self%n_dofs, block, self%n_dofs, pivots, info)
         if (info == 0) then
            call zgetrs("N", self%n_dofs, 1, block, self%n_dofs, pivots, c, self%n_dofs, info)
         else
            c = (0.0_wp, 0.0_wp)
         end if
         do i = 1, self%n_dofs
            call set_amplitude(self, step, h, i, c(i))
         end do
      end do
   end subroutine balance_solve_mean_tangent

   real(wp) function balance_rounding_level(self, x)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)

      balance_rounding_level = rounding_level_of(self, x)
   end function balance_rounding_level

   !> A few units in the last place of the largest terms of each equation: |F_ext| + |S| |u|, and what an error of one unit
   !> in the motion does to the forces of stiff laws.
   real(wp) function rounding_level_of(self, u)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)
      real(wp), parameter :: units = 8.0_wp
      real(wp), parameter :: largest_level = 1.0e-6_wp                 ! above, a point counts as lost, not as rounded
      type(error_t), allocatable :: error
      real(wp) :: terms, total
      integer :: h, i, k

      total = 0.0_wp
      do h = 1, self%harmonics%n_harmonics
         do i = 1, self%n_dofs
            terms = abs(self%stiffness%load(i, h))
            do k = 1, self%n_dofs
               terms = terms + abs(self%stiffness%condensed(i, k, h))*abs(amplitude(self, u, h, k))
            end do
            total = total + (terms/scale_of(i))**2
         end do
      end do
      call balance_sample(self, u)
      call self%law_set%differentiate(error)
      if (.not. allocated(error)) then                                ! without memory the first part must do
         do i = 1, self%law_set%n_pairs
            associate (slope => self%law_set%df_dq%values(:, i), q => self%law_set%q%values(:, self%law_set%column(i)))
               terms = norm2(slope)/sqrt(real(size(slope), wp))*maxval(abs(q))
            end associate
            total = total + (self%law_factor*terms/scale_of(self%law_set%row(i)))**2
         end do
         if (self%law_set%has_memory) total = total + sum((self%law_factor*self%law_set%spring_forces() &
                                                           /[(scale_of(i), i=1, self%n_dofs)])**2)
      end if
      rounding_level_of = min(largest_level, units*epsilon(1.0_wp)*sqrt(total))

   contains

      real(wp) function scale_of(dof)
         integer, intent(in) :: dof

         scale_of = self%r_scale(1 + (dof - 1)*self%harmonics%n_coefficients)
      end function scale_of
   end function rounding_level_of

   !> Coefficients of sampled functions at the degrees of freedom of the laws, such as the forces `law_set%f`.
   subroutine balance_project(self, samples, coefficients)
      class(balance_t), intent(inout) :: self
      real(wp), intent(inout), contiguous :: samples(:, :)            !! (n_samples, n_dofs), aligned as those of law_set
      real(wp), intent(out) :: coefficients(:, :)                     !! (n_coefficients, n_dofs)

      call self%transform%to_coefficients(samples, coefficients)
   end subroutine balance_project

   !> Motion of all degrees of freedom of the structure from that at the laws.
   subroutine balance_all_dofs(self, u, c)
      class(balance_t), intent(in) :: self
      real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)    !! [m]
      complex(wp), intent(out) :: c(:, :)                             !! a - i b [m], (all dofs, n_harmonics)
      complex(wp) :: at_laws(self%n_dofs, self%harmonics%n_harmonics)
      integer :: h, i

      do h = 1, self%harmonics%n_harmonics
         do i = 1, self%n_dofs
            at_laws(i, h) = amplitude(self, u, h, i)
         end do
      end do
      call self%stiffness%recover(at_laws, c)
   end subroutine balance_all_dofs

   !> Frees transforms and samples; safe to call twice.
   subroutine balance_destroy(self)
      class(balance_t), intent(inout) :: self

      call self%transform%destroy()
      call self%law_set%destroy()
      call self%answer%destroy()
   end subroutine balance_destroy
end module hb_balance
