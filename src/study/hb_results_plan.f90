!> What stands in a result file: its dimensions, its datasets with one row per point, their names and units.
module hb_results_plan
   use hb_hdf5, only: h5_dataset_t
   use hb_kinds, only: int64, wp
   use hb_results_layout, only: results_layout_t
   use hb_text, only: join, to_text
   implicit none
   private
   public :: axis_t, identifier, is_checked, measure_row, n_bytes_of, new_plan, parameter_name_length, parameter_names, plan_t
   public :: size_text
   public :: tuple_entry_name, variable_t
   public :: message_length
   public :: is_characters, is_integer, is_real
   public :: component_axis, dof_axis, harmonic_axis, law_axis, law_dof_axis, message_axis, multiplier_axis, output_axis
   public :: curve_entries, point_axis, tone_axis, worker_axis

   integer, parameter :: message_length = 400          ! bytes
   character(*), parameter :: curve_entries = "curve_entry" ! name of the axis of what a curve goes on from, the last one
   integer, parameter :: parameter_name_length = 256   ! more than any path of an input has
   ! Kinds of variables.
   integer, parameter :: is_integer = 1, is_real = 2, is_characters = 3
   integer, parameter :: bytes_of_kind(3) = [4, 8, 1]
   ! Indices of the axes; the hypertime axes follow.
   integer, parameter :: point_axis = 1, tone_axis = 2, harmonic_axis = 3, dof_axis = 4, law_dof_axis = 5, &
      component_axis = 6, message_axis = 7, law_axis = 8, worker_axis = 9, multiplier_axis = 10, &
      output_axis = 11, n_plain_axes = 11

   !> A dimension of the file.
   type :: axis_t
      character(:), allocatable :: name, long_name, units
      integer :: length = 0
      type(h5_dataset_t) :: scale
   end type axis_t

   !> A dataset of the file that has one row per point, or per rank.
   type :: variable_t
      character(:), allocatable :: name, long_name, units
      integer :: kind = 0                               ! one of the three above
      integer, allocatable :: axes(:)                   ! indices of axes, fastest first
      character(:), allocatable :: dof_units            ! of each degree of freedom, where they are an axis
      logical :: is_part_used = .false.                 ! of each row only the first harmonics, as many as the point has
      character(:), allocatable :: parameter            ! path in the input, of the value that moves along curves
      type(h5_dataset_t) :: dataset
   end type variable_t

   !> What the file consists of, beside swept parameters and texts.
   type :: plan_t
      type(axis_t), allocatable :: axes(:)
      type(variable_t), allocatable :: variables(:)
      type(variable_t), allocatable :: times(:)         ! one row per rank, as list_times says
   end type plan_t

