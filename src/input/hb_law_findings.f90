!> Whether the derivatives of user laws are those of their forces, and laws that are declared odd are odd: compared at the first
!> motion of a run. Newton's method converges to the right motion with wrong derivatives, but stability, curves and derivatives are
!> then wrong; motions under a law that is wrongly declared odd lack their even harmonics.
module hb_law_findings
   use hb_advice, only: advice, advice_list_t
   use hb_discretisation, only: discretisation_t
   use hb_kinds, only: wp
   use hb_law, only: law_t
   use hb_law_check, only: check_derivatives_at, derivative_check_t
   use hb_motion_result, only: motion_result_t
   use hb_motion_samples, only: sample_motion
   use hb_outcome, only: is_solved
   use hb_system, only: system_t
   use hb_text, only: join
   implicit none
   private
   public :: law_findings_t

   integer, parameter :: n_samples = 64

   !> The comparison of a run, made once.
   type :: law_findings_t
      logical :: is_done = .false.
      type(advice_list_t) :: found                                    !! what is wrong
   contains
      procedure :: examine => law_findings_examine
   end type law_findings_t

contains

   !> Compares the derivatives of all user laws along a motion, unless this was done before or there is no motion.
   subroutine law_findings_examine(self, system, discretisation, motion)
      class(law_findings_t), intent(inout) :: self
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(motion_result_t), intent(in) :: motion
      type(derivative_check_t) :: check
      real(wp), allocatable :: phases(:, :), q(:, :), v(:, :)
      integer, allocatable :: dofs(:)
      integer :: i, k

      if (self%is_done .or. .not. is_solved(motion%status)) return
      self%is_done = .true.
      if (.not. any([(is_compared(system%laws(i)%law), i=1, size(system%laws))])) return
      call sample_motion(discretisation, motion, n_samples, phases, q, v)
      if (.not. allocated(q)) return
      dofs = system%dofs_of_unknowns()
      do i = 1, size(system%laws)
         associate (law => system%laws(i)%law)
            if (.not. is_compared(law)) cycle
            associate (at => [(findloc(dofs, law%dofs(k), dim=1), k=1, size(law%dofs))])
               call check_derivatives_at(law, matmul(q(:, at), law%shape), matmul(v(:, at), law%shape), phases, &
                                         motion%frequency, check)
            end associate
            if (check%mixes_samples) then
               call self%found%add(advice%mixed_samples, a=law%label)
               cycle
            end if
            if (size(check%wrong) > 0) call self%found%add(advice%wrong_derivative, a=law%label, b=join(check%wrong, ", "))
            if (check%is_wrongly_odd) call self%found%add(advice%wrongly_odd, a=law%label)
         end associate
      end do
   end subroutine law_findings_examine

   !> Whether the derivatives of a law come from the user; those with memory are compared when loaded from rest.
   pure logical function is_compared(law)
      class(law_t), intent(in) :: law

      is_compared = law%is_users_own .and. .not. law%is_multiplier
   end function is_compared
end module hb_law_findings
