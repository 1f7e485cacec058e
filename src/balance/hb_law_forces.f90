!> The forces of all laws of a scene on the samples of one torus, with their derivatives at the same samples.
!>
!> Explicit laws come first; a multiplier law then sees the reaction p = s - (explicit forces) that equilibrium asks of it
!> at each sample, s = (loads - S u)(tau). Laws with memory are explicit; their states come from a walk along time.
!> Source: docs/user/theory.md, sections 5.3 to 5.5.
module hb_law_forces
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_characteristic, only: characteristic_t, new_characteristic
   use hb_error, only: error_t
   use hb_fftw, only: new_real_block, real_block_t
   use hb_hysteretic_law, only: has_memory
   use hb_kinds, only: wp
   use hb_law, only: law_box_t
   use hb_law_kinks, only: law_kinks_t, new_law_kinks
   use hb_law_pairs, only: add_explicit_derivatives, add_multiplier_derivatives, find_pairs
   use hb_law_slot, only: new_slot, slot_t
   use hb_torus, only: torus_t
   implicit none
   private
   public :: law_forces_t, new_law_forces

   !> Owner of outside resources: call `destroy`.
   type :: law_forces_t
      integer :: n_dofs = 0                                           !! coordinates on which laws act
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
      type(slot_t), allocatable :: slots(:)                           !! (laws) each law with its samples
      type(law_kinks_t) :: kinks                                      !! of the laws between samples
      integer, allocatable, private :: pair_at(:, :)                  ! (n_dofs, n_dofs), 0: no pair
      logical, allocatable, private :: is_summed(:)                   ! (n_dofs) whose force is a sum; else one law writes it
      logical, private :: has_derivatives = .false.
   contains
      procedure :: move => law_forces_move
      procedure :: coordinates_of => law_forces_coordinates_of
      procedure :: evaluate => law_forces_evaluate
      procedure :: listen => law_forces_listen
      procedure :: differentiate => law_forces_differentiate
      procedure :: force_of => law_forces_force_of
      procedure :: destroy => law_forces_destroy
   end type law_forces_t

