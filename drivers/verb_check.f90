!> `nhbm check`: reads an input as `solve` would, every point of it, and says what it asks for.
module verb_check
   use, intrinsic :: iso_fortran_env, only: output_unit
   use arguments, only: arguments_t
   use hb_error, only: annotate, error_t
   use hb_law_set, only: law_dofs_of
   use hb_mpi, only: comm_t, rank_of
   use hb_namelist, only: document_t
   use hb_scene, only: read_scene, scene_t
   use hb_sweep, only: study_t
   use hb_text, only: to_text
   use verb_solve, only: load_study
   implicit none
   private
   public :: run_check

contains

   !> Runs the verb.
   subroutine run_check(options, comm, error)
      type(arguments_t), intent(in) :: options
      type(comm_t), intent(in) :: comm
      type(error_t), allocatable, intent(out) :: error
      type(study_t) :: study
      integer :: point

      call load_study(options, comm, study, error)
      if (allocated(error)) return
      do point = 2, study%plan%n_points
         call check_point(study, point, error)
         if (allocated(error)) return
      end do
      if (rank_of(comm) == 0) call describe(study)
   end subroutine run_check

   subroutine check_point(study, point, error)
      type(study_t), intent(in) :: study
      integer, intent(in) :: point
      type(error_t), allocatable, intent(out) :: error
      type(document_t), target :: document
      type(scene_t) :: scene

      document = study%document
      call study%plan%apply(point, document, error)
      if (.not. allocated(error)) call read_scene(scene, document, error)
      call annotate(error, "point "//to_text(point)//" ("//study%plan%describe(point)//")")
   end subroutine check_point

   subroutine describe(study)
      type(study_t), intent(in) :: study
      integer, allocatable :: law_dofs(:)
      integer :: i

      associate (scene => study%scene)
         law_dofs = law_dofs_of(scene%laws)
         write (output_unit, "(a)") "points      "//to_text(study%plan%n_points)
         do i = 1, size(study%plan%parameters)
            write (output_unit, "(a)") "sweep       "//study%plan%parameters(i)%path
         end do
         write (output_unit, "(a)") "structure   "//to_text(scene%structure%n_dofs)//" degrees of freedom"
         write (output_unit, "(a, *(a, :, ', '))") "tones       ", &
            (to_text(scene%tones%omega(i))//" rad/s", i=1, scene%tones%n_tones)
         write (output_unit, "(a)") "harmonics   "//to_text(scene%harmonics%n_harmonics)
         write (output_unit, "(a, *(a, :, ' x '))") "samples     ", &
            (to_text(scene%torus%n_samples(i)), i=1, scene%tones%n_tones)
         write (output_unit, "(a)") "unknowns    "//to_text(scene%harmonics%n_coefficients*size(law_dofs))
         do i = 1, size(scene%laws)
            write (output_unit, "(a)") "law         "//scene%laws(i)%law%label
         end do
      end associate
      write (output_unit, "(a)") "the input is sound"
   end subroutine describe
end module verb_check
