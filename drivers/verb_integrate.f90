!> `nhbm integrate`: integrates a model in time and writes the record.
module verb_integrate
   use arguments, only: arguments_t
   use console, only: print_error, say
   use exit_status, only: incomplete
   use hb_attractors, only: report_motions
   use hb_cancellation, only: cancellation_t, verdict
   use hb_clock, only: wall_clock
   use hb_document, only: document_t
   use hb_error, only: annotate, error_t, fail
   use hb_file_location, only: check_target
   use hb_input_keys, only: choices_of, max_choice
   use hb_integration, only: check_integration, integrate_model, integration_t
   use hb_integration_file, only: integration_origin_t, read_integration_state, write_integration_file
   use hb_integration_system, only: integration_state_t, new_integration_state
   use hb_interruption, only: interruption
   use hb_kinds, only: wp
   use hb_model_reader, only: read_model
   use hb_mpi, only: comm_t, rank_of, share_error
   use hb_outcome, only: outcome
   use hb_progress, only: log_level, new_progress, progress_t
   use hb_study, only: study_t
   use hb_text, only: to_text
   use hb_time_stepping, only: integration_assessment_t
   use result_location, only: place_result
   use run_texts, only: ending_text
   use verb_solve, only: load_study
   implicit none
   private
   public :: choose_point, run_integrate

   type, extends(cancellation_t) :: shown_progress_t
      type(progress_t) :: line
      logical :: is_begun = .false.
      integer :: level = log_level%normal
      integer :: n_steps = 0
      real(wp) :: ends = huge(1.0_wp)                                 ! time of the wall clock [s]
   contains
      procedure :: note_progress => shown_progress_note_progress
      procedure :: wants_end => shown_progress_wants_end
   end type shown_progress_t

