!> Advice on a search that has found no motion, from the outcomes of the attempts and from properties that make a model difficult:
!> contact much stiffer than the structure, sliders that hardly slide, steep friction, nearly commensurate tones.
module hb_search_advice
   use hb_advice, only: advice, advice_list_t, n_advice
   use hb_attempts, only: attempt_rules, technique
   use hb_balance, only: balance_t
   use hb_error_estimate, only: near_commensurate
   use hb_kinds, only: wp
   use hb_law, only: law_t
   use hb_numbers, only: number_t
   use hb_options, only: options_t
   use hb_outcome, only: outcome, reason
   use hb_solver_types, only: report_t
   use hb_system, only: system_t
   implicit none
   private
   public :: advise_on_search, circumstances_t, find_circumstances, limit_of

   real(wp), parameter :: min_contact_ratio = 100.0_wp   ! contact relative to the structure: lower limit of a difficult model
   real(wp), parameter :: max_slip_ratio = 1.5_wp                     ! motion relative to the sticking displacement of a slider
   real(wp), parameter :: min_speed_ratio = 1.0e4_wp                  ! speed relative to that over which friction is smoothed
   character(*), parameter :: smoothing(2) = [character(13) :: "velocity", "slip_velocity"]        ! keys of this speed [m/s]
   real(wp), parameter :: closed_contact_ratio = 1.0e3_wp ! motion relative to a law's length at which its contact is closed

   !> Properties that make a model difficult, as far as known.
   type :: circumstances_t
      integer :: contact = 0                                          !! number of the stiffest law
      real(wp) :: stiffness_ratio = 0.0_wp !! its stiffness relative to that of the structure at its coordinate
      integer :: slider = 0                                           !! number of the law that slides least
      real(wp) :: slip_ratio = huge(1.0_wp)                           !! its motion relative to its sticking displacement
      integer :: friction = 0                                         !! number of the law with the steepest smoothed friction
      real(wp) :: smoothing = 1.0_wp, speed = 0.0_wp                  !! over which it is smoothed, and that of the motion [m/s]
      integer, allocatable :: combination(:)                          !! of tones, nearly zero; not allocated: none
      real(wp) :: combination_frequency = 0.0_wp                      !! [rad/s]
      logical :: is_neighbour_used = .false.                          !! first guesses already come from neighbours
      logical :: is_integration_used = .false.                        !! or from time integration, or that follows by itself
      logical :: has_fallbacks = .false.                              !! the settings permit other methods
   end type circumstances_t

