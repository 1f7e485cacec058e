!> The result of the search for a motion.
module hb_motion_result
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_advice, only: advice_list_t, append_advice, describe_advice, has_row
   use hb_error, only: error_t
   use hb_estimated_errors, only: error_estimate_t
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_outcome, only: has_verdict, is_solved, outcome, reason
   use hb_solver_types, only: attempt_t
   use hb_stability, only: noise_status, stability_t, unknown_because
   implicit none
   private
   public :: advise_on_reason, as_pairs, curve_position_t, effort_t, gradient_t, motion_result_t, stored_motion_t

   integer, parameter :: of_reason = 900                !! a row of the table of advice: this and the number of a reason

   !> Position of a motion on a curve, hb_motion_curve, and the data from which the curve continues: complete for ends
   !> of steps and starts of branches.
   type :: curve_position_t
      integer :: kind = 0                               !! hb_point_kinds%curve_kind
      real(wp) :: parameter = 0.0_wp                    !! in the unit of the input
      real(wp) :: length = 0.0_wp                       !! of the arc from the start, negative on the second branch from there
      integer :: branch = 0                             !! number of the branch point where this curve starts; 0: none
      real(wp), allocatable :: unknowns(:)              !! of the balance, further ones, and the value along the curve
      real(wp), allocatable :: direction(:) !! tangent of the curve, same size; not allocated: no continuation from there
      real(wp) :: step = 0.0_wp                         !! length of the next one; 0: not the end of a step
      real(wp) :: orientation = 0.0_wp                  !! sign of the determinant at the end of a step; 0: not known
      real(wp) :: largest_motion = 0.0_wp               !! so far, relative to a typical one: the unit of lengths
      integer :: n_unreliable = 0                       !! last steps whose errors are not known, up to the end of a step
      integer :: n_exhausted = 0                        !! last steps that took the work of a point, likewise
      real(wp) :: angle = 0.0_wp                        !! of the multipliers at a period doubling or Neimark-Sacker point [rad]
      integer :: response = 0                           !! number in the request of the response that is located there
      integer :: extreme = 0                            !! 1: a maximum, -1: a minimum, 2: one of unknown sense, or a fold that was
                                                        !! passed on the step and not located
      real(wp) :: over = 0.0_wp                         !! value of `over`, for a located point that is followed
      integer, allocatable :: tuples(:, :)              !! set of the motion, (n_tones, n_harmonics); that of the model if none
      integer, allocatable :: n_samples(:)              !! of its grid, (n_tones); likewise
   end type curve_position_t

   !> Derivatives of a motion with respect to values of the input, in their units.
   type :: gradient_t
      real(wp), allocatable :: coefficients(:, :, :, :) !! (cos and sin, n_harmonics, n_dofs, values); n_dofs = 0 if those
                                                        !! of one response are requested
      real(wp), allocatable :: response(:)              !! of this response, (values); otherwise not allocated
      complex(wp), allocatable :: weights(:)            !! its differential, Re(sum conj(weights) dx) of the amplitudes of its
                                                        !! degree of freedom, (n_harmonics); not allocated: it is zero
      real(wp), allocatable :: frequency(:, :)          !! [rad/s], (n_tones, values)
      real(wp), allocatable :: position(:)              !! of the value along a curve, at a located point (values)
      real(wp), allocatable :: estimate(:) !! change of the coefficients' derivatives on a finer grid, relative (values)
      real(wp), allocatable :: defect(:)                !! residual after a small step of value and motion, relative to that
                                                        !! after a step of the value alone
   end type gradient_t

   !> What a motion has taken.
   type :: effort_t
      integer :: iterations = 0
      integer :: evaluations = 0                        !! of the residual
      real(wp) :: work = 0.0_wp                         !! of the solver and of time integration, see hb_solver_types
      real(wp) :: work_spent = 0.0_wp                   !! of levels, everything included, see hb_cancellation
      integer :: n_levels = 0 !! sets solved until the tolerance was satisfied, hb_accurate_motion; 0: a given one
      integer :: fallback = 0                           !! methods that the solver needed, hb_solver_types
      real(wp) :: setup_seconds = 0.0_wp                !! wall time of dynamic stiffness, plans, first guess
      real(wp) :: solver_seconds = 0.0_wp               !! of the iterations
      real(wp) :: error_estimate_seconds = 0.0_wp          !! of the error estimate
   contains
      procedure :: add => effort_add
   end type effort_t

   !> A motion that was found, and what describes it: all that is discarded with it. A component that is not allocated is unknown,
   !> and NaN in a file. One along the axis `dof` or `harmonic` of hb_motion_columns needs a line in the procedures that follow.
   type, extends(effort_t) :: stored_motion_t
      real(wp), allocatable :: coefficients(:, :, :)    !! (cos and sin, n_harmonics, n_dofs)
      complex(wp), allocatable :: outputs(:, :)         !! cos - i sin [m], (n_harmonics, outputs with a requested accuracy)
      real(wp), allocatable :: output_estimate(:)       !! estimated error of each of them, relative to it
      real(wp), allocatable :: output_level_estimate(:) !! for each of them the analogue of `level_estimate`
      real(wp), allocatable :: force_coefficients(:, :, :) !! [N], (cos and sin, n_harmonics, n_law_dofs)
      real(wp), allocatable :: corrected_coefficients(:, :, :) !! (cos and sin, n_harmonics, n_law_dofs)
      real(wp), allocatable :: improved_coefficients(:, :, :) !! (cos and sin, harmonics of error_estimate%wider, n_law_dofs)
      integer :: n_full_stick = 0                       !! friction laws that slip nowhere: one of many solutions
      type(error_estimate_t) :: error_estimate                !! zero and without combination if none was computed
      logical :: is_near_commensurate = .false.
      logical :: is_beyond_tables = .false.             !! its frequencies, those of parts: values at their ends apply
      type(stability_t) :: stability
      type(gradient_t) :: gradient                      !! if it was requested
      real(wp), allocatable :: displacement_samples(:, :) !! (n_samples_total, n_law_dofs), tone 1 fastest
      real(wp), allocatable :: corrected_samples(:, :)  !! corrected to walls, as displacement_samples
      real(wp), allocatable :: force_samples(:, :)      !! [N], as displacement_samples
   contains
      procedure :: select_dofs => stored_motion_select_dofs
      procedure :: spread_harmonics => stored_motion_spread_harmonics
      procedure :: turn_harmonics => stored_motion_turn_harmonics
   end type stored_motion_t

   !> The result of one model.
   type, extends(stored_motion_t) :: motion_result_t
      integer :: status = outcome%pending               !! hb_outcome
      integer :: reason = reason%none                   !! hb_outcome
      integer :: n_periods = 0 !! after which a motion found by time integration repeats, if `subharmonic`
      character(:), allocatable :: message              !! cause of a failure, or a remark; truncated to 400 bytes in a file
      type(advice_list_t) :: advice                     !! if no motion was found
      type(attempt_t), allocatable :: attempts(:)       !! that were made, see hb_attempts
      real(wp) :: integration_work = 0.0_wp             !! part of it for time integration
      real(wp) :: usual_work = 0.0_wp                   !! of a point with these equations, in about a nanosecond
      logical :: is_integrated_first = .false.          !! time integration was tried before the balance, hb_primary_method
      integer :: n_motions = 0 !! number of different motions from several starts of time integration; 0: none were tried
      real(wp) :: residual = 0.0_wp                     !! relative to the scale of the forces
      real(wp) :: solve_seconds = 0.0_wp                !! wall time of the whole point
      integer :: rank = 0                               !! that solved it
      integer :: n_harmonics = 0                        !! in the set of this point
      real(wp) :: level_difference = 0.0_wp             !! of the motions of the last two levels, relative
      real(wp) :: departure = -1.0_wp                   !! of a time integration from the motion, relative; negative: not known
      real(wp) :: penetration_share = 0.0_wp                          !! of the penetration that is permitted
      real(wp) :: level_estimate = 0.0_wp               !! estimated error from this difference if larger than the error estimate's
                                                        !! estimate from the motion alone, relative; otherwise 0
      type(harmonics_t) :: harmonics                    !! set of the coefficients, if the point has chosen it
      integer, allocatable :: n_samples(:)              !! of its grid, (n_tones); not allocated: that of the model
      integer :: preconditioner_level = 0               !! that solutions from products have required
      integer :: n_unknowns = 0                         !! of the equations that were solved; 0: none
      real(wp), allocatable :: frequency(:)             !! [rad/s], (n_tones)
      real(wp), allocatable :: artificial_damping(:)    !! [1/s], (n_tones), of a normal mode
      logical :: is_odd = .false.                       !! searched for among motions of odd tuples alone
      real(wp) :: asymmetry = 0.0_wp                    !! of forces with memory, if only odd tuples are stored
      logical :: leaves_branch = .false.                !! of the preceding point in a chain, hb_chain_check
      type(curve_position_t), allocatable :: curve      !! of a motion on a curve
   contains
      procedure :: add_message => motion_result_add_message
      procedure :: describe => motion_result_describe
      procedure :: forget_motion => motion_result_forget_motion
      procedure :: list_advice => motion_result_list_advice
      procedure :: set_failure => motion_result_set_failure
      procedure :: withdraw_verdict => motion_result_withdraw_verdict
   end type motion_result_t

