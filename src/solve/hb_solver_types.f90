!> Settings and reports of all solvers.
module hb_solver_types
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_outcome, only: outcome
   implicit none
   private
   public :: attempt_t, fallback, fallback_names, largest_affordable, method, report_t, share_of_solver
   public :: solver_config_t, unit_of_work

   type :: method_t
      integer :: auto = 1                                             !! numbers as the order of the table of input keys
      integer :: newton = 2
      integer :: krylov = 3
      integer :: broyden = 4
   end type method_t
   type(method_t), parameter :: method = method_t()

   real(wp), parameter :: clear_gain = 0.7_wp                         ! least norm, relative to the least one before
   !> Work is counted, never measured, so that no result depends on the machine. One of work is about a nanosecond of a processor,
   !> in solvers, time integration and stability alike; inputs give it in this unit, about a second.
   real(wp), parameter :: unit_of_work = 1.0e9_wp
   real(wp), parameter :: share_of_solver = 1.0_wp/3.0_wp             !! of the work of all fallbacks, the rest: time integration
   integer, parameter :: largest_affordable = 10000                   !! unknowns up to which a dense tangent fits at all, in 0.8 GB

   !> What was needed beside the direct attempt; numbers as in the result file.
   type :: fallback_t
      integer :: none = 0
      integer :: other_guess = 1                                      !! from zero, or from the linear motion
      integer :: other_method = 2                                     !! Broyden after Newton, or the other way round
      integer :: nonlinearity = 3                                     !! homotopy in the strength of the laws
      integer :: load = 4                                             !! homotopy in the loads
      integer :: fewer_harmonics = 5                                  !! from the solution of a smaller problem
      integer :: integration = 6                                      !! from a time-integrated motion
      integer :: damping = 7                                          !! artificial damping, less and less of it
   end type fallback_t
   type(fallback_t), parameter :: fallback = fallback_t()
   character(*), parameter :: fallback_names(0:7) = [character(22) :: &
      "none", "other_guess", "other_method", "nonlinearity_homotopy", "load_homotopy", "fewer_harmonics", "integration", "damping"]

   !> Settings of a solver; the component initialisers are the defaults of the program.
   type :: solver_config_t
      integer :: method = method%auto
      real(wp) :: tolerance = 1.0e-12_wp                              !! norm of the residual relative to the forces
      logical :: has_tolerance = .false.                              !! it was requested, whatever else is
      logical :: has_max_fallback_work = .false.                          !! likewise
      integer :: max_iterations = 100
      integer :: patience = 0                                         !! iterations that may gain nothing; 0: all
      logical :: continues_in_order = .true.                          !! from fewer harmonics first, where that pays
      logical :: line_search = .true.
      logical :: repeats_tangent = .true.                             !! Newton: steps with the factors at hand, where that will do
      integer :: memory = 40                                          !! updates of Broyden's method before a new tangent
      logical :: start_with_tangent = .false.                         !! Broyden's first Jacobian: tangent, else linear part
      logical :: fallback = .true.                                    !! try fallbacks if the direct attempt fails
      logical :: fallback_by_integration = .true.                     !! and time integration if none of them finds a motion
      integer :: krylov_vectors = 150                                 !! of GMRES until it restarts
      integer :: krylov_patience = 100                                !! products until the preconditioner gets stronger, at least
      integer :: krylov_products = 1000                               !! with the tangent, at most, for one step
      integer :: preconditioner_level = 0                             !! that solutions from products begin with
      integer :: homotopy_iterations = 500                            !! of all corrections together
      real(wp) :: max_fallback_work = 1.5e9_wp                            !! of all fallbacks, as `work` of a report
      real(wp) :: fallback_share = 4.0_wp                             !! at least so many times that of the direct attempt
      real(wp) :: max_work = huge(1.0_wp)                           !! of the attempt that gets these settings
      real(wp) :: time_limit = huge(1.0_wp)                           !! of the processor, for one point [s]
      integer :: n_threads = 1                                        !! that share the work of a large point
   end type solver_config_t

   !> An attempt and its outcome.
   type :: attempt_t
      integer :: rule = 0                                             !! row of hb_attempts%attempt_rules
      integer :: status = outcome%pending                             !! one of hb_outcome%outcome
      integer :: iterations = 0
      real(wp) :: best = huge(1.0_wp)                                 !! least norm of the residual, relative
      logical :: is_out_of_work = .false.                             !! its budget of work came first
      logical :: was_falling = .false.                                !! the residual fell to the end, by a factor of ten or more
      logical :: has_succeeded = .false.                              !! the table goes on with `on_success`
      integer :: depth = 0                                            !! attempts that this one is part of
   end type attempt_t

   !> How a solution was found, or not.
   type :: report_t
      integer :: status = outcome%pending                             !! one of hb_outcome%outcome
      integer :: iterations = 0
      integer :: evaluations = 0                                      !! of the residual
      integer :: levels = 0                                           !! smaller problems solved before
      integer :: factorizations = 0                                   !! of a tangent
      integer :: products = 0                                         !! with a tangent
      integer :: fallback = fallback%none                             !! what led to the solution
      real(wp) :: work = 0.0_wp                                       !! see `unit_of_work`
      real(wp) :: residual = huge(1.0_wp)                             !! last norm, relative
      real(wp) :: first = -1.0_wp                                     !! first norm, relative; negative: none
      real(wp) :: best = huge(1.0_wp)                                 !! least norm, relative
      integer, private :: last_gain = 0                               ! iterations up to the last clear gain
      real(wp), private :: best_then = huge(1.0_wp)                   ! least norm there
      logical :: is_out_of_work = .false.                             !! the budget of work came first
      type(error_t), allocatable :: error                             !! why the problem could not be solved, see hb_problem
      type(attempt_t), allocatable :: attempts(:)                     !! that were made, in their order
   contains
      procedure :: add => report_add
      procedure :: adopt_outcome => report_adopt_outcome
      procedure :: adopt => report_adopt
      procedure :: note => report_note
      procedure :: gains_nothing => report_gains_nothing
      procedure :: as_attempt => report_as_attempt
   end type report_t

