!> Derivatives of the functions of a motion by many values at once, in reverse mode (hb_adjoint): of one response, or of all
!> stored coefficients, and of unknown frequencies. Source: docs/why/theory.md, section 6.8.
submodule (hb_gradient) hb_reverse_gradient
   use hb_adjoint, only: adjoint_t, function_t, new_adjoint, suits_reverse_mode
   use hb_amplitudes, only: as_amplitudes, new_amplitudes
   implicit none

contains

   module procedure differentiate_in_reverse
      type(adjoint_t) :: adjoint
      type(error_t), allocatable :: error
      type(function_t), allocatable :: functions(:)
      type(movement_t), allocatable :: movements(:)
      real(wp), allocatable :: derivatives(:), explicit(:, :)
      real(wp) :: effect, largest, value
      integer :: k
      logical :: is_found, suits(size(is_done))

      strongest = 0
      associate (by => known%model%options%gradient%by)
         if (size(by) <= n_functions()) return                        ! before anything is allocated for each
         allocate (movements(size(by)))
         do k = 1, size(by)
            call new_movement(movements(k), here%model, by(k), .false., error)
            suits(k) = .not. allocated(error)
            if (suits(k)) suits(k) = suits_reverse_mode(here, movements(k))
         end do
         if (count(suits) <= n_functions()) return
         call list_functions(known, gradient, functions)
         call find_explicit(known, here, functions, explicit, is_found)
         if (is_found) call new_adjoint(adjoint, problem, here, tangent, known%x, functions, explicit, is_found)
         if (.not. is_found) return
         allocate (derivatives(size(functions)))
         largest = -1.0_wp
         do k = 1, size(by)
            if (work_is_over()) return
            if (.not. suits(k)) cycle
            call find_model_number(known%model, by(k), value, is_found)
            call adjoint%find_derivatives(here, movements(k), value, derivatives, is_done(k))
            if (.not. is_done(k)) cycle
            call store_derivatives(known, functions, derivatives, k, gradient)
            effect = norm2(derivatives)*merge(abs(value), 1.0_wp, abs(value) > 0.0_wp)
            if (effect > largest) strongest = k
            largest = max(largest, effect)
         end do
      end associate

   contains

      !> Functions that `list_functions` returns.
      integer function n_functions()
         n_functions = size(known%tones) + 1
         if (.not. allocated(gradient%response)) n_functions = size(known%tones) + &
            known%model%discretisation%harmonics%n_coefficients*size(known%model%options%output%dofs)
      end function n_functions
   end procedure differentiate_in_reverse

   !> The functions of a motion that are differentiated: the response, or all coefficients of the stored degrees of freedom;
   !> then unknown frequencies.
   subroutine list_functions(known, gradient, functions)
      type(known_t), intent(in) :: known
      type(gradient_t), intent(in) :: gradient
      type(function_t), allocatable, intent(out) :: functions(:)
      type(function_t) :: next
      complex(wp) :: w(known%model%system%structure%n_dofs, known%model%discretisation%harmonics%n_harmonics)
      integer :: h, i, part

      allocate (functions(0))
      associate (set => known%model%discretisation%harmonics, dofs => known%model%options%output%dofs)
         if (allocated(gradient%response)) then
            w = (0.0_wp, 0.0_wp)
            if (allocated(gradient%weights)) w(known%model%options%gradient%of%dof, :) = gradient%weights
            next%weights = as_amplitudes(w)
            functions = [functions, next]
         else
            do i = 1, size(dofs)
               do h = 1, set%n_harmonics
                  do part = 1, merge(2, 1, set%sin_at(h) > 0)
                     w = (0.0_wp, 0.0_wp)
                     w(dofs(i), h) = merge((1.0_wp, 0.0_wp), (0.0_wp, -1.0_wp), part == 1)
                     next%weights = as_amplitudes(w)
                     functions = [functions, next]
                  end do
               end do
            end do
         end if
         do i = 1, size(known%tones)
            call new_amplitudes(next%weights, size(w, 1), size(w, 2))
            next%parameter = i
            functions = [functions, next]
         end do
      end associate
   end subroutine list_functions

   !> Derivatives of the functions by the unknown parameters at a fixed motion of the coordinates: that of the interior.
   subroutine find_explicit(known, here, functions, explicit, is_found)
      type(known_t), intent(in) :: known
      type(model_problem_t), intent(inout) :: here
      type(function_t), intent(in) :: functions(:)
      real(wp), allocatable, intent(out) :: explicit(:, :)            !! (unknown parameters, functions)
      logical, intent(out) :: is_found
      complex(wp) :: slopes(known%model%system%structure%n_dofs, known%model%discretisation%harmonics%n_harmonics)
      real(wp) :: direction(size(known%x) + 1)
      integer :: h, i, k, m

      is_found = .true.
      allocate (explicit(size(known%which), size(functions)), source=0.0_wp)
      if (size(slopes, 1) == here%n_dofs .or. size(known%which) == 0) return
      here%which = [known%which, here%own]
      do m = 1, size(known%which)
         direction = 0.0_wp
         direction(known%n + m) = 1.0_wp
         call find_motion_slopes(here, [known%x, 0.0_wp], direction, [(h, h=1, size(slopes, 2))], slopes, is_found)
         if (.not. is_found) return
         do i = 1, size(functions)
            associate (weights => functions(i)%weights)
               do k = 1, size(weights%harmonics)
                  explicit(m, i) = explicit(m, i) + &
                                   real(dot_product(weights%values(:, k), slopes(:, weights%harmonics(k))), wp)
               end do
            end associate
         end do
      end do
   end subroutine find_explicit

   !> Stores the derivatives of the functions of `list_functions` by one value.
   pure subroutine store_derivatives(known, functions, derivatives, k, gradient)
      type(known_t), intent(in) :: known
      type(function_t), intent(in) :: functions(:)
      real(wp), intent(in) :: derivatives(:)
      integer, intent(in) :: k                                        !! number of the value
      type(gradient_t), intent(inout) :: gradient
      integer :: h, i, m, part

      m = 0
      if (allocated(gradient%response)) then
         m = 1
         if (allocated(gradient%weights)) gradient%response(k) = derivatives(1)
      else
         associate (set => known%model%discretisation%harmonics)
            do i = 1, size(gradient%coefficients, 3)
               do h = 1, set%n_harmonics
                  do part = 1, merge(2, 1, set%sin_at(h) > 0)
                     m = m + 1
                     gradient%coefficients(part, h, i, k) = derivatives(m)
                  end do
               end do
            end do
         end associate
      end if
      gradient%frequency(:, k) = 0.0_wp
      gradient%frequency(known%tones, k) = derivatives(m + 1:size(functions))
   end subroutine store_derivatives
end submodule hb_reverse_gradient
