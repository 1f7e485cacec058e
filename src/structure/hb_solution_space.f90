!> Solutions of S(w) x = b at many frequencies from one small space, as exact as by factors of S at each of them.
!>
!> S(w) = K + i w D - (w**2 + i drive) M. The space holds real vectors; in it x is found by Galerkin's condition, and its residual
!> in all rows decides whether it is a solution: if not, the space is extended by K_s**-1 times the residual, K_s = K + s**2 M, of
!> which one real factor serves all frequencies. Solutions at neighbouring frequencies are nearly in the space then. These are
!> the spaces of a preconditioned Krylov method, reused from one frequency to the next: M. Parks, E. de Sturler et al., SIAM J. Sci.
!> Comput. 28 (2006) 1651-1674; nothing is assumed of D, and K_s only needs to be definite.
!>
!> What is found depends on the matrices and on the frequencies and right-hand sides since `begin`, never on earlier ones.
module hb_solution_space
   use hb_kinds, only: wp
   use hb_lapack, only: dgemm, dpotrf, dpotrs, zgetrf, zgetrs
   use hb_structure_block, only: structure_block_t
   use hb_umfpack, only: umfpack_t
   implicit none
   private
   public :: pays_to_span, solution_space_t

   integer, parameter :: min_order = 100                     ! of a block; the factors of smaller ones take less time
   integer, parameter :: min_systems = 8                     ! frequencies for which a space is worth it
   integer, parameter :: vectors_per_side = 20               ! for each right-hand side, about
   real(wp), parameter :: largest_share = 0.4_wp             ! of the order of the block that the space may have
   integer, parameter :: largest_space = 400                 ! vectors
   integer, parameter :: max_failures = 3                    ! systems that the space does not solve, before it is given up
   integer, parameter :: max_extensions = 60                 ! for one system
   real(wp), parameter :: shift_share = 0.1_wp               ! s relative to the highest frequency
   real(wp), parameter :: exact_residual = 1.0e-13_wp        ! residual relative to the terms of which it is the difference
   real(wp), parameter :: min_independent_part = 1.0e-8_wp   ! part of a vector outside the space, below which it is in it

   type :: part_t
      integer :: stiffness = 1, damping = 2, mass = 3
   end type part_t
   type(part_t), parameter :: part = part_t()

   !> Owner of memory of a library if the matrices are sparse: call `end`.
   type :: solution_space_t
      logical :: is_on = .false.                             !! can be used at present
      integer, private :: n = 0, m = 0                       ! rows; vectors
      integer, private :: max_vectors = 0, n_failures = 0
      integer, allocatable, private :: first(:), column(:)   ! entries by rows
      real(wp), allocatable, private :: entries(:, :)        ! of the three matrices, (3, n_entries)
      logical, private :: is_there(3) = .false.              ! the matrix is not zero
      real(wp), private :: norms(3) = 0.0_wp                 ! largest sums of magnitudes in a row
      real(wp), private :: tolerance = exact_residual
      real(wp), allocatable, private :: factor(:, :)         ! Cholesky's of K_s, or
      logical, private :: is_sparse = .false.
      type(umfpack_t), private :: factors                    ! those of a sparse one
      real(wp), allocatable, private :: basis(:, :)          ! V, orthonormal, (n, max_vectors)
      real(wp), allocatable, private :: products(:, :, :)    ! K V, D V, M V, (n, max_vectors, 3)
      real(wp), allocatable, private :: reduced(:, :, :)     ! V^T K V and so on, (max_vectors, max_vectors, 3)
   contains
      procedure :: begin => solution_space_begin
      procedure :: end => solution_space_end
      procedure :: learn => solution_space_learn
      procedure :: solve => solution_space_solve
      procedure :: size_of_terms => solution_space_size_of_terms
   end type solution_space_t

