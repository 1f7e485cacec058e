!> Fast Fourier transforms between the samples of a torus and a spectrum of tuples, on the whole grid or on half of it.
!>
!> A function that a shift of all phases by pi multiplies by -1 or 1 has tuples of odd or even sum alone. Half of the grid, the
!> first half of the last tone, then tells all, and the transform along the last tone has half the length: with j_d = 2 l + p,
!> p 0 or 1, exp(i j_d tau_d) is exp(2 pi i l i_d/(n_d/2)) times the twist exp(i p tau_d), and p follows from the other entries.
!> With a single tone even functions have half the period. The odd ones have x(i + n/2) = -x(i), so that
!> z(i) = x(i) - i x(i + n/4), i < n/4, has the harmonics 4 l + 1 alone, those of 4 l + 3 being conjugates of -(4 l + 3).
!> Source: docs/theory.md, section 3.
module hb_grid_fft
   use hb_error, only: error_t
   use hb_fftw, only: complex_block_t, fft_plan_t, line_plan_t, new_complex_block, new_fft_plan, new_line_plan, new_real_block, &
      real_block_t
   use hb_kinds, only: two_pi, wp
   use hb_torus, only: torus_t
   implicit none
   private
   public :: grid_fft_t, new_grid_fft, spectrum_size

   !> Plans, and the spectra that they work on. Owner of outside resources: call `destroy`.
   type :: grid_fft_t
      type(complex_block_t) :: spectra                                !! (n_spectrum, n_batch), c/2 at j before `to_samples`
      logical, private :: is_half = .false.
      integer, private :: parity = 0                                  ! of the sums of tuples, on half a grid
      integer, allocatable, private :: shape(:)                       ! of the grid transformed, (n_tones)
      integer, private :: n_rows = 0                                  ! places of the first tone in use, on half a grid
      type(fft_plan_t), private :: plan                               ! whole grid; on half of it the tones but the last
      type(line_plan_t), private :: lines                             ! last tone, on half a grid
      complex(wp), allocatable, private :: twist(:)                   ! exp(i tau_d) of its samples
      logical, allocatable, private :: is_even_block(:)               ! sum of the tones between the first and the last
   contains
      procedure :: find_place => grid_fft_find_place
      procedure :: to_samples => grid_fft_to_samples
      procedure :: to_spectrum => grid_fft_to_spectrum
      procedure :: destroy => grid_fft_destroy
   end type grid_fft_t

