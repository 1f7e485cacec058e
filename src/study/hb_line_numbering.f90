!> Numbers the branches along a line of a sweep from its motions, which come in pieces, for the command, C and Python alike.
module hb_line_numbering
   use hb_branches, only: is_reported, left_branch, line_t, new_line
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t, new_box
   use hb_kinds, only: wp
   use hb_motion_columns, only: columns_t
   use hb_outcome, only: is_solved
   use hb_sweep_plan, only: sweep_plan_t
   implicit none
   private
   public :: branch_column, line_numbering_t, line_up

   type :: line_numbering_t
      private
      type(line_t) :: line
      integer :: before = 0                                           ! point before the line
      integer :: chain = 1                                            ! largest number of points in a chain
      integer :: last = 0                                             ! position of the last solved point, from 0
      integer :: last_branch = 0                                      ! its branch as it was known
   contains
      procedure :: begin => line_numbering_begin
      procedure :: add => line_numbering_add
      procedure :: number => line_numbering_number
   end type line_numbering_t

contains

   !> The column of the numbers; before a line is numbered it has the points at which a chain left its branch.
   subroutine branch_column(t, leaves_branch)
      class(columns_t), intent(inout) :: t
      logical, intent(in) :: leaves_branch

      call t%integer("branch", "1", "", "segment of the response along the fastest swept parameter, from 1; 0: unknown", &
         merge(left_branch, 0, leaves_branch))
   end subroutine branch_column

   !> Begins the line that follows a point.
   subroutine line_numbering_begin(self, plan, chain, before)
      class(line_numbering_t), intent(out) :: self
      type(sweep_plan_t), intent(in) :: plan
      integer, intent(in) :: chain                                    !! largest number of points of a line in a chain
      integer, intent(in) :: before

      call new_line(self%line, plan%n_fastest())
      self%before = before
      self%chain = chain
      self%last = -chain
   end subroutine line_numbering_begin

   !> Adds consecutive points.
   subroutine line_numbering_add(self, plan, first, status, motion, known_branch)
      class(line_numbering_t), intent(inout) :: self
      type(sweep_plan_t), intent(in) :: plan
      integer, intent(in) :: first                                    !! position on the line, from 1
      integer, intent(in) :: status(:)                                !! (points)
      real(wp), intent(in) :: motion(:, :)                            !! coefficients, (any, points)
      integer, intent(in) :: known_branch(:)                          !! (points), `left_branch` or numbers of a previous run
      integer :: i

      do i = 1, size(status)
         if (.not. is_solved(status(i))) cycle
         associate (position => first + i - 2)
            call self%line%add(position + 1, plan%fastest_value(self%before + position + 1), motion(:, i), &
                               self%last/self%chain == position/self%chain .and. is_reported(self%last_branch, known_branch(i)))
            self%last = position
         end associate
         self%last_branch = known_branch(i)
      end do
   end subroutine line_numbering_add

   !> Numbers the branches of all points of the line, from 1; 0: no motion.
   subroutine line_numbering_number(self, branch)
      class(line_numbering_t), intent(in) :: self
      integer, intent(out) :: branch(:)                               !! (points of the line)

      call self%line%number(branch)
   end subroutine line_numbering_number

   !> Maps motions of points with their own tuples to the tuples of a box, so that they can be compared; tuples outside it
   !> contribute little.
   subroutine line_up(tuples, n_stored, motion, error)
      integer, intent(in) :: tuples(:, :, :)                          !! (n_tones, n_harmonics, points)
      integer, intent(in) :: n_stored                                 !! harmonics of a row of the result file
      real(wp), allocatable, intent(inout) :: motion(:, :)            !! (any, points); on return of the box
      type(error_t), allocatable, intent(out) :: error
      type(harmonics_t) :: box
      real(wp), allocatable :: own(:, :, :), moved(:, :, :), lined_up(:, :)
      integer :: h, k, n_functions, n_tones, order, p

      n_tones = size(tuples, 1)
      order = 0
      do while ((2*order + 3.0_wp)**n_tones + 1.0_wp <= 2.0_wp*n_stored)
         order = order + 1
      end do
      call new_box(box, spread(order, 1, n_tones), .false., error)
      if (allocated(error)) return
      n_functions = size(motion, 1)/(2*size(tuples, 2))
      allocate (moved(2, size(box%tuples, 2), n_functions))
      allocate (lined_up(size(moved), size(motion, 2)))
      do p = 1, size(motion, 2)
         own = reshape(motion(:, p), [2, size(tuples, 2), n_functions])
         moved = 0.0_wp
         do h = 1, size(tuples, 2)
            if (h > 1 .and. all(tuples(:, h, p) == 0)) exit           ! unused
            k = box%index_of(tuples(:, h, p))
            if (k > 0) moved(:, k, :) = own(:, h, :)
         end do
         lined_up(:, p) = reshape(moved, [size(moved)])
      end do
      call move_alloc(lined_up, motion)
   end subroutine line_up
end module hb_line_numbering
