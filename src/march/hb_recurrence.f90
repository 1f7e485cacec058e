!> Whether a record repeats as a motion of given tones does: after a time in which all of their phases come back.
!>
!> A motion of given tones is a function of their phases. After a shift in which each tone makes nearly whole turns, and before
!> it, its
!> record is nearly the same: the mean of both differs from it by a curvature times the square of what is missing to whole turns. A
!> motion with a period of n turns repeats where whole turns are multiples of n and changes elsewhere; one without order nowhere
!> does. With one tone this is the stroboscopic section. Source: J.-P. Eckmann, S. Oliffson Kamphorst and D. Ruelle, Recurrence
!> plots
!> of dynamical systems, Europhysics Letters 4 (1987) 973-977.
module hb_recurrence
   use hb_kinds, only: wp
   implicit none
   private
   public :: defect_of, find_return

   real(wp), parameter :: least_gain = 0.7_wp                         ! what is missing to whole turns, beside a shorter shift
   real(wp), parameter :: exact = 1.0e-9_wp                           ! turns
   real(wp), parameter :: farthest = 0.05_wp                          ! turns that may be missing

contains

   !> Largest defect of the record over all ways in which numbers of turns can be odd multiples of `part`: the root mean square of
   !> what the record differs from the mean of itself before and after, relative. Negative where the record is too short to tell.
   function defect_of(x, scale, turns, part) result(defect)
      real(wp), intent(in) :: x(:, :)                                 !! record, (n_samples, any)
      real(wp), intent(in) :: scale(:)                                !! of each column
      real(wp), intent(in) :: turns(:)                                !! of each tone from one sample to the next
      integer, intent(in) :: part                                     !! turns in which the motion may repeat
      real(wp) :: defect
      integer :: class, k, n, shift

      n = size(x, 1)
      defect = -1.0_wp
      do class = 1, 2**size(turns) - 1
         call find_return(turns, part, class, n/3, shift)
         if (shift == 0) cycle
         do k = 1, size(x, 2)
            associate (between => 0.5_wp*(x(:n - 2*shift, k) + x(2*shift + 1:, k)) - x(shift + 1:n - shift, k))
               defect = max(defect, norm2(between)/(scale(k)*sqrt(real(n - 2*shift, wp))))
            end associate
         end do
      end do
   end function defect_of

   !> Finds the shift after which all tones have made nearly a multiple of `part` turns, an odd one where the bit of the tone in
   !> `class` is set, an even one elsewhere; 0 where there is none. Of equally good ones the shortest.
   pure subroutine find_return(turns, part, class, longest, shift)
      real(wp), intent(in) :: turns(:)                                !! of each tone from one sample to the next
      integer, intent(in) :: part, class
      integer, intent(in) :: longest                                  !! samples
      integer, intent(out) :: shift                                   !! samples
      real(wp) :: best, missing, whole
      integer :: i, m

      shift = 0
      best = farthest/least_gain
      do i = 1, longest
         missing = 0.0_wp
         do m = 1, size(turns)
            whole = real(merge(part, 0, btest(class, m - 1)), wp)
            missing = max(missing, abs(modulo(i*turns(m) - whole + part, 2.0_wp*part) - part))
            if (missing >= least_gain*best - exact) exit
         end do
         if (missing >= least_gain*best - exact) cycle
         best = missing
         shift = i
      end do
   end subroutine find_return
end module hb_recurrence
