!> Balances of the models of tests.
module model_balances
   use hb_balance, only: balance_t, new_balance
   use hb_dynamic_stiffness, only: dynamic_stiffness_t, new_dynamic_stiffness, wanted_slopes_t
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_law_coordinates, only: laws_at
   use hb_model, only: model_t
   use hb_system, only: coordinates_of
   use random_numbers, only: fill_random
   implicit none
   private
   public :: balance_at, balance_of, product_error

contains

   !> Balance of a model; the caller destroys it.
   subroutine balance_of(model, balance, error)
      type(model_t), intent(in) :: model
      type(balance_t), intent(inout) :: balance
      type(error_t), allocatable, intent(out) :: error
      type(dynamic_stiffness_t) :: stiffness

      associate (frequencies => model%discretisation%harmonics%frequencies(model%system%tones%omega))
         call new_dynamic_stiffness(stiffness, model%system%structure, coordinates_of(model%system), frequencies, &
                                    model%system%loads_in(model%discretisation%harmonics), error)
         if (allocated(error)) return
         call new_balance(balance, model%discretisation%harmonics, model%discretisation%torus, model%system%tones%omega, &
                          stiffness, laws_at(stiffness%coordinates, model%system%laws), error)
      end associate
   end subroutine balance_of

   !> Balance of a model at other base frequencies, on its grid, with the derivatives of the dynamic stiffness; the caller
   !> destroys it.
   subroutine balance_at(model, omega, balance, error)
      type(model_t), intent(in) :: model
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones)
      type(balance_t), intent(inout) :: balance
      type(error_t), allocatable, intent(out) :: error
      type(dynamic_stiffness_t) :: stiffness

      associate (frequencies => model%discretisation%harmonics%frequencies(omega))
         call new_dynamic_stiffness(stiffness, model%system%structure, coordinates_of(model%system), frequencies, &
                                    model%system%loads_in(model%discretisation%harmonics), error, &
                                    wanted_slopes_t(.true., &
                                                    loads=model%system%load_slopes_in(model%discretisation%harmonics)))
         if (allocated(error)) return
         call new_balance(balance, model%discretisation%harmonics, model%discretisation%torus, omega, stiffness, &
                          laws_at(stiffness%coordinates, model%system%laws), error)
      end associate
   end subroutine balance_at

   !> Largest difference between products with the tangent and with its matrix, relative to the largest product, for a few
   !> random vectors; huge where there are no products.
   real(wp) function product_error(balance, x)
      type(balance_t), intent(inout) :: balance
      real(wp), intent(in), contiguous :: x(:)
      integer, parameter :: n_vectors = 3
      real(wp), allocatable :: jacobian(:, :), v(:, :), product(:)
      logical :: is_ready
      integer :: i

      allocate (jacobian(size(x), size(x)), v(size(x), n_vectors), product(size(x)))
      call balance%tangent(x, jacobian)
      call balance%linearise(x, is_ready)
      product_error = huge(1.0_wp)
      if (.not. is_ready) return
      call fill_random(31, v)
      product_error = 0.0_wp
      do i = 1, n_vectors
         call balance%apply_tangent(v(:, i), product)
         product_error = max(product_error, maxval(abs(product - matmul(jacobian, v(:, i))))/maxval(abs(product)))
      end do
   end function product_error

end module model_balances
