!> The states of one hysteretic law over the torus, at all samples, by integration along time until they are periodic.
!> The first slice starts from rest, loaded along a straight path to the motion there. If all sliders slip, the start
!> is forgotten and the periodic states are unique. A slider that never slips keeps its position, which is arbitrary:
!> the rule is to start from rest, and `full_stick` reports it. Source: docs/why/theory.md, section 5.5.
!> A slider between bounds ends each step at its start, but not below the end position of one from far below, nor
!> above that of one from far above (a play operator is a clamp, and so is a sequence of clamps). For many lines these
!> two positions are computed once for all rounds, `low` and `high`.
!> Sliders in a plane that only the loading moves have different positions, which interpolation alone would make equal,
!> slowly, at their mean: if all of them stick round after round, they are put there.
!> A slider in a plane that slips little converges slowly from round to round: after many rounds without convergence Newton's
!> method moves the first slice to the limit, by the derivative of a round (hb_round_map). Where the states hardly forget, the
!> rounding of its steps moves them on in each further round.
module hb_slider_states
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_cancellation, only: spend_work, work_is_over
   use hb_characteristic, only: characteristic_t
   use hb_hysteretic_law, only: hysteretic_law_t, n_path_parts, path_part
   use hb_kinds, only: wp
   use hb_round_map, only: find_closing, is_affordable
   use hb_slider, only: pushed_by
   implicit none
   private
   public :: max_rounds, new_slider_states, repeat_tolerance, slider_states_t

   integer, parameter :: max_rounds = 1000
   integer, parameter :: few_rounds = 10, many_rounds = 40, between_jumps = 4, few_to_close = 3
   integer, parameter :: not_known = -1, no = 0, yes = 1
   real(wp), parameter :: per_clamp = 4.0_wp, per_neighbour = 1.0_wp  ! see hb_solver_types%unit_of_work
   real(wp), parameter :: repeat_tolerance = 64*epsilon(1.0_wp)       ! of the largest coordinate or state
   real(wp), parameter :: rounding_of_step = 8*epsilon(1.0_wp)        ! likewise

   !> Samples are stored slice by slice: (n_slice, ..., n_steps).
   type :: slider_states_t
      real(wp), allocatable :: path(:, :, :, :)                       !! [m], (n_slice, n_coordinates, n_path_parts, n_steps)
      real(wp), allocatable :: states(:, :, :)                        !! (n_slice, n_states, n_steps)
      real(wp), allocatable :: force(:, :)                            !! of one slice [N], (n_slice, n_coordinates)
      integer :: rounds = 0                                           !! until the states were periodic
      logical :: repeats = .true.                                     !! false: not within `max_rounds`
      logical :: full_stick = .false.                                 !! no state moved in the last round
      integer :: levelled_at = 0                                      !! round after which sliders were put to their mean; 0: none
      logical :: has_jumped = .false.                                 !! a Newton step was made: rounds from rest do not lead there
      real(wp), allocatable :: ds_ds_old(:, :, :, :)                  !! (n_slice, n_states, n_states, n_steps)
      real(wp), allocatable :: ds_dpath(:, :, :, :, :)                !! (n_slice, n_states, n_coordinates, n_path_parts, n_steps)
      real(wp), allocatable :: before(:, :)                           !! first slice before the last round, (n_slice, n_states)
      logical :: is_clamped = .false.                                 !! the next three are those of the last `integration`
      real(wp), allocatable :: low(:, :, :), high(:, :, :)            !! as states
      integer, allocatable :: pusher(:, :, :)                         !! in the last round, of `pushed_by`, as states
      real(wp), allocatable :: low_slope(:, :, :, :, :), high_slope(:, :, :, :, :)   !! by the path, as ds_dpath; from
                                                                      !! `find_clamp_slopes` on
      real(wp), allocatable :: closing(:, :)                          !! (1 - M)**-1, see hb_round_map; after `find_closing`, and
                                                                      !! not allocated if it does not pay off or nearly singular
      real(wp), allocatable :: df_dz(:, :, :), df_ds(:, :, :)         !! slopes of the forces on one line of samples, from
                                                                      !! `find_force_slopes` on, (n_steps, n_coordinates, any)
      logical, private :: has_force_slopes = .false.
      logical, private :: has_closing = .false.                       ! it was looked for
      logical, private :: has_slopes = .false.
      logical, private :: has_last_round = .false.                    ! the derivatives of its steps are there
      integer, private :: start_matters = not_known
      real(wp), allocatable, private :: start(:, :)                   ! (n_slice, n_states)
   contains
      procedure :: integration => slider_states_integration
      procedure :: differentiable => slider_states_differentiable
      procedure :: load_from_rest => slider_states_load_from_rest
      procedure :: integrate_round => slider_states_integrate_round
      procedure :: find_closing => slider_states_find_closing
      procedure :: close => slider_states_close
      procedure :: rounds_of_derivatives => slider_states_rounds_of_derivatives
      procedure :: average_first_slice => slider_states_average_first_slice
      procedure :: integrate_clamped => slider_states_integrate_clamped
      procedure :: find_clamp_slopes => slider_states_find_clamp_slopes
      procedure :: repeat_last_round => slider_states_repeat_last_round
      procedure :: forgets_start => slider_states_forgets_start
      procedure :: find_force_slopes => slider_states_find_force_slopes
      procedure :: mean_slope => slider_states_mean_slope
   end type slider_states_t

