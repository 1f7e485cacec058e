!> Benchmark of one scene: solves it at every rung of a ladder of orders, samples, methods and formulations, again and again,
!> and measures what each rung costs and how far its motion is from a reference.
!>
!> A rung is solved from nothing each time: its document is read, FFTW forgets its plans, freed memory goes back to the
!> system. The rungs take turns, up the ladder and down again, so that a machine that slows down hits all alike.
module hb_benchmark
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_benchmark_plan, only: benchmark_plan_t, read_benchmark_plan
   use hb_benchmark_reference, only: read_reference, read_reference_file
   use hb_coefficient_set, only: coefficient_set_t, compare_motions, new_coefficient_set
   use hb_error, only: annotate, error_t, fail
   use hb_fftw, only: forget_plans
   use hb_kinds, only: wp
   use hb_law_forces, only: law_dofs_of
   use hb_mpi, only: wall_clock
   use hb_namelist, only: document_t, new_document
   use hb_outcome, only: is_solved, outcome
   use hb_point, only: solve_point
   use hb_progress, only: new_progress, progress_t
   use hb_results, only: point_result_t
   use hb_scene, only: scene_t
   use hb_scene_reader, only: group_names, read_scene
   use hb_solver_types, only: method_names
   use hb_study, only: apply_overrides
   use hb_system, only: exists, memory_peak, memory_resident, release_memory, reset_memory_peak
   use hb_text, only: string_t, to_text
   implicit none
   private
   public :: benchmark_t, measured_t, new_benchmark, part, part_names, run_benchmark

   !> Parts of the time of a rung; wall time but for the last.
   type :: part_t
      integer :: setup = 1                                            !! input, dynamic stiffness, plans, first guess
      integer :: solver = 2                                           !! iterations
      integer :: recovery = 3                                         !! motion of all degrees of freedom, forces
      integer :: certificate = 4
      integer :: total = 5                                            !! without the certificate
      integer :: cpu = 6                                              !! the same as processor time, of all threads
   end type part_t
   type(part_t), parameter :: part = part_t()
   character(*), parameter :: part_names(6) = [character(11) :: "setup", "solver", "recovery", "certificate", "total", "cpu"]

   !> What was found at one rung.
   type :: measured_t
      type(point_result_t) :: result                                  !! of the first time
      integer :: order = -1                                           !! -1: a list of tuples
      integer, allocatable :: samples(:)                              !! (n_tones)
      character(:), allocatable :: method
      integer :: n_unknowns = 0
      real(wp), allocatable :: seconds(:, :)                          !! (parts, repeats)
      real(wp) :: memory = 0.0_wp                                     !! largest addition [byte]; 0: not known
      type(coefficient_set_t) :: motion                               !! at the observed degrees of freedom
      type(coefficient_set_t) :: improved                            !! the same in a wider set
      logical :: has_motion = .false., has_improved = .false.
      logical :: is_reference = .false.
      real(wp) :: error = 0.0_wp                                      !! relative rms of the difference; NaN: not known
      real(wp) :: largest_error = 0.0_wp                              !! of one coefficient, unit of the motion
      real(wp) :: improved_error = 0.0_wp                            !! as `error`, of the improved motion
   end type measured_t

   !> An input that was read without a problem, ready to run.
   type :: benchmark_t
      type(document_t) :: document                                    !! the input after overrides
      type(benchmark_plan_t) :: plan
      character(16), allocatable :: dofs(:)                           !! observed
      character(:), allocatable :: units                              !! of them
      character(:), allocatable :: title
      integer :: n_tones = 0
      character(:), allocatable :: input_text                         !! as given
      character(:), allocatable :: input_complete                     !! after defaults
      logical :: has_reference = .false.                              !! where not from the input, after the run
      type(coefficient_set_t) :: reference
      type(measured_t), allocatable :: rungs(:)                       !! (n_rungs), after the run
   end type benchmark_t

