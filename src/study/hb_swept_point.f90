!> One point of a sweep: its values are set in the input, its model is read and solved, and its result is converted to
!> the form of the file, which is the same for all points.
module hb_swept_point
   use hb_cancellation, only: cancellation_t, verdict
   use hb_chain_check, only: chain_check_t
   use hb_clock, only: wall_clock
   use hb_error, only: error_t, fail
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_level, only: level_t
   use hb_model_reader, only: update_model
   use hb_motion_result, only: motion_result_t
   use hb_name_table, only: find_first_equal
   use hb_neighbour, only: neighbour_t
   use hb_options, only: options_t
   use hb_outcome, only: outcome
   use hb_point_runner, only: run_model
   use hb_point_source, only: point_source_t
   use hb_results_layout, only: rank_times_t, results_layout_t
   use hb_system, only: system_t
   use hb_text, only: to_text
   implicit none
   private
   public :: check_dofs, note_dofs, run_point, spread_result

contains

   !> Solves one point; any error becomes its status and message.
   subroutine run_point(source, point, neighbour, check, times, result)
      type(point_source_t), intent(inout), target :: source           !! of this rank
      integer, intent(in) :: point                                    !! from 1
      type(neighbour_t), intent(inout) :: neighbour                   !! solutions of the preceding points of its chain
      type(chain_check_t), intent(inout), optional :: check           !! of this chain
      type(rank_times_t), intent(inout) :: times
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable :: error
      type(level_t) :: level
      type(cancellation_t), target :: cancellation
      real(wp) :: read, started, value
      logical :: is_new

      started = wall_clock()
      call cancellation%enter(huge(1.0_wp))
      call source%plan%apply(point, source%document)
      call update_model(source%model, source%document, is_new, error, source%available_memory, source%callbacks, source%purpose)
      if (is_new .and. .not. allocated(error)) call check_dofs(source%model%system, source%model%options, source%layout, error)
      read = wall_clock()
      value = source%plan%fastest_value(point)
      if (allocated(error)) then
         call result%set_failure(error)
      else
         call cancellation%begin(source%model%options%solver%time_limit)
         call run_model(source%model, value, neighbour, source%cached, result, level, error)
      end if
      if (.not. allocated(error)) then
         call source%law_findings%examine(source%model%system, source%model%discretisation, result)
         call source%inactive_laws%examine(source%model%system, source%model%discretisation, result)
         if (allocated(source%layout%tuples) .and. .not. source%layout%has_own_tuples) &
            call spread_result(source%model%discretisation%harmonics, source%layout, result)
      end if
      if (.not. allocated(error) .and. allocated(level%unknowns)) then
         if (present(check)) call check%examine(source, point, level, result)
         if (result%leaves_branch) call neighbour%forget()
         call neighbour%store(value, level, result%n_levels)
      else
         call neighbour%forget()
      end if
      if (cancellation%verdict == verdict%interrupted) result%status = outcome%interrupted
      call cancellation%leave()
      result%rank = source%rank
      result%solve_seconds = wall_clock() - started
      times%reading = times%reading + read - started
      times%solving = times%solving + wall_clock() - read
   end subroutine run_point

   !> Notes the degrees of freedom and the laws that all points have, for `check_dofs`.
   subroutine note_dofs(system, options, layout)
      type(system_t), intent(in) :: system                            !! of the first point
      type(options_t), intent(in) :: options
      type(results_layout_t), intent(inout) :: layout

      layout%dof_labels = system%structure%labels(options%output%dofs)
      layout%law_dof_labels = system%structure%labels(system%dofs_of_unknowns())
      layout%law_labels = unique_labels(system)
      layout%n_samples = options%output%samples
   end subroutine note_dofs

   !> Rejects a point whose structure or laws have other degrees of freedom: a file has one list of them.
   subroutine check_dofs(system, options, layout, error)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(results_layout_t), intent(in) :: layout
      type(error_t), allocatable, intent(out) :: error
      logical :: is_same

      associate (law_dofs => system%dofs_of_unknowns())
         is_same = size(options%output%dofs) == size(layout%dof_labels) .and. size(law_dofs) == size(layout%law_dof_labels) &
                   .and. size(system%laws) == size(layout%law_labels) .and. size(options%output%samples) == size(layout%n_samples)
         if (is_same) is_same = all(system%structure%labels(options%output%dofs) == layout%dof_labels) .and. &
                                all(system%structure%labels(law_dofs) == layout%law_dof_labels) .and. &
                                all(options%output%samples == layout%n_samples)
      end associate
      if (.not. is_same) call fail(error, "this point has other degrees of freedom or surfaces than the first point; "// &
                                   "list the common ones in &output dofs, or run it by itself")
   end subroutine check_dofs

   !> Spreads the motion of a point over the harmonics of the file.
   subroutine spread_result(harmonics, layout, result)
      type(harmonics_t), intent(in) :: harmonics                      !! of the point
      type(results_layout_t), intent(in) :: layout
      type(motion_result_t), intent(inout) :: result

      if (.not. layout%has_improved .and. allocated(result%improved_coefficients)) deallocate (result%improved_coefficients)
      call result%spread_harmonics(harmonics, layout%tuples)
   end subroutine spread_result

   !> Labels of the laws; if two laws have the same label, the number of the law is added.
   function unique_labels(system) result(labels)
      type(system_t), intent(in) :: system
      character(64) :: labels(size(system%laws))
      integer :: first(size(labels)), i, n, numbered(size(labels))

      do i = 1, size(labels)
         labels(i) = system%laws(i)%law%label
      end do
      call find_first_equal(labels, first)
      n = 0
      do i = 1, size(labels)
         if (first(i) == i .and. .not. any(labels(numbered(:n)) == labels(i))) cycle
         labels(i) = trim(labels(i))//" "//to_text(i)
         n = n + 1
         numbered(n) = i
      end do
   end function unique_labels
end module hb_swept_point
