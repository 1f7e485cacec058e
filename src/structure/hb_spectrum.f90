!> Complex amplitudes c = cos - i sin of all degrees of freedom by tuples of the tones, of loads or of a first guess. In a set of
!> harmonics they are `amplitudes_t`.
module hb_spectrum
   use hb_amplitudes, only: amplitudes_t, new_amplitudes
   use hb_harmonics, only: canonical_sign, harmonics_t
   use hb_kinds, only: wp
   implicit none
   private
   public :: as_spectrum, new_spectrum, spectrum_t

   type :: spectrum_t
      integer :: n_dofs = 0
      integer, allocatable :: tuples(:, :)                            !! of canonical sign, each once, (n_tones, n_lines)
      complex(wp), allocatable :: values(:, :)                        !! [N] or [m], (n_dofs, n_lines)
   contains
      procedure :: add => spectrum_add
      procedure :: find_state => spectrum_find_state
      procedure :: frequencies => spectrum_frequencies
      procedure :: in_set => spectrum_in_set
      procedure :: is_zero => spectrum_is_zero
      procedure :: nonzero_tuples => spectrum_nonzero_tuples
   end type spectrum_t

contains

   !> Creates a spectrum without lines.
   pure subroutine new_spectrum(self, n_dofs, n_tones)
      type(spectrum_t), intent(out) :: self
      integer, intent(in) :: n_dofs, n_tones

      self%n_dofs = n_dofs
      allocate (self%tuples(n_tones, 0), self%values(n_dofs, 0))
   end subroutine new_spectrum

   !> Spectrum of a motion in a set.
   pure function as_spectrum(set, values) result(self)
      type(harmonics_t), intent(in) :: set
      complex(wp), intent(in) :: values(:, :)                         !! (n_dofs, n_harmonics)
      type(spectrum_t) :: self
      integer, allocatable :: which(:)
      integer :: h

      which = pack([(h, h=1, set%n_harmonics)], [(any(abs(values(:, h)) > 0.0_wp), h=1, set%n_harmonics)])
      self%n_dofs = size(values, 1)
      self%tuples = set%tuples(:, which)
      self%values = values(:, which)
   end function as_spectrum

   !> Adds Re(c exp(i j.tau)); of the mean value the real part counts.
   pure subroutine spectrum_add(self, tuple, values, dofs)
      class(spectrum_t), intent(inout) :: self
      integer, intent(in) :: tuple(:)                                 !! j, (n_tones)
      complex(wp), intent(in) :: values(:)                            !! c, (size(dofs)) or (n_dofs)
      integer, intent(in), optional :: dofs(:)                        !! default: all
      complex(wp) :: c
      integer :: i, k

      call find_or_add(self, canonical_sign(tuple)*tuple, k)
      do i = 1, size(values)
         c = values(i)
         if (all(tuple == 0)) c = real(c, wp)
         if (canonical_sign(tuple) < 0) c = conjg(c)
         associate (sum => self%values(:, k))
            if (present(dofs)) then
               sum(dofs(i)) = sum(dofs(i)) + c
            else
               sum(i) = sum(i) + c
            end if
         end associate
      end do
   end subroutine spectrum_add

   !> Finds the line of a tuple, and adds one of zeros if there is none.
   pure subroutine find_or_add(self, tuple, k)
      class(spectrum_t), intent(inout) :: self
      integer, intent(in) :: tuple(:)
      integer, intent(out) :: k
      complex(wp), allocatable :: values(:, :)
      integer, allocatable :: tuples(:, :)
      integer :: n

      n = size(self%tuples, 2)
      do k = 1, n
         if (all(self%tuples(:, k) == tuple)) return
         if (precedes(tuple, self%tuples(:, k))) exit
      end do
      allocate (tuples(size(tuple), n + 1), values(self%n_dofs, n + 1))
      tuples(:, :k - 1) = self%tuples(:, :k - 1)
      tuples(:, k) = tuple
      tuples(:, k + 1:) = self%tuples(:, k:)
      values(:, :k - 1) = self%values(:, :k - 1)
      values(:, k) = (0.0_wp, 0.0_wp)
      values(:, k + 1:) = self%values(:, k:)
      call move_alloc(tuples, self%tuples)
      call move_alloc(values, self%values)
   end subroutine find_or_add

   pure logical function precedes(tuple, other)
      integer, intent(in) :: tuple(:), other(:)
      integer :: first

      first = findloc(tuple /= other, .true., dim=1)
      precedes = .false.
      if (first > 0) precedes = tuple(first) < other(first)
   end function precedes

   !> Frequencies j.omega of the lines [rad/s], (n_lines).
   pure function spectrum_frequencies(self, omega) result(frequencies)
      class(spectrum_t), intent(in) :: self
      real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s], (n_tones)
      real(wp) :: frequencies(size(self%tuples, 2)), tuples(size(omega), size(self%tuples, 2))

      tuples = real(self%tuples, wp)
      frequencies = matmul(omega, tuples)
   end function spectrum_frequencies

   !> Displacements and velocities of a motion at time 0.
   pure subroutine spectrum_find_state(self, omega, q, v)
      class(spectrum_t), intent(in) :: self
      real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s], (n_tones)
      real(wp), intent(out) :: q(:), v(:)                             !! [m], [m/s], (n_dofs)
      real(wp) :: frequencies(size(self%tuples, 2))
      integer :: k

      frequencies = self%frequencies(omega)
      q = sum(real(self%values), 2)
      v = 0.0_wp
      do k = 1, size(frequencies)
         v = v - frequencies(k)*aimag(self%values(:, k))
      end do
   end subroutine spectrum_find_state

   !> Amplitudes in a set, of the lines whose tuples it has. A set of other base frequencies may have their negatives: derivatives
   !> by j.omega then change their sign as well.
   pure function spectrum_in_set(self, set, are_slopes) result(amplitudes)
      class(spectrum_t), intent(in) :: self
      type(harmonics_t), intent(in) :: set
      logical, intent(in), optional :: are_slopes                     !! derivatives by j.omega, otherwise amplitudes
      type(amplitudes_t) :: amplitudes
      real(wp) :: turned

      turned = 1.0_wp
      if (present(are_slopes)) turned = merge(-1.0_wp, 1.0_wp, are_slopes)
      if (allocated(self%tuples)) then
         call store_lines(self, set, turned, amplitudes)
      else
         call new_amplitudes(amplitudes, self%n_dofs, set%n_harmonics)
      end if
   end function spectrum_in_set

   pure subroutine store_lines(self, set, turned, amplitudes)
      type(spectrum_t), intent(in) :: self
      type(harmonics_t), intent(in) :: set
      real(wp), intent(in) :: turned                                  !! factor of lines whose tuples change their sign
      type(amplitudes_t), intent(inout) :: amplitudes
      integer :: i, k, numbers(size(self%tuples, 2)), tuple(set%n_tones)
      logical :: is_turned(size(self%tuples, 2))

      do k = 1, size(numbers)
         tuple = matmul(set%units, self%tuples(:, k))
         numbers(k) = set%index_of(tuple)
         is_turned(k) = canonical_sign(tuple) < 0
      end do
      amplitudes%n_dofs = self%n_dofs
      amplitudes%n_harmonics = set%n_harmonics
      allocate (amplitudes%harmonics(count(numbers > 0)), amplitudes%values(self%n_dofs, count(numbers > 0)))
      do k = 1, size(numbers)
         if (numbers(k) == 0) cycle
         i = count(numbers > 0 .and. numbers <= numbers(k))           ! ascending
         amplitudes%harmonics(i) = numbers(k)
         amplitudes%values(:, i) = self%values(:, k)
         if (is_turned(k)) amplitudes%values(:, i) = turned*conjg(self%values(:, k))
      end do
   end subroutine store_lines

   !> Whether there are no lines, or all are zero.
   pure logical function spectrum_is_zero(self) result(is_zero)
      class(spectrum_t), intent(in) :: self

      is_zero = .not. allocated(self%values)
      if (.not. is_zero) is_zero = all(abs(self%values) <= 0.0_wp)
   end function spectrum_is_zero

   !> Tuples of the lines that are not zero, (n_tones, any).
   pure function spectrum_nonzero_tuples(self) result(tuples)
      class(spectrum_t), intent(in) :: self
      integer, allocatable :: tuples(:, :)
      integer :: k

      tuples = self%tuples(:, pack([(k, k=1, size(self%tuples, 2))], &
                                   [(any(abs(self%values(:, k)) > 0.0_wp), k=1, size(self%tuples, 2))]))
   end function spectrum_nonzero_tuples
end module hb_spectrum
