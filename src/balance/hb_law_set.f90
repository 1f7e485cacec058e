!> All laws of a scene on the samples of one torus: total force and its derivatives at the degrees of freedom of the laws.
!>
!> Explicit laws come first; a multiplier law then sees the reaction p = s - (explicit forces) that equilibrium asks of it
!> at each sample, s = (loads - S u)(tau). Laws with memory are explicit; their states come from a walk along time.
!> Source: docs/theory.md, sections 5.3 to 5.5.
module hb_law_set
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite, ieee_quiet_nan, ieee_value
   use hb_characteristic, only: characteristic_t, new_characteristic
   use hb_error, only: error_t
   use hb_fftw, only: new_real_block, real_block_t
   use hb_harmonics, only: harmonics_t
   use hb_hysteretic_law, only: hysteretic_law_t, path_part
   use hb_kinds, only: wp
   use hb_law, only: defects_t, law_box_t
   use hb_memory_tangent, only: memory_tangent_t, new_memory_tangent, width
   use hb_slider_memory, only: memory_t, new_memory
   use hb_text, only: to_text
   use hb_torus, only: torus_t
   implicit none
   private
   public :: law_dofs_of, law_set_t, new_law_set

   !> One law with its samples.
   type :: slot_t
      integer, allocatable :: columns(:)                              ! of its degrees of freedom among those of all laws
      real(wp), allocatable :: z(:, :), v(:, :), p(:, :), f(:, :)     ! (n_samples, n_coordinates, or no columns)
      real(wp), allocatable :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)
      type(memory_t), allocatable :: memory                           ! of a law that has one
      type(memory_tangent_t), allocatable :: tangent                  ! of its memory, from the first use on
      real(wp), allocatable :: answer(:, :, :, :)                     ! (width, 2, n_coordinates, n_samples) to a block of columns
   end type slot_t

   !> Owner of outside resources: call `destroy`.
   type :: law_set_t
      integer :: n_dofs = 0                                           !! degrees of freedom on which laws act
      integer :: n_pairs = 0                                          !! pairs (i, k) with d force_i/d motion_k not zero
      logical :: needs_velocity = .false.
      logical :: needs_reaction = .false.
      logical :: has_memory = .false.                                 !! then q_before, step_rate, step_rate_before are needed
      type(characteristic_t) :: characteristic                        !! steps along time, for laws with memory
      integer, allocatable :: row(:), column(:)                       !! (n_pairs) i and k of each pair
      type(law_box_t), allocatable :: laws(:)
      character(:), allocatable :: complaint                          !! why a law had no finite force so far
      logical :: is_given_up = .false.                                !! a law cannot go on: all forces are NaN from then on
      type(real_block_t) :: q, v, s, f                                !! motion, rate, reaction, force, (n_samples, n_dofs)
      type(real_block_t) :: q_before                                  !! motion one step before each sample
      type(real_block_t) :: step_rate, step_rate_before               !! rate times the step, there and one step before
      type(real_block_t) :: df_dq, df_dv, df_ds                       !! (n_samples, n_pairs)
      type(slot_t), allocatable, private :: slots(:)
      integer, allocatable, private :: pair_at(:, :)                  ! (n_dofs, n_dofs), 0: no pair
      logical, private :: has_derivatives = .false.
   contains
      procedure :: columns_of => law_set_columns_of
      procedure :: evaluate => law_set_evaluate
      procedure :: differentiate => law_set_differentiate
      procedure :: prepare_answers => law_set_prepare_answers
      procedure :: n_blocks => law_set_n_blocks
      procedure :: answer_block => law_set_answer_block
      procedure :: answer => law_set_answer
      procedure :: answering_dofs => law_set_answering_dofs
      procedure :: memory_trouble => law_set_memory_trouble
      procedure :: full_stick => law_set_full_stick
      procedure :: spring_forces => law_set_spring_forces
      procedure :: correct => law_set_correct
      procedure :: defects => law_set_defects
      procedure :: isolate_force => law_set_isolate_force
      procedure :: mean_slopes => law_set_mean_slopes
      procedure :: destroy => law_set_destroy
   end type law_set_t

