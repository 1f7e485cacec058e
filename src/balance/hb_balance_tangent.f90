!> The dense tangent of the balance.
!>
!> Source: docs/user/theory.md, section 5.4.
submodule (hb_balance) hb_balance_tangent
   use hb_law_response, only: find_response, responding_dofs
   use hb_memory_tangent, only: width
   implicit none

contains

   module subroutine balance_tangent(self, x, jacobian)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(out), contiguous :: jacobian(:, :)

      call balance_tangent_of(self, x, jacobian)
   end subroutine balance_tangent

   !> J = S + T[df/dq] + T[df/dv] d/dt - T[df/ds] S, with T[g] the projection of multiplication by g.
   !> Source: docs/user/theory.md, eq. (11) to (13).
   subroutine balance_tangent_of(self, u, jacobian)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)
      real(wp), intent(out) :: jacobian(self%harmonics%n_coefficients, self%n_dofs, &
                                        self%harmonics%n_coefficients, self%n_dofs)
      type(error_t), allocatable :: error
      logical :: is_filled(self%n_dofs, self%n_dofs)
      integer :: h, i, k

      call self%sample_if_new(u)
      call self%law_set%differentiate(error)
      if (.not. allocated(error)) call self%transform%prepare_products(self%table, n_parts, error)
      if (allocated(error)) then                                      ! out of memory: no tangent, the solver sees it
         jacobian = 0.0_wp
         return
      end if
      is_filled = .false.                                             ! by the products of a pair, before anything is added
      if (self%n_dofs == 1 .or. .not. self%law_set%needs_reaction) then
         do i = 1, self%law_set%jacobian%n_pairs
            is_filled(self%law_set%jacobian%row(i), self%law_set%jacobian%column(i)) = .true.
         end do
      end if
      do k = 1, self%n_dofs
         do i = 1, self%n_dofs
            if (.not. is_filled(i, k)) jacobian(:, i, :, k) = 0.0_wp
         end do
      end do
      do i = 1, self%law_set%jacobian%n_pairs
         associate (row => self%law_set%jacobian%row(i), column => self%law_set%jacobian%column(i))
            call self%transform%tabulate_product(self%law_set%jacobian%df_dq%values, i, self%table, by_motion, self%law_factor)
            if (self%law_set%needs_velocity) &
               call self%transform%tabulate_product(self%law_set%jacobian%df_dv%values, i, self%table, by_rate, self%law_factor)
            if (self%law_set%needs_reaction) &
               call self%transform%tabulate_product(self%law_set%jacobian%df_ds%values, i, self%table, by_reaction, self%law_factor)
            call put_products(self, row, column, is_filled(row, column), jacobian)
         end associate
      end do
      do k = 1, self%n_dofs
         do h = 1, self%harmonics%n_harmonics
            do i = self%stiffness%pattern%first(k), self%stiffness%pattern%last(k)
               call add_linear(self, jacobian, h, i, k)
            end do
            if (self%is_singular(h)) call add_support(h, k)
         end do
      end do
      if (self%law_set%kinks%are_met()) call add_kinks(self, jacobian)
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

   !> Adds how forces corrected between samples answer to the motion at neighbours.
   subroutine add_kinks(self, jacobian)
      type(balance_t), intent(inout) :: self
      real(wp), intent(inout), contiguous :: jacobian(:, :, :, :)
      logical :: is_any
      integer :: a, b, h, i, part
      real(wp) :: angle(self%harmonics%n_harmonics), weight

      do i = 1, size(self%law_set%kinks%lines)
         do part = 1, self%law_set%kinks%grid%n_parts
            call self%tabulate_kinks(i, part, angle, is_any)
            if (.not. is_any) cycle
            associate (line => self%law_set%kinks%lines(i))
               do b = 1, size(line%columns)
                  do a = 1, size(line%columns)
                     weight = line%force(a)*line%motion(b)
                     if (weight == 0.0_wp) cycle
                     do h = 1, self%harmonics%n_harmonics
                        call add(h, weight*cos(angle(h)), -weight*sin(angle(h)), line%columns(a), line%columns(b))
                     end do
                  end do
               end do
            end associate
         end do
      end do

   contains

      subroutine add(h, cosine, sine, row, column)
         integer, intent(in) :: h, row, column
         real(wp), intent(in) :: cosine, sine

         associate (set => self%harmonics)
            if (set%sin_at(h) == 0) then
               call self%table%add_columns(by_motion, set, h, cosine, sine, jacobian(:, row, set%cos_at(h), column), &
                                           self%columns(:, 1))
            else
               call self%table%add_columns(by_motion, set, h, cosine, sine, jacobian(:, row, set%cos_at(h), column), &
                                           jacobian(:, row, set%sin_at(h), column))
            end if
         end associate
      end subroutine add
   end subroutine add_kinks

   !> Adds how the forces with memory respond to each coefficient: through coordinate b of a law, cos or sin of harmonic h of
   !> the degree of freedom k moves it by shape(k, b) times that of the coordinate.
   subroutine add_memory(self, jacobian)
      type(balance_t), intent(inout) :: self
      real(wp), intent(inout) :: jacobian(:, :, :, :)
      integer, allocatable :: responding(:)
      logical :: has_line
      integer :: b, block, h, i, in_block, k, law, part, place

      do law = 1, size(self%law_set%sampled)
         if (.not. allocated(self%law_set%sampled(law)%hysteresis)) cycle
         associate (laws => self%law_set, hysteresis => self%law_set%sampled(law)%hysteresis, &
                    moved => self%law_set%sampled(law)%columns, shape => self%law_set%sampled(law)%law%shape)
            responding = responding_dofs(laws%sampled, law, self%n_dofs)
            has_line = .false.
            if (.not. laws%needs_reaction) &                          ! no multiplier law may pass the response on
               call hysteresis%prepare_line(laws%characteristic, self%harmonics, self%frequencies, has_line)
            if (has_line) then
               call add_line(self, law, jacobian)
               cycle
            end if
            call hysteresis%prepare_response(laws%characteristic, self%harmonics, self%transform%torus, self%frequencies)
            do b = 1, size(shape, 2)
               h = 0
               do block = 1, hysteresis%n_blocks()
                  if (associated(self%watch)) then
                     if (self%watch%is_over()) return                 ! whoever asked for the tangent ends too
                  end if
                  call hysteresis%find_block_response(laws%characteristic, b, block)
                  do in_block = 1, min(width, self%harmonics%n_harmonics - h)
                     h = h + 1
                     do part = 1, 2
                        place = merge(self%harmonics%cos_at(h), self%harmonics%sin_at(h), part == 1)
                        if (place == 0) cycle
                        do i = 1, size(responding)
                           call find_response(laws%sampled, law, in_block, part, responding(i), self%answer%values(:, 1))
                           call self%transform%to_coefficients_of_one(self%answer%values, self%columns(:, 1))
                           do k = 1, size(moved)
                              jacobian(:, responding(i), place, moved(k)) = jacobian(:, responding(i), place, moved(k)) &
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

   !> Adds the response of one law under one tone: for each pair of its coordinates T[g], and for each time that a slider sticks
   !> the projection of the samples while it does so times the row of the motion where it was pushed last.
   subroutine add_line(self, law, jacobian)
      type(balance_t), intent(inout) :: self
      integer, intent(in) :: law
      real(wp), intent(inout) :: jacobian(:, :, :, :)
      complex(wp), allocatable :: stuck(:, :), pushed(:, :)
      real(wp) :: answer(self%harmonics%n_coefficients, self%harmonics%n_coefficients)
      real(wp), dimension(self%harmonics%n_coefficients) :: column, row
      integer :: a, b, i, k, run

      associate (columns => self%law_set%laws(law)%law%dofs, shape => self%law_set%laws(law)%law%shape)
         do b = 1, size(shape, 2)
            do a = 1, size(shape, 2)
               call self%law_set%sampled(law)%hysteresis%find_line(self%law_set%characteristic, a, b, &
                                                                   self%answer%values(:, 1), stuck, pushed)
               answer = 0.0_wp
               call self%transform%tabulate_product(self%answer%values, 1, self%table, by_motion, 1.0_wp)
               call add_motion(self, answer)
               do run = 1, size(stuck, 2)
                  column = projection(stuck(:, run))
                  row = as_row(pushed(:, run))
                  do i = 1, size(row)
                     answer(:, i) = answer(:, i) + row(i)*column
                  end do
               end do
               do k = 1, size(columns)
                  do i = 1, size(columns)
                     jacobian(:, columns(i), :, columns(k)) = jacobian(:, columns(i), :, columns(k)) &
                                                              + self%law_factor*shape(i, a)*shape(k, b)*answer
                  end do
               end do
            end do
         end do
      end associate

   contains

      !> Coefficients of a function from its sums with exp(i j.tau) over the samples.
      pure function projection(sums) result(x)
         complex(wp), intent(in) :: sums(:)
         real(wp) :: x(self%harmonics%n_coefficients)
         integer :: h

         associate (set => self%harmonics, weight => 2.0_wp/self%transform%torus%n_total)
            do h = 1, set%n_harmonics
               if (set%sin_at(h) == 0) then
                  x(set%cos_at(h)) = 0.5_wp*weight*real(sums(h))
               else
                  x(set%cos_at(h)) = weight*real(sums(h))
                  x(set%sin_at(h)) = weight*aimag(sums(h))
               end if
            end do
         end associate
      end function projection

      !> What exp(i j.tau) of all harmonics is worth for cosines (real parts) and sines.
      pure function as_row(waves) result(x)
         complex(wp), intent(in) :: waves(:)
         real(wp) :: x(self%harmonics%n_coefficients)
         integer :: h

         do h = 1, self%harmonics%n_harmonics
            x(self%harmonics%cos_at(h)) = real(waves(h))
            if (self%harmonics%sin_at(h) > 0) x(self%harmonics%sin_at(h)) = aimag(waves(h))
         end do
      end function as_row
   end subroutine add_line

   !> Block of S for harmonic h: (S c) = (Re S a + Im S b) - i (Re S b - Im S a).
   pure subroutine add_linear(self, jacobian, h, i, k)
      type(balance_t), intent(in) :: self
      real(wp), intent(inout) :: jacobian(:, :, :, :)
      integer, intent(in) :: h, i, k

      associate (s => self%stiffness%condensed(self%stiffness%pattern%shift(k) + i, k, h), &
                 a => self%harmonics%cos_at(h), b => self%harmonics%sin_at(h))
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
            call self%table%columns(by_motion, set, h, self%columns(:, 1), self%columns(:, 2))
            block(:, set%cos_at(h)) = block(:, set%cos_at(h)) + self%columns(:, 1)
            if (set%sin_at(h) > 0) block(:, set%sin_at(h)) = block(:, set%sin_at(h)) + self%columns(:, 2)
         end do
      end associate
   end subroutine add_motion

   !> T[df/dq] + T[df/dv] d/dt into block (row, column), and -T[df/ds] S(column, k) into block (row, k), column by column while
   !> these are in the cache: the rate of cos is -frequency sin, that of sin is frequency cos.
   subroutine put_products(self, row, column, is_first, jacobian)
      type(balance_t), intent(inout) :: self
      integer, intent(in) :: row, column
      logical, intent(in) :: is_first                                 !! to touch block (row, column): nothing stands there yet
      real(wp), intent(inout), contiguous :: jacobian(:, :, :, :)
      integer :: h, k

      associate (set => self%harmonics, pattern => self%stiffness%pattern)
         do h = 1, set%n_harmonics
            if (set%sin_at(h) == 0) then                              ! a column to spare takes what has no place
               call put(jacobian(:, row, set%cos_at(h), column), self%columns(:, 1))
            else
               call put(jacobian(:, row, set%cos_at(h), column), jacobian(:, row, set%sin_at(h), column))
            end if
            if (.not. self%law_set%needs_reaction) cycle
            do k = pattern%first(column), pattern%last(column)
               if (set%sin_at(h) == 0) then
                  call add_reaction(k, jacobian(:, row, set%cos_at(h), k), self%columns(:, 1))
               else
                  call add_reaction(k, jacobian(:, row, set%cos_at(h), k), jacobian(:, row, set%sin_at(h), k))
               end if
            end do
         end do
      end associate

   contains

      subroutine put(cosine_column, sine_column)
         real(wp), intent(inout), contiguous :: cosine_column(:), sine_column(:)

         associate (set => self%harmonics, table => self%table)
            if (is_first) then
               call table%columns(by_motion, set, h, cosine_column, sine_column)
            else
               call table%add_columns(by_motion, set, h, 1.0_wp, 0.0_wp, cosine_column, sine_column)
            end if
            if (self%law_set%needs_velocity) &
               call table%add_columns(by_rate, set, h, 0.0_wp, -self%frequencies(h), cosine_column, sine_column)
         end associate
      end subroutine put

      subroutine add_reaction(k, cosine_column, sine_column)
         integer, intent(in) :: k
         real(wp), intent(inout), contiguous :: cosine_column(:), sine_column(:)

         associate (s => self%stiffness%condensed(self%stiffness%pattern%shift(k) + column, k, h))
            call self%table%add_columns(by_reaction, self%harmonics, h, -real(s), aimag(s), cosine_column, sine_column)
         end associate
      end subroutine add_reaction
   end subroutine put_products
end submodule hb_balance_tangent
