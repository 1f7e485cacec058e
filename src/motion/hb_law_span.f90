!> Fewer unknowns where laws feel fewer coordinates than they have degrees of freedom, as a stop at one point of a beam by
!> its modes does: coordinates that span what the laws feel take the place of their degrees of freedom, the others
!> join the interior, which is condensed out.
!>
!> With W an orthonormal basis of the shapes of all laws and N of what is orthogonal to it, q = [W N] y at the degrees of
!> freedom of the laws. Laws act on y = W^T q alone; motions and forces come back by [W N] and W. Source: docs/user/theory.md,
!> section 4.
module hb_law_span
   use hb_kinds, only: wp
   use hb_law_forces, only: law_dofs_of
   use hb_motion_result, only: motion_result_t
   use hb_scene, only: scene_t
   implicit none
   private
   public :: law_span_t, reduce_to_span

   integer, parameter :: most_dofs = 64                                ! of the structure, whose bands are lost
   real(wp), parameter :: dependent = 1.0e-10_wp                       ! part of a shape outside others that counts as none

   type :: law_span_t
      logical :: is_smaller = .false.                                 !! than the degrees of freedom; else nothing was reduced
      integer :: rank = 0                                             !! coordinates that the laws feel
      integer, allocatable, private :: dofs(:)                        ! on which laws act, (n)
      integer, allocatable, private :: kept(:)                        ! those whose coefficients are wanted
      real(wp), allocatable, private :: basis(:, :)                   ! [W N], (n, n)
   contains
      procedure :: restore => law_span_restore
   end type law_span_t

