!> Whether a record repeats as a motion of given tones does: after a time in which all their phases return.
!>
!> A motion of given tones is a function of their phases. Shifted forwards and backwards by a time in which each tone
!> makes nearly whole cycles, its record is nearly the same: the mean of both differs from it by a curvature times the
!> square of the phase defect. A motion with a period of n cycles repeats where the numbers of cycles are multiples of
!> n and differs elsewhere; an aperiodic one never repeats. With one tone this is the stroboscopic section. Source:
!> J.-P. Eckmann, S. Oliffson Kamphorst and D. Ruelle, Recurrence plots of dynamical systems, Europhysics Letters 4
!> (1987) 973-977.
!>
!> Tones whose ratio is close to that of small integers return accurately after these, and inaccurately after any
!> other time that is not very long. The defect of a return is therefore scaled to the phase defect of the most
!> accurate one. If tones have a common period, a motion that repeats after it is one of them, whatever differs after
!> other times.
module hb_recurrence
   use hb_cancellation, only: work_is_over
   use hb_kinds, only: wp
   implicit none
   private
   public :: defect_of, find_return, repetition, turns_to_repeat

   !> Results other than a number of cycles after which a record repeats.
   type :: repetition_t
      integer :: none = 0                                             !! it does not repeat
      integer :: not_known = -1
   end type repetition_t
   type(repetition_t), parameter :: repetition = repetition_t()

   integer, parameter :: max_parts = 8                               ! largest number of cycles after which a motion may repeat
   real(wp), parameter :: min_gain = 0.7_wp                         ! phase defect, relative to a shorter shift
   real(wp), parameter :: exact_phase_defect = 1.0e-9_wp              ! cycles
   real(wp), parameter :: max_phase_defect = 0.05_wp                  ! largest phase defect, in cycles
   real(wp), parameter :: negligible_phase_defect = 1.0e-4_wp         ! likewise: negligible
   real(wp), parameter :: max_negligible_ratio = 0.3_wp               ! ratio below which one part of the motion is negligible
   real(wp), parameter :: min_significant_ratio = 0.7_wp              ! ratio above which it is significant

