!> The columns of a result file: those of motions (hb_motion_columns), those that are computed when a row, or the run,
!> is complete, and the times of ranks.
!> One pass over them lists the datasets of a file (`new_plan`); a pass with a motion stores its values in the row of
!> a point (`store_row`).
module hb_result_columns
   use hb_error, only: annotate, error_t, fail
   use hb_file_columns, only: file_columns_t
   use hb_hdf5, only: bytes_of_kind, h5_dataset_t, is_characters, is_integer, is_real
   use hb_integration_verdict, only: verdict_t
   use hb_kinds, only: int64, two_pi, wp
   use hb_line_numbering, only: branch_column
   use hb_motion_columns, only: max_advice, max_attempts, max_values
   use hb_motion_result, only: motion_result_t
   use hb_parameter_path, only: identifier
   use hb_results_layout, only: results_layout_t
   use hb_row_buffer, only: row_buffer_t
   use hb_text, only: join, shortened, to_text
   use hb_verdict_columns, only: verdict_columns
   implicit none
   private
   public :: bytes_of_row, column_t, measure_row, message_length, new_plan, plan_t, tuple_entry_name

   integer, parameter :: message_length = 400          ! bytes
   integer, parameter :: first_capacity = 64          ! of the table, in columns; it grows

   !> A text that describes a dataset.
   type :: attribute_t
      character(:), allocatable :: name, text
   end type attribute_t

   !> A dataset of the file that has one row per point, or per rank.
   type :: column_t
      character(:), allocatable :: name, long_name, units
      integer :: kind = 0                               ! of its values, hb_hdf5
      integer, allocatable :: axes(:)                   ! indices of axes, fastest first
      character(:), allocatable :: dof_units            ! of each degree of freedom, if these are an axis
      character(:), allocatable :: flags                ! names of the values lowest_flag, ..., separated by blanks
      integer :: n_flags = 0, lowest_flag = 0
      character(:), allocatable :: parameter            ! path in the input of the value that moves along curves
      type(attribute_t), allocatable :: attributes(:)   ! further ones
      logical :: is_part_used = .false.                 ! each row uses only as many harmonics as the point has
      logical :: is_checked = .true.                    ! the checksum of a row includes it
      type(h5_dataset_t) :: dataset
      type(row_buffer_t) :: held                        ! rows that are not written yet
   end type column_t

   !> The contents of a file besides swept parameters and texts.
   type, extends(file_columns_t) :: plan_t
      type(column_t), allocatable :: columns(:)         ! one row per point
      type(column_t), allocatable :: times(:)           ! one row per rank: hb_results_layout%rank_times_t and the overhead
      ! Going through the table:
      integer, private :: row = 0                       ! of the buffers into which values are stored; 0: columns are listed
      integer, private :: i = 0                         ! column
      type(error_t), allocatable, private :: error
   contains
      procedure :: extents_of => plan_extents_of
      procedure :: index_of => plan_index_of
      procedure :: store_row => plan_store_row
      procedure :: integer => plan_integer
      procedure :: attribute => plan_attribute
      procedure :: real => plan_real
      procedure :: text => plan_text
   end type plan_t

