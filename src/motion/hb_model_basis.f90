!> The coordinates of the unknowns of a model, and the basis in which it is solved: all tuples of its set, or where its equations
!> are odd the odd ones on half of the grid.
!>
!> An odd motion balances all harmonics, the even ones vanish on both sides. Whether other motions exist beside it is
!> another question: `symmetry = 'none'` looks among all. Source: docs/why/theory.md, section 2.
module hb_model_basis
   use hb_basis, only: basis_t, new_basis, whole_basis
   use hb_coordinates, only: coordinates_t
   use hb_error, only: error_t
   use hb_hysteretic_law, only: has_memory
   use hb_kinds, only: wp
   use hb_law_coordinates, only: new_law_coordinates
   use hb_model, only: model_t, symmetry
   use hb_odd_symmetry, only: even_part, most_even, why_not_odd
   use hb_properties, only: properties_t
   use hb_torus, only: torus_t
   implicit none
   private
   public :: check_symmetry, coordinates_of, find_basis, half_of_odd, is_solved_odd

contains

   !> Finds the basis of a model, with a first guess that takes the place of its own. An odd one is left to what has nothing
   !> to the contrary, unless the user requests odd motions.
   subroutine find_basis(self, is_odd, model, error, guess)
      type(basis_t), intent(out) :: self
      logical, intent(out) :: is_odd
      type(model_t), intent(in) :: model
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: guess(:)                      !! coefficients of all tuples, then all base frequencies

      is_odd = is_solved_odd(model)
      if (is_odd .and. present(guess) .and. model%symmetry == symmetry%auto) then
         associate (n => model%harmonics%n_coefficients, n_all => size(guess) - model%tones%n_tones)
            is_odd = even_part(model%harmonics, reshape(guess(:n_all), [n, n_all/n])) <= most_even
         end associate
      end if
      if (is_odd) then
         call new_basis(self, model%harmonics, modulo(sum(model%harmonics%tuples, dim=1), 2) == 1, half_of_odd(model), error)
      else
         self = whole_basis(model%harmonics, model%torus)
      end if
   end subroutine find_basis

   !> What the laws feel, and degrees of freedom at which a phase or an amplitude is reported.
   function coordinates_of(model, n_laws) result(coordinates)
      type(model_t), intent(in) :: model
      integer, intent(in), optional :: n_laws                         !! the first ones alone, else all
      type(coordinates_t) :: coordinates
      integer, allocatable :: wanted(:)
      integer :: last

      last = size(model%laws)
      if (present(n_laws)) last = n_laws
      allocate (wanted(0))
      if (allocated(model%phase_dofs)) wanted = model%phase_dofs
      if (model%normal_mode%is_asked .and. .not. model%normal_mode%has_energy) wanted = [wanted, model%normal_mode%dof]
      call new_law_coordinates(coordinates, model%structure, model%laws(:last), wanted)
   end function coordinates_of

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
end module hb_model_basis