contains

   !> Adds the work of another motion; its fallback counts if it is a later one.
   pure subroutine effort_add(self, other)
      class(effort_t), intent(inout) :: self
      type(effort_t), intent(in) :: other

      self%iterations = self%iterations + other%iterations
      self%evaluations = self%evaluations + other%evaluations
      self%work = self%work + other%work
      self%work_spent = self%work_spent + other%work_spent
      self%n_levels = self%n_levels + other%n_levels
      self%fallback = max(self%fallback, other%fallback)
      self%setup_seconds = self%setup_seconds + other%setup_seconds
      self%solver_seconds = self%solver_seconds + other%solver_seconds
      self%error_estimate_seconds = self%error_estimate_seconds + other%error_estimate_seconds
   end subroutine effort_add

   !> Reduces a motion at all degrees of freedom to some of them: all components along the axis `dof` of hb_motion_columns except
   !> `gradient`, which is not yet known.
   pure subroutine stored_motion_select_dofs(self, dofs)
      class(stored_motion_t), intent(inout) :: self
      integer, intent(in) :: dofs(:)                    !! the remaining ones, in their order

      if (allocated(self%coefficients)) self%coefficients = self%coefficients(:, :, dofs)
      call self%stability%response%select_dofs(dofs)
   end subroutine stored_motion_select_dofs

   !> Spreads a motion over other harmonics: all components along the axis `harmonic`. Those that the set lacks become NaN.
   pure subroutine stored_motion_spread_harmonics(self, set, tuples)
      class(stored_motion_t), intent(inout) :: self
      type(harmonics_t), intent(in) :: set              !! of the motion
      integer, intent(in) :: tuples(:, :)               !! of the harmonics, (n_tones, any)
      integer :: places(size(tuples, 2))

      places = places_in(set, tuples)
      call spread_pairs(self%coefficients, places)
      call spread_pairs(self%force_coefficients, places)
      call spread_pairs(self%corrected_coefficients, places)
      call spread_pairs(self%improved_coefficients, places_in(self%error_estimate%wider, tuples))
      call spread_gradient(self%gradient%coefficients, places)
   end subroutine stored_motion_spread_harmonics

   !> Names harmonics by the negative of their tuples: all components along the axes `harmonic` and `component`, except the
   !> improved ones and `gradient`, which are not yet known.
   pure subroutine stored_motion_turn_harmonics(self, is_turned)
      class(stored_motion_t), intent(inout) :: self
      logical, intent(in) :: is_turned(:)               !! (n_harmonics)

      call turn_pairs(self%coefficients, is_turned)
      call turn_pairs(self%force_coefficients, is_turned)
      call turn_pairs(self%corrected_coefficients, is_turned)
   end subroutine stored_motion_turn_harmonics

   !> Places of tuples in a set; 0: it lacks them.
   pure function places_in(set, tuples) result(places)
      type(harmonics_t), intent(in) :: set
      integer, intent(in) :: tuples(:, :)               !! (n_tones, any)
      integer :: places(size(tuples, 2))
      integer :: i

      places = [(set%index_of(tuples(:, i)), i=1, size(places))]
   end function places_in

   !> The coefficients at places, NaN at place 0.
   pure subroutine spread_pairs(pairs, places)
      real(wp), allocatable, intent(inout) :: pairs(:, :, :) !! (cos and sin, n_harmonics, any)
      integer, intent(in) :: places(:)
      real(wp), allocatable :: there(:, :, :)
      integer :: i

      if (.not. allocated(pairs)) return
      if (is_order(places, size(pairs, 2))) return
      allocate (there(2, size(places), size(pairs, 3)), source=ieee_value(1.0_wp, ieee_quiet_nan))
      do i = 1, size(places)
         if (places(i) > 0) there(:, i, :) = pairs(:, places(i), :)
      end do
      call move_alloc(there, pairs)
   end subroutine spread_pairs

   !> The same for derivatives.
   pure subroutine spread_gradient(gradient, places)
      real(wp), allocatable, intent(inout) :: gradient(:, :, :, :) !! (cos and sin, n_harmonics, any, any)
      integer, intent(in) :: places(:)
      real(wp), allocatable :: there(:, :, :, :)
      integer :: i

      if (.not. allocated(gradient)) return
      if (is_order(places, size(gradient, 2))) return
      allocate (there(2, size(places), size(gradient, 3), size(gradient, 4)), source=ieee_value(1.0_wp, ieee_quiet_nan))
      do i = 1, size(places)
         if (places(i) > 0) there(:, i, :, :) = gradient(:, places(i), :, :)
      end do
      call move_alloc(there, gradient)
   end subroutine spread_gradient

   !> Whether places are all of n, in their order.
   pure logical function is_order(places, n)
      integer, intent(in) :: places(:)
      integer, intent(in) :: n
      integer :: i

      is_order = size(places) == n
      if (is_order) is_order = all(places == [(i, i=1, n)])
   end function is_order

   !> Changes the sign of the sines of some harmonics.
   pure subroutine turn_pairs(pairs, is_turned)
      real(wp), allocatable, intent(inout) :: pairs(:, :, :) !! (cos and sin, n_harmonics, any)
      logical, intent(in) :: is_turned(:)
      integer :: h

      if (.not. allocated(pairs)) return
      do h = 1, size(is_turned)
         if (is_turned(h)) pairs(2, h, :) = 0.0_wp - pairs(2, h, :) ! no zero has a sign
      end do
   end subroutine turn_pairs

   !> Discards a motion that an error, or time integration, has shown to be none; what it has taken remains.
   pure subroutine motion_result_forget_motion(self)
      class(motion_result_t), intent(inout) :: self
      type(stored_motion_t) :: none

      none%effort_t = self%effort_t
      self%stored_motion_t = none
      self%advice = advice_list_t()
   end subroutine motion_result_forget_motion

   !> Adds a part of the message.
   pure subroutine motion_result_add_message(self, text, is_first)
      class(motion_result_t), intent(inout) :: self
      character(*), intent(in) :: text
      logical, intent(in) :: is_first                                 !! before what there is

      if (.not. allocated(self%message)) self%message = ""
      if (len(self%message) == 0) then
         self%message = text
      else if (is_first) then
         self%message = text//"; "//self%message
      else
         self%message = self%message//"; "//text
      end if
   end subroutine motion_result_add_message

   !> Advice on the search, and on what ended the work.
   pure subroutine motion_result_list_advice(self, list)
      class(motion_result_t), intent(in) :: self
      type(advice_list_t), intent(inout) :: list

      call append_advice(list, self%advice)
      call advise_on_reason(self%reason, list)
   end subroutine motion_result_list_advice

   !> Adds what the table has for what ended the work.
   pure subroutine advise_on_reason(why, list)
      integer, intent(in) :: why                                      !! of `reason`
      type(advice_list_t), intent(inout) :: list

      if (has_row(of_reason + why)) call list%add(of_reason + why)
   end subroutine advise_on_reason

   !> The message and, if there is no motion, the advice, in one text.
   pure subroutine motion_result_describe(self, text)
      class(motion_result_t), intent(in) :: self
      character(:), allocatable, intent(out) :: text
      type(advice_list_t) :: list
      character(:), allocatable :: message

      if (.not. is_solved(self%status)) call self%list_advice(list)
      call describe_advice(list, text, "; ")
      message = ""
      if (allocated(self%message)) message = self%message
      if (len(message) > 0 .and. len(text) > 0) message = message//"; "
      text = message//text
   end subroutine motion_result_describe

   !> Makes an error the outcome.
   pure subroutine motion_result_set_failure(self, error)
      class(motion_result_t), intent(inout) :: self
      type(error_t), intent(in) :: error

      self%status = outcome%failed
      self%reason = reason%error
      self%message = error%message
      self%advice = advice_list_t()
   end subroutine motion_result_set_failure

   !> Withdraws a verdict on stability unless the status permits one: it is that of another motion. Whatever returns a result
   !> calls this last, since the status may change after the verdict was found.
   pure subroutine motion_result_withdraw_verdict(self)
      class(motion_result_t), intent(inout) :: self

      if (has_verdict(self%status)) return
      call self%stability%withdraw(unknown_because%status)
      if (self%stability%response%status /= noise_status%none) call self%stability%response%fail(noise_status%no_verdict)
   end subroutine motion_result_withdraw_verdict

   !> Amplitudes a - i b as pairs (cos and sin, n_harmonics, any).
   pure function as_pairs(c) result(pairs)
      complex(wp), intent(in) :: c(:, :)                !! (any, n_harmonics)
      real(wp) :: pairs(2, size(c, 2), size(c, 1))

      pairs(1, :, :) = real(transpose(c), wp)
      pairs(2, :, :) = 0.0_wp - aimag(transpose(c))     ! no zero has a sign
   end function as_pairs
end module hb_motion_result
