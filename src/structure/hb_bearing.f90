!> A bearing or a seal: stiffness, damping and mass of two directions, tabulated over the speed of a shaft.
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
      real(wp), allocatable :: mass(:, :)                             !! [kg], (size(speeds), 3): xx, xy, yy
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
      if (.not. allocated(self%mass)) allocate (self%mass(size(self%speeds), 3), source=0.0_wp)
      call numbers%add("mass", self%mass, size(self%speeds), 3)
   end subroutine bearing_declare_numbers

   logical function bearing_has_valid_numbers(self) result(are_valid)
      class(bearing_t), intent(in) :: self

      are_valid = has_speed(self)
      if (are_valid) are_valid = is_mass(mass_of(self))
   end function bearing_has_valid_numbers

   !> Whether there is a table, with the speed.
   pure logical function has_speed(self)
      type(bearing_t), intent(in) :: self

      has_speed = size(self%speeds) > 1
      if (has_speed) has_speed = is_ascending(self%speeds) .and. &
                                 self%speed >= self%speeds(1) .and. self%speed <= self%speeds(size(self%speeds))
   end function has_speed

   !> Reports a table that is none, a speed outside of it, and a mass with a negative energy.
   subroutine bearing_check(self, problems)
      class(bearing_t), intent(in) :: self
      class(problems_t), intent(inout) :: problems

      if (.not. allocated(self%speeds)) return                        ! which has been reported
      associate (speeds => self%speeds)
         if (size(speeds) < 2 .or. .not. is_ascending(speeds)) then
            call problems%add("speeds", "two or more are needed, each greater than the one before")
         else if (.not. has_speed(self)) then
            call problems%add("speed", to_text(self%speed)//" rad/s lies outside of the table, "//to_text(speeds(1))//" to "// &
                              to_text(speeds(size(speeds))))
         else if (.not. is_mass(mass_of(self))) then
            call problems%add("mass", "at the speed it must have m_xx and m_yy of 0 or more, and m_xy**2 of at most m_xx m_yy")
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

      call self%add_matrices(structure, matrix_of(values_at(self, self%stiffness)), matrix_of(values_at(self, self%damping)), &
                             mass_of(self))
   end subroutine bearing_add_to

   !> The values of a table at the speed.
   function values_at(self, table) result(values)
      type(bearing_t), intent(in) :: self
      real(wp), intent(in) :: table(:, :)                             !! (size(speeds), :)
      real(wp) :: values(size(table, 2)), slope
      type(monotone_cubic_t) :: curve
      integer :: k

      do k = 1, size(values)
         call new_monotone_cubic(curve, self%speeds, table(:, k), is_constant_beyond=.true.)
         call curve%at(self%speed, values(k), slope)
      end do
   end function values_at

   !> The matrix of the values xx, xy, yx, yy.
   pure function matrix_of(values) result(matrix)
      real(wp), intent(in) :: values(4)
      real(wp) :: matrix(2, 2)

      matrix = reshape(values, [2, 2], order=[2, 1])
   end function matrix_of

   !> The mass at the speed; zero without a table of it.
   function mass_of(self) result(mass)
      type(bearing_t), intent(in) :: self
      real(wp) :: mass(2, 2), values(3)

      values = 0.0_wp
      if (allocated(self%mass)) values = values_at(self, self%mass)
      mass = matrix_of(values([1, 2, 2, 3]))
   end function mass_of

   !> Whether no motion has a negative kinetic energy.
   pure logical function is_mass(mass)
      real(wp), intent(in) :: mass(2, 2)                              !! symmetric

      is_mass = mass(1, 1) >= 0.0_wp .and. mass(2, 2) >= 0.0_wp
      if (is_mass) is_mass = abs(mass(1, 2)) <= sqrt(mass(1, 1))*sqrt(mass(2, 2))*(1.0_wp + 4.0_wp*epsilon(1.0_wp))
   end function is_mass
end module hb_bearing
