!> Time integration of a scene as its group `&march` has it: record, coefficients of it, and the state from which it can go on.
module hb_integration
   use hb_error, only: annotate, error_t, fail
   use hb_kinds, only: wp
   use hb_march, only: judge, march_from, march_judgement_t, march_record_t
   use hb_march_config, only: march_start, step_of
   use hb_march_starts, only: motions_of, state_on_sphere
   use hb_march_state, only: march_state_t, new_march_state
   use hb_march_system, only: march_system_t, new_march_system
   use hb_modes, only: modes_t, new_modes
   use hb_record_tones, only: find_tones
   use hb_scene, only: scene_t
   use hb_structure, only: max_dofs, most_dense
   use hb_text, only: to_text
   implicit none
   private
   public :: check_integration, integrate_scene, integration_t

   integer, parameter :: fewest_samples = 32                          ! from which frequencies are read

   !> What time integration has come to.
   type :: integration_t
      type(march_system_t) :: system
      type(march_record_t) :: record
      type(march_judgement_t) :: judgement
      type(march_state_t) :: state                                    !! the last one
      real(wp), allocatable :: omega(:)                               !! base frequencies [rad/s], (n_tones)
      real(wp) :: share = 0.0_wp                                      !! of the power of the record that unknown tones explain
      integer, allocatable :: motion(:)                               !! in which each start ends, from 1; 0: it runs away
      type(march_judgement_t), allocatable :: motions(:)              !! each of them, (maxval(motion))
   end type integration_t

