!> Response of the states of one hysteretic law to one direction, of the motion or with respect to a base frequency:
!> the exact derivative of the discrete time integration over the torus.
!> A direction of the motion changes the paths of the steps; a frequency changes these, and the weights of the
!> interpolation of states at their starts. The derivative follows the steps of the last round of the states until it is
!> periodic as well; where the states do not forget their start, it first follows all rounds, from rest. Source:
!> docs/why/theory.md, sections 5.6 and 6.6.
module hb_slider_derivative
   use hb_cancellation, only: spend_work, work_is_over
   use hb_characteristic, only: characteristic_t
   use hb_hysteretic_law, only: hysteretic_law_t, n_path_parts, path_part
   use hb_kinds, only: wp
   use hb_slider, only: pushed_by
   use hb_slider_states, only: max_rounds, repeat_tolerance, slider_states_t
   implicit none
   private
   public :: new_slider_derivative, slider_derivative_t

   !> Derivatives, slice by slice as in hb_slider_states.
   type :: slider_derivative_t
      real(wp), allocatable :: path(:, :, :, :)                       !! (n_slice, n_coordinates, n_path_parts, n_steps)
      real(wp), allocatable :: states(:, :, :)                        !! (n_slice, n_states, n_steps)
      logical :: repeats = .true.                                     !! false: not within `max_rounds`
      real(wp), allocatable, private :: start(:, :), first(:, :)      ! (n_slice, n_states)
      real(wp), allocatable, private :: low(:, :, :), high(:, :, :)   ! of those of clamped sliders, as states
   contains
      procedure :: integration => slider_derivative_integration
      procedure :: force => slider_derivative_force
      procedure, private :: load_from_rest => slider_derivative_load_from_rest
      procedure, private :: integrate_round => slider_derivative_integrate_round
   end type slider_derivative_t

