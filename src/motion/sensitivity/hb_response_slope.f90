!> Derivatives of the motion along a direction of a curve of motions, of one degree of freedom or of all.
!> Frequencies have exact derivatives, and so have the matrices and loads that are affine functions of the numbers that
!> move (hb_model_problem); the interior follows by one condensation. If the coordinates of the laws move, and of whole models,
!> which are not condensed, it is a central difference. Source: docs/why/theory.md, section 6.7.
module hb_response_slope
   use hb_kinds, only: wp
   use hb_linear_slopes, only: linear_slopes_t
   use hb_model_problem, only: model_problem_t
   use hb_motion_slope, only: find_motion_slope, moving_parameters_t
   use hb_thresholds, only: difference_step
   implicit none
   private
   public :: find_motion_slopes, find_series_slope, omega_slopes_along

contains

   !> Finds the derivatives of some harmonics of a degree of freedom, at a point of a curve to which the problem has
   !> moved. Not allocated if the structure is singular there.
   subroutine find_series_slope(problem, dof, x, direction, harmonics, slope)
      type(model_problem_t), intent(inout) :: problem                 !! unchanged on return
      integer, intent(in) :: dof                                      !! of the structure
      real(wp), intent(in) :: x(:), direction(:)                      !! unknowns, then the parameters `which`
      integer, intent(in) :: harmonics(:)                             !! numbers of the requested ones
      complex(wp), allocatable, intent(out) :: slope(:)               !! (size(harmonics))
      complex(wp), allocatable :: all_slopes(:, :)
      logical :: is_found

      if (problem%moves_coordinates() .or. allocated(problem%stiffness%contacts)) then
         call find_difference(problem, dof, x, direction, harmonics, slope)
         return
      end if
      allocate (all_slopes(problem%model%system%structure%n_dofs, size(harmonics)))
      call find_motion_slopes(problem, x, direction, harmonics, all_slopes, is_found)
      if (is_found) slope = all_slopes(dof, :)
   end subroutine find_series_slope

   !> Finds the derivatives of some harmonics of all degrees of freedom, as `find_series_slope` does; the coordinates of laws
   !> must not move.
   subroutine find_motion_slopes(problem, x, direction, harmonics, slopes, is_found)
      type(model_problem_t), intent(inout) :: problem                 !! unchanged on return
      real(wp), intent(in) :: x(:), direction(:)                      !! unknowns, then the parameters `which`
      integer, intent(in) :: harmonics(:)                             !! numbers of the requested ones
      complex(wp), intent(out) :: slopes(:, :)                        !! (n_dofs, size(harmonics))
      logical, intent(out) :: is_found                                !! the structure is not singular
      type(linear_slopes_t) :: linear
      type(moving_parameters_t) :: moving
      logical :: is_singular

      moving%frequencies = problem%frequencies
      moving%drives = problem%drives()
      moving%tuples = problem%harmonics%tuples
      moving%loads = problem%model%system%loads_in(problem%harmonics)
      call add_frequency_slopes(problem, direction, moving)
      call problem%find_linear_slopes(direction(problem%n_unknowns + 1:), linear)
      call move_alloc(linear%structure, moving%structure_slope)
      moving%load_slopes = linear%loads
      call moving%load_slopes%add_scaled(problem%model%system%load_slopes_in(problem%harmonics), moving%frequency_slopes)
      call find_motion_slope(problem%model%system%structure, problem%stiffness%coordinates, moving, harmonics, &
                             motion_in(problem, x), motion_in(problem, direction), slopes, is_singular)
      is_found = .not. is_singular
   end subroutine find_motion_slopes

   !> Amplitudes of the coordinates of a vector along the curve, (n_coordinates, n_harmonics).
   function motion_in(problem, x) result(motion)
      type(model_problem_t), intent(in) :: problem
      real(wp), intent(in) :: x(:)
      complex(wp) :: motion(problem%n_dofs, problem%harmonics%n_harmonics)

      motion = problem%harmonics%amplitudes(reshape(x(:problem%n_unknowns), [problem%harmonics%n_coefficients, problem%n_dofs]))
   end function motion_in

   !> Derivatives of the base frequencies along the direction [rad/s], (n_tones).
   pure function omega_slopes_along(problem, direction) result(slopes)
      type(model_problem_t), intent(in) :: problem
      real(wp), intent(in) :: direction(:)                            !! unknowns, then the parameters `which`
      real(wp) :: slopes(size(problem%omega))
      integer :: i

      slopes = problem%omega_slopes*direction(size(direction))
      do i = 1, size(problem%which) - 1
         if (problem%which(i) <= size(slopes)) slopes(problem%which(i)) = direction(problem%n_unknowns + i)
      end do
   end function omega_slopes_along

   !> Adds the derivatives of frequencies, drives = j.(xi omega), along the direction.
   subroutine add_frequency_slopes(problem, direction, moving)
      type(model_problem_t), intent(in) :: problem
      real(wp), intent(in) :: direction(:)
      type(moving_parameters_t), intent(inout) :: moving
      real(wp), dimension(size(problem%omega)) :: omega_slopes, xi_slopes
      integer :: i

      omega_slopes = omega_slopes_along(problem, direction)
      xi_slopes = 0.0_wp
      associate (n => size(problem%omega))
         do i = 1, size(problem%which) - 1
            if (problem%which(i) > n) xi_slopes(problem%which(i) - n) = direction(problem%n_unknowns + i)
         end do
      end associate
      moving%frequency_slopes = problem%harmonics%frequencies(omega_slopes)
      moving%drive_slopes = problem%harmonics%frequencies(xi_slopes*problem%omega + problem%xi*omega_slopes)
   end subroutine add_frequency_slopes

   !> Differences of the motion on both sides of a point; at the end of the range of the value on one side and at the point.
   subroutine find_difference(problem, dof, x, direction, harmonics, slope)
      type(model_problem_t), intent(inout) :: problem                 ! at the point, as on return
      integer, intent(in) :: dof
      real(wp), intent(in) :: x(:), direction(:)
      integer, intent(in) :: harmonics(:)
      complex(wp), allocatable, intent(out) :: slope(:)
      complex(wp) :: series(problem%harmonics%n_harmonics, 2)
      real(wp) :: positions(2)
      logical :: is_found(2), is_possible
      integer :: i

      do i = 1, 2
         call evaluate(i, (3 - 2*i)*difference_step)
      end do
      do i = 1, 2
         if (.not. is_found(i) .and. any(is_found)) call evaluate(i, 0.0_wp)
      end do
      call problem%move_to_point(x, is_possible)
      if (is_possible .and. all(is_found)) &
         slope = (series(harmonics, 1) - series(harmonics, 2))/(positions(1) - positions(2))

   contains

      subroutine evaluate(side, position)
         integer, intent(in) :: side
         real(wp), intent(in) :: position
         complex(wp) :: motion(problem%model%system%structure%n_dofs, problem%harmonics%n_harmonics)

         associate (there => x + position*direction)
            positions(side) = position
            call problem%move_to_point(there, is_found(side))
            if (.not. is_found(side)) return
            call problem%all_dofs(reshape(there(:problem%n_unknowns), [problem%harmonics%n_coefficients, problem%n_dofs]), motion)
            series(:, side) = motion(dof, :)
         end associate
      end subroutine evaluate
   end subroutine find_difference
end module hb_response_slope
