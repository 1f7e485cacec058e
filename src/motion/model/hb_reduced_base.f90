!> Base frequencies in which the box around a set of tuples is small: which models permit them, and their matrix.
module hb_reduced_base
   use hb_assert, only: assert, asserts_are_on
   use hb_kinds, only: wp
   use hb_options, only: options_t
   use hb_system, only: system_t
   implicit none
   private
   public :: grid_share, max_grid_ratio, may_change_base, min_grid, reduced_base

   integer, parameter :: min_grid = 4096                              !! samples, below which nothing is gained
   real(wp), parameter :: max_grid_ratio = 0.6_wp                     !! samples, relative to those of the given base

contains

   !> Samples of a set in its own base, relative to those in the given one; 1 if they are the same.
   real(wp) function grid_share(system, options, tuples, n_samples) result(share)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      integer, intent(in) :: tuples(:, :)                             !! (n_tones, any)
      integer, intent(in) :: n_samples(:)                             !! in the given base, (n_tones)
      integer, allocatable :: matrix(:, :), inverse(:, :)

      if (asserts_are_on) call assert(size(n_samples) == size(tuples, 1), "grid_share", "samples of each tone")
      share = 1.0_wp
      if (product(real(n_samples, wp)) < min_grid) return
      if (.not. may_change_base(system, options)) return
      call reduced_base(tuples, matrix, inverse)
      share = product((2.0_wp*maxval(abs(matmul(matrix, tuples)), dim=2) + 1.0_wp)/(2.0_wp*maxval(abs(tuples), dim=2) + 1.0_wp))
      if (share > max_grid_ratio) share = 1.0_wp
   end function grid_share

   !> Whether nothing in a model depends on the base itself: laws that take phases or base frequencies do, and so do sectors,
   !> unknown tones and requests for single harmonics. Rigid laws hold at the samples alone, so that their errors depend on the
   !> grid more than those of others do.
   pure logical function may_change_base(system, options) result(may_change)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      integer :: i

      may_change = system%tones%n_tones > 1 .and. .not. any(system%tones%is_unknown) .and. options%accuracy%refines_grid .and. &
                   .not. (system%normal_mode%is_requested .or. system%structure%depends_on_tuple())
      if (may_change .and. allocated(options%accuracy%outputs)) may_change = size(options%accuracy%outputs) == 0
      do i = 1, size(system%laws)
         associate (law => system%laws(i)%law)
            may_change = may_change .and. law%n_phases == 0 .and. .not. (law%needs_frequencies .or. law%is_multiplier)
         end associate
      end do
   end function may_change_base

   !> A base in which the box around some tuples is small: while the product of its sides decreases, rows of A are added to or
   !> subtracted from others, as in Euclid's algorithm. Tuples with an odd sum stay odd.
   subroutine reduced_base(tuples, matrix, inverse)
      integer, intent(in) :: tuples(:, :)                             !! (n_tones, any)
      integer, allocatable, intent(out) :: matrix(:, :), inverse(:, :)
      integer :: there(size(tuples, 1), size(tuples, 2))              ! A j
      integer :: i, k, sign_of, best_i, best_k, best_sign, n
      real(wp) :: ratio, best

      n = size(tuples, 1)
      allocate (matrix(n, n), inverse(n, n), source=0)
      do i = 1, n
         matrix(i, i) = 1
      end do
      inverse = matrix
      there = tuples
      do
         best = 1.0_wp
         do i = 1, n
            do k = 1, n
               if (i == k) cycle
               do sign_of = -1, 1, 2
                  ratio = side(there(i, :) + sign_of*there(k, :))/side(there(i, :))
                  if (ratio >= best) cycle
                  best = ratio
                  best_i = i
                  best_k = k
                  best_sign = sign_of
               end do
            end do
         end do
         if (best >= 1.0_wp) exit
         call add_row(best_i, best_k, best_sign)
      end do
      do i = 1, n                                                     ! sums of an odd column of A are odd again
         if (modulo(sum(inverse(:, i)), 2) == 1) cycle
         do k = 1, n
            if (modulo(sum(inverse(:, k)), 2) == 1) exit
         end do
         sign_of = merge(1, -1, side(there(k, :) + there(i, :)) <= side(there(k, :) - there(i, :)))
         call add_row(k, i, sign_of)
      end do

   contains

      pure real(wp) function side(row)
         integer, intent(in) :: row(:)

         side = 2*maxval(abs(row)) + 1
      end function side

      subroutine add_row(to, from, factor)
         integer, intent(in) :: to, from, factor

         matrix(to, :) = matrix(to, :) + factor*matrix(from, :)
         inverse(:, from) = inverse(:, from) - factor*inverse(:, to)
         there(to, :) = there(to, :) + factor*there(from, :)
      end subroutine add_row
   end subroutine reduced_base
end module hb_reduced_base
