!> Whether the equations of a model are odd: a motion of the opposite sign, half a period later in every tone, then is a motion
!> as well.
!>
!> Laws with f(-q, -v) = -f(q, v) and loads of odd tuples alone allow motions u(tau + pi) = -u(tau), all phases shifted, whose
!> tuples have odd sums. Others may exist beside these. Source: docs/why/theory.md, section 2.
module hb_odd_symmetry
   use hb_amplitudes, only: amplitudes_t
   use hb_harmonics, only: harmonics_t, tuple_text
   use hb_kinds, only: wp
   use hb_law, only: law_box_t
   use hb_torus, only: torus_t
   implicit none
   private
   public :: asymmetry, even_part, most_even, why_not_odd

   real(wp), parameter :: most_even = 1.0e-10_wp                      !! even part of a motion that counts as none, relative; 1e-9
                                                                      !! takes curves beside branch points for symmetric

contains

   !> Why equations are not odd; empty where they are.
   pure function why_not_odd(laws, harmonics, torus, loads) result(reason)
      type(law_box_t), intent(in) :: laws(:)
      type(harmonics_t), intent(in) :: harmonics
      type(torus_t), intent(in) :: torus                              !! of the laws
      type(amplitudes_t), intent(in), optional :: loads               !! [N]
      character(200) :: reason
      integer :: h, i

      reason = ""
      do i = 1, size(laws)
         if (.not. laws(i)%law%is_odd) reason = "the force of law '"//laws(i)%law%label//"' is not odd"
      end do
      do h = 1, harmonics%n_harmonics
         if (.not. present(loads)) exit
         if (.not. is_even(harmonics, h)) cycle
         if (.not. loads%is_zero_at(h)) reason = "there is a load of the even tuple "//tuple_text(harmonics%tuples(:, h))
      end do
      if (any(modulo(torus%n_samples, 2) /= 0)) reason = "the number of samples of a tone is odd"
      if (all([(is_even(harmonics, h), h=1, harmonics%n_harmonics)])) reason = "the set of harmonics has no odd tuple"
   end function why_not_odd

   !> Whether the entries of a tuple sum to an even number.
   pure logical function is_even(harmonics, h)
      type(harmonics_t), intent(in) :: harmonics
      integer, intent(in) :: h

      is_even = modulo(sum(harmonics%tuples(:, h)), 2) == 0
   end function is_even

   !> Largest coefficient of even tuples, relative to the largest of all.
   pure real(wp) function even_part(harmonics, u)
      type(harmonics_t), intent(in) :: harmonics
      real(wp), intent(in) :: u(:, :)                                 !! (n_coefficients, any)
      integer :: h

      even_part = 0.0_wp
      do h = 1, harmonics%n_harmonics
         if (.not. is_even(harmonics, h)) cycle
         even_part = max(even_part, maxval(abs(u(harmonics%cos_at(h), :))))
         if (harmonics%sin_at(h) > 0) even_part = max(even_part, maxval(abs(u(harmonics%sin_at(h), :))))
      end do
      if (even_part > 0.0_wp) even_part = even_part/maxval(abs(u))
   end function even_part

   !> Largest sum of samples half a period apart in every tone, relative to the largest sample: 0 for an odd function.
   pure real(wp) function asymmetry(torus, samples)
      type(torus_t), intent(in) :: torus                              !! whole, with even numbers of samples
      real(wp), intent(in) :: samples(:, :)                           !! (n_total, any)
      integer :: i, m, opposite, quotient, stride

      asymmetry = 0.0_wp
      do i = 1, torus%n_total
         quotient = i - 1
         opposite = 1
         stride = 1
         do m = 1, size(torus%n_samples)
            associate (n => torus%n_samples(m))
               opposite = opposite + stride*modulo(modulo(quotient, n) + n/2, n)
               quotient = quotient/n
               stride = stride*n
            end associate
         end do
         asymmetry = max(asymmetry, maxval(abs(samples(i, :) + samples(opposite, :))))
      end do
      if (asymmetry > 0.0_wp) asymmetry = asymmetry/maxval(abs(samples))
   end function asymmetry
end module hb_odd_symmetry
