!> An interruption that also shows the progress within a point of a run.
module hb_watched_interruption
   use hb_interruption, only: interruption_t
   use hb_kinds, only: wp
   use hb_mpi, only: work_counter_t
   use hb_progress, only: progress_t
   use hb_text, only: to_text
   implicit none
   private
   public :: watched_t

   type, extends(interruption_t) :: watched_t
      type(progress_t), pointer :: progress => null()                 !! of the run
      type(work_counter_t), pointer :: counter => null()              !! with the tallies of all ranks
   contains
      procedure :: note_level => watched_note_level
      procedure :: note_progress => watched_note_progress
      procedure :: show_within => watched_show_within
   end type watched_t

contains

   recursive subroutine watched_note_level(self, level, n_unknowns, estimate)
      class(watched_t), intent(inout) :: self
      integer, intent(in) :: level, n_unknowns
      real(wp), intent(in) :: estimate
      character(8) :: error

      if (.not. self%progress%is_due()) return
      write (error, "(es8.1)") min(estimate, 1.0_wp)
      call self%show_within("level "//to_text(level)//": "//to_text(n_unknowns)//" unknowns, estimated error "// &
                       trim(adjustl(error)))
   end subroutine watched_note_level

   recursive subroutine watched_note_progress(self, n_done, n_steps)
      class(watched_t), intent(inout) :: self
      integer, intent(in) :: n_done, n_steps

      if (self%progress%is_due()) call self%show_within("time integration")
   end subroutine watched_note_progress

   !> Writes the progress of the run with that within a point of this rank.
   subroutine watched_show_within(self, text, share)
      class(watched_t), intent(inout) :: self
      character(*), intent(in) :: text
      real(wp), intent(in), optional :: share                         !! of the point which is done
      integer :: done, failed

      call self%counter%read_tallies(done, failed)
      call self%progress%show(done, failed, text, share)
   end subroutine watched_show_within
end module hb_watched_interruption
