!> A scene with unknown tones: where the search for its motion starts, and the search.
!>
!> A motion known from elsewhere, a neighbouring point or a march, comes in as `scene%start` with its frequencies as the first
!> guesses `scene%tones%omega`; it is tried before any mode.
module hb_autonomous
   use hb_balance, only: balance_t
   use hb_basis, only: basis_t
   use hb_coordinates, only: coordinates_t
   use hb_energy, only: energy_t, new_energy
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   use hb_normal_mode, only: find_mode_of_energy, find_normal_mode
   use hb_outcome, only: outcome
   use hb_rest, only: find_rest, rest_t
   use hb_scene, only: scene_t
   use hb_search, only: new_search, search_t
   use hb_self_excitation, only: search_from_modes
   use hb_text, only: to_text
   implicit none
   private
   public :: autonomous_start_t, find_motion, find_start

   integer, parameter :: most_modes = 8                               ! from which one unknown tone is looked for

   type :: autonomous_start_t
      type(rest_t) :: rest
      real(wp), allocatable :: omega(:)                               !! [rad/s], (n_tones), first guesses where unknown
      integer, allocatable :: tones(:)                                !! unknown ones
      integer, allocatable :: modes(:)                                !! of the rest, one for each, or fewer
      logical :: has_motion = .false.                                 !! the user gives a motion of an unknown tone to start from
   end type autonomous_start_t

