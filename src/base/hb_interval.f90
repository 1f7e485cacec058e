!> Search in an ascending table, shared by the laws that are defined by a table.
module hb_interval
   use hb_kinds, only: wp
   implicit none
   private
   public :: interval_of, is_ascending

contains

   !> Number of nodes at or below z, 0 to size(nodes), by bisection.
   pure integer function interval_of(nodes, z) result(low)
      real(wp), intent(in) :: nodes(:)                                !! ascending
      real(wp), intent(in) :: z
      integer :: high, middle

      low = 0
      high = size(nodes) + 1
      do while (high - low > 1)
         middle = (low + high)/2
         if (nodes(middle) <= z) then
            low = middle
         else
            high = middle
         end if
      end do
   end function interval_of

   !> Whether every node is greater than the previous one.
   pure logical function is_ascending(nodes)
      real(wp), intent(in) :: nodes(:)

      is_ascending = all(nodes(2:) > nodes(:size(nodes) - 1))
   end function is_ascending
end module hb_interval
