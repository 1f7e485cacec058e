!> Removal of padding: files of points with their own tuples have room for as many tuples as the input permits; a
!> complete file is reduced to the number that its points use, because with many degrees of freedom padding is most of
!> its size.
module hb_padding
   use hb_error, only: error_t
   use hb_hdf5, only: open_file
   use hb_kinds, only: wp
   use hb_progress, only: progress_t
   use hb_result_columns, only: measure_row, new_plan, plan_t
   use hb_results_file, only: copied_file_t, make_file
   use hb_results_layout, only: results_layout_t
   use hb_results_record, only: open_points, read_record, record_t
   use hb_study, only: describe_layout, row_of_study, study_t
   implicit none
   private
   public :: remove_padding

   real(wp), parameter :: worth_it = 1.0e6_wp                         ! [B] smallest saving that justifies a copy
   integer, parameter :: many_points = 1000                           ! points, whose copy takes a second or more

contains

   !> Replaces a complete file of points with their own tuples by a copy without unused elements if that has less than half
   !> the size. A file with points that could be solved again is not replaced, because they may need the room. After an error
   !> the file is unchanged.
   subroutine remove_padding(study, path, progress, has_time)
      type(study_t), intent(in) :: study
      character(*), intent(in) :: path                                !! of the result file, which must be closed
      type(progress_t), intent(in) :: progress
      logical, intent(in) :: has_time                                 !! for a copy of many points
      type(results_layout_t) :: layout
      type(record_t) :: record
      type(plan_t) :: plan
      type(copied_file_t) :: source
      type(error_t), allocatable :: error
      integer, allocatable :: n_harmonics(:)
      real(wp) :: narrow, wide
      integer :: i, n_datasets

      call row_of_study(study, wide, n_datasets)
      if (study%plan%n_points*wide <= worth_it) return
      call read_record(record, path, error)
      if (allocated(error)) return
      if (size(open_points(record, .true.)) > 0) return
      call open_file(source%file, path, error)
      if (allocated(error)) return
      call source%file%get("n_harmonics", n_harmonics, error)
      if (.not. allocated(error)) then
         call describe_layout(study, record%n_ranks, layout, min(size(record%tuples, 2), max(1, maxval(n_harmonics))))
         call new_plan(plan, layout)
         call measure_row(plan, size(layout%parameters), narrow, n_datasets)
         call row_of_study(study, wide, n_datasets, size(record%tuples, 2))
         if (narrow < 0.5_wp*wide .and. record%n_points*(wide - narrow) > worth_it) then
            if (record%n_points > many_points .and. .not. has_time) then
               call progress%say("complete; no time was left to compact it, which nhbm resume "//path//" does")
            else
               if (record%n_points > many_points) call progress%say("compacting "//path)
               source%rows = [(i, i=1, record%n_points)]
               call make_file(path, layout, plan, .true., error, [source])
            end if
         end if
      end if
      call source%file%close(error)
   end subroutine remove_padding
end module hb_padding