contains

   !> Examines a model and the last iterate, on its balance.
   subroutine find_circumstances(system, options, balance, u, found)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(balance_t), intent(inout) :: balance
      real(wp), intent(in) :: u(:, :)                                 !! [m], (n_coefficients, n_dofs)
      type(circumstances_t), intent(out) :: found
      real(wp) :: frequency, length, ratio
      integer :: i
      integer, allocatable :: combination(:)

      found%is_neighbour_used = options%chain%is_on
      found%is_integration_used = options%start%from_integration .or. is_integrated(system, options)
      found%has_fallbacks = options%solver%fallback
      call balance%sample(u)
      do i = 1, size(system%laws)
         associate (law => system%laws(i)%law, set => balance%law_set)
            length = law%length_scale
            if (law%needs_velocity) call find_friction(i, law, maxval(abs(set%coordinates_of(i, set%samples%v%values))), found)
            if (law%n_states > 0) then
               if (length <= 0.0_wp) cycle
               ratio = maxval(abs(set%coordinates_of(i, set%samples%q%values)))/length
               if (ratio >= found%slip_ratio) cycle
               found%slip_ratio = ratio
               found%slider = i
            else
               ratio = stiffness_of(law, length)*balance%compliance_of_law(i)
               if (ratio <= found%stiffness_ratio) cycle
               found%stiffness_ratio = ratio
               found%contact = i
            end if
         end associate
      end do
      if (system%tones%n_tones < 2 .or. any(system%tones%is_unknown)) return
      call near_commensurate(system%tones, combination, frequency)
      if (frequency > options%error_estimate%commensurability*maxval(system%tones%omega)) return
      found%combination = combination
      found%combination_frequency = frequency
   end subroutine find_circumstances

   !> Keeps a law if its friction is smoothed over a smaller part of the speed of its coordinates than that of others.
   subroutine find_friction(number, given, speed, found)
      integer, intent(in) :: number                                   !! of the law
      class(law_t), intent(in) :: given
      real(wp), intent(in) :: speed                                   !! [m/s]
      type(circumstances_t), intent(inout) :: found
      class(law_t), allocatable :: law
      type(number_t), allocatable :: numbers(:)
      real(wp) :: value
      logical :: is_found
      integer :: i

      allocate (law, source=given)
      call law%list_numbers(numbers)
      do i = 1, size(numbers)
         if (.not. any(numbers(i)%key == smoothing)) cycle
         call law%find_number(numbers(i), value, is_found)
         if (.not. is_found .or. value <= 0.0_wp) cycle
         if (speed/value <= found%speed/found%smoothing) cycle
         found%friction = number
         found%smoothing = value
         found%speed = speed
      end do
   end subroutine find_friction

   !> Whether a time integration follows by itself where the balance finds no motion, or is not possible.
   pure logical function is_integrated(system, options)
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      logical :: is_unknown

      is_unknown = any(system%tones%is_unknown)
      is_integrated = options%solver%fallback .and. options%solver%fallback_by_integration .and. &
                      allocated(options%callbacks%time_domain_solver)
      if (is_unknown) is_integrated = is_integrated .and. options%accuracy%is_on .and. system%tones%n_tones == 1
      is_integrated = is_integrated .or. system%normal_mode%is_requested
   end function is_integrated

   !> Largest slope of a nonsmooth law, far on either side of each of its coordinates; 0 for other laws, which have no
   !> length of their own or must not be evaluated far from their motion.
   real(wp) function stiffness_of(law, length) result(stiffness)
      class(law_t), intent(in) :: law
      real(wp), intent(in) :: length                                  !! of the law [m], 0: none
      real(wp), allocatable, dimension(:, :) :: f, p, v, z
      real(wp), allocatable, dimension(:, :, :) :: df_dp, df_dv, df_dz
      integer :: i, n

      stiffness = 0.0_wp
      if (law%degree > 0 .or. law%is_multiplier .or. law%n_phases > 0 .or. law%is_users_own) return
      n = size(law%shape, 2)
      allocate (z(2*n, n), f(2*n, n), df_dz(2*n, n, n), source=0.0_wp)
      allocate (v(2*n, merge(n, 0, law%needs_velocity)), df_dv(2*n, n, merge(n, 0, law%needs_velocity)), source=0.0_wp)
      allocate (p(2*n, 0), df_dp(2*n, n, 0))
      do i = 1, n
         z(2*i - 1, i) = closed_contact_ratio*merge(length, 1.0_wp, length > 0.0_wp)
         z(2*i, i) = -z(2*i - 1, i)
      end do
      call law%evaluate(z, v, p, f, df_dz, df_dv, df_dp)
      stiffness = maxval(abs(df_dz))
   end function stiffness_of

   !> Adds what may help, beside the limit that ended the search (`limit_of`). The first value of an advice on a law is its number,
   !> with which a file stores it.
   subroutine advise_on_search(system, report, circumstances, list)
      type(system_t), intent(in) :: system
      type(report_t), intent(in) :: report
      type(circumstances_t), intent(in) :: circumstances
      type(advice_list_t), intent(inout) :: list
      integer :: n

      n = n_advice(list)
      associate (c => circumstances)
         if (c%stiffness_ratio >= min_contact_ratio) call add(advice%stiff_contact, c%contact, [c%stiffness_ratio])
         if (c%slip_ratio < max_slip_ratio) call add(advice%hardly_slipping, c%slider, [c%slip_ratio])
         if (is_steep(c)) call add(advice%steep_friction, c%friction, [c%smoothing, c%speed])
         if (allocated(c%combination)) call list%add(advice%slow_combination, [real(wp) :: c%combination_frequency, c%combination])
         if (report%status == outcome%singular) call list%add(advice%singular_tangent)
         if (any(report%status == [outcome%diverged, outcome%not_finite])) call list%add(advice%smaller_loads)
         if (count_attempts(report) == 1 .and. report%status /= outcome%timed_out .and. .not. c%has_fallbacks) &
            call list%add(advice%no_fallbacks)
         if (report%status == outcome%stalled .or. (n_advice(list) == n .and. limit_of(report, c) == reason%none)) &
            call list%add(unused_guess(c))
      end associate

   contains

      !> Adds an advice on a law.
      subroutine add(number, law, values)
         integer, intent(in) :: number, law
         real(wp), intent(in) :: values(:)

         call list%add(number, [real(law, wp), values], system%laws(law)%law%label)
      end subroutine add
   end subroutine advise_on_search

   !> Whether smoothed friction is a step at the speeds of the motion, so that work alone does not help.
   pure logical function is_steep(circumstances)
      type(circumstances_t), intent(in) :: circumstances

      is_steep = circumstances%speed > min_speed_ratio*circumstances%smoothing
   end function is_steep

   !> The limit that ended the attempts, of hb_outcome%reason.
   pure integer function limit_of(report, circumstances) result(limit)
      type(report_t), intent(in) :: report
      type(circumstances_t), intent(in) :: circumstances

      limit = reason%none
      if (is_out_of_work(report)) limit = reason%max_fallback_work
      if (was_falling(report)) limit = reason%max_iterations
      if (is_steep(circumstances)) limit = reason%steep_friction
      if (report%status == outcome%timed_out) limit = reason%time_limit
   end function limit_of

   !> The advice on first guesses that were not used.
   pure integer function unused_guess(circumstances) result(number)
      type(circumstances_t), intent(in) :: circumstances

      number = advice%other_guess
      if (.not. circumstances%is_neighbour_used) number = advice%guess_of_neighbour
      if (.not. circumstances%is_integration_used) number = advice%guess_by_integration
   end function unused_guess

   !> Attempts at the problem itself, without those at smaller ones.
   pure integer function count_attempts(report)
      type(report_t), intent(in) :: report

      count_attempts = 0
      if (allocated(report%attempts)) count_attempts = count(report%attempts%depth == 0)
   end function count_attempts

   !> Whether the direct attempt would have converged with more iterations.
   pure logical function was_falling(report)
      type(report_t), intent(in) :: report
      integer :: i

      was_falling = .false.
      if (.not. allocated(report%attempts)) return
      do i = 1, size(report%attempts)
         associate (attempt => report%attempts(i))
            if (attempt%depth > 0 .or. attempt_rules(attempt%rule)%technique /= technique%direct) cycle
            was_falling = attempt%status == outcome%out_of_budget .and. attempt%was_falling
            return                                                    ! others start elsewhere
         end associate
      end do
   end function was_falling

   !> Whether a homotopy, or the last method, was ended by its budget.
   pure logical function is_out_of_work(report)
      type(report_t), intent(in) :: report
      integer :: i

      is_out_of_work = .false.
      if (.not. allocated(report%attempts)) return
      do i = 1, size(report%attempts)
         associate (attempt => report%attempts(i))
            if (attempt%depth > 0 .or. attempt_rules(attempt%rule)%share <= 0.0_wp) cycle   ! not a fallback
            is_out_of_work = is_out_of_work .or. (attempt%is_out_of_work .and. attempt%status == outcome%out_of_budget)
         end associate
      end do
   end function is_out_of_work
end module hb_search_advice
