!> Dependence of the forces of all laws on the motion at the same sample: the pairs (i, k) of degrees of freedom with
!> d force_i/d motion_k not zero, and these derivatives.
!> Explicit laws come first. The argument of a multiplier law is then the reaction p = w.(s - f_explicit)/w.w of each
!> of its coordinates, with the weights w, so that it depends on everything on which the explicit laws beside it
!> depend. Laws with memory have no pairs: their forces depend on all samples. Source: docs/why/theory.md, sections
!> 5.3 and 5.4.
module hb_law_jacobian
   use hb_assert, only: assert, asserts_are_on
   use hb_block_pattern, only: block_pattern_t
   use hb_error, only: error_t
   use hb_fftw, only: new_real_block, real_block_t
   use hb_kinds, only: wp
   use hb_law_samples, only: law_samples_t
   use hb_sampled_law, only: sampled_law_t
   use hb_threads, only: n_threads
   implicit none
   private
   public :: law_jacobian_t, new_law_jacobian

   !> Columns of a row, in the order of addition.
   type :: row_t
      integer :: n = 0
      integer, allocatable :: columns(:)                              ! the first n are in use
   contains
      procedure :: add => row_add
   end type row_t

   !> Owner of external resources: call `destroy`.
   type :: law_jacobian_t
      integer :: n_pairs = 0
      integer, allocatable :: row(:), column(:)                       !! (n_pairs) i and k of each pair
      integer, allocatable :: order(:)                                !! (n_pairs) row by row, columns ascending
      integer, allocatable :: first(:)                                !! (n_dofs + 1) where each row begins
      logical :: needs_velocity = .false., needs_reaction = .false.   !! of any law
      type(real_block_t) :: df_dq                                     !! [N/m], (n_samples, n_pairs), after `allocate_slopes`
      type(real_block_t) :: df_dv                                     !! [N s/m], as df_dq if a law needs it
      type(real_block_t) :: df_ds                                     !! as df_dq if a law needs it
   contains
      procedure :: pattern => law_jacobian_pattern
      procedure :: pair_at => law_jacobian_pair_at
      procedure :: is_allocated => law_jacobian_is_allocated
      procedure :: allocate_slopes => law_jacobian_allocate_slopes
      procedure :: clear => law_jacobian_clear
      procedure :: add => law_jacobian_add
      procedure :: add_product => law_jacobian_add_product
      procedure :: add_transposed => law_jacobian_add_transposed
      procedure :: mean => law_jacobian_mean
      procedure :: variation => law_jacobian_variation
      procedure :: destroy => law_jacobian_destroy
   end type law_jacobian_t

