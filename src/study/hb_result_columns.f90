!> The columns of a result file: those of motions (hb_motion_columns), those that are found when a row, or the run, is complete, and
!> the times of ranks.
!>
!> Going through them once lists the datasets of a file (`new_plan`); going through them again with a motion puts its values into
!> the row of a point (`put_motion`).
module hb_result_columns
   use hb_branches, only: left_branch
   use hb_error, only: annotate, error_t, fail
   use hb_hdf5, only: h5_dataset_t, is_characters, is_integer, is_real
   use hb_integration_verdict, only: verdict_names
   use hb_kinds, only: wp
   use hb_motion_columns, only: columns_t, of_dof, of_force
   use hb_motion_result, only: motion_result_t
   use hb_parameter_path, only: identifier
   use hb_results_layout, only: results_layout_t
   use hb_row_buffer, only: row_buffer_t
   use hb_text, only: join, shortened, split, string_t, to_text
   implicit none
   private
   public :: axis_t, column_t, message_length, new_plan, plan_t, tuple_entry_name

   integer, parameter :: message_length = 400          ! bytes
   integer, parameter :: most_columns = 100            ! that the table has room for

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
   type, extends(columns_t) :: plan_t
      type(axis_t), allocatable :: axes(:)              ! that of the points is the first
      type(column_t), allocatable :: columns(:)         ! one row per point
      type(column_t), allocatable :: times(:)           ! one row per rank: hb_timing%rank_times_t and the overhead
      ! Going through the table:
      integer, private :: row = 0                       ! of the buffers that is filled; 0: columns are listed
      integer, private :: i = 0                         ! column
      type(error_t), allocatable, private :: error
   contains
      procedure :: axis_index => plan_axis_index
      procedure :: extents_of => plan_extents_of
      procedure :: index_of => plan_index_of
      procedure :: length_of => plan_length_of
      procedure :: put_motion => plan_put_motion
      procedure :: integer => plan_integer
      procedure :: real => plan_real
      procedure :: text => plan_text
   end type plan_t

