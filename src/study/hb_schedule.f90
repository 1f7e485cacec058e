!> The points that a rank solves next: arithmetic on numbers drawn from shared counters, the same for a run over ranks
!> and for its simulation.
!> Points that one rank must solve in order form a *unit*: a chain along the fastest swept parameter (hb_neighbour),
!> or a single point. The points of a unit depend on the input alone. A counter contains the number of the next unit;
!> a rank draws a *block* of units from it by one atomic operation that adds the length of the block. The rank chooses
!> this length so that the block takes a given time, estimated from its last block, and is at most a small part of a
!> fair share of the units that remained at the last draw. Slow points are thus drawn one by one, and a rank that
!> meets slow points after fast ones has only a few of them. Source: C. D. Polychronopoulos, D. J. Kuck, Guided
!> self-scheduling, IEEE Transactions on Computers C-36 (1987), with the remainder at the last draw and the limit in
!> time added.
!> One counter serves a few hundred ranks. For more ranks there are several counters, each with its own share of the
!> units. A rank draws from the counter of its group; when that is exhausted it continues with the others, each once,
!> since an exhausted counter remains so.
module hb_schedule
   use hb_common_divisor, only: common_divisor
   use hb_kinds, only: int64, wp
   implicit none
   private
   public :: cursor_t, new_schedule, schedule_t

   integer, parameter :: ranks_per_counter = 256
   integer, parameter :: largest_block = 32                           ! points; more would save no time and risk more
   integer, parameter :: share_divisor = 8                            ! a block is at most this part of a fair share of the rest

   !> The present counter of a rank, and its speed.
   type :: cursor_t
      integer :: counter = 1                                          !! to draw the next number from
      logical :: is_done = .false.                                    !! all counters are exhausted
      integer, private :: n_empty = 0
      integer, private :: seen = -1                                   ! units that the counter had issued, if known
      real(wp), private :: seconds = -1.0_wp                          ! [s] per unit of the last block, if known
   contains
      procedure :: note => cursor_note
   end type cursor_t

   type :: schedule_t
      integer :: n_points = 0                                         !! to solve
      integer :: n_units = 0                                          !! to solve
      integer :: n_counters = 1
      integer, private :: n_ranks = 1, group_size = 1, stride = 1, largest = 1
      integer, private :: line = 1, chain = 1, units_per_line = 1, n_all_units = 0
      integer, allocatable, private :: retained(:)                    ! units, if only some are to be solved
      real(wp) :: block_seconds = 0.0_wp                              !! [s] intended duration of a block
   contains
      procedure :: all_points => schedule_all_points
      procedure :: ask => schedule_ask
      procedure :: restrict_to => schedule_restrict
      procedure :: owner_of => schedule_owner_of
      procedure :: points_of => schedule_points_of
      procedure :: block_of => schedule_block_of
      procedure :: unit_of => schedule_unit_of
      procedure :: cursor_of => schedule_cursor_of
   end type schedule_t

