!> Coordinates z = shape^T q that replace as many degrees of freedom of a structure, such as the coordinates of laws.
!>
!> Of the degrees of freedom in the shape, n pivots p are replaced by z and the others r remain:
!>
!>     q = T y:   q_p = G z + B q_r,   G = shape_p^-T,   B = -G shape_r^T,   y = q but for y_p = z.
!>
!> Pivots come from complete pivoting of the shape with its rows divided by the square root of the diagonal stiffness:
!> soft degrees of freedom are replaced, so that no stiff one dominates those that remain in T^T K T. Source:
!> docs/why/theory.md, section 4.
module hb_coordinates
   use hb_kinds, only: wp
   use hb_lapack, only: dgetrf, dgetrs
   use hb_sparse, only: sparse_from_entries, sparse_product, sparse_t, sparse_transpose
   use hb_structure, only: structure_t
   implicit none
   private
   public :: coordinates_t, dofs_as_coordinates, new_coordinates, softness

   real(wp), parameter :: rounding = 1.0e-12_wp                       ! relative

   type :: coordinates_t
      integer :: n = 0
      logical :: are_dofs = .true.                                    !! each coordinate is a degree of freedom: T is 1
      integer, allocatable :: dofs(:)                                 !! of the structure, in the shape
      integer, allocatable :: positions(:)                            !! (n) degrees of freedom that they replace
      real(wp), allocatable :: shape(:, :)                            !! (size(dofs), n); not allocated where `are_dofs`
      real(wp), allocatable :: scale(:)                               !! with which they may be compared, (n); not allocated: 1
      integer, allocatable, private :: pivots(:), others(:)           ! among `dofs`
      real(wp), allocatable, private :: of_z(:, :), of_others(:, :)   ! G and B
   contains
      procedure :: equal => coordinates_equal
      procedure :: number_of => coordinates_number_of
      procedure :: values_of => coordinates_values_of
      procedure :: amplitudes_of => coordinates_amplitudes_of
      procedure :: spread_forces => coordinates_spread_forces
      procedure :: place => coordinates_place
      procedure :: weights_of => coordinates_weights_of
      procedure :: structure_in => coordinates_structure_in
      procedure :: forces_in => coordinates_forces_in
      procedure :: motion_from => coordinates_motion_from
   end type coordinates_t

