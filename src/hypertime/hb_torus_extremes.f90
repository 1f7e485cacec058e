!> The smallest and the largest value of functions of the phases of a motion, over all phases: of its distance from a stop, or of a
!> velocity.
!>
!> A grid of phases, or with many tones scattered phases, show where values are large. Each of their local extremes that may be
!> the global one is improved by Newton's method on the torus: of several tones the tops are often ridges, such as along equal
!> phases, on which a search in one phase after the other ends early.
module hb_torus_extremes
   use hb_kinds, only: two_pi, wp
   implicit none
   private
   public :: new_phase_grid, phase_functions_t, phase_grid_t

   integer, parameter :: largest_grid = 16384                         ! phases
   integer, parameter :: min_phases_of_tone = 5                       ! phases of a tone, where all together are too many
   real(wp), parameter :: min_distance_from_zero = 0.25_wp            ! from zero, relative to the range of the values
   real(wp), parameter :: max_rival_distance = 0.25_wp                ! of the range: so close to the best one, others are tried
   integer, parameter :: max_rivals = 12
   integer, parameter :: max_rounds = 40                              ! of Newton's method
   real(wp), parameter :: smallest_width = 1.0e-4_wp                  ! [rad] of differences: less would show rounding errors only

   !> Functions of the phases.
   type, abstract :: phase_functions_t
   contains
      procedure(values_at_phases), deferred :: evaluate
   end type phase_functions_t

   abstract interface
      !> Values at given phases, (n_functions, n_phases).
      subroutine values_at_phases(self, phases, values)
         import :: phase_functions_t, wp
         class(phase_functions_t), intent(inout) :: self
         real(wp), intent(in) :: phases(:, :)                         !! [rad], (n_tones, n_phases)
         real(wp), allocatable, intent(out) :: values(:, :)
      end subroutine values_at_phases
   end interface

   !> Phases at which extremes are sought first.
   type :: phase_grid_t
      integer, allocatable, private :: each(:)                        ! phases of each tone; 0: they are scattered
      real(wp), allocatable, private :: phases(:, :)                  ! [rad], (n_tones, any)
   contains
      procedure :: find_extremes => phase_grid_find_extremes
   end type phase_grid_t

