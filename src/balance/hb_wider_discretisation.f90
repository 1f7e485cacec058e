!> The wider set and the finer grid on which an error estimate evaluates a motion.
!>
!> Source: docs/why/theory.md, section 7.
module hb_wider_discretisation
   use hb_balance, only: balance_t
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t, new_box, new_of_parity
   use hb_kinds, only: wp
   use hb_thresholds, only: small_share
   use hb_torus, only: fast_size, new_torus, samples_for, torus_t
   use hb_tuple_choice, only: new_doubled_set, shifted
   implicit none
   private
   public :: choose_wider, choose_wider_set, finer_samples, wider_orders

   real(wp), parameter :: largest_wide_set = 2.0e5_wp                  ! tuples of the wider set
   real(wp), parameter :: largest_fine_grid = 4.0e6_wp                 ! samples

contains

   !> A box of about twice the order around the set.
   subroutine choose_wider_set(narrow, set, error)
      type(harmonics_t), intent(in) :: narrow
      type(harmonics_t), intent(out) :: set
      type(error_t), allocatable, intent(out) :: error
      integer :: orders(narrow%n_tones)

      orders = wider_orders(narrow%highest)
      call new_box(set, orders, .false., error)
   end subroutine choose_wider_set

   !> The wider set, which extends twice as far as that of the motion in all directions, and a finer grid: with one
   !> tone at least four times the samples, because a short contact may lie between fewer; with several tones, whose
   !> samples are at different phases in each period, twice. Half a grid is used for odd motions of odd equations,
   !> which have no response in even tuples.
   subroutine choose_wider(balance, carried, slow, is_fine, set, grid, error)
      type(balance_t), intent(in) :: balance
      real(wp), intent(in) :: carried(:)                              !! amplitudes of the motion (n_harmonics)
      integer, intent(in) :: slow(:)                                  !! tuple k with k.omega near 0
      logical, intent(in) :: is_fine                                  !! four times the samples also with several tones:
                                                                      !! penetration of rigid walls and errors of frequencies
                                                                      !! need them
      type(harmonics_t), intent(out) :: set
      type(torus_t), intent(out) :: grid
      type(error_t), allocatable, intent(out) :: error
      type(harmonics_t) :: all_tuples

      call new_doubled_set(set, balance%harmonics, error, carried, answers_of_laws_and_resonances(balance, carried, slow))
      if (allocated(error)) return
      if (set%n_harmonics > largest_wide_set) call choose_wider_set(balance%harmonics, set, error)
      if (allocated(error)) return
      associate (torus => balance%law_set%transform%torus)
         call new_torus(grid, finer_samples(torus%n_samples, set%highest, is_fine), set, error)
         grid%corrects_kinks = torus%corrects_kinks
         if (allocated(error) .or. .not. torus%is_half) return
      end associate
      all_tuples = set
      call new_of_parity(set, all_tuples, 1, error)
      if (grid%can_be_halved()) grid = grid%half()
   end subroutine choose_wider

   !> Tuples far from those of a motion that respond to it: those to which a law that varies with tones shifts each,
   !> and, for large combinations near a resonance of the structure, the neighbours along a slow tuple, which are
   !> nearly as resonant.
   pure function answers_of_laws_and_resonances(balance, carried, slow) result(tuples)
      type(balance_t), intent(in) :: balance
      real(wp), intent(in) :: carried(:)                              !! amplitudes of the motion (n_harmonics)
      integer, intent(in) :: slow(:)                                  !! tuple k with k.omega near 0
      integer, allocatable :: tuples(:, :)
      integer, parameter :: min_order = 4                          ! sum of entries not excited directly by loads and steep laws
      real(wp), parameter :: large_amplitude_share = 0.03_wp          ! of the largest amplitude
      real(wp) :: least
      integer :: d, first, h, i

      least = large_amplitude_share*maxval(carried)                   ! once: there may be a hundred thousand
      associate (set => balance%harmonics, stiffness => balance%stiffness, laws => balance%law_set%laws)
         tuples = reshape([integer ::], [size(slow), 0])
         do h = 1, set%n_harmonics
            if (sum(abs(set%tuples(:, h))) < min_order .or. carried(h) < least) cycle
            ! resonant: a minor part of the stiffness is left beside the inertia
            if (any([(abs(stiffness%entry(d, d, h)) < small_share*stiffness%magnitude(d, h), d=1, balance%n_dofs)])) &
               tuples = reshape([tuples, shifted(set%tuples(:, h:h), slow)], [size(slow), size(tuples, 2) + 2])
         end do
         do i = 1, size(laws)
            if (.not. allocated(laws(i)%law%modulation)) cycle
            associate (n => laws(i)%law%n_phases, modulation => laws(i)%law%modulation)
               do first = 1, size(modulation), n
                  tuples = reshape([tuples, shifted(set%tuples, [modulation(first:first + n - 1), spread(0, 1, size(slow) - n)])], &
                                   [size(slow), size(tuples, 2) + 2*set%n_harmonics])
               end do
            end associate
         end do
      end associate
   end function answers_of_laws_and_resonances

   !> Orders of the wider box, for the orders of the solution.
   pure function wider_orders(highest) result(orders)
      integer, intent(in) :: highest(:)                               !! (n_tones)
      integer :: orders(size(highest)), widest(size(highest)), less, most, least

      widest = max(2*highest, highest + 2)
      least = 0                                                        ! bisection for the common reduction of all orders
      most = maxval(widest - highest)
      do while (least < most)
         less = (least + most)/2
         if (product(2*real(max(widest - less, highest), wp) + 1) > 2*largest_wide_set) then
            least = less + 1
         else
            most = less
         end if
      end do
      orders = max(widest - least, highest)
   end function wider_orders

   !> Samples of the finer grid, for those of the solution and the highest entries of the wider set.
   pure function finer_samples(n_samples, highest, is_fine) result(samples)
      integer, intent(in) :: n_samples(:), highest(:)                 !! (n_tones)
      logical, intent(in) :: is_fine                                  !! as for `choose_wider`
      integer :: samples(size(highest))

      samples = max(2*n_samples, fast_size(2*highest + 2))
      if (.not. (size(highest) == 1 .or. is_fine .or. product(real(samples, wp)) > largest_fine_grid)) return
      samples = max(samples_for(highest, 0), 4*n_samples)
      do while (product(real(samples, wp)) > largest_fine_grid .and. any(samples > max(n_samples, 2*highest + 2)))
         samples = max(n_samples, 2*highest + 2, samples - max(2, samples/8))
      end do
   end function finer_samples
end module hb_wider_discretisation
