!> Coefficients <-> samples on the torus, for many degrees of freedom at once, and the rate of change along time.
!> Threads share the functions.
!>
!> With c = a - i b a motion is Re sum c_j exp(i j.tau). Functions are transformed one by one, so that the spectrum of
!> one remains in the cache; see hb_packed_fft for its layout. Source: docs/why/theory.md, section 3.
module hb_transform
   use hb_assert, only: assert, asserts_are_on
   use hb_error, only: error_t, fail
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_packed_fft, only: direction, new_packed_fft, packed_fft_t
   use hb_threads, only: n_threads, this_thread
   use hb_torus, only: torus_t
   implicit none
   private
   public :: new_transform, product_table_t, transform_t

   !> Plans and work arrays for one harmonic set on one grid. Owner of external resources: call `destroy`.
   type :: transform_t
      type(harmonics_t) :: harmonics
      type(torus_t) :: torus
      integer :: n_channels = 0                                       !! functions in a block of samples; 0: nothing is planned
      integer, private :: directions = direction%both
      type(packed_fft_t), private :: fft
      type(packed_fft_t), private :: products                         ! of tuples up to twice the highest, after `prepare_products`
      integer, allocatable, private :: at(:), mirror_at(:)            ! (n_harmonics) positions of j and -j in the spectrum
      logical, private :: has_shared_positions = .false.              ! of several harmonics
      complex(wp), allocatable, private :: near_factor(:), far_factor(:)   ! (n_harmonics), see hb_packed_fft%factors
      complex(wp), allocatable, private :: near_share(:), far_share(:)     ! (n_harmonics), see hb_packed_fft%shares
   contains
      procedure :: to_samples => transform_to_samples
      procedure :: to_rate_samples => transform_to_rate_samples
      procedure :: to_coefficients => transform_to_coefficients
      procedure :: to_coefficients_of_one => transform_to_coefficients_of_one
      procedure :: to_samples_of_one => transform_to_samples_of_one
      procedure :: prepare_products => transform_prepare_products
      procedure :: tabulate_product => transform_tabulate_product
      procedure :: serves => transform_serves
      procedure :: destroy => transform_destroy
   end type transform_t

   !> Fourier coefficients of a few sampled functions g, the parts, at all sums and differences of the retained
   !> tuples. They contain the matrices of the operators x -> projection of g x; see `columns`.
   type :: product_table_t
      integer :: centre = 0                                           !! position of the zero tuple in the tables
      integer, allocatable :: offset(:)                               !! (n_harmonics) position of j, relative to the centre
      complex(wp), allocatable :: mean(:, :)                          !! of g exp(i m.tau), last tone fastest; (any, parts)
      integer, allocatable, private :: at(:)                          ! of the same m, position in the spectrum; that of -m is
                                                                      !! at the same distance from the other end
      complex(wp), allocatable, private :: near_share(:), far_share(:)     ! by m_1
   contains
      procedure :: columns => product_table_columns
      procedure :: columns_among => product_table_columns_among
      procedure :: add_columns => product_table_add_columns
   end type product_table_t

