!> Whether a model is solved among odd motions, on which grid, and whether it may ask for that.
!>
!> Source: docs/why/theory.md, section 2.
module hb_model_symmetry
   use hb_hysteretic_law, only: has_memory
   use hb_kinds, only: wp
   use hb_model, only: model_t, symmetry
   use hb_odd_symmetry, only: why_not_odd
   use hb_properties, only: properties_t
   use hb_torus, only: torus_t
   implicit none
   private
   public :: check_symmetry, half_of_odd, is_solved_odd

contains

   !> Whether the motion is sought among odd ones, unless a first guess from elsewhere is not odd. Loads and first guess that
   !> are not read yet count as none.
   logical function is_solved_odd(self)
      type(model_t), intent(in) :: self
      logical :: is_even(self%harmonics%n_harmonics)
      integer :: i

      is_solved_odd = .false.
      if (self%symmetry == symmetry%none .or. size(self%laws) == 0) return
      is_even = modulo(sum(self%harmonics%tuples, dim=1), 2) == 0
      if (self%symmetry == symmetry%auto) then
         if (self%start_from_integration) return
         ! a rigid law may take its augmentation from tuples that would go
         if (any(is_even) .and. any([(self%laws(i)%law%is_multiplier, i=1, size(self%laws))])) return
         if (self%start%n_dofs > 0) then
            do i = 1, size(is_even)
               if (.not. is_even(i)) cycle
               if (.not. self%start%is_zero_at(i)) return
            end do
         end if
      end if
      if (self%loads%n_dofs > 0) then
         is_solved_odd = why_not_odd(self%laws, self%harmonics, self%torus, self%loads) == ""
      else
         is_solved_odd = why_not_odd(self%laws, self%harmonics, self%torus) == ""
      end if
   end function is_solved_odd

   !> The grid on which odd motions are solved: half of it, but whole for what cannot be halved.
   type(torus_t) function half_of_odd(self) result(torus)
      type(model_t), intent(in) :: self

      torus = self%torus
      if (.not. torus%can_be_halved()) return
      if (.not. has_memory(self%laws) .or. self%tones%n_tones == 1) torus = torus%half()
   end function half_of_odd

   !> Refuses `symmetry = 'odd'` where the equations are not odd.
   subroutine check_symmetry(self, group)
      type(model_t), intent(in) :: self
      type(properties_t), intent(inout) :: group
      character(:), allocatable :: reason
      integer :: i

      if (self%symmetry /= symmetry%odd .or. .not. allocated(self%torus%n_samples)) return
      if (.not. all([(allocated(self%laws(i)%law%dofs), i=1, size(self%laws))])) return   ! a problem by now
      reason = trim(why_not_odd(self%laws, self%harmonics, self%torus, self%loads))
      if (len(reason) > 0) call group%problem("symmetry", "must not be 'odd': "//reason// &
                                              "; 'auto' uses the symmetry where there is one")
   end subroutine check_symmetry
end module hb_model_symmetry
