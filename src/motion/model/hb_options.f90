!> The settings with which motions are computed, by stage. They are read once and passed on.
!> The component initialisers of the types in this module and in the types it contains are the defaults of the table
!> of input keys (src/input_keys.txt).
module hb_options
   use hb_discretisation, only: discretisation_t
   use hb_error, only: error_t
   use hb_fe_model, only: fe_model_source_t
   use hb_integration_config, only: integration_config_t
   use hb_kinds, only: wp
   use hb_locking, only: locking_t
   use hb_model_number, only: model_number_t
   use hb_outcome, only: outcome
   use hb_primary_method, only: primary_method
   use hb_response, only: response_t
   use hb_solver_types, only: share_of_solver, solver_config_t
   use hb_spectrum, only: spectrum_t
   use hb_stability, only: harmonic_motion_t, stability_config_t, stability_finder_t
   use hb_start_term, only: start_term_t
   use hb_steady_motion, only: steady_motion_t
   use hb_system, only: system_t
   implicit none
   private
   public :: accuracy_t, callbacks_t, chain_config_t, error_estimate_config_t, gradient_config_t, options_t, output_config_t, &
      purpose_t, share_of_integrated, start_config_t, time_domain_solver_t

   integer, parameter :: share_of_integrated = 4 !! sets of integrated motions are as many times larger: no tuple
                                                                      !! of theirs is an unknown

   !> The results that are stored.
   type :: output_config_t
      character(:), allocatable :: title
      integer, allocatable :: dofs(:)                                 !! stored degrees of freedom
      integer, allocatable :: samples(:)                              !! grid of the stored surfaces, size 0: none
   end type output_config_t

   !> The requested accuracy of a motion, if sets and grids are chosen for it, hb_accurate_motion.
   type :: accuracy_t
      logical :: is_on = .false.
      logical :: grows_set = .false.                                  !! the set is not fixed
      logical :: refines_grid = .false.                               !! the grid is not fixed
      real(wp) :: tolerance = 1.0e-2_wp                               !! estimated error relative to the motion at the laws
      type(response_t), allocatable :: outputs(:)                     !! or relative to each of these, if there are any
      integer :: max_harmonics = 2000                                 !! tuples of a set
      integer :: max_samples = 2000000                                !! of a grid
      real(wp) :: max_work = 3.0e9_wp                                 !! of all solutions of a point, as `work` of a report
   end type accuracy_t

   !> Numbers with respect to which motions are differentiated.
   type :: gradient_config_t
      character(64), allocatable :: names(:)                          !! as given
      type(model_number_t), allocatable :: by(:)
      type(response_t), allocatable :: of                             !! differentiated alone; not allocated: all coefficients
   end type gradient_config_t

   !> Limits above which a solved point counts as inaccurate.
   type :: error_estimate_config_t
      logical :: is_on = .true.
      real(wp) :: truncation = 1.0e-2_wp                              !! largest estimated error, relative to the motion
      real(wp) :: aliasing = 1.0e-2_wp                                !! largest estimated error, relative to the motion
      real(wp) :: penetration = 1.0e-2_wp                             !! largest, relative to the largest harmonic
      real(wp) :: impact = 1.0e-2_wp                                  !! strongest impact on a rigid wall, its energy relative to
                                                                      !! that of the motion there
      integer :: improvement_steps = 0                                !! steps towards the motion in a wider set
      real(wp) :: commensurability = 1.0e-3_wp                        !! smallest |k.omega| relative to the largest tone
   end type error_estimate_config_t

   !> First guesses from neighbouring points of a sweep.
   type :: chain_config_t
      logical :: is_on = .false.
      logical :: is_auto = .true.                                     !! hb_study decides from the sweep
      integer :: length = 1000                                        !! points along the fastest parameter
      logical :: secant = .true.                                      !! extrapolate from the last two solutions
   end type chain_config_t

   !> The first guess of a motion: the sum of the given terms and one of these.
   type :: start_config_t
      type(start_term_t), allocatable :: given(:)                     !! terms
      type(spectrum_t) :: spectrum                                    !! their sum [m]
      logical :: from_linear = .true.                                 !! the motion without laws, otherwise zero
      logical :: from_integration = .false.                           !! or the end of a time integration
   end type start_config_t

   !> Integrates systems in time. If the cancellation of the thread (hb_cancellation) ends the integration, the
   !> procedures return an error, or nothing.
   type, abstract :: time_domain_solver_t
   contains
      procedure(find_steady_motion), deferred, nopass :: find_steady_motion
      procedure(first_guess), deferred, nopass :: first_guess
      procedure(find_locking), deferred, nopass :: find_locking
      procedure, nopass :: find_departure => leave_departure_unknown
   end type time_domain_solver_t

   !> Objects of later layers that the solution of a model calls, which the caller supplies, and the share of the work that they
   !> may use. Progress and cancellation belong to the thread, hb_cancellation.
   type :: callbacks_t
      class(fe_model_source_t), allocatable :: fe_models              !! source of a structure of type `model`
      class(stability_finder_t), allocatable :: stability_finder      !! not allocated: stability is not computed
      class(time_domain_solver_t), allocatable :: time_domain_solver  !! not allocated: there is no time integration
      real(wp) :: share_of_integration = 1.0_wp                       !! of a point, of the work of time integration
   end type callbacks_t

   !> What the motion of a model is for; it decides defaults, and which models are complete.
   type :: purpose_t
      logical :: is_followed = .false.                                !! it is the first one of a curve
      logical :: may_only_integrate = .false.                         !! models may lack what a balance needs, such as tones
   end type purpose_t

   type :: options_t
      type(callbacks_t) :: callbacks
      type(purpose_t) :: purpose
      type(start_config_t) :: start
      type(chain_config_t) :: chain
      integer :: primary_method = primary_method%auto                 !! one of hb_steady_motion
      type(solver_config_t) :: solver
      type(accuracy_t) :: accuracy
      type(error_estimate_config_t) :: error_estimate
      type(stability_config_t) :: stability
      type(integration_config_t) :: integration
      logical :: may_integrate = .true.                               !! by the time-domain solver, if there is one
      logical :: compares_in_time = .false.                           !! a motion that may jump within a period of a slow tone
      type(gradient_config_t) :: gradient
      type(output_config_t) :: output
      real(wp) :: memory_limit = huge(1.0_wp)                         !! bytes that this process may use
   contains
      procedure :: has_time_domain => options_has_time_domain
      procedure :: lacks_impacts_of => options_lacks_impacts_of
      procedure :: max_work => options_max_work
   end type options_t

   abstract interface
      !> Integrates the system until it is steady or the budget of work is exhausted. An error is one of the
      !> integration, such as a law that cannot be integrated.
      subroutine find_steady_motion(system, discretisation, options, law_dofs, steady, error)
         import :: discretisation_t, error_t, options_t, steady_motion_t, system_t
         type(system_t), intent(in) :: system                         !! with all tones given
         type(discretisation_t), intent(in) :: discretisation
         type(options_t), intent(in) :: options
         integer, intent(in) :: law_dofs(:)
         type(steady_motion_t), intent(out) :: steady
         type(error_t), allocatable, intent(out) :: error
      end subroutine find_steady_motion

      !> Returns a first guess in the form of hb_motion: coefficients at the laws, then all base frequencies. It is
      !> not allocated if the motion vanishes, or has no unknown tone.
      subroutine first_guess(system, discretisation, options, omega, law_dofs, guess, error)
         import :: discretisation_t, error_t, options_t, system_t, wp
         type(system_t), intent(in) :: system
         type(discretisation_t), intent(in) :: discretisation
         type(options_t), intent(in) :: options
         real(wp), intent(in) :: omega(:)                             !! [rad/s], (n_tones), first guesses where unknown, all > 0
         integer, intent(in) :: law_dofs(:)
         real(wp), allocatable, intent(out) :: guess(:)
         type(error_t), allocatable, intent(out) :: error
      end subroutine first_guess

      !> Searches for a common frequency of the whole motion.
      subroutine find_locking(locking, system, discretisation, options, omega, law_dofs)
         import :: discretisation_t, locking_t, options_t, system_t, wp
         type(locking_t), intent(out) :: locking
         type(system_t), intent(in) :: system
         type(discretisation_t), intent(in) :: discretisation
         type(options_t), intent(in) :: options
         real(wp), intent(in) :: omega(:)                             !! [rad/s], (n_tones), as far as known, > 0
         integer, intent(in) :: law_dofs(:)
      end subroutine find_locking
   end interface

