!> The model of one point of a study, with its settings.
!> The component initialisers of the types in this module and in the types it contains are the defaults of the table
!> of input keys (src/input_keys.txt). hb_model_reader reads models from an input.
module hb_model
   use hb_amplitudes, only: amplitudes_t
   use hb_bearing, only: bearing_t
   use hb_error, only: error_t
   use hb_fe_model, only: fe_model_source_t
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_law, only: hold_t, law_box_t
   use hb_load, only: load_t
   use hb_model_number, only: model_number_t, model_tie_t
   use hb_normal_mode, only: normal_mode_t
   use hb_outcome, only: outcome
   use hb_response, only: response_t
   use hb_solver_types, only: share_of_solver, solver_config_t
   use hb_stability, only: stability_config_t, stability_finder_t
   use hb_structure, only: structure_t
   use hb_structure_builder, only: structure_builder_t
   use hb_time_domain, only: integration_config_t, locking_t, primary_method, steady_motion_t
   use hb_tones, only: tones_t
   use hb_torus, only: torus_t
   implicit none
   private
   public :: accuracy_t, callbacks_t, error_estimate_config_t, gradient_config_t, model_t, share_of_integrated, symmetry, &
      time_domain_solver_t

   integer, parameter :: share_of_integrated = 4 !! sets of integrated motions are as many times larger: no tuple
                                                                      !! of theirs is an unknown

   !> Among which motions a model is solved.
   type :: symmetry_t
      integer :: auto = 1                                             !! odd motions if equations and first guess are odd
      integer :: none = 2                                             !! all
      integer :: odd = 3                                              !! odd motions; rejected if the equations are not odd
   end type symmetry_t
   type(symmetry_t), parameter :: symmetry = symmetry_t()

   !> The results that are stored.
   type :: output_config_t
      character(:), allocatable :: title
      integer, allocatable :: dofs(:)                                 !! stored degrees of freedom
      integer, allocatable :: samples(:)                              !! grid of the stored surfaces, size 0: none
   end type output_config_t

   !> The requested accuracy of a motion, if sets and grids are chosen for it, hb_accurate_motion.
   type :: accuracy_t
      logical :: is_on = .false.
      logical :: grows_set = .false.                                  !! no &harmonics group fixes the set
      logical :: refines_grid = .false.                               !! no &sampling group fixes the grid
      real(wp) :: tolerance = 1.0e-2_wp                               !! estimated error relative to the motion at the laws
      type(response_t), allocatable :: outputs(:)                     !! or relative to each of these, if there are any
      integer :: max_harmonics = 2000                                 !! tuples of a set
      integer :: max_samples = 2000000                                !! of a grid
      real(wp) :: max_work = 6.0e9_wp                                 !! of all solutions of a point, as `work` of a report
   end type accuracy_t

   !> Numbers with respect to which motions are differentiated.
   type :: gradient_config_t
      character(64), allocatable :: names(:)                          !! as given
      type(model_number_t), allocatable :: by(:)
   end type gradient_config_t

   !> Limits above which a solved point counts as inaccurate.
   type :: error_estimate_config_t
      logical :: is_on = .true.
      real(wp) :: truncation = 1.0e-2_wp                              !! largest estimated error, relative to the motion
      real(wp) :: aliasing = 1.0e-2_wp                                !! largest estimated error, relative to the motion
      real(wp) :: penetration = 1.0e-2_wp                             !! largest, relative to the largest harmonic
      real(wp) :: impact = 1.0e-2_wp                                  !! hardest impact against a rigid wall, its energy relative to
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

   !> Integrates models in time. If the cancellation of the thread (hb_cancellation) ends the integration, the
   !> procedures return an error, or nothing.
   type, abstract :: time_domain_solver_t
   contains
      procedure(find_steady_motion), deferred, nopass :: find_steady_motion
      procedure(first_guess), deferred, nopass :: first_guess
      procedure(find_locking), deferred, nopass :: find_locking
   end type time_domain_solver_t

   !> Objects of later layers that the solution of a model calls, and the purpose of its motion; the caller supplies
   !> them. Progress and cancellation belong to the thread, hb_cancellation.
   type :: callbacks_t
      class(fe_model_source_t), allocatable :: fe_models              !! source of a structure of type `model`
      class(stability_finder_t), allocatable :: stability_finder      !! not allocated: stability is not computed
      class(time_domain_solver_t), allocatable :: time_domain_solver  !! not allocated: there is no time integration
      real(wp) :: share_of_integration = 1.0_wp                       !! of a point, of the work of time integration
      logical :: is_followed = .false.                                !! the motion is the first one of a curve
   end type callbacks_t

   type :: model_t
      logical :: is_read = .false.                                    !! from an input, without an error
      type(callbacks_t) :: callbacks
      logical :: may_integrate = .true.                               !! by the time-domain solver, if there is one
      class(structure_builder_t), allocatable :: builder              !! of the structure without bearings
      type(bearing_t), allocatable :: bearings(:)
      type(structure_t) :: structure                                  !! with them
      type(tones_t) :: tones
      integer, allocatable :: phase_dofs(:)                           !! of the sines that are zero, by unknown tone; size 0:
                                                                      !! integral phase conditions
      type(normal_mode_t) :: normal_mode
      type(harmonics_t) :: harmonics
      integer :: symmetry = symmetry%auto
      type(torus_t) :: torus
      type(law_box_t), allocatable :: laws(:)
      integer, allocatable :: law_groups(:)                           !! number of the group of each law
      type(load_t), allocatable :: given_loads(:)
      type(amplitudes_t) :: loads                                     !! [N], of `harmonics`
      type(amplitudes_t) :: load_slopes                               !! their derivatives by j.omega [N s]
      logical :: has_inertia_loads = .false.                          !! some grow with the frequency
      type(load_t), allocatable :: given_starts(:)                    !! terms of the first guess
      type(amplitudes_t) :: start                                     !! their sum [m]
      type(solver_config_t) :: solver
      logical :: start_from_linear = .true.                           !! first guess: the motion without laws, otherwise zero
      logical :: start_from_integration = .false.                     !! or the end of a time integration
      type(chain_config_t) :: chain
      type(accuracy_t) :: accuracy
      type(error_estimate_config_t) :: error_estimate
      type(stability_config_t) :: stability
      type(output_config_t) :: output
      real(wp) :: memory_limit = huge(1.0_wp)                         !! bytes that this process may use
      type(integration_config_t) :: integration
      type(model_tie_t), allocatable :: ties(:)                       !! by which numbers follow others, in their order
      type(gradient_config_t) :: gradient
      integer :: primary_method = primary_method%auto                 !! to its motion, one of hb_time_domain
   contains
      procedure :: has_time_domain => model_has_time_domain
      procedure :: lacks_impacts_of => model_lacks_impacts_of
      procedure :: max_work => model_most_work
   end type model_t

   abstract interface
      !> Integrates the model until it is steady or the budget of work is exhausted. An error is one of the
      !> integration, such as a law that cannot be integrated.
      subroutine find_steady_motion(model, law_dofs, steady, error)
         import :: error_t, model_t, steady_motion_t
         type(model_t), intent(in) :: model                           !! with all tones given
         integer, intent(in) :: law_dofs(:)
         type(steady_motion_t), intent(out) :: steady
         type(error_t), allocatable, intent(out) :: error
      end subroutine find_steady_motion

      !> Returns a first guess in the form of hb_motion: coefficients at the laws, then all base frequencies. It is
      !> not allocated if the motion vanishes, or has no unknown tone.
      subroutine first_guess(model, omega, law_dofs, guess, error)
         import :: error_t, model_t, wp
         type(model_t), intent(in) :: model
         real(wp), intent(in) :: omega(:)                             !! [rad/s], (n_tones), first guesses where unknown, all > 0
         integer, intent(in) :: law_dofs(:)
         real(wp), allocatable, intent(out) :: guess(:)
         type(error_t), allocatable, intent(out) :: error
      end subroutine first_guess

      !> Searches for a common frequency of the whole motion.
      subroutine find_locking(locking, model, omega, law_dofs)
         import :: locking_t, model_t, wp
         type(locking_t), intent(out) :: locking
         type(model_t), intent(in) :: model
         real(wp), intent(in) :: omega(:)                             !! [rad/s], (n_tones), as far as known, > 0
         integer, intent(in) :: law_dofs(:)
      end subroutine find_locking
   end interface

contains

   !> Work of a point that its limits permit: that of all levels, and that of fallbacks, time integration included.
   pure real(wp) function model_most_work(self) result(work)
      class(model_t), intent(in) :: self

      work = self%accuracy%max_work + self%solver%fallback_work/share_of_solver
   end function model_most_work

   !> Whether time integration may be used.
   pure logical function model_has_time_domain(self) result(has)
      class(model_t), intent(in) :: self

      has = self%may_integrate .and. allocated(self%callbacks%time_domain_solver)
   end function model_has_time_domain

   !> Whether walls are struck in a balance with this status and all of them have a given restitution: the motion is
   !> then found by time integration.
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
