!> What fixes the phases of unknown tones along a curve, and the amplitude of a normal mode.
module hb_curve_conditions
   use hb_curve, only: curve_t
   use hb_kinds, only: wp
   use hb_phase, only: coefficient_form, peak_form, peak_rate_form, shift_form
   use hb_scene_problem, only: scene_problem_t
   use hb_limit_cycle_search, only: fundamental
   implicit none
   private
   public :: is_mirrored, set_conditions

contains

   !> The conditions for the phases of unknown tones, by the motion at hand, and for the amplitude of a normal mode.
   subroutine set_conditions(problem, which, curve, weights)
      type(scene_problem_t), intent(in) :: problem
      integer, intent(in) :: which(:)                                 !! parameters that are unknown, the value last
      type(curve_t), intent(inout) :: curve                           !! whose problem gets them
      real(wp), intent(in) :: weights(:)                              !! typical motion, (unknowns of the balance)
      integer :: dof, h, i, n
      real(wp) :: scale(problem%scene%harmonics%n_coefficients, problem%balance%n_dofs)

      n = problem%n_unknowns
      scale = reshape(weights, shape(scale))
      associate (scene => problem%scene, set => problem%scene%harmonics, forms => curve%problem%forms, &
                 n_dofs => problem%balance%n_dofs)
         if (scene%normal_mode%is_asked) then
            dof = problem%balance%stiffness%coordinates%number_of(scene%normal_mode%dof)
            h = fundamental(set, which(1))
            if (scene%normal_mode%is_peak) then
               forms(:n, 1) = peak_rate_form(set, n_dofs, dof, which(1))
               forms(:n, 2) = peak_form(set, n_dofs, dof)
            else
               forms(:n, 1) = coefficient_form(set, n_dofs, set%sin_at(h), dof)
               forms(:n, 2) = coefficient_form(set, n_dofs, set%cos_at(h), dof)
            end if
            curve%problem%values(2) = scene%normal_mode%amplitude
         else
            do i = 1, size(which) - 1
               forms(:n, i) = shift_form(set, which(i), reshape(curve%x(:n), shape(scale)), scale)
            end do
         end if
      end associate
   end subroutine set_conditions

   !> Whether the motion of an unknown tone has gone through zero on the step: what follows is its mirror image.
   logical function is_mirrored(problem, which, curve, weights)
      type(scene_problem_t), intent(in) :: problem
      integer, intent(in) :: which(:)
      type(curve_t), intent(in) :: curve
      real(wp), intent(in) :: weights(:)
      real(wp) :: u(problem%scene%harmonics%n_coefficients, problem%balance%n_dofs), before(size(u, 1), size(u, 2))
      integer :: h, i

      is_mirrored = .false.
      associate (set => problem%scene%harmonics)
         u = reshape(curve%x(:size(u))/weights, shape(u))
         before = reshape(curve%last_x(:size(u))/weights, shape(u))
         do i = 1, size(which) - 1
            if (which(i) > set%n_tones) cycle
            do h = 1, set%n_harmonics
               if (set%tuples(which(i), h) /= 0) cycle
               u(set%cos_at(h), :) = 0.0_wp
               if (set%sin_at(h) > 0) u(set%sin_at(h), :) = 0.0_wp
            end do
            is_mirrored = is_mirrored .or. sum(u*before) <= 0.0_wp
         end do
      end associate
   end function is_mirrored
end module hb_curve_conditions
