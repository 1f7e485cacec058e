!> The basis in which a model is solved: all tuples of its set, or where its equations are odd the odd ones on half of the grid.
!>
!> An odd motion balances all harmonics, the even ones vanish on both sides. Whether other motions exist beside it is
!> another question: `symmetry = 'none'` looks among all. Source: docs/why/theory.md, section 2.
module hb_model_basis
   use hb_basis, only: basis_t, new_basis, whole_basis
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_model, only: model_t, symmetry
   use hb_model_symmetry, only: half_of_odd, is_solved_odd
   use hb_odd_symmetry, only: even_part, most_even
   implicit none
   private
   public :: find_basis


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
end module hb_model_basis
