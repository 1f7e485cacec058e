!> The file of kernel times, one row a point of the input: the only writer of the third schema in docs/user/schema.md.
module hb_kernel_file
   use hb_benchmark_table, only: add_integers, add_one_text, add_reals, add_texts, begin_table, end_table, table_t, &
      text_length, threads_text
   use hb_error, only: error_t
   use hb_kernel_times, only: kernel, kernel_names, kernel_times_t
   use hb_kinds, only: wp
   use hb_outcome, only: outcome_names
   use hb_results_file, only: describe, schema_version
   use hb_results_plan, only: identifier
   use hb_study, only: study_t
   use hb_sweep_plan, only: parameter_units
   use hb_system, only: utc_now
   use hb_version, only: git_commit, program_version
   implicit none
   private
   public :: write_kernel_times

contains

   !> Writes the times of all points. The file is made under another name first, and replaces an existing one only where it may.
   subroutine write_kernel_times(times, study, bandwidth, path, overwrite, error)
      type(kernel_times_t), intent(in) :: times(:)                    !! of each point
      type(study_t), intent(in) :: study
      real(wp), intent(in) :: bandwidth                               !! of the memory [B/s]
      character(*), intent(in) :: path
      logical, intent(in) :: overwrite
      type(error_t), allocatable, intent(out) :: error
      type(table_t) :: table

      call begin_table(table, path, overwrite)
      if (.not. allocated(table%error)) call fill(table, times, study, bandwidth)
      call end_table(table, error)
   end subroutine write_kernel_times

   subroutine fill(table, times, study, bandwidth)
      type(table_t), intent(inout) :: table
      type(kernel_times_t), intent(in) :: times(:)
      type(study_t), intent(in) :: study
      real(wp), intent(in) :: bandwidth
      integer :: i

      call add_attributes(table, study%scene%output%title)
      call add_rows(table, size(times))
      call add_parameters(table, study)
      call add_integers(table, "n_tones", times%n_tones, "number of tones")
      call add_integers(table, "n_harmonics", times%n_harmonics, "number of harmonics")
      call add_integers(table, "n_unknowns", times%n_unknowns, "number of unknowns of the condensed balance")
      call add_integers(table, "n_samples", times%n_samples, "samples of the torus")
      call add_integers(table, "n_channels", times%n_channels, "degrees of freedom that are transformed")
      call add_integers(table, "status", times%status, "outcome of the solution", outcome_names)
      call add_integers(table, "iterations", times%iterations, "iterations of the solver")
      call add_integers(table, "evaluations", times%evaluations, "evaluations of the residual")
      call add_reals(table, "residual_norm", times%residual, "1", "norm of the balance relative to the scale of the forces")
      do i = 1, size(kernel_names)
         call add_kernel(table, times, i)
      end do
      call add_reals(table, "memory_bandwidth", spread(bandwidth, 1, size(times)), "byte/s", "triad over long arrays")
      call add_one_text(table, "input_text", study%input_text, "the input as given")
      call add_one_text(table, "input_complete", study%input_complete, "the input after defaults, of the first point")
   end subroutine fill

   subroutine add_attributes(table, title)
      type(table_t), intent(inout) :: table
      character(*), intent(in) :: title

      call table%file%set_attribute("schema_version", schema_version, table%error)
      call set_text("kind", "bench")
      call set_text("program_version", program_version)
      call set_text("git_commit", git_commit)
      call set_text("created_utc", utc_now())
      call set_text("title", title)
      call set_text("threads", threads_text())

   contains

      subroutine set_text(name, value)
         character(*), intent(in) :: name, value

         if (.not. allocated(table%error)) call table%file%set_attribute(name, value, table%error)
      end subroutine set_text
   end subroutine add_attributes

   !> The dimension scale of all columns.
   subroutine add_rows(table, n_points)
      type(table_t), intent(inout) :: table
      integer, intent(in) :: n_points
      integer :: k

      if (allocated(table%error)) return
      call table%file%add_integer("point", [n_points], table%row, table%error)
      if (.not. allocated(table%error)) call table%row%write([(k, k=0, n_points - 1)], table%error)
      if (.not. allocated(table%error)) call table%row%make_scale("point", table%error)
      if (.not. allocated(table%error)) call describe(table%row, "1", "number of the point, from 0", table%error)
   end subroutine add_rows

   !> The swept values, a dataset for each parameter, named as in a result file.
   subroutine add_parameters(table, study)
      type(table_t), intent(inout) :: table
      type(study_t), intent(in) :: study
      character(text_length) :: words(study%plan%n_points)
      real(wp) :: values(study%plan%n_points)
      character(:), allocatable :: name, long_name
      integer :: i, k

      do k = 1, size(study%plan%parameters)
         associate (swept => study%plan%parameters(k))
            name = "parameter_"//identifier(swept%path)
            long_name = "swept parameter "//swept%path
            do i = 1, study%plan%n_points
               if (swept%is_text) then
                  words(i) = swept%texts(study%plan%index_on(k, i))%value
               else
                  values(i) = swept%values(study%plan%index_on(k, i))
               end if
            end do
            if (swept%is_text) then
               call add_texts(table, name, words, long_name, swept%path)
            else
               call add_reals(table, name, values, parameter_units(swept%path), long_name, swept%path)
            end if
         end associate
      end do
   end subroutine add_parameters

   !> The columns of one kernel.
   subroutine add_kernel(table, times, i)
      type(table_t), intent(inout) :: table
      type(kernel_times_t), intent(in) :: times(:)
      integer, intent(in) :: i
      character(*), parameter :: words(size(kernel_names)) = [character(60) :: "one residual", "assembly of the tangent", &
         "one Newton step: tangent, factorisation, step, residual", "set-up and solution of the equations", &
         "a whole point: input, solution, recovery, certificate"]
      character(:), allocatable :: name, what, yardstick

      name = trim(kernel_names(i))
      what = trim(words(i))
      yardstick = "LU factorisation of a full matrix of the same size"
      if (i == kernel%residual) yardstick = "bare pair of transforms"
      call add_reals(table, name//"_seconds", times%seconds(i), "s", what//", median of the repeats")
      call add_reals(table, name//"_seconds_first", times%first(i), "s", what//", the first time")
      call add_reals(table, name//"_seconds_min", times%fastest(i), "s", what//", least of the repeats")
      call add_reals(table, name//"_seconds_max", times%slowest(i), "s", what//", most of the repeats")
      call add_reals(table, name//"_yardstick", times%yardstick(i), "s", yardstick//", median of the repeats")
      call add_reals(table, name//"_ratio", times%ratio(i), "1", what//" over "//yardstick//", median")
      call add_reals(table, name//"_ratio_low", times%ratio_low(i), "1", what//" over "//yardstick//", lower quartile")
      call add_reals(table, name//"_ratio_high", times%ratio_high(i), "1", what//" over "//yardstick//", upper quartile")
   end subroutine add_kernel
end module hb_kernel_file
