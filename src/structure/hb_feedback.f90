!> A linear controller of any number of sensors and actuators, such as that of a magnetic bearing: with the displacements z of the
!> sensors and the states x,
!>
!>     x' = A x + B z,   f(t) = C x(t - T) + D z(t - T) + E z'(t - T),
!>
!> where f stands beside K q, as the force of a spring. The states are degrees of freedom of first order, so that the controller
!> is in all equations of the structure, in those of time, too. A delay T has none: delayed forces are parts (hb_frequency_part).
module hb_feedback
   use hb_frequency_part, only: frequency_part_t, kind_of_part
   use hb_kinds, only: wp
   use hb_null_space, only: find_null_space
   use hb_numbers, only: numbers_t
   use hb_problems, only: problems_t
   use hb_structure, only: structure_t
   use hb_structure_element, only: dof_key_length, structure_element_t
   implicit none
   private
   public :: feedback_t

   type, extends(structure_element_t) :: feedback_t                   ! its degrees of freedom: sensors, then actuators
      integer :: n_states = 0
      real(wp), allocatable :: a(:, :)                                !! A [1/s], (n_states, n_states)
      real(wp), allocatable :: b(:, :)                                !! B [1/(m s)], (n_states, n_sensors)
      real(wp), allocatable :: c(:, :)                                !! C [N], (n_actuators, n_states)
      real(wp), allocatable :: d(:, :)                                !! D [N/m], (n_actuators, n_sensors)
      real(wp), allocatable :: e(:, :)                                !! E [N s/m], likewise
      real(wp) :: delay = 0.0_wp                                      !! T [s]
      logical, private :: integrates = .false.                        ! A is singular
   contains
      procedure :: derive => feedback_derive
      procedure :: declare_numbers => feedback_declare_numbers
      procedure :: has_valid_numbers => feedback_has_valid_numbers
      procedure :: check => feedback_check
      procedure :: get_dof_keys => feedback_get_dof_keys
      procedure :: n_dofs => feedback_n_dofs
      procedure :: add_to => feedback_add_to
      procedure :: wanted_dofs => feedback_wanted_dofs
   end type feedback_t

