!> The first motion of a curve that leaves another one: at a distance from the intersection, where the tangent is singular, yet
!> before the next events. Source: docs/why/theory.md, section 6.7.
module hb_curve_origin
   use hb_bifurcation, only: bifurcation, bifurcation_value
   use hb_curve_points, only: origin_t
   use hb_curve_request, only: find_direction
   use hb_curve_step, only: longest_chord
   use hb_kinds, only: wp
   use hb_observed_motion, only: observed_motion_t
   use hb_stability, only: stability_t
   implicit none
   private
   public :: find_first

   integer, parameter :: max_halvings = 12                            ! of the distance from the origin
   real(wp), parameter :: first_parts(4) = [0.02_wp, 0.1_wp, 0.3_wp, 0.005_wp]   ! of the motion: departure of others

contains

   !> Finds the first motion of a curve that leaves another one at the origin of its request, and the direction there.
   subroutine find_first(self, first, is_found)
      class(observed_motion_t), intent(inout), target :: self         !! prepared for the origin
      type(origin_t), intent(inout) :: first                          !! receives the motion and the direction
      logical, intent(out) :: is_found
      real(wp) :: across(self%problem%n_unknowns), joined
      real(wp), allocatable :: from(:)
      integer :: i

      associate (origin => self%request%origin, n => self%problem%n_unknowns, n_which => size(self%problem%which))
         allocate (from, source=[origin%u, origin%further])
         call self%problem%move_to_point(from, is_found)
         if (.not. is_found) return
         call find_direction(self%problem, origin, joined, across, is_found)
         if (.not. is_found) return
         if (origin%is_torus) from(n + n_which - 1) = joined
         across = across/norm2(across/self%weights)*norm2(from(:n)/self%weights)
         first%direction = [across, spread(0.0_wp, 1, n_which)]
      end associate
      do i = 1, size(first_parts)                                     ! for forces with kinks there may be none very close to it
         first%x = from + first_parts(i)*first%direction
         call self%correct_on_plane(first%x, first%direction, is_found)
         if (is_found) is_found = norm2((first%x - from)/self%units_at(from)) <= longest_chord*first_parts(i)
         if (is_found) exit
      end do
      if (is_found) call move_before_events(self, from, first)
   end subroutine find_first

   !> Moves the first motion closer to the origin as long as there are period doublings between them.
   subroutine move_before_events(self, from, first)
      class(observed_motion_t), intent(inout), target :: self
      real(wp), intent(in) :: from(:)                                 !! the origin
      type(origin_t), intent(inout) :: first
      type(stability_t) :: at_first, at_origin
      type(origin_t) :: nearer
      integer :: i
      logical :: is_found

      if (self%request%origin%is_torus) return
      call self%find_stability(from, self%model%options%stability%tolerance, at_origin)
      if (.not. allocated(at_origin%multipliers)) return
      do i = 1, max_halvings
         call self%find_stability(first%x, self%model%options%stability%tolerance, at_first)
         if (.not. allocated(at_first%multipliers)) return
         if (bifurcation_value(bifurcation%doubling, at_first%multipliers)* &
             bifurcation_value(bifurcation%doubling, at_origin%multipliers) > 0.0_wp) return
         nearer = first
         nearer%x = from + 0.5_wp*(first%x - from)
         call self%correct_on_plane(nearer%x, nearer%direction, is_found)
         if (is_found) is_found = norm2((nearer%x - from)/self%units_at(from)) < norm2((first%x - from)/self%units_at(from))
         if (.not. is_found) return
         first = nearer
      end do
   end subroutine move_before_events
end module hb_curve_origin
