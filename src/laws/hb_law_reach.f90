!> Laws with a length within which they exert no force, such as stops and walls: whether a motion reaches them.
module hb_law_reach
   use hb_kinds, only: wp
   use hb_law, only: law_t
   implicit none
   private
   public :: exerts_no_force, has_reach

contains

   !> Whether a law may exert no force on a motion at all, and its force depends on the present motion alone.
   pure logical function has_reach(law)
      class(law_t), intent(in) :: law

      has_reach = (law%length_scale > 0.0_wp .or. (law%is_multiplier .and. .not. law%needs_velocity)) .and. law%n_states == 0 &
                  .and. law%n_phases == 0 .and. .not. (law%is_users_own .or. law%needs_frequencies)
   end function has_reach

   !> Whether the force of a prepared law vanishes along a motion that is multiplied by each of some factors.
   logical function exerts_no_force(law, z, rates, factors) result(is_inactive)
      class(law_t), intent(in) :: law                                 !! prepared
      real(wp), intent(in) :: z(:, :), rates(:, :)                    !! (n_samples, n_coordinates); rates if the law needs them
      real(wp), intent(in) :: factors(:)
      real(wp) :: f(size(z, 1), size(z, 2)), p(size(z, 1), merge(size(z, 2), 0, law%is_multiplier))
      integer :: i

      is_inactive = .true.
      p = 0.0_wp
      do i = 1, size(factors)
         call law%evaluate(factors(i)*z, factors(i)*rates, p, f)
         is_inactive = is_inactive .and. .not. any(abs(f) > 0.0_wp)
      end do
   end function exerts_no_force
end module hb_law_reach