contains

   !> Prepares the samples of all laws on a grid. Derivatives get their memory at their first use.
   subroutine new_law_forces(self, laws, n_coordinates, torus, omega, error)
      type(law_forces_t), intent(inout) :: self
      type(law_box_t), intent(in) :: laws(:)                          !! on coordinates; no two multipliers on one
      integer, intent(in) :: n_coordinates
      type(torus_t), intent(in) :: torus
      real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s], (n_tones)
      type(error_t), allocatable, intent(out) :: error
      integer :: i, n_samples

      call self%destroy()
      n_samples = torus%n_total
      self%has_memory = has_memory(laws)
      if (self%has_memory) call new_characteristic(self%characteristic, torus, omega)
      self%has_derivatives = .false.
      self%needs_velocity = .false.
      self%needs_reaction = .false.
      self%is_given_up = .false.
      if (allocated(self%complaint)) deallocate (self%complaint)
      self%laws = laws
      call set_phases(self%laws, torus)
      self%n_dofs = n_coordinates
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
      call make_slots(self, error)
      if (allocated(error)) return
      if (allocated(self%pair_at)) deallocate (self%pair_at)
      allocate (self%pair_at(self%n_dofs, self%n_dofs))
      call find_pairs(self%laws, self%slots, self%row, self%column, self%pair_at)
      self%n_pairs = size(self%row)
      call new_law_kinks(self%kinks, self%laws, self%slots, torus)
      if (.not. self%has_memory) return
      call new_real_block(self%q_before, n_samples, self%n_dofs, error)
      if (allocated(error)) return
      call new_real_block(self%step_rate, n_samples, self%n_dofs, error)
      if (allocated(error)) return
      call new_real_block(self%step_rate_before, n_samples, self%n_dofs, error)
   end subroutine new_law_forces

   !> Gives each law its place, and finds the degrees of freedom whose force has to be summed.
   subroutine make_slots(self, error)
      type(law_forces_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error
      integer :: i, k, n_laws(self%n_dofs)

      n_laws = 0
      do i = 1, size(self%laws)
         associate (columns => self%laws(i)%law%dofs)
            n_laws(columns) = n_laws(columns) + 1
         end associate
      end do
      allocate (self%slots(size(self%laws)))
      self%is_summed = [(.true., k=1, self%n_dofs)]
      do i = 1, size(self%laws)
         associate (columns => self%laws(i)%law%dofs)
            call new_slot(self%slots(i), self%laws(i)%law, columns, all(n_laws(columns) == 1), self%q, self%v, self%s, self%f, &
                          self%characteristic, error)
            if (allocated(error)) return
            if (self%slots(i)%writes_in_place) self%is_summed(columns) = .false.
         end associate
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
   subroutine law_forces_move(self, torus, omega)
      class(law_forces_t), intent(inout) :: self
      type(torus_t), intent(in) :: torus
      real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s], (n_tones), > 0
      integer :: i, tone

      if (.not. self%has_memory) return
      tone = self%characteristic%tone
      call new_characteristic(self%characteristic, torus, omega, tone)
      do i = 1, size(self%slots)
         if (allocated(self%slots(i)%memory)) call self%slots(i)%memory%forget_tones()
      end do
   end subroutine law_forces_move

   !> Coordinates of law i from values of all coordinates.
   pure function law_forces_coordinates_of(self, i, values) result(z)
      class(law_forces_t), intent(in) :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: values(:, :)                            !! (any, n_dofs)
      real(wp) :: z(size(values, 1), size(self%laws(i)%law%shape, 2))

      z = matmul(values(:, self%laws(i)%law%dofs), self%laws(i)%law%shape)
   end function law_forces_coordinates_of

   !> Forces f from the samples q, v and s. Where they are not finite, `listen` tells why.
   subroutine law_forces_evaluate(self)
      class(law_forces_t), intent(inout) :: self

      call run_laws(self, with_derivatives=.false.)
   end subroutine law_forces_evaluate

   !> Remembers what laws say about forces that are not finite, after `evaluate`. Who looks at coefficients of the forces sees
   !> whether they are: one sample that is not spoils them all.
   subroutine law_forces_listen(self)
      class(law_forces_t), intent(inout) :: self
      integer :: i

      if (self%is_given_up) return
      do i = 1, size(self%laws)
         if (allocated(self%slots(i)%memory)) cycle
         call self%slots(i)%listen(self%laws(i)%law, .false., self%complaint, self%is_given_up)
         if (self%is_given_up) return
      end do
   end subroutine law_forces_listen

   !> Forces f and derivatives df_dq, df_dv, df_ds of all pairs from the samples q, v and s.
   subroutine law_forces_differentiate(self, error)
      class(law_forces_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error

      if (.not. self%has_derivatives) call allocate_derivatives(self, error)
      if (allocated(error)) return
      call run_laws(self, with_derivatives=.true.)
   end subroutine law_forces_differentiate

   subroutine allocate_derivatives(self, error)
      class(law_forces_t), intent(inout) :: self
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

   subroutine run_laws(self, with_derivatives)
      class(law_forces_t), intent(inout) :: self
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
      call self%kinks%correct(self%q, self%f, with_derivatives)
      if (with_derivatives) call self%kinks%add_own_slopes(self%pair_at, self%df_dq)
   end subroutine run_laws

   !> Adds the derivatives of law i, which has no memory, to those of its pairs.
   subroutine add_derivatives(self, i)
      class(law_forces_t), intent(inout) :: self
      integer, intent(in) :: i

      associate (law => self%laws(i)%law, slot => self%slots(i))
         if (law%is_multiplier) then
            call add_multiplier_derivatives(law, slot, self%pair_at, self%needs_velocity, self%df_dq, self%df_dv, self%df_ds)
         else
            call add_explicit_derivatives(law, slot, self%pair_at, self%df_dq, self%df_dv)
         end if
      end associate
   end subroutine add_derivatives

   !> Force of law i alone at its coordinates, as `evaluate` left it.
   function law_forces_force_of(self, i) result(force)
      class(law_forces_t), intent(in) :: self
      integer, intent(in) :: i
      real(wp), pointer, contiguous :: force(:, :)                    !! [N], (n_samples, n_coordinates)

      force => self%slots(i)%f
   end function law_forces_force_of

   !> Frees all samples; safe to call twice.
   subroutine law_forces_destroy(self)
      class(law_forces_t), intent(inout) :: self
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
   end subroutine law_forces_destroy
end module hb_law_forces