contains

   !> Whether the values of a dataset are in the checksum of the row: all that is written when the point is solved, but for what
   !> depends on who did that and when; so the checksums of two runs are the same.
   pure elemental logical function is_checked(variable)
      type(variable_t), intent(in) :: variable

      select case (variable%name)
      case ("checksum", "branch", "rank"); is_checked = .false.
      case default; is_checked = index(variable%name, "march_") /= 1 .and. index(variable%name, "_seconds") == 0
      end select
   end function is_checked

   !> Plans the file for a layout that `check_layout` has passed.
   subroutine new_plan(self, layout)
      type(plan_t), intent(out) :: self
      type(results_layout_t), intent(in) :: layout

      call list_axes(layout, self%axes)
      call list_variables(layout, self%variables)
      call list_times(self%times)
   end subroutine new_plan

   !> Lists the datasets that tell where the time of each rank went, in the order of hb_timing%rank_times_t, the overhead
   !> last.
   subroutine list_times(list)
      type(variable_t), allocatable, intent(out) :: list(:)

      allocate (list(9))
      call set(1, "points", is_integer, "1", "points that the rank solved")
      call set(2, "draws", is_integer, "1", "numbers that the rank drew from shared counters")
      call set(3, "reading_seconds", is_real, "s", "time of making scenes of the input")
      call set(4, "solving_seconds", is_real, "s", "time of solving")
      call set(5, "writing_seconds", is_real, "s", "time of writing results")
      call set(6, "drawing_seconds", is_real, "s", "time at shared counters")
      call set(7, "idle_seconds", is_real, "s", "time of waiting for the other ranks at the end")
      call set(8, "total_seconds", is_real, "s", "time from the first draw to the end of the slowest rank")
      call set(9, "overhead_per_point", is_real, "s", "time per point that was neither solving nor waiting")
   contains
      subroutine set(i, name, kind, units, long_name)
         integer, intent(in) :: i, kind
         character(*), intent(in) :: name, units, long_name

         list(i)%name = "worker_"//name
         list(i)%kind = kind
         list(i)%axes = [worker_axis]
         list(i)%units = units
         list(i)%long_name = long_name
      end subroutine set
   end subroutine list_times

   !> Lists all datasets that have one row per point and are written when it is solved.
   subroutine list_variables(layout, list)
      type(results_layout_t), intent(in) :: layout
      type(variable_t), allocatable, intent(out) :: list(:)
      integer :: taus(size(layout%n_samples)), i, n_listed

      n_listed = 0
      allocate (list(0))
      call add_all()                                   ! counts
      deallocate (list)
      allocate (list(n_listed))
      n_listed = 0
      call add_all()
   contains
      subroutine add_all()
         call add("status", is_integer, [point_axis], "1", "outcome of the point")
         call add("message", is_characters, [message_axis, point_axis], "1", "why the point failed")
         call add("iterations", is_integer, [point_axis], "1", "iterations of the solver")
         call add("rescue", is_integer, [point_axis], "1", "what the solver needed beside the direct attempt")
         call add("evaluations", is_integer, [point_axis], "1", "evaluations of the residual")
         call add("residual", is_real, [point_axis], "1", &
            "norm of the balance relative to the scale of the forces")
         call add("solve_seconds", is_real, [point_axis], "s", "wall time of the point")
         call add("setup_seconds", is_real, [point_axis], "s", "of it, dynamic stiffness, plans, first guess")
         call add("iteration_seconds", is_real, [point_axis], "s", "of it, the solver")
         call add("certificate_seconds", is_real, [point_axis], "s", "of it, the certificate")
         call add("rank", is_integer, [point_axis], "1", "MPI rank that solved the point")
         call add("n_harmonics", is_integer, [point_axis], "1", "number of harmonics in the set of the point")
         call add("n_unknowns", is_integer, [point_axis], "1", "number of unknowns of the equations that were solved")
         call add("is_odd", is_integer, [point_axis], "1", &
            "1 where the motion was sought among those of odd tuples alone, the equations being odd")
         call add("n_full_stick", is_integer, [point_axis], "1", &
            "friction laws that slip nowhere: the solution from rest, one of many")
         call add("n_motions", is_integer, [point_axis], "1", "motions in which marching from several starts ends; 0: not tried")
         call add("is_marched_first", is_integer, [point_axis], "1", "1 where marching was tried before the balance")
         call add("frequency", is_real, [tone_axis, point_axis], "rad/s", "base frequencies")
         call add("artificial_damping", is_real, [tone_axis, point_axis], "1/s", &
            "xi of a normal mode: the forces -xi M dx/dt that keep up its amplitude")
         if (layout%has_accuracy) then
            call add("n_rungs", is_integer, [point_axis], "1", "sets and grids that were solved until the tolerance was met")
            call add("rung_difference", is_real, [point_axis], "1", "difference of the last two of them, relative to the motion")
            call add("level_estimate", is_real, [point_axis], "1", &
               "estimated error as this difference shows it, where it is more than by the motion alone; else 0")
            call add("grid", is_integer, [tone_axis, point_axis], "1", "samples of each tone")
            if (size(layout%output_names) > 0) call add("output_estimate", is_real, [output_axis, point_axis], "1", &
               "estimated error of each output that the tolerance is for, relative to it")
         end if
         if (layout%has_own_tuples) call add("tuples", is_integer, [tone_axis, harmonic_axis, point_axis], "1", &
            "integer tuple j of each harmonic of the point; only the first n_harmonics are in use")
         call add("coefficients", is_real, [component_axis, harmonic_axis, dof_axis, point_axis], "", &
            "coefficients of the motion", layout%dof_units)
         call add("force_coefficients", is_real, [component_axis, harmonic_axis, law_dof_axis, point_axis], "", &
            "coefficients of the force of the laws, on the left-hand side", force_units(layout%law_dof_units))
         call add("corrected_coefficients", is_real, [component_axis, harmonic_axis, law_dof_axis, point_axis], &
            "", "coefficients of the displacement corrected to the wall", layout%law_dof_units)
         call add("frequency_estimate", is_real, [tone_axis, point_axis], "rad/s", &
            "estimated error of the frequencies, 0 where given")
         if (layout%has_improved) call add("improved_coefficients", is_real, &
            [component_axis, harmonic_axis, law_dof_axis, point_axis], "", &
            "coefficients of the motion improved in a wider set of harmonics", layout%law_dof_units)
         call add("truncation_estimate", is_real, [point_axis], "1", &
            "estimated error by the harmonics left out, relative to the motion")
         call add("aliasing_estimate", is_real, [point_axis], "1", &
            "estimated error by the finite number of samples, relative to the motion")
         call add("penetration", is_real, [point_axis], "m", "largest penetration into a rigid wall")
         call add("impact_estimate", is_real, [point_axis], "1", &
            "energy of the hardest blow against a rigid wall, relative to that of the motion there")
         call add("tension", is_real, [point_axis], "N", "largest pull that a rigid wall would have to exert")
         call add("complementarity", is_real, [point_axis], "N m", "largest product of reaction and gap of a rigid wall")
         call add("slip_defect", is_real, [point_axis], "W", &
            "largest power that exact friction would take beyond the reaction of rigid friction")
         call add("power_in", is_real, [point_axis], "W", "mean power of the loads")
         call add("power_damping", is_real, [point_axis], "W", "mean loss in the damping of the structure")
         call add("power_laws", is_real, [law_axis, point_axis], "W", "mean loss in each law")
         call add("energy_kinetic", is_real, [point_axis], "J", "mean kinetic energy of the structure")
         call add("energy_strain", is_real, [point_axis], "J", "mean strain energy of the structure")
         call add("loss_factor", is_real, [point_axis], "1", &
            "all losses over twice the sum of frequency times mean strain energy of each harmonic")
         call add("equivalent_damping", is_real, [point_axis], "1/s", "all losses over four times the mean kinetic energy")
         call add("combination_frequency", is_real, [point_axis], "rad/s", "smallest |k.omega| of low order")
         call add("combination", is_integer, [tone_axis, point_axis], "1", "integers k of combination_frequency")
         call add("is_near_commensurate", is_integer, [point_axis], "1", &
            "1 where combination_frequency is below the threshold: the tones are hard to tell from commensurate ones")
         call add("is_stable", is_integer, [point_axis], "1", &
            "1 where small disturbances of the motion die out, -1 where one grows, 0 where that is not known")
         call add("n_unstable", is_integer, [point_axis], "1", "disturbances that grow")
         call add("stability_method", is_integer, [point_axis], "1", "how stability was found")
         call add("stability_estimate", is_real, [point_axis], merge("1  ", "1/s", size(layout%tuples, 1) == 1), &
            "estimated error of the monodromy matrix, relative; of several tones of the largest exponent")
         if (layout%n_multipliers > 0) call add("exponent", is_real, [multiplier_axis, point_axis], "1/s", &
            "rates at which disturbances grow, the largest first")
         if (layout%n_multipliers > 0 .and. size(layout%tuples, 1) == 1) then
            call add("multiplier_real", is_real, [multiplier_axis, point_axis], "1", &
               "Floquet multipliers, the largest first: real parts")
            call add("multiplier_imag", is_real, [multiplier_axis, point_axis], "1", &
               "Floquet multipliers, the largest first: imaginary parts")
         end if
         call add("checksum", is_integer, [point_axis], "1", "CRC-32 over the values of the row, as they stand in the file")
         call add("branch", is_integer, [point_axis], "1", &
            "piece of the response along the fastest swept parameter, from 1; 0 where that is not known")
         call add("march_verdict", is_integer, [point_axis], "1", "what marching from the point says of it")
         call add("march_first_difference", is_real, [point_axis], "1", &
            "largest difference to marching in the first period of the slowest tone, relative to the motion of its coordinate")
         call add("march_difference", is_real, [point_axis], "1", &
            "difference to marching in the last periods, of the coordinate worst for its limit, relative to its motion")
         call add("march_limit", is_real, [point_axis], "1", "limit of that difference")
         call add("march_growth", is_real, [point_axis], "1/s", "rate at which a march close to the motion leaves it")
         call add("march_duration", is_real, [point_axis], "s", "how long was marched")
         call add("march_drift", is_real, [tone_axis, point_axis], "rad/s", &
            "difference of the marched frequency to that of the motion, 0 where given")
         if (allocated(layout%curve_parameter)) call add_curve()
         if (size(taus) == 0) return
         taus = [(n_plain_axes + i, i=1, size(taus))]
         call add("displacement_samples", is_real, [taus, law_dof_axis, point_axis], "", &
            "hypertime surface of the motion", layout%law_dof_units)
         call add("corrected_samples", is_real, [taus, law_dof_axis, point_axis], "", &
            "hypertime surface corrected to the wall", layout%law_dof_units)
         call add("force_samples", is_real, [taus, law_dof_axis, point_axis], "", &
            "hypertime surface of the force", force_units(layout%law_dof_units))
      end subroutine add_all

      subroutine add_curve()
         call add("curve_kind", is_integer, [point_axis], "1", "what the point of a curve is")
         call add("curve_branch", is_integer, [point_axis], "1", &
            "number of the branch point from which this part of the curve was followed, from 1; 0: from its start")
         call add("curve_length", is_real, [point_axis], "1", &
            "length of the curve from its start, in units of the range and of the largest motion; negative on the other way")
         call add("curve_state", is_real, [n_plain_axes + size(taus) + 1, point_axis], "1", &
            "unknowns and value, direction, step, orientation and largest motion, from which the curve goes on")
         call add(identifier(layout%curve_parameter), is_real, [point_axis], layout%curve_units, &
            "value of "//layout%curve_parameter//" along the curve")
         if (n_listed <= size(list)) list(n_listed)%parameter = layout%curve_parameter
      end subroutine add_curve

      subroutine add(name, kind, axes, units, long_name, units_by_dof)
         character(*), intent(in) :: name
         integer, intent(in) :: kind, axes(:)
         character(*), intent(in) :: units, long_name
         character(*), intent(in), optional :: units_by_dof(:) !! replaces `units`

         n_listed = n_listed + 1
         if (n_listed > size(list)) return
         associate (new => list(n_listed))
            new%name = name
            new%kind = kind
            new%axes = axes
            new%units = units
            new%long_name = long_name
            new%is_part_used = layout%has_own_tuples .and. (any(axes == harmonic_axis) .or. name == "curve_state")
            if (present(units_by_dof)) then
               new%units = common_units(units_by_dof)
               new%dof_units = trim(adjustl(join(units_by_dof, " ")))
            end if
         end associate
      end subroutine add
   end subroutine list_variables

   !> Lists all dimensions of the file, in the order of the axis indices.
   subroutine list_axes(layout, axes)
      type(results_layout_t), intent(in) :: layout
      type(axis_t), allocatable, intent(out) :: axes(:)
      integer :: i, n_axes

      n_axes = n_plain_axes + size(layout%n_samples)
      if (allocated(layout%curve_parameter)) n_axes = n_axes + 1
      allocate (axes(n_axes))
      call set(point_axis, "point", layout%n_points, "1", "number of the sweep point, from 0")
      call set(tone_axis, "tone", size(layout%tuples, 1), "1", "number of the tone, from 1")
      call set(harmonic_axis, "harmonic", size(layout%tuples, 2), "1", "number of the harmonic, from 0")
      call set(dof_axis, "dof", size(layout%dof_labels), "1", "stored degree of freedom")
      call set(law_axis, "law", size(layout%law_labels), "1", "law, by its label")
      call set(law_dof_axis, "law_dof", size(layout%law_dof_labels), "1", &
         "degree of freedom on which laws act")
      call set(component_axis, "component", 2, "1", "part of a coefficient")
      call set(worker_axis, "worker", layout%n_ranks, "1", "MPI rank of the run, from 0")
      call set(multiplier_axis, "multiplier", layout%n_multipliers, "1", "number of the multiplier, from 0")
      call set(output_axis, "output", size(layout%output_names), "1", "output that the tolerance is for, as the input has it")
      call set(message_axis, "message_byte", message_length, "1", "byte of a message")
      do i = 1, size(layout%n_samples)
         call set(n_plain_axes + i, "tau_"//to_text(i), layout%n_samples(i), "rad", &
            "hypertime of tone "//to_text(i))
      end do
      if (allocated(layout%curve_parameter)) call set(n_axes, curve_entries, layout%n_curve_state, "1", &
         "number from which a curve goes on, from 0")
   contains
      subroutine set(i_axis, name, length, units, long_name)
         integer, intent(in) :: i_axis, length
         character(*), intent(in) :: name, units, long_name

         axes(i_axis)%name = name
         axes(i_axis)%length = length
         axes(i_axis)%units = units
         axes(i_axis)%long_name = long_name
      end subroutine set
   end subroutine list_axes

   !> Gives a variable name for each swept parameter: its path in lower case with one underscore for every run
   !> of other characters; a number is added where the name is taken.
   function parameter_names(layout, plan) result(names)
      type(results_layout_t), intent(in) :: layout
      type(plan_t), intent(in) :: plan
      character(parameter_name_length) :: names(size(layout%parameters))
      character(parameter_name_length), allocatable :: taken(:)
      character(:), allocatable :: stem
      integer :: i, n

      allocate (taken, source=[character(parameter_name_length) :: "tuple", "input_text", "input_overrides", &
                               "input_complete", "input_libraries", "tuples"])
      do i = 1, size(plan%axes)
         taken = [character(parameter_name_length) :: taken, plan%axes(i)%name]
      end do
      do i = 1, size(plan%variables)
         taken = [character(parameter_name_length) :: taken, plan%variables(i)%name]
      end do
      do i = 1, size(layout%tuples, 1)
         taken = [character(parameter_name_length) :: taken, tuple_entry_name(i)]
      end do
      do i = 1, size(plan%times)
         taken = [character(parameter_name_length) :: taken, plan%times(i)%name]
      end do
      do i = 1, size(names)
         stem = identifier(layout%parameters(i)%path)
         if (stem == "") stem = "parameter"
         names(i) = stem
         n = 1
         do while (any(names(i) == taken))
            n = n + 1
            names(i) = stem//"_"//to_text(n)
         end do
         taken = [character(parameter_name_length) :: taken, names(i)]
      end do
   end function parameter_names

   !> Gives the name of the dataset with the entries of all tuples for one tone, from 1.
   pure function tuple_entry_name(tone) result(name)
      integer, intent(in) :: tone
      character(:), allocatable :: name

      name = "tuple_"//to_text(tone)
   end function tuple_entry_name

   !> Gives a path in lower case with one underscore for every run of other characters, none at the ends.
   pure function identifier(path) result(name)
      character(*), intent(in) :: path
      character(:), allocatable :: name
      integer :: i

      name = ""
      do i = 1, len(path)
         select case (path(i:i))
         case ("a":"z", "0":"9")
            name = name//path(i:i)
         case ("A":"Z")
            name = name//achar(iachar(path(i:i)) + iachar("a") - iachar("A"))
         case default
            if (len(name) > 0) then
               if (name(len(name):) /= "_") name = name//"_"
            end if
         end select
      end do
      if (len(name) > 0) then
         if (name(len(name):) == "_") name = name(:len(name) - 1)
      end if
   end function identifier

   ! Units and size

   !> Gives the unit of the force that does work on each degree of freedom.
   pure function force_units(units)
      character(*), intent(in) :: units(:)
      character(16) :: force_units(size(units))
      integer :: i

      do i = 1, size(units)
         select case (units(i))
         case ("m")
            force_units(i) = "N"
         case ("rad")
            force_units(i) = "N*m"
         case ("1", "")
            force_units(i) = "1"
         case default
            force_units(i) = "J/"//units(i)
         end select
      end do
   end function force_units

   !> Gives the unit that all degrees of freedom share, or the name of the attribute that lists them.
   pure function common_units(units) result(common)
      character(*), intent(in) :: units(:)
      character(:), allocatable :: common

      common = "see dof_units"
      if (size(units) == 0) then
         common = "1"
      else if (all(units == units(1))) then
         common = trim(units(1))
      end if
   end function common_units

   !> Gives what one point takes in the file, swept parameters included, and how many datasets it is written to when solved.
   pure subroutine measure_row(plan, n_parameters, n_bytes, n_datasets)
      type(plan_t), intent(in) :: plan
      integer, intent(in) :: n_parameters
      real(wp), intent(out) :: n_bytes
      integer, intent(out) :: n_datasets
      integer :: i

      n_bytes = bytes_of_kind(is_integer) + real(bytes_of_kind(is_real), wp)*n_parameters
      n_datasets = size(plan%variables)
      do i = 1, size(plan%variables)
         associate (variable => plan%variables(i))
            n_bytes = n_bytes + bytes_of_kind(variable%kind)* &
               product(real(plan%axes(variable%axes(:size(variable%axes) - 1))%length, wp))
         end associate
      end do
   end subroutine measure_row

   !> Gives the number of bytes that a file takes on the disk, rather a few too many.
   pure function n_bytes_of(plan, layout) result(n_bytes)
      type(plan_t), intent(in) :: plan
      type(results_layout_t), intent(in) :: layout
      integer(int64) :: n_bytes
      integer(int64), parameter :: of_one_dataset = 4000, of_a_text = 100 ! what describes a dataset; a label or text value
      integer :: i

      n_bytes = of_one_dataset*(size(plan%variables) + size(plan%times) + size(plan%axes) + &
         size(layout%parameters) + size(layout%tuples, 1) + 8)
      do i = 1, size(plan%variables)
         associate (variable => plan%variables(i))
            if (variable%is_part_used) cycle                          ! nothing yet
            n_bytes = n_bytes + &
               bytes_of_kind(variable%kind)*product(int(plan%axes(variable%axes)%length, int64))
         end associate
      end do
      do i = 1, size(plan%times)
         n_bytes = n_bytes + bytes_of_kind(plan%times(i)%kind)*int(layout%n_ranks, int64)
      end do
      n_bytes = n_bytes + 8*sum(int(plan%axes%length, int64)) + 8*size(layout%tuples, kind=int64) + &
         of_a_text*(size(layout%dof_labels) + size(layout%law_dof_labels) + size(layout%law_labels) + &
                    size(layout%output_names))
      do i = 1, size(layout%parameters)
         n_bytes = n_bytes + layout%n_points*merge(of_a_text, 8_int64, layout%parameters(i)%is_text)
      end do
      if (allocated(layout%input_text)) n_bytes = n_bytes + len(layout%input_text)
      if (allocated(layout%input_complete)) n_bytes = n_bytes + len(layout%input_complete)
   end function n_bytes_of

   !> Gives a number of bytes in words, for messages.
   function size_text(n_bytes) result(text)
      integer(int64), intent(in) :: n_bytes
      character(:), allocatable :: text
      character(40) :: digits

      write (digits, "(f0.1)") max(0.1_wp, real(n_bytes, wp)/1.0e6_wp)
      text = trim(digits)//" MB"
      if (text(1:1) == ".") text = "0"//text
   end function size_text
end module hb_results_plan
