!> The preconditioner of the balance: the exact tangent between the harmonics that the laws couple most, and the tangent of
!> each other harmonic by itself.
!>
!> Source: docs/user/theory.md, section 6.6.
submodule (hb_balance) hb_balance_precondition
   use hb_block_factors, only: new_block_factors
   use hb_coarse_tangent, only: factor_memory, factor_work, most_memory, new_coarse_tangent
   implicit none

   real(wp), parameter :: unit_work = 1.0e6_wp                        ! multiplications: factors at level 1 take eight times that

contains

   module subroutine balance_update_preconditioner(self, level, is_strongest)
      class(balance_t), intent(inout) :: self
      integer, intent(in) :: level
      logical, intent(out) :: is_strongest
      real(wp), dimension(self%n_dofs, self%n_dofs) :: df_dq, df_dv, df_ds
      real(wp), dimension(self%n_dofs) :: varies_q, varies_v, varies_s
      complex(wp) :: block(self%tangent_pattern%n_rows, self%n_dofs)
      real(wp) :: coupling(self%harmonics%n_harmonics)
      logical :: is_singular
      integer :: h, i

      call self%law_set%mean_slopes(df_dq, df_dv, df_ds)
      df_dq = self%law_factor*df_dq
      df_dv = self%law_factor*df_dv
      df_ds = self%law_factor*df_ds
      call self%law_set%jacobian%variation(varies_q, varies_v, varies_s)
      if (.not. allocated(self%alone)) then
         allocate (self%alone)
         call new_block_factors(self%alone, self%tangent_pattern, self%harmonics%n_harmonics)
      end if
      do h = 1, self%harmonics%n_harmonics
         call self%mean_tangent(h, df_dq, df_dv, df_ds, block)
         coupling(h) = coupling_of(h)
         call self%alone%factorise(h, block, is_singular)
         if (is_singular) then                                        ! a unit step per unit force: any will do
            block = (0.0_wp, 0.0_wp)
            do i = 1, self%n_dofs
               associate (first => 1 + (i - 1)*self%harmonics%n_coefficients)
                  block(self%tangent_pattern%shift(i) + i, i) = cmplx(self%r_scale(first)/self%x_scale(first), kind=wp)
               end associate
            end do
            call self%alone%factorise(h, block, is_singular)
         end if
      end do
      call choose_coupled(self, level, coupling, is_strongest)
      if (allocated(self%coupled)) call fill_coupled(self)

   contains

      !> How strongly a harmonic answers to what the laws pass on from others: what varies in their slopes, relative to its
      !> own stiffness, at the degree of freedom where that is most.
      real(wp) function coupling_of(h)
         integer, intent(in) :: h

         coupling_of = 0.0_wp
         do i = 1, self%n_dofs
            associate (own => abs(block(self%tangent_pattern%shift(i) + i, i)), &
                       linear => abs(self%stiffness%condensed(self%stiffness%pattern%shift(i) + i, i, h)))
               coupling_of = max(coupling_of, (varies_q(i) + abs(self%frequencies(h))*varies_v(i) + linear*varies_s(i))/ &
                                 max(tiny(1.0_wp), own))
            end associate
         end do
      end function coupling_of
   end subroutine balance_update_preconditioner

   !> Takes the harmonics with the strongest coupling, as many as the level allows; all of them make the factors those of the
   !> tangent itself.
   subroutine choose_coupled(self, level, coupling, is_strongest)
      type(balance_t), intent(inout) :: self
      integer, intent(in) :: level
      real(wp), intent(in) :: coupling(:)                             !! (n_harmonics)
      logical, intent(out) :: is_strongest
      integer, allocatable :: kept(:)
      integer :: most, possible

      is_strongest = .false.
      if (level == 0) then
         if (allocated(self%coupled)) deallocate (self%coupled)
         return
      end if
      possible = size(coupling)
      do while (factor_memory(2*possible, self%n_dofs, self%tangent_pattern%reach) > most_memory .and. possible > 0)
         possible = possible - max(1, possible/32)
      end do
      most = possible
      do while (factor_work(2*most, self%n_dofs, self%tangent_pattern%reach) > unit_work*8.0_wp**level .and. most > 0)
         most = most - max(1, most/32)
      end do
      is_strongest = most == possible
      kept = strongest(coupling, most)
      if (allocated(self%coupled)) then
         if (size(self%coupled%kept) == size(kept)) then
            if (all(self%coupled%kept == kept)) return
         end if
         deallocate (self%coupled)
      end if
      if (size(kept) == 0) return
      allocate (self%coupled)
      call new_coarse_tangent(self%coupled, self%harmonics, kept, self%n_dofs, self%tangent_pattern%reach)
   end subroutine choose_coupled

   !> Numbers of the largest values, at most `most` of them, in ascending order; of equal ones all or none.
   pure function strongest(values, most) result(kept)
      real(wp), intent(in) :: values(:)                               !! >= 0
      integer, intent(in) :: most
      integer, allocatable :: kept(:)
      real(wp) :: lowest, highest, middle
      integer :: h, step

      if (size(values) <= most) then
         kept = [(h, h=1, size(values))]
         return
      end if
      lowest = -1.0_wp
      highest = maxval(values)
      do step = 1, 100                                                ! halves the interval down to rounding
         middle = 0.5_wp*(lowest + highest)
         if (count(values > middle) > most) then
            lowest = middle
         else
            highest = middle
         end if
      end do
      kept = pack([(h, h=1, size(values))], values > highest)
   end function strongest

   !> The tangent between the chosen harmonics, term by term as in hb_balance_tangent, and its factors.
   subroutine fill_coupled(self)
      type(balance_t), intent(inout) :: self
      real(wp), allocatable :: block(:, :), cosine(:), sine(:)
      type(error_t), allocatable :: error
      integer :: h, i, k

      call self%transform%prepare_products(self%table, n_parts, error)
      if (allocated(error)) then                                      ! out of memory: each harmonic by itself will have to do
         deallocate (self%coupled)
         return
      end if
      associate (coupled => self%coupled, set => self%coupled%set, pattern => self%stiffness%pattern)
         allocate (block(set%n_coefficients, set%n_coefficients), cosine(set%n_coefficients), sine(set%n_coefficients))
         call coupled%clear()
         do k = 1, self%n_dofs
            do i = pattern%first(k), pattern%last(k)
               block = 0.0_wp
               do h = 1, set%n_harmonics
                  call add_linear(h, self%stiffness%condensed(pattern%shift(k) + i, k, coupled%kept(h)))
                  if (i == k .and. self%is_singular(coupled%kept(h))) &
                     call add_linear(h, cmplx((1.0_wp - self%law_factor)*self%support(i), kind=wp))
               end do
               call coupled%add(i, k, block)
            end do
         end do
         do i = 1, self%law_set%jacobian%n_pairs
            associate (jacobian => self%law_set%jacobian, row => self%law_set%jacobian%row(i), &
                       column => self%law_set%jacobian%column(i))
               call self%transform%tabulate_product(jacobian%df_dq%values, i, self%table, by_motion, self%law_factor)
               do h = 1, set%n_harmonics
                  call find_columns(h)
                  block(:, set%cos_at(h)) = cosine
                  if (set%sin_at(h) > 0) block(:, set%sin_at(h)) = sine
               end do
               if (self%law_set%needs_velocity) then
                  call self%transform%tabulate_product(jacobian%df_dv%values, i, self%table, by_motion, self%law_factor)
                  do h = merge(2, 1, set%has_zero), set%n_harmonics
                     call find_columns(h)
                     associate (w => self%frequencies(coupled%kept(h)))
                        block(:, set%cos_at(h)) = block(:, set%cos_at(h)) - w*sine
                        block(:, set%sin_at(h)) = block(:, set%sin_at(h)) + w*cosine
                     end associate
                  end do
               end if
               call coupled%add(row, column, block)
               if (.not. self%law_set%needs_reaction) cycle
               call self%transform%tabulate_product(jacobian%df_ds%values, i, self%table, by_motion, self%law_factor)
               do k = pattern%first(column), pattern%last(column)
                  do h = 1, set%n_harmonics
                     call find_columns(h)
                     associate (s => self%stiffness%condensed(pattern%shift(k) + column, k, coupled%kept(h)))
                        block(:, set%cos_at(h)) = aimag(s)*sine - real(s)*cosine
                        if (set%sin_at(h) > 0) block(:, set%sin_at(h)) = -aimag(s)*cosine - real(s)*sine
                     end associate
                  end do
                  call coupled%add(row, k, block)
               end do
            end associate
         end do
         if (self%law_set%kinks%are_met()) call add_kinks()
         call coupled%factorise()
      end associate

   contains

      subroutine add_kinks()
         logical :: is_any
         integer :: a, b, line, part
         real(wp) :: angle(self%harmonics%n_harmonics)

         do line = 1, size(self%law_set%kinks%lines)
            do part = 1, self%law_set%kinks%grid%n_parts
               call self%tabulate_kinks(line, part, angle, is_any)
               if (.not. is_any) cycle
               do h = 1, self%coupled%set%n_harmonics
                  call find_columns(h)
                  associate (set => self%coupled%set, ahead => angle(self%coupled%kept(h)))
                     block(:, set%cos_at(h)) = cos(ahead)*cosine - sin(ahead)*sine
                     if (set%sin_at(h) > 0) block(:, set%sin_at(h)) = cos(ahead)*sine + sin(ahead)*cosine
                  end associate
               end do
               associate (columns => self%law_set%kinks%lines(line)%columns, force => self%law_set%kinks%lines(line)%force, &
                          motion => self%law_set%kinks%lines(line)%motion)
                  do b = 1, size(columns)
                     do a = 1, size(columns)
                        if (force(a)*motion(b) /= 0.0_wp) call self%coupled%add(columns(a), columns(b), force(a)*motion(b)*block)
                     end do
                  end do
               end associate
            end do
         end do
      end subroutine add_kinks

      subroutine find_columns(h)
         integer, intent(in) :: h                                     ! within those chosen

         associate (kept => self%coupled%kept)
            call self%table%columns_among(by_motion, self%coupled%set, self%table%offset(kept), self%table%offset(kept(h)), &
                                          cosine, sine)
         end associate
      end subroutine find_columns

      subroutine add_linear(h, s)
         integer, intent(in) :: h
         complex(wp), intent(in) :: s

         associate (a => self%coupled%set%cos_at(h), b => self%coupled%set%sin_at(h))
            block(a, a) = block(a, a) + real(s)
            if (b == 0) return
            block(a, b) = block(a, b) + aimag(s)
            block(b, a) = block(b, a) - aimag(s)
            block(b, b) = block(b, b) + real(s)
         end associate
      end subroutine add_linear
   end subroutine fill_coupled

   module subroutine balance_precondition(self, r, step)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: r(:)
      real(wp), intent(out), contiguous :: step(:)

      call precondition_of(self, r, step)
   end subroutine balance_precondition

   !> Each harmonic by itself, then those that are coupled.
   subroutine precondition_of(self, r, step)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: r(self%harmonics%n_coefficients, self%n_dofs)
      real(wp), intent(out) :: step(self%harmonics%n_coefficients, self%n_dofs)

      call self%alone%solve_harmonics(self%harmonics, r, step)
      if (.not. allocated(self%coupled)) return
      if (self%coupled%is_usable) call self%coupled%solve(self%harmonics, r, step)
   end subroutine precondition_of

   !> Solves with the tangent at u of each harmonic by itself, (1 - mean df/ds) S + mean df/dq + i w mean df/dv: what couples
   !> the harmonics is left out.
   module subroutine balance_solve_mean_tangent(self, u, r, step, error)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)    !! [m]
      real(wp), intent(in) :: r(self%harmonics%n_coefficients, self%n_dofs)    !! [N]
      real(wp), intent(out) :: step(self%harmonics%n_coefficients, self%n_dofs)
      type(error_t), allocatable, intent(out) :: error
      real(wp), dimension(self%n_dofs, self%n_dofs) :: df_dq, df_dv, df_ds

      call self%sample(u)
      call self%law_set%differentiate(error)
      if (allocated(error)) return
      call self%law_set%mean_slopes(df_dq, df_dv, df_ds)
      step = 0.0_wp
      call add_response(self, df_dq, df_dv, df_ds, r, step)
   end subroutine balance_solve_mean_tangent

   !> Answers that each harmonic by itself gives to forces, with the mean slopes of the laws while contacts are closed to what acts
   !> then, and with those while they are open to what acts then: a stop that is touched for a hundredth of the time does not hold
   !> back what moves freely for the rest, however stiff it is. Where no contact comes and goes this is `solve_mean_tangent`.
   module subroutine balance_mean_response(self, u, r, step, error)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)    !! [m]
      real(wp), intent(in) :: r(self%harmonics%n_coefficients, self%n_dofs)    !! [N]
      real(wp), intent(out) :: step(self%harmonics%n_coefficients, self%n_dofs)
      type(error_t), allocatable, intent(out) :: error
      real(wp), dimension(self%n_dofs, self%n_dofs, 2) :: df_dq, df_dv, df_ds  ! open, closed
      real(wp) :: held_forces(size(r, 1), size(r, 2))
      logical, allocatable :: is_held(:)
      integer :: i

      call self%sample(u)
      call self%law_set%differentiate(error)
      if (allocated(error)) return
      is_held = self%law_set%jacobian%held()
      step = 0.0_wp
      if (.not. any(is_held)) then
         call self%law_set%mean_slopes(df_dq(:, :, 1), df_dv(:, :, 1), df_ds(:, :, 1))
         call add_response(self, df_dq(:, :, 1), df_dv(:, :, 1), df_ds(:, :, 1), r, step)
         return
      end if
      call self%law_set%mean_slopes(df_dq(:, :, 1), df_dv(:, :, 1), df_ds(:, :, 1), .not. is_held)
      call self%law_set%mean_slopes(df_dq(:, :, 2), df_dv(:, :, 2), df_ds(:, :, 2), is_held)
      self%has_samples = .false.
      associate (forces => self%law_set%samples%q%values)             ! the motion has told its slopes
         call self%transform%to_samples(r, forces)
         do i = 1, self%n_dofs
            where (.not. is_held) forces(:, i) = 0.0_wp
         end do
         call self%project(forces, held_forces)
      end associate
      call add_response(self, df_dq(:, :, 1), df_dv(:, :, 1), df_ds(:, :, 1), r - held_forces, step)
      call add_response(self, df_dq(:, :, 2), df_dv(:, :, 2), df_ds(:, :, 2), held_forces, step)
   end subroutine balance_mean_response

   !> Adds the answers of all harmonics to forces, with slopes of the laws that are the same at all times.
   subroutine add_response(self, df_dq, df_dv, df_ds, r, step)
      type(balance_t), intent(in) :: self
      real(wp), intent(in) :: df_dq(:, :), df_dv(:, :), df_ds(:, :)   !! (n_dofs, n_dofs)
      real(wp), intent(in) :: r(:, :)                                 !! [N], (n_coefficients, n_dofs)
      real(wp), intent(inout) :: step(:, :)                           !! [m], as r
      complex(wp) :: block(self%tangent_pattern%n_rows, self%n_dofs), c(self%n_dofs)
      type(block_factors_t) :: factors
      logical :: is_singular
      integer :: h, i

      call new_block_factors(factors, self%tangent_pattern, 1)
      do h = 1, self%harmonics%n_harmonics
         call self%mean_tangent(h, df_dq, df_dv, df_ds, block)
         call factors%factorise(1, block, is_singular)
         if (is_singular) cycle
         do i = 1, self%n_dofs
            c(i) = self%harmonics%amplitude(r(:, i), h)
         end do
         call factors%solve(1, c)
         do i = 1, self%n_dofs
            call self%harmonics%set_amplitude(step(:, i), h, self%harmonics%amplitude(step(:, i), h) + c(i))
         end do
      end do
   end subroutine add_response

   !> Means over the torus of the derivatives of all forces by motion and rate, at a motion. Reactions are left out.
   module subroutine balance_mean_slopes(self, u, df_dq, df_dv, error)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)
      real(wp), intent(out) :: df_dq(:, :)
      real(wp), intent(out) :: df_dv(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: df_ds(self%n_dofs, self%n_dofs)

      call self%sample(u)
      call self%law_set%differentiate(error)
      if (.not. allocated(error)) call self%law_set%mean_slopes(df_dq, df_dv, df_ds)
   end subroutine balance_mean_slopes

   !> The tangent of harmonic h by itself, from mean slopes.
   module subroutine balance_mean_tangent(self, h, df_dq, df_dv, df_ds, block)
      class(balance_t), intent(in) :: self
      integer, intent(in) :: h
      real(wp), intent(in) :: df_dq(:, :), df_dv(:, :), df_ds(:, :)
      complex(wp), intent(out) :: block(:, :)
      integer :: i, k, m

      associate (own => self%tangent_pattern, linear => self%stiffness%pattern)
         block = (0.0_wp, 0.0_wp)
         do k = 1, self%n_dofs
            do m = linear%first(k), linear%last(k)
               associate (s => self%stiffness%condensed(linear%shift(k) + m, k, h), at => own%shift(k))
                  block(at + m, k) = block(at + m, k) + s
                  if (.not. self%law_set%needs_reaction) cycle
                  do i = max(own%first(m), own%first(k)), min(own%last(m), own%last(k))
                     block(at + i, k) = block(at + i, k) - df_ds(i, m)*s
                  end do
               end associate
            end do
            do i = own%first(k), own%last(k)
               block(own%shift(k) + i, k) = block(own%shift(k) + i, k) + cmplx(df_dq(i, k), self%frequencies(h)*df_dv(i, k), wp)
            end do
            if (self%is_singular(h)) block(own%shift(k) + k, k) = block(own%shift(k) + k, k) &
                                                                  + (1.0_wp - self%law_factor)*self%support(k)
         end do
      end associate
   end subroutine balance_mean_tangent
end submodule hb_balance_precondition
