!> Spectrum of low tuples <-> real samples on a grid of an even number of samples, by complex transforms of half the length.
!>
!> Two neighbours x(2k), x(2k + 1) along the first tone are the real and the imaginary part of z(k), as they stand in memory.
!> The motion Re(c exp(i j.tau)) puts c (1 + i w)/2 at j and conj(c) (1 + i conj(w))/2 at -j into the spectrum of z, with
!> w = exp(2 pi i j_1/n_1); back, c comes from both. Source of the method: Press et al., Numerical Recipes, section 12.3,
!> for one tone. Where the first tone has an odd number of samples z is x, and w is left out.
!>
!> One tone is transformed after the other. A column in which a tone not yet transformed has a tuple beyond the highest
!> kept is zero, or of no interest: it is not transformed. Each stage has an array of its own, so that what it does not write
!> stays zero. FFTW's transforms of several axes know nothing of that, and those of real numbers run one number at a time.
module hb_packed_fft
   use hb_error, only: error_t
   use hb_fftw, only: axis_plan_t, complex_block_t, new_axis_plan, new_complex_block, two_together
   use hb_kinds, only: two_pi, wp
   implicit none
   private
   public :: new_packed_fft, packed_fft_t, way

   !> The ways that a transform goes; each needs arrays of its own.
   type :: way_t
      integer :: both = 0
      integer :: to_samples = 1
      integer :: to_spectrum = 2
   end type way_t
   type(way_t), parameter :: way = way_t()

   !> Transforms along one tone, from a spectrum in which lower tones stand close together and this one at full length, to one
   !> in which the next lower tone has its full length as well.
   type :: stage_t
      type(axis_plan_t) :: plan
      type(complex_block_t) :: spectrum                               ! (any, 1), only where there is a way to samples
      integer :: high_spectrum = 0                                    ! where negative j of the next lower tone begin, in both;
      integer :: high_samples = 0                                     ! 0: all of its j are transformed at once
   end type stage_t

   !> Owner of outside resources: call `destroy`.
   type :: packed_fft_t
      integer :: n_samples = 0                                        !! of the whole grid
      integer, private :: n_together = 1                              ! samples in one complex number
      integer, private :: n_first = 0                                 ! samples of the first tone
      integer, allocatable, private :: extent(:)                      ! (n_tones) of the spectrum
      type(stage_t), allocatable, private :: stages(:)                ! (n_tones)
      type(complex_block_t), private :: work(2)                       ! on the way to the spectrum
      type(complex_block_t), private :: loose                         ! samples as complex numbers, where not two are together
   contains
      procedure :: place => packed_fft_place
      procedure :: n_places => packed_fft_n_places
      procedure :: factors => packed_fft_factors
      procedure :: shares => packed_fft_shares
      procedure :: spectrum => packed_fft_spectrum
      procedure :: to_samples => packed_fft_to_samples
      procedure :: to_spectrum => packed_fft_to_spectrum
      procedure :: destroy => packed_fft_destroy
   end type packed_fft_t

