!> The basis in which a model is solved: its discretisation or, if its equations are odd, the odd tuples on half of the grid.
!> Laws with f(-q, -v) = -f(q, v) and loads of odd tuples only permit motions u(tau + pi) = -u(tau), all phases
!> shifted, whose tuples have odd sums: both sides of the balance of the even ones vanish. This does not exclude other
!> motions: without the symmetry they are included in the search. Source: docs/why/theory.md, section 2.
module hb_model_basis
   use hb_amplitudes, only: amplitudes_t
   use hb_discretisation, only: discretisation_t, symmetry
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t, new_of_parity, tuple_text
   use hb_kinds, only: wp
   use hb_law, only: has_memory, law_box_t
   use hb_options, only: options_t
   use hb_system, only: system_t
   use hb_torus, only: torus_t
   implicit none
   private
   public :: asymmetry, even_part, find_basis, half_of_odd, is_solved_odd, max_even_share, why_not_odd

   real(wp), parameter :: max_even_share = 1.0e-10_wp                !! negligible even part of a motion, relative; 1e-9 would
                                                                      !! take curves beside branch points for symmetric ones

contains

   !> Finds the basis of a model, with a first guess that replaces its own. The odd basis is used if nothing prevents
   !> it, or if the user requests odd motions.
   subroutine find_basis(self, is_odd, system, discretisation, options, error, guess)
      type(discretisation_t), intent(out) :: self
      logical, intent(out) :: is_odd
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: guess(:)                      !! coefficients of all tuples, then all base frequencies

      is_odd = is_solved_odd(system, discretisation, options)
      if (is_odd .and. present(guess) .and. discretisation%symmetry == symmetry%auto) then
         associate (n => discretisation%harmonics%n_coefficients, n_all => size(guess) - system%tones%n_tones)
            is_odd = even_part(discretisation%harmonics, reshape(guess(:n_all), [n, n_all/n])) <= max_even_share
         end associate
      end if
      self = discretisation
      if (.not. is_odd) return
      call new_of_parity(self%harmonics, discretisation%harmonics, 1, error)
      self%torus = half_of_odd(system, discretisation)
   end subroutine find_basis

   !> Whether the motion is searched for among odd ones, unless a first guess from elsewhere is not odd. Loads and
   !> first guesses that are not read yet count as zero.
   logical function is_solved_odd(system, discretisation, options)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(amplitudes_t) :: start
      logical :: is_even(discretisation%harmonics%n_harmonics)
      integer :: i

      is_solved_odd = .false.
      if (discretisation%symmetry == symmetry%none .or. size(system%laws) == 0) return
      is_even = modulo(sum(discretisation%harmonics%tuples, dim=1), 2) == 0
      if (discretisation%symmetry == symmetry%auto) then
         if (options%start%from_integration) return
         ! a rigid law may base its augmentation on tuples that would be removed
         if (any(is_even) .and. any([(system%laws(i)%law%is_multiplier, i=1, size(system%laws))])) return
         start = options%start%spectrum%in_set(discretisation%harmonics)
         if (any([(is_even(i) .and. .not. start%is_zero_at(i), i=1, size(is_even))])) return
      end if
      is_solved_odd = why_not_odd(system%laws, discretisation%harmonics, discretisation%torus, &
                                  system%loads_in(discretisation%harmonics)) == ""
   end function is_solved_odd

   !> The grid for odd motions: half of it if it can be halved, otherwise all of it.
   type(torus_t) function half_of_odd(system, discretisation) result(torus)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation

      torus = discretisation%torus
      if (.not. torus%can_be_halved()) return
      if (.not. has_memory(system%laws) .or. system%tones%n_tones == 1) torus = torus%half()
   end function half_of_odd

   !> Why equations are not odd; empty if they are.
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

   !> Whether the entries of a tuple have an even sum.
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
end module hb_model_basis
