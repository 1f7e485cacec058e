!> nhbm: steady vibration under several tones by the n-dimensional harmonic balance method.
program nhbm
   use, intrinsic :: iso_c_binding, only: c_int
   use, intrinsic :: iso_fortran_env, only: error_unit, output_unit
   use arguments, only: argument_list, arguments_t, read_arguments
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

   character(9), parameter :: verbs(10) = [character(9) :: &
      "solve", &
      "resume", &
      "info", &
      "check", &
      "plan", &
      "march", &
      "verify", &
      "bench", &
      "help", &
      "version"]

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
         call write_help()
      else if (verb == "version") then
         if (rank_of(comm) == 0) write (output_unit, "(a)") "nhbm "//program_version//" ("//git_commit//")"
      else if (verb == "") then
         call fail(error, "say what to do: nhbm solve input.nml; nhbm --help tells all")
      else if (all(verbs /= verb)) then
         closest = closest_word(verb, verbs)
         if (len(closest) > 0) closest = " did you mean '"//closest//"'?"
         call fail(error, "unknown verb '"//verb//"';"//closest//" known: "//join(verbs, ", "))
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

   subroutine write_help()
      if (rank_of(comm) > 0) return
      write (output_unit, "(a)") &
         "nhbm finds the steady vibration of structures with contact and other strong nonlinearities", &
         "under several tones, by the n-dimensional harmonic balance method.", &
         "", &
         "usage: nhbm solve INPUT [options]      solve all points of a namelist file, write an HDF5 file", &
         "       nhbm resume RESULT [options]    solve the points that an ended run has left in its result file", &
         "       nhbm info RESULT                what a result file holds, whether it is complete", &
         "       nhbm check INPUT [options]      read the input, every point of it, say what it asks for, and compare the", &
         "                                       derivatives of its laws with differences of their forces", &
         "       nhbm plan INPUT [options]       say how large the result becomes and how the run would go on many ranks", &
         "       nhbm bench INPUT [options]      solve each point from nothing again and again, and time its kernels (residual,", &
         "                                       tangent, Newton step, solution) beside bare transforms and LU of the same size;", &
         "                                       nhbm-post work-precision, convergence, cost and bench draw what it writes", &
         "       nhbm march INPUT [options]      follow the motion through time as &march says, write an HDF5 record", &
         "       nhbm verify RESULT [options]    march from the points of a result file and say whether their motions stay", &
         "       nhbm version                    version and commit", &
         "       mpirun -n 4 nhbm solve INPUT    the same, points spread over 4 ranks", &
         "", &
         "options:", &
         "  -o, --output FILE    result file; default: name of the input, ending in .h5, in the current folder", &
         "  --overwrite          replace the result file if there is one", &
         "  --resume             go on with the result file if there is one; the input must be the same", &
         "  --retry              with resume or --resume: also solve again the points that did not converge", &
         "  --time-limit SECONDS begin no point that would end later, as long as the longest so far", &
         "  --set PATH=VALUE     change one input value, such as law(1)%gap=1.5e-3 or solver%method='broyden';", &
         "                       may be given several times", &
         "  --quiet              errors alone: neither progress nor summary; as --log-level quiet", &
         "  --verbose            also where the time of each rank went; as --log-level verbose", &
         "  --log-level LEVEL    quiet, normal (progress, summary, warnings), verbose, debug (also a line a point)", &
         "  --point N            march: the point of a sweep to be followed, from 0", &
         "  --points N,N,...     verify: the points to start from; default: all that are solved", &
         "  --periods N          verify: length of each march in periods of the slowest tone, 20 by default", &
         "  --budget SECONDS     bench: time spent on each kernel of each point, 0.5 by default; 0: no kernels", &
         "  --repeats N          bench: solutions of each point, 3 by default", &
         "  -h, --help           this text", &
         "", &
         "options of plan (docs/user/cluster.md):", &
         "  --ranks N,N,...      numbers of ranks; default: 1 to 100000 by tens", &
         "  --points N           points, in place of those of the input", &
         "  --cost-from FILE     seconds of the points of a result file, in their order", &
         "  --cost MEAN,SPREAD   seconds of a point, and the standard deviation of its logarithm", &
         "  --machine KEY=VALUE  latency, counter_rate, write_latency, write_rate, bandwidth, hold, group_size;", &
         "                       may be given several times", &
         "  -o, --output FILE    write the table as comma-separated values too, for nhbm-post plan", &
         "", &
         "exit status: 0 all points converged, 1 some did not (their status is in the file), a derivative is wrong or", &
         "             marching does not stay on a motion, 2 bad input or file, 3 points are left: a signal or the time", &
         "             limit came first; resume solves them.", &
         "SIGINT, SIGTERM, SIGUSR1 or SIGUSR2 end a run once the points in flight are solved, a second one at once.", &
         "BLAS works with one thread unless OPENBLAS_NUM_THREADS says otherwise. docs/user/input.md lists the keys of the", &
         "input, docs/user/schema.md the results."
   end subroutine write_help
end program nhbm
