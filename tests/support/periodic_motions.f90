!> Numbers of periodic motions that tests compare with other sources.
module periodic_motions
   use hb_kinds, only: two_pi, wp
   use hb_model, only: model_t
   use hb_motion_result, only: motion_result_t
   implicit none
   private
   public :: amplitude, peak_of

contains

   !> Amplitude of a stored degree of freedom at a tuple.
   real(wp) function amplitude(model, result, dof, tuple)
      type(model_t), intent(in) :: model
      type(motion_result_t), intent(in) :: result
      integer, intent(in) :: dof, tuple(:)

      amplitude = norm2(result%coefficients(:, model%discretisation%harmonics%index_of(tuple), dof))
   end function amplitude

   !> Largest displacement of the first degree of freedom of a periodic motion: samples, then Newton's method on the rate.
   real(wp) function peak_of(model, result)
      type(model_t), intent(in) :: model
      type(motion_result_t), intent(in) :: result
      integer, parameter :: n = 2000
      real(wp) :: samples(n), tau
      integer :: i

      samples = [(displacement(two_pi*i/n, 0), i=1, n)]
      tau = two_pi*maxloc(samples, dim=1)/n
      do i = 1, 20
         tau = tau - displacement(tau, 1)/displacement(tau, 2)
      end do
      peak_of = displacement(tau, 0)

   contains

      !> The series, or its first or second derivative.
      real(wp) function displacement(at, order)
         real(wp), intent(in) :: at
         integer, intent(in) :: order
         real(wp) :: phase(model%discretisation%harmonics%n_harmonics), j(model%discretisation%harmonics%n_harmonics)

         j = model%discretisation%harmonics%tuples(1, :)
         phase = j*at + 0.25_wp*order*two_pi
         displacement = sum(j**order*(result%coefficients(1, :, 1)*cos(phase) + result%coefficients(2, :, 1)*sin(phase)))
      end function displacement
   end function peak_of
end module periodic_motions
