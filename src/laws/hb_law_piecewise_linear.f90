!> Continuous piecewise linear spring: slope s_1 below the first breakpoint, s_2 to the second, ..., s_(n+1) above the last.
!> Source: docs/why/theory.md, section 5.2. Sign: f stands beside K q on the left-hand side.
module hb_law_piecewise_linear
   use hb_interpolation, only: interval_of, is_ascending
   use hb_kinds, only: wp
   use hb_law, only: law_t
   use hb_numbers, only: number_t, numbers_t
   use hb_problems, only: problems_t
   implicit none
   private
   public :: new_piecewise_linear, piecewise_linear_t

   type, extends(law_t) :: piecewise_linear_t
      real(wp), allocatable :: breakpoints(:)                         !! [m], ascending, at least one
      real(wp), allocatable :: slopes(:)                              !! [N/m], one more than breakpoints
      real(wp) :: force_at_zero = 0.0_wp                              !! [N]
      real(wp), allocatable :: forces(:)                              !! at the breakpoints [N]
   contains
      procedure :: declare_numbers => piecewise_linear_declare_numbers
      procedure :: has_valid_numbers => piecewise_linear_has_valid_numbers
      procedure :: check => piecewise_linear_check
      procedure :: derive => piecewise_linear_derive
      procedure :: number_slope => piecewise_linear_number_slope
      procedure :: evaluate => piecewise_linear_evaluate
      procedure :: potential => piecewise_linear_potential
      procedure :: switches => piecewise_linear_switches
      procedure :: evaluate_held => piecewise_linear_evaluate_held
   end type piecewise_linear_t