contains

   !> Creates the schedule of `n_points` points. Each `line` consecutive points are a line of the grid along its
   !> fastest parameter, divided into chains of `chain` points; the last chain of a line may be shorter.
   pure subroutine new_schedule(self, n_points, line, chain, n_ranks, block_seconds, group_size)
      type(schedule_t), intent(out) :: self
      integer, intent(in) :: n_points                                 !! a multiple of line
      integer, intent(in) :: line, chain                              !! at least 1
      integer, intent(in) :: n_ranks
      real(wp), intent(in) :: block_seconds                           !! [s] intended duration of a block
      integer, intent(in), optional :: group_size                     !! ranks that share a counter, default ranks_per_counter

      self%n_points = n_points
      self%line = line
      self%chain = min(chain, line)
      self%units_per_line = (line + self%chain - 1)/self%chain
      self%n_all_units = (n_points/line)*self%units_per_line
      self%n_units = self%n_all_units
      self%n_ranks = n_ranks
      self%block_seconds = block_seconds
      self%group_size = ranks_per_counter
      if (present(group_size)) self%group_size = group_size
      self%group_size = min(self%group_size, n_ranks)
      self%n_counters = (n_ranks + self%group_size - 1)/self%group_size
      self%largest = max(1, largest_block/self%chain)
      self%stride = max(1, nint(0.618*self%n_counters))               ! visits distant groups early
      do while (common_divisor([self%stride, self%n_counters]) > 1)
         self%stride = self%stride + 1
      end do
   end subroutine new_schedule

   !> Unit that contains a point, both from 1, among all units. A point can only be solved again together with its
   !> whole unit.
   pure integer function schedule_unit_of(self, point)
      class(schedule_t), intent(in) :: self
      integer, intent(in) :: point

      schedule_unit_of = ((point - 1)/self%line)*self%units_per_line + modulo(point - 1, self%line)/self%chain + 1
   end function schedule_unit_of

   !> Restricts the schedule to the units that contain one of the points: a chain with a missing point is solved again
   !> from its beginning, because its points start from each other.
   pure subroutine schedule_restrict(self, points)
      class(schedule_t), intent(inout) :: self
      integer, intent(in) :: points(:)                                !! from 1
      logical :: is_retained(self%n_all_units)
      integer :: first, i, last

      is_retained = .false.
      do i = 1, size(points)
         is_retained(self%unit_of(points(i))) = .true.
      end do
      self%retained = pack([(i, i=1, self%n_all_units)], is_retained)
      self%n_units = size(self%retained)
      self%n_points = 0
      do i = 1, self%n_units
         call self%points_of(i, first, last)
         self%n_points = self%n_points + last - first + 1
      end do
   end subroutine schedule_restrict

   !> First and last point of a unit to solve, all from 1.
   pure subroutine schedule_points_of(self, unit, first, last)
      class(schedule_t), intent(in) :: self
      integer, intent(in) :: unit
      integer, intent(out) :: first, last
      integer :: number, position, start_of_line

      number = unit
      if (allocated(self%retained)) number = self%retained(unit)
      start_of_line = ((number - 1)/self%units_per_line)*self%line
      position = modulo(number - 1, self%units_per_line)*self%chain
      first = start_of_line + position + 1
      last = start_of_line + min(position + self%chain, self%line)
   end subroutine schedule_points_of

   !> All points to solve, in the order of the sweep: after `keep` there are more than the given points if chains are
   !> solved again from their beginning.
   pure function schedule_all_points(self) result(points)
      class(schedule_t), intent(in) :: self
      integer :: points(self%n_points)
      integer :: first, i, k, last, n

      n = 0
      do i = 1, self%n_units
         call self%points_of(i, first, last)
         points(n + 1:n + last - first + 1) = [(k, k=first, last)]
         n = n + last - first + 1
      end do
   end function schedule_all_points

   !> Rank, from 0, that owns a counter, from 1: the first of its group.
   pure integer function schedule_owner_of(self, counter)
      class(schedule_t), intent(in) :: self
      integer, intent(in) :: counter

      schedule_owner_of = (counter - 1)*self%group_size
   end function schedule_owner_of

   !> The initial cursor of a rank, counted from 0.
   pure type(cursor_t) function schedule_cursor_of(self, rank)
      class(schedule_t), intent(in) :: self
      integer, intent(in) :: rank

      schedule_cursor_of%counter = rank/self%group_size + 1
   end function schedule_cursor_of

   !> Number of units that the rank should draw from `cursor%counter`: one if it has no estimate yet.
   pure integer function schedule_ask(self, cursor) result(n)
      class(schedule_t), intent(in) :: self
      type(cursor_t), intent(in) :: cursor
      integer :: n_left

      n = 1
      if (cursor%seen < 0 .or. cursor%seconds < 0.0_wp) return
      n_left = share_start(self, cursor%counter + 1) - share_start(self, cursor%counter) - cursor%seen
      n = min(self%largest, n_left/(share_divisor*ranks_of(self, cursor%counter)))
      if (n*cursor%seconds > self%block_seconds) n = int(self%block_seconds/cursor%seconds)
      n = max(1, n)
   end function schedule_ask

   !> Converts the number drawn from `cursor%counter` with `n` into a block of units; if none is left, first > last
   !> and the cursor moves to the next counter.
   pure subroutine schedule_block_of(self, cursor, number, n, first, last)
      class(schedule_t), intent(in) :: self
      type(cursor_t), intent(inout) :: cursor
      integer, intent(in) :: number                                   !! sum of all previous draws
      integer, intent(in) :: n                                        !! result of `ask`
      integer, intent(out) :: first, last                             !! units, from 1
      integer :: end_of_share, start

      start = share_start(self, cursor%counter)
      end_of_share = share_start(self, cursor%counter + 1)
      first = start + number + 1
      last = min(start + number + n, end_of_share)
      cursor%seen = number + n
      if (first <= end_of_share) return
      last = first - 1
      cursor%seen = -1
      cursor%n_empty = cursor%n_empty + 1
      cursor%is_done = cursor%n_empty == self%n_counters
      cursor%counter = modulo(cursor%counter - 1 + self%stride, self%n_counters) + 1
   end subroutine schedule_block_of

   !> Records the duration of the last block.
   pure subroutine cursor_note(self, n_units, seconds)
      class(cursor_t), intent(inout) :: self
      integer, intent(in) :: n_units                                  !! of the block, above 0
      real(wp), intent(in) :: seconds                                 !! [s]

      self%seconds = seconds/n_units
   end subroutine cursor_note

   !> Number of units in the shares of the preceding counters; shares are proportional to the numbers of ranks.
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
end module hb_schedule