contains

   !> Reads the text of an input file with its overrides and tries every rung of it.
   subroutine new_benchmark(self, file_name, text, overrides, error)
      type(benchmark_t), intent(out), target :: self
      character(*), intent(in) :: file_name
      character(*), intent(in) :: text
      type(string_t), intent(in) :: overrides(:)                      !! path=value, as --set gives them
      type(error_t), allocatable, intent(out) :: error
      type(document_t), target :: first
      type(scene_t) :: scene
      integer :: i

      self%input_text = text
      call new_document(self%document, file_name, text, error)
      if (allocated(error)) return
      call self%document%expect_groups([group_names, "sweep      ", "benchmark  ", "reference  "], error)
      if (allocated(error)) return
      call apply_overrides(self%document, overrides, error)
      if (allocated(error)) return
      first = self%document
      call read_benchmark_plan(self%plan, first, error)
      if (.not. allocated(error)) call self%plan%apply(1, first, error)
      if (.not. allocated(error)) call read_scene(scene, first, error)
      if (allocated(error)) return
      self%title = scene%output%title
      self%n_tones = scene%tones%n_tones
      call choose_dofs(self, scene, error)
      if (.not. allocated(error)) call find_reference(self, first, scene, error)
      if (allocated(error)) return
      self%input_complete = first%complete()
      call self%document%forget_values()
      do i = 2, self%plan%n_rungs + merge(1, 0, self%plan%reference_order >= 0)
         call read_rung(self, i, scene, error)
         if (allocated(error)) return
      end do
   end subroutine new_benchmark

   !> Observed are the degrees of freedom that the user names, else those of the laws, else all that are stored.
   subroutine choose_dofs(self, scene, error)
      type(benchmark_t), intent(inout) :: self
      type(scene_t), intent(in) :: scene
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: dofs(:)
      integer :: i

      if (size(self%plan%dofs) > 0) then
         allocate (dofs(size(self%plan%dofs)))
         do i = 1, size(dofs)
            call scene%structure%find_dof(self%plan%dofs(i)%value, dofs(i), error)
            call annotate(error, "&benchmark: dofs")
            if (allocated(error)) return
         end do
      else
         dofs = law_dofs_of(scene%laws)
         if (size(dofs) == 0) dofs = scene%output%dofs
      end if
      self%dofs = [character(16) :: scene%structure%labels(dofs)]
      self%units = trim(scene%structure%units(dofs(1)))
      if (any(scene%structure%units(dofs) /= self%units)) call fail(error, "&benchmark: the error sums up over the observed "// &
         "degrees of freedom, which have different units; choose some of one unit by &benchmark dofs")
   end subroutine choose_dofs

   !> Reads the reference, where it is not one of the rungs or solved beside them.
   subroutine find_reference(self, document, scene, error)
      type(benchmark_t), intent(inout) :: self
      type(document_t), intent(inout), target :: document
      type(scene_t), intent(in) :: scene
      type(error_t), allocatable, intent(out) :: error
      character(:), allocatable :: path

      if (allocated(self%plan%reference_file)) then
         path = self%plan%reference_file
         associate (input => self%document%file_name)
            if (.not. exists(path)) path = input(:index(input, "/", back=.true.))//path
            if (.not. exists(path)) path = self%plan%reference_file
         end associate
         call read_reference_file(self%reference, path, self%plan%reference_point, scene%tones%omega, self%dofs, error)
         self%has_reference = .true.
      else if (document%count("reference") > 0) then
         call read_reference(self%reference, document, scene%tones%n_tones, self%dofs, error)
         self%has_reference = .true.
      end if
   end subroutine find_reference

   !> Reads the scene of rung i, or that of the reference for i = n_rungs + 1; only the observed motion is kept.
   subroutine read_rung(self, i, scene, error)
      type(benchmark_t), intent(in) :: self
      integer, intent(in) :: i
      type(scene_t), intent(out) :: scene
      type(error_t), allocatable, intent(out) :: error
      type(document_t), target :: document
      integer :: k

      document = self%document
      if (i > self%plan%n_rungs) then
         call self%plan%apply_reference(document, error)
      else
         call self%plan%apply(i, document, error)
      end if
      if (.not. allocated(error)) call read_scene(scene, document, error)
      if (.not. allocated(error) .and. scene%tones%n_tones /= self%n_tones) &
         call fail(error, "all rungs need the same number of tones")
      if (.not. allocated(error)) then
         scene%output%samples = [integer ::]
         scene%output%dofs = [(0, k=1, size(self%dofs))]
         do k = 1, size(self%dofs)
            call scene%structure%find_dof(trim(self%dofs(k)), scene%output%dofs(k), error)
            if (allocated(error)) exit
         end do
      end if
      if (i > self%plan%n_rungs) then
         call annotate(error, "reference_order")
      else
         call annotate(error, self%plan%describe(i))
      end if
   end subroutine read_rung

   !> Solves all rungs and measures them. What is wrong with a single rung becomes its status and message.
   subroutine run_benchmark(self, level, error)
      type(benchmark_t), intent(inout) :: self
      integer, intent(in) :: level                                    !! how much to tell, one of hb_progress%log_level
      type(error_t), allocatable, intent(out) :: error
      type(progress_t) :: progress
      type(measured_t) :: warm_up
      integer :: failed, i, repeat, step

      associate (n => self%plan%n_rungs, repeats => self%plan%repeats)
         allocate (self%rungs(n))
         do i = 1, n
            allocate (self%rungs(i)%seconds(size(part_names), repeats), source=0.0_wp)
         end do
         allocate (warm_up%seconds(size(part_names), 1))
         call solve_rung(self, 1, 1, warm_up)                         ! loads libraries; not counted
         if (self%plan%reference_order >= 0) call solve_reference(self, error)
         if (allocated(error)) return
         call new_progress(progress, n*repeats, level, is_first=.true., what="solutions")
         failed = 0
         do repeat = 1, repeats
            do step = 1, n
               i = merge(step, n + 1 - step, modulo(repeat, 2) == 1)
               call solve_rung(self, i, repeat, self%rungs(i))
               if (.not. is_solved(self%rungs(i)%result%status)) failed = failed + 1
               call progress%show((repeat - 1)*n + step, failed)
            end do
         end do
         call progress%finish(n*repeats, failed)
      end associate
      if (.not. self%has_reference) call choose_finest(self)
      do i = 1, size(self%rungs)
         call measure_error(self, self%rungs(i))
      end do
   end subroutine run_benchmark

   !> Solves rung i from nothing; the first time keeps what it gives, each time how long it takes.
   subroutine solve_rung(self, i, repeat, rung)
      type(benchmark_t), intent(in) :: self
      integer, intent(in) :: i, repeat
      type(measured_t), intent(inout) :: rung
      type(scene_t) :: scene
      type(point_result_t) :: result
      type(error_t), allocatable :: error
      real(wp) :: begun, read_at, ended, cpu_begun, cpu_ended, resident
      logical :: has_peak

      call release_memory()
      call forget_plans()
      resident = memory_resident()
      call reset_memory_peak(has_peak)
      call cpu_time(cpu_begun)
      begun = wall_clock()
      call read_rung(self, i, scene, error)
      read_at = wall_clock()
      if (.not. allocated(error)) call solve_point(scene, result, error)
      ended = wall_clock()
      call cpu_time(cpu_ended)
      if (has_peak) rung%memory = max(rung%memory, memory_peak() - resident)
      associate (seconds => rung%seconds(:, repeat))
         seconds(part%setup) = read_at - begun + result%setup_seconds
         seconds(part%solver) = result%solver_seconds
         seconds(part%certificate) = result%certificate_seconds
         seconds(part%total) = ended - begun - result%certificate_seconds
         seconds(part%cpu) = cpu_ended - cpu_begun - result%certificate_cpu_seconds
         seconds(part%recovery) = seconds(part%total) - seconds(part%setup) - seconds(part%solver)
      end associate
      if (repeat > 1) return
      if (allocated(error)) then
         result%status = outcome%failed
         result%message = error%message
      end if
      call keep(self, i, scene, result, rung)
   end subroutine solve_rung

   !> Keeps what a rung is and what it gives.
   subroutine keep(self, i, scene, result, rung)
      type(benchmark_t), intent(in) :: self
      integer, intent(in) :: i
      type(scene_t), intent(in) :: scene
      type(point_result_t), intent(in) :: result
      type(measured_t), intent(inout) :: rung
      type(error_t), allocatable :: error
      integer, allocatable :: law_dofs(:)
      integer :: h, k, m

      rung%result = result
      if (.not. allocated(scene%laws)) return                         ! its input could not be read
      law_dofs = law_dofs_of(scene%laws)
      rung%order = maxval(scene%harmonics%highest)
      rung%samples = scene%torus%n_samples
      rung%method = trim(method_names(scene%solver%method))
      rung%n_unknowns = scene%harmonics%n_coefficients*size(law_dofs)
      if (result%is_odd) rung%n_unknowns = 2*count(modulo(sum(scene%harmonics%tuples, dim=1), 2) == 1)*size(law_dofs)
      if (allocated(result%coefficients)) then
         call new_coefficient_set(rung%motion, scene%harmonics%tuples, result%coefficients, error)
         rung%has_motion = .not. allocated(error)
      end if
      if (.not. allocated(result%certificate%improved)) return
      if (.not. all([(any(law_dofs == scene%output%dofs(k)), k=1, size(self%dofs))])) return
      associate (wider => result%certificate%wider, found => result%certificate%improved, improved => rung%improved)
         improved%harmonics = wider
         allocate (improved%values(2, wider%n_harmonics, size(self%dofs)), source=0.0_wp)
         do k = 1, size(self%dofs)
            m = findloc(law_dofs == scene%output%dofs(k), .true., dim=1)
            do h = 1, wider%n_harmonics
               improved%values(1, h, k) = found(wider%cos_at(h), m)
               if (wider%sin_at(h) > 0) improved%values(2, h, k) = found(wider%sin_at(h), m)
            end do
         end do
      end associate
      rung%has_improved = .true.
   end subroutine keep

   !> Solves the reference of `reference_order`.
   subroutine solve_reference(self, error)
      type(benchmark_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error
      type(measured_t) :: beside

      allocate (beside%seconds(size(part_names), 1))
      call solve_rung(self, self%plan%n_rungs + 1, 1, beside)
      if (is_solved(beside%result%status)) then
         self%reference = beside%motion
         self%has_reference = .true.
      else
         call fail(error, "&benchmark: the reference of order "//to_text(self%plan%reference_order)//" is not solved")
      end if
   end subroutine solve_reference

   !> Makes the solved rung with most harmonics, then with most samples, the first of them, the reference.
   subroutine choose_finest(self)
      type(benchmark_t), intent(inout) :: self
      integer :: finest, i

      finest = 0
      do i = 1, size(self%rungs)
         if (.not. (is_solved(self%rungs(i)%result%status) .and. self%rungs(i)%has_motion)) cycle
         if (finest > 0) then
            if (.not. is_finer(self%rungs(i), self%rungs(finest))) cycle
         end if
         finest = i
      end do
      if (finest == 0) return
      self%reference = self%rungs(finest)%motion
      self%has_reference = .true.
      self%rungs(finest)%is_reference = .true.
   end subroutine choose_finest

   pure logical function is_finer(rung, other)
      type(measured_t), intent(in) :: rung, other

      is_finer = rung%n_unknowns > other%n_unknowns
      if (rung%n_unknowns == other%n_unknowns) is_finer = product(real(rung%samples, wp)) > product(real(other%samples, wp))
   end function is_finer

   subroutine measure_error(self, rung)
      type(benchmark_t), intent(in) :: self
      type(measured_t), intent(inout) :: rung
      real(wp) :: ignored

      rung%error = ieee_value(1.0_wp, ieee_quiet_nan)
      rung%largest_error = rung%error
      rung%improved_error = rung%error
      if (.not. self%has_reference) return
      if (rung%has_motion) call compare_motions(rung%motion, self%reference, .not. self%plan%compares_union, &
                                                rung%error, rung%largest_error)
      if (rung%has_improved) call compare_motions(rung%improved, self%reference, .not. self%plan%compares_union, &
                                                   rung%improved_error, ignored)
   end subroutine measure_error
end module hb_benchmark
