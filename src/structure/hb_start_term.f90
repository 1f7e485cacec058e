!> A term of a first guess: one tuple at some degrees of freedom.
module hb_start_term
   use hb_harmonic_amplitude, only: harmonic_amplitude_t
   use hb_kinds, only: wp
   use hb_numbers, only: numbered_t, numbers_t
   use hb_spectrum, only: spectrum_t
   implicit none
   private
   public :: start_term_t

   type, extends(numbered_t) :: start_term_t
      integer, allocatable :: tuple(:)                                !! j, (n_tones)
      integer, allocatable :: dofs(:)
      real(wp), allocatable :: weights(:)                             !! (size(dofs)); not allocated after a problem of the input
      type(harmonic_amplitude_t) :: amplitude                         !! [m]
   contains
      procedure :: add_to => start_term_add_to
      procedure :: declare_numbers => start_term_declare_numbers
   end type start_term_t

contains

   subroutine start_term_declare_numbers(self, numbers)
      class(start_term_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call self%amplitude%declare(numbers, "m")
   end subroutine start_term_declare_numbers

   !> Adds the term to the others.
   pure subroutine start_term_add_to(self, start)
      class(start_term_t), intent(in) :: self
      type(spectrum_t), intent(inout) :: start                        !! [m]

      call start%add(self%tuple, self%weights*self%amplitude%turned(is_constant=all(self%tuple == 0)), self%dofs)
   end subroutine start_term_add_to
end module hb_start_term
