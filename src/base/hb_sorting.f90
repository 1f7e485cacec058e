!> The order of numbers by their size: a merge sort, stable.
module hb_sorting
   use hb_kinds, only: wp
   implicit none
   private
   public :: sort_descending

contains

   !> Finds the order of numbers from the largest to the smallest; of equal ones the first comes first.
   pure subroutine sort_descending(values, order)
      real(wp), intent(in) :: values(:)
      integer, intent(out) :: order(:)                                !! positions in `values`, (size(values))
      integer :: merged(size(values)), first, i, j, k, last, middle, width

      order = [(i, i=1, size(values))]
      width = 1
      do while (width < size(values))
         do first = 1, size(values), 2*width
            middle = min(first + width, size(values) + 1)
            last = min(first + 2*width, size(values) + 1)
            i = first
            j = middle
            do k = first, last - 1
               if (takes_first(i, j)) then
                  merged(k) = order(i)
                  i = i + 1
               else
                  merged(k) = order(j)
                  j = j + 1
               end if
            end do
         end do
         order = merged
         width = 2*width
      end do

   contains

      pure logical function takes_first(i, j)
         integer, intent(in) :: i, j

         takes_first = j >= last
         if (i >= middle) return
         if (.not. takes_first) takes_first = values(order(i)) >= values(order(j))
      end function takes_first
   end subroutine sort_descending
end module hb_sorting
