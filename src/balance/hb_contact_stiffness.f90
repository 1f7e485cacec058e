!> Stiffness of contact laws where they are closed and stuck: the slopes that the laws of a whole model may have at most.
module hb_contact_stiffness
   use hb_kinds, only: wp
   use hb_law, only: law_box_t, law_t
   implicit none
   private
   public :: contact_stiffness_of

   real(wp), parameter :: probed_gaps = 2.0_wp                        !! a gap
   real(wp), parameter :: min_stiffness_ratio = 1.0e-6_wp             !! relative to the stiffest contact

contains

   !> The largest slope of the laws at each coordinate, at rest and when it alone is moved either way beyond the gap of the law;
   !> 0 everywhere if a law is rigid, or defined by the user, who need not have defined it there.
   function contact_stiffness_of(laws, n) result(stiffness)
      type(law_box_t), intent(in) :: laws(:)                          !! on numbers of coordinates
      integer, intent(in) :: n                                        !! coordinates
      real(wp) :: stiffness(n)                                        !! [N/m]
      integer :: i

      stiffness = 0.0_wp
      if (any([(laws(i)%law%is_multiplier .or. laws(i)%law%is_users_own .or. laws(i)%law%n_phases > 0 .or. &
                laws(i)%law%needs_frequencies, i=1, size(laws))])) return
      do i = 1, size(laws)
         call add_law(laws(i)%law, stiffness)
      end do
      stiffness = max(stiffness, min_stiffness_ratio*maxval(stiffness))
   end function contact_stiffness_of

   subroutine add_law(law, stiffness)
      class(law_t), intent(in) :: law
      real(wp), intent(inout) :: stiffness(:)
      real(wp), allocatable :: df_dp(:, :, :), df_dv(:, :, :), df_dz(:, :, :), f(:, :), p(:, :), v(:, :), z(:, :)
      real(wp) :: distance, here(size(law%dofs), size(law%dofs))
      integer :: c, k, m, n

      m = size(law%shape, 2)
      n = 2*m + 1
      distance = probed_gaps*law%length_scale
      if (.not. distance > 0.0_wp) distance = sqrt(epsilon(1.0_wp))
      allocate (z(n, m), f(n, m), df_dz(n, m, m), source=0.0_wp)
      allocate (v(n, merge(m, 0, law%needs_velocity)), p(n, 0), source=0.0_wp)
      allocate (df_dv(n, m, size(v, 2)), df_dp(n, m, 0), source=0.0_wp)
      do c = 1, m
         z(2*c, c) = distance
         z(2*c + 1, c) = -distance
      end do
      call law%evaluate(z, v, p, f, df_dz, df_dv, df_dp)
      here = 0.0_wp
      do k = 1, n
         here = max(here, abs(matmul(law%shape, matmul(df_dz(k, :, :), transpose(law%shape)))))
      end do
      do k = 1, size(law%dofs)
         stiffness(law%dofs(k)) = max(stiffness(law%dofs(k)), here(k, k))
      end do
   end subroutine add_law
end module hb_contact_stiffness