contains

   subroutine all_columns(t, m)
      type(plan_t), intent(inout) :: t
      type(motion_result_t), intent(in) :: m

      call t%append_connected(m)
      call later_columns(t, m)
      t%is_known = .true.
   end subroutine all_columns

   !> Columns that are written when the row, or the run, is complete: the checksum, branches, and those of `nhbm
   !> verify`.
   subroutine later_columns(t, m)
      type(plan_t), intent(inout) :: t
      type(motion_result_t), intent(in) :: m

      call t%integer("checksum", "1", "", "CRC-32 over the values of the row, as they stand in the file", 0)
      call branch_column(t, m%leaves_branch)
      t%is_known = .false.
      call verdict_columns(t, verdict_t())
      t%is_known = .true.
   end subroutine later_columns

   !> One row per rank: hb_results_layout%rank_times_t%as_row and the overhead.
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

   !> All dimensions of the file; that of the points is the first.
   subroutine list_axes(self, layout)
      class(plan_t), intent(inout) :: self
      type(results_layout_t), intent(in) :: layout
      integer :: i, k

      call self%add_axis("point", layout%n_points, "number of the sweep point, from 0")
      call self%add_axis("tone", size(layout%tuples, 1), "number of the tone, from 1", first=1)
      call self%add_axis("harmonic", size(layout%tuples, 2), "number of the harmonic, from 0")
      call self%add_axis("dof", size(layout%dof_labels), "stored degree of freedom", layout%dof_labels, layout%dof_units)
      call self%add_axis("law_dof", size(layout%law_dof_labels), "degree of freedom on which laws act", layout%law_dof_labels, &
         layout%law_dof_units)
      call self%add_axis("component", 2, "part of a coefficient", ["cos", "sin"])
      call self%add_axis("message_byte", message_length, "byte of a message")
      call self%add_axis("advice_item", max_advice, "number of the advice, from 0")
      call self%add_axis("advice_value", max_values, "number of the value, from 0")
      call self%add_axis("attempt", max_attempts, "number of the attempt, from 0")
      call self%add_axis("law", size(layout%law_labels), "law, by its label", layout%law_labels)
      call self%add_axis("worker", layout%n_ranks, "rank or process of the run, from 0")
      call self%add_axis("multiplier", layout%n_multipliers, "number of the multiplier, from 0")
      call self%add_axis("output", size(layout%output_names), "output that the tolerance is for, as the input has it", &
         layout%output_names)
      call self%add_axis("gradient_value", size(layout%gradient_names), &
         "value by which motions are differentiated, as the input has it", layout%gradient_names)
      do i = 1, size(layout%n_samples)
         call self%add_axis("tau_"//to_text(i), layout%n_samples(i), "hypertime of tone "//to_text(i))
         associate (axis => self%axes(size(self%axes)))
            axis%units = "rad"
            axis%values = [(two_pi*k/axis%length, k=0, axis%length - 1)]
         end associate
      end do
      if (allocated(layout%curve_parameter)) &
         call self%add_axis("curve_unknown", layout%n_curve_unknowns, "number of the unknown of the curve, from 0")
   end subroutine list_axes

   ! Going through the table

   !> Plans the file for a layout that has passed `check_layout`.
   subroutine new_plan(self, layout)
      type(plan_t), intent(out) :: self
      type(results_layout_t), intent(in) :: layout

      self%has_accuracy = layout%has_accuracy
      self%has_own_tuples = layout%has_own_tuples
      self%has_improved = layout%has_improved
      self%has_outputs = size(layout%output_names) > 0
      self%has_gradient = size(layout%gradient_names) > 0
      self%has_response_gradient = layout%has_response_gradient
      self%has_noise = layout%has_noise
      self%has_noise_spectrum = layout%has_noise_spectrum
      self%has_one_tone = size(layout%tuples, 1) == 1
      self%has_surfaces = size(layout%n_samples) > 0
      self%n_multipliers = layout%n_multipliers
      self%n_curve_unknowns = layout%n_curve_unknowns
      self%has_curve = allocated(layout%curve_parameter)
      self%curve_units = ""
      if (allocated(layout%curve_units)) self%curve_units = layout%curve_units
      if (self%has_curve) self%curve_path = layout%curve_parameter
      if (self%has_curve) self%curve_column = identifier(layout%curve_parameter)
      call list_axes(self, layout)
      allocate (self%columns(first_capacity))
      call time_columns(self)
      self%times = self%columns(:self%i)
      self%i = 0
      self%row_axis = 1
      self%describes = .true.
      call all_columns(self, motion_result_t())
      self%describes = .false.
      self%columns = self%columns(:self%i)
   end subroutine new_plan

   !> Stores the results of a motion in a row of the buffers, and missing values for unknown ones.
   subroutine plan_store_row(self, row, motion, error)
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
   end subroutine plan_store_row

   !> A column of integers: lists it, or stores the values of the row in its buffer.
   subroutine plan_integer(self, name, units, axes, long_name, values, flags, lowest)
      class(plan_t), intent(inout) :: self
      character(*), intent(in) :: name, units, axes, long_name
      integer, intent(in), contiguous, optional :: values(..)
      character(*), intent(in), optional :: flags(:)
      integer, intent(in), optional :: lowest

      if (.not. begins(self, is_integer, name, units, axes, long_name)) return
      associate (column => self%columns(self%i))
         if (present(flags) .and. self%row == 0) then
            column%flags = join(flags, " ")
            column%n_flags = size(flags)
            if (present(lowest)) column%lowest_flag = lowest
         end if
         if (self%row == 0) return
         if (present(values)) then
            call column%held%store(self%row, values, self%error)
         else
            call column%held%blank(self%row)
         end if
      end associate
      if (allocated(self%error)) call annotate(self%error, "'"//name//"'")
   end subroutine plan_integer

   !> An attribute of the column that was listed last.
   subroutine plan_attribute(self, name, text)
      class(plan_t), intent(inout) :: self
      character(*), intent(in) :: name, text

      associate (column => self%columns(self%i))
         if (.not. allocated(column%attributes)) allocate (column%attributes(0))
         column%attributes = [column%attributes, attribute_t(name, text)]
      end associate
   end subroutine plan_attribute

   !> A column of real numbers.
   subroutine plan_real(self, name, units, axes, long_name, values)
      class(plan_t), intent(inout) :: self
      character(*), intent(in) :: name, units, axes, long_name
      real(wp), intent(in), contiguous, optional :: values(..)

      if (.not. begins(self, is_real, name, units, axes, long_name) .or. self%row == 0) return
      associate (held => self%columns(self%i)%held)
         if (present(values)) then
            call held%store(self%row, values, self%error)
         else
            call held%store_none(self%row, self%error)
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
         if (present(value)) call held%store(self%row, shortened(value, message_length), self%error)
      end associate
   end subroutine plan_text

   !> Proceeds to the next column, and lists it unless a row is filled. False if there is no value to store.
   logical function begins(self, kind, name, units, shape, long_name)
      class(plan_t), intent(inout) :: self
      integer, intent(in) :: kind
      character(*), intent(in) :: name, units, shape, long_name

      begins = self%is_there .and. .not. allocated(self%error)
      if (.not. begins) return
      self%i = self%i + 1
      if (self%i > size(self%columns)) call enlarge(self%columns)
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
         call self%find_axes(shape, column%axes)
         call self%find_units(units, column%axes, column%units, column%dof_units)
         column%is_checked = all(name /= ["checksum", "branch  ", "rank    "]) .and. index(name, "integration_") /= 1 .and. &
            index(name, "_seconds") == 0
         column%is_part_used = self%has_own_tuples .and. (index(shape, "harmonic") > 0 .or. shape == "curve_unknown")
      end associate
   end function begins

   !> Doubles the capacity of a list of columns.
   subroutine enlarge(columns)
      type(column_t), allocatable, intent(inout) :: columns(:)
      type(column_t), allocatable :: larger(:)

      allocate (larger(2*size(columns)))
      larger(:size(columns)) = columns
      call move_alloc(larger, columns)
   end subroutine enlarge

   !> Index of a column, 0 if the file has none of this name.
   pure integer function plan_index_of(self, name) result(i)
      class(plan_t), intent(in) :: self
      character(*), intent(in) :: name

      do i = size(self%columns), 1, -1
         if (self%columns(i)%name == name) return
      end do
   end function plan_index_of

   !> Extents of a column, fastest first; all but the last are those of a row.
   pure function plan_extents_of(self, column) result(extents)
      class(plan_t), intent(in) :: self
      type(column_t), intent(in) :: column
      integer :: extents(size(column%axes))

      extents = self%axes(column%axes)%length
   end function plan_extents_of

   !> Size of one point in the file, including swept parameters, and the number of datasets to which it is written
   !> when solved.
   pure subroutine measure_row(plan, n_parameters, n_bytes, n_datasets)
      type(plan_t), intent(in) :: plan
      integer, intent(in) :: n_parameters
      real(wp), intent(out) :: n_bytes
      integer, intent(out) :: n_datasets
      integer :: i

      n_datasets = size(plan%columns)
      n_bytes = bytes_of_kind(is_integer) + real(bytes_of_kind(is_real), wp)*n_parameters
      do i = 1, size(plan%columns)
         n_bytes = n_bytes + bytes_of_row(plan, plan%columns(i))
      end do
   end subroutine measure_row

   !> Bytes of a row of one column.
   pure integer(int64) function bytes_of_row(plan, column) result(n_bytes)
      type(plan_t), intent(in) :: plan
      type(column_t), intent(in) :: column

      n_bytes = bytes_of_kind(column%kind)*product(int(plan%axes(column%axes(:size(column%axes) - 1))%length, int64))
   end function bytes_of_row

   !> Name of the dataset with the entries of all tuples for one tone, from 1.
   pure function tuple_entry_name(tone) result(name)
      integer, intent(in) :: tone
      character(:), allocatable :: name

      name = "tuple_"//to_text(tone)
   end function tuple_entry_name
end module hb_result_columns