contains

   !> Runs the verb, on one rank.
   subroutine run_integrate(options, comm, status, error)
      type(arguments_t), intent(in) :: options
      type(comm_t), intent(in) :: comm
      integer, intent(inout) :: status                                !! of the program
      type(error_t), allocatable, intent(out) :: error
      type(study_t) :: study
      character(:), allocatable :: path
      integer :: point

      call load_study(options, comm, study, error)
      if (allocated(error)) return
      call choose_point(options, study, point, error)
      if (.not. allocated(error)) call adopt_point(study, point, error)
      if (allocated(error)) return
      call check_integration(study%model%system, study%model%options, error)
      call annotate(error, options%input)
      if (allocated(error)) return
      call place_result(options, comm, path, error)
      if (allocated(error)) return
      if (rank_of(comm) == 0) call integrate_to_file(options, study, path, status, error)
      call share_error(comm, error)
   end subroutine run_integrate

   !> The requested point, from 1; that of the start of a single curve by default. Fails if a sweep leaves the choice open.
   subroutine choose_point(options, study, point, error)
      type(arguments_t), intent(in) :: options
      type(study_t), intent(in) :: study
      integer, intent(out) :: point
      type(error_t), allocatable, intent(out) :: error

      point = max(1, options%point + 1)
      if (options%point < 0 .and. study%plan%n_points == 1) return
      if (options%point < 0 .and. allocated(study%plan%curve) .and. study%plan%n_points == study%plan%n_fastest()) return  ! start
      if (options%point < 0 .or. options%point >= study%plan%n_points) then
         call fail(error, "the input has the points 0 to "//to_text(study%plan%n_points - 1)// &
                   "; "//options%verb// &
                   " takes one of them, give its number by --point")
      end if
   end subroutine choose_point

   !> Sets the model of the study to that of a point.
   subroutine adopt_point(study, point, error)
      type(study_t), intent(inout) :: study
      integer, intent(in) :: point                                    !! from 1
      type(error_t), allocatable, intent(out) :: error
      type(document_t), target :: document

      if (point == 1) return                                          ! as it is read
      document = study%document
      call study%plan%apply(point, document)
      call read_model(study%model, document, error, callbacks=study%callbacks, purpose=study%purpose)
      call annotate(error, "point "//to_text(point - 1))
   end subroutine adopt_point

   subroutine integrate_to_file(options, study, path, status, error)
      type(arguments_t), intent(in) :: options
      type(study_t), intent(in) :: study
      character(*), intent(in) :: path                                !! of the record
      integer, intent(inout) :: status                                !! of the program
      type(error_t), allocatable, intent(out) :: error
      type(integration_t), target :: content
      type(integration_origin_t) :: origin
      type(integration_state_t), allocatable :: earlier
      type(shown_progress_t), target :: progress
      real(wp) :: seconds
      character(max_choice), allocatable :: methods(:)
      character(:), allocatable :: motions
      character(300) :: line
      integer :: i

      call check_target(path, options%overwrite, error)
      call annotate(error, "time integration record '"//path//"'")
      if (allocated(error)) return
      associate (model => study%model)
         if (len(model%options%integration%record) > 0) then
            allocate (earlier)
            call new_integration_state(earlier, model%system%structure%n_dofs, &
                                       sum([(model%system%laws(i)%law%n_states, i=1, size(model%system%laws))]))
            call read_integration_state(model%options%integration%record, earlier, error)
            if (allocated(error)) return
         end if
         progress%level = options%level
         seconds = wall_clock()
         if (options%time_limit < huge(1.0_wp)) progress%ends = seconds + options%time_limit
         call progress%enter(huge(1.0_wp))
         call integrate_model(content, model%system, model%discretisation, model%options, error, earlier)
         call progress%leave()
         if (allocated(error) .and. progress%verdict == verdict%interrupted) then
            deallocate (error)
            status = incomplete
            call print_error(ending_text(interruption%time_limit)//" before there was a result")
            return
         end if
         if (allocated(error)) return
         seconds = wall_clock() - seconds
         if (progress%is_begun) call progress%line%finish(progress%n_steps, 0)
         origin%title = model%options%output%title
         allocate (methods, source=choices_of("integration", "method"))
         origin%method = trim(methods(model%options%integration%method))
         origin%input_text = study%input_text
         origin%input_complete = study%input_complete
         origin%tuples = model%discretisation%harmonics%tuples
         origin%retained_dofs = model%options%output%dofs
         call write_integration_file(path, options%overwrite, origin, model%system%structure, content%system%laws, content, error)
      end associate
      if (allocated(error) .or. options%level < log_level%normal) return
      write (line, "(f0.3)") seconds
      call say("integrated to t = "//to_text(content%state%time)//" s in "//trim(line)//" s of computing; record in "//path)
      if (any(study%model%system%tones%is_unknown)) then
         if (content%share > 0.0_wp) then
            write (line, "(*(es23.15e2))") pack(content%omega, study%model%system%tones%is_unknown)
            call say("frequencies read from the record [rad/s]:"//trim(line))
         else
            call say("the record has no tone of its own; the coefficients of unknown tones mean nothing")
         end if
      end if
      if (allocated(content%motion)) then
         call report_motions(content%motion, [(outcome%integrated, i=1, size(content%motion))], &
                           [(amplitude_of(content, content%motion(i)), i=1, size(content%motion))], motions)
         call say(motions)
      end if
      if (study%model%system%tones%n_tones > 0) then
         write (line, "(es7.1)") maxval(content%assessment%spread)
         call say("largest difference between coefficients of both halves of the record: "//trim(line))
      end if
      call say_peaks(content%assessment, study%model%system%structure%labels(study%model%options%output%dofs))
   end subroutine integrate_to_file

   !> Prints the largest lines of the spectrum of the degree of freedom that has the largest of all.
   subroutine say_peaks(assessment, labels)
      type(integration_assessment_t), intent(in) :: assessment
      character(*), intent(in) :: labels(:)
      character(40) :: line
      character(:), allocatable :: text
      integer :: dof, i

      if (size(assessment%frequencies) == 0) return
      dof = maxloc(maxval(abs(assessment%amplitudes), dim=1), dim=1)
      text = ""
      do i = 1, size(assessment%frequencies, 1)
         write (line, "(es13.6, a, es7.1, a)") assessment%frequencies(i, dof), " (", abs(assessment%amplitudes(i, dof)), ")"
         text = text//", "//trim(adjustl(line))
      end do
      call say("largest lines of "//trim(labels(dof))//", frequency [rad/s] (amplitude): "//text(3:))
   end subroutine say_peaks

   !> Amplitude of an oscillation with the same root mean square, for the degree of freedom with the largest one.
   pure real(wp) function amplitude_of(content, motion) result(amplitude)
      type(integration_t), intent(in) :: content
      integer, intent(in) :: motion                                   !! 0: none
      integer :: k

      amplitude = 0.0_wp
      if (motion == 0) return
      associate (c => content%motions(motion)%coefficients)           ! the zero tuple is the first one
         amplitude = maxval([(norm2(abs(c(2:, k))), k=1, size(c, 2))])
      end associate
   end function amplitude_of

   recursive subroutine shown_progress_note_progress(self, n_done, n_steps)
      class(shown_progress_t), intent(inout) :: self
      integer, intent(in) :: n_done, n_steps

      if (.not. self%is_begun) call new_progress(self%line, n_steps, self%level, is_first=.true., what="steps")
      self%is_begun = .true.
      self%n_steps = n_steps
      if (self%line%is_due()) call self%line%show(n_done, 0)
   end subroutine shown_progress_note_progress

   logical function shown_progress_wants_end(self) result(wants_end)
      class(shown_progress_t), intent(inout) :: self

      wants_end = wall_clock() > self%ends
   end function shown_progress_wants_end
end module verb_integrate
