!> The balance of a model in whose input one value moves: an additional parameter of the problem, besides base
!> frequencies and artificial damping.
!> If the value is the frequency of a tone, the balance moves to it, and loads that grow with frequencies change
!> accordingly. A number of laws is set in them. Any other value is set in the document of the model, and the objects that
!> depend on it are created again; for the amplitude or the energy of a normal mode, the balance is unchanged and an
!> equation is added. The derivative of the residual with respect to the value is exact for frequencies, for loads, in
!> which the residual is linear, and for numbers of laws that know it; otherwise it is a central difference, taken of the
!> quantities before condensation. Values that follow the frequency of an unknown tone move with it in the same way, and
!> the derivative with respect to the frequency includes them. Source: docs/why/theory.md, section 6.7.
module hb_model_problem
   use hb_amplitudes, only: amplitudes_t, new_amplitudes
   use hb_balance, only: balance_t, new_balance
   use hb_coordinates, only: coordinates_t
   use hb_document, only: document_t, parameter_t
   use hb_dynamic_stiffness, only: dynamic_stiffness_t, new_dynamic_stiffness, wanted_slopes_t
   use hb_error, only: error_t, fail
   use hb_kinds, only: two_pi, wp
   use hb_law_coordinates, only: laws_at
   use hb_level, only: level_t, put_on_level
   use hb_linear_part, only: linear_part_t, new_linear_part
   use hb_model, only: model_t
   use hb_model_basis, only: coordinates_of
   use hb_model_laws, only: find_law_number
   use hb_model_loads, only: read_loads
   use hb_model_reader, only: set_changed_numbers, update_model
   use hb_model_tones, only: put_frequencies, tied_tones
   use hb_numbers, only: number_t
   use hb_structure, only: structure_t
   use hb_thresholds, only: difference_step
   implicit none
   private
   public :: model_problem_t, moving_value_t, new_model_problem, refusal_t

   character(*), parameter :: mode_group = "normal_mode"
   character(*), parameter :: several = "several"                     ! groups, in which values follow the moving one

   !> A moving value of the input, and the parts of the model that move with it.
   type :: moving_value_t
      type(parameter_t) :: parameter                                  !! in the document of the model
      real(wp) :: typical = 1.0_wp                                    !! > 0, such as the length of its range
      logical :: is_tied = .false.                                    !! of a tone: all others keep their ratios to it
   end type moving_value_t

   !> The structure and its loads at a slightly larger or smaller value.
   type :: side_t
      type(structure_t) :: structure
      real(wp), allocatable :: frequencies(:)                         !! [rad/s], (n_harmonics)
      type(amplitudes_t) :: loads                                     !! [N]
   end type side_t

   !> A value that was rejected: of several the nearest to the last possible one.
   type :: refusal_t
      character(:), allocatable :: text                               !! the reason; not allocated: none was rejected
      real(wp) :: value = 0.0_wp
      real(wp) :: possible = 0.0_wp                                   !! the last possible one
   contains
      procedure :: note => refusal_note
      procedure :: forget => refusal_forget
   end type refusal_t

   !> Owns external resources: call `destroy`.
   type, extends(balance_t) :: model_problem_t
      type(model_t) :: model                                          !! at the present value
      type(document_t) :: document                                    !! likewise, except for frequencies
      integer :: own = 0                                              !! number of the moving value among the parameters
      integer, allocatable :: which(:)                                !! parameters that are unknown along a curve, the value last
      logical :: moves_frequency = .false.                            !! the value is that of a tone, and loads do not grow with it
      logical :: moves_mode = .false.                                 !! the value is the amplitude or the energy of a normal mode
      type(refusal_t) :: refusal                                      !! since the last step of a curve began
      type(moving_value_t), private :: moving
      character(:), allocatable, private :: group                     ! of the value, or `several`
      integer, private :: i_law = 0                                   ! number of the &law of the value, if it belongs to one
      type(number_t), private :: number                               ! the value among the numbers of these laws
      real(wp), private :: value = 0.0_wp                             ! the present one
      real(wp), private :: first_value = 0.0_wp                       ! that of the model of `new_model_problem`
      real(wp), allocatable, private :: omega_at_zero(:)              ! base frequencies as functions of the value
      real(wp), allocatable :: omega_slopes(:)                        !! likewise: their derivatives, (n_tones)
      real(wp), allocatable, private :: ratios(:)                     ! of tones to the value, if it moves more than tones
      integer, allocatable, private :: tied(:)                        ! unknown tones whose frequencies other values follow
      real(wp), allocatable, private :: followed(:)                   ! frequencies that they follow at present [rad/s], (n_tones)
      logical, private :: has_stiffness = .false.
      real(wp), private :: available_memory = huge(1.0_wp)            ! bytes
      logical, private :: is_sound = .false.                          ! model and balance belong to the value
   contains
      procedure :: update_regular_preconditioner => model_problem_update_regular_preconditioner
      procedure :: parameters => model_problem_parameters
      procedure :: parameter_scales => model_problem_parameter_scales
      procedure :: set_parameters => model_problem_set_parameters
      procedure :: move_to_point => model_problem_move_to_point
      procedure :: parameter_derivative => model_problem_parameter_derivative
      procedure :: choose_number => model_problem_choose_number
      procedure :: document_here => model_problem_document_here
      procedure :: renew => model_problem_renew
      procedure :: roughness => model_problem_roughness
   end type model_problem_t

