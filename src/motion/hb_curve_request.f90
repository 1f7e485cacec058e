!> The request for a curve of motions, and the kinds of its points.
module hb_curve_request
   use hb_curve_origin, only: curve_origin_t
   use hb_kinds, only: wp
   use hb_model_problem, only: moving_value_t
   use hb_response, only: response_t
   implicit none
   private
   public :: curve_kind, curve_kind_names, curve_request_t, located_response_t

   !> What a point of a curve is; numbers as in the result file.
   type :: curve_kind_t
      integer :: none = 0
      integer :: regular = 1                                          !! a step of the curve
      integer :: start = 2                                            !! from where it is followed
      integer :: fold = 3                                             !! the value turns back
      integer :: peak = 4                                             !! maximum of a response
      integer :: value = 5                                            !! a value that was requested
      integer :: end = 6                                              !! an end of the range, or where the curve closes
      integer :: branch = 7                                           !! another curve crosses: the determinant changes its sign
      integer :: flip = 8                                             !! a multiplier passes -1: motions of twice the period
      integer :: torus = 9                                            !! a pair of them passes the unit circle: a tone joins
      integer :: split = 10                                           !! a multiplier passes 1, and nothing that is sought is there
      integer :: graze = 11                                           !! a contact begins or is never left any more
      integer :: minimum = 12                                         !! of a response
      integer :: amplitude = 13                                       !! a response has one that was requested
      integer :: resonance = 14                                       !! a harmonic is a quarter of a period from its load
   end type curve_kind_t
   type(curve_kind_t), parameter :: curve_kind = curve_kind_t()
   character(*), parameter :: curve_kind_names(0:14) = [character(9) :: "none", "regular", "start", "fold", "peak", "value", &
      "end", "branch", "flip", "torus", "split", "graze", "minimum", "amplitude", "resonance"]

   !> A response, and what is located along curves by it.
   type, extends(response_t) :: located_response_t
      integer :: kind = curve_kind%peak                               !! or minimum, amplitude, resonance
      real(wp) :: amplitude = 0.0_wp                                  !! that it shall have
   end type located_response_t

   !> A located point, such as a peak or fold over a first value, that is followed along a second one, in place of the motion
   !> itself.
   type :: over_t
      integer :: kind = curve_kind%peak                               !! or another one
      type(moving_value_t) :: moving                                  !! the first value
      real(wp) :: from = 0.0_wp, to = 0.0_wp                          !! its range
   end type over_t

   !> What is requested.
   type :: curve_request_t
      type(moving_value_t) :: moving
      real(wp) :: from = 0.0_wp, to = 0.0_wp                          !! range of the value
      real(wp) :: start = 0.0_wp                                      !! value of the first motion, in the range
      real(wp), allocatable :: values(:)                              !! to be met exactly
      real(wp), allocatable :: others(:)                              !! likewise; motions apart are sought there
      real(wp) :: longest_step = 0.04_wp                              !! in units of the range and of the largest motion
      integer :: n_points = 0                                         !! at most
      real(wp) :: available_memory = huge(1.0_wp)                     !! bytes
      logical :: switches = .false.                                   !! at branch points: the other curve is followed as well
      type(located_response_t), allocatable :: responses(:)
      type(curve_origin_t), allocatable :: origin                     !! if given: where the curve leaves another one, in place
                                                                      !! of a first motion at `start`
      type(over_t), allocatable :: over                               !! hb_motion_ridge
   end type curve_request_t
end module hb_curve_request
