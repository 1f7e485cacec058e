!> A bearing: stiffness and damping of two directions, tabulated over the speed of a shaft.
module hb_bearing
   use hb_interpolation, only: is_ascending, monotone_cubic_t, new_monotone_cubic
   use hb_kinds, only: wp
   use hb_numbers, only: numbered_t, numbers_t
   use hb_sparse, only: sparse_from_entries, sparse_sum
   use hb_structure, only: structure_t
   implicit none
   private
   public :: bearing_t

   integer, parameter :: row(4) = [1, 1, 2, 2], column(4) = [1, 2, 1, 2]   ! of the columns of a table: xx, xy, yx, yy

   type, extends(numbered_t) :: bearing_t
      integer :: dofs(2) = 0                                          !! directions x and y
      real(wp) :: speed = 0.0_wp                                      !! [rad/s], in the table
      real(wp), allocatable :: speeds(:)                              !! [rad/s], ascending, two or more
      real(wp), allocatable :: stiffness(:, :), damping(:, :)         !! [N/m], [N s/m], (size(speeds), 4)
   contains
      procedure :: declare_numbers => bearing_declare_numbers
      procedure :: has_valid_numbers => bearing_has_valid_numbers
      procedure :: is_complete => bearing_is_complete
      procedure :: add_to => bearing_add_to
   end type bearing_t

contains

   subroutine bearing_declare_numbers(self, numbers)
      class(bearing_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("speed", self%speed)
      call numbers%add("speeds", self%speeds)
      if (.not. allocated(self%speeds)) return
      call numbers%add("stiffness", self%stiffness, size(self%speeds), 4)
      if (.not. allocated(self%damping)) allocate (self%damping(size(self%speeds), 4), source=0.0_wp)
      call numbers%add("damping", self%damping, size(self%speeds), 4)
   end subroutine bearing_declare_numbers

   logical function bearing_has_valid_numbers(self) result(are_valid)
      class(bearing_t), intent(in) :: self

      are_valid = size(self%speeds) > 1
      if (are_valid) are_valid = is_ascending(self%speeds) .and. &
                                 self%speed >= self%speeds(1) .and. self%speed <= self%speeds(size(self%speeds))
   end function bearing_has_valid_numbers

   !> Whether all numbers are there, and fit together.
   logical function bearing_is_complete(self) result(is_complete)
      class(bearing_t), intent(in) :: self

      is_complete = allocated(self%speeds) .and. allocated(self%stiffness) .and. all(self%dofs > 0)
      if (is_complete) is_complete = all([size(self%stiffness, 1), size(self%damping, 1)] == size(self%speeds)) .and. &
                                     self%has_valid_numbers()
   end function bearing_is_complete

   !> Adds the bearing, at its speed, to a structure.
   subroutine bearing_add_to(self, structure)
      class(bearing_t), intent(in) :: self
      type(structure_t), intent(inout) :: structure

      call add_at(structure, self%dofs, values_at(self%speeds, self%stiffness, self%speed), &
                  values_at(self%speeds, self%damping, self%speed))
   end subroutine bearing_add_to

   !> The four coefficients at a speed.
   function values_at(speeds, table, speed) result(values)
      real(wp), intent(in) :: speeds(:), table(:, :)
      real(wp), intent(in) :: speed
      real(wp) :: slope, values(4)
      type(monotone_cubic_t) :: curve
      integer :: k

      do k = 1, 4
         call new_monotone_cubic(curve, speeds, table(:, k), is_constant_beyond=.true.)
         call curve%at(speed, values(k), slope)
      end do
   end function values_at

   subroutine add_at(structure, dofs, stiffness, damping)
      type(structure_t), intent(inout) :: structure
      integer, intent(in) :: dofs(2)
      real(wp), intent(in) :: stiffness(4), damping(4)
      integer :: k

      if (allocated(structure%sparse)) then
         associate (s => structure%sparse, n => structure%n_dofs)
            s%stiffness = sparse_sum(1.0_wp, s%stiffness, 1.0_wp, sparse_from_entries(n, dofs(row), dofs(column), stiffness))
            s%damping = sparse_sum(1.0_wp, s%damping, 1.0_wp, sparse_from_entries(n, dofs(row), dofs(column), damping))
         end associate
         return
      end if
      do k = 1, 4
         associate (i => dofs(row(k)), j => dofs(column(k)))
            structure%stiffness(i, j) = structure%stiffness(i, j) + stiffness(k)
            structure%damping(i, j) = structure%damping(i, j) + damping(k)
         end associate
      end do
   end subroutine add_at
end module hb_bearing
