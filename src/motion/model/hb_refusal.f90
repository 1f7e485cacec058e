!> Values of a number that a model rejects, such as a negative gap: the reason is that of the nearest one.
module hb_refusal
   use hb_kinds, only: wp
   implicit none
   private
   public :: refusal_t

   !> A value that was rejected: of several the nearest to the last possible one.
   type :: refusal_t
      character(:), allocatable :: text                               !! the reason; not allocated: none was rejected
      real(wp) :: value = 0.0_wp
      real(wp) :: possible = 0.0_wp                                   !! the last possible one
   contains
      procedure :: note => refusal_note
      procedure :: forget => refusal_forget
   end type refusal_t

contains

   !> Notes a rejected value.
   pure subroutine refusal_note(self, text, value)
      class(refusal_t), intent(inout) :: self
      character(*), intent(in) :: text
      real(wp), intent(in) :: value

      if (allocated(self%text)) then
         if (abs(value - self%possible) >= abs(self%value - self%possible)) return
      end if
      self%text = text
      self%value = value
   end subroutine refusal_note

   !> Forgets rejected values.
   pure subroutine refusal_forget(self)
      class(refusal_t), intent(inout) :: self

      if (allocated(self%text)) deallocate (self%text)
   end subroutine refusal_forget
end module hb_refusal
