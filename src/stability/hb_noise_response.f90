!> The covariance of a motion under small white noise, and the diffusion of the phase of a limit cycle.
!>
!> The linearised equations dx = A x dt + G dw have the covariance P' = A P + P A^T + G G^T, which becomes periodic where
!> disturbances decay: P = Phi P Phi^T + Q over a period, with the map Phi of disturbances and the covariance Q of the noise of one
!> period. An unknown tone leaves the phase free: with the shift u by a unit of phase and the left vector v of the multiplier 1,
!> v.u = 1, the variance of the phase grows by v^T Q v in a period, and the rest is the covariance at the phase of the motion. Under
!> several tones P is followed over a record, after noise from its start has been forgotten.
!> Source: docs/why/theory.md, section 8.
module hb_noise_response
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite, ieee_quiet_nan, ieee_value
   use hb_cancellation, only: work_is_over
   use hb_exponents, only: periods_of_beats
   use hb_kinds, only: two_pi, wp
   use hb_lapack, only: dgetrf, dgetrs, dpotrs
   use hb_matrix_exponential, only: multiply_by, turn_covariance, work_of_product
   use hb_monodromy, only: find_transfer_over, monodromy_t, n_instants_of
   use hb_stability, only: change_of_variances, few_periods, noise_response_t, noise_status, stability_config_t
   use hb_structure, only: structure_t
   use hb_variation, only: piece_t, variation_t
   use hb_variation_pieces, only: cut_time, make_sliders_periodic
   implicit none
   private
   public :: find_noise_response

   integer, parameter :: min_intervals = 64, max_intervals = 1024     ! of a period, even
   integer, parameter :: intervals_per_harmonic = 16                  ! of the highest one that carries the motion
   real(wp), parameter :: max_change = 1.0e-3_wp                      ! of variances by half of the intervals, relative
   integer, parameter :: max_doublings = 60                           ! of periods
   real(wp), parameter :: products_per_interval = 300.0_wp            ! of matrices, measured
   integer, parameter :: instants_per_turn = 32, max_instants = 16384 ! of a spectrum: of the fastest oscillation, in a period
   real(wp), parameter :: max_work_of_spectrum = 6.0e10_wp            ! in about a nanosecond
   real(wp), parameter :: max_estimate = 0.5_wp                       ! relative error beyond which nothing is known
   real(wp), parameter :: forgotten = 1.0e-4_wp                       ! relative error of a covariance that has begun at zero