contains

   !> Determines which forces depend on which motions. `allocate_slopes` allocates the derivatives.
   subroutine new_law_jacobian(self, laws, n_dofs, needs_velocity, needs_reaction)
      type(law_jacobian_t), intent(inout) :: self
      type(sampled_law_t), intent(in) :: laws(:)
      integer, intent(in) :: n_dofs                                   !! on which they act
      logical, intent(in) :: needs_velocity, needs_reaction           !! of any law
      type(row_t), allocatable :: rows(:)
      integer :: a, b, i, k, pass
      integer, allocatable :: next(:)                                 ! pair of each column

      call self%destroy()
      self%needs_velocity = needs_velocity
      self%needs_reaction = needs_reaction
      allocate (rows(n_dofs))
      do pass = 1, 2                                                   ! explicit laws, then multipliers
         do i = 1, size(laws)
            if (laws(i)%law%is_multiplier .neqv. pass == 2) cycle
            if (allocated(laws(i)%hysteresis)) cycle
            associate (columns => laws(i)%columns)
               do b = 1, size(columns)
                  do a = 1, size(columns)
                     call rows(columns(a))%add([columns(b)])
                     if (pass == 1 .or. a == b .or. rows(columns(b))%n == 0) cycle
                     call rows(columns(a))%add(rows(columns(b))%columns(:rows(columns(b))%n))
                  end do
               end do
            end associate
         end do
      end do
      allocate (self%first(n_dofs + 1))
      self%first(1) = 1
      do a = 1, n_dofs
         self%first(a + 1) = self%first(a) + rows(a)%n
      end do
      self%n_pairs = self%first(n_dofs + 1) - 1
      allocate (next(n_dofs + 1), source=0)
      do a = 1, n_dofs
         do k = 1, rows(a)%n
            next(rows(a)%columns(k) + 1) = next(rows(a)%columns(k) + 1) + 1
         end do
      end do
      next(1) = 1
      do b = 1, n_dofs
         next(b + 1) = next(b) + next(b + 1)
      end do
      allocate (self%row(self%n_pairs), self%column(self%n_pairs), self%order(self%n_pairs))
      do a = 1, n_dofs
         if (rows(a)%n == 0) cycle                                     ! no law acts here, and there are no columns
         call sort(rows(a)%columns(:rows(a)%n))
         do k = 1, rows(a)%n
            b = rows(a)%columns(k)
            self%row(next(b)) = a
            self%column(next(b)) = b
            self%order(self%first(a) + k - 1) = next(b)
            next(b) = next(b) + 1
         end do
      end do
   end subroutine new_law_jacobian

   !> Adds columns that are not there yet.
   pure subroutine row_add(self, columns)
      class(row_t), intent(inout) :: self
      integer, intent(in) :: columns(:)
      integer, allocatable :: longer(:)
      integer :: i

      do i = 1, size(columns)
         if (self%n > 0) then
            if (any(self%columns(:self%n) == columns(i))) cycle
         else
            allocate (self%columns(4))
         end if
         if (self%n == size(self%columns)) then
            allocate (longer(2*self%n))
            longer(:self%n) = self%columns
            call move_alloc(longer, self%columns)
         end if
         self%n = self%n + 1
         self%columns(self%n) = columns(i)
      end do
   end subroutine row_add

   !> Sorts by insertion: rows are short, and almost sorted.
   pure subroutine sort(columns)
      integer, intent(inout) :: columns(:)
      integer :: column, i, k

      do i = 2, size(columns)
         column = columns(i)
         do k = i - 1, 1, -1
            if (columns(k) <= column) exit
            columns(k + 1) = columns(k)
         end do
         columns(k + 1) = column
      end do
   end subroutine sort

   !> Returns a Jacobian with these pairs, without memory for derivatives.
   pure type(law_jacobian_t) function law_jacobian_pattern(self) result(pattern)
      class(law_jacobian_t), intent(in) :: self

      pattern%n_pairs = self%n_pairs
      allocate (pattern%row, source=self%row)
      allocate (pattern%column, source=self%column)
      allocate (pattern%order, source=self%order)
      allocate (pattern%first, source=self%first)
      pattern%needs_velocity = self%needs_velocity
      pattern%needs_reaction = self%needs_reaction
   end function law_jacobian_pattern

   !> Number of the pair (i, k), which must be one.
   pure integer function law_jacobian_pair_at(self, i, k) result(pair)
      class(law_jacobian_t), intent(in) :: self
      integer, intent(in) :: i, k
      integer :: first, last, middle

      first = self%first(i)
      last = self%first(i + 1) - 1
      do while (first < last)                                         ! bisection
         middle = (first + last)/2
         if (self%column(self%order(middle)) < k) then
            first = middle + 1
         else
            last = middle
         end if
      end do
      pair = self%order(first)
      if (asserts_are_on) call assert(self%column(pair) == k, "law_jacobian_pair_at", "a pair that the laws couple")
   end function law_jacobian_pair_at

   !> Whether derivatives are allocated.
   pure logical function law_jacobian_is_allocated(self)
      class(law_jacobian_t), intent(in) :: self

      law_jacobian_is_allocated = associated(self%df_dq%values)
   end function law_jacobian_is_allocated

   !> Allocates derivatives on a grid.
   subroutine law_jacobian_allocate_slopes(self, n_samples, error)
      class(law_jacobian_t), intent(inout) :: self
      integer, intent(in) :: n_samples
      type(error_t), allocatable, intent(out) :: error

      if (self%needs_velocity) call new_real_block(self%df_dv, n_samples, self%n_pairs, error)
      if (allocated(error)) return
      if (self%needs_reaction) call new_real_block(self%df_ds, n_samples, self%n_pairs, error)
      if (allocated(error)) return
      call new_real_block(self%df_dq, n_samples, self%n_pairs, error) ! the last one: tested by `is_allocated`
   end subroutine law_jacobian_allocate_slopes

   !> Sets all derivatives to zero.
   subroutine law_jacobian_clear(self)
      class(law_jacobian_t), intent(inout) :: self

      self%df_dq%values = 0.0_wp
      if (self%needs_velocity) self%df_dv%values = 0.0_wp
      if (self%needs_reaction) self%df_ds%values = 0.0_wp
   end subroutine law_jacobian_clear

   !> Adds the derivatives of one law without memory; multiplier laws come after all others.
   subroutine law_jacobian_add(self, law)
      class(law_jacobian_t), intent(inout) :: self
      type(sampled_law_t), intent(in) :: law                          !! differentiated

      if (law%law%is_multiplier) then
         call add_multiplier(self, law)
      else
         call add_explicit(self, law)
      end if
   end subroutine law_jacobian_add

   !> d force_i/d motion_k += sum over coordinates a, b of shape(i, a) df_a/dz_b shape(k, b), and likewise for rates.
   subroutine add_explicit(self, law)
      type(law_jacobian_t), intent(inout) :: self
      type(sampled_law_t), intent(in) :: law
      integer :: a, b, i, k, pair
      real(wp) :: weight

      associate (shape => law%law%shape, df_dq => self%df_dq, df_dv => self%df_dv)
         do k = 1, size(law%columns)
            do i = 1, size(law%columns)
               pair = self%pair_at(law%columns(i), law%columns(k))
               do b = 1, size(shape, 2)
                  do a = 1, size(shape, 2)
                     weight = shape(i, a)*shape(k, b)
                     if (weight == 0.0_wp) cycle                       ! the usual case if coordinates are degrees of freedom
                     df_dq%values(:, pair) = df_dq%values(:, pair) + weight*law%df_dz(:, a, b)
                     if (size(law%v, 2) == 0) cycle
                     df_dv%values(:, pair) = df_dv%values(:, pair) + weight*law%df_dv(:, a, b)
                  end do
               end do
            end do
         end do
      end associate
   end subroutine add_explicit

   !> Chain rule through p_b = w_b.(s - f_explicit)/w_b.w_b for a law of coordinates with the weights w_b, orthogonal
   !> to each other. Its degrees of freedom belong to no other multiplier, so the present entries of their rows are
   !> explicit.
   subroutine add_multiplier(self, law)
      type(law_jacobian_t), intent(inout) :: self
      type(sampled_law_t), intent(in) :: law
      integer :: a, b, i, k, m, own, pair
      real(wp), dimension(size(law%law%shape, 2)) :: square, w_k
      real(wp), dimension(size(law%f, 1), size(law%law%shape, 2)) :: explicit_q, explicit_v
      real(wp), dimension(size(law%f, 1)) :: slope_q, slope_v, slope_s

      associate (shape => law%law%shape, columns => law%columns, needs_velocity => self%needs_velocity)
         square = sum(shape**2, dim=1)
         do m = self%first(columns(1)), self%first(columns(1) + 1) - 1
            k = self%column(self%order(m))
            own = findloc(columns, k, dim=1)
            w_k = 0.0_wp
            if (own > 0) w_k = shape(own, :)
            explicit_q = explicit_slopes(self%df_dq%values, k)
            if (needs_velocity) explicit_v = explicit_slopes(self%df_dv%values, k)
            do a = 1, size(shape, 2)
               slope_q = 0.0_wp
               slope_s = 0.0_wp
               slope_v = 0.0_wp
               do b = 1, size(shape, 2)
                  slope_q = slope_q - law%df_dp(:, a, b)*explicit_q(:, b)
                  if (needs_velocity) slope_v = slope_v - law%df_dp(:, a, b)*explicit_v(:, b)
                  if (w_k(b) == 0.0_wp) cycle                          ! the usual case if coordinates are degrees of freedom
                  slope_q = slope_q + w_k(b)*law%df_dz(:, a, b)
                  if (size(law%v, 2) > 0) slope_v = slope_v + w_k(b)*law%df_dv(:, a, b)
                  slope_s = slope_s + w_k(b)/square(b)*law%df_dp(:, a, b)
               end do
               do i = 1, size(columns)
                  if (shape(i, a) == 0.0_wp) cycle
                  pair = self%pair_at(columns(i), k)
                  self%df_dq%values(:, pair) = self%df_dq%values(:, pair) + shape(i, a)*slope_q
                  if (needs_velocity) self%df_dv%values(:, pair) = self%df_dv%values(:, pair) + shape(i, a)*slope_v
                  self%df_ds%values(:, pair) = self%df_ds%values(:, pair) + shape(i, a)*slope_s
               end do
            end do
         end do
      end associate

   contains

      !> w_b.(d f_explicit/d motion_k)/w_b.w_b of all coordinates b.
      function explicit_slopes(derivative, k) result(slopes)
         real(wp), intent(in) :: derivative(:, :)
         integer, intent(in) :: k
         real(wp) :: slopes(size(derivative, 1), size(law%law%shape, 2))
         integer :: c, m

         slopes = 0.0_wp
         associate (shape => law%law%shape, columns => law%columns)
            do c = 1, size(shape, 2)
               do m = 1, size(columns)
                  if (shape(m, c) == 0.0_wp) cycle
                  slopes(:, c) = slopes(:, c) + shape(m, c)/square(c)*derivative(:, self%pair_at(columns(m), k))
               end do
            end do
         end associate
      end function explicit_slopes
   end subroutine add_multiplier

   !> Adds the derivative of the forces along a direction to its `f`: the sum over pairs (i, k) of df_i/dq_k q_k + df_i/dv_k v_k +
   !> df_i/ds_k s_k.
   subroutine law_jacobian_add_product(self, along)
      class(law_jacobian_t), intent(in) :: self
      type(law_samples_t), intent(inout) :: along
      integer :: dof, i, n

      n = n_threads(self%n_pairs*size(along%f%values, 1))
      if (n == 1) then
         do i = 1, size(self%order)
            call add_pair(self, self%order(i), along)
         end do
      else                                                            ! a force is summed by one thread
         !$omp parallel do num_threads(n) private(i)
         do dof = 1, size(self%first) - 1
            do i = self%first(dof), self%first(dof + 1) - 1
               call add_pair(self, self%order(i), along)
            end do
         end do
      end if
   end subroutine law_jacobian_add_product

   subroutine add_pair(self, i, along)
      type(law_jacobian_t), intent(in) :: self
      integer, intent(in) :: i
      type(law_samples_t), intent(in) :: along                        ! its f is written

      associate (f => along%f%values(:, self%row(i)), k => self%column(i))
         f = f + self%df_dq%values(:, i)*along%q%values(:, k)
         if (self%needs_velocity) f = f + self%df_dv%values(:, i)*along%v%values(:, k)
         if (self%needs_reaction) f = f + self%df_ds%values(:, i)*along%s%values(:, k)
      end associate
   end subroutine add_pair

   !> Adds the product with the transposed derivatives: to q, v and s of `along` from its f.
   subroutine law_jacobian_add_transposed(self, along)
      class(law_jacobian_t), intent(in) :: self
      type(law_samples_t), intent(inout) :: along
      integer :: i

      do i = 1, self%n_pairs
         associate (f => along%f%values(:, self%row(i)), k => self%column(i))
            along%q%values(:, k) = along%q%values(:, k) + self%df_dq%values(:, i)*f
            if (self%needs_velocity) along%v%values(:, k) = along%v%values(:, k) + self%df_dv%values(:, i)*f
            if (self%needs_reaction) along%s%values(:, k) = along%s%values(:, k) + self%df_ds%values(:, i)*f
         end associate
      end do
   end subroutine law_jacobian_add_transposed

   !> Computes the means of all derivatives over the torus, in a memory layout with room for all pairs.
   subroutine law_jacobian_mean(self, layout, df_dq, df_dv, df_ds)
      class(law_jacobian_t), intent(in) :: self
      type(block_pattern_t), intent(in) :: layout
      real(wp), intent(out) :: df_dq(:, :), df_dv(:, :), df_ds(:, :)  !! (layout%n_rows, n_dofs)
      real(wp) :: weight
      integer :: i

      df_dq = 0.0_wp
      df_dv = 0.0_wp
      df_ds = 0.0_wp
      weight = 1.0_wp/real(size(self%df_dq%values, 1), wp)
      do i = 1, self%n_pairs
         associate (row => layout%shift(self%column(i)) + self%row(i), column => self%column(i))
            df_dq(row, column) = weight*sum(self%df_dq%values(:, i))
            if (self%needs_velocity) df_dv(row, column) = weight*sum(self%df_dv%values(:, i))
            if (self%needs_reaction) df_ds(row, column) = weight*sum(self%df_ds%values(:, i))
         end associate
      end do
   end subroutine law_jacobian_mean

   !> Computes the standard deviations over the torus of the derivatives of each force by the motion of its own degree
   !> of freedom.
   subroutine law_jacobian_variation(self, df_dq, df_dv, df_ds)
      class(law_jacobian_t), intent(in) :: self
      real(wp), intent(out) :: df_dq(:), df_dv(:), df_ds(:)           !! (n_dofs)
      integer :: i

      df_dq = 0.0_wp
      df_dv = 0.0_wp
      df_ds = 0.0_wp
      do i = 1, self%n_pairs
         associate (dof => self%row(i))
            if (self%column(i) /= dof) cycle
            df_dq(dof) = deviation(self%df_dq%values(:, i))
            if (self%needs_velocity) df_dv(dof) = deviation(self%df_dv%values(:, i))
            if (self%needs_reaction) df_ds(dof) = deviation(self%df_ds%values(:, i))
         end associate
      end do

   contains

      pure real(wp) function deviation(values)
         real(wp), intent(in) :: values(:)

         associate (n => real(size(values), wp))
            deviation = sqrt(sum((values - sum(values)/n)**2)/n)
         end associate
      end function deviation
   end subroutine law_jacobian_variation

   !> Frees all derivatives and discards the pairs; safe to call twice.
   subroutine law_jacobian_destroy(self)
      class(law_jacobian_t), intent(inout) :: self

      call self%df_dq%destroy()
      call self%df_dv%destroy()
      call self%df_ds%destroy()
      if (allocated(self%row)) deallocate (self%row, self%column, self%order, self%first)
      self%n_pairs = 0
   end subroutine law_jacobian_destroy
end module hb_law_jacobian
