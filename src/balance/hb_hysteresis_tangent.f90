!> Response of the force of one hysteretic law to each coefficient of its motion: the exact derivative of the discrete
!> time integration over the torus.
!> Columns belong to the motions exp(i j.tau) of a coordinate; real and imaginary part are those of cos and sin. They
!> follow the steps of the last round of the states, with every step replaced by its derivative, until they are periodic
!> as well; where the states do not forget their start, from rest and through all rounds. A block of columns is processed
!> at once. Source:
!> docs/why/theory.md, section 5.5.
module hb_hysteresis_tangent
   use hb_cancellation, only: spend_work, work_is_over
   use hb_characteristic, only: characteristic_t
   use hb_harmonics, only: harmonics_t
   use hb_hysteretic_law, only: hysteretic_law_t, n_path_parts, path_part
   use hb_kinds, only: two_pi, wp
   use hb_slider_states, only: max_rounds, repeat_tolerance, slider_states_t
   use hb_torus, only: torus_t
   implicit none
   private
   public :: block_width, memory_tangent_t, new_memory_tangent

   integer, parameter :: block_width = 16                             !! harmonics of a block

   !> Complex numbers of a block are stored as (width, 2): real parts, imaginary parts.
   type :: memory_tangent_t
      integer :: n_blocks = 0
      integer, allocatable, private :: n_harmonics(:)                 ! (n_blocks) in each block
      real(wp), allocatable, private :: factor(:, :, :, :)            ! (width, 2, n_path_parts, n_blocks) path of exp(i j.tau)
      real(wp), allocatable, private :: lead(:, :, :, :)              ! (width, 2, n_steps, n_blocks) exp of the leading tone
      real(wp), allocatable, private :: across(:, :, :, :)            ! (width, 2, n_slice, n_blocks) exp of the others
      real(wp), allocatable, private :: first_slice(:, :, :, :, :, :) ! (width, 2, n_states, n_slice, n_blocks, n_coordinates)
      real(wp), allocatable, private :: closing(:, :)                 ! transposed, states fastest, if the memory has it
      real(wp), allocatable, private :: now(:, :, :, :), before(:, :, :, :)   ! (width, 2, n_states, n_slice)
      real(wp), allocatable, private :: df_dz(:, :, :, :), df_ds(:, :, :, :)  ! (n_slice, n_coordinates, any, n_steps)
   contains
      procedure :: prepare => memory_tangent_prepare
      procedure :: respond => memory_tangent_respond
   end type memory_tangent_t

