!> Response of the force of a law with memory to the coefficients of its motion under one tone, without an integration
!> along time for each of them.
!> Under one tone the samples form a single line in time. A slider that slips moves with the bound that moves it; one
!> that sticks remains where it was moved last. The derivative of the force is therefore a product with the motion at
!> the same sample, g, plus a term of rank one for each interval of sticking: the samples of the interval times the
!> motion where the slider was moved last. Sums over consecutive samples are Dirichlet kernels. Source:
!> docs/why/theory.md, section 5.5.
module hb_line_tangent
   use hb_characteristic, only: characteristic_t
   use hb_harmonics, only: harmonics_t
   use hb_hysteretic_law, only: hysteretic_law_t, n_path_parts, path_part
   use hb_kinds, only: two_pi, wp
   use hb_slider_states, only: slider_states_t
   implicit none
   private
   public :: line_tangent_t, new_line_tangent

   !> Complex numbers of all harmonics: sums of exp(i j.tau).
   type :: line_tangent_t
      logical :: is_available = .false.                               !! after `prepare`: the method applies to the law
      real(wp), allocatable :: g(:)                                   !! after `find`, (n_steps) [N/m]
      integer :: n_runs = 0
      complex(wp), allocatable :: stuck(:, :) !! sum over the samples of an interval, (n_harmonics, intervals)
      complex(wp), allocatable :: pushed(:, :)                        !! motion where the slider was moved last, as `stuck`
      integer, allocatable, private :: order(:)                       ! (n_harmonics) entry of the tuple
      integer, private :: n_steps = 0
      integer, private :: n_period = 0                                ! steps of a whole period, twice those of half a torus
      complex(wp), allocatable, private :: half_turn(:)               ! exp(i pi m/n_period), m = 0 to 2 n_period - 1
      complex(wp), allocatable, private :: factor(:, :)               ! (n_harmonics, n_path_parts) path of exp(i j tau)
      real(wp), allocatable, private :: df_dz(:, :, :), df_ds(:, :, :)   ! (n_steps, n_coordinates, any)
   contains
      procedure :: prepare => line_tangent_prepare
      procedure :: find => line_tangent_find
   end type line_tangent_t

