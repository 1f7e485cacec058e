!> `nhbm census`: searches for all coexisting motions of a point, and reports how complete the search is.
module verb_census
   use arguments, only: arguments_t
   use console, only: print_error, say
   use exit_status, only: incomplete, not_all_right, success
   use hb_cancellation, only: cancellation_t
   use hb_census, only: census_config_t, census_t, take_census
   use hb_census_file, only: study_of_point, write_census
   use hb_census_starts, only: start_kind, start_kind_names
   use hb_error, only: annotate, error_t, fail
   use hb_file_location, only: check_target
   use hb_interruption, only: interruption
   use hb_kinds, only: wp
   use hb_mpi, only: comm_t, size_of
   use hb_outcome, only: is_solved, outcome_name
   use hb_progress, only: log_level, new_progress, progress_t
   use hb_signals, only: signal_caught, wait_for_points
   use hb_stability, only: verdict
   use hb_study, only: study_t
   use hb_text, only: number_of, to_text
   use result_location, only: place_result
   use run_texts, only: ending_text
   use verb_integrate, only: choose_point
   use verb_solve, only: load_study
   implicit none
   private
   public :: run_census

   type, extends(cancellation_t) :: shown_starts_t
      type(progress_t) :: line
      logical :: is_begun = .false.
      integer :: level = log_level%normal
      integer :: n_steps = 0
   contains
      procedure :: note_progress => shown_starts_note_progress
   end type shown_starts_t

