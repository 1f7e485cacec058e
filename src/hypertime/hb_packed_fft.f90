!> Spectrum of low tuples <-> real samples on a grid of an even number of samples, by complex transforms of half the length.
!>
!> Two neighbours x(2k), x(2k + 1) along the first tone, adjacent in memory, are the real and the imaginary part of
!> z(k). The motion Re(c exp(i j.tau)) contributes c (1 + i w)/2 at j and conj(c) (1 + i conj(w))/2 at -j to the
!> spectrum of z, with w = exp(2 pi i j_1/n_1); conversely, c follows from both. Source of the method: Press et al.,
!> Numerical Recipes, section 12.3, for one tone. If the first tone has an odd number of samples, z is x, and w is
!> omitted.
!>
!> A function that a shift of all phases by pi multiplies by -1 or 1 has only tuples of odd or even sum. Half of the
!> grid, the first half of the last tone, then determines it, and the transform along this tone has half the length:
!> with j_d = 2 l + p, p 0 or 1, exp(i j_d tau_d) is exp(2 pi i l i_d/(n_d/2)) times the twist exp(i p tau_d), and p
!> follows from the other entries.
!>
!> One tone is transformed after the other. A column in which a tone not yet transformed has a tuple beyond the
!> highest retained one is zero, or not needed, and is skipped. Each stage has an array of its own, so that elements
!> that it does not write remain zero. FFTW's transforms of several axes do not exploit this, and those of real
!> numbers process one number at a time.
module hb_packed_fft
   use hb_error, only: error_t
   use hb_fftw, only: axis_plan_t, complex_block_t, new_axis_plan, new_complex_block, two_together
   use hb_kinds, only: two_pi, wp
   use hb_torus, only: torus_t
   implicit none
   private
   public :: direction, new_packed_fft, packed_fft_t

   !> The directions of a transform; each needs arrays of its own.
   type :: direction_t
      integer :: both = 0
      integer :: to_samples = 1
      integer :: to_spectrum = 2
   end type direction_t
   type(direction_t), parameter :: direction = direction_t()

   !> Transforms along one tone, from a spectrum in which lower tones are stored compactly and this one at full
   !> length, to one in which the next lower tone has its full length as well.
   type :: stage_t
      type(axis_plan_t) :: plan
      integer :: high_spectrum = 0                                    ! start of negative j of the next lower tone, in both;
      integer :: high_samples = 0                                     ! 0: all of its j are transformed at once
   end type stage_t

   !> The arrays of one thread.
   type :: lane_t
      type(complex_block_t), allocatable :: spectra(:)                ! (n_tones) of the stages, (any, 1), for transforms to samples
      type(complex_block_t) :: work(2)                                ! intermediate arrays of the transform to the spectrum
      type(complex_block_t) :: loose                                  ! samples, if they are not transformed in place
   end type lane_t

   !> Owner of external resources: call `destroy`.
   type :: packed_fft_t
      integer :: n_samples                                            !! of the whole grid
      integer, private :: n_together                                  ! samples per complex number
      integer, private :: n_first                                     ! samples of the first tone
      integer, allocatable, private :: extent(:)                      ! (n_tones) of the spectrum
      logical, private :: is_half                                     ! of the grid
      integer, private :: parity                                      ! of the sums of tuples, on half a grid
      complex(wp), allocatable, private :: twist(:)                   ! exp(i tau_d) of the samples of the last tone, on half a grid
      integer, allocatable, private :: twisted(:)                     ! columns of lower tones whose last entries are odd
      integer, private :: n_columns = 0                               ! of lower tones, before the last one is transformed
      type(stage_t), allocatable, private :: stages(:)                ! (n_tones)
      type(lane_t), allocatable, private :: lanes(:)
   contains
      procedure :: position => packed_fft_position
      procedure :: n_positions => packed_fft_n_positions
      procedure :: factors => packed_fft_factors
      procedure :: shares => packed_fft_shares
      procedure :: n_lanes => packed_fft_n_lanes
      procedure :: spectrum => packed_fft_spectrum
      procedure :: to_samples => packed_fft_to_samples
      procedure :: to_spectrum => packed_fft_to_spectrum
      procedure :: destroy => packed_fft_destroy
   end type packed_fft_t

