!> The dynamic stiffness of many coordinates at many frequencies, condensed from an interior of few degrees of freedom, by
!> matrices that all frequencies share: S_c(w) = K - w**2 M + i w D - S_lr(w) T(w) with the symbols of hb_dynamic_stiffness.
!>
!> A joint with a thousand retained degrees of freedom and thirty modes needs three real matrices and sixty columns a frequency
!> instead of a complex matrix a frequency.
module hb_shared_stiffness
   use hb_kinds, only: wp
   use hb_lapack, only: dgemm, zgemm, zgemv
   use hb_structure_block, only: structure_block_t
   use hb_threads, only: n_threads
   implicit none
   private
   public :: new_shared_stiffness, pays_to_share, shared_stiffness_t

   integer, parameter :: least_coordinates = 200             !! below, blocks of all frequencies take a few MB
   integer, parameter :: coordinates_per_interior = 8
   integer, parameter :: frequencies_per_product = 8         !! frequencies of one product, whatever the number of threads

   type :: shared_stiffness_t
      integer :: n = 0, n_frequencies = 0
      real(wp), allocatable :: frequencies(:)                !! [rad/s], (n_frequencies)
      real(wp), allocatable :: stiffness(:, :), mass(:, :)   !! K [N/m] and M [kg] between the coordinates, (n, n)
      real(wp), allocatable :: damping(:, :)                 !! D [N s/m], (n, n); not allocated where there is none
      complex(wp), allocatable :: coupling(:, :, :)          !! S_lr [N/m], (n, n_interior, n_frequencies)
      complex(wp), allocatable :: transfer(:, :, :)          !! T, (n_interior, n, n_frequencies)
      complex(wp), allocatable :: extra(:, :)                !! added to the diagonal [N/m], (n, n_frequencies), or not allocated
   contains
      procedure :: entry => shared_stiffness_entry
      procedure :: get_columns => shared_stiffness_get_columns
      procedure :: multiply => shared_stiffness_multiply
      procedure :: restricted_to => shared_stiffness_restricted_to
   end type shared_stiffness_t

