!> The steady motion of a model from time integration.
module hb_steady_motion
   use hb_kinds, only: wp
   use hb_outcome, only: outcome
   implicit none
   private
   public :: steady_motion_t

   !> The steady motion of a model from time integration.
   type :: steady_motion_t
      integer :: status = outcome%pending                             !! of time integration; pending: not known
      integer :: n_motions = 0 !! different motions from several starts; 0: there was one start
      character(:), allocatable :: message                            !! the result, or the cause of a failure
      complex(wp), allocatable :: amplitudes(:, :) !! cos - i sin [m], (n_dofs, n_harmonics); of the integrated motion
      complex(wp), allocatable :: averages(:, :)                      !! likewise at the coordinates, (n_harmonics, n_coordinates)
      real(wp) :: amplitude = 0.0_wp                                  !! of equal root mean square, of the largest coordinate [m]
      real(wp) :: spread = 0.0_wp                                     !! difference of the coordinates of the laws between
                                                                      !! windows, relative; for fits to candidates, the misfit
      real(wp) :: change_by_steps = 0.0_wp                            !! of it, with fixed steps: effect of halving the steps
      real(wp) :: left_out = 0.0_wp                                   !! part of the motion outside the set, relative; for fits 0
      integer :: n_periods = 0                                        !! of the slowest tone, in all
      integer :: n_repeat = 0                                         !! periods after which a subharmonic motion repeats
      logical :: is_out_of_work = .false.                             !! before its end
      logical :: is_at_pole = .false.                                 !! it has ended where a force becomes infinite, as by pull-in
      real(wp) :: work = 0.0_wp                                       !! from counts, see hb_solver_types
      real(wp), allocatable :: monodromy(:, :)                        !! derivative of the period map, of a motion from shooting
   end type steady_motion_t

end module hb_steady_motion
