!> Base frequencies of a quasi-periodic record, for a given set of harmonics.
!>
!> Each line of the spectrum (hb_frequency_analysis) may be any tuple of the set; of the resulting candidate base
!> frequencies those are selected whose harmonics carry most of the power of the record. The power of a harmonic is
!> that of its average with the window of hb_birkhoff.
module hb_record_tones
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_birkhoff, only: bump_weights, coefficients_at
   use hb_cancellation, only: work_is_over
   use hb_error, only: error_t
   use hb_frequency_analysis, only: find_frequencies
   use hb_kinds, only: two_pi, wp
   implicit none
   private
   public :: find_tones

   integer, parameter :: n_lines = 6                                  ! of each degree of freedom
   integer, parameter :: max_dofs = 4, max_tuples = 40, max_candidates = 300, max_of_several = 8
   integer, parameter :: highest_share = 3                            ! a line may be harmonic 1 to 3 of a tone
   real(wp), parameter :: as_good = 1.0e-3_wp                         ! difference of the power that does not count
   real(wp), parameter :: same_line = 0.3_wp                          ! in units of the resolution of the record
   real(wp), parameter :: smallest_line = 1.0e-3_wp                   ! relative to the motion

   !> A record and the data of the search.
   type :: search_t
      real(wp), allocatable :: x(:, :)                                ! the degrees of freedom that move most, (n_samples, any)
      real(wp), allocatable :: mean(:)                                ! of each of them
      real(wp), allocatable :: power(:)                               ! of each of them
      real(wp) :: start, step, resolution
      integer, allocatable :: tuples(:, :)                            ! the lowest ones but zero, (n_tones, any)
      logical, allocatable :: is_fundamental(:)                       ! the lowest ones except zero, (n_tones, any)
      integer, allocatable :: tones(:)                                ! the unknown ones
      real(wp), allocatable :: omega(:)                               ! of all tones, a guess or 0 if unknown
   end type search_t

