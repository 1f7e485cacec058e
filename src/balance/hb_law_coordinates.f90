!> The coordinates of the unknowns of a model: those of its laws, instead of all degrees of freedom involved, and degrees
!> of freedom that are wanted, whether or not a law acts on them.
!> Three stops on a modal beam are three coordinates. Laws that share degrees of freedom form a part; in each part the
!> coordinates of rigid laws come first and unchanged, so that each has its own reaction, then wanted degrees of
!> freedom, then the coordinates of other laws as far as they are independent, if their number is smaller than that of
!> the degrees of freedom. Source: docs/why/theory.md, section 4.
module hb_law_coordinates
   use hb_condensation, only: condensed_half_bandwidth
   use hb_contact_flexibility, only: pays_to_factorise
   use hb_coordinates, only: coordinate_part_t, coordinates_t, dofs_as_coordinates, new_coordinates, position_in, softness
   use hb_kinds, only: wp
   use hb_law, only: law_box_t
   use hb_structure, only: structure_t
   use hb_thresholds, only: rounding_level, small_share
   implicit none
   private
   public :: dofs_of_unknowns, laws_at, new_law_coordinates

   integer, parameter :: max_columns = 500                            !! of a part; the work grows with their third power

   !> Columns of a part found so far.
   type :: span_t
      integer :: n = 0
      real(wp), allocatable :: weight(:)                              ! of each degree of freedom of the part in products
      real(wp), allocatable :: shape(:, :), orthonormal(:, :)         ! (members, room), the latter of weight*shape
   contains
      procedure :: add => span_add
   end type span_t

   !> Numbers in several groups: those of group i are numbers(first(i):first(i + 1) - 1), in their order.
   type :: grouped_t
      integer, allocatable :: first(:), numbers(:)
   end type grouped_t