contains

   !> Finds the motion at rest, its modes, and the frequencies from which to start.
   subroutine find_start(self, scene, basis, coordinates, error)
      type(autonomous_start_t), intent(out) :: self
      type(scene_t), intent(in) :: scene
      type(basis_t), intent(in) :: basis
      type(coordinates_t), intent(in) :: coordinates                  !! of its laws
      type(error_t), allocatable, intent(out) :: error
      integer :: h, m

      associate (tones => scene%tones)
         self%tones = pack([(m, m=1, tones%n_tones)], tones%is_unknown)
         self%has_motion = any([(any(basis%harmonics%tuples(self%tones, h) /= 0) .and. &
                                 any(abs(scene%start(:, basis%places(h))) > 0.0_wp), h=1, basis%harmonics%n_harmonics)])
         self%omega = tones%omega
         where (self%omega <= 0.0_wp) self%omega = 1.0_wp             ! any: the rest does not know these tones
         call find_rest(self%rest, scene%structure, coordinates, scene%laws, basis%amplitudes_of(scene%loads), &
                        basis%harmonics, basis%torus, self%omega, tones%is_unknown, scene%solver, scene%planning, error)
         if (allocated(error)) then
            if (.not. (allocated(self%rest%u) .and. self%has_motion)) return
            deallocate (error)                                         ! without modes the start must do
            allocate (self%modes(0))
         else
            call choose_modes(self, scene)
         end if
         do m = 1, size(self%tones)
            if (tones%omega(self%tones(m)) > 0.0_wp) cycle
            if (m > size(self%modes)) then
               call fail(error, "the linear structure has "//to_text(self%rest%n_linear)//" oscillatory modes, not "// &
                         "one for each unknown tone: give first guesses of their frequencies in &tones, and a &start")
               return
            end if
            self%omega(self%tones(m)) = self%rest%modes%frequency(self%modes(m))
         end do
      end associate
   end subroutine find_start

   !> Modes from which the unknown tones start: nearest to the first guess of a frequency; without one, that of a normal mode
   !> by its number, else those that grow most, by frequency.
   subroutine choose_modes(self, scene)
      type(autonomous_start_t), intent(inout) :: self
      type(scene_t), intent(in) :: scene
      logical :: is_free(self%rest%modes%n_modes), is_grown(self%rest%modes%n_modes)
      integer :: i, m, mode(size(self%tones))

      is_free = .true.
      is_free(self%rest%n_linear + 1:) = .false.
      if (.not. scene%normal_mode%is_asked) is_free = is_free .and. self%rest%is_at_laws
      mode = 0
      associate (modes => self%rest%modes, guess => scene%tones%omega)
         do m = 1, size(mode)
            if (guess(self%tones(m)) <= 0.0_wp) cycle
            mode(m) = minloc(abs(modes%frequency - guess(self%tones(m))), mask=is_free, dim=1)
            if (mode(m) > 0) is_free(mode(m)) = .false.
         end do
         if (scene%normal_mode%is_asked .and. mode(1) == 0) then
            mode(1) = max(1, scene%normal_mode%mode)
            if (mode(1) > self%rest%n_linear) mode(1) = 0
         else if (scene%normal_mode%mode > 0) then
            mode(1) = merge(scene%normal_mode%mode, 0, scene%normal_mode%mode <= self%rest%n_linear)
         end if
         is_grown = .false.
         do i = 1, count(mode == 0 .and. .not. scene%normal_mode%is_asked)
            m = maxloc(modes%growth, mask=is_free, dim=1)
            if (m == 0) exit
            is_free(m) = .false.
            is_grown(m) = .true.
         end do
         do m = 1, size(mode)
            if (mode(m) > 0 .or. .not. any(is_grown)) cycle
            mode(m) = findloc(is_grown, .true., dim=1)
            is_grown(mode(m)) = .false.
         end do
      end associate
      self%modes = pack(mode, mode > 0)
   end subroutine choose_modes

   !> Looks for the motion on a balance with slopes at the frequencies of the start. Afterwards u is what the status of the
   !> report in `search` says, and the balance stands at its frequencies.
   subroutine find_motion(scene, start, balance, u, search)
      type(scene_t), intent(in) :: scene
      type(autonomous_start_t), intent(in) :: start
      type(balance_t), intent(inout), target :: balance
      real(wp), intent(inout) :: u(:, :)                              !! [m], (n_coefficients, n_dofs): the start given
      type(search_t), intent(out) :: search
      type(energy_t) :: energy
      real(wp) :: length
      integer :: i
      logical :: is_found

      length = 0.0_wp
      do i = 1, size(scene%laws)
         length = max(length, scene%laws(i)%law%length_scale)
      end do
      if (length <= 0.0_wp) length = maxval(norm2(start%rest%u, dim=1))
      if (length <= 0.0_wp) length = 1.0_wp
      call new_search(search, balance, start%rest, start%tones, start%modes, &
                      [(balance%stiffness%coordinates%number_of(scene%phase_dofs(i)), i=1, size(scene%phase_dofs))], length, &
                      scene%solver)
      u = u + start%rest%u
      if (scene%normal_mode%has_energy) then
         call new_energy(energy, scene%structure, constant_load(scene), balance, start%rest%u)
         call find_mode_of_energy(search, energy, scene%normal_mode%energy, start%has_motion, u)
         return
      else if (scene%normal_mode%is_asked) then
         call find_normal_mode(search, scene%normal_mode%amplitude, scene%normal_mode%is_peak, &
                               balance%stiffness%coordinates%number_of(scene%normal_mode%dof), start%has_motion, u)
         return
      end if
      is_found = .false.
      if (start%has_motion) call search%from_start(u, is_found)
      if (is_found) return
      if (size(start%tones) == 1 .and. size(start%modes) == 1) then
         call search_all_modes()
      else if (size(start%modes) == size(start%tones)) then
         call search_from_modes(search, u, is_found)
      else
         u = start%rest%u
         search%report%status = outcome%stalled
         search%message = "not found from the &start, and the linear structure has fewer oscillatory modes than unknown tones"
      end if

   contains

      !> One unknown tone: from the mode chosen, then from others, nearest to the first guess or most driven first. A motion
      !> that others leave is the answer only if there is no other.
      subroutine search_all_modes()
         real(wp) :: merit(start%rest%modes%n_modes), reached
         real(wp), allocatable :: spare_u(:, :), spare_omega(:)
         integer :: best, k
         logical :: is_neutral
         character(:), allocatable :: spare_message, trouble
         type(error_t), allocatable :: error

         associate (modes => start%rest%modes, guess => scene%tones%omega(start%tones(1)))
            merit = modes%growth
            if (guess > 0.0_wp) merit = -abs(modes%frequency - guess)
         end associate
         reached = huge(1.0_wp)
         is_neutral = .true.
         best = 1
         where (.not. start%rest%is_at_laws) merit = -huge(1.0_wp)
         do k = 1, min(most_modes, count(start%rest%is_at_laws))
            best = maxloc(merit, dim=1)
            merit(best) = -huge(1.0_wp)
            search%modes = [best]
            call search_from_modes(search, u, is_found)
            if (is_found .and. .not. search%is_left) return
            if (is_found .and. .not. allocated(spare_u)) then
               spare_u = u
               spare_omega = balance%omega
               spare_message = search%message
            end if
            if (search%report%status == outcome%stalled) trouble = search%message
            reached = min(reached, search%reached)
            is_neutral = is_neutral .and. search%is_neutral
            if (is_neutral) return
         end do
         if (allocated(spare_u)) then
            u = spare_u
            call balance%move(spare_omega, 0.0_wp*spare_omega, error)
            call search%from_start(u, is_found)
            search%message = spare_message
            if (is_found) return
         end if
         if (allocated(trouble)) then
            search%report%status = outcome%stalled
            search%message = trouble
            return
         end if
         search%message = "damped from each of "//to_text(k - 1)//" modes, up to an amplitude of "//to_text(reached)//" or more"
      end subroutine search_all_modes
   end subroutine find_motion

   !> Constant forces on all degrees of freedom [N], the loads in the zero tuple.
   pure function constant_load(scene) result(load)
      type(scene_t), intent(in) :: scene
      real(wp) :: load(scene%structure%n_dofs)
      integer :: h

      load = 0.0_wp
      h = scene%harmonics%index_of(spread(0, 1, scene%tones%n_tones))
      if (h > 0) load = real(scene%loads(:, h))
   end function constant_load
end module hb_autonomous
