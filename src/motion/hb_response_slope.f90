!> Derivative of the amplitudes of a degree of freedom along a direction of a curve of motions.
!> It is exact where the moving value is a frequency, the amplitude or the energy of a normal mode. Otherwise the change
!> of structure, loads and frequencies is a central difference, as in the derivative of the residual (hb_model_problem),
!> which is taken before condensation. Source: docs/why/theory.md, section 6.7.
module hb_response_slope
   use hb_amplitudes, only: amplitudes_t, new_amplitudes
   use hb_coordinates, only: coordinates_t
   use hb_kinds, only: wp
   use hb_model_problem, only: model_problem_t
   use hb_motion_slope, only: find_motion_slope, moving_parameters_t
   use hb_structure, only: structure_t
   use hb_thresholds, only: difference_step
   implicit none
   private
   public :: find_series_slope

   !> The problem slightly beside a point, in the direction.
   type :: side_t
      real(wp) :: position = 0.0_wp                                   ! along the direction
      type(structure_t) :: structure
      type(amplitudes_t) :: loads
      real(wp), allocatable :: frequencies(:), drives(:)              ! (n_harmonics)
      complex(wp), allocatable :: series(:)                           ! (n_harmonics); only if the coordinates move
   end type side_t

contains

   !> Finds the derivatives of some harmonics of a degree of freedom, at a point of a curve to which the problem has
   !> moved. Not allocated if the structure is singular there, or if the value cannot move.
   subroutine find_series_slope(problem, dof, x, direction, harmonics, slope)
      type(model_problem_t), intent(inout) :: problem                 !! unchanged on return
      integer, intent(in) :: dof                                      !! of the structure
      real(wp), intent(in) :: x(:), direction(:)                      !! unknowns, then the parameters `which`
      integer, intent(in) :: harmonics(:)                             !! numbers of the requested ones
      complex(wp), allocatable, intent(out) :: slope(:)               !! (size(harmonics))
      type(coordinates_t) :: coordinates
      type(moving_parameters_t) :: moving
      type(side_t) :: sides(2)
      complex(wp), allocatable :: all_slopes(:, :)
      logical :: is_possible, is_singular

      coordinates = problem%stiffness%coordinates
      moving%frequencies = problem%frequencies
      moving%drives = problem%drives()
      moving%loads = problem%model%loads
      if (moves_frequencies_alone(problem)) then
         call add_frequency_slopes(problem, direction, moving)
      else
         call find_sides(problem, dof, x, direction, coordinates, sides, is_possible)
         if (.not. is_possible) return
         if (allocated(sides(1)%series) .and. allocated(sides(2)%series)) then
            slope = (sides(1)%series(harmonics) - sides(2)%series(harmonics))/(sides(1)%position - sides(2)%position)
            return
         end if
         call add_differences(sides, moving)
      end if
      allocate (all_slopes(problem%model%structure%n_dofs, size(harmonics)))
      call find_motion_slope(problem%model%structure, coordinates, moving, harmonics, motion_in(problem, x), &
                             motion_in(problem, direction), all_slopes, is_singular)
      if (.not. is_singular) slope = all_slopes(dof, :)
   end subroutine find_series_slope

   !> Whether structure and loads are constant along the curve.
   logical function moves_frequencies_alone(problem) result(moves)
      type(model_problem_t), intent(in) :: problem

      moves = problem%moves_frequency
      if (problem%moves_mode) moves = .not. problem%follows_tones()
   end function moves_frequencies_alone

   !> Amplitudes of the coordinates of a vector along the curve, (n_coordinates, n_harmonics).
   function motion_in(problem, x) result(motion)
      type(model_problem_t), intent(in) :: problem
      real(wp), intent(in) :: x(:)
      complex(wp) :: motion(problem%n_dofs, problem%harmonics%n_harmonics)

      motion = problem%harmonics%amplitudes(reshape(x(:problem%n_unknowns), [problem%harmonics%n_coefficients, problem%n_dofs]))
   end function motion_in

   !> Adds the derivatives of frequencies, drives = j.(xi omega), along the direction.
   subroutine add_frequency_slopes(problem, direction, moving)
      type(model_problem_t), intent(in) :: problem
      real(wp), intent(in) :: direction(:)
      type(moving_parameters_t), intent(inout) :: moving
      real(wp), dimension(size(problem%omega)) :: omega_slope, xi_slope
      integer :: i

      omega_slope = problem%omega_slopes*direction(size(direction))
      xi_slope = 0.0_wp
      associate (n => size(problem%omega), further => direction(problem%n_unknowns + 1:))
         do i = 1, size(problem%which) - 1
            if (problem%which(i) <= n) omega_slope(problem%which(i)) = further(i)
            if (problem%which(i) > n) xi_slope(problem%which(i) - n) = further(i)
         end do
      end associate
      moving%frequency_slopes = problem%harmonics%frequencies(omega_slope)
      moving%drive_slopes = problem%harmonics%frequencies(xi_slope*problem%omega + problem%xi*omega_slope)
   end subroutine add_frequency_slopes

   !> Evaluates the problem on both sides of a point; at the end of the range of the value on one side and at the point.
   subroutine find_sides(problem, dof, x, direction, coordinates, sides, is_possible)
      type(model_problem_t), intent(inout) :: problem                 ! at the point, as on return
      integer, intent(in) :: dof
      real(wp), intent(in) :: x(:), direction(:)
      type(coordinates_t), intent(in) :: coordinates                  ! at the point
      type(side_t), intent(out) :: sides(2)
      logical, intent(out) :: is_possible
      logical :: is_found(2)
      integer :: i

      do i = 1, 2
         call evaluate(sides(i), (3 - 2*i)*difference_step, is_found(i))
      end do
      do i = 1, 2
         if (.not. is_found(i) .and. any(is_found)) call evaluate(sides(i), 0.0_wp, is_found(i))
      end do
      call problem%move_to_point(x, is_possible)
      is_possible = is_possible .and. all(is_found)

   contains

      subroutine evaluate(side, position, is_there)
         type(side_t), intent(out) :: side
         real(wp), intent(in) :: position
         logical, intent(out) :: is_there
         complex(wp) :: motion(problem%model%structure%n_dofs, problem%harmonics%n_harmonics)

         associate (there => x + position*direction)
            call problem%move_to_point(there, is_there)
            if (.not. is_there) return
            side%position = position
            side%structure = problem%model%structure
            side%loads = problem%model%loads
            side%frequencies = problem%frequencies
            side%drives = problem%drives()
            if (coordinates%equal(problem%stiffness%coordinates)) return
            call problem%all_dofs(reshape(there(:problem%n_unknowns), [problem%harmonics%n_coefficients, problem%n_dofs]), motion)
            side%series = motion(dof, :)
         end associate
      end subroutine evaluate
   end subroutine find_sides

   !> Adds the differences between both sides.
   subroutine add_differences(sides, moving)
      type(side_t), intent(in) :: sides(2)
      type(moving_parameters_t), intent(inout) :: moving
      real(wp) :: once(size(moving%frequencies)), weight

      once = 1.0_wp
      weight = 1.0_wp/(sides(1)%position - sides(2)%position)
      moving%frequency_slopes = weight*(sides(1)%frequencies - sides(2)%frequencies)
      moving%drive_slopes = weight*(sides(1)%drives - sides(2)%drives)
      call new_amplitudes(moving%load_slopes, moving%loads%n_dofs, moving%loads%n_harmonics)
      call moving%load_slopes%add_scaled(sides(1)%loads, weight*once)
      call moving%load_slopes%add_scaled(sides(2)%loads, -weight*once)
      if (.not. sides(1)%structure%has_matrices_of(sides(2)%structure)) &
         moving%structure_slope = sides(1)%structure%change_from(sides(2)%structure, weight)
   end subroutine add_differences
end module hb_response_slope