contains

   !> Whether the shared matrices take less memory than a block for each frequency, of blocks that are large.
   pure logical function pays_to_share(n, n_interior, n_frequencies)
      integer, intent(in) :: n                               !! coordinates
      integer, intent(in) :: n_interior, n_frequencies

      pays_to_share = n >= least_coordinates .and. coordinates_per_interior*n_interior <= n .and. n_frequencies > 2
   end function pays_to_share

   !> Prepares the matrices of a block between the coordinates, without frequency-dependent parts; coupling and transfer follow.
   subroutine new_shared_stiffness(self, block, n, n_interior, frequencies)
      type(shared_stiffness_t), intent(out) :: self
      type(structure_block_t), intent(in) :: block
      integer, intent(in) :: n                               !! coordinates
      integer, intent(in) :: n_interior
      real(wp), intent(in) :: frequencies(:)                 !! [rad/s]

      self%n = n
      self%n_frequencies = size(frequencies)
      self%frequencies = frequencies
      self%stiffness = full(block%stiffness)
      self%mass = full(block%mass)
      if (any(abs(block%damping) > 0.0_wp)) self%damping = full(block%damping)
      allocate (self%coupling(n, n_interior, size(frequencies)), self%transfer(n_interior, n, size(frequencies)), &
                source=(0.0_wp, 0.0_wp))

   contains

      function full(values) result(matrix)
         real(wp), intent(in) :: values(:)                   !! of the entries
         real(wp), allocatable :: matrix(:, :)
         integer :: e

         allocate (matrix(n, n), source=0.0_wp)
         do e = 1, block%n_entries
            matrix(block%row(e), block%column(e)) = values(e)
         end do
      end function full
   end subroutine new_shared_stiffness

   !> Entry (i, k) at frequency number h [N/m].
   pure complex(wp) function shared_stiffness_entry(self, i, k, h) result(entry)
      class(shared_stiffness_t), intent(in) :: self
      integer, intent(in) :: i, k, h

      associate (w => self%frequencies(h))
         entry = cmplx(self%stiffness(i, k) - w**2*self%mass(i, k), 0.0_wp, wp)
         if (allocated(self%damping)) entry = entry + cmplx(0.0_wp, w*self%damping(i, k), wp)
      end associate
      entry = entry - sum(self%coupling(i, :, h)*self%transfer(:, k, h))
      if (allocated(self%extra) .and. i == k) entry = entry + self%extra(i, h)
   end function shared_stiffness_entry

   !> Successive columns from number `first` at frequency number h [N/m].
   subroutine shared_stiffness_get_columns(self, first, h, columns)
      class(shared_stiffness_t), intent(in) :: self
      integer, intent(in) :: first, h
      complex(wp), intent(out), contiguous :: columns(:, :)  !! (n, number of columns)
      complex(wp), parameter :: one = (1.0_wp, 0.0_wp)
      integer :: i, k

      associate (w => self%frequencies(h), n_interior => size(self%transfer, 1))
         do i = 1, size(columns, 2)
            k = first + i - 1
            columns(:, i) = cmplx(self%stiffness(:, k) - w**2*self%mass(:, k), 0.0_wp, wp)
            if (allocated(self%damping)) columns(:, i) = columns(:, i) + cmplx(0.0_wp, w*self%damping(:, k), wp)
         end do
         if (n_interior > 0) call zgemm("N", "N", self%n, size(columns, 2), n_interior, -one, self%coupling(:, :, h), self%n, &
                                        self%transfer(:, first:first + size(columns, 2) - 1, h), n_interior, one, columns, self%n)
      end associate
      if (.not. allocated(self%extra)) return
      do i = 1, size(columns, 2)
         k = first + i - 1
         columns(k, i) = columns(k, i) + self%extra(k, h)
      end do
   end subroutine shared_stiffness_get_columns

   !> Products S_c c of all frequencies.
   subroutine shared_stiffness_multiply(self, c, product)
      class(shared_stiffness_t), intent(in) :: self
      complex(wp), intent(in), contiguous :: c(:, :)         !! [m], (n, n_frequencies)
      complex(wp), intent(out), contiguous :: product(:, :)  !! [N], as c
      integer :: first, n

      n = n_threads(self%n*self%n*min(self%n_frequencies, frequencies_per_product))
      !$omp parallel do num_threads(n) if (n > 1)
      do first = 1, self%n_frequencies, frequencies_per_product
         associate (last => min(first + frequencies_per_product - 1, self%n_frequencies))
            call multiply_chunk(self, first, c(:, first:last), product(:, first:last))
         end associate
      end do
   end subroutine shared_stiffness_multiply

   !> The products of some successive frequencies: each shared matrix is read once.
   subroutine multiply_chunk(self, first, c, product)
      class(shared_stiffness_t), intent(in) :: self
      integer, intent(in) :: first
      complex(wp), intent(in), contiguous :: c(:, :)
      complex(wp), intent(out), contiguous :: product(:, :)
      complex(wp), parameter :: one = (1.0_wp, 0.0_wp)
      real(wp), dimension(:, :), allocatable :: motion, by_stiffness, other ! real parts, then imaginary parts
      complex(wp) :: interior(size(self%transfer, 1))
      integer :: h, k

      associate (n => self%n, m => size(c, 2))
         allocate (motion(n, 2*m), by_stiffness(n, 2*m), other(n, 2*m))
         motion(:, :m) = real(c)
         motion(:, m + 1:) = aimag(c)
         call dgemm("N", "N", n, 2*m, n, 1.0_wp, self%stiffness, n, motion, n, 0.0_wp, by_stiffness, n)
         call dgemm("N", "N", n, 2*m, n, 1.0_wp, self%mass, n, motion, n, 0.0_wp, other, n)
         do k = 1, m
            associate (w => self%frequencies(first + k - 1))
               product(:, k) = cmplx(by_stiffness(:, k) - w**2*other(:, k), by_stiffness(:, m + k) - w**2*other(:, m + k), wp)
            end associate
         end do
         if (allocated(self%damping)) then
            call dgemm("N", "N", n, 2*m, n, 1.0_wp, self%damping, n, motion, n, 0.0_wp, other, n)
            do k = 1, m
               associate (w => self%frequencies(first + k - 1))
                  product(:, k) = product(:, k) + w*cmplx(-other(:, m + k), other(:, k), wp)
               end associate
            end do
         end if
         associate (n_interior => size(self%transfer, 1))
            do k = 1, merge(m, 0, n_interior > 0)
               h = first + k - 1
               call zgemv("N", n_interior, n, one, self%transfer(:, :, h), n_interior, c(:, k), 1, 0*one, interior, 1)
               call zgemv("N", n, n_interior, -one, self%coupling(:, :, h), n, interior, 1, one, product(:, k), 1)
            end do
         end associate
         if (allocated(self%extra)) product = product + self%extra(:, first:first + m - 1)*c
      end associate
   end subroutine multiply_chunk

   !> The stiffness at some of the frequencies.
   pure function shared_stiffness_restricted_to(self, retained) result(part)
      class(shared_stiffness_t), intent(in) :: self
      integer, intent(in) :: retained(:)                     !! numbers of the frequencies
      type(shared_stiffness_t) :: part

      part%n = self%n
      part%n_frequencies = size(retained)
      allocate (part%frequencies(size(retained)), source=self%frequencies(retained))
      allocate (part%stiffness, source=self%stiffness)
      allocate (part%mass, source=self%mass)
      if (allocated(self%damping)) allocate (part%damping, source=self%damping)
      allocate (part%coupling(self%n, size(self%coupling, 2), size(retained)), source=self%coupling(:, :, retained))
      allocate (part%transfer(size(self%transfer, 1), self%n, size(retained)), source=self%transfer(:, :, retained))
      if (allocated(self%extra)) allocate (part%extra(self%n, size(retained)), source=self%extra(:, retained))
   end function shared_stiffness_restricted_to
end module hb_shared_stiffness