contains

   !> Plans the transforms of one function at a time on a grid, between samples and tuples with |j_m| <= highest(m).
   subroutine new_packed_fft(self, n_samples, highest, ways, effort, error)
      type(packed_fft_t), intent(inout) :: self
      integer, intent(in) :: n_samples(:)                             !! (n_tones)
      integer, intent(in) :: highest(:)                               !! (n_tones) >= 0; larger than the grid tells apart: all
      integer, intent(in) :: ways                                     !! one of `way`
      integer, intent(in) :: effort                                   !! one of hb_fftw%planning
      type(error_t), allocatable, intent(out) :: error
      integer :: grid(size(n_samples)), m, n_tones

      call self%destroy()
      n_tones = size(n_samples)
      self%n_samples = product(n_samples)
      self%n_first = n_samples(1)
      self%n_together = 2 - modulo(n_samples(1), 2)
      grid = n_samples
      grid(1) = n_samples(1)/self%n_together
      self%extent = min(grid, 2*highest + 2)
      self%extent(n_tones) = grid(n_tones)
      allocate (self%stages(n_tones))
      do m = 1, n_tones
         if (.not. allocated(error)) call plan_stage(self%stages(m), m)
         if (ways /= way%to_spectrum .and. .not. allocated(error)) &
            call new_complex_block(self%stages(m)%spectrum, product(self%extent(:m - 1))*product(grid(m:)), 1, error)
      end do
      if (self%n_together == 1 .and. .not. allocated(error)) call new_complex_block(self%loose, product(grid), 1, error)
      if (ways == way%to_samples) return
      if (.not. allocated(error)) call new_complex_block(self%work(1), product(grid), 1, error)
      if (.not. allocated(error) .and. n_tones > 1) &
         call new_complex_block(self%work(2), self%extent(1)*product(grid(2:)), 1, error)

   contains

      subroutine plan_stage(stage, m)
         type(stage_t), intent(inout) :: stage
         integer, intent(in) :: m
         integer :: before, n_inner, next, next_grid

         before = product(self%extent(:m - 2))
         next = 1
         next_grid = 1
         if (m > 1) then
            next = self%extent(m - 1)
            next_grid = grid(m - 1)
         end if
         n_inner = before*next
         if (next < next_grid) then                                   ! j = 0 .. highest, then -highest - 1 .. -1
            n_inner = n_inner/2
            stage%high_spectrum = n_inner
            stage%high_samples = before*next_grid - n_inner
         end if
         call new_axis_plan(stage%plan, grid(m), n_inner, product(grid(m + 1:)), before*next, before*next_grid, effort, &
                            error)
      end subroutine plan_stage
   end subroutine new_packed_fft

   !> Where tuple j stands in the spectrum.
   pure integer function packed_fft_place(self, j)
      class(packed_fft_t), intent(in) :: self
      integer, intent(in) :: j(:)                                     !! any integers, (n_tones)
      integer :: m

      packed_fft_place = 0
      do m = size(j), 1, -1
         packed_fft_place = packed_fft_place*self%extent(m) + modulo(j(m), self%extent(m))
      end do
      packed_fft_place = packed_fft_place + 1
   end function packed_fft_place

   !> What Re(c exp(i j.tau)) puts into the spectrum: `near` c at j and `far` conj(c) at -j.
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

   !> The sum of x exp(-i j.tau) over all samples is `near` times the spectrum at j and `far` times the conjugate of that at -j.
   elemental subroutine packed_fft_shares(self, first, near, far)
      class(packed_fft_t), intent(in) :: self
      integer, intent(in) :: first                                    !! j_1
      complex(wp), intent(out) :: near, far
      complex(wp) :: turn

      near = 1.0_wp
      far = 0.0_wp
      if (self%n_together == 1) return
      turn = cmplx(0.0_wp, 1.0_wp, wp)*conjg(turn_by(self, first))
      near = 0.5_wp*(1.0_wp - turn)
      far = 0.5_wp*(1.0_wp + turn)
   end subroutine packed_fft_shares

   !> exp(i tau_1) over j_1 steps of the grid.
   elemental complex(wp) function turn_by(self, first)
      type(packed_fft_t), intent(in) :: self
      integer, intent(in) :: first
      real(wp) :: angle

      angle = two_pi*modulo(first, self%n_first)/self%n_first
      turn_by = cmplx(cos(angle), sin(angle), wp)
   end function turn_by

   !> Number of places in the spectrum.
   pure integer function packed_fft_n_places(self)
      class(packed_fft_t), intent(in) :: self

      packed_fft_n_places = product(self%extent)
   end function packed_fft_n_places

   !> The spectrum from which `to_samples` starts, zero at first and left as it is: who writes always the same places has
   !> nothing to clear.
   function packed_fft_spectrum(self) result(spectrum)
      class(packed_fft_t), intent(in) :: self
      complex(wp), pointer, contiguous :: spectrum(:)                 !! by `place`

      spectrum => self%stages(size(self%stages))%spectrum%values(:, 1)
   end function packed_fft_spectrum

   !> Samples of what was written into `spectrum`.
   subroutine packed_fft_to_samples(self, samples)
      class(packed_fft_t), intent(inout) :: self
      real(wp), intent(inout), contiguous, target :: samples(:)       !! (n_samples), a column of a block of hb_fftw
      complex(wp), pointer, contiguous :: z(:)
      integer :: m

      do m = size(self%stages), 2, -1
         call run(self%stages(m), self%stages(m)%spectrum%values(:, 1), self%stages(m - 1)%spectrum%values(:, 1))
      end do
      if (self%n_together == 2) then
         z => two_together(samples)
         call run(self%stages(1), self%stages(1)%spectrum%values(:, 1), z)
      else
         call run(self%stages(1), self%stages(1)%spectrum%values(:, 1), self%loose%values(:, 1))
         samples = real(self%loose%values(:, 1))
      end if

   contains

      subroutine run(stage, spectrum, z)
         type(stage_t), intent(in) :: stage
         complex(wp), intent(inout), contiguous :: spectrum(:), z(:)

         call stage%plan%to_samples(spectrum, z)
         if (stage%high_spectrum > 0) call stage%plan%to_samples(spectrum(1 + stage%high_spectrum:), z(1 + stage%high_samples:))
      end subroutine run
   end subroutine packed_fft_to_samples

   !> Finds the spectrum of samples; it holds until the next call.
   subroutine packed_fft_to_spectrum(self, samples, spectrum)
      class(packed_fft_t), intent(inout) :: self
      real(wp), intent(inout), contiguous, target :: samples(:)       !! (n_samples), a column of a block of hb_fftw; unchanged
      complex(wp), intent(out), pointer, contiguous :: spectrum(:)    !! by `place`
      complex(wp), pointer, contiguous :: z(:)
      integer :: from, m

      if (self%n_together == 2) then
         z => two_together(samples)
      else
         self%loose%values(:, 1) = samples
         z => self%loose%values(:, 1)
      end if
      call self%stages(1)%plan%to_spectrum(z, self%work(1)%values(:, 1))
      from = 1
      do m = 2, size(self%stages)
         associate (stage => self%stages(m), z => self%work(from)%values(:, 1), spectrum => self%work(3 - from)%values(:, 1))
            call stage%plan%to_spectrum(z, spectrum)
            if (stage%high_spectrum > 0) &
               call stage%plan%to_spectrum(z(1 + stage%high_samples:), spectrum(1 + stage%high_spectrum:))
         end associate
         from = 3 - from
      end do
      spectrum => self%work(from)%values(:, 1)
   end subroutine packed_fft_to_spectrum

   !> Frees plans and memory; safe to call twice.
   subroutine packed_fft_destroy(self)
      class(packed_fft_t), intent(inout) :: self
      integer :: m

      if (allocated(self%stages)) then
         do m = 1, size(self%stages)
            call self%stages(m)%plan%destroy()
            call self%stages(m)%spectrum%destroy()
         end do
         deallocate (self%stages)
      end if
      call self%work(1)%destroy()
      call self%work(2)%destroy()
      call self%loose%destroy()
   end subroutine packed_fft_destroy
end module hb_packed_fft
