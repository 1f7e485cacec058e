!> A system of nonlinear equations r(x) = 0, the interface of the solvers: numbers and their scales, without
!> mechanics.
module hb_problem
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite, ieee_quiet_nan, ieee_value
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_solver_types, only: report_t, solver_config_t
   implicit none
   private
   public :: default_largest_dense, deformation, deformation_derivative, deformation_positions, problem_t, set_deformations

   integer, parameter :: default_largest_dense = 400                  !! unknowns up to which the dense tangent is cheaper

   !> Deformations of a problem from an easy one, at 0, to the given one, at 1.
   type :: deformation_t
      integer :: nonlinearity = 1                                     !! factor of all nonlinear terms
      integer :: load = 2                                             !! factor of all loads
      integer :: damping = 3 !! 1 minus this is the artificial damping, if the problem supports it
   end type deformation_t
   type(deformation_t), parameter :: deformation = deformation_t()

   real(wp), parameter :: log_slope_ratio = 14.0_wp                   ! of an amount along the deformation, about six decades
   real(wp), parameter :: max_position = 2.0_wp                       ! position beyond which it is constant

   !> Solvers work with x/x_scale and r/r_scale, so that results do not depend on the units of a model.
   type, abstract :: problem_t
      integer :: n_unknowns = 0
      logical :: continues_in_order_first = .false.                   !! from `coarse_guess`, before a direct attempt
      logical :: has_products = .false.                               !! with the tangent, by `linearise` and `apply_tangent`
      logical :: can_be_damped = .false.                              !! by `deform`
      integer :: largest_dense = default_largest_dense                !! unknowns up to which the dense tangent is cheaper
      real(wp), allocatable :: x_scale(:)                             !! typical magnitude of each unknown, > 0
      real(wp), allocatable :: r_scale(:)                             !! typical magnitude of each equation, > 0
      real(wp) :: residual_work = 0.0_wp                              !! of a residual or a product, see hb_solver_types%report_t
      real(wp) :: tangent_work = 0.0_wp                               !! of a dense tangent and its factors
      real(wp) :: preconditioner_work = 0.0_wp                        !! of a preconditioner of level 0; each further one: 8 times
      integer :: preconditioner_level = 0                             !! level with which recent solutions from products succeeded
      logical :: has_preconditioner = .false. !! of that level, with which the last solution took few products
      type(error_t), allocatable :: failure                           !! why a tangent, a product or a derivative by a parameter
                                                                      !! could not be computed; a solver copies it into its
                                                                      !! report
      real(wp), private :: position(3) = 1.0_wp                       ! position along each deformation
   contains
      procedure(residual), deferred :: residual
      procedure(tangent), deferred :: tangent
      procedure(solve_linear), deferred :: solve_linear
      procedure(rounding_level), deferred :: rounding_level
      procedure(deform), deferred :: deform
      procedure :: linearise => problem_linearise
      procedure :: apply_tangent => problem_apply_tangent
      procedure :: update_preconditioner => problem_update_preconditioner
      procedure :: precondition => problem_precondition
      procedure :: update_regular_preconditioner => problem_update_regular_preconditioner
      procedure :: parameters => deformation_positions
      procedure :: parameter_scales => problem_parameter_scales
      procedure :: set_parameters => set_deformations
      procedure :: parameter_derivative => deformation_derivative
      procedure :: lowest_level => problem_lowest_level
      procedure :: coarse_guess => problem_coarse_guess
      procedure :: has_sound_scales => problem_has_sound_scales
      procedure :: is_unsuitable => problem_is_unsuitable
      procedure :: has_left_domain => problem_has_left_domain
      procedure :: norm => problem_norm
      procedure :: work_of => problem_work_of
   end type problem_t

   abstract interface
      !> Residual r(x).
      subroutine residual(self, x, r)
         import :: problem_t, wp
         class(problem_t), intent(inout) :: self
         real(wp), intent(in), contiguous :: x(:)                     !! (n_unknowns)
         real(wp), intent(out), contiguous :: r(:)                    !! (n_unknowns)
      end subroutine residual

      !> Exact derivative of the residual; if the problem is not smooth, one element of its generalised derivative.
      subroutine tangent(self, x, jacobian)
         import :: problem_t, wp
         class(problem_t), intent(inout) :: self
         real(wp), intent(in), contiguous :: x(:)                     !! (n_unknowns)
         real(wp), intent(out), contiguous :: jacobian(:, :)          !! d r_i/d x_k, (n_unknowns, n_unknowns)
      end subroutine tangent

      !> Solves with the linear part of the problem, a cheap approximation of the tangent that needs no x.
      subroutine solve_linear(self, r, step)
         import :: problem_t, wp
         class(problem_t), intent(inout) :: self
         real(wp), intent(in), contiguous :: r(:)                     !! (n_unknowns)
         real(wp), intent(out), contiguous :: step(:)                 !! (n_unknowns)
      end subroutine solve_linear

      !> Norm of the residual at x due to rounding errors alone: no solver can go below it.
      real(wp) function rounding_level(self, x)
         import :: problem_t, wp
         class(problem_t), intent(inout) :: self
         real(wp), intent(in), contiguous :: x(:)                     !! (n_unknowns)
      end function rounding_level

      !> Deforms the problem for all later calls; 1 is the problem itself.
      subroutine deform(self, kind, amount)
         import :: problem_t, wp
         class(problem_t), intent(inout) :: self
         integer, intent(in) :: kind                                  !! one of `deformation`
         real(wp), intent(in) :: amount                               !! 0 to 1
      end subroutine deform
   end interface

