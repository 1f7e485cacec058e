!> All laws of a model at the samples of one torus: their forces, derivatives of these, their response to a direction
!> or to single coefficients of the motion, and their properties on the torus as a whole.
!> Explicit laws come first; the argument of a multiplier law is then the reaction p = s - (explicit forces) that
!> equilibrium requires at each sample, s = (loads - S u)(tau). Laws with memory are explicit; their states are
!> integrated along time. Source: docs/why/theory.md, sections 5.3 to 5.5.
module hb_sampled_laws
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_block_pattern, only: block_pattern_t
   use hb_cancellation, only: shared_work_t, work_of_thread
   use hb_characteristic, only: characteristic_t, new_characteristic
   use hb_coordinates, only: coordinates_t
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_law, only: defects_t, has_memory, law_box_t, law_t
   use hb_law_check, only: find_fault, find_fault_of_memory
   use hb_law_jacobian, only: law_jacobian_t, new_law_jacobian
   use hb_law_kinks, only: law_kinks_t, new_law_kinks
   use hb_law_samples, only: law_samples_t, new_law_samples
   use hb_memory_response, only: add_multiplier_response
   use hb_numbers, only: number_t
   use hb_sampled_law, only: new_sampled_law, sampled_law_t
   use hb_threads, only: n_threads
   use hb_torus, only: torus_t
   implicit none
   private
   public :: new_sampled_laws, sampled_laws_t

   !> Owner of external resources: call `destroy`.
   type :: sampled_laws_t
      integer :: n_dofs = 0                                           !! coordinates on which laws act
      logical :: needs_velocity = .false.
      logical :: needs_reaction = .false.
      logical :: has_memory = .false.                                 !! samples then include the step of time before each
      type(characteristic_t) :: characteristic                        !! steps along time, for laws with memory
      type(law_box_t), allocatable :: laws(:)
      character(:), allocatable :: error_text                         !! why a law had no finite force
      logical :: is_given_up = .false.                                !! a law cannot continue: all forces are NaN from then on
      type(law_samples_t) :: samples                                  !! of the motion
      type(law_samples_t) :: along                                    !! of a direction, allocated at their first use
      type(law_jacobian_t) :: jacobian                                !! derivatives at the same sample, after `differentiate`
      type(law_kinks_t) :: kinks                                      !! of the laws between samples
      type(sampled_law_t), allocatable :: sampled(:)                  !! (laws) each law with its samples
      logical, allocatable, private :: is_summed(:)                   ! (n_dofs) the force is a sum; otherwise one law writes it
   contains
      procedure :: move => sampled_laws_move
      procedure :: replace => sampled_laws_replace
      procedure :: coordinates_of => sampled_laws_coordinates_of
      procedure :: evaluate => sampled_laws_evaluate
      procedure :: find_failure => sampled_laws_find_failure
      procedure :: find_unsuitable => sampled_laws_find_unsuitable
      procedure :: differentiate => sampled_laws_differentiate
      procedure :: force_of => sampled_laws_force_of
      procedure :: make_direction_samples => sampled_laws_make_direction_samples
      procedure :: differentiate_along => sampled_laws_differentiate_along
      procedure :: differentiate_by_number => sampled_laws_differentiate_by_number
      procedure :: memory_bandwidth => sampled_laws_memory_bandwidth
      procedure :: memory_rounds => sampled_laws_memory_rounds
      procedure :: memory_failure => sampled_laws_memory_failure
      procedure :: full_stick => sampled_laws_full_stick
      procedure :: all_stick => sampled_laws_all_stick
      procedure :: spring_forces => sampled_laws_spring_forces
      procedure :: correct => sampled_laws_correct
      procedure :: defects => sampled_laws_defects
      procedure :: potential => sampled_laws_potential
      procedure :: add_frequency_slopes => sampled_laws_add_frequency_slopes
      procedure :: mean_slopes => sampled_laws_mean_slopes
      procedure :: add_memory_slopes => sampled_laws_add_memory_slopes
      procedure :: destroy => sampled_laws_destroy
   end type sampled_laws_t

