!> What moves with a number of a model, or with the frequency of an unknown tone: the numbers that follow it by ties, and the
!> parts of the model that depend on them.
module hb_movement
   use hb_error, only: error_t, fail
   use hb_kinds, only: two_pi, wp
   use hb_model, only: model_t
   use hb_model_number, only: follower_t, followers_of, has_number, model_number_t, relation_t, values_at
   use hb_model_numbers, only: find_model_number, set_model_numbers
   use hb_numbers, only: numbered_t
   use hb_system, only: system_t
   use hb_tones, only: tones_t
   implicit none
   private
   public :: add_linear_numbers, follow_frequencies, movement_t, movement_with_tone, new_movement, set_movement, tied_tones

   !> The numbers that move with a value, and what they change.
   type :: movement_t
      type(follower_t), allocatable :: followers(:)                   !! the value itself first
      integer :: first = 1                                            !! of those that are set in the model
      logical :: structure = .false.                                  !! its matrices
      logical :: loads = .false.                                      !! at constant frequencies
      logical :: laws = .false.
      logical :: coordinates = .false.                                !! of laws
      logical :: tones = .false.                                      !! given frequencies
      logical :: is_affine = .false.                                  !! structure and loads are affine functions, a + b p
      logical, private :: has_inertia_loads = .false.
   contains
      procedure :: moves => movement_moves
      procedure :: is_of_laws => movement_is_of_laws
      procedure :: is_of_loads => movement_is_of_loads
      procedure :: needs_balance => movement_needs_balance
      procedure :: omega_slopes => movement_omega_slopes
   end type movement_t