contains

   !> Plans the transforms of `n_channels` functions, in both directions or one; those that are planned already remain.
   subroutine new_transform(self, harmonics, torus, n_channels, error, directions, n_lanes, is_new)
      type(transform_t), intent(inout) :: self
      type(harmonics_t), intent(in) :: harmonics                      !! on half a torus with sums of one parity
      type(torus_t), intent(in) :: torus
      integer, intent(in) :: n_channels                               !! >= 1
      type(error_t), allocatable, intent(out) :: error
      integer, intent(in), optional :: directions                     !! one of hb_packed_fft%direction, default: both
      integer, intent(in), optional :: n_lanes                        !! threads that transform a function each; default: as many as
                                                                      !! the functions occupy
      logical, intent(out), optional :: is_new                        !! they were not planned
      logical :: is_planned
      logical, allocatable :: is_used(:)
      integer :: chosen, lanes, first(0:harmonics%highest(1)), h, j(harmonics%n_tones)
      complex(wp), dimension(0:harmonics%highest(1)) :: far, near

      chosen = direction%both
      if (present(directions)) chosen = directions
      lanes = min(n_channels, n_threads(n_channels*torus%n_total))
      if (present(n_lanes)) lanes = n_lanes
      is_planned = self%serves(harmonics, torus, n_channels, chosen, lanes)
      if (present(is_new)) is_new = .not. is_planned
      if (is_planned) return
      call self%destroy()
      self%harmonics = harmonics
      self%torus = torus
      self%directions = chosen
      call new_packed_fft(self%fft, torus, modulo(sum(harmonics%tuples(:, 1)), 2), harmonics%highest, chosen, error, lanes)
      if (allocated(error)) return
      self%n_channels = n_channels
      if (allocated(self%at)) deallocate (self%at, self%mirror_at)
      allocate (self%at(harmonics%n_harmonics), self%mirror_at(harmonics%n_harmonics))
      do h = 1, harmonics%n_harmonics
         j = harmonics%tuples(:, h)
         self%at(h) = self%fft%position(j)
         j = -j
         self%mirror_at(h) = self%fft%position(j)
      end do
      first = [(h, h=0, size(first) - 1)]                             ! of retained tuples none is negative
      call self%fft%factors(first, near, far)
      self%near_factor = near(harmonics%tuples(1, :))
      self%far_factor = far(harmonics%tuples(1, :))
      self%near_share = self%near_factor
      self%far_share = self%far_factor
      call self%fft%shares(self%near_factor, self%far_factor, self%near_share, self%far_share)
      allocate (is_used(self%fft%n_positions()), source=.false.)
      is_used(self%at) = .true.
      is_used(self%mirror_at) = .true.
      self%has_shared_positions = count(is_used) < 2*harmonics%n_harmonics - merge(1, 0, harmonics%has_zero)
   end subroutine new_transform

   !> Whether these transforms are planned.
   pure logical function transform_serves(self, harmonics, torus, n_channels, directions, n_lanes) result(serves)
      class(transform_t), intent(in) :: self
      type(harmonics_t), intent(in) :: harmonics
      type(torus_t), intent(in) :: torus
      integer, intent(in) :: n_channels, directions, n_lanes          !! as for `new_transform`

      serves = n_channels == self%n_channels .and. directions == self%directions
      if (serves) serves = n_lanes == self%fft%n_lanes()
      if (serves) serves = torus%equal(self%torus)
      if (serves) serves = harmonics%equal(self%harmonics)
   end function transform_serves

   !> Samples of the motions with coefficients `x`.
   subroutine transform_to_samples(self, x, samples)
      class(transform_t), intent(inout) :: self
      real(wp), intent(in) :: x(:, :)                                 !! (n_coefficients, n_channels)
      real(wp), intent(inout), contiguous :: samples(:, :)            !! (n_total, n_channels), aligned
      integer :: channel

      if (asserts_are_on) call assert(size(x, 1) == self%harmonics%n_coefficients, &
                                      "transform_to_samples", "coefficients of its harmonics")
      if (self%fft%n_lanes() == 1) then
         do channel = 1, self%n_channels
            call sample_motion(self, 1, x(:, channel), samples(:, channel))
         end do
      else
         !$omp parallel do num_threads(self%fft%n_lanes())
         do channel = 1, self%n_channels
            call sample_motion(self, this_thread(), x(:, channel), samples(:, channel))
         end do
      end if
   end subroutine transform_to_samples

   subroutine sample_motion(self, lane, x, samples)
      type(transform_t), intent(inout) :: self
      integer, intent(in) :: lane
      real(wp), intent(in) :: x(:)
      real(wp), intent(inout), contiguous :: samples(:)
      complex(wp) :: c(self%harmonics%n_harmonics)
      integer :: h

      associate (set => self%harmonics)
         if (set%has_zero) c(1) = x(1)
         do h = merge(2, 1, set%has_zero), set%n_harmonics
            c(h) = cmplx(x(set%cos_at(h)), -x(set%sin_at(h)), wp)
         end do
      end associate
      call sample_amplitudes(self, lane, c, samples)
   end subroutine sample_motion

   !> Samples of d/dt of the motions with coefficients `x`: tau_m = omega_m t, so the phase of harmonic j grows at the
   !> rate j.omega.
   subroutine transform_to_rate_samples(self, x, frequencies, samples)
      class(transform_t), intent(inout) :: self
      real(wp), intent(in) :: x(:, :)                                 !! (n_coefficients, n_channels)
      real(wp), intent(in) :: frequencies(:)                          !! j.omega [rad/s], (n_harmonics)
      real(wp), intent(inout), contiguous :: samples(:, :)            !! (n_total, n_channels), aligned
      integer :: channel

      if (asserts_are_on) call assert(size(x, 1) == self%harmonics%n_coefficients .and. &
                                      size(frequencies) == self%harmonics%n_harmonics, &
                                      "transform_to_rate_samples", "coefficients and frequencies of its harmonics")
      if (self%fft%n_lanes() == 1) then
         do channel = 1, self%n_channels
            call sample_rate(self, 1, x(:, channel), frequencies, samples(:, channel))
         end do
      else
         !$omp parallel do num_threads(self%fft%n_lanes())
         do channel = 1, self%n_channels
            call sample_rate(self, this_thread(), x(:, channel), frequencies, samples(:, channel))
         end do
      end if
   end subroutine transform_to_rate_samples

   subroutine sample_rate(self, lane, x, frequencies, samples)
      type(transform_t), intent(inout) :: self
      integer, intent(in) :: lane
      real(wp), intent(in) :: x(:), frequencies(:)
      real(wp), intent(inout), contiguous :: samples(:)
      complex(wp) :: c(self%harmonics%n_harmonics)
      integer :: h

      associate (set => self%harmonics)
         if (set%has_zero) c(1) = 0.0_wp
         do h = merge(2, 1, set%has_zero), set%n_harmonics
            c(h) = frequencies(h)*cmplx(x(set%sin_at(h)), x(set%cos_at(h)), wp)
         end do
      end associate
      call sample_amplitudes(self, lane, c, samples)
   end subroutine sample_rate

   !> Samples of Re sum c exp(i j.tau). The same elements of the spectrum are written each time, so that the others
   !> remain zero.
   subroutine sample_amplitudes(self, lane, c, samples)
      type(transform_t), intent(inout) :: self
      integer, intent(in) :: lane                                     !! of `fft`
      complex(wp), intent(in) :: c(:)                                 !! (n_harmonics)
      real(wp), intent(inout), contiguous :: samples(:)               !! (n_total), aligned
      complex(wp), pointer, contiguous :: spectrum(:)
      integer :: h

      spectrum => self%fft%spectrum(lane)
      if (self%has_shared_positions) then
         spectrum(self%at) = (0.0_wp, 0.0_wp)
         spectrum(self%mirror_at) = (0.0_wp, 0.0_wp)
         do h = 1, size(c)
            associate (near => spectrum(self%at(h)))
               near = near + self%near_factor(h)*c(h)
            end associate
            associate (far => spectrum(self%mirror_at(h)))
               far = far + self%far_factor(h)*conjg(c(h))
            end associate
         end do
      else
         do h = 1, size(c)
            spectrum(self%at(h)) = self%near_factor(h)*c(h)
            spectrum(self%mirror_at(h)) = self%far_factor(h)*conjg(c(h))
         end do
         if (self%harmonics%has_zero) spectrum(self%at(1)) = (self%near_factor(1) + self%far_factor(1))*real(c(1))
      end if
      call self%fft%to_samples(lane, samples)
   end subroutine sample_amplitudes

   !> Coefficients of the sampled functions in the retained harmonics (their projection).
   subroutine transform_to_coefficients(self, samples, x)
      class(transform_t), intent(inout) :: self
      real(wp), intent(inout), contiguous :: samples(:, :)            !! (n_total, n_channels), aligned; unchanged
      real(wp), intent(out) :: x(:, :)                                !! (n_coefficients, n_channels)
      integer :: channel

      if (asserts_are_on) call assert(size(x, 1) == self%harmonics%n_coefficients, &
                                      "transform_to_coefficients", "coefficients of its harmonics")
      if (self%fft%n_lanes() == 1) then
         do channel = 1, self%n_channels
            call find_coefficients(self, 1, samples(:, channel), x(:, channel))
         end do
      else
         !$omp parallel do num_threads(self%fft%n_lanes())
         do channel = 1, self%n_channels
            call find_coefficients(self, this_thread(), samples(:, channel), x(:, channel))
         end do
      end if
   end subroutine transform_to_coefficients

   !> Coefficients of one function alone, whatever the number of channels.
   subroutine transform_to_coefficients_of_one(self, samples, x, lane)
      class(transform_t), intent(inout) :: self
      real(wp), intent(inout), contiguous :: samples(:, :)            !! (n_total, 1), aligned; unchanged
      real(wp), intent(out) :: x(:)                                   !! (n_coefficients)
      integer, intent(in), optional :: lane                           !! of the calling thread, default 1

      if (present(lane)) then
         call find_coefficients(self, lane, samples(:, 1), x)
      else
         call find_coefficients(self, 1, samples(:, 1), x)
      end if
   end subroutine transform_to_coefficients_of_one

   !> Samples of one motion alone, likewise.
   subroutine transform_to_samples_of_one(self, x, samples, lane)
      class(transform_t), intent(inout) :: self
      real(wp), intent(in) :: x(:)                                    !! (n_coefficients)
      real(wp), intent(inout), contiguous :: samples(:)               !! (n_total), aligned
      integer, intent(in) :: lane                                     !! of the calling thread

      call sample_motion(self, lane, x, samples)
   end subroutine transform_to_samples_of_one

   subroutine find_coefficients(self, lane, samples, x)
      type(transform_t), intent(inout) :: self
      integer, intent(in) :: lane                                     !! of `fft`
      real(wp), intent(inout), contiguous :: samples(:)
      real(wp), intent(out) :: x(:)
      complex(wp), pointer, contiguous :: spectrum(:)
      complex(wp) :: c
      integer :: h
      real(wp) :: weight

      call self%fft%to_spectrum(lane, samples, spectrum)
      weight = 2.0_wp/self%torus%n_total
      associate (set => self%harmonics)
         do h = 1, set%n_harmonics
            c = weight*(self%near_share(h)*spectrum(self%at(h)) + self%far_share(h)*conjg(spectrum(self%mirror_at(h))))
            if (h == 1 .and. set%has_zero) then
               x(1) = 0.5_wp*real(c)
            else
               x(set%cos_at(h)) = real(c)
               x(set%sin_at(h)) = -aimag(c)
            end if
         end do
      end associate
   end subroutine find_coefficients

   !> Prepares products: plans the transform of their tuples and allocates their table at its first use.
   subroutine transform_prepare_products(self, table, n_parts, error, n_lanes)
      class(transform_t), intent(inout) :: self
      type(product_table_t), intent(inout) :: table
      integer, intent(in) :: n_parts                                  !! functions stored at once, the same number each time
      type(error_t), allocatable, intent(out) :: error
      integer, intent(in), optional :: n_lanes                        !! threads that tabulate at the same time, default 1

      if (allocated(table%at)) return
      call new_packed_fft(self%products, self%torus, 0, 2*self%harmonics%highest, direction%to_spectrum, error, n_lanes)
      if (.not. allocated(error)) call index_table(self, table, n_parts, error)
   end subroutine transform_prepare_products

   !> Fills one part of the table with `factor` times the function sampled in one column of `samples`, after `prepare_products`.
   subroutine transform_tabulate_product(self, samples, column, table, part, factor, lane)
      class(transform_t), intent(inout) :: self
      real(wp), intent(inout), contiguous :: samples(:, :)            !! (n_total, any); unchanged
      integer, intent(in) :: column
      type(product_table_t), intent(inout) :: table
      integer, intent(in) :: part
      real(wp), intent(in) :: factor
      integer, intent(in), optional :: lane                           !! of the calling thread, default 1
      complex(wp), pointer, contiguous :: spectrum(:)
      complex(wp) :: far, near
      integer :: i, m, n, n_inner, own

      own = 1
      if (present(lane)) own = lane
      call self%products%to_spectrum(own, samples(:, column), spectrum)
      n = size(table%at)
      n_inner = n/size(table%near_share)
      do m = 1, size(table%near_share)
         near = factor/self%torus%n_total*table%near_share(m)
         far = factor/self%torus%n_total*table%far_share(m)
         do i = (m - 1)*n_inner + 1, m*n_inner
            table%mean(i, part) = conjg(near*spectrum(table%at(i)) + far*conjg(spectrum(table%at(n + 1 - i))))
         end do
      end do
   end subroutine transform_tabulate_product

   !> Sets up the table over all m with |m_n| <= 2 N_n, wrapped onto the grid, so that it contains the exact
   !> derivative of the discrete projection, including aliases. On half a torus slopes have only even sums; others are
   !> never used.
   subroutine index_table(self, table, n_parts, error)
      type(transform_t), intent(in) :: self
      type(product_table_t), intent(inout) :: table
      integer, intent(in) :: n_parts
      type(error_t), allocatable, intent(inout) :: error
      integer :: extent(self%harmonics%n_tones), stride(self%harmonics%n_tones), j(self%harmonics%n_tones)
      complex(wp), dimension(4*self%harmonics%highest(1) + 1) :: far, near
      integer :: h, i, m, quotient, status

      associate (set => self%harmonics)
         extent = 4*set%highest + 1
         allocate (table%mean(product(extent), n_parts), stat=status)
         if (status /= 0) then
            call fail(error, "out of memory for the table of products")
            return
         end if
         stride(set%n_tones) = 1
         do m = set%n_tones - 1, 1, -1
            stride(m) = stride(m + 1)*extent(m + 1)
         end do
         table%centre = 1 + dot_product(2*set%highest, stride)
         allocate (table%offset(set%n_harmonics), table%at(product(extent)))
         do h = 1, set%n_harmonics
            table%offset(h) = dot_product(set%tuples(:, h), stride)
         end do
         do i = 1, size(table%at)
            quotient = i - 1
            do m = set%n_tones, 1, -1
               j(m) = modulo(quotient, extent(m)) - 2*set%highest(m)
               quotient = quotient/extent(m)
            end do
            table%at(i) = self%products%position(j)
         end do
         allocate (table%near_share(extent(1)), table%far_share(extent(1)))
         associate (n => 2*set%highest(1))
            call self%products%factors([(m, m=0, n)], near(n + 1:), far(n + 1:))
            near(:n) = far(extent(1):n + 2:-1)
            far(:n) = near(extent(1):n + 2:-1)
            call self%products%shares(near, far, table%near_share, table%far_share)
         end associate
      end associate
   end subroutine index_table

   !> The two columns, for cosine and sine of harmonic k, of the matrix of x -> projection of g x, with g a part of the table:
   !> its entry at cosine j, cosine k is mean g [cos((j-k).tau) + cos((j+k).tau)], and so on by the product formulas,
   !> half of that in the row of the zero tuple. Source: docs/why/theory.md, eq. (11).
   pure subroutine product_table_columns(self, part, set, k, cosine_column, sine_column)
      class(product_table_t), intent(in) :: self
      integer, intent(in) :: part
      type(harmonics_t), intent(in) :: set
      integer, intent(in) :: k                                        !! harmonic
      real(wp), intent(out), contiguous :: cosine_column(:), sine_column(:)  !! (n_coefficients); the sine of tuple zero is zero

      call self%columns_among(part, set, self%offset, self%offset(k), cosine_column, sine_column)
   end subroutine product_table_columns

   !> Columns as returned by `columns`, in the rows of some of the harmonics.
   pure subroutine product_table_columns_among(self, part, set, offsets, offset, cosine_column, sine_column)
      class(product_table_t), intent(in) :: self
      integer, intent(in) :: part
      type(harmonics_t), intent(in) :: set                            !! of these harmonics
      integer, intent(in) :: offsets(:)                               !! those of `offset`, (set%n_harmonics)
      integer, intent(in) :: offset                                   !! that of the column
      real(wp), intent(out), contiguous :: cosine_column(:), sine_column(:)  !! (set%n_coefficients)
      complex(wp) :: difference, total
      integer :: first, h, last, minus, plus, row

      last = 0
      row = 0
      if (set%has_zero) then
         cosine_column(1) = real(self%mean(self%centre + offset, part))
         sine_column(1) = aimag(self%mean(self%centre + offset, part))
         last = 1
         row = -1
      end if
      do while (last < set%n_harmonics)                               ! one contiguous run of the table after the other
         first = last + 1
         call find_run(offsets, first, last)
         minus = self%centre + offsets(first) - first - offset
         plus = self%centre + offsets(first) - first + offset
         do h = first, last
            total = self%mean(plus + h, part) + self%mean(minus + h, part)
            difference = self%mean(plus + h, part) - self%mean(minus + h, part)
            cosine_column(row + 2*h - 1) = real(total)
            cosine_column(row + 2*h) = aimag(total)
            sine_column(row + 2*h - 1) = aimag(difference)
            sine_column(row + 2*h) = -real(difference)
         end do
      end do
   end subroutine product_table_columns_among

   !> Adds a times the columns of `columns` and b times their quarter-turn: to that of the cosine b times that of the
   !> sine, to that of the sine -b times that of the cosine.
   pure subroutine product_table_add_columns(self, part, set, k, a, b, cosine_column, sine_column)
      class(product_table_t), intent(in) :: self
      integer, intent(in) :: part
      type(harmonics_t), intent(in) :: set
      integer, intent(in) :: k                                        !! harmonic
      real(wp), intent(in) :: a, b
      real(wp), intent(inout), contiguous :: cosine_column(:), sine_column(:)  !! (n_coefficients)
      complex(wp) :: difference, total
      integer :: first, h, last, minus, plus, row

      last = 0
      row = 0
      if (set%has_zero) then
         total = self%mean(self%centre + self%offset(k), part)
         cosine_column(1) = cosine_column(1) + a*real(total) + b*aimag(total)
         sine_column(1) = sine_column(1) + a*aimag(total) - b*real(total)
         last = 1
         row = -1
      end if
      do while (last < set%n_harmonics)
         first = last + 1
         call find_run(self%offset, first, last)
         minus = self%centre + self%offset(first) - first - self%offset(k)
         plus = self%centre + self%offset(first) - first + self%offset(k)
         do h = first, last
            total = self%mean(plus + h, part) + self%mean(minus + h, part)
            difference = self%mean(plus + h, part) - self%mean(minus + h, part)
            cosine_column(row + 2*h - 1) = cosine_column(row + 2*h - 1) + a*real(total) + b*aimag(difference)
            cosine_column(row + 2*h) = cosine_column(row + 2*h) + a*aimag(total) - b*real(difference)
            sine_column(row + 2*h - 1) = sine_column(row + 2*h - 1) + a*aimag(difference) - b*real(total)
            sine_column(row + 2*h) = sine_column(row + 2*h) - a*real(difference) - b*aimag(total)
         end do
      end do
   end subroutine product_table_add_columns

   !> Last of the harmonics from `first` on that are contiguous in a table.
   pure subroutine find_run(offsets, first, last)
      integer, intent(in) :: offsets(:)
      integer, intent(in) :: first
      integer, intent(out) :: last

      last = first
      do while (last < size(offsets))
         if (offsets(last + 1) /= offsets(last) + 1) exit
         last = last + 1
      end do
   end subroutine find_run

   !> Frees plans and memory; safe to call twice.
   subroutine transform_destroy(self)
      class(transform_t), intent(inout) :: self

      call self%fft%destroy()
      call self%products%destroy()
      self%n_channels = 0
   end subroutine transform_destroy
end module hb_transform