contains

   !> Degrees of freedom of the structure on which any law acts or which are wanted, ascending, each once.
   pure function dofs_of_unknowns(laws, wanted) result(dofs)
      type(law_box_t), intent(in) :: laws(:)
      integer, intent(in) :: wanted(:)
      integer, allocatable :: dofs(:)
      logical, allocatable :: is_used(:)
      integer :: i, last

      last = max(0, maxval(wanted))
      do i = 1, size(laws)
         last = max(last, maxval(laws(i)%law%dofs))
      end do
      allocate (is_used(last), source=.false.)
      do i = 1, size(laws)
         is_used(laws(i)%law%dofs) = .true.
      end do
      is_used(wanted) = .true.
      dofs = pack([(i, i=1, last)], is_used)
   end function dofs_of_unknowns

   !> The laws on coordinates: their degrees of freedom are indices of these.
   function laws_at(coordinates, laws) result(placed)
      type(coordinates_t), intent(in) :: coordinates
      type(law_box_t), intent(in) :: laws(:)                          !! on degrees of freedom of the structure
      type(law_box_t), allocatable :: placed(:)
      integer :: i

      placed = laws
      do i = 1, size(placed)
         call coordinates%place(placed(i)%law%dofs, placed(i)%law%shape)
      end do
   end function laws_at

   !> Finds the coordinates of the laws of a model.
   subroutine new_law_coordinates(self, structure, laws, wanted)
      type(coordinates_t), intent(out) :: self
      type(structure_t), intent(in) :: structure
      type(law_box_t), intent(in) :: laws(:)
      integer, intent(in) :: wanted(:)                                !! degrees of freedom that are coordinates in any case
      type(coordinate_part_t), allocatable :: parts(:)
      integer, allocatable :: dofs(:)
      integer :: i

      dofs = dofs_of_unknowns(laws, wanted)
      if (any([(size(laws(i)%law%shape, 1) > size(laws(i)%law%shape, 2), i=1, size(laws))])) then
         call find_parts(parts, structure, laws, dofs, wanted)
         if (sum([(size(parts(i)%shape, 2), i=1, size(parts))]) < size(dofs)) then
            call new_coordinates(self, structure, dofs, parts)
            if (is_worth_it(self, structure)) return
         end if
      end if
      self = dofs_as_coordinates(dofs)
   end subroutine new_law_coordinates

   !> The parts of the coordinates: degrees of freedom of one law are in the same part.
   subroutine find_parts(parts, structure, laws, dofs, wanted)
      type(coordinate_part_t), allocatable, intent(out) :: parts(:)
      type(structure_t), intent(in) :: structure
      type(law_box_t), intent(in) :: laws(:)
      integer, intent(in) :: dofs(:), wanted(:)                       !! ascending
      type(grouped_t) :: laws_of, members_of, wanted_of
      integer :: i, k, n_parts, part_of(size(dofs))
      real(wp) :: weight(size(dofs))

      weight = sqrt(softness(structure, dofs))
      call number_parts(laws, dofs, part_of, n_parts)
      members_of = grouped(part_of, n_parts)
      laws_of = grouped([(part_of(position_in(dofs, laws(i)%law%dofs(1))), i=1, size(laws))], n_parts)
      wanted_of = grouped([(part_of(position_in(dofs, wanted(i))), i=1, size(wanted))], n_parts)
      allocate (parts(n_parts))
      do k = 1, n_parts
         parts(k)%members = members_of%numbers(members_of%first(k):members_of%first(k + 1) - 1)
         call find_shape(parts(k)%shape, laws, laws_of%numbers(laws_of%first(k):laws_of%first(k + 1) - 1), &
                         dofs(parts(k)%members), wanted(wanted_of%numbers(wanted_of%first(k):wanted_of%first(k + 1) - 1)), &
                         weight(parts(k)%members))
      end do
   end subroutine find_parts

   !> Sorts the numbers 1, 2, 3, ... by their groups.
   pure function grouped(group_of, n_groups) result(self)
      integer, intent(in) :: group_of(:)
      integer, intent(in) :: n_groups
      type(grouped_t) :: self
      integer :: i, next(n_groups + 1)

      next = 0
      do i = 1, size(group_of)
         next(group_of(i) + 1) = next(group_of(i) + 1) + 1
      end do
      next(1) = 1
      do i = 1, n_groups
         next(i + 1) = next(i) + next(i + 1)
      end do
      allocate (self%first, source=next)
      allocate (self%numbers(size(group_of)))
      do i = 1, size(group_of)
         self%numbers(next(group_of(i))) = i
         next(group_of(i)) = next(group_of(i)) + 1
      end do
   end function grouped

   !> Finds the columns of a part.
   subroutine find_shape(shape, laws, own, dofs, wanted, weight)
      real(wp), allocatable, intent(out) :: shape(:, :)               !! (size(dofs), any)
      type(law_box_t), intent(in) :: laws(:)
      integer, intent(in) :: own(:)                                   !! numbers of the laws of the part
      integer, intent(in) :: dofs(:), wanted(:)                       !! of the part, ascending
      real(wp), intent(in) :: weight(:)                               !! (size(dofs))
      type(span_t) :: span
      integer :: at, i, k, most, pass
      logical :: is_literal, is_retained

      most = min(size(dofs), size(wanted) + sum([(size(laws(own(i))%law%shape, 2), i=1, size(own))]))
      is_retained = most <= max_columns
      allocate (span%shape(size(dofs), most), span%orthonormal(size(dofs), most))
      span%weight = weight
      do pass = 1, merge(2, 0, is_retained)                           ! rigid laws, then others
         do i = 1, size(own)
            associate (law => laws(own(i))%law)
               if (law%is_multiplier .neqv. pass == 1) cycle
               do k = 1, size(law%shape, 2)
                  call span%add(spread_over(dofs, law%dofs, law%shape(:, k)), is_literal)
                  if (pass == 1) is_retained = is_retained .and. is_literal
               end do
            end associate
         end do
         do i = 1, merge(size(wanted), 0, pass == 1)
            at = position_in(dofs, wanted(i))
            if (is_column(span, at)) cycle
            call span%add(spread_over(dofs, wanted(i:i), [1.0_wp]), is_literal)
            is_retained = is_retained .and. is_literal
         end do
      end do
      if (is_retained .and. span%n < size(dofs)) then
         shape = span%shape(:, :span%n)
         return
      end if
      allocate (shape(size(dofs), size(dofs)), source=0.0_wp)         ! nothing gained: the degrees of freedom themselves
      do k = 1, size(dofs)
         shape(k, k) = 1.0_wp
      end do
   end subroutine find_shape

   !> Whether a coordinate is the degree of freedom at this position.
   pure logical function is_column(span, at)
      type(span_t), intent(in) :: span
      integer, intent(in) :: at
      integer :: k

      is_column = any([(span%shape(at, k) == 1.0_wp .and. count(span%shape(:, k) /= 0.0_wp) == 1, k=1, span%n)])
   end function is_column

   !> Numbers the parts of degrees of freedom in the order of their first ones.
   pure subroutine number_parts(laws, dofs, part_of, n_parts)
      type(law_box_t), intent(in) :: laws(:)
      integer, intent(in) :: dofs(:)                                  !! ascending
      integer, intent(out) :: part_of(:)                              !! (size(dofs))
      integer, intent(out) :: n_parts
      integer :: a, b, first(size(dofs)), i, k ! each points to an earlier one of its part, the first to itself

      first = [(k, k=1, size(dofs))]
      do i = 1, size(laws)
         a = first_of(position_in(dofs, laws(i)%law%dofs(1)))
         do k = 2, size(laws(i)%law%dofs)
            b = first_of(position_in(dofs, laws(i)%law%dofs(k)))
            first(max(a, b)) = min(a, b)
            a = min(a, b)
         end do
      end do
      n_parts = 0
      do k = 1, size(dofs)
         if (first(k) == k) n_parts = n_parts + 1
         if (first(k) == k) part_of(k) = n_parts
         if (first(k) < k) part_of(k) = part_of(first(k))
      end do

   contains

      pure integer function first_of(member)
         integer, intent(in) :: member

         first_of = member
         do while (first(first_of) /= first_of)
            first_of = first(first_of)
         end do
      end function first_of
   end subroutine number_parts

   !> Adds a column if it is independent of the previous ones: unchanged, or only its independent component if that is
   !> small.
   pure subroutine span_add(self, column, is_literal)
      class(span_t), intent(inout) :: self
      real(wp), intent(in) :: column(:)
      logical, intent(out) :: is_literal                              !! it is a column now
      real(wp) :: orthogonal(size(column)), share
      integer :: pass

      is_literal = .false.
      if (self%n == size(self%shape, 2)) return
      orthogonal = self%weight*column
      associate (part => self%orthonormal(:, :self%n))
         do pass = 1, 2
            orthogonal = orthogonal - matmul(part, matmul(orthogonal, part))
         end do
      end associate
      associate (whole => norm2(self%weight*column))
         if (norm2(orthogonal) <= rounding_level*whole) return
         share = norm2(orthogonal)/whole
      end associate
      self%n = self%n + 1
      self%orthonormal(:, self%n) = orthogonal/norm2(orthogonal)
      is_literal = share > small_share                                ! else only its independent part is the coordinate
      self%shape(:, self%n) = merge(column, orthogonal/(share*self%weight), is_literal)
   end subroutine span_add

   !> Weights of a linear functional over all degrees of freedom of a part.
   pure function spread_over(dofs, own, weights) result(wide)
      integer, intent(in) :: dofs(:), own(:)
      real(wp), intent(in) :: weights(:)                              !! (size(own))
      real(wp) :: wide(size(dofs))
      integer :: k

      wide = 0.0_wp
      do k = 1, size(own)
         wide(position_in(dofs, own(k))) = weights(k)
      end do
   end function spread_over

   !> Whether the blocks of fewer coordinates cost less than those of all degrees of freedom, which may be a narrow
   !> band.
   logical function is_worth_it(self, structure)
      type(coordinates_t), intent(in) :: self
      type(structure_t), intent(in) :: structure

      is_worth_it = allocated(structure%sparse)
      if (is_worth_it) is_worth_it = pays_to_factorise(structure, self)
      if (is_worth_it) return
      is_worth_it = work(self%n, condensed_half_bandwidth(structure, self)) <= &
                    work(size(self%dofs), condensed_half_bandwidth(structure, dofs_as_coordinates(self%dofs)))

   contains

      !> Per harmonic: transforms and laws for each coordinate, factors of a block.
      pure real(wp) function work(n, half_bandwidth)
         integer, intent(in) :: n, half_bandwidth
         real(wp), parameter :: of_transforms = 1.0e3_wp

         work = n*(of_transforms + real(min(n, 3*half_bandwidth + 1), wp)**2)
      end function work
   end function is_worth_it
end module hb_law_coordinates
