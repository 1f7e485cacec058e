!> The memory of one law at the samples of one torus: its forces from periodic states, and the response of these
!> forces to the motion, coefficient by coefficient or along a direction, and to a base frequency.
!>
!> Source: docs/why/theory.md, sections 5.5 and 5.6.
module hb_hysteresis
   use, intrinsic :: iso_fortran_env, only: int64
   use hb_block_pattern, only: block_pattern_t
   use hb_characteristic, only: characteristic_t
   use hb_error, only: error_t, fail
   use hb_harmonics, only: harmonics_t
   use hb_hysteresis_tangent, only: block_width, memory_tangent_t, new_memory_tangent
   use hb_hysteretic_law, only: hysteretic_law_t, path_part
   use hb_kinds, only: wp
   use hb_law_samples, only: law_samples_t
   use hb_line_tangent, only: line_tangent_t, new_line_tangent
   use hb_slider_derivative, only: new_slider_derivative, slider_derivative_t
   use hb_slider_states, only: new_slider_states, slider_states_t
   use hb_text, only: to_text
   use hb_torus, only: torus_t
   implicit none
   private
   public :: hysteresis_t, new_hysteresis

   type :: hysteresis_t
      class(hysteretic_law_t), pointer :: law => null()               !! of `new_hysteresis`, which must outlive this
      type(slider_states_t) :: sliders                                !! over the torus
      real(wp), allocatable :: response(:, :, :, :)                   !! (n_samples, width, 2, n_coordinates) to a block of
                                                                      !! columns
      type(line_tangent_t), allocatable, private :: line           ! under one tone, after the first `prepare_line`
      type(memory_tangent_t), allocatable, private :: tangent         ! after the first use
      real(wp), allocatable, private :: by_sample(:, :)               ! as `response`, all columns of one sample after the other
      type(slider_derivative_t), allocatable, private :: derivative ! after the first use
      real(wp), allocatable, private :: f_along(:, :)                 ! (n_samples, n_coordinates)
      integer(int64), private :: motion = -1                          ! of whose samples the states are; -1: none
   contains
      procedure :: forget_tones => hysteresis_forget_tones
      procedure :: evaluate => hysteresis_evaluate
      procedure :: find_steps => hysteresis_find_steps
      procedure :: find_slope => hysteresis_find_slope
      procedure :: add_slope => hysteresis_add_slope
      procedure :: prepare_line => hysteresis_prepare_line
      procedure :: find_line => hysteresis_find_line
      procedure :: prepare_response => hysteresis_prepare_response
      procedure :: n_blocks => hysteresis_n_blocks
      procedure :: find_block_response => hysteresis_find_block_response
      procedure :: failure => hysteresis_failure
      procedure :: add_spring_forces => hysteresis_add_spring_forces
      procedure :: add_mean_slope => hysteresis_add_mean_slope
   end type hysteresis_t

