!> nhbm: steady vibration under several tones by the n-dimensional harmonic balance method.
program nhbm
   use, intrinsic :: iso_c_binding, only: c_int
   use, intrinsic :: iso_fortran_env, only: error_unit, output_unit
   use arguments, only: argument_list, arguments_t, read_arguments
   use command_table, only: verb_names, write_help
   use exit_status, only: bad_input, not_all_right, success
   use hb_blas_threads, only: use_one_blas_thread
   use hb_closest_word, only: closest_word
   use hb_error, only: error_t, fail
   use hb_mpi, only: comm_t, rank_of, start_mpi, stop_mpi, world
   use hb_system, only: keep_freed_memory
   use hb_text, only: join
   use hb_version, only: git_commit, program_version
   use verb_bench, only: run_bench_verb
   use verb_check, only: run_check
   use verb_info, only: run_info
   use verb_march, only: run_march
   use verb_plan, only: run_plan
   use verb_solve, only: run_resume, run_solve
   use verb_verify, only: run_verify
   implicit none

   interface
      !> Ends the process with a status and without a word.
      subroutine c_exit(status) bind(c, name="exit")
         import :: c_int
         integer(c_int), value :: status
      end subroutine c_exit
   end interface

   type(arguments_t) :: options
   type(error_t), allocatable :: error
   type(comm_t) :: comm
   integer :: status

   call keep_freed_memory()
   call use_one_blas_thread()
   call start_mpi()
   comm = world()
   status = success
   call read_arguments(options, argument_list(), error)
   if (.not. allocated(error)) call run_verb()
   if (allocated(error)) then
      status = bad_input
      if (rank_of(comm) == 0) write (error_unit, "(a)") "nhbm: "//error%message
   end if
   call stop_mpi()
   flush (output_unit)
   flush (error_unit)
   call c_exit(int(status, c_int))

contains

   subroutine run_verb()
      character(:), allocatable :: closest, verb
      logical :: all_right

      verb = ""
      if (allocated(options%verb)) verb = options%verb
      if (options%wants_help .or. verb == "help") then
         if (rank_of(comm) > 0) return
         if (verb == "help" .and. allocated(options%input)) verb = options%input
         call write_help(verb)
      else if (options%wants_version .or. verb == "version") then
         if (rank_of(comm) == 0) write (output_unit, "(a)") "nhbm "//program_version//" ("//git_commit//")"
      else if (verb == "") then
         call fail(error, "say what to do: nhbm solve input.nml; nhbm --help tells all")
      else if (all(verb_names() /= verb)) then
         closest = closest_word(verb, verb_names())
         if (len(closest) > 0) closest = " did you mean '"//closest//"'?"
         call fail(error, "unknown verb '"//verb//"';"//closest//" known: "//join(verb_names(), ", "))
      else if ((verb == "resume" .or. verb == "info") .and. .not. allocated(options%input)) then
         call fail(error, verb//" needs a result file, such as nhbm "//verb//" result.h5")
      else if (.not. allocated(options%input)) then
         call fail(error, verb//" needs an input file, such as nhbm "//verb//" input.nml")
      else if (verb == "check") then
         call run_check(options, comm, all_right, error)
         if (.not. all_right) status = not_all_right
      else if (verb == "info") then
         call run_info(options, comm, status, error)
      else if (verb == "plan") then
         call run_plan(options, comm, error)
      else if (verb == "bench") then
         call run_bench_verb(options, comm, all_right, error)
         if (.not. all_right) status = not_all_right
      else if (verb == "resume") then
         call run_resume(options, comm, status, error)
      else if (verb == "verify") then
         call run_verify(options, comm, all_right, error)
         if (.not. all_right) status = not_all_right
      else if (verb == "march") then
         call run_march(options, comm, error)
      else
         call run_solve(options, comm, status, error)
      end if
   end subroutine run_verb
end program nhbm
