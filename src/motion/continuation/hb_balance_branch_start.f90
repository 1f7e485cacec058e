!> The first motion of a curve of balances: by all methods of a point, or next to the bifurcation at which it leaves another curve.
submodule (hb_balance_branch) hb_balance_branch_start
   use hb_curve_origin, only: find_leaving_motion
   use hb_curve_sets, only: transfer_motion
   use hb_level, only: join, level_of, without_motion
   use hb_outcome, only: is_integrated
   use hb_point, only: solve_point
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
end submodule hb_balance_branch_start
