!> Products with the tangent of the balance with unknown base frequencies, and their preconditioner, by block elimination:
!>
!>     (A B; C D) (x; y) = (r; s),   x = A^-1 r - A^-1 B y,   (D - C A^-1 B) y = s - C A^-1 r.
!>
!> A is the tangent of the balance, or its preconditioner; B the derivatives by the further unknowns; C and D the forms.
!> Source: docs/user/theory.md, section 6.6.
submodule (hb_phase) hb_phase_products
   use hb_lapack, only: dgetrf, dgetrs
   implicit none

   real(wp), parameter :: added_damping = 1.0e-6_wp                   ! of the preconditioner, relative to the frequencies

contains

   module subroutine phase_problem_linearise(self, x, is_ready)
      class(phase_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      logical, intent(out) :: is_ready

      call self%move_to(x, is_ready)
      if (.not. is_ready) return
      call self%find_border(x, self%border)
      call self%find_energy_form(x)
      call self%balance%linearise(x(:self%n_u), is_ready)
   end subroutine phase_problem_linearise

   module subroutine phase_problem_apply_tangent(self, x, product)
      class(phase_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: x(:)
      real(wp), intent(out), contiguous :: product(:)

      associate (n => self%n_u)
         call self%balance%apply_tangent(x(:n), product(:n))
         product(:n) = product(:n) + matmul(self%border, x(n + 1:))
         product(n + 1:) = matmul(x(:size(self%forms, 1)), self%forms)
         if (.not. allocated(self%is_held)) return
         where (self%is_held) product(:n) = x(:n)*self%r_scale(:n)/self%x_scale(:n)
      end associate
   end subroutine phase_problem_apply_tangent

   !> The preconditioner of the balance is made with a trace of damping: at a solution its tangent is singular along the
   !> shift of an unknown phase, which the forms alone exclude.
   module subroutine phase_problem_update_preconditioner(self, level, is_strongest)
      class(phase_problem_t), intent(inout) :: self
      integer, intent(in) :: level
      logical, intent(out) :: is_strongest
      type(error_t), allocatable :: error
      real(wp) :: xi(size(self%balance%xi))
      integer :: i, info, k

      k = self%n_unknowns - self%n_u
      xi = self%balance%xi
      xi(self%tones) = xi(self%tones) + added_damping*self%balance%omega(self%tones)
      call exchange_damping(xi)
      call self%balance%update_preconditioner(level, is_strongest)
      call exchange_damping(xi)
      self%eliminated = self%border
      do i = 1, k
         call solve_block(self, self%border(:, i), self%eliminated(:, i))
      end do
      associate (n => self%n_u)
         self%schur = -matmul(transpose(self%forms(:n, :)), self%eliminated)
         if (size(self%forms, 1) > n) self%schur = self%schur + transpose(self%forms(n + 1:, :))
      end associate
      self%schur_pivots = [(i, i=1, k)]
      call dgetrf(k, k, self%schur, k, self%schur_pivots, info)
      self%has_schur = info == 0

   contains

      !> Moves the balance to another damping, and returns the one it had.
      subroutine exchange_damping(other)
         real(wp), intent(inout) :: other(:)
         real(wp) :: before(size(other)), omega(size(other))

         before = self%balance%xi
         omega = self%balance%omega
         call self%balance%move(omega, other, error)
         other = before
      end subroutine exchange_damping
   end subroutine phase_problem_update_preconditioner

   module subroutine phase_problem_precondition(self, r, step)
      class(phase_problem_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: r(:)
      real(wp), intent(out), contiguous :: step(:)
      integer :: info, k

      k = self%n_unknowns - self%n_u
      associate (n => self%n_u)
         call solve_block(self, r(:n), step(:n))
         step(n + 1:) = r(n + 1:) - matmul(step(:n), self%forms(:n, :))
         if (self%has_schur) then
            call dgetrs("N", k, 1, self%schur, k, self%schur_pivots, step(n + 1:), k, info)
            step(:n) = step(:n) - matmul(self%eliminated, step(n + 1:))
         else
            step(n + 1:) = r(n + 1:)*self%x_scale(n + 1:)/self%r_scale(n + 1:)
         end if
      end associate
   end subroutine phase_problem_precondition

   !> The preconditioner of the balance, held coefficients apart.
   subroutine solve_block(self, r, step)
      class(phase_problem_t), intent(inout) :: self
      real(wp), intent(in) :: r(:)
      real(wp), intent(out), contiguous :: step(:)
      real(wp) :: free(self%n_u)

      free = r
      if (allocated(self%is_held)) then
         where (self%is_held) free = 0.0_wp
      end if
      call self%balance%precondition(free, step)
      if (.not. allocated(self%is_held)) return
      where (self%is_held) step = r*self%x_scale(:self%n_u)/self%r_scale(:self%n_u)
   end subroutine solve_block
end submodule hb_phase_products