contains

   !> Adds the work of another report to this one; the first error stays.
   pure subroutine report_add(self, other)
      class(report_t), intent(inout) :: self
      type(report_t), intent(in) :: other

      self%iterations = self%iterations + other%iterations
      self%evaluations = self%evaluations + other%evaluations
      self%factorizations = self%factorizations + other%factorizations
      self%products = self%products + other%products
      self%work = self%work + other%work
      if (allocated(other%error) .and. .not. allocated(self%error)) self%error = other%error
   end subroutine report_add

   !> Adds the work of an attempt to this report and takes over its outcome.
   pure subroutine report_adopt(self, attempt)
      class(report_t), intent(inout) :: self
      type(report_t), intent(in) :: attempt

      call self%add(attempt)
      self%status = attempt%status
      self%residual = attempt%residual
      self%best = min(self%best, attempt%best)
      self%is_out_of_work = attempt%is_out_of_work
   end subroutine report_adopt

   !> Adopts the outcome of an attempt whose work has been added.
   pure subroutine report_adopt_outcome(self, attempt)
      class(report_t), intent(inout) :: self
      type(report_t), intent(in) :: attempt

      self%status = attempt%status
      self%residual = attempt%residual
      self%first = attempt%first
      self%best = attempt%best
      self%is_out_of_work = attempt%is_out_of_work
      self%levels = attempt%levels
      self%fallback = attempt%fallback
   end subroutine report_adopt_outcome

   !> Notes the norm of the point reached.
   pure subroutine report_note(self)
      class(report_t), intent(inout) :: self

      if (ieee_is_nan(self%residual)) return
      if (self%first < 0.0_wp) self%first = self%residual
      self%best = min(self%best, self%residual)
      if (self%best > clear_gain*self%best_then) return
      self%best_then = self%best
      self%last_gain = self%iterations
   end subroutine report_note

   !> Whether the last `patience` iterations have not brought the norm down clearly; 0: patience has no end.
   pure logical function report_gains_nothing(self, patience)
      class(report_t), intent(in) :: self
      integer, intent(in) :: patience

      report_gains_nothing = patience > 0 .and. self%iterations - self%last_gain >= patience
   end function report_gains_nothing

   !> What is stored of an attempt.
   pure type(attempt_t) function report_as_attempt(self, rule) result(attempt)
      class(report_t), intent(in) :: self
      integer, intent(in) :: rule                                     !! row of hb_attempts%attempt_rules
      real(wp) :: last

      last = huge(last)
      if (.not. ieee_is_nan(self%residual)) last = self%residual
      attempt = attempt_t(rule, self%status, self%iterations, min(self%best, last), self%is_out_of_work, &
                          last <= self%best .and. last < 0.1_wp*self%first, self%status == outcome%converged)
   end function report_as_attempt
end module hb_solver_types
