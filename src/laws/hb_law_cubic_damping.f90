!> Damping that grows with the square of a speed, f = c |a|**2 a, on one coordinate or on several at once.
!>
!> a is the rate of the coordinates, a = v. For two coordinates in a frame that rotates relative to the damped body it
!> is the velocity in the frame of the body: a = v + W J z, J = ((0, -1), (1, 0)); for modes of n nodal diameters in a
!> frame of the speed S relative to the body W = n S. Source: docs/why/theory.md, sections 4 and 5.1. Sign: f stands
!> beside K q on the left-hand side.
module hb_law_cubic_damping
   use hb_kinds, only: wp
   use hb_law, only: law_t, read_dofs
   use hb_properties, only: properties_t
   use hb_structure, only: structure_t
   implicit none
   private
   public :: cubic_damping_t

   type, extends(law_t) :: cubic_damping_t
      real(wp) :: coefficient = 0.0_wp                                !! c [N s**3/m**3]
      real(wp) :: rate = 0.0_wp                                       !! W [rad/s]
   contains
      procedure :: read => cubic_damping_read
      procedure :: evaluate => cubic_damping_evaluate
   end type cubic_damping_t

contains

   !> Reads a `&law type = 'cubic_damping'` group.
   subroutine cubic_damping_read(self, group, structure)
      class(cubic_damping_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(in) :: structure
      real(wp) :: speed
      integer :: n_diameters

      call read_dofs(self, group, structure)
      call group%get("coefficient", self%coefficient)
      call group%get("speed", speed)
      call group%get("n_diameters", n_diameters)
      self%rate = n_diameters*speed
      self%needs_velocity = .true.
      self%degree = 3
      self%has_potential = .not. abs(self%rate) > 0.0_wp
      self%is_odd = .true.
      if (.not. allocated(self%dofs)) return
      if (abs(speed) > 0.0_wp .and. size(self%dofs) /= 2) then
         call group%problem("speed", "only two coordinates can belong to a rotating frame")
      end if
   end subroutine cubic_damping_read

   subroutine cubic_damping_evaluate(self, z, v, p, f, df_dz, df_dv, df_dp)
      class(cubic_damping_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)
      real(wp) :: seen(size(z, 1), size(z, 2)), slope(size(z, 1)), square(size(z, 1))
      integer :: i, k

      seen = v
      if (size(z, 2) == 2) then
         seen(:, 1) = seen(:, 1) - self%rate*z(:, 2)
         seen(:, 2) = seen(:, 2) + self%rate*z(:, 1)
      end if
      square = sum(seen**2, dim=2)
      do i = 1, size(z, 2)
         f(:, i) = self%coefficient*square*seen(:, i)
      end do
      if (.not. (present(df_dz) .and. present(df_dv))) return
      df_dz = 0.0_wp
      do k = 1, size(z, 2)
         do i = 1, size(z, 2)
            slope = 2.0_wp*self%coefficient*seen(:, i)*seen(:, k)     ! df_i/da_k = c (|a|**2 delta_ik + 2 a_i a_k)
            if (i == k) slope = slope + self%coefficient*square
            df_dv(:, i, k) = slope
            if (size(z, 2) /= 2) cycle
            if (k == 1) df_dz(:, i, 2) = -self%rate*slope             ! da_1 = -W dz_2
            if (k == 2) df_dz(:, i, 1) = self%rate*slope              ! da_2 = W dz_1
         end do
      end do
   end subroutine cubic_damping_evaluate
end module hb_law_cubic_damping
