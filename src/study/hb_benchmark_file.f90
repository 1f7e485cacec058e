!> The file of a benchmark, one row a rung: the only writer of the second schema in docs/user/schema.md.
module hb_benchmark_file
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_benchmark, only: benchmark_t, measured_t, part, part_names
   use hb_benchmark_table, only: add_integers, add_one_text, add_reals, add_texts, begin_table, end_table, median, &
      table_t, text_length, threads_text
   use hb_coefficient_set, only: coefficient_set_t
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t, new_harmonics
   use hb_hdf5, only: h5_dataset_t
   use hb_kinds, only: wp
   use hb_outcome, only: outcome_names
   use hb_results_file, only: amplitude_convention, describe, schema_version
   use hb_results_plan, only: identifier
   use hb_solver_types, only: rescue_names
   use hb_sweep_plan, only: parameter_units
   use hb_system, only: utc_now
   use hb_tuple_union, only: tuple_union_t
   use hb_version, only: git_commit, program_version
   implicit none
   private
   public :: write_benchmark

contains

   !> Writes what a run has found. The file is made under another name first, and replaces an existing one only where it may.
   subroutine write_benchmark(self, path, overwrite, error)
      type(benchmark_t), intent(in) :: self
      character(*), intent(in) :: path
      logical, intent(in) :: overwrite
      type(error_t), allocatable, intent(out) :: error
      type(table_t) :: table

      call begin_table(table, path, overwrite)
      if (.not. allocated(table%error)) call fill(table, self)
      call end_table(table, error)
   end subroutine write_benchmark

   subroutine fill(table, self)
      type(table_t), intent(inout) :: table
      type(benchmark_t), intent(in) :: self
      type(harmonics_t) :: set

      call union_of_sets(self, set, table%error)
      if (allocated(table%error)) return
      call add_attributes(table, self)
      call add_scales(table, self, set%n_harmonics)
      call add_rungs(table, self)
      call add_formulations(table, self)
      call add_outcomes(table, self%rungs)
      call add_costs(table, self)
      call add_errors(table, self)
      call add_motions(table, self, set)
      call add_one_text(table, "input_text", self%input_text, "the input as given")
      call add_one_text(table, "input_complete", self%input_complete, "the input after defaults, of the first rung")
   end subroutine fill

   !> All tuples of all motions and of the reference.
   subroutine union_of_sets(self, set, error)
      type(benchmark_t), intent(in) :: self
      type(harmonics_t), intent(out) :: set
      type(error_t), allocatable, intent(out) :: error
      type(tuple_union_t) :: union
      integer :: i, m

      call union%add(reshape([(0, m=1, self%n_tones)], [self%n_tones, 1]))
      if (self%has_reference) call union%add(self%reference%harmonics%tuples)
      do i = 1, size(self%rungs)
         if (self%rungs(i)%has_motion) call union%add(self%rungs(i)%motion%harmonics%tuples)
      end do
      call new_harmonics(set, union%list(), error)
   end subroutine union_of_sets

   subroutine add_attributes(table, self)
      type(table_t), intent(inout) :: table
      type(benchmark_t), intent(in) :: self

      call table%file%set_attribute("schema_version", schema_version, table%error)
      call set_text("kind", "benchmark")
      call set_text("program_version", program_version)
      call set_text("git_commit", git_commit)
      call set_text("created_utc", utc_now())
      call set_text("title", self%title)
      call set_text("amplitude_convention", amplitude_convention)
      call set_text("threads", threads_text())

   contains

      subroutine set_text(name, value)
         character(*), intent(in) :: name, value

         if (.not. allocated(table%error)) call table%file%set_attribute(name, value, table%error)
      end subroutine set_text
   end subroutine add_attributes

   subroutine add_scales(table, self, n_harmonics)
      type(table_t), intent(inout) :: table
      type(benchmark_t), intent(in) :: self
      integer, intent(in) :: n_harmonics
      integer :: k

      call add_numbers(table%row, "rung", [(k, k=0, size(self%rungs) - 1)], "number of the rung, from 0")
      call add_numbers(table%repeat, "repeat", [(k, k=0, self%plan%repeats - 1)], "number of the repeat, from 0")
      call add_numbers(table%tone, "tone", [(k, k=1, self%n_tones)], "number of the tone, from 1")
      call add_numbers(table%harmonic, "harmonic", [(k, k=0, n_harmonics - 1)], "number of the harmonic, from 0")
      call add_words(table%dof, "dof", self%dofs, "observed degree of freedom")
      call add_words(table%component, "component", ["cos", "sin"], "part of a coefficient")

   contains

      subroutine add_numbers(scale, name, numbers, long_name)
         type(h5_dataset_t), intent(inout) :: scale
         character(*), intent(in) :: name, long_name
         integer, intent(in), contiguous :: numbers(:)

         if (allocated(table%error)) return
         call table%file%add_integer(name, [size(numbers)], scale, table%error)
         if (.not. allocated(table%error)) call scale%write(numbers, table%error)
         call finish_scale(scale, name, long_name)
      end subroutine add_numbers

      subroutine add_words(scale, name, words, long_name)
         type(h5_dataset_t), intent(inout) :: scale
         character(*), intent(in) :: name, words(:), long_name

         if (allocated(table%error)) return
         call table%file%add_texts(name, words, scale, table%error)
         call finish_scale(scale, name, long_name)
      end subroutine add_words

      subroutine finish_scale(scale, name, long_name)
         type(h5_dataset_t), intent(in) :: scale
         character(*), intent(in) :: name, long_name

         if (.not. allocated(table%error)) call scale%make_scale(name, table%error)
         if (.not. allocated(table%error)) call describe(scale, "1", long_name, table%error)
      end subroutine finish_scale
   end subroutine add_scales

   !> What each rung is.
   subroutine add_rungs(table, self)
      type(table_t), intent(inout) :: table
      type(benchmark_t), intent(in) :: self
      integer :: i
      integer :: samples(self%n_tones, size(self%rungs))
      real(wp) :: oversampling(size(self%rungs))
      character(text_length), dimension(size(self%rungs)) :: methods, formulations, samplings

      samples = 0
      oversampling = ieee_value(1.0_wp, ieee_quiet_nan)
      do i = 1, size(self%rungs)
         associate (rung => self%rungs(i))
            methods(i) = ""
            if (allocated(rung%method)) methods(i) = rung%method
            samplings(i) = self%plan%describe_sampling(i)
            formulations(i) = self%plan%formulations%describe(i_formulation(self, i))
            if (.not. allocated(rung%samples)) cycle
            samples(:, i) = rung%samples
            if (rung%has_motion) oversampling(i) = minval(rung%samples/real(2*rung%motion%harmonics%highest + 1, wp))
         end associate
      end do
      call add_integers(table, "order", self%rungs%order, "largest entry of the tuples")
      call add_sample_counts()
      call add_reals(table, "oversampling", oversampling, "1", "samples over 2N + 1 of the tone that has fewest")
      call add_texts(table, "method", methods, "solver")
      call add_texts(table, "sampling", samplings, "samples as &benchmark asks for them; empty: by the input")
      call add_texts(table, "formulation", formulations, "swept values of the rung")

   contains

      subroutine add_sample_counts()
         type(h5_dataset_t) :: dataset

         if (allocated(table%error)) return
         call table%file%add_integer("samples", shape(samples), dataset, table%error)
         if (.not. allocated(table%error)) call dataset%write(samples, table%error)
         if (.not. allocated(table%error)) call dataset%attach_scale(1, table%tone, table%error)
         if (.not. allocated(table%error)) call dataset%attach_scale(2, table%row, table%error)
         if (.not. allocated(table%error)) call describe(dataset, "1", "samples per tone", table%error)
      end subroutine add_sample_counts
   end subroutine add_rungs

   integer function i_formulation(self, i)
      type(benchmark_t), intent(in) :: self
      integer, intent(in) :: i

      associate (rung => self%plan%rung(i))
         i_formulation = rung%formulation
      end associate
   end function i_formulation

   !> The swept values, a dataset for each parameter, named as in a result file.
   subroutine add_formulations(table, self)
      type(table_t), intent(inout) :: table
      type(benchmark_t), intent(in) :: self
      character(:), allocatable :: name
      character(text_length) :: words(size(self%rungs))
      real(wp) :: values(size(self%rungs))
      integer :: i, k, place

      do k = 1, size(self%plan%formulations%parameters)
         associate (plan => self%plan%formulations, swept => self%plan%formulations%parameters(k))
            name = "parameter_"//identifier(swept%path)
            do i = 1, size(self%rungs)
               place = plan%index_on(k, i_formulation(self, i))
               if (swept%is_text) then
                  words(i) = swept%texts(place)%value
               else
                  values(i) = swept%values(place)
               end if
            end do
            if (swept%is_text) then
               call add_texts(table, name, words, "swept parameter "//swept%path, swept%path)
            else
               call add_reals(table, name, values, parameter_units(swept%path), "swept parameter "//swept%path, swept%path)
            end if
         end associate
      end do
   end subroutine add_formulations

   !> How each rung ended.
   subroutine add_outcomes(table, rungs)
      type(table_t), intent(inout) :: table
      type(measured_t), intent(in) :: rungs(:)
      real(wp) :: truncation(size(rungs)), aliasing(size(rungs))
      character(text_length) :: messages(size(rungs))
      integer :: i

      truncation = ieee_value(1.0_wp, ieee_quiet_nan)
      aliasing = truncation
      do i = 1, size(rungs)
         messages(i) = ""
         if (allocated(rungs(i)%result%message)) messages(i) = rungs(i)%result%message
         if (.not. allocated(rungs(i)%result%certificate%combination)) cycle
         truncation(i) = rungs(i)%result%certificate%truncation
         aliasing(i) = rungs(i)%result%certificate%aliasing
      end do
      call add_integers(table, "status", rungs%result%status, "outcome of the rung", outcome_names)
      call add_texts(table, "message", messages, "why the rung failed")
      call add_integers(table, "rescue", rungs%result%rescue, "what the solver needed beside the direct attempt", rescue_names)
      call add_integers(table, "iterations", rungs%result%iterations, "iterations of the solver")
      call add_integers(table, "evaluations", rungs%result%evaluations, "evaluations of the residual")
      call add_integers(table, "n_harmonics", rungs%result%n_harmonics, "number of harmonics")
      call add_integers(table, "n_unknowns", rungs%n_unknowns, "number of unknowns of the condensed balance")
      call add_reals(table, "residual", rungs%result%residual, "1", "norm of the balance relative to the scale of the forces")
      call add_reals(table, "truncation_estimate", truncation, "1", &
         "error by the harmonics left out as the certificate estimates it")
      call add_reals(table, "aliasing_estimate", aliasing, "1", &
         "error by the finite number of samples as the certificate estimates it")
   end subroutine add_outcomes

   !> Time and memory. Of each part of the time the median over the repeats, and the least and the most.
   subroutine add_costs(table, self)
      type(table_t), intent(inout) :: table
      type(benchmark_t), intent(in) :: self
      character(*), parameter :: words(size(part_names)) = [character(80) :: &
         "wall time of the set-up: input, dynamic stiffness, plans, first guess", "wall time of the iterations", &
         "wall time of the motion of all degrees of freedom and the forces of laws", "wall time of the certificate", &
         "wall time of set-up, iterations and recovery, without the certificate", &
         "processor time of all threads for set-up, iterations and recovery"]
      real(wp), dimension(size(self%rungs)) :: middle, least, most, memory
      real(wp) :: total(self%plan%repeats, size(self%rungs))
      integer :: i, k

      do k = 1, size(part_names)
         do i = 1, size(self%rungs)
            associate (seconds => self%rungs(i)%seconds(k, :))
               middle(i) = median(seconds)
               least(i) = minval(seconds)
               most(i) = maxval(seconds)
               if (k == part%total) total(:, i) = seconds
            end associate
         end do
         associate (name => trim(part_names(k))//"_seconds")
            call add_reals(table, name, middle, "s", trim(words(k))//", median of the repeats")
            call add_reals(table, name//"_min", least, "s", trim(words(k))//", least of the repeats")
            call add_reals(table, name//"_max", most, "s", trim(words(k))//", most of the repeats")
         end associate
      end do
      call add_all_times()
      memory = self%rungs%memory
      where (memory <= 0.0_wp) memory = ieee_value(1.0_wp, ieee_quiet_nan)
      call add_reals(table, "memory_peak", memory, "byte", "most memory in use beyond that before the rung")

   contains

      subroutine add_all_times()
         type(h5_dataset_t) :: dataset

         if (allocated(table%error)) return
         call table%file%add_real("total_seconds_of_repeat", shape(total), dataset, table%error)
         if (.not. allocated(table%error)) call dataset%write(total, table%error)
         if (.not. allocated(table%error)) call dataset%attach_scale(1, table%repeat, table%error)
         if (.not. allocated(table%error)) call dataset%attach_scale(2, table%row, table%error)
         if (.not. allocated(table%error)) call describe(dataset, "s", trim(words(part%total))//", each repeat", table%error)
      end subroutine add_all_times
   end subroutine add_costs

   subroutine add_errors(table, self)
      type(table_t), intent(inout) :: table
      type(benchmark_t), intent(in) :: self

      call add_integers(table, "is_reference", merge(1, 0, self%rungs%is_reference), "1 where the rung is the reference")
      call add_reals(table, "error", self%rungs%error, "1", &
         "rms over hypertime of the difference to the reference, relative to the reference")
      call add_reals(table, "largest_error", self%rungs%largest_error, self%units, &
         "largest difference of one coefficient to the reference")
      call add_reals(table, "improved_error", self%rungs%improved_error, "1", &
         "as error, of the improved motion in a wider set")
   end subroutine add_errors

   !> The motions at the observed degrees of freedom on the union of all tuples; NaN for what a set lacks.
   subroutine add_motions(table, self, set)
      type(table_t), intent(inout) :: table
      type(benchmark_t), intent(in) :: self
      type(harmonics_t), intent(in) :: set
      type(h5_dataset_t) :: dataset
      real(wp), allocatable :: all_values(:, :, :, :)
      integer :: i

      if (allocated(table%error)) return
      call table%file%add_integer("tuple", shape(set%tuples), dataset, table%error)
      if (.not. allocated(table%error)) call dataset%write(set%tuples, table%error)
      if (.not. allocated(table%error)) call dataset%attach_scale(1, table%tone, table%error)
      if (.not. allocated(table%error)) call dataset%attach_scale(2, table%harmonic, table%error)
      if (.not. allocated(table%error)) call describe(dataset, "1", "integer tuple j of each harmonic", table%error)

      allocate (all_values(2, set%n_harmonics, size(self%dofs), size(self%rungs)))
      all_values = ieee_value(1.0_wp, ieee_quiet_nan)
      do i = 1, size(self%rungs)
         if (self%rungs(i)%has_motion) call place(self%rungs(i)%motion, all_values(:, :, :, i))
      end do
      call add("coefficients", 4, "coefficients of the motion")
      if (.not. self%has_reference) return
      all_values(:, :, :, 1) = ieee_value(1.0_wp, ieee_quiet_nan)
      call place(self%reference, all_values(:, :, :, 1))
      call add("reference_coefficients", 3, "coefficients of the reference")

   contains

      subroutine place(from, to)
         type(coefficient_set_t), intent(in) :: from
         real(wp), intent(inout) :: to(:, :, :)
         integer :: h

         do h = 1, from%harmonics%n_harmonics
            to(:, set%index_of(from%harmonics%tuples(:, h)), :) = from%values(:, h, :)
         end do
      end subroutine place

      subroutine add(name, rank, long_name)
         character(*), intent(in) :: name, long_name
         integer, intent(in) :: rank
         integer :: extents(4)

         if (allocated(table%error)) return
         extents = shape(all_values)
         call table%file%add_real(name, extents(:rank), dataset, table%error)
         if (allocated(table%error)) return
         if (rank == 4) call dataset%write(all_values, table%error)
         if (rank == 3) call dataset%write(all_values(:, :, :, 1), table%error)
         if (.not. allocated(table%error)) call dataset%attach_scale(1, table%component, table%error)
         if (.not. allocated(table%error)) call dataset%attach_scale(2, table%harmonic, table%error)
         if (.not. allocated(table%error)) call dataset%attach_scale(3, table%dof, table%error)
         if (rank == 4 .and. .not. allocated(table%error)) call dataset%attach_scale(4, table%row, table%error)
         if (.not. allocated(table%error)) call describe(dataset, self%units, long_name, table%error)
      end subroutine add
   end subroutine add_motions
end module hb_benchmark_file