contains

   !> Cycles of the tones after which a record repeats: 1 for a motion of them, 2 to 8 for one that takes several;
   !> otherwise a `repetition`.
   function turns_to_repeat(x, scale, turns, share, allowed) result(part)
      real(wp), intent(in) :: x(:, :)                                 !! record, (n_samples, any)
      real(wp), intent(in) :: scale(:)                                !! of each column
      real(wp), intent(in) :: turns(:)                                !! of each tone from one sample to the next
      real(wp), intent(in) :: share                                   !! largest root mean square of a column, relative
      real(wp), intent(in) :: allowed                                 !! permitted defect of a motion that repeats
      integer :: class, part
      real(wp), dimension(2**size(turns) - 1, max_parts) :: defect, missing
      real(wp) :: in_one, largest(max_parts), least, within
      logical :: returns(2**size(turns) - 1, max_parts)

      defect = -1.0_wp
      missing = 1.0_wp
      do part = 1, max_parts
         if (work_is_over()) exit
         call find_defects(x, scale, turns, part, defect(:, part), missing(:, part))
      end do
      returns = defect >= 0.0_wp
      class = class_of_common_period(turns, size(x, 1)/3)
      part = 1
      if (class > 0) then
         if (returns(class, 1) .and. defect(class, 1) <= allowed) return
      end if
      largest = merge(maxval(defect, dim=1), 1.0_wp, any(returns, dim=1))
      least = minval(largest(2:))
      part = findloc(largest <= max(allowed, 2.0_wp*least), .true., dim=1)
      if (share > allowed .and. part > 1) then
         within = max(negligible_phase_defect, maxval(missing(:, part), mask=returns(:, part)))
         in_one = maxval(defect(:, 1)*(within/max(within, missing(:, 1)))**2, mask=returns(:, 1))
         if (least <= max_negligible_ratio*min(in_one, share)) return
      end if
      part = repetition%not_known
      if (share <= allowed .or. largest(1) <= max(allowed, max_negligible_ratio*share)) then
         part = 1
      else if (any(returns(:, 1)) .and. all(defect(:, 1) >= min_significant_ratio*share .or. .not. returns(:, 1))) then
         part = repetition%none
      end if
   end function turns_to_repeat

   !> Tones that make an odd number of cycles, a bit each, in the shortest time in which all make whole ones; 0: there is none.
   pure integer function class_of_common_period(turns, longest) result(class)
      real(wp), intent(in) :: turns(:)                                !! of each tone from one sample to the next
      integer, intent(in) :: longest                                  !! samples
      real(wp) :: cycles(size(turns))
      integer :: k, m

      class = 0
      do k = 1, int(longest*turns(1))
         cycles = k*(turns/turns(1))
         if (any(abs(cycles - anint(cycles)) > exact_phase_defect*k)) cycle
         class = sum([(merge(2**(m - 1), 0, modulo(nint(cycles(m)), 2) == 1), m=1, size(turns))])
         return
      end do
   end function class_of_common_period

   !> Largest defect of the record over all combinations in which numbers of cycles can be odd multiples of `part`,
   !> negative if the record is too short.
   real(wp) function defect_of(x, scale, turns, part)
      real(wp), intent(in) :: x(:, :), scale(:), turns(:)             !! as in `turns_to_repeat`
      integer, intent(in) :: part                                     !! cycles in which the motion may repeat
      real(wp), dimension(2**size(turns) - 1) :: defect, missing

      call find_defects(x, scale, turns, part, defect, missing)
      defect_of = maxval(defect)
   end function defect_of

   !> For each combination in which numbers of cycles can be odd multiples of `part`, computes the root mean square of
   !> the difference of the record from the mean of itself shifted forwards and backwards, relative: -1 if the record
   !> is too short.
   subroutine find_defects(x, scale, turns, part, defect, missing)
      real(wp), intent(in) :: x(:, :), scale(:), turns(:)             !! as in `turns_to_repeat`
      integer, intent(in) :: part
      real(wp), intent(out) :: defect(:), missing(:)                  !! and phase defects in cycles, (2**n_tones - 1)
      integer :: class, k, n, shift

      n = size(x, 1)
      defect = -1.0_wp
      do class = 1, size(defect)
         call find_return(turns, part, class, n/3, shift, missing(class))
         if (shift == 0) cycle
         do k = 1, size(x, 2)
            associate (between => 0.5_wp*(x(:n - 2*shift, k) + x(2*shift + 1:, k)) - x(shift + 1:n - shift, k))
               defect(class) = max(defect(class), norm2(between)/(scale(k)*sqrt(real(n - 2*shift, wp))))
            end associate
         end do
      end do
   end subroutine find_defects

   !> Finds the shift after which all tones have made nearly a multiple of `part` cycles, an odd one if the bit of the
   !> tone in `class` is set, an even one otherwise; 0 if there is none. Of equally good ones the shortest.
   pure subroutine find_return(turns, part, class, longest, shift, nearest)
      real(wp), intent(in) :: turns(:)                                !! of each tone from one sample to the next
      integer, intent(in) :: part, class
      integer, intent(in) :: longest                                  !! samples
      integer, intent(out) :: shift                                   !! samples
      real(wp), intent(out) :: nearest                                !! phase defect in cycles, of the tone with the largest
      real(wp) :: missing, whole
      integer :: i, m

      shift = 0
      nearest = max_phase_defect/min_gain
      do i = 1, longest
         missing = 0.0_wp
         do m = 1, size(turns)
            whole = real(merge(part, 0, btest(class, m - 1)), wp)
            missing = max(missing, abs(modulo(i*turns(m) - whole + part, 2.0_wp*part) - part))
            if (missing >= min_gain*nearest - exact_phase_defect) exit
         end do
         if (missing >= min_gain*nearest - exact_phase_defect) cycle
         nearest = missing
         shift = i
      end do
   end subroutine find_return
end module hb_recurrence
