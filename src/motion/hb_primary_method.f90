!> The primary method for a motion, balance or time integration: given, or decided from counts and never from a clock.
!>
!> The balance is cheaper nearly everywhere. The exceptions are rigid friction and walls to many
!> digits: its error falls with less than the second power of the order, that of the series of the motion itself with 2.5,
!> and with 1.5 where a wall turns it back.
!> Counts of both, fitted to measurements: docs/user/time_integration.md.
module hb_primary_method
   use hb_kinds, only: two_pi, wp
   implicit none
   private
   public :: integration_counts_t, integration_is_cheaper, primary_method, work_of_look

   type :: primary_method_t
      integer :: auto = 1
      integer :: balance = 2
      integer :: integration = 3
   end type primary_method_t
   type(primary_method_t), parameter :: primary_method = primary_method_t()

   !> What is counted, of a model with rigid laws and one tone.
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

   !> Whether time integration takes clearly less work to the tolerance than the balance.
   pure logical function integration_is_cheaper(counts)
      type(integration_counts_t), intent(in) :: counts
      real(wp), parameter :: clearly = 10.0_wp
      real(wp), parameter :: fewest_periods = 150.0_wp                ! of the windows of a time integration
      real(wp), parameter :: decays = 3.0_wp                          ! of its transient, until two windows agree
      real(wp), parameter :: samples_of_harmonic = 16.0_wp, steps_of_mode = 30.0_wp, looks_of_step = 2.0_wp
      real(wp), parameter :: of_pair = 500.0_wp                       ! [ns] of a balance, for each pair of unknowns
      real(wp) :: n_balance, n_integration, periods, samples, steps, work_of_integration

      integration_is_cheaper = .false.
      if (counts%decay <= 0.0_wp) return
      associate (tolerance => counts%tolerance, n_coordinates => real(counts%n_coordinates, wp))
         n_balance = 5.0_wp*tolerance**(-0.55_wp)
         n_integration = tolerance**(-merge(0.67_wp, 0.4_wp, counts%has_walls))
         if (n_integration > counts%max_harmonics) return
         periods = max(fewest_periods, decays*log(1.0e2_wp/tolerance)*counts%omega/(two_pi*counts%decay))
         samples = samples_of_harmonic*n_integration
         steps = max(samples, steps_of_mode*counts%fastest/counts%omega)
         work_of_integration = periods*(looks_of_step*work_of_look(counts%n_dofs, counts%n_coordinates, .false.)*steps + &
                                        2.0_wp*samples*n_integration*n_coordinates)
         integration_is_cheaper = clearly*work_of_integration < of_pair*(n_balance*n_coordinates)**2
      end associate
   end function integration_is_cheaper

   !> What one evaluation of the equations of motion takes [ns]; in implicit steps with a dense tangent of the laws.
   pure real(wp) function work_of_look(n_dofs, n_coordinates, is_implicit) result(work)
      integer, intent(in) :: n_dofs
      integer, intent(in) :: n_coordinates                            !! of the laws
      logical, intent(in) :: is_implicit

      work = 600.0_wp + 6.0_wp*real(n_dofs, wp)**2 + 60.0_wp*n_coordinates
      if (is_implicit) work = work + 0.2_wp*real(n_coordinates, wp)**3     ! 28 springs on a beam: 7.5 us
   end function work_of_look
end module hb_primary_method
