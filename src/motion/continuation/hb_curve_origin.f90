!> The direction of a curve of other motions where it leaves the one on which it was found, at a period doubling or a torus
!> bifurcation, and the first motion of this curve: at a distance from the intersection, where the tangent is singular, yet
!> before the next events.
!>
!> The motion at this point is also one of the wider set, in which its additional harmonics are zero; the tangent of
!> the balance with respect to these has a null vector, the direction of the other motions, which is computed by
!> inverse iteration. The multipliers determine the frequency of an additional tone only up to a multiple of the given
!> tone: the frequency with the largest fundamental is chosen. Source: docs/why/theory.md, section 6.7.
module hb_curve_origin
   use hb_balance_branch, only: balance_branch_t
   use hb_bifurcation, only: bifurcation, bifurcation_value
   use hb_curve_branches, only: origin_t
   use hb_curve_request, only: curve_origin_t
   use hb_curve_step, only: max_chord
   use hb_kinds, only: two_pi, wp
   use hb_model_problem, only: model_problem_t
   use hb_stability, only: stability_t
   use hb_tangent_solver, only: find_null_vector
   implicit none
   private
   public :: find_leaving_motion

   integer, parameter :: max_halvings = 12                            ! of the distance from the origin
   real(wp), parameter :: first_parts(4) = [0.02_wp, 0.1_wp, 0.3_wp, 0.005_wp]   ! of the motion: departure of others

contains

   !> Direction of the other motions at the origin, where the problem is evaluated, and the frequency of an additional
   !> tone, to which the problem is moved. The model from which the origin was created may have had another base
   !> frequency.
   subroutine find_direction(problem, origin, joined, direction, is_found)
      type(model_problem_t), intent(inout) :: problem
      type(curve_origin_t), intent(in) :: origin
      real(wp), intent(out) :: joined                                 !! [rad/s]; 0 without one
      real(wp), intent(out) :: direction(:)                           !! of length 1 in units of x_scale
      logical, intent(out) :: is_found
      integer :: h, i, largest
      real(wp) :: amplitude, most, u(size(origin%u, 1), size(origin%u, 2))
      logical :: is_possible

      joined = 0.0_wp
      if (origin%is_torus) then
         joined = origin%angle/two_pi*problem%omega(1)
         call problem%set_parameters([problem%model%discretisation%harmonics%n_tones], [joined], is_found)
         if (.not. is_found) return
      end if
      call iterate(problem, origin, direction, is_found)
      if (.not. (origin%is_torus .and. is_found)) return
      associate (set => problem%model%discretisation%harmonics)
         u = reshape(direction/problem%x_scale, shape(u))
         most = -1.0_wp
         largest = 0
         do h = 1, set%n_harmonics
            if (abs(set%tuples(set%n_tones, h)) /= 1) cycle
            amplitude = sum([(abs(set%amplitude(u(:, i), h))**2, i=1, size(u, 2))])
            if (amplitude <= most) cycle
            most = amplitude
            largest = h
         end do
         if (all(set%tuples(:set%n_tones - 1, largest) == 0)) return
         joined = abs(dot_product(problem%omega, real(set%tuples(:, largest), wp)))
         call problem%set_parameters([set%n_tones], [joined], is_possible)
         is_found = is_possible
      end associate
      if (is_found) call iterate(problem, origin, direction, is_found)
   end subroutine find_direction

   !> Computes the null vector among the harmonics that the origin does not have.
   subroutine iterate(problem, origin, direction, is_found)
      type(model_problem_t), intent(inout) :: problem
      type(curve_origin_t), intent(in) :: origin
      real(wp), intent(out) :: direction(:)
      logical, intent(out) :: is_found
      logical :: is_further(size(origin%u, 1))
      integer :: h

      associate (set => problem%model%discretisation%harmonics, u => origin%u)
         is_further = .false.
         do h = 1, set%n_harmonics
            if (origin%is_torus) then
               if (set%tuples(set%n_tones, h) == 0) cycle
            else if (all(modulo(set%tuples(:, h), 2) == 0)) then
               cycle
            end if
            is_further([set%cos_at(h), set%sin_at(h)]) = .true.
         end do
         call find_null_vector(problem, reshape(u, [size(u)]), problem%x_scale, &
                               reshape(spread(is_further, 2, size(u, 2)), [size(u)]), spread(0.0_wp, 1, size(u)), direction, &
                               is_found)
      end associate
   end subroutine iterate

   !> Finds the first motion of a curve that leaves another one at the origin of its request, and the direction there.
   subroutine find_leaving_motion(self, first, is_found)
      class(balance_branch_t), intent(inout), target :: self         !! prepared for the origin
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
         if (is_found) is_found = norm2((first%x - from)/self%units_at(from)) <= max_chord*first_parts(i)
         if (is_found) exit
      end do
      if (is_found) call move_before_events(self, from, first)
   end subroutine find_leaving_motion

   !> Moves the first motion closer to the origin as long as there are period doublings between them.
   subroutine move_before_events(self, from, first)
      class(balance_branch_t), intent(inout), target :: self
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
