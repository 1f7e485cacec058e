!> GMRES: solves J s = b from products with J alone, preconditioned from the right, with restarts.
!>
!> Works on b/r_scale, so that it minimises the residual measured by Newton's method. Orthogonalises by classical
!> Gram-Schmidt, twice if cancellation occurs: as accurate as the modified form, and suited to matrix-vector products.
!> Further right-hand sides with the same J reuse the products for the first: their projection is solved for at once,
!> and removed from all further products (GCRO). Source: docs/why/theory.md, section 6.6; Saad and Schultz, SIAM J.
!> Sci. Stat. Comput. 7 (1986) 856-869; Giraud, Langou, Rozloznik, van den Eshof, Numer. Math. 101 (2005) 87-100
!> (twice is enough); de Sturler, J. Comput. Appl. Math. 67 (1996) 15-41.
module hb_gmres
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_assert, only: assert, asserts_are_on
   use hb_cancellation, only: work_is_over
   use hb_kinds, only: wp
   use hb_lapack, only: dgemv, dnrm2
   use hb_problem, only: problem_t
   implicit none
   private
   public :: gmres_t, new_gmres

   real(wp), parameter :: exhausted_remainder = 100*epsilon(1.0_wp)   ! remainder of a product that adds no direction

   real(wp), parameter :: cancellation_ratio = 0.1_wp ! remainder of a product below which it is orthogonalised again

   type :: gmres_t
      integer :: n_products = 0                                       !! of the last `solve`
      logical :: is_slow = .false.                                    !! the last `solve` ended because of `fewer_than`
      real(wp) :: residual = 0.0_wp                                   !! |b - J s|/|b| of the last `solve`, scaled; 1: no step helps
      real(wp), allocatable, private :: basis(:, :)                   ! (n_unknowns, n_vectors + 1), orthonormal
      real(wp), allocatable, private :: h(:, :)                       ! (n_vectors + 1, n_vectors) triangular after rotations
      real(wp), allocatable, private :: cosine(:), sine(:), g(:), y(:), again(:)
      real(wp), allocatable, private :: work(:), direction(:)         ! (n_unknowns)
      integer, private :: n_retained = 0                              ! products with J from previous solutions: columns of
                                                                      !! `h`, and one more of `basis`
      real(wp), allocatable, private :: g_kept(:)                     ! (n_vectors) component of the residual in their space
      real(wp), allocatable, private :: h_kept(:, :)                  ! (n_vectors, n_vectors) and of the products that follow;
                                                                      !! from the first of them on
   contains
      procedure :: forget => gmres_forget
      procedure :: solve => gmres_solve
      procedure, private :: cycle => gmres_cycle
      procedure, private :: remove_recycled => gmres_remove_recycled
      procedure, private :: add_solution => gmres_add_solution
   end type gmres_t

