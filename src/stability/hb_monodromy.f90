!> The map of disturbances of a motion over an interval of time by the linearised equations; over a period, the
!> monodromy matrix.
!>
!> Computed with a number of steps, with twice as many and so on, and extrapolated: the error of a symmetric method is
!> a series in even powers of the step. Source: E. Hairer, S. P. Norsett and G. Wanner, Solving Ordinary Differential
!> Equations I, 2nd edition, Springer 1993, section II.9.
!>
!> Integration of disturbances over a piece of time without events.
!>
!> Method: commutator-free Magnus integrator of fourth order, exact for any stiffness of the constant part, with the
!> moments of A in a step by Simpson's rule. Source: S. Blanes and P. C. Moan, Applied Numerical Mathematics 56 (2006)
!> 1519-1537.
module hb_monodromy
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_cancellation, only: work_is_over
   use hb_hysteretic_law, only: hysteretic_law_t
   use hb_kinds, only: two_pi, wp
   use hb_matrix_exponential, only: exponential_of, exponential_of_two, multiply_by
   use hb_thresholds, only: agreement, minor, rounding
   use hb_variation, only: piece_t, variation_t
   use hb_variation_pieces, only: cut_time, make_sliders_periodic
   implicit none
   private
   public :: find_monodromy, find_transfer, min_instants, monodromy_t, n_instants_of, work_of_monodromy, work_of_transfer

   integer, parameter :: min_steps = 8
   integer, parameter :: instants_per_harmonic = 8 ! detection times for events in a period of the highest harmonic
   integer, parameter :: min_instants = 128                        !! in a period
   integer, parameter :: max_doublings = 12
   integer, parameter :: few_rows = 16, between_checks = 16           ! steps of few rows take less than a check of the budget

   type :: matrix_t
      real(wp), allocatable :: entries(:, :)
   end type matrix_t

   type :: monodromy_t
      real(wp), allocatable :: matrix(:, :)                           !! of (q, v/scale, positions of sliders that slip at times)
      real(wp) :: estimate = huge(1.0_wp)                             !! of its error, relative to its largest entry or 1
      integer :: n_steps = 0                                          !! of the last iteration
      real(wp) :: work = 0.0_wp                                       !! of events and all iterations, in about a nanosecond
   end type monodromy_t

