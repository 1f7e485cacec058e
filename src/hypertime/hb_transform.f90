!> Coefficients <-> samples on the torus, for many degrees of freedom at once, and the rate of change along time.
!>
!> With c = a - i b a motion is Re sum c_j exp(i j.tau); its discrete spectrum holds c/2 at j and conj(c)/2 at -j. Because
!> the first non-zero entry of a kept tuple is positive, all j fall into the half spectrum that a real FFT keeps (j_1 >= 0);
!> in its plane j_1 = 0 both j and -j are stored. On half a torus all tuples have sums of one parity. Source: docs/theory.md,
!> section 3.
module hb_transform
   use hb_error, only: error_t
   use hb_grid_fft, only: grid_fft_t, new_grid_fft
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_torus, only: torus_t
   implicit none
   private
   public :: new_transform, product_table_t, transform_t

   !> Plans and work arrays for one harmonic set on one grid. Owner of outside resources: call `destroy`.
   type :: transform_t
      type(harmonics_t) :: harmonics
      type(torus_t) :: torus
      integer :: n_channels = 0                                       !! transforms done at once
      integer, allocatable, private :: at(:)                          ! (n_harmonics) place of j in the half spectrum
      logical, allocatable, private :: is_conjugate(:)                ! where that place holds the conjugate
      integer, allocatable, private :: mirror_at(:)                   ! place of -j, 0 where the half spectrum leaves it out
      integer, private :: parity = 0                                  ! of the sums of tuples, on half a torus
      type(grid_fft_t), private :: batch                              ! of all channels
      type(grid_fft_t), private :: single                             ! of one, on half a torus of slopes
      type(grid_fft_t), allocatable, private :: single_odd            ! of one odd function on half a torus, where batch has more
   contains
      procedure :: to_samples => transform_to_samples
      procedure :: to_rate_samples => transform_to_rate_samples
      procedure :: to_coefficients => transform_to_coefficients
      procedure :: to_coefficients_of_one => transform_to_coefficients_of_one
      procedure :: tabulate_product => transform_tabulate_product
      procedure :: destroy => transform_destroy
   end type transform_t

   !> Fourier coefficients of a sampled function g at all sums and differences of the kept tuples, in the basis of
   !> cos and sin. They hold the matrix of the operator x -> projection of g x; see `columns`.
   type :: product_table_t
      integer :: centre = 0                                           !! place of tuple zero in the tables
      integer, allocatable :: offset(:)                               !! (n_harmonics) place of j, relative to the centre
      real(wp), allocatable :: cosine(:), sine(:)                     !! mean of g cos(m.tau), g sin(m.tau)
      integer, allocatable, private :: entry(:)                       ! of the tables that are filled
      integer, allocatable, private :: source(:)                      ! place in the half spectrum, negative: conjugate
   contains
      procedure :: columns => product_table_columns
      procedure :: columns_among => product_table_columns_among
   end type product_table_t

