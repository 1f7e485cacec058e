!> Damping that grows with the square of a speed, f = c |a|**2 a, on one coordinate or on several at once.
!>
!> a is the rate of the coordinates, a = v. For two coordinates in a frame that rotates relative to the damped body it
!> is the velocity in the frame of the body: a = v + W J z, J = ((0, -1), (1, 0)); for modes of n nodal diameters in a
!> frame of the speed S relative to the body W = n S. Source: docs/why/theory.md, sections 4 and 5.1. Sign: f stands
!> beside K q on the left-hand side.
module hb_law_cubic_damping
   use hb_kinds, only: wp
   use hb_law, only: law_t, placement_t
   use hb_numbers, only: number_t, numbers_t
   use hb_problems, only: problems_t
   implicit none
   private
   public :: cubic_damping_t

   type, extends(law_t) :: cubic_damping_t
      real(wp) :: coefficient = 0.0_wp                                !! c [N s**3/m**3]
      real(wp) :: speed = 0.0_wp                                      !! of the rotating frame [rad/s]
      integer :: n_diameters = 1
      real(wp) :: rate = 0.0_wp                                       !! W, their product [rad/s]
   contains
      procedure :: declare_numbers => cubic_damping_declare_numbers
      procedure :: placement => cubic_damping_placement
      procedure :: has_valid_numbers => cubic_damping_has_valid_numbers
      procedure :: check => cubic_damping_check
      procedure :: derive => cubic_damping_derive
      procedure :: number_slope => cubic_damping_number_slope
      procedure :: evaluate => cubic_damping_evaluate
   end type cubic_damping_t

contains

   subroutine cubic_damping_declare_numbers(self, numbers)
      class(cubic_damping_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("coefficient", self%coefficient)
      call numbers%add("speed", self%speed)
      call numbers%add("n_diameters", self%n_diameters)
   end subroutine cubic_damping_declare_numbers

   logical function cubic_damping_has_valid_numbers(self) result(are_valid)
      class(cubic_damping_t), intent(in) :: self

      are_valid = .true.
      if (abs(self%speed) > 0.0_wp .and. allocated(self%dofs)) are_valid = size(self%dofs) == 2
   end function cubic_damping_has_valid_numbers

   subroutine cubic_damping_check(self, problems)
      class(cubic_damping_t), intent(in) :: self
      class(problems_t), intent(inout) :: problems

      if (.not. self%has_valid_numbers()) call problems%add("speed", "only two coordinates can belong to a rotating frame")
   end subroutine cubic_damping_check

   pure function cubic_damping_placement(self) result(placement)
      class(cubic_damping_t), intent(in) :: self
      type(placement_t) :: placement

      placement%is_by_dofs = .true.
   end function cubic_damping_placement

   pure subroutine cubic_damping_derive(self)
      class(cubic_damping_t), intent(inout) :: self

      self%rate = self%n_diameters*self%speed
      self%needs_velocity = .true.
      self%needs_displacement = abs(self%rate) > 0.0_wp
      self%degree = 3
      self%has_potential = .not. abs(self%rate) > 0.0_wp
      self%is_odd = .true.
   end subroutine cubic_damping_derive

   subroutine cubic_damping_evaluate(self, z, v, p, f, df_dz, df_dv, df_dp)
      class(cubic_damping_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)
      real(wp) :: seen(size(z, 1), size(z, 2)), slope(size(z, 1)), square(size(z, 1))
      integer :: i, k

      seen = seen_velocity(self, z, v)
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

   subroutine cubic_damping_number_slope(self, number, z, v, p, slope, is_known)
      class(cubic_damping_t), intent(in) :: self
      type(number_t), intent(in) :: number
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: slope(:, :)
      logical, intent(out) :: is_known
      real(wp) :: along(size(z, 1)), seen(size(z, 1), size(z, 2)), square(size(z, 1))
      integer :: i

      is_known = .true.
      seen = seen_velocity(self, z, v)
      square = sum(seen**2, dim=2)
      select case (number%key)
      case ("coefficient")
         do i = 1, size(z, 2)
            slope(:, i) = square*seen(:, i)
         end do
      case ("speed")
         slope = 0.0_wp                                              ! da = n (-z_2, z_1)
         if (size(z, 2) /= 2) return
         along = self%n_diameters*(seen(:, 2)*z(:, 1) - seen(:, 1)*z(:, 2))
         slope(:, 1) = self%coefficient*(2.0_wp*along*seen(:, 1) - self%n_diameters*square*z(:, 2))
         slope(:, 2) = self%coefficient*(2.0_wp*along*seen(:, 2) + self%n_diameters*square*z(:, 1))
      case default
         is_known = .false.
      end select
   end subroutine cubic_damping_number_slope

   !> Velocity in the rotating frame.
   pure function seen_velocity(self, z, v) result(seen)
      class(cubic_damping_t), intent(in) :: self
      real(wp), intent(in) :: z(:, :), v(:, :)
      real(wp) :: seen(size(z, 1), size(z, 2))

      seen = v
      if (size(z, 2) /= 2) return
      seen(:, 1) = seen(:, 1) - self%rate*z(:, 2)
      seen(:, 2) = seen(:, 2) + self%rate*z(:, 1)
   end function seen_velocity
end module hb_law_cubic_damping
