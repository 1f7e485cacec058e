!> The preconditioner of the balance at its motion, and the mean slopes of the laws along a motion.
!>
!> Source: docs/why/theory.md, section 6.6.
submodule (hb_balance) hb_balance_precondition
   use hb_block_factors, only: new_block_factors
   use hb_block_pattern, only: block_pattern_t, new_block_pattern
   implicit none

contains

   module procedure balance_update_preconditioner
      integer :: i

      if (allocated(self%stiffness%contacts)) then
         is_strongest = .true.                                        ! the equations are those times the compliance
         return
      end if
      call spend_work(self%preconditioner_work*8.0_wp**level)
      associate (n => self%harmonics%n_coefficients)
         call self%preconditioner%update(self%stiffness, self%law_set, self%frequencies, &
                                         [(self%r_scale(1 + (i - 1)*n)/self%x_scale(1 + (i - 1)*n), i=1, self%n_dofs)], &
                                         level, is_strongest)
      end associate
   end procedure balance_update_preconditioner

   module procedure balance_precondition

      if (allocated(self%stiffness%contacts)) then
         call self%solve_mean_tangent(r, step)
         return
      end if
      call spend_work(self%preconditioner%work_of_solution())
      call self%preconditioner%apply(self%harmonics, r, step)
   end procedure balance_precondition

   !> Factorises the tangent at u of each harmonic by itself, (1 - mean df/ds) S + mean df/dq + i w mean df/dv,
   !> without the coupling of harmonics. Those that are left out remain without factors.
   module procedure balance_factorise_mean_tangent
      real(wp), dimension(self%preconditioner%pattern%n_rows, self%n_dofs) :: df_dq, df_dv, df_ds
      complex(wp) :: block(self%preconditioner%pattern%n_rows, self%n_dofs)
      logical :: is_singular, is_wanted(self%harmonics%n_harmonics)
      integer :: h

      is_wanted = .true.
      if (present(without)) is_wanted([(self%harmonics%index_of(without%tuples(:, h)), h=1, without%n_harmonics)]) = .false.
      call self%differentiate(u, error)
      if (allocated(error)) return
      if (allocated(self%stiffness%contacts)) return                  ! stuck contacts take its place, as in `precondition`
      call self%law_set%mean_slopes(self%preconditioner%pattern, df_dq, df_dv, df_ds)
      call new_block_factors(self%mean_factors, self%preconditioner%pattern, self%harmonics%n_harmonics, are_corrected=.true.)
      do h = 1, self%harmonics%n_harmonics
         if (.not. is_wanted(h)) cycle
         call self%preconditioner%harmonic_tangent(self%stiffness, h, self%frequencies(h), df_dq, df_dv, df_ds, block)
         call self%mean_factors%factorise(h, block, is_singular)
      end do
   end procedure balance_factorise_mean_tangent

   !> Solves with these factors; harmonics without factors remain zero.
   module procedure balance_solve_mean_tangent

      if (allocated(self%stiffness%contacts)) then
         step = r/spread(self%stiffness%magnitude(:, 1), 1, size(r, 1))
         return
      end if
      call self%mean_factors%solve_harmonics(self%harmonics, r, step)
   end procedure balance_solve_mean_tangent

   !> Means over the torus of the derivatives of all forces with respect to motion and rate, at a motion. Reactions
   !> are not included.
   module procedure balance_mean_slopes
      type(block_pattern_t) :: all_entries
      real(wp) :: df_ds(self%n_dofs, self%n_dofs)

      call self%sample_if_new(u)
      call self%law_set%differentiate(error)
      if (allocated(error)) return
      call new_block_pattern(all_entries, self%n_dofs, self%n_dofs)
      call self%law_set%mean_slopes(all_entries, df_dq, df_dv, df_ds)
   end procedure balance_mean_slopes
end submodule hb_balance_precondition
