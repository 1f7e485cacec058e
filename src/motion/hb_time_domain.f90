!> Interface of the time-domain solver: the motion after the transient, and whether tones lock.
module hb_time_domain
   use hb_kinds, only: wp
   use hb_outcome, only: outcome
   use hb_text, only: to_text
   implicit none
   private
   public :: highest_part, locking_t, may_be_locked, steady_motion_t

   integer, parameter :: highest_part = 6                             !! of a tone that a common base frequency is
   real(wp), parameter :: close = 0.05_wp                             ! |q w_m - p w_l| relative to the larger tone

   !> Whether several tones are multiples of one.
   type :: locking_t
      logical :: is_locked = .false.
      real(wp) :: base = 0.0_wp                                       !! common frequency [rad/s]
      integer, allocatable :: multiples(:)                            !! of it, one for each tone
   contains
      procedure :: message => locking_message
   end type locking_t

   !> Where a model ends that is followed through time.
   type :: steady_motion_t
      integer :: status = outcome%pending                             !! of time integration; pending: not known
      integer :: n_motions = 0                                        !! in which several starts end; 0: there was one start
      character(:), allocatable :: message                            !! what was found, or why nothing was
      complex(wp), allocatable :: amplitudes(:, :)                    !! cos - i sin [m], (n_dofs, n_harmonics); where integrated
      complex(wp), allocatable :: averages(:, :)                      !! likewise at the coordinates, (n_harmonics, n_coordinates)
      real(wp) :: amplitude = 0.0_wp                                  !! of the same root mean square, of the largest coordinate [m]
      real(wp) :: spread = 0.0_wp                                     !! of the coordinates of the laws between windows, relative;
                                                                      !! of fits to candidates, what they leave of a record
      real(wp) :: change_by_steps = 0.0_wp                            !! of it, with fixed steps: by the last ones half as long
      real(wp) :: left_out = 0.0_wp                                   !! of the motion beyond the set, relative; of fits 0
      integer :: n_periods = 0                                        !! of the slowest tone, in all
      logical :: is_out_of_work = .false.                             !! before its end
      real(wp) :: work = 0.0_wp                                       !! from counts, see hb_solver_types
   end type steady_motion_t

contains

   !> Whether two tones, one of them unknown, are close to a ratio of small numbers.
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
                  if (abs(q*omega(m) - p*omega(l)) < close*max(omega(l), omega(m))) may_be_locked = .true.
               end do
            end do
         end do
      end do
   end function may_be_locked

   !> Describes what to do about it.
   pure function locking_message(self) result(text)
      class(locking_t), intent(in) :: self
      character(200) :: text
      integer :: m

      text = to_text(self%multiples(1))
      do m = 2, size(self%multiples)
         text = trim(text)//":"//to_text(self%multiples(m))
      end do
      text = "the tones lock in the ratio "//trim(text)//", as time integration shows: use one tone, near "// &
         to_text(self%base)//" rad/s"
   end function locking_message
end module hb_time_domain