contains

   !> Whether a space takes less time than factors of a block that is not narrow, for some right-hand sides at each of many
   !> frequencies.
   pure logical function pays_to_span(n, n_rhs, n_systems) result(pays)
      integer, intent(in) :: n                               !! order of the block
      integer, intent(in) :: n_rhs, n_systems

      pays = n >= min_order .and. n_systems >= min_systems
      if (pays) pays = real(vectors_per_side, wp)*n_rhs <= min(largest_share*n, real(largest_space, wp))
   end function pays_to_span

   !> Starts an empty space; it remains off if K_s is not positive definite.
   subroutine solution_space_begin(self, n, block, highest_frequency, first, by_column)
      class(solution_space_t), intent(inout) :: self
      integer, intent(in) :: n                               !! order of the block
      type(structure_block_t), intent(in) :: block           !! scaled, so that diagonals are about 1
      real(wp), intent(in) :: highest_frequency              !! [rad/s], of the systems, > 0
      integer, intent(in), optional :: first(:), by_column(:) !! (n + 1), (n_entries): a sparse block, sorted by columns; default:
                                                             !! K_s is a full matrix
      logical :: is_definite

      call self%end()
      if (allocated(block%parts) .or. .not. highest_frequency > 0.0_wp) return
      self%n = n
      self%m = 0
      self%n_failures = 0
      self%is_sparse = present(first)
      self%max_vectors = min(largest_space, int(largest_share*n))
      self%tolerance = max(exact_residual, epsilon(1.0_wp)*sqrt(real(n, wp)))
      if (.not. allocated(self%first)) call sort_by_row(self, block)
      if (self%is_sparse) then
         call factorise_sparse(self, block, (shift_share*highest_frequency)**2, first, by_column, is_definite)
      else
         call factorise_full(self, block, (shift_share*highest_frequency)**2, is_definite)
      end if
      self%is_on = is_definite
      if (.not. is_definite) return
      if (.not. allocated(self%basis)) allocate (self%basis(n, self%max_vectors), self%products(n, self%max_vectors, 3), &
                                                 self%reduced(self%max_vectors, self%max_vectors, 3))
   end subroutine solution_space_begin

   !> Frees the memory of the library; nothing can be solved until the next `begin`.
   subroutine solution_space_end(self)
      class(solution_space_t), intent(inout) :: self

      if (self%is_sparse) call self%factors%destroy()
      self%is_on = .false.
   end subroutine solution_space_end

   !> Copies the entries, row by row.
   subroutine sort_by_row(self, block)
      type(solution_space_t), intent(inout) :: self
      type(structure_block_t), intent(in) :: block
      integer, allocatable :: next(:)
      integer :: e, i

      allocate (self%first(self%n + 1), source=0)
      allocate (self%column(block%n_entries), self%entries(3, block%n_entries))
      do e = 1, block%n_entries
         self%first(block%row(e) + 1) = self%first(block%row(e) + 1) + 1
      end do
      self%first(1) = 1
      do i = 1, self%n
         self%first(i + 1) = self%first(i) + self%first(i + 1)
      end do
      next = self%first
      do e = 1, block%n_entries
         associate (k => next(block%row(e)))
            self%column(k) = block%column(e)
            self%entries(:, k) = [block%stiffness(e), block%damping(e), block%mass(e)]
            k = k + 1
         end associate
      end do
      do i = 1, self%n
         self%norms = max(self%norms, sum(abs(self%entries(:, self%first(i):self%first(i + 1) - 1)), dim=2))
      end do
      self%is_there = self%norms > 0.0_wp
   end subroutine sort_by_row

   !> Factorises K_s as a full symmetric matrix.
   subroutine factorise_full(self, block, shift, is_definite)
      type(solution_space_t), intent(inout) :: self
      type(structure_block_t), intent(in) :: block
      real(wp), intent(in) :: shift                          !! s**2
      logical, intent(out) :: is_definite
      integer :: e, info

      if (.not. allocated(self%factor)) allocate (self%factor(self%n, self%n))
      self%factor = 0.0_wp
      do e = 1, block%n_entries
         self%factor(block%row(e), block%column(e)) = block%stiffness(e) + shift*block%mass(e)
      end do
      call dpotrf("L", self%n, self%factor, self%n, info)
      is_definite = info == 0
   end subroutine factorise_full

   !> Factorises K_s as a sparse matrix.
   subroutine factorise_sparse(self, block, shift, first, by_column, is_done)
      type(solution_space_t), intent(inout) :: self
      type(structure_block_t), intent(in) :: block
      real(wp), intent(in) :: shift                          !! s**2
      integer, intent(in) :: first(:), by_column(:)
      logical, intent(out) :: is_done

      is_done = self%factors%analyse(first, block%row(by_column))
      if (is_done) is_done = self%factors%factorise(cmplx(block%stiffness(by_column) + shift*block%mass(by_column), kind=wp))
   end subroutine factorise_sparse

   !> Extends the space by what solves some systems at once, which takes less time than one after the other.
   subroutine solution_space_learn(self, frequencies, drives, b)
      class(solution_space_t), intent(inout) :: self
      real(wp), intent(in) :: frequencies(:), drives(:)      !! [rad/s], [rad**2/s**2], (n_systems)
      complex(wp), intent(in) :: b(:, :, :)                  !! right-hand sides, (n, n_rhs, n_systems)
      complex(wp) :: residual(self%n, size(b, 2)), y(self%max_vectors, size(b, 2))
      real(wp), allocatable :: wanted(:, :)
      logical :: is_exact(size(b, 2))
      integer :: i, k, n_wanted, pass

      if (.not. self%is_on) return
      allocate (wanted(self%n, 2*size(b, 2)*size(b, 3)))
      do pass = 1, max_extensions
         n_wanted = 0
         do k = 1, size(b, 3)
            call project(self, frequencies(k), drives(k), b(:, :, k), y, residual, is_exact)
            do i = 1, size(b, 2)
               if (.not. is_exact(i)) call add_parts(residual(:, i), wanted, n_wanted)
            end do
         end do
         if (n_wanted == 0) return
         call extend(self, wanted(:, :n_wanted), k)
         if (k == 0) return
      end do
   end subroutine solution_space_learn

   !> Solves S x = b in place, if the space can be extended so that it has the solution; otherwise b is unchanged.
   subroutine solution_space_solve(self, frequency, drive, b, is_solved)
      class(solution_space_t), intent(inout) :: self
      real(wp), intent(in) :: frequency                      !! [rad/s], of any sign
      real(wp), intent(in) :: drive                          !! [rad**2/s**2]
      complex(wp), intent(inout), contiguous :: b(:, :)      !! (n, any)
      logical, intent(out) :: is_solved
      complex(wp) :: residual(self%n, size(b, 2)), y(self%max_vectors, size(b, 2))
      real(wp) :: wanted(self%n, 2*size(b, 2))
      logical :: is_exact(size(b, 2))
      integer :: i, n_new, n_wanted, pass

      is_solved = .false.
      if (.not. self%is_on) return
      do pass = 1, max_extensions
         call project(self, frequency, drive, b, y, residual, is_exact)
         is_solved = all(is_exact)
         if (is_solved) exit
         n_wanted = 0
         do i = 1, size(b, 2)
            if (.not. is_exact(i)) call add_parts(residual(:, i), wanted, n_wanted)
         end do
         call extend(self, wanted(:, :n_wanted), n_new)
         if (n_new == 0) exit
      end do
      if (is_solved) then
         call multiply(self%basis, self%m, y, b)
      else
         self%n_failures = self%n_failures + 1
         self%is_on = self%n_failures < max_failures
      end if
   end subroutine solution_space_solve

   !> Bound of the norm of the terms of S before cancellation.
   pure real(wp) function solution_space_size_of_terms(self, frequency, drive) result(bound)
      class(solution_space_t), intent(in) :: self
      real(wp), intent(in) :: frequency, drive               !! [rad/s], [rad**2/s**2]

      bound = sum(abs(factors_of(frequency, drive))*self%norms)
   end function solution_space_size_of_terms

   !> Factors of stiffness, damping and mass in S.
   pure function factors_of(frequency, drive) result(factors)
      real(wp), intent(in) :: frequency, drive
      complex(wp) :: factors(3)

      factors(part%stiffness) = (1.0_wp, 0.0_wp)
      factors(part%damping) = cmplx(0.0_wp, frequency, wp)
      factors(part%mass) = -cmplx(frequency**2, drive, wp)
   end function factors_of

   !> Galerkin's solution, and what it leaves of the right-hand sides.
   subroutine project(self, frequency, drive, b, y, residual, is_exact)
      class(solution_space_t), intent(in) :: self
      real(wp), intent(in) :: frequency, drive
      complex(wp), intent(in) :: b(:, :)                     !! (n, n_rhs)
      complex(wp), intent(out) :: y(:, :)                    !! in the first m rows, (max_vectors, n_rhs)
      complex(wp), intent(out) :: residual(:, :)             !! as b
      logical, intent(out) :: is_exact(:)                    !! (n_rhs)
      complex(wp) :: factors(3), product(size(b, 1), size(b, 2))
      complex(wp), allocatable :: a(:, :)
      integer, allocatable :: pivots(:)
      real(wp) :: size_of_terms
      integer :: i, info, p

      residual = b
      y = (0.0_wp, 0.0_wp)
      factors = factors_of(frequency, drive)
      associate (m => self%m)
         if (m > 0) then
            allocate (a(m, m), pivots(m))
            a = self%reduced(:m, :m, part%stiffness) + factors(part%mass)*self%reduced(:m, :m, part%mass)
            if (self%is_there(part%damping)) a = a + factors(part%damping)*self%reduced(:m, :m, part%damping)
            call multiply_transposed(self%basis, m, b, y)
            call zgetrf(m, m, a, m, pivots, info)
            if (info == 0) call zgetrs("N", m, size(b, 2), a, m, pivots, y, size(y, 1), info)
            if (info /= 0) y = (0.0_wp, 0.0_wp)
            do p = 1, 3
               if (.not. self%is_there(p)) cycle
               call multiply(self%products(:, :, p), m, y, product)
               residual = residual - factors(p)*product
            end do
         end if
      end associate
      size_of_terms = self%size_of_terms(frequency, drive)
      do i = 1, size(b, 2)
         is_exact(i) = length_of(residual(:, i)) <= self%tolerance*(length_of(b(:, i)) + size_of_terms*length_of(y(:, i)))
      end do
   end subroutine project

   !> Extends the space by K_s**-1 times vectors, as far as that is not in it.
   subroutine extend(self, wanted, n_new)
      class(solution_space_t), intent(inout) :: self
      real(wp), intent(inout), contiguous :: wanted(:, :)    !! (n, any), lost
      integer, intent(out) :: n_new                          !! vectors by which it has grown
      real(wp) :: overlap(self%max_vectors), norm
      integer :: before, i, info, pass

      if (self%is_sparse) then
         call solve_sparse(self, wanted)
      else
         call dpotrs("L", self%n, size(wanted, 2), self%factor, self%n, wanted, self%n, info)
      end if
      before = self%m
      do i = 1, size(wanted, 2)
         if (self%m == self%max_vectors) exit
         associate (v => wanted(:, i), m => self%m)
            norm = norm2(v)
            if (.not. norm > 0.0_wp) cycle
            v = v/norm
            do pass = 1, 2
               call dgemm("T", "N", m, 1, self%n, 1.0_wp, self%basis, self%n, v, self%n, 0.0_wp, overlap, size(overlap))
               call dgemm("N", "N", self%n, 1, m, -1.0_wp, self%basis, self%n, overlap, size(overlap), 1.0_wp, v, self%n)
            end do
            norm = norm2(v)
            if (.not. norm > min_independent_part) cycle
            v = v/norm
            call dgemm("T", "N", m, 1, self%n, 1.0_wp, self%basis, self%n, v, self%n, 0.0_wp, overlap, size(overlap))
            call dgemm("N", "N", self%n, 1, m, -1.0_wp, self%basis, self%n, overlap, size(overlap), 1.0_wp, v, self%n)
            self%basis(:, m + 1) = v/norm2(v)
            m = m + 1
         end associate
      end do
      n_new = self%m - before
      if (n_new > 0) call add_products(self, before)
   end subroutine extend

   !> The products of the vectors behind the first ones, and what they add to the reduced matrices.
   subroutine add_products(self, before)
      class(solution_space_t), intent(inout) :: self
      integer, intent(in) :: before                          !! vectors whose products are there
      integer, parameter :: at_once = 8                      ! the entries of a full matrix are read that many times less
      real(wp) :: sums(3, at_once)
      integer :: e, i, k, p, start, stop

      do start = before + 1, self%m, at_once
         stop = min(self%m, start + at_once - 1)
         do i = 1, self%n
            sums = 0.0_wp
            do e = self%first(i), self%first(i + 1) - 1
               do k = start, stop
                  sums(:, k - start + 1) = sums(:, k - start + 1) + self%entries(:, e)*self%basis(self%column(e), k)
               end do
            end do
            do p = 1, 3
               self%products(i, start:stop, p) = sums(p, :stop - start + 1)
            end do
         end do
      end do
      associate (n => self%n, m => self%m, ld => self%max_vectors)
         do p = 1, 3
            if (.not. self%is_there(p)) cycle
            call dgemm("T", "N", m, m - before, n, 1.0_wp, self%basis, n, self%products(1, before + 1, p), n, 0.0_wp, &
                       self%reduced(1, before + 1, p), ld)
            call dgemm("T", "N", m - before, before, n, 1.0_wp, self%basis(1, before + 1), n, self%products(1, 1, p), n, 0.0_wp, &
                       self%reduced(before + 1, 1, p), ld)
         end do
      end associate
   end subroutine add_products

   !> Overwrites vectors by the solutions with the sparse factors of K_s: two real ones at once.
   subroutine solve_sparse(self, wanted)
      class(solution_space_t), intent(in) :: self
      real(wp), intent(inout) :: wanted(:, :)
      complex(wp) :: pair(self%n)
      integer :: i, other

      do i = 1, size(wanted, 2), 2
         other = min(i + 1, size(wanted, 2))
         pair = cmplx(wanted(:, i), wanted(:, other), wp)
         call self%factors%solve(pair, of_transpose=.false., is_refined=.false.)
         wanted(:, i) = real(pair)
         if (other > i) wanted(:, other) = aimag(pair)
      end do
   end subroutine solve_sparse

   !> Appends real and imaginary part of a vector, if they are not zero.
   pure subroutine add_parts(z, list, n_list)
      complex(wp), intent(in) :: z(:)
      real(wp), intent(inout) :: list(:, :)
      integer, intent(inout) :: n_list

      if (any(abs(real(z)) > 0.0_wp)) then
         n_list = n_list + 1
         list(:, n_list) = real(z)
      end if
      if (any(abs(aimag(z)) > 0.0_wp)) then
         n_list = n_list + 1
         list(:, n_list) = aimag(z)
      end if
   end subroutine add_parts

   !> The product of the first m columns of a real matrix with the first m rows of complex ones.
   subroutine multiply(a, m, y, product)
      real(wp), intent(in), contiguous :: a(:, :)            !! (n, at least m)
      integer, intent(in) :: m
      complex(wp), intent(in) :: y(:, :)                     !! (at least m, any)
      complex(wp), intent(out) :: product(:, :)              !! (n, any)
      real(wp) :: left(m, 2*size(y, 2)), right(size(a, 1), 2*size(y, 2))
      integer :: n

      n = size(y, 2)
      left(:, :n) = real(y(:m, :))
      left(:, n + 1:) = aimag(y(:m, :))
      call dgemm("N", "N", size(a, 1), 2*n, m, 1.0_wp, a, size(a, 1), left, max(1, m), 0.0_wp, right, size(a, 1))
      product = cmplx(right(:, :n), right(:, n + 1:), wp)
   end subroutine multiply

   !> The products of the first m columns of a real matrix with complex columns.
   subroutine multiply_transposed(a, m, b, product)
      real(wp), intent(in), contiguous :: a(:, :)            !! (n, at least m)
      integer, intent(in) :: m
      complex(wp), intent(in) :: b(:, :)                     !! (n, any)
      complex(wp), intent(inout) :: product(:, :)            !! in the first m rows
      real(wp) :: right(size(b, 1), 2*size(b, 2)), left(m, 2*size(b, 2))
      integer :: n

      n = size(b, 2)
      right(:, :n) = real(b)
      right(:, n + 1:) = aimag(b)
      call dgemm("T", "N", m, 2*n, size(a, 1), 1.0_wp, a, size(a, 1), right, size(a, 1), 0.0_wp, left, m)
      product(:m, :) = cmplx(left(:, :n), left(:, n + 1:), wp)
   end subroutine multiply_transposed

   pure real(wp) function length_of(z)
      complex(wp), intent(in) :: z(:)

      length_of = sqrt(sum(real(z)**2 + aimag(z)**2))
   end function length_of
end module hb_solution_space