contains

   !> Complex numbers in the spectrum of one function.
   pure integer function spectrum_size(torus, parity)
      type(torus_t), intent(in) :: torus
      integer, intent(in) :: parity                                   !! as for `new_grid_fft`

      associate (n => torus%n_samples)
         spectrum_size = (n(1)/2 + 1)*product(n(2:))
         if (.not. torus%is_half) return
         if (size(n) > 1) then
            spectrum_size = spectrum_size/2
         else if (parity == 1) then
            spectrum_size = n(1)/4
         else
            spectrum_size = n(1)/4 + 1
         end if
      end associate
   end function spectrum_size

   !> Plans the transforms of `n_batch` functions at once.
   subroutine new_grid_fft(self, torus, parity, highest, n_batch, effort, any_column, error)
      type(grid_fft_t), intent(inout) :: self
      type(torus_t), intent(in) :: torus
      integer, intent(in) :: parity                                   !! 1 or 0: sum of all tuples; any on the whole grid
      integer, intent(in) :: highest                                  !! largest entry of the first tone
      integer, intent(in) :: n_batch                                  !! >= 1
      integer, intent(in) :: effort                                   !! one of hb_fftw%planning
      logical, intent(in) :: any_column                               !! samples may be any column of a block
      type(error_t), allocatable, intent(out) :: error
      type(real_block_t) :: scratch
      integer :: last, n_spectrum

      call self%destroy()
      self%is_half = torus%is_half
      self%parity = parity
      self%shape = torus%n_samples
      n_spectrum = spectrum_size(torus, parity)
      call new_complex_block(self%spectra, n_spectrum, n_batch, error)
      if (allocated(error)) return
      call new_real_block(scratch, torus%n_total, n_batch, error)
      if (allocated(error)) return
      last = size(self%shape)
      associate (shape => self%shape, spectra => self%spectra%values)
         if (.not. torus%is_half) then
            call new_fft_plan(self%plan, shape, n_batch, effort, any_column, scratch%values, spectra, error)
         else if (last > 1) then
            shape(last) = shape(last)/2
            self%n_rows = min(highest, shape(1)/2) + 1
            call new_fft_plan(self%plan, shape(:last - 1), shape(last)*n_batch, effort, any_column, scratch%values, spectra, error)
            if (.not. allocated(error)) then
               call new_line_plan(self%lines, shape(last), n_spectrum/shape(last), self%n_rows, product(shape(2:last - 1)), &
                                  shape(1)/2 + 1, effort, spectra, n_batch, error)
            end if
            call find_twist(self, shape(last), 2*shape(last))
            call find_even_blocks(self)
         else if (parity == 1) then
            shape(1) = shape(1)/4
            call new_line_plan(self%lines, shape(1), 1, 1, 1, 1, effort, spectra, n_batch, error)
            call find_twist(self, shape(1), 4*shape(1))
         else
            shape(1) = shape(1)/2
            call new_fft_plan(self%plan, shape, n_batch, effort, any_column, scratch%values, spectra, error)
         end if
      end associate
      call scratch%destroy()
   end subroutine new_grid_fft

   !> exp(2 pi i k/n) for k from 0 on.
   pure subroutine find_twist(self, n_values, n)
      type(grid_fft_t), intent(inout) :: self
      integer, intent(in) :: n_values, n
      integer :: k

      self%twist = [(cmplx(cos(two_pi*k/n), sin(two_pi*k/n), wp), k=0, n_values - 1)]
   end subroutine find_twist

   !> Parities of the sums of tuples in the blocks between the first and the last tone.
   pure subroutine find_even_blocks(self)
      type(grid_fft_t), intent(inout) :: self
      integer :: b, m, rest, total

      associate (last => size(self%shape))
         if (allocated(self%is_even_block)) deallocate (self%is_even_block)
         allocate (self%is_even_block(product(self%shape(2:last - 1))))
         do b = 1, size(self%is_even_block)
            rest = b - 1
            total = 0
            do m = 2, last - 1
               total = total + modulo(rest, self%shape(m))
               rest = rest/self%shape(m)
            end do
            self%is_even_block(b) = modulo(total, 2) == 0
         end do
      end associate
   end subroutine find_even_blocks

   !> Place of a tuple in a spectrum, wrapped onto the grid; where `is_conjugate` the place holds the conjugate. On half a grid
   !> the tuple has the parity of the plan.
   pure subroutine grid_fft_find_place(self, tuple, place, is_conjugate)
      class(grid_fft_t), intent(in) :: self
      integer, intent(in) :: tuple(:)                                 !! (n_tones)
      integer, intent(out) :: place
      logical, intent(out) :: is_conjugate
      integer :: j(size(tuple)), last, m

      last = size(tuple)
      j = tuple
      if (self%is_half .and. last == 1 .and. self%parity == 1) then
         is_conjugate = modulo(j(1), 4) == 3
         if (is_conjugate) j = -j
         place = 1 + modulo((j(1) - 1)/4, self%shape(1))
         return
      end if
      if (self%is_half .and. last == 1) j = j/2
      is_conjugate = modulo(j(1), self%shape(1)) > self%shape(1)/2
      if (is_conjugate) j = -j
      if (self%is_half .and. last > 1) j(last) = (j(last) - modulo(j(last), 2))/2
      place = 0
      do m = last, 2, -1
         place = place*self%shape(m) + modulo(j(m), self%shape(m))
      end do
      place = place*(self%shape(1)/2 + 1) + modulo(j(1), self%shape(1)) + 1
   end subroutine grid_fft_find_place

   !> Samples of the spectra, which are lost.
   subroutine grid_fft_to_samples(self, samples)
      class(grid_fft_t), intent(inout) :: self
      real(wp), intent(inout), contiguous :: samples(:, :)            !! (n_total, n_batch), aligned
      integer :: c, i, n
      complex(wp) :: z

      if (.not. self%is_half .or. (size(self%shape) == 1 .and. self%parity == 0)) then
         call self%plan%to_samples(self%spectra%values, samples)
         return
      end if
      call self%lines%run_backward(self%spectra%values)
      if (size(self%shape) > 1) then
         call multiply_by_twist(self, .false.)
         call self%plan%to_samples(self%spectra%values, samples)
         return
      end if
      n = self%shape(1)
      do c = 1, size(samples, 2)
         do i = 1, n
            z = 2.0_wp*self%twist(i)*self%spectra%values(i, c)
            samples(i, c) = real(z)
            samples(i + n, c) = -aimag(z)
         end do
      end do
   end subroutine grid_fft_to_samples

   !> Spectra of the samples: their sums with exp(-i j.tau).
   subroutine grid_fft_to_spectrum(self, samples)
      class(grid_fft_t), intent(inout) :: self
      real(wp), intent(inout), contiguous :: samples(:, :)            !! (n_total, n_batch), aligned; unchanged
      integer :: c, i, n

      if (self%is_half .and. size(self%shape) == 1 .and. self%parity == 1) then
         n = self%shape(1)
         do c = 1, size(samples, 2)
            do i = 1, n
               self%spectra%values(i, c) = cmplx(samples(i, c), -samples(i + n, c), wp)*conjg(self%twist(i))
            end do
         end do
         call self%lines%run_forward(self%spectra%values)
         return
      end if
      call self%plan%to_spectrum(samples, self%spectra%values)
      if (.not. self%is_half .or. size(self%shape) == 1) return
      call multiply_by_twist(self, .true.)
      call self%lines%run_forward(self%spectra%values)
   end subroutine grid_fft_to_spectrum

   !> Multiplies the rows whose last entry is odd by the twist of each sample of the last tone, or by its conjugate.
   subroutine multiply_by_twist(self, is_conjugate)
      type(grid_fft_t), intent(inout) :: self
      logical, intent(in) :: is_conjugate
      complex(wp) :: factor
      integer :: at, b, c, first, i, row

      do c = 1, size(self%spectra%values, 2)
         at = size(self%is_even_block)*(self%shape(1)/2 + 1)           ! the first sample needs none
         do i = 2, size(self%twist)
            factor = self%twist(i)
            if (is_conjugate) factor = conjg(factor)
            do b = 1, size(self%is_even_block)
               first = merge(1, 2, self%is_even_block(b) .eqv. self%parity == 1)
               do row = at + first, at + self%n_rows, 2
                  self%spectra%values(row, c) = factor*self%spectra%values(row, c)
               end do
               at = at + self%shape(1)/2 + 1
            end do
         end do
      end do
   end subroutine multiply_by_twist

   !> Frees plans and memory; safe to call twice.
   subroutine grid_fft_destroy(self)
      class(grid_fft_t), intent(inout) :: self

      call self%plan%destroy()
      call self%lines%destroy()
      call self%spectra%destroy()
   end subroutine grid_fft_destroy
end module hb_grid_fft
