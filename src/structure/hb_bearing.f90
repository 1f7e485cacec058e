!> A bearing: stiffness and damping of two directions, tabulated over the speed of a shaft.
module hb_bearing
   use hb_interpolation, only: is_ascending, monotone_cubic_t, new_monotone_cubic
   use hb_kinds, only: wp
   use hb_numbers, only: numbers_t
   use hb_problems, only: problems_t
   use hb_structure, only: structure_t
   use hb_structure_element, only: structure_element_t
   use hb_text, only: to_text
   implicit none
   private
   public :: bearing_t

   type, extends(structure_element_t) :: bearing_t                    ! its degrees of freedom are the directions x and y
      real(wp) :: speed = 0.0_wp                                      !! [rad/s], in the table
      real(wp), allocatable :: speeds(:)                              !! [rad/s], ascending, two or more
      real(wp), allocatable :: stiffness(:, :), damping(:, :)         !! [N/m], [N s/m], (size(speeds), 4): xx, xy, yx, yy
   contains
      procedure :: declare_numbers => bearing_declare_numbers
      procedure :: has_valid_numbers => bearing_has_valid_numbers
      procedure :: check => bearing_check
      procedure :: n_dofs => bearing_n_dofs
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

   !> Reports a table that is none, and a speed outside of it.
   subroutine bearing_check(self, problems)
      class(bearing_t), intent(in) :: self
      class(problems_t), intent(inout) :: problems

      if (.not. allocated(self%speeds)) return                        ! which has been reported
      associate (speeds => self%speeds)
         if (size(speeds) < 2 .or. .not. is_ascending(speeds)) then
            call problems%add("speeds", "two or more are needed, each greater than the one before")
         else if (.not. self%has_valid_numbers()) then
            call problems%add("speed", to_text(self%speed)//" rad/s lies outside of the table, "//to_text(speeds(1))//" to "// &
                              to_text(speeds(size(speeds))))
         end if
      end associate
   end subroutine bearing_check

   pure integer function bearing_n_dofs(self) result(n_dofs)
      class(bearing_t), intent(in) :: self

      n_dofs = 2
   end function bearing_n_dofs

   !> Adds the bearing, at its speed, to a structure.
   subroutine bearing_add_to(self, structure)
      class(bearing_t), intent(in) :: self
      type(structure_t), intent(inout) :: structure

      call self%add_matrices(structure, matrix_at(self%speeds, self%stiffness, self%speed), &
                             matrix_at(self%speeds, self%damping, self%speed))
   end subroutine bearing_add_to

   !> The matrix of a table at a speed.
   function matrix_at(speeds, table, speed) result(matrix)
      real(wp), intent(in) :: speeds(:), table(:, :)
      real(wp), intent(in) :: speed
      real(wp) :: matrix(2, 2), slope, values(4)
      type(monotone_cubic_t) :: curve
      integer :: k

      do k = 1, 4
         call new_monotone_cubic(curve, speeds, table(:, k), is_constant_beyond=.true.)
         call curve%at(speed, values(k), slope)
      end do
      matrix = reshape(values, [2, 2], order=[2, 1])
   end function matrix_at
end module hb_bearing
