!> Order of unknowns in which the entries of a matrix are near its diagonal: that of Cuthill and McKee, which starts at an end of
!> the graph. Source: A. George and J. W. H. Liu, Computer Solution of Large Sparse Positive Definite Systems, Prentice-Hall 1981,
!> chapter 4.
module hb_narrow_order
   implicit none
   private
   public :: narrow_order

contains

   !> Returns the places of n unknowns in that order; each pair (row, column) is coupled.
   function narrow_order(n, row, column) result(place)
      integer, intent(in) :: n
      integer, intent(in) :: row(:), column(:)
      integer :: place(n)
      integer :: first(n + 1), order(n)
      integer, allocatable :: neighbours(:)
      integer :: i, n_before, n_found

      call collect_neighbours(row, column, first, neighbours)
      place = 0                                                       ! not found
      n_found = 0
      do while (n_found < n)                                          ! each part of the graph
         n_before = n_found
         i = minloc(first(2:) - first(:n), dim=1, mask=place == 0)
         call go_through(first, neighbours, i, order, place, n_found)
         i = order(n_found)                                           ! the last one is at an end of the part
         place(order(n_before + 1:n_found)) = 0
         n_found = n_before
         call go_through(first, neighbours, i, order, place, n_found)
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
   subroutine go_through(first, neighbours, start, order, place, n_found)
      integer, intent(in) :: first(:), neighbours(:), start
      integer, intent(inout) :: order(:), place(:), n_found
      integer :: i, i_done, k, n_before

      i_done = n_found
      call add(start)
      do while (i_done < n_found)
         i_done = i_done + 1
         i = order(i_done)
         n_before = n_found
         do k = first(i), first(i + 1) - 1
            if (place(neighbours(k)) == 0) call add(neighbours(k))
         end do
         call sort(order(n_before + 1:n_found))
         do k = n_before + 1, n_found
            place(order(k)) = k
         end do
      end do

   contains

      subroutine add(member)
         integer, intent(in) :: member

         n_found = n_found + 1
         order(n_found) = member
         place(member) = n_found
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
   end subroutine go_through
end module hb_narrow_order
