!> What the solver tries for a problem, in which order and with which budget: one table, its conditions, and nothing else.
!>
!> `attempt_rules` is the table; `plan_attempts` selects the rows that apply to a problem, and `hb_solver` makes these attempts
!> in this order until one converges. A new attempt is a row here and, if its technique is new, a case in `hb_solver`. The page
!> docs/user/convergence.md has the same table; a test compares them.
module hb_attempts
   use hb_kinds, only: wp
   use hb_solver_types, only: attempt_rule_t, fallback, starting_point, technique
   implicit none
   private
   public :: attempt_conditions_t, attempt_rules, is_fallback, plan_attempts

   integer, parameter :: max_stagnant_iterations = 10 ! without a clear gain, where other attempts remain
   real(wp), parameter :: half = 0.5_wp               ! of what remains of the budget, so that no attempt exhausts it

   !> All attempts in their order. Direct attempts without a share of the fallbacks' budget are the normal way to a solution.
   type(attempt_rule_t), parameter :: attempt_rules(9) = [ &
      attempt_rule_t("smaller_problems_first", "from a solution with fewer harmonics", fallback%none, &
                     technique%smaller_problems, starting_point%first_guess, max_stagnant_iterations, 0.0_wp, .false.), &
      attempt_rule_t("direct", "from the first guess", fallback%none, &
                     technique%direct, starting_point%first_guess, max_stagnant_iterations, 0.0_wp, .false.), &
      attempt_rule_t("other_guess", "from another first guess", fallback%other_guess, &
                     technique%direct, starting_point%other_guess, max_stagnant_iterations, half, .false.), &
      attempt_rule_t("fewer_harmonics", "from a solution with fewer harmonics", fallback%fewer_harmonics, &
                     technique%smaller_problems, starting_point%first_guess, 0, half, .false.), &
      attempt_rule_t("damping", "by homotopy in artificial damping", fallback%damping, &
                     technique%damping_homotopy, starting_point%zero, max_stagnant_iterations, half, .true.), &
      attempt_rule_t("nonlinearity_homotopy", "by homotopy in the laws", fallback%nonlinearity, &
                     technique%nonlinearity_homotopy, starting_point%linear_solution, 0, half, .true.), &
      attempt_rule_t("direct_all_iterations", "from the first guess with all iterations", fallback%none, &
                     technique%direct, starting_point%first_guess, 0, half, .true.), &
      attempt_rule_t("other_method", "by another method", fallback%other_method, &
                     technique%other_method, starting_point%first_guess, 0, half, .true.), &
      attempt_rule_t("load_homotopy", "by homotopy in the loads", fallback%load, &
                     technique%load_homotopy, starting_point%zero, 0, half, .true.)]

   !> What decides which attempts apply.
   type :: attempt_conditions_t
      logical :: has_fallbacks = .true.                               !! `fallback` of the settings; else the direct attempt alone
      logical :: continues_in_order = .true.                          !! smaller problems may be solved before
      logical :: continues_in_order_first = .false.                   !! that is the normal way to this problem
      logical :: can_be_damped = .false.                              !! the problem has an artificial damping
      logical :: affords_tangent = .true.                             !! a dense tangent fits into memory
   end type attempt_conditions_t

contains

   !> Returns the rows of `attempt_rules` that apply, in the order in which they are tried.
   pure function plan_attempts(conditions) result(plan)
      type(attempt_conditions_t), intent(in) :: conditions
      integer, allocatable :: plan(:)                                 !! rows
      integer :: i

      plan = pack([(i, i=1, size(attempt_rules))], [(applies(attempt_rules(i), conditions), i=1, size(attempt_rules))])
   end function plan_attempts

   !> Whether an attempt applies under the conditions.
   pure logical function applies(rule, conditions)
      type(attempt_rule_t), intent(in) :: rule
      type(attempt_conditions_t), intent(in) :: conditions
      logical :: begins_in_order

      begins_in_order = conditions%continues_in_order .and. conditions%continues_in_order_first
      applies = conditions%has_fallbacks .or. (rule%technique == technique%direct .and. .not. rule%has_budget())
      if (rule%needs_tangent) applies = applies .and. conditions%affords_tangent
      select case (rule%technique)
      case (technique%smaller_problems)
         applies = applies .and. conditions%continues_in_order .and. (begins_in_order .neqv. rule%has_budget())
      case (technique%damping_homotopy)
         applies = applies .and. conditions%can_be_damped
      end select
   end function applies

   !> Whether a solution that was found in this way needed a fallback: homotopy, another method, time integration. Other first
   !> guesses and smaller problems before are normal.
   elemental logical function is_fallback(kind)
      integer, intent(in) :: kind                                     !! one of hb_solver_types%fallback

      is_fallback = kind > fallback%none .and. kind /= fallback%other_guess .and. kind /= fallback%fewer_harmonics
   end function is_fallback
end module hb_attempts
