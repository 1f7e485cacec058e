!> nhbm: steady vibration under several tones by the n-dimensional harmonic balance method.
program nhbm
   use, intrinsic :: iso_c_binding, only: c_char, c_int, c_null_char
   use, intrinsic :: iso_fortran_env, only: error_unit
   use arguments, only: argument_list, arguments_t, read_arguments
   use build_description, only: description
   use command_table, only: verb_names, write_completion, write_help, write_manual
   use console, only: finish_output, print_error, say
   use exit_status, only: bad_input, incomplete, success
   use hb_blas_threads, only: allocate_blas_memory, can_end_blas, limit_blas_threads
   use hb_crash_handler, only: protect_outside_code
   use hb_error, only: error_t, fail
   use hb_hdf5, only: can_end_library
   use hb_kinds, only: wp
   use hb_memory, only: retain_freed_memory
   use hb_mpi, only: barrier, comm_t, rank_of, share_error, start_mpi, start_workers, stop_mpi, world
   use hb_printable, only: printable
   use hb_signals, only: catch_signals, survive_failed_writes, wait_for_points
   use hb_similar_word, only: closest_word
   use hb_text, only: join, string_t
   use hb_version, only: git_commit, program_version
   use key_table, only: print_keys
   use starters, only: starter_list, starter_names, starter_text
   use verb_census, only: run_census
   use verb_check, only: run_check
   use verb_fit, only: run_fit
   use verb_info, only: run_info
   use verb_integrate, only: run_integrate
   use verb_merge, only: run_merge
   use verb_plan, only: run_plan
   use verb_solve, only: run_resume, run_solve
   use verb_verify, only: run_verify
   use verb_why, only: print_statuses, run_why
   implicit none

   interface
      !> Ends the process with a status, without a message.
      subroutine hb_exit(status) bind(c, name="hb_exit")
         import :: c_int
         integer(c_int), value :: status
      end subroutine hb_exit

      !> Ends the process with a status immediately.
      subroutine hb_exit_at_once(status) bind(c, name="hb_exit_at_once")
         import :: c_int
         integer(c_int), value :: status
      end subroutine hb_exit_at_once

      !> Ends the process with a text and a status if other code calls exit().
      subroutine hb_reject_exit(text, status) bind(c, name="hb_reject_exit")
         import :: c_char, c_int
         character(c_char), intent(in) :: text(*)
         integer(c_int), value :: status
      end subroutine hb_reject_exit
   end interface

   type(arguments_t) :: options
   type(string_t), allocatable :: words(:)
   type(error_t), allocatable :: error
   type(comm_t) :: comm
   integer :: status
   real(wp), parameter :: pause = 0.5_wp                              !! [s] see expect_signals

   call retain_freed_memory(64)
   call limit_blas_threads()
   call survive_failed_writes()
   words = argument_list()
   if (size(words) > 0) then
      if (words(1)%value == "fit") call run_fit(words(2:), error)     ! which has options of its own
   end if
   if (.not. allocated(error)) call read_arguments(options, words, error)
   status = -1
   if (.not. allocated(error)) call start_workers(options%n_workers, status, error)
   if (status >= 0) call hb_exit(int(status, c_int))                  ! of the process that has started others, which have ended
   call protect_outside_code()
   call hb_reject_exit("nhbm: a library has called exit(): a law of the user's own, or one that met a limit on memory "// &
      "(ulimit -v); the work is not done"//new_line("a")//c_null_char, int(bad_input, c_int))
   if (.not. allocated(error)) call expect_signals()
   call start_mpi()
   comm = world()
   status = success
   if (.not. allocated(error)) call run_verb()
   call report_error(bad_input)
   call finish_output(error)
   call report_error(merge(incomplete, bad_input, status == incomplete))
   call wait_for_points()                                             ! a signal to mpirun does not change the status any more
   flush (error_unit)
   call barrier(comm)                                                 ! a launcher kills the others when one ends with an error
   if (.not. (can_end_library() .and. can_end_blas())) &              ! HDF5 would crash, OpenBLAS wait for its threads
      call hb_exit_at_once(int(merge(incomplete, bad_input, status == incomplete), c_int))
   call stop_mpi()
   flush (error_unit)
   call hb_exit(int(status, c_int))

contains

   !> From now on, before any long operation, a signal requests the end of a run between two points. A worker receives
   !> one from a terminal, as its group does, and again from the process that has started it.
   subroutine expect_signals()
      character(*), parameter :: words = "nhbm: ended by a second signal"
      real(wp) :: shortest

      if (.not. (allocated(options%verb) .and. allocated(options%input))) return
      shortest = merge(pause, 0.0_wp, options%n_workers > 1)
      if (any(options%verb == [character(9) :: "census", "check", "integrate", "verify"])) then
         call catch_signals(words, incomplete, error, shortest)
      else if (options%verb == "solve" .or. options%verb == "resume") then
         call catch_signals(words//"; nhbm resume "//printable(options%result_path())//" continues it", incomplete, error, shortest)
      end if
   end subroutine expect_signals

   !> Writes an error, if there is one, and sets this status for the end of the program.
   subroutine report_error(status_of_error)
      integer, intent(in) :: status_of_error

      if (.not. allocated(error)) return
      status = status_of_error
      if (rank_of(comm) == 0) call print_error(error%message)
   end subroutine report_error

   subroutine reject_verb(verb)
      character(*), intent(in) :: verb
      character(:), allocatable :: closest
      logical :: is_file

      inquire (file=verb, exist=is_file)
      if (is_file) then
         call fail(error, "missing verb before the file '"//verb//"', for example nhbm "// &
            trim(merge("info ", "solve", index(verb, ".h5", back=.true.) == max(1, len(verb) - 2)))//" "//verb)
         return
      end if
      closest = trim(closest_word(verb, verb_names()))
      if (len(closest) > 0) closest = " did you mean '"//closest//"'?"
      call fail(error, "unknown verb '"//verb//"';"//closest//" known: "//join(verb_names(), ", "))
   end subroutine reject_verb

   subroutine run_verb()
      character(:), allocatable :: verb

      verb = ""
      if (allocated(options%verb)) verb = options%verb
      if (options%wants_help .or. verb == "help") then
         if (rank_of(comm) > 0) return
         if (verb == "help" .and. allocated(options%input)) verb = options%input
         if (verb == "man") then
            call write_manual(program_version)
         else if (verb /= "" .and. all(verb_names() /= verb)) then
            call reject_verb(verb)
         else
            call write_help(verb)
         end if
      else if (options%wants_version .or. verb == "version") then
         if (rank_of(comm) > 0) return
         call say("nhbm "//program_version//" ("//git_commit//")")
         call say(description)
      else if (verb == "keys") then
         if (rank_of(comm) > 0) return
         if (.not. allocated(options%input)) options%input = ""
         call print_keys(options%input, options%is_json, error)
      else if (verb == "new") then
         if (rank_of(comm) == 0) call print_starter()
      else if (verb == "completion") then
         if (rank_of(comm) == 0) call tell_completion()
      else if (verb == "") then
         call fail(error, "missing subcommand, for example nhbm solve input.nml; nhbm --help lists all")
      else if (all(verb_names() /= verb)) then
         call reject_verb(verb)
      else if (verb == "why" .and. .not. allocated(options%input)) then
         if (rank_of(comm) == 0) call print_statuses()
      else if ((verb == "resume" .or. verb == "info") .and. .not. allocated(options%input)) then
         call fail(error, verb//" needs a result file, such as nhbm "//verb//" result.h5")
      else if (verb == "merge" .and. .not. allocated(options%input)) then
         call fail(error, "merge needs a new file and those of the parts, such as nhbm merge whole.h5 part_*.h5")
      else if (.not. allocated(options%input)) then
         call fail(error, verb//" needs an input file, such as nhbm "//verb//" input.nml")
      else
         call reject_other_file(verb, options%input)
         if (.not. allocated(error)) call allocate_blas_memory(error)
         call share_error(comm, error)
         if (.not. allocated(error)) call run_known_verb(verb)
      end if
   end subroutine run_verb

   !> Rejects an input where a result is needed, and a result where an input is.
   subroutine reject_other_file(verb, path)
      character(*), intent(in) :: verb, path
      integer :: n

      n = len_trim(path)
      if (any(verb == [character(6) :: "resume", "info", "why", "verify"])) then
         if (path(max(1, n - 3):n) == ".nml") call fail(error, verb//" needs a result file, not the input '"//path// &
            "': nhbm solve "//path//" makes one, "//path(:n - 4)//".h5")
      else if (any(verb == [character(9) :: "check", "plan", "integrate", "census"])) then
         if (path(max(1, n - 2):n) == ".h5") call fail(error, verb//" needs an input file, not '"//path// &
            "'; nhbm info describes a result, and nhbm-model info a model")
      end if
   end subroutine reject_other_file

   !> Prints a starter input, or the names of all of them.
   subroutine print_starter()
      character(:), allocatable :: closest

      if (.not. allocated(options%input)) then
         call say(starter_list())
      else if (any(starter_names() == options%input)) then
         call say(starter_text(options%input))
      else
         closest = trim(closest_word(options%input, starter_names()))
         if (len(closest) > 0) closest = " did you mean '"//closest//"'?"
         call fail(error, "there is no starter input '"//options%input//"';"//closest//" known: "// &
                   join(starter_names(), ", "))
      end if
   end subroutine print_starter

   subroutine tell_completion()
      character(*), parameter :: shells(2) = ["bash", "zsh "]

      if (.not. allocated(options%input)) options%input = ""
      if (any(shells == options%input)) then
         call write_completion(options%input)
      else
         call fail(error, "completion needs the name of a shell, bash or zsh: source <(nhbm completion bash)")
      end if
   end subroutine tell_completion

   subroutine run_known_verb(verb)
      character(*), intent(in) :: verb
      if (verb == "fit") then
         call fail(error, "fit must be the first word: nhbm fit INPUT data.csv")
      else if (verb == "census") then
         call run_census(options, comm, status, error)
      else if (verb == "check") then
         call run_check(options, comm, status, error)
      else if (verb == "info") then
         call run_info(options, comm, status, error)
      else if (verb == "merge") then
         call run_merge(options, comm, status, error)
      else if (verb == "plan") then
         call run_plan(options, comm, error)
      else if (verb == "resume") then
         call run_resume(options, comm, status, error)
      else if (verb == "why") then
         call run_why(options, comm, error)
      else if (verb == "verify") then
         call run_verify(options, comm, status, error)
      else if (verb == "integrate") then
         call run_integrate(options, comm, status, error)
      else
         call run_solve(options, comm, status, error)
      end if
   end subroutine run_known_verb
end program nhbm