contains

   !> Allocates memory for the states of a law.
   subroutine new_hysteresis(self, law, characteristic)
      type(hysteresis_t), intent(out) :: self
      class(hysteretic_law_t), pointer, intent(in) :: law
      type(characteristic_t), intent(in) :: characteristic

      self%law => law
      call new_slider_states(self%sliders, characteristic, size(law%shape, 2), law%n_states)
   end subroutine new_hysteresis

   !> Discards the data for the base frequencies when these change.
   pure subroutine hysteresis_forget_tones(self)
      class(hysteresis_t), intent(inout) :: self

      if (allocated(self%tangent)) deallocate (self%tangent, self%response, self%by_sample)
      if (allocated(self%line)) deallocate (self%line)
      self%motion = -1
   end subroutine hysteresis_forget_tones

   !> Computes the forces: the periodic states on the path of the law, unless they are known, then the force sample by sample.
   subroutine hysteresis_evaluate(self, characteristic, samples, f)
      class(hysteresis_t), intent(inout) :: self
      type(characteristic_t), intent(in) :: characteristic
      type(law_samples_t), intent(in) :: samples
      real(wp), intent(inout) :: f(:, :)                              !! [N], (n_samples, n_coordinates)
      real(wp), allocatable :: z(:, :), s(:, :), force(:, :)
      integer :: slice

      call integrate_states(self, characteristic, samples)
      associate (path => self%sliders%path, states => self%sliders%states)
         if (characteristic%n_slice == 1) then                        ! all samples form one line: their forces at once
            z = transpose(path(1, :, path_part%at_end, :))
            s = transpose(states(1, :, :))
            allocate (force, mold=z)
            call self%law%force(z, s, force)
            f(characteristic%sample(1, :), :) = force
            return
         end if
         do slice = 1, characteristic%n_steps
            call self%law%force(path(:, :, path_part%at_end, slice), states(:, :, slice), self%sliders%force)
            f(characteristic%sample(:, slice), :) = self%sliders%force
         end do
      end associate
   end subroutine hysteresis_evaluate

   !> Integrates the states along the motion of the samples, unless they are known.
   subroutine integrate_states(self, characteristic, samples)
      type(hysteresis_t), intent(inout) :: self
      type(characteristic_t), intent(in) :: characteristic
      type(law_samples_t), intent(in) :: samples

      if (self%motion == samples%n_motions) return
      call gather_path(self, characteristic, samples, self%sliders%path)
      call self%sliders%integration(self%law, characteristic)
      self%motion = merge(samples%n_motions, -1_int64, self%sliders%repeats)
   end subroutine integrate_states

   !> The steps along the motion of the samples, one line after another, with the states of the step before each of them.
   subroutine hysteresis_find_steps(self, characteristic, samples, path, states)
      class(hysteresis_t), intent(inout) :: self
      type(characteristic_t), intent(in) :: characteristic
      type(law_samples_t), intent(in) :: samples
      real(wp), allocatable, intent(out) :: path(:, :, :)             !! [m], (n_samples, n_coordinates, n_path_parts)
      real(wp), allocatable, intent(out) :: states(:, :)              !! (n_samples, n_states)
      integer :: c, n, part

      call integrate_states(self, characteristic, samples)
      n = characteristic%n_slice*characteristic%n_steps
      associate (paths => self%sliders%path, states_after => self%sliders%states)
         allocate (path(n, size(paths, 2), size(paths, 3)), states(n, size(states_after, 2)))
         do part = 1, size(paths, 3)
            do c = 1, size(paths, 2)
               path(:, c, part) = reshape(transpose(paths(:, c, part, :)), [n])
            end do
         end do
         do c = 1, size(states_after, 2)
            states(:, c) = reshape(transpose(cshift(states_after(:, c, :), -1, dim=2)), [n])
         end do
      end associate
   end subroutine hysteresis_find_steps

   !> The paths of all coordinates of the law along the steps, from samples of the degrees of freedom.
   subroutine gather_path(self, characteristic, samples, path)
      type(hysteresis_t), intent(in) :: self
      type(characteristic_t), intent(in) :: characteristic
      type(law_samples_t), intent(in) :: samples
      real(wp), intent(inout) :: path(:, :, :, :)                     !! (n_slice, n_coordinates, n_path_parts, n_steps)

      call gather_part(self, characteristic, samples%q%values, path(:, :, path_part%at_end, :))
      call gather_part(self, characteristic, samples%q_before%values, path(:, :, path_part%at_start, :))
      call gather_part(self, characteristic, samples%step_rate%values, path(:, :, path_part%end_rate, :))
      call gather_part(self, characteristic, samples%step_rate_before%values, path(:, :, path_part%start_rate, :))
   end subroutine gather_path

   !> One part of these paths.
   subroutine gather_part(self, characteristic, values, path)
      type(hysteresis_t), intent(in) :: self
      type(characteristic_t), intent(in) :: characteristic
      real(wp), intent(in) :: values(:, :)                            !! (n_samples, n_dofs)
      real(wp), intent(out) :: path(:, :, :)                          !! (n_slice, n_coordinates, n_steps)
      integer :: c, k, slice

      associate (shape => self%law%shape, columns => self%law%dofs, sample => characteristic%sample)
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

   !> Computes the derivative of the forces along a direction, from the derivatives of the paths of the steps; `add_slope` adds it.
   subroutine hysteresis_find_slope(self, characteristic, weight_slope, along)
      class(hysteresis_t), intent(inout) :: self
      type(characteristic_t), intent(in) :: characteristic
      real(wp), intent(in) :: weight_slope(:)                         !! of `characteristic`
      type(law_samples_t), intent(in) :: along

      if (.not. allocated(self%derivative)) then
         allocate (self%derivative)
         call new_slider_derivative(self%derivative, self%sliders)
         allocate (self%f_along(size(along%f%values, 1), size(self%law%shape, 2)))
      end if
      call gather_path(self, characteristic, along, self%derivative%path)
      call self%derivative%integration(self%sliders, self%law, characteristic, weight_slope)
      if (self%derivative%repeats) call self%derivative%force(self%sliders, self%law, characteristic, self%f_along)
   end subroutine hysteresis_find_slope

   !> Adds the derivative of the forces along a direction to its `f`, after `find_slope`. Fails if that of the states has not become
   !> periodic.
   subroutine hysteresis_add_slope(self, along, error)
      class(hysteresis_t), intent(in) :: self
      type(law_samples_t), intent(inout) :: along
      type(error_t), allocatable, intent(out) :: error
      integer :: c, k

      if (.not. self%derivative%repeats) then
         call fail(error, "law '"//self%law%label//"': the derivative of its memory does not repeat "// &
                   "from round to round of the torus")
         return
      end if
      associate (shape => self%law%shape, columns => self%law%dofs, f => along%f%values)
         do c = 1, size(shape, 2)
            do k = 1, size(columns)
               f(:, columns(k)) = f(:, columns(k)) + shape(k, c)*self%f_along(:, c)
            end do
         end do
      end associate
   end subroutine hysteresis_add_slope

   !> Prepares the response to coefficients of the motion, after `evaluate`.
   subroutine hysteresis_prepare_response(self, characteristic, harmonics, torus, frequencies)
      class(hysteresis_t), intent(inout) :: self
      type(characteristic_t), intent(in) :: characteristic
      type(harmonics_t), intent(in) :: harmonics
      type(torus_t), intent(in) :: torus
      real(wp), intent(in) :: frequencies(:)                          !! j.omega [rad/s], (n_harmonics)

      if (.not. allocated(self%tangent)) then
         allocate (self%tangent)
         call new_memory_tangent(self%tangent, characteristic, harmonics, torus, frequencies, size(self%law%shape, 2), &
                                 self%law%n_states)
         allocate (self%response(torus%n_total, block_width, 2, size(self%law%shape, 2)))
         allocate (self%by_sample(2*block_width*size(self%law%shape, 2), torus%n_total))
      end if
      call self%tangent%prepare(self%sliders, self%law, characteristic)
   end subroutine hysteresis_prepare_response

   !> Prepares `line`, if it applies to the law, after `evaluate`.
   subroutine hysteresis_prepare_line(self, characteristic, harmonics, frequencies, is_available)
      class(hysteresis_t), intent(inout) :: self
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
      call self%line%prepare(self%sliders, self%law, characteristic)
      is_available = self%line%is_available
   end subroutine hysteresis_prepare_line

   !> Response of force a of the law to its coordinate c, after `prepare_line`: the product with the motion at the
   !> same sample, and for each interval of sticking the samples and the motion, see hb_line_tangent.
   subroutine hysteresis_find_line(self, characteristic, a, c, product, stuck, pushed)
      class(hysteresis_t), intent(inout) :: self
      type(characteristic_t), intent(in) :: characteristic
      integer, intent(in) :: a, c
      real(wp), intent(out) :: product(:)                             !! [N/m], (n_samples)
      complex(wp), allocatable, intent(out) :: stuck(:, :), pushed(:, :)   !! (n_harmonics, n_runs)

      associate (line => self%line)
         call line%find(self%sliders, a, c)
         product(characteristic%sample(1, :)) = line%g
         stuck = line%stuck(:, :line%n_runs)
         pushed = line%pushed(:, :line%n_runs)
      end associate
   end subroutine hysteresis_find_line

   !> Number of blocks of at most hb_hysteresis_tangent%block_width harmonics of the response.
   pure integer function hysteresis_n_blocks(self)
      class(hysteresis_t), intent(in) :: self

      hysteresis_n_blocks = self%tangent%n_blocks
   end function hysteresis_n_blocks

   !> Computes `response` to cos and sin of a block of harmonics of one coordinate.
   subroutine hysteresis_find_block_response(self, characteristic, coordinate, block)
      class(hysteresis_t), intent(inout) :: self
      type(characteristic_t), intent(in) :: characteristic
      integer, intent(in) :: coordinate, block

      call self%tangent%respond(self%sliders, characteristic, block, coordinate, self%by_sample)
      call transpose_in_parts(self%by_sample, self%response)
   end subroutine hysteresis_find_block_response

   !> Transposes a matrix that does not fit into the cache: a few of its columns at a time.
   pure subroutine transpose_in_parts(matrix, transposed)
      real(wp), intent(in), contiguous :: matrix(:, :)
      real(wp), intent(out) :: transposed(size(matrix, 2), size(matrix, 1))
      integer, parameter :: n_together = 32
      integer :: first, i, last

      do first = 1, size(matrix, 2), n_together
         last = min(first + n_together - 1, size(matrix, 2))
         do i = 1, size(matrix, 1)
            transposed(first:last, i) = matrix(i, first:last)
         end do
      end do
   end subroutine transpose_in_parts

   !> Error of the states after `evaluate`; empty if they are periodic.
   pure function hysteresis_failure(self) result(text)
      class(hysteresis_t), intent(in) :: self
      character(merge(0, 140 + len(self%law%label), self%sliders%repeats)) :: text

      if (self%sliders%repeats) return
      text = "the sliders of law '"//self%law%label//"' do not return to their positions within "// &
             to_text(self%sliders%rounds)//" rounds of the torus: they hardly slip"
   end function hysteresis_failure

   !> Adds the largest forces that the springs of the law would have without their sliders.
   subroutine hysteresis_add_spring_forces(self, forces)
      class(hysteresis_t), intent(in) :: self
      real(wp), intent(inout) :: forces(:)                            !! [N], (n_dofs)
      real(wp), allocatable :: df_dz(:, :, :), df_ds(:, :, :), f(:, :)
      integer :: c

      associate (path => self%sliders%path, states => self%sliders%states, shape => self%law%shape, &
                 columns => self%law%dofs)
         allocate (f(size(path, 1), size(path, 2)), df_dz(size(path, 1), size(path, 2), size(path, 2)))
         allocate (df_ds(size(path, 1), size(path, 2), size(states, 2)))
         call self%law%force(path(:, :, path_part%at_end, 1), states(:, :, 1), f, df_dz, df_ds)
         do c = 1, size(shape, 2)
            forces(columns) = forces(columns) + matmul(abs(shape), maxval(abs(df_dz(:, :, c)), dim=1)) &
                              *maxval(abs(path(:, c, path_part%at_end, :)))
         end do
      end associate
   end subroutine hysteresis_add_spring_forces

   !> Adds the mean over the torus of the derivative of the force with respect to the motion, after `evaluate`.
   subroutine hysteresis_add_mean_slope(self, characteristic, layout, df_dq)
      class(hysteresis_t), intent(inout) :: self
      type(characteristic_t), intent(in) :: characteristic
      type(block_pattern_t), intent(in) :: layout
      real(wp), intent(inout) :: df_dq(:, :)                          !! [N/m], (layout%n_rows, n_dofs)
      real(wp), allocatable :: slope(:, :)
      integer :: k

      associate (shape => self%law%shape, columns => self%law%dofs)
         allocate (slope(size(shape, 2), size(shape, 2)))
         call self%sliders%mean_slope(self%law, characteristic, slope)
         slope = matmul(shape, matmul(slope, transpose(shape)))
         do k = 1, size(columns)
            associate (rows => layout%shift(columns(k)) + columns, column => columns(k))
               df_dq(rows, column) = df_dq(rows, column) + slope(:, k)
            end associate
         end do
      end associate
   end subroutine hysteresis_add_mean_slope
end module hb_hysteresis
