!> All laws of a scene on the samples of one torus: total force and its derivatives at the degrees of freedom of the laws.
!>
!> Explicit laws come first; a multiplier law then sees the reaction p = s - (explicit forces) that equilibrium asks of it
!> at each sample, s = (loads - S u)(tau). Laws with memory are explicit; their states come from a walk along time.
!> Source: docs/theory.md, sections 5.3 to 5.5.
module hb_law_set
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_characteristic, only: characteristic_t, new_characteristic
   use hb_direction_samples, only: direction_samples_t, new_direction_samples
   use hb_error, only: error_t
   use hb_fftw, only: new_real_block, real_block_t
   use hb_harmonics, only: harmonics_t
   use hb_hysteretic_law, only: hysteretic_law_t
   use hb_kinds, only: wp
   use hb_law, only: defects_t, law_box_t
   use hb_law_answers, only: answer_on, answering_dofs, pass_on_to_multipliers
   use hb_law_pairs, only: add_explicit_derivatives, add_multiplier_derivatives, add_slopes_along, find_pairs
   use hb_law_slot, only: new_slot, slot_t
   use hb_torus, only: torus_t
   implicit none
   private
   public :: law_dofs_of, law_set_t, new_law_set

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
      type(direction_samples_t) :: along                              !! made at their first use
      type(slot_t), allocatable, private :: slots(:)
      integer, allocatable, private :: pair_at(:, :)                  ! (n_dofs, n_dofs), 0: no pair
      logical, allocatable, private :: is_summed(:)                   ! (n_dofs) whose force is a sum; else one law writes it
      logical, private :: has_derivatives = .false.
   contains
      procedure :: move => law_set_move
      procedure :: columns_of => law_set_columns_of
      procedure :: evaluate => law_set_evaluate
      procedure :: listen => law_set_listen
      procedure :: differentiate => law_set_differentiate
      procedure :: make_direction_samples => law_set_make_direction_samples
      procedure :: differentiate_along => law_set_differentiate_along
      procedure :: differentiate_without_memory => law_set_differentiate_without_memory
      procedure :: prepare_line => law_set_prepare_line
      procedure :: find_line => law_set_find_line
      procedure :: prepare_answers => law_set_prepare_answers
      procedure :: n_blocks => law_set_n_blocks
      procedure :: answer_block => law_set_answer_block
      procedure :: answer => law_set_answer
      procedure :: answering_dofs => law_set_answering_dofs
      procedure :: memory_reach => law_set_memory_reach
      procedure :: memory_trouble => law_set_memory_trouble
      procedure :: full_stick => law_set_full_stick
      procedure :: spring_forces => law_set_spring_forces
      procedure :: correct => law_set_correct
      procedure :: defects => law_set_defects
      procedure :: force_of => law_set_force_of
      procedure :: potential => law_set_potential
      procedure :: mean_slopes => law_set_mean_slopes
      procedure :: slope_variations => law_set_slope_variations
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
      integer :: i, n_samples

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
      call set_phases(self%laws, torus)
      dofs = law_dofs_of(laws)
      self%n_dofs = size(dofs)
      do i = 1, size(laws)
         self%needs_velocity = self%needs_velocity .or. laws(i)%law%needs_velocity
         self%needs_reaction = self%needs_reaction .or. laws(i)%law%is_multiplier
      end do
      call new_real_block(self%q, n_samples, self%n_dofs, error)
      if (allocated(error)) return
      call new_real_block(self%f, n_samples, self%n_dofs, error)
      if (allocated(error)) return
      if (self%needs_velocity) call new_real_block(self%v, n_samples, self%n_dofs, error)
      if (allocated(error)) return
      if (self%needs_reaction) call new_real_block(self%s, n_samples, self%n_dofs, error)
      if (allocated(error)) return
      call make_slots(self, dofs, error)
      if (allocated(error)) return
      if (allocated(self%pair_at)) deallocate (self%pair_at)
      allocate (self%pair_at(self%n_dofs, self%n_dofs))
      call find_pairs(self%laws, self%slots, self%row, self%column, self%pair_at)
      self%n_pairs = size(self%row)
      if (.not. self%has_memory) return
      call new_real_block(self%q_before, n_samples, self%n_dofs, error)
      if (allocated(error)) return
      call new_real_block(self%step_rate, n_samples, self%n_dofs, error)
      if (allocated(error)) return
      call new_real_block(self%step_rate_before, n_samples, self%n_dofs, error)
   end subroutine new_law_set

   !> Gives each law its place, and finds the degrees of freedom whose force has to be summed.
   subroutine make_slots(self, dofs, error)
      type(law_set_t), intent(inout) :: self
      integer, intent(in) :: dofs(:)                                  !! of the structure, (n_dofs)
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: columns(:)
      integer :: i, k, n_laws(self%n_dofs), place(maxval(dofs))

      place(dofs) = [(k, k=1, self%n_dofs)]
      n_laws = 0
      do i = 1, size(self%laws)
         columns = place(self%laws(i)%law%dofs)
         n_laws(columns) = n_laws(columns) + 1
      end do
      allocate (self%slots(size(self%laws)))
      self%is_summed = [(.true., k=1, self%n_dofs)]
      do i = 1, size(self%laws)
         columns = place(self%laws(i)%law%dofs)
         call new_slot(self%slots(i), self%laws(i)%law, columns, all(n_laws(columns) == 1), self%q, self%v, self%s, self%f, &
                       self%characteristic, error)
         if (allocated(error)) return
         if (self%slots(i)%writes_in_place) self%is_summed(columns) = .false.
      end do
   end subroutine make_slots

   !> Tells the laws that ask for it the phases of their tones on the grid.
   pure subroutine set_phases(laws, torus)
      type(law_box_t), intent(inout) :: laws(:)
      type(torus_t), intent(in) :: torus
      real(wp), allocatable :: tau(:, :)
      integer :: i

      do i = 1, size(laws)
         if (laws(i)%law%phase_tone < 1) cycle
         if (.not. allocated(tau)) tau = torus%phases()
         call laws(i)%law%set_phase(tau(laws(i)%law%phase_tone, :))
      end do
   end subroutine set_phases

   !> Changes the base frequencies; the tone that leads the steps of laws with memory stays.
   subroutine law_set_move(self, torus, omega)
      class(law_set_t), intent(inout) :: self
      type(torus_t), intent(in) :: torus
      real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s], (n_tones), > 0
      integer :: i, tone

      if (.not. self%has_memory) return
      tone = self%characteristic%tone
      call new_characteristic(self%characteristic, torus, omega, tone)
      do i = 1, size(self%slots)
         if (allocated(self%slots(i)%memory)) call self%slots(i)%memory%forget_tones()
      end do
   end subroutine law_set_move

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

   !> Where the degrees of freedom of law i stand among those of all laws.
   pure function law_set_columns_of(self, i) result(columns)
      class(law_set_t), intent(in) :: self
      integer, intent(in) :: i
      integer :: columns(size(self%slots(i)%columns))

      columns = self%slots(i)%columns
   end function law_set_columns_of

   !> Forces f from the samples q, v and s. Where they are not finite, `listen` tells why.
   subroutine law_set_evaluate(self)
      class(law_set_t), intent(inout) :: self

      call run_laws(self, with_derivatives=.false.)
   end subroutine law_set_evaluate

   !> Remembers what laws say about forces that are not finite, after `evaluate`. Who looks at coefficients of the forces sees
   !> whether they are: one sample that is not spoils them all.
   subroutine law_set_listen(self)
      class(law_set_t), intent(inout) :: self
      integer :: i

      if (self%is_given_up) return
      do i = 1, size(self%laws)
         if (allocated(self%slots(i)%memory)) cycle
         call self%slots(i)%listen(self%laws(i)%law, .false., self%complaint, self%is_given_up)
         if (self%is_given_up) return
      end do
   end subroutine law_set_listen

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
         if (.not. allocated(self%slots(i)%memory)) call self%slots(i)%make_derivatives()
      end do
      self%has_derivatives = .true.
   end subroutine allocate_derivatives

   !> Makes room for the samples `along` a direction, at their first use.
   subroutine law_set_make_direction_samples(self, error)
      class(law_set_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error

      if (associated(self%along%f%values)) return
      call new_direction_samples(self%along, size(self%q%values, 1), self%n_dofs, self%needs_velocity, &
                                 self%needs_reaction, self%has_memory, error)
   end subroutine law_set_make_direction_samples

   !> Derivative along a direction of the forces, `along%f`, from the others there, after `differentiate`.
   !>
   !> Fails where the derivative of a law with memory does not repeat from round to round.
   subroutine law_set_differentiate_along(self, weight_slope, error)
      class(law_set_t), intent(inout) :: self
      real(wp), intent(in) :: weight_slope(:)                         !! of `characteristic`, any without memory
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      associate (along => self%along)
         along%f%values = 0.0_wp
         do i = 1, size(self%laws)
            if (.not. allocated(self%slots(i)%memory)) cycle
            call self%slots(i)%memory%add_slope(self%laws(i)%law, self%slots(i)%columns, self%characteristic, weight_slope, &
                                                along%q, along%q_before, along%step_rate, along%step_rate_before, along%f, &
                                                error)
            if (allocated(error)) return
         end do
         if (self%has_memory) call pass_on_to_multipliers(self%laws, self%slots, along%f)
      end associate
      call add_pairs_along(self)
   end subroutine law_set_differentiate_along

   !> The same where the steps along time do not change, so that laws with memory give nothing.
   subroutine law_set_differentiate_without_memory(self)
      class(law_set_t), intent(inout) :: self

      self%along%f%values = 0.0_wp
      call add_pairs_along(self)
   end subroutine law_set_differentiate_without_memory

   !> Adds what forces answer to `along%q`, `along%v` and `along%s` at the same sample.
   subroutine add_pairs_along(self)
      class(law_set_t), intent(inout) :: self

      associate (along => self%along)
         call add_slopes_along(self%row, self%column, self%df_dq, self%df_dv, self%df_ds, along%q, along%v, along%s, along%f)
      end associate
   end subroutine add_pairs_along

   subroutine run_laws(self, with_derivatives)
      class(law_set_t), intent(inout) :: self
      logical, intent(in) :: with_derivatives
      integer :: i, pass

      do i = 1, self%n_dofs
         if (self%is_summed(i)) self%f%values(:, i) = 0.0_wp
      end do
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
            associate (law => self%laws(i)%law, slot => self%slots(i))
               if (allocated(slot%memory)) then
                  call slot%memory%run(law, slot%columns, self%characteristic, self%q, self%q_before, self%step_rate, &
                                       self%step_rate_before, slot%f)
               else
                  call slot%gather(law, self%q, self%v, self%s, self%f)
                  if (with_derivatives) then
                     call slot%differentiate(law)
                     call add_derivatives(self, i)
                     call slot%listen(law, with_derivatives, self%complaint, self%is_given_up)
                  else
                     call slot%evaluate(law)
                  end if
               end if
               call slot%scatter(law, self%f)
            end associate
         end do
      end do
   end subroutine run_laws

   !> Adds the derivatives of law i, which has no memory, to those of its pairs.
   subroutine add_derivatives(self, i)
      class(law_set_t), intent(inout) :: self
      integer, intent(in) :: i

      associate (law => self%laws(i)%law, slot => self%slots(i))
         if (law%is_multiplier) then
            call add_multiplier_derivatives(law, slot, self%pair_at, self%needs_velocity, self%df_dq, self%df_dv, self%df_ds)
         else
            call add_explicit_derivatives(law, slot, self%pair_at, self%df_dq, self%df_dv)
         end if
      end associate
   end subroutine add_derivatives

   !> Prepares the answers of law i under one tone in the form of hb_line_tangent, after `differentiate`, where law and scene
   !> allow it: no multiplier law may pass them on.
   subroutine law_set_prepare_line(self, i, harmonics, frequencies, is_available)
      class(law_set_t), intent(inout) :: self
      integer, intent(in) :: i
      type(harmonics_t), intent(in) :: harmonics
      real(wp), intent(in) :: frequencies(:)                          !! j.omega [rad/s], (n_harmonics)
      logical, intent(out) :: is_available

      is_available = .false.
      if (.not. allocated(self%slots(i)%memory) .or. self%needs_reaction) return
      call self%slots(i)%memory%prepare_line(self%laws(i)%law, self%characteristic, harmonics, frequencies, is_available)
   end subroutine law_set_prepare_line

   !> How force a of law i answers to its coordinate c, after `prepare_line`: the product with the motion at the same sample
   !> (n_samples) [N/m], and for each run of sticking the samples and the motion, see hb_line_tangent.
   subroutine law_set_find_line(self, i, a, c, product, stuck, pushed)
      class(law_set_t), intent(inout) :: self
      integer, intent(in) :: i, a, c
      real(wp), intent(out) :: product(:)
      complex(wp), allocatable, intent(out) :: stuck(:, :), pushed(:, :)   !! (n_harmonics, n_runs)

      associate (memory => self%slots(i)%memory)
         call memory%line%find(memory%walk, a, c)
         product(self%characteristic%sample(1, :)) = memory%line%g
         stuck = memory%line%stuck(:, :memory%line%n_runs)
         pushed = memory%line%pushed(:, :memory%line%n_runs)
      end associate
   end subroutine law_set_find_line

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
         if (has_answers) call slot%memory%prepare_answers(self%laws(i)%law, self%characteristic, harmonics, torus, frequencies)
      end associate
   end subroutine law_set_prepare_answers

   !> Number of blocks of at most hb_memory_tangent%width harmonics in which the answers come.
   pure integer function law_set_n_blocks(self, i)
      class(law_set_t), intent(in) :: self
      integer, intent(in) :: i                                        !! law with memory

      law_set_n_blocks = self%slots(i)%memory%n_blocks()
   end function law_set_n_blocks

   !> Finds the answers of law i to cos and sin of a block of harmonics of one of its coordinates.
   subroutine law_set_answer_block(self, i, coordinate, block)
      class(law_set_t), intent(inout) :: self
      integer, intent(in) :: i, coordinate, block

      call self%slots(i)%memory%answer_block(self%characteristic, coordinate, block)
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

      call answer_on(self%laws, self%slots, i, h, part, k, samples)
   end subroutine law_set_answer

   !> Degrees of freedom, among those of all laws, whose forces answer to the motion of law i, which has memory: its own and
   !> those of multiplier laws that share one with it.
   pure function law_set_answering_dofs(self, i) result(dofs)
      class(law_set_t), intent(in) :: self
      integer, intent(in) :: i
      integer, allocatable :: dofs(:)

      dofs = answering_dofs(self%laws, self%slots, i, self%n_dofs)
   end function law_set_answering_dofs

   !> Largest distance between degrees of freedom, among those of all laws, that one law with memory couples.
   pure integer function law_set_memory_reach(self) result(reach)
      class(law_set_t), intent(in) :: self
      integer :: i

      reach = 0
      do i = 1, size(self%slots)
         if (.not. allocated(self%slots(i)%memory)) cycle
         reach = max(reach, maxval(self%slots(i)%columns) - minval(self%slots(i)%columns))
      end do
   end function law_set_memory_reach

   !> What is wrong with the memory of a law after `evaluate`; empty when the states of all laws repeat.
   pure function law_set_memory_trouble(self) result(text)
      class(law_set_t), intent(in) :: self
      character(:), allocatable :: text
      integer :: i

      text = ""
      do i = 1, size(self%laws)
         if (.not. allocated(self%slots(i)%memory)) cycle
         text = self%slots(i)%memory%trouble(self%laws(i)%law)
         if (len(text) > 0) return
      end do
   end function law_set_memory_trouble

   !> Largest forces [N] that the springs of laws with memory would have without their sliders: errors of rounding are units
   !> in their last place.
   function law_set_spring_forces(self) result(forces)
      class(law_set_t), intent(in) :: self
      real(wp) :: forces(self%n_dofs)
      integer :: i

      forces = 0.0_wp
      do i = 1, size(self%laws)
         if (.not. allocated(self%slots(i)%memory)) cycle
         call self%slots(i)%memory%add_spring_forces(self%laws(i)%law, self%slots(i)%columns, forces)
      end do
   end function law_set_spring_forces

   !> Whether no slider of law i slipped anywhere, after `evaluate`: then it stays where loading from rest put it, which is
   !> one of many solutions. False for laws without memory.
   pure logical function law_set_full_stick(self, i)
      class(law_set_t), intent(in) :: self
      integer, intent(in) :: i

      law_set_full_stick = .false.
      if (allocated(self%slots(i)%memory)) law_set_full_stick = self%slots(i)%memory%walk%full_stick
   end function law_set_full_stick

   !> Motion of the degrees of freedom as the laws allow it, from the samples q. A law moves its degrees of freedom by
   !> w (corrected - z)/w.w for each of its coordinates z, w its weights.
   subroutine law_set_correct(self, corrected)
      class(law_set_t), intent(inout) :: self
      real(wp), intent(out) :: corrected(:, :)                        !! [m], (n_samples, n_dofs)
      real(wp), allocatable :: z(:, :)
      integer :: c, i, k

      corrected = self%q%values
      do i = 1, size(self%laws)
         if (.not. self%laws(i)%law%is_multiplier) cycle
         associate (shape => self%laws(i)%law%shape, slot => self%slots(i))
            call slot%gather(self%laws(i)%law, self%q, self%v, self%s, self%f)
            z = slot%z
            call self%laws(i)%law%correct(slot%z, z)
            do c = 1, size(shape, 2)
               do k = 1, size(shape, 1)
                  if (shape(k, c) == 0.0_wp) cycle
                  corrected(:, slot%columns(k)) = corrected(:, slot%columns(k)) + &
                     shape(k, c)/sum(shape(:, c)**2)*(z(:, c) - slot%z(:, c))
               end do
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

   !> Force of law i alone at its coordinates, as `evaluate` left it.
   function law_set_force_of(self, i) result(force)
      class(law_set_t), intent(in) :: self
      integer, intent(in) :: i
      real(wp), pointer, contiguous :: force(:, :)                    !! [N], (n_samples, n_coordinates)

      force => self%slots(i)%f
   end function law_set_force_of

   !> Mean over the torus of the potentials of all laws at the samples q; their gradients take the place of the force f.
   subroutine law_set_potential(self, mean_energy)
      class(law_set_t), intent(inout) :: self
      real(wp), intent(out) :: mean_energy                            !! [J]
      real(wp) :: energy(size(self%q%values, 1))
      integer :: i

      mean_energy = 0.0_wp
      self%f%values = 0.0_wp
      do i = 1, size(self%laws)
         associate (law => self%laws(i)%law, slot => self%slots(i))
            call slot%gather(law, self%q, self%v, self%s, self%f)
            call law%potential(slot%z, energy, slot%f)
            call slot%scatter(law, self%f)
         end associate
         mean_energy = mean_energy + sum(energy)/size(energy)
      end do
   end subroutine law_set_potential

   !> Means over the torus of df/dq, df/dv and df/ds, after `differentiate`.
   subroutine law_set_mean_slopes(self, df_dq, df_dv, df_ds)
      class(law_set_t), intent(inout) :: self
      real(wp), intent(out) :: df_dq(:, :), df_dv(:, :), df_ds(:, :)  !! (n_dofs, n_dofs)
      integer :: i
      real(wp) :: weight

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
         call self%slots(i)%memory%add_mean_slope(self%laws(i)%law, self%slots(i)%columns, self%characteristic, df_dq)
      end do
   end subroutine law_set_mean_slopes

   !> Standard deviations over the torus of df/dq, df/dv and df/ds of each degree of freedom by itself, after `differentiate`;
   !> zero for laws with memory.
   subroutine law_set_slope_variations(self, df_dq, df_dv, df_ds)
      class(law_set_t), intent(in) :: self
      real(wp), intent(out) :: df_dq(:), df_dv(:), df_ds(:)           !! (n_dofs)
      integer :: i

      df_dq = 0.0_wp
      df_dv = 0.0_wp
      df_ds = 0.0_wp
      do i = 1, self%n_pairs
         associate (dof => self%row(i))
            if (self%column(i) /= dof) cycle
            df_dq(dof) = variation(self%df_dq%values(:, i))
            if (self%needs_velocity) df_dv(dof) = variation(self%df_dv%values(:, i))
            if (self%needs_reaction) df_ds(dof) = variation(self%df_ds%values(:, i))
         end associate
      end do

   contains

      pure real(wp) function variation(values)
         real(wp), intent(in) :: values(:)

         associate (n => real(size(values), wp))
            variation = sqrt(sum((values - sum(values)/n)**2)/n)
         end associate
      end function variation
   end subroutine law_set_slope_variations

   !> Frees all samples; safe to call twice.
   subroutine law_set_destroy(self)
      class(law_set_t), intent(inout) :: self
      integer :: i

      if (allocated(self%slots)) then
         do i = 1, size(self%slots)
            call self%slots(i)%destroy()
         end do
         deallocate (self%slots)
      end if
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
      call self%along%destroy()
   end subroutine law_set_destroy
end module hb_law_set
