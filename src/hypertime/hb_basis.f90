!> A basis: the coefficients of a motion that are unknowns, and the grid on which its forces are sampled.
!>
!> Some of the tuples of a motion are unknowns, such as the odd ones of an odd motion; the coefficients of the others
!> are zero. Vectors and amplitudes are restricted to the unknowns and expanded from them. Source:
!> docs/why/theory.md, section 2.
module hb_basis
   use hb_assert, only: assert, asserts_are_on
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t, new_subset
   use hb_kinds, only: wp
   use hb_torus, only: torus_t
   implicit none
   private
   public :: basis_t, new_basis, transfer_coefficients, whole_basis

   type :: basis_t
      type(harmonics_t) :: whole                                      !! tuples of the motion
      type(harmonics_t) :: harmonics                                  !! those whose coefficients are unknowns
      type(torus_t) :: torus                                          !! grid of the forces
      integer, allocatable :: positions(:)                            !! positions of `harmonics` in `whole`
   contains
      procedure :: restrict => basis_restrict
      procedure :: expand => basis_expand
   end type basis_t

contains

   !> Creates a basis of some tuples of a set. Fails if there are none.
   subroutine new_basis(self, whole, is_unknown, torus, error)
      type(basis_t), intent(out) :: self
      type(harmonics_t), intent(in) :: whole
      logical, intent(in) :: is_unknown(:)                            !! (whole%n_harmonics)
      type(torus_t), intent(in) :: torus
      type(error_t), allocatable, intent(out) :: error
      integer :: h

      if (asserts_are_on) call assert(size(is_unknown) == whole%n_harmonics, "new_basis", "a value for each harmonic")
      self%whole = whole
      self%torus = torus
      self%positions = pack([(h, h=1, whole%n_harmonics)], is_unknown)
      call new_subset(self%harmonics, whole, self%positions, error)
   end subroutine new_basis

   !> Basis in which all tuples of a set are unknowns.
   pure function whole_basis(whole, torus) result(self)
      type(harmonics_t), intent(in) :: whole
      type(torus_t), intent(in) :: torus
      type(basis_t) :: self
      integer :: h

      self%whole = whole
      self%harmonics = whole
      self%torus = torus
      self%positions = [(h, h=1, whole%n_harmonics)]
   end function whole_basis

   !> Unknowns of a motion from all its coefficients.
   pure function basis_restrict(self, coefficients) result(u)
      class(basis_t), intent(in) :: self
      real(wp), intent(in) :: coefficients(:, :)                      !! (whole%n_coefficients, any)
      real(wp) :: u(self%harmonics%n_coefficients, size(coefficients, 2))

      call transfer_coefficients(self%whole, self%harmonics, coefficients, u)
   end function basis_restrict

   !> All coefficients of a motion from its unknowns.
   pure function basis_expand(self, u) result(coefficients)
      class(basis_t), intent(in) :: self
      real(wp), intent(in) :: u(:, :)                                 !! (harmonics%n_coefficients, any)
      real(wp) :: coefficients(self%whole%n_coefficients, size(u, 2))

      call transfer_coefficients(self%harmonics, self%whole, u, coefficients)
   end function basis_expand

   !> Copies coefficients of the tuples in both sets; the others of `to` become zero.
   pure subroutine transfer_coefficients(from_set, to_set, from, to)
      type(harmonics_t), intent(in) :: from_set, to_set
      real(wp), intent(in) :: from(:, :)                              !! (from_set%n_coefficients, any)
      real(wp), intent(out) :: to(:, :)                               !! (to_set%n_coefficients, any)
      integer :: h, k

      if (asserts_are_on) call assert(size(from, 1) == from_set%n_coefficients .and. size(to, 1) == to_set%n_coefficients, &
                                      "transfer_coefficients", "coefficients of the two sets")
      if (from_set%n_harmonics == to_set%n_harmonics) then             ! the usual case: points of a sweep
         if (all(from_set%tuples == to_set%tuples)) then
            to = from
            return
         end if
      end if
      to = 0.0_wp
      do h = 1, to_set%n_harmonics
         k = from_set%index_of(to_set%tuples(:, h))
         if (k == 0) cycle
         to(to_set%cos_at(h), :) = from(from_set%cos_at(k), :)
         if (to_set%sin_at(h) > 0) to(to_set%sin_at(h), :) = from(from_set%sin_at(k), :)
      end do
   end subroutine transfer_coefficients
end module hb_basis
