!> The verbs and options of nhbm, each in one place: the permitted command lines, and the text of the help.
module command_table
   use console, only: say, say_entry
   use hb_text, only: join, split, string_t
   use starters, only: starter_names
   implicit none
   private
   public :: long_name, option_names, options_of, takes_value, verb_names, write_completion, write_help, write_manual

   type :: verb_t
      character(10) :: name
      character(6) :: argument
      character(240) :: text
   end type verb_t

   type :: option_t
      character(12) :: name
      character(2) :: short
      character(11) :: value                            !! word for the value in the help; blank: no value
      character(100) :: verbs                            !! that have the option, separated by blanks
      character(200) :: text
   end type option_t

   type(verb_t), parameter :: verbs(16) = [ &
      verb_t("solve", "INPUT", "solve all points of a namelist file, write an HDF5 file"), &
      verb_t("resume", "RESULT", "solve the remaining points of an interrupted run"), &
      verb_t("info", "RESULT", "print the contents of a result file, and whether it is complete; of several files, such as "// &
         "those of an array of jobs, one line each"), &
      verb_t("merge", "RESULT", "write the new file RESULT from those of the parts of a sweep, the further arguments, such as "// &
         "the jobs of an array (&sweep part); its status is that of info"), &
      verb_t("why", "RESULT", "explain points that failed: attempts, residuals, remedy, and a command to try; "// &
         "without RESULT: all statuses"), &
      verb_t("check", "INPUT", "read and check the input with all points, print its sizes and natural frequencies, test "// &
         "the derivatives of the laws, and measure the cost of the tolerance at the first point"), &
      verb_t("plan", "INPUT", "estimate the size of the result and the time of a run on many ranks"), &
      verb_t("integrate", "INPUT", "integrate the motion in time as &integration specifies, write an HDF5 record"), &
      verb_t("census", "INPUT", "search for all coexisting motions at the values of the input, report how often each was found "// &
         "and how many were probably missed; write them to an HDF5 file"), &
      verb_t("verify", "RESULT", "integrate in time from the points of a result file and report whether the motions agree"), &
      verb_t("fit", "INPUT", "fit parameters of an input to measured responses over the frequency, a CSV file; a "// &
         "command of the Python package, whose options nhbm fit --help lists"), &
      verb_t("keys", "[WORD]", "print the table of input keys, one per row: group | key | type | unit | default | range | "// &
         "meaning; with WORD the rows that contain it, as in nhbm keys jenkins"), &
      verb_t("new", "[NAME]", "print a commented starter input: nhbm new duffing > duffing.nml; nhbm new lists all"), &
      verb_t("completion", "SHELL", "print the completion of verbs and options for bash or zsh: "// &
         "source <(nhbm completion bash)"), &
      verb_t("version", "", "print version, commit, build and libraries; also --version"), &
      verb_t("help", "[VERB]", "this text; nhbm help VERB or nhbm VERB --help: one verb; nhbm help man: all as a manual "// &
         "page, for man")]

   character(*), parameter :: all_verbs = "solve resume info merge why check plan integrate census verify"

   type(option_t), parameter :: options(29) = [ &
      option_t("--output", "-o", "FILE", "solve integrate census", &
         "result file; default: name of the input with .h5, in the current folder"), &
      option_t("--overwrite", "", "", "solve integrate census merge", "replace an existing result file"), &
      option_t("--check", "", "", "info", "also compare the results with their checksums"), &
      option_t("--resume", "", "", "solve", "continue an existing result file; the input must be the same"), &
      option_t("--retry", "", "", "solve", "with --resume: also repeat the points that did not converge"), &
      option_t("--retry", "", "", "resume", "also repeat the points that did not converge"), &
      option_t("--time-limit", "", "SECONDS", "solve resume", &
         "end the run after this time; nhbm resume solves the remaining points"), &
      option_t("--time-limit", "", "SECONDS", "integrate", "end after this time, without a record"), &
      option_t("--time-limit", "", "SECONDS", "check census verify", "end after this time, with what is done until then"), &
      option_t("--workers", "", "N", "solve resume verify", &
         "number of processes on this computer that share the points, for nhbm without MPI (pip); otherwise use mpirun -n N"), &
      option_t("--set", "", "PATH=VALUE", "solve check plan integrate census", &
         "change one input value, such as law(1)%gap=1.5e-3 or solver%method='broyden'; repeatable"), &
      option_t("--set", "", "PATH=VALUE", "resume", &
         "only curve%points=N: more points for curves that have reached their limit"), &
      option_t("--unset", "", "PATH", "solve check plan integrate census", &
         "remove one key of the input, such as harmonics%order"), &
      option_t("--quiet", "", "", all_verbs, "print errors only, neither progress nor summary; as --log-level quiet"), &
      option_t("--verbose", "", "", all_verbs, "also print the time spent by each rank; as --log-level verbose"), &
      option_t("--log-level", "", "LEVEL", all_verbs, &
         "quiet, normal (progress, summary, warnings), verbose, debug (also a line per point)"), &
      option_t("--point", "", "N", "why integrate census", &
         "number of the point of a sweep, from 0"), &
      option_t("--starts", "", "N", "census", "number of random starts; default 200"), &
      option_t("--seed", "", "N", "census", "seed of the random starts; default 1"), &
      option_t("--points", "", "N,N,...", "verify", "the points to start from; default: all that are solved"), &
      option_t("--periods", "", "N", "verify", "longest time integration in periods of the slowest tone"), &
      option_t("--ranks", "", "N,N,...", "plan", "numbers of ranks; default: 1 to 10000 by tens"), &
      option_t("--array", "", "N", "plan", "the commands of an array of N jobs, each of which solves a part of the sweep"), &
      option_t("--points", "", "N", "plan", "number of points, instead of that of the input"), &
      option_t("--cost-from", "", "FILE", "plan", "time of a point from a result file, for example of a smaller run"), &
      option_t("--cost", "", "SECONDS", "plan", "seconds of a point"), &
      option_t("--json", "", "", "keys", "the rows as a JSON array of objects"), &
      option_t("--help", "-h", "", all_verbs//" keys new completion version help", "this text"), &
      option_t("--version", "", "", "version", "version and commit")]

   integer, parameter :: column_of_text = 31

   !> Of verbs that read a file.
   character(*), parameter :: closing(6) = [character(120) :: &
      "exit status: 0 all points solved, 2 invalid input or file error, 3 points remain after a signal or the time limit,", &
      "             which resume solves, 4 some points failed (see their status in the file), a derivative is wrong, or time", &
      "             integration disagrees with a motion.", &
      "SIGINT, SIGTERM, SIGUSR1 or SIGUSR2 stop a run at the next iteration, a second signal at once.", &
      "BLAS uses one thread, or NHBM_BLAS_THREADS of the environment. nhbm keys lists the keys of the input, which", &
      "docs/user/input.md of the sources explains, as docs/user/schema.md does the contents of the results."]

contains

   !> Names of the verbs.
   pure function verb_names() result(names)
      character(10) :: names(size(verbs))

      names = verbs%name
   end function verb_names

   !> Names of the options of a verb, or of all verbs; long and short names, each once.
   pure function option_names(verb) result(names)
      character(*), intent(in), optional :: verb
      character(12), allocatable :: names(:)
      integer :: i

      allocate (names(0))
      do i = 1, size(options)
         if (present(verb)) then
            if (.not. has(options(i), verb)) cycle
         end if
         if (any(names == options(i)%name)) cycle
         names = [character(12) :: names, options(i)%name]
         if (options(i)%short /= "") names = [character(12) :: names, options(i)%short]
      end do
   end function option_names

   !> Options of a verb as a list in a message.
   pure function options_of(verb) result(text)
      character(*), intent(in) :: verb
      character(:), allocatable :: text

      text = join(option_names(verb), ", ")
   end function options_of

   !> The long name of an option given by its short or long one; empty if it is unknown.
   pure function long_name(name) result(long)
      character(*), intent(in) :: name
      character(:), allocatable :: long
      integer :: i

      long = ""
      do i = 1, size(options)
         if (name /= "" .and. (options(i)%name == name .or. options(i)%short == name)) long = trim(options(i)%name)
      end do
   end function long_name

   !> Whether an option has a value.
   pure logical function takes_value(name)
      character(*), intent(in) :: name                  !! a long one

      takes_value = any(options%name == name .and. options%value /= "")
   end function takes_value

   pure logical function has(option, verb)
      type(option_t), intent(in) :: option
      character(*), intent(in) :: verb

      has = index(" "//trim(option%verbs)//" ", " "//trim(verb)//" ") > 0
   end function has

   !> Writes the help of one verb, or of all verbs without a name.
   subroutine write_help(verb)
      character(*), intent(in) :: verb
      logical :: is_one
      integer :: i

      is_one = any(verbs%name == verb) .and. verb /= "help"
      if (.not. is_one) call say([character(120) :: &
         "nhbm computes the steady-state vibration of structures with contact and other strong nonlinearities", &
         "under several tones, by the n-dimensional harmonic balance method.", ""])
      do i = 1, size(verbs)
         if (is_one .and. verbs(i)%name /= verb) cycle
         call say_entry(merge("usage: nhbm ", "       nhbm ", i == 1 .or. is_one)//trim(verbs(i)%name)//" "// &
            trim(verbs(i)%argument)//merge(" [options]", "          ", has_other_options(trim(verbs(i)%name))), &
            verbs(i)%text, 42)
      end do
      if (.not. is_one .or. verb == "solve") &
         call say_entry("       mpirun -n 4 nhbm solve INPUT", "the same, points distributed over 4 ranks", 42)
      call say([character(120) :: "", "options:"])
      do i = 1, size(options)
         if (is_one .and. .not. has(options(i), verb)) cycle
         call say_entry("  "//merge(options(i)%short//", ", "    ", options(i)%short /= "")//trim(options(i)%name)//" "// &
            options(i)%value, trim(verbs_before(options(i), is_one))//" "//options(i)%text, column_of_text)
      end do
      if (is_one .and. index(all_verbs, trim(verb)) == 0) return
      call say("")
      call say(closing)
   end subroutine write_help

   !> Whether a verb has options besides those that print help and version.
   pure logical function has_other_options(verb)
      character(*), intent(in) :: verb
      integer :: i

      has_other_options = any([(has(options(i), verb) .and. all(options(i)%name /= [character(12) :: "--help", "--version"]), &
                                i=1, size(options))])
   end function has_other_options

   !> Writes the manual page in troff.
   subroutine write_manual(version)
      character(*), intent(in) :: version
      integer :: i

      call say('.TH NHBM 1 "" "nhbm '//version//'" "User commands"')
      call say([character(120) :: ".SH NAME", "nhbm \- steady vibration with contact and friction under several tones", &
         ".SH SYNOPSIS", ".B nhbm", "VERB [FILE] [options]", ".SH VERBS"])
      do i = 1, size(verbs)
         call write_item(trim(verbs(i)%name)//" "//verbs(i)%argument, verbs(i)%text)
      end do
      call say(".SH OPTIONS")
      do i = 1, size(options)
         call write_item(trim(merge(options(i)%short//", ", "    ", options(i)%short /= "")//trim(options(i)%name)//" "// &
            options(i)%value), trim(verbs_before(options(i), .false.))//" "//options(i)%text)
      end do
      call say([character(120) :: ".SH NOTES", ".nf"])
      call say(closing)
   end subroutine write_manual

   subroutine write_item(name, text)
      character(*), intent(in) :: name, text
      character(:), allocatable :: line
      integer :: i

      call say(".TP")
      line = ""
      do i = 1, len_trim(name)
         if (name(i:i) == "-") line = line//"\"
         line = line//name(i:i)
      end do
      call say(".B "//trim(adjustl(line)))
      call say("\&"//trim(adjustl(text)))
   end subroutine write_item

   !> Writes the script by which bash, or zsh with the ways of bash, completes verbs, their options, names of starters and files.
   subroutine write_completion(shell)
      character(*), intent(in) :: shell                 !! bash or zsh
      integer :: i

      if (shell == "zsh") call say([character(50) :: "#compdef nhbm", "autoload -U +X bashcompinit && bashcompinit"])
      call say([character(80) :: "_nhbm() {", "   local word=${COMP_WORDS[COMP_CWORD]} words=", "   if [ $COMP_CWORD = 1 ]; then"])
      call say("      words='"//join(verb_names(), " ")//"'")
      call say([character(80) :: "   else", "      case ${COMP_WORDS[1]} in"])
      do i = 1, size(verbs)
         call say("      "//trim(verbs(i)%name)//") words='"//join(option_names(trim(verbs(i)%name)), " ")//"' ;;")
      end do
      call say([character(80) :: "      esac", "      [[ $word != -* ]] && words= && case ${COMP_WORDS[1]} in"])
      call say("      new) words='"//join(starter_names(), " ")//"' ;;")
      call say([character(80) :: "      completion) words='bash zsh' ;;", "      esac", "   fi", &
                "   COMPREPLY=($(compgen -W ""$words"" -- ""$word""))", "}", "complete -o default -F _nhbm nhbm"])
      if (shell == "zsh") call say("(($#compstate)) && _bash_complete -o default -F _nhbm")  ! the first time, as a file of $fpath
   end subroutine write_completion

   !> The verbs of an option, for the help of all verbs if some do not have it.
   pure function verbs_before(option, is_one) result(text)
      type(option_t), intent(in) :: option
      logical, intent(in) :: is_one
      character(:), allocatable :: text
      type(string_t), allocatable :: words(:)

      text = ""
      if (is_one .or. index(option%verbs, all_verbs) == 1 .or. option%verbs == "version") return
      call split(trim(option%verbs), " ", words)
      text = join(words, ", ")//":"
   end function verbs_before
end module command_table
