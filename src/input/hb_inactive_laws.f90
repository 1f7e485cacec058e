!> Laws that exert no force on any of some motions, such as a stop that is never touched: often a length in the wrong unit.
module hb_inactive_laws
   use hb_advice, only: advice, advice_list_t, has_advice
   use hb_coordinates, only: position_in
   use hb_discretisation, only: discretisation_t
   use hb_floquet, only: free_motions
   use hb_kinds, only: two_pi, wp
   use hb_law, only: law_box_t, law_t
   use hb_law_reach, only: exerts_no_force, has_reach
   use hb_modes, only: find_natural_frequencies
   use hb_motion_result, only: motion_result_t
   use hb_motion_samples, only: sample_motion
   use hb_outcome, only: is_solved, outcome
   use hb_system, only: system_t
   use hb_text, only: rounded_to
   use hb_thresholds, only: negligible_share
   implicit none
   private
   public :: advise_on_inactive_laws, inactive_laws_t

   character(*), parameter :: units(2) = [character(5) :: "rad/s", "Hz"]
   integer, parameter :: n_digits = 3                                 ! of a frequency
   integer, parameter :: n_samples(2) = [32, 512]                     ! few show that most laws exert a force
   integer, parameter :: largest_examined = 1000                      ! degrees of freedom, for free bodies and natural frequencies
   real(wp), parameter :: motion_margin = 0.05_wp                     ! a motion larger or smaller by this share has no force
                                                                      ! either: a body at rest on a wall is on one side of it only
                                                                      ! then
   real(wp), parameter :: reach_in_lengths = 10.0_wp                  ! lengths of a law, at which it exerts a force unless it is
                                                                      ! switched off, as by a stiffness of zero

   !> What is known from the motions examined so far.
   type :: inactive_laws_t
      integer :: n_motions = 0
      logical, allocatable :: is_inactive(:)                              !! of each law: no force on any of these motions
      real(wp), allocatable :: largest(:)                             !! of these motions at its coordinates [m]
   contains
      procedure :: examine => inactive_laws_examine
      procedure :: add => inactive_laws_add
      procedure :: advise => inactive_laws_advise
   end type inactive_laws_t

