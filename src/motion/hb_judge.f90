!> What a solution may ask of somebody who follows motions through time: a first guess, whether tones lock, and where it all ends.
!>
!> Who that is need not be known here; without a judge such questions have no answer.
module hb_judge
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_outcome, only: outcome
   use hb_scene, only: scene_t
   use hb_text, only: to_text
   use hb_watch, only: watch_t
   implicit none
   private
   public :: highest_part, judge_t, locking_t, may_be_locked, settled_t

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

   !> Where a scene ends that is followed through time.
   type :: settled_t
      integer :: status = outcome%pending                             !! of marching; pending: not known
      integer :: n_motions = 0                                        !! in which several starts end; 0: there was one start
      character(:), allocatable :: message                            !! what was found, or why nothing was
      complex(wp), allocatable :: amplitudes(:, :)                    !! cos - i sin [m], (n_dofs, n_harmonics); where marched
      complex(wp), allocatable :: averages(:, :)                      !! likewise at the coordinates, (n_harmonics, n_coordinates)
      real(wp) :: amplitude = 0.0_wp                                  !! of the same root mean square, of the largest coordinate [m]
      real(wp) :: spread = 0.0_wp                                     !! of the coordinates of the laws between windows, relative;
                                                                      !! of fits to candidates, what they leave of a record
      real(wp) :: change_by_steps = 0.0_wp                            !! of it, with fixed steps: by the last ones half as long
      real(wp) :: left_out = 0.0_wp                                   !! of the motion beyond the set, relative; of fits 0
      integer :: n_periods = 0                                        !! of the slowest tone, in all
      logical :: is_out_of_work = .false.                             !! before anything was known
      real(wp) :: work = 0.0_wp                                       !! from counts, see hb_solver_types
   end type settled_t

   type, abstract :: judge_t
   contains
      procedure(settle), deferred :: settle
      procedure(first_guess), deferred :: first_guess
      procedure(find_locking), deferred :: find_locking
   end type judge_t

   abstract interface
      !> Follows the scene until it is steady or the budget of work ends. An error is one of marching, such as a law that it cannot
      !> follow.
      subroutine settle(self, scene, law_dofs, watch, settled, error)
         import :: error_t, judge_t, scene_t, settled_t, watch_t
         class(judge_t), intent(in) :: self
         type(scene_t), intent(in) :: scene                           !! all of its tones given
         integer, intent(in) :: law_dofs(:)
         class(watch_t), intent(inout) :: watch                       !! may end the march, with an error
         type(settled_t), intent(out) :: settled
         type(error_t), allocatable, intent(out) :: error
      end subroutine settle

      !> Gives a first guess as hb_motion takes it: coefficients at the laws, then all base frequencies. Not
      !> allocated where nothing is left to move, or where the motion has no tone of its own.
      subroutine first_guess(self, scene, omega, law_dofs, watch, guess, error)
         import :: error_t, judge_t, scene_t, watch_t, wp
         class(judge_t), intent(in) :: self
         type(scene_t), intent(in) :: scene
         real(wp), intent(in) :: omega(:)                             !! [rad/s], (n_tones), guesses where unknown, all > 0
         integer, intent(in) :: law_dofs(:)
         class(watch_t), intent(inout) :: watch                       !! may end the march, with an error
         real(wp), allocatable, intent(out) :: guess(:)
         type(error_t), allocatable, intent(out) :: error
      end subroutine first_guess

      !> Looks for a common frequency of all that moves.
      subroutine find_locking(self, locking, scene, omega, law_dofs, watch)
         import :: judge_t, locking_t, scene_t, watch_t, wp
         class(judge_t), intent(in) :: self
         type(locking_t), intent(out) :: locking
         type(scene_t), intent(in) :: scene
         real(wp), intent(in) :: omega(:)                             !! [rad/s], (n_tones), as far as known, > 0
         integer, intent(in) :: law_dofs(:)
         class(watch_t), intent(inout) :: watch                       !! may end the march: nothing is known then
      end subroutine find_locking
   end interface

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

   !> Says what to do about it.
   pure function locking_message(self) result(text)
      class(locking_t), intent(in) :: self
      character(:), allocatable :: text
      integer :: m

      text = to_text(self%multiples(1))
      do m = 2, size(self%multiples)
         text = text//":"//to_text(self%multiples(m))
      end do
      text = "the tones lock in the ratio "//text//", as marching shows: use one tone, near "//to_text(self%base)//" rad/s"
   end function locking_message
end module hb_judge
