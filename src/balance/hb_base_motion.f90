!> The motion without the unknown tones, and the modes of small vibration about it, from which unknown tones start.
!> The balance over the tuples without unknown tones is solved first: the equilibrium, or the forced motion. The
!> structure with the mean slopes of the laws along it then has modes with growth rates. Rigid laws count as open.
!> Source: docs/why/theory.md, section 6.5.
module hb_base_motion
   use hb_balance, only: balance_t
   use hb_error, only: error_t
   use hb_harmonics, only: coefficients_in, harmonics_t
   use hb_kinds, only: wp
   use hb_modes, only: modes_t, new_modes
   use hb_outcome, only: outcome
   use hb_part_modes, only: follow_parts
   use hb_solver, only: solve
   use hb_solver_types, only: report_t, solver_config_t
   use hb_structure, only: max_dense, structure_t
   use hb_thresholds, only: equality_tolerance, rounding_level
   implicit none
   private
   public :: base_motion_t, find_base_motion

   type :: base_motion_t
      real(wp), allocatable :: u(:, :)                                !! [m], (n_coefficients, n_dofs) in the whole set
      logical :: is_forced = .false.                                  !! it has harmonics other than the mean
      type(modes_t) :: modes                                          !! shapes at the coordinates of the laws, with
                                                                      !! travelling waves after the modes themselves
      logical, allocatable :: is_at_laws(:)                           !! whether a mode has a displacement at the laws, (n_modes)
      integer :: n_linear = 0                                         !! modes themselves
      logical :: is_undamped = .false.                                !! frequencies of the modes are those without damping
      type(report_t) :: report                                        !! of the balance without unknown tones
   end type base_motion_t

