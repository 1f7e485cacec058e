!> Separate motions, on none of the curves followed so far, at values given in the input: each is the start of a
!> curve.
!> Other motions at values at which some are known: Newton's method with deflation of these, from many first guesses.
!> The residual is multiplied by the product of s**2/|x - x_i|**2 + 1 over the known motions x_i, with the size s of
!> the largest: its other zeros are those of the residual, and Newton's method is repelled from the known ones. Its
!> step is the usual one multiplied by a factor, which may be negative. Source: P. E. Farrell, A. Birkisson and S. W.
!> Funke, SIAM J. Sci. Comput. 37 (2015) A2026-A2045.
module hb_motions_apart
   use hb_bordered, only: bordered_problem_t, new_bordered_problem
   use hb_cancellation, only: work_is_over
   use hb_curve_sets, only: transfer_motion
   use hb_error, only: error_t
   use hb_followed_motion, only: followed_motion_t, origin_t
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: two_pi, wp
   use hb_level, only: join, level_t, transferred
   use hb_line_search, only: end_at_point
   use hb_newton, only: solve_newton
   use hb_outcome, only: outcome
   use hb_problem, only: problem_t
   use hb_solver_types, only: report_t, solver_config_t
   use hb_tangent_solver, only: new_tangent_solver, tangent_solver_t
   use hb_thresholds, only: agreement, faint, safety
   implicit none
   private
   public :: deflated_share, find_other, is_other, search_separate, shifted

   real(wp), parameter :: factors(5) = [0.0_wp, 3.0_wp, 0.3_wp, 8.0_wp, 1.1_wp]   ! of known motions, as guesses
   real(wp), parameter :: perturbations(4) = [1.0_wp, 3.0_wp, 8.0_wp, 0.3_wp] ! in one harmonic, relative to the size
   integer, parameter :: n_turns = 4                                  ! quarters of a turn of the phases
   integer, parameter :: max_perturbed = 4                           ! harmonics, the lowest

   integer, parameter :: max_iterations = 40                         ! from one first guess
   integer, parameter :: max_spurious = 4                            ! motions at a value that are known ones on a larger set: a
                                                                      ! limit of the work alone

