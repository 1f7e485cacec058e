!> The table of columns of a result file: name, unit, shape, meaning, when a column is there, and where a motion has its value.
!>
!> Nothing else declares a column. Going through the table once lists the columns of a file (`new_plan`); going through it again
!> with a motion puts its values into the row of a point (`put_motion`). A new column is a line here and one in
!> docs/user/schema.md, which tests/cases/test_schema.py compares.
!>
!> Shapes are names of dimensions behind that of the point, in the order that h5py shows: slowest first.
module hb_result_columns
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_branches, only: left_branch
   use hb_curve_request, only: curve_kind_names
   use hb_error, only: annotate, error_t, fail
   use hb_hdf5, only: h5_dataset_t, is_characters, is_integer, is_real
   use hb_kinds, only: wp
   use hb_march_verdict, only: verdict_names
   use hb_motion_result, only: curve_place_t, motion_result_t
   use hb_outcome, only: outcome_names
   use hb_results_layout, only: identifier, results_layout_t
   use hb_row_buffer, only: row_buffer_t
   use hb_solver_types, only: rescue_names
   use hb_stability, only: stability_method_names
   use hb_text, only: join, shortened, split, string_t, to_text
   implicit none
   private
   public :: axis_t, column_t, message_length, new_plan, plan_t, tuple_entry_name

   integer, parameter :: message_length = 400          ! bytes
   integer, parameter :: most_columns = 100            ! that the table has room for
   ! Units that depend on the degrees of freedom along the slowest axis of a row, and those of the forces on these.
   character(*), parameter :: of_dof = "of the degree of freedom", of_force = "of its force"

   !> A dimension of the file. Its entries are labels, else angles if the unit says so, else numbers from `first`.
   type :: axis_t
      character(:), allocatable :: name, long_name, units
      integer :: length = 0, first = 0
      character(64), allocatable :: labels(:)
      character(16), allocatable :: dof_units(:)        ! of the degrees of freedom that the labels name
      type(h5_dataset_t) :: scale
   end type axis_t

   !> A dataset of the file that has one row per point, or per rank.
   type :: column_t
      character(:), allocatable :: name, long_name, units
      integer :: kind = 0                               ! of its values, hb_hdf5
      integer, allocatable :: axes(:)                   ! indices of axes, fastest first
      character(:), allocatable :: dof_units            ! of each degree of freedom, where they are an axis
      character(:), allocatable :: flags                ! names of the values 0, 1, ..., with blanks between
      integer :: n_flags = 0
      character(:), allocatable :: parameter            ! path in the input, of the value that moves along curves
      logical :: is_part_used = .false.                 ! of each row only the first harmonics, as many as the point has
      logical :: is_checked = .true.                    ! the checksum of a row goes over it
      type(h5_dataset_t) :: dataset
      type(row_buffer_t) :: held                        ! rows that are not written yet
   end type column_t

   !> What a file consists of, beside swept parameters and texts.
   type :: plan_t
      type(axis_t), allocatable :: axes(:)              ! that of the points is the first
      type(column_t), allocatable :: columns(:)         ! one row per point
      type(column_t), allocatable :: times(:)           ! one row per rank: hb_timing%rank_times_t and the overhead
      character(:), allocatable :: curve_parameter      ! path of the value that moves along curves
      character(:), allocatable, private :: curve_units
      logical, private :: has_accuracy = .false., has_own_tuples = .false., has_improved = .false., has_outputs = .false.
      logical, private :: has_one_tone = .false., has_surfaces = .false.
      integer, private :: n_multipliers = 0, n_curve_state = 0
      ! Going through the table:
      integer, private :: row = 0                       ! of the buffers that is filled; 0: columns are listed
      integer, private :: i = 0                         ! column
      logical, private :: is_there = .true.             ! the columns that follow are part of the file
      logical, private :: is_known = .true.             ! their values are known of the motion
      type(error_t), allocatable, private :: error
   contains
      procedure :: axis_index => plan_axis_index
      procedure :: extents_of => plan_extents_of
      procedure :: index_of => plan_index_of
      procedure :: length_of => plan_length_of
      procedure :: put_motion => plan_put_motion
      procedure, private :: integer => plan_integer
      procedure, private :: real => plan_real
      procedure, private :: text => plan_text
   end type plan_t

