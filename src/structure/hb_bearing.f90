!> A bearing, a seal or a foundation: stiffness, damping and mass of two directions, tabulated over the speed of a shaft, the
!> frequency of the motion, or both.
!>
!> Over the speed cubics interpolate first, at each frequency of the table, then over the frequency. The matrices of the structure
!> contain the values at the highest frequency, which apply beyond it; parts (hb_frequency_part) the differences from these.
module hb_bearing
   use hb_frequency_part, only: frequency_part_t, kind_of_part
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
      real(wp), allocatable :: speeds(:)                              !! [rad/s], ascending, two or more, or none
      real(wp), allocatable :: frequencies(:)                         !! [rad/s], likewise, from 0 or more
      real(wp), allocatable :: stiffness(:, :), damping(:, :) !! [N/m], [N s/m], (rows, 4): xx, xy, yx, yy; all frequencies
                                                                      !! at the first speed, then at the next
      real(wp), allocatable :: mass(:, :)                             !! [kg], (rows, 3): xx, xy, yy
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
      integer :: n

      call numbers%add("frequencies", self%frequencies)
      call numbers%add("speeds", self%speeds, required=.not. allocated(self%frequencies))
      call numbers%add("speed", self%speed, required=allocated(self%speeds))
      if (.not. (allocated(self%speeds) .or. allocated(self%frequencies))) return
      n = n_along(self%speeds)*n_along(self%frequencies)
      call numbers%add("stiffness", self%stiffness, n, 4)
      if (.not. allocated(self%damping)) allocate (self%damping(n, 4), source=0.0_wp)
      call numbers%add("damping", self%damping, n, 4)
      if (.not. allocated(self%mass)) allocate (self%mass(n, 3), source=0.0_wp)
      call numbers%add("mass", self%mass, n, 3)
   end subroutine bearing_declare_numbers

   !> Values along an axis of the table; one without it.
   pure integer function n_along(axis)
      real(wp), allocatable, intent(in) :: axis(:)

      n_along = 1
      if (allocated(axis)) n_along = size(axis)
   end function n_along

   logical function bearing_has_valid_numbers(self) result(are_valid)
      class(bearing_t), intent(in) :: self

      are_valid = has_speed(self) .and. has_frequencies(self)
      if (are_valid) are_valid = is_mass(mass_of(self, n_along(self%frequencies)))
   end function bearing_has_valid_numbers

   !> Whether there is a table, with the speed.
   pure logical function has_speed(self)
      type(bearing_t), intent(in) :: self

      has_speed = allocated(self%frequencies)
      if (.not. allocated(self%speeds)) return
      has_speed = size(self%speeds) > 1
      if (has_speed) has_speed = is_ascending(self%speeds) .and. &
                                 self%speed >= self%speeds(1) .and. self%speed <= self%speeds(size(self%speeds))
   end function has_speed

   pure logical function has_frequencies(self)
      type(bearing_t), intent(in) :: self

      has_frequencies = .true.
      if (.not. allocated(self%frequencies)) return
      has_frequencies = size(self%frequencies) > 1
      if (has_frequencies) has_frequencies = is_ascending(self%frequencies) .and. self%frequencies(1) >= 0.0_wp
   end function has_frequencies

   !> Reports a table that is none, a speed outside of it, and a mass with a negative energy.
   subroutine bearing_check(self, problems)
      class(bearing_t), intent(in) :: self
      class(problems_t), intent(inout) :: problems

      if (.not. has_frequencies(self)) then
         call problems%add("frequencies", "two or more are needed, each greater than the one before, the first 0 or more")
         return
      end if
      if (allocated(self%speeds)) then
         associate (speeds => self%speeds)
            if (size(speeds) < 2 .or. .not. is_ascending(speeds)) then
               call problems%add("speeds", "two or more are needed, each greater than the one before")
            else if (.not. has_speed(self)) then
               call problems%add("speed", to_text(self%speed)//" rad/s lies outside of the table, "//to_text(speeds(1))//" to "// &
                                 to_text(speeds(size(speeds))))
            end if
         end associate
      end if
      if (.not. has_speed(self)) return                               ! which has been reported
      if (size(self%mass, 1) /= n_along(self%speeds)*n_along(self%frequencies)) return
      if (.not. is_mass(mass_of(self, n_along(self%frequencies)))) &
         call problems%add("mass", "at the speed and the highest frequency it must have m_xx and m_yy of 0 or more, and "// &
                           "m_xy**2 of at most m_xx m_yy")
   end subroutine bearing_check

   pure integer function bearing_n_dofs(self) result(n_dofs)
      class(bearing_t), intent(in) :: self

      n_dofs = 2
   end function bearing_n_dofs

   !> Adds the bearing, at its speed, to a structure.
   subroutine bearing_add_to(self, structure)
      class(bearing_t), intent(in) :: self
      type(structure_t), intent(inout) :: structure
      type(frequency_part_t) :: parts(2, 2)                           ! the force in x by x, and so on
      real(wp) :: damping(n_along(self%frequencies), 4), mass(n_along(self%frequencies), 4), stiffness(n_along(self%frequencies), 4)
      integer :: i, j, k, n

      n = n_along(self%frequencies)
      do k = 1, n
         stiffness(k, :) = values_at(self, self%stiffness, k)
         damping(k, :) = values_at(self, self%damping, k)
         mass(k, :) = [transpose(mass_of(self, k))]
      end do
      call self%add_matrices(structure, self%dofs, matrix_of(stiffness(n, :)), matrix_of(damping(n, :)), matrix_of(mass(n, :)))
      if (n == 1) return
      do i = 1, 2
         do j = 1, 2
            k = 2*(i - 1) + j
            call new_part(parts(i, j), stiffness(:, k), damping(:, k), mass(:, k), self%dofs(i), self%dofs(j))
         end do
      end do
      call structure%add_parts([parts])

   contains

      !> The difference of a coefficient from its values at the highest frequency.
      subroutine new_part(part, stiffness, damping, mass, row, column)
         type(frequency_part_t), intent(inout) :: part
         real(wp), intent(in) :: stiffness(:), damping(:), mass(:)    !! at the frequencies
         integer, intent(in) :: row, column                           !! degrees of freedom

         associate (w => self%frequencies)
            part%kind = kind_of_part%coefficients
            part%is_of_element = .true.
            part%known = [w(1), w(n)]
            part%n_curves = 3
            call new_monotone_cubic(part%curves(1), w, stiffness - stiffness(n), is_constant_beyond=.true.)
            call new_monotone_cubic(part%curves(2), w, damping - damping(n), is_constant_beyond=.true.)
            call new_monotone_cubic(part%curves(3), w, mass - mass(n), is_constant_beyond=.true.)
            allocate (part%acts(structure%n_dofs), part%feels(structure%n_dofs), source=0.0_wp)
            part%acts(row) = 1.0_wp
            part%feels(column) = 1.0_wp
         end associate
      end subroutine new_part
   end subroutine bearing_add_to

   !> The values of a table at the speed and a frequency of it.
   function values_at(self, table, k) result(values)
      type(bearing_t), intent(in) :: self
      real(wp), intent(in) :: table(:, :)                             !! (rows, :)
      integer, intent(in) :: k                                        !! number of the frequency
      real(wp) :: values(size(table, 2)), slope
      type(monotone_cubic_t) :: curve
      integer :: i

      values = table(k, :)
      if (.not. allocated(self%speeds)) return
      do i = 1, size(values)
         call new_monotone_cubic(curve, self%speeds, table(k::n_along(self%frequencies), i), is_constant_beyond=.true.)
         call curve%at(self%speed, values(i), slope)
      end do
   end function values_at

   !> The matrix of the values xx, xy, yx, yy.
   pure function matrix_of(values) result(matrix)
      real(wp), intent(in) :: values(4)
      real(wp) :: matrix(2, 2)

      matrix = reshape(values, [2, 2], order=[2, 1])
   end function matrix_of

   !> The mass at the speed and a frequency; zero without a table of it.
   function mass_of(self, k) result(mass)
      type(bearing_t), intent(in) :: self
      integer, intent(in) :: k                                        !! number of the frequency
      real(wp) :: mass(2, 2), values(3)

      values = 0.0_wp
      if (allocated(self%mass)) values = values_at(self, self%mass, k)
      mass = matrix_of(values([1, 2, 2, 3]))
   end function mass_of

   !> Whether no motion has a negative kinetic energy.
   pure logical function is_mass(mass)
      real(wp), intent(in) :: mass(2, 2)                              !! symmetric

      is_mass = mass(1, 1) >= 0.0_wp .and. mass(2, 2) >= 0.0_wp
      if (is_mass) is_mass = abs(mass(1, 2)) <= sqrt(mass(1, 1))*sqrt(mass(2, 2))*(1.0_wp + 4.0_wp*epsilon(1.0_wp))
   end function is_mass
end module hb_bearing
