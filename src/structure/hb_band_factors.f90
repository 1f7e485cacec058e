!> LU factors of complex band matrices in the storage and format of LAPACK's `zgbtrf`: by LAPACK, or, of narrow bands, without it.
module hb_band_factors
   use hb_kinds, only: wp
   use hb_lapack, only: zgbtrf, zgbtrs
   use hb_narrow_band, only: factorise_narrow, solve_narrow, widest_narrow
   implicit none
   private
   public :: factorise_band, solve_band

contains

   !> Overwrites a with its factors. `is_singular` if a pivot is too small for division; the factors are then invalid.
   subroutine factorise_band(a, n_lower, n_upper, pivots, is_singular)
      complex(wp), intent(inout), contiguous :: a(:, :)               !! (2 n_lower + n_upper + 1, n), as of `zgbtrf`; the first
                                                                      !! n_lower rows are zero
      integer, intent(in) :: n_lower, n_upper
      integer, intent(out) :: pivots(:)                               !! (n)
      logical, intent(out) :: is_singular
      integer :: info

      if (n_lower + n_upper <= widest_narrow) then
         call factorise_narrow(a, n_lower, n_upper, pivots, is_singular)
      else
         call zgbtrf(size(a, 2), size(a, 2), n_lower, n_upper, a, size(a, 1), pivots, info)
         is_singular = info > 0
      end if
   end subroutine factorise_band

   !> Overwrites b with the solution of A X = b (`form` "N") or A**H X = b (`form` "C"), from the factors of A.
   subroutine solve_band(form, a, n_lower, n_upper, pivots, b)
      character, intent(in) :: form
      complex(wp), intent(in), contiguous :: a(:, :)                  !! as above
      integer, intent(in) :: n_lower, n_upper
      integer, intent(in) :: pivots(:)                                !! (n)
      complex(wp), intent(inout), contiguous :: b(:, :)               !! (n, any)
      integer :: info

      if (n_lower + n_upper <= widest_narrow .and. form == "N") then
         call solve_narrow(a, n_lower, n_upper, pivots, b)
      else
         call zgbtrs(form, size(a, 2), n_lower, n_upper, size(b, 2), a, size(a, 1), pivots, b, size(b, 1), info)
      end if
   end subroutine solve_band
end module hb_band_factors
