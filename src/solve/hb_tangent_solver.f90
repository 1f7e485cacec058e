!> Solves with the tangent of a problem at one point: by its factors, or from products if it is large.
module hb_tangent_solver
   use hb_kinds, only: wp
   use hb_problem, only: default_largest_dense, problem_t
   use hb_solver_types, only: solver_config_t
   use hb_tangent_factor, only: new_tangent_factor, tangent_factor_t
   use hb_tangent_krylov, only: new_tangent_krylov, tangent_krylov_t
   use hb_thresholds, only: rounding_level
   implicit none
   private
   public :: find_null_vector, new_tangent_solver, tangent_solver_t

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
      if (problem%largest_dense == 0) largest_dense = 0
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

   !> Computes a vector that the tangent of a problem maps to nearly zero if it is singular, see `find_null_vector` of
   !> its solver.
   subroutine find_null_vector(problem, x, scale, mask, along, vector, is_found)
      class(problem_t), intent(inout) :: problem
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(in) :: scale(:)                                !! of vectors
      logical, intent(in) :: mask(:)
      real(wp), intent(in) :: along(:)                                !! in these scales, of length 1 or 0
      real(wp), intent(out) :: vector(:)                              !! of length 1 in these scales
      logical, intent(out) :: is_found
      type(tangent_solver_t) :: solver
      logical :: is_singular

      call new_tangent_solver(solver, problem, x, is_singular)
      if (is_singular) call new_tangent_solver(solver, problem, (1.0_wp + rounding_level)*x, is_singular)
      is_found = .not. is_singular
      if (is_found) call solver%find_null_vector(problem, scale, mask, along, vector, is_found)
   end subroutine find_null_vector
end module hb_tangent_solver
