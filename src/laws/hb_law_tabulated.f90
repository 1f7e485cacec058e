!> Spring through measured points (z_i, f_i), interpolated by a monotone cubic (hb_interpolation). Sign: f stands
!> beside K q on the left-hand side.
module hb_law_tabulated
   use hb_interpolation, only: cubic_change_t, interval_of, is_ascending, monotone_cubic_t, new_monotone_cubic
   use hb_kinds, only: wp
   use hb_law, only: law_t
   use hb_numbers, only: number_t, numbers_t
   use hb_problems, only: problems_t
   implicit none
   private
   public :: new_tabulated, tabulated_t

   type, extends(law_t) :: tabulated_t
      real(wp), allocatable :: nodes(:)                               !! z_i [m]
      real(wp), allocatable :: forces(:)                              !! f_i [N], as nodes
      logical :: is_constant_beyond = .false.                         !! otherwise the force continues with the slope of the end
      type(monotone_cubic_t) :: table                                 !! through these points
   contains
      procedure :: declare_numbers => tabulated_declare_numbers
      procedure :: has_valid_numbers => tabulated_has_valid_numbers
      procedure :: check => tabulated_check
      procedure :: derive => tabulated_derive
      procedure :: evaluate => tabulated_evaluate
      procedure :: potential => tabulated_potential
      procedure :: switches => tabulated_switches
      procedure :: evaluate_held => tabulated_evaluate_held
      procedure :: number_slope => tabulated_number_slope
   end type tabulated_t