contains

   !> Creates the problem of a model as read from its document. Fails for a value of a group that cannot move, and for
   !> a model without laws.
   subroutine new_model_problem(self, model, document, moving, value, available_memory, error)
      type(model_problem_t), intent(inout) :: self
      type(model_t), intent(in) :: model
      type(document_t), intent(in) :: document                        !! from which the model was read
      type(moving_value_t), intent(in) :: moving
      real(wp), intent(in) :: value                                   !! its value in the model
      real(wp), intent(in) :: available_memory                        !! bytes
      type(error_t), allocatable, intent(out) :: error
      integer :: tone

      self%model = model
      self%document = document
      self%moving = moving
      self%value = value
      self%first_value = value
      self%available_memory = available_memory
      self%own = 2*model%tones%n_tones + 1
      self%n_unknowns = 0
      self%has_stiffness = .false.
      self%group = self%document%groups%holders(moving%parameter%i_group)%group%name
      if (document%drives(moving%parameter)) self%group = several
      call find_law_number(document, moving%parameter, self%i_law, self%number)
      self%moves_mode = self%group == mode_group
      self%moves_frequency = self%group == "tones" .and. .not. model%has_inertia_loads
      self%omega_slopes = 0.0_wp*model%tones%omega
      self%xi = self%omega_slopes
      self%omega_at_zero = model%tones%omega
      if (self%group == "tones") then
         tone = max(1, moving%parameter%element(1))
         self%omega_slopes(tone) = merge(two_pi, 1.0_wp, moving%parameter%key == "hertz")/model%tones%subharmonic
         self%omega_at_zero(tone) = 0.0_wp
         if (moving%is_tied) then
            self%omega_slopes = self%omega_slopes(tone)*(model%tones%omega/model%tones%omega(tone))
            self%omega_at_zero = 0.0_wp
         end if
      end if
      if (moving%is_tied) self%ratios = model%tones%omega/model%tones%omega(max(1, moving%parameter%element(1)))
      self%tied = tied_tones(document, model%tones)
      self%followed = model%tones%omega
      self%omega = model%tones%omega
      if (size(self%tied) == 0) then
         call rebuild(self, error)
      else
         self%moves_frequency = .false.
         self%model%is_read = .false.                                 ! its values may follow other frequencies
         call read_again(self, error)
      end if
   end subroutine new_model_problem

   !> Makes another number of laws the value that moves; the present one returns to its value in the model of
   !> `new_model_problem`. `is_done` is false unless both are numbers of laws that nothing follows: create another problem.
   subroutine model_problem_choose_number(self, moving, value, is_done)
      class(model_problem_t), intent(inout) :: self
      type(moving_value_t), intent(in) :: moving
      real(wp), intent(in) :: value                                   !! its value in the model
      logical, intent(out) :: is_done
      type(number_t) :: number
      integer :: i_law

      is_done = .false.
      if (.not. (allocated(self%group) .and. self%is_sound) .or. moving%is_tied) return
      call find_law_number(self%document, moving%parameter, i_law, number)
      if (self%group /= "law" .or. i_law == 0 .or. self%document%drives(moving%parameter) .or. size(self%tied) > 0) return
      call move_to(self, self%first_value, is_done)
      if (.not. is_done) return
      self%moving = moving
      self%i_law = i_law
      self%number = number
      self%value = value
      self%first_value = value
   end subroutine model_problem_choose_number

   !> Creates the balance of laws with other numbers.
   subroutine replace_laws(self, error)
      type(model_problem_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error
      type(coordinates_t) :: coordinates

      coordinates = coordinates_of(self%model)
      if (coordinates%equal(self%stiffness%coordinates)) then
         call self%balance_t%replace_laws(laws_at(coordinates, self%model%laws))
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
      real(wp), allocatable :: xi(:)
      integer :: n_before
      logical :: has_slopes, keeps_stiffness

      self%is_sound = .false.
      allocate (xi, source=self%xi)
      n_before = self%n_unknowns
      has_slopes = self%group == "tones" .or. any(self%model%tones%is_unknown)
      associate (model => self%model)
         if (size(model%laws) == 0) then
            call fail(error, "a curve needs at least one &law; without laws use a &sweep")
            return
         end if
         coordinates = coordinates_of(model)
         keeps_stiffness = self%group == "law" .and. self%has_stiffness .and. size(self%tied) == 0
         if (keeps_stiffness) keeps_stiffness = coordinates%equal(self%stiffness%coordinates)
         if (keeps_stiffness) then
            call self%stiffness%transfer_to(stiffness)
         else
            call new_dynamic_stiffness(stiffness, model%structure, coordinates, &
               model%harmonics%frequencies(model%tones%omega), model%loads, error, &
               wanted_slopes_t(is_on=has_slopes, of_motion=model%normal_mode%has_energy, loads=model%load_slopes))
            if (allocated(error)) return
         end if
         call new_balance(self%balance_t, model%harmonics, model%torus, model%tones%omega, stiffness, &
                          laws_at(coordinates, model%laws), error)
      end associate
      self%has_stiffness = .not. allocated(error)
      if (allocated(error)) return
      if (n_before > 0 .and. n_before /= self%n_unknowns) then
         self%n_unknowns = n_before
         call fail(error, "the number of unknowns must not change along a curve")
         return
      end if
      if (any(abs(xi) > 0.0_wp)) call self%move(self%model%tones%omega, xi, error)
      self%is_sound = .not. allocated(error)
   end subroutine rebuild

   !> Creates the balance again at its present value, so that its scales do not depend on previous values.
   subroutine model_problem_renew(self)
      class(model_problem_t), intent(inout) :: self
      type(error_t), allocatable :: error

      if (self%moves_frequency .or. self%moves_mode) return           ! the scales never change
      if (self%group == "law" .and. self%has_stiffness .and. self%is_sound .and. size(self%tied) == 0) then
         call replace_laws(self, error)
      else
         call rebuild(self, error)
      end if
   end subroutine model_problem_renew

   !> Roughness of the residual in the base frequencies: its change when they change in their last digits. The
   !> condensed stiffness of a beam of 200 elements, whose condition number is 1e11, has other rounding errors at each
   !> frequency.
   real(wp) function model_problem_roughness(self, x) result(change)
      class(model_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), parameter :: nearby = 16.0_wp*epsilon(1.0_wp)         ! relative
      real(wp), dimension(size(x)) :: here, there
      real(wp) :: omega(size(self%omega)), value
      integer :: k
      logical :: is_possible

      change = 0.0_wp
      if (self%model%structure%n_dofs <= self%n_dofs) return          ! nothing is condensed
      if (.not. (any(self%group == [character(len(several)) :: "tones", several]) .or. any(self%model%tones%is_unknown))) return
      omega = self%omega
      value = self%value
      call self%residual(x, here)
      do k = -1, 1, 2
         call go(1.0_wp + k*nearby)
         if (.not. is_possible) exit
         call self%residual(x, there)
         change = max(change, self%norm(there - here))
      end do
      call go(1.0_wp)

   contains

      subroutine go(factor)
         real(wp), intent(in) :: factor
         integer :: i

         if (self%group == several) then
            call move_to(self, factor*value, is_possible)
         else
            call self%balance_t%set_parameters([(i, i=1, size(omega))], factor*omega, is_possible)
         end if
      end subroutine go
   end function model_problem_roughness

   !> Sets model and balance to a value; `error` is the reason if that is not possible.
   subroutine move_to(self, value, is_possible)
      type(model_problem_t), intent(inout) :: self
      real(wp), intent(in) :: value
      logical, intent(out) :: is_possible
      type(error_t), allocatable :: error
      integer :: i

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
      self%is_sound = .false.
      if (self%group == "tones") then
         associate (omega => self%omega_at_zero + self%omega_slopes*value, tones => self%model%tones)
            is_possible = all(omega > 0.0_wp)
            if (.not. is_possible) then
               call self%refusal%note("frequencies must be greater than 0", value)
               return
            end if
            where (.not. tones%is_unknown) tones%omega = omega
         end associate
         if (self%model%has_inertia_loads) then
            call self%document%begin()
            call read_loads(self%model, self%document)
            call rebuild(self, error)
         else
            call self%balance_t%set_parameters([(i, i=1, size(self%omega_slopes))], self%model%tones%omega, is_possible)
            if (.not. is_possible) &
               call self%refusal%note("the structure has no condensed stiffness at these frequencies", value)
         end if
      else
         call set_value(self, value)
         call read_again(self, error)
      end if
      if (allocated(error)) call refuse(self, error, is_possible)
      self%is_sound = is_possible
      if (is_possible) self%refusal%possible = value
   end subroutine move_to

   !> Sets model and balance to the frequencies that other values follow.
   subroutine follow(self, omega, is_possible)
      type(model_problem_t), intent(inout) :: self
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones)
      logical, intent(out) :: is_possible
      type(error_t), allocatable :: error

      is_possible = .true.
      if (self%is_sound .and. all(abs(omega(self%tied) - self%followed(self%tied)) <= 0.0_wp)) return
      self%followed = omega
      call set_value(self, self%value)
      call read_again(self, error)
      if (allocated(error)) call refuse(self, error, is_possible)
   end subroutine follow

   !> Stores why a value was rejected.
   subroutine refuse(self, error, is_possible)
      type(model_problem_t), intent(inout) :: self
      type(error_t), intent(in) :: error
      logical, intent(out) :: is_possible

      is_possible = .false.
      call self%refusal%note(error%message, self%value)
   end subroutine refuse

   !> Notes a rejected value.
   pure subroutine refusal_note(self, text, value)
      class(refusal_t), intent(inout) :: self
      character(*), intent(in) :: text
      real(wp), intent(in) :: value

      if (allocated(self%text)) then
         if (abs(value - self%possible) >= abs(self%value - self%possible)) return
      end if
      self%text = text
      self%value = value
   end subroutine refusal_note

   !> Forgets rejected values.
   pure subroutine refusal_forget(self)
      class(refusal_t), intent(inout) :: self

      if (allocated(self%text)) deallocate (self%text)
   end subroutine refusal_forget

   !> Reads the model again from the document, and creates the balance at the present frequencies.
   subroutine read_again(self, error)
      type(model_problem_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error
      type(model_t) :: before, fresh
      logical :: is_done, is_new

      self%is_sound = .false.
      if (self%group == "law" .and. self%has_stiffness .and. self%model%is_read .and. size(self%tied) == 0) then
         call set_changed_numbers(self%model, self%document, is_done)
         if (is_done) then
            call replace_laws(self, error)
            return
         end if
      end if
      if (size(self%tied) > 0) call put_frequencies(self%document, self%model%tones, self%followed)
      if (self%model%accuracy%is_on) before = self%model
      call update_model(self%model, self%document, is_new, error, self%available_memory)
      if (is_new .and. before%accuracy%is_on .and. .not. allocated(error)) then   ! on the set that was chosen
         self%model%certificate = before%certificate
         fresh = self%model
         call put_on_level(self%model, fresh, level_t(before%harmonics, before%torus%n_samples), error)
      end if
      if (.not. allocated(error)) then
         where (self%model%tones%is_unknown) self%model%tones%omega = self%omega   ! unchanged
      end if
      if (.not. allocated(error)) call rebuild(self, error)
      if (allocated(error) .and. before%accuracy%is_on) then          ! a rejected value leaves the chosen set unchanged
         self%model = before
         self%model%is_read = .false.
      end if
   end subroutine read_again

   !> Sets the value in the document, with the tones that keep their ratios to it.
   subroutine set_value(self, value)
      type(model_problem_t), intent(inout) :: self
      real(wp), intent(in) :: value
      type(parameter_t) :: tone
      integer :: i

      call self%document%set(self%moving%parameter, value)
      if (.not. allocated(self%ratios)) return
      tone = self%moving%parameter
      do i = 1, size(self%ratios)
         tone%element(1) = i
         call self%document%set(tone, self%ratios(i)*value)
      end do
   end subroutine set_value

   !> The document of the model at the present value, also for a frequency.
   function model_problem_document_here(self) result(document)
      class(model_problem_t), intent(inout) :: self
      type(document_t) :: document

      call set_value(self, self%value)
      document = self%document
   end function model_problem_document_here

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
      integer :: i

      is_possible = .true.
      i = findloc(which, self%own, dim=1)
      if (i > 0) call move_to(self, values(i), is_possible)
      if (is_possible .and. any(which /= self%own)) &
         call self%balance_t%set_parameters(pack(which, which /= self%own), pack(values, which /= self%own), is_possible)
      if (.not. is_possible .or. all(which == self%own)) return
      self%model%tones%omega = self%omega                             ! for a new balance
      if (size(self%tied) > 0) call follow(self, self%omega, is_possible)
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
      real(wp) :: other(size(x))
      integer :: tone
      logical :: is_known

      is_known = .false.
      if (which /= self%own) then
         call self%balance_t%parameter_derivative(x, which, derivative)
         if (all(self%tied /= which)) return
         call difference(self, x, which, other)
         derivative = derivative + other
         return
      end if
      derivative = 0.0_wp
      if (self%moves_mode) return
      if (self%group == "tones") then
         do tone = 1, size(self%omega_slopes)
            if (abs(self%omega_slopes(tone)) <= 0.0_wp) cycle
            call self%balance_t%parameter_derivative(x, tone, other)
            derivative = derivative + self%omega_slopes(tone)*other
         end do
      else
         if (self%group == "law") call self%number_derivative(x, self%model%law_groups == self%i_law, self%number, &
                                                              difference_step*self%moving%typical, derivative, is_known)
         if (.not. is_known) call difference(self, x, 0, derivative)
      end if
   end subroutine model_problem_parameter_derivative

   !> Derivative of the residual with respect to the value, or to the frequency that other values follow, by a central
   !> difference; zero if the value cannot move.
   subroutine difference(self, x, tone, derivative)
      type(model_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      integer, intent(in) :: tone                                     !! 0: the value
      real(wp), intent(out) :: derivative(:)
      type(side_t) :: sides(2)
      real(wp) :: at(2), r(size(x), 2), step, value
      integer :: i
      logical :: is_condensed, is_here, is_possible(2)

      derivative = 0.0_wp
      is_condensed = (tone > 0 .or. any(self%group == [character(17) :: "structure", "bearing", "dynamic_stiffness", several])) &
                     .and. self%model%structure%n_dofs > self%n_dofs .and. .not. self%law_set%needs_reaction
      if (tone > 0) then
         value = self%followed(tone)
         step = difference_step*value
      else
         value = self%value
         step = self%moving%typical*merge(1.0_wp, difference_step, self%group == "load" .and. .not. self%law_set%needs_reaction)
      end if
      call find_side(1, value + step, is_possible(1))
      call find_side(2, value - step, is_possible(2))
      call go(value, is_here)
      if (.not. is_here .or. .not. any(is_possible)) return
      do i = 1, 2                                                     ! at the end of the range of the value
         if (.not. is_possible(i)) call find_side(i, value, is_possible(i))
      end do
      derivative = (r(:, 1) - r(:, 2))/(at(1) - at(2))
      if (is_condensed) derivative = derivative - reaction_slope(self, sides, x, 1.0_wp/(at(1) - at(2)))

   contains

      !> Residual at a value; for a condensed structure that of the laws alone.
      subroutine find_side(i, there, is_possible)
         integer, intent(in) :: i
         real(wp), intent(in) :: there
         logical, intent(out) :: is_possible
         real(wp) :: reaction(self%harmonics%n_coefficients, self%n_dofs)

         call go(there, is_possible)
         if (.not. is_possible) return
         at(i) = there
         call self%residual(x, r(:, i))
         if (.not. is_condensed) return
         call self%stiffness%find_reaction(self%harmonics, reshape(x, shape(reaction)), 1.0_wp, reaction)
         r(:, i) = r(:, i) + [reaction]
         sides(i) = side_t(self%model%structure, self%frequencies, self%model%loads)
      end subroutine find_side

      subroutine go(there, is_possible)
         real(wp), intent(in) :: there
         logical, intent(out) :: is_possible
         real(wp) :: omega(size(self%followed))

         if (tone == 0) then
            call move_to(self, there, is_possible)
         else
            omega = self%followed
            omega(tone) = there
            call follow(self, omega, is_possible)
         end if
      end subroutine go
   end subroutine difference

   !> Derivative of the reaction with respect to the value; zero if the structure is singular.
   function reaction_slope(self, sides, x, weight) result(slope)
      class(model_problem_t), intent(in) :: self
      type(side_t), intent(in) :: sides(2)                            !! slightly beside the value
      real(wp), intent(in) :: x(:)
      real(wp), intent(in) :: weight                               !! of differences of both sides
      real(wp) :: slope(size(x))
      type(dynamic_stiffness_t) :: stiffness
      type(error_t), allocatable :: error
      type(linear_part_t) :: linear
      type(wanted_slopes_t) :: wanted
      real(wp) :: along(self%harmonics%n_coefficients, self%n_dofs), once(self%harmonics%n_harmonics)

      slope = 0.0_wp
      once = 1.0_wp
      wanted%is_on = .true.
      wanted%change = sides(1)%structure%change_from(sides(2)%structure, weight)
      wanted%drives = self%drives()
      wanted%rates = weight*(sides(1)%frequencies - sides(2)%frequencies)
      call new_amplitudes(wanted%loads, sides(1)%loads%n_dofs, sides(1)%loads%n_harmonics)
      call wanted%loads%add_scaled(sides(1)%loads, weight*once)
      call wanted%loads%add_scaled(sides(2)%loads, -weight*once)
      call new_dynamic_stiffness(stiffness, self%model%structure, coordinates_of(self%model), self%frequencies, &
                                 self%model%loads, error, wanted)
      if (allocated(error)) return
      call new_linear_part(linear, stiffness)
      call linear%find_reaction_slope(self%harmonics, reshape(x, shape(along)), 1.0_wp, once, along)
      slope = [along]
   end function reaction_slope

   subroutine model_problem_update_regular_preconditioner(self, which, level, is_strongest)
      class(model_problem_t), intent(inout) :: self
      integer, intent(in) :: which(:)
      integer, intent(in) :: level
      logical, intent(out) :: is_strongest

      call self%balance_t%update_regular_preconditioner(pack(which, which /= self%own), level, is_strongest)
   end subroutine model_problem_update_regular_preconditioner

end module hb_model_problem
