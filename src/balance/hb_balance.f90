!> The harmonic balance of a scene: R(u) = S u + F_nl(u) - F_ext at the degrees of freedom on which laws act.
!>
!> Forces are evaluated on the torus and projected back (alternating frequency/time); the tangent is the exact derivative
!> of this discrete residual. Unknowns u(n_coefficients, n_dofs) are cosines and sines, degree of freedom by degree of
!> freedom. Source: docs/theory.md, sections 3 to 5.
!>
!> Glossary: u unknowns, S condensed dynamic stiffness, s reaction = F_ext - S u, q motion and v rate on the samples.
module hb_balance
   use hb_dynamic_stiffness, only: dynamic_stiffness_t
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_lapack, only: zgetrf, zgetrs
   use hb_law, only: law_box_t
   use hb_law_set, only: law_set_t, new_law_set
   use hb_problem, only: problem_t
   use hb_torus, only: torus_t
   use hb_transform, only: new_transform, product_table_t, transform_t
   implicit none
   private
   public :: balance_t, new_balance

   !> Owner of outside resources: call `destroy`.
   type, extends(problem_t) :: balance_t
      type(harmonics_t) :: harmonics
      type(dynamic_stiffness_t) :: stiffness
      real(wp), allocatable :: frequencies(:)                         !! j.omega [rad/s], (n_harmonics)
      integer :: n_dofs = 0                                           !! degrees of freedom on which laws act
      type(law_set_t) :: law_set
      type(transform_t), private :: transform
      type(product_table_t), private :: table
      real(wp), allocatable, private :: reaction(:, :), force(:, :)   ! (n_coefficients, n_dofs)
      real(wp), allocatable, private :: columns(:, :)                 ! (n_coefficients, 2) of a product
      complex(wp), allocatable, private :: factors(:, :, :)           ! LU of S, (n_dofs, n_dofs, n_harmonics)
      integer, allocatable, private :: pivots(:, :)
      logical, allocatable, private :: is_singular(:)                 ! (n_harmonics) where the structure is free to move
   contains
      procedure :: residual => balance_residual
      procedure :: tangent => balance_tangent
      procedure :: solve_linear => balance_solve_linear
      procedure :: rounding_level => balance_rounding_level
      procedure :: linear_solution => balance_linear_solution
      procedure :: sample => balance_sample
      procedure :: project => balance_project
      procedure :: all_dofs => balance_all_dofs
      procedure :: destroy => balance_destroy
   end type balance_t

