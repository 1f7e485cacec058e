!> Numbers the branches of a run in its result file when all of its points are complete: a jump is assessed from the
!> points on both sides of it, which different ranks may have solved.
module hb_branch_numbers
   use hb_branches, only: jumps_between
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_line_numbering, only: line_numbering_t
   use hb_mpi, only: barrier, comm_t, max_over, rank_of, share_error, size_of, sum_over
   use hb_results, only: results_t
   use hb_sweep_plan, only: sweep_plan_t
   implicit none
   private
   public :: number_branches

   integer, parameter :: max_numbers = 4000000                       ! of motions in memory

contains

   !> Numbers the branches along each line of a sweep whose fastest parameter is ordered, and writes the numbers; collective, and
   !> an error is the same on all ranks.
   subroutine number_branches(results, plan, chain, comm, n_jumps, first_jump, error)
      type(results_t), intent(inout) :: results
      type(sweep_plan_t), intent(in) :: plan
      integer, intent(in) :: chain                                    !! largest number of points of a line in a chain
      type(comm_t), intent(in) :: comm
      integer, intent(out) :: n_jumps
      integer, intent(out) :: first_jump                              !! first point after a jump, counted from 1; 0: none
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: branch(:), points(:)
      integer :: line, n

      n_jumps = 0
      first_jump = 0
      call results%share(size_of(comm), error)
      call share_error(comm, error)
      if (allocated(error)) return
      call barrier(comm)
      n = plan%n_fastest()
      allocate (branch(n))
      do line = rank_of(comm), plan%n_points/n - 1, size_of(comm)
         call number_line(results, plan, chain, line*n, branch, error)
         if (.not. allocated(error)) call results%write_branches(line*n + 1, branch, error)
         if (allocated(error)) exit
         allocate (points, source=jumps_between(branch, n))
         n_jumps = n_jumps + size(points)
         if (first_jump == 0 .and. size(points) > 0) first_jump = line*n + points(1)
         deallocate (points)
      end do
      call share_error(comm, error)
      n_jumps = sum_over(comm, n_jumps)
      if (first_jump == 0) first_jump = huge(1)
      first_jump = -max_over(comm, -first_jump)
      if (n_jumps == 0) first_jump = 0
   end subroutine number_branches

   !> Numbers the branches of the line that follows a point; the motions are read in pieces.
   subroutine number_line(results, plan, chain, before, branch, error)
      type(results_t), intent(in) :: results
      type(sweep_plan_t), intent(in) :: plan
      integer, intent(in) :: chain                                    !! length
      integer, intent(in) :: before                                   !! preceding point
      integer, intent(out) :: branch(:)                               !! (points of the line)
      type(error_t), allocatable, intent(out) :: error
      type(line_numbering_t) :: numbering
      real(wp), allocatable :: motion(:, :)
      integer, allocatable :: status(:), known_branch(:)
      integer :: first, n

      n = min(size(branch), max(1, max_numbers/max(1, results%motion_size())))
      allocate (status(n), known_branch(n))
      call numbering%begin(plan, chain, before)
      do first = 1, size(branch), n
         n = min(n, size(branch) - first + 1)
         call results%read_motions(before + first, status(:n), motion, known_branch(:n), error)
         if (allocated(error)) return
         call numbering%add(plan, first, status(:n), motion, known_branch(:n))
      end do
      call numbering%number(branch)
   end subroutine number_line
end module hb_branch_numbers
