!> Which points a rank solves next: pure arithmetic on numbers drawn from shared counters, the same for a run over ranks
!> and for its simulation.
!>
!> Points that must be solved one after the other by one rank form a *unit*: a chain along the fastest swept parameter
!> (hb_neighbour), or a single point. What a unit holds depends on the input alone. Units are handed out in *blocks* of
!> decreasing size: the number that a counter gives says which block it is, so one atomic operation suffices for a block
!> and nobody has to know what remains. Source: S. F. Hummel, E. Schonberg, L. E. Flynn, Factoring: a method for
!> scheduling parallel loops, Communications of the ACM 35 (1992); blocks from numbers: A. Eleliemy, F. M. Ciorba, A
!> distributed chunk calculation approach for self-scheduling, Journal of Computational Science 51 (2021).
!>
!> One counter serves a few hundred ranks. More ranks have several, each with its own share of the units. A rank draws
!> from the counter of its group; when that is empty it goes on to the others, each once, since a counter that is empty
!> stays so.
module hb_schedule
   use hb_kinds, only: int64
   implicit none
   private
   public :: new_schedule, ranks_per_counter, schedule_t, way_t

   integer, parameter :: ranks_per_counter = 256
   integer, parameter :: largest_block = 32                           ! points; more would save no time and risk more
   integer, parameter :: divisor = 4                                  ! a block is this part of a rank's fair share of the rest

   !> Where a rank stands among the counters.
   type :: way_t
      integer :: counter = 1                                          !! to draw the next number from
      logical :: is_done = .false.                                    !! all counters were found empty
      integer, private :: n_empty = 0
   end type way_t

   type :: schedule_t
      integer :: n_points = 0
      integer :: n_units = 0
      integer :: n_counters = 1
      integer, private :: n_ranks = 1, group_size = 1, stride = 1, largest = 1
      integer, private :: line = 1, chain = 1, units_per_line = 1
   contains
      procedure :: owner_of => schedule_owner_of
      procedure :: points_of => schedule_points_of
      procedure :: take => schedule_take
      procedure :: unit_of => schedule_unit_of
      procedure :: way_of => schedule_way_of
   end type schedule_t