contains

   !> Creates a spring through the given points.
   pure subroutine new_tabulated(self, nodes, forces, is_constant_beyond)
      class(tabulated_t), intent(inout) :: self
      real(wp), intent(in) :: nodes(:)                                !! [m], ascending, at least two
      real(wp), intent(in) :: forces(:)                               !! [N], as nodes
      logical, intent(in) :: is_constant_beyond                       !! otherwise the force continues with the slope of the end

      self%nodes = nodes
      self%forces = forces
      self%is_constant_beyond = is_constant_beyond
      call self%derive()
   end subroutine new_tabulated

   subroutine tabulated_declare_numbers(self, numbers)
      class(tabulated_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("displacements", self%nodes)
      if (allocated(self%nodes)) call numbers%add("forces", self%forces, n=size(self%nodes))
      call numbers%add("beyond", self%is_constant_beyond, word="constant")
   end subroutine tabulated_declare_numbers

   pure logical function tabulated_has_valid_numbers(self) result(are_valid)
      class(tabulated_t), intent(in) :: self

      are_valid = allocated(self%nodes) .and. allocated(self%forces)
      if (are_valid) are_valid = size(self%nodes) >= 2 .and. size(self%forces) == size(self%nodes)
      if (are_valid) are_valid = is_ascending(self%nodes)
   end function tabulated_has_valid_numbers

   subroutine tabulated_check(self, problems)
      class(tabulated_t), intent(in) :: self
      class(problems_t), intent(inout) :: problems

      if (.not. allocated(self%nodes)) return
      if (size(self%nodes) < 2) then
         call problems%add("displacements", "a table needs two points or more")
      else if (.not. is_ascending(self%nodes)) then
         call problems%add("displacements", "each must be greater than the one before")
      end if
   end subroutine tabulated_check

   pure subroutine tabulated_derive(self)
      class(tabulated_t), intent(inout) :: self

      self%has_potential = .true.                                     ! even if other numbers have problems
      if (.not. self%has_valid_numbers()) return
      call new_monotone_cubic(self%table, self%nodes, self%forces, self%is_constant_beyond)
      associate (nodes => self%nodes, forces => self%forces)
         self%has_convex_free_region = all(forces(2:) >= forces(:size(forces) - 1)) ! a force that rises is zero in one interval
         self%length_scale = maxval(abs(nodes))
         self%n_switches = size(nodes)
         if (allocated(self%kinks)) deallocate (self%kinks)
         if (self%is_constant_beyond) &
            call self%set_kinks_of_coordinate(nodes([1, size(nodes)]), [self%table%slopes(1), -self%table%slopes(size(nodes))])
         ! Odd if the table is symmetric about zero, and so are its slopes: reduced slopes may not be.
         associate (n => size(nodes), slopes => self%table%slopes, rounding => 8*epsilon(1.0_wp))
            self%is_odd = all(abs(nodes + nodes(n:1:-1)) <= rounding*abs(nodes)) .and. &
                          all(abs(forces + forces(n:1:-1)) <= rounding*abs(forces)) .and. &
                          all(abs(slopes - slopes(n:1:-1)) <= rounding*abs(slopes))
         end associate
      end associate
   end subroutine tabulated_derive

   subroutine tabulated_evaluate(self, z, v, p, f, df_dz, df_dv, df_dp)
      class(tabulated_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)
      real(wp) :: slope
      integer :: i

      do i = 1, size(z, 1)
         call self%table%at(z(i, 1), f(i, 1), slope)
         if (present(df_dz)) df_dz(i, 1, 1) = slope
      end do
   end subroutine tabulated_evaluate

   !> Derivative by one of the points, which changes the force near it alone.
   subroutine tabulated_number_slope(self, number, z, v, p, slope, is_known)
      class(tabulated_t), intent(in) :: self
      type(number_t), intent(in) :: number
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: slope(:, :)
      logical, intent(out) :: is_known
      type(cubic_change_t) :: change
      integer :: i

      slope = 0.0_wp
      is_known = number%element(1) >= 1 .and. number%element(1) <= size(self%table%nodes)
      if (.not. is_known) return
      call self%table%find_change(number%element(1), number%key == "displacements", change)
      do i = 1, size(z, 1)
         slope(i, 1) = self%table%change_at(change, z(i, 1))
      end do
   end subroutine tabulated_number_slope

   pure subroutine tabulated_switches(self, z, v, values)
      class(tabulated_t), intent(in) :: self
      real(wp), intent(in) :: z(:), v(:)
      real(wp), intent(out) :: values(:)

      values = z(1) - self%table%nodes
   end subroutine tabulated_switches

   subroutine tabulated_evaluate_held(self, z, v, is_positive, f)
      class(tabulated_t), intent(in) :: self
      real(wp), intent(in) :: z(:), v(:)
      logical, intent(in) :: is_positive(:)
      real(wp), intent(out) :: f(:)
      real(wp) :: slope

      call self%table%on_interval(count(is_positive), z(1), f(1), slope)
   end subroutine tabulated_evaluate_held

   !> Integral of the cubics from the first point on; Simpson's rule is exact for them.
   subroutine tabulated_potential(self, z, energy, gradient)
      class(tabulated_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :)
      real(wp), intent(out) :: energy(:), gradient(:, :)
      real(wp) :: at_nodes(size(self%table%nodes)), slope
      integer :: i, interval

      at_nodes(1) = 0.0_wp
      do i = 2, size(at_nodes)
         at_nodes(i) = at_nodes(i - 1) + work(i - 1, self%table%nodes(i))
      end do
      do i = 1, size(z, 1)
         interval = interval_of(self%table%nodes, z(i, 1))
         call self%table%on_interval(interval, z(i, 1), gradient(i, 1), slope)
         energy(i) = at_nodes(max(interval, 1)) + work(interval, z(i, 1))
      end do

   contains

      !> Work from the lower end of an interval, or from the first point for the interval before it.
      pure real(wp) function work(interval, to)
         integer, intent(in) :: interval
         real(wp), intent(in) :: to
         real(wp) :: at_end, at_middle, at_start, from, slope

         from = self%table%nodes(max(interval, 1))
         call self%table%on_interval(interval, from, at_start, slope)
         call self%table%on_interval(interval, 0.5_wp*(from + to), at_middle, slope)
         call self%table%on_interval(interval, to, at_end, slope)
         work = (to - from)*(at_start + 4.0_wp*at_middle + at_end)/6.0_wp
      end function work
   end subroutine tabulated_potential
end module hb_law_tabulated
