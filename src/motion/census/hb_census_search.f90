!> The search of a census for coexisting motions: solutions of the balance on one set of harmonics.
!>
!> Newton's method runs from each start without fallbacks; from multiples with other phases of each motion found, with deflation
!> of all known ones (hb_deflation), which finds partners at folds; mirror images are tried. The branch of a motion under varied
!> loads (hb_load_branch) passes further ones. Motions that differ by a period of the loads are the same.
module hb_census_search
   use hb_balance, only: balance_t, new_balance
   use hb_cancellation, only: work_is_over
   use hb_census_starts, only: new_starts, start_kind, starts_t
   use hb_clock, only: wall_clock
   use hb_deflation, only: follow_deflated, is_apart, scale_of, shifted
   use hb_discretisation, only: discretisation_t, symmetry
   use hb_dynamic_stiffness, only: dynamic_stiffness_t, new_dynamic_stiffness
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t, new_box, new_of_parity
   use hb_kinds, only: two_pi, wp
   use hb_law_coordinates, only: laws_at
   use hb_level, only: check_discretisation, degree_of, join, level_t
   use hb_load_branch, only: follow_loads
   use hb_model, only: model_t
   use hb_motion_result, only: motion_result_t
   use hb_outcome, only: outcome
   use hb_solver, only: solve
   use hb_solver_types, only: report_t, solver_config_t
   use hb_system, only: coordinates_of
   use hb_thresholds, only: negligible_share, rounding_level
   use hb_torus, only: samples_for
   use hb_tuple_choice, only: lowest_order
   implicit none
   private
   public :: census_config_t, census_motion_t, search_t

   integer, parameter :: max_iterations = 50                         ! from one start
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

   abstract interface
      !> Whether no further start is wanted.
      logical function is_requested()
      end function is_requested
   end interface

   !> The search, on one set. Owner of external resources: call `balance%destroy`.
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
      procedure :: begin => search_begin
      procedure :: try => search_try
      procedure :: add_branch_of => search_add_branch_of
      procedure :: is_over => search_is_over
      procedure :: images => search_images
      procedure :: scale => search_scale
      procedure, private :: index_of => search_index_of
      procedure, private :: add => search_add
      procedure, private :: add_others_from => search_add_others_from
      procedure, private :: known => search_known
   end type search_t

contains

   !> Prepares the balance and its starts: on the set of the model, or on that of its motion and a small box.
   subroutine search_begin(self, model, level, config, error)
      class(search_t), intent(inout) :: self
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
                                    here%harmonics%frequencies(omega), model%system%loads_in(here%harmonics), error, &
                                    tuples=here%harmonics%tuples)
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
   end subroutine search_begin

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
   subroutine search_add_branch_of(self, number)
      class(search_t), intent(inout), target :: self
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
   end subroutine search_add_branch_of

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
      real(wp) :: before, r(size(x))
      real(wp), allocatable :: images(:, :)
      integer :: i

      call self%balance%residual(x, r)
      before = self%balance%norm(r)
      allocate (images, source=self%images(x))
      do i = 1, size(images, 2)
         call self%balance%residual(images(:, i), r)
         if (.not. self%balance%norm(r) <= max(10.0_wp*before, rounding_level)) cycle
         if (self%index_of(images(:, i)) == 0) call self%add(images(:, i), start_kind%mirror)
      end do
   end subroutine try_mirror_images

   !> Mirror images of a motion, (n_unknowns, any): -x at all phases by which the loads may change their sign.
   pure function search_images(self, x) result(images)
      class(search_t), intent(in) :: self
      real(wp), intent(in) :: x(:)
      real(wp) :: images(size(x), n_copies(self, 2) - 1)
      integer :: copy

      do copy = 1, size(images, 2)
         images(:, copy) = -shifted(x, self%here%harmonics, phases_of(self, copy, 2))
      end do
   end function search_images

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

   !> Whether no further start may be made: the motions found so far are still to be described.
   logical function search_is_over(self) result(is_over)
      class(search_t), intent(in) :: self

      is_over = work_is_over()
      if (.not. is_over .and. associated(self%ends_starts)) is_over = self%ends_starts()
      if (.not. is_over) is_over = wall_clock() - self%started + size(self%motions)*self%time_of_motion >= self%time_limit
   end function search_is_over
end module hb_census_search
