!> Ordinary differential equations for an integrator with location of events.
module hb_ode
   use hb_kinds, only: wp
   implicit none
   private
   public :: ode_t

   !> Equations y' = rhs(t, y) with event functions.
   type, abstract :: ode_t
      logical :: is_over = .false.                                    !! set by `rhs` to end the integration
   contains
      procedure(rhs_of_ode), deferred :: rhs
      procedure(events_of_ode), deferred :: events
      procedure(weights_of_ode), deferred :: weights
   end type ode_t

   abstract interface
      subroutine rhs_of_ode(self, t, y, dydt)
         import :: ode_t, wp
         class(ode_t), intent(inout) :: self
         real(wp), intent(in) :: t
         real(wp), intent(in), contiguous :: y(:)
         real(wp), intent(out), contiguous :: dydt(:)
      end subroutine rhs_of_ode

      !> Functions whose zeros stop the integration.
      subroutine events_of_ode(self, t, y, g)
         import :: ode_t, wp
         class(ode_t), intent(inout) :: self
         real(wp), intent(in) :: t
         real(wp), intent(in), contiguous :: y(:)
         real(wp), intent(out), contiguous :: g(:)
      end subroutine events_of_ode

      !> Weights w of the error norm: |w(i) error(i)| = 1 is just tolerable.
      subroutine weights_of_ode(self, y, w)
         import :: ode_t, wp
         class(ode_t), intent(inout) :: self
         real(wp), intent(in), contiguous :: y(:)
         real(wp), intent(out), contiguous :: w(:)
      end subroutine weights_of_ode
   end interface
end module hb_ode
