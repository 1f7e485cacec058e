!> Integration of disturbances over a piece of time without events.
!>
!> Method: commutator-free Magnus integrator of fourth order, exact for any stiffness of the constant part, with the
!> moments of A in a step by Simpson's rule. Source: S. Blanes and P. C. Moan, Applied Numerical Mathematics 56 (2006)
!> 1519-1537.
module hb_piece_propagation
   use hb_cancellation, only: work_is_over
   use hb_hysteretic_law, only: hysteretic_law_t
   use hb_kinds, only: wp
   use hb_matrix_exponential, only: exponential_of, exponential_of_two, exponential_with_noise, multiply_by, turn_covariance
   use hb_thresholds, only: rounding_level
   use hb_variation, only: piece_t, variation_t
   implicit none
   private
   public :: propagate

   integer, parameter :: few_rows = 16, between_checks = 16           ! steps of few rows take less than a check of the budget

contains

   !> Integral over half a step, relative to the step, from the values at its near end, its middle and its far end.
   elemental real(wp) function half_step(near, middle, far)
      real(wp), intent(in) :: near, middle, far

      half_step = 0.25_wp*near + 1.0_wp/3.0_wp*middle - 1.0_wp/12.0_wp*far
   end function half_step

   !> Propagates changes of the state from the start to the end of a piece in steps of equal length, and with `covariance` that of
   !> the state under the noise of the variation.
   subroutine propagate(self, piece, n_steps, x, covariance)
      type(variation_t), intent(inout) :: self
      type(piece_t), intent(inout) :: piece
      integer, intent(in) :: n_steps
      real(wp), intent(inout), contiguous :: x(:, :)                  !! (size, any)
      real(wp), intent(inout), contiguous, optional :: covariance(:, :) !! (size, size)
      real(wp), dimension(self%size, self%size) :: at_end, at_middle, at_start
      real(wp) :: h
      integer :: i

      h = (piece%finish - piece%start)/n_steps
      if (h > 0.0_wp .and. self%is_piecewise_linear()) then
         call propagate_constant(self, piece, x, covariance)
      else if (h > 0.0_wp) then
         call evaluate_steps(self, piece, n_steps)
         if (self%size == 2 .and. .not. (allocated(self%massless) .or. present(covariance))) then
            call propagate_two(self, piece, h, x)
         else
            call self%matrix_at(piece, 0, at_end)
            do i = 1, n_steps
               if (self%size > few_rows .or. modulo(i, between_checks) == 0) then
                  if (work_is_over()) return
               end if
               at_start = at_end
               call self%matrix_at(piece, 2*i - 1, at_middle)
               call self%matrix_at(piece, 2*i, at_end)
               call advance(self, h*half_step(at_start, at_middle, at_end), 0.5_wp*h, x, covariance)
               call advance(self, h*half_step(at_end, at_middle, at_start), 0.5_wp*h, x, covariance)
            end do
         end if
      end if
      if (self%n_states == 0) return
      call move_sliders(self, piece, x)
      if (.not. present(covariance)) return
      call move_sliders(self, piece, covariance)
      covariance = transpose(covariance)
      call move_sliders(self, piece, covariance)
   end subroutine propagate

   !> Advances by a time during which the equations, integrated over it, are constant.
   subroutine advance(self, a, time, x, covariance)
      type(variation_t), intent(in) :: self
      real(wp), intent(in) :: a(:, :)                                 !! integrated over the time
      real(wp), intent(in) :: time                                    !! [s]
      real(wp), intent(inout), contiguous :: x(:, :)
      real(wp), intent(inout), contiguous, optional :: covariance(:, :)
      real(wp), dimension(self%size, self%size) :: e, q

      if (present(covariance)) then
         call exponential_with_noise(a, time*self%noise, e, q)
         call turn_covariance(e, covariance)
         covariance = covariance + q
      else
         call exponential_of(a, e)
      end if
      call multiply_by(e, x)
   end subroutine advance

   !> Propagates over a piece with constant slopes of the laws, those of its middle, with one exponential.
   subroutine propagate_constant(self, piece, x, covariance)
      type(variation_t), intent(inout) :: self
      type(piece_t), intent(inout) :: piece
      real(wp), intent(inout), contiguous :: x(:, :)                  !! (size, any)
      real(wp), intent(inout), contiguous, optional :: covariance(:, :)
      real(wp) :: a(self%size, self%size)

      if (.not. allocated(piece%by_displacement)) then
         associate (n => self%n_coordinates)
            allocate (piece%by_displacement(n, n, 1), piece%by_rate(n, n, 1), piece%by_state(n, self%n_states, 1))
         end associate
         call self%find_slopes(piece, [0.5_wp*(piece%start + piece%finish)], piece%by_displacement, &
                               piece%by_rate, piece%by_state)
      end if
      call self%matrix_at(piece, 1, a)
      associate (length => piece%finish - piece%start)
         call advance(self, length*a, length, x, covariance)
      end associate
   end subroutine propagate_constant

   !> Steps of a single degree of freedom, without forming a matrix.
   subroutine propagate_two(self, piece, h, x)
      type(variation_t), intent(in) :: self
      type(piece_t), intent(in) :: piece
      real(wp), intent(in) :: h
      real(wp), intent(inout) :: x(:, :)                              !! (2, any)
      real(wp) :: damping(0:ubound(piece%by_displacement, 3)), e(2, 2), stiffness(0:ubound(piece%by_displacement, 3))
      integer :: c, d, i

      stiffness = h*self%constant(2, 1)
      damping = h*self%constant(2, 2)
      do d = 1, self%n_coordinates
         do c = 1, self%n_coordinates
            stiffness = stiffness - (h/self%scale*self%accelerance(1, c)*self%shape(1, d))*piece%by_displacement(c, d, :)
            damping = damping - (h*self%accelerance(1, c)*self%shape(1, d))*piece%by_rate(c, d, :)
         end do
      end do
      do i = 0, ubound(stiffness, 1) - 2, 2
         call exponential_of_two(0.0_wp, 0.5_wp*h*self%scale, half_step(stiffness(i), stiffness(i + 1), stiffness(i + 2)), &
                                 half_step(damping(i), damping(i + 1), damping(i + 2)), e)
         call turn()
         call exponential_of_two(0.0_wp, 0.5_wp*h*self%scale, half_step(stiffness(i + 2), stiffness(i + 1), stiffness(i)), &
                                 half_step(damping(i + 2), damping(i + 1), damping(i)), e)
         call turn()
      end do

   contains

      !> x = e x, for which `matmul` would allocate memory.
      subroutine turn()
         integer :: j

         do j = 1, size(x, 2)
            x(:, j) = [e(1, 1)*x(1, j) + e(1, 2)*x(2, j), e(2, 1)*x(1, j) + e(2, 2)*x(2, j)]
         end do
      end subroutine turn
   end subroutine propagate_two

   !> Computes the slopes at the ends and in the middle of each step, reusing those of half as many steps. At events a
   !> piece is evaluated from inside.
   subroutine evaluate_steps(self, piece, n_steps)
      type(variation_t), intent(inout) :: self
      type(piece_t), intent(inout) :: piece
      integer, intent(in) :: n_steps
      real(wp), allocatable :: by_displacement(:, :, :), by_rate(:, :, :), by_state(:, :, :)
      real(wp) :: times(0:2*n_steps)
      integer :: i, known

      known = -1
      if (allocated(piece%by_displacement)) known = ubound(piece%by_displacement, 3)
      if (known == 2*n_steps) return
      associate (length => piece%finish - piece%start)
         times = piece%start + length*[(real(i, wp)/(2*n_steps), i=0, 2*n_steps)]
         if (piece%is_after_event) times(0) = piece%start + rounding_level*length
         if (piece%is_before_event) times(2*n_steps) = piece%finish - rounding_level*length
      end associate
      associate (n => self%n_coordinates)
         allocate (by_displacement(n, n, 0:2*n_steps), by_rate(n, n, 0:2*n_steps), by_state(n, self%n_states, 0:2*n_steps))
      end associate
      if (known == n_steps) then
         by_displacement(:, :, ::2) = piece%by_displacement
         by_rate(:, :, ::2) = piece%by_rate
         by_state(:, :, ::2) = piece%by_state
         call self%find_slopes(piece, times(1::2), by_displacement(:, :, 1::2), by_rate(:, :, 1::2), &
                          by_state(:, :, 1::2))
      else
         call self%find_slopes(piece, times, by_displacement, by_rate, by_state)
      end if
      call move_alloc(by_displacement, piece%by_displacement)
      call move_alloc(by_rate, piece%by_rate)
      call move_alloc(by_state, piece%by_state)
   end subroutine evaluate_steps

   !> Moves sliders that have slipped at the end of a piece to their bounds.
   subroutine move_sliders(self, piece, x)
      type(variation_t), intent(in) :: self
      type(piece_t), intent(in) :: piece
      real(wp), intent(inout) :: x(:, :)
      real(wp) :: v(1, self%n_coordinates), z(1, self%n_coordinates)
      real(wp), allocatable :: slopes(:, :)
      integer :: i, k

      if (all(piece%slip == 0)) return
      call self%find_motion([piece%finish], z, v)
      do i = 1, size(self%laws)
         associate (span => self%spans(i))
            if (span%last_state < span%first_state) cycle
            associate (slip => piece%slip(span%first_state:span%last_state))
               if (all(slip == 0)) cycle
               select type (law => self%laws(i)%law)
               class is (hysteretic_law_t)
                  allocate (slopes(size(slip), span%last - span%first + 1))
                  call self%find_bound_slopes(law, span, z(1, span%first:span%last), v(1, span%first:span%last), slip, slopes)
                  do k = 1, size(slip)
                     if (slip(k) == 0) cycle
                     x(2*self%n_dofs + span%first_state + k - 1, :) = &
                        matmul(matmul(self%shape(:, span%first:span%last), slopes(k, :)), x(:self%n_dofs, :))/ &
                        self%slider_unit(span%first_state + k - 1)
                  end do
                  deallocate (slopes)
               end select
            end associate
         end associate
      end do
   end subroutine move_sliders
end module hb_piece_propagation
