!> The balance of a model in which one value moves: an additional parameter of the problem, besides base frequencies and
!> artificial damping.
!> The value is a number of the model (hb_model_number), and numbers that follow it by ties move along. If it is the
!> frequency of a tone, the balance moves to it; numbers of laws are set in them; structure and loads are built again, and
!> condensed. For the amplitude or the energy of a normal mode, the balance is unchanged and an equation is added.
!> The derivative of the residual with respect to the value is the sum of those with respect to all numbers that move:
!> exact for frequencies and for numbers of laws that know it, a difference of their forces for other numbers of laws, to both
!> sides or, at an end of a range, to one, and that of hb_linear_slopes for structure and loads. Numbers that follow the frequency
!> of an unknown tone move with it in the same way, and the derivative with respect to the frequency includes them. Source:
!> docs/why/theory.md, section 6.7.
module hb_model_problem
   use hb_amplitudes, only: amplitudes_t
   use hb_balance, only: balance_t, new_balance
   use hb_contact_stiffness, only: contact_stiffness_of
   use hb_coordinates, only: coordinates_t
   use hb_discretisation, only: discretisation_t
   use hb_dynamic_stiffness, only: dynamic_stiffness_t, new_dynamic_stiffness, wanted_slopes_t
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   use hb_law_coordinates, only: laws_at
   use hb_linear_part, only: linear_part_t, new_linear_part
   use hb_linear_slopes, only: beside_t, find_slopes_between, find_slopes_by, linear_slopes_t, reaction_slope
   use hb_model, only: model_t
   use hb_model_number, only: has_number, moving_value_t, values_at
   use hb_movement, only: movement_t, movement_with_tone, new_movement, set_movement
   use hb_options, only: options_t
   use hb_refusal, only: refusal_t
   use hb_system, only: coordinates_of, system_t
   use hb_thresholds, only: difference_step
   implicit none
   private
   public :: model_problem_t, new_model_problem

   !> Owns external resources: call `destroy`.
   type, extends(balance_t) :: model_problem_t
      type(model_t) :: model                                          !! at the present value
      integer :: own = 0                                              !! number of the moving value among the parameters
      integer, allocatable :: which(:)                                !! parameters that are unknown along a curve, the value last
      logical :: moves_frequency = .false.                            !! the value is that of a tone, and nothing else moves
      logical :: moves_mode = .false.                                 !! the value is the amplitude or the energy of a normal mode
      type(refusal_t) :: refusal                                      !! since the last step of a curve began
      type(moving_value_t), private :: moving
      type(movement_t), private :: movement                           ! of all numbers that move with the value
      type(movement_t), allocatable, private :: with_tones(:)         ! likewise with the frequencies of unknown tones, (n_tones)
      real(wp), private :: value = 0.0_wp                             ! the present one
      real(wp), private :: first_value = 0.0_wp                       ! that of the model of `new_model_problem`
      real(wp), allocatable :: omega_slopes(:)                        !! derivatives of base frequencies by the value, (n_tones)
      real(wp), allocatable, private :: followed(:)                   ! frequencies that numbers follow [rad/s], (n_tones)
      logical, private :: has_stiffness = .false.
      logical, private :: is_sound = .false.                          ! model and balance belong to the value
   contains
      procedure :: update_regular_preconditioner => model_problem_update_regular_preconditioner
      procedure :: parameters => model_problem_parameters
      procedure :: parameter_scales => model_problem_parameter_scales
      procedure :: set_parameters => model_problem_set_parameters
      procedure :: move_to_point => model_problem_move_to_point
      procedure :: parameter_derivative => model_problem_parameter_derivative
      procedure :: choose_number => model_problem_choose_number
      procedure :: follows_tones => model_problem_follows_tones
      procedure :: find_linear_slopes => model_problem_find_linear_slopes
      procedure :: add_law_slopes => model_problem_add_law_slopes
      procedure :: moves_coordinates => model_problem_moves_coordinates
      procedure :: rebuild_balance => model_problem_rebuild_balance
      procedure :: destroy => model_problem_destroy
      procedure :: roughness => model_problem_roughness
      procedure :: rounding_level => model_problem_rounding_level
   end type model_problem_t

