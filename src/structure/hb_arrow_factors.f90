!> Factors of matrices that are diagonal except for a border of some rows and columns, like those of reduced
!> structures:
!>
!>     (d E) (x)   (b)        y = (A - F d^-1 E)^-1 (c - F d^-1 b),   x = d^-1 (b - E y).
!>     (F A) (y) = (c),
module hb_arrow_factors
   use hb_kinds, only: wp
   use hb_lapack, only: zgemm, zgetrf, zgetrs
   implicit none
   private
   public :: arrow_factors_t, new_arrow_factors

   integer, parameter :: min_order = 24
   integer, parameter :: inner_to_border = 4                          ! least number of inner rows per row of the border
   real(wp), parameter :: min_pivot = 1.0e-6_wp                       ! entry of d below which a row exchange would be needed

   type :: arrow_factors_t
      logical :: is_arrow = .false.                                   !! whether the pattern has this form
      integer, allocatable, private :: inner(:), border(:)            ! rows of each
      integer, allocatable, private :: part(:), number(:)             ! of a row: 1 inner, 2 border; its number in that part
      complex(wp), allocatable, private :: d(:), over_d(:)            ! (n_inner), the diagonal and its inverse
      complex(wp), allocatable, private :: e(:, :), f(:, :), a(:, :)  ! (n_inner, n_border), (n_border, n_inner), ...
      integer, allocatable, private :: pivots(:)
   contains
      procedure :: factorise => arrow_factors_factorise
      procedure :: solve => arrow_factors_solve
   end type arrow_factors_t

contains

   !> Determines whether a pattern is diagonal except for a border.
   pure subroutine new_arrow_factors(self, n, row, column)
      type(arrow_factors_t), intent(out) :: self
      integer, intent(in) :: n
      integer, intent(in) :: row(:), column(:)                        !! of the entries
      integer :: e, i, neighbours(n)

      if (n < min_order) return
      neighbours = 0
      do e = 1, size(row)
         if (row(e) == column(e)) cycle
         neighbours(row(e)) = neighbours(row(e)) + 1
         neighbours(column(e)) = neighbours(column(e)) + 1
      end do
      self%part = merge(2, 1, neighbours > n)                         ! counted by rows and by columns
      self%inner = pack([(i, i=1, n)], self%part == 1)
      self%border = pack([(i, i=1, n)], self%part == 2)
      if (size(self%inner) < inner_to_border*size(self%border)) return
      if (any(self%part(row) == 1 .and. self%part(column) == 1 .and. row /= column)) return
      allocate (self%number(n))
      self%number(self%inner) = [(i, i=1, size(self%inner))]
      self%number(self%border) = [(i, i=1, size(self%border))]
      associate (m => size(self%inner), b => size(self%border))
         allocate (self%d(m), self%over_d(m), self%e(m, b), self%f(b, m), self%a(b, b), self%pivots(b))
      end associate
      self%is_arrow = .true.
   end subroutine new_arrow_factors

   !> Factorises; false if an entry of the diagonal nearly vanishes, so that rows would have to be exchanged, or if
   !> the matrix is singular.
   logical function arrow_factors_factorise(self, row, column, value) result(is_done)
      class(arrow_factors_t), intent(inout) :: self
      integer, intent(in) :: row(:), column(:)                        !! as in `new_arrow_factors`
      complex(wp), intent(in) :: value(:)                             !! scaled to one on the diagonal before cancellation
      complex(wp), allocatable :: of_d(:, :)
      integer :: e, i, info, b, m

      self%d = (0.0_wp, 0.0_wp)
      self%e = (0.0_wp, 0.0_wp)
      self%f = (0.0_wp, 0.0_wp)
      self%a = (0.0_wp, 0.0_wp)
      associate (part => self%part, number => self%number)
         do e = 1, size(row)
            if (part(row(e)) == 1) then
               if (part(column(e)) == 1) then
                  self%d(number(row(e))) = value(e)
               else
                  self%e(number(row(e)), number(column(e))) = value(e)
               end if
            else if (part(column(e)) == 1) then
               self%f(number(row(e)), number(column(e))) = value(e)
            else
               self%a(number(row(e)), number(column(e))) = value(e)
            end if
         end do
      end associate
      is_done = all(abs(self%d) > min_pivot)
      if (.not. is_done) return
      self%over_d = 1.0_wp/self%d
      b = size(self%border)
      m = size(self%inner)
      if (b == 0) return
      allocate (of_d, mold=self%e)
      do i = 1, b
         of_d(:, i) = self%e(:, i)*self%over_d
      end do
      call zgemm("N", "N", b, b, m, (-1.0_wp, 0.0_wp), self%f, b, of_d, m, (1.0_wp, 0.0_wp), self%a, b)
      call zgetrf(b, b, self%a, b, self%pivots, info)
      is_done = info == 0
   end function arrow_factors_factorise

   !> Solves A x = b (`form` "N") or A**H x = b ("C") in place.
   subroutine arrow_factors_solve(self, form, x)
      class(arrow_factors_t), intent(in) :: self
      character, intent(in) :: form
      complex(wp), intent(inout) :: x(:, :)                           !! (n, any)
      complex(wp) :: over_d(size(self%inner)), y(size(self%border), size(x, 2)), z(size(self%inner), size(x, 2))
      complex(wp), parameter :: one = (1.0_wp, 0.0_wp)
      integer :: b, i, info, k, m

      b = size(self%border)
      m = size(self%inner)
      k = size(x, 2)
      over_d = self%over_d
      if (form == "C") over_d = conjg(over_d)
      do i = 1, k
         z(:, i) = x(self%inner, i)*over_d
         y(:, i) = x(self%border, i)
      end do
      if (b > 0) then
         if (form == "C") then
            call zgemm("C", "N", b, k, m, -one, self%e, m, z, m, one, y, b)
         else
            call zgemm("N", "N", b, k, m, -one, self%f, b, z, m, one, y, b)
         end if
         call zgetrs(form, b, k, self%a, b, self%pivots, y, b, info)
         do i = 1, k
            z(:, i) = x(self%inner, i)
         end do
         if (form == "C") then
            call zgemm("C", "N", m, k, b, -one, self%f, b, y, b, one, z, m)
         else
            call zgemm("N", "N", m, k, b, -one, self%e, m, y, b, one, z, m)
         end if
         do i = 1, k
            z(:, i) = z(:, i)*over_d
         end do
      end if
      do i = 1, k
         x(self%inner, i) = z(:, i)
         x(self%border, i) = y(:, i)
      end do
   end subroutine arrow_factors_solve
end module hb_arrow_factors
