!> A law with memory: its force depends on internal states that evolve with the motion along time, such as the
!> position of a friction slider.
!>
!> On the torus time is along the characteristic d tau/dt = omega. The law defines one step: the state at a sample
!> from the state one step earlier and the path of its coordinates in between. hb_slider_states integrates the states
!> over the torus. Source: docs/why/theory.md, section 5.5.
module hb_hysteretic_law
   use hb_kinds, only: wp
   use hb_law, only: law_t
   implicit none
   private
   public :: advance_step_by_step, hysteretic_law_t, n_path_parts, path_part

   !> Data of a coordinate along one step: its value at both ends [m], and its rate times the step [m]; in this order a law of
   !> the user has them (hb_user_library).
   type :: path_part_t
      integer :: at_end = 1                                           !! at the sample itself
      integer :: at_start = 2                                         !! one step earlier
      integer :: end_rate = 3
      integer :: start_rate = 4
   end type path_part_t
   type(path_part_t), parameter :: path_part = path_part_t()
   integer, parameter :: n_path_parts = 4

   !> At rest all states are zero: sliders relaxed, no force.
   type, extends(law_t), abstract :: hysteretic_law_t
      logical :: has_bounds = .false.                                 !! each state is the position of a slider between two `bounds`
      real(wp) :: work_of_advance = 25.0_wp                           !! of a state over one step, in about a nanosecond
   contains
      procedure(advance_law), deferred :: advance
      procedure(force_of_law), deferred :: force
      procedure :: evaluate => hysteretic_law_evaluate
      procedure :: advance_line => advance_step_by_step
      procedure :: bounds => hysteretic_law_bounds
   end type hysteretic_law_t

   abstract interface
      !> States at the end of a step of many samples at once, and their derivatives when these are present.
      subroutine advance_law(self, s_old, path, s_new, ds_ds_old, ds_dpath)
         import :: hysteretic_law_t, wp
         class(hysteretic_law_t), intent(in) :: self
         real(wp), intent(in), contiguous :: s_old(:, :)              !! states at the start, (n_samples, n_states)
         real(wp), intent(in), contiguous :: path(:, :, :)            !! (n_samples, n_coordinates, n_path_parts)
         real(wp), intent(out), contiguous :: s_new(:, :)             !! states at the end, as s_old
         real(wp), intent(out), contiguous, optional :: ds_ds_old(:, :, :)   !! last axis: the state differentiated by
         real(wp), intent(out), contiguous, optional :: ds_dpath(:, :, :, :) !! (n_samples, n_states, n_coordinates,
                                                                      !! n_path_parts)
      end subroutine advance_law

      !> Forces of many samples from coordinates and states, and their derivatives when these are present.
      subroutine force_of_law(self, z, s, f, df_dz, df_ds)
         import :: hysteretic_law_t, wp
         class(hysteretic_law_t), intent(in) :: self
         real(wp), intent(in), contiguous :: z(:, :)                  !! coordinates [m], (n_samples, n_coordinates)
         real(wp), intent(in), contiguous :: s(:, :)                  !! (n_samples, n_states)
         real(wp), intent(out), contiguous :: f(:, :)                 !! forces [N], as z
         real(wp), intent(out), contiguous, optional :: df_dz(:, :, :)   !! last axis: the coordinate differentiated by
         real(wp), intent(out), contiguous, optional :: df_ds(:, :, :)   !! last axis: the state differentiated by
      end subroutine force_of_law
   end interface

contains

   !> Integrates once along a closed line of samples, from the states of the first to those of the second and so on,
   !> back to the first, whose previous states are those of the last times `closing`. Laws may override it with a
   !> faster method for the same states.
   subroutine advance_step_by_step(self, n_coordinates, n_steps, closing, path, states, largest_move)
      class(hysteretic_law_t), intent(in) :: self
      integer, intent(in) :: n_coordinates, n_steps
      real(wp), intent(in) :: closing                                 !! 1, or -1 if the line is half of an odd motion
      real(wp), intent(in) :: path(n_coordinates, n_path_parts, n_steps)  !! [m]
      real(wp), intent(inout) :: states(self%n_states, n_steps)
      real(wp), intent(out) :: largest_move                           !! of any state within a step
      real(wp) :: s_old(1, self%n_states), s_new(1, self%n_states), step_path(1, n_coordinates, n_path_parts)
      integer :: i

      largest_move = 0.0_wp
      s_new(1, :) = states(:, 1)
      do i = 2, n_steps + 1
         s_old = s_new
         if (i > n_steps) s_old = closing*s_old
         step_path(1, :, :) = path(:, :, 1 + modulo(i - 1, n_steps))
         call self%advance(s_old, step_path, s_new)
         states(:, 1 + modulo(i - 1, n_steps)) = s_new(1, :)
         largest_move = max(largest_move, maxval(abs(s_new - s_old)))
      end do
   end subroutine advance_step_by_step

   !> Bounds of the sliders at one moment, and their rates of change; time integration stops where a slider begins or
   !> ends to slip.
   pure subroutine hysteretic_law_bounds(self, z, v, lower, upper, lower_rate, upper_rate)
      class(hysteretic_law_t), intent(in) :: self
      real(wp), intent(in) :: z(:), v(:)                              !! [m], [m/s], (n_coordinates)
      real(wp), intent(out) :: lower(:), upper(:)                     !! [m], (n_states)
      real(wp), intent(out) :: lower_rate(:), upper_rate(:)           !! [m/s], (n_states)

      lower = 0.0_wp
      upper = 0.0_wp
      lower_rate = 0.0_wp
      upper_rate = 0.0_wp
   end subroutine hysteretic_law_bounds

   !> Forces after loading from rest along a straight path to z, with which the time integration over the torus
   !> starts.
   subroutine hysteretic_law_evaluate(self, z, v, p, f, df_dz, df_dv, df_dp)
      class(hysteretic_law_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)
      real(wp), allocatable :: path(:, :, :), s_old(:, :), s_new(:, :), df_ds(:, :, :), ds_dpath(:, :, :, :), ds_ds_old(:, :, :)
      integer :: c, k, n, part

      n = size(z, 1)
      allocate (path(n, size(z, 2), n_path_parts), s_old(n, self%n_states), s_new(n, self%n_states))
      s_old = 0.0_wp
      path = spread(z, 3, n_path_parts)
      path(:, :, path_part%at_start) = 0.0_wp
      if (.not. present(df_dz)) then
         call self%advance(s_old, path, s_new)
         call self%force(z, s_new, f)
         return
      end if
      allocate (ds_ds_old(n, self%n_states, self%n_states), ds_dpath(n, self%n_states, size(z, 2), n_path_parts))
      allocate (df_ds(n, size(z, 2), self%n_states))
      call self%advance(s_old, path, s_new, ds_ds_old, ds_dpath)
      call self%force(z, s_new, f, df_dz, df_ds)
      do part = 1, n_path_parts
         if (part == path_part%at_start) cycle
         do c = 1, size(z, 2)
            do k = 1, self%n_states
               df_dz(:, :, c) = df_dz(:, :, c) + df_ds(:, :, k)*spread(ds_dpath(:, k, c, part), 2, size(z, 2))
            end do
         end do
      end do
   end subroutine hysteretic_law_evaluate
end module hb_hysteretic_law
