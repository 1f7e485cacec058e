!> Reads many hostile inputs, solves what is small and sound among them, and says how long the worst took and how much
!> memory all did: fuzz_input SEED FIRST LAST SECONDS MEGABYTES FOLDER FILES...
!>
!> Inputs FIRST to LAST of the campaign SEED are made from FILES; each is an error message or a run, within SECONDS of
!> processor time and MEGABYTES of memory. An input beyond that is written into FOLDER, as is the one under way, for the
!> case that the process dies. Exit status 0: all within the limits.
program fuzz_input
   use, intrinsic :: iso_c_binding, only: c_double, c_long
   use, intrinsic :: iso_fortran_env, only: output_unit
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_model, only: model_t
   use hb_motion, only: solve_motion
   use hb_motion_result, only: motion_result_t
   use hb_mpi, only: start_mpi, stop_mpi
   use hb_study, only: new_study, study_t
   use hb_text, only: parse_integer, string_t, to_text
   use hb_text_file, only: read_text_file
   use hb_law_check, only: check_derivatives, derivative_check_t
   use mutations, only: generator_t, mutant_of, new_generator
   implicit none

   interface
      integer(c_long) function peak_memory() bind(c, name="fuzz_peak_memory")
         import :: c_long
      end function peak_memory

      real(c_double) function processor_time() bind(c, name="fuzz_processor_time")
         import :: c_double
      end function processor_time
   end interface

   integer, parameter :: largest_unknowns = 150, largest_samples = 1000, largest_structure = 60   ! of what is solved
   integer, parameter :: every = 10                                   ! inputs, one of which is solved
   real(wp), parameter :: memory_limit = 2.5e8_wp                     ! bytes that a study may ask for
   real(wp), parameter :: share_of_work = 0.05_wp ! of fallbacks, time integration and levels, which take seconds when they may
   character(:), allocatable :: folder, mutant
   type(string_t), allocatable :: texts(:)
   type(generator_t) :: generator
   integer :: first, i, last, megabytes, slowest, n_bad, n_refused, n_slow, n_solved, n_sound, seconds, seed
   integer(c_long) :: memory
   real(wp) :: longest, started, taken

   call read_arguments()
   call start_mpi()
   n_bad = 0
   n_refused = 0
   n_solved = 0
   n_sound = 0
   n_slow = 0
   longest = 0.0_wp
   slowest = first
   do i = first, last
      call new_generator(generator, seed, i)
      call mutant_of(texts, generator, mutant)
      call write_text(folder//"/current.nml", mutant)
      memory = peak_memory()
      started = processor_time()
      call try(mutant)
      taken = processor_time() - started
      if (taken > longest) slowest = i
      longest = max(longest, taken)
      if (taken > seconds .or. (peak_memory() > 1024_c_long*megabytes .and. memory <= 1024_c_long*megabytes)) then
         n_slow = n_slow + 1
         write (output_unit, "(a, i0, a, f0.2, a, i0, a)") "input ", i, ": ", taken, " s, ", peak_memory()/1024, " MB"
         flush (output_unit)
         call write_text(folder//"/input_"//to_text(i)//".nml", mutant)
      end if
   end do
   write (output_unit, "(5(i0, a))") last - first + 1, " inputs: ", n_refused, " refused, ", n_sound, " sound, of these ", &
      n_solved, " solved; ", n_slow, " beyond the limits"
   write (output_unit, "(a, f0.2, 2(a, i0), a)") "longest ", longest, " s, input ", slowest, "; memory ", peak_memory()/1024, " MB"
   call stop_mpi()
   if (n_slow + n_bad > 0) stop 1

contains

   subroutine read_arguments()
      type(error_t), allocatable :: error
      integer :: k

      if (command_argument_count() < 7) error stop "fuzz_input SEED FIRST LAST SECONDS MEGABYTES FOLDER FILES..."
      seed = integer_at(1)
      first = integer_at(2)
      last = integer_at(3)
      seconds = integer_at(4)
      megabytes = integer_at(5)
      folder = argument(6)
      allocate (texts(command_argument_count() - 6))
      do k = 1, size(texts)
         call read_text_file(argument(6 + k), texts(k)%value, error)
         if (allocated(error)) error stop error%message
      end do
   end subroutine read_arguments

   function argument(k)
      integer, intent(in) :: k
      character(:), allocatable :: argument
      integer :: length

      call get_command_argument(k, length=length)
      allocate (character(length) :: argument)
      call get_command_argument(k, argument)
   end function argument

   integer function integer_at(k)
      integer, intent(in) :: k
      logical :: ok

      call parse_integer(argument(k), integer_at, ok)
      if (.not. ok) error stop "fuzz_input: a number is missing"
   end function integer_at

   !> Does with a text what the verbs do with an input file.
   subroutine try(text)
      character(*), intent(in) :: text
      type(study_t) :: study
      type(error_t), allocatable :: error
      type(motion_result_t) :: result
      type(derivative_check_t) :: check
      type(string_t) :: overrides(0)
      integer :: k

      call new_study(study, "fuzz.nml", text, overrides, error, memory_limit)
      if (allocated(error)) then
         n_refused = n_refused + 1
         if (len_trim(error%message) == 0) then
            write (output_unit, "(a, i0)") "no message for input ", i
            n_bad = n_bad + 1
         end if
         return
      end if
      n_sound = n_sound + 1
      if (modulo(i, every) /= 0 .or. .not. is_small(study%model)) return
      n_solved = n_solved + 1
      do k = 1, size(study%model%system%laws)
         call check_derivatives(study%model%system%laws(k)%law, check, study%model%system%tones%n_tones)
      end do
      study%model%options%solver%max_iterations = min(study%model%options%solver%max_iterations, 2)
      study%model%options%solver%homotopy_iterations = min(study%model%options%solver%homotopy_iterations, 2)
      study%model%options%solver%max_fallback_work = share_of_work*study%model%options%solver%max_fallback_work
      study%model%options%integration%max_work = share_of_work*study%model%options%integration%max_work
      study%model%options%accuracy%max_work = share_of_work*study%model%options%accuracy%max_work
      call solve_motion(study%model, result, error)
   end subroutine try

   logical function is_small(model)
      type(model_t), intent(in) :: model

      is_small = model%system%structure%n_dofs <= largest_structure .and. model%discretisation%torus%n_total <= largest_samples &
                 .and. product(real(model%options%output%samples, wp)) <= largest_samples .and. &
                 model%discretisation%harmonics%n_coefficients*size(model%system%dofs_of_unknowns()) <= largest_unknowns
   end function is_small

   subroutine write_text(path, text)
      character(*), intent(in) :: path, text
      integer :: unit

      open (newunit=unit, file=path, access="stream", form="unformatted", status="replace", action="write")
      write (unit) text
      close (unit)
   end subroutine write_text
end program fuzz_input
