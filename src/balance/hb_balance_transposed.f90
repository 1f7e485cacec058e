!> Products with the transposed tangent of the balance: transposed transforms are transforms in the other direction, with the
!> weights W of the projection, P = W E^T, and slopes of laws are transposed sample by sample.
!>
!> Source: docs/why/theory.md, section 6.8.
submodule (hb_balance) hb_balance_transposed
   implicit none

contains

   module procedure balance_transpose_reaction
      type(error_t), allocatable :: error
      real(wp) :: spread_out(self%harmonics%n_coefficients, self%n_dofs)

      product = reshape(l, [size(l)])
      if (.not. self%law_set%needs_reaction) return
      call self%differentiate(u, error)
      if (.not. allocated(error)) call self%law_set%make_direction_samples(error)
      if (allocated(error)) then
         call move_alloc(error, self%failure)
         return
      end if
      associate (along => self%law_set%along)
         call spread_to_samples(self, l)
         call self%law_set%jacobian%add_transposed(along)
         call gather_from(self, along%s%values, spread_out)
      end associate
      product = product - self%law_set%factor*reshape(spread_out, [size(l)])
   end procedure balance_transpose_reaction

   !> P^T l in the forces `along`, all other samples there zero.
   subroutine spread_to_samples(self, l)
      type(balance_t), intent(inout) :: self
      real(wp), intent(in) :: l(:, :)                                 !! (n_coefficients, n_dofs)

      associate (along => self%law_set%along)
         call self%law_set%transform%to_samples(spread(weights(self), 2, size(l, 2))*l, along%f%values)
         along%q%values = 0.0_wp
         if (self%law_set%needs_velocity) along%v%values = 0.0_wp
         if (self%law_set%needs_reaction) along%s%values = 0.0_wp
      end associate
   end subroutine spread_to_samples

   !> E^T samples.
   subroutine gather_from(self, samples, l)
      type(balance_t), intent(inout) :: self
      real(wp), intent(inout), contiguous :: samples(:, :)            !! (n_samples, n_dofs), aligned; unchanged
      real(wp), intent(out) :: l(:, :)                                !! (n_coefficients, n_dofs)

      call self%law_set%transform%to_coefficients(samples, l)
      l = l/spread(weights(self), 2, size(l, 2))
   end subroutine gather_from

   !> W, the weights of the projection: 1/n of the mean, 2/n of cosines and sines.
   pure function weights(self)
      type(balance_t), intent(in) :: self
      real(wp) :: weights(self%harmonics%n_coefficients)
      integer :: h

      weights = 2.0_wp/self%law_set%transform%torus%n_total
      do h = 1, self%harmonics%n_harmonics
         if (self%harmonics%sin_at(h) == 0) weights(self%harmonics%cos_at(h)) = 0.5_wp*weights(self%harmonics%cos_at(h))
      end do
   end function weights
end submodule hb_balance_transposed
