!> The time of each rank by activity, as in the result file.
module hb_timing
   use hb_kinds, only: wp
   implicit none
   private
   public :: n_times, rank_times_t, times_of_row

   integer, parameter :: n_times = 8                                  ! numbers in a row of a table

   !> The activities of one rank between the first draw and the end of the run. The seconds of the parts add up to
   !> `total`, except for the time outside the parts.
   type :: rank_times_t
      integer :: n_points = 0
      integer :: n_draws = 0                                          !! numbers drawn from counters
      real(wp) :: reading = 0.0_wp                                    !! [s] creating models from the input
      real(wp) :: solving = 0.0_wp                                    !! [s]
      real(wp) :: writing = 0.0_wp                                    !! [s]
      real(wp) :: drawing = 0.0_wp                                    !! [s] waiting for counters and tallies
      real(wp) :: idle = 0.0_wp                                       !! [s] waiting for the other ranks at the end
      real(wp) :: total = 0.0_wp                                      !! [s]
   contains
      procedure :: as_row => rank_times_as_row
      procedure :: overhead_per_point => rank_times_overhead_per_point
   end type rank_times_t

contains

   !> Seconds per point that are neither solving nor waiting; 0 without points.
   pure real(wp) function rank_times_overhead_per_point(self)
      class(rank_times_t), intent(in) :: self

      rank_times_overhead_per_point = 0.0_wp
      if (self%n_points > 0) rank_times_overhead_per_point = (self%total - self%solving - self%idle)/self%n_points
   end function rank_times_overhead_per_point

   !> All components as real numbers, to be gathered.
   pure function rank_times_as_row(self) result(row)
      class(rank_times_t), intent(in) :: self
      real(wp) :: row(n_times)

      row = [real(self%n_points, wp), real(self%n_draws, wp), self%reading, self%solving, self%writing, self%drawing, &
             self%idle, self%total]
   end function rank_times_as_row

   !> The inverse of `as_row`.
   pure type(rank_times_t) function times_of_row(row)
      real(wp), intent(in) :: row(n_times)

      times_of_row = rank_times_t(nint(row(1)), nint(row(2)), row(3), row(4), row(5), row(6), row(7), row(8))
   end function times_of_row
end module hb_timing
