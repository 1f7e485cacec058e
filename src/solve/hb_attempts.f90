!> What is tried for a set of equations, a motion, a point and the start of a curve, in which order, under which conditions and
!> with which budget: one table, its conditions, and the driver that makes the attempts and records them.
!>
!> `attempt_rules` is the table. Its stages are nested: the start of a curve is a point, a point needs motions on given sets, and
!> a motion is the solution of equations. `make_attempts` makes the attempts of one stage for an object that extends `attempts_t`;
!> the conditions of the stage (`permit`) decide which of them apply, `row_after` where to go on. A new attempt is a row here, its
!> number in `attempt_row`, its condition in `permit` of its stage, and a case in `make` of the object of its stage: hb_motion,
!> hb_accurate_motion, hb_curve_runner; for the solver, if it does something new, a component of `technique_t` and a case in
!> `proceed` of hb_solver, and if it starts elsewhere, one of `starting_point_t` and a case in `start_of`. What a condition of
!> the solver needs is a component of `solver_conditions_t`, set in `conditions_of`. `kind` is an existing `fallback`, unless
!> result files must tell it apart. The page docs/user/convergence.md has the same table; tests compare them, and assert what is
!> tried next after which failures.
module hb_attempts
   use hb_kinds, only: wp
   use hb_outcome, only: is_integrated, is_lost, outcome, outcome_name
   use hb_solver_types, only: attempt_t, fallback
   use hb_text, only: rounded
   implicit none
   private
   public :: attempt_row, attempt_rule_t, attempt_rules, attempts_t, describe_attempts, is_fallback, make_attempts
   public :: motion_conditions_t, point_conditions_t, row_after, row_of, solver_conditions_t, stage, starting_point, technique

   integer, parameter :: max_stagnant_iterations = 10 ! without a clear gain, where other attempts remain
   real(wp), parameter :: half_share = 0.5_wp         ! of what remains of the budget, so that no attempt exhausts it
   real(wp), parameter :: quarter_share = 0.25_wp     ! of the budget, for the time integration of a first guess

   !> What attempts are for; each stage makes those of the stages before it.
   type :: stage_t
      integer :: solver = 1                                           !! a solution of equations
      integer :: motion = 2                                           !! a motion on a given set of harmonics
      integer :: point = 3                                            !! a motion to a tolerance
      integer :: curve = 4                                            !! the start of a curve
   end type stage_t
   type(stage_t), parameter :: stage = stage_t()

   !> How an attempt proceeds.
   type :: technique_t
      integer :: direct = 1                                           !! the method of the settings from the start
      integer :: other_method = 2                                     !! Broyden's after Newton's, or the other way round
      integer :: smaller_problems = 3                                 !! the smallest one by all attempts, larger ones from it
      integer :: damping_homotopy = 4                                 !! artificial damping that is reduced to zero
      integer :: nonlinearity_homotopy = 5                            !! along a factor of all laws
      integer :: load_homotopy = 6                                    !! along a factor of all loads
      integer :: balance = 7                                          !! harmonic balance, by the attempts of the stages below
      integer :: integration = 8                                      !! in time, until the motion is steady
   end type technique_t
   type(technique_t), parameter :: technique = technique_t()

   !> Where an attempt of the solver starts.
   type :: starting_point_t
      integer :: first_guess = 1                                      !! the one that was given
      integer :: linear_solution = 2                                  !! of the problem without its nonlinearity
      integer :: zero = 3
      integer :: other_guess = 4                                      !! zero if the linear solution was given, else that
   end type starting_point_t
   type(starting_point_t), parameter :: starting_point = starting_point_t()

   !> The rows of `attempt_rules`, and what else can follow an attempt.
   type :: attempt_row_t
      integer :: next = -1                                            !! the row below, if it belongs to the same stage
      integer :: none = 0
      integer :: smaller_problems_first = 1
      integer :: direct = 2
      integer :: other_guess = 3
      integer :: fewer_harmonics = 4
      integer :: damping = 5
      integer :: nonlinearity_homotopy = 6
      integer :: direct_all_iterations = 7
      integer :: other_method = 8
      integer :: load_homotopy = 9
      integer :: integration_first = 10
      integer :: odd_set = 11
      integer :: whole_set = 12
      integer :: integration = 13
      integer :: from_integration = 14
      integer :: lines_first = 15
      integer :: set_of_neighbour = 16
      integer :: first_set = 17
      integer :: larger_first_set = 18
      integer :: smaller_first_set = 19
      integer :: integrated_guess = 20
      integer :: lines = 21
      integer :: refinement = 22
      integer :: without_neighbour = 23
      integer :: refinement_integrated = 24
      integer :: lines_from_motion = 25
      integer :: refinement_of_lines = 26
      integer :: finer_for_stability = 27
      integer :: start = 28
      integer :: other_end = 29
      integer :: start_integrated = 30
   end type attempt_row_t
   type(attempt_row_t), parameter :: attempt_row = attempt_row_t()

   !> A row of the table of attempts.
   type :: attempt_rule_t
      integer :: row = attempt_row%none                               !! its own, one of `attempt_row`
      character(22) :: name = ""                                      !! as the result file has it
      integer :: kind = fallback%none                                 !! one of `fallback`, as the result file has it
      integer :: technique = technique%balance
      integer :: start = starting_point%first_guess
      integer :: max_stagnant_iterations = 0                          !! without a clear gain; 0: no limit
      real(wp) :: share = 0.0_wp                                      !! of the work that it may use: of what is left for the
                                                                      !! fallbacks of a solver, of all that is permitted for them
                                                                      !! (guesses by integration), of the work of the point so far
                                                                      !! (verdicts); 0: not limited by it
      logical :: needs_tangent = .false.                              !! a dense one
      integer :: stage = stage%solver
      integer :: on_success = attempt_row%none                        !! the attempt that follows: one of `attempt_row`
      integer :: on_failure = attempt_row%next
   contains
      procedure :: has_budget => attempt_rule_has_budget
   end type attempt_rule_t

   !> All attempts, stage by stage, in their order. Attempts of the solver without a share of the fallbacks' budget are the normal
   !> way to a solution. Time integrations without one have what the solver leaves of it, see `share_of_solver`.
   type(attempt_rule_t), parameter :: attempt_rules(*) = [ &
      attempt_rule_t(attempt_row%smaller_problems_first, "smaller_problems_first", fallback%none, &
                     technique%smaller_problems, starting_point%first_guess, max_stagnant_iterations, 0.0_wp, .false.), &
      attempt_rule_t(attempt_row%direct, "direct", fallback%none, &
                     technique%direct, starting_point%first_guess, max_stagnant_iterations, 0.0_wp, .false.), &
      attempt_rule_t(attempt_row%other_guess, "other_guess", fallback%other_guess, &
                     technique%direct, starting_point%other_guess, max_stagnant_iterations, half_share, .false.), &
      attempt_rule_t(attempt_row%fewer_harmonics, "fewer_harmonics", fallback%fewer_harmonics, &
                     technique%smaller_problems, starting_point%first_guess, 0, half_share, .false.), &
      attempt_rule_t(attempt_row%damping, "damping", fallback%damping, &
                     technique%damping_homotopy, starting_point%zero, max_stagnant_iterations, half_share, .true.), &
      attempt_rule_t(attempt_row%nonlinearity_homotopy, "nonlinearity_homotopy", fallback%nonlinearity, &
                     technique%nonlinearity_homotopy, starting_point%linear_solution, 0, half_share, .true.), &
      attempt_rule_t(attempt_row%direct_all_iterations, "direct_all_iterations", fallback%none, &
                     technique%direct, starting_point%first_guess, 0, half_share, .true.), &
      attempt_rule_t(attempt_row%other_method, "other_method", fallback%other_method, &
                     technique%other_method, starting_point%first_guess, 0, half_share, .true.), &
      attempt_rule_t(attempt_row%load_homotopy, "load_homotopy", fallback%load, &
                     technique%load_homotopy, starting_point%zero, 0, half_share, .true.), &
      !
      attempt_rule_t(attempt_row%integration_first, "integration_first", technique=technique%integration, stage=stage%motion), &
      attempt_rule_t(attempt_row%odd_set, "odd_set", stage=stage%motion, on_success=attempt_row%integration), &
      attempt_rule_t(attempt_row%whole_set, "whole_set", stage=stage%motion), &
      attempt_rule_t(attempt_row%integration, "integration", technique=technique%integration, stage=stage%motion, &
                     on_success=attempt_row%next, on_failure=attempt_row%none), &
      attempt_rule_t(attempt_row%from_integration, "from_integration", kind=fallback%integration, stage=stage%motion), &
      !
      attempt_rule_t(attempt_row%lines_first, "lines_first", technique=technique%integration, stage=stage%point), &
      attempt_rule_t(attempt_row%set_of_neighbour, "set_of_neighbour", stage=stage%point, on_success=attempt_row%refinement), &
      attempt_rule_t(attempt_row%first_set, "first_set", stage=stage%point, on_success=attempt_row%refinement), &
      attempt_rule_t(attempt_row%larger_first_set, "larger_first_set", stage=stage%point, on_success=attempt_row%refinement), &
      attempt_rule_t(attempt_row%smaller_first_set, "smaller_first_set", stage=stage%point, on_success=attempt_row%refinement), &
      attempt_rule_t(attempt_row%integrated_guess, "integrated_guess", kind=fallback%integration, share=quarter_share, &
                     stage=stage%point, on_success=attempt_row%refinement), &
      attempt_rule_t(attempt_row%lines, "lines", technique=technique%integration, stage=stage%point, on_failure=attempt_row%none), &
      attempt_rule_t(attempt_row%refinement, "refinement", stage=stage%point, on_success=attempt_row%finer_for_stability), &
      attempt_rule_t(attempt_row%without_neighbour, "without_neighbour", stage=stage%point), &
      attempt_rule_t(attempt_row%refinement_integrated, "refinement_integrated", kind=fallback%integration, share=quarter_share, &
                     stage=stage%point), &
      attempt_rule_t(attempt_row%lines_from_motion, "lines_from_motion", technique=technique%integration, stage=stage%point, &
                     on_success=attempt_row%next, on_failure=attempt_row%none), &
      attempt_rule_t(attempt_row%refinement_of_lines, "refinement_of_lines", kind=fallback%integration, stage=stage%point, &
                     on_failure=attempt_row%none), &
      attempt_rule_t(attempt_row%finer_for_stability, "finer_for_stability", share=4.0_wp, stage=stage%point, &
                     on_failure=attempt_row%none), &
      !
      attempt_rule_t(attempt_row%start, "start", stage=stage%curve), &
      attempt_rule_t(attempt_row%other_end, "other_end", stage=stage%curve), &
      attempt_rule_t(attempt_row%start_integrated, "start_integrated", technique=technique%integration, stage=stage%curve)]

   !> What decides which attempts of the solver apply.
   type :: solver_conditions_t
      logical :: has_fallbacks = .true.                               !! `fallback` of the settings; else the direct attempt alone
      logical :: continues_in_order = .true.                          !! smaller problems may be solved before
      logical :: continues_in_order_first = .false.                   !! that is the normal way to this problem
      logical :: can_be_damped = .false.                              !! the problem has an artificial damping
      logical :: affords_tangent = .true.                             !! a dense tangent fits into memory
   contains
      procedure :: permit => solver_conditions_permit
   end type solver_conditions_t

   !> What decides which attempts at a motion on a given set apply.
   type :: motion_conditions_t
      logical :: may_integrate = .false.                              !! in time: all tones are given
      logical :: integrates_first = .false.                           !! the settings prefer it, and there is no first guess
      logical :: integrates_last = .false.                            !! the settings permit it as a fallback
      logical :: has_odd_set = .false.                                !! the equations permit odd tuples alone
      integer :: status = outcome%pending                             !! of the attempts so far
      logical :: is_struck = .false.                                  !! their motion strikes walls with a given restitution
   contains
      procedure :: permit => motion_conditions_permit
   end type motion_conditions_t

   !> What decides which attempts at a motion to a tolerance apply.
   type :: point_conditions_t
      logical :: may_integrate = .false.                              !! in time
      logical :: integrates_first = .false.                           !! the settings prefer it, or it is cheaper
      logical :: integrates_last = .false.                            !! the settings permit it as a fallback
      logical :: integrates_unknown_tone = .false.                    !! likewise, to find a limit cycle
      logical :: grows_set = .true.                                   !! the set of harmonics is not given
      logical :: has_laws = .true.
      logical :: has_neighbour = .false.                              !! in a chain
      logical :: is_within_another = .false.                          !! these attempts belong to `finer_for_stability`
      integer :: status = outcome%pending                             !! of the attempts so far
      logical :: has_motion = .false.                                 !! they have found a motion of the balance
      logical :: is_struck = .false.                                  !! which strikes walls with a given restitution
      logical :: is_unstable = .false.
      logical :: lacks_stability = .false.                            !! its errors leave the stability undecided
      logical :: is_out_of_work = .false.                             !! the budget of all levels is exhausted
      logical :: is_cancelled = .false.                               !! or the time
   contains
      procedure :: permit => point_conditions_permit
   end type point_conditions_t

   !> An object that can make the attempts of a stage, and what it has made.
   type, abstract :: attempts_t
      type(attempt_t), allocatable :: made(:)                         !! in their order, each before those within it
   contains
      procedure(applies), deferred :: applies
      procedure(make_one), deferred :: make
      procedure(is_over), deferred :: is_over
   end type attempts_t

   abstract interface
      !> Whether an attempt can be made now.
      logical function applies(self, rule)
         import :: attempt_rule_t, attempts_t
         class(attempts_t), intent(inout) :: self
         type(attempt_rule_t), intent(in) :: rule
      end function applies

      !> Makes an attempt.
      subroutine make_one(self, rule, attempt, within)
         import :: attempt_rule_t, attempt_t, attempts_t
         class(attempts_t), intent(inout) :: self
         type(attempt_rule_t), intent(in) :: rule
         type(attempt_t), intent(inout) :: attempt                    !! its outcome; `pending`: it was not made after all
         type(attempt_t), allocatable, intent(out) :: within(:)       !! attempts that were made within it, if it was made
      end subroutine make_one

      !> Whether no further attempt is made, whatever the table says: the work was cancelled, or there was an error.
      logical function is_over(self)
         import :: attempts_t
         class(attempts_t), intent(inout) :: self
      end function is_over
   end interface

