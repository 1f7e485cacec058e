!> The preconditioner of the balance at its motion, and what the mean slopes of the laws along a motion tell.
!>
!> Source: docs/user/theory.md, section 6.6.
submodule (hb_balance) hb_balance_precondition
   use hb_block_factors, only: block_factors_t, new_block_factors
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

   !> Solves with the tangent at u of each harmonic by itself, (1 - mean df/ds) S + mean df/dq + i w mean df/dv: what couples
   !> the harmonics is left out.
   module subroutine balance_solve_mean_tangent(self, u, r, step, error)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)    !! [m]
      real(wp), intent(in) :: r(self%harmonics%n_coefficients, self%n_dofs)    !! [N]
      real(wp), intent(out) :: step(self%harmonics%n_coefficients, self%n_dofs)
      type(error_t), allocatable, intent(out) :: error
      real(wp), dimension(self%n_dofs, self%n_dofs) :: df_dq, df_dv, df_ds

      call self%differentiate(u, error)
      if (allocated(error)) return
      call self%law_set%mean_slopes(df_dq, df_dv, df_ds)
      step = 0.0_wp
      call add_response(self, df_dq, df_dv, df_ds, r, step)
   end subroutine balance_solve_mean_tangent

   !> Answers that each harmonic by itself gives to forces, with the mean slopes of the laws while contacts are closed to what acts
   !> then, and with those while they are open to what acts then: a stop that is touched for a hundredth of the time does not hold
   !> back what moves freely for the rest, however stiff it is. Where no contact comes and goes this is `solve_mean_tangent`.
   module subroutine balance_mean_response(self, u, r, step, error)
      class(balance_t), intent(inout) :: self
      real(wp), intent(in) :: u(self%harmonics%n_coefficients, self%n_dofs)    !! [m]
      real(wp), intent(in) :: r(self%harmonics%n_coefficients, self%n_dofs)    !! [N]
      real(wp), intent(out) :: step(self%harmonics%n_coefficients, self%n_dofs)
      type(error_t), allocatable, intent(out) :: error
      real(wp), dimension(self%n_dofs, self%n_dofs, 2) :: df_dq, df_dv, df_ds  ! open, closed
      real(wp) :: held_forces(size(r, 1), size(r, 2))
      logical, allocatable :: is_held(:)
      integer :: i

      call self%differentiate(u, error)
      if (allocated(error)) return
      is_held = self%law_set%held()
      step = 0.0_wp
      if (.not. any(is_held)) then
         call self%law_set%mean_slopes(df_dq(:, :, 1), df_dv(:, :, 1), df_ds(:, :, 1))
         call add_response(self, df_dq(:, :, 1), df_dv(:, :, 1), df_ds(:, :, 1), r, step)
         return
      end if
      call self%law_set%mean_slopes(df_dq(:, :, 1), df_dv(:, :, 1), df_ds(:, :, 1), .not. is_held)
      call self%law_set%mean_slopes(df_dq(:, :, 2), df_dv(:, :, 2), df_ds(:, :, 2), is_held)
      self%has_samples = .false.
      associate (forces => self%law_set%samples%q%values)             ! the motion has told its slopes
         call self%law_set%transform%to_samples(r, forces)
         do i = 1, self%n_dofs
            where (.not. is_held) forces(:, i) = 0.0_wp
         end do
         call self%project(forces, held_forces)
      end associate
      call add_response(self, df_dq(:, :, 1), df_dv(:, :, 1), df_ds(:, :, 1), r - held_forces, step)
      call add_response(self, df_dq(:, :, 2), df_dv(:, :, 2), df_ds(:, :, 2), held_forces, step)
   end subroutine balance_mean_response

   !> Adds the answers of all harmonics to forces, with slopes of the laws that are the same at all times.
   subroutine add_response(self, df_dq, df_dv, df_ds, r, step)
      type(balance_t), intent(in) :: self
      real(wp), intent(in) :: df_dq(:, :), df_dv(:, :), df_ds(:, :)   !! (n_dofs, n_dofs)
      real(wp), intent(in) :: r(:, :)                                 !! [N], (n_coefficients, n_dofs)
      real(wp), intent(inout) :: step(:, :)                           !! [m], as r
      complex(wp) :: block(self%preconditioner%pattern%n_rows, self%n_dofs), c(self%n_dofs)
      type(block_factors_t) :: factors
      logical :: is_singular
      integer :: h, i

      call new_block_factors(factors, self%preconditioner%pattern, 1)
      do h = 1, self%harmonics%n_harmonics
         call self%preconditioner%harmonic_tangent(self%stiffness, h, self%frequencies(h), df_dq, df_dv, df_ds, block)
         call factors%factorise(1, block, is_singular)
         if (is_singular) cycle
         do i = 1, self%n_dofs
            c(i) = self%harmonics%amplitude(r(:, i), h)
         end do
         call factors%solve(1, c)
         do i = 1, self%n_dofs
            call self%harmonics%set_amplitude(step(:, i), h, self%harmonics%amplitude(step(:, i), h) + c(i))
         end do
      end do
   end subroutine add_response

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
