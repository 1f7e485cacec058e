!> A census: the coexisting motions of a model at its values, and an estimate of how many were missed.
!>
!> Newton's method runs from the first guess of the model, from directed and from random starts (hb_census_starts), without
!> fallbacks; from multiples with other phases of each motion found, with deflation of all known ones (hb_deflation), which
!> finds partners at folds; mirror images are tried. The branches of all motions found under varied loads (hb_load_branch) pass
!> further ones. Motions that differ by a period of the loads are the same. Walls with a given restitution have no balance:
!> the model is integrated in time from random states, which finds attractors alone. Each motion is
!> then described like that of a point, to the requested tolerance if there is one. How often random starts have found each
!> motion gives the estimate (hb_census_estimate); all other finds together are the other capture.
module hb_census
   use hb_balance, only: balance_t, new_balance
   use hb_cancellation, only: cancellation_t, note_progress, work_is_over
   use hb_census_estimate, only: completeness_t, estimate_completeness
   use hb_census_starts, only: new_starts, start_kind, starts_t
   use hb_clock, only: wall_clock
   use hb_deflation, only: follow_deflated, is_apart, scale_of, shifted
   use hb_discretisation, only: discretisation_t, symmetry
   use hb_dynamic_stiffness, only: dynamic_stiffness_t, new_dynamic_stiffness
   use hb_error, only: error_t, fail
   use hb_harmonics, only: harmonics_t, new_box, new_of_parity
   use hb_kinds, only: two_pi, wp
   use hb_law_coordinates, only: laws_at
   use hb_level, only: check_discretisation, degree_of, estimate_of, join, level_t, transferred
   use hb_load_branch, only: follow_loads
   use hb_model, only: model_t
   use hb_motion_result, only: motion_result_t
   use hb_outcome, only: is_solved, outcome
   use hb_point, only: solve_point
   use hb_primary_method, only: primary_method
   use hb_solver, only: solve
   use hb_solver_types, only: report_t, solver_config_t
   use hb_spectrum, only: new_spectrum
   use hb_system, only: coordinates_of
   use hb_thresholds, only: equality_tolerance, estimate_safety, max_distance_of_same, negligible_share, rounding_level
   use hb_torus, only: samples_for
   use hb_tuple_choice, only: lowest_order
   implicit none
   private
   public :: census_config_t, census_motion_t, census_t, take_census

   integer, parameter :: max_iterations = 50                         ! from one start
   integer, parameter :: starts_of_integration = 4                   ! random starts that cost as much as one of time integration
   integer, parameter :: max_copies = 64                              ! of a motion, by periods of the loads

   type :: census_config_t
      integer :: n_starts = 200                                       !! random ones
      integer :: seed = 1                                             !! of the random numbers
      integer :: n_deflated = 40                                      !! starts near each motion found, with deflation
      real(wp) :: time_limit = huge(1.0_wp)                           !! wall time [s] of the starts and the descriptions
      procedure(is_requested), pointer, nopass :: ends_starts => null() !! for what has been found so far
   end type census_config_t

   type :: census_motion_t
      type(motion_result_t) :: result
      integer :: n_random = 0                                         !! random starts that led to it
      integer :: n_directed = 0                                       !! directed starts, likewise
      integer :: first_kind = start_kind%given                        !! of the start that found it, hb_census_starts
      integer :: mirror_of = 0                                        !! number of the motion whose mirror image it is; 0: of none
      real(wp) :: size_of_motion = 0.0_wp                             !! largest amplitude of an oscillation with the same root
                                                                      !! mean square
      real(wp), allocatable :: x(:)                                   !! coefficients at the laws' coordinates, on one set
      logical :: is_on_known_branch = .false.                         !! its branch was followed
   end type census_motion_t

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

   abstract interface
      !> Whether no further start is wanted.
      logical function is_requested()
      end function is_requested
   end interface

   !> The search, on one set.
   type :: search_t
      type(balance_t) :: balance
      type(discretisation_t) :: here
      type(starts_t) :: starts
      integer :: n_deflated = 0                                       ! starts near each motion
      type(solver_config_t) :: config
      integer :: subharmonic = 1
      real(wp), allocatable :: linear(:)                              ! the motion without laws
      type(census_motion_t), allocatable :: motions(:)
      real(wp) :: started = 0.0_wp                                    ! by the clock [s]
      real(wp) :: time_of_motion = 0.0_wp                             ! that the description of one takes [s]
      real(wp) :: time_limit = huge(1.0_wp)                           ! of the starts and the descriptions [s]
      procedure(is_requested), pointer, nopass :: ends_starts => null()
   contains
      procedure :: index_of => search_index_of
      procedure :: is_over => search_is_over
      procedure :: try => search_try
      procedure :: add => search_add
      procedure :: add_others_from => search_add_others_from
      procedure :: known => search_known
      procedure :: scale => search_scale
   end type search_t

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
      call begin(search, model, level, config, error)
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
         call add_branch_of(self, i)
         i = i + 1
      end do
      census%n_unfollowed = size(self%motions) - i + 1
   end subroutine follow_branches

   !> Whether no further start may be made: the motions found so far are still to be described.
   logical function search_is_over(self) result(is_over)
      class(search_t), intent(in) :: self

      is_over = work_is_over()
      if (.not. is_over .and. associated(self%ends_starts)) is_over = self%ends_starts()
      if (.not. is_over) is_over = wall_clock() - self%started + size(self%motions)*self%time_of_motion >= self%time_limit
   end function search_is_over

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

   !> Prepares the balance and its starts: on the set of the model, or on that of its motion and a small box.
   subroutine begin(self, model, level, config, error)
      type(search_t), intent(inout) :: self
      type(model_t), intent(in) :: model
      type(level_t), intent(in) :: level                              !! of the motion from its first guess, if there is one
      type(census_config_t), intent(in) :: config
      type(error_t), allocatable, intent(out) :: error
      type(dynamic_stiffness_t) :: stiffness
      type(harmonics_t) :: odd
      real(wp), allocatable :: u(:, :)

      allocate (self%motions(0))
      self%subharmonic = model%system%tones%subharmonic
      self%here = model%discretisation
      if (model%options%accuracy%is_on) call choose_set(self%here, model, level, error)
      if (allocated(error)) return
      if (self%here%symmetry == symmetry%odd) then
         call new_of_parity(odd, self%here%harmonics, 1, error)
         if (allocated(error)) return
         self%here%harmonics = odd
      end if
      associate (here => self%here, omega => model%system%tones%omega)
         call new_dynamic_stiffness(stiffness, model%system%structure, coordinates_of(model%system), &
                                    here%harmonics%frequencies(omega), model%system%loads_in(here%harmonics), error)
         if (allocated(error)) return
         call new_balance(self%balance, here%harmonics, here%torus, omega, stiffness, &
                          laws_at(coordinates_of(model%system), model%system%laws), error)
         if (allocated(error)) return
         allocate (u(here%harmonics%n_coefficients, self%balance%n_dofs))
         call self%balance%linear_solution(u)
         self%linear = [u]
         self%balance%continues_in_order_first = .false.
         call new_starts(self%starts, self%balance, here%harmonics, 0.0_wp*self%linear, config%seed)
      end associate
      self%n_deflated = config%n_deflated
      self%time_limit = config%time_limit
      self%ends_starts => config%ends_starts
      self%config = model%options%solver
      self%config%fallback = .false.
      self%config%max_iterations = min(self%config%max_iterations, max_iterations)
   end subroutine begin

   !> Sets the discretisation for a requested tolerance: all motions must have room in it, not only the first one.
   subroutine choose_set(here, model, level, error)
      type(discretisation_t), intent(inout) :: here
      type(model_t), intent(in) :: model
      type(level_t), intent(in) :: level
      type(error_t), allocatable, intent(out) :: error
      type(harmonics_t) :: box
      type(level_t) :: joined
      integer :: m
      logical :: is_new

      if (allocated(level%unknowns)) then
         joined = level
      else
         joined%discretisation_t = model%discretisation
         allocate (joined%unknowns(0))
      end if
      if (model%options%accuracy%grows_set) then
         associate (n_tones => model%system%tones%n_tones)
            call new_box(box, [(lowest_order(n_tones)*merge(model%system%tones%subharmonic, 1, n_tones == 1), m=1, n_tones)], &
                         .false., error)
         end associate
         if (allocated(error)) return
         if (allocated(level%unknowns)) then
            call join(joined, box, is_new)
         else
            joined%harmonics = box
         end if
      end if
      if (model%options%accuracy%refines_grid) &
         call joined%torus%resample(max(joined%torus%n_samples, samples_for(joined%harmonics%highest, degree_of(model%system))))
      here = joined%discretisation_t
      call check_discretisation(model%system, here, model%options, error)
   end subroutine choose_set

   !> Makes a start: the motion to which it leads is counted, and added if it is a new one, with those found from it.
   subroutine search_try(self, x, kind, n_lost)
      class(search_t), intent(inout) :: self
      real(wp), intent(inout), contiguous :: x(:)                     !! first guess, on return arbitrary
      integer, intent(in) :: kind                                     !! one of `start_kind`
      integer, intent(inout) :: n_lost
      integer :: i, n_before
      logical :: is_found

      call find_motion(self, x, is_found)
      if (.not. is_found) then
         n_lost = n_lost + 1
         return
      end if
      n_before = size(self%motions)
      i = self%index_of(x)
      if (i == 0) then
         i = n_before + 1
         call self%add(x, kind)
      end if
      if (kind == start_kind%random) then
         self%motions(i)%n_random = self%motions(i)%n_random + 1
      else
         self%motions(i)%n_directed = self%motions(i)%n_directed + 1
      end if
      call self%add_others_from(n_before + 1)
   end subroutine search_try

   !> Adds the mirror images of motions, and those near them, from a number on.
   subroutine search_add_others_from(self, first)
      class(search_t), intent(inout) :: self
      integer, intent(in) :: first
      real(wp) :: guess(self%balance%n_unknowns)
      integer :: i

      i = first
      do while (i <= size(self%motions))                              ! those found from it follow
         guess = self%motions(i)%x                                    ! a copy: the list grows
         call try_mirror_images(self, guess)
         call try_near(self, guess)
         i = i + 1
      end do
   end subroutine search_add_others_from

   !> Adds the motions on the branch of a motion; a branch is followed once, from the first of its motions.
   subroutine add_branch_of(self, number)
      type(search_t), intent(inout), target :: self
      integer, intent(in) :: number
      real(wp) :: motion(self%balance%n_unknowns)
      real(wp), allocatable :: found(:, :)
      integer :: direction, i, k, n_before
      logical :: is_closed

      if (self%balance%n_unknowns > self%balance%largest_dense) return
      if (self%motions(number)%is_on_known_branch .or. self%motions(number)%first_kind == start_kind%mirror) return
      motion = self%motions(number)%x
      is_closed = .false.
      do direction = 1, 2
         if (is_closed .or. work_is_over()) exit
         self%balance%law_set%is_given_up = .false.
         call follow_loads(self%balance, self%config, motion, self%scale(), direction == 1, found)
         do i = 1, size(found, 2)
            if (self%balance%drifting(reshape(found(:, i), [size(motion)/self%balance%n_dofs, self%balance%n_dofs]), &
                                      self%config%tolerance) /= 0) cycle
            n_before = size(self%motions)
            k = self%index_of(found(:, i))
            is_closed = k == number
            if (k == 0) then
               k = n_before + 1
               call self%add(found(:, i), start_kind%continued)
            end if
            self%motions(k)%is_on_known_branch = .true.
            call self%add_others_from(n_before + 1)
         end do
      end do
      self%motions(number)%is_on_known_branch = .true.
   end subroutine add_branch_of

   !> Newton's method from x.
   subroutine find_motion(self, x, is_found)
      type(search_t), intent(inout) :: self
      real(wp), intent(inout), contiguous :: x(:)
      logical, intent(out) :: is_found
      type(report_t) :: report

      self%balance%law_set%is_given_up = .false.
      call solve(self%balance, self%config, self%linear, x, report)
      is_found = report%status == outcome%converged
      if (is_found) is_found = self%balance%drifting(reshape(x, [size(x)/self%balance%n_dofs, self%balance%n_dofs]), &
                                                     self%config%tolerance) == 0
   end subroutine find_motion

   !> Starts near a motion, with deflation of all known ones.
   subroutine try_near(self, motion)
      type(search_t), intent(inout) :: self
      real(wp), intent(in) :: motion(:)
      real(wp) :: x(size(motion))
      integer :: i
      logical :: is_found

      if (self%balance%n_unknowns > self%balance%largest_dense) return
      do i = 1, self%n_deflated
         if (work_is_over()) return
         call self%starts%draw_near(self%balance, motion, x)
         self%balance%law_set%is_given_up = .false.
         call follow_deflated(self%balance, self%config, self%known(), self%scale(), x, is_found)
         if (.not. is_found) cycle
         if (self%index_of(x) == 0) call self%add(x, start_kind%deflated)
      end do
   end subroutine try_near

   !> Adds the mirror images of a motion, -x with phases by which the loads change their sign, where they satisfy the balance.
   subroutine try_mirror_images(self, x)
      class(search_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), dimension(size(x)) :: image, r
      real(wp) :: before
      integer :: copy

      call self%balance%residual(x, r)
      before = self%balance%norm(r)
      do copy = 1, n_copies(self, 2) - 1
         image = -shifted(x, self%here%harmonics, phases_of(self, copy, 2))
         call self%balance%residual(image, r)
         if (.not. self%balance%norm(r) <= max(10.0_wp*before, rounding_level)) cycle
         if (self%index_of(image) == 0) call self%add(image, start_kind%mirror)
      end do
   end subroutine try_mirror_images

   !> Adds a motion to the known ones.
   subroutine search_add(self, x, kind)
      class(search_t), intent(inout) :: self
      real(wp), intent(in) :: x(:)
      integer, intent(in) :: kind
      type(census_motion_t) :: motion

      motion%x = x
      motion%first_kind = kind
      self%motions = [self%motions, motion]
   end subroutine search_add

   !> Number of the known motion that x is, or is after periods of the loads; 0: none.
   integer function search_index_of(self, x) result(found)
      class(search_t), intent(in) :: self
      real(wp), intent(in) :: x(:)
      real(wp) :: moved(size(x), 1), scale(size(x))
      integer :: copy, i

      scale = self%scale()
      do copy = 0, n_copies(self, 1) - 1
         moved(:, 1) = x
         if (copy > 0) moved(:, 1) = shifted(x, self%here%harmonics, phases_of(self, copy, 1))
         do i = 1, size(self%motions)
            found = i
            if (.not. is_apart(self%motions(i)%x, moved, scale, negligible_share)) return
         end do
      end do
      found = 0
   end function search_index_of

   !> Known motions, (n_unknowns, any).
   function search_known(self) result(known)
      class(search_t), intent(in) :: self
      real(wp), allocatable :: known(:, :)
      integer :: i

      allocate (known(self%balance%n_unknowns, size(self%motions)))
      do i = 1, size(self%motions)
         known(:, i) = self%motions(i)%x
      end do
   end function search_known

   !> Amplitudes of the known motions; typical ones without any.
   function search_scale(self) result(scale)
      class(search_t), intent(in) :: self
      real(wp) :: scale(self%balance%n_unknowns)

      scale = self%balance%x_scale
      if (size(self%motions) > 0) scale = scale_of(self%known(), self%here%harmonics, self%balance%x_scale)
   end function search_scale

   !> Number of motions that are the same but for a multiple of a part of the loads' periods; 1 if there are too many.
   pure integer function n_copies(self, parts) result(n)
      type(search_t), intent(in) :: self
      integer, intent(in) :: parts                                    !! of a period

      n = 1
      associate (n_tones => self%here%harmonics%n_tones)
         if (real(parts*self%subharmonic, wp)**n_tones <= max_copies) n = (parts*self%subharmonic)**n_tones
      end associate
   end function n_copies

   !> Phases of a copy, by its number from 0.
   pure function phases_of(self, copy, parts) result(phases)
      type(search_t), intent(in) :: self
      integer, intent(in) :: copy, parts
      real(wp) :: phases(self%here%harmonics%n_tones)
      integer :: m

      associate (n => parts*self%subharmonic)
         phases = two_pi/n*[(modulo(copy/n**(m - 1), n), m=1, size(phases))]
      end associate
   end function phases_of

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
      real(wp) :: image(self%balance%n_unknowns, 1), scale(self%balance%n_unknowns)
      integer :: copy, i, k

      scale = self%scale()
      do i = 2, size(motions)
         search: do copy = 1, n_copies(self, 2) - 1
            image(:, 1) = -shifted(motions(i)%x, self%here%harmonics, phases_of(self, copy, 2))
            do k = 1, i - 1
               if (is_apart(motions(k)%x, image, scale, 10.0_wp*equality_tolerance)) cycle
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