contains

   !> Spring of the given slopes between the breakpoints, with the given force at z = 0.
   pure subroutine new_piecewise_linear(self, breakpoints, slopes, force_at_zero)
      class(piecewise_linear_t), intent(inout) :: self
      real(wp), intent(in) :: breakpoints(:)                          !! [m], ascending, at least one
      real(wp), intent(in) :: slopes(:)                               !! [N/m], one more than breakpoints
      real(wp), intent(in) :: force_at_zero                           !! [N]

      self%breakpoints = breakpoints
      self%slopes = slopes
      self%force_at_zero = force_at_zero
      call self%derive()
   end subroutine new_piecewise_linear

   subroutine piecewise_linear_declare_numbers(self, numbers)
      class(piecewise_linear_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("breakpoints", self%breakpoints)
      call numbers%add("force_at_zero", self%force_at_zero)
      if (allocated(self%breakpoints)) call numbers%add("slopes", self%slopes, n=size(self%breakpoints) + 1)
   end subroutine piecewise_linear_declare_numbers

   pure logical function piecewise_linear_has_valid_numbers(self) result(are_valid)
      class(piecewise_linear_t), intent(in) :: self

      are_valid = allocated(self%breakpoints) .and. allocated(self%slopes)
      if (are_valid) are_valid = size(self%slopes) == size(self%breakpoints) + 1 .and. is_ascending(self%breakpoints)
   end function piecewise_linear_has_valid_numbers

   subroutine piecewise_linear_check(self, problems)
      class(piecewise_linear_t), intent(in) :: self
      class(problems_t), intent(inout) :: problems

      if (.not. allocated(self%breakpoints)) return
      if (.not. is_ascending(self%breakpoints)) call problems%add("breakpoints", "each must be greater than the one before")
   end subroutine piecewise_linear_check

   pure subroutine piecewise_linear_derive(self)
      class(piecewise_linear_t), intent(inout) :: self
      real(wp) :: at_zero
      integer :: i

      self%has_potential = .true.                                     ! even if other numbers have problems
      if (.not. self%has_valid_numbers()) return
      associate (breakpoints => self%breakpoints, slopes => self%slopes, n => size(self%breakpoints))
         self%forces = [(0.0_wp, i=1, n)]
         do i = 2, n
            self%forces(i) = self%forces(i - 1) + slopes(i)*(breakpoints(i) - breakpoints(i - 1))
         end do
         at_zero = force_at(self, interval_of(breakpoints, 0.0_wp), 0.0_wp)
         self%forces = self%forces + (self%force_at_zero - at_zero)
         self%is_piecewise_linear = .true.
         self%has_convex_free_region = all(slopes >= 0.0_wp)          ! a force that rises is zero in one interval at most
         self%length_scale = maxval(abs(breakpoints))
         self%n_switches = n
         call self%set_kinks_of_coordinate(breakpoints, slopes(2:) - slopes(:n))
      end associate
      ! Odd if breakpoints and slopes are symmetric about zero and the force is zero there.
      associate (breakpoints => self%breakpoints, n => size(self%breakpoints), rounding => 8*epsilon(1.0_wp))
         self%is_odd = all(abs(breakpoints + breakpoints(n:1:-1)) <= rounding*abs(breakpoints)) .and. &
                       all(abs(self%slopes - self%slopes(n + 1:1:-1)) <= rounding*abs(self%slopes)) .and. &
                       all(abs(self%forces + self%forces(n:1:-1)) <= rounding*maxval(abs(self%forces)))
      end associate
   end subroutine piecewise_linear_derive

   subroutine piecewise_linear_evaluate(self, z, v, p, f, df_dz, df_dv, df_dp)
      class(piecewise_linear_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)
      integer :: i, piece

      do i = 1, size(z, 1)
         piece = interval_of(self%breakpoints, z(i, 1))
         f(i, 1) = force_at(self, piece, z(i, 1))
         if (present(df_dz)) df_dz(i, 1, 1) = self%slopes(piece + 1)
      end do
   end subroutine piecewise_linear_evaluate

   !> The force is f_0 + the integral of the slopes from 0 to z.
   subroutine piecewise_linear_number_slope(self, number, z, v, p, slope, is_known)
      class(piecewise_linear_t), intent(in) :: self
      type(number_t), intent(in) :: number
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: slope(:, :)
      logical, intent(out) :: is_known
      real(wp) :: from, to
      integer :: i

      is_known = .true.
      i = max(1, number%element(1))
      associate (b => self%breakpoints, s => self%slopes)
         select case (number%key)
         case ("breakpoints")
            slope = (s(i) - s(i + 1))*(merge(1.0_wp, 0.0_wp, z > b(i)) - merge(1.0_wp, 0.0_wp, b(i) < 0.0_wp))
         case ("slopes")
            from = -huge(1.0_wp)
            to = huge(1.0_wp)
            if (i > 1) from = b(i - 1)
            if (i <= size(b)) to = b(i)
            slope = min(max(z, from), to) - min(max(0.0_wp, from), to)
         case ("force_at_zero")
            slope = 1.0_wp
         case default
            is_known = .false.
         end select
      end associate
   end subroutine piecewise_linear_number_slope

   !> Force on piece 0, ..., n, measured from the breakpoint at its lower end; piece 0 from that at its upper end.
   pure real(wp) function force_at(self, piece, z)
      class(piecewise_linear_t), intent(in) :: self
      integer, intent(in) :: piece
      real(wp), intent(in) :: z
      integer :: node

      node = max(piece, 1)
      force_at = self%forces(node) + self%slopes(piece + 1)*(z - self%breakpoints(node))
   end function force_at

   pure subroutine piecewise_linear_switches(self, z, v, values)
      class(piecewise_linear_t), intent(in) :: self
      real(wp), intent(in) :: z(:), v(:)
      real(wp), intent(out) :: values(:)

      values = z(1) - self%breakpoints
   end subroutine piecewise_linear_switches

   subroutine piecewise_linear_evaluate_held(self, z, v, is_positive, f)
      class(piecewise_linear_t), intent(in) :: self
      real(wp), intent(in) :: z(:), v(:)
      logical, intent(in) :: is_positive(:)
      real(wp), intent(out) :: f(:)

      f(1) = force_at(self, count(is_positive), z(1))
   end subroutine piecewise_linear_evaluate_held

   !> Trapezoids from the first breakpoint on.
   subroutine piecewise_linear_potential(self, z, energy, gradient)
      class(piecewise_linear_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :)
      real(wp), intent(out) :: energy(:), gradient(:, :)
      real(wp) :: at_nodes(size(self%breakpoints))
      integer :: i, node, piece

      at_nodes(1) = 0.0_wp
      do i = 2, size(at_nodes)
         at_nodes(i) = at_nodes(i - 1) + 0.5_wp*sum(self%forces(i - 1:i))*(self%breakpoints(i) - self%breakpoints(i - 1))
      end do
      do i = 1, size(z, 1)
         piece = interval_of(self%breakpoints, z(i, 1))
         node = max(piece, 1)
         gradient(i, 1) = force_at(self, piece, z(i, 1))
         energy(i) = at_nodes(node) + 0.5_wp*(self%forces(node) + gradient(i, 1))*(z(i, 1) - self%breakpoints(node))
      end do
   end subroutine piecewise_linear_potential
end module hb_law_piecewise_linear
