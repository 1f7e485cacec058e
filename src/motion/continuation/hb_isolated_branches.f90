!> Isolated branches: motions on none of the curves followed so far, at values given in the input: each is the start of a
!> curve. They are searched for from the starts of a census, by Newton's method and, where that leads to a known motion,
!> with deflation of all known ones.
module hb_isolated_branches
   use hb_balance_branch, only: balance_branch_t
   use hb_bordered, only: bordered_problem_t, new_bordered_problem
   use hb_cancellation, only: work_is_over
   use hb_census_starts, only: new_starts, starts_t
   use hb_curve_branches, only: branches_t, origin_t
   use hb_curve_sets, only: transfer_motion
   use hb_deflation, only: follow_deflated, is_apart, is_other, scale_of, shifted
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: two_pi, wp
   use hb_level, only: join, level_t, transferred
   use hb_newton, only: solve_newton
   use hb_outcome, only: outcome
   use hb_problem, only: problem_t
   use hb_solver_types, only: report_t, solver_config_t
   use hb_thresholds, only: estimate_safety, negligible_share
   implicit none
   private
   public :: find_other, search_separate

   integer, parameter :: n_random = 100                              ! starts after the directed ones
   integer, parameter :: max_iterations = 40                         ! from one first guess
   integer, parameter :: max_spurious = 4                            ! motions at a value that are known ones on a larger set: a
                                                                      ! limit of the work alone

