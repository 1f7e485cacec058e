!> Spring given by measured points (z_i, f_i), joined by a monotone cubic: no overshoot between points, one continuous slope.
!>
!> Beyond the table the force continues with the slope of the end, or stays constant.
!> Source: Fritsch and Carlson, SIAM J. Numer. Anal. 17 (1980) 238-246: three-point slopes, limited to the circle of radius
!> 3 in their figure 2; docs/why/theory.md, section 5.1. Sign: f stands beside K q on the left-hand side.
module hb_law_tabulated
   use hb_interval, only: interval_of, is_ascending
   use hb_kinds, only: wp
   use hb_law, only: kink_t, law_t, read_place
   use hb_properties, only: properties_t
   use hb_structure, only: structure_t
   implicit none
   private
   public :: new_tabulated, tabulated_t

   type, extends(law_t) :: tabulated_t
      real(wp), allocatable :: nodes(:)                               !! z_i [m], ascending, at least two
      real(wp), allocatable :: forces(:)                              !! f_i [N]
      real(wp), allocatable :: slopes(:)                              !! at the nodes [N/m]
      logical :: is_constant_beyond = .false.
   contains
      procedure :: read => tabulated_read
      procedure :: evaluate => tabulated_evaluate
      procedure :: potential => tabulated_potential
      procedure :: switches => tabulated_switches
      procedure :: evaluate_held => tabulated_evaluate_held
   end type tabulated_t

