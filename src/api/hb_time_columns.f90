!> What time integration gives, by names: a record as its file has it (docs/user/schema.md), or the verdict on a motion.
module hb_time_columns
   use hb_column_view, only: column_kind, column_view_t
   use hb_error, only: error_t, fail
   use hb_integration, only: integration_t
   use hb_kinds, only: wp
   use hb_model, only: model_t
   use hb_verification, only: verdict_t
   implicit none
   private
   public :: find_record_column, find_verdict_column

contains

   !> Looks a column of a record up. Fails for a name that there is not.
   subroutine find_record_column(column, name, record, model, error)
      class(column_view_t), intent(inout) :: column
      character(*), intent(in) :: name                                !! empty: names are listed
      type(integration_t), intent(in) :: record
      type(model_t), intent(in) :: model
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      call begin(column, name)
      associate (r => record%record, assessment => record%assessment, state => record%state)
         call put(column, "time", "s", "time", shape(r%time), r%time)
         call put(column, "displacement", "m", "dof time", shape(r%displacement), [r%displacement])
         call put(column, "velocity", "m/s", "dof time", shape(r%velocity), [r%velocity])
         call put(column, "force", "N", "law_coordinate time", shape(r%force), [r%force])
         call put(column, "cpu_seconds", "s", "", [integer ::], [r%cpu_seconds])
         call put(column, "frequency", "rad/s", "tone", shape(record%omega), record%omega)
         call put_integers(column, "tuple", "harmonic tone", shape(model%harmonics%tuples), [model%harmonics%tuples])
         call put(column, "coefficients", "m", "dof harmonic component", [2, shape(assessment%coefficients)], &
                  pairs_of(assessment%coefficients))
         call put(column, "spread", "m", "dof harmonic", shape(assessment%spread), [assessment%spread])
         if (model%integration%n_peaks > 0) then
            call put(column, "peak_frequency", "rad/s", "dof peak", shape(assessment%frequencies), [assessment%frequencies])
            call put(column, "peak_coefficients", "m", "dof peak component", [2, shape(assessment%amplitudes)], &
                     pairs_of(assessment%amplitudes))
         end if
         if (allocated(record%motion)) then
            call put_integers(column, "start_motion", "start", shape(record%motion), record%motion)
            associate (n => shape(assessment%spread), motions => record%motions)
               call put(column, "motion_coefficients", "m", "motion dof harmonic component", [2, n, size(motions)], &
                        [(pairs_of(motions(i)%coefficients), i=1, size(motions))])
               call put(column, "motion_spread", "m", "motion dof harmonic", [n, size(motions)], &
                        [(motions(i)%spread, i=1, size(motions))])
            end associate
         end if
         call put(column, "state_time", "s", "", [integer ::], [state%time])
         call put(column, "state_displacement", "m", "state_dof", shape(state%q), state%q)
         call put(column, "state_velocity", "m/s", "state_dof", shape(state%v), state%v)
         if (size(state%s) > 0) call put(column, "state_slider", "m", "slider", shape(state%s), state%s)
      end associate
      call finish(column, error)
   end subroutine find_record_column

   !> Looks a column of the verdict on a motion up. Fails for a name that there is not.
   subroutine find_verdict_column(column, name, verdict, error)
      class(column_view_t), intent(inout) :: column
      character(*), intent(in) :: name                                !! empty: names are listed
      type(verdict_t), intent(in) :: verdict
      type(error_t), allocatable, intent(out) :: error

      call begin(column, name)
      call put_integers(column, "integration_verdict", "", [integer ::], [verdict%kind])
      call put(column, "integration_first_difference", "1", "", [integer ::], [verdict%first_difference])
      call put(column, "integration_difference", "1", "", [integer ::], [verdict%difference])
      call put(column, "integration_limit", "1", "", [integer ::], [verdict%limit])
      call put(column, "integration_growth", "1/s", "", [integer ::], [verdict%growth])
      call put(column, "integration_duration", "s", "", [integer ::], [verdict%duration])
      if (allocated(verdict%drift)) call put(column, "integration_drift", "rad/s", "tone", shape(verdict%drift), verdict%drift)
      call finish(column, error)
   end subroutine find_verdict_column

   subroutine begin(column, name)
      class(column_view_t), intent(inout) :: column
      character(*), intent(in) :: name

      column%name = name
      column%names = ""
      column%is_found = .false.
      column%kind = column_kind%unknown
      column%extents = [integer ::]
      column%units = "1"
      column%axes = ""
   end subroutine begin

   subroutine finish(column, error)
      class(column_view_t), intent(inout) :: column
      type(error_t), allocatable, intent(out) :: error

      if (len(column%name) > 0 .and. .not. column%is_found) &
         call fail(error, "there is no column '"//column%name//"'; known: "//column%names)
   end subroutine finish

   subroutine put(column, name, units, axes, extents, values)
      class(column_view_t), intent(inout) :: column
      character(*), intent(in) :: name, units, axes
      integer, intent(in) :: extents(:)                               !! fastest first
      real(wp), intent(in) :: values(:)

      if (.not. is_asked(column, name, units, axes)) return
      column%kind = column_kind%real
      column%extents = extents
      column%reals = values
   end subroutine put

   subroutine put_integers(column, name, axes, extents, values)
      class(column_view_t), intent(inout) :: column
      character(*), intent(in) :: name, axes
      integer, intent(in) :: extents(:), values(:)

      if (.not. is_asked(column, name, "1", axes)) return
      column%kind = column_kind%integer
      column%extents = extents
      column%integers = values
   end subroutine put_integers

   logical function is_asked(column, name, units, axes)
      class(column_view_t), intent(inout) :: column
      character(*), intent(in) :: name, units, axes

      if (len(column%names) > 0) column%names = column%names//" "
      column%names = column%names//name
      is_asked = name == column%name
      if (.not. is_asked) return
      column%is_found = .true.
      column%units = units
      column%axes = axes
   end function is_asked

   !> Cosine and sine of amplitudes c - i s, one after the other.
   pure function pairs_of(amplitudes) result(pairs)
      complex(wp), intent(in) :: amplitudes(:, :)
      real(wp) :: pairs(2*size(amplitudes))
      integer :: i, k

      do k = 1, size(amplitudes, 2)
         do i = 1, size(amplitudes, 1)
            pairs(2*(i + size(amplitudes, 1)*(k - 1)) - 1:2*(i + size(amplitudes, 1)*(k - 1))) = &
               [real(amplitudes(i, k), wp), -aimag(amplitudes(i, k))]
         end do
      end do
   end function pairs_of
end module hb_time_columns
