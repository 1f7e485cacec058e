!> Thresholds that several decisions share; all are relative. Constants of a single decision are in its module.
module hb_thresholds
   use hb_kinds, only: wp
   implicit none
   private
   public :: certainty_factor, difference_step, equality_tolerance, max_bisections, max_reliable_error, nearby_steps, &
      negligible_share, negligible_step, rounding_level, small_share
   public :: estimate_safety, location_tolerance, max_distance_of_same, well_solved

   real(wp), parameter :: rounding_level = 1.0e-9_wp               !! smaller differences are rounding: equations solved to the
                                                                   !! last digit leave 1e-13 to 1e-10
   real(wp), parameter :: equality_tolerance = 1.0e-6_wp           !! two results are equal: half of the digits
   real(wp), parameter :: negligible_share = 1.0e-3_wp             !! a part of a motion that carries no information on it
   real(wp), parameter :: small_share = 0.1_wp                     !! small beside the whole: for decisions that need the
                                                                   !! order of magnitude alone
   real(wp), parameter :: max_distance_of_same = 0.1_wp            !! largest distance of the result of one method from that of
                                                                   !! another, relative to the state: beyond it is another
                                                                   !! motion
   real(wp), parameter :: estimate_safety = 3.0_wp                 !! error estimates have been too small by this factor
   real(wp), parameter :: certainty_factor = 10.0_wp               !! times an error estimate: beyond it a verdict is certain
   real(wp), parameter :: difference_step = 1.0e-5_wp              !! relative step of difference quotients: they lose half of
                                                                   !! the digits at most, and their error is of its square
   real(wp), parameter :: location_tolerance = 1.0e-11_wp          !! tolerance of located points and of derivatives: rounding
                                                                   !! leaves 1e-13 to 1e-10
   real(wp), parameter :: well_solved = 1.0e-4_wp                  !! of a tolerance or an estimate: what the solution of its
                                                                   !! equations, or the steps in time, may leave of it
   real(wp), parameter :: max_reliable_error = 0.3_wp              !! largest meaningful error estimate, relative to the motion
   real(wp), parameter :: negligible_step = 1.0e-4_wp              !! of a step along a curve, or of a range: negligible
   integer, parameter :: max_bisections = 60                      !! of an interval; 40 leave differences that a curve may
                                                                   !! show, more would be rounding
   integer, parameter :: nearby_steps = 20                         !! of Newton's method from a near solution: those that
                                                                   !! converge need fewer
end module hb_thresholds
