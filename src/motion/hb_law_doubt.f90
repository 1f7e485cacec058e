!> Whether the derivatives of user laws are those of their forces: compared at the first motion of a run. Newton's method converges
!> to the right motion with wrong ones, but stability, curves and derivatives are then wrong.
module hb_law_doubt
   use hb_kinds, only: two_pi, wp
   use hb_law, only: law_t
   use hb_law_check, only: check_derivatives_at, derivative_check_t
   use hb_law_coordinates, only: law_dofs_of
   use hb_model, only: model_t
   use hb_motion_result, only: motion_result_t
   use hb_outcome, only: is_solved
   use hb_text, only: join
   implicit none
   private
   public :: law_doubt_t

   integer, parameter :: n_samples = 64
   real(wp), parameter :: golden = 0.618033988749895_wp               ! its multiples are spread evenly over the circle

   !> The comparison of a run, made once.
   type :: law_doubt_t
      logical :: is_done = .false.
      character(:), allocatable :: text                               !! what is wrong; not allocated: nothing is known to be
   contains
      procedure :: examine => law_doubt_examine
   end type law_doubt_t

contains

   !> Compares the derivatives of all user laws along a motion, unless this was done before or there is no motion.
   subroutine law_doubt_examine(self, model, motion)
      class(law_doubt_t), intent(inout) :: self
      type(model_t), intent(in) :: model
      type(motion_result_t), intent(in) :: motion
      type(derivative_check_t) :: check
      real(wp), allocatable :: phases(:, :), q(:, :), v(:, :)
      integer, allocatable :: dofs(:), tuples(:, :)
      integer :: i, k, s

      if (self%is_done .or. .not. is_solved(motion%status)) return
      self%is_done = .true.
      if (.not. any([(is_compared(model%laws(i)%law), i=1, size(model%laws))])) return
      if (.not. (allocated(motion%corrected_coefficients) .and. allocated(motion%frequency))) return
      tuples = model%harmonics%tuples
      if (allocated(motion%harmonics%tuples)) tuples = motion%harmonics%tuples
      if (size(motion%corrected_coefficients, 2) /= size(tuples, 2)) return
      allocate (phases(size(tuples, 1), n_samples))
      do s = 1, n_samples
         do k = 1, size(tuples, 1)
            phases(k, s) = two_pi*modulo(s*golden**k, 1.0_wp)
         end do
      end do
      call sample(motion%corrected_coefficients, tuples, motion%frequency, phases, q, v)
      dofs = law_dofs_of(model%laws)
      do i = 1, size(model%laws)
         associate (law => model%laws(i)%law)
            if (.not. is_compared(law)) cycle
            associate (at => [(findloc(dofs, law%dofs(k), dim=1), k=1, size(law%dofs))])
               call check_derivatives_at(law, matmul(q(:, at), law%shape), matmul(v(:, at), law%shape), phases, &
                                         motion%frequency, check)
            end associate
            if (size(check%wrong) == 0) cycle
            if (.not. allocated(self%text)) self%text = ""
            if (len(self%text) > 0) self%text = self%text//new_line("a")
            self%text = self%text//"law '"//law%label//"': "//join(check%wrong, ", ")//" is not the derivative of its force "// &
               "(differences along the motion): stability, curves and derivatives are wrong; correct the law"
         end associate
      end do
   end subroutine law_doubt_examine

   !> Whether the derivatives of a law come from the user, and depend on the motion at the same instant alone.
   pure logical function is_compared(law)
      class(law_t), intent(in) :: law

      is_compared = law%is_users_own .and. law%n_states == 0 .and. .not. law%is_multiplier
   end function is_compared

   !> Displacements and velocities of a motion at phases of its tones.
   pure subroutine sample(coefficients, tuples, omega, phases, q, v)
      real(wp), intent(in) :: coefficients(:, :, :)                   !! (cos and sin, n_harmonics, n_dofs)
      integer, intent(in) :: tuples(:, :)                             !! (n_tones, n_harmonics)
      real(wp), intent(in) :: omega(:)                                !! [rad/s]
      real(wp), intent(in) :: phases(:, :)                            !! (n_tones, n_samples)
      real(wp), allocatable, intent(out) :: q(:, :), v(:, :)          !! (n_samples, n_dofs)
      real(wp) :: phase(size(phases, 2)), rate
      integer :: d, h

      allocate (q(size(phases, 2), size(coefficients, 3)), source=0.0_wp)
      v = q
      do h = 1, size(tuples, 2)
         phase = matmul(real(tuples(:, h), wp), phases)
         rate = dot_product(real(tuples(:, h), wp), omega)
         do d = 1, size(coefficients, 3)
            associate (c => coefficients(1, h, d), s => coefficients(2, h, d))
               q(:, d) = q(:, d) + c*cos(phase) + s*sin(phase)
               v(:, d) = v(:, d) + rate*(s*cos(phase) - c*sin(phase))
            end associate
         end do
      end do
   end subroutine sample
end module hb_law_doubt
