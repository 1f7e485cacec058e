!> A few shapes in which a large structure answers forces at some places as it does by all its degrees of freedom: the basis of a
!> block Krylov space of the shifted stiffness K_s = (K + K^T)/2 + s**2 M,
!>
!>     V = span{K_s^-1 B, K_s^-1 M K_s^-1 B, (K_s^-1 M)**2 K_s^-1 B, ...},   V^T K_s V = 1,
!>
!> for the places B. One factorisation (CHOLMOD) serves it, real whatever the damping. For symmetric matrices the flexibility
!> H(w) = B^T (V^T S(w) V)^-1 B, of Galerkin's projection, matches as many derivatives at w = i s as two times the blocks, and its
!> error is the square of that of the motion. Damping that is no sum of mass and stiffness, gyroscopic and circulatory terms are
!> projected as they are; where they act all over the structure, blocks follow that are what is left of the forces at some
!> frequencies, times K_s^-1. Source: Bai, Krylov subspace techniques for reduced-order
!> modeling of large-scale dynamical systems, Appl. Numer. Math. 43 (2002), sections 3 and 5.
module hb_krylov_basis
   use hb_cholmod, only: cholesky_t
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   use hb_lapack, only: dgemm, dpotrf, dsyev, dtrsm, zgetrf, zgetrs
   use hb_sparse, only: sparse_sum, sparse_t, sparse_transpose
   use hb_watch, only: work_is_over
   implicit none
   private
   public :: krylov_basis_t, new_krylov_basis

   real(wp), parameter :: dependent = 1.0e-11_wp                      ! what is left of a shape beside those before, to leave it out

   real(wp), parameter :: agreement = 1.0e-6_wp                        ! of the damping of a row with that of most

   !> Sums of products of entries of mass, stiffness and damping.
   type :: products_t
      real(wp) :: mm = 0.0_wp, mk = 0.0_wp, kk = 0.0_wp, dm = 0.0_wp, dk = 0.0_wp, dd = 0.0_wp
   contains
      procedure :: add => products_add
      procedure :: fit => products_fit
      procedure :: remainder => products_remainder
   end type products_t

   type :: krylov_basis_t
      integer :: n = 0                                                !! shapes
      integer :: n_before = 0                                         !! shapes before the last block
      real(wp) :: shift = 0.0_wp                                      !! s**2 [rad**2/s**2]
      real(wp) :: alpha = 0.0_wp, beta = 0.0_wp                       !! D = alpha M + beta K + remainder [1/s], [s]
      real(wp), allocatable :: v(:, :)                                !! (n_dofs, n or more)
      real(wp), allocatable :: mass(:, :)                             !! V^T M V [1], (n or more, n or more)
      real(wp), allocatable :: damping(:, :), stiffness(:, :)         !! V^T (remainder of D) V, V^T (K - K^T)/2 V, as mass, or not
                                                                      !! allocated where there is none
      real(wp), allocatable :: inputs(:, :)                           !! B, (n_dofs, n_inputs)
      type(sparse_t) :: remainder_of_damping, remainder_of_stiffness            !! without entries where there is none
      type(sparse_t), private :: m, k
      type(cholesky_t), private :: factors
      real(wp), allocatable, private :: next(:, :)                    ! M, and the rests, times the last block
   contains
      procedure :: extend => krylov_basis_extend
      procedure :: change => krylov_basis_change
      procedure :: poles => krylov_basis_poles
      procedure :: take_residuals => krylov_basis_take_residuals
      procedure :: bytes_of_factors => krylov_basis_bytes_of_factors
      procedure :: destroy => krylov_basis_destroy
   end type krylov_basis_t

