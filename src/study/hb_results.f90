!> The result file of a run: the only writer of the schema in docs/schema.md.
!>
!> In the order of use: fill a `results_layout_t`, `create_results`, then `write_point` by any rank for any
!> point, then `close`. The file is made whole before the first point is solved; after that only raw data are
!> written in place, the status of a point last, so that a killed run leaves a sound file in which a status
!> other than 0 means complete.
module hb_results
   use, intrinsic :: iso_c_binding, only: c_char, c_int, c_long, c_null_char, c_null_ptr, c_ptr, c_size_t
   use, intrinsic :: iso_fortran_env, only: int64
   use hb_certificate, only: certificate_t
   use hb_error, only: annotate, error_t, fail
   use hb_hdf5, only: create_file, h5_dataset_t, h5_file_t, open_file_parallel
   use hb_kinds, only: two_pi, wp
   use hb_mpi, only: comm_t, rank_of, share_error
   use hb_outcome, only: outcome, outcome_names
   use hb_solver_types, only: rescue_names
   use hb_text, only: to_text
   implicit none
   private
   public :: create_results, point_result_t, results_layout_t, results_t, swept_parameter_t

   integer, parameter :: schema_version = 1
   integer, parameter :: message_length = 200          ! bytes
   integer, parameter :: name_length = 256             ! more than any path of an input has
   character(*), parameter :: amplitude_convention = "x(t) = sum over harmonics h of "// &
      "[ cos_h cos(j_h . omega t) + sin_h sin(j_h . omega t) ], j_h = tuple[h, :]"

   !> One swept input parameter with its value at every point.
   type :: swept_parameter_t
      character(:), allocatable :: path                 !! in the input, for example `law(1)%gap`
      character(:), allocatable :: units                !! of the input
      logical :: is_text = .false.                      !! which of the next two holds the values
      real(wp), allocatable :: values(:)                !! (n_points)
      character(64), allocatable :: text_values(:)      !! (n_points)
   end type swept_parameter_t

   !> All that is known before the first point is solved; the same on all ranks.
   type :: results_layout_t
      integer :: n_points = 0
      integer, allocatable :: tuples(:, :)              !! (n_tones, n_harmonics), the union over all points
      character(16), allocatable :: dof_labels(:), dof_units(:) !! stored degrees of freedom; `m`, `rad`
      character(16), allocatable :: law_dof_labels(:), law_dof_units(:) !! those on which laws act
      character(64), allocatable :: law_labels(:)       !! of the laws, unique
      integer, allocatable :: n_samples(:)              !! grid per tone; size 0: no surfaces are stored
      type(swept_parameter_t), allocatable :: parameters(:)
      character(:), allocatable :: title
      character(:), allocatable :: input_text           !! the input as given
      character(:), allocatable :: input_complete       !! the input after defaults
      integer :: n_ranks = 1
      character(:), allocatable :: program_version
      character(:), allocatable :: git_commit
   end type results_layout_t

   !> The result of one point. What is not allocated stays NaN in the file.
   type :: point_result_t
      integer :: status = outcome%pending               !! hb_outcome
      character(:), allocatable :: message              !! why the point failed; cut to 200 bytes
      integer :: iterations = 0
      integer :: evaluations = 0                        !! of the residual
      integer :: rescue = 0                                           !! what the solver needed, hb_solver_types
      real(wp) :: residual = 0.0_wp                     !! relative to the scale of the forces
      real(wp) :: solve_seconds = 0.0_wp
      integer :: rank = 0                               !! that solved it
      integer :: n_harmonics = 0                        !! in the set of this point
      real(wp), allocatable :: frequency(:)             !! [rad/s], (n_tones)
      real(wp), allocatable :: coefficients(:, :, :)    !! (cos and sin, n_harmonics, n_dofs)
      real(wp), allocatable :: force_coefficients(:, :, :) !! [N], (cos and sin, n_harmonics, n_law_dofs)
      real(wp), allocatable :: corrected_coefficients(:, :, :) !! (cos and sin, n_harmonics, n_law_dofs)
      integer :: n_full_stick = 0                       !! friction laws that slip nowhere: one of many solutions
      type(certificate_t) :: certificate                !! zero and without combination where none was made
      logical :: is_near_commensurate = .false.
      real(wp), allocatable :: displacement_samples(:, :) !! (n_samples_total, n_law_dofs), tone 1 fastest
      real(wp), allocatable :: corrected_samples(:, :)  !! same
      real(wp), allocatable :: force_samples(:, :)      !! [N], same
   end type point_result_t

   !> A dimension of the file.
   type :: axis_t
      character(:), allocatable :: name, long_name, units
      integer :: length = 0
      type(h5_dataset_t) :: scale
   end type axis_t

   !> A dataset of the file that has one row per point.
   type :: variable_t
      character(:), allocatable :: name, long_name, units
      integer :: kind = 0                               ! one of the three below
      integer, allocatable :: axes(:)                   ! indices of axes, fastest first
      character(:), allocatable :: dof_units            ! of each degree of freedom, where they are an axis
      type(h5_dataset_t) :: dataset
   end type variable_t

   !> What the file consists of, besides swept parameters and texts.
   type :: plan_t
      type(axis_t), allocatable :: axes(:)
      type(variable_t), allocatable :: variables(:)
   end type plan_t

   integer, parameter :: is_integer = 1, is_real = 2, is_characters = 3
   ! Indices of the axes; the hypertime axes follow.
   integer, parameter :: point_axis = 1, tone_axis = 2, harmonic_axis = 3, dof_axis = 4, law_dof_axis = 5, &
      component_axis = 6, message_axis = 7, law_axis = 8, n_plain_axes = 8

   !> An open result file.
   type :: results_t
      private
      type(h5_file_t) :: file
      character(:), allocatable :: path
      type(plan_t) :: plan
      integer :: n_points = 0
   contains
      procedure :: close => results_close
      procedure :: write_point => results_write_point
   end type results_t

   !> Writes the row of one point; does nothing once there is an error, so that a point reads as a plain list.
   interface put
      module procedure put_integer
      module procedure put_real
   end interface put

   interface
      !> Gives a file a second name; unlike rename it fails where the name is taken.
      integer(c_int) function c_link(old, new) bind(c, name="link")
         import :: c_char, c_int
         character(c_char), intent(in) :: old(*), new(*)
      end function c_link

      integer(c_int) function c_rename(old, new) bind(c, name="rename")
         import :: c_char, c_int
         character(c_char), intent(in) :: old(*), new(*)
      end function c_rename

      integer(c_int) function c_unlink(path) bind(c, name="unlink")
         import :: c_char, c_int
         character(c_char), intent(in) :: path(*)
      end function c_unlink

      integer(c_int) function c_getpid() bind(c, name="getpid")
         import :: c_int
      end function c_getpid

      integer(c_long) function c_time(seconds) bind(c, name="time")
         import :: c_long, c_ptr
         type(c_ptr), value :: seconds
      end function c_time

      type(c_ptr) function c_gmtime(seconds) bind(c, name="gmtime")
         import :: c_long, c_ptr
         integer(c_long), intent(in) :: seconds
      end function c_gmtime

      integer(c_size_t) function c_strftime(text, max_length, format, moment) bind(c, name="strftime")
         import :: c_char, c_ptr, c_size_t
         character(c_char), intent(out) :: text(*)
         integer(c_size_t), value :: max_length
         character(c_char), intent(in) :: format(*)
         type(c_ptr), value :: moment
      end function c_strftime
   end interface

