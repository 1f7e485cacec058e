!> The dense tangent of the balance, J = S + T[df/dq] + T[df/dv] d/dt - T[df/ds] S, with T[g] the projection of multiplication by g.
!>
!> Source: docs/why/theory.md, section 5.4, eq. (11) to (13).
module hb_dense_tangent
   use hb_cancellation, only: work_is_over
   use hb_error, only: error_t
   use hb_fftw, only: new_real_block, real_block_t
   use hb_hysteresis_tangent, only: block_width
   use hb_kinds, only: wp
   use hb_linear_part, only: linear_part_t
   use hb_memory_response, only: find_response, responding_dofs
   use hb_projected_laws, only: part_of, projected_laws_t, slope
   use hb_threads, only: this_thread
   implicit none
   private
   public :: dense_tangent_t

   !> Owner of external resources: call `destroy`.
   type :: dense_tangent_t
      real(wp), allocatable, private :: columns(:, :, :)              ! (n_coefficients, 2, n_lanes) of a product
      type(real_block_t), private :: response                         ! (n_samples, 1) of a law with memory
   contains
      procedure :: assemble => dense_tangent_assemble
      procedure :: destroy => dense_tangent_destroy
   end type dense_tangent_t

contains

   !> Computes the tangent at the motion along which the laws were differentiated. Fails out of memory.
   subroutine dense_tangent_assemble(self, linear, laws, frequencies, jacobian, error)
      class(dense_tangent_t), intent(inout) :: self
      type(linear_part_t), intent(in) :: linear
      type(projected_laws_t), intent(inout) :: laws                   !! differentiated
      real(wp), intent(in) :: frequencies(:)                          !! j.omega [rad/s], (n_harmonics)
      real(wp), intent(out), contiguous :: jacobian(:, :, :, :)       !! [N/m], (n_coefficients, n_dofs, n_coefficients, n_dofs)
      type(error_t), allocatable, intent(out) :: error
      logical :: is_filled(laws%n_dofs, laws%n_dofs)
      integer :: h, i, k

      call allocate_work(self, laws, error)
      if (allocated(error)) return
      is_filled = .false.                                             ! by the products of a pair, before anything is added
      associate (pairs => laws%jacobian)
         if (laws%n_dofs == 1 .or. .not. laws%needs_reaction) then
            do i = 1, pairs%n_pairs
               is_filled(pairs%row(i), pairs%column(i)) = .true.
            end do
         end if
         do k = 1, laws%n_dofs
            do i = 1, laws%n_dofs
               if (.not. is_filled(i, k)) jacobian(:, i, :, k) = 0.0_wp
            end do
         end do
         if (laws%n_lanes == 1) then
            do i = 1, pairs%n_pairs
               call laws%tabulate(i, 1)
               call store_products(self, linear, laws, frequencies, i, 1, is_filled(pairs%row(i), pairs%column(i)), jacobian)
            end do
         else                                                         ! a row is written by one thread
            !$omp parallel do num_threads(laws%n_lanes) schedule(dynamic) private(i)
            do k = 1, laws%n_dofs
               do i = pairs%first(k), pairs%first(k + 1) - 1
                  call laws%tabulate(pairs%order(i), this_thread())
                  call store_products(self, linear, laws, frequencies, pairs%order(i), this_thread(), &
                                    is_filled(k, pairs%column(pairs%order(i))), jacobian)
               end do
            end do
         end if
      end associate
      do k = 1, laws%n_dofs
         do h = 1, size(frequencies)
            do i = linear%pattern%first(k), linear%pattern%last(k)
               call add_linear(laws, linear%entry(i, k, h), h, i, k, jacobian)
            end do
            if (linear%is_singular(h)) call add_linear(laws, cmplx(linear%support_in(k, h), kind=wp), h, k, k, jacobian)
         end do
      end do
      if (laws%kinks%are_met()) call add_kinks(self, laws, jacobian)
      if (laws%has_memory) call add_memory(self, laws, frequencies, jacobian)
   end subroutine dense_tangent_assemble

   !> Allocates memory for products at their first use.
   subroutine allocate_work(self, laws, error)
      type(dense_tangent_t), intent(inout) :: self
      type(projected_laws_t), intent(inout) :: laws
      type(error_t), allocatable, intent(out) :: error

      call laws%prepare_products(error)
      if (allocated(error)) return
      if (.not. allocated(self%columns)) &
         allocate (self%columns(laws%transform%harmonics%n_coefficients, 2, laws%n_lanes), source=0.0_wp)
      if (laws%has_memory .and. .not. associated(self%response%values)) &
         call new_real_block(self%response, laws%transform%torus%n_total, 1, error)
   end subroutine allocate_work

   !> Adds the response of forces corrected between samples to the motion at neighbours.
   subroutine add_kinks(self, laws, jacobian)
      type(dense_tangent_t), intent(inout) :: self
      type(projected_laws_t), intent(inout) :: laws
      real(wp), intent(inout), contiguous :: jacobian(:, :, :, :)
      logical :: is_any
      integer :: a, b, h, i, part
      real(wp) :: angle(laws%transform%harmonics%n_harmonics), weight

      do i = 1, size(laws%kinks%lines)
         do part = 1, laws%kinks%grid%n_parts
            call laws%tabulate_kinks(i, part, angle, is_any)
            if (.not. is_any) cycle
            associate (line => laws%kinks%lines(i))
               do b = 1, size(line%columns)
                  do a = 1, size(line%columns)
                     weight = line%force(a)*line%motion(b)
                     if (weight == 0.0_wp) cycle
                     do h = 1, laws%transform%harmonics%n_harmonics
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

         associate (set => laws%transform%harmonics)
            if (set%sin_at(h) == 0) then
               call laws%table%add_columns(slope%by_motion, set, h, cosine, sine, jacobian(:, row, set%cos_at(h), column), &
                                           self%columns(:, 1, 1))
            else
               call laws%table%add_columns(slope%by_motion, set, h, cosine, sine, jacobian(:, row, set%cos_at(h), column), &
                                           jacobian(:, row, set%sin_at(h), column))
            end if
         end associate
      end subroutine add
   end subroutine add_kinks

   !> Adds the response of the forces with memory to each coefficient: through coordinate b of a law, cos or sin of
   !> harmonic h of degree of freedom k moves it by shape(k, b) times that of the coordinate.
   subroutine add_memory(self, laws, frequencies, jacobian)
      type(dense_tangent_t), intent(inout) :: self
      type(projected_laws_t), intent(inout) :: laws
      real(wp), intent(in) :: frequencies(:)
      real(wp), intent(inout) :: jacobian(:, :, :, :)
      integer, allocatable :: responding(:)
      logical :: has_line
      integer :: b, block, h, i, in_block, k, law, part, position

      do law = 1, size(laws%sampled)
         if (.not. allocated(laws%sampled(law)%hysteresis)) cycle
         associate (hysteresis => laws%sampled(law)%hysteresis, &
                    moved => laws%sampled(law)%columns, shape => laws%sampled(law)%law%shape)
            responding = responding_dofs(laws%sampled, law, laws%n_dofs)
            has_line = .false.
            if (.not. laws%needs_reaction) &                          ! no multiplier law may pass on the response
               call hysteresis%prepare_line(laws%characteristic, laws%transform%harmonics, frequencies, has_line)
            if (has_line) then
               call add_line(self, laws, law, jacobian)
               cycle
            end if
            call hysteresis%prepare_response(laws%characteristic, laws%transform%harmonics, laws%transform%torus, frequencies)
            do b = 1, size(shape, 2)
               h = 0
               do block = 1, hysteresis%n_blocks()
                  if (work_is_over()) return                         ! the solver ends too
                  call hysteresis%find_block_response(laws%characteristic, b, block)
                  do in_block = 1, min(block_width, laws%transform%harmonics%n_harmonics - h)
                     h = h + 1
                     do part = 1, 2
                        position = merge(laws%transform%harmonics%cos_at(h), laws%transform%harmonics%sin_at(h), part == 1)
                        if (position == 0) cycle
                        do i = 1, size(responding)
                           call find_response(laws%sampled, law, in_block, part, responding(i), self%response%values(:, 1))
                           call laws%transform%to_coefficients_of_one(self%response%values, self%columns(:, 1, 1))
                           do k = 1, size(moved)
                              jacobian(:, responding(i), position, moved(k)) = jacobian(:, responding(i), position, moved(k)) &
                                                                            + laws%factor*shape(k, b)*self%columns(:, 1, 1)
                           end do
                        end do
                     end do
                  end do
               end do
            end do
         end associate
      end do
   end subroutine add_memory

   !> Adds the response of one law under one tone: for each pair of its coordinates T[g], and for each interval in
   !> which a slider sticks the projection of these samples times the row of the motion where it was moved last.
   subroutine add_line(self, laws, law, jacobian)
      type(dense_tangent_t), intent(inout) :: self
      type(projected_laws_t), intent(inout) :: laws
      integer, intent(in) :: law
      real(wp), intent(inout) :: jacobian(:, :, :, :)
      complex(wp), allocatable :: stuck(:, :), pushed(:, :)
      real(wp) :: response(size(jacobian, 1), size(jacobian, 1)), column(size(jacobian, 1)), row(size(jacobian, 1))
      integer :: a, b, i, k, run

      associate (columns => laws%laws(law)%law%dofs, shape => laws%laws(law)%law%shape)
         do b = 1, size(shape, 2)
            do a = 1, size(shape, 2)
               call laws%sampled(law)%hysteresis%find_line(laws%characteristic, a, b, self%response%values(:, 1), &
                                                             stuck, pushed)
               response = 0.0_wp
               call laws%transform%tabulate_product(self%response%values, 1, laws%table, slope%by_motion, 1.0_wp)
               call add_motion(self, laws, response)
               do run = 1, size(stuck, 2)
                  column = projection(stuck(:, run))
                  row = as_row(pushed(:, run))
                  do i = 1, size(row)
                     response(:, i) = response(:, i) + row(i)*column
                  end do
               end do
               do k = 1, size(columns)
                  do i = 1, size(columns)
                     jacobian(:, columns(i), :, columns(k)) = jacobian(:, columns(i), :, columns(k)) &
                                                              + laws%factor*shape(i, a)*shape(k, b)*response
                  end do
               end do
            end do
         end do
      end associate

   contains

      !> Coefficients of a function from its sums with exp(i j.tau) over the samples.
      pure function projection(sums) result(x)
         complex(wp), intent(in) :: sums(:)
         real(wp) :: x(laws%transform%harmonics%n_coefficients)
         integer :: h

         associate (set => laws%transform%harmonics, weight => 2.0_wp/laws%transform%torus%n_total)
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

      !> Row of exp(i j.tau) of all harmonics for cosines (real parts) and sines.
      pure function as_row(waves) result(x)
         complex(wp), intent(in) :: waves(:)
         real(wp) :: x(laws%transform%harmonics%n_coefficients)
         integer :: h

         associate (set => laws%transform%harmonics)
            do h = 1, set%n_harmonics
               x(set%cos_at(h)) = real(waves(h))
               if (set%sin_at(h) > 0) x(set%sin_at(h)) = aimag(waves(h))
            end do
         end associate
      end function as_row
   end subroutine add_line

   !> Adds the block s of one harmonic: (s c) = (Re s a + Im s b) - i (Re s b - Im s a).
   pure subroutine add_linear(laws, s, h, i, k, jacobian)
      type(projected_laws_t), intent(in) :: laws
      complex(wp), intent(in) :: s                                    !! [N/m]
      integer, intent(in) :: h, i, k
      real(wp), intent(inout) :: jacobian(:, :, :, :)

      associate (a => laws%transform%harmonics%cos_at(h), b => laws%transform%harmonics%sin_at(h))
         jacobian(a, i, a, k) = jacobian(a, i, a, k) + real(s)
         if (b == 0) return
         jacobian(a, i, b, k) = jacobian(a, i, b, k) + aimag(s)
         jacobian(b, i, a, k) = jacobian(b, i, a, k) - aimag(s)
         jacobian(b, i, b, k) = jacobian(b, i, b, k) + real(s)
      end associate
   end subroutine add_linear

   !> block += T[g]
   subroutine add_motion(self, laws, block)
      type(dense_tangent_t), intent(inout) :: self
      type(projected_laws_t), intent(in) :: laws
      real(wp), intent(inout) :: block(:, :)
      integer :: h

      associate (set => laws%transform%harmonics)
         do h = 1, set%n_harmonics
            call laws%table%columns(slope%by_motion, set, h, self%columns(:, 1, 1), self%columns(:, 2, 1))
            block(:, set%cos_at(h)) = block(:, set%cos_at(h)) + self%columns(:, 1, 1)
            if (set%sin_at(h) > 0) block(:, set%sin_at(h)) = block(:, set%sin_at(h)) + self%columns(:, 2, 1)
         end do
      end associate
   end subroutine add_motion

   !> T[df/dq] + T[df/dv] d/dt into block (row, column), and -T[df/ds] S(column, k) into block (row, k), column by column while
   !> these are in the cache: the rate of cos is -frequency sin, that of sin is frequency cos.
   subroutine store_products(self, linear, laws, frequencies, pair, lane, is_first, jacobian)
      type(dense_tangent_t), intent(inout) :: self
      type(linear_part_t), intent(in) :: linear
      type(projected_laws_t), intent(in) :: laws
      real(wp), intent(in) :: frequencies(:)
      integer, intent(in) :: pair                                     !! tabulated, at (row, column)
      integer, intent(in) :: lane                                     !! in whose parts of the table
      logical, intent(in) :: is_first !! first access of block (row, column), which is undefined before
      real(wp), intent(inout), contiguous :: jacobian(:, :, :, :)
      integer :: h, k

      associate (set => laws%transform%harmonics, pattern => linear%pattern, row => laws%jacobian%row(pair), &
                 column => laws%jacobian%column(pair))
         do h = 1, set%n_harmonics
            if (set%sin_at(h) == 0) then                              ! an extra column receives values without a position
               call store_pair(jacobian(:, row, set%cos_at(h), column), self%columns(:, 1, lane))
            else
               call store_pair(jacobian(:, row, set%cos_at(h), column), jacobian(:, row, set%sin_at(h), column))
            end if
            if (.not. laws%needs_reaction) cycle
            do k = pattern%first(column), pattern%last(column)
               if (set%sin_at(h) == 0) then
                  call add_reaction(k, jacobian(:, row, set%cos_at(h), k), self%columns(:, 1, lane))
               else
                  call add_reaction(k, jacobian(:, row, set%cos_at(h), k), jacobian(:, row, set%sin_at(h), k))
               end if
            end do
         end do
      end associate

   contains

      subroutine store_pair(cosine_column, sine_column)
         real(wp), intent(inout), contiguous :: cosine_column(:), sine_column(:)

         associate (set => laws%transform%harmonics, table => laws%table)
            if (is_first) then
               call table%columns(part_of(slope%by_motion, lane), set, h, cosine_column, sine_column)
            else
               call table%add_columns(part_of(slope%by_motion, lane), set, h, 1.0_wp, 0.0_wp, cosine_column, sine_column)
            end if
            if (laws%needs_velocity) &
               call table%add_columns(part_of(slope%by_rate, lane), set, h, 0.0_wp, -frequencies(h), cosine_column, sine_column)
         end associate
      end subroutine store_pair

      subroutine add_reaction(k, cosine_column, sine_column)
         integer, intent(in) :: k
         real(wp), intent(inout), contiguous :: cosine_column(:), sine_column(:)

         associate (s => linear%entry(laws%jacobian%column(pair), k, h))
            call laws%table%add_columns(part_of(slope%by_reaction, lane), laws%transform%harmonics, h, -real(s), aimag(s), &
                                        cosine_column, sine_column)
         end associate
      end subroutine add_reaction
   end subroutine store_products

   !> Frees the memory of products; safe to call twice.
   subroutine dense_tangent_destroy(self)
      class(dense_tangent_t), intent(inout) :: self

      call self%response%destroy()
      if (allocated(self%columns)) deallocate (self%columns)
   end subroutine dense_tangent_destroy
end module hb_dense_tangent