contains

   !> Schedule of `n_points` points, of which each run of `line` is a line of the grid along its fastest parameter, cut into
   !> chains of `chain` points; the last of a line may be shorter.
   pure subroutine new_schedule(self, n_points, line, chain, n_ranks, group_size)
      type(schedule_t), intent(out) :: self
      integer, intent(in) :: n_points                                 !! a multiple of line
      integer, intent(in) :: line, chain                              !! 1 or greater
      integer, intent(in) :: n_ranks
      integer, intent(in), optional :: group_size                     !! ranks that share a counter, default ranks_per_counter

      self%n_points = n_points
      self%line = line
      self%chain = min(chain, line)
      self%units_per_line = (line + self%chain - 1)/self%chain
      self%n_units = (n_points/line)*self%units_per_line
      self%n_ranks = n_ranks
      self%group_size = ranks_per_counter
      if (present(group_size)) self%group_size = group_size
      self%group_size = min(self%group_size, n_ranks)
      self%n_counters = (n_ranks + self%group_size - 1)/self%group_size
      self%largest = max(1, largest_block/self%chain)
      self%stride = max(1, nint(0.618*self%n_counters))               ! visits far groups early
      do while (common_divisor(self%stride, self%n_counters) > 1)
         self%stride = self%stride + 1
      end do
   end subroutine new_schedule

   pure integer function common_divisor(a, b)
      integer, intent(in) :: a, b
      integer :: rest, other

      common_divisor = a
      rest = b
      do while (rest > 0)
         other = modulo(common_divisor, rest)
         common_divisor = rest
         rest = other
      end do
   end function common_divisor

   !> Unit that holds a point, both from 1. A point may only be solved again together with its whole unit.
   pure integer function schedule_unit_of(self, point)
      class(schedule_t), intent(in) :: self
      integer, intent(in) :: point

      schedule_unit_of = ((point - 1)/self%line)*self%units_per_line + modulo(point - 1, self%line)/self%chain + 1
   end function schedule_unit_of

   !> First and last point of a unit, all from 1.
   pure subroutine schedule_points_of(self, unit, first, last)
      class(schedule_t), intent(in) :: self
      integer, intent(in) :: unit
      integer, intent(out) :: first, last
      integer :: start_of_line, place

      start_of_line = ((unit - 1)/self%units_per_line)*self%line
      place = modulo(unit - 1, self%units_per_line)*self%chain
      first = start_of_line + place + 1
      last = start_of_line + min(place + self%chain, self%line)
   end subroutine schedule_points_of

   !> Rank, from 0, that holds a counter, from 1: the first of its group.
   pure integer function schedule_owner_of(self, counter)
      class(schedule_t), intent(in) :: self
      integer, intent(in) :: counter

      schedule_owner_of = (counter - 1)*self%group_size
   end function schedule_owner_of

   !> Where a rank, from 0, begins.
   pure type(way_t) function schedule_way_of(self, rank)
      class(schedule_t), intent(in) :: self
      integer, intent(in) :: rank

      schedule_way_of%counter = rank/self%group_size + 1
   end function schedule_way_of

   !> Turns a number drawn from `way%counter` into a block of units, and sends the rank on to the next counter where there
   !> is none left: then first > last.
   pure subroutine schedule_take(self, way, number, first, last)
      class(schedule_t), intent(in) :: self
      type(way_t), intent(inout) :: way
      integer, intent(in) :: number                                   !! from 0
      integer, intent(out) :: first, last                             !! units, from 1
      integer :: start, n

      start = share_start(self, way%counter)
      n = share_start(self, way%counter + 1) - start
      call block_of(n, ranks_of(self, way%counter), self%largest, number, first, last)
      first = start + first
      last = start + last
      if (first <= last) return
      way%n_empty = way%n_empty + 1
      way%is_done = way%n_empty == self%n_counters
      way%counter = modulo(way%counter - 1 + self%stride, self%n_counters) + 1
   end subroutine schedule_take

   !> Number of units in the shares before that of a counter; shares follow the number of ranks.
   pure integer function share_start(self, counter)
      class(schedule_t), intent(in) :: self
      integer, intent(in) :: counter
      integer(int64) :: ranks_before

      ranks_before = min(int(counter - 1, int64)*self%group_size, int(self%n_ranks, int64))
      share_start = int(ranks_before*self%n_units/self%n_ranks)
   end function share_start

   pure integer function ranks_of(self, counter)
      class(schedule_t), intent(in) :: self
      integer, intent(in) :: counter

      ranks_of = min(self%group_size, self%n_ranks - (counter - 1)*self%group_size)
   end function ranks_of

   !> Block `number`, from 0, of `n` units for `n_ranks` ranks: rounds of equal blocks, one for each rank, of
   !> rest/(divisor*n_ranks) units, at most `largest` and at least one. first > last where all are given out.
   pure subroutine block_of(n, n_ranks, largest, number, first, last)
      integer, intent(in) :: n, n_ranks, largest, number
      integer, intent(out) :: first, last                             !! from 1
      integer(int64) :: in_round, left, n_full, round_size, start

      first = 1
      last = 0
      round_size = int(n_ranks, int64)*largest
      n_full = max(0_int64, (n - (divisor - 1)*round_size)/round_size)   ! rounds that the limit decides
      left = number - n_full*n_ranks
      if (left < 0) then
         first = number*largest + 1
         last = first + largest - 1
         return
      end if
      start = n_full*round_size
      do
         if (start >= n) return
         in_round = max(1_int64, min(int(largest, int64), (n - start)/(int(divisor, int64)*n_ranks)))
         if (left < n_ranks .or. in_round == 1) exit
         left = left - n_ranks
         start = start + in_round*n_ranks
      end do
      if (start + left*in_round >= n) return
      first = int(start + left*in_round) + 1
      last = int(min(int(n, int64), first - 1 + in_round))
   end subroutine block_of
end module hb_schedule
