!> Newton's step in a wider set than that of a solution, including the coupling of retained and added harmonics.
!> Its first approximation is the block step: the exact tangent of the solution and, for each added harmonic, the tangent with
!> the mean slopes of the laws. Where block steps do not add up to it, GMRES solves J s = r with the exact tangent J of the wider
!> balance and the preconditioner of its own strongest couplings: added tuples may be next to a resonance, and are then coupled
!> to the retained ones more strongly than these among each other. Unknown frequencies and the parameter of a curve remain
!> unknowns. Source: docs/why/theory.md, section 7.
module hb_wide_problem
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_balance, only: balance_t
   use hb_bordered, only: bordered_problem_t, new_bordered_problem
   use hb_cancellation, only: work_is_over
   use hb_kinds, only: wp
   use hb_phase, only: peak_functional, peak_rate_functional, phase_problem_t
   use hb_problem, only: problem_t
   use hb_tangent_solver, only: new_tangent_krylov, tangent_krylov_t, tangent_solver_t
   implicit none
   private
   public :: nearer, new_wide_problem, wide_problem_t

   type, extends(bordered_problem_t) :: wide_problem_t
      integer :: n_products = 0                                       !! so far
      type(balance_t), pointer, private :: wide => null()
      class(problem_t), pointer, private :: narrow => null()
      type(tangent_solver_t), pointer, private :: solver => null()    ! of `narrow`
      integer, allocatable :: positions(:)                            !! positions of the retained unknowns among all
      logical :: is_lost = .false.                                    !! the tangent of `narrow` gave no step
      type(tangent_krylov_t), allocatable, private :: krylov          ! solves with the tangent of all unknowns
   contains
      procedure :: find_two_steps => wide_problem_find_two_steps
      procedure :: find_residual => wide_problem_find_residual
      procedure :: find_step => wide_problem_find_step
      procedure :: step_in_blocks => wide_problem_step_in_blocks
      procedure :: improve => wide_problem_improve
   end type wide_problem_t

   real(wp), parameter :: nearer = 0.5_wp                             !! a second step, relative to the first
   ! Remaining residual of the equations of a step, relative. Near resonances a step is inaccurate by up to a hundred times as
   ! much; the second step corrects that of the first.
   real(wp), parameter :: of_first = 1.0e-3_wp, of_second = 3.0e-2_wp
   real(wp), parameter :: negligible = 1.0e-2_wp                      ! a second step in blocks, relative to the first
   real(wp), parameter :: largest_residual = 0.5_wp                   ! of a step that is one
   integer, parameter :: n_vectors = 40, most_products = 200
   integer, parameter :: patience = 20 ! products before the preconditioner becomes stronger: they are dear, its factors are not