contains

   !> Spring through the given points.
   pure subroutine new_tabulated(self, nodes, forces, is_constant_beyond)
      class(tabulated_t), intent(inout) :: self
      real(wp), intent(in) :: nodes(:)                                !! [m], ascending, at least two
      real(wp), intent(in) :: forces(:)                               !! [N], as nodes
      logical, intent(in) :: is_constant_beyond                       !! else the force continues with the slope of the end

      self%nodes = nodes
      self%forces = forces
      self%slopes = monotone_slopes(nodes, forces)
      self%is_constant_beyond = is_constant_beyond
      self%has_potential = .true.
      self%length_scale = maxval(abs(nodes))
      self%n_switches = size(nodes)
      if (allocated(self%kinks)) deallocate (self%kinks)
      if (is_constant_beyond) self%kinks = [kink_t([1.0_wp], [1.0_wp], nodes([1, size(nodes)]), &
                                                   [self%slopes(1), -self%slopes(size(nodes))])]
      ! Odd where the table mirrors at zero, and so do its slopes: those that were shrunk may not.
      associate (n => size(self%nodes), rounding => 8*epsilon(1.0_wp))
         self%is_odd = all(abs(nodes + nodes(n:1:-1)) <= rounding*abs(nodes)) .and. &
                       all(abs(self%forces + self%forces(n:1:-1)) <= rounding*abs(self%forces)) .and. &
                       all(abs(self%slopes - self%slopes(n:1:-1)) <= rounding*abs(self%slopes))
      end associate
   end subroutine new_tabulated

   !> Slopes at the nodes that keep each cubic between the two forces at its ends.
   pure function monotone_slopes(nodes, forces) result(slopes)
      real(wp), intent(in) :: nodes(:), forces(:)
      real(wp) :: slopes(size(nodes))
      real(wp) :: factor, secants(size(nodes) - 1), widths(size(nodes) - 1)
      integer :: i, n

      n = size(nodes)
      widths = nodes(2:) - nodes(:n - 1)
      secants = (forces(2:) - forces(:n - 1))/widths
      slopes(1) = secants(1)
      slopes(n) = secants(n - 1)
      do i = 2, n - 1
         slopes(i) = (widths(i)*secants(i - 1) + widths(i - 1)*secants(i))/(widths(i - 1) + widths(i))
         if (have_other_signs(secants(i - 1), secants(i))) slopes(i) = 0.0_wp
      end do
      do i = 1, n - 1
         if (secants(i) == 0.0_wp) then
            slopes(i:i + 1) = 0.0_wp
         else
            factor = 3.0_wp/hypot(slopes(i)/secants(i), slopes(i + 1)/secants(i))
            if (factor < 1.0_wp) slopes(i:i + 1) = factor*slopes(i:i + 1)
         end if
      end do
   end function monotone_slopes

   pure logical function have_other_signs(a, b)
      real(wp), intent(in) :: a, b

      have_other_signs = (a > 0.0_wp .and. b < 0.0_wp) .or. (a < 0.0_wp .and. b > 0.0_wp)
   end function have_other_signs

   !> Reads a `&law type = 'tabulated'` group.
   subroutine tabulated_read(self, group, structure)
      class(tabulated_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(in) :: structure
      real(wp), allocatable :: forces(:), nodes(:)
      integer :: beyond                                               ! linear, constant

      self%has_potential = .true.                                     ! whatever is wrong with the rest
      call group%get("displacements", nodes)
      call group%choose("beyond", beyond)
      if (allocated(nodes)) then
         call group%get("forces", forces, n=size(nodes))
         if (size(nodes) < 2) then
            call group%problem("displacements", "a table needs two points or more")
         else if (.not. is_ascending(nodes)) then
            call group%problem("displacements", "each must be greater than the one before")
         else if (allocated(forces)) then
            if (size(forces) == size(nodes)) call new_tabulated(self, nodes, forces, beyond == 2)
         end if
      end if
      call read_place(self, group, structure)
   end subroutine tabulated_read

   subroutine tabulated_evaluate(self, z, v, p, f, df_dz, df_dv, df_dp)
      class(tabulated_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)
      real(wp) :: slope
      integer :: i

      do i = 1, size(z, 1)
         call on_interval(self, interval_of(self%nodes, z(i, 1)), z(i, 1), f(i, 1), slope)
         if (present(df_dz)) df_dz(i, 1, 1) = slope
      end do
   end subroutine tabulated_evaluate

   !> Cubic with force and slope given at both ends, in t = (z - z_i)/(z_(i+1) - z_i).
   pure subroutine on_interval(self, interval, z, force, slope)
      class(tabulated_t), intent(in) :: self
      integer, intent(in) :: interval                                 !! as `interval_of` counts
      real(wp), intent(in) :: z
      real(wp), intent(out) :: force, slope
      real(wp) :: secant, t, width
      integer :: i, n

      n = size(self%nodes)
      i = interval
      if (i == 0 .or. i == n) then
         i = max(i, 1)
         slope = merge(0.0_wp, self%slopes(i), self%is_constant_beyond)
         force = self%forces(i) + slope*(z - self%nodes(i))
         return
      end if
      width = self%nodes(i + 1) - self%nodes(i)
      t = (z - self%nodes(i))/width
      secant = (self%forces(i + 1) - self%forces(i))/width
      associate (s_1 => self%slopes(i), s_2 => self%slopes(i + 1))
         force = self%forces(i) + width*t*(s_1 + t*(3.0_wp*secant - 2.0_wp*s_1 - s_2 + t*(s_1 + s_2 - 2.0_wp*secant)))
         slope = s_1 + t*(2.0_wp*(3.0_wp*secant - 2.0_wp*s_1 - s_2) + 3.0_wp*t*(s_1 + s_2 - 2.0_wp*secant))
      end associate
   end subroutine on_interval

   pure subroutine tabulated_switches(self, z, v, values)
      class(tabulated_t), intent(in) :: self
      real(wp), intent(in) :: z(:), v(:)
      real(wp), intent(out) :: values(:)

      values = z(1) - self%nodes
   end subroutine tabulated_switches

   subroutine tabulated_evaluate_held(self, z, v, is_positive, f)
      class(tabulated_t), intent(in) :: self
      real(wp), intent(in) :: z(:), v(:)
      logical, intent(in) :: is_positive(:)
      real(wp), intent(out) :: f(:)
      real(wp) :: slope

      call on_interval(self, count(is_positive), z(1), f(1), slope)
   end subroutine tabulated_evaluate_held

   !> Integral of the cubics from the first point on. Simpson's rule is exact for them.
   subroutine tabulated_potential(self, z, energy, gradient)
      class(tabulated_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :)
      real(wp), intent(out) :: energy(:), gradient(:, :)
      real(wp) :: at_nodes(size(self%nodes)), slope
      integer :: i, interval

      at_nodes(1) = 0.0_wp
      do i = 2, size(at_nodes)
         at_nodes(i) = at_nodes(i - 1) + work(i - 1, self%nodes(i))
      end do
      do i = 1, size(z, 1)
         interval = interval_of(self%nodes, z(i, 1))
         call on_interval(self, interval, z(i, 1), gradient(i, 1), slope)
         energy(i) = at_nodes(max(interval, 1)) + work(interval, z(i, 1))
      end do

   contains

      !> Work from the lower end of an interval, or from the first point for the one before it.
      pure real(wp) function work(interval, to)
         integer, intent(in) :: interval
         real(wp), intent(in) :: to
         real(wp) :: at_end, at_middle, at_start, from, slope

         from = self%nodes(max(interval, 1))
         call on_interval(self, interval, from, at_start, slope)
         call on_interval(self, interval, 0.5_wp*(from + to), at_middle, slope)
         call on_interval(self, interval, to, at_end, slope)
         work = (to - from)*(at_start + 4.0_wp*at_middle + at_end)/6.0_wp
      end function work
   end subroutine tabulated_potential
end module hb_law_tabulated
