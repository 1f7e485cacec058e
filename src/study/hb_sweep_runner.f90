!> The points of a sweep in one process, in the order and from the first guesses of a run of the command: its chains can be
!> distributed over several such processes.
module hb_sweep_runner
   use hb_chain_check, only: chain_check_t
   use hb_chained_points, only: are_checked, is_chained, length_of_units
   use hb_document, only: document_t
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   use hb_line_numbering, only: line_numbering_t, line_up
   use hb_model_reader, only: update_model
   use hb_motion_result, only: motion_result_t
   use hb_namelist, only: set_text, write_complete_text
   use hb_neighbour, only: neighbour_t
   use hb_options, only: share_of_integrated
   use hb_point_source, only: point_source_t
   use hb_results_layout, only: rank_times_t
   use hb_schedule, only: new_schedule, schedule_t
   use hb_swept_point, only: note_dofs, run_point
   implicit none
   private
   public :: sweep_runner_t

   type :: sweep_runner_t
      logical :: is_begun = .false.
      character(:), allocatable :: input                              !! complete, of the first point
      integer :: n_units = 0                                          !! chains, or points that start alone
      type(schedule_t), private :: schedule
      type(neighbour_t), private :: neighbour
      type(chain_check_t), allocatable, private :: check
      type(rank_times_t), private :: times
      logical, private :: is_checked = .false.
      integer, private :: chain = 1                                   ! largest number of points of a unit
      integer, private :: unit = 0, last_unit = 0                     ! the present one, and the last of those that are selected
      integer, private :: point = 0, last_point = 0                   ! the next one, and the last of the unit
   contains
      procedure :: begin => sweep_runner_begin
      procedure :: select => sweep_runner_select
      procedure :: has_next => sweep_runner_has_next
      procedure :: next => sweep_runner_next
      procedure :: number_branches => sweep_runner_number_branches
   end type sweep_runner_t

contains

   !> Begins the sweep of a source, whose document, plan, model, callbacks and purpose are set.
   subroutine sweep_runner_begin(self, source, error)
      class(sweep_runner_t), intent(out) :: self
      type(point_source_t), intent(inout), target :: source
      type(error_t), allocatable, intent(out) :: error
      type(document_t), target :: first

      if (allocated(source%plan%curve)) then
         call fail(error, "&curve: a sweep of points has no curve; trace one curve for each value")
         return
      end if
      call read_first(source, first, error)
      if (.not. allocated(error)) call source%model%system%check_balance(error)
      if (.not. allocated(error)) call source%plan%reject_tied(first, error)
      if (allocated(error)) return
      call source%plan%note_units(first)
      if (is_chained(source%plan, source%model)) then
         call set_text(source%document, "solver%first_guess", "'neighbour'", error)
         if (.not. allocated(error)) call read_first(source, first, error)
         if (allocated(error)) return
      end if
      call write_complete_text(first, self%input)
      call note_dofs(source%model%system, source%model%options, source%layout)
      source%layout%has_own_tuples = source%model%options%accuracy%grows_set
      self%is_checked = are_checked(source%plan, source%model)
      self%chain = length_of_units(source%plan, source%model)
      call new_schedule(self%schedule, source%plan%n_points, source%plan%n_fastest(), self%chain, n_ranks=1, block_seconds=0.0_wp)
      self%n_units = self%schedule%n_units
      self%is_begun = .true.
      call self%select(1, self%n_units)
   end subroutine sweep_runner_begin

   !> Reads the model of the first point.
   subroutine read_first(source, first, error)
      type(point_source_t), intent(inout) :: source
      type(document_t), intent(out), target :: first                  !! with the values of the point
      type(error_t), allocatable, intent(out) :: error
      logical :: is_new

      first = source%document
      call source%plan%apply(1, first)
      call update_model(source%model, first, is_new, error, source%available_memory, source%callbacks, source%purpose)
   end subroutine read_first

   !> Chooses the units whose points follow.
   subroutine sweep_runner_select(self, first, last)
      class(sweep_runner_t), intent(inout) :: self
      integer, intent(in) :: first, last                              !! from 1

      self%unit = first - 1
      self%last_unit = last
      self%point = 0
      self%last_point = -1
   end subroutine sweep_runner_select

   !> Whether the chosen units have a further point.
   pure logical function sweep_runner_has_next(self) result(has_next)
      class(sweep_runner_t), intent(in) :: self

      has_next = self%point <= self%last_point .or. self%unit < self%last_unit
   end function sweep_runner_has_next

   !> Solves the next point of the chosen units; any error becomes its status and message.
   subroutine sweep_runner_next(self, source, result)
      class(sweep_runner_t), intent(inout) :: self
      type(point_source_t), intent(inout), target :: source
      type(motion_result_t), intent(out) :: result
      type(document_t), target :: first
      type(error_t), allocatable :: ignored

      if (self%point > self%last_point) then
         self%unit = self%unit + 1
         call self%schedule%points_of(self%unit, self%point, self%last_point)
         call self%neighbour%forget()
         if (allocated(self%check)) deallocate (self%check)
         if (self%is_checked) allocate (self%check)
      end if
      call run_point(source, self%point, self%neighbour, self%check, self%times, result)
      self%point = self%point + 1
      if (.not. source%model%is_read) call read_first(source, first, ignored)  ! the point is invalid: columns need a model
   end subroutine sweep_runner_next

   !> Numbers the branches of all points along the fastest parameter if it is ordered, hb_branches; 0 otherwise.
   subroutine sweep_runner_number_branches(self, source, status, tuples, motion, branch, error)
      class(sweep_runner_t), intent(in) :: self
      type(point_source_t), intent(in) :: source
      integer, intent(in) :: status(:)                                !! (points)
      integer, intent(in) :: tuples(:, :, :)                          !! (n_tones, n_harmonics, points)
      real(wp), intent(in) :: motion(:, :)                            !! corrected coefficients, (any, points)
      integer, intent(inout) :: branch(:)                             !! (points): -1 where a chain left its branch; the numbers
      type(error_t), allocatable, intent(out) :: error
      type(line_numbering_t) :: numbering
      real(wp), allocatable :: of_line(:, :)
      integer :: first, last, n

      n = source%plan%n_fastest()
      do first = 1, size(branch), n
         last = first + n - 1
         if (source%plan%is_ordered()) then
            of_line = motion(:, first:last)
            if (source%layout%has_own_tuples) call line_up(tuples(:, :, first:last), share_of_integrated* &
                                                           source%model%options%accuracy%max_harmonics, of_line, error)
            if (allocated(error)) return
            call numbering%begin(source%plan, self%chain, first - 1)
            call numbering%add(source%plan, 1, status(first:last), of_line, branch(first:last))
            call numbering%number(branch(first:last))
         else
            branch(first:last) = 0
         end if
      end do
   end subroutine sweep_runner_number_branches
end module hb_sweep_runner
