!> Solves with the tangent of a problem at one point: by its factors, or from products if it is large.
!>
!> The tangent of a problem, scaled to unit magnitudes and LU factorised by LAPACK.
!>
!> Solves with the tangent of a problem from products alone: GMRES, with a preconditioner that is strengthened if
!> GMRES does not converge. If products with the strongest one cost as much as the factors, these take their place.
!> Source: docs/why/theory.md, section 6.6.
module hb_tangent_solver
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_cancellation, only: work_is_over
   use hb_gmres, only: gmres_t, new_gmres
   use hb_kinds, only: wp
   use hb_lapack, only: dgetrf, dgetrs
   use hb_problem, only: default_largest_dense, problem_t
   use hb_solver_types, only: largest_affordable, solver_config_t
   implicit none
   private
   public :: new_tangent_factor, new_tangent_krylov, new_tangent_solver, tangent_factor_t, tangent_krylov_t, tangent_solver_t

   integer, parameter :: max_patience = 300                          ! products, if a stronger preconditioner costs more
   real(wp), parameter :: uses = 4.0_wp                               ! uses of a stronger preconditioner that pay for it
   integer, parameter :: easy = 20                                    ! products up to which it is reused

   type :: tangent_factor_t
      real(wp), allocatable, private :: jacobian(:, :)
      integer, allocatable, private :: pivots(:)
   contains
      procedure :: update => tangent_factor_update
      procedure :: solve => tangent_factor_solve
      procedure :: solve_transposed => tangent_factor_solve_transposed
      procedure :: determinant_sign => tangent_factor_determinant_sign
   end type tangent_factor_t

   type :: tangent_krylov_t
      integer :: max_products = 0                                    !! of one solution
      integer :: n_products = 0                                       !! of all solutions so far
      integer :: n_preconditioners = 0                                !! made so far
      real(wp) :: residual = 1.0_wp !! remaining residual of the last solution, relative; 1: there is none
      type(gmres_t), private :: gmres
      integer :: patience = 100 !! least number of products before the preconditioner is strengthened
      integer, private :: level = 0                                   ! of the preconditioner
      logical, private :: is_fresh = .false.                          ! computed for this tangent
      logical, private :: needs_update = .true.                       ! another one would save more products than it costs
      real(wp), private :: fresh_pace = 0.0_wp                        ! of the first solution with it, see `pace`
      logical, private :: is_strongest = .false.
      type(tangent_factor_t), allocatable, private :: factor          ! from the first tangent for which products cost more
      logical, private :: has_factor = .false.                        ! of this tangent
      real(wp), allocatable, private :: x(:)                          ! where the tangent is
   contains
      procedure :: update => tangent_krylov_update
      procedure :: solve => tangent_krylov_solve
      procedure, private :: update_preconditioner => tangent_krylov_update_preconditioner
      procedure, private :: is_outdated => tangent_krylov_is_outdated
      procedure, private :: products_of_factors => tangent_krylov_products_of_factors
      procedure, private :: solve_by_factors => tangent_krylov_solve_by_factors
   end type tangent_krylov_t

   real(wp), parameter :: default_accuracy = 1.0e-8_wp
   integer, parameter :: largest_of_many = 1500 ! unknowns up to which factors cost less than tens of solutions from products

   type :: tangent_solver_t
      type(tangent_factor_t), allocatable, private :: factor
      type(tangent_krylov_t), allocatable, private :: krylov
      real(wp), private :: accuracy = default_accuracy
      real(wp), allocatable, private :: null_vector(:), units(:)      ! removed from solutions, of length 1 in these units
   contains
      procedure :: determinant_sign => tangent_solver_determinant_sign
      procedure :: find_null_vector => tangent_solver_find_null_vector
      procedure :: leave_out_null_vector => tangent_solver_leave_out_null_vector
      procedure :: solve => tangent_solver_solve
      procedure :: solve_transposed => tangent_solver_solve_transposed
   end type tangent_solver_t