contains

   !> Degrees of freedom of the structure on which any law acts, ascending and once each.
   pure function law_dofs_of(laws) result(dofs)
      type(law_box_t), intent(in) :: laws(:)
      integer, allocatable :: dofs(:)
      logical, allocatable :: is_used(:)
      integer :: i, last

      last = 0
      do i = 1, size(laws)
         last = max(last, maxval(laws(i)%law%dofs))
      end do
      allocate (is_used(last), source=.false.)
      do i = 1, size(laws)
         is_used(laws(i)%law%dofs) = .true.
      end do
      dofs = pack([(i, i=1, last)], is_used)
   end function law_dofs_of

   !> Prepares the samples of all laws on a grid. Derivatives get their memory at their first use.
   subroutine new_law_set(self, laws, torus, omega, error)
      type(law_set_t), intent(inout) :: self
      type(law_box_t), intent(in) :: laws(:)                          !! no two multipliers on one degree of freedom
      type(torus_t), intent(in) :: torus
      real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s], (n_tones)
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: dofs(:)
      integer :: c, i, k, n_samples

      call self%destroy()
      n_samples = torus%n_total
      self%has_memory = any_hysteretic(laws)
      if (self%has_memory) call new_characteristic(self%characteristic, torus, omega)
      self%has_derivatives = .false.
      self%needs_velocity = .false.
      self%needs_reaction = .false.
      self%is_given_up = .false.
      if (allocated(self%complaint)) deallocate (self%complaint)
      self%laws = laws
      dofs = law_dofs_of(laws)
      self%n_dofs = size(dofs)
      if (allocated(self%slots)) deallocate (self%slots)
      allocate (self%slots(size(laws)))
      do i = 1, size(laws)
         associate (law => laws(i)%law, slot => self%slots(i))
            slot%columns = [(findloc(dofs, law%dofs(k), dim=1), k=1, size(law%dofs))]
            c = size(law%shape, 2)
            self%needs_velocity = self%needs_velocity .or. law%needs_velocity
            self%needs_reaction = self%needs_reaction .or. law%is_multiplier
            allocate (slot%z(n_samples, c), slot%f(n_samples, c))
            allocate (slot%v(n_samples, merge(c, 0, law%needs_velocity)))
            allocate (slot%p(n_samples, merge(c, 0, law%is_multiplier)))
            select type (law)
            class is (hysteretic_law_t)
               allocate (slot%memory)
               call new_memory(slot%memory, self%characteristic, c, law%n_states)
            end select
         end associate
      end do
      call find_pairs(self)
      call new_real_block(self%q, n_samples, self%n_dofs, error)
      if (allocated(error)) return
      call new_real_block(self%f, n_samples, self%n_dofs, error)
      if (allocated(error)) return
      if (self%needs_velocity) call new_real_block(self%v, n_samples, self%n_dofs, error)
      if (allocated(error)) return
      if (self%needs_reaction) call new_real_block(self%s, n_samples, self%n_dofs, error)
      if (allocated(error) .or. .not. self%has_memory) return
      call new_real_block(self%q_before, n_samples, self%n_dofs, error)
      if (allocated(error)) return
      call new_real_block(self%step_rate, n_samples, self%n_dofs, error)
      if (allocated(error)) return
      call new_real_block(self%step_rate_before, n_samples, self%n_dofs, error)
   end subroutine new_law_set

   pure logical function any_hysteretic(laws)
      type(law_box_t), intent(in) :: laws(:)
      integer :: i

      any_hysteretic = .false.
      do i = 1, size(laws)
         select type (law => laws(i)%law)
         class is (hysteretic_law_t)
            any_hysteretic = .true.
         end select
      end do
   end function any_hysteretic

   !> Finds which forces depend on which motions at the same sample. A multiplier law passes on what the explicit laws beside
   !> it depend on. Laws with memory have no pairs: their forces depend on all samples.
   subroutine find_pairs(self)
      type(law_set_t), intent(inout) :: self
      logical, allocatable :: coupled(:, :)
      integer :: a, b, i, pass

      allocate (coupled(self%n_dofs, self%n_dofs), source=.false.)
      do pass = 1, 2                                                   ! explicit laws, then multipliers
         do i = 1, size(self%laws)
            if (self%laws(i)%law%is_multiplier .neqv. pass == 2) cycle
            if (allocated(self%slots(i)%memory)) cycle
            associate (columns => self%slots(i)%columns)
               do b = 1, size(columns)
                  do a = 1, size(columns)
                     coupled(columns(a), columns(b)) = .true.
                     if (pass == 2) coupled(columns(a), :) = coupled(columns(a), :) .or. coupled(columns(b), :)
                  end do
               end do
            end associate
         end do
      end do
      self%n_pairs = count(coupled)
      if (allocated(self%row)) deallocate (self%row, self%column, self%pair_at)
      allocate (self%row(self%n_pairs), self%column(self%n_pairs))
      allocate (self%pair_at(self%n_dofs, self%n_dofs), source=0)
      i = 0
      do b = 1, self%n_dofs
         do a = 1, self%n_dofs
            if (.not. coupled(a, b)) cycle
            i = i + 1
            self%row(i) = a
            self%column(i) = b
            self%pair_at(a, b) = i
         end do
      end do
   end subroutine find_pairs

   !> Where the degrees of freedom of law i stand among those of all laws.
   pure function law_set_columns_of(self, i) result(columns)
      class(law_set_t), intent(in) :: self
      integer, intent(in) :: i
      integer :: columns(size(self%slots(i)%columns))

      columns = self%slots(i)%columns
   end function law_set_columns_of

   !> Forces f from the samples q, v and s.
   subroutine law_set_evaluate(self)
      class(law_set_t), intent(inout) :: self

      call run_laws(self, with_derivatives=.false.)
   end subroutine law_set_evaluate

   !> Forces f and derivatives df_dq, df_dv, df_ds of all pairs from the samples q, v and s.
   subroutine law_set_differentiate(self, error)
      class(law_set_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error

      if (.not. self%has_derivatives) call allocate_derivatives(self, error)
      if (allocated(error)) return
      call run_laws(self, with_derivatives=.true.)
   end subroutine law_set_differentiate

   subroutine allocate_derivatives(self, error)
      class(law_set_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error
      integer :: i, n

      n = size(self%q%values, 1)
      call new_real_block(self%df_dq, n, self%n_pairs, error)
      if (allocated(error)) return
      if (self%needs_velocity) call new_real_block(self%df_dv, n, self%n_pairs, error)
      if (allocated(error)) return
      if (self%needs_reaction) call new_real_block(self%df_ds, n, self%n_pairs, error)
      if (allocated(error)) return
      do i = 1, size(self%slots)
         if (allocated(self%slots(i)%memory)) cycle
         associate (slot => self%slots(i))
            allocate (slot%df_dz(n, size(slot%z, 2), size(slot%z, 2)))
            allocate (slot%df_dv(n, size(slot%z, 2), size(slot%v, 2)))
            allocate (slot%df_dp(n, size(slot%z, 2), size(slot%p, 2)))
         end associate
      end do
      self%has_derivatives = .true.
   end subroutine allocate_derivatives

   subroutine run_laws(self, with_derivatives)
      class(law_set_t), intent(inout) :: self
      logical, intent(in) :: with_derivatives
      integer :: i, pass

      self%f%values = 0.0_wp
      if (with_derivatives) then
         self%df_dq%values = 0.0_wp
         if (self%needs_velocity) self%df_dv%values = 0.0_wp
         if (self%needs_reaction) self%df_ds%values = 0.0_wp
      end if
      if (self%is_given_up) then
         self%f%values = ieee_value(1.0_wp, ieee_quiet_nan)
         return
      end if
      do pass = 1, 2                                                   ! explicit laws, then multipliers
         do i = 1, size(self%laws)
            if (self%laws(i)%law%is_multiplier .neqv. pass == 2) cycle
            if (allocated(self%slots(i)%memory)) then
               call run_law_with_memory(self, i)
               call scatter(self, i)
               cycle
            end if
            call gather(self, i)
            associate (law => self%laws(i)%law, slot => self%slots(i))
               if (with_derivatives) then
                  call law%evaluate(slot%z, slot%v, slot%p, slot%f, slot%df_dz, slot%df_dv, slot%df_dp)
                  if (law%is_multiplier) then
                     call add_multiplier_derivatives(self, i)
                  else
                     call add_explicit_derivatives(self, i)
                  end if
               else
                  call law%evaluate(slot%z, slot%v, slot%p, slot%f)
               end if
            end associate
            call listen(self, i, with_derivatives)
            call scatter(self, i)
         end do
      end do
   end subroutine run_laws

   !> Forces of law i, which has memory: the states that repeat on its path, then the force sample by sample.
   subroutine run_law_with_memory(self, i)
      class(law_set_t), intent(inout) :: self
      integer, intent(in) :: i
      integer :: slice

      associate (slot => self%slots(i), shape => self%laws(i)%law%shape)
         call gather_part(self%q%values, path_part%at_end)
         call gather_part(self%q_before%values, path_part%at_start)
         call gather_part(self%step_rate%values, path_part%end_rate)
         call gather_part(self%step_rate_before%values, path_part%start_rate)
         select type (law => self%laws(i)%law)
         class is (hysteretic_law_t)
            call slot%memory%march(law, self%characteristic)
            do slice = 1, self%characteristic%n_steps
               call law%force(slot%memory%path(:, :, path_part%at_end, slice), slot%memory%states(:, :, slice), &
                              slot%memory%force)
               slot%f(self%characteristic%sample(:, slice), :) = slot%memory%force
            end do
         end select
      end associate

   contains

      !> One part of the paths of all coordinates from samples of the degrees of freedom.
      subroutine gather_part(values, part)
         real(wp), intent(in) :: values(:, :)
         integer, intent(in) :: part
         integer :: c, k, slice

         associate (slot => self%slots(i), shape => self%laws(i)%law%shape, sample => self%characteristic%sample)
            do slice = 1, size(sample, 2)
               do c = 1, size(shape, 2)
                  slot%memory%path(:, c, part, slice) = 0.0_wp
                  do k = 1, size(slot%columns)
                     if (abs(shape(k, c)) <= 0.0_wp) cycle
                     slot%memory%path(:, c, part, slice) = slot%memory%path(:, c, part, slice) &
                                                          + shape(k, c)*values(sample(:, slice), slot%columns(k))
                  end do
               end do
            end do
         end associate
      end subroutine gather_part
   end subroutine run_law_with_memory

   !> Remembers what law i says when its forces or derivatives are not finite, for the message of the point.
   subroutine listen(self, i, with_derivatives)
      class(law_set_t), intent(inout) :: self
      integer, intent(in) :: i
      logical, intent(in) :: with_derivatives
      character(:), allocatable :: text
      logical :: is_fatal, is_finite

      associate (law => self%laws(i)%law, slot => self%slots(i))
         is_finite = all(ieee_is_finite(slot%f))
         if (with_derivatives) is_finite = is_finite .and. all(ieee_is_finite(slot%df_dz)) .and. &
                                           all(ieee_is_finite(slot%df_dv)) .and. all(ieee_is_finite(slot%df_dp))
         if (is_finite) return
         call law%explain(slot%z, slot%v, text, is_fatal)
         if (len(text) == 0) text = "forces or derivatives are not finite"
         if (is_fatal .or. .not. allocated(self%complaint)) self%complaint = "law '"//law%label//"': "//text
         self%is_given_up = is_fatal
      end associate
   end subroutine listen

   !> Coordinates, their rates and the reaction of law i from the samples of its degrees of freedom.
   subroutine gather(self, i)
      class(law_set_t), intent(inout) :: self
      integer, intent(in) :: i
      integer :: c, k

      associate (shape => self%laws(i)%law%shape, slot => self%slots(i))
         do c = 1, size(shape, 2)
            slot%z(:, c) = shape(1, c)*self%q%values(:, slot%columns(1))
            do k = 2, size(slot%columns)
               slot%z(:, c) = slot%z(:, c) + shape(k, c)*self%q%values(:, slot%columns(k))
            end do
         end do
         if (size(slot%v, 2) > 0) then
            do c = 1, size(shape, 2)
               slot%v(:, c) = shape(1, c)*self%v%values(:, slot%columns(1))
               do k = 2, size(slot%columns)
                  slot%v(:, c) = slot%v(:, c) + shape(k, c)*self%v%values(:, slot%columns(k))
               end do
            end do
         end if
         if (size(slot%p, 2) > 0) then
            slot%p(:, 1) = 0.0_wp
            do k = 1, size(slot%columns)
               slot%p(:, 1) = slot%p(:, 1) + shape(k, 1)/sum(shape(:, 1)**2)* &
                              (self%s%values(:, slot%columns(k)) - self%f%values(:, slot%columns(k)))
            end do
         end if
      end associate
   end subroutine gather

   !> Adds the force of law i to those of its degrees of freedom.
   subroutine scatter(self, i)
      class(law_set_t), intent(inout) :: self
      integer, intent(in) :: i
      integer :: c, k

      associate (shape => self%laws(i)%law%shape, slot => self%slots(i))
         do c = 1, size(shape, 2)
            do k = 1, size(slot%columns)
               self%f%values(:, slot%columns(k)) = self%f%values(:, slot%columns(k)) + shape(k, c)*slot%f(:, c)
            end do
         end do
      end associate
   end subroutine scatter

   !> d force_i/d motion_k += sum over coordinates a, b of shape(i, a) df_a/dz_b shape(k, b), and the same for rates.
   subroutine add_explicit_derivatives(self, law)
      class(law_set_t), intent(inout) :: self
      integer, intent(in) :: law
      integer :: a, b, i, k, pair
      real(wp) :: weight

      associate (shape => self%laws(law)%law%shape, slot => self%slots(law))
         do k = 1, size(slot%columns)
            do i = 1, size(slot%columns)
               pair = self%pair_at(slot%columns(i), slot%columns(k))
               do b = 1, size(shape, 2)
                  do a = 1, size(shape, 2)
                     weight = shape(i, a)*shape(k, b)
                     if (weight == 0.0_wp) cycle                       ! most of them where coordinates are degrees of freedom
                     self%df_dq%values(:, pair) = self%df_dq%values(:, pair) + weight*slot%df_dz(:, a, b)
                     if (size(slot%v, 2) > 0) then
                        self%df_dv%values(:, pair) = self%df_dv%values(:, pair) + weight*slot%df_dv(:, a, b)
                     end if
                  end do
               end do
            end do
         end do
      end associate
   end subroutine add_explicit_derivatives

   !> Chain rule through p = w.(s - f_explicit)/w.w for a law of one coordinate with weights w.
   !> Its degrees of freedom belong to no other multiplier, so what stands in their rows so far is explicit.
   subroutine add_multiplier_derivatives(self, law)
      class(law_set_t), intent(inout) :: self
      integer, intent(in) :: law
      integer :: i, k, own, pair
      real(wp) :: w_k
      real(wp), allocatable :: slope_q(:), slope_v(:)

      associate (w => self%laws(law)%law%shape(:, 1), slot => self%slots(law), df_dp => self%slots(law)%df_dp(:, 1, 1))
         do k = 1, self%n_dofs
            if (self%pair_at(slot%columns(1), k) == 0) cycle
            own = findloc(slot%columns, k, dim=1)
            w_k = 0.0_wp
            if (own > 0) w_k = w(own)
            slope_q = w_k*slot%df_dz(:, 1, 1) - df_dp*explicit_slope(self%df_dq%values, k)
            if (self%needs_velocity) slope_v = -df_dp*explicit_slope(self%df_dv%values, k)
            if (size(slot%v, 2) > 0) slope_v = slope_v + w_k*slot%df_dv(:, 1, 1)
            do i = 1, size(slot%columns)
               pair = self%pair_at(slot%columns(i), k)
               self%df_dq%values(:, pair) = self%df_dq%values(:, pair) + w(i)*slope_q
               if (self%needs_velocity) self%df_dv%values(:, pair) = self%df_dv%values(:, pair) + w(i)*slope_v
               self%df_ds%values(:, pair) = self%df_ds%values(:, pair) + w(i)*w_k/sum(w**2)*df_dp
            end do
         end do
      end associate

   contains

      !> w.(d f_explicit/d motion_k)/w.w
      function explicit_slope(derivative, k) result(slope)
         real(wp), intent(in) :: derivative(:, :)
         integer, intent(in) :: k
         real(wp) :: slope(size(derivative, 1))
         integer :: m

         slope = 0.0_wp
         associate (w => self%laws(law)%law%shape(:, 1), columns => self%slots(law)%columns)
            do m = 1, size(columns)
               slope = slope + w(m)/sum(w**2)*derivative(:, self%pair_at(columns(m), k))
            end do
         end associate
      end function explicit_slope
   end subroutine add_multiplier_derivatives

   !> Prepares the answers of law i to coefficients of its motion, after `differentiate`; `has_answers` is false for a law
   !> without memory.
   subroutine law_set_prepare_answers(self, i, harmonics, torus, frequencies, has_answers)
      class(law_set_t), intent(inout) :: self
      integer, intent(in) :: i
      type(harmonics_t), intent(in) :: harmonics
      type(torus_t), intent(in) :: torus
      real(wp), intent(in) :: frequencies(:)                          !! j.omega [rad/s], (n_harmonics)
      logical, intent(out) :: has_answers

      associate (slot => self%slots(i))
         has_answers = allocated(slot%memory)
         if (.not. has_answers) return
         select type (law => self%laws(i)%law)
         class is (hysteretic_law_t)
            if (.not. allocated(slot%tangent)) then
               allocate (slot%tangent)
               call new_memory_tangent(slot%tangent, self%characteristic, harmonics, torus, frequencies, size(slot%z, 2), &
                                       law%n_states)
               allocate (slot%answer(width, 2, size(slot%z, 2), torus%n_total))
            end if
            call slot%tangent%prepare(slot%memory, law, self%characteristic)
         end select
      end associate
   end subroutine law_set_prepare_answers

   !> Number of blocks of at most hb_memory_tangent%width harmonics in which the answers come.
   pure integer function law_set_n_blocks(self, i)
      class(law_set_t), intent(in) :: self
      integer, intent(in) :: i                                        !! law with memory

      law_set_n_blocks = self%slots(i)%tangent%n_blocks
   end function law_set_n_blocks

   !> Finds the answers of law i to cos and sin of a block of harmonics of one of its coordinates.
   subroutine law_set_answer_block(self, i, coordinate, block)
      class(law_set_t), intent(inout) :: self
      integer, intent(in) :: i, coordinate, block

      associate (slot => self%slots(i))
         call slot%tangent%respond(slot%memory, self%characteristic, block, coordinate, slot%answer)
      end associate
   end subroutine law_set_answer_block

   !> Answer, at all samples, of the forces on degree of freedom k to cos (part 1) or sin (part 2) of harmonic h of the block
   !> that was found last. A multiplier law there supplies what equilibrium then asks of it.
   subroutine law_set_answer(self, i, h, part, k, samples)
      class(law_set_t), intent(in) :: self
      integer, intent(in) :: i                                        !! law with memory
      integer, intent(in) :: h                                        !! within the block
      integer, intent(in) :: part
      integer, intent(in) :: k                                        !! one of `answering_dofs`
      real(wp), intent(out) :: samples(:)                             !! [N/m], (n_samples)
      real(wp), allocatable :: asked(:)
      integer :: m, n, own

      samples = 0.0_wp
      call add_force_on(k, 1.0_wp, samples)
      do m = 1, size(self%laws)
         if (.not. self%laws(m)%law%is_multiplier) cycle
         own = findloc(self%slots(m)%columns, k, dim=1)
         if (own == 0) cycle
         allocate (asked(size(samples)), source=0.0_wp)
         associate (w => self%laws(m)%law%shape(:, 1), columns => self%slots(m)%columns)
            do n = 1, size(columns)
               call add_force_on(columns(n), -w(n)/sum(w**2), asked)
            end do
            samples = samples + w(own)*self%slots(m)%df_dp(:, 1, 1)*asked
         end associate
         return                                                       ! no other multiplier acts there
      end do

   contains

      subroutine add_force_on(dof, weight, to)
         integer, intent(in) :: dof
         real(wp), intent(in) :: weight
         real(wp), intent(inout) :: to(:)
         integer :: a, row

         row = findloc(self%slots(i)%columns, dof, dim=1)
         if (row == 0) return
         associate (shape => self%laws(i)%law%shape)
            do a = 1, size(shape, 2)
               if (abs(shape(row, a)) > 0.0_wp) to = to + weight*shape(row, a)*self%slots(i)%answer(h, part, a, :)
            end do
         end associate
      end subroutine add_force_on
   end subroutine law_set_answer

   !> Degrees of freedom, among those of all laws, whose forces answer to the motion of law i, which has memory: its own and
   !> those of multiplier laws that share one with it.
   pure function law_set_answering_dofs(self, i) result(dofs)
      class(law_set_t), intent(in) :: self
      integer, intent(in) :: i
      integer, allocatable :: dofs(:)
      logical :: answers(self%n_dofs)
      integer :: k, m

      answers = .false.
      answers(self%slots(i)%columns) = .true.
      do m = 1, size(self%laws)
         if (.not. self%laws(m)%law%is_multiplier) cycle
         associate (columns => self%slots(m)%columns)
            if (any([(any(columns(k) == self%slots(i)%columns), k=1, size(columns))])) answers(columns) = .true.
         end associate
      end do
      dofs = pack([(k, k=1, self%n_dofs)], answers)
   end function law_set_answering_dofs

   !> What is wrong with the memory of a law after `evaluate`; empty when the states of all laws repeat.
   pure function law_set_memory_trouble(self) result(text)
      class(law_set_t), intent(in) :: self
      character(:), allocatable :: text
      integer :: i

      text = ""
      do i = 1, size(self%laws)
         if (.not. allocated(self%slots(i)%memory)) cycle
         if (self%slots(i)%memory%repeats) cycle
         text = "the sliders of law '"//self%laws(i)%law%label//"' do not come back to their places within "// &
                to_text(self%slots(i)%memory%rounds)//" rounds of the torus: they hardly slip"
         return
      end do
   end function law_set_memory_trouble

   !> Largest forces [N] that the springs of laws with memory would have without their sliders: errors of rounding are units
   !> in their last place.
   function law_set_spring_forces(self) result(forces)
      class(law_set_t), intent(in) :: self
      real(wp) :: forces(self%n_dofs)
      real(wp), allocatable :: df_dz(:, :, :), df_ds(:, :, :), f(:, :)
      integer :: c, i

      forces = 0.0_wp
      do i = 1, size(self%laws)
         if (.not. allocated(self%slots(i)%memory)) cycle
         associate (path => self%slots(i)%memory%path, states => self%slots(i)%memory%states, &
                    shape => self%laws(i)%law%shape, columns => self%slots(i)%columns)
            allocate (f(size(path, 1), size(path, 2)), df_dz(size(path, 1), size(path, 2), size(path, 2)))
            allocate (df_ds(size(path, 1), size(path, 2), size(states, 2)))
            select type (law => self%laws(i)%law)
            class is (hysteretic_law_t)
               call law%force(path(:, :, path_part%at_end, 1), states(:, :, 1), f, df_dz, df_ds)
            end select
            do c = 1, size(shape, 2)
               forces(columns) = forces(columns) + matmul(abs(shape), maxval(abs(df_dz(:, :, c)), dim=1)) &
                                 *maxval(abs(path(:, c, path_part%at_end, :)))
            end do
            deallocate (f, df_dz, df_ds)
         end associate
      end do
   end function law_set_spring_forces

   !> Whether no slider of law i slipped anywhere, after `evaluate`: then it stays where loading from rest put it, which is
   !> one of many solutions. False for laws without memory.
   pure logical function law_set_full_stick(self, i)
      class(law_set_t), intent(in) :: self
      integer, intent(in) :: i

      law_set_full_stick = .false.
      if (allocated(self%slots(i)%memory)) law_set_full_stick = self%slots(i)%memory%full_stick
   end function law_set_full_stick

   !> Motion of the degrees of freedom as the laws allow it, from the samples q. A law of one coordinate z moves its degrees
   !> of freedom by w (corrected - z)/w.w.
   subroutine law_set_correct(self, corrected)
      class(law_set_t), intent(inout) :: self
      real(wp), intent(out) :: corrected(:, :)                        !! [m], (n_samples, n_dofs)
      integer :: i, k

      corrected = self%q%values
      do i = 1, size(self%laws)
         if (.not. self%laws(i)%law%is_multiplier) cycle
         call gather(self, i)
         associate (w => self%laws(i)%law%shape(:, 1), slot => self%slots(i))
            call self%laws(i)%law%correct(slot%z, slot%f)
            do k = 1, size(w)
               corrected(:, slot%columns(k)) = corrected(:, slot%columns(k)) + w(k)/sum(w**2)*(slot%f(:, 1) - slot%z(:, 1))
            end do
         end associate
      end do
   end subroutine law_set_correct

   !> Largest defects of all rigid contacts and rigid friction over the samples q, v and s, after `evaluate`.
   pure function law_set_defects(self) result(largest)
      class(law_set_t), intent(in) :: self
      type(defects_t) :: largest
      type(defects_t) :: found
      integer :: i

      do i = 1, size(self%laws)
         if (.not. self%laws(i)%law%is_multiplier) cycle
         found = self%laws(i)%law%defects(self%slots(i)%z, self%slots(i)%v, self%slots(i)%p)
         largest%penetration = max(largest%penetration, found%penetration)
         largest%tension = max(largest%tension, found%tension)
         largest%complementarity = max(largest%complementarity, found%complementarity)
         largest%slip = max(largest%slip, found%slip)
      end do
   end function law_set_defects

   !> Replaces the total force f by that of law i alone, as `evaluate` left it.
   subroutine law_set_isolate_force(self, i)
      class(law_set_t), intent(inout) :: self
      integer, intent(in) :: i

      self%f%values = 0.0_wp
      call scatter(self, i)
   end subroutine law_set_isolate_force

   !> Means over the torus of df/dq, df/dv and df/ds, after `differentiate`.
   subroutine law_set_mean_slopes(self, df_dq, df_dv, df_ds)
      class(law_set_t), intent(inout) :: self
      real(wp), intent(out) :: df_dq(:, :), df_dv(:, :), df_ds(:, :)  !! (n_dofs, n_dofs)
      integer :: i
      real(wp) :: weight
      real(wp), allocatable :: slope(:, :)

      df_dq = 0.0_wp
      df_dv = 0.0_wp
      df_ds = 0.0_wp
      weight = 1.0_wp/real(size(self%q%values, 1), wp)
      do i = 1, self%n_pairs
         associate (row => self%row(i), column => self%column(i))
            df_dq(row, column) = weight*sum(self%df_dq%values(:, i))
            if (self%needs_velocity) df_dv(row, column) = weight*sum(self%df_dv%values(:, i))
            if (self%needs_reaction) df_ds(row, column) = weight*sum(self%df_ds%values(:, i))
         end associate
      end do
      do i = 1, size(self%laws)
         if (.not. allocated(self%slots(i)%memory)) cycle
         associate (slot => self%slots(i), shape => self%laws(i)%law%shape)
            allocate (slope(size(shape, 2), size(shape, 2)))
            select type (law => self%laws(i)%law)
            class is (hysteretic_law_t)
               call slot%memory%mean_slope(law, self%characteristic, slope)
            end select
            df_dq(slot%columns, slot%columns) = df_dq(slot%columns, slot%columns) &
                                                + matmul(shape, matmul(slope, transpose(shape)))
            deallocate (slope)
         end associate
      end do
   end subroutine law_set_mean_slopes

   !> Frees all samples; safe to call twice.
   subroutine law_set_destroy(self)
      class(law_set_t), intent(inout) :: self

      call self%q%destroy()
      call self%v%destroy()
      call self%s%destroy()
      call self%f%destroy()
      call self%q_before%destroy()
      call self%step_rate%destroy()
      call self%step_rate_before%destroy()
      call self%df_dq%destroy()
      call self%df_dv%destroy()
      call self%df_ds%destroy()
   end subroutine law_set_destroy
end module hb_law_set
