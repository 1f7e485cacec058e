!> The levels of a point that is refined to a tolerance: each is solved with the same settings, within what is left of the work,
!> in the base frequencies in which it needs the fewest samples.
module hb_level_solver
   use hb_base_change, only: base_change_t
   use hb_cancellation, only: cancellation_t, verdict
   use hb_discretisation, only: discretisation_t
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_level, only: apply_safety_factor, check_discretisation, level_t
   use hb_motion, only: solve_system
   use hb_motion_result, only: effort_t, motion_result_t
   use hb_options, only: options_t
   use hb_outcome, only: is_answer => is_solved, outcome, reason
   use hb_point_budget, only: budget_of, point_budget_t
   use hb_primary_method, only: primary_method
   use hb_stability, only: stability_method
   use hb_system, only: system_t
   use hb_thresholds, only: well_solved
   implicit none
   private
   public :: level_solver_t, solve_level, solver_tolerance

   integer, parameter :: patience_with_products = 16 ! iterations before the preconditioner becomes stronger: there are many levels
   integer, parameter :: steps_without_gain = 3                       ! steps without improvement from the level below

   !> Solves the levels of a point and counts their work.
   type, extends(effort_t) :: level_solver_t
      type(system_t), pointer :: system => null()
      type(options_t), pointer :: options => null()                   ! of the point
      type(options_t) :: level_options
      logical :: is_out_of_work = .false.                             ! the last level was ended by its limit
   contains
      procedure :: prepare => level_solver_prepare
      procedure :: solve => level_solver_solve
      procedure :: budget => level_solver_budget
   end type level_solver_t

contains

   !> Residual at which the equations of a level are solved: far below the permitted error of its motion, unless a
   !> residual was requested.
   pure real(wp) function solver_tolerance(options) result(tolerance)
      type(options_t), intent(in) :: options

      tolerance = options%solver%tolerance
      if (.not. options%solver%has_tolerance) tolerance = max(tolerance, well_solved*options%accuracy%tolerance)
   end function solver_tolerance

   !> Prepares the levels of a point.
   subroutine level_solver_prepare(self, system, options)
      class(level_solver_t), intent(inout) :: self
      type(system_t), intent(in), target :: system
      type(options_t), intent(in), target :: options

      self%system => system
      self%options => options
      self%level_options = options
      associate (level_options => self%level_options)
         level_options%primary_method = primary_method%balance
         level_options%may_integrate = .false.
         level_options%error_estimate%is_on = .true.
         level_options%solver%tolerance = solver_tolerance(options)
         level_options%solver%krylov_patience = patience_with_products
         level_options%solver%fallback_share = 0.0_wp                      ! other sets remain to be tried
         level_options%error_estimate%improvement_steps = 0
         if (size(system%laws) == 0) return                           ! the first level is the last: nothing is added to its result
         level_options%stability%method = stability_method%off
         if (allocated(level_options%output%samples)) level_options%output%samples = level_options%output%samples(:0)
      end associate
   end subroutine level_solver_prepare

   !> Solves the model on a level, starting from its motion if it has one. Afterwards the level contains a motion if
   !> the solution succeeded.
   subroutine level_solver_solve(self, level, with_fallback, result, error)
      class(level_solver_t), intent(inout) :: self
      type(level_t), intent(inout) :: level
      logical, intent(in) :: with_fallback
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      type(cancellation_t), target :: limit
      type(point_budget_t) :: budget
      real(wp), allocatable :: first_guess(:), found(:)

      call move_alloc(level%unknowns, first_guess)
      budget = self%budget()
      associate (options => self%options, solver => self%level_options%solver)
         solver%fallback = options%solver%fallback .and. with_fallback
         solver%patience = merge(0, steps_without_gain, with_fallback)
         solver%max_fallback_work = budget%of_search()
         call limit%enter(huge(1.0_wp), budget%of_level(self%system, options, with_fallback))
         call solve_level(self%system, self%level_options, level, first_guess, result, error, found)
         call limit%leave()
         result%work_spent = limit%budget%spent
         self%is_out_of_work = limit%verdict == verdict%out_of_work
         if (self%is_out_of_work) call end_level(result, error, allocated(found))
         result%n_levels = 1
         call self%add(result%effort_t)
         solver%preconditioner_level = result%preconditioner_level
         if (allocated(error)) return
         call apply_safety_factor(self%system, result)
      end associate
      if (is_answer(result%status) .and. allocated(found)) call move_alloc(found, level%unknowns)
   end subroutine level_solver_solve

   !> Solves a model on the set of a level, from a first guess if there is one, in the base that needs the fewest samples. What it
   !> returns is in the given base.
   subroutine solve_level(system, options, level, guess, result, error, found)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(level_t), intent(in) :: level
      real(wp), allocatable, intent(inout) :: guess(:)                !! unknowns as those of a level; lost
      type(motion_result_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable, intent(out) :: found(:)                  !! unknowns of the motion, if there is one
      type(base_change_t) :: base

      call base%choose(system, options, level, guess)
      if (base%is_on) then
         call check_discretisation(base%system, base%level%discretisation_t, options, error)
         if (.not. allocated(error)) &
            call solve_system(base%system, base%level%discretisation_t, options, result, error, guess, found)
         if (.not. allocated(error)) call base%bring_back(system, options, level%harmonics, result, found)
      else
         call check_discretisation(system, level%discretisation_t, options, error)
         if (.not. allocated(error)) call solve_system(system, level%discretisation_t, options, result, error, guess, found)
      end if
   end subroutine solve_level

   !> The budget of the point after the levels so far.
   pure type(point_budget_t) function level_solver_budget(self) result(budget)
      class(level_solver_t), intent(in) :: self

      budget = budget_of(self%options, self%effort_t)
   end function level_solver_budget

   !> Ends a level that its limit of work has interrupted: without a motion, or with one whose error is not known.
   subroutine end_level(result, error, has_motion)
      type(motion_result_t), intent(inout) :: result
      type(error_t), allocatable, intent(inout) :: error
      logical, intent(in) :: has_motion

      if (allocated(error)) deallocate (error)                        ! of the partial results
      result%status = merge(outcome%truncated, outcome%out_of_budget, has_motion)
      if (.not. has_motion) result%reason = reason%max_fallback_work
      result%error_estimate%truncation = 1.0_wp
   end subroutine end_level
end module hb_level_solver