contains

   !> Balance of the laws on a structure whose dynamic stiffness is condensed to `law_dofs_of(laws)`.
   subroutine new_balance(self, harmonics, torus, frequencies, stiffness, laws, effort, error)
      type(balance_t), intent(inout) :: self
      type(harmonics_t), intent(in) :: harmonics
      type(torus_t), intent(in) :: torus
      real(wp), intent(in) :: frequencies(:)                          !! j.omega [rad/s], (n_harmonics)
      type(dynamic_stiffness_t), intent(in) :: stiffness
      type(law_box_t), intent(in) :: laws(:)                          !! at least one
      integer, intent(in) :: effort                                   !! one of hb_fftw%planning
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      self%harmonics = harmonics
      self%frequencies = frequencies
      self%stiffness = stiffness
      self%n_dofs = size(stiffness%load, 1)
      self%n_unknowns = harmonics%n_coefficients*self%n_dofs
      call new_transform(self%transform, harmonics, torus, self%n_dofs, effort, error)
      if (allocated(error)) return
      call new_law_set(self%law_set, laws, torus%n_total, error)
      if (allocated(error)) return
      call factorise_linear_part(self)
      do i = 1, size(laws)
         call prepare_law(self, i)
      end do
      if (allocated(self%reaction)) deallocate (self%reaction, self%force, self%columns)
      allocate (self%reaction(harmonics%n_coefficients, self%n_dofs), self%force(harmonics%n_coefficients, self%n_dofs))
      allocate (self%columns(harmonics%n_coefficients, 2))
      self%table = product_table_t()
      call choose_scales(self)
   end subroutine new_balance

   !> LU of S per harmonic. Where S is singular (a structure free to move, an undamped resonance) its diagonal is lifted:
   !> the factors are used for first steps only, never for a residual.
   subroutine factorise_linear_part(self)
      type(balance_t), intent(inout) :: self
      real(wp), parameter :: lift = 1.0e-6_wp
      integer :: h, i, info
      complex(wp), allocatable :: free_motion(:, :)
      real(wp) :: magnitude

      self%factors = self%stiffness%condensed
      if (allocated(self%pivots)) deallocate (self%pivots)
      allocate (self%pivots(self%n_dofs, self%harmonics%n_harmonics))
      if (allocated(self%is_singular)) deallocate (self%is_singular)
      allocate (self%is_singular(self%harmonics%n_harmonics))
      allocate (free_motion(self%n_dofs, self%harmonics%n_harmonics))
      call self%stiffness%linear_amplitudes(free_motion, self%is_singular)
      magnitude = maxval(abs(self%factors))
      if (magnitude <= 0.0_wp) magnitude = 1.0_wp
      do h = 1, self%harmonics%n_harmonics
         if (self%is_singular(h)) then
            do i = 1, self%n_dofs
               self%factors(i, i, h) = self%factors(i, i, h) + lift*magnitude
            end do
         end if
         call zgetrf(self%n_dofs, self%n_dofs, self%factors(:, :, h), self%n_dofs, self%pivots(:, h), info)
      end do
   end subroutine factorise_linear_part

   !> Tells law i the stiffness 1/|w.S^-1 w| that it feels at its first coordinate, in the first harmonic in which the
   !> structure is not free to move: the static one, unless the set has no zero tuple or the structure no support.
   subroutine prepare_law(self, i)
      type(balance_t), intent(inout) :: self
      integer, intent(in) :: i
      complex(wp) :: response(self%n_dofs)
      integer :: h, info
      real(wp) :: compliance

      h = max(1, findloc(self%is_singular, .false., dim=1))
      associate (law => self%law_set%laws(i)%law)
         response = spread_weights(self, i)
         call zgetrs("N", self%n_dofs, 1, self%factors(:, :, h), self%n_dofs, self%pivots(:, h), response, self%n_dofs, info)
         compliance = abs(dot_product(spread_weights(self, i), response))
         if (compliance > 0.0_wp) call law%prepare(1.0_wp/compliance)
      end associate
   end subroutine prepare_law

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

   !> The motion without any law; zero in harmonics where the structure is free to move.
   subroutine balance_linear_solution(self, u)
      class(balance_t), intent(in) :: self
      real(wp), intent(out) :: u(self%harmonics%n_coefficients, self%n_dofs)   !! [m]
      complex(wp) :: c(self%n_dofs, self%harmonics%n_harmonics)
      logical :: is_singular(self%harmonics%n_harmonics)
      integer :: h, i

      call self%stiffness%linear_amplitudes(c, is_singular)
      do h = 1, self%harmonics%n_harmonics
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

   !> R = F_nl - s, with s = F_ext - S u.
   subroutine balance_residual_of(self, u, r)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)
      real(wp), intent(out) :: r(self%harmonics%n_coefficients, self%n_dofs)

      call balance_sample(self, u)
      call self%law_set%evaluate()
      call self%transform%to_coefficients(self%law_set%f%values, self%force)
      r = self%force - self%reaction
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
   end subroutine balance_sample

   !> s = F_ext - S u, per harmonic.
   subroutine find_reaction(self, u)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(:, :)
      complex(wp) :: s
      integer :: h, i, k

      do h = 1, self%harmonics%n_harmonics
         do i = 1, self%n_dofs
            s = self%stiffness%load(i, h)
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
            call self%transform%tabulate_product(self%law_set%df_dq%values, i, self%table)
            call add_motion(self, jacobian(:, row, :, column))
            if (self%law_set%needs_velocity) then
               call self%transform%tabulate_product(self%law_set%df_dv%values, i, self%table)
               call add_rate(self, jacobian(:, row, :, column))
            end if
            if (self%law_set%needs_reaction) then
               call self%transform%tabulate_product(self%law_set%df_ds%values, i, self%table)
               do k = 1, self%n_dofs
                  call add_reaction(self, column, k, jacobian(:, row, :, k))
               end do
            end if
         end associate
      end do
   end subroutine balance_tangent_of

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

   real(wp) function balance_rounding_level(self, x)
      class(balance_t), intent(in) :: self
      real(wp), intent(in), contiguous :: x(:)

      balance_rounding_level = rounding_level_of(self, x)
   end function balance_rounding_level

   !> A few units in the last place of the largest terms of each equation: |F_ext| + |S| |u|.
   real(wp) function rounding_level_of(self, u)
      class(balance_t), intent(in) :: self
      real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)
      real(wp), parameter :: units = 8.0_wp
      real(wp) :: terms, total
      integer :: h, i, k

      total = 0.0_wp
      do h = 1, self%harmonics%n_harmonics
         do i = 1, self%n_dofs
            terms = abs(self%stiffness%load(i, h))
            do k = 1, self%n_dofs
               terms = terms + abs(self%stiffness%condensed(i, k, h))*abs(amplitude(self, u, h, k))
            end do
            total = total + (terms/self%r_scale(1 + (i - 1)*self%harmonics%n_coefficients))**2
         end do
      end do
      rounding_level_of = units*epsilon(1.0_wp)*sqrt(total)
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
   end subroutine balance_destroy
end module hb_balance
