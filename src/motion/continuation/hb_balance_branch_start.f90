!> The first motion of a curve of balances, by all methods of a point or next to the bifurcation at which it leaves another curve;
!> and its equations on a set of harmonics and a grid.
submodule (hb_balance_branch) hb_balance_branch_start
   use hb_autonomous, only: find_energy
   use hb_curve_origin, only: find_leaving_motion
   use hb_curve_sets, only: transfer_motion
   use hb_discretisation, only: discretisation_t
   use hb_harmonics, only: harmonics_t, new_of_parity
   use hb_law, only: has_memory
   use hb_level, only: check_discretisation, estimate_of, join, level_of, transferred, without_motion
   use hb_model_basis, only: half_of_odd, is_solved_odd
   use hb_model_problem, only: new_model_problem
   use hb_options, only: options_t
   use hb_outcome, only: is_integrated
   use hb_point, only: solve_point
   use hb_stability, only: stability_method
   use hb_thresholds, only: max_reliable_error
   implicit none

contains

   !> Finds the first motion of the requested curve.
   module procedure balance_branch_find_first
      type(level_t) :: level, lowest
      logical :: is_found, is_new

      is_described = .false.
      if (allocated(self%request%origin)) then
         call find_at_origin(self, model, first, result, error)
         return
      end if
      if (model%options%accuracy%is_on) model%options%chain%is_on = .false. ! the point has no neighbour and is none
      call solve_point(model, result, error, level)
      if (allocated(level%unknowns) .and. model%options%accuracy%is_on .and. model%options%accuracy%grows_set) then
         lowest = level
         call join(lowest, model%discretisation%harmonics, is_new)    ! without even tuples no loss of symmetry is detected
         if (is_new) call solve_point(model, result, error, level, lowest)
      end if
      is_found = .not. allocated(error) .and. allocated(level%unknowns)
      if (is_integrated(result%status)) then
         result%status = outcome%stalled                              ! a motion, but not a point of a curve
         result%message = "a curve must start from a harmonic balance solution; "//result%message
      end if
      if (is_found) call check_tones(model, result, is_found)
      if (.not. is_found) return
      is_described = .true.
      associate (tones => model%system%tones, mode => model%system%normal_mode)
         self%further = [pack(result%frequency, tones%is_unknown)]
         if (mode%is_requested) self%further = [self%further, pack(result%artificial_damping, tones%is_unknown)]
         self%further = [self%further, self%request%start]
      end associate
      call self%prepare(model%system, model%discretisation, model%options, level, error)
      if (allocated(error)) return
      first%x = [level%unknowns(:self%problem%n_unknowns), self%further]
      first%level = without_motion(level)
   end procedure balance_branch_find_first

   !> Rejects a motion with unknown tones whose tones are not certain.
   subroutine check_tones(model, result, is_accepted)
      type(model_t), intent(in) :: model
      type(motion_result_t), intent(inout) :: result
      logical, intent(out) :: is_accepted

      is_accepted = .true.
      if (any(model%system%tones%is_unknown) .and. model%options%accuracy%is_on) then
         is_accepted = estimate_of(result) < max_reliable_error
         if (.not. is_accepted) &
            result%message = "no harmonic set within the limits represents this motion: it may have other tones, or none"
      end if
      if (.not. is_accepted) return
      is_accepted = .not. may_be_locked(model%system%tones%is_unknown, result)
      if (.not. is_accepted) &
         result%message = "a combination of the tones is slower than the error of the unknown ones: they may lock, and the "// &
                          "motion may have fewer tones"
   end subroutine check_tones

   !> Whether the tones are next to a strong resonance, closer than the errors of the unknown ones: a series of few beats of a
   !> motion with fewer tones looks the same.
   pure logical function may_be_locked(is_unknown, result)
      logical, intent(in) :: is_unknown(:)                            !! (n_tones)
      type(motion_result_t), intent(in) :: result
      integer, parameter :: largest_sum = 5                           ! of a strong resonance, 1:4 at most

      may_be_locked = .false.
      associate (found => result%error_estimate)
         if (.not. (result%is_near_commensurate .and. allocated(found%frequency_error))) return
         may_be_locked = sum(abs(found%combination)) <= largest_sum .and. &
            sum(abs(pack(found%combination*found%frequency_error, is_unknown))) > found%combination_frequency
      end associate
   end function may_be_locked

   !> Finds a first motion a short distance along the other curve: at the intersection itself the tangent is singular.
   subroutine find_at_origin(self, model, first, result, error)
      class(balance_branch_t), intent(inout), target :: self
      type(model_t), intent(in) :: model
      type(origin_t), intent(out) :: first
      type(motion_result_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error
      type(origin_t) :: found
      logical :: is_found

      self%further = self%request%origin%further
      call self%prepare(model%system, model%discretisation, model%options, self%request%origin%level, error)
      if (allocated(error)) return
      call find_leaving_motion(self, found, is_found)
      if (.not. is_found) then
         result%status = outcome%stalled
         result%message = "no bifurcating motion was found near the bifurcation point"
         return
      end if
      if (model%options%accuracy%is_on) call transfer_motion(self, found%x, found%direction, error)
      if (allocated(error)) return
      found%level = self%level
      first = found
   end subroutine find_at_origin

   !> Prepares the problem for a stored curve.
   module procedure balance_branch_resume
      integer :: n

      n = model%system%n_further()
      associate (x => stored(1)%unknowns)
         self%further = x(size(x) - n + 1:)
      end associate
      call self%prepare(model%system, model%discretisation, model%options, level_of(model%discretisation, stored(1)), error)
   end procedure balance_branch_resume

   ! Sets of harmonics

   !> Sets up the problem of the curve on a set and a grid, at its start.
   module procedure balance_branch_adopt_level
      type(model_t) :: found
      integer, allocatable :: which(:)
      integer :: i, n_unknown

      found = self%model
      associate (tones => found%system%tones)
         n_unknown = count(tones%is_unknown)
         which = pack([(i, i=1, tones%n_tones)], tones%is_unknown)
         tones%omega(which) = self%further(:n_unknown)
         if (found%system%normal_mode%is_requested) which = [which, tones%n_tones + which]
      end associate
      if (found%options%accuracy%is_on .or. any(level%torus%n_samples /= found%discretisation%torus%n_samples)) then
         found%discretisation = level%discretisation_t
         call check_discretisation(found%system, found%discretisation, found%options, error)
         if (allocated(error)) return
      end if
      if (found%options%accuracy%is_on) then
         found%options%error_estimate%is_on = .true.
         found%options%error_estimate%truncation = found%options%accuracy%tolerance
         found%options%error_estimate%aliasing = found%options%accuracy%tolerance
         call self%problem%destroy()
      end if
      call new_model_problem(self%problem, found%system, found%discretisation, found%options, self%request%moving, &
                             self%request%start, error)
      if (allocated(error)) return
      if (allocated(self%problem%stiffness%contacts) .and. self%problem%moves_frequency) &
         call found%system%contact_parts%cover(maxval(abs(self%problem%frequencies))* &
                                               max(self%request%from, self%request%to)/self%request%start)
      self%level = without_motion(level)
      self%problem%which = [which, self%problem%own]
      self%n_further = size(self%problem%which)
      self%weights = self%problem%x_scale
      associate (set => found%discretisation%harmonics, system => found%system)
         self%has_all_harmonics = set%n_harmonics == set%highest(1) + 1
         self%has_integrated_multipliers = found%options%stability%method == stability_method%integration .and. &
                                           system%tones%n_tones == 1 .and. has_kinks_or_memory(system)
         self%may_jump_within_period = self%model%system%may_jump_within_period()
      end associate
      if (found%system%normal_mode%has_energy) &
         call find_energy(self%energy, found%system, found%discretisation, found%options, self%problem%balance_t, error)
      if (allocated(error)) return
      call make_odd_problem(self, found%system, found%discretisation, found%options, error)
      if (allocated(error)) return
      do i = 1, size(self%request%responses)
         associate (response => self%request%responses(i))
            response%column = self%problem%stiffness%coordinates%number_of(response%dof)
         end associate
      end do
   end procedure balance_branch_adopt_level

   !> Whether laws have kinks or memory, near which multipliers of a series have errors of first order.
   pure logical function has_kinks_or_memory(system)
      type(system_t), intent(in) :: system
      integer :: i

      has_kinks_or_memory = any([(system%laws(i)%law%n_switches + system%laws(i)%law%n_states > 0, i=1, size(system%laws))])
   end function has_kinks_or_memory

   !> Sets up the problem of odd motions alone on the present set, if the moving value is a given frequency and the
   !> equations are odd: other values may break the symmetry. Odd motions may hold sliders away from their center, and
   !> the forces of these are then not odd.
   subroutine make_odd_problem(self, system, discretisation, options, error)
      class(balance_branch_t), intent(inout), target :: self
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation            !! on the present set
      type(options_t), intent(in) :: options
      type(error_t), allocatable, intent(out) :: error
      type(harmonics_t) :: odd
      type(discretisation_t) :: reduced
      integer :: i

      if (allocated(self%odd_problem)) then
         call self%odd_problem%destroy()
         deallocate (self%odd_problem)
      end if
      if (.not. (self%problem%moves_frequency .and. is_solved_odd(system, discretisation, options)) .or. &
          has_memory(system%laws) .or. any(system%tones%is_unknown)) return
      call new_of_parity(odd, discretisation%harmonics, 1, error)
      if (allocated(error) .or. odd%n_harmonics == discretisation%harmonics%n_harmonics) return
      reduced = discretisation
      reduced%harmonics = odd
      reduced%torus = half_of_odd(system, discretisation)
      allocate (self%odd_problem)
      call new_model_problem(self%odd_problem, system, reduced, options, self%request%moving, self%request%start, error)
      associate (n => self%problem%n_unknowns, m => size(self%problem%which))
         self%odd_indices = [discretisation%harmonics%indices_of(odd, self%problem%n_dofs), (n + i, i=1, m)]
      end associate
   end subroutine make_odd_problem

   !> An origin on the present set.
   module procedure balance_branch_on_level
      moved = origin
      moved%x = transferred(origin%level%harmonics, self%level%harmonics, origin%x, self%n_further)
      moved%direction = transferred(origin%level%harmonics, self%level%harmonics, origin%direction, self%n_further)
   end procedure balance_branch_on_level
end submodule hb_balance_branch_start
