!> The time of each rank by activity: columns of the result file, and a table to print.
module hb_timing
   use hb_kinds, only: wp
   use hb_text, only: to_text
   implicit none
   private
   public :: n_times, rank_times_t, times_of_row, timing_lines

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

   !> Table of all ranks, one line each, and their sum; of many ranks only those with the least and the most idle
   !> time.
   function timing_lines(table) result(lines)
      real(wp), intent(in) :: table(:, :)                             !! (n_times, n_ranks), of hb_mpi%gather_rows
      character(112), allocatable :: lines(:)
      integer, parameter :: most_lines = 32
      integer, allocatable :: shown(:)
      integer :: i, n_ranks

      n_ranks = size(table, 2)
      shown = [(i, i=1, n_ranks)]
      if (n_ranks > most_lines) shown = [minloc(table(7, :)), maxloc(table(7, :))]
      lines = [character(112) :: &
         "    rank    points     draws   reading   solving   writing   drawing      idle     total [s]  overhead/point [s]"]
      do i = 1, size(shown)
         lines = [character(112) :: lines, line_of(to_text(shown(i) - 1), times_of_row(table(:, shown(i))))]
      end do
      if (n_ranks > 1) lines = [character(112) :: lines, line_of("all", times_of_row(sum(table, dim=2)))]
      lines = [character(112) :: lines, "idle share "//share_text(sum(table(7, :)), sum(table(8, :)))// &
               ", solving share "//share_text(sum(table(4, :)), sum(table(8, :)))]
   end function timing_lines

   function line_of(name, times) result(line)
      character(*), intent(in) :: name
      type(rank_times_t), intent(in) :: times
      character(112) :: line

      write (line, "(a8, 2i10, 6f10.3, es14.3)") name, times%n_points, times%n_draws, times%reading, times%solving, &
         times%writing, times%drawing, times%idle, times%total, times%overhead_per_point()
   end function line_of

   function share_text(part, whole) result(text)
      real(wp), intent(in) :: part, whole
      character(:), allocatable :: text
      character(16) :: buffer

      write (buffer, "(f8.2)") 100.0_wp*part/max(whole, tiny(1.0_wp))
      text = trim(adjustl(buffer))//" %"
   end function share_text
end module hb_timing