contains

   !> Factorises; the basis is empty yet. Fails where K_s is not positive definite.
   subroutine new_krylov_basis(self, mass, damping, stiffness, inputs, shift, most_bytes, error)
      type(krylov_basis_t), intent(out) :: self
      type(sparse_t), intent(in) :: mass, damping, stiffness          !! (n_dofs, n_dofs)
      real(wp), intent(in) :: inputs(:, :)                            !! B, (n_dofs, n_inputs), independent columns
      real(wp), intent(in) :: shift                                   !! s**2 [rad**2/s**2], > 0
      real(wp), intent(in) :: most_bytes                              !! that the factors may take
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: first(:), row(:)
      real(wp), allocatable :: value(:)
      type(sparse_t) :: turned

      self%shift = shift
      self%inputs = inputs
      self%m = mass
      turned = sparse_transpose(stiffness)
      self%k = sparse_sum(shift, mass, 1.0_wp, sparse_sum(0.5_wp, stiffness, 0.5_wp, turned))
      self%remainder_of_stiffness = without_rounding(sparse_sum(0.5_wp, stiffness, -0.5_wp, turned), stiffness)
      call split_damping(self, mass, damping, sparse_sum(0.5_wp, stiffness, 0.5_wp, turned))
      call lower_triangle(self%k, first, row, value)
      call self%factors%factorise(first, row, value, most_bytes, error)
      if (.not. allocated(error)) return
      if (self%factors%is_indefinite) call fail(error, "the stiffness is indefinite, or something moves without stiffness or mass")
   end subroutine new_krylov_basis

   !> D = alpha M + beta K + remainder, with the factors of most rows, and no remainder where that is rounding alone.
   subroutine split_damping(self, mass, damping, stiffness)
      type(krylov_basis_t), intent(inout) :: self
      type(sparse_t), intent(in) :: mass, damping, stiffness
      real(wp), allocatable :: alpha(:), beta(:)
      real(wp) :: more_alpha, more_beta
      type(products_t), allocatable :: row(:)
      type(products_t) :: all
      logical, allocatable :: is_sound(:)
      logical :: is_fit
      integer :: i, pass

      allocate (alpha(mass%n_rows), beta(mass%n_rows), row(mass%n_rows), is_sound(mass%n_rows))
      do i = 1, mass%n_rows
         row(i) = products_of_row(i, mass, damping, stiffness)
         call row(i)%fit(alpha(i), beta(i), is_sound(i))
      end do
      if (any(is_sound)) then
         self%alpha = median(pack(alpha, is_sound))
         self%beta = median(pack(beta, is_sound))
      end if
      is_sound = [(row(i)%remainder(self%alpha, self%beta) <= agreement**2*row(i)%dd, i=1, mass%n_rows)]
      do pass = 1, 2                                                  ! what most rows have in common leaves nothing in them
         self%remainder_of_damping = sparse_sum(1.0_wp, damping, -1.0_wp, sparse_sum(self%alpha, mass, self%beta, stiffness))
         all = products_t()
         do i = 1, mass%n_rows
            if (.not. (is_sound(i) .and. row(i)%kk > 0.0_wp)) cycle
            call all%add(products_of_row(i, mass, self%remainder_of_damping, stiffness), 1.0_wp/row(i)%kk)
         end do
         call all%fit(more_alpha, more_beta, is_fit)
         self%alpha = self%alpha + more_alpha
         self%beta = self%beta + more_beta
      end do
      self%remainder_of_damping = without_rounding(sparse_sum(1.0_wp, damping, -1.0_wp, &
                                                         sparse_sum(self%alpha, mass, self%beta, stiffness)), damping)
   end subroutine split_damping

   !> Sums of products of the entries of one row.
   pure type(products_t) function products_of_row(i, mass, damping, stiffness) result(row)
      integer, intent(in) :: i
      type(sparse_t), intent(in) :: mass, damping, stiffness

      row%mm = inner(mass, mass)
      row%mk = inner(mass, stiffness)
      row%kk = inner(stiffness, stiffness)
      row%dm = inner(damping, mass)
      row%dk = inner(damping, stiffness)
      row%dd = inner(damping, damping)

   contains

      pure real(wp) function inner(one, other)
         type(sparse_t), intent(in) :: one, other
         integer :: e, f

         inner = 0.0_wp
         do e = one%first(i), one%first(i + 1) - 1
            do f = other%first(i), other%first(i + 1) - 1
               if (one%column(e) == other%column(f)) inner = inner + one%value(e)*other%value(f)
            end do
         end do
      end function inner
   end function products_of_row

   !> Adds `factor` times the products of another entry.
   pure subroutine products_add(self, other, factor)
      class(products_t), intent(inout) :: self
      type(products_t), intent(in) :: other
      real(wp), intent(in) :: factor

      self%mm = self%mm + factor*other%mm
      self%mk = self%mk + factor*other%mk
      self%kk = self%kk + factor*other%kk
      self%dm = self%dm + factor*other%dm
      self%dk = self%dk + factor*other%dk
      self%dd = self%dd + factor*other%dd
   end subroutine products_add

   !> Least squares of D - alpha M - beta K; not sound where M and K are nearly in proportion.
   pure subroutine products_fit(self, alpha, beta, is_sound)
      class(products_t), intent(in) :: self
      real(wp), intent(out) :: alpha, beta
      logical, intent(out) :: is_sound
      real(wp) :: determinant

      alpha = 0.0_wp
      beta = 0.0_wp
      determinant = self%mm*self%kk - self%mk**2
      is_sound = determinant > 1.0e-6_wp*self%mm*self%kk
      if (.not. is_sound) return
      alpha = (self%dm*self%kk - self%dk*self%mk)/determinant
      beta = (self%dk*self%mm - self%dm*self%mk)/determinant
   end subroutine products_fit

   !> Square sum of D - alpha M - beta K.
   pure real(wp) function products_remainder(self, alpha, beta) result(remainder)
      class(products_t), intent(in) :: self
      real(wp), intent(in) :: alpha, beta

      remainder = self%dd + alpha**2*self%mm + beta**2*self%kk + 2.0_wp*(alpha*beta*self%mk - alpha*self%dm - beta*self%dk)
   end function products_remainder

   !> The middle one of some numbers: one that more than half of them share, if there is such a one.
   pure real(wp) function median(values)
      real(wp), intent(in) :: values(:)
      integer :: pass, n_below
      real(wp) :: high, low, middle

      low = minval(values)
      high = maxval(values)
      middle = low
      do pass = 1, 100
         middle = 0.5_wp*(low + high)
         if (middle <= low .or. middle >= high) exit
         n_below = count(values <= middle)
         if (2*n_below >= size(values)) then
            high = middle
         else
            low = middle
         end if
      end do
      median = high
   end function median

   !> Leaves out entries that are rounding beside the largest one of their row in a matrix that they come from.
   pure function without_rounding(matrix, origin) result(remainder)
      type(sparse_t), intent(in) :: matrix, origin
      type(sparse_t) :: remainder
      real(wp), parameter :: rounding = 1.0e-12_wp
      real(wp) :: largest
      integer :: e, i, n

      remainder = matrix
      n = 0
      do i = 1, matrix%n_rows
         remainder%first(i) = n + 1
         largest = maxval([0.0_wp, abs(origin%value(origin%first(i):origin%first(i + 1) - 1))])
         do e = matrix%first(i), matrix%first(i + 1) - 1
            if (abs(matrix%value(e)) <= rounding*largest) cycle
            n = n + 1
            remainder%column(n) = matrix%column(e)
            remainder%value(n) = matrix%value(e)
         end do
      end do
      remainder%first(matrix%n_rows + 1) = n + 1
      remainder%column = remainder%column(:n)
      remainder%value = remainder%value(:n)
   end function without_rounding

   !> Columns of the lower triangle of a symmetric matrix, that is rows of the upper one, ascending.
   subroutine lower_triangle(matrix, first, row, value)
      type(sparse_t), intent(in) :: matrix
      integer, allocatable, intent(out) :: first(:), row(:)
      real(wp), allocatable, intent(out) :: value(:)
      integer, allocatable :: next(:)
      integer :: e, i, n

      allocate (first(matrix%n_rows + 1), source=0)
      do i = 1, matrix%n_rows
         do e = matrix%first(i), matrix%first(i + 1) - 1
            if (matrix%column(e) <= i) first(matrix%column(e) + 1) = first(matrix%column(e) + 1) + 1
         end do
      end do
      first(1) = 1
      do i = 1, matrix%n_rows
         first(i + 1) = first(i) + first(i + 1)
      end do
      n = first(matrix%n_rows + 1) - 1
      allocate (row(n), value(n))
      next = first
      do i = 1, matrix%n_rows                                         ! row by row: ascending in each column
         do e = matrix%first(i), matrix%first(i + 1) - 1
            if (matrix%column(e) > i) cycle
            associate (at => next(matrix%column(e)))
               row(at) = i
               value(at) = matrix%value(e)
               at = at + 1
            end associate
         end do
      end do
   end subroutine lower_triangle

   !> Adds a block: what the inputs do, then what the inertia of the last block does. `n` stays where there is nothing new.
   subroutine krylov_basis_extend(self, error)
      class(krylov_basis_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: w(:, :), x(:, :)
      integer :: first, last

      if (.not. allocated(self%next)) then
         x = self%inputs
      else
         call move_alloc(self%next, x)
      end if
      allocate (w, mold=x)
      call self%factors%solve(x, w, error)
      if (allocated(error)) return
      call make_room(self, size(w, 2))
      call orthonormalise(self, w, error)
      if (allocated(error)) return
      self%n_before = self%n
      first = self%n + 1
      last = self%n + size(w, 2)
      self%v(:, first:last) = w
      self%n = last
      deallocate (x)
      allocate (x, mold=w)
      call self%m%times(w, x)
      call project(self, x, self%mass(:last, first:last))
      self%mass(first:last, :first - 1) = transpose(self%mass(:first - 1, first:last))
      call move_alloc(x, self%next)
      call project_remainder(self, w, self%remainder_of_damping, .false., self%damping)
      call project_remainder(self, w, self%remainder_of_stiffness, .true., self%stiffness)
   end subroutine krylov_basis_extend

   !> Goes on with the projection of a remainder.
   subroutine project_remainder(self, w, remainder, is_skew, projected)
      class(krylov_basis_t), intent(in) :: self
      real(wp), intent(in), contiguous :: w(:, :)                     !! the last block
      type(sparse_t), intent(in) :: remainder
      logical, intent(in) :: is_skew
      real(wp), allocatable, intent(inout) :: projected(:, :)
      real(wp) :: rows(self%n, size(w, 2))
      real(wp), allocatable :: x(:, :)
      type(sparse_t) :: turned

      if (remainder%n_entries() == 0) return
      if (.not. allocated(projected)) allocate (projected(size(self%mass, 1), size(self%mass, 2)), source=0.0_wp)
      allocate (x, mold=w)
      associate (first => self%n_before + 1, last => self%n)
         call remainder%times(w, x)
         call project(self, x, projected(:last, first:last))
         if (is_skew) then
            projected(first:last, :first - 1) = -transpose(projected(:first - 1, first:last))
         else
            turned = sparse_transpose(remainder)
            call turned%times(w, x)
            call project(self, x, rows)
            projected(first:last, :first - 1) = transpose(rows(:first - 1, :))
         end if
      end associate
   end subroutine project_remainder

   !> Goes on with what the basis leaves of the forces at some frequencies, R = B - S(w) V (V^T S V)^-1 V^T B, in place of inertia:
   !> where damping or stiffness of another kind than that of the space acts all over the structure.
   subroutine krylov_basis_take_residuals(self, frequencies)
      class(krylov_basis_t), intent(inout) :: self
      real(wp), intent(in) :: frequencies(:)                          !! [rad/s]
      complex(wp), allocatable :: response(:, :, :)
      real(wp), allocatable :: both(:, :), force(:, :), of_d(:, :), of_k(:, :), of_m(:, :), x(:, :)
      integer :: b, i, n

      b = size(self%inputs, 2)
      n = size(self%v, 1)
      call find_flexibility(self, self%n, frequencies, response, is_motion=.true.)
      if (allocated(self%next)) deallocate (self%next)
      allocate (self%next(n, 2*b*size(frequencies)), both(self%n, 2*b), x(n, 2*b))
      allocate (of_d, of_k, of_m, force, mold=x)
      do i = 1, size(frequencies)
         both(:, :b) = real(response(:, :, i))
         both(:, b + 1:) = aimag(response(:, :, i))
         call dgemm("N", "N", n, 2*b, self%n, 1.0_wp, self%v, n, both, self%n, 0.0_wp, x, n)
         call self%k%times(x, of_k)
         call self%m%times(x, of_m)
         of_k = of_k - self%shift*of_m
         of_d = self%alpha*of_m + self%beta*of_k
         if (self%remainder_of_damping%n_entries() > 0) then
            call self%remainder_of_damping%times(x, force)
            of_d = of_d + force
         end if
         if (self%remainder_of_stiffness%n_entries() > 0) then
            call self%remainder_of_stiffness%times(x, force)
            of_k = of_k + force
         end if
         associate (residual => self%next(:, 2*b*(i - 1) + 1:2*b*i), w => frequencies(i))
            residual = w**2*of_m - of_k
            residual(:, :b) = residual(:, :b) + self%inputs + w*of_d(:, b + 1:)
            residual(:, b + 1:) = residual(:, b + 1:) - w*of_d(:, :b)
         end associate
      end do
   end subroutine krylov_basis_take_residuals

   !> V^T x.
   subroutine project(self, x, projected)
      class(krylov_basis_t), intent(in) :: self
      real(wp), intent(in), contiguous :: x(:, :)
      real(wp), intent(out) :: projected(:, :)                        !! (n, size(x, 2))
      real(wp) :: c(self%n, size(x, 2))

      if (size(c) == 0) return
      associate (n => size(x, 1), k => size(x, 2))
         call dgemm("T", "N", self%n, k, n, 1.0_wp, self%v, n, x, n, 0.0_wp, c, self%n)
      end associate
      projected = c
   end subroutine project

   !> Takes the shapes of the basis out of new ones, and makes these orthonormal by K_s; those that then are nothing are left out.
   subroutine orthonormalise(self, w, error)
      class(krylov_basis_t), intent(in) :: self
      real(wp), allocatable, intent(inout) :: w(:, :)                 !! (n_dofs, any)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: gram(:, :), kept(:, :), x(:, :)
      real(wp) :: size_before(size(w, 2)), energy
      integer :: i, info, j, n_kept, pass

      allocate (x, kept, mold=w)
      call self%k%times(w, x)
      do i = 1, size(w, 2)
         energy = dot_product(w(:, i), x(:, i))
         size_before(i) = sqrt(max(energy, tiny(1.0_wp)))
         w(:, i) = w(:, i)/size_before(i)
         x(:, i) = x(:, i)/size_before(i)
      end do
      call take_out(self, w, x)
      call self%k%times(w, x)
      n_kept = 0
      do i = 1, size(w, 2)                                            ! Gram and Schmidt, twice
         if (size_before(i) <= sqrt(tiny(1.0_wp))) cycle
         do pass = 1, 2
            do j = 1, n_kept
               energy = dot_product(kept(:, j), w(:, i))              ! kept: K_s times the shapes
               w(:, i) = w(:, i) - energy*w(:, j)
               x(:, i) = x(:, i) - energy*kept(:, j)
            end do
         end do
         energy = dot_product(w(:, i), x(:, i))
         if (energy <= dependent**2) cycle
         n_kept = n_kept + 1
         w(:, n_kept) = w(:, i)/sqrt(energy)
         kept(:, n_kept) = x(:, i)/sqrt(energy)
      end do
      w = w(:, :n_kept)
      deallocate (x)
      allocate (x, mold=w)
      if (n_kept == 0) return
      call self%k%times(w, x)
      call take_out(self, w, x)
      call self%k%times(w, x)
      allocate (gram(n_kept, n_kept))
      associate (n => size(w, 1))
         call dgemm("T", "N", n_kept, n_kept, n, 1.0_wp, w, n, x, n, 0.0_wp, gram, n_kept)
         call dpotrf("U", n_kept, gram, n_kept, info)
         if (info /= 0) then
            call fail(error, "shapes of the structure depend on each other")
            return
         end if
         call dtrsm("R", "U", "N", "N", n, n_kept, 1.0_wp, gram, n_kept, w, n)
      end associate
   end subroutine orthonormalise

   !> w - V V^T x, with x = K_s w.
   subroutine take_out(self, w, x)
      class(krylov_basis_t), intent(in) :: self
      real(wp), intent(inout), contiguous :: w(:, :)
      real(wp), intent(in), contiguous :: x(:, :)
      real(wp), allocatable :: c(:, :)

      if (self%n == 0) return
      allocate (c(self%n, size(x, 2)))
      call project(self, x, c)
      associate (n => size(w, 1))
         call dgemm("N", "N", n, size(w, 2), self%n, -1.0_wp, self%v, n, c, self%n, 1.0_wp, w, n)
      end associate
   end subroutine take_out

   !> Makes room for more shapes.
   subroutine make_room(self, n_more)
      class(krylov_basis_t), intent(inout) :: self
      integer, intent(in) :: n_more
      real(wp), allocatable :: larger(:, :)
      integer :: n

      if (.not. allocated(self%v)) then
         allocate (self%v(size(self%inputs, 1), 0), self%mass(0, 0))
      end if
      if (self%n + n_more <= size(self%v, 2)) return
      n = self%n + 4*n_more
      allocate (larger(size(self%v, 1), n))
      larger(:, :self%n) = self%v(:, :self%n)
      call move_alloc(larger, self%v)
      call enlarge(self%mass)
      if (allocated(self%damping)) call enlarge(self%damping)
      if (allocated(self%stiffness)) call enlarge(self%stiffness)

   contains

      subroutine enlarge(matrix)
         real(wp), allocatable, intent(inout) :: matrix(:, :)
         real(wp), allocatable :: wider(:, :)

         allocate (wider(n, n), source=0.0_wp)
         wider(:self%n, :self%n) = matrix(:self%n, :self%n)
         call move_alloc(wider, matrix)
      end subroutine enlarge
   end subroutine make_room

   !> Largest change of the flexibility at the inputs by the last block, relative to its largest entry at that frequency, over
   !> frequencies. Rows and columns are scaled to be one each at w = i s, so that no unit matters.
   function krylov_basis_change(self, frequencies) result(change)
      class(krylov_basis_t), intent(in) :: self
      real(wp), intent(in) :: frequencies(:)                          !! [rad/s]
      real(wp) :: change
      complex(wp), allocatable :: after(:, :, :), before(:, :, :)
      integer :: i

      change = huge(1.0_wp)
      if (self%n_before == 0) return
      call find_flexibility(self, self%n_before, frequencies, before)
      call find_flexibility(self, self%n, frequencies, after)
      change = 0.0_wp
      do i = 1, size(frequencies)
         associate (largest => maxval(abs(after(:, :, i))))
            if (largest > 0.0_wp) change = max(change, maxval(abs(after(:, :, i) - before(:, :, i)))/largest)
         end associate
      end do
   end function krylov_basis_change

   !> Frequencies [rad/s] of the undamped structure in the basis, ascending; none of rigid motions.
   function krylov_basis_poles(self) result(poles)
      class(krylov_basis_t), intent(in) :: self
      real(wp), allocatable :: poles(:)
      real(wp) :: theta(self%n), u(self%n, self%n)
      integer :: i

      call find_modes(self, self%n, theta, u)
      poles = [(sqrt(max(0.0_wp, 1.0_wp/max(theta(i), tiny(1.0_wp)) - self%shift)), i=self%n, 1, -1)]
      poles = pack(poles, poles**2 > 1.0e-6_wp*self%shift)
   end function krylov_basis_poles

   !> V^T M V = U theta U^T of the first n shapes.
   subroutine find_modes(self, n, theta, u)
      class(krylov_basis_t), intent(in) :: self
      integer, intent(in) :: n
      real(wp), intent(out) :: theta(:), u(:, :)                      !! (n), (n, n)
      real(wp), allocatable :: work(:)
      integer :: info

      u = self%mass(:n, :n)
      allocate (work(34*n + 1))
      call dsyev("V", "U", n, u, n, theta, work, size(work), info)
   end subroutine find_modes

   !> Scaled flexibility at the inputs by the first n shapes;
   !> or the motion of all shapes by forces of one at the inputs.
   subroutine find_flexibility(self, n, frequencies, flexibility, is_motion)
      class(krylov_basis_t), intent(in) :: self
      integer, intent(in) :: n
      real(wp), intent(in) :: frequencies(:)
      complex(wp), allocatable, intent(out) :: flexibility(:, :, :)   !! (n_inputs or n, n_inputs, size(frequencies))
      logical, intent(in), optional :: is_motion
      complex(wp), allocatable :: s(:, :), x(:, :)
      real(wp), allocatable :: b(:, :), remainder_of_damping(:, :), remainder_of_stiffness(:, :), theta(:), u(:, :)
      complex(wp) :: of_k, of_m
      logical :: all_shapes
      integer :: i, info, k, pivots(n)

      all_shapes = .false.
      if (present(is_motion)) all_shapes = is_motion
      associate (n_inputs => size(self%inputs, 2))
         allocate (b(n, n_inputs), theta(n), u(n, n))
         allocate (flexibility(merge(n, n_inputs, all_shapes), n_inputs, size(frequencies)))
         call dgemm("T", "N", n, n_inputs, size(self%v, 1), 1.0_wp, self%v, size(self%v, 1), self%inputs, size(self%v, 1), &
                    0.0_wp, b, n)
         if (.not. all_shapes) then
            do i = 1, n_inputs
               b(:, i) = b(:, i)/max(norm2(b(:, i)), tiny(1.0_wp))
            end do
         end if
         call find_modes(self, n, theta, u)
         b = matmul(transpose(u), b)
         x = cmplx(b, kind=wp)
         allocate (remainder_of_damping(0, 0), remainder_of_stiffness(0, 0))
         if (allocated(self%damping)) remainder_of_damping = matmul(transpose(u), matmul(self%damping(:n, :n), u))
         if (allocated(self%stiffness)) remainder_of_stiffness = matmul(transpose(u), matmul(self%stiffness(:n, :n), u))
         do i = 1, size(frequencies)
            if (work_is_over()) return                                ! who extends the basis ends, too
            associate (w => frequencies(i))
               of_k = cmplx(1.0_wp, w*self%beta, wp)
               of_m = cmplx(-w**2, w*self%alpha, wp)
               if (allocated(self%damping) .or. allocated(self%stiffness)) then
                  allocate (s(n, n), source=(0.0_wp, 0.0_wp))
                  if (allocated(self%damping)) s = s + cmplx(0.0_wp, w, wp)*remainder_of_damping
                  if (allocated(self%stiffness)) s = s + remainder_of_stiffness
                  do k = 1, n
                     s(k, k) = s(k, k) + of_k*(1.0_wp - self%shift*theta(k)) + of_m*theta(k)
                  end do
                  x = cmplx(b, kind=wp)
                  call zgetrf(n, n, s, n, pivots, info)
                  call zgetrs("N", n, n_inputs, s, n, pivots, x, n, info)
                  deallocate (s)
               else
                  do k = 1, n
                     x(k, :) = b(k, :)/(of_k*(1.0_wp - self%shift*theta(k)) + of_m*theta(k))
                  end do
               end if
               if (all_shapes) then
                  flexibility(:, :, i) = matmul(u, x)
               else
                  flexibility(:, :, i) = matmul(transpose(b), x)
               end if
            end associate
         end do
      end associate
   end subroutine find_flexibility

   !> Bytes that the factors take.
   pure real(wp) function krylov_basis_bytes_of_factors(self) result(bytes)
      class(krylov_basis_t), intent(in) :: self

      bytes = self%factors%bytes
   end function krylov_basis_bytes_of_factors

   !> Gives back what the factors take.
   subroutine krylov_basis_destroy(self)
      class(krylov_basis_t), intent(inout) :: self

      call self%factors%destroy()
   end subroutine krylov_basis_destroy
end module hb_krylov_basis
