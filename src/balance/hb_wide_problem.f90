!> Newton's step in a wider set than that of a solution, including the coupling of retained and added harmonics.
!> No matrix of the size of the wider set is factorised. It is replaced by M, which consists of the exact tangent of
!> the solution and, for each added harmonic, the tangent with the mean slopes of the laws. GMRES solves M**-1 J s =
!> M**-1 r with the exact tangent J of the wider balance, so that the residual of the equations is measured as a step;
!> M**-1 r itself is the block step. Unknown frequencies and the parameter of a curve remain unknowns. With several tones and
!> a tangent of the solution that is not factorised, each M**-1 would be an iteration; the preconditioner of the wider balance
!> is then used instead, unless a law is rigid or a parameter unknown. Source: docs/why/theory.md, section 7.
module hb_wide_problem
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_balance, only: balance_t
   use hb_bordered, only: bordered_problem_t, new_bordered_problem
   use hb_cancellation, only: work_is_over
   use hb_gmres, only: gmres_t, new_gmres
   use hb_kinds, only: two_pi, wp
   use hb_law, only: law_t
   use hb_law_measure, only: law_measure_t
   use hb_phase, only: peak_functional, peak_rate_functional, phase_problem_t
   use hb_problem, only: problem_t
   use hb_tangent_krylov, only: new_tangent_krylov, tangent_krylov_t
   use hb_tangent_solver, only: tangent_solver_t
   implicit none
   private
   public :: are_walls_struck, clearly_smaller, has_multipliers, has_walls, new_wide_problem, slightly_later, vectors_of_steps
   public :: wide_problem_t

   real(wp), parameter :: step_accuracy = 1.0e-2_wp                   ! of a step, and of the one after it in units of that

   type, extends(bordered_problem_t) :: wide_problem_t
      integer :: n_products = 0                                       !! so far
      type(balance_t), pointer, private :: wide => null()
      class(problem_t), pointer, private :: narrow => null()
      type(tangent_solver_t), pointer, private :: solver => null()    ! of `narrow`
      integer, allocatable :: positions(:)                            !! positions of the retained unknowns among all
      logical :: is_lost = .false.                                    !! the tangent of `narrow` gave no step
      real(wp) :: accuracy = step_accuracy                            !! of steps
      real(wp) :: growth = 0.0_wp                                     !! step in blocks after a coupled step, relative to that:
                                                                      !! above 1 the tangent of `narrow` is almost singular
      type(tangent_krylov_t), allocatable, private :: krylov          ! of the wide balance, where this gives the steps
   contains
      procedure :: find_two_steps => wide_problem_find_two_steps
      procedure :: find_residual => wide_problem_find_residual
      procedure :: find_step => wide_problem_find_step
      procedure, private :: find_whole_step => wide_problem_find_whole_step
      procedure :: length_of => wide_problem_length_of
      procedure :: apply_tangent => wide_problem_apply_tangent
      procedure :: precondition => wide_problem_precondition
      procedure :: step_in_blocks => wide_problem_step_in_blocks
      procedure :: improve => wide_problem_improve
   end type wide_problem_t

   real(wp), parameter :: residual_rounding = 1.0e-10_wp              ! of a residual, relative to its largest component: rounding
   real(wp), parameter :: clearly_smaller = 0.5_wp                    !! a second step, relative to the first
   ! products for one step: with 16 and 30, points of stops under two tones were more expensive and their sets no
   ! smaller
   integer, parameter :: of_one_tone = 100, of_several = 8, of_friction = 2
   ! remaining residuals of whole steps, relative: near resonances a step is inaccurate by up to a hundred times as much
   real(wp), parameter :: residual_of_first = 3.0e-3_wp, residual_of_second = 0.1_wp, largest_residual = 0.5_wp
   real(wp), parameter :: largest_of_first = 0.03_wp                  ! before a second one
   integer, parameter :: vectors_of_steps = 60                        !! of GMRES until it restarts
   integer, parameter :: max_products = 30, max_idle_steps = 20       ! and products before the preconditioner becomes stronger
   integer, parameter :: of_contacts = 100                            ! products where there is no stronger one

