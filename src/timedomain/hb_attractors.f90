!> The motions in which a model ends from several starts: distinguished, counted, named by their amplitudes.
module hb_attractors
   use hb_cancellation, only: work_is_over
   use hb_discretisation, only: discretisation_t
   use hb_error, only: error_t
   use hb_integrated_motion, only: find_steady_motion
   use hb_integration_starts, only: motions_of, state_on_sphere
   use hb_integration_system, only: integration_state_t, integration_system_t, new_integration_system
   use hb_kinds, only: wp
   use hb_options, only: options_t
   use hb_outcome, only: outcome, outcome_name
   use hb_steady_motion, only: steady_motion_t
   use hb_system, only: system_t
   use hb_text, only: rounded, to_text
   implicit none
   private
   public :: find_from_starts, report_motions

contains

   !> Integrates from as many starts as the model requests, the first one as in `find_steady_motion`. The result is the first
   !> motion of the tones; if there are others, the status is `multiple_attractors`, with their number.
   subroutine find_from_starts(system, discretisation, options, law_dofs, steady, error)
      type(system_t), intent(in) :: system                            !! all tones given
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      integer, intent(in) :: law_dofs(:)
      type(steady_motion_t), intent(out) :: steady
      type(error_t), allocatable, intent(out) :: error
      type(integration_state_t) :: start
      type(integration_system_t) :: equations
      type(steady_motion_t) :: each(options%integration%starts)
      complex(wp), allocatable :: c(:, :, :)
      integer :: i, motion(options%integration%starts)
      real(wp) :: size_of_motion

      call find_steady_motion(system, discretisation, options, law_dofs, steady, error)
      if (options%integration%starts == 1 .or. .not. allocated(steady%averages)) return
      if (allocated(error)) return
      each(1) = steady
      associate (omega => system%tones%omega, frequencies => discretisation%harmonics%frequencies(system%tones%omega))
         call new_integration_system(equations, system%structure, system%laws, system%load_spectrum, omega)
         size_of_motion = maxval(sum(abs(steady%averages), 1))
         if (size_of_motion <= 0.0_wp) size_of_motion = max(equations%length, tiny(1.0_wp))
         do i = 2, size(each)
            call state_on_sphere(equations, omega, size_of_motion, i - 1, start)
            call find_steady_motion(system, discretisation, options, law_dofs, each(i), error, start)
            steady%work = steady%work + each(i)%work
            if (work_is_over()) return
            if (allocated(error)) each(i)%status = outcome%pending    ! it diverges from there
         end do
      end associate
      if (allocated(error)) deallocate (error)
      allocate (c(size(steady%averages, 1), size(steady%averages, 2), size(each)), source=(0.0_wp, 0.0_wp))
      do i = 1, size(each)
         if (each(i)%status == outcome%pending) cycle
         c(:, :, i) = each(i)%averages
         each(i)%spread = min(1.0_wp, each(i)%spread)
         if (each(i)%status == outcome%broadband) each(i)%spread = 1.0_wp
      end do
      motion = motions_of(c, each%status, each%spread)
      i = findloc(each%status, outcome%integrated, dim=1)
      if (i == 0) i = max(1, findloc(motion, 1, dim=1))
      each(i)%work = steady%work
      steady = each(i)
      steady%n_motions = maxval(motion)
      if (steady%n_motions == 0) return
      if (steady%n_motions > 1 .and. steady%status == outcome%integrated) steady%status = outcome%multiple_attractors
      call report_motions(motion, each%status, each%amplitude, steady%message)
   end subroutine find_from_starts

   !> Returns a text with the amplitudes of the motions, and the number of starts that lead to each.
   pure subroutine report_motions(motion, status, amplitude, message)
      integer, intent(in) :: motion(:)                                !! motion in which each start ends; 0: none of them
      integer, intent(in) :: status(:)                                !! of each start, one of `outcome`
      real(wp), intent(in) :: amplitude(:)                            !! of each start [m]
      character(:), allocatable, intent(out) :: message
      integer, parameter :: max_named = 8                            ! limits the length of the message
      integer :: first, k

      message = "integrated from "//to_text(size(motion))//" starts: "//to_text(maxval(motion))//" motion"
      if (maxval(motion) /= 1) message = message//"s"
      do k = 1, min(maxval(motion), max_named)
         first = findloc(motion, k, dim=1)
         message = message//merge(": ", ", ", k == 1)//"amplitude "//rounded(amplitude(first))//" from "// &
                   to_text(count(motion == k))
         if (status(first) /= outcome%integrated) message = message//" ("//outcome_name(status(first))//")"
      end do
      if (maxval(motion) > max_named) message = message//", ..."
      if (any(motion == 0)) message = message//"; no steady state from "//to_text(count(motion == 0))
   end subroutine report_motions
end module hb_attractors
