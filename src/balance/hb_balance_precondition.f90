!> The preconditioner of the balance at its motion, and the mean slopes of the laws along a motion.
!>
!> Source: docs/why/theory.md, section 6.6.
submodule (hb_balance) hb_balance_precondition
   use hb_block_factors, only: new_block_factors
   implicit none

contains

   module subroutine balance_update_preconditioner(self, level, is_strongest)
      class(balance_t), intent(inout) :: self
      integer, intent(in) :: level
      logical, intent(out) :: is_strongest
      integer :: i

      associate (n => self%harmonics%n_coefficients)
         call self%preconditioner%update(self%stiffness, self%law_set, self%frequencies, &
                                         [(self%r_scale(1 + (i - 1)*n)/self%x_scale(1 + (i - 1)*n), i=1, self%n_dofs)], &
                                         level, is_strongest)
      end associate
   end subroutine balance_update_preconditioner

   module subroutine balance_precondition(self, r, step)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: r(:)
      real(wp), intent(out), contiguous :: step(:)

      call self%preconditioner%apply(self%harmonics, r, step)
   end subroutine balance_precondition

   !> Factorises the tangent at u of each harmonic by itself, (1 - mean df/ds) S + mean df/dq + i w mean df/dv: what couples the
   !> harmonics is left out.
   module subroutine balance_factorise_mean_tangent(self, u, error)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)    !! [m]
      type(error_t), allocatable, intent(out) :: error
      real(wp), dimension(self%n_dofs, self%n_dofs) :: df_dq, df_dv, df_ds
      complex(wp) :: block(self%preconditioner%pattern%n_rows, self%n_dofs)
      logical :: is_singular
      integer :: h

      call self%differentiate(u, error)
      if (allocated(error)) return
      call self%law_set%mean_slopes(df_dq, df_dv, df_ds)
      call new_block_factors(self%mean_factors, self%preconditioner%pattern, self%harmonics%n_harmonics)
      self%has_mean_factors = [(.true., h=1, self%harmonics%n_harmonics)]
      do h = 1, self%harmonics%n_harmonics
         call self%preconditioner%harmonic_tangent(self%stiffness, h, self%frequencies(h), df_dq, df_dv, df_ds, block)
         call self%mean_factors%factorise(h, block, is_singular)
         self%has_mean_factors(h) = .not. is_singular
      end do
   end subroutine balance_factorise_mean_tangent

   !> Solves with these factors; harmonics without any stay zero.
   module subroutine balance_solve_mean_tangent(self, r, step)
      class(balance_t), intent(in) :: self
      real(wp), intent(in) :: r(self%harmonics%n_coefficients, self%n_dofs)    !! [N]
      real(wp), intent(out) :: step(self%harmonics%n_coefficients, self%n_dofs)
      complex(wp) :: c(self%n_dofs)
      integer :: h, i

      step = 0.0_wp
      do h = 1, self%harmonics%n_harmonics
         if (.not. self%has_mean_factors(h)) cycle
         do i = 1, self%n_dofs
            c(i) = self%harmonics%amplitude(r(:, i), h)
         end do
         call self%mean_factors%solve(h, c)
         do i = 1, self%n_dofs
            call self%harmonics%set_amplitude(step(:, i), h, c(i))
         end do
      end do
   end subroutine balance_solve_mean_tangent

   !> Means over the torus of the derivatives of all forces by motion and rate, at a motion. Reactions are left out.
   module subroutine balance_mean_slopes(self, u, df_dq, df_dv, error)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)
      real(wp), intent(out) :: df_dq(:, :)
      real(wp), intent(out) :: df_dv(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: df_ds(self%n_dofs, self%n_dofs)

      call self%sample_if_new(u)
      call self%law_set%differentiate(error)
      if (.not. allocated(error)) call self%law_set%mean_slopes(df_dq, df_dv, df_ds)
   end subroutine balance_mean_slopes
end submodule hb_balance_precondition
