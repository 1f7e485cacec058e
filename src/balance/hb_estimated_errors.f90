!> The estimated errors of a motion, with what else the finer grid tells about it. hb_error_estimate computes them.
module hb_estimated_errors
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_law, only: defects_t
   use hb_mean_energy, only: mean_energy_t
   implicit none
   private
   public :: error_estimate_t, wanted_motions_t

   !> Requested motions beside the estimates, and what the estimates decide.
   type :: wanted_motions_t
      integer :: improvement_steps = 0                                !! towards the motion in the wider set; 0: none
      logical :: refined = .false.                                    !! `refined` of an error estimate, also with several tones
      real(wp) :: acceptable = huge(1.0_wp)                           !! estimate up to which the motion is accepted
   end type wanted_motions_t

   type :: error_estimate_t
      real(wp) :: truncation = 0.0_wp                                 !! estimated error by the harmonics left out, relative
      real(wp) :: aliasing = 0.0_wp                                   !! estimated error by the finite grid, relative
      real(wp), allocatable :: frequency_error(:)                     !! of unknown tones, by both [rad/s], (n_tones)
      real(wp) :: parameter_error = 0.0_wp                            !! of the value along a curve, by both
      type(defects_t) :: defects                                      !! of rigid walls and rigid friction, on the finer grid
      real(wp) :: impact = 0.0_wp                                     !! energy of the strongest impact on a rigid wall, relative
                                                                      !! to that of the motion there
      real(wp) :: power_in = 0.0_wp                                   !! mean power of the loads [W]
      real(wp), allocatable :: power_laws(:)                          !! mean loss in each law, on the finer grid [W]
      real(wp), allocatable :: peak_force(:)                          !! largest force of each law, over its coordinates, there [N]
      type(mean_energy_t) :: energy                                   !! of the structure
      real(wp) :: combination_frequency = 0.0_wp                      !! smallest |k.omega| of low order [rad/s]
      integer, allocatable :: combination(:)                          !! its k, (n_tones)
      type(harmonics_t) :: wider                                      !! the set of the improved motion
      type(harmonics_t) :: around                                     !! the wider set of the estimate
      real(wp), allocatable :: neglected(:)                           !! first-order amplitude of each of its tuples outside the
                                                                      !! set, relative to the motion; not allocated if not known
      real(wp), allocatable :: first_order(:, :)                      !! motion with its first-order errors removed [m],
                                                                      !! (n_coefficients of `around`, n_dofs of the balance)
      real(wp), allocatable :: improved(:, :)                         !! motion in the wider set [m], (n_coefficients,
                                                                      !! n_law_dofs); not allocated unless requested
      integer :: n_products = 0 !! with the tangent of the wider set; 0: steps in blocks suffice
      type(wanted_motions_t) :: wanted                                !! as requested
      complex(wp), allocatable :: refined(:, :)                       !! motion with its first-order errors removed [m], (all
                                                                      !! dofs, tuples of `around`); with several tones if
                                                                      !! requested
   end type error_estimate_t

end module hb_estimated_errors
