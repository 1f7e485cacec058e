!> Interface of the time-domain solver: the motion after the transient, and locked tones.
!> The primary method for a motion, balance or time integration: given, or chosen from counts, independently of
!> measured times.
!> The balance is cheaper in nearly all cases. The exceptions are rigid friction and walls with small tolerances: the
!> error of the balance decreases with less than the second power of the order, that of the Fourier series of the
!> motion with the power 2.5, or 1.5 if a wall is struck. Counts of both, fitted to measurements:
!> docs/user/time_integration.md.
!>
!> The settings of time integration.
module hb_time_domain
   use hb_kinds, only: int64, two_pi, wp
   use hb_outcome, only: outcome
   use hb_text, only: to_text
   use hb_thresholds, only: clearly
   implicit none
   private
   public :: evaluation_work, highest_part, integration_config_t, integration_counts_t, integration_is_cheaper, &
      integration_method, integration_start, locking_t, may_be_locked, primary_method, steady_motion_t, step_of

   type :: integration_method_t
      integer :: cvode = 1
      integer :: runge_kutta_4 = 2
      integer :: central_differences = 3
      integer :: generalized_alpha = 4
   end type integration_method_t
   type(integration_method_t), parameter :: integration_method = integration_method_t()

   type :: integration_start_t
      integer :: rest = 1
      integer :: given = 2
   end type integration_start_t
   type(integration_start_t), parameter :: integration_start = integration_start_t()

   type :: integration_config_t
      integer :: method = integration_method%cvode
      real(wp) :: step = 0.0_wp                                       !! [s]; 0: from steps_per_period
      integer :: steps_per_period = 200                               !! of the fastest tone
      real(wp) :: duration = 0.0_wp                                   !! [s] of the record, without the transient; 0: not given
      real(wp) :: transient = 0.0_wp                                  !! [s] before the record
      integer :: decimation = 1                                       !! steps from one stored sample to the next
      real(wp) :: tolerance = 1.0e-10_wp                              !! of cvode and of Newton, relative
      logical :: is_stiff = .false.                                   !! cvode: backward differentiation instead of Adams
      real(wp) :: restitution = -1.0_wp                               !! of walls without their own; < 0: not given
      real(wp) :: spectral_radius = 0.8_wp                            !! of generalized_alpha at infinite frequency
      integer :: start = integration_start%rest
      real(wp), allocatable :: displacement(:), velocity(:)           !! added to the initial state [m], [m/s], (n_dofs)
      character(:), allocatable :: record                             !! file with the record to be continued
      integer :: starts = 1                                           !! states from which to integrate
      integer :: n_peaks = 0                                          !! frequencies searched for, per degree of freedom
      real(wp) :: largest = huge(1.0_wp)                              !! displacement at which the integration ends [m], no key
      integer(int64) :: max_evaluations = huge(1_int64)              !! at the motion, after which to give up, no key
      real(wp) :: max_work = huge(1.0_wp)                           !! of one method, no key
      integer :: substeps = 1                                         !! of the method, from one step to the next, no key
      real(wp) :: aim = 0.0_wp                                        !! error of the motion at which to end, with many
                                                                      !! candidate tuples; 0: the requested set is used. No key
   end type integration_config_t

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

   integer, parameter :: highest_part = 6                             !! of a tone: lowest common base frequency
   real(wp), parameter :: close = 0.05_wp                             ! |q w_m - p w_l| relative to the larger tone

   !> Whether several tones are multiples of one frequency.
   type :: locking_t
      logical :: is_locked = .false.
      real(wp) :: base = 0.0_wp                                       !! common frequency [rad/s]
      integer, allocatable :: multiples(:)                            !! of it, one for each tone
   contains
      procedure :: message => locking_message
   end type locking_t

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
      real(wp) :: work = 0.0_wp                                       !! from counts, see hb_solver_types
      real(wp), allocatable :: monodromy(:, :)                        !! derivative of the period map, of a motion from shooting
   end type steady_motion_t

contains

   !> Whether two tones, one of them unknown, are close to a ratio of small integers.
   pure logical function may_be_locked(omega, is_unknown)
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones)
      logical, intent(in) :: is_unknown(:)                            !! (n_tones)
      integer :: l, m, p, q

      may_be_locked = .false.
      do m = 2, size(omega)
         do l = 1, m - 1
            if (.not. (is_unknown(l) .or. is_unknown(m))) cycle
            do p = 1, highest_part
               do q = 1, highest_part - p + 1
                  if (abs(q*omega(m) - p*omega(l)) < close*max(omega(l), omega(m))) may_be_locked = .true.
               end do
            end do
         end do
      end do
   end function may_be_locked

   !> The message with the suggested remedy.
   pure function locking_message(self) result(text)
      class(locking_t), intent(in) :: self
      character(200) :: text
      integer :: m

      text = to_text(self%multiples(1))
      do m = 2, size(self%multiples)
         text = trim(text)//":"//to_text(self%multiples(m))
      end do
      text = "the tones lock in the ratio "//trim(text)//", as time integration shows: use one tone, near "// &
         to_text(self%base)//" rad/s"
   end function locking_message

   !> Whether time integration clearly needs less work to the tolerance than the balance.
   pure logical function integration_is_cheaper(counts)
      type(integration_counts_t), intent(in) :: counts
      real(wp), parameter :: min_periods = 150.0_wp                ! of the windows of a time integration
      real(wp), parameter :: decays = 3.0_wp                          ! decay times of its transient, until two windows agree
      real(wp), parameter :: of_harmonic = 32.0_wp                   ! evaluations in a period, two a step
      real(wp), parameter :: of_pair = 500.0_wp                       ! [ns] of a balance, for each pair of unknowns
      real(wp) :: evaluations, n_balance, n_integration, periods, work_of_integration

      integration_is_cheaper = .false.
      if (counts%decay <= 0.0_wp) return
      associate (tolerance => counts%tolerance, n_coordinates => real(counts%n_coordinates, wp))
         n_balance = 5.0_wp*tolerance**(-0.55_wp)
         n_integration = tolerance**(-merge(0.67_wp, 0.4_wp, counts%has_walls))
         if (n_integration > counts%max_harmonics) return
         periods = max(min_periods, decays*log(1.0e2_wp/tolerance)*counts%omega/(two_pi*counts%decay))
         evaluations = of_harmonic*max(n_integration, counts%fastest/counts%omega)
         work_of_integration = periods*(evaluation_work(counts%n_dofs, counts%n_coordinates, .false.)*evaluations + &
                                        of_harmonic*n_integration**2*n_coordinates)
         integration_is_cheaper = clearly*work_of_integration < of_pair*(n_balance*n_coordinates)**2
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

   !> The step [s], also the distance of two samples of the record.
   pure real(wp) function step_of(self, omega) result(step)
      type(integration_config_t), intent(in) :: self
      real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s], > 0

      step = self%step
      if (step <= 0.0_wp) step = two_pi/(maxval(omega)*self%steps_per_period)
   end function step_of
end module hb_time_domain
