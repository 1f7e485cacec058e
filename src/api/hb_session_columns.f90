!> Columns of the last result of a session by their names, as in a result file, and the labels along their axes.
module hb_session_columns
   use hb_column_table, only: column_table_t
   use hb_column_units, only: columns_with_units_t
   use hb_column_view, only: column_view_t
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   use hb_parameter_path, only: identifier
   use hb_record_columns, only: record_columns
   use hb_session, only: session_t
   use hb_stability, only: n_multipliers_of, stability_method
   use hb_structure_load, only: is_random
   use hb_text, only: to_text
   use hb_verdict_columns, only: verdict_columns
   implicit none
   private
   public :: labels_along, session_columns_t, session_table_t

   !> The column that was found last.
   type, extends(column_view_t) :: session_columns_t
   contains
      procedure :: find_of_motion => session_columns_find_of_motion
      procedure :: find_in_time => session_columns_find_in_time
   end type session_columns_t

   !> Several motions of a session.
   type, extends(column_table_t) :: session_table_t
      integer, private :: declared_for = -1                           ! structure of the session, to which units and labels belong
   contains
      procedure :: add_motion => session_table_add_motion
   end type session_table_t

contains

   !> Finds a column of the last motion. Fails for an unknown name.
   subroutine session_columns_find_of_motion(self, session, name, error)
      class(session_columns_t), intent(inout) :: self
      type(session_t), intent(in) :: session
      character(*), intent(in) :: name                                !! empty: `names` are listed
      type(error_t), allocatable, intent(out) :: error

      call session%check_model(error)
      if (allocated(error)) return
      call prepare(self, session)
      call self%find(name, session%result, size(session%source%model%options%accuracy%outputs), error)
   end subroutine session_columns_find_of_motion

   !> Adds the last motion of a session as a row.
   subroutine session_table_add_motion(self, session, error)
      class(session_table_t), intent(inout) :: self
      type(session_t), intent(in) :: session
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: lengths(:)
      integer :: i

      call session%check_model(error)
      if (allocated(error)) return
      if (self%n_rows == 0 .and. self%declared_for /= session%structure_number) then
         call self%redeclare()
         self%declared_for = session%structure_number
      end if
      call prepare(self, session)
      self%has_outputs = size(session%source%model%options%accuracy%outputs) > 0
      allocate (lengths(0))
      if (allocated(self%axes)) lengths = self%axes%length
      call self%add(session%result)
      do i = 1, size(self%axes)
         if (i <= size(lengths)) then
            if (self%axes(i)%length == lengths(i)) cycle
         end if
         if (self%n_rows == 1 .and. allocated(self%axes(i)%labels)) cycle   ! those of the structure
         self%axes(i)%labels = labels_along(session, self%axes(i)%name)
         if (self%n_rows == 1 .or. size(self%axes(i)%labels) == 0) cycle
         self%declaration = self%declaration + 1
         self%declared_for = -1                                       ! the next table has labels of its own
      end do
   end subroutine session_table_add_motion

   !> Sets which columns the motions of a session have, and their units.
   subroutine prepare(self, session)
      class(columns_with_units_t), intent(inout) :: self
      type(session_t), intent(in) :: session

      call find_units(self, session)
      self%n_multipliers = n_multipliers_stored(session)
      self%has_branch = session%sweep%is_begun
      associate (options => session%source%model%options)
         self%has_accuracy = options%accuracy%is_on
         self%has_own_tuples = .true.
         self%has_improved = options%error_estimate%improvement_steps > 0
         self%has_surfaces = size(options%output%samples) > 0
         self%has_noise = any(is_random(session%source%model%system%loads))
         self%has_noise_spectrum = options%stability%noise_frequency >= 0.0_wp
         self%has_gradient = size(options%gradient%by) > 0
         self%has_response_gradient = allocated(options%gradient%of)
         if (allocated(session%result%curve)) then
            self%curve_path = session%plan%path
            self%curve_column = identifier(session%plan%path)
            self%curve_units = session%plan%units
         end if
      end associate
   end subroutine prepare

   !> Finds a column of the record, or of the verdict if `verify` was called last. Fails for an unknown name.
   subroutine session_columns_find_in_time(self, session, name, error)
      class(session_columns_t), intent(inout) :: self
      type(session_t), intent(in) :: session
      character(*), intent(in) :: name                                !! empty: `names` are listed
      type(error_t), allocatable, intent(out) :: error

      if (.not. session%has_time_results()) then
         call fail(error, "there are no results of a time integration; integrate or verify before")
         return
      end if
      call find_units(self, session)
      call self%begin(name)
      if (allocated(session%record)) then
         call record_columns(self, session%record, session%source%model%discretisation%harmonics%tuples)
      else
         call verdict_columns(self, session%verdict)
      end if
      call self%reject_unknown(error)
   end subroutine session_columns_find_in_time

   !> Finds the units of degrees of freedom, once for a structure.
   subroutine find_units(self, session)
      class(columns_with_units_t), intent(inout) :: self
      type(session_t), intent(in) :: session

      if (self%structure_number /= session%structure_number .and. allocated(self%units_of_dof)) deallocate (self%units_of_dof)
      self%structure_number = session%structure_number
      if (allocated(self%units_of_dof) .or. .not. session%source%model%is_read) return
      associate (structure => session%source%model%system%structure)
         self%units_of_dof = [character(16) :: structure%units(session%source%model%options%output%dofs)]
         self%units_of_law_dof = [character(16) :: structure%units(session%source%model%system%dofs_of_unknowns())]
         self%units_of_state_dof = [character(16) :: structure%units]
      end associate
   end subroutine find_units

   !> Length of the axis `multiplier`, 0 without stability.
   integer function n_multipliers_stored(session) result(n)
      type(session_t), intent(in) :: session

      n = 0
      associate (model => session%source%model)
         if (model%options%stability%method /= stability_method%off) n = n_multipliers_of(model%system%structure, model%system%laws)
      end associate
   end function n_multipliers_stored

   !> Labels of the degrees of freedom along the axes `dof`, `law_dof` and `state_dof`, of the laws along `law`, of
   !> their coordinates in a record, and numbers from 0 along `multiplier`; none for other axes.
   function labels_along(session, axis) result(labels)
      type(session_t), intent(in) :: session
      character(*), intent(in) :: axis
      character(64), allocatable :: labels(:)
      integer :: i

      labels = [character(64) ::]
      if (.not. session%source%model%is_read) return
      if (axis == "law_coordinate" .and. allocated(session%record)) then
         labels = session%record%system%laws%coordinate_labels()
         return
      end if
      associate (system => session%source%model%system, options => session%source%model%options)
         select case (axis)
         case ("dof"); labels = [character(64) :: system%structure%labels(options%output%dofs)]
         case ("law_dof"); labels = [character(64) :: system%structure%labels(session%source%model%system%dofs_of_unknowns())]
         case ("gradient_value"); labels = options%gradient%names
         case ("law"); labels = [(adjustl([character(64) :: system%laws(i)%law%label]), i=1, size(system%laws))]
         case ("multiplier"); labels = [(adjustl([character(64) :: to_text(i)]), i=0, n_multipliers_stored(session) - 1)]
         case ("state_dof"); labels = [character(64) :: system%structure%labels]
         end select
      end associate
   end function labels_along
end module hb_session_columns
