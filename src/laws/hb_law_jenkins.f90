!> Elastic Coulomb friction (Jenkins element): a spring in series with a slider, f = k (z - w), |f| <= mu N.
!>
!> The normal load N is constant, or N = max(0, N_0 + k_n z_n) with a second coordinate z_n, on which N itself acts.
!> State: the position w of the slider. Source: docs/why/theory.md, section 5.5. Sign: f and N stand beside K q on the
!> left-hand side.
module hb_law_jenkins
   use hb_hysteretic_law, only: advance_step_by_step, hysteretic_law_t, n_path_parts, path_part
   use hb_kinds, only: wp
   use hb_law, only: placement_t
   use hb_numbers, only: numbers_t
   use hb_slider, only: move_slider, move_steadily, pushed_by
   implicit none
   private
   public :: derive_limit, jenkins_t

   type, extends(hysteretic_law_t) :: jenkins_t
      real(wp) :: stiffness = 0.0_wp                                  !! k [N/m]
      real(wp) :: limit = 0.0_wp                                      !! mu N [N], of a constant normal load
      logical :: normal_load_varies = .false.
      real(wp) :: friction_coefficient = 0.0_wp                       !! mu
      real(wp) :: preload = 0.0_wp                                    !! N_0 [N]; negative: a gap N_0/k_n
      real(wp) :: normal_stiffness = 0.0_wp                           !! k_n [N/m]
   contains
      procedure :: declare_numbers => jenkins_declare_numbers
      procedure :: placement => jenkins_placement
      procedure :: derive => jenkins_derive
      procedure :: advance => jenkins_advance
      procedure :: advance_line => jenkins_advance_line
      procedure :: force => jenkins_force
      procedure :: bounds => jenkins_bounds
      procedure :: switches => jenkins_switches
   end type jenkins_t