contains

   !> Finds what moves with a number. Fails if something follows it that cannot move.
   subroutine new_movement(self, model, number, is_tied, error)
      type(movement_t), intent(out) :: self
      type(model_t), intent(inout) :: model                           !! unchanged
      type(model_number_t), intent(in) :: number
      logical, intent(in) :: is_tied                                  !! tones keep their ratios to this one
      type(error_t), allocatable, intent(out) :: error
      type(follower_t), allocatable :: first(:)
      type(model_number_t) :: tone
      real(wp) :: ratio, value
      integer :: i
      logical :: is_found

      first = [follower_t(number)]
      if (is_tied) then
         tone = number
         do i = 1, model%system%tones%n_tones
            if (i == max(1, number%element(1))) cycle
            tone%element(1) = i
            ratio = model%system%tones%omega(i)/model%system%tones%omega(max(1, number%element(1)))
            first = [first, follower_t(tone, relation_t(ratio), slope=ratio)]
         end do
      end if
      call make_movement(self, model%system, first)
      if (number%object == has_number%normal_mode) self%first = 2     ! an equation has it
      do i = 1, size(self%followers)
         call find_model_number(model, self%followers(i)%number, value, is_found)
         if (.not. is_found) call fail(error, trim(self%followers(i)%number%name)//" cannot move: it is not a number of this model")
         if (.not. is_found) return
      end do
   end subroutine new_movement

   !> What moves with the frequency of an unknown tone [rad/s], which itself belongs to the balance.
   function movement_with_tone(system, tone) result(self)
      type(system_t), intent(in) :: system
      integer, intent(in) :: tone
      type(movement_t) :: self
      type(model_number_t) :: number
      real(wp) :: unit

      number%object = has_number%tones
      number%key = trim(merge("hertz    ", "frequency", system%tones%is_in_hertz))
      number%element(1) = tone
      unit = system%tones%subharmonic/merge(two_pi, 1.0_wp, system%tones%is_in_hertz)
      call make_movement(self, system, [follower_t(number, relation_t(unit), slope=unit)])
      self%tones = .false.                                            ! no given one can follow it
      self%first = 2
   end function movement_with_tone

   subroutine make_movement(self, system, first)
      type(movement_t), intent(out) :: self
      type(system_t), intent(in) :: system
      type(follower_t), intent(in) :: first(:)
      class(numbered_t), pointer :: object
      integer :: i

      self%followers = first
      if (allocated(system%ties)) self%followers = followers_of(system%ties, first)
      associate (numbers => self%followers%number)
         self%structure = any(numbers%is_of_structure())
         self%loads = any(numbers%is_of_loads())
         if (self%structure .and. .not. self%loads) self%loads = system%has_loads_by_structure()
         self%laws = any(numbers%object == has_number%law)
         self%coordinates = any([(is_weight(system, numbers(i)), i=1, size(numbers))])
         self%tones = any(numbers%object == has_number%tones)
         self%has_inertia_loads = system%has_inertia_loads
         if (size(numbers) > 1) return
         object => system%object_of(numbers(1))
         if (associated(object)) self%is_affine = object%is_affine_in(numbers(1)%number_t)
      end associate
   end subroutine make_movement

   !> Whether a number is the weight of a coordinate of laws.
   pure logical function is_weight(system, number)
      type(system_t), intent(in) :: system
      type(model_number_t), intent(in) :: number
      integer :: i

      is_weight = .false.
      if (number%object /= has_number%law) return
      do i = 1, size(system%laws)
         if (system%law_groups(i) == number%i) is_weight = is_weight .or. system%laws(i)%law%has_weight(number%number_t)
      end do
   end function is_weight

   !> Whether it moves numbers of the model.
   pure logical function movement_moves(self) result(moves)
      class(movement_t), intent(in) :: self

      moves = allocated(self%followers)
      if (moves) moves = size(self%followers) >= self%first
   end function movement_moves

   !> Whether laws alone change.
   pure logical function movement_is_of_laws(self) result(is_of_laws)
      class(movement_t), intent(in) :: self

      is_of_laws = self%laws .and. .not. (self%structure .or. self%loads .or. self%tones)
   end function movement_is_of_laws

   !> Whether loads alone change.
   pure logical function movement_is_of_loads(self) result(is_of_loads)
      class(movement_t), intent(in) :: self

      is_of_loads = self%loads .and. .not. (self%structure .or. self%laws .or. self%tones)
   end function movement_is_of_loads

   !> Whether a balance that can move to other frequencies has to be created again.
   pure logical function movement_needs_balance(self) result(needs)
      class(movement_t), intent(in) :: self

      needs = self%structure .or. self%loads .or. self%laws .or. (self%tones .and. self%has_inertia_loads)
   end function movement_needs_balance

   !> Derivatives of the given base frequencies [rad/s] by the value, (n_tones).
   pure function movement_omega_slopes(self, tones) result(slopes)
      class(movement_t), intent(in) :: self
      type(tones_t), intent(in) :: tones
      real(wp) :: slopes(tones%n_tones)
      integer :: i

      slopes = 0.0_wp
      do i = self%first, size(self%followers)
         associate (follower => self%followers(i))
            if (follower%number%object /= has_number%tones) cycle
            slopes(max(1, follower%number%element(1))) = follower%slope*merge(two_pi, 1.0_wp, tones%is_in_hertz)/tones%subharmonic
         end associate
      end do
   end function movement_omega_slopes

   !> Sets the numbers of a movement in a model, as `set_model_numbers` does.
   subroutine set_movement(model, movement, value, error, is_alike, laws_only)
      type(model_t), intent(inout) :: model
      type(movement_t), intent(in) :: movement
      real(wp), intent(in) :: value
      type(error_t), allocatable, intent(out) :: error
      logical, intent(out), optional :: is_alike
      logical, intent(in), optional :: laws_only                      !! only numbers of laws
      integer, allocatable :: which(:)
      real(wp) :: values(size(movement%followers))
      logical :: is_set(size(movement%followers))
      integer :: i

      values = values_at(movement%followers, value)
      is_set = [(i >= movement%first, i=1, size(is_set))]
      if (present(laws_only)) then
         if (laws_only) is_set = is_set .and. movement%followers%number%object == has_number%law
      end if
      which = pack([(i, i=1, size(is_set))], is_set)
      call set_model_numbers(model, movement%followers(which)%number, values(which), error, is_alike)
   end subroutine set_movement

   !> The numbers of structures and loads among those of a movement, and their values.
   subroutine add_linear_numbers(movement, value, numbers, values)
      type(movement_t), intent(in) :: movement
      real(wp), intent(in) :: value
      type(model_number_t), allocatable, intent(inout) :: numbers(:)  !! any number before, added
      real(wp), allocatable, intent(inout) :: values(:)
      real(wp) :: all_values(size(movement%followers))
      integer :: i

      all_values = values_at(movement%followers, value)
      do i = movement%first, size(movement%followers)
         associate (number => movement%followers(i)%number)
            if (.not. (number%is_of_structure() .or. number%is_of_loads())) cycle
            numbers = [numbers, number]
            values = [values, all_values(i)]
         end associate
      end do
   end subroutine add_linear_numbers

   !> Unknown tones whose frequencies numbers follow.
   function tied_tones(system) result(which)
      type(system_t), intent(in) :: system
      integer, allocatable :: which(:)
      type(movement_t) :: movement
      integer :: tone

      which = [integer ::]
      do tone = 1, system%tones%n_tones
         if (.not. system%tones%is_unknown(tone)) cycle
         movement = movement_with_tone(system, tone)
         if (movement%moves()) which = [which, tone]
      end do
   end function tied_tones

   !> Sets the numbers that follow frequencies of unknown tones.
   subroutine follow_frequencies(model, omega, error)
      type(model_t), intent(inout) :: model
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones)
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: tones(:)
      integer :: i

      allocate (tones, source=tied_tones(model%system))
      do i = 1, size(tones)
         call set_movement(model, movement_with_tone(model%system, tones(i)), omega(tones(i)), error)
         if (allocated(error)) return
      end do
   end subroutine follow_frequencies
end module hb_movement
