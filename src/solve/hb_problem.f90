!> A system of nonlinear equations r(x) = 0 as the solvers see it: no mechanics, only numbers and their scales.
module hb_problem
   use hb_kinds, only: wp
   implicit none
   private
   public :: deformation, problem_t

   !> Ways to deform a problem from an easy one, at 0, to the one asked for, at 1.
   type :: deformation_t
      integer :: nonlinearity = 1                                     !! factor of all that is not linear
      integer :: load = 2                                             !! factor of what drives the problem
   end type deformation_t
   type(deformation_t), parameter :: deformation = deformation_t()

   !> Solvers work with x/x_scale and r/r_scale, so that the units of a scene do not matter to them.
   type, abstract :: problem_t
      integer :: n_unknowns = 0
      real(wp), allocatable :: x_scale(:)                             !! typical magnitude of each unknown, > 0
      real(wp), allocatable :: r_scale(:)                             !! typical magnitude of each equation, > 0
   contains
      procedure(residual), deferred :: residual
      procedure(tangent), deferred :: tangent
      procedure(solve_linear), deferred :: solve_linear
      procedure(rounding_level), deferred :: rounding_level
      procedure(deform), deferred :: deform
      procedure :: norm => problem_norm
   end type problem_t

   abstract interface
      !> Residual r(x).
      subroutine residual(self, x, r)
         import :: problem_t, wp
         class(problem_t), intent(inout) :: self
         real(wp), intent(in), contiguous :: x(:)                     !! (n_unknowns)
         real(wp), intent(out), contiguous :: r(:)                    !! (n_unknowns)
      end subroutine residual

      !> Exact derivative of the residual; where the problem is not smooth, one element of its generalised derivative.
      subroutine tangent(self, x, jacobian)
         import :: problem_t, wp
         class(problem_t), intent(inout) :: self
         real(wp), intent(in), contiguous :: x(:)                     !! (n_unknowns)
         real(wp), intent(out), contiguous :: jacobian(:, :)          !! d r_i/d x_k, (n_unknowns, n_unknowns)
      end subroutine tangent

      !> Solves with the linear part of the problem, a cheap approximation of the tangent that needs no x.
      subroutine solve_linear(self, r, step)
         import :: problem_t, wp
         class(problem_t), intent(in) :: self
         real(wp), intent(in), contiguous :: r(:)                     !! (n_unknowns)
         real(wp), intent(out), contiguous :: step(:)                 !! (n_unknowns)
      end subroutine solve_linear

      !> Norm that rounding errors alone may give the residual at x: below it no solver can go.
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

   !> Euclidean norm of r/r_scale; NaN or infinity if any entry is.
   pure real(wp) function problem_norm(self, r)
      class(problem_t), intent(in) :: self
      real(wp), intent(in) :: r(:)                                    !! (n_unknowns)

      problem_norm = sqrt(sum((r/self%r_scale)**2))
   end function problem_norm
end module hb_problem