contains

   !> Finds the unknown base frequencies. Of several that are equally good the one nearest to the guess is selected,
   !> without a guess the one with the largest fundamental; several unknown tones are in ascending order.
   subroutine find_tones(x, start, step, tuples, is_unknown, omega, share, error)
      real(wp), intent(in), contiguous :: x(:, :)                     !! record, (n_samples, n_dofs), at least 32 samples
      real(wp), intent(in) :: start, step                             !! time of the first sample, sampling interval [s]
      integer, intent(in) :: tuples(:, :)                             !! of the set, (n_tones, n_harmonics)
      logical, intent(in) :: is_unknown(:)                            !! (n_tones)
      real(wp), intent(inout) :: omega(:)                             !! [rad/s], (n_tones), if unknown a guess or 0
      real(wp), intent(out) :: share                                  !! of the power that they explain, 0: nothing found
      type(error_t), allocatable, intent(out) :: error
      type(search_t) :: search
      real(wp), allocatable :: candidates(:, :), fundamentals(:), lines(:), shares(:)
      integer :: best, c, m

      share = 0.0_wp
      search%start = start
      search%step = step
      search%resolution = two_pi/(size(x, 1)*step)
      allocate (search%tones, source=pack([(m, m=1, size(omega))], is_unknown))
      allocate (search%omega, source=omega)
      call choose_dofs(search, x)
      if (size(search%power) == 0) return
      call choose_tuples(search, tuples)
      call collect_lines(search, lines, error)
      if (allocated(error)) return
      if (size(search%tones) == 1) then
         call candidates_of_one(search, is_unknown, lines, candidates)
      else
         call candidates_of_several(size(search%tones), lines, candidates)
      end if
      if (size(candidates, 2) == 0) return
      allocate (shares(size(candidates, 2)), fundamentals(size(candidates, 2)), source=0.0_wp)
      do c = 1, size(shares)
         if (work_is_over()) exit
         call explain(search, candidates(:, c), shares(c), fundamentals(c))
         if (shares(c) > 1.0_wp + 10*as_good) shares(c) = 0.0_wp       ! two tuples share a line
      end do
      best = maxloc(shares, dim=1)
      if (size(search%tones) == 1) then
         associate (guess => omega(search%tones(1)), are_good => shares >= maxval(shares) - as_good)
            best = maxloc(fundamentals, mask=are_good, dim=1)
            if (guess > 0.0_wp) best = minloc(abs(candidates(1, :) - guess), mask=are_good, dim=1)
         end associate
      end if
      share = shares(best)
      if (share > 0.0_wp) omega(search%tones) = candidates(:, best)
   end subroutine find_tones

   !> The degrees of freedom with the largest motion, with the power of each.
   subroutine choose_dofs(self, x)
      type(search_t), intent(inout) :: self
      real(wp), intent(in) :: x(:, :)
      real(wp) :: mean(size(x, 2)), variance(size(x, 2)), weights(size(x, 1))
      integer, allocatable :: dofs(:)
      integer :: k

      weights = bump_weights(size(x, 1))
      mean = matmul(weights, x)
      do k = 1, size(x, 2)
         variance(k) = sum(weights*(x(:, k) - mean(k))**2)
      end do
      allocate (dofs(0), self%power(0))
      do k = 1, min(max_dofs, size(variance))
         if (maxval(variance) <= 0.0_wp) exit
         dofs = [dofs, maxloc(variance, dim=1)]
         self%power = [self%power, maxval(variance)]
         variance(dofs(k)) = -1.0_wp
      end do
      self%x = x(:, dofs)
      self%mean = mean(dofs)
   end subroutine choose_dofs

   !> The lowest tuples except zero.
   subroutine choose_tuples(self, tuples)
      type(search_t), intent(inout) :: self
      integer, intent(in) :: tuples(:, :)
      integer :: h, order(size(tuples, 2))
      integer, allocatable :: lowest(:)

      order = sum(abs(tuples), dim=1)
      where (order == 0) order = huge(1)
      allocate (lowest(0))
      do h = 1, min(max_tuples, count(order < huge(1)))
         lowest = [lowest, minloc(order, dim=1)]
         order(lowest(h)) = huge(1)
      end do
      self%tuples = tuples(:, lowest)
      self%is_fundamental = [(sum(abs(self%tuples(:, h))) == 1 .and. any(self%tuples(self%tones, h) /= 0), h=1, size(lowest))]
   end subroutine choose_tuples

   !> Lines of the spectra that are distinguished [rad/s].
   subroutine collect_lines(self, lines, error)
      type(search_t), intent(in) :: self
      real(wp), allocatable, intent(out) :: lines(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: found(n_lines)
      complex(wp) :: amplitudes(n_lines)
      integer :: i, k

      allocate (lines(0))
      do k = 1, size(self%power)
         call find_frequencies(self%x(:, k), self%start, self%step, found, amplitudes, error)
         if (allocated(error)) return
         do i = 1, n_lines
            if (.not. ieee_is_finite(found(i))) exit
            if (found(i) <= self%resolution .or. abs(amplitudes(i)) < smallest_line*sqrt(self%power(k))) cycle
            if (any(abs(lines - found(i)) < same_line*self%resolution)) cycle
            lines = [lines, found(i)]
         end do
      end do
   end subroutine collect_lines

   !> Frequencies of one unknown tone: each line as each low tuple.
   subroutine candidates_of_one(self, is_unknown, lines, candidates)
      type(search_t), intent(in) :: self
      logical, intent(in) :: is_unknown(:)
      real(wp), intent(in) :: lines(:)
      real(wp), allocatable, intent(out) :: candidates(:, :)
      real(wp) :: known, value
      integer :: h, i, n, sense

      n = 0
      allocate (candidates(1, max_candidates))
      do i = 1, size(lines)
         do h = 1, size(self%tuples, 2)
            associate (j => self%tuples(:, h), tone => self%tones(1))
               if (j(tone) == 0 .or. abs(j(tone)) > highest_share) cycle
               known = sum(j*self%omega, mask=.not. is_unknown)
               do sense = -1, 1, 2
                  value = (sense*lines(i) - known)/j(tone)
                  if (value <= self%resolution .or. n == max_candidates) cycle
                  if (any(abs(candidates(1, :n) - value) < 0.01_wp*same_line*self%resolution)) cycle
                  n = n + 1
                  candidates(1, n) = value
               end do
            end associate
         end do
      end do
      candidates = candidates(:, :n)
   end subroutine candidates_of_one

   !> All choices of as many lines as there are tones.
   subroutine candidates_of_several(n_tones, lines, candidates)
      integer, intent(in) :: n_tones
      real(wp), intent(in) :: lines(:)
      real(wp), allocatable, intent(out) :: candidates(:, :)
      integer :: chosen(n_tones), k, m, n

      n = min(max_of_several, size(lines))
      allocate (candidates(n_tones, 0))
      chosen = [(k, k=1, n_tones)]
      do while (chosen(n_tones) <= n)
         candidates = reshape([reshape(candidates, [size(candidates)]), ascending(lines(chosen))], &
                              [n_tones, size(candidates, 2) + 1])
         do m = n_tones, 1, -1
            if (chosen(m) < n - n_tones + m) exit
         end do
         if (m == 0) exit
         chosen(m:) = [(chosen(m) + 1 + k, k=0, n_tones - m)]
      end do
   end subroutine candidates_of_several

   !> Shares of the power of the record in harmonics of these tones, and in their fundamentals alone.
   subroutine explain(self, values, all_harmonics, fundamental)
      type(search_t), intent(in) :: self
      real(wp), intent(in) :: values(:)                               ! of the unknown tones
      real(wp), intent(out) :: all_harmonics, fundamental
      complex(wp) :: coefficients(size(self%tuples, 2))
      real(wp) :: tried(size(self%omega))
      integer :: k

      tried = self%omega
      tried(self%tones) = values
      all_harmonics = 0.0_wp
      fundamental = 0.0_wp
      do k = 1, size(self%power)
         call coefficients_at(self%x(:, k) - self%mean(k), self%start, self%step, matmul(tried, real(self%tuples, wp)), &
                              coefficients)
         all_harmonics = all_harmonics + 0.5_wp*sum(abs(coefficients)**2)
         fundamental = fundamental + 0.5_wp*sum(abs(coefficients)**2, mask=self%is_fundamental)
      end do
      all_harmonics = all_harmonics/sum(self%power)
      fundamental = fundamental/sum(self%power)
   end subroutine explain

   pure function ascending(values) result(sorted)
      real(wp), intent(in) :: values(:)
      real(wp) :: sorted(size(values))
      logical :: is_left(size(values))
      integer :: i, k

      is_left = .true.
      do i = 1, size(values)
         k = minloc(values, mask=is_left, dim=1)
         sorted(i) = values(k)
         is_left(k) = .false.
      end do
   end function ascending
end module hb_record_tones