contains

   !> Fails where `&march` does not say what is to be integrated.
   subroutine check_integration(scene, error)
      type(scene_t), intent(in) :: scene
      type(error_t), allocatable, intent(out) :: error

      if (scene%march%duration <= 0.0_wp) then
         call fail(error, "&march: missing key 'duration', which needs a real number [s]")
      else if (scene%march%starts > 1 .and. any(scene%tones%is_unknown)) then
         call fail(error, "&march starts: motions with an unknown tone differ by its phase, too; give 1")
      end if
   end subroutine check_integration

   !> Integrates from rest, from the sum of the `&start` amplitudes, or from the end of an earlier record.
   subroutine integrate_scene(self, scene, error, earlier)
      type(integration_t), intent(out), target :: self
      type(scene_t), intent(in) :: scene
      type(error_t), allocatable, intent(out) :: error
      type(march_state_t), intent(in), optional :: earlier            !! end of an earlier record
      real(wp), allocatable :: frequencies(:)
      real(wp) :: step

      call check_integration(scene, error)
      if (.not. allocated(error)) call guess_frequencies(scene, self%omega, error)
      if (allocated(error)) return
      call scene%structure%refuse_large("marching", max_dofs, error)
      if (allocated(error)) return
      frequencies = scene%harmonics%frequencies(self%omega)
      call new_march_system(self%system, scene%structure, scene%laws, scene%loads%whole(), frequencies, self%omega)
      call new_march_state(self%state, self%system%n_dofs, self%system%laws%n_states)
      if (present(earlier)) then
         self%state = earlier
      else if (scene%march%start == march_start%given) then
         self%state%q = sum(real(scene%start%values), 2)
         self%state%v = matmul(-aimag(scene%start%values), frequencies(scene%start%harmonics))
      end if
      step = step_of(scene%march, self%omega)
      call march_from(self%system, scene%march, step, scene%output%dofs, self%state, self%record, error)
      if (.not. allocated(error)) call read_frequencies(scene, self%record, self%omega, self%share, error)
      if (allocated(error)) return
      frequencies = scene%harmonics%frequencies(self%omega)
      call judge(self%record, frequencies, scene%march%n_peaks, self%judgement, error)
      if (scene%march%starts > 1 .and. .not. allocated(error)) call march_others(scene, frequencies, step, self, error)
   end subroutine integrate_scene

   !> Marches from the other starts, as long as from the first one, and tells motions apart.
   subroutine march_others(scene, frequencies, step, content, error)
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: frequencies(:)                          !! [rad/s], (n_harmonics)
      real(wp), intent(in) :: step                                    !! [s]
      type(integration_t), intent(inout) :: content                 !! with what the first start has come to
      type(error_t), allocatable, intent(out) :: error
      type(march_judgement_t) :: each(scene%march%starts)
      type(march_record_t) :: record
      type(march_state_t) :: state
      type(march_system_t), target :: system
      complex(wp) :: c(size(frequencies), size(scene%output%dofs), scene%march%starts)
      integer :: i, kind(scene%march%starts)
      real(wp) :: size_of_motion, spread(scene%march%starts)

      each(1) = content%judgement
      kind = 1
      do i = 1, size(each)
         call new_march_system(system, scene%structure, scene%laws, scene%loads%whole(), frequencies, scene%tones%omega)
         if (i == 1) then
            size_of_motion = maxval(abs(matmul(content%record%every_displacement, system%laws%shape(scene%output%dofs, :))))
            if (size_of_motion <= 0.0_wp) size_of_motion = max(system%length, tiny(1.0_wp))
         else
            call state_on_sphere(system, scene%tones%omega, size_of_motion, i - 1, state)
            call march_from(system, scene%march, step, scene%output%dofs, state, record, error)
            if (allocated(error)) kind(i) = 0                         ! it runs away from there
            if (kind(i) > 0) call judge(record, frequencies, 0, each(i), error)
         end if
         c(:, :, i) = 0.0_wp
         spread(i) = 0.0_wp
         if (kind(i) == 0) cycle
         c(:, :, i) = each(i)%coefficients
         spread(i) = min(1.0_wp, norm2(each(i)%spread)/max(norm2(abs(c(:, :, i))), tiny(1.0_wp)))
      end do
      if (allocated(error)) deallocate (error)
      content%motion = motions_of(c, kind, spread)
      allocate (content%motions(maxval(content%motion)))
      do i = 1, size(content%motions)
         content%motions(i) = each(findloc(content%motion, i, dim=1))
      end do
   end subroutine march_others

   !> Base frequencies for the march: unknown ones without a first guess take those of the linear structure, the lowest first.
   subroutine guess_frequencies(scene, omega, error)
      type(scene_t), intent(in) :: scene
      real(wp), allocatable, intent(out) :: omega(:)                  !! [rad/s], (n_tones), > 0
      type(error_t), allocatable, intent(out) :: error
      type(modes_t) :: modes
      integer :: m, n

      omega = scene%tones%omega
      if (all(omega > 0.0_wp)) return
      associate (structure => scene%structure)
         call structure%refuse_large("a search for modes", most_dense, error)
         if (.not. allocated(error)) call new_modes(modes, structure%mass, structure%damping, structure%stiffness, error)
      end associate
      n = 0
      do m = 1, size(omega)
         if (allocated(error)) exit
         if (omega(m) > 0.0_wp) cycle
         n = n + 1
         if (n > modes%n_modes) then
            call fail(error, "the linear structure has "//to_text(modes%n_modes)// &
                      " oscillatory modes, not one for each unknown tone")
         else
            omega(m) = modes%frequency(n)
         end if
      end do
      call annotate(error, "give first guesses of the frequencies in &tones")
   end subroutine guess_frequencies

   !> Reads the frequencies of unknown tones from a record. Where it has none, guesses stay and the share is zero.
   subroutine read_frequencies(scene, record, omega, share, error)
      type(scene_t), intent(in) :: scene
      type(march_record_t), intent(in) :: record
      real(wp), intent(inout) :: omega(:)                             !! [rad/s], (n_tones)
      real(wp), intent(out) :: share                                  !! of the power of the record that they explain
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: found(size(omega))

      share = 0.0_wp
      if (.not. any(scene%tones%is_unknown) .or. size(record%every_displacement, 1) < fewest_samples) return
      found = scene%tones%omega                                       ! only guesses of the user count
      call find_tones(record%every_displacement, record%start, record%step, scene%harmonics%tuples, scene%tones%is_unknown, &
                      found, share, error)
      if (share > 0.0_wp) omega = found
   end subroutine read_frequencies
end module hb_integration