contains

   subroutine feedback_declare_numbers(self, numbers)
      class(feedback_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers
      logical :: has_states

      call numbers%add("delay", self%delay)
      call numbers%add("n_states", self%n_states)
      if (.not. allocated(self%n_of_key) .or. self%n_states < 0) return
      associate (n => self%n_states, n_sensors => self%n_of_key(1), n_actuators => self%n_of_key(2))
         has_states = n > 0
         if (has_states) then
            call numbers%add("a", self%a, n, n, required=.true.)
            call numbers%add("b", self%b, n, n_sensors, required=.true.)
            call numbers%add("c", self%c, n_actuators, n, required=.true.)
         else
            call numbers%reject("a", "there are no states: give n_states, their number")
            call numbers%reject("b", "there are no states: give n_states, their number")
            call numbers%reject("c", "there are no states: give n_states, their number")
         end if
         if (.not. allocated(self%d)) allocate (self%d(n_actuators, n_sensors), source=0.0_wp)
         call numbers%add("d", self%d, n_actuators, n_sensors)
         if (.not. allocated(self%e)) allocate (self%e(n_actuators, n_sensors), source=0.0_wp)
         call numbers%add("e", self%e, n_actuators, n_sensors)
      end associate
   end subroutine feedback_declare_numbers

   logical function feedback_has_valid_numbers(self) result(are_valid)
      class(feedback_t), intent(in) :: self

      are_valid = self%delay >= 0.0_wp .and. allocated(self%d) .and. allocated(self%e)
      if (self%n_states > 0) are_valid = are_valid .and. allocated(self%a) .and. allocated(self%b) .and. allocated(self%c)
   end function feedback_has_valid_numbers

   !> Whether A is singular.
   pure subroutine feedback_derive(self)
      class(feedback_t), intent(inout) :: self
      real(wp), parameter :: threshold = 100.0_wp*epsilon(1.0_wp)
      real(wp), allocatable :: constant(:, :), scaled(:, :)
      logical :: is_dependent(self%n_states)
      integer :: i

      self%integrates = .false.
      if (self%n_states == 0) return
      allocate (scaled, source=self%a)
      do i = 1, self%n_states
         if (any(abs(scaled(:, i)) > 0.0_wp)) scaled(:, i) = scaled(:, i)/norm2(scaled(:, i))
      end do
      call find_null_space(scaled, threshold, is_dependent, constant)
      self%integrates = any(is_dependent)
   end subroutine feedback_derive

   !> Reports a controller that exerts no force.
   subroutine feedback_check(self, problems)
      class(feedback_t), intent(in) :: self
      class(problems_t), intent(inout) :: problems

      if (.not. self%has_valid_numbers()) return                      ! which has been reported
      if (self%n_states == 0 .and. .not. (any(abs(self%d) > 0.0_wp) .or. any(abs(self%e) > 0.0_wp))) &
         call problems%add("d", "the controller exerts no force: give d or e, or states with c")
   end subroutine feedback_check

   !> The sensors, and the actuators.
   pure subroutine feedback_get_dof_keys(self, keys)
      class(feedback_t), intent(in) :: self
      character(dof_key_length), allocatable, intent(out) :: keys(:)

      keys = [character(dof_key_length) :: "sensors", "actuators"]
   end subroutine feedback_get_dof_keys

   !> Any number.
   pure integer function feedback_n_dofs(self) result(n_dofs)
      class(feedback_t), intent(in) :: self

      n_dofs = 0
   end function feedback_n_dofs

   !> Appends the states, and adds their equations and the forces. A state has the equations of a force: they are multiplied by a
   !> stiffness, so that rows are of one size.
   subroutine feedback_add_to(self, structure)
      class(feedback_t), intent(in) :: self
      type(structure_t), intent(inout) :: structure
      real(wp), allocatable :: damping(:, :), diagonal(:), mass(:), of_damping(:), stiffness(:, :)
      integer :: sensors(self%n_of_key(1)), actuators(self%n_of_key(2)), states(self%n_states)
      integer, allocatable :: at(:)
      real(wp) :: scale
      integer :: i, n

      call structure%diagonals(mass, of_damping, diagonal)
      n = structure%n_dofs
      if (self%n_states > 0) call structure%append_dofs("state", spread("1", 1, self%n_states))
      associate (n_sensors => size(sensors), n_actuators => size(actuators), n_states => self%n_states)
         at = [pack(self%dofs, [(findloc(self%dofs, self%dofs(i), dim=1) == i, i=1, size(self%dofs))]), (n + i, i=1, n_states)]
         sensors = [(findloc(at, self%dofs(i), dim=1), i=1, n_sensors)]
         actuators = [(findloc(at, self%dofs(n_sensors + i), dim=1), i=1, n_actuators)]
         states = [(findloc(at, n + i, dim=1), i=1, n_states)]
         if (n_states > 0 .and. .not. allocated(structure%states)) allocate (structure%states(0))
         if (n_states > 0) structure%states = [structure%states, (n + i, i=1, n_states)]
      end associate
      allocate (stiffness(size(at), size(at)), damping(size(at), size(at)), source=0.0_wp)
      do i = 1, self%n_states
         scale = maxval(abs(diagonal))/max(maxval(abs(self%a(i, :))), maxval(abs(self%b(i, :))))
         if (.not. (scale > 0.0_wp .and. scale < huge(scale))) scale = 1.0_wp
         stiffness(states(i), states) = -scale*self%a(i, :)
         stiffness(states(i), sensors) = -scale*self%b(i, :)
         damping(states(i), states(i)) = scale
      end do
      if (.not. self%delay > 0.0_wp) then
         if (self%n_states > 0) stiffness(actuators, states) = self%c
         stiffness(actuators, sensors) = stiffness(actuators, sensors) + self%d
         damping(actuators, sensors) = damping(actuators, sensors) + self%e
      end if
      call self%add_matrices(structure, at, stiffness, damping)
      if (self%delay > 0.0_wp) call add_delayed(self, structure, at(sensors), at(actuators), at(states))
   end subroutine feedback_add_to

   !> Adds the delayed forces: of each actuator one of states and displacements, and one of rates.
   subroutine add_delayed(self, structure, sensors, actuators, states)
      class(feedback_t), intent(in) :: self
      type(structure_t), intent(inout) :: structure
      integer, intent(in) :: sensors(:), actuators(:), states(:)      !! degrees of freedom
      type(frequency_part_t) :: of_displacement(size(actuators)), of_rate(size(actuators))
      integer :: i

      do i = 1, size(actuators)
         call new_part(of_displacement(i))
         of_displacement(i)%stiffness = 1.0_wp
         of_displacement(i)%feels(sensors) = self%d(i, :)
         if (size(states) > 0) of_displacement(i)%feels(states) = self%c(i, :)
         call new_part(of_rate(i))
         of_rate(i)%damping = 1.0_wp
         of_rate(i)%feels(sensors) = self%e(i, :)
      end do
      call structure%add_parts([of_displacement, of_rate])

   contains

      subroutine new_part(part)
         type(frequency_part_t), intent(inout) :: part

         part%kind = kind_of_part%delay
         part%is_of_element = .true.
         part%delay = self%delay
         allocate (part%acts(structure%n_dofs), part%feels(structure%n_dofs), source=0.0_wp)
         part%acts(actuators(i)) = 1.0_wp
      end subroutine new_part
   end subroutine add_delayed

   !> All states, if some integrate: they have no equilibrium under a constant input.
   pure function feedback_wanted_dofs(self, structure, is_used) result(dofs)
      class(feedback_t), intent(in) :: self
      type(structure_t), intent(in) :: structure
      logical, intent(in) :: is_used(:)
      integer, allocatable :: dofs(:)

      allocate (dofs(0))
      if (self%integrates .and. any(is_used) .and. allocated(structure%states)) dofs = structure%states
   end function feedback_wanted_dofs
end module hb_feedback
