!> Factors that free a matrix of the units of its coordinates and equations.
!>
!> With coordinates x_i = s_i y_i and rows multiplied by r_i the diagonal fixes the products r_i s_i, the balance of rows and
!> columns the ratios. Source: Parlett and Reinsch, Balancing a matrix for calculation of eigenvalues and eigenvectors,
!> Numerische Mathematik 13 (1969), here for a list of entries.
module hb_balancing
   use hb_kinds, only: wp
   implicit none
   private
   public :: balancing_factors

contains

   !> Powers of two d for which the rows and columns of a(i, j) d(j)/d(i) have about equal sums beside the diagonal; a row whose
   !> column is empty there (or a column whose row is) has at most the length 1. All are 1 for a matrix of symmetric size.
   pure function balancing_factors(n, row, column, a) result(d)
      integer, intent(in) :: n
      integer, intent(in) :: row(:), column(:)                        !! (n_entries), each position once
      real(wp), intent(in) :: a(:)                                    !! absolute values, with ones on the diagonal
      real(wp) :: d(n)
      integer, parameter :: max_sweeps = 100
      real(wp), parameter :: worthwhile = 2.0_wp                      ! ratio of sums that remains: the resolution of the factors
      real(wp) :: of_columns(n), of_rows(n), factors(n)
      integer :: e, sweep

      d = 1.0_wp
      do sweep = 1, max_sweeps
         of_columns = 0.0_wp
         of_rows = 0.0_wp
         do e = 1, size(a)
            if (row(e) == column(e)) cycle
            associate (scaled => a(e)*(d(column(e))/d(row(e))))
               of_rows(row(e)) = of_rows(row(e)) + scaled
               of_columns(column(e)) = of_columns(column(e)) + scaled
            end associate
         end do
         factors = factor_of(of_rows, of_columns)
         if (.not. any(factors > worthwhile .or. factors*worthwhile < 1.0_wp)) return
         d = d*2.0_wp**nint(log(factors)/log(2.0_wp))
      end do

   contains

      !> The change of d(i): half of the way of two neighbours that both change; none if nothing couples them.
      elemental real(wp) function factor_of(of_row, of_column)
         real(wp), intent(in) :: of_row, of_column

         factor_of = 1.0_wp
         if (of_row > 0.0_wp .and. of_column > 0.0_wp) then
            factor_of = sqrt(sqrt(of_row/of_column))
         else if (of_row > 1.0_wp) then
            factor_of = of_row
         else if (of_column > 1.0_wp) then
            factor_of = 1.0_wp/of_column
         end if
      end function factor_of
   end function balancing_factors
end module hb_balancing
