!> The settings of time integration.
module hb_integration_config
   use hb_kinds, only: int64, two_pi, wp
   implicit none
   private
   public :: integration_config_t, integration_method, integration_start, step_of

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

contains

   !> The step [s], also the distance of two samples of the record.
   pure real(wp) function step_of(self, omega) result(step)
      type(integration_config_t), intent(in) :: self
      real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s], > 0

      step = self%step
      if (step <= 0.0_wp) step = two_pi/(maxval(omega)*self%steps_per_period)
   end function step_of
end module hb_integration_config