contains

   !> Allocates memory for the derivatives of the states of a law.
   subroutine new_slider_derivative(self, sliders)
      type(slider_derivative_t), intent(out) :: self
      type(slider_states_t), intent(in) :: sliders

      allocate (self%path, mold=sliders%path)
      allocate (self%states, mold=sliders%states)
      allocate (self%start(size(self%states, 1), size(self%states, 2)), self%first(size(self%states, 1), size(self%states, 2)))
      self%path = 0.0_wp
   end subroutine new_slider_derivative

   !> Computes the derivatives of the states from those of the paths; the states must have their path and `rounds`.
   subroutine slider_derivative_integration(self, sliders, law, characteristic, weight_slope)
      class(slider_derivative_t), intent(inout) :: self
      type(slider_states_t), intent(inout) :: sliders
      class(hysteretic_law_t), intent(in) :: law
      type(characteristic_t), intent(in) :: characteristic
      real(wp), intent(in) :: weight_slope(:)                         !! derivative of the weights, (n_neighbours)
      real(wp) :: change, largest_path
      integer :: round

      largest_path = maxval(abs(self%path))
      if (sliders%is_clamped) then
         call sliders%find_clamp_slopes(law)
         call find_clamps(self, sliders)
      else
         call sliders%repeat_last_round(law, characteristic)
         call sliders%find_closing(law, characteristic)
      end if
      self%states(:, :, 1) = 0.0_wp
      if (.not. (closes() .or. sliders%has_jumped)) then
         if (.not. sliders%forgets_start(characteristic)) call follow_all_rounds(self, sliders, law, characteristic, weight_slope)
      end if
      call repeat_rounds()

   contains

      !> Whether one round gives the derivatives that repeat themselves.
      logical function closes()
         closes = .not. sliders%is_clamped .and. allocated(sliders%closing)
      end function closes

      !> With the steps of the last round of the states.
      subroutine repeat_rounds()
         self%repeats = .false.
         do round = 1, max_rounds
            self%first = self%states(:, :, 1)
            call self%integrate_round(sliders, characteristic, weight_slope, is_repeated=round > 1)
            change = maxval(abs(self%states(:, :, 1) - self%first))
            self%repeats = change <= repeat_tolerance*max(largest_path, maxval(abs(self%states)))
            if (self%repeats .or. work_is_over()) return
            if (closes()) call sliders%close(self%first, self%states(:, :, 1))
         end do
      end subroutine repeat_rounds
   end subroutine slider_derivative_integration

   !> Follows the states from rest through all rounds before the last one.
   subroutine follow_all_rounds(self, sliders, law, characteristic, weight_slope)
      class(slider_derivative_t), intent(inout) :: self
      type(slider_states_t), intent(inout) :: sliders
      class(hysteretic_law_t), intent(in) :: law
      type(characteristic_t), intent(in) :: characteristic
      real(wp), intent(in) :: weight_slope(:)
      real(wp) :: change, largest_move
      integer :: round

      call sliders%differentiable()
      call sliders%load_from_rest(law, with_derivatives=.true.)
      call self%load_from_rest(sliders)
      do round = 1, sliders%rounds
         if (sliders%is_clamped) then
            call sliders%integrate_clamped(characteristic, change, largest_move)
         else
            call sliders%integrate_round(law, characteristic, with_derivatives=.true., change=change, largest_move=largest_move)
         end if
         if (round < sliders%rounds) call self%integrate_round(sliders, characteristic, weight_slope, is_repeated=.false.)
         if (round == sliders%levelled_at) then
            call sliders%average_first_slice()
            self%states(:, :, 1) = spread(sum(self%states(:, :, 1), dim=1)/size(self%states, 1), 1, size(self%states, 1))
         end if
      end do
   end subroutine follow_all_rounds

   !> Computes the derivatives of the clamp positions of sliders along the direction.
   subroutine find_clamps(self, sliders)
      class(slider_derivative_t), intent(inout) :: self
      type(slider_states_t), intent(in) :: sliders
      integer :: c, i, k, p, part
      real(wp) :: high, low

      if (.not. allocated(self%low)) allocate (self%low, self%high, mold=self%states)
      do i = 1, size(self%path, 4)
         do k = 1, size(self%states, 2)
            do p = 1, size(self%path, 1)
               low = 0.0_wp
               high = 0.0_wp
               do part = 1, n_path_parts
                  do c = 1, size(self%path, 2)
                     low = low + sliders%low_slope(p, k, c, part, i)*self%path(p, c, part, i)
                     high = high + sliders%high_slope(p, k, c, part, i)*self%path(p, c, part, i)
                  end do
               end do
               self%low(p, k, i) = low
               self%high(p, k, i) = high
            end do
         end do
      end do
   end subroutine find_clamps

   !> The first slice after loading from rest along a straight path.
   subroutine slider_derivative_load_from_rest(self, sliders)
      class(slider_derivative_t), intent(inout) :: self
      type(slider_states_t), intent(in) :: sliders
      integer :: c, k

      self%states = 0.0_wp
      do c = 1, size(self%path, 2)
         do k = 1, size(self%states, 2)
            associate (slope => sliders%ds_dpath(:, k, c, :, 1))
               self%states(:, k, 1) = self%states(:, k, 1) + (slope(:, path_part%at_end) + slope(:, path_part%end_rate) &
                                                              + slope(:, path_part%start_rate)) &
                                      *self%path(:, c, path_part%at_end, 1)
            end associate
         end do
      end do
   end subroutine slider_derivative_load_from_rest

   !> Integrates one round with the last steps of the states.
   subroutine slider_derivative_integrate_round(self, sliders, characteristic, weight_slope, is_repeated)
      class(slider_derivative_t), intent(inout) :: self
      type(slider_states_t), intent(in) :: sliders
      type(characteristic_t), intent(in) :: characteristic
      real(wp), intent(in) :: weight_slope(:)
      logical, intent(in) :: is_repeated                              !! on the same paths, from another first slice
      real(wp), parameter :: per_value = 8.0_wp, per_neighbour = 1.0_wp  ! see hb_solver_types%unit_of_work
      integer :: c, i, k, last, old_state, part
      logical :: shifts_states

      call spend_work(characteristic%work_of_round(size(self%states, 2), per_value, per_neighbour))
      if (characteristic%n_slice == 1 .and. .not. sliders%is_clamped) then
         call integrate_line(self, sliders, characteristic%closing, is_repeated)
         return
      end if
      shifts_states = any(abs(weight_slope) > 0.0_wp)
      do i = 2, characteristic%n_steps + 1
         last = i - 1
         associate (now => self%states(:, :, 1 + modulo(i - 1, characteristic%n_steps)), &
                    slice => 1 + modulo(i - 1, characteristic%n_steps))
            call characteristic%interpolate(self%states(:, :, last), self%start)
            if (slice == 1) self%start = characteristic%closing*self%start
            if (shifts_states) then
               if (last == 1) then
                  call add_shift(sliders%before)
               else
                  call add_shift(sliders%states(:, :, last))
               end if
            end if
            if (sliders%is_clamped) then
               now = merge(self%low(:, :, slice), merge(self%high(:, :, slice), self%start, &
                                                        sliders%pusher(:, :, slice) == pushed_by%upper), &
                           sliders%pusher(:, :, slice) == pushed_by%lower)
               cycle
            end if
            now = 0.0_wp
            do old_state = 1, size(now, 2)
               do k = 1, size(now, 2)
                  now(:, k) = now(:, k) + sliders%ds_ds_old(:, k, old_state, slice)*self%start(:, old_state)
               end do
            end do
            do part = 1, n_path_parts
               do c = 1, size(self%path, 2)
                  do k = 1, size(now, 2)
                     now(:, k) = now(:, k) + sliders%ds_dpath(:, k, c, part, slice)*self%path(:, c, part, slice)
                  end do
               end do
            end do
         end associate
      end do

   contains

      !> Effect of changed weights on the previous states. Their slopes sum to zero: taken relative to one neighbour,
      !> equal states cause no rounding errors.
      subroutine add_shift(before)
         real(wp), intent(in) :: before(:, :)
         integer :: k, p

         do k = 1, size(before, 2)
            do p = 1, characteristic%n_slice
               associate (neighbour => characteristic%neighbour(:, p))
                  self%start(p, k) = self%start(p, k) + dot_product(weight_slope, before(neighbour, k) - before(neighbour(1), k))
               end associate
            end do
         end do
      end subroutine add_shift
   end subroutine slider_derivative_integrate_round

   !> Integrates one round along a single line of samples, as with one tone: there nothing is interpolated. A repeated
   !> round ends where its states meet those of the previous one, at the latest where all sliders have slipped.
   subroutine integrate_line(self, sliders, closing, is_repeated)
      type(slider_derivative_t), intent(inout) :: self
      type(slider_states_t), intent(in) :: sliders
      real(wp), intent(in) :: closing                                 !! factor of the states as the round closes
      logical, intent(in) :: is_repeated
      real(wp), dimension(size(self%states, 2)) :: now, start
      integer :: c, i, k, old_state, part, step

      associate (n_steps => size(self%states, 3), path => self%path, states => self%states)
         do i = 2, n_steps + 1
            step = 1 + modulo(i - 1, n_steps)
            start = states(1, :, i - 1)
            if (step == 1) start = closing*start
            do k = 1, size(start)
               now(k) = 0.0_wp
               do old_state = 1, size(start)
                  now(k) = now(k) + sliders%ds_ds_old(1, k, old_state, step)*start(old_state)
               end do
               do part = 1, n_path_parts
                  do c = 1, size(path, 2)
                     now(k) = now(k) + sliders%ds_dpath(1, k, c, part, step)*path(1, c, part, step)
                  end do
               end do
            end do
            if (is_repeated .and. step > 1) then                       ! before, these states are not set yet
               if (all(now == states(1, :, step))) exit
            end if
            states(1, :, step) = now
         end do
      end associate
   end subroutine integrate_line

   !> Derivatives of the forces, at the samples of the torus, after `integration`.
   subroutine slider_derivative_force(self, sliders, law, characteristic, df)
      class(slider_derivative_t), intent(in) :: self
      type(slider_states_t), intent(inout) :: sliders
      class(hysteretic_law_t), intent(in) :: law
      type(characteristic_t), intent(in) :: characteristic
      real(wp), intent(out) :: df(:, :)                               !! (n_samples, n_coordinates)
      integer, parameter :: samples_at_once = 512
      integer :: first, n_at_once

      if (characteristic%n_slice == 1) then
         call sliders%find_force_slopes(law)
         call force_of_line(self, sliders, characteristic%sample(1, :), df)
         return
      end if
      n_at_once = max(1, samples_at_once/characteristic%n_slice)
      do first = 1, characteristic%n_steps, n_at_once
         call force_of_steps(self, sliders, law, characteristic, [first, min(characteristic%n_steps, first + n_at_once - 1)], df)
      end do
   end subroutine slider_derivative_force

   !> Those of a single line of samples, after `find_force_slopes`.
   subroutine force_of_line(self, sliders, sample, df)
      class(slider_derivative_t), intent(in) :: self
      type(slider_states_t), intent(in) :: sliders
      integer, intent(in) :: sample(:)                                !! of each step
      real(wp), intent(inout) :: df(:, :)                             !! (n_samples, n_coordinates)
      real(wp) :: slope(size(sample))
      integer :: a, b, k

      do a = 1, size(df, 2)
         slope = 0.0_wp
         do b = 1, size(df, 2)
            slope = slope + sliders%df_dz(:, a, b)*self%path(1, b, path_part%at_end, :)
         end do
         do k = 1, size(self%states, 2)
            slope = slope + sliders%df_ds(:, a, k)*self%states(1, k, :)
         end do
         df(sample, a) = slope
      end do
   end subroutine force_of_line

   !> Those of the samples of several steps, by one evaluation of the law.
   subroutine force_of_steps(self, sliders, law, characteristic, steps, df)
      class(slider_derivative_t), intent(in) :: self
      type(slider_states_t), intent(in) :: sliders
      class(hysteretic_law_t), intent(in) :: law
      type(characteristic_t), intent(in) :: characteristic
      integer, intent(in) :: steps(2)                                 !! first and last
      real(wp), intent(inout) :: df(:, :)                             !! (n_samples, n_coordinates)
      real(wp), allocatable :: f(:, :), df_dz(:, :, :), df_ds(:, :, :), slope(:), states(:, :), z(:, :)
      integer :: a, b, k, n

      associate (n_coordinates => size(df, 2), n_states => size(self%states, 2), at_end => path_part%at_end, &
                 first => steps(1), last => steps(2))
         n = characteristic%n_slice*(last - first + 1)
         allocate (f(n, n_coordinates), df_dz(n, n_coordinates, n_coordinates), df_ds(n, n_coordinates, n_states), slope(n))
         allocate (z(n, n_coordinates), states(n, n_states))
         do b = 1, n_coordinates
            z(:, b) = reshape(sliders%path(:, b, at_end, first:last), [n])
         end do
         do k = 1, n_states
            states(:, k) = reshape(sliders%states(:, k, first:last), [n])
         end do
         call law%force(z, states, f, df_dz, df_ds)
         do a = 1, n_coordinates
            slope = 0.0_wp
            do b = 1, n_coordinates
               slope = slope + df_dz(:, a, b)*reshape(self%path(:, b, at_end, first:last), [n])
            end do
            do k = 1, n_states
               slope = slope + df_ds(:, a, k)*reshape(self%states(:, k, first:last), [n])
            end do
            df(reshape(characteristic%sample(:, first:last), [n]), a) = slope
         end do
      end associate
   end subroutine force_of_steps
end module hb_slider_derivative
