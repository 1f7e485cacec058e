!> `nhbm solve`: solves all points of an input and writes the result file.
module verb_solve
   use, intrinsic :: iso_fortran_env, only: output_unit
   use arguments, only: arguments_t, default_output
   use hb_available_memory, only: available_memory
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_mpi, only: broadcast_text, comm_t, max_over, rank_of, ranks_on_node, share_error, size_of
   use hb_outcome, only: outcome, outcome_text
   use hb_progress, only: log_level
   use hb_sweep, only: new_study, run_study, run_summary_t, study_t
   use hb_text, only: read_text_file, to_text
   use hb_timing, only: timing_lines
   implicit none
   private
   public :: load_study, run_solve

contains

   !> Runs the verb; `all_converged` tells whether every point did.
   subroutine run_solve(options, comm, all_converged, error)
      type(arguments_t), intent(in) :: options
      type(comm_t), intent(in) :: comm
      logical, intent(out) :: all_converged
      type(error_t), allocatable, intent(out) :: error
      type(study_t) :: study
      type(run_summary_t) :: summary
      character(:), allocatable :: path
      logical :: tells

      all_converged = .false.
      path = default_output(options%input)
      if (allocated(options%output)) path = options%output
      tells = rank_of(comm) == 0 .and. options%level >= log_level%normal
      call load_study(options, comm, study, error)
      if (allocated(error)) return
      if (tells) write (output_unit, "(a)") "nhbm solve "//options%input//": "// &
         to_text(study%plan%n_points)//" points on "//to_text(size_of(comm))//" ranks, "// &
         to_text(study%scene%tones%n_tones)//" tones, "//to_text(size(study%tuples, 2))//" harmonics"
      call run_study(study, path, options%overwrite, options%level, comm, summary, error)
      if (allocated(error)) return
      all_converged = summary%counts(outcome%converged) == summary%n_points
      if (.not. tells) return
      call write_summary(summary, path)
      if (options%level >= log_level%verbose) call write_times(summary)
   end subroutine run_solve

   subroutine write_times(summary)
      type(run_summary_t), intent(in) :: summary
      character(:), allocatable :: lines(:)
      integer :: i

      lines = timing_lines(summary%times)
      write (output_unit, "(a)") "where the time of the ranks went:", (trim(lines(i)), i=1, size(lines))
   end subroutine write_times

   subroutine write_summary(summary, path)
      type(run_summary_t), intent(in) :: summary
      character(*), intent(in) :: path
      integer :: status

      write (output_unit, "(a)") to_text(summary%counts(outcome%converged))//" of "//to_text(summary%n_points)// &
         " points converged; results in "//path
      do status = outcome%converged + 1, ubound(summary%counts, 1)
         if (summary%counts(status) == 0) cycle
         write (output_unit, "(a)") to_text(summary%counts(status))//" "//outcome_text(status)
      end do
      if (summary%n_rescued > 0) write (output_unit, "(a)") to_text(summary%n_rescued)// &
         " needed more than the direct attempt (see 'rescue' in the results)"
      if (summary%n_certified > 0) write (output_unit, "(a, es7.1, a, es7.1, a)") "largest estimated relative error: ", &
         summary%truncation, " by truncation, ", summary%aliasing, " by aliasing"
      if (summary%n_near_commensurate > 0) write (output_unit, "(a)") "warning: in "// &
         to_text(summary%n_near_commensurate)//" points a low-order combination of the tones nearly vanishes"// &
         " (see 'combination'); such tones are hard to tell from commensurate ones"
   end subroutine write_summary

   !> Reads the input file on rank 0, for all ranks, and makes the study of it.
   subroutine load_study(options, comm, study, error)
      type(arguments_t), intent(in) :: options
      type(comm_t), intent(in) :: comm
      type(study_t), intent(out) :: study
      type(error_t), allocatable, intent(out) :: error
      character(:), allocatable :: text
      real(wp) :: share

      if (rank_of(comm) == 0) call read_text_file(options%input, text, error)
      call share_error(comm, error)
      if (allocated(error)) return
      call broadcast_text(comm, text, 0)
      share = -max_over(comm, -available_memory()/ranks_on_node(comm))   ! the smallest of all ranks
      call new_study(study, options%input, text, options%overrides, error, share)
   end subroutine load_study
end module verb_solve
