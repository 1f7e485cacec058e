!> Solves with the tangent of a problem from products alone: GMRES, with a preconditioner that is strengthened if
!> GMRES does not converge. If products with the strongest one cost as much as the factors, these take their place.
!> Source: docs/why/theory.md, section 6.6.
module hb_tangent_krylov
   use hb_cancellation, only: work_is_over
   use hb_gmres, only: gmres_t, new_gmres
   use hb_kinds, only: wp
   use hb_problem, only: problem_t
   use hb_solver_types, only: largest_affordable
   use hb_tangent_factor, only: new_tangent_factor, tangent_factor_t
   implicit none
   private
   public :: new_tangent_krylov, tangent_krylov_t

   integer, parameter :: max_patience = 300                          ! products, if a stronger preconditioner costs more
   real(wp), parameter :: uses_that_pay = 4.0_wp                      ! uses of a stronger preconditioner that pay for it
   integer, parameter :: max_products_of_reuse = 20                   ! products up to which it is reused

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

contains

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

      is_outdated = self%gmres%n_products > max_products_of_reuse
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
                                 problem%preconditioner_work*8.0_wp**(level + 1)/(uses_that_pay*problem%residual_work))))
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
end module hb_tangent_krylov
