!> External loads: one cosine and sine at one degree of freedom and one tuple each, added into complex
!> amplitudes.
module hb_loads
   use hb_error, only: error_t, fail
   use hb_harmonics, only: canonical_sign, harmonics_t, tuple_text
   use hb_kinds, only: wp
   implicit none
   private
   public :: add_harmonic

contains

   !> Adds cos cos(j.tau) + sin sin(j.tau) to the amplitudes c = cos - i sin of one degree of freedom. For a
   !> tuple whose negative is the one that the set keeps the sine changes its sign. Fails for a tuple outside
   !> the set.
   pure subroutine add_harmonic(amplitudes, harmonics, dof, tuple, cosine, sine, error)
      complex(wp), intent(inout) :: amplitudes(:, :)                  !! (n_dofs, n_harmonics)
      type(harmonics_t), intent(in) :: harmonics
      integer, intent(in) :: dof                                      !! 1 to n_dofs
      integer, intent(in) :: tuple(:)                                 !! (n_tones)
      real(wp), intent(in) :: cosine, sine                            !! of a load [N], of a motion [m]
      type(error_t), allocatable, intent(out) :: error
      integer :: h

      h = harmonics%index_of(tuple)
      if (h == 0) then
         call fail(error, "tuple "//tuple_text(tuple)//" is not in the set of harmonics; give one entry per tone, "// &
            "and raise the order in &harmonics if it is too low")
         return
      end if
      if (all(tuple == 0)) then
         amplitudes(dof, h) = amplitudes(dof, h) + cosine
      else
         amplitudes(dof, h) = amplitudes(dof, h) + cmplx(cosine, -canonical_sign(tuple)*sine, wp)
      end if
   end subroutine add_harmonic
end module hb_loads
