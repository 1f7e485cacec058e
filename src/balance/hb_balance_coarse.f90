!> Sequence of orders: the balance with half the orders is solved first, and recursively that with half of these
!> before it.
!>
!> Changes of contact between the linear motion and the solution are resolved on the lowest level, where steps are cheap; each
!> further level takes a few steps from the one below it.
!> Source: docs/why/theory.md, section 6.4.
submodule (hb_balance) hb_balance_coarse
   use hb_harmonics, only: new_harmonics
   use hb_outcome, only: outcome
   use hb_solver, only: solve
   use hb_thresholds, only: negligible_share, rounding_level
   use hb_torus, only: fast_size, new_torus
   implicit none

   integer, parameter :: lowest_order = 3                             ! of the coarsest set, in the tone of highest order

contains

   module procedure balance_coarse_guess
      type(balance_t) :: coarse
      type(solver_config_t) :: loose
      integer, allocatable :: retained(:), positions(:)
      real(wp), allocatable :: linear_solution(:, :), y(:)
      type(error_t), allocatable :: error

      is_found = .false.
      retained = level_of(self, share)
      if (size(retained) == 0) return
      call make_coarse(self, retained, coarse, error)
      if (.not. allocated(error)) then
         allocate (linear_solution(coarse%harmonics%n_coefficients, coarse%n_dofs))
         positions = [self%harmonics%indices_of(coarse%harmonics, self%n_dofs)]
         y = x(positions)
         call coarse%linear_solution(linear_solution)
         loose = config
         loose%tolerance = max(negligible_share, config%tolerance)      ! the omitted harmonics have a larger effect
         call solve(coarse, loose, reshape(linear_solution, [size(y)]), y, report)
         is_found = report%status == outcome%converged
         if (is_found) x(positions) = y
      end if
      call coarse%destroy()
   end procedure balance_coarse_guess

   !> The fraction of the orders with the lowest order in the tone of highest order, and all harmonics that drive the
   !> motion.
   module procedure balance_lowest_level
      integer :: h

      share = 1.0_wp
      associate (set => self%harmonics)
         if (maxval(set%highest) <= lowest_order) return
         share = real(lowest_order, wp)/maxval(set%highest)
         do h = 1, set%n_harmonics
            if (maxval(abs(self%stiffness%load(:, h))) > 0.0_wp) &
               share = max(share, maxval(real(abs(set%tuples(:, h)), wp)/max(1, set%highest)))
         end do
      end associate
   end procedure balance_lowest_level

   !> Harmonics of a smaller set, with a fraction of the orders; none if it is not smaller.
   pure function level_of(self, share) result(retained)
      class(balance_t), intent(in) :: self
      real(wp), intent(in) :: share
      integer, allocatable :: retained(:)
      integer :: h

      associate (set => self%harmonics)
         retained = pack([(h, h=1, set%n_harmonics)], &
                         [(all(abs(set%tuples(:, h)) <= ceiling((share - rounding_level)*set%highest)), h=1, set%n_harmonics)])
         if (size(retained) == set%n_harmonics) retained = retained(:0)
      end associate
   end function level_of

   !> Creates the balance of the harmonics `retained`, on a grid with the same oversampling as the whole one.
   subroutine make_coarse(self, retained, coarse, error)
      type(balance_t), intent(in) :: self
      integer, intent(in) :: retained(:)
      type(balance_t), intent(inout) :: coarse
      type(error_t), allocatable, intent(out) :: error
      type(dynamic_stiffness_t) :: stiffness
      type(harmonics_t) :: set
      type(torus_t) :: torus
      integer :: m

      call new_harmonics(set, self%harmonics%tuples(:, retained), error)
      if (allocated(error)) return
      associate (fine => self%law_set%transform%torus%n_samples, highest => self%harmonics%highest)
         call new_torus(torus, [(fast_size(ceiling(real(fine(m), wp)*(2*set%highest(m) + 1)/(2*highest(m) + 1))), &
                                 m=1, set%n_tones)], set, error)
      end associate
      if (allocated(error)) return
      torus%corrects_kinks = self%law_set%transform%torus%corrects_kinks
      if (self%law_set%transform%torus%is_half .and. torus%can_be_halved()) torus = torus%half()
      stiffness = self%stiffness%restricted_to(retained)
      call new_balance(coarse, set, torus, self%omega, stiffness, self%law_set%laws, error)
   end subroutine make_coarse
end submodule hb_balance_coarse
