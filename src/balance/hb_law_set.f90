!> All laws of a scene on the samples of one torus, as the balance asks for them: their forces and derivatives, what they answer
!> to a direction or to single coefficients of the motion, and what holds of them on the torus as a whole.
!>
!> Source: docs/user/theory.md, sections 5.3 to 5.5.
module hb_law_set
   use hb_coordinates, only: coordinates_t
   use hb_direction_samples, only: direction_samples_t, new_direction_samples
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_law, only: defects_t, law_box_t
   use hb_law_answers, only: answer_on, answering_dofs, pass_on_to_multipliers
   use hb_law_forces, only: law_forces_t, new_law_forces
   use hb_law_pairs, only: add_slopes_along
   use hb_torus, only: torus_t
   implicit none
   private
   public :: law_set_t, new_law_set

   !> Owner of outside resources: call `destroy`.
   type, extends(law_forces_t) :: law_set_t
      type(direction_samples_t) :: along                              !! made at their first use
   contains
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
      procedure :: all_stick => law_set_all_stick
      procedure :: spring_forces => law_set_spring_forces
      procedure :: correct => law_set_correct
      procedure :: defects => law_set_defects
      procedure :: potential => law_set_potential
      procedure :: mean_slopes => law_set_mean_slopes
      procedure :: slope_variations => law_set_slope_variations
      procedure :: destroy => law_set_destroy
   end type law_set_t

contains

   !> Prepares the samples of all laws on a grid. Derivatives get their memory at their first use.
   subroutine new_law_set(self, laws, n_coordinates, torus, omega, error)
      type(law_set_t), intent(inout) :: self
      type(law_box_t), intent(in) :: laws(:)                          !! on coordinates; no two multipliers on one
      integer, intent(in) :: n_coordinates
      type(torus_t), intent(in) :: torus
      real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s], (n_tones)
      type(error_t), allocatable, intent(out) :: error

      call self%destroy()
      call new_law_forces(self%law_forces_t, laws, n_coordinates, torus, omega, error)
   end subroutine new_law_set

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

   !> Derivatives of the forces along a direction in which the steps along time do not change, so that laws with memory give
   !> nothing.
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
         call self%kinks%add_along(along%q, along%f)
      end associate
   end subroutine add_pairs_along

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

   !> Whether no slider of any law slipped anywhere, after `evaluate`.
   pure logical function law_set_all_stick(self) result(all_stick)
      class(law_set_t), intent(in) :: self
      integer :: i

      all_stick = all([(self%full_stick(i) .or. .not. allocated(self%slots(i)%memory), i=1, size(self%laws))])
   end function law_set_all_stick

   !> Adds to the motion of degrees of freedom what makes it as the laws allow it, from the samples q. A law moves its degrees of
   !> freedom by w (corrected - z)/w.w for each of its coordinates z, w its weights.
   subroutine law_set_correct(self, coordinates, motion)
      class(law_set_t), intent(inout) :: self
      type(coordinates_t), intent(in) :: coordinates
      real(wp), intent(inout) :: motion(:, :)                         !! [m], (n_samples, size(coordinates%dofs))
      real(wp), allocatable :: weights(:), z(:, :)
      integer :: c, i, k

      do i = 1, size(self%laws)
         if (.not. self%laws(i)%law%is_multiplier) cycle
         associate (law => self%laws(i)%law, slot => self%slots(i))
            call slot%gather(law, self%q, self%v, self%s, self%f)
            z = slot%z
            call law%correct(slot%z, z)
            do c = 1, size(law%shape, 2)
               weights = coordinates%weights_of(law%dofs, law%shape(:, c))
               weights = weights/sum(weights**2)
               do k = 1, size(weights)
                  if (abs(weights(k)) > 0.0_wp) motion(:, k) = motion(:, k) + weights(k)*(z(:, c) - slot%z(:, c))
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

      call self%law_forces_t%destroy()
      call self%along%destroy()
   end subroutine law_set_destroy
end module hb_law_set