contains

   !> Searches for a separate motion at the requested values, and returns the first one.
   subroutine search_separate(self, met, x, is_found, error)
      class(followed_motion_t), intent(inout), target :: self
      type(origin_t), intent(in) :: met(:)                            !! motions at these values
      real(wp), allocatable, intent(out) :: x(:)                      !! on the present set
      logical, intent(out) :: is_found
      type(error_t), allocatable, intent(out) :: error
      type(origin_t), allocatable :: known(:), others(:)
      integer :: i, k, n_spurious

      is_found = .false.
      if (.not. allocated(self%request%others)) return
      do i = 1, size(self%request%others)
         known = pack(met, [(.not. abs(met(k)%x(size(met(k)%x)) - self%request%others(i)) > 0.0_wp, k=1, size(met))])
         if (size(known) == 0) cycle                                  ! no motion to start from
         others = known
         do n_spurious = 0, max_spurious
            call search_at(self, self%request%others(i), others, x, is_found, error)
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
   subroutine search_at(self, value, known, x, is_found, error)
      class(followed_motion_t), intent(inout), target :: self
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
         level = known(1)%level
         level%unknowns = [known(1)%x(:size(known(1)%x) - size(self%problem%which)), 0.0_wp*self%model%system%tones%omega]
         do i = 2, size(known)
            call join(level, known(i)%level%set, is_new)
            level%n_samples = max(level%n_samples, known(i)%level%n_samples)
         end do
         call self%put_on(level, error)
         if (allocated(error)) return
      end if
      motions = motions_of(self, known)
      call self%problem%move_to_point(motions(:, 1), is_possible)
      if (.not. is_possible) return
      allocate (functional(size(motions, 1), 1), source=0.0_wp)
      functional(size(functional), 1) = 1.0_wp
      call new_bordered_problem(held, self%problem, self%problem%which, functional, [value])
      config = self%problem%model%options%solver
      config%tolerance = max(config%tolerance, 2.0_wp*self%problem%rounding_level(motions(:self%problem%n_unknowns, 1)))
      config%max_iterations = max_iterations
      if (self%model%options%accuracy%is_on) then                     ! the deflated motion must be a zero of this problem
         do i = 1, size(motions, 2)
            solved = motions(:, i)
            call solve_newton(held, config, solved, report)
            if (report%status == outcome%converged) motions(:, i) = solved
         end do
      end if
      x = motions(:, 1)
      call find_other(held, config, self%problem%model%discretisation%harmonics, motions, x, is_found)
      x(size(x)) = value
   end subroutine search_at

   !> Refines a motion to the tolerance; it is not accepted if it is then a known one.
   subroutine accept(self, known, x, is_accepted, error)
      class(followed_motion_t), intent(inout), target :: self
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
                             safety*self%model%options%accuracy%tolerance)
   end subroutine accept

   !> Motions on the present set, and their shifts by periods of the loads.
   function motions_of(self, known) result(motions)
      class(followed_motion_t), intent(in) :: self
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
               x = transferred(known(i)%level%set, model%discretisation%harmonics, known(i)%x, 1)
               if (copy > 0) x(:n) = shifted(x(:n), model%discretisation%harmonics, phases)
               motions = reshape([motions, x], [n + 1, size(motions, 2) + 1])
            end do
         end do
      end associate
   end function motions_of

   !> Searches for a zero of the residual other than the known ones, from all first guesses in turn.
   subroutine find_other(problem, config, harmonics, known, x, is_found)
      class(problem_t), intent(inout) :: problem                      !! unknowns of a balance, and equations that hold further ones
      type(solver_config_t), intent(in) :: config
      type(harmonics_t), intent(in) :: harmonics
      real(wp), intent(in) :: known(:, :)                             !! (n_unknowns, any, at least 1)
      real(wp), intent(out), contiguous :: x(:)                       !! (n_unknowns)
      logical, intent(out) :: is_found
      integer, allocatable :: lowest(:)
      type(report_t) :: report
      real(wp), dimension(size(x)) :: guessed, scale
      integer :: guess, i, n_each

      is_found = .false.
      lowest = lowest_harmonics(harmonics)
      n_each = (size(factors) + size(lowest)*size(perturbations))*n_turns
      scale = scale_of(known, harmonics, problem%x_scale)
      do guess = 0, n_each - 1
         do i = 1, size(known, 2)
            x = known(:, i)
            call disturb(guess, scale, harmonics, lowest, x)
            guessed = x
            call solve_newton(problem, config, x, report)             ! without deflation many guesses already lead to other motions
            is_found = report%status == outcome%converged .and. is_apart(x, known, scale, faint)
            if (is_found) return
            x = guessed
            call follow_deflated(problem, config, known, scale, x, is_found)
            if (is_found .or. work_is_over()) return
         end do
      end do
   end subroutine find_other

   !> Newton's method from x with deflation of the known zeros.
   subroutine follow_deflated(problem, config, known, scale, x, is_found)
      class(problem_t), intent(inout) :: problem
      type(solver_config_t), intent(in) :: config
      real(wp), intent(in) :: known(:, :)                             !! (n_unknowns, any)
      real(wp), intent(in) :: scale(:)                                !! amplitudes of known motions, (n_unknowns)
      real(wp), intent(inout), contiguous :: x(:)
      logical, intent(out) :: is_found
      type(report_t) :: report
      type(tangent_solver_t) :: solver
      real(wp) :: length, r(size(x)), size_of_known
      integer :: i
      logical :: is_singular

      is_found = .false.
      size_of_known = maxval([(norm2(known(:, i)/scale), i=1, size(known, 2))])
      do
         call problem%residual(x, r)
         report%residual = problem%norm(r)
         report%evaluations = report%evaluations + 1
         call end_at_point(problem, config, report)
         if (report%status /= outcome%pending) exit
         call new_tangent_solver(solver, problem, x, is_singular)
         if (is_singular) return
         call solver%solve(problem, r, is_singular)
         if (is_singular) return
         r = -deflated_share(-r/scale, x/scale, known/spread(scale, 2, size(known, 2)), size_of_known)*r
         length = norm2(r/scale)/size_of_known
         x = x + min(1.0_wp, 1.0_wp/max(length, tiny(1.0_wp)))*r        ! no farther than the size of the known motions
         report%iterations = report%iterations + 1
      end do
      is_found = report%status == outcome%converged .and. is_apart(x, known, scale, faint)
   end subroutine follow_deflated

   !> Whether x is none of the known motions, which may have an error of a share of themselves.
   pure logical function is_other(x, known, harmonics, x_scale, share)
      real(wp), intent(in) :: x(:)
      real(wp), intent(in) :: known(:, :)                             !! (n_unknowns, any)
      type(harmonics_t), intent(in) :: harmonics
      real(wp), intent(in) :: x_scale(:)                              !! of unknowns of the balance
      real(wp), intent(in) :: share

      is_other = is_apart(x, known, scale_of(known, harmonics, [x_scale, spread(1.0_wp, 1, size(x) - size(x_scale))]), &
                          max(faint, share))
   end function is_other

   !> Whether x is none of the known motions.
   pure logical function is_apart(x, known, scale, least)
      real(wp), intent(in) :: x(:)
      real(wp), intent(in) :: known(:, :), scale(:)
      real(wp), intent(in) :: least                                   !! distance, relative to each of them
      integer :: i

      is_apart = all([(norm2((x - known(:, i))/scale) >= least*norm2(known(:, i)/scale), i=1, size(known, 2))])
   end function is_apart

   !> The step of the deflated problem, relative to that of the problem itself.
   pure real(wp) function deflated_share(step, x, known, size_of_motion) result(share)
      real(wp), intent(in) :: step(:), x(:)
      real(wp), intent(in) :: known(:, :)                             !! (n_unknowns, any)
      real(wp), intent(in) :: size_of_motion
      real(wp) :: growth, square
      integer :: i

      growth = 0.0_wp                                                 ! of the logarithm of the product along the step
      do i = 1, size(known, 2)
         square = max(sum((x - known(:, i))**2)/size_of_motion**2, tiny(1.0_wp))
         growth = growth - 2.0_wp*dot_product(x - known(:, i), step)/size_of_motion**2/(square*(1.0_wp + square))
      end do
      share = 1.0_wp - growth
      share = 1.0_wp/sign(max(abs(share), agreement), share)
   end function deflated_share

   !> Amplitude of the largest known motion at each degree of freedom, for all its coefficients.
   pure function scale_of(known, harmonics, x_scale) result(scale)
      real(wp), intent(in) :: known(:, :)                             !! (n_unknowns, any)
      type(harmonics_t), intent(in) :: harmonics
      real(wp), intent(in) :: x_scale(:)                              !! of unknowns that are not coefficients
      real(wp) :: scale(size(x_scale))
      integer :: d, i

      scale = x_scale
      associate (n => harmonics%n_coefficients)
         do d = 1, size(scale)/n
            scale((d - 1)*n + 1:d*n) = maxval([(norm2(known((d - 1)*n + 1:d*n, i)), i=1, size(known, 2))])
         end do
         associate (all_of_them => scale(:(size(scale)/n)*n))
            all_of_them = max(all_of_them, faint*maxval(all_of_them), tiny(1.0_wp))
         end associate
      end associate
   end function scale_of

   !> Creates a first guess from a known motion, by its number from 0: a multiple with other phases, or a perturbation
   !> of a low harmonic.
   pure subroutine disturb(guess, scale, harmonics, lowest, x)
      integer, intent(in) :: guess
      real(wp), intent(in) :: scale(:)                                !! amplitudes of known motions, (n_unknowns)
      type(harmonics_t), intent(in) :: harmonics
      integer, intent(in) :: lowest(:)
      real(wp), intent(inout) :: x(:)
      real(wp) :: angle
      integer :: d, first, k, n

      n = (size(x)/harmonics%n_coefficients)*harmonics%n_coefficients  ! further unknowns are fixed
      angle = modulo(guess, n_turns)*two_pi/n_turns
      k = guess/n_turns
      if (k < size(factors)) then
         x(:n) = factors(k + 1)*shifted(x(:n), harmonics, spread(angle, 1, harmonics%n_tones))
         return
      end if
      k = k - size(factors)
      associate (h => lowest(1 + k/size(perturbations)), amount => perturbations(1 + modulo(k, size(perturbations))))
         do d = 1, n/harmonics%n_coefficients
            first = (d - 1)*harmonics%n_coefficients
            associate (c => first + harmonics%cos_at(h), s => first + harmonics%sin_at(h))
               x(c) = x(c) + amount*cos(angle)*scale(c)
               x(s) = x(s) + amount*sin(angle)*scale(s)
            end associate
         end do
      end associate
   end subroutine disturb

   !> The motion with shifted phases, x(tau + phases).
   pure function shifted(x, harmonics, phases) result(y)
      real(wp), intent(in) :: x(:)                                    !! (n_coefficients*n_dofs)
      type(harmonics_t), intent(in) :: harmonics
      real(wp), intent(in) :: phases(:)                               !! [rad], (n_tones)
      real(wp) :: y(size(x))

      associate (n => harmonics%n_coefficients, angles => matmul(phases, real(harmonics%tuples, wp)))
         y = reshape(harmonics%times(exp(cmplx(0.0_wp, angles, wp)), reshape(x, [n, size(x)/n])), [size(x)])
      end associate
   end function shifted

   !> Numbers of the harmonics with the lowest tuples, except the zero tuple.
   pure function lowest_harmonics(harmonics) result(lowest)
      type(harmonics_t), intent(in) :: harmonics
      integer, allocatable :: lowest(:)
      integer :: h, order

      allocate (lowest(0))
      do order = 1, maxval(harmonics%highest)*harmonics%n_tones
         do h = 1, harmonics%n_harmonics
            if (size(lowest) >= max_perturbed) return
            if (sum(abs(harmonics%tuples(:, h))) == order) lowest = [lowest, h]
         end do
      end do
   end function lowest_harmonics
end module hb_motions_apart
