!> Numbers below the range of single precision as zero: processors take many times as long for gradual underflow.
module hb_underflow
   use, intrinsic :: ieee_arithmetic, only: ieee_get_underflow_mode, ieee_set_underflow_mode, ieee_support_underflow_control
   use hb_kinds, only: sp
   implicit none
   private
   public :: restore_underflow, underflow_to_zero

contains

   !> Makes results below the range of their precision zero in the calling thread, until `restore_underflow`.
   subroutine underflow_to_zero(was_gradual)
      logical, intent(out) :: was_gradual                             !! for `restore_underflow`

      was_gradual = .false.
      if (.not. ieee_support_underflow_control(0.0_sp)) return
      call ieee_get_underflow_mode(was_gradual)
      if (was_gradual) call ieee_set_underflow_mode(gradual=.false.)
   end subroutine underflow_to_zero

   !> Restores what `underflow_to_zero` changed.
   subroutine restore_underflow(was_gradual)
      logical, intent(in) :: was_gradual

      if (was_gradual) call ieee_set_underflow_mode(gradual=.true.)
   end subroutine restore_underflow
end module hb_underflow
