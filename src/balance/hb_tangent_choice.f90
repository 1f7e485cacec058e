!> The number of unknowns above which a step of Newton's method by products with the tangent is cheaper than by its factors, for
!> each kind of laws. Measured: docs/develop/performance.md, section "Factors or products".
module hb_tangent_choice
   use hb_law, only: law_box_t
   use hb_problem, only: default_largest_dense
   implicit none
   private
   public :: largest_dense_tangent

   integer, parameter :: with_smooth_laws = 40                        ! few products each step, few steps
   integer, parameter :: with_kinks = 120                             ! steps that are not quite exact cost a step or two more
   integer, parameter :: with_memory = 250                            ! each product integrates along time

contains

   !> Unknowns up to which the dense tangent is the cheaper, of the laws of a model: the largest of what each requests. Walls and
   !> rigid friction, whose steps have to be exact, ask for the most.
   pure integer function largest_dense_tangent(laws)
      type(law_box_t), intent(in) :: laws(:)
      integer :: i

      largest_dense_tangent = with_smooth_laws
      do i = 1, size(laws)
         associate (law => laws(i)%law)
            if (law%degree == 0) largest_dense_tangent = max(largest_dense_tangent, with_kinks)
            if (law%is_multiplier) largest_dense_tangent = max(largest_dense_tangent, default_largest_dense)
            if (law%n_states > 0) largest_dense_tangent = max(largest_dense_tangent, with_memory)
         end associate
      end do
   end function largest_dense_tangent
end module hb_tangent_choice
