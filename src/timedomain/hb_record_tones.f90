!> Base frequencies of a quasi-periodic record, for a given set of harmonics.
!>
!> Each line of the spectrum (hb_frequency_analysis) may be any tuple of the set; of the base frequencies that this makes possible
!> those are taken whose harmonics carry most of the power of the record. The power of a harmonic is that of its average with the
!> window of hb_birkhoff.
module hb_record_tones
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_birkhoff, only: bump_weights, coefficients_at
   use hb_error, only: error_t
   use hb_frequency_analysis, only: find_frequencies
   use hb_kinds, only: two_pi, wp
   use hb_watch, only: work_is_over
   implicit none
   private
   public :: find_tones

   integer, parameter :: n_lines = 6                                  ! of each degree of freedom
   integer, parameter :: most_dofs = 4, most_tuples = 40, most_candidates = 300, most_of_several = 8
   integer, parameter :: highest_share = 3                            ! lines are taken for harmonics 1 to 3 of a tone
   real(wp), parameter :: as_good = 1.0e-3_wp                         ! of the power
   real(wp), parameter :: same_line = 0.3_wp                          ! in units of the resolution of the record
   real(wp), parameter :: smallest_line = 1.0e-3_wp                   ! relative to the motion

contains

   !> Finds the unknown ones among the base frequencies. Of several that are equally good the one nearest to the guess is taken,
   !> without a guess the one with the largest fundamental; several unknown tones are in ascending order.
   subroutine find_tones(x, start, step, tuples, is_unknown, omega, share, error)
      real(wp), intent(in), contiguous :: x(:, :)                     !! record, (n_samples, n_dofs), at least 32 samples
      real(wp), intent(in) :: start, step                             !! time of the first sample, distance of two [s]
      integer, intent(in) :: tuples(:, :)                             !! of the set, (n_tones, n_harmonics)
      logical, intent(in) :: is_unknown(:)                            !! (n_tones)
      real(wp), intent(inout) :: omega(:)                             !! [rad/s], (n_tones), where unknown a guess or 0
      real(wp), intent(out) :: share                                  !! of the power that they explain, 0: nothing found
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: candidates(:, :), lines(:), fundamentals(:), power(:), shares(:), weights(:)
      integer, allocatable :: dofs(:), lowest(:), tones(:)
      logical, allocatable :: is_fundamental(:)                       ! of an unknown tone, as lowest
      real(wp) :: best_distance, distance, resolution
      integer :: c, best, m

      share = 0.0_wp
      tones = pack([(m, m=1, size(omega))], is_unknown)
      resolution = two_pi/(size(x, 1)*step)
      weights = bump_weights(size(x, 1))
      call choose_dofs()
      if (size(dofs) == 0) return
      call choose_tuples()
      call collect_lines()
      if (allocated(error)) return
      if (size(tones) == 1) then
         call candidates_of_one()
      else
         call candidates_of_several()
      end if
      if (size(candidates, 2) == 0) return
      allocate (shares(size(candidates, 2)), fundamentals(size(candidates, 2)))
      shares = 0.0_wp
      fundamentals = 0.0_wp
      do c = 1, size(shares)
         if (work_is_over()) exit
         call explain(candidates(:, c), shares(c), fundamentals(c))
         if (shares(c) > 1.0_wp + 10*as_good) shares(c) = 0.0_wp       ! two tuples share a line
      end do
      best = maxloc(shares, dim=1)
      if (size(tones) == 1) then
         best_distance = huge(1.0_wp)
         do c = 1, size(shares)
            if (shares(c) < maxval(shares) - as_good) cycle
            distance = -fundamentals(c)
            if (omega(tones(1)) > 0.0_wp) distance = abs(candidates(1, c) - omega(tones(1)))
            if (distance >= best_distance) cycle
            best_distance = distance
            best = c
         end do
      end if
      share = shares(best)
      if (share > 0.0_wp) omega(tones) = candidates(:, best)

   contains

      !> The degrees of freedom that move most, with the power of each.
      subroutine choose_dofs()
         real(wp) :: variance(size(x, 2))
         integer :: k

         do k = 1, size(x, 2)
            variance(k) = sum(weights*(x(:, k) - sum(weights*x(:, k)))**2)
         end do
         allocate (dofs(0))
         do k = 1, min(most_dofs, size(variance))
            if (maxval(variance) <= 0.0_wp) exit
            dofs = [dofs, maxloc(variance, dim=1)]
            if (k == 1) allocate (power(0))
            power = [power, maxval(variance)]
            variance(dofs(k)) = -1.0_wp
         end do
      end subroutine choose_dofs

      !> The lowest tuples but zero.
      subroutine choose_tuples()
         integer :: order(size(tuples, 2)), h

         order = sum(abs(tuples), dim=1)
         where (order == 0) order = huge(1)
         allocate (lowest(0))
         do h = 1, min(most_tuples, count(order < huge(1)))
            lowest = [lowest, minloc(order, dim=1)]
            order(lowest(h)) = huge(1)
         end do
         is_fundamental = [(sum(abs(tuples(:, lowest(h)))) == 1 .and. any(tuples(tones, lowest(h)) /= 0), &
                            h=1, size(lowest))]
      end subroutine choose_tuples

      subroutine collect_lines()
         real(wp) :: found(n_lines)
         complex(wp) :: amplitudes(n_lines)
         integer :: i, k

         allocate (lines(0))
         do k = 1, size(dofs)
            call find_frequencies(x(:, dofs(k)), start, step, found, amplitudes, error)
            if (allocated(error)) return
            do i = 1, n_lines
               if (.not. ieee_is_finite(found(i))) exit
               if (found(i) <= resolution .or. abs(amplitudes(i)) < smallest_line*sqrt(power(k))) cycle
               if (any(abs(lines - found(i)) < same_line*resolution)) cycle
               lines = [lines, found(i)]
            end do
         end do
      end subroutine collect_lines

      subroutine candidates_of_one()
         real(wp) :: known, value
         integer :: h, i, n, sense, tone

         tone = tones(1)
         n = 0
         allocate (candidates(1, most_candidates))
         do i = 1, size(lines)
            do h = 1, size(lowest)
               associate (j => tuples(:, lowest(h)))
                  if (j(tone) == 0 .or. abs(j(tone)) > highest_share) cycle
                  known = sum(j*omega, mask=.not. is_unknown)
                  do sense = -1, 1, 2
                     value = (sense*lines(i) - known)/j(tone)
                     if (value <= resolution .or. n == most_candidates) cycle
                     if (any(abs(candidates(1, :n) - value) < 0.01_wp*same_line*resolution)) cycle
                     n = n + 1
                     candidates(1, n) = value
                  end do
               end associate
            end do
         end do
         candidates = candidates(:, :n)
      end subroutine candidates_of_one

      !> All choices of as many lines as there are tones.
      subroutine candidates_of_several()
         integer :: chosen(size(tones)), k, m, n

         n = min(most_of_several, size(lines))
         allocate (candidates(size(tones), 0))
         chosen = [(k, k=1, size(tones))]
         do while (chosen(size(tones)) <= n)
            candidates = reshape([reshape(candidates, [size(candidates)]), ascending(lines(chosen))], &
                                 [size(tones), size(candidates, 2) + 1])
            do m = size(tones), 1, -1
               if (chosen(m) < n - size(tones) + m) exit
            end do
            if (m == 0) exit
            chosen(m:) = [(chosen(m) + 1 + k, k=0, size(tones) - m)]
         end do
      end subroutine candidates_of_several

      !> Shares of the power of the record that harmonics of these tones carry, and their fundamentals alone.
      subroutine explain(values, all_harmonics, fundamental)
         real(wp), intent(in) :: values(:)
         real(wp), intent(out) :: all_harmonics, fundamental
         complex(wp) :: coefficients(size(lowest))
         real(wp) :: tried(size(omega))
         integer :: k

         tried = omega
         tried(tones) = values
         all_harmonics = 0.0_wp
         fundamental = 0.0_wp
         do k = 1, size(dofs)
            call coefficients_at(x(:, dofs(k)) - sum(weights*x(:, dofs(k))), start, step, &
                                 matmul(tried, real(tuples(:, lowest), wp)), coefficients)
            all_harmonics = all_harmonics + 0.5_wp*sum(abs(coefficients)**2)
            fundamental = fundamental + 0.5_wp*sum(abs(coefficients)**2, mask=is_fundamental)
         end do
         all_harmonics = all_harmonics/sum(power)
         fundamental = fundamental/sum(power)
      end subroutine explain
   end subroutine find_tones

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
