!> Derivatives of a few functions of a motion by many numbers of its model: reverse mode.
!> A function J of the motion u, with R(u, p) = 0 and the tangent A = dR/du, has the derivative
!>
!>     dJ/dp = J_p - lambda.R_p,   transpose(A) lambda = J_u,
!>
!> so that one solution with the transposed tangent serves all numbers p. The interior of the structure, x_r = y - T x_l
!> (hb_dynamic_stiffness), follows: with the amplitudes psi = conj(lambda) of all degrees of freedom, which are the motion of
!> the transposed structure under the loads conj(dJ/dx), the contribution of its matrices and loads is
!>
!>     dJ/dp = sum over harmonics of Re(psi.(dP/dp - dS/dp x)).
!>
!> Source: docs/why/theory.md, section 6.8.
module hb_adjoint
   use hb_amplitudes, only: amplitudes_t, new_amplitudes
   use hb_cancellation, only: work_is_over
   use hb_contact_parts, only: contact_parts_t                        ! gfortran 12 cannot write the module without it
   use hb_dynamic_stiffness, only: dynamic_stiffness_t, new_dynamic_stiffness, wanted_slopes_t
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_linear_slopes, only: find_slopes_by, linear_slopes_t
   use hb_model_number, only: has_number, model_number_t
   use hb_model_problem, only: model_problem_t
   use hb_movement, only: movement_t
   use hb_problem, only: problem_t
   use hb_spectrum, only: new_spectrum, spectrum_t
   use hb_structure_builder, only: matrix_slope_t
   use hb_tangent_solver, only: tangent_solver_t
   implicit none
   private
   public :: adjoint_t, function_t, new_adjoint, suits_reverse_mode

   !> A function of a motion, by its differential Re(sum of conj(weights) dx) + dw, w an unknown frequency.
   type :: function_t
      type(amplitudes_t) :: weights                                   !! a - i b, of all degrees of freedom
      integer :: parameter = 0                                        !! index of the unknown frequency among those of the
                                                                      !! bordered problem; 0: none
   end type function_t

   type :: adjoint_t
      real(wp), allocatable :: multipliers(:, :)                      !! lambda at the coordinates of the laws,
                                                                      !! (n_unknowns, functions)
      complex(wp), allocatable, private :: psi(:, :, :)               ! (n_dofs, n_harmonics, functions)
      complex(wp), allocatable, private :: motion(:, :)               ! of all degrees of freedom [m], (n_dofs, n_harmonics)
      real(wp), allocatable, private :: x(:)                          ! coefficients, (n_unknowns)
   contains
      procedure :: find_derivatives => adjoint_find_derivatives
   end type adjoint_t