contains

   !> Creates the problem of a wide balance around a narrow one with its tangent, which may have unknown parameters; the border of
   !> these is that of the retained harmonics. Steps need the factors of the mean tangent of the wide balance.
   subroutine new_wide_problem(self, wide, balance, narrow, tangent, measure)
      type(wide_problem_t), intent(out) :: self
      type(balance_t), intent(inout), target :: wide
      type(balance_t), intent(in) :: balance                          !! the narrow one
      class(problem_t), intent(inout), target :: narrow               !! on the narrow balance
      type(tangent_solver_t), intent(inout), target :: tangent        !! of `narrow`, not singular
      type(law_measure_t), intent(in) :: measure                      !! related to the motion
      real(wp), allocatable :: functionals(:, :), border(:, :)
      integer :: i, n, n_retained

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
         call add_peaks()
         call move_alloc(functionals, self%functionals)
         call move_alloc(border, self%border)
      end select
      self%r_scale = [(1.0_wp, i=1, self%n_unknowns)]                 ! equations are scaled as steps: those of parameters count
      self%r_scale(:n) = measure%units_of(reshape(self%r_scale(:n), [n/wide%n_dofs, wide%n_dofs]))
      self%r_scale(n + 1:) = narrow%x_scale(n_retained + 1:)/measure%size_of_motion ! like motions of the same relative size
      self%x_scale = self%r_scale
      if (.not. solves_by_products()) return
      allocate (self%krylov)
      wide%preconditioner_level = first_level(wide%n_unknowns)
      wide%has_preconditioner = .false.

   contains

      !> Strength of the first preconditioner, by the set alone, so that an estimate does not depend on the path to its motion.
      pure integer function first_level(n)
         integer, intent(in) :: n

         first_level = 1 + count(n > [1000, 4000, 6000])
      end function first_level

      !> Whether GMRES finds the steps with the preconditioner of the wide balance: each solution of the narrow problem
      !> would be an iteration too. Rigid laws need its exact tangent, and for polynomials
      !> few block steps suffice.
      logical function solves_by_products()
         solves_by_products = (size(wide%omega) > 1 .or. allocated(wide%stiffness%contacts)) .and. &
            narrow%n_unknowns > balance%largest_dense .and. &
            size(self%which) == 0 .and. .not. any([(wide%law_set%laws(i)%law%is_multiplier, i=1, size(wide%law_set%laws))]) &
            .and. any([(wide%law_set%laws(i)%law%degree == 0, i=1, size(wide%law_set%laws))])
      end function solves_by_products

      !> Adds to the equations of peaks the part outside the retained harmonics.
      subroutine add_peaks()
         select type (narrow)
         class is (phase_problem_t)
            if (narrow%peak_dof == 0) return
            functionals(:n, 1) = peak_rate_functional(wide%harmonics, wide%n_dofs, narrow%peak_dof, narrow%tones(1))
            functionals(:n, 2) = peak_functional(wide%harmonics, wide%n_dofs, narrow%peak_dof)
         end select
      end subroutine add_peaks
   end subroutine new_wide_problem

   !> The motion a small part of a sample later, at which tangents are computed: slopes of laws jump at their kinks, and rounding
   !> would decide on which side a sample on a kink is. Of a contact that begins and ends on samples one of both belongs to
   !> it. Without switches the motion itself: with sliders alone, whose states would be integrated again, and smooth laws.
   pure function slightly_later(balance, motion) result(later)
      class(balance_t), intent(in) :: balance
      real(wp), intent(in) :: motion(:, :)                            !! [m], (n_coefficients, n_dofs)
      real(wp) :: later(size(motion, 1), size(motion, 2))
      real(wp), parameter :: sample_shift = 1.0e-5_wp                 ! of a sample: above the accuracy of solutions
      real(wp), parameter :: shift_growth = 0.4_wp                    ! of the next tone, so that a kink along none is followed
      real(wp) :: angle(balance%harmonics%n_harmonics)
      integer :: i, m

      later = motion
      if (.not. any([(has_kinks(balance%law_set%laws(i)%law), i=1, size(balance%law_set%laws))])) return
      associate (set => balance%harmonics, torus => balance%law_set%transform%torus)
         angle = 0.0_wp
         do m = 1, set%n_tones
            angle = angle + sample_shift*two_pi/torus%n_samples(m)*(1.0_wp + shift_growth*(m - 1))*set%tuples(m, :)
         end do
         later = set%times(cmplx(cos(angle), sin(angle), wp), motion)
      end associate

   contains

      !> Rigid laws have kinks too, where contact and sticking begin and end, and corners of several contacts.
      pure logical function has_kinks(law)
         class(law_t), intent(in) :: law

         has_kinks = law%n_switches > 0 .or. law%is_multiplier
      end function has_kinks
   end function slightly_later

   !> Two steps of Newton's method from a motion, in the first of these ways that finds them: by the preconditioner of the wider
   !> balance, if that is used; with several tones by block steps; by the coupling of retained and added harmonics.
   subroutine wide_problem_find_two_steps(self, motion, r, acts_rigidly, first, second, is_lost)
      class(wide_problem_t), intent(inout) :: self
      real(wp), intent(in) :: motion(:, :)                            !! [m], (n_coefficients, n_dofs)
      real(wp), intent(in) :: r(:)                                    !! residual of the motion, found last (n_unknowns)
      logical, intent(in) :: acts_rigidly                             !! laws are almost rigid: impacts are too short for the set
      real(wp), intent(out) :: first(:), second(:)                    !! (n_unknowns)
      logical, intent(out) :: is_lost                                 !! no step was found
      integer :: most
      logical :: is_found, strikes_walls

      strikes_walls = are_walls_struck(self%wide)
      if (allocated(self%krylov) .and. .not. acts_rigidly) then
         call find_whole_steps(self, motion, r, first, second, is_found, is_lost)
         if (is_found .or. is_lost) return
         deallocate (self%krylov)                                     ! the preconditioner is too weak
      end if
      call self%step_in_blocks(r, first)
      is_lost = self%is_lost
      if (is_lost) return
      if (size(self%wide%omega) > 1) then
         call find_second_in_blocks(self, motion, first, strikes_walls, second, is_found, is_lost)
         if (is_found .or. is_lost) return
      end if
      if (size(self%wide%omega) > 1 .and. has_multipliers(self%wide) .and. .not. strikes_walls) then
         call find_step_of_friction(self, motion, r, first, is_lost)
         second = 0.0_wp
      else
         most = merge(of_one_tone, of_several, size(self%wide%omega) == 1)
         call find_coupled_steps(self, motion, r, most, first, second, is_lost)
      end if
   end subroutine wide_problem_find_two_steps

   !> Finds both steps with the preconditioner of the wide balance, as far as the products go: the components that need
   !> more, along which the tangent is almost singular, would be far too large in a linear step. What a first step leaves
   !> of the residual after all of its products is what a second one would be spent on, in vain: it counts in proportion.
   subroutine find_whole_steps(self, motion, r, first, second, is_found, is_lost)
      class(wide_problem_t), intent(inout) :: self
      real(wp), intent(in) :: motion(:, :)                            !! [m], (n_coefficients, n_dofs)
      real(wp), intent(in) :: r(:)                                    !! residual of the motion (n_unknowns)
      real(wp), intent(inout) :: first(:), second(:)                  !! (n_unknowns)
      logical, intent(out) :: is_found                                !! the first one, at least
      logical, intent(out) :: is_lost                                 !! a law is outside its domain after the first one
      real(wp) :: r_there(size(r))
      logical :: is_complete

      is_lost = .false.
      call self%find_whole_step(motion, r, residual_of_first, first, is_found)
      if (.not. is_found) return
      if (self%krylov%residual > largest_of_first) then
         second = self%krylov%residual*first
      else
         call self%find_residual(moved(motion, first), first, r_there, is_lost)
         if (.not. is_lost) call self%find_whole_step(moved(motion, first), r_there, residual_of_second, second, is_complete)
      end if
   end subroutine find_whole_steps

   !> Finds the second step in blocks, and adds a third one to it, if each is clearly smaller than the one before: retained and
   !> added harmonics are then so weakly coupled that a few block steps add up to the full step; otherwise `is_found` is false.
   !> Two may decrease by chance: the first one is in the added harmonics, and what comes back to these shows only in the third.
   !>
   !> Where rigid walls are struck, the harmonics of an impact decrease slowly, and in the response to the first step contact
   !> begins and ends within it: the second step grows with the set (.0003, .035, .041 at orders 8, 20, 30 of the beam
   !> against a wall, products .019, .018) while the first one agrees with the true error (.0054, .0041, .0043; against order
   !> 45 .0031 at order 20), and only the first one is used unless the second is clearly smaller.
   subroutine find_second_in_blocks(self, motion, first, strikes_walls, second, is_found, is_lost)
      class(wide_problem_t), intent(inout) :: self
      real(wp), intent(in) :: motion(:, :)                            !! [m], (n_coefficients, n_dofs)
      real(wp), intent(in) :: first(:)                                !! in blocks (n_unknowns)
      logical, intent(in) :: strikes_walls                            !! the motion does
      real(wp), intent(inout) :: second(:)                            !! (n_unknowns)
      logical, intent(out) :: is_found
      logical, intent(out) :: is_lost                                 !! a law is outside its domain after the first step
      real(wp) :: r_there(size(first))

      is_found = .false.
      call self%find_residual(moved(motion, first), first, r_there, is_lost)
      if (is_lost) return
      call self%step_in_blocks(r_there, second)
      if (.not. self%is_lost) then
         is_found = self%length_of(second) < clearly_smaller*self%length_of(first)
         if (strikes_walls) then
            if (.not. is_found) second = 0.0_wp
            is_found = .true.
         else if (is_found) then
            call add_third(self, motion, first, second, is_found, is_lost)
         end if
      end if
      self%is_lost = .false.
   end subroutine find_second_in_blocks

   !> Adds a third block step to the second; `is_found` is false if it is no smaller.
   subroutine add_third(self, motion, first, second, is_found, is_lost)
      class(wide_problem_t), intent(inout) :: self
      real(wp), intent(in) :: motion(:, :)                            !! [m], (n_coefficients, n_dofs)
      real(wp), intent(in) :: first(:)                                !! (n_unknowns)
      real(wp), intent(inout) :: second(:)                            !! (n_unknowns)
      logical, intent(out) :: is_found
      logical, intent(out) :: is_lost                                 !! a law is outside its domain after both steps
      real(wp), dimension(size(first)) :: r_there, third

      is_found = .true.
      call self%find_residual(moved(moved(motion, first), second), first + second, r_there, is_lost)
      if (is_lost) return
      call self%step_in_blocks(r_there, third)
      is_found = .not. self%is_lost
      if (is_found) is_found = self%length_of(third) < clearly_smaller*self%length_of(second)
      if (is_found) second = second + third
   end subroutine add_third

   !> Finds both steps with the coupling of retained and added harmonics.
   subroutine find_coupled_steps(self, motion, r, most, first, second, is_lost)
      class(wide_problem_t), intent(inout) :: self
      real(wp), intent(in) :: motion(:, :)                            !! [m], (n_coefficients, n_dofs)
      real(wp), intent(in) :: r(:)                                    !! residual of the motion (n_unknowns)
      integer, intent(in) :: most                                     !! products for one step
      real(wp), intent(inout) :: first(:)                             !! in blocks on entry (n_unknowns)
      real(wp), intent(inout) :: second(:)                            !! (n_unknowns)
      logical, intent(out) :: is_lost
      real(wp) :: r_there(size(r))
      logical :: is_found

      call self%find_step(motion, r, most, 0.0_wp, first, is_found)
      is_lost = .not. is_found
      if (.not. is_lost) call self%find_residual(moved(motion, first), first, r_there, is_lost)
      if (is_lost) return
      call self%step_in_blocks(r_there, second)
      self%growth = self%length_of(second)/max(self%length_of(first), tiny(1.0_wp))
      associate (units => self%r_scale(:size(motion)))
         call self%find_step(moved(motion, first), r_there, most, step_accuracy*norm2(first(:size(motion))/units), second, is_found)
      end associate
      is_lost = .not. is_found
   end subroutine find_coupled_steps

   !> Finds the first step alone with this coupling, by few products. Under rigid friction with several tones steps in blocks
   !> change little but the added harmonics, though the friction that these change moves the retained ones most; in a second
   !> step samples begin and end to stick within it, and more products find more of what a linear step exaggerates (36 boxes of
   !> orders 4 and 8: 8 products and two steps up to 9 times the error, 8 and one 4.2, 4 3.5, 2 .6 to 2.6 times, 1 .2 times).
   subroutine find_step_of_friction(self, motion, r, first, is_lost)
      class(wide_problem_t), intent(inout) :: self
      real(wp), intent(in) :: motion(:, :)                            !! [m], (n_coefficients, n_dofs)
      real(wp), intent(in) :: r(:)                                    !! residual of the motion (n_unknowns)
      real(wp), intent(inout) :: first(:)                             !! in blocks on entry (n_unknowns)
      logical, intent(out) :: is_lost
      logical :: is_found

      call self%find_step(motion, r, of_friction, 0.0_wp, first, is_found)
      is_lost = .not. is_found
   end subroutine find_step_of_friction

   !> Whether a law is rigid.
   pure logical function has_multipliers(balance)
      type(balance_t), intent(in) :: balance
      integer :: i

      has_multipliers = any([(balance%law_set%laws(i)%law%is_multiplier, i=1, size(balance%law_set%laws))])
   end function has_multipliers

   !> Whether a law is rigid in displacements: what it exerts when it is struck has all harmonics alike.
   pure logical function has_walls(balance)
      type(balance_t), intent(in) :: balance
      integer :: i

      has_walls = any([(is_wall(balance%law_set%laws(i)%law), i=1, size(balance%law_set%laws))])
   end function has_walls

   !> Whether such a law exerts a force at any sample of the last motion.
   logical function are_walls_struck(balance)
      type(balance_t), intent(in) :: balance
      integer :: i

      are_walls_struck = .false.
      associate (set => balance%law_set)
         do i = 1, size(set%laws)
            if (is_wall(set%laws(i)%law)) are_walls_struck = are_walls_struck .or. any(abs(set%force_of(i)) > 0.0_wp)
         end do
      end associate
   end function are_walls_struck

   pure logical function is_wall(law)
      class(law_t), intent(in) :: law

      is_wall = law%is_multiplier .and. .not. law%is_rigid_friction()
   end function is_wall

   !> The motion after a step.
   pure function moved(motion, step)
      real(wp), intent(in) :: motion(:, :)                            !! [m], (n_coefficients, n_dofs)
      real(wp), intent(in) :: step(:)                                 !! (n_unknowns)
      real(wp) :: moved(size(motion, 1), size(motion, 2))

      moved = motion - reshape(step(:size(motion)), shape(motion))
   end function moved

   !> Length of a step in the units of the equations.
   pure real(wp) function wide_problem_length_of(self, step) result(length)
      class(wide_problem_t), intent(in) :: self
      real(wp), intent(in) :: step(:)                                 !! (n_unknowns)

      length = norm2(step/self%r_scale)
   end function wide_problem_length_of

   !> Continues Newton's method towards the motion of the wide balance. A step is halved unless it reduces the step in
   !> blocks, by which motions are compared.
   subroutine wide_problem_improve(self, n_steps, motion)
      class(wide_problem_t), intent(inout) :: self
      integer, intent(in) :: n_steps                                  !! >= 1, halved ones included
      real(wp), intent(inout) :: motion(:, :)                         !! [m], (n_coefficients, n_dofs)
      real(wp), dimension(self%n_unknowns) :: no_step, r, blocks, step
      real(wp) :: least, now(size(motion, 1), size(motion, 2))
      integer :: i
      logical :: is_found, is_lost

      now = motion
      no_step = 0.0_wp
      least = huge(1.0_wp)
      do i = 0, n_steps
         if (work_is_over()) return
         call self%find_residual(now, no_step, r, is_lost)
         if (.not. is_lost) call self%step_in_blocks(r, blocks)
         if (is_lost .or. self%is_lost) return
         if (self%length_of(blocks) < least) then
            motion = now
            least = self%length_of(blocks)
            step = blocks
            if (i == n_steps .or. least <= 0.0_wp) return
            call self%find_step(now, r, of_one_tone, 0.0_wp, step, is_found)
            if (.not. is_found) return
         else
            step = 0.5_wp*step
         end if
         now = moved(motion, step)
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

   !> Finds the step s of J s = r at a motion, starting from the block step; `is_found` is false if no step close to
   !> it is found.
   subroutine wide_problem_find_step(self, motion, r, most, least, step, is_found)
      class(wide_problem_t), intent(inout) :: self
      real(wp), intent(in) :: motion(:, :)                            !! [m], (n_coefficients, n_dofs)
      real(wp), intent(in) :: r(:)                                    !! (n_unknowns)
      integer, intent(in) :: most                                     !! products
      real(wp), intent(in) :: least                                   !! size of negligible steps
      real(wp), intent(inout) :: step(:)                              !! (n_unknowns)
      logical, intent(out) :: is_found
      type(gmres_t) :: gmres
      real(wp) :: blocks(size(step))

      is_found = .false.
      if (self%is_lost .or. .not. all(ieee_is_finite(step))) return
      is_found = self%length_of(step) <= least
      if (is_found) return
      call self%wide%linearise([slightly_later(self%wide, motion)], is_found)
      if (.not. is_found) return
      call new_gmres(gmres, self%n_unknowns, most)
      blocks = step
      call gmres%solve(self, blocks, max(self%accuracy, least/self%length_of(blocks)), most, step)
      self%n_products = self%n_products + gmres%n_products
      is_found = all(ieee_is_finite(step)) .and. .not. self%is_lost
   end subroutine wide_problem_find_step

   !> Finds the step s of J s = r at a motion with the preconditioner of the wide balance, its own most strongly coupled
   !> tuples: added ones may be next to a resonance, and are then coupled to the retained ones more strongly than these
   !> among each other. `is_found` is false if most of r remains after the permitted products.
   subroutine wide_problem_find_whole_step(self, motion, r, residual, step, is_found)
      class(wide_problem_t), intent(inout) :: self
      real(wp), intent(in) :: motion(:, :)                            !! [m], (n_coefficients, n_dofs)
      real(wp), intent(in) :: r(:)                                    !! (n_unknowns)
      real(wp), intent(in) :: residual                                !! at which it ends, relative
      real(wp), intent(out) :: step(:)                                !! (n_unknowns)
      logical, intent(out) :: is_found

      step = 0.0_wp
      is_found = all(ieee_is_finite(r))
      if (.not. is_found) return
      call new_tangent_krylov(self%krylov, self%wide, vectors_of_steps, &
                              merge(of_contacts, max_products, allocated(self%wide%stiffness%contacts)))
      self%krylov%patience = max_idle_steps
      call self%krylov%update(self%wide, [slightly_later(self%wide, motion)], is_found)
      if (.not. is_found) return
      call self%krylov%solve(self%wide, r, residual, step)
      self%n_products = self%n_products + self%krylov%n_products
      self%wide%has_preconditioner = .true.                           ! also of the next step, however many products it took
      is_found = all(ieee_is_finite(step)) .and. self%krylov%residual <= largest_residual
   end subroutine wide_problem_find_whole_step

   subroutine wide_problem_apply_tangent(self, x, product)
      class(wide_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(out), contiguous :: product(:)
      real(wp) :: r(size(x))

      associate (n => self%wide%n_unknowns)
         call self%wide%apply_tangent(x(:n), r(:n))
         if (self%n_unknowns > n) then
            r(:n) = r(:n) + matmul(self%border, x(n + 1:))
            r(n + 1:) = matmul(x, self%functionals)
         end if
      end associate
      call self%step_in_blocks(r, product)
   end subroutine wide_problem_apply_tangent

   !> The equations are preconditioned with M.
   subroutine wide_problem_precondition(self, r, step)
      class(wide_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: r(:)
      real(wp), intent(out), contiguous :: step(:)

      step = r(:self%n_unknowns)
   end subroutine wide_problem_precondition

   !> M**-1 r: the step of the retained unknowns and parameters alone, and of each added harmonic alone. Equations that have nothing
   !> but rounding are left out: harmonics that a symmetry of the motion excludes would be amplified from product to product.
   subroutine wide_problem_step_in_blocks(self, r, step)
      class(wide_problem_t), intent(inout) :: self
      real(wp), intent(in) :: r(:)
      real(wp), intent(out) :: step(:)
      real(wp) :: clean(self%wide%n_unknowns), retained(size(self%positions) + size(self%which))
      logical :: is_lost

      associate (n => self%wide%n_unknowns, n_retained => size(self%positions))
         clean = r(:n)
         associate (in_units => abs(clean)/self%wide%r_scale)
            where (in_units <= residual_rounding*maxval(in_units)) clean = 0.0_wp
         end associate
         call self%wide%solve_mean_tangent(clean, step(:n))
         retained(:n_retained) = clean(self%positions)
         retained(n_retained + 1:) = r(n + 1:)
         call self%solver%solve(self%narrow, retained, is_lost)
         self%is_lost = self%is_lost .or. is_lost
         step(self%positions) = retained(:n_retained)
         step(n + 1:) = retained(n_retained + 1:)
      end associate
   end subroutine wide_problem_step_in_blocks
end module hb_wide_problem
