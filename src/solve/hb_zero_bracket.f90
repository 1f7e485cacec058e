!> A bracket of a zero on a step of a curve, which shrinks by false position, in which the weight of the older end falls from
!> step to step (Illinois), and by bisection. Source: Dowell and Jarratt, BIT 11 (1971) 168-174.
module hb_zero_bracket
   use hb_kinds, only: wp
   implicit none
   private
   public :: new_zero_bracket, zero_bracket_t

   real(wp), parameter :: max_change = 1.0e-3_wp                      ! of function and point at a zero: otherwise it is a jump

   !> The bracket.
   type :: zero_bracket_t
      real(wp) :: ends(2) = 0.0_wp                                    !! positions on the step
      real(wp) :: values(2) = 0.0_wp                                  !! of the function there
      real(wp), private :: first_values(2) = 0.0_wp                   ! at the beginning
      real(wp), private :: weights(2) = 1.0_wp                        ! of the values, for false position
      real(wp), private :: positions(2) = 0.0_wp                      ! of the nearest known points
      real(wp), allocatable, private :: x(:, :)                       ! these, (n_unknowns, 2)
      integer, private :: newest = 0                                  ! end
   contains
      procedure :: length => zero_bracket_length
      procedure :: inside => zero_bracket_inside
      procedure :: between => zero_bracket_between
      procedure :: insert => zero_bracket_insert
      procedure :: get_nearest => zero_bracket_get_nearest
      procedure :: has_zero => zero_bracket_has_zero
   end type zero_bracket_t

contains

   !> Creates a bracket on a step from one point to another.
   pure subroutine new_zero_bracket(self, ends, values, from, to, step)
      type(zero_bracket_t), intent(out) :: self
      real(wp), intent(in) :: ends(2), values(2)                      !! values with different signs
      real(wp), intent(in) :: from(:), to(:)                          !! points at the ends of the step
      real(wp), intent(in) :: step                                    !! its length

      self%ends = ends
      self%values = values
      self%first_values = values
      self%positions = [0.0_wp, step]
      allocate (self%x(size(from), 2))
      self%x(:, 1) = from
      self%x(:, 2) = to
   end subroutine new_zero_bracket

   !> Length of the bracket.
   pure real(wp) function zero_bracket_length(self) result(length)
      class(zero_bracket_t), intent(in) :: self

      length = self%ends(2) - self%ends(1)
   end function zero_bracket_length

   !> A position in the bracket: the middle, or that of false position.
   pure real(wp) function zero_bracket_inside(self, is_middle) result(position)
      class(zero_bracket_t), intent(in) :: self
      logical, intent(in) :: is_middle

      position = 0.5_wp*sum(self%ends)
      associate (low => self%weights(1)*self%values(1), high => self%weights(2)*self%values(2))
         if (.not. is_middle .and. abs(high - low) > 0.0_wp) &
            position = self%ends(1) + (self%ends(2) - self%ends(1))*min(0.999_wp, max(0.001_wp, -low/(high - low)))
      end associate
   end function zero_bracket_inside

   !> The line between the nearest points, at a position.
   pure function zero_bracket_between(self, position) result(x)
      class(zero_bracket_t), intent(in) :: self
      real(wp), intent(in) :: position
      real(wp) :: x(size(self%x, 1))

      x = self%x(:, 1) + (position - self%positions(1))/(self%positions(2) - self%positions(1))*(self%x(:, 2) - self%x(:, 1))
   end function zero_bracket_between

   !> Replaces the end with the same sign by a point inside.
   pure subroutine zero_bracket_insert(self, position, x, value)
      class(zero_bracket_t), intent(inout) :: self
      real(wp), intent(in) :: position, x(:), value
      integer :: end

      end = merge(1, 2, value*self%first_values(1) > 0.0_wp)
      if (self%newest == end) self%weights(3 - end) = 0.5_wp*self%weights(3 - end)
      self%newest = end
      self%ends(end) = position
      self%positions(end) = position
      self%values(end) = value
      self%x(:, end) = x
      self%weights(end) = 1.0_wp
   end subroutine zero_bracket_insert

   !> The point at the end with the smaller value.
   pure subroutine zero_bracket_get_nearest(self, position, x)
      class(zero_bracket_t), intent(in) :: self
      real(wp), intent(out) :: position, x(:)
      integer :: end

      end = minloc(abs(self%values), dim=1)
      position = self%positions(end)
      x = self%x(:, end)
   end subroutine zero_bracket_get_nearest

   !> Whether the curve passes through the bracket without a leap, and the function has a zero there, or may jump.
   pure logical function zero_bracket_has_zero(self, units, step, may_jump) result(has_zero)
      class(zero_bracket_t), intent(in) :: self
      real(wp), intent(in) :: units(:), step                          !! of the unknowns; length of the whole step
      logical, intent(in) :: may_jump

      has_zero = norm2((self%x(:, 2) - self%x(:, 1))/units) <= max_change*step .and. &
         (may_jump .or. abs(self%values(2) - self%values(1)) <= max_change*abs(self%first_values(2) - self%first_values(1)))
   end function zero_bracket_has_zero
end module hb_zero_bracket