contains

   !> Creates the tables for one tone.
   subroutine new_line_tangent(self, characteristic, harmonics, frequencies)
      type(line_tangent_t), intent(out) :: self
      type(characteristic_t), intent(in) :: characteristic
      type(harmonics_t), intent(in) :: harmonics
      real(wp), intent(in) :: frequencies(:)                          !! j.omega [rad/s], (n_harmonics)
      real(wp) :: angle
      integer :: h, m

      self%n_steps = characteristic%n_steps
      self%n_period = merge(1, 2, characteristic%closing > 0.0_wp)*self%n_steps
      self%order = harmonics%tuples(1, :)
      allocate (self%half_turn(0:2*self%n_period - 1), self%factor(harmonics%n_harmonics, n_path_parts))
      allocate (self%g(self%n_steps))
      do m = 0, 2*self%n_period - 1
         angle = 0.5_wp*two_pi*m/self%n_period
         self%half_turn(m) = cmplx(cos(angle), sin(angle), wp)
      end do
      do h = 1, harmonics%n_harmonics
         angle = frequencies(h)*characteristic%step
         self%factor(h, path_part%at_end) = 1.0_wp
         self%factor(h, path_part%at_start) = cmplx(cos(angle), -sin(angle), wp)
         self%factor(h, path_part%end_rate) = cmplx(0.0_wp, angle, wp)
         self%factor(h, path_part%start_rate) = angle*cmplx(sin(angle), cos(angle), wp)
      end do
   end subroutine new_line_tangent

   !> Integrates one more round with derivatives, from periodic states, and checks whether each state is held or moved
   !> in each step, moved at least once, and enters the force with a constant slope.
   subroutine line_tangent_prepare(self, memory, law, characteristic)
      class(line_tangent_t), intent(inout) :: self
      type(slider_states_t), intent(inout) :: memory
      class(hysteretic_law_t), intent(in) :: law
      type(characteristic_t), intent(in) :: characteristic
      real(wp) :: change, largest_move
      real(wp), allocatable :: f(:, :), s(:, :), z(:, :)
      integer :: c, i, k, n_runs

      self%is_available = .false.
      if (characteristic%n_slice /= 1 .or. .not. memory%repeats) return
      call memory%differentiable()
      call memory%integrate_round(law, characteristic, with_derivatives=.true., change=change, largest_move=largest_move)
      n_runs = 0
      do k = 1, law%n_states
         do i = 1, self%n_steps
            associate (held => memory%ds_ds_old(1, k, :, i))
               if (any(held /= 0.0_wp .and. held /= 1.0_wp) .or. count(held /= 0.0_wp) /= count(held(k:k) /= 0.0_wp)) return
            end associate
         end do
         associate (is_held => memory%ds_ds_old(1, k, k, :) /= 0.0_wp)
            if (all(is_held)) return
            n_runs = n_runs + count(is_held .and. .not. cshift(is_held, -1))
            n_runs = n_runs + count(.not. is_held .and. is_turned(memory, k))
         end associate
      end do
      if (allocated(self%stuck)) deallocate (self%stuck, self%pushed)
      allocate (self%stuck(size(self%order), n_runs), self%pushed(size(self%order), n_runs))
      c = size(memory%path, 2)
      z = transpose(memory%path(1, :, path_part%at_end, :))
      s = transpose(memory%states(1, :, :))
      allocate (f, mold=z)
      if (.not. allocated(self%df_dz)) allocate (self%df_dz(self%n_steps, c, c), self%df_ds(self%n_steps, c, law%n_states))
      call law%force(z, s, f, self%df_dz, self%df_ds)
      do k = 1, law%n_states
         do i = 1, c
            if (any(self%df_ds(:, i, k) /= self%df_ds(1, i, k))) return
         end do
      end do
      self%is_available = .true.
   end subroutine line_tangent_prepare

   !> Whether the state k is moved within a step by more than the bound at its end.
   pure function is_turned(memory, k)
      type(slider_states_t), intent(in) :: memory
      integer, intent(in) :: k
      logical :: is_turned(size(memory%ds_dpath, 5))
      integer :: i

      do i = 1, size(is_turned)
         associate (parts => memory%ds_dpath(1, k, :, :, i))
            is_turned(i) = any(parts(:, [path_part%at_start, path_part%end_rate, path_part%start_rate]) /= 0.0_wp)
         end associate
      end do
   end function is_turned

   !> The product g and the intervals of sticking for the response of force `a` to coordinate `c`, after `prepare`.
   subroutine line_tangent_find(self, memory, a, c)
      class(line_tangent_t), intent(inout) :: self
      type(slider_states_t), intent(in) :: memory
      integer, intent(in) :: a, c
      logical :: turned(self%n_steps)
      integer :: first, i, k, last_push, n_stuck, step

      self%g = self%df_dz(:, a, c)
      self%n_runs = 0
      do k = 1, size(self%df_ds, 3)
         associate (slope => self%df_ds(1, a, k))
            if (slope == 0.0_wp) cycle
            turned = is_turned(memory, k)
            last_push = 1
            do while (memory%ds_ds_old(1, k, k, last_push) /= 0.0_wp)  ! one exists, see prepare
               last_push = last_push + 1
            end do
            first = last_push
            n_stuck = merge(1, 0, turned(first))
            if (.not. turned(first)) self%g(first) = self%g(first) + slope*memory%ds_dpath(1, k, c, path_part%at_end, first)
            do i = 1, self%n_steps
               step = 1 + modulo(first - 1 + i, self%n_steps)
               if (i < self%n_steps .and. memory%ds_ds_old(1, k, k, step) /= 0.0_wp) then
                  n_stuck = n_stuck + 1
                  cycle
               end if
               if (n_stuck > 0) call add_run(self, memory, slope, k, c, last_push, step - n_stuck, n_stuck)
               if (i == self%n_steps) exit
               last_push = step
               n_stuck = merge(1, 0, turned(step))
               if (.not. turned(step)) self%g(step) = self%g(step) + slope*memory%ds_dpath(1, k, c, path_part%at_end, step)
            end do
         end associate
      end do
   end subroutine line_tangent_find

   !> Adds an interval of `n` samples from `from` (perhaps below 1) during which state k remains where step `push`
   !> left it.
   subroutine add_run(self, memory, slope, k, c, push, from, n)
      type(line_tangent_t), intent(inout) :: self
      type(slider_states_t), intent(in) :: memory
      real(wp), intent(in) :: slope
      integer, intent(in) :: k, c, push, from, n
      complex(wp) :: path
      integer :: h, part, pushed_at

      pushed_at = push
      if (from < push) pushed_at = push - self%n_steps                ! before the samples of the interval, in the previous round
      self%n_runs = self%n_runs + 1
      do h = 1, size(self%order)
         associate (j => self%order(h))
            ! sum of exp(i j theta s) over s = from - 1, ..., from + n - 2 by Dirichlet's kernel, theta = 2 pi/n_period
            if (modulo(j, self%n_period) == 0) then
               self%stuck(h, self%n_runs) = slope*n
            else
               self%stuck(h, self%n_runs) = slope*turned_by(self, j*(2*from + n - 3))* &
                                            (aimag(turned_by(self, j*n))/aimag(turned_by(self, j)))
            end if
            path = 0.0_wp
            do part = 1, n_path_parts
               path = path + memory%ds_dpath(1, k, c, part, push)*self%factor(h, part)
            end do
            self%pushed(h, self%n_runs) = path*turned_by(self, 2*j*(pushed_at - 1))
         end associate
      end do
   end subroutine add_run

   !> exp(i pi m/n_period)
   pure complex(wp) function turned_by(self, m)
      type(line_tangent_t), intent(in) :: self
      integer, intent(in) :: m

      turned_by = self%half_turn(modulo(m, 2*self%n_period))
   end function turned_by
end module hb_line_tangent