contains

   !> Makes each degree of freedom a coordinate of its own.
   pure function dofs_as_coordinates(dofs) result(self)
      integer, intent(in) :: dofs(:)                                  !! in any order
      type(coordinates_t) :: self

      self%n = size(dofs)
      allocate (self%dofs, source=dofs)
      allocate (self%positions, source=dofs)
   end function dofs_as_coordinates

   !> Compliance of degrees of freedom [m/N], from the diagonal stiffness; those without stiffness count as very soft.
   pure function softness(structure, dofs)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: dofs(:)
      real(wp) :: softness(size(dofs))
      real(wp), parameter :: softest = 1.0e-8_wp                      ! stiffness relative to the largest
      real(wp) :: stiffness(size(dofs))
      integer :: i

      if (allocated(structure%sparse)) then
         stiffness = [(abs(structure%sparse%stiffness%at(dofs(i), dofs(i))), i=1, size(dofs))]
      else
         stiffness = [(abs(structure%stiffness(dofs(i), dofs(i))), i=1, size(dofs))]
      end if
      stiffness = max(stiffness, softest*maxval(stiffness))
      softness = 1.0_wp
      where (stiffness >= tiny(1.0_wp)) softness = 1.0_wp/stiffness
   end function softness

   !> Creates coordinates of a structure, ordered by the degrees of freedom that they replace.
   subroutine new_coordinates(self, structure, dofs, shape)
      type(coordinates_t), intent(out) :: self
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: dofs(:)                                  !! all different
      real(wp), intent(in) :: shape(:, :)                             !! (size(dofs), n) with independent columns
      integer :: column_at(size(dofs)), i, info, swapped(size(shape, 2))
      real(wp), allocatable :: factors(:, :)

      self%n = size(shape, 2)
      self%are_dofs = .false.
      self%dofs = dofs
      call find_pivots(shape, sqrt(softness(structure, dofs)), column_at)
      self%pivots = pack([(i, i=1, size(dofs))], column_at > 0)
      self%others = pack([(i, i=1, size(dofs))], column_at == 0)
      self%positions = dofs(self%pivots)
      self%shape = shape(:, column_at(self%pivots))
      factors = transpose(self%shape(self%pivots, :))
      allocate (self%of_z(self%n, self%n), source=0.0_wp)
      do i = 1, self%n
         self%of_z(i, i) = 1.0_wp
      end do
      call dgetrf(self%n, self%n, factors, self%n, swapped, info)
      call dgetrs("N", self%n, self%n, factors, self%n, swapped, self%of_z, self%n, info)
      self%of_others = -matmul(self%of_z, transpose(self%shape(self%others, :)))
   end subroutine new_coordinates

   !> Assigns a row of its own to each column of the shape.
   pure subroutine find_pivots(shape, weight, column_at)
      real(wp), intent(in) :: shape(:, :), weight(:)                  !! (m, n), (m)
      integer, intent(out) :: column_at(:)                            !! (m), 0: no pivot
      real(wp) :: remainder(size(shape, 1), size(shape, 2)), row(size(shape, 2))
      integer :: at(2), j, k

      remainder = spread(weight, 2, size(shape, 2))*shape
      column_at = 0
      do k = 1, size(shape, 2)
         at = maxloc(abs(remainder))
         row = remainder(at(1), :)/remainder(at(1), at(2))
         column_at(at(1)) = at(2)
         do j = 1, size(shape, 2)
            if (j /= at(2) .and. abs(row(j)) > 0.0_wp) remainder(:, j) = remainder(:, j) - row(j)*remainder(:, at(2))
         end do
         remainder(:, at(2)) = 0.0_wp
         remainder(at(1), :) = 0.0_wp
      end do
   end subroutine find_pivots

   !> Whether these are equal to others.
   pure logical function coordinates_equal(self, other) result(are_equal)
      class(coordinates_t), intent(in) :: self
      type(coordinates_t), intent(in) :: other

      are_equal = self%n == other%n .and. size(self%dofs) == size(other%dofs)
      if (are_equal) are_equal = all(self%dofs == other%dofs)
      if (are_equal .and. .not. self%are_dofs) are_equal = .not. any(abs(self%shape - other%shape) > 0.0_wp)
   end function coordinates_equal

   !> Number of the coordinate that is a degree of freedom of the structure; 0 if there is none.
   pure integer function coordinates_number_of(self, dof) result(number)
      class(coordinates_t), intent(in) :: self
      integer, intent(in) :: dof

      number = findloc(self%positions, dof, dim=1)
      if (number == 0 .or. self%are_dofs) return
      if (any(abs(self%shape(:, number) - merge(1.0_wp, 0.0_wp, self%dofs == dof)) > 0.0_wp)) number = 0
   end function coordinates_number_of

   !> Coordinates of motions of the degrees of freedom in the shape.
   pure function coordinates_values_of(self, q) result(z)
      class(coordinates_t), intent(in) :: self
      real(wp), intent(in) :: q(:, :)                                 !! [m], (any, size(dofs))
      real(wp) :: z(size(q, 1), self%n)

      if (self%are_dofs) then
         z = q
      else
         z = matmul(q, self%shape)
      end if
   end function coordinates_values_of

   !> Amplitudes of the coordinates from those of all degrees of freedom.
   pure function coordinates_amplitudes_of(self, c) result(z)
      class(coordinates_t), intent(in) :: self
      complex(wp), intent(in) :: c(:, :)                              !! [m], (all degrees of freedom, any)
      complex(wp) :: z(self%n, size(c, 2))

      if (self%are_dofs) then
         z = c(self%dofs, :)
      else
         z = matmul(transpose(self%shape), c(self%dofs, :))
      end if
   end function coordinates_amplitudes_of

   !> Forces on the degrees of freedom from those on the coordinates.
   pure function coordinates_spread_forces(self, f) result(forces)
      class(coordinates_t), intent(in) :: self
      real(wp), intent(in) :: f(:, :)                                 !! [N], (any, n)
      real(wp) :: forces(size(f, 1), size(self%dofs))

      if (self%are_dofs) then
         forces = f
      else
         forces = matmul(f, transpose(self%shape))
      end if
   end function coordinates_spread_forces

   !> Expresses the shape of a law, linear functionals of degrees of freedom, in these coordinates; it is in their
   !> span.
   pure subroutine coordinates_place(self, dofs, shape)
      class(coordinates_t), intent(in) :: self
      integer, allocatable, intent(inout) :: dofs(:)                  !! on return numbers of coordinates
      real(wp), allocatable, intent(inout) :: shape(:, :)             !! (size(dofs), any)
      real(wp), allocatable :: at_pivots(:, :), in_coordinates(:, :)
      integer, allocatable :: used(:)
      integer :: i, k

      if (self%are_dofs) then
         dofs = [(findloc(self%dofs, dofs(k), dim=1), k=1, size(dofs))]
         return
      end if
      allocate (at_pivots(self%n, size(shape, 2)), source=0.0_wp)
      do k = 1, size(dofs)
         i = findloc(self%positions, dofs(k), dim=1)
         if (i > 0) at_pivots(i, :) = shape(k, :)
      end do
      in_coordinates = matmul(transpose(self%of_z), at_pivots)
      associate (largest => maxval(abs(in_coordinates)))
         where (abs(in_coordinates) < rounding*largest) in_coordinates = 0.0_wp
         where (abs(in_coordinates - 1.0_wp) < rounding*largest) in_coordinates = 1.0_wp
      end associate
      used = pack([(i, i=1, self%n)], any(in_coordinates /= 0.0_wp, dim=2))
      if (size(used) == 0) used = [1]                                 ! a law without coordinates
      dofs = used
      shape = in_coordinates(used, :)
   end subroutine coordinates_place

   !> Weights at `dofs` of a linear functional of some coordinates.
   pure function coordinates_weights_of(self, numbers, functional) result(weights)
      class(coordinates_t), intent(in) :: self
      integer, intent(in) :: numbers(:)                               !! of coordinates
      real(wp), intent(in) :: functional(:)                           !! (size(numbers))
      real(wp) :: weights(size(self%dofs))

      if (self%are_dofs) then
         weights = 0.0_wp
         weights(numbers) = functional
      else
         weights = matmul(self%shape(:, numbers), functional)
      end if
   end function coordinates_weights_of

   !> The structure in these coordinates: T^T M T, the same for damping and stiffness, T^T a and T^T b for parts.
   function coordinates_structure_in(self, structure) result(turned)
      class(coordinates_t), intent(in) :: self
      type(structure_t), intent(in) :: structure
      type(structure_t) :: turned
      integer :: i

      turned = structure
      if (self%are_dofs) return
      if (allocated(turned%parts)) then
         do i = 1, size(turned%parts)
            call turn_vector(turned%parts(i)%acts)
            call turn_vector(turned%parts(i)%feels)
         end do
      end if
      if (allocated(structure%sparse)) then
         call turn_sparse(turned%sparse%mass)
         call turn_sparse(turned%sparse%damping)
         call turn_sparse(turned%sparse%stiffness)
         return
      end if
      call turn(turned%mass)
      call turn(turned%damping)
      call turn(turned%stiffness)

   contains

      subroutine turn(matrix)
         real(wp), intent(inout) :: matrix(:, :)
         real(wp), allocatable :: at_pivots(:, :)

         associate (p => self%positions, r => self%dofs(self%others))
            allocate (at_pivots(size(matrix, 1), size(p)), source=matrix(:, p))
            matrix(:, r) = matrix(:, r) + matmul(at_pivots, self%of_others)
            matrix(:, p) = matmul(at_pivots, self%of_z)
            at_pivots = matrix(p, :)
            matrix(r, :) = matrix(r, :) + matmul(transpose(self%of_others), at_pivots)
            matrix(p, :) = matmul(transpose(self%of_z), at_pivots)
         end associate
      end subroutine turn

      pure subroutine turn_vector(vector)
         real(wp), intent(inout) :: vector(:)
         real(wp) :: at_pivots(size(self%positions))

         associate (p => self%positions, r => self%dofs(self%others))
            at_pivots = vector(p)
            vector(r) = vector(r) + matmul(at_pivots, self%of_others)
            vector(p) = matmul(at_pivots, self%of_z)
         end associate
      end subroutine turn_vector

      subroutine turn_sparse(matrix)
         type(sparse_t), intent(inout) :: matrix
         type(sparse_t) :: t

         t = transformation(self, structure%n_dofs)
         matrix = sparse_product(sparse_transpose(t), sparse_product(matrix, t))
      end subroutine turn_sparse
   end function coordinates_structure_in

   !> T as a sparse matrix.
   function transformation(self, n_dofs) result(t)
      class(coordinates_t), intent(in) :: self
      integer, intent(in) :: n_dofs
      type(sparse_t) :: t
      integer, allocatable :: column(:), row(:)
      real(wp), allocatable :: value(:)
      logical :: is_replaced(n_dofs)
      integer :: i, k

      is_replaced = .false.
      is_replaced(self%positions) = .true.
      allocate (row, source=pack([(i, i=1, n_dofs)], .not. is_replaced))
      allocate (column, source=row)
      allocate (value(size(row)), source=1.0_wp)
      associate (p => self%positions, r => self%dofs(self%others))
         do k = 1, size(p)
            row = [row, p]
            column = [column, spread(p(k), 1, size(p))]
            value = [value, self%of_z(:, k)]
         end do
         do k = 1, size(r)
            row = [row, p]
            column = [column, spread(r(k), 1, size(p))]
            value = [value, self%of_others(:, k)]
         end do
      end associate
      t = sparse_from_entries(n_dofs, row, column, value)
   end function transformation

   !> Forces, or gradients, in these coordinates from those on all degrees of freedom: T^T f.
   pure function coordinates_forces_in(self, forces) result(turned)
      class(coordinates_t), intent(in) :: self
      complex(wp), intent(in) :: forces(:, :)                         !! (all degrees of freedom, any)
      complex(wp) :: turned(size(forces, 1), size(forces, 2))

      turned = forces
      if (self%are_dofs) return
      associate (p => self%positions, r => self%dofs(self%others))
         turned(p, :) = matmul(transpose(self%of_z), forces(p, :))
         turned(r, :) = forces(r, :) + matmul(transpose(self%of_others), forces(p, :))
      end associate
   end function coordinates_forces_in

   !> Transforms y to the motion of all degrees of freedom, q = T y.
   pure subroutine coordinates_motion_from(self, y)
      class(coordinates_t), intent(in) :: self
      complex(wp), intent(inout) :: y(:, :)                           !! [m], (all degrees of freedom, any)

      if (self%are_dofs) return
      associate (p => self%positions, r => self%dofs(self%others))
         y(p, :) = matmul(self%of_z, y(p, :)) + matmul(self%of_others, y(r, :))
      end associate
   end subroutine coordinates_motion_from
end module hb_coordinates
