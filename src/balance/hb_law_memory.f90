!> What a law with memory keeps beside its samples: the walk of its states over the torus, and how that walk answers to the
!> motion, coefficient by coefficient or along a direction, and to a base frequency.
!>
!> Source: docs/user/theory.md, sections 5.5 and 5.6.
module hb_law_memory
   use hb_characteristic, only: characteristic_t
   use hb_direction_walk, only: direction_walk_t, new_direction_walk
   use hb_error, only: error_t, fail
   use hb_fftw, only: real_block_t
   use hb_harmonics, only: harmonics_t
   use hb_hysteretic_law, only: hysteretic_law_t, path_part
   use hb_kinds, only: wp
   use hb_law, only: law_t
   use hb_line_tangent, only: line_tangent_t, new_line_tangent
   use hb_memory_tangent, only: memory_tangent_t, new_memory_tangent, width
   use hb_slider_memory, only: memory_t, new_memory
   use hb_text, only: to_text
   use hb_torus, only: torus_t
   implicit none
   private
   public :: law_memory_t, new_law_memory

   !> The law itself is passed to the procedures; it is always the one of `new_law_memory`. `columns` says where its degrees
   !> of freedom stand among those of all laws.
   type :: law_memory_t
      type(memory_t) :: walk                                          !! the states
      real(wp), allocatable :: answer(:, :, :, :)                     !! (width, 2, n_coordinates, n_samples) to a block of
                                                                      !! columns
      type(line_tangent_t), allocatable :: line                       !! under one tone, from the first `prepare_line` on
      type(memory_tangent_t), allocatable, private :: tangent         ! from the first use on
      type(direction_walk_t), allocatable, private :: direction_walk  ! from the first use on
      real(wp), allocatable, private :: f_along(:, :)                 ! (n_samples, n_coordinates)
   contains
      procedure :: forget_tones => law_memory_forget_tones
      procedure :: run => law_memory_run
      procedure :: add_slope => law_memory_add_slope
      procedure :: prepare_line => law_memory_prepare_line
      procedure :: prepare_answers => law_memory_prepare_answers
      procedure :: n_blocks => law_memory_n_blocks
      procedure :: answer_block => law_memory_answer_block
      procedure :: trouble => law_memory_trouble
      procedure :: add_spring_forces => law_memory_add_spring_forces
      procedure :: add_mean_slope => law_memory_add_mean_slope
   end type law_memory_t

