!> First guesses of normal modes at an internal resonance: motions in two linear modes, the frequency of one of which is a
!> multiple of that of the other.
!> A small motion of given size in two such modes has two numbers that the linear equations leave open, the share of the second mode
!> and the change of the frequency. The balance of the forces of the laws projected on the two modes determines them: the first
!> equation gives the change of the frequency, the second one is zero at the shares of which motions exist.
!> Source: A. H. Nayfeh and D. T. Mook, Nonlinear Oscillations, Wiley 1979, chapter 6.
module hb_resonant_modes
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_limit_cycle_search, only: fundamental, search_t
   use hb_thresholds, only: equality_tolerance
   implicit none
   private
   public :: find_resonant, find_shares, resonant_t, with_resonant

   real(wp), parameter :: near_resonance = 1.0e-2_wp                  ! of the frequency: modes that interact at small amplitudes

   !> A mode whose frequency is a multiple of that of the chosen mode.
   type :: resonant_t
      integer :: mode = 0                                             !! its number
      integer :: harmonic = 0                                         !! of the set, at its frequency
   end type resonant_t

contains

   !> Finds the modes that are at an internal resonance with the chosen one and have a harmonic in the set.
   subroutine find_resonant(search, found)
      type(search_t), intent(in) :: search
      type(resonant_t), allocatable, intent(out) :: found(:)
      integer, allocatable :: tuple(:)
      integer :: h, k, multiple

      allocate (found(0))
      associate (frequency => search%base%modes%frequency, chosen => search%modes(1))
         do k = 1, search%base%n_linear
            multiple = nint(frequency(k)/frequency(chosen))
            if (k == chosen .or. multiple < 1) cycle
            if (abs(frequency(k) - multiple*frequency(chosen)) > near_resonance*frequency(chosen)) cycle
            if (allocated(tuple)) deallocate (tuple)
            allocate (tuple, source=0*search%balance%harmonics%tuples(:, 1))
            tuple(search%tones(1)) = multiple
            h = search%balance%harmonics%index_of(tuple)
            if (h > 0) found = [found, resonant_t(k, h)]
         end do
      end associate
   end subroutine find_resonant

   !> A motion in the chosen mode with a share of the second one, in phase with it or a quarter of its period behind.
   function with_resonant(search, u, second, share, is_sine) result(both)
      type(search_t), intent(in) :: search
      real(wp), intent(in) :: u(:, :)                                 !! in the chosen mode [m]
      type(resonant_t), intent(in) :: second
      real(wp), intent(in) :: share                                   !! ratio of the largest deflections
      logical, intent(in) :: is_sine
      real(wp) :: both(size(u, 1), size(u, 2))
      complex(wp) :: deflection(size(u, 2))

      associate (set => search%balance%harmonics)
         deflection = share*maxval(abs(u - search%base%u))*shape_of(search, second%mode)
         if (is_sine) deflection = (0.0_wp, -1.0_wp)*deflection
         both = u
         both(set%cos_at(second%harmonic), :) = both(set%cos_at(second%harmonic), :) + real(deflection)
         both(set%sin_at(second%harmonic), :) = both(set%sin_at(second%harmonic), :) - aimag(deflection)
      end associate
   end function with_resonant

   !> Shape of a mode at the laws, with the largest deflection 1.
   pure function shape_of(search, mode) result(shape)
      type(search_t), intent(in) :: search
      integer, intent(in) :: mode
      complex(wp) :: shape(size(search%base%modes%shapes, 1))

      shape = search%base%modes%shapes(:, mode)
      shape = shape/shape(maxloc(abs(shape), dim=1))
   end function shape_of

   !> Finds the shares of the second mode, and the frequencies, at which the projected equations hold. The balance is at the
   !> frequency of the chosen mode.
   subroutine find_shares(search, u, second, is_sine, shares, frequencies)
      type(search_t), intent(inout) :: search
      real(wp), intent(in) :: u(:, :)                                 !! motion in the chosen mode [m]
      type(resonant_t), intent(in) :: second
      logical, intent(in) :: is_sine
      real(wp), allocatable, intent(out) :: shares(:), frequencies(:) !! [rad/s]
      integer, parameter :: n_grid = 13, n_bisections = 10
      real(wp), parameter :: min_frequency_ratio = 1.0e-3_wp, max_frequency_ratio = 30.0_wp
      real(wp), dimension(2*n_grid) :: grid, values
      real(wp) :: high, low, middle, omega, value
      integer :: i, k
      logical :: is_known(size(grid)), is_known_there

      do i = 1, n_grid
         grid(n_grid + i) = min_frequency_ratio*(max_frequency_ratio/min_frequency_ratio)**(real(i - 1, wp)/(n_grid - 1))
         grid(n_grid + 1 - i) = -grid(n_grid + i)
      end do
      do i = 1, size(grid)
         call project(search, u, second, grid(i), is_sine, values(i), omega, is_known(i))
      end do
      allocate (shares(0), frequencies(0))
      do i = 1, size(grid) - 1
         if (.not. all(is_known(i:i + 1))) cycle
         if (values(i)*values(i + 1) >= 0.0_wp .or. maxval(abs(values(i:i + 1))) <= equality_tolerance**2) cycle
         low = grid(i)
         high = grid(i + 1)
         do k = 1, n_bisections
            middle = 0.5_wp*(low + high)
            call project(search, u, second, middle, is_sine, value, omega, is_known_there)
            if (.not. is_known_there) exit
            if (value*values(i) > 0.0_wp) then
               low = middle
            else
               high = middle
            end if
         end do
         if (.not. is_known_there) cycle
         shares = [shares, middle]
         frequencies = [frequencies, omega]
      end do
   end subroutine find_shares

   !> Projects the balance of a motion in both modes on them: the frequency at which the equation of the chosen mode holds, and what
   !> is left of that of the second one, relative to its change with the frequency.
   subroutine project(search, u, second, share, is_sine, left, frequency, is_known)
      type(search_t), intent(inout) :: search
      real(wp), intent(in) :: u(:, :), share
      type(resonant_t), intent(in) :: second
      logical, intent(in) :: is_sine
      real(wp), intent(out) :: left, frequency
      logical, intent(out) :: is_known
      type(error_t), allocatable :: error
      real(wp), dimension(size(u, 1), size(u, 2)) :: both, derivative
      real(wp) :: r(size(u))
      real(wp) :: change, of_first(2), of_second(2)
      integer :: first

      associate (balance => search%balance, tone => search%tones(1))
         left = 0.0_wp
         is_known = .false.
         frequency = balance%omega(tone)
         both = with_resonant(search, u, second, share, is_sine)
         call balance%residual([both], r)
         call balance%frequency_derivative(both, tone, derivative, error)
         if (allocated(error)) return
         first = fundamental(balance%harmonics, tone)
         of_first = [part(reshape(r, shape(u)), search%modes(1), first, .false.), &
                     part(derivative, search%modes(1), first, .false.)]
         of_second = [part(reshape(r, shape(u)), second%mode, second%harmonic, is_sine), &
                      part(derivative, second%mode, second%harmonic, is_sine)]
         if (.not. (all(ieee_is_finite(of_first)) .and. all(ieee_is_finite(of_second)))) return
         if (.not. abs(of_first(2)) > 0.0_wp) return
         change = -of_first(1)/of_first(2)
         if (abs(change) > 0.5_wp*frequency) return
         left = (of_second(1) + of_second(2)*change)/max(abs(of_first(2))*frequency, tiny(1.0_wp))
         frequency = frequency + change
         is_known = .true.
      end associate

   contains

      !> Projection of a harmonic on a mode: of its cosine, or of its sine.
      real(wp) function part(values, mode, harmonic, of_sine)
         real(wp), intent(in) :: values(:, :)
         integer, intent(in) :: mode, harmonic
         logical, intent(in) :: of_sine
         complex(wp) :: value

         associate (set => search%balance%harmonics)
            value = dot_product(shape_of(search, mode), &
                                cmplx(values(set%cos_at(harmonic), :), -values(set%sin_at(harmonic), :), wp))
         end associate
         part = merge(-aimag(value), real(value, wp), of_sine)
      end function part
   end subroutine project
end module hb_resonant_modes
