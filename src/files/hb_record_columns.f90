!> The table of the columns of a record of time integration, as its file has it (docs/user/schema.md).
module hb_record_columns
   use hb_integration, only: integration_t
   use hb_kinds, only: wp
   use hb_motion_columns, only: columns_t, of_dof, of_rate
   implicit none
   private
   public :: record_columns

contains

   !> Hands over all columns of a record.
   subroutine record_columns(t, content, tuples)
      class(columns_t), intent(inout) :: t
      type(integration_t), intent(in) :: content
      integer, intent(in) :: tuples(:, :)                             !! (n_tones, n_harmonics)
      integer :: i

      associate (record => content%record, assessment => content%assessment, state => content%state)
         call t%real("time", "s", "time", "time", record%time)
         call t%real("displacement", of_dof, "dof time", "displacement", record%displacement)
         call t%real("velocity", of_rate, "dof time", "velocity", record%velocity)
         call t%real("force", "N", "law_coordinate time", "force of the laws on their coordinates, on the left-hand side", &
                     record%force)
         call t%real("cpu_seconds", "s", "", "processor time of the integration", record%cpu_seconds)
         if (size(tuples, 1) > 0) then
            call t%real("frequency", "rad/s", "tone", "base frequencies", content%omega)
            call t%integer("tuple", "1", "harmonic tone", "integer tuple j of each harmonic", tuples)
         end if
         call t%real("coefficients", of_dof, "dof harmonic component", &
                     "coefficients of the record by averages with a smooth window", pairs_of(assessment%coefficients))
         call t%real("spread", of_dof, "dof harmonic", "difference of the coefficients of both halves of the record", &
                     assessment%spread)
         if (size(assessment%frequencies, 1) > 0) then
            call t%real("peak_frequency", "rad/s", "dof peak", "frequencies of the largest lines", assessment%frequencies)
            call t%real("peak_coefficients", of_dof, "dof peak component", "coefficients of the largest lines", &
                        pairs_of(assessment%amplitudes))
         end if
         if (allocated(content%motion)) then
            associate (n => size(assessment%spread, 1), m => size(assessment%spread, 2), motions => content%motions)
               call t%integer("start_motion", "1", "start", "motion in which each start ends, 0: none", content%motion)
               call t%real("motion_coefficients", of_dof, "motion dof harmonic component", "coefficients of each motion", &
                           reshape([(pairs_of(motions(i)%coefficients), i=1, size(motions))], [2, n, m, size(motions)]))
               call t%real("motion_spread", of_dof, "motion dof harmonic", &
                           "difference of the coefficients of both halves of its record", &
                           reshape([(motions(i)%spread, i=1, size(motions))], [n, m, size(motions)]))
            end associate
         end if
         call t%real("state_time", "s", "", "time of the last state", state%time)
         call t%real("state_displacement", of_dof, "state_dof", "displacement of the last state", state%q)
         call t%real("state_velocity", of_rate, "state_dof", "velocity of the last state", state%v)
         if (size(state%s) > 0) &
            call t%real("state_slider", "m", "slider", "states of the laws with memory in the last state", state%s)
      end associate
   end subroutine record_columns

   !> Cosine and sine of amplitudes c - i s.
   pure function pairs_of(amplitudes) result(pairs)
      complex(wp), intent(in) :: amplitudes(:, :)
      real(wp) :: pairs(2, size(amplitudes, 1), size(amplitudes, 2))

      pairs(1, :, :) = real(amplitudes, wp)
      pairs(2, :, :) = -aimag(amplitudes)
   end function pairs_of
end module hb_record_columns