contains

   !> Finds the motion and its modes. Fails for a structure too large for all its modes, or laws without derivatives.
   subroutine find_base_motion(self, structure, balance, harmonics, config, error)
      type(base_motion_t), intent(out) :: self
      type(structure_t), intent(in) :: structure
      type(balance_t), intent(inout) :: balance                       !! over the tuples without unknown tones and the zero tuple
      type(harmonics_t), intent(in) :: harmonics                      !! the whole set
      type(solver_config_t), intent(in) :: config
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: u(balance%harmonics%n_coefficients, balance%n_dofs), x(size(u)), linear(size(u))

      call balance%linear_solution(u)
      linear = reshape(u, [size(u)])
      x = linear
      call solve(balance, config, linear, x, self%report)
      if (self%report%status == outcome%converged) u = reshape(x, shape(u))
      allocate (self%u, source=coefficients_in(harmonics, balance%harmonics, u))
      self%is_forced = any(abs(u(2:, :)) > 0.0_wp)                    ! the zero tuple is the first one
      call find_modes()

   contains

      subroutine find_modes()
         real(wp), dimension(balance%n_dofs, balance%n_dofs) :: df_dq, df_dv
         real(wp), allocatable :: damping(:, :), stiffness(:, :)
         complex(wp), allocatable :: at_laws(:, :)

         call structure%check_matrices("the search for unknown frequencies", max_dense, error, has_parts=.true.)
         if (allocated(error)) return
         call balance%mean_slopes(u, df_dq, df_dv, error)
         if (allocated(error)) return
         allocate (damping, source=structure%damping)
         allocate (stiffness, source=structure%stiffness)
         associate (dofs => balance%stiffness%coordinates%dofs)
            damping(dofs, dofs) = damping(dofs, dofs) + spread_both(df_dv)
            stiffness(dofs, dofs) = stiffness(dofs, dofs) + spread_both(df_dq)
         end associate
         call new_modes(self%modes, structure%mass, damping, stiffness, error)
         if (.not. allocated(error)) call replace_creeping_modes(self%modes, structure%mass, damping, stiffness, &
                                                                 self%is_undamped, error)
         if (allocated(error)) return
         if (allocated(structure%parts)) call follow_parts(self%modes, structure%parts, structure%mass, damping, stiffness)
         self%n_linear = self%modes%n_modes
         call add_travelling_waves(self%modes, structure%mass)
         allocate (at_laws, source=balance%stiffness%coordinates%amplitudes_of(self%modes%shapes))
         self%is_at_laws = maxval(abs(at_laws), dim=1) > rounding_level*maxval(abs(self%modes%shapes), dim=1)
         call move_alloc(at_laws, self%modes%shapes)
      end subroutine find_modes

      !> Slopes at the degrees of freedom from those at the coordinates.
      function spread_both(slopes) result(spread)
         real(wp), intent(in) :: slopes(:, :)
         real(wp), allocatable :: spread(:, :)

         associate (coordinates => balance%stiffness%coordinates)
            spread = transpose(coordinates%spread_forces(transpose(coordinates%spread_forces(slopes))))
         end associate
      end function spread_both
   end subroutine find_base_motion

   !> A mode with damping or driving beyond critical has no frequency. In that case all modes are those without the
   !> symmetric part of the damping, with the growth rates of their shapes: an unknown tone with artificial damping
   !> starts from these.
   subroutine replace_creeping_modes(modes, mass, damping, stiffness, is_replaced, error)
      type(modes_t), intent(inout) :: modes
      real(wp), intent(in) :: mass(:, :), damping(:, :), stiffness(:, :)
      logical, intent(out) :: is_replaced
      type(error_t), allocatable, intent(out) :: error
      type(modes_t) :: without
      integer :: i

      is_replaced = .false.
      if (modes%n_modes == size(mass, 1)) return                      ! all have one
      if (.not. any(abs(mass) > 0.0_wp)) return                       ! without damping nothing moves
      call new_modes(without, mass, 0.5_wp*(damping - transpose(damping)), stiffness, error)
      is_replaced = .not. allocated(error) .and. without%n_modes > modes%n_modes
      if (.not. is_replaced) return
      do i = 1, without%n_modes
         associate (q => without%shapes(:, i))
            without%growth(i) = without%growth(i) - 0.5_wp*real(dot_product(q, matmul(damping, q))/ &
                                                                dot_product(q, matmul(mass, q)))
         end associate
      end do
      modes = without
   end subroutine replace_creeping_modes

   !> Adds both travelling waves of each pair of modes with the same frequency and growth rate: for shapes that are
   !> mass-orthogonal with equal modal masses, one plus or minus i times the other.
   subroutine add_travelling_waves(modes, mass)
      type(modes_t), intent(inout) :: modes
      real(wp), intent(in) :: mass(:, :)
      complex(wp) :: first(size(mass, 1)), second(size(mass, 1))
      real(wp) :: weight
      integer :: i, n

      n = modes%n_modes
      if (.not. any(abs(mass) > 0.0_wp)) return
      do i = 1, n - 1
         if (abs(cmplx(modes%growth(i + 1) - modes%growth(i), modes%frequency(i + 1) - modes%frequency(i), wp)) > &
             equality_tolerance*modes%frequency(i)) cycle
         first = modes%shapes(:, i)/modes%shapes(maxloc(abs(modes%shapes(:, i)), dim=1), i)
         second = modes%shapes(:, i + 1)/modes%shapes(maxloc(abs(modes%shapes(:, i + 1)), dim=1), i + 1)
         first = first/sqrt(real(dot_product(first, matmul(mass, first))))
         second = second - dot_product(first, matmul(mass, second))*first
         weight = real(dot_product(second, matmul(mass, second)))
         if (.not. weight > equality_tolerance*real(dot_product(first, first))) cycle
         second = second/sqrt(weight)
         call append(i, first + (0.0_wp, 1.0_wp)*second)
         call append(i, first - (0.0_wp, 1.0_wp)*second)
      end do

   contains

      subroutine append(like, wave)
         integer, intent(in) :: like
         complex(wp), intent(in) :: wave(:)

         modes%shapes = reshape([reshape(modes%shapes, [size(modes%shapes)]), wave], [size(wave), modes%n_modes + 1])
         modes%growth = [modes%growth, modes%growth(like)]
         modes%frequency = [modes%frequency, modes%frequency(like)]
         modes%response = [modes%response, modes%response(like)]
         modes%n_modes = modes%n_modes + 1
      end subroutine append
   end subroutine add_travelling_waves
end module hb_base_motion
