!> A census: the coexisting motions of a model at its values, and an estimate of how many were missed.
!>
!> A search (hb_census_search) runs from the first guess of the model, from directed and from random starts (hb_census_starts), and
!> along the branches of all motions found. Walls with a given restitution have no balance: the model is integrated in time from
!> random states, which finds attractors alone. Each motion is then described like that of a point, to the requested tolerance
!> if there is one. How often random starts have found each motion gives the estimate (hb_census_estimate); all other finds
!> together are the other capture.
module hb_census
   use hb_cancellation, only: cancellation_t, note_progress, work_is_over
   use hb_census_estimate, only: completeness_t, estimate_completeness
   use hb_census_search, only: census_config_t, census_motion_t, search_t
   use hb_census_starts, only: start_kind
   use hb_clock, only: wall_clock
   use hb_deflation, only: is_apart
   use hb_discretisation, only: symmetry
   use hb_error, only: error_t, fail
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_level, only: estimate_of, level_t, transferred
   use hb_model, only: model_t
   use hb_motion_result, only: motion_result_t
   use hb_outcome, only: is_solved, outcome
   use hb_point, only: solve_point
   use hb_primary_method, only: primary_method
   use hb_spectrum, only: new_spectrum
   use hb_thresholds, only: equality_tolerance, estimate_safety, max_distance_of_same, negligible_share
   implicit none
   private
   public :: census_config_t, census_motion_t, census_t, take_census

   integer, parameter :: starts_of_integration = 4                   ! random starts that cost as much as one of time integration

   type :: census_t
      type(census_motion_t), allocatable :: motions(:)                !! by size
      integer :: n_random = 0, n_directed = 0                         !! starts
      integer :: n_random_lost = 0, n_directed_lost = 0               !! those of them that led to no motion
      integer :: n_left = 0                                           !! random starts that time did not permit
      integer :: n_unfollowed = 0                                     !! motions whose branches it did not permit to follow
      integer :: n_spurious = 0                                       !! solutions without a motion near them on larger sets
      logical :: is_complete = .false.                                !! the model is linear: there is no other motion
      type(completeness_t) :: completeness
   end type census_t

   !> Ends all work in progress at a time.
   type, extends(cancellation_t) :: time_limit_t
      real(wp) :: end_of_time = huge(1.0_wp)                          ! wall time [s]
   contains
      procedure :: wants_end => time_limit_wants_end
   end type time_limit_t