contains

   subroutine all_columns(t, m)
      type(plan_t), intent(inout) :: t
      type(motion_result_t), intent(in) :: m

      call t%go_through(m)
      call later_columns(t, m)
      t%is_known = .true.
   end subroutine all_columns

   !> What is found when the row, or the run, is complete: the checksum, branches, and what `nhbm verify` writes.
   subroutine later_columns(t, m)
      type(plan_t), intent(inout) :: t
      type(motion_result_t), intent(in) :: m
      real(wp), parameter :: none = 0.0_wp

      call t%integer("checksum", "1", "", "CRC-32 over the values of the row, as they stand in the file", 0)
      call t%integer("branch", "1", "", &
         "segment of the response along the fastest swept parameter, from 1; 0: unknown", &
         merge(left_branch, 0, m%leaves_branch))
      t%is_known = .false.
      call t%integer("integration_verdict", "1", "", "verdict of nhbm verify", 0, verdict_names)
      call t%real("integration_first_difference", "1", "", &
         "largest difference from time integration in the first period of the slowest tone, "// &
         "relative to the motion of its coordinate", none)
      call t%real("integration_difference", "1", "", "difference from time integration in the last periods, "// &
         "for the coordinate with the largest ratio to its limit, relative to its motion", none)
      call t%real("integration_limit", "1", "", "limit of that difference", none)
      call t%real("integration_growth", "1/s", "", "rate at which a nearby trajectory diverges from the motion", none)
      call t%real("integration_duration", "s", "", "integrated time", none)
      call t%real("integration_drift", "rad/s", "tone", &
         "integrated frequency minus that of the motion, 0 for given tones", [none])
      t%is_known = .true.
   end subroutine later_columns

   !> One row per rank: hb_timing%rank_times_t%as_row and the overhead.
   subroutine time_columns(t)
      type(plan_t), intent(inout) :: t

      call t%integer("worker_points", "1", "worker", "points that the rank solved", 0)
      call t%integer("worker_draws", "1", "worker", "accesses of the rank to shared counters", 0)
      call t%real("worker_reading_seconds", "s", "worker", "time for creating models from the input", 0.0_wp)
      call t%real("worker_solving_seconds", "s", "worker", "time for solving", 0.0_wp)
      call t%real("worker_writing_seconds", "s", "worker", "time for writing results", 0.0_wp)
      call t%real("worker_drawing_seconds", "s", "worker", "time for accessing shared counters", 0.0_wp)
      call t%real("worker_idle_seconds", "s", "worker", "time waiting for the other ranks at the end", 0.0_wp)
      call t%real("worker_total_seconds", "s", "worker", "time from the first access to the end of the slowest rank", 0.0_wp)
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
      call add("gradient_value", size(layout%gradient_names), "value by which motions are differentiated, as the input has it", &
         layout%gradient_names)
      do i = 1, size(layout%n_samples)
         call add("tau_"//to_text(i), layout%n_samples(i), "hypertime of tone "//to_text(i))
         axes(size(axes))%units = "rad"
      end do
      if (allocated(layout%curve_parameter)) &
         call add("curve_unknown", layout%n_curve_unknowns, "number of the unknown of the curve, from 0")
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
      self%has_gradient = size(layout%gradient_names) > 0
      self%has_one_tone = size(layout%tuples, 1) == 1
      self%has_surfaces = size(layout%n_samples) > 0
      self%n_multipliers = layout%n_multipliers
      self%n_curve_unknowns = layout%n_curve_unknowns
      self%has_curve = allocated(layout%curve_parameter)
      self%curve_units = ""
      if (allocated(layout%curve_units)) self%curve_units = layout%curve_units
      if (self%has_curve) self%curve_path = layout%curve_parameter
      if (self%has_curve) self%curve_column = identifier(layout%curve_parameter)
      call list_axes(layout, self%axes)
      allocate (self%columns(most_columns))
      call time_columns(self)
      self%times = self%columns(:self%i)
      self%i = 0
      call all_columns(self, motion_result_t())
      self%columns = self%columns(:self%i)
   end subroutine new_plan

   !> Puts the results of a motion into a row of the buffers, and nothing where that is not known.
   subroutine plan_put_motion(self, row, motion, error)
      class(plan_t), intent(inout) :: self
      integer, intent(in) :: row
      type(motion_result_t), intent(in) :: motion
      type(error_t), allocatable, intent(out) :: error

      if (.not. self%has_surfaces .and. (allocated(motion%displacement_samples) .or. &
                                         allocated(motion%corrected_samples) .or. allocated(motion%force_samples))) then
         call fail(error, "'displacement_samples' or 'force_samples' given, but the layout has no room for surfaces")
         return
      end if
      self%row = row
      self%i = 0
      call all_columns(self, motion)
      call move_alloc(self%error, error)
   end subroutine plan_put_motion

   !> A column of integers: lists it, or puts the values of the row into its buffer.
   subroutine plan_integer(self, name, units, axes, long_name, values, flags)
      class(plan_t), intent(inout) :: self
      character(*), intent(in) :: name, units, axes, long_name
      integer, intent(in), contiguous, optional :: values(..)
      character(*), intent(in), optional :: flags(:)

      if (.not. begins(self, is_integer, name, units, axes, long_name)) return
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
   subroutine plan_real(self, name, units, axes, long_name, values)
      class(plan_t), intent(inout) :: self
      character(*), intent(in) :: name, units, axes, long_name
      real(wp), intent(in), contiguous, optional :: values(..)

      if (.not. begins(self, is_real, name, units, axes, long_name) .or. self%row == 0) return
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
   subroutine plan_text(self, name, units, axes, long_name, value)
      class(plan_t), intent(inout) :: self
      character(*), intent(in) :: name, units, axes, long_name
      character(*), intent(in), optional :: value

      if (.not. begins(self, is_characters, name, units, axes, long_name) .or. self%row == 0) return
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
         if (self%has_curve) then
            if (name == self%curve_column) column%parameter = self%curve_path
         end if
         column%kind = kind
         column%long_name = long_name
         column%units = units
         call find_axes(self, shape, column%axes)
         column%is_checked = all(name /= ["checksum", "branch  ", "rank    "]) .and. index(name, "integration_") /= 1 .and. &
            index(name, "_seconds") == 0
         column%is_part_used = self%has_own_tuples .and. (index(shape, "harmonic") > 0 .or. shape == "curve_unknown")
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
   pure function common_units(units) result(shared)
      character(*), intent(in) :: units(:)
      character(:), allocatable :: shared

      shared = "see dof_units"
      if (size(units) == 0) then
         shared = "1"
      else if (all(units == units(1))) then
         shared = trim(units(1))
      end if
   end function common_units
end module hb_result_columns