contains

   !> Prepares the samples of all laws on a grid. Derivatives are allocated at their first use.
   subroutine new_sampled_laws(self, laws, n_coordinates, torus, omega, error)
      type(sampled_laws_t), intent(inout), target :: self
      type(law_box_t), intent(in) :: laws(:)                          !! on coordinates; no two multipliers on one
      integer, intent(in) :: n_coordinates
      type(torus_t), intent(in) :: torus
      real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s], (n_tones)
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      call forget_laws(self)
      self%has_memory = has_memory(laws)
      if (self%has_memory) call new_characteristic(self%characteristic, torus, omega)
      self%is_given_up = .false.
      if (allocated(self%error_text)) deallocate (self%error_text)
      self%laws = laws
      call set_phases(self%laws, torus)
      call set_frequencies(self%laws, omega)
      self%n_dofs = n_coordinates
      self%needs_velocity = any([(laws(i)%law%needs_velocity, i=1, size(laws))])
      self%needs_reaction = any([(laws(i)%law%is_multiplier, i=1, size(laws))])
      call new_law_samples(self%samples, torus%n_total, self%n_dofs, self%needs_velocity, self%needs_reaction, &
                           self%has_memory, error)
      if (allocated(error)) return
      call sample_laws(self, error)
      if (allocated(error)) return
      call new_law_jacobian(self%jacobian, self%sampled, self%n_dofs, self%needs_velocity, self%needs_reaction)
      call new_law_kinks(self%kinks, self%sampled, torus)
   end subroutine new_sampled_laws

   !> Replaces the laws by others that differ from them in numbers alone; the states of those with memory are forgotten.
   subroutine sampled_laws_replace(self, laws, torus, omega)
      class(sampled_laws_t), intent(inout), target :: self
      type(law_box_t), intent(in) :: laws(:)                          !! on coordinates
      type(torus_t), intent(in) :: torus
      real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s], (n_tones)
      class(law_t), pointer :: law
      integer :: i

      if (self%has_memory) call new_characteristic(self%characteristic, torus, omega)
      self%is_given_up = .false.
      if (allocated(self%error_text)) deallocate (self%error_text)
      self%laws = laws
      call set_phases(self%laws, torus)
      call set_frequencies(self%laws, omega)
      do i = 1, size(self%laws)
         law => self%laws(i)%law
         call self%sampled(i)%replace(law, self%characteristic)
      end do
      call new_law_kinks(self%kinks, self%sampled, torus)
   end subroutine sampled_laws_replace

   !> Creates the samples of each law, and determines the degrees of freedom whose force is a sum.
   subroutine sample_laws(self, error)
      type(sampled_laws_t), intent(inout), target :: self
      type(error_t), allocatable, intent(out) :: error
      class(law_t), pointer :: law
      integer :: i, k, n_laws(self%n_dofs)

      n_laws = 0
      do i = 1, size(self%laws)
         associate (columns => self%laws(i)%law%dofs)
            n_laws(columns) = n_laws(columns) + 1
         end associate
      end do
      allocate (self%sampled(size(self%laws)))
      self%is_summed = [(.true., k=1, self%n_dofs)]
      do i = 1, size(self%laws)
         law => self%laws(i)%law
         call new_sampled_law(self%sampled(i), law, all(n_laws(law%dofs) == 1), self%samples, self%characteristic, error)
         if (allocated(error)) return
         if (self%sampled(i)%writes_in_place) self%is_summed(law%dofs) = .false.
      end do
   end subroutine sample_laws

   !> Sets the phases of the tones on the grid for the laws that need them.
   pure subroutine set_phases(laws, torus)
      type(law_box_t), intent(inout) :: laws(:)
      type(torus_t), intent(in) :: torus
      real(wp), allocatable :: tau(:, :)
      integer :: i

      do i = 1, size(laws)
         if (laws(i)%law%n_phases < 1) cycle
         if (.not. allocated(tau)) tau = torus%phases()
         call laws(i)%law%set_phases(tau)
      end do
   end subroutine set_phases

   pure subroutine set_frequencies(laws, omega)
      type(law_box_t), intent(inout) :: laws(:)
      real(wp), intent(in) :: omega(:)
      integer :: i

      do i = 1, size(laws)
         if (laws(i)%law%needs_frequencies) call laws(i)%law%set_frequencies(omega)
      end do
   end subroutine set_frequencies

   !> Changes the base frequencies; the leading tone of laws with memory is unchanged.
   subroutine sampled_laws_move(self, torus, omega)
      class(sampled_laws_t), intent(inout) :: self
      type(torus_t), intent(in) :: torus
      real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s], (n_tones), > 0
      integer :: i, tone

      call set_frequencies(self%laws, omega)
      if (.not. self%has_memory) return
      tone = self%characteristic%tone
      call new_characteristic(self%characteristic, torus, omega, tone)
      do i = 1, size(self%sampled)
         if (allocated(self%sampled(i)%hysteresis)) call self%sampled(i)%hysteresis%forget_tones()
      end do
   end subroutine sampled_laws_move

   !> Coordinates of law i from values of all coordinates.
   pure function sampled_laws_coordinates_of(self, i, values) result(z)
      class(sampled_laws_t), intent(in) :: self
      integer, intent(in) :: i
      real(wp), intent(in) :: values(:, :)                            !! (any, n_dofs)
      real(wp) :: of_law(size(values, 1), size(self%laws(i)%law%shape, 1)), z(size(values, 1), size(self%laws(i)%law%shape, 2))

      of_law = values(:, self%laws(i)%law%dofs)
      z = matmul(of_law, self%laws(i)%law%shape)
   end function sampled_laws_coordinates_of

   !> Computes forces f from the samples q, v and s. If they are not finite, `find_failure` explains why.
   subroutine sampled_laws_evaluate(self)
      class(sampled_laws_t), intent(inout) :: self

      call run_laws(self, with_derivatives=.false.)
   end subroutine sampled_laws_evaluate

   !> Stores the explanations of laws for forces that are not finite, after `evaluate`. Callers detect these in the
   !> coefficients, all of which become NaN.
   subroutine sampled_laws_find_failure(self)
      class(sampled_laws_t), intent(inout) :: self
      integer :: i

      if (self%is_given_up) return
      do i = 1, size(self%laws)
         if (allocated(self%sampled(i)%hysteresis)) cycle
         call self%sampled(i)%find_failure(.false., self%error_text, self%is_given_up)
         if (self%is_given_up) return
      end do
   end subroutine sampled_laws_find_failure

   !> Gives up the laws of the user whose forces no method can follow along the present motion, and stores the reason.
   subroutine sampled_laws_find_unsuitable(self, torus)
      class(sampled_laws_t), intent(inout) :: self
      type(torus_t), intent(in) :: torus
      character(:), allocatable :: fault
      real(wp), allocatable :: path(:, :, :), rates(:, :), states(:, :)
      integer :: i

      do i = 1, size(self%laws)
         if (self%is_given_up) return
         associate (law => self%laws(i)%law)
            if (.not. law%is_users_own) cycle
            if (allocated(self%sampled(i)%hysteresis)) then
               call self%sampled(i)%hysteresis%find_steps(self%characteristic, self%samples, path, states)
               call find_fault_of_memory(self%sampled(i)%hysteresis%law, path, states, fault)
            else
               associate (z => self%coordinates_of(i, self%samples%q%values))
                  allocate (rates, source=0.0_wp*z)
                  if (law%needs_velocity) rates = self%coordinates_of(i, self%samples%v%values)
                  call find_fault(law, z, rates, torus%phases(), fault)
                  deallocate (rates)
               end associate
            end if
            if (len(fault) == 0) cycle
            self%error_text = "law '"//law%label//"': "//fault
            self%is_given_up = .true.
         end associate
      end do
   end subroutine sampled_laws_find_unsuitable

   !> Forces and derivatives of all pairs from the samples.
   subroutine sampled_laws_differentiate(self, error)
      class(sampled_laws_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      if (.not. self%jacobian%is_allocated()) then
         call self%jacobian%allocate_slopes(size(self%samples%q%values, 1), error)
         if (allocated(error)) return
         do i = 1, size(self%sampled)
            if (.not. allocated(self%sampled(i)%hysteresis)) call self%sampled(i)%make_derivatives()
         end do
      end if
      call run_laws(self, with_derivatives=.true.)
   end subroutine sampled_laws_differentiate

   subroutine run_laws(self, with_derivatives)
      class(sampled_laws_t), intent(inout) :: self
      logical, intent(in) :: with_derivatives
      type(shared_work_t) :: work
      integer :: i, n, pass

      associate (samples => self%samples)
         do i = 1, self%n_dofs
            if (self%is_summed(i)) samples%f%values(:, i) = 0.0_wp
         end do
         if (with_derivatives) call self%jacobian%clear()
         if (self%is_given_up) then
            samples%f%values = ieee_value(1.0_wp, ieee_quiet_nan)
            return
         end if
         n = n_threads(size(samples%q%values))
         do pass = 1, 2                                                ! explicit laws, then multipliers
            if (n == 1) then
               do i = 1, size(self%laws)
                  if (self%laws(i)%law%is_multiplier .neqv. pass == 2) cycle
                  call run_law(self, i, with_derivatives)
                  call add_law(self, i, with_derivatives)
               end do
            else
               work = work_of_thread()
               !$omp parallel do num_threads(n) schedule(dynamic)
               do i = 1, size(self%laws)
                  if ((self%laws(i)%law%is_multiplier .neqv. pass == 2) .or. self%laws(i)%law%is_users_own) cycle
                  call work%join()
                  call run_law(self, i, with_derivatives)
                  call work%leave()
               end do
               do i = 1, size(self%laws)
                  if (self%laws(i)%law%is_multiplier .neqv. pass == 2) cycle
                  if (self%laws(i)%law%is_users_own) call run_law(self, i, with_derivatives)
                  call add_law(self, i, with_derivatives)
               end do
            end if
         end do
         call self%kinks%correct(samples, with_derivatives)
         if (with_derivatives) call self%kinks%add_own_slopes(self%jacobian)
      end associate
   end subroutine run_laws

   !> Evaluates law i; changes nothing that others read, so that threads may share the laws.
   subroutine run_law(self, i, with_derivatives)
      class(sampled_laws_t), intent(inout) :: self
      integer, intent(in) :: i
      logical, intent(in) :: with_derivatives

      associate (law => self%sampled(i))
         if (allocated(law%hysteresis)) then
            call law%hysteresis%evaluate(self%characteristic, self%samples, law%f)
            return
         end if
         call law%gather(self%samples)
         if (with_derivatives) then
            call law%differentiate()
         else
            call law%evaluate()
         end if
      end associate
   end subroutine run_law

   !> Adds law i to the forces and derivatives of all laws.
   subroutine add_law(self, i, with_derivatives)
      class(sampled_laws_t), intent(inout) :: self
      integer, intent(in) :: i
      logical, intent(in) :: with_derivatives

      associate (law => self%sampled(i))
         if (with_derivatives .and. .not. allocated(law%hysteresis)) then
            call self%jacobian%add(law)
            call law%find_failure(with_derivatives, self%error_text, self%is_given_up)
         end if
         call law%scatter(self%samples%f)
      end associate
   end subroutine add_law

   !> Force of law i alone at its coordinates, after `evaluate`.
   function sampled_laws_force_of(self, i) result(force)
      class(sampled_laws_t), intent(in) :: self
      integer, intent(in) :: i
      real(wp), pointer, contiguous :: force(:, :)                    !! [N], (n_samples, n_coordinates)

      force => self%sampled(i)%f
   end function sampled_laws_force_of

   !> Allocates the samples `along` a direction at their first use.
   subroutine sampled_laws_make_direction_samples(self, error)
      class(sampled_laws_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error

      if (associated(self%along%f%values)) return
      call new_law_samples(self%along, size(self%samples%q%values, 1), self%n_dofs, self%needs_velocity, &
                           self%needs_reaction, self%has_memory, error)
   end subroutine sampled_laws_make_direction_samples

   !> Derivative along a direction of the forces, `along%f`, from the other samples there, after `differentiate`.
   !> Fails if the derivative of a law with memory does not become periodic.
   subroutine sampled_laws_differentiate_along(self, error, weight_slope)
      class(sampled_laws_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: weight_slope(:)               !! of `characteristic`; not present: laws with memory
                                                                      !! contribute nothing, as steps along time do not change
      integer :: i

      self%along%f%values = 0.0_wp
      if (present(weight_slope) .and. self%has_memory) then
         call differentiate_memory(self, weight_slope)
         do i = 1, size(self%sampled)
            if (.not. allocated(self%sampled(i)%hysteresis)) cycle
            call self%sampled(i)%hysteresis%add_slope(self%along, error)
            if (allocated(error)) return
         end do
         call add_multiplier_response(self%sampled, self%along%f)
      end if
      call self%jacobian%add_product(self%along)
      call self%kinks%add_along(self%along)
   end subroutine sampled_laws_differentiate_along

   !> The derivatives of all laws with memory along the direction.
   subroutine differentiate_memory(self, weight_slope)
      class(sampled_laws_t), intent(inout) :: self
      real(wp), intent(in) :: weight_slope(:)
      type(shared_work_t) :: work
      integer :: i, n

      n = n_threads(size(self%along%q%values))
      work = work_of_thread()
      !$omp parallel do num_threads(n) schedule(dynamic) if (n > 1)
      do i = 1, size(self%sampled)
         if (.not. allocated(self%sampled(i)%hysteresis)) cycle
         if (n > 1) call work%join()
         call self%sampled(i)%hysteresis%find_slope(self%characteristic, weight_slope, self%along)
         if (n > 1) call work%leave()
      end do
   end subroutine differentiate_memory

   !> Derivative of the forces with respect to a number of some laws at a fixed motion, `along%f`, after `differentiate`.
   !> Kinks between samples move with the number; their correction is differentiated by differences, and so are laws that do
   !> not know their derivative, among them those with memory. `is_known` is false if the number cannot move by these steps.
   subroutine sampled_laws_differentiate_by_number(self, is_moved, number, steps, is_known)
      class(sampled_laws_t), intent(inout) :: self
      logical, intent(in) :: is_moved(:)                              !! the laws that have the number, (laws)
      type(number_t), intent(in) :: number
      real(wp), intent(in) :: steps(2)                                !! as for `find_sides` of hb_sampled_law
      logical, intent(out) :: is_known
      type(law_box_t) :: sides(2)
      real(wp), allocatable :: slope(:, :)
      integer :: i, pass

      is_known = .false.
      self%along%f%values = 0.0_wp
      do pass = 1, 2                                                  ! explicit laws, then multipliers
         do i = 1, size(self%laws)
            if (.not. is_moved(i) .or. (self%laws(i)%law%is_multiplier .neqv. pass == 2)) cycle
            if (self%laws(i)%law%has_weight(number)) then
               is_known = .false.
               return
            end if
            if (allocated(self%sampled(i)%hysteresis)) then
               call self%sampled(i)%find_memory_slope(number, steps, self%characteristic, self%samples, slope, is_known)
            else
               call self%sampled(i)%find_number_slope(number, steps, slope, is_known)
            end if
            if (.not. is_known) return
            associate (law => self%laws(i)%law, f => self%along%f%values)
               f(:, law%dofs) = f(:, law%dofs) + matmul(slope, transpose(law%shape))
            end associate
         end do
         if (pass == 1 .and. self%needs_reaction) call add_multiplier_response(self%sampled, self%along%f)
      end do
      do i = 1, size(self%laws)
         if (.not. is_moved(i) .or. .not. allocated(self%laws(i)%law%kinks)) cycle
         call self%sampled(i)%find_sides(number, steps, sides, is_known)
         if (.not. is_known) return
         call self%kinks%add_of(i, sides(2)%law, 1.0_wp/sum(steps), self%samples, self%along%f)
         call self%kinks%add_of(i, sides(1)%law, -1.0_wp/sum(steps), self%samples, self%along%f)
      end do
   end subroutine sampled_laws_differentiate_by_number

   !> Adds to `along%f` the derivative of the forces with respect to a base frequency at a fixed motion, after
   !> `differentiate`.
   subroutine sampled_laws_add_frequency_slopes(self, tone)
      class(sampled_laws_t), intent(inout) :: self
      integer, intent(in) :: tone
      real(wp), allocatable :: slope(:, :)
      integer :: i

      do i = 1, size(self%laws)
         associate (law => self%laws(i)%law, sampled => self%sampled(i))
            if (.not. law%needs_frequencies) cycle
            allocate (slope, mold=sampled%f)
            call law%frequency_slope(sampled%z, sampled%v, tone, slope)
            self%along%f%values(:, law%dofs) = self%along%f%values(:, law%dofs) + matmul(slope, transpose(law%shape))
            deallocate (slope)
         end associate
      end do
   end subroutine sampled_laws_add_frequency_slopes

   !> Computes the means over the torus of df/dq, df/dv and df/ds, after `differentiate`, in a memory layout with room for what
   !> laws couple.
   subroutine sampled_laws_mean_slopes(self, layout, df_dq, df_dv, df_ds)
      class(sampled_laws_t), intent(inout) :: self
      type(block_pattern_t), intent(in) :: layout
      real(wp), intent(out) :: df_dq(:, :), df_dv(:, :), df_ds(:, :)  !! (layout%n_rows, n_dofs)

      call self%jacobian%mean(layout, df_dq, df_dv, df_ds)
      call self%add_memory_slopes(layout, df_dq)
   end subroutine sampled_laws_mean_slopes

   !> Adds the mean slopes of the laws with memory, which are not in `jacobian`.
   subroutine sampled_laws_add_memory_slopes(self, layout, df_dq)
      class(sampled_laws_t), intent(inout) :: self
      type(block_pattern_t), intent(in) :: layout
      real(wp), intent(inout) :: df_dq(:, :)                          !! (layout%n_rows, n_dofs)
      integer :: i

      do i = 1, size(self%sampled)
         if (allocated(self%sampled(i)%hysteresis)) &
            call self%sampled(i)%hysteresis%add_mean_slope(self%characteristic, layout, df_dq)
      end do
   end subroutine sampled_laws_add_memory_slopes

   !> Largest distance between degrees of freedom, among those of all laws, that one law with memory couples.
   pure integer function sampled_laws_memory_bandwidth(self) result(bandwidth)
      class(sampled_laws_t), intent(in) :: self
      integer :: i

      bandwidth = 0
      do i = 1, size(self%sampled)
         if (.not. allocated(self%sampled(i)%hysteresis)) cycle
         bandwidth = max(bandwidth, maxval(self%sampled(i)%columns) - minval(self%sampled(i)%columns))
      end do
   end function sampled_laws_memory_bandwidth

   !> Rounds of the torus for the columns of a tangent until sliders are periodic, for all laws. One for a single
   !> line.
   pure integer function sampled_laws_memory_rounds(self) result(rounds)
      class(sampled_laws_t), intent(in) :: self
      integer :: i

      rounds = 0
      if (self%characteristic%n_slice == 1) return
      do i = 1, size(self%sampled)
         if (allocated(self%sampled(i)%hysteresis)) rounds = rounds + self%sampled(i)%hysteresis%sliders%rounds_of_derivatives()
      end do
   end function sampled_laws_memory_rounds

   !> Error of the memory of a law after `evaluate`; empty if the states of all laws are periodic.
   pure function sampled_laws_memory_failure(self) result(text)
      class(sampled_laws_t), intent(in) :: self
      character(300) :: text
      integer :: i

      text = ""
      do i = 1, size(self%laws)
         if (.not. allocated(self%sampled(i)%hysteresis)) cycle
         text = self%sampled(i)%hysteresis%failure()
         if (text /= "") return
      end do
   end function sampled_laws_memory_failure

   !> Largest forces [N] that the springs of laws with memory would have without their sliders: rounding errors are
   !> units in their last place.
   function sampled_laws_spring_forces(self) result(forces)
      class(sampled_laws_t), intent(in) :: self
      real(wp) :: forces(self%n_dofs)
      integer :: i

      forces = 0.0_wp
      do i = 1, size(self%laws)
         if (.not. allocated(self%sampled(i)%hysteresis)) cycle
         call self%sampled(i)%hysteresis%add_spring_forces(forces)
      end do
   end function sampled_laws_spring_forces

   !> Whether no slider of law i slipped anywhere, after `evaluate`: it is then at its position after loading from
   !> rest, which is one of many solutions. False for laws without memory.
   pure logical function sampled_laws_full_stick(self, i)
      class(sampled_laws_t), intent(in) :: self
      integer, intent(in) :: i

      sampled_laws_full_stick = .false.
      if (allocated(self%sampled(i)%hysteresis)) sampled_laws_full_stick = self%sampled(i)%hysteresis%sliders%full_stick
   end function sampled_laws_full_stick

   !> Whether no slider of any law slipped anywhere, after `evaluate`.
   pure logical function sampled_laws_all_stick(self) result(all_stick)
      class(sampled_laws_t), intent(in) :: self
      integer :: i

      all_stick = all([(self%full_stick(i) .or. .not. allocated(self%sampled(i)%hysteresis), i=1, size(self%laws))])
   end function sampled_laws_all_stick

   !> Adds to the motion of degrees of freedom the correction that satisfies the constraints of the laws, from the
   !> samples q. A law moves its degrees of freedom by w (corrected - z)/w.w for each of its coordinates z with the
   !> weights w.
   subroutine sampled_laws_correct(self, coordinates, motion)
      class(sampled_laws_t), intent(inout) :: self
      type(coordinates_t), intent(in) :: coordinates
      real(wp), intent(inout) :: motion(:, :)                         !! [m], (n_samples, size(coordinates%dofs))
      real(wp), allocatable :: weights(:), z(:, :)
      integer :: c, i, k

      do i = 1, size(self%laws)
         if (.not. self%laws(i)%law%is_multiplier) cycle
         associate (law => self%laws(i)%law, sampled => self%sampled(i))
            call sampled%gather(self%samples)
            z = sampled%z
            call law%correct(sampled%z, z)
            do c = 1, size(law%shape, 2)
               weights = coordinates%weights_of(law%dofs, law%shape(:, c))
               weights = weights/sum(weights**2)
               do k = 1, size(weights)
                  if (abs(weights(k)) > 0.0_wp) motion(:, k) = motion(:, k) + weights(k)*(z(:, c) - sampled%z(:, c))
               end do
            end do
         end associate
      end do
   end subroutine sampled_laws_correct

   !> Largest defects of all rigid contacts and rigid friction over the samples q, v and s, after `evaluate`.
   pure function sampled_laws_defects(self) result(largest)
      class(sampled_laws_t), intent(in) :: self
      type(defects_t) :: largest
      type(defects_t) :: found
      integer :: i

      do i = 1, size(self%laws)
         if (.not. self%laws(i)%law%is_multiplier) cycle
         found = self%laws(i)%law%defects(self%sampled(i)%z, self%sampled(i)%v, self%sampled(i)%p)
         largest%penetration = max(largest%penetration, found%penetration)
         largest%tension = max(largest%tension, found%tension)
         largest%complementarity = max(largest%complementarity, found%complementarity)
         largest%slip = max(largest%slip, found%slip)
      end do
   end function sampled_laws_defects

   !> Mean over the torus of the potentials of all laws at the samples q; their gradients replace the force f.
   subroutine sampled_laws_potential(self, mean_energy)
      class(sampled_laws_t), intent(inout) :: self
      real(wp), intent(out) :: mean_energy                            !! [J]
      real(wp) :: energy(size(self%samples%q%values, 1))
      integer :: i

      mean_energy = 0.0_wp
      self%samples%f%values = 0.0_wp
      do i = 1, size(self%laws)
         associate (law => self%laws(i)%law, sampled => self%sampled(i))
            call sampled%gather(self%samples)
            call law%potential(sampled%z, energy, sampled%f)
            call sampled%scatter(self%samples%f)
         end associate
         mean_energy = mean_energy + sum(energy)/size(energy)
      end do
   end subroutine sampled_laws_potential

   !> Frees all samples; safe to call twice.
   subroutine sampled_laws_destroy(self)
      class(sampled_laws_t), intent(inout) :: self

      call forget_laws(self)
      call self%samples%destroy()
   end subroutine sampled_laws_destroy

   !> Frees all but the samples of the motion.
   subroutine forget_laws(self)
      type(sampled_laws_t), intent(inout) :: self
      integer :: i

      if (allocated(self%sampled)) then
         do i = 1, size(self%sampled)
            call self%sampled(i)%destroy()
         end do
         deallocate (self%sampled)
      end if
      call self%along%destroy()
      call self%jacobian%destroy()
   end subroutine forget_laws
end module hb_sampled_laws