contains

   !> Computes the monodromy matrix of a periodic motion from a given time; sliders that never slip are omitted.
   subroutine find_monodromy(self, variation, start, tolerance, max_work)
      type(monodromy_t), intent(out) :: self
      type(variation_t), intent(inout) :: variation
      real(wp), intent(in) :: start                                   !! [s]
      real(wp), intent(in) :: tolerance
      real(wp), intent(in) :: max_work                              !! in about a nanosecond

      associate (finish => start + two_pi/variation%motion%omega(1))
         call make_sliders_periodic(variation, start, finish, n_instants_of(variation, finish - start))
         call find_transfer(self, variation, start, finish, tolerance, max_work)
      end associate
      if (variation%n_states > 0) call drop_stuck(self, variation)
   end subroutine find_monodromy

   !> Computes the map of disturbances over an interval of time; doubles the steps until the estimate is below the
   !> tolerance, no longer falls fast, or the work exceeds its limit.
   subroutine find_transfer(self, variation, start, finish, tolerance, max_work)
      type(monodromy_t), intent(out) :: self
      type(variation_t), intent(inout) :: variation
      real(wp), intent(in) :: start, finish                           !! [s]
      real(wp), intent(in) :: tolerance
      real(wp), intent(in) :: max_work                              !! in about a nanosecond
      type(piece_t), allocatable :: pieces(:)
      type(matrix_t) :: row(0:max_doublings)                         ! of the table of extrapolations
      real(wp), allocatable :: before(:, :), last(:, :)
      real(wp) :: estimate_before
      integer :: doubling, k

      call cut_time(variation, start, finish, n_instants_of(variation, finish - start), pieces)
      self%work = work_of_cuts(variation, finish - start, size(pieces) - 1)
      if (variation%is_piecewise_linear()) then
         call integrate_round(variation, pieces, finish - start, 1, self%matrix, self%n_steps)
         self%work = self%work + self%n_steps*variation%work_of_step((finish - start)/max(1, self%n_steps))
         if (.not. work_is_over()) self%estimate = rounding_of(variation, pieces)
         return
      end if
      do doubling = 0, max_doublings
         call integrate_round(variation, pieces, (finish - start)/first_steps(variation, finish - start), 2**doubling, last, &
                              self%n_steps)
         do k = 1, doubling                                           ! the remaining error is of order h**(2k + 2)
            before = last
            last = last + (last - row(k - 1)%entries)/(2.0_wp**(2*k + 2) - 1.0_wp)
            call move_alloc(before, row(k - 1)%entries)
         end do
         row(doubling)%entries = last
         if (.not. all(ieee_is_finite(last))) exit
         if (work_is_over()) then
            self%estimate = huge(1.0_wp)
            exit
         end if
         self%work = self%work + &
                     self%n_steps*(variation%work_of_step((finish - start)/self%n_steps) + variation%work_of_node())
         if (doubling == 0) cycle
         estimate_before = self%estimate
         self%estimate = maxval(abs(last - row(max(doubling, 1) - 1)%entries))/max(1.0_wp, maxval(abs(last)))
         if (self%estimate <= tolerance .or. 2.0_wp*self%work > max_work) exit
         if (self%estimate <= agreement .and. self%estimate > minor*estimate_before) exit
      end do
      call move_alloc(last, self%matrix)
   end subroutine find_transfer

   !> Approximate work of a typical monodromy matrix in nanoseconds; sliders are usually periodic after two periods.
   pure real(wp) function work_of_monodromy(variation) result(work)
      type(variation_t), intent(in) :: variation

      associate (length => two_pi/variation%motion%omega(1))
         work = work_of_transfer(variation, length)
         if (variation%n_states > 0) work = work + 2*work_of_cuts(variation, length, n_events_of(variation, length))
      end associate
   end function work_of_monodromy

   !> Approximate work of a typical interval of time in nanoseconds: after three doublings the error is of order
   !> h**10.
   pure real(wp) function work_of_transfer(variation, length) result(work)
      type(variation_t), intent(in) :: variation
      real(wp), intent(in) :: length                                  !! [s]
      integer :: doubling, n

      work = work_of_cuts(variation, length, n_events_of(variation, length))
      if (variation%is_piecewise_linear()) then
         n = 1 + n_events_of(variation, length)
         work = work + 0.5_wp*n*variation%work_of_step(2.0_wp*length/n)
         return
      end if
      do doubling = 0, 3
         n = first_steps(variation, length)*2**doubling
         work = work + n*variation%work_of_step(length/n)
      end do
      work = work + 2*n*variation%work_of_node()
   end function work_of_transfer

   !> Its part for the detection of events.
   pure real(wp) function work_of_cuts(variation, length, n_events) result(work)
      type(variation_t), intent(in) :: variation
      real(wp), intent(in) :: length                                  !! [s]
      integer, intent(in) :: n_events
      integer, parameter :: evaluations_per_event = 10

      work = 0.0_wp
      if (variation%is_smooth()) return
      work = evaluations_per_event*n_events*variation%work_of_node()
      work = work + n_instants_of(variation, length)*variation%work_of_node()
   end function work_of_cuts

   !> Typical number of events: two for each switch, four for each slider in a period of the fastest tone.
   pure integer function n_events_of(variation, length)
      type(variation_t), intent(in) :: variation
      real(wp), intent(in) :: length                                  !! [s]

      n_events_of = nint(maxval(variation%motion%omega)*length/two_pi)*2*(variation%n_switches() + variation%n_states)
   end function n_events_of

   !> Relative effect of rounding in the matrices of constant pieces on their exponentials.
   real(wp) function rounding_of(variation, pieces) result(estimate)
      type(variation_t), intent(in) :: variation
      type(piece_t), intent(in) :: pieces(:)
      real(wp) :: a(variation%size, variation%size)
      integer :: i

      estimate = 0.0_wp
      do i = 1, size(pieces)
         if (.not. allocated(pieces(i)%by_displacement)) cycle        ! without any length
         call variation%matrix_at(pieces(i), 1, a)
         estimate = estimate + epsilon(1.0_wp)*(pieces(i)%finish - pieces(i)%start)*maxval(sum(abs(a), dim=1))
      end do
   end function rounding_of

   !> Number of detection times for events, from the harmonics that carry the motion.
   pure integer function n_instants_of(variation, length)
      type(variation_t), intent(in) :: variation
      real(wp), intent(in) :: length                                  !! [s]

      n_instants_of = max(min_instants, instants_per_harmonic*(nint(variation%detection_frequency*length/two_pi) + 1))
   end function n_instants_of

   !> One step per period of the highest harmonic, plus one.
   pure integer function first_steps(variation, length)
      type(variation_t), intent(in) :: variation
      real(wp), intent(in) :: length                                  !! [s]

      associate (n_periods => maxval(abs(variation%motion%frequencies))*length/two_pi)
         first_steps = max(min_steps, nint(n_periods) + 1)
      end associate
   end function first_steps

   !> Propagates over all pieces, in steps of about the same length, each divided into `n_parts`.
   subroutine integrate_round(variation, pieces, step, n_parts, x, n_steps)
      type(variation_t), intent(inout) :: variation
      type(piece_t), intent(inout) :: pieces(:)
      real(wp), intent(in) :: step                                    !! [s]
      integer, intent(in) :: n_parts
      real(wp), allocatable, intent(out) :: x(:, :)
      integer, intent(out) :: n_steps
      integer :: i, n

      allocate (x(variation%size, variation%size), source=0.0_wp)
      do i = 1, variation%size
         x(i, i) = 1.0_wp
      end do
      n_steps = 0
      do i = 1, size(pieces)
         n = n_parts*max(1, ceiling((pieces(i)%finish - pieces(i)%start)/step*(1.0_wp - 1.0e-9_wp)))
         call propagate(variation, pieces(i), n, x)
         if (work_is_over()) return
         n_steps = n_steps + n
      end do
   end subroutine integrate_round

   !> Integral over half a step, relative to the step, from the values at its near end, its middle and its far end.
   elemental real(wp) function half_step(near, middle, far)
      real(wp), intent(in) :: near, middle, far

      half_step = 0.25_wp*near + 1.0_wp/3.0_wp*middle - 1.0_wp/12.0_wp*far
   end function half_step

   !> Omits sliders that always stick: a change of them is permanent, and does not affect the stability of anything
   !> else.
   subroutine drop_stuck(self, variation)
      type(monodromy_t), intent(inout) :: self
      type(variation_t), intent(in) :: variation
      integer, allocatable :: retained(:)
      integer :: i

      allocate (retained, source=[[(i, i=1, 2*variation%n_dofs)], &
                                  pack([(2*variation%n_dofs + i, i=1, variation%n_states)], variation%has_slipped)])
      self%matrix = self%matrix(retained, retained)
   end subroutine drop_stuck

   !> Propagates changes of the state from the start to the end of a piece in steps of equal length.
   subroutine propagate(self, piece, n_steps, x)
      type(variation_t), intent(inout) :: self
      type(piece_t), intent(inout) :: piece
      integer, intent(in) :: n_steps
      real(wp), intent(inout), contiguous :: x(:, :)                  !! (size, any)
      real(wp), dimension(self%size, self%size) :: a, at_end, at_middle, at_start, e
      real(wp) :: h
      integer :: i

      h = (piece%finish - piece%start)/n_steps
      if (h > 0.0_wp .and. self%is_piecewise_linear()) then
         call propagate_constant(self, piece, x)
      else if (h > 0.0_wp) then
         call evaluate_steps(self, piece, n_steps)
         if (self%size == 2 .and. .not. allocated(self%massless)) then
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
               a = h*half_step(at_start, at_middle, at_end)
               call exponential_of(a, e)
               call multiply_by(e, x)
               a = h*half_step(at_end, at_middle, at_start)
               call exponential_of(a, e)
               call multiply_by(e, x)
            end do
         end if
      end if
      if (self%n_states > 0) call move_sliders(self, piece, x)
   end subroutine propagate

   !> Propagates over a piece with constant slopes of the laws, those of its middle, with one exponential.
   subroutine propagate_constant(self, piece, x)
      type(variation_t), intent(inout) :: self
      type(piece_t), intent(inout) :: piece
      real(wp), intent(inout), contiguous :: x(:, :)                  !! (size, any)
      real(wp), dimension(self%size, self%size) :: a, e

      if (.not. allocated(piece%by_displacement)) then
         associate (n => self%n_coordinates)
            allocate (piece%by_displacement(n, n, 1), piece%by_rate(n, n, 1), piece%by_state(n, self%n_states, 1))
         end associate
         call self%find_slopes(piece, [0.5_wp*(piece%start + piece%finish)], piece%by_displacement, &
                               piece%by_rate, piece%by_state)
      end if
      call self%matrix_at(piece, 1, a)
      call exponential_of((piece%finish - piece%start)*a, e)
      call multiply_by(e, x)
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
         if (piece%is_after_event) times(0) = piece%start + rounding*length
         if (piece%is_before_event) times(2*n_steps) = piece%finish - rounding*length
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
                        matmul(matmul(self%shape(:, span%first:span%last), slopes(k, :)), x(:self%n_dofs, :))
                  end do
                  deallocate (slopes)
               end select
            end associate
         end associate
      end do
   end subroutine move_sliders
end module hb_monodromy