contains

   !> Creates the problem of a model. Fails for a number that cannot move, and for a model without laws.
   subroutine new_model_problem(self, system, discretisation, options, moving, value, error)
      type(model_problem_t), intent(inout) :: self
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(moving_value_t), intent(in) :: moving
      real(wp), intent(in) :: value                                   !! its value in the model
      type(error_t), allocatable, intent(out) :: error
      integer :: tone

      self%model%system = system
      self%model%discretisation = discretisation
      self%model%options = options
      self%first_value = value
      self%own = 2*system%tones%n_tones + 1
      self%n_unknowns = 0
      self%has_stiffness = .false.
      self%omega = system%tones%omega
      self%xi = 0.0_wp*system%tones%omega
      call adopt_value(self, moving, value, error)
      if (allocated(error)) return
      if (allocated(self%with_tones)) deallocate (self%with_tones)
      allocate (self%with_tones(system%tones%n_tones))
      do tone = 1, system%tones%n_tones
         if (system%tones%is_unknown(tone)) self%with_tones(tone) = movement_with_tone(system, tone)
      end do
      self%moves_frequency = self%movement%tones .and. .not. (self%movement%needs_balance() .or. self%follows_tones())
      self%followed = 0.0_wp*system%tones%omega                       ! not yet
      if (self%follows_tones()) then
         call follow_tones(self, system%tones%omega, error)
      else
         call rebuild(self, error)
      end if
   end subroutine new_model_problem

   !> Frees external resources; safe to call twice.
   subroutine model_problem_destroy(self)
      class(model_problem_t), intent(inout) :: self

      call self%balance_t%destroy()
      call self%model%system%clear()
   end subroutine model_problem_destroy

   !> Adopts the value that moves.
   subroutine adopt_value(self, moving, value, error)
      type(model_problem_t), intent(inout) :: self
      type(moving_value_t), intent(in) :: moving
      real(wp), intent(in) :: value
      type(error_t), allocatable, intent(out) :: error

      self%moving = moving
      self%value = value
      self%first_value = value
      self%moves_mode = moving%number%object == has_number%normal_mode
      call new_movement(self%movement, self%model, moving%number, moving%is_tied, error)
      if (.not. allocated(error)) self%omega_slopes = self%movement%omega_slopes(self%model%system%tones)
   end subroutine adopt_value

   !> Whether numbers follow frequencies of unknown tones.
   pure logical function model_problem_follows_tones(self) result(follows)
      class(model_problem_t), intent(in) :: self
      integer :: i

      follows = any([(self%with_tones(i)%moves(), i=1, size(self%with_tones))])
   end function model_problem_follows_tones

   !> Makes another number of laws the value that moves; the present one returns to its value in the model of
   !> `new_model_problem`. `is_done` is false unless both move laws alone: create another problem.
   subroutine model_problem_choose_number(self, moving, value, is_done)
      class(model_problem_t), intent(inout) :: self
      type(moving_value_t), intent(in) :: moving
      real(wp), intent(in) :: value                                   !! its value in the model
      logical, intent(out) :: is_done
      type(movement_t) :: movement
      type(error_t), allocatable :: error

      is_done = self%is_sound
      if (.not. is_done) return
      call new_movement(movement, self%model, moving%number, moving%is_tied, error)
      is_done = .not. allocated(error)
      if (is_done) is_done = movement%is_of_laws() .and. self%movement%is_of_laws() .and. .not. self%follows_tones()
      if (.not. is_done) return
      call move_to(self, self%first_value, is_done)
      if (is_done) call adopt_value(self, moving, value, error)
   end subroutine model_problem_choose_number

   !> Creates the balance of laws with other numbers.
   subroutine replace_laws(self, error)
      type(model_problem_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error
      type(coordinates_t) :: coordinates

      logical :: is_same

      coordinates = coordinates_of(self%model%system)
      is_same = coordinates%equal(self%stiffness%coordinates)
      if (is_same .and. allocated(self%stiffness%contacts)) &
         is_same = all(contact_stiffness_of(laws_at(coordinates, self%model%system%laws), coordinates%n) == &
                       self%stiffness%magnitude(:, 1))
      if (is_same) then
         call self%balance_t%replace_laws(laws_at(coordinates, self%model%system%laws))
         self%is_sound = .true.
      else
         call rebuild(self, error)
      end if
   end subroutine replace_laws

   !> Creates stiffness and balance of the model again; the stiffness remains if only laws have changed.
   subroutine rebuild(self, error)
      type(model_problem_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error
      type(coordinates_t) :: coordinates
      type(dynamic_stiffness_t) :: stiffness
      class(linear_part_t), allocatable :: linear
      real(wp), allocatable :: xi(:)
      integer :: n_before
      logical :: has_slopes, keeps_stiffness

      self%is_sound = .false.
      allocate (xi, source=self%xi)
      n_before = self%n_unknowns
      has_slopes = self%movement%tones .or. any(self%model%system%tones%is_unknown)
      associate (model => self%model)
         coordinates = coordinates_of(model%system)
         if (coordinates%n == 0) then
            call fail(error, "a curve needs unknowns: a law, or a degree of freedom that is kept")
            return
         end if
         call find_contacts(self, coordinates, linear)
         if (.not. allocated(linear)) then
            keeps_stiffness = self%movement%is_of_laws() .and. self%has_stiffness .and. .not. self%follows_tones()
            if (keeps_stiffness) keeps_stiffness = coordinates%equal(self%stiffness%coordinates)
            if (keeps_stiffness) then
               call self%stiffness%transfer_to(stiffness)
            else
               call new_dynamic_stiffness(stiffness, model%system%structure, coordinates, &
                  model%discretisation%harmonics%frequencies(model%system%tones%omega), &
                  model%system%loads_in(model%discretisation%harmonics), error, &
                  wanted_slopes_t(is_on=has_slopes, of_motion=model%system%normal_mode%has_energy, &
                                  loads=model%system%load_slopes_in(model%discretisation%harmonics)), &
                  model%discretisation%harmonics%tuples)
               if (allocated(error)) return
            end if
            allocate (linear)
            call new_linear_part(linear, stiffness)
         end if
         call new_balance(self%balance_t, model%discretisation%harmonics, model%discretisation%torus, model%system%tones%omega, &
                          linear, laws_at(coordinates, model%system%laws), error)
      end associate
      self%has_stiffness = .not. allocated(error)
      if (allocated(error)) return
      if (n_before > 0 .and. n_before /= self%n_unknowns) then
         self%n_unknowns = n_before
         call fail(error, "the number of unknowns must not change along a curve")
         return
      end if
      if (any(abs(xi) > 0.0_wp)) call self%move(self%model%system%tones%omega, xi, error)
      self%is_sound = .not. allocated(error)
   end subroutine rebuild

   !> The linear part of the contacts of a whole model by its factor, where matrices and coordinates do not move.
   subroutine find_contacts(self, coordinates, linear)
      type(model_problem_t), intent(inout) :: self
      type(coordinates_t), intent(in) :: coordinates
      class(linear_part_t), allocatable, intent(out) :: linear

      associate (system => self%model%system, discretisation => self%model%discretisation)
         if (.not. associated(system%contact_parts) .or. any(system%tones%is_unknown)) return
         if (self%movement%structure .or. self%movement%coordinates) return
         call system%contact_parts%find_linear_part(system%structure, coordinates, laws_at(coordinates, system%laws), &
            discretisation%harmonics%frequencies(system%tones%omega), system%loads_in(discretisation%harmonics), linear, &
            system%load_slopes_in(discretisation%harmonics))
      end associate
   end subroutine find_contacts

   !> Creates the balance again at its present value, so that its scales do not depend on previous values.
   subroutine model_problem_rebuild_balance(self)
      class(model_problem_t), intent(inout) :: self
      type(error_t), allocatable :: error

      if (self%moves_frequency .or. self%moves_mode) return           ! the scales never change
      if (self%is_sound .and. .not. self%follows_tones() .and. (self%movement%is_of_laws() .or. moves_loads_alone(self))) then
         call replace_laws(self, error)
      else
         call rebuild(self, error)
      end if
   end subroutine model_problem_rebuild_balance

   !> Roughness of the residual in the base frequencies: its change when they change in their last digits. The
   !> condensed stiffness of a beam of 200 elements, whose condition number is 1e11, has other rounding errors at each
   !> frequency.
   real(wp) function model_problem_roughness(self, x) result(change)
      class(model_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), parameter :: equal_values_rounding = 16.0_wp*epsilon(1.0_wp) ! relative
      real(wp) :: sides(size(x), -1:1)
      logical :: is_possible

      change = 0.0_wp
      call find_sides(self, x, equal_values_rounding, sides, is_possible)
      if (is_possible) change = max(self%norm(sides(:, -1) - sides(:, 0)), self%norm(sides(:, 1) - sides(:, 0)))
   end function model_problem_roughness

   !> As that of a balance, with the roughness at x: the level that the corrector of a curve can reach. The entries of stiff
   !> structures do not change with the last digits of a frequency, so that this is also compared farther away, by second
   !> differences, which are zero for a smooth residual.
   real(wp) function model_problem_rounding_level(self, x) result(level)
      class(model_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), parameter :: value_change = 16384.0_wp*epsilon(1.0_wp) ! relative
      real(wp) :: sides(size(x), -1:1)
      logical :: is_possible

      level = max(self%balance_t%rounding_level(x), self%roughness(x))
      call find_sides(self, x, value_change, sides, is_possible)
      if (is_possible) level = max(level, 0.5_wp*self%norm(sides(:, -1) - 2.0_wp*sides(:, 0) + sides(:, 1)))
   end function model_problem_rounding_level

   !> The residual at the base frequencies, and at a relative distance on either side, if coordinates are condensed.
   subroutine find_sides(self, x, distance, sides, is_possible)
      class(model_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(in) :: distance
      real(wp), intent(out), contiguous :: sides(:, -1:)
      logical, intent(out) :: is_possible                             !! false: nothing is condensed, or no such frequencies
      real(wp) :: omega(size(self%omega)), value
      integer :: k

      is_possible = self%model%system%structure%n_dofs > self%n_dofs .and. &
                    (self%movement%tones .or. any(self%model%system%tones%is_unknown)) .and. &
                    .not. allocated(self%stiffness%contacts)
      if (.not. is_possible) return
      omega = self%omega
      value = self%value
      call self%residual(x, sides(:, 0))
      do k = -1, 1, 2
         call move_by_factor(1.0_wp + k*distance)
         if (.not. is_possible) exit
         call self%residual(x, sides(:, k))
      end do
      call move_by_factor(1.0_wp)

   contains

      subroutine move_by_factor(factor)
         real(wp), intent(in) :: factor
         integer :: i
         logical :: is_there

         if (self%movement%tones .and. (self%movement%structure .or. self%movement%laws)) then
            call move_to(self, factor*value, is_there)
         else
            call self%balance_t%set_parameters([(i, i=1, size(omega))], factor*omega, is_there)
         end if
         is_possible = is_possible .and. is_there
      end subroutine move_by_factor
   end subroutine find_sides

   !> Sets model and balance to a value.
   subroutine move_to(self, value, is_possible)
      type(model_problem_t), intent(inout) :: self
      real(wp), intent(in) :: value
      logical, intent(out) :: is_possible
      type(error_t), allocatable :: error

      is_possible = .true.
      if (self%is_sound .and. abs(value - self%value) <= 0.0_wp) return
      if (self%moves_mode) then
         is_possible = self%is_sound .and. self%value*value > 0.0_wp
         if (is_possible) then
            self%value = value
         else
            call self%refusal%note("an amplitude or energy must not be 0", value)
         end if
         return
      end if
      self%value = value
      call set_numbers(self, self%movement, value, error)
      is_possible = .not. allocated(error)
      if (is_possible) then
         self%refusal%possible = value
      else
         call self%refusal%note(error%message, value)
      end if
   end subroutine move_to

   !> Sets the numbers of a movement in the model, and the balance accordingly.
   subroutine set_numbers(self, movement, value, error, laws_only)
      type(model_problem_t), intent(inout) :: self
      type(movement_t), intent(in) :: movement
      real(wp), intent(in) :: value
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: laws_only                      !! only numbers of laws
      type(amplitudes_t) :: loads
      logical :: is_alike, is_of_laws, is_possible
      integer :: i

      self%is_sound = .false.
      loads = self%model%system%loads_in(self%harmonics)
      is_of_laws = movement%is_of_laws()
      if (present(laws_only)) is_of_laws = is_of_laws .or. laws_only
      call set_movement(self%model, movement, value, error, is_alike, laws_only)
      if (allocated(error)) return
      if (is_of_laws .and. is_alike .and. self%has_stiffness) then
         call replace_laws(self, error)
      else if (movement%tones .and. .not. movement%needs_balance()) then
         call self%balance_t%set_parameters([(i, i=1, size(self%omega))], self%model%system%tones%omega, is_possible)
         if (.not. is_possible) call fail(error, "the structure has no condensed stiffness at these frequencies")
         self%is_sound = is_possible
      else if (moves_loads_alone(self)) then
         call self%stiffness%change_loads(self%model%system%structure, self%frequencies, loads, &
                                          self%model%system%loads_in(self%harmonics), error)
         self%has_stiffness = .not. allocated(error)
         if (self%has_stiffness) call replace_laws(self, error)
      else
         call rebuild(self, error)
      end if
   end subroutine set_numbers

   !> Whether the value moves loads alone, on a stiffness that can take others.
   pure logical function moves_loads_alone(self)
      type(model_problem_t), intent(in) :: self

      moves_loads_alone = self%movement%is_of_loads() .and. self%has_stiffness
      if (moves_loads_alone) moves_loads_alone = .not. allocated(self%stiffness%condensed_slope)
   end function moves_loads_alone

   !> Sets model and balance to the frequencies that numbers follow.
   subroutine follow_tones(self, omega, error)
      type(model_problem_t), intent(inout) :: self
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones)
      type(error_t), allocatable, intent(out) :: error
      integer :: tone
      logical :: is_alike, is_same

      is_same = self%is_sound
      do tone = 1, size(omega)
         if (self%with_tones(tone)%moves()) is_same = is_same .and. abs(omega(tone) - self%followed(tone)) <= 0.0_wp
      end do
      if (is_same) return
      self%is_sound = .false.
      self%followed = 0.0_wp*omega
      do tone = 1, size(omega)
         if (.not. self%with_tones(tone)%moves()) cycle
         call set_movement(self%model, self%with_tones(tone), omega(tone), error, is_alike)
         if (allocated(error)) return
      end do
      call rebuild(self, error)
      if (.not. allocated(error)) self%followed = omega
   end subroutine follow_tones

   pure function model_problem_parameters(self, which) result(values)
      class(model_problem_t), intent(in) :: self
      integer, intent(in) :: which(:)
      real(wp) :: values(size(which))

      values = self%balance_t%parameters(merge(1, which, which == self%own))
      where (which == self%own) values = self%value
   end function model_problem_parameters

   pure function model_problem_parameter_scales(self, which) result(scales)
      class(model_problem_t), intent(in) :: self
      integer, intent(in) :: which(:)
      real(wp) :: scales(size(which))

      scales = self%balance_t%parameter_scales(merge(1, which, which == self%own))
      where (which == self%own) scales = self%moving%typical
   end function model_problem_parameter_scales

   subroutine model_problem_set_parameters(self, which, values, is_possible)
      class(model_problem_t), intent(inout) :: self
      integer, intent(in) :: which(:)
      real(wp), intent(in) :: values(:)
      logical, intent(out) :: is_possible
      type(error_t), allocatable :: error
      integer :: i

      is_possible = .true.
      i = findloc(which, self%own, dim=1)
      if (i > 0) call move_to(self, values(i), is_possible)
      if (is_possible .and. any(which /= self%own)) &
         call self%balance_t%set_parameters(pack(which, which /= self%own), pack(values, which /= self%own), is_possible)
      if (.not. is_possible .or. all(which == self%own)) return
      self%model%system%tones%omega = self%omega                      ! for a new balance
      if (.not. self%follows_tones()) return
      call follow_tones(self, (self%omega), error)
      is_possible = .not. allocated(error)
      if (.not. is_possible) call self%refusal%note(error%message, self%value)
   end subroutine model_problem_set_parameters

   !> Moves to the parameters of a point of a curve.
   subroutine model_problem_move_to_point(self, x, is_possible)
      class(model_problem_t), intent(inout) :: self
      real(wp), intent(in) :: x(:)                                    !! unknowns, then the parameters `which`
      logical, intent(out) :: is_possible

      call self%set_parameters(self%which, x(self%n_unknowns + 1:), is_possible)
   end subroutine model_problem_move_to_point

   subroutine model_problem_parameter_derivative(self, x, which, derivative)
      class(model_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      integer, intent(in) :: which
      real(wp), intent(out), contiguous :: derivative(:)

      if (which == self%own) then
         derivative = 0.0_wp
         if (.not. self%moves_mode) call add_derivative(self, self%movement, self%value, self%moving%typical, x, derivative)
         return
      end if
      call self%balance_t%parameter_derivative(x, which, derivative)
      if (which < 1 .or. which > size(self%with_tones)) return
      if (self%with_tones(which)%moves()) &
         call add_derivative(self, self%with_tones(which), self%followed(which), self%followed(which), x, derivative)
   end subroutine model_problem_parameter_derivative

   !> Adds the derivatives of the residual by all numbers that move; zero for a number that cannot move.
   subroutine add_derivative(self, movement, value, typical, x, derivative)
      type(model_problem_t), intent(inout) :: self
      type(movement_t), intent(in) :: movement
      real(wp), intent(in) :: value                                   !! with which they move
      real(wp), intent(in) :: typical                                 !! of the value, > 0
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(inout) :: derivative(:)
      real(wp) :: part(size(x)), slopes(size(self%omega))
      integer :: tone

      if (movement%laws) call add_derivative_of_laws(self, movement, value, typical, x, derivative)
      if (movement%structure .or. movement%loads) call add_derivative_of_structure(self, movement, value, typical, x, derivative)
      if (.not. movement%tones) return
      slopes = movement%omega_slopes(self%model%system%tones)
      do tone = 1, size(slopes)
         if (abs(slopes(tone)) <= 0.0_wp) cycle
         call self%balance_t%parameter_derivative(x, tone, part)
         derivative = derivative + slopes(tone)*part
      end do
   end subroutine add_derivative

   !> Adds the derivatives by numbers of laws, from the laws themselves or, if one of them has none, by a difference.
   subroutine add_derivative_of_laws(self, movement, value, typical, x, derivative, is_possible)
      type(model_problem_t), intent(inout) :: self
      type(movement_t), intent(in) :: movement
      real(wp), intent(in) :: value, typical
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(inout) :: derivative(:)
      logical, intent(out), optional :: is_possible                   !! the numbers can move
      real(wp) :: part(size(x)), steps(2), total(size(x)), values(size(movement%followers))
      integer :: k, side
      logical :: can_move, is_known

      total = 0.0_wp
      can_move = .true.
      values = values_at(movement%followers, value)
      do k = movement%first, size(movement%followers)
         associate (follower => movement%followers(k))
            if (follower%number%object /= has_number%law .or. abs(follower%slope) <= 0.0_wp) cycle
            steps = difference_step*typical*abs(follower%slope)
            do side = 1, 2                                            ! a law need not be one outside of the range
               if (follower%number%range_problem(values(k) + (2*side - 3)*steps(side)) /= "") steps(side) = 0.0_wp
            end do
            call self%number_derivative(x, self%model%system%law_groups == follower%number%i, follower%number%number_t, &
                                        steps, part, is_known)
            if (.not. is_known) then
               call find_difference_of_laws(self, movement, value, difference_step*typical, x, total, can_move)
               exit
            end if
            total = total + follower%slope*part
         end associate
      end do
      derivative = derivative + total
      if (present(is_possible)) is_possible = can_move
   end subroutine add_derivative_of_laws

   !> Derivative of the residual if the numbers of laws alone move, by a central difference; zero if they cannot move.
   subroutine find_difference_of_laws(self, movement, value, step, x, derivative, can_move)
      type(model_problem_t), intent(inout) :: self
      type(movement_t), intent(in) :: movement
      real(wp), intent(in) :: value, step
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(out) :: derivative(:)
      logical, intent(out) :: can_move
      type(error_t), allocatable :: error
      real(wp) :: at(2), r(size(x), 2)
      integer :: i
      logical :: is_possible(2)

      derivative = 0.0_wp
      do i = 1, 2
         call find_side(i, value + (3 - 2*i)*step)
      end do
      do i = 1, 2                                                     ! at the end of the range of the value
         if (.not. is_possible(i) .and. any(is_possible)) call find_side(i, value)
      end do
      call set_numbers(self, movement, value, error, laws_only=.true.)
      can_move = all(is_possible)
      if (can_move) derivative = (r(:, 1) - r(:, 2))/(at(1) - at(2))

   contains

      subroutine find_side(i, there)
         integer, intent(in) :: i
         real(wp), intent(in) :: there

         at(i) = there
         call set_numbers(self, movement, there, error, laws_only=.true.)
         is_possible(i) = .not. allocated(error)
         if (is_possible(i)) call self%residual(x, r(:, i))
      end subroutine find_side
   end subroutine find_difference_of_laws

   !> Adds the derivative by numbers of the structure and of loads.
   subroutine add_derivative_of_structure(self, movement, value, typical, x, derivative)
      type(model_problem_t), intent(inout) :: self
      type(movement_t), intent(in) :: movement
      real(wp), intent(in) :: value, typical
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(inout) :: derivative(:)
      type(error_t), allocatable :: error
      type(linear_slopes_t) :: slopes
      real(wp) :: part(size(x))

      call find_slopes_by(self%model, movement, value, typical, slopes)
      call self%reaction_derivative(x, reaction_slope(self, self%model, slopes, x), part, error)
      if (.not. allocated(error)) derivative = derivative + part
   end subroutine add_derivative_of_structure

   !> Derivatives of structure and loads, at constant frequencies, along a direction of the parameters `which`.
   subroutine model_problem_find_linear_slopes(self, direction, slopes)
      class(model_problem_t), intent(inout) :: self                   !! unchanged
      real(wp), intent(in) :: direction(:)                            !! as `which`
      type(linear_slopes_t), intent(out) :: slopes
      type(beside_t) :: sides(2)
      integer :: i, k
      logical :: has_structure

      has_structure = .false.
      do i = 1, 2
         sides(i)%position = (3 - 2*i)*difference_step
         associate (position => sides(i)%position)
            do k = 1, size(self%which)
               if (self%which(k) == self%own .and. .not. self%moves_mode) then
                  call sides(i)%add(self%movement, self%value + position*direction(k))
                  has_structure = has_structure .or. self%movement%structure
               else if (self%which(k) <= size(self%with_tones)) then
                  associate (movement => self%with_tones(self%which(k)), omega => self%followed(self%which(k)))
                     if (.not. movement%moves()) cycle
                     call sides(i)%add(movement, omega + position*direction(k))
                     has_structure = has_structure .or. movement%structure
                  end associate
               end if
            end do
         end associate
      end do
      call find_slopes_between(self%model, sides, has_structure, slopes)
   end subroutine model_problem_find_linear_slopes

   !> Adds the derivatives of the residual by the numbers of laws of another movement.
   subroutine model_problem_add_law_slopes(self, movement, value, typical, x, derivative, is_possible)
      class(model_problem_t), intent(inout) :: self                   !! unchanged
      type(movement_t), intent(in) :: movement
      real(wp), intent(in) :: value, typical                          !! its present one; > 0
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(inout) :: derivative(:)
      logical, intent(out) :: is_possible                             !! false: it cannot move

      call add_derivative_of_laws(self, movement, value, typical, x, derivative, is_possible)
   end subroutine model_problem_add_law_slopes

   !> Whether coordinates of laws move with the parameters.
   pure logical function model_problem_moves_coordinates(self) result(moves)
      class(model_problem_t), intent(in) :: self

      moves = self%movement%coordinates .or. any(self%with_tones%coordinates)
   end function model_problem_moves_coordinates

   subroutine model_problem_update_regular_preconditioner(self, which, level, is_strongest)
      class(model_problem_t), intent(inout) :: self
      integer, intent(in) :: which(:)
      integer, intent(in) :: level
      logical, intent(out) :: is_strongest

      call self%balance_t%update_regular_preconditioner(pack(which, which /= self%own), level, is_strongest)
   end subroutine model_problem_update_regular_preconditioner
end module hb_model_problem