contains

   !> Examines a motion, if there is one.
   subroutine inactive_laws_examine(self, system, discretisation, motion)
      class(inactive_laws_t), intent(inout) :: self
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(motion_result_t), intent(in) :: motion
      real(wp), allocatable :: phases(:, :), q(:, :), v(:, :)
      real(wp) :: largest
      integer, allocatable :: columns(:), dofs(:)
      integer :: i, k

      if (.not. is_solved(motion%status)) return
      if (allocated(self%is_inactive)) then
         if (size(self%is_inactive) /= size(system%laws)) deallocate (self%is_inactive, self%largest)
      end if
      if (.not. allocated(self%is_inactive)) then
         self%n_motions = 0
         self%is_inactive = [(has_length_and_reach(system%laws(i)%law), i=1, size(system%laws))]
         allocate (self%largest(size(system%laws)), source=0.0_wp)
      end if
      self%n_motions = self%n_motions + 1
      dofs = system%dofs_of_unknowns()
      if (motion%status == outcome%integrated) then
         do i = 1, size(system%laws)
            if (has_stored_force(system, motion, dofs, system%laws(i)%law)) self%is_inactive(i) = .false.
            if (system%laws(i)%law%is_multiplier) self%is_inactive(i) = .false. ! impacts
         end do
      end if
      do k = 1, size(n_samples)
         if (.not. any(self%is_inactive)) return
         columns = columns_of(pack([(i, i=1, size(system%laws))], self%is_inactive))
         call sample_motion(discretisation, motion, n_samples(k), phases, q, v, columns)
         if (.not. allocated(q)) then
            self%is_inactive = .false.
            return
         end if
         do i = 1, size(system%laws)
            if (.not. self%is_inactive(i)) cycle
            call find_force(system%laws(i)%law, dofs(columns), q, v, self%is_inactive(i), largest)
            if (k == size(n_samples)) self%largest(i) = max(self%largest(i), largest)
         end do
      end do

   contains

      !> Positions of the degrees of freedom of some laws among those of the unknowns, ascending.
      function columns_of(numbers) result(columns)
         integer, intent(in) :: numbers(:)
         integer, allocatable :: columns(:)
         logical :: is_needed(system%structure%n_dofs)
         integer :: k

         is_needed = .false.
         do k = 1, size(numbers)
            associate (law => system%laws(numbers(k))%law)
               is_needed(law%dofs) = .true.
               if (allocated(law%positions)) is_needed(reshape(law%positions, [size(law%positions)])) = .true.
            end associate
         end do
         columns = pack([(k, k=1, size(dofs))], is_needed(dofs))
      end function columns_of
   end subroutine inactive_laws_examine

   !> Adds what is known from other motions.
   subroutine inactive_laws_add(self, other)
      class(inactive_laws_t), intent(inout) :: self
      type(inactive_laws_t), intent(in) :: other

      if (.not. allocated(other%is_inactive)) return
      if (allocated(self%is_inactive)) then
         if (size(self%is_inactive) /= size(other%is_inactive)) deallocate (self%is_inactive, self%largest)
      end if
      if (.not. allocated(self%is_inactive)) then
         self%n_motions = other%n_motions
         self%is_inactive = other%is_inactive
         self%largest = other%largest
         return
      end if
      self%n_motions = self%n_motions + other%n_motions
      self%is_inactive = self%is_inactive .and. other%is_inactive
      self%largest = max(self%largest, other%largest)
   end subroutine inactive_laws_add

   !> Names the inactive laws. Laws at degrees of freedom at rest are not named.
   subroutine inactive_laws_advise(self, system, list)
      class(inactive_laws_t), intent(in) :: self
      type(system_t), intent(in) :: system
      type(advice_list_t), intent(inout) :: list

      if (.not. allocated(self%is_inactive) .or. self%n_motions == 0) return
      if (size(self%is_inactive) == size(system%laws)) &
         call advise_on_inactive_laws(system, self%is_inactive .and. self%largest > 0.0_wp, list)
   end subroutine inactive_laws_advise

   !> Names inactive laws, and why each exerts no force.
   subroutine advise_on_inactive_laws(system, is_inactive, list)
      type(system_t), intent(in) :: system
      logical, intent(in) :: is_inactive(:)                               !! of each law
      type(advice_list_t), intent(inout) :: list
      integer :: i

      do i = 1, size(system%laws)
         if (.not. is_inactive(i)) cycle
         associate (law => system%laws(i)%law)
            if (is_at_free_body(system, is_inactive, law)) then
               call list%add(advice%inactive_law_at_free_body, a=law%label)
            else
               call list%add(advice%inactive_law, a=law%label)
               if (.not. has_advice(list, advice%tone_in_other_unit)) call advise_on_unit(system, list)
            end if
         end associate
      end do
   end subroutine advise_on_inactive_laws

   !> Names a tone that is far from all natural frequencies, but near one if it is read in the other unit.
   subroutine advise_on_unit(system, list)
      type(system_t), intent(in) :: system
      type(advice_list_t), intent(inout) :: list
      real(wp), parameter :: factors(2) = [two_pi, 1.0_wp/two_pi], max_unit_mismatch = 2.0_wp
      real(wp), allocatable :: natural(:)
      real(wp) :: omega, read_as
      integer :: k, tone
      logical :: lacks_gyroscopic

      if (system%structure%n_dofs > largest_examined) return
      call find_natural_frequencies(system%structure, natural, lacks_gyroscopic)
      natural = pack(natural, natural > 0.0_wp)
      associate (tones => system%tones)
         do tone = 1, tones%n_tones
            omega = tones%omega(tone)
            if (tones%is_unknown(tone) .or. is_near(omega)) cycle
            k = merge(2, 1, tones%unit() == "Hz")
            read_as = omega*factors(k)
            if (.not. is_near(read_as)) cycle
            call list%add(advice%tone_in_other_unit, rounded_to([tones%in_unit(omega), &
               natural(minloc(abs(natural - read_as), dim=1))/two_pi**(2 - k)], n_digits), tones%unit(), units(3 - k))
            return
         end do
      end associate

   contains

      pure logical function is_near(omega)
         real(wp), intent(in) :: omega

         is_near = any(natural > omega/max_unit_mismatch .and. natural < omega*max_unit_mismatch)
      end function is_near
   end subroutine advise_on_unit

   !> Whether a law acts on a body that nothing else holds: neither the structure nor a law that exerts a force.
   logical function is_at_free_body(system, is_inactive, law)
      type(system_t), intent(in) :: system
      logical, intent(in) :: is_inactive(:)                               !! of each law
      class(law_t), intent(in) :: law
      type(law_box_t), allocatable :: active(:)
      real(wp), allocatable :: free(:, :)
      real(wp), parameter :: zero_displacement = 1.0e-9_wp            ! of a motion of length 1
      integer, allocatable :: places(:, :)
      integer :: i, k, place

      is_at_free_body = .false.
      if (system%structure%n_dofs > largest_examined) return
      allocate (active(count(.not. is_inactive)))
      k = 0
      do i = 1, size(system%laws)
         if (is_inactive(i)) cycle
         k = k + 1
         allocate (active(k)%law, source=system%laws(i)%law)
      end do
      free = free_motions(system%structure, active)
      if (size(free, 2) == 0) return
      places = reshape(law%dofs, [size(law%dofs), 1])
      if (allocated(law%positions)) places = law%positions
      do place = 1, size(places, 2)
         is_at_free_body = is_at_free_body .or. &
                           any(abs(matmul(transpose(law%shape), free(places(:, place), :))) > zero_displacement)
      end do
   end function is_at_free_body

   !> Whether forces act at the degrees of freedom of a law in a motion that time integration has found: its series, which may lack
   !> harmonics, stays within gaps that the motion exceeds, but is in balance with the forces, to the errors of its averages.
   pure logical function has_stored_force(system, motion, dofs, law)
      type(system_t), intent(in) :: system
      type(motion_result_t), intent(in) :: motion
      integer, intent(in) :: dofs(:)                                  !! of the stored forces
      class(law_t), intent(in) :: law
      real(wp) :: none
      integer :: i

      has_stored_force = .false.
      if (motion%status /= outcome%integrated .or. .not. allocated(motion%force_coefficients)) return
      if (size(motion%force_coefficients, 3) /= size(dofs)) return
      none = negligible_share*maxval(abs(system%load_spectrum%values))
      do i = 1, size(dofs)
         if (.not. any(law%dofs == dofs(i))) cycle
         has_stored_force = has_stored_force .or. any(abs(motion%force_coefficients(:, :, i)) > none)
      end do
   end function has_stored_force

   !> Whether a law has a length within which it may exert no force.
   pure logical function has_length_and_reach(law)
      class(law_t), intent(in) :: law

      has_length_and_reach = law%length_scale > 0.0_wp .and. has_reach(law)
   end function has_length_and_reach

   !> Whether the force of a law vanishes along a motion, but not along a much larger one, and the largest displacement at its
   !> coordinates.
   subroutine find_force(given, dofs, q, v, is_inactive, largest)
      class(law_t), intent(in) :: given
      integer, intent(in) :: dofs(:)                                  !! of the columns of q and v
      real(wp), intent(in) :: q(:, :), v(:, :)
      logical, intent(out) :: is_inactive
      real(wp), intent(out) :: largest                                !! [m]
      class(law_t), allocatable :: law
      real(wp), allocatable :: f(:, :), p(:, :), rates(:, :), z(:, :)
      integer, allocatable :: at(:), places(:, :)
      real(wp), parameter :: factors(2) = [1.0_wp + motion_margin, 1.0_wp/(1.0_wp + motion_margin)]
      real(wp) :: reach
      logical :: has_force
      integer :: i, k, n, place

      allocate (law, source=given)
      call law%prepare(1.0_wp)                                        ! the sign of a force does not depend on it
      call law%prepare_rate(1.0_wp, 1.0_wp)
      places = reshape(law%dofs, [size(law%dofs), 1])
      if (allocated(law%positions)) places = law%positions
      n = size(law%shape, 2)
      allocate (f(size(q, 1), n))
      allocate (p(size(q, 1), merge(n, 0, law%is_multiplier)), source=0.0_wp)
      is_inactive = .true.
      has_force = .false.
      largest = 0.0_wp
      do place = 1, size(places, 2)
         at = [(position_in(dofs, places(k, place)), k=1, size(places, 1))]
         if (any(at == 0)) is_inactive = .false.
         if (.not. is_inactive) return
         z = matmul(q(:, at), law%shape)
         rates = matmul(v(:, at), law%shape)
         if (.not. law%needs_velocity) rates = rates(:, :0)
         largest = max(largest, maxval(abs(z)))
         is_inactive = is_inactive .and. exerts_no_force(law, z, rates, factors)
         if (.not. (is_inactive .and. maxval(abs(z)) > 0.0_wp)) cycle
         reach = reach_in_lengths*law%length_scale/maxval(abs(z))
         do i = -1, 1, 2
            call law%evaluate(i*reach*z, i*reach*rates, p, f)
            has_force = has_force .or. any(abs(f) > 0.0_wp)
         end do
      end do
      if (largest > 0.0_wp) is_inactive = is_inactive .and. has_force
   end subroutine find_force
end module hb_inactive_laws
