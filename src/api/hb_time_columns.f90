!> Results of time integration by name: a record as in its file (docs/user/schema.md), or the verdict on a motion.
module hb_time_columns
   use hb_column_view, only: column_view_t
   use hb_error, only: error_t
   use hb_integration, only: integration_t
   use hb_kinds, only: wp
   use hb_model, only: model_t
   use hb_verification, only: verdict_t
   implicit none
   private
   public :: find_record_column, find_verdict_column

contains

   !> Looks up a column of a record. Fails for an unknown name.
   subroutine find_record_column(column, name, record, model, error)
      class(column_view_t), intent(inout) :: column
      character(*), intent(in) :: name                                !! empty: names are listed
      type(integration_t), intent(in) :: record
      type(model_t), intent(in) :: model
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      call column%begin(name)
      associate (r => record%record, assessment => record%assessment, state => record%state)
         call column%real("time", "s", "time", "", r%time)
         call column%real("displacement", "m", "dof time", "", r%displacement)
         call column%real("velocity", "m/s", "dof time", "", r%velocity)
         call column%real("force", "N", "law_coordinate time", "", r%force)
         call column%real("cpu_seconds", "s", "", "", r%cpu_seconds)
         call column%real("frequency", "rad/s", "tone", "", record%omega)
         call column%integer("tuple", "1", "harmonic tone", "", model%harmonics%tuples)
         call column%real("coefficients", "m", "dof harmonic component", "", pairs_of(assessment%coefficients))
         call column%real("spread", "m", "dof harmonic", "", assessment%spread)
         if (model%integration%n_peaks > 0) then
            call column%real("peak_frequency", "rad/s", "dof peak", "", assessment%frequencies)
            call column%real("peak_coefficients", "m", "dof peak component", "", pairs_of(assessment%amplitudes))
         end if
         if (allocated(record%motion)) then
            call column%integer("start_motion", "1", "start", "", record%motion)
            associate (n => size(assessment%spread, 1), m => size(assessment%spread, 2), motions => record%motions)
               call column%real("motion_coefficients", "m", "motion dof harmonic component", "", &
                  reshape([(pairs_of(motions(i)%coefficients), i=1, size(motions))], [2, n, m, size(motions)]))
               call column%real("motion_spread", "m", "motion dof harmonic", "", &
                  reshape([(motions(i)%spread, i=1, size(motions))], [n, m, size(motions)]))
            end associate
         end if
         call column%real("state_time", "s", "", "", state%time)
         call column%real("state_displacement", "m", "state_dof", "", state%q)
         call column%real("state_velocity", "m/s", "state_dof", "", state%v)
         if (size(state%s) > 0) call column%real("state_slider", "m", "slider", "", state%s)
      end associate
      call column%refuse_unknown(error)
   end subroutine find_record_column

   !> Looks up a column of the verdict on a motion. Fails for an unknown name.
   subroutine find_verdict_column(column, name, verdict, error)
      class(column_view_t), intent(inout) :: column
      character(*), intent(in) :: name                                !! empty: names are listed
      type(verdict_t), intent(in) :: verdict
      type(error_t), allocatable, intent(out) :: error

      call column%begin(name)
      call column%integer("integration_verdict", "1", "", "", verdict%kind)
      call column%real("integration_first_difference", "1", "", "", verdict%first_difference)
      call column%real("integration_difference", "1", "", "", verdict%difference)
      call column%real("integration_limit", "1", "", "", verdict%limit)
      call column%real("integration_growth", "1/s", "", "", verdict%growth)
      call column%real("integration_duration", "s", "", "", verdict%duration)
      if (allocated(verdict%drift)) call column%real("integration_drift", "rad/s", "tone", "", verdict%drift)
      call column%refuse_unknown(error)
   end subroutine find_verdict_column

   !> Cosine and sine of amplitudes c - i s.
   pure function pairs_of(amplitudes) result(pairs)
      complex(wp), intent(in) :: amplitudes(:, :)
      real(wp) :: pairs(2, size(amplitudes, 1), size(amplitudes, 2))

      pairs(1, :, :) = real(amplitudes, wp)
      pairs(2, :, :) = -aimag(amplitudes)
   end function pairs_of
end module hb_time_columns
