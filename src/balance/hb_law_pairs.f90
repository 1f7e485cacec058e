!> Pairs (i, k) of degrees of freedom with d force_i/d motion_k not zero at the same sample, and these derivatives.
!>
!> Explicit laws come first. A multiplier law then sees the reaction p = w.(s - f_explicit)/w.w of each of its coordinates,
!> with the weights w; it passes on what the explicit laws beside it depend on. Laws with memory have no pairs: their forces
!> depend on all samples. Source: docs/user/theory.md, sections 5.3 and 5.4.
module hb_law_pairs
   use hb_fftw, only: real_block_t
   use hb_kinds, only: wp
   use hb_law, only: law_box_t, law_t
   use hb_law_slot, only: slot_t
   implicit none
   private
   public :: add_explicit_derivatives, add_multiplier_derivatives, add_slopes_along, find_pairs

contains

   !> Finds which forces depend on which motions.
   subroutine find_pairs(laws, slots, row, column, pair_at)
      type(law_box_t), intent(in) :: laws(:)
      type(slot_t), intent(in) :: slots(:)
      integer, allocatable, intent(out) :: row(:), column(:)          !! (n_pairs) i and k of each pair
      integer, intent(out) :: pair_at(:, :)                           !! (n_dofs, n_dofs), 0: no pair
      logical, allocatable :: coupled(:, :)
      integer :: a, b, i, pass

      allocate (coupled(size(pair_at, 1), size(pair_at, 2)), source=.false.)
      do pass = 1, 2                                                   ! explicit laws, then multipliers
         do i = 1, size(laws)
            if (laws(i)%law%is_multiplier .neqv. pass == 2) cycle
            if (allocated(slots(i)%memory)) cycle
            associate (columns => slots(i)%columns)
               do b = 1, size(columns)
                  do a = 1, size(columns)
                     coupled(columns(a), columns(b)) = .true.
                     if (pass == 2) coupled(columns(a), :) = coupled(columns(a), :) .or. coupled(columns(b), :)
                  end do
               end do
            end associate
         end do
      end do
      allocate (row(count(coupled)), column(count(coupled)))
      pair_at = 0
      i = 0
      do b = 1, size(coupled, 2)
         do a = 1, size(coupled, 1)
            if (.not. coupled(a, b)) cycle
            i = i + 1
            row(i) = a
            column(i) = b
            pair_at(a, b) = i
         end do
      end do
   end subroutine find_pairs

   !> d force_i/d motion_k += sum over coordinates a, b of shape(i, a) df_a/dz_b shape(k, b), and the same for rates.
   subroutine add_explicit_derivatives(law, slot, pair_at, df_dq, df_dv)
      class(law_t), intent(in) :: law
      type(slot_t), intent(in) :: slot                                !! differentiated
      integer, intent(in) :: pair_at(:, :)                            !! (n_dofs, n_dofs)
      type(real_block_t), intent(inout) :: df_dq, df_dv               !! (n_samples, n_pairs); df_dv empty where no law needs it
      integer :: a, b, i, k, pair
      real(wp) :: weight

      associate (shape => law%shape)
         do k = 1, size(slot%columns)
            do i = 1, size(slot%columns)
               pair = pair_at(slot%columns(i), slot%columns(k))
               do b = 1, size(shape, 2)
                  do a = 1, size(shape, 2)
                     weight = shape(i, a)*shape(k, b)
                     if (weight == 0.0_wp) cycle                       ! most of them where coordinates are degrees of freedom
                     df_dq%values(:, pair) = df_dq%values(:, pair) + weight*slot%df_dz(:, a, b)
                     if (size(slot%v, 2) > 0) then
                        df_dv%values(:, pair) = df_dv%values(:, pair) + weight*slot%df_dv(:, a, b)
                     end if
                  end do
               end do
            end do
         end do
      end associate
   end subroutine add_explicit_derivatives

   !> Adds what forces answer along a direction: the sum over pairs (i, k) of df_i/dq_k q_k + df_i/dv_k v_k + df_i/ds_k s_k. Rates
   !> and reactions that no law needs have no samples.
   subroutine add_slopes_along(row, column, df_dq, df_dv, df_ds, q, v, s, f)
      integer, intent(in) :: row(:), column(:)                        !! (n_pairs) i and k of each pair
      type(real_block_t), intent(in) :: df_dq, df_dv, df_ds           !! (n_samples, n_pairs)
      type(real_block_t), intent(in) :: q, v, s                       !! (n_samples, n_dofs)
      type(real_block_t), intent(in) :: f                             !! what it points to is added to
      integer :: i

      do i = 1, size(row)
         associate (answer => f%values(:, row(i)), k => column(i))
            answer = answer + df_dq%values(:, i)*q%values(:, k)
            if (associated(v%values)) answer = answer + df_dv%values(:, i)*v%values(:, k)
            if (associated(s%values)) answer = answer + df_ds%values(:, i)*s%values(:, k)
         end associate
      end do
   end subroutine add_slopes_along

   !> Chain rule through p_b = w_b.(s - f_explicit)/w_b.w_b for a law of coordinates with the weights w_b, orthogonal to each
   !> other. Its degrees of freedom belong to no other multiplier, so what stands in their rows so far is explicit.
   subroutine add_multiplier_derivatives(law, slot, pair_at, needs_velocity, df_dq, df_dv, df_ds)
      class(law_t), intent(in) :: law
      type(slot_t), intent(in) :: slot                                !! differentiated
      integer, intent(in) :: pair_at(:, :)                            !! (n_dofs, n_dofs)
      logical, intent(in) :: needs_velocity                           !! of any law; else df_dv is empty
      type(real_block_t), intent(inout) :: df_dq, df_dv, df_ds        !! (n_samples, n_pairs)
      integer :: a, b, i, k, own, pair
      real(wp), dimension(size(law%shape, 2)) :: square, w_k
      real(wp), allocatable :: explicit_q(:, :), explicit_v(:, :), slope_q(:), slope_v(:), slope_s(:)

      associate (shape => law%shape, columns => slot%columns)
         square = sum(shape**2, dim=1)
         do k = 1, size(pair_at, 2)
            if (pair_at(columns(1), k) == 0) cycle
            own = findloc(columns, k, dim=1)
            w_k = 0.0_wp
            if (own > 0) w_k = shape(own, :)
            explicit_q = explicit_slopes(df_dq%values, k)
            if (needs_velocity) explicit_v = explicit_slopes(df_dv%values, k)
            do a = 1, size(shape, 2)
               slope_q = spread(0.0_wp, 1, size(slot%f, 1))
               slope_s = slope_q
               if (needs_velocity) slope_v = slope_q
               do b = 1, size(shape, 2)
                  slope_q = slope_q - slot%df_dp(:, a, b)*explicit_q(:, b)
                  if (needs_velocity) slope_v = slope_v - slot%df_dp(:, a, b)*explicit_v(:, b)
                  if (w_k(b) == 0.0_wp) cycle                          ! most of them where coordinates are degrees of freedom
                  slope_q = slope_q + w_k(b)*slot%df_dz(:, a, b)
                  if (size(slot%v, 2) > 0) slope_v = slope_v + w_k(b)*slot%df_dv(:, a, b)
                  slope_s = slope_s + w_k(b)/square(b)*slot%df_dp(:, a, b)
               end do
               do i = 1, size(columns)
                  if (shape(i, a) == 0.0_wp) cycle
                  pair = pair_at(columns(i), k)
                  df_dq%values(:, pair) = df_dq%values(:, pair) + shape(i, a)*slope_q
                  if (needs_velocity) df_dv%values(:, pair) = df_dv%values(:, pair) + shape(i, a)*slope_v
                  df_ds%values(:, pair) = df_ds%values(:, pair) + shape(i, a)*slope_s
               end do
            end do
         end do
      end associate

   contains

      !> w_b.(d f_explicit/d motion_k)/w_b.w_b of all coordinates b.
      function explicit_slopes(derivative, k) result(slopes)
         real(wp), intent(in) :: derivative(:, :)
         integer, intent(in) :: k
         real(wp) :: slopes(size(derivative, 1), size(law%shape, 2))
         integer :: c, m

         slopes = 0.0_wp
         associate (shape => law%shape, columns => slot%columns)
            do c = 1, size(shape, 2)
               do m = 1, size(columns)
                  if (shape(m, c) == 0.0_wp) cycle
                  slopes(:, c) = slopes(:, c) + shape(m, c)/square(c)*derivative(:, pair_at(columns(m), k))
               end do
            end do
         end associate
      end function explicit_slopes
   end subroutine add_multiplier_derivatives
end module hb_law_pairs
