!> A problem with some of its parameters unknown: x = (unknowns of the base problem, these parameters), and as many
!> additional equations, each a linear functional of all unknowns with a prescribed value. One of them may be a
!> general function instead.
!>
!> Products with the tangent and their preconditioner by block elimination:
!>
!>     (A B; C D) (x; y) = (r; s),   x = A^-1 r - A^-1 B y,   (D - C A^-1 B) y = s - C A^-1 r.
!>
!> A is the tangent of the base problem, or its preconditioner; B the derivatives with respect to the parameters; C
!> and D the functionals. Source: docs/why/theory.md, section 6.6.
module hb_bordered
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_assert, only: assert, asserts_are_on
   use hb_kinds, only: wp
   use hb_lapack, only: dgetrf, dgetrs
   use hb_problem, only: problem_t
   implicit none
   private
   public :: bordered_problem_t, new_bordered_problem, plane_t, row_t

   !> A linear equation of all unknowns.
   type :: plane_t
      real(wp), allocatable :: functional(:)                          !! (n_unknowns)
      real(wp) :: value = 0.0_wp                                      !! of it
      real(wp), allocatable :: units_across(:)                        !! for crossings of another curve of solutions: units of
                                                                      !! lengths, in which steps are normal to both (n_unknowns)
   end type plane_t

   !> A function of all unknowns with a prescribed value.
   type, abstract :: row_t
   contains
      procedure(row_value), deferred :: value
      procedure(row_gradient), deferred :: gradient
   end type row_t

   type, extends(problem_t) :: bordered_problem_t
      class(problem_t), pointer :: base => null()
      integer, allocatable :: which(:)                                !! parameters of the base problem that are unknown
      real(wp), allocatable :: functionals(:, :)                      !! (n_unknowns, added equations)
      real(wp), allocatable :: values(:)                              !! of the functionals, (added equations)
      class(row_t), allocatable :: row !! function for one of the values; its functional is recomputed
      integer :: row_at = 0                                           !! index of its value
      logical, allocatable :: is_held(:)                              !! unknowns of the base problem fixed at zero; none if not
                                                                      !! allocated
      real(wp), allocatable :: units_across(:)                        !! of the last equation, `plane_t`
      integer :: n_base = 0                                           !! unknowns of the base problem
      real(wp), allocatable :: border(:, :)                           !! derivatives by the parameters, (n_base, parameters), at
                                                                      !! the last tangent
      real(wp), allocatable, private :: eliminated(:, :), schur(:, :) ! preconditioner by block elimination
      integer, allocatable, private :: schur_pivots(:)
      logical, private :: has_schur = .false.
   contains
      procedure :: residual => bordered_residual
      procedure :: tangent => bordered_tangent
      procedure :: linearise => bordered_linearise
      procedure :: apply_tangent => bordered_apply_tangent
      procedure :: update_preconditioner => bordered_update_preconditioner
      procedure :: precondition => bordered_precondition
      procedure :: solve_linear => bordered_solve_linear
      procedure :: rounding_level => bordered_rounding_level
      procedure :: is_unsuitable => bordered_is_unsuitable
      procedure :: has_left_domain => bordered_has_left_domain
      procedure :: deform => bordered_deform
      procedure :: unknowns => bordered_unknowns
      procedure :: move_to => bordered_move_to
      procedure :: rescale => bordered_rescale
      procedure :: hold => bordered_hold
      procedure, private :: find_border => bordered_find_border
      procedure, private :: solve_block => bordered_solve_block
   end type bordered_problem_t

   abstract interface
      !> Value of the function at x; the parameters of the base problem are those in x.
      real(wp) function row_value(self, base, x)
         import :: problem_t, row_t, wp
         class(row_t), intent(in) :: self
         class(problem_t), intent(inout) :: base
         real(wp), intent(in) :: x(:)                                 !! (n_unknowns)
      end function row_value

      !> Derivatives with respect to all unknowns.
      subroutine row_gradient(self, base, x, gradient)
         import :: problem_t, row_t, wp
         class(row_t), intent(in) :: self
         class(problem_t), intent(inout) :: base
         real(wp), intent(in) :: x(:)                                 !! (n_unknowns)
         real(wp), intent(out) :: gradient(:)                         !! (n_unknowns)
      end subroutine row_gradient
   end interface

