!> `nhbm march`: follows a scene through time and writes the record.
module verb_march
   use arguments, only: arguments_t
   use console, only: say
   use hb_clock, only: wall_clock
   use hb_coexisting_motions, only: tell_motions
   use hb_document, only: document_t
   use hb_error, only: annotate, error_t, fail
   use hb_file_place, only: check_place
   use hb_input_keys, only: choices_of
   use hb_kinds, only: wp
   use hb_march, only: judge, march_from, march_judgement_t, march_record_t
   use hb_march_config, only: march_start, step_of
   use hb_march_file, only: march_content_t, march_origin_t, read_march_state, write_march_file
   use hb_march_starts, only: motions_of, state_on_sphere
   use hb_march_state, only: march_state_t, new_march_state
   use hb_march_system, only: march_system_t, new_march_system
   use hb_modes, only: modes_t, new_modes
   use hb_mpi, only: comm_t, rank_of, share_error
   use hb_outcome, only: outcome
   use hb_progress, only: log_level, new_progress, progress_t
   use hb_record_tones, only: find_tones
   use hb_run_callbacks, only: run_callbacks
   use hb_scene, only: scene_t
   use hb_scene_reader, only: read_scene
   use hb_structure, only: max_dofs, most_dense
   use hb_study, only: study_t
   use hb_text, only: to_text
   use hb_watch, only: watch_t
   use result_place, only: place_result
   use verb_solve, only: load_study
   implicit none
   private
   public :: run_march

   integer, parameter :: fewest_samples = 32                          ! from which frequencies are read

   type, extends(watch_t) :: shown_progress_t
      type(progress_t) :: line
      logical :: is_begun = .false.
      integer :: level = log_level%normal
      integer :: n_steps = 0
   contains
      procedure :: note_progress => shown_progress_note_progress
   end type shown_progress_t