contains

   ! The table

   subroutine all_columns(t, m)
      type(plan_t), intent(inout) :: t
      type(motion_result_t), intent(in) :: m

      call outcome_columns(t, m)
      call accuracy_columns(t, m)
      call motion_columns(t, m)
      call certificate_columns(t, m)
      call stability_columns(t, m)
      call later_columns(t, m)
      call curve_columns(t, m)
      call surface_columns(t, m)
      t%is_there = .true.
      t%is_known = .true.
   end subroutine all_columns

   subroutine outcome_columns(t, m)
      type(plan_t), intent(inout) :: t
      type(motion_result_t), intent(in) :: m

      call t%integer("status", "1", "", "outcome of the point", m%status, outcome_names)
      call t%text("message", "1", "message_byte", "why the point failed", m%message)
      call t%integer("iterations", "1", "", "iterations of the solver", m%iterations)
      call t%integer("rescue", "1", "", "what the solver needed beside the direct attempt", m%rescue, rescue_names)
      call t%integer("evaluations", "1", "", "evaluations of the residual", m%evaluations)
      call t%real("residual", "1", "", "norm of the balance relative to the scale of the forces", m%residual)
      call t%real("solve_seconds", "s", "", "wall time of the point", m%solve_seconds)
      call t%real("setup_seconds", "s", "", "of it, dynamic stiffness, plans, first guess", m%setup_seconds)
      call t%real("iteration_seconds", "s", "", "of it, the solver", m%solver_seconds)
      call t%real("certificate_seconds", "s", "", "of it, the certificate", m%certificate_seconds)
      call t%integer("rank", "1", "", "MPI rank that solved the point", m%rank)
      call t%integer("n_harmonics", "1", "", "number of harmonics in the set of the point", m%n_harmonics)
      call t%integer("n_unknowns", "1", "", "number of unknowns of the equations that were solved", m%n_unknowns)
      call t%integer("is_odd", "1", "", &
         "1 where the motion was sought among those of odd tuples alone, the equations being odd", merge(1, 0, m%is_odd))
      call t%integer("n_full_stick", "1", "", &
         "friction laws that slip nowhere: the solution from rest, one of many", m%n_full_stick)
      call t%integer("n_motions", "1", "", "motions in which marching from several starts ends; 0: not tried", m%n_motions)
      call t%integer("is_marched_first", "1", "", "1 where marching was tried before the balance", merge(1, 0, m%is_marched_first))
      call t%real("frequency", "rad/s", "tone", "base frequencies", m%frequency)
      call t%real("artificial_damping", "1/s", "tone", &
         "xi of a normal mode: the forces -xi M dx/dt that keep up its amplitude", m%artificial_damping)
   end subroutine outcome_columns

   !> With `&accuracy`; the last columns where it names outputs.
   subroutine accuracy_columns(t, m)
      type(plan_t), intent(inout) :: t
      type(motion_result_t), intent(in) :: m

      t%is_there = t%has_accuracy
      call t%integer("n_rungs", "1", "", "sets and grids that were solved until the tolerance was met", m%n_rungs)
      call t%real("rung_difference", "1", "", "difference of the last two of them, relative to the motion", m%rung_difference)
      call t%real("level_estimate", "1", "", &
         "estimated error as this difference shows it, where it is more than by the motion alone; else 0", m%level_estimate)
      call t%integer("grid", "1", "tone", "samples of each tone", m%n_samples)
      t%is_there = t%has_accuracy .and. t%has_outputs
      call t%real("output_estimate", "1", "output", &
         "estimated error of each output that the tolerance is for, relative to it", m%output_estimate)
      call t%real("output_level_estimate", "1", "output", &
         "estimated error of each output as the difference of rungs shows it, where it is more; else 0", m%output_level_estimate)
   end subroutine accuracy_columns

   !> `tuples` where each point chooses its own, improved coefficients with `&certificate improvement_steps`.
   subroutine motion_columns(t, m)
      type(plan_t), intent(inout) :: t
      type(motion_result_t), intent(in) :: m

      t%is_there = t%has_own_tuples
      call t%integer("tuples", "1", "harmonic tone", &
         "integer tuple j of each harmonic of the point; only the first n_harmonics are in use", m%harmonics%tuples)
      t%is_there = .true.
      call t%real("coefficients", of_dof, "dof harmonic component", "coefficients of the motion", m%coefficients)
      call t%real("force_coefficients", of_force, "law_dof harmonic component", &
         "coefficients of the force of the laws, on the left-hand side", m%force_coefficients)
      call t%real("corrected_coefficients", of_dof, "law_dof harmonic component", &
         "coefficients of the displacement corrected to the wall", m%corrected_coefficients)
      t%is_known = allocated(m%certificate%combination)
      call t%real("frequency_estimate", "rad/s", "tone", "estimated error of the frequencies, 0 where given", &
         m%certificate%frequency_error)
      t%is_known = .true.
      t%is_there = t%has_improved
      call t%real("improved_coefficients", of_dof, "law_dof harmonic component", &
         "coefficients of the motion improved in a wider set of harmonics", m%improved_coefficients)
      t%is_there = .true.
   end subroutine motion_columns

   subroutine certificate_columns(t, m)
      type(plan_t), intent(inout) :: t
      type(motion_result_t), intent(in) :: m
      real(wp) :: damping, loss, loss_factor

      loss = m%certificate%power_damping
      if (allocated(m%certificate%power_laws)) loss = loss + sum(m%certificate%power_laws)
      t%is_known = allocated(m%certificate%combination)
      damping = 0.0_wp
      loss_factor = 0.0_wp
      if (t%is_known) damping = m%certificate%energy%decay(loss)
      if (t%is_known) loss_factor = m%certificate%energy%loss_factor(loss)
      associate (found => m%certificate)
         call t%real("truncation_estimate", "1", "", &
            "estimated error by the harmonics left out, relative to the motion", found%truncation)
         call t%real("aliasing_estimate", "1", "", &
            "estimated error by the finite number of samples, relative to the motion", found%aliasing)
         call t%real("penetration", "m", "", "largest penetration into a rigid wall", found%defects%penetration)
         call t%real("impact_estimate", "1", "", &
            "energy of the hardest blow against a rigid wall, relative to that of the motion there", found%impact)
         call t%real("tension", "N", "", "largest pull that a rigid wall would have to exert", found%defects%tension)
         call t%real("complementarity", "N m", "", "largest product of reaction and gap of a rigid wall", &
            found%defects%complementarity)
         call t%real("slip_defect", "W", "", &
            "largest power that exact friction would take beyond the reaction of rigid friction", found%defects%slip)
         call t%real("power_in", "W", "", "mean power of the loads", found%power_in)
         call t%real("power_damping", "W", "", "mean loss in the damping of the structure", found%power_damping)
         call t%real("power_laws", "W", "law", "mean loss in each law", found%power_laws)
         call t%real("energy_kinetic", "J", "", "mean kinetic energy of the structure", found%energy%kinetic)
         call t%real("energy_strain", "J", "", "mean strain energy of the structure", found%energy%strain)
         call t%real("loss_factor", "1", "", &
            "all losses over twice the sum of frequency times mean strain energy of each harmonic", loss_factor)
         call t%real("equivalent_damping", "1/s", "", "all losses over four times the mean kinetic energy", damping)
         call t%real("combination_frequency", "rad/s", "", "smallest |k.omega| of low order", found%combination_frequency)
         call t%integer("combination", "1", "tone", "integers k of combination_frequency", found%combination)
      end associate
      call t%integer("is_near_commensurate", "1", "", "1 where combination_frequency is below the threshold: "// &
         "the tones are hard to tell from commensurate ones", merge(1, 0, m%is_near_commensurate))
      t%is_known = .true.
   end subroutine certificate_columns

   !> Exponents and multipliers where stability is asked for, multipliers of one tone alone.
   subroutine stability_columns(t, m)
      type(plan_t), intent(inout) :: t
      type(motion_result_t), intent(in) :: m
      real(wp), allocatable :: exponents(:), im(:), re(:)
      integer :: n

      n = t%n_multipliers
      associate (found => m%stability)
         if (allocated(found%exponents)) exponents = padded(found%exponents, n)
         if (allocated(found%exponents) .and. allocated(found%multipliers)) then
            re = padded(real(found%multipliers), n)
            im = padded(aimag(found%multipliers), n)
         end if
         call t%integer("is_stable", "1", "", &
            "1 where small disturbances of the motion die out, -1 where one grows, 0 where that is not known", found%verdict)
         call t%integer("n_unstable", "1", "", "disturbances that grow", found%n_unstable)
         call t%integer("stability_method", "1", "", "how stability was found", found%method, stability_method_names)
         t%is_known = allocated(exponents)
         call t%real("stability_estimate", trim(merge("1  ", "1/s", t%has_one_tone)), "", &
            "estimated error of the monodromy matrix, relative; of several tones of the largest exponent", found%estimate)
         t%is_there = n > 0
         call t%real("exponent", "1/s", "multiplier", "rates at which disturbances grow, the largest first", exponents)
         t%is_there = n > 0 .and. t%has_one_tone
         call t%real("multiplier_real", "1", "multiplier", "Floquet multipliers, the largest first: real parts", re)
         call t%real("multiplier_imag", "1", "multiplier", "Floquet multipliers, the largest first: imaginary parts", im)
      end associate
      t%is_there = .true.
      t%is_known = .true.
   end subroutine stability_columns

   !> What is found when the row, or the run, is complete: the checksum, branches, and what `nhbm verify` writes.
   subroutine later_columns(t, m)
      type(plan_t), intent(inout) :: t
      type(motion_result_t), intent(in) :: m
      real(wp), parameter :: none = 0.0_wp

      call t%integer("checksum", "1", "", "CRC-32 over the values of the row, as they stand in the file", 0)
      call t%integer("branch", "1", "", &
         "piece of the response along the fastest swept parameter, from 1; 0 where that is not known", &
         merge(left_branch, 0, m%leaves_branch))
      t%is_known = .false.
      call t%integer("march_verdict", "1", "", "what marching from the point says of it", 0, verdict_names)
      call t%real("march_first_difference", "1", "", "largest difference to marching in the first period of the slowest tone, "// &
         "relative to the motion of its coordinate", none)
      call t%real("march_difference", "1", "", "difference to marching in the last periods, "// &
         "of the coordinate worst for its limit, relative to its motion", none)
      call t%real("march_limit", "1", "", "limit of that difference", none)
      call t%real("march_growth", "1/s", "", "rate at which a march close to the motion leaves it", none)
      call t%real("march_duration", "s", "", "how long was marched", none)
      call t%real("march_drift", "rad/s", "tone", &
         "difference of the marched frequency to that of the motion, 0 where given", [none])
      t%is_known = .true.
   end subroutine later_columns

   !> With `&curve`. What a state lacks of the row stays NaN; with tuples of its own it is used up to a first NaN.
   subroutine curve_columns(t, m)
      type(plan_t), intent(inout) :: t
      type(motion_result_t), intent(in) :: m
      type(curve_place_t) :: place
      real(wp), allocatable :: state(:)
      character(:), allocatable :: path

      t%is_there = allocated(t%curve_parameter)
      if (.not. t%is_there) return
      path = t%curve_parameter
      t%is_known = allocated(m%curve)
      if (t%is_known) place = m%curve
      allocate (state(0))
      if (allocated(place%state)) state = place%state
      state = padded(state, merge(size(state) + 1, t%n_curve_state, t%has_own_tuples))
      call t%integer("curve_kind", "1", "", "what the point of a curve is", place%kind, curve_kind_names)
      call t%integer("curve_branch", "1", "", &
         "number of the branch point from which this part of the curve was followed, from 1; 0: from its start", place%branch)
      call t%real("curve_length", "1", "", "length of the curve from its start, "// &
         "in units of the range and of the largest motion; negative on the other way", place%length)
      call t%real("curve_state", "1", "curve_entry", &
         "unknowns and value, direction, step, orientation and largest motion, from which the curve goes on", state)
      call t%real(identifier(path), t%curve_units, "", "value of "//path//" along the curve", place%parameter)
      if (t%row == 0) t%columns(t%i)%parameter = path
   end subroutine curve_columns

   !> With `&output samples`.
   subroutine surface_columns(t, m)
      type(plan_t), intent(inout) :: t
      type(motion_result_t), intent(in) :: m

      t%is_there = t%has_surfaces
      t%is_known = .true.
      if (.not. t%is_there .and. .not. allocated(t%error) .and. &
          (allocated(m%displacement_samples) .or. allocated(m%corrected_samples) .or. allocated(m%force_samples))) &
         call fail(t%error, "'displacement_samples' or 'force_samples' given, but the layout has no room for surfaces")
      call t%real("displacement_samples", of_dof, "law_dof tau", "hypertime surface of the motion", m%displacement_samples)
      call t%real("corrected_samples", of_dof, "law_dof tau", "hypertime surface corrected to the wall", m%corrected_samples)
      call t%real("force_samples", of_force, "law_dof tau", "hypertime surface of the force", m%force_samples)
   end subroutine surface_columns

   !> One row per rank: hb_timing%rank_times_t%as_row and the overhead.
   subroutine time_columns(t)
      type(plan_t), intent(inout) :: t

      call t%integer("worker_points", "1", "worker", "points that the rank solved", 0)
      call t%integer("worker_draws", "1", "worker", "numbers that the rank drew from shared counters", 0)
      call t%real("worker_reading_seconds", "s", "worker", "time of making scenes of the input", 0.0_wp)
      call t%real("worker_solving_seconds", "s", "worker", "time of solving", 0.0_wp)
      call t%real("worker_writing_seconds", "s", "worker", "time of writing results", 0.0_wp)
      call t%real("worker_drawing_seconds", "s", "worker", "time at shared counters", 0.0_wp)
      call t%real("worker_idle_seconds", "s", "worker", "time of waiting for the other ranks at the end", 0.0_wp)
      call t%real("worker_total_seconds", "s", "worker", "time from the first draw to the end of the slowest rank", 0.0_wp)
      call t%real("worker_overhead_per_point", "s", "worker", "time per point that was neither solving nor waiting", 0.0_wp)
   end subroutine time_columns

   !> All dimensions of the file.
   subroutine list_axes(layout, axes)
      type(results_layout_t), intent(in) :: layout
      type(axis_t), allocatable, intent(out) :: axes(:)
      integer :: i

      allocate (axes(0))
      call add("point", layout%n_points, "number of the sweep point, from 0")
      call add("tone", size(layout%tuples, 1), "number of the tone, from 1", first=1)
      call add("harmonic", size(layout%tuples, 2), "number of the harmonic, from 0")
      call add("dof", size(layout%dof_labels), "stored degree of freedom", layout%dof_labels, layout%dof_units)
      call add("law_dof", size(layout%law_dof_labels), "degree of freedom on which laws act", layout%law_dof_labels, &
         layout%law_dof_units)
      call add("component", 2, "part of a coefficient", ["cos", "sin"])
      call add("message_byte", message_length, "byte of a message")
      call add("law", size(layout%law_labels), "law, by its label", layout%law_labels)
      call add("worker", layout%n_ranks, "MPI rank of the run, from 0")
      call add("multiplier", layout%n_multipliers, "number of the multiplier, from 0")
      call add("output", size(layout%output_names), "output that the tolerance is for, as the input has it", layout%output_names)
      do i = 1, size(layout%n_samples)
         call add("tau_"//to_text(i), layout%n_samples(i), "hypertime of tone "//to_text(i))
         axes(size(axes))%units = "rad"
      end do
      if (allocated(layout%curve_parameter)) &
         call add("curve_entry", layout%n_curve_state, "number from which a curve goes on, from 0")
   contains
      subroutine add(name, length, long_name, labels, dof_units, first)
         character(*), intent(in) :: name, long_name
         integer, intent(in) :: length
         character(*), intent(in), optional :: labels(:), dof_units(:)
         integer, intent(in), optional :: first                       !! number, default 0
         type(axis_t) :: axis

         axis%name = name
         axis%length = length
         axis%long_name = long_name
         axis%units = "1"
         if (present(labels)) axis%labels = [character(64) :: labels]
         if (present(dof_units)) axis%dof_units = [character(16) :: dof_units]
         if (present(first)) axis%first = first
         axes = [axes, axis]
      end subroutine add
   end subroutine list_axes

   ! Going through the table

   !> Plans the file for a layout that `check_layout` has passed.
   subroutine new_plan(self, layout)
      type(plan_t), intent(out) :: self
      type(results_layout_t), intent(in) :: layout

      self%has_accuracy = layout%has_accuracy
      self%has_own_tuples = layout%has_own_tuples
      self%has_improved = layout%has_improved
      self%has_outputs = size(layout%output_names) > 0
      self%has_one_tone = size(layout%tuples, 1) == 1
      self%has_surfaces = size(layout%n_samples) > 0
      self%n_multipliers = layout%n_multipliers
      self%n_curve_state = layout%n_curve_state
      self%curve_units = ""
      if (allocated(layout%curve_parameter)) self%curve_parameter = layout%curve_parameter
      if (allocated(layout%curve_units)) self%curve_units = layout%curve_units
      call list_axes(layout, self%axes)
      allocate (self%columns(most_columns))
      call time_columns(self)
      self%times = self%columns(:self%i)
      self%i = 0
      call all_columns(self, motion_result_t())
      self%columns = self%columns(:self%i)
   end subroutine new_plan

   !> Puts what is known of a motion into a row of the buffers, and nothing where that is not known.
   subroutine plan_put_motion(self, row, motion, error)
      class(plan_t), intent(inout) :: self
      integer, intent(in) :: row
      type(motion_result_t), intent(in) :: motion
      type(error_t), allocatable, intent(out) :: error

      self%row = row
      self%i = 0
      call all_columns(self, motion)
      call move_alloc(self%error, error)
   end subroutine plan_put_motion

   !> A column of integers: lists it, or puts the values of the row into its buffer.
   subroutine plan_integer(self, name, units, shape, long_name, values, flags)
      class(plan_t), intent(inout) :: self
      character(*), intent(in) :: name, units, shape, long_name
      integer, intent(in), contiguous, optional :: values(..)
      character(*), intent(in), optional :: flags(:)

      if (.not. begins(self, is_integer, name, units, shape, long_name)) return
      associate (column => self%columns(self%i))
         if (present(flags) .and. self%row == 0) then
            column%flags = join(flags, " ")
            column%n_flags = size(flags)
         end if
         if (self%row == 0) return
         if (present(values)) then
            call column%held%put(self%row, values, self%error)
         else
            call column%held%blank(self%row)
         end if
      end associate
      if (allocated(self%error)) call annotate(self%error, "'"//name//"'")
   end subroutine plan_integer

   !> A column of real numbers.
   subroutine plan_real(self, name, units, shape, long_name, values)
      class(plan_t), intent(inout) :: self
      character(*), intent(in) :: name, units, shape, long_name
      real(wp), intent(in), contiguous, optional :: values(..)

      if (.not. begins(self, is_real, name, units, shape, long_name) .or. self%row == 0) return
      associate (held => self%columns(self%i)%held)
         if (present(values)) then
            call held%put(self%row, values, self%error)
         else
            call held%put_none(self%row, self%error)
         end if
      end associate
      if (allocated(self%error)) call annotate(self%error, "'"//name//"'")
   end subroutine plan_real

   !> A column of texts.
   subroutine plan_text(self, name, units, shape, long_name, value)
      class(plan_t), intent(inout) :: self
      character(*), intent(in) :: name, units, shape, long_name
      character(*), intent(in), optional :: value

      if (.not. begins(self, is_characters, name, units, shape, long_name) .or. self%row == 0) return
      associate (held => self%columns(self%i)%held)
         call held%blank(self%row)
         if (present(value)) call held%put(self%row, shortened(value, message_length), self%error)
      end associate
   end subroutine plan_text

   !> Goes on to the next column, and lists it unless a row is filled. False where there is no value to put.
   logical function begins(self, kind, name, units, shape, long_name)
      class(plan_t), intent(inout) :: self
      integer, intent(in) :: kind
      character(*), intent(in) :: name, units, shape, long_name
      character(16), allocatable :: dof_units(:)

      begins = self%is_there .and. .not. allocated(self%error)
      if (.not. begins) return
      self%i = self%i + 1
      associate (column => self%columns(self%i))
         if (self%row > 0) then
            begins = self%is_known
            if (.not. begins) call column%held%blank(self%row)
            return
         end if
         column%name = name
         column%kind = kind
         column%long_name = long_name
         column%units = units
         call find_axes(self, shape, column%axes)
         column%is_checked = all(name /= ["checksum", "branch  ", "rank    "]) .and. index(name, "march_") /= 1 .and. &
            index(name, "_seconds") == 0
         column%is_part_used = self%has_own_tuples .and. (index(shape, "harmonic") > 0 .or. shape == "curve_entry")
         if (units /= of_dof .and. units /= of_force) return
         dof_units = self%axes(column%axes(size(column%axes) - 1))%dof_units
         if (units == of_force) dof_units = force_units(dof_units)
         column%units = common_units(dof_units)
         column%dof_units = trim(adjustl(join(dof_units, " ")))
      end associate
   end function begins

   !> Axes of the rows of a shape, fastest first; the last is that of the points, or of the ranks.
   subroutine find_axes(self, shape, axes)
      class(plan_t), intent(in) :: self
      character(*), intent(in) :: shape
      integer, allocatable, intent(out) :: axes(:)
      type(string_t), allocatable :: names(:)
      integer :: i, k

      allocate (axes(0))
      if (shape /= "worker") axes = [self%axis_index("point")]
      call split(shape, " ", names)
      do i = 1, size(names)
         select case (names(i)%value)
         case ("")
         case ("tau")
            axes = [pack([(k, k=1, size(self%axes))], [(index(self%axes(k)%name, "tau_") == 1, k=1, size(self%axes))]), axes]
         case default
            axes = [self%axis_index(names(i)%value), axes]
         end select
      end do
   end subroutine find_axes

   !> Gives the index of an axis, 0 where the file has none of the name.
   pure integer function plan_axis_index(self, name) result(i)
      class(plan_t), intent(in) :: self
      character(*), intent(in) :: name

      do i = size(self%axes), 1, -1
         if (self%axes(i)%name == name) return
      end do
   end function plan_axis_index

   !> Gives the index of a column, 0 where the file has none of the name.
   pure integer function plan_index_of(self, name) result(i)
      class(plan_t), intent(in) :: self
      character(*), intent(in) :: name

      do i = size(self%columns), 1, -1
         if (self%columns(i)%name == name) return
      end do
   end function plan_index_of

   !> Gives the extents of a column, fastest first; without the last those of a row.
   pure function plan_extents_of(self, column) result(extents)
      class(plan_t), intent(in) :: self
      type(column_t), intent(in) :: column
      integer :: extents(size(column%axes))

      extents = self%axes(column%axes)%length
   end function plan_extents_of

   !> Gives the length of an axis, 0 where the file has none of the name.
   pure integer function plan_length_of(self, axis) result(length)
      class(plan_t), intent(in) :: self
      character(*), intent(in) :: axis
      integer :: i

      i = self%axis_index(axis)
      length = 0
      if (i > 0) length = self%axes(i)%length
   end function plan_length_of

   ! Values and units

   !> The first `n` values, and NaN where there are fewer.
   pure function padded(values, n)
      real(wp), intent(in) :: values(:)
      integer, intent(in) :: n
      real(wp) :: padded(n)

      padded = ieee_value(1.0_wp, ieee_quiet_nan)
      padded(:min(n, size(values))) = values(:min(n, size(values)))
   end function padded

   !> Gives the name of the dataset with the entries of all tuples for one tone, from 1.
   pure function tuple_entry_name(tone) result(name)
      integer, intent(in) :: tone
      character(:), allocatable :: name

      name = "tuple_"//to_text(tone)
   end function tuple_entry_name

   !> Gives the unit of the force that does work on each degree of freedom.
   pure function force_units(units)
      character(*), intent(in) :: units(:)
      character(16) :: force_units(size(units))
      integer :: i

      do i = 1, size(units)
         select case (units(i))
         case ("m"); force_units(i) = "N"
         case ("rad"); force_units(i) = "N*m"
         case ("1", ""); force_units(i) = "1"
         case default; force_units(i) = "J/"//units(i)
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
end module hb_result_columns
