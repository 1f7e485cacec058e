!> Iwan model: Jenkins elements in parallel, f = sum k_i (z - w_i), which slip one after the other (micro-slip).
!>
!> States: the positions w_i of the sliders. Source: W. D. Iwan, J. Applied Mechanics 33 (1966) 893-900;
!> docs/why/theory.md, section 5.5. Sign: f stands beside K q on the left-hand side.
module hb_law_iwan
   use hb_hysteretic_law, only: hysteretic_law_t, n_path_parts, path_part
   use hb_kinds, only: wp
   use hb_numbers, only: numbers_t
   use hb_slider, only: move_slider, pushed_by
   implicit none
   private
   public :: iwan_t

   type, extends(hysteretic_law_t) :: iwan_t
      real(wp), allocatable :: stiffness(:)                           !! k_i [N/m], (n_states)
      real(wp), allocatable :: limit(:)                               !! mu N_i [N], (n_states)
   contains
      procedure :: declare_numbers => iwan_declare_numbers
      procedure :: derive => iwan_derive
      procedure :: advance => iwan_advance
      procedure :: force => iwan_force
      procedure :: bounds => iwan_bounds
   end type iwan_t

contains

   subroutine iwan_declare_numbers(self, numbers)
      class(iwan_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("stiffness", self%stiffness)
      if (allocated(self%stiffness)) then
         call numbers%add("limit", self%limit, n=size(self%stiffness))
      else
         call numbers%add("limit", self%limit)
      end if
   end subroutine iwan_declare_numbers

   pure subroutine iwan_derive(self)
      class(iwan_t), intent(inout) :: self

      self%is_odd = .true.
      self%has_bounds = .true.
      if (allocated(self%stiffness) .and. allocated(self%limit)) then
         self%n_states = size(self%stiffness)
         self%length_scale = minval(self%limit/self%stiffness)
      end if
   end subroutine iwan_derive

   subroutine iwan_advance(self, s_old, path, s_new, ds_ds_old, ds_dpath)
      class(iwan_t), intent(in) :: self
      real(wp), intent(in), contiguous :: s_old(:, :), path(:, :, :)
      real(wp), intent(out), contiguous :: s_new(:, :)
      real(wp), intent(out), contiguous, optional :: ds_ds_old(:, :, :), ds_dpath(:, :, :, :)
      real(wp) :: half_width(n_path_parts), weights(n_path_parts)
      integer :: i, k, pusher

      if (present(ds_ds_old)) ds_ds_old = 0.0_wp
      if (present(ds_dpath)) ds_dpath = 0.0_wp
      half_width = 0.0_wp
      do k = 1, self%n_states
         half_width([path_part%at_start, path_part%at_end]) = self%limit(k)/self%stiffness(k)
         do i = 1, size(s_old, 1)
            call move_slider(s_old(i, k), path(i, 1, :) - half_width, path(i, 1, :) + half_width, s_new(i, k), pusher, weights)
            if (.not. (present(ds_ds_old) .and. present(ds_dpath))) cycle
            if (pusher == pushed_by%nothing) then
               ds_ds_old(i, k, k) = 1.0_wp
            else
               ds_dpath(i, k, 1, :) = weights
            end if
         end do
      end do
   end subroutine iwan_advance

   subroutine iwan_force(self, z, s, f, df_dz, df_ds)
      class(iwan_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), s(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_ds(:, :, :)
      integer :: k

      f(:, 1) = sum(self%stiffness)*z(:, 1)
      do k = 1, self%n_states
         f(:, 1) = f(:, 1) - self%stiffness(k)*s(:, k)
      end do
      if (.not. (present(df_dz) .and. present(df_ds))) return
      df_dz = sum(self%stiffness)
      do k = 1, self%n_states
         df_ds(:, :, k) = -self%stiffness(k)
      end do
   end subroutine iwan_force

   pure subroutine iwan_bounds(self, z, v, lower, upper, lower_rate, upper_rate)
      class(iwan_t), intent(in) :: self
      real(wp), intent(in) :: z(:), v(:)
      real(wp), intent(out) :: lower(:), upper(:), lower_rate(:), upper_rate(:)

      lower = z(1) - self%limit/self%stiffness
      upper = z(1) + self%limit/self%stiffness
      lower_rate = v(1)
      upper_rate = v(1)
   end subroutine iwan_bounds
end module hb_law_iwan