contains

   !> Finds the response of a stable periodic motion; its status says why it is not known.
   subroutine find_noise_response(self, variation, structure, forces, shift, slowest_decay, config, max_work)
      type(noise_response_t), intent(out) :: self
      type(variation_t), intent(inout) :: variation
      type(structure_t), intent(in) :: structure                      !! of the variation
      real(wp), intent(in) :: forces(:, :)                            !! of independent noises of density 1, (n_dofs, n_sources)
      real(wp), intent(in) :: shift(:)                                !! state by the phase of an unknown tone, (2 n_dofs); none
      real(wp), intent(in) :: slowest_decay                           !! of a disturbance [1/s], > 0
      type(stability_config_t), intent(in) :: config
      real(wp), intent(in) :: max_work                                !! in about a nanosecond
      real(wp) :: period, unit
      integer :: n_before, n_record                                   ! periods

      n_before = 0
      n_record = 1
      period = two_pi/minval(abs(variation%motion%omega))
      if (has_torus(variation)) then
         n_before = ceiling(min(-log(forgotten)/(2.0_wp*slowest_decay*period), 0.5_wp*huge(1)))
         n_record = max(2*few_periods, periods_of_beats(variation%motion%tuples, variation%motion%omega, &
                                                       variation%motion%amplitudes))
      end if
      self%status = noise_status%too_costly
      if (real(n_before + n_record, wp)*n_intervals_of(variation, period)*products_per_interval*work_of_product(variation%size) > &
          max_work) return
      call set_noise(variation, structure, forces, period, unit)
      self%status = noise_status%infinite
      if (.not. ieee_is_finite(unit)) return
      self%status = noise_status%inaccurate
      if (has_torus(variation)) then
         call follow_torus(self, variation, period, [n_before, n_record], config%tolerance, unit)
      else
         call follow_orbit(self, variation, shift, slowest_decay, config%tolerance, unit, max_work)
         if (config%noise_frequency >= 0.0_wp .and. size(shift) == 0 .and. allocated(self%variance)) &
            call find_spectrum(self, variation, config, period, unit)
      end if
      deallocate (variation%noise)
      if (.not. allocated(self%variance)) call self%fail(noise_status%inaccurate)
      if (.not. allocated(self%variance)) return
      call forget_static(self, variation)
      self%status = noise_status%known
      if (.not. self%estimate <= max_estimate) call self%fail(noise_status%inaccurate)
   end subroutine find_noise_response

   !> Whether the equations along the motion depend on several tones.
   pure logical function has_torus(variation) result(has)
      type(variation_t), intent(in) :: variation

      has = size(variation%motion%omega) > 1 .and. variation%n_coordinates > 0
   end function has_torus

   !> Finds the periodic covariance, and follows it over a period, at twice as many instants until this changes little; no variance
   !> if this fails.
   subroutine follow_orbit(self, variation, shift, slowest_decay, tolerance, unit, max_work)
      type(noise_response_t), intent(inout) :: self
      type(variation_t), intent(inout) :: variation
      real(wp), intent(in) :: shift(:), slowest_decay, tolerance, max_work
      real(wp), intent(in) :: unit                                    !! of the noise
      type(monodromy_t), allocatable :: parts(:)
      type(monodromy_t) :: whole
      real(wp), allocatable :: left(:), p(:, :)
      real(wp) :: period
      integer, allocatable :: retained(:)
      integer :: n

      period = two_pi/minval(abs(variation%motion%omega))
      n = n_intervals_of(variation, period)
      do
         call find_parts(variation, period, tolerance, n, parts)
         if (size(parts) == 0) return
         call compose(parts, whole)
         if (.not. (all(ieee_is_finite(whole%matrix)) .and. all(ieee_is_finite(whole%covariance)))) return
         if (allocated(self%variance)) deallocate (self%variance, self%peak, self%least, self%phase_diffusion)
         call find_retained(variation, retained)
         allocate (self%phase_diffusion(size(variation%motion%omega)), source=0.0_wp)
         if (size(shift) > 0) then
            call separate_phase(whole, shift, retained, left, self%phase_diffusion(1))
            self%phase_diffusion = unit/period*self%phase_diffusion
         end if
         call find_periodic_covariance(whole, retained, p)
         if (.not. allocated(p)) return
         call follow_period(self, parts, p, shift, left, unit, variation%n_dofs)
         if (self%estimate <= max_change .or. 2*n > max_intervals .or. n == 1) exit
         n = 2*n
         if (n*products_per_interval*work_of_product(variation%size) > max_work) exit
      end do
      self%estimate = max(self%estimate, 2.0_wp*whole%estimate/(1.0_wp - exp(-2.0_wp*slowest_decay*period)))
   end subroutine follow_orbit

   !> The states without the sliders that never slip, which noise does not move.
   pure subroutine find_retained(variation, retained)
      type(variation_t), intent(in) :: variation
      integer, allocatable, intent(out) :: retained(:)
      integer :: i

      retained = [(i, i=1, 2*variation%n_dofs), pack([(2*variation%n_dofs + i, i=1, variation%n_states)], variation%has_slipped)]
   end subroutine find_retained

   !> Sums the noise of all periods before, twice as many by each doubling; not allocated if the sum has no limit.
   subroutine find_periodic_covariance(whole, retained, p)
      type(monodromy_t), intent(in) :: whole
      integer, intent(in) :: retained(:)
      real(wp), allocatable, intent(out) :: p(:, :)
      real(wp), dimension(size(retained), size(retained)) :: f, more, total, twice
      integer :: k

      f = whole%matrix(retained, retained)
      total = whole%covariance(retained, retained)
      do k = 1, max_doublings
         more = total
         call turn_covariance(f, more)
         if (.not. all(ieee_is_finite(more)) .or. work_is_over()) return
         total = total + more
         if (maxval(abs(more)) <= epsilon(1.0_wp)*maxval(abs(total))) exit
         twice = f
         call multiply_by(f, twice)
         f = twice
      end do
      if (k > max_doublings) return
      allocate (p, mold=whole%covariance)
      p = 0.0_wp
      p(retained, retained) = total
   end subroutine find_periodic_covariance

   !> Spectral densities at a frequency: the transform of the covariance of displacements at a time and at a later one, mean over
   !> all times of a period, as a sum over instants, whose error is the density at multiples of their frequency.
   subroutine find_spectrum(self, variation, config, period, unit)
      type(noise_response_t), intent(inout) :: self
      type(variation_t), intent(inout) :: variation
      type(stability_config_t), intent(in) :: config
      real(wp), intent(in) :: period                                  !! [s]
      real(wp), intent(in) :: unit                                    !! of the noise
      type(monodromy_t), allocatable :: parts(:)
      type(monodromy_t) :: whole
      real(wp), allocatable :: p(:, :)
      complex(wp), dimension(variation%size, variation%size) :: f, more, y
      complex(wp) :: turn
      integer, allocatable :: retained(:)
      integer :: i, k, n, round

      associate (fastest => max(config%noise_frequency, variation%scale, maxval(abs(variation%motion%frequencies))))
         n = instants_per_turn*ceiling(min(fastest*period/two_pi, real(max_instants, wp)))
      end associate
      if (n > max_instants .or. n*products_per_interval*work_of_product(variation%size) > max_work_of_spectrum) return
      call find_parts(variation, period, config%tolerance, n, parts)
      if (size(parts) == 0) return
      call compose(parts, whole)
      call find_retained(variation, retained)
      call find_periodic_covariance(whole, retained, p)
      if (.not. allocated(p)) return
      turn = exp(cmplx(0.0_wp, -config%noise_frequency*period/n, wp))
      allocate (self%spectrum(variation%n_dofs), source=0.0_wp)
      y = 0.0_wp
      do round = 1, 2                                                 ! from zero for what a period adds; then of all periods before
         do k = 1, n
            call turn_covariance(parts(k)%matrix, p)
            p = p + parts(k)%covariance
            y = p + turn*matmul(parts(k)%matrix, y)
            if (round == 1) cycle
            do i = 1, variation%n_dofs
               self%spectrum(i) = self%spectrum(i) + 2.0_wp*real(y(i, i)) - p(i, i)
            end do
         end do
         if (round == 2) exit
         f = turn**n*whole%matrix
         do k = 1, max_doublings
            more = matmul(f, y)
            y = y + more
            if (maxval(abs(more)) <= epsilon(1.0_wp)*maxval(abs(y))) exit
            f = matmul(f, f)
         end do
      end do
      self%spectrum = 2.0_wp*unit*period/real(n, wp)**2*self%spectrum
   end subroutine find_spectrum

   !> Follows the covariance along a motion of several tones from its start at zero; no variance if this fails. The estimate is the
   !> difference of both halves of the record.
   subroutine follow_torus(self, variation, length, n_periods, tolerance, unit)
      type(noise_response_t), intent(inout) :: self
      type(variation_t), intent(inout) :: variation
      real(wp), intent(in) :: length                                  !! of a period [s]
      integer, intent(in) :: n_periods(2)                             !! before the record, and of the record
      real(wp), intent(in) :: tolerance                               !! of each map
      real(wp), intent(in) :: unit                                    !! of the noise
      type(monodromy_t), allocatable :: parts(:)
      type(noise_response_t) :: halves(2)
      real(wp), allocatable :: p(:, :), variances(:, :)
      integer :: i, k, n, period

      n = n_intervals_of(variation, length)
      allocate (p(variation%size, variation%size), source=0.0_wp)
      allocate (variances(variation%n_dofs, n*n_periods(2)))
      do period = -n_periods(1), n_periods(2) - 1
         call find_parts(variation, length, tolerance, n, parts, start=period*length)
         if (size(parts) == 0) return
         do k = 1, n
            call turn_covariance(parts(k)%matrix, p)
            p = p + parts(k)%covariance
            if (period >= 0) variances(:, period*n + k) = [(unit*p(i, i), i=1, variation%n_dofs)]
         end do
      end do
      if (.not. all(ieee_is_finite(p))) return
      allocate (self%phase_diffusion(size(variation%motion%omega)), source=0.0_wp)
      call summarise(variances, self)
      associate (half => size(variances, 2)/2)
         call summarise(variances(:, :half), halves(1))
         call summarise(variances(:, half + 1:), halves(2))
      end associate
      self%estimate = max(forgotten, change_of_variances(halves(1), halves(2)))
   end subroutine follow_torus

   !> Intervals of a period at whose ends the covariance is evaluated; one where it is constant.
   pure integer function n_intervals_of(variation, period) result(n)
      type(variation_t), intent(in) :: variation
      real(wp), intent(in) :: period                                  !! [s]

      n = 1
      if (variation%n_coordinates == 0) return
      n = intervals_per_harmonic*nint(min(variation%detection_frequency*period/two_pi, real(max_intervals, wp)))
      n = max(min_intervals, min(n, max_intervals))
   end function n_intervals_of

   !> Stores the density of the noise in the state, divided by a unit in which a period of it is of order 1; the unit is not finite
   !> if the noise moves a coordinate at an infinite rate.
   subroutine set_noise(variation, structure, forces, period, unit)
      type(variation_t), intent(inout) :: variation
      type(structure_t), intent(in) :: structure
      real(wp), intent(in) :: forces(:, :)
      real(wp), intent(in) :: period                                  !! [s]
      real(wp), intent(out) :: unit
      real(wp) :: by_force(variation%size, size(forces, 2))           ! rates of the state
      real(wp), allocatable :: a(:, :), factor(:, :)
      integer :: info, n

      n = variation%n_dofs
      by_force = 0.0_wp
      if (allocated(variation%massless)) then
         associate (of => variation%massless, m => 2*n + size(forces, 2))
            allocate (a(m, m))
            call of%state_matrix(variation%scale, of%stiffness, of%damping, -forces, a)
            by_force(:2*n, :) = a(:2*n, 2*n + 1:)
            if (has_static_noise(variation, forces)) by_force = huge(1.0_wp)
         end associate
      else
         call structure%factorise_mass(factor, info)
         by_force(n + 1:2*n, :) = forces
         if (size(forces) > 0) call dpotrs("L", n, size(forces, 2), factor, n, by_force(n + 1:2*n, :), n, info)
         by_force = by_force/variation%scale
      end if
      variation%noise = matmul(by_force, transpose(by_force))
      unit = period*maxval([(variation%noise(n, n), n=1, variation%size)])
      if (unit > 0.0_wp) variation%noise = variation%noise/unit
   end subroutine set_noise

   !> Whether noise acts on a degree of freedom without mass that has no damping, or whose damping changes.
   pure logical function has_static_noise(variation, forces) result(has)
      type(variation_t), intent(in) :: variation
      real(wp), intent(in) :: forces(:, :)
      logical :: is_light(variation%n_dofs)
      integer :: i

      associate (n => variation%n_dofs, is_inert => variation%massless%is_inert)
         has = any(spread(is_inert(:n), 2, size(forces, 2)) .and. abs(forces) > 0.0_wp)
         is_light = is_inert(n + 1:) .and. .not. is_inert(:n)
         do i = 1, size(variation%laws)
            associate (law => variation%laws(i)%law)
               if (law%needs_velocity .and. any(abs(forces) > 0.0_wp)) has = has .or. any(is_light(law%dofs))
            end associate
         end do
      end associate
   end function has_static_noise

   !> The maps and covariances between the instants of a period; none if they are not found.
   subroutine find_parts(variation, period, tolerance, n, parts, start)
      type(variation_t), intent(inout) :: variation
      real(wp), intent(in) :: period                                  !! [s]
      real(wp), intent(in) :: tolerance
      integer, intent(in) :: n                                        !! parts
      type(monodromy_t), allocatable, intent(out) :: parts(:)
      real(wp), intent(in), optional :: start                         !! [s], where sliders continue; not present: 0, periodic ones
      type(piece_t), allocatable :: pieces(:), within(:)
      real(wp) :: begun
      integer :: k

      begun = 0.0_wp
      if (present(start)) begun = start
      if (.not. present(start)) call make_sliders_periodic(variation, begun, begun + period, n_instants_of(variation, period))
      call cut_time(variation, begun, begun + period, n_instants_of(variation, period), pieces)
      allocate (parts(n))
      do k = 1, size(parts)
         call cut_out(pieces, begun + period*(k - 1)/size(parts), begun + period*k/size(parts), within)
         call find_transfer_over(parts(k), variation, within, 1, tolerance, huge(1.0_wp))
         if (parts(k)%estimate >= huge(1.0_wp)) then                  ! cancelled, or not finite
            deallocate (parts)
            allocate (parts(0))
            return
         end if
      end do
   end subroutine find_parts

   !> The parts of pieces that lie within an interval.
   pure subroutine cut_out(pieces, start, finish, within)
      type(piece_t), intent(in) :: pieces(:)
      real(wp), intent(in) :: start, finish                           !! [s]
      type(piece_t), allocatable, intent(out) :: within(:)
      integer :: i

      within = pack(pieces, pieces%start < finish .and. pieces%finish > start)
      do i = 1, size(within)
         associate (piece => within(i))
            piece%is_after_event = piece%is_after_event .and. piece%start >= start
            piece%is_before_event = piece%is_before_event .and. piece%finish <= finish
            piece%start = max(piece%start, start)
            piece%finish = min(piece%finish, finish)
         end associate
      end do
   end subroutine cut_out

   !> Map and covariance of all parts one after the other.
   subroutine compose(parts, whole)
      type(monodromy_t), intent(in) :: parts(:)
      type(monodromy_t), intent(out) :: whole
      integer :: k

      whole = parts(1)
      do k = 2, size(parts)
         call multiply_by(parts(k)%matrix, whole%matrix)
         call turn_covariance(parts(k)%matrix, whole%covariance)
         whole%covariance = whole%covariance + parts(k)%covariance
         whole%estimate = whole%estimate + parts(k)%estimate
      end do
   end subroutine compose

   !> Removes the phase from map and covariance over a period, and finds its variance of a period.
   subroutine separate_phase(whole, shift, retained, left, variance)
      type(monodromy_t), intent(inout) :: whole
      real(wp), intent(in) :: shift(:)
      integer, intent(in) :: retained(:)
      real(wp), allocatable, intent(out) :: left(:)                   !! v, (size)
      real(wp), intent(out) :: variance                               !! [rad**2]
      real(wp) :: a(size(retained) + 1, size(retained) + 1), b(size(retained) + 1), u(size(whole%matrix, 1))
      integer :: i, info, n, pivots(size(retained) + 1)

      n = size(retained)
      u = 0.0_wp
      u(:size(shift)) = shift
      if (size(u) > size(shift)) u = matmul(whole%matrix, u)          ! sliders are included
      a = 0.0_wp
      a(:n, :n) = transpose(whole%matrix(retained, retained))
      do i = 1, n
         a(i, i) = a(i, i) - 1.0_wp
      end do
      a(n + 1, :n) = u(retained)
      a(:n, n + 1) = u(retained)
      b = 0.0_wp
      b(n + 1) = 1.0_wp
      allocate (left(size(u)), source=0.0_wp)
      call dgetrf(n + 1, n + 1, a, n + 1, pivots, info)
      if (info == 0) call dgetrs("N", n + 1, 1, a, n + 1, pivots, b, n + 1, info)
      if (info /= 0) b = ieee_value(1.0_wp, ieee_quiet_nan)
      left(retained) = b(:n)
      variance = dot_product(left, matmul(whole%covariance, left))
      associate (u_row => matmul(left, whole%matrix))
         do i = 1, size(u)
            whole%matrix(:, i) = whole%matrix(:, i) - u*u_row(i)
         end do
      end associate
      call remove_phase(whole%covariance, u, left)
   end subroutine separate_phase

   !> Covariance of a state without its component along u: (1 - u v^T) P (1 - v u^T).
   pure subroutine remove_phase(p, u, v)
      real(wp), intent(inout) :: p(:, :)
      real(wp), intent(in) :: u(:), v(:)                              !! v.u = 1
      real(wp) :: along(size(u))
      integer :: i

      along = matmul(p, v)
      do i = 1, size(u)
         p(:, i) = p(:, i) - u*along(i)
      end do
      along = matmul(v, transpose(p))                                 ! of what is left
      do i = 1, size(u)
         p(:, i) = p(:, i) - along*u(i)
      end do
   end subroutine remove_phase

   !> Follows the covariance over a period, for the mean and the largest variance of each degree of freedom. The estimate is their
   !> change by half of the instants.
   subroutine follow_period(self, parts, p, shift, left, unit, n_dofs)
      type(noise_response_t), intent(inout) :: self
      type(monodromy_t), intent(in) :: parts(:)
      real(wp), intent(inout) :: p(:, :)                              !! at the start
      real(wp), intent(in) :: shift(:)
      real(wp), allocatable, intent(in) :: left(:)                    !! of the phase at the start, if it is free
      real(wp), intent(in) :: unit
      integer, intent(in) :: n_dofs
      real(wp) :: u(size(p, 1)), v(size(p, 1), size(parts)), variances(n_dofs, size(parts))
      type(noise_response_t) :: coarse
      integer :: i, k

      if (size(shift) > 0) then
         v(:, size(parts)) = left
         do k = size(parts), 2, -1
            v(:, k - 1) = matmul(v(:, k), parts(k)%matrix)
         end do
         u = 0.0_wp
         u(:size(shift)) = shift
      end if
      do k = 1, size(parts)
         call turn_covariance(parts(k)%matrix, p)
         p = p + parts(k)%covariance
         if (size(shift) > 0) then
            u = matmul(parts(k)%matrix, u)
            u = u/dot_product(v(:, k), u)
            call remove_phase(p, u, v(:, k))
         end if
         variances(:, k) = [(unit*p(i, i), i=1, n_dofs)]
      end do
      call summarise(variances, self)
      self%estimate = 0.0_wp
      if (size(parts) == 1) return
      call summarise(variances(:, 2::2), coarse)
      self%estimate = change_of_variances(self, coarse)
   end subroutine follow_period

   !> Mean, largest and smallest variances from equidistant samples of a period, which repeat.
   pure subroutine summarise(samples, response)
      real(wp), intent(in) :: samples(:, :)                           !! (n_dofs, samples)
      type(noise_response_t), intent(inout) :: response
      integer :: i

      response%variance = sum(samples, dim=2)/size(samples, 2)
      response%peak = [(top_of(samples(i, :)), i=1, size(samples, 1))]
      response%least = [(max(-top_of(-samples(i, :)), 0.0_wp), i=1, size(samples, 1))]
   end subroutine summarise

   !> Largest value of a periodic function: of the parabola through the largest sample and its neighbours.
   pure real(wp) function top_of(samples) result(top)
      real(wp), intent(in) :: samples(:)
      real(wp) :: after, before, bend
      integer :: k

      associate (n => size(samples))
         k = maxloc(samples, dim=1)
         top = samples(k)
         before = samples(modulo(k - 2, n) + 1)
         after = samples(modulo(k, n) + 1)
      end associate
      bend = 2.0_wp*top - before - after
      if (bend > 0.0_wp) top = top + (after - before)**2/(8.0_wp*bend)
   end function top_of

   !> Coordinates with neither mass nor damping follow the others, and are no states: their variances are not found.
   subroutine forget_static(self, variation)
      type(noise_response_t), intent(inout) :: self
      type(variation_t), intent(in) :: variation

      if (.not. allocated(variation%massless)) return
      where (variation%massless%is_inert(:variation%n_dofs))
         self%variance = ieee_value(1.0_wp, ieee_quiet_nan)
         self%peak = ieee_value(1.0_wp, ieee_quiet_nan)
         self%least = ieee_value(1.0_wp, ieee_quiet_nan)
      end where
      if (.not. allocated(self%spectrum)) return
      where (variation%massless%is_inert(:variation%n_dofs))
         self%spectrum = ieee_value(1.0_wp, ieee_quiet_nan)
      end where
   end subroutine forget_static
end module hb_noise_response