contains

   !> Searches for a separate motion at the requested values, and returns the first one.
   subroutine search_separate(self, branches, x, is_found, error)
      class(balance_branch_t), intent(inout), target :: self
      type(branches_t), intent(in) :: branches
      real(wp), allocatable, intent(out) :: x(:)                      !! on the present set
      logical, intent(out) :: is_found
      type(error_t), allocatable, intent(out) :: error
      type(origin_t), allocatable :: known(:), others(:)
      integer :: i, k, n_spurious

      is_found = .false.
      do i = 1, size(self%request%others)
         associate (passed => branches%coexisting)
            known = pack(passed, [(.not. abs(passed(k)%x(size(passed(k)%x)) - self%request%others(i)) > 0.0_wp, &
                                   k=1, size(passed))])
         end associate
         others = known
         do n_spurious = 0, max_spurious
            call search_at(self, branches%start_on_set%x, self%request%others(i), others, x, is_found, error)
            if (allocated(error)) return
            if (.not. is_found) exit
            others = [others, origin_t(x=x, level=self%level)]
            call accept(self, known, x, is_found, error)
            if (allocated(error)) return
            if (is_found) return
         end do
      end do
   end subroutine search_separate

   !> Searches for a motion at a value other than the known ones, on a set that has the tuples of all of them.
   subroutine search_at(self, start, value, known, x, is_found, error)
      class(balance_branch_t), intent(inout), target :: self
      real(wp), intent(in) :: start(:)                                !! a motion on the present set
      real(wp), intent(in) :: value
      type(origin_t), intent(in) :: known(:)
      real(wp), allocatable, intent(out) :: x(:)
      logical, intent(out) :: is_found
      type(error_t), allocatable, intent(out) :: error
      type(bordered_problem_t) :: held
      type(report_t) :: report
      type(level_t) :: level
      type(solver_config_t) :: config
      real(wp), allocatable :: functional(:, :), motions(:, :), solved(:)
      integer :: i
      logical :: is_new, is_possible

      is_found = .false.
      if (self%model%options%accuracy%is_on) then
         level%discretisation_t = self%level%discretisation_t
         level%unknowns = [start(:size(start) - self%n_further), 0.0_wp*self%model%system%tones%omega]
         do i = 1, size(known)
            call join(level, known(i)%level%harmonics, is_new)
            call level%torus%resample(max(level%torus%n_samples, known(i)%level%torus%n_samples))
         end do
         call self%adopt_level(level, error)
         if (allocated(error)) return
      end if
      motions = motions_of(self, known)
      x = [spread(0.0_wp, 1, self%problem%n_unknowns), value]
      call self%problem%move_to_point(x, is_possible)
      if (.not. is_possible) return
      allocate (functional(size(motions, 1), 1), source=0.0_wp)
      functional(size(functional), 1) = 1.0_wp
      call new_bordered_problem(held, self%problem, self%problem%which, functional, [value])
      config = self%problem%model%options%solver
      if (size(known) > 0) &
         config%tolerance = max(config%tolerance, 2.0_wp*self%problem%rounding_level(motions(:self%problem%n_unknowns, 1)))
      config%max_iterations = max_iterations
      if (self%model%options%accuracy%is_on) then                     ! the deflated motion must be a zero of this problem
         do i = 1, size(motions, 2)
            solved = motions(:, i)
            call solve_newton(held, config, solved, report)
            if (report%status == outcome%converged) motions(:, i) = solved
         end do
      end if
      call find_other(held, config, self%problem%model%discretisation%harmonics, motions, x, is_found)
      x(size(x)) = value
   end subroutine search_at

   !> Refines a motion to the tolerance; it is not accepted if it is then a known one.
   subroutine accept(self, known, x, is_accepted, error)
      class(balance_branch_t), intent(inout), target :: self
      type(origin_t), intent(in) :: known(:)
      real(wp), allocatable, intent(inout) :: x(:)
      logical, intent(out) :: is_accepted
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: along(:)
      real(wp) :: value

      is_accepted = .true.
      if (.not. self%model%options%accuracy%is_on) return
      value = x(size(x))
      along = 0.0_wp*x
      along(size(x)) = 1.0_wp
      call transfer_motion(self, x, along, error)
      if (allocated(error)) return
      x(size(x)) = value
      is_accepted = is_other(x, motions_of(self, known), self%problem%model%discretisation%harmonics, self%problem%x_scale, &
                             estimate_safety*self%model%options%accuracy%tolerance)
   end subroutine accept

   !> Motions on the present set, and their shifts by periods of the loads.
   function motions_of(self, known) result(motions)
      class(balance_branch_t), intent(in) :: self
      type(origin_t), intent(in) :: known(:)
      real(wp), allocatable :: motions(:, :)
      real(wp), allocatable :: phases(:)
      real(wp) :: x(self%problem%n_unknowns + 1)
      integer :: copy, i, m, n_copies

      associate (model => self%problem%model, n => self%problem%n_unknowns)
         n_copies = model%system%tones%subharmonic**model%system%tones%n_tones
         allocate (motions(n + 1, 0), phases(model%system%tones%n_tones))
         do i = 1, size(known)
            do copy = 0, n_copies - 1
               phases = [(modulo(copy/model%system%tones%subharmonic**(m - 1), model%system%tones%subharmonic), m=1, &
                          model%system%tones%n_tones)]
               phases = two_pi/model%system%tones%subharmonic*phases
               x = transferred(known(i)%level%harmonics, model%discretisation%harmonics, known(i)%x, 1)
               if (copy > 0) x(:n) = shifted(x(:n), model%discretisation%harmonics, phases)
               motions = reshape([motions, x], [n + 1, size(motions, 2) + 1])
            end do
         end do
      end associate
   end function motions_of

   !> Searches for a zero of the residual other than the known ones, from all starts in turn.
   subroutine find_other(problem, config, harmonics, known, x, is_found)
      class(problem_t), intent(inout) :: problem                      !! unknowns of a balance, and equations that hold further ones
      type(solver_config_t), intent(in) :: config
      type(harmonics_t), intent(in) :: harmonics
      real(wp), intent(in) :: known(:, :)                             !! (n_unknowns, any)
      real(wp), intent(inout), contiguous :: x(:)                     !! on entry the values of further unknowns, (n_unknowns)
      logical, intent(out) :: is_found
      type(report_t) :: report
      type(starts_t) :: starts
      real(wp), dimension(size(x)) :: guessed, scale
      integer :: i, kind

      is_found = .false.
      x(:(size(x)/harmonics%n_coefficients)*harmonics%n_coefficients) = 0.0_wp
      scale = problem%x_scale
      if (size(known, 2) > 0) scale = scale_of(known, harmonics, problem%x_scale)
      call new_starts(starts, problem, harmonics, x, seed=0)
      do i = 1, starts%n_directed + n_random
         if (i <= starts%n_directed) then
            call starts%directed(i, guessed, kind)
         else
            call starts%draw(problem, i - starts%n_directed, guessed)
         end if
         x = guessed
         call solve_newton(problem, config, x, report)
         is_found = report%status == outcome%converged .and. is_apart(x, known, scale, negligible_share)
         if (is_found .or. work_is_over()) return
         if (size(known, 2) == 0) cycle
         x = guessed
         call follow_deflated(problem, config, known, scale, x, is_found)
         if (is_found .or. work_is_over()) return
      end do
   end subroutine find_other
end module hb_isolated_branches