contains

   !> Creates the problem of a wide balance, with the factors of its mean tangent, around a narrow one with its
   !> tangent, which may have unknown parameters; the border of these is that of the retained harmonics.
   subroutine new_wide_problem(self, wide, balance, narrow, tangent)
      type(wide_problem_t), intent(out) :: self
      type(balance_t), intent(inout), target :: wide
      type(balance_t), intent(in) :: balance                          !! the narrow one
      class(problem_t), intent(inout), target :: narrow               !! on the narrow balance
      type(tangent_solver_t), intent(inout), target :: tangent        !! of `narrow`, not singular
      real(wp), allocatable :: functionals(:, :), border(:, :)
      integer :: n, n_retained

      self%wide => wide
      self%narrow => narrow
      self%solver => tangent
      n = wide%n_unknowns
      n_retained = balance%n_unknowns
      self%positions = [wide%harmonics%indices_of(balance%harmonics, balance%n_dofs)]
      allocate (functionals(n, 0))
      call new_bordered_problem(self%bordered_problem_t, wide, [integer ::], functionals, [real(wp) ::])
      select type (narrow)
      class is (bordered_problem_t)
         self%which = narrow%which
         self%values = narrow%values
         self%n_unknowns = n + size(self%which)
         deallocate (functionals)
         allocate (functionals(self%n_unknowns, size(self%which)), border(n, size(self%which)), source=0.0_wp)
         functionals(self%positions, :) = narrow%functionals(:n_retained, :)
         functionals(n + 1:, :) = narrow%functionals(n_retained + 1:, :)
         border(self%positions, :) = narrow%border
         call take_peaks()
         call move_alloc(functionals, self%functionals)
         call move_alloc(border, self%border)
      end select
      call self%rescale()

   contains

      !> Adds to the equations of peaks the part outside the retained harmonics.
      subroutine take_peaks()
         select type (narrow)
         class is (phase_problem_t)
            if (narrow%peak_dof == 0) return
            functionals(:n, 1) = peak_rate_functional(wide%harmonics, wide%n_dofs, narrow%peak_dof, narrow%tones(1))
            functionals(:n, 2) = peak_functional(wide%harmonics, wide%n_dofs, narrow%peak_dof)
         end select
      end subroutine take_peaks
   end subroutine new_wide_problem

   !> Two steps of Newton's method from a motion. With several tones they are block steps, two in the second one, if each
   !> is clearly smaller than the one before: retained and added harmonics are then so weakly coupled that a few block
   !> steps add up to the full step. Two may decrease by chance: the first one is in the added harmonics, and what
   !> comes back to these shows only in the third. With rigid walls, the harmonics of an impact decrease slowly, and in
   !> the response to the first step contact begins and ends within it: the second step grows with the set (.0003, .035,
   !> .041 at orders 8, 20, 30 of the beam against a wall, products .019, .018) while the first one agrees with the true
   !> error (.0054, .0041, .0043; against order 45 .0031 at order 20), and only the first one is used.
   subroutine wide_problem_find_two_steps(self, motion, r, is_rigid, first, second, is_lost)
      class(wide_problem_t), intent(inout) :: self
      real(wp), intent(in) :: motion(:, :)                            !! [m], (n_coefficients, n_dofs)
      real(wp), intent(in) :: r(:)                                    !! residual of the motion (n_unknowns)
      logical, intent(in) :: is_rigid                                 !! a law is rigid
      real(wp), intent(out) :: first(:), second(:)                    !! (n_unknowns)
      logical, intent(out) :: is_lost                                 !! no step was found
      real(wp) :: r_there(size(r))
      logical :: is_found

      call self%step_in_blocks(r, first)
      is_lost = self%is_lost
      if (is_lost) return
      if (size(self%wide%omega) > 1) then
         call self%find_residual(moved(), first, r_there, is_lost)
         if (is_lost) return
         call self%step_in_blocks(r_there, second)
         if (.not. self%is_lost) then
            is_found = norm2(second) < nearer*norm2(first)
            if (is_found .and. .not. is_rigid) call add_third()
            if (is_found .or. is_lost) return
            if (is_rigid) second = 0.0_wp
            if (is_rigid) return
         end if
         self%is_lost = .false.
      end if
      call self%find_step(motion, r, of_first, first, is_found)
      is_lost = .not. is_found
      if (.not. is_lost) call self%find_residual(moved(), first, r_there, is_lost)
      if (is_lost) return
      call self%step_in_blocks(r_there, second)
      is_lost = self%is_lost
      if (is_lost .or. norm2(second) <= negligible*norm2(first)) return
      call self%find_step(moved(), r_there, of_second, second, is_found)
      is_lost = .not. is_found

   contains

      !> Adds a third block step to the second; `is_found` becomes false if it is no smaller.
      subroutine add_third()
         real(wp) :: third(size(r))

         call self%find_residual(moved() - reshape(second(:size(motion)), shape(motion)), first + second, r_there, is_lost)
         if (is_lost) return
         call self%step_in_blocks(r_there, third)
         is_found = .not. self%is_lost
         if (is_found) is_found = norm2(third) < nearer*norm2(second)
         if (is_found) second = second + third
      end subroutine add_third

      !> The motion after the first step.
      function moved()
         real(wp) :: moved(size(motion, 1), size(motion, 2))

         moved = motion - reshape(first(:size(motion)), shape(motion))
      end function moved
   end subroutine wide_problem_find_two_steps

   !> Continues Newton's method towards the motion of the wide balance. A step is halved unless it reduces the step in
   !> blocks, by which motions are compared.
   subroutine wide_problem_improve(self, n_steps, motion)
      class(wide_problem_t), intent(inout) :: self
      integer, intent(in) :: n_steps                                  !! >= 1, halved ones included
      real(wp), intent(inout) :: motion(:, :)                         !! [m], (n_coefficients, n_dofs)
      real(wp), dimension(self%n_unknowns) :: nothing, r, blocks, step
      real(wp) :: least, now(size(motion, 1), size(motion, 2))
      integer :: i
      logical :: is_found, is_lost

      now = motion
      nothing = 0.0_wp
      least = huge(1.0_wp)
      do i = 0, n_steps
         if (work_is_over()) return
         call self%find_residual(now, nothing, r, is_lost)
         if (.not. is_lost) call self%step_in_blocks(r, blocks)
         if (is_lost .or. self%is_lost) return
         if (norm2(blocks) < least) then
            motion = now
            least = norm2(blocks)
            step = blocks
            if (i == n_steps .or. least <= 0.0_wp) return
            call self%find_step(now, r, of_first, step, is_found)
            if (.not. is_found) return
         else
            step = 0.5_wp*step
         end if
         now = motion - reshape(step(:size(now)), shape(now))
      end do
   end subroutine wide_problem_improve

   !> Residual of a motion that a step `before` has produced; `is_lost` if a law is outside its domain.
   subroutine wide_problem_find_residual(self, motion, before, r, is_lost)
      class(wide_problem_t), intent(inout) :: self
      real(wp), intent(in) :: motion(:, :)                            !! [m], (n_coefficients, n_dofs)
      real(wp), intent(in) :: before(:)                               !! (n_unknowns)
      real(wp), intent(out) :: r(:)                                   !! (n_unknowns)
      logical, intent(out) :: is_lost

      call self%wide%residual(reshape(motion, [size(motion)]), r(:size(motion)))
      is_lost = .not. all(ieee_is_finite(r(:size(motion))))
      if (is_lost) return
      associate (n => size(motion), n_all => size(r))
         r(n + 1:) = 0.0_wp
         if (n_all > n) r(:n) = r(:n) - matmul(self%border, before(n + 1:))
         select type (narrow => self%narrow)
         type is (phase_problem_t)
            r(n + 1:) = narrow%added_residual(self%wide, motion)
            if (allocated(narrow%row)) r(n_all) = r(n_all) - dot_product(self%functionals(n + 1:, n_all - n), before(n + 1:))
         end select
      end associate
   end subroutine wide_problem_find_residual

   !> Finds the step s of J s = r at a motion; `is_found` is false if there is none.
   subroutine wide_problem_find_step(self, motion, r, accuracy, step, is_found)
      class(wide_problem_t), intent(inout) :: self
      real(wp), intent(in) :: motion(:, :)                            !! [m], (n_coefficients, n_dofs)
      real(wp), intent(in) :: r(:)                                    !! (n_unknowns)
      real(wp), intent(in) :: accuracy                                !! remaining residual, relative
      real(wp), intent(inout) :: step(:)                              !! (n_unknowns)
      logical, intent(out) :: is_found

      is_found = all(ieee_is_finite(r))
      if (is_found) call self%wide%linearise(reshape(motion, [size(motion)]), is_found)
      if (.not. is_found) return
      if (allocated(self%krylov)) then
         call self%krylov%forget()
      else
         allocate (self%krylov)
         self%preconditioner_level = max(1, self%narrow%preconditioner_level)
         call new_tangent_krylov(self%krylov, self, n_vectors, most_products)
         self%krylov%patience = patience
      end if
      call self%krylov%solve(self, r, accuracy, step)
      call self%solver%remove_null_vector(step, self%positions)
      self%n_products = self%krylov%n_products
      is_found = all(ieee_is_finite(step)) .and. self%krylov%residual <= largest_residual
   end subroutine wide_problem_find_step

   !> The block step: of the retained unknowns and parameters alone, and of each added harmonic alone.
   subroutine wide_problem_step_in_blocks(self, r, step)
      class(wide_problem_t), intent(inout) :: self
      real(wp), intent(in) :: r(:)
      real(wp), intent(out) :: step(:)
      real(wp) :: retained(size(self%positions) + size(self%which))
      logical :: is_lost

      associate (n => self%wide%n_unknowns, n_retained => size(self%positions))
         call self%wide%solve_mean_tangent(r(:n), step(:n))
         retained(:n_retained) = r(self%positions)
         retained(n_retained + 1:) = r(n + 1:)
         call self%solver%solve(self%narrow, retained, is_lost)
         self%is_lost = self%is_lost .or. is_lost
         step(self%positions) = retained(:n_retained)
         step(n + 1:) = retained(n_retained + 1:)
      end associate
   end subroutine wide_problem_step_in_blocks
end module hb_wide_problem
