!> Locked tones: the ratio of integers in which several tones are multiples of one frequency.
module hb_locking
   use hb_kinds, only: wp
   use hb_text, only: to_text
   implicit none
   private
   public :: highest_part, locking_t, may_be_locked

   integer, parameter :: highest_part = 6                             !! of a tone: lowest common base frequency
   real(wp), parameter :: max_locking_detuning = 0.05_wp              ! |q w_m - p w_l| relative to the larger tone

   !> Whether several tones are multiples of one frequency.
   type :: locking_t
      logical :: is_locked = .false.
      real(wp) :: base = 0.0_wp                                       !! common frequency [rad/s]
      integer, allocatable :: multiples(:)                            !! of it, one for each tone
   contains
      procedure :: message => locking_message
   end type locking_t

contains

   !> Whether two tones, one of them unknown, are close to a ratio of small integers.
   pure logical function may_be_locked(omega, is_unknown)
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones)
      logical, intent(in) :: is_unknown(:)                            !! (n_tones)
      integer :: l, m, p, q

      may_be_locked = .false.
      do m = 2, size(omega)
         do l = 1, m - 1
            if (.not. (is_unknown(l) .or. is_unknown(m))) cycle
            do p = 1, highest_part
               do q = 1, highest_part - p + 1
                  if (abs(q*omega(m) - p*omega(l)) < max_locking_detuning*max(omega(l), omega(m))) may_be_locked = .true.
               end do
            end do
         end do
      end do
   end function may_be_locked

   !> The ratio of the tones and their common frequency.
   pure function locking_message(self) result(text)
      class(locking_t), intent(in) :: self
      character(200) :: text
      integer :: m

      text = to_text(self%multiples(1))
      do m = 2, size(self%multiples)
         text = trim(text)//":"//to_text(self%multiples(m))
      end do
      text = "the tones lock in the ratio "//trim(text)//", as time integration shows; their common frequency is near "// &
         to_text(self%base)//" rad/s"
   end function locking_message
end module hb_locking
