!> The motion without the unknown tones, and the modes of small vibration about it, from which unknown tones start.
!>
!> The balance over the tuples without unknown tones is solved first: the equilibrium, or the forced motion. The structure
!> with the mean slopes that the laws have along it then has modes with growth rates. Rigid laws count as open.
!> Source: docs/user/theory.md, section 6.5.
module hb_rest
   use hb_balance, only: balance_t, new_balance
   use hb_coordinates, only: coordinates_t
   use hb_dynamic_stiffness, only: dynamic_stiffness_t, new_dynamic_stiffness
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t, new_harmonics
   use hb_kinds, only: wp
   use hb_law, only: law_box_t
   use hb_law_coordinates, only: laws_at
   use hb_modes, only: modes_t, new_modes
   use hb_outcome, only: outcome
   use hb_solver, only: solve
   use hb_solver_types, only: report_t, solver_config_t
   use hb_structure, only: most_dense, structure_t
   use hb_torus, only: default_samples, new_torus, torus_t
   implicit none
   private
   public :: find_rest, rest_t

   real(wp), parameter :: unmoved = 1.0e-8_wp                         ! motion where laws act relative to the largest of a mode

   type :: rest_t
      real(wp), allocatable :: u(:, :)                                !! [m], (n_coefficients, n_dofs) in the whole set
      logical :: is_forced = .false.                                  !! it moves, other than by its mean
      type(modes_t) :: modes                                          !! shapes at the coordinates of the laws, with
                                                                      !! travelling waves after the modes themselves
      logical, allocatable :: is_at_laws(:)                           !! whether a mode moves where laws act, (n_modes)
      integer :: n_linear = 0                                         !! modes themselves
      type(report_t) :: report                                        !! of the balance without unknown tones
   end type rest_t

