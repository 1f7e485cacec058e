!> The map of disturbances of a motion over an interval of time by the linearised equations; over a period, the
!> monodromy matrix.
!>
!> Computed with a number of steps, with twice as many and so on, and extrapolated: the error of a symmetric method is
!> a series in even powers of the step. Source: E. Hairer, S. P. Norsett and G. Wanner, Solving Ordinary Differential
!> Equations I, 2nd edition, Springer 1993, section II.9.
module hb_monodromy
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_cancellation, only: work_is_over
   use hb_kinds, only: two_pi, wp
   use hb_piece_propagation, only: propagate
   use hb_thresholds, only: equality_tolerance, small_share
   use hb_variation, only: piece_t, variation_t
   use hb_variation_pieces, only: cut_time, make_sliders_periodic
   implicit none
   private
   public :: find_monodromy, find_transfer, find_transfer_over, min_instants, monodromy_t, n_instants_of, work_of_monodromy, &
      work_of_transfer

   integer, parameter :: min_steps = 8
   integer, parameter :: instants_per_harmonic = 8 ! detection times for events in a period of the highest harmonic
   integer, parameter :: min_instants = 128                        !! in a period
   integer, parameter :: max_doublings = 12

   type :: matrix_t
      real(wp), allocatable :: entries(:, :)
   end type matrix_t

   type :: monodromy_t
      real(wp), allocatable :: matrix(:, :)                           !! of (q, v/scale, positions of sliders that slip at times)
      real(wp), allocatable :: covariance(:, :)                       !! of the noise in the variation since the start, if any
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

   !> Computes the map of disturbances over an interval of time.
   subroutine find_transfer(self, variation, start, finish, tolerance, max_work)
      type(monodromy_t), intent(out) :: self
      type(variation_t), intent(inout) :: variation
      real(wp), intent(in) :: start, finish                           !! [s]
      real(wp), intent(in) :: tolerance
      real(wp), intent(in) :: max_work                              !! in about a nanosecond
      type(piece_t), allocatable :: pieces(:)

      call cut_time(variation, start, finish, n_instants_of(variation, finish - start), pieces)
      associate (cuts => work_of_cuts(variation, finish - start, size(pieces) - 1))
         call find_transfer_over(self, variation, pieces, min_steps, tolerance, max_work - 2.0_wp*cuts)
         self%work = self%work + cuts
      end associate
   end subroutine find_transfer

   !> Computes the map of disturbances over an interval of time that has been cut, and the covariance of the noise that begins with
   !> it, if there is one; doubles the steps until the estimate is below the tolerance, no longer falls fast, or the work exceeds
   !> its limit.
   subroutine find_transfer_over(self, variation, pieces, fewest_steps, tolerance, max_work)
      type(monodromy_t), intent(out) :: self
      type(variation_t), intent(inout) :: variation
      type(piece_t), intent(inout) :: pieces(:)
      integer, intent(in) :: fewest_steps                             !! to begin with
      real(wp), intent(in) :: tolerance
      real(wp), intent(in) :: max_work                              !! in about a nanosecond
      type(matrix_t) :: row(0:max_doublings)                         ! of the table of extrapolations
      real(wp), allocatable :: before(:, :), last(:, :)
      real(wp) :: estimate_before, length
      integer :: doubling, k

      length = pieces(size(pieces))%finish - pieces(1)%start
      if (variation%is_piecewise_linear()) then
         call integrate_round(variation, pieces, length, 1, last, self%n_steps)
         self%work = self%n_steps*variation%work_of_step(length/max(1, self%n_steps))
         if (.not. work_is_over()) self%estimate = rounding_of(variation, pieces)
         call store(self, last)
         return
      end if
      do doubling = 0, max_doublings
         call integrate_round(variation, pieces, length/first_steps(variation, length, fewest_steps), 2**doubling, last, &
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
                     self%n_steps*(variation%work_of_step(length/self%n_steps) + variation%work_of_node())
         if (doubling == 0) cycle
         estimate_before = self%estimate
         self%estimate = maxval(abs(last - row(max(doubling, 1) - 1)%entries))/max(1.0_wp, maxval(abs(last)))
         if (self%estimate <= tolerance .or. 2.0_wp*self%work > max_work) exit
         if (self%estimate <= equality_tolerance .and. self%estimate > small_share*estimate_before) exit
      end do
      call store(self, last)
   end subroutine find_transfer_over

   !> Stores the map and, after it, the covariance.
   subroutine store(self, last)
      type(monodromy_t), intent(inout) :: self
      real(wp), allocatable, intent(inout) :: last(:, :)              !! (n, n) or (n, 2 n)

      associate (n => size(last, 1))
         if (size(last, 2) > n) then
            self%matrix = last(:, :n)
            self%covariance = last(:, n + 1:)
         else
            call move_alloc(last, self%matrix)
         end if
      end associate
   end subroutine store

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
         n = first_steps(variation, length, min_steps)*2**doubling
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
   pure integer function first_steps(variation, length, fewest)
      type(variation_t), intent(in) :: variation
      real(wp), intent(in) :: length                                  !! [s]
      integer, intent(in) :: fewest

      associate (n_periods => maxval(abs(variation%motion%frequencies))*length/two_pi)
         first_steps = max(fewest, nint(n_periods) + 1)
      end associate
   end function first_steps

   !> Propagates over all pieces, in steps of about the same length, each divided into `n_parts`; the map, and after it the
   !> covariance of the noise, if there is one.
   subroutine integrate_round(variation, pieces, step, n_parts, x, n_steps)
      type(variation_t), intent(inout) :: variation
      type(piece_t), intent(inout) :: pieces(:)
      real(wp), intent(in) :: step                                    !! [s]
      integer, intent(in) :: n_parts
      real(wp), allocatable, intent(out) :: x(:, :)
      integer, intent(out) :: n_steps
      integer :: i, n

      associate (m => variation%size)
         allocate (x(m, merge(2*m, m, allocated(variation%noise))), source=0.0_wp)
      end associate
      do i = 1, variation%size
         x(i, i) = 1.0_wp
      end do
      n_steps = 0
      do i = 1, size(pieces)
         n = n_parts*max(1, ceiling((pieces(i)%finish - pieces(i)%start)/step*(1.0_wp - 1.0e-9_wp)))
         if (allocated(variation%noise)) then
            call propagate(variation, pieces(i), n, x(:, :variation%size), x(:, variation%size + 1:))
         else
            call propagate(variation, pieces(i), n, x)
         end if
         if (work_is_over()) return
         n_steps = n_steps + n
      end do
   end subroutine integrate_round

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
end module hb_monodromy