contains

   !> Borders a problem. There must be as many functionals as parameters.
   subroutine new_bordered_problem(self, base, which, functionals, values, row)
      type(bordered_problem_t), intent(out) :: self
      class(problem_t), intent(inout), target :: base
      integer, intent(in) :: which(:)                                 !! parameters of the base problem
      real(wp), intent(in) :: functionals(:, :)                       !! (unknowns of the base problem, or all; parameters)
      real(wp), intent(in) :: values(:)                               !! (parameters)
      class(row_t), intent(in), optional :: row                       !! for the last value; its functional is arbitrary

      if (asserts_are_on) call assert(size(functionals, 2) == size(which) .and. size(values) == size(which), &
                                      "new_bordered_problem", "as many functionals and values as parameters")
      self%base => base
      self%which = which
      self%n_base = base%n_unknowns
      self%n_unknowns = self%n_base + size(which)
      self%has_products = base%has_products
      if (base%largest_dense == 0) self%largest_dense = 0              ! there are products alone
      self%residual_work = base%residual_work
      self%tangent_work = base%tangent_work
      self%preconditioner_work = base%preconditioner_work
      allocate (self%functionals(self%n_unknowns, size(which)), source=0.0_wp)
      self%functionals(:size(functionals, 1), :) = functionals
      self%values = values
      if (present(row)) self%row = row
      self%row_at = size(values)
      allocate (self%border(self%n_base, size(which)))
      call self%rescale()
   end subroutine new_bordered_problem

   !> Copies the scales of the base problem, and derives those of the functionals.
   subroutine bordered_rescale(self)
      class(bordered_problem_t), intent(inout) :: self
      integer :: i

      self%x_scale = [self%base%x_scale, self%base%parameter_scales(self%which)]
      self%r_scale = [self%base%r_scale, (norm2(self%functionals(:, i)*self%x_scale), i=1, size(self%values))]
      if (allocated(self%row)) self%r_scale(self%n_base + self%row_at) = abs(self%values(self%row_at))
   end subroutine bordered_rescale

   !> Makes a plane the last equation.
   subroutine bordered_hold(self, plane)
      class(bordered_problem_t), intent(inout) :: self
      type(plane_t), intent(in) :: plane

      associate (last => size(self%values))
         self%functionals(:, last) = plane%functional
         self%values(last) = plane%value
      end associate
      if (allocated(self%units_across)) deallocate (self%units_across)
      if (allocated(plane%units_across)) self%units_across = plane%units_across
      call self%rescale()
   end subroutine bordered_hold

   !> The vector of unknowns: those of the base problem, and its present parameters.
   pure function bordered_unknowns(self, x) result(all_unknowns)
      class(bordered_problem_t), intent(in) :: self
      real(wp), intent(in) :: x(:)                                    !! (n_base)
      real(wp) :: all_unknowns(self%n_unknowns)

      all_unknowns = [x, self%base%parameters(self%which)]
   end function bordered_unknowns

   !> Sets the base problem to the parameters in x; `is_possible` is false if it has no such parameters.
   subroutine bordered_move_to(self, x, is_possible)
      class(bordered_problem_t), intent(inout) :: self
      real(wp), intent(in) :: x(:)                                    !! (n_unknowns)
      logical, intent(out) :: is_possible

      call self%base%set_parameters(self%which, x(self%n_base + 1:), is_possible)
   end subroutine bordered_move_to

   subroutine bordered_residual(self, x, r)
      class(bordered_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(out), contiguous :: r(:)
      logical :: is_possible

      call self%move_to(x, is_possible)
      if (.not. is_possible) then
         r = ieee_value(1.0_wp, ieee_quiet_nan)
         return
      end if
      associate (n => self%n_base)
         call self%base%residual(x(:n), r(:n))
         r(n + 1:) = matmul(x, self%functionals) - self%values
         if (allocated(self%row)) r(n + self%row_at) = self%row%value(self%base, x) - self%values(self%row_at)
         if (allocated(self%is_held)) then
            where (self%is_held) r(:n) = x(:n)*self%r_scale(:n)/self%x_scale(:n)
         end if
      end associate
   end subroutine bordered_residual

   subroutine bordered_tangent(self, x, jacobian)
      class(bordered_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(out), contiguous :: jacobian(:, :)
      real(wp), allocatable :: block(:, :)
      logical :: is_possible
      integer :: i

      jacobian = 0.0_wp
      call self%move_to(x, is_possible)
      if (.not. is_possible) return                                   ! singular: the solver detects it
      associate (n => self%n_base)
         allocate (block(n, n))
         call self%base%tangent(x(:n), block)
         self%tangent_work = self%base%tangent_work
         jacobian(:n, :n) = block
         call adopt_failure(self)
         if (allocated(self%row)) call self%row%gradient(self%base, x, self%functionals(:, self%row_at))
         jacobian(n + 1:, :) = transpose(self%functionals)
         call self%find_border(x, self%border)
         jacobian(:n, n + 1:) = self%border
         if (.not. allocated(self%is_held)) return
         do i = 1, n
            if (.not. self%is_held(i)) cycle
            jacobian(i, :) = 0.0_wp
            jacobian(i, i) = self%r_scale(i)/self%x_scale(i)
         end do
      end associate
   end subroutine bordered_tangent

   !> Derivatives of the residual of the base problem by the parameters.
   subroutine bordered_find_border(self, x, border)
      class(bordered_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(out) :: border(:, :)                           !! (n_base, parameters)
      real(wp) :: column(self%n_base)
      integer :: i

      do i = 1, size(self%which)
         call self%base%parameter_derivative(x(:self%n_base), self%which(i), column)
         border(:, i) = column
      end do
      call adopt_failure(self)
   end subroutine bordered_find_border

   subroutine bordered_linearise(self, x, is_ready)
      class(bordered_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      logical, intent(out) :: is_ready

      call self%move_to(x, is_ready)
      if (.not. is_ready) return
      call self%find_border(x, self%border)
      if (allocated(self%row)) call self%row%gradient(self%base, x, self%functionals(:, self%row_at))
      call self%base%linearise(x(:self%n_base), is_ready)
      call adopt_failure(self)
   end subroutine bordered_linearise

   !> Copies the failure of the base problem.
   subroutine adopt_failure(self)
      class(bordered_problem_t), intent(inout) :: self

      if (allocated(self%base%failure)) call move_alloc(self%base%failure, self%failure)
   end subroutine adopt_failure

   subroutine bordered_apply_tangent(self, x, product)
      class(bordered_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(out), contiguous :: product(:)

      associate (n => self%n_base)
         call self%base%apply_tangent(x(:n), product(:n))
         product(:n) = product(:n) + matmul(self%border, x(n + 1:))
         product(n + 1:) = matmul(x, self%functionals)
         if (.not. allocated(self%is_held)) return
         where (self%is_held) product(:n) = x(:n)*self%r_scale(:n)/self%x_scale(:n)
      end associate
   end subroutine bordered_apply_tangent

   !> The tangent of the base problem may be singular at a solution, which only the functionals exclude; its
   !> preconditioner must not be.
   subroutine bordered_update_preconditioner(self, level, is_strongest)
      class(bordered_problem_t), intent(inout) :: self
      integer, intent(in) :: level
      logical, intent(out) :: is_strongest
      integer :: i, info, k

      k = size(self%which)
      call self%base%update_regular_preconditioner(self%which, level, is_strongest)
      self%eliminated = self%border
      do i = 1, k
         call self%solve_block(self%border(:, i), self%eliminated(:, i))
      end do
      associate (n => self%n_base)
         self%schur = transpose(self%functionals(n + 1:, :)) - matmul(transpose(self%functionals(:n, :)), self%eliminated)
      end associate
      self%schur_pivots = [(i, i=1, k)]
      call dgetrf(k, k, self%schur, k, self%schur_pivots, info)
      self%has_schur = info == 0
   end subroutine bordered_update_preconditioner

   subroutine bordered_precondition(self, r, step)
      class(bordered_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: r(:)
      real(wp), intent(out), contiguous :: step(:)
      integer :: info, k

      k = size(self%which)
      associate (n => self%n_base)
         call self%solve_block(r(:n), step(:n))
         step(n + 1:) = r(n + 1:) - matmul(step(:n), self%functionals(:n, :))
         if (self%has_schur) then
            call dgetrs("N", k, 1, self%schur, k, self%schur_pivots, step(n + 1:), k, info)
            step(:n) = step(:n) - matmul(self%eliminated, step(n + 1:))
         else
            step(n + 1:) = r(n + 1:)*self%x_scale(n + 1:)/self%r_scale(n + 1:)
         end if
      end associate
   end subroutine bordered_precondition

   !> Applies the preconditioner of the base problem, except for fixed unknowns.
   subroutine bordered_solve_block(self, r, step)
      class(bordered_problem_t), intent(inout) :: self
      real(wp), intent(in) :: r(:)
      real(wp), intent(out), contiguous :: step(:)
      real(wp) :: free(self%n_base)

      free = r
      if (allocated(self%is_held)) then
         where (self%is_held) free = 0.0_wp
      end if
      call self%base%precondition(free, step)
      if (.not. allocated(self%is_held)) return
      where (self%is_held) step = r*self%x_scale(:self%n_base)/self%r_scale(:self%n_base)
   end subroutine bordered_solve_block

   !> Solves with the linear part of the base problem, without its coupling to the parameters.
   subroutine bordered_solve_linear(self, r, step)
      class(bordered_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: r(:)
      real(wp), intent(out), contiguous :: step(:)

      associate (n => self%n_base)
         call self%base%solve_linear(r(:n), step(:n))
         step(n + 1:) = r(n + 1:)*self%x_scale(n + 1:)/self%r_scale(n + 1:)
      end associate
   end subroutine bordered_solve_linear

   real(wp) function bordered_rounding_level(self, x)
      class(bordered_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      logical :: is_possible

      bordered_rounding_level = 0.0_wp
      call self%move_to(x, is_possible)
      if (is_possible) bordered_rounding_level = self%base%rounding_level(x(:self%n_base))
   end function bordered_rounding_level

   logical function bordered_is_unsuitable(self, x) result(is_unsuitable)
      class(bordered_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      logical :: is_possible

      call self%move_to(x, is_possible)
      is_unsuitable = .false.
      if (is_possible) is_unsuitable = self%base%is_unsuitable(x(:self%n_base))
   end function bordered_is_unsuitable

   pure logical function bordered_has_left_domain(self) result(has_left_domain)
      class(bordered_problem_t), intent(in) :: self

      has_left_domain = self%base%has_left_domain()
   end function bordered_has_left_domain

   subroutine bordered_deform(self, kind, amount)
      class(bordered_problem_t), intent(inout) :: self
      integer, intent(in) :: kind
      real(wp), intent(in) :: amount

      call self%base%deform(kind, amount)
   end subroutine bordered_deform
end module hb_bordered
