!> Thresholds that more than one decision shares; all are relative. A module has constants of its own for what it alone decides.
module hb_thresholds
   use hb_kinds, only: wp
   implicit none
   private
   public :: agreement, faint, most_bisections, rounding, safety, same_motion

   real(wp), parameter :: rounding = 1.0e-9_wp                     !! less is no difference: 1e-13 to 1e-10 are left where equations
                                                                      !! are solved to the last digit
   real(wp), parameter :: agreement = 1.0e-6_wp                       !! two results are the same one: half of the digits
   real(wp), parameter :: faint = 1.0e-3_wp                           !! a part of a motion that says nothing of it
   real(wp), parameter :: same_motion = 0.1_wp                     !! farthest that one method may lead from what another one found,
                                                                      !! in units of the state: beyond it is another motion
   real(wp), parameter :: safety = 3.0_wp                             !! estimates of errors have been as many times too small
   integer, parameter :: most_bisections = 40                         !! of an interval, which is rounding then
end module hb_thresholds
