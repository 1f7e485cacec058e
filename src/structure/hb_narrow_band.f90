!> LU factors of narrow complex band matrices in the storage and format of LAPACK's `zgbtrf`.
!>
!> Chains and beams have one to three diagonals on each side, for which LAPACK, with several calls per row, takes
!> longer than the arithmetic. Source: Golub and Van Loan, Matrix Computations, 4th ed., section 4.3 (band Gaussian
!> elimination with partial pivoting). Their unknowns have the order of Cuthill and McKee, which starts at an end of the graph.
!> Source: A. George and J. W. H. Liu, Computer Solution of Large Sparse Positive Definite Systems, Prentice-Hall 1981, chapter 4.
module hb_narrow_band
   use hb_kinds, only: wp
   implicit none
   private
   public :: factorise_narrow, narrow_order, solve_narrow, widest_narrow

   integer, parameter :: widest_narrow = 12 !! diagonals beside the main one up to which these routines are faster

contains

   !> Overwrites a with its factors. `is_singular` if a pivot is too small for division; the factors are then invalid.
   pure subroutine factorise_narrow(a, n_lower, n_upper, pivots, is_singular)
      complex(wp), intent(inout), contiguous :: a(:, :)               !! (2 n_lower + n_upper + 1, n): element (i, j) in row
                                                                      !! n_lower + n_upper + 1 + i - j; the first n_lower are zero
      integer, intent(in) :: n_lower, n_upper
      integer, intent(out) :: pivots(:)                               !! (n) row with which row i was exchanged
      logical, intent(out) :: is_singular
      complex(wp) :: factor, inverse, retained
      integer :: d, i, j, k, last, n, n_below, p
      real(wp) :: largest

      n = size(a, 2)
      d = n_lower + n_upper + 1
      last = 1
      is_singular = .true.
      do k = 1, n
         n_below = min(n_lower, n - k)
         p = 0
         largest = -1.0_wp
         do i = 0, n_below
            associate (size_of => abs(real(a(d + i, k))) + abs(aimag(a(d + i, k))))
               if (size_of <= largest) cycle
               largest = size_of
               p = i
            end associate
         end do
         if (.not. largest >= tiny(1.0_wp)) return
         pivots(k) = k + p
         last = max(last, min(n, k + n_upper + p))                    ! last column of the rows so far
         if (p > 0) then
            do j = k, last
               retained = a(d + k - j, j)
               a(d + k - j, j) = a(d + k - j + p, j)
               a(d + k - j + p, j) = retained
            end do
         end if
         inverse = (1.0_wp, 0.0_wp)/a(d, k)
         do i = 1, n_below
            a(d + i, k) = inverse*a(d + i, k)
         end do
         do j = k + 1, last
            factor = a(d + k - j, j)
            if (.not. abs(real(factor)) + abs(aimag(factor)) > 0.0_wp) cycle
            do i = 1, n_below
               a(d + k - j + i, j) = a(d + k - j + i, j) - factor*a(d + i, k)
            end do
         end do
      end do
      is_singular = .false.
   end subroutine factorise_narrow

   !> Overwrites b with the solution of A X = B, from the factors of A.
   pure subroutine solve_narrow(a, n_lower, n_upper, pivots, b)
      complex(wp), intent(in), contiguous :: a(:, :)                  !! as above
      integer, intent(in) :: n_lower, n_upper
      integer, intent(in) :: pivots(:)                                !! (n)
      complex(wp), intent(inout), contiguous :: b(:, :)               !! (n, any)
      complex(wp) :: inverse, retained
      integer :: d, i, j, k, n, half_bandwidth

      n = size(a, 2)
      d = n_lower + n_upper + 1
      do k = 1, n
         do j = 1, size(b, 2)
            retained = b(pivots(k), j)
            b(pivots(k), j) = b(k, j)
            b(k, j) = retained
            do i = 1, min(n_lower, n - k)
               b(k + i, j) = b(k + i, j) - retained*a(d + i, k)
            end do
         end do
      end do
      do k = n, 1, -1
         inverse = (1.0_wp, 0.0_wp)/a(d, k)
         half_bandwidth = min(d - 1, k - 1)
         do j = 1, size(b, 2)
            retained = inverse*b(k, j)
            b(k, j) = retained
            do i = 1, half_bandwidth
               b(k - i, j) = b(k - i, j) - retained*a(d - i, k)
            end do
         end do
      end do
   end subroutine solve_narrow

   !> Returns the positions of n unknowns in that order; each pair (row, column) is coupled.
   function narrow_order(n, row, column) result(position)
      integer, intent(in) :: n
      integer, intent(in) :: row(:), column(:)
      integer :: position(n)
      integer :: first(n + 1), order(n)
      integer, allocatable :: neighbours(:)
      integer :: i, n_before, n_found

      call collect_neighbours(row, column, first, neighbours)
      position = 0                                                    ! not found
      n_found = 0
      do while (n_found < n)                                          ! each part of the graph
         n_before = n_found
         i = minloc(first(2:) - first(:n), dim=1, mask=position == 0)
         call append_connected(first, neighbours, i, order, position, n_found)
         i = order(n_found)                                           ! the last one is at an end of the part
         position(order(n_before + 1:n_found)) = 0
         n_found = n_before
         call append_connected(first, neighbours, i, order, position, n_found)
      end do
   end function narrow_order

   !> Collects the neighbours of all unknowns; those of unknown i are neighbours(first(i):first(i + 1) - 1), some of them twice.
   pure subroutine collect_neighbours(row, column, first, neighbours)
      integer, intent(in) :: row(:), column(:)
      integer, intent(out) :: first(:)
      integer, allocatable, intent(out) :: neighbours(:)
      integer :: e, next(size(first))

      first = 0
      do e = 1, size(row)
         first(row(e) + 1) = first(row(e) + 1) + 1
         first(column(e) + 1) = first(column(e) + 1) + 1
      end do
      first(1) = 1
      do e = 2, size(first)
         first(e) = first(e - 1) + first(e)
      end do
      allocate (neighbours(2*size(row)))
      next = first
      do e = 1, size(row)
         neighbours(next(row(e))) = column(e)
         next(row(e)) = next(row(e)) + 1
         neighbours(next(column(e))) = row(e)
         next(column(e)) = next(column(e)) + 1
      end do
   end subroutine collect_neighbours

   !> Appends the unknowns that are connected to `start` to the order, breadth first, those with few neighbours first.
   subroutine append_connected(first, neighbours, start, order, position, n_found)
      integer, intent(in) :: first(:), neighbours(:), start
      integer, intent(inout) :: order(:), position(:), n_found
      integer :: i, i_done, k, n_before

      i_done = n_found
      call add(start)
      do while (i_done < n_found)
         i_done = i_done + 1
         i = order(i_done)
         n_before = n_found
         do k = first(i), first(i + 1) - 1
            if (position(neighbours(k)) == 0) call add(neighbours(k))
         end do
         call sort(order(n_before + 1:n_found))
         do k = n_before + 1, n_found
            position(order(k)) = k
         end do
      end do

   contains

      subroutine add(member)
         integer, intent(in) :: member

         n_found = n_found + 1
         order(n_found) = member
         position(member) = n_found
      end subroutine add

      !> Sorts unknowns by their numbers of neighbours, ascending.
      subroutine sort(members)
         integer, intent(inout) :: members(:)
         integer :: held, k, l

         do k = 2, size(members)
            held = members(k)
            l = k - 1
            do while (l > 0)
               if (first(members(l) + 1) - first(members(l)) <= first(held + 1) - first(held)) exit
               members(l + 1) = members(l)
               l = l - 1
            end do
            members(l + 1) = held
         end do
      end subroutine sort
   end subroutine append_connected
end module hb_narrow_band