contains

   !> Whether reverse mode has the derivatives by what moves: numbers of laws, structures and loads. Given frequencies, weights
   !> of coordinates and amplitudes of normal modes are few.
   logical function suits_reverse_mode(problem, movement) result(suits)
      type(model_problem_t), intent(in) :: problem
      type(movement_t), intent(in) :: movement

      suits = .not. (movement%tones .or. movement%coordinates .or. problem%follows_tones()) .and. movement%first == 1
      if (movement%structure .or. movement%loads) suits = suits .and. size(problem%stiffness%free_dofs) == 0
   end function suits_reverse_mode

   !> Solves with the transposed tangent for each function. `is_found` is false if there is no such solution.
   subroutine new_adjoint(self, problem, base, tangent, x, functions, explicit, is_found)
      type(adjoint_t), intent(out) :: self
      class(problem_t), intent(inout) :: problem                      !! `base`, or `base` with unknown parameters
      type(model_problem_t), intent(inout) :: base                    !! at the motion
      type(tangent_solver_t), intent(inout) :: tangent                !! of `problem` at the motion
      real(wp), intent(in) :: x(:)                                    !! its unknowns
      type(function_t), intent(in) :: functions(:)
      real(wp), intent(in) :: explicit(:, :)                          !! derivatives of the functions by the unknown parameters at
                                                                      !! a fixed motion of the coordinates,
                                                                      !! (unknown parameters, functions)
      logical, intent(out) :: is_found
      type(dynamic_stiffness_t) :: transposed
      real(wp), allocatable :: g(:), multipliers(:)
      complex(wp), allocatable :: by_coordinates(:, :)
      integer :: i

      associate (n => base%n_unknowns, n_dofs => base%model%system%structure%n_dofs, set => base%harmonics)
         self%x = x(:n)
         allocate (self%motion(n_dofs, set%n_harmonics), self%psi(n_dofs, set%n_harmonics, size(functions)))
         allocate (self%multipliers(n, size(functions)), by_coordinates(base%n_dofs, set%n_harmonics))
         call base%all_dofs(self%x, self%motion)
         call transpose_structure(base, transposed, is_found)
         if (.not. is_found) return
         do i = 1, size(functions)
            is_found = .not. work_is_over()
            if (.not. is_found) return
            call base%stiffness%map_to_laws(functions(i)%weights%whole(), by_coordinates)
            g = [set%coefficients(by_coordinates), explicit(:, i)]
            if (functions(i)%parameter > 0) g(n + functions(i)%parameter) = g(n + functions(i)%parameter) + 1.0_wp
            call tangent%solve_transposed(problem, g, is_found)
            if (.not. is_found) return
            self%multipliers(:, i) = g(:n)
            call base%transpose_reaction(self%x, g(:n), multipliers)
            by_coordinates = conjg(set%amplitudes(reshape(multipliers, [set%n_coefficients, base%n_dofs])))
            call transposed%recover(by_coordinates, self%psi(:, :, i))
            call add_held_motion(base, functions(i)%weights, self%psi(:, :, i), is_found)
            if (.not. is_found) return
         end do
      end associate
   end subroutine new_adjoint

   !> Condenses the transposed structure without loads.
   subroutine transpose_structure(base, transposed, is_found)
      type(model_problem_t), intent(in) :: base
      type(dynamic_stiffness_t), intent(out) :: transposed
      logical, intent(out) :: is_found
      type(amplitudes_t) :: none
      type(error_t), allocatable :: error
      type(wanted_slopes_t) :: wanted

      call new_amplitudes(none, base%model%system%structure%n_dofs, base%harmonics%n_harmonics)
      wanted%drives = base%drives()
      call new_dynamic_stiffness(transposed, base%model%system%structure%transposed(), base%stiffness%coordinates, &
                                 base%frequencies, none, error, wanted, base%harmonics%tuples)
      is_found = .not. allocated(error)
   end subroutine transpose_structure

   !> Adds the motion of the interior of the transposed structure under the weights, with the coordinates held.
   subroutine add_held_motion(base, weights, psi, is_found)
      type(model_problem_t), intent(in) :: base
      type(amplitudes_t), intent(in) :: weights
      complex(wp), intent(inout) :: psi(:, :)
      logical, intent(out) :: is_found
      type(amplitudes_t) :: loads
      type(dynamic_stiffness_t) :: held
      type(error_t), allocatable :: error
      type(wanted_slopes_t) :: wanted
      complex(wp), allocatable :: at_rest(:, :), motion(:, :)

      is_found = .true.
      if (size(psi, 1) == base%n_dofs) return                         ! there is no interior
      associate (positions => weights%harmonics)
         if (size(positions) == 0) return
         wanted%drives = base%drives()
         wanted%drives = wanted%drives(positions)
         loads = weights%at(positions)
         loads%values = conjg(loads%values)
         call new_dynamic_stiffness(held, base%model%system%structure%transposed(), base%stiffness%coordinates, &
                                    base%frequencies(positions), loads, error, wanted, base%harmonics%tuples(:, positions))
         is_found = .not. allocated(error)
         if (.not. is_found) return
         allocate (at_rest(base%n_dofs, size(positions)), source=(0.0_wp, 0.0_wp))
         allocate (motion(size(psi, 1), size(positions)))
         call held%recover(at_rest, motion)
         psi(:, positions) = psi(:, positions) + motion
      end associate
   end subroutine add_held_motion

   !> Derivatives of all functions by the value of a movement that suits; `is_possible` is false if it cannot move.
   subroutine adjoint_find_derivatives(self, base, movement, value, derivatives, is_possible)
      class(adjoint_t), intent(in) :: self
      type(model_problem_t), intent(inout) :: base                    !! unchanged
      type(movement_t), intent(in) :: movement
      real(wp), intent(in) :: value                                   !! present one
      real(wp), intent(out) :: derivatives(:)                         !! (functions)
      logical, intent(out) :: is_possible
      type(matrix_slope_t) :: slope
      real(wp) :: by_value(size(self%x)), typical
      integer :: attempt
      logical :: is_known

      derivatives = 0.0_wp
      is_possible = .true.
      typical = abs(value)
      if (.not. typical > 0.0_wp) typical = 1.0_wp
      if (movement%laws) then
         do attempt = 1, 2
            by_value = 0.0_wp
            call base%add_law_slopes(movement, value, typical, self%x, by_value, is_possible)
            if (.not. is_possible) return
            if (abs(value) > 0.0_wp .or. .not. norm2(by_value) > 0.0_wp) exit
            typical = 1.0_wp/norm2(by_value/base%r_scale)             ! of a value of zero: the change with a comparable effect
         end do
         derivatives = -matmul(by_value, self%multipliers)
      end if
      if (.not. (movement%structure .or. movement%loads)) return
      is_known = .false.
      if (size(movement%followers) == 1) then
         associate (number => movement%followers(1)%number)
            if (number%is_of_loads()) then
               call add_load(self, base, number, derivatives, is_known)
               if (is_known) return
            end if
            if (number%object == has_number%structure .and. .not. movement%loads) &
               call base%model%system%builder%find_slope(number%number_t, slope, is_known)
         end associate
      end if
      if (is_known) then
         call add_entries(self, base, slope, derivatives)
      else
         call add_differences(self, base, movement, value, derivatives, is_possible)
      end if
   end subroutine adjoint_find_derivatives

   !> Contribution of a number of a load, if its derivative is known.
   subroutine add_load(self, base, number, derivatives, is_known)
      class(adjoint_t), intent(in) :: self
      type(model_problem_t), intent(in) :: base
      type(model_number_t), intent(in) :: number
      real(wp), intent(inout) :: derivatives(:)
      logical, intent(out) :: is_known
      type(amplitudes_t) :: slope
      type(spectrum_t) :: spectrum
      integer :: i, k

      i = base%model%system%load_of(number)
      associate (system => base%model%system)
         call new_spectrum(spectrum, system%structure%n_dofs, system%tones%n_tones)
         call system%loads(i)%load%add_slope_to(number%number_t, system%structure, base%omega, spectrum, is_known)
      end associate
      if (.not. is_known) return
      slope = spectrum%in_set(base%harmonics)
      do i = 1, size(derivatives)
         do k = 1, size(slope%harmonics)
            derivatives(i) = derivatives(i) + real(sum(self%psi(:, slope%harmonics(k), i)*slope%values(:, k)), wp)
         end do
      end do
   end subroutine add_load

   !> Contribution of matrices of which few entries move.
   pure subroutine add_entries(self, base, slope, derivatives)
      class(adjoint_t), intent(in) :: self
      type(model_problem_t), intent(in) :: base
      type(matrix_slope_t), intent(in) :: slope
      real(wp), intent(inout) :: derivatives(:)
      complex(wp) :: s
      real(wp) :: drives(base%harmonics%n_harmonics)
      integer :: e, h, i

      drives = base%drives()
      do e = 1, size(slope%row)
         do h = 1, base%harmonics%n_harmonics
            s = cmplx(slope%stiffness(e), base%frequencies(h)*slope%damping(e), wp) - &
                cmplx(base%frequencies(h)**2, drives(h), wp)*slope%mass(e)
            s = s*self%motion(slope%column(e), h)
            do i = 1, size(derivatives)
               derivatives(i) = derivatives(i) - real(self%psi(slope%row(e), h, i)*s, wp)
            end do
         end do
      end do
   end subroutine add_entries

   !> Contribution of matrices and loads by their differences, which are exact for affine functions.
   subroutine add_differences(self, base, movement, value, derivatives, is_possible)
      class(adjoint_t), intent(in) :: self
      type(model_problem_t), intent(inout) :: base
      type(movement_t), intent(in) :: movement
      real(wp), intent(in) :: value
      real(wp), intent(inout) :: derivatives(:)
      logical, intent(out) :: is_possible
      type(linear_slopes_t) :: slopes
      complex(wp) :: force(size(self%motion, 1))
      real(wp) :: drives(base%harmonics%n_harmonics), part(size(derivatives)), strength, typical
      integer :: attempt, h, i

      drives = base%drives()
      typical = abs(value)
      if (.not. typical > 0.0_wp) typical = 1.0_wp
      do attempt = 1, 2
         call find_slopes_by(base%model, movement, value, typical, slopes)
         is_possible = slopes%is_possible
         if (.not. is_possible) return
         part = 0.0_wp
         strength = 0.0_wp
         do h = 1, base%harmonics%n_harmonics
            force = slopes%loads%of(h)
            if (allocated(slopes%structure)) then
               call slopes%structure%set_tuple(base%harmonics%tuples(:, h))
               force = force - slopes%structure%force_in(self%motion(:, h), base%frequencies(h), drives(h))
            end if
            strength = strength + norm2(abs(force))
            do i = 1, size(derivatives)
               part(i) = part(i) + real(sum(self%psi(:, h, i)*force), wp)
            end do
         end do
         if (abs(value) > 0.0_wp .or. movement%is_affine .or. .not. strength > 0.0_wp) exit
         typical = min(1.0_wp, maxval(base%r_scale)/strength)
      end do
      derivatives = derivatives + part
   end subroutine add_differences
end module hb_adjoint