contains

   !> Makes the result file and opens it on all ranks; collective, and an error is the same on all ranks.
   !>
   !> An existing file is an error unless `overwrite` is true. It is replaced only when the new file is
   !> complete: that is made under another name in the same folder.
   subroutine create_results(self, path, layout, overwrite, comm, error)
      type(results_t), intent(out) :: self
      character(*), intent(in) :: path
      type(results_layout_t), intent(in) :: layout
      logical, intent(in) :: overwrite
      type(comm_t), intent(in) :: comm
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      self%path = path
      call check_layout(layout, error)
      if (.not. allocated(error)) then
         self%n_points = layout%n_points
         call new_plan(self%plan, layout)
         if (rank_of(comm) == 0) call make_file(path, layout, self%plan, overwrite, error)
      end if
      call share_error(comm, error)
      if (.not. allocated(error)) then
         call open_file_parallel(self%file, path, comm, error)
         call share_error(comm, error)
      end if
      if (.not. allocated(error)) then
         do i = 1, size(self%plan%variables)
            associate (variable => self%plan%variables(i))
               call self%file%open_dataset(variable%name, variable%dataset, error)
            end associate
            if (allocated(error)) exit
         end do
         call share_error(comm, error)
      end if
      call annotate(error, "result file '"//path//"'")
   end subroutine create_results

   !> Writes the result of point `i`, from 1, the status last; any rank may write any point at any time.
   subroutine results_write_point(self, i, point, error)
      class(results_t), intent(inout) :: self
      integer, intent(in) :: i
      type(point_result_t), intent(in) :: point
      type(error_t), allocatable, intent(out) :: error

      if (i < 1 .or. i > self%n_points) then
         call fail(error, "result file '"//self%path//"': no point "//to_text(i)//", there are "// &
                   to_text(self%n_points))
         return
      end if
      call put_message(self, i, or_empty(point%message), error)
      call put(self, "iterations", i, [point%iterations], error)
      call put(self, "rescue", i, [point%rescue], error)
      call put(self, "evaluations", i, [point%evaluations], error)
      call put(self, "residual", i, [point%residual], error)
      call put(self, "solve_seconds", i, [point%solve_seconds], error)
      call put(self, "rank", i, [point%rank], error)
      call put(self, "n_harmonics", i, [point%n_harmonics], error)
      call put(self, "n_full_stick", i, [point%n_full_stick], error)
      if (allocated(point%frequency)) call put(self, "frequency", i, point%frequency, error)
      if (allocated(point%coefficients)) call put(self, "coefficients", i, point%coefficients, error)
      if (allocated(point%force_coefficients)) call put(self, "force_coefficients", i, point%force_coefficients, error)
      if (allocated(point%corrected_coefficients)) call put(self, "corrected_coefficients", i, point%corrected_coefficients, error)
      if (allocated(point%certificate%combination)) call put_certificate(self, i, point, error)
      if (allocated(point%displacement_samples)) call put(self, "displacement_samples", i, point%displacement_samples, error)
      if (allocated(point%corrected_samples)) call put(self, "corrected_samples", i, point%corrected_samples, error)
      if (allocated(point%force_samples)) call put(self, "force_samples", i, point%force_samples, error)
      call put(self, "status", i, [point%status], error)
      call annotate(error, "point "//to_text(i))
   end subroutine results_write_point

   subroutine put_certificate(self, i, point, error)
      class(results_t), intent(inout) :: self
      integer, intent(in) :: i
      type(point_result_t), intent(in) :: point
      type(error_t), allocatable, intent(inout) :: error

      associate (found => point%certificate)
         call put(self, "truncation_estimate", i, [found%truncation], error)
         call put(self, "aliasing_estimate", i, [found%aliasing], error)
         call put(self, "penetration", i, [found%defects%penetration], error)
         call put(self, "tension", i, [found%defects%tension], error)
         call put(self, "complementarity", i, [found%defects%complementarity], error)
         call put(self, "slip_defect", i, [found%defects%slip], error)
         call put(self, "power_in", i, [found%power_in], error)
         call put(self, "power_damping", i, [found%power_damping], error)
         call put(self, "power_laws", i, found%power_laws, error)
         call put(self, "combination_frequency", i, [found%combination_frequency], error)
         call put(self, "combination", i, found%combination, error)
         call put(self, "is_near_commensurate", i, [merge(1, 0, point%is_near_commensurate)], error)
      end associate
   end subroutine put_certificate

   !> Closes the file; collective, safe to call twice.
   subroutine results_close(self, error)
      class(results_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error

      call self%file%close(error)
      call annotate(error, "result file '"//self%path//"'")
   end subroutine results_close

   subroutine put_integer(self, name, i, values, error)
      class(results_t), intent(inout) :: self
      character(*), intent(in) :: name
      integer, intent(in) :: i
      integer, intent(in), contiguous :: values(:)
      type(error_t), allocatable, intent(inout) :: error

      if (allocated(error)) return
      call self%plan%variables(index_of(self, name))%dataset%write_row(i, values, error)
   end subroutine put_integer

   subroutine put_real(self, name, i, values, error)
      class(results_t), intent(inout) :: self
      character(*), intent(in) :: name
      integer, intent(in) :: i
      real(wp), intent(in), contiguous :: values(..)
      type(error_t), allocatable, intent(inout) :: error
      integer :: j

      if (allocated(error)) return
      j = index_of(self, name)
      if (j == 0) then
         call fail(error, "'"//name//"' given, but the layout has no grid for surfaces")
         return
      end if
      call self%plan%variables(j)%dataset%write_row(i, values, error)
   end subroutine put_real

   subroutine put_message(self, i, message, error)
      class(results_t), intent(inout) :: self
      integer, intent(in) :: i
      character(*), intent(in) :: message
      type(error_t), allocatable, intent(inout) :: error

      if (allocated(error)) return
      associate (text => message(:whole_length(message, message_length)))
         call self%plan%variables(index_of(self, "message"))%dataset%write_row(i, text, error)
      end associate
   end subroutine put_message

   !> Gives the index of the variable called `name`, 0 when the file has none.
   pure integer function index_of(self, name)
      class(results_t), intent(in) :: self
      character(*), intent(in) :: name

      do index_of = size(self%plan%variables), 1, -1
         if (self%plan%variables(index_of)%name == name) return
      end do
   end function index_of

   ! What stands in the file

   subroutine new_plan(self, layout)
      type(plan_t), intent(out) :: self
      type(results_layout_t), intent(in) :: layout

      call list_axes(layout, self%axes)
      call list_variables(layout, self%variables)
   end subroutine new_plan

   !> Lists all datasets that have one row per point and are written when it is solved.
   subroutine list_variables(layout, list)
      type(results_layout_t), intent(in) :: layout
      type(variable_t), allocatable, intent(out) :: list(:)
      integer :: taus(size(layout%n_samples)), i, n_listed

      n_listed = 0
      allocate (list(0))
      call add_all()                                                   ! counts
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
         call add("rank", is_integer, [point_axis], "1", "MPI rank that solved the point")
         call add("n_harmonics", is_integer, [point_axis], "1", "number of harmonics in the set of the point")
         call add("n_full_stick", is_integer, [point_axis], "1", &
            "friction laws that slip nowhere: the solution from rest, one of many")
         call add("frequency", is_real, [tone_axis, point_axis], "rad/s", "base frequencies")
         call add("coefficients", is_real, [component_axis, harmonic_axis, dof_axis, point_axis], "", &
            "coefficients of the motion", layout%dof_units)
         call add("force_coefficients", is_real, [component_axis, harmonic_axis, law_dof_axis, point_axis], "", &
            "coefficients of the force of the laws, on the left-hand side", force_units(layout%law_dof_units))
         call add("corrected_coefficients", is_real, [component_axis, harmonic_axis, law_dof_axis, point_axis], &
            "", "coefficients of the displacement corrected to the wall", layout%law_dof_units)
         call add("truncation_estimate", is_real, [point_axis], "1", &
            "estimated error by the harmonics left out, relative to the motion")
         call add("aliasing_estimate", is_real, [point_axis], "1", &
            "estimated error by the finite number of samples, relative to the motion")
         call add("penetration", is_real, [point_axis], "m", "largest penetration into a rigid wall")
         call add("tension", is_real, [point_axis], "N", "largest pull that a rigid wall would have to exert")
         call add("complementarity", is_real, [point_axis], "N m", "largest product of reaction and gap of a rigid wall")
         call add("slip_defect", is_real, [point_axis], "W", &
            "largest power that exact friction would take beyond the reaction of rigid friction")
         call add("power_in", is_real, [point_axis], "W", "mean power of the loads")
         call add("power_damping", is_real, [point_axis], "W", "mean loss in the damping of the structure")
         call add("power_laws", is_real, [law_axis, point_axis], "W", "mean loss in each law")
         call add("combination_frequency", is_real, [point_axis], "rad/s", "smallest |k.omega| of low order")
         call add("combination", is_integer, [tone_axis, point_axis], "1", "integers k of combination_frequency")
         call add("is_near_commensurate", is_integer, [point_axis], "1", &
            "1 where combination_frequency is below the threshold: the tones are hard to tell from commensurate ones")
         if (size(taus) == 0) return
         taus = [(n_plain_axes + i, i=1, size(taus))]
         call add("displacement_samples", is_real, [taus, law_dof_axis, point_axis], "", &
            "hypertime surface of the motion", layout%law_dof_units)
         call add("corrected_samples", is_real, [taus, law_dof_axis, point_axis], "", &
            "hypertime surface corrected to the wall", layout%law_dof_units)
         call add("force_samples", is_real, [taus, law_dof_axis, point_axis], "", &
            "hypertime surface of the force", force_units(layout%law_dof_units))
      end subroutine add_all

      subroutine add(name, kind, axes, units, long_name, units_by_dof)
         character(*), intent(in) :: name
         integer, intent(in) :: kind, axes(:)
         character(*), intent(in) :: units, long_name
         character(*), intent(in), optional :: units_by_dof(:)        !! replaces `units`

         n_listed = n_listed + 1
         if (n_listed > size(list)) return
         associate (new => list(n_listed))
            new%name = name
            new%kind = kind
            new%axes = axes
            new%units = units
            new%long_name = long_name
            if (present(units_by_dof)) then
               new%units = common_units(units_by_dof)
               new%dof_units = joined(units_by_dof)
            end if
         end associate
      end subroutine add
   end subroutine list_variables

   !> Lists all dimensions of the file, in the order of the axis indices.
   subroutine list_axes(layout, axes)
      type(results_layout_t), intent(in) :: layout
      type(axis_t), allocatable, intent(out) :: axes(:)
      integer :: i

      allocate (axes(n_plain_axes + size(layout%n_samples)))
      call set(point_axis, "point", layout%n_points, "1", "number of the sweep point, from 0")
      call set(tone_axis, "tone", size(layout%tuples, 1), "1", "number of the tone, from 1")
      call set(harmonic_axis, "harmonic", size(layout%tuples, 2), "1", "number of the harmonic, from 0")
      call set(dof_axis, "dof", size(layout%dof_labels), "1", "stored degree of freedom")
      call set(law_dof_axis, "law_dof", size(layout%law_dof_labels), "1", &
         "degree of freedom on which laws act")
      call set(component_axis, "component", 2, "1", "part of a coefficient")
      call set(law_axis, "law", size(layout%law_labels), "1", "law, by its label")
      call set(message_axis, "message_byte", message_length, "1", "byte of a message")
      do i = 1, size(layout%n_samples)
         call set(n_plain_axes + i, "tau_"//to_text(i), layout%n_samples(i), "rad", &
            "hypertime of tone "//to_text(i))
      end do
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
      character(name_length) :: names(size(layout%parameters))
      character(name_length), allocatable :: taken(:)
      character(:), allocatable :: stem
      integer :: i, n

      allocate (taken, source=[character(name_length) :: "tuple", "input_text", "input_complete"])
      do i = 1, size(plan%axes)
         taken = [character(name_length) :: taken, plan%axes(i)%name]
      end do
      do i = 1, size(plan%variables)
         taken = [character(name_length) :: taken, plan%variables(i)%name]
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
         taken = [character(name_length) :: taken, names(i)]
      end do
   end function parameter_names

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

   !> Refuses a layout with parts that are missing or do not fit each other.
   subroutine check_layout(layout, error)
      type(results_layout_t), intent(in) :: layout
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      if (.not. (allocated(layout%tuples) .and. allocated(layout%dof_labels) .and. &
                 allocated(layout%dof_units) .and. allocated(layout%law_dof_labels) .and. &
                 allocated(layout%law_labels) .and. &
                 allocated(layout%law_dof_units) .and. allocated(layout%n_samples) .and. &
                 allocated(layout%parameters))) then
         call fail(error, "layout: an array is not allocated")
      else if (layout%n_points < 1 .or. size(layout%tuples) < 1) then
         call fail(error, "layout: at least one point, one tone and one harmonic are needed")
      else if (size(layout%dof_units) /= size(layout%dof_labels) .or. &
               size(layout%law_dof_units) /= size(layout%law_dof_labels)) then
         call fail(error, "layout: labels and units of the degrees of freedom differ in number")
      else if (all(size(layout%n_samples) /= [0, size(layout%tuples, 1)]) .or. any(layout%n_samples < 1)) then
         call fail(error, "layout: the grid of surfaces needs a positive size for each tone, or no size")
      else
         do i = 1, size(layout%parameters)
            call check_parameter(layout%parameters(i), layout%n_points, error)
            if (allocated(error)) return
         end do
      end if
   end subroutine check_layout

   subroutine check_parameter(parameter, n_points, error)
      type(swept_parameter_t), intent(in) :: parameter
      integer, intent(in) :: n_points
      type(error_t), allocatable, intent(out) :: error
      integer :: n_values

      if (.not. allocated(parameter%path)) then
         call fail(error, "layout: a swept parameter has no path")
         return
      end if
      n_values = 0
      if (parameter%is_text .and. allocated(parameter%text_values)) n_values = size(parameter%text_values)
      if (.not. parameter%is_text .and. allocated(parameter%values)) n_values = size(parameter%values)
      if (n_values /= n_points) call fail(error, "layout: swept parameter '"//parameter%path//"' has "// &
                                          to_text(n_values)//" values for "//to_text(n_points)//" points")
   end subroutine check_parameter

   ! Making the file; one process

   !> Makes the whole file under another name beside `path`, then puts it in its place.
   subroutine make_file(path, layout, plan, overwrite, error)
      character(*), intent(in) :: path
      type(results_layout_t), intent(in) :: layout
      type(plan_t), intent(inout) :: plan
      logical, intent(in) :: overwrite
      type(error_t), allocatable, intent(out) :: error
      character(:), allocatable :: folder, temporary
      integer :: ignored

      folder = path(:index(path, "/", back=.true.))
      if (folder == "") folder = "./"
      if (.not. exists(folder//".")) then
         call fail(error, "folder '"//folder//"' does not exist; make it or give another --output")
      else if (exists(path//"/.")) then
         call fail(error, "is a folder; give another --output")
      else if (exists(path) .and. .not. overwrite) then
         call fail(error, "exists; give --overwrite or another --output")
      end if
      if (allocated(error)) return

      temporary = path//"."//to_text(int(c_getpid()))//".part"
      call fill_file(temporary, layout, plan, error)
      if (allocated(error)) then
         error%message = "cannot be made; check permission and space ("//size_text(plan)// &
            ") or give another --output: "//error%message
      else
         call put_in_place(temporary, path, overwrite, error)
      end if
      if (allocated(error)) ignored = c_unlink(c_path(temporary))
   end subroutine make_file

   subroutine put_in_place(temporary, path, overwrite, error)
      character(*), intent(in) :: temporary, path
      logical, intent(in) :: overwrite
      type(error_t), allocatable, intent(out) :: error
      integer :: ignored

      if (.not. overwrite) then
         ! another run may have made the file meanwhile: link refuses then, and rename would not
         if (c_link(c_path(temporary), c_path(path)) == 0) then
            ignored = c_unlink(c_path(temporary))
            return
         end if
         if (exists(path)) then
            call fail(error, "exists; give --overwrite or another --output")
            return
         end if
         ! a file system without links: rename after all
      end if
      if (c_rename(c_path(temporary), c_path(path)) /= 0) &
         call fail(error, "'"//temporary//"' cannot be renamed to it; give another --output")
   end subroutine put_in_place

   subroutine fill_file(path, layout, plan, error)
      character(*), intent(in) :: path
      type(results_layout_t), intent(in) :: layout
      type(plan_t), intent(inout) :: plan
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: error_in_close
      type(h5_file_t) :: file

      call create_file(file, path, .true., error)
      if (.not. allocated(error)) call add_root_attributes(file, layout, error)
      if (.not. allocated(error)) call add_scales(file, layout, plan%axes, error)
      if (.not. allocated(error)) call add_inputs(file, layout, plan, error)
      if (.not. allocated(error)) call add_point_variables(file, plan, error)
      call file%close(error_in_close)
      if (.not. allocated(error)) call move_alloc(error_in_close, error)
   end subroutine fill_file

   subroutine add_root_attributes(file, layout, error)
      type(h5_file_t), intent(in) :: file
      type(results_layout_t), intent(in) :: layout
      type(error_t), allocatable, intent(out) :: error

      call file%set_attribute("schema_version", schema_version, error)
      if (.not. allocated(error)) call file%set_attribute("n_ranks", layout%n_ranks, error)
      call set_text("program_version", or_empty(layout%program_version))
      call set_text("git_commit", or_empty(layout%git_commit))
      call set_text("created_utc", utc_now())
      call set_text("title", or_empty(layout%title))
      call set_text("amplitude_convention", amplitude_convention)
   contains
      subroutine set_text(name, value)
         character(*), intent(in) :: name, value

         if (.not. allocated(error)) call file%set_attribute(name, value, error)
      end subroutine set_text
   end subroutine add_root_attributes

   subroutine add_scales(file, layout, axes, error)
      type(h5_file_t), intent(in) :: file
      type(results_layout_t), intent(in) :: layout
      type(axis_t), intent(inout) :: axes(:)
      type(error_t), allocatable, intent(out) :: error
      integer :: i, k

      do i = 1, size(axes)
         associate (axis => axes(i))
            select case (i)
            case (point_axis, harmonic_axis, message_axis)
               call add_numbers(file, axis, [(k, k=0, axis%length - 1)], error)
            case (tone_axis)
               call add_numbers(file, axis, [(k, k=1, axis%length)], error)
            case (dof_axis)
               call file%add_texts(axis%name, layout%dof_labels, axis%scale, error)
            case (law_dof_axis)
               call file%add_texts(axis%name, layout%law_dof_labels, axis%scale, error)
            case (law_axis)
               call file%add_texts(axis%name, layout%law_labels, axis%scale, error)
            case (component_axis)
               call file%add_texts(axis%name, ["cos", "sin"], axis%scale, error)
            case default
               call file%add_real(axis%name, [axis%length], axis%scale, error)
               if (.not. allocated(error)) &
                  call axis%scale%write([(two_pi*k/axis%length, k=0, axis%length - 1)], error)
            end select
            if (.not. allocated(error)) call axis%scale%make_scale(scale_name(axis, i), error)
            if (.not. allocated(error)) call describe(axis%scale, axis%units, axis%long_name, error)
         end associate
         if (allocated(error)) return
      end do
   end subroutine add_scales

   !> Gives the name that a scale keeps in the file: its own, or the words of netCDF for a dimension without
   !> coordinate.
   function scale_name(axis, i) result(name)
      type(axis_t), intent(in) :: axis
      integer, intent(in) :: i                          !! its index
      character(:), allocatable :: name
      character(64) :: words

      name = axis%name
      if (i /= message_axis) return
      write (words, "(a, i10)") "This is a netCDF dimension but not a netCDF variable.", axis%length
      name = trim(words)
   end function scale_name

   subroutine add_numbers(file, axis, numbers, error)
      type(h5_file_t), intent(in) :: file
      type(axis_t), intent(inout) :: axis
      integer, intent(in), contiguous :: numbers(:)
      type(error_t), allocatable, intent(out) :: error

      call file%add_integer(axis%name, [axis%length], axis%scale, error)
      if (.not. allocated(error)) call axis%scale%write(numbers, error)
   end subroutine add_numbers

   !> Adds what is known of the run before it starts: tuples, swept parameters, input files.
   subroutine add_inputs(file, layout, plan, error)
      type(h5_file_t), intent(in) :: file
      type(results_layout_t), intent(in) :: layout
      type(plan_t), intent(in) :: plan
      type(error_t), allocatable, intent(out) :: error
      type(h5_dataset_t) :: dataset
      character(name_length) :: names(size(layout%parameters))
      integer :: i

      call file%add_integer("tuple", shape(layout%tuples), dataset, error)
      if (.not. allocated(error)) call dataset%write(layout%tuples, error)
      if (.not. allocated(error)) call attach(dataset, plan, [tone_axis, harmonic_axis], error)
      if (.not. allocated(error)) call describe(dataset, "1", "integer tuple j of each harmonic", error)
      if (allocated(error)) return

      names = parameter_names(layout, plan)
      do i = 1, size(names)
         call add_parameter(file, trim(names(i)), layout%parameters(i), plan, error)
         if (allocated(error)) return
      end do

      call file%add_text("input_text", or_empty(layout%input_text), dataset, error)
      if (.not. allocated(error)) call describe(dataset, "1", "the input as given", error)
      if (allocated(error)) return
      call file%add_text("input_complete", or_empty(layout%input_complete), dataset, error)
      if (.not. allocated(error)) call describe(dataset, "1", "the input after defaults", error)
   end subroutine add_inputs

   subroutine add_parameter(file, name, parameter, plan, error)
      type(h5_file_t), intent(in) :: file
      character(*), intent(in) :: name
      type(swept_parameter_t), intent(in) :: parameter
      type(plan_t), intent(in) :: plan
      type(error_t), allocatable, intent(out) :: error
      type(h5_dataset_t) :: dataset

      if (parameter%is_text) then
         call file%add_texts(name, parameter%text_values, dataset, error)
      else
         call file%add_real(name, shape(parameter%values), dataset, error)
         if (.not. allocated(error)) call dataset%write(parameter%values, error)
      end if
      if (.not. allocated(error)) call attach(dataset, plan, [point_axis], error)
      if (.not. allocated(error)) &
         call describe(dataset, or_empty(parameter%units), "swept parameter "//parameter%path, error)
      if (.not. allocated(error)) call dataset%set_attribute("parameter", parameter%path, error)
   end subroutine add_parameter

   subroutine add_point_variables(file, plan, error)
      type(h5_file_t), intent(in) :: file
      type(plan_t), intent(inout) :: plan
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: extents(:)
      integer :: i

      do i = 1, size(plan%variables)
         associate (variable => plan%variables(i))
            extents = plan%axes(variable%axes)%length
            select case (variable%kind)
            case (is_integer)
               call file%add_integer(variable%name, extents, variable%dataset, error)
            case (is_real)
               call file%add_real(variable%name, extents, variable%dataset, error)
            case (is_characters)
               call file%add_characters(variable%name, extents, variable%dataset, error)
            end select
            if (.not. allocated(error)) call attach(variable%dataset, plan, variable%axes, error)
            if (.not. allocated(error)) &
               call describe(variable%dataset, variable%units, variable%long_name, error)
            if (allocated(variable%dof_units) .and. .not. allocated(error)) &
               call variable%dataset%set_attribute("dof_units", variable%dof_units, error)
            if (variable%kind == is_characters .and. .not. allocated(error)) &
               call variable%dataset%set_attribute("_Encoding", "utf-8", error)
            if (allocated(error)) return
            if (variable%name == "status") call set_flags(variable%dataset, outcome_names, error)
            if (variable%name == "rescue") call set_flags(variable%dataset, rescue_names, error)
         end associate
         if (allocated(error)) return
      end do
   end subroutine add_point_variables

   !> Names the values 0, 1, ... of an integer dataset (CF convention).
   subroutine set_flags(dataset, names, error)
      type(h5_dataset_t), intent(in) :: dataset
      character(*), intent(in) :: names(:)
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      call dataset%set_attribute("flag_values", [(k, k=0, size(names) - 1)], error)
      if (.not. allocated(error)) call dataset%set_attribute("flag_meanings", joined(names), error)
   end subroutine set_flags

   subroutine attach(dataset, plan, axes, error)
      type(h5_dataset_t), intent(in) :: dataset
      type(plan_t), intent(in) :: plan
      integer, intent(in) :: axes(:)                    !! indices, fastest first
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      do i = 1, size(axes)
         call dataset%attach_scale(i, plan%axes(axes(i))%scale, error)
         if (allocated(error)) return
      end do
   end subroutine attach

   subroutine describe(dataset, units, long_name, error)
      type(h5_dataset_t), intent(in) :: dataset
      character(*), intent(in) :: units, long_name
      type(error_t), allocatable, intent(out) :: error

      call dataset%set_attribute("units", units, error)
      if (.not. allocated(error)) call dataset%set_attribute("long_name", long_name, error)
   end subroutine describe

   ! Units and texts

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

   pure function joined(words) result(text)
      character(*), intent(in) :: words(:)
      character(:), allocatable :: text
      integer :: i

      text = ""
      do i = 1, size(words)
         text = text//" "//trim(words(i))
      end do
      text = trim(adjustl(text))
   end function joined

   !> Gives the length to which a UTF-8 text can be cut without cutting a character.
   pure integer function whole_length(text, max_length)
      character(*), intent(in) :: text
      integer, intent(in) :: max_length

      whole_length = min(len(text), max_length)
      if (whole_length == len(text)) return
      do while (whole_length > 0 .and. iand(ichar(text(whole_length + 1:whole_length + 1)), 192) == 128)
         whole_length = whole_length - 1               ! the next byte continues a character
      end do
   end function whole_length

   !> Gives the text, or an empty one where none is allocated.
   pure function or_empty(text)
      character(*), intent(in), optional :: text
      character(:), allocatable :: or_empty

      or_empty = ""
      if (present(text)) or_empty = text
   end function or_empty

   !> Gives the size of the file in words.
   function size_text(plan) result(text)
      type(plan_t), intent(in) :: plan
      character(:), allocatable :: text
      character(40) :: digits
      integer(int64) :: n_bytes
      integer, parameter :: bytes(3) = [4, 8, 1]
      integer :: i

      n_bytes = 0
      do i = 1, size(plan%variables)
         associate (variable => plan%variables(i))
            n_bytes = n_bytes + bytes(variable%kind)*product(int(plan%axes(variable%axes)%length, int64))
         end associate
      end do
      write (digits, "(f0.1)") max(0.1_wp, real(n_bytes, wp)/1.0e6_wp)
      text = trim(digits)//" MB"
      if (text(1:1) == ".") text = "0"//text
   end function size_text

   ! The operating system

   logical function exists(path)
      character(*), intent(in) :: path

      inquire (file=path, exist=exists)
   end function exists

   pure function c_path(path)
      character(*), intent(in) :: path
      character(:), allocatable :: c_path

      c_path = path//c_null_char
   end function c_path

   !> Gives the time of now in UTC, ISO 8601.
   function utc_now() result(text)
      character(:), allocatable :: text
      character(21, c_char) :: bytes
      integer(c_size_t) :: length

      length = c_strftime(bytes, len(bytes, c_size_t), "%Y-%m-%dT%H:%M:%SZ"//c_null_char, &
                          c_gmtime(c_time(c_null_ptr)))
      text = bytes(:length)
   end function utc_now
end module hb_results
