!> The table of the columns of the verdict on a motion (docs/user/schema.md).
module hb_verdict_columns
   use hb_integration_verdict, only: verdict_names, verdict_t
   use hb_motion_columns, only: columns_t
   implicit none
   private
   public :: verdict_columns

contains

   !> Hands over all columns of a verdict.
   subroutine verdict_columns(t, verdict)
      class(columns_t), intent(inout) :: t
      type(verdict_t), intent(in) :: verdict

      call t%integer("integration_verdict", "1", "", "verdict of nhbm verify", verdict%kind, verdict_names)
      call t%real("integration_first_difference", "1", "", &
         "largest difference from time integration in the first period of the slowest tone, "// &
         "relative to the motion of its coordinate", verdict%first_difference)
      call t%real("integration_difference", "1", "", "difference from time integration in the last periods, "// &
         "for the coordinate with the largest ratio to its limit, relative to its motion", verdict%difference)
      call t%real("integration_limit", "1", "", "limit of that difference", verdict%limit)
      call t%real("integration_growth", "1/s", "", "rate at which a nearby trajectory diverges from the motion", verdict%growth)
      call t%real("integration_duration", "s", "", "integrated time", verdict%duration)
      call t%real_array("integration_drift", "rad/s", "tone", &
         "integrated frequency minus that of the motion, 0 for given tones", verdict%drift)
   end subroutine verdict_columns
end module hb_verdict_columns
