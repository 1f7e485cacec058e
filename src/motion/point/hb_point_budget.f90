!> The work of a point: its limits, which an input gives, what has been spent of them, which its `effort_t` counts, and the part of
!> the rest that a level, a search, a time integration or a refinement may take. Work is counted as in hb_solver_types%unit_of_work.
module hb_point_budget
   use hb_budget, only: budget_t
   use hb_kinds, only: wp
   use hb_motion_result, only: effort_t
   use hb_options, only: options_t
   use hb_primary_method, only: primary_method
   use hb_solver_types, only: share_of_solver
   use hb_stability, only: stability_method, work_of_verdict
   use hb_system, only: system_t
   implicit none
   private
   public :: budget_of, limit_refinement, point_budget_t, work_of_integration

   real(wp), parameter :: share_of_later_searches = 0.2_wp            ! of the work of fallbacks, for each level except the first
   real(wp), parameter :: share_of_first_level = 0.5_wp               ! of all work: a level that takes more leaves too little
   real(wp), parameter :: share_of_lines = 1.0_wp/3.0_wp              ! of time integration, under three tones or more: more
                                                                      ! rarely decides
   real(wp), parameter :: min_work_of_refinement = 5.0e7_wp           ! beyond which no level is begun for a verdict
   real(wp), parameter :: ratio_of_method = 0.5_wp*(1.0_wp/share_of_solver - 1.0_wp) ! of time integration to the fallbacks of the
                                                                      ! solver; two methods share the rest
   real(wp), parameter :: work_of_requested_method = 19.0e9_wp        ! if time integration is no fallback
   real(wp), parameter :: min_work_of_method = 0.5e9_wp               ! of time integration, at each point of a sweep

   type :: point_budget_t
      type(budget_t) :: levels                                        !! solutions on all levels
      type(budget_t) :: margin                                        !! likewise, error estimates included: beyond it no level is
                                                                      !! begun whose motion is within the tolerance
      type(budget_t) :: whole                                         !! everything, time integration included
      real(wp), private :: of_fallbacks = 0.0_wp                      ! limit of one search by the solver
      real(wp), private :: of_methods = 0.0_wp                        ! limit of two methods of time integration
      logical, private :: is_first = .true.                           ! no level is solved yet
   contains
      procedure :: of_level => point_budget_of_level
      procedure :: of_search => point_budget_of_search
      procedure :: of_record => point_budget_of_record
   end type point_budget_t

contains

   !> The budget of a point after some effort.
   pure type(point_budget_t) function budget_of(options, effort) result(self)
      type(options_t), intent(in) :: options
      class(effort_t), intent(in) :: effort

      self%levels = budget_t(options%accuracy%max_work, effort%work)
      self%margin = budget_t(options%accuracy%max_work, effort%work_spent)
      self%whole = budget_t(options%max_work(), effort%work_spent)
      self%of_fallbacks = options%solver%max_fallback_work
      self%of_methods = 2.0_wp*options%integration%max_work
      self%is_first = effort%n_levels == 0
   end function budget_of

   !> Work that a level may take: what is left, without the share of a time integration that may follow. The first takes
   !> half of it, a further search no more than all levels before it, but a share of the limit in any case.
   pure real(wp) function point_budget_of_level(self, system, options, is_search) result(work)
      class(point_budget_t), intent(in) :: self
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      logical, intent(in) :: is_search                                !! with fallbacks
      type(budget_t) :: budget

      budget = self%whole
      if (options%has_time_domain() .and. options%solver%fallback .and. options%solver%fallback_by_integration .and. &
          .not. any(system%tones%is_unknown)) budget%limit = self%levels%limit + self%of_fallbacks
      work = budget%left()
      if (self%is_first .and. options%accuracy%grows_set) work = share_of_first_level*work
      if (is_search .and. .not. self%is_first) work = max(share_of_later_searches*self%levels%limit, min(work, budget%spent))
   end function point_budget_of_level

   !> Work of the fallbacks of the solver on a level.
   pure real(wp) function point_budget_of_search(self) result(work)
      class(point_budget_t), intent(in) :: self

      work = min(self%of_fallbacks, self%levels%left())
      if (.not. self%is_first) work = share_of_later_searches*work
   end function point_budget_of_search

   !> Budget of a time integration by all methods: two may need as much.
   pure type(budget_t) function point_budget_of_record(self, integrated, decides_rarely) result(budget)
      class(point_budget_t), intent(in) :: self
      real(wp), intent(in) :: integrated                              !! work of time integrations before
      logical, intent(in) :: decides_rarely

      budget%limit = min(self%of_methods - integrated, max(self%of_methods, self%whole%limit) - self%whole%spent)
      if (decides_rarely) budget%limit = min(budget%limit, share_of_lines*self%of_methods)
   end function point_budget_of_record

   !> Limits levels that are refined for a verdict on stability alone.
   pure subroutine limit_refinement(options, effort, share)
      type(options_t), intent(inout) :: options
      class(effort_t), intent(in) :: effort
      real(wp), intent(in) :: share                                   !! of the solutions so far

      if (options%stability%method == stability_method%auto) then
         options%accuracy%max_work = work_of_verdict(effort%work_spent, min_work_of_refinement)
         options%solver%max_fallback_work = 0.0_wp                    ! a level in progress ends at the limit
      else
         options%accuracy%max_work = min(options%accuracy%max_work, max(min_work_of_refinement, share*effort%work))
      end if
   end subroutine limit_refinement

   !> Largest work of one method of time integration.
   real(wp) function work_of_integration(system, options) result(work)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options

      work = ratio_of_method*options%solver%max_fallback_work
      if (options%solver%has_max_fallback_work) return
      if (options%primary_method == primary_method%integration .or. (system%tones%n_tones > 1 .and. &
                                                                     system%has_restitution(options%integration%restitution))) &
         work = work_of_requested_method                              ! of one tone the period map finds a motion with impacts
      work = max(options%callbacks%share_of_integration*work, min_work_of_method)
   end function work_of_integration
end module hb_point_budget
