!> Coordinates z = shape^T q that replace as many degrees of freedom of a structure, such as the coordinates of laws.
!>
!> Of the degrees of freedom in the shape, n pivots p are replaced by z and the others r remain:
!>
!>     q = T y:   q_p = G z + B q_r,   G = shape_p^-T,   B = -G shape_r^T,   y = q but for y_p = z.
!>
!> Pivots come from complete pivoting of the shape with its rows divided by the square root of the diagonal stiffness:
!> soft degrees of freedom are replaced, so that no stiff one dominates those that remain in T^T K T. Source:
!> docs/why/theory.md, section 4. Coordinates that share no degree of freedom are in different parts, each with blocks of its own:
!> the work grows with the number of parts.
module hb_coordinates
   use hb_kinds, only: wp
   use hb_lapack, only: dgetrf, dgetrs
   use hb_sparse, only: sparse_from_entries, sparse_product, sparse_t, sparse_transpose
   use hb_structure, only: structure_t
   implicit none
   private
   public :: coordinate_part_t, coordinates_t, dofs_as_coordinates, new_coordinates, position_in, softness

   real(wp), parameter :: entry_rounding = 1.0e-12_wp                 ! relative

   !> Coordinates that share degrees of freedom with no others.
   type :: coordinate_part_t
      integer, allocatable :: members(:)                              !! positions among all degrees of freedom
      real(wp), allocatable :: shape(:, :)                            !! (size(members), any) with independent columns
   end type coordinate_part_t

   type :: coordinates_t
      integer :: n = 0
      logical :: are_dofs = .true.                                    !! each coordinate is a degree of freedom: T is 1
      integer, allocatable :: dofs(:)                                 !! of the structure, in the shape
      integer, allocatable :: positions(:)                            !! (n) degrees of freedom that they replace
      type(sparse_t), private :: functionals ! shape^T, (n, size(dofs)); empty where `are_dofs`, as the next
      integer, allocatable, private :: others(:)                      ! degrees of freedom in the shape that remain
      type(sparse_t), private :: of_z, of_others                      ! G, (n, n), and B, (n, size(others))
   contains
      procedure :: equal => coordinates_equal
      procedure :: find_functional => coordinates_find_functional
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

   !> Entries of a sparse matrix, in any order.
   type :: entries_t
      integer :: n = 0
      integer, allocatable :: row(:), column(:)                       ! (capacity)
      real(wp), allocatable :: value(:)
   contains
      procedure :: add => entries_add
      procedure :: matrix => entries_matrix
   end type entries_t

   interface new_coordinates
      procedure :: new_coordinates_of_shape, new_coordinates_of_parts
   end interface new_coordinates

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
      real(wp), parameter :: min_stiffness_ratio = 1.0e-8_wp          ! stiffness relative to the largest
      real(wp) :: stiffness(size(dofs))
      integer :: i

      if (allocated(structure%sparse)) then
         stiffness = [(abs(structure%sparse%stiffness%at(dofs(i), dofs(i))), i=1, size(dofs))]
      else
         stiffness = [(abs(structure%stiffness(dofs(i), dofs(i))), i=1, size(dofs))]
      end if
      stiffness = max(stiffness, min_stiffness_ratio*maxval(stiffness))
      softness = 1.0_wp
      where (stiffness >= tiny(1.0_wp)) softness = 1.0_wp/stiffness
   end function softness

   !> Creates coordinates of a structure, ordered by the degrees of freedom that they replace.
   subroutine new_coordinates_of_shape(self, structure, dofs, shape)
      type(coordinates_t), intent(out) :: self
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: dofs(:)                                  !! all different
      real(wp), intent(in) :: shape(:, :)                             !! (size(dofs), n) with independent columns
      integer :: i

      call new_coordinates(self, structure, dofs, [coordinate_part_t([(i, i=1, size(dofs))], shape)])
   end subroutine new_coordinates_of_shape

   !> The same from the parts of the shape.
   subroutine new_coordinates_of_parts(self, structure, dofs, parts)
      type(coordinates_t), intent(out) :: self
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: dofs(:)                                  !! all different
      type(coordinate_part_t), intent(in) :: parts(:)                 !! which contain each degree of freedom once
      type(entries_t) :: functionals, of_others, of_z
      integer :: column_at(size(dofs)), i, number(size(dofs)), part
      real(wp) :: weight(size(dofs))

      self%are_dofs = .false.
      self%dofs = dofs
      weight = sqrt(softness(structure, dofs))
      do part = 1, size(parts)
         associate (members => parts(part)%members)
            call find_pivots(parts(part)%shape, weight(members), number(:size(members)))
            column_at(members) = number(:size(members))
         end associate
      end do
      self%n = count(column_at > 0)
      self%positions = pack(dofs, column_at > 0)
      self%others = pack(dofs, column_at == 0)
      number(pack([(i, i=1, size(dofs))], column_at > 0)) = [(i, i=1, self%n)]
      number(pack([(i, i=1, size(dofs))], column_at == 0)) = [(i, i=1, size(self%others))]
      do part = 1, size(parts)
         call add_part(parts(part), column_at(parts(part)%members), number(parts(part)%members), functionals, of_z, of_others)
      end do
      self%functionals = functionals%matrix(self%n, size(dofs))
      self%of_z = of_z%matrix(self%n, self%n)
      self%of_others = of_others%matrix(self%n, size(self%others))
   end subroutine new_coordinates_of_parts

   !> Adds the blocks of a part to the matrices of all.
   subroutine add_part(part, column_at, number, functionals, of_z, of_others)
      type(coordinate_part_t), intent(in) :: part
      integer, intent(in) :: column_at(:)                             !! of its shape, at each pivot; 0: no pivot
      integer, intent(in) :: number(:) !! of each pivot among all pivots, of each other among all others
      type(entries_t), intent(inout) :: functionals, of_z, of_others
      integer, allocatable :: others(:), pivots(:), swapped(:)
      real(wp), allocatable :: factors(:, :), inverse(:, :), shape(:, :)
      integer :: i, info, n

      pivots = pack([(i, i=1, size(number))], column_at > 0)
      others = pack([(i, i=1, size(number))], column_at == 0)
      n = size(pivots)
      shape = part%shape(:, column_at(pivots))
      factors = transpose(shape(pivots, :))
      allocate (inverse(n, n), source=0.0_wp)
      allocate (swapped(n))
      do i = 1, n
         inverse(i, i) = 1.0_wp
      end do
      call dgetrf(n, n, factors, n, swapped, info)
      call dgetrs("N", n, n, factors, n, swapped, inverse, n, info)
      call functionals%add(number(pivots), part%members, transpose(shape))
      call of_z%add(number(pivots), number(pivots), inverse)
      call of_others%add(number(pivots), number(others), -matmul(inverse, transpose(shape(others, :))))
   end subroutine add_part

   !> Adds a block, without its zeros.
   subroutine entries_add(self, rows, columns, block)
      class(entries_t), intent(inout) :: self
      integer, intent(in) :: rows(:), columns(:)
      real(wp), intent(in) :: block(:, :)                             !! (size(rows), size(columns))
      integer :: i, k

      if (.not. allocated(self%value)) allocate (self%row(64), self%column(64), self%value(64))
      do k = 1, size(columns)
         do i = 1, size(rows)
            if (.not. abs(block(i, k)) > 0.0_wp) cycle
            if (self%n == size(self%value)) then
               self%row = [self%row, self%row]
               self%column = [self%column, self%column]
               self%value = [self%value, self%value]
            end if
            self%n = self%n + 1
            self%row(self%n) = rows(i)
            self%column(self%n) = columns(k)
            self%value(self%n) = block(i, k)
         end do
      end do
   end subroutine entries_add

   !> The matrix of the entries.
   function entries_matrix(self, n_rows, n_columns) result(matrix)
      class(entries_t), intent(in) :: self
      integer, intent(in) :: n_rows, n_columns
      type(sparse_t) :: matrix

      if (allocated(self%value)) then
         matrix = sparse_from_entries(n_rows, self%row(:self%n), self%column(:self%n), self%value(:self%n), n_columns)
      else
         matrix = sparse_from_entries(n_rows, [integer ::], [integer ::], [real(wp) ::], n_columns)
      end if
   end function entries_matrix

   !> Assigns a row of its own to each column of the shape.
   pure subroutine find_pivots(shape, weight, column_at)
      real(wp), intent(in) :: shape(:, :), weight(:)                  !! (m, n), (m)
      integer, intent(out) :: column_at(:)                            !! (m), 0: no pivot
      real(wp) :: row(size(shape, 2))
      real(wp), allocatable :: remainder(:, :)                        ! may be large: not on the stack
      integer :: at(2), j, k

      allocate (remainder, source=spread(weight, 2, size(shape, 2))*shape)
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
      if (are_equal .and. .not. self%are_dofs) are_equal = self%functionals%equal(other%functionals)
   end function coordinates_equal

   !> Finds the weights of a coordinate.
   pure subroutine coordinates_find_functional(self, number, at, weights)
      class(coordinates_t), intent(in) :: self
      integer, intent(in) :: number                                   !! of the coordinate
      integer, allocatable, intent(out) :: at(:)                      !! positions in `dofs` where the weights are not zero
      real(wp), allocatable, intent(out) :: weights(:)                !! (size(at))

      if (self%are_dofs) then
         at = [number]
         weights = [1.0_wp]
         return
      end if
      associate (first => self%functionals%first(number), last => self%functionals%first(number + 1) - 1)
         at = self%functionals%column(first:last)
         weights = self%functionals%value(first:last)
      end associate
   end subroutine coordinates_find_functional

   !> Number of the coordinate that is a degree of freedom of the structure; 0 if there is none.
   pure integer function coordinates_number_of(self, dof) result(number)
      class(coordinates_t), intent(in) :: self
      integer, intent(in) :: dof

      number = position_in(self%positions, dof)
      if (number == 0 .or. self%are_dofs) return
      associate (e => self%functionals%first(number))
         if (self%functionals%n_in_row(number) /= 1 .or. abs(self%functionals%value(e) - 1.0_wp) > 0.0_wp) number = 0
      end associate
   end function coordinates_number_of

   !> Coordinates of motions of the degrees of freedom in the shape.
   pure function coordinates_values_of(self, q) result(z)
      class(coordinates_t), intent(in) :: self
      real(wp), intent(in) :: q(:, :)                                 !! [m], (any, size(dofs))
      real(wp) :: z(size(q, 1), self%n)
      integer :: e, i

      if (self%are_dofs) then
         z = q
         return
      end if
      z = 0.0_wp
      do i = 1, self%n
         do e = self%functionals%first(i), self%functionals%first(i + 1) - 1
            z(:, i) = z(:, i) + self%functionals%value(e)*q(:, self%functionals%column(e))
         end do
      end do
   end function coordinates_values_of

   !> Amplitudes of the coordinates from those of all degrees of freedom.
   pure function coordinates_amplitudes_of(self, c) result(z)
      class(coordinates_t), intent(in) :: self
      complex(wp), intent(in) :: c(:, :)                              !! [m], (all degrees of freedom, any)
      complex(wp) :: z(self%n, size(c, 2))

      if (self%are_dofs) then
         z = c(self%dofs, :)
      else
         z = product_of(self%functionals, c(self%dofs, :))
      end if
   end function coordinates_amplitudes_of

   !> Forces on the degrees of freedom from those on the coordinates.
   pure function coordinates_spread_forces(self, f) result(forces)
      class(coordinates_t), intent(in) :: self
      real(wp), intent(in) :: f(:, :)                                 !! [N], (any, n)
      real(wp) :: forces(size(f, 1), size(self%dofs))
      integer :: e, i

      if (self%are_dofs) then
         forces = f
         return
      end if
      forces = 0.0_wp
      do i = 1, self%n
         do e = self%functionals%first(i), self%functionals%first(i + 1) - 1
            associate (at => self%functionals%column(e))
               forces(:, at) = forces(:, at) + self%functionals%value(e)*f(:, i)
            end associate
         end do
      end do
   end function coordinates_spread_forces

   !> Expresses the shape of a law, linear functionals of degrees of freedom, in these coordinates; it is in their
   !> span.
   pure subroutine coordinates_place(self, dofs, shape)
      class(coordinates_t), intent(in) :: self
      integer, allocatable, intent(inout) :: dofs(:)                  !! on return numbers of coordinates
      real(wp), allocatable, intent(inout) :: shape(:, :)             !! (size(dofs), any)
      real(wp), allocatable :: in_coordinates(:, :)
      integer, allocatable :: used(:)
      integer :: at, e, i, k

      if (self%are_dofs) then
         dofs = [(position_in(self%dofs, dofs(k)), k=1, size(dofs))]
         return
      end if
      used = coordinates_at(self, dofs)
      allocate (in_coordinates(size(used), size(shape, 2)), source=0.0_wp)
      do k = 1, size(dofs)
         i = position_in(self%positions, dofs(k))
         if (i == 0) cycle
         do e = self%of_z%first(i), self%of_z%first(i + 1) - 1
            at = position_in(used, self%of_z%column(e))
            in_coordinates(at, :) = in_coordinates(at, :) + self%of_z%value(e)*shape(k, :)
         end do
      end do
      associate (largest => maxval(abs(in_coordinates)))
         where (abs(in_coordinates) < entry_rounding*largest) in_coordinates = 0.0_wp
         where (abs(in_coordinates - 1.0_wp) < entry_rounding*largest) in_coordinates = 1.0_wp
      end associate
      associate (is_used => any(abs(in_coordinates) > 0.0_wp, dim=2))
         if (.not. any(is_used)) then                                 ! a law without coordinates
            dofs = [1]
            shape = 0.0_wp*shape(:1, :)
            return
         end if
         dofs = pack(used, is_used)
         shape = in_coordinates(pack([(i, i=1, size(used))], is_used), :)
      end associate
   end subroutine coordinates_place

   !> Numbers of the coordinates that depend on some degrees of freedom, ascending.
   pure function coordinates_at(self, dofs) result(numbers)
      class(coordinates_t), intent(in) :: self
      integer, intent(in) :: dofs(:)
      integer, allocatable :: numbers(:)
      integer :: e, i, k, n

      allocate (numbers(0))
      do k = 1, size(dofs)
         i = position_in(self%positions, dofs(k))
         if (i == 0) cycle
         do e = self%of_z%first(i), self%of_z%first(i + 1) - 1
            n = count(numbers < self%of_z%column(e))
            if (all(numbers /= self%of_z%column(e))) numbers = [numbers(:n), self%of_z%column(e), numbers(n + 1:)]
         end do
      end do
   end function coordinates_at

   !> Position of a number in a list, 0 if it is not there; at once if the list is ascending, as those of models are.
   pure integer function position_in(list, number) result(position)
      integer, intent(in) :: list(:), number
      integer :: last, middle

      position = 1
      last = size(list)
      do while (position < last)
         middle = (position + last)/2
         if (list(middle) < number) then
            position = middle + 1
         else
            last = middle
         end if
      end do
      if (size(list) > 0) then
         if (list(position) == number) return
      end if
      position = findloc(list, number, dim=1)
   end function position_in

   !> Weights at `dofs` of a linear functional of some coordinates.
   pure function coordinates_weights_of(self, numbers, functional) result(weights)
      class(coordinates_t), intent(in) :: self
      integer, intent(in) :: numbers(:)                               !! of coordinates
      real(wp), intent(in) :: functional(:)                           !! (size(numbers))
      real(wp) :: weights(size(self%dofs))
      integer :: e, i

      weights = 0.0_wp
      if (self%are_dofs) then
         weights(numbers) = functional
         return
      end if
      do i = 1, size(numbers)
         do e = self%functionals%first(numbers(i)), self%functionals%first(numbers(i) + 1) - 1
            associate (at => self%functionals%column(e))
               weights(at) = weights(at) + functional(i)*self%functionals%value(e)
            end associate
         end do
      end do
   end function coordinates_weights_of

   !> The structure in these coordinates: T^T M T, the same for damping and stiffness, T^T a and T^T b for parts.
   function coordinates_structure_in(self, structure) result(turned)
      class(coordinates_t), intent(in) :: self
      type(structure_t), intent(in) :: structure
      type(structure_t) :: turned
      type(sparse_t) :: t
      integer :: i

      turned = structure
      if (self%are_dofs) return
      t = transformation(self, structure%n_dofs)
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

         matrix = transpose(times_t(transpose(times_t(matrix))))
      end subroutine turn

      function times_t(matrix) result(product)
         real(wp), intent(in) :: matrix(:, :)
         real(wp), allocatable :: product(:, :)
         integer :: e, row

         allocate (product(size(matrix, 1), size(matrix, 2)), source=0.0_wp)
         do row = 1, t%n_rows
            do e = t%first(row), t%first(row + 1) - 1
               associate (column => t%column(e))
                  product(:, column) = product(:, column) + t%value(e)*matrix(:, row)
               end associate
            end do
         end do
      end function times_t

      subroutine turn_vector(vector)
         real(wp), intent(inout) :: vector(:)
         real(wp) :: given(1, size(vector))

         given(1, :) = vector
         vector = reshape(times_t(given), shape(vector))
      end subroutine turn_vector

      subroutine turn_sparse(matrix)
         type(sparse_t), intent(inout) :: matrix

         matrix = sparse_product(sparse_transpose(t), sparse_product(matrix, t))
      end subroutine turn_sparse
   end function coordinates_structure_in

   !> T as a sparse matrix.
   function transformation(self, n_dofs) result(t)
      class(coordinates_t), intent(in) :: self
      integer, intent(in) :: n_dofs
      type(sparse_t) :: t
      type(entries_t) :: entries
      real(wp), parameter :: unit_entry(1, 1) = 1.0_wp
      logical :: is_replaced(n_dofs)
      integer :: e, i

      is_replaced = .false.
      is_replaced(self%positions) = .true.
      do i = 1, n_dofs
         if (.not. is_replaced(i)) call entries%add([i], [i], unit_entry)
      end do
      do i = 1, self%n
         associate (row => self%positions(i:i))
            do e = self%of_z%first(i), self%of_z%first(i + 1) - 1
               call entries%add(row, self%positions(self%of_z%column(e:e)), self%of_z%value(e)*unit_entry)
            end do
            do e = self%of_others%first(i), self%of_others%first(i + 1) - 1
               call entries%add(row, self%others(self%of_others%column(e:e)), self%of_others%value(e)*unit_entry)
            end do
         end associate
      end do
      t = entries%matrix(n_dofs, n_dofs)
   end function transformation

   !> Product of a sparse matrix and columns.
   pure function product_of(matrix, columns) result(product)
      type(sparse_t), intent(in) :: matrix
      complex(wp), intent(in) :: columns(:, :)
      complex(wp) :: product(matrix%n_rows, size(columns, 2))
      integer :: e, i

      product = (0.0_wp, 0.0_wp)
      do i = 1, matrix%n_rows
         do e = matrix%first(i), matrix%first(i + 1) - 1
            product(i, :) = product(i, :) + matrix%value(e)*columns(matrix%column(e), :)
         end do
      end do
   end function product_of

   !> Forces, or gradients, in these coordinates from those on all degrees of freedom: T^T f.
   pure function coordinates_forces_in(self, forces) result(turned)
      class(coordinates_t), intent(in) :: self
      complex(wp), intent(in) :: forces(:, :)                         !! (all degrees of freedom, any)
      complex(wp) :: turned(size(forces, 1), size(forces, 2))
      integer :: e, i

      turned = forces
      if (self%are_dofs) return
      turned(self%positions, :) = (0.0_wp, 0.0_wp)
      do i = 1, self%n
         associate (f => forces(self%positions(i), :))
            do e = self%of_z%first(i), self%of_z%first(i + 1) - 1
               associate (at => self%positions(self%of_z%column(e)))
                  turned(at, :) = turned(at, :) + self%of_z%value(e)*f
               end associate
            end do
            do e = self%of_others%first(i), self%of_others%first(i + 1) - 1
               associate (at => self%others(self%of_others%column(e)))
                  turned(at, :) = turned(at, :) + self%of_others%value(e)*f
               end associate
            end do
         end associate
      end do
   end function coordinates_forces_in

   !> Transforms y to the motion of all degrees of freedom, q = T y.
   pure subroutine coordinates_motion_from(self, y)
      class(coordinates_t), intent(in) :: self
      complex(wp), intent(inout) :: y(:, :)                           !! [m], (all degrees of freedom, any)

      if (self%are_dofs) return
      y(self%positions, :) = product_of(self%of_z, y(self%positions, :)) + product_of(self%of_others, y(self%others, :))
   end subroutine coordinates_motion_from
end module hb_coordinates