contains

   !> Whether the attempt shares the budget of fallbacks.
   pure logical function attempt_rule_has_budget(self)
      class(attempt_rule_t), intent(in) :: self

      attempt_rule_has_budget = self%share > 0.0_wp
   end function attempt_rule_has_budget

   !> Makes the attempts of a stage, in the order of the table, and records them. One that does not apply counts as a failure.
   recursive subroutine make_attempts(self, of_stage)
      class(attempts_t), intent(inout) :: self
      integer, intent(in) :: of_stage                                 !! one of `stage`
      type(attempt_t) :: attempt
      type(attempt_t), allocatable :: within(:)
      integer :: row

      if (allocated(self%made)) deallocate (self%made)
      allocate (self%made(0))
      row = findloc(attempt_rules%stage, of_stage, dim=1)
      do while (row > 0)
         if (.not. self%applies(attempt_rules(row))) then
            row = row_after(row, .false.)
            cycle
         end if
         attempt = attempt_t(rule=row)
         call self%make(attempt_rules(row), attempt, within)
         if (attempt%status /= outcome%pending) self%made = [self%made, attempt]
         if (allocated(within)) then
            within%depth = within%depth + 1
            self%made = [self%made, within]
         end if
         if (self%is_over()) return
         row = row_after(row, attempt%has_succeeded)
      end do
   end subroutine make_attempts

   !> Returns the row that follows an attempt; 0: none.
   pure integer function row_after(row, has_succeeded) result(next)
      integer, intent(in) :: row                                      !! of `attempt_rules`
      logical, intent(in) :: has_succeeded

      next = merge(attempt_rules(row)%on_success, attempt_rules(row)%on_failure, has_succeeded)
      if (next == attempt_row%next) next = row_below(row)
   end function row_after

   !> Returns the next row of the same stage; 0: none.
   pure integer function row_below(row) result(next)
      integer, intent(in) :: row

      next = row + 1
      if (next > size(attempt_rules)) then
         next = 0
      else if (attempt_rules(next)%stage /= attempt_rules(row)%stage) then
         next = 0
      end if
   end function row_below

   !> Returns the row of a name; 0: there is none.
   pure integer function row_of(name)
      character(*), intent(in) :: name

      row_of = findloc(attempt_rules%name, name, dim=1)
   end function row_of

   !> Describes attempts in one line: the name of each with its outcome, in parentheses those within it, and the least residual of
   !> those of the solver that failed, such as
   !> `first_set converged (whole_set converged (direct stalled at 0.03, other_guess converged)), refinement converged`.
   pure subroutine describe_attempts(made, text)
      type(attempt_t), intent(in) :: made(:)                          !! as in `attempts_t`
      character(:), allocatable, intent(out) :: text
      type(attempt_rule_t) :: rule
      integer :: depth, i

      text = ""
      depth = 0
      do i = 1, size(made)
         rule = attempt_rules(made(i)%rule)
         if (made(i)%depth > depth) then
            text = text//" "//repeat("(", made(i)%depth - depth)
         else if (i > 1) then
            text = text//repeat(")", depth - made(i)%depth)//", "
         end if
         depth = made(i)%depth
         text = text//trim(rule%name)//" "//outcome_name(made(i)%status)
         if (made(i)%status /= outcome%converged .and. made(i)%best < huge(1.0_wp)) text = text//" at "//rounded(made(i)%best)
      end do
      text = text//repeat(")", depth)
   end subroutine describe_attempts

   !> Whether an attempt of the solver applies under the conditions.
   pure logical function solver_conditions_permit(self, rule) result(permit)
      class(solver_conditions_t), intent(in) :: self
      type(attempt_rule_t), intent(in) :: rule
      logical :: begins_in_order

      begins_in_order = self%continues_in_order .and. self%continues_in_order_first
      permit = rule%stage == stage%solver .and. (self%has_fallbacks .or. &
                                                 (rule%technique == technique%direct .and. .not. rule%has_budget()))
      if (rule%needs_tangent) permit = permit .and. self%affords_tangent
      select case (rule%technique)
      case (technique%smaller_problems)
         permit = permit .and. self%continues_in_order .and. (begins_in_order .neqv. rule%has_budget())
      case (technique%damping_homotopy)
         permit = permit .and. self%can_be_damped
      end select
   end function solver_conditions_permit

   !> Whether an attempt at a motion on a given set applies under the conditions.
   pure logical function motion_conditions_permit(self, rule) result(permit)
      class(motion_conditions_t), intent(in) :: self
      type(attempt_rule_t), intent(in) :: rule

      select case (rule%row)
      case (attempt_row%integration_first)
         permit = self%may_integrate .and. self%integrates_first
      case (attempt_row%odd_set)
         permit = self%has_odd_set
      case (attempt_row%integration)
         permit = self%may_integrate .and. self%integrates_last .and. (self%is_struck .or. is_lost(self%status))
      case default
         permit = rule%stage == stage%motion
      end select
   end function motion_conditions_permit

   !> Whether an attempt at a motion to a tolerance applies under the conditions.
   pure logical function point_conditions_permit(self, rule) result(permit)
      class(point_conditions_t), intent(in) :: self
      type(attempt_rule_t), intent(in) :: rule
      logical :: may_search, may_repeat

      may_search = self%grows_set .and. self%has_laws .and. .not. self%has_motion .and. &
                   all(self%status /= [outcome%collapsed, outcome%no_motion, outcome%locked, outcome%failed])
      may_repeat = self%status == outcome%truncated .and. &
                   .not. (self%is_within_another .or. self%is_out_of_work .or. self%is_cancelled)
      select case (rule%row)
      case (attempt_row%lines_first)
         permit = self%may_integrate .and. self%integrates_first .and. .not. self%has_neighbour
      case (attempt_row%set_of_neighbour)
         permit = self%has_neighbour
      case (attempt_row%first_set)
         permit = .not. self%has_motion
      case (attempt_row%larger_first_set)
         permit = may_search .and. .not. self%is_out_of_work
      case (attempt_row%smaller_first_set)
         permit = may_search
      case (attempt_row%integrated_guess)
         permit = self%integrates_unknown_tone .and. .not. self%has_motion .and. &
                  (is_lost(self%status) .or. any(self%status == [outcome%no_motion, outcome%truncated]))
      case (attempt_row%lines)
         permit = self%may_integrate .and. .not. self%has_motion .and. &
                  (is_integrated(self%status) .or. (is_lost(self%status) .and. self%integrates_last))
      case (attempt_row%refinement, attempt_row%refinement_of_lines)
         permit = self%has_motion
      case (attempt_row%without_neighbour)
         permit = may_repeat .and. self%has_neighbour
      case (attempt_row%refinement_integrated)
         permit = may_repeat .and. self%integrates_unknown_tone .and. self%grows_set
      case (attempt_row%lines_from_motion)
         permit = self%may_integrate .and. self%has_motion .and. &
                  (self%is_struck .or. (self%status == outcome%truncated .and. .not. self%is_unstable))
      case (attempt_row%finer_for_stability)
         permit = self%lacks_stability .and. self%grows_set .and. .not. (self%is_within_another .or. self%is_cancelled)
      case default
         permit = .false.
      end select
   end function point_conditions_permit

   !> Whether a solution that was found in this way needed a fallback: homotopy, another method, time integration. Other first
   !> guesses and smaller problems before are normal.
   elemental logical function is_fallback(kind)
      integer, intent(in) :: kind                                     !! one of hb_solver_types%fallback

      is_fallback = kind > fallback%none .and. kind /= fallback%other_guess .and. kind /= fallback%fewer_harmonics
   end function is_fallback
end module hb_attempts