contains

   subroutine jenkins_declare_numbers(self, numbers)
      class(jenkins_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers
      logical :: has_limit

      has_limit = .false.                                             ! unless an input is read
      call numbers%note_given("limit", has_limit)
      call numbers%note_given("friction_coefficient", self%normal_load_varies)
      call numbers%add("stiffness", self%stiffness)
      if (self%normal_load_varies .and. has_limit) then               ! one problem, not what each of both lacks
         call numbers%reject("limit", "give either 'limit' or 'friction_coefficient', not both")
         self%normal_load_varies = .false.
         call numbers%add("friction_coefficient", self%friction_coefficient)
         call numbers%add("normal_stiffness", self%normal_stiffness, required=.false.)
         call numbers%add("preload", self%preload, required=.false.)
      else if (self%normal_load_varies) then
         call numbers%add("friction_coefficient", self%friction_coefficient)
         call numbers%add("normal_stiffness", self%normal_stiffness)
         call numbers%add("preload", self%preload)
      else
         call numbers%add("limit", self%limit)
      end if
   end subroutine jenkins_declare_numbers

   !> The normal coordinate is the last one.
   pure function jenkins_placement(self) result(placement)
      class(jenkins_t), intent(in) :: self
      type(placement_t) :: placement

      if (self%normal_load_varies) placement%further(1) = "normal_dofs"
   end function jenkins_placement

   pure subroutine jenkins_derive(self)
      class(jenkins_t), intent(inout) :: self

      self%n_states = 1
      self%has_bounds = .true.
      self%is_piecewise_linear = .not. self%normal_load_varies
      call derive_limit(self)
   end subroutine jenkins_derive

   !> Sets what follows from the numbers in one as in two directions.
   pure subroutine derive_limit(self)
      class(jenkins_t), intent(inout) :: self

      self%is_odd = .not. self%normal_load_varies                     ! a normal load acts to one side
      if (self%normal_load_varies) then
         self%n_switches = 1
      else if (self%stiffness > 0.0_wp) then                          ! not after a problem
         self%length_scale = self%limit/self%stiffness
      end if
   end subroutine derive_limit

   subroutine jenkins_advance(self, s_old, path, s_new, ds_ds_old, ds_dpath)
      class(jenkins_t), intent(in) :: self
      real(wp), intent(in), contiguous :: s_old(:, :), path(:, :, :)
      real(wp), intent(out), contiguous :: s_new(:, :)
      real(wp), intent(out), contiguous, optional :: ds_ds_old(:, :, :), ds_dpath(:, :, :, :)
      real(wp) :: half_width(n_path_parts), slope(n_path_parts), weights(n_path_parts)
      integer :: i, pusher

      half_width = 0.0_wp
      half_width([path_part%at_start, path_part%at_end]) = self%limit/self%stiffness
      slope = 0.0_wp
      if (present(ds_ds_old)) ds_ds_old = 0.0_wp
      if (present(ds_dpath)) ds_dpath = 0.0_wp
      do i = 1, size(s_old, 1)
         if (self%normal_load_varies) call window(self, path(i, 2, :), half_width, slope)
         call move_slider(s_old(i, 1), path(i, 1, :) - half_width, path(i, 1, :) + half_width, s_new(i, 1), pusher, weights)
         if (.not. (present(ds_ds_old) .and. present(ds_dpath))) cycle
         if (pusher == pushed_by%nothing) then
            ds_ds_old(i, 1, 1) = 1.0_wp
         else
            ds_dpath(i, 1, 1, :) = weights
            if (self%normal_load_varies) then
               ds_dpath(i, 1, 2, :) = merge(-1.0_wp, 1.0_wp, pusher == pushed_by%lower)*slope*weights
            end if
         end if
      end do
   end subroutine jenkins_advance

   subroutine jenkins_advance_line(self, n_coordinates, n_steps, closing, path, states, largest_move)
      class(jenkins_t), intent(in) :: self
      integer, intent(in) :: n_coordinates, n_steps
      real(wp), intent(in) :: closing
      real(wp), intent(in) :: path(n_coordinates, n_path_parts, n_steps)
      real(wp), intent(inout) :: states(self%n_states, n_steps)
      real(wp), intent(out) :: largest_move
      real(wp) :: half_width, w, w_old
      integer :: i

      if (self%normal_load_varies .or. self%n_states > 1) then
         call advance_step_by_step(self, n_coordinates, n_steps, closing, path, states, largest_move)
         return
      end if
      half_width = self%limit/self%stiffness
      largest_move = 0.0_wp
      w = states(1, 1)
      do i = 2, n_steps
         w_old = w
         w = move_steadily(w_old, path(1, :, i), half_width)
         states(1, i) = w
         largest_move = max(largest_move, abs(w - w_old))
      end do
      w = closing*w
      states(1, 1) = move_steadily(w, path(1, :, 1), half_width)
      largest_move = max(largest_move, abs(states(1, 1) - w))
   end subroutine jenkins_advance_line

   !> Path of mu N/k for a path of the normal coordinate, and its slope with respect to that coordinate. If contact
   !> opens or closes within the step, its rates are omitted: no turning point is sought.
   pure subroutine window(self, normal, half_width, slope)
      class(jenkins_t), intent(in) :: self
      real(wp), intent(in) :: normal(:)                               !! (n_path_parts)
      real(wp), intent(out) :: half_width(:), slope(:)                !! (n_path_parts)
      logical :: is_closed(n_path_parts)

      is_closed = self%preload + self%normal_stiffness*normal > 0.0_wp
      is_closed([path_part%start_rate, path_part%end_rate]) = is_closed(path_part%at_start) .and. is_closed(path_part%at_end)
      slope = merge(self%friction_coefficient*self%normal_stiffness/self%stiffness, 0.0_wp, is_closed)
      half_width = slope*normal
      associate (mean => self%friction_coefficient*self%preload/self%stiffness)
         if (is_closed(path_part%at_start)) half_width(path_part%at_start) = half_width(path_part%at_start) + mean
         if (is_closed(path_part%at_end)) half_width(path_part%at_end) = half_width(path_part%at_end) + mean
      end associate
   end subroutine window

   subroutine jenkins_force(self, z, s, f, df_dz, df_ds)
      class(jenkins_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), s(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_ds(:, :, :)
      integer :: c

      associate (n => self%n_states)                                  ! tangential coordinates, followed by a normal one
         f(:, :n) = self%stiffness*(z(:, :n) - s)
         if (self%normal_load_varies) f(:, n + 1) = max(self%preload + self%normal_stiffness*z(:, n + 1), 0.0_wp)
         if (.not. (present(df_dz) .and. present(df_ds))) return
         df_dz = 0.0_wp
         df_ds = 0.0_wp
         do c = 1, n
            df_dz(:, c, c) = self%stiffness
            df_ds(:, c, c) = -self%stiffness
         end do
         if (self%normal_load_varies) then
            df_dz(:, n + 1, n + 1) = merge(self%normal_stiffness, 0.0_wp, self%preload + self%normal_stiffness*z(:, n + 1) > 0.0_wp)
         end if
      end associate
   end subroutine jenkins_force

   pure subroutine jenkins_bounds(self, z, v, lower, upper, lower_rate, upper_rate)
      class(jenkins_t), intent(in) :: self
      real(wp), intent(in) :: z(:), v(:)
      real(wp), intent(out) :: lower(:), upper(:), lower_rate(:), upper_rate(:)
      real(wp) :: half_width, half_width_rate

      half_width = self%limit/self%stiffness
      half_width_rate = 0.0_wp
      if (self%normal_load_varies) then
         half_width = self%friction_coefficient*max(self%preload + self%normal_stiffness*z(2), 0.0_wp)/self%stiffness
         if (half_width > 0.0_wp) half_width_rate = self%friction_coefficient*self%normal_stiffness*v(2)/self%stiffness
      end if
      lower = z(1) - half_width
      upper = z(1) + half_width
      lower_rate = v(1) - half_width_rate
      upper_rate = v(1) + half_width_rate
   end subroutine jenkins_bounds

   pure subroutine jenkins_switches(self, z, v, values)
      class(jenkins_t), intent(in) :: self
      real(wp), intent(in) :: z(:), v(:)
      real(wp), intent(out) :: values(:)

      if (self%normal_load_varies) values = self%preload + self%normal_stiffness*z(size(z))
   end subroutine jenkins_switches
end module hb_law_jenkins
