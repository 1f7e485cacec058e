!> A first guess from fewer harmonics: the balance of half the orders is solved first, and that of half of these before it.
!>
!> Contact that comes and goes on the way from the linear motion is settled where a step costs next to nothing.
!> Source: docs/user/theory.md, section 6.4.
submodule (hb_balance) hb_balance_coarse
   use hb_harmonics, only: new_harmonics
   use hb_krylov, only: solve_krylov
   use hb_newton, only: solve_newton
   use hb_outcome, only: outcome
   use hb_torus, only: fast_size, new_torus
   implicit none

   integer, parameter :: lowest_order = 2                             ! of the coarsest set, in the tone of highest order
   real(wp), parameter :: coarse_tolerance = 1.0e-3_wp                ! what the harmonics left out change is more than that
   integer, parameter :: most_iterations = 30

contains

   recursive module subroutine balance_coarse_guess(self, config, x, report, is_found)
      class(balance_t), intent(inout) :: self
      type(solver_config_t), intent(in) :: config
      real(wp), intent(inout), contiguous :: x(:)
      type(report_t), intent(out) :: report
      logical, intent(out) :: is_found
      type(balance_t) :: coarse
      type(report_t) :: attempt
      type(solver_config_t) :: loose
      integer, allocatable :: kept(:)
      logical, allocatable :: is_kept(:)
      real(wp), allocatable :: y(:)
      type(error_t), allocatable :: error
      integer :: h

      is_found = .false.
      associate (set => self%harmonics)
         if (maxval(set%highest) < 2*lowest_order) return
         is_kept = [(all(abs(set%tuples(:, h)) <= (set%highest + 1)/2), h=1, set%n_harmonics)]
         kept = pack([(h, h=1, set%n_harmonics)], is_kept)
         if (size(kept) == 0 .or. size(kept) == set%n_harmonics) return
         do h = 1, set%n_harmonics
            if (.not. is_kept(h) .and. maxval(abs(self%stiffness%load(:, h))) > 0.0_wp) return   ! part of what drives the motion
         end do
      end associate
      call make_coarse(self, kept, coarse, error)
      if (.not. allocated(error)) then
         allocate (y(coarse%n_unknowns))
         call copy_kept(self, coarse, kept, x, y, to_coarse=.true.)
         call coarse%coarse_guess(config, y, report, is_found)
         loose = config
         loose%tolerance = max(coarse_tolerance, config%tolerance)
         loose%max_iterations = min(most_iterations, config%max_iterations)
         if (coarse%n_unknowns > coarse%largest_dense) then
            call solve_krylov(coarse, loose, y, attempt)
         else
            call solve_newton(coarse, loose, y, attempt)
         end if
         call report%add(attempt)
         is_found = attempt%status == outcome%converged
         if (is_found) call copy_kept(self, coarse, kept, x, y, to_coarse=.false.)
      end if
      call coarse%destroy()
   end subroutine balance_coarse_guess

   !> The balance of the harmonics `kept`, on a grid that is finer than they need by as much as the whole one is.
   subroutine make_coarse(self, kept, coarse, error)
      type(balance_t), intent(in) :: self
      integer, intent(in) :: kept(:)
      type(balance_t), intent(inout) :: coarse
      type(error_t), allocatable, intent(out) :: error
      type(harmonics_t) :: set
      type(torus_t) :: torus
      integer :: m

      call new_harmonics(set, self%harmonics%tuples(:, kept), error)
      if (allocated(error)) return
      associate (fine => self%transform%torus%n_samples, highest => self%harmonics%highest)
         call new_torus(torus, [(fast_size(ceiling(real(fine(m), wp)*(2*set%highest(m) + 1)/(2*highest(m) + 1))), &
                                 m=1, set%n_tones)], set, error)
      end associate
      if (allocated(error)) return
      call new_balance(coarse, set, torus, self%omega, self%stiffness%restricted_to(kept), self%law_set%laws, self%effort, error)
      coarse%watch => self%watch
   end subroutine make_coarse

   !> Copies the coefficients of the kept harmonics from the fine set to the coarse one, or back; others stay.
   subroutine copy_kept(self, coarse, kept, fine_x, coarse_x, to_coarse)
      type(balance_t), intent(in) :: self, coarse
      integer, intent(in) :: kept(:)
      real(wp), intent(inout) :: fine_x(self%harmonics%n_coefficients, self%n_dofs)
      real(wp), intent(inout) :: coarse_x(coarse%harmonics%n_coefficients, self%n_dofs)
      logical, intent(in) :: to_coarse
      integer :: h

      do h = 1, size(kept)
         call copy(self%harmonics%cos_at(kept(h)), coarse%harmonics%cos_at(h))
         call copy(self%harmonics%sin_at(kept(h)), coarse%harmonics%sin_at(h))
      end do

   contains

      subroutine copy(at_fine, at_coarse)
         integer, intent(in) :: at_fine, at_coarse

         if (at_fine == 0) return                                     ! the zero tuple has no sine
         if (to_coarse) then
            coarse_x(at_coarse, :) = fine_x(at_fine, :)
         else
            fine_x(at_fine, :) = coarse_x(at_coarse, :)
         end if
      end subroutine copy
   end subroutine copy_kept
end submodule hb_balance_coarse