contains

   !> Makes room for the states of a law.
   subroutine new_law_memory(self, law, characteristic)
      type(law_memory_t), intent(out) :: self
      class(hysteretic_law_t), intent(in) :: law
      type(characteristic_t), intent(in) :: characteristic

      call new_memory(self%walk, characteristic, size(law%shape, 2), law%n_states)
   end subroutine new_law_memory

   !> Drops what was made for the base frequencies, when these change.
   pure subroutine law_memory_forget_tones(self)
      class(law_memory_t), intent(inout) :: self

      if (allocated(self%tangent)) deallocate (self%tangent, self%answer)
      if (allocated(self%line)) deallocate (self%line)
   end subroutine law_memory_forget_tones

   !> Finds the forces: the states that repeat on the path of the law, then the force sample by sample.
   subroutine law_memory_run(self, law, columns, characteristic, q, q_before, step_rate, step_rate_before, f)
      class(law_memory_t), intent(inout) :: self
      class(law_t), intent(in) :: law
      integer, intent(in) :: columns(:)
      type(characteristic_t), intent(in) :: characteristic
      type(real_block_t), intent(in) :: q, q_before                   !! motion, and one step before [m], (n_samples, n_dofs)
      type(real_block_t), intent(in) :: step_rate, step_rate_before   !! rate times the step, there and one step before [m]
      real(wp), intent(inout) :: f(:, :)                              !! [N], (n_samples, n_coordinates)
      integer :: slice

      associate (walk => self%walk)
         call gather_part(law, columns, characteristic, q%values, walk%path(:, :, path_part%at_end, :))
         call gather_part(law, columns, characteristic, q_before%values, walk%path(:, :, path_part%at_start, :))
         call gather_part(law, columns, characteristic, step_rate%values, walk%path(:, :, path_part%end_rate, :))
         call gather_part(law, columns, characteristic, step_rate_before%values, walk%path(:, :, path_part%start_rate, :))
         select type (law)
         class is (hysteretic_law_t)
            call walk%march(law, characteristic)
            if (characteristic%n_slice == 1) then
               call find_line_forces(walk, law, characteristic, f)
               return
            end if
            do slice = 1, characteristic%n_steps
               call law%force(walk%path(:, :, path_part%at_end, slice), walk%states(:, :, slice), walk%force)
               f(characteristic%sample(:, slice), :) = walk%force
            end do
         end select
      end associate
   end subroutine law_memory_run

   !> Forces of all samples at once where they form one line.
   subroutine find_line_forces(walk, law, characteristic, f)
      type(memory_t), intent(in) :: walk
      class(hysteretic_law_t), intent(in) :: law
      type(characteristic_t), intent(in) :: characteristic
      real(wp), intent(inout) :: f(:, :)                              !! [N], (n_samples, n_coordinates)
      real(wp), allocatable :: z(:, :), s(:, :), force(:, :)

      z = transpose(walk%path(1, :, path_part%at_end, :))
      s = transpose(walk%states(1, :, :))
      allocate (force, mold=z)
      call law%force(z, s, force)
      f(characteristic%sample(1, :), :) = force
   end subroutine find_line_forces

   !> One part of the paths of all coordinates of a law from samples of the degrees of freedom.
   subroutine gather_part(law, columns, characteristic, values, path)
      class(law_t), intent(in) :: law
      integer, intent(in) :: columns(:)
      type(characteristic_t), intent(in) :: characteristic
      real(wp), intent(in) :: values(:, :)                            !! (n_samples, n_dofs)
      real(wp), intent(out) :: path(:, :, :)                          !! (n_slice, n_coordinates, n_steps)
      integer :: c, k, slice

      associate (shape => law%shape, sample => characteristic%sample)
         if (size(sample, 1) == 1) then                                ! one line: all steps at once
            do c = 1, size(shape, 2)
               path(1, c, :) = 0.0_wp
               do k = 1, size(columns)
                  if (abs(shape(k, c)) <= 0.0_wp) cycle
                  path(1, c, :) = path(1, c, :) + shape(k, c)*values(sample(1, :), columns(k))
               end do
            end do
            return
         end if
         do slice = 1, size(sample, 2)
            do c = 1, size(shape, 2)
               path(:, c, slice) = 0.0_wp
               do k = 1, size(columns)
                  if (abs(shape(k, c)) <= 0.0_wp) cycle
                  path(:, c, slice) = path(:, c, slice) + shape(k, c)*values(sample(:, slice), columns(k))
               end do
            end do
         end do
      end associate
   end subroutine gather_part

   !> Adds how the forces of the law answer along a direction, from the derivatives of what steps know of the motion.
   !>
   !> Fails where the derivative of the states does not repeat from round to round.
   subroutine law_memory_add_slope(self, law, columns, characteristic, weight_slope, q, q_before, step_rate, step_rate_before, &
                                   f, error)
      class(law_memory_t), intent(inout) :: self
      class(law_t), intent(in) :: law
      integer, intent(in) :: columns(:)
      type(characteristic_t), intent(in) :: characteristic
      real(wp), intent(in) :: weight_slope(:)                         !! of `characteristic`
      type(real_block_t), intent(in) :: q, q_before, step_rate, step_rate_before !! derivatives, (n_samples, n_dofs)
      type(real_block_t), intent(inout) :: f                          !! derivatives, (n_samples, n_dofs)
      type(error_t), allocatable, intent(out) :: error
      integer :: c, k

      if (.not. allocated(self%direction_walk)) then
         allocate (self%direction_walk)
         call new_direction_walk(self%direction_walk, self%walk)
         allocate (self%f_along(size(f%values, 1), size(law%shape, 2)))
      end if
      associate (path => self%direction_walk%path)
         call gather_part(law, columns, characteristic, q%values, path(:, :, path_part%at_end, :))
         call gather_part(law, columns, characteristic, q_before%values, path(:, :, path_part%at_start, :))
         call gather_part(law, columns, characteristic, step_rate%values, path(:, :, path_part%end_rate, :))
         call gather_part(law, columns, characteristic, step_rate_before%values, path(:, :, path_part%start_rate, :))
      end associate
      select type (law)
      class is (hysteretic_law_t)
         call self%direction_walk%walk(self%walk, law, characteristic, weight_slope)
         if (.not. self%direction_walk%repeats) then
            call fail(error, "law '"//law%label//"': the derivative of its memory does not repeat "// &
                      "from round to round of the torus")
            return
         end if
         call self%direction_walk%force(self%walk, law, characteristic, self%f_along)
      end select
      do c = 1, size(law%shape, 2)
         do k = 1, size(columns)
            f%values(:, columns(k)) = f%values(:, columns(k)) + law%shape(k, c)*self%f_along(:, c)
         end do
      end do
   end subroutine law_memory_add_slope

   !> Prepares the answers to coefficients of the motion, after `run`.
   subroutine law_memory_prepare_answers(self, law, characteristic, harmonics, torus, frequencies)
      class(law_memory_t), intent(inout) :: self
      class(law_t), intent(in) :: law
      type(characteristic_t), intent(in) :: characteristic
      type(harmonics_t), intent(in) :: harmonics
      type(torus_t), intent(in) :: torus
      real(wp), intent(in) :: frequencies(:)                          !! j.omega [rad/s], (n_harmonics)

      select type (law)
      class is (hysteretic_law_t)
         if (.not. allocated(self%tangent)) then
            allocate (self%tangent)
            call new_memory_tangent(self%tangent, characteristic, harmonics, torus, frequencies, size(law%shape, 2), &
                                    law%n_states)
            allocate (self%answer(width, 2, size(law%shape, 2), torus%n_total))
         end if
         call self%tangent%prepare(self%walk, law, characteristic)
      end select
   end subroutine law_memory_prepare_answers

   !> Prepares `line`, if the law is of the kind that it treats, after `run`.
   subroutine law_memory_prepare_line(self, law, characteristic, harmonics, frequencies, is_available)
      class(law_memory_t), intent(inout) :: self
      class(law_t), intent(in) :: law
      type(characteristic_t), intent(in) :: characteristic
      type(harmonics_t), intent(in) :: harmonics
      real(wp), intent(in) :: frequencies(:)                          !! j.omega [rad/s], (n_harmonics)
      logical, intent(out) :: is_available

      is_available = .false.
      if (harmonics%n_tones /= 1) return
      if (.not. allocated(self%line)) then
         allocate (self%line)
         call new_line_tangent(self%line, characteristic, harmonics, frequencies)
      end if
      select type (law)
      class is (hysteretic_law_t)
         call self%line%prepare(self%walk, law, characteristic)
      end select
      is_available = self%line%is_available
   end subroutine law_memory_prepare_line

   !> Number of blocks of at most hb_memory_tangent%width harmonics in which the answers come.
   pure integer function law_memory_n_blocks(self)
      class(law_memory_t), intent(in) :: self

      law_memory_n_blocks = self%tangent%n_blocks
   end function law_memory_n_blocks

   !> Finds `answer`, to cos and sin of a block of harmonics of one coordinate.
   subroutine law_memory_answer_block(self, characteristic, coordinate, block)
      class(law_memory_t), intent(inout) :: self
      type(characteristic_t), intent(in) :: characteristic
      integer, intent(in) :: coordinate, block

      call self%tangent%respond(self%walk, characteristic, block, coordinate, self%answer)
   end subroutine law_memory_answer_block

   !> What is wrong with the states after `run`; empty when they repeat.
   pure function law_memory_trouble(self, law) result(text)
      class(law_memory_t), intent(in) :: self
      class(law_t), intent(in) :: law
      character(:), allocatable :: text

      text = ""
      if (self%walk%repeats) return
      text = "the sliders of law '"//law%label//"' do not come back to their places within "// &
             to_text(self%walk%rounds)//" rounds of the torus: they hardly slip"
   end function law_memory_trouble

   !> Adds the largest forces that the springs of the law would have without their sliders.
   subroutine law_memory_add_spring_forces(self, law, columns, forces)
      class(law_memory_t), intent(in) :: self
      class(law_t), intent(in) :: law
      integer, intent(in) :: columns(:)
      real(wp), intent(inout) :: forces(:)                            !! [N], (n_dofs)
      real(wp), allocatable :: df_dz(:, :, :), df_ds(:, :, :), f(:, :)
      integer :: c

      associate (path => self%walk%path, states => self%walk%states, shape => law%shape)
         allocate (f(size(path, 1), size(path, 2)), df_dz(size(path, 1), size(path, 2), size(path, 2)))
         allocate (df_ds(size(path, 1), size(path, 2), size(states, 2)))
         select type (law)
         class is (hysteretic_law_t)
            call law%force(path(:, :, path_part%at_end, 1), states(:, :, 1), f, df_dz, df_ds)
         end select
         do c = 1, size(shape, 2)
            forces(columns) = forces(columns) + matmul(abs(shape), maxval(abs(df_dz(:, :, c)), dim=1)) &
                              *maxval(abs(path(:, c, path_part%at_end, :)))
         end do
      end associate
   end subroutine law_memory_add_spring_forces

   !> Adds the mean over the torus of the derivative of the force by the motion, after `run`.
   subroutine law_memory_add_mean_slope(self, law, columns, characteristic, df_dq)
      class(law_memory_t), intent(inout) :: self
      class(law_t), intent(in) :: law
      integer, intent(in) :: columns(:)
      type(characteristic_t), intent(in) :: characteristic
      real(wp), intent(inout) :: df_dq(:, :)                          !! [N/m], (n_dofs, n_dofs)
      real(wp), allocatable :: slope(:, :)

      associate (shape => law%shape)
         allocate (slope(size(shape, 2), size(shape, 2)))
         select type (law)
         class is (hysteretic_law_t)
            call self%walk%mean_slope(law, characteristic, slope)
         end select
         df_dq(columns, columns) = df_dq(columns, columns) + matmul(shape, matmul(slope, transpose(shape)))
      end associate
   end subroutine law_memory_add_mean_slope
end module hb_law_memory