contains

   !> Prepares products with the exact tangent at x; they are valid until the next call of `tangent`, `linearise`,
   !> `residual` or `rounding_level`. The default has no products.
   subroutine problem_linearise(self, x, is_ready)
      class(problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)                        !! (n_unknowns)
      logical, intent(out) :: is_ready                                !! false: no products, for lack of memory or in general

      is_ready = .false.
   end subroutine problem_linearise

   !> Multiplies by the tangent after `linearise`, if the problem has products.
   subroutine problem_apply_tangent(self, x, product)
      class(problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)                        !! (n_unknowns)
      real(wp), intent(out), contiguous :: product(:)                 !! (n_unknowns)

      product = ieee_value(1.0_wp, ieee_quiet_nan)
   end subroutine problem_apply_tangent

   !> Updates the preconditioner to the tangent of the last `linearise`; it is valid until the next call.
   !>
   !> Level 0 is the cheapest; each further one takes about eight times the work and is closer to the tangent.
   subroutine problem_update_preconditioner(self, level, is_strongest)
      class(problem_t), intent(inout) :: self
      integer, intent(in) :: level                                    !! >= 0
      logical, intent(out) :: is_strongest                            !! a higher level would not be better

      is_strongest = .true.
   end subroutine problem_update_preconditioner

   !> Solves with a cheap approximation of the tangent, by default with the linear part.
   subroutine problem_precondition(self, r, step)
      class(problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: r(:)                        !! (n_unknowns)
      real(wp), intent(out), contiguous :: step(:)                    !! (n_unknowns)

      call self%solve_linear(r, step)
   end subroutine problem_precondition

   !> As `update_preconditioner`, regularised for tangents that are singular because some parameters are unknown.
   subroutine problem_update_regular_preconditioner(self, which, level, is_strongest)
      class(problem_t), intent(inout) :: self
      integer, intent(in) :: which(:)                                 !! the unknown parameters
      integer, intent(in) :: level                                    !! >= 0
      logical, intent(out) :: is_strongest

      call self%update_preconditioner(level, is_strongest)
   end subroutine problem_update_regular_preconditioner

   ! Parameters are numbered: those of the problem itself from 1 on; -kind is the position along a deformation, from 0
   ! at the easy problem to 1. In between the amount grows exponentially, (exp(c theta) - 1)/(exp(c) - 1), because the
   ! ratio of a contact stiffness to the stiffness of the structure is decisive.

   !> Values of some parameters.
   pure function deformation_positions(self, which) result(values)
      class(problem_t), intent(in) :: self
      integer, intent(in) :: which(:)
      real(wp) :: values(size(which))

      values = 0.0_wp
      where (which < 0) values = self%position(-which)
   end function deformation_positions

   !> Typical magnitudes of some parameters, > 0.
   pure function problem_parameter_scales(self, which) result(scales)
      class(problem_t), intent(in) :: self
      integer, intent(in) :: which(:)
      real(wp) :: scales(size(which))

      scales = 1.0_wp
   end function problem_parameter_scales

   !> Changes some parameters for all later calls; `is_possible` is false, and the problem invalid until the next
   !> change, if it has no such parameter or the value is not admissible.
   subroutine set_deformations(self, which, values, is_possible)
      class(problem_t), intent(inout) :: self
      integer, intent(in) :: which(:)
      real(wp), intent(in) :: values(:)                               !! as which
      logical, intent(out) :: is_possible
      integer :: i

      is_possible = all(which < 0) .and. all(abs(values) <= huge(values))
      if (.not. is_possible) return
      do i = 1, size(which)
         self%position(-which(i)) = values(i)
         call self%deform(-which(i), amount_at(values(i)))
      end do
   end subroutine set_deformations

   !> Derivative of the residual with respect to a parameter at fixed x; for a deformation from two amounts, because
   !> the residual is linear in them.
   subroutine deformation_derivative(self, x, which, derivative)
      class(problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)                        !! (n_unknowns)
      integer, intent(in) :: which
      real(wp), intent(out), contiguous :: derivative(:)              !! (n_unknowns)
      real(wp), parameter :: amount_distance = 0.5_wp                 ! distance of the two amounts
      real(wp) :: r(size(x)), amount, position

      position = self%position(-which)
      amount = amount_at(position)
      call self%deform(-which, amount + amount_distance)
      call self%residual(x, derivative)
      call self%deform(-which, amount)
      call self%residual(x, r)
      derivative = (derivative - r)/amount_distance*log_slope_ratio*exp(log_slope_ratio*min(position, max_position))/ &
                   (exp(log_slope_ratio) - 1.0_wp)
   end subroutine deformation_derivative

   pure real(wp) function amount_at(position)
      real(wp), intent(in) :: position

      amount_at = (exp(log_slope_ratio*min(position, max_position)) - 1.0_wp)/(exp(log_slope_ratio) - 1.0_wp)
   end function amount_at

   !> Smallest fraction of its size, in each dimension, at which a reduced problem still approximates this one; 1:
   !> none.
   pure real(wp) function problem_lowest_level(self) result(share)
      class(problem_t), intent(in) :: self

      share = 1.0_wp
   end function problem_lowest_level

   !> Improves a first guess by solving a smaller problem that approximates this one; the default has none.
   subroutine problem_coarse_guess(self, share, config, x, report, is_found)
      class(problem_t), intent(inout) :: self
      real(wp), intent(in) :: share                                   !! of the size in each dimension, at least `lowest_level`
      type(solver_config_t), intent(in) :: config
      real(wp), intent(inout), contiguous :: x(:)                     !! (n_unknowns), a first guess, on return the better one
      type(report_t), intent(out) :: report                           !! the work used
      logical, intent(out) :: is_found                                !! false: x is unchanged

      is_found = .false.
   end subroutine problem_coarse_guess

   !> Work of a report. A preconditioner of products is counted as the number of products that would justify another
   !> one.
   pure real(wp) function problem_work_of(self, report) result(work)
      class(problem_t), intent(in) :: self
      type(report_t), intent(in) :: report
      real(wp), parameter :: products_of_preconditioner = 60.0_wp

      work = (real(report%evaluations, wp) + report%products)*self%residual_work
      if (report%products > 0) then
         work = work + products_of_preconditioner*report%factorizations*self%residual_work
      else
         work = work + report%factorizations*self%tangent_work
      end if
   end function problem_work_of

   !> Whether the scales, and their products (work), are in a numerically meaningful range: outside it a zero residual
   !> carries no information.
   pure logical function problem_has_sound_scales(self) result(has_sound_scales)
      class(problem_t), intent(in) :: self

      has_sound_scales = all(ieee_is_finite(self%x_scale)) .and. all(ieee_is_finite(self%r_scale))
      if (has_sound_scales) has_sound_scales = all(self%x_scale >= tiny(1.0_wp)) .and. all(self%r_scale >= tiny(1.0_wp))
      if (has_sound_scales) has_sound_scales = &
         maxval(exponent(self%x_scale)) + maxval(exponent(self%r_scale)) < maxexponent(1.0_wp)
   end function problem_has_sound_scales

   !> Whether the equations themselves are the reason why x, the end of an attempt, is no solution, so that no other attempt can
   !> succeed. The default does not examine them.
   logical function problem_is_unsuitable(self, x) result(is_unsuitable)
      class(problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)                        !! (n_unknowns)

      is_unsuitable = .false.
   end function problem_is_unsuitable

   !> Whether the equations were undefined at some x that was tried: there may be no solution. The default assumes that they
   !> never are.
   pure logical function problem_has_left_domain(self) result(has_left_domain)
      class(problem_t), intent(in) :: self

      has_left_domain = .false.
   end function problem_has_left_domain

   !> Euclidean norm of r/r_scale; NaN or infinity if any entry is.
   pure real(wp) function problem_norm(self, r)
      class(problem_t), intent(in) :: self
      real(wp), intent(in) :: r(:)                                    !! (n_unknowns)

      problem_norm = sqrt(sum((r/self%r_scale)**2))
   end function problem_norm
end module hb_problem