contains

   !> Makes the smaller scene, if there is one: its first degrees of freedom of laws are the coordinates y, and it keeps the
   !> motion of all that `restore` needs.
   subroutine reduce_to_span(self, scene, smaller)
      type(law_span_t), intent(out) :: self
      type(scene_t), intent(in) :: scene
      type(scene_t), allocatable, intent(out) :: smaller
      integer :: i

      if (size(scene%laws) == 0 .or. scene%structure%n_dofs > most_dofs) return
      if (any(scene%tones%is_unknown) .or. size(scene%output%samples) > 0) return
      if (scene%certificate%improvement_steps > 0) return
      self%dofs = law_dofs_of(scene%laws)
      if (any(scene%structure%units(self%dofs) /= scene%structure%units(self%dofs(1)))) return
      if (size(self%dofs) == 1) return
      call find_basis(self, scene)
      self%is_smaller = self%rank > 0 .and. self%rank < size(self%dofs)
      if (.not. self%is_smaller) return

      allocate (smaller, source=scene)
      self%kept = scene%output%dofs
      smaller%output%dofs = [self%kept, pack(self%dofs, [(all(self%kept /= self%dofs(i)), i=1, size(self%dofs))])]
      associate (dofs => self%dofs, basis => self%basis, structure => smaller%structure)
         call turn_rows(self, structure%mass)
         call turn_columns(self, structure%mass)
         call turn_rows(self, structure%damping)
         call turn_columns(self, structure%damping)
         call turn_rows(self, structure%stiffness)
         call turn_columns(self, structure%stiffness)
         smaller%loads(dofs, :) = matmul(transpose(basis), scene%loads(dofs, :))
         smaller%load_slopes(dofs, :) = matmul(transpose(basis), scene%load_slopes(dofs, :))
         smaller%start(dofs, :) = matmul(transpose(basis), scene%start(dofs, :))
         do i = 1, size(smaller%laws)
            associate (law => smaller%laws(i)%law)
               law%shape = matmul(transpose(basis(:, :self%rank)), spread_shape(self, law%dofs, law%shape))
               law%dofs = dofs(:self%rank)
            end associate
         end do
      end associate
   end subroutine reduce_to_span

   !> W by orthogonalising the shapes of all laws one after the other, twice each, then N from unit vectors.
   subroutine find_basis(self, scene)
      type(law_span_t), intent(inout) :: self
      type(scene_t), intent(in) :: scene
      real(wp), allocatable :: shape(:, :), unit(:)
      integer :: c, i, n, n_found

      n = size(self%dofs)
      allocate (self%basis(n, n), source=0.0_wp)
      allocate (unit(n))
      n_found = 0
      do i = 1, size(scene%laws)
         shape = spread_shape(self, scene%laws(i)%law%dofs, scene%laws(i)%law%shape)
         do c = 1, size(shape, 2)
            if (n_found < n) call add_direction(self%basis, n_found, shape(:, c), dependent)
         end do
      end do
      self%rank = n_found
      do while (n_found < n)
         unit = 0.0_wp
         unit(maxloc(1.0_wp - sum(self%basis(:, :n_found)**2, dim=2), dim=1)) = 1.0_wp   ! farthest from what is there
         call add_direction(self%basis, n_found, unit, 0.0_wp)
      end do
   end subroutine find_basis

   !> Adds the part of a vector that is orthogonal to the first `n_found` columns, unless it is small beside the vector.
   pure subroutine add_direction(basis, n_found, vector, smallest)
      real(wp), intent(inout) :: basis(:, :)
      integer, intent(inout) :: n_found
      real(wp), intent(in) :: vector(:), smallest
      real(wp) :: rest(size(vector))
      integer :: pass

      rest = vector
      do pass = 1, 2
         rest = rest - matmul(basis(:, :n_found), matmul(rest, basis(:, :n_found)))
      end do
      if (norm2(rest) <= smallest*norm2(vector)) return
      n_found = n_found + 1
      basis(:, n_found) = rest/norm2(rest)
   end subroutine add_direction

   !> Shape of a law over all degrees of freedom of laws.
   pure function spread_shape(self, dofs, shape) result(wide)
      type(law_span_t), intent(in) :: self
      integer, intent(in) :: dofs(:)
      real(wp), intent(in) :: shape(:, :)                             !! (size(dofs), n_coordinates)
      real(wp) :: wide(size(self%dofs), size(shape, 2))
      integer :: k

      wide = 0.0_wp
      do k = 1, size(dofs)
         wide(findloc(self%dofs, dofs(k), dim=1), :) = shape(k, :)
      end do
   end function spread_shape

   !> matrix := [W N]^T matrix at the rows of the degrees of freedom of laws.
   pure subroutine turn_rows(self, matrix)
      type(law_span_t), intent(in) :: self
      real(wp), intent(inout) :: matrix(:, :)

      matrix(self%dofs, :) = matmul(transpose(self%basis), matrix(self%dofs, :))
   end subroutine turn_rows

   !> matrix := matrix [W N] at their columns.
   pure subroutine turn_columns(self, matrix)
      type(law_span_t), intent(in) :: self
      real(wp), intent(inout) :: matrix(:, :)

      matrix(:, self%dofs) = matmul(matrix(:, self%dofs), self%basis)
   end subroutine turn_columns

   !> Turns the result of the smaller scene into that of the scene itself.
   subroutine law_span_restore(self, smaller, result)
      class(law_span_t), intent(in) :: self
      type(scene_t), intent(in) :: smaller
      type(motion_result_t), intent(inout) :: result
      integer :: at_laws(size(self%dofs)), i, part
      real(wp), allocatable :: y(:, :, :), corrected(:, :, :), force(:, :, :)

      if (.not. allocated(result%coefficients)) return
      at_laws = [(findloc(smaller%output%dofs, self%dofs(i), dim=1), i=1, size(self%dofs))]
      y = result%coefficients(:, :, at_laws)
      do part = 1, 2
         result%coefficients(part, :, at_laws) = matmul(y(part, :, :), transpose(self%basis))
      end do
      result%coefficients = result%coefficients(:, :, :size(self%kept))
      if (allocated(result%force_coefficients)) then
         call move_alloc(result%force_coefficients, force)
         allocate (result%force_coefficients(2, size(force, 2), size(self%dofs)))
         do part = 1, 2
            result%force_coefficients(part, :, :) = matmul(force(part, :, :), transpose(self%basis(:, :self%rank)))
         end do
      end if
      if (allocated(result%corrected_coefficients)) then
         call move_alloc(result%corrected_coefficients, corrected)
         y(:, :, :self%rank) = corrected
         allocate (result%corrected_coefficients(2, size(y, 2), size(self%dofs)))
         do part = 1, 2
            result%corrected_coefficients(part, :, :) = matmul(y(part, :, :), transpose(self%basis))
         end do
      end if
   end subroutine law_span_restore
end module hb_law_span