contains

   !> Prepares solutions with the tangent at x; `is_singular` if there are none.
   subroutine new_tangent_solver(self, problem, x, is_singular, accuracy, are_many)
      type(tangent_solver_t), intent(out) :: self
      class(problem_t), intent(inout) :: problem
      real(wp), intent(in), contiguous :: x(:)                        !! (n_unknowns)
      logical, intent(out) :: is_singular
      real(wp), intent(in), optional :: accuracy                      !! of solutions from products, default 1e-8
      logical, intent(in), optional :: are_many                       !! tens of solutions are needed; default no
      type(solver_config_t) :: config
      integer :: largest_dense
      logical :: is_ready

      largest_dense = default_largest_dense
      if (present(accuracy)) then
         self%accuracy = accuracy
         if (problem%has_preconditioner) largest_dense = min(largest_dense, problem%largest_dense)
      end if
      if (present(are_many)) largest_dense = merge(max(largest_dense, largest_of_many), largest_dense, are_many)
      if (problem%has_products .and. problem%n_unknowns > largest_dense) then
         allocate (self%krylov)
         call new_tangent_krylov(self%krylov, problem, config%krylov_vectors, config%krylov_products)
         call self%krylov%update(problem, x, is_ready)
         is_singular = .not. is_ready
      else
         allocate (self%factor)
         call new_tangent_factor(self%factor, problem%n_unknowns)
         call self%factor%update(problem, x, is_singular)
      end if
   end subroutine new_tangent_solver

   !> Sign of the determinant of the tangent, 1 or -1; 0 if it is not known.
   pure real(wp) function tangent_solver_determinant_sign(self)
      class(tangent_solver_t), intent(in) :: self

      tangent_solver_determinant_sign = 0.0_wp
      if (allocated(self%factor)) tangent_solver_determinant_sign = self%factor%determinant_sign()
   end function tangent_solver_determinant_sign

   !> Overwrites r with the solution s of tangent s = r. With products this is valid as long as the problem is not
   !> evaluated at another point; `is_singular` if they do not lead to a solution.
   subroutine tangent_solver_solve(self, problem, r, is_singular, guess)
      class(tangent_solver_t), intent(inout) :: self
      class(problem_t), intent(inout) :: problem
      real(wp), intent(inout), contiguous :: r(:)                     !! (n_unknowns)
      logical, intent(out) :: is_singular
      real(wp), intent(in), optional :: guess(:)                      !! of the solution: saves products (n_unknowns)
      real(wp), allocatable :: s(:)

      is_singular = .false.
      if (allocated(self%factor)) then
         call self%factor%solve(problem, r)
      else
         allocate (s(size(r)), source=0.0_wp)
         if (present(guess)) s = guess
         call self%krylov%solve(problem, r, self%accuracy, s, from_guess=.true.)
         is_singular = self%krylov%residual > sqrt(self%accuracy)
         r = s
      end if
      if (allocated(self%null_vector)) &
         r = r - dot_product(self%null_vector, r/self%units)*self%null_vector*self%units
   end subroutine tangent_solver_solve

   !> Overwrites r with the solution s of transpose(tangent) s = r; `is_known` is false without factors, which alone have
   !> such solutions.
   subroutine tangent_solver_solve_transposed(self, problem, r, is_known)
      class(tangent_solver_t), intent(in) :: self
      class(problem_t), intent(in) :: problem
      real(wp), intent(inout), contiguous :: r(:)                     !! (n_unknowns)
      logical, intent(out) :: is_known

      is_known = allocated(self%factor)
      if (is_known) call self%factor%solve_transposed(problem, r)
   end subroutine tangent_solver_solve_transposed

   !> Makes solutions with a tangent that is singular to rounding those without a component along its null vector.
   subroutine tangent_solver_leave_out_null_vector(self, problem, units)
      class(tangent_solver_t), intent(inout) :: self
      class(problem_t), intent(inout) :: problem
      real(wp), intent(in) :: units(:)                                !! of lengths (n_unknowns)
      real(wp) :: vector(size(units))
      logical :: is_found

      call self%find_null_vector(problem, units, spread(.true., 1, size(units)), 0.0_wp*units, vector, is_found)
      if (.not. is_found) return
      self%units = units
      self%null_vector = vector/units
   end subroutine tangent_solver_leave_out_null_vector

   !> A vector that a nearly singular tangent maps to nearly zero, within the entries of a mask and orthogonal to
   !> another vector: the best of several iterations of inverse iteration. Iterations need not converge monotonically:
   !> if damping shifts motions by a quarter of a period against residuals, the tangent alternates between the null
   !> vector and others.
   subroutine tangent_solver_find_null_vector(self, problem, units, mask, along, vector, is_found)
      class(tangent_solver_t), intent(inout) :: self
      class(problem_t), intent(inout) :: problem
      real(wp), intent(in) :: units(:)                                !! of lengths (n_unknowns)
      logical, intent(in) :: mask(:)
      real(wp), intent(in) :: along(:)                                !! in these units, of length 1 or 0
      real(wp), intent(out) :: vector(:)                              !! of length 1 in these units
      logical, intent(out) :: is_found
      integer, parameter :: n_rounds = 4
      real(wp) :: length, longest, next(size(units))
      integer :: i
      logical :: is_singular

      is_found = .false.
      longest = 0.0_wp
      next = cos([(real(i, wp), i=1, size(next))])
      call across(next)
      do i = 1, n_rounds
         if (.not. norm2(next) > 0.0_wp) return
         next = next/norm2(next)*problem%r_scale                      ! as a residual
         call self%solve(problem, next, is_singular)
         if (is_singular) return
         next = next/units
         call across(next)
         length = norm2(next)
         if (.not. length > longest) cycle
         longest = length
         vector = next/length*units
         is_found = .true.
      end do

   contains

      pure subroutine across(v)
         real(wp), intent(inout) :: v(:)

         v = merge(v, 0.0_wp, mask)
         v = v - dot_product(v, along)*along
      end subroutine across
   end subroutine tangent_solver_find_null_vector

   !> Allocates memory for `n` unknowns.
   subroutine new_tangent_factor(self, n)
      type(tangent_factor_t), intent(out) :: self
      integer, intent(in) :: n

      allocate (self%jacobian(n, n), self%pivots(n))
   end subroutine new_tangent_factor

   !> Factorises the tangent at x; `is_singular` if it has no inverse or is not finite.
   subroutine tangent_factor_update(self, problem, x, is_singular)
      class(tangent_factor_t), intent(inout) :: self
      class(problem_t), intent(inout) :: problem
      real(wp), intent(in), contiguous :: x(:)                        !! (n_unknowns)
      logical, intent(out) :: is_singular
      real(wp) :: row_factor(size(x)), size_of_all
      integer :: i, info, n

      n = problem%n_unknowns
      call problem%tangent(x, self%jacobian)
      row_factor = 1.0_wp/problem%r_scale
      size_of_all = 0.0_wp
      do i = 1, n
         self%jacobian(:, i) = self%jacobian(:, i)*(problem%x_scale(i)*row_factor)
         size_of_all = size_of_all + sum(abs(self%jacobian(:, i)))
      end do
      is_singular = .not. ieee_is_finite(size_of_all)
      if (is_singular) return                                         ! NaN must not reach LAPACK if exceptions stop it
      call dgetrf(n, n, self%jacobian, n, self%pivots, info)
      is_singular = info /= 0
   end subroutine tangent_factor_update

   !> Sign of the determinant of the tangent, 1 or -1, after an `update` that was not singular.
   pure real(wp) function tangent_factor_determinant_sign(self)
      class(tangent_factor_t), intent(in) :: self
      integer :: i

      tangent_factor_determinant_sign = 1.0_wp
      do i = 1, size(self%pivots)
         if (self%jacobian(i, i) < 0.0_wp .neqv. self%pivots(i) /= i) &
            tangent_factor_determinant_sign = -tangent_factor_determinant_sign
      end do
   end function tangent_factor_determinant_sign

   !> Overwrites r with the solution s of tangent s = r.
   subroutine tangent_factor_solve(self, problem, r)
      class(tangent_factor_t), intent(in) :: self
      class(problem_t), intent(in) :: problem
      real(wp), intent(inout), contiguous :: r(:)                     !! (n_unknowns)
      integer :: info, n

      n = problem%n_unknowns
      r = r/problem%r_scale
      call dgetrs("N", n, 1, self%jacobian, n, self%pivots, r, n, info)
      r = r*problem%x_scale
   end subroutine tangent_factor_solve

   !> Overwrites r with the solution s of transpose(tangent) s = r.
   subroutine tangent_factor_solve_transposed(self, problem, r)
      class(tangent_factor_t), intent(in) :: self
      class(problem_t), intent(in) :: problem
      real(wp), intent(inout), contiguous :: r(:)                     !! (n_unknowns)
      integer :: info, n

      n = problem%n_unknowns
      r = r*problem%x_scale
      call dgetrs("T", n, 1, self%jacobian, n, self%pivots, r, n, info)
      r = r/problem%r_scale
   end subroutine tangent_factor_solve_transposed

   !> Allocates memory for a problem; GMRES restarts after `n_vectors` products. Starts with the level of
   !> preconditioner that the last solutions of the problem needed.
   subroutine new_tangent_krylov(self, problem, n_vectors, max_products)
      type(tangent_krylov_t), intent(out) :: self
      class(problem_t), intent(in) :: problem
      integer, intent(in) :: n_vectors, max_products

      self%max_products = max_products
      self%level = problem%preconditioner_level
      self%needs_update = .not. problem%has_preconditioner
      call new_gmres(self%gmres, problem%n_unknowns, n_vectors)
   end subroutine new_tangent_krylov

   !> Changes to the tangent at x; `is_ready` is false if there are no products.
   subroutine tangent_krylov_update(self, problem, x, is_ready)
      class(tangent_krylov_t), intent(inout) :: self
      class(problem_t), intent(inout) :: problem
      real(wp), intent(in), contiguous :: x(:)                        !! (n_unknowns)
      logical, intent(out) :: is_ready

      self%residual = 1.0_wp
      self%x = x
      self%has_factor = .false.
      is_ready = .true.
      if (allocated(self%factor)) return
      call problem%linearise(x, is_ready)
      call self%gmres%forget()
      self%is_fresh = .false.
   end subroutine tangent_krylov_update

   !> Computes s with |b - J s| <= accuracy |b|, or as near as `max_products` permit: see `residual`.
   subroutine tangent_krylov_solve(self, problem, b, accuracy, s, from_guess)
      class(tangent_krylov_t), intent(inout) :: self
      class(problem_t), intent(inout) :: problem
      real(wp), intent(in), contiguous :: b(:)                        !! (n_unknowns)
      real(wp), intent(in) :: accuracy
      real(wp), intent(inout), contiguous :: s(:)                     !! (n_unknowns)
      logical, intent(in), optional :: from_guess                     !! s contains a guess; default no
      integer :: most, patience, products

      if (allocated(self%factor)) then
         call self%solve_by_factors(problem, b, s)
         return
      end if
      if (.not. self%is_fresh .and. (self%level == 0 .or. self%needs_update)) call self%update_preconditioner(problem)
      if (.not. present(from_guess)) s = 0.0_wp
      products = 0
      most = self%products_of_factors(problem)
      do
         if (self%is_strongest) then
            call self%gmres%solve(problem, b, accuracy, min(most, self%max_products - products), s)
         else
            patience = patience_at(self%patience, self%level, problem)
            call self%gmres%solve(problem, b, accuracy, min(patience, self%max_products - products), s, fewer_than=patience)
         end if
         products = products + self%gmres%n_products
         if (self%gmres%residual <= accuracy .or. products >= self%max_products .or. work_is_over()) exit
         if (self%is_strongest .and. self%is_fresh) exit
         if (self%is_fresh) self%level = self%level + 1
         call self%update_preconditioner(problem)
      end do
      self%residual = self%gmres%residual
      self%n_products = self%n_products + products
      self%needs_update = self%is_outdated(problem)
      problem%preconditioner_level = self%level
      problem%has_preconditioner = .not. self%needs_update
      if (self%residual <= accuracy .or. products < most .or. .not. self%is_strongest .or. work_is_over()) return
      allocate (self%factor)
      call new_tangent_factor(self%factor, problem%n_unknowns)
      call self%solve_by_factors(problem, b, s)
   end subroutine tangent_krylov_solve

   !> Whether the preconditioner, after the last solution, is to be computed again for the next tangent: by then it has cost more
   !> products than a new one would have, and as much as that. One that takes few products serves on.
   logical function tangent_krylov_is_outdated(self, problem) result(is_outdated)
      class(tangent_krylov_t), intent(inout) :: self
      class(problem_t), intent(in) :: problem
      real(wp) :: pace, products

      is_outdated = self%gmres%n_products > easy
      if (problem%residual_work <= 0.0_wp .or. .not. self%gmres%residual < 1.0_wp) return
      products = real(self%gmres%n_products, wp)
      pace = -log(max(tiny(1.0_wp), self%gmres%residual))/max(1.0_wp, products)
      if (self%is_fresh) self%fresh_pace = pace
      if (.not. is_outdated .or. self%fresh_pace <= 0.0_wp) return
      is_outdated = products*(1.0_wp - pace/self%fresh_pace)*problem%residual_work > &
                    problem%preconditioner_work*8.0_wp**self%level
   end function tangent_krylov_is_outdated

   !> Products that cost as much as the factors of the tangent; more than any solution takes if these are not affordable.
   pure integer function tangent_krylov_products_of_factors(self, problem) result(products)
      class(tangent_krylov_t), intent(in) :: self
      class(problem_t), intent(in) :: problem

      products = huge(1)
      if (problem%residual_work <= 0.0_wp .or. problem%n_unknowns > largest_affordable) return
      if (problem%tangent_work < self%max_products*problem%residual_work) &
         products = max(self%patience, ceiling(problem%tangent_work/problem%residual_work))
   end function tangent_krylov_products_of_factors

   !> Computes s with J s = b by the factors of J; `residual` is 1 if it is singular.
   subroutine tangent_krylov_solve_by_factors(self, problem, b, s)
      class(tangent_krylov_t), intent(inout) :: self
      class(problem_t), intent(inout) :: problem
      real(wp), intent(in), contiguous :: b(:)                        !! (n_unknowns)
      real(wp), intent(out), contiguous :: s(:)                       !! (n_unknowns)
      logical :: is_singular

      s = b
      if (.not. self%has_factor) then
         call self%factor%update(problem, self%x, is_singular)
         self%n_preconditioners = self%n_preconditioners + 1
         self%has_factor = .not. is_singular
      end if
      self%residual = merge(0.0_wp, 1.0_wp, self%has_factor)
      if (self%has_factor) call self%factor%solve(problem, s)
   end subroutine tangent_krylov_solve_by_factors

   !> Products permitted with a preconditioner before the next stronger one: as many as this one costs, divided by its
   !> uses. The factors between all harmonics of ten contacts under two tones cost thousands of products, where 60
   !> lead to the solution.
   pure integer function patience_at(least, level, problem)
      integer, intent(in) :: least                                    !! lower limit
      integer, intent(in) :: level
      class(problem_t), intent(in) :: problem

      patience_at = least
      if (problem%residual_work <= 0.0_wp) return
      patience_at = nint(min(real(max_patience, wp), &
                             max(real(least, wp), &
                                 problem%preconditioner_work*8.0_wp**(level + 1)/(uses*problem%residual_work))))
   end function patience_at

   !> Updates the preconditioner to the present point of the problem.
   subroutine tangent_krylov_update_preconditioner(self, problem)
      class(tangent_krylov_t), intent(inout) :: self
      class(problem_t), intent(inout) :: problem

      call problem%update_preconditioner(self%level, self%is_strongest)
      call self%gmres%forget()
      self%n_preconditioners = self%n_preconditioners + 1
      self%is_fresh = .true.
   end subroutine tangent_krylov_update_preconditioner
end module hb_tangent_solver