contains

   !> Difference between a motion and a short integration that starts on it, root mean square at the degrees of freedom of
   !> the laws, relative; negative if it is not known, as always here.
   subroutine leave_departure_unknown(system, options, motion, max_work, departure)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(harmonic_motion_t), intent(in) :: motion
      real(wp), intent(in) :: max_work                              !! in about a nanosecond
      real(wp), intent(out) :: departure

      departure = -1.0_wp
   end subroutine leave_departure_unknown

   !> Whether time integration may be used.
   pure logical function options_has_time_domain(self) result(has)
      class(options_t), intent(in) :: self

      has = self%may_integrate .and. allocated(self%callbacks%time_domain_solver)
   end function options_has_time_domain

   !> Whether walls are struck in a balance with this status and all of them have a given restitution: the motion is
   !> then found by time integration.
   logical function options_lacks_impacts_of(self, system, status) result(lacks)
      class(options_t), intent(in) :: self
      type(system_t), intent(in) :: system
      integer, intent(in) :: status

      lacks = .false.
      if (status == outcome%impact) lacks = system%has_restitution(self%integration%restitution)
   end function options_lacks_impacts_of

   !> Work of a point that its limits permit: that of all levels, and that of fallbacks, time integration included.
   pure real(wp) function options_max_work(self) result(work)
      class(options_t), intent(in) :: self

      work = self%accuracy%max_work + self%solver%max_fallback_work/share_of_solver
   end function options_max_work
end module hb_options
