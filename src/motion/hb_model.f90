!> The model of one point of a study, with its settings.
!>
!> The component initialisers of the types here and below are the defaults of the table of input keys (src/input_keys.txt).
!> hb_model_reader fills models from an input.
module hb_model
   use hb_amplitudes, only: amplitudes_t
   use hb_document, only: parameter_t
   use hb_error, only: error_t
   use hb_fe_model, only: fe_model_source_t
   use hb_fftw, only: planning
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_law, only: hold_t, law_box_t
   use hb_normal_mode, only: normal_mode_t
   use hb_outcome, only: outcome
   use hb_response, only: response_t
   use hb_solver_types, only: solver_config_t
   use hb_stability, only: stability_config_t, stability_finder_t
   use hb_structure, only: structure_t
   use hb_time_domain, only: integration_config_t, locking_t, primary_method, steady_motion_t
   use hb_tones, only: tones_t
   use hb_torus, only: torus_t
   implicit none
   private
   public :: accuracy_t, callbacks_t, certificate_config_t, gradient_config_t, model_t, share_of_integrated, symmetry, &
      time_domain_solver_t

   integer, parameter :: share_of_integrated = 4 !! sets of integrated motions are as many times larger: no tuple
                                                                      !! of theirs is an unknown

   !> Among which motions a model is solved.
   type :: symmetry_t
      integer :: auto = 1                                             !! odd ones where equations and first guess are odd
      integer :: none = 2                                             !! all
      integer :: odd = 3                                              !! odd ones; refused where equations are not
   end type symmetry_t
   type(symmetry_t), parameter :: symmetry = symmetry_t()

   !> What is kept of a result.
   type :: output_config_t
      character(:), allocatable :: title
      integer, allocatable :: dofs(:)                                 !! stored degrees of freedom
      integer, allocatable :: samples(:)                              !! grid of the stored surfaces, size 0: none
   end type output_config_t

   !> How accurate a motion is requested, where sets and grids are chosen for that, hb_accurate_motion.
   type :: accuracy_t
      logical :: is_on = .false.
      logical :: grows_set = .false.                                  !! no &harmonics rules the set
      logical :: refines_grid = .false.                               !! no &sampling rules the grid
      real(wp) :: tolerance = 1.0e-2_wp                               !! estimated error relative to the motion that the laws feel
      type(response_t), allocatable :: outputs(:)                     !! or relative to each of these, where there are any
      integer :: max_harmonics = 2000                                 !! tuples of a set
      integer :: max_samples = 2000000                                !! of a grid
      real(wp) :: max_work = 6.0e9_wp                                 !! of all solutions of a point, as `work` of a report
   end type accuracy_t

   !> Values of the input by which motions are differentiated.
   type :: gradient_config_t
      character(64), allocatable :: names(:)                          !! their paths
      type(parameter_t), allocatable :: by(:)                         !! in the document of the model
   end type gradient_config_t

   !> What makes a solved point count as not good enough.
   type :: certificate_config_t
      logical :: is_on = .true.
      real(wp) :: truncation = 1.0e-2_wp                              !! largest estimated error, relative to the motion
      real(wp) :: aliasing = 1.0e-2_wp                                !! largest estimated error, relative to the motion
      real(wp) :: penetration = 1.0e-2_wp                             !! largest, relative to the largest harmonic
      real(wp) :: impact = 1.0e-2_wp                                  !! hardest impact against a rigid wall, its energy relative to
                                                                      !! that of the motion there
      integer :: improvement_steps = 0                                !! steps towards the motion in a wider set
      real(wp) :: commensurability = 1.0e-3_wp                        !! smallest |k.omega| relative to the largest tone
   end type certificate_config_t

   !> First guesses from neighbouring points of a sweep.
   type :: chain_config_t
      logical :: is_on = .false.
      logical :: is_auto = .true.                                     !! hb_study decides by the sweep
      integer :: length = 1000                                        !! points along the fastest parameter
      logical :: secant = .true.                                      !! extrapolate through the last two solutions
   end type chain_config_t

   !> Follows motions through time. Where the cancellation of the thread (hb_cancellation) ends that, the result is an error, or
   !> nothing.
   type, abstract :: time_domain_solver_t
   contains
      procedure(settle), deferred, nopass :: settle
      procedure(first_guess), deferred, nopass :: first_guess
      procedure(find_locking), deferred, nopass :: find_locking
   end type time_domain_solver_t

   !> What the solution of a model calls but does not contain, and what its motion is for: later layers and callers say so. Progress
   !> and cancellation belong to the thread, hb_cancellation.
   type :: callbacks_t
      class(fe_model_source_t), allocatable :: fe_models              !! from where a structure of type `model` comes
      class(stability_finder_t), allocatable :: stability_finder      !! not allocated: stability is not known
      class(time_domain_solver_t), allocatable :: time_domain_solver  !! not allocated: there is no time integration
      real(wp) :: share_of_integration = 1.0_wp                       !! of a point, of the work of time integration
      logical :: is_followed = .false.                                !! the motion is the first one of a curve
   end type callbacks_t

   type :: model_t
      logical :: is_read = .false.                                    !! from an input, without an error
      type(callbacks_t) :: callbacks
      logical :: may_integrate = .true.                               !! by the time-domain solver, where there is one
      type(structure_t) :: structure
      type(tones_t) :: tones
      integer, allocatable :: phase_dofs(:)                           !! of the sines that vanish, by unknown tone; size 0:
                                                                      !! integral phase conditions
      type(normal_mode_t) :: normal_mode
      type(harmonics_t) :: harmonics
      integer :: symmetry = symmetry%auto
      type(torus_t) :: torus
      type(law_box_t), allocatable :: laws(:)
      integer, allocatable :: law_groups(:)                           !! number of the group that each law comes from
      type(amplitudes_t) :: loads                                     !! [N], of `harmonics`
      type(amplitudes_t) :: load_slopes                               !! their derivatives by j.omega [N s]
      logical :: has_inertia_loads = .false.                          !! some grow with the frequency
      type(amplitudes_t) :: start                                     !! added to the first guess [m]
      type(solver_config_t) :: solver
      logical :: start_from_linear = .true.                           !! first guess: the motion without laws, else zero
      logical :: start_from_integration = .false.                     !! or where time integration ends
      type(chain_config_t) :: chain
      integer :: planning = planning%estimate                         !! effort of FFTW
      character(:), allocatable :: wisdom                             !! file with FFTW's wisdom
      type(accuracy_t) :: accuracy
      type(certificate_config_t) :: certificate
      type(stability_config_t) :: stability
      type(output_config_t) :: output
      real(wp) :: memory_limit = huge(1.0_wp)                         !! bytes that this process may take
      type(integration_config_t) :: integration
      type(gradient_config_t) :: gradient
      integer :: primary_method = primary_method%auto                 !! to its motion, one of hb_time_domain
   contains
      procedure :: has_time_domain => model_has_time_domain
      procedure :: lacks_impacts_of => model_lacks_impacts_of
   end type model_t

   abstract interface
      !> Follows the model until it is steady or the budget of work ends. An error is one of the integration, such as a law that it
      !> cannot follow.
      subroutine settle(model, law_dofs, settled, error)
         import :: error_t, model_t, steady_motion_t
         type(model_t), intent(in) :: model                           !! all of its tones given
         integer, intent(in) :: law_dofs(:)
         type(steady_motion_t), intent(out) :: settled
         type(error_t), allocatable, intent(out) :: error
      end subroutine settle

      !> Gives a first guess as hb_motion takes it: coefficients at the laws, then all base frequencies. Not
      !> allocated where nothing is left to move, or where the motion has no tone of its own.
      subroutine first_guess(model, omega, law_dofs, guess, error)
         import :: error_t, model_t, wp
         type(model_t), intent(in) :: model
         real(wp), intent(in) :: omega(:)                             !! [rad/s], (n_tones), guesses where unknown, all > 0
         integer, intent(in) :: law_dofs(:)
         real(wp), allocatable, intent(out) :: guess(:)
         type(error_t), allocatable, intent(out) :: error
      end subroutine first_guess

      !> Looks for a common frequency of all that moves.
      subroutine find_locking(locking, model, omega, law_dofs)
         import :: locking_t, model_t, wp
         type(locking_t), intent(out) :: locking
         type(model_t), intent(in) :: model
         real(wp), intent(in) :: omega(:)                             !! [rad/s], (n_tones), as far as known, > 0
         integer, intent(in) :: law_dofs(:)
      end subroutine find_locking
   end interface

contains

   !> Whether time integration may be used.
   pure logical function model_has_time_domain(self) result(has)
      class(model_t), intent(in) :: self

      has = self%may_integrate .and. allocated(self%callbacks%time_domain_solver)
   end function model_has_time_domain

   !> Whether a balance with this status strikes walls, and what each of them leaves of an impact is given: the motion is then
   !> found by time integration.
   logical function model_lacks_impacts_of(self, status) result(lacks)
      class(model_t), intent(in) :: self
      integer, intent(in) :: status
      type(hold_t) :: hold
      integer :: i

      lacks = .false.
      if (status /= outcome%impact) return
      do i = 1, size(self%laws)
         if (.not. self%laws(i)%law%is_multiplier) cycle
         hold = self%laws(i)%law%hold()
         if (.not. hold%is_wall) cycle
         lacks = max(hold%restitution, self%integration%restitution) >= 0.0_wp
         if (.not. lacks) return
      end do
   end function model_lacks_impacts_of
end module hb_model