contains

   !> Allocates memory for the states of a law.
   subroutine new_slider_states(self, characteristic, n_coordinates, n_states)
      type(slider_states_t), intent(out) :: self
      type(characteristic_t), intent(in) :: characteristic
      integer, intent(in) :: n_coordinates, n_states

      associate (n => characteristic%n_slice, n_steps => characteristic%n_steps)
         allocate (self%path(n, n_coordinates, n_path_parts, n_steps), self%states(n, n_states, n_steps))
         allocate (self%before(n, n_states), self%start(n, n_states), self%force(n, n_coordinates))
      end associate
   end subroutine new_slider_states

   !> Allocates derivatives at their first use.
   subroutine slider_states_differentiable(self)
      class(slider_states_t), intent(inout) :: self

      if (allocated(self%ds_ds_old)) return
      associate (n => size(self%path, 1), n_coordinates => size(self%path, 2), n_steps => size(self%path, 4), &
                 n_states => size(self%states, 2))
         allocate (self%ds_ds_old(n, n_states, n_states, n_steps), self%ds_dpath(n, n_states, n_coordinates, n_path_parts, n_steps))
      end associate
   end subroutine slider_states_differentiable

   !> Computes the periodic states on the path. A motion that is not finite ends the rounds.
   subroutine slider_states_integration(self, law, characteristic)
      class(slider_states_t), intent(inout) :: self
      class(hysteretic_law_t), intent(in) :: law
      type(characteristic_t), intent(in) :: characteristic
      real(wp) :: change, largest, largest_move, rounding
      integer :: next_jump                                            ! after so many rounds; not known: none

      next_jump = merge(many_rounds, not_known, is_affordable(characteristic, size(self%states, 2)))
      largest = maxval(abs(self%path(:, :, path_part%at_end, :)))
      call self%load_from_rest(law, with_derivatives=.false.)
      self%is_clamped = law%has_bounds .and. characteristic%n_slice > 1
      if (self%is_clamped) call find_clamps(self, law)
      self%rounds = 0
      self%has_last_round = .false.
      self%has_force_slopes = .false.
      self%has_closing = .false.
      self%start_matters = not_known
      self%has_jumped = .false.
      self%levelled_at = 0
      do
         if (self%is_clamped) then
            call self%integrate_clamped(characteristic, change, largest_move)
         else if (self%rounds == next_jump) then
            call jump(self, law, characteristic, change, largest_move)
            next_jump = next_jump + merge(between_jumps, next_jump, self%has_jumped .or. characteristic%n_slice == 1)
         else
            call self%integrate_round(law, characteristic, with_derivatives=.false., change=change, largest_move=largest_move)
         end if
         self%rounds = self%rounds + 1
         rounding = repeat_tolerance*max(largest, maxval(abs(self%states)))
         self%repeats = change <= rounding .or. &
                        (self%has_jumped .and. change <= rounding/repeat_tolerance*rounding_of_step*characteristic%n_steps)
         self%full_stick = largest_move <= rounding
         if (self%repeats .or. self%rounds >= max_rounds .or. .not. ieee_is_finite(change)) exit
         if (modulo(self%rounds, between_jumps) == 0) then
            if (work_is_over()) exit
         end if
         if (self%full_stick .and. characteristic%n_slice > 1 .and. self%rounds >= many_rounds .and. self%levelled_at == 0) then
            self%levelled_at = self%rounds
            call self%average_first_slice()
         end if
      end do
   end subroutine slider_states_integration

   !> States of the first slice after loading from rest along a straight path; their derivatives if requested.
   subroutine slider_states_load_from_rest(self, law, with_derivatives)
      class(slider_states_t), intent(inout) :: self
      class(hysteretic_law_t), intent(in) :: law
      logical, intent(in) :: with_derivatives
      real(wp) :: straight(size(self%path, 1), size(self%path, 2), n_path_parts)

      straight = spread(self%path(:, :, path_part%at_end, 1), 3, n_path_parts)
      straight(:, :, path_part%at_start) = 0.0_wp
      self%start = 0.0_wp
      if (with_derivatives) then
         call law%advance(self%start, straight, self%states(:, :, 1), self%ds_ds_old(:, :, :, 1), self%ds_dpath(:, :, :, :, 1))
      else
         call law%advance(self%start, straight, self%states(:, :, 1))
      end if
   end subroutine slider_states_load_from_rest

   !> Integrates one round from the states of the first slice back to it.
   subroutine slider_states_integrate_round(self, law, characteristic, with_derivatives, change, largest_move)
      class(slider_states_t), intent(inout) :: self
      class(hysteretic_law_t), intent(in) :: law
      type(characteristic_t), intent(in) :: characteristic
      logical, intent(in) :: with_derivatives                         !! of every step
      real(wp), intent(out) :: change                                 !! of the first slice since the previous round
      real(wp), intent(out) :: largest_move                           !! of any state within a step
      integer :: i, last, n

      call spend_work(characteristic%work_of_round(size(self%states, 2), merge(2, 1, with_derivatives)*law%work_of_advance, &
                                                   per_neighbour))
      n = characteristic%n_steps
      largest_move = 0.0_wp
      self%before = self%states(:, :, 1)
      if (characteristic%n_slice == 1 .and. .not. with_derivatives) then
         call law%advance_line(size(self%path, 2), n, characteristic%closing, self%path, self%states, largest_move)
         change = maxval(abs(self%states(:, :, 1) - self%before))
         return
      end if
      do i = 2, n + 1
         last = i - 1
         associate (now => 1 + modulo(i - 1, n))
            call characteristic%interpolate(self%states(:, :, last), self%start)
            if (now == 1) self%start = characteristic%closing*self%start
            if (with_derivatives) then
               call law%advance(self%start, self%path(:, :, :, now), self%states(:, :, now), &
                                self%ds_ds_old(:, :, :, now), self%ds_dpath(:, :, :, :, now))
            else
               call law%advance(self%start, self%path(:, :, :, now), self%states(:, :, now))
            end if
            largest_move = max(largest_move, maxval(abs(self%states(:, :, now) - self%start)))
         end associate
      end do
      change = maxval(abs(self%states(:, :, 1) - self%before))
   end subroutine slider_states_integrate_round

   !> Repeats the last round with the derivatives of its steps, once after each `integration`.
   subroutine slider_states_repeat_last_round(self, law, characteristic)
      class(slider_states_t), intent(inout) :: self
      class(hysteretic_law_t), intent(in) :: law
      type(characteristic_t), intent(in) :: characteristic
      real(wp) :: change, largest_move

      if (self%has_last_round) return
      call self%differentiable()
      self%states(:, :, 1) = self%before
      call self%integrate_round(law, characteristic, with_derivatives=.true., change=change, largest_move=largest_move)
      self%has_last_round = .true.
   end subroutine slider_states_repeat_last_round

   !> Whether the states forget where they started: a difference of the first slice vanishes if it goes on through rounds like
   !> the last one. Periodic states, and their derivatives, then depend on that round alone. After `integration` of clamped
   !> sliders or `repeat_last_round`.
   logical function slider_states_forgets_start(self, characteristic) result(forgets)
      class(slider_states_t), intent(inout) :: self
      type(characteristic_t), intent(in) :: characteristic
      real(wp) :: probe(size(self%states, 1), size(self%states, 2))
      integer :: i, k, now, round

      if (self%start_matters == not_known) then
         self%start_matters = yes
         probe = reshape([(1.0_wp + 0.5_wp*sin(real(i, wp)), i=1, size(probe))], shape(probe))   ! not along special directions
         do round = 1, max(many_rounds, self%rounds)
            do i = 2, characteristic%n_steps + 1
               now = 1 + modulo(i - 1, characteristic%n_steps)
               call characteristic%interpolate(probe, self%start)
               if (now == 1) self%start = characteristic%closing*self%start
               if (self%is_clamped) then
                  probe = merge(self%start, 0.0_wp, self%pusher(:, :, now) == pushed_by%nothing)
               else
                  do k = 1, size(probe, 2)
                     probe(:, k) = sum(self%ds_ds_old(:, k, :, now)*self%start, dim=2)
                  end do
               end if
            end do
            if (maxval(abs(probe)) > repeat_tolerance) cycle
            self%start_matters = no
            exit
         end do
      end if
      forgets = self%start_matters == no
   end function slider_states_forgets_start

   !> Integrates one round, and makes a Newton step to the limit of further rounds.
   subroutine jump(self, law, characteristic, change, largest_move)
      class(slider_states_t), intent(inout) :: self
      class(hysteretic_law_t), intent(in) :: law
      type(characteristic_t), intent(in) :: characteristic
      real(wp), intent(out) :: change, largest_move                   !! of the round

      call self%differentiable()
      call self%integrate_round(law, characteristic, with_derivatives=.true., change=change, largest_move=largest_move)
      if (.not. change > 0.0_wp) return
      call find_closing(self%ds_ds_old, characteristic, self%closing)
      if (.not. allocated(self%closing)) return
      call self%close(self%before, self%states(:, :, 1))
      change = huge(1.0_wp)                                           ! determined by the next round
      self%has_jumped = .true.
   end subroutine jump

   !> Finds (1 - M)**-1 of the last round, once after each `integration`, where that pays off: on one line, or on a slice that is
   !> not too large for states that converged slowly.
   subroutine slider_states_find_closing(self, law, characteristic)
      class(slider_states_t), intent(inout) :: self
      class(hysteretic_law_t), intent(in) :: law
      type(characteristic_t), intent(in) :: characteristic

      if (self%has_closing) return
      if (allocated(self%closing)) deallocate (self%closing)
      self%has_closing = .true.
      if (characteristic%n_slice > 1 .and. self%rounds <= few_rounds) return
      if (.not. is_affordable(characteristic, size(self%states, 2))) return
      call self%repeat_last_round(law, characteristic)
      call find_closing(self%ds_ds_old, characteristic, self%closing)
   end subroutine slider_states_find_closing

   !> Rounds that derivatives of the states need, as far as is known.
   pure integer function slider_states_rounds_of_derivatives(self) result(rounds)
      class(slider_states_t), intent(in) :: self

      rounds = self%rounds
      if (self%has_closing .and. allocated(self%closing)) rounds = min(rounds, few_to_close)
   end function slider_states_rounds_of_derivatives

   !> Moves the first slice of states, or of their derivatives, from where a round began to what repeats itself, as far as the
   !> round is linear: see `closing`.
   subroutine slider_states_close(self, first, states)
      class(slider_states_t), intent(in) :: self
      real(wp), intent(in) :: first(:, :)                             !! before the round, (n_slice, n_states)
      real(wp), intent(inout) :: states(:, :)                         !! after it, likewise

      states = first + reshape(matmul(self%closing, reshape(states - first, [size(first)])), shape(first))
   end subroutine slider_states_close

   !> Puts the sliders of the first slice to their mean, after a round in which all of them stuck. It sticks as well: the
   !> positions at which a slider sticks are a convex set.
   subroutine slider_states_average_first_slice(self)
      class(slider_states_t), intent(inout) :: self

      self%states(:, :, 1) = spread(sum(self%states(:, :, 1), dim=1)/size(self%states, 1), 1, size(self%states, 1))
   end subroutine slider_states_average_first_slice

   !> Computes `low` and `high` of all steps.
   subroutine find_clamps(self, law)
      class(slider_states_t), intent(inout) :: self
      class(hysteretic_law_t), intent(in) :: law
      real(wp) :: far(size(self%states, 1), size(self%states, 2))
      integer :: i

      if (.not. allocated(self%low)) then
         allocate (self%low, self%high, mold=self%states)
         allocate (self%pusher(size(self%states, 1), size(self%states, 2), size(self%states, 3)))
      end if
      self%has_slopes = .false.
      call spend_work(2*law%work_of_advance*size(self%states))
      far = huge(1.0_wp)
      do i = 1, size(self%states, 3)
         call law%advance(-far, self%path(:, :, :, i), self%low(:, :, i))
         call law%advance(far, self%path(:, :, :, i), self%high(:, :, i))
      end do
   end subroutine find_clamps

   !> Computes the derivatives of `low` and `high` with respect to the path, once after each `integration`.
   subroutine slider_states_find_clamp_slopes(self, law)
      class(slider_states_t), intent(inout) :: self
      class(hysteretic_law_t), intent(in) :: law
      real(wp) :: far(size(self%states, 1), size(self%states, 2))
      real(wp) :: by_start(size(self%states, 1), size(self%states, 2), size(self%states, 2))
      integer :: i

      if (self%has_slopes) return
      if (.not. allocated(self%low_slope)) then
         associate (n => shape(self%path), n_states => size(self%states, 2))
            allocate (self%low_slope(n(1), n_states, n(2), n(3), n(4)), self%high_slope(n(1), n_states, n(2), n(3), n(4)))
         end associate
      end if
      call spend_work(4*law%work_of_advance*size(self%states))
      far = huge(1.0_wp)
      do i = 1, size(self%states, 3)
         call law%advance(-far, self%path(:, :, :, i), self%low(:, :, i), by_start, self%low_slope(:, :, :, :, i))
         call law%advance(far, self%path(:, :, :, i), self%high(:, :, i), by_start, self%high_slope(:, :, :, :, i))
      end do
      self%has_slopes = .true.
   end subroutine slider_states_find_clamp_slopes

   !> As `integrate_round`, by clamps.
   subroutine slider_states_integrate_clamped(self, characteristic, change, largest_move)
      class(slider_states_t), intent(inout) :: self
      type(characteristic_t), intent(in) :: characteristic
      real(wp), intent(out) :: change, largest_move
      integer :: i, k, last, n, now, p

      call spend_work(characteristic%work_of_round(size(self%states, 2), per_clamp, per_neighbour))
      n = characteristic%n_steps
      largest_move = 0.0_wp
      self%before = self%states(:, :, 1)
      do i = 2, n + 1
         last = i - 1
         call characteristic%interpolate(self%states(:, :, last), self%start)
         now = 1 + modulo(i - 1, n)
         if (now == 1) self%start = characteristic%closing*self%start
         do k = 1, size(self%states, 2)
            do p = 1, size(self%states, 1)
               associate (w => self%start(p, k), low => self%low(p, k, now), high => self%high(p, k, now))
                  self%pusher(p, k, now) = merge(pushed_by%lower, merge(pushed_by%upper, pushed_by%nothing, w > high), w < low)
                  self%states(p, k, now) = min(max(w, low), high)
               end associate
            end do
         end do
         largest_move = max(largest_move, maxval(abs(self%states(:, :, now) - self%start)))
      end do
      change = maxval(abs(self%states(:, :, 1) - self%before))
   end subroutine slider_states_integrate_clamped

   !> Computes `df_dz` and `df_ds` at the steps of a single line of samples, once after each `integration`.
   subroutine slider_states_find_force_slopes(self, law)
      class(slider_states_t), intent(inout) :: self
      class(hysteretic_law_t), intent(in) :: law
      real(wp), allocatable :: f(:, :), s(:, :), z(:, :)

      if (self%has_force_slopes) return
      z = transpose(self%path(1, :, path_part%at_end, :))
      s = transpose(self%states(1, :, :))
      allocate (f, mold=z)
      if (.not. allocated(self%df_dz)) &
         allocate (self%df_dz(size(z, 1), size(z, 2), size(z, 2)), self%df_ds(size(z, 1), size(z, 2), size(s, 2)))
      call law%force(z, s, f, self%df_dz, self%df_ds)
      self%has_force_slopes = .true.
   end subroutine slider_states_find_force_slopes

   !> Mean over all samples of the slope of the force within a step: the spring while sliders stick, zero while they
   !> slip. After `integration`.
   subroutine slider_states_mean_slope(self, law, characteristic, slope)
      class(slider_states_t), intent(inout) :: self
      class(hysteretic_law_t), intent(in) :: law
      type(characteristic_t), intent(in) :: characteristic
      real(wp), intent(out) :: slope(:, :)                            !! [N/m], (n_coordinates, n_coordinates)
      real(wp), allocatable :: df_dz(:, :, :), df_ds(:, :, :)
      integer :: a, b, i, k

      call self%repeat_last_round(law, characteristic)
      allocate (df_dz(size(self%path, 1), size(slope, 1), size(slope, 1)))
      allocate (df_ds(size(self%path, 1), size(slope, 1), law%n_states))
      slope = 0.0_wp
      do i = 1, characteristic%n_steps
         call law%force(self%path(:, :, path_part%at_end, i), self%states(:, :, i), self%force, df_dz, df_ds)
         do b = 1, size(slope, 1)
            do a = 1, size(slope, 1)
               slope(a, b) = slope(a, b) + sum(df_dz(:, a, b))
               do k = 1, law%n_states
                  slope(a, b) = slope(a, b) + dot_product(df_ds(:, a, k), self%ds_dpath(:, k, b, path_part%at_end, i))
               end do
            end do
         end do
      end do
      slope = slope/real(size(self%path, 1)*characteristic%n_steps, wp)
   end subroutine slider_states_mean_slope
end module hb_slider_states