contains

   !> Plans the transforms of one function at a time on a grid, between samples and tuples with |j_m| <= highest(m).
   subroutine new_packed_fft(self, torus, parity, highest, directions, error, n_lanes)
      type(packed_fft_t), intent(inout) :: self
      type(torus_t), intent(in) :: torus
      integer, intent(in) :: parity                                   !! 1 or 0: of the sums of tuples; arbitrary on the whole grid
      integer, intent(in) :: highest(:)                               !! (n_tones) >= 0; larger than the grid resolves: all
      integer, intent(in) :: directions                               !! one of `direction`
      type(error_t), allocatable, intent(out) :: error
      integer, intent(in), optional :: n_lanes                        !! threads that transform a function each; default 1
      integer :: grid(size(highest)), lane, m, n_tones

      call self%destroy()
      n_tones = size(highest)
      self%n_samples = torus%n_total
      self%n_first = torus%n_samples(1)
      self%is_half = torus%is_half
      self%parity = parity
      self%n_together = 2 - modulo(self%n_first, 2)
      if (torus%is_half .and. n_tones > 1 .and. modulo(self%n_first, 4) == 2 .and. 2*highest(1) + 2 > self%n_first/2) &
         self%n_together = 1                                          ! an odd number of pairs would mix tuples of both parities
      grid = torus%n_samples
      if (torus%is_half) grid(n_tones) = grid(n_tones)/2
      grid(1) = grid(1)/self%n_together
      self%extent = min(grid, 2*highest + 2)
      self%extent(n_tones) = grid(n_tones)
      allocate (self%stages(n_tones))
      do m = 1, n_tones
         if (.not. allocated(error)) call plan_stage(self, grid, m, error)
      end do
      if (torus%is_half) call find_twist(self, torus, grid)
      lane = 1
      if (present(n_lanes)) lane = n_lanes
      allocate (self%lanes(lane))
      do lane = 1, size(self%lanes)
         if (.not. allocated(error)) call make_lane(self, grid, directions, self%lanes(lane), error)
      end do
   end subroutine new_packed_fft

   !> Plans the transforms along tone m.
   subroutine plan_stage(self, grid, m, error)
      type(packed_fft_t), intent(inout) :: self
      integer, intent(in) :: grid(:)                                  !! complex numbers, (n_tones)
      integer, intent(in) :: m
      type(error_t), allocatable, intent(out) :: error
      integer :: before, n_inner, next, next_grid

      before = product(self%extent(:m - 2))
      next = 1
      next_grid = 1
      if (m > 1) then
         next = self%extent(m - 1)
         next_grid = grid(m - 1)
      end if
      n_inner = before*next
      associate (stage => self%stages(m))
         if (next < next_grid) then                                   ! j = 0 .. highest, then -highest - 1 .. -1
            n_inner = n_inner/2
            stage%high_spectrum = n_inner
            stage%high_samples = before*next_grid - n_inner
         end if
         call new_axis_plan(stage%plan, grid(m), n_inner, product(grid(m + 1:)), before*next, before*next_grid, error)
      end associate
   end subroutine plan_stage

   !> Finds the twisted columns, those in which the sum of the lower entries requires an odd last entry, and the twist.
   subroutine find_twist(self, torus, grid)
      type(packed_fft_t), intent(inout) :: self
      type(torus_t), intent(in) :: torus
      integer, intent(in) :: grid(:)                                  !! complex numbers, (n_tones)
      integer :: b, i, k, lower, n_tones, quotient, total
      real(wp) :: step

      n_tones = size(grid)
      allocate (self%twisted(0))
      self%n_columns = product(self%extent(:n_tones - 2))
      if (n_tones > 1) self%n_columns = self%n_columns*grid(n_tones - 1)
      do i = 1, self%n_columns
         quotient = i - 1
         total = 0
         do k = 1, n_tones - 2
            total = total + modulo(quotient, self%extent(k))          ! an even extent: negative entries keep their parity
            quotient = quotient/self%extent(k)
         end do
         if (n_tones > 1) then
            lower = self%extent(n_tones - 1)/2                        ! entries from 0 on come first
            b = quotient
            if (self%extent(n_tones - 1) < grid(n_tones - 1) .and. quotient >= lower) b = quotient - grid(n_tones - 1)
            if (b < -lower) cycle                                     ! beyond the highest: zero, or not needed
            total = total + b
         end if
         if (modulo(self%parity - total, 2) == 1) self%twisted = [self%twisted, i]
      end do
      step = two_pi/torus%n_samples(n_tones)                          ! phase between two stored samples
      if (n_tones == 1) step = step*self%n_together
      self%twist = [(cmplx(cos(step*k), sin(step*k), wp), k=0, merge(grid(n_tones), 0, size(self%twisted) > 0) - 1)]
   end subroutine find_twist

   !> Allocates the arrays of one thread.
   subroutine make_lane(self, grid, directions, lane, error)
      type(packed_fft_t), intent(in) :: self
      integer, intent(in) :: grid(:)                                  !! complex numbers, (n_tones)
      integer, intent(in) :: directions                               !! one of `direction`
      type(lane_t), intent(inout) :: lane
      type(error_t), allocatable, intent(out) :: error
      integer :: m, n_tones

      n_tones = size(grid)
      allocate (lane%spectra(n_tones))
      do m = 1, n_tones
         if (directions /= direction%to_spectrum .and. .not. allocated(error)) &
            call new_complex_block(lane%spectra(m), product(self%extent(:m - 1))*product(grid(m:)), 1, error)
      end do
      if ((self%n_together == 1 .or. (self%is_half .and. n_tones == 1)) .and. .not. allocated(error)) &
         call new_complex_block(lane%loose, product(grid), 1, error)
      if (directions == direction%to_samples) return
      if (.not. allocated(error)) call new_complex_block(lane%work(1), product(grid), 1, error)
      if (.not. allocated(error) .and. n_tones > 1) &
         call new_complex_block(lane%work(2), self%extent(1)*product(grid(2:)), 1, error)
   end subroutine make_lane

   !> Position of tuple j in the spectrum. On half a grid its sum has the parity of the plan; other tuples get the
   !> position of a neighbour.
   pure integer function packed_fft_position(self, j)
      class(packed_fft_t), intent(in) :: self
      integer, intent(in) :: j(:)                                     !! any integers, (n_tones)
      integer :: last, m

      last = j(size(j))
      if (self%is_half) then
         last = last - modulo(self%parity - sum(j(:size(j) - 1)), 2)
         last = (last - modulo(last, 2))/2
      end if
      packed_fft_position = wrapped(last, self%extent(size(j)))
      do m = size(j) - 1, 1, -1
         packed_fft_position = packed_fft_position*self%extent(m) + wrapped(j(m), self%extent(m))
      end do
      packed_fft_position = packed_fft_position + 1
   end function packed_fft_position

   !> modulo(j, n), without a division if j is small: positions of thousands of tuples are computed for each solution.
   pure integer function wrapped(j, n)
      integer, intent(in) :: j, n

      wrapped = j
      if (j < 0) wrapped = j + n
      if (wrapped < 0 .or. wrapped >= n) wrapped = modulo(j, n)
   end function wrapped

   !> Contribution of Re(c exp(i j.tau)) to the spectrum: `near` c at j and `far` conj(c) at -j. For -j_1 they are
   !> exchanged.
   elemental subroutine packed_fft_factors(self, first, near, far)
      class(packed_fft_t), intent(in) :: self
      integer, intent(in) :: first                                    !! j_1
      complex(wp), intent(out) :: near, far
      complex(wp) :: turn

      turn = (0.0_wp, 0.0_wp)
      if (self%n_together == 2) turn = cmplx(0.0_wp, 1.0_wp, wp)*turn_by(self, first)
      near = 0.5_wp*(1.0_wp + turn)
      far = 0.5_wp*(1.0_wp - conjg(turn))
   end subroutine packed_fft_factors

   !> The sum of x exp(-i j.tau) over all samples is `near` times the spectrum at j plus `far` times the conjugate of
   !> that at -j; both follow from `factors` of the same j.
   elemental subroutine packed_fft_shares(self, near_factor, far_factor, near, far)
      class(packed_fft_t), intent(in) :: self
      complex(wp), intent(in) :: near_factor, far_factor
      complex(wp), intent(out) :: near, far

      near = 1.0_wp
      far = 0.0_wp
      if (self%n_together == 1) return
      near = conjg(near_factor)
      far = far_factor
   end subroutine packed_fft_shares

   !> exp(i tau_1) over j_1 steps of the grid.
   elemental complex(wp) function turn_by(self, first)
      type(packed_fft_t), intent(in) :: self
      integer, intent(in) :: first
      real(wp) :: angle

      angle = two_pi*modulo(first, self%n_first)/self%n_first
      turn_by = cmplx(cos(angle), sin(angle), wp)
   end function turn_by

   !> Number of elements of the spectrum.
   pure integer function packed_fft_n_positions(self)
      class(packed_fft_t), intent(in) :: self

      packed_fft_n_positions = product(self%extent)
   end function packed_fft_n_positions

   !> Number of threads that may transform a function each at the same time.
   pure integer function packed_fft_n_lanes(self) result(n_lanes)
      class(packed_fft_t), intent(in) :: self

      n_lanes = size(self%lanes)
   end function packed_fft_n_lanes

   !> The spectrum from which `to_samples` starts, zero at first and not modified: a caller that always writes the
   !> same elements need not clear it.
   function packed_fft_spectrum(self, lane) result(spectrum)
      class(packed_fft_t), intent(in) :: self
      integer, intent(in) :: lane                                     !! 1 to n_lanes
      complex(wp), pointer, contiguous :: spectrum(:)                 !! by `position`

      spectrum => self%lanes(lane)%spectra(size(self%stages))%values(:, 1)
   end function packed_fft_spectrum

   !> Transforms the values written into `spectrum` to samples.
   subroutine packed_fft_to_samples(self, lane, samples)
      class(packed_fft_t), intent(inout) :: self
      integer, intent(in) :: lane                                     !! that of `spectrum`
      real(wp), intent(inout), contiguous, target :: samples(:)       !! (n_samples), a column of a block of hb_fftw
      complex(wp), pointer, contiguous :: z(:)
      integer :: m

      associate (spectra => self%lanes(lane)%spectra, loose => self%lanes(lane)%loose)
         do m = size(self%stages), 2, -1
            call run(self%stages(m), spectra(m)%values(:, 1), spectra(m - 1)%values(:, 1))
            if (m == size(self%stages) .and. self%is_half) call multiply_by_twist(self, spectra(m - 1)%values(:, 1), .false.)
         end do
         if (self%n_together == 2) then
            z => two_together(samples)
            call run(self%stages(1), spectra(1)%values(:, 1), z)
            if (size(self%stages) == 1 .and. self%is_half) call multiply_by_twist(self, z, .false.)
         else
            call run(self%stages(1), spectra(1)%values(:, 1), loose%values(:, 1))
            samples = real(loose%values(:, 1))
         end if
      end associate

   contains

      subroutine run(stage, spectrum, z)
         type(stage_t), intent(in) :: stage
         complex(wp), intent(inout), contiguous :: spectrum(:), z(:)

         call stage%plan%to_samples(spectrum, z)
         if (stage%high_spectrum > 0) call stage%plan%to_samples(spectrum(1 + stage%high_spectrum:), z(1 + stage%high_samples:))
      end subroutine run
   end subroutine packed_fft_to_samples

   !> Transforms samples to their spectrum, which is valid until the next call with this lane.
   subroutine packed_fft_to_spectrum(self, lane, samples, spectrum)
      class(packed_fft_t), intent(inout) :: self
      integer, intent(in) :: lane                                     !! 1 to n_lanes
      real(wp), intent(inout), contiguous, target :: samples(:)       !! (n_samples), a column of a block of hb_fftw; unchanged
      complex(wp), intent(out), pointer, contiguous :: spectrum(:)    !! by `position`
      complex(wp), pointer, contiguous :: z(:)
      integer :: from, m

      associate (own => self%lanes(lane))
         if (self%n_together == 1) then
            own%loose%values(:, 1) = samples
            z => self%lanes(lane)%loose%values(:, 1)
         else if (size(self%stages) == 1 .and. self%is_half) then
            z => two_together(samples)
            own%loose%values(:, 1) = z
            z => self%lanes(lane)%loose%values(:, 1)
            call multiply_by_twist(self, z, .true.)
         else
            z => two_together(samples)
         end if
         call self%stages(1)%plan%to_spectrum(z, own%work(1)%values(:, 1))
         from = 1
         do m = 2, size(self%stages)
            associate (stage => self%stages(m), z => own%work(from)%values(:, 1), spectrum => own%work(3 - from)%values(:, 1))
               if (m == size(self%stages) .and. self%is_half) call multiply_by_twist(self, z, .true.)
               call stage%plan%to_spectrum(z, spectrum)
               if (stage%high_spectrum > 0) &
                  call stage%plan%to_spectrum(z(1 + stage%high_samples:), spectrum(1 + stage%high_spectrum:))
            end associate
            from = 3 - from
         end do
         spectrum => own%work(from)%values(:, 1)
      end associate
   end subroutine packed_fft_to_spectrum

   !> Multiplies the columns whose last entries are odd by the twist of each sample of the last tone, or by its conjugate.
   pure subroutine multiply_by_twist(self, z, is_conjugate)
      type(packed_fft_t), intent(in) :: self
      complex(wp), intent(inout) :: z(self%n_columns, *)              !! a column for each sample of the last tone
      logical, intent(in) :: is_conjugate
      complex(wp) :: factor
      integer :: i, k

      do i = 2, size(self%twist)                                      ! the first is 1
         factor = self%twist(i)
         if (is_conjugate) factor = conjg(factor)
         do k = 1, size(self%twisted)
            z(self%twisted(k), i) = factor*z(self%twisted(k), i)
         end do
      end do
   end subroutine multiply_by_twist

   !> Frees plans and memory; safe to call twice.
   subroutine packed_fft_destroy(self)
      class(packed_fft_t), intent(inout) :: self
      integer :: lane, m

      if (allocated(self%stages)) then
         do m = 1, size(self%stages)
            call self%stages(m)%plan%destroy()
         end do
         deallocate (self%stages)
      end if
      if (allocated(self%lanes)) then
         do lane = 1, size(self%lanes)
            if (allocated(self%lanes(lane)%spectra)) then
               do m = 1, size(self%lanes(lane)%spectra)
                  call self%lanes(lane)%spectra(m)%destroy()
               end do
            end if
            call self%lanes(lane)%work(1)%destroy()
            call self%lanes(lane)%work(2)%destroy()
            call self%lanes(lane)%loose%destroy()
         end do
         deallocate (self%lanes)
      end if
      if (allocated(self%twist)) deallocate (self%twist, self%twisted)
      if (allocated(self%extent)) deallocate (self%extent)              ! as in discretisation_clear
   end subroutine packed_fft_destroy
end module hb_packed_fft
