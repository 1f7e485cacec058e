!> The coordinates of the unknowns of a model: those of its laws, instead of all degrees of freedom involved, and degrees
!> of freedom that are wanted, whether or not a law acts on them.
!> Three stops on a modal beam are three coordinates. Laws that share degrees of freedom form a part; in each part the
!> coordinates of rigid laws come first and unchanged, so that each has its own reaction, then wanted degrees of
!> freedom, then the coordinates of other laws as far as they are independent, if their number is smaller than that of
!> the degrees of freedom. Source: docs/why/theory.md, section 4.
module hb_law_coordinates
   use hb_condensation, only: condensed_half_bandwidth
   use hb_coordinates, only: coordinates_t, dofs_as_coordinates, new_coordinates, softness
   use hb_kinds, only: wp
   use hb_law, only: law_box_t
   use hb_structure, only: structure_t
   use hb_thresholds, only: minor, rounding
   implicit none
   private
   public :: dofs_of_unknowns, laws_at, new_law_coordinates

   !> Columns found so far.
   type :: span_t
      integer :: n = 0
      integer :: n_before = 0                                         ! of complete parts: orthogonal to all that follows
      real(wp), allocatable :: weight(:)                              ! of each degree of freedom in products
      real(wp), allocatable :: shape(:, :), orthonormal(:, :)         ! (n_dofs, n_dofs), the latter of weight*shape
   contains
      procedure :: add => span_add
   end type span_t

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
      type(span_t) :: span
      integer, allocatable :: dofs(:)
      integer :: i

      dofs = dofs_of_unknowns(laws, wanted)
      if (any([(size(laws(i)%law%shape, 1) > size(laws(i)%law%shape, 2), i=1, size(laws))])) then
         call find_span(span, structure, laws, dofs, wanted)
         if (span%n < size(dofs)) then
            call new_coordinates(self, structure, dofs, span%shape(:, :span%n))
            if (is_worth_it(self, structure)) return
         end if
      end if
      self = dofs_as_coordinates(dofs)
   end subroutine new_law_coordinates

   !> Columns of all parts, one part after the other.
   subroutine find_span(span, structure, laws, dofs, wanted)
      type(span_t), intent(out) :: span
      type(structure_t), intent(in) :: structure
      type(law_box_t), intent(in) :: laws(:)
      integer, intent(in) :: dofs(:), wanted(:)
      integer :: i, k, part, part_of(size(dofs)), part_of_law(size(laws)), pass
      logical :: is_retained, is_literal

      allocate (span%shape(size(dofs), size(dofs)), span%orthonormal(size(dofs), size(dofs)))
      span%weight = sqrt(softness(structure, dofs))
      part_of = parts_of(laws, dofs)
      part_of_law = [(part_of(findloc(dofs, laws(i)%law%dofs(1), dim=1)), i=1, size(laws))]
      do part = 1, size(dofs)
         if (all(part_of /= part)) cycle
         span%n_before = span%n
         is_retained = .true.
         do pass = 1, 2                                                ! rigid laws, then others
            do i = 1, size(laws)
               associate (law => laws(i)%law)
                  if (part_of_law(i) /= part .or. (law%is_multiplier .neqv. pass == 1)) cycle
                  do k = 1, size(law%shape, 2)
                     call span%add(spread_over(dofs, law%dofs, law%shape(:, k)), is_literal)
                     if (pass == 1) is_retained = is_retained .and. is_literal
                  end do
               end associate
            end do
            do i = 1, merge(size(wanted), 0, pass == 1)
               associate (at => findloc(dofs, wanted(i), dim=1))
                  if (part_of(at) /= part) cycle
                  if (is_column(span, at)) cycle
                  call span%add(spread_over(dofs, wanted(i:i), [1.0_wp]), is_literal)
                  is_retained = is_retained .and. is_literal
               end associate
            end do
         end do
         if (is_retained .and. span%n - span%n_before < count(part_of == part)) cycle
         span%n = span%n_before                                            ! nothing gained: the degrees of freedom themselves
         do k = 1, size(dofs)
            if (part_of(k) == part) call span%add(spread_over(dofs, dofs(k:k), [1.0_wp]), is_literal)
         end do
      end do
   end subroutine find_span

   !> Whether a coordinate is the degree of freedom at this position.
   pure logical function is_column(span, at)
      type(span_t), intent(in) :: span
      integer, intent(in) :: at
      integer :: k

      is_column = any([(span%shape(at, k) == 1.0_wp .and. count(span%shape(:, k) /= 0.0_wp) == 1, k=1, span%n)])
   end function is_column

   !> Numbers of the parts of degrees of freedom; those of one law are in the same part.
   pure function parts_of(laws, dofs) result(part_of)
      type(law_box_t), intent(in) :: laws(:)
      integer, intent(in) :: dofs(:)
      integer :: part_of(size(dofs))
      integer :: first, i, k, other

      part_of = [(k, k=1, size(dofs))]
      do i = 1, size(laws)
         first = part_of(findloc(dofs, laws(i)%law%dofs(1), dim=1))
         do k = 2, size(laws(i)%law%dofs)
            other = part_of(findloc(dofs, laws(i)%law%dofs(k), dim=1))
            where (part_of == other) part_of = first
         end do
      end do
   end function parts_of

   !> Adds a column if it is independent of the previous ones: unchanged, or only its independent component if that is
   !> small.
   pure subroutine span_add(self, column, is_literal)
      class(span_t), intent(inout) :: self
      real(wp), intent(in) :: column(:)
      logical, intent(out) :: is_literal                              !! it is a column now
      real(wp) :: orthogonal(size(column)), share
      integer :: pass

      is_literal = .false.
      if (self%n == size(column)) return
      orthogonal = self%weight*column
      associate (part => self%orthonormal(:, self%n_before + 1:self%n))
         do pass = 1, 2
            orthogonal = orthogonal - matmul(part, matmul(orthogonal, part))
         end do
      end associate
      associate (whole => norm2(self%weight*column))
         if (norm2(orthogonal) <= rounding*whole) return
         share = norm2(orthogonal)/whole
      end associate
      self%n = self%n + 1
      self%orthonormal(:, self%n) = orthogonal/norm2(orthogonal)
      is_literal = share > minor                                      ! else only its independent part is the coordinate
      self%shape(:, self%n) = merge(column, orthogonal/(share*self%weight), is_literal)
   end subroutine span_add

   !> Weights of a linear functional over all degrees of freedom of laws.
   pure function spread_over(dofs, own, weights) result(wide)
      integer, intent(in) :: dofs(:), own(:)
      real(wp), intent(in) :: weights(:)                              !! (size(own))
      real(wp) :: wide(size(dofs))
      integer :: k

      wide = 0.0_wp
      do k = 1, size(own)
         wide(findloc(dofs, own(k), dim=1)) = weights(k)
      end do
   end function spread_over

   !> Whether the blocks of fewer coordinates cost less than those of all degrees of freedom, which may be a narrow
   !> band.
   logical function is_worth_it(self, structure)
      type(coordinates_t), intent(in) :: self
      type(structure_t), intent(in) :: structure

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
