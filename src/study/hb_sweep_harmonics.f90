!> The union of the harmonic sets of all points of a sweep, so that its file can be laid out before any is solved.
!>
!> Every combination of swept values of `&harmonics` is read, but of boxes and diamonds that lie within one another only the
!> largest are made: a sweep over N orders takes a time in proportion to N.
module hb_sweep_harmonics
   use hb_certificate, only: choose_wider_set, wider_orders
   use hb_document, only: document_t
   use hb_error, only: annotate, error_t
   use hb_harmonics, only: harmonics_t
   use hb_sweep_plan, only: sweep_plan_t
   use hb_text, only: to_text
   use hb_truncation, only: box_truncation, read_truncation, truncation_t
   use hb_tuple_union, only: tuple_union_t
   implicit none
   private
   public :: tuples_of_sweep

   character(*), parameter :: group = "harmonics"

   !> Truncations of which none contains another, with the points that have them.
   type :: largest_t
      integer :: n = 0
      type(truncation_t), allocatable :: truncations(:)
      integer, allocatable :: points(:)
   contains
      procedure :: add => largest_add
   end type largest_t

contains

   !> Collects the tuples of all points: those of the first point come first, those that others add follow.
   subroutine tuples_of_sweep(tuples, first, plan, input, has_improved, error)
      integer, allocatable, intent(out) :: tuples(:, :)               !! (n_tones, any), each once
      type(harmonics_t), intent(in) :: first                          !! set of the first point
      type(sweep_plan_t), intent(in) :: plan
      type(document_t), intent(in) :: input                           !! before values of the sweep are set
      logical, intent(in) :: has_improved                             !! with the wider sets of improved motions
      type(error_t), allocatable, intent(out) :: error
      type(tuple_union_t) :: union

      call union%add(first%tuples)
      if (has_improved) call add_wider(union, first, error)
      if (.not. allocated(error)) call add_points(union, plan, input, first%n_tones, has_improved, error)
      if (.not. allocated(error)) tuples = union%list()
   end subroutine tuples_of_sweep

   !> Adds what the sets of the other points have.
   subroutine add_points(union, plan, input, n_tones, has_improved, error)
      type(tuple_union_t), intent(inout) :: union
      type(sweep_plan_t), intent(in) :: plan
      type(document_t), intent(in) :: input
      integer, intent(in) :: n_tones
      logical, intent(in) :: has_improved
      type(error_t), allocatable, intent(out) :: error
      type(document_t), target :: document
      type(truncation_t) :: truncation
      type(largest_t) :: largest, wider
      logical, allocatable :: axes(:)
      integer :: i, point

      axes = plan%axes_of(group)
      if (.not. any(axes)) return
      document = input
      do i = 1, plan%n_combinations(axes)
         point = plan%point_of_combination(axes, i)
         call plan%apply(point, document)
         if (i > 1 .and. .not. document%has_changed([group])) cycle
         call document%begin()
         call read_truncation(truncation, document, n_tones, error)
         call document%accept_changes()
         if (.not. allocated(error)) then
            if (truncation%set == "list") then
               call add_set(union, truncation, has_improved, error)
            else
               call largest%add(truncation, point, error)
               if (has_improved .and. .not. allocated(error)) &
                  call wider%add(box_truncation(wider_orders(truncation%highest())), point, error)
            end if
         end if
         if (allocated(error)) then
            call annotate(error, place_of(point))
            return
         end if
      end do
      call add_largest(union, largest, error)
      if (.not. allocated(error)) call add_largest(union, wider, error)
   end subroutine add_points

   !> Keeps a truncation unless one that is there contains it, and drops those that it contains. What could not be made is
   !> an error at once.
   subroutine largest_add(self, truncation, point, error)
      class(largest_t), intent(inout) :: self
      type(truncation_t), intent(in) :: truncation
      integer, intent(in) :: point
      type(error_t), allocatable, intent(out) :: error
      type(truncation_t), allocatable :: longer(:)
      type(harmonics_t) :: set
      integer :: i, n

      if (truncation%cannot_be_made()) then
         call truncation%make(set, error)
         if (allocated(error)) return
      end if
      do i = 1, self%n
         if (self%truncations(i)%contains(truncation)) return
      end do
      n = 0
      do i = 1, self%n
         if (truncation%contains(self%truncations(i))) cycle
         n = n + 1
         if (n == i) cycle
         self%truncations(n) = self%truncations(i)
         self%points(n) = self%points(i)
      end do
      self%n = n + 1
      if (.not. allocated(self%truncations)) allocate (self%truncations(4), self%points(4))
      if (self%n > size(self%truncations)) then
         allocate (longer(2*self%n))
         longer(:n) = self%truncations(:n)
         call move_alloc(longer, self%truncations)
         self%points = [self%points(:n), spread(0, 1, 2*self%n - n)]
      end if
      self%truncations(self%n) = truncation
      self%points(self%n) = point
   end subroutine largest_add

   subroutine add_largest(union, largest, error)
      type(tuple_union_t), intent(inout) :: union
      type(largest_t), intent(in) :: largest
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      do i = 1, largest%n
         call add_set(union, largest%truncations(i), .false., error)
         if (allocated(error)) then
            call annotate(error, place_of(largest%points(i)))
            return
         end if
      end do
   end subroutine add_largest

   !> Makes a set and adds its tuples.
   subroutine add_set(union, truncation, has_improved, error)
      type(tuple_union_t), intent(inout) :: union
      type(truncation_t), intent(in) :: truncation
      logical, intent(in) :: has_improved                             !! with its wider set
      type(error_t), allocatable, intent(out) :: error
      type(harmonics_t) :: set

      call truncation%make(set, error)
      if (allocated(error)) return
      call union%add(set%tuples)
      if (has_improved) call add_wider(union, set, error)
   end subroutine add_set

   !> Adds the tuples that an improved motion has beyond those of its set.
   subroutine add_wider(union, set, error)
      type(tuple_union_t), intent(inout) :: union
      type(harmonics_t), intent(in) :: set
      type(error_t), allocatable, intent(out) :: error
      type(harmonics_t) :: wider

      call choose_wider_set(set, wider, error)
      if (.not. allocated(error)) call union%add(wider%tuples)
   end subroutine add_wider

   !> Where a message belongs.
   function place_of(point) result(place)
      integer, intent(in) :: point
      character(:), allocatable :: place

      place = "point "//to_text(point)//" of the sweep"
   end function place_of
end module hb_sweep_harmonics