contains

   !> Runs the verb; one rank does the work.
   subroutine run_march(options, comm, error)
      type(arguments_t), intent(in) :: options
      type(comm_t), intent(in) :: comm
      type(error_t), allocatable, intent(out) :: error
      type(study_t) :: study
      character(:), allocatable :: path

      call load_study(options, comm, study, error)
      if (allocated(error)) return
      call choose_point(options, study, error)
      if (allocated(error)) return
      if (study%scene%march%duration <= 0.0_wp) then
         call fail(error, options%input//": &march: missing key 'duration', which needs a real number [s]")
         return
      end if
      if (study%scene%march%starts > 1 .and. any(study%scene%tones%is_unknown)) then
         call fail(error, options%input//": &march starts: motions with an unknown tone differ by its phase, too; give 1")
         return
      end if
      call place_result(options, comm, path, error)
      if (allocated(error)) return
      if (rank_of(comm) == 0) call march_scene(options, study, path, error)
      call share_error(comm, error)
   end subroutine run_march

   !> Makes the scene of the study that of the point asked for; fails where a sweep leaves the choice open.
   subroutine choose_point(options, study, error)
      type(arguments_t), intent(in) :: options
      type(study_t), intent(inout) :: study
      type(error_t), allocatable, intent(out) :: error
      type(document_t), target :: document

      if (options%point < 0 .and. study%plan%n_points == 1) return
      if (options%point < 0 .and. allocated(study%plan%curve) .and. study%plan%n_points == study%plan%n_fastest()) return  ! start
      if (options%point < 0 .or. options%point >= study%plan%n_points) then
         call fail(error, "the input has the points 0 to "//to_text(study%plan%n_points - 1)// &
                   "; march follows one of them, say which by --point")
         return
      end if
      document = study%document
      call study%plan%apply(options%point + 1, document)
      call read_scene(study%scene, document, error, callbacks=run_callbacks())
      call annotate(error, "point "//to_text(options%point))
   end subroutine choose_point

   subroutine march_scene(options, study, path, error)
      type(arguments_t), intent(in) :: options
      type(study_t), intent(in) :: study
      character(*), intent(in) :: path                                !! of the record
      type(error_t), allocatable, intent(out) :: error
      type(march_system_t), target :: system
      type(march_content_t) :: content
      type(march_origin_t) :: origin
      type(shown_progress_t), target :: progress
      real(wp) :: seconds, share, step
      real(wp), allocatable :: frequencies(:), omega(:)
      character(:), allocatable :: methods(:)
      character(:), allocatable :: motions
      character(300) :: line
      integer :: i

      call check_place(path, options%overwrite, error)
      call annotate(error, "march record '"//path//"'")
      if (allocated(error)) return
      associate (scene => study%scene)
         call guess_frequencies(scene, omega, error)
         if (allocated(error)) return
         call scene%structure%refuse_large("marching", max_dofs, error)
         if (allocated(error)) return
         frequencies = scene%harmonics%frequencies(omega)
         call new_march_system(system, scene%structure, scene%laws, scene%loads%whole(), frequencies, omega)
         call first_state(scene, system, frequencies, content%state, error)
         if (allocated(error)) return
         step = step_of(scene%march, omega)
         progress%level = options%level
         seconds = wall_clock()
         call progress%enter(huge(1.0_wp))
         call march_from(system, scene%march, step, scene%output%dofs, content%state, content%record, error)
         call progress%leave()
         if (allocated(error)) return
         seconds = wall_clock() - seconds
         if (progress%is_begun) call progress%line%finish(progress%n_steps, 0)
         call read_frequencies(scene, content%record, omega, share, error)
         if (allocated(error)) return
         frequencies = scene%harmonics%frequencies(omega)
         call judge(content%record, frequencies, scene%march%n_peaks, content%judgement, error)
         if (allocated(error)) return
         if (scene%march%starts > 1) call march_others(scene, frequencies, step, content, error)
         if (allocated(error)) return
         origin%title = scene%output%title
         methods = choices_of("march", "method")
         origin%method = trim(methods(scene%march%method))
         origin%input_text = study%input_text
         origin%input_complete = study%input_complete
         origin%omega = omega
         origin%tuples = scene%harmonics%tuples
         origin%kept_dofs = scene%output%dofs
         call write_march_file(path, options%overwrite, origin, scene%structure, system%laws, content, error)
      end associate
      if (allocated(error) .or. options%level < log_level%normal) return
      write (line, "(f0.3)") seconds
      call say("marched to t = "//to_text(content%state%time)//" s in "//trim(line)//" s of computing; record in "//path)
      if (any(study%scene%tones%is_unknown)) then
         if (share > 0.0_wp) then
            write (line, "(*(es23.15e2))") pack(omega, study%scene%tones%is_unknown)
            call say("frequencies read from the record [rad/s]:"//trim(line))
         else
            call say("the record has no tone of its own; the coefficients of unknown tones mean nothing")
         end if
      end if
      if (allocated(content%motion)) then
         call tell_motions(content%motion, [(outcome%marched, i=1, size(content%motion))], &
                           [(amplitude_of(content, content%motion(i)), i=1, size(content%motion))], motions)
         call say(motions)
      end if
      write (line, "(es7.1)") maxval(content%judgement%spread)
      call say("largest difference between coefficients of both halves of the record: "//trim(line))
   end subroutine march_scene

   !> Marches from the other starts, as long as from the first one, and tells motions apart.
   subroutine march_others(scene, frequencies, step, content, error)
      type(scene_t), intent(in) :: scene
      real(wp), intent(in) :: frequencies(:)                          !! [rad/s], (n_harmonics)
      real(wp), intent(in) :: step                                    !! [s]
      type(march_content_t), intent(inout) :: content                 !! with what the first start has come to
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

   !> Amplitude of an oscillation with the same root mean square, of the degree of freedom that has the largest one.
   pure real(wp) function amplitude_of(content, motion) result(amplitude)
      type(march_content_t), intent(in) :: content
      integer, intent(in) :: motion                                   !! 0: none
      integer :: k

      amplitude = 0.0_wp
      if (motion == 0) return
      associate (c => content%motions(motion)%coefficients)           ! the zero tuple is the first one
         amplitude = maxval([(norm2(abs(c(2:, k))), k=1, size(c, 2))])
      end associate
   end function amplitude_of

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

   !> Rest, or the sum of the `&start` amplitudes at time zero, or the end of an earlier record.
   subroutine first_state(scene, system, frequencies, state, error)
      type(scene_t), intent(in) :: scene
      type(march_system_t), intent(in) :: system
      real(wp), intent(in) :: frequencies(:)
      type(march_state_t), intent(out) :: state
      type(error_t), allocatable, intent(out) :: error

      call new_march_state(state, system%n_dofs, system%laws%n_states)
      if (len(scene%march%record) > 0) then
         call read_march_state(scene%march%record, state, error)
      else if (scene%march%start == march_start%given) then
         state%q = sum(real(scene%start%values), 2)
         state%v = matmul(-aimag(scene%start%values), frequencies(scene%start%harmonics))
      end if
   end subroutine first_state

   subroutine shown_progress_note_progress(self, n_done, n_steps)
      class(shown_progress_t), intent(inout) :: self
      integer, intent(in) :: n_done, n_steps

      if (.not. self%is_begun) call new_progress(self%line, n_steps, self%level, is_first=.true., what="steps")
      self%is_begun = .true.
      self%n_steps = n_steps
      if (self%line%is_due()) call self%line%show(n_done, 0)
   end subroutine shown_progress_note_progress
end module verb_march