contains

   !> Plans the transforms of `n_channels` functions at once.
   subroutine new_transform(self, harmonics, torus, n_channels, effort, error)
      type(transform_t), intent(inout) :: self
      type(harmonics_t), intent(in) :: harmonics                      !! on half a torus with sums of one parity
      type(torus_t), intent(in) :: torus
      integer, intent(in) :: n_channels                               !! >= 1
      integer, intent(in) :: effort                                   !! one of hb_fftw%planning
      type(error_t), allocatable, intent(out) :: error
      integer :: h
      logical :: is_conjugate

      call self%destroy()
      self%harmonics = harmonics
      self%torus = torus
      self%n_channels = n_channels
      self%parity = modulo(sum(harmonics%tuples(:, 1)), 2)
      call new_grid_fft(self%batch, torus, self%parity, harmonics%highest(1), n_channels, effort, .false., error)
      if (allocated(error)) return
      call new_grid_fft(self%single, torus, 0, 2*harmonics%highest(1), 1, effort, .true., error)
      if (allocated(error)) return
      if (torus%is_half .and. self%parity == 1 .and. n_channels > 1) then
         allocate (self%single_odd)
         call new_grid_fft(self%single_odd, torus, 1, harmonics%highest(1), 1, effort, .true., error)
         if (allocated(error)) return
      end if
      if (allocated(self%at)) deallocate (self%at, self%mirror_at, self%is_conjugate)
      allocate (self%at(harmonics%n_harmonics), self%mirror_at(harmonics%n_harmonics), self%is_conjugate(harmonics%n_harmonics))
      do h = 1, harmonics%n_harmonics
         associate (j => harmonics%tuples(:, h))
            call self%batch%find_place(j, self%at(h), self%is_conjugate(h))
            self%mirror_at(h) = 0
            if (j(1) == 0 .and. any(j /= 0)) call self%batch%find_place(-j, self%mirror_at(h), is_conjugate)
         end associate
      end do
   end subroutine new_transform

   !> Samples of the motions with coefficients `x`.
   subroutine transform_to_samples(self, x, samples)
      class(transform_t), intent(inout) :: self
      real(wp), intent(in) :: x(:, :)                                 !! (n_coefficients, n_channels)
      real(wp), intent(inout), contiguous :: samples(:, :)            !! (n_total, n_channels), aligned
      integer :: channel, h

      associate (set => self%harmonics, spectra => self%batch%spectra%values)
         spectra = (0.0_wp, 0.0_wp)
         do channel = 1, self%n_channels
            if (set%has_zero) spectra(self%at(1), channel) = x(1, channel)
            do h = merge(2, 1, set%has_zero), set%n_harmonics
               call store(self, channel, h, 0.5_wp*cmplx(x(set%cos_at(h), channel), -x(set%sin_at(h), channel), wp))
            end do
         end do
         call self%batch%to_samples(samples)
      end associate
   end subroutine transform_to_samples

   !> Samples of d/dt of the motions with coefficients `x`: tau_m = omega_m t, so cosine j turns with j.omega.
   subroutine transform_to_rate_samples(self, x, frequencies, samples)
      class(transform_t), intent(inout) :: self
      real(wp), intent(in) :: x(:, :)                                 !! (n_coefficients, n_channels)
      real(wp), intent(in) :: frequencies(:)                          !! j.omega [rad/s], (n_harmonics)
      real(wp), intent(inout), contiguous :: samples(:, :)            !! (n_total, n_channels), aligned
      integer :: channel, h

      associate (set => self%harmonics, spectra => self%batch%spectra%values)
         spectra = (0.0_wp, 0.0_wp)
         do channel = 1, self%n_channels
            do h = merge(2, 1, set%has_zero), set%n_harmonics
               call store(self, channel, h, &
                  0.5_wp*frequencies(h)*cmplx(x(set%sin_at(h), channel), x(set%cos_at(h), channel), wp))
            end do
         end do
         call self%batch%to_samples(samples)
      end associate
   end subroutine transform_to_rate_samples

   !> Puts one complex value at j and its conjugate at -j where the half spectrum stores both.
   pure subroutine store(self, channel, h, value)
      type(transform_t), intent(inout) :: self
      integer, intent(in) :: channel, h
      complex(wp), intent(in) :: value

      associate (spectra => self%batch%spectra%values)
         spectra(self%at(h), channel) = merge(conjg(value), value, self%is_conjugate(h))
         if (self%mirror_at(h) > 0) spectra(self%mirror_at(h), channel) = conjg(value)
      end associate
   end subroutine store

   !> Coefficients of the sampled functions in the kept harmonics (their projection).
   subroutine transform_to_coefficients(self, samples, x)
      class(transform_t), intent(inout) :: self
      real(wp), intent(inout), contiguous :: samples(:, :)            !! (n_total, n_channels), aligned; unchanged
      real(wp), intent(out) :: x(:, :)                                !! (n_coefficients, n_channels)
      integer :: channel

      call self%batch%to_spectrum(samples)
      do channel = 1, self%n_channels
         call read_spectrum(self, self%batch%spectra%values(:, channel), x(:, channel))
      end do
   end subroutine transform_to_coefficients

   !> The same of one function alone, whatever the number of channels.
   subroutine transform_to_coefficients_of_one(self, samples, x)
      class(transform_t), intent(inout) :: self
      real(wp), intent(inout), contiguous :: samples(:, :)            !! (n_total, 1), aligned; unchanged
      real(wp), intent(out) :: x(:)                                   !! (n_coefficients)

      if (.not. self%torus%is_half .or. self%parity == 0) then
         call project(self%single)
      else if (allocated(self%single_odd)) then
         call project(self%single_odd)
      else
         call project(self%batch)
      end if

   contains

      subroutine project(plan)
         type(grid_fft_t), intent(inout) :: plan

         call plan%to_spectrum(samples)
         call read_spectrum(self, plan%spectra%values(:, 1), x)
      end subroutine project
   end subroutine transform_to_coefficients_of_one

   !> Coefficients from the spectrum of one channel.
   pure subroutine read_spectrum(self, spectrum, x)
      type(transform_t), intent(in) :: self
      complex(wp), intent(in) :: spectrum(:)
      real(wp), intent(out) :: x(:)
      integer :: h
      real(wp) :: weight

      weight = 2.0_wp/self%torus%n_total
      associate (set => self%harmonics)
         if (set%has_zero) x(1) = 0.5_wp*weight*real(spectrum(self%at(1)))
         do h = merge(2, 1, set%has_zero), set%n_harmonics
            x(set%cos_at(h)) = weight*real(spectrum(self%at(h)))
            x(set%sin_at(h)) = merge(weight, -weight, self%is_conjugate(h))*aimag(spectrum(self%at(h)))
         end do
      end associate
   end subroutine read_spectrum

   !> Fills the table of `factor` times the function sampled in one column of `samples`. The table's index arrays are made at
   !> its first use.
   subroutine transform_tabulate_product(self, samples, column, table, factor)
      class(transform_t), intent(inout) :: self
      real(wp), intent(inout), contiguous, target :: samples(:, :)    !! (n_total, any); unchanged
      integer, intent(in) :: column
      type(product_table_t), intent(inout) :: table
      real(wp), intent(in) :: factor
      integer :: i, place
      real(wp) :: weight

      if (.not. allocated(table%source)) call index_table(self, table)
      weight = factor/self%torus%n_total
      call self%single%to_spectrum(samples(:, column:column))
      do i = 1, size(table%source)
         place = abs(table%source(i))
         table%cosine(table%entry(i)) = weight*real(self%single%spectra%values(place, 1))
         table%sine(table%entry(i)) = -sign(weight, real(table%source(i), wp))*aimag(self%single%spectra%values(place, 1))
      end do
   end subroutine transform_tabulate_product

   !> Lays out the table over all m with |m_n| <= 2 N_n, wrapped onto the grid, so that what it holds is the exact
   !> derivative of the discrete projection, aliases included. On half a torus those of odd sums are zero and left out.
   subroutine index_table(self, table)
      type(transform_t), intent(in) :: self
      type(product_table_t), intent(inout) :: table
      integer :: extent(self%harmonics%n_tones), stride(self%harmonics%n_tones), j(self%harmonics%n_tones)
      integer :: h, i, m, n_entries, place, rest
      logical :: is_conjugate

      associate (set => self%harmonics)
         extent = 4*set%highest + 1
         stride(1) = 1
         do m = 2, set%n_tones
            stride(m) = stride(m - 1)*extent(m - 1)
         end do
         table%centre = 1 + dot_product(2*set%highest, stride)
         allocate (table%offset(set%n_harmonics), table%source(product(extent)), table%entry(product(extent)))
         do h = 1, set%n_harmonics
            table%offset(h) = dot_product(set%tuples(:, h), stride)
         end do
         n_entries = 0
         do i = 1, product(extent)
            rest = i - 1
            do m = 1, set%n_tones
               j(m) = modulo(rest, extent(m)) - 2*set%highest(m)
               rest = rest/extent(m)
            end do
            if (self%torus%is_half .and. modulo(sum(j), 2) == 1) cycle
            n_entries = n_entries + 1
            call self%single%find_place(j, place, is_conjugate)
            table%entry(n_entries) = i
            table%source(n_entries) = merge(-place, place, is_conjugate)
         end do
         table%entry = table%entry(:n_entries)
         table%source = table%source(:n_entries)
         allocate (table%cosine(product(extent)), table%sine(product(extent)), source=0.0_wp)
      end associate
   end subroutine index_table

   !> The two columns, for cosine and sine of harmonic k, of the matrix of x -> projection of g x:
   !> its entry at cosine j, cosine k is mean g [cos((j-k).tau) + cos((j+k).tau)], and so on by the product formulas,
   !> half of that in the row of the zero tuple. Source: docs/theory.md, eq. (11).
   pure subroutine product_table_columns(self, set, k, cosine_column, sine_column)
      class(product_table_t), intent(in) :: self
      type(harmonics_t), intent(in) :: set
      integer, intent(in) :: k                                        !! harmonic
      real(wp), intent(out) :: cosine_column(:), sine_column(:)       !! (n_coefficients); the sine of tuple zero is zero

      call self%columns_among(set, self%offset, self%offset(k), cosine_column, sine_column)
   end subroutine product_table_columns

   !> The same columns in the rows of some of the harmonics alone.
   pure subroutine product_table_columns_among(self, set, offsets, offset, cosine_column, sine_column)
      class(product_table_t), intent(in) :: self
      type(harmonics_t), intent(in) :: set                            !! of these harmonics
      integer, intent(in) :: offsets(:)                               !! those of `offset`, (set%n_harmonics)
      integer, intent(in) :: offset                                   !! that of the column
      real(wp), intent(out) :: cosine_column(:), sine_column(:)       !! (set%n_coefficients)
      integer :: h, minus, plus

      do h = merge(2, 1, set%has_zero), set%n_harmonics
         minus = self%centre + offsets(h) - offset
         plus = self%centre + offsets(h) + offset
         cosine_column(set%cos_at(h)) = self%cosine(plus) + self%cosine(minus)
         cosine_column(set%sin_at(h)) = self%sine(plus) + self%sine(minus)
         sine_column(set%cos_at(h)) = self%sine(plus) - self%sine(minus)
         sine_column(set%sin_at(h)) = self%cosine(minus) - self%cosine(plus)
      end do
      if (set%has_zero) then
         cosine_column(1) = self%cosine(self%centre + offset)
         sine_column(1) = self%sine(self%centre + offset)
      end if
   end subroutine product_table_columns_among

   !> Frees plans and memory; safe to call twice.
   subroutine transform_destroy(self)
      class(transform_t), intent(inout) :: self

      call self%batch%destroy()
      call self%single%destroy()
      if (.not. allocated(self%single_odd)) return
      call self%single_odd%destroy()
      deallocate (self%single_odd)
   end subroutine transform_destroy
end module hb_transform
