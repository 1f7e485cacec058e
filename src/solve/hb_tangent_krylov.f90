!> Solves with the tangent of a problem from products alone: GMRES, with a preconditioner that is strengthened if
!> GMRES does not converge. Source: docs/why/theory.md, section 6.6.
module hb_tangent_krylov
   use hb_cancellation, only: work_is_over
   use hb_gmres, only: gmres_t, new_gmres
   use hb_kinds, only: wp
   use hb_problem, only: problem_t
   implicit none
   private
   public :: new_tangent_krylov, tangent_krylov_t

   integer, parameter :: most_patience = 300                          ! products, if a stronger preconditioner costs more
   real(wp), parameter :: uses = 4.0_wp                               ! uses of a stronger preconditioner that pay for it
   integer, parameter :: easy = 20                                    ! products up to which it is reused

   type :: tangent_krylov_t
      integer :: most_products = 0                                    !! of one solution
      integer :: n_products = 0                                       !! of all solutions so far
      integer :: n_preconditioners = 0                                !! made so far
      real(wp) :: residual = 1.0_wp !! remaining residual of the last solution, relative; 1: there is none
      type(gmres_t), private :: gmres
      integer :: patience = 100 !! least number of products before the preconditioner is strengthened
      integer, private :: level = 0                                   ! of the preconditioner
      logical, private :: is_fresh = .false.                          ! computed for this tangent
      logical, private :: is_tired = .true.                           ! the last solution took many products
      logical, private :: is_strongest = .false.
   contains
      procedure :: update => tangent_krylov_update
      procedure :: solve => tangent_krylov_solve
      procedure, private :: renew => tangent_krylov_renew
   end type tangent_krylov_t

contains

   !> Allocates memory for a problem; GMRES restarts after `n_vectors` products. Starts with the level of
   !> preconditioner that the last solutions of the problem needed.
   subroutine new_tangent_krylov(self, problem, n_vectors, most_products)
      type(tangent_krylov_t), intent(out) :: self
      class(problem_t), intent(in) :: problem
      integer, intent(in) :: n_vectors, most_products

      self%most_products = most_products
      self%level = problem%preconditioner_level
      self%is_tired = .not. problem%has_preconditioner
      call new_gmres(self%gmres, problem%n_unknowns, n_vectors)
   end subroutine new_tangent_krylov

   !> Changes to the tangent at x; `is_ready` is false if there are no products.
   subroutine tangent_krylov_update(self, problem, x, is_ready)
      class(tangent_krylov_t), intent(inout) :: self
      class(problem_t), intent(inout) :: problem
      real(wp), intent(in), contiguous :: x(:)                        !! (n_unknowns)
      logical, intent(out) :: is_ready

      call problem%linearise(x, is_ready)
      call self%gmres%forget()
      self%is_fresh = .false.
      self%residual = 1.0_wp
   end subroutine tangent_krylov_update

   !> Computes s with |b - J s| <= accuracy |b|, or as near as `most_products` permit: see `residual`.
   subroutine tangent_krylov_solve(self, problem, b, accuracy, s)
      class(tangent_krylov_t), intent(inout) :: self
      class(problem_t), intent(inout) :: problem
      real(wp), intent(in), contiguous :: b(:)                        !! (n_unknowns)
      real(wp), intent(in) :: accuracy
      real(wp), intent(out), contiguous :: s(:)                       !! (n_unknowns)
      integer :: patience, products

      if (.not. self%is_fresh .and. (self%level == 0 .or. self%is_tired)) call self%renew(problem)
      s = 0.0_wp
      products = 0
      do
         if (self%is_strongest) then
            call self%gmres%solve(problem, b, accuracy, self%most_products - products, s)
         else
            patience = patience_at(self%patience, self%level, problem)
            call self%gmres%solve(problem, b, accuracy, min(patience, self%most_products - products), s, fewer_than=patience)
         end if
         products = products + self%gmres%n_products
         if (self%gmres%residual <= accuracy .or. products >= self%most_products .or. work_is_over()) exit
         if (self%is_strongest .and. self%is_fresh) exit
         if (self%is_fresh) self%level = self%level + 1
         call self%renew(problem)
      end do
      self%residual = self%gmres%residual
      self%n_products = self%n_products + products
      self%is_tired = self%gmres%n_products > easy
      problem%preconditioner_level = self%level
      problem%has_preconditioner = .not. self%is_tired
   end subroutine tangent_krylov_solve

   !> Products permitted with a preconditioner before the next stronger one: as many as this one costs, divided by its
   !> uses. The factors between all harmonics of ten contacts under two tones cost thousands of products, where 60
   !> lead to the solution.
   pure integer function patience_at(least, level, problem)
      integer, intent(in) :: least                                    !! lower limit
      integer, intent(in) :: level
      class(problem_t), intent(in) :: problem

      patience_at = least
      if (problem%residual_work <= 0.0_wp) return
      patience_at = nint(min(real(most_patience, wp), &
                             max(real(least, wp), &
                                 problem%preconditioner_work*8.0_wp**(level + 1)/(uses*problem%residual_work))))
   end function patience_at

   !> Updates the preconditioner to the present point of the problem.
   subroutine tangent_krylov_renew(self, problem)
      class(tangent_krylov_t), intent(inout) :: self
      class(problem_t), intent(inout) :: problem

      call problem%update_preconditioner(self%level, self%is_strongest)
      call self%gmres%forget()
      self%n_preconditioners = self%n_preconditioners + 1
      self%is_fresh = .true.
   end subroutine tangent_krylov_renew
end module hb_tangent_krylov