contains

   !> Allocates memory for `n` unknowns and restarts after `n_vectors` products.
   subroutine new_gmres(self, n, n_vectors)
      type(gmres_t), intent(out) :: self
      integer, intent(in) :: n, n_vectors

      associate (m => min(n, n_vectors))
         allocate (self%basis(n, m + 1), self%h(m + 1, m), self%cosine(m), self%sine(m), self%g(m + 1), self%y(m))
         allocate (self%again(m + 1), self%g_kept(m))
      end associate
      allocate (self%work(n), self%direction(n))
   end subroutine new_gmres

   !> Discards the products of previous solutions; call it if the tangent or its preconditioner changes.
   pure subroutine gmres_forget(self)
      class(gmres_t), intent(inout) :: self

      self%n_retained = 0
   end subroutine gmres_forget

   !> Solves with the tangent of the last `problem%linearise`, from the given s, to |b - J s| <= tolerance |b| or as far as
   !> `max_products` go.
   !>
   !> Ends early if a whole cycle reduces the residual hardly at all: J is singular, or the preconditioner too weak.
   !> With `fewer_than` it also ends if, after at least half as many products, the rate of the last ones predicts
   !> clearly more than that: GMRES accelerates as it finds the outlying eigenvalues.
   subroutine gmres_solve(self, problem, b, tolerance, max_products, s, fewer_than)
      class(gmres_t), intent(inout) :: self
      class(problem_t), intent(inout) :: problem
      real(wp), intent(in), contiguous :: b(:)                        !! (n_unknowns)
      real(wp), intent(in) :: tolerance
      integer, intent(in) :: max_products
      real(wp), intent(inout), contiguous :: s(:)                     !! (n_unknowns)
      integer, intent(in), optional :: fewer_than                     !! products
      real(wp), parameter :: max_cycle_reduction = 0.9_wp             ! reduction of a cycle that justifies another one
      real(wp) :: before, norm, norm_of_b
      integer :: slow_from

      if (asserts_are_on) call assert(size(b) == size(self%work) .and. size(s) == size(b), &
                                      "gmres_solve", "vectors of the size of new_gmres")
      slow_from = huge(1)
      if (present(fewer_than)) slow_from = (3*fewer_than)/2           ! with a margin: a rate is no guarantee
      self%is_slow = .false.
      self%n_products = 0
      self%residual = 0.0_wp
      self%work = b/problem%r_scale
      norm_of_b = dnrm2(size(b), self%work, 1)
      if (norm_of_b <= 0.0_wp) then
         s = 0.0_wp
         return
      end if
      self%residual = 1.0_wp
      if (.not. ieee_is_finite(norm_of_b)) return
      norm = norm_of_b
      if (any(abs(s) > 0.0_wp)) call find_residual()
      do
         if (.not. ieee_is_finite(norm)) return
         self%residual = norm/norm_of_b
         if (norm <= tolerance*norm_of_b .or. self%n_products >= max_products) return
         before = norm
         call self%cycle(problem, norm, tolerance*norm_of_b, max_products, slow_from, s)
         self%residual = norm/norm_of_b
         if (self%is_slow) return
         if (norm <= tolerance*norm_of_b .or. self%n_products >= max_products) return
         if (.not. norm <= max_cycle_reduction*before) return
         call self%forget()
         call find_residual()                                         ! recomputed: the values from rotations drift
      end do

   contains

      subroutine find_residual()
         call problem%apply_tangent(s, self%work)
         self%work = (b - self%work)/problem%r_scale
         self%n_products = self%n_products + 1
         norm = dnrm2(size(b), self%work, 1)
      end subroutine find_residual
   end subroutine gmres_solve

   !> One cycle: from the residual `work` of length `norm` to the smallest in the space; adds to s.
   subroutine gmres_cycle(self, problem, norm, target, max_products, slow_from, s)
      class(gmres_t), intent(inout) :: self
      class(problem_t), intent(inout) :: problem
      real(wp), intent(inout) :: norm
      real(wp), intent(in) :: target
      integer, intent(in) :: max_products
      integer, intent(in) :: slow_from                                !! total number of expected products that is too large
      real(wp), intent(inout) :: s(:)
      integer, parameter :: products_of_rate = 6                      ! products for a rate, after as many others
      integer :: i, j, k, n
      real(wp) :: a, length

      n = size(self%basis, 1)
      k = self%n_retained
      if (k > 0) then
         if (.not. allocated(self%h_kept)) allocate (self%h_kept(size(self%y), size(self%y)))
         call self%remove_recycled(self%g_kept)
         norm = dnrm2(n, self%work, 1)
         k = k + 1                                                    ! vectors
      end if
      self%g = 0.0_wp
      self%g(1) = norm
      if (norm > 0.0_wp) self%basis(:, k + 1) = self%work/norm
      j = 0
      do while (k + j < size(self%y) .and. norm > target .and. self%n_products < max_products)
         if (work_is_over()) exit
         self%work = self%basis(:, k + j + 1)*problem%r_scale
         call problem%precondition(self%work, self%direction)
         call problem%apply_tangent(self%direction, self%work)
         self%work = self%work/problem%r_scale
         self%n_products = self%n_products + 1
         if (k > 0) call self%remove_recycled(self%h_kept(:, j + 1))
         length = dnrm2(n, self%work, 1)
         if (.not. ieee_is_finite(length)) exit
         j = j + 1
         associate (h => self%h(:, k + j))
            call orthogonalise(self, k, j, length, h)
            self%basis(:, k + j + 1) = self%work/merge(h(j + 1), 1.0_wp, h(j + 1) > 0.0_wp)
            do i = 1, j - 1
               call rotate(self%cosine(k + i), self%sine(k + i), h(i), h(i + 1))
            end do
            a = hypot(h(j), h(j + 1))
            if (a <= exhausted_remainder*length) then                 ! this product adds no direction: J is singular
               j = j - 1
               exit
            end if
            self%cosine(k + j) = h(j)/a
            self%sine(k + j) = h(j + 1)/a
            length = h(j + 1)
            h(j) = a
         end associate
         self%g(j + 1) = -self%sine(k + j)*self%g(j)
         self%g(j) = self%cosine(k + j)*self%g(j)
         norm = abs(self%g(j + 1))
         if (length <= 0.0_wp) exit                                   ! the space contains the solution
         if (j < max(2*products_of_rate, slow_from/3) .or. norm <= target) cycle
         self%is_slow = log(norm/target) > pace_of(self%sine(k + j - products_of_rate + 1:k + j))*(slow_from - self%n_products)
         if (self%is_slow) exit
      end do
      if (k + j > 0) call self%add_solution(problem, j, s)
      if (k == 0) self%n_retained = min(j, size(self%y)/2)            ! leave memory for others
   end subroutine gmres_cycle

   !> Decrease of the logarithm of the residual per product over the last products.
   pure real(wp) function pace_of(sines)
      real(wp), intent(in) :: sines(:)                                !! of the rotations: reduction of the residual

      pace_of = -sum(log(max(tiny(1.0_wp), abs(sines))))/size(sines)
   end function pace_of

   !> Orthogonalises the product against the first j vectors of the present cycle, twice if most of it cancels.
   subroutine orthogonalise(self, k, j, length, h)
      class(gmres_t), intent(inout) :: self
      integer, intent(in) :: k                                        !! vectors stored from previous cycles
      integer, intent(in) :: j
      real(wp), intent(in) :: length                                  !! of the product
      real(wp), intent(inout), contiguous :: h(:)                     !! column of the Hessenberg matrix
      integer :: n

      n = size(self%basis, 1)
      call dgemv("T", n, j, 1.0_wp, self%basis(1, k + 1), n, self%work, 1, 0.0_wp, h, 1)
      call dgemv("N", n, j, -1.0_wp, self%basis(1, k + 1), n, h, 1, 1.0_wp, self%work, 1)
      h(j + 1) = dnrm2(n, self%work, 1)
      if (h(j + 1) < cancellation_ratio*length) then
         call dgemv("T", n, j, 1.0_wp, self%basis(1, k + 1), n, self%work, 1, 0.0_wp, self%again, 1)
         call dgemv("N", n, j, -1.0_wp, self%basis(1, k + 1), n, self%again, 1, 1.0_wp, self%work, 1)
         h(1:j) = h(1:j) + self%again(1:j)
         h(j + 1) = dnrm2(n, self%work, 1)
      end if
      if (h(j + 1) <= exhausted_remainder*length) h(j + 1) = 0.0_wp
   end subroutine orthogonalise

   !> Removes from `work` its projection onto the stored products: the space spanned by the first columns of `basis`,
   !> rotated, except for the last.
   subroutine gmres_remove_recycled(self, along)
      class(gmres_t), intent(inout) :: self
      real(wp), intent(out) :: along(:)                               !! its component along each of them
      integer :: i, n

      n = size(self%basis, 1)
      associate (k => self%n_retained, c => self%again)
         call dgemv("T", n, k + 1, 1.0_wp, self%basis, n, self%work, 1, 0.0_wp, c, 1)
         do i = 1, k
            call rotate(self%cosine(i), self%sine(i), c(i), c(i + 1))
         end do
         along(:k) = c(:k)
         c(k + 1) = 0.0_wp
         do i = k, 1, -1
            call rotate(self%cosine(i), -self%sine(i), c(i), c(i + 1))
         end do
         call dgemv("N", n, k + 1, -1.0_wp, self%basis, n, c, 1, 1.0_wp, self%work, 1)
      end associate
   end subroutine gmres_remove_recycled

   pure subroutine rotate(cosine, sine, a, b)
      real(wp), intent(in) :: cosine, sine
      real(wp), intent(inout) :: a, b
      real(wp) :: before

      before = a
      a = cosine*a + sine*b
      b = cosine*b - sine*before
   end subroutine rotate

   !> Adds the combination of the first j vectors, and the stored ones, with the smallest residual.
   subroutine gmres_add_solution(self, problem, j, s)
      class(gmres_t), intent(inout) :: self
      class(problem_t), intent(inout) :: problem
      integer, intent(in) :: j
      real(wp), intent(inout) :: s(:)
      integer :: i, n

      n = size(s)
      associate (k => self%n_retained, base => merge(self%n_retained + 1, 0, self%n_retained > 0), y => self%y, h => self%h)
         do i = j, 1, -1
            y(base + i) = (self%g(i) - dot_product(h(i, base + i + 1:base + j), y(base + i + 1:base + j)))/h(i, base + i)
         end do
         self%work = 0.0_wp
         call dgemv("N", n, j, 1.0_wp, self%basis(1, base + 1), n, y(base + 1), 1, 1.0_wp, self%work, 1)
         if (k > 0) then
            y(:k) = self%g_kept(:k) - matmul(self%h_kept(:k, :j), y(base + 1:base + j))
            do i = k, 1, -1
               y(i) = (y(i) - dot_product(h(i, i + 1:k), y(i + 1:k)))/h(i, i)
            end do
            call dgemv("N", n, k, 1.0_wp, self%basis, n, y, 1, 1.0_wp, self%work, 1)
         end if
      end associate
      self%work = self%work*problem%r_scale
      call problem%precondition(self%work, self%direction)
      s = s + self%direction
   end subroutine gmres_add_solution
end module hb_gmres