contains

   !> Takes a census. An `error` is one of the model, such as a structure that cannot be condensed. Work that ends early
   !> (hb_cancellation) leaves the motions found so far, those that are not described with status `pending`.
   subroutine take_census(model, config, census, error)
      type(model_t), intent(in) :: model
      type(census_config_t), intent(in) :: config
      type(census_t), intent(out) :: census
      type(error_t), allocatable, intent(out) :: error
      real(wp), parameter :: last_start_grace = 1.0_wp                ! for what is begun when no start may be made any more [s]
      type(search_t), target :: search
      type(time_limit_t), target :: limit

      search%started = wall_clock()
      allocate (census%motions(0))
      if (any(model%system%tones%is_unknown) .or. model%system%normal_mode%is_requested) then
         call fail(error, "a census needs given tones; follow self-excited motions and normal modes along a curve")
         return
      end if
      if (config%time_limit < huge(1.0_wp)) limit%end_of_time = search%started + config%time_limit + last_start_grace
      call limit%enter(huge(1.0_wp))
      call search_all(search, model, config, census, error)
      call limit%leave()
   end subroutine take_census

   !> The census itself.
   subroutine search_all(search, model, config, census, error)
      type(search_t), intent(inout), target :: search
      type(model_t), intent(in) :: model
      type(census_config_t), intent(in) :: config
      type(census_t), intent(inout) :: census
      type(error_t), allocatable, intent(out) :: error
      type(level_t) :: level
      type(motion_result_t) :: first
      type(model_t) :: own
      logical :: is_integrated

      own = model
      own%options%chain%is_on = .false.
      is_integrated = model%options%has_time_domain() .and. model%options%lacks_impacts_of(model%system, outcome%impact)
      call solve_point(own, first, error, level)
      search%time_of_motion = wall_clock() - search%started
      if (allocated(error) .and. size(model%system%laws) == 0) return
      if (size(model%system%laws) == 0) then
         call add_linear(first, model%discretisation%harmonics%has_zero, census)
         return
      end if
      if (allocated(error)) deallocate (error)                        ! of this motion; that of the model is found again
      call search%begin(model, level, config, error)
      if (allocated(error)) return
      call try_given(search, level, census)
      call try_starts(search, merge(0, config%n_starts, is_integrated), census)
      call follow_branches(search, census)
      call describe(search, model, census)
      if (is_integrated) then
         call note_attractor(search, first, start_kind%given, census)
         call find_attractors(search, own, size_of(first, .true.), config%n_starts, census)
      end if
      call search%balance%destroy()
      census%completeness = estimate_completeness(census%motions%n_random, census%motions%n_directed + &
                                                  merge(1, 0, census%motions%first_kind >= start_kind%mirror))
   end subroutine search_all

   logical function time_limit_wants_end(self) result(wants_end)
      class(time_limit_t), intent(inout) :: self

      wants_end = .false.
      if (self%end_of_time < huge(1.0_wp)) wants_end = wall_clock() >= self%end_of_time
   end function time_limit_wants_end

   !> Starts at the motion that the model has from its first guess, if it has one.
   subroutine try_given(self, level, census)
      type(search_t), intent(inout), target :: self
      type(level_t), intent(in) :: level
      type(census_t), intent(inout) :: census
      real(wp), allocatable :: given(:)

      census%n_directed = 1
      if (.not. allocated(level%unknowns)) then
         census%n_directed_lost = 1
         return
      end if
      allocate (given, source=transferred(level%harmonics, self%here%harmonics, level%unknowns, level%harmonics%n_tones))
      call self%try(given(:self%balance%n_unknowns), start_kind%given, census%n_directed_lost)
   end subroutine try_given

   !> Makes the directed starts, then the random ones, as far as time permits.
   subroutine try_starts(self, n_random, census)
      type(search_t), intent(inout), target :: self
      integer, intent(in) :: n_random
      type(census_t), intent(inout) :: census
      real(wp) :: x(self%balance%n_unknowns)
      integer :: i, kind, n_steps

      n_steps = 1 + self%starts%n_directed + n_random
      do i = 1, self%starts%n_directed
         if (self%is_over()) exit
         call note_progress(i, n_steps)
         call self%starts%directed(i, x, kind)
         call self%try(x, kind, census%n_directed_lost)
         census%n_directed = census%n_directed + 1
      end do
      do while (census%n_random < n_random)
         if (self%is_over()) exit
         call note_progress(1 + self%starts%n_directed + census%n_random, n_steps)
         call self%starts%draw(self%balance, census%n_random + 1, x)
         call self%try(x, start_kind%random, census%n_random_lost)
         census%n_random = census%n_random + 1
      end do
      census%n_left = n_random - census%n_random
   end subroutine try_starts

   !> Follows the branches of all motions, and of those that are found on them.
   subroutine follow_branches(self, census)
      type(search_t), intent(inout), target :: self
      type(census_t), intent(inout) :: census
      integer :: i

      i = 1
      do while (i <= size(self%motions))
         if (self%is_over()) exit
         call self%add_branch_of(i)
         i = i + 1
      end do
      census%n_unfollowed = size(self%motions) - i + 1
   end subroutine follow_branches

   !> The only motion of a model without laws.
   subroutine add_linear(result, has_zero, census)
      type(motion_result_t), intent(in) :: result
      logical, intent(in) :: has_zero
      type(census_t), intent(inout) :: census
      type(census_motion_t) :: motion

      census%n_directed = 1
      census%is_complete = is_solved(result%status)
      if (.not. census%is_complete) return
      motion%result = result
      motion%n_directed = 1
      motion%size_of_motion = size_of(result, has_zero)
      census%motions = [motion]
   end subroutine add_linear

   !> Describes the motions like those of points; solutions that do not persist to the tolerance are dropped.
   subroutine describe(self, model, census)
      type(search_t), intent(inout) :: self
      type(model_t), intent(in) :: model
      type(census_t), intent(inout) :: census
      type(census_motion_t), allocatable :: accepted(:)
      type(model_t) :: own
      type(error_t), allocatable :: error
      type(level_t) :: below, level
      integer :: i

      allocate (accepted(0))
      do i = 1, size(self%motions)
         associate (motion => self%motions(i))
            own = model
            own%options%chain%is_on = .false.
            own%options%may_integrate = .false.
            own%options%solver%fallback = .false.
            below%discretisation_t = self%here
            below%unknowns = [motion%x, model%system%tones%omega]
            if (.not. work_is_over()) then
               if (self%here%symmetry == symmetry%odd) then
                  call solve_point(own, motion%result, error, level, below, &
                     transferred(self%here%harmonics, model%discretisation%harmonics, &
                                 below%unknowns, size(model%system%tones%omega)))
               else
                  call solve_point(own, motion%result, error, level, below, below%unknowns)
               end if
            end if
            if (allocated(error)) then
               motion%result%status = outcome%failed
               motion%result%message = error%message
            end if
            motion%size_of_motion = size_of(motion%result, model%discretisation%harmonics%has_zero)
            if (model%options%has_time_domain() .and. &
                model%options%lacks_impacts_of(model%system, motion%result%status)) cycle ! a motion with other impacts
            if (allocated(level%unknowns) .and. is_solved(motion%result%status)) then
               if (model%options%accuracy%is_on .and. has_moved(self, motion%x, level)) then
                  census%n_spurious = census%n_spurious + 1
                  cycle
               end if
            end if
         end associate
         call insert(accepted, self%motions(i))
      end do
      call find_mirror_images(self, accepted)
      call move_alloc(accepted, census%motions)
   end subroutine describe

   !> Inserts a motion into those ordered by size.
   subroutine insert(motions, motion)
      type(census_motion_t), allocatable, intent(inout) :: motions(:)
      type(census_motion_t), intent(in) :: motion
      integer :: k

      k = count(motions%size_of_motion <= motion%size_of_motion)
      motions = [motions(:k), motion, motions(k + 1:)]
   end subroutine insert

   !> Finds attractors by time integration from random states of the size of a motion.
   subroutine find_attractors(self, model, size_of_motion, n_starts, census)
      type(search_t), intent(inout) :: self
      type(model_t), intent(in) :: model
      real(wp), intent(in) :: size_of_motion                          !! typical amplitude [m]; 0: not known
      integer, intent(in) :: n_starts                                 !! random ones, as for the balance
      type(census_t), intent(inout) :: census
      type(model_t) :: own
      type(level_t) :: level
      type(motion_result_t) :: result
      type(error_t), allocatable :: error
      complex(wp) :: c(model%system%structure%n_dofs)
      real(wp) :: typical
      integer :: first, h

      typical = size_of_motion
      if (typical <= 0.0_wp) typical = maxval(self%balance%x_scale)
      own = model
      own%options%primary_method = primary_method%integration
      own%options%solver%fallback = .false.
      associate (set => own%discretisation%harmonics)
         first = findloc([(sum(abs(set%tuples(:, h))), h=1, set%n_harmonics)], 1, dim=1)
      end associate
      do while (starts_of_integration*census%n_random < n_starts)
         if (self%is_over()) exit
         call note_progress(starts_of_integration*census%n_random, n_starts)
         call self%starts%draw_state(census%n_random + 1, c)
         call new_spectrum(own%options%start%spectrum, size(c), own%system%tones%n_tones)
         call own%options%start%spectrum%add(own%discretisation%harmonics%tuples(:, first), typical*c)
         call solve_point(own, result, error, level)
         if (allocated(error)) result%status = outcome%failed
         call note_attractor(self, result, start_kind%random, census)
      end do
      census%n_left = (n_starts - 1)/starts_of_integration + 1 - census%n_random
   end subroutine find_attractors

   !> Counts an attractor of time integration, and adds it if it is a new one.
   subroutine note_attractor(self, result, kind, census)
      type(search_t), intent(in) :: self
      type(motion_result_t), intent(in) :: result
      integer, intent(in) :: kind                                     !! one of `start_kind`
      type(census_t), intent(inout) :: census
      type(census_motion_t) :: motion
      logical :: is_found

      motion%result = result
      motion%first_kind = kind
      motion%size_of_motion = size_of(result, .true.)
      motion%n_random = merge(1, 0, kind == start_kind%random)
      motion%n_directed = 1 - motion%n_random
      is_found = (is_solved(result%status) .and. result%status /= outcome%impact) .or. result%status == outcome%subharmonic
      census%n_random = census%n_random + motion%n_random
      if (kind == start_kind%random .and. .not. is_found) census%n_random_lost = census%n_random_lost + 1
      if (is_found) call count_or_insert(self, motion, census%motions)
   end subroutine note_attractor

   !> Counts a motion as one of the known ones if it differs from it by the errors of both alone, or inserts it.
   subroutine count_or_insert(self, motion, motions)
      type(search_t), intent(in) :: self
      type(census_motion_t), intent(in) :: motion
      type(census_motion_t), allocatable, intent(inout) :: motions(:)
      real(wp), allocatable :: known(:), x(:)
      integer :: i

      allocate (x, source=coefficients_of(self, motion%result))
      do i = 1, size(motions)
         associate (other => motions(i))
            if (size(x) == 0) then                                    ! only its period is known
               if (other%result%status /= motion%result%status .or. other%result%n_periods /= motion%result%n_periods) cycle
            else
               if (other%result%status == outcome%subharmonic) cycle
               known = coefficients_of(self, other%result)
               if (size(known) /= size(x)) cycle
               if (norm2(x - known) > max(negligible_share, estimate_safety*(estimate_of(motion%result) + &
                     estimate_of(other%result)))* &
                   max(norm2(x), norm2(known))) cycle
            end if
            other%n_random = other%n_random + motion%n_random
            other%n_directed = other%n_directed + motion%n_directed
            return
         end associate
      end do
      call insert(motions, motion)
   end subroutine count_or_insert

   !> Coefficients of a described motion at the stored degrees of freedom, on the set of the search; none if it has none.
   function coefficients_of(self, result) result(x)
      type(search_t), intent(in) :: self
      type(motion_result_t), intent(in) :: result
      real(wp), allocatable :: x(:)
      type(harmonics_t) :: set

      allocate (x(0))
      if (.not. allocated(result%coefficients)) return
      set = self%here%harmonics
      if (result%harmonics%n_harmonics == size(result%coefficients, 2)) set = result%harmonics
      if (set%n_harmonics /= size(result%coefficients, 2)) return
      x = transferred(set, self%here%harmonics, &
         [set%coefficients(transpose(cmplx(result%coefficients(1, :, :), -result%coefficients(2, :, :), wp)))], 0)
   end function coefficients_of

   !> Whether the motion to the tolerance is another one.
   logical function has_moved(self, x, level)
      type(search_t), intent(in) :: self
      real(wp), intent(in) :: x(:)
      type(level_t), intent(in) :: level
      real(wp), allocatable :: there(:)

      allocate (there, source=transferred(level%harmonics, self%here%harmonics, level%unknowns, self%here%harmonics%n_tones))
      has_moved = is_apart(x, reshape(there(:size(x)), [size(x), 1]), self%scale(), max_distance_of_same)
   end function has_moved

   !> Notes which motions are mirror images of earlier ones.
   subroutine find_mirror_images(self, motions)
      type(search_t), intent(in) :: self
      type(census_motion_t), intent(inout) :: motions(:)
      real(wp), allocatable :: images(:, :)
      real(wp) :: scale(self%balance%n_unknowns)
      integer :: copy, i, k

      scale = self%scale()
      do i = 2, size(motions)
         images = self%images(motions(i)%x)
         search: do copy = 1, size(images, 2)
            do k = 1, i - 1
               if (is_apart(motions(k)%x, images(:, copy:copy), scale, 10.0_wp*equality_tolerance)) cycle
               motions(i)%mirror_of = k
               exit search
            end do
         end do search
      end do
   end subroutine find_mirror_images

   !> Amplitude of an oscillation with the same root mean square, for the stored degree of freedom with the largest one.
   pure real(wp) function size_of(result, has_zero) result(amplitude)
      type(motion_result_t), intent(in) :: result
      logical, intent(in) :: has_zero                                 !! the set has the zero tuple, as its first one
      integer :: d

      amplitude = 0.0_wp
      if (.not. allocated(result%coefficients)) return
      do d = 1, size(result%coefficients, 3)
         amplitude = max(amplitude, norm2(result%coefficients(:, merge(2, 1, has_zero):, d)))
      end do
   end function size_of
end module hb_census
