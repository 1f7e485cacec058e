!> One curve of a run: its first model is read, or the state at the end of a previous run is restored from the file; then its
!> points are returned one by one (hb_curve_runner), in the form of the file.
module hb_swept_curve
   use hb_cancellation, only: cancellation_t
   use hb_clock, only: wall_clock
   use hb_curve_runner, only: curve_runner_t
   use hb_document, only: document_t
   use hb_error, only: error_t
   use hb_inactive_laws, only: inactive_laws_t
   use hb_kinds, only: wp
   use hb_law_findings, only: law_findings_t
   use hb_model_reader, only: update_model
   use hb_motion_result, only: curve_position_t, motion_result_t
   use hb_outcome, only: is_solved, outcome
   use hb_point_kinds, only: curve_kind
   use hb_point_source, only: point_source_t
   use hb_results, only: results_t
   use hb_results_layout, only: results_layout_t
   use hb_stored_origin, only: request_curve
   use hb_swept_point, only: check_dofs, spread_result
   use hb_system, only: system_t
   implicit none
   private
   public :: new_swept_curve, swept_curve_t

   !> Owns external resources: call `destroy`. A variable of this type needs the attribute `target`.
   type :: swept_curve_t
      integer, allocatable :: stored(:) !! statuses of the points in the file after which it continues
      logical :: is_done = .false.                                    !! there is no further point
      type(law_findings_t) :: law_findings                                  !! at the first point
      type(inactive_laws_t) :: inactive_laws                                  !! in all points
      type(curve_runner_t), private :: runner
   contains
      procedure :: next => swept_curve_next
      procedure :: destroy => swept_curve_destroy
   end type swept_curve_t

contains

   !> Reads the model at the start of the curve with a given first point. An `error` is one of the file; an error of
   !> the curve becomes the status of its first point.
   subroutine new_swept_curve(self, source, results, first, is_resumed, failure, error)
      type(swept_curve_t), intent(inout), target :: self
      type(point_source_t), intent(in) :: source
      type(results_t), intent(inout) :: results
      integer, intent(in) :: first                                    !! point, from 1
      logical, intent(in) :: is_resumed                               !! the file may contain points of the curve
      type(error_t), allocatable, intent(out) :: failure              !! of the curve
      type(error_t), allocatable, intent(out) :: error
      type(curve_position_t), allocatable :: positions(:)
      integer, allocatable :: status(:)
      type(document_t), target :: document
      integer :: last
      logical :: is_new

      document = source%document
      call source%plan%apply(first, document)
      allocate (self%stored(0))
      associate (model => self%runner%model)
         call update_model(model, document, is_new, failure, source%available_memory, source%callbacks, source%purpose)
         if (.not. allocated(failure)) call check_dofs(model%system, model%options, source%layout, failure)
         if (.not. allocated(failure)) call request_curve(source%plan%curve, model, document, self%runner%request, failure)
      end associate
      if (.not. allocated(failure)) call self%runner%prepare()
      self%is_done = allocated(failure)
      if (self%is_done .or. .not. is_resumed) return
      allocate (positions(source%plan%curve%n_points), status(source%plan%curve%n_points))
      call results%read_curve(first, status, positions, error)
      if (allocated(error)) return
      last = last_step(status, positions%kind, source%plan%curve%jumps)
      if (last == 0) return
      call self%runner%continue_from(positions(:last), failure)
      self%is_done = self%runner%is_done
      self%stored = status(:last)
   end subroutine new_swept_curve

   !> The last of the stored points from which a curve can continue, without gaps before it; 0: none. A curve that jumps goes on
   !> behind a row without a motion.
   pure integer function last_step(status, kind, jumps) result(last)
      integer, intent(in) :: status(:), kind(:)                       !! of all points of the curve
      logical, intent(in) :: jumps
      integer :: i

      last = 0
      do i = 1, size(status)
         if (status(i) == outcome%pending) exit
         if (.not. jumps .and. (kind(i) == curve_kind%none .or. .not. (is_solved(status(i)) .or. i == 1))) exit
         if (any(kind(i) == [curve_kind%regular, curve_kind%start])) last = i
      end do
      if (all(status /= outcome%pending) .and. all(is_solved(status) .or. status == outcome%unused)) last = 0   ! rows are damaged
   end function last_step

   !> Returns the next point; `interrupted` if the run ends first.
   subroutine swept_curve_next(self, layout, rank, result)
      class(swept_curve_t), intent(inout), target :: self
      type(results_layout_t), intent(in) :: layout
      integer, intent(in) :: rank
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable :: error
      type(cancellation_t), target :: cancellation
      type(system_t), pointer :: system
      real(wp) :: started

      started = wall_clock()
      call self%runner%next(cancellation, result, error)
      self%is_done = self%runner%is_done
      if (result%status == outcome%interrupted) return
      associate (model => self%runner%model)
         if (.not. allocated(error)) then
            system => self%runner%system_at(result)
            call self%law_findings%examine(system, model%discretisation, result)
            call self%inactive_laws%examine(system, model%discretisation, result)
            if (.not. layout%has_own_tuples) call spread_result(model%discretisation%harmonics, layout, result)
         end if
      end associate
      result%rank = rank
      result%solve_seconds = wall_clock() - started
   end subroutine swept_curve_next

   !> Frees the curve; safe to call twice.
   subroutine swept_curve_destroy(self)
      class(swept_curve_t), intent(inout) :: self

      call self%runner%destroy()
   end subroutine swept_curve_destroy
end module hb_swept_curve
