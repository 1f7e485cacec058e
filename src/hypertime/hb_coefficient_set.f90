!> Coefficients of a motion by their tuples, whoever found them, and how far two such motions are apart.
!>
!> The error is the root of the mean square of the difference over hypertime, by Parseval's equation: in the mean over the
!> torus the square of sum a_j cos(j.tau) + b_j sin(j.tau) is a_0**2 + 1/2 sum over j /= 0 of (a_j**2 + b_j**2).
module hb_coefficient_set
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan, ieee_quiet_nan, ieee_value
   use hb_error, only: error_t
   use hb_harmonics, only: canonical_sign, harmonics_t, new_harmonics
   use hb_kinds, only: wp
   implicit none
   private
   public :: coefficient_set_t, compare_motions, new_coefficient_set

   type :: coefficient_set_t
      type(harmonics_t) :: harmonics
      real(wp), allocatable :: values(:, :, :)                        !! (cos and sin, n_harmonics, n_dofs); NaN: not known
   end type coefficient_set_t

contains

   !> Takes coefficients of any tuples, each once; of j and -j either may be given. Fails for a tuple that is there twice.
   subroutine new_coefficient_set(self, tuples, values, error)
      type(coefficient_set_t), intent(out) :: self
      integer, intent(in) :: tuples(:, :)                             !! (n_tones, n_harmonics)
      real(wp), intent(in) :: values(:, :, :)                         !! (cos and sin, n_harmonics, n_dofs)
      type(error_t), allocatable, intent(out) :: error
      integer :: h, k

      call new_harmonics(self%harmonics, tuples, error)
      if (allocated(error)) return
      allocate (self%values, mold=values)
      do h = 1, size(tuples, 2)
         k = self%harmonics%index_of(tuples(:, h))                    ! the zero tuple goes first
         self%values(1, k, :) = values(1, h, :)
         self%values(2, k, :) = canonical_sign(tuples(:, h))*values(2, h, :)
      end do
      if (self%harmonics%has_zero) self%values(2, 1, :) = 0.0_wp
   end subroutine new_coefficient_set

   !> Compares a motion with a reference of the same degrees of freedom: the rms of the difference over hypertime, summed
   !> over the degrees of freedom, relative to that of the reference, and the largest difference of one coefficient.
   !>
   !> What the motion lacks counts as zero; so does what the reference lacks, unless `only_tuples_of_reference`. What the
   !> reference does not know (NaN) is left out. NaN where nothing can be compared or the reference rests.
   subroutine compare_motions(found, reference, only_tuples_of_reference, relative_rms, largest)
      type(coefficient_set_t), intent(in) :: found, reference
      logical, intent(in) :: only_tuples_of_reference
      real(wp), intent(out) :: relative_rms                           !! [1]
      real(wp), intent(out) :: largest                                !! |difference| of a cosine or sine, as the values
      real(wp) :: difference, size_of_reference, term(2)
      integer :: h, i, k
      logical :: is_compared

      difference = 0.0_wp
      size_of_reference = 0.0_wp
      largest = 0.0_wp
      is_compared = .false.
      do h = 1, reference%harmonics%n_harmonics
         k = found%harmonics%index_of(reference%harmonics%tuples(:, h))
         do i = 1, size(reference%values, 3)
            if (any(ieee_is_nan(reference%values(:, h, i)))) cycle
            is_compared = .true.
            term = reference%values(:, h, i)
            size_of_reference = size_of_reference + weight_of(reference%harmonics, h)*sum(term**2)
            if (k > 0) term = term - found%values(:, k, i)
            call add(weight_of(reference%harmonics, h), term)
         end do
      end do
      if (.not. only_tuples_of_reference) then
         do k = 1, found%harmonics%n_harmonics
            if (reference%harmonics%index_of(found%harmonics%tuples(:, k)) > 0) cycle
            do i = 1, size(found%values, 3)
               call add(weight_of(found%harmonics, k), found%values(:, k, i))
            end do
         end do
      end if
      relative_rms = ieee_value(1.0_wp, ieee_quiet_nan)
      if (size_of_reference > 0.0_wp) relative_rms = sqrt(difference/size_of_reference)
      if (.not. is_compared) largest = ieee_value(1.0_wp, ieee_quiet_nan)

   contains

      subroutine add(weight, pair)
         real(wp), intent(in) :: weight, pair(2)

         difference = difference + weight*sum(pair**2)
         largest = max(largest, maxval(abs(pair)))
      end subroutine add
   end subroutine compare_motions

   !> Mean square of cos(j.tau) over the torus.
   pure real(wp) function weight_of(harmonics, h)
      type(harmonics_t), intent(in) :: harmonics
      integer, intent(in) :: h

      weight_of = 0.5_wp
      if (all(harmonics%tuples(:, h) == 0)) weight_of = 1.0_wp
   end function weight_of
end module hb_coefficient_set