contains

   !> Finds the motion and its modes. An error is a singular interior or a structure too large for all its modes.
   subroutine find_rest(self, structure, coordinates, laws, loads, harmonics, torus, omega, is_unknown, config, effort, error)
      type(rest_t), intent(out) :: self
      type(structure_t), intent(in) :: structure
      type(coordinates_t), intent(in) :: coordinates                  !! of the laws
      type(law_box_t), intent(in) :: laws(:)
      complex(wp), intent(in) :: loads(:, :)                          !! cos - i sin [N], (n_dofs, n_harmonics)
      type(harmonics_t), intent(in) :: harmonics                      !! the whole set
      type(torus_t), intent(in) :: torus
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones), > 0, any of unknown tones
      logical, intent(in) :: is_unknown(:)                            !! (n_tones)
      type(solver_config_t), intent(in) :: config
      integer, intent(in) :: effort                                   !! one of hb_fftw%planning
      type(error_t), allocatable, intent(out) :: error
      type(balance_t) :: balance
      type(harmonics_t) :: set

      call make_balance()
      if (.not. allocated(error)) call solve_balance()
      call balance%destroy()

   contains

      subroutine make_balance()
         type(dynamic_stiffness_t) :: stiffness
         type(torus_t) :: grid
         complex(wp), allocatable :: kept_loads(:, :)
         integer, allocatable :: tuples(:, :), kept(:)
         integer :: h, samples(size(omega))

         kept = pack([(h, h=1, harmonics%n_harmonics)], [(all(harmonics%tuples(:, h) == 0 .or. .not. is_unknown), &
                                                          h=1, harmonics%n_harmonics)])
         tuples = harmonics%tuples(:, kept)
         if (.not. harmonics%has_zero) tuples = reshape([spread(0, 1, size(omega)), reshape(tuples, [size(tuples)])], &
                                                             [size(omega), size(kept) + 1])
         call new_harmonics(set, tuples, error)
         if (allocated(error)) return
         samples = default_samples(set, 0)
         where (.not. is_unknown) samples = max(samples, torus%n_samples)
         call new_torus(grid, samples, set, error)
         grid%corrects_kinks = torus%corrects_kinks
         if (allocated(error)) return
         allocate (kept_loads(structure%n_dofs, set%n_harmonics), source=(0.0_wp, 0.0_wp))
         kept_loads(:, set%n_harmonics - size(kept) + 1:) = loads(:, kept)
         call new_dynamic_stiffness(stiffness, structure, coordinates, set%frequencies(omega), kept_loads, error)
         if (.not. allocated(error)) call new_balance(balance, set, grid, omega, stiffness, &
                                                     laws_at(coordinates, laws), effort, error)
      end subroutine make_balance

      subroutine solve_balance()
         real(wp) :: u(set%n_coefficients, coordinates%n), x(set%n_coefficients*coordinates%n), linear(size(x))
         integer :: h, k

         call balance%linear_solution(u)
         linear = reshape(u, [size(u)])
         x = linear
         call solve(balance, config, linear, x, self%report)
         if (self%report%status == outcome%converged) u = reshape(x, shape(u))
         allocate (self%u(harmonics%n_coefficients, coordinates%n), source=0.0_wp)
         do h = 1, set%n_harmonics
            k = harmonics%index_of(set%tuples(:, h))
            if (k == 0) cycle
            self%u(harmonics%cos_at(k), :) = u(set%cos_at(h), :)
            if (set%sin_at(h) == 0) cycle
            self%u(harmonics%sin_at(k), :) = u(set%sin_at(h), :)
            self%is_forced = self%is_forced .or. any(abs(u([set%cos_at(h), set%sin_at(h)], :)) > 0.0_wp)
         end do
         call find_modes(u)
      end subroutine solve_balance

      subroutine find_modes(u)
         real(wp), intent(in) :: u(:, :)
         real(wp) :: df_dq(coordinates%n, coordinates%n), df_dv(coordinates%n, coordinates%n)
         real(wp), allocatable :: damping(:, :), stiffness(:, :)
         complex(wp), allocatable :: at_laws(:, :)

         call structure%refuse_large("the search for unknown frequencies", most_dense, error)
         if (allocated(error)) return
         call balance%mean_slopes(u, df_dq, df_dv, error)
         if (allocated(error)) return
         allocate (damping, source=structure%damping)
         allocate (stiffness, source=structure%stiffness)
         associate (dofs => coordinates%dofs)
            damping(dofs, dofs) = damping(dofs, dofs) + spread_both(df_dv)
            stiffness(dofs, dofs) = stiffness(dofs, dofs) + spread_both(df_dq)
         end associate
         call new_modes(self%modes, structure%mass, damping, stiffness, error)
         if (.not. allocated(error)) call replace_creeping_modes(self%modes, structure%mass, damping, stiffness, error)
         if (allocated(error)) return
         self%n_linear = self%modes%n_modes
         call add_travelling_waves(self%modes, structure%mass)
         at_laws = coordinates%amplitudes_of(self%modes%shapes)
         self%is_at_laws = maxval(abs(at_laws), dim=1) > unmoved*maxval(abs(self%modes%shapes), dim=1)
         call move_alloc(at_laws, self%modes%shapes)
      end subroutine find_modes

      !> Slopes at the degrees of freedom from those at the coordinates.
      pure function spread_both(slopes) result(spread)
         real(wp), intent(in) :: slopes(:, :)
         real(wp) :: spread(size(coordinates%dofs), size(coordinates%dofs))

         spread = transpose(coordinates%spread_forces(transpose(coordinates%spread_forces(slopes))))
      end function spread_both
   end subroutine find_rest

   !> Damping or driving beyond the critical leaves a mode no frequency. Where that happens all modes are those without the
   !> symmetric part of the damping, with the growth that this gives their shapes: an unknown tone with artificial damping
   !> starts from these.
   subroutine replace_creeping_modes(modes, mass, damping, stiffness, error)
      type(modes_t), intent(inout) :: modes
      real(wp), intent(in) :: mass(:, :), damping(:, :), stiffness(:, :)
      type(error_t), allocatable, intent(out) :: error
      type(modes_t) :: without
      integer :: i

      call new_modes(without, mass, 0.5_wp*(damping - transpose(damping)), stiffness, error)
      if (allocated(error) .or. without%n_modes <= modes%n_modes) return
      do i = 1, without%n_modes
         associate (q => without%shapes(:, i))
            without%growth(i) = without%growth(i) - 0.5_wp*real(dot_product(q, matmul(damping, q))/ &
                                                                dot_product(q, matmul(mass, q)))
         end associate
      end do
      modes = without
   end subroutine replace_creeping_modes

   !> Adds both travelling waves of each pair of modes with the same frequency and growth: of shapes that are orthogonal by
   !> the mass and equally heavy, one plus or minus i times the other.
   subroutine add_travelling_waves(modes, mass)
      type(modes_t), intent(inout) :: modes
      real(wp), intent(in) :: mass(:, :)
      real(wp), parameter :: same = 1.0e-6_wp                         ! relative
      complex(wp), parameter :: quarter = (0.0_wp, 1.0_wp)
      complex(wp) :: first(size(mass, 1)), second(size(mass, 1))
      real(wp) :: weight
      integer :: i, n

      n = modes%n_modes
      do i = 1, n - 1
         if (abs(cmplx(modes%growth(i + 1) - modes%growth(i), modes%frequency(i + 1) - modes%frequency(i), wp)) > &
             same*modes%frequency(i)) cycle
         first = modes%shapes(:, i)/modes%shapes(maxloc(abs(modes%shapes(:, i)), dim=1), i)
         second = modes%shapes(:, i + 1)/modes%shapes(maxloc(abs(modes%shapes(:, i + 1)), dim=1), i + 1)
         first = first/sqrt(real(dot_product(first, matmul(mass, first))))
         second = second - dot_product(first, matmul(mass, second))*first
         weight = real(dot_product(second, matmul(mass, second)))
         if (.not. weight > same*real(dot_product(first, first))) cycle
         second = second/sqrt(weight)
         call append(i, first + quarter*second)
         call append(i, first - quarter*second)
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
end module hb_rest