contains

   !> Allocates memory, and tables of exp(i j.tau), for a law.
   subroutine new_memory_tangent(self, characteristic, harmonics, torus, frequencies, n_coordinates, n_states)
      type(memory_tangent_t), intent(out) :: self
      type(characteristic_t), intent(in) :: characteristic
      type(harmonics_t), intent(in) :: harmonics
      type(torus_t), intent(in) :: torus
      real(wp), intent(in) :: frequencies(:)                          !! j.omega [rad/s], (n_harmonics)
      integer, intent(in) :: n_coordinates, n_states
      integer :: block, h, i, k

      self%n_blocks = (harmonics%n_harmonics + block_width - 1)/block_width
      associate (n_slice => characteristic%n_slice, n_steps => characteristic%n_steps, tone => characteristic%tone)
         allocate (self%n_harmonics(self%n_blocks))
         allocate (self%factor(block_width, 2, n_path_parts, self%n_blocks), source=0.0_wp)
         allocate (self%lead(block_width, 2, n_steps, self%n_blocks), source=0.0_wp)
         allocate (self%across(block_width, 2, n_slice, self%n_blocks), source=0.0_wp)
         allocate (self%first_slice(block_width, 2, n_states, n_slice, self%n_blocks, n_coordinates))
         allocate (self%now(block_width, 2, n_states, n_slice), self%before(block_width, 2, n_states, n_slice))
         allocate (self%df_dz(n_slice, n_coordinates, n_coordinates, n_steps))
         allocate (self%df_ds(n_slice, n_coordinates, n_states, n_steps))
         do block = 1, self%n_blocks
            self%n_harmonics(block) = min(block_width, harmonics%n_harmonics - (block - 1)*block_width)
            do h = 1, self%n_harmonics(block)
               k = (block - 1)*block_width + h
               associate (angle => frequencies(k)*characteristic%step, factor => self%factor(h, :, :, block))
                  factor(:, path_part%at_end) = [1.0_wp, 0.0_wp]
                  factor(:, path_part%at_start) = [cos(angle), -sin(angle)]
                  factor(:, path_part%end_rate) = [0.0_wp, angle]
                  factor(:, path_part%start_rate) = angle*[sin(angle), cos(angle)]
               end associate
               do i = 1, n_steps
                  self%lead(h, :, i, block) = wave(torus, harmonics%tuples(:, k), i, tone, tone)
               end do
               do i = 1, n_slice
                  self%across(h, :, i, block) = wave_across(torus, tone, harmonics%tuples(:, k), i)
               end do
            end do
         end do
      end associate
   end subroutine new_memory_tangent

   !> exp(i j.tau) of tones first to last, at sample i of the grid of these tones alone.
   pure function wave(torus, j, i, first, last)
      type(torus_t), intent(in) :: torus
      integer, intent(in) :: j(:), i, first, last
      real(wp) :: wave(2), angle
      integer :: m, quotient

      quotient = i - 1
      angle = 0.0_wp
      do m = first, last
         associate (n => torus%n_samples(m))
            angle = angle + two_pi*modulo(j(m)*modulo(quotient, n), n)/n
            quotient = quotient/n
         end associate
      end do
      wave = [cos(angle), sin(angle)]
   end function wave

   !> Cosine and sine of the phase of tuple j at sample p of a slice: of all tones except the leading one.
   pure function wave_across(torus, tone, j, p)
      type(torus_t), intent(in) :: torus
      integer, intent(in) :: tone, j(:), p
      real(wp) :: wave_across(2), below(2), above(2)
      integer :: inner

      inner = product(torus%n_samples(:tone - 1))
      below = wave(torus, j, 1 + modulo(p - 1, inner), 1, tone - 1)
      above = wave(torus, j, 1 + (p - 1)/inner, tone + 1, size(j))
      wave_across = [below(1)*above(1) - below(2)*above(2), below(1)*above(2) + below(2)*above(1)]
   end function wave_across

   !> Repeats the last round of the states, and integrates all columns, if necessary, through the rounds before. The memory
   !> must have its path.
   subroutine memory_tangent_prepare(self, memory, law, characteristic)
      class(memory_tangent_t), intent(inout) :: self
      type(slider_states_t), intent(inout) :: memory
      class(hysteretic_law_t), intent(in) :: law
      type(characteristic_t), intent(in) :: characteristic
      real(wp), allocatable :: f(:, :)
      integer :: i

      call memory%repeat_last_round(law, characteristic)
      call memory%find_closing(law, characteristic)
      call adopt_closing(self, memory)
      if (allocated(self%closing) .or. memory%has_jumped .or. memory%forgets_start(characteristic)) then
         self%first_slice = 0.0_wp
      else
         call integrate_rounds(self, memory, law, characteristic)
      end if
      allocate (f(characteristic%n_slice, size(memory%path, 2)))
      do i = 1, characteristic%n_steps
         call law%force(memory%path(:, :, path_part%at_end, i), memory%states(:, :, i), f, self%df_dz(:, :, :, i), &
                        self%df_ds(:, :, :, i))
      end do
   end subroutine memory_tangent_prepare

   !> Integrates states and columns from rest through all rounds.
   subroutine integrate_rounds(self, memory, law, characteristic)
      class(memory_tangent_t), intent(inout) :: self
      type(slider_states_t), intent(inout) :: memory
      class(hysteretic_law_t), intent(in) :: law
      type(characteristic_t), intent(in) :: characteristic
      real(wp) :: change, largest_move
      integer :: block, c, round

      call memory%load_from_rest(law, with_derivatives=.true.)
      call load_columns(self, memory)
      do round = 1, memory%rounds
         call memory%integrate_round(law, characteristic, with_derivatives=.true., change=change, largest_move=largest_move)
         if (round == memory%rounds) exit
         do c = 1, size(self%first_slice, 6)
            do block = 1, self%n_blocks
               if (work_is_over()) return                             ! the solver ends too
               self%before = self%first_slice(:, :, :, :, block, c)
               call integrate_round(self, memory, characteristic, block, c)
               self%first_slice(:, :, :, :, block, c) = self%before
            end do
         end do
         if (round /= memory%levelled_at) cycle
         call memory%average_first_slice()
         self%first_slice = spread(sum(self%first_slice, dim=4)/characteristic%n_slice, 4, characteristic%n_slice)
      end do
   end subroutine integrate_rounds

   !> Columns of the first slice after loading from rest.
   subroutine load_columns(self, memory)
      class(memory_tangent_t), intent(inout) :: self
      type(slider_states_t), intent(in) :: memory
      real(wp) :: slope, wave(block_width, 2)
      integer :: block, c, k, p

      do c = 1, size(self%first_slice, 6)
         do block = 1, self%n_blocks
            do p = 1, size(self%first_slice, 4)
               wave = times(self%lead(:, :, 1, block), self%across(:, :, p, block))
               do k = 1, size(self%first_slice, 3)
                  associate (parts => memory%ds_dpath(p, k, c, :, 1))
                     slope = parts(path_part%at_end) + parts(path_part%end_rate) + parts(path_part%start_rate)
                  end associate
                  self%first_slice(:, :, k, p, block, c) = slope*wave
               end do
            end do
         end do
      end do
   end subroutine load_columns

   !> Response of all forces of the law, at the samples of the torus, to the columns of one block and one coordinate,
   !> with the steps of the last round of the states, repeated until the columns are periodic.
   subroutine memory_tangent_respond(self, memory, characteristic, block, coordinate, df)
      class(memory_tangent_t), intent(inout) :: self
      type(slider_states_t), intent(in) :: memory
      type(characteristic_t), intent(in) :: characteristic
      integer, intent(in) :: block, coordinate
      real(wp), intent(out) :: df(block_width, 2, size(memory%path, 2), *) !! [N/m], (.., n_samples)
      integer :: round
      real(wp) :: change

      associate (first => self%first_slice(:, :, :, :, block, coordinate))
         self%before = first
         if (allocated(self%closing)) then
            call integrate_round(self, memory, characteristic, block, coordinate)
            call close_columns(self, first)
         end if
         do round = 1, max_rounds
            if (work_is_over() .and. round > 1) return                ! the solver ends too
            call integrate_round(self, memory, characteristic, block, coordinate, df)
            change = maxval(abs(self%before - first))
            if (change <= repeat_tolerance*max(1.0_wp, maxval(abs(self%before)))) return
            if (allocated(self%closing)) then
               call close_columns(self, first)
            else
               first = self%before
            end if
         end do
      end associate
   end subroutine memory_tangent_respond

   !> Takes over (1 - M)**-1 of the last round in the order of the columns.
   subroutine adopt_closing(self, memory)
      class(memory_tangent_t), intent(inout) :: self
      type(slider_states_t), intent(in) :: memory
      integer :: n_slice, n_states

      if (allocated(self%closing)) deallocate (self%closing)
      if (.not. allocated(memory%closing)) return
      n_slice = size(memory%states, 1)
      n_states = size(memory%states, 2)
      self%closing = reshape(reshape(transpose(memory%closing), [n_states, n_slice, n_states, n_slice], order=[2, 1, 4, 3]), &
                             shape(memory%closing))
   end subroutine adopt_closing

   !> Moves the columns of the first slice from where a round began to what repeats itself; `before` contains them after the round.
   subroutine close_columns(self, first)
      class(memory_tangent_t), intent(inout) :: self
      real(wp), intent(inout) :: first(:, :, :, :)                    !! (width, 2, n_states, n_slice)
      real(wp) :: change(2*block_width, size(self%closing, 1))

      change = reshape(self%before - first, shape(change))
      self%before = first + reshape(matmul(change, self%closing), shape(first))
      first = self%before
   end subroutine close_columns

   !> Integrates the columns `before` of the first slice through one round; with `df` stores the forces.
   subroutine integrate_round(self, memory, characteristic, block, coordinate, df)
      class(memory_tangent_t), intent(inout) :: self
      type(slider_states_t), intent(in) :: memory
      type(characteristic_t), intent(in) :: characteristic
      integer, intent(in) :: block, coordinate
      real(wp), intent(inout), optional :: df(block_width, 2, size(memory%path, 2), *)
      real(wp), parameter :: per_value = 2.0_wp, per_neighbour = 0.3_wp ! see hb_solver_types%unit_of_work
      integer :: i, p, slice
      real(wp) :: wave(block_width, 2)

      call spend_work(characteristic%work_of_round(2*block_width*size(self%now, 3), per_value, per_neighbour))
      do i = 2, characteristic%n_steps + 1
         slice = 1 + modulo(i - 1, characteristic%n_steps)
         if (slice == 1) self%before = characteristic%closing*self%before
         do p = 1, characteristic%n_slice
            wave = times(self%lead(:, :, slice, block), self%across(:, :, p, block))
            call step(self, memory, characteristic, slice, p, coordinate, self%factor(:, :, :, block), wave)
            if (present(df)) call store_forces(self, characteristic%sample(p, slice), slice, p, coordinate, wave, df)
         end do
         call exchange(self%now, self%before)
      end do
   end subroutine integrate_round

   !> Derivative of one step of one sample: from `before` into `now`.
   subroutine step(self, memory, characteristic, slice, p, coordinate, factor, wave)
      class(memory_tangent_t), intent(inout) :: self
      type(slider_states_t), intent(in) :: memory
      type(characteristic_t), intent(in) :: characteristic
      integer, intent(in) :: slice, p, coordinate
      real(wp), intent(in) :: factor(block_width, 2, n_path_parts), wave(block_width, 2)
      real(wp) :: old(block_width, 2), source(block_width, 2), slope
      integer :: k, n_states, old_state, part

      n_states = size(self%now, 3)
      do k = 1, n_states
         if (.not. any(abs(memory%ds_dpath(p, k, coordinate, :, slice)) > 0.0_wp)) then
            self%now(:, :, k, p) = 0.0_wp
            cycle
         end if
         source = 0.0_wp
         do part = 1, n_path_parts
            slope = memory%ds_dpath(p, k, coordinate, part, slice)
            if (abs(slope) > 0.0_wp) source = source + slope*factor(:, :, part)
         end do
         self%now(:, :, k, p) = times(source, wave)
      end do
      do old_state = 1, n_states
         if (.not. any(abs(memory%ds_ds_old(p, :, old_state, slice)) > 0.0_wp)) cycle
         call blend(n_states, old_state, characteristic%neighbour(:, p), characteristic%weight, self%before, old)
         do k = 1, n_states
            slope = memory%ds_ds_old(p, k, old_state, slice)
            if (abs(slope) > 0.0_wp) self%now(:, :, k, p) = self%now(:, :, k, p) + slope*old
         end do
      end do
   end subroutine step

   !> One state at the start of a step: the sum of weights times that state of the neighbours, whose number is 1 or a
   !> multiple of 4.
   pure subroutine blend(n_states, state, neighbour, weight, before, blended)
      integer, intent(in) :: n_states, state
      integer, intent(in), contiguous :: neighbour(:)
      real(wp), intent(in), contiguous :: weight(:)
      real(wp), intent(in) :: before(2*block_width, n_states, *)
      real(wp), intent(out) :: blended(2*block_width)
      integer :: q

      if (size(neighbour) == 1) then
         blended = weight(1)*before(:, state, neighbour(1))
         return
      end if
      blended = 0.0_wp
      do q = 1, size(neighbour), 4
         blended = blended + weight(q)*before(:, state, neighbour(q)) + weight(q + 1)*before(:, state, neighbour(q + 1)) &
                   + weight(q + 2)*before(:, state, neighbour(q + 2)) + weight(q + 3)*before(:, state, neighbour(q + 3))
      end do
   end subroutine blend

   subroutine store_forces(self, sample, slice, p, coordinate, wave, df)
      class(memory_tangent_t), intent(in) :: self
      integer, intent(in) :: sample, slice, p, coordinate
      real(wp), intent(in) :: wave(block_width, 2)
      real(wp), intent(inout) :: df(block_width, 2, size(self%df_dz, 2), *)
      integer :: a, k

      do a = 1, size(df, 3)
         df(:, :, a, sample) = self%df_dz(p, a, coordinate, slice)*wave
         do k = 1, size(self%now, 3)
            df(:, :, a, sample) = df(:, :, a, sample) + self%df_ds(p, a, k, slice)*self%now(:, :, k, p)
         end do
      end do
   end subroutine store_forces

   !> Product of complex numbers.
   pure function times(a, b) result(c)
      real(wp), intent(in) :: a(block_width, 2), b(block_width, 2)
      real(wp) :: c(block_width, 2)

      c(:, 1) = a(:, 1)*b(:, 1) - a(:, 2)*b(:, 2)
      c(:, 2) = a(:, 1)*b(:, 2) + a(:, 2)*b(:, 1)
   end function times

   subroutine exchange(a, b)
      real(wp), allocatable, intent(inout) :: a(:, :, :, :), b(:, :, :, :)
      real(wp), allocatable :: c(:, :, :, :)

      call move_alloc(a, c)
      call move_alloc(b, a)
      call move_alloc(c, b)
   end subroutine exchange
end module hb_hysteresis_tangent
