!> Thresholds that several decisions share; all are relative. Constants of a single decision are in its module.
module hb_thresholds
   use hb_kinds, only: wp
   implicit none
   private
   public :: agreement, clearly, difference_step, faint, most_bisections, next_to_none, rounding, safety, same_motion

   real(wp), parameter :: rounding = 1.0e-9_wp                     !! less is no difference: 1e-13 to 1e-10 are left where equations
                                                                      !! are solved to the last digit
   real(wp), parameter :: agreement = 1.0e-6_wp                       !! two results are the same one: half of the digits
   real(wp), parameter :: faint = 1.0e-3_wp                           !! a part of a motion that says nothing of it
   real(wp), parameter :: same_motion = 0.1_wp                     !! farthest that one method may lead from what another one found,
                                                                      !! in units of the state: beyond it is another motion
   real(wp), parameter :: safety = 3.0_wp                             !! estimates of errors have been as many times too small
   real(wp), parameter :: clearly = 10.0_wp                           !! times an estimate: beyond it nothing is left open
   real(wp), parameter :: difference_step = 1.0e-5_wp                 !! of values whose differences make a derivative, relative: they
                                                                      !! lose half of the digits at most, their errors are of its square
   real(wp), parameter :: next_to_none = 1.0e-4_wp                    !! of a step along a curve, or of a range: nothing lies between
   integer, parameter :: most_bisections = 40                         !! of an interval, which is rounding then
end module hb_thresholds