contains

   !> Runs the verb, on one rank; without an error it returns an exit status.
   subroutine run_census(options, comm, status, error)
      type(arguments_t), intent(in) :: options
      type(comm_t), intent(in) :: comm
      integer, intent(out) :: status
      type(error_t), allocatable, intent(out) :: error
      type(shown_starts_t), target :: progress
      type(census_config_t) :: config
      type(census_t) :: census
      type(study_t) :: alone, study
      character(:), allocatable :: path
      integer :: i, point

      status = success
      if (size_of(comm) > 1) then
         call fail(error, "census runs on one rank, without mpirun")
         return
      end if
      call load_study(options, comm, study, error)
      if (allocated(error)) return
      call choose_point(options, study, point, error)
      if (.not. allocated(error)) call place_result(options, comm, path, error)
      if (.not. allocated(error)) then
         call check_target(path, options%overwrite, error)
         call annotate(error, "result file '"//path//"'")
      end if
      if (.not. allocated(error)) call study_of_point(study, point, alone, error)
      if (allocated(error)) return
      config%n_starts = options%n_starts
      config%seed = options%seed
      config%time_limit = options%time_limit
      config%ends_starts => signal_caught
      progress%level = options%level
      call wait_for_points()
      call progress%enter(huge(1.0_wp))
      call take_census(alone%model, config, census, error)
      call progress%leave()
      if (progress%is_begun) call progress%line%finish(progress%n_steps, 0)
      call annotate(error, options%input)
      if (allocated(error)) return
      if (.not. all([(is_solved(census%motions(i)%result%status), i=1, size(census%motions))])) status = not_all_right
      if (max(census%n_left, census%n_unfollowed) > 0) status = incomplete
      if (size(census%motions) == 0) then
         if (status == incomplete) then
            call print_error(ending_text(merge(interruption%signal, interruption%time_limit, signal_caught()))// &
                             " before a motion was found")
         else
            status = not_all_right
            call print_error("no start led to a motion")
         end if
         return
      end if
      call write_census(alone, census, path, options%overwrite, comm, error)
      if (allocated(error)) return
      if (status == incomplete) call print_error( &
         ending_text(merge(interruption%signal, interruption%time_limit, signal_caught()))//": "// &
         number_of(census%n_left, "random start")//" not made, branches of "// &
         number_of(census%n_unfollowed, "motion")//" not followed")
      if (options%level < log_level%normal) return
      call write_table(alone, census)
      call write_completeness(census, config)
      call say("results in "//path)
   end subroutine run_census

   !> Writes a line for each motion, in the order of the rows of the result file.
   subroutine write_table(study, census)
      type(study_t), intent(in) :: study
      type(census_t), intent(in) :: census
      character(16), allocatable :: labels(:)
      character(200) :: line
      character(:), allocatable :: mirror                             ! the start, and the motion of which it is the image
      character(10) :: stable
      real(wp) :: amplitude, mean
      integer :: dof, i

      allocate (labels, source=[character(16) :: study%model%system%structure%labels(study%model%options%output%dofs)])
      dof = largest_dof(census)
      call say("motion   mean of "//labels(dof)(:9)//"   amplitude   stable   status         found   first found by")
      do i = 1, size(census%motions)
         associate (motion => census%motions(i))
            mean = 0.0_wp
            amplitude = 0.0_wp
            if (allocated(motion%result%coefficients)) then
               mean = motion%result%coefficients(1, 1, dof)
               amplitude = norm2(motion%result%coefficients(:, 2:, dof))
            end if
            stable = "?"
            if (motion%result%stability%verdict == verdict%stable) stable = "yes"
            if (motion%result%stability%verdict == verdict%unstable) stable = "no"
            mirror = trim(start_kind_names(motion%first_kind))
            if (motion%mirror_of > 0) then
               if (motion%first_kind /= start_kind%mirror) mirror = mirror//", "//trim(start_kind_names(start_kind%mirror))
               mirror = mirror//" of "//to_text(motion%mirror_of - 1)
            end if
            write (line, "(i6, 2es15.4, 3x, a6, 3x, a12, i8, 3x, a)") i - 1, mean, amplitude, stable, &
               outcome_name(motion%result%status), motion%n_random, mirror
            call say(trim(line))
         end associate
      end do
   end subroutine write_table

   !> The stored degree of freedom with the largest oscillation of all motions.
   pure integer function largest_dof(census) result(dof)
      type(census_t), intent(in) :: census
      real(wp) :: largest
      integer :: d, i

      dof = 1
      largest = 0.0_wp
      do i = 1, size(census%motions)
         if (.not. allocated(census%motions(i)%result%coefficients)) cycle
         associate (c => census%motions(i)%result%coefficients)
            do d = 1, size(c, 3)
               if (norm2(c(:, :, d)) <= largest) cycle
               largest = norm2(c(:, :, d))
               dof = d
            end do
         end associate
      end do
   end function largest_dof

   !> Writes how many starts were made, and what they may have missed.
   subroutine write_completeness(census, config)
      type(census_t), intent(in) :: census
      type(census_config_t), intent(in) :: config

      if (census%is_complete) then
         call say("the model has no law: there is no other motion")
         return
      end if
      call say(number_of(size(census%motions), "motion")//" from "//number_of(census%n_directed, "directed start")//" and "// &
               number_of(census%n_random, "random start")//" (seed "//to_text(config%seed)//"), of which "// &
               to_text(census%n_directed_lost)//" and "//to_text(census%n_random_lost)//" did not converge")
      if (census%n_spurious > 0) call say(number_of(census%n_spurious, "solution")// &
                                          " of few harmonics did not persist on larger sets")
      associate (found => census%completeness)
         call say(to_text(found%n_once)//" found by one random start only, "//to_text(found%n_never)//" by none; "// &
                  "estimated number of missed motions: at least "//rounded(found%missed))
         call say("a motion to which fewer than "//rounded(100.0_wp*found%least_share)// &
                  " % of the converged starts lead may be missed (95 % confidence)")
         call say("a further random start finds an unknown motion with a probability of about "//rounded(100.0_wp*found%unseen)// &
                  " %, at most "//rounded(100.0_wp*found%unseen_bound)//" % (95 % confidence)")
         if (.not. found%is_reliable) &
            call say("these estimates are unreliable: too few motions were found again; use more --starts")
      end associate
   end subroutine write_completeness

   !> A number with one decimal.
   function rounded(number) result(text)
      real(wp), intent(in) :: number
      character(:), allocatable :: text
      character(20) :: digits

      write (digits, "(f18.1)") number
      text = trim(adjustl(digits))
   end function rounded

   recursive subroutine shown_starts_note_progress(self, n_done, n_steps)
      class(shown_starts_t), intent(inout) :: self
      integer, intent(in) :: n_done, n_steps

      if (.not. self%is_begun) call new_progress(self%line, n_steps, self%level, is_first=.true., what="starts")
      self%is_begun = .true.
      self%n_steps = n_steps
      if (self%line%is_due()) call self%line%show(n_done, 0)
   end subroutine shown_starts_note_progress
end module verb_census
