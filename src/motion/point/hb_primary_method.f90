!> The primary method for a motion, balance or time integration: given, or chosen from counts, independently of
!> measured times.
!>
!> The balance is cheaper in nearly all cases. The exceptions are rigid friction and walls with small tolerances: the
!> error of the balance decreases with less than the second power of the order, that of the Fourier series of the
!> motion with the power 2.5, or 1.5 if a wall is struck. Counts of both, fitted to measurements:
!> docs/user/time_integration.md.
module hb_primary_method
   use hb_kinds, only: two_pi, wp
   use hb_thresholds, only: certainty_factor
   implicit none
   private
   public :: evaluation_work, integration_counts_t, integration_is_cheaper, primary_method

   type :: primary_method_t
      integer :: auto = 1
      integer :: balance = 2
      integer :: integration = 3
   end type primary_method_t
   type(primary_method_t), parameter :: primary_method = primary_method_t()

   !> Counts of a model with rigid laws and one tone.
   type :: integration_counts_t
      integer :: n_dofs = 1, n_coordinates = 1
      integer :: max_harmonics = 2000
      logical :: has_walls = .false.
      real(wp) :: tolerance = 1.0e-2_wp
      real(wp) :: omega = 1.0_wp                                      !! of the tone [rad/s]
      real(wp) :: decay = 0.0_wp                                      !! of the slowest mode [1/s]; 0: none decays
      real(wp) :: fastest = 0.0_wp                                    !! frequency of the structure [rad/s]
   end type integration_counts_t

contains

   !> Whether time integration clearly needs less work to the tolerance than the balance.
   pure logical function integration_is_cheaper(counts)
      type(integration_counts_t), intent(in) :: counts
      real(wp), parameter :: min_periods = 150.0_wp                ! of the windows of a time integration
      real(wp), parameter :: transient_in_decay_times = 3.0_wp        ! decay times of its transient, until two windows agree
      real(wp), parameter :: evaluations_per_period = 32.0_wp        ! evaluations in a period, two a step
      real(wp), parameter :: ns_per_pair = 500.0_wp                   ! [ns] of a balance, for each pair of unknowns
      real(wp) :: evaluations, n_balance, n_integration, periods, work_of_integration

      integration_is_cheaper = .false.
      if (counts%decay <= 0.0_wp) return
      associate (tolerance => counts%tolerance, n_coordinates => real(counts%n_coordinates, wp))
         n_balance = 5.0_wp*tolerance**(-0.55_wp)
         n_integration = tolerance**(-merge(0.67_wp, 0.4_wp, counts%has_walls))
         if (n_integration > counts%max_harmonics) return
         periods = max(min_periods, transient_in_decay_times*log(1.0e2_wp/tolerance)*counts%omega/(two_pi*counts%decay))
         evaluations = evaluations_per_period*max(n_integration, counts%fastest/counts%omega)
         work_of_integration = periods*(evaluation_work(counts%n_dofs, counts%n_coordinates, .false.)*evaluations + &
                                        evaluations_per_period*n_integration**2*n_coordinates)
         integration_is_cheaper = certainty_factor*work_of_integration < ns_per_pair*(n_balance*n_coordinates)**2
      end associate
   end function integration_is_cheaper

   !> Work of one evaluation of the equations of motion [ns]; for implicit steps with a dense tangent of the laws.
   pure real(wp) function evaluation_work(n_dofs, n_coordinates, is_implicit) result(work)
      integer, intent(in) :: n_dofs
      integer, intent(in) :: n_coordinates                            !! of the laws
      logical, intent(in) :: is_implicit

      work = 600.0_wp + 6.0_wp*real(n_dofs, wp)**2 + 60.0_wp*n_coordinates
      if (is_implicit) work = work + 0.2_wp*real(n_coordinates, wp)**3     ! 28 springs on a beam: 7.5 us
   end function evaluation_work
end module hb_primary_method