contains

   !> Finds the extremes of functions, (2, n_functions): smallest, largest. Those far from zero are values on the grid.
   subroutine phase_grid_find_extremes(self, functions, extremes)
      class(phase_grid_t), intent(in) :: self
      class(phase_functions_t), intent(inout) :: functions
      real(wp), allocatable, intent(out) :: extremes(:, :)
      real(wp), allocatable :: values(:, :)
      real(wp) :: sense
      integer :: i, k

      call functions%evaluate(self%phases, values)
      allocate (extremes(2, size(values, 1)))
      do i = 1, size(extremes, 2)
         do k = 1, 2
            sense = merge(-1.0_wp, 1.0_wp, k == 1)
            call locate_extreme(self, functions, i, sense, sense*values(i, :), extremes(k, i))
            extremes(k, i) = sense*extremes(k, i)
         end do
      end do
   end subroutine phase_grid_find_extremes

   !> Creates a grid of phases: fine enough for the highest harmonics, or as fine as is affordable; with too many tones
   !> for a grid the same number of scattered phases.
   pure subroutine new_phase_grid(self, tuples)
      type(phase_grid_t), intent(out) :: self
      integer, intent(in) :: tuples(:, :)                             !! (n_tones, n_harmonics)
      integer :: i, m, quotient

      allocate (self%each, source=max(24, 4*maxval(abs(tuples), dim=2)))
      associate (each => self%each)
         do while (product(real(each, wp)) > real(largest_grid, wp) .and. any(each > min_phases_of_tone))
            where (each == maxval(each)) each = max(min_phases_of_tone, 9*each/10)
         end do
         if (product(real(each, wp)) > real(largest_grid, wp)) then
            each = 0
            call scatter(size(each), self%phases)
            return
         end if
         allocate (self%phases(size(each), product(each)))
         do i = 1, size(self%phases, 2)
            quotient = i - 1
            do m = 1, size(each)
               self%phases(m, i) = two_pi*modulo(quotient, each(m))/each(m)
               quotient = quotient/each(m)
            end do
         end do
      end associate
   end subroutine new_phase_grid

   !> Phases that fill the torus evenly, multiples of the powers of 1/g, where g**(n + 1) = g + 1. Source: Roberts, The unreasonable
   !> effectiveness of quasirandom sequences, 2018.
   pure subroutine scatter(n, phases)
      integer, intent(in) :: n                                        !! tones
      real(wp), allocatable, intent(out) :: phases(:, :)
      integer, parameter :: n_rounds = 60                             ! of a contraction by more than 2 each
      real(wp) :: g
      integer :: i, m

      g = 1.5_wp
      do i = 1, n_rounds
         g = (1.0_wp + g)**(1.0_wp/(n + 1))
      end do
      allocate (phases(n, largest_grid))
      do i = 1, largest_grid
         phases(:, i) = [(two_pi*modulo(i/g**m, 1.0_wp), m=1, n)]
      end do
   end subroutine scatter

   !> The largest value of a function times a sign: from the best local extremes of the grid. One that is far from zero is that of
   !> the grid: its sign is known.
   subroutine locate_extreme(grid, functions, number, sense, values, extreme)
      type(phase_grid_t), intent(in) :: grid
      class(phase_functions_t), intent(inout) :: functions
      integer, intent(in) :: number
      real(wp), intent(in) :: sense
      real(wp), intent(in) :: values(:)                               !! on the grid, times the sign
      real(wp), intent(out) :: extreme
      logical :: is_left(size(values))
      integer :: i, k

      extreme = maxval(values)
      associate (range => maxval(values) - minval(values))
         if (abs(extreme) > min_distance_from_zero*range) return
         is_left = values >= extreme - max_rival_distance*range
      end associate
      associate (each => grid%each)
         do i = 1, merge(0, size(values), any(each == 0))
            if (is_left(i)) is_left(i) = is_local_extreme(each, values, i)
         end do
         do k = 1, min(max_rivals, count(is_left))
            i = maxloc(values, dim=1, mask=is_left)
            is_left(i) = .false.
            call climb(functions, number, sense, 0.5_wp*two_pi/max(min_phases_of_tone, maxval(each)), grid%phases(:, i), extreme)
         end do
      end associate
   end subroutine locate_extreme

   !> Whether no neighbour in any phase has a larger value.
   pure logical function is_local_extreme(each, values, i)
      integer, intent(in) :: each(:), i
      real(wp), intent(in) :: values(:)
      integer :: m, position, stride

      is_local_extreme = .true.
      stride = 1
      do m = 1, size(each)
         position = modulo((i - 1)/stride, each(m))
         associate (first => i - position*stride)
            is_local_extreme = is_local_extreme .and. &
                               values(i) >= values(first + modulo(position - 1, each(m))*stride) .and. &
                               values(i) >= values(first + modulo(position + 1, each(m))*stride)
         end associate
         stride = stride*each(m)
      end do
   end function is_local_extreme

   !> Climbs from given phases to a top. Differences have the width of the last step; where a step leads down, as at a corner,
   !> a smaller width is used.
   subroutine climb(functions, number, sense, first_width, start, highest)
      class(phase_functions_t), intent(inout) :: functions
      integer, intent(in) :: number
      real(wp), intent(in) :: sense
      real(wp), intent(in) :: first_width, start(:)                   !! [rad]
      real(wp), intent(inout) :: highest                              !! value of all climbs
      real(wp), allocatable :: near(:, :), stencil(:, :)
      real(wp) :: at(size(start)), last(size(start)), reached, shift(size(start)), width
      integer :: round
      logical :: is_concave, is_last

      at = start
      last = start
      reached = -huge(1.0_wp)
      width = first_width
      is_last = .false.
      do round = 1, max_rounds
         stencil = spread(at, 2, 1 + 2*size(at)**2) + width*directions(size(at))
         call functions%evaluate(stencil, near)
         associate (f => sense*near(number, :))
            highest = max(highest, maxval(f))
            if (is_last) return
            call find_step(f, shift, is_concave)
            if (f(1) < reached .or. (maxloc(f, dim=1) == 1 .and. .not. is_concave)) then
               if (f(1) < reached) at = last
               width = 0.25_wp*width
               if (width < smallest_width) return
            else
               last = at
               reached = f(1)
               if (is_concave) then
                  at = at + width*shift
                  is_last = width <= smallest_width .and. maxval(abs(shift)) <= 1.0_wp
                  width = max(smallest_width, width*min(1.0_wp, max(0.05_wp, maxval(abs(shift)))))
               else
                  at = stencil(:, maxloc(f, dim=1))
               end if
            end if
         end associate
      end do
   end subroutine climb

   !> Points of differences around a point: itself, both neighbours in each direction, the four of each pair of directions.
   pure function directions(n)
      integer, intent(in) :: n
      real(wp) :: directions(n, 1 + 2*n**2)
      integer :: i, k, m

      directions = 0.0_wp
      i = 1
      do m = 1, n
         directions(m, i + 1:i + 2) = [1.0_wp, -1.0_wp]
         i = i + 2
      end do
      do m = 2, n
         do k = 1, m - 1
            directions(m, i + 1:i + 4) = [1.0_wp, -1.0_wp, 1.0_wp, -1.0_wp]
            directions(k, i + 1:i + 4) = [1.0_wp, -1.0_wp, -1.0_wp, 1.0_wp]
            i = i + 4
         end do
      end do
   end function directions

   !> The step of Newton's method to the top from values at the points of `directions`, in units of their distance, at most 2.
   pure subroutine find_step(f, shift, is_concave)
      real(wp), intent(in) :: f(:)
      real(wp), intent(out) :: shift(:)
      logical, intent(out) :: is_concave                              !! otherwise there is no step
      real(wp), parameter :: min_curvature_ratio = 1.0e-9_wp          ! of the largest curvature: a direction without any
      real(wp) :: factor(size(shift), size(shift))
      integer :: i, k, m, n

      n = size(shift)
      shift = 0.5_wp*(f(2:2*n:2) - f(3:2*n + 1:2))
      factor = 0.0_wp
      i = 2*n + 1
      do m = 1, n
         factor(m, m) = 2.0_wp*f(1) - f(2*m) - f(2*m + 1)
         do k = 1, m - 1
            factor(m, k) = -0.25_wp*(f(i + 1) + f(i + 2) - f(i + 3) - f(i + 4))
            i = i + 4
         end do
      end do
      associate (floor => min_curvature_ratio*maxval(abs(factor)))
         is_concave = .false.
         do m = 1, n                                                  ! factors of Cholesky
            do k = 1, m - 1
               factor(m, k) = (factor(m, k) - dot_product(factor(m, :k - 1), factor(k, :k - 1)))/factor(k, k)
            end do
            associate (pivot => factor(m, m) - sum(factor(m, :m - 1)**2) + floor)
               if (.not. pivot > 0.0_wp) return
               factor(m, m) = sqrt(pivot)
            end associate
         end do
      end associate
      is_concave = .true.
      do m = 1, n
         shift(m) = (shift(m) - dot_product(factor(m, :m - 1), shift(:m - 1)))/factor(m, m)
      end do
      do m = n, 1, -1
         shift(m) = (shift(m) - dot_product(factor(m + 1:, m), shift(m + 1:)))/factor(m, m)
      end do
      shift = shift*min(1.0_wp, 2.0_wp/max(tiny(1.0_wp), maxval(abs(shift))))
   end subroutine find_step
end module hb_torus_extremes
